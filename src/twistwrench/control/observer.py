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
    """(nv,): r - J'F, the part of r that no wrench at this frame explains; large if the contact is elsewhere."""
    frame: str
    """Frame of the wrench; its axes are the frame's."""
    rank: int
    """Number of independent wrenches that the joint torques determine."""

    def __str__(self) -> str:
        shown = ", ".join(f"{n} {number(x)}" for n, x in zip(WRENCH, self.wrench, strict=True))
        rank = f"rank {self.rank}"
        if len(self.blind):
            rank += f", {len(self.blind)} directions are not observable"
        residual = float(np.linalg.norm(self.unexplained))
        return (
            f"wrench on the robot at {self.frame}: {shown} ({rank}; {number(residual, 3)} of the torques unexplained)"
        )


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
        self.robot, self.friction = require_robot(robot, "MomentumObserver"), arguments.flag(friction, "friction")
        K = arguments.real(gain, "MomentumObserver: gain")
        if K.shape not in ((), (robot.nv,)) or not (K > 0).all():
            raise ValueRangeError(
                f"MomentumObserver: gain is {gain!r}. Give rates [1/s] above zero, one number or {robot.nv} of them; "
                "np.inf does not filter."
            )
        self.gain = np.broadcast_to(np.array(K, float), (robot.nv,))
        self._terms = robot.kernel("mass_matrix", "coriolis_matrix", "bias_forces")
        self._past = robot.kernel("torque_past_friction")
        self._last: tuple[float, Array, Array, Array] | None = None
        self._residual = np.zeros(robot.nv)

    def __repr__(self) -> str:
        return f"<MomentumObserver of {self.robot.name!r}: {np.round(self._residual, 6).tolist()}>"

    @property
    def residual(self) -> Array:
        """Residual: current estimate of τ_ext (nv,) [N m or N]."""
        return self._residual.copy()

    def reset(self) -> None:
        """Reset the observer: the next :meth:`update` is the first."""
        self._last, self._residual = None, np.zeros(self.robot.nv)

    def update(self, t: float, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> Array:
        """Residual at a time, from the state and the torques since the last update.

        Parameters
        ----------
        t : float, later than the last one [s]
        tau : (nv,) array_like, torques since then [N m, sliding joints: N]; ignored in the first call

        Returns
        -------
        residual : (nv,) array, estimate of τ_ext [N m, sliding joints: N]
        """
        now, nv = arguments.number(t, "MomentumObserver: t"), self.robot.nv
        q, dq = one_state(self.robot, "MomentumObserver", q, dq)
        tau = arguments.one(tau, "MomentumObserver: tau", nv, names=self.robot.model.velocity_names)
        for name, x in (("t", t), ("q", q), ("dq", dq), ("tau", tau)):  # a NaN would stay in the residual forever
            arguments.finite(x, f"MomentumObserver: {name}")
        state = (now, dq.copy(), *self._momentum(q, dq))  # copied: the caller may overwrite dq
        if self._last is not None:
            self._residual = self._next_residual(self._residual, self._last, state, tau)
        self._last = state
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

        def rows(x: ArrayLike, name: str, names: Sequence[str]) -> Array:
            what = f"MomentumObserver: {name}"
            return arguments.finite(arguments.one(x, what, len(t), len(names), names=names), what)

        rates = self.robot.model.velocity_names
        q, dq, tau = rows(q, "q", self.robot.coordinate_names), rows(dq, "dq", rates), rows(tau, "tau", rates)
        p, beta = self._momentum(q, dq)
        before, after = ((t[rows], dq[rows], p[rows], beta[rows]) for rows in (slice(None, -1), slice(1, None)))
        x, keep = self._mean(before, after, tau[:-1])
        residual = np.zeros((len(t), self.robot.nv))
        for k in range(len(t) - 1):
            residual[k + 1] = x[k] + keep[k] * (residual[k] - x[k])
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
        Largest noise in each second follows a Gumbel law of its square, which gives the level of the wanted rate. Means of
        the residual in regions of speed and position are errors of the model, and are added.

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
        tau = np.zeros(self.robot.nv)

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
        robot, chosen = self.robot, list(row_numbers(rows))
        if not isinstance(kind, str) or kind not in KINDS:
            raise UnknownNameError.from_choices("kind", kind, KINDS)
        q = arguments.one(q, "MomentumObserver.wrench: q", robot.nq, names=robot.coordinate_names)
        q = arguments.finite(q, "MomentumObserver.wrench: q")
        r, what = self._residual if residual is None else residual, "MomentumObserver.wrench: residual"
        r = arguments.finite(arguments.one(r, what, robot.nv, names=robot.model.velocity_names), what)
        J = robot.jacobian(q, frame, kind)[chosen]
        U, s, Vt = np.linalg.svd(J)  # r = J'F
        rank = int(np.count_nonzero(s > SINGULAR_VALUE_SHARE * s.max(initial=0.0)))
        F, blind = np.zeros(6), np.zeros((len(chosen) - rank, 6))
        F[chosen] = U[:, :rank] @ (Vt[:rank] @ r / s[:rank])
        blind[:, chosen] = U[:, rank:].T
        name = str(robot.tip if frame is None else frame)
        return ContactWrench(F, blind, r - J.T @ F[chosen], name, rank)

    def _momentum(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Momentum p, and β."""
        M, C, h = self._terms(q, dq)
        v = dq[..., None]
        return (M @ v)[..., 0], ((C + np.swapaxes(C, -1, -2)) @ v)[..., 0] - h

    def _next_residual(
        self, r: Array, a: tuple[float, Array, Array, Array], b: tuple[float, Array, Array, Array], tau: Array
    ) -> Array:
        """Residual after one sample."""
        before, after = [np.asarray(x)[None] for x in a], [np.asarray(x)[None] for x in b]
        x, keep = self._mean(before, after, tau[None])
        return np.asarray(x[0] + keep[0] * (r - x[0]))

    def _mean(self, a: Sequence[Array], b: Sequence[Array], tau: Array) -> tuple[Array, Array]:
        """Means (n, nv) of τ_ext between samples, and the share of the residual that is kept."""
        (t0, dq0, p0, beta0), (t1, dq1, p1, beta1) = a, b
        dt = (t1 - t0)[:, None]
        not_rising = ~(dt[:, 0] > 0)
        if not_rising.any():
            k = int(not_rising.argmax())
            raise ValueRangeError(
                f"MomentumObserver: t = {printed(float(t1[k]))} s is not after the last time, {printed(float(t0[k]))} s. Give "
                "samples in order, and begin a new motion with reset()."
            )
        if self.friction:
            # Torques minus friction; load-dependent friction depends on the remaining torques.
            tau = 0.5 * np.asarray(self._past(dq0, tau) + self._past(dq1, tau))
        return (p1 - p0) / dt - tau - 0.5 * (beta0 + beta1), np.exp(-self.gain * dt)


complete(globals())
