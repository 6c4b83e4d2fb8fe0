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
    """Load case of a robot on the ground. A free base needs no torque; where no forces balance, contacts stick."""

    ground: Ground = field(kw_only=True)
    """Contacts with the ground, and the rule by which they carry."""
    effort: Array | None = None
    """(nv,): torque limits. If the torques of the least forces exceed them, other forces are chosen whose torques do not, or
    exceed them least."""

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
        """Forces of the contacts on a robot, and a mask (n, c) of the contacts that carry.

        The default is the robot with its payloads, under the given wrenches; another robot is under no wrenches.
        """
        carrying = self.ground.carrying(self.robot, s)
        if robot is None:
            robot, tau = self.with_load, self.torques_in_the_air(s)
        else:
            tau = np.asarray(robot.inverse_dynamics(s.q, s.dq, s.ddq))
        return self._forces(robot, s.q, tau, carrying), carrying

    def _forces(self, robot: Robot, q: Array, tau: Array, carrying: Array) -> ContactForces:
        """Contact forces that balance torques (n, nv) at the free base.

        If no friction is given, some instants need more than the assumed friction, to balance or to keep the torque limits.
        Their forces are those with unlimited friction.
        """
        assumed = contact_forces(robot, q, tau, self.ground.contacts, carrying, self.effort)
        if self.ground.given:
            return assumed
        needs_friction = ~assumed.holds | self._exceed_limits(tau, assumed)
        rows = np.flatnonzero(needs_friction & carrying.any(axis=1))
        if not len(rows):
            return assumed
        contacts = self.ground.unlimited_contacts
        unlimited = contact_forces(robot, q[rows], tau[rows], contacts, carrying[rows], self.effort)
        # Forces that balance stay if torques exceed their limits with unlimited friction as well.
        stays = assumed.holds[rows] & self._exceed_limits(tau[rows], unlimited)
        forces, holds = assumed.forces.copy(), assumed.holds.copy()
        forces[rows[~stays]] = unlimited.forces[~stays]
        holds[rows[~stays]] = unlimited.holds[~stays]
        return ContactForces(forces, assumed.maps, holds)

    def _exceed_limits(self, tau: Array, contacts: ContactForces) -> Array:
        """Mask (n,) of states whose drive torques, tau less those of the contact forces, exceed their limits."""
        if self.effort is None:
            return np.zeros(len(tau), bool)
        limits = np.where(floating_entries(self.robot), np.inf, self.effort)
        return exceeding(tau - _torques_of(contacts), limits)

    def torques(self, s: MotionSamples) -> Array:
        """Inverse dynamics with payloads, wrenches, contact forces and friction; (n,) states → (n, nv)."""
        return self._without_base(super().torques(s))  # it calls _wrenches, which include those of the contacts

    def unloaded_torques(self, s: MotionSamples) -> Array:
        """Torques without payloads and wrenches, on the ground."""
        forces, _ = self.contact(s, self.robot)
        tau = np.asarray(self.robot.inverse_dynamics(s.q, s.dq, s.ddq)) - _torques_of(forces)
        return self._without_base(self._with_friction(s, tau))

    def terms(self, s: MotionSamples) -> dict[str, Array]:
        """Causes, (n, nv) each, in the order of :attr:`causes`; their sum is :meth:`torques`."""
        terms = super().terms(s)  # its wrenches are the given ones, without those of the contacts
        del terms["friction"]  # replaced below: friction depends on all other torques
        forces, _ = self.contact(s)
        terms[CONTACT] = -_torques_of(forces)
        tau = np.sum(list(terms.values()), axis=0)
        terms["friction"] = np.zeros_like(s.dq)
        if self.friction:
            terms["friction"] = self._friction(s, tau)
        return terms

    def mass_matrix(self, q: Array) -> Array:
        """Drive torques per joint acceleration (..., nv, nv), less those of the contact forces that bear the free base.

        Accelerations change the contact forces, in proportion: f = G_b⁺ M_b q̈, with the rows b of the free base.
        """
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
        maps = forces.maps * carrying[:, None, :, None]  # (n, nv, c, 3), zero for contacts that do not carry
        G = maps.reshape(len(rows), self.robot.nv, -1)  # torques of the contact forces f
        M_in_the_air = np.asarray(M).reshape(-1, *M.shape[-2:])
        borne = G @ np.linalg.pinv(G[:, free]) @ M_in_the_air[:, free]
        return np.asarray((M_in_the_air - borne).reshape(M.shape))

    def explain(self, s: MotionSamples) -> Explanation:
        """Drive torques of one state by link and by term, with contact forces and friction."""
        motion_of_one_row = MotionSamples(*[np.asarray(values)[None] for values in vars(s).values()])
        forces, _ = self.contact(motion_of_one_row)
        # Friction depends on the forces of the contacts, so it comes last.
        explanation = replace(self, friction=False)._explanation_in_the_air(s)
        explanation = explanation.with_term(CONTACT, -_torques_of(forces)[0])
        if not self.friction:
            return explanation
        return explanation.with_term("friction", self._friction(s, explanation.torque))

    def _explanation_in_the_air(self, s: MotionSamples) -> Explanation:
        """Drive torques without contacts, by the inherited method that :meth:`explain` replaces."""
        return super().explain(s)

    def _wrenches(self, s: MotionSamples) -> dict[str, Array] | None:
        """Given wrenches and those of the contacts (n, 6) by frame, in its axes."""
        wrenches = dict(self.wrenches_on(s) or {})
        forces, _ = self.contact(s)
        for frame in self.ground.frames:
            T = np.asarray(self.robot.forward_kinematics(s.q, frame))
            R = T[:, :3, :3]
            wrench = np.zeros((len(s), 6))
            for k in self.ground.contacts_at(frame):
                contact, f = self.ground.contacts[k], forces.forces[:, k]
                lever = R @ contact.point - contact.radius * contact.normal  # a ball touches below its centre
                moment = np.cross(lever, f)
                wrench[:, :3] += np.einsum("nji,nj->ni", R, moment)
                wrench[:, 3:] += np.einsum("nji,nj->ni", R, f)
            wrenches[frame] = wrenches.get(frame, 0.0) + wrench
        return wrenches

    def _without_base(self, tau: Array) -> Array:
        """Torques (n, nv) with zeros at the free base."""
        return np.where(floating_entries(self.robot), 0.0, tau)


def _torques_of(contacts: ContactForces) -> Array:
    """Torques (n, nv) of the contact forces."""
    return np.einsum("nvck,nck->nv", contacts.maps, contacts.forces)
