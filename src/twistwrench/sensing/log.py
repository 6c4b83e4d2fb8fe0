"""Log of a force-torque sensor: readings, gravity in the sensor's frame, and motion if known."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.doubts import Doubt, doubt
from ..core.errors import ModelWarning, ShapeError, ValueRangeError
from ..core.glossary import complete
from ..core.gravity import GRAVITY, STRENGTH
from ..core.numbers import number, printed
from ..core.typing import Array
from ..mechanics.lie.labelled import WRENCH
from .sensor import (
    ForceTorqueSensor,
    checked_rotations,
    checked_sensor,
    gravity_in_frame,
    plain_arrays,
    rotations_of_quaternions,
)

MAX_FORCE = 1100.0
"""N: largest plausible force, the change when a 50 kg load is turned over, plus 10 %. Logs in grams exceed it."""
MAX_LEVER = 5.0
"""m: largest plausible ratio of moments to forces. It is 1000 times too large if moments are in N mm."""
_MIN_DOUBTED_MOMENT = 10.0
"""N m: smaller moments are not doubted, since their ratio to forces may be that of noise."""
_MOTION_LIMITS = (  # field, its columns, largest plausible value, quantity, unit, cause of larger values
    ("V", slice(0, 3), 50.0, "angular velocities", "rad/s", "are in degrees per second"),
    ("V", slice(3, 6), 30.0, "velocities", "m/s", "or the poses are in mm"),
    ("dV", slice(3, 6), 1000.0, "accelerations", "m/s²", "or the poses are in mm"),
)
"""Limits of plausible motions. No arm is as fast as a limit, and usual motions in degrees or millimetres are faster."""
MAX_TURN = np.radians(2.0)
"""Angle between gravity by orientations and by joint positions above which there is a doubt."""
_GRAVITY_RANGE = (1.5, 30.0)
"""m/s²: range from below the Moon's to above Jupiter's gravity; values in g or cm/s² are outside."""


@dataclass(frozen=True, eq=False, repr=False)
class ReadingLog:
    """Log of a force-torque sensor: n readings with the poses and motions that determine the load's wrench.

    Quantities are in SI units and in {f}, the frame whose poses are known.

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
    """Readings (n, 6): mx, my, mz [N m], fx, fy, fz [N]."""
    gravity: Array
    """Gravity (n, 3) in {f} [m/s²]."""
    V: Array | None = None
    """Body twist (n, 6) of {f}, or None if the sensor was at rest."""
    dV: Array | None = None
    """Rate of the twist (n, 6), or None."""
    time: Array | None = None
    """Times (n,) [s], or None."""
    name: str = "log"
    """Name in messages and reports."""
    notes: tuple[str, ...] = ()
    """Sentences about the parts of the file that were ignored."""
    by_gravity: bool = False
    """True if gravity, and not the orientation, was logged for each reading."""
    rotations: Array | None = None
    """Orientations R_wf (n, 3, 3), or None if gravity was logged instead."""
    turned: float = 0.0
    """Median angle between gravity by the logged orientations and by the joint positions of a robot [rad]."""

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
        gravity : (3,) array_like, in {w} [m/s²]; (n, 3) in {f} if no orientations are given
        V : (n, 6) array_like, optional, body twists of {f}; None at rest [rad/s, m/s]
        dV : (n, 6) array_like, optional, their rates [rad/s², m/s²]
        time : (n,) array_like, optional [s]
        name : str, for messages

        Raises
        ------
        ValueRangeError
            The log is empty, values are not finite, or orientations are invalid.

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
        plain = plain_arrays({"pose": pose, "V": V, "dV": dV})  # without labels of frames
        pose = plain["pose"]
        V = plain["V"]
        dV = plain["dV"]
        F = np.array(arguments.real(readings, f"{name}: readings"), float)

        if F.size == 0:
            raise ValueRangeError(f"{name}: the log is empty. Give at least one reading.")
        if F.ndim != 2 or F.shape[1] != 6:
            raise ShapeError(f"{name}: readings have shape {F.shape}, expected (n, 6): {', '.join(WRENCH)}.")
        n = len(F)
        if pose is not None and quaternion is not None:
            raise ValueRangeError(f"{name}: both pose and quaternion are given. Keep one of them.")
        if quaternion is not None:
            pose = rotations_of_quaternions(quaternion, f"{name}: quaternion")
        if pose is None:
            g = np.array(arguments.real(gravity, f"{name}: gravity"), float)
        else:
            g = gravity_in_frame(pose, gravity)
        gravity_rows = _reading_rows(g, n, 3, f"{name}: gravity")
        V_rows = None if V is None else _reading_rows(V, n, 6, f"{name}: V")
        dV_rows = None if dV is None else _reading_rows(dV, n, 6, f"{name}: dV")
        if not np.isfinite(F).all():
            not_finite = np.argwhere(~np.isfinite(F))
            row, column = not_finite[0]
            raise ValueRangeError(
                f"{name}: {WRENCH[column]} of reading {row} is {F[row, column]}. Readings must be finite: fill or remove it."
            )
        has_gravity = np.any(gravity_rows, axis=1)
        if not has_gravity.all():
            raise ValueRangeError(
                f"{name}: gravity is zero in a reading, so nothing has a weight. Give {STRENGTH} m/s² of it."
            )
        lacks_one_of_both = (V is None) != (dV is None)
        if lacks_one_of_both:
            raise ValueRangeError(f"{name}: V and dV belong together. Give both, or neither for a sensor at rest.")
        t = None if time is None else _increasing_times(time, n, name)
        R = None if pose is None else np.broadcast_to(checked_rotations(pose), (n, 3, 3))
        has_gravity_of_each = pose is None and g.ndim == 2
        log = cls(F, gravity_rows, V_rows, dV_rows, t, name, by_gravity=has_gravity_of_each, rotations=R)
        for log_doubt in log.doubts():
            warnings.warn(f"{name}: {log_doubt}", ModelWarning, stacklevel=2)
        return log

    def __repr__(self) -> str:
        motion = "at rest" if self.V is None else "in motion"
        return f"<ReadingLog {self.name!r}: {len(self)} readings, {motion}>"

    @property
    def clock(self) -> Array:
        """Times (n,) of the readings [s], or their indices if no time was logged."""
        return np.arange(float(len(self))) if self.time is None else self.time

    def __len__(self) -> int:
        return len(self.readings)

    def rows(self, which: Any) -> ReadingLog:
        """Select some of the readings.

        Parameters
        ----------
        which : slice, mask or indices

        Examples
        --------
        >>> len(ReadingLog.from_arrays(np.zeros((5, 6)), pose=np.tile(np.eye(3), (5, 1, 1))).rows(slice(2)))
        2
        """
        try:
            self.readings[which]  # only for NumPy's error if the index is not valid
        except (IndexError, TypeError, ValueError) as problem:
            raise ValueRangeError(
                f"{self.name}: {arguments.value_text(which)} chooses no readings: {problem}. Give a slice, indices, or "
                f"a mask of {len(self)}."
            ) from None
        selected: dict[str, Any] = {}
        for name in ("readings", "gravity", "V", "dV", "time", "rotations"):
            values = getattr(self, name)
            selected[name] = None if values is None else values[which]
        return replace(self, **selected)

    def doubts(self) -> list[Doubt]:
        """Doubts about the units of the log.

        Returns
        -------
        doubts : list of Doubt, empty if all units are plausible
        """
        return self.size_doubts() + self.motion_doubts()

    def size_doubts(self) -> list[Doubt]:
        """Doubts about the units of the readings, by magnitude.

        Returns
        -------
        doubts : list of Doubt
        """
        doubts = []
        centred = self.readings - np.median(self.readings, axis=0)  # removes the bias, which may have any size
        moments, forces = centred[:, :3], centred[:, 3:]
        largest_force = float(np.abs(forces).max())
        if largest_force > MAX_FORCE:
            mass = number(largest_force / STRENGTH, 2)
            newtons_per_gram = printed(STRENGTH / 1000)
            doubts.append(doubt("sensor-force-size", force=number(largest_force), mass=mass, factor=newtons_per_gram))
        largest_moment = float(np.abs(moments).max())
        moment_norm = float(np.linalg.norm(moments))
        force_norm = float(np.linalg.norm(forces))
        if largest_moment > _MIN_DOUBTED_MOMENT and force_norm > 0.0:
            lever = moment_norm / force_norm
            if lever > MAX_LEVER:
                doubts.append(doubt("sensor-lever-size", lever=number(lever, 3)))
        return doubts

    def motion_doubts(self) -> list[Doubt]:
        """Doubts about the units of gravity and of the motion, by magnitude, and about orientations.

        Returns
        -------
        doubts : list of Doubt
        """
        doubts = []
        if self.turned > MAX_TURN:
            angle = number(np.degrees(self.turned), 2)
            doubts.append(doubt("sensor-kinematics", angle=angle, found={"value": self.turned}))
        strength = np.linalg.norm(self.gravity, axis=1)
        least, largest = _GRAVITY_RANGE
        if strength.min() < least:
            doubts.append(doubt("sensor-gravity-size", gravity=number(strength.min()), usual=STRENGTH))
        elif strength.max() > largest:
            doubts.append(doubt("sensor-gravity-size", gravity=number(strength.max()), usual=STRENGTH))
        for field, columns, limit, quantity, unit, cause in _MOTION_LIMITS:
            twists_or_rates = getattr(self, field)
            if twists_or_rates is None:
                continue
            peak = float(np.abs(twists_or_rates[:, columns]).max())
            if peak > limit:
                doubts.append(doubt("sensor-motion-size", what=quantity, reached=f"{number(peak)} {unit}", other=cause))
        return doubts

    def predicted(self, sensor: ForceTorqueSensor) -> Array:
        """Predicted readings of a sensor for the poses and motions of the log.

        Returns
        -------
        readings : (n, 6) array [N m, N]
        """
        checked_sensor(sensor, "predicted")
        no_rotation = np.eye(3)  # gravity is in {f} already
        return sensor.predict(no_rotation, self.V, self.dV, gravity=self.gravity)

    def compensated(self, sensor: ForceTorqueSensor) -> Array:
        """Gravity compensation: readings without the sensor's bias, weight and inertial load.

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


ReadingsGiven: TypeAlias = ReadingLog | str | Path
"""Log, or the path of its file; ``demo`` and ``demo-motion`` are bundled."""


def checked_log(log: Any, taker: str) -> ReadingLog:
    """Return a ReadingLog unchanged; otherwise raise :class:`~twistwrench.ShapeError` naming the caller."""
    if isinstance(log, ReadingLog):
        return log
    raise ShapeError(
        f"{taker} takes a ReadingLog, got {arguments.value_text(log)}. Make one with "
        "ReadingLog.from_arrays(readings, pose=T_wf), or read one with read_log(path)."
    )


def first_late_row(time: Array) -> int | None:
    """Index of the first time (n,) that does not exceed the time before it; None if all times increase."""
    late_rows = np.flatnonzero(np.diff(time) <= 0)
    if not late_rows.size:
        return None
    return int(late_rows[0]) + 1  # difference k is between rows k and k + 1


def _increasing_times(time: ArrayLike, count: int, name: str) -> Array:
    """Checked times (n,), which must be finite and increase."""
    t = np.array(arguments.real(time, f"{name}: time"), float)
    if t.shape != (count,) or not np.isfinite(t).all():
        raise ShapeError(f"{name}: time has shape {t.shape}, expected ({count},) finite numbers [s].")
    k = first_late_row(t)
    if k is not None:
        raise ValueRangeError(
            f"{name}: time of reading {k} is {printed(t[k])} s, not after the {printed(t[k - 1])} s of the one before. "
            "Times must increase: sort the readings, or remove the column."
        )
    return t


def _reading_rows(value: ArrayLike, count: int, width: int, what: str) -> Array:
    """Values (count, width), a row for each reading; a single row is repeated. ``what`` names them in errors."""
    rows = np.array(arguments.finite(value, what), float)
    if rows.shape == (width,):
        rows = np.tile(rows, (count, 1))
    if rows.shape != (count, width):
        raise ShapeError(f"{what} has shape {rows.shape}, expected ({count}, {width}), a row for each reading.")
    return rows


complete(globals())
