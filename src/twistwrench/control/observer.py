"""Momentum observer: external torques from the momentum, without accelerations, force sensors or the inverse of M.

The generalised momentum p = M dq obeys

    dp/dt = τ + τ_ext + β,     β = (C + C') dq - h,

because dM/dt = C + C'. Over a time Δ the mean of τ_ext is therefore x = (p1 - p0)/Δ - mean(τ + β), and the residual

    r ← x + exp(-K Δ) (r - x)

is τ_ext after a first-order filter with the time constant 1/K, for any Δ. Only the mean of β is approximate
(trapezoidal rule). Source: De Luca and Mattone, "Sensorless robot collision detection and hybrid force/motion control",
ICRA 2005; Haddadin, De Luca and Albu-Schäffer, "Robot collisions: a survey", IEEE T-RO 33(6), 2017.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, UnknownNameError, ValueRangeError
from ..core.glossary import complete
from ..core.numbers import number, printed
from ..core.typing import Array
from ..mechanics.algorithms.kinematics import KINDS, row_numbers
from ..mechanics.lie.labelled import WRENCH
from ..robot import Robot
from ..robot.arguments import Kind, Rows
from ..robot.base import require_robot
from .references import one_state

if TYPE_CHECKING:
    from ..motion.motion import Motion
    from .residual_threshold import ResidualThreshold

SINGULAR_VALUE_SHARE = 1e-6
"""Fraction of the largest singular value of J' below which a singular value counts as zero."""


@dataclass(frozen=True, eq=False)
class ContactWrench:
    """Contact wrench estimate: the wrench at a frame with the best fit r = J'F to the residual, and its undetermined part."""

    wrench: Array
    """(6,): (m, f) by the world on the robot; the smallest of all best fits, zero on unselected rows [N m, N]."""
    blind: Array
    """(k - rank, 6), for k selected rows: orthonormal wrenches on them that need no joint torques."""
    unexplained: Array
    """(nv,): part of r that no wrench at this frame explains, r - J'F; large if the contact is elsewhere."""
    frame: str
    """Frame of the wrench; its axes are the frame's."""
    rank: int
    """Number of independent wrenches that the joint torques determine."""

    def __str__(self) -> str:
        components = [f"{name} {number(value)}" for name, value in zip(WRENCH, self.wrench, strict=True)]
        rank = f"rank {self.rank}"
        if len(self.blind):
            rank += f", {len(self.blind)} directions are not observable"
        unexplained = number(float(np.linalg.norm(self.unexplained)), 3)
        wrench = ", ".join(components)
        return f"wrench on the robot at {self.frame}: {wrench} ({rank}; {unexplained} of the torques unexplained)"


class MomentumObserver:
    """Momentum observer: estimates the torques τ_ext that the world applies to the joints.

    :meth:`update` takes the state and the torques at every sample; :meth:`watch` calls it for a controller. Floating
    bases are supported; their torques are zero.

    Parameters
    ----------
    robot : Robot
    gain : float or (nv,) array_like, inverse of the time constant [1/s]
    friction : bool, subtract the robot's friction laws; otherwise friction is part of the estimate

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> observer = MomentumObserver(arm, gain=50.0)
    >>> held = tw.control.PD(arm, [0.5, 0.5], kp=200.0, kd=40.0)
    >>> push = {"tip": [0, 0, 0, 0, 5.0, 0]}
    >>> end = arm.simulate([0.5, 0.5], duration=1.0, dt=0.002, controller=observer.watch(held), wrench_on_robot=push)
    >>> np.allclose(observer.residual, arm.wrench_torques(end.q[-1], push["tip"]), atol=2e-3)
    True
    >>> observer.wrench(end.q[-1], rows="vx vy").rank
    2
    >>> observer.over([0, 0.01], [[0, 0]] * 2, [[0, 0]] * 2, [[29.43, 9.81]] * 2).shape
    (2, 2)
    >>> observer.reset()
    >>> observer.update(0.0, [0, 0], [0, 0], [0, 0]).tolist()
    [0.0, 0.0]
    """

    def __init__(self, robot: Robot, gain: ArrayLike, *, friction: bool = False) -> None:
        self.robot = require_robot(robot, "MomentumObserver")
        self.friction = arguments.flag(friction, "friction")
        K = arguments.real(gain, "MomentumObserver: gain")
        if K.shape not in ((), (robot.nv,)) or not (K > 0).all():
            raise ValueRangeError(
                f"MomentumObserver: gain is {gain!r}. Give rates [1/s] above zero, one number or {robot.nv} of them; "
                "np.inf does not filter."
            )
        self.gain = np.broadcast_to(np.array(K, float), (robot.nv,))
        self._dynamics = robot.kernel("mass_matrix", "coriolis_matrix", "bias_forces")
        self._torque_past_friction = robot.kernel("torque_past_friction")
        self._last: tuple[float, Array, Array, Array] | None = None  # t, dq, p and β of the last update
        self._residual = np.zeros(robot.nv)

    def __repr__(self) -> str:
        return f"<MomentumObserver of {self.robot.name!r}: {np.round(self._residual, 6).tolist()}>"

    @property
    def residual(self) -> Array:
        """Residual: current estimate of τ_ext (nv,) [N m or N]."""
        return self._residual.copy()

    def reset(self) -> None:
        """Reset the observer: the next :meth:`update` is the first."""
        self._last = None
        self._residual = np.zeros(self.robot.nv)

    def update(self, t: float, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> Array:
        """Residual at a time, from the state and the torques since the last update.

        Parameters
        ----------
        t : float, later than the last one [s]
        tau : (nv,) array_like, torques since the last call [N m, sliding joints: N]; ignored in the first call

        Returns
        -------
        residual : (nv,) array, estimate of τ_ext [N m, sliding joints: N]
        """
        time = arguments.number(t, "MomentumObserver: t")
        q, dq = one_state(self.robot, "MomentumObserver", q, dq)
        velocity_names = self.robot.model.velocity_names
        tau = arguments.one(tau, "MomentumObserver: tau", self.robot.nv, names=velocity_names)
        for name, value in (("t", t), ("q", q), ("dq", dq), ("tau", tau)):  # a NaN would stay in the residual forever
            arguments.finite(value, f"MomentumObserver: {name}")
        p, beta = self._momentum(q, dq)
        sample = (time, dq.copy(), p, beta)  # copied: the caller may overwrite dq
        if self._last is not None:
            self._residual = self._next_residual(self._residual, self._last, sample, tau)
        self._last = sample
        return self.residual

    def over(self, times: ArrayLike, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> Array:
        """Residuals of a record, starting from zero; the state of :meth:`update` is unchanged.

        Parameters
        ----------
        times : (n,) array_like [s]
        q : (n, nq) array_like, configurations
        dq : (n, nv) array_like, velocities [rad/s, m/s]
        tau : (n, nv) array_like [N m, sliding joints: N]
            ``tau[k]`` is applied from ``times[k]`` on, as in the result of a simulation with a controller.

        Returns
        -------
        residuals : (n, nv) array [N m, sliding joints: N]
        """
        t = arguments.finite(times, "MomentumObserver: times")
        if t.ndim != 1 or not len(t):
            raise ShapeError(f"MomentumObserver: times have shape {t.shape}, expected (n,), the instants of a record.")

        def checked_rows(matrix: ArrayLike, name: str, columns: Sequence[str]) -> Array:
            """Finite numbers, with a row for each time and the columns in this order."""
            what = f"MomentumObserver: {name}"
            rows = arguments.one(matrix, what, len(t), len(columns), names=columns)
            return arguments.finite(rows, what)

        velocity_names = self.robot.model.velocity_names
        q = checked_rows(q, "q", self.robot.coordinate_names)
        dq = checked_rows(dq, "dq", velocity_names)
        tau = checked_rows(tau, "tau", velocity_names)
        p, beta = self._momentum(q, dq)
        begins = t[:-1], dq[:-1], p[:-1], beta[:-1]
        ends = t[1:], dq[1:], p[1:], beta[1:]
        x, kept_share = self._mean(begins, ends, tau[:-1])
        residual = np.zeros((len(t), self.robot.nv))
        for k in range(len(t) - 1):
            residual[k + 1] = x[k] + kept_share[k] * (residual[k] - x[k])
        return residual

    def threshold(self, motion: Motion, *, per_hour: float = 1.0) -> ResidualThreshold:
        """Thresholds of the residual for a number of false alarms, from a log without contact.

        Parameters
        ----------
        motion : Motion
            Log of the robot's work with measured torques, 32 s or more; its first 2 s are not used.
        per_hour : float, false alarms in an hour, of all joints together

        Returns
        -------
        found : ResidualThreshold
            ``torques`` (nv,) with their parts ``noise`` and ``model``, ``smallest_force`` and ``verdict``.

        Raises
        ------
        ShapeError, ValueRangeError
            The motion has no torques, or is too short.

        Notes
        -----
        The square of the largest noise in each second follows a Gumbel law, which gives the level for a rate of false
        alarms. Means of the residual in regions of speed and position are errors of the model; they are added to that level.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.planar_2r(), np.arange(0, 40, 0.01)
        >>> work = tw.Motion(t, np.stack([np.sin(t), np.cos(t)], axis=1), robot=arm)
        >>> noise = np.random.default_rng(0).normal(0, 0.5, work.q.shape)
        >>> log = tw.Motion(t, work.q, work.dq, work.ddq, work.torques() + noise, robot=arm)
        >>> MomentumObserver(arm, 30.0).threshold(log).torques.shape
        (2,)
        """
        from .residual_threshold import residual_threshold

        return residual_threshold(self, motion, per_hour)

    def watch(self, controller: Callable[[float, Array, Array], ArrayLike]) -> Callable[[float, Array, Array], Array]:
        """Controller that also updates the observer, for ``robot.simulate(controller=…)``, which holds the torques.

        Parameters
        ----------
        controller : function of (t, q, dq), returns torques (nv,)

        Returns
        -------
        controller : function of (t, q, dq)

        Notes
        -----
        The observer is updated before the controller is called, so the controller can use :attr:`residual`.
        """
        if not callable(controller):
            raise ValueRangeError(
                f"MomentumObserver.watch: {controller!r} is not a controller, a function of (t, q, dq)."
            )
        tau = np.zeros(self.robot.nv)  # torques since the last call

        def update_and_control(t: float, q: Array, dq: Array) -> Array:
            nonlocal tau
            self.update(t, q, dq, tau)
            tau = arguments.one(controller(t, q, dq), "the torques of the controller watched", self.robot.nv)
            return tau

        return update_and_control

    def wrench(
        self,
        q: ArrayLike,
        frame: str | None = None,
        kind: Kind = "body",
        rows: Rows = None,
        *,
        residual: ArrayLike | None = None,
    ) -> ContactWrench:
        """Contact wrench at a frame that explains the residual, by least squares, with its undetermined part.

        Parameters
        ----------
        rows : str or iterable, optional, nonzero rows of the wrench; ``"vx vy vz"`` is a pure force at its origin;
            fewer rows need fewer joints
        residual : (nv,) array_like, optional, in place of :attr:`residual` [N m, sliding joints: N]

        Returns
        -------
        found : ContactWrench
        """
        robot = self.robot
        selected = list(row_numbers(rows))
        if not isinstance(kind, str) or kind not in KINDS:
            raise UnknownNameError.from_choices("kind", kind, KINDS)
        q = arguments.one(q, "MomentumObserver.wrench: q", robot.nq, names=robot.coordinate_names)
        q = arguments.finite(q, "MomentumObserver.wrench: q")
        what = "MomentumObserver.wrench: residual"
        if residual is None:
            residual = self._residual
        residual = arguments.one(residual, what, robot.nv, names=robot.model.velocity_names)
        r = arguments.finite(residual, what)
        J = robot.jacobian(q, frame, kind)[selected]
        U, s, Vt = np.linalg.svd(J)  # J = U diag(s) Vt, so r = J'F = Vt' diag(s) U' F
        min_singular_value = SINGULAR_VALUE_SHARE * s.max(initial=0.0)
        rank = int(np.count_nonzero(s > min_singular_value))
        F = np.zeros(6)
        F[selected] = U[:, :rank] @ (Vt[:rank] @ r / s[:rank])  # the pseudoinverse gives the smallest fit
        blind = np.zeros((len(selected) - rank, 6))
        blind[:, selected] = U[:, rank:].T  # J' of these wrenches is zero
        unexplained = r - J.T @ F[selected]
        frame_name = str(robot.tip if frame is None else frame)
        return ContactWrench(F, blind, unexplained, frame_name, rank)

    def _momentum(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Momentum p = M dq, and β = (C + C') dq - h."""
        M, C, h = self._dynamics(q, dq)
        dq_column = dq[..., None]
        p_column = M @ dq_column
        C_transposed = np.swapaxes(C, -1, -2)
        velocity_column = (C + C_transposed) @ dq_column
        return p_column[..., 0], velocity_column[..., 0] - h

    def _next_residual(
        self,
        r: Array,
        last_sample: tuple[float, Array, Array, Array],
        sample: tuple[float, Array, Array, Array],
        tau: Array,
    ) -> Array:
        """Residual (nv,) after a sample, from the one before it and t, dq, p and β of both samples."""
        begin = [np.asarray(value)[None] for value in last_sample]
        end = [np.asarray(value)[None] for value in sample]
        x, kept_share = self._mean(begin, end, tau[None])
        return np.asarray(x[0] + kept_share[0] * (r - x[0]))

    def _mean(self, begins: Sequence[Array], ends: Sequence[Array], tau: Array) -> tuple[Array, Array]:
        """Means x (n, nv) of τ_ext between samples, and the kept share exp(-K Δ) of the residual.

        ``begins`` and ``ends`` are t, dq, p and β at the begins and ends of n intervals.
        """
        t0, dq0, p0, beta0 = begins
        t1, dq1, p1, beta1 = ends
        dt = (t1 - t0)[:, None]
        is_after = dt[:, 0] > 0  # False for NaN
        if not is_after.all():
            k = int(is_after.argmin())  # the first False
            raise ValueRangeError(
                f"MomentumObserver: t = {printed(float(t1[k]))} s is not after the last time, {printed(float(t0[k]))} s. Give "
                "samples in order, and begin a new motion with reset()."
            )
        if self.friction:
            # Torques minus friction; load-dependent friction depends on the remaining torques.
            past_friction = self._torque_past_friction
            tau = 0.5 * np.asarray(past_friction(dq0, tau) + past_friction(dq1, tau))
        x = (p1 - p0) / dt - tau - 0.5 * (beta0 + beta1)
        return x, np.exp(-self.gain * dt)


complete(globals())
