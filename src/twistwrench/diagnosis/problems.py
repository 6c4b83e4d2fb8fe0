"""What the loader refuses in a URDF, all of it and not only the first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from ..errors import ModelError, TwistWrenchError, UnknownNameError
from ..formats.element import Element
from ..formats.urdf import add_joint, add_link
from ..model.builder import ModelBuilder

_MOST = 20


@dataclass(frozen=True)
class FileProblem:
    """One reason to refuse a file."""

    where: str
    line: int
    sentence: str
    mimic: bool = False
    """Whether it is only a leader that is not there: the robot can be read with such joints independent."""

    def __str__(self) -> str:
        return self.sentence


def problems_of(root: Element) -> list[FileProblem]:
    """All reasons to refuse a ``<robot>``, link by link and joint by joint; none for other formats."""
    if root.tag != "robot":
        return []
    found = [*_each_by_itself(root), *_ends(root), *_leaders(root)]
    return found[:_MOST]


def _each_by_itself(root: Element) -> Iterator[FileProblem]:
    builder = ModelBuilder("robot")
    for add, tag in ((add_link, "link"), (add_joint, "joint")):
        for element in root.all(tag):
            try:
                add(builder, element)
            except TwistWrenchError as error:
                yield FileProblem(f"{tag} {element.attributes.get('name', '')!r}", element.line, str(error))


def _ends(root: Element) -> Iterator[FileProblem]:
    """Parents and children that are not there, and links with two parents."""
    links = [link.attributes.get("name", "").strip() for link in root.all("link")]
    children: Counter[str] = Counter()
    for joint in root.all("joint"):
        for end in ("parent", "child"):
            try:
                element = joint.child(end)
            except ModelError:
                continue
            name = element.attributes.get("link", "").strip() if element is not None else ""
            if not name:
                continue
            where = f"joint {joint.attributes.get('name', '')!r}"
            if name not in links:
                missing = UnknownNameError.of("link", name, links)
                yield FileProblem(where, joint.line, f"the {end} of {joint} is not there: {missing}")
            children[name] += end == "child"
            if end == "child" and children[name] == 2:
                yield FileProblem(
                    where, joint.line, f"{joint} gives link {name!r} a second parent. A robot must be a tree."
                )


def _leaders(root: Element) -> Iterator[FileProblem]:
    joints = [joint.attributes.get("name", "").strip() for joint in root.all("joint")]
    for joint in root.all("joint"):
        for mimic in joint.all("mimic") if joint.attributes.get("type") != "fixed" else ():
            leader = mimic.attributes.get("joint", "").strip()
            if leader and leader not in joints:
                missing = str(UnknownNameError.of("joint", leader, joints)).partition(" Known:")[0]
                said = f"it mimics a joint that is not there: {missing}"
                yield FileProblem(f"joint {joint.attributes.get('name', '')!r}", joint.line, said, mimic=True)
