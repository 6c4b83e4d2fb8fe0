"""Free motion of one rigid body under wrenches, with the drift of its invariants."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from inspect import signature

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.errors import InertiaError, ValueRangeError
from ...core.numbers import number, percent, printed, residual
from ...core.quadrature import probe_spacing
from ...core.typing import Array
from ..lie import se3
from .free_body_steps import (
    FreeBody,
    MissedImpulse,
    WrenchLaw,
    adaptive_motion,
    motion_under_wrench,
    six,
    torque_free_motion,
)
from .inertia import COMPOSITIONS, SpatialInertia
from .rigid_body import common_frame

_MAX_STATES = 1e8
"""Largest number of recorded states."""


def step_count(duration: float, dt: float, stride: int) -> int:
    """Number of steps that fill the duration, each at most ``dt``. Raises ValueRangeError for impossible arguments.

    ``stride`` is the number of steps from one recorded state to the next.
    """
    for name, value in (("duration", duration), ("dt", dt)):
        if not 0.0 < arguments.number(value, name) < np.inf:
            raise ValueRangeError(f"{name} is {value}, and must be a positive number of seconds.")
    if not (arguments.number(stride, "every") >= 1 and stride % 1 == 0):
        raise ValueRangeError(f"every is {stride}, and must be a whole number of steps, at least 1.")
    if not float(duration) < _MAX_STATES * stride * dt:
        raise ValueRangeError(
            f"a duration of {printed(duration)} s in steps of {printed(dt)} s, one in {stride} kept, makes more than 1e8 "
            "states. Keep fewer with every, or take a larger dt."
        )
    step_ratio = duration / dt * (1.0 - 1e-12)  # a whole number of steps stays whole in spite of rounding
    return max(1, int(np.ceil(step_ratio)))


def constant_law(wrench: ArrayLike) -> WrenchLaw:
    """Law that returns a constant wrench (6,) for every time, pose and twist."""
    F = six("wrench", wrench)
    return lambda _t, _T, _V: F


def checked_law(wrench: WrenchLaw, frame: str | None) -> WrenchLaw:
    """Law ``wrench``, checked to take three arguments; its labelled values must be in one frame.

    This is ``frame``, the body's frame, if it is known; otherwise the first labelled value determines it.
    """
    try:
        wrench_signature = signature(wrench)
    except (TypeError, ValueError):  # some C functions have no signature
        wrench_signature = None
    if wrench_signature is not None:
        try:
            wrench_signature.bind(0.0, None, None)
        except TypeError as problem:
            raise ValueRangeError(
                f"wrench is a function of {wrench_signature}, and is called as wrench(t, T, V), with the time [s], the pose "
                f"T_sb (4, 4) and the body twist (6,): {problem}. Write lambda t, T, V: …"
            ) from None

    wrench_frame = frame

    def law(t: float, T: Array, V: Array) -> ArrayLike:
        nonlocal wrench_frame
        F = wrench(t, T, V)
        wrench_frame = common_frame(wrench_frame, wrench=F)  # raises for another frame
        return F

    return law


# ── Recorded motion and drift of its invariants

_MAX_TURN_PER_STEP = 1.0
"""Rotation per step [rad] above which simulations of boxes failed within a few turns."""
_MAX_ENERGY_ERROR = 0.01
"""Error of the energy, as a fraction of it, above which simulations of boxes failed within a few turns."""


@dataclass(frozen=True)
class Drift:
    """Drift of the invariants of a flight, momentum minus impulse and energy minus work. All numbers are relative."""

    momentum: float
    """Largest change of the spatial momentum about the origin of {s}, relative to its largest terms."""
    energy: float
    """Largest change of the kinetic energy, relative to its largest value."""
    energy_trend: float
    """Growing part of the energy change: the slope of its regression line, times the duration."""
    rotation: float
    """Largest entry of RᵀR − 1 over all poses."""
    remarks: tuple[str, ...] = ()
    """Steps that are too large, or differ from the requested ones, as text; see :func:`fly`."""

    def __str__(self) -> str:
        trend = printed(self.energy_trend, 2, signed=True)
        text = (
            f"momentum {residual(self.momentum)}, energy {residual(self.energy)} (trend {trend}), rotation "
            f"{residual(self.rotation)}"
        )
        return "; note: ".join((text, *self.remarks))


@dataclass(frozen=True, eq=False, repr=False)
class Flight:
    """Recorded free motion: n + 1 states, the first at time 0. ``print`` shows the number of states and the drift."""

    times: Array
    """Times (n + 1,) [s]."""
    poses: Array
    """Poses T_sb (n + 1, 4, 4)."""
    twists: Array
    """Body twists (n + 1, 6) in {b}, angular part first [rad/s, m/s]."""
    momentum: Array
    """Spatial momentum (n + 1, 6), Ad(T_bs)ᵀ G V about the origin of {s} [N m s, N s], from the poses and twists above."""
    energy: Array
    """Kinetic energy (n + 1,), ½ Vᵀ G V [J]."""
    impulse: Array
    """Impulse (n + 1, 6) of the wrench up to each time, about the origin of {s} [N m s, N s]."""
    work: Array
    """Work (n + 1,) of the wrench up to each time [J]."""
    dt: float = np.nan
    """Requested step [s]."""
    step: float = np.nan
    """Step taken [s]; with a tolerance, interval of the record. A whole number of steps fills the duration."""
    turn: float = 0.0
    """Largest rotation in one step [rad]; 0 if steps are adaptive or exact."""
    unseen: str = ""
    """Text on a change of the wrench within steps, which the method does not resolve; empty if there is none."""
    drift: Drift = field(init=False)
    """Drift of momentum and energy."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks of :attr:`drift` and on the wrench, to be read before the flight is used; empty if none."""
        return self.drift.remarks

    def __repr__(self) -> str:
        steps = "" if np.isnan(self.step) else f", steps of {number(self.step, 6)} s"
        return f"Flight of {printed(self.times[-1])} s: {len(self.times)} states{steps}; drift: {self.drift}"

    def __post_init__(self) -> None:
        R, p = self.poses[:, :3, :3], self.poses[:, :3, 3]
        l, f = self.momentum[:, :3], self.momentum[:, 3:]
        momentum_errors = np.abs(self.momentum - self.impulse - self.momentum[0])
        largest_f = np.abs(f).max()
        largest_l = np.abs(l).max() + np.abs(p).max() * largest_f  # of the terms whose sum is l
        angular_drift = _ratio(momentum_errors[:, :3].max(), largest_l)
        linear_drift = _ratio(momentum_errors[:, 3:].max(), largest_f)
        momentum_drift = max(angular_drift, linear_drift)
        energy_scale = float(self.energy.max()) or 1.0  # 1 J for a body at rest
        energy_errors = (self.energy - self.work - self.energy[0]) / energy_scale
        t = self.times / self.times[-1] - 0.5  # relative to the duration
        t_deviations = t - t.mean()
        energy_trend = float(t_deviations @ energy_errors / (t_deviations @ t))
        rotation_error = float(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max())
        energy_drift = float(np.abs(energy_errors).max())
        remarks = tuple(self._remarks(energy_drift))
        drift = Drift(momentum_drift, energy_drift, energy_trend, rotation_error, remarks)
        object.__setattr__(self, "drift", drift)

    def _remarks(self, energy_drift: float) -> Iterator[str]:
        """Remarks on the steps, on what they do not resolve, and on the energy."""
        if abs(self.step - self.dt) > 1e-9 * self.dt:  # beyond rounding
            yield (
                f"steps of {number(self.step, 6)} s, not {number(self.dt, 6)} s, so that a whole number fills "
                f"{printed(self.times[-1])} s"
            )
        if self.turn > _MAX_TURN_PER_STEP:
            yield (
                f"dt is too large to trust the motion: the body turns up to {number(self.turn, 3)} rad in a step; keep it "
                "below 1"
            )
        if self.unseen:
            yield self.unseen
        if energy_drift > _MAX_ENERGY_ERROR:
            yield f"the energy is off by {percent(energy_drift, 2)}, so the motion is wrong: take a smaller dt, or a tolerance"


def _ratio(error: float, size: float) -> float:
    """error / size, 0 for size 0."""
    return float(error / size) if size else 0.0


# The body is integrated in principal axes at its centre of mass, where rotation and translation are independent. The state is
# the pose and the *spatial* momentum. Without a wrench this momentum is constant, the centre of mass moves on a straight line,
# and only the rotation takes steps (:mod:`twistwrench.mechanics.bodies.inertia`). A wrench acts as impulses between half steps
# of free motion, each an implicit midpoint rule in the momentum. So the method is symmetric, the orders of the compositions
# also hold for wrenches that depend on velocity, and work is exactly the gain of energy.

_PROBES_PER_STEP = 3.0
"""Maximum step of DOP853 in intervals between probes: its stages are at most 0.27 of a step apart."""
_MIN_TOLERANCE = 1e-13
"""Smallest tolerance of an adaptive step: above rounding."""
_MAX_TOLERANCE = 1e-2
"""Largest tolerance of an adaptive step."""
_MIN_MOMENT_RATIO = 1e-14
"""Smallest over largest principal moment of a rod or point, whose rotation about itself is not defined."""
_EQUAL_MOMENTS = 1e-6
"""Difference of two principal moments, over the largest, up to which the rotation is computed exactly."""


def fly(
    inertia: SpatialInertia,
    T0: ArrayLike,
    V0: ArrayLike,
    duration: float,
    dt: float,
    wrench: ArrayLike | WrenchLaw | None,
    *,
    order: int,
    tolerance: float | None,
    every: int,
) -> Flight:
    """Free motion of a body; the arguments are those of :meth:`twistwrench.RigidBody.fly`."""
    moments, axes = inertia.principal()
    smallest, _, largest = moments
    if not (inertia.mass > 0 and smallest > _MIN_MOMENT_RATIO * largest):
        raise InertiaError(
            f"a body of mass {printed(inertia.mass)} kg with principal moments {moments.tolist()} kg m² has no definite "
            "rotation. Give it mass, and some thickness."
        )
    body = FreeBody(float(inertia.mass), moments, se3.pose(axes, inertia.com))
    n = step_count(duration, dt, every)
    h = float(duration) / n
    if arguments.number(order, "order") not in COMPOSITIONS:
        raise ValueRangeError(f"order {order} is not available; choose one of {sorted(COMPOSITIONS)}.")
    if tolerance is not None and not _MIN_TOLERANCE <= arguments.number(tolerance, "tolerance") <= _MAX_TOLERANCE:
        raise ValueRangeError(f"tolerance is {tolerance}, and must be between 1e-13 and 1e-2.")
    frame = common_frame(T0=T0, V0=V0, wrench=wrench)
    matrix = arguments.finite(arguments.one(T0, "T0", 4, 4), "T0", 4, 4)
    start = body.state(arguments.pose(matrix, "T0"), six("V0", V0))
    recorded_steps = np.append(np.arange(0, n, every), n)
    composition = COMPOSITIONS[order]
    law: WrenchLaw | None = None
    probe_interval = np.inf  # a constant wrench needs no probes
    if callable(wrench):
        law = checked_law(wrench, frame)
        probe_interval = probe_spacing(h, float(duration))
    elif wrench is not None:
        law = constant_law(wrench)
    missed = MissedImpulse(composition, h, probe_interval)
    if tolerance is not None:
        max_step = _PROBES_PER_STEP * probe_interval
        record = adaptive_motion(body, start, recorded_steps * h, law, tolerance, max_step)
    elif law is None:
        record = torque_free_motion(body, start, h, n, every, composition)
    else:
        record = motion_under_wrench(body, start, h, n, every, composition, law, missed)
    q, p, l, f, impulse, work = record  # quaternions, positions, angular and linear momenta
    T, V = body.motion(q, p, l, f)
    P = inertia @ V
    energy = 0.5 * np.einsum("ij,ij->i", V, P)
    has_equal_moments = np.diff(moments).min() <= _EQUAL_MOMENTS * largest
    is_exact = law is None and has_equal_moments
    turn = 0.0
    if not is_exact and tolerance is None:
        turn = h * float(np.linalg.norm(V[:, :3], axis=-1).max())
    momentum = se3.Ad(se3.inverse(T)).T @ P
    largest_linear_impulse = float(np.abs(impulse[:, 3:]).sum(axis=-1).max())
    largest_linear = max(float(np.abs(f).max()), largest_linear_impulse)
    remark = missed.remark(largest_linear, angular=float(np.abs(l).max()))
    return Flight(recorded_steps * h, T, V, momentum, energy, impulse, work, float(dt), h, turn, remark)
