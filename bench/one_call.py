"""One call with one state in every way a loop writes it: `out=`, a frame, a wrench, lists; and Pinocchio's Python call."""

from collections.abc import Callable, Iterator, Sequence
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
        mine, theirs = _inputs(ours, quantity, states), _theirs(peer, quantity, states)
        count = MATRICES.get(quantity, 0)
        room = [np.empty((robot.nv,) * (2 if count else 1)) for _ in range(max(count, 1))]
        out: Any = room[0] if len(room) == 1 else tuple(room)
        yield quantity, _calls(f"robot.{quantity}", "{x}", mine, robot=robot), theirs
        yield f"{quantity}, out=", _calls(f"robot.{quantity}", "{x}, out=out", mine, robot=robot, out=out), theirs
    q, known = ours.inputs("jacobian", states), {"robot": robot, "tip": tip}
    yield "jacobian, frame=", _calls("robot.jacobian", "{x}, frame=tip", q, **known), _theirs(peer, "jacobian", states)
    poses = _calls("robot.forward_kinematics", "{x}, frame=tip", q, **known)
    yield "forward kinematics, frame=", poses, _poses(peer, tip, states)
    mine, method, F = ours.inputs("inverse_dynamics", states), "robot.inverse_dynamics", np.arange(1.0, 7.0)
    pushed = _calls(method, "{x}, wrench_on_robot={{tip: F}}", mine, F=F, **known)
    yield "inverse dynamics with a wrench", pushed, _theirs_with_wrench(peer, tip, states, F)
    lists = _calls(method, "{x}", [x.tolist() for x in mine], **known)
    yield "inverse dynamics of lists", lists, _theirs(peer, "inverse_dynamics", states)


def _calls(function: str, arguments: str, given: Sequence[Any], **known: Any) -> Calls:
    """A call for each state, written out as a loop in a program has it; ``{x}`` are the arrays of a state."""
    names = ", ".join(f"x{k}" for k in range(len(given)))
    call = f"        function({arguments.format(x=names)})"
    lines = ["def calls():", f"    function = {function}", f"    for {names}, in rows:", call, ""]
    found: dict[str, Any] = {**known, "rows": list(zip(*given, strict=True))}
    exec("\n".join(lines), found)
    return found["calls"]  # type: ignore[no-any-return]


def _inputs(ours: Ours, quantity: str, states: States) -> tuple[np.ndarray, ...]:
    given = ours.inputs("inverse_dynamics" if quantity in INPUTS else quantity, states)
    return given[: len(INPUTS[quantity])] if quantity in INPUTS else given


def _theirs(peer: Pinocchio, quantity: str, states: States) -> Calls:
    known = {"model": peer.model, "data": peer.data}
    if quantity in INPUTS:
        given = tuple(getattr(states, name) for name in INPUTS[quantity])
        return _calls("compute", "model, data, {x}", given, compute=pin.nonLinearEffects, **known)
    (function, more), given = peer.functions[quantity], states.inputs(quantity)
    further = {f"further{k}": value for k, value in enumerate(more)}
    arguments = ", ".join(["model, data, {x}", *further])
    return _calls("compute", arguments, given, compute=function, **known, **further)


def _poses(peer: Pinocchio, tip: str, states: States) -> Calls:
    frame, model, data = peer.model.getFrameId(tip, pin.BODY), peer.model, peer.data
    forward, place, rows = pin.forwardKinematics, pin.updateFramePlacement, list(states.q)

    def calls() -> None:
        for q in rows:
            forward(model, data, q)
            place(model, data, frame)

    return calls


def _theirs_with_wrench(peer: Pinocchio, tip: str, states: States, F: np.ndarray) -> Calls:
    forces = pin.StdVec_Force()
    for _ in range(peer.model.njoints):
        forces.append(pin.Force.Zero())
    forces[peer.model.frames[peer.model.getFrameId(tip, pin.BODY)].parentJoint] = pin.Force(F)
    given = states.inputs("inverse_dynamics")
    known = {"model": peer.model, "data": peer.data, "forces": forces}
    return _calls("compute", "model, data, {x}, forces", given, compute=pin.rnea, **known)
