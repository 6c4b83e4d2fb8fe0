"""XML elements with their file and line."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.text import clipped
from ..errors import RobotFileError
from ..typing import Array

_WORD = r"[+-]?(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
_NUMBER = re.compile(_WORD)
_NUMBERS = re.compile(rf"{_WORD}(?:\s++{_WORD})*+")
_LARGEST = 1e60  # far above anything meant, and products of five such numbers are still finite
_SHORT = 60
"""Texts of fewer characters without an exponent have no number that is too large."""


_NAMES = {"name", "reference"}
"""Attributes that distinguish elements of one tag; Gazebo's refer to a link or joint."""


@dataclass(frozen=True)
class Place:
    """Position of a number in a robot file.

    Attributes
    ----------
    element : int, number of the element in document order
    attribute : str; empty: the text within the element
    position : int, which of several numbers; -1: all there is
    """

    element: int
    attribute: str = ""
    position: int = -1


@dataclass(eq=False, slots=True)
class Element:
    """XML element with its tag (prefix included), attributes, line, children and text."""

    tag: str
    attributes: dict[str, str]
    line: int
    parent: Element | None
    children: Sequence[Element] = ()
    """A list if there are any; a tuple otherwise, to save memory."""
    file: str = ""
    """File name if another file includes it, else empty."""
    content: str = ""
    """Text of the element."""
    index: int = -1
    """Position in the document order of its own file."""

    @property
    def place(self) -> str:
        """Position in messages: ``line 12`` or ``common/parts.xml, line 12``."""
        return f"{self.file}, line {self.line}" if self.file else f"line {self.line}"

    def __str__(self) -> str:
        """Name in messages: ``<mass> of link 'arm' (line 12)``."""
        if "name" in self.attributes:
            return f"<{clipped(self.tag)} name={clipped(self.attributes['name'])!r}> ({self.place})"
        owner = self.parent
        while owner is not None and not _NAMES & owner.attributes.keys():
            owner = owner.parent
        name = None if owner is None else owner.attributes.get("name", owner.attributes.get("reference", ""))
        of = f" of {clipped(owner.tag)} {clipped(name)!r}" if owner is not None and name is not None else ""
        return f"<{clipped(self.tag)}>{of} ({self.place})"

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
        """The child with a tag, or None; an error if there are several."""
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
        """An attribute as a list of ``count`` finite numbers."""
        text = self.text(attribute)
        values = self._numbers(attribute, text)
        if len(values) != count:
            raise RobotFileError(f'{self} has {attribute}="{clipped(text)}": {len(values)} numbers, expected {count}.')
        return values

    def floats(self, attribute: str, default: Sequence[float]) -> list[float]:
        """An attribute as finite numbers, as many as ``default`` at most; those left out are the default's."""
        if attribute not in self.attributes:
            return list(default)
        values = self._numbers(attribute, self.attributes[attribute].strip())
        if len(values) > len(default):
            raise RobotFileError(
                f'{self} has {attribute}="{clipped(self.attributes[attribute].strip())}": {len(values)} numbers, expected at '
                f"most {len(default)}."
            )
        return values + list(default[len(values) :])

    def word(self, attribute: str, choices: Sequence[str], default: str) -> str:
        """An attribute that is one of ``choices``."""
        value = self.attributes.get(attribute, default).strip()
        if value not in choices:
            raise RobotFileError(f'{self} has {attribute}="{clipped(value)}". Allowed: {", ".join(choices)}.')
        return value

    def flag(self, attribute: str, *, default: bool) -> bool:
        """An attribute that is ``true`` or ``false``."""
        return self.word(attribute, ("true", "false"), "true" if default else "false") == "true"

    def with_attributes(self, attributes: dict[str, str]) -> Element:
        """The same element with other attributes."""
        return Element(self.tag, attributes, self.line, self.parent, self.children, self.file, self.content, self.index)

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
        shown = repr(clipped(word))
        if value is not None:
            problem = f"{shown} is too large to be meant. Write a finite number in SI units"
        elif word.lower().lstrip("+-").startswith(("nan", "inf")):
            problem = f"{shown} is not a finite number. Write a finite one, or leave the attribute out"
        elif "," in word:
            problem = f"{shown} is not a number. Write a decimal point, as in 0.5, and blanks between numbers"
        else:
            problem = f"{shown} is not a number. Write digits with one decimal point at most, as in 0.5 or -1.2e-3"
        raise RobotFileError(f'{self} has {attribute}="{clipped(self.attributes[attribute].strip())}": {problem}.')
