"""Gradients through rollouts: adjoint steps from last to first, by one kernel for all samples.

With x1 = f(x0, u) a step, τ the torques applied in it, and λ the derivatives of a cost by a state, including its effect
on all later states,
    (1)  λ0 = l + A' λ1 + C' m,       A = ∂x1/∂x0,  C = ∂τ/∂x0
    (2)  ∂cost/∂u = B' λ1 + D' m,     B = ∂x1/∂u,   D = ∂τ/∂u

with l and m the cost's own derivatives by x0 and by τ. One reverse-mode sweep through the program of the step
evaluates both, without forming a matrix. Derivatives by configurations are along robot.add: nv entries, not nq.

Sources: Bryson and Ho, Applied Optimal Control (1975), section 2.2, and Griewank and Walther, Evaluating Derivatives
(2008), chapter 3.

If every state is stored, one sweep takes all steps. Otherwise the states between two stored ones are recomputed bit by
bit, from the last interval to the first. This needs memory for one interval, and the time of the steps once more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..compiler.ir import autodiff
from ..compiler.ir.loops import Scan, Source
from ..compiler.ir.tracer import trace
from ..compiler.runtime.result_pool import result_arrays
from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.typing import Array
from ..mechanics.algorithms.friction import dry_friction_indices
from ..mechanics.algorithms.kinematics import velocity_map
from ..robot.differentiate import Chart
from ..robot.engine import compile_form
from .compiled_steps import Ports, StepPlan
from .rollout_inputs import Inputs
from .rollout_steps import kernel_of, run_steps

if TYPE_CHECKING:
    from ..robot import Robot


@dataclass(frozen=True)
class StepAdjoint:
    """Adjoint of the steps of one plan."""

    plan: StepPlan

    @property
    def derivative_ports(self) -> Ports:
        """Differentiable inputs of each step, all except dt and limits, with the shapes of derivatives by them."""
        shapes = dict(self.plan.inputs)
        del shapes["dt"]
        shapes.pop("torque limits", None)
        if "q_des" in shapes:
            shapes["q_des"] = (self.plan.model.nv,)
        return list(shapes.items())

    @property
    def recurrence(self) -> Scan:
        """Adjoint loop of (1) and (2), from the last step to the first.

        Inputs of each step: q twice (as angles and as coordinates), dq, the inputs of the forward step, l by q and by
        dq, and m if torques are returned.
        """
        nq, nv = self.plan.model.nq, self.plan.model.nv
        states: Ports = [("slope by q", (nv,)), ("slope by dq", (nv,))]
        inputs: Ports = [("angles", (nq,)), ("q", (nq,)), ("dq", (nv,)), *self.plan.inputs]
        inputs += [("cost by q", (nv,)), ("cost by dq", (nv,))]
        if self.plan.returns_torques:
            inputs.append(("cost by tau", (nv,)))
        slopes = [f"slope by {name}" for name, _ in self.derivative_ports]
        program = trace(self._adjoint_step, [*states, *inputs], [*dict(states), *slopes])
        given_sources = [Source("given")] * len(inputs)
        sources = (Source("state", 0), Source("state", 1), *given_sources)  # in the order of the program's inputs
        return Scan(program, sources, visible=2)

    def _adjoint_step(
        self, by_q1: Array, by_dq1: Array, angles: Array, q: Array, dq: Array, *inputs_and_costs: Any
    ) -> tuple[Array, ...]:
        """Derivatives λ0 by q (nv,) and by dq (nv,), (1), then derivatives by the inputs of the step, (2).

        ``by_q1`` (nv,) and ``by_dq1`` (nv,) are λ1.
        """
        model = self.plan.model
        input_count = len(self.plan.inputs)
        step_inputs = inputs_and_costs[:input_count]
        cost_by_q, cost_by_dq, *cost_by_tau = inputs_and_costs[input_count:]  # the last is empty without torques
        q1, *others = self.plan.step(angles, q, dq, *step_inputs)
        by_q1_entries = by_q1 @ velocity_map(model, q1)  # (nq,)
        weights = [*by_q1_entries, *by_dq1, *chain.from_iterable(cost_by_tau)]
        known = {**Chart.from_input(angles, model).known, **Chart.from_input(q, model).known}
        q_chart = Chart((model.nv,), known)  # of both forms of q
        inputs = dict(zip(dict(self.plan.inputs), step_inputs, strict=True))
        charts = [q_chart, Chart.from_input(dq)]
        for name, _ in self.derivative_ports:
            model_of_chart = None
            if name == "q_des":  # a configuration
                model_of_chart = model
            charts.append(Chart.from_input(inputs[name], model_of_chart))
        chart = Chart.concatenate(charts)
        tracer = dq[0].trace
        results = [tracer.lift(e) for e in chain(q1, *others)]
        slopes = autodiff.gradient(results, weights, chart.known, math.prod(chart.shape))
        sizes = [model.nv, model.nv, *(math.prod(shape) for _, shape in self.derivative_ports)]
        by_q0, by_dq0, *by_inputs = np.split(slopes, np.cumsum(sizes)[:-1])
        return by_q0 + cost_by_q, by_dq0 + cost_by_dq, *by_inputs


DRY_FRICTION_REMARK = (
    "dry friction has corners: slopes are those of each joint as it was in each step, sliding its way or held, and do not "
    "include when it breaks loose or stops"
)
TORQUE_LIMIT_REMARK = (
    "a torque at its limit answers to nothing: its slope is 0 there, also by what would bring it back within"
)


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
        slopes = {"q0": self.q0, "dq0": self.dq0}
        if self.tau is not None:
            slopes["tau"] = self.tau
        slopes |= {**self.law, **self.wrench_on_robot, **self.parameters}
        parts = [f"{name} {x.shape}" for name, x in slopes.items()]
        parts += [f"note: {remark}" for remark in self.remarks]
        return f"<RolloutGradient: {'; '.join(parts)}>"


def copy_inputs(inputs: Inputs, out: Any) -> Inputs:
    """Inputs with copies of the caller's arrays; raises an error for inputs without an exact gradient."""
    if out is not None:
        raise ShapeError(
            "gradients=True wants the states as they were, and out= lends arrays that will be written again."
        )
    if inputs.plan.eases:
        raise ValueRangeError(
            "gradients: method='rk4' eases dry friction off below speeds that are chosen by the robot's inertia at q0, which "
            "no slope would include. Take method='semi_implicit', or leave friction out."
        )
    return replace(inputs, arrays=[_copy(x) for x in inputs.arrays])


def _copy(x: Array) -> Array:
    """Copy in which a broadcast axis is reduced to one entry."""
    index = tuple(slice(1) if stride == 0 else slice(None) for stride in x.strides)
    return np.broadcast_to(x[index].copy(), x.shape)


def gradient(robot: Robot, inputs: Inputs, q: Array, dq: Array, slopes: Mapping[str, ArrayLike]) -> RolloutGradient:
    """Gradient of a cost; ``slopes`` are its derivatives by q, dq and tau of each stored state, by name."""
    plan = inputs.plan
    shapes = inputs.argument_shapes
    batch = inputs.batch
    cost_slopes = {name: _slopes_of(robot, inputs, name, x) for name, x in slopes.items()}
    by_start, by_inputs = _sweep_backward(robot, inputs, _flatten_batch(q), _flatten_batch(dq), cost_slopes)
    by_q0, by_dq0 = by_start
    by_step = {}  # derivatives (..., steps, …) by the inputs of each step
    for (name, _), x in zip(StepAdjoint(plan).derivative_ports, by_inputs, strict=True):
        by_step[name] = x.reshape(*batch, *x.shape[1:])
    law = {name: _sum_broadcast_axes(by_step[name], shapes[name]) for name in plan.law.names}
    wrenches = {}
    for frame in plan.frames:
        wrenches[frame] = _sum_broadcast_axes(by_step[f"wrench at {frame}"], shapes[f"the wrench at {frame!r}"])
    parameters = {}
    for k, name in enumerate(plan.parameters):
        by_sample = by_step["parameters"][..., k].sum(axis=-1)  # over steps
        batch_shape = shapes[f"parameter {name}"] or ()
        summed = _sum_broadcast_axes(by_sample[..., None], (*batch_shape, 1))
        parameters[name] = summed[..., 0]
    q0 = _sum_broadcast_axes(by_q0.reshape(*batch, robot.nv), shapes["q0"])
    dq0 = _sum_broadcast_axes(by_dq0.reshape(*batch, robot.nv), shapes["dq0"])
    tau = law.pop("tau", None)
    return RolloutGradient(q0, dq0, tau, law, wrenches, parameters, remarks_of(robot, plan))


def linearize_steps(robot: Robot, inputs: Inputs, q: Array, dq: Array) -> tuple[Array, Array]:
    """A (..., steps, 2 nv, 2 nv) and B (..., steps, 2 nv, nv): rows by the adjoint of each step for unit vectors."""
    n = robot.nv
    row_shape = (*inputs.batch, inputs.steps, 2 * n)
    dtype = inputs.dtype
    A = np.empty((*row_shape, 2 * n), dtype)
    B = np.empty((*row_shape, n), dtype)
    unit = np.eye(2 * n, dtype=dtype)
    no_cost = np.zeros((1, n), dtype)
    # q as angles and as coordinates; the new axes are of unit vectors, and of the single step that the kernel takes
    states = [x[..., :-1, None, None, :] for x in (q, q, dq)]
    _, _, dt, *other_inputs = inputs.arrays  # without the initial state
    step_inputs = [dt[:, None, None]]
    for x, rank in zip(other_inputs, inputs.ranks[3:], strict=True):
        if x.ndim != rank:
            x = x.reshape(*inputs.batch, *x.shape[1:])
        step_inputs.append(x[..., :, None, None, :])
    cost_count = 2 + inputs.plan.returns_torques  # by q, by dq, and by tau if torques are returned
    costs = [no_cost] * cost_count
    ports = StepAdjoint(inputs.plan).derivative_ports
    by_inputs = {name: np.empty((*row_shape, 1, *shape), dtype) for name, shape in ports}
    by_inputs["tau"] = B[..., None, :]
    out = (A[..., None, :n], A[..., None, n:], *by_inputs.values())
    with np.errstate(all="ignore"):  # unstable steps overflow
        kernel = _adjoint_kernel(robot, inputs.plan)
        kernel(unit[:, :n], unit[:, n:], *states, *step_inputs, *costs, out=out)
    return A, B


def remarks_of(robot: Robot, plan: StepPlan) -> tuple[str, ...]:
    """Remarks on derivatives at kinks of the motions."""
    dry_friction_endings = (".coulomb", ".static", ".load")
    varies_dry_friction = any(name.endswith(dry_friction_endings) for name in plan.parameters)
    has_dry_friction = dry_friction_indices(robot.model) or varies_dry_friction
    remarks = []
    if plan.friction and has_dry_friction:
        remarks.append(DRY_FRICTION_REMARK)
    if plan.limited:
        remarks.append(TORQUE_LIMIT_REMARK)
    return tuple(remarks)


def _sweep_backward(
    robot: Robot, inputs: Inputs, q: Array, dq: Array, cost_slopes: Mapping[str, Array]
) -> tuple[tuple[Array, Array], list[Array]]:
    """λ by q and by dq at the start, (samples, nv) each, and derivatives by all inputs, (samples, steps, …) each."""
    sample_count = len(q)
    steps = inputs.steps
    steps_per_state = steps // inputs.kept
    dtype = np.dtype(inputs.dtype)
    ports = StepAdjoint(inputs.plan).derivative_ports
    by_inputs = list(result_arrays([(sample_count, steps, *shape) for _, shape in ports], dtype))
    slopes = cost_slopes["q"][:, -1], cost_slopes["dq"][:, -1]
    interval_length = steps if steps_per_state == 1 else steps_per_state
    for first_step in reversed(range(0, steps, interval_length)):
        interval = slice(first_step, first_step + interval_length)
        step_inputs = _inputs_of_steps(inputs, interval)
        if steps_per_state == 1:
            states = q[:, :-1], dq[:, :-1]
            costs = [x[:, :steps] for x in cost_slopes.values()]
        else:
            state_index = first_step // steps_per_state
            states = _recompute_states(robot, inputs, q[:, state_index], dq[:, state_index], step_inputs)
            costs = []  # of the first step of the interval; the other states are not stored
            for x in cost_slopes.values():
                step_costs = np.zeros((sample_count, interval_length, robot.nv), x.dtype)
                step_costs[:, 0] = x[:, state_index]
                costs.append(step_costs)
        interval_q, interval_dq = states
        # inputs of the adjoint kernel and their ranks, its steps in reverse order
        arrays = [*slopes]
        ranks = [1, 1]
        arrays += [x[:, ::-1] for x in (interval_q, interval_q, interval_dq)]  # q as angles and as coordinates
        ranks += [2, 2, 2]
        arrays += [x[::-1] if x.ndim == 1 else x[..., ::-1, :] for x in step_inputs]
        ranks += inputs.ranks[2:]
        arrays += [x[:, ::-1] for x in costs]
        ranks += [2] * len(costs)
        by_q, by_dq = result_arrays([(sample_count, interval_length, robot.nv)] * 2, dtype)
        outputs = [by_q, by_dq]
        outputs += [x[:, interval][:, ::-1] for x in by_inputs]
        run_steps(_adjoint_kernel(robot, inputs.plan), arrays, ranks, tuple(outputs), interval_length)
        slopes = by_q[:, -1], by_dq[:, -1]  # at the beginning of the interval
    return slopes, by_inputs


def _inputs_of_steps(inputs: Inputs, steps: slice) -> list[Array]:
    """dt and all other inputs of some steps."""
    step_inputs = []
    for x, rank in zip(inputs.arrays[2:], inputs.ranks[2:], strict=True):
        step_inputs.append(x[steps] if rank == 1 else x[..., steps, :])
    return step_inputs


def _recompute_states(
    robot: Robot, inputs: Inputs, q: Array, dq: Array, step_inputs: list[Array]
) -> tuple[Array, Array]:
    """q (samples, n, nq) and dq (samples, n, nv) before each of the n steps of an interval, recomputed from its start."""
    n = len(step_inputs[0])
    sizes = [robot.nq, robot.nv]
    if inputs.plan.returns_torques:
        sizes.append(robot.nv)
    results = result_arrays([(len(q), n, size) for size in sizes], np.dtype(inputs.dtype))
    run_steps(kernel_of(robot, inputs.plan), [q, dq, *step_inputs], [1, 1, *inputs.ranks[2:]], results, n)
    q_after, dq_after, *_ = results  # of each step, then its torques if requested
    q_before = np.concatenate([q[:, None], q_after[:, :-1]], axis=1)
    dq_before = np.concatenate([dq[:, None], dq_after[:, :-1]], axis=1)
    return q_before, dq_before


def _flatten_batch(x: Array) -> Array:
    """Array (..., n, k) with one batch axis, (samples, n, k)."""
    return x.reshape(-1, *x.shape[-2:])


def _adjoint_kernel(robot: Robot, plan: StepPlan) -> Any:
    """Kernel of the adjoint loop, compiled once per robot and plan."""
    doc = f"Adjoints of the steps of rollouts of {robot.name}, compiled: {plan.method}."
    return robot.engine.cache(
        ("adjoint", *plan.key), lambda: compile_form(StepAdjoint(plan).recurrence, "adjoint", doc)
    )


def _slopes_of(robot: Robot, inputs: Inputs, name: str, x: ArrayLike) -> Array:
    """Derivatives of a cost by q, dq or tau, (samples, rows, nv): a row for each stored state, for tau without the last."""
    row_count = inputs.kept if name == "tau" else inputs.kept + 1
    what = f"gradient: the slope by {name}"
    slope = arguments.real(x, what, names=robot.model.velocity_names)
    shape = (*inputs.batch, row_count, robot.nv)
    try:
        slopes = np.broadcast_to(slope, shape)
    except ValueError:
        hint = " Configurations are moved along robot.add, by nv numbers." if name == "q" else ""
        raise ShapeError(
            f"{what} has shape {slope.shape}, expected {shape}: a number for each row and velocity.{hint}"
        ) from None
    return _flatten_batch(slopes.astype(inputs.dtype))


def _sum_broadcast_axes(x: Array, shape: tuple[int, ...] | None) -> Array:
    """Derivatives x summed over the broadcast axes of an input; the last axis stays.

    ``shape`` is the shape of the input; None for an input that is not given, whose derivatives are not summed.
    """
    if shape is None:
        return x
    if not shape:
        return np.asarray(x.sum())
    missing_axes = tuple(range(x.ndim - len(shape)))
    x = x.sum(axis=missing_axes)
    broadcast_axes = tuple(k for k, size in enumerate(shape[:-1]) if size == 1 and x.shape[k] != 1)
    return np.asarray(x.sum(axis=broadcast_axes, keepdims=True))
