"""Elements, attributes and model fields of other programs' formats: read, ignored, or left out with a note.

``KNOWN[format][tag]`` is a *row*: it lists what an element with this tag may contain, by name. A name is an attribute, or
``<child>`` for a child element; ``*`` stands for all unlisted names. Each name has an *entry*:

* READ: attributes and children that are read. Such a child has a row of its own, named by its tag, or by ``parent/tag`` for
  tags with two meanings. A child without a row contains only text.
* NO_MECHANICS: appearance, contacts, sensors or controllers, which are skipped with all that they contain.
* :class:`LeftOut`: mechanics that is not read, which gives a note.

Unlisted names with another program's prefix are skipped; other unlisted names give a note. The table is in
``known_elements.txt``.
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
"""Entry of what is read."""
NO_MECHANICS = "no mechanics"
"""Entry of what is skipped with all that it contains."""
ALL_OTHERS = "*"
"""Name in a row that stands for all unlisted names."""


@dataclass(frozen=True)
class LeftOut:
    """Mechanics that is not read, and its effect."""

    change: str
    """Sentence on the numbers that this mechanics would change."""
    unless: tuple[str, ...] = ()
    """Values without an effect, in lower case; if empty, these are zeros and ``false``."""

    def acts(self, texts: Iterable[str]) -> bool:
        """True if any word in the texts has an effect, or if there are no words."""
        words = " ".join(texts).lower().split()
        if not words:
            return True
        if self.unless:
            return any(word not in self.unless for word in words)
        return not all(map(_is_zero, words))


Entry = str | LeftOut
Rows = Mapping[str, Mapping[str, Entry]]


def _is_zero(word: str) -> bool:
    """True for a number that is zero, and for ``false``."""
    try:
        return word == "false" or float(word) == 0.0
    except ValueError:
        return False


def _read_table(text: str) -> dict[str, Rows]:
    """Rows of each format, from the lines of ``known_elements.txt``.

    Each line is one of these:

    * ``# …``: a comment
    * ``[URDF]``: name of a format, whose rows follow
    * ``key: change | values``: an effect with its key, its sentence, and its values without an effect
    * ``tag tag``: tags that share the row in the next lines
    * ``  key: names``, indented: names of the row that have this entry. The keys "read" and "ignored" stand for READ and
      NO_MECHANICS, others for effects
    """
    formats: dict[str, dict[str, dict[str, Entry]]] = {}
    entry_of_key: dict[str, Entry] = {"read": READ, "ignored": NO_MECHANICS}
    rows: dict[str, dict[str, Entry]] = {}  # of the current format
    row: dict[str, Entry] = {}
    for line in text.splitlines():
        key, _, content = line.partition(": ")
        if line.startswith("["):
            format_name = line[1:-1]  # without brackets
            rows = {}
            formats[format_name] = rows
        elif line.startswith(" "):
            row |= dict.fromkeys(content.split(), entry_of_key[key.strip()])
        elif not line or line.startswith("#"):
            continue
        elif content:
            change, _, values = content.partition(" | ")
            entry_of_key[key] = LeftOut(change, tuple(values.split()))
        else:
            if row:  # otherwise the line before has tags too, and all share its row
                row = {}
            rows |= dict.fromkeys(line.split(), row)  # one object for all these tags
    return {name: rows for name, rows in formats.items() if rows}  # the section of effects has no rows


_TABLE = get_data(__name__, "known_elements.txt")
"""Table in the package, which get_data finds also in an archive."""
KNOWN: Mapping[str, Rows] = _read_table((_TABLE or b"").decode())

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
"""Notes on left-out mechanics of MJCF and of compiled MuJoCo models, by element and attribute.

Most effects depend on several attributes, so the readers decide whether to add a note.
"""

_MAX_NAMES = 100
"""Largest number of names with separate notes."""
_MAX_COMPARED_LENGTH = 100
"""Number of characters of a name that are compared with known names."""
_MAX_PARENTS = 3
"""Largest number of parents that a note names."""


class Unread:
    """Notes on elements and attributes that are not read: one note for each name, with the number of its occurrences.

    Parameters
    ----------
    format_name : str, one of KNOWN
    """

    def __init__(self, format_name: str) -> None:
        self.format = format_name
        self.rows = KNOWN[format_name]
        self._notes: dict[tuple[str, str], tuple[str, str]] = {}
        """Place of the first occurrence and text of each note, by tag and name."""
        self._occurrences: Counter[tuple[str, str]] = Counter()
        """Number of occurrences, by tag and name."""

    def row(self, tag: str, parent: str = "") -> Mapping[str, Entry]:
        """Row of a tag inside the tag ``parent``; empty if there is none."""
        row_in_parent = self.rows.get(f"{parent}/{tag}")
        return row_in_parent or self.rows.get(tag) or {}

    @staticmethod
    def entry(row: Mapping[str, Entry], name: str) -> Entry | None:
        """Entry of a name in a row; None for unknown names."""
        entry = row.get(name) or row.get(ALL_OTHERS)  # no entry is empty
        is_of_usd = name.startswith("physics:")  # USD's own prefix
        has_foreign_prefix = ":" in name and not is_of_usd
        if entry is None and has_foreign_prefix:
            return NO_MECHANICS
        return entry

    def note_left_out(self, tag: str, name: str, entry: LeftOut, place: str) -> None:
        """Add a note on mechanics that is not read."""
        self._add_note(tag, name, place, lambda: f"not read; {entry.change}")

    def note_unknown(self, tag: str, name: str, place: str) -> None:
        """Add a note on an unknown name in a tag."""
        self._add_note(tag, name, place, lambda: self._unknown_text(tag, name))

    def walk(self, element: Element) -> None:
        """Add notes on unread content of an element and of the elements in it."""
        stack = [(element, "")]  # with the tag of the parent
        while stack:
            current, parent = stack.pop()
            row = self.row(current.tag, parent)
            for name, text in current.attributes.items():
                entry = self.entry(row, name)
                if entry is None:
                    self.note_unknown(current.tag, name, current.place)
                elif isinstance(entry, LeftOut) and entry.acts([text]):
                    place = f'{name}="{shorten(text)}" of {current}'
                    self.note_left_out(current.tag, name, entry, place)
            read_children = []
            for child in current.children:
                name = f"<{child.tag}>"
                entry = self.entry(row, name)
                if entry is READ:
                    read_children.append((child, current.tag))
                elif entry is None:
                    self.note_unknown(current.tag, name, child.place)
                elif isinstance(entry, LeftOut) and entry.acts(_texts_in(child)):
                    self.note_left_out(current.tag, name, entry, str(child))
            stack.extend(reversed(read_children))  # the stack returns the last one first

    @property
    def remarks(self) -> list[str]:
        """Notes as sentences, in order of first occurrence."""
        sentences = []
        for key, (place, text) in self._notes.items():
            repetitions = self._occurrences[key] - 1
            others = f" and {repetitions} more" if repetitions else ""
            sentences.append(f"{place}{others}: {text}")
        names_without_note = len(self._occurrences) - len(self._notes)
        if names_without_note:
            sentences.append(f"{names_without_note} more names are not read")
        return sentences

    def _add_note(self, tag: str, name: str, place: str, make_text: Callable[[], str]) -> None:
        """Count an occurrence of a name; the first one adds a note, whose text is made only then."""
        key = tag, name
        self._occurrences[key] += 1
        if self._occurrences[key] == 1 and len(self._notes) < _MAX_NAMES:
            self._notes[key] = place, make_text()

    def _unknown_text(self, tag: str, name: str) -> str:
        """Clause about an unknown name, with the elements that may have it, or with the most similar known name."""
        row = self.row(tag)
        if name.startswith("<"):
            parents = [parent for parent, names in self.rows.items() if name in names]
            if parents:
                parent_tags = [parent.split("/")[-1] for parent in parents[:_MAX_PARENTS]]  # without the tag above
                choices_text = " or ".join(f"<{parent_tag}>" for parent_tag in parent_tags)
                return f"{name} is not an element of <{tag}> in {self.format}; it belongs into {choices_text}"
            text = f"{shorten(name)} is not an element of {self.format}"
            choices = [choice for choice in row if choice.startswith("<")]
        else:
            text = f"{shorten(name)} is not an attribute of <{tag}> in {self.format}"
            choices = [choice for choice in row if not choice.startswith("<")]
        similar_names = difflib.get_close_matches(name[:_MAX_COMPARED_LENGTH], choices, n=1)
        if not similar_names:
            return text
        return f"{text}; did you mean {similar_names[0]}?"


def unread(format_name: str, *elements: Element) -> list[str]:
    """Notes on unread content of elements."""
    notes = Unread(format_name)
    for element in elements:
        notes.walk(element)
    return notes.remarks


def _texts_in(element: Element) -> list[str]:
    """Nonempty texts and ``value`` attributes of an element and of all elements in it."""
    texts: list[str] = []
    for part in element.walk():
        texts.append(part.content)
        texts.append(part.attributes.get("value", ""))
    return [text for text in texts if text.strip()]
