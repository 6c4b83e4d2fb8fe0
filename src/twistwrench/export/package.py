"""Where an export goes: one header, one source, one test, all or none of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ValueRangeError
from ..outputs import check_outputs, replacing_together
from .document import header, source
from .request import Quantities, prefix_of, requests

if TYPE_CHECKING:
    from ..robot import Robot


def export_c(
    robot: Robot,
    quantities: Quantities,
    path: str | Path,
    *,
    precision: str = "double",
    prefix: str | None = None,
    test: bool = True,
    label: str = "path",
    inputs: Mapping[str, str | Path | None] | None = None,
) -> tuple[Path, ...]:
    """C code export; see :meth:`twistwrench.Robot.export_c`.

    Parameters
    ----------
    robot : Robot
    quantities : names as for :meth:`twistwrench.Robot.kernel`, with options as ``(name, {option: value})``
    path : str or Path, a folder, or the .c file
    precision : "double" or "float"
    prefix : str, optional, what the functions' names begin with; None: the robot's name
    test : bool, write a program that compares the functions with the kernels, too
    label : str, what the user calls ``path``, for messages
    inputs : {what the user calls it: path}, optional, files that were read: no output may overwrite them

    Returns
    -------
    paths : tuple of Path, what was written

    Raises
    ------
    UnknownNameError, KernelError, SingularMassMatrixError, ValueRangeError
        As :meth:`twistwrench.Robot.export_c`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in export_c(tw.robots.pendulum(), ["gravity_forces"], folder)]
    ['pendulum.h', 'pendulum.c', 'pendulum_test.c']
    """
    prefix = prefix_of(robot, prefix)
    plain = _source_path(path, prefix, label)
    paths = {".h": plain.with_suffix(".h"), ".c": plain}
    if test:
        paths["_test.c"] = plain.with_name(f"{plain.stem}_test.c")
    read = robot.model.source
    check_outputs(
        {label: plain, **{f"{label} (its {end})": p for end, p in paths.items() if p is not plain}},
        {"the robot": read if _is_file(read) else None, **(inputs or {})},
    )
    wanted = requests(robot, quantities, precision, prefix)
    texts = {".h": header(robot, wanted, plain.stem, prefix), ".c": source(robot, wanted, plain.stem)}
    if test:
        from .self_test import self_test

        texts["_test.c"] = self_test(robot, wanted, plain.stem)
    with replacing_together(list(paths.values())) as scratch:
        for end, file in zip(paths, scratch, strict=True):
            file.write_text(texts[end], encoding="utf-8", newline="\n")
    return tuple(paths.values())


def _source_path(path: str | Path, prefix: str, label: str) -> Path:
    """The .c file meant: the one named, or the one of the robot's name in a folder."""
    given = Path(path)
    if given.is_dir():
        return given / f"{prefix}.c"
    if given.suffix != ".c":
        raise ValueRangeError(
            f"{label} {str(path)!r} is neither a folder that exists nor a name that ends in .c. "
            f"Make the folder first, or name the source, such as {prefix}.c; the header goes beside it."
        )
    if not given.name.isprintable() or any(c in given.name for c in '"\\'):
        raise ValueRangeError(
            f"{label} {str(path)!r} cannot stand in an #include. Give a name without quotes and backslashes."
        )
    return given


def _is_file(source: str) -> bool:
    try:
        return bool(source) and Path(source).is_file()
    except OSError:  # XML text is no path
        return False
