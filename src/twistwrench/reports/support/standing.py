"""Torques of a robot that stands: contact forces of least norm take part in every torque, and are a cause of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.typing import Array
from ...motion.differentiation import MotionSamples
from ...motion.load_case import TERMS, LoadCase
from ...statics.balance import exceeding
from ...statics.contact_forces import ContactForces, contact_forces
from ...statics.torque_limits import floating_entries
from .ground import Ground

if TYPE_CHECKING:
    from ...robot import Robot
    from ...robot.explanation import Explanation

CONTACT = "contact"
"""Cause of a torque: forces of the ground."""


@dataclass(frozen=True, eq=False)
class StandingCase(LoadCase):
    """Load case of a robot on the ground. A free base needs no torque; where no forces balance, contacts stick."""

    ground: Ground = field(kw_only=True)
    effort: Array | None = None
    """(nv,): torque limits; where the least forces exceed them, others are chosen that do not, or do so least."""

    @property
    def causes(self) -> tuple[str, ...]:
        """Causes of a torque, in order."""
        *without_friction, friction = TERMS
        return (*without_friction, CONTACT, friction)

    @property
    def fixed_words(self) -> str:
        """Reason why torques of other payloads are not known from those of this one, so that a page has no slider for them."""
        return "contact forces change with the load"

    @property
    def payload_mass(self) -> float:
        """Mass of the single payload [kg]; 0 without one, or with several."""
        if len(self.payloads) != 1:
            return 0.0
        return self.payloads[0].mass

    def wrenches_on(self, s: MotionSamples) -> dict[str, Array] | None:
        """Given wrenches (n, 6) by frame, without those of contacts; None without any."""
        return super()._wrenches(s)

    def torques_in_the_air(self, s: MotionSamples) -> Array:
        """Inverse dynamics (n, nv) with payloads and wrenches, without contacts and friction."""
        return np.asarray(self.with_load.inverse_dynamics(s.q, s.dq, s.ddq, wrench_on_robot=self.wrenches_on(s)))

    def contact(self, s: MotionSamples, robot: Robot | None = None) -> tuple[ContactForces, Array]:
        """Forces of the contacts on a robot (default: with its payloads), and which carry, (n, c)."""
        carrying = self.ground.carrying(self.robot, s)
        if robot is None:
            return self._forces(self.with_load, s.q, self.torques_in_the_air(s), carrying), carrying
        tau = np.asarray(robot.inverse_dynamics(s.q, s.dq, s.ddq))
        return self._forces(robot, s.q, tau, carrying), carrying

    def _forces(self, robot: Robot, q: Array, tau: Array, carrying: Array) -> ContactForces:
        """Contact forces that balance torques (n, nv) at the free base.

        If no friction is given, some instants need more than the assumed friction, to balance or to keep the torque limits.
        Their forces are those with unlimited friction.
        """
        assumed = contact_forces(robot, q, tau, self.ground.contacts, carrying, self.effort)
        rows = np.flatnonzero((~assumed.holds | self._exceeds(tau, assumed)) & carrying.any(axis=1))
        if self.ground.given or not len(rows):
            return assumed
        contacts = self.ground.unlimited_contacts
        unlimited = contact_forces(robot, q[rows], tau[rows], contacts, carrying[rows], self.effort)
        # Forces that balance stay if torques exceed their limits with unlimited friction as well.
        stays = assumed.holds[rows] & self._exceeds(tau[rows], unlimited)
        forces, holds = assumed.forces.copy(), assumed.holds.copy()
        forces[rows[~stays]], holds[rows[~stays]] = unlimited.forces[~stays], unlimited.holds[~stays]
        return ContactForces(forces, assumed.maps, holds)

    def _exceeds(self, tau: Array, contacts: ContactForces) -> Array:
        """True for states whose torques exceed their limits with these forces."""
        if self.effort is None:
            return np.zeros(len(tau), bool)
        limits = np.where(floating_entries(self.robot), np.inf, self.effort)
        return exceeding(tau - _torques_of(contacts), limits)

    def torques(self, s: MotionSamples) -> Array:
        """Inverse dynamics with payloads, wrenches, contact forces and friction; (n,) states → (n, nv)."""
        return self._without_base(super().torques(s))  # whose wrenches are those of _wrenches, with the contacts

    def unloaded_torques(self, s: MotionSamples) -> Array:
        """Torques without payloads and wrenches, on the ground."""
        forces, _ = self.contact(s, self.robot)
        tau = np.asarray(self.robot.inverse_dynamics(s.q, s.dq, s.ddq)) - _torques_of(forces)
        return self._without_base(self._with_friction(s, tau))

    def terms(self, s: MotionSamples) -> dict[str, Array]:
        """Causes, (n, nv) each, in the order of :attr:`causes`; their sum is :meth:`torques`."""
        terms = super().terms(s)  # its wrenches are the given ones, without those of the contacts
        del terms["friction"]  # which depends on all other torques
        terms[CONTACT] = -_torques_of(self.contact(s)[0])
        tau = np.sum(list(terms.values()), axis=0)
        terms["friction"] = np.zeros_like(s.dq)
        if self.friction:
            terms["friction"] = self._friction(s, tau)
        return terms

    def mass_matrix(self, q: Array) -> Array:
        """Drive torques per joint acceleration (..., nv, nv), with the contact forces of least norm that it changes."""
        M = np.asarray(super().mass_matrix(q))
        rows = np.asarray(q, float).reshape(-1, q.shape[-1])
        at_rest = np.zeros((len(rows), self.robot.nv))
        states = MotionSamples(
            time=at_rest[:, 0],
            q=rows,
            dq=at_rest,
            ddq=at_rest,
            measured=rows,
            stationary=at_rest.astype(bool),
            outlier=np.zeros((len(rows), 0)),
        )
        free = floating_entries(self.robot)
        forces, carrying = self.contact(states)
        maps = (
            forces.maps * carrying[:, None, :, None]
        )  # (n, nv, c, 3): torques of the force of each contact that carries
        G = maps.reshape(len(rows), self.robot.nv, -1)
        in_the_air = np.asarray(M).reshape(-1, *M.shape[-2:])
        borne = G @ np.linalg.pinv(G[:, free]) @ in_the_air[:, free]
        return np.asarray((in_the_air - borne).reshape(M.shape))

    def explain(self, s: MotionSamples) -> Explanation:
        """Drive torques of one state by link and by term, with contact forces and friction."""
        row = MotionSamples(
            *[np.asarray(values)[None] for values in vars(s).values()]
        )  # one state as a motion of one row
        # Friction depends on the forces of the contacts, so it comes last.
        why = replace(self, friction=False)._explanation_in_the_air(s)
        why = why.with_term(CONTACT, -_torques_of(self.contact(row)[0])[0])
        if not self.friction:
            return why
        return why.with_term("friction", self._friction(s, why.torque))

    def _explanation_in_the_air(self, s: MotionSamples) -> Explanation:
        """Drive torques without contacts, by the method that :meth:`explain` replaces."""
        return super().explain(s)

    def _wrenches(self, s: MotionSamples) -> dict[str, Array] | None:
        """Wrenches on frames, those of the contacts among them."""
        wrenches = dict(self.wrenches_on(s) or {})
        forces, _ = self.contact(s)
        for frame in self.ground.frames:
            T = np.asarray(self.robot.forward_kinematics(s.q, frame))
            R = T[:, :3, :3]
            wrench = np.zeros((len(s), 6))
            for k in self.ground.contacts_at(frame):
                contact, f = self.ground.contacts[k], forces.forces[:, k]
                moment = np.cross(R @ contact.point - contact.radius * contact.normal, f)
                wrench[:, :3] += np.einsum("nji,nj->ni", R, moment)
                wrench[:, 3:] += np.einsum("nji,nj->ni", R, f)
            wrenches[frame] = wrenches.get(frame, 0.0) + wrench
        return wrenches

    def _without_base(self, tau: Array) -> Array:
        return np.where(floating_entries(self.robot), 0.0, tau)


def _torques_of(found: ContactForces) -> Array:
    return np.einsum("nvck,nck->nv", found.maps, found.forces)
