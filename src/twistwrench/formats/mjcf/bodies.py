"""The bodies of an MJCF file in MuJoCo's order, each with what lies directly in it; frames are multiplied out on the way."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...errors import RobotFileError
from ...lie.identity import IDENTITY, product
from ...typing import Array
from ..element import Element
from .defaults import Defaults
from .placement import placement
from .settings import Settings

WORLD = "world"
"""The link that stands for the worldbody."""
_EXPANDED = (
    "expand it with MuJoCo: model = mujoco.MjSpec.from_file(path).compile(), then twistwrench.from_mujoco(model)"
)
REFUSED = {
    "composite": "it makes bodies by a recipe of MuJoCo's",
    "flexcomp": "it makes a deformable body",
    "replicate": "it makes bodies by a recipe of MuJoCo's",
    "attach": "it copies a body of another model",
}
_IGNORED = ("camera", "light", "plugin")
_IN_BODIES = ("body", "frame", "joint", "freejoint", "geom", "site", "inertial", *_IGNORED)


@dataclass(frozen=True, eq=False)
class PlacedElement:
    """A joint, geom or site with its defaults applied, and the pose of the frame around it in the body."""

    element: Element
    frame: Array

    def turned(self, x: Array) -> Array:
        """A direction (3,) of the frame, in the body."""
        return x if self.frame is IDENTITY else self.frame[:3, :3] @ x

    def moved(self, x: Array) -> Array:
        """A place (3,) of the frame, in the body."""
        return x if self.frame is IDENTITY else self.frame[:3, :3] @ x + self.frame[:3, 3]


@dataclass(eq=False)
class MjcfBody:
    """One body. The worldbody is number 0, and its own parent."""

    element: Element
    name: str
    parent: int
    T: Array
    """(4, 4) in the parent's frame, joints at their reference."""
    joints: list[PlacedElement] = field(default_factory=list)
    geoms: list[PlacedElement] = field(default_factory=list)
    sites: list[PlacedElement] = field(default_factory=list)
    inertial: PlacedElement | None = None
    plugins: list[Element] = field(default_factory=list)
    moves: bool = False
    """Whether a joint carries it, its own or one before."""


def survey(root: Element, settings: Settings, defaults: Defaults) -> list[MjcfBody]:
    """All bodies, depth first in the file's order, as MuJoCo numbers them.

    Raises :class:`~twistwrench.RobotFileError` for elements that are not read, and for those that are no elements of a body.
    """
    found = [MjcfBody(root, WORLD, 0, IDENTITY)]
    worlds = root.all("worldbody")
    stack = [
        (iter(world.children), 0, IDENTITY, world.attributes.get("childclass", "").strip())
        for world in reversed(worlds)
    ]
    taken = {e.attributes.get("name", "") for world in worlds for e in world.walk() if e.tag == "body"}
    taken.add(WORLD)
    while stack:
        children, at, frame, around = stack[-1]
        child = next(children, None)
        if child is None:
            stack.pop()
            continue
        body = found[at]
        if child.tag in ("joint", "freejoint"):
            if not at:
                raise RobotFileError(f"{child} stands in the worldbody, which does not move. Put it into a <body>.")
            # A free joint written short has no defaults.
            one = defaults.apply(child, around) if child.tag == "joint" else child
            body.joints.append(PlacedElement(one, frame))
            body.moves = True
        elif child.tag == "geom":
            body.geoms.append(PlacedElement(defaults.apply(child, around), frame))
        elif child.tag == "site":
            body.sites.append(PlacedElement(defaults.apply(child, around), frame))
        elif child.tag == "inertial":
            if body.inertial is not None:
                raise RobotFileError(f"{child} is the second one of its body, after {body.inertial.element}. Keep one.")
            body.inertial = PlacedElement(child, frame)
        elif child.tag in ("body", "frame"):
            T = product(frame, placement(child, settings))
            inner = (
                defaults.check(child, child.attributes["childclass"].strip())
                if "childclass" in child.attributes
                else around
            )
            if child.tag == "frame":
                stack.append((iter(child.children), at, T, inner))
                continue
            found.append(MjcfBody(child, _name(child, len(found), taken), at, T, moves=body.moves))
            stack.append((iter(child.children), len(found) - 1, IDENTITY, inner))
        elif child.tag in REFUSED:
            raise RobotFileError(f"{child} is not read: {REFUSED[child.tag]}. Use it there, and {_EXPANDED}.")
        elif child.tag == "plugin":
            body.plugins.append(child)
        elif child.tag not in _IGNORED:
            raise RobotFileError(f"{child} is no element of a body. Known: {', '.join(_IN_BODIES)}.")
    return found


def _name(body: Element, number: int, taken: set[str]) -> str:
    """Its name, or ``body3`` by its number; with a line at the end where another body is called so."""
    if body.attributes.get("name", "").strip():
        return body.text("name")
    return unused(f"body{number}", taken)


def unused(name: str, taken: set[str]) -> str:
    """The name, with ``_`` appended until nothing else has it; it is taken from then on."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name
