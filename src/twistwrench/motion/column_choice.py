"""The choice of columns: as they are told, then by their exact names, by names as loggers write them, and by number."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..errors import TrajectoryError, UnknownNameError
from .column_names import PARTS, NamedJoints, numbered, time_meaning
from .coordinates import Coordinates
from .dialect import is_number
from .units import split_unit, time_factor

__all__ = ["Choice", "Chosen", "absent_joints", "choose"]

_EXACT = {"q": ("",), "dq": (".vel",), "ddq": (".acc",), "tau": (".tau", ".torque", ".effort")}
_SHOWN, _FEW = 12, 4


@dataclass(frozen=True)
class Choice:
    """A column of the file, and the unit it is in where that is said."""

    column: int
    unit: str | None = None


@dataclass
class Chosen:
    """The columns taken, in the robot's order; a part that the file does not have is empty."""

    time: Choice | None
    parts: dict[str, list[Choice]]
    of_locked: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass
class _Header:
    """The header's cells while columns are being given away."""

    cells: Sequence[str]
    where: str
    joints: Sequence[str] = ()
    """Names that are taken as they stand, brackets at their ends included."""
    free: list[int] = field(init=False)
    split: list[tuple[str, str | None]] = field(init=False)

    def __post_init__(self) -> None:
        self.free = [k for k, cell in enumerate(self.cells) if cell]
        self.split = [(cell, None) if cell in self.joints else split_unit(cell) for cell in self.cells]

    def found(self) -> str:
        """The names, as they end an error."""
        return f"found: {_listed([cell or '(no name)' for cell in self.cells])}."

    def column(self, name: str, told: str) -> Choice:
        """The column of that name, with or without its unit; ``told`` says who asks."""
        base, unit = split_unit(name)
        exact = [k for k, cell in enumerate(self.cells) if cell == name.strip()]
        alike = exact or [k for k, (text, _) in enumerate(self.split) if text == base]
        if not alike:
            near = difflib.get_close_matches(name, [c for c in self.cells if c], n=1, cutoff=0.6)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise TrajectoryError(f"{self.where}: no column {name!r}, which {told} names.{hint} {self.found()}")
        if len(alike) > 1:
            raise self.repeated(name.strip(), len(alike))
        return Choice(alike[0], unit or self.split[alike[0]][1])

    def repeated(self, name: str, count: int) -> TrajectoryError:
        """The error of a column that is there more than once."""
        return TrajectoryError(f"{self.where}: column {name!r} is there {count} times. Keep one of them.")


def choose(
    cells: Sequence[str],
    coordinates: Coordinates,
    where: str,
    *,
    locked: Sequence[str],
    columns: Mapping[str, str],
    rate: float | None,
) -> Chosen:
    """Give the header's columns to the robot's coordinates; TrajectoryError and UnknownNameError begin with ``where``."""
    if all(is_number(cell) or not cell for cell in cells):
        raise TrajectoryError(
            f"{where}: the header is missing; the first line has numbers. Name the columns: time, then joints."
        )
    header, notes = _Header(cells, where, coordinates.names), list[str]()
    names = {part: coordinates.names if part == "q" else coordinates.velocity_names for part in PARTS}
    told = _told(header, names, columns)
    time = _time(header, told.pop(("time", 0), None), rate, notes)
    given: dict[str, dict[int, Choice]] = {part: {} for part in PARTS}
    for (part, k), choice in told.items():
        given[part][k] = choice
        header.free = [c for c in header.free if c != choice.column]
    _by_exact_name(header, names, given)
    _by_words(header, names, given, notes)
    _by_number(header, names, given, notes)
    of_locked = [k for k in header.free if _of(locked, header.split[k][0])]
    # Torques are for comparison only, and may be those of some joints.
    if len(given["tau"]) < len(names["tau"]):
        given["tau"] = {}
    taken = {c.column for found in given.values() for c in found.values()} | ({time.column} if time else set())
    extra = [cell for k, cell in enumerate(cells) if cell and k not in taken and k not in of_locked]
    _check(header, names, given, extra)
    if unnamed := [str(k + 1) for k, cell in enumerate(cells) if not cell]:
        notes.append(f"Columns without a name are ignored: {', '.join(unnamed)}.")
    return Chosen(
        time,
        {part: [given[part][k] for k in sorted(given[part])] for part in PARTS},
        tuple(cells[k] for k in of_locked),
        tuple(extra),
        tuple(notes),
    )


def absent_joints(
    cells: Sequence[str], coordinates: Coordinates, joints: Sequence[str], columns: Mapping[str, str]
) -> tuple[str, ...]:
    """Which of the ``joints`` have no column of their position in this header, by their names or as ``columns`` says."""
    header = _Header(cells, "", coordinates.names)
    given: dict[str, dict[int, Choice]] = {part: {} for part in PARTS}
    names = {part: coordinates.names if part == "q" else coordinates.velocity_names for part in PARTS}
    for key in columns:
        if key.removesuffix(".pos") in names["q"]:
            given["q"][names["q"].index(key.removesuffix(".pos"))] = Choice(0)
    _by_exact_name(header, names, given)
    _by_words(header, names, given, [])
    have = {names["q"][k] for k in given["q"]}
    return tuple(j for j in joints if not any(n == j or n.startswith(f"{j}.") for n in have))


def _told(
    header: _Header, names: Mapping[str, Sequence[str]], columns: Mapping[str, str]
) -> dict[tuple[str, int], Choice]:
    """What ``columns`` says, by part and place."""
    suffixes = {".pos": "q", ".vel": "dq", ".acc": "ddq", ".tau": "tau", "": "q"}
    known = {f"{name}{suffix}": (part, k) for suffix, part in suffixes.items() for k, name in enumerate(names[part])}
    known["time"] = ("time", 0)
    told: dict[tuple[str, int], Choice] = {}
    for key, name in columns.items():
        if key not in known:
            raise UnknownNameError.of("coordinate (of --columns)", key, ["time", *names["q"]])
        place = known[key]
        if place in told:
            raise TrajectoryError(f"{header.where}: --columns says twice what {key!r} is. Keep one of them.")
        told[place] = header.column(name, f"--columns {key}={name}")
    return told


def _time(header: _Header, told: Choice | None, rate: float | None, notes: list[str]) -> Choice | None:
    ranked = sorted((rank[0], k) for k in header.free if (rank := time_meaning(header.split[k][0])) is not None)
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
            f"{header.where}: no time column. Name one 'time' (or 't'), in seconds; or say which it is, --columns "
            f"'time=COLUMN'; or say how many rows a second has, --rate HZ; {header.found()}"
        )
    if told is None and len(first) > 1:
        raise TrajectoryError(
            f"{header.where}: two time columns, {_listed([header.cells[k] for k in first])}. Keep one of them, or say which: "
            f"--columns 'time={header.cells[first[0]]}'."
        )
    choice = told or Choice(
        first[0], header.split[first[0]][1] or (time_meaning(header.split[first[0]][0]) or (0, None))[1]
    )
    if choice.unit is not None and time_factor(choice.unit) is None:
        raise TrajectoryError(
            f"{header.where}, column {header.cells[choice.column]!r}: {choice.unit!r} is no unit of time. Known: s, ms, us, "
            "ns, min."
        )
    if choice.unit is not None and time_factor(choice.unit) != 1.0:
        notes.append(f"Time is read in {choice.unit} from column {header.cells[choice.column]!r}.")
    header.free = [k for k in header.free if k != choice.column]
    return choice


def _by_exact_name(header: _Header, names: Mapping[str, Sequence[str]], given: dict[str, dict[int, Choice]]) -> None:
    by_text: dict[str, list[int]] = {}
    for k in header.free:
        by_text.setdefault(header.split[k][0], []).append(k)
    for part, endings in _EXACT.items():
        for k, name in enumerate(names[part]):
            for ending in endings:
                columns = by_text.get(f"{name}{ending}", [])
                if len(columns) > 1 and k not in given[part]:
                    raise header.repeated(f"{name}{ending}", len(columns))
                if columns and k not in given[part]:
                    given[part][k] = Choice(columns[0], header.split[columns[0]][1])
                    header.free.remove(columns[0])


def _by_words(
    header: _Header, names: Mapping[str, Sequence[str]], given: dict[str, dict[int, Choice]], notes: list[str]
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
    taken = []
    for (part, place), columns in found.items():
        if place in given[part]:
            continue
        if len(columns) > 1:
            name = names[part][place]
            shown = [header.cells[k] for k in columns]
            key = name + ("" if part == "q" else _EXACT[part][0])
            raise TrajectoryError(
                f"{header.where}: {_listed(shown)} may all be {key}. Say which: --columns '{key}={shown[0]}'."
            )
        given[part][place] = Choice(columns[0], units[columns[0]])
        header.free.remove(columns[0])
        taken.append((part, place, columns[0]))
    if taken:
        part, place, column = taken[0]
        key = names[part][place] + ("" if part == "q" else _EXACT[part][0])
        others = f", and {len(taken) - 1} more likewise" if len(taken) > 1 else ""
        notes.append(f"Column {header.cells[column]!r} is taken to be {key}{others}.")


def _by_number(
    header: _Header, names: Mapping[str, Sequence[str]], given: dict[str, dict[int, Choice]], notes: list[str]
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
            f"{_listed(pairs)}."
            if len(numbers) > 1
            else f"Column {header.cells[numbers[0][1]]!r} is taken to be that of {names[part][0]}, the only joint."
        )


def _of(locked: Sequence[str], text: str) -> bool:
    return any(text == j or text.startswith(f"{j}.") for j in locked) or NamedJoints(locked).meaning(text) is not None


def _check(
    header: _Header, names: Mapping[str, Sequence[str]], given: Mapping[str, Mapping[int, Choice]], extra: Sequence[str]
) -> None:
    missing = [name for k, name in enumerate(names["q"]) if k not in given["q"]]
    if missing:
        near = {name: difflib.get_close_matches(name, extra, n=1, cutoff=0.6) for name in missing}
        meant = next(((name, c[0]) for name, c in near.items() if c), None)
        hint = f" Column {meant[1]!r} is no joint of this robot. Did you mean {meant[0]!r}?" if meant else ""
        first = [name for name in missing if near[name]][:_FEW] or missing[:2]
        choices = " ".join(f"--columns '{name}={near[name][0] if near[name] else 'COLUMN'}'" for name in first)
        more = " …" if len(missing) > len(first) else ""
        joints = list(dict.fromkeys(_joint(name) for name in missing))
        held = f", or {' '.join(f'--lock {name}=0' for name in joints)}" if len(joints) <= _FEW else ""
        held = f"--lock-missing{held}" if len(missing) < len(names["q"]) else "--lock 'PATTERN*=0'"
        raise TrajectoryError(
            f"{header.where}: no column for {_listed(missing)}.{hint} Expected: {_listed(names['q'])}; {header.found()} "
            f"Say which they are: {choices}{more}; or hold joints still that never move: {held}."
        )
    for part, ending in (("dq", ".vel"), ("ddq", ".acc")):
        absent = [f"{name}{ending}" for k, name in enumerate(names[part]) if k not in given[part]]
        if absent and len(absent) < len(names[part]):
            alike = [c[0] for name in extra if (c := difflib.get_close_matches(name, absent, n=1, cutoff=0.6))]
            hint = f" Did you mean {alike[0]!r}?" if alike else ""
            raise TrajectoryError(
                f"{header.where}: no column {_listed(absent)}, although others of its kind are there.{hint} "
                f"Give them for every joint, or for none: then they are derived. Or say which it is: --columns "
                f"'{absent[0]}=COLUMN'; {header.found()}"
            )


def _joint(coordinate: str) -> str:
    """The joint of a coordinate; those of planar and floating joints have a suffix."""
    base, dot, suffix = coordinate.rpartition(".")
    return base if dot and suffix in ("x", "y", "z", "theta", "qw", "qx", "qy", "qz") else coordinate


def _listed(names: Sequence[str], most: int = _SHOWN) -> str:
    rest = f", … ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(names[:most]) + rest
