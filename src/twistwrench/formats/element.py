"""XML elements that know their file and line, and the safe parser that makes them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.foreign_errors import foreign_errors
from ..errors import RobotFileError
from ..typing import Array

_WORD = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
_NUMBER = re.compile(_WORD)
_NUMBERS = re.compile(rf"{_WORD}(?:\s++{_WORD})*+")
_LARGEST = 1e60  # far above anything meant, and products of five such numbers are still finite
_SHORT = 60
"""Texts of fewer characters hold no number that is too large, unless by an exponent."""
_BLANK = "\ufeff \t\r\n"


MOST_BODIES = 20_000
"""Links or bodies that a file may have unless ``max_bodies`` says otherwise: more is a mistake, or meant to take all memory."""
_BODIES = ("link", "body")
_WITHOUT_TEXT = ("robot", "mujoco", "mujocoinclude")
"""Root elements of formats that say everything by attributes."""
_LEVELS = 1_000
"""Elements one inside the other, beside those of bodies in bodies."""


@dataclass(eq=False, slots=True)
class Element:
    """One element: its tag (prefix and all), attributes, line in the file, the elements in it, and its text."""

    tag: str
    attributes: dict[str, str]
    line: int
    parent: Element | None
    children: Sequence[Element] = ()
    """A list where there are any. Most elements have none, and a long file has too many empty lists to look after."""
    file: str = ""
    """The file it is from, where that is one that another includes."""
    content: str = ""
    """The text in it, as SDF has it."""

    @property
    def place(self) -> str:
        """``line 12``, or ``common/parts.xml, line 12``: where messages say it is."""
        return f"{self.file}, line {self.line}" if self.file else f"line {self.line}"

    def __str__(self) -> str:
        """``<mass> of link 'arm' (line 12)``: what messages call it."""
        owner = self.parent
        while owner is not None and "name" not in owner.attributes:
            owner = owner.parent
        if "name" in self.attributes:
            return f"<{self.tag} name={self.attributes['name']!r}> ({self.place})"
        of = f" of {owner.tag} {owner.attributes['name']!r}" if owner is not None else ""
        return f"<{self.tag}>{of} ({self.place})"

    def add(self, child: Element) -> None:
        """Append a child."""
        if isinstance(self.children, list):
            self.children.append(child)
        else:
            self.children = [*self.children, child]

    def walk(self) -> Iterator[Element]:
        """The element itself and all within, in document order."""
        stack = [self]
        while stack:
            element = stack.pop()
            yield element
            stack.extend(reversed(element.children))

    def all(self, tag: str) -> list[Element]:
        """The children with a tag."""
        return [child for child in self.children if child.tag == tag]

    def child(self, tag: str) -> Element | None:
        """The child with a tag, or None; an error if there are several, for then one cannot know which is meant."""
        found = None
        for element in self.children:
            if element.tag == tag:
                if found is not None:
                    raise self._several(tag)
                found = element
        return found

    def _several(self, tag: str) -> RobotFileError:
        found = self.all(tag)
        lines = ", ".join(str(element.line) for element in found)
        return RobotFileError(
            f"{self} has {len(found)} <{tag}> elements (lines {lines}); one is allowed. Remove the others."
        )

    def required(self, tag: str, example: str) -> Element:
        """The child with a tag; an error that shows ``example`` if there is none."""
        found = self.child(tag)
        if found is None:
            raise RobotFileError(f"{self} has no <{tag}>. Add one, such as {example}.")
        return found

    def text(self, attribute: str) -> str:
        """An attribute's text, blanks at its ends removed; an error if it is absent or empty."""
        value = self.attributes.get(attribute, "").strip()
        if not value:
            raise RobotFileError(f'{self} needs the attribute {attribute}="…", which is absent or empty.')
        return value

    def number(self, attribute: str) -> float:
        """An attribute as one finite number; an error if it is absent or anything else."""
        text = self.attributes.get(attribute, "")
        if _NUMBER.fullmatch(text) and abs(x := float(text)) <= _LARGEST:
            return x
        return self.values(attribute, 1)[0]  # with blanks around it, or it says what is wrong

    def optional_number(self, attribute: str) -> float | None:
        """An attribute as one finite number; None if it is absent."""
        return self.number(attribute) if attribute in self.attributes else None

    def numbers(self, attribute: str, count: int) -> Array:
        """An attribute as ``count`` finite numbers (count,), separated by blanks."""
        return np.array(self.values(attribute, count))

    def values(self, attribute: str, count: int) -> list[float]:
        """The same as a list."""
        text = self.text(attribute)
        values = self._numbers(attribute, text)
        if len(values) != count:
            raise RobotFileError(f'{self} has {attribute}="{text}": {len(values)} numbers, expected {count}.')
        return values

    def floats(self, attribute: str, default: Sequence[float]) -> list[float]:
        """An attribute as finite numbers, as many as ``default`` at most; those left out are the default's."""
        if attribute not in self.attributes:
            return list(default)
        values = self._numbers(attribute, self.attributes[attribute].strip())
        if len(values) > len(default):
            raise RobotFileError(
                f'{self} has {attribute}="{self.attributes[attribute].strip()}": {len(values)} numbers, expected at most '
                f"{len(default)}."
            )
        return values + list(default[len(values) :])

    def word(self, attribute: str, choices: Sequence[str], default: str) -> str:
        """An attribute that is one of some words."""
        value = self.attributes.get(attribute, default).strip()
        if value not in choices:
            raise RobotFileError(f'{self} has {attribute}="{value}". Allowed: {", ".join(choices)}.')
        return value

    def flag(self, attribute: str, *, default: bool) -> bool:
        """An attribute that is ``true`` or ``false``."""
        return self.word(attribute, ("true", "false"), "true" if default else "false") == "true"

    def with_attributes(self, attributes: dict[str, str]) -> Element:
        """The same element with other attributes."""
        return Element(self.tag, attributes, self.line, self.parent, self.children, self.file, self.content)

    def _numbers(self, attribute: str, text: str) -> list[float]:
        if _NUMBERS.fullmatch(text):
            values = list(map(float, text.split()))
            short = len(text) < _SHORT and "e" not in text and "E" not in text
            if short or max(map(abs, values)) <= _LARGEST:
                return values
        return [self._number(attribute, word) for word in text.split()]  # which says what is wrong

    def _number(self, attribute: str, word: str) -> float:
        value = float(word) if _NUMBER.fullmatch(word) else None
        if value is not None and abs(value) <= _LARGEST:
            return value
        if value is not None:
            problem = f"{word!r} is too large to be meant. Write a finite number in SI units"
        elif word.lower().lstrip("+-").startswith(("nan", "inf")):
            problem = f"{word!r} is not a finite number. Write a finite one, or leave the attribute out"
        elif "," in word:
            problem = f"{word!r} is not a number. Write a decimal point, as in 0.5, and blanks between numbers"
        else:
            problem = f"{word!r} is not a number. Write digits with one decimal point at most, as in 0.5 or -1.2e-3"
        raise RobotFileError(f'{self} has {attribute}="{self.attributes[attribute].strip()}": {problem}.')


class _Forbidden(Exception):
    """A declaration a robot file has no need of; its text says which."""


class _Watcher:
    """Counts the bodies that the parser meets; ``skipped`` lines were removed above what it sees."""

    def __init__(self, skipped: int, file: str, most: int) -> None:
        from xml.parsers import expat

        # Without namespaces: an undeclared prefix somewhere inside a plugin's settings is no reason to refuse a robot.
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        # Entities are how XML exhausts memory and reads other files; expat fetches nothing unless told how.
        self.parser.EntityDeclHandler = self._entity
        self.parser.UnparsedEntityDeclHandler = self._entity
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.skipped, self.file, self.most, self.bodies = skipped, file, most, 0

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if name in _BODIES:
            self.bodies += 1
            if self.bodies > self.most:
                place = self._made(name, attributes, None).place
                raise RobotFileError(
                    f"it has more than {self.most:,} bodies ({place}). Raise the limit, max_bodies=, if that is meant."
                )

    def _made(self, name: str, attributes: dict[str, str], parent: Element | None) -> Element:
        return Element(name, attributes, self.parser.CurrentLineNumber + self.skipped, parent, (), self.file)

    def _entity(self, name: str, *_: Any) -> None:
        raise _Forbidden(f"line {self.parser.CurrentLineNumber + self.skipped}: it declares the entity {name!r}")

    def _doctype(self, _name: str, system: str | None, _public: str | None, _internal: bool) -> None:
        if system is not None:
            line = self.parser.CurrentLineNumber + self.skipped
            raise _Forbidden(f"line {line}: it points to another document, {system!r}")

    def watch(self, body: str) -> None:
        """Go through the text; raises :class:`~twistwrench.RobotFileError` with the line."""
        from xml.parsers.expat import ExpatError

        with foreign_errors(lambda reason: RobotFileError(f"it cannot be read as XML: {reason}.")):
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


class _TreeMaker(_Watcher):
    """Collects the parser's events into a tree of elements."""

    def __init__(self, skipped: int, file: str, most: int) -> None:
        super().__init__(skipped, file, most)
        self.parser.buffer_text = True
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self.root: Element | None = None
        self._open: list[Element] = []

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if name in _BODIES:
            super()._start(name, attributes)
        path = self._open
        parent = path[-1] if path else None
        element = self._made(name, attributes, parent)
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


def parse(text: str, file: str = "", max_bodies: int = MOST_BODIES) -> Element:
    """The root element of an XML text. Blank lines before its declaration are forgiven, as most robot tools do.

    ``file`` is named in messages. More links or bodies than ``max_bodies`` are refused before the tree is built.

    Entities, and whatever would be fetched from elsewhere, are refused: a robot file may come from anywhere.
    Raises :class:`~twistwrench.RobotFileError` with the line.
    """
    body = text.lstrip(_BLANK)
    if not body:
        raise RobotFileError("it is empty. A robot file begins with <robot name=…>.")
    if not body.startswith("<"):
        raise RobotFileError(
            f"it is not XML: it begins with {body[:20]!r}, not with '<'. Pass a robot description, such as URDF."
        )
    skipped = text[: len(text) - len(body)].count("\n")
    if sum(body.count(f"<{tag}") for tag in _BODIES) > max_bodies:  # comments counted, so it is worth a closer look
        _Watcher(skipped, file, max_bodies).watch(body)
    maker = _TreeMaker(skipped, file, max_bodies)
    maker.watch(body)
    if maker.root is None:
        raise RobotFileError("it has no elements. A robot file begins with <robot name=…>.")
    return maker.root
