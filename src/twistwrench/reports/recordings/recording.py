"""Recordings of motions for other viewers: ROS 2 messages in MCAP files, and rerun's .rrd files.

Both contain the robot's URDF text with its meshes, joint states in rad, m, N m and N, and stamps in nanoseconds. Stamps counted
from 1970 stay unchanged. A report adds torques, their causes, shares of limits, the limits and the verdict.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.errors import ValueRangeError
from ...core.numbers import seconds
from ...core.typing import Array
from ...core.verdict import Word
from ...mechanics.joints.units import unit_of
from ...mechanics.model.couplings import joint_effort
from ...motion.coordinates import Coordinates

if TYPE_CHECKING:
    from ...motion.motion import Motion
    from ...motion.motion_log import LogRows
    from ...robot import Robot
    from ..torque_report import TorqueReport

NANOSECONDS = 10**9
"""Number of nanoseconds in a second."""
_MAX_STAMP = 2**31
"""Time [s] from which there is no ROS time stamp."""
_CHUNK = 8192
"""Number of rows that are computed at once."""
_QUANTITIES = {"position": "q", "velocity": "dq", "effort": "tau"}
"""Fields of a JointState and the quantities stored in them."""


class JointStates(NamedTuple):
    """States of the joints: positions (n, nq), velocities and torques (n, nv); None if unknown."""

    q: Array | None = None
    dq: Array | None = None
    tau: Array | None = None


Portion = tuple[Array, Array, Mapping[str, JointStates]]
"""Times (n,), configurations (n, nq) to show, and joint states by their topic."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Content of a recording, in chunks of rows."""

    robot: Robot
    """Robot of the motion."""
    epoch: int
    """Time stamp of the motion's time 0 [ns]."""
    span: tuple[float, float]
    """First and last time [s]."""
    portions: Iterator[Portion]
    """Chunks of rows in the order of time, which can be iterated once."""
    limits: JointStates | None = None
    """Velocity and torque limits, (1, nv) each."""
    verdict: tuple[Word, str] | None = None
    """Word of the verdict of a report, and its text."""

    @classmethod
    def from_motion(cls, motion: Motion) -> Recording:
        """Recording of a motion: its joint states."""
        states = {"joint_states": JointStates(motion.q, motion.dq, motion.tau)}
        portions = iter([(motion.time, motion.q, states)])
        span = float(motion.time[0]), float(motion.time[-1])
        return cls(motion.robot, motion.epoch, span, portions)

    @classmethod
    def from_report(cls, report: TorqueReport) -> Recording:
        """Recording of a report: the log's joint states, and the results."""
        from ..spoken_verdict import verdict_text

        effort = joint_effort(report.load.robot.model, report.limits.effort)
        limits = JointStates(None, report.limits.velocity[None], effort[None])
        verdict = report.verdict.word, verdict_text(report)
        epoch = report.differentiation.trajectory.epoch
        return cls(report.load.robot, epoch, (report.begin, report.end), _results(report), limits, verdict)

    @cached_property
    def coordinates(self) -> Coordinates:
        """Names and units of the robot's coordinates."""
        return Coordinates.from_model(self.robot.model)

    @cached_property
    def joints(self) -> tuple[list[str], Array, Array]:
        """Joints with one coordinate: names, indices in q, and indices in dq."""
        names = list[str]()
        q_indices = list[int]()
        v_indices = list[int]()
        for body in self.robot.model.leaders:
            if body.joint.nq == 1:
                names.append(body.joint.name)
                q_indices.append(body.q_index)
                v_indices.append(body.v_index)
        return names, np.array(q_indices, int), np.array(v_indices, int)

    @cached_property
    def units(self) -> dict[str, list[str]]:
        """Units of the positions, velocities and efforts of the joints with one coordinate, by field of a JointState."""
        _, _, v_indices = self.joints
        joints_turn = self.coordinates.angular_velocity[v_indices].tolist()
        units = {}
        for name, quantity in _QUANTITIES.items():
            units[name] = [unit_of(quantity, turns) for turns in joints_turn]
        return units

    def values(self, states: JointStates) -> dict[str, Array]:
        """Known positions, velocities and efforts (n, joints) of the joints with one coordinate, by field of a JointState."""
        _, q_indices, v_indices = self.joints
        values = {}
        if states.q is not None:
            values["position"] = states.q[:, q_indices]
        if states.dq is not None:
            values["velocity"] = states.dq[:, v_indices]
        if states.tau is not None:
            values["effort"] = states.tau[:, v_indices]
        return values

    def stamps(self, time: Array) -> Array:
        """Stamps (n,) of times [ns]; raises ValueRangeError if they are negative or too large for ROS."""
        stamps = self.epoch + np.rint(time * NANOSECONDS).astype(np.int64)
        first_stamp = stamps[0]
        last_stamp = stamps[-1]
        if first_stamp < 0 or last_stamp >= _MAX_STAMP * NANOSECONDS:
            raise ValueRangeError(
                f"stamps of recordings are from 0 to {_MAX_STAMP} s, and the motion is from "
                f"{seconds(first_stamp / NANOSECONDS)} to {seconds(last_stamp / NANOSECONDS)} s. Shift its times, for example "
                "to begin at 0."
            )
        return stamps


def _results(report: TorqueReport) -> Iterator[Portion]:
    """Chunks of a report: log, computed torques, their causes, and shares of limits."""
    load = report.load
    model = load.with_load.model
    # causes of the terms that are zero without them
    causes = {"spring": model.springs, "payload": load.payloads, "wrench": load.wrenches, "friction": load.friction}
    for surrounded_states, log_rows, inner_rows in report.differentiation.surrounded_states(_CHUNK):
        states = surrounded_states[inner_rows]
        torques = load.torques(states)
        states_by_topic = {
            "joint_states": _logged_states(log_rows, inner_rows),
            "torque": JointStates(states.q, states.dq, torques),
        }
        for name, values in load.terms(states).items():
            if name not in causes or causes[name]:
                states_by_topic[f"torque/{name}"] = JointStates(tau=values)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.abs(load.drive_torques(torques)) / report.limits.effort
        for joints, motor_per_joint, _ in model.coupled:  # each coupled joint has the largest share of its motors
            is_motor_of_joint = motor_per_joint != 0
            shares_of_motors = share[:, joints, None] * is_motor_of_joint  # (n, motors, joints)
            share[:, joints] = np.max(shares_of_motors, axis=1)
        states_by_topic["share"] = JointStates(tau=share)
        yield states.time, states.q, states_by_topic


def _logged_states(log_rows: LogRows, inner: slice) -> JointStates:
    """States of the rows ``inner`` of a log; velocities and torques are None if the log has none."""
    dq = log_rows.dq
    if dq is not None:
        dq = dq[inner]
    tau = log_rows.tau
    if tau is not None:
        tau = tau[inner]
    return JointStates(log_rows.q[inner], dq, tau)
