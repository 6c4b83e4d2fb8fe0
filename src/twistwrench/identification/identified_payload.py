"""A payload alone: the body that a log's robot carries and its file does not, all other numbers held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..algorithms.regressor import PARAMETER_NAMES
from ..bodies.inertia import SpatialInertia
from ..errors import ValueRangeError
from ..model.model import BASE
from ..robot import Robot
from ..typing import Array
from .log_side import MotorSide
from .parameter_groups import BaseParameters
from .unknown_parameters import FRICTION, UnknownParameters


@dataclass(frozen=True, eq=False)
class IdentifiedPayload:
    """Payload that was identified.

    Attributes
    ----------
    frame : str, that it is fixed to
    inertia : SpatialInertia, in that frame
    mass_deviation : float [kg]
    com_deviations : (3,) array, along the frame's axes [m]
    untold : tuple of str, parameters of the body that carries it, about which no torque of this robot tells anything
    """

    frame: str
    inertia: SpatialInertia
    mass_deviation: float
    com_deviations: Array
    untold: tuple[str, ...] = ()

    @property
    def mass(self) -> float:
        """In kg."""
        return float(self.inertia.mass)

    def to_dict(self) -> dict[str, object]:
        """As plain data, in SI units.

        Returns
        -------
        findings : dict, which ``json.dumps`` takes

        Examples
        --------
        >>> one = IdentifiedPayload("tool0", SpatialInertia.from_com(2.0, (0, 0, 0.1)), 0.01, np.zeros(3))
        >>> one.to_dict()["com"]
        [0.0, 0.0, 0.1]
        """
        return {
            "frame": self.frame,
            "mass": self.mass,
            "mass_deviation": self.mass_deviation,
            "com": self.com.tolist(),
            "com_deviations": self.com_deviations.tolist(),
            "untold": list(self.untold),
            "moment_about_com": np.asarray(self.inertia.moment_about_com).tolist(),
        }

    @property
    def com(self) -> Array:
        """(3,) centre of mass in the frame [m]."""
        return np.asarray(self.inertia.com)


def payload_body(robot: Robot, frame: str) -> str:
    """The link of the moving body that a frame is fixed to.

    Parameters
    ----------
    robot : Robot
    frame : str

    Returns
    -------
    link : str

    Raises
    ------
    UnknownNameError
        There is no such frame.
    ValueRangeError
        It does not move.
    """
    carrier = robot.model.frame(frame).body
    if carrier == BASE:
        raise ValueRangeError(f"frame {frame!r} does not move, so no torque tells what is fixed to it.")
    return robot.model.bodies[carrier].link


def known_but_for(robot: Robot, link: str) -> dict[str, float]:
    """The file's values of all parameters but the ten of a moving body and the offsets of the joints.

    Parameters
    ----------
    robot : Robot
    link : str, of the moving body

    Returns
    -------
    known : {name: value}

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = known_but_for(tw.robots.planar_2r(), "link2")
    >>> len(found), found["link1.m"], found["joint1.viscous"]
    (16, 1.0, 0.0)
    """
    model, own = robot.model, robot.parameters
    known = {
        f"{body.link}.{name}": float(own[10 * i + k])
        for i, body in enumerate(model.bodies)
        if body.link != link and body.link in model.link_inertias
        for k, name in enumerate(PARAMETER_NAMES)
    }
    drives: Mapping[str, Array] = {
        "motor_inertia": np.broadcast_to(model.armature, robot.nv),
        "viscous": model.friction.viscous,
        "coulomb": model.friction.coulomb,
    }
    for kind, values in drives.items():
        known |= {f"{name}.{kind}": float(v) for name, v in zip(model.velocity_names, values, strict=True)}
    return known


def payload_from(robot: Robot, frame: str, base: BaseParameters, values: Array, covariance: Array) -> IdentifiedPayload:
    """The payload: what the groups have beyond the file, of the ten parameters of the body that carries it.

    Parameters
    ----------
    robot : Robot, as its file has it
    frame : str
    base : BaseParameters, in which all but these ten and the offsets are known
    values : (r,) array, of the groups
    covariance : (r, r) array

    Returns
    -------
    payload : IdentifiedPayload
    """
    place, names = robot.model.frames[frame], list(base.unknown.names)
    ten = [f"{payload_body(robot, frame)}.{name}" for name in PARAMETER_NAMES]
    beyond = values - base.project(base.unknown.file_values)
    S = np.zeros((10, base.count))  # what the torques cannot tell stays as the file has it
    for k, name in enumerate(ten):
        S[k, base.kept == names.index(name)] = 1.0
    T = np.linalg.inv(place.pose)
    A = np.stack([SpatialInertia.from_parameters(e).in_frame(T).parameters for e in np.eye(10)], axis=1) @ S
    G = SpatialInertia.from_parameters(A @ beyond)
    C = A @ covariance @ A.T
    m, mc = (PARAMETER_NAMES.index(name) for name in ("m", "mcx"))
    J = np.zeros((3, 10))  # c = (m c) / m
    J[:, mc : mc + 3], J[:, m] = np.eye(3) / G.mass, -np.asarray(G.com) / G.mass
    untold = tuple(name for name, row in zip(ten, S, strict=True) if not row.any())
    return IdentifiedPayload(frame, G, float(np.sqrt(C[m, m])), np.sqrt((J @ C @ J.T).diagonal()), untold)


def unknown_of(
    robot: Robot,
    *,
    motor_inertia: bool,
    friction: Sequence[str],
    motor_side: MotorSide | None,
    known: Mapping[str, float] | None,
    payload_only: str | None,
    stribeck_speed: float,
) -> UnknownParameters:
    """What is sought; of a payload alone all but its own numbers and the torques' offsets are known."""
    held = dict(known or {})
    if payload_only is not None:
        held = known_but_for(robot, payload_body(robot, payload_only)) | held
        motor_inertia, friction = True, FRICTION
    return UnknownParameters(robot, motor_inertia, tuple(friction), motor_side, held, stribeck_speed)
