"""Measurements of an arm's tip: joint positions with poses, positions, distances or touches, from arrays or CSV files."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from ..core import arguments
from ..core.errors import ModelError, NotFoundError, TrajectoryError, UnknownNameError, ValueRangeError
from ..core.files import as_path
from ..core.numbers import number, printed
from ..core.text import Argument, argument, listed, spell
from ..core.typing import Array
from ..mechanics.lie import quaternion, se3, so3
from ..motion.column_names import split_unit, unit_factor
from ..motion.columns import Assignment, Choice, Reading, check_header
from ..motion.coordinates import Coordinates
from ..motion.readers.csv_reader import CsvFile
from ..robot import Robot
from ..robots.finding import bundled_file
from .chain import TipChain

ReadingKind = Literal["pose", "position", "distance", "pair", "point", "plane", "sphere"]
"""Kinds of readings."""
KINDS: tuple[ReadingKind, ...] = get_args(ReadingKind)
TOUCHES = ("point", "plane", "sphere")
LENGTHS_MEASURED = ("pose", "position", "distance", "pair")
"""Kinds whose readings are lengths."""
MIN_CONFIGURATIONS = 3
"""Smallest number of configurations."""
MAX_VALUE = 1e6
"""Largest joint position and reading, in any unit that files have."""
MAX_JOINT_DIFFERENCE = 1e-9
"""Largest difference of the joints at one configuration [rad, m]."""


def length_and_angle(values: float | tuple[float, float] | Array, name: str) -> tuple[float, float]:
    """Two positive numbers, for lengths [m] and angles [rad], from two or from one for both."""
    length, angle = [arguments.positive(x, name) for x in np.broadcast_to(values, 2).tolist()]
    return length, angle


@dataclass(frozen=True, eq=False, kw_only=True)
class Measurements:
    """Configurations of the joints, and readings of the tip there.

    Raises
    ------
    ShapeError, UnknownNameError, ValueRangeError
        The arrays do not belong together, or contain numbers that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> m = Measurements(np.zeros((4, 6)), positions=np.ones((4, 3)))
    >>> m.kind, len(m), m.count, m.taken(np.array([0, 2])).count
    ('position', 4, 4, 2)
    """

    q: Array = field(kw_only=False)
    """(n, nq) configurations [rad or m]."""
    poses: Array | None = None
    """(n, 4, 4) poses of the target in the tracker's frame."""
    positions: Array | None = None
    """(n, 3) positions of the target in the tracker's frame [m]."""
    distances: Array | None = None
    """(n,) distances from a fixed point, or (k,) between the tips of each pair [m]."""
    pairs: Array | None = None
    """(k, 2) rows of q whose tips are that far apart."""
    targets: Sequence[str] | None = None
    """Names of the touched points, planes or spheres by row; one target without them."""
    kind: str | None = None
    """Kind of the readings: pose, position, distance, pair, point, plane or sphere; only touches need it."""
    noise: float | tuple[float, float] | None = None
    """Standard deviation of a reading [m], or also [rad]; None if estimated."""
    length: float | None = None
    """Known length of touches [m]: distance of two points or planes, or diameter of a sphere."""
    path: str = ""
    """Path of the file; empty for arrays."""
    notes: tuple[str, ...] = ()
    """Sentences about the file."""
    board_in_camera: bool = False
    """True for columns that are named so: a camera, on either side, measured a board."""

    def __post_init__(self) -> None:
        q = np.atleast_2d(arguments.finite(self.q, "q"))
        given = {"pose": self.poses, "position": self.positions, "pair": self.pairs, "distance": self.distances}
        kind = self.kind or next((name for name, values in given.items() if values is not None), "")
        if kind not in KINDS:
            raise UnknownNameError.from_choices("kind of measurement", kind, KINDS)
        values: dict[str, object] = {"q": q, "kind": kind}
        if self.poses is not None:
            values["poses"] = arguments.pose(self.poses, "poses")
        for name, shape in (("positions", (3,)), ("distances", ())):
            if getattr(self, name) is not None:
                values[name] = arguments.finite(getattr(self, name), name, *shape)
        if self.pairs is not None:
            values["pairs"] = np.asarray(self.pairs, int).reshape(-1, 2)
        if self.targets is not None:
            values["targets"] = tuple(map(str, self.targets))
        if self.noise is not None:
            values["noise"] = length_and_angle(self.noise, "noise")
        if self.length is not None:
            values["length"] = arguments.positive(self.length, "length", "m")
        for name, value in values.items():
            object.__setattr__(self, name, value)
        self._check()

    def _check(self) -> None:
        """Raise ValueRangeError if the arrays do not belong together."""
        n, kind, distances = len(self.q), self.kind, self.distances
        wanted = {"pose": n, "position": n, "distance": n, "pair": 0 if self.pairs is None else len(self.pairs)}
        given = {"pose": self.poses, "position": self.positions}.get(str(kind), distances)
        if kind in wanted and (given is None or len(given) != wanted[str(kind)]):
            has = 0 if given is None else len(given)
            raise ValueRangeError(f"kind {kind} has {has} readings for {wanted[str(kind)]}. Give one for each.")
        for name in ("q", "positions", "distances"):
            if getattr(self, name) is None:
                continue
            values = np.abs(getattr(self, name))
            if values.size and values.max() > MAX_VALUE:
                row = int(np.unravel_index(values.argmax(), values.shape)[0])
                raise ValueRangeError(
                    f"{name}[{row}] has {printed(values.max())}. Give at most {printed(MAX_VALUE)} rad or m."
                )
        if self.targets is not None and len(self.targets) != n:
            raise ValueRangeError(f"{len(self.targets)} targets for {n} configurations. Give one for each.")
        if self.pairs is not None and self.pairs.size and not (self.pairs.min() >= 0 and self.pairs.max() < n):
            raise ValueRangeError(f"pairs names rows outside 0 … {n - 1}. Count the rows from 0.")
        if self.pairs is not None and self.pairs.size:
            equal = np.abs(self.q[self.pairs[:, 0]] - self.q[self.pairs[:, 1]]).max(axis=1) <= MAX_JOINT_DIFFERENCE
            if equal.any():
                first, second = self.pairs[int(equal.argmax())]
                raise ValueRangeError(
                    f"rows {first} and {second} are a pair at one configuration, whose tips have no distance. Give two."
                )
        if distances is not None and kind in TOUCHES:
            raise ValueRangeError(f"kind {kind} has no distances. Remove them, or the kind.")
        if distances is not None and not (distances > 0).all():
            row = int(np.flatnonzero(~(distances > 0))[0])
            raise ValueRangeError(f"distance {row} is {printed(distances[row])} m. Distances are above 0.")
        if self.length is not None and kind not in TOUCHES:
            raise ValueRangeError(f"readings of kind {kind} contain lengths already. Remove {argument('length')}.")
        if self.length is not None and kind != "sphere" and len(self.target_names) != 2:
            raise ValueRangeError(
                f"{argument('length')} is the distance of two {kind}s, and there are {len(self.target_names)}. "
                "Name the target of each row."
            )

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        robot: Robot,
        *,
        kind: str | None = None,
        columns: Mapping[str, str] | None = None,
        degrees: bool = False,
        tip: str | None = None,
    ) -> Measurements:
        """Read a CSV file with the joints' positions and the readings.

        Parameters
        ----------
        path : str or Path
        robot : Robot
        kind : str, optional; default: by the columns
        columns : {joint: column}, optional; default: by name
        degrees : bool, joint positions and angles without a unit are in degrees
        tip : str, optional, frame whose joints must be there; default: the tip

        Returns
        -------
        measurements : Measurements

        Raises
        ------
        NotFoundError, TrajectoryError, ValueRangeError
            The file cannot be read; the message has line and column.

        Examples
        --------
        >>> import twistwrench as tw
        >>> m = tw.calibration.Measurements.from_file("demo", tw.robots.ur5())
        >>> m.kind, m.positions.shape
        ('position', (40, 3))
        """
        return _MeasurementFile(path, robot, tip, kind, dict(columns or {}), degrees=degrees).read()

    # ── Readings

    @cached_property
    def target_names(self) -> tuple[str, ...]:
        """Names of the targets, in order of appearance."""
        return tuple(dict.fromkeys(self.targets or ())) or ("",)

    @cached_property
    def target_index(self) -> Array:
        """(n,) index of each row's target."""
        known = self.target_names
        return np.array([known.index(name) for name in self.targets or ()] or [0] * len(self), int)

    @property
    def count(self) -> int:
        """Number of readings: rows, or pairs."""
        if self.pairs is None:
            return len(self)
        return len(self.pairs)

    @property
    def points(self) -> Array:
        """(n, 3) measured positions [m], also of poses."""
        if self.poses is not None:
            return np.asarray(self.poses[:, :3, 3])
        if self.positions is None:
            return np.zeros((0, 3))
        return self.positions

    @property
    def rotations(self) -> Array:
        """(n, 3, 3) measured orientations; empty for kinds other than poses."""
        if self.poses is None:
            return np.zeros((0, 3, 3))
        return np.asarray(self.poses[:, :3, :3])

    @property
    def sizes(self) -> Array:
        """(n,) or (k,) measured distances [m]; empty for other kinds."""
        if self.distances is None:
            return np.zeros(0)
        return self.distances

    @property
    def rows_each(self) -> int:
        """Number of equations of a reading."""
        return {"pose": 6, "position": 3, "point": 3}.get(str(self.kind), 1)

    @property
    def angle_rows(self) -> int:
        """Number of equations of a reading in rad; they come first."""
        if self.kind == "pose":
            return 3
        return 0

    @property
    def is_scaleless(self) -> bool:
        """True for touches without a known length."""
        return self.kind in TOUCHES and self.length is None

    def taken(self, kept: Array) -> Measurements:
        """Some of the readings.

        Parameters
        ----------
        kept : (k,) array of indices, or (count,) of bool

        Returns
        -------
        measurements : Measurements
        """
        if self.pairs is not None:
            return replace(self, pairs=self.pairs[kept], distances=self.sizes[kept])
        selected: dict[str, Any] = {}
        for name in ("q", "poses", "positions", "distances"):
            readings = getattr(self, name)
            if readings is not None:
                selected[name] = readings[kept]
        if self.targets is not None:
            selected["targets"] = tuple(np.array(self.targets, object)[kept])
        return replace(self, **selected)


# ── Columns of a file

_QUATERNION = ("qw", "qx", "qy", "qz")
_VECTOR = ("rx", "ry", "rz")
_ROLL = ("roll", "pitch", "yaw")
_MATRIX = tuple(f"r{row}{column}" for row in "123" for column in "123")
_POINT = ("x", "y", "z")
_ORIENTATIONS = (_QUATERNION, _VECTOR, _ROLL, _MATRIX)
_READINGS = {*_POINT, *_QUATERNION, *_VECTOR, *_ROLL, *_MATRIX, "distance", "pair", "target"}
_CAMERA = re.compile(r"board_in_camera_", re.IGNORECASE)
_ROTATION = 1e-3
"""Tolerance of entries of rotation matrices, and of lengths of quaternions."""


@dataclass(frozen=True, eq=False)
class _MeasurementFile:
    """CSV file of measurements of a robot, and the options of its reading."""

    given: str | Path
    robot: Robot
    tip: str | None
    kind: str | None
    columns: dict[str, str]
    degrees: bool

    @property
    def path(self) -> Path:
        """Path of the file, or of the bundled one."""
        return as_path(bundled_file(str(self.given), self.robot.model.name, "_calibration.csv", "measurement"))

    @cached_property
    def file(self) -> CsvFile:
        """File with its header."""
        file = CsvFile.open(self.path)
        check_header(file.header, f"{self.path}: line {file.header_line}")
        return file

    @cached_property
    def names(self) -> list[tuple[str, str | None]]:
        """Name of a reading and unit of each column; of others an empty name."""
        names = []
        for cell in self.file.header:
            name, unit = split_unit(_CAMERA.sub("", cell))
            name = name.lower()
            if name not in _READINGS:
                name = ""
            names.append((name, unit))
        return names

    def read(self) -> Measurements:
        """Measurements of the file."""
        rows = [cells for _, cells in self.file.rows()]
        if not rows:
            raise ValueRangeError(
                f"{self.path}: no readings below the header. Give at least {MIN_CONFIGURATIONS} rows."
            )
        has = {name for name, _ in self.names if name}
        kind = self.kind or self._kind(has)
        needed = {"pose": _POINT, "position": _POINT, "distance": ("distance",), "pair": ("distance", "pair")}.get(
            kind, ()
        )
        missing = [name for name in needed if name not in has]
        if missing:
            raise ValueRangeError(
                f"{self.path}: kind {kind} needs the columns {listed(missing)}. Found: {listed(self.file.header)}."
            )
        if kind in TOUCHES and "distance" in has:
            raise ValueRangeError(
                f"{self.path}: kind {kind} with a column 'distance'. Remove the column, or {spell(Argument('kind', kind))}."
            )
        targets = list[str]()
        poses: Array | None = None
        positions: Array | None = None
        distances: Array | None = None
        if "target" in has:
            place = self._place("target")
            targets = [cells[place] for cells in rows]
        if kind == "pose":
            rotations = self._rotations(has)
            poses = np.asarray(se3.pose(rotations, self._values(_POINT, "q", angular=False)))
        elif kind == "position":
            positions = self._values(_POINT, "q", angular=False)
        elif kind in ("distance", "pair"):
            distances = self._values(["distance"], "q", angular=False)[:, 0]
        q, notes = self._configurations(len(rows))
        pairs = None
        if kind == "pair":
            partner = self.file.table([self._place("pair")])[:, 0].astype(int)
            both = np.sort(np.c_[np.arange(len(rows)), partner], axis=1)
            pairs, first = np.unique(both[both[:, 0] != both[:, 1]], axis=0, return_index=True)
            distances = np.asarray(distances)[both[:, 0] != both[:, 1]][first]
        return Measurements(
            q, kind=kind, poses=poses, positions=positions, distances=distances, pairs=pairs,
            targets=targets or None, path=str(self.path), notes=notes,
            board_in_camera=any(_CAMERA.match(cell) for cell in self.file.header),
        )  # fmt: skip

    def _kind(self, has: set[str]) -> str:
        """Kind by the columns."""
        if "distance" in has:
            if "pair" in has:
                return "pair"
            return "distance"
        if has.issuperset(_POINT):
            if any(map(has.issuperset, _ORIENTATIONS)):
                return "pose"
            return "position"
        if "target" in has:
            raise ValueRangeError(
                f"{self.path}: the column 'target' needs the kind of touch, {spell(Argument('kind'))}: {listed(TOUCHES)}."
            )
        raise ValueRangeError(
            f"{self.path}: no reading in the columns {listed(self.file.header)}. Give x, y, z, perhaps with qw, qx, qy, qz; or "
            f"distance; or {spell(Argument('kind'))} for touches: {listed(TOUCHES)}."
        )

    def _place(self, name: str) -> int:
        """Column of a reading."""
        places = [k for k, (known, _) in enumerate(self.names) if known == name]
        if len(places) != 1:
            raise ValueRangeError(f"{self.path}: {len(places)} columns {name!r}. Give one.")
        return places[0]

    def _values(self, names: Sequence[str], part: str, *, angular: bool, unitless: bool = False) -> Array:
        """Columns (n, k) in SI units; raises for numbers that are not finite."""
        places = [self._place(name) for name in names]
        table = self.file.table(places)
        for k, place in enumerate(places):
            unit, cell = self.names[place][1], self.file.header[place]
            if unit is not None and not unitless:
                table[:, k] *= unit_factor(unit, part, angular, f"{self.path}, column {cell!r}")
            elif angular and self.degrees:
                table[:, k] *= math.radians(1.0)
            self._check_finite(table[:, k], cell)
        return table

    def _check_finite(self, column: Array, cell: str) -> None:
        if not np.isfinite(column).all():
            row = int(np.flatnonzero(~np.isfinite(column))[0])
            raise ValueRangeError(
                f"{self.path}: {self.file.place(row)}, column {cell!r} is not finite. Remove the row."
            )

    def _rotations(self, has: set[str]) -> Array:
        """(n, 3, 3) orientations."""
        found = [names for names in _ORIENTATIONS if has.issuperset(names)]
        if len(found) != 1:
            raise ValueRangeError(
                f"{self.path}: {len(found)} orientations. Give one: qw, qx, qy, qz; rx, ry, rz; roll, pitch, yaw; r11 … r33."
            )
        names = found[0]
        values = self._values(names, "q", angular=names in (_VECTOR, _ROLL), unitless=names in (_QUATERNION, _MATRIX))
        if names == _VECTOR:
            return np.asarray(so3.exp(values))
        if names == _ROLL:
            return rotations_from_roll(values)
        if names == _QUATERNION:
            size = np.linalg.norm(values, axis=1)
            self._check_rows(np.abs(size - 1.0), "quaternion does not have the length 1")
            return np.asarray(quaternion.rotation(values / size[:, None]))
        R = values.reshape(-1, 3, 3)
        self._check_rows(np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2)), "matrix is not a rotation")
        return np.asarray(so3.project(R))

    def _check_rows(self, off: Array, problem: str) -> None:
        if not (off <= _ROTATION).all():
            row = int(np.flatnonzero(~(off <= _ROTATION))[0])
            raise ValueRangeError(
                f"{self.path}: {self.file.place(row)}: the {problem}, off by {number(off[row], 3)}. Correct the row."
            )

    def _configurations(self, count: int) -> tuple[Array, tuple[str, ...]]:
        """(n, nq) configurations; joints that do not move the tip may be missing."""
        coordinates = Coordinates.from_model(self.robot.model)
        try:
            needed = TipChain.from_robot(self.robot, self.tip).columns
        except ModelError:
            if self.tip is not None:
                raise
            needed = list(range(self.robot.nq))
        cells = ["" if name else cell for cell, (name, _) in zip(self.file.header, self.names, strict=True)]
        reading = Reading(self.path, self.columns, degrees=self.degrees)
        found = Assignment(cells, str(self.path), coordinates, reading)
        names: dict[str, tuple[str, ...]] = dict.fromkeys(found.names, ())
        names["q"] = tuple(coordinates.names[k] for k in needed)
        found.names = names
        for (part, k), choice in found.requested_choices(self.columns).items():
            found.assign(part, k, choice)
        found.assign_by_exact_name()
        found.assign_by_words()
        if len(found.given["q"]) < len(needed):
            found.assign_by_rules([])
        missing = [coordinates.names[k] for place, k in enumerate(needed) if place not in found.given["q"]]
        if missing:
            raise TrajectoryError(
                f"{self.path}: no column for {listed(missing)} on the way to the tip; {found.found_text()}"
            )
        q = np.tile(self.robot.model.neutral, (count, 1))
        for place, choice in found.given["q"].items():
            k = needed[place]
            column = self.file.table([choice.column])[:, 0]
            self._check_finite(column, self.file.header[choice.column])
            q[:, k] = column * found.factor(Choice(choice.column, choice.unit), "q", bool(coordinates.angular[k]))
        return q, tuple(map(str, found.notes))


def rotations_from_roll(angles: Array) -> Array:
    """Rotations (n, 3, 3) Rz(yaw) Ry(pitch) Rx(roll)."""
    turns = angles[:, :, None] * np.eye(3)  # one around each axis
    x, y, z = np.moveaxis(np.asarray(so3.exp(turns)), 1, 0)
    return np.asarray(z @ y @ x)


def read_measurements(
    given: str | Path | Measurements, robot: Robot, kind: str | None, tip: str | None, *, degrees: bool = False
) -> Measurements:
    """Measurements from a path or as they are. Raises NotFoundError and others of :meth:`Measurements.from_file`."""
    if isinstance(given, Measurements):
        return given
    if not isinstance(given, str | Path):
        raise NotFoundError(
            f"{arguments.value_text(given)} is not a file of measurements. Give a path, or Measurements(q, positions=…)."
        )
    return Measurements.from_file(given, robot, kind=kind, tip=tip, degrees=degrees)
