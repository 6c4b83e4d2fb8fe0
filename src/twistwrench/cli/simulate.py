"""The command ``twistwrench simulate``: options, run and report of a simulation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeAlias

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block, Headline
from ..core.arguments import parse_numbers
from ..core.errors import SimulationError, ValueRangeError
from ..core.verdict import Verdict, Word
from ..motion.coordinates import configuration_of, degrees_hint, parse_rates
from ..motion.load_case import LoadCase, parse_payload, parse_wrenches
from ..robot import Robot
from ..robot.doors import clearance_along
from ..simulation.contact import Plane
from ..simulation.result import SimulationResult
from . import shared
from .main import noted_if_failed, option
from .shared import RobotOptions
from .skin import Asked, OutputFile, Outputs, command_of, picture_file, table_file
from .terminal import progress_bar

_CONTACT = "1e5,0.3,0.5"
"""Default of --contact."""


@dataclass(frozen=True, eq=False, repr=False)
class RefusedSimulation(Answer):
    """Answer in place of a simulation that was not begun, since its loads contradict themselves."""

    call: ClassVar[str] = "simulate"

    robot: str
    contradictions: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        """LOOK AGAIN."""
        return Verdict(Word.LOOK_AGAIN, self.contradictions)

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot

    def blocks(self) -> Iterator[Block]:
        """Verdict."""
        yield Headline(Word.LOOK_AGAIN, f"{'; '.join(self.contradictions)}.")


Simulated: TypeAlias = SimulationResult | RefusedSimulation


def _is_simulated(answer: Simulated) -> bool:
    return isinstance(answer, SimulationResult)


def _is_cut_off(answer: Simulated) -> bool:
    return isinstance(answer, SimulationResult) and answer.interrupted


def _simulation_result(answer: Simulated) -> SimulationResult:
    assert isinstance(answer, SimulationResult)
    return answer


def _write_csv(answer: Simulated, path: str) -> object:
    result = _simulation_result(answer)
    return result.to_csv(path, degrees=result.degrees)


@command_of(
    "simulate",
    Robot.simulate,
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
    shared.DEGREES,
    files=(
        table_file(
            _write_csv,
            "Write the motion, which torques and view read",
            exists=_is_simulated,
            keeps=_is_cut_off,
        ),
        OutputFile(
            "--npz OUT.npz",
            "Write all arrays in NumPy format.",
            lambda answer, path: _simulation_result(answer).to_npz(path),
            exists=_is_simulated,
            keeps=_is_cut_off,
        ),
        picture_file("Draw joints, energies and drift.", exists=_is_simulated, keeps=_is_cut_off),
    ),
    report=True,
    examples=("simulate ur5 --duration 0.5", "simulate planar_2r --at joint1=0.5 --csv fall.csv --plot fall.png"),
    left_out=(
        *("q0", "dq0", "tau", "wrench_on_robot", "friction", "limits", "contacts"),
        *("controller", "creep", "events", "atol", "max_step"),
    ),
)
def simulate_command(
    robot: RobotOptions,
    asked: Asked,
    outputs: Outputs[Simulated],
    at: tuple[str, ...],
    velocity: tuple[str, ...],
    torque: tuple[str, ...],
    payloads: tuple[str, ...],
    wrenches: tuple[str, ...],
    no_friction: bool,
    clearance: float | None,
    srdf: str | None,
    stop_at_limits: bool,
    touch: tuple[str, ...],
    ground: float | None,
    contact: str | None,
) -> Simulated:
    """Simulate a motion, and report states, energy drift and events.

    DONE: no limit is judged unless torques are given (--torque), and no distance without --clearance. Exit code: 1 if
    given torques pass a limit, if the motion ended before its duration, at a limit with --stop-at-limits or because
    integration failed, or if links come too near (--clearance). The motion until then is printed and written.
    """
    parsed_payloads = tuple(parse_payload(text, robot.tip) for text in payloads)
    load = LoadCase(robot.load(), parsed_payloads, parse_wrenches(wrenches), friction=not no_friction)
    if load.contradictions:
        return RefusedSimulation(load.robot.name, tuple(load.contradictions))
    loaded_robot = load.with_load
    degrees = robot.degrees
    q0 = configuration_of(loaded_robot, at, degrees=degrees)
    dq0 = parse_rates(loaded_robot, velocity, "--velocity", degrees=degrees)
    tau = parse_rates(loaded_robot, torque, "--torque", degrees=False) if torque else None
    ground_planes = _ground_planes(loaded_robot, touch, ground, contact)
    hints = list(load.unit_hints)
    hint_on_degrees = degrees_hint(loaded_robot, q0)
    if hint_on_degrees:
        hints.insert(0, hint_on_degrees)
    counts_friction = load.friction and loaded_robot.model.friction.any
    interrupted = False
    result: Any
    try:
        with noted_if_failed(hints), progress_bar(f"{loaded_robot.name}: {asked.get('method', 'dopri5')}") as progress:
            result = loaded_robot.simulate(
                q0, dq0, tau=tau, wrench_on_robot=load.wrenches or None, friction=counts_friction,
                limits="stop" if stop_at_limits else None, contacts=ground_planes, progress=progress, **asked,
            )  # fmt: skip
    except SimulationError as problem:
        if problem.result is None:  # nothing was simulated
            raise
        result = problem.result
        interrupted = True
    except KeyboardInterrupt as interrupt:
        result = getattr(interrupt, "result", None)
        interrupted = True
        outputs.interrupt = interrupt
        if result is None:
            raise
    path_clearance = clearance_along(loaded_robot, [(result.times, result.q)], clearance, srdf)
    return replace(
        result, friction=load.friction, degrees=degrees,
        remarks=(*result.remarks, *hints), clearance=path_clearance, interrupted=interrupted,
    )  # fmt: skip


def _ground_planes(robot: Robot, touch: tuple[str, ...], ground: float | None, contact: str | None) -> list[Any]:
    """Ground plane of each frame with contact points, as contacts of a simulation; empty without ground."""
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
    points_by_frame: dict[str, list[list[float]]] = {}
    tip = "" if robot.tip is None else robot.tip
    for text in touch or (tip,):
        frame, colon, coordinates = text.partition(":")
        if not frame:  # the robot has no tip
            robot.model.frame(None)  # only for its error, which lists the names
        point = [0.0, 0.0, 0.0]
        if colon:
            point = parse_numbers(coordinates, "--touch", "FRAME:x,y,z in metres, for example tool0:0,0,0.1", 3)
        points_by_frame.setdefault(frame, []).append(point)
    return [
        Plane(frame, points, height=ground, stiffness=k, dissipation=c, friction=mu)
        for frame, points in points_by_frame.items()
    ]
