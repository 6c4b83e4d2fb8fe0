"""Findings of the doctor with their effects, and repairs that edit only the numbers concerned."""

from __future__ import annotations

import codecs
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from ..bodies.inertia import SpatialInertia
from ..core.numbers import number
from ..errors import RobotFileError
from ..formats.source import MAX_BYTES
from ..formats.xml import BLANK, without_loose_declaration


class Severity(StrEnum):
    """How much a finding matters."""

    ERROR = "error"
    """What it is about cannot exist, or cannot be read."""
    WARNING = "warning"
    """Very probably not meant, and it changes what is computed."""
    NOTE = "note"


@dataclass(frozen=True)
class Place:
    """Where a number stands in the file.

    Attributes
    ----------
    element : int, number of the element in document order
    attribute : str; empty: the text within the element
    position : int, which of several numbers; -1: all there is
    """

    element: int
    attribute: str = ""
    position: int = -1


@dataclass(frozen=True)
class Edit:
    """One number of the file, as it will be written.

    Attributes
    ----------
    place : Place
    text : str
    how : str, ``change`` what is there, ``put`` an attribute that may be missing, or ``remove`` an attribute
    """

    place: Place
    text: str
    how: Literal["change", "put", "remove"] = "change"


_ALL = 1e8
"""Per cent of what is left, from which a repair takes all inertia that a joint moves."""


@dataclass(frozen=True)
class Effect:
    """Effect of a finding: the largest changes between the file and its repair, over random configurations.

    Attributes
    ----------
    inertia_percent : float, of a diagonal entry of the mass matrix, in percent of the repaired robot's
    inertia_joint : str, whose entry that is; empty where none changes
    torque : float, of a gravity torque or force [N m or N]
    torque_joint : str
    effort_percent : float, of a gravity torque in percent of the joint's effort limit; 0 where no limit is given
    effort_joint : str

    Examples
    --------
    >>> print(Effect(260.0, "wrist_3_joint", 0.0, "", 0.0, ""))
    M of wrist_3_joint by 260 %
    """

    inertia_percent: float = 0.0
    inertia_joint: str = ""
    torque: float = 0.0
    torque_joint: str = ""
    effort_percent: float = 0.0
    effort_joint: str = ""

    def __str__(self) -> str:
        lost = self.inertia_percent >= _ALL
        by = f"M of {self.inertia_joint} " + ("to next to nothing" if lost else f"by {_percent(self.inertia_percent)}")
        said = [by] if self.inertia_joint else []
        if self.torque_joint:
            share = (
                f", {_percent(self.effort_percent)} of the effort of {self.effort_joint}" if self.effort_joint else ""
            )
            said.append(f"g of {self.torque_joint} by {number(self.torque, 3)}{share}")
        return "; ".join(said) or "none"

    def reaches(self, percent: float, effort: float = 1.0) -> bool:
        """Whether an entry of M changes by that much, or a gravity torque by that much of its limit.

        Parameters
        ----------
        percent : float, of M
        effort : float, of the effort limit, percent

        Returns
        -------
        answer : bool

        Examples
        --------
        >>> Effect(3.0, "elbow").reaches(5.0)
        False
        """
        return self.inertia_percent >= percent or self.effort_percent >= effort


@dataclass(frozen=True, eq=False)
class FileRepair:
    """FileRepair of a finding: what it changes, and why.

    Attributes
    ----------
    kind : str, "slip" where one slip explains the numbers, "nearest", "entropic", "shape", "mirror", "number" or "advice"
    sentence : str
    inertias : {link: SpatialInertia} about the link's origin, what they become
    edits : the numbers of the file to change; empty where nothing is written
    metric : str, what "nearest" is measured in
    """

    kind: str
    sentence: str
    inertias: Mapping[str, SpatialInertia] = field(default_factory=dict)
    edits: tuple[Edit, ...] = ()
    metric: str = ""


@dataclass(frozen=True, eq=False)
class Finding:
    """Finding of the doctor.

    Attributes
    ----------
    check : str, name of the check
    severity : Severity
    where : str, the link or joint
    line : int, in the file; 0 where it is not known
    sentence : str, what is wrong
    numbers : {name: float}, what it is judged by
    effect : Effect, between the file and its repair
    repair : FileRepair, or None
    file : str, the included file that the line is of; empty for the robot's own
    """

    check: str
    severity: Severity
    where: str
    line: int
    sentence: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    effect: Effect = Effect()
    repair: FileRepair | None = None
    file: str = ""

    def __str__(self) -> str:
        place = f" ({self.file + ', ' if self.file else ''}line {self.line})" if self.line else ""
        return f"{self.severity}: {self.where}{place}: {self.sentence}"


def _percent(value: float) -> str:
    return f"{number(value, 3)} %" if value < 1e4 else f"a factor of {number(value / 100.0, 2)}"


# ── Edits of a robot file

_ATTRIBUTE = re.compile(r"""([^\s=<>"'/]+)\s*=\s*("[^"]*"|'[^']*')""")
_SIGNATURE = "twistwrench doctor"


@dataclass(frozen=True)
class _Tag:
    """The start tag of an element in the text: from ``<`` to behind ``>``."""

    start: int
    end: int
    content_end: int
    """Where the text behind the tag ends."""


def edited(
    text: str,
    edits: Sequence[tuple[Edit, str]],
    *,
    additions: Mapping[int, str] | None = None,
    signature: str = _SIGNATURE,
) -> str:
    """The text with some numbers changed; each edit comes with a sentence that says why, which goes into a comment.

    ``additions`` are what goes first into elements, by the numbers of these. Raises :class:`~twistwrench.RobotFileError` where
    a number is not found at its place.
    """
    tags = _tags(text, {edit.place.element for edit, _ in edits} | set(additions or {}))
    by_element: dict[int, list[tuple[Edit, str]]] = defaultdict(list)
    for edit, why in edits:
        by_element[edit.place.element].append((edit, why))
    changes: list[tuple[int, int, str]] = []
    for element, mine in by_element.items():
        tag = tags[element]
        was = []
        for edit, _ in mine:
            change, before = _change(text, tag, edit)
            was.append(before)
            changes.append(change)
        whys = dict.fromkeys(why for _, why in mine)
        said = f"{signature}: {', '.join(was)}: {'; '.join(whys)}"
        changes.append((tag.start, tag.start, _comment(text, tag.start, said)))
    for element, addition in (additions or {}).items():
        tag = tags[element]
        blank = text[tag.end : tag.content_end]
        before = blank[: len(blank) - len(blank.lstrip())]
        if text[tag.end - 2] == "/":  # <link name="tool"/> gets an end of its own
            name = re.split(r"[\s/>]", text[tag.start + 1 : tag.end], maxsplit=1)[0]
            changes.append((tag.end - 2, tag.end, f">{addition}</{name}>"))
        else:
            changes.append((tag.end, tag.end, f"{before}{addition}"))
    parts, at = [], 0
    for start, end, new in sorted(changes):
        if start < at:
            raise RobotFileError(
                "two repairs change the same number of the file. Repair one check at a time, with only=…."
            )
        parts += [text[at:start], new]
        at = end
    return "".join([*parts, text[at:]])


def encoded(text: str, original: bytes) -> bytes:
    """The bytes of a text in the encoding of the file it came from."""
    for encoding, mark in (
        ("utf-8", codecs.BOM_UTF8),
        ("utf-16-le", codecs.BOM_UTF16_LE),
        ("utf-16-be", codecs.BOM_UTF16_BE),
    ):
        if original.startswith(mark):
            return mark + text.lstrip("\ufeff").encode(encoding)
    declared = re.match(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([A-Za-z0-9._:-]+)["']""", original)
    encoding = declared[1].decode("ascii") if declared else "utf-8"
    return text.encode(encoding, "xmlcharrefreplace")


def _tags(text: str, wanted: set[int]) -> Mapping[int, _Tag]:
    """The start tags of some elements, by their numbers in document order."""
    from xml.parsers import expat

    if len(text) > MAX_BYTES:
        raise RobotFileError("the file is too large to be edited.")
    body = text.lstrip(BLANK)
    skipped = len(text) - len(body)
    data = without_loose_declaration(body).encode("utf-8", "surrogatepass")
    places: dict[int, int] = {}
    ends: dict[int, int] = {}
    count, last = 0, -1
    parser = expat.ParserCreate("utf-8")

    def start(*_: object) -> None:
        nonlocal count, last
        close(last)
        if count in wanted:
            places[count] = parser.CurrentByteIndex
        last, count = count, count + 1

    def end(*_: object) -> None:
        nonlocal last
        close(last)
        last = -1

    def close(element: int) -> None:
        if element in places and element not in ends:
            ends[element] = parser.CurrentByteIndex

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    found: dict[int, _Tag] = {}
    for element, place in places.items():
        at = skipped + len(data[:place].decode("utf-8", "surrogatepass"))
        stop = skipped + len(data[: ends[element]].decode("utf-8", "surrogatepass"))
        found[element] = _Tag(at, _behind(text, at), stop)
    return found


def _behind(text: str, start: int) -> int:
    """Behind the ``>`` that ends a start tag: one within quotes does not."""
    quote = ""
    for k in range(start, len(text)):
        letter = text[k]
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter == ">":
            return k + 1
    raise RobotFileError("an element of the file does not end.")


def _change(text: str, tag: _Tag, edit: Edit) -> tuple[tuple[int, int, str], str]:
    """From where to where the text changes, and to what; and what it was, in words."""
    place = edit.place
    match = _attribute(text, tag, place.attribute) if edit.how != "change" else None
    if edit.how == "put" and match is None:
        at = tag.end - (2 if text[tag.end - 2] == "/" else 1)
        at -= len(text[tag.start : at]) - len(text[tag.start : at].rstrip())
        return (at, at, f' {place.attribute}="{edit.text}"'), f"{place.attribute} was not given"
    start, end = _span(text, tag, edit)
    which = f"number {place.position + 1} of " if place.position >= 0 else ""
    was = f"{which}{place.attribute or 'its text'} was {text[start:end].strip()}"
    if edit.how == "remove" and match is not None:
        blanks = len(text[tag.start : match.start()]) - len(text[tag.start : match.start()].rstrip())
        return (match.start() - blanks, match.end(), ""), was
    return (start, end, edit.text), was


def _attribute(text: str, tag: _Tag, name: str) -> re.Match[str] | None:
    return next((m for m in _ATTRIBUTE.finditer(text, tag.start, tag.end) if m[1] == name), None)


def _span(text: str, tag: _Tag, edit: Edit) -> tuple[int, int]:
    """Where the number stands."""
    place = edit.place
    if place.attribute:
        match = _attribute(text, tag, place.attribute)
        if match is None:
            raise RobotFileError(f"the attribute {place.attribute!r} is not where it was. Load the file again.")
        start, end = match.start(2) + 1, match.end(2) - 1
    else:
        start, end = tag.end, tag.content_end
    if place.position < 0:
        content = text[start:end]
        return start + len(content) - len(content.lstrip()), end - len(content) + len(content.rstrip())
    words = list(re.compile(r"\S+").finditer(text, start, end))
    if place.position >= len(words):
        raise RobotFileError(f"the attribute {place.attribute!r} has too few numbers. Load the file again.")
    return words[place.position].span()


def _comment(text: str, at: int, said: str) -> str:
    """A comment on a line of its own, as far in as the element; before it where that does not begin its line."""
    said = re.sub(r"-(?=-)", "- ", said).rstrip("-")
    comment = f"<!-- {said} -->"
    line = max(text.rfind("\n", 0, at), text.rfind("\r", 0, at)) + 1
    indent = text[line:at]
    if indent.strip(" \t"):
        return comment
    newline = "\r\n" if text[max(0, line - 2) : line] == "\r\n" else text[line - 1 : line] if line else "\n"
    return f"{comment}{newline}{indent}"
