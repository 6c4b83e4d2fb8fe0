"""Masses without inertia, inertia without mass, placeholders, joints that move nothing, unlikely densities."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ...bodies.inertia import SpatialInertia
from ...core.printed_numbers import number, printed
from ...listing import listed
from ...model.massless import massless_links
from ...report.loaded_robot import reach
from ..described import DescribedLink, DescribedRobot, WrittenInertia
from ..findings import Effect, FileRepair, Finding, Severity
from ..shapes import hull_solid
from .inertia import MATTERS, no_tensor, placeholder, shape_repair
from .options import Options

_POINT = 10.0
"""% of M from which a mass without inertia matters: below it is a point mass as models in books have it."""
_LEAST_PER_METRE = 0.01
"""kg of moving links for each metre of reach: a thin carbon rod has twice as much."""
_NAMED = 6
"""Links that a sentence names; more are counted."""
_DENSITIES = 50.0, 8000.0
"""kg/m³, of the hull of a part: foam to steel."""


def _stand_ins(
    robot: DescribedRobot, is_one: Callable[[WrittenInertia], bool], least: float
) -> Iterator[tuple[DescribedLink, WrittenInertia, FileRepair, Effect, Severity]]:
    """Links with a mass whose tensor is a stand-in; how to mend it, what that changes, and whether it does by ``least``."""
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or not is_one(written):
            continue
        repair = shape_repair(link, "it is the tensor of its shapes as uniform solids")
        effect = robot.effects.of(repair.inertias)
        matters = robot.heavy(link) and effect.reaches(least)
        yield link, written, repair, effect, Severity.WARNING if matters else Severity.NOTE


def check_placeholder(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Moments that are one power of ten: a stand-in that was never replaced."""
    for link, written, repair, effect, severity in _stand_ins(robot, placeholder, MATTERS):
        yield Finding(
            "placeholder", severity, f"link {link.name!r}", written.line,
            f"its moments are {printed(written.tensor[0, 0])} kg m² about every axis at {number(written.mass)} kg, which "
            "looks like a placeholder",
            {"moment": float(written.tensor[0, 0]), "mass": written.mass}, effect, repair, written.file,
        )  # fmt: skip


def check_no_inertia(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Mass whose tensor is nothing, or rounding."""
    for link, written, repair, effect, severity in _stand_ins(robot, no_tensor, _POINT):
        largest = float(np.abs(written.tensor).max())
        yield Finding(
            "no-inertia", severity, f"link {link.name!r}", written.line,
            f"it has {number(written.mass)} kg and no rotational inertia ({number(largest, 1)} kg m²), as a point mass has",
            {"mass": written.mass, "largest": largest}, effect, repair, written.file,
        )  # fmt: skip


def check_no_mass(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Rotational inertia without a mass."""
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass != 0 or not written.tensor.any():
            continue
        repair = FileRepair("advice", "give it its mass, or no inertia", {link.name: SpatialInertia.zero()})
        effect = robot.effects.of(repair.inertias)
        yield Finding(
            "no-mass", Severity.WARNING if effect.reaches(MATTERS) else Severity.NOTE, f"link {link.name!r}", written.line,
            f"it has rotational inertia, {number(float(written.tensor.diagonal().max()), 3)} kg m², and no mass",
            {"largest": float(written.tensor.diagonal().max())}, effect, repair, written.file,
        )  # fmt: skip


def check_massless(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Moving links that stand for something real and have no mass; M is singular where nothing behind has any."""
    diagonal = robot.effects.diagonal
    least = 1e-12 * float(np.abs(diagonal).max(initial=0.0))
    nothing: dict[str, list[str]] = {}
    for name in massless_links(robot.model):
        body = robot.model.bodies[robot.model.frames[name].body]
        columns = range(body.v_index, body.v_index + body.joint.nv)
        nothing.setdefault("singular" if (diagonal[:, columns] <= least).any() else "light", []).append(name)
    for kind, names in nothing.items():
        link = robot.links.get(names[0], DescribedLink(names[0], 0))
        joints = [robot.model.bodies[robot.model.frames[name].body].joint.name for name in names]
        singular = kind == "singular"
        what = f"; M is singular, as {listed(map(repr, joints), _NAMED)} move nothing" if singular else ""
        yield Finding(
            "massless", Severity.WARNING if singular else Severity.NOTE,
            f"link{'s' * (len(names) > 1)} {listed(map(repr, names), _NAMED)}", link.line,
            f"no mass, and a joint of its own: weight and inertia are missing from every torque{what}",
            {"links": float(len(names))},
            repair=FileRepair("advice", f"give each a mass and a tensor, or fix the joints, lock={{{joints[0]!r}: 0, …}}"),
            file=link.file,
        )  # fmt: skip


def check_light(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Robots whose links weigh a few grams for each metre: masses in kilograms that were meant to be more."""
    model, length = robot.model, reach(robot.model)
    if not 0 < length < np.inf or not 0 < model.moving_mass < _LEAST_PER_METRE * length:
        return
    yield Finding(
        "light", Severity.WARNING, f"robot {model.name!r}", 0,
        f"all that moves weighs {number(1e3 * model.moving_mass)} g, and the robot reaches {number(length)} m",
        {"mass": model.moving_mass, "reach": length},
        repair=FileRepair("advice", "give each link its mass, in kilograms"),
    )  # fmt: skip


def check_assumed(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Inertia that the file does not give: SDF's 1 kg and 1 kg m², and what MJCF's compiler settings change."""
    means = {"mass": "1 kg", "inertia": "1 kg m² about every axis"}
    for link in robot.links.values():
        if link.assumed:
            said = " and ".join(f"no {part}, which means {means[part]}" for part in link.assumed)
            yield Finding(
                "assumed", Severity.WARNING if robot.moves(link.name) else Severity.NOTE, f"link {link.name!r}", link.line,
                f"it has {said}, in this format",
                repair=FileRepair("advice", "give it a mass and a tensor"), file=link.file,
            )  # fmt: skip
    for text in robot.settings:
        meant = text.startswith("settotalmass")
        yield Finding("assumed", Severity.NOTE if meant else Severity.WARNING, f"robot {robot.model.name!r}", 0, text)


def check_density(robot: DescribedRobot, _options: Options) -> Iterator[Finding]:
    """Mass over the volume of the hull of the shapes."""
    least, most = _DENSITIES
    for link in robot.links.values():
        written = link.written
        if written is None or not robot.heavy(link) or not link.shapes.complete:
            continue
        hull = hull_solid(link.shapes.points)
        volume = 0.0 if hull is None else float(hull.mass)  # at 1 kg/m³
        density = written.mass / volume if volume > 0 else 0.0
        if volume <= 0 or least <= density <= most:
            continue
        yield Finding(
            "density", Severity.NOTE, f"link {link.name!r}", written.line,
            f"{number(written.mass)} kg in a hull of {number(1e3 * volume, 3)} litres is {number(density, 3)} kg/m³; parts of "
            "robots have "
            f"{printed(least)} to {printed(most)}", {"density": density, "volume": volume}, file=written.file,
        )  # fmt: skip
