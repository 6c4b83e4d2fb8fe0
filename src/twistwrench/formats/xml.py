"""XML elements with file and line, a safe XML parser, and exact serialisation."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import ModelError, RobotFileError
from ..core.text import listed, shorten
from ..core.third_party import third_party_errors
from ..core.typing import Array

_NUMBER_PATTERN = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
"""Decimal number; possessive quantifiers, so that a long text that does not match fails at once."""
_NUMBER = re.compile(_NUMBER_PATTERN)
_NUMBERS = re.compile(rf"{_NUMBER_PATTERN}(?:\s++{_NUMBER_PATTERN})*+")
_MAX_NUMBER = 1e60
"""Largest number in a file: far above realistic values, and products of five such numbers are still finite."""
_MIN_LENGTH_OF_LARGE = 60
"""Number of characters below which a text without exponents cannot contain a number above ``_MAX_NUMBER``."""
_NAMING_ATTRIBUTES = {"name", "reference"}
"""Attributes that name an element in messages; elements of Gazebo name their link or joint as ``reference``."""


CONTENT = ""
"""Name in place of an attribute's for the text within an element; no attribute has it."""


@dataclass(frozen=True)
class Place:
    """Position of a number in a robot file.

    Attributes
    ----------
    element : int, number of the element in document order
    attribute : str; if empty, the text within the element
    position : int, index among several numbers; -1 for the whole value
    """

    element: int
    attribute: str = CONTENT
    position: int = -1


@dataclass(eq=False, slots=True)
class Element:
    """XML element with tag (including prefix), attributes, line, children and text."""

    tag: str
    attributes: dict[str, str]
    line: int
    parent: Element | None
    children: Sequence[Element] = ()
    """List if there are children; otherwise a tuple, to save memory."""
    file: str = ""
    """Name of the included file, else empty."""
    content: str = ""
    """Text of the element."""
    index: int = -1
    """Position in the document order of its file."""

    @property
    def place(self) -> str:
        """Line for messages, ``line 12`` or ``common/parts.xml, line 12``; empty if the element is not from a file."""
        if self.file:
            return f"{self.file}, line {self.line}"
        return f"line {self.line}" if self.line else ""

    def children_in(self, tag: str) -> list[Element]:
        """Children of all children with a tag, such as the actuators of all sections ``<actuator>``."""
        return [child for section in self.children if section.tag == tag for child in section.children]

    def __str__(self) -> str:
        """Name for messages: ``<mass> of link 'arm' (line 12)``."""
        place = f" ({self.place})" if self.place else ""
        if "name" in self.attributes:
            return f"<{shorten(self.tag)} name={shorten(self.attributes['name'])!r}>{place}"
        owner = self.parent
        while owner is not None and not _NAMING_ATTRIBUTES & owner.attributes.keys():
            owner = owner.parent
        of_owner = ""
        if owner is not None:
            owner_name = owner.attributes.get("name", owner.attributes.get("reference", ""))
            of_owner = f" of {shorten(owner.tag)} {shorten(owner_name)!r}"
        return f"<{shorten(self.tag)}>{of_owner}{place}"

    def error(self, text: str) -> RobotFileError:
        """Error whose message begins with the element's name."""
        return RobotFileError(f"{self} {text}")

    def locate(self, attribute: str = CONTENT, position: int = -1) -> Place:
        """Place of an attribute, of one of its numbers, or of the text."""
        return Place(self.index, attribute, position)

    def add(self, child: Element) -> None:
        """Append a child."""
        if isinstance(self.children, list):
            self.children.append(child)
        else:
            self.children = [*self.children, child]

    def walk(self) -> Iterator[Element]:
        """Iterate over the element and its descendants, in document order."""
        stack: list[Element] = [self]
        while stack:
            element = stack.pop()
            yield element
            stack.extend(reversed(element.children))

    def all(self, tag: str) -> list[Element]:
        """Children with a tag."""
        return [child for child in self.children if child.tag == tag]

    def child(self, tag: str) -> Element | None:
        """Child with a tag, or None; raises if there are several."""
        child = None
        for element in self.children:
            if element.tag == tag:
                if child is not None:
                    raise self._error_for_several(tag)
                child = element
        return child

    def _error_for_several(self, tag: str) -> RobotFileError:
        """Error for several children with a tag of which one is allowed."""
        children = self.all(tag)
        lines = listed(element.line for element in children)
        return self.error(f"has {len(children)} <{tag}> elements (lines {lines}); one is allowed. Remove the others.")

    def require_child(self, tag: str, example: str) -> Element:
        """Child with a tag; raises an error with ``example`` if there is none."""
        child = self.child(tag)
        if child is None:
            raise self.error(f"has no <{tag}>. Add one, such as {example}.")
        return child

    def text(self, attribute: str) -> str:
        """Text of an attribute without leading and trailing blanks; raises if it is absent or empty."""
        value = self.attributes.get(attribute, "").strip()
        if not value and attribute == CONTENT:
            raise self.error("is empty. Write its value, or leave the element out.")
        if not value:
            raise RobotFileError(f'{self} needs the attribute {attribute}="…", which is absent or empty.')
        return value

    def number(self, attribute: str) -> float:
        """Attribute as a finite number; raises if it is absent or invalid."""
        text = self.attributes.get(attribute, "")
        if _NUMBER.fullmatch(text):
            number = float(text)
            if abs(number) <= _MAX_NUMBER:
                return number
        return self.values(attribute, 1)[0]  # accepts blanks around the number; raises the error of an invalid one

    def optional_number(self, attribute: str) -> float | None:
        """Attribute as a finite number; None if absent."""
        return self.number(attribute) if attribute in self.attributes else None

    def numbers(self, attribute: str, count: int) -> Array:
        """Attribute as ``count`` finite numbers (count,), separated by blanks."""
        return np.array(self.values(attribute, count))

    def values(self, attribute: str, count: int) -> list[float]:
        """Attribute as a list of ``count`` finite numbers."""
        text = self.text(attribute)
        values = self._numbers(attribute, text)
        if len(values) != count:
            raise self.error(f"has {self._quoted(attribute)}: {len(values)} numbers, expected {count}.")
        return values

    def floats(self, attribute: str, default: Sequence[float]) -> list[float]:
        """Attribute as finite numbers, at most as many as in ``default``, whose last entries replace missing ones."""
        if attribute not in self.attributes:
            return list(default)
        values = self._numbers(attribute, self.attributes[attribute].strip())
        if len(values) > len(default):
            raise self.error(f"has {self._quoted(attribute)}: {len(values)} numbers, expected at most {len(default)}.")
        return values + list(default[len(values) :])

    def word(self, attribute: str, choices: Sequence[str], default: str) -> str:
        """Attribute with one of the values ``choices``."""
        value = self.attributes.get(attribute, default).strip()
        if value not in choices:
            raise RobotFileError(f'{self} has {attribute}="{shorten(value)}". Allowed: {", ".join(choices)}.')
        return value

    def flag(self, attribute: str, *, default: bool) -> bool:
        """Boolean attribute, ``true`` or ``false``."""
        return self.word(attribute, ("true", "false"), "true" if default else "false") == "true"

    def with_attributes(self, attributes: dict[str, str]) -> Element:
        """Copy of the element with other attributes; its children are the same objects."""
        return Element(self.tag, attributes, self.line, self.parent, self.children, self.file, self.content, self.index)

    def deep_copy(self) -> Element:
        """Copy of the element and all its descendants; changes of the copy do not change the original."""
        copy = self.with_attributes(dict(self.attributes))
        copy.children = [child.deep_copy() for child in self.children]
        return copy

    def _numbers(self, attribute: str, text: str) -> list[float]:
        """Finite numbers of an attribute's text, separated by blanks."""
        if _NUMBERS.fullmatch(text):
            values = list(map(float, text.split()))
            surely_small = len(text) < _MIN_LENGTH_OF_LARGE and "e" not in text and "E" not in text
            if surely_small or max(map(abs, values)) <= _MAX_NUMBER:
                return values
        return [self._parse_number(attribute, word) for word in text.split()]  # raises an error for the invalid word

    def _parse_number(self, attribute: str, word: str) -> float:
        """Finite number of one word of an attribute; raises an error with the reason if it is not one."""
        value = None
        if _NUMBER.fullmatch(word):
            value = float(word)
        if value is not None and abs(value) <= _MAX_NUMBER:
            return value
        quoted_word = repr(shorten(word))
        if value is not None:
            problem = f"{quoted_word} is too large to be meant. Write a finite number in SI units"
        elif word.lower().lstrip("+-").startswith(("nan", "inf")):
            what = "attribute" if attribute != CONTENT else "element"
            problem = f"{quoted_word} is not a finite number. Write a finite one, or leave the {what} out"
        elif "," in word:
            problem = f"{quoted_word} is not a number. Write a decimal point, as in 0.5, and blanks between numbers"
        else:
            problem = (
                f"{quoted_word} is not a number. Write digits with one decimal point at most, as in 0.5 or -1.2e-3"
            )
        raise self.error(f"has {self._quoted(attribute)}: {problem}.")

    def _quoted(self, attribute: str) -> str:
        """Attribute with its text as in the file, or the text alone if it is the element's, for messages."""
        text = shorten(self.attributes[attribute].strip())
        if attribute == CONTENT:
            return f'the text "{text}"'
        return f'{attribute}="{text}"'


BLANK = "\ufeff \t\r\n"
"""Characters allowed before the first element."""

_QUOTED_BEGINNING = 20
"""Number of characters of a file's beginning in a message."""
_VERSION_ONE = re.compile(r"""<\?xml\s+version\s*=\s*(["'])1\1[^>]*\?>""")
"""XML declaration of version "1" instead of "1.0", as in some robot files."""

MOST_BODIES = 20_000
"""Default of ``max_bodies``, the largest number of links or bodies of a file."""

_BODY_TAGS = ("link", "body")
"""Elements of which at most ``max_bodies`` are allowed."""
_BODY_PART_TAGS = ("frame", "geom", "site")
"""Elements of which at least MOST_BODIES are allowed, even if ``max_bodies`` is smaller: a body may have many."""
_MAX_ELEMENTS_PER_BODY = 50
"""Largest number of elements of a file for each body that is allowed."""

_ROOTS_WITHOUT_TEXT = ("robot", "mujoco", "mujocoinclude")
"""Root elements of formats that use only attributes. Text below them is skipped to save time."""
_TAGS_WITH_TEXT = ("gazebo", "gravity", "kinematic")
"""Elements of Gazebo in URDF, which have text: from the first of them on, text is no longer skipped."""

_MAX_DEPTH_WITHOUT_BODIES = 1_000
"""Largest depth of nested elements, not counting nested bodies."""


class _ForbiddenDeclaration(Exception):
    """Declaration that is not allowed in robot files."""


class _TreeMaker:
    """Builder of a tree from parser events.

    ``skipped_lines`` is the number of blank lines that were removed above the text.
    """

    def __init__(self, skipped_lines: int, file: str, max_bodies: int) -> None:
        from xml.parsers import expat

        # Without namespaces, so that an undeclared prefix in a plugin's settings is accepted.
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        # Entities can exhaust memory and read other files; expat fetches nothing by default.
        self.parser.EntityDeclHandler = self._entity
        self.parser.UnparsedEntityDeclHandler = self._entity
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.skipped_lines = skipped_lines
        self.file = file
        self.max_bodies = max_bodies
        self.counts: dict[str, int] = dict.fromkeys((*_BODY_TAGS, *_BODY_PART_TAGS), 0)  # elements so far, by tag
        self.root: Element | None = None
        self._open_elements: list[Element] = []
        """Elements that have begun and not ended, from the root down."""
        self._element_count = 0

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        """Begin an element; raises for too many bodies and too deep nesting."""
        open_elements = self._open_elements
        parent = open_elements[-1] if open_elements else None
        line = self.parser.CurrentLineNumber + self.skipped_lines
        element = Element(name, attributes, line, parent, (), self.file, "", self._element_count)
        self._element_count += 1
        if name in self.counts:
            self.counts[name] += 1
            if name in _BODY_TAGS:
                kind = "bodies"
                max_count = self.max_bodies
            else:
                kind = f"<{name}> elements"
                max_count = max(self.max_bodies, MOST_BODIES)
            if self.counts[name] > max_count:
                raise RobotFileError(
                    f"it has more than {max_count:,} {kind} ({element.place}). Raise the limit, max_bodies=, if that is meant."
                )
        elif name in _TAGS_WITH_TEXT:
            self.parser.CharacterDataHandler = self._text
        max_depth = self.max_bodies + _MAX_DEPTH_WITHOUT_BODIES
        if len(open_elements) > max_depth:
            raise RobotFileError(f"its elements lie more than {max_depth:,} deep in each other ({element.place}).")
        if parent is None:
            self.root = element
            if name in _ROOTS_WITHOUT_TEXT:
                self.parser.CharacterDataHandler = None
        else:
            parent.add(element)
        open_elements.append(element)

    def _end(self, _name: str) -> None:
        self._open_elements.pop()

    def _text(self, text: str) -> None:
        if self._open_elements and text and not text.isspace():
            self._open_elements[-1].content += text

    def _entity(self, name: str, *_: Any) -> None:
        """Refuse the declaration of an entity."""
        line = self.parser.CurrentLineNumber + self.skipped_lines
        raise _ForbiddenDeclaration(f"line {line}: it declares the entity {name!r}")

    def _doctype(self, _name: str, system: str | None, _public: str | None, _internal: bool) -> None:
        """Refuse a document type from another document."""
        if system is not None:
            line = self.parser.CurrentLineNumber + self.skipped_lines
            raise _ForbiddenDeclaration(f"line {line}: it points to another document, {system!r}")

    def parse(self, text: str) -> None:
        """Parse the text; raises :class:`~twistwrench.RobotFileError` with the line."""
        from xml.parsers.expat import ExpatError

        with third_party_errors(lambda reason: RobotFileError(f"it cannot be read as XML: {reason}.")):
            try:
                self.parser.Parse(text, True)
            except ExpatError as error:
                problem, _, _ = str(error).partition(":")  # without expat's line and column
                raise RobotFileError(
                    f"line {error.lineno + self.skipped_lines}, column {error.offset}: it is not well-formed XML: {problem}. "
                    "Correct that line; every element that opens must close."
                ) from None
            except _ForbiddenDeclaration as declaration:
                raise RobotFileError(
                    f"{declaration}, which is refused: entities can exhaust memory or read other files. Write the text out and "
                    "remove the <!DOCTYPE …>."
                ) from None


def without_loose_declaration(body: str) -> str:
    """Replace a declaration of version "1", which newer versions of expat reject, by blanks. Columns stay the same."""
    if not body.startswith("<?xml"):
        return body
    return _VERSION_ONE.sub(lambda declaration: re.sub(r"\S", " ", declaration[0]), body, count=1)


def parse(text: str, file: str = "", max_bodies: int = MOST_BODIES) -> Element:
    """Parse an XML text and return the root element. Blank lines before the declaration are accepted.

    Messages name ``file``. If there are more links or bodies than ``max_bodies``, the error names the first excess one.

    Entities and external references are rejected, as a robot file may come from an untrusted source.
    Raises :class:`~twistwrench.RobotFileError` with the line.
    """
    body = text.lstrip(BLANK)
    if not body:
        raise RobotFileError("it is empty. A robot file begins with <robot name=…>.")
    if not body.startswith("<"):
        raise RobotFileError(
            f"it is not XML: it begins with {body[:_QUOTED_BEGINNING]!r}, not with '<'. Pass a robot description, such as URDF."
        )
    blanks = text[: len(text) - len(body)]
    skipped_lines = blanks.count("\n")
    body = without_loose_declaration(body)
    max_elements = _MAX_ELEMENTS_PER_BODY * max(max_bodies, MOST_BODIES)
    element_count = body.count("<") - body.count("</")  # about: comments count too
    if element_count > max_elements:
        raise RobotFileError(
            f"it has about {element_count:,} elements; more than {max_elements:,} are refused. Raise the limit, max_bodies=, "
            "if that is meant."
        )
    maker = _TreeMaker(skipped_lines, file, max_bodies)
    maker.parse(body)
    if maker.root is None:
        raise RobotFileError("it has no elements. A robot file begins with <robot name=…>.")
    return maker.root


_CHARACTER_NOT_ALLOWED = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
_MAX_INDENT_DEPTH = 60
"""Depth of an element beyond which its line is not indented further."""
_MAX_QUOTE_LENGTH = 100
"""Number of characters of a line in a message."""


def new(tag: str, parent: Element | None = None, text: str = "", /, **attributes: str) -> Element:
    """Create an element and append it to its parent's children."""
    element = Element(tag, attributes, 0, parent, content=text)
    if parent is not None:
        parent.add(element)
    return element


def figures(values: ArrayLike) -> str:
    """Numbers separated by blanks, with the fewest digits that give the same doubles; -0 becomes 0."""
    return " ".join(_figure(float(number)) for number in np.ravel(np.asarray(values, float)))


def exact(values: ArrayLike) -> str:
    """Numbers separated by blanks, exact to the last digit and the sign of zero."""
    return " ".join(repr(number) for number in np.ravel(np.asarray(values, float)).tolist())


def _figure(number: float) -> str:
    """Number with the fewest digits that give the same double."""
    if number.is_integer() and abs(number) < 1e15:  # 1e15 and more are shorter with an exponent
        return str(int(number))
    return repr(number)


def xml_text(root: Element) -> str:
    """XML document of an element. Raises :class:`~twistwrench.ModelError` for characters that XML does not allow."""
    from xml.sax.saxutils import escape, quoteattr  # slow: imports urllib and its SSL

    lines = ['<?xml version="1.0" encoding="utf-8"?>']
    # No recursion, as elements may be nested deeper than Python's stack. A closing tag waits as (None, tag, depth).
    stack: list[tuple[Element | None, str, int]] = [(root, "", 0)]
    while stack:
        element, closing_tag, depth = stack.pop()
        indent = "  " * min(depth, _MAX_INDENT_DEPTH)
        if element is None:
            lines.append(f"{indent}{closing_tag}")
            continue
        attributes = "".join(f" {name}={quoteattr(value)}" for name, value in element.attributes.items())
        if element.children:
            lines.append(f"{indent}<{element.tag}{attributes}>")
            stack.append((None, f"</{element.tag}>", depth))
            stack.extend((child, "", depth + 1) for child in reversed(element.children))
        elif element.content:
            lines.append(f"{indent}<{element.tag}{attributes}>{escape(element.content)}</{element.tag}>")
        else:
            lines.append(f"{indent}<{element.tag}{attributes}/>")
    text = "\n".join(lines) + "\n"
    forbidden = _CHARACTER_NOT_ALLOWED.search(text)
    if forbidden:
        _, _, line_before = text[: forbidden.start()].rpartition("\n")
        line_after, _, _ = text[forbidden.start() :].partition("\n")
        line = (line_before + line_after).strip()
        raise ModelError(
            f"no XML file can hold the character {forbidden[0]!r}, which is in {line[:_MAX_QUOTE_LENGTH]!r}. Rename that."
        )
    return text
