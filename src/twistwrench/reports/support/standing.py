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
"""Name of a cause of torque: forces of the ground."""


@dataclass(frozen=True, eq=False)
class StandingCase(LoadCase):
    """Load case of a robot on the ground. A free base needs no torque; contacts stick if no forces balance."""

    ground: Ground = field(kw_only=True)
    """Contacts with the ground, and the rule by which they carry."""
    effort: Array | None = None
    """(nv,): torque limits. If the forces of least norm exceed them, other forces are chosen that exceed them least."""

    @property
    def causes(self) -> tuple[str, ...]:
        """Causes of a torque, in order: friction is the last, since it depends on the contact forces."""
        *other_terms, friction = TERMS
        return (*other_terms, CONTACT, friction)

    @property
    def fixed_words(self) -> str:
        """Reason why a page has no slider for the payload."""
        return "contact forces change with the load"

    @property
    def payload_mass(self) -> float:
        """Mass of the single payload [kg]; 0 without one, or with several."""
        if len(self.payloads) != 1:
            return 0.0
        return self.payloads[0].mass

    def wrenches_on(self, s: MotionSamples) -> dict[str, Array] | None:
        """Given wrenches (n, 6) by frame, without contact forces; None if no wrench is given."""
        return super()._wrenches(s)

    def torques_in_the_air(self, s: MotionSamples) -> Array:
        """Inverse dynamics (n, nv) with payloads and wrenches, without contacts and friction."""
        wrenches = self.wrenches_on(s)
        return np.asarray(self.with_load.inverse_dynamics(s.q, s.dq, s.ddq, wrench_on_robot=wrenches))

    def contact(self, s: MotionSamples, robot: Robot | None = None) -> tuple[ContactForces, Array]:
        """Forces of the contacts on a robot, and a mask (n, c) of the contacts that carry.

        The default robot is the one with its payloads, under the given wrenches. Another robot has no wrenches.
        """
        carrying = self.ground.carrying(self.robot, s)
        if robot is None:
            robot = self.with_load
            tau = self.torques_in_the_air(s)
        else:
            tau = np.asarray(robot.inverse_dynamics(s.q, s.dq, s.ddq))
        return self._forces(robot, s.q, tau, carrying), carrying

    def _forces(self, robot: Robot, q: Array, tau: Array, carrying: Array) -> ContactForces:
        """Contact forces that balance torques (n, nv) at the free base.

        If no friction is given, friction is assumed. Instants that need more friction, to balance or to keep the torque
        limits, get the forces with unlimited friction.
        """
        limited_forces = contact_forces(robot, q, tau, self.ground.contacts, carrying, self.effort)
        if self.ground.given:
            return limited_forces
        needs_friction = ~limited_forces.holds | self._exceed_limits(tau, limited_forces)
        rows = np.flatnonzero(needs_friction & carrying.any(axis=1))
        if not len(rows):
            return limited_forces
        contacts = self.ground.unlimited_contacts
        unlimited_forces = contact_forces(robot, q[rows], tau[rows], contacts, carrying[rows], self.effort)
        # Unlimited friction does not help where torques still exceed their limits; forces that balance stay there.
        is_better = ~(limited_forces.holds[rows] & self._exceed_limits(tau[rows], unlimited_forces))
        forces = limited_forces.forces.copy()
        holds = limited_forces.holds.copy()
        forces[rows[is_better]] = unlimited_forces.forces[is_better]
        holds[rows[is_better]] = unlimited_forces.holds[is_better]
        return ContactForces(forces, limited_forces.maps, holds)

    def _exceed_limits(self, tau: Array, contacts: ContactForces) -> Array:
        """Mask (n,) of states in which tau, minus the torques of the contact forces, exceeds the torque limits."""
        if self.effort is None:
            return np.zeros(len(tau), bool)
        limits = np.where(floating_entries(self.robot), np.inf, self.effort)
        return exceeding(tau - _torques_of(contacts), limits)

    def torques(self, s: MotionSamples) -> Array:
        """Inverse dynamics with payloads, wrenches, contact forces and friction; (n,) states → (n, nv)."""
        tau = super().torques(s)  # with _wrenches, which include the contact forces
        return self._without_base(tau)

    def unloaded_torques(self, s: MotionSamples) -> Array:
        """Torques (n, nv) on the ground without payloads and wrenches."""
        forces, _ = self.contact(s, self.robot)
        torques_in_the_air = np.asarray(self.robot.inverse_dynamics(s.q, s.dq, s.ddq))
        tau = torques_in_the_air - _torques_of(forces)
        return self._without_base(self._with_friction(s, tau))

    def terms(self, s: MotionSamples) -> dict[str, Array]:
        """Causes, (n, nv) each, in the order of :attr:`causes`; their sum is :meth:`torques`."""
        terms = super().terms(s)  # with the given wrenches only
        del terms["friction"]  # replaced below: friction depends on all other torques
        forces, _ = self.contact(s)
        terms[CONTACT] = -_torques_of(forces)
        tau = np.sum(list(terms.values()), axis=0)
        terms["friction"] = np.zeros_like(s.dq)
        if self.friction:
            terms["friction"] = self._friction(s, tau)
        return terms

    def mass_matrix(self, q: Array) -> Array:
        """Drive torques per joint acceleration (..., nv, nv), minus the torques of the contact forces that bear the free base.

        Accelerations change the contact forces, in proportion: f = G_b⁺ M_b q̈, with the rows b of the free base.
        """
        M = np.asarray(super().mass_matrix(q))
        q_rows = np.asarray(q, float).reshape(-1, q.shape[-1])
        n = len(q_rows)
        zeros = np.zeros((n, self.robot.nv))
        states_at_rest = MotionSamples(
            time=zeros[:, 0],
            q=q_rows,
            dq=zeros,
            ddq=zeros,
            measured=q_rows,
            stationary=zeros.astype(bool),
            outlier=np.zeros((n, 0)),
        )
        b = floating_entries(self.robot)
        forces, carrying = self.contact(states_at_rest)
        maps = forces.maps * carrying[:, None, :, None]  # (n, nv, c, 3), zero for contacts that do not carry
        G = maps.reshape(n, self.robot.nv, -1)  # torques of the contact forces f are G f
        M_in_the_air = np.asarray(M).reshape(-1, *M.shape[-2:])
        M_of_contacts = G @ np.linalg.pinv(G[:, b]) @ M_in_the_air[:, b]
        return np.asarray((M_in_the_air - M_of_contacts).reshape(M.shape))

    def explain(self, s: MotionSamples) -> Explanation:
        """Drive torques of one state by link and by term, with contact forces and friction."""
        motion_of_one_row = MotionSamples(**{name: np.asarray(values)[None] for name, values in vars(s).items()})
        forces, _ = self.contact(motion_of_one_row)
        (contact_torques,) = _torques_of(forces)
        # Friction depends on the contact forces, so it comes last.
        explanation = replace(self, friction=False)._explanation_in_the_air(s)
        explanation = explanation.with_term(CONTACT, -contact_torques)
        if not self.friction:
            return explanation
        return explanation.with_term("friction", self._friction(s, explanation.torque))

    def _explanation_in_the_air(self, s: MotionSamples) -> Explanation:
        """Drive torques without contacts, by the inherited method that :meth:`explain` replaces."""
        return super().explain(s)

    def _wrenches(self, s: MotionSamples) -> dict[str, Array] | None:
        """Wrenches (n, 6) on the robot by frame, in its axes: the given wrenches plus the contact forces."""
        wrenches = dict(self.wrenches_on(s) or {})
        forces, _ = self.contact(s)
        for frame in self.ground.frames:
            T = np.asarray(self.robot.forward_kinematics(s.q, frame))
            R = T[:, :3, :3]
            wrench = np.zeros((len(s), 6))
            for k in self.ground.contacts_at(frame):
                contact = self.ground.contacts[k]
                f = forces.forces[:, k]
                lever = R @ contact.point - contact.radius * contact.normal  # a ball touches below its centre
                moment = np.cross(lever, f)
                wrench[:, :3] += np.einsum("nji,nj->ni", R, moment)
                wrench[:, 3:] += np.einsum("nji,nj->ni", R, f)
            given_wrench = wrenches.get(frame, 0.0)  # zero if none is given
            wrenches[frame] = given_wrench + wrench
        return wrenches

    def _without_base(self, tau: Array) -> Array:
        """Torques (n, nv) with zeros at the free base."""
        return np.where(floating_entries(self.robot), 0.0, tau)


def _torques_of(contacts: ContactForces) -> Array:
    """Torques (n, nv) of the contact forces."""
    return np.einsum("nvck,nck->nv", contacts.maps, contacts.forces)
