"""Identified servos in files: position actuators, armature and friction of an MJCF file, and an actuator file.

A robot that was not read from an MJCF file is written as one. Otherwise only numbers of its joints change, and position
actuators are added. The servo gets all of the damping as ``kv``, and the joint none, as positions cannot separate them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import ValueRangeError
from ...core.files import as_path, replacing
from ...core.numbers import number, quantity
from ...core.text import listed
from ...core.verdict import refuse_to_write
from ...core.version import __version__
from ...diagnosis.subject import Subject, read_subject
from ...formats.edit import TextChanges, encode_as
from ...formats.robot_text import MjcfText
from ...robot import Robot, load, save
from .replay import QUANTITIES, servo_unit

if TYPE_CHECKING:
    from .result import IdentifiedServos

SIGNATURE = "twistwrench identify"
"""Beginning of comments in written files."""
_FRICTION_TIME_CONSTANT = "0.002 1"
"""``solreffriction`` of MuJoCo, time constant [s] and damping ratio: with the default of 0.02 s, joints at rest creep."""
_MAX_DIFFERENCE = 1e-9
"""Largest relative difference of values that are read back."""
_MILLI = 1e3
"""Factor of seconds for milliseconds."""
_MAX_LISTED = 6
"""Largest number of joints that a note names."""


def write_servos(
    found: IdentifiedServos, path: str | Path | None, actuators: str | Path | None, *, force: bool
) -> tuple[str, ...]:
    """Write the MJCF file ``path`` and the file ``actuators``, and return notes; raises ValueRangeError before it writes.

    Only joints with all values determined are written; with ``force``, all joints.
    """
    if not force:
        refuse_to_write(found.verdict, "Pass force=True to write all the same.")
    is_written = np.asarray(found.whole, bool)  # for each joint
    if force:
        is_written = np.ones(len(found.joints), bool)
    if not is_written.any():
        raise ValueRangeError(
            "nothing is written, as no joint has all values determined. Give one known value, known={'JOINT.kp': 25}, or pass "
            "force=True."
        )
    if path is not None and as_path(path).suffix.lower() not in (".xml", ".mjcf"):
        raise ValueRangeError(f"servos are written as MJCF, and {str(path)!r} does not end in .xml.")
    # both are made before one is written
    mjcf = b""
    actuator_text = ""
    if path is not None:
        mjcf = mjcf_of_servos(found, is_written)
    if actuators is not None:
        actuator_text = actuators_of_servos(found, is_written)
    if path is not None:
        with replacing(path) as temporary:
            temporary.write_bytes(mjcf)
    if actuators is not None:
        with replacing(actuators) as temporary:
            temporary.write_text(actuator_text, encoding="utf-8")
    delay = quantity(_MILLI * found.delay, "ms", 3)
    notes = [f"commands reach the servos {delay} late, which no file represents: delay them"]
    not_written = [found.joints[j] for j in np.flatnonzero(~is_written)]
    if not_written:
        notes.append(f"values of {listed(not_written, _MAX_LISTED)} are not determined, and not written")
    return tuple(notes)


def mjcf_of_servos(found: IdentifiedServos, written: Sequence[bool] | np.ndarray) -> bytes:
    """MJCF file with position actuators, armature and friction of the joints for which ``written`` (nv,) is True.

    Raises ValueRangeError if the robot cannot be written as MJCF.
    """
    subject = _mjcf_subject(found.original)
    root = subject.root
    if root is None:
        raise ValueRangeError(f"robot {found.robot_name!r} cannot be written as MJCF.")
    file = MjcfText(root, found.original.model.name, subject.path)
    changes = TextChanges(SIGNATURE)
    actuators = list[str]()
    for j in np.flatnonzero(written).tolist():
        name = found.joints[j]
        armature, damping, coulomb, kp = found.values[j].tolist()
        file.write_joint(changes, name, {"motor_inertia": armature, "coulomb": coulomb, "viscous": 0.0})
        changes.set(file.joint_element(name), "solreffriction", _FRICTION_TIME_CONSTANT)
        actuators.append(f'    <position name="{name}" joint="{name}" kp="{kp!r}" kv="{damping!r}"/>\n')
    comment = (
        f"{SIGNATURE}: version {__version__}, {date.today().isoformat()}, servos from commands and positions; kv has the "
        f"servo's and the joint's damping; delay the commands by {number(found.delay, 4)} s"
    )
    xml_comment = comment.replace("--", "- -")  # XML forbids -- inside a comment
    changes.add(root, f"<!-- {xml_comment} -->\n  <actuator>\n{''.join(actuators)}  </actuator>\n")
    text = changes.apply(subject.text)
    _check(text, subject, found, written)
    return encode_as(text, subject.data)


def _mjcf_subject(robot: Robot) -> Subject:
    """Text of the robot's MJCF file; for a robot from another file, of an MJCF file that the robot is saved to."""
    subject = read_subject(robot, meshes=False)
    if subject.root is not None and subject.robot.format == "mjcf":
        return subject
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{robot.name}.xml"
        save(robot, path)
        return read_subject(path, meshes=False)


def _check(text: str, subject: Subject, found: IdentifiedServos, written: Sequence[bool] | np.ndarray) -> None:
    """Raise ValueRangeError if armature and friction differ when the text is read back."""
    folders = [] if subject.path is None else [subject.path.resolve().parent]
    read_model = load(text, include_paths=folders, inertia="accept").model
    read_index = {name: k for k, name in enumerate(read_model.velocity_names)}
    for j in np.flatnonzero(written).tolist():
        k = read_index[found.joints[j]]
        armature = found.armature[j]
        coulomb = found.coulomb[j]
        is_armature_same = abs(read_model.armature[k] - armature) <= _MAX_DIFFERENCE * armature
        is_friction_same = abs(read_model.friction.coulomb[k] - coulomb) <= _MAX_DIFFERENCE * coulomb
        if not (is_armature_same and is_friction_same):
            raise ValueRangeError(f"what was written of {found.joints[j]} does not come back. Please report it.")


def actuators_of_servos(found: IdentifiedServos, written: Sequence[bool] | np.ndarray) -> str:
    """Actuator file with armature and Coulomb friction; stiffness and damping of the servos are comments."""
    import yaml

    entries = dict[str, Any]()  # by joint
    comments = ""
    leaders = found.original.model.leaders
    for j in np.flatnonzero(written).tolist():
        name = found.joints[j]
        armature, damping, coulomb, kp = found.values[j].tolist()
        turns = bool(leaders[j].joint.turning[0])
        units = {quantity_name: servo_unit(quantity_name, turning=turns) for quantity_name in QUANTITIES}
        entries[name] = {
            "reflected_inertia": f"{armature!r} {units['armature']}",
            "friction": {"coulomb": f"{coulomb!r} {units['coulomb']}"},
        }
        comments += (
            f"# servo of {name}: kp {kp!r} {units['kp']}, kd {damping!r} {units['damping']}, with the joint's damping\n"
        )
    head = f"# {SIGNATURE}: servos from commands and positions; delay of the commands {found.delay!r} s\n"
    content: Mapping[str, Any] = {"robot": found.original.model.name, "actuators": entries}
    return head + comments + yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
