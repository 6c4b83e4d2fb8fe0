"""Matching of a log's columns to joints by name: words of loggers, common prefix, ending, or order.

Each rule, except the rule for words of loggers, matches all joints or none; it fails if other columns have similar names.
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
"""Largest number of columns that are considered for a missing name."""
_MIN_SIMILARITY = 0.6
"""Smallest similarity of two names for a suggestion."""
_MIN_VARIATION = 1e-6
"""Smallest relative variation of the column of a moving joint."""
_POSITION_UNITS = ("rad", "deg", "degrees", "radians", "°", "m", "mm", "cm")
"""Units that a column of positions may have."""
_NOT_A_POSITION = re.compile(
    r"temp|curr|volt|amp|force|torq|effort|tau|load|power|energy|tcp|pose|ee_|imu|acc|vel|speed|rate|time|stamp|seq|index|"
    r"count|frame|status|state|mode|flag|id$|err|residual|cmd|command|action|target|desired|reference|setpoint"
)
"""Words in names of columns that are not measured joint positions."""
_NOT_A_TIME = re.compile(r"temp|volt|energy|count|index|seq|cycle|step|dist|odom|tick|batt|soc|charge")
"""Words in names of columns that may increase in every row and are not the time."""
_MAX_COLUMNS_READ = 256
"""Largest number of columns that are read for a hint; reading one takes up to 0.1 s in some formats."""


def varying_columns(cells: Sequence[str], extra: Sequence[str], first_numbers: Callable[[int], Array]) -> list[str]:
    """Columns of ``extra`` that may be joint positions: varying, without the name or unit of another quantity.

    ``cells``: names of all columns; ``first_numbers`` returns the first numbers of a column. At most the first
    :data:`_MAX_COLUMNS_READ` columns are read.
    """
    extra_cells = set(extra)
    columns = [k for k, cell in enumerate(cells) if cell in extra_cells and _may_be_position(cell)]
    varying = []
    for k in columns[:_MAX_COLUMNS_READ]:
        try:
            numbers = first_numbers(k)
        except TrajectoryError:  # the column has texts
            continue
        if not numbers.size or not np.isfinite(numbers).all():
            continue
        size = 1 + np.abs(numbers).max()  # small numbers are compared with 1
        if np.ptp(numbers) > _MIN_VARIATION * size:
            varying.append(cells[k])
    return varying


def _may_be_position(cell: str) -> bool:
    """True unless a column has the name or unit of another quantity."""
    name, unit = split_unit(cell)
    if _NOT_A_POSITION.search(name.lower()):
        return False
    return unit is None or unit in _POSITION_UNITS


_MIN_AMBIGUOUS_NAMES = 2
"""Number of missing names from which a column whose name they contain is ambiguous."""


def alike(missing: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """Map missing names to the most similar columns, each used once, in the order of the names.

    A column whose name is a part of several missing names is ambiguous and matches none of them.

    >>> alike(["shoulder", "elbow"], ["schoulder", "temperature"])
    {'shoulder': 'schoulder'}
    >>> alike(["shoulder_pan", "shoulder_lift"], ["shoulder"])
    {}
    """
    unambiguous_columns = []
    for column in columns:
        containing_names = [name for name in missing if column.lower() in name.lower()]
        if len(containing_names) < _MIN_AMBIGUOUS_NAMES:
            unambiguous_columns.append(column)
    similar_pairs = []
    for name in missing:
        close_columns = difflib.get_close_matches(name, unambiguous_columns, n=_MAX_CANDIDATES, cutoff=_MIN_SIMILARITY)
        for column in close_columns:
            similarity = difflib.SequenceMatcher(None, column, name).ratio()
            similar_pairs.append((similarity, name, column))
    similar_pairs.sort(key=lambda pair: -pair[0])
    column_by_name: dict[str, str] = {}
    for _, name, column in similar_pairs:  # the most similar pair first
        if name not in column_by_name and column not in column_by_name.values():
            column_by_name[name] = column
    return {name: column_by_name[name] for name in missing if name in column_by_name}


def rising_columns(cells: Mapping[int, str], first_numbers: Callable[[int], Array]) -> list[int]:
    """Columns that increase in every row and are not row numbers; ``first_numbers`` returns a column's first numbers."""
    columns = [k for k, cell in cells.items() if not _NOT_A_TIME.search(cell.lower())]
    rising = []
    for k in columns[:_MAX_COLUMNS_READ]:
        try:
            steps = np.diff(first_numbers(k))
        except TrajectoryError:  # the column has texts
            continue
        rises = len(steps) > 0 and (steps > 0).all()
        is_row_number = (steps == 1).all()
        if rises and not is_row_number:
            rising.append(k)
    return rising


def counts_rows(first_numbers: Array) -> bool:
    """True if the first numbers (n,) of a column are whole and usually rise by exactly 1.

    >>> counts_rows(np.array([7.0, 8.0, 9.0, 12.0])), counts_rows(np.array([0.0, 10.0, 20.0]))
    (True, False)
    """
    has_fractions = (first_numbers != np.round(first_numbers)).any()
    if len(first_numbers) < 2 or has_fractions:
        return False
    return bool(np.median(np.diff(first_numbers)) == 1.0)


def series(cells: Sequence[str], count: int) -> list[str]:
    """The only set of ``count`` columns whose names differ by a number, sorted by this number; empty if not unique.

    >>> series(["A2", "A1", "E1"], 2)
    ['A1', 'A2']
    """
    groups: dict[Words, list[tuple[list[int], str]]] = {}  # (numbers in the name, column) by pattern of the name
    for cell in cells:
        name, _ = split_unit(cell)
        words = _words(name)
        numbers = [int(word) for word in words if word.isdigit()]
        if numbers:
            groups.setdefault(_pattern(words), []).append((numbers, cell))
    groups_of_right_size = [group for group in groups.values() if len(group) == count]
    if len(groups_of_right_size) != 1:
        return []
    return [cell for _, cell in sorted(groups_of_right_size[0])]


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
        names_without_case = {name.casefold() for name in names}
        self._ignores_case = len(names_without_case) == len(names)
        indices = {self._key(name): k for k, name in enumerate(names)}
        short_names = [_WORD_FOR_JOINT.sub("", name) for name in names]
        short_name_counts = Counter(short_names)
        for k, short_name in enumerate(short_names):  # elbow for elbow_joint, unless another joint has that name
            is_specific = len(short_name) > 2 and not short_name.isdigit()
            if is_specific and short_name_counts[short_name] == 1:
                indices.setdefault(self._key(short_name), k)
        # The longest names come first, since a name may be a part of another one.
        self._joint_indices = sorted(indices.items(), key=lambda item: -len(item[0]))

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
        for name, joint_index in self._joint_indices:
            position = _position(name, key)
            if position is None:
                continue
            text_beside_name = key[:position] + " " + key[position + len(name) :]
            other_words = _words(text_beside_name)
            part_and_unit = _part_of(other_words)
            if part_and_unit is not None:
                part, unit = part_and_unit
                return Meaning(joint_index, part, unit)
        return None

    def _key(self, text: str) -> str:
        """Text in the form in which names are compared."""
        return text.casefold() if self._ignores_case else text


def _position(name: str, text: str) -> int | None:
    """Position of the name in the text as a separate word; None if absent."""
    position = text.find(name)
    while position >= 0:
        character_before = text[:position][-1:]
        character_after = text[position + len(name) :][:1]
        if not (character_before.isalnum() or character_after.isalnum()):
            return position
        position = text.find(name, position + 1)
    return None


def _words(text: str) -> Words:
    """Words and numbers of a name in lower case: ``fer, joint, 1``."""
    return tuple(re.findall(r"[^\W\d_]+|\d+", text.casefold()))


def _part_of(words: Sequence[str]) -> tuple[str, str | None] | None:
    """Quantity and unit of the words beside a joint's name; None if uncertain.

    No words mean a position. A word for commands beside words for a position means a command.
    """
    words_without_command = [word for word in words if word not in COMMANDS]
    if len(words_without_command) < len(words):
        commanded = _part_of(words_without_command)
        if commanded is None:
            return None
        part, unit_of_command = commanded
        if part != "q":
            return None
        return "command", unit_of_command
    units: list[str] = []
    quantity_words: list[str] = []
    for word in words:
        if word in UNITS:
            units.append(word)
        elif word not in NEUTRAL:
            quantity_words.append(word)
    if units and quantity_words[-1:] == ["s"]:  # as in deg_s
        quantity_words = quantity_words[:-1]
        units = [f"{units[0]}/s"]
    if not words:
        return "q", None
    if len(quantity_words) != 1 or len(units) > 1:
        return None
    (quantity_word,) = quantity_words
    if quantity_word not in PART_OF:
        return None
    unit = units[0] if units else None
    return PART_OF[quantity_word], unit


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
    """Words of a name for quantities and units, and its other words."""
    quantity_words: list[str] = []
    other_words: list[str] = []
    for k, word in enumerate(words):
        is_per_second = word == "s" and words[k - 1] in UNITS
        is_neutral = word in NEUTRAL and word not in JOINT
        if word in PART_OF or word in UNITS or is_neutral or is_per_second:
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
        names_without_command = {}
        for column, text in texts.items():
            words = _words(text)
            if command in words:
                names_without_command[column] = " ".join(word for word in words if word != command)
        group = candidates(names_without_command).get("q", [])
        if group:
            groups.append(group)
    return groups


def _pattern(words: Iterable[str]) -> Words:
    """Words of a name with # for each number; names with equal patterns differ only by numbers."""
    return tuple("#" if word.isdigit() else word for word in words)


def _has_unmatched(matched_names: Iterable[Words], all_names: Iterable[Words], known_names: Iterable[Words]) -> bool:
    """True if a name in ``all_names`` that is neither matched nor known differs from a matched name only by a number."""
    unmatched = {*all_names} - {*matched_names, *known_names}
    unmatched_patterns = {_pattern(words) for words in unmatched}
    return not unmatched_patterns.isdisjoint(map(_pattern, matched_names))


Rule = Callable[[Sequence[Candidate], Sequence[str], Sequence[str]], "list[Candidate] | None"]
"""Rule: candidates, joint names, names of joints without a coordinate of their own → columns of the joints, or None."""


def match_by_prefix(
    columns: Sequence[Candidate], names: Sequence[str], other_joints: Sequence[str] = ()
) -> list[Candidate] | None:
    """Match columns with the joints' names up to a common prefix: ``fer_joint1`` for ``panda_joint1``.

    >>> fer = candidates(dict(enumerate(["fer_joint2", "fer_joint1", "fer_tool_temp"])))["q"]
    >>> [c.column for c in match_by_prefix(fer, ["panda_joint1", "panda_joint2"])]
    [1, 0]
    """
    matches = _matches_by_prefix(columns, names, other_joints)
    complete_matches: list[list[Candidate]] = []
    for match, is_exclusive in matches.items():
        match_columns = [column for column in match if column is not None]
        if is_exclusive and len(match_columns) == len(names):
            complete_matches.append(match_columns)
    if len(complete_matches) != 1:
        return None
    (matched_columns,) = complete_matches
    for match in matches:  # the match is ambiguous if other columns match at least half of the joints
        has_other_columns = not set(match) <= {*matched_columns, None}
        if has_other_columns and 2 * match.count(None) <= len(names):
            return None
    return matched_columns


def match_most_by_prefix(columns: Sequence[Candidate], names: Sequence[str]) -> Sequence[Candidate | None]:
    """Columns by a common prefix, None for joints without a column; all None if several prefixes match equally many."""
    no_match = [None] * len(names)
    matches = sorted(_matches_by_prefix(columns, names, ()), key=lambda match: match.count(None))  # best first
    if not matches:
        return no_match
    best_match = matches[0]
    is_ambiguous = len(matches) > 1 and best_match.count(None) == matches[1].count(None)
    matched_joint_count = len(names) - best_match.count(None)
    if is_ambiguous or matched_joint_count < 2:
        return no_match
    return best_match


def _matches_by_prefix(
    columns: Sequence[Candidate], names: Sequence[str], other_joints: Sequence[str]
) -> dict[tuple[Candidate | None, ...], bool]:
    """Matches by a prefix of the columns in place of a prefix of the joints.

    A match has a column, or None, for each joint. Its value is False if further columns have its prefix and its pattern.
    """
    matches = dict[tuple[Candidate | None, ...], bool]()
    joint_words = list(map(_words, names))
    other_joint_words = list(map(_words, other_joints))
    fewest_words = min(map(len, joint_words), default=0)
    for prefix_length in range(fewest_words):
        joint_prefix = joint_words[0][:prefix_length]
        endings = _endings(joint_words, joint_prefix)
        is_common_prefix = len(endings) == len(joint_words)
        if not is_common_prefix or any("".join(ending).isdigit() for ending in endings):
            break
        known_endings = _endings(other_joint_words, joint_prefix) + other_joint_words
        for prefix in _column_prefixes(columns, endings):
            columns_by_ending: dict[Words, list[Candidate | None]] = {}
            for column in columns:
                if column.words[: len(prefix)] == prefix:
                    columns_by_ending.setdefault(column.words[len(prefix) :], []).append(column)
            match: list[Candidate | None] = []
            for ending in endings:
                columns_with_ending = columns_by_ending.get(ending, [])
                match += columns_with_ending if len(columns_with_ending) == 1 else [None]
            if not _NOT_A_POSITION.search("_".join(prefix)):
                is_exclusive = not _has_unmatched(endings, columns_by_ending, known_endings)
                matches.setdefault(tuple(match), is_exclusive)
    return matches


def _endings(names: Iterable[Words], prefix: Words) -> list[Words]:
    """Words after the prefix, for each name that begins with the prefix."""
    return [words[len(prefix) :] for words in names if words[: len(prefix)] == prefix]


def _column_prefixes(columns: Sequence[Candidate], endings: Iterable[Words]) -> set[Words]:
    """Words that stand before one of the endings in the name of a column."""
    prefixes = set()
    for ending in set(endings):
        for column in columns:
            if column.words[-len(ending) :] == ending:
                prefixes.add(column.words[: -len(ending)])
    return prefixes


def match_by_ending(
    columns: Sequence[Candidate], names: Sequence[str], other_joints: Sequence[str] = ()
) -> list[Candidate] | None:
    """Match columns by unique endings of the joint's or the column's name: ``A1`` for ``joint_a1``.

    >>> kuka = candidates(dict(enumerate(["A1", "A2", "E1"])))["q"]
    >>> [c.column for c in match_by_ending(kuka, ["joint_a1", "joint_a2"])]
    [0, 1]
    """
    matches: list[Candidate] = []
    prefixes = set[Words]()
    matched_words = set[Words]()
    for name in names:
        joint_words = _words(name)
        fitting_columns = _columns_with_ending(columns, joint_words)
        if len(fitting_columns) != 1:
            return None
        (match,) = fitting_columns
        if match in matches:
            return None
        matches.append(match)
        matched_words.add(match.words)
        if len(match.words) > len(joint_words):
            prefixes.add(match.words[: -len(joint_words)])
    if len(prefixes) > 1:  # columns of several robots
        return None
    known_words = set[Words]()
    for name in other_joints:
        known_words |= {column.words for column in _columns_with_ending(columns, _words(name))}
    if _has_unmatched(matched_words, [column.words for column in columns], known_words):
        return None
    return matches


def _columns_with_ending(columns: Sequence[Candidate], joint: Words) -> list[Candidate]:
    """Columns whose name is the end of a joint's name, or has the joint's name as its end."""
    return [column for column in columns if _ends(column.words, joint)]


def _ends(column: Words, joint: Words) -> bool:
    """True if one name is the end of the other, and is more than a letter, a number or the word for a joint."""
    short_name, long_name = sorted((column, joint), key=len)
    if long_name[-len(short_name) :] != short_name:
        return False
    is_unspecific = len(short_name) == 1 and len(short_name[0]) < 3
    is_number = all(word in JOINT or word.isdigit() for word in short_name)
    if is_unspecific or is_number:
        return False
    prefix_of_column = "_".join(column[: -len(joint)])
    return len(column) <= len(joint) or not _NOT_A_POSITION.search(prefix_of_column)


_MIN_DIGITS_OF_CODE = 4
"""Number of digits from which a number is not the number of a joint."""
_NO_NUMBER = -1
"""Number of a column whose name has none."""


def match_by_number(
    columns: Sequence[Candidate],
    names: Sequence[str],
    other_joints: Sequence[str] = (),  # noqa: ARG001  signature of the rules
) -> list[Candidate] | None:
    """Match columns that are numbered from 0 or 1, as many as joints: ``pos1``, ``actual_q_0``, ``Joint_3``.

    For a single joint, a column without a number also matches.

    >>> ur = candidates(dict(enumerate(["actual_q_1", "actual_q_0", "target_q_0"])))["q"]
    >>> [c.column for c in match_by_number(ur, ["shoulder", "elbow"])]
    [1, 0]
    """
    numbered_columns = []
    for column in columns:
        numbers_in_name = [int(word) for word in column.words if word.isdigit()]
        other_words = [word for word in column.words if word not in JOINT]
        has_only_numbers = all(word.isdigit() and len(word) < _MIN_DIGITS_OF_CODE for word in other_words)
        if len(numbers_in_name) < 2 and has_only_numbers:
            number = numbers_in_name[0] if numbers_in_name else _NO_NUMBER
            numbered_columns.append((number, column))
    if len(numbered_columns) != len(names):
        return None
    if not names:
        return []
    numbered_columns.sort(key=lambda pair: pair[0])
    numbers = [number for number, _ in numbered_columns]
    first_number = numbers[0]
    are_consecutive = numbers == list(range(first_number, first_number + len(numbers)))
    if first_number == _NO_NUMBER:
        begins_well = len(numbers) == 1
    else:
        begins_well = first_number in (0, 1)
    if not (are_consecutive and begins_well):
        return None
    return [column for _, column in numbered_columns]


RULES: Mapping[str, Rule] = {
    "by their names, a common prefix aside": match_by_prefix,
    "by the ends of their names": match_by_ending,
    "in their order": match_by_number,
}
"""Rules by their description in notes, in the order of application."""
