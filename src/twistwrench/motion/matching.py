"""Matching of a log's columns to joints by name: words of loggers, common prefix, ending, or order.

Each rule, except that for loggers' words, matches all joints or none; it fails if other columns have similar names.
"""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.errors import TrajectoryError
from ..core.typing import Array
from .column_names import COMMANDS, JOINT, NEUTRAL, PART_OF, UNITS, split_unit

Words = tuple[str, ...]
"""Words of a name in lower case, digits separate: ``fer, joint, 1``."""

_MAX_CANDIDATES = 4
"""Most columns that are compared with a missing name."""
_MIN_SIMILARITY = 0.6
"""Smallest similarity of two names for a suggestion."""
_MIN_VARIATION = 1e-6
"""Smallest relative variation of the column of a moving joint."""
_ANGLES_AND_LENGTHS = ("rad", "deg", "degrees", "radians", "°", "m", "mm", "cm")
_OTHER = re.compile(
    r"temp|curr|volt|amp|force|torq|effort|tau|load|power|energy|tcp|pose|ee_|imu|acc|vel|speed|rate|time|stamp|seq|index|"
    r"count|frame|status|state|mode|flag|id$|err|residual|cmd|command|action|target|desired|reference|setpoint"
)
"""Words in names of columns that are not measured joint positions."""
_COUNTED = re.compile(r"temp|volt|energy|count|index|seq|cycle|step|dist|odom|tick|batt|soc|charge")
"""Words in names of columns that may increase in every row and are not the time."""


_MAX_COLUMNS_READ = 256
"""Columns whose numbers are looked at for a hint; a look at a column of a foreign format takes up to 0.1 s."""


def varying_columns(cells: Sequence[str], extra: Sequence[str], look: Callable[[int], Array]) -> list[str]:
    """Columns of ``extra`` that may be joint positions: varying, without the name or unit of another quantity.

    Of a file with thousands of columns the first :data:`_MAX_COLUMNS_READ` are looked at.
    """
    candidate_cells = set(extra)
    columns = [k for k, cell in enumerate(cells) if cell in candidate_cells and _may_be_position(cell)]
    varying = []
    for k in columns[:_MAX_COLUMNS_READ]:
        try:
            numbers = look(k)
        except TrajectoryError:  # not numbers
            continue
        if not numbers.size or not np.isfinite(numbers).all():
            continue
        if np.ptp(numbers) > _MIN_VARIATION * (1 + np.abs(numbers).max()):
            varying.append(cells[k])
    return varying


def _may_be_position(cell: str) -> bool:
    """True unless a column has the name or unit of another quantity."""
    name, unit = split_unit(cell)
    return not _OTHER.search(name.lower()) and (unit is None or unit in _ANGLES_AND_LENGTHS)


_MIN_SHARED = 2
"""Number of missing names from which a column whose name is a part of them is none of them."""


def alike(missing: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """Map missing names to the most similar columns, each used once, in the order of the names.

    A column whose name is a part of several missing names is none of them.

    >>> alike(["shoulder", "elbow"], ["schoulder", "temperature"])
    {'shoulder': 'schoulder'}
    >>> alike(["shoulder_pan", "shoulder_lift"], ["shoulder"])
    {}
    """
    specific = []
    for cell in columns:
        containing = [name for name in missing if cell.lower() in name.lower()]
        if len(containing) < _MIN_SHARED:
            specific.append(cell)
    pairs = []
    for name in missing:
        for cell in difflib.get_close_matches(name, specific, n=_MAX_CANDIDATES, cutoff=_MIN_SIMILARITY):
            similarity = difflib.SequenceMatcher(None, cell, name).ratio()
            pairs.append((similarity, name, cell))
    matches: dict[str, str] = {}
    for _, name, cell in sorted(pairs, key=lambda pair: -pair[0]):
        if name not in matches and cell not in matches.values():
            matches[name] = cell
    return {name: matches[name] for name in missing if name in matches}


def rising_columns(cells: Mapping[int, str], look: Callable[[int], Array]) -> list[int]:
    """Columns that increase in every row and are not row numbers; ``look`` returns a column's first numbers."""
    columns = [k for k, cell in cells.items() if not _COUNTED.search(cell.lower())]
    rising = []
    for k in columns[:_MAX_COLUMNS_READ]:
        try:
            steps = np.diff(look(k))
        except TrajectoryError:  # not numbers
            continue
        if len(steps) and (steps > 0).all() and not (steps == 1).all():
            rising.append(k)
    return rising


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
        numbers = list(map(int, filter(str.isdigit, words)))
        if numbers:
            groups.setdefault(_pattern(words), []).append((numbers, cell))
    fitting = [group for group in groups.values() if len(group) == count]
    if len(fitting) != 1:
        return []
    return [cell for _, cell in sorted(fitting[0])]


@dataclass(frozen=True)
class Meaning:
    """Meaning of a column: joint, quantity and unit."""

    name: int
    """Index of the joint's name."""
    part: str
    """One of :data:`PARTS`, or :data:`CURRENT`."""
    unit: str | None = None
    """Unit suffix of the name, as in ``elbow_pos_deg``."""


_WORD_FOR_JOINT = re.compile(r"(_joint$|^joint_)", re.IGNORECASE)
"""Word for a joint at the beginning or end of its name."""


class NamedJoints:
    """Joint names that columns may contain once; case matters only if two names differ by nothing else."""

    def __init__(self, names: Sequence[str]) -> None:
        self._fold = len(set(map(str.casefold, names))) == len(names)
        indices = {self._key(name): k for k, name in enumerate(names)}
        short_names = [_WORD_FOR_JOINT.sub("", name) for name in names]
        count = Counter(short_names)
        for k, short in enumerate(short_names):  # elbow for elbow_joint, unless another joint has that name
            if len(short) > 2 and not short.isdigit() and count[short] == 1:
                indices.setdefault(self._key(short), k)
        self._indices = sorted(indices.items(), key=lambda item: -len(item[0]))

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
        for name, k in self._indices:
            position = _position(name, key)
            if position is None:
                continue
            other_words = _words(key[:position] + " " + key[position + len(name) :])
            part_and_unit = _part_of(other_words)
            if part_and_unit is not None:
                return Meaning(k, *part_and_unit)
        return None

    def _key(self, text: str) -> str:
        return text.casefold() if self._fold else text


def _position(name: str, text: str) -> int | None:
    """Position of the name in the text as a separate word; None if absent."""
    position = text.find(name)
    while position >= 0:
        before = text[:position][-1:]
        after = text[position + len(name) :][:1]
        if not (before.isalnum() or after.isalnum()):
            return position
        position = text.find(name, position + 1)
    return None


def _words(text: str) -> Words:
    """Words and numbers of a name in lower case: ``fer, joint, 1``."""
    return tuple(re.findall(r"[^\W\d_]+|\d+", text.casefold()))


def _part_of(words: Sequence[str]) -> tuple[str, str | None] | None:
    """Quantity and unit of the words beside a joint's name; no words mean a position, and a word for commands a command."""
    measured = [word for word in words if word not in COMMANDS]
    if len(measured) < len(words):
        meaning = _part_of(measured)
        if meaning is None or meaning[0] != "q":
            return None
        return "command", meaning[1]
    units, kinds = [], []
    for word in words:
        if word in UNITS:
            units.append(word)
        elif word not in NEUTRAL:
            kinds.append(word)
    if units and kinds[-1:] == ["s"]:  # deg_s
        kinds = kinds[:-1]
        units = [f"{units[0]}/s"]
    if not words:
        return "q", None
    if len(kinds) != 1 or kinds[0] not in PART_OF or len(units) > 1:
        return None
    return PART_OF[kinds[0]], next(iter(units), None)


class Candidate(NamedTuple):
    """Column that may belong to a joint."""

    column: int
    words: Words
    """Words of the name without quantity and unit."""
    unit: str | None


def candidates(texts: Mapping[int, str]) -> dict[str, list[Candidate]]:
    """Group columns by the quantity in their names, which are given without bracketed units.

    >>> candidates({3: "fer_joint1_velocity", 4: "actual_q_0"})
    {'dq': [Candidate(column=3, words=('fer', 'joint', '1'), unit=None)], 'q': [Candidate(column=4, words=('0',), unit=None)]}
    """
    groups: dict[str, list[Candidate]] = {}
    for column, text in texts.items():
        quantity_words, other_words = _split_words(_words(text))
        meaning = _part_of(quantity_words)
        if meaning is not None:
            part, unit = meaning
            groups.setdefault(part, []).append(Candidate(column, tuple(other_words), unit))
    return groups


def _split_words(words: Sequence[str]) -> tuple[list[str], list[str]]:
    """Words for quantities and units, and the other words of a name."""
    quantity_words, other_words = [], []
    for k, word in enumerate(words):
        per_second = word == "s" and words[k - 1] in UNITS
        neutral = word in NEUTRAL and word not in JOINT
        if word in PART_OF or word in UNITS or neutral or per_second:
            quantity_words.append(word)
        else:
            other_words.append(word)
    return quantity_words, other_words


def command_candidates(texts: Mapping[int, str]) -> list[list[Candidate]]:
    """Columns that may be commanded positions, grouped by their word for commands.

    >>> command_candidates({1: "actual_q_0", 2: "target_q_0", 3: "target_qd_0", 4: "action1"})
    [[Candidate(column=4, words=('1',), unit=None)], [Candidate(column=2, words=('0',), unit=None)]]
    """
    groups = []
    for command in COMMANDS:
        others = {}
        for column, text in texts.items():
            words = _words(text)
            if command in words:
                others[column] = " ".join(word for word in words if word != command)
        group = candidates(others).get("q", [])
        if group:
            groups.append(group)
    return groups


def _pattern(words: Iterable[str]) -> Words:
    """Words of a name with # for each number: names of one pattern differ only by numbers."""
    return tuple("#" if word.isdigit() else word for word in words)


def _has_unmatched(matched: Iterable[Words], all_words: Iterable[Words], known: Iterable[Words]) -> bool:
    """True if there are unknown columns whose names differ from those matched only by a number."""
    unmatched = {*all_words} - {*matched, *known}
    return not {*map(_pattern, unmatched)}.isdisjoint(map(_pattern, matched))


Rule = Callable[[Sequence[Candidate], Sequence[str], Sequence[str]], "list[Candidate] | None"]
"""Rule: candidates, joint names, and names of joints without a coordinate of their own → columns of the joints."""


def match_by_prefix(
    found: Sequence[Candidate], names: Sequence[str], others: Sequence[str] = ()
) -> list[Candidate] | None:
    """Match columns with the joints' names up to a common prefix: ``fer_joint1`` for ``panda_joint1``.

    >>> fer = candidates(dict(enumerate(["fer_joint2", "fer_joint1", "fer_tool_temp"])))["q"]
    >>> [c.column for c in match_by_prefix(fer, ["panda_joint1", "panda_joint2"])]
    [1, 0]
    """
    matches = _matches_by_prefix(found, names, others)
    complete: list[list[Candidate]] = []
    for match, exclusive in matches.items():
        match_columns = [column for column in match if column is not None]
        if exclusive and len(match_columns) == len(names):
            complete.append(match_columns)
    if len(complete) != 1:
        return None
    columns = complete[0]
    for match in matches:
        has_other_columns = not set(match) <= {*columns, None}
        if has_other_columns and 2 * match.count(None) <= len(names):
            return None
    return columns


def match_most_by_prefix(found: Sequence[Candidate], names: Sequence[str]) -> Sequence[Candidate | None]:
    """Columns by a common prefix, None for joints without one; all None if several prefixes match equally many."""
    matches = sorted(_matches_by_prefix(found, names, ()), key=lambda match: match.count(None))
    if not matches:
        return [None] * len(names)
    ambiguous = len(matches) > 1 and matches[0].count(None) == matches[1].count(None)
    if ambiguous or len(names) - matches[0].count(None) < 2:
        return [None] * len(names)
    return matches[0]


def _matches_by_prefix(
    found: Sequence[Candidate], names: Sequence[str], others: Sequence[str]
) -> dict[tuple[Candidate | None, ...], bool]:
    """Matches by a prefix of the columns in place of a prefix of the joints; None for joints without a column.

    The value is False if other columns with the same prefix and pattern remain.
    """
    matches = dict[tuple[Candidate | None, ...], bool]()
    joints, other_joints = list(map(_words, names)), list(map(_words, others))
    for cut in range(min(map(len, joints), default=0)):
        endings = _endings(joints, joints[0][:cut])
        if len(endings) < len(joints) or any("".join(ending).isdigit() for ending in endings):
            break
        known = _endings(other_joints, joints[0][:cut]) + other_joints
        for prefix in _column_prefixes(found, endings):
            columns: dict[Words, list[Candidate | None]] = {}
            for column in found:
                if column.words[: len(prefix)] == prefix:
                    columns.setdefault(column.words[len(prefix) :], []).append(column)
            match: list[Candidate | None] = []
            for ending in endings:
                with_ending = columns.get(ending, [])
                match += with_ending if len(with_ending) == 1 else [None]
            if not _OTHER.search("_".join(prefix)):
                matches.setdefault(tuple(match), not _has_unmatched(endings, columns, known))
    return matches


def _endings(names: Iterable[Words], prefix: Words) -> list[Words]:
    """Words after the prefix, of the names that begin with it."""
    return [words[len(prefix) :] for words in names if words[: len(prefix)] == prefix]


def _column_prefixes(found: Sequence[Candidate], endings: Iterable[Words]) -> set[Words]:
    """Words before the endings, in the names of columns."""
    prefixes = set()
    for ending in set(endings):
        for column in found:
            if column.words[-len(ending) :] == ending:
                prefixes.add(column.words[: -len(ending)])
    return prefixes


def match_by_ending(
    found: Sequence[Candidate], names: Sequence[str], others: Sequence[str] = ()
) -> list[Candidate] | None:
    """Match columns by unique name endings, of the joint's or the column's name: ``A1`` for ``joint_a1``.

    >>> kuka = candidates(dict(enumerate(["A1", "A2", "E1"])))["q"]
    >>> [c.column for c in match_by_ending(kuka, ["joint_a1", "joint_a2"])]
    [0, 1]
    """
    matches: list[Candidate] = []
    prefixes, matched_words = set[Words](), set[Words]()
    for name in names:
        words = _words(name)
        fitting = _columns_with_ending(found, words)
        if len(fitting) != 1:
            return None
        match = fitting[0]
        if match in matches:
            return None
        matches.append(match)
        matched_words.add(match.words)
        if len(match.words) > len(words):
            prefixes.add(match.words[: -len(words)])
    if len(prefixes) > 1:  # columns of several robots
        return None
    known_words = set[Words]()
    for name in others:
        known_words |= {column.words for column in _columns_with_ending(found, _words(name))}
    if _has_unmatched(matched_words, [column.words for column in found], known_words):
        return None
    return matches


def _columns_with_ending(found: Sequence[Candidate], joint: Words) -> list[Candidate]:
    """Columns whose name ends a joint's name, or has it as its end."""
    return [column for column in found if _ends(column.words, joint)]


def _ends(column: Words, joint: Words) -> bool:
    """True if one name ends the other and is more than a letter, a number or the word for a joint."""
    short, long = sorted((column, joint), key=len)
    if long[-len(short) :] != short or (len(short) == 1 and len(short[0]) < 3):
        return False
    if all(word in JOINT or word.isdigit() for word in short):
        return False
    return len(column) <= len(joint) or not _OTHER.search("_".join(column[: -len(joint)]))


def match_by_number(
    found: Sequence[Candidate],
    names: Sequence[str],
    others: Sequence[str] = (),  # noqa: ARG001  signature of the rules
) -> list[Candidate] | None:
    """Match columns that are numbered from 0 or 1, as many as joints: ``pos1``, ``actual_q_0``, ``Joint_3``.

    For a single joint, a column without a number also matches.

    >>> ur = candidates(dict(enumerate(["actual_q_1", "actual_q_0", "target_q_0"])))["q"]
    >>> [c.column for c in match_by_number(ur, ["shoulder", "elbow"])]
    [1, 0]
    """
    numbered = []
    for column in found:
        digits = [word for word in column.words if word.isdigit()]
        others_allowed = all(word in JOINT or (word.isdigit() and len(word) < 4) for word in column.words)
        if len(digits) < 2 and others_allowed:
            numbered.append((int(next(iter(digits), "-1")), column))
    numbered.sort(key=lambda pair: pair[0])
    numbers = [number for number, _ in numbered]
    first = next(iter(numbers), 0)
    consecutive = numbers == list(range(first, first + len(numbers))) and first in (-1, 0, 1)
    if len(numbers) != len(names) or not consecutive or (first == -1 and len(numbers) > 1):
        return None
    return [column for _, column in numbered]


RULES: Mapping[str, Rule] = {
    "by their names, a common prefix aside": match_by_prefix,
    "by the ends of their names": match_by_ending,
    "in their order": match_by_number,
}
"""Rules by their description in notes, in the order of application."""
