"""The header of a motion file: which column is which coordinate, velocity or acceleration."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import TrajectoryError
from .coordinates import Coordinates

Array = NDArray[Any]

__all__ = ["Columns"]

_TIME_NAMES = ("time", "t")


@dataclass(frozen=True, eq=False)
class Columns:
    """Where time, q, dq and ddq stand in the rows of a motion file."""

    header: tuple[str, ...]
    time: int
    places: dict[str, Array | None]
    """For ``q``, ``dq`` and ``ddq``: the columns in the robot's order, or None where the file has none."""
    factors: dict[str, Array]
    """What takes each of them to SI units."""
    angle: float
    """What takes the file's angles to radians."""
    of_locked: tuple[str, ...] = ()
    """Columns that belong to joints held still; they are ignored."""
    extra: tuple[str, ...] = ()
    """Columns that are nothing of this robot; they are ignored."""
    quaternions: tuple[Array, ...] = ()
    """The columns of each quaternion."""

    @classmethod
    def of(
        cls, text: str, coordinates: Coordinates, where: str, *, degrees: bool, locked: Sequence[str] = ()
    ) -> Columns:
        """From the header line; ``where`` begins the errors (:class:`~twistwrench.TrajectoryError`).

        Columns of the joints ``locked`` are ignored.
        """
        header = tuple(name.strip().strip('"').strip() for name in text.split(","))
        _check_shape(header, text, where)
        expected = {
            "q": coordinates.names,
            "dq": tuple(f"{n}.vel" for n in coordinates.velocity_names),
            "ddq": tuple(f"{n}.acc" for n in coordinates.velocity_names),
        }
        time = _time_column(header, where)
        known = {name for names in expected.values() for name in names}
        others = [name for k, name in enumerate(header) if k != time and name not in known]
        of_locked = tuple(n for n in others if any(n == j or n.startswith(f"{j}.") for j in locked))
        extra = tuple(n for n in others if n not in of_locked)
        _check_names(header, extra, expected, where)
        place = {name: k for k, name in enumerate(header)}
        angle = math.radians(1.0) if degrees else 1.0
        rates = np.where(coordinates.angular_velocity, angle, 1.0)
        return cls(
            header=header,
            time=time,
            places={
                part: np.array([place[n] for n in names], int) if names and names[0] in place else None
                for part, names in expected.items()
            },
            factors={"q": np.where(coordinates.angular, angle, 1.0), "dq": rates, "ddq": rates},
            angle=angle,
            of_locked=of_locked,
            extra=extra,
            quaternions=tuple(
                np.array([place[n] for n in coordinates.names[part]], int) for part in coordinates.quaternions
            ),
        )

    def take(self, table: Array, part: str) -> Any:
        """The columns of ``part`` (``q``, ``dq``, ``ddq``) of a table (n, columns), in SI units; None where absent."""
        where = self.places[part]
        return None if where is None else table[:, where] * self.factors[part]


def _check_shape(header: Sequence[str], text: str, where: str) -> None:
    if len(header) == 1 and (";" in text or "\t" in text or len(text.split()) > 1):
        used = "semicolons" if ";" in text else "tabs" if "\t" in text else "blanks"
        raise TrajectoryError(
            f"{where}: columns are separated by {used}. Separate them by commas, and write decimals with a point (0.5)."
        )
    if all(_is_number(name) for name in header):
        raise TrajectoryError(
            f"{where}: the header is missing; the first line has numbers. Name the columns: time, then joints."
        )
    if "" in header:
        raise TrajectoryError(
            f"{where}: column {header.index('') + 1} has no name. Name every column, and end no line in a comma."
        )
    for name in header:
        if header.count(name) > 1:
            raise TrajectoryError(f"{where}: column {name!r} is there {header.count(name)} times. Keep one of them.")


def _time_column(header: Sequence[str], where: str) -> int:
    found = [k for k, name in enumerate(header) if name.lower() in _TIME_NAMES]
    if not found:
        raise TrajectoryError(
            f"{where}: no time column. Name one column 'time' (or 't'), in seconds; found {_listed(header)}."
        )
    if len(found) > 1:
        raise TrajectoryError(f"{where}: two time columns, {_listed([header[k] for k in found])}. Keep one of them.")
    return found[0]


def _check_names(
    given: Sequence[str], unknown: Sequence[str], expected: dict[str, tuple[str, ...]], where: str
) -> None:
    missing = [name for name in expected["q"] if name not in given]
    listed = f"Expected: {_listed(expected['q'])}, and for all of them or none '.vel' and '.acc' columns."
    if missing:
        hint = next((_alike(name, missing) for name in unknown if _alike(name, missing)), "")
        raise TrajectoryError(
            f"{where}: no column for {_listed(missing)}.{hint} {listed} A joint that never moves can be locked (--lock)."
        )
    for part in ("dq", "ddq"):
        absent = [name for name in expected[part] if name not in given]
        if absent and len(absent) < len(expected[part]):
            hint = next((_alike(name, absent) for name in unknown if _alike(name, absent)), "")
            raise TrajectoryError(
                f"{where}: no column {_listed(absent)}, although others of its kind are there.{hint} "
                "Give them for every joint, or for none: then they are derived."
            )


def _alike(name: str, choices: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, choices, n=1, cutoff=0.6)
    return f" Column {name!r} is no joint of this robot. Did you mean {near[0]!r}?" if near else ""


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _listed(names: Sequence[str], most: int = 12) -> str:
    rest = f", … ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(names[:most]) + rest
