"""Commands about the geometry of an arm."""

from __future__ import annotations
