"""Gradients through rollouts: the adjoints of the steps, taken from the last to the first, for all samples in one kernel.

Where every state is kept, one sweep takes all steps. Where one in some is, the states between two are computed once more, with
the bits they had, from the last such piece to the first: memory for one piece, and time for the steps once more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.friction import rubbing
from ..core import arguments
from ..errors import ShapeError, ValueRangeError
from ..kernels.results import room
from ..robot.model_kernels import compiled
from ..typing import Array
from .rollout_inputs import Inputs
from .rollout_kernel import kernel_of, take
from .step_adjoint import StepAdjoint
from .step_program import Plan

if TYPE_CHECKING:
    from ..robot import Robot

DRY = (
    "dry friction has corners: slopes are those of each joint as it was in each step, sliding its way or held, and say nothing "
    "of what sets it free or stops it"
)
LIMITED = "a torque at its limit answers to nothing: its slope is 0 there, also by what would bring it back within"


@dataclass(frozen=True, eq=False, repr=False)
class RolloutGradient:
    """Gradient of a cost of the motions of a rollout by all that went in.

    Each part has the shape of what was given. By configurations it is along robot.add, with entries nv in place of nq. What
    several samples or steps share, as a payload or a gain, has the sum of their slopes. There is no slope by
    ``torque_limits``, and a torque at its limit passes none on: its slope by what would change it is 0.
    """

    q0: Array
    """(..., nv) by the configurations at the start."""
    dq0: Array
    """(..., nv) by the velocities at the start."""
    tau: Array | None
    """By the torques, (..., steps, nv) if none were given; None where a law gives them."""
    law: Mapping[str, Array] = field(default_factory=dict)
    """By the references and gains of a law, by their names."""
    wrench_on_robot: Mapping[str, Array] = field(default_factory=dict)
    """By the wrenches, (m, f) in their frame, by its name."""
    parameters: Mapping[str, Array] = field(default_factory=dict)
    """By the parameters, by their names."""
    remarks: tuple[str, ...] = ()
    """What to know before the slopes are used, in words; empty if nothing."""

    def __repr__(self) -> str:
        tau = {} if self.tau is None else {"tau": self.tau}
        parts = {"q0": self.q0, "dq0": self.dq0, **tau, **self.law, **self.wrench_on_robot, **self.parameters}
        said = [f"{name} {x.shape}" for name, x in parts.items()] + [f"note: {remark}" for remark in self.remarks]
        return f"<RolloutGradient: {'; '.join(said)}>"


def kept_for_gradients(given: Inputs, out: Any) -> Inputs:
    """The inputs with arrays of their own, whatever becomes of the caller's; refuses what has no exact gradient."""
    if out is not None:
        raise ShapeError(
            "gradients=True wants the states as they were, and out= lends arrays that will be written again."
        )
    if given.plan.eases:
        raise ValueRangeError(
            "gradients: method='rk4' eases dry friction off below speeds that are chosen by the robot's inertia at q0, which "
            "no slope would know of. Take method='semi_implicit', or leave friction out."
        )
    return replace(given, arrays=[_copied(x) for x in given.arrays])


def _copied(x: Array) -> Array:
    """A copy, of one entry where there is one for a whole axis."""
    once = x[tuple(slice(1) if step == 0 else slice(None) for step in x.strides)]
    return np.broadcast_to(once.copy(), x.shape)


def gradient(robot: Robot, given: Inputs, q: Array, dq: Array, slopes: Mapping[str, ArrayLike]) -> RolloutGradient:
    """The gradient of a cost whose ``slopes`` by q, dq and tau of each row are given."""
    plan, own, batch = given.plan, given.own, given.batch
    cost = {name: _slopes_of(robot, given, name, x) for name, x in slopes.items()}
    (by_q0, by_dq0), said = _swept(robot, given, _rows(q), _rows(dq), cost)
    names = [name for name, _ in StepAdjoint(plan).by]
    whole = {name: x.reshape(*batch, *x.shape[1:]) for name, x in zip(names, said, strict=True)}
    law = {name: _shared(whole[name], own[name]) for name in plan.law.names}
    pushed = {frame: _shared(whole[f"wrench at {frame}"], own[f"the wrench at {frame!r}"]) for frame in plan.frames}
    parameters = {}
    for k, name in enumerate(plan.parameters):
        total = whole["parameters"][..., k].sum(axis=-1)
        parameters[name] = _shared(total[..., None], (*(own[f"parameter {name}"] or ()), 1))[..., 0]
    return RolloutGradient(
        _shared(by_q0.reshape(*batch, robot.nv), own["q0"]),
        _shared(by_dq0.reshape(*batch, robot.nv), own["dq0"]),
        law.pop("tau", None),
        law,
        pushed,
        parameters,
        remarks_of(robot, plan),
    )


def linearized(robot: Robot, given: Inputs, q: Array, dq: Array) -> tuple[Array, Array]:
    """A (..., steps, 2 nv, 2 nv) and B (..., steps, 2 nv, nv): rows by the adjoint of each step for unit slopes."""
    n, steps, batch = robot.nv, given.steps, given.batch
    A, B = np.empty((*batch, steps, 2 * n, 2 * n), given.dtype), np.empty((*batch, steps, 2 * n, n), given.dtype)
    unit, none = np.eye(2 * n, dtype=given.dtype), np.zeros((1, n), given.dtype)
    now = [x[..., :-1, None, None, :] for x in (q, q, dq)]
    step = [given.arrays[2][:, None, None]]
    for x, rank in zip(given.arrays[3:], given.ranks[3:], strict=True):
        x = x if x.ndim == rank else x.reshape(*batch, *x.shape[1:])
        step.append(x[..., :, None, None, :])
    extra = [np.empty((*batch, steps, 2 * n, 1, *shape), given.dtype) for _, shape in StepAdjoint(given.plan).by]
    rows = [x[..., None, :] for x in (A[..., :n], A[..., n:], B)]
    place = [name for name, _ in StepAdjoint(given.plan).by].index("tau")
    extra[place] = rows.pop()
    with np.errstate(all="ignore"):
        kernel = _kernel(robot, given.plan)
        kernel(unit[:, :n], unit[:, n:], *now, *step, *[none] * (2 + given.plan.says_torques), out=(*rows, *extra))
    return A, B


def remarks_of(robot: Robot, plan: Plan) -> tuple[str, ...]:
    """What to know of slopes where motions have corners."""
    laws = (".coulomb", ".static", ".load")
    dry = rubbing(robot.model) or any(name.endswith(laws) for name in plan.parameters)
    return (*[DRY] * bool(plan.friction and dry), *[LIMITED] * plan.limited)


# ── the sweep ──


def _swept(
    robot: Robot, given: Inputs, q: Array, dq: Array, cost: Mapping[str, Array]
) -> tuple[tuple[Array, Array], list[Array]]:
    """λ by q and by dq at the start, (samples, nv) each, and the slopes by all that was given, (samples, steps, …) each."""
    samples, every, steps = len(q), given.steps // given.kept, given.steps
    kernel, by = _kernel(robot, given.plan), StepAdjoint(given.plan).by
    said = list(room([(samples, steps, *shape) for _, shape in by], np.dtype(given.dtype)))
    now = cost["q"][:, -1], cost["dq"][:, -1]
    pieces = [(0, steps)] if every == 1 else [(k * every, (k + 1) * every) for k in reversed(range(given.kept))]
    for first, last in pieces:
        step = [x[first:last] if rank == 1 else x[..., first:last, :] for x, rank in _given(given)]
        if every == 1:
            states, costs = (q[:, :-1], dq[:, :-1]), [x[:, :steps] for x in cost.values()]
        else:
            states = _between(robot, given, q[:, first // every], dq[:, first // every], step)
            costs = [_at_first(x[:, first // every], every) for x in cost.values()]
        back = [x[:, ::-1] for x in (states[0], *states)]
        arrays = [
            *now,
            *back,
            *(x[..., ::-1] if x.ndim == 1 else x[..., ::-1, :] for x in step),
            *(x[:, ::-1] for x in costs),
        ]
        ranks = [1, 1, 2, 2, 2, *given.ranks[2:], *[2] * len(costs)]
        rows = room([(samples, last - first, robot.nv)] * 2, np.dtype(given.dtype))
        take(kernel, arrays, ranks, (*rows, *(x[:, first:last][:, ::-1] for x in said)), last - first)
        now = rows[0][:, -1], rows[1][:, -1]
    return now, said


def _between(robot: Robot, given: Inputs, q: Array, dq: Array, step: list[Array]) -> tuple[Array, Array]:
    """States of a piece, computed once more; all but the last."""
    samples, n = len(q), step[0].shape[0]
    sizes = [robot.nq, robot.nv, *[robot.nv] * given.plan.says_torques]
    found = room([(samples, n, size) for size in sizes], np.dtype(given.dtype))
    take(kernel_of(robot, given.plan), [q, dq, *step], [1, 1, *given.ranks[2:]], found, n)
    shifted = [np.concatenate([x[:, None], y[:, :-1]], axis=1) for x, y in zip((q, dq), found, strict=False)]
    return shifted[0], shifted[1]


def _given(given: Inputs) -> list[tuple[Array, int]]:
    """dt and all that is given for each step, with the axes that are not the batch's."""
    return list(zip(given.arrays[2:], given.ranks[2:], strict=True))


def _at_first(slope: Array, steps: int) -> Array:
    """Slopes (samples, nv) of the first of some steps, 0 for the others."""
    found = np.zeros((len(slope), steps, slope.shape[-1]), slope.dtype)
    found[:, 0] = slope
    return found


def _rows(x: Array) -> Array:
    return x.reshape(-1, *x.shape[-2:])


def _kernel(robot: Robot, plan: Plan) -> Any:
    doc = f"Adjoints of the steps of rollouts of {robot.name}, compiled: {plan.method}."
    return robot.engine.kept(("adjoint", *plan.key), lambda: compiled(StepAdjoint(plan).recurrence, "adjoint", doc))


# ── shapes ──


def _slopes_of(robot: Robot, given: Inputs, name: str, x: ArrayLike) -> Array:
    """Slopes of a cost by ``name`` of each row, (samples, rows, nv)."""
    rows, what = given.kept + (name != "tau"), f"gradient: the slope by {name}"
    found = arguments.real(x, what, names=robot.model.velocity_names)
    wanted = (*given.batch, rows, robot.nv)
    try:
        whole = np.broadcast_to(found, wanted)
    except ValueError:
        along = " Configurations are moved along robot.add, by nv numbers." if name == "q" else ""
        raise ShapeError(
            f"{what} has shape {found.shape}, expected {wanted}: a number for each row and velocity.{along}"
        ) from None
    return _rows(whole.astype(given.dtype))


def _shared(x: Array, shape: tuple[int, ...] | None) -> Array:
    """Slopes summed over what those of this shape share; its last axis stays as x has it."""
    if shape is None:
        return x
    if not shape:
        return np.asarray(x.sum())
    x = x.sum(axis=tuple(range(x.ndim - len(shape))))
    alone = tuple(k for k, size in enumerate(shape[:-1]) if size == 1 != x.shape[k])
    return np.asarray(x.sum(axis=alone, keepdims=True))
