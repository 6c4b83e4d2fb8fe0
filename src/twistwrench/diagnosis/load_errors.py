"""All load errors of a URDF, so that one run of the doctor lists them together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

from ..core.errors import ModelError, TwistWrenchError, UnknownNameError
from ..formats.urdf import add_joint, add_link
from ..formats.xml import Element
from ..mechanics.model.builder import ModelBuilder

_MAX_ERRORS = 20
"""Maximum number of listed errors of a file."""


@dataclass(frozen=True)
class LoadError:
    """One reason why a file cannot be loaded."""

    where: str
    """Element with the error, such as "joint 'elbow'"."""
    line: int
    """Line of the element in the file."""
    sentence: str
    """Text of the error."""
    mimic: bool = False
    """True if only the leader of a mimic joint is missing; such joints can be loaded as independent."""

    def __str__(self) -> str:
        return self.sentence


def load_errors(root: Element) -> list[LoadError]:
    """All load errors of a ``<robot>``, by link and joint; empty for other formats."""
    if root.tag != "robot":
        return []
    errors = [*_element_errors(root), *_tree_errors(root), *_leader_errors(root)]
    return errors[:_MAX_ERRORS]


def _element_errors(root: Element) -> Iterator[LoadError]:
    """Errors within one link or joint."""
    builder = ModelBuilder("robot")
    for add, tag in ((add_link, "link"), (add_joint, "joint")):
        for element in root.all(tag):
            try:
                add(builder, element)
            except TwistWrenchError as error:
                name = element.attributes.get("name", "")
                yield LoadError(f"{tag} {name!r}", element.line, str(error))


def _tree_errors(root: Element) -> Iterator[LoadError]:
    """Missing parents and children, and links with two parents."""
    links = [link.attributes.get("name", "").strip() for link in root.all("link")]
    parent_counts: Counter[str] = Counter()  # number of joints whose child is the link
    for joint in root.all("joint"):
        where = f"joint {joint.attributes.get('name', '')!r}"
        for end in ("parent", "child"):
            name = _link_at(joint, end)
            if not name:
                continue
            if name not in links:
                unknown_name = UnknownNameError.from_choices("link", name, links)
                yield LoadError(where, joint.line, f"the {end} of {joint} is not there: {unknown_name}")
            if end == "parent":
                continue
            parent_counts[name] += 1
            if parent_counts[name] == 2:  # a third parent is not reported again
                sentence = f"{joint} gives link {name!r} a second parent. A robot must be a tree."
                yield LoadError(where, joint.line, sentence)


def _link_at(joint: Element, end: str) -> str:
    """Name of a joint's parent or child; empty if it is missing or given twice."""
    try:
        element = joint.child(end)
    except ModelError:
        return ""
    if element is None:
        return ""
    return element.attributes.get("link", "").strip()


def _leader_errors(root: Element) -> Iterator[LoadError]:
    """Mimic joints whose leader is missing."""
    joints = [joint.attributes.get("name", "").strip() for joint in root.all("joint")]
    for joint in root.all("joint"):
        if joint.attributes.get("type") == "fixed":
            continue
        for mimic in joint.all("mimic"):
            leader = mimic.attributes.get("joint", "").strip()
            if leader and leader not in joints:
                unknown_name = UnknownNameError.from_choices("joint", leader, joints)
                reason, _, _ = str(unknown_name).partition(" Known:")  # without the list of all joints
                sentence = f"it mimics a joint that is not there: {reason}"
                where = f"joint {joint.attributes.get('name', '')!r}"
                yield LoadError(where, joint.line, sentence, mimic=True)
