"""Frozen model of a robot: moving bodies in tree order, joints, frames, springs and loops."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import chain
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.errors import FrameError, ModelError, UnknownNameError
from ...core.text import argument, listed
from ...core.typing import Array
from ..bodies.inertia import SpatialInertia
from ..joints import Joint
from .actuators import Actuator
from .limits import Friction, Limits

if TYPE_CHECKING:
    from .couplings import Coupling


@dataclass(frozen=True)
class Spring:
    """Spring with the energy ``½ stiffness (Σ weight · coordinate - rest)²`` between joints of one degree of freedom."""

    terms: tuple[tuple[str, float], ...]
    """Name of each joint with its weight."""
    stiffness: float
    """Stiffness [N m/rad or N/m]."""
    rest: float = 0.0
    """Length at which the spring is unloaded [rad or m]."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints that the spring acts on."""
        return tuple(joint for joint, _ in self.terms)

    def with_fixed(self, positions: dict[str, float]) -> Spring:
        """Spring with some joints locked at ``positions``, by which their part of the extension is constant."""
        remaining_terms: list[tuple[str, float]] = []
        constant_extension = 0.0
        for joint, weight in self.terms:
            if joint in positions:
                constant_extension += weight * positions[joint]
            else:
                remaining_terms.append((joint, weight))
        return Spring(tuple(remaining_terms), self.stiffness, self.rest - constant_extension)


@dataclass(frozen=True)
class OfferedClosure:
    """Loop closure of the file: ``robot.close(closure.frame_a, closure.frame_b, closure.rows)``."""

    frame_a: str
    """First frame."""
    frame_b: str
    """Second frame."""
    rows: str = "wx wy wz vx vy vz"
    """Rows of the frames' relative twist that are held at zero."""


_MAX_LISTED_TIPS = 12
"""Number of frames that a message lists as possible tips; the others are counted."""
BASE = -1
"""Index of the fixed base."""
_MAPPINGS = ("actuators", "configurations", "closures", "mounts", "locked")
"""Fields of a model that are stored as read-only mappings, since a model is frozen."""


@dataclass(frozen=True, eq=False)
class Body:
    """One moving body, with the links fixed to it, and the joint that carries it.

    At joint coordinates x = ``ratio * q[q_index] + offset``, the body's frame has the pose ``placement @ joint.pose(x)`` in its
    parent's frame. The ratio is 1 and the offset 0 except for mimic joints.
    """

    joint: Joint
    """Joint that carries the body."""
    link: str
    """Child link, whose frame is the body's frame; links fixed to it are part of the body."""
    parent: int
    """Index of the parent body; ``BASE`` for the base."""
    placement: Array
    """Pose T_parent,joint (4, 4)."""
    inertia: SpatialInertia
    """Inertia about the origin of the body's frame, which is the child link's frame."""
    q_index: int
    """Index of the joint's first coordinate in q."""
    v_index: int
    """Index of the joint's first velocity in dq."""
    ratio: float = 1.0
    """Ratio of a mimic joint: change of its coordinate for a unit of its leader's coordinate."""
    offset: float = 0.0
    """Coordinate of a mimic joint at zero of its leader [rad or m]."""
    follows: bool = False
    """True if the joint mimics another and shares its coordinate."""
    effort: float = np.inf
    """Largest torque of a mimic joint [N m or N]; inf if not given, and for other joints."""

    @property
    def places(self) -> tuple[slice, slice]:
        """Slices of the joint in q and in dq."""
        joint = self.joint
        return slice(self.q_index, self.q_index + joint.nq), slice(self.v_index, self.v_index + joint.nv)

    def coordinates(self, q: Array) -> Array:
        """Coordinates of the joint at a configuration; those of a follower come from its leader.

        Parameters
        ----------
        q : (nq,) array, of the model

        Returns
        -------
        coordinates : (n,) array [rad or m], quaternions as they are

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_2r().model.bodies[1].coordinates(np.array([0.1, 0.2])).tolist()
        [0.2]
        """
        q_slice, _ = self.places
        q_joint = q[q_slice]
        if self.follows:
            return self.ratio * q_joint + self.offset
        return q_joint


@dataclass(frozen=True, eq=False)
class Frame:
    """Frame fixed to a body."""

    body: int
    """Index of the body; ``BASE`` for the base."""
    pose: Array
    """Pose in the body's frame (4, 4)."""


@dataclass(frozen=True, eq=False, repr=False)
class Model:
    """Robot model as data, parents before children; created by :class:`~twistwrench.mechanics.model.builder.ModelBuilder`."""

    name: str
    """The robot's name."""
    bodies: tuple[Body, ...]
    """Moving bodies, parents first."""
    frames: dict[str, Frame]
    """Frames of all links by name, also of fixed links, in document order."""
    limits: Limits
    """Limits of the joints."""
    friction: Friction
    """Joint friction, which quantities include only on request."""
    gravity: Array
    """Gravity in the base frame, (3,) m/s²."""
    base_inertia: SpatialInertia
    """Inertia of all fixed links, in the base frame."""
    tip: str | None
    """Default frame of quantities."""
    leaves: tuple[str, ...] = ()
    """Links without children, in document order."""
    defects: tuple[str, ...] = ()
    """Doubtful entries of the file."""
    link_inertias: dict[str, SpatialInertia] = field(default_factory=dict)
    """Inertia of each single link, in its own frame, for reports."""
    source: str = ""
    """Path of the file."""
    springs: tuple[Spring, ...] = ()
    """Springs between joint coordinates; their torques are part of the dynamics, like gravity torques."""
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    """Actuators by joint; their rotors are among the bodies, their elasticity among the springs."""
    payloads: tuple[tuple[str, SpatialInertia], ...] = ()
    """Frame of each attached payload, with its inertia about this frame; bodies and links that carry payloads include them."""
    shaped: frozenset[str] = frozenset()
    """Links with a visual or collision shape."""
    snap: float = 0.0
    """Distance from 0 or ±1 within which entries of fixed rotations were set to 0 or ±1; edits use this distance, too."""
    armature: Array = field(default_factory=lambda: np.zeros(0))
    """Reflected inertia (nv,) of the drives, added to the diagonal of M [kg m² or kg]. It has neither weight nor momentum. A
    rotor with known position and axis is a body instead."""
    sites: dict[str, Frame] = field(default_factory=dict)
    """Named frames of the file that are not links, in document order; their names differ from link names."""
    configurations: Mapping[str, Array] = field(default_factory=dict)
    """Named configurations (nq,) of the file, such as ``home``."""
    couplings: tuple[Coupling, ...] = ()
    """Motors that move several joints together. At the indices of these joints, armature, friction and effort are those of the
    motors."""
    closures: Mapping[str, OfferedClosure] = field(default_factory=dict)
    """Loops that the file describes; the tree leaves them open."""
    motor_joints: frozenset[str] = frozenset()
    """Joints that the file's actuators drive, directly or by a tendon; empty if the file describes no actuators."""
    mounted: bool = False
    """True if the file or the caller fixes the root: a joint of the file to the world, or ``floating_base=False``."""
    mounts: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Parent link and joint of each link except the root, also for fixed joints. The parent of a floating base is the link
    ``""``."""
    locked: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Joints that were locked, each with the joints that mimicked it; joints that the file fixes are not among them."""

    def __post_init__(self) -> None:
        if not self.armature.size:
            object.__setattr__(self, "armature", np.zeros(self.nv))
        for name in _MAPPINGS:
            own_copy = dict(getattr(self, name))
            object.__setattr__(self, name, MappingProxyType(own_copy))
        limits = [getattr(self.limits, kind.name) for kind in fields(Limits)]
        arrays = [self.gravity, self.armature, *limits, *self.configurations.values()]
        arrays += [frame.pose for frame in self.all_frames.values()]
        arrays += [coupling.motor_per_joint for coupling in self.couplings]
        for body in self.bodies:
            arrays += [body.placement, body.joint.axes]
        for array in arrays:
            array.setflags(write=False)  # robots share arrays, and kernels contain their values

    def __getstate__(self) -> dict[str, Any]:
        state = {f.name: getattr(self, f.name) for f in fields(self)}  # without cached properties
        for name in _MAPPINGS:
            state[name] = dict(state[name])  # read-only mappings cannot be pickled
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.__post_init__()  # unpickled arrays are writable

    @cached_property
    def nq(self) -> int:
        """Number of coordinates."""
        return sum(body.joint.nq for body in self.leaders)

    @cached_property
    def nv(self) -> int:
        """Number of velocities."""
        return sum(body.joint.nv for body in self.leaders)

    def positions(self, q: Any) -> Array:
        """Coordinate of each velocity; zero for planar, ball and floating joints, whose velocities have no coordinate.

        Parameters
        ----------
        q : (..., nq) array

        Returns
        -------
        positions : (..., nv) array [rad or m]

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.floating_box().model.positions([1, 0, 0, 0, 1, 2, 3]).tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        """
        q = np.asarray(q, float)
        positions = np.zeros((*q.shape[:-1], self.nv))
        for body in self.leaders:
            if body.joint.nv == 1:
                positions[..., body.v_index] = q[..., body.q_index]
        return positions

    @cached_property
    def leaders(self) -> tuple[Body, ...]:
        """Bodies whose joints have coordinates of their own, in the order of q: all except bodies of mimic joints."""
        leaders = [body for body in self.bodies if not body.follows]
        return tuple(sorted(leaders, key=lambda body: body.v_index))

    @cached_property
    def leaders_by_name(self) -> dict[str, Body]:
        """Leaders (:attr:`leaders`) by the name of their joint."""
        return dict(zip(self.joint_names, self.leaders, strict=True))

    @cached_property
    def all_locked(self) -> tuple[str, ...]:
        """Joints that were locked, and the joints that mimicked them."""
        return (*self.locked, *chain.from_iterable(self.locked.values()))

    @cached_property
    def limited_followers(self) -> tuple[int, ...]:
        """Indices of the bodies whose mimic joints have effort limits of their own."""
        return tuple(i for i, body in enumerate(self.bodies) if body.follows and np.isfinite(body.effort))

    @cached_property
    def moving_mass(self) -> float:
        """Mass of all moving bodies [kg], without links fixed to the base."""
        return float(sum(body.inertia.mass for body in self.bodies))

    @cached_property
    def quaternions(self) -> tuple[slice, ...]:
        """Slices of the quaternions in q."""
        slices: list[slice] = []
        for body in self.leaders:
            if body.joint.quaternion is not None:
                start = body.q_index + body.joint.quaternion
                slices.append(slice(start, start + 4))
        return tuple(slices)

    @cached_property
    def all_frames(self) -> dict[str, Frame]:
        """All frames by name: links, then sites."""
        return {**self.frames, **self.sites}

    def __repr__(self) -> str:
        return f"<Model {self.name!r}: {len(self.bodies)} moving bodies, {len(self.frames)} links>"

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Joints with coordinates, in the order of q."""
        return tuple(body.joint.name for body in self.leaders)

    @cached_property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names (nq,) of the coordinates: the joint's name, with a suffix if the joint has several coordinates."""
        return tuple(body.joint.name + suffix for body in self.leaders for suffix in body.joint.coordinate_suffixes)

    @cached_property
    def velocity_names(self) -> tuple[str, ...]:
        """Names (nv,) of velocities and torques: the joint's name, with a suffix if the joint has several velocities."""
        return tuple(body.joint.name + suffix for body in self.leaders for suffix in body.joint.velocity_suffixes)

    @cached_property
    def coupled(self) -> tuple[tuple[Array, Array, Array], ...]:
        """Indices (n,) in dq, matrix A (n, n) from joints to motors, and A⁻¹, of each coupling."""
        blocks = []
        for coupling in self.couplings:
            indices = np.array([self.leaders_by_name[joint].v_index for joint in coupling.joints])
            blocks.append((indices, coupling.motor_per_joint, coupling.joint_per_motor))
        return tuple(blocks)

    @cached_property
    def coupled_motors(self) -> tuple[str, ...]:
        """Motors of all couplings."""
        return tuple(chain.from_iterable(coupling.motors for coupling in self.couplings))

    @cached_property
    def drive_names(self) -> tuple[str, ...]:
        """Names (nv,) of the drives: the name of the velocity, or of the coupled motor at its index."""
        motor_by_joint: dict[str, str] = {}
        for coupling in self.couplings:
            motor_by_joint.update(zip(coupling.joints, coupling.motors, strict=True))
        return tuple(motor_by_joint.get(name, name) for name in self.velocity_names)

    @cached_property
    def drive_labels(self) -> tuple[str, ...]:
        """Drive names (:attr:`drive_names`) for reports, (nv,): coupled motors have also the joints that they move."""
        label_by_motor: dict[str, str] = {}
        for coupling in self.couplings:
            for motor in coupling.motors:
                label_by_motor[motor] = coupling.label(motor)
        return tuple(label_by_motor.get(name, name) for name in self.drive_names)

    def drive_index(self, name: str) -> int:
        """Index in dq of a drive.

        Parameters
        ----------
        name : str, a joint with one degree of freedom that is not coupled, or a coupled motor

        Returns
        -------
        index : int

        Raises
        ------
        ModelError
            The joint has several velocities, follows another, or is moved by coupled motors.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_2r().model.drive_index("joint2")
        1
        """
        if name in self.coupled_motors:
            return self.drive_names.index(name)
        for coupling in self.couplings:
            if name in coupling.joints:
                raise ModelError(
                    f"joint {name!r} is moved by motors {listed(coupling.motors)} of coupling {coupling.name!r}. Describe "
                    "those instead."
                )
        if name in self.leaders_by_name:
            leader = self.leaders_by_name[name]
            if leader.joint.nv != 1:
                raise ModelError(f"joint {name!r} is {leader.joint.kind}; only joints of one degree have actuators.")
            return leader.v_index
        if any(body.follows and body.joint.name == name for body in self.bodies):
            raise ModelError(f"joint {name!r} mimics another and has no actuator of its own. Describe its leader's.")
        raise UnknownNameError.from_choices("joint", name, (*self.leaders_by_name, *self.coupled_motors))

    @property
    def neutral(self) -> Array:
        """Coordinates (nq,) with every joint at zero."""
        no_coordinates = np.zeros(0)  # concatenate needs an array, also without joints
        return np.concatenate([no_coordinates, *(body.joint.neutral for body in self.leaders)])

    def ancestors(self, body: int) -> set[int]:
        """Indices of a moving body and of the bodies between it and the base; empty for the base.

        Parameters
        ----------
        body : int, index of the moving body

        Returns
        -------
        bodies : set of int

        Examples
        --------
        >>> import twistwrench as tw
        >>> sorted(tw.robots.planar_3r().model.ancestors(1))
        [0, 1]
        """
        bodies = set[int]()
        while body != BASE:
            bodies.add(body)
            body = self.bodies[body].parent
        return bodies

    @cached_property
    def possible_tips(self) -> tuple[str, ...]:
        """Frames that may be the tip: links that carry several moving joints, farthest from the base first, then the leaves."""
        joint_counts: Counter[str] = Counter()  # moving joints that each link carries
        for body in self.bodies:
            if body.joint.moves_body and body.link in self.mounts:
                carrier, _ = self.mounts[body.link]
                joint_counts[carrier] += 1
        branching_links: list[str] = []
        for link, joint_count in joint_counts.items():
            if joint_count > 1 and link in self.frames and self.frames[link].body != BASE:
                branching_links.append(link)
        branching_links.sort(key=lambda link: -len(self.ancestors(self.frames[link].body)))
        return tuple(dict.fromkeys([*branching_links, *self.leaves]))

    def frame(self, name: str | None) -> Frame:
        """Frame with a name; the tip for None.

        Parameters
        ----------
        name : str or None

        Returns
        -------
        frame : Frame

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.robots.planar_2r().model.frame(None).body
        1
        """
        if name is None:
            if self.tip is None:
                tips = self.possible_tips
                raise FrameError(
                    f"robot {self.name!r} has no single tip, so the frame must be named. It may be one of "
                    f"{listed(tips, _MAX_LISTED_TIPS)}. Load with {argument('tip', tips[0])}, or name the frame in the call."
                )
            name = self.tip
        try:
            return self.all_frames[name]
        except (KeyError, TypeError):  # TypeError: a name that cannot be hashed
            raise UnknownNameError.from_choices("frame", name, self.all_frames) from None
