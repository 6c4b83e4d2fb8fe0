"""The tree of links that joints describe: that it is one, and the order in which it is walked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..errors import ModelError, UnknownNameError
from ..listing import listed
from .description import JointEntry, LinkEntry


@dataclass(frozen=True)
class Tree:
    """The root link, the joints depth first (document order among siblings), and the links without children."""

    root: str
    joints: tuple[JointEntry, ...]
    leaves: tuple[str, ...]


def find_tree(links: Mapping[str, LinkEntry], joints: Sequence[JointEntry]) -> Tree:
    """Order the joints depth first; :class:`~twistwrench.ModelError` unless they join all links into one tree."""
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
            found = UnknownNameError.of("link", name, links)
            hint = ' Declare it with <link name="world"/>, say.' if name == "world" else ""
            raise ModelError(f"the {end} of {joint} is not there: {found}{hint}")
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
    # A stack rather than recursion: a chain may be longer than Python's stack is deep.
    ordered: list[JointEntry] = []
    stack = list(reversed(children[root]))
    while stack:
        joint = stack.pop()
        ordered.append(joint)
        stack.extend(reversed(children[joint.child]))
    return tuple(ordered)


def _cycle_message(link: str, parent_joint: Mapping[str, JointEntry]) -> str:
    # Going up from a link that no root reaches must come back to where it has been.
    path = [link]
    while (above := parent_joint[path[-1]].parent) not in path:
        path.append(above)
    loop = [*path[path.index(above) :], above][::-1]
    joints = ", ".join(str(parent_joint[name]) for name in loop[1:])
    return (
        f"the links {listed(map(repr, loop), between=' → ')} form a cycle, through {joints}. A robot must be a tree; "
        "remove one of these joints."
    )
