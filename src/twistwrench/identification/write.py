"""Writing of identified parameters to actuator files and to the robot file, in which only the numbers change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import ModelError, RobotFileError, ValueRangeError
from ..core.files import as_path, replacing
from ..core.numbers import number, percent
from ..core.text import argument
from ..core.verdict import Word
from ..core.version import __version__
from ..diagnosis.subject import Subject, read_subject
from ..formats.edit import TextChanges, encode_as
from ..formats.robot_text import TEXTS
from ..formats.xml import Element
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.joints.units import unit_of
from ..mechanics.lie import se3
from ..mechanics.model.model import BASE, Model
from ..robot import Robot, load
from .consistent import ConsistentRobot

if TYPE_CHECKING:
    from .result import IdentifiedRobot

OF_COUPLED_MOTORS = (
    "coupled motors have friction beside that of their joints here, which actuator files do not represent"
)
"""Reason why coupled motors get no actuator file."""
SIGNATURE = "twistwrench identify"
"""Beginning of comments in written files."""


def actuator_text(
    model: Model,
    found: ConsistentRobot,
    given: Mapping[str, object] | None = None,
    load: Mapping[str, float] | None = None,
) -> str:
    """Actuator file with identified friction and motor inertias; other entries of ``given`` are kept.

    ``load`` is the load friction of joints, as a share of the carried torque. If the ratio is known, the motor inertia
    is written as an additional rotor, Ia / ratio²; otherwise as reflected inertia.
    """
    import yaml

    content: dict[str, Any] = {"robot": model.name, **dict(given or {})}
    entries: dict[str, dict[str, Any]] = {name: dict(x) for name, x in (content.get("actuators") or {}).items()}
    kinds = ("motor_inertia", "viscous", "coulomb", "stribeck", "offset")
    inertia, viscous, coulomb, stribeck, offset = map(found.of_joints, kinds)
    for joint in (body.joint for body in model.leaders):
        name, turns = joint.name, bool(joint.turning[0])
        entry, law = entries.setdefault(name, {}), dict[str, str]()
        if name in inertia:
            entry.pop("rotor", None)
            entry["reflected_inertia"] = f"{inertia[name]!r} {'kg m^2' if turns else 'kg'}"
        if name in viscous:
            law["viscous"] = f"{viscous[name]!r} {'N m s/rad' if turns else 'N s/m'}"
        if name in coulomb:
            law["coulomb"] = f"{coulomb[name]!r} {unit_of('tau', turns)}"
        if name in stribeck:
            law["static"] = f"{coulomb.get(name, 0.0) + stribeck[name]!r} {unit_of('tau', turns)}"
            law["stribeck"] = f"{found.base.unknown.stribeck_speed!r} {unit_of('dq', turns)}"
        if load and name in load:
            law["load"] = repr(load[name])
        if law:
            entry["friction"] = law
    content["actuators"] = entries
    head = f"# {SIGNATURE}: friction and motor inertias, reflected to the joints\n"
    head += "".join(
        f"# offset of the measured torque of {name}, not read: {number(value, 6)}\n" for name, value in offset.items()
    )
    together = found.of_several_joints.items()
    head += "".join(f"# of several joints, not read: {name} {value!r}\n" for name, value in together)
    return head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def same_actuators(text: str, found: ConsistentRobot) -> float:
    """Largest difference of friction and armature after reading an actuator file back, as a share of the largest value."""
    import yaml

    model = found.base.unknown.model
    bare = replace(model, armature=np.zeros(model.nv))
    again = Robot(bare).with_actuators(yaml.safe_load(text)).model
    right = found.robot.model
    has, wanted = (
        np.concatenate([m.armature, m.friction.viscous, m.friction.coulomb, m.friction.static]) for m in (again, right)
    )
    return float(np.abs(has - wanted).max() / max(np.abs(wanted).max(), 1e-300))


# ── The robot's file: only numbers change

# A body of the model is a moving link with the links fixed to it; the change is applied to the moving link. If the
# remaining inertia of the moving link is not physically consistent, the fixed links are folded into it. The written
# text is read back and compared before it replaces a file.

_SAME = 1e-12
_STATES = 200
_AS_GOOD = 1.05
"""Ratio to the held-out residual of the file's bodies with friction up to which a robot is as good as these."""
_IMMATERIAL = 0.002  # negligible increase of the residual, as a share of the torques


@dataclass(frozen=True, eq=False)
class WrittenRobot:
    """Robot file with identified parameters, before it is written to disk."""

    text: str
    data: bytes  # in the encoding of the original file
    difference: float  # of torques after reading back, as a share of the largest
    folded: tuple[str, ...]  # fixed links whose inertia was added to the carrying links
    missing: Mapping[str, Mapping[str, float]]  # values by kind and joint that the file cannot store
    folder: Path | None  # base folder of relative paths in the file, such as meshes; None without any


def written_robot(original: Robot, found: ConsistentRobot, said: str) -> WrittenRobot:
    """File of ``original`` with the bodies and drives of ``found``; ``said`` becomes a comment at its top.

    Raises ModelError if the robot has no file or its format cannot store a value, and RobotFileError if reading back
    the text gives other values.
    """
    subject = read_subject(original, meshes=False)
    if subject.root is None:
        raise ModelError(
            f"robot {original.name!r} was not read from a file, so there is none to write into. tw.save(found.robot, path) "
            "writes a new one."
        )
    root = subject.root
    inertias, folded = _link_inertias(found, TEXTS[subject.robot.format].share_left)
    drives = wanted = _drives(found)

    def off(wanted: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
        return _off(_again(_text(subject, root, found, said, inertias, wanted), subject, found), drives)

    beside = off(wanted)
    if any(value > 0 for of_kind in beside.values() for value in of_kind.values()):
        # subtract the part of actuators, which the file stores separately
        wanted = {
            kind: {joint: max(0.0, x - max(0.0, beside.get(kind, {}).get(joint, 0.0))) for joint, x in of_kind.items()}
            for kind, of_kind in drives.items()
        }
        beside = off(wanted)
    missing = {kind: {joint: drives[kind][joint] for joint in of_kind} for kind, of_kind in beside.items()}
    lacking = [f"{kind} {joint} {number(x)}" for kind, of_kind in missing.items() for joint, x in of_kind.items()]
    text = _text(
        subject, root, found, f"{said}; not in it: {', '.join(lacking)}" if lacking else said, inertias, wanted
    )
    difference = _difference(_again(text, subject, found), found)
    if not difference <= _SAME:
        raise RobotFileError(
            f"what was written does not come back: torques differ by {number(difference, 2)} of the largest. Please report it."
        )
    folder = subject.path.resolve().parent if subject.path is not None and _names_files(root) else None
    return WrittenRobot(text, encode_as(text, subject.data), difference, tuple(folded), missing, folder)


def _names_files(root: Element) -> bool:
    """True if the file refers to others by relative paths: includes, meshes, textures."""
    elements = list(root.walk())
    if any(element.file for element in elements):
        return True
    named = [element.attributes.get(key, "") for element in elements for key in ("file", "filename")]
    named += [element.content.strip() for element in elements if element.tag == "uri"]
    return any(name and "://" not in name and not name.startswith("/") for name in named)


def _text(
    subject: Subject,
    root: Element,
    found: ConsistentRobot,
    said: str,
    inertias: Mapping[str, SpatialInertia],
    drives: Mapping[str, Mapping[str, float]],
) -> str:
    """Text of the file with new inertias of links and values of joints; values of mimic joints are 0."""
    changes = TextChanges(SIGNATURE)
    model = found.base.unknown.model
    file = TEXTS[subject.robot.format](root, model.name, subject.path)
    before = subject.robot.model.link_inertias
    file.write_links(changes, {
        link: G
        for link, G in inertias.items()
        if link not in before or not np.array_equal(before[link].parameters, G.parameters)
    })  # fmt: skip
    for joint in model.velocity_names:
        file.write_joint(changes, joint, {kind: of_kind[joint] for kind, of_kind in drives.items() if joint in of_kind})
    for body in model.bodies:
        if body.follows:
            file.write_joint(changes, body.joint.name, dict.fromkeys(drives, 0.0), "part of the joint that it follows")
    changes.add(root, f"<!-- {SIGNATURE}: {said.replace('--', '- -')} -->")
    return changes.apply(subject.text)


def _link_inertias(found: ConsistentRobot, share: float) -> tuple[dict[str, SpatialInertia], list[str]]:
    """Inertia of each moving link in its own frame, and names of fixed links that were folded into others.

    A folded link keeps a ``share`` of the whole body's inertia, which is physically consistent like the whole.
    """
    model = found.base.unknown.model
    wanted, folded = dict[str, SpatialInertia](), list[str]()
    for i, (body, whole) in enumerate(zip(model.bodies, found.inertias, strict=True)):
        if body.link not in model.link_inertias:
            continue  # massless body between two joints of one link
        mine = {
            link: frame.pose for link, frame in model.frames.items() if frame.body == i and link in model.link_inertias
        }
        others = {link: model.link_inertias[link] for link in mine if link != body.link}
        left = whole
        for link, G in others.items():
            left = left - G.in_frame(mine[link])
        if others and (left.mass <= 0 or left.defects()):
            heavy = [link for link, G in others.items() if G.parameters.any()]
            part = SpatialInertia(share * whole.parameters)
            others = {
                link: part.in_frame(se3.inverse(mine[link])) if share else SpatialInertia.zero() for link in heavy
            }
            left = SpatialInertia((1.0 - share * len(heavy)) * whole.parameters)
            folded += heavy
        wanted |= {**others, body.link: left}
    return wanted, folded


def _drives(found: ConsistentRobot) -> dict[str, dict[str, float]]:
    """Values of the joints by kind: identified friction and motor inertias; 0 if not identified."""
    model = found.base.unknown.model
    sought = {kind: found.of_joints(kind) for kind in ("viscous", "coulomb", "stribeck")}
    inertias = dict.fromkeys(model.velocity_names, 0.0) | found.of_joints("motor_inertia")
    return {kind: values for kind, values in sought.items() if values} | {"motor_inertia": inertias}


def _again(text: str, subject: Subject, found: ConsistentRobot) -> Model:
    """Read the text with the options of the robot's file."""
    folders = [] if subject.path is None else [subject.path.resolve().parent]
    given: dict[str, Any] = {"include_paths": folders, "inertia": "accept", "model": subject.model}
    model = load(text, **given).model
    joints = set(found.base.unknown.model.velocity_names)
    return model if joints <= set(model.velocity_names) else load(text, **given, mimic="independent").model


def _off(again: Model, drives: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Deviations of joint values from the requested ones, without rounding errors."""
    friction = again.friction
    above = np.asarray(friction.static) - friction.coulomb
    has = {"viscous": friction.viscous, "coulomb": friction.coulomb, "stribeck": above, "motor_inertia": again.armature}
    place = {name: k for k, name in enumerate(again.velocity_names)}
    found: dict[str, dict[str, float]] = {}
    for kind, of_kind in drives.items():
        size = max(map(abs, of_kind.values()), default=0.0)
        for joint, value in of_kind.items():
            off = float(has[kind][place[joint]]) - value if joint in place else -value
            if abs(off) > _SAME * size:
                found.setdefault(kind, {})[joint] = off
    return found


def _difference(again: Model, found: ConsistentRobot) -> float:
    """Largest difference of torques after reading the text back, over random states, as a share of the largest torque."""
    model = found.base.unknown.model
    bodies = [np.zeros(10) for _ in model.bodies]
    for link, frame in model.frames.items():
        if frame.body != BASE and link in again.link_inertias:
            bodies[frame.body] = bodies[frame.body] + again.link_inertias[link].in_frame(frame.pose).parameters
    rng = np.random.default_rng(0)
    robot = found.base.unknown.robot
    q = np.stack([robot.random_configuration(rng) for _ in range(_STATES)])
    dq, ddq = rng.normal(size=(2, _STATES, robot.nv))
    Y = robot.regressor(q, dq, ddq)
    right = Y @ np.concatenate([G.parameters for G in found.inertias])
    return float(np.abs(Y @ np.concatenate(bodies) - right).max() / max(np.abs(right).max(), 1e-300))


def check_written(found: ConsistentRobot) -> list[str]:
    """Sentences on changes of the robot; raises ValueRangeError if it must not be written.

    Every body must be physically consistent, M positive definite, and the held-out residual no
    larger than that of the file's bodies with friction.
    """
    model = found.base.unknown.model
    for body, G in zip(model.bodies, found.inertias, strict=True):
        if body.link in model.link_inertias and (said := G.defects()):
            raise ValueRangeError(f"the body of {body.link!r} cannot exist: {'; '.join(said)}. Nothing is written.")
    robot = found.robot
    rng = np.random.default_rng(0)
    q = np.stack([robot.random_configuration(rng) for _ in range(_STATES)])
    if np.linalg.eigvalsh(robot.mass_matrix(q)).min() <= 0:
        raise ValueRangeError("the mass matrix is not positive at some configuration. Nothing is written.")
    if found.held_out > max(_AS_GOOD * found.of_file, found.of_file + _IMMATERIAL):
        raise ValueRangeError(
            f"rows held out are explained to {percent(found.held_out, 3)}, and to {percent(found.of_file, 3)} by the file's "
            "own bodies with friction. Nothing is written."
        )
    said = []
    if found.held_out > found.of_file:
        said.append("the file's own bodies with friction explain rows held out as well")
    mass, before = sum(float(G.mass) for G in found.inertias), sum(float(b.inertia.mass) for b in model.bodies)
    if before > 0 and abs(mass / before - 1.0) > 0.2:
        said.append(f"the moving bodies weigh {number(mass)} kg, in the file {number(before)} kg")
    if found.repaired:
        said.append(
            f"the file's inertia of {', '.join(found.repaired)} was thickened first, as no body of volume has it"
        )
    return said


# ── Robot file and actuator file, written together or not at all

_KINDS = {
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "stribeck": "static friction above Coulomb's",
    "motor_inertia": "motor inertia",
}


def write_identified(
    found: IdentifiedRobot,
    path: str | Path | None,
    actuators: str | Path | None,
    given: Mapping[str, object] | None,
    logs: Sequence[str],
    *,
    force: bool,
) -> tuple[str, ...]:
    """Write both files and return the notes; raises as :meth:`IdentifiedRobot.write` does, without writing."""
    if found.verdict.word is Word.LOOK_AGAIN and not force:
        raise ValueRangeError(
            f"nothing is written after {found.verdict}. Pass {argument('force', True)} to write all the same."
        )
    if found.payload_frame is not None:
        raise ValueRangeError(
            "a payload alone is not a robot to write. Take found.payload, or with_payload of the robot."
        )
    side = found.base.unknown.motor_side
    if actuators is not None and side is not None and side.names:
        raise ValueRangeError(f"actuators: {OF_COUPLED_MOTORS}. found.to_dict() has the results.")
    consistent = found.consistent
    notes = check_written(consistent)
    if together := _numbers(consistent.of_several_joints):
        notes.append(
            f"no file format represents friction of one motor in several joints: {together}. Without it, "
            "the torques of these joints are not predicted as they are here"
        )
    notes += [
        f"the files are of the log without {one}" for one in found.settings.assumed if one.kind != "load-friction"
    ]
    if found.load_friction and actuators is None:
        notes.append(
            f"load friction stands in an actuator file only, and none is written: {_numbers(found.load_friction)}"
        )
    notes += consistent.outside(found.interval(), found.standard_deviations)
    made = None if path is None else written_robot(found.original, consistent, _headline(found, logs))
    text = None if actuators is None else actuator_text(found.original.model, consistent, given, found.load_friction)
    if text is not None and not same_actuators(text, consistent) <= _SAME:
        raise ValueRangeError("what was written of the actuators does not come back. Please report it.")
    if path is not None and made is not None:
        with replacing(path) as scratch:
            scratch.write_bytes(made.data)
        notes += _notes(made, as_path(path), beside=text is not None)
    if actuators is not None and text is not None:
        with replacing(actuators) as scratch:
            scratch.write_text(text, encoding="utf-8")
    return tuple(notes)


def _headline(found: IdentifiedRobot, logs: Sequence[str]) -> str:
    """Comment at the top of the robot's file."""
    said = (
        f"version {__version__}, {date.today().isoformat()}{' from ' + ', '.join(logs) if logs else ''}: {found.base.count} "
        f"groups, {percent(found.held_out.all, 3)} of the torques left in rows held out ({found.held_out.kind}), weight of "
        f"the prior {number(found.consistent.fit.strength)}"
    )
    together = _numbers(found.consistent.of_several_joints)
    return f"{said}; not in it: {together}" if together else said


def _notes(made: WrittenRobot, path: Path, *, beside: bool) -> list[str]:
    """Remarks on the robot's file; ``beside``: True if an actuator file is written too."""
    notes = [f"{link} is part of the link that carries it now" for link in made.folded]
    if made.folder is not None and path.resolve().parent != made.folder:
        notes.append(
            f"the robot's file names other files from the folder it came from, {made.folder}: keep the new one there"
        )
    where = "the actuator file has it" if beside else "it stands in an actuator file only, and none is written"
    return notes + [
        f"the robot's file has no place for this {_KINDS[kind]}; {where}: {_numbers(values)}"
        for kind, values in made.missing.items()
    ]


def _numbers(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {number(value)}" for name, value in values.items())
