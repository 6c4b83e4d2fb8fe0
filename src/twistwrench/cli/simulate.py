"""The command ``twistwrench simulate``: its options, and its answer as things to print."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.verdict import ExitCode
from ..errors import SimulationError, ValueRangeError
from .console import progress_bar
from .motion_options import AT, CONFIGURATION, NO_FRICTION, PAYLOADS, WRENCHES, option_group

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..robot import Robot
    from ..simulation.result import SimulationResult


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


def run_simulate(
    robot: Robot,
    show: Callable[[RenderableType], None],
    *,
    degrees: bool,
    duration: float,
    dt: float,
    method: str,
    at: tuple[str, ...],
    configuration: str | None,
    velocity: tuple[str, ...],
    torque: tuple[str, ...],
    payloads: tuple[str, ...],
    wrenches: tuple[str, ...],
    no_friction: bool,
    stop_at_limits: bool,
    touch: tuple[str, ...],
    ground: float | None,
    contact: str | None,
    rtol: float,
    every: int,
    csv_path: str | None,
    npz_path: str | None,
    plot_path: str | None,
) -> ExitCode:
    """Print the answer with ``show``, and write the files.

    Returns FINE where the motion came to the end of its duration, NO where it ended before, at a limit or because it could
    not go on. What was computed before a failure or an interrupt is printed and written too. Raises errors of the library,
    and KeyboardInterrupt.
    """
    from ..reports.load_case import LoadCase, parse_payload, parse_wrenches
    from ..reports.robot_summary import degrees_hint, parse_configuration, parse_rates
    from .tables.motion import simulation_view

    load = LoadCase(robot, tuple(map(parse_payload, payloads)), parse_wrenches(wrenches))
    loaded = load.with_load
    friction = not no_friction
    failure: BaseException | None = None
    q0 = parse_configuration(loaded, at, configuration, degrees=degrees)
    if hint := degrees_hint(loaded, q0):
        show(f"! {hint}")
    dq0 = parse_rates(loaded, velocity, "--velocity", degrees=degrees)
    options: dict[str, Any] = {
        "method": method,
        "tau": parse_rates(loaded, torque, "--torque", degrees=False) if torque else None,
        "wrench_on_robot": load.wrenches or None,
        "friction": friction and loaded.model.friction.any,
        "limits": "stop" if stop_at_limits else None,
        "contacts": _planes(loaded, touch, ground, contact),
        "rtol": rtol,
        "every": every,
    }
    try:
        with progress_bar(f"{loaded.name}: {options['method']}") as progress:
            result = loaded.simulate(q0, dq0, duration, dt, **options, progress=progress)
    except SimulationError as problem:
        if problem.result is None:
            raise
        result, failure = _computed(problem), problem
    except KeyboardInterrupt as interrupt:
        if not hasattr(interrupt, "result"):
            raise
        result, failure = interrupt.result, interrupt
    show(simulation_view(loaded, result, degrees=degrees, friction=friction))
    to_csv = partial(result.to_csv, degrees=degrees)
    for path, write in ((csv_path, to_csv), (npz_path, result.to_npz), (plot_path, result.plot)):
        if path is not None and failure is not None and Path(path).is_file():
            click.echo(
                f"note: {path} is kept as it was: the motion is not complete. Name another file for it.", err=True
            )
        elif path is not None:
            show(f"wrote {write(path)}")
    if isinstance(failure, KeyboardInterrupt):
        raise failure
    return ExitCode.FINE if failure is None and result.completed else ExitCode.NO


def _computed(problem: SimulationError) -> SimulationResult:
    result: Any = problem.result
    return result


def _planes(robot: Robot, touch: tuple[str, ...], ground: float | None, contact: str | None) -> list[Any]:
    """A plane for each frame that touches the ground."""
    from ..reports.robot_summary import parse_numbers
    from ..simulation.contact import Plane

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
