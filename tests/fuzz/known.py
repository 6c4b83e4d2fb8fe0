"""Failures that are known and not mended yet: kind of files, pattern of what is found, reason. The list may only shrink."""

from __future__ import annotations

KNOWN: list[tuple[str, str, str]] = [
    ("Feather 1", "process ends|memory|takes more", "Arrow crashes in damaged files of version 1"),
    *((kind, "reaches|takes more|memory|waits", "external and virtual storage, and no bound of its size") for kind in ("HDF5", "MAT 7.3")),
    *((kind, "characters|message of|OSError|memory|MemoryError", "texts of Arrow, and a damaged page of a column") for kind in ("Parquet", "LeRobot", "Feather")),
    ("MCAP", "memory|MemoryError|takes more", "sizes of messages are not asked"),
    *((kind, "memory|takes more", "views without end") for kind in ("database", "bag folder")),
    *((kind, "memory|MemoryError|takes more|message of", "width of an array is not bounded") for kind in ("npy", "npz", "simulation npz")),
    ("limits", "message of|characters", "names in messages are not clipped"),
    *((kind, "strictly increasing", "a waypoint twice") for kind in ("waypoints",)),
    ("CSV", "takes more", "time of a header of thousands of columns"),
]  # fmt: skip
