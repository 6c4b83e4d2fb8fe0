"""Tree of links and joints, from their ends in any order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...core.errors import ModelError, UnknownNameError
from ...core.text import listed
from .description import JointEntry, LinkEntry


@dataclass(frozen=True)
class Tree:
    """Root link, joints depth first (document order among siblings), and the links without children."""

    root: str
    joints: tuple[JointEntry, ...]
    leaves: tuple[str, ...]


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
    ordered = _depth_first(root, children)
    if len(ordered) + 1 < len(links):
        reached = {root, *(joint.child for joint in ordered)}
        raise ModelError(_cycle_message(next(name for name in links if name not in reached), parent_joint))
    return Tree(root, ordered, tuple(name for name in links if not children[name]))


def _check_ends(joint: JointEntry, links: Mapping[str, LinkEntry]) -> None:
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
    roots = [name for name in links if name not in parent_joint]
    if not roots:
        raise ModelError("there is no root link: " + _cycle_message(next(iter(links)), parent_joint))
    if len(roots) > 1:
        raise ModelError(
            f"{len(roots)} root links, where a robot has one: {listed(str(links[r]) for r in roots)}. "
            "Join them with (fixed) joints, or remove those that do not belong to the robot."
        )
    return roots[0]


def _depth_first(root: str, children: Mapping[str, Sequence[JointEntry]]) -> tuple[JointEntry, ...]:
    # A stack instead of recursion: chains may exceed Python's recursion limit.
    ordered: list[JointEntry] = []
    stack = list(reversed(children[root]))
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack.extend(reversed(children[joint.child]))
    return tuple(ordered)


def _cycle_message(link: str, parent_joint: Mapping[str, JointEntry]) -> str:
    # Parents of a link without a root form a cycle.
    order: dict[str, int] = {}
    while link not in order:
        order[link] = len(order)
        link = parent_joint[link].parent
    loop = [*list(order)[order[link] :], link][::-1]
    joints = listed(str(parent_joint[name]) for name in loop[1:])
    return (
        f"the links {listed(map(repr, loop), between=' → ')} form a cycle, through {joints}. A robot must be a tree; "
        "remove one of these joints."
    )
