"""Work on many files: folders and patterns as the files in them, and who does it, this process, others, or a cluster."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from pathlib import Path

import click

from ..errors import ValueRangeError
from .shared_options import option_group

worker_options = option_group(
    click.option(
        "--scheduler", metavar="ADDRESS", help="Work on the Dask cluster of this scheduler: tcp://10.0.0.1:8786."
    ),
    click.option("--workers", type=int, metavar="N", help="Work on N processes of this machine (Dask)."),
)
"""``--workers`` and ``--scheduler``."""


def files_in(path: Path, text: str) -> list[str]:
    """A folder as the files in it, a pattern as what it matches, in the order of their names; all else as it is."""
    from ..motion.ros_file import is_recording

    if any(c in text for c in "*?[") and not path.exists():
        matches = sorted(glob.glob(text))  # noqa: PTH207  the pattern may begin at the root
        if not matches:
            raise ValueRangeError(f"no file matches {text!r}.")
        return matches
    if path.is_dir() and not is_recording(path):
        inside = sorted(str(p) for p in path.iterdir() if p.is_file() and not p.name.startswith("."))
        if not inside:
            raise ValueRangeError(f"{text!r} is a folder without files.")
        return inside
    return [str(path)]


def bytes_of(paths: Sequence[str]) -> int:
    """Of files, ``a.csv+b.csv`` among them; those that cannot be seen are none."""
    total = 0
    for path in paths:
        for part in [path] if Path(path).exists() else path.split("+"):
            try:
                total += Path(part.strip()).stat().st_size * (10 if part.endswith(".gz") else 1)
            except OSError:
                continue
    return total
