"""Default classes: what an element says where it says nothing itself.

A class begins as a copy of the class it stands in, whatever the order in the file. An element takes the class it names, else
the ``childclass`` of the nearest body or frame around it, else the outermost class, ``main``.
"""

from __future__ import annotations

from ...errors import RobotFileError
from ..element import Element

ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor", "pid",
    "orientation", "plugin",
)  # fmt: skip
"""The elements of ``<actuator>``; they share their defaults."""

SHORTCUT = "the shortcut"
"""Beside the attributes of an actuator: the element whose meaning they have."""

_TURNED = {"quat", "axisangle", "xyaxes", "zaxis", "euler"}
_MAIN = "main"


class Defaults:
    """The classes of a file, by name."""

    def __init__(self, root: Element) -> None:
        self._classes: dict[str, dict[str, dict[str, str]]] = {_MAIN: {}}
        stack = [(element, "") for element in reversed(root.all("default"))]
        while stack:
            element, parent = stack.pop()
            name = element.attributes.get("class", "").strip() or ("" if parent else _MAIN)
            if not name:
                raise RobotFileError(
                    f"{element} lies in the class {parent!r} and has no name of its own. Give it class=…."
                )
            if parent and name in self._classes:
                raise RobotFileError(f"{element} is the second class called {name!r}. Rename one.")
            if not parent and name != _MAIN:
                raise RobotFileError(
                    f"{element} is called {name!r}; the outermost class is {_MAIN!r}. Put it into that one."
                )
            start = self._classes.get(parent or name, {})
            mine = {tag: dict(attributes) for tag, attributes in start.items()}
            for child in element.children:
                if child.tag != "default":
                    key = _key(child.tag)
                    mine[key] = merged(mine.get(key, {}), child)
            self._classes[name] = mine
            stack.extend((child, name) for child in reversed(element.all("default")))

    def apply(self, element: Element, around: str = "", kind: str = "") -> Element:
        """The element with the attributes of its class where it has none; ``around`` is the childclass it stands in.

        ``kind`` is what the defaults are called where that is not the element's own tag.
        """
        name = element.attributes.get("class", "").strip() or around or _MAIN
        if name not in self._classes:
            known = ", ".join(repr(one) for one in self._classes)
            raise RobotFileError(f"{element} is of the class {name!r}, which no <default> describes. Known: {known}.")
        default = self._classes[name].get(kind or _key(element.tag))
        return element.with_attributes(merged(default, element)) if default or element.tag in ACTUATORS else element

    def check(self, element: Element, name: str) -> str:
        """``name`` if there is such a class, or where it is empty."""
        if name and name not in self._classes:
            known = ", ".join(repr(one) for one in self._classes)
            raise RobotFileError(
                f"{element} has the childclass {name!r}, which no <default> describes. Known: {known}."
            )
        return name


def merged(default: dict[str, str] | None, element: Element) -> dict[str, str]:
    """The attributes of an element over those of a class; of orientations, which are written in five ways, one counts."""
    own = element.attributes
    found = dict(default or {})
    if not own.keys().isdisjoint(_TURNED):
        found = {name: value for name, value in found.items() if name not in _TURNED}
    if element.tag in ACTUATORS:
        shortcut = element.tag if element.tag != "general" else found.get(SHORTCUT, "general")
        return {**found, **own, SHORTCUT: shortcut}
    return {**found, **own}


def _key(tag: str) -> str:
    return "actuator" if tag in ACTUATORS else tag
