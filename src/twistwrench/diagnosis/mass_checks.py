"""Checks of masses: placeholders, missing inertias, densities, symmetry, and centres of mass outside the shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..core.numbers import number, percent, printed
from ..core.text import Argument, listed, spell
from ..core.typing import Array
from ..formats.edit import Edit
from ..formats.robot_text import WrittenInertia, inertia_about_com
from ..formats.sdf import assumed_text
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.inertia_checks import massless_links, reasons
from ..mechanics.model.model import BASE
from ..motion.load_case import reach
from ..shapes.solids import hull_solid
from .findings import Effect, FileRepair, Finding, Severity
from .parsed_file import ParsedFile, ParsedLink, SymmetricLinks, symmetric_links
from .tensor_checks import MATTERS, UNITS, Options, identified, no_tensor, placeholder, shape_repair

_POINT = 10.0
"""Percentage of M above which a missing inertia is relevant; below it, the link is a textbook point mass."""
_LEAST_PER_METRE = 0.01
"""Smallest mass of moving links per metre of reach [kg/m]: half of a thin carbon rod's."""
_NAMED = 6
"""Largest number of links that a sentence names; further ones are counted."""
_DENSITIES = 50.0, 8000.0
"""Range of plausible densities of a part's hull [kg/m³]: foam to steel."""


def _stand_ins(
    robot: ParsedFile, is_one: Callable[[WrittenInertia], bool], least: float
) -> Iterator[tuple[ParsedLink, WrittenInertia, bool, Effect, FileRepair]]:
    """Links with a mass and a placeholder tensor: repair, its effect, and True if the effect is at least ``least``."""
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or not is_one(written):
            continue
        repair = shape_repair(link, "it is the tensor of its shapes as uniform solids")
        effect = robot.effects.evaluate(repair.inertias)
        yield link, written, robot.heavy(link) and effect.reaches(least), effect, repair


def check_placeholder(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Equal moments that are a power of ten: an unreplaced placeholder."""
    for link, written, matters, effect, repair in _stand_ins(robot, placeholder, MATTERS):
        moment = float(written.tensor[0, 0])
        said = (
            f"its moments are {printed(moment)} kg m² about every axis at {number(written.mass)} kg, which looks like a "
            "placeholder"
        )
        yield link.finding("placeholder", matters, said, {"moment": moment, "mass": written.mass}, effect, repair)


def check_no_inertia(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Mass with a tensor that is zero or a rounding error."""
    for link, written, matters, effect, repair in _stand_ins(robot, no_tensor, _POINT):
        largest = float(np.abs(written.tensor).max())
        yield link.finding(
            "no-inertia", matters,
            f"it has {number(written.mass)} kg and no rotational inertia ({number(largest, 1)} kg m²), as a point mass has",
            {"mass": written.mass, "largest": largest}, effect, repair,
        )  # fmt: skip


def check_no_mass(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Rotational inertia without a mass."""
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass != 0 or not written.tensor.any():
            continue
        repair = FileRepair("advice", "give it its mass, or no inertia", {link.name: SpatialInertia.zero()})
        effect = robot.effects.evaluate(repair.inertias)
        largest = float(written.tensor.diagonal().max())
        said = f"it has rotational inertia, {number(largest, 3)} kg m², and no mass"
        yield link.finding("no-mass", effect.reaches(MATTERS), said, {"largest": largest}, effect, repair)


def check_massless(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Moving links without mass; M is singular if no link after them has mass."""
    diagonal = robot.effects.diagonal
    least = 1e-12 * float(np.abs(diagonal).max(initial=0.0))
    nothing: dict[str, list[str]] = {}
    for name in massless_links(robot.model):
        body = robot.model.bodies[robot.model.frames[name].body]
        columns = range(body.v_index, body.v_index + body.joint.nv)
        nothing.setdefault("singular" if (diagonal[:, columns] <= least).any() else "light", []).append(name)
    for kind, names in nothing.items():
        link = robot.links.get(names[0], ParsedLink(names[0], 0))
        joints = [robot.model.bodies[robot.model.frames[name].body].joint.name for name in names]
        singular, fixed = kind == "singular", spell(Argument("lock", {joints[0]: 0}))
        what = f"; M is singular, as {listed(map(repr, joints), _NAMED)} move nothing" if singular else ""
        yield Finding(
            "massless", Severity.WARNING if singular else Severity.NOTE,
            f"link{'s' * (len(names) > 1)} {listed(map(repr, names), _NAMED)}", link.line,
            f"no mass, and a joint of its own: weight and inertia are missing from every torque{what}",
            {"links": float(len(names))},
            repair=FileRepair("advice", f"give each a mass and a tensor, or fix the joints, {fixed}"),
            file=link.file,
        )  # fmt: skip


def check_light(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Robots with a few grams per metre: masses probably in a wrong unit."""
    model, length = robot.model, reach(robot.model)
    if not 0 < length < np.inf or not 0 < model.moving_mass < _LEAST_PER_METRE * length:
        return
    yield Finding(
        "light", Severity.WARNING, f"robot {model.name!r}", 0,
        f"all that moves weighs {number(1e3 * model.moving_mass)} g, and the robot reaches {number(length)} m",
        {"mass": model.moving_mass, "reach": length},
        repair=FileRepair("advice", "give each link its mass, in kilograms"),
    )  # fmt: skip


def check_assumed(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Inertia that is not in the file: SDF's default 1 kg and 1 kg m², and changes by MJCF's compiler settings."""
    for link in robot.links.values():
        if link.assumed:
            yield Finding(
                "assumed", Severity.WARNING if robot.moves(link.name) else Severity.NOTE, f"link {link.name!r}", link.line,
                f"it has {assumed_text(link.assumed)}",
                repair=FileRepair("advice", "give it a mass and a tensor"), file=link.file,
            )  # fmt: skip
    for text in robot.settings:
        meant = text.startswith("settotalmass")
        yield Finding("assumed", Severity.NOTE if meant else Severity.WARNING, f"robot {robot.model.name!r}", 0, text)


def check_density(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Mass divided by the volume of the hull of the shapes."""
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
        said = (
            f"{number(written.mass)} kg in a hull of {number(1e3 * volume, 3)} litres is {number(density, 3)} kg/m³; parts of "
            f"robots have {printed(least)} to {printed(most)}"
        )
        yield link.finding("density", False, said, {"density": density, "volume": volume})


# ── Symmetry of left and right

_MASS, _COM, _TENSOR = 1e-3, 2e-3, 0.05
"""Tolerances: fraction of the mass, metres, fraction of the trace."""
_HEAVY = 1e-3
"""Smallest mass of either side as a fraction of the robot's mass."""
_MATTERS, _TORQUE = 0.5, 0.2
"""Percentages of M and of the effort limit above which a difference is relevant."""


def check_mirror(robot: ParsedFile, options: Options) -> Iterator[Finding]:
    """Pairs of links with mirrored frames at zero, but without mirrored masses, centres of mass or tensors."""
    for pair in symmetric_links(robot):
        a, b = pair.left.written, pair.right.written
        if a is None or b is None or not (a.mass > 0 and b.mass > 0):
            continue
        image = mirrored(a.inertia, pair.D)
        said, numbers = _differences(b.inertia, image)
        same = np.allclose(a.inertia.parameters, b.inertia.parameters, rtol=1e-3, atol=1e-9)
        if not said or (same and _shapes(pair.left) == _shapes(pair.right)):  # or the same part is mounted twice
            continue
        copies = {"left": (pair.right, image), "right": (pair.left, mirrored(b.inertia, pair.D.T))}
        effects = {side: robot.effects.evaluate({link.name: G}) for side, (link, G) in copies.items()}
        side = options.mirror_from or max(effects, key=lambda s: effects[s].inertia_percent + effects[s].effort_percent)
        link, wanted = copies[side]
        parts = _parts_mirrored(pair)
        heavy = robot.heavy(pair.left, _HEAVY) or robot.heavy(pair.right, _HEAVY)
        matters = parts and heavy and effects[side].reaches(_MATTERS, _TORQUE)
        more = "" if parts else "; one mesh serves both, or their shapes do not decide"
        edits: tuple[Edit, ...] = ()
        if options.mirror_from and reasons(wanted):
            sentence = f"the {side} one, which cannot exist itself: repair it first"
        elif options.mirror_from:
            sentence = f"the {side} one, mirrored"
            edits = link.written.edits(wanted) if link.written is not None and parts else ()
        else:
            sentence = f"copy one side to the other, mirrored; {_evidence(pair)}"
        yield Finding(
            "mirror", Severity.WARNING if matters else Severity.NOTE,
            f"links {pair.left.name!r} and {pair.right.name!r}", a.line,
            f"they mirror each other, and their inertias do not: {'; '.join(said)}{more}", numbers, effects[side],
            FileRepair("mirror", sentence, {link.name: wanted}, edits), a.file,
        )  # fmt: skip


def _evidence(pair: SymmetricLinks) -> str:
    """Sentence naming the side whose centre of mass is much nearer to the centre of its shapes."""
    unknown = "the file does not determine which is meant"
    away = []
    for link in (pair.left, pair.right):
        if link.written is None or not link.shapes.complete or link.shapes.uniform is None:
            return unknown
        away.append(float(np.linalg.norm(link.written.com - link.shapes.uniform.com)))
    if min(away) > 0.5 * max(away) or max(away) - min(away) < _COM:
        return unknown
    side, near, far = ("left" if away[0] < away[1] else "right"), 1e3 * min(away), 1e3 * max(away)
    distance = f"{number(near, 2)} mm from theirs, not {number(far, 2)}"
    return f"the shapes speak for the {side} one, whose centre of mass is {distance}"


def mirrored(inertia: SpatialInertia, D: Array) -> SpatialInertia:
    """Inertia of the mirrored body; D (3, 3) maps its points."""
    return inertia_about_com(inertia.mass, D @ inertia.com, D @ inertia.moment_about_com @ D.T)


def _differences(given: SpatialInertia, image: SpatialInertia) -> tuple[list[str], dict[str, float]]:
    mass = abs(given.mass - image.mass) / max(given.mass, image.mass)
    com = float(np.linalg.norm(given.com - image.com))
    I, J = given.moment_about_com, image.moment_about_com
    tensor = float(np.linalg.norm(I - J) / max(I.trace(), J.trace(), 1e-300))
    said = [f"masses {number(image.mass)} and {number(given.mass)} kg"] if mass > _MASS else []
    said += [f"centres of mass {number(1e3 * com, 3)} mm apart"] if com > _COM else []
    said += [f"tensors {percent(tensor, 2)} of their trace apart"] if tensor > _TENSOR else []
    return said, {"mass_share": mass, "com_distance": com, "tensor_share": tensor}


def _parts_mirrored(pair: SymmetricLinks) -> bool:
    """True if the parts are mirror images: different mesh files on the sides, or a mesh with a negative scale.

    If all shapes were read, their boxes must also be mirrored.
    """
    a, b = pair.left, pair.right
    files = [{shape.mesh for shape in link.shapes.shapes if shape.kind == "mesh"} for link in (a, b)]
    signs = [{np.prod(np.sign(shape.sizes)) for shape in link.shapes.shapes if shape.kind == "mesh"} for link in (a, b)]
    if not files[0] or not files[1] or (files[0] == files[1] and signs[0] == signs[1]):
        return False
    if not (a.shapes.complete and b.shapes.complete):
        return True
    image, points = a.shapes.points @ pair.D.T, b.shapes.points
    allowed = 0.05 * a.shapes.diagonal + 2e-3
    low, high = np.abs(image.min(axis=0) - points.min(axis=0)), np.abs(image.max(axis=0) - points.max(axis=0))
    return bool(max(low.max(), high.max()) <= allowed)


def _shapes(link: ParsedLink) -> list[tuple[str, tuple[float, ...], str]]:
    return sorted((shape.kind, shape.sizes, shape.mesh) for shape in link.shapes.shapes)


# ── Centres of mass outside the shapes, and shapes in another unit of length

_MARGIN = 0.1, 0.01
"""Largest distance of a centre of mass from the shapes: fraction of their diagonal, and metres."""
_REGROUPED = 0.25
"""Largest distance for identified parameters, as a fraction of the robot's span."""
_SMALLEST = 0.005
"""Smallest plausible gyration radius of a part with mass [m]."""
_LARGEST, _LEAST = 20.0, 1e-3
"""Largest and smallest plausible diagonal of the shapes of a link [m]."""
_BEYOND = 3.0
"""Largest distance of a centre of mass from the link frame: ratio to the robot's span, and metres. Real files: 1.5, 2."""
_GRAMS = 150.0
"""Ratio to the next heaviest link, and to the median, above which a mass is too large; up to 100 in real files."""
_COMPACT = 0.008
"""Ratio to the robot's span below which a gyration radius is too small; at least 0.0116 in real files."""


def check_com(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
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
        moved = inertia_about_com(written.mass, inside, written.inertia.moment_about_com)
        effect = robot.effects.evaluate({link.name: moved})
        regrouped = identified(written) and away <= _REGROUPED * robot.span
        matters = effect.reaches(MATTERS) and not regrouped and not reasons(written.inertia)
        listed = " ".join(number(x) for x in written.com)
        fitting = _fitting(robot, link, written.com, low, high)
        hint = f"; read in the frame of {fitting!r} it would be inside" if fitting else ""
        yield link.finding(
            "com-outside", matters,
            f"its centre of mass, {listed} m, is {number(away, 3)} m outside its shapes{hint}; the effect is that of moving it "
            "to their edge", {"distance": away, "diagonal": link.shapes.diagonal}, effect,
            FileRepair("advice", "measure the centre of mass in the frame of the link"),
        )  # fmt: skip


def _fitting(robot: ParsedFile, link: ParsedLink, com: Array, low: Array, high: Array) -> str:
    """Other link in whose frame (at zero joint positions) the centre of mass would lie within the shapes."""
    frames, bodies = robot.model.frames, robot.model.bodies
    if link.name not in frames:
        return ""
    own = frames[link.name].body
    above = {own} if own == BASE else {own, bodies[own].parent}
    poses = robot.neutral_poses
    for name, frame in frames.items():
        if frame.body not in above and (frame.body == BASE or bodies[frame.body].parent != own):
            continue  # same body, ancestor or descendant
        T = np.linalg.solve(poses[link.name], poses[name])
        place = T[:3, :3] @ com + T[:3, 3]
        if np.abs(T - np.eye(4)).max() > 1e-6 and (place >= low).all() and (place <= high).all():
            return name
    return ""


def check_units(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Shapes, centres of mass, masses and gyration radii that are implausible for the robot's size."""
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
        yield from _far_com(robot, link, written, span)
        yield from _grams(robot, link, written, span)


def _far_com(robot: ParsedFile, link: ParsedLink, written: WrittenInertia, span: float) -> Iterator[Finding]:
    """Centre of mass beyond the robot's span from its link frame: probably millimetres."""
    away = float(np.linalg.norm(written.com))
    if away <= (max(_BEYOND * span, _BEYOND) if span > 0 else _LARGEST) or link.shapes.complete:
        return
    wanted = inertia_about_com(written.mass, 1e-3 * written.com, written.inertia.moment_about_com)
    if span > 0 and 1e-3 * away <= span:
        repair = FileRepair(
            "slip", "in millimetres, for metres: divide it by 1000", {link.name: wanted}, written.edits(wanted)
        )
    else:
        repair = FileRepair("advice", "give the centre of mass in metres, in the frame of the link")
    effect = robot.effects.evaluate({link.name: wanted})
    said = (
        f"its centre of mass is {number(away, 3)} m from the frame of the link, and the robot spans {number(span, 3)} m"
    )
    matters = robot.heavy(link) and effect.reaches(MATTERS)
    yield link.finding("units", matters, said, {"distance": away, "span": span}, effect, repair)


def _grams(robot: ParsedFile, link: ParsedLink, written: WrittenInertia, span: float) -> Iterator[Finding]:
    """Mass far above all others, or too large for its tensor: probably grams."""
    others = [other.written.mass for other in robot.links.values() if other.written is not None and other is not link]
    others = [mass for mass in others if mass > 0]
    times = written.mass / max(others) if len(others) > 1 else 0.0
    radius = float(np.sqrt(max(np.linalg.eigvalsh(written.tensor)[-1], 0.0) / written.mass))
    compact = robot.moves(link.name) and robot.heavy(link) and radius < _COMPACT * span
    compact = compact and not (no_tensor(written) or placeholder(written) or link.shapes.complete)
    if times < _GRAMS and not compact:
        return
    wanted = inertia_about_com(1e-3 * written.mass, written.com, written.inertia.moment_about_com)
    alike = len(others) > 1 and 1e-3 * written.mass <= max(others) and written.mass >= _GRAMS * np.median(others)
    if alike:
        repair = FileRepair(
            "slip", "in grams, for kilograms: divide it by 1000", {link.name: wanted}, written.edits(wanted)
        )
    else:
        repair = FileRepair("advice", "give the mass in kilograms, or the tensor in kg m²: 1000 g are 1 kg")
    said = f"its mass is {number(written.mass)} kg"
    said += f", {number(times, 3)} times that of the next heaviest link" if times >= _GRAMS else ""
    small = (
        f"at its tensor, a gyration radius of {number(1e3 * radius, 2)} mm in a robot that spans {number(span, 3)} m"
    )
    said += f"; {small}" if compact else ""
    effect = robot.effects.evaluate({link.name: wanted})
    numbers = {"mass": written.mass, "times": times, "gyration_radius": radius, "span": span}
    yield link.finding("units", effect.reaches(MATTERS), said, numbers, effect, repair)


def _giant(robot: ParsedFile, link: ParsedLink, written: WrittenInertia, span: float) -> Iterator[Finding]:
    """Gyration radius above a metre and above the robot's span: moments in kg mm²."""
    radius = float(np.sqrt(max(np.linalg.eigvalsh(written.tensor)[-1], 0.0) / written.mass))
    if radius <= max(1.0, span) or link.shapes.complete:
        return
    # If several units are plausible, nothing is written, and the effect is that of the largest.
    units = [k for k in UNITS if _SMALLEST <= radius * 10.0 ** (-k / 2) <= 0.5 * max(span, 1e-9)]
    tensor = written.tensor * 10.0 ** -(units[0] if units else 6)
    edits, tensor = written.tensor_edits(tensor)
    wanted = {link.name: written.with_tensor(tensor)}
    if len(units) == 1:
        said = f"all entries are 1e{units[0]} times too large, as {UNITS[units[0]]} for kg m²"
        repair = FileRepair("slip", said, wanted, edits)
    else:
        repair = FileRepair("advice", "give it the tensor of its shape at its mass, in kg m²", wanted)
    effect = robot.effects.evaluate(repair.inertias)
    said = f"its gyration radius is {number(radius, 3)} m, more than the whole robot's span of {number(span, 3)} m"
    matters = effect.reaches(MATTERS) and robot.heavy(link)
    yield link.finding("units", matters, said, {"gyration_radius": radius, "span": span}, effect, repair)
