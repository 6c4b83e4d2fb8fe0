"""One pass over the states of a motion and their torques: peaks and their causes, limits, what a picture needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..joints.units import unit_of
from ..model.limits import margin
from ..motion.column_extremes import Extreme
from ..motion.complete_states import States
from ..motion.coordinates import Coordinates
from ..motion.differentiation import Differentiation, pulse_peak
from ..motion.log_outliers import Strays
from ..motion.motion_log import LogRows
from ..typing import Array
from .decimation import Envelope
from .estimates import INTERVAL, PeakEstimate, PeakSearch
from .loaded_robot import STEADY, TERMS, LoadedRobot
from .measured import MeasuredTally, MeasuredTorque
from .motors import MotorTally
from .payload_room import PayloadRoomTally
from .running_statistics import Gaps, Rms
from .torque_findings import ZERO, Excess

if TYPE_CHECKING:
    from ..model.limits import Limits

_AROUND, _KEPT = 2048, 1 << 23
"""Rows kept on either side of each joint's peak, and numbers of all these together: 64 MiB."""
_GAP = 5.0
"""Usual steps of time from which a step is a gap."""
_MASS_SAMPLES = 32
"""States of each portion whose mass matrix carries noise of accelerations into torques, and where payloads are felt."""
_BAND_SAMPLES = 512
"""States of each portion whose mass matrix is that of those up to the next."""


class MotionTally:
    """What is kept of the states, which come in any portions."""

    def __init__(self, load: LoadedRobot, limits: Limits, plan: Differentiation, *, estimating: bool = False) -> None:
        nv = load.bare.nv
        self.load, self.limits, self.plan = load, limits, plan
        self.coordinates = Coordinates.of(load.bare.model)
        self.rows = 0
        self.begin = self.end = np.nan
        self.peak, self.rms = Extreme(nv), Rms(nv)
        self.signed = {kind: np.zeros(nv) for kind in ("effort", "lower", "upper", "velocity")}
        """The values themselves at their worst."""
        self.terms = {name: np.zeros(nv) for name in TERMS}
        self.passed = {kind: Extreme(nv) for kind in ("lower", "upper", "velocity")}
        """By how much."""
        self.envelope, self.band = Envelope(), Envelope()
        """Of the torques, and of their 95 % intervals where that is known, which are none of their largest."""
        self.around: list[States | None] = [None] * nv
        """Of each joint: the states on either side of its peak."""
        self._reach = min(_AROUND, max(1, _KEPT // (2 * nv * (1 + 2 * load.bare.nq + 3 * nv))))
        self.gaps = Gaps(_GAP * plan.quality.step)
        self.noise = np.zeros(nv)
        self.carried = 0.0
        """The largest torque that the payloads make, in some of the states."""
        self.room = PayloadRoomTally(load, limits.effort)
        self.followers = [load.loaded.model.bodies[i] for i in load.loaded.model.limited_followers]
        self.borne, self.borne_signed = Extreme(len(self.followers)), np.zeros(len(self.followers))
        """By mimic joints with a limit of effort."""
        self.largest = np.zeros(load.bare.nq)
        self.strays = Strays()
        self.search = PeakSearch(plan, load) if estimating else None
        """For the peaks less what noise adds to them."""
        self._measured = [MeasuredTally(nv) for _ in range(1 + load.carries)]
        """Beside the torques with all that is carried and pushes, and beside those of the robot alone: the log may have been
        recorded either way."""
        self.motors = MotorTally(load.loaded.model)
        self.still = np.zeros(nv, int)
        """Rows in which the direction of motion is unknown."""

    def add(self, states: States, torques: Array, motion: LogRows, inner: slice) -> None:
        """Take in an overlapping run: its states, the torques (n, nv) of those that are new in it, and what the log says."""
        s = states.at(inner)
        noisy = bool(self.plan.sigma_ddq.any())
        sigma = self._sigma(s) if noisy and (self.search or motion.tau is not None) else np.zeros_like(torques)
        if self.search is not None:
            self.search.add(s, torques, motion, inner)
            self.band.add(s.time, torques - INTERVAL * sigma, torques + INTERVAL * sigma)
        if motion.tau is not None:
            computed = [torques, self.load.unloaded_torques(s)] if self.load.carries else [torques]
            for tally, tau in zip(self._measured, computed, strict=True):
                tally.add(s.time, tau, motion.tau[inner], sigma)
        self.begin = float(s.time[0]) if self.rows == 0 else self.begin
        self.end = float(s.time[-1])
        self.rows += len(s)
        self.rms.add(s.time, torques)
        self.envelope.add(s.time, torques)
        self.gaps.add(s.time, s.q)
        self._look_at_peaks(s, torques)
        self._look_at_limits(s)
        self.largest = np.maximum(self.largest, np.abs(s.logged).max(axis=0))
        self.still += s.still.sum(axis=0)
        if s.stray.any():
            self.strays.add(s.time, s.stray, self._may_pass(s, torques))
        if self.load.loaded.actuators:
            self.motors.add(s.time, self.load.motor_loads(s))
        some = s.at(slice(None, None, max(1, len(s) // _MASS_SAMPLES)))
        if self.plan.sigma_ddq.any():
            M = self.load.loaded.mass_matrix(some.q)
            spread = np.sqrt((M * M) @ (self.plan.sigma_ddq**2))
            self.noise = np.maximum(self.noise, spread.max(axis=0))
        borne = np.zeros((len(s), 0))
        if self.followers:
            borne = self.load.follower_torques(s)
            for k, row in self.borne.add(s.time, np.abs(borne)):
                self.borne_signed[k] = borne[row, k]
        if self.room.asked:
            added = self.load.payload_torques(s)
            if self.followers:
                torques, added = np.hstack([torques, borne]), np.hstack([added, self.load.follower_payload_torques(s)])
            self.room.add(s.time, torques, added)
        if self.load.payloads:
            self.carried = max(self.carried, float(np.abs(self.load.payload_torques(some)).max(initial=0.0)))

    def _sigma(self, s: States) -> Array:
        """(n, nv) standard deviation of the torques, by the mass matrices of some of the states."""
        stride = max(1, len(s) // _BAND_SAMPLES)
        M = self.load.loaded.mass_matrix(s.q[::stride])
        squares = self.plan.sigma_at(s) ** 2
        blocks = [(M[k] * M[k]) @ squares[k * stride : (k + 1) * stride].T for k in range(len(M))]
        return np.sqrt(np.concatenate(blocks, axis=1).T)

    def _may_pass(self, s: States, torques: Array) -> Array:
        """(n, k) bool: a flattened sample is a torque beyond a limit, or of a joint without one, if the robot did move so."""
        plan, found = self.plan, np.zeros(s.stray.shape[:2], bool)
        order = 1 if plan.source == "velocities" else 2
        gain = pulse_peak(order, plan.quality.step)
        joint_of = {int(p): v for v, p in enumerate(self.coordinates.position_of) if p >= 0}
        rows, columns = np.nonzero(s.stray[:, :, 0])
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            joint = column if order == 1 else joint_of.get(column)
            if joint is None:  # of a quaternion
                found[row, column] = True
                continue
            M = self.load.loaded.mass_matrix(s.q[row])
            change = np.abs(M[:, joint]) * gain * abs(float(s.stray[row, column, 1]))
            within = np.abs(torques[row]) + change <= np.where(np.isfinite(self.limits.effort), self.limits.effort, 0.0)
            found[row, column] = not (within | (change <= ZERO * np.abs(torques[row]).max())).all()
        return found

    def _look_at_peaks(self, s: States, torques: Array) -> None:
        fresh = self.peak.add(s.time, np.abs(torques))
        if not fresh:
            return
        joints, rows = (np.array(x) for x in zip(*fresh, strict=True))
        for name, values in self.load.terms(s.at(rows)).items():
            self.terms[name][joints] = values[np.arange(len(joints)), joints]
        self.signed["effort"][joints] = torques[rows, joints]
        for joint, row in fresh:
            self.around[joint] = s.at(slice(max(0, row - self._reach), row + self._reach)).copy()

    def _look_at_limits(self, s: States) -> None:
        at, limits = self.coordinates.position_of, self.limits
        q = np.where(at >= 0, s.logged[:, np.maximum(at, 0)], 0.0)
        for kind, values, beyond in (
            ("lower", q, np.where(at >= 0, limits.lower, -np.inf) - q),
            ("upper", q, q - np.where(at >= 0, limits.upper, np.inf)),
            ("velocity", s.dq, np.abs(s.dq) - limits.velocity),
        ):
            for joint, row in self.passed[kind].add(s.time, beyond):
                self.signed[kind][joint] = values[row, joint]

    def excesses(self) -> tuple[Excess, ...]:
        """The limits that were passed, worst effort first."""
        c, limits = self.coordinates, self.limits
        found = []
        for kind, extreme in (("effort", self.peak), *self.passed.items()):
            bound = getattr(limits, kind)
            over = extreme.value - bound if kind == "effort" else extreme.value
            allowed = limits.tolerance if kind in ("lower", "upper") else margin(bound)
            for k in np.flatnonzero(over > allowed):
                angular = bool(c.angular_velocity[k])
                unit = unit_of({"effort": "tau", "velocity": "dq"}.get(kind, "q"), angular)
                value, limit, time = float(self.signed[kind][k]), float(bound[k]), float(extreme.time[k])
                found.append(Excess(c.velocity_names[k], kind, value, limit, time, unit, angular))
        for i, body in enumerate(self.followers):
            value, time, angular = float(self.borne_signed[i]), float(self.borne.time[i]), bool(body.joint.turning[0])
            if abs(value) > body.effort + margin(body.effort):
                unit = unit_of("tau", angular)
                found.append(Excess(body.joint.name, "effort", value, body.effort, time, unit, angular))
        return tuple(
            sorted(found, key=lambda e: (e.kind != "effort", e.kind, -abs(e.value / e.limit) if e.limit else 0.0))
        )

    def estimate(self, joint: int) -> PeakEstimate:
        """The joint's peak less the noise of the log; of a tally that is ``estimating``."""
        assert self.search is not None
        steady = sum(self.terms[name][joint] for name in STEADY)
        return self.search.estimate(joint, float(steady))

    def measured(self) -> tuple[MeasuredTorque, ...]:
        """The torques that the log has itself, beside those computed: of the robot as it agrees better, loaded or not."""
        best = min(self._measured, key=lambda tally: tally.misfit)
        return best.result(self.coordinates.velocity_names, self.coordinates.torque_units)
