"""The command ``twistwrench simulate``: options, run and report of a simulation."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ..answers.blocks import Headline
from ..core.arguments import parse_numbers
from ..core.errors import SimulationError, ValueRangeError
from ..core.verdict import ExitCode, Word
from ..motion.coordinates import configuration_of, degrees_hint, parse_rates
from ..motion.model_doubts import friction_words
from ..robot import Robot
from ..simulation.contact import Plane
from . import shared
from .main import Given, note, noted_if_failed, option, with_option_names
from .report import REPORT, write_report
from .shared import RobotOptions, robot_command
from .terminal import progress_bar, show, show_answer

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
    words = with_option_names(result.stopped)
    result = replace(result, friction=friction, degrees=options.degrees)
    clearance = shared.clearance_along(given, loaded, [(result.times, result.q)])
    answer = replace(result, stopped=words, remarks=(*result.remarks, *hints), clearance=clearance)
    show_answer(answer)
    to_csv = partial(result.to_csv, degrees=options.degrees)
    for path, write in ((given.csv, to_csv), (given.npz, result.to_npz), (given.plot, result.plot)):
        if path is not None and failure is not None and Path(path).is_file():
            note(f"{path} is kept as it was: the motion is not complete. Name another file for it.")
        elif path is not None:
            shared.show_written(write(path))
    used = [("method", f"{result.method}, {friction_words(loaded.model, counted=friction)}")]
    write_report(
        given, "simulate", answer.subject, list(answer.blocks()), files=options.files, facts=answer.facts().items(),
        pictures=answer.pictures() if given.report is not None else (), robot=loaded, limits=loaded.limits,
        degrees=options.degrees, used=used,
    )  # fmt: skip
    if isinstance(failure, KeyboardInterrupt):
        raise failure
    return answer.verdict.exit_code


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
