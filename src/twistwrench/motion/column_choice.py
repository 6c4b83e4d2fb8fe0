"""The choice of columns: as they are told, then by their exact names, by names as loggers write them, and by number."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ..errors import TrajectoryError, UnknownNameError
from ..listing import listed
from ..typing import Array
from .column_names import PARTS, ROS_TIME, NamedJoints, numbered, time_meaning
from .column_suffixes import READ, is_result
from .column_units import ros_nanoseconds, time_factor
from .coordinates import Coordinates
from .csv_dialect import is_number
from .header import Choice, Header
from .missing_columns import check_complete


@dataclass
class Chosen:
    """The columns taken, in the robot's order; a part that the file does not have is empty."""

    time: Choice | None
    parts: dict[str, list[Choice]]
    of_locked: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    followers: dict[int, Choice] = field(default_factory=dict)
    """Of mimic joints, by their number: columns that ought to be their leaders'."""


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
    told = _told(header, names, columns)
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
        for k, follower in enumerate(coordinates.followers)
        for c in [c for c in header.free if header.split[c][0] == follower.name][:1]
    }
    of_locked = [k for k in header.free if _of(locked, header.split[k][0])]
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
    """Which of the ``joints`` have no column of their position in this header, by their names or as ``columns`` says."""
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


def _told(
    header: Header, names: Mapping[str, Sequence[str]], columns: Mapping[str, str]
) -> dict[tuple[str, int], Choice]:
    """What ``columns`` says, by part and place."""
    suffixes = {".pos": "q", **{suffix: part for part, endings in READ.items() for suffix in endings}}
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
            f"{header.where}, column {header.cells[choice.column]!r}: {choice.unit!r} is no unit of time. Known: s, ms, us, "
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
    taken = []
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


def _of(locked: Sequence[str], text: str) -> bool:
    return any(text == j or text.startswith(f"{j}.") for j in locked) or NamedJoints(locked).meaning(text) is not None
