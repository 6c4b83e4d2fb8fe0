"""Export as C99 or CUDA source: header, functions with comments, and files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from ...compiler.printers.c99 import FUSED_MACROS, PRECISIONS, identifier
from ...compiler.printers.cuda import CudaFunction
from ...core.errors import KernelError, ValueRangeError
from ...core.files import check_outputs, replacing_together
from ...core.glossary import complete
from ...core.numbers import file_number
from .comments import comment, comment_lines, entries
from .request import Quantities, Request, prefix_of, requests
from .self_test import self_test
from .written import Written

if TYPE_CHECKING:
    from .. import Robot


_CONVENTIONS = """\
SI units, radians. The angular part comes first: twists are (omega, v), wrenches (m, f). A pose is a 4 x 4 matrix that maps
points of the frame to the base frame. Kinds of frame quantities: body, seen in the frame itself; space, at the origin of the
base; world_aligned, at the frame's origin along the axes of the base. A wrench input is what the robot applies to the world
at that frame, expressed in it. Joint friction is included only where a function names it.
Arrays of several axes are stored row by row: entry (i, j) of an m x n matrix is element n i + j.
The functions allocate nothing, keep no state, do not branch, and call nothing but math.h. They read their inputs before they
write, so an output may be an input's array; two outputs must not overlap."""


def header(robot: Robot, requests: Sequence[Request], stem: str, prefix: str) -> str:
    """Text of the .h file: conventions, joint order, and a prototype with meaning and cost for each function.

    ``stem`` is the file's name without its ending.
    """
    precision = requests[0].function.precision
    gx, gy, gz = map(file_number, robot.gravity)
    description = [
        f"Dynamics of the robot {robot.name} in C99, numbers of type {precision}.",
        f"Written by twistwrench {version('twistwrench')}.",
        "",
        *_CONVENTIONS.split("\n"),
        f"Gravity is ({gx}, {gy}, {gz}) m/s^2 in the base frame.",
        "",
        *entries(robot),
    ]
    guard = f"{identifier(stem) or prefix}_H".upper()  # macro that keeps the header from being included twice
    if not guard[0].isalpha():
        guard = f"H_{guard}"
    prototypes = [f"{comment(comment_lines(robot, request))}\n{request.function.prototype};" for request in requests]
    sections = [
        comment(description),
        f"#ifndef {guard}\n#define {guard}",
        '#ifdef __cplusplus\nextern "C" {\n#endif',
        f"/* Entries of q, and of dq, ddq and tau. */\n"
        f"#define {prefix.upper()}_NQ {robot.nq}\n#define {prefix.upper()}_NV {robot.nv}",
        *prototypes,
        f"#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {guard} */",
    ]
    return "\n\n".join(sections) + "\n"


def source(robot: Robot, requests: Sequence[Request], stem: str) -> str:
    """Text of the .c file; ``stem`` is its name without the ending."""
    precision = requests[0].function.precision
    description = f"Dynamics of the robot {robot.name} in C99, one operation a line. See {stem}.h for the interface."
    sections = [
        comment([description]),
        f'#include "{stem}.h"\n\n#include <math.h>',
        # Clang then rounds products and sums as in the kernels; GCC does so with -ffp-contract=off.
        "#ifdef __clang__\n#pragma STDC FP_CONTRACT OFF\n#endif",
    ]
    if any(request.function.fuses for request in requests):
        fma_function = f"fma{PRECISIONS[precision]}"  # such as fmaf
        sections.append(FUSED_MACROS.format(fma=fma_function).rstrip())
    sections += [request.function.definition for request in requests]
    return "\n\n".join(sections) + "\n"


_MAX_CUDA_LENGTH = 40_000
"""Maximum number of instructions of a program exported as one CUDA kernel."""


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
) -> Written:
    """C code export; see :meth:`twistwrench.Robot.export_c`.

    Parameters
    ----------
    path : str or Path, a folder, or the .c file
    test : bool, also write a program that compares the functions with the kernels
    label : str, name of ``path`` in messages
    inputs : {name in messages: path}, optional, input files, which outputs must not overwrite

    Returns
    -------
    files : Written, a tuple of Path: header, source, and test program

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
    source_path = _source_path(path, prefix, label)
    path_by_ending = {".h": source_path.with_suffix(".h"), ".c": source_path}
    if test:
        path_by_ending["_test.c"] = source_path.with_name(f"{source_path.stem}_test.c")
    paths_by_label = {label: source_path}  # by their names in messages
    for ending, file in path_by_ending.items():
        if ending != ".c":
            paths_by_label[f"{label} (its {ending})"] = file
    protected_files: dict[str, str | Path | None] = {"the robot": file_of(robot), **(inputs or {})}
    check_outputs(paths_by_label, protected_files)  # raises ValueRangeError
    exports = requests(robot, quantities, precision, prefix)
    stem = source_path.stem
    text_by_ending = {".h": header(robot, exports, stem, prefix), ".c": source(robot, exports, stem)}
    if test:
        text_by_ending["_test.c"] = self_test(robot, exports, stem)
    with replacing_together(list(path_by_ending.values())) as temporary_files:
        for ending, file in zip(path_by_ending, temporary_files, strict=True):
            file.write_text(text_by_ending[ending], encoding="utf-8", newline="\n")
    test_command = ""
    if test:
        quoted_source = quote(str(source_path))
        quoted_test = quote(str(path_by_ending["_test.c"]))
        test_command = f"cc -O2 {quoted_source} {quoted_test} -lm && ./a.out"
    return Written(path_by_ending.values(), source_path, robot.name, test_command)


def export_cuda(
    robot: Robot, quantities: Quantities, path: str | Path, *, precision: str = "double", prefix: str | None = None
) -> tuple[Path, ...]:
    """CUDA source export; see :meth:`twistwrench.Robot.export_cuda`.

    Parameters
    ----------
    path : str or Path, a folder for one file per kernel; or the .cu file of one kernel

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
    exports = requests(robot, quantities, precision, prefix_of(robot, prefix))
    target = Path(path)
    if target.is_dir():
        files = [target / f"{request.function.name}.cu" for request in exports]
    elif target.suffix == ".cu" and len(exports) == 1:
        files = [target]
    else:
        raise ValueRangeError(
            f"path {str(path)!r} is neither a folder that exists nor a name that ends in .cu, for one kernel. "
            "Make the folder first: each kernel is a file of its own."
        )
    check_outputs({f"path ({file.name})": file for file in files}, {"the robot": file_of(robot)})
    texts = [_cuda_source(robot, request) for request in exports]
    with replacing_together(files) as temporary_files:
        for file, text in zip(temporary_files, texts, strict=True):
            file.write_text(text, encoding="utf-8", newline="\n")
    return tuple(files)


def _cuda_source(robot: Robot, request: Request) -> str:
    """Text of the .cu file of one request. Raises KernelError for programs that are too long for NVIDIA's compiler."""
    function = request.function
    instruction_count = len(function.program.instructions)
    if instruction_count > _MAX_CUDA_LENGTH:
        raise KernelError(
            f"{request.quantity} takes {instruction_count} instructions, more than the {_MAX_CUDA_LENGTH} that NVIDIA's "
            "compiler handles in reasonable time. Export parts of it."
        )
    description = [
        f"{request.quantity} of the robot {robot.name} as a CUDA kernel, numbers of type {function.precision}. By twistwrench "
        f"{version('twistwrench')}.",
        "A thread computes a sample, a block THREADS of them; blocks: (samples + THREADS - 1) / THREADS.",
        "An input has a pointer and the number of elements from one sample to the next, 0 if one serves all.",
        "Compile with -std=c++17 -fmad=false: products that are fused are fused here. As C++ (-ffp-contract=off) the",
        "function of the same name runs all blocks on the processor.",
    ]
    cuda_function = CudaFunction(function.name, function.program, function.precision)
    return f"{comment(description)}\n{cuda_function.source}"


def _source_path(path: str | Path, prefix: str, label: str) -> Path:
    """Path of the .c file: the given one, or one with the robot's name in a folder."""
    file = Path(path)
    if file.is_dir():
        return file / f"{prefix}.c"
    if file.suffix != ".c":
        raise ValueRangeError(
            f"{label} {str(path)!r} is neither a folder that exists nor a name that ends in .c. "
            f"Make the folder first, or name the source, such as {prefix}.c; the header goes beside it."
        )
    has_quote_or_backslash = any(character in file.name for character in '"\\')
    if has_quote_or_backslash or not file.name.isprintable():
        raise ValueRangeError(
            f"{label} {str(path)!r} cannot stand in an #include. Give a name without quotes and backslashes."
        )
    return file


def file_of(robot: Robot) -> str | None:
    """Path of the file that the robot was read from; None if there is no such file."""
    path_or_text = robot.model.source  # may be empty
    try:
        is_file = bool(path_or_text) and Path(path_or_text).is_file()
    except OSError:  # XML text is not a path
        return None
    return path_or_text if is_file else None


complete(globals())
