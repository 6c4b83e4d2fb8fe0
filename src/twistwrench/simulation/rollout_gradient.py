"""Gradients through rollouts: adjoint steps from last to first, and the kernels of both directions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..compiler.ir import autodiff
from ..compiler.ir.loops import Scan, Source
from ..compiler.ir.tracer import trace
from ..compiler.lowering.target_machine import SINGLE
from ..compiler.runtime import batch_threads
from ..compiler.runtime.batch_threads import Part
from ..compiler.runtime.gufunc import owner_of
from ..compiler.runtime.result_pool import result_arrays
from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.algorithms.friction import dry_friction_indices
from ..mechanics.algorithms.kinematics import velocity_map
from ..robot.differentiate import Chart
from ..robot.engine import compile_form
from .compiled_steps import Ports, StepPlan
from .rollout_inputs import Inputs

if TYPE_CHECKING:
    from ..robot import Robot

IN_ONE_CALL = 5e9
"""Operations between two checks for a keyboard interrupt: about 0.3 s."""
ALONE = 3
"""Slowdown for batches that leave most vector lanes unused."""
LANES = 16
"""Samples are distributed in multiples of this: whole blocks for every processor."""


def computed(robot: Robot, given: Inputs, results: list[Array]) -> list[Array]:
    """Take all steps; returns the results, with the states written into them."""
    samples = math.prod(given.batch)
    arrays = [x.copy() if any(np.may_share_memory(x, place) for place in results) else x for x in given.arrays]
    states = len(given.plan.state)
    flat = [x.reshape(samples, *x.shape[-2:]) for x in results]  # views: the results are contiguous
    for x, start in zip(flat[:states], arrays, strict=False):
        x[:, 0] = start
    outputs = (*(x[:, 1:] for x in flat[:states]), *flat[states:])
    run_steps(kernel_of(robot, given.plan), arrays, given.ranks, outputs, given.steps)
    return results


def run_steps(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> None:
    """Take the steps of a recurrence, in parts of the batch; the first axis of all outputs is that of the samples."""
    with np.errstate(all="ignore"):  # overflow in unstable steps is detected and reported
        for some, places, count in _slices(kernel, arrays, ranks, outputs, steps):
            batch_threads.share(kernel, _parts(kernel, some, ranks, places, count))


def _slices(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[tuple[Sequence[Array], tuple[Array, ...], int]]:
    """Slices of the steps, between which Ctrl-C is handled; each begins where the previous one ended."""
    owner = owner_of(kernel)
    scan = owner.given if owner is not None else None
    samples, kept = outputs[0].shape[:2]
    if not (owner is not None and isinstance(scan, Scan) and samples and kept) or (
        scan.hidden and len(scan.table) == 1
    ):
        yield arrays, outputs, steps
        return
    most = max(1, int(IN_ONE_CALL / (owner.cost * len(scan.table) * LANES * ALONE)))
    every, states, rest = steps // kept, list(arrays[: scan.visible]), arrays[scan.visible :]
    rows = max(1, most // every)  # stored states in a slice; long intervals between two are divided too
    for row in range(0, kept, rows):
        begin, end = row * every, min(kept, row + rows) * every
        places = tuple(x[:, row : row + rows] for x in outputs)
        portion = end - begin if every <= most else most
        for first in range(begin, end, portion):
            last = min(end, first + portion)
            given = (
                x[(slice(None),) * (x.ndim - rank) + (slice(first, last),)]
                for x, rank in zip(rest, ranks[scan.visible :], strict=True)
            )
            said = places[scan.visible :] if first == begin else tuple(map(np.empty_like, places[scan.visible :]))
            yield (*states, *given), (*places[: scan.visible], *said), last - first
            states = [x[:, -1].copy() for x in places[: scan.visible]]


def _parts(
    kernel: Any, arrays: Sequence[Array], ranks: Sequence[int], outputs: tuple[Array, ...], steps: int
) -> Iterator[Part]:
    """Parts of the batch, one for each thread, short enough to handle Ctrl-C between two."""
    samples, owner = len(outputs[0]), owner_of(kernel)
    rows = max(samples, 1)
    if owner is not None:
        if outputs[0].dtype == np.float32:
            owner.address(SINGLE)  # compiled before the threads start, where exceptions propagate
        stages = len(owner.given.table) if isinstance(owner.given, Scan) else 1
        rows = min(int(IN_ONE_CALL / (owner.cost * stages * steps)), -(-samples // batch_threads.get_threads()))
        rows = max(LANES, rows // LANES * LANES)
    for first in range(0, samples, rows):
        some = slice(first, first + rows)
        inputs = (x if x.ndim == rank else x[some] for x, rank in zip(arrays, ranks, strict=True))
        yield Part(tuple(inputs), tuple(x[some] for x in outputs))


def kernel_of(robot: Robot, plan: StepPlan) -> Any:
    """Compiled steps of a plan, cached with the robot."""

    def build() -> Any:
        robot.engine.require_invertible()
        return compile_form(plan.recurrence(), "rollout", f"Rollouts of {robot.name}, compiled: {plan.method}.")

    return robot.engine.cache(plan.key, build)


def room_for(given: Inputs, out: Any) -> list[Array]:
    """Arrays for the results: new ones or the caller's; raises ShapeError if these do not fit."""
    shapes, dtype = given.shapes, np.dtype(given.dtype)
    if out is not None:
        return _lent(out, shapes, dtype)
    try:
        return list(result_arrays(shapes, dtype))
    except (MemoryError, ValueError):
        size = sum(map(math.prod, shapes)) * dtype.itemsize
        raise ValueRangeError(
            f"the states of this rollout take {printed(size / 1e9, 3)} GB, more than there is. Keep fewer with every=, or "
            "take fewer samples at a time."
        ) from None


def _lent(out: Any, shapes: list[tuple[int, ...]], dtype: Any) -> list[Array]:
    """The caller's arrays, if the results fit."""

    def fits(x: Any, shape: tuple[int, ...]) -> bool:
        flags = type(x) is np.ndarray and x.flags.writeable and x.flags.c_contiguous
        return bool(flags) and x.shape == shape and x.dtype == dtype

    wanted = ", ".join(f"{name} {shape}" for name, shape in zip(("q", "dq", "tau"), shapes, strict=False))
    given = f"of type {type(out).__name__}"
    if isinstance(out, tuple):
        given = ", ".join(f"{getattr(x, 'dtype', type(x).__name__)} {np.shape(x)}" for x in out)
    if not isinstance(out, tuple) or len(out) != len(shapes) or not all(map(fits, out, shapes)):
        raise ShapeError(
            f"out= is {given}. Give a tuple of {dtype.name} arrays in C order that can be written to: {wanted}; "
            "or leave it out."
        )
    if any(np.may_share_memory(x, y) for k, x in enumerate(out) for y in out[:k]):
        raise ShapeError("out= has arrays that share memory.")
    return list(out)


# ── Adjoint program of a step

# With x1 = f(x0, u) a step, τ the torques applied in it, and λ the derivatives of a cost by a state through all later
# ones,
#     (1)  λ0 = l + A' λ1 + C' m,       A = ∂x1/∂x0,  C = ∂τ/∂x0
#     (2)  ∂cost/∂u = B' λ1 + D' m,     B = ∂x1/∂u,   D = ∂τ/∂u
#
# with l and m the cost's own derivatives by x0 and by τ. One reverse-mode sweep through the program of the step
# evaluates both, without forming a matrix. Derivatives by configurations are along robot.add: nv entries, not nq.
#
# Sources: Bryson and Ho, Applied Optimal Control (1975), section 2.2, and Griewank and Walther, Evaluating Derivatives
# (2008), chapter 3.


@dataclass(frozen=True)
class StepAdjoint:
    """Adjoint of the steps of one plan."""

    plan: StepPlan

    @property
    def by(self) -> Ports:
        """Differentiable inputs of each step and the shapes of their derivatives: all except dt and limits."""
        known = {"dt", "torque limits"}
        return [
            (name, (self.plan.model.nv,) if name == "q_des" else shape)
            for name, shape in self.plan.given
            if name not in known
        ]

    @property
    def recurrence(self) -> Scan:
        """Adjoint loop of (1) and (2), from the last step to the first.

        Inputs of each step: q twice (as angles and as coordinates), dq, the inputs of the forward step, l by q and by
        dq, and m if torques are returned.
        """
        nq, nv = self.plan.model.nq, self.plan.model.nv
        states: Ports = [("slope by q", (nv,)), ("slope by dq", (nv,))]
        given: Ports = [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,)), *self.plan.given]
        given += [("cost by q", (nv,)), ("cost by dq", (nv,)), *[("cost by tau", (nv,))] * self.plan.says_torques]
        said = [f"slope by {name}" for name, _ in self.by]
        program = trace(self._on_symbols, [*states, *given], [*(name for name, _ in states), *said])
        return Scan(program, (Source("state", 0), Source("state", 1), *[Source("given")] * len(given)), visible=2)

    def _on_symbols(
        self, by_q1: Array, by_dq1: Array, angles: Array, q: Array, dq: Array, *given: Any
    ) -> tuple[Array, ...]:
        model, count = self.plan.model, len(self.plan.given)
        step, cost = given[:count], given[count:]
        q1, *rest = self.plan.step(angles, q, dq, *step)
        weights = [*(by_q1 @ velocity_map(model, q1)), *by_dq1, *(e for m in cost[2:] for e in m)]
        moved = Chart((model.nv,), {**Chart.from_input(angles, model).known, **Chart.from_input(q, model).known})
        inputs = dict(zip([name for name, _ in self.plan.given], step, strict=True))
        charts = [Chart.from_input(inputs[name], model if name == "q_des" else None) for name, _ in self.by]
        chart = Chart.concatenate([moved, Chart.from_input(dq), *charts])
        owner = dq[0].trace
        results = [owner.lift(e) for part in (q1, *rest) for e in part]
        slopes = autodiff.gradient(results, weights, chart.known, math.prod(chart.shape))
        sizes = [model.nv, model.nv, *(math.prod(shape) for _, shape in self.by)]
        before_q, before_dq, *by = np.split(slopes, np.cumsum(sizes)[:-1])
        return before_q + cost[0], before_dq + cost[1], *by


# ── Gradients through rollouts, by one kernel for all samples

# If every state is stored, one sweep takes all steps. Otherwise the states between two stored ones are recomputed bit
# by bit, from the last interval to the first. This needs memory for one interval, and the time of the steps once more.

DRY = (
    "dry friction has corners: slopes are those of each joint as it was in each step, sliding its way or held, and do not "
    "include when it breaks loose or stops"
)
LIMITED = "a torque at its limit answers to nothing: its slope is 0 there, also by what would bring it back within"


@dataclass(frozen=True, eq=False, repr=False)
class RolloutGradient:
    """Gradient of a cost of the motions of a rollout with respect to all inputs.

    Each part has the shape of its input; derivatives by configurations are along robot.add, with nv entries instead of
    nq. For inputs shared by several samples or steps, such as a payload or a gain, derivatives are summed.
    ``torque_limits`` have no derivative, and derivatives through a torque at its limit are 0.
    """

    q0: Array
    """Derivatives by the initial configurations (..., nv)."""
    dq0: Array
    """Derivatives by the initial velocities (..., nv)."""
    tau: Array | None
    """Derivatives by the torques, (..., steps, nv) if none were given; None for torques from a law."""
    law: Mapping[str, Array] = field(default_factory=dict)
    """Derivatives by the references and gains of a law, by name."""
    wrench_on_robot: Mapping[str, Array] = field(default_factory=dict)
    """Derivatives by the wrenches, (m, f) in their frame, by frame name."""
    parameters: Mapping[str, Array] = field(default_factory=dict)
    """Derivatives by the parameters, by name."""
    remarks: tuple[str, ...] = ()
    """Remarks to read before the derivatives are used; empty if there are none."""

    def __repr__(self) -> str:
        tau = {} if self.tau is None else {"tau": self.tau}
        parts = {"q0": self.q0, "dq0": self.dq0, **tau, **self.law, **self.wrench_on_robot, **self.parameters}
        said = [f"{name} {x.shape}" for name, x in parts.items()] + [f"note: {remark}" for remark in self.remarks]
        return f"<RolloutGradient: {'; '.join(said)}>"


def kept_for_gradients(given: Inputs, out: Any) -> Inputs:
    """Inputs with copies of the caller's arrays; raises an error for inputs without an exact gradient."""
    if out is not None:
        raise ShapeError(
            "gradients=True wants the states as they were, and out= lends arrays that will be written again."
        )
    if given.plan.eases:
        raise ValueRangeError(
            "gradients: method='rk4' eases dry friction off below speeds that are chosen by the robot's inertia at q0, which "
            "no slope would include. Take method='semi_implicit', or leave friction out."
        )
    return replace(given, arrays=[_copied(x) for x in given.arrays])


def _copied(x: Array) -> Array:
    """Copy in which a broadcast axis is reduced to one entry."""
    once = x[tuple(slice(1) if step == 0 else slice(None) for step in x.strides)]
    return np.broadcast_to(once.copy(), x.shape)


def gradient(robot: Robot, given: Inputs, q: Array, dq: Array, slopes: Mapping[str, ArrayLike]) -> RolloutGradient:
    """Gradient of a cost with derivatives ``slopes`` by q, dq and tau of each row."""
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
    q0, dq0 = (_shared(x.reshape(*batch, robot.nv), own[name]) for name, x in (("q0", by_q0), ("dq0", by_dq0)))
    return RolloutGradient(q0, dq0, law.pop("tau", None), law, pushed, parameters, remarks_of(robot, plan))


def linearized(robot: Robot, given: Inputs, q: Array, dq: Array) -> tuple[Array, Array]:
    """A (..., steps, 2 nv, 2 nv) and B (..., steps, 2 nv, nv): rows by the adjoint of each step for unit vectors."""
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


def remarks_of(robot: Robot, plan: StepPlan) -> tuple[str, ...]:
    """Remarks on derivatives at kinks of the motions."""
    laws = (".coulomb", ".static", ".load")
    dry = dry_friction_indices(robot.model) or any(name.endswith(laws) for name in plan.parameters)
    return (*[DRY] * bool(plan.friction and dry), *[LIMITED] * plan.limited)


# ── Backward sweep ──


def _swept(
    robot: Robot, given: Inputs, q: Array, dq: Array, cost: Mapping[str, Array]
) -> tuple[tuple[Array, Array], list[Array]]:
    """λ by q and by dq at the start, (samples, nv) each, and derivatives by all inputs, (samples, steps, …) each."""
    samples, every, steps = len(q), given.steps // given.kept, given.steps
    kernel, by = _kernel(robot, given.plan), StepAdjoint(given.plan).by
    said = list(result_arrays([(samples, steps, *shape) for _, shape in by], np.dtype(given.dtype)))
    now = cost["q"][:, -1], cost["dq"][:, -1]
    pieces = [(0, steps)] if every == 1 else [(k, k + every) for k in range(steps - every, -1, -every)]
    for first, last in pieces:
        inputs = zip(given.arrays[2:], given.ranks[2:], strict=True)  # dt and all inputs of each step
        step = [x[first:last] if rank == 1 else x[..., first:last, :] for x, rank in inputs]
        if every == 1:
            states, costs = (q[:, :-1], dq[:, :-1]), [x[:, :steps] for x in cost.values()]
        else:
            states = _between(robot, given, q[:, first // every], dq[:, first // every], step)
            costs = [np.zeros((samples, every, robot.nv), x.dtype) for x in cost.values()]
            for at_first, x in zip(costs, cost.values(), strict=True):
                at_first[:, 0] = x[:, first // every]
        back = [x[:, ::-1] for x in (states[0], *states, *costs)]
        arrays = [*now, *back[:3], *(x[::-1] if x.ndim == 1 else x[..., ::-1, :] for x in step), *back[3:]]
        ranks = [1, 1, 2, 2, 2, *given.ranks[2:], *[2] * len(costs)]
        rows = result_arrays([(samples, last - first, robot.nv)] * 2, np.dtype(given.dtype))
        run_steps(kernel, arrays, ranks, (*rows, *(x[:, first:last][:, ::-1] for x in said)), last - first)
        now = rows[0][:, -1], rows[1][:, -1]
    return now, said


def _between(robot: Robot, given: Inputs, q: Array, dq: Array, step: list[Array]) -> tuple[Array, Array]:
    """Recomputed states of an interval, without the last."""
    samples, n = len(q), step[0].shape[0]
    sizes = [robot.nq, robot.nv, *[robot.nv] * given.plan.says_torques]
    found = result_arrays([(samples, n, size) for size in sizes], np.dtype(given.dtype))
    run_steps(kernel_of(robot, given.plan), [q, dq, *step], [1, 1, *given.ranks[2:]], found, n)
    shifted = [np.concatenate([x[:, None], y[:, :-1]], axis=1) for x, y in zip((q, dq), found, strict=False)]
    return shifted[0], shifted[1]


def _rows(x: Array) -> Array:
    return x.reshape(-1, *x.shape[-2:])


def _kernel(robot: Robot, plan: StepPlan) -> Any:
    doc = f"Adjoints of the steps of rollouts of {robot.name}, compiled: {plan.method}."
    return robot.engine.cache(
        ("adjoint", *plan.key), lambda: compile_form(StepAdjoint(plan).recurrence, "adjoint", doc)
    )


# ── Shapes ──


def _slopes_of(robot: Robot, given: Inputs, name: str, x: ArrayLike) -> Array:
    """Derivatives of a cost by ``name`` of each row, (samples, rows, nv)."""
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
    """Derivatives summed over the broadcast axes of an input of this shape; the last axis stays as in x."""
    if shape is None:
        return x
    if not shape:
        return np.asarray(x.sum())
    x = x.sum(axis=tuple(range(x.ndim - len(shape))))
    alone = tuple(k for k, size in enumerate(shape[:-1]) if size == 1 != x.shape[k])
    return np.asarray(x.sum(axis=alone, keepdims=True))
