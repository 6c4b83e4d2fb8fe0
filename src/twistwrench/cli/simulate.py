"""The command ``twistwrench simulate``: options, run and report of a simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.numbers import number, residual, seconds
from ..core.verdict import ExitCode, Word
from ..errors import SimulationError, ValueRangeError
from ..joints.units import heading_unit
from ..motion.bounds import LimitCheck, Violation, bounds_of
from ..motion.coordinates import Coordinates
from ..reports.blocks import Block, Line, Table, numbers, remarks, verdict, words
from ..reports.robot_summary import degrees_hint, parse_configuration, parse_numbers, parse_rates
from ..reports.torque_verdict import friction_words
from ..robot import Robot
from ..simulation.contact import Plane
from ..simulation.result import SimulationResult
from ..typing import Array
from . import shared
from .main import Given, note, option, with_option_names
from .report import REPORT, drawn, robot_picture, write_report
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

    Exit code: 1 if the motion ended before its duration, at a limit with --stop-at-limits or because integration failed;
    the motion until then is printed and written. Also 1 if links come too near (--clearance).
    """
    given.check_files({"--srdf": given.srdf, **options.files})
    load = shared.load_case(options.load(), options, given)
    loaded, friction = load.with_load, load.friction
    result: Any
    failure: BaseException | None = None
    q0 = parse_configuration(loaded, given.at, degrees=options.degrees)
    if hint := degrees_hint(loaded, q0):
        show(*remarks([hint]))
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
        with progress_bar(f"{loaded.name}: {given.method}") as progress:
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
    blocks = list(simulation_view(loaded, result, clearance, degrees=options.degrees, friction=friction))
    show(*blocks)
    to_csv = partial(result.to_csv, degrees=options.degrees)
    for path, write in ((given.csv, to_csv), (given.npz, result.to_npz), (given.plot, result.plot)):
        if path is not None and failure is not None and Path(path).is_file():
            note(f"{path} is kept as it was: the motion is not complete. Name another file for it.")
        elif path is not None:
            shared.show_written(write(path))
    if given.report is not None:
        end = f"{number(result.times[-1], 6)} s"
        pictures = [robot_picture(loaded, *_worst_moment(loaded, result))]
        pictures.append(drawn("Joints, energies and drift", result.plot))
        facts = [
            ("simulated", end),
            ("energy drift, relative to the energy exchanged", residual(result.relative_drift)),
        ]
        used = [("method", f"{result.method}, {friction_words(loaded.model, counted=friction)}")]
        subject, shown = f"{loaded.name} · {end}", [*blocks, *(remarks([hint]) if hint else [])]
        write_report(
            given, "simulate", subject, shown, files=options.files, facts=facts, pictures=pictures, robot=loaded,
            limits=loaded.limits, degrees=options.degrees, used=used,
        )  # fmt: skip
    if isinstance(failure, KeyboardInterrupt):
        raise failure
    clear = clearance is None or clearance.verdict.ok
    return ExitCode.FINE if failure is None and result.completed and clear else ExitCode.NO


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
    degrees: bool = False,
    friction: bool = True,
) -> Iterator[Block]:
    """Verdict, limits and closest links; then coordinates, velocities, energies, accuracy and events."""
    c = Coordinates.from_model(robot.model)
    drift = f"Energy drift {residual(result.relative_drift)} of the energy exchanged."
    touching = shared.clearance_verdict(clearance)
    yield from touching
    if result.completed:
        done = f"simulated {number(result.times[-1], 6)} s. {drift}"
        yield f"{done[0].upper()}{done[1:]}" if touching else verdict(Word.OK, f": {done}")
    else:
        yield verdict(
            Word.STOPPED, f" at t = {number(result.times[-1], 6)} s: {with_option_names(result.stopped)}. {drift}"
        )
    yield from () if clearance is None else clearance.lines
    yield from remarks(_limits_passed(robot, result))
    yield ""
    yield Line(
        (result.robot, "bold"),
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
    "position": ("Joints were not held at their limits", "--stop-at-limits ends where the first is reached."),
    "torque": (
        "The torques given are more than the motors have",
        "Give less, or raise the efforts in the robot's file.",
    ),
    "velocity": ("Joints are faster than their limits", "The robot's own drives would not let them."),
}
"""Meaning and remedy for each kind of exceeded limit."""


def _violations(robot: Robot, result: SimulationResult) -> dict[str, list[Violation]]:
    """Limits exceeded by states or given torques, by kind."""
    check = LimitCheck(robot.model, bounds_of(robot))
    check.add(result.times, result.q, result.dq, None, result.tau)
    passed = check.violations()
    found = {kind: [violation for violation in passed if violation.kind == kind] for kind in _PASSED}
    return {kind: mine for kind, mine in found.items() if mine}


def _worst_moment(robot: Robot, result: SimulationResult) -> tuple[Array, str | None, str, str]:
    """Configuration of the picture, the joint that stopped the motion or exceeds its limit most, its label and a title."""
    end = f"{number(result.times[-1], 6)} s"
    joint = next((name for name in robot.joint_names if f"joint {name!r} reaches" in result.stopped), None)
    if joint is not None:
        return (
            result.q[-1],
            joint,
            f"{joint}, at its limit",
            f"{robot.name} at the end, t = {end}; red: {joint}, at its limit",
        )
    worst = next((mine[0] for mine in _violations(robot, result).values()), None)
    if worst is None:
        return result.q[-1], None, "", f"{robot.name} at the end, t = {end}"
    row, label = int(np.abs(result.times - worst.time).argmin()), f"{worst.joint}, {worst.kind} over its limit"
    return result.q[row], worst.joint, label, f"{robot.name} at t = {seconds(worst.time)} s; red: {label}"


def _limits_passed(robot: Robot, result: SimulationResult) -> list[str]:
    """Sentences on limits exceeded by states or given torques, one per kind."""
    sentences = []
    for kind, mine in _violations(robot, result).items():
        meaning, remedy = _PASSED[kind]
        more = len(mine) - 1
        others = f", and {more} more joint{'s pass' if more > 1 else ' passes'} theirs" if more else ""
        sentences.append(f"{meaning}: {mine[0]}{others}. {remedy}")
    return sentences
