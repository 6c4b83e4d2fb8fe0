"""Drive sizing: motors and gears from a catalogue for a repeated motion."""

from __future__ import annotations

from .choice import Sizing
from .sizing import size_drives

__all__ = ["Sizing", "size_drives"]
