"""Entry errors: single mistakes in entering a tensor, and the options of all checks."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..core.numbers import printed, residual
from ..formats.robot_text import WrittenInertia
from ..formats.urdf import ENTRIES, IN_MJCF
from ..typing import Array


@dataclass(frozen=True)
class Options:
    """Options of all checks."""

    metric: str = "frobenius"
    """Metric of the nearest tensor, one of ``METRICS``."""
    mirror_from: str = ""
    """Side, left or right, that is correct if two sides are not mirror images; empty: not known."""


# ── Entry errors: single changes that turn a tensor into one that a body can have

# Tensors are about the centre of mass, along the axes they are written in [kg m²]. An entry error is accepted only if it is
# the only one, or far nearer than all others to the tensor of the link's shapes at its mass.

_POWERS = range(1, 7)
UNITS = {3: "g m²", 4: "kg cm²", 6: "kg mm²", 7: "g cm²", 9: "g mm²"}
"""Units that are mistaken for kg m², by the power of ten."""
_PRODUCTS = {name: ENTRIES[name] for name in IN_MJCF[3:]}
_NEARER, _NEAR, _FAR = 0.5, 0.5, 3.0
"""Relative distances to the tensor of the shapes: ratio to the second nearest, largest of the nearest, and cut-off."""
_ROUND = 1e-4
"""Relative distance from a number of two digits at which a dimension is round."""


@dataclass(frozen=True, eq=False)
class EntryError:
    """An error in entering the numbers, and the tensor that was meant."""

    kind: str
    """sign, power, origin, dimension or unit."""
    sentence: str
    tensor: Array
    certain: bool = False
    """True if it reproduces the numbers digit for digit."""
    family: str = ""
    """Equal for entry errors that differ only by the power of ten."""


def possible(tensor: Array) -> bool:
    """True if a body can have the tensor, by the loader's criterion, and it is not zero."""
    fine = np.isfinite(tensor).all() and tensor.trace() > 0.0
    return bool(fine) and not SpatialInertia.from_com(1.0, moment_about_com=tensor).defects()


def explain(candidates: list[EntryError], reference: Array | None) -> EntryError | None:
    """The error that explains the numbers: by far the nearest to the tensor of the shapes, or the only one.

    Among several powers of ten in one entry the smallest is taken if the shapes do not decide.
    """
    candidates = [error for error in candidates if error.certain] or candidates
    if reference is not None and candidates:
        size = float(np.linalg.norm(reference))
        gaps = np.array([float(np.linalg.norm(error.tensor - reference)) / size for error in candidates])
        first, second = [*np.argsort(gaps), -1][:2]
        if len(candidates) > 1 and gaps[first] < min(_NEARER * gaps[second], _NEAR):
            return candidates[int(first)]
        candidates = [error for error, gap in zip(candidates, gaps, strict=True) if gap < _FAR]
    return candidates[0] if len({error.family for error in candidates}) == 1 else None


def impossible_tensor_errors(tensor: Array) -> list[EntryError]:
    """Errors that explain an impossible tensor by a possible one."""
    found = [*_signs(tensor), *_entries(tensor)]
    return [error for error in found if possible(error.tensor)]


def large_tensor_errors(
    tensor: Array, written: WrittenInertia, fits: Callable[[Array], bool], reference: Array | None
) -> list[EntryError]:
    """Errors that explain a tensor too large for the shapes by one that fits."""
    found = [*_about_origin(tensor, written), *_units(tensor, reference), *_dimensions(tensor, written.mass)]
    return [error for error in found if possible(error.tensor) and fits(error.tensor)]


def small_tensor_errors(tensor: Array, reference: Array | None) -> list[EntryError]:
    """Errors that explain a tensor too small for the shapes: another unit."""
    return [error for error in _units(tensor, reference) if possible(error.tensor)]


def _signs(tensor: Array) -> Iterator[EntryError]:
    """Three products that are not zero: one of other sign changes the moments, and so do all three, but two do not."""
    if not all(tensor[at] for at in _PRODUCTS.values()):
        return
    for name, at in _PRODUCTS.items():
        yield EntryError("sign", f"{name} has the other sign", _with(tensor, at, -tensor[at]), family=name)
    both = 2.0 * np.diag(tensor.diagonal()) - tensor
    yield EntryError("sign", "all products have the other sign, as some CAD programs write them", both)


def _entries(tensor: Array) -> Iterator[EntryError]:
    """One entry a power of ten off, either way for moments, down for products, the least power first."""
    for name, at in ((name, ENTRIES[name]) for name in IN_MJCF):
        for up in (False, True) if at[0] == at[1] else (False,):
            for k in _POWERS if tensor[at] else ():
                factor = 10.0**k if up else 10.0**-k
                changed = _with(tensor, at, tensor[at] * factor)
                if possible(changed):
                    way = "small" if up else "large"
                    yield EntryError(
                        "power", f"{name} is {printed(10.0**k)} times too {way}", changed, family=f"{name} {way}"
                    )


def _about_origin(tensor: Array, written: WrittenInertia) -> Iterator[EntryError]:
    steiner = _steiner(written)
    if np.linalg.norm(steiner) > 0.05 * np.linalg.norm(tensor):
        yield EntryError(
            "origin",
            "it is about the link's origin, where the centre of mass is meant",
            tensor - steiner,
            family="origin",
        )


def _steiner(written: WrittenInertia) -> Array:
    """m (c.c 1 - c c') along the written axes."""
    c = written.R.T @ written.com
    return np.asarray(written.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def _units(tensor: Array, reference: Array | None) -> Iterator[EntryError]:
    """All entries one power of ten off, compared with the tensor of the shapes."""
    if reference is None or tensor.trace() <= 0 or reference.trace() <= 0:
        return
    ratio = float(np.log10(tensor.trace() / reference.trace()))
    k = round(ratio)
    if abs(k) in UNITS and abs(ratio - k) < 0.35:
        size = f"large, as {UNITS[k]} for kg m²" if k > 0 else "small"
        yield EntryError("unit", f"all entries are 1e{abs(k)} times too {size}", tensor * 10.0**-k, family="unit")


def _dimensions(tensor: Array, mass: float) -> Iterator[EntryError]:
    """A uniform solid of round dimensions, one of which is ten, a hundred or a thousand times too large."""
    moments = tensor.diagonal()
    if mass <= 0 or np.abs(tensor - np.diag(moments)).max() > 1e-6 * np.abs(moments).max():
        return
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        if abs(moments[others[0]] - moments[others[1]]) > _ROUND * moments[others[0]]:
            continue
        r2 = 2.0 * moments[axis] / mass
        h2 = 12.0 * moments[others[0]] / mass - 3.0 * r2
        if r2 > 0 and h2 > 1e-6 * r2 and (r := _round(r2**0.5)) and (h := _round(h2**0.5)):
            for name, radius, length, k in (
                *(("radius", r / 10**k, h, k) for k in (1, 2, 3)),
                *(("length", r, h / 10**k, k) for k in (1, 2, 3)),
            ):
                meant = np.empty(3)
                meant[axis] = mass * radius**2 / 2.0
                meant[others] = mass * (3.0 * radius**2 + length**2) / 12.0
                wrong, right = (r, radius) if name == "radius" else (h, length)
                yield EntryError(
                    "dimension",
                    f"it is that of a solid cylinder of radius {printed(r)} m and length {printed(h)} m, whose {name} is "
                    f"{10**k} times too large: {printed(wrong)} m for {printed(right)} m",
                    np.diag(meant),
                    certain=k == 1,
                    family=name,
                )
    edges2 = 6.0 * (moments.sum() - 2.0 * moments) / mass
    if (edges2 > 0).all() and all(edges := [_round(float(e) ** 0.5) for e in edges2]):
        for axis, k in itertools.product(range(3), (1, 2, 3)):
            a = np.array(edges, float)
            a[axis] /= 10**k
            listed = " x ".join(f"{printed(e)}" for e in edges)
            yield EntryError(
                "dimension",
                f"it is that of a solid box of {listed} m, one edge of which is {10**k} times too large: "
                f"{printed(edges[axis])} m for {printed(a[axis])} m",
                np.diag(mass * (a @ a - a**2) / 12.0),
                certain=k == 1,
                family=f"edge {axis}",
            )


def _round(value: float) -> float:
    """The value as a number of two digits; 0 if it is not one."""
    near = float(f"{residual(value)}")
    return near if abs(value - near) <= _ROUND * near else 0.0


def _with(tensor: Array, at: tuple[int, int], value: float) -> Array:
    changed = tensor.copy()
    changed[at] = changed[at[::-1]] = value
    return changed
