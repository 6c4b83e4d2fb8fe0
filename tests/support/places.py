"""Where things are: the repository, and the folder beside it."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"
"""Robot files and logs that are not part of the repository; tests that use them skip where it is absent."""
