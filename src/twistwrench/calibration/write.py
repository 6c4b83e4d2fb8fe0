"""Writing of a calibrated geometry into the robot's file, in which only placements change.

With fixed links between two joints, the new origin of the moving joint is (fixed chain)⁻¹ P_k e^[d_k]; frames, masses and
meshes stay on their links. The text is read back before it replaces a file.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np

from ..core.errors import ModelError, RobotFileError
from ..core.files import as_path, replacing
from ..core.numbers import number
from ..core.text import argument
from ..core.typing import Array
from ..core.version import __version__
from ..formats.edit import TextChanges, encode_as
from ..formats.robot_file import file_of
from ..formats.robot_text import text_of
from ..mechanics.lie import se3
from ..mechanics.model.model import BASE, Model
from ..robot import Robot, load
from .chain import TipChain

SIGNATURE = "twistwrench calibrate"
"""Beginning of comments in written files."""
_MAX_POSE_DIFFERENCE = 1e-9
"""Largest difference of poses after reading back, in m and in entries of rotations."""
_STATES = 200
_WHY = "calibrated"
_MAX_UNCHANGED_ENTRY = 1e-15
"""Largest change of an entry of a placement that keeps its spelling."""


def write_geometry(original: Robot, calibrated: Robot, frame: str, path: str | Path, said: str) -> Path:
    """Write the placements of ``calibrated`` into the file of ``original``; ``said`` becomes a comment at its top.

    Raises ModelError if the robot has no URDF or MJCF file, RobotFileError if the text does not come back the same.
    """
    file = file_of(original.model)
    if file is None or file.xacro or file.root.tag not in ("robot", "mujoco"):
        raise ModelError(
            f"robot {original.name!r} was not read from a URDF or MJCF file, so there is none to write into. "
            "tw.save(found.robot, path) writes a new one."
        )
    source = Path(str(file)) if str(original.model.source) and Path(str(file)).is_file() else None
    editable = text_of(file.root, original.model.name, source)
    changes = TextChanges(SIGNATURE)
    chain = TipChain.from_robot(original, frame)
    links = [original.model.bodies[i].link for i in chain.bodies]
    if frame != links[-1]:
        links.append(frame)
    for link in links:
        if link not in editable.links:
            raise ModelError(
                f"the file has no {editable.noun} {link!r} whose place could be written. Name another: {argument('tip')}."
            )
        parent = editable.parent(link)
        before, after = (_placement(model, link, parent) for model in (original.model, calibrated.model))
        if np.abs(after - before).max() > _MAX_UNCHANGED_ENTRY:
            editable.write_pose(changes, link, after, _WHY)
    comment = f"{SIGNATURE} {__version__}, {date.today().isoformat()}: {said}".replace("--", "- -")
    changes.add(file.root, f"<!-- {comment} -->")
    text = changes.apply(file.text)
    off = _difference(text, calibrated, links, source)
    if not off <= _MAX_POSE_DIFFERENCE:
        raise RobotFileError(
            f"what was written does not come back: poses differ by {number(off, 2)} m. Nothing is written; "
            "tw.save(found.robot, path) writes a new file."
        )
    target = as_path(path)
    with replacing(target) as scratch:
        scratch.write_bytes(encode_as(text, file.data))
    return target


def _placement(model: Model, link: str, parent: str) -> Array:
    """(4, 4) pose of a link in its parent link or body, at zero of the joint between them."""
    frame, above = model.frames[link], model.frames.get(parent)
    base, body = np.eye(4), BASE
    if above is not None:
        base, body = np.asarray(above.pose), above.body
    between, i = np.asarray(frame.pose), frame.body
    while i != body:
        between = model.bodies[i].placement @ between
        i = model.bodies[i].parent
    return np.asarray(se3.inverse(base)) @ between


def _difference(text: str, calibrated: Robot, links: list[str], source: Path | None) -> float:
    """Largest difference of the links' poses after reading the text."""
    folders = [] if source is None else [source.resolve().parent]
    again = load(text, include_paths=folders, inertia="accept", snap=0)
    rng = np.random.default_rng(0)
    q = calibrated.random_configuration(rng, _STATES)
    differences = []
    for link in links:
        written, expected = again.forward_kinematics(q, frame=link), calibrated.forward_kinematics(q, frame=link)
        differences.append(float(np.abs(np.asarray(written) - np.asarray(expected)).max()))
    return max(differences)
