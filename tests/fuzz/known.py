"""Failures that are known and not mended yet: kind of files, pattern of what is found, reason. The list may only shrink."""

from __future__ import annotations

KNOWN: list[tuple[str, str, str]] = []
