"""Screw axes: direction, point and pitch ⇄ six numbers, for twists (rotation and velocity) and wrenches (moment and force).

A line with a pitch describes both. A twist is a rotation about its axis with a translation of pitch metres per radian along
it. A wrench is a force along its line of action with a moment of pitch newton metres per newton about it. Pitch 0 is a pure
rotation or force; infinite pitch is a pure translation or couple, which has a direction but no line.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import ValueRangeError
from ...core.glossary import complete
from ...core.typing import Array
from .so3 import cross

__all__ = ["Axis", "axis_of", "line_of_action", "reciprocal_product", "screw_axis", "wrench_along"]


class Axis(NamedTuple):
    """Screw axis as a line with a pitch, and its magnitude."""

    direction: Array
    """Unit vector (..., 3)."""
    point: Array
    """Point of the line nearest to the frame's origin (..., 3) [m]; the origin if the pitch is infinite."""
    pitch: Array
    """Pitch (...) [m], metres per radian or newton metres per newton; infinite for pure translations and couples."""
    magnitude: Array
    """Magnitude (...) in rad/s or N; for infinite pitch in m/s or N m."""


def screw_axis(direction: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0), pitch: ArrayLike = 0.0) -> Array:
    """Screw axis S = (ŝ, q × ŝ + h ŝ) along a direction through a point (MR section 3.3.2.2).

    Returns
    -------
    S : (..., 6) array; (0, ŝ) at infinite pitch

    Examples
    --------
    >>> screw_axis([0, 0, 2], point=[1, 0, 0], pitch=0.1).tolist()
    [0.0, 0.0, 1.0, 0.0, -1.0, 0.1]
    """
    s, length = _unit_and_length(_floats(direction, "the direction of an axis", 3))
    if not np.all(length > 0) or not np.isfinite(length).all():
        raise ValueRangeError("an axis needs a direction: three finite numbers that are not all zero.")
    q = _floats(point, "the point of an axis", 3)
    h = _floats(pitch, "the pitch of an axis")[..., None]
    s, q, h = arguments.together(direction=s, point=q, pitch=h)  # equal batch shapes
    is_translation = np.isinf(h)
    finite_h = np.where(is_translation, 0.0, h)  # avoids inf * 0
    angular = np.where(is_translation, 0.0, s)
    linear = np.where(is_translation, np.sign(h) * s, cross(q, s) + finite_h * s)
    return np.concatenate([angular, linear], axis=-1)


def axis_of(S: ArrayLike) -> Axis:
    """Screw axis of a twist: ŝ = ω/|ω|, q = ω × v / |ω|², h = ω·v / |ω|² (MR section 3.3.2.2).

    If ω = 0, the pitch is infinite and v gives the direction. ``screw_axis(*axis_of(S)[:3]) *
    axis_of(S).magnitude`` equals S.

    Parameters
    ----------
    S : (..., 6) array_like, twist or screw axis (omega, v)

    Examples
    --------
    >>> axis = axis_of([0, 0, 2, 0, -2, 0.2])
    >>> axis.point.tolist(), float(axis.pitch), float(axis.magnitude)
    ([1.0, 0.0, 0.0], 0.1, 2.0)
    """
    S = _floats(S, _SCREW, 6)
    w, v = S[..., :3], S[..., 3:]
    return _axis(w, v, "twist")


def line_of_action(F: ArrayLike) -> Axis:
    """Line of action of a wrench: f̂, q = f × m / |f|², h = m·f / |f|² (MR section 3.4).

    A pure couple (f = 0) has infinite pitch, and m gives the direction.

    Parameters
    ----------
    F : (..., 6) array_like, wrench (m, f) [N m, N]

    Examples
    --------
    >>> axis = line_of_action([0, 0, 6, 0, 3, 0])       # 3 N along y, 2 m out along x
    >>> axis.point.tolist(), float(axis.pitch)
    ([2.0, 0.0, 0.0], 0.0)
    """
    F = _floats(F, _SCREW, 6)
    m, f = F[..., :3], F[..., 3:]
    return _axis(f, m, "wrench")


def wrench_along(direction: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0), pitch: ArrayLike = 0.0) -> Array:
    """Unit wrench along a line with a pitch, (q × f̂ + h f̂, f̂): 1 N, or 1 N m if the pitch is infinite.

    Equals :func:`screw_axis` with exchanged halves. ``wrench_along(f, r) * |f|`` is the force f at r.

    Returns
    -------
    F : (..., 6) array, (m, f) [N m, N]

    Examples
    --------
    >>> (3 * wrench_along([0, 1, 0], point=[2, 0, 0])).tolist()
    [0.0, 0.0, 6.0, 0.0, 3.0, 0.0]
    """
    S = screw_axis(direction, point, pitch)
    return np.concatenate([S[..., 3:], S[..., :3]], axis=-1)


def reciprocal_product(S1: ArrayLike, S2: ArrayLike) -> Array:
    """Reciprocal product ω₁·v₂ + v₁·ω₂: power of a wrench along the second screw on a motion about the first.

    Zero for reciprocal screws. Two lines (pitch 0) are reciprocal exactly if they meet or are parallel.

    Parameters
    ----------
    S1, S2 : (..., 6) array_like, screw axes (omega, v)

    Returns
    -------
    power : (...) array

    Examples
    --------
    >>> float(reciprocal_product(screw_axis([0, 0, 1]), screw_axis([1, 0, 0], point=[0, 2, 0])))
    -2.0
    """
    S1 = _floats(S1, _SCREW, 6)
    S2 = _floats(S2, _SCREW, 6)
    S1, S2 = arguments.together(S1=S1, S2=S2)  # equal batch shapes
    w1, v1 = S1[..., :3], S1[..., 3:]
    w2, v2 = S2[..., :3], S2[..., 3:]
    return np.asarray(np.sum(w1 * v2 + v1 * w2, axis=-1))


def kinds(first: Array, second: Array, names: tuple[str, str, str, str]) -> Any:
    """Kind of a screw from its two halves: one of four names, as a text, or an array of texts.

    A pitch counts as zero up to 16 eps.

    Parameters
    ----------
    first : (..., 3) array, the half along the axis: ω of a twist, f of a wrench
    second : (..., 3) array, the half at the origin: v of a twist, m of a wrench
    names : four str, for zero pitch, infinite pitch, finite pitch, and a screw that is zero

    Returns
    -------
    kind : str, or array of str for a batch

    Examples
    --------
    >>> kinds(np.array([0.0, 0, 1]), np.zeros(3), ("line", "couple", "screw", "nothing"))
    'line'
    """
    line = _floats(first, "the first half", 3)
    moment = _floats(second, "the second half", 3)
    direction, line_length = _unit_and_length(line)
    moment_length = _length(moment)
    moment_along_line = np.abs(np.sum(direction * moment, axis=-1))
    has_no_line = line_length == 0
    is_zero = has_no_line & (moment_length == 0)
    rounding = 16 * np.finfo(float).eps * moment_length
    has_zero_pitch = moment_along_line <= rounding
    zero_pitch, infinite_pitch, finite_pitch, zero = names
    masks = [is_zero, has_no_line, has_zero_pitch]  # the first one that is true decides
    kind = np.select(masks, [zero, infinite_pitch, zero_pitch], finite_pitch)
    return kind if kind.ndim else str(kind)


_SCREW = "a screw, angular part first,"
"""Name of an argument in messages."""


def _floats(x: ArrayLike, what: str, *shape: int) -> Array:
    """Array of floats (..., *shape); raises an error that names ``what``."""
    return np.asarray(arguments.real(x, what, *shape), float)


def _length(x: Array) -> Array:
    """Length of vectors (..., 3)."""
    return np.asarray(np.hypot(np.hypot(x[..., 0], x[..., 1]), x[..., 2]))  # hypot avoids underflow of squares


def _unit_and_length(x: Array) -> tuple[Array, Array]:
    """Unit vector along x, zero for x = 0, and the length of x; x itself if its length is infinite or not a number."""
    length = _length(x)
    has_direction = (length > 0) & np.isfinite(length)
    divisor = np.where(has_direction, length, 1.0)
    return x / divisor[..., None], length


def _axis(axis_half: Array, origin_half: Array, what: str) -> Axis:
    """Axis of a screw from its half along the axis and its half at the origin; ``what`` names the screw in messages."""
    line_direction, line_length = _unit_and_length(axis_half)
    moment_direction, moment_length = _unit_and_length(origin_half)
    has_no_line = line_length == 0
    is_zero = has_no_line & (moment_length == 0)
    are_finite = np.isfinite(line_length + moment_length).all()
    if np.any(is_zero) or not are_finite:
        raise ValueRangeError(f"a {what} needs six finite numbers that are not all zero to have an axis.")
    moment_ratio = origin_half / np.where(has_no_line, 1.0, line_length)[..., None]
    return Axis(
        direction=np.where(has_no_line[..., None], moment_direction, line_direction),
        point=np.where(has_no_line[..., None], 0.0, cross(line_direction, moment_ratio)) + 0.0,  # no -0.0
        pitch=np.where(has_no_line, np.inf, np.sum(line_direction * moment_ratio, axis=-1)),
        magnitude=np.where(has_no_line, moment_length, line_length),
    )


complete(globals())
