"""Simulations and rollouts of closed robots, with constraint forces and constraint drift."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..algorithms.loop_closure import SAFE
from ..core import arguments
from ..core.numbers import printed, residual
from ..errors import SimulationError, UnknownNameError, ValueRangeError
from ..model.parameters import moves_joints
from ..robot import constraints as checks
from ..typing import Array
from .closed_system import CLOSED_METHODS, FASTEST, GOOD, KEPT, OPEN, PIVOT, WIDEST, Loops
from .preparation import simulated
from .result import SimulationResult
from .rollout import Rollout, rolled_out
from .rollout_gradient import computed, room_for
from .rollout_inputs import Inputs, cleaned

if TYPE_CHECKING:
    from ..robot.closed_robot import ClosedRobot


@dataclass(frozen=True, eq=False, repr=False)
class ClosedSimulation(SimulationResult):
    """A simulated motion of a closed robot. What it has beside :class:`SimulationResult` is read from no file."""

    row_names: tuple[str, ...] = ()
    """Names of the entries of lam."""
    lam: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n, k) N m or N, λ of each state: what the robot applies where it is held."""
    gap: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) rad or m, by how much the loops are open at most, in each state."""
    gap_before: float = 0.0
    """rad or m, the largest gap that a step left; it was closed at the end of the step."""
    slip_before: float = 0.0
    """rad/s or m/s, the largest rate A dq that a step left; it was taken away likewise."""

    def __repr__(self) -> str:
        held = f"gap {residual(self.gap.max(initial=0.0))}, before projection {residual(self.gap_before)}"
        return f"{super().__repr__()[:-1]}; {held}>"


def simulate_closed(closed: ClosedRobot, q0: Any, *start: Any, method: str | None, **given: Any) -> ClosedSimulation:
    """Simulation of a closed robot from one state; see :meth:`twistwrench.Robot.simulate`."""
    method = "rk4" if method is None else method
    if method not in CLOSED_METHODS:
        raise UnknownNameError.from_choices("method", method, CLOSED_METHODS)
    loops = Loops(closed) if closed.independent else None
    if q0 is None:
        q0 = checks.some_configurations(closed, closed.robot.neutral)[0]
    try:
        found = simulated(closed.robot, q0, *start, method=method, loops=loops, **given)
    except (SimulationError, KeyboardInterrupt) as problem:
        if isinstance(result := getattr(problem, "result", None), SimulationResult):
            problem.result = _held(result, closed, loops)  # type: ignore[union-attr]
        raise
    return _held(found, closed, loops)


def _held(found: SimulationResult, closed: ClosedRobot, loops: Loops | None) -> ClosedSimulation:
    """The result with what its constraints did; ``loops`` is None where no row of them holds anything."""
    known = {f.name: getattr(found, f.name) for f in fields(SimulationResult) if f.init}
    gaps = np.abs(closed.gaps(found.q)).max(axis=-1, initial=0.0)
    if loops is None:
        lam = np.zeros((len(found), len(closed.sizes)))
        return ClosedSimulation(**known, row_names=closed.row_names, lam=lam, gap=gaps)
    lam = loops.system.multipliers(found.times, found.q, found.dq, found.tau)
    return ClosedSimulation(
        **known, row_names=closed.row_names, lam=lam, gap=gaps, gap_before=loops.widest, slip_before=loops.fastest
    )


# ── Rollouts of closed robots, each step projected onto the constraints


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRollout(Rollout):
    """Rollout of a closed robot: motions of any batch shape, and how well each kept to the constraints."""

    gap: Array = field(default_factory=lambda: np.zeros(()))
    """(...) rad or m, by how much the loops were open at most, after any step."""
    gap_before: Array = field(default_factory=lambda: np.zeros(()))
    """(...) rad or m, the largest gap that a step left; it was closed at the end of the step."""
    slip_before: Array = field(default_factory=lambda: np.zeros(()))
    """(...) rad/s or m/s, the largest rate A dq that a step left; it was taken away likewise."""
    lost_from: Array = field(default_factory=lambda: np.zeros(()))
    """(...) s, the first kept time at which the constraints had lost rank or could not be kept, inf where they were: the states
    from there on are NaN, for the motion may go on in several ways."""

    def __repr__(self) -> str:
        gaps = (float(np.max(x, initial=0.0)) for x in (self.gap, self.gap_before))
        return f"{super().__repr__()[:-1]}; gap {residual(next(gaps))}, before projection {residual(next(gaps))}>"


def rollout_closed(
    closed: ClosedRobot, *start: Any, gradients: bool, out: tuple[Array, ...] | None, **given: Any
) -> ClosedRollout:
    """Motions from q0 (..., nq) and dq0 (..., nv); see :meth:`twistwrench.Robot.rollout`."""
    robot = closed.robot
    if arguments.flag(gradients, "gradients") or out is not None:
        raise ValueRangeError(
            "gradients and out are for rollouts of open robots; leave them out where loops are closed."
        )
    if not closed.independent:
        return _held_of_closed_rollout(rolled_out(robot, *start, gradients=False, out=None, **given), None)
    loops = Loops(closed)
    inputs = cleaned(robot, *start, **given, step_of=loops.step_of)
    if moves_joints(robot.model, inputs.plan.parameters):
        raise ValueRangeError(
            f"parameters={inputs.plan.parameters!r} move joints, and with them where the loops close. Close a robot of each "
            "geometry by itself; inertias, payloads and friction may vary."
        )
    inputs = _begun(loops, inputs)
    results = room_for(inputs, None)
    computed(robot, inputs, results)
    q, dq, kept, *said = results
    lost = ~(kept[..., GOOD] > 0.5)
    q[lost], dq[lost] = np.nan, np.nan
    plain = Rollout(
        robot.name, robot.coordinate_names, robot.model.velocity_names, inputs.times, q, dq, said[0] if said else None,
        inputs.dt, inputs.steps, inputs.plan.method, inputs.remarks, robot,
    )  # fmt: skip
    return _held_of_closed_rollout(plain, (kept, lost))


def _begun(loops: Loops, given: Inputs) -> Inputs:
    """The inputs with their first states on the constraints, and what is passed on from step to step beside them."""
    closed = loops.closed
    arrays = [
        x.astype(float, copy=False) for x in given.arrays
    ]  # loops close to 1e-12, and float32 knows no such number
    q, dq = arrays[:2]
    checks.require_met(closed, q, dq)
    with np.errstate(all="ignore"):
        q, dq, pivot = loops.projected(q, dq)
    if not (pivot >= SAFE).all():
        row = int(np.argmin(pivot))
        where = f" (motion {row} of the batch)" if pivot.ndim else ""
        raise ValueRangeError(
            f"q0 is a singular configuration{where}: the constraints lose rank there, and no motion goes on from it in one "
            "way only. Start elsewhere."
        )
    passed = np.zeros((*pivot.shape, KEPT))
    passed[..., PIVOT], passed[..., GOOD] = pivot, 1.0
    ranks = [1, *given.ranks]
    return replace(given, arrays=[q, dq, passed, *arrays[2:]], ranks=ranks, dtype=np.float64)


def _held_of_closed_rollout(found: Rollout, said: tuple[Array, Array] | None) -> ClosedRollout:
    """The rollout with what its constraints did; None where no row of them holds anything."""
    known = {name: getattr(found, name) for name in Rollout.__dataclass_fields__}
    none = np.zeros(found.batch)
    if said is None:
        return ClosedRollout(**known, gap=none, gap_before=none, slip_before=none, lost_from=none + np.inf)
    kept, lost = said
    last = np.maximum((~lost).sum(axis=-1) - 1, 0)
    end = np.take_along_axis(kept, last[..., None, None], axis=-2)[
        ..., 0, :
    ]  # the last state that is on the constraints
    lost_from = np.where(lost.any(axis=-1), found.times[np.argmax(lost, axis=-1)], np.inf)
    remarks = found.remarks
    if lost.any():
        first = np.unravel_index(int(np.argmin(lost_from)), found.batch) if found.batch else ()
        where = f", first {tuple(map(int, first))}" if found.batch else ""
        remarks = (
            *remarks,
            f"{np.isfinite(lost_from).sum()} of the motions lose rank of their constraints or leave them{where} before "
            f"{printed(float(lost_from[first]))} s; their states after that are NaN",
        )
    known["remarks"] = remarks
    return ClosedRollout(
        **known, gap=end[..., OPEN], gap_before=end[..., WIDEST], slip_before=end[..., FASTEST], lost_from=lost_from
    )
