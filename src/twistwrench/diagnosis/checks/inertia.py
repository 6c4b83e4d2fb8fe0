"""Checks of tensors: physically impossible ones, and those that do not fit the link's shapes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...core.numbers import number, percent
from ...formats.robot_text import WrittenInertia
from ...model.inertia_checks import reasons
from ...model.model import BASE
from ...typing import Array
from ..entry_errors import (
    EntryError,
    Options,
    explain,
    impossible_tensor_errors,
    large_tensor_errors,
    small_tensor_errors,
)
from ..findings import FileRepair, Finding, Severity
from ..parsed_file import ParsedFile, ParsedLink
from ..shapes import METRICS, nearest

_ABSORBED = 1.0
"""% of M from which an impossible link within a possible body matters."""
MATTERS = 5.0
"""% of M from which a tensor of another size than its shapes matters."""
_FACTOR = 2.0
"""Factor above the largest moment in its box from which a moment is too large."""
_IDENTIFIED = 10.0
"""Factor above that largest moment up to which base-parameter regrouping can explain it."""
_SMALL = 1.0 / 30.0
"""Share of the diagonal of its shapes below which a gyration radius is too small."""


def check_impossible(robot: ParsedFile, options: Options) -> Iterator[Finding]:
    """Negative moments, or a broken triangle inequality, of a link by itself."""
    refused = {i for i, body in enumerate(robot.model.bodies) if reasons(body.inertia)}
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or no_tensor(written) or not (why := reasons(written.inertia)):
            continue
        body = robot.model.frames[link.name].body if link.name in robot.model.frames else BASE
        reference = reference_of(link)
        error = explain(impossible_tensor_errors(written.tensor), reference)
        repair = (
            entry_error_repair(link, error)
            if error is not None
            else nearest_repair(link, options.metric, reference if options.metric == "entropic" else None)
        )
        effect = robot.effects.evaluate(repair.inertias)
        if body in refused:
            severity, fate = Severity.ERROR, "the moving body it belongs to cannot exist, and is refused on loading"
        elif body == BASE:
            severity, fate = Severity.NOTE, "it does not move"
        else:
            severity = Severity.WARNING if effect.reaches(_ABSORBED) else Severity.NOTE
            fate = "with what is fixed to it, it makes a body that can exist"
        yield Finding(
            "impossible", severity, f"link {link.name!r}", written.line, f"its tensor cannot exist: {'; '.join(why)}; {fate}",
            dict(zip(("moment_1", "moment_2", "moment_3"), np.linalg.eigvalsh(written.tensor).tolist(), strict=True)),
            effect, repair, written.file,
        )  # fmt: skip


def check_too_large(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """A moment above twice the largest that the mass could have within the box of the link's shapes."""
    for link, written in judged(robot):
        reach = _reach(link, written)

        def fits(tensor: Array, reach: Array = reach, mass: float = written.mass) -> bool:
            return bool((tensor.diagonal() <= _FACTOR * _most(reach, mass)).all())

        if fits(written.tensor) or not reach.all():
            continue
        most = _most(reach, written.mass)
        axis = int((written.tensor.diagonal() / most).argmax())
        factor = float(written.tensor[axis, axis] / most[axis])
        reference = reference_of(link)
        error = explain(large_tensor_errors(written.tensor, written, fits, reference), reference)
        if error is None and factor <= _IDENTIFIED and identified(written):
            repair = None
            severity, more = Severity.NOTE, ", as identified sets have, whose parts are right in their sums only"
        else:
            repair, severity, more = (
                entry_error_repair(link, error) if error is not None else shape_repair(link),
                None,
                "",
            )
        effect = robot.effects.evaluate(repair.inertias) if repair is not None else robot.effects.evaluate({})
        if severity is None:
            severity = Severity.WARNING if effect.reaches(MATTERS) else Severity.NOTE
        name = ("ixx", "iyy", "izz")[axis]
        radius = float(np.sqrt(written.tensor[axis, axis] / written.mass))
        yield Finding(
            "too-large", severity, f"link {link.name!r}", written.line,
            f"its tensor is too large for its shapes: {name} is {number(written.tensor[axis, axis])} kg m², a gyration radius "
            f"of {number(radius, 3)} m, and {number(written.mass)} kg in their box have {number(most[axis], 3)} at most{more}",
            {"factor": factor, "gyration_radius": radius, "largest": float(most[axis])}, effect, repair, written.file,
        )  # fmt: skip


def check_too_small(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """A largest gyration radius below a thirtieth of the diagonal of the shapes."""
    for link, written in judged(robot):
        largest = float(np.linalg.eigvalsh(written.tensor)[-1])
        radius, diagonal = float(np.sqrt(max(largest, 0.0) / written.mass)), link.shapes.diagonal
        if radius >= _SMALL * diagonal or no_tensor(written):
            continue
        reference = reference_of(link)
        error = explain(small_tensor_errors(written.tensor, reference), reference)
        repair = entry_error_repair(link, error) if error is not None else shape_repair(link)
        effect = robot.effects.evaluate(repair.inertias)
        yield Finding(
            "too-small", Severity.WARNING if effect.reaches(MATTERS) else Severity.NOTE, f"link {link.name!r}", written.line,
            f"its tensor is too small for its shapes: its gyration radius is {number(radius, 2)} m, their diagonal "
            f"{number(diagonal, 2)} m",
            {"gyration_radius": radius, "diagonal": diagonal}, effect, repair, written.file,
        )  # fmt: skip


def judged(robot: ParsedFile) -> Iterator[tuple[ParsedLink, WrittenInertia]]:
    """Links with a hundredth of the mass, a possible tensor, and shapes that were all read."""
    for link in robot.links.values():
        written = link.written
        fine = written is not None and robot.heavy(link) and not reasons(written.inertia)
        if written is not None and fine and not placeholder(written) and link.shapes.complete:
            yield link, written


def no_tensor(written: WrittenInertia) -> bool:
    """True if the tensor is zero, rounding beside the moments about the origin, or that of a body of a micrometre."""
    largest = float(np.abs(written.tensor).max())
    return largest <= max(1e-13 * float(np.abs(written.inertia.moment_about_origin).max()), 1e-12 * written.mass)


def placeholder(written: WrittenInertia) -> bool:
    """True if the moments are one power of ten, as in templates, and the products zero or the same."""
    value = float(written.tensor[0, 0])
    if value <= 0 or (written.tensor.diagonal() != value).any():
        return False
    products = set(np.abs(written.tensor[[0, 0, 1], [1, 2, 2]]).tolist())
    return products <= {0.0, value} and abs(np.log10(value) - round(np.log10(value))) < 1e-9


def reference_of(link: ParsedLink) -> Array | None:
    """The tensor of the link's shapes at its mass, along the axes its own is written in; None without volume."""
    if link.written is None or not link.shapes.complete:
        return None
    tensor = link.shapes.tensor(link.written.mass)
    R = link.written.R
    return None if tensor is None else np.asarray(R.T @ tensor @ R)


def entry_error_repair(link: ParsedLink, error: EntryError) -> FileRepair:
    """Repair by the tensor that an entry error explains."""
    return _repair(link, "slip", f"one slip explains it: {error.sentence}", error.tensor)


def nearest_repair(link: ParsedLink, metric: str, reference: Array | None) -> FileRepair:
    """The nearest tensor that can exist."""
    assert link.written is not None
    tensor = nearest(link.written.tensor, metric, reference)
    change = float(np.linalg.norm(tensor - link.written.tensor) / np.linalg.norm(link.written.tensor))
    sentence = (
        f"no one slip explains it; the nearest tensor that can exist ({METRICS[metric]}) is {percent(change, 2)} away"
    )
    return _repair(link, "nearest" if metric == "frobenius" else metric, sentence, tensor, METRICS[metric])


def shape_repair(
    link: ParsedLink, why: str = "no one slip explains it; this is the tensor of its shapes as uniform solids"
) -> FileRepair:
    """The tensor of the shapes at the link's mass, or advice where they have no volume."""
    tensor = reference_of(link)
    if tensor is None:
        return FileRepair("advice", "give it the tensor of its shape at its mass")
    return _repair(link, "shape", why, tensor)


def _repair(link: ParsedLink, kind: str, sentence: str, tensor: Array, metric: str = "") -> FileRepair:
    assert link.written is not None
    edits, tensor = link.written.tensor_edits(tensor)
    return FileRepair(kind, sentence, {link.name: link.written.with_tensor(tensor)}, edits, metric)


def _reach(link: ParsedLink, written: WrittenInertia) -> Array:
    """Extent (3,) of the shapes from the centre of mass along the written axes [m]."""
    low, high = link.shapes.box(written.R)
    c = written.R.T @ written.com
    return np.maximum(np.abs(low - c), np.abs(high - c))


def _most(reach: Array, mass: float) -> Array:
    """The largest moments that a mass within that reach can have."""
    return np.asarray(mass * (reach @ reach - reach**2))


def identified(written: WrittenInertia) -> bool:
    """True if the numbers look identified: all six are given, and the products are not small beside the moments."""
    products = np.abs(written.tensor[[0, 0, 1], [1, 2, 2]])
    return bool(products.all() and products.max() > 1e-3 * written.tensor.trace())
