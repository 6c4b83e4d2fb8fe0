"""Tree of links and joints, from joints in any order that name their parent and child links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...core.errors import ModelError, UnknownNameError
from ...core.text import listed
from .description import JointEntry, LinkEntry


@dataclass(frozen=True)
class Tree:
    """Tree of a robot."""

    root: str
    """Link without a parent."""
    joints: tuple[JointEntry, ...]
    """Joints depth first, siblings in document order."""
    leaves: tuple[str, ...]
    """Links without children, in document order."""


def find_tree(links: Mapping[str, LinkEntry], joints: Sequence[JointEntry]) -> Tree:
    """Sort joints depth first; raises :class:`~twistwrench.ModelError` unless they join all links into one tree."""
    if not links:
        raise ModelError("the robot has no links. Give at least one.")
    parent_joint: dict[str, JointEntry] = {}
    children: dict[str, list[JointEntry]] = {name: [] for name in links}
    for joint in joints:
        _check_ends(joint, links)
        if joint.child in parent_joint:
            raise ModelError(
                f"{links[joint.child]} has two parents: {joint.parent!r} by {joint} and "
                f"{parent_joint[joint.child].parent!r} by {parent_joint[joint.child]}. A robot must be a tree; "
                "remove one of these joints (a closed loop is cut open at one joint)."
            )
        parent_joint[joint.child] = joint
        children[joint.parent].append(joint)
    root = _root(links, parent_joint)
    ordered_joints = _depth_first(root, children)
    if len(ordered_joints) + 1 < len(links):
        links_of_tree = {root, *(joint.child for joint in ordered_joints)}
        other_link = next(name for name in links if name not in links_of_tree)
        raise ModelError(_cycle_message(other_link, parent_joint))
    leaves = tuple(name for name in links if not children[name])
    return Tree(root, ordered_joints, leaves)


def _check_ends(joint: JointEntry, links: Mapping[str, LinkEntry]) -> None:
    """Raise ModelError if a joint's parent or child does not exist, or if both are one link."""
    for end, name in (("parent", joint.parent), ("child", joint.child)):
        if name not in links:
            error = UnknownNameError.from_choices("link", name, links)
            hint = ' For example, declare it with <link name="world"/>.' if name == "world" else ""
            raise ModelError(f"the {end} of {joint} is not there: {error}{hint}")
    if joint.parent == joint.child:
        raise ModelError(
            f"{joint} makes {links[joint.parent]} its own child (a cycle of one). Name another parent or child."
        )


def _root(links: Mapping[str, LinkEntry], parent_joint: Mapping[str, JointEntry]) -> str:
    """The only link without a parent; raises ModelError if there is none or more than one."""
    roots = [name for name in links if name not in parent_joint]
    if not roots:
        raise ModelError("there is no root link: " + _cycle_message(next(iter(links)), parent_joint))
    if len(roots) > 1:
        raise ModelError(
            f"{len(roots)} root links, where a robot has one: {listed(str(links[name]) for name in roots)}. "
            "Join them with (fixed) joints, or remove those that do not belong to the robot."
        )
    return roots[0]


def _depth_first(root: str, children: Mapping[str, Sequence[JointEntry]]) -> tuple[JointEntry, ...]:
    """Joints depth first. A stack replaces recursion, since chains may exceed Python's recursion limit."""
    ordered: list[JointEntry] = []
    stack = list(reversed(children[root]))
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack.extend(reversed(children[joint.child]))
    return tuple(ordered)


def _cycle_message(link: str, parent_joint: Mapping[str, JointEntry]) -> str:
    """Error message for a link that is not connected to a root: among its ancestors there is a cycle."""
    path: list[str] = []  # from the link towards its ancestors, up to the first that is there already
    ancestor = link
    while ancestor not in path:
        path.append(ancestor)
        ancestor = parent_joint[ancestor].parent
    children_first = [*path[path.index(ancestor) :], ancestor]
    cycle = children_first[::-1]
    links_text = listed(map(repr, cycle), between=" → ")
    joints_text = listed(str(parent_joint[name]) for name in cycle[1:])
    return (
        f"the links {links_text} form a cycle, through {joints_text}. A robot must be a tree; "
        "remove one of these joints."
    )
