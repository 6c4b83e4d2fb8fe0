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
        return (*TERMS[:-1], CONTACT, TERMS[-1])

    @property
    def fixed_words(self) -> str:
        """Reason why a page cannot judge other loads."""
        return "contact forces change with the load"

    @property
    def payload_mass(self) -> float:
        """Mass of the single payload [kg]; 0 without one, or with several."""
        return self.payloads[0].mass if len(self.payloads) == 1 else 0.0

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

        If no friction is given, instants that need more than is assumed, to balance or to keep the torque limits, are those
        of unlimited friction.
        """
        assumed = contact_forces(robot, q, tau, self.ground.contacts, carrying, self.effort)
        rows = np.flatnonzero((~assumed.holds | self._exceeds(tau, assumed)) & carrying.any(axis=1))
        if self.ground.given or not len(rows):
            return assumed
        contacts = self.ground.unlimited_contacts
        unlimited = contact_forces(robot, q[rows], tau[rows], contacts, carrying[rows], self.effort)
        better = ~assumed.holds[rows] | ~self._exceeds(tau[rows], unlimited)
        forces, holds = assumed.forces.copy(), assumed.holds.copy()
        forces[rows[better]], holds[rows[better]] = unlimited.forces[better], unlimited.holds[better]
        return ContactForces(forces, assumed.maps, holds)

    def _exceeds(self, tau: Array, contacts: ContactForces) -> Array:
        """True for states whose torques exceed their limits with these forces."""
        if self.effort is None:
            return np.zeros(len(tau), bool)
        limits = np.where(floating_entries(self.robot), np.inf, self.effort)
        return exceeding(tau - _torques_of(contacts), limits)

    def torques(self, s: MotionSamples) -> Array:
        """Inverse dynamics with payloads, wrenches, contact forces and friction; (n,) states → (n, nv)."""
        return self._without_base(super().torques(s))

    def unloaded_torques(self, s: MotionSamples) -> Array:
        """Torques without payloads and wrenches, on the ground."""
        forces, _ = self.contact(s, self.robot)
        tau = np.asarray(self.robot.inverse_dynamics(s.q, s.dq, s.ddq)) - _torques_of(forces)
        if self.friction:
            tau = tau + self._friction(s, tau)
        return self._without_base(tau)

    def terms(self, s: MotionSamples) -> dict[str, Array]:
        """Causes, (n, nv) each, in the order of :attr:`causes`; their sum is :meth:`torques`."""
        terms = super().terms(s)
        del terms["friction"]
        terms[CONTACT] = -_torques_of(self.contact(s)[0])
        tau = np.sum(list(terms.values()), axis=0)
        terms["friction"] = self._friction(s, tau) if self.friction else np.zeros_like(s.dq)
        return terms

    def mass_matrix(self, q: Array) -> Array:
        """Drive torques per joint acceleration (..., nv, nv), with the contact forces of least norm that it changes."""
        M = np.asarray(super().mass_matrix(q))
        rows = np.asarray(q, float).reshape(-1, q.shape[-1])
        zeros = np.zeros((len(rows), self.robot.nv))
        states = MotionSamples(zeros[:, 0], rows, zeros, zeros, rows, zeros.astype(bool), np.zeros((len(rows), 0)))
        free = floating_entries(self.robot)
        forces, carrying = self.contact(states)
        G = (forces.maps * carrying[:, None, :, None]).reshape(len(rows), self.robot.nv, -1)
        in_the_air = np.asarray(M).reshape(-1, *M.shape[-2:])
        borne = G @ np.linalg.pinv(G[:, free]) @ in_the_air[:, free]
        return np.asarray((in_the_air - borne).reshape(M.shape))

    def explain(self, s: MotionSamples) -> Explanation:
        """Drive torques of one state by link and by term, with contact forces and friction."""
        row = MotionSamples(*(np.asarray(x)[None] for x in vars(s).values()))
        why = replace(self, friction=False)._plain_explanation(s)
        why = why.with_term(CONTACT, -_torques_of(self.contact(row)[0])[0])
        if not self.friction:
            return why
        return why.with_term("friction", self._friction(s, why.torque))

    def _plain_explanation(self, s: MotionSamples) -> Explanation:
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
                wrench += np.concatenate([np.einsum("nji,nj->ni", R, x) for x in (moment, f)], axis=1)
            wrenches[frame] = wrenches.get(frame, 0.0) + wrench
        return wrenches

    def _without_base(self, tau: Array) -> Array:
        return np.where(floating_entries(self.robot), 0.0, tau)


def _torques_of(found: ContactForces) -> Array:
    return np.einsum("nvck,nck->nv", found.maps, found.forces)
