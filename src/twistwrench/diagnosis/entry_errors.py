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
"""Powers of ten by which one entry may be wrong."""
UNITS = {3: "g m²", 4: "kg cm²", 6: "kg mm²", 7: "g cm²", 9: "g mm²"}
"""Units that are mistaken for kg m², by power of ten."""
_PRODUCTS = {name: ENTRIES[name] for name in IN_MJCF[3:]}
_MAX_RATIO_TO_SECOND, _MAX_NEAREST, _MAX_PLAUSIBLE = 0.5, 0.5, 3.0
"""Distances relative to the tensor of the shapes: ratio to the second nearest, largest of the nearest, and cut-off."""
_MAX_ROUNDING = 1e-4
"""Relative tolerance for a dimension to count as a round number of two digits."""


@dataclass(frozen=True, eq=False)
class EntryError:
    """Error in entering the numbers, with the corrected tensor."""

    kind: str
    """sign, power, origin, dimension or unit."""
    sentence: str
    tensor: Array
    certain: bool = False
    """True if it reproduces all digits of the numbers."""
    family: str = ""
    """Equal for entry errors that differ only by a power of ten."""


def possible(tensor: Array) -> bool:
    """True if the tensor is nonzero and physically consistent by the loader's criterion."""
    if not (np.isfinite(tensor).all() and tensor.trace() > 0.0):
        return False
    return not SpatialInertia.from_com(1.0, moment_about_com=tensor).defects()


def explain(errors: Iterable[EntryError], reference: Array | None) -> EntryError | None:
    """Entry error that explains the numbers: the only one, or by far the nearest to the tensor of the shapes.

    If the shapes do not decide between powers of ten in one entry, the smallest is used.
    """
    candidates = [error for error in errors if possible(error.tensor)]
    candidates = [error for error in candidates if error.certain] or candidates
    if reference is not None:
        gaps = [float(np.linalg.norm(error.tensor - reference) / np.linalg.norm(reference)) for error in candidates]
        if len(candidates) > 1:
            nearest, second = np.argsort(gaps)[:2]
            if gaps[nearest] < min(_MAX_RATIO_TO_SECOND * gaps[second], _MAX_NEAREST):
                return candidates[nearest]
        candidates = [error for error, gap in zip(candidates, gaps, strict=True) if gap < _MAX_PLAUSIBLE]
    if len({error.family for error in candidates}) != 1:
        return None
    return candidates[0]


def sign_errors(tensor: Array) -> Iterator[EntryError]:
    """Wrong signs of nonzero products: of one, or of all three. Two wrong signs do not change the principal moments."""
    if not all(tensor[at] for at in _PRODUCTS.values()):
        return
    for name, at in _PRODUCTS.items():
        yield EntryError("sign", f"{name} has the other sign", _replace_entry(tensor, at, -tensor[at]), family=name)
    opposite = 2.0 * np.diag(tensor.diagonal()) - tensor
    yield EntryError("sign", "all products have the other sign, as some CAD programs write them", opposite)


def power_errors(tensor: Array) -> Iterator[EntryError]:
    """One entry wrong by a power of ten: moments in either direction, products too large; smallest power first."""
    for name in IN_MJCF:
        row, column = ENTRIES[name]
        if tensor[row, column] == 0.0:
            continue
        yield from _scaled_entries(tensor, name, "large")
        if row == column:  # moments may also be too small
            yield from _scaled_entries(tensor, name, "small")


def _scaled_entries(tensor: Array, name: str, size: str) -> Iterator[EntryError]:
    """One entry too large or too small by each power of ten that leaves a possible tensor."""
    at = ENTRIES[name]
    for k in _EXPONENTS:
        factor = 10.0**-k
        if size == "small":
            factor = 10.0**k
        corrected = _replace_entry(tensor, at, tensor[at] * factor)
        if possible(corrected):
            sentence = f"{name} is {printed(10.0**k)} times too {size}"
            yield EntryError("power", sentence, corrected, family=f"{name} {size}")


def origin_errors(tensor: Array, written: WrittenInertia) -> Iterator[EntryError]:
    """Tensor about the origin: differs by m (c.c 1 - c c') along the file's axes."""
    c = written.R.T @ written.com
    steiner = written.mass * (c @ c * np.eye(3) - np.outer(c, c))
    if np.linalg.norm(steiner) > 0.05 * np.linalg.norm(tensor):
        sentence = "it is about the link's origin, where the centre of mass is meant"
        yield EntryError("origin", sentence, tensor - steiner, family="origin")


def unit_errors(tensor: Array, reference: Array | None) -> Iterator[EntryError]:
    """All entries wrong by one power of ten, compared with the tensor of the shapes."""
    if reference is None or tensor.trace() <= 0 or reference.trace() <= 0:
        return
    exponent = float(np.log10(tensor.trace() / reference.trace()))
    k = round(exponent)
    if abs(k) in UNITS and abs(exponent - k) < 0.35:
        size = f"large, as {UNITS[k]} for kg m²" if k > 0 else "small"
        yield EntryError("unit", f"all entries are 1e{abs(k)} times too {size}", tensor * 10.0**-k, family="unit")


def dimension_errors(tensor: Array, mass: float) -> Iterator[EntryError]:
    """Tensor of a uniform solid with round dimensions, one of which is too large by a factor of 10, 100 or 1000."""
    moments = tensor.diagonal()
    if mass <= 0 or np.abs(tensor - np.diag(moments)).max() > 1e-6 * np.abs(moments).max():
        return
    for axis in range(3):
        yield from _cylinder_errors(moments, mass, axis)
    yield from _box_errors(moments, mass)


def _cylinder_errors(moments: Array, mass: float, axis: int) -> Iterator[EntryError]:
    """Radius or length of a solid cylinder about an axis of the tensor."""
    across = np.delete(moments, axis)
    if abs(across[0] - across[1]) > _MAX_ROUNDING * across[0]:
        return
    r2 = 2.0 * moments[axis] / mass
    h2 = 12.0 * across[0] / mass - 3.0 * r2
    if not (r2 > 0 and h2 > 1e-6 * r2):
        return
    r, h = _round_dimension(r2**0.5), _round_dimension(h2**0.5)
    if not (r and h):
        return
    solid = f"it is that of a solid cylinder of radius {printed(r)} m and length {printed(h)} m, whose"
    for k in (1, 2, 3):
        radius = r / 10**k
        corrected = _cylinder_moments(mass, radius, h, axis)
        yield _dimension_error(f"{solid} radius", "radius", k, r, radius, corrected)
    for k in (1, 2, 3):
        length = h / 10**k
        corrected = _cylinder_moments(mass, r, length, axis)
        yield _dimension_error(f"{solid} length", "length", k, h, length, corrected)


def _cylinder_moments(mass: float, radius: float, length: float, axis: int) -> Array:
    """Principal moments (3,) of a uniform solid cylinder."""
    moments = np.full(3, mass * (3.0 * radius**2 + length**2) / 12.0)
    moments[axis] = mass * radius**2 / 2.0
    return moments


def _box_errors(moments: Array, mass: float) -> Iterator[EntryError]:
    """One edge of a solid box."""
    squared_edges = 6.0 * (moments.sum() - 2.0 * moments) / mass
    if not (squared_edges > 0).all():
        return
    edges = [_round_dimension(float(square) ** 0.5) for square in squared_edges]
    if not all(edges):
        return
    solid = f"it is that of a solid box of {' x '.join(map(printed, edges))} m, one edge of which"
    for axis, k in itertools.product(range(3), (1, 2, 3)):
        a = np.array(edges, float)
        a[axis] /= 10**k
        yield _dimension_error(solid, f"edge {axis}", k, edges[axis], a[axis], mass * (a @ a - a**2) / 12.0)


def _dimension_error(
    dimension: str, family: str, k: int, written: float, corrected: float, moments: Array
) -> EntryError:
    """One dimension too large by 10^k; only k = 1 is certain."""
    sentence = f"{dimension} is {10**k} times too large: {printed(written)} m for {printed(corrected)} m"
    return EntryError("dimension", sentence, np.diag(moments), certain=k == 1, family=family)


def _round_dimension(value: float) -> float:
    """Nearest number of two digits; 0 if the value is not close to one."""
    rounded = float(f"{residual(value)}")
    return rounded if abs(value - rounded) <= _MAX_ROUNDING * rounded else 0.0


def _replace_entry(tensor: Array, at: tuple[int, int], value: float) -> Array:
    """Symmetric tensor with one entry replaced."""
    changed = tensor.copy()
    changed[at] = changed[at[::-1]] = value
    return changed
