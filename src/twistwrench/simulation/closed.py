"""Simulations and rollouts of closed robots, with constraint forces and constraint drift."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..core import arguments
from ..core.errors import SimulationError, UnknownNameError, ValueRangeError
from ..core.numbers import printed, residual
from ..core.typing import Array
from ..mechanics.algorithms.constraint_projector import MIN_PIVOT
from ..mechanics.model.parameters import moves_joints
from ..robot.constraints.closures import some_configurations
from ..robot.constraints.states import require_met
from .methods.closed_steps import (
    LARGEST_GAP,
    LARGEST_RATE,
    LOOP_STATE_SIZE,
    ON_CONSTRAINTS,
    PIVOT,
    REMAINING_GAP,
    Loops,
)
from .methods.schemes import ADAPTIVE
from .preparation import build_run, run_to_end
from .result import SimulationResult
from .rollout import Rollout, build_rollout, rollout_of_tree
from .rollout_inputs import Inputs, validate_inputs
from .rollout_steps import room_for, take_all_steps

if TYPE_CHECKING:
    from ..robot.doors import ConstrainedRobot

CLOSED_METHODS = (ADAPTIVE, "rk4", "semi_implicit", "euler")
"""Methods for closed robots, which only evaluate rates; the variational methods are for open robots."""


@dataclass(frozen=True, eq=False, repr=False)
class ClosedSimulation(SimulationResult):
    """Simulated motion of a closed robot. Files do not store the fields in addition to :class:`SimulationResult`."""

    row_names: tuple[str, ...] = ()
    """Names of the columns of lam."""
    lam: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(n, k) constraint forces λ in each state, exerted by the robot on its constraints [N m or N]."""
    gap: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) largest gap of the loops in each state [rad or m]."""
    gap_before: float = 0.0
    """Largest gap after a step, before the projection removed it [rad or m]."""
    slip_before: float = 0.0
    """Largest rate A dq after a step, before the projection removed it [rad/s or m/s]."""

    @classmethod
    def _from_result(cls, result: SimulationResult, closed: ConstrainedRobot, loops: Loops | None) -> Self:
        """Result with its constraint forces and errors; ``loops`` is None if no row is constrained."""
        values = {field.name: getattr(result, field.name) for field in fields(SimulationResult) if field.init}
        values["row_names"] = closed.row_names
        values["gap"] = np.abs(closed.gaps(result.q)).max(axis=-1, initial=0.0)
        if loops is None:
            return cls(**values, lam=np.zeros((len(result), len(closed.sizes))))
        lam = loops.system.multipliers(result.times, result.q, result.dq, result.tau)
        return cls(**values, lam=lam, gap_before=loops.largest_gap, slip_before=loops.largest_rate)

    def __repr__(self) -> str:
        max_gap = self.gap.max(initial=0.0)
        text_without_bracket = super().__repr__()[:-1]
        return f"{text_without_bracket}; gap {residual(max_gap)}, before projection {residual(self.gap_before)}>"


def simulate_closed(
    closed: ConstrainedRobot, q0: Any, *start: Any, method: str | None, **options: Any
) -> ClosedSimulation:
    """Simulation from one state; see :meth:`twistwrench.Robot.simulate`."""
    method = "rk4" if method is None else method
    if method not in CLOSED_METHODS:
        raise UnknownNameError.from_choices("method", method, CLOSED_METHODS)
    loops = Loops(closed) if closed.independent else None
    if q0 is None:
        q0, *_ = some_configurations(closed, closed.open().neutral)
    try:
        run = build_run(closed.open(), q0, *start, method=method, loops=loops, **options)
        result = run_to_end(run)
    except (SimulationError, KeyboardInterrupt) as problem:  # its partial result becomes that of a closed robot
        partial_result = getattr(problem, "result", None)
        if isinstance(partial_result, SimulationResult):
            problem.result = ClosedSimulation._from_result(partial_result, closed, loops)  # type: ignore[union-attr]
        raise
    return ClosedSimulation._from_result(result, closed, loops)


@dataclass(frozen=True, eq=False, repr=False)
class ClosedRollout(Rollout):
    """Rollout of a closed robot: motions of any batch shape, with their constraint errors."""

    gap: Array = field(default_factory=lambda: np.zeros(()))
    """(...) largest gap of the loops after any step [rad or m]."""
    gap_before: Array = field(default_factory=lambda: np.zeros(()))
    """(...) largest gap after a step, before the projection removed it [rad or m]."""
    slip_before: Array = field(default_factory=lambda: np.zeros(()))
    """(...) largest rate A dq after a step, before the projection removed it [rad/s or m/s]."""
    lost_from: Array = field(default_factory=lambda: np.zeros(()))
    """(...) first stored time [s] at which constraints had lost rank or could not be satisfied; inf if they hold throughout.
    States from there on are NaN, because the motion is not unique."""

    def __repr__(self) -> str:
        max_gap = float(np.max(self.gap, initial=0.0))
        max_gap_before = float(np.max(self.gap_before, initial=0.0))
        text_without_bracket = super().__repr__()[:-1]
        return f"{text_without_bracket}; gap {residual(max_gap)}, before projection {residual(max_gap_before)}>"


def rollout_closed(
    closed: ConstrainedRobot, *start: Any, gradients: bool, out: tuple[Array, ...] | None, **options: Any
) -> ClosedRollout:
    """Motions from q0 (..., nq) and dq0 (..., nv); see :meth:`twistwrench.Robot.rollout`."""
    robot = closed.open()
    if arguments.flag(gradients, "gradients") or out is not None:
        raise ValueRangeError(
            "gradients and out are for rollouts of open robots; leave them out where loops are closed."
        )
    if not closed.independent:
        rollout = rollout_of_tree(robot, *start, gradients=False, out=None, **options)
        zeros = np.zeros(rollout.batch)
        values = {name: getattr(rollout, name) for name in Rollout.__dataclass_fields__}
        return ClosedRollout(**values, gap=zeros, gap_before=zeros, slip_before=zeros, lost_from=zeros + np.inf)
    loops = Loops(closed)
    inputs = validate_inputs(robot, *start, **options, step_of=loops.step_of)
    if moves_joints(robot.model, inputs.plan.parameters):
        raise ValueRangeError(
            f"parameters={inputs.plan.parameters!r} move joints, and with them where the loops close. Close a robot of each "
            "geometry by itself; inertias, payloads and friction may vary."
        )
    inputs = _projected_inputs(loops, inputs)
    q, dq, loop_states, *tau = take_all_steps(robot, inputs, room_for(inputs, None))  # tau: an array or none
    is_lost = ~(loop_states[..., ON_CONSTRAINTS] > 0.5)  # a flag of 0 or 1; NaN counts as lost
    q[is_lost] = np.nan
    dq[is_lost] = np.nan
    last_index = np.maximum((~is_lost).sum(axis=-1) - 1, 0)  # of the last state on the constraints
    last_loop_state = np.take_along_axis(loop_states, last_index[..., None, None], axis=-2)[..., 0, :]
    first_lost_index = np.argmax(is_lost, axis=-1)
    lost_from = np.where(is_lost.any(axis=-1), inputs.times[first_lost_index], np.inf)
    if is_lost.any():
        inputs = replace(inputs, remarks=(*inputs.remarks, _remark_on_lost(lost_from)))
    return build_rollout(
        ClosedRollout,
        robot,
        inputs,
        q,
        dq,
        tau,
        gap=last_loop_state[..., REMAINING_GAP],
        gap_before=last_loop_state[..., LARGEST_GAP],
        slip_before=last_loop_state[..., LARGEST_RATE],
        lost_from=lost_from,
    )


def _remark_on_lost(lost_from: Array) -> str:
    """Remark on motions that leave their constraints, by the times (...) at which they do."""
    first_index: tuple[int, ...] = ()
    index_text = ""
    if lost_from.shape:
        earliest = int(np.argmin(lost_from))  # in the flattened array
        first_index = tuple(map(int, np.unravel_index(earliest, lost_from.shape)))
        index_text = f", first {first_index}"
    return (
        f"{np.isfinite(lost_from).sum()} of the motions lose rank of their constraints or leave them{index_text} before "
        f"{printed(float(lost_from[first_index]))} s; their states after that are NaN"
    )


def _projected_inputs(loops: Loops, inputs: Inputs) -> Inputs:
    """Inputs with initial states projected onto the constraints, and the initial loop-closure state."""
    q, dq, *other_arrays = (x.astype(float, copy=False) for x in inputs.arrays)  # float64: loops are closed to 1e-12
    require_met(loops.closed, q, dq)
    with np.errstate(all="ignore"):  # singular configurations are reported below
        q, dq, pivot = loops.project(q, dq)
    if not (pivot >= MIN_PIVOT).all():
        row = int(np.argmin(pivot))
        index = f" (motion {row} of the batch)" if pivot.ndim else ""
        raise ValueRangeError(
            f"q0 is a singular configuration{index}: the constraints lose rank there, and no motion goes on from it in one "
            "way only. Start elsewhere."
        )
    loop_state = np.zeros((*pivot.shape, LOOP_STATE_SIZE))
    loop_state[..., PIVOT] = pivot
    loop_state[..., ON_CONSTRAINTS] = 1.0
    return replace(inputs, arrays=[q, dq, loop_state, *other_arrays], ranks=[1, *inputs.ranks], dtype=np.float64)
