"""A robot of the Robotics Toolbox for Python, by its attributes: ``roboticstoolbox`` is not imported."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..bodies.inertia import SpatialInertia
from ..errors import ModelError
from ..lie import se3, so3
from ..lie.adjoint import Ad
from ..model.builder import ModelBuilder
from ..model.remark import Remark
from ..typing import Array

_BASE = "base"
_LETTERS = "xyz"


def read_rtb_robot(robot: Any) -> ModelBuilder:
    """A builder filled with the links of a ``DHRobot``, or of a ``Robot`` of elementary transforms.

    Raises :class:`~twistwrench.ModelError` for what is no such robot.
    """
    try:
        builder = ModelBuilder(str(robot.name) or "robot")
        builder.gravity = np.array(robot.gravity, float).ravel().tolist()
        links = list(robot.links)
        if links and hasattr(links[0], "alpha"):
            _add_dh(builder, robot, links)
        else:
            _add_tree(builder, robot, links)
    except AttributeError as problem:
        raise ModelError(
            f"this is no robot of the Robotics Toolbox: {type(robot).__name__} has not what one has ({problem})."
        ) from None
    return builder


def _add_dh(builder: ModelBuilder, robot: Any, links: list[Any]) -> None:
    """Frames are ``link0``, the base, … ``linkn``, and ``tool`` where the robot has one."""
    builder.add_link("link0")
    T_base = _matrix(robot.base)
    for k, link in enumerate(links, start=1):
        builder.add_link(f"link{k}", _inertia(link))
        turns, at_rest = not int(link.sigma), float(link.offset)
        theta, d = (
            (float(link.theta) + at_rest, float(link.d)) if turns else (float(link.theta), float(link.d) + at_rest)
        )
        along, across = _screw_z(theta, d), _screw_x(float(link.alpha), float(link.a))
        S = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0] if turns else [0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        if link.mdh:
            T = across @ along
        else:  # the joint is about z of the frame before
            T = along @ across
            S = np.array(Ad(se3.inverse(across)) @ S)
        S = -S if link.isflip else S
        T = T_base @ T if k == 1 else T
        kind = "revolute" if turns else "prismatic"
        options = _options(builder, link, f"joint{k}")
        builder.add_joint(f"joint{k}", kind, f"link{k - 1}", f"link{k}", placement=T, axis=S + 0.0, **options)
    T_tool = _matrix(robot.tool)
    if not np.array_equal(T_tool, np.eye(4)):
        builder.add_link("tool")
        builder.add_joint("tool.fixed", "fixed", f"link{len(links)}", "tool", placement=T_tool)


def _add_tree(builder: ModelBuilder, robot: Any, links: list[Any]) -> None:
    """Joints are called as the links that they carry."""
    names = [str(link.name) or f"link{k}" for k, link in enumerate(links)]
    base = _BASE
    while base in names:
        base += "_"
    builder.add_link(base)
    for name, link in zip(names, links, strict=True):
        builder.add_link(name, _inertia(link))
    T_base = _matrix(robot.base)
    called = {id(link): name for link, name in zip(links, names, strict=True)}
    for name, link in zip(names, links, strict=True):
        parent = base if link.parent is None else called[id(link.parent)]
        T = np.eye(4) if link.Ts is None else np.array(link.Ts, float)
        T = T_base @ T if link.parent is None else T
        if not link.isjoint:
            builder.add_joint(f"{name}.fixed", "fixed", parent, name, placement=T)
            continue
        variable = link.v
        said = str(getattr(variable, "kind", None) or variable.axis)
        if said[:1] not in "Rt" or said[1:2] not in _LETTERS:
            raise ModelError(f"the joint of link {name!r} is {said!r}, which is not read.")
        axis = np.eye(3)[_LETTERS.index(said[1])] * (-1.0 if variable.isflip else 1.0)
        kind = "revolute" if said[0] == "R" else "prismatic"
        options = _options(builder, link, name)
        builder.add_joint(name, kind, parent, name, placement=T, axis=axis + 0.0, **options)


def _options(builder: ModelBuilder, link: Any, name: str) -> dict[str, Any]:
    """Limits, friction and armature of a joint, the motor's own by its gear."""
    gear = abs(float(link.G or 1.0))
    losses = np.abs(np.array(link.Tc, float).ravel())
    if losses.size and np.ptp(losses) > 0:
        builder.remark(Remark(f"joint {name!r}", "has another Coulomb friction either way, of which the mean is taken"))
    found: dict[str, Any] = {
        "armature": gear**2 * float(link.Jm or 0.0),
        "damping": gear**2 * float(link.B or 0.0),
        "friction": gear * float(losses.mean()) if losses.size else 0.0,
    }
    if link.qlim is not None:
        lower, upper = np.array(link.qlim, float).ravel()
        found |= {"lower": float(lower)} if np.isfinite(lower) else {}
        found |= {"upper": float(upper)} if np.isfinite(upper) else {}
    return found


def _inertia(link: Any) -> SpatialInertia:
    I = np.array(link.I, float).reshape(3, 3)
    return SpatialInertia.from_com(float(link.m or 0.0), np.array(link.r, float).ravel(), I)


def _matrix(T: Any) -> Array:
    return np.array(getattr(T, "A", T), float)


def _screw_z(theta: float, d: float) -> Array:
    return se3.pose(so3.exp([0.0, 0.0, theta]), [0.0, 0.0, d])


def _screw_x(alpha: float, a: float) -> Array:
    return se3.pose(so3.exp([alpha, 0.0, 0.0]), [a, 0.0, 0.0])
