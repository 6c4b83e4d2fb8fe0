"""Checks of joints, and the table of all checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from ..core.doubts import Doubt
from ..core.numbers import file_number, margin, number, printed
from ..core.text import listed
from ..formats.edit import Edit
from ..formats.xml import Element
from ..mechanics.model.limits import StatedLimits
from ..motion.credible_values import arm_entries, credible_limits, placeholder_limits
from ..motion.load_case import confirmed_efforts, limits_remedy
from ..motion.plausibility import BY_WEIGHT
from ..robot import Robot
from . import mass_checks as masses
from . import tensor_checks as tensors
from .findings import FileRepair, Finding, Severity
from .parsed_file import ParsedFile
from .tensor_checks import Options

__all__ = ["CHECKS", "Options"]

_SINGLE = ("revolute", "continuous", "prismatic")
_TURNS = 4.0 * math.pi
_ENDLESS = 1000.0
"""Largest limit [rad or m]; larger ones mean no limit."""
_STROKE = 5.0
_NAMED = 6


def check_mimic(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Mimic joints without a leader: loading fails unless ``mimic="independent"``."""
    for problem in robot.load_errors:
        yield Finding("mimic", Severity.ERROR, problem.where, problem.line, problem.sentence)


def check_degrees(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Integer limits of revolute joints beyond ±2 turns: probably degrees; an error if no robot has such limits."""
    refused = [found for found in _doubts_of_limits(robot) if found.kind == "limits-degrees"]
    found = list(_whole_numbers(robot, Severity.ERROR if refused else Severity.WARNING))
    yield from found
    if refused and not found:
        yield Finding("degrees", Severity.ERROR, f"joint {refused[0].joints[0]!r}", 0, str(refused[0]))


def _whole_numbers(robot: ParsedFile, severity: Severity) -> Iterator[Finding]:
    """Limits of revolute joints that are whole numbers beyond two turns, and the edits of the file in radians."""
    for joint in robot.joints.values() if robot.format == "urdf" else ():
        limit = joint.child("limit")
        if limit is None or joint.text("type") != "revolute":
            continue
        limits = [limit.optional_number(name) or 0.0 for name in ("lower", "upper")]
        if not _TURNS < max(map(abs, limits)) < _ENDLESS or not all(x.is_integer() for x in limits):
            continue
        edits = tuple(
            Edit(limit.locate(name), file_number(math.radians(x)))
            for name, x in zip(("lower", "upper"), limits, strict=True)
            if x
        )
        yield _finding(
            joint, "degrees", severity,
            f"its limits, {printed(limits[0])} to {printed(limits[1])} rad, look like degrees",
            {"lower": limits[0], "upper": limits[1]}, FileRepair("number", "the limits in radians", edits=edits),
        )  # fmt: skip


def _doubts_of_limits(robot: ParsedFile) -> list[Doubt]:
    """Doubts that other commands have about the same limits."""
    return credible_limits(robot.model.limits, Robot(robot.model))


def check_limits(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Limits that exclude zero, and strokes of several metres."""
    outside, long = [], []
    model = robot.model
    for body in model.leaders:
        if body.joint.nv != 1:
            continue
        lower, upper = float(model.limits.lower[body.v_index]), float(model.limits.upper[body.v_index])
        if lower > 0 or upper < 0:
            outside.append(body.joint.name)
        if not body.joint.turning[0] and _STROKE < upper - lower < _ENDLESS:
            long.append(body.joint.name)
    said = "zero is outside the limits, so the robot cannot be in its neutral configuration"
    yield from _of_several(robot, "limits", outside, said)
    yield from _of_several(robot, "limits", long, f"the stroke is more than {printed(_STROKE)} m")


def check_effort(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Missing effort and velocity limits, and joints whose own weight exceeds their effort limit."""
    leaders = {body.joint.name for body in robot.model.leaders}
    for what in ("effort", "velocity") if robot.format == "urdf" else ():
        limits = {
            name: _limit(robot, joint, what) for name, joint in robot.joints.items() if joint.text("type") in _SINGLE
        }
        none = [name for name, x in limits.items() if not x and name in leaders]
        large = [name for name, x in limits.items() if x >= 1e4 or x == 1000.0]
        arm = what == "effort" and len(arm_entries(robot.model)) > 1
        said = ", so neither torques nor payloads can be judged" if arm else ""
        severity = Severity.WARNING if arm else Severity.NOTE
        yield from _of_several(robot, "effort", none, f"there is no limit of {what}{said}", severity)
        yield from _of_several(robot, "effort", large, f"the limit of {what} stands for none")
    efforts, torques = robot.model.limits.effort, np.abs(robot.effects.gravity_torques).max(axis=0, initial=0.0)
    names = robot.model.velocity_names
    weak = {names[k]: k for k in range(robot.model.nv) if torques[k] > efforts[k] + margin(efforts[k])}
    crushed = [name for name, k in weak.items() if torques[k] > BY_WEIGHT * efforts[k] > 0]
    said = "the robot's own weight takes more than the effort at some pose"
    yield from _of_several(robot, "effort", [name for name in weak if name not in crushed], said)
    most = max((torques[weak[name]] / efforts[weak[name]] for name in crushed), default=0.0)
    said = (
        f"the robot's own weight takes up to {number(most, 3)} times the effort: is a mass in grams, a centre of mass in "
        "millimetres, or an effort that of the motor before the gear?"
    )
    yield from _of_several(robot, "effort", crushed, said, Severity.WARNING)


def check_placeholder_limits(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Effort limits that are probably placeholders: far above the torques due to weight."""
    if said := placeholder_limits(Robot(robot.model), robot.model.limits):
        remedy = f"{limits_remedy(robot.model.source)}; {confirmed_efforts(robot.model)}"
        yield Finding(
            "placeholder-limits", Severity.WARNING, f"robot {robot.model.name!r}", 0, said,
            repair=FileRepair("advice", f"take the efforts from the data sheet, or {remedy}"),
        )  # fmt: skip


def check_axis(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Axes without unit length; loading normalises them, but other programs may not."""
    for joint in robot.joints.values() if robot.format == "urdf" else ():
        axis = joint.child("axis") if joint.text("type") not in ("fixed", "floating") else None
        direction = np.zeros(3) if axis is None else axis.numbers("xyz", 3)
        length = float(np.linalg.norm(direction))
        if axis is None or length == 0 or abs(length - 1.0) < 1e-3:
            continue
        text = " ".join(map(file_number, direction / length))
        repair = FileRepair("number", "the axis with unit length", edits=(Edit(axis.locate("xyz"), text),))
        yield _finding(
            joint, "axis", Severity.NOTE, f"its axis has the length {number(length)}, not 1", {"length": length}, repair
        )


def check_friction(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Robots without joint damping."""
    model = robot.model
    if model.nv and not model.friction.any and not model.armature.any():
        yield Finding(
            "friction", Severity.NOTE, f"robot {model.name!r}", 0,
            "no joint has damping, friction or armature; real gears have all three",
        )  # fmt: skip


def _limit(robot: ParsedFile, joint: Element, what: str) -> float:
    """The limit in force, of the user's table if there is one, else of the file; 0 without any."""
    limits, name = robot.model.limits, joint.text("name")
    if isinstance(limits, StatedLimits) and name in robot.model.velocity_names:
        value = float(getattr(limits, what)[robot.model.velocity_names.index(name)])
        return value if math.isfinite(value) else 0.0
    limit = joint.child("limit")
    return (limit.optional_number(what) if limit is not None else None) or 0.0


def _finding(
    joint: Element, check: str, severity: Severity, sentence: str, numbers: dict[str, float], repair: FileRepair
) -> Finding:
    return Finding(
        check, severity, f"joint {joint.text('name')!r}", joint.line, sentence, numbers, repair=repair, file=joint.file
    )


def _of_several(
    robot: ParsedFile, check: str, names: list[str], sentence: str, severity: Severity = Severity.NOTE
) -> Iterator[Finding]:
    """One finding for all joints with the same problem."""
    if not names:
        return
    first = robot.joints.get(names[0])
    noun = "joint" if len(names) == 1 else "joints"
    yield Finding(
        check, severity, f"{noun} {listed(map(repr, names), _NAMED)}", first.line if first else 0,
        sentence, {"joints": float(len(names))}, file=first.file if first else "", collective=True,
    )  # fmt: skip


# ── All checks

CHECKS: Mapping[str, Callable[[ParsedFile, Options], Iterator[Finding]]] = {
    "impossible": tensors.check_impossible,
    "too-large": tensors.check_too_large,
    "too-small": tensors.check_too_small,
    "placeholder": masses.check_placeholder,
    "no-inertia": masses.check_no_inertia,
    "no-mass": masses.check_no_mass,
    "massless": masses.check_massless,
    "assumed": masses.check_assumed,
    "com-outside": masses.check_com,
    "density": masses.check_density,
    "light": masses.check_light,
    "units": masses.check_units,
    "mirror": masses.check_mirror,
    "mimic": check_mimic,
    "degrees": check_degrees,
    "limits": check_limits,
    "effort": check_effort,
    "placeholder-limits": check_placeholder_limits,
    "axis": check_axis,
    "friction": check_friction,
}
"""Checks by name, in the order of reports."""
