"""The command ``twistwrench simulate``: options, run and report of a simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..answers.blocks import Block, Headline, Line, Table, numbers, remarks, words
from ..answers.page import MarkedJoint
from ..core.arguments import parse_numbers
from ..core.colours import Style
from ..core.errors import SimulationError, ValueRangeError
from ..core.numbers import number, residual, seconds
from ..core.typing import Array
from ..core.verdict import ExitCode, Verdict, Word
from ..mechanics.joints.units import heading_unit, unit_of
from ..motion.bounds import LimitCheck, Violation, bounds_of
from ..motion.coordinates import Coordinates, configuration_of, degrees_hint, parse_rates
from ..motion.model_doubts import friction_words
from ..robot import Robot
from ..simulation.contact import Plane
from ..simulation.result import SimulationResult
from . import shared
from .main import Given, note, noted_if_failed, option, with_option_names
from .report import REPORT, write_report
from .shared import RobotOptions, robot_command
from .terminal import progress_bar, show

if TYPE_CHECKING:
    from ..statics.clearance import PathClearance

_CONTACT = "1e5,0.3,0.5"


@robot_command(
    "simulate",
    option("--duration SECONDS", "Duration of the motion.", default=1.0),
    option("--step SECONDS", "Time between two states.", default=1e-3),
    option(
        "--method NAME",
        "Integrator: dopri5, rk4, variational, variational6, midpoint, semi_implicit or euler.",
        default="dopri5",
    ),
    shared.AT,
    option(
        "--velocity JOINT=VALUE",
        "Initial velocity of a joint [rad/s, m/s]; may be repeated. [default: 0]",
        multiple=True,
    ),
    option("--torque JOINT=VALUE", "Constant torque of a joint [N m, N]; may be repeated. [default: 0]", multiple=True),
    shared.PAYLOADS,
    shared.WRENCHES,
    shared.NO_FRICTION,
    shared.CLEARANCE,
    option("--stop-at-limits", "Stop with exit code 1 if a joint reaches a position limit."),
    option(
        "--touch FRAME[:x,y,z]",
        "Contact point with --ground [m]; may be repeated. [default: the tip]",
        multiple=True,
    ),
    option("--ground HEIGHT", "Height of the ground along z of the base [m]. [default: none]", type=float),
    option(
        "--contact k,c,mu",
        f"Stiffness [N/m^1.5], dissipation [s/m] and friction of --ground.  [default: {_CONTACT}]",
    ),
    option("--rtol", "Relative tolerance of a dopri5 step.", default=1e-8),
    option("--every N", "Keep every N-th state.", default=1),
    shared.csv_option("Write the motion, which torques and view read"),
    shared.JSON,
    option("--npz OUT.npz", "Write all arrays in NumPy format."),
    option("--plot OUT.png", "Draw joints, energies and drift."),
    REPORT,
    examples=("simulate ur5 --duration 0.5", "simulate planar_2r --at joint1=0.5 --csv fall.csv --plot fall.png"),
)
def simulate_command(options: RobotOptions, given: Given) -> ExitCode:
    """Simulate a motion, and report states, energy drift and events.

    DONE: no limit is judged unless torques are given (--torque), and no distance without --clearance. Exit code: 1 if
    given torques pass a limit, if the motion ended before its duration, at a limit with --stop-at-limits or because
    integration failed, or if links come too near (--clearance). The motion until then is printed and written.
    """
    given.check_files({"--srdf": given.srdf, **options.files})
    load = shared.load_case(options.load(), options, given)
    if load.contradictions:
        show(Headline(Word.LOOK_AGAIN, f"{'; '.join(load.contradictions)}."))
        return ExitCode.NO
    loaded, friction = load.with_load, load.friction
    result: Any
    failure: BaseException | None = None
    q0 = configuration_of(loaded, given.at, what="--at", degrees=options.degrees)
    hints = [*filter(None, [degrees_hint(loaded, q0)]), *load.unit_hints]
    dq0 = parse_rates(loaded, given.velocity, "--velocity", degrees=options.degrees)
    settings: dict[str, Any] = {
        **given.pick("method", "rtol", "every"),
        "tau": parse_rates(loaded, given.torque, "--torque", degrees=False) if given.torque else None,
        "wrench_on_robot": load.wrenches or None,
        "friction": friction and loaded.model.friction.any,
        "limits": "stop" if given.stop_at_limits else None,
        "contacts": _planes(loaded, given.touch, given.ground, given.contact),
    }
    try:
        with noted_if_failed(hints), progress_bar(f"{loaded.name}: {given.method}") as progress:
            result = loaded.simulate(q0, dq0, given.duration, given.step, **settings, progress=progress)
    except SimulationError as problem:
        if problem.result is None:
            raise
        result, failure = problem.result, problem
    except KeyboardInterrupt as interrupt:
        result, failure = getattr(interrupt, "result", None), interrupt
        if result is None:
            raise
    clearance = shared.clearance_along(given, loaded, [(result.times, result.q)])
    shown_as: dict[str, Any] = {"driven": bool(given.torque), "degrees": options.degrees, "friction": friction}
    blocks = [*simulation_view(loaded, result, clearance, **shown_as), *remarks(hints)]
    show(*blocks)
    to_csv = partial(result.to_csv, degrees=options.degrees)
    for path, write in ((given.csv, to_csv), (given.npz, result.to_npz), (given.plot, result.plot)):
        if path is not None and failure is not None and Path(path).is_file():
            note(f"{path} is kept as it was: the motion is not complete. Name another file for it.")
        elif path is not None:
            shared.show_written(write(path))
    if given.report is not None:
        write_simulation_report(loaded, result, blocks, options, given, friction=friction)
    if isinstance(failure, KeyboardInterrupt):
        raise failure
    judged = simulation_verdict(loaded, result, driven=bool(given.torque))
    clear = clearance is None or clearance.verdict.ok
    return judged.exit_code if failure is None and clear else ExitCode.NO


def write_simulation_report(
    loaded: Robot, result: Any, blocks: Sequence[Block], options: RobotOptions, given: Given, *, friction: bool
) -> None:
    """Write the page of a simulation: the end or the worst moment, and plots."""
    from ..viz.pictures import drawn, robot_picture

    end = f"{number(result.times[-1], 6)} s"
    pictures = [robot_picture(loaded, *_worst_moment(loaded, result))]
    pictures.append(drawn("Joints, energies and drift", result.plot))
    facts = [
        ("simulated", end),
        ("energy drift, relative to the energy exchanged", residual(result.relative_drift)),
    ]
    used = [("method", f"{result.method}, {friction_words(loaded.model, counted=friction)}")]
    subject = f"{loaded.name} · {end}"
    write_report(
        given, "simulate", subject, blocks, files=options.files, facts=facts, pictures=pictures, robot=loaded,
        limits=loaded.limits, degrees=options.degrees, used=used,
    )  # fmt: skip


def _planes(robot: Robot, touch: tuple[str, ...], ground: float | None, contact: str | None) -> list[Any]:
    """Ground plane for each contact frame."""
    if ground is None:
        if touch:
            raise ValueRangeError("--touch names points that the ground holds up, and there is none. Add --ground 0.")
        if contact is not None:
            raise ValueRangeError("--contact sets properties of the ground, and there is no ground. Add --ground 0.")
        return []
    k, c, mu = parse_numbers(
        _CONTACT if contact is None else contact,
        "--contact",
        "k,c,mu: stiffness, dissipation and friction, for example 1e5,0.3,0.5",
        3,
    )
    points: dict[str, list[list[float]]] = {}
    for text in touch or (robot.tip or "",):
        frame, colon, place = text.partition(":")
        if not frame:
            robot.model.frame(None)  # raises with the names to choose from
        form = "FRAME:x,y,z in metres, for example tool0:0,0,0.1"
        points.setdefault(frame, []).append(parse_numbers(place, "--touch", form, 3) if colon else [0.0, 0.0, 0.0])
    return [
        Plane(frame, rows, height=ground, stiffness=k, dissipation=c, friction=mu) for frame, rows in points.items()
    ]


# ── The report


_MOST = 20
"""Maximum number of listed events."""
_ROUNDING = 12
"""Decimals of coordinates, velocities and energies; smaller values are rounding errors."""


def simulation_view(
    robot: Robot,
    result: SimulationResult,
    clearance: PathClearance | None = None,
    *,
    driven: bool = False,
    degrees: bool = False,
    friction: bool = True,
) -> Iterator[Block]:
    """Verdict, limits and closest links; then coordinates, velocities, energies, accuracy and events."""
    c = Coordinates.from_model(robot.model)
    judged = simulation_verdict(robot, result, driven=driven, degrees=degrees)
    drift = f"Energy drift {residual(result.relative_drift)} of the energy exchanged."
    touching = shared.clearance_verdict(clearance)
    yield from touching
    if touching and judged.ok:
        yield f"Simulated {number(result.times[-1], 6)} s. {drift}"
    elif judged.ok:
        word = judged.word if clearance is None else Word.OK
        yield Headline(word, f"simulated {number(result.times[-1], 6)} s. {drift}")
    else:
        at = "" if judged.word is Word.OVER_LIMIT else f" at t = {number(result.times[-1], 6)} s"
        yield Headline(judged.word, f"{judged.reasons[0]}. {drift}", at)
    yield from () if clearance is None else clearance.lines
    if not driven or not result.completed:
        yield from remarks(_limits_passed(robot, result, degrees=degrees))
    yield ""
    yield Line(
        (result.robot, Style.STRONG),
        f"  ·  {result.method}  ·  {len(result)} states to {number(result.times[-1], 6)} s  ·  {result.steps} steps",
        f", {result.rejected} rejected" if result.rejected else "",
        f"  ·  {friction_words(robot.model, counted=friction)}",
    )
    q = result.q * np.where(c.angular & degrees, math.degrees(1.0), 1.0)
    unit = heading_unit("q", (True, False), degrees=degrees)
    places = partial(numbers, show=_rounded, unit=unit, headed=False)
    yield Table(
        f"Coordinates [{unit}]",
        words("coordinate", c.names),
        places("start", q[0]),
        places("end", q[-1]),
        places("lowest", q.min(axis=0)),
        places("highest", q.max(axis=0)),
    )
    dq = result.dq * np.where(c.angular_velocity & degrees, math.degrees(1.0), 1.0)
    peaks = np.abs(dq).argmax(axis=0)
    unit = heading_unit("dq", (True, False), degrees=degrees)
    speeds = partial(numbers, show=_rounded, unit=unit, headed=False)
    yield Table(
        f"Velocities [{unit}]",
        words("velocity", c.velocity_names),
        speeds("start", dq[0]),
        speeds("end", dq[-1]),
        speeds("fastest", dq[peaks, np.arange(len(peaks))]),
        numbers("at", result.times[peaks], seconds, "s"),
    )
    yield _energies(result)
    if np.isfinite(result.relative_error):
        yield f"error of the steps: {residual(result.relative_error)} of the motion"
    yield from (f"· {event}" for event in result.events[:_MOST])
    if len(result.events) > _MOST:
        yield f"· … {len(result.events)} events in all"
    yield from remarks(result.remarks)


def _energies(result: SimulationResult) -> Table:
    energies = {"kinetic": result.kinetic_energy, "potential": result.potential_energy, "both": result.energy}
    energies |= {f"work of {name}": work for name, work in result.work.items() if np.any(work)}
    rows = {name: x[[0, -1, int(np.abs(x).argmax())]] for name, x in energies.items()}
    drift = result.drift
    last = [Line(residual(x), value=x) for x in (0.0, drift[-1], drift[np.abs(drift).argmax()])]
    cells = zip(*([Line(_rounded(x), value=x) for x in row] for row in rows.values()), last, strict=True)
    heads = ("start", "end", "largest")
    columns = [numbers(head, column, unit="J", headed=False) for head, column in zip(heads, cells, strict=True)]
    return Table("Energies [J]", words("", [*rows, "drift"]), *columns)


def _rounded(value: float) -> str:
    return number(value, decimals=_ROUNDING)


_PASSED = {
    "position": ("is at", "Nothing held the joint: --stop-at-limits ends where a limit is reached"),
    "torque": (
        "is given",
        "The robot's drives cannot give it: reduce --torque, or raise the efforts in the robot's file",
    ),
    "velocity": ("moves at", "The robot's drives would not let it"),
}
"""Verb and meaning for each kind of exceeded limit."""


def simulation_verdict(robot: Robot, result: SimulationResult, *, driven: bool, degrees: bool = False) -> Verdict:
    """Verdict on a simulation: STOPPED if it ended early, OVER LIMIT if given torques pass a limit, otherwise DONE.

    A passive fall is not judged by limits: it is DONE whatever it passes. Angles are in degrees if ``degrees``.
    """
    if not result.completed:
        return Verdict(Word.STOPPED, (_reason_of_end(robot, result, degrees=degrees),))
    passed = [v for mine in _violations(robot, result).values() for v in mine]
    if not driven or not passed:
        return Verdict(Word.DONE)
    more = f"; {len(passed) - 1} more limit{'s are' if len(passed) > 2 else ' is'} passed" if len(passed) > 1 else ""
    return Verdict(Word.OVER_LIMIT, (f"{_in_words(passed[0], degrees=degrees)}{more}. {_PASSED[passed[0].kind][1]}",))


def _reason_of_end(robot: Robot, result: SimulationResult, *, degrees: bool) -> str:
    """Reason for an early end; a position limit is in degrees if ``degrees``."""
    k = _joint_at_limit(robot, result)
    if k is None:
        return with_option_names(result.stopped)
    limits, x = robot.limits, robot.model.positions(result.events[-1].q)[k]
    side = "upper" if limits.upper[k] - x < x - limits.lower[k] else "lower"
    turns = bool(Coordinates.from_model(robot.model).angular_velocity[k])
    limit = getattr(limits, side)[k] * (math.degrees(1.0) if degrees and turns else 1.0)
    unit = unit_of("q", turns, degrees=degrees)
    return f"{robot.model.velocity_names[k]} reached its {side} position limit, {number(limit, 5)} {unit}"


def _joint_at_limit(robot: Robot, result: SimulationResult) -> int | None:
    """Index in dq of the joint whose position limit ended the simulation; None if it ended otherwise."""
    if result.completed or not result.events:
        return None
    limits, x = robot.limits, robot.model.positions(result.events[-1].q)
    margins = np.minimum(limits.upper - x, x - limits.lower) / limits.tolerance
    k = int(np.argmin(np.where(np.isfinite(margins), margins, np.inf)))
    return k if margins[k] <= 1.0 else None


def _in_words(violation: Violation, *, degrees: bool) -> str:
    shown = violation.in_degrees() if degrees else violation
    verb, value = _PASSED[shown.kind][0], f"{number(shown.value, 5)} {shown.unit}"
    limit = shown.limit if shown.kind == "position" else abs(shown.limit)
    return f"{shown.joint} {verb} {value} at t = {seconds(shown.time)} s, limit {number(limit, 5)}"


def _violations(robot: Robot, result: SimulationResult) -> dict[str, list[Violation]]:
    """Limits exceeded by states or given torques, by kind."""
    check = LimitCheck(robot.model, bounds_of(robot))
    check.add(result.times, result.q, result.dq, None, result.tau)
    passed = check.violations()
    found = {kind: [violation for violation in passed if violation.kind == kind] for kind in _PASSED}
    return {kind: mine for kind, mine in found.items() if mine}


def _worst_moment(robot: Robot, result: SimulationResult) -> tuple[Array, MarkedJoint | None, str]:
    """Configuration of the picture, the joint that stopped the motion or exceeds its limit most, and a title."""
    end = f"{robot.name} at the end, t = {number(result.times[-1], 6)} s"
    k = _joint_at_limit(robot, result)
    if k is not None:
        joint = robot.model.velocity_names[k]
        return result.q[-1], MarkedJoint(joint, f"{joint}, at its limit", Style.NEAR), end
    worst = next((mine[0] for mine in _violations(robot, result).values()), None)
    if worst is None:
        return result.q[-1], None, end
    row, label = int(np.abs(result.times - worst.time).argmin()), f"{worst.joint}, {worst.kind} over its limit"
    return result.q[row], MarkedJoint(worst.joint, label, Style.OVER), f"{robot.name} at t = {seconds(worst.time)} s"


def _limits_passed(robot: Robot, result: SimulationResult, *, degrees: bool) -> list[str]:
    """Sentences on exceeded limits, one per kind."""
    sentences = []
    for kind, mine in _violations(robot, result).items():
        more = len(mine) - 1
        others = f", and {more} more joint{'s pass' if more > 1 else ' passes'} theirs" if more else ""
        sentences.append(f"{_in_words(mine[0], degrees=degrees)}{others}. {_PASSED[kind][1]}.")
    return sentences
