"""Which column of a motion file is which coordinate, velocity, acceleration or torque, in which unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..typing import Array
from .column_choice import choose
from .column_units import time_factor, unit_factor
from .coordinates import Coordinates, Follower
from .follower_columns import FollowerColumn
from .header import Choice


@dataclass(frozen=True, eq=False)
class Columns:
    """Where time, q, dq, ddq and torques stand in the table of a motion file, which has the used columns only."""

    header: tuple[str, ...]
    """Of the table."""
    used: tuple[int, ...]
    """Which columns of the file these are; without a time column the table's first is none of them, but counts rows."""
    time: int
    """The column of time [s]."""
    seconds: float
    """What takes the file's time, or the row's number, to seconds."""
    counted: bool
    """Whether time is the row's number, as there is no column of it."""
    time_stated: bool
    """Whether the file, or whoever reads it, says the unit of time."""
    places: dict[str, Array | None]
    """For ``q``, ``dq``, ``ddq``, ``tau``: the columns in the robot's order, or None where the file has none."""
    factors: dict[str, Array]
    """What takes each of them to SI units."""
    angle: Array
    """(nq,) what takes the file's angles to radians; 1 where the coordinate is none."""
    angle_stated: Array
    """(nq,) bool: the column's name, or whoever reads it, says its unit."""
    of_locked: tuple[str, ...] = ()
    """Columns that belong to joints held still; they are ignored."""
    extra: tuple[str, ...] = ()
    """Columns that are nothing of this robot; they are ignored."""
    quaternions: tuple[Array, ...] = ()
    """The columns of each quaternion."""
    notes: tuple[str, ...] = ()
    """A sentence for each thing that was taken to be meant."""
    followers: tuple[FollowerColumn, ...] = ()
    """Columns of mimic joints, which ought to be as their leaders' say."""

    @classmethod
    def of(
        cls,
        header: Sequence[str],
        coordinates: Coordinates,
        where: str,
        *,
        degrees: bool = False,
        locked: Sequence[str] = (),
        columns: Mapping[str, str] | None = None,
        rate: float | None = None,
        look: Callable[[int], Array] = lambda _column: np.zeros(0),
    ) -> Columns:
        """From the header's cells; ``where`` begins the errors (:class:`~twistwrench.TrajectoryError`).

        ``columns`` says which column is which (``{"elbow": "pos3", "elbow.vel": "w3", "time": "stamp [ms]"}``), all others
        are found by their names. ``rate`` [Hz] takes the place of a column of time. Columns of the joints ``locked`` are
        ignored. ``look`` gives the first numbers of a column, where its name alone does not say its unit.
        """
        chosen = choose(header, coordinates, where, locked=locked, columns=columns or {}, rate=rate, look=look)
        used = [
            *([chosen.time.column] if chosen.time else []),
            *(c.column for part in chosen.parts.values() for c in part),
            *(c.column for c in chosen.followers.values()),
        ]
        place = {column: k for k, column in enumerate(used)}
        names = [header[k] for k in used]
        if chosen.time is None:
            place, names = {column: k + 1 for column, k in place.items()}, ["time", *names]
        unit = None if chosen.time is None else chosen.time.unit
        return cls(
            header=tuple(names),
            used=tuple(used),
            time=0,
            seconds=1.0 / rate if rate else (time_factor(unit) or 1.0) if unit else 1.0,
            counted=chosen.time is None,
            time_stated=rate is not None or unit is not None,
            places={
                part: np.array([place[c.column] for c in found], int) if found else None
                for part, found in chosen.parts.items()
            },
            factors={
                part: _factors(part, found, coordinates, header, where, degrees=degrees)
                for part, found in chosen.parts.items()
            },
            angle=np.where(
                coordinates.angular, _factors("q", chosen.parts["q"], coordinates, header, where, degrees=degrees), 1.0
            ),
            angle_stated=np.array([choice.unit is not None for choice in chosen.parts["q"]], bool),
            of_locked=chosen.of_locked,
            extra=chosen.extra,
            quaternions=tuple(
                np.array([place[c.column] for c in chosen.parts["q"][part]], int) for part in coordinates.quaternions
            ),
            notes=chosen.notes,
            followers=tuple(
                FollowerColumn(
                    coordinates.followers[k],
                    place[c.column],
                    _factor_of(coordinates.followers[k], c, header, where, degrees),
                )
                for k, c in chosen.followers.items()
            ),
        )

    def take(self, table: Array, part: str) -> Any:
        """The columns of ``part`` (``q``, ``dq``, ``ddq``, ``tau``) of a table (n, columns), in SI units; None if absent."""
        where = self.places[part]
        return None if where is None else table[:, where] * self.factors[part]


def _factor_of(follower: Follower, choice: Choice, header: Sequence[str], where: str, degrees: bool) -> float:
    """What takes the column of a mimic joint to SI units."""
    if choice.unit is not None:
        return unit_factor(choice.unit, "q", follower.angular, f"{where}, column {header[choice.column]!r}")
    return math.radians(1.0) if degrees and follower.angular else 1.0


def _factors(
    part: str, found: Sequence[Choice], coordinates: Coordinates, header: Sequence[str], where: str, *, degrees: bool
) -> Array:
    """What takes the columns found for a part to SI units: the unit that each says, else ``degrees``."""
    angular = coordinates.angular if part == "q" else coordinates.angular_velocity
    usual = np.where(angular, math.radians(1.0) if degrees and part != "tau" else 1.0, 1.0)
    for k, choice in enumerate(found):
        if choice.unit is not None:
            usual[k] = unit_factor(choice.unit, part, bool(angular[k]), f"{where}, column {header[choice.column]!r}")
    return usual
