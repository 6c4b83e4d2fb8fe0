"""Random robots of every joint kind, and random states of motion."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import ModelWarning, ValueRangeError
from ..core.glossary import complete
from ..core.typing import Array
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.bodies.solids import rotational_inertia
from ..mechanics.joints import JOINT_TYPES
from ..mechanics.joints.screw_joint import ScrewJoint
from ..mechanics.lie import se3, so3
from ..mechanics.model.builder import ModelBuilder
from ..robot import Robot

KINDS = (*JOINT_TYPES, "mimic", "fixed")
"""Kinds of random joints: moving joints, mimic joints of earlier one-degree joints, and fixed joints."""

_SCREWS = {kind: joint for kind, joint in JOINT_TYPES.items() if issubclass(joint, ScrewJoint)}
"""Classes of joints with one degree of freedom, by kind."""
_CHAIN_PROBABILITY = 0.6
"""Probability that a link is attached to the link before it; otherwise to any earlier link."""
_OBLIQUE_PROBABILITY = 0.7
"""Probability of an axis in any direction; otherwise it is a coordinate axis."""
_GYRATION_RADIUS = 0.2
"""Typical radius of gyration of a body [m]."""
_MIN_SECOND_MOMENT = 1e-3
"""Term of the second moments for each unit mass [m²], which keeps a body from being flat."""
_COM_DISTANCE = 0.3
"""Typical coordinate of a centre of mass [m]."""


def random_robot(
    rng: np.random.Generator | int | None = None,
    joints: int = 7,
    kinds: Sequence[str] = KINDS,
    *,
    floating_base: bool = False,
    mimic: str = "follow",
) -> Robot:
    """Random robot: a tree with the given number of joints; the same ``rng`` seed gives the same robot.

    Parameters
    ----------
    floating_base : bool, let the root link float
    mimic : "follow" or "independent", which frees mimic joints

    Returns
    -------
    robot : Robot, with gravity in a random direction

    Examples
    --------
    >>> random_robot(1, joints=3, kinds=("revolute",)).nv
    3
    """
    rng = np.random.default_rng(rng)
    builder = random_builder(rng, joints, kinds)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # a floating joint on a floating base is intended
        gravity = rng.uniform(-10.0, 10.0, 3)
        return Robot(builder.build(floating_base=floating_base, mimic=mimic, gravity=gravity))


def random_builder(
    rng: np.random.Generator | int | None = None, joints: int = 7, kinds: Sequence[str] = KINDS
) -> ModelBuilder:
    """Description of a random robot, as used by :func:`random_robot`.

    Returns
    -------
    builder : ModelBuilder, with links ``link0`` (the root), ``link1``, …, joints ``joint1``, …

    Notes
    -----
    The parent of each link is a random earlier link, most often the last, so that branches and chains both occur.

    Examples
    --------
    >>> random_builder(0, joints=3).build().name
    'random'
    """
    rng = np.random.default_rng(rng)
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise ValueRangeError(f"no joint kinds {unknown}. Choose from: {', '.join(KINDS)}.")
    builder = ModelBuilder("random")
    builder.add_link("link0", random_inertia(rng))
    leaders: list[str] = []
    moving_kinds = tuple(kind for kind in kinds if kind not in ("mimic", "fixed"))
    if not moving_kinds:
        moving_kinds = ("revolute",)
    for i in range(1, joints + 1):
        possible_kinds = moving_kinds if i == 1 else tuple(kinds)  # the first joint moves
        kind = str(rng.choice(possible_kinds))
        follows = kind == "mimic" and bool(leaders)
        if kind == "mimic":
            kind = str(rng.choice(list(_SCREWS)))
        parent_index = i - 1
        if rng.random() >= _CHAIN_PROBABILITY:
            parent_index = int(rng.integers(i))
        parent = f"link{parent_index}"
        builder.add_link(f"link{i}", random_inertia(rng))
        placement = random_pose(rng)
        mimic = None
        if follows:
            leader = str(rng.choice(leaders))
            ratio = float(rng.uniform(-2.0, 2.0))
            offset = float(rng.uniform(-1.0, 1.0))
            mimic = (leader, ratio, offset)
        options = _joint_options(rng, kind)
        builder.add_joint(f"joint{i}", kind, parent, f"link{i}", placement=placement, mimic=mimic, **options)
        if kind in _SCREWS and not follows:
            leaders.append(f"joint{i}")
    return builder


def _joint_options(rng: np.random.Generator, kind: str) -> dict[str, Any]:
    """Axis, limits and losses of a joint. Some axes are coordinate axes, since these use other code paths."""
    options: dict[str, Any] = {}
    if rng.random() < _OBLIQUE_PROBABILITY:
        options["axis"] = rng.standard_normal(3)
    else:
        axis_index = rng.integers(3)
        options["axis"] = np.eye(3)[axis_index]
    joint_class = _SCREWS.get(kind)
    if joint_class is None:
        return options
    if joint_class.has_pitch:
        options["pitch"] = rng.uniform(-0.5, 0.5)
    elif not joint_class.wraps:
        options |= {"lower": rng.uniform(-3.0, -0.5), "upper": rng.uniform(0.5, 3.0)}
    options |= {"damping": rng.uniform(0.0, 1.0), "friction": rng.uniform(0.0, 1.0)}
    return options


def random_inertia(rng: np.random.Generator | int | None = None) -> SpatialInertia:
    """Random inertia of a physically consistent body.

    The second moments S of its mass are random and in rotated axes, and its centre of mass is away from the origin.

    Examples
    --------
    >>> random_inertia(3).defects()
    []
    """
    rng = np.random.default_rng(rng)
    A = _GYRATION_RADIUS * rng.standard_normal((3, 3))
    mass = rng.uniform(0.2, 5.0)
    S = mass * (A @ A.T + _MIN_SECOND_MOMENT * np.eye(3))
    com = _COM_DISTANCE * rng.standard_normal(3)
    return SpatialInertia.from_com(mass, com, rotational_inertia(S))


def random_pose(rng: np.random.Generator | int | None = None) -> Array:
    """Random pose with any rotation and a position within ±0.5 m.

    Returns
    -------
    T : (4, 4) array

    Examples
    --------
    >>> random_pose(0).shape
    (4, 4)
    """
    rng = np.random.default_rng(rng)
    w = rng.standard_normal(3)
    axis = w / np.linalg.norm(w)
    R = so3.exp(axis * rng.uniform(0.0, np.pi))
    p = rng.uniform(-0.5, 0.5, 3)
    return np.asarray(se3.pose(R, p))


class State(NamedTuple):
    """State and acceleration of a robot: q (..., nq), dq and ddq (..., nv)."""

    q: Array
    """Configuration (..., nq)."""
    dq: Array
    """Velocities (..., nv), rad/s or m/s."""
    ddq: Array
    """Accelerations (..., nv), rad/s² or m/s²."""


def random_state(robot: Robot, rng: np.random.Generator | int | None = None, size: int | tuple[int, ...] = ()) -> State:
    """Random state: a configuration inside the limits, velocities and accelerations of order 1.

    Returns
    -------
    state : State, q (*size, nq), dq and ddq (*size, nv)

    Examples
    --------
    >>> import twistwrench as tw
    >>> random_state(tw.robots.ur5(), 0, size=4).dq.shape
    (4, 6)
    """
    rng = np.random.default_rng(rng)
    shape = (size,) if isinstance(size, int) else tuple(size)
    q = robot.random_configuration(rng, shape)
    dq = rng.standard_normal((*shape, robot.nv))
    ddq = rng.standard_normal((*shape, robot.nv))
    return State(q, dq, ddq)


complete(globals())
