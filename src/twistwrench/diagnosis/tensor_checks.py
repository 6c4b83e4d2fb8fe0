"""Checks of tensors: physical consistency, agreement with the link's shapes, and entry errors as explanations."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..core.numbers import number, percent, printed, residual
from ..core.typing import Array
from ..formats.robot_text import WrittenInertia
from ..formats.urdf import ENTRIES, IN_MJCF
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.inertia_checks import reasons
from ..mechanics.model.model import BASE
from ..shapes.solids import METRICS, nearest
from .findings import FileRepair, Finding, Severity
from .parsed_file import ParsedFile, ParsedLink


@dataclass(frozen=True)
class Options:
    """Options common to all checks."""

    metric: str = "frobenius"
    """Metric of the nearest tensor, a key of ``METRICS``."""
    mirror_from: str = ""
    """Correct side, left or right, if two sides are not mirror images; empty if unknown."""


# ── Entry errors: single changes that make a tensor physically consistent

# Tensors are about the centre of mass, along the file's axes [kg m²]. An entry error is accepted only if it is the only
# candidate, or far nearer than all others to the tensor of the link's shapes at its mass.

_POWERS = range(1, 7)
UNITS = {3: "g m²", 4: "kg cm²", 6: "kg mm²", 7: "g cm²", 9: "g mm²"}
"""Units that are mistaken for kg m², by power of ten."""
_PRODUCTS = {name: ENTRIES[name] for name in IN_MJCF[3:]}
_NEARER, _NEAR, _FAR = 0.5, 0.5, 3.0
"""Distances relative to the tensor of the shapes: ratio to the second nearest, largest of the nearest, and cut-off."""
_ROUND = 1e-4
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
    fine = np.isfinite(tensor).all() and tensor.trace() > 0.0
    return bool(fine) and not SpatialInertia.from_com(1.0, moment_about_com=tensor).defects()


def explain(errors: Iterable[EntryError], reference: Array | None) -> EntryError | None:
    """Entry error that explains the numbers: the only one, or by far the nearest to the tensor of the shapes.

    If the shapes do not decide between powers of ten in one entry, the smallest is used.
    """
    candidates = [error for error in errors if possible(error.tensor)]
    candidates = [error for error in candidates if error.certain] or candidates
    if reference is not None and candidates:
        size = float(np.linalg.norm(reference))
        gaps = np.array([float(np.linalg.norm(error.tensor - reference)) / size for error in candidates])
        first, second = [*np.argsort(gaps), -1][:2]
        if len(candidates) > 1 and gaps[first] < min(_NEARER * gaps[second], _NEAR):
            return candidates[int(first)]
        candidates = [error for error, gap in zip(candidates, gaps, strict=True) if gap < _FAR]
    return candidates[0] if len({error.family for error in candidates}) == 1 else None


def _signs(tensor: Array) -> Iterator[EntryError]:
    """Wrong signs of nonzero products: of one, or of all three. Two wrong signs do not change the principal moments."""
    if not all(tensor[at] for at in _PRODUCTS.values()):
        return
    for name, at in _PRODUCTS.items():
        yield EntryError("sign", f"{name} has the other sign", _with(tensor, at, -tensor[at]), family=name)
    both = 2.0 * np.diag(tensor.diagonal()) - tensor
    yield EntryError("sign", "all products have the other sign, as some CAD programs write them", both)


def _entries(tensor: Array) -> Iterator[EntryError]:
    """One entry wrong by a power of ten: moments in either direction, products too large; smallest power first."""
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
    """Tensor about the origin: differs by m (c.c 1 - c c') along the file's axes."""
    c = written.R.T @ written.com
    steiner = written.mass * (c @ c * np.eye(3) - np.outer(c, c))
    if np.linalg.norm(steiner) > 0.05 * np.linalg.norm(tensor):
        said = "it is about the link's origin, where the centre of mass is meant"
        yield EntryError("origin", said, tensor - steiner, family="origin")


def _units(tensor: Array, reference: Array | None) -> Iterator[EntryError]:
    """All entries wrong by one power of ten, compared with the tensor of the shapes."""
    if reference is None or tensor.trace() <= 0 or reference.trace() <= 0:
        return
    ratio = float(np.log10(tensor.trace() / reference.trace()))
    k = round(ratio)
    if abs(k) in UNITS and abs(ratio - k) < 0.35:
        size = f"large, as {UNITS[k]} for kg m²" if k > 0 else "small"
        yield EntryError("unit", f"all entries are 1e{abs(k)} times too {size}", tensor * 10.0**-k, family="unit")


def _dimensions(tensor: Array, mass: float) -> Iterator[EntryError]:
    """Tensor of a uniform solid with round dimensions, one of which is too large by a factor of 10, 100 or 1000."""
    moments = tensor.diagonal()
    if mass <= 0 or np.abs(tensor - np.diag(moments)).max() > 1e-6 * np.abs(moments).max():
        return
    for axis in range(3):
        across = np.delete(moments, axis)
        if abs(across[0] - across[1]) > _ROUND * across[0]:
            continue
        r2 = 2.0 * moments[axis] / mass
        h2 = 12.0 * across[0] / mass - 3.0 * r2
        if not (r2 > 0 and h2 > 1e-6 * r2 and (r := _round(r2**0.5)) and (h := _round(h2**0.5))):
            continue
        said = f"it is that of a solid cylinder of radius {printed(r)} m and length {printed(h)} m, whose"
        for name, k in itertools.product(("radius", "length"), (1, 2, 3)):
            radius, length = (r / 10**k, h) if name == "radius" else (r, h / 10**k)
            meant = np.full(3, mass * (3.0 * radius**2 + length**2) / 12.0)
            meant[axis] = mass * radius**2 / 2.0
            wrong, right = (r, radius) if name == "radius" else (h, length)
            yield _too_large(f"{said} {name}", name, k, wrong, right, meant)
    edges2 = 6.0 * (moments.sum() - 2.0 * moments) / mass
    if (edges2 > 0).all() and all(edges := [_round(float(e) ** 0.5) for e in edges2]):
        said = f"it is that of a solid box of {' x '.join(map(printed, edges))} m, one edge of which"
        for axis, k in itertools.product(range(3), (1, 2, 3)):
            a = np.array(edges, float)
            a[axis] /= 10**k
            yield _too_large(said, f"edge {axis}", k, edges[axis], a[axis], mass * (a @ a - a**2) / 12.0)


def _too_large(said: str, family: str, k: int, wrong: float, right: float, moments: Array) -> EntryError:
    """One dimension too large by 10^k; only k = 1 is certain."""
    said = f"{said} is {10**k} times too large: {printed(wrong)} m for {printed(right)} m"
    return EntryError("dimension", said, np.diag(moments), certain=k == 1, family=family)


def _round(value: float) -> float:
    """Nearest number of two digits; 0 if the value is not close to one."""
    near = float(f"{residual(value)}")
    return near if abs(value - near) <= _ROUND * near else 0.0


def _with(tensor: Array, at: tuple[int, int], value: float) -> Array:
    changed = tensor.copy()
    changed[at] = changed[at[::-1]] = value
    return changed


# ── Checks of tensors: physical consistency, and agreement with the link's shapes

_ABSORBED = 1.0
"""Percentage of M above which an impossible link within a consistent body is relevant."""
MATTERS = 5.0
"""Percentage of M above which a disagreement of tensor and shapes is relevant."""
_FACTOR = 2.0
"""Ratio to the largest moment in the box above which a moment is too large."""
_IDENTIFIED = 10.0
"""Ratio to this largest moment up to which base-parameter regrouping is an explanation."""
_MILDER = 0.5
"""Ratio to the change by a slip's repair below which the nearest tensor is named beside it."""
_SMALL = 1.0 / 30.0
"""Ratio to the diagonal of the shapes below which a gyration radius is too small."""


def check_impossible(robot: ParsedFile, options: Options) -> Iterator[Finding]:
    """Negative moments, or a violated triangle inequality, of a single link."""
    refused = {i for i, body in enumerate(robot.model.bodies) if reasons(body.inertia)}
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or no_tensor(written) or not (why := reasons(written.inertia)):
            continue
        body = robot.model.frames[link.name].body if link.name in robot.model.frames else BASE
        reference = reference_of(link)
        error = explain([*_signs(written.tensor), *_entries(written.tensor)], reference)
        repair = _with_milder(link, error, options.metric, reference) or nearest_repair(link, options.metric, reference)
        effect = robot.effects.evaluate(repair.inertias)
        fate = (
            "the moving body it belongs to cannot exist, and is refused on loading" if body in refused
            else "it does not move" if body == BASE
            else "with what is fixed to it, it makes a physically consistent body"
        )  # fmt: skip
        moments = {f"moment_{k}": float(x) for k, x in enumerate(np.linalg.eigvalsh(written.tensor), start=1)}
        said = f"its tensor cannot exist: {'; '.join(why)}; {fate}"
        found = link.finding("impossible", body != BASE and effect.reaches(_ABSORBED), said, moments, effect, repair)
        yield replace(found, severity=Severity.ERROR) if body in refused else found


def check_too_large(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Moment above twice the largest that the mass can have within the box of the link's shapes."""
    for link, written in judged(robot):
        reach, I = _reach(link, written), written.tensor
        most = written.mass * (reach @ reach - reach**2)  # largest moments within the extent
        if (I.diagonal() <= _FACTOR * most).all() or not reach.all():
            continue
        axis = int((I.diagonal() / most).argmax())
        factor = float(I[axis, axis] / most[axis])
        reference = reference_of(link)
        errors = [*_about_origin(I, written), *_units(I, reference), *_dimensions(I, written.mass)]
        error = explain([e for e in errors if (e.tensor.diagonal() <= _FACTOR * most).all()], reference)
        if error is None and factor <= _IDENTIFIED and identified(written):
            repair, more = None, ", as identified sets have, whose parts are right in their sums only"
        else:
            repair, more = entry_error_repair(link, error) or shape_repair(link), ""
        effect = robot.effects.evaluate(repair.inertias if repair is not None else {})
        name = ("ixx", "iyy", "izz")[axis]
        radius = float(np.sqrt(I[axis, axis] / written.mass))
        yield link.finding(
            "too-large", effect.reaches(MATTERS),
            f"its tensor is too large for its shapes: {name} is {number(I[axis, axis])} kg m², a gyration radius "
            f"of {number(radius, 3)} m, and {number(written.mass)} kg in their box have {number(most[axis], 3)} at most{more}",
            {"factor": factor, "gyration_radius": radius, "largest": float(most[axis])}, effect, repair,
        )  # fmt: skip


def check_too_small(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Largest gyration radius below a thirtieth of the diagonal of the shapes."""
    for link, written in judged(robot):
        largest = float(np.linalg.eigvalsh(written.tensor)[-1])
        radius, diagonal = float(np.sqrt(max(largest, 0.0) / written.mass)), link.shapes.diagonal
        if radius >= _SMALL * diagonal or no_tensor(written):
            continue
        reference = reference_of(link)
        error = explain(_units(written.tensor, reference), reference)
        repair = entry_error_repair(link, error) or shape_repair(link)
        effect = robot.effects.evaluate(repair.inertias)
        said = (
            f"its tensor is too small for its shapes: its gyration radius is {number(radius, 2)} m, their diagonal "
            f"{number(diagonal, 2)} m"
        )
        numbers = {"gyration_radius": radius, "diagonal": diagonal}
        yield link.finding("too-small", effect.reaches(MATTERS), said, numbers, effect, repair)


def judged(robot: ParsedFile) -> Iterator[tuple[ParsedLink, WrittenInertia]]:
    """Links with at least 1 % of the mass, a consistent tensor, and completely read shapes."""
    for link in robot.links.values():
        written = link.written
        fine = written is not None and robot.heavy(link) and not reasons(written.inertia)
        if written is not None and fine and not placeholder(written) and link.shapes.complete:
            yield link, written


def no_tensor(written: WrittenInertia) -> bool:
    """True if the tensor is zero, negligible beside the moments about the origin, or that of a micrometre body."""
    largest = float(np.abs(written.tensor).max())
    return largest <= max(1e-13 * float(np.abs(written.inertia.moment_about_origin).max()), 1e-12 * written.mass)


def placeholder(written: WrittenInertia) -> bool:
    """True if the moments equal one power of ten, as in templates, and the products are zero or the same."""
    value = float(written.tensor[0, 0])
    if value <= 0 or (written.tensor.diagonal() != value).any():
        return False
    products = set(np.abs(written.tensor[[0, 0, 1], [1, 2, 2]]).tolist())
    return products <= {0.0, value} and abs(np.log10(value) - round(np.log10(value))) < 1e-9


def reference_of(link: ParsedLink) -> Array | None:
    """Tensor of the link's shapes at its mass, along the axes of the link's tensor; None without volume."""
    if link.written is None or not link.shapes.complete:
        return None
    tensor = link.shapes.tensor(link.written.mass)
    R = link.written.R
    return None if tensor is None else np.asarray(R.T @ tensor @ R)


def entry_error_repair(link: ParsedLink, error: EntryError | None) -> FileRepair | None:
    """Repair by correction of an entry error, if there is one."""
    if error is None:
        return None
    return _repair(link, "slip", f"one slip would explain it: {error.sentence}", error.tensor)


def _with_milder(link: ParsedLink, error: EntryError | None, metric: str, reference: Array | None) -> FileRepair | None:
    """Repair of an entry error, with the distance of the nearest tensor in its sentence if that is far milder."""
    repair = entry_error_repair(link, error)
    if error is None or repair is None or link.written is None:
        return repair
    written = link.written.tensor
    near = nearest(written, metric, reference if metric == "entropic" else None)
    mild, change = (
        float(np.linalg.norm(tensor - written) / np.linalg.norm(written)) for tensor in (near, error.tensor)
    )
    if mild >= _MILDER * change:
        return repair
    sizes = f"{percent(mild, 2)} away, the slip's {percent(change, 2)}: check all entries"
    said = f"{repair.sentence}; the nearest tensor that can exist ({METRICS[metric]}) is only {sizes}"
    return replace(repair, sentence=said)


def nearest_repair(link: ParsedLink, metric: str, reference: Array | None) -> FileRepair:
    """Repair by the nearest physically consistent tensor."""
    assert link.written is not None
    tensor = nearest(link.written.tensor, metric, reference if metric == "entropic" else None)
    change = float(np.linalg.norm(tensor - link.written.tensor) / np.linalg.norm(link.written.tensor))
    sentence = (
        f"no one slip explains it; the nearest tensor that can exist ({METRICS[metric]}) is {percent(change, 2)} away"
    )
    return _repair(link, "nearest" if metric == "frobenius" else metric, sentence, tensor, METRICS[metric])


def shape_repair(
    link: ParsedLink, why: str = "no one slip explains it; this is the tensor of its shapes as uniform solids"
) -> FileRepair:
    """Repair by the tensor of the shapes at the link's mass, or advice if they have no volume."""
    tensor = reference_of(link)
    if tensor is None:
        return FileRepair("advice", "give it the tensor of its shape at its mass")
    return _repair(link, "shape", why, tensor)


def _repair(link: ParsedLink, kind: str, sentence: str, tensor: Array, metric: str = "") -> FileRepair:
    assert link.written is not None
    edits, tensor = link.written.tensor_edits(tensor)
    return FileRepair(kind, sentence, {link.name: link.written.with_tensor(tensor)}, edits, metric)


def _reach(link: ParsedLink, written: WrittenInertia) -> Array:
    """Extent (3,) of the shapes from the centre of mass along the file's axes [m]."""
    low, high = link.shapes.box(written.R)
    c = written.R.T @ written.com
    return np.maximum(np.abs(low - c), np.abs(high - c))


def identified(written: WrittenInertia) -> bool:
    """True if the numbers look identified: all six are given, and the products are not small beside the moments."""
    products = np.abs(written.tensor[[0, 0, 1], [1, 2, 2]])
    return bool(products.all() and products.max() > 1e-3 * written.tensor.trace())
