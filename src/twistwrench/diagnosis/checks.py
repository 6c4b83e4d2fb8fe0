"""Checks of joints, and the table of all checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from ..core.numbers import file_number, margin, number, printed
from ..core.text import listed
from ..formats.edit import Edit
from ..formats.xml import Element
from ..mechanics.model.limits import StatedLimits
from ..motion.credible_values import BY_WEIGHT, arm_entries, credible_limits, placeholder_limits
from ..motion.load_case import confirmed_efforts, limits_remedy
from ..robot import Robot
from . import mass_checks as masses
from . import tensor_checks as tensors
from . import unit_checks as units
from .findings import FileRepair, Finding, Severity
from .options import Options
from .parsed_file import ParsedFile
from .symmetry_checks import check_mirror

_SINGLE_AXIS_TYPES = ("revolute", "continuous", "prismatic")
_TWO_TURNS = 4.0 * math.pi
"""Largest usual limit of a revolute joint [rad]."""
_MAX_LIMIT = 1000.0
"""Largest limit [rad or m]; larger ones mean no limit."""
_MAX_UNIT_ERROR = 1e-3
"""Largest difference of the length of a unit vector from 1."""
_MAX_STROKE = 5.0
"""Largest usual stroke of a prismatic joint [m]."""
_MAX_LISTED_JOINTS = 6
"""Largest number of joints that a finding names."""
_MIN_SYMBOLIC_LIMIT = 1e4
"""Limit of effort or velocity from which it stands for no limit."""
_USUAL_SYMBOLIC_LIMIT = 1000.0
"""Limit of effort or velocity that often stands for no limit, although it is smaller."""


def check_mimic(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Mimic joints without a leader: loading fails unless ``mimic="independent"``."""
    for problem in robot.load_errors:  # the only errors that do not prevent the checks
        yield Finding("mimic", Severity.ERROR, problem.where, problem.line, problem.sentence)


def check_degrees(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Integer limits of revolute joints beyond ±2 turns, which are probably degrees.

    They are an error if the other commands refuse them, and a warning otherwise.
    """
    limit_doubts = credible_limits(robot.model.limits, Robot(robot.model))  # the other commands refuse by these doubts
    refusals = [doubt for doubt in limit_doubts if doubt.kind == "limits-degrees"]
    if not refusals:
        yield from _limits_in_degrees(robot, Severity.WARNING)
        return
    findings = list(_limits_in_degrees(robot, Severity.ERROR))
    yield from findings
    if not findings:  # the file has no URDF joint to point at
        refusal = refusals[0]
        yield Finding("degrees", Severity.ERROR, f"joint {refusal.joints[0]!r}", 0, str(refusal))


def _limits_in_degrees(robot: ParsedFile, severity: Severity) -> Iterator[Finding]:
    """Findings on revolute joints whose limits are whole numbers beyond two turns, with the limits in radians as repair."""
    for joint in _urdf_joints(robot).values():
        limit = joint.child("limit")
        if limit is None or joint.text("type") != "revolute":
            continue
        limits = {name: limit.optional_number(name) or 0.0 for name in ("lower", "upper")}  # a missing limit is 0
        largest = max(map(abs, limits.values()))
        if not _TWO_TURNS < largest < _MAX_LIMIT:
            continue
        if not all(angle.is_integer() for angle in limits.values()):
            continue
        edits = []
        for name, degrees in limits.items():
            if degrees != 0.0:
                radians_text = file_number(math.radians(degrees))
                edits.append(Edit(limit.locate(name), radians_text))
        yield _joint_finding(
            joint, "degrees", severity,
            f"its limits, {printed(limits['lower'])} to {printed(limits['upper'])} rad, look like degrees",
            limits, FileRepair("number", "the limits in radians", edits=tuple(edits)),
        )  # fmt: skip


def check_limits(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Limits that exclude zero, and strokes of several metres."""
    joints_without_zero: list[str] = []
    joints_with_long_stroke: list[str] = []
    model = robot.model
    for body in model.leaders:
        if body.joint.nv != 1:
            continue
        lower = float(model.limits.lower[body.v_index])
        upper = float(model.limits.upper[body.v_index])
        if lower > 0 or upper < 0:
            joints_without_zero.append(body.joint.name)
        slides = not body.joint.turning[0]
        if slides and _MAX_STROKE < upper - lower < _MAX_LIMIT:
            joints_with_long_stroke.append(body.joint.name)
    sentence = "zero is outside the limits, so the robot cannot be in its neutral configuration"
    yield from _collective_finding(robot, "limits", joints_without_zero, sentence)
    sentence = f"the stroke is more than {printed(_MAX_STROKE)} m"
    yield from _collective_finding(robot, "limits", joints_with_long_stroke, sentence)


def check_effort(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Missing effort and velocity limits, and joints whose own weight exceeds their effort limit."""
    if robot.format == "urdf":
        for quantity in ("effort", "velocity"):
            yield from _missing_limits(robot, quantity)
    yield from _efforts_below_weight(robot)


def _missing_limits(robot: ParsedFile, quantity: str) -> Iterator[Finding]:
    """Findings on joints without a limit of a quantity, and on joints whose limit stands for no limit."""
    leaders = {body.joint.name for body in robot.model.leaders}
    joints_without_limit: list[str] = []
    joints_with_symbolic_limit: list[str] = []
    for name, joint in robot.joints.items():
        if joint.text("type") not in _SINGLE_AXIS_TYPES:
            continue
        limit = _limit(robot, joint, quantity)
        if not limit and name in leaders:
            joints_without_limit.append(name)
        if limit >= _MIN_SYMBOLIC_LIMIT or limit == _USUAL_SYMBOLIC_LIMIT:
            joints_with_symbolic_limit.append(name)
    sentence = f"there is no limit of {quantity}"
    severity = Severity.NOTE
    if quantity == "effort" and len(arm_entries(robot.model)) > 1:  # an arm of several joints
        sentence += ", so neither torques nor payloads can be judged"
        severity = Severity.WARNING
    yield from _collective_finding(robot, "effort", joints_without_limit, sentence, severity)
    sentence = f"the limit of {quantity} stands for none"
    yield from _collective_finding(robot, "effort", joints_with_symbolic_limit, sentence)


def _efforts_below_weight(robot: ParsedFile) -> Iterator[Finding]:
    """Joints whose torque by weight exceeds their effort limit: a note, or a warning if it exceeds a multiple of it."""
    efforts = robot.model.limits.effort
    max_torques = np.abs(robot.effects.gravity_torques).max(axis=0, initial=0.0)  # of each joint over all poses
    overloaded = np.flatnonzero(max_torques > efforts + margin(efforts))
    # By more than the factor BY_WEIGHT; an effort of 0 has no multiple.
    far_overloaded = [k for k in overloaded if max_torques[k] > BY_WEIGHT * efforts[k] > 0]
    names = robot.model.velocity_names
    slightly_overloaded_names = [names[k] for k in overloaded if k not in far_overloaded]
    far_overloaded_names = [names[k] for k in far_overloaded]
    sentence = "the robot's own weight takes more than the effort at some pose"
    yield from _collective_finding(robot, "effort", slightly_overloaded_names, sentence)
    ratios = [max_torques[k] / efforts[k] for k in far_overloaded]
    max_ratio = max(ratios, default=0.0)
    sentence = (
        f"the robot's own weight takes up to {number(max_ratio, 3)} times the effort: is a mass in grams, a centre of mass "
        "in millimetres, or an effort that of the motor before the gear?"
    )
    yield from _collective_finding(robot, "effort", far_overloaded_names, sentence, Severity.WARNING)


def check_placeholder_limits(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Effort limits that are probably placeholders: far above the torques due to weight."""
    sentence = placeholder_limits(Robot(robot.model), robot.model.limits)
    if not sentence:
        return
    remedy = f"{limits_remedy(robot.model.source)}; {confirmed_efforts(robot.model)}"
    yield Finding(
        "placeholder-limits", Severity.WARNING, f"robot {robot.model.name!r}", 0, sentence,
        repair=FileRepair("advice", f"take the efforts from the data sheet, or {remedy}"),
    )  # fmt: skip


def check_axis(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Axes without unit length; loading normalises them, but other programs may not."""
    for joint in _urdf_joints(robot).values():
        if joint.text("type") in ("fixed", "floating"):
            continue
        axis = joint.child("axis")
        if axis is None:
            continue
        direction = axis.numbers("xyz", 3)
        length = float(np.linalg.norm(direction))
        if length == 0 or abs(length - 1.0) < _MAX_UNIT_ERROR:
            continue
        unit_axis_text = " ".join(map(file_number, direction / length))
        edit = Edit(axis.locate("xyz"), unit_axis_text)
        repair = FileRepair("number", "the axis with unit length", edits=(edit,))
        sentence = f"its axis has the length {number(length)}, not 1"
        yield _joint_finding(joint, "axis", Severity.NOTE, sentence, {"length": length}, repair)


def check_friction(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Robots without joint damping, friction and armature."""
    model = robot.model
    if model.nv and not model.friction.any and not model.armature.any():
        yield Finding(
            "friction", Severity.NOTE, f"robot {model.name!r}", 0,
            "no joint has damping, friction or armature; real gears have all three",
        )  # fmt: skip


def _urdf_joints(robot: ParsedFile) -> Mapping[str, Element]:
    """Joints of a URDF by name; empty for other formats."""
    return robot.joints if robot.format == "urdf" else {}


def _limit(robot: ParsedFile, joint: Element, quantity: str) -> float:
    """Limit of a joint from the user's table if there is one, otherwise from the file; 0 without a limit."""
    limits = robot.model.limits
    name = joint.text("name")
    if isinstance(limits, StatedLimits) and name in robot.model.velocity_names:
        k = robot.model.velocity_names.index(name)
        limit = float(getattr(limits, quantity)[k])
        return limit if math.isfinite(limit) else 0.0
    element = joint.child("limit")
    if element is None:
        return 0.0
    return element.optional_number(quantity) or 0.0


def _joint_finding(
    joint: Element, check: str, severity: Severity, sentence: str, numbers: dict[str, float], repair: FileRepair
) -> Finding:
    """Finding about one joint, with its repair."""
    return Finding(
        check, severity, f"joint {joint.text('name')!r}", joint.line, sentence, numbers, repair=repair, file=joint.file
    )


def _collective_finding(
    robot: ParsedFile, check: str, names: list[str], sentence: str, severity: Severity = Severity.NOTE
) -> Iterator[Finding]:
    """One finding for all joints with the same problem."""
    if not names:
        return
    first_joint = robot.joints.get(names[0])  # the finding points at it
    line = 0
    file = ""
    if first_joint is not None:
        line = first_joint.line
        file = first_joint.file
    noun = "joint" if len(names) == 1 else "joints"
    yield Finding(
        check, severity, f"{noun} {listed(map(repr, names), _MAX_LISTED_JOINTS)}", line, sentence,
        {"joints": float(len(names))}, file=file, collective=True,
    )  # fmt: skip


CHECKS: Mapping[str, Callable[[ParsedFile, Options], Iterator[Finding]]] = {
    "impossible": tensors.check_impossible,
    "too-large": tensors.check_too_large,
    "too-small": tensors.check_too_small,
    "placeholder": masses.check_placeholder,
    "no-inertia": masses.check_no_inertia,
    "no-mass": masses.check_no_mass,
    "massless": masses.check_massless,
    "assumed": masses.check_assumed,
    "com-outside": units.check_com,
    "density": masses.check_density,
    "light": masses.check_light,
    "units": units.check_units,
    "mirror": check_mirror,
    "mimic": check_mimic,
    "degrees": check_degrees,
    "limits": check_limits,
    "effort": check_effort,
    "placeholder-limits": check_placeholder_limits,
    "axis": check_axis,
    "friction": check_friction,
}
"""Checks by name, in the order of reports."""
