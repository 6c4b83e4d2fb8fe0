"""Drive sizing: motors and gears for a motion that repeats, chosen from a catalogue."""

from __future__ import annotations

from .choice import Sizing, size_drives

__all__ = ["Sizing", "size_drives"]
