"""Other libraries, Pinocchio and MuJoCo, on the file of a robot: residuals of their dynamics at one state."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import MissingExtraError, ModelError, ModelWarning, NotFoundError, RobotFileError
from ..core.third_party import capture_stderr
from ..formats import format_of_file, load_model, usd_path
from ..formats.source import read_robot_text
from ..formats.xacro import xacro_in
from ..mechanics.model.assembly import ROOT_JOINT
from ..mechanics.model.couplings import refuse_couplings
from ..robot import Robot
from ..robot.convert import mujoco_rates, pinocchio_rates, to_mujoco, to_pinocchio
from .laws import Residual, against
from .random_robots import State

_MAX_GAP_OF_ROUNDING = 1e-7
"""Largest deviation of a parameter from the file that loading may cause."""
_MAX_MESSAGE_LENGTH = 200
"""Largest number of characters of another library's message."""


def _file_of(robot: Robot, library: str, kind: str) -> Path:
    """Path of the robot's file, which must be of ``kind`` "urdf" or "mjcf".

    Raises NotFoundError without a file, and RobotFileError for a file of another kind.
    """
    path = Path(robot.model.source)
    if not robot.model.source or not path.is_file():
        raise NotFoundError(f"robot {robot.name!r} has no file that another library could read; load it from a path.")
    if _is_xacro(path):
        raise RobotFileError(f"{path.name} is xacro; with {library}, {kind.upper()} files are compared.")
    actual_kind = format_of_file(path)
    if actual_kind != kind:
        raise RobotFileError(
            f"{path.name} is {actual_kind.upper()}; with {library}, {kind.upper()} files are compared."
        )
    return path


def _is_xacro(path: Path) -> bool:
    """True for a file that requires xacro."""
    if usd_path(path) is not None:
        return False
    text, _ = read_robot_text(path)
    return bool(xacro_in(text))


def _has_added_root(robot: Robot) -> bool:
    """True if loading added the joint of a floating base."""
    return any(body.joint.name == ROOT_JOINT for body in robot.model.bodies)


def file_gap(robot: Robot) -> float:
    """Largest deviation of the robot's parameters from its file, at most about 1e-9, since loading normalises rotations.

    Raises ModelError for a robot edited after loading, or loaded with locked joints or repaired inertias.
    """
    model = robot.model
    refuse_couplings(model, "comparison with the file")
    mimic = "follow" if any(body.follows for body in model.bodies) else "independent"
    path = Path(model.source)
    if not model.source or not path.is_file() or _is_xacro(path):
        return 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        floating_base = True if _has_added_root(robot) else None  # None follows the file
        file_model = load_model(path, floating_base=floating_base, mimic=mimic, inertia="accept", snap=0.0)
    if [body.joint.name for body in file_model.bodies] != [body.joint.name for body in model.bodies]:
        raise ModelError("joints differ from those of the file: some are locked, or driven by actuators with rotors.")
    gaps = [0.0]
    for body, file_body in zip(model.bodies, file_model.bodies, strict=True):
        gaps.append(float(np.abs(body.placement - file_body.placement).max()))
        parameters = file_body.inertia.parameters
        size = np.abs(parameters).max() or 1.0  # 1 for a body without inertia
        gaps.append(float(np.abs(body.inertia.parameters - parameters).max() / size))
    if max(gaps) > _MAX_GAP_OF_ROUNDING:
        raise ModelError("numbers differ from those of the file: a payload is carried, or inertias were repaired.")
    return max(gaps)


def _pinocchio(robot: Robot) -> Residual:
    """Residual of inverse dynamics and mass matrix against Pinocchio on the robot's URDF."""
    path = _file_of(robot, "Pinocchio", "urdf")
    try:
        import pinocchio
    except ImportError:
        raise MissingExtraError.from_extra("pin", "peers", "Comparing with Pinocchio") from None
    # the joint of a floating base is an optional argument
    root_arguments = [pinocchio.JointModelFreeFlyer()] if _has_added_root(robot) else []
    model = _read_by("Pinocchio", path, lambda: pinocchio.buildModelFromUrdf(str(path), *root_arguments))
    model.gravity.linear = robot.gravity
    data = model.createData()
    P = pinocchio_rates(robot, model)  # maps dq of the robot to Pinocchio's

    def residual(robot: Robot, state: State) -> float:
        q, dq, ddq = to_pinocchio(robot, model, *state)
        upper_triangle = np.triu(pinocchio.crba(model, data, q))  # crba fills only this triangle
        M = upper_triangle + np.triu(upper_triangle, 1).T
        tau = pinocchio.rnea(model, data, q, dq, ddq)
        return against(robot, state, P.T @ tau, P.T @ M @ P)

    return residual


def _mujoco(robot: Robot) -> Residual:
    """Residual of inverse dynamics and mass matrix against MuJoCo on the robot's MJCF."""
    path = _file_of(robot, "MuJoCo", "mjcf")
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError.from_extra("mujoco", "peers", "Comparing with MuJoCo") from None
    model = _read_by("MuJoCo", path, lambda: mujoco.MjModel.from_xml_path(str(path)))
    kept_flags = ("mjDSBL_GRAVITY", "mjDSBL_EULERDAMP", "mjDSBL_SPRING")
    for name, flag in mujoco.mjtDisableBit.__members__.items():  # contacts, limits and friction are not compared
        if name not in kept_flags:
            model.opt.disableflags |= int(flag.value)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    model.opt.gravity[:] = robot.gravity
    model.opt.density = 0.0  # no fluid; the file reader warns of fluids
    model.opt.viscosity = 0.0
    data = mujoco.MjData(model)
    M = np.zeros((model.nv, model.nv))  # filled at each state
    mujoco_rates(robot, model, robot.neutral)  # raises if the joints do not match

    def residual(robot: Robot, state: State) -> float:
        q, dq, ddq = to_mujoco(robot, model, *state)
        data.qpos[:] = q
        data.qvel[:] = dq
        data.qacc[:] = ddq
        P = mujoco_rates(robot, model, state.q)  # maps dq of the robot to MuJoCo's
        mujoco.mj_inverse(model, data)
        mujoco.mj_fullM(model, data, M)
        return against(robot, state, P.T @ data.qfrc_inverse, P.T @ M @ P)

    return residual


def _read_by(library: str, path: Path, read: Callable[[], Any]) -> Any:
    """Result of another library's reader.

    Any exception of the reader becomes a RobotFileError with the text that the library wrote on standard error.
    """
    problem: Exception | None = None
    with capture_stderr() as error_text:
        try:
            return read()
        except Exception as raised:  # parsers raise exceptions of any kind
            problem = raised
    message = " ".join(str(problem).split())  # on one line
    message = message[:_MAX_MESSAGE_LENGTH]
    if str(error_text):
        message += f"; it wrote: {error_text}"
    raise RobotFileError(f"{library} does not read {path.name}: {message}")


PEERS: tuple[tuple[str, Callable[[Robot], Residual]], ...] = (("Pinocchio", _pinocchio), ("MuJoCo", _mujoco))
"""Name of each library, and function that prepares its residual for a robot."""
