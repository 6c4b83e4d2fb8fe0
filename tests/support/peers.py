"""A robot's file as other libraries read it: what a comparison with them starts from."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from twistwrench.core.errors import MissingExtraError, ModelError, ModelWarning, NotFoundError, RobotFileError
from twistwrench.core.numbers import printed
from twistwrench.core.third_party import capture_stderr
from twistwrench.formats import format_of_file, load_model
from twistwrench.formats.source import read_robot_text
from twistwrench.formats.xml import parse
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.lie import quaternion
from twistwrench.mechanics.model.assembly import ROOT_JOINT
from twistwrench.robot import Robot


def pinocchio_model(robot: Robot) -> Any:
    """Pinocchio's model of the file that ``robot`` came from, under the robot's gravity; its mimic joints independent.

    Raises: MissingExtraError, NotFoundError for a robot without a file, RobotFileError where Pinocchio refuses it.
    """
    path = _file_of(robot)
    if (kind := format_of_file(path)) != "urdf":
        raise RobotFileError(f"{path.name} is {kind.upper()}; with Pinocchio, URDF files are compared.")
    try:
        import pinocchio
    except ImportError:
        raise MissingExtraError.from_extra("pin", "peers", "Comparing with Pinocchio") from None
    root = [pinocchio.JointModelFreeFlyer()] if _floats(robot) else []
    with _read_by("Pinocchio", path):
        model = pinocchio.buildModelFromUrdf(str(path), *root)
    model.gravity.linear = robot.gravity
    return model


def mujoco_model(robot: Robot) -> Any:
    """MuJoCo's model of the same file: no contacts, constraints, limits, passive forces; only the mechanics is left.

    Its shapes are left out, so that no mesh is opened. Raises as :func:`pinocchio_model`.
    """
    path = _file_of(robot)
    kind = format_of_file(path)
    if kind not in ("urdf", "mjcf"):
        raise RobotFileError(f"{path.name} is {kind.upper()}, which MuJoCo does not read.")
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError.from_extra("mujoco", "peers", "Comparing with MuJoCo") from None
    with _read_by("MuJoCo", path):
        if kind == "mjcf":
            model = mujoco.MjModel.from_xml_path(str(path))
        else:
            model = mujoco.MjSpec.from_string(_for_mujoco(path, floating=_floats(robot))).compile()
    for name, flag in mujoco.mjtDisableBit.__members__.items():
        if name not in ("mjDSBL_GRAVITY", "mjDSBL_EULERDAMP", *(("mjDSBL_SPRING",) if kind == "mjcf" else ())):
            model.opt.disableflags |= int(flag.value)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)  # none is said by the robot's gravity
    model.opt.gravity[:] = robot.gravity
    model.opt.density = model.opt.viscosity = 0.0  # a fluid is not part of the robot, and remarked on
    if kind == "urdf":
        _check_bodies(robot, model)
    return model


def _check_bodies(robot: Robot, model: Any) -> None:
    """MuJoCo changes bodies that cannot exist, and drops fixed links without mass: then it is another robot."""
    joints = {model.joint(i).name: int(model.joint(i).bodyid[0]) for i in range(model.njnt)}
    for body in robot.model.bodies:
        i, G = joints.get(body.joint.name), body.inertia
        if i is None:
            continue
        R = quaternion.rotation(model.body_iquat[i])
        theirs = SpatialInertia.from_com(
            model.body_mass[i], model.body_ipos[i], R @ np.diag(model.body_inertia[i]) @ R.T
        )
        gap = np.abs(theirs.parameters - G.parameters).max()
        if gap > 1e-9 * np.abs(G.parameters).max():
            raise ModelError(f"MuJoCo changes the body of joint {body.joint.name!r}, by up to {printed(gap, 2)} kg m².")


def _for_mujoco(path: Path, *, floating: bool) -> str:
    """The file's text for MuJoCo: without shapes, fixed links fused, the root on a free joint if wanted."""
    from xml.etree import ElementTree as Tree

    text = read_robot_text(path)[0].lstrip("\ufeff \t\r\n")
    parse(text)  # refuses what is not safe to read: entities
    root = Tree.fromstring(text)
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for extension in root.findall("mujoco"):
        root.remove(extension)
    if floating:
        children = {child.get("link") for child in root.iter("child")}
        base = next(link.attrib["name"] for link in root.findall("link") if link.get("name") not in children)
        if base == "world":  # to MuJoCo that is the world itself, which cannot move
            base = "floating world"
            for element in root.iter():
                for key in ("name", "link"):
                    if element.tag in ("link", "parent") and element.get(key) == "world":
                        element.set(key, base)
        Tree.SubElement(root, "link", name=f"{ROOT_JOINT} world")
        joint = Tree.SubElement(root, "joint", name=ROOT_JOINT, type="floating")
        Tree.SubElement(joint, "parent", link=f"{ROOT_JOINT} world")
        Tree.SubElement(joint, "child", link=base)
    Tree.SubElement(Tree.SubElement(root, "mujoco"), "compiler", fusestatic="true", balanceinertia="false")
    return Tree.tostring(root, encoding="unicode")


def _file_of(robot: Robot) -> Path:
    path = Path(robot.model.source)
    if not robot.model.source or not path.is_file():
        raise NotFoundError(f"robot {robot.name!r} has no file that another library could read; load it from a path.")
    return path


def _floats(robot: Robot) -> bool:
    return any(body.joint.name == ROOT_JOINT for body in robot.model.bodies)


@contextlib.contextmanager
def _read_by(library: str, path: Path) -> Iterator[None]:
    """Turn whatever the library raises into RobotFileError, with what it wrote to standard error, which nobody sees else."""
    problem: Exception | None = None
    with capture_stderr() as said:
        try:
            yield
        except Exception as raised:  # whatever its parsers raise
            problem = raised
    if problem is not None:
        more = f"; it wrote: {said}" if str(said) else ""
        raise RobotFileError(
            f"{library} does not read {path.name}: {' '.join(str(problem).split())[:200]}{more}"
        ) from None


def file_gap(robot: Robot) -> float:
    """How far the robot's numbers are from those of its file: some 1e-9 at most, by which loading snaps rotations.

    Raises ModelError for a robot edited since, or loaded with locked joints or repaired inertias.
    """
    model = robot.model
    mimic = "follow" if any(body.follows for body in model.bodies) else "independent"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        read = load_model(
            _file_of(robot), floating_base=_floats(robot) or None, mimic=mimic, inertia="accept", snap=0.0
        )
    if [b.joint.name for b in read.bodies] != [b.joint.name for b in model.bodies]:
        raise ModelError(
            "the robot has other joints than its file: some are locked, or driven by actuators with rotors."
        )
    gaps = [0.0]
    for body, filed in zip(model.bodies, read.bodies, strict=True):
        gaps.append(float(np.abs(body.placement - filed.placement).max()))
        size = np.abs(filed.inertia.parameters).max() or 1.0
        gaps.append(float(np.abs(body.inertia.parameters - filed.inertia.parameters).max() / size))
    if max(gaps) > 1e-7:
        raise ModelError("the robot is not what its file says: it carries a payload, or its inertias were repaired.")
    return max(gaps)
