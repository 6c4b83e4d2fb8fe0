"""Files out: written beside their final name and moved there when whole, so that no half-written file is found."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from numpy.typing import NDArray

from ..errors import ValueRangeError

Array = NDArray[Any]

__all__ = ["TableFile", "replacing"]

_PORTION = 4096


@dataclass(frozen=True, eq=False)
class TableFile:
    """A CSV file that rows are being added to."""

    file: BinaryIO

    @staticmethod
    @contextlib.contextmanager
    def writing(path: str | Path | None, header: Sequence[str]) -> Iterator[TableFile | None]:
        """Begin a file with that header, and finish it on leaving; None, and nothing written, if there is no path."""
        if path is None:
            yield None
            return
        with replacing(path) as scratch, scratch.open("wb") as file:
            file.write((",".join(header) + "\n").encode())
            yield TableFile(file)

    def write(self, rows: Array) -> None:
        """Add rows (n, columns), each number with the digits that give it back exactly."""
        # repr of a float is its shortest exact decimal; joining lists is three times as fast as np.savetxt.
        for k in range(0, len(rows), _PORTION):  # a number takes ten times its memory while it is text
            lines = [",".join(map(repr, row)) for row in rows[k : k + _PORTION].tolist()]
            self.file.write(("\n".join(lines) + "\n").encode("ascii"))


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A scratch name in the same folder; on leaving without an error the file there becomes ``path``, else it goes.

    :class:`~twistwrench.ValueRangeError` if the folder is missing or not writable.
    """
    path = Path(path)
    if path.is_dir():
        raise ValueRangeError(f"cannot write {str(path)!r}: it is a folder. Give a file name.")
    if path.exists() and not path.is_file():  # a pipe or a device is written to, never replaced
        yield path
        return
    try:
        target = path.resolve()  # a link stays a link
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent)
    except OSError as problem:
        raise ValueRangeError(
            f"cannot write {str(path)!r}: {problem.strerror}. Name a file in a folder that exists and is writable."
        ) from None
    os.close(handle)
    scratch = Path(name)
    try:
        yield scratch
        scratch.chmod(0o666 & ~_umask())  # temporary files are private; what replaces a file is as others are
        os.replace(scratch, target)  # noqa: PTH105  the atomic one, by its plain name
    except OSError as problem:
        raise ValueRangeError(
            f"cannot write {str(path)!r}: {problem.strerror}. Free space, or give another name."
        ) from None
    finally:
        scratch.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
