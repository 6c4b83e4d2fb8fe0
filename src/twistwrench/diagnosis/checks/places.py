"""Centres of mass outside the shapes, and parts that are drawn in another unit of length."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...core.printed_numbers import number
from ...model.inertia_checks import reasons
from ...model.model import BASE
from ...typing import Array
from ..described import DescribedLink, DescribedRobot, WrittenInertia, about_com
from ..findings import FileRepair, Finding, Severity
from ..slips import UNITS
from .inertia import MATTERS, identified
from .options import Options

_MARGIN = 0.1, 0.01
"""Of the diagonal of the shapes, and metres: how far outside a centre of mass may be."""
_REGROUPED = 0.25
"""Of the robot's span: how far outside that of an identified set may be."""
_SMALLEST = 0.005
"""m, the gyration radius of a part that is worth a mass."""
_LARGEST, _LEAST = 20.0, 1e-3
"""m, the diagonal of the shapes of one link."""


def check_com(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """A centre of mass outside the box of the link's shapes."""
    for link in robot.links.values():
        written = link.written
        if written is None or not robot.heavy(link) or not link.shapes.complete:
            continue
        low, high = link.shapes.points.min(axis=0), link.shapes.points.max(axis=0)
        inside = np.clip(written.com, low, high)
        away = float(np.linalg.norm(written.com - inside))
        if away <= _MARGIN[0] * link.shapes.diagonal + _MARGIN[1]:
            continue
        moved = about_com(written.mass, inside, written.inertia.moment_about_com)
        effect = robot.effects.of({link.name: moved})
        regrouped = identified(written) and away <= _REGROUPED * robot.span
        matters = effect.reaches(MATTERS) and not regrouped and not reasons(written.inertia)
        listed = " ".join(number(x) for x in written.com)
        fitting = _fitting(robot, link, written.com, low, high)
        hint = f"; read in the frame of {fitting!r} it would be inside" if fitting else ""
        yield Finding(
            "com-outside", Severity.WARNING if matters else Severity.NOTE, f"link {link.name!r}", written.line,
            f"its centre of mass, {listed} m, is {number(away, 3)} m outside its shapes{hint}; the effect is that of moving "
            "it to "
            "their edge", {"distance": away, "diagonal": link.shapes.diagonal}, effect,
            FileRepair("advice", "measure the centre of mass in the frame of the link"), written.file,
        )  # fmt: skip


def _fitting(robot: DescribedRobot, link: DescribedLink, com: Array, low: Array, high: Array) -> str:
    """The other link in whose frame, all joints at zero, the same numbers would be inside the shapes."""
    frames, bodies = robot.model.frames, robot.model.bodies
    if link.name not in frames:
        return ""
    own = frames[link.name].body
    above = {own} if own == BASE else {own, bodies[own].parent}
    poses = robot.neutral_poses
    for name, frame in frames.items():
        if frame.body not in above and (frame.body == BASE or bodies[frame.body].parent != own):
            continue  # neither the same body, nor what carries it or what it carries
        T = np.linalg.solve(poses[link.name], poses[name])
        place = T[:3, :3] @ com + T[:3, 3]
        if np.abs(T - np.eye(4)).max() > 1e-6 and (place >= low).all() and (place <= high).all():
            return name
    return ""


def check_units(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Shapes of tens of metres or below a millimetre, and tensors of bodies larger than the whole robot."""
    span = robot.span
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or reasons(written.inertia):
            continue
        if robot.heavy(link) and link.shapes.complete and not _LEAST <= link.shapes.diagonal <= _LARGEST:
            factor = "millimetres" if link.shapes.diagonal > _LARGEST else "metres written as millimetres"
            yield Finding(
                "units", Severity.WARNING, f"link {link.name!r}", link.line,
                f"its shapes are {number(link.shapes.diagonal, 3)} m long: are they in {factor}?",
                {"diagonal": link.shapes.diagonal},
                repair=FileRepair("advice", "scale its shapes to metres"), file=link.file,
            )  # fmt: skip
        yield from _giant(robot, link, written, span)


def _giant(robot: DescribedRobot, link: DescribedLink, written: WrittenInertia, span: float) -> Iterator[Finding]:
    """A gyration radius of more than a metre, and than the robot: moments in kg mm²."""
    radius = float(np.sqrt(max(np.linalg.eigvalsh(written.tensor)[-1], 0.0) / written.mass))
    if radius <= max(1.0, span) or link.shapes.complete:
        return
    # Several units may be plausible; then nothing is written, and the effect is that of the largest.
    units = [k for k in UNITS if _SMALLEST <= radius * 10.0 ** (-k / 2) <= 0.5 * max(span, 1e-9)]
    tensor = written.tensor * 10.0 ** -(units[0] if units else 6)
    edits, tensor = written.edits(tensor)
    wanted = {link.name: written.with_tensor(tensor)}
    if len(units) == 1:
        said = f"all entries are 1e{units[0]} times too large, as {UNITS[units[0]]} for kg m²"
        repair = FileRepair("slip", said, wanted, edits)
    else:
        repair = FileRepair("advice", "give it the tensor of its shape at its mass, in kg m²", wanted)
    effect = robot.effects.of(repair.inertias)
    yield Finding(
        "units", Severity.WARNING if effect.reaches(MATTERS) and robot.heavy(link) else Severity.NOTE,
        f"link {link.name!r}", written.line,
        f"its gyration radius is {number(radius, 3)} m, more than the whole robot's span of {number(span, 3)} m",
        {"gyration_radius": radius, "span": span}, effect, repair, written.file,
    )  # fmt: skip
