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

_WORD = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
_NUMBER = re.compile(_WORD)
_NUMBERS = re.compile(rf"{_WORD}(?:\s++{_WORD})*+")
_MAX_NUMBER = 1e60  # far above realistic values; products of five such numbers are still finite
_MIN_CHARACTERS_OF_LARGE = 60
"""Texts with fewer characters and no exponent cannot contain numbers above the limit."""
_NAMES = {"name", "reference"}
"""Attributes that distinguish elements of one tag; Gazebo elements reference a link or joint."""


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
    attribute: str = ""
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
        """Position for messages: ``line 12`` or ``common/parts.xml, line 12``; empty if not from a file."""
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
        while owner is not None and not _NAMES & owner.attributes.keys():
            owner = owner.parent
        name = None if owner is None else owner.attributes.get("name", owner.attributes.get("reference", ""))
        of = f" of {shorten(owner.tag)} {shorten(name)!r}" if owner is not None and name is not None else ""
        return f"<{shorten(self.tag)}>{of}{place}"

    def error(self, text: str) -> RobotFileError:
        """Error whose message begins with the element's name."""
        return RobotFileError(f"{self} {text}")

    def locate(self, attribute: str = "", position: int = -1) -> Place:
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
                    raise self._several(tag)
                child = element
        return child

    def _several(self, tag: str) -> RobotFileError:
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
        return self.values(attribute, 1)[0]  # with blanks around it, or raises an error

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
            raise RobotFileError(f'{self} has {attribute}="{shorten(text)}": {len(values)} numbers, expected {count}.')
        return values

    def floats(self, attribute: str, default: Sequence[float]) -> list[float]:
        """Attribute as finite numbers, at most as many as ``default``, which supplies missing ones."""
        if attribute not in self.attributes:
            return list(default)
        values = self._numbers(attribute, self.attributes[attribute].strip())
        if len(values) > len(default):
            raise RobotFileError(
                f'{self} has {attribute}="{shorten(self.attributes[attribute].strip())}": {len(values)} numbers, expected at '
                f"most {len(default)}."
            )
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
        """Copy of the element with other attributes."""
        return Element(self.tag, attributes, self.line, self.parent, self.children, self.file, self.content, self.index)

    def deep_copy(self) -> Element:
        """Copy of the element and its descendants, whose changes leave the original as it is."""
        copy = self.with_attributes(dict(self.attributes))
        copy.children = [child.deep_copy() for child in self.children]
        return copy

    def _numbers(self, attribute: str, text: str) -> list[float]:
        if _NUMBERS.fullmatch(text):
            values = list(map(float, text.split()))
            short = len(text) < _MIN_CHARACTERS_OF_LARGE and "e" not in text and "E" not in text
            if short or max(map(abs, values)) <= _MAX_NUMBER:
                return values
        return [self._number(attribute, word) for word in text.split()]  # raises an error for the invalid word

    def _number(self, attribute: str, word: str) -> float:
        value = float(word) if _NUMBER.fullmatch(word) else None
        if value is not None and abs(value) <= _MAX_NUMBER:
            return value
        shown = repr(shorten(word))
        if value is not None:
            problem = f"{shown} is too large to be meant. Write a finite number in SI units"
        elif word.lower().lstrip("+-").startswith(("nan", "inf")):
            problem = f"{shown} is not a finite number. Write a finite one, or leave the attribute out"
        elif "," in word:
            problem = f"{shown} is not a number. Write a decimal point, as in 0.5, and blanks between numbers"
        else:
            problem = f"{shown} is not a number. Write digits with one decimal point at most, as in 0.5 or -1.2e-3"
        raise RobotFileError(f'{self} has {attribute}="{shorten(self.attributes[attribute].strip())}": {problem}.')


BLANK = "\ufeff \t\r\n"
"""Characters allowed before the first element."""

_VERSION_ONE = re.compile(r"""<\?xml\s+version\s*=\s*(["'])1\1[^>]*\?>""")
"""XML declaration with version 1 in place of 1.0, as in some robot files."""

MOST_BODIES = 20_000
"""Default of ``max_bodies``, the largest number of links or bodies of a file."""

_BODIES = ("link", "body")
_PARTS = ("frame", "geom", "site")
"""Elements with a limit of at least MOST_BODIES, as a body may have many."""
_ELEMENTS = 50
"""Largest number of elements per allowed body."""

_WITHOUT_TEXT = ("robot", "mujoco", "mujocoinclude")
"""Root elements of formats that use only attributes; text is skipped, which saves time."""
_WITH_TEXT = ("gazebo", "gravity", "kinematic")
"""Elements with text in URDF: Gazebo's."""

_LEVELS = 1_000
"""Largest depth of elements, without nested bodies."""


class _Forbidden(Exception):
    """Declaration that is not allowed in robot files."""


class _TreeMaker:
    """Builder of a tree from parser events; ``skipped`` is the number of lines removed above the text."""

    def __init__(self, skipped: int, file: str, most: int) -> None:
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
        self.skipped, self.file, self.most = skipped, file, most
        self.counts: dict[str, int] = dict.fromkeys((*_BODIES, *_PARTS), 0)
        self.root: Element | None = None
        self._open: list[Element] = []
        self._count = 0

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        path = self._open
        parent = path[-1] if path else None
        line = self.parser.CurrentLineNumber + self.skipped
        element = Element(name, attributes, line, parent, (), self.file, "", self._count)
        self._count += 1
        if name in self.counts:
            self.counts[name] += 1
            most = self.most if name in _BODIES else max(self.most, MOST_BODIES)
            if self.counts[name] > most:
                kind = "bodies" if name in _BODIES else f"<{name}> elements"
                raise RobotFileError(
                    f"it has more than {most:,} {kind} ({element.place}). Raise the limit, max_bodies=, if that is meant."
                )
        elif name in _WITH_TEXT:
            self.parser.CharacterDataHandler = self._text
        if len(path) > self.most + _LEVELS:
            raise RobotFileError(
                f"its elements lie more than {self.most + _LEVELS:,} deep in each other ({element.place})."
            )
        if parent is None:
            self.root = element
            if name in _WITHOUT_TEXT:
                self.parser.CharacterDataHandler = None
        else:
            parent.add(element)
        path.append(element)

    def _end(self, _name: str) -> None:
        self._open.pop()

    def _text(self, text: str) -> None:
        if self._open and text and not text.isspace():
            self._open[-1].content += text

    def _entity(self, name: str, *_: Any) -> None:
        raise _Forbidden(f"line {self.parser.CurrentLineNumber + self.skipped}: it declares the entity {name!r}")

    def _doctype(self, _name: str, system: str | None, _public: str | None, _internal: bool) -> None:
        if system is not None:
            line = self.parser.CurrentLineNumber + self.skipped
            raise _Forbidden(f"line {line}: it points to another document, {system!r}")

    def parse(self, body: str) -> None:
        """Parse the text; raises :class:`~twistwrench.RobotFileError` with the line."""
        from xml.parsers.expat import ExpatError

        with third_party_errors(lambda reason: RobotFileError(f"it cannot be read as XML: {reason}.")):
            try:
                self.parser.Parse(body, True)
            except ExpatError as error:
                what = str(error).partition(":")[0]
                raise RobotFileError(
                    f"line {error.lineno + self.skipped}, column {error.offset}: it is not well-formed XML: {what}. "
                    "Correct that line; every element that opens must close."
                ) from None
            except _Forbidden as problem:
                raise RobotFileError(
                    f"{problem}, which is refused: entities can exhaust memory or read other files. Write the text out and "
                    "remove the <!DOCTYPE …>."
                ) from None


def without_loose_declaration(body: str) -> str:
    """Replace a declaration that newer versions of expat reject by blanks; positions are unchanged."""
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
            f"it is not XML: it begins with {body[:20]!r}, not with '<'. Pass a robot description, such as URDF."
        )
    skipped = text[: len(text) - len(body)].count("\n")
    body = without_loose_declaration(body)
    max_elements = _ELEMENTS * max(max_bodies, MOST_BODIES)
    count = body.count("<") - body.count("</")
    if count > max_elements:
        raise RobotFileError(
            f"it has about {count:,} elements; more than {max_elements:,} are refused. Raise the limit, max_bodies=, if that "
            "is meant."
        )
    maker = _TreeMaker(skipped, file, max_bodies)
    maker.parse(body)
    if maker.root is None:
        raise RobotFileError("it has no elements. A robot file begins with <robot name=…>.")
    return maker.root


_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def new(tag: str, parent: Element | None = None, text: str = "", /, **attributes: str) -> Element:
    """Create an element and append it to its parent's children."""
    element = Element(tag, attributes, 0, parent, content=text)
    if parent is not None:
        parent.add(element)
    return element


def figures(values: ArrayLike) -> str:
    """Numbers separated by blanks, with the fewest digits that give the same doubles; -0 becomes 0."""
    return " ".join(_figure(float(x)) for x in np.ravel(np.asarray(values, float)))


def exact(values: ArrayLike) -> str:
    """Numbers separated by blanks, exact to the last digit and the sign of zero."""
    return " ".join(repr(x) for x in np.ravel(np.asarray(values, float)).tolist())


def _figure(x: float) -> str:
    return str(int(x)) if x.is_integer() and abs(x) < 1e15 else repr(x)


def xml_text(root: Element) -> str:
    """XML document of an element. Raises :class:`~twistwrench.ModelError` for characters that XML does not allow."""
    from xml.sax.saxutils import escape, quoteattr  # slow: imports urllib and its SSL

    lines = ['<?xml version="1.0" encoding="utf-8"?>']
    stack: list[tuple[Element | None, str, int]] = [(root, "", 0)]  # a chain may be deeper than Python's stack
    while stack:
        element, closing, depth = stack.pop()
        pad = "  " * min(depth, 60)
        if element is None:
            lines.append(f"{pad}{closing}")
            continue
        attributes = "".join(f" {name}={quoteattr(value)}" for name, value in element.attributes.items())
        if element.children:
            lines.append(f"{pad}<{element.tag}{attributes}>")
            stack.append((None, f"</{element.tag}>", depth))
            stack.extend((child, "", depth + 1) for child in reversed(element.children))
        elif element.content:
            lines.append(f"{pad}<{element.tag}{attributes}>{escape(element.content)}</{element.tag}>")
        else:
            lines.append(f"{pad}<{element.tag}{attributes}/>")
    text = "\n".join(lines) + "\n"
    forbidden = _FORBIDDEN.search(text)
    if forbidden:
        line = text[: forbidden.start()].rpartition("\n")[2] + text[forbidden.start() :].partition("\n")[0]
        raise ModelError(
            f"no XML file can hold the character {forbidden[0]!r}, which is in {line.strip()[:100]!r}. Rename that."
        )
    return text
