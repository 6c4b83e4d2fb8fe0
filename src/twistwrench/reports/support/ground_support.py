"""Support of a robot by the ground along a motion: contact forces, margins, and feet that slide."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.typing import Array
from ...statics.balance import exceeding
from ...statics.contact_forces import friction_within
from ...statics.contacts import contact_maps
from ...statics.support import Support, support
from ...statics.torque_limits import floating_entries
from .ground import UNLIMITED_FRICTION, Ground
from .slope import ground_doubt, samples
from .standing import StandingCase

if TYPE_CHECKING:
    from ...motion.differentiation import MotionSamples
    from ...motion.motion import Motion
    from ...robot import Robot
    from ...statics.contacts import Contact
    from .noise import SupportNoise

_STATES_PER_BATCH = 4096
"""Number of states that are evaluated at once."""
_MAX_STANDING_SPEED = 0.1
"""Speed of a foot on the ground above which it slides [m/s]."""
_MAX_HEIGHT_ON_FLOOR = 0.01
"""Height above the floor up to which a foot is on it [m]."""
MAX_DETERMINATE_CONTACTS = 3
"""Largest number of contacts whose forces follow from the balance alone."""
_MIN_LENGTH = 1e-3
"""Least extent of the contacts [m] in the comparison of width and length."""
_MIN_WIDTH_SHARE = 1e-3
"""Ratio of width to length of the contacts below which they lie on one line."""


@dataclass(frozen=True, eq=False, repr=False)
class GroundSupport(Support):
    """Support of a robot by the ground along a motion, with the times and the contacts that carry."""

    in_contact: Array = field(kw_only=True)
    """(n, c) of bool: contacts that carry."""
    case: StandingCase = field(kw_only=True)
    """Robot with its payloads and its ground."""
    states: Motion = field(kw_only=True)
    """States of the motion."""
    need: Array = field(kw_only=True)
    """(n,): magnitude of the force that the floating base needs [N]."""
    sliding: tuple[str, float, float] | None = field(kw_only=True)
    """Foot on the ground that moves although no other foot carries, with its speed [m/s] and time [s]; None if none does."""
    strained: bool = field(kw_only=True)
    """True if torques exceed their limits at some instant, whatever forces within the cones are chosen."""
    noise: SupportNoise | None = field(kw_only=True, default=None)
    """Effect of the log's noise; None if its accelerations have none."""

    @property
    def ground(self) -> Ground:
        """Contacts, and the rule by which they carry."""
        return self.case.ground

    @property
    def robot(self) -> Robot:
        """Robot with its payloads."""
        return self.case.with_load

    @property
    def time(self) -> Array:
        """(n,) times of the states [s]."""
        return self.states.time

    def again(self, s: MotionSamples, contacts: tuple[Contact, ...], in_contact: Array) -> Support:
        """Support of other states, or on other contacts, of the same robot with its loads."""
        return _support_of_states(self.case, s, contacts, in_contact)

    def failing_motions(self, s: MotionSamples, rows: Array) -> tuple[Array, Array]:
        """Motions (k, nv) that prove that the states ``rows`` fail, and their power; friction is unlimited unless given."""
        if self.ground.given:
            return self.motion[rows], self.power[rows]
        unlimited = self.again(s, self.ground.unlimited_contacts, self.in_contact[rows])
        return np.nan_to_num(unlimited.motion), np.nan_to_num(unlimited.power)

    @cached_property
    def ground_doubt(self) -> str:
        """Reason why the ground is not as assumed; empty if it fits."""
        return ground_doubt(self.case, self.states, self.in_contact, self.aground & ~self.holds)

    @property
    def aground(self) -> Array:
        """(n,) of bool: instants with a contact that carries."""
        return np.asarray(self.in_contact.any(axis=1))

    @property
    def balanced(self) -> Array:
        """(n,) of bool: instants at which forces balance, with any friction if none is given."""
        if self.ground.given:
            return self.holds
        return self.aground & np.isfinite(self.friction)

    @cached_property
    def balanced_forces(self) -> Array:
        """(n, c, 3): ``forces`` [N], but forces with unlimited friction at instants that need more friction than is assumed."""
        forces = self.forces.copy()
        rows_needing_friction = np.flatnonzero(self.balanced & ~self.holds)
        for start in range(0, len(rows_needing_friction), _STATES_PER_BATCH):
            rows = rows_needing_friction[start : start + _STATES_PER_BATCH]
            contact_forces, _ = self.case.contact(samples(self.states, rows))
            forces[rows] = contact_forces.forces
        return forces

    @cached_property
    def balancing(self) -> Array:
        """(n,) of bool: instants whose contacts lie on one line, so that the robot can only balance."""
        _, points = contact_maps(self.robot, self.states.q, self.contacts)
        on_a_line = np.zeros(len(self.time), bool)
        for k in np.flatnonzero(self.aground & ~self.holds):
            carrying_points = points[k, self.in_contact[k]]
            if len(carrying_points) < 3:
                on_a_line[k] = True
                continue
            centred_points = carrying_points - carrying_points.mean(axis=0)
            length, width, _ = np.linalg.svd(centred_points, compute_uv=False)
            on_a_line[k] = width < _MIN_WIDTH_SHARE * max(_MIN_LENGTH, length)
        return on_a_line


def ground_support(load: StandingCase, motion: Motion) -> GroundSupport:
    """Support along the states of a motion, computed in batches."""
    batches, in_contact_of_batches, base_forces = [], [], []
    is_strained = False
    force_indices = _floating_base_indices(load.robot)[3:]  # in τ, after the moments
    for start in range(0, len(motion), _STATES_PER_BATCH):
        s = samples(motion, slice(start, start + _STATES_PER_BATCH))
        in_contact_of_batch = load.ground.carrying(load.robot, s)
        batch = _support_of_states(load, s, load.ground.contacts, in_contact_of_batch)
        if load.effort is not None:
            batch, exceeds_limits = _with_torque_limits(load, s, batch, in_contact_of_batch, load.effort)
            is_strained |= exceeds_limits
        batches.append(batch)
        in_contact_of_batches.append(in_contact_of_batch)
        base_force = load.torques_in_the_air(s)[:, force_indices]
        base_forces.append(np.linalg.norm(base_force, axis=1))
    joined_arrays: dict[str, Any] = {}
    for support_field in fields(Support):
        name = support_field.name
        if name != "contacts":  # the only field without a row for each state
            joined_arrays[name] = np.concatenate([getattr(batch, name) for batch in batches])
    in_contact = np.concatenate(in_contact_of_batches)
    return GroundSupport(
        **joined_arrays,
        contacts=load.ground.contacts,
        in_contact=in_contact,
        case=load,
        states=motion,
        need=np.concatenate(base_forces),
        sliding=_sliding_foot(load, motion, in_contact),
        strained=is_strained,
    )


def _with_torque_limits(
    load: StandingCase, s: MotionSamples, batch: Support, in_contact: Array, limits: Array
) -> tuple[Support, bool]:
    """Support with the friction that also keeps the torque limits (nv,), and True if no friction keeps them at some state."""
    robot = load.with_load
    effort = np.where(floating_entries(load.robot), np.inf, limits)
    tau = load.torques_in_the_air(s)
    friction = batch.friction.copy()
    torques = batch.torques
    if load.ground.given:
        max_friction = float(load.ground.frictions.max())
        rows = np.flatnonzero(batch.holds)
    else:
        max_friction = UNLIMITED_FRICTION
        rows = np.flatnonzero(np.isfinite(friction) & in_contact.any(axis=1))
    if len(rows):
        friction[rows] = friction_within(
            robot, s.q[rows], tau[rows], load.ground.contacts, in_contact[rows], friction[rows], effort, max_friction
        )
    if not load.ground.given:
        forces, _ = load.contact(s)
        torques = tau - np.einsum("nvck,nck->nv", forces.maps, forces.forces)
        torques = np.where(forces.holds[:, None], torques, np.nan)
    return replace(batch, friction=friction), bool(exceeding(torques, effort).any())


def _floating_base_indices(robot: Robot) -> Array:
    """Indices in τ of the floating base: moments, then forces."""
    return np.flatnonzero(floating_entries(robot))


def _support_of_states(
    load: StandingCase, s: MotionSamples, contacts: tuple[Contact, ...], in_contact: Array
) -> Support:
    """Support of states on some contacts. An additional payload would be where the load case has one, or at the tip."""
    frame: str | None = load.robot.model.tip
    com = (0.0, 0.0, 0.0)
    if load.payload_mass:
        payload = load.payloads[0]
        frame = payload.frame or frame
        com = payload.place
    if frame in load.ground.frames:  # a mass at a foot says nothing about what the robot can carry
        frame = None
    return support(
        load.with_load,
        s.q,
        s.dq,
        s.ddq,
        contacts,
        in_contact=in_contact,
        wrench_on_robot=load.wrenches_on(s),
        limits=load.effort,
        payload_frame=frame,
        payload_com=com,
    )


def _sliding_foot(load: StandingCase, motion: Motion, in_contact: Array) -> tuple[str, float, float] | None:
    """Fastest foot on the floor while no contact carries, with its speed [m/s] and the time [s]; None if all are slow."""
    in_the_air = np.flatnonzero(~in_contact.any(axis=1))
    if not len(in_the_air):
        return None
    normal = load.ground.normal
    contacts = load.ground.contacts
    min_heights = []  # of each batch [m]
    for start in range(0, len(motion), _STATES_PER_BATCH):
        _, points = contact_maps(load.robot, motion.q[start : start + _STATES_PER_BATCH], contacts)
        heights = points @ normal
        min_heights.append(float(heights.min()))
    floor_height = min(min_heights)
    maps, points = contact_maps(load.robot, motion.q[in_the_air], contacts)
    velocities = np.einsum("nvck,nv->nck", maps, motion.dq[in_the_air])
    speeds = np.linalg.norm(velocities, axis=-1)
    is_on_floor = points @ normal <= floor_height + _MAX_HEIGHT_ON_FLOOR
    speeds_on_floor = np.where(is_on_floor, speeds, 0.0)
    row, contact_index = np.unravel_index(int(speeds_on_floor.argmax()), speeds_on_floor.shape)
    speed = float(speeds_on_floor[row, contact_index])
    if speed <= _MAX_STANDING_SPEED:
        return None
    state_index = in_the_air[row]
    return str(contacts[contact_index].frame), speed, float(motion.time[state_index])
