"""A motion to be shown: as many of its states as a picture can tell apart, with their torques, and the limits it passes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from ..errors import ShapeError, ValueRangeError
from ..report.coordinates import Coordinates, joint_rates
from ..report.derivatives import Differentiation, States, spline_rates
from ..report.load import LoadedRobot
from ..report.tally import Extreme
from .thinning import Thinned

if TYPE_CHECKING:
    from ..model.model import Model
    from ..motion.trajectory import Trajectory
    from ..robot import Robot

Array = NDArray[Any]

__all__ = ["Motion", "motion_of", "read_motion"]

_MOST = 4000
"""Evenly spaced states kept of a long motion; those at peaks may be three times as many."""
_CHUNK = 8192
_FEWEST = 6
"""Samples that velocities and accelerations can be derived from."""
_SLACK = 1e-9


@dataclass(frozen=True, eq=False)
class Motion:
    """States of a robot over time; of a motion of very many, evenly spaced ones and those at which a curve peaks."""

    load: LoadedRobot
    time: Array
    """(n,) s, increasing."""
    q: Array
    """(n, nq)."""
    dq: Array
    """(n, nv)."""
    ddq: Array
    """(n, nv)."""
    torques: Array
    """(n, nv), everything included that ``load`` says; N m or N."""
    peaks: Array
    """(nv,) the largest magnitude of each torque over every row."""
    rows: int
    """Of the whole motion."""
    warnings: tuple[str, ...]
    """A sentence for each limit that is passed, and for what in the input contradicts itself."""
    still: Array
    """(n, nv) bool: the velocity is derived and within its own uncertainty; friction that needs its sign is left out."""

    @property
    def states(self) -> States:
        """The same as the functions of :class:`~twistwrench.report.load.LoadedRobot` take it."""
        none = np.zeros((len(self.time), 0))
        return States(self.time, self.q, self.dq, self.ddq, self.q, self.still, none)

    def require(self, robot: Robot) -> None:
        """Raise ValueRangeError unless this is a motion of that robot, whatever it carries."""
        own = self.load.bare
        if own.coordinate_names != robot.coordinate_names:
            raise ValueRangeError(
                f"the motion is of robot {own.name!r}, and the one to be shown is {robot.name!r}. Make it with "
                "motion_of(robot, …)."
            )

    def at(self, time: float) -> tuple[Array, Array]:
        """q (nq,) and torques (nv,) at a time, between two samples on the straight way from one to the other."""
        k = int(np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, max(0, len(self.time) - 2)))
        after = min(k + 1, len(self.time) - 1)
        step = float(self.time[after] - self.time[k])
        share = float(np.clip((time - self.time[k]) / step, 0.0, 1.0)) if step > 0 else 0.0
        robot = self.load.loaded
        step_q = robot.subtract(self.q[after], self.q[k])
        for b in robot.model.leaders:
            if b.joint.kind == "continuous":  # a log may jump by a turn
                step_q[b.v_index] -= 2 * np.pi * np.round(step_q[b.v_index] / (2 * np.pi))
        q = robot.add(self.q[k], share * step_q)
        return q, self.torques[k] + share * (self.torques[after] - self.torques[k])


def motion_of(
    robot: Robot, time: ArrayLike, q: ArrayLike, dq: ArrayLike | None = None, ddq: ArrayLike | None = None
) -> Motion:
    """A motion from arrays: time (n,) [s], q (n, nq), and dq, ddq (n, nv), which are derived by a spline where left out.

    Fewer samples than six are taken to be at rest, and a warning says so where they are not. Torques include joint friction,
    as the command ``torques`` does. Raises ShapeError, ValueRangeError.

    >>> import twistwrench as tw
    >>> t = np.linspace(0, 1, 21)
    >>> motion = motion_of(tw.robots.pendulum(), t, np.sin(t)[:, None])
    >>> motion.torques.shape, motion.rows
    ((21, 1), 21)
    """
    model = robot.model
    t, q = arguments.finite(time, "time"), arguments.finite(q, "q", model.nq, names=robot.coordinate_names)
    if t.ndim != 1 or q.shape != (len(t), model.nq) or not len(t):
        raise ShapeError(f"a motion has time (n,) and q (n, {model.nq}), got {t.shape} and {q.shape}.")
    if (np.diff(t) <= 0).any():
        k = int(np.argmax(np.diff(t) <= 0))
        raise ValueRangeError(f"time does not increase from sample {k} ({t[k]:g} s) to the next ({t[k + 1]:g} s).")
    given = {"dq": dq, "ddq": ddq}
    rates = {
        n: None if x is None else arguments.finite(x, n, model.nv, names=model.velocity_names) for n, x in given.items()
    }
    for name, x in rates.items():
        if x is not None and x.shape != (len(t), model.nv):
            raise ShapeError(f"{name} has shape {x.shape}, expected ({len(t)}, {model.nv}).")
    zero = np.zeros((len(t), model.nv))
    derived = (zero, zero)
    if len(t) >= _FEWEST and (dq is None or ddq is None):
        q = _continuous(model, q)
        derived = joint_rates(model, q, *spline_rates(t, q))
        if dq is not None:
            derived = derived[0], spline_rates(t, np.asarray(rates["dq"]))[0]
    moves = len(t) < _FEWEST and (dq is None or ddq is None) and bool((q != q[0]).any())
    dq, ddq = (y if x is None else x for x, y in zip(rates.values(), derived, strict=True))
    states = States(t, q, dq, ddq, q, np.zeros_like(zero, bool), zero[:, :0])
    motion = _gathered(LoadedRobot(robot), iter([states]))
    if not moves:
        return motion
    said = f"{len(t)} samples are too few to derive rates from, so torques are those at rest: give {_FEWEST}, or dq and ddq"
    return replace(motion, warnings=(*motion.warnings, said))


def read_motion(
    load: LoadedRobot,
    trajectory: Trajectory,
    progress: Callable[[int], None] | None = None,
    *,
    smoothing: bool = False,
) -> Motion:
    """The motion in a file, as the command ``torques`` reads it; raises TrajectoryError as that does.

    ``smoothing`` fits its strength to the noise found before anything is derived.
    """
    differentiation = Differentiation.plan(trajectory, load.bare.model, smoothing=smoothing)
    motion = _gathered(load, differentiation.states(_CHUNK, progress))
    doubts = [*load.contradictions, *trajectory.contradictions(load.bare.limits)]
    return replace(motion, warnings=(*(f"LOOK AGAIN: {said}" for said in doubts), *motion.warnings))


def _continuous(model: Model, q: Array) -> Array:
    """q without the jumps that are no motion: of angles by a turn, of quaternions to their negatives."""
    coordinates, q = Coordinates.of(model), q.astype(float)
    q[:, coordinates.endless] = np.unwrap(q[:, coordinates.endless], axis=0)
    for place in coordinates.quaternions:
        turned = np.einsum("ij,ij->i", q[1:, place], q[:-1, place]) < 0
        q[1:, place] *= np.where(np.cumsum(turned) % 2, -1.0, 1.0)[:, None]
    return q


def _gathered(load: LoadedRobot, every: Iterator[States]) -> Motion:
    """One pass in bounded memory; torques, velocities and power keep the peaks of every row."""
    nq, nv = load.bare.nq, load.bare.nv
    kept = Thinned(4 * _MOST, slice(1, 2 + 2 * nv))
    peaks = Extreme(nv)
    excesses = _Excesses(load)
    for s in every:
        torques = load.torques(s)
        peaks.add(s.time, np.abs(torques))
        excesses.add(s, torques)
        power = (torques * s.dq).sum(axis=1)
        kept.add(np.column_stack([s.time, power, torques, s.dq, s.q, s.ddq, s.still]))
    time, _, torques, dq, q, ddq, still = np.split(kept.result(), np.cumsum([1, 1, nv, nv, nq, nv]), axis=1)
    said = excesses.sentences()
    return Motion(load, time[:, 0], q, dq, ddq, torques, peaks.value.copy(), kept.count, said, still.astype(bool))


class _Excesses:
    """By how much each limit is passed, and when, over all rows."""

    def __init__(self, load: LoadedRobot) -> None:
        model = load.bare.model
        self.names, self.limits = model.velocity_names, model.limits
        self.at = Coordinates.of(model).position_of
        self.worst = {kind: Extreme(model.nv) for kind in ("effort", "lower", "upper", "velocity")}

    def add(self, s: States, torques: Array) -> None:
        """Take in states and their torques."""
        limits = self.limits
        q = np.where(self.at >= 0, s.logged[:, np.maximum(self.at, 0)], 0.0)
        some = self.at >= 0
        self.worst["effort"].add(s.time, np.abs(torques) - limits.effort)
        self.worst["lower"].add(s.time, np.where(some, limits.lower, -np.inf) - q)
        self.worst["upper"].add(s.time, q - np.where(some, limits.upper, np.inf))
        self.worst["velocity"].add(s.time, np.abs(s.dq) - limits.velocity)

    def sentences(self) -> tuple[str, ...]:
        """One for each joint and kind of limit that is passed."""
        words = {"effort": "torque limit", "lower": "lower limit", "upper": "upper limit", "velocity": "velocity limit"}
        found = []
        for kind, extreme in self.worst.items():
            bound = np.abs(getattr(self.limits, kind))
            for k in np.flatnonzero(extreme.value > _SLACK * np.maximum(1.0, np.where(np.isfinite(bound), bound, 1.0))):
                by = f"{extreme.value[k]:.3g}" + (
                    f" ({100 * extreme.value[k] / bound[k]:.3g} %)" if bound[k] > 0 else ""
                )
                found.append(f"{self.names[k]} passes its {words[kind]} by {by} at t = {extreme.time[k]:.3f} s")
        return tuple(found)
