"""Velocities and accelerations of a log that has none: a quintic spline through its samples, smoothed if asked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TrajectoryError
from ..model.model import Model
from .coordinates import Coordinates, joint_rates
from .smoothing import best_strength, margin_of, smooth
from .survey import Survey, survey
from .trajectory import Motion, Trajectory
from .windows import windows

Array = NDArray[Any]

__all__ = ["Differentiation", "States", "spline_rates"]

_DEGREE = 5
_FEWEST = _DEGREE + 1
_SPLINE_MARGIN = 64
"""Samples. The pull of a sample on a quintic spline falls by 0.43 a sample: by 4e-24 over the margin."""
_EXCERPTS, _EXCERPT_ROWS = 8, 2048


@dataclass(frozen=True, eq=False)
class States:
    """Consecutive samples of a motion with everything inverse dynamics needs; (n,), (n, nq), (n, nv), (n, nv)."""

    time: Array
    q: Array
    dq: Array
    ddq: Array

    def __len__(self) -> int:
        return len(self.time)

    def at(self, rows: Any) -> States:
        """Some of the rows."""
        return States(self.time[rows], self.q[rows], self.dq[rows], self.ddq[rows])

    def copy(self) -> States:
        """The same, holding on to no larger arrays."""
        return States(self.time.copy(), self.q.copy(), self.dq.copy(), self.ddq.copy())

    @classmethod
    def none(cls, nq: int, nv: int) -> States:
        """No states at all."""
        return cls(np.zeros(0), np.zeros((0, nq)), np.zeros((0, nv)), np.zeros((0, nv)))


@dataclass(frozen=True, eq=False)
class Differentiation:
    """How the states of a motion file come about, and how uncertain that makes them."""

    trajectory: Trajectory
    model: Model
    quality: Survey
    """Of the columns that are differentiated."""
    source: str
    """What accelerations come from: ``given``, ``velocities`` or ``positions``."""
    derives_velocities: bool
    places: Array
    """(k,) the columns that are differentiated."""
    strengths: Array
    """(k,) smoothing strengths of those; 0 for none."""
    sigma_ddq: Array
    """(nv,) standard deviation of the accelerations that follows from the noise of the log; 0 where they are given."""

    @classmethod
    def plan(cls, trajectory: Trajectory, model: Model, *, smoothing: bool = False) -> Differentiation:
        """Look at excerpts of the file and decide. ``smoothing`` fits its strength to the noise found."""
        has = trajectory.columns.places
        source = "given" if has["ddq"] is not None else "velocities" if has["dq"] is not None else "positions"
        differentiated = "dq" if source == "velocities" else "q"
        derives_velocities = has["dq"] is None
        derives = source != "given" or derives_velocities
        places = has[differentiated] if derives else None
        places = np.zeros(0, int) if places is None else places

        excerpts = trajectory.excerpts(_EXCERPTS, _EXCERPT_ROWS)
        times = [table[:, trajectory.columns.time] for table in excerpts]
        parts = [table[:, places] for table in excerpts]
        if derives and sum(map(len, times)) < _FEWEST:
            raise _too_few(trajectory, sum(map(len, times)), "accelerations" if source != "given" else "velocities")
        quality = survey(times, parts)
        strengths = np.zeros(len(places))
        if smoothing:
            for k, noise in enumerate(quality.noise):
                strengths[k] = best_strength(times, [x[:, k] for x in parts], float(noise), quality.step)
        sigma_ddq = np.zeros(model.nv)
        if source != "given":
            order = 1 if source == "velocities" else 2
            gains = [noise_gain(order, float(s), quality.step) for s in strengths]
            sigma = quality.noise * trajectory.columns.factors[differentiated] * np.array(gains)
            sigma_ddq = sigma if source == "velocities" else _to_joints(model, sigma)
        return cls(trajectory, model, quality, source, derives_velocities, places, strengths, sigma_ddq)

    @property
    def derives(self) -> bool:
        """Whether anything is derived at all."""
        return self.source != "given" or self.derives_velocities

    def states(self, core: int, progress: Callable[[int], None] | None = None) -> Iterator[States]:
        """The motion in runs of about ``core`` rows; the same values whatever ``core``, to round-off."""
        margin = (
            max([_SPLINE_MARGIN, *(margin_of(s) + _SPLINE_MARGIN for s in self.strengths if s)]) if self.derives else 0
        )
        for rows, inner in windows(self.trajectory.tables(progress), max(core, margin), margin):
            yield self._complete(self.trajectory.motion(rows)).at(inner)

    def _complete(self, motion: Motion) -> States:
        """Add what the file does not give; all at rows of one window."""
        t, q, dq, ddq = motion.time, motion.q, motion.dq, motion.ddq
        if self.source == "velocities":
            assert dq is not None  # what the source being "velocities" means
            dq = self._smoothed(t, dq)
            ddq, _ = spline_rates(t, dq)
        elif self.derives_velocities:
            q, rates1, rates2 = self._position_rates(t, q)
            dq, derived = joint_rates(self.model, q, rates1, rates2)
            ddq = derived if ddq is None else ddq
        assert dq is not None and ddq is not None
        return States(t, q, dq, ddq)

    def _position_rates(self, t: Array, q: Array) -> tuple[Array, Array, Array]:
        endless = Coordinates.of(self.model).endless
        unwrapped = q.copy()
        unwrapped[:, endless] = np.unwrap(q[:, endless], axis=0)
        continuous = _continuous_signs(self.model, unwrapped)
        smoothed = self._smoothed(t, continuous)
        return (smoothed, *spline_rates(t, smoothed))

    def _smoothed(self, t: Array, x: Array) -> Array:
        columns = [smooth(t, x[:, k], float(s), self.quality.step) for k, s in enumerate(self.strengths)]
        return np.stack(columns, axis=1) if columns else x


def _too_few(trajectory: Trajectory, rows: int, wanted: str) -> TrajectoryError:
    return TrajectoryError(
        f"{trajectory.path}: {rows} row{'s are' if rows != 1 else ' is'} too few to derive {wanted} from. "
        f"Give at least {_FEWEST} rows, or '.vel' and '.acc' columns for every joint."
    )


def spline_rates(t: Array, x: Array) -> tuple[Array, Array]:
    """First and second derivatives at the samples of the quintic spline through them; (n,), (n, k) → (n, k) twice."""
    from scipy.interpolate import make_interp_spline

    # Time from the window's middle, so that large clock readings (seconds since 1970) cost no digits.
    local = t - t[len(t) // 2]
    spline = make_interp_spline(local, x, k=_DEGREE)
    return spline(local, 1), spline(local, 2)


def noise_gain(order: int, strength: float, step: float) -> float:
    """Standard deviation of the spline's derivative of that ``order`` for white noise of unit standard deviation.

    Found by differentiating a unit pulse on a uniform grid: a linear filter gains the norm of its pulse response.
    """
    half = _SPLINE_MARGIN + (margin_of(strength) if strength else 0)
    t = np.arange(2 * half + 1) * step
    pulse = np.zeros(len(t))
    pulse[half] = 1.0
    response = spline_rates(t, smooth(t, pulse, strength, step)[:, None])[order - 1]
    return float(np.linalg.norm(response))


def _to_joints(model: Model, spread: Array) -> Array:
    """Standard deviations of second derivatives of q (nq,) as those of ddq (nv,)."""
    found = np.zeros(model.nv)
    for b in model.leaders:
        part, here = spread[b.q_index : b.q_index + b.joint.nq], slice(b.v_index, b.v_index + b.joint.nv)
        if b.joint.kind == "floating":  # omega_b = 2 vec(conj(p) p'): twice the quaternion's
            found[here] = np.r_[np.full(3, 2.0 * part[:4].max()), np.full(3, part[4:].max())]
        elif b.joint.kind == "planar":
            found[here] = np.r_[part[2], np.full(2, part[:2].max())]
        else:
            found[here] = part
    return found


def _continuous_signs(model: Model, q: Array) -> Array:
    """Turn quaternions to the sign that continues their predecessor's: p and -p are one rotation, but not one curve."""
    for b in model.leaders:
        if b.joint.kind == "floating":
            p = q[:, b.q_index : b.q_index + 4]
            flips = np.sign(np.sum(p[1:] * p[:-1], axis=1))
            q[:, b.q_index : b.q_index + 4] = p * np.cumprod(np.r_[1.0, np.where(flips == 0, 1.0, flips)])[:, None]
    return q
