"""A robot's file as other libraries read it: what a comparison with them starts from."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from .bodies.inertia import SpatialInertia
from .errors import MissingExtraError, ModelError, ModelWarning, NotFoundError, RobotFileError
from .io import load_model
from .io.element import parse
from .io.source import read_robot_text
from .lie import quaternion
from .model.assembly import ROOT_JOINT
from .robot import Robot

__all__ = ["file_gap", "mujoco_model", "pinocchio_model"]


def pinocchio_model(robot: Robot) -> Any:
    """Pinocchio's model of the file that ``robot`` came from, under the robot's gravity; its mimic joints independent.

    Raises: MissingExtraError, NotFoundError for a robot without a file, RobotFileError where Pinocchio refuses it.
    """
    path = _file_of(robot)
    try:
        import pinocchio
    except ImportError:
        raise MissingExtraError.of("pin", "peers", "Comparing with Pinocchio") from None
    root = [pinocchio.JointModelFreeFlyer()] if _floats(robot) else []
    try:
        model = pinocchio.buildModelFromUrdf(str(path), *root)
    except Exception as problem:  # it raises whatever its parsers do
        raise RobotFileError(f"Pinocchio does not read {path.name}: {_line(problem)}") from None
    model.gravity.linear = robot.gravity
    return model


def mujoco_model(robot: Robot) -> Any:
    """MuJoCo's model of the same file: no contacts, constraints, limits, passive forces; only the mechanics is left.

    Its shapes are left out, so that no mesh is opened. Raises as :func:`pinocchio_model`.
    """
    path = _file_of(robot)
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError.of("mujoco", "peers", "Comparing with MuJoCo") from None
    text = _for_mujoco(path, floating=_floats(robot))
    try:
        model = mujoco.MjSpec.from_string(text).compile()
    except Exception as problem:  # it raises whatever its compiler does
        raise RobotFileError(f"MuJoCo does not read {path.name}: {_line(problem)}") from None
    for name, flag in mujoco.mjtDisableBit.__members__.items():
        if name not in ("mjDSBL_GRAVITY", "mjDSBL_EULERDAMP"):
            model.opt.disableflags |= int(flag.value)
    model.opt.gravity[:] = robot.gravity
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
            raise ModelError(f"MuJoCo changes the body of joint {body.joint.name!r}, by up to {gap:.2g} kg m².")


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


def _line(problem: Exception) -> str:
    return " ".join(str(problem).split())[:200]


def file_gap(robot: Robot) -> float:
    """How far the robot's numbers are from those of its file: some 1e-9 at most, by which loading snaps rotations.

    Raises ModelError for a robot edited since, or loaded with locked joints or repaired inertias.
    """
    model = robot.model
    mimic = "follow" if any(body.follows for body in model.bodies) else "independent"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        read = load_model(_file_of(robot), floating_base=_floats(robot), mimic=mimic, inertia="accept", snap=0.0)
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
