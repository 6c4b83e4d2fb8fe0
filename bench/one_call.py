"""One call with one state in every way a loop writes it: `out=`, a frame, a wrench, lists; and Pinocchio's Python call."""

from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
import pinocchio as pin

from bench import machine
from bench.cases import CASES, MATRICES, Case, States
from bench.ours import Ours
from bench.peer_pinocchio import Pinocchio
from bench.timing import ROUNDS, Contender, interleave

STATES = 64
WARM = 300  # calls before anything is timed: methods of long programs take their shortcut after some

QUANTITIES = {
    "panda": (
        "inverse_dynamics", "forward_dynamics", "mass_matrix", "gravity_forces", "bias_forces",
        "inverse_dynamics_derivatives", "forward_dynamics_derivatives",
    ),
    "talos": ("inverse_dynamics", "forward_dynamics", "mass_matrix", "inverse_dynamics_derivatives"),
}  # fmt: skip
INPUTS = {"bias_forces": ("q", "dq")}

Calls = Callable[[], None]


def times(rounds: int = ROUNDS, cases: tuple[Case, ...] = CASES) -> dict[str, Any]:
    """Nanoseconds a call by robot and way, ours and theirs in turns."""
    where = machine.describe()
    found: dict[str, Any] = {"date": where["date"], "cpu": where["cpu"], "rounds": rounds, "robots": {}}
    for case in cases:
        if case.name not in QUANTITIES:
            continue
        print(f"{case.name}: one call", flush=True)
        rows: dict[str, Any] = {}
        for way, ours, theirs in _ways(case):
            for _ in range(1 + WARM // STATES):
                ours()
            pair = [Contender(name, _repeat(calls), STATES) for name, calls in (("ours", ours), ("theirs", theirs))]
            rows[way] = {name: asdict(timing) for name, timing in interleave(pair, rounds).items()}
        found["robots"][case.name] = rows
    return found


def _repeat(calls: Calls) -> Callable[[int], None]:
    def sweep(times: int) -> None:
        for _ in range(times):
            calls()

    return sweep


def _ways(case: Case) -> Iterator[tuple[str, Calls, Calls]]:
    """A way's name, a call of it for each state, and Pinocchio's."""
    ours, peer, states = Ours(case), Pinocchio(case), States.random(case, STATES)
    robot, tip = ours.robot, case.tip
    for quantity in QUANTITIES[case.name]:
        mine, theirs = list(zip(*_inputs(ours, quantity, states), strict=True)), _theirs(peer, quantity, states)
        count = MATRICES.get(quantity, 0)
        room = [np.empty((robot.nv,) * (2 if count else 1)) for _ in range(max(count, 1))]
        out: Any = room[0] if len(room) == 1 else tuple(room)
        yield quantity, _each(robot, quantity, mine, {}), theirs
        yield f"{quantity}, out=", _each(robot, quantity, mine, {"out": out}), theirs
    q = list(zip(*ours.inputs("jacobian", states), strict=True))
    yield "jacobian, frame=", _each(robot, "jacobian", q, {"frame": tip}), _theirs(peer, "jacobian", states)
    yield "forward kinematics, frame=", _each(robot, "forward_kinematics", q, {"frame": tip}), _poses(peer, tip, states)
    mine = list(zip(*ours.inputs("inverse_dynamics", states), strict=True))
    F = np.arange(1.0, 7.0)

    def with_wrench() -> None:
        method = robot.inverse_dynamics
        for q, dq, ddq in mine:
            method(q, dq, ddq, wrench_on_robot={tip: F})

    yield "inverse dynamics with a wrench", with_wrench, _theirs_with_wrench(peer, tip, states, F)
    lists = [[x.tolist() for x in row] for row in mine]
    yield (
        "inverse dynamics of lists",
        _each(robot, "inverse_dynamics", lists, {}),
        _theirs(peer, "inverse_dynamics", states),
    )


def _inputs(ours: Ours, quantity: str, states: States) -> tuple[np.ndarray, ...]:
    given = ours.inputs("inverse_dynamics" if quantity in INPUTS else quantity, states)
    return given[: len(INPUTS[quantity])] if quantity in INPUTS else given


def _each(robot: Any, quantity: str, rows: list[Any], options: dict[str, Any]) -> Calls:
    def calls() -> None:
        method = getattr(robot, quantity)
        for row in rows:
            method(*row, **options)

    return calls


def _theirs(peer: Pinocchio, quantity: str, states: States) -> Calls:
    if quantity in INPUTS:
        function: Any = pin.nonLinearEffects
        more: tuple[Any, ...] = ()
        given = tuple(getattr(states, name) for name in INPUTS[quantity])
    else:
        (function, more), given = peer.functions[quantity], states.inputs(quantity)
    rows = [(*row, *more) for row in zip(*given, strict=True)]

    def calls() -> None:
        for row in rows:
            function(peer.model, peer.data, *row)

    return calls


def _poses(peer: Pinocchio, tip: str, states: States) -> Calls:
    frame, rows = peer.model.getFrameId(tip, pin.BODY), list(states.q)

    def calls() -> None:
        for q in rows:
            pin.forwardKinematics(peer.model, peer.data, q)
            pin.updateFramePlacement(peer.model, peer.data, frame)

    return calls


def _theirs_with_wrench(peer: Pinocchio, tip: str, states: States, F: np.ndarray) -> Calls:
    forces = pin.StdVec_Force()
    for _ in range(peer.model.njoints):
        forces.append(pin.Force.Zero())
    forces[peer.model.frames[peer.model.getFrameId(tip, pin.BODY)].parentJoint] = pin.Force(F)
    rows = list(zip(*states.inputs("inverse_dynamics"), strict=True))

    def calls() -> None:
        for row in rows:
            pin.rnea(peer.model, peer.data, *row, forces)

    return calls
