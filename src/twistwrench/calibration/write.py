"""Writing of a calibrated geometry into the robot's file, in which only placements change.

With fixed links between two joints, the new origin of the second joint is (fixed chain)⁻¹ P_k D_k, with the displacement D_k
of the calibration. Frames, masses and meshes stay on their links. The text is read back before it replaces a file.
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
"""Number of random configurations at which poses are compared."""
_REASON = "calibrated"
"""Reason of a change, in its comment in the file."""
_MAX_UNCHANGED_ENTRY = 1e-15
"""Largest change of an entry of a placement that keeps its spelling."""


def write_geometry(original: Robot, calibrated: Robot, frame: str, path: str | Path, summary: str) -> Path:
    """Write the file of ``original`` with the placements of ``calibrated``, and with ``summary`` in a comment, to ``path``.

    ``frame`` is the frame of the tip. Raises ModelError if the robot has no URDF or MJCF file, and RobotFileError if reading
    the text gives other poses.
    """
    file = file_of(original.model)
    if file is None or file.xacro or file.root.tag not in ("robot", "mujoco"):
        raise ModelError(
            f"robot {original.name!r} was not read from a URDF or MJCF file, so there is none to write into. "
            "tw.save(found.robot, path) writes a new one."
        )
    source = None  # path of the file; None if the robot was read from a text
    if str(original.model.source) and Path(str(file)).is_file():
        source = Path(str(file))
    robot_text = text_of(file.root, original.model.name, source)
    changes = TextChanges(SIGNATURE)
    chain = TipChain.from_robot(original, frame)
    links = [original.model.bodies[i].link for i in chain.bodies]
    if frame != links[-1]:
        links.append(frame)
    for link in links:
        if link not in robot_text.links:
            raise ModelError(
                f"the file has no {robot_text.noun} {link!r} whose place could be written. Name another: {argument('tip')}."
            )
        parent = robot_text.parent(link)
        file_pose = _placement(original.model, link, parent)
        calibrated_pose = _placement(calibrated.model, link, parent)
        if np.abs(calibrated_pose - file_pose).max() > _MAX_UNCHANGED_ENTRY:
            robot_text.write_pose(changes, link, calibrated_pose, _REASON)
    comment = f"{SIGNATURE} {__version__}, {date.today().isoformat()}: {summary}"
    xml_comment = comment.replace("--", "- -")  # XML forbids -- inside a comment
    changes.add(file.root, f"<!-- {xml_comment} -->")
    text = changes.apply(file.text)
    difference = _difference(text, calibrated, links, source)
    if not difference <= _MAX_POSE_DIFFERENCE:
        raise RobotFileError(
            f"what was written does not come back: poses differ by {number(difference, 2)} m. Nothing is written; "
            "tw.save(found.robot, path) writes a new file."
        )
    target = as_path(path)
    with replacing(target) as temporary:
        temporary.write_bytes(encode_as(text, file.data))
    return target


def _placement(model: Model, link: str, parent: str) -> Array:
    """(4, 4) pose of a link in its parent link or, without such a frame, in the base; all joints between them at zero."""
    parent_pose = np.eye(4)  # in the parent's body
    parent_body = BASE
    parent_frame = model.frames.get(parent)
    if parent_frame is not None:
        parent_pose = np.asarray(parent_frame.pose)
        parent_body = parent_frame.body
    frame = model.frames[link]
    pose = np.asarray(frame.pose)  # in ``body``
    body = frame.body
    while body != parent_body:  # one body towards the base
        pose = model.bodies[body].placement @ pose
        body = model.bodies[body].parent
    return np.asarray(se3.inverse(parent_pose)) @ pose


def _difference(text: str, calibrated: Robot, links: list[str], source: Path | None) -> float:
    """Largest difference of the links' poses, in m and in entries of rotations, between the text and ``calibrated``."""
    folders = [] if source is None else [source.resolve().parent]
    read_robot = load(text, include_paths=folders, inertia="accept", snap=0)
    rng = np.random.default_rng(0)
    q = calibrated.random_configuration(rng, _STATES)
    differences = []
    for link in links:
        T_read = np.asarray(read_robot.forward_kinematics(q, frame=link))
        T = np.asarray(calibrated.forward_kinematics(q, frame=link))
        differences.append(float(np.abs(T_read - T).max()))
    return max(differences)
