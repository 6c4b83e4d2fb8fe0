"""Checks of units: centres of mass outside the shapes, and lengths, masses or moments in another unit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..core.numbers import number
from ..core.typing import Array
from ..formats.robot_text import WrittenInertia, inertia_about_com
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.inertia_checks import reasons
from ..mechanics.model.model import BASE
from .entry_errors import UNITS
from .findings import FileRepair, Finding, Severity
from .options import Options
from .parsed_file import ParsedFile, ParsedLink
from .tensor_checks import MIN_EFFECT, identified_like, no_tensor, placeholder

# A centre of mass may be outside the shapes by a share of their diagonal plus a gap.
_MAX_SHARE_OF_DIAGONAL = 0.1
_MAX_COM_GAP = 0.01  # m
_MAX_IDENTIFIED_SHARE_OF_SPAN = 0.25
"""Largest distance of an identified centre of mass from the shapes, as a share of the robot's span."""
_MIN_GYRATION_RADIUS = 0.005
"""Smallest plausible gyration radius of a part with mass [m]."""
_MAX_DIAGONAL = 20.0
"""Largest plausible diagonal of the shapes of a link [m]."""
_MIN_DIAGONAL = 1e-3
"""Smallest plausible diagonal of the shapes of a link [m]."""
_MAX_COM_DISTANCE = 3.0
"""Largest distance of a centre of mass from the link frame: 3 spans of the robot, or 3 m if that is more.

Real files have up to 1.5 spans and 2 m."""
_MAX_MASS_RATIO = 150.0
"""Ratio to the next heaviest link, and to the median, above which a mass is too large; up to 100 in real files."""
_MIN_RADIUS_SHARE_OF_SPAN = 0.008
"""Ratio to the robot's span below which a gyration radius is too small; at least 0.0116 in real files."""
_SAME_FRAME = 1e-6
"""Largest difference of entries of a pose from the identity at which two frames are one."""


def check_com(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Findings on centres of mass outside the box of the link's shapes."""
    for link in robot.links.values():
        written = link.written
        if written is None or not robot.heavy(link) or not link.shapes.complete:
            continue
        low, high = link.shapes.points.min(axis=0), link.shapes.points.max(axis=0)
        nearest_point = np.clip(written.com, low, high)
        distance = float(np.linalg.norm(written.com - nearest_point))
        if distance <= _MAX_SHARE_OF_DIAGONAL * link.shapes.diagonal + _MAX_COM_GAP:
            continue
        moved_inertia = inertia_about_com(written.mass, nearest_point, written.inertia.moment_about_com)
        effect = robot.effects.evaluate({link.name: moved_inertia})
        # Identified parameters are regrouped among links, which may move a centre of mass outside.
        is_regrouped = identified_like(written) and distance <= _MAX_IDENTIFIED_SHARE_OF_SPAN * robot.span
        is_impossible = bool(reasons(written.inertia))  # which another check finds
        matters = effect.reaches(MIN_EFFECT) and not (is_regrouped or is_impossible)
        com_text = " ".join(map(number, written.com))
        other_link = _link_of_frame(robot, link, written.com, low, high)
        hint = f"; read in the frame of {other_link!r} it would be inside" if other_link else ""
        yield link.finding(
            "com-outside", matters,
            f"its centre of mass, {com_text} m, is {number(distance, 3)} m outside its shapes{hint}; the effect is that of "
            "moving it to their edge", {"distance": distance, "diagonal": link.shapes.diagonal}, effect,
            FileRepair("advice", "measure the centre of mass in the frame of the link"),
        )  # fmt: skip


def _link_of_frame(robot: ParsedFile, link: ParsedLink, com: Array, low: Array, high: Array) -> str:
    """Other link in whose frame, at zero joint positions, the centre of mass would lie within the shapes; empty for none."""
    if link.name not in robot.model.frames:
        return ""
    poses = robot.neutral_poses
    for name in _neighbour_frames(robot, link):
        T = np.linalg.solve(poses[link.name], poses[name])
        point = T[:3, :3] @ com + T[:3, 3]
        is_other_frame = np.abs(T - np.eye(4)).max() > _SAME_FRAME
        if is_other_frame and (point >= low).all() and (point <= high).all():
            return name
    return ""


def _neighbour_frames(robot: ParsedFile, link: ParsedLink) -> Iterator[str]:
    """Names of the frames of the same moving body, of its parent, and of its children."""
    bodies, own_body = robot.model.bodies, robot.model.frames[link.name].body
    own_and_parent = {own_body}
    if own_body != BASE:
        own_and_parent.add(bodies[own_body].parent)
    for name, frame in robot.model.frames.items():
        is_child = frame.body != BASE and bodies[frame.body].parent == own_body
        if is_child or frame.body in own_and_parent:
            yield name


def check_units(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Findings on shapes, centres of mass, masses and gyration radii that are implausible for the robot's size."""
    for link in robot.links.values():
        written = link.written
        if written is None or written.mass <= 0 or reasons(written.inertia):
            continue
        yield from _shapes_of_other_size(robot, link)
        yield from _large_gyration_radius(robot, link, written)
        yield from _distant_com(robot, link, written)
        yield from _mass_in_grams(robot, link, written)


def _shapes_of_other_size(robot: ParsedFile, link: ParsedLink) -> Iterator[Finding]:
    """Finding on shapes that are too large or too small for a link: probably millimetres, or metres written as millimetres."""
    if not robot.heavy(link) or not link.shapes.complete:
        return
    diagonal = link.shapes.diagonal
    if _MIN_DIAGONAL <= diagonal <= _MAX_DIAGONAL:
        return
    unit = "millimetres" if diagonal > _MAX_DIAGONAL else "metres written as millimetres"
    yield Finding(
        "units", Severity.WARNING, f"link {link.name!r}", link.line,
        f"its shapes are {number(diagonal, 3)} m long: are they in {unit}?", {"diagonal": diagonal},
        repair=FileRepair("advice", "scale its shapes to metres"), file=link.file,
    )  # fmt: skip


def _distant_com(robot: ParsedFile, link: ParsedLink, written: WrittenInertia) -> Iterator[Finding]:
    """Finding on a centre of mass far from its link frame, compared with the robot's span: probably millimetres."""
    span = robot.span
    distance = float(np.linalg.norm(written.com))
    max_distance = _MAX_DIAGONAL  # if all frames are at one place, only the size of a link is a measure
    if span > 0:
        max_distance = max(_MAX_COM_DISTANCE * span, _MAX_COM_DISTANCE)
    if distance <= max_distance or link.shapes.complete:
        return
    in_metres = inertia_about_com(written.mass, 1e-3 * written.com, written.inertia.moment_about_com)
    repair = FileRepair("advice", "give the centre of mass in metres, in the frame of the link")
    is_plausible_in_metres = span > 0 and 1e-3 * distance <= span
    if is_plausible_in_metres:
        repair = _slip_repair(link, written, "in millimetres, for metres: divide it by 1000", in_metres)
    effect = robot.effects.evaluate({link.name: in_metres})
    sentence = (
        f"its centre of mass is {number(distance, 3)} m from the frame of the link, and the robot spans "
        f"{number(span, 3)} m"
    )
    matters = robot.heavy(link) and effect.reaches(MIN_EFFECT)
    yield link.finding("units", matters, sentence, {"distance": distance, "span": span}, effect, repair)


def _mass_in_grams(robot: ParsedFile, link: ParsedLink, written: WrittenInertia) -> Iterator[Finding]:
    """Finding on a mass far above all others, or too large for its tensor: probably grams."""
    other_inertias = [other.written for other in robot.links.values() if other.written and other is not link]
    other_masses = [inertia.mass for inertia in other_inertias if inertia.mass > 0]
    mass_ratio = 0.0  # to the next heaviest link
    if len(other_masses) > 1:
        mass_ratio = written.mass / max(other_masses)
    radius = _max_gyration_radius(written)
    is_compact = _is_compact(robot, link, written, radius)
    if mass_ratio < _MAX_MASS_RATIO and not is_compact:
        return
    in_kilograms = inertia_about_com(1e-3 * written.mass, written.com, written.inertia.moment_about_com)
    repair = FileRepair("advice", "give the mass in kilograms, or the tensor in kg m²: 1000 g are 1 kg")
    if _fits_in_kilograms(written.mass, other_masses):
        repair = _slip_repair(link, written, "in grams, for kilograms: divide it by 1000", in_kilograms)
    sentence = f"its mass is {number(written.mass)} kg"
    if mass_ratio >= _MAX_MASS_RATIO:
        sentence += f", {number(mass_ratio, 3)} times that of the next heaviest link"
    if is_compact:
        sentence += (
            f"; at its tensor, a gyration radius of {number(1e3 * radius, 2)} mm in a robot that spans "
            f"{number(robot.span, 3)} m"
        )
    effect = robot.effects.evaluate({link.name: in_kilograms})
    numbers = {"mass": written.mass, "times": mass_ratio, "gyration_radius": radius, "span": robot.span}
    yield link.finding("units", effect.reaches(MIN_EFFECT), sentence, numbers, effect, repair)


def _is_compact(robot: ParsedFile, link: ParsedLink, written: WrittenInertia, radius: float) -> bool:
    """True if a moving, heavy link has a tensor of its own that is too small for its mass."""
    if not robot.moves(link.name) or not robot.heavy(link) or radius >= _MIN_RADIUS_SHARE_OF_SPAN * robot.span:
        return False
    has_own_tensor = not (no_tensor(written) or placeholder(written))
    return has_own_tensor and not link.shapes.complete  # complete shapes are compared by another check


def _fits_in_kilograms(mass: float, other_masses: list[float]) -> bool:
    """True if a mass read in grams is not above all others, and is far above their median as it stands."""
    if len(other_masses) < 2:
        return False
    is_far_above = mass >= _MAX_MASS_RATIO * float(np.median(other_masses))
    return is_far_above and 1e-3 * mass <= max(other_masses)


def _slip_repair(link: ParsedLink, written: WrittenInertia, sentence: str, inertia: SpatialInertia) -> FileRepair:
    """Repair of a slip in units, written to the file."""
    return FileRepair("slip", sentence, {link.name: inertia}, written.edits(inertia))


def _max_gyration_radius(written: WrittenInertia) -> float:
    """Largest gyration radius of the principal axes [m]."""
    largest_moment = np.linalg.eigvalsh(written.tensor)[-1]
    return float(np.sqrt(max(largest_moment, 0.0) / written.mass))


def _large_gyration_radius(robot: ParsedFile, link: ParsedLink, written: WrittenInertia) -> Iterator[Finding]:
    """Finding on a gyration radius above a metre and above the robot's span: probably moments in kg mm²."""
    span = robot.span
    radius = _max_gyration_radius(written)
    if radius <= max(1.0, span) or link.shapes.complete:
        return
    # A tensor that is 10^k times too large has a gyration radius that is 10^(k/2) times too large.
    max_radius = 0.5 * max(span, 1e-9)
    plausible_exponents = [k for k in UNITS if _MIN_GYRATION_RADIUS <= radius * 10.0 ** (-k / 2) <= max_radius]
    # If several units are plausible, nothing is written, and the effect is evaluated for the first.
    kg_mm2 = 6  # exponent of the usual mistake
    exponent = plausible_exponents[0] if plausible_exponents else kg_mm2
    edits, tensor = written.tensor_edits(written.tensor * 10.0**-exponent)
    inertias = {link.name: written.with_tensor(tensor)}
    if len(plausible_exponents) == 1:
        sentence = f"all entries are 1e{exponent} times too large, as {UNITS[exponent]} for kg m²"
        repair = FileRepair("slip", sentence, inertias, edits)
    else:
        repair = FileRepair("advice", "give it the tensor of its shape at its mass, in kg m²", inertias)
    effect = robot.effects.evaluate(inertias)
    sentence = f"its gyration radius is {number(radius, 3)} m, more than the whole robot's span of {number(span, 3)} m"
    matters = effect.reaches(MIN_EFFECT) and robot.heavy(link)
    yield link.finding("units", matters, sentence, {"gyration_radius": radius, "span": span}, effect, repair)
