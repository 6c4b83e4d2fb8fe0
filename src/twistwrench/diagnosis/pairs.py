"""Left and right: the pairs of links that mirror each other with the joints at zero."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..typing import Array
from .described import DescribedLink, DescribedRobot

_SIDES = {"left": "right", "l": "r", "fl": "fr", "rl": "rr", "hl": "hr", "bl": "br", "lf": "rf", "lh": "rh", "lr": "rr"}
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^A-Za-z0-9]+")
_PLANES = (np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0]))
"""Reflections of the base frame: left and right along y, and along x."""
_ALIKE = 1e-3
"""m, and entries of rotations: how far from mirrored frames may be."""


@dataclass(frozen=True, eq=False)
class Pair:
    """Two links that mirror each other."""

    left: DescribedLink
    right: DescribedLink
    D: Array
    """(3, 3) what a point of the left link, in its frame, is multiplied by to be its image in the right one's."""


def names_of_right(name: str) -> Iterator[str]:
    """What the other side of a left link may be called: one word for the side, exchanged.

    >>> list(names_of_right("arm_left_4_link")), list(names_of_right("LElbow")), list(names_of_right("tool"))
    (['arm_right_4_link'], ['RElbow'], [])
    """
    words = _WORDS.findall(name)
    for k, word in enumerate(words):
        other = _SIDES.get(word.lower())
        if other is not None:
            cased = other.upper() if word.isupper() else other.capitalize() if word[0].isupper() else other
            yield "".join([*words[:k], cased, *words[k + 1 :]])
    # One letter in front of a word in small letters, as in lshoulder.
    if re.match(r"l[a-z]{3}", name) and not name.startswith("left"):
        yield "r" + name[1:]


def pairs_of(robot: DescribedRobot) -> Iterator[Pair]:
    """All pairs of links by their names whose frames are mirror images of each other in one plane of the base."""
    poses = robot.neutral_poses
    for left in robot.links.values():
        right = next((robot.links[name] for name in names_of_right(left.name) if name in robot.links), None)
        if right is None or left.name not in poses or right.name not in poses:
            continue
        D = _mirrored(poses[left.name], poses[right.name])
        if D is not None:
            yield Pair(left, right, D)


def _mirrored(T_a: Array, T_b: Array) -> Array | None:
    """R_b' Y R_a where it is a signed permutation and the places are mirrored; None elsewhere."""
    for Y in _PLANES:
        gap = T_b[:3, 3] - Y @ T_a[:3, 3]
        if np.linalg.norm(gap) > _ALIKE or abs(T_a[:3, 3] @ (np.eye(3) - Y).diagonal()) < 0.02:
            continue
        D = T_b[:3, :3].T @ Y @ T_a[:3, :3]
        rounded = np.round(D)
        if np.abs(D - rounded).max() < _ALIKE and np.allclose(rounded @ rounded.T, np.eye(3)):
            return np.asarray(rounded)
    return None
