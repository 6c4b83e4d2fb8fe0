"""Argument checks: what a caller gives, as arrays as they must be, or errors that name them and say what to do.

``brought`` and ``plain`` take any kind of array: NumPy's as they are, tables by the names of their columns, all else as
``np.asarray`` does; ``brought`` leaves Dask's lazy. ``array``, ``real`` and ``finite`` look at types and shapes besides;
``number``, ``positive`` and ``whole`` are for single numbers; ``pose`` says how far a matrix is off. Symbols
(object arrays) pass all but ``real`` and ``finite`` as they are, so checked functions can be traced. NaN passes all but
``finite``: plain arrays hand it on row by row, as NumPy does.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from numbers import Rational
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import ShapeError, TwistWrenchError, ValueRangeError
from ..typing import Array
from .labelled_arrays import in_order
from .lazy import is_lazy
from .rotation_checks import last_row, rotation

_LONGEST = 60
"""Characters of what was given that an error shows."""
_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
_NO_ARRAY = "is not an array of real numbers"
_FLOATS = (np.dtype(np.float64), np.dtype(np.float32))
_PYTHON = (int, float, np.floating, np.integer, Rational)
_NAMES = {"U": "text", "S": "bytes", "c": "complex numbers", "M": "dates", "m": "time spans", "O": "objects"}


def brought(x: Any, what: str, names: Sequence[str] = (), *, complaint: str = _NO_ARRAY) -> Any:
    """x as an ndarray of whatever numbers it has, or as the Dask array that it is.

    A table (a data frame, a row of one, an array with a labelled last axis) is put in the order of ``names``; without names
    its labels are refused where they are texts. Raises UnknownNameError for labels that are not exactly the names, and
    ValueRangeError for masked entries; ShapeError, with the ``complaint``, for what is no array.
    """
    if type(x) is np.ndarray:
        return x
    try:
        x = in_order(x, what, names)
        made = x if is_lazy(x) else np.asarray(x)
    except TwistWrenchError:
        raise
    except Exception as error:  # rows of different lengths, integers beyond floats, whatever another library raises
        if type(error).__module__.startswith("jax."):
            raise ShapeError(
                f"{what} is being traced by JAX, and NumPy cannot read it. Inside jit, vmap and grad use the quantity as a "
                "function of JAX arrays: robot.to_jax(name)."
            ) from None
        raise ShapeError(f"{what} {complaint}: {error}") from None
    masked = sys.modules.get("numpy.ma")  # NumPy imports it when asked for it
    if masked and isinstance(x, masked.MaskedArray) and masked.is_masked(x):
        count = int(masked.getmaskarray(x).sum())
        raise ValueRangeError(
            f"{what} has {count} masked entries, which are no numbers. Fill them: x.filled(np.nan) makes gaps of them."
        )
    return made


def of_plain(given: Sequence[Any]) -> tuple[Array, ...] | None:
    """The arrays, where each is NumPy's or a plain list, tuple or number that makes one; None where a closer look is needed."""
    if not all(type(x) in (np.ndarray, list, tuple, float, int) for x in given):
        return None
    try:
        return tuple([np.asarray(x) for x in given])
    except Exception:  # which brought() explains
        return None


def plain(x: Any, what: str, names: Sequence[str] = ()) -> Array:
    """The same as an ndarray: a Dask array is computed."""
    return np.asarray(brought(x, what, names))


def array(x: ArrayLike, what: str, *shape: int, batch: bool = True, names: Sequence[str] = ()) -> Array:
    """x as float32, float64 or symbols, its last axes of the given shape; all else is an error that names ``what``.

    ``names``: those of the last axis, by which a table is read; see :func:`brought`.
    """
    if type(x) is not np.ndarray:
        x = _array(x, what, shape, batch, names)
    if (x.shape[-len(shape) :] if batch else x.shape) != shape and (shape or not batch):
        raise ShapeError(f"{what} has {_described(x)}, expected {_wanted(shape, batch)}.")
    if x.dtype in _FLOATS:
        return x
    if x.dtype.kind in "biuf":  # small integers would overflow, and unsigned ones have no minus sign
        return x.astype(float)
    if x.dtype != object or not all(map(_is_number, set(map(type, x.flat)))):
        raise ValueRangeError(f"{what} has {_described(x)}, expected {_wanted(shape, batch)} of real numbers.")
    return x


def real(x: ArrayLike, what: str, *shape: int, batch: bool = True, names: Sequence[str] = ()) -> Array:
    """x as float32 if it is that, else as float64, with the last axes of the given shape; symbols are refused."""
    M = array(x, what, *shape, batch=batch, names=names)
    if M.dtype != object:
        return M
    try:
        return M.astype(float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueRangeError(f"{what} has {_described(M)}, expected numbers that float64 can hold: {error}.") from None


def finite(x: ArrayLike, what: str, *shape: int, names: Sequence[str] = ()) -> Array:
    """x as real numbers, its last axes of the given shape and none of them NaN or infinite."""
    M = real(x, what, *shape, names=names)
    bad = ~np.isfinite(M)
    if bad.any():
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise ValueRangeError(f"{what} has the entry {M[where]} at {where}: every entry must be a finite number.")
    return M


def one(x: ArrayLike, what: str, *shape: int, symbols: bool = False, names: Sequence[str] = ()) -> Array:
    """x as float64 numbers, or symbols where they may be, of exactly this shape: one thing, not a batch."""
    M = (array if symbols else real)(x, what, *shape, batch=False, names=names)
    return M if M.dtype == object else np.asarray(M, float)


def number(x: Any, what: str) -> float:
    """x as one real number, which may be NaN or infinite."""
    if type(x) is float:
        return x
    M = _array(x, what, ())
    if M.shape != () or M.dtype.kind not in "iuf":
        raise ValueRangeError(f"{what} is {x!r}, expected one real number.")
    return float(M)


def positive(x: Any, what: str, unit: str = "", *, zero: bool = False, infinite: bool = False) -> float:
    """x as one number above 0 [``unit``]; 0 too where ``zero``, infinity too where ``infinite``. Raises ValueRangeError."""
    value = number(x, what)
    if not (value > 0 or (zero and value == 0)) or (value == np.inf and not infinite):
        wanted = "a number, at least 0" if zero else "a positive number"
        raise ValueRangeError(f"{what} is {x}, and must be {wanted}{f' [{unit}]' if unit else ''}.")
    return value


def whole(x: Any, what: str, least: int = 1) -> int:
    """x as a whole number of at least ``least``; 6.0 is one. Raises ValueRangeError."""
    value = number(x, what)
    if not (value >= least and value % 1 == 0):
        raise ValueRangeError(f"{what} is {x}, and must be a whole number, at least {least}.")
    return int(value)


def generator(rng: Any, what: str = "rng") -> np.random.Generator:
    """A NumPy generator, from a seed or as it is. Raises ValueRangeError."""
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError):
        raise ValueRangeError(f"{what} is {shown(rng)}: give a seed, a whole number, or a numpy Generator.") from None


def flag(x: Any, what: str) -> bool:
    """x as a yes or no: a bool, NumPy's too, 0, 1, or None for no. Raises ValueRangeError."""
    if x is None or isinstance(x, bool | np.bool_) or (isinstance(x, int | float) and x in (0, 1)):
        return bool(x)
    raise ValueRangeError(f"{what} is {shown(x)}: give True or False.")


def choice(x: Any, what: str, choices: Sequence[str]) -> str:
    """x as one of a few texts. Raises ValueRangeError, which lists them."""
    if not isinstance(x, str) or x not in choices:
        raise ValueRangeError(f"{what} {shown(x)} is not known. Choose one of: {', '.join(choices)}.")
    return x


def shown(x: Any) -> str:
    """What was given, in a few words: for errors about things of the wrong kind.

    >>> shown(None), shown("abc"), shown(np.float64(0.5)), shown(np.zeros(3)), shown([]), shown(abs)
    ('None', "'abc'", '0.5', 'an array of shape (3,)', '[]', 'a builtin_function_or_method')
    """
    if isinstance(x, np.ndarray) and x.ndim:
        return f"an array of shape {x.shape}"
    if isinstance(x, type):
        return f"the class {x.__name__}"
    if x is not None and not isinstance(
        x, str | bytes | int | float | complex | list | tuple | dict | set | np.generic
    ):
        return f"a {type(x).__name__}"
    text = repr(x.item() if isinstance(x, np.generic) else x)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def visible(text: str) -> str:
    r"""A text with control characters, and those that change the direction of writing, as escapes; lines and tabs stay.

    >>> print(visible("joint\x1b[2J \u202e1"))
    joint\x1b[2J \u202e1
    """
    return _UNSEEN.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def as_matrix(x: Any, what: str, kind: str) -> Array:
    """What ``x.as_matrix()`` gives, for an object of SciPy's."""
    if not hasattr(x, "as_matrix"):
        raise ValueRangeError(f"{what} takes a {kind}, got {type(x).__name__}.")
    return np.asarray(x.as_matrix())


def together(**arrays: Array) -> tuple[Array, ...]:
    """The arrays broadcast against each other, or a :func:`mismatch`."""
    try:
        return tuple(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        raise mismatch(**arrays) from None


def mismatch(**arrays: Array) -> ShapeError:
    """The error for batches that do not broadcast."""
    shapes = ", ".join(f"{name} {x.shape}" for name, x in arrays.items())
    return ShapeError(f"these batches do not broadcast: {shapes}. All axes but the last ones must agree or be 1.")


def _array(x: Any, what: str, shape: tuple[int, ...], batch: bool = False, names: Sequence[str] = ()) -> Array:
    complaint = f"is no array, expected {_wanted(shape, batch)} of real numbers"
    M = np.asarray(brought(x, what, names, complaint=complaint))
    if M.dtype == object and M.size and all(issubclass(kind, _PYTHON) for kind in set(map(type, M.flat))):
        try:
            return M.astype(float)  # fractions, and integers beyond 64 bits
        except OverflowError as error:
            raise ShapeError(f"{what} {complaint}: {error}") from None
    return M


def _wanted(shape: tuple[int, ...], batch: bool) -> str:
    return f"({', '.join(['...', *map(str, shape)])})" if batch else str(shape)


def _is_number(kind: type) -> bool:
    """Whether elements of an object array can be calculated with: numbers and symbols can be negated, texts and None cannot."""
    return hasattr(kind, "__neg__") and not issubclass(kind, (complex, np.complexfloating, np.ndarray))


def _described(x: Array) -> str:
    kind = x.dtype.kind
    if kind == "O" and x.size:
        return f"shape {x.shape} of {', '.join(sorted({type(e).__name__ for e in x.flat}))}"
    return f"shape {x.shape}" + (f" of {_NAMES.get(kind, x.dtype.name)}" if kind not in "biufO" else "")


def pose(T: ArrayLike, what: str) -> Array:
    """T (..., 4, 4), when it is a pose to a millionth. A labelled pose was judged when it was made, symbols never are."""
    M = array(T, what, 4, 4)
    if M.dtype != object and not hasattr(T, "of"):
        last_row(M, what)
        rotation(M[..., :3, :3], what)
    return M
