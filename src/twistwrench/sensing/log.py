"""A log of readings: gravity in the sensor's frame, motion if known, and the readings."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.glossary import complete
from ..core.gravity import GRAVITY, STRENGTH
from ..core.numbers import number, printed
from ..errors import ModelWarning, ShapeError, ValueRangeError
from ..lie.labelled import WRENCH
from ..log_checks.doubts import Doubt, doubt
from ..typing import Array
from .sensor import (
    ForceTorqueSensor,
    checked_rotations,
    checked_sensor,
    gravity_in_frame,
    rotations_of_quaternions,
    unlabelled,
)

_STRONG = 1100.0  # N; twice the weight of 50 kg turned over, and a tenth; a log in grams of 1.1 kg is above
_LONG_LEVER = 5.0  # m; N mm read as N m make levers a thousand times too long
_MOST = (  # no arm turns or moves so fast, but in degrees or millimetres any does
    ("V", slice(0, 3), 50.0, "angular velocities", "rad/s", "are in degrees per second"),
    ("V", slice(3, 6), 30.0, "velocities", "m/s", "or the poses are in mm"),
    ("dV", slice(3, 6), 1000.0, "accelerations", "m/s²", "or the poses are in mm"),
)
_AFTER = "not after the {} s of the one before. Times must increase: sort the readings, or remove the column."
_GRAVITY = (1.5, 30.0)  # m/s²; from the Moon to Jupiter, but not in g or cm/s²


@dataclass(frozen=True, eq=False, repr=False)
class ReadingLog:
    """Log of a force-torque sensor: n readings with what is needed to explain them.

    In SI units and in {f}, the frame whose poses are known.

    Examples
    --------
    >>> from twistwrench.sensing import ForceTorqueSensor
    >>> log = ReadingLog.from_arrays([[0, 0, 0, 0, 0, -29.43]], pose=[np.eye(3)])
    >>> len(log), log.gravity.tolist()
    (1, [[0.0, 0.0, -9.81]])
    >>> log.doubts(), log.size_doubts(), log.motion_doubts()
    ([], [], [])
    >>> sensor = ForceTorqueSensor(bias=[0, 0, 0, 0, 0, -29.43])
    >>> log.predicted(sensor)[0, 5].item(), log.compensated(sensor)[0, 5].item()
    (-29.43, 0.0)
    """

    readings: Array
    """(n, 6): mx, my, mz [N m], fx, fy, fz [N]."""
    gravity: Array
    """(n, 3) gravity in {f} [m/s²]."""
    V: Array | None = None
    """(n, 6) twist of {f} in {f}, or None where the sensor stood still."""
    dV: Array | None = None
    """(n, 6) its rate, or None."""
    time: Array | None = None
    """(n,) s."""
    name: str = "log"
    """Name in errors and reports."""
    notes: tuple[str, ...] = ()
    """Parts left out when the log was read, in sentences."""
    by_gravity: bool = False
    """True if gravity itself was logged, reading by reading, and not orientations."""
    rotations: Array | None = None
    """(n, 3, 3) orientations R_wf, or None where gravity itself was logged."""

    @classmethod
    def from_arrays(
        cls,
        readings: ArrayLike,
        *,
        pose: ArrayLike | None = None,
        quaternion: ArrayLike | None = None,
        gravity: ArrayLike = GRAVITY,
        V: ArrayLike | None = None,
        dV: ArrayLike | None = None,
        time: ArrayLike | None = None,
        name: str = "log",
    ) -> ReadingLog:
        """Log from arrays.

        Parameters
        ----------
        readings : (n, 6) array_like, (m, f) [N m, N]
        pose : (n, 4, 4) or (n, 3, 3) array_like, optional, poses T_wf or rotations R_wf
        quaternion : (n, 4) array_like, optional, unit quaternions of R_wf, scalar first
        gravity : (3,) array_like, in {w} [m/s²]; without any orientations (n, 3), in {f} itself
        V : (n, 6) array_like, optional, body twists of {f} where it moved [rad/s, m/s]
        dV : (n, 6) array_like, optional, their rates [rad/s², m/s²]
        time : (n,) array_like, optional [s]
        name : str, for messages

        Raises
        ------
        ValueRangeError
            The log is empty, values are not finite, or orientations are none.

        Warns
        -----
        ModelWarning
            Units look wrong.

        Examples
        --------
        >>> log = ReadingLog.from_arrays([[0, 0, 0, 0, 0, -29.43]], quaternion=[[1, 0, 0, 0]])
        >>> log.gravity.tolist()
        [[0.0, 0.0, -9.81]]
        """
        labelled = unlabelled({"pose": pose, "V": V, "dV": dV})
        pose, V, dV = labelled["pose"], labelled["V"], labelled["dV"]
        r = np.array(arguments.real(readings, f"{name}: readings"), float)
        if r.size == 0:
            raise ValueRangeError(f"{name}: the log is empty. Give at least one reading.")
        if r.ndim != 2 or r.shape[1] != 6:
            raise ShapeError(f"{name}: readings have shape {r.shape}, expected (n, 6): {', '.join(WRENCH)}.")
        if pose is not None and quaternion is not None:
            raise ValueRangeError(f"{name}: both pose and quaternion are given. Keep one of them.")
        if quaternion is not None:
            pose = rotations_of_quaternions(quaternion, f"{name}: quaternion")
        g = (
            np.array(arguments.real(gravity, f"{name}: gravity"), float)
            if pose is None
            else gravity_in_frame(pose, gravity)
        )
        arrays = {"gravity": (g, 3), "V": (V, 6), "dV": (dV, 6)}
        checked = {key: _rows(value, len(r), width, f"{name}: {key}") for key, (value, width) in arrays.items()}
        if not np.isfinite(r).all():
            row, column = (int(k[0]) for k in np.nonzero(~np.isfinite(r)))
            raise ValueRangeError(
                f"{name}: {WRENCH[column]} of reading {row} is {r[row, column]}. Readings must be finite: fill or remove it."
            )
        if checked["gravity"] is None or not np.any(checked["gravity"], axis=1).all():
            raise ValueRangeError(
                f"{name}: gravity is zero in a reading, so nothing has a weight. Give {STRENGTH} m/s² of it."
            )
        if (V is None) != (dV is None):
            raise ValueRangeError(f"{name}: V and dV come together. Give both, or none for a sensor that stands still.")
        t = None if time is None else np.array(arguments.real(time, f"{name}: time"), float)
        if t is not None and (t.shape != (len(r),) or not np.isfinite(t).all()):
            raise ShapeError(f"{name}: time has shape {t.shape}, expected ({len(r)},) finite numbers [s].")
        if t is not None and (k := late(t)) is not None:
            raise ValueRangeError(
                f"{name}: time of reading {k} is {printed(t[k])} s, {_AFTER.format(printed(t[k - 1]))}"
            )
        by_gravity = pose is None and g.ndim == 2
        R = None if pose is None else np.broadcast_to(checked_rotations(pose), (len(r), 3, 3))
        log = cls(r, checked["gravity"], checked["V"], checked["dV"], t, name, by_gravity=by_gravity, rotations=R)
        for each in log.doubts():
            warnings.warn(f"{name}: {each}", ModelWarning, stacklevel=2)
        return log

    def __repr__(self) -> str:
        motion = "at rest" if self.V is None else "in motion"
        return f"<ReadingLog {self.name!r}: {len(self)} readings, {motion}>"

    @property
    def clock(self) -> Array:
        """Times (n,) of the readings [s], or their numbers where no time was logged."""
        return np.arange(float(len(self))) if self.time is None else self.time

    def __len__(self) -> int:
        return len(self.readings)

    def rows(self, which: Any) -> ReadingLog:
        """Log of some of the readings only.

        Parameters
        ----------
        which : slice, mask or indices

        Examples
        --------
        >>> len(ReadingLog.from_arrays(np.zeros((5, 6)), pose=np.tile(np.eye(3), (5, 1, 1))).rows(slice(2)))
        2
        """
        try:
            self.readings[which]
        except (IndexError, TypeError, ValueError) as problem:
            raise ValueRangeError(
                f"{self.name}: {arguments.shown(which)} chooses no readings: {problem}. Give a slice, indices, or a mask of "
                f"{len(self)}."
            ) from None
        optional = {name: getattr(self, name) for name in ("V", "dV", "time", "rotations")}
        chosen: dict[str, Any] = {name: None if x is None else x[which] for name, x in optional.items()}
        return replace(self, readings=self.readings[which], gravity=self.gravity[which], **chosen)

    def doubts(self) -> list[Doubt]:
        """Units that look wrong.

        Returns
        -------
        doubts : list of Doubt, empty when all look right
        """
        return self.size_doubts() + self.motion_doubts()

    def size_doubts(self) -> list[Doubt]:
        """Units of the readings that look wrong by their size alone.

        Returns
        -------
        doubts : list of Doubt
        """
        found = []
        centred = self.readings - np.median(self.readings, axis=0)  # a bias may be anything
        moment, force = (float(np.abs(centred[:, k]).max()) for k in (slice(0, 3), slice(3, 6)))
        if force > _STRONG:
            mass, factor = number(force / STRENGTH, 2), printed(STRENGTH / 1000)
            found.append(doubt("sensor-force-size", force=number(force), mass=mass, factor=factor))
        spread_m, spread_f = (float(np.linalg.norm(centred[:, k])) for k in (slice(0, 3), slice(3, 6)))
        if moment > 10 and spread_f and spread_m / spread_f > _LONG_LEVER:
            found.append(doubt("sensor-lever-size", lever=number(spread_m / spread_f, 3)))
        return found

    def motion_doubts(self) -> list[Doubt]:
        """Units of gravity and of the motion that look wrong by their size.

        Returns
        -------
        doubts : list of Doubt
        """
        found = []
        strength = np.linalg.norm(self.gravity, axis=1)
        if strength.min() < _GRAVITY[0] or strength.max() > _GRAVITY[1]:
            worst = strength.min() if strength.min() < _GRAVITY[0] else strength.max()
            found.append(doubt("sensor-gravity-size", gravity=number(worst), usual=STRENGTH))
        for motion, part, most, what, unit, other in _MOST:
            reached = 0.0 if getattr(self, motion) is None else float(np.abs(getattr(self, motion)[:, part]).max())
            if reached > most:
                found.append(doubt("sensor-motion-size", what=what, reached=f"{number(reached)} {unit}", other=other))
        return found

    def predicted(self, sensor: ForceTorqueSensor) -> Array:
        """Predicted readings of that sensor in these poses and motions.

        Returns
        -------
        readings : (n, 6) array [N m, N]
        """
        return checked_sensor(sensor, "predicted").predict(np.eye(3), self.V, self.dV, gravity=self.gravity)

    def compensated(self, sensor: ForceTorqueSensor) -> Array:
        """Gravity compensation: the readings without that sensor's bias, weight and inertial load.

        Returns
        -------
        compensated : (n, 6) array [N m, N]

        Warns
        -----
        ModelWarning
            The log has motion and the load's inertia is unknown.
        """
        checked_sensor(sensor, "compensated")
        sensor.warn_of_motion(self.V, self.dV)
        return self.readings - self.predicted(sensor)


def checked_log(log: Any, taker: str) -> ReadingLog:
    """The log itself; :class:`~twistwrench.ShapeError` naming who takes it and how to make one, if it is none."""
    if isinstance(log, ReadingLog):
        return log
    raise ShapeError(
        f"{taker} takes a ReadingLog, got {arguments.shown(log)}. Make one with "
        "ReadingLog.from_arrays(readings, pose=T_wf), or read one with read_log(path)."
    )


def late(time: Array) -> int | None:
    """The first of these times (n,) that is not after the one before; None if all are."""
    places = np.flatnonzero(np.diff(time) <= 0)
    return int(places[0]) + 1 if places.size else None


def _rows(value: ArrayLike | None, count: int, width: int, where: str) -> Any:
    if value is None:
        return None
    x = np.array(arguments.finite(value, where), float)
    if x.shape == (width,):
        x = np.tile(x, (count, 1))
    if x.shape != (count, width):
        raise ShapeError(f"{where} has shape {x.shape}, expected ({count}, {width}), a row for each reading.")
    return x


complete(globals())
