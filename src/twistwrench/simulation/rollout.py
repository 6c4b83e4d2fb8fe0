"""Rollouts: many motions at once, all their steps in one kernel, samples side by side in its lanes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ShapeError, ValueRangeError
from ..kernels import threads
from ..kernels.parts import Part
from ..kernels.ufunc import owner_of
from ..lie import checks
from ..model.varied import matching, nominal
from ..screws.wrench import Wrench
from ..targets.machine import SINGLE
from .given import positive, whole
from .step_program import Plan, integrator_named
from .torque_laws import GivenTorque, TorqueLaw

if TYPE_CHECKING:
    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["Rollout", "rollout"]

FASTEST = 1e6
"""rad/s or m/s: what no robot reaches, and steps that are too long soon do."""
CREEP = 1e-3
"""rad/s or m/s, the least speed below which dry friction is eased off."""
MOST_STEPS = 10**9
IN_ONE_CALL = 5e9
"""Operations between two looks at whether the user wants to stop: some 0.3 s."""
LANES = 16
"""Samples are shared out in multiples of this: whole blocks on every processor."""


@dataclass(frozen=True, eq=False, repr=False)
class Rollout:
    """Motions of any batch shape, n states each, the first at time 0. Printing it says whether all are stable."""

    robot: str
    """The robot's name."""
    coordinate_names: tuple[str, ...]
    """Of the entries of q."""
    velocity_names: tuple[str, ...]
    """Of the entries of dq and tau."""
    times: Array
    """(n,) s."""
    q: Array
    """(..., n, nq)."""
    dq: Array
    """(..., n, nv)."""
    tau: Array | None
    """(..., n - 1, nv), the torques of the step that begins at each time but the last; None unless asked for."""
    dt: float
    """s, of one step."""
    steps: int
    integrator: str

    @property
    def batch(self) -> tuple[int, ...]:
        """The shape of the batch."""
        return self.q.shape[:-2]

    @cached_property
    def unstable(self) -> Array:
        """Which motions end in numbers that mean nothing, (...) bool: not finite, or faster than 1e6 rad/s or m/s."""
        return _meaningless(self.q[..., -1, :], self.dq[..., -1, :])

    @cached_property
    def unstable_from(self) -> Array:
        """When each of them is first seen to be unstable, (...) s; inf for those that are not."""
        found = np.full(self.batch, np.inf)
        for sample in map(tuple, np.argwhere(self.unstable)):
            found[sample] = self.times[np.argmax(_meaningless(self.q[sample], self.dq[sample]))]
        return found

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        many = f"{math.prod(self.batch)} motions" if self.batch else "a motion"
        said = [f"{many} of {self.steps} steps of {self.dt:g} s, {len(self)} states each"]
        bad = int(np.count_nonzero(self.unstable))
        if bad:
            first = np.unravel_index(np.argmin(self.unstable_from), self.batch)
            where = f", first {tuple(map(int, first))}" if self.batch else ""
            said.append(f"{bad} unstable{where} at {self.unstable_from[first]:g} s: take a smaller dt")
        return f"<Rollout of {self.robot!r}, {self.integrator}: {'; '.join(said)}>"


def rollout(
    robot: Robot,
    q0: ArrayLike,
    dq0: ArrayLike,
    tau: ArrayLike | TorqueLaw | None = None,
    *,
    dt: float = 1e-3,
    steps: int | None = None,
    duration: float | None = None,
    every: int = 1,
    integrator: str = "semi_implicit",
    wrench_on_robot: Mapping[str, ArrayLike | Wrench] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    friction: bool = False,
    torques: bool = False,
    out: tuple[Array, ...] | None = None,
) -> Rollout:
    """Motions from q0 (..., nq) and dq0 (..., nv); see :meth:`twistwrench.Robot.rollout`."""
    if robot.nv == 0:
        raise ValueRangeError(f"nothing to roll out: robot {robot.name!r} has no joint that moves.")
    law = _law(tau)
    law.check(robot.model)
    frames = _frames(robot, wrench_on_robot)
    names, values = _parameters(robot, parameters)
    plan = Plan(
        robot.model, law, integrator_named(integrator), tuple(frames), names, bool(friction), bool(torques)
    )
    given = _of_law(robot, law)
    given += [(f"the wrench at {frame!r}", F, 6) for frame, F in frames.items()]
    states = [_state(robot, "q0", q0, robot.nq), _state(robot, "dq0", dq0, robot.nv)]
    single = all(_is_single(x) for x in (*states, *(x for _, x, _ in given), *values))
    dtype: Any = np.float32 if single else np.float64
    n, h, kept = _steps(dt, steps, duration, every, given)
    stepped = [(label, _stepped(label, x, size, n)) for label, x, size in given]
    batches = [("q0", states[0].shape[:-1]), ("dq0", states[1].shape[:-1])]
    batches += [(label, x.shape[:-2]) for label, x in stepped]
    batches += [(name, x.shape) for name, x in zip(names, values, strict=True)]
    batch = _together(batches)
    rest = [x.astype(dtype, copy=False) for _, x in stepped]
    if friction:
        rest.append(_creep(robot, states[0], h)[..., None, :].astype(dtype))
    if names:
        rest.append(np.stack(np.broadcast_arrays(*values), axis=-1)[..., None, :].astype(dtype))
    inputs = [*(x.astype(dtype, copy=False) for x in states), np.full(1, h, dtype), *rest]
    inputs = [*inputs[:2], np.broadcast_to(inputs[2], (n,)), *(_all_steps(x, n) for x in inputs[3:])]
    shapes = [(*batch, kept + 1, robot.nq), (*batch, kept + 1, robot.nv), *[(*batch, kept, robot.nv)] * torques]
    q, dq, *said = _room(shapes, dtype) if out is None else _lent(out, shapes, dtype)
    if out is not None:
        inputs = [x.copy() if any(np.may_share_memory(x, place) for place in out) else x for x in inputs]
    q[..., 0, :], dq[..., 0, :] = inputs[0], inputs[1]
    outputs = [q[..., 1:, :], dq[..., 1:, :], *said]
    _run(_kernel(robot, plan), inputs, [1, 1, 1, *[2] * len(rest)], outputs, batch, n)
    return Rollout(
        robot.name,
        robot.coordinate_names,
        robot.model.velocity_names,
        np.arange(kept + 1) * (h * every),
        q,
        dq,
        said[0] if said else None,
        h,
        n,
        plan.integrator,
    )


def _meaningless(q: Array, dq: Array) -> Array:
    with np.errstate(invalid="ignore"):
        return np.asarray(~(np.isfinite(q).all(axis=-1) & (np.abs(dq) < FASTEST).all(axis=-1)))


# ── the door ──


def _law(tau: Any) -> TorqueLaw:
    if hasattr(tau, "torques") and hasattr(tau, "names"):
        return tau
    if callable(tau):
        raise ValueRangeError(
            "tau is a function, and the loop over the steps is machine code, which calls none. Give torques as an array, "
            "tw.simulation.PD or tw.simulation.ComputedTorque; robot.simulate takes functions."
        )
    return GivenTorque(tau)


def _real(x: Any, what: str) -> Array:
    """Real numbers, float32 or float64, of any shape."""
    array = checks.array(x, what)
    if array.dtype == object:
        raise ValueRangeError(f"{what} is of symbols, and a rollout is of numbers.")
    return array


def _is_single(x: Array) -> bool:
    """Whether an array leaves the result in float32; single numbers do."""
    return x.dtype == np.float32 or x.ndim == 0


def _state(robot: Robot, what: str, given: Any, size: int) -> Array:
    x = _real(given, what)
    if x.shape[-1:] != (size,):
        raise ShapeError(f"{what} has shape {x.shape}, but robot {robot.name!r} wants {size} in the last axis.")
    if what == "q0":
        for body in robot.model.leaders:
            part = x[..., body.q_index : body.q_index + 4]
            if body.joint.kind == "floating" and not np.any(part, axis=-1).all():
                raise ValueRangeError(
                    f"q0 has a quaternion of zeros at joint {body.joint.name!r}, which is no rotation; none is (1, 0, 0, 0)."
                )
    return x


def _of_law(robot: Robot, law: TorqueLaw) -> list[tuple[str, Array, int]]:
    """What a law is given, by name, with the length of the last axis."""
    found = []
    for name in law.names:
        size = robot.nq if name == "q_des" else robot.nv
        given = getattr(law, name)
        x = _real(0.0 if given is None else given, name)
        one_for_all = given is None or name not in ("tau", "q_des")
        if x.shape[-1:] != (size,) and not (one_for_all and x.ndim == 0):
            more = ", or one number for all" if one_for_all else ""
            raise ShapeError(f"{name} has shape {x.shape}, but robot {robot.name!r} wants {size} in the last axis{more}.")
        found.append((name, x, size))
    return found


def _frames(robot: Robot, wrenches: Any) -> dict[str, Array]:
    if wrenches is None:
        return {}
    if not isinstance(wrenches, Mapping):
        raise ShapeError("wrench_on_robot is a dict {frame: (m, f)}, for the frame is part of what a wrench says.")
    return {frame: robot._wrench(frame, F) for frame, F in wrenches.items()}


def _parameters(robot: Robot, given: Any) -> tuple[tuple[str, ...], list[Array]]:
    if given is None:
        return (), []
    if not isinstance(given, Mapping):
        raise ShapeError(f"parameters is a dict {{name: numbers}}, got {given!r}; robot.varying() lists the names.")
    known = nominal(robot.model)
    for name in given:
        if name not in known:
            matching(robot.model, (str(name),))  # says which there are
            raise ValueRangeError(f"parameters: {name!r} is a pattern. Name each: {', '.join(robot.varying(str(name)))}.")
    return tuple(given), [_real(x, f"parameter {name!r}") for name, x in given.items()]


def _steps(
    dt: Any, steps: Any, duration: Any, every: Any, given: list[tuple[str, Array, int]]
) -> tuple[int, float, int]:
    """How many steps, how long each, and how many states are kept after the first."""
    h, each = positive(dt, "dt", "s"), whole(every, "every")
    if steps is not None and duration is not None:
        raise ValueRangeError("both steps and duration are given: leave one out.")
    if steps is not None:
        n = whole(steps, "steps")
    elif duration is not None:
        length = positive(duration, "duration", "s")
        if not length / h < MOST_STEPS:
            raise ValueRangeError(f"a duration of {length:g} s with a dt of {h:g} s makes more than {MOST_STEPS:.0e} steps.")
        n = max(1, math.ceil(length / h * (1.0 - 1e-12)))
        h = length / n
    else:
        axes = [x.shape[-2] for _, x, _ in given if x.ndim > 1 and x.shape[-2] != 1]
        if not axes or not axes[0]:
            raise ValueRangeError("how long? Give steps, duration, or torques with axes (..., steps, nv).")
        n = axes[0]
    if n > MOST_STEPS:
        raise ValueRangeError(f"steps is {n:.3g}, and more than {MOST_STEPS:.0e} are refused.")
    if n % each:
        raise ValueRangeError(f"every={each} does not divide {n} steps: the last state would not be among those kept.")
    return n, h, n // each


def _stepped(label: str, x: Array, size: int, n: int) -> Array:
    """With an axis of steps before the last, of length n or 1."""
    if x.ndim < 2:
        return np.broadcast_to(x, (1, size))
    if x.shape[-2] not in (1, n):
        raise ShapeError(
            f"{label} has shape {x.shape}, and the axis before the last counts the steps: {n} of them, or 1 for what stays. "
            f"What differs from sample to sample but not in time has shape (..., 1, {size}): {label}[..., None, :]."
        )
    return x


def _all_steps(x: Array, n: int) -> Array:
    return np.broadcast_to(x, (*x.shape[:-2], n, x.shape[-1]))


def _together(batches: list[tuple[str, tuple[int, ...]]]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*(shape for _, shape in batches))
    except ValueError:
        listed = ", ".join(f"{label} {shape}" for label, shape in batches)
        raise ShapeError(f"the batch shapes do not broadcast: {listed}.") from None


def _creep(robot: Robot, q0: Array, h: float) -> Array:
    """The speeds below which dry friction is eased off, (..., nv): no less than what it takes off a joint in a step."""
    friction = robot.model.friction
    light = np.diagonal(np.linalg.inv(robot.mass_matrix(np.asarray(q0, float))), axis1=-2, axis2=-1)
    return np.asarray(np.maximum(CREEP, h * np.maximum(friction.static, friction.coulomb) * light))


# ── the kernel ──


def _kernel(robot: Robot, plan: Plan) -> Any:
    found = robot._kernels.get(plan.key)
    if found is None:
        from ..robot import _make_kernel

        robot._require_invertible()
        doc = f"Rollouts of {robot.name}, compiled: {plan.integrator}."
        found = robot._kernels[plan.key] = _make_kernel(plan.recurrence(), "rollout", doc)
    return found


def _room(shapes: list[tuple[int, ...]], dtype: Any) -> list[Array]:
    try:
        return [np.empty(shape, dtype) for shape in shapes]
    except (MemoryError, ValueError):
        size = sum(map(math.prod, shapes)) * np.dtype(dtype).itemsize
        raise ValueRangeError(
            f"the states of this rollout take {size / 1e9:.3g} GB, more than there is. Keep fewer with every=, or take fewer "
            "samples at a time."
        ) from None


def _lent(out: Any, shapes: list[tuple[int, ...]], dtype: Any) -> list[Array]:
    """The caller's arrays, if the results fit in."""
    wanted = ", ".join(f"{name} {shape}" for name, shape in zip(("q", "dq", "tau"), shapes, strict=False))
    fit = (
        isinstance(out, tuple)
        and len(out) == len(shapes)
        and all(
            type(x) is np.ndarray and x.shape == shape and x.dtype == dtype and x.flags.writeable
            for x, shape in zip(out, shapes, strict=True)
        )
    )
    if not fit:
        given = ", ".join(f"{getattr(x, 'dtype', type(x).__name__)} {np.shape(x)}" for x in out) if isinstance(out, tuple) else out
        raise ShapeError(
            f"out= is {given}. Give a tuple of {np.dtype(dtype).name} arrays that can be written to: {wanted}; or leave it out."
        )
    if any(np.may_share_memory(x, y) for k, x in enumerate(out) for y in out[:k]):
        raise ShapeError("out= has arrays that share memory.")
    return list(out)


def _run(
    kernel: Any, inputs: list[Array], core: list[int], outputs: list[Array], batch: tuple[int, ...], steps: int
) -> None:
    """Call the kernel in parts of the batch: for as many threads as there are, and so that Ctrl-C is heard between two."""
    owner, many = owner_of(kernel), batch.index(max(batch)) if batch else 0
    if not math.prod(batch):
        return
    rows = batch[many] if batch else 1
    if owner is not None:
        if outputs[0].dtype == np.float32:
            owner.address(SINGLE)  # compiled before it is shared out, and here, where an exception can leave
        stages = len(owner.given.table) if hasattr(owner.given, "table") else 1
        work = owner.effort * stages * steps * math.prod(batch) / rows
        rows = min(int(IN_ONE_CALL / work), -(-rows // threads.get_threads()))
        rows = max(LANES, rows // LANES * LANES)
    parts = [
        Part(
            tuple(_cut(x, x.ndim - c - len(batch) + many, here) for x, c in zip(inputs, core, strict=True)),
            tuple(_cut(x, many, here) for x in outputs),
        )
        for here in (slice(first, first + rows) for first in range(0, batch[many] if batch else 1, rows))
    ]
    with np.errstate(all="ignore"):  # what a step too long makes of the numbers is found and said
        threads.share(kernel, parts if batch else [Part(tuple(inputs), tuple(outputs))])


def _cut(x: Array, axis: int, here: slice) -> Array:
    """Some samples along one axis of the batch, or the whole where it is the same for all of them."""
    return x if axis < 0 or x.shape[axis] == 1 else x[(slice(None),) * axis + (here,)]
