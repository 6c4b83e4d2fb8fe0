"""Checks of tensors: physical consistency, and agreement with the link's shapes."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from ..core.numbers import number, percent
from ..core.typing import Array
from ..formats.robot_text import WrittenInertia
from ..mechanics.model.inertia_checks import reasons
from ..mechanics.model.model import BASE
from ..shapes.solids import METRICS, nearest
from .entry_errors import (
    EntryError,
    dimension_errors,
    explain,
    origin_errors,
    power_errors,
    sign_errors,
    unit_errors,
)
from .findings import Effect, FileRepair, Finding, Severity
from .options import Options
from .parsed_file import ParsedFile, ParsedLink

_MIN_ABSORBED_EFFECT = 1.0
"""Change of the mass matrix M [%] above which an impossible link is relevant although its body, with all links, is possible."""
MIN_EFFECT = 5.0
"""Change of the mass matrix M [%] above which a disagreement of tensor and shapes is relevant."""
_MAX_RATIO_TO_BOX = 2.0
"""Largest moment that fits the shapes, in units of the largest moment that the mass can have in the box of the shapes."""
_MAX_IDENTIFIED_RATIO = 10.0
"""Largest ratio to the box, as above, that base-parameter regrouping explains."""
_MAX_MILD_CHANGE = 0.5
"""The message also names the nearest possible tensor if the change to it is less than this share of the change that the
corrected slip makes."""
_MIN_RADIUS_OF_DIAGONAL = 1.0 / 30.0
"""Smallest gyration radius that fits the shapes, as a share of their diagonal."""
_NAMES_OF_MOMENTS = ("ixx", "iyy", "izz")
_PRODUCTS = ([0, 0, 1], [1, 2, 2])
"""Indices of the products of inertia xy, xz and yz in a tensor: rows, then columns."""
_MIN_PRODUCT_OF_TRACE = 1e-3
"""Largest product of inertia from which a tensor looks identified, as a share of its trace."""
_MAX_EXPONENT_ERROR = 1e-9
"""Distance of a decimal logarithm from a whole number up to which the number is a power of ten."""


def check_impossible(robot: ParsedFile, options: Options) -> Iterator[Finding]:
    """Findings on tensors of single links with a negative moment, or a violated triangle inequality."""
    refused_bodies = {i for i, body in enumerate(robot.model.bodies) if reasons(body.inertia)}
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or no_tensor(written):
            continue
        defects = reasons(written.inertia)
        if not defects:
            continue
        reference = reference_of(link)
        possible_errors = [*sign_errors(written.tensor), *power_errors(written.tensor)]
        error = explain(possible_errors, reference)
        repair = _repair_with_milder(link, error, options.metric, reference)
        if repair is None:
            repair = nearest_repair(link, options.metric, reference)
        effect = robot.effects.evaluate(repair.inertias)
        principal_moments = np.linalg.eigvalsh(written.tensor)
        numbers = {f"moment_{k}": float(moment) for k, moment in enumerate(principal_moments, start=1)}
        body = BASE  # a link that does not move has no frame
        if link.name in robot.model.frames:
            body = robot.model.frames[link.name].body
        sentence = f"its tensor cannot exist: {'; '.join(defects)}; {_body_clause(body, refused_bodies)}"
        is_relevant = body != BASE and effect.reaches(_MIN_ABSORBED_EFFECT)
        finding = link.finding("impossible", is_relevant, sentence, numbers, effect, repair)
        if body in refused_bodies:
            finding = replace(finding, severity=Severity.ERROR)
        yield finding


def _body_clause(body: int, refused_bodies: Collection[int]) -> str:
    """Clause on the moving body of an impossible link: refused, absent, or consistent."""
    if body in refused_bodies:
        return "the moving body it belongs to cannot exist, and is refused on loading"
    if body == BASE:
        return "it does not move"
    return "with what is fixed to it, it makes a physically consistent body"


def check_too_large(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Findings on tensors with a moment above twice the largest that the mass can have in the box of the shapes."""
    for link, written in comparable_links(robot):
        I = written.tensor
        moments = I.diagonal()
        extent = _extent_from_centre(link, written)
        # With all mass in the farthest corner of the box; about x: m (y² + z²).
        box_moments = written.mass * (extent @ extent - extent**2)
        allowed_moments = _MAX_RATIO_TO_BOX * box_moments
        has_flat_box = not extent.all()
        if has_flat_box or (moments <= allowed_moments).all():
            continue
        axis = int((moments / box_moments).argmax())
        factor = float(moments[axis] / box_moments[axis])
        reference = reference_of(link)
        errors = [*origin_errors(I, written), *unit_errors(I, reference), *dimension_errors(I, written.mass)]
        fitting_errors = [error for error in errors if (error.tensor.diagonal() <= allowed_moments).all()]
        error = explain(fitting_errors, reference)
        if error is None and factor <= _MAX_IDENTIFIED_RATIO and identified_like(written):
            repair = None
            effect = Effect()
            explanation = (
                ", as identified sets have, whose parts are right in their sums only"  # mass and moments of a body
            )
        else:
            repair = entry_error_repair(link, error) or shape_repair(link)
            effect = robot.effects.evaluate(repair.inertias)
            explanation = ""
        name = _NAMES_OF_MOMENTS[axis]
        radius = float(np.sqrt(moments[axis] / written.mass))
        max_moment = float(box_moments[axis])
        yield link.finding(
            "too-large", effect.reaches(MIN_EFFECT),
            f"its tensor is too large for its shapes: {name} is {number(moments[axis])} kg m², a gyration radius "
            f"of {number(radius, 3)} m, and {number(written.mass)} kg in their box have {number(max_moment, 3)} at most"
            f"{explanation}", {"factor": factor, "gyration_radius": radius, "largest": max_moment}, effect, repair,
        )  # fmt: skip


def check_too_small(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Findings on tensors whose largest gyration radius is below a thirtieth of the diagonal of the shapes."""
    for link, written in comparable_links(robot):
        *_, max_moment = np.linalg.eigvalsh(written.tensor).tolist()  # in ascending order
        radius = float(np.sqrt(max(max_moment, 0.0) / written.mass))
        diagonal = link.shapes.diagonal
        if radius >= _MIN_RADIUS_OF_DIAGONAL * diagonal or no_tensor(written):
            continue
        reference = reference_of(link)
        error = explain(unit_errors(written.tensor, reference), reference)
        repair = entry_error_repair(link, error) or shape_repair(link)
        effect = robot.effects.evaluate(repair.inertias)
        sentence = (
            f"its tensor is too small for its shapes: its gyration radius is {number(radius, 2)} m, their diagonal "
            f"{number(diagonal, 2)} m"
        )
        numbers = {"gyration_radius": radius, "diagonal": diagonal}
        yield link.finding("too-small", effect.reaches(MIN_EFFECT), sentence, numbers, effect, repair)


def comparable_links(robot: ParsedFile) -> Iterator[tuple[ParsedLink, WrittenInertia]]:
    """Links whose tensor can be compared with shapes: heavy links with a consistent tensor and completely read shapes."""
    for link in robot.links.values():
        written = link.written
        if written is None or not robot.heavy(link) or reasons(written.inertia):
            continue
        if not placeholder(written) and link.shapes.complete:
            yield link, written


def no_tensor(written: WrittenInertia) -> bool:
    """True if the tensor is zero, or is not larger than a rounding error or the tensor of a body of a micrometre."""
    max_entry = float(np.abs(written.tensor).max())
    rounding_error = 1e-13 * float(np.abs(written.inertia.moment_about_origin).max())  # of Steiner's theorem
    micrometre_body = 1e-12 * written.mass  # m r² with r = 1e-6 m
    return max_entry <= max(rounding_error, micrometre_body)


def placeholder(written: WrittenInertia) -> bool:
    """True for a tensor as in templates: all moments are one power of ten, and each product is zero or of this size."""
    moment = float(written.tensor[0, 0])
    if moment <= 0 or (written.tensor.diagonal() != moment).any():
        return False
    products = set(np.abs(written.tensor[_PRODUCTS]).tolist())
    exponent = np.log10(moment)
    is_power_of_ten = abs(exponent - round(exponent)) < _MAX_EXPONENT_ERROR
    return products <= {0.0, moment} and is_power_of_ten


def reference_of(link: ParsedLink) -> Array | None:
    """Tensor of the link's shapes with the link's mass, in the axes of its written tensor; None without volume."""
    if link.written is None or not link.shapes.complete:
        return None
    tensor = link.shapes.tensor(link.written.mass)
    if tensor is None:
        return None
    R = link.written.R  # axes of the written tensor in the link
    return np.asarray(R.T @ tensor @ R)


def entry_error_repair(link: ParsedLink, error: EntryError | None) -> FileRepair | None:
    """Repair by correction of an entry error; None without an error."""
    if error is None:
        return None
    return _tensor_repair(link, "slip", f"one slip would explain it: {error.sentence}", error.tensor)


def _repair_with_milder(
    link: ParsedLink, error: EntryError | None, metric: str, reference: Array | None
) -> FileRepair | None:
    """Repair of an entry error, None without one; its sentence names the nearest possible tensor if that is far nearer."""
    repair = entry_error_repair(link, error)
    if error is None or repair is None or link.written is None:
        return repair
    written_tensor = link.written.tensor
    nearest_tensor = nearest(written_tensor, metric, reference)
    mild_change = _relative_change(written_tensor, nearest_tensor)
    change = _relative_change(written_tensor, error.tensor)
    if mild_change >= _MAX_MILD_CHANGE * change:
        return repair
    changes = f"{percent(mild_change, 2)} away, the slip's {percent(change, 2)}: check all entries"
    sentence = f"{repair.sentence}; the nearest tensor that can exist ({METRICS[metric]}) is only {changes}"
    return replace(repair, sentence=sentence)


def nearest_repair(link: ParsedLink, metric: str, reference: Array | None) -> FileRepair:
    """Repair by the nearest physically consistent tensor."""
    assert link.written is not None
    tensor = nearest(link.written.tensor, metric, reference)
    distance = percent(_relative_change(link.written.tensor, tensor), 2)
    sentence = f"no one slip explains it; the nearest tensor that can exist ({METRICS[metric]}) is {distance} away"
    kind = "nearest" if metric == "frobenius" else metric
    return _tensor_repair(link, kind, sentence, tensor, METRICS[metric])


def _relative_change(written: Array, tensor: Array) -> float:
    """Norm of the change from the written tensor to another one, relative to the written tensor."""
    return float(np.linalg.norm(tensor - written) / np.linalg.norm(written))


def shape_repair(
    link: ParsedLink, why: str = "no one slip explains it; this is the tensor of its shapes as uniform solids"
) -> FileRepair:
    """Repair by the tensor of the shapes at the link's mass, or advice if they have no volume."""
    tensor = reference_of(link)
    if tensor is None:
        return FileRepair("advice", "give it the tensor of its shape at its mass")
    return _tensor_repair(link, "shape", why, tensor)


def _tensor_repair(link: ParsedLink, kind: str, sentence: str, tensor: Array, metric: str = "") -> FileRepair:
    """Repair of a kind by another tensor, with the rounded entries that the file gets."""
    assert link.written is not None
    edits, rounded_tensor = link.written.tensor_edits(tensor)
    inertias = {link.name: link.written.with_tensor(rounded_tensor)}
    return FileRepair(kind, sentence, inertias, edits, metric)


def _extent_from_centre(link: ParsedLink, written: WrittenInertia) -> Array:
    """Largest distance (3,) of the shapes from the centre of mass, along each of the file's axes [m]."""
    low, high = link.shapes.box(written.R)  # corners along the file's axes, from the link's origin
    c = written.R.T @ written.com
    return np.maximum(np.abs(low - c), np.abs(high - c))


def identified_like(written: WrittenInertia) -> bool:
    """True if the tensor looks identified: no product is zero, and the largest is not small beside the moments."""
    products = np.abs(written.tensor[_PRODUCTS])
    min_product = _MIN_PRODUCT_OF_TRACE * written.tensor.trace()
    return bool(products.all() and products.max() > min_product)
