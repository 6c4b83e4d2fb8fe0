"""The frozen model of a robot: moving bodies, the joints between them, and the frames fixed to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.inertia import SpatialInertia
from ..errors import FrameError, UnknownNameError
from .actuator import Actuator
from .friction import Friction
from .joint import Joint
from .spring import Spring

Array = NDArray[Any]

__all__ = ["BASE", "Body", "Frame", "Limits", "Model"]

BASE = -1
"""Index that stands for the base, the one body that does not move."""


@dataclass(frozen=True, eq=False)
class Body:
    """One moving body (fixed links fused) and the joint that carries it.

    At joint coordinates ``ratio * q[q_index] + offset`` (mimic joints have a ratio and an offset; the others 1 and 0), the
    body's frame has the pose ``placement @ joint.pose(·)`` in its parent's frame.
    """

    joint: Joint
    link: str
    """The child link, whose frame is the body's frame; links fixed to it moved in with it."""
    parent: int
    placement: Array
    """(4, 4) T_parent,joint."""
    inertia: SpatialInertia
    """About the origin of the body's frame, which is the child link's frame."""
    q_index: int
    """Where the joint's coordinates begin in q."""
    v_index: int
    """Where the joint's velocities begin in dq."""
    ratio: float = 1.0
    offset: float = 0.0
    follows: bool = False
    """Whether the joint mimics another, whose coordinate it shares."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame fixed to a body: index of the body (``BASE`` for the base), and its pose in the body's frame (4, 4)."""

    body: int
    pose: Array


@dataclass(frozen=True, eq=False)
class Limits:
    """Joint limits, one entry per velocity, (nv,) each: rad or m, rad/s or m/s, N m or N; inf where none is given."""

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True, eq=False)
class Model:
    """A robot as data. Parents come before children; made by :class:`~twistwrench.model.builder.ModelBuilder`."""

    name: str
    bodies: tuple[Body, ...]
    frames: dict[str, Frame]
    """Every link of the file by name, fused ones included, in document order."""
    limits: Limits
    friction: Friction
    """Of the joints, left out of every quantity unless it is asked for."""
    gravity: Array
    """(3,) m/s², in the base frame."""
    base_inertia: SpatialInertia
    """The links that do not move, fused, in the base frame."""
    tip: str | None
    """The frame meant when none is named."""
    leaves: tuple[str, ...] = ()
    """Links without children, in document order."""
    defects: tuple[str, ...] = ()
    link_inertias: dict[str, SpatialInertia] = field(default_factory=dict)
    """The inertia of each link by itself, in its own frame, for reports."""
    source: str = ""
    springs: tuple[Spring, ...] = ()
    """Between joint coordinates; their torques are part of the dynamics, as gravity's are."""
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    """What drives the joints, by joint; their rotors are among the bodies, their elasticity among the springs."""
    payloads: tuple[tuple[str, SpatialInertia], ...] = ()
    """(frame, inertia about it) of what was attached; the bodies and the links that carry it have it in them."""
    shaped: frozenset[str] = frozenset()
    """The links that the file gives a shape, to be seen or to be touched."""
    snap: float = 0.0
    """How near to 0 or ±1 an entry of a fixed rotation was to be to count as exactly that; edits keep to it."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "actuators", MappingProxyType(dict(self.actuators)))
        arrays = [self.gravity, *vars(self.limits).values()]
        arrays += [frame.pose for frame in self.frames.values()]
        for array in (*arrays, *(a for body in self.bodies for a in (body.placement, body.joint.axes))):
            array.setflags(write=False)  # robots share these, and kernels have them compiled in

    def __getstate__(self) -> dict[str, Any]:
        state = {f.name: getattr(self, f.name) for f in fields(self)}  # what is derived is derived again
        return {**state, "actuators": dict(self.actuators)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.__post_init__()  # arrays come out of a pickle writable

    @cached_property
    def nq(self) -> int:
        """Number of coordinates."""
        return sum(b.joint.nq for b in self.leaders)

    @cached_property
    def nv(self) -> int:
        """Number of velocities."""
        return sum(b.joint.nv for b in self.leaders)

    @cached_property
    def leaders(self) -> tuple[Body, ...]:
        """The bodies whose joints have coordinates of their own, in the order of q: all but followers of mimic joints."""
        return tuple(sorted((b for b in self.bodies if not b.follows), key=lambda b: b.v_index))

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """A name for each velocity and torque: the joint's, with a suffix where it has several; (nv,)."""
        return tuple(b.joint.name + s for b in self.leaders for s in b.joint.velocity_suffixes)

    @property
    def neutral(self) -> Array:
        """Coordinates with every joint at zero; (nq,)."""
        return np.concatenate([np.zeros(0), *(b.joint.neutral for b in self.leaders)])

    def frame(self, name: str | None) -> Frame:
        """The frame called ``name``, or the tip's; errors list the choices."""
        if name is None:
            if self.tip is None:
                raise FrameError(
                    f"robot {self.name!r} has no single tip, so the frame must be named. "
                    f"Its leaves: {', '.join(self.leaves)}. Pass frame=…, or load with tip=…."
                )
            name = self.tip
        try:
            return self.frames[name]
        except (KeyError, TypeError):
            raise UnknownNameError.of("frame", name, self.frames) from None
