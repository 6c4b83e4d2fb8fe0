"""Torques of a robot that stands: contact forces of least norm take part in every torque, and are a cause of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.typing import Array
from ...motion.differentiation import MotionSamples
from ...motion.load_case import TERMS, LoadCase
from ...statics.support import ContactForces, contact_forces, exceeding
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
        tau = self.torques_in_the_air(s) if robot is None else np.asarray(robot.inverse_dynamics(s.q, s.dq, s.ddq))
        carrying = self.ground.carrying(self.robot, s)
        return self._forces(self.with_load if robot is None else robot, s.q, tau, carrying), carrying

    def _forces(self, robot: Robot, q: Array, tau: Array, carrying: Array) -> ContactForces:
        """Contact forces that balance torques (n, nv) at the free base.

        If no friction is given, instants that need more than is assumed, to balance or to keep the torque limits, are those
        of unlimited friction.
        """
        found = contact_forces(robot, q, tau, self.ground.contacts, carrying, self.effort)
        more = np.flatnonzero((~found.holds | self._strained(tau, found)) & carrying.any(axis=1))
        if self.ground.given or not len(more):
            return found
        again = contact_forces(robot, q[more], tau[more], self.ground.unlimited_contacts, carrying[more], self.effort)
        better = more[~found.holds[more] | ~self._strained(tau[more], again)]
        kept = np.isin(more, better)
        forces, holds = found.forces.copy(), found.holds.copy()
        forces[better], holds[better] = again.forces[kept], again.holds[kept]
        return ContactForces(forces, found.maps, holds)

    def _strained(self, tau: Array, found: ContactForces) -> Array:
        """True for states whose torques exceed their limits with these forces."""
        if self.effort is None:
            return np.zeros(len(tau), bool)
        limits = np.where(floating_entries(self.robot), np.inf, self.effort)
        return exceeding(tau - _torques_of(found), limits)

    def torques(self, s: MotionSamples) -> Array:
        """Inverse dynamics with payloads, wrenches, contact forces and friction; (n,) states → (n, nv)."""
        return self._without_base(super().torques(s))

    def unloaded_torques(self, s: MotionSamples) -> Array:
        """Torques without payloads and wrenches, on the ground."""
        forces, _ = self.contact(s, self.robot)
        tau = np.asarray(self.robot.inverse_dynamics(s.q, s.dq, s.ddq)) - _torques_of(forces)
        tau = tau + self._friction(s, tau) if self.friction else tau
        return self._without_base(tau)

    def terms(self, s: MotionSamples) -> dict[str, Array]:
        """Causes, (n, nv) each, in the order of :attr:`causes`; their sum is :meth:`torques`."""
        found = super().terms(s)
        del found["friction"]
        found[CONTACT] = -_torques_of(self.contact(s)[0])
        tau = np.sum(list(found.values()), axis=0)
        return {**found, "friction": self._friction(s, tau) if self.friction else np.zeros_like(s.dq)}

    def mass_matrix(self, q: Array) -> Array:
        """Drive torques per joint acceleration (..., nv, nv), with the contact forces of least norm that it changes."""
        M = np.asarray(super().mass_matrix(q))
        flat = np.asarray(q, float).reshape(-1, q.shape[-1])
        still = np.zeros((len(flat), self.robot.nv))
        states = MotionSamples(still[:, 0], flat, still, still, flat, still.astype(bool), np.zeros((len(flat), 0)))
        free = floating_entries(self.robot)
        forces, carrying = self.contact(states)
        G = (forces.maps * carrying[:, None, :, None]).reshape(len(flat), self.robot.nv, -1)
        moved = np.asarray(M).reshape(-1, *M.shape[-2:])
        borne = G @ np.linalg.pinv(G[:, free]) @ moved[:, free]
        return np.asarray((moved - borne).reshape(M.shape))

    def explain(self, s: MotionSamples) -> Explanation:
        """Drive torques of one state by link and by term, with contact forces and friction."""
        row = MotionSamples(*(np.asarray(x)[None] for x in vars(s).values()))
        why = replace(self, friction=False)._plain_explanation(s)
        why = why.with_term(CONTACT, -_torques_of(self.contact(row)[0])[0])
        return why.with_term("friction", self._friction(s, why.torque)) if self.friction else why

    def _plain_explanation(self, s: MotionSamples) -> Explanation:
        return super().explain(s)

    def _wrenches(self, s: MotionSamples) -> dict[str, Array] | None:
        """Wrenches on frames, those of the contacts among them."""
        found = dict(self.wrenches_on(s) or {})
        forces, _ = self.contact(s)
        for frame in self.ground.frames:
            T = np.asarray(self.robot.forward_kinematics(s.q, frame))
            own = np.zeros((len(s), 6))
            for k in self.ground.contacts_at(frame):
                contact, f = self.ground.contacts[k], forces.forces[:, k]
                moment = np.cross(T[:, :3, :3] @ contact.point - contact.radius * contact.normal, f)
                own += np.concatenate([np.einsum("nji,nj->ni", T[:, :3, :3], x) for x in (moment, f)], axis=1)
            found[frame] = found.get(frame, 0.0) + own
        return found

    def _without_base(self, tau: Array) -> Array:
        return np.where(floating_entries(self.robot), 0.0, tau)


def _torques_of(found: ContactForces) -> Array:
    return np.einsum("nvck,nck->nv", found.maps, found.forces)
