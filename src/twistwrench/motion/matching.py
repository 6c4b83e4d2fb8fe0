"""Matching of a log's columns to joints by name: words of loggers, common prefix, ending, or order.

Each rule, except that for loggers' words, matches all joints or none; it fails if other columns have similar names.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import TrajectoryError
from ..core.typing import Array
from .column_names import COMMANDS, JOINT, NEUTRAL, PART_OF, UNITS, split_unit

_FEW = 4
_LIKE = 0.6
"""Smallest similarity of two names for a suggestion."""
_STILL = 1e-6
"""Smallest relative variation of the column of a moving joint."""
_ANGLES_AND_LENGTHS = ("rad", "deg", "degrees", "radians", "°", "m", "mm", "cm")
_OTHER = re.compile(
    r"temp|curr|volt|amp|force|torq|effort|tau|load|power|energy|tcp|pose|ee_|imu|acc|vel|speed|rate|time|stamp|seq|index|"
    r"count|frame|status|state|mode|flag|id$|err|residual|cmd|command|action|target|desired|reference|setpoint"
)
"""Words in names of columns that are not measured joint positions."""
_COUNTED = re.compile(r"temp|volt|energy|count|index|seq|cycle|step|dist|odom|tick|batt|soc|charge")
"""Words in names of columns that may increase in every row and are not the time."""


_MOST_LOOKED_AT = 256
"""Columns whose numbers are looked at for a hint; a look at a column of a foreign format takes up to 0.1 s."""


def varying_columns(cells: Sequence[str], extra: Sequence[str], look: Callable[[int], Array]) -> list[str]:
    """Columns of ``extra`` that may be joint positions: varying, without the name or unit of another quantity.

    Of a file with thousands of columns the first :data:`_MOST_LOOKED_AT` are looked at.
    """
    found, among, looked_at = [], set(extra), 0
    for k, cell in enumerate(cells):
        name, unit = split_unit(cell)
        if cell not in among or _OTHER.search(name.lower()) or (unit is not None and unit not in _ANGLES_AND_LENGTHS):
            continue
        looked_at += 1
        if looked_at > _MOST_LOOKED_AT:
            break
        try:
            numbers = look(k)
        except TrajectoryError:  # not numbers
            continue
        if numbers.size and np.isfinite(numbers).all() and np.ptp(numbers) > _STILL * (1 + np.abs(numbers).max()):
            found.append(cell)
    return found


_SEVERAL = 2


def alike(missing: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """Map missing names to the most similar columns, each used once, in the order of the names.

    A column whose name is a part of several missing names is none of them.

    >>> alike(["shoulder", "elbow"], ["schoulder", "temperature"])
    {'shoulder': 'schoulder'}
    >>> alike(["shoulder_pan", "shoulder_lift"], ["shoulder"])
    {}
    """
    columns = [cell for cell in columns if sum(cell.lower() in name.lower() for name in missing) < _SEVERAL]
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


def rising_columns(cells: Mapping[int, str], look: Callable[[int], Array]) -> list[int]:
    """Columns that increase in every row and are not row numbers; ``look`` returns a column's first numbers."""
    found, named = [], {k: cell for k, cell in cells.items() if not _COUNTED.search(cell.lower())}
    for k in [*named][:_MOST_LOOKED_AT]:
        try:
            steps = np.diff(look(k))
        except TrajectoryError:  # not numbers
            continue
        if len(steps) and (steps > 0).all() and not (steps == 1).all():
            found.append(k)
    return found


def counts_rows(first: Array) -> bool:
    """True if the first numbers (n,) of a column are whole and usually rise by exactly 1.

    >>> counts_rows(np.array([7.0, 8.0, 9.0, 12.0])), counts_rows(np.array([0.0, 10.0, 20.0]))
    (True, False)
    """
    return bool(len(first) > 1 and (first == np.round(first)).all() and np.median(np.diff(first)) == 1.0)


def series(cells: Sequence[str], count: int) -> list[str]:
    """The only set of ``count`` columns that differ by a number, sorted by it; empty if not unique.

    >>> series(["A2", "A1", "E1"], 2)
    ['A1', 'A2']
    """
    groups: dict[tuple[str, ...], list[tuple[list[int], str]]] = {}
    for cell in cells:
        words = _words(split_unit(cell)[0])
        groups.setdefault(_pattern(words), []).append(([int(w) for w in words if w.isdigit()], cell))
    fitting = [sorted(group) for group in groups.values() if len(group) == count and group[0][0]]
    return [cell for _, cell in fitting[0]] if len(fitting) == 1 else []


# ── Joint names combined with words for quantities, as used by loggers


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column: joint, quantity and unit."""

    name: int
    """Index of the joint's name."""
    part: str
    """One of :data:`PARTS`, or :data:`CURRENT`."""
    unit: str | None = None
    """Unit suffix of the name, as in ``elbow_pos_deg``."""


class NamedJoints:
    """Joint names that columns may contain once; case matters only if two names differ by nothing else."""

    def __init__(self, names: Sequence[str]) -> None:
        folded = [name.casefold() for name in names]
        self._fold = len(set(folded)) == len(folded)
        known = {self._key(name): k for k, name in enumerate(names)}
        for k, name in enumerate(names):  # elbow for elbow_joint, unless another joint has that name
            short = re.sub(r"(_joint$|^joint_)", "", name, flags=re.IGNORECASE)
            others = [
                n for n in names if n != name and re.sub(r"(_joint$|^joint_)", "", n, flags=re.IGNORECASE) == short
            ]
            if len(short) > 2 and not short.isdigit() and not others:
                known.setdefault(self._key(short), k)
        self._known = sorted(known.items(), key=lambda item: -len(item[0]))

    def meaning(self, text: str) -> Meaning | None:
        """Meaning of a column's name (without unit in brackets); None if uncertain.

        >>> joints = NamedJoints(["arm_1_joint", "arm_10_joint"])
        >>> joints.meaning("- arm_1_joint_position")
        Meaning(name=0, part='q', unit=None)
        >>> joints.meaning("/joint_states/effort/arm_10_joint").part
        'tau'
        >>> joints.meaning("arm_1_joint_temperature") is None
        True
        """
        key = self._key(text)
        for name, k in self._known:
            at = _place(name, key)
            if at is None:
                continue
            rest = key[:at] + " " + key[at + len(name) :]
            found = _part_of(_words(rest))
            if found is not None:
                return Meaning(k, *found)
        return None

    def _key(self, text: str) -> str:
        return text.casefold() if self._fold else text


def _place(name: str, text: str) -> int | None:
    """Position of the name in the text as a separate word; None if absent."""
    at = text.find(name)
    while at >= 0:
        before, after = text[at - 1 : at] if at else "", text[at + len(name) : at + len(name) + 1]
        if not (before.isalnum() or after.isalnum()):
            return at
        at = text.find(name, at + 1)
    return None


def _words(text: str) -> list[str]:
    return re.findall(r"[^\W\d_]+|\d+", text.casefold())


def _part_of(words: list[str]) -> tuple[str, str | None] | None:
    """Quantity and unit of the words beside a joint's name; no words mean a position, and a word for commands a command."""
    rest = [w for w in words if w not in COMMANDS]
    if len(rest) < len(words):
        meant = _part_of(rest)
        return ("command", meant[1]) if meant is not None and meant[0] == "q" else None
    units = [w for w in words if w in UNITS]
    kinds = [w for w in words if w not in UNITS and w not in NEUTRAL]
    if units and kinds[-1:] == ["s"]:  # deg_s
        kinds = kinds[:-1]
        units = [f"{units[0]}/s"]
    if not words:
        return "q", None
    if len(kinds) != 1 or kinds[0] not in PART_OF or len(units) > 1:
        return None
    return PART_OF[kinds[0]], units[0] if units else None


# ── Columns of one quantity, without the words for the quantity


class Candidate(NamedTuple):
    """Column that may belong to a joint."""

    column: int
    words: tuple[str, ...]
    """Words of the name without quantity and unit, digits separate: ``fer, joint, 1``."""
    unit: str | None


def candidates(texts: Mapping[int, str]) -> dict[str, list[Candidate]]:
    """Group columns by the quantity in their names, which are given without bracketed units.

    >>> candidates({3: "fer_joint1_velocity", 4: "actual_q_0"})
    {'dq': [Candidate(column=3, words=('fer', 'joint', '1'), unit=None)], 'q': [Candidate(column=4, words=('0',), unit=None)]}
    """
    found: dict[str, list[Candidate]] = {}
    for column, text in texts.items():
        words = _words(text)
        said = [
            w in PART_OF or w in UNITS or (w in NEUTRAL and w not in JOINT) or (w == "s" and words[k - 1] in UNITS)
            for k, w in enumerate(words)
        ]
        meant = _part_of([w for w, one in zip(words, said, strict=True) if one])
        if meant is not None:
            rest = tuple(w for w, one in zip(words, said, strict=True) if not one)
            found.setdefault(meant[0], []).append(Candidate(column, rest, meant[1]))
    return found


def command_candidates(texts: Mapping[int, str]) -> list[list[Candidate]]:
    """Columns that may be commanded positions, grouped by their word for commands.

    >>> command_candidates({1: "actual_q_0", 2: "target_q_0", 3: "target_qd_0", 4: "action1"})
    [[Candidate(column=4, words=('1',), unit=None)], [Candidate(column=2, words=('0',), unit=None)]]
    """
    split = {column: _words(text) for column, text in texts.items()}
    by_word = [
        {k: " ".join(w for w in words if w != word) for k, words in split.items() if word in words} for word in COMMANDS
    ]
    found = [candidates(of_word).get("q", []) for of_word in by_word]
    return [group for group in found if group]


def _pattern(words: Iterable[str]) -> tuple[str, ...]:
    return tuple("#" if w.isdigit() else w for w in words)


def _left_over(
    taken: Iterable[Sequence[str]], all_words: Iterable[Sequence[str]], known: Iterable[Sequence[str]]
) -> bool:
    """True if there are unknown columns whose names differ from those taken only by a number."""
    patterns, own = {_pattern(w) for w in taken}, {tuple(w) for w in [*taken, *known]}
    return any(_pattern(w) in patterns and tuple(w) not in own for w in all_words)


# ── Rules that match all joints or none

Rule = Callable[[Sequence[Candidate], Sequence[str], Sequence[str]], "list[Candidate] | None"]
"""Rule: candidates, joint names, and names of joints without a coordinate of their own → columns of the joints."""


def by_prefix(found: Sequence[Candidate], names: Sequence[str], others: Sequence[str] = ()) -> list[Candidate] | None:
    """Match columns with the joints' names up to a common prefix: ``fer_joint1`` for ``panda_joint1``.

    >>> fer = candidates(dict(enumerate(["fer_joint2", "fer_joint1", "fer_tool_temp"])))["q"]
    >>> [c.column for c in by_prefix(fer, ["panda_joint1", "panda_joint2"])]
    [1, 0]
    """
    ways = _prefix_ways(found, names, others)
    whole = [way for way, alone in ways.items() if alone and None not in way]
    if len(whole) != 1:
        return None
    columns = [c for c in whole[0] if c]
    rivals = (way for way in ways if not set(way) <= {*columns, None} and 2 * way.count(None) <= len(names))
    return None if any(rivals) else columns


def most_by_prefix(found: Sequence[Candidate], names: Sequence[str]) -> Sequence[Candidate | None]:
    """Columns by a common prefix, None for joints without one; all None if several prefixes match equally many."""
    ways = sorted(_prefix_ways(found, names, ()), key=lambda way: way.count(None))
    if (
        not ways
        or (len(ways) > 1 and ways[0].count(None) == ways[1].count(None))
        or len(names) - ways[0].count(None) < 2
    ):
        return [None] * len(names)
    return ways[0]


def _prefix_ways(
    found: Sequence[Candidate], names: Sequence[str], others: Sequence[str]
) -> dict[tuple[Candidate | None, ...], bool]:
    """Ways to replace a prefix of the columns by a prefix of the joints; None for joints without a column.

    The value is False if other columns with the same prefix and pattern remain.
    """
    own, ways = [tuple(_words(name)) for name in names], dict[tuple[Candidate | None, ...], bool]()
    words_of = [tuple(_words(name)) for name in others]
    for cut in range(min(map(len, own), default=0)):
        rests = [w[cut:] for w in own]
        if len({w[:cut] for w in own}) > 1 or any(all(x.isdigit() for x in rest) for rest in rests):
            break
        known = [*(w[cut:] for w in words_of if w[:cut] == own[0][:cut]), *words_of]
        for prefix in {c.words[: -len(r)] for r in set(rests) for c in found if c.words[-len(r) :] == r}:
            inside: dict[tuple[str, ...], list[Candidate]] = {}
            for c in found:
                if c.words[: len(prefix)] == prefix:
                    inside.setdefault(c.words[len(prefix) :], []).append(c)
            way = tuple(inside[rest][0] if len(inside.get(rest, ())) == 1 else None for rest in rests)
            if not _OTHER.search("_".join(prefix)):
                ways.setdefault(way, not _left_over(rests, inside, known))
    return ways


def by_ending(found: Sequence[Candidate], names: Sequence[str], others: Sequence[str] = ()) -> list[Candidate] | None:
    """Match columns by unique name endings, of the joint's or the column's name: ``A1`` for ``joint_a1``.

    >>> kuka = candidates(dict(enumerate(["A1", "A2", "E1"])))["q"]
    >>> [c.column for c in by_ending(kuka, ["joint_a1", "joint_a2"])]
    [0, 1]
    """
    taken, prefixes = list[Candidate](), set[tuple[str, ...]]()
    for name in names:
        words = tuple(_words(name))
        fitting = [c for c in found if _ends(c.words, words)]
        if len(fitting) != 1:
            return None
        taken += fitting
        prefixes |= {c.words[: -len(words)] for c in fitting if len(c.words) > len(words)}
    if len(prefixes) > 1:  # columns of several robots
        return None
    known = [c.words for c in found if any(_ends(c.words, tuple(_words(name))) for name in others)]
    if len({c.column for c in taken}) < len(taken) or _left_over(
        [c.words for c in taken], [c.words for c in found], known
    ):
        return None
    return taken


def _ends(column: tuple[str, ...], joint: tuple[str, ...]) -> bool:
    """True if one name ends the other and is more than a letter, a number or the word for a joint."""
    short, long = sorted((column, joint), key=len)
    telling = [w for w in short if w not in JOINT and not w.isdigit()]
    if long[-len(short) :] != short or not telling or (len(short) == 1 and len(short[0]) < 3):
        return False
    return len(column) <= len(joint) or not _OTHER.search("_".join(column[: -len(joint)]))


def by_number(
    found: Sequence[Candidate],
    names: Sequence[str],
    others: Sequence[str] = (),  # noqa: ARG001  signature of the rules
) -> list[Candidate] | None:
    """Match columns that are numbered from 0 or 1, as many as joints: ``pos1``, ``actual_q_0``, ``Joint_3``.

    For a single joint, a column without a number also matches.

    >>> ur = candidates(dict(enumerate(["actual_q_1", "actual_q_0", "target_q_0"])))["q"]
    >>> [c.column for c in by_number(ur, ["shoulder", "elbow"])]
    [1, 0]
    """
    counting = [
        (int(digits[0]) if digits else -1, c)
        for c in found
        if len(digits := [w for w in c.words if w.isdigit()]) < 2
        and all(w in JOINT or (w.isdigit() and len(w) < 4) for w in c.words)
    ]
    numbers = sorted(counting, key=lambda each: each[:1])
    first = numbers[0][0] if numbers else 0
    in_turn = [n for n, _ in numbers] == list(range(first, first + len(numbers))) and first in (-1, 0, 1)
    if len(numbers) != len(names) or not in_turn or (first == -1 and len(numbers) > 1):
        return None
    return [c for _, c in numbers]


RULES: Mapping[str, Rule] = {
    "by their names, a common prefix aside": by_prefix,
    "by the ends of their names": by_ending,
    "in their order": by_number,
}
"""Rules by their description in notes, in the order of application."""
