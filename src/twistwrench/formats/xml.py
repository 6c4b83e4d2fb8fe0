"""Safe parser of XML text into elements, and exact XML text of elements."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.third_party import third_party_errors
from ..errors import ModelError, RobotFileError
from .element import Element

BLANK = "\ufeff \t\r\n"
"""Characters allowed before the first element."""

_VERSION_ONE = re.compile(r"""<\?xml\s+version\s*=\s*(["'])1\1[^>]*\?>""")
"""A declaration of version 1 in place of 1.0, as some robot files have it."""

MOST_BODIES = 20_000
"""Default of ``max_bodies``, the largest number of links or bodies of a file."""

_BODIES = ("link", "body")
_PARTS = ("frame", "geom", "site")
"""Elements counted against at least MOST_BODIES, as a body may have many."""
_ELEMENTS = 50
"""Elements that a file may have for each body that it may have."""

_WITHOUT_TEXT = ("robot", "mujoco", "mujocoinclude")
"""Root elements of formats that use attributes only; their text is skipped, which saves time."""
_WITH_TEXT = ("gazebo", "gravity", "kinematic")
"""Elements with text in URDF: Gazebo's."""

_LEVELS = 1_000
"""Largest depth of elements, beside nested bodies."""


class _Forbidden(Exception):
    """Declaration that is refused in robot files."""


class _TreeMaker:
    """Collects the parser's events into a tree; ``skipped`` lines were removed above the text."""

    def __init__(self, skipped: int, file: str, most: int) -> None:
        from xml.parsers import expat

        # Without namespaces: an undeclared prefix somewhere inside a plugin's settings does not refuse a robot.
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        # Entities are how XML exhausts memory and reads other files; expat fetches nothing unless told how.
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
    """Text with blanks for a declaration that newer versions of expat refuse; positions stay.

    >>> without_loose_declaration('<?xml version="1"?><robot/>').strip()
    '<robot/>'
    """
    return (
        _VERSION_ONE.sub(lambda found: re.sub(r"\S", " ", found[0]), body, count=1)
        if body.startswith("<?xml")
        else body
    )


def parse(text: str, file: str = "", max_bodies: int = MOST_BODIES) -> Element:
    """The root element of an XML text. Blank lines before its declaration are accepted.

    ``file`` is named in messages. More links or bodies than ``max_bodies`` are refused at the first that is too many.

    Entities, and whatever would be fetched from elsewhere, are refused: a robot file may come from anywhere.
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
    most = _ELEMENTS * max(max_bodies, MOST_BODIES)
    if (count := body.count("<") - body.count("</")) > most:
        raise RobotFileError(
            f"it has about {count:,} elements; more than {most:,} are refused. Raise the limit, max_bodies=, if that is meant."
        )
    maker = _TreeMaker(skipped, file, max_bodies)
    maker.parse(body)
    if maker.root is None:
        raise RobotFileError("it has no elements. A robot file begins with <robot name=…>.")
    return maker.root


# ── XML text of elements: two blanks a level, numbers exact to the bit

_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def new(tag: str, parent: Element | None = None, text: str = "", /, **attributes: str) -> Element:
    """A new element, appended to its parent's children."""
    element = Element(tag, attributes, 0, parent, content=text)
    if parent is not None:
        parent.add(element)
    return element


def figures(values: ArrayLike) -> str:
    """Numbers with blanks between, the fewest digits that are the same doubles; no minus before a zero.

    >>> figures([1, -0.0, 0.1, 1e-9])
    '1 0 0.1 1e-09'
    """
    return " ".join(_figure(float(x)) for x in np.ravel(np.asarray(values, float)))


def _figure(x: float) -> str:
    return str(int(x)) if x.is_integer() and abs(x) < 1e15 else repr(x)


def xml_text(root: Element) -> str:
    """The document of an element. Raises :class:`~twistwrench.ModelError` for characters that are not allowed in one."""
    from xml.sax.saxutils import escape, quoteattr  # imports urllib, whose SSL takes longer than a robot file

    lines = ['<?xml version="1.0" encoding="utf-8"?>']
    stack: list[tuple[Element | None, str, int]] = [(root, "", 0)]  # a chain may be longer than Python's stack is deep
    while stack:
        element, closing, depth = stack.pop()
        pad = "  " * min(depth, 60)
        if element is None:
            lines.append(f"{pad}{closing}")
            continue
        said = "".join(f" {name}={quoteattr(value)}" for name, value in element.attributes.items())
        if element.children:
            lines.append(f"{pad}<{element.tag}{said}>")
            stack.append((None, f"</{element.tag}>", depth))
            stack.extend((child, "", depth + 1) for child in reversed(element.children))
        elif element.content:
            lines.append(f"{pad}<{element.tag}{said}>{escape(element.content)}</{element.tag}>")
        else:
            lines.append(f"{pad}<{element.tag}{said}/>")
    text = "\n".join(lines) + "\n"
    if bad := _FORBIDDEN.search(text):
        line = text[: bad.start()].rpartition("\n")[2] + text[bad.start() :].partition("\n")[0]
        raise ModelError(
            f"no XML file can hold the character {bad[0]!r}, which is in {line.strip()[:100]!r}. Rename that."
        )
    return text
