"""The command ``twistwrench simulate``: options, run and report of a simulation."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ..core.files import check_outputs
from ..core.numbers import number, residual, seconds
from ..core.verdict import ExitCode
from ..errors import SimulationError, ValueRangeError
from ..joints.units import heading_unit
from ..motion.bounds import LimitCheck, bounds_of
from ..motion.coordinates import Coordinates
from ..reports.load_case import LoadCase, parse_payload, parse_wrenches
from ..reports.robot_summary import degrees_hint, parse_configuration, parse_numbers, parse_rates
from ..robot import Robot
from ..simulation.contact import Plane
from ..simulation.result import SimulationResult
from ..typing import Array
from .console import picture, progress_bar, show, show_written
from .motion_options import AT, CONFIGURATION, NO_FRICTION, PAYLOADS, WRENCHES
from .plain_table import PlainTable, friction_words, remarks
from .robot_options import RobotOptions, robot_command
from .usage import Given, option_group, with_option_names

_CONTACT = "1e5,0.3,0.5"


simulate_options = option_group(
    click.option("--plot", "plot_path", metavar="OUT.png", help="Draw joints, energies and drift."),
    click.option("--npz", "npz_path", metavar="OUT.npz", help="Write all arrays in NumPy's format."),
    click.option("--csv", "csv_path", metavar="OUT.csv", help="Write a motion that the torques command reads."),
    click.option("--every", type=int, default=1, show_default=True, metavar="N", help="Keep one state in N."),
    click.option("--rtol", type=float, default=1e-8, show_default=True, help="Of dopri5: relative error of a step."),
    click.option(
        "--contact",
        metavar="k,c,mu",
        help=f"The ground's stiffness [N/m^1.5], dissipation [s/m] and friction; needs --ground.  [default: {_CONTACT}]",
    ),
    click.option("--ground", metavar="HEIGHT", type=float, help="Where the ground is, along z of the base [m]."),
    click.option(
        "--touch",
        metavar="FRAME[:x,y,z]",
        multiple=True,
        help="A point that the ground holds up, with --ground; may be repeated. Without it the tip.",
    ),
    click.option(
        "--stop-at-limits", is_flag=True, help="End where a joint reaches a limit of position, with exit code 1."
    ),
    NO_FRICTION,
    WRENCHES,
    PAYLOADS,
    click.option("--torque", metavar="JOINT=VALUE", multiple=True, help="A constant torque; may be repeated."),
    click.option("--velocity", metavar="JOINT=VALUE", multiple=True, help="A velocity at the start; may be repeated."),
    CONFIGURATION,
    AT,
    click.option(
        "--method",
        default="dopri5",
        show_default=True,
        metavar="NAME",
        help="dopri5, rk4, variational, variational6, midpoint, semi_implicit or euler.",
    ),
    click.option("--dt", type=float, default=1e-3, show_default=True, help="Between two states [s]."),
    click.option("--duration", type=float, default=1.0, show_default=True, help="How long [s]."),
)
"""The options of the command, all but the robot's own."""


@robot_command(
    "simulate",
    simulate_options,
    examples=(
        "simulate ur5 --duration 0.5",
        "simulate planar_2r --at joint1=0.5 --csv fall.csv --plot fall.png",
    ),
)
def simulate_command(options: RobotOptions, given: Given) -> ExitCode:
    """Simulate a motion: states, energies with their drift, events, and why it stopped.

    Exit code 1 if the motion ended before its duration: at a limit with --stop-at-limits, or because it could not go on;
    what was computed until then is printed and written.
    """
    given.plot_path = picture(given.plot_path)
    check_outputs({"--csv": given.csv_path, "--npz": given.npz_path, "--plot": given.plot_path}, options.files)
    robot = options.load()
    load = LoadCase(robot, tuple(map(parse_payload, given.payloads)), parse_wrenches(given.wrenches))
    loaded = load.with_load
    friction = not given.no_friction
    failure: BaseException | None = None
    q0 = parse_configuration(loaded, given.at, given.configuration, degrees=options.degrees)
    if hint := degrees_hint(loaded, q0):
        show(f"! {hint}")
    dq0 = parse_rates(loaded, given.velocity, "--velocity", degrees=options.degrees)
    settings: dict[str, Any] = {
        "method": given.method,
        "tau": parse_rates(loaded, given.torque, "--torque", degrees=False) if given.torque else None,
        "wrench_on_robot": load.wrenches or None,
        "friction": friction and loaded.model.friction.any,
        "limits": "stop" if given.stop_at_limits else None,
        "contacts": _planes(loaded, given.touch, given.ground, given.contact),
        "rtol": given.rtol,
        "every": given.every,
    }
    try:
        with progress_bar(f"{loaded.name}: {given.method}") as progress:
            result = loaded.simulate(q0, dq0, given.duration, given.dt, **settings, progress=progress)
    except SimulationError as problem:
        if problem.result is None:
            raise
        result, failure = _computed(problem), problem
    except KeyboardInterrupt as interrupt:
        if not hasattr(interrupt, "result"):
            raise
        result, failure = interrupt.result, interrupt
    show(simulation_view(loaded, result, degrees=options.degrees, friction=friction))
    to_csv = partial(result.to_csv, degrees=options.degrees)
    for path, write in ((given.csv_path, to_csv), (given.npz_path, result.to_npz), (given.plot_path, result.plot)):
        if path is not None and failure is not None and Path(path).is_file():
            click.echo(
                f"note: {path} is kept as it was: the motion is not complete. Name another file for it.", err=True
            )
        elif path is not None:
            show_written(write(path))
    if isinstance(failure, KeyboardInterrupt):
        raise failure
    return ExitCode.FINE if failure is None and result.completed else ExitCode.NO


def _computed(problem: SimulationError) -> SimulationResult:
    result: Any = problem.result
    return result


def _planes(robot: Robot, touch: tuple[str, ...], ground: float | None, contact: str | None) -> list[Any]:
    """A plane for each frame that touches the ground."""
    if ground is None:
        if touch:
            raise ValueRangeError("--touch names points that the ground holds up, and there is none. Add --ground 0.")
        if contact is not None:
            raise ValueRangeError("--contact says what the ground is like, and there is none. Add --ground 0.")
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
            robot.model.frame(None)  # says what to name
        form = "FRAME:x,y,z in metres, for example tool0:0,0,0.1"
        points.setdefault(frame, []).append(parse_numbers(place, "--touch", form, 3) if colon else [0.0, 0.0, 0.0])
    return [
        Plane(frame, rows, height=ground, stiffness=k, dissipation=c, friction=mu) for frame, rows in points.items()
    ]


# ── The report


_MOST = 20
"""Events listed."""
_ROUNDING = 12
"""Decimals below which a coordinate, a velocity or an energy is zero."""


def simulation_view(
    robot: Robot, result: SimulationResult, *, degrees: bool = False, friction: bool = True
) -> RenderableType:
    """Verdict with remarks on limits, then coordinates, velocities, energies, accuracy and events."""
    c = Coordinates.from_model(robot.model)
    word = ("DONE", "bold") if result.completed else ("STOPPED", "bold red")
    verdict = [
        Text.assemble(word, f": {with_option_names(result.stopped)}."),
        *remarks(_limits_passed(robot, result)),
        Text(),
    ]
    heading = Text.assemble(
        (result.robot, "bold"),
        f"  ·  {result.method}  ·  {len(result)} states to {number(result.times[-1], 6)} s  ·  {result.steps} steps",
        f", {result.rejected} taken again" if result.rejected else "",
        f"  ·  {friction_words(robot.model, counted=friction)}",
    )
    parts: list[RenderableType] = [*verdict, heading, _coordinates(result, c, degrees=degrees)]
    parts += [_velocities(result, c, degrees=degrees), _energies(result), _accuracy(result)]
    parts += [Text(f"· {event}") for event in result.events[:_MOST]]
    if len(result.events) > _MOST:
        parts.append(Text(f"· … {len(result.events)} events in all"))
    return Group(*parts, *remarks(result.remarks))


_PASSED = {
    "position": ("Joints were not held at their limits", "--stop-at-limits ends where the first is reached."),
    "torque": (
        "The torques given are more than the motors have",
        "Give less, or raise the efforts in the robot's file.",
    ),
    "velocity": ("Joints are faster than their limits", "The robot's own drives would not let them."),
}
"""Meaning and remedy for each kind of limit that a simulation may exceed."""


def _limits_passed(robot: Robot, result: SimulationResult) -> list[str]:
    """Sentence for each kind of limit that the states or the given torques exceed."""
    check, said = LimitCheck(robot.model, bounds_of(robot)), []
    check.add(result.times, result.q, result.dq, None, result.tau)
    passed = check.violations()
    for kind, (meaning, remedy) in _PASSED.items():
        mine = [violation for violation in passed if violation.kind == kind]
        if not mine:
            continue
        more = len(mine) - 1
        others = f", and {more} more joint{'s pass' if more > 1 else ' passes'} theirs" if more else ""
        said.append(f"{meaning}: {mine[0]}{others}. {remedy}")
    return said


def _coordinates(result: SimulationResult, c: Coordinates, *, degrees: bool) -> PlainTable:
    table = PlainTable(f"Coordinates [{heading_unit('q', (True, False), degrees=degrees)}]")
    table.words("coordinate")
    table.numbers("start", "end", "lowest", "highest")
    for name, x, angular in zip(c.names, result.q.T, c.angular, strict=True):
        unit = math.degrees(1.0) if degrees and angular else 1.0
        table.row(name, *_cells(unit * np.array([x[0], x[-1], x.min(), x.max()])))
    return table


def _velocities(result: SimulationResult, c: Coordinates, *, degrees: bool) -> PlainTable:
    table = PlainTable(f"Velocities [{heading_unit('dq', (True, False), degrees=degrees)}]")
    table.words("velocity")
    table.numbers("start", "end", "fastest", "at [s]")
    for name, v, angular in zip(c.velocity_names, result.dq.T, c.angular_velocity, strict=True):
        unit, peak = math.degrees(1.0) if degrees and angular else 1.0, int(np.abs(v).argmax())
        table.row(name, *_cells(unit * v[[0, -1, peak]]), seconds(result.times[peak]))
    return table


def _energies(result: SimulationResult) -> PlainTable:
    table = PlainTable("Energies [J]")
    table.words("")
    table.numbers("start", "end", "largest")
    rows = {"kinetic": result.kinetic_energy, "potential": result.potential_energy, "both": result.energy}
    rows |= {f"work of {name}": work for name, work in result.work.items() if np.any(work)}
    for name, x in rows.items():
        table.row(name, *_cells(x[[0, -1, int(np.abs(x).argmax())]]))
    drift = result.drift
    table.row("drift", "0", residual(drift[-1]), residual(drift[np.abs(drift).argmax()]))
    return table


def _accuracy(result: SimulationResult) -> Text:
    """Energy drift and integration error, relative to the motion."""
    said = f"drift {residual(result.relative_drift)} of the energy that moved"
    if np.isfinite(result.relative_error):
        said += f"; error of the steps {residual(result.relative_error)} of the motion"
    return Text(said)


def _cells(values: Array) -> list[str]:
    return [number(x, decimals=_ROUNDING) for x in values]
