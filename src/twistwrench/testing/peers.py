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


def _file_of(robot: Robot, library: str, kind: str) -> Path:
    """Path of the robot's file. Raises NotFoundError without one, RobotFileError if it is of another format."""
    path = Path(robot.model.source)
    if not robot.model.source or not path.is_file():
        raise NotFoundError(f"robot {robot.name!r} has no file that another library could read; load it from a path.")
    if _is_expanded(path):
        raise RobotFileError(f"{path.name} is xacro; with {library}, {kind.upper()} files are compared.")
    own_kind = format_of_file(path)
    if own_kind != kind:
        raise RobotFileError(f"{path.name} is {own_kind.upper()}; with {library}, {kind.upper()} files are compared.")
    return path


def _is_expanded(path: Path) -> bool:
    """True for a file that requires xacro."""
    return usd_path(path) is None and bool(xacro_in(read_robot_text(path)[0]))


def _floats(robot: Robot) -> bool:
    return any(body.joint.name == ROOT_JOINT for body in robot.model.bodies)


def file_gap(robot: Robot) -> float:
    """Largest deviation of the robot's parameters from its file, at most about 1e-9, since loading normalises rotations.

    Raises ModelError for a robot edited after loading, or loaded with locked joints or repaired inertias.
    """
    model = robot.model
    refuse_couplings(model, "comparison with the file")
    mimic = "follow" if any(body.follows for body in model.bodies) else "independent"
    if not model.source or not Path(model.source).is_file() or _is_expanded(Path(model.source)):
        return 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        filed = load_model(
            Path(model.source), floating_base=_floats(robot) or None, mimic=mimic, inertia="accept", snap=0.0
        )
    if [b.joint.name for b in filed.bodies] != [b.joint.name for b in model.bodies]:
        raise ModelError("joints differ from those of the file: some are locked, or driven by actuators with rotors.")
    gaps = [0.0]
    for mine, theirs in zip(model.bodies, filed.bodies, strict=True):
        size = np.abs(theirs.inertia.parameters).max() or 1.0
        gaps.append(float(np.abs(mine.placement - theirs.placement).max()))
        gaps.append(float(np.abs(mine.inertia.parameters - theirs.inertia.parameters).max() / size))
    if max(gaps) > 1e-7:
        raise ModelError("numbers differ from those of the file: a payload is carried, or inertias were repaired.")
    return max(gaps)


def _pinocchio(robot: Robot) -> Residual:
    path = _file_of(robot, "Pinocchio", "urdf")
    try:
        import pinocchio
    except ImportError:
        raise MissingExtraError.from_extra("pin", "peers", "Comparing with Pinocchio") from None
    root = [pinocchio.JointModelFreeFlyer()] if _floats(robot) else []
    model = _read_by("Pinocchio", path, lambda: pinocchio.buildModelFromUrdf(str(path), *root))
    model.gravity.linear = robot.gravity
    data, P = model.createData(), pinocchio_rates(robot, model)

    def residual(robot: Robot, at: State) -> float:
        q, dq, ddq = to_pinocchio(robot, model, *at)
        M = np.triu(pinocchio.crba(model, data, q))  # crba fills only the upper triangle
        M = M + np.triu(M, 1).T
        return against(robot, at, P.T @ pinocchio.rnea(model, data, q, dq, ddq), P.T @ M @ P)

    return residual


def _mujoco(robot: Robot) -> Residual:
    path = _file_of(robot, "MuJoCo", "mjcf")
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError.from_extra("mujoco", "peers", "Comparing with MuJoCo") from None
    model = _read_by("MuJoCo", path, lambda: mujoco.MjModel.from_xml_path(str(path)))
    kept = ("mjDSBL_GRAVITY", "mjDSBL_EULERDAMP", "mjDSBL_SPRING")
    for name, flag in mujoco.mjtDisableBit.__members__.items():  # contacts, limits and friction are not compared
        if name not in kept:
            model.opt.disableflags |= int(flag.value)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    model.opt.gravity[:] = robot.gravity
    model.opt.density = model.opt.viscosity = 0.0  # the file reader warns of fluids
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco_rates(robot, model, robot.neutral)  # raises if the joints do not match

    def residual(robot: Robot, at: State) -> float:
        data.qpos[:], data.qvel[:], data.qacc[:] = to_mujoco(robot, model, *at)
        P = mujoco_rates(robot, model, at.q)
        mujoco.mj_inverse(model, data)
        mujoco.mj_fullM(model, data, M)
        return against(robot, at, P.T @ data.qfrc_inverse, P.T @ M @ P)

    return residual


def _read_by(library: str, path: Path, read: Callable[[], Any]) -> Any:
    """Result of another library's reader; RobotFileError for any exception, with the text from standard error."""
    problem: Exception | None = None
    with capture_stderr() as written:
        try:
            return read()
        except Exception as raised:  # any exception of its parsers
            problem = raised
    more = f"; it wrote: {written}" if str(written) else ""
    raise RobotFileError(f"{library} does not read {path.name}: {' '.join(str(problem).split())[:200]}{more}")


PEERS: tuple[tuple[str, Callable[[Robot], Residual]], ...] = (("Pinocchio", _pinocchio), ("MuJoCo", _mujoco))
