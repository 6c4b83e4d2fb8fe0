"""What was identified, written into the text of the robot's file: the numbers concerned, everything else as it stands.

A body of the model is a moving link with the links that are fixed to it; the change goes to the moving link. Where what is left
for it is no body that can exist, the fixed links are folded into it. What was written is read again and compared before a file
is put in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..diagnosis.described import DescribedRobot
from ..diagnosis.editing import edited, encoded
from ..diagnosis.findings import Edit, Place
from ..diagnosis.reading import Subject, read_subject
from ..errors import ModelError, RobotFileError, ValueRangeError
from ..formats.element import Element
from ..formats.urdf import PRODUCTS, origin_of
from ..formats.xml_parser import parse
from ..model.model import Model
from ..robot import Robot, load
from ..typing import Array
from .consistent_robot import ConsistentRobot

SIGNATURE = "twistwrench identify"
_SAME = 1e-12
_STATES = 200


@dataclass(frozen=True, eq=False)
class WrittenRobot:
    """A robot file with identified numbers, not yet on disk.

    Attributes
    ----------
    text : str
    data : bytes, as the file it came from is encoded
    difference : float, of torques of the file read again, as a share of the largest
    folded : tuple of str, fixed links whose inertia went into the links that carry them
    notes : tuple of str, what could not be written
    """

    text: str
    data: bytes
    difference: float
    folded: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(eq=False)
class _Changes:
    edits: list[tuple[Edit, str]] = field(default_factory=list)
    additions: dict[int, str] = field(default_factory=dict)
    folded: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def written_robot(original: Robot, found: ConsistentRobot, said: str) -> WrittenRobot:
    """The file of ``original`` with the bodies and the friction of ``found``; ``said`` goes into a comment at its top.

    Raises ModelError where the robot has no file or its format has no place for a number, and RobotFileError where what was
    written does not come back.
    """
    subject = read_subject(original, meshes=False)
    if not subject.text:
        raise ModelError(
            f"robot {original.name!r} was not read from a file, so there is none to write into. tw.save(found.robot, path) "
            "writes a new one."
        )
    root = parse(subject.text)
    numbers = {id(element): k for k, element in enumerate(root.walk())}
    links = {element.text("name"): element for element in root.all("link")} if subject.robot.format == "urdf" else {}
    changes = _Changes()
    wanted = _link_inertias(found, changes)
    model = found.base.unknown.model
    for link, before in subject.robot.model.link_inertias.items():
        if before.mass > 0 and link in model.link_inertias and not model.link_inertias[link].parameters.any():
            wanted.setdefault(link, SpatialInertia.zero())  # left out: see without_links
    for link, inertia in wanted.items():
        _write_link(link, inertia, subject.robot, links.get(link), numbers, changes)
    if subject.robot.format == "urdf":
        _write_friction(found, root, numbers, changes)
        changes.additions[0] = f"<!-- {SIGNATURE}: {said.replace('--', '- -')} -->"
    else:
        changes.notes.append("friction is written into the actuator file only")
    text = edited(subject.text, changes.edits, additions=changes.additions, signature=SIGNATURE)
    difference = _difference(text, subject, found)
    if not difference <= _SAME:
        raise RobotFileError(
            f"what was written does not come back: torques differ by {difference:.2g} of the largest. Please report it."
        )
    return WrittenRobot(text, encoded(text, subject.data), difference, tuple(changes.folded), tuple(changes.notes))


def _link_inertias(found: ConsistentRobot, changes: _Changes) -> dict[str, SpatialInertia]:
    """The inertia that each link is to have, in its own frame; those that change."""
    model = found.base.unknown.model
    wanted: dict[str, SpatialInertia] = {}
    for i, (body, whole) in enumerate(zip(model.bodies, found.inertias, strict=True)):
        others = {
            link: model.link_inertias[link].in_frame(frame.pose)
            for link, frame in model.frames.items()
            if frame.body == i and link != body.link and link in model.link_inertias
        }
        left = whole
        for G in others.values():
            left = left - G
        if others and (left.mass <= 0 or left.defects()):
            heavy = [link for link, G in others.items() if G.parameters.any()]
            changes.folded += heavy
            wanted |= dict.fromkeys(heavy, SpatialInertia.zero())
            left = whole
        wanted[body.link] = left
    return wanted


def _write_link(
    link: str,
    inertia: SpatialInertia,
    described: DescribedRobot,
    element: Element | None,
    numbers: Mapping[int, int],
    changes: _Changes,
) -> None:
    why = (
        "identified from logs"
        if inertia.parameters.any()
        else "in none of the logs, or part of the link that carries it"
    )
    written = described.links[link].written if link in described.links else None
    if written is not None and not inertia.parameters.any():
        zero = {name: place for name, place in written.places.items() if name in ("mass", *PRODUCTS)}
        changes.edits += [(Edit(place, "0"), why) for place in zero.values()]
        return
    edits = () if written is None else written.exact_edits(inertia)
    if edits:
        changes.edits += [(edit, why) for edit in edits]
        return
    if element is None:
        raise ModelError(
            f"the inertia of {link!r} has no place for all ten numbers in this file. Convert the robot to URDF first: "
            "twistwrench convert."
        )
    _add_inertial(link, inertia, element, numbers, changes, why)


def _add_inertial(
    link: str, inertia: SpatialInertia, element: Element, numbers: Mapping[int, int], changes: _Changes, why: str
) -> None:
    """Into a URDF whose link has no <inertial>, or one without an <origin>."""
    inertial = element.child("inertial")
    com = " ".join(map(repr, inertia.com.tolist()))
    if inertial is None:
        I = inertia.moment_about_com
        entries = dict(zip(PRODUCTS, (I[0, 0], I[0, 1], I[0, 2], I[1, 1], I[1, 2], I[2, 2]), strict=True))
        tensor = " ".join(f'{name}="{float(value)!r}"' for name, value in entries.items())
        changes.additions[numbers[id(element)]] = (
            f'<inertial><origin xyz="{com}" rpy="0 0 0"/><mass value="{float(inertia.mass)!r}"/><inertia {tensor}/></inertial>'
        )
        return
    origin = inertial.child("origin")
    if origin is not None:
        raise ModelError(f'the <origin> of {link!r} has no xyz, so its centre of mass has no place. Add xyz="0 0 0".')
    R = origin_of(inertial)[:3, :3]
    moments = R.T @ inertia.moment_about_com @ R
    changes.additions[numbers[id(inertial)]] = f'<origin xyz="{com}" rpy="0 0 0"/>'
    mass, tensor_element = inertial.required("mass", "a mass"), inertial.required("inertia", "an inertia")
    changes.edits.append((Edit(Place(numbers[id(mass)], "value"), repr(float(inertia.mass))), why))
    places = dict(zip(PRODUCTS, ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), strict=True))
    for name, (i, j) in places.items():
        edit = Edit(Place(numbers[id(tensor_element)], name), repr(float(0.5 * (moments[i, j] + moments[j, i]))))
        changes.edits.append((edit, why))


def _write_friction(found: ConsistentRobot, root: Element, numbers: Mapping[int, int], changes: _Changes) -> None:
    joints = {element.text("name"): element for element in root.all("joint")}
    laws = {"damping": found.of_joints("viscous"), "friction": found.of_joints("coulomb")}
    for name in found.base.unknown.model.velocity_names:
        values = {key: law[name] for key, law in laws.items() if name in law}
        if name not in joints or not values:
            continue
        dynamics = joints[name].child("dynamics")
        if dynamics is None:
            entries = " ".join(f'{key}="{value!r}"' for key, value in values.items())
            changes.additions[numbers[id(joints[name])]] = f"<dynamics {entries}/>"
            continue
        for key, value in values.items():
            if key in dynamics.attributes:
                changes.edits.append((Edit(Place(numbers[id(dynamics)], key), repr(value)), "identified from logs"))
            else:
                changes.notes.append(f"<dynamics> of {name} has no {key}, so {value:.4g} is in the actuator file only")


def _difference(text: str, subject: Subject, found: ConsistentRobot) -> float:
    """Largest difference of torques of the text read again, as a share of the largest torque, over random states."""
    folders = [] if subject.path is None else [subject.path.resolve().parent]
    again = load(text, include_paths=folders, inertia="accept", model=subject.model).model
    model = found.base.unknown.model
    bodies = [np.zeros(10) for _ in model.bodies]
    for link, frame in model.frames.items():
        if frame.body >= 0 and link in again.link_inertias:
            bodies[frame.body] = bodies[frame.body] + again.link_inertias[link].in_frame(frame.pose).parameters
    rng = np.random.default_rng(0)
    robot = found.base.unknown.robot
    q = np.stack([robot.random_configuration(rng) for _ in range(_STATES)])
    dq, ddq = rng.normal(size=(2, _STATES, robot.nv))
    Y = robot.regressor(q, dq, ddq)
    right = Y @ np.concatenate([G.parameters for G in found.inertias])
    return float(np.abs(Y @ np.concatenate(bodies) - right).max() / max(np.abs(right).max(), 1e-300))


def check_written(found: ConsistentRobot) -> list[str]:
    """Sentences on what the robot became; raises ValueRangeError where it must not be written.

    Every body must be one that can exist, M positive, and rows held out no worse than by the file's bodies with friction.
    """
    model = found.base.unknown.model
    for body, G in zip(model.bodies, found.inertias, strict=True):
        if said := G.defects():
            raise ValueRangeError(f"the body of {body.link!r} cannot exist: {'; '.join(said)}. Nothing is written.")
    robot = found.robot
    rng = np.random.default_rng(0)
    q = np.stack([robot.random_configuration(rng) for _ in range(_STATES)])
    if np.linalg.eigvalsh(robot.mass_matrix(q)).min() <= 0:
        raise ValueRangeError("the mass matrix is not positive at some configuration. Nothing is written.")
    if found.held_out > found.of_file:
        raise ValueRangeError(
            f"rows held out are explained to {100 * found.held_out:.3g} %, and to {100 * found.of_file:.3g} % by the file's "
            "own bodies with friction. Nothing is written."
        )
    said = []
    mass, before = (
        sum(float(b.mass) for b in bodies) for bodies in (found.inertias, [b.inertia for b in model.bodies])
    )
    if before > 0 and abs(mass / before - 1.0) > 0.2:
        said.append(f"the moving bodies weigh {mass:.4g} kg, in the file {before:.4g} kg")
    if found.repaired:
        said.append(
            f"the file's inertia of {', '.join(found.repaired)} was thickened first, as no body of volume has it"
        )
    return said


def actuator_text(model: Model, found: ConsistentRobot, given: Mapping[str, object] | None = None) -> str:
    """An actuator file with friction and motor inertias; entries that were ``given`` stay, but for these.

    With a known ratio the motor's inertia is that of an extra rotor, Ia / ratio²; without, the reflected one.
    """
    import yaml

    content: dict[str, object] = {"robot": model.name, **dict(given or {})}
    entries = {name: dict(entry) for name, entry in dict(content.get("actuators", {}) or {}).items()}  # type: ignore[call-overload]
    sliding = {b.joint.name for b in model.leaders if not b.joint.turning[0]}
    inertia, viscous = found.of_joints("motor_inertia"), found.of_joints("viscous")
    coulomb, offset = found.of_joints("coulomb"), found.of_joints("offset")
    for name in model.velocity_names:
        entry = entries.setdefault(name, {})
        slides = name in sliding
        if name in inertia:
            entry.pop("rotor", None)
            entry["reflected_inertia"] = f"{inertia[name]!r} {'kg' if slides else 'kg m^2'}"
        law = {}
        if name in viscous:
            law["viscous"] = f"{viscous[name]!r} {'N s/m' if slides else 'N m s/rad'}"
        if name in coulomb:
            law["coulomb"] = f"{coulomb[name]!r} {'N' if slides else 'N m'}"
        if law:
            entry["friction"] = law
    content["actuators"] = entries
    head = f"# {SIGNATURE}: friction and motor inertias as the joints feel them\n"
    if offset:
        head += "".join(f"# offset of the torque of {name}: {value:.6g}\n" for name, value in offset.items())
    head += "".join(
        f"# of several joints, not read: {name} {value!r}\n" for name, value in found.of_several_joints.items()
    )
    return head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def same_actuators(text: str, found: ConsistentRobot) -> float:
    """Largest difference of friction and armature of an actuator file read again, as a share of the largest."""
    import yaml

    model = found.base.unknown.model
    bare = replace(model, armature=np.zeros(model.nv))
    again = Robot(bare).with_actuators(yaml.safe_load(text)).model
    right = found.robot.model
    pairs: list[tuple[Array, Array]] = [
        (again.armature, right.armature),
        (again.friction.viscous, right.friction.viscous),
        (again.friction.coulomb, right.friction.coulomb),
    ]
    size = max(float(np.abs(b).max()) for _, b in pairs)
    return max(float(np.abs(a - b).max()) for a, b in pairs) / max(size, 1e-300)
