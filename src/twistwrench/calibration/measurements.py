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
"""Kinds whose readings are configurations in which the tip touches a target."""
LENGTHS_MEASURED = ("pose", "position", "distance", "pair")
"""Kinds whose readings are lengths."""
MIN_CONFIGURATIONS = 3
"""Smallest number of configurations."""
MAX_VALUE = 1e6
"""Largest joint position and reading, in any unit that files have."""
MAX_JOINT_DIFFERENCE = 1e-9
"""Largest difference of the joints at one configuration [rad, m]."""


def length_and_angle(values: float | tuple[float, float] | Array, name: str) -> tuple[float, float]:
    """Positive numbers for lengths [m] and angles [rad], from two numbers, or from one for both."""
    length, angle = np.broadcast_to(values, 2).tolist()
    return arguments.positive(length, name), arguments.positive(angle, name)


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
    """(k, 2) rows of q of each pair."""
    targets: Sequence[str] | None = None
    """Name of the touched point, plane or sphere for each row; without names there is one target."""
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
        kind = self.kind
        if not kind:
            kind = self._kind_of_arrays()
        if kind not in KINDS:
            raise UnknownNameError.from_choices("kind of measurement", kind, KINDS)
        fields: dict[str, object] = {"q": q, "kind": kind}
        if self.poses is not None:
            fields["poses"] = arguments.pose(self.poses, "poses")
        if self.positions is not None:
            fields["positions"] = arguments.finite(self.positions, "positions", 3)
        if self.distances is not None:
            fields["distances"] = arguments.finite(self.distances, "distances")
        if self.pairs is not None:
            fields["pairs"] = np.asarray(self.pairs, int).reshape(-1, 2)
        if self.targets is not None:
            fields["targets"] = tuple(map(str, self.targets))
        if self.noise is not None:
            fields["noise"] = length_and_angle(self.noise, "noise")
        if self.length is not None:
            fields["length"] = arguments.positive(self.length, "length", "m")
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        self._check_counts()
        self._check_sizes()
        self._check_pairs()
        self._check_distances()
        self._check_length()

    def _kind_of_arrays(self) -> str:
        """Kind of the readings by the arrays that are given; empty without readings."""
        # "pair" stands before "distance", since pairs have distances too.
        arrays = {"pose": self.poses, "position": self.positions, "pair": self.pairs, "distance": self.distances}
        for kind, array in arrays.items():
            if array is not None:
                return kind
        return ""

    def _check_counts(self) -> None:
        """Raise ValueRangeError if there is not one reading for each configuration or pair."""
        expected_count = len(self.q)
        readings = self.distances
        if self.kind == "pose":
            readings = self.poses
        elif self.kind == "position":
            readings = self.positions
        elif self.kind == "pair":
            expected_count = 0 if self.pairs is None else len(self.pairs)
        if self.kind in LENGTHS_MEASURED and (readings is None or len(readings) != expected_count):
            count = 0 if readings is None else len(readings)
            raise ValueRangeError(f"kind {self.kind} has {count} readings for {expected_count}. Give one for each.")

    def _check_sizes(self) -> None:
        """Raise ValueRangeError for numbers that are too large in any unit."""
        for name in ("q", "positions", "distances"):
            if getattr(self, name) is None:
                continue
            sizes = np.abs(getattr(self, name))
            if sizes.size and sizes.max() > MAX_VALUE:
                row, *_ = np.unravel_index(sizes.argmax(), sizes.shape)
                raise ValueRangeError(
                    f"{name}[{row}] has {printed(sizes.max())}. Give at most {printed(MAX_VALUE)} rad or m."
                )

    def _check_pairs(self) -> None:
        """Raise ValueRangeError if targets or pairs do not belong to the configurations."""
        n = len(self.q)
        if self.targets is not None and len(self.targets) != n:
            raise ValueRangeError(f"{len(self.targets)} targets for {n} configurations. Give one for each.")
        if self.pairs is None or not self.pairs.size:
            return
        if self.pairs.min() < 0 or self.pairs.max() >= n:
            raise ValueRangeError(f"pairs names rows outside 0 … {n - 1}. Count the rows from 0.")
        first_rows, second_rows = self.pairs.T
        differences = np.abs(self.q[first_rows] - self.q[second_rows]).max(axis=1)
        is_one_configuration = differences <= MAX_JOINT_DIFFERENCE
        if is_one_configuration.any():
            first, second = self.pairs[int(is_one_configuration.argmax())]
            raise ValueRangeError(
                f"rows {first} and {second} are a pair at one configuration, whose tips have no distance. Give two."
            )

    def _check_distances(self) -> None:
        """Raise ValueRangeError for distances that are not positive, and for distances of touches."""
        distances = self.distances
        if distances is None:
            return
        if self.kind in TOUCHES:
            raise ValueRangeError(f"kind {self.kind} has no distances. Remove them, or the kind.")
        is_positive = distances > 0
        if not is_positive.all():
            row = int(np.flatnonzero(~is_positive)[0])
            raise ValueRangeError(f"distance {row} is {printed(distances[row])} m. Distances are above 0.")

    def _check_length(self) -> None:
        """Raise ValueRangeError if the known length has no meaning for the readings."""
        if self.length is None:
            return
        if self.kind not in TOUCHES:
            raise ValueRangeError(f"readings of kind {self.kind} contain lengths already. Remove {argument('length')}.")
        if self.kind != "sphere" and len(self.target_names) != 2:
            raise ValueRangeError(
                f"{argument('length')} is the distance of two {self.kind}s, and there are {len(self.target_names)}. "
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
        """Names of the targets, in order of appearance; one empty name without targets."""
        if not self.targets:
            return ("",)
        return tuple(dict.fromkeys(self.targets))

    @cached_property
    def target_index(self) -> Array:
        """(n,) index of each row's target."""
        if not self.targets:
            return np.zeros(len(self), int)
        return np.array([self.target_names.index(name) for name in self.targets], int)

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
        """Rows of each reading: number of its equations."""
        return {"pose": 6, "position": 3, "point": 3}.get(str(self.kind), 1)

    @property
    def angle_rows(self) -> int:
        """Number of a reading's equations in rad, which come first."""
        if self.kind == "pose":
            return 3
        return 0

    @property
    def is_scaleless(self) -> bool:
        """True for touches without a known length."""
        return self.kind in TOUCHES and self.length is None

    def taken(self, kept: Array) -> Measurements:
        """Measurements with some of the readings only.

        Parameters
        ----------
        kept : (k,) array of indices of readings, or (count,) mask of readings

        Returns
        -------
        measurements : Measurements
        """
        if self.pairs is not None:
            return replace(self, pairs=self.pairs[kept], distances=self.sizes[kept])
        selected_fields: dict[str, Any] = {}
        for name in ("q", "poses", "positions", "distances"):
            readings = getattr(self, name)
            if readings is not None:
                selected_fields[name] = readings[kept]
        if self.targets is not None:
            selected_fields["targets"] = tuple(np.array(self.targets, object)[kept])
        return replace(self, **selected_fields)


# ── Columns of a file

# Names of columns.
_QUATERNION = ("qw", "qx", "qy", "qz")
_ROTATION_VECTOR = ("rx", "ry", "rz")
_ROLL_PITCH_YAW = ("roll", "pitch", "yaw")
_MATRIX = tuple(f"r{row}{column}" for row in "123" for column in "123")
_POINT = ("x", "y", "z")
_ORIENTATIONS = (_QUATERNION, _ROTATION_VECTOR, _ROLL_PITCH_YAW, _MATRIX)
_READINGS = {name for names in _ORIENTATIONS for name in names} | {*_POINT, "distance", "pair", "target"}
"""Names of columns of readings."""
_CAMERA_PREFIX = re.compile(r"board_in_camera_", re.IGNORECASE)
"""Prefix of columns of a camera that measured a board."""
_MAX_ROTATION_ERROR = 1e-3
"""Tolerance of entries of rotation matrices, and of lengths of quaternions."""
_COLUMNS_OF_KIND = {
    "pose": _POINT,
    "position": _POINT,
    "distance": ("distance",),
    "pair": ("distance", "pair"),
}
"""Columns that a kind of readings needs; poses need an orientation besides."""


@dataclass(frozen=True, eq=False)
class _MeasurementFile:
    """CSV file of measurements of a robot, and the options of its reading."""

    given: str | Path
    """Given path, or name of a bundled file."""
    robot: Robot
    tip: str | None
    kind: str | None
    """Kind of the readings; None: by the columns."""
    columns: dict[str, str]
    """Columns of joints whose name is not the joint's, by joint."""
    degrees: bool
    """True if angles without a unit are in degrees."""

    @property
    def path(self) -> Path:
        """Path of the file, which may be bundled."""
        return as_path(bundled_file(str(self.given), self.robot.model.name, "_calibration.csv", "measurement"))

    @cached_property
    def file(self) -> CsvFile:
        """File with its header."""
        file = CsvFile.open(self.path)
        check_header(file.header, f"{self.path}: line {file.header_line}")
        return file

    @cached_property
    def names(self) -> list[tuple[str, str | None]]:
        """Name of the reading and unit of each column; the name is empty for columns of other quantities."""
        names = []
        for cell in self.file.header:
            name, unit = split_unit(_CAMERA_PREFIX.sub("", cell))
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
        readings = {name for name, _ in self.names if name}
        kind = self.kind
        if not kind:
            kind = self._kind(readings)
        missing = [name for name in _COLUMNS_OF_KIND.get(kind, ()) if name not in readings]
        if missing:
            raise ValueRangeError(
                f"{self.path}: kind {kind} needs the columns {listed(missing)}. Found: {listed(self.file.header)}."
            )
        if kind in TOUCHES and "distance" in readings:
            raise ValueRangeError(
                f"{self.path}: kind {kind} with a column 'distance'. Remove the column, or {spell(Argument('kind', kind))}."
            )
        targets = list[str]()
        poses: Array | None = None
        positions: Array | None = None
        distances: Array | None = None
        if "target" in readings:
            target_column = self._column("target")
            targets = [cells[target_column] for cells in rows]
        if kind == "pose":
            rotations = self._rotations(readings)
            points = self._values(_POINT, "q", angular=False)
            poses = np.asarray(se3.pose(rotations, points))
        elif kind == "position":
            positions = self._values(_POINT, "q", angular=False)
        elif kind in ("distance", "pair"):
            (distances,) = self._values(["distance"], "q", angular=False).T
        q, notes = self._configurations(len(rows))
        pairs = None
        if kind == "pair" and distances is not None:
            pairs, distances = self._pairs(distances)
        board_in_camera = any(_CAMERA_PREFIX.match(cell) for cell in self.file.header)
        return Measurements(
            q, kind=kind, poses=poses, positions=positions, distances=distances, pairs=pairs,
            targets=targets or None, path=str(self.path), notes=notes, board_in_camera=board_in_camera,
        )  # fmt: skip

    def _pairs(self, distances: Array) -> tuple[Array, Array]:
        """(k, 2) rows of each pair, and the distance (k,) of each pair, from the distances (n,) of all rows.

        Both rows of a pair name each other; rows that name themselves are left out.
        """
        (column,) = self.file.table([self._column("pair")]).T
        partner = column.astype(int)  # (n,), row
        pair_of_row = np.sort(np.c_[np.arange(len(partner)), partner], axis=1)
        has_partner = pair_of_row[:, 0] != pair_of_row[:, 1]
        pairs, first_index = np.unique(pair_of_row[has_partner], axis=0, return_index=True)
        distances_with_partner = np.asarray(distances)[has_partner]
        return pairs, distances_with_partner[first_index]

    def _kind(self, readings: set[str]) -> str:
        """Kind by the names of the readings that have columns."""
        if "distance" in readings:
            if "pair" in readings:
                return "pair"
            return "distance"
        if readings.issuperset(_POINT):
            if any(map(readings.issuperset, _ORIENTATIONS)):
                return "pose"
            return "position"
        if "target" in readings:
            raise ValueRangeError(
                f"{self.path}: the column 'target' needs the kind of touch, {spell(Argument('kind'))}: {listed(TOUCHES)}."
            )
        raise ValueRangeError(
            f"{self.path}: no reading in the columns {listed(self.file.header)}. Give x, y, z, perhaps with qw, qx, qy, qz; or "
            f"distance; or {spell(Argument('kind'))} for touches: {listed(TOUCHES)}."
        )

    def _column(self, name: str) -> int:
        """Index of the column of a reading."""
        columns = [k for k, (reading, _) in enumerate(self.names) if reading == name]
        if len(columns) != 1:
            raise ValueRangeError(f"{self.path}: {len(columns)} columns {name!r}. Give one.")
        return columns[0]

    def _values(self, names: Sequence[str], part: str, *, angular: bool, unitless: bool = False) -> Array:
        """Columns (n, k) of these readings in SI units; raises ValueRangeError for numbers that are not finite.

        ``part`` is the quantity whose units are allowed; ``unitless`` columns are not converted.
        """
        columns = [self._column(name) for name in names]
        table = self.file.table(columns)
        for k, column in enumerate(columns):
            _, unit = self.names[column]
            cell = self.file.header[column]
            if unit is not None and not unitless:
                table[:, k] *= unit_factor(unit, part, angular, f"{self.path}, column {cell!r}")
            elif angular and self.degrees:
                table[:, k] *= math.radians(1.0)
            self._check_finite(table[:, k], cell)
        return table

    def _check_finite(self, column: Array, cell: str) -> None:
        """Raise ValueRangeError for a column with a number that is not finite; ``cell`` is its header."""
        is_finite = np.isfinite(column)
        if not is_finite.all():
            row = int(np.flatnonzero(~is_finite)[0])
            raise ValueRangeError(
                f"{self.path}: {self.file.place(row)}, column {cell!r} is not finite. Remove the row."
            )

    def _rotations(self, readings: set[str]) -> Array:
        """(n, 3, 3) orientations from the columns; ``readings`` are the names of all columns of readings."""
        orientations = [names for names in _ORIENTATIONS if readings.issuperset(names)]
        if len(orientations) != 1:
            raise ValueRangeError(
                f"{self.path}: {len(orientations)} orientations. "
                "Give one: qw, qx, qy, qz; rx, ry, rz; roll, pitch, yaw; r11 … r33."
            )
        names = orientations[0]
        is_angular = names in (_ROTATION_VECTOR, _ROLL_PITCH_YAW)
        values = self._values(names, "q", angular=is_angular, unitless=not is_angular)
        if names == _ROTATION_VECTOR:
            return np.asarray(so3.exp(values))
        if names == _ROLL_PITCH_YAW:
            return rotations_from_roll(values)
        if names == _QUATERNION:
            lengths = np.linalg.norm(values, axis=1)
            self._check_rows(np.abs(lengths - 1.0), "quaternion does not have the length 1")
            return np.asarray(quaternion.rotation(values / lengths[:, None]))
        R = values.reshape(-1, 3, 3)
        errors = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2))
        self._check_rows(errors, "matrix is not a rotation")
        return np.asarray(so3.project(R))

    def _check_rows(self, errors: Array, problem: str) -> None:
        """Raise ValueRangeError for the first row whose error is too large."""
        is_right = errors <= _MAX_ROTATION_ERROR
        if not is_right.all():
            row = int(np.flatnonzero(~is_right)[0])
            raise ValueRangeError(
                f"{self.path}: {self.file.place(row)}: the {problem}, off by {number(errors[row], 3)}. Correct the row."
            )

    def _configurations(self, count: int) -> tuple[Array, tuple[str, ...]]:
        """(n, nq) configurations, and notes on their columns; joints that do not move the tip may be missing."""
        coordinates = Coordinates.from_model(self.robot.model)
        try:
            needed_indices = TipChain.from_robot(self.robot, self.tip).columns  # in q
        except ModelError:
            if self.tip is not None:
                raise
            needed_indices = list(range(self.robot.nq))  # without a tip: all joints
        # Columns of readings get an empty name, so that no joint is assigned to them.
        cells = ["" if name else cell for cell, (name, _) in zip(self.file.header, self.names, strict=True)]
        reading = Reading(self.path, self.columns, degrees=self.degrees)
        assignment = Assignment(cells, str(self.path), coordinates, reading)
        names: dict[str, tuple[str, ...]] = dict.fromkeys(assignment.names, ())
        names["q"] = tuple(coordinates.names[k] for k in needed_indices)
        assignment.names = names
        for (part, place), choice in assignment.requested_choices(self.columns).items():
            assignment.assign(part, place, choice)
        assignment.assign_by_exact_name()
        assignment.assign_by_words()
        if len(assignment.assigned["q"]) < len(needed_indices):
            assignment.assign_by_rules([])
        choice_by_place = assignment.assigned["q"]  # column by place among the needed joints
        missing = [coordinates.names[k] for place, k in enumerate(needed_indices) if place not in choice_by_place]
        if missing:
            raise TrajectoryError(
                f"{self.path}: no column for {listed(missing)} on the way to the tip; {assignment.found_text()}"
            )
        q = np.tile(self.robot.model.neutral, (count, 1))
        for place, choice in choice_by_place.items():
            k = needed_indices[place]
            (column,) = self.file.table([choice.column]).T
            self._check_finite(column, self.file.header[choice.column])
            is_angular = bool(coordinates.angular[k])
            q[:, k] = column * assignment.factor(Choice(choice.column, choice.unit), "q", is_angular)
        return q, tuple(map(str, assignment.notes))


def rotations_from_roll(angles: Array) -> Array:
    """Rotations (n, 3, 3) Rz(yaw) Ry(pitch) Rx(roll), from roll, pitch and yaw (n, 3)."""
    rotation_vectors = angles[:, :, None] * np.eye(3)  # (n, 3, 3), one about each axis
    rotations = np.asarray(so3.exp(rotation_vectors))  # (n, 3, 3, 3)
    Rx, Ry, Rz = np.moveaxis(rotations, 1, 0)
    return np.asarray(Rz @ Ry @ Rx)


def read_measurements(
    given: str | Path | Measurements, robot: Robot, kind: str | None, tip: str | None, *, degrees: bool = False
) -> Measurements:
    """Measurements from a path, or unchanged if they are given; raises as :meth:`Measurements.from_file`."""
    if isinstance(given, Measurements):
        return given
    if not isinstance(given, str | Path):
        raise NotFoundError(
            f"{arguments.value_text(given)} is not a file of measurements. Give a path, or Measurements(q, positions=…)."
        )
    return Measurements.from_file(given, robot, kind=kind, tip=tip, degrees=degrees)
