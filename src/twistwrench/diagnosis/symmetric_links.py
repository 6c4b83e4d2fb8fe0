"""Symmetric links: left and right links whose frames are mirror images at zero joint positions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..core.typing import Array
from .parsed_file import ParsedFile, ParsedLink

_RIGHT_WORDS = {
    "left": "right",
    "l": "r",
    "fl": "fr",
    "rl": "rr",
    "hl": "hr",
    "bl": "br",
    "lf": "rf",
    "lh": "rh",
    "lr": "rr",
}
"""Word of the right side by the word of the left side; f, r, b, h are front, rear, back and hind."""
_WORD_PATTERN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^A-Za-z0-9]+")
"""Part of a name: capitals, a word with or without capital, a number, or separators."""
_REFLECTIONS = (np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0]))
"""Reflections Y of the base frame: left and right lie along y, or along x."""
_MAX_FRAME_GAP = 1e-3
"""Tolerance of mirrored frames: distance of origins [m], and difference of entries of rotations."""
_MIN_DISTANCE_OF_SIDES = 0.02
"""Smallest distance of two mirrored frames [m]; nearer frames lie in the plane of reflection, on neither side."""


@dataclass(frozen=True, eq=False)
class SymmetricLinks:
    """Two links that are mirror images."""

    left: ParsedLink
    """Link with the name of the left side."""
    right: ParsedLink
    """Link with the name of the right side."""
    D: Array
    """Matrix (3, 3) that maps points of the left link to their mirror images on the right link, in link frames."""


def right_side_names(name: str) -> Iterator[str]:
    """Possible names of a left link's counterpart on the right, by exchanging one word.

    >>> list(right_side_names("arm_left_4_link")), list(right_side_names("LElbow")), list(right_side_names("tool"))
    (['arm_right_4_link'], ['RElbow'], [])
    """
    words = _WORD_PATTERN.findall(name)
    for k, word in enumerate(words):
        if word.lower() in _RIGHT_WORDS:
            exchanged = words.copy()
            exchanged[k] = _right_side_word(word)
            yield "".join(exchanged)
    # A single letter before a lower-case word, as in lshoulder.
    if re.match(r"l[a-z]{3}", name) and not name.startswith("left"):
        yield "r" + name[1:]


def _right_side_word(word: str) -> str:
    """Word of the right side for a word of the left side, with the same capitals."""
    right = _RIGHT_WORDS[word.lower()]
    if word.isupper():
        return right.upper()
    if word[0].isupper():
        return right.capitalize()
    return right


def symmetric_links(robot: ParsedFile) -> Iterator[SymmetricLinks]:
    """Pairs of links with left and right names whose frames are mirror images in a plane of the base."""
    poses = robot.neutral_poses
    for left in robot.links.values():
        right_names = [name for name in right_side_names(left.name) if name in robot.links]
        if not right_names:
            continue
        right_name = right_names[0]
        if left.name not in poses or right_name not in poses:
            continue
        right = robot.links[right_name]
        D = _mirror_map(poses[left.name], poses[right.name])
        if D is not None:
            yield SymmetricLinks(left, right, D)


def _mirror_map(T_a: Array, T_b: Array) -> Array | None:
    """D = R_b' Y R_a if it is a signed permutation and the origins of the frames are mirrored; otherwise None."""
    for Y in _REFLECTIONS:
        p_a, p_b = T_a[:3, 3], T_b[:3, 3]
        gap = p_b - Y @ p_a
        diagonal = (np.eye(3) - Y).diagonal()  # 2 along the direction of reflection
        distance = abs(p_a @ diagonal)  # |p - Y p|: twice the distance to the plane
        if np.linalg.norm(gap) > _MAX_FRAME_GAP or distance < _MIN_DISTANCE_OF_SIDES:
            continue
        D = T_b[:3, :3].T @ Y @ T_a[:3, :3]
        rounded = np.round(D)
        is_integer = np.abs(D - rounded).max() < _MAX_FRAME_GAP
        is_orthogonal = np.allclose(rounded @ rounded.T, np.eye(3))
        if is_integer and is_orthogonal:  # a signed permutation
            return np.asarray(rounded)
    return None
