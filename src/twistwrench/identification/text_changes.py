"""Changes to the text of a robot file, told by elements: numbers that are set, attributes that go, elements that come."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

from ..bodies.inertia import SpatialInertia
from ..diagnosis.editing import edited
from ..diagnosis.findings import Edit, Place
from ..errors import ModelError
from ..formats.element import Element
from ..typing import Array

FOUND, ELSEWHERE = "identified from logs", "in none of the logs, or part of the link that carries it"
"""Why a number changes."""


def plain(values: Sequence[float] | Array) -> str:
    """Numbers as they come back to the last digit."""
    return " ".join(repr(float(x)) for x in values)


def links_of(
    links: Mapping[str, Element], wanted: Mapping[str, SpatialInertia]
) -> Iterator[tuple[Element, SpatialInertia]]:
    """Each link with the inertia that it is to have. Raises ModelError for links that the file does not have."""
    for name, inertia in wanted.items():
        if name not in links:
            raise ModelError(f"the file has no link {name!r} whose inertia could be written.")
        yield links[name], inertia


class TextChanges:
    """Changes to the file whose elements are those of ``root``, before others are included in it.

    Parameters
    ----------
    root : Element
    signature : str, what comments begin with
    """

    def __init__(self, root: Element, signature: str) -> None:
        self._elements = list(root.walk())  # kept alive, so that no included one gets the place of another
        self._numbers = {id(element): k for k, element in enumerate(self._elements)}
        self._signature = signature
        self._edits: dict[Place, tuple[Edit, str]] = {}
        self._additions: dict[int, str] = {}

    def set(self, element: Element, attribute: str, value: str, why: str = FOUND) -> None:
        """An attribute of an element, which may lack it; or its text, where the attribute is empty. What it says stays."""
        if _meaning(element.attributes.get(attribute, "") if attribute else element.content) == _meaning(value):
            return
        if not attribute and not element.content.strip():
            self.add(element, value)
            return
        self._edit(element, attribute, value, why, "put" if attribute else "change")

    def remove(self, element: Element, attribute: str, why: str = FOUND) -> None:
        """An attribute that an element has."""
        self._edit(element, attribute, "", why, "remove")

    def add(self, element: Element, text: str) -> None:
        """Put text first into an element; later ones come behind."""
        number = self._number(element)
        self._additions[number] = self._additions.get(number, "") + text

    def made(self, text: str) -> str:
        """The file's text with all of them."""
        return edited(text, list(self._edits.values()), additions=self._additions, signature=self._signature)

    def _edit(
        self, element: Element, attribute: str, value: str, why: str, how: Literal["change", "put", "remove"]
    ) -> None:
        place = Place(self._number(element), attribute)
        self._edits[place] = (Edit(place, value, how), why)

    def _number(self, element: Element) -> int:
        if id(element) not in self._numbers:
            raise ModelError(
                f"{element} stands in the included file {element.file!r}, and only the robot's own file is written. Put the "
                "included elements into it first."
            )
        return self._numbers[id(element)]


def _meaning(text: str) -> list[float] | str:
    """The numbers of a text, or the text where it is something else."""
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return text.strip()
