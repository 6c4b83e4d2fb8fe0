"""Assignment of log columns to coordinates, velocities, accelerations and torques, with units and error messages."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Collection, Mapping, Sequence
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
    most_by_prefix,
    rising_columns,
    series,
    varying_columns,
)
from .readers.csv_reader import is_number

_FEW = 4
_MOST_BESIDE = 12
"""Most joints beside an arm that an error message lists."""
ORDER = "#"
"""Prefix of keys for columns listed in the order of the coordinates: ``#1``, ``#2`` …"""


def _joint(coordinate: str) -> str:
    """Joint of a coordinate; coordinates of planar and floating joints have a suffix."""
    base, dot, suffix = coordinate.rpartition(".")
    return base if dot and suffix in ("x", "y", "z", "theta", "qw", "qx", "qy", "qz") else coordinate


# ── Assignment of columns: by request, by exact name, by logger names, by number


@dataclass(frozen=True)
class Choice:
    """Column of a file, with its unit if given."""

    column: int
    unit: str | None = None
    gain: float | None = None
    """Torque per unit of a current column."""


_NONE = Choice(-1)
"""Column of a joint without one."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Options for reading a file."""

    path: Path
    columns: Mapping[str, str] | None = None
    """Columns by quantity (``{"elbow": "pos3", "elbow.vel": "w3", "time": "stamp [ms]"}``); others are found by name.

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
        self.cells, self.where, self.reading, self.arms = cells, where, reading, coordinates.arms
        self.names = {part: coordinates.names if part == "q" else coordinates.velocity_names for part in PARTS}
        motors = {*coordinates.drive_names} - {*coordinates.velocity_names}
        named = [*(split_unit(cell)[0] for cell in cells), *(reading.columns or {})]
        keys = {f"{motor}{ending}" for motor in motors for ending in ("", f".{CURRENT}", *READ["tau"])}
        self.motors = motors
        self.of_motors = bool(motors) and any(name.rpartition(":")[2] in keys for name in named)
        """True if torques of coupled joints are motor torques, according to the column names."""
        if self.of_motors:
            self.names["tau"] = coordinates.drive_names
        self.free = [k for k, cell in enumerate(cells) if cell]
        """Unassigned columns."""
        self.split = [(cell, None) if cell in coordinates.names else split_unit(cell) for cell in cells]
        """Name and unit of each column; joint names that end in brackets are kept whole."""
        self.given: dict[str, dict[int, Choice]] = {part: {} for part in PARTS}
        """Columns of each part of the motion, by coordinate index."""
        self.requested_names: dict[str, set[int]] = {part: set() for part in PARTS}
        """Indices of the coordinates whose columns the caller named, by part."""
        self.notes: list[str] = []
        self.degrees = reading.degrees
        self.time: Choice | None = None
        self.mimic_joints: list[tuple[MimicJoint, Choice]] = []
        self.of_locked: list[str] = []
        """Columns of locked joints."""
        self.extra: list[str] = []
        """Columns without a known meaning."""

    @classmethod
    def from_header(
        cls,
        cells: Sequence[str],
        coordinates: Coordinates,
        where: str,
        reading: Reading,
        look: Callable[[int], Array],
    ) -> Assignment:
        """Assign the header's columns to the robot's coordinates; raises TrajectoryError and UnknownNameError.

        ``look`` returns the first numbers of a column.
        """
        check_header(cells, where)
        found = cls(cells, where, coordinates, reading)
        requested = found.requested(reading.columns or {})
        found.time = found.assign_time(requested.pop(("time", 0), None), reading.rate, look)
        for (part, k), choice in requested.items():
            found.assign(part, k, choice)
            found.requested_names[part].add(k)
        found.assign_by_exact_name()
        found.assign_by_words()
        found.assign_by_rules([*reading.locked, *(follower.name for follower in coordinates.mimic_joints)])
        found.take_currents()
        found.time = found.time or found.rising_time(look)
        for follower in coordinates.mimic_joints:
            own = [c for c in found.free if found.split[c][0] == follower.name]
            found.mimic_joints += [(follower, Choice(c, found.split[c][1])) for c in own[:1]]
        mimic = [choice.column for _, choice in found.mimic_joints]
        of_locked = [k for k in found.free if belongs(found.split[k][0], reading.locked)]
        if len(found.given["tau"]) < len(found.names["tau"]):
            # Torques are only compared with others, so some joints may lack them.
            found.free += [choice.column for choice in found.given["tau"].values()]
            found.given["tau"] = {}
        unread = [k for k in sorted(found.free) if k not in of_locked and k not in mimic]
        found.of_locked = [cells[k] for k in of_locked]
        found.extra = [cells[k] for k in unread if not (is_result(cells[k]) or is_command(cells[k]))]
        found.check_complete(look)
        if unnamed := [str(k + 1) for k, cell in enumerate(cells) if not cell]:
            found.notes.append(f"Columns without a name are ignored: {', '.join(unnamed)}.")
        return found

    def factor(self, choice: Choice, part: str, angular: bool) -> float:
        """Factor from a column to SI units: by its unit or gain, otherwise by the common unit of angles."""
        if choice.gain is not None:
            return choice.gain
        if choice.unit is not None:
            return unit_factor(choice.unit, part, angular, f"{self.where}, column {self.cells[choice.column]!r}")
        return math.radians(1.0) if self.degrees and angular and part != "tau" else 1.0

    def found(self) -> str:
        """List of the column names, for the end of an error message."""
        return f"found: {listed([cell or '(no name)' for cell in self.cells])}."

    def column(self, name: str, given: Argument) -> Choice:
        """Column by name, with or without its unit; errors name the argument that was given."""
        base, unit = split_unit(name)
        exact = [k for k, cell in enumerate(self.cells) if cell == name.strip()]
        alike = exact or [k for k, (text, _) in enumerate(self.split) if text == base]
        if not alike:
            near = difflib.get_close_matches(name, [c for c in self.cells if c], n=1, cutoff=0.6)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise TrajectoryError(f"{self.where}: no column {name!r}, which {{0}} names.{hint} {self.found()}", given)
        if len(alike) > 1:
            raise self.repeated(name.strip(), len(alike))
        return Choice(alike[0], unit or self.split[alike[0]][1])

    def repeated(self, name: str, count: int) -> TrajectoryError:
        """Error for a column that occurs more than once."""
        return TrajectoryError(f"{self.where}: column {name!r} is there {count} times. Keep one of them.")

    def assign(self, part: str, k: int, choice: Choice) -> None:
        """Assign a column to a coordinate."""
        self.given[part][k] = choice
        self.free = [c for c in self.free if c != choice.column]

    def requested(self, columns: Mapping[str, str]) -> dict[tuple[str, int], Choice]:
        """Columns of the option ``columns``, by part and coordinate index."""
        suffixes = {
            ".pos": "q",
            f".{CURRENT}": "tau",
            **{suffix: part for part, endings in READ.items() for suffix in endings},
        }
        known = {f"{n}{suffix}": (part, k) for suffix, part in suffixes.items() for k, n in enumerate(self.names[part])}
        known["time"] = ("time", 0)
        found: dict[tuple[str, int], Choice] = {}
        for key, name in self.in_order(self.of_this_log(columns, known)).items():
            if key not in known:
                raise UnknownNameError.from_choices(
                    f"coordinate (of {argument('columns')})", key, ["time", *self.names["q"]]
                )
            if known[key] in found:
                raise TrajectoryError(
                    f"{self.where}: {{0}} assigns {key!r} twice. Keep one of them.", Argument("columns")
                )
            choice = self.column(name, Argument("columns", {key: name}))
            found[known[key]] = replace(choice, unit=choice.unit or "A") if key.endswith(f".{CURRENT}") else choice
        return found

    def in_order(self, columns: Mapping[str, str]) -> dict[str, str]:
        """Replace ``#1``, ``#2`` … in ``columns`` by the joints' names."""
        names, listing = self.names["q"], [key for key in columns if key.startswith(ORDER) and key[1:].isdigit()]
        if listing and len(listing) != len(names):
            raise TrajectoryError(
                f"{self.where}: {{0}} lists {len(listing)} columns, and the robot has {len(names)} coordinates: "
                f"{listed(names)}. List one for each, or name the joint of each.",
                Argument("columns"),
            )
        return {names[int(key[1:]) - 1] if key in listing else key: column for key, column in columns.items()}

    def of_this_log(self, columns: Mapping[str, str], known: Collection[str]) -> dict[str, str]:
        """Entries of ``columns`` for this log; entries with its path or name as prefix override general ones."""
        found, own = dict[str, str](), dict[str, str]()
        for key, column in columns.items():
            rest = max((name for name in known if key.endswith(f":{name}")), key=len, default="")
            if key in known or not rest:
                found[key] = column
            elif key.removesuffix(f":{rest}") in (str(self.reading.path), self.reading.path.name):
                own[rest] = column
        return found | own

    def take_currents(self) -> None:
        """Convert currents in torque columns by the gains; raises TrajectoryError if the unit is that of a torque."""
        names, gains = self.names["tau"], self.reading.gain or {}
        for name in gains:
            if name.removesuffix(f".{CURRENT}") not in {*names} | self.motors:
                raise UnknownNameError.from_choices(f"joint (of {argument('gain')})", name, names)
        for k, choice in self.given["tau"].items():
            ampere = 1.0 if choice.unit is None else current_factor(choice.unit)
            known = gains.get(f"{names[k]}.{CURRENT}") if choice.unit is not None and ampere else None
            gain = gains.get(names[k], known)
            if gain is not None and ampere is None:
                raise TrajectoryError(
                    f"{self.where}, column {self.cells[choice.column]!r}: {{0}} of {names[k]} is for a current, and this is a "
                    f"torque in {choice.unit}. Leave out one of them.",
                    Argument("gain"),
                )
            if gain is not None and ampere is not None:
                self.given["tau"][k] = replace(choice, gain=gain * ampere)

    def assign_time(self, requested: Choice | None, rate: float | None, look: Callable[[int], Array]) -> Choice | None:
        """Time column by name or unit; None if there is none. With a ``rate``, it may only have row numbers."""
        ranked = sorted((rank[0], k) for k in self.free if (rank := time_meaning(self.split[k][0])) is not None)
        if others := [(rank, k) for rank, k in ranked if self.cells[k] not in self.names["q"]]:
            ranked = others  # a joint may be named t
        first = [k for rank, k in ranked if rank == ranked[0][0]]
        if rate is not None:
            if not requested and not first:
                return None
            column = requested.column if requested else first[0]
            if (requested is None or requested.unit is None) and counts_rows(look(column)):
                self.notes.append(f"Column {self.cells[column]!r} is read as the number of a row, by its numbers.")
                self.free = [k for k in self.free if k != column]
                return Choice(column)
            raise TrajectoryError(
                f"{self.where}: {{0}} is given, and column {self.cells[column]!r} is time. Leave out one of them.",
                Argument("rate"),
            )
        if requested is None and not first:
            timed = [k for k in self.free if time_factor(self.split[k][1] or "") is not None]
            timed = rising_columns({k: self.cells[k] for k in timed}, look)
            if len(timed) != 1:
                return None
            requested = Choice(timed[0], self.split[timed[0]][1])
        if requested is None and len(first) > 1:
            raise TrajectoryError(
                f"{self.where}: two time columns, {listed([self.cells[k] for k in first])}. Keep one of them, or choose: "
                "{0}.",
                Argument("columns", {"time": self.cells[first[0]]}),
            )
        choice = requested or Choice(
            first[0], self.split[first[0]][1] or (time_meaning(self.split[first[0]][0]) or (0, None))[1]
        )
        noted = False
        if choice.unit is None and self.split[choice.column][0] == ROS_TIME:
            whole = ros_nanoseconds(look(choice.column))
            kind = "whole numbers, so time is read in ns" if whole else "no whole nanoseconds, so time is read in s"
            self.notes.append(f"Column {ROS_TIME!r} has {kind}.")
            choice, noted = Choice(choice.column, "ns" if whole else None), True
        if choice.unit is None and not noted and (unit := unit_since_1970(look(choice.column))) is not None:
            self.notes.append(
                f"Time is read in {unit} since 1970 from column {self.cells[choice.column]!r}, by its numbers."
            )
            choice, noted = Choice(choice.column, unit), True
        if choice.unit is not None and time_factor(choice.unit) is None:
            raise TrajectoryError(
                f"{self.where}, column {self.cells[choice.column]!r}: {choice.unit!r} is not a unit of time. Known: s, ms, us, "
                "ns, min."
            )
        if choice.unit is not None and time_factor(choice.unit) != 1.0 and not noted:
            self.notes.append(ReadingNote(f"Time is read in {choice.unit} from column {self.cells[choice.column]!r}."))
        self.free = [k for k in self.free if k != choice.column]
        return choice

    def assign_by_exact_name(self) -> None:
        """Assign columns with the names used in written files."""
        by_text: dict[str, list[int]] = {}
        for k in self.free:
            by_text.setdefault(self.split[k][0], []).append(k)
        for part in self.reading.parts:
            for k, name in enumerate(self.names[part]):
                for ending in READ[part]:
                    columns = by_text.get(f"{name}{ending}", [])
                    if len(columns) > 1 and k not in self.given[part]:
                        raise self.repeated(f"{name}{ending}", len(columns))
                    if columns and k not in self.given[part]:
                        self.assign(part, k, Choice(columns[0], self.split[columns[0]][1]))

    def assign_by_words(self) -> None:
        """Assign columns whose names contain a joint's name and words for a quantity."""
        readers = {part: NamedJoints(self.names[part]) for part in ("q", "dq")}
        driven = NamedJoints(self.names["tau"])
        found: dict[tuple[str, int], list[int]] = {}
        units: dict[int, str | None] = {}
        for k in self.free:
            text, unit = self.split[k]
            for kind, reader in readers.items():
                meant = reader.meaning(text)
                if self.of_motors and kind == "dq" and (meant is None or meant.part in ("tau", CURRENT)):
                    meant = driven.meaning(text)
                if meant is not None and meant.part == "command" and not self.reading.commands:
                    continue
                if meant is not None and (meant.part == "q") == (kind == "q"):
                    found.setdefault((meant.part, meant.name), []).append(k)
                    units[k] = unit or meant.unit or ("A" if meant.part == CURRENT else None)
                    break
        assigned = []
        for (meant_part, k), columns in sorted(found.items(), key=lambda item: item[0][0] == CURRENT):
            part, gains = ("tau", self.reading.gain) if meant_part == CURRENT else (meant_part, {})
            if gains and self.names[part][k] in gains:
                self.free += [choice.column for choice in [self.given[part].pop(k, None)] if choice]
            if k in self.given[part] or (meant_part == CURRENT and not gains):
                continue
            key = self.names[part][k] + ("" if part == "q" else READ[part][0])
            if len(columns) > 1:
                shown = [self.cells[column] for column in columns]
                raise TrajectoryError(
                    f"{self.where}: {listed(shown)} may all be {key}. Say which: {{0}}.",
                    Argument("columns", {key: shown[0]}),
                )
            self.assign(part, k, Choice(columns[0], units[columns[0]]))
            assigned.append((self.cells[columns[0]], key))
        if assigned:
            others = f", and {len(assigned) - 1} more likewise" if len(assigned) > 1 else ""
            self.notes.append(ReadingNote(f"Column {assigned[0][0]!r} is taken to be {assigned[0][1]}{others}."))

    def assign_by_rules(self, others: Sequence[str]) -> None:
        """Assign columns by the first rule that matches all joints; ``others`` are joints without a coordinate."""
        texts = {k: self.split[k][0] for k in self.free}
        for meant, found in candidates(texts).items():
            if meant == CURRENT and not self.reading.gain:
                continue
            cells = self.assign_group(meant, found, others)
            if meant == "q" and not self.degrees and are_in_degrees(cells):
                self.degrees = True
                self.notes.append(f"Columns named {cells[0]} … {cells[-1]} are in degrees, as their maker writes them.")
        if self.reading.commands:
            for group in command_candidates({k: text for k, text in texts.items() if k in self.free}):
                self.assign_group("command", group, others)

    def assign_group(self, meant: str, found: Sequence[Candidate], others: Sequence[str]) -> list[str]:
        """Assign columns of one quantity by the first rule that matches all joints; returns their names, or none.

        Joints whose columns the caller named are left out of the rule.
        """
        part = "tau" if meant == CURRENT else meant
        if self.given[part].keys() - self.requested_names[part]:
            return []
        remaining = [k for k in range(len(self.names[part])) if k not in self.given[part]]
        names = [self.names[part][k] for k in remaining]
        chosen = ((rule, columns) for rule, of in RULES.items() if (columns := of(found, names, others)))
        rule, columns = next(chosen, ("", []))
        for k, (column, _, unit) in zip(remaining, columns, strict=bool(columns)):
            self.assign(part, k, Choice(column, self.split[column][1] or unit or ("A" if meant == CURRENT else None)))
        cells = [self.cells[c.column] for c in columns]
        if len(cells) > 1:
            pairs = listed(
                [
                    f"{cell} is {name}{SUFFIX[part] * (part == 'command')}"
                    for cell, name in zip(cells, names, strict=True)
                ]
            )
            note = f"Columns {cells[0]} … {cells[-1]} are taken {rule}: {pairs}."
            self.notes.append(ReadingNote(note) if rule.startswith("by ") else note)  # their order is a guess
        elif cells:
            self.notes.append(f"Column {cells[0]!r} is taken to be that of {names[0]}, the only joint.")
        return cells

    def rising_time(self, look: Callable[[int], Array]) -> Choice | None:
        """The only unassigned column that increases in every row; None if a rate is given, or without a unique one."""
        if self.reading.rate is not None:
            return None
        rising = rising_columns({k: self.cells[k] for k in self.free}, look)
        if len(rising) != 1:
            return None
        self.free.remove(rising[0])
        self.notes.append(
            f"Column {self.cells[rising[0]]!r} is taken to be the time, the only one that rises in every row."
        )
        return Choice(rising[0], self.split[rising[0]][1])

    def usual_rate(self) -> str:
        """Hint for the error message: usual sampling rate of recordings without a time column."""
        return " (ALOHA records 50)" if any("observations/qpos" in cell for cell in self.cells) else ""

    def without_columns(
        self, missing: Sequence[str], look: Callable[[int], Array], *, timeless: bool
    ) -> TrajectoryError:
        """Error for coordinates without a column, with arguments to copy."""
        all_missing = len(missing) == len(self.names["q"])
        varying = set(varying_columns(self.cells, self.extra, look))
        may_be = [cell for cell in self.extra if cell in varying]
        if found := self.of_arms(missing, unused=may_be):
            return found
        in_order = series(may_be, len(missing)) if all_missing else []
        near = dict(zip(missing, in_order, strict=True)) if in_order else alike(missing, self.extra)
        hint = ""
        if in_order:
            hint = f" Columns {in_order[0]} … {in_order[-1]} match no joint by name. If they are the joints in order:"
        elif all_missing and 2 * len(near) < len(missing) and len(self.extra) > len(near):
            hint = " No column has the name of a joint of this robot: the file seems to be a log of another one."
            near = {}
        elif near:
            name, cell = next(iter(near.items()))
            hint = f" Column {cell!r} is not a joint of this robot. Did you mean {name!r}?"
        told = {"time": "COLUMN"} if timeless else {}
        which = Argument("columns", told | {name: near.get(name, "COLUMN") for name in missing})
        if in_order:
            spans = [np.abs(look(self.cells.index(cell))).max() for cell in in_order]
            degrees = " {1}" if max(spans) > math.tau and not self.degrees else ""
            no_time = f", and {{2}}{self.usual_rate()} in place of the column of time if there is none"
            ways = f"{{0}}{degrees}{no_time if timeless else ''}"
            return TrajectoryError(
                f"{self.where}: no column for {listed(missing)}.{hint} {ways}; {self.found()}",
                which,
                Argument("degrees", True),
                Argument("rate", Placeholder("HZ")),
            )
        joints = list(dict.fromkeys(_joint(name) for name in missing))
        few = dict.fromkeys(joints if len(joints) <= _FEW and not all_missing else ["PATTERN*"], 0)
        held = "; or hold joints still that never move, when the robot is loaded: {1}"
        if any(name not in missing for name in joints):  # a joint of several coordinates, which no option holds still
            held = "; if the pose of the base was not logged, load the robot with its base fixed"
        if not all_missing and may_be:
            held = f" (columns that vary and are not used: {listed(may_be)})"
        return TrajectoryError(
            f"{self.where}: no column for {listed(missing)}.{hint} Expected: {listed(self.names['q'])}; {self.found()} "
            f"Say which they are: {{0}}{held}.",
            which,
            Argument("lock", few),
        )

    def logged_arm(self, unused: Sequence[str]) -> list[str]:
        """Coordinates of the arm, or of all arms, that have columns, in a robot that has joints beside them; or none.

        Columns fit by name, if no ``unused`` one may be another joint's, or by a rule that matches all joints of one arm.
        """
        names = self.names["q"]
        groups = [[names[k] for k in arm] for arm in self.arms]
        every = [name for group in groups for name in group]
        fitting = [group for group in groups if len(group) < len(names) and self.has_columns_of(group, unused)]
        if not fitting and len(groups) > 1 and len(every) < len(names) and self.has_columns_of(every, unused):
            fitting = [every]
        beside = [name for name in names if fitting and name not in fitting[0]]
        if len(fitting) != 1 or len(beside) > _MOST_BESIDE or any(_joint(name) != name for name in beside):
            return []
        return fitting[0]

    def of_arms(self, missing: Sequence[str], unused: Sequence[str]) -> TrajectoryError | None:
        """Error for a log of an arm, or of all arms, of a robot that has joints beside them; None for other logs."""
        group = self.logged_arm(unused)
        if not group:
            return None
        arms = [self.names["q"][k] for arm in self.arms for k in arm]
        beside = [name for name in self.names["q"] if name not in group]
        which = f"the arm{'s' if len(group) == len(arms) > len(self.arms[0]) else ''}"
        if len(group) < len(arms):
            which = f"one arm, {group[0]} to {group[-1]}"
        have = "has" if len(beside) == 1 else "have"
        rest = " and ".join([", ".join(beside[:-1]), beside[-1]] if len(beside) > 1 else beside)
        return TrajectoryError(
            f"{self.where}: {len(group)} columns fit the {len(group)} joints of {which}; {rest} {have} none: load the robot "
            f"with {{0}}. If there are columns for more of them, name these: {{1}}; {self.found()}",
            Argument("lock", dict.fromkeys(beside, 0)),
            Argument(
                "columns", dict.fromkeys(missing, "COLUMN") if len(missing) == len(beside) else {"JOINT": "COLUMN"}
            ),
        )

    def has_columns_of(self, group: Sequence[str], unused: Sequence[str]) -> bool:
        """True if the columns are those of the positions of a group of joints, by name or by a rule that matches all."""
        names = self.names["q"]
        if self.given["q"]:
            return not unused and {names[k] for k in self.given["q"]} == {*group}
        columns = candidates({k: self.split[k][0] for k in self.free}).get("q", [])
        others = [*self.reading.locked, *(name for name in names if name not in group)]
        return any(rule(columns, group, others) for rule in RULES.values())

    def check_complete(self, look: Callable[[int], Array]) -> None:
        """Raise TrajectoryError if time, coordinates or rates are missing; ``look`` returns a column's numbers."""
        missing = [name for k, name in enumerate(self.names["q"]) if k not in self.given["q"]]
        timeless = self.time is None and self.reading.rate is None
        if missing:
            raise self.without_columns(missing, look, timeless=timeless)
        if timeless:
            raise TrajectoryError(
                f"{self.where}: no time column. Name one 'time' (or 't'), in seconds; or give {{0}}, or "
                f"the rows per second, {{1}}{self.usual_rate()}; {self.found()}",
                Argument("columns", {"time": "COLUMN"}),
                Argument("rate", Placeholder("HZ")),
            )
        for part in ("dq", "ddq"):
            absent = [f"{name}{SUFFIX[part]}" for k, name in enumerate(self.names[part]) if k not in self.given[part]]
            if absent and len(absent) < len(self.names[part]):
                alike = [c[0] for name in self.extra if (c := difflib.get_close_matches(name, absent, n=1, cutoff=0.6))]
                hint = f" Did you mean {alike[0]!r}?" if alike else ""
                raise TrajectoryError(
                    f"{self.where}: no column {listed(absent)}, although others of its kind are there.{hint} "
                    f"Give them for every joint, or for none: then they are derived. Or assign it: {{0}}; "
                    f"{self.found()}",
                    Argument("columns", {absent[0]: "COLUMN"}),
                )


def belongs(text: str, locked: Sequence[str]) -> bool:
    """True if the name of a column is that of a locked joint, or of a quantity of it."""
    return any(text == j or text.startswith(f"{j}.") for j in locked) or NamedJoints(locked).meaning(text) is not None


def absent_joints(
    cells: Sequence[str],
    coordinates: Coordinates,
    joints: Sequence[str],
    columns: Mapping[str, str],
    path: Path,
) -> tuple[str, ...]:
    """Joints without a position column in this header, by name or by ``columns``."""
    found = Assignment(cells, "", coordinates, Reading(path))
    names = list(found.names["q"])
    for key in found.of_this_log(columns, {*names, *(f"{name}.pos" for name in names)}):
        if key.removesuffix(".pos") in names:
            found.given["q"][names.index(key.removesuffix(".pos"))] = Choice(0)
    found.assign_by_exact_name()
    found.assign_by_words()
    present = {names[k] for k in found.given["q"]}
    if not present:
        texts = {k: found.split[k][0] for k in found.free}
        by_prefix = most_by_prefix(candidates(texts).get("q", []), names)
        present = {name for name, column in zip(names, by_prefix, strict=True) if column is not None}
    present = present or {*found.logged_arm(unused=())}
    return tuple(j for j in joints if not any(n == j or n.startswith(f"{j}.") for n in present))


# ── Columns of a motion file and their factors


class MimicJointColumn(NamedTuple):
    """Column of a mimic joint."""

    follower: MimicJoint
    column: int
    """Index in the table."""
    factor: float
    """Factor to SI units."""


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
        look: Callable[[int], Array],
    ) -> Columns:
        """Columns from the header's cells; errors (:class:`~twistwrench.TrajectoryError`) begin with ``where``.

        ``look`` returns the first numbers of a column, used if its name does not specify the unit.
        """
        found = Assignment.from_header(header, coordinates, where, reading, look)
        parts = {part: [given[k] for k in sorted(given)] for part, given in found.given.items()}
        if commands := found.given["command"]:
            parts["command"] = [commands.get(k, _NONE) for k in range(len(found.names["command"]))]
        used = [
            *([found.time.column] if found.time else []),
            *(choice.column for choices in parts.values() for choice in choices if choice is not _NONE),
            *(choice.column for _, choice in found.mimic_joints),
        ]
        counted, unit = found.time is None, None if found.time is None else found.time.unit
        place = {column: k + counted for k, column in enumerate(used)} | {_NONE.column: _NONE.column}
        factors = {}
        for part, choices in parts.items():
            angular = (coordinates.angular if part == "q" else coordinates.angular_velocity).tolist()
            angular = list(coordinates.drive_turns) if part == "tau" and found.of_motors else angular
            each = zip(choices or [_NONE] * len(angular), angular, strict=True)
            factors[part] = np.array([found.factor(choice, part, turns) for choice, turns in each])
        return cls(
            header=(*["time"] * counted, *(header[k] for k in used)),
            used=tuple(used),
            time=0,
            seconds=1.0 / reading.rate if reading.rate else (time_factor(unit) or 1.0) if unit else 1.0,
            counted=counted,
            time_stated=reading.rate is not None or unit is not None,
            places={p: np.array([place[c.column] for c in cs], int) if cs else None for p, cs in parts.items()},
            factors=factors,
            angle=np.where(coordinates.angular, factors["q"], 1.0),
            angle_stated=np.array([choice.unit is not None for choice in parts["q"]], bool),
            of_locked=tuple(found.of_locked),
            extra=tuple(found.extra),
            quaternions=tuple(
                np.array([place[choice.column] for choice in parts["q"][part]], int) for part in coordinates.quaternions
            ),
            notes=tuple(found.notes),
            of_motors=found.of_motors,
            listed=any(key.rpartition(":")[2].startswith(ORDER) for key in reading.columns or ()),
            mimic_joints=tuple(
                MimicJointColumn(
                    follower,
                    place[choice.column],
                    found.factor(choice, "q", follower.angular),
                )
                for follower, choice in found.mimic_joints
            ),
        )

    @property
    def in_degrees(self) -> bool:
        """True if the file has angles in degrees."""
        return bool((self.angle == math.radians(1.0)).any())

    def in_si(self, table: Array, part: str) -> Any:
        """Columns of ``part`` of a table (n, columns) in SI units, NaN for joints without a command; None if absent."""
        where = self.places[part]
        if where is None:
            return None
        found = table[:, where] * self.factors[part]
        found[:, where == _NONE.column] = np.nan
        return found
