"""Symmetric links: left and right links whose frames are mirror images at zero joint positions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..core.typing import Array
from .parsed_file import ParsedFile, ParsedLink

_SIDES = {"left": "right", "l": "r", "fl": "fr", "rl": "rr", "hl": "hr", "bl": "br", "lf": "rf", "lh": "rh", "lr": "rr"}
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^A-Za-z0-9]+")
_PLANES = (np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0]))
"""Reflections of the base frame: left and right along y, and along x."""
_MAX_FRAME_GAP = 1e-3
"""Tolerance of mirrored frames, in m and in entries of rotations."""
_MIN_DISTANCE_OF_SIDES = 0.02
"""Smallest distance of two mirrored frames [m]; frames nearer to the plane are on no side."""


@dataclass(frozen=True, eq=False)
class SymmetricLinks:
    """Two links that are mirror images."""

    left: ParsedLink
    right: ParsedLink
    D: Array
    """Matrix (3, 3) that maps points of the left link to mirrored points of the right one, in link frames."""


def right_side_names(name: str) -> Iterator[str]:
    """Possible names of a left link's counterpart on the right, by exchanging one word.

    >>> list(right_side_names("arm_left_4_link")), list(right_side_names("LElbow")), list(right_side_names("tool"))
    (['arm_right_4_link'], ['RElbow'], [])
    """
    words = _WORDS.findall(name)
    for k, word in enumerate(words):
        if word.lower() in _SIDES:
            yield "".join([*words[:k], _right_side_word(word), *words[k + 1 :]])
    # A single letter before a lower-case word, as in lshoulder.
    if re.match(r"l[a-z]{3}", name) and not name.startswith("left"):
        yield "r" + name[1:]


def _right_side_word(word: str) -> str:
    """Word of the right side for one of the left, with the same capitals."""
    right = _SIDES[word.lower()]
    if word.isupper():
        return right.upper()
    if word[0].isupper():
        return right.capitalize()
    return right


def symmetric_links(robot: ParsedFile) -> Iterator[SymmetricLinks]:
    """Pairs of links with left and right names whose frames are mirror images in a plane of the base."""
    poses = robot.neutral_poses
    for left in robot.links.values():
        right = next((robot.links[name] for name in right_side_names(left.name) if name in robot.links), None)
        if right is None or left.name not in poses or right.name not in poses:
            continue
        D = _mirror_map(poses[left.name], poses[right.name])
        if D is not None:
            yield SymmetricLinks(left, right, D)


def _mirror_map(T_a: Array, T_b: Array) -> Array | None:
    """R_b' Y R_a if it is a signed permutation and the positions are mirrored; otherwise None."""
    for Y in _PLANES:
        gap = T_b[:3, 3] - Y @ T_a[:3, 3]
        distance = abs(T_a[:3, 3] @ (np.eye(3) - Y).diagonal())
        if np.linalg.norm(gap) > _MAX_FRAME_GAP or distance < _MIN_DISTANCE_OF_SIDES:
            continue
        D = T_b[:3, :3].T @ Y @ T_a[:3, :3]
        permutation = np.round(D)
        if np.abs(D - permutation).max() < _MAX_FRAME_GAP and np.allclose(permutation @ permutation.T, np.eye(3)):
            return np.asarray(permutation)
    return None
