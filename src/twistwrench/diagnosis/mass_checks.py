"""Checks of masses: placeholders, missing inertias, and densities."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from ..core.numbers import number, printed
from ..core.text import Argument, listed, spell
from ..formats.robot_text import WrittenInertia
from ..formats.sdf import assumed_text
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.inertia_checks import massless_links
from ..motion.load_case import reach
from ..shapes.solids import hull_solid
from .findings import Effect, FileRepair, Finding, Severity
from .options import Options
from .parsed_file import ParsedFile, ParsedLink
from .tensor_checks import MIN_EFFECT, no_tensor, placeholder, shape_repair

_MIN_POINT_MASS_EFFECT = 10.0
"""Change of the mass matrix M [%] above which a missing inertia is relevant; below it, the link may be a point mass."""
_MIN_MASS_PER_METRE = 0.01
"""Smallest mass of moving links per metre of reach [kg/m]: half that of a thin carbon rod."""
_MAX_LISTED_LINKS = 6
"""Largest number of links that a sentence names; further ones are counted."""
_MIN_DENSITY = 50.0
"""Smallest plausible density of a part's hull [kg/m³], that of foam."""
_MAX_DENSITY = 8000.0
"""Largest plausible density of a part's hull [kg/m³], that of steel."""
_ROUND_OFF = 1e-12
"""Entry of M, relative to the largest, up to which it is a rounding error."""


def _shape_repairs(
    robot: ParsedFile, lacks_tensor: Callable[[WrittenInertia], bool]
) -> Iterator[tuple[ParsedLink, WrittenInertia, FileRepair, Effect]]:
    """Links with a mass whose tensor is missing: link, its inertia as written, repair by its shapes, effect of the repair."""
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or not lacks_tensor(written):
            continue
        repair = shape_repair(link, "it is the tensor of its shapes as uniform solids")
        yield link, written, repair, robot.effects.evaluate(repair.inertias)


def check_placeholder(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Equal moments that are a power of ten: an unreplaced placeholder."""
    for link, written, repair, effect in _shape_repairs(robot, placeholder):
        moment = float(written.tensor[0, 0])
        sentence = (
            f"its moments are {printed(moment)} kg m² about every axis at {number(written.mass)} kg, which looks like a "
            "placeholder"
        )
        is_relevant = robot.heavy(link) and effect.reaches(MIN_EFFECT)
        numbers = {"moment": moment, "mass": written.mass}
        yield link.finding("placeholder", is_relevant, sentence, numbers, effect, repair)


def check_no_inertia(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Mass with a tensor that is zero or a rounding error."""
    for link, written, repair, effect in _shape_repairs(robot, no_tensor):
        max_entry = float(np.abs(written.tensor).max())
        is_relevant = robot.heavy(link) and effect.reaches(_MIN_POINT_MASS_EFFECT)
        yield link.finding(
            "no-inertia", is_relevant,
            f"it has {number(written.mass)} kg and no rotational inertia ({number(max_entry, 1)} kg m²), as a point mass has",
            {"mass": written.mass, "largest": max_entry}, effect, repair,
        )  # fmt: skip


def check_no_mass(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Rotational inertia without a mass."""
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass != 0 or not written.tensor.any():
            continue
        repair = FileRepair("advice", "give it its mass, or no inertia", {link.name: SpatialInertia.zero()})
        effect = robot.effects.evaluate(repair.inertias)
        max_moment = float(written.tensor.diagonal().max())
        is_relevant = effect.reaches(MIN_EFFECT)
        sentence = f"it has rotational inertia, {number(max_moment, 3)} kg m², and no mass"
        yield link.finding("no-mass", is_relevant, sentence, {"largest": max_moment}, effect, repair)


def check_massless(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Moving links without mass; the mass matrix M is singular if no link that they carry has mass."""
    diagonal = robot.effects.diagonal  # of M at several poses, (poses, nv)
    max_rounding_error = _ROUND_OFF * float(np.abs(diagonal).max(initial=0.0))
    joints_by_effect: dict[bool, dict[str, str]] = {}  # joint by link, apart for links that make M singular
    for link in massless_links(robot.model):
        body = robot.model.bodies[robot.model.frames[link].body]
        _, v_entries = body.places
        makes_singular = bool((diagonal[:, v_entries] <= max_rounding_error).any())
        joints_by_effect.setdefault(makes_singular, {})[link] = body.joint.name
    for makes_singular, joint_by_link in joints_by_effect.items():
        yield _massless_finding(robot, joint_by_link, makes_singular)


def _massless_finding(robot: ParsedFile, joint_by_link: Mapping[str, str], makes_singular: bool) -> Finding:
    """Finding about massless links, whose joints are the values of ``joint_by_link``."""
    links = list(joint_by_link)
    joints = list(joint_by_link.values())
    severity = Severity.NOTE
    consequence = ""
    if makes_singular:
        severity = Severity.WARNING
        consequence = f"; M is singular, as {listed(map(repr, joints), _MAX_LISTED_LINKS)} move nothing"
    first_link = robot.links.get(links[0], ParsedLink(links[0], 0))  # line 0 if the file does not have the link
    lock_argument = spell(Argument("lock", {joints[0]: 0}))
    noun = "link" if len(links) == 1 else "links"
    return Finding(
        "massless", severity, f"{noun} {listed(map(repr, links), _MAX_LISTED_LINKS)}", first_link.line,
        f"no mass, and a joint of its own: weight and inertia are missing from every torque{consequence}",
        {"links": float(len(links))},
        repair=FileRepair("advice", f"give each a mass and a tensor, or fix the joints, {lock_argument}"),
        file=first_link.file,
    )  # fmt: skip


def check_light(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Robots with a few grams per metre: masses probably in a wrong unit."""
    model = robot.model
    robot_reach = reach(model)  # [m]
    if not 0 < robot_reach < np.inf:
        return
    if not 0 < model.moving_mass < _MIN_MASS_PER_METRE * robot_reach:
        return
    yield Finding(
        "light", Severity.WARNING, f"robot {model.name!r}", 0,
        f"all that moves weighs {number(1e3 * model.moving_mass)} g, and the robot reaches {number(robot_reach)} m",
        {"mass": model.moving_mass, "reach": robot_reach},
        repair=FileRepair("advice", "give each link its mass, in kilograms"),
    )  # fmt: skip


def check_assumed(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Inertia that is not written in the file: SDF's defaults, 1 kg and 1 kg m², and changes by MJCF's compiler settings."""
    for link in robot.links.values():
        if not link.assumed:
            continue
        severity = Severity.WARNING if robot.moves(link.name) else Severity.NOTE
        yield Finding(
            "assumed", severity, f"link {link.name!r}", link.line, f"it has {assumed_text(link.assumed)}",
            repair=FileRepair("advice", "give it a mass and a tensor"), file=link.file,
        )  # fmt: skip
    for setting in robot.settings:
        is_chosen_mass = setting.startswith("settotalmass")
        severity = Severity.NOTE if is_chosen_mass else Severity.WARNING
        yield Finding("assumed", severity, f"robot {robot.model.name!r}", 0, setting)


def check_density(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Implausible densities: mass divided by the volume of the hull of the shapes."""
    for link in robot.links.values():
        written = link.written
        if written is None or not robot.heavy(link) or not link.shapes.complete:
            continue
        hull = hull_solid(link.shapes.points)
        if hull is None or hull.mass <= 0:
            continue
        volume = float(hull.mass)  # [m³]: the hull's mass at 1 kg/m³
        density = written.mass / volume
        if _MIN_DENSITY <= density <= _MAX_DENSITY:
            continue
        sentence = (
            f"{number(written.mass)} kg in a hull of {number(1e3 * volume, 3)} litres is {number(density, 3)} kg/m³; parts of "
            f"robots have {printed(_MIN_DENSITY)} to {printed(_MAX_DENSITY)}"
        )
        yield link.finding("density", False, sentence, {"density": density, "volume": volume})
