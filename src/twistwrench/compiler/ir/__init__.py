"""Straight-line programs: expressions, tracing, derivatives, loops."""

from __future__ import annotations
