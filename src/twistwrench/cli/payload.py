"""The command ``twistwrench payload``: the largest payload at a pose, as text and as a file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..answers.blocks import Bar, Block, Headline, Line, Table, numbers, remarks, words
from ..answers.page import MarkedJoint
from ..core.arguments import parse_numbers
from ..core.colours import Style, strong
from ..core.errors import FrameError, UnknownNameError, ValueRangeError
from ..core.numbers import MISSING, number, percent_of_limit, quantity, rounded_down, torque, without_noise
from ..core.text import listed
from ..core.typing import Array
from ..core.verdict import ExitCode, Word
from ..mechanics.joints.units import heading_unit, unit_of
from ..mechanics.model.limits import over_limit
from ..motion.coordinates import Coordinates
from ..motion.credible_values import credible_limits, credible_load
from ..motion.limits_file import read_limits
from ..motion.load_case import Payload, limit_doubts, reach, unlimited
from ..reports.robot_summary import degrees_hint, parse_configuration
from ..reports.torque_verdict import assumed_words, assumptions, base_doubts, model_warnings
from ..robot import Robot
from ..statics.equilibrium import BeyondStop, joints_beyond_stops
from ..statics.force_capability import largest_wrench, weakest_direction
from ..statics.payload import LargestPayload, largest_payload, payload_map, plane_and_samples
from ..statics.torque_limits import require_fixed_base, unit_slips
from . import shared
from .main import Given, note, option
from .report import REPORT, write_report
from .shared import RobotOptions, robot_command
from .terminal import show

_SAMPLES = 200_000


@robot_command(
    "payload",
    shared.AT,
    option(
        "--tool MASS[,x,y,z][@FRAME]",
        "Load attached already, in the form of --payload of torques; may be repeated.",
        "payloads",
        multiple=True,
    ),
    option("--frame FRAME", "Frame of the payload. [default: the tip]"),
    option("--com x,y,z", "Centre of mass of the payload in this frame [m].", default="0,0,0"),
    shared.LIMITS,
    option("--map rz|xz|yz|xy", "Map the largest payload over this plane of the workspace.", "plane"),
    option("--samples N", f"Number of random configurations for --map.  [default: {_SAMPLES}]", type=int),
    shared.csv_option("Write the table, one row per joint"),
    shared.JSON,
    option("--plot OUT.png", "Draw force polytope, ellipsoid, shares and map."),
    REPORT,
    examples=("payload ur5", "payload ur5 --at shoulder_lift_joint=-0.6 --at elbow_joint=0.9 --com 0,0,0.1"),
)
def payload_command(options: RobotOptions, given: Given) -> ExitCode:
    """Find the largest payload held at rest at a pose, the joint that limits it, and the forces at the tip.

    Exit code: 1 if the pose is outside the position limits, or the robot cannot hold itself there.
    """
    files = {"--limits": given.limits, **options.files}
    given.check_files(files)
    if given.samples is not None and given.plane is None:
        raise ValueRangeError("--samples is about the map, and there is none. Add --map rz.")
    count = _SAMPLES if given.samples is None else given.samples
    if given.plane is not None:
        given.plane, count = plane_and_samples(given.plane, count)
    load = shared.load_case(options.load(), options, given)
    robot = load.with_load
    _check_frame(robot, given.frame)
    q = parse_configuration(robot, given.at, degrees=options.degrees)
    place = np.array(parse_numbers(given.com, "--com", "x,y,z in metres, for example 0,0,0.1", 3))
    allowed = read_limits(given.limits, robot.model, degrees=options.degrees)
    limits = allowed.effort
    found = largest_payload(robot, q, place, frame=given.frame, limits=limits)
    assumed = assumed_words(assumptions(robot.model, (Payload(1.0, frame=given.frame or options.tip), *load.payloads)))
    name = str(robot.tip if given.frame is None else given.frame)
    where, carried = place_words(name, place), carried_words(robot, load.payloads)
    beyond = joints_beyond_stops(robot, q, allowed)
    loads = (np.abs(found.unloaded) + np.abs(found.per_kilogram))[: robot.nv]
    judged = not unlimited(robot.model, limits, loads)
    asked = credible_load(None, place, given.frame or options.tip, robot, reach(robot.model))
    carried_doubts = [
        each for each in load.doubts if each.refuses or found.holds
    ]  # an excess stands at any size of a load
    typed = [*credible_limits(allowed, load.robot), *carried_doubts, *asked]
    refused = [str(each) for each in typed if each.refuses]
    doubts = [str(each) for each in typed if not each.refuses]
    doubts += [*base_doubts(robot.model, payload=True), *limit_doubts(load.robot, allowed, loads)]
    if found.joint < 0 and found.holds and not given.at:
        doubts.append(
            "at the default pose the load stands on the axes of the joints, so no torque depends on it: give --at"
        )
    if lacking := model_warnings(robot.model):
        doubts.append(f"{'; '.join(lacking)}: the payload may be less")
    blocks: list[Block] = [stops_view(beyond, degrees=options.degrees)] if beyond else []
    if refused:
        blocks.insert(0, Headline(Word.LOOK_AGAIN, f"{'; '.join(refused)}."))
    if doubts:
        blocks.append(Headline(Word.UNSURE, f"{'; '.join(doubts)}."))
    if hint := degrees_hint(robot, q):
        blocks += remarks([hint])
    if judged:
        blocks.append(_verdict(found, where, carried, assumed, first=not (beyond or doubts or refused)))
    blocks += payload_view(robot, found, q, where, carried=carried, degrees=options.degrees, judged=judged)
    if judged:
        blocks += _forces(robot, q, name, limits)
    elif given.plane or given.plot:
        note("--map and --plot need a torque limit of every joint that is loaded; none is written.")
        given.plane = given.plot = None
    chart = None
    if given.plane is not None:
        chart = payload_map(robot, given.plane, samples=count, com=place, frame=given.frame, limits=limits)
        blocks.append(f"map, {chart}")
    blocks.append(Line((_CAUTION, Style.QUIET)))
    show(*blocks)
    places = {"--com": place}
    places |= {f"--tool {text}": np.array(p.place) for text, p in zip(given.payloads, load.payloads, strict=True)}
    for slip in (*unit_slips(robot, q, allowed, places, degrees=options.degrees), *load.unit_hints):
        note(slip)
    write_payload(robot, found, q, given.csv, degrees=options.degrees, judged=judged)
    from ..viz.plots.payload import plot_payload

    def plot(path: Path) -> None:
        plot_payload(robot, q, found, path, frame=name, where=where, carried=carried, limits=limits, chart=chart)

    if given.plot is not None:
        plot(given.plot)
    shared.show_written(given.csv, given.plot)
    if given.report is not None:
        from ..viz.pictures import drawn, robot_picture

        worst = found.joint_names[int(found.joint)] if judged and found.joint >= 0 else None
        marked = MarkedJoint(worst, f"{worst}, which limits the payload", Style.NEAR) if worst else None
        pictures = [robot_picture(robot, q, marked, f"{robot.name} in this pose")]
        pictures += [drawn("Forces and holding torques", plot)] if judged else []
        subject, most = f"{robot.name} · payload at {where}", rounded_down(found.mass)
        facts = [("largest payload", f"{most} kg"), ("limited by", worst)] if worst and found.holds else []
        write_report(
            given, "payload", subject, blocks, files=files, facts=facts, pictures=pictures, robot=robot, limits=allowed,
            degrees=options.degrees,
        )  # fmt: skip
    fine = found.holds and not (beyond or doubts or refused)
    return ExitCode.FINE if fine else ExitCode.NO


def _check_frame(robot: Robot, frame: str | None) -> None:
    """Raise FrameError for a robot without a single tip, and UnknownNameError for an unknown frame, naming --frame.

    Raises ValueRangeError if a robot without a single tip has a floating base.
    """
    if frame is None and robot.tip is None:
        require_fixed_base(robot, "the largest payload")  # a frame does not help there
        raise FrameError(
            f"robot {robot.name!r} has no single tip, so the frame of the payload must be named: --frame FRAME. "
            f"Its leaves: {listed(robot.model.leaves)}."
        )
    try:
        robot.model.frame(frame)
    except UnknownNameError as error:
        raise UnknownNameError(f"--frame: {error}") from None


# ── The report


_ROUNDING = 12
"""Decimals of a coordinate; smaller values are rounding errors."""
_CAUTION = "Counts joint torques at rest alone: structure, grip, warm motors and motion may limit it earlier."


def payload_view(
    robot: Robot,
    found: LargestPayload,
    q: Array,
    where: str,
    *,
    carried: str = "",
    degrees: bool = False,
    judged: bool = True,
) -> list[Block]:
    """Heading and one row per joint, for one pose.

    ``where`` and ``carried`` describe the payload's frame and the tools. Without limits, only holding torques are listed.
    """
    turning = Coordinates.from_model(robot.model).angular_velocity
    shares = [float(x) for x in found.share]
    known = [share if math.isfinite(limit) else None for share, limit in zip(shares, found.limits, strict=True)]
    styles = [""] * len(shares)
    if found.joint >= 0:
        styles[int(found.joint)] = Style.STRONG
    styles = [strong(Style.OVER) if over_limit(share) else style for share, style in zip(shares, styles, strict=True)]
    bars = [Bar(share or 0.0, f"  {percent_of_limit(share):>5}") for share in known]
    unit = heading_unit("tau", turning)
    holding = partial(numbers, show=torque, unit=unit, headed=False)
    limited = numbers("limit", found.limits, unit=unit, headed=False)
    judgement = (
        holding("loaded", found.torques),
        limited,
        numbers(
            "up to", np.maximum(found.per_joint, 0.0), lambda m: rounded_down(m) if math.isfinite(m) else MISSING, "kg"
        ),
        words("share of limit", bars, fold=False, narrow=numbers("share", known, percent_of_limit)),
    )
    table = Table(
        f"Holding torques [{unit}]",
        words("joint", found.joint_names, fold=False),
        numbers(
            "q",
            _places(robot, found.joint_names, q, degrees=degrees),
            lambda x: number(x, decimals=_ROUNDING, missing=""),
            heading_unit("q", turning, degrees=degrees),
        ),
        holding("alone", found.unloaded),
        holding("per kg", found.per_kilogram),
        *(judgement if judged else (limited,)),
        styles=styles if judged else None,
    )
    besides = f"  ·  carrying {carried} already" if carried else ""
    return ["", Line((robot.name, Style.STRONG), f"  ·  payload at {where}{besides}"), table]


def place_words(frame: str, com: Array) -> str:
    """Text of a point of a frame: tool0 + [0, 0, 0.1] m."""
    return frame + (f" + [{', '.join(number(x) for x in com)}] m" if np.any(com) else "")


def carried_words(robot: Robot, payloads: Sequence[Payload]) -> str:
    """Text of point masses with their positions: 1.2 kg at tool0 + [0, 0, 0.05] m."""
    return " and ".join(
        f"{number(p.mass)} kg at {place_words(str(p.frame or robot.tip), np.array(p.place))}" for p in payloads
    )


def _places(robot: Robot, names: Sequence[str], q: Array, *, degrees: bool = False) -> Array:
    """Positions of the joints ``names`` [rad or m, or degrees]; nan for joints of more than one degree of freedom."""
    places = dict.fromkeys(names, math.nan)
    for b in robot.model.bodies:
        if b.joint.nq == b.joint.nv == 1:
            turns = b.joint.turning[0]
            places[b.joint.name] = (b.ratio * q[b.q_index] + b.offset) * (180 / math.pi if degrees and turns else 1.0)
    return np.array([places[name] for name in names])


def _forces(robot: Robot, q: Array, frame: str, limits: ArrayLike | None) -> Iterator[str]:
    """Table of the forces that the robot can apply at the frame."""
    along = largest_wrench(robot, q, np.concatenate([np.eye(3), -np.eye(3)]), frame=frame, limits=limits)
    pairs = [f"±{n} {_force(along.magnitude[k])} / {_force(along.magnitude[k + 3])}" for k, n in enumerate("xyz")]
    yield f"Largest force [N] at the origin of {frame}, in place of the payload, along {', '.join(pairs)} (base axes)."
    try:
        weakest = weakest_direction(robot, q, frame=frame, limits=limits)
    except ValueRangeError:
        return
    d = ", ".join(number(x, 2, decimals=3) for x in weakest.wrench[3:])
    limited = f", limited by {weakest.joint_names[int(weakest.joint)]}" if weakest.joint >= 0 else ""
    yield f"Weakest along ({d}): {_force(weakest.magnitude)} N{limited}."
    yield ""


def _verdict(found: LargestPayload, where: str, carried: str, assumed: str, *, first: bool) -> Headline | Line:
    """Largest payload and the joint that limits it; OK is its word only if it comes ``first``."""
    itself = "the robot and what it carries" if carried else "the robot itself"
    if not found.holds:
        why = str(found).removeprefix("no payload: ")
        return Headline(Word.OVER_LIMIT, f"no payload. {why.replace('the robot alone', itself) if carried else why}.")
    k, side = int(found.joint), "upper" if found.side > 0 else "lower"
    if k < 0:
        sentence = f"the payload is not limited at this pose: no joint torque depends on it{assumed}."
    else:
        sentence = (
            f"largest payload at rest in this pose: {rounded_down(found.mass)} kg at {where}. Limited by "
            f"{found.joint_names[k]}, {side} limit: {torque(found.torques[k])} {found.units[k]}, of which "
            f"{torque(found.unloaded[k])} carry {itself}{assumed}."
        )
    return Headline(Word.OK, sentence) if first else Line(sentence[0].upper() + sentence[1:])


def stops_view(beyond: Sequence[BeyondStop], *, degrees: bool = False) -> Headline:
    """Joints beyond their position limits, with their excess; turning joints in degrees if ``degrees``."""
    parts = []
    for b in beyond:
        scale = math.degrees(1.0) if degrees and b.turns else 1.0
        unit = unit_of("q", b.turns, degrees=degrees)
        side = "above its upper" if b.value > b.stop else "below its lower"
        value, far, stop = (quantity(scale * x, unit, decimals=_ROUNDING) for x in (b.value, b.by, b.stop))
        parts.append(f"{b.joint} at {value} is {far} {side} position limit, {stop}")
    return Headline(Word.OVER_LIMIT, f"the robot cannot be in this pose: {'; '.join(parts)}.")


def write_payload(
    robot: Robot,
    found: LargestPayload,
    q: Array,
    path: str | Path | None,
    *,
    degrees: bool = False,
    judged: bool = True,
) -> None:
    """CSV row per joint: name, position (column ``q_degrees`` if in degrees, empty if several numbers), torques.

    Without limits, the columns that depend on them are left out. Numbers have all digits; rounding errors of zero are
    written as zero. Raises ValueRangeError if the file cannot be written.
    """
    columns = {
        "q_degrees" if degrees else "q": _places(robot, found.joint_names, q, degrees=degrees),
        "alone": without_noise(found.unloaded),
        "per_kilogram": without_noise(found.per_kilogram),
        **({"with_payload": without_noise(found.torques)} if judged else {}),
        "limit": found.limits,
        **({"holds_up_to": found.per_joint, "share": without_noise(found.share)} if judged else {}),
    }
    known = {name: [None if math.isnan(x) else x for x in column] for name, column in columns.items()}
    shared.write_csv(path, {"joint": found.joint_names, **known})


def _force(value: Any) -> str:
    return number(value, missing="unbounded")
