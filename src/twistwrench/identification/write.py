"""Writing of identified parameters to actuator files and to the robot file, in which only the numbers change.

A body of the model is a moving link with the links fixed to it. The moving link gets the identified inertia less the inertias
of the fixed links. If this remaining inertia is not physically consistent, the fixed links are folded into the moving link.
The written text is read back and compared before it replaces a file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import ModelError, RobotFileError, ValueRangeError
from ..core.files import as_path, replacing
from ..core.numbers import number, percent
from ..core.text import argument
from ..core.typing import Array
from ..core.verdict import refuse_to_write
from ..core.version import __version__
from ..diagnosis.subject import Subject, read_subject
from ..formats.edit import TextChanges, encode_as
from ..formats.robot_text import TEXTS
from ..formats.xml import Element
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.lie import se3
from ..mechanics.model.model import BASE, Model
from ..robot import Robot, load
from .actuator_text import OF_COUPLED_MOTORS, SIGNATURE, actuator_text, same_actuators
from .consistent import ConsistentRobot

if TYPE_CHECKING:
    from .result import IdentifiedRobot

_MAX_DIFFERENCE = 1e-12
"""Largest difference after reading back, as a share of the largest value."""
_STATES = 200
"""Number of random states at which robots are compared."""
_MAX_RATIO_TO_FILE = 1.05
"""Largest ratio of a robot's held-out residual to the residual of the file's bodies with friction."""
_MAX_INCREASE = 0.002
"""Increase of the held-out residual that is negligible, as a share of the torques."""
_MAX_MASS_CHANGE = 0.2
"""Largest change of the moving mass without a remark, as a share of the file's moving mass."""


@dataclass(frozen=True, eq=False)
class WrittenRobot:
    """Robot file with identified parameters, before it is written to disk."""

    text: str
    data: bytes  # of the text, in the encoding of the original file
    difference: float  # of torques after reading back, as a share of the largest torque
    folded: tuple[str, ...]  # fixed links whose inertia was added to the carrying links
    missing: Mapping[str, Mapping[str, float]]  # values by kind and joint that the file cannot store
    folder: Path | None  # folder to which the file's relative paths refer; None if it has no such paths


def written_robot(original: Robot, found: ConsistentRobot, comment: str) -> WrittenRobot:
    """File of ``original`` with the bodies and drives of ``found``; ``comment`` is added at its top.

    Raises ModelError if the robot has no file or its format cannot store a value, and RobotFileError if reading back
    the text gives other values.
    """
    subject = read_subject(original, meshes=False)
    root = subject.root
    if root is None:
        raise ModelError(
            f"robot {original.name!r} was not read from a file, so there is none to write into. tw.save(found.robot, path) "
            "writes a new one."
        )
    inertias, folded_links = _link_inertias(found, TEXTS[subject.robot.format].share_left)
    file = _ChangedFile(subject, root, found, inertias)
    drives = _drives(found)
    written_drives = drives
    deviations = file.deviations(comment, written_drives, drives)
    largest_deviations = [max(deviation_by_joint.values()) for deviation_by_joint in deviations.values()]  # by kind
    if max(largest_deviations, default=0.0) > 0:  # actuators of the file add a part when it is read: write less
        written_drives = _without_stored_part(drives, deviations)
        deviations = file.deviations(comment, written_drives, drives)
    missing: dict[str, dict[str, float]] = {}
    missing_texts: list[str] = []
    for kind, deviation_by_joint in deviations.items():  # what still differs has no place in the file
        missing[kind] = {joint: drives[kind][joint] for joint in deviation_by_joint}
        missing_texts += [f"{kind} {joint} {number(value)}" for joint, value in missing[kind].items()]
    if missing_texts:
        comment = f"{comment}; not in it: {', '.join(missing_texts)}"
    text = file.text(comment, written_drives)
    difference = _difference(file.model(text), found)
    if not difference <= _MAX_DIFFERENCE:
        raise RobotFileError(
            f"what was written does not come back: torques differ by {number(difference, 2)} of the largest. Please report it."
        )
    folder = None
    if subject.path is not None and _names_files(root):
        folder = subject.path.resolve().parent
    return WrittenRobot(text, encode_as(text, subject.data), difference, tuple(folded_links), missing, folder)


def _without_stored_part(
    drives: Mapping[str, Mapping[str, float]], deviations: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """Values to write, by kind and joint, so that reading, which adds the part of the file's actuators, gives ``drives``.

    Positive ``deviations`` are these parts.
    """
    written = {kind: dict(values) for kind, values in drives.items()}
    for kind, stored_by_joint in deviations.items():
        for joint, stored in stored_by_joint.items():
            if stored > 0.0:
                written[kind][joint] = max(0.0, written[kind][joint] - stored)
    return written


def _names_files(root: Element) -> bool:
    """True if the file refers to others by relative paths: includes, meshes, textures."""
    for element in root.walk():
        names = [element.attributes.get("file", ""), element.attributes.get("filename", "")]
        if element.tag == "uri":
            names.append(element.content.strip())
        is_included = bool(element.file)
        if is_included or any(map(_is_relative, names)):
            return True
    return False


def _is_relative(name: str) -> bool:
    """True for a relative path, not an address, a package or an absolute path."""
    return bool(name) and "://" not in name and not name.startswith("/")


@dataclass(frozen=True, eq=False)
class _ChangedFile:
    """Robot file in which the numbers of links and joints are replaced."""

    subject: Subject
    """File as it was read."""
    root: Element
    found: ConsistentRobot
    inertias: Mapping[str, SpatialInertia]
    """New inertias by link, each in the link's frame."""

    def text(self, comment: str, drives: Mapping[str, Mapping[str, float]]) -> str:
        """Text of the file with the new inertias, and with the values ``drives`` of joints, by kind and joint.

        Mimic joints get values of 0, since the values of the joint that they follow contain their part.
        """
        changes = TextChanges(SIGNATURE)
        model = self.found.base.unknown.model
        text_of_format = TEXTS[self.subject.robot.format]
        file = text_of_format(self.root, model.name, self.subject.path)
        file.write_links(changes, self._changed_inertias())
        values_by_joint: dict[str, dict[str, float]] = {joint: {} for joint in model.velocity_names}
        for kind, value_by_joint in drives.items():
            for joint, value in value_by_joint.items():
                values_by_joint[joint][kind] = value
        for joint, values in values_by_joint.items():
            file.write_joint(changes, joint, values)
        for body in model.bodies:
            if body.follows:
                zeros = dict.fromkeys(drives, 0.0)
                file.write_joint(changes, body.joint.name, zeros, "part of the joint that it follows")
        xml_comment = comment.replace("--", "- -")  # XML forbids -- inside a comment
        changes.add(self.root, f"<!-- {SIGNATURE}: {xml_comment} -->")
        return changes.apply(self.subject.text)

    def _changed_inertias(self) -> dict[str, SpatialInertia]:
        """New inertias of the links whose inertia differs from the file's, by link."""
        inertias_of_file = self.subject.robot.model.link_inertias
        changed: dict[str, SpatialInertia] = {}
        for link, G in self.inertias.items():
            is_same = link in inertias_of_file and np.array_equal(inertias_of_file[link].parameters, G.parameters)
            if not is_same:
                changed[link] = G
        return changed

    def model(self, text: str) -> Model:
        """Model of the text, read with the options of the robot's file."""
        path = self.subject.path
        folders = [] if path is None else [path.resolve().parent]
        options: dict[str, Any] = {"include_paths": folders, "inertia": "accept", "model": self.subject.model}
        model = load(text, **options).model
        joint_names = self.found.base.unknown.model.velocity_names
        if set(joint_names) <= set(model.velocity_names):
            return model
        # joints are missing: the robot was identified with its mimic joints as independent ones
        return load(text, **options, mimic="independent").model

    def deviations(
        self, comment: str, written: Mapping[str, Mapping[str, float]], drives: Mapping[str, Mapping[str, float]]
    ) -> dict[str, dict[str, float]]:
        """Differences, by kind and joint, of the values that are read back after ``written`` is written, less ``drives``."""
        text = self.text(comment, written)
        return _deviations(self.model(text), drives)


def _link_inertias(found: ConsistentRobot, folded_share: float) -> tuple[dict[str, SpatialInertia], list[str]]:
    """Inertia of each link in its own frame, and names of fixed links that are folded into moving ones.

    Fixed links keep their inertia of the file, and the moving link gets the remaining inertia of the body. If that is not
    physically consistent, each fixed link gets ``folded_share`` of the body's inertia instead. Shares of a consistent inertia
    are consistent.
    """
    model = found.base.unknown.model
    link_inertias: dict[str, SpatialInertia] = {}
    folded_links: list[str] = []
    for i, (body, body_inertia) in enumerate(zip(model.bodies, found.inertias, strict=True)):
        if body.link not in model.link_inertias:
            continue  # massless body between two joints of one link
        poses: dict[str, Array] = {}
        for link, frame in model.frames.items():
            if frame.body == i and link in model.link_inertias:
                poses[link] = frame.pose
        fixed_inertias = {link: model.link_inertias[link] for link in poses if link != body.link}
        remaining = body_inertia
        for link, G in fixed_inertias.items():
            remaining = remaining - G.in_frame(poses[link])
        is_possible = remaining.mass > 0 and not remaining.defects()
        if fixed_inertias and not is_possible:
            heavy_links = [link for link, G in fixed_inertias.items() if G.parameters.any()]
            folded_inertia = SpatialInertia(folded_share * body_inertia.parameters)
            fixed_inertias = dict.fromkeys(heavy_links, SpatialInertia.zero())
            if folded_share:
                fixed_inertias = {link: folded_inertia.in_frame(se3.inverse(poses[link])) for link in heavy_links}
            remaining_share = 1.0 - folded_share * len(heavy_links)
            remaining = SpatialInertia(remaining_share * body_inertia.parameters)
            folded_links += heavy_links
        link_inertias |= {**fixed_inertias, body.link: remaining}
    return link_inertias, folded_links


def _drives(found: ConsistentRobot) -> dict[str, dict[str, float]]:
    """Values by kind and joint: identified friction, and motor inertias, which are 0 if not identified."""
    drives: dict[str, dict[str, float]] = {}
    for kind in ("viscous", "coulomb", "stribeck"):
        values = found.of_joints(kind)
        if values:
            drives[kind] = values
    names = found.base.unknown.model.velocity_names
    drives["motor_inertia"] = dict.fromkeys(names, 0.0) | found.of_joints("motor_inertia")
    return drives


def _deviations(model: Model, drives: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Joint values of a model less ``drives``, by kind and joint, where they differ by more than rounding errors.

    A joint that the model lacks has the value 0.
    """
    friction = model.friction
    static_excess = np.asarray(friction.static) - friction.coulomb
    values_of_model = {
        "viscous": friction.viscous,
        "coulomb": friction.coulomb,
        "stribeck": static_excess,
        "motor_inertia": model.armature,
    }
    velocity_index = {name: k for k, name in enumerate(model.velocity_names)}
    deviations: dict[str, dict[str, float]] = {}
    for kind, values in drives.items():
        largest_value = max(map(abs, values.values()), default=0.0)
        for joint, value in values.items():
            model_value = 0.0
            if joint in velocity_index:
                model_value = float(values_of_model[kind][velocity_index[joint]])
            deviation = model_value - value
            is_rounding = abs(deviation) <= _MAX_DIFFERENCE * largest_value
            if not is_rounding:
                deviations.setdefault(kind, {})[joint] = deviation
    return deviations


def _difference(model: Model, found: ConsistentRobot) -> float:
    """Largest difference between the torques of ``model``, read back, and of ``found``, as a share of the largest torque.

    Torques are those of the bodies without drives, at random states.
    """
    read_parameters = [np.zeros(10) for _ in found.base.unknown.model.bodies]
    for link, frame in found.base.unknown.model.frames.items():
        if frame.body != BASE and link in model.link_inertias:
            G = model.link_inertias[link].in_frame(frame.pose)
            read_parameters[frame.body] = read_parameters[frame.body] + G.parameters
    rng = np.random.default_rng(0)
    robot = found.base.unknown.robot
    q = _random_configurations(robot, rng)
    dq, ddq = rng.normal(size=(2, _STATES, robot.nv))
    Y = robot.regressor(q, dq, ddq)
    torques = Y @ np.concatenate([G.parameters for G in found.inertias])
    read_torques = Y @ np.concatenate(read_parameters)
    largest_torque = max(np.abs(torques).max(), 1e-300)  # above zero, also without any torque
    return float(np.abs(read_torques - torques).max() / largest_torque)


def _random_configurations(robot: Robot, rng: np.random.Generator) -> Array:
    """(200, nq) random configurations."""
    return np.stack([robot.random_configuration(rng) for _ in range(_STATES)])


def check_written(found: ConsistentRobot) -> list[str]:
    """Remarks on changes of the robot; raises ValueRangeError if it must not be written.

    Every body must be physically consistent, M must be positive definite, and the held-out residual hardly larger than the
    residual of the file's bodies with friction.
    """
    model = found.base.unknown.model
    for body, G in zip(model.bodies, found.inertias, strict=True):
        defects = G.defects()
        if defects and body.link in model.link_inertias:  # other bodies are massless, between two joints of one link
            raise ValueRangeError(f"the body of {body.link!r} cannot exist: {'; '.join(defects)}. Nothing is written.")
    q = _random_configurations(found.robot, np.random.default_rng(0))
    eigenvalues = np.linalg.eigvalsh(found.robot.mass_matrix(q))
    if eigenvalues.min() <= 0:
        raise ValueRangeError("the mass matrix is not positive at some configuration. Nothing is written.")
    max_residual = max(_MAX_RATIO_TO_FILE * found.of_file, found.of_file + _MAX_INCREASE)
    if found.held_out > max_residual:
        raise ValueRangeError(
            f"rows held out are explained to {percent(found.held_out, 3)}, and to {percent(found.of_file, 3)} by the file's "
            "own bodies with friction. Nothing is written."
        )
    remarks = []
    if found.held_out > found.of_file:
        remarks.append("the file's own bodies with friction explain rows held out as well")
    identified_mass = 0.0  # of all moving bodies
    file_mass = 0.0
    for body, G in zip(model.bodies, found.inertias, strict=True):
        identified_mass += float(G.mass)
        file_mass += float(body.inertia.mass)
    if file_mass > 0 and abs(identified_mass / file_mass - 1.0) > _MAX_MASS_CHANGE:
        remarks.append(f"the moving bodies weigh {number(identified_mass)} kg, in the file {number(file_mass)} kg")
    if found.repaired:
        remarks.append(
            f"the file's inertia of {', '.join(found.repaired)} was thickened first, as no body of volume has it"
        )
    return remarks


# ── Robot file and actuator file, written together or not at all

_KINDS = {
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "stribeck": "static friction above Coulomb's",
    "motor_inertia": "motor inertia",
}
"""Names of the kinds of joint values in notes."""


def write_identified(
    found: IdentifiedRobot,
    path: str | Path | None,
    actuators: str | Path | None,
    given: Mapping[str, object] | None,
    logs: Sequence[str],
    *,
    force: bool,
) -> tuple[str, ...]:
    """Write the robot's file to ``path`` and the actuator file to ``actuators``, and return the notes.

    ``given`` are entries of an actuator file that are kept, ``logs`` names of logs for a comment. Both texts are checked before
    the first file is written. The errors are those of :meth:`IdentifiedRobot.write`.
    """
    _check_writable(found, actuators, force=force)
    consistent = found.consistent
    notes = [*check_written(consistent), *_notes_on_losses(found, actuators)]
    notes += consistent.outside(found.interval(), found.standard_deviations)
    robot_file: WrittenRobot | None = None
    text_of_actuators: str | None = None
    if path is not None:
        robot_file = written_robot(found.original, consistent, _headline(found, logs))
    if actuators is not None:
        text_of_actuators = actuator_text(found.original.model, consistent, given, found.load_friction)
        difference = same_actuators(text_of_actuators, consistent)
        if not difference <= _MAX_DIFFERENCE:
            raise ValueRangeError("what was written of the actuators does not come back. Please report it.")
    if path is not None and robot_file is not None:
        with replacing(path) as temporary:
            temporary.write_bytes(robot_file.data)
        notes += _notes_on_robot_file(robot_file, as_path(path), has_actuator_file=text_of_actuators is not None)
    if actuators is not None and text_of_actuators is not None:
        with replacing(actuators) as temporary:
            temporary.write_text(text_of_actuators, encoding="utf-8")
    return tuple(notes)


def _check_writable(found: IdentifiedRobot, actuators: str | Path | None, *, force: bool) -> None:
    """Raise ValueRangeError if the result must not be written, or has no actuator file."""
    if not force:
        refuse_to_write(found.verdict, f"Pass {argument('force', True)} to write all the same.")
    if found.payload_frame is not None:
        raise ValueRangeError(
            "a payload alone is not a robot to write. Take found.payload, or with_payload of the robot."
        )
    motor_side = found.base.unknown.motor_side
    if actuators is not None and motor_side is not None and motor_side.names:
        raise ValueRangeError(f"actuators: {OF_COUPLED_MOTORS}. found.to_dict() has the results.")


def _notes_on_losses(found: IdentifiedRobot, actuators: str | Path | None) -> list[str]:
    """Remarks on results that none of the written files contains."""
    notes = []
    coupled_friction = _named_values(found.consistent.of_several_joints)
    if coupled_friction:
        notes.append(
            f"no file format represents friction of one motor in several joints: {coupled_friction}. Without it, "
            "the torques of these joints are not predicted as they are here"
        )
    # an actuator file stores load friction
    removed_causes = [cause for cause in found.settings.assumed if cause.kind != "load-friction"]
    notes += [f"the files are of the log without {cause}" for cause in removed_causes]
    if found.load_friction and actuators is None:
        notes.append(
            f"load friction stands in an actuator file only, and none is written: {_named_values(found.load_friction)}"
        )
    return notes


def _headline(found: IdentifiedRobot, logs: Sequence[str]) -> str:
    """Comment at the top of the robot's file."""
    origin = f" from {', '.join(logs)}" if logs else ""
    text = (
        f"version {__version__}, {date.today().isoformat()}{origin}: {found.base.count} "
        f"groups, {percent(found.held_out.all, 3)} of the torques left in rows held out ({found.held_out.kind}), weight of "
        f"the prior {number(found.consistent.fit.strength)}"
    )
    coupled_friction = _named_values(found.consistent.of_several_joints)
    return f"{text}; not in it: {coupled_friction}" if coupled_friction else text


def _notes_on_robot_file(robot_file: WrittenRobot, path: Path, *, has_actuator_file: bool) -> list[str]:
    """Remarks on the robot's file; ``has_actuator_file``: True if an actuator file is written too."""
    notes = [f"{link} is part of the link that carries it now" for link in robot_file.folded]
    if robot_file.folder is not None and path.resolve().parent != robot_file.folder:
        notes.append(
            f"the robot's file names other files from the folder it came from, {robot_file.folder}: keep the new one there"
        )
    place = "it stands in an actuator file only, and none is written"
    if has_actuator_file:
        place = "the actuator file has it"
    for kind, values in robot_file.missing.items():
        notes.append(f"the robot's file has no place for this {_KINDS[kind]}; {place}: {_named_values(values)}")
    return notes


def _named_values(values: Mapping[str, float]) -> str:
    """Names with their values, separated by commas; empty without any."""
    return ", ".join(f"{name} {number(value)}" for name, value in values.items())
