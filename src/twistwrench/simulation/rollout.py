"""Rollouts: many motions at once, all steps in one kernel, one sample per vector lane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.numbers import printed
from ..core.typing import Array
from .methods.schemes import MAX_SPEED
from .rollout_gradient import RolloutGradient, copy_inputs, gradient, linearize_steps
from .rollout_inputs import Inputs, validate_inputs
from .rollout_steps import room_for, take_all_steps

if TYPE_CHECKING:
    from ..motion.motion import Motion
    from ..robot import Robot
    from ..robot.doors import ConstrainedRobot


@dataclass(frozen=True, eq=False, repr=False)
class Rollout:
    """Rollout: motions of any batch shape, n states each, the first at time 0.

    Printing it reports unstable motions.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> falls = tw.robots.pendulum().rollout([[1.0], [2.0]], [0.0], dt=0.01, steps=100, gradients=True)
    >>> falls.motion(1)
    <Motion of 'pendulum': 101 states, 0 to 1 s>
    >>> falls.to_xarray().q.isel(sample=1, time=-1).sel(coordinate="hinge").shape
    ()
    >>> A, B = falls.linearize()
    >>> cost_by_q = np.zeros((2, 101, 1))
    >>> cost_by_q[:, -1] = 1.0                              # cost: the angles at the end
    >>> gradient = falls.gradient(cost_by_q)
    >>> A.shape, B.shape, gradient.q0.shape, gradient.tau.shape
    ((2, 100, 2, 2), (2, 100, 2, 1), (2, 1), (2, 100, 1))
    """

    robot: str
    """Name of the robot."""
    coordinate_names: tuple[str, ...]
    """Names of the entries of q."""
    velocity_names: tuple[str, ...]
    """Names of the entries of dq and tau."""
    times: Array
    """Times (n,) [s]."""
    q: Array
    """Configurations (..., n, nq)."""
    dq: Array
    """Velocities (..., n, nv)."""
    tau: Array | None
    """Torques (..., n - 1, nv) [N m or N] of the step that begins at each time but the last; None unless requested."""
    dt: float
    """Length of a step [s]."""
    steps: int
    """Number of steps."""
    method: str
    """The integrator, "semi_implicit" or "rk4"."""
    remarks: tuple[str, ...] = ()
    """Remarks to read before use; empty if there are none."""
    simulated: Robot | None = None
    """The simulated robot itself."""
    given: Inputs | None = None
    """Copy of the arguments of the rollout, for gradients; None unless requested."""

    def motion(self, *index: int) -> Motion:
        """States of one motion of the batch as a :class:`twistwrench.Motion`; accelerations by a spline of the velocities.

        Parameters
        ----------
        *index : int, index of the motion in the batch

        Returns
        -------
        motion : Motion

        Notes
        -----
        The motion refers to the original robot, even if the sample had other ``parameters=``. For torques with a
        sample's payload, use ``motion.with_robot(robot.with_payload(…))``.
        """
        is_valid = len(index) == len(self.batch)
        if is_valid:
            for k, size in zip(index, self.batch, strict=True):
                if not isinstance(k, int | np.integer) or not -size <= k < size:
                    is_valid = False
        if not is_valid:
            raise ValueRangeError(
                f"motion{index}: the batch has shape {self.batch}; give one index for each of its axes."
            )
        from ..motion.motion import Motion

        tau = None
        if self.tau is not None:  # the last state has the torques of the step before it
            step_torques = self.tau[index]
            tau = np.concatenate([step_torques, step_torques[-1:]])
        # plan: its values are exact, not measured
        return Motion(
            self.times, self.q[index], self.dq[index], tau=tau, robot=self._robot(), in_seconds=True, plan=True
        )

    def to_xarray(self) -> Any:
        """Dataset of q, dq, and tau if requested, with named axes: samples, time, coordinate, joint.

        Returns
        -------
        dataset : xarray.Dataset; torques belong to the step from each time and are NaN at the last one
        """
        from ..motion.motion_io import labelled_dataset

        arrays = {"q": self.q, "dq": self.dq}
        if self.tau is not None:
            arrays["tau"] = self.tau
        return labelled_dataset(self._robot().model, self.times, arrays)

    def gradient(self, q: ArrayLike = 0.0, dq: ArrayLike = 0.0, tau: ArrayLike = 0.0) -> RolloutGradient:
        """Gradient of a cost of these motions with respect to all inputs, by the discrete adjoint method.

        Parameters
        ----------
        q : (..., n, nv) array_like, derivatives of the cost by each configuration, along robot.add
        dq : (..., n, nv) array_like, derivatives by each velocity
        tau : (..., n - 1, nv) array_like, derivatives by the torques; requires ``torques=True``

        Returns
        -------
        gradient : RolloutGradient
        """
        inputs = self._require_inputs()
        cost_derivatives = {"q": q, "dq": dq}
        if inputs.plan.returns_torques:
            cost_derivatives["tau"] = tau
        elif np.any(tau):
            raise ValueRangeError("gradient: this rollout returns no torques. Make it with torques=True, too.")
        return gradient(self._robot(), inputs, self.q, self.dq, cost_derivatives)

    def linearize(self) -> tuple[Array, Array]:
        """Linearised steps: A and B of small deviations from each state, x[k + 1] = A[k] x[k] + B[k] u[k].

        Returns
        -------
        A : (..., steps, 2 nv, 2 nv) array, of x = (δ, δdq)
        B : (..., steps, 2 nv, nv) array, of u = δτ

        Notes
        -----
        δ are deviations along robot.add, as in :meth:`twistwrench.Robot.linearize`, its continuous-time counterpart.
        """
        inputs = self._require_inputs()
        stores_every_step = inputs.kept == inputs.steps
        if not stores_every_step:
            raise ValueRangeError("linearize: every step wants the state at its beginning. Roll out with every=1.")
        has_given_torques = "tau" in inputs.plan.law.names
        if not has_given_torques:
            raise ValueRangeError(
                "linearize: the torques follow a law, and B is by torques that are given. Roll out with those that the law "
                "applied: torques=True returns them."
            )
        return linearize_steps(self._robot(), inputs, self.q, self.dq)

    def _require_inputs(self) -> Inputs:
        """Inputs of the rollout; raises ValueRangeError if they were not kept."""
        if self.given is None:
            raise ValueRangeError("this rollout did not keep what went in: make it with gradients=True.")
        return self.given

    def _robot(self) -> Robot:
        """Robot of the rollout; raises ValueRangeError if there is none."""
        if self.simulated is None:
            raise ValueRangeError("this rollout has no robot in it.")
        return self.simulated

    @property
    def batch(self) -> tuple[int, ...]:
        """Shape of the batch."""
        return self.q.shape[:-2]

    @cached_property
    def unstable(self) -> Array:
        """Mask (...) of motions whose end is not finite or faster than 1e6 rad/s or m/s."""
        return _is_unstable(self.q[..., -1, :], self.dq[..., -1, :])

    @cached_property
    def unstable_from(self) -> Array:
        """First stored time at which each motion is unstable, (...) s; inf for stable motions."""
        start_times = np.full(self.batch, np.inf)
        for sample in map(tuple, np.argwhere(self.unstable)):
            is_unstable = _is_unstable(self.q[sample], self.dq[sample])
            first_state = np.argmax(is_unstable)  # index of the first True
            start_times[sample] = self.times[first_state]
        return start_times

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        motions = f"{math.prod(self.batch)} motions" if self.batch else "a motion"
        parts = [f"{motions} of {self.steps} steps of {printed(self.dt)} s, {len(self)} states each"]
        if self.unstable.any():
            parts.append(self._remark_on_unstable())
        parts += [f"note: {remark}" for remark in self.remarks]
        return f"<Rollout of {self.robot!r}, {self.method}: {'; '.join(parts)}>"

    def _remark_on_unstable(self) -> str:
        """Number of unstable motions, index and time of the earliest, and advice."""
        flat_index = np.argmin(self.unstable_from)
        earliest = np.unravel_index(flat_index, self.batch)
        time = self.unstable_from[earliest]
        index_text = f", first {tuple(map(int, earliest))}" if self.batch else ""
        advice = "take a smaller dt" if time > 0 else "look at its q0 and dq0"
        unstable_count = int(np.count_nonzero(self.unstable))
        return f"{unstable_count} unstable{index_text} at {printed(time)} s: {advice}"


Result = TypeVar("Result", bound=Rollout)


def roll_out(robot: Robot | ConstrainedRobot, *start: Any, **options: Any) -> Rollout:
    """Result of :meth:`twistwrench.Robot.rollout`; each step of a robot with constraints ends on them.

    ``start`` is q0 (..., nq), dq0 (..., nv) and tau.
    """
    if robot.constraints:
        from .closed import rollout_closed

        return rollout_closed(cast("ConstrainedRobot", robot), *start, **options)
    return rollout_of_tree(cast("Robot", robot), *start, **options)


def rollout_of_tree(
    robot: Robot, *start: Any, gradients: bool, out: tuple[Array, ...] | None, **options: Any
) -> Rollout:
    """Rollout of a robot without constraints. ``out`` are arrays for q, dq and, if requested, tau; None for new arrays."""
    inputs = validate_inputs(robot, *start, **options)
    copied_inputs = None
    if arguments.flag(gradients, "gradients"):
        copied_inputs = copy_inputs(inputs, out)
    result_arrays = room_for(inputs, out)
    q, dq, *torques = take_all_steps(robot, inputs, result_arrays)
    if copied_inputs is not None:  # gradients are those of the states as they were
        q.flags.writeable = False
        dq.flags.writeable = False
    return build_rollout(Rollout, robot, inputs, q, dq, torques, given=copied_inputs)


def build_rollout(
    kind: type[Result], robot: Robot, inputs: Inputs, q: Array, dq: Array, torques: list[Array], **more: Any
) -> Result:
    """Rollout of a type, from validated inputs.

    ``torques`` is a list of one array, or empty if no torques are requested. ``more`` are the additional fields of the type.
    """
    return kind(
        robot=robot.name,
        simulated=robot,
        times=inputs.times,
        dt=inputs.dt,
        steps=inputs.steps,
        method=inputs.plan.method,
        q=q,
        dq=dq,
        tau=torques[0] if torques else None,
        coordinate_names=robot.coordinate_names,
        velocity_names=robot.model.velocity_names,
        remarks=inputs.remarks,
        **more,
    )


def _is_unstable(q: Array, dq: Array) -> Array:
    """Mask (...) of states that are not finite or faster than the largest plausible speed."""
    with np.errstate(invalid="ignore"):
        is_slow = (np.abs(dq) < MAX_SPEED).all(axis=-1)  # False for NaN, too
    is_finite = np.isfinite(q).all(axis=-1)
    is_stable = is_finite & is_slow
    return np.asarray(~is_stable)


complete(globals())
