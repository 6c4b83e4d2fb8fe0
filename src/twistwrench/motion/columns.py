"""Assignment of log columns to coordinates, velocities, accelerations and torques, with units and errors for missing ones."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..core.text import listed
from ..errors import TrajectoryError, UnknownNameError
from ..typing import Array
from .column_names import (
    PARTS,
    READ,
    ROS_TIME,
    SUFFIX,
    Choice,
    Header,
    NamedJoints,
    is_result,
    numbered,
    ros_nanoseconds,
    split_unit,
    time_factor,
    time_meaning,
    unit_factor,
)
from .coordinates import Coordinates, MimicJoint
from .csv_reader import is_number

_FEW = 4
_LIKE = 0.6
"""Similarity of two names from which one may be meant by the other."""
_STILL = 1e-6
"""Share of its size that a column varies by where a joint moves."""
_ANGLES_AND_LENGTHS = ("rad", "deg", "degrees", "radians", "°", "m", "mm", "cm")
_OTHER = re.compile(
    r"temp|curr|volt|amp|force|torq|effort|tau|load|power|energy|tcp|pose|ee_|imu|acc|vel|speed|rate|time|stamp|seq|index|"
    r"count|frame|status|state|mode|flag|id$|err|residual|cmd|command|target|desired|reference|setpoint"
)
"""Words in names of columns that are not positions of joints, or are commanded ones."""


def check_complete(
    header: Header,
    names: Mapping[str, Sequence[str]],
    given: Mapping[str, Mapping[int, Choice]],
    extra: Sequence[str],
    look: Callable[[int], Array],
) -> None:
    """Raise TrajectoryError where coordinates have no column, or rates only some; ``extra`` are columns of no meaning.

    ``look`` gives the first numbers of a column: joints are offered to be held still unless a column that varies is unused.
    """
    missing = [name for k, name in enumerate(names["q"]) if k not in given["q"]]
    if missing:
        near = _alike(missing, extra)
        hint = ""
        if len(missing) == len(names["q"]) and 2 * len(near) < len(missing) and len(extra) > len(near):
            hint = " No column has the name of a joint of this robot: the file seems to be a log of another one."
            near = {}
        elif near:
            name, cell = next(iter(near.items()))
            hint = f" Column {cell!r} is not a joint of this robot. Did you mean {name!r}?"
        first = (list(near) or missing[:2])[:_FEW]
        choices = " ".join(f"--columns '{name}={near.get(name, 'COLUMN')}'" for name in first)
        more = " …" if len(missing) > len(first) else ""
        joints = list(dict.fromkeys(_joint(name) for name in missing))
        held = f", or {' '.join(f'--lock {name}=0' for name in joints)}" if len(joints) <= _FEW else ""
        held = f"--lock-missing{held}" if len(missing) < len(names["q"]) else "--lock 'PATTERN*=0'"
        held = f"; or hold joints still that never move: {held}"
        if len(missing) < len(names["q"]) and (unused := varying_columns(header.cells, extra, look)):
            held = f" (columns that vary and are not used: {listed(unused)})"
        raise TrajectoryError(
            f"{header.where}: no column for {listed(missing)}.{hint} Expected: {listed(names['q'])}; {header.found()} "
            f"Say which they are: {choices}{more}{held}."
        )
    for part in ("dq", "ddq"):
        absent = [f"{name}{SUFFIX[part]}" for k, name in enumerate(names[part]) if k not in given[part]]
        if absent and len(absent) < len(names[part]):
            alike = [c[0] for name in extra if (c := difflib.get_close_matches(name, absent, n=1, cutoff=0.6))]
            hint = f" Did you mean {alike[0]!r}?" if alike else ""
            raise TrajectoryError(
                f"{header.where}: no column {listed(absent)}, although others of its kind are there.{hint} "
                f"Give them for every joint, or for none: then they are derived. Or say which it is: --columns "
                f"'{absent[0]}=COLUMN'; {header.found()}"
            )


def varying_columns(cells: Sequence[str], extra: Sequence[str], look: Callable[[int], Array]) -> list[str]:
    """Columns of ``extra`` that may be positions of joints: numbers that vary, by name and unit of no other quantity."""
    found = []
    for k, cell in enumerate(cells):
        name, unit = split_unit(cell)
        if cell not in extra or _OTHER.search(name.lower()) or (unit is not None and unit not in _ANGLES_AND_LENGTHS):
            continue
        try:
            numbers = look(k)
        except TrajectoryError:  # words
            continue
        if numbers.size and np.isfinite(numbers).all() and np.ptp(numbers) > _STILL * (1 + np.abs(numbers).max()):
            found.append(cell)
    return found


def _alike(missing: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """For names that are missing the columns most like them, each column once; in the order of the names.

    >>> _alike(["shoulder", "elbow"], ["schoulder", "temperature"])
    {'shoulder': 'schoulder'}
    """
    pairs = [
        (difflib.SequenceMatcher(None, cell, name).ratio(), name, cell)
        for name in missing
        for cell in difflib.get_close_matches(name, columns, n=_FEW, cutoff=_LIKE)
    ]
    found: dict[str, str] = {}
    for _, name, cell in sorted(pairs, key=lambda pair: -pair[0]):
        if name not in found and cell not in found.values():
            found[name] = cell
    return {name: found[name] for name in missing if name in found}


def _joint(coordinate: str) -> str:
    """The joint of a coordinate; those of planar and floating joints have a suffix."""
    base, dot, suffix = coordinate.rpartition(".")
    return base if dot and suffix in ("x", "y", "z", "theta", "qw", "qx", "qy", "qz") else coordinate


# ── Choice of columns: as given, by exact name, by logger names, by number


@dataclass
class Chosen:
    """The columns taken, in the robot's order; a part that the file does not have is empty."""

    time: Choice | None
    parts: dict[str, list[Choice]]
    of_locked: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    followers: dict[int, Choice] = field(default_factory=dict)
    """Columns of mimic joints, by the number of the joint."""


def choose(
    cells: Sequence[str],
    coordinates: Coordinates,
    where: str,
    *,
    locked: Sequence[str],
    columns: Mapping[str, str],
    rate: float | None,
    look: Callable[[int], Array],
) -> Chosen:
    """Give the header's columns to the robot's coordinates; TrajectoryError and UnknownNameError begin with ``where``.

    ``look`` gives the first numbers of a column.
    """
    if all(is_number(cell) or not cell for cell in cells):
        raise TrajectoryError(
            f"{where}: the header is missing; the first line has numbers. Name the columns: time, then joints."
        )
    header, notes = Header(cells, where, coordinates.names), list[str]()
    names = {part: coordinates.names if part == "q" else coordinates.velocity_names for part in PARTS}
    told = _requested(header, names, columns)
    time = _time(header, told.pop(("time", 0), None), rate, notes, look)
    given: dict[str, dict[int, Choice]] = {part: {} for part in PARTS}
    for (part, k), choice in told.items():
        given[part][k] = choice
        header.free = [c for c in header.free if c != choice.column]
    _by_exact_name(header, names, given)
    _by_words(header, names, given, notes)
    _by_number(header, names, given, notes)
    followers = {
        k: Choice(c, header.split[c][1])
        for k, follower in enumerate(coordinates.mimic_joints)
        for c in [c for c in header.free if header.split[c][0] == follower.name][:1]
    }
    of_locked = [k for k in header.free if _belongs(header.split[k][0], locked)]
    # Torques are for comparison only, and may be those of some joints.
    if len(given["tau"]) < len(names["tau"]):
        given["tau"] = {}
    taken = {c.column for found in given.values() for c in found.values()} | ({time.column} if time else set())
    taken |= {c.column for c in followers.values()}
    unread = [cell for k, cell in enumerate(cells) if cell and k not in taken and k not in of_locked]
    extra = [cell for cell in unread if not is_result(cell)]
    check_complete(header, names, given, extra, look)
    if unnamed := [str(k + 1) for k, cell in enumerate(cells) if not cell]:
        notes.append(f"Columns without a name are ignored: {', '.join(unnamed)}.")
    return Chosen(
        time,
        {part: [given[part][k] for k in sorted(given[part])] for part in PARTS},
        tuple(cells[k] for k in of_locked),
        tuple(extra),
        tuple(notes),
        followers,
    )


def absent_joints(
    cells: Sequence[str], coordinates: Coordinates, joints: Sequence[str], columns: Mapping[str, str]
) -> tuple[str, ...]:
    """Joints without a column of their position in this header, by their names or by ``columns``."""
    header = Header(cells, "", coordinates.names)
    given: dict[str, dict[int, Choice]] = {part: {} for part in PARTS}
    names = {part: coordinates.names if part == "q" else coordinates.velocity_names for part in PARTS}
    for key in columns:
        if key.removesuffix(".pos") in names["q"]:
            given["q"][names["q"].index(key.removesuffix(".pos"))] = Choice(0)
    _by_exact_name(header, names, given)
    _by_words(header, names, given, [])
    have = {names["q"][k] for k in given["q"]}
    return tuple(j for j in joints if not any(n == j or n.startswith(f"{j}.") for n in have))


def _requested(
    header: Header, names: Mapping[str, Sequence[str]], columns: Mapping[str, str]
) -> dict[tuple[str, int], Choice]:
    """Columns of the option ``columns``, by part and number of the coordinate."""
    suffixes = {".pos": "q", **{suffix: part for part, endings in READ.items() for suffix in endings}}
    known = {f"{name}{suffix}": (part, k) for suffix, part in suffixes.items() for k, name in enumerate(names[part])}
    known["time"] = ("time", 0)
    told: dict[tuple[str, int], Choice] = {}
    for key, name in columns.items():
        if key not in known:
            raise UnknownNameError.from_choices("coordinate (of --columns)", key, ["time", *names["q"]])
        place = known[key]
        if place in told:
            raise TrajectoryError(f"{header.where}: --columns says twice what {key!r} is. Keep one of them.")
        told[place] = header.column(name, f"--columns {key}={name}")
    return told


def _time(
    header: Header, told: Choice | None, rate: float | None, notes: list[str], look: Callable[[int], Array]
) -> Choice | None:
    ranked = sorted((rank[0], k) for k in header.free if (rank := time_meaning(header.split[k][0])) is not None)
    if others := [(rank, k) for rank, k in ranked if header.cells[k] not in header.joints]:
        ranked = others  # a joint may be called t
    first = [k for rank, k in ranked if rank == ranked[0][0]]
    if rate is not None:
        if told or first:
            name = header.cells[told.column if told else first[0]]
            raise TrajectoryError(
                f"{header.where}: --rate is given, and column {name!r} is time. Leave out one of them."
            )
        return None
    if told is None and not first:
        raise TrajectoryError(
            f"{header.where}: no time column. Name one 'time' (or 't'), in seconds; a command can be told which it is, "
            f"--columns 'time=COLUMN', or how many rows a second has, --rate HZ; {header.found()}"
        )
    if told is None and len(first) > 1:
        raise TrajectoryError(
            f"{header.where}: two time columns, {listed([header.cells[k] for k in first])}. Keep one of them, or say which: "
            f"--columns 'time={header.cells[first[0]]}'."
        )
    choice = told or Choice(
        first[0], header.split[first[0]][1] or (time_meaning(header.split[first[0]][0]) or (0, None))[1]
    )
    noted = False
    if choice.unit is None and header.split[choice.column][0] == ROS_TIME:
        whole = ros_nanoseconds(look(choice.column))
        kind = "whole numbers, so time is read in ns" if whole else "no whole nanoseconds, so time is read in s"
        notes.append(f"Column {ROS_TIME!r} has {kind}.")
        choice, noted = Choice(choice.column, "ns" if whole else None), True
    if choice.unit is not None and time_factor(choice.unit) is None:
        raise TrajectoryError(
            f"{header.where}, column {header.cells[choice.column]!r}: {choice.unit!r} is not a unit of time. Known: s, ms, us, "
            "ns, min."
        )
    if choice.unit is not None and time_factor(choice.unit) != 1.0 and not noted:
        notes.append(f"Time is read in {choice.unit} from column {header.cells[choice.column]!r}.")
    header.free = [k for k in header.free if k != choice.column]
    return choice


def _by_exact_name(header: Header, names: Mapping[str, Sequence[str]], given: dict[str, dict[int, Choice]]) -> None:
    by_text: dict[str, list[int]] = {}
    for k in header.free:
        by_text.setdefault(header.split[k][0], []).append(k)
    for part, endings in READ.items():
        for k, name in enumerate(names[part]):
            for ending in endings:
                columns = by_text.get(f"{name}{ending}", [])
                if len(columns) > 1 and k not in given[part]:
                    raise header.repeated(f"{name}{ending}", len(columns))
                if columns and k not in given[part]:
                    given[part][k] = Choice(columns[0], header.split[columns[0]][1])
                    header.free.remove(columns[0])


def _by_words(
    header: Header, names: Mapping[str, Sequence[str]], given: dict[str, dict[int, Choice]], notes: list[str]
) -> None:
    readers = {part: NamedJoints(names[part]) for part in ("q", "dq")}
    found: dict[tuple[str, int], list[int]] = {}
    units: dict[int, str | None] = {}
    for k in header.free:
        text, unit = header.split[k]
        for kind, reader in readers.items():
            meant = reader.meaning(text)
            if meant is not None and (meant.part == "q") == (kind == "q"):
                found.setdefault((meant.part, meant.name), []).append(k)
                units[k] = unit or meant.unit
                break
    taken: list[tuple[str, int, int]] = []
    for (part, place), columns in found.items():
        if place in given[part]:
            continue
        if len(columns) > 1:
            name = names[part][place]
            shown = [header.cells[k] for k in columns]
            key = name + ("" if part == "q" else READ[part][0])
            raise TrajectoryError(
                f"{header.where}: {listed(shown)} may all be {key}. Say which: --columns '{key}={shown[0]}'."
            )
        given[part][place] = Choice(columns[0], units[columns[0]])
        header.free.remove(columns[0])
        taken.append((part, place, columns[0]))
    if taken:
        part, place, column = taken[0]
        key = names[part][place] + ("" if part == "q" else READ[part][0])
        others = f", and {len(taken) - 1} more likewise" if len(taken) > 1 else ""
        notes.append(f"Column {header.cells[column]!r} is taken to be {key}{others}.")


def _by_number(
    header: Header, names: Mapping[str, Sequence[str]], given: dict[str, dict[int, Choice]], notes: list[str]
) -> None:
    """Columns that count joints, where there are as many as joints."""
    found: dict[str, list[tuple[int, int]]] = {part: [] for part in PARTS}
    units = {k: unit for k, (_, unit) in enumerate(header.split)}
    for k in header.free:
        meant = numbered(header.split[k][0])
        if meant is not None:
            found[meant[0]].append((-1 if meant[1] is None else meant[1], k))
            units[k] = units[k] or meant[2]
    for part, columns in found.items():
        numbers = sorted(columns)
        first = numbers[0][0] if numbers else 0
        in_turn = [n for n, _ in numbers] == list(range(first, first + len(numbers))) and first in (-1, 0, 1)
        if given[part] or len(numbers) != len(names[part]) or not in_turn or (first == -1 and len(numbers) > 1):
            continue
        for place, (_, k) in enumerate(numbers):
            given[part][place] = Choice(k, units[k])
            header.free.remove(k)
        pairs = [f"{header.cells[k]} is {names[part][place]}" for place, (_, k) in enumerate(numbers)]
        if not numbers:
            continue
        notes.append(
            f"Columns {header.cells[numbers[0][1]]} … {header.cells[numbers[-1][1]]} are taken in their order: "
            f"{listed(pairs)}."
            if len(numbers) > 1
            else f"Column {header.cells[numbers[0][1]]!r} is taken to be that of {names[part][0]}, the only joint."
        )


def _belongs(text: str, locked: Sequence[str]) -> bool:
    return any(text == j or text.startswith(f"{j}.") for j in locked) or NamedJoints(locked).meaning(text) is not None


# ── The columns of a motion file and their factors


class MimicJointColumn(NamedTuple):
    """A column of a mimic joint."""

    follower: MimicJoint
    column: int
    """Column of the table."""
    factor: float
    """Factor to SI units."""


@dataclass(frozen=True, eq=False)
class Columns:
    """Places of time, q, dq, ddq and torques in the table of a log, which has the used columns only."""

    header: tuple[str, ...]
    """Header of the table."""
    used: tuple[int, ...]
    """Columns of the file; without a time column the table begins with one more, the row's number."""
    time: int
    """The column of time [s]."""
    seconds: float
    """Factor from the file's time, or from the row's number, to seconds."""
    counted: bool
    """True if time is the row's number, for want of a column."""
    time_stated: bool
    """True if the unit of time is given, by the file or the caller."""
    places: dict[str, Array | None]
    """For ``q``, ``dq``, ``ddq``, ``tau``: the columns in the robot's order, or None where the file has none."""
    factors: dict[str, Array]
    """Factors to SI units."""
    angle: Array
    """(nq,) what takes the file's angles to radians; 1 where the coordinate is none."""
    angle_stated: Array
    """(nq,) bool: the unit is given, by the column's name or the caller."""
    of_locked: tuple[str, ...] = ()
    """Columns that belong to joints held still; they are ignored."""
    extra: tuple[str, ...] = ()
    """Columns that are nothing of this robot; they are ignored."""
    quaternions: tuple[Array, ...] = ()
    """The columns of each quaternion."""
    notes: tuple[str, ...] = ()
    """A sentence for each thing that was taken to be meant."""
    mimic_joints: tuple[MimicJointColumn, ...] = ()
    """Columns of mimic joints."""

    @classmethod
    def from_header(
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
            mimic_joints=tuple(
                MimicJointColumn(
                    coordinates.mimic_joints[k],
                    place[c.column],
                    _factor_of(coordinates.mimic_joints[k], c, header, where, degrees),
                )
                for k, c in chosen.followers.items()
            ),
        )

    def in_si(self, table: Array, part: str) -> Any:
        """The columns of ``part`` (``q``, ``dq``, ``ddq``, ``tau``) of a table (n, columns), in SI units; None if absent."""
        where = self.places[part]
        return None if where is None else table[:, where] * self.factors[part]


def _factor_of(follower: MimicJoint, choice: Choice, header: Sequence[str], where: str, degrees: bool) -> float:
    """Factor from the column of a mimic joint to SI units."""
    if choice.unit is not None:
        return unit_factor(choice.unit, "q", follower.angular, f"{where}, column {header[choice.column]!r}")
    return math.radians(1.0) if degrees and follower.angular else 1.0


def _factors(
    part: str, found: Sequence[Choice], coordinates: Coordinates, header: Sequence[str], where: str, *, degrees: bool
) -> Array:
    """Factors from the columns of a part to SI units: by the unit of each, else by ``degrees``."""
    angular = coordinates.angular if part == "q" else coordinates.angular_velocity
    usual = np.where(angular, math.radians(1.0) if degrees and part != "tau" else 1.0, 1.0)
    for k, choice in enumerate(found):
        if choice.unit is not None:
            usual[k] = unit_factor(choice.unit, part, bool(angular[k]), f"{where}, column {header[choice.column]!r}")
    return usual
