"""Refusing, before anything runs, outputs that would destroy an input or each other, or cannot be written."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from ..errors import ValueRangeError

__all__ = ["check_outputs", "picture_path"]

_PICTURES = (".png", ".pdf", ".svg")


def picture_path(path: str) -> str:
    """The file a picture goes to: .png if nothing is said; ValueRangeError for what is no picture."""
    suffix = Path(path).suffix.lower()
    if not suffix:
        return f"{path}.png"
    if suffix not in _PICTURES:
        raise ValueRangeError(
            f"cannot draw {Path(path).name!r}: pictures of kind {suffix[1:]!r} are not made. "
            f"Choose one of {', '.join(_PICTURES)}."
        )
    return path


def check_outputs(outputs: Mapping[str, str | None], inputs: Mapping[str, str | Path | None]) -> None:
    """Both by what the user calls them, such as ``--csv``; None for those not given.

    Raises :class:`~twistwrench.ValueRangeError`.
    """
    others = {name: Path(path) for name, path in inputs.items() if path is not None}
    for name, text in outputs.items():
        if text is None:
            continue
        path = Path(text)
        for other, known in others.items():
            if _same(path, known):
                raise ValueRangeError(f"{name} {text!r} would overwrite the file of {other}. Give another name.")
        others[name] = path
        _check_writable(path)


def _same(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.is_file() and one.samefile(other)  # hard links too; devices, such as /dev/null, may be shared
    return one.resolve() == other.resolve()


def _check_writable(path: Path) -> None:
    if path.is_dir():
        raise ValueRangeError(f"cannot write {str(path)!r}: it is a folder. Give a file name.")
    folder = path.resolve().parent
    reason = "no such folder" if not folder.is_dir() else "the folder is not writable"
    special = path.exists() and not path.is_file()
    if not folder.is_dir() or not os.access(path if special else folder, os.W_OK):
        raise ValueRangeError(
            f"cannot write {str(path)!r}: {reason}. Name a file in a folder that exists and is writable."
        )
