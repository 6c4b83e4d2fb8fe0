"""Text edits of robot files: single numbers, attributes and elements; all other bytes are unchanged."""

from __future__ import annotations

import codecs
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ..core.errors import ModelError, RobotFileError
from ..core.text import argument
from .source import DECLARED_ENCODING, MAX_BYTES
from .xml import BLANK, Element, Place, without_loose_declaration


@dataclass(frozen=True)
class Edit:
    """Edit of one number of a file.

    Attributes
    ----------
    place : Place
    text : str, the new value
    how : str, kind of edit: ``change`` a number, ``put`` an attribute that may be missing, or ``remove`` an attribute
    """

    place: Place
    text: str
    how: Literal["change", "put", "remove"] = "change"


# ── Edits of a robot file

_START_TAG = re.compile(r"""<(?:[^"'>]++|"[^"]*+"|'[^']*+')*+>""")
"""Start tag; a ``>`` within quotes does not end it."""
_ATTRIBUTE = re.compile(r"""([^\s=<>"'/]+)\s*=\s*("[^"]*"|'[^']*')""")
"""Name of an attribute, and its value with quotes."""


@dataclass(frozen=True)
class _Tag:
    """Start tag of an element in the text, from ``<`` to after ``>``."""

    start: int
    end: int
    content_end: int
    """End of the text between this tag and the next one."""


_TextChange = tuple[int, int, str]
"""Start and end of a part of a text, and the new text of that part."""


def apply_edits(
    text: str,
    edits: Sequence[tuple[Edit, str]],
    *,
    additions: Mapping[int, str] | None = None,
    signature: str = "twistwrench doctor",
) -> str:
    """Apply pairs of an edit and its reason to a text. A comment before each edited element has old values and reasons.

    ``additions`` holds texts by element number; each is inserted at the beginning of its element. Raises
    :class:`~twistwrench.RobotFileError` if a number is not found.
    """
    additions = additions or {}
    edited_elements = {edit.place.element for edit, _ in edits}
    tags = _start_tags(text, edited_elements | set(additions))
    edits_by_element: dict[int, list[tuple[Edit, str]]] = defaultdict(list)
    for edit, reason in edits:
        edits_by_element[edit.place.element].append((edit, reason))
    changes: list[_TextChange] = []
    for element, element_edits in edits_by_element.items():
        tag = tags[element]
        old_values = []
        for edit, _ in element_edits:
            change, old_value = _change(text, tag, edit)
            old_values.append(old_value)
            changes.append(change)
        reasons = dict.fromkeys(reason for _, reason in element_edits)  # each once, in order
        comment = f"{signature}: {', '.join(old_values)}: {'; '.join(reasons)}"
        changes.append((tag.start, tag.start, _comment(text, tag.start, comment)))
    for element, addition in additions.items():
        changes.append(_insertion(text, tags[element], addition))
    parts: list[str] = []
    position = 0
    for start, end, new_text in sorted(changes):
        if start < position:
            raise RobotFileError(
                f"two repairs change the same number of the file. Repair one check at a time, with {argument('only')}."
            )
        parts += [text[position:start], new_text]
        position = end
    return "".join([*parts, text[position:]])


def _insertion(text: str, tag: _Tag, addition: str) -> _TextChange:
    """Change that adds text at the beginning of an element."""
    if _closes_itself(text, tag):  # an element such as <link name="tool"/> gets an end tag
        element_name, *_ = re.split(r"[\s/>]", text[tag.start + 1 : tag.end], maxsplit=1)
        return tag.end - 2, tag.end, f">{addition}</{element_name}>"
    content = text[tag.end : tag.content_end]
    leading_blanks = content[: len(content) - len(content.lstrip())]
    return tag.end, tag.end, f"{leading_blanks}{addition}"


def _closes_itself(text: str, tag: _Tag) -> bool:
    """True if a start tag ends with ``/>``."""
    return text[tag.end - 2] == "/"


def encode_as(text: str, original: bytes) -> bytes:
    """Encode a text as in the original file: by its byte order mark, else by its declaration, else as UTF-8."""
    for encoding, byte_order_mark in (
        ("utf-8", codecs.BOM_UTF8),
        ("utf-16-le", codecs.BOM_UTF16_LE),
        ("utf-16-be", codecs.BOM_UTF16_BE),
    ):
        if original.startswith(byte_order_mark):
            return byte_order_mark + text.lstrip("\ufeff").encode(encoding)
    declaration = DECLARED_ENCODING.match(original)
    declared_encoding = "utf-8"
    if declaration:
        declared_encoding = declaration[1].decode("ascii")
    return text.encode(declared_encoding, "xmlcharrefreplace")


def _start_tags(text: str, numbers: set[int]) -> Mapping[int, _Tag]:
    """Start tags, by element number, of the elements with these numbers; elements are numbered in document order."""
    from xml.parsers import expat

    if len(text) > MAX_BYTES:
        raise RobotFileError("the file is too large to be edited.")
    body = text.lstrip(BLANK)
    leading_blanks = len(text) - len(body)
    data = without_loose_declaration(body).encode("utf-8", "surrogatepass")
    tag_starts: dict[int, int] = {}  # byte indices
    content_ends: dict[int, int] = {}  # byte indices
    element_count = 0
    current = -1  # number of the element whose text the parser reads; -1 after an end tag
    parser = expat.ParserCreate("utf-8")

    def begin_element(*_: object) -> None:
        nonlocal element_count, current
        end_content(current)
        if element_count in numbers:
            tag_starts[element_count] = parser.CurrentByteIndex
        current = element_count
        element_count += 1

    def end_element(*_: object) -> None:
        nonlocal current
        end_content(current)
        current = -1

    def end_content(element: int) -> None:
        if element in tag_starts and element not in content_ends:
            content_ends[element] = parser.CurrentByteIndex

    parser.StartElementHandler = begin_element
    parser.EndElementHandler = end_element
    parser.Parse(data, True)

    def character_index(byte_index: int) -> int:
        return leading_blanks + len(data[:byte_index].decode("utf-8", "surrogatepass"))

    tags: dict[int, _Tag] = {}
    for element, tag_start in tag_starts.items():
        start = character_index(tag_start)
        tags[element] = _Tag(start, _end_of_start_tag(text, start), character_index(content_ends[element]))
    return tags


def _end_of_start_tag(text: str, start: int) -> int:
    """Index after the ``>`` that ends a start tag, outside of quotes."""
    tag = _START_TAG.match(text, start)
    if tag is None:
        raise RobotFileError("an element of the file does not end.")
    return tag.end()


def _change(text: str, tag: _Tag, edit: Edit) -> tuple[_TextChange, str]:
    """Change of the text by an edit, and a description of the old value."""
    place = edit.place
    match = None
    if edit.how != "change":
        match = _attribute(text, tag, place.attribute)
    if edit.how == "put" and match is None:
        position = tag.end - 1  # before ">"
        if _closes_itself(text, tag):
            position -= 1  # before "/>"
        position -= _trailing_blanks(text[tag.start : position])
        new_attribute = f' {place.attribute}="{edit.text}"'
        return (position, position, new_attribute), f"{place.attribute} was not given"
    start, end = _span(text, tag, edit)
    value_name = place.attribute or "its text"
    if place.position >= 0:  # one of several numbers
        value_name = f"number {place.position + 1} of {value_name}"
    old_value = f"{value_name} was {text[start:end].strip()}"
    if edit.how == "remove" and match is not None:
        blanks = _trailing_blanks(text[tag.start : match.start()])
        return (match.start() - blanks, match.end(), ""), old_value
    return (start, end, edit.text), old_value


def _trailing_blanks(text: str) -> int:
    """Number of blanks at the end of a text."""
    return len(text) - len(text.rstrip())


def _attribute(text: str, tag: _Tag, name: str) -> re.Match[str] | None:
    """Match of an attribute in a start tag: group 1 is its name, group 2 its value with quotes."""
    for match in _ATTRIBUTE.finditer(text, tag.start, tag.end):
        if match[1] == name:
            return match
    return None


def _span(text: str, tag: _Tag, edit: Edit) -> tuple[int, int]:
    """Start and end in the text of the number that an edit changes, or of a whole value without blanks around it.

    A place with a negative ``position`` is a whole value; a place without ``attribute`` is in the text of the element.
    """
    place = edit.place
    if place.attribute:
        match = _attribute(text, tag, place.attribute)
        if match is None:
            raise RobotFileError(f"the attribute {place.attribute!r} is not where it was. Load the file again.")
        start, end = match.start(2) + 1, match.end(2) - 1  # without the quotes
    else:
        start, end = tag.end, tag.content_end
    if place.position < 0:
        content = text[start:end]
        leading_blanks = len(content) - len(content.lstrip())
        return start + leading_blanks, end - _trailing_blanks(content)
    word_pattern = re.compile(r"\S+")
    words = list(word_pattern.finditer(text, start, end))
    if place.position >= len(words):
        raise RobotFileError(f"the attribute {place.attribute!r} has too few numbers. Load the file again.")
    return words[place.position].span()


def _comment(text: str, position: int, content: str) -> str:
    """Comment on a separate line with the element's indentation, or on the element's line if other text stands before it."""
    # XML allows no "--" in a comment.
    content = re.sub(r"-(?=-)", "- ", content).rstrip("-")
    comment = f"<!-- {content} -->"
    last_newline = max(text.rfind("\n", 0, position), text.rfind("\r", 0, position))  # -1 in the first line
    line_start = last_newline + 1
    indent = text[line_start:position]
    if indent.strip(" \t"):  # other text
        return comment
    newline = "\n"
    if line_start > 0:
        newline = text[line_start - 1 : line_start]
    if text[max(0, line_start - 2) : line_start] == "\r\n":
        newline = "\r\n"
    return f"{comment}{newline}{indent}"


FOUND = "identified from logs"
"""Reason of a change to an identified number."""
ELSEWHERE = "in none of the logs, or part of the link that carries it"
"""Reason of a change to zero."""


class TextChanges:
    """Changes to the text of a robot file; its comments begin with ``signature``."""

    def __init__(self, signature: str) -> None:
        self._signature = signature
        self._edits: dict[Place, tuple[Edit, str]] = {}
        self._additions: dict[int, str] = {}

    def set(self, element: Element, attribute: str, value: str, why: str = FOUND) -> None:
        """Set or add an attribute, or the element's text if ``attribute`` is empty. Equal numbers keep their spelling."""
        old_value = element.content
        if attribute:
            old_value = element.attributes.get(attribute, "")
        if _numbers_or_text(old_value) == _numbers_or_text(value):
            return
        if attribute:
            self._edit(element, attribute, value, why, "put")
        elif element.content.strip():
            self._edit(element, attribute, value, why, "change")
        else:
            self.add(element, value)

    def set_child(self, parent: Element, tag: str, text: str, why: str) -> None:
        """Set the text of a child, which may be missing."""
        child = parent.child(tag)
        if child is None:
            self.add(parent, f"<{tag}>{text}</{tag}>")
        else:
            self.set(child, "", text, why)

    def remove(self, element: Element, attribute: str, why: str = FOUND) -> None:
        """Remove an attribute."""
        self._edit(element, attribute, "", why, "remove")

    def add(self, element: Element, text: str) -> None:
        """Insert text at the beginning of an element, after earlier insertions."""
        element_number = self._check_own_file(element).index
        earlier_text = self._additions.get(element_number, "")
        self._additions[element_number] = earlier_text + text

    def apply(self, text: str) -> str:
        """Apply all changes to the file's text."""
        return apply_edits(text, list(self._edits.values()), additions=self._additions, signature=self._signature)

    def _edit(
        self, element: Element, attribute: str, value: str, why: str, how: Literal["change", "put", "remove"]
    ) -> None:
        """Store an edit of an attribute, or of the text if ``attribute`` is empty; it replaces an earlier one."""
        place = self._check_own_file(element).locate(attribute)
        self._edits[place] = (Edit(place, value, how), why)

    def _check_own_file(self, element: Element) -> Element:
        """Return ``element``; raise ModelError if it stands in an included file."""
        if element.file:
            raise ModelError(
                f"{element} stands in the included file {element.file!r}, and only the robot's own file is written. Put the "
                "included elements into it first."
            )
        return element


def _numbers_or_text(text: str) -> list[float] | str:
    """Numbers of a text, or the text itself if it has other content."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return text.strip()
