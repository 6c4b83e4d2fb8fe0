"""Elements, attributes and model fields of other programs' formats: read, ignored, or left out with a note.

``KNOWN[format][tag][name]`` is READ, NO_MECHANICS or a :class:`LeftOut`; ``name`` is an attribute, or ``<child>`` for an
element. An element marked READ has a row of its own, named by its tag, or ``parent/tag`` for tags with two meanings;
without a row it contains only text. NO_MECHANICS (appearance, contacts, sensors, controllers) is skipped entirely.
:class:`LeftOut` is mechanics that is not read. ``*`` stands for all unlisted names. Unlisted names with another
program's prefix are skipped; other unlisted names give a note. The names are in ``known_elements.txt``.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pkgutil import get_data

from ..core.text import shorten
from .xml import Element

READ = "read"
NO_MECHANICS = "no mechanics"
OTHERS = "*"


@dataclass(frozen=True)
class LeftOut:
    """Mechanics that is not read, and its effect."""

    change: str
    """Sentence: numbers that it would change."""
    unless: tuple[str, ...] = ()
    """Values without an effect; if empty: zeros and ``false``."""

    def acts(self, texts: Iterable[str]) -> bool:
        """True if any word in the texts has an effect, or if there are no words."""
        words = [word for text in texts for word in text.lower().split()]
        return not words or any(word not in self.unless if self.unless else not _is_zero(word) for word in words)


Entry = str | LeftOut
Rows = Mapping[str, Mapping[str, Entry]]


def _is_zero(word: str) -> bool:
    try:
        return word == "false" or float(word) == 0.0
    except ValueError:
        return False


def _read_table(text: str) -> dict[str, Rows]:
    """Parse formats and their rows; the first section has the effects of mechanics that is left out."""
    formats: dict[str, dict[str, dict[str, Entry]]] = {}
    entries: dict[str, Entry] = {"read": READ, "ignored": NO_MECHANICS}
    rows: dict[str, dict[str, Entry]] = {}
    row: dict[str, Entry] = {}
    for line in text.splitlines():
        key, _, rest = line.partition(": ")
        if line.startswith("["):
            rows = formats[line[1:-1]] = {}
        elif line.startswith(" "):
            row |= dict.fromkeys(rest.split(), entries[key.strip()])
        elif rest and not line.startswith("#"):
            change, _, values = rest.partition(" | ")
            entries[key] = LeftOut(change, tuple(values.split()))
        elif line and not line.startswith("#"):  # tags, possibly on several lines
            row = {} if row else row
            rows |= dict.fromkeys(line.split(), row)
    return {name: rows for name, rows in formats.items() if rows}


KNOWN: Mapping[str, Rows] = _read_table((get_data(__name__, "known_elements.txt") or b"").decode())  # works in archives

ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor", "pid",
    "orientation", "plugin",
)  # fmt: skip
"""Elements of ``<actuator>`` in MJCF, which share their defaults."""

LEFT_OUT: Mapping[str, str] = {
    "option/density": "fills the world with a fluid, whose forces are left out",
    "body/gravcomp": "is held against gravity (gravcomp), which is left out",
    "body/plugin": "is a plugin, whose forces are left out",
    "joint/damping": "has a damping that is a polynomial, of which the linear term alone is kept",
    "joint/stiffness": "has a stiffness that is a polynomial, of which the linear term alone is kept",
    "joint/springyield": "has a spring that yields (springyield), which is read as elastic",
    "ball/stiffness": "is a ball or free joint with a stiffness, which is left out",
    "ball/range": "is a ball joint with a limit, which is not kept",
    "actuator/unknown": "is not an actuator known here, and its effect is left out",
    "actuator/joint": "drives no hinge or slide, and its effect is left out",
    "actuator/damping": "has a damping that is a polynomial, of which the linear term alone is kept",
    "tendon/stiffness": "has a stiffness that is a polynomial, and its spring is left out",
    "tendon/springyield": "has a spring that yields (springyield), which is read as elastic",
    "deformable/flex": "is a deformable body, whose elastic forces are left out",
}
"""Notes on mechanics of MJCF and of compiled MuJoCo models that is left out, by element and attribute.

Most effects depend on several attributes, so the readers decide whether to add a note.
"""

_MAX_NAMES = 100
"""Largest number of names with separate notes."""


class Unread:
    """Notes on elements and attributes that are not read, once per name with a count.

    Parameters
    ----------
    format_name : str, one of KNOWN
    """

    def __init__(self, format_name: str) -> None:
        self.format, self.rows = format_name, KNOWN[format_name]
        self._notes: dict[tuple[str, str], tuple[str, str]] = {}
        self._count: Counter[tuple[str, str]] = Counter()

    def row(self, tag: str, parent: str = "") -> Mapping[str, Entry]:
        """Names allowed in a tag inside another tag."""
        return self.rows.get(f"{parent}/{tag}") or self.rows.get(tag) or {}

    @staticmethod
    def entry(row: Mapping[str, Entry], name: str) -> Entry | None:
        """Entry of a name in a row; None for unknown names."""
        entry = row.get(name) or row.get(OTHERS)
        foreign = entry is None and ":" in name and not name.startswith("physics:")  # prefix of USD itself
        return NO_MECHANICS if foreign else entry

    def note_left_out(self, tag: str, name: str, entry: LeftOut, who: str) -> None:
        """Add a note on mechanics that is not read."""
        self._note(tag, name, who, lambda: f"not read; {entry.change}")

    def note_unknown(self, tag: str, name: str, place: str) -> None:
        """Add a note on an unknown name in a tag."""
        self._note(tag, name, place, lambda: self._unknown_text(tag, name))

    def walk(self, element: Element) -> None:
        """Add notes on unread content of an element."""
        stack = [(element, "")]
        while stack:
            current, parent = stack.pop()
            row = self.row(current.tag, parent)
            for name, text in current.attributes.items():
                entry = self.entry(row, name)
                if entry is None:
                    self.note_unknown(current.tag, name, current.place)
                elif isinstance(entry, LeftOut) and entry.acts([text]):
                    self.note_left_out(current.tag, name, entry, f'{name}="{shorten(text)}" of {current}')
            children = []
            for child in current.children:
                name = f"<{child.tag}>"
                entry = self.entry(row, name)
                if entry is READ:
                    children.append((child, current.tag))
                elif entry is None:
                    self.note_unknown(current.tag, name, child.place)
                elif isinstance(entry, LeftOut) and entry.acts(_texts(child)):
                    self.note_left_out(current.tag, name, entry, str(child))
            stack.extend(reversed(children))

    @property
    def remarks(self) -> list[str]:
        """Notes as sentences, in order of first occurrence."""
        sentences = []
        for key, (who, text) in self._notes.items():
            repeats = self._count[key] - 1
            others = f" and {repeats} more" if repeats else ""
            sentences.append(f"{who}{others}: {text}")
        without_note = len(self._count) - len(self._notes)
        if without_note:
            sentences.append(f"{without_note} more names are not read")
        return sentences

    def _note(self, tag: str, name: str, who: str, text: Callable[[], str]) -> None:
        key = tag, name
        self._count[key] += 1
        if self._count[key] == 1 and len(self._notes) < _MAX_NAMES:
            self._notes[key] = who, text()

    def _unknown_text(self, tag: str, name: str) -> str:
        """Sentence about an unknown name, with the closest known name."""
        choices = self.row(tag)
        if not name.startswith("<"):
            text = f"{shorten(name)} is not an attribute of <{tag}> in {self.format}"
            similar = [choice for choice in choices if not choice.startswith("<")]
        else:
            parents = [f"<{parent.rpartition('/')[2]}>" for parent, names in self.rows.items() if name in names]
            if parents:
                return (
                    f"{name} is not an element of <{tag}> in {self.format}; it belongs into {' or '.join(parents[:3])}"
                )
            text = f"{shorten(name)} is not an element of {self.format}"
            similar = [choice for choice in choices if choice.startswith("<")]
        nearest = difflib.get_close_matches(name[:_MAX_NAMES], similar, n=1)
        return f"{text}; did you mean {nearest[0]}?" if nearest else text


def unread(format_name: str, *elements: Element) -> list[str]:
    """Notes on unread content of elements."""
    notes = Unread(format_name)
    for element in elements:
        notes.walk(element)
    return notes.remarks


def _texts(element: Element) -> list[str]:
    """Texts and ``value`` attributes in an element."""
    texts = [text for one in element.walk() for text in (one.content, one.attributes.get("value", ""))]
    return [text for text in texts if text.strip()]
