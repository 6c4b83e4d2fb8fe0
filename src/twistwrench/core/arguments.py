"""Validation of arguments: tables with named columns, rotations and poses, arrays and numbers.

Tables are recognised by attributes, without imports: ``columns`` (pandas, Polars), ``index`` (a row of pandas), or
``dims`` and ``coords`` (xarray).
"""

from __future__ import annotations

import math
import operator
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from numbers import Rational
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .errors import ShapeError, TwistWrenchError, UnknownNameError, ValueRangeError
from .numbers import printed
from .text import Argument, listed
from .third_party import is_lazy
from .typing import Array

_UNLABELLED_TYPES = (list, tuple, float, int)
"""Types without labels, whose attributes are not looked up."""


def is_table(x: Any) -> bool:
    """True if the last axis of ``x`` has labels."""
    return _labels(x) is not None


def columns_in_order(x: Any, what: str, names: Sequence[str]) -> Any:
    """Contents of the table ``x``, with its columns in the order of ``names``; anything else unchanged.

    Without ``names``, text labels raise ValueRangeError. Columns that are not exactly ``names`` raise UnknownNameError, whose
    message lists the unknown and the missing ones.
    """
    labels = _labels(x)
    if labels is None:
        return x
    if not names:
        if any(isinstance(label, str) for label in labels):
            raise ValueRangeError(
                f"{what} has named columns ({listed(labels)}), and is read by position. Give its numbers alone, in the order "
                "that is meant: for a data frame, df.to_numpy()."
            )
        return _contents(x)
    if labels == list(names):
        return _contents(x)
    foreign_labels = [label for label in labels if label not in names]
    missing_names = [name for name in names if name not in labels]
    repeated_labels = [label for k, label in enumerate(labels) if label in labels[:k]]
    if foreign_labels or missing_names or repeated_labels:
        labels_by_defect = {"foreign": foreign_labels, "missing": missing_names, "twice": repeated_labels}
        defect_texts = []
        for defect, defect_labels in labels_by_defect.items():
            if defect_labels:
                defect_texts.append(f"{defect}: {listed(defect_labels)}")
        defects = "; ".join(defect_texts)
        raise UnknownNameError(
            f"{what} has columns that are not the robot's. {defects[0].upper()}{defects[1:]}. Its columns must be "
            f"{listed(names)}, in any order. Choose them: df[list(names)] with names = robot.coordinate_names for "
            "q, robot.velocity_names for rates and torques; or give df.to_numpy() if they are in the robot's order already."
        )
    return _contents(x)[..., [labels.index(name) for name in names]]


def _labels(x: Any) -> list[Any] | None:
    """Labels of the last axis of a table, or those of a row of a data frame; None if ``x`` has no labels."""
    if isinstance(x, _UNLABELLED_TYPES):
        return None
    columns = getattr(x, "columns", None)
    if columns is not None and not callable(columns):
        return list(columns)
    dims, coords = getattr(x, "dims", None), getattr(x, "coords", None)
    if isinstance(dims, tuple) and coords is not None:
        if dims and dims[-1] in coords:
            return list(coords[dims[-1]].values.tolist())
        return None
    index = getattr(x, "index", None)
    if index is not None and not callable(index) and hasattr(x, "__array__"):
        return list(index)
    return None


def _contents(x: Any) -> Any:
    """Numbers of a table without their labels; a lazy array if the table is lazy."""
    if getattr(x, "dims", None) is not None and hasattr(x, "data"):
        return x.data
    return x.to_numpy()


TOLERANCE = 1e-6
"""Largest deviation of R' R from the identity for a rotation; rounding to float32 stays below it."""


def refuse(gaps: Array, allowed: float, complaint: str) -> None:
    """Raise ValueRangeError with the batch row if the largest of ``gaps`` (..., n, n) exceeds ``allowed``. NaN passes."""
    if not (gaps > allowed).any():
        return
    flat_index = int(np.nanargmax(gaps))
    index = np.unravel_index(flat_index, gaps.shape)
    batch_index = [str(i) for i in index[:-2]]
    row_text = f" (row {', '.join(batch_index)} of the batch)" if batch_index else ""
    largest_gap = printed(gaps.flat[flat_index], 3)
    message = complaint.format(gap=largest_gap, allowed=printed(allowed))
    raise ValueRangeError(f"{message}{row_text}.")


def rotation(R: Array, what: str) -> Array:
    """R (..., 3, 3) of float32, float64 or symbols, checked to be a rotation within :data:`TOLERANCE`, except symbols."""
    if R.dtype == object or _surely_rotations(R):
        return R
    allowed = max(TOLERANCE, 100 * float(np.finfo(R.dtype).eps))  # float32: errors of a chain of products
    with np.errstate(all="ignore"):
        deviation = np.abs(np.swapaxes(R, -1, -2) @ R - np.eye(3))
        reflected = np.maximum(0.0, -np.linalg.det(R))[..., None, None]
    has_infinite_entry = np.isinf(R).any(axis=(-2, -1), keepdims=True)
    refuse(
        np.where(has_infinite_entry, np.inf, deviation),  # instead of NaN, which passes
        allowed,
        f"{what} is not a rotation: R' R is {{gap}} off the identity, allowed {{allowed}}; "
        "so3.project gives the nearest one",
    )
    # ``reflected`` is 0 for a rotation and 1 for a reflection.
    refuse(reflected, 0.5, f"{what} is not a rotation but a reflection: det R = -{{gap}}; negate one axis")
    return R


def _surely_rotations(R: Array) -> bool:
    """True if two rows are orthonormal and the third is their cross product, to a fifth of the tolerance.

    Computes with floats, or with columns of a batch: every Ad and inverse calls it, and R' R takes ten times as long.
    """
    allowed = 0.2 * TOLERANCE
    if R.ndim == 2:
        return all(not abs(gap) > allowed for gap in gaps(R.tolist()))  # "not >": NaN passes
    columns = np.moveaxis(R.reshape(-1, 3, 3), 0, -1).copy()  # of each entry over the batch, contiguous
    with np.errstate(all="ignore"):  # infinite entries fail the test, without a warning
        return not any((np.abs(gap) > allowed).any() for gap in gaps(columns))


def gaps(rows: Any) -> tuple[Any, ...]:
    """Deviations of a matrix (3, 3) from a rotation: row products, and the cross product of two rows minus the third."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    return (
        a * a + b * b + c * c - 1.0,
        d * d + e * e + f * f - 1.0,
        a * d + b * e + c * f,
        b * f - c * e - g,
        c * d - a * f - h,
        a * e - b * d - i,
    )


def last_row(T: Array, what: str, allowed: float = TOLERANCE) -> None:
    """Raise ValueRangeError unless the last row of T (..., 4, 4) is (0, 0, 0, 1)."""
    if T.ndim == 2 and T[3].tolist() == [0.0, 0.0, 0.0, 1.0]:
        return
    deviation = np.abs(T[..., 3:, :] - np.array([0.0, 0.0, 0.0, 1.0]))
    refuse(deviation, allowed, f"{what} is not a pose: its last row is {{gap}} off (0, 0, 0, 1), allowed {{allowed}}")


# ``to_numbers`` and ``plain`` accept any kind of array: NumPy's unchanged, tables by the names of their columns, all else as
# ``np.asarray`` does; ``to_numbers`` keeps Dask arrays lazy. ``array``, ``real`` and ``finite`` also check types and shapes;
# ``number``, ``positive``, ``whole`` and ``integer`` are for single numbers; ``pose`` checks rotation and last row. All
# functions but ``real`` and ``finite`` pass symbols (object arrays) unchanged, so that checked functions can be traced. All but
# ``finite`` pass NaN, which arrays propagate row by row as NumPy does.

_MAX_VALUE_LENGTH = 60
"""Maximum number of characters of a given value in an error message."""
_NOT_AN_ARRAY = "is not an array of real numbers"
_FLOAT_TYPES = (np.dtype(np.float64), np.dtype(np.float32))
_REAL_NUMBER_TYPES = (int, float, np.floating, np.integer, Rational)
_KIND_NAMES = {"U": "text", "S": "bytes", "c": "complex numbers", "M": "dates", "m": "time spans", "O": "objects"}
"""Names of other contents of an array, by the ``kind`` of its NumPy type."""


def to_numbers(x: Any, what: str, names: Sequence[str] = (), *, complaint: str = _NOT_AN_ARRAY) -> Any:
    """x as an ndarray of any numbers; a Dask array is returned unchanged.

    The columns of a table (a data frame, a row of one, an array with a labelled last axis) are put in the order of ``names``;
    without names, text labels are rejected. Raises UnknownNameError for labels that are not exactly the names, ValueRangeError
    for masked entries, and ShapeError with the ``complaint`` for anything else that is not an array.
    """
    if type(x) is np.ndarray:
        return x
    try:
        x = columns_in_order(x, what, names)
        numbers = x if is_lazy(x) else np.asarray(x)
    except TwistWrenchError:
        raise
    except Exception as error:  # rows of different lengths, integers beyond floats, any error of another library
        if type(error).__module__.startswith("jax."):
            raise ShapeError(
                f"{what} is being traced by JAX, and NumPy cannot read it. Inside jit, vmap and grad use the quantity as a "
                "function of JAX arrays: robot.to_jax(name)."
            ) from None
        raise ShapeError(f"{what} {complaint}: {error}") from None
    masked_arrays = sys.modules.get("numpy.ma")  # None if nothing has imported it: then no array is masked
    if masked_arrays and isinstance(x, masked_arrays.MaskedArray) and masked_arrays.is_masked(x):
        masked_count = int(masked_arrays.getmaskarray(x).sum())
        raise ValueRangeError(
            f"{what} has {masked_count} masked entries, which are not numbers. Fill them: x.filled(np.nan) makes gaps of them."
        )
    return numbers


def of_plain(values: Sequence[Any]) -> tuple[Array, ...] | None:
    """Arrays of some arguments if each is a NumPy array, a plain list, a tuple or a number; else None."""
    if not all(type(x) in (np.ndarray, list, tuple, float, int) for x in values):
        return None
    try:
        return tuple([np.asarray(x) for x in values])
    except Exception:  # to_numbers() reports the error
        return None


def plain(x: Any, what: str, names: Sequence[str] = ()) -> Array:
    """Result of :func:`to_numbers` as an ndarray: a Dask array is computed."""
    return np.asarray(to_numbers(x, what, names))


def array(x: ArrayLike, what: str, *shape: int, batch: bool = True, names: Sequence[str] = ()) -> Array:
    """x as float32, float64 or symbols, with last axes of the given shape. Raises errors that name ``what``.

    ``names`` are the labels of the last axis for tables; see :func:`to_numbers`.
    """
    if type(x) is not np.ndarray:
        x = _array(x, what, shape, batch, names)
    last_axes = x.shape[-len(shape) :] if batch else x.shape
    if last_axes != shape and (shape or not batch):  # a batch of numbers may have any shape
        raise ShapeError(f"{what} has {_kind_text(x)}, expected {_shape_text(shape, batch)}.")
    if x.dtype in _FLOAT_TYPES:
        return x
    if x.dtype.kind in "biuf":  # small integers would overflow, and unsigned ones have no minus sign
        return x.astype(float)
    holds_numbers = x.dtype == object and all(map(_is_number, set(map(type, x.flat))))
    if not holds_numbers:
        raise ValueRangeError(f"{what} has {_kind_text(x)}, expected {_shape_text(shape, batch)} of real numbers.")
    return x


def real(x: ArrayLike, what: str, *shape: int, batch: bool = True, names: Sequence[str] = ()) -> Array:
    """x as float32 if it has that type, else as float64, with last axes of the given shape; symbols are rejected."""
    numbers = array(x, what, *shape, batch=batch, names=names)
    if numbers.dtype != object:
        return numbers
    try:
        return numbers.astype(float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueRangeError(
            f"{what} has {_kind_text(numbers)}, expected numbers that float64 can hold: {error}."
        ) from None


def finite(x: ArrayLike, what: str, *shape: int, names: Sequence[str] = ()) -> Array:
    """x as finite real numbers, with last axes of the given shape."""
    numbers = real(x, what, *shape, names=names)
    is_refused = ~np.isfinite(numbers)
    if is_refused.any():
        first_index = np.argwhere(is_refused)[0]
        index = tuple(int(i) for i in first_index)
        raise ValueRangeError(f"{what} has the entry {numbers[index]} at {index}: every entry must be a finite number.")
    return numbers


def one(x: ArrayLike, what: str, *shape: int, symbols: bool = False, names: Sequence[str] = ()) -> Array:
    """x as float64 numbers, or symbols if allowed, of exactly this shape: one value, not a batch."""
    check = array if symbols else real
    numbers = check(x, what, *shape, batch=False, names=names)
    if numbers.dtype == object:
        return numbers
    return np.asarray(numbers, float)


_UNITS: Mapping[str, Mapping[str, float]] = {
    "s": {"": 1.0, "s": 1.0, "ms": 1e-3, "min": 60.0},
}
"""By the SI unit of a quantity: units that a text may have, each with its factor; the empty text is for no unit."""
_NUMBER_WITH_UNIT = re.compile(r"\s*(?P<number>[^a-zA-Z\s]+(?:[eE][-+]?\d+)?)\s*(?P<unit>[a-zA-Z]*)\s*")


def read_quantity(text: str, what: str, unit: str) -> float:
    """Read a number with or without its unit, ``5``, ``5s``, ``500 ms``, in SI units; raises ValueRangeError.

    >>> read_quantity("500 ms", "duration", "s"), read_quantity("5", "duration", "s")
    (0.5, 5.0)
    """
    match = _NUMBER_WITH_UNIT.fullmatch(text)
    factors = _UNITS[unit]
    try:
        if match:
            return float(match["number"]) * factors[match["unit"]]
        return float(text)
    except (KeyError, ValueError):
        *units, last_unit = list(factors)[1:]  # without the empty text
        raise ValueRangeError(
            f"{what} is {text!r}: expected a number, or one with {', '.join(units)} or {last_unit}."
        ) from None


def number(x: Any, what: str) -> float:
    """x as one real number, which may be NaN or infinite."""
    if type(x) is float:
        return x
    scalar = _array(x, what, ())
    if scalar.shape != () or scalar.dtype.kind not in "iuf":
        raise ValueRangeError(f"{what} is {x!r}, expected one real number.")
    return float(scalar)


def positive(x: Any, what: str, unit: str = "", *, zero: bool = False, infinite: bool = False) -> float:
    """x, a number or a text with a number, as one number above 0 [``unit``]. Raises ValueRangeError.

    ``zero`` also allows 0, ``infinite`` also infinity.
    """
    if isinstance(x, str) and unit in _UNITS:
        value = read_quantity(x, what, unit)
    else:
        value = number(x, what)
    is_large_enough = value > 0 or (zero and value == 0)
    if not is_large_enough or (value == np.inf and not infinite):
        requirement = "a number, at least 0" if zero else "a positive number"
        unit_text = f" [{unit}]" if unit else ""
        raise ValueRangeError(f"{what} is {x}, and must be {requirement}{unit_text}.")
    return value


def whole(x: Any, what: str, least: int = 1) -> int:
    """x as a whole number of at least ``least``; 6.0 is accepted. Raises ValueRangeError."""
    value = number(x, what)
    if not (value >= least and value % 1 == 0):
        raise ValueRangeError(f"{what} is {x}, and must be a whole number, at least {least}.")
    return int(value)


def integer(x: Any, what: str, least: int = 1) -> int:
    """x as an integer of at least ``least``, also a NumPy integer; 6.0 and True are rejected. Raises ValueRangeError."""
    try:
        value = operator.index(x)
    except TypeError:
        value = least - 1  # fails the next test
    if isinstance(x, bool) or value < least:
        raise ValueRangeError(f"{what}={value_text(x)}: give a whole number of at least {least}.")
    return value


def generator(rng: Any, what: str = "rng") -> np.random.Generator:
    """Return a NumPy generator, from a seed or unchanged. Raises ValueRangeError."""
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError):
        raise ValueRangeError(
            f"{what} is {value_text(rng)}: give a seed, a whole number, or a numpy Generator."
        ) from None


def flag(x: Any, what: str) -> bool:
    """x as a bool: True, False, a NumPy bool, 0, 1, or None for False. Raises ValueRangeError."""
    if x is None or isinstance(x, bool | np.bool_):
        return bool(x)
    if isinstance(x, int | float) and x in (0, 1):
        return bool(x)
    raise ValueRangeError(f"{what} is {value_text(x)}: give True or False.")


def choice(x: Any, what: str, choices: Sequence[str]) -> str:
    """x as one of the given texts. Raises ValueRangeError, which lists them."""
    if not isinstance(x, str) or x not in choices:
        raise ValueRangeError(f"{what} {value_text(x)} is not known. Choose one of: {', '.join(choices)}.")
    return x


def value_text(x: Any) -> str:
    """Short description of a given value, for errors about values of the wrong kind.

    >>> value_text(None), value_text("abc"), value_text(np.float64(0.5)), value_text(np.zeros(3)), value_text(abs)
    ('None', "'abc'", '0.5', 'an array of shape (3,)', 'a builtin_function_or_method')
    """
    if isinstance(x, np.ndarray) and x.ndim:
        return f"an array of shape {x.shape}"
    if isinstance(x, type):
        return f"the class {x.__name__}"
    is_plain = isinstance(x, str | bytes | int | float | complex | list | tuple | dict | set | np.generic)
    if x is not None and not is_plain:
        return f"a {type(x).__name__}"
    if isinstance(x, np.generic):
        x = x.item()
    text = repr(x)
    if len(text) <= _MAX_VALUE_LENGTH:
        return text
    return f"{text[:_MAX_VALUE_LENGTH]}…"


def matrix_of_rotation(x: Any, what: str, kind: str) -> Array:
    """Result of ``x.as_matrix()`` for a SciPy object."""
    if not hasattr(x, "as_matrix"):
        raise ValueRangeError(f"{what} takes a {kind}, got {type(x).__name__}.")
    return np.asarray(x.as_matrix())


def together(**arrays: Array) -> tuple[Array, ...]:
    """Arrays broadcast against each other. Raises :func:`mismatch`."""
    try:
        return tuple(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        raise mismatch(**arrays) from None


def mismatch(**arrays: Array) -> ShapeError:
    """Error for batches that do not broadcast."""
    shapes = ", ".join(f"{name} {x.shape}" for name, x in arrays.items())
    return ShapeError(f"these batches do not broadcast: {shapes}. All axes but the last ones must agree or be 1.")


def _array(x: Any, what: str, shape: tuple[int, ...], batch: bool = False, names: Sequence[str] = ()) -> Array:
    """x as an ndarray, its numbers as floats if NumPy has no type for them. The shape is only named in errors."""
    complaint = f"is not an array, expected {_shape_text(shape, batch)} of real numbers"
    numbers = np.asarray(to_numbers(x, what, names, complaint=complaint))
    if numbers.dtype != object or not numbers.size:
        return numbers
    entry_types = set(map(type, numbers.flat))
    if all(issubclass(entry_type, _REAL_NUMBER_TYPES) for entry_type in entry_types):
        try:
            return numbers.astype(float)  # fractions, and integers beyond 64 bits
        except OverflowError as error:
            raise ShapeError(f"{what} {complaint}: {error}") from None
    return numbers


def _shape_text(shape: tuple[int, ...], batch: bool) -> str:
    """Shape as a text; with ``batch``, with leading dots for further axes."""
    if batch:
        return f"({', '.join(['...', *map(str, shape)])})"
    return str(shape)


def _is_number(entry_type: type) -> bool:
    """True if an entry type of an object array is one of numbers or symbols: these can be negated, unlike texts and None."""
    return hasattr(entry_type, "__neg__") and not issubclass(entry_type, (complex, np.complexfloating, np.ndarray))


def _kind_text(x: Array) -> str:
    """Shape of an array, and the kind of its entries unless they are real numbers."""
    kind = x.dtype.kind
    if kind == "O" and x.size:
        type_names = {type(entry).__name__ for entry in x.flat}
        return f"shape {x.shape} of {', '.join(sorted(type_names))}"
    if kind in "biufO":
        return f"shape {x.shape}"
    return f"shape {x.shape} of {_KIND_NAMES.get(kind, x.dtype.name)}"


def pose(T: ArrayLike, what: str) -> Array:
    """T (..., 4, 4), checked to be a pose within 1e-6. Symbols and labelled poses (checked before) are not checked."""
    poses = array(T, what, 4, 4)
    is_labelled = hasattr(T, "of")
    if poses.dtype != object and not is_labelled:
        last_row(poses, what)
        rotation(poses[..., :3, :3], what)
    return poses


def parse_numbers(text: str, what: str, form: str, *counts: int) -> list[float]:
    """Parse finite numbers separated by commas, as many as one of ``counts``; ValueRangeError shows the form."""
    try:
        numbers = [float(x) for x in text.split(",")]
    except ValueError:
        numbers = []  # not in counts
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        raise ValueRangeError(f"{what} {text!r}: expected {form}.")
    return numbers


def refuse_unused_srdf(clearance: float | None, srdf: object) -> None:
    """Raise :class:`~twistwrench.ValueRangeError` if pairs of links are left out of a check that is not made."""
    if srdf is not None and clearance is None:
        raise ValueRangeError(
            "{0} leaves out pairs of links for {1}, and that is not given. Add {1}.",
            Argument("srdf"),
            Argument("clearance"),
        )


def assignments(texts: Iterable[str], option: str, form: str) -> dict[str, str]:
    """Values by name from texts ``NAME=VALUE``; ValueRangeError shows the form."""
    values: dict[str, str] = {}
    for text in texts:
        name, equals, value = map(str.strip, text.partition("="))
        if not (name and equals and value):
            raise ValueRangeError(f"{option} {text!r} is not {form}.")
        if name in values:
            raise ValueRangeError(f"{option} {name} is given twice. Keep one of them.")
        values[name] = value
    return values


Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def taking_the_arguments_of(
    other: Callable[Arguments, Any],
) -> Callable[[Callable[..., Result]], Callable[Arguments, Result]]:
    """Decorator that takes names, types and defaults from ``other``, for type checkers and ``inspect.signature``."""

    def decorate(function: Callable[..., Result]) -> Callable[Arguments, Result]:
        function.__wrapped__ = other  # type: ignore[attr-defined]
        return function

    return decorate


def hint_if_misused(hint: str) -> Callable[[Callable[Arguments, Result]], Callable[Arguments, Result]]:
    """Decorator for a function: calls with arguments that it does not take raise TypeError with this hint."""

    def decorate(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
        @wraps(function)
        def call(*positional: Arguments.args, **named: Arguments.kwargs) -> Result:
            try:
                return function(*positional, **named)
            except TypeError as error:
                # No name for the traceback: its reference to this frame would keep the arguments until the next collection.
                if error.__traceback__ is not None and error.__traceback__.tb_next is None:  # raised by the call itself
                    raise TypeError(hint) from None
                raise

        return call

    return decorate
