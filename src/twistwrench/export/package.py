"""Export of quantities as C99 (header, source and test) and as CUDA source: all files or none."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import KernelError, ValueRangeError
from ..outputs import check_outputs, replacing_together
from ..targets.cuda_text import CudaFunction
from .document import comment, header, source
from .request import Quantities, Request, prefix_of, requests

if TYPE_CHECKING:
    from ..robot import Robot

_LONGEST_CUDA = 40_000
"""Most instructions of a program exported as one CUDA kernel."""


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


def export_cuda(
    robot: Robot,
    quantities: Quantities,
    path: str | Path,
    *,
    precision: str = "double",
    prefix: str | None = None,
) -> tuple[Path, ...]:
    """CUDA source export; see :meth:`twistwrench.Robot.export_cuda`.

    Parameters
    ----------
    robot : Robot
    quantities : names as for :meth:`twistwrench.Robot.kernel`, with options as ``(name, {option: value})``
    path : str or Path, a folder, which gets a file for each kernel; or the .cu file of one kernel
    precision : "double" or "float"
    prefix : str, optional, first part of the kernels' names; None: the robot's name

    Returns
    -------
    paths : tuple of Path, the files written

    Raises
    ------
    UnknownNameError, KernelError, SingularMassMatrixError, ValueRangeError
        As :meth:`twistwrench.Robot.export_cuda`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in export_cuda(tw.robots.pendulum(), ["mass_matrix", "gravity_forces"], folder)]
    ['pendulum_mass_matrix.cu', 'pendulum_gravity_forces.cu']
    """
    wanted, given = requests(robot, quantities, precision, prefix_of(robot, prefix)), Path(path)
    if not given.is_dir() and (given.suffix != ".cu" or len(wanted) > 1):
        raise ValueRangeError(
            f"path {str(path)!r} is neither a folder that exists nor a name that ends in .cu, for one kernel. "
            "Make the folder first: each kernel is a file of its own."
        )
    files = [given / f"{request.function.name}.cu" if given.is_dir() else given for request in wanted]
    read = robot.model.source
    check_outputs({f"path ({file.name})": file for file in files}, {"the robot": read if _is_file(read) else None})
    texts = [_cuda_source(robot, request) for request in wanted]
    with replacing_together(files) as scratch:
        for file, text in zip(scratch, texts, strict=True):
            file.write_text(text, encoding="utf-8", newline="\n")
    return tuple(files)


def _cuda_source(robot: Robot, request: Request) -> str:
    """The .cu file of one request. Raises KernelError for programs that are too long for NVIDIA's compiler."""
    function = request.function
    if (length := len(function.program.instructions)) > _LONGEST_CUDA:
        raise KernelError(
            f"{request.quantity} takes {length} instructions, more than the {_LONGEST_CUDA} that NVIDIA's compiler handles "
            "in reasonable time. Export parts of it."
        )
    about = [
        f"{request.quantity} of the robot {robot.name} as a CUDA kernel, numbers of type {function.precision}. By twistwrench "
        f"{version('twistwrench')}.",
        "A thread computes a sample, a block THREADS of them; blocks: (samples + THREADS - 1) / THREADS.",
        "An input has a pointer and the number of elements from one sample to the next, 0 if one serves all.",
        "Compile with -std=c++17 -fmad=false: products that are fused are fused here. As C++ (-ffp-contract=off) the",
        "function of the same name runs all blocks on the processor.",
    ]
    return f"{comment(about)}\n{CudaFunction(function.name, function.program, function.precision).source}"


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
