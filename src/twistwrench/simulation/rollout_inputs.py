"""Inputs of a rollout: states, torques or a law, limits, wrenches and parameters, validated and shaped."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import arguments
from ..core.arguments import positive, whole
from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.model.couplings import refuse_couplings
from ..mechanics.model.limits import NONE_GIVEN
from ..mechanics.model.parameters import matching, nominal, refuse_impossible
from ..robot.arguments import wrench_at
from .compiled_steps import StepPlan
from .forces import creep_of_samples, easing_remark
from .torque_laws import GivenTorque, TorqueLaw

if TYPE_CHECKING:
    from ..robot import Robot


def torque_limits_of(robot: Robot, torque_limits: Any) -> list[tuple[str, Array, int]]:
    """Torque limits as a list of one input, (label, array, length of the last axis); empty without limits."""
    if torque_limits is None or torque_limits is False:
        return []
    refuse_couplings(robot.model, "torque_limits")
    if torque_limits is True:
        limits = robot.limits.effort
    else:
        limits = _real_array(torque_limits, "torque_limits", robot.model.velocity_names)
    if limits.ndim and limits.shape[-1] != robot.nv:
        raise ShapeError(
            f"torque_limits has shape {limits.shape}, but robot {robot.name!r} wants {robot.nv} in the last axis, one number "
            "for all, or True for its own."
        )
    invalid_limits = limits[~(limits >= 0)]  # NaN among them
    if invalid_limits.size:
        raise ValueRangeError(
            f"torque_limits has {printed(invalid_limits.flat[0])}, and limits are at least 0; inf is none."
        )
    return [("torque_limits", limits, robot.nv)]


def law_of(tau: Any) -> TorqueLaw:
    """Law of the torques: ``tau`` itself if it is a law, and a law for an array of torques."""
    if isinstance(tau, type):
        raise ValueRangeError(f"tau is the class {tau.__name__}, not a law: call it, with a reference and gains.")
    if hasattr(tau, "torques") and hasattr(tau, "names"):
        return tau
    if callable(tau):
        raise ValueRangeError(
            "tau is a function, and the loop over the steps is machine code, which calls none. Give torques as an array, "
            "tw.control.PD, tw.control.ComputedTorque, or their batches in tw.simulation; robot.simulate takes functions."
        )
    return GivenTorque(tau)


def _real_array(x: Any, label: str, names: Sequence[str] = ()) -> Array:
    """Real numbers, float32 or float64, of any shape; ``names`` are the columns to take from a table."""
    array = arguments.array(x, label, names=names)
    if array.dtype == object:
        raise ValueRangeError(f"{label} is of symbols, and a rollout is of numbers.")
    return array


def state_of(robot: Robot, name: str, values: Any, size: int) -> Array:
    """Validated q0 or dq0, by its name: ``size`` entries in the last axis, and no quaternion of zeros."""
    names = robot.coordinate_names if name == "q0" else robot.model.velocity_names
    x = _real_array(values, name, names)
    if x.shape[-1:] != (size,):
        raise ShapeError(f"{name} has shape {x.shape}, but robot {robot.name!r} wants {size} in the last axis.")
    if name == "q0":
        for body in robot.model.leaders:
            q_indices, _ = body.places
            if not body.joint.is_configuration(x[..., q_indices]):
                raise ValueRangeError(
                    f"q0 has a quaternion of zeros at joint {body.joint.name!r}, not a rotation; the identity is (1, 0, 0, 0)."
                )
    return x


def law_inputs(robot: Robot, law: TorqueLaw) -> list[tuple[str, Array, int]]:
    """Inputs of a law, (name, array, length of the last axis)."""
    inputs = []
    for name in law.names:
        names = robot.coordinate_names if name == "q_des" else robot.model.velocity_names
        size = len(names)
        values = getattr(law, name)
        is_torque_left_out = values is None and isinstance(law, GivenTorque)
        if is_torque_left_out:
            values = 0.0
        x = _real_array(values, name, names)
        may_be_number = is_torque_left_out or name not in ("tau", "q_des")
        is_number_for_all = may_be_number and x.ndim == 0
        if x.shape[-1:] != (size,) and not is_number_for_all:
            alternative = ", or one number for all" if may_be_number else ""
            raise ShapeError(
                f"{name} has shape {x.shape}, but robot {robot.name!r} wants {size} in the last axis{alternative}."
            )
        inputs.append((name, x, size))
    return inputs


def parameter_values(robot: Robot, parameters: Any) -> tuple[tuple[str, ...], list[Array]]:
    """Names of the parameters that vary by sample, and their numbers, one array for each."""
    if parameters is None:
        return (), []
    if not isinstance(parameters, Mapping):
        raise ShapeError(
            f"parameters is a dict {{name: numbers}}, got {parameters!r}; robot.varying() lists the names."
        )
    known_parameters = nominal(robot.model)
    for name in parameters:
        if name not in known_parameters:
            matching(robot.model, (str(name),))  # its error lists the valid names
            raise ValueRangeError(
                f"parameters: {name!r} is a pattern. Name each: {', '.join(robot.varying(str(name)))}."
            )
    values = {name: _real_array(x, f"parameter {name!r}") for name, x in parameters.items()}
    refuse_impossible(robot.model, values)
    return tuple(values), list(values.values())


ROLLOUT_METHODS = ("semi_implicit", "rk4")
"""Methods of rollouts, by their names in simulations."""
MAX_STEPS = 10**9
"""Largest number of steps of a rollout."""
LAWS_OF_FRICTION = (".viscous", ".coulomb", ".static", ".load")
"""Endings of the names of friction parameters."""


@dataclass(frozen=True)
class Inputs:
    """Arguments of a kernel call."""

    plan: StepPlan
    """Step of the rollout."""
    arrays: list[Array]
    """States, dt, and the other inputs of each step, with an axis of steps; the batch has one axis or none."""
    ranks: list[int]
    """Number of axes of each array that do not belong to the batch."""
    batch: tuple[int, ...]
    """Shape of the batch."""
    dtype: Any
    """Type of the arrays and of the results, float32 or float64."""
    steps: int
    """Number of steps."""
    dt: float
    """Length of a step [s]."""
    kept: int
    """Number of kept states: those stored after the first."""
    remarks: tuple[str, ...] = ()
    """Remarks on the motions before any is computed."""
    argument_shapes: Mapping[str, tuple[int, ...] | None] = field(default_factory=dict)
    """Shapes of the caller's arguments, by name; None for torques that are not given."""

    @property
    def times(self) -> Array:
        """Times of the stored states, (kept + 1,) s."""
        steps_per_state = self.steps // self.kept
        return np.arange(self.kept + 1) * (self.dt * steps_per_state)

    @property
    def shapes(self) -> list[tuple[int, ...]]:
        """Shapes of the results: q, dq, the other parts of the state, and the torques if requested."""
        shapes: list[tuple[int, ...]] = [(*self.batch, self.kept + 1, *shape) for _, shape in self.plan.state]
        if self.plan.returns_torques:
            shapes.append((*self.batch, self.kept, self.plan.model.nv))
        return shapes


def validate_inputs(
    robot: Robot, q0: Any, dq0: Any, tau: Any, *, dt: Any, steps: Any, duration: Any, every: Any, method: Any,
    wrench_on_robot: Any, parameters: Any, friction: Any, torque_limits: Any, torques: Any,
    step_of: Callable[[StepPlan], StepPlan] = lambda plan: plan,
) -> Inputs:  # fmt: skip
    """Validated inputs of a rollout; raises ShapeError, ValueRangeError and UnknownNameError.

    ``step_of`` returns the plan to use in place of the plan of a step.
    """
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to roll out: robot {robot.name!r} has no joint that moves.")
    if hasattr(tau, "batch_law") and not isinstance(tau, type):  # a controller of one motion
        n, h, _ = _count_steps(dt, steps, duration, every=1, inputs=[])
        tau = tau.batch_law(robot, h * np.arange(n))
    law = law_of(tau)
    law.check(robot.model)
    if isinstance(torque_limits, np.bool_):
        torque_limits = bool(torque_limits)
    friction = arguments.flag(friction, "friction")
    limits = torque_limits_of(robot, torque_limits)
    wrench_by_frame = _wrenches_by_frame(robot, wrench_on_robot)
    names, values = parameter_values(robot, parameters)
    has_friction = friction and _has_friction(robot, names)
    if has_friction and method == "semi_implicit":
        refuse_couplings(robot.model, f"friction by method {method!r}")
    returns_torques = arguments.flag(torques, "torques")
    if not isinstance(method, str) or method not in ROLLOUT_METHODS:
        raise UnknownNameError.from_choices("method", method, ROLLOUT_METHODS)
    plan = step_of(
        StepPlan(robot.model, law, method, bool(limits), tuple(wrench_by_frame), names, has_friction, returns_torques)
    )
    inputs = [*law_inputs(robot, law), *limits]  # label, array, length of the last axis
    inputs += [(f"the wrench at {frame!r}", F, 6) for frame, F in wrench_by_frame.items()]
    q = state_of(robot, "q0", q0, robot.nq)
    dq = state_of(robot, "dq0", dq0, robot.nv)
    states = [q, dq]
    n, h, kept_count = _count_steps(dt, steps, duration, every, inputs)
    arrays_by_step = {label: _with_step_axis(label, x, size, n) for label, x, size in inputs}
    parameter_by_name = dict(zip(names, values, strict=True))
    batch = _batch_shape(states, arrays_by_step, parameter_by_name)
    step_inputs = list(arrays_by_step.values())
    remarks: tuple[str, ...] = (NONE_GIVEN,) if friction and not plan.friction else ()
    if plan.eases:
        creep = creep_of_samples(robot, q, h, parameter_by_name)
        step_inputs.append(creep[..., None, :])
        remark = easing_remark(robot.model, creep) if creep.size else None
        if remark:
            remarks = (remark,)
    if names:
        step_inputs.append(np.stack(np.broadcast_arrays(*values), axis=-1)[..., None, :])
    # The robot's own torque limits are float64 and do not decide the type of the results.
    typed_inputs = [x for label, x, _ in inputs if label != "torque_limits" or torque_limits is not True]
    dtype = _common_dtype([*states, *typed_inputs, *values])
    arrays = [_with_batch_axis(x.astype(dtype, copy=False), 1, batch) for x in states]
    arrays.append(np.broadcast_to(np.asarray(h, dtype), n))
    arrays += [_with_all_steps(_with_batch_axis(x.astype(dtype, copy=False), 2, batch), n) for x in step_inputs]
    shapes: dict[str, tuple[int, ...] | None] = {"q0": q.shape, "dq0": dq.shape}
    shapes |= {label: x.shape for label, x, _ in inputs}
    shapes |= {f"parameter {name}": x.shape for name, x in parameter_by_name.items()}
    if isinstance(law, GivenTorque) and law.tau is None:
        shapes["tau"] = None
    ranks = [1, 1, 1, *[2] * len(step_inputs)]  # of q0, dq0 and dt, then of the other inputs
    return Inputs(plan, arrays, ranks, batch, dtype, n, h, kept_count, remarks, shapes)


def _wrenches_by_frame(robot: Robot, wrench_on_robot: Any) -> dict[str, Array]:
    """Wrenches on the robot (..., 6) by frame; none for None. Raises ShapeError without frames."""
    if wrench_on_robot is None:
        return {}
    if not isinstance(wrench_on_robot, Mapping):
        raise ShapeError("wrench_on_robot is a dict {frame: (m, f)}, since a wrench needs its frame.")
    return {frame: wrench_at(robot.model, frame, F) for frame, F in wrench_on_robot.items()}


def _has_friction(robot: Robot, parameters: Sequence[str]) -> bool:
    """True if a robot has joint friction, or if one of the varying ``parameters`` is a friction parameter."""
    return bool(robot.model.friction.any) or any(name.endswith(LAWS_OF_FRICTION) for name in parameters)


def _with_all_steps(x: Array, n: int) -> Array:
    """Array with n entries along its axis of steps, the last but one; a single entry is repeated."""
    if x.shape[-2] == n:
        return x
    return np.broadcast_to(x, (*x.shape[:-2], n, x.shape[-1]))


def _batch_shape(
    states: list[Array], arrays_by_step: dict[str, Array], parameter_by_name: dict[str, Array]
) -> tuple[int, ...]:
    """Shape of the batch of all inputs; raises ShapeError if they do not broadcast."""
    q0, dq0 = states
    shapes = [("q0", q0.shape[:-1]), ("dq0", dq0.shape[:-1])]
    shapes += [(label, x.shape[:-2]) for label, x in arrays_by_step.items()]
    shapes += [(name, x.shape) for name, x in parameter_by_name.items()]
    try:
        return np.broadcast_shapes(*(shape for _, shape in shapes))
    except ValueError:
        listed = ", ".join(f"{label} {shape}" for label, shape in shapes)
        raise ShapeError(f"the batch shapes do not broadcast: {listed}.") from None


def _common_dtype(arrays: list[Array]) -> Any:
    """float32 if all arrays are of that type; single numbers do not count."""
    if all(x.dtype == np.float32 or x.ndim == 0 for x in arrays):
        return np.float32
    return np.float64


def _with_batch_axis(x: Array, rank: int, batch: tuple[int, ...]) -> Array:
    """Array with one axis for the whole batch before its last ``rank`` axes, or none if it is constant over the batch."""
    batch_axes = x.ndim - rank
    own_batch, core = x.shape[:batch_axes], x.shape[batch_axes:]
    if math.prod(own_batch) == 1:
        return x.reshape(core)
    try:
        return np.broadcast_to(x, (*batch, *core)).reshape(math.prod(batch), *core)
    except (MemoryError, ValueError):
        bytes_needed = math.prod((*batch, *core)) * x.itemsize
        raise ValueRangeError(
            f"an input of shape {x.shape} for each of a batch {batch} takes {printed(bytes_needed / 1e9, 3)} GB, more than "
            "there is. Take fewer samples at a time."
        ) from None


def _count_steps(
    dt: Any, steps: Any, duration: Any, every: Any, inputs: list[tuple[str, Array, int]]
) -> tuple[int, float, int]:
    """Number of steps, their length [s], and the number of states stored after the first."""
    h = positive(dt, "dt", "s")
    interval = whole(every, "every")
    if steps is not None and duration is not None:
        raise ValueRangeError("both steps and duration are given: leave one out.")
    if steps is not None:
        n = whole(steps, "steps")
    elif duration is not None:
        duration = positive(duration, "duration", "s")
        if not duration / h < MAX_STEPS:
            raise ValueRangeError(
                f"a duration of {printed(duration)} s with a dt of {printed(h)} s makes more than {printed(MAX_STEPS, 1)} "
                "steps."
            )
        n = max(1, math.ceil(duration / h * (1.0 - 1e-12)))  # no further step for a rounding error
        h = duration / n
    else:
        step_counts = [x.shape[-2] for _, x, _ in inputs if x.ndim > 1 and x.shape[-2] != 1]
        n = step_counts[0] if step_counts else 0
        if n == 0:
            raise ValueRangeError("how long? Give steps, duration, or torques with axes (..., steps, nv).")
    if n > MAX_STEPS:
        raise ValueRangeError(f"steps is {printed(n, 3)}, and more than {printed(MAX_STEPS, 1)} are refused.")
    if n % interval:
        raise ValueRangeError(
            f"every={interval} does not divide {n} steps: the last state would not be among those kept."
        )
    return n, h, n // interval


def _with_step_axis(label: str, x: Array, size: int, n: int) -> Array:
    """Array with an axis of steps, of length n or 1, before the last axis, of length ``size``."""
    if x.ndim == 0:
        return np.full((1, size), x)
    if x.ndim == 1:
        return x[None]
    if x.shape[-2] not in (1, n):
        raise ShapeError(
            f"{label} has shape {x.shape}, and the axis before the last counts the steps: {n} of them, or 1 for what stays. "
            f"What differs from sample to sample but not in time has shape (..., 1, {size}): {label}[..., None, :]."
        )
    return x
