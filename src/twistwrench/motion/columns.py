"""Assignment of log columns to coordinates, velocities, accelerations and torques, with units and error messages."""

from __future__ import annotations

import difflib
import itertools
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import TrajectoryError, UnknownNameError
from ..core.text import Argument, Placeholder, ReadingNote, argument, listed
from ..core.typing import Array
from .column_names import (
    CURRENT,
    PARTS,
    READ,
    ROS_TIME,
    STATES,
    SUFFIX,
    are_in_degrees,
    current_factor,
    is_command,
    is_result,
    ros_nanoseconds,
    split_unit,
    time_factor,
    time_meaning,
    unit_factor,
    unit_since_1970,
)
from .coordinates import Coordinates, MimicJoint
from .matching import (
    RULES,
    Candidate,
    NamedJoints,
    alike,
    candidates,
    command_candidates,
    counts_rows,
    match_most_by_prefix,
    rising_columns,
    series,
    varying_columns,
)
from .readers.csv_reader import is_number

_MAX_LOCKED_NAMES = 4
"""Largest number of joints that an error message proposes to lock."""
_MAX_JOINTS_BESIDE = 12
"""Largest number of joints beside an arm that an error message lists."""
ORDER = "#"
"""Prefix of keys for columns listed in the order of the coordinates: ``#1``, ``#2`` …"""


def _joint(coordinate: str) -> str:
    """Joint of a coordinate; coordinates of planar and floating joints have a suffix."""
    joint, dot, suffix = coordinate.rpartition(".")
    if dot and suffix in ("x", "y", "z", "theta", "qw", "qx", "qy", "qz"):
        return joint
    return coordinate


@dataclass(frozen=True)
class Choice:
    """Column of a file, with its unit if given."""

    column: int
    """Index in the file."""
    unit: str | None = None
    """Unit as written; None if neither the column's name nor the caller gives one."""
    gain: float | None = None
    """Torque per unit of a current column; None for other columns."""


_NO_COLUMN = Choice(-1)
"""Stands for the missing column of a joint."""
_DEFAULT_UNITS = {CURRENT: "A"}
"""Units, by quantity, of columns whose names have no unit."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Options for reading a file."""

    path: Path
    columns: Mapping[str, str] | None = None
    """Columns by quantity (``{"elbow": "pos3", "elbow.vel": "w3", "time": "stamp [ms]"}``). Other columns are found by name.

    ``LOG:JOINT`` applies only to the log with that path or name.
    """
    rate: float | None = None
    """Sampling rate [Hz] in place of a time column."""
    degrees: bool = False
    """True if angles without a unit are in degrees."""
    gain: Mapping[str, float] | None = None
    """Torque per ampere by joint; for ``joint.current``, only if the column is a current by name or unit."""
    locked: Sequence[str] = ()
    """Joints whose columns are ignored."""
    commands: bool = False
    """True to read commanded positions too."""

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of the motion that are read."""
        return PARTS if self.commands else STATES


def check_header(cells: Sequence[str], where: str, names: str = "time, then joints") -> None:
    """Raise TrajectoryError if the first line has numbers in place of the names of columns."""
    if all(is_number(cell) or not cell for cell in cells):
        raise TrajectoryError(f"{where}: the header is missing; the first line has numbers. Name the columns: {names}.")


class Assignment:
    """Assignment of a header's columns to the coordinates of a robot; errors begin with ``where``."""

    def __init__(self, cells: Sequence[str], where: str, coordinates: Coordinates, reading: Reading) -> None:
        self.cells = cells
        self.where = where
        self.reading = reading
        self.arms = coordinates.arms
        self.names = dict.fromkeys(PARTS, coordinates.velocity_names) | {"q": coordinates.names}
        """Names of the entries of each part of the motion."""
        self.motors = {*coordinates.drive_names} - {*coordinates.velocity_names}
        """Coupled motors, which do not have the name of a joint."""
        self.of_motors = self._names_motors()
        """True if torques of coupled joints are motor torques, according to the column names."""
        if self.of_motors:
            self.names["tau"] = coordinates.drive_names
        self.free_columns = [k for k, cell in enumerate(cells) if cell]
        """Indices of unassigned columns."""
        self.column_names: list[str] = []
        """Name of each column without its unit; joint names that end in brackets are kept whole."""
        self.units: list[str | None] = []
        """Unit of each column in brackets after its name."""
        for cell in cells:
            name, unit = split_unit(cell)
            if cell in coordinates.names:
                name = cell
                unit = None
            self.column_names.append(name)
            self.units.append(unit)
        self.assigned: dict[str, dict[int, Choice]] = {}
        """Columns assigned to the entries of each part of the motion, by index of the entry."""
        self.requested_entries: dict[str, set[int]] = {}
        """Indices of the entries whose columns the caller named, by part."""
        for part in PARTS:
            self.assigned[part] = {}
            self.requested_entries[part] = set()
        self.notes: list[str] = []
        """Sentences about assumptions."""
        self.degrees = reading.degrees
        """True if angles without a unit are in degrees, by the option or by the names of the columns."""
        self.time: Choice | None = None
        """Column of time; None without one."""
        self.mimic_joints: list[tuple[MimicJoint, Choice]] = []
        self.of_locked: list[str] = []
        """Columns of locked joints."""
        self.extra: list[str] = []
        """Columns without a known meaning."""

    def _names_motors(self) -> bool:
        """True if a column, or an entry of the option ``columns``, is a torque or a current of a coupled motor by its name."""
        endings = (f".{CURRENT}", *READ["tau"])
        names: list[str] = []
        for cell in self.cells:
            name, _ = split_unit(cell)
            names.append(name)
        names += self.reading.columns or {}
        for name in names:
            _, _, name_without_log = name.rpartition(":")
            for ending in endings:
                is_motor = name_without_log.removesuffix(ending) in self.motors
                if is_motor and name_without_log.endswith(ending):
                    return True
        return False

    @classmethod
    def from_header(
        cls,
        cells: Sequence[str],
        coordinates: Coordinates,
        where: str,
        reading: Reading,
        first_numbers: Callable[[int], Array],
    ) -> Assignment:
        """Assign the header's columns to the robot's coordinates; raises TrajectoryError and UnknownNameError.

        ``first_numbers`` returns the first numbers of a column, by index.
        """
        check_header(cells, where)
        assignment = cls(cells, where, coordinates, reading)
        requested = assignment.requested_choices(reading.columns or {})
        assignment.time = assignment.assign_time(requested.pop(("time", 0), None), reading.rate, first_numbers)
        for (part, k), choice in requested.items():
            assignment.assign(part, k, choice)
            assignment.requested_entries[part].add(k)
        assignment.assign_by_exact_name()
        assignment.assign_by_words()
        mimic_joint_names = [follower.name for follower in coordinates.mimic_joints]
        assignment.assign_by_rules([*reading.locked, *mimic_joint_names])
        assignment.take_currents()
        if assignment.time is None:
            assignment.time = assignment.rising_time(first_numbers)
        assignment.assign_mimic_joints(coordinates.mimic_joints)
        assignment.sort_out_unread(reading.locked)
        assignment.check_complete(first_numbers)
        unnamed = [str(k + 1) for k, cell in enumerate(cells) if not cell]
        if unnamed:
            assignment.notes.append(f"Columns without a name are ignored: {', '.join(unnamed)}.")
        return assignment

    def assign_mimic_joints(self, followers: Sequence[MimicJoint]) -> None:
        """Assign columns with the names of mimic joints, which are compared with their leaders."""
        for follower in followers:
            columns_of_follower = [k for k in self.free_columns if self.column_names[k] == follower.name]
            if columns_of_follower:
                self.mimic_joints.append((follower, self.choice(columns_of_follower[0])))

    def sort_out_unread(self, locked: Sequence[str]) -> None:
        """Sort the columns that are not read into columns of locked joints and columns without a known meaning."""
        explained = {choice.column for _, choice in self.mimic_joints}
        for k in self.free_columns:
            if belongs(self.column_names[k], locked):
                self.of_locked.append(self.cells[k])
                explained.add(k)
        if len(self.assigned["tau"]) < len(self.names["tau"]):
            # Torques are only compared with others, so some joints may lack them.
            self.free_columns += [choice.column for choice in self.assigned["tau"].values()]
            self.assigned["tau"] = {}
        for k in sorted(self.free_columns):
            cell = self.cells[k]
            if k not in explained and not (is_result(cell) or is_command(cell)):
                self.extra.append(cell)

    def factor(self, choice: Choice, part: str, angular: bool) -> float:
        """Factor from a column to SI units: by its unit or gain, otherwise by the common unit of angles."""
        if choice.gain is not None:
            return choice.gain
        if choice.unit is not None:
            return unit_factor(choice.unit, part, angular, f"{self.where}, column {self.cells[choice.column]!r}")
        if self.degrees and angular and part != "tau":  # torques do not depend on the unit of angles
            return math.radians(1.0)
        return 1.0

    def factors(self, choices: Sequence[Choice], part: str, angular: Sequence[bool]) -> Array:
        """Factors (k,) of columns of one part to SI units."""
        return np.array([self.factor(choice, part, turns) for choice, turns in zip(choices, angular, strict=True)])

    def choice(self, column: int) -> Choice:
        """Column with the unit in its name."""
        return Choice(column, self.units[column])

    def cells_of(self, column_indices: Iterable[int]) -> list[str]:
        """Names of columns as the header has them."""
        return [self.cells[column] for column in column_indices]

    def free_names(self) -> dict[int, str]:
        """Names of the unassigned columns, without their units."""
        return {column: self.column_names[column] for column in self.free_columns}

    def without_column(self, part: str) -> list[int]:
        """Indices of the entries of a part of the motion that have no column."""
        return [k for k in range(len(self.names[part])) if k not in self.assigned[part]]

    def found_text(self) -> str:
        """List of the column names, for the end of an error message."""
        names = [cell or "(no name)" for cell in self.cells]
        return f"found: {listed(names)}."

    def column(self, name: str, source: Argument) -> Choice:
        """Column by name, with or without its unit; errors name ``source``, the argument that names the column."""
        name_without_unit, unit = split_unit(name)
        matches = [k for k, cell in enumerate(self.cells) if cell == name.strip()]
        if not matches:
            matches = [k for k, column_name in enumerate(self.column_names) if column_name == name_without_unit]
        if not matches:
            named_cells = [cell for cell in self.cells if cell]
            hint = _suggestion(name, named_cells)
            raise TrajectoryError(
                f"{self.where}: no column {name!r}, which {{0}} names.{hint} {self.found_text()}", source
            )
        if len(matches) > 1:
            raise self.repetition_error(name.strip(), len(matches))
        (column,) = matches
        return Choice(column, unit or self.units[column])

    def repetition_error(self, name: str, count: int) -> TrajectoryError:
        """Error for a column that occurs more than once."""
        return TrajectoryError(f"{self.where}: column {name!r} is there {count} times. Keep one of them.")

    def assign(self, part: str, k: int, choice: Choice) -> None:
        """Assign a column to entry k of a part of the motion."""
        self.assigned[part][k] = choice
        self.use(choice.column)

    def use(self, column: int) -> None:
        """Remove a column from the unassigned columns."""
        if column in self.free_columns:
            self.free_columns.remove(column)

    def requested_choices(self, columns: Mapping[str, str]) -> dict[tuple[str, int], Choice]:
        """Columns of the option ``columns``, by part and coordinate index."""
        targets = self._known_entries()
        choices: dict[tuple[str, int], Choice] = {}
        columns_for_log = self.replace_numbers(self.entries_for_log(columns, targets))
        for key, name in columns_for_log.items():
            if key not in targets:
                raise UnknownNameError.from_choices(
                    f"coordinate (of {argument('columns')})", key, ["time", *self.names["q"]]
                )
            target = targets[key]
            if target in choices:
                raise TrajectoryError(
                    f"{self.where}: {{0}} assigns {key!r} twice. Keep one of them.", Argument("columns")
                )
            choice = self.column(name, Argument("columns", {key: name}))
            if key.endswith(f".{CURRENT}") and not choice.unit:
                choice = replace(choice, unit="A")
            choices[target] = choice
        return choices

    def _known_entries(self) -> dict[str, tuple[str, int]]:
        """Part and coordinate index of each key that the option ``columns`` may have."""
        part_by_suffix = {".pos": "q", f".{CURRENT}": "tau"}
        for part, endings in READ.items():
            part_by_suffix |= dict.fromkeys(endings, part)
        entries: dict[str, tuple[str, int]] = {}
        for suffix, part in part_by_suffix.items():
            for k, name in enumerate(self.names[part]):
                entries[f"{name}{suffix}"] = part, k
        return entries | {"time": ("time", 0)}

    def replace_numbers(self, columns: Mapping[str, str]) -> dict[str, str]:
        """Replace ``#1``, ``#2`` … in ``columns`` by the joints' names."""
        names = self.names["q"]
        numbered_keys = [key for key in columns if key.startswith(ORDER) and key.removeprefix(ORDER).isdigit()]
        if numbered_keys and len(numbered_keys) != len(names):
            raise TrajectoryError(
                f"{self.where}: {{0}} lists {len(numbered_keys)} columns, and the robot has {len(names)} coordinates: "
                f"{listed(names)}. List one for each, or name the joint of each.",
                Argument("columns"),
            )
        column_by_name = {}
        for key, column in columns.items():
            name = key
            if key in numbered_keys:
                number = int(key.removeprefix(ORDER))  # from 1
                name = names[number - 1]
            column_by_name[name] = column
        return column_by_name

    def entries_for_log(self, columns: Mapping[str, str], known: Collection[str]) -> dict[str, str]:
        """Entries of ``columns`` for this log; entries with its path or name as prefix override general ones."""
        for_all_logs = dict[str, str]()
        for_this_log = dict[str, str]()
        for key, column in columns.items():
            # The key is LOG:JOINT, but either name may contain a colon: the longest known ending is the joint.
            endings = [name for name in known if key.endswith(f":{name}")]
            coordinate = max(endings, key=len, default="")  # empty for a key without a log
            if key in known or not coordinate:
                for_all_logs[key] = column
                continue
            log_name = key.removesuffix(f":{coordinate}")
            if log_name in (str(self.reading.path), self.reading.path.name):
                for_this_log[coordinate] = column
        return for_all_logs | for_this_log

    def take_currents(self) -> None:
        """Convert currents in torque columns by the gains; raises TrajectoryError for a column in a unit of torque."""
        names = self.names["tau"]
        gains = self.reading.gain or {}
        joints_and_motors = {*names} | self.motors
        for name in gains:
            if name.removesuffix(f".{CURRENT}") not in joints_and_motors:
                raise UnknownNameError.from_choices(f"joint (of {argument('gain')})", name, names)
        for k, choice in self.assigned["tau"].items():
            amperes_per_unit: float | None = 1.0  # None if the unit is not a unit of current
            gain = gains.get(names[k])
            if choice.unit is not None:
                amperes_per_unit = current_factor(choice.unit)
                if amperes_per_unit is not None and gain is None:
                    gain = gains.get(f"{names[k]}.{CURRENT}")
            if gain is not None and amperes_per_unit is None:
                raise TrajectoryError(
                    f"{self.where}, column {self.cells[choice.column]!r}: {{0}} of {names[k]} is for a current, and this is a "
                    f"torque in {choice.unit}. Leave out one of them.",
                    Argument("gain"),
                )
            if gain is not None and amperes_per_unit is not None:
                self.assigned["tau"][k] = replace(choice, gain=gain * amperes_per_unit)

    def assign_time(
        self, requested: Choice | None, rate: float | None, first_numbers: Callable[[int], Array]
    ) -> Choice | None:
        """Time column by name or unit; None if there is none. With a ``rate``, it may only have row numbers."""
        named_columns = self._columns_named_time()
        if rate is not None:
            return self._row_numbers(requested, named_columns, first_numbers)
        if requested is None and not named_columns:
            columns_with_time_unit = {}
            for k in self.free_columns:
                if time_factor(self.units[k] or "") is not None:
                    columns_with_time_unit[k] = self.cells[k]
            rising = rising_columns(columns_with_time_unit, first_numbers)
            if len(rising) != 1:
                return None
            requested = self.choice(rising[0])
        if requested is None and len(named_columns) > 1:
            raise TrajectoryError(
                f"{self.where}: two time columns, {listed(self.cells_of(named_columns))}. Keep one of them, or choose: {{0}}.",
                Argument("columns", {"time": self.cells[named_columns[0]]}),
            )
        choice = self._named_time(named_columns[0]) if requested is None else requested
        unit_by_numbers = self._time_unit_by_numbers(choice, first_numbers)
        if unit_by_numbers is not None:
            choice = unit_by_numbers
        elif choice.unit is not None and time_factor(choice.unit) is None:
            raise TrajectoryError(
                f"{self.where}, column {self.cells[choice.column]!r}: {choice.unit!r} is not a unit of time. Known: s, ms, us, "
                "ns, min."
            )
        elif choice.unit is not None and time_factor(choice.unit) != 1.0:
            self.notes.append(ReadingNote(f"Time is read in {choice.unit} from column {self.cells[choice.column]!r}."))
        self.use(choice.column)
        return choice

    def _columns_named_time(self) -> list[int]:
        """Unassigned columns with the most certain name for time; several if they have the same rank."""
        columns_by_rank: dict[tuple[bool, int], list[int]] = {}
        for k in sorted(self.free_columns):
            meaning = time_meaning(self.column_names[k])
            if meaning is not None:
                rank, _ = meaning
                is_joint_name = self.cells[k] in self.names["q"]  # a joint may be named t
                columns_by_rank.setdefault((is_joint_name, rank), []).append(k)
        if not columns_by_rank:
            return []
        most_certain_rank = min(columns_by_rank)
        return columns_by_rank[most_certain_rank]

    def _named_time(self, column: int) -> Choice:
        """Time column with its unit, which is after its name or in it."""
        unit = self.units[column]
        meaning = time_meaning(self.column_names[column])
        if not unit and meaning is not None:
            _, unit = meaning
        return Choice(column, unit)

    def _row_numbers(
        self, requested: Choice | None, named_columns: Sequence[int], first_numbers: Callable[[int], Array]
    ) -> Choice | None:
        """Column of row numbers of a file whose rate is given; raises TrajectoryError for a column of time."""
        if requested is None and not named_columns:
            return None
        choice = Choice(named_columns[0]) if requested is None else requested
        column = choice.column
        if choice.unit is None and counts_rows(first_numbers(column)):
            self.notes.append(f"Column {self.cells[column]!r} is read as the number of a row, by its numbers.")
            self.use(column)
            return choice
        raise TrajectoryError(
            f"{self.where}: {{0}} is given, and column {self.cells[column]!r} is time. Leave out one of them.",
            Argument("rate"),
        )

    def _time_unit_by_numbers(self, choice: Choice, first_numbers: Callable[[int], Array]) -> Choice | None:
        """Time column with the unit that its numbers show, which is noted; None if it has a unit or shows none."""
        if choice.unit is not None:
            return None
        if self.column_names[choice.column] == ROS_TIME:
            if ros_nanoseconds(first_numbers(choice.column)):
                self.notes.append(f"Column {ROS_TIME!r} has whole numbers, so time is read in ns.")
                return Choice(choice.column, "ns")
            self.notes.append(f"Column {ROS_TIME!r} has no whole nanoseconds, so time is read in s.")
            return Choice(choice.column)
        unit = unit_since_1970(first_numbers(choice.column))
        if unit is None:
            return None
        self.notes.append(
            f"Time is read in {unit} since 1970 from column {self.cells[choice.column]!r}, by its numbers."
        )
        return Choice(choice.column, unit)

    def assign_by_exact_name(self) -> None:
        """Assign columns with the names used in written files."""
        columns_by_name: dict[str, list[int]] = {}
        for column in self.free_columns:
            columns_by_name.setdefault(self.column_names[column], []).append(column)
        for part in self.reading.parts:
            for k, name in enumerate(self.names[part]):
                for ending in READ[part]:
                    columns = columns_by_name.get(f"{name}{ending}", [])
                    if k in self.assigned[part] or not columns:
                        continue
                    if len(columns) > 1:
                        raise self.repetition_error(f"{name}{ending}", len(columns))
                    self.assign(part, k, self.choice(columns[0]))

    def assign_by_words(self) -> None:
        """Assign columns whose names contain a joint's name and words for a quantity."""
        columns_by_meaning, units = self._columns_by_words()
        assigned_sentences = []
        # Currents come last, since they replace only torques of joints with a gain.
        currents_last = sorted(columns_by_meaning, key=lambda meaning: meaning[0] == CURRENT)
        for quantity, k in currents_last:
            columns = columns_by_meaning[quantity, k]
            is_current = quantity == CURRENT
            part = "tau" if is_current else quantity
            name = self.names[part][k]
            if is_current:
                if not self.reading.gain:
                    continue
                if name in self.reading.gain and k in self.assigned[part]:
                    torque_choice = self.assigned[part].pop(k)
                    self.free_columns.append(torque_choice.column)
            if k in self.assigned[part]:
                continue
            key = name
            if part != "q":
                usual_ending = READ[part][0]
                key = f"{name}{usual_ending}"
            if len(columns) > 1:
                cells = self.cells_of(columns)
                raise TrajectoryError(
                    f"{self.where}: {listed(cells)} may all be {key}. Say which: {{0}}.",
                    Argument("columns", {key: cells[0]}),
                )
            column = columns[0]
            self.assign(part, k, Choice(column, units[column]))
            assigned_sentences.append(f"Column {self.cells[column]!r} is taken to be {key}")
        if len(assigned_sentences) > 1:
            further_count = len(assigned_sentences) - 1
            self.notes.append(ReadingNote(f"{assigned_sentences[0]}, and {further_count} more likewise."))
        elif assigned_sentences:
            self.notes.append(ReadingNote(f"{assigned_sentences[0]}."))

    def _columns_by_words(self) -> tuple[dict[tuple[str, int], list[int]], dict[int, str | None]]:
        """Unassigned columns by quantity and entry that the words of their names mean, and their units by column.

        Positions have the names of coordinates, and other quantities the names of velocities. Torques may have the names of
        motors.
        """
        joints_by_part = {"q": NamedJoints(self.names["q"]), "dq": NamedJoints(self.names["dq"])}
        drives = NamedJoints(self.names["tau"])
        columns_by_meaning: dict[tuple[str, int], list[int]] = {}
        units: dict[int, str | None] = {}
        for column in self.free_columns:
            name = self.column_names[column]
            for named_part, joints in joints_by_part.items():
                meaning = joints.meaning(name)
                may_be_of_motor = meaning is None or meaning.part in ("tau", CURRENT)
                if self.of_motors and named_part == "dq" and may_be_of_motor:
                    meaning = drives.meaning(name)
                if meaning is None or (meaning.part == "command" and not self.reading.commands):
                    continue
                is_position = meaning.part == "q"
                if is_position == (named_part == "q"):
                    columns_by_meaning.setdefault((meaning.part, meaning.name), []).append(column)
                    units[column] = self.units[column] or meaning.unit or _DEFAULT_UNITS.get(meaning.part)
                    break
        return columns_by_meaning, units

    def assign_by_rules(self, other_joints: Sequence[str]) -> None:
        """Assign columns by the first rule that matches all joints; ``other_joints`` are joints without a coordinate."""
        names = self.free_names()
        for part, group in candidates(names).items():
            if part == CURRENT and not self.reading.gain:
                continue
            cells = self.assign_group(part, group, other_joints)
            if part == "q" and not self.degrees and are_in_degrees(cells):
                self.degrees = True
                self.notes.append(f"Columns named {cells[0]} … {cells[-1]} are in degrees, as their maker writes them.")
        if self.reading.commands:
            for commands in command_candidates(self.free_names()):
                self.assign_group("command", commands, other_joints)

    def assign_group(self, meaning: str, group: Sequence[Candidate], other_joints: Sequence[str]) -> list[str]:
        """Assign columns of one quantity by the first rule that matches all joints; returns their names, empty without a rule.

        Joints whose columns the caller named are left out of the rule.
        """
        part = "tau" if meaning == CURRENT else meaning
        if self.assigned[part].keys() - self.requested_entries[part]:
            return []
        entries = self.without_column(part)
        names = [self.names[part][k] for k in entries]
        rule, columns = _match_by_rules(group, names, other_joints)
        if not columns:
            return []
        suffix = SUFFIX["command"] if part == "command" else ""
        cells: list[str] = []
        pair_texts: list[str] = []
        for k, name, (column, _, unit_in_name) in zip(entries, names, columns, strict=True):
            cell = self.cells[column]
            unit = self.units[column] or unit_in_name or _DEFAULT_UNITS.get(meaning)
            self.assign(part, k, Choice(column, unit))
            cells.append(cell)
            pair_texts.append(f"{cell} is {name}{suffix}")
        if len(cells) == 1:
            self.notes.append(f"Column {cells[0]!r} is taken to be that of {names[0]}, the only joint.")
            return cells
        note = f"Columns {cells[0]} … {cells[-1]} are taken {rule}: {listed(pair_texts)}."
        if rule.startswith("by "):
            note = ReadingNote(note)  # the order of the columns is not a guess
        self.notes.append(note)
        return cells

    def rising_time(self, first_numbers: Callable[[int], Array]) -> Choice | None:
        """The only unassigned column that increases in every row; None if a rate is given, or if several or no columns do."""
        if self.reading.rate is not None:
            return None
        free_cells = {column: self.cells[column] for column in self.free_columns}
        rising = rising_columns(free_cells, first_numbers)
        if len(rising) != 1:
            return None
        choice = self.choice(rising[0])
        self.use(choice.column)
        self.notes.append(
            f"Column {self.cells[choice.column]!r} is taken to be the time, the only one that rises in every row."
        )
        return choice

    def usual_rate(self) -> str:
        """Hint for the error message at the usual sampling rate of the program that wrote the file; empty if unknown."""
        if any("observations/qpos" in cell for cell in self.cells):
            return " (ALOHA records 50)"
        return ""

    def choices(self) -> dict[str, list[Choice]]:
        """Columns of each part of the motion in the order of its entries; ``_NO_COLUMN`` for joints without a command."""
        choices = {}
        for part, choice_by_index in self.assigned.items():
            choices[part] = [choice_by_index[k] for k in sorted(choice_by_index)]
        commands = self.assigned["command"]
        if commands:
            choices["command"] = [commands.get(k, _NO_COLUMN) for k in range(len(self.names["command"]))]
        return choices

    def without_columns(
        self, missing_names: Sequence[str], first_numbers: Callable[[int], Array], *, timeless: bool
    ) -> TrajectoryError:
        """Error for coordinates without a column, with arguments to copy."""
        all_missing = len(missing_names) == len(self.names["q"])
        varying = set(varying_columns(self.cells, self.extra, first_numbers))
        unused_cells = [cell for cell in self.extra if cell in varying]
        arm_error = self.arm_error(missing_names, unused_cells)
        if arm_error:
            return arm_error
        if all_missing:
            columns_in_order = series(unused_cells, len(missing_names))
            if columns_in_order:
                return self._error_for_series(missing_names, columns_in_order, first_numbers, timeless=timeless)
        similar_columns = alike(missing_names, self.extra)
        hint = ""
        few_are_similar = len(similar_columns) < len(missing_names) / 2
        others_are_unknown = len(self.extra) > len(similar_columns)
        if all_missing and few_are_similar and others_are_unknown:
            hint = " No column has the name of a joint of this robot: the file seems to be a log of another one."
            similar_columns = {}
        elif similar_columns:
            name, cell = next(iter(similar_columns.items()))  # the first pair
            hint = f" Column {cell!r} is not a joint of this robot. Did you mean {name!r}?"
        missing_joints = list(dict.fromkeys(map(_joint, missing_names)))
        names_to_lock = ["PATTERN*"]
        if len(missing_joints) <= _MAX_LOCKED_NAMES and not all_missing:
            names_to_lock = missing_joints
        remedy = "; or hold joints still that never move, when the robot is loaded: {1}"
        are_joints_of_one_coordinate = {*missing_joints} <= {*missing_names}
        if not are_joints_of_one_coordinate:  # no option holds other joints still
            remedy = "; if the pose of the base was not logged, load the robot with its base fixed"
        if not all_missing and unused_cells:
            remedy = f" (columns that vary and are not used: {listed(unused_cells)})"
        return TrajectoryError(
            f"{self.where}: no column for {listed(missing_names)}.{hint} Expected: {listed(self.names['q'])}; "
            f"{self.found_text()} Say which they are: {{0}}{remedy}.",
            _columns_argument(missing_names, similar_columns, timeless=timeless),
            Argument("lock", dict.fromkeys(names_to_lock, 0)),
        )

    def _error_for_series(
        self,
        missing_names: Sequence[str],
        columns_in_order: Sequence[str],
        first_numbers: Callable[[int], Array],
        *,
        timeless: bool,
    ) -> TrajectoryError:
        """Error for joints without a column, if the file has as many columns whose names differ by a number."""
        first_cell = columns_in_order[0]
        last_cell = columns_in_order[-1]
        column_by_name = dict(zip(missing_names, columns_in_order, strict=True))
        hint = f" Columns {first_cell} … {last_cell} match no joint by name. If they are the joints in order:"
        values = np.concatenate([first_numbers(self.cells.index(cell)) for cell in columns_in_order])
        options = "{0}"
        seem_degrees = np.abs(values).max() > math.tau
        if seem_degrees and not self.degrees:
            options += " {1}"
        if timeless:
            options += f", and {{2}}{self.usual_rate()} in place of the column of time if there is none"
        return TrajectoryError(
            f"{self.where}: no column for {listed(missing_names)}.{hint} {options}; {self.found_text()}",
            _columns_argument(missing_names, column_by_name, timeless=timeless),
            Argument("degrees", True),
            Argument("rate", Placeholder("HZ")),
        )

    def logged_arm(self, unused_cells: Sequence[str]) -> list[str]:
        """Coordinates of the arm, or of all arms, that have columns, if the robot has joints beside them; otherwise empty.

        Columns fit by name if none of ``unused_cells`` may be another joint's, or by a rule that matches all joints of an arm.
        """
        arm = self._fitting_arms(unused_cells)
        if arm is None:
            return []
        other_coordinates = self.coordinates_beside(arm)
        other_joints = [_joint(coordinate) for coordinate in other_coordinates]
        have_one_coordinate = other_joints == other_coordinates
        if len(other_coordinates) > _MAX_JOINTS_BESIDE or not have_one_coordinate:
            return []
        return list(arm)

    def coordinates_beside(self, group: Sequence[str]) -> list[str]:
        """Coordinates that are not in a group."""
        return [name for name in self.names["q"] if name not in group]

    def arm_error(self, missing_names: Sequence[str], unused_cells: Sequence[str]) -> TrajectoryError | None:
        """Error for a log of an arm, or of all arms, of a robot that has joints beside them; None for other logs."""
        arm = self.logged_arm(unused_cells)
        if not arm:
            return None
        other_names = self.coordinates_beside(arm)
        joints_of_all_arms = sum(map(len, self.arms))
        arm_text = "the arms"
        if len(arm) < joints_of_all_arms:
            arm_text = f"one arm, {arm[0]} to {arm[-1]}"
        elif len(self.arms) == 1:
            arm_text = "the arm"
        others_text = f"{other_names[-1]} has"
        if len(other_names) > 1:
            others_text = f"{', '.join(other_names[:-1])} and {other_names[-1]} have"
        columns = {"JOINT": "COLUMN"}
        if len(missing_names) == len(other_names):
            columns = dict.fromkeys(missing_names, "COLUMN")
        return TrajectoryError(
            f"{self.where}: {len(arm)} columns fit the {len(arm)} joints of {arm_text}; {others_text} none: load the robot "
            f"with {{0}}. If there are columns for more of them, name these: {{1}}; {self.found_text()}",
            Argument("lock", dict.fromkeys(other_names, 0)),
            Argument("columns", columns),
        )

    def _fitting_arms(self, unused_cells: Sequence[str]) -> Sequence[str] | None:
        """Joints of the only arm, or of all arms, whose columns the log has; None otherwise, or without joints beside them."""
        names = self.names["q"]
        fitting_arms: list[list[str]] = []
        joints_of_all_arms: list[str] = []
        for arm in self.arms:
            joints = [names[k] for k in arm]
            joints_of_all_arms += joints
            if len(joints) < len(names) and self.has_columns_of(joints, unused_cells):
                fitting_arms.append(joints)
        if len(fitting_arms) == 1:
            return fitting_arms[0]
        robot_has_other_joints = len(joints_of_all_arms) < len(names)
        if fitting_arms or len(self.arms) < 2 or not robot_has_other_joints:
            return None
        if self.has_columns_of(joints_of_all_arms, unused_cells):
            return joints_of_all_arms
        return None

    def has_columns_of(self, group: Sequence[str], unused_cells: Sequence[str]) -> bool:
        """True if the log has the positions of exactly this group of joints, by name or by a rule that matches all of them."""
        names = self.names["q"]
        if self.assigned["q"]:
            return not unused_cells and {names[k] for k in self.assigned["q"]} == {*group}
        columns = candidates(self.free_names()).get("q", [])
        other_joints = [*self.reading.locked, *self.coordinates_beside(group)]
        _, matches = _match_by_rules(columns, group, other_joints)
        return bool(matches)

    def check_complete(self, first_numbers: Callable[[int], Array]) -> None:
        """Raise TrajectoryError if time, coordinates or rates are missing; ``first_numbers`` returns a column's numbers."""
        missing_names = [self.names["q"][k] for k in self.without_column("q")]
        timeless = self.time is None and self.reading.rate is None
        if missing_names:
            raise self.without_columns(missing_names, first_numbers, timeless=timeless)
        if timeless:
            raise TrajectoryError(
                f"{self.where}: no time column. Name one 'time' (or 't'), in seconds; or give {{0}}, or "
                f"the rows per second, {{1}}{self.usual_rate()}; {self.found_text()}",
                Argument("columns", {"time": "COLUMN"}),
                Argument("rate", Placeholder("HZ")),
            )
        for part in ("dq", "ddq"):
            absent = [self.names[part][k] + SUFFIX[part] for k in self.without_column(part)]
            only_some_are_absent = 0 < len(absent) < len(self.names[part])
            if only_some_are_absent:
                raise TrajectoryError(
                    f"{self.where}: no column {listed(absent)}, although others of its kind are there.{self._hint_at(absent)} "
                    f"Give them for every joint, or for none: then they are derived. Or assign it: {{0}}; "
                    f"{self.found_text()}",
                    Argument("columns", {absent[0]: "COLUMN"}),
                )

    def _hint_at(self, absent: Sequence[str]) -> str:
        """Hint at the first absent name that is similar to an unread column; empty without one."""
        for cell in self.extra:
            suggestion = _suggestion(cell, absent)
            if suggestion:
                return suggestion
        return ""


def _suggestion(name: str, choices: Sequence[str]) -> str:
    """Question for the choice that is most similar to a name, to be appended to a sentence; empty without one."""
    similar = difflib.get_close_matches(name, choices, n=1, cutoff=0.6)
    return f" Did you mean {similar[0]!r}?" if similar else ""


def _columns_argument(missing_names: Sequence[str], columns: Mapping[str, str], *, timeless: bool) -> Argument:
    """Option ``columns`` with a column for each missing coordinate, and for the time if there is none."""
    entries = {"time": "COLUMN"} if timeless else {}
    for name in missing_names:
        entries[name] = columns.get(name, "COLUMN")
    return Argument("columns", entries)


def _match_by_rules(
    group: Sequence[Candidate], names: Sequence[str], other_joints: Sequence[str]
) -> tuple[str, list[Candidate]]:
    """First rule that matches all joints, and their columns; both empty without such a rule."""
    for rule, match in RULES.items():
        columns = match(group, names, other_joints)
        if columns:
            return rule, columns
    return "", []


def belongs(text: str, locked: Sequence[str]) -> bool:
    """True if the name of a column names a locked joint, or a quantity of a locked joint."""
    for joint in locked:
        if text == joint or text.startswith(f"{joint}."):
            return True
    return NamedJoints(locked).meaning(text) is not None


def absent_joints(
    cells: Sequence[str],
    coordinates: Coordinates,
    joints: Sequence[str],
    columns: Mapping[str, str],
    path: Path,
) -> tuple[str, ...]:
    """Joints without a position column in this header, by name or by ``columns``."""
    assignment = Assignment(cells, "", coordinates, Reading(path))
    names = list(assignment.names["q"])
    name_by_key = {f"{name}.pos": name for name in names} | {name: name for name in names}
    for key in assignment.entries_for_log(columns, name_by_key):
        if key in name_by_key:
            k = names.index(name_by_key[key])
            assignment.assigned["q"][k] = Choice(0)  # some column: only its presence counts here
    assignment.assign_by_exact_name()
    assignment.assign_by_words()
    present = {names[k] for k in assignment.assigned["q"]}
    if not present:
        position_columns = candidates(assignment.free_names()).get("q", [])
        matches = match_most_by_prefix(position_columns, names)
        present = {name for name, column in zip(names, matches, strict=True) if column is not None}
    if not present:
        present = {*assignment.logged_arm(unused_cells=())}
    joints_present = {*present, *map(_joint, present)}
    return tuple(joint for joint in joints if joint not in joints_present)


class MimicJointColumn(NamedTuple):
    """Column of a mimic joint."""

    follower: MimicJoint
    column: int
    """Index in the table."""
    factor: float
    """Factor to SI units."""


def _lists_columns(keys: Iterable[str]) -> bool:
    """True if one of the keys, after the name of a log, is a number in the order of the coordinates."""
    for key in keys:
        _, _, name = key.rpartition(":")
        if name.startswith(ORDER):
            return True
    return False


def _seconds_per_unit(rate: float | None, time_unit: str | None) -> float:
    """Seconds for each unit of the time column, or for each sample if the rate [1/s] is given."""
    if rate:
        return 1.0 / rate
    return time_factor(time_unit or "s") or 1.0


def _is_angular(part: str, coordinates: Coordinates, *, of_motors: bool) -> list[bool]:
    """True for each coordinate, velocity or drive of a part of the motion that is an angle or a torque."""
    if part == "tau" and of_motors:
        return list(coordinates.drive_turns)
    if part == "q":
        return coordinates.angular.tolist()
    return coordinates.angular_velocity.tolist()


@dataclass(frozen=True, eq=False)
class Columns:
    """Indices of time, q, dq, ddq and torques in the table of a log, which contains only the used columns."""

    header: tuple[str, ...]
    """Header of the table."""
    used: tuple[int, ...]
    """Indices in the file; without a time column, the table starts with the row number as an additional column."""
    time: int
    """Index of the time column."""
    seconds: float
    """Factor from the file's time, or from the row number, to seconds."""
    counted: bool
    """True if the row number replaces a missing time column."""
    time_stated: bool
    """True if the file or the caller specifies the unit of time."""
    places: dict[str, Array | None]
    """Columns of ``q``, ``dq``, ``ddq``, ``tau``, ``command`` in the robot's order, or None if absent; -1: no command."""
    factors: dict[str, Array]
    """Factors to SI units."""
    angle: Array
    """(nq,) factors from the file's angles to radians; 1 for other coordinates."""
    angle_stated: Array
    """(nq,) True if the column's name or the caller specifies the unit."""
    of_locked: tuple[str, ...] = ()
    """Ignored columns of locked joints."""
    extra: tuple[str, ...] = ()
    """Ignored columns that are unrelated to this robot."""
    quaternions: tuple[Array, ...] = ()
    """Columns of each quaternion."""
    notes: tuple[str, ...] = ()
    """Sentences about assumptions."""
    mimic_joints: tuple[MimicJointColumn, ...] = ()
    """Columns of mimic joints."""
    of_motors: bool = False
    """True if torques of coupled joints are motor torques."""
    listed: bool = False
    """True if the caller listed the columns in the order of the coordinates."""

    @classmethod
    def from_header(
        cls,
        header: Sequence[str],
        coordinates: Coordinates,
        where: str,
        reading: Reading,
        first_numbers: Callable[[int], Array],
    ) -> Columns:
        """Columns from the header's cells; errors (:class:`~twistwrench.TrajectoryError`) begin with ``where``.

        ``first_numbers`` returns the first numbers of a column, used if its name does not specify the unit.
        """
        assignment = Assignment.from_header(header, coordinates, where, reading, first_numbers)
        choices_by_part = assignment.choices()
        time_unit = None
        has_row_numbers = assignment.time is None
        read_choices = list(itertools.chain(*choices_by_part.values()))
        read_choices += [choice for _, choice in assignment.mimic_joints]
        if assignment.time is not None:
            time_unit = assignment.time.unit
            read_choices.insert(0, assignment.time)
        used = [choice.column for choice in read_choices if choice is not _NO_COLUMN]
        # Index in the table by column of the file. The last entry is for _NO_COLUMN, whose column is -1.
        table_index = np.full(len(header) + 1, _NO_COLUMN.column)
        first_index = 1 if has_row_numbers else 0
        table_index[used] = np.arange(len(used)) + first_index
        places: dict[str, Array | None] = {}
        factors = {}
        for part, choices in choices_by_part.items():
            columns = [choice.column for choice in choices]
            places[part] = table_index[columns] if columns else None
            angular = _is_angular(part, coordinates, of_motors=assignment.of_motors)
            if not choices:  # factors of a part without columns
                choices = [_NO_COLUMN] * len(angular)
            factors[part] = assignment.factors(choices, part, angular)
        mimic_joints = []
        for follower, choice in assignment.mimic_joints:
            factor = assignment.factor(choice, "q", follower.angular)
            mimic_joints.append(MimicJointColumn(follower, int(table_index[choice.column]), factor))
        q_choices = choices_by_part["q"]
        q_indices = table_index[[choice.column for choice in q_choices]]
        table_header = assignment.cells_of(used)
        if has_row_numbers:
            table_header.insert(0, "time")
        return cls(
            header=tuple(table_header),
            used=tuple(used),
            time=0,
            seconds=_seconds_per_unit(reading.rate, time_unit),
            counted=has_row_numbers,
            time_stated=reading.rate is not None or time_unit is not None,
            places=places,
            factors=factors,
            angle=np.where(coordinates.angular, factors["q"], 1.0),
            angle_stated=np.array([choice.unit is not None for choice in q_choices], bool),
            of_locked=tuple(assignment.of_locked),
            extra=tuple(assignment.extra),
            quaternions=tuple(q_indices[entries] for entries in coordinates.quaternions),
            notes=tuple(assignment.notes),
            of_motors=assignment.of_motors,
            listed=_lists_columns(reading.columns or ()),
            mimic_joints=tuple(mimic_joints),
        )

    @property
    def has_degrees(self) -> bool:
        """True if the file has angles in degrees."""
        return bool((self.angle == math.radians(1.0)).any())

    def si_values(self, table: Array, part: str) -> Any:
        """Columns of ``part`` of a table (n, columns) in SI units, NaN for joints without a command; None if absent."""
        columns = self.places[part]
        if columns is None:
            return None
        values = table[:, columns] * self.factors[part]
        values[:, columns == _NO_COLUMN.column] = np.nan
        return values
