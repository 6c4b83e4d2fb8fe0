"""Entry errors: single changes that make a tensor physically consistent.

Tensors are about the centre of mass, along the file's axes [kg m²]. An entry error is accepted only if it is the only
candidate, or far nearer than all others to the tensor of the link's shapes at its mass.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ..core.numbers import printed, residual
from ..core.typing import Array
from ..formats.robot_text import WrittenInertia
from ..formats.urdf import ENTRIES, IN_MJCF
from ..mechanics.bodies.inertia import SpatialInertia

_EXPONENTS = range(1, 7)
"""Exponents of the powers of ten by which one entry may be wrong."""
UNITS = {3: "g m²", 4: "kg cm²", 6: "kg mm²", 7: "g cm²", 9: "g mm²"}
"""Units that are mistaken for kg m²; the keys are exponents of ten by which the numbers are then too large."""
_PRODUCTS = {name: ENTRIES[name] for name in IN_MJCF[3:]}
"""Row and column of each product of inertia, by its name in files."""
# The distance of a tensor is relative to the norm of the tensor of the shapes.
_MAX_RATIO_TO_SECOND = 0.5
"""Largest ratio of the smallest distance to the second smallest, for the nearest tensor to explain the numbers."""
_MAX_NEAREST = 0.5
"""Largest distance of a nearest tensor that explains the numbers."""
_MAX_PLAUSIBLE = 3.0
"""Largest distance of a tensor that is considered at all."""
_MAX_ROUNDING = 1e-4
"""Relative tolerance for a dimension to count as a round number of two digits."""
_MIN_STEINER_SHARE = 0.05
"""Smallest ratio of the parallel-axis term to the tensor at which a wrong reference point is considered."""
_MAX_EXPONENT_ERROR = 0.35
"""Largest distance of a decimal logarithm to an integer, for a ratio to count as a power of ten."""
_DIMENSION_EXPONENTS = (1, 2, 3)
"""Exponents of the powers of ten by which one dimension may be too large."""
_MAX_PRODUCT_SHARE = 1e-6
"""Largest product of inertia of a solid along the axes, as a share of the largest moment: rounding in files."""
_MIN_SQUARE_RATIO = 1e-6
"""Smallest ratio of squares of length and radius of a cylinder; less is a rounding error."""


@dataclass(frozen=True, eq=False)
class EntryError:
    """Error in entering the numbers of a tensor, with the corrected tensor."""

    kind: str
    """sign, power, origin, dimension or unit."""
    sentence: str
    """Text on what is wrong."""
    tensor: Array
    """Corrected tensor (3, 3)."""
    certain: bool = False
    """True if the error reproduces all digits of the numbers."""
    family: str = ""
    """Text that is equal for entry errors that differ only by a power of ten."""


def possible(tensor: Array) -> bool:
    """True if the tensor is nonzero and physically consistent by the loader's criterion."""
    if not (np.isfinite(tensor).all() and tensor.trace() > 0.0):
        return False
    return not SpatialInertia.from_com(1.0, moment_about_com=tensor).defects()


def explain(errors: Iterable[EntryError], reference: Array | None) -> EntryError | None:
    """Entry error that explains the numbers: the only one, or by far the nearest to ``reference``; None if there is none.

    ``reference`` is the tensor (3, 3) of the shapes. If it does not decide between powers of ten in one entry, the first error
    is used, which has the smallest power.
    """
    candidates = [error for error in errors if possible(error.tensor)]
    certain = [error for error in candidates if error.certain]
    if certain:
        candidates = certain
    if reference is not None:
        norm = np.linalg.norm(reference)
        distances = [float(np.linalg.norm(error.tensor - reference) / norm) for error in candidates]
        if len(candidates) > 1:
            nearest, second = np.argsort(distances)[:2]
            max_distance = min(_MAX_RATIO_TO_SECOND * distances[second], _MAX_NEAREST)
            if distances[nearest] < max_distance:
                return candidates[nearest]
        candidates = [error for error, distance in zip(candidates, distances, strict=True) if distance < _MAX_PLAUSIBLE]
    families = {error.family for error in candidates}
    if len(families) != 1:
        return None
    return candidates[0]


def sign_errors(tensor: Array) -> Iterator[EntryError]:
    """Errors in the sign of one product or of all three, if no product is zero.

    Two wrong signs do not change the principal moments, so they leave a possible tensor possible.
    """
    has_all_products = all(tensor[entry] for entry in _PRODUCTS.values())
    if not has_all_products:
        return
    for name, entry in _PRODUCTS.items():
        corrected = _replace_entry(tensor, entry, -tensor[entry])
        yield EntryError("sign", f"{name} has the other sign", corrected, family=name)
    opposite_products = 2.0 * np.diag(tensor.diagonal()) - tensor
    yield EntryError("sign", "all products have the other sign, as some CAD programs write them", opposite_products)


def power_errors(tensor: Array) -> Iterator[EntryError]:
    """Errors of one entry by a power of ten; for each entry, the smallest power comes first.

    Moments may be too large or too small. Products may only be too large, since smaller ones never make a tensor impossible.
    """
    for name in IN_MJCF:
        row, column = ENTRIES[name]
        if tensor[row, column] == 0.0:
            continue
        yield from _scaled_entries(tensor, name, "large")
        if row == column:  # moments may also be too small
            yield from _scaled_entries(tensor, name, "small")


def _scaled_entries(tensor: Array, name: str, size: str) -> Iterator[EntryError]:
    """Errors of one entry, too "large" or too "small" by each power of ten that leaves a possible tensor."""
    entry = ENTRIES[name]
    for k in _EXPONENTS:
        factor = 10.0**-k
        if size == "small":
            factor = 10.0**k
        corrected = _replace_entry(tensor, entry, tensor[entry] * factor)
        if possible(corrected):
            sentence = f"{name} is {printed(10.0**k)} times too {size}"
            yield EntryError("power", sentence, corrected, family=f"{name} {size}")


def origin_errors(tensor: Array, written: WrittenInertia) -> Iterator[EntryError]:
    """Error of a tensor about the link's origin: larger by m (c.c 1 - c c'), with the centre of mass c in the file's axes."""
    c = written.R.T @ written.com
    steiner = written.mass * (c @ c * np.eye(3) - np.outer(c, c))
    if np.linalg.norm(steiner) > _MIN_STEINER_SHARE * np.linalg.norm(tensor):
        sentence = "it is about the link's origin, where the centre of mass is meant"
        yield EntryError("origin", sentence, tensor - steiner, family="origin")


def unit_errors(tensor: Array, reference: Array | None) -> Iterator[EntryError]:
    """Error of all entries by the same power of ten, compared with ``reference``, the tensor of the shapes."""
    if reference is None or tensor.trace() <= 0 or reference.trace() <= 0:
        return
    exponent = float(np.log10(tensor.trace() / reference.trace()))
    k = round(exponent)
    if abs(k) in UNITS and abs(exponent - k) < _MAX_EXPONENT_ERROR:
        size = "small"
        if k > 0:
            size = f"large, as {UNITS[k]} for kg m²"
        yield EntryError("unit", f"all entries are 1e{abs(k)} times too {size}", tensor * 10.0**-k, family="unit")


def dimension_errors(tensor: Array, mass: float) -> Iterator[EntryError]:
    """Errors of a uniform solid with round dimensions, one of which is too large by a factor of 10, 100 or 1000."""
    moments = tensor.diagonal()
    max_product = np.abs(tensor - np.diag(moments)).max()
    if mass <= 0 or max_product > _MAX_PRODUCT_SHARE * np.abs(moments).max():  # not along the axes of a solid
        return
    for axis in range(3):
        yield from _cylinder_errors(moments, mass, axis)
    yield from _box_errors(moments, mass)


def _cylinder_errors(moments: Array, mass: float, axis: int) -> Iterator[EntryError]:
    """Errors of radius or length of a solid cylinder about an axis of the tensor.

    Its moments are m r² / 2 about the axis, and m (3 r² + h²) / 12 across it.
    """
    moment_across, other_across = np.delete(moments, axis)
    if abs(moment_across - other_across) > _MAX_ROUNDING * moment_across:
        return
    r_square = 2.0 * moments[axis] / mass
    h_square = 12.0 * moment_across / mass - 3.0 * r_square
    if not (r_square > 0 and h_square > _MIN_SQUARE_RATIO * r_square):
        return
    r = _round_dimension(r_square**0.5)
    h = _round_dimension(h_square**0.5)
    if not (r and h):  # a radius or length is not round
        return
    solid = f"it is that of a solid cylinder of radius {printed(r)} m and length {printed(h)} m, whose"
    for k in _DIMENSION_EXPONENTS:
        corrected_r = r / 10**k
        corrected = _cylinder_moments(mass, corrected_r, h, axis)
        yield _dimension_error(f"{solid} radius", "radius", k, r, corrected_r, corrected)
    for k in _DIMENSION_EXPONENTS:
        corrected_h = h / 10**k
        corrected = _cylinder_moments(mass, r, corrected_h, axis)
        yield _dimension_error(f"{solid} length", "length", k, h, corrected_h, corrected)


def _cylinder_moments(mass: float, radius: float, length: float, axis: int) -> Array:
    """Principal moments (3,) of a uniform solid cylinder."""
    moments = np.full(3, mass * (3.0 * radius**2 + length**2) / 12.0)
    moments[axis] = mass * radius**2 / 2.0
    return moments


def _box_errors(moments: Array, mass: float) -> Iterator[EntryError]:
    """Errors of one edge of a solid box with the edges a, b and c; its first moment is m (b² + c²) / 12."""
    squared_edges = 6.0 * (moments.sum() - 2.0 * moments) / mass
    if not (squared_edges > 0).all():
        return
    edges = [_round_dimension(float(square) ** 0.5) for square in squared_edges]
    if not all(edges):  # an edge is not round
        return
    solid = f"it is that of a solid box of {' x '.join(map(printed, edges))} m, one edge of which"
    for axis, k in itertools.product(range(3), _DIMENSION_EXPONENTS):
        corrected_edges = np.array(edges, float)
        corrected_edges[axis] /= 10**k
        corrected = mass * (corrected_edges @ corrected_edges - corrected_edges**2) / 12.0
        yield _dimension_error(solid, f"edge {axis}", k, edges[axis], corrected_edges[axis], corrected)


def _dimension_error(
    dimension: str, family: str, k: int, written: float, corrected: float, moments: Array
) -> EntryError:
    """Error of a dimension that is too large by 10^k, with the principal moments (3,) of the corrected solid.

    Only k = 1 is certain. ``dimension`` begins the sentence.
    """
    sentence = f"{dimension} is {10**k} times too large: {printed(written)} m for {printed(corrected)} m"
    return EntryError("dimension", sentence, np.diag(moments), certain=k == 1, family=family)


def _round_dimension(value: float) -> float:
    """Nearest number of two digits; 0 if the value is not close to such a number."""
    rounded = float(residual(value))  # residual prints two digits
    return rounded if abs(value - rounded) <= _MAX_ROUNDING * rounded else 0.0


def _replace_entry(tensor: Array, entry: tuple[int, int], value: float) -> Array:
    """Symmetric tensor with an entry at (row, column), and its mirror image, replaced."""
    row, column = entry
    changed = tensor.copy()
    changed[row, column] = value
    changed[column, row] = value
    return changed
