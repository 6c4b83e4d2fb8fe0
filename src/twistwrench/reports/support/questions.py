"""Questions about what holds a robot: ground, mounting and grip, from the options of a user to the parts of the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import ValueRangeError
from ...core.text import Argument, Placeholder, in_the_shell, spell
from ...motion.coordinates import ConfigurationGiven, configuration_of
from ...motion.load_case import LoadCase
from ...motion.motion import Motion
from ...motion.motion_file import open_motion_file
from ...motion.motion_log import MotionLog
from ...robot import Robot
from ...robots.finding import bundled_file
from ...statics.contacts import refuse_loops
from .answers import SupportAnswers
from .grip import Holder, HolderGiven, grip_support
from .ground import FeetGiven, FramesGiven, FrictionGiven, GroundGiven, InContactGiven
from .ground_support import GroundSupport, ground_support
from .mounting import BoltsGiven, FrameOrTrue, motion_mounting
from .noise import support_noise
from .standing import StandingCase
from .standing_log import robot_of_log, standing_case, with_base_held

if TYPE_CHECKING:
    from ...mechanics.model.limits import Limits
    from ...motion.differentiation import Differentiation
    from ..torque_report import TorqueReport


@dataclass(frozen=True, kw_only=True)
class SupportQuestion:
    """Options of a user about what holds the robot and its payload."""

    feet: FeetGiven | None = None
    wheels: FramesGiven | None = None
    casters: FramesGiven | None = None
    contact_friction: FrictionGiven | None = None
    contact_normal: ArrayLike | None = None
    in_contact: InContactGiven = "auto"
    mounting: FrameOrTrue | None = None
    bolts: BoltsGiven | None = None
    grip: HolderGiven | None = None
    cup: HolderGiven | None = None

    @property
    def ground(self) -> GroundGiven | None:
        """Feet and wheels on the ground; None without any."""
        return GroundGiven.of(
            self.feet, self.wheels, self.casters, self.contact_friction, self.in_contact, self.contact_normal
        )

    @property
    def mounted(self) -> bool:
        """True if the robot is mounted on a foundation."""
        return self.mounting not in (None, False) or self.bolts is not None

    def robot_of(self, robot: Robot, motion: Any, named: str, reading: Mapping[str, Any]) -> Robot:
        """Robot as its motion has it: with its base held if that file has the joints alone, or if it is mounted."""
        ground = self.ground
        if ground is not None and self.mounted:
            raise ValueRangeError(
                "{0} and {1}: a robot that is mounted stands on no feet. Leave out one of them.",
                Argument("feet" if self.feet is not None else "wheels"),
                Argument("mounting" if self.mounting else "bolts"),
            )
        if self.grip is not None and self.cup is not None:
            raise ValueRangeError(
                "{0} and {1} hold the same payload. Leave out one.", Argument("grip"), Argument("cup")
            )
        if ground is not None:
            refuse_loops(robot, "check")
        if self.mounted:
            return Robot(replace(robot.model, mounted=True))
        if ground is not None and motion is None:
            return with_base_held(robot)
        if ground is None or not isinstance(motion, str | Path):
            return robot
        path = bundled_file(str(motion), named, ".csv", "motion")
        return robot_of_log(robot, open_motion_file(path, reading["topic"], reading["episode"]), reading["columns"])

    def motion_of(self, robot: Robot, motion: Any, at: ConfigurationGiven, *, degrees: bool) -> Any:
        """Motion as given; without one an instant at rest ``at`` a configuration, by default neutral within its limits."""
        if motion is not None and at is None:
            return motion
        if motion is not None:
            raise ValueRangeError(
                "{0} is of a robot at rest, and a motion is given too. Leave out one.", Argument("at")
            )
        if at is None and self.ground is None:
            said = "Missing MOTION:" if in_the_shell() else "no motion is given. Give"
            raise ValueRangeError(
                f"{said} a log or plan, or 'demo'. Or give a configuration at rest, {{0}}.",
                Argument("at", {robot.model.velocity_names[-1]: 0} if robot.nv else {}),
            )
        q = configuration_of(robot, at, degrees=degrees)
        if at is None:
            for body in robot.model.leaders:
                if body.joint.nv == 1:
                    k = body.v_index
                    q[body.q_index] = np.clip(q[body.q_index], robot.limits.lower[k], robot.limits.upper[k])
        still = np.zeros((1, robot.nv))
        log = MotionLog.from_motion(Motion(np.zeros(1), q[None], still, still, robot=robot, in_seconds=True))
        if at is not None:
            return log
        other = spell(Argument("at", Placeholder("JOINT=VALUE" if in_the_shell() else "{joint: position}")))
        pose = f"At rest with each joint at zero, or at the nearest limit. Another configuration: {other}."
        return replace(log, columns=replace(log.columns, notes=(*log.columns.notes, pose)))

    def case(self, robot: Robot, log: MotionLog, loads: Mapping[str, Any]) -> tuple[LoadCase, MotionLog]:
        """Load case with what holds the robot, and its log."""
        ground = self.ground
        found, log = (LoadCase(robot, **loads), log) if ground is None else standing_case(robot, log, ground, loads)
        self._holder(found)
        return found, log

    def _holder(self, load: LoadCase) -> Holder | None:
        if self.grip is not None:
            return Holder.from_given("grip", self.grip, load)
        return None if self.cup is None else Holder.from_given("cup", self.cup, load)

    def answers(self, report: TorqueReport) -> SupportAnswers:
        """Parts of the report."""
        load, holder = report.load, self._holder(report.load)
        if holder is None and not self.mounted and not isinstance(load, StandingCase):
            return SupportAnswers()
        motion, frame = report.motion, self.mounting if isinstance(self.mounting, str) else None
        return SupportAnswers(
            support=_ground(load, motion, report.differentiation) if isinstance(load, StandingCase) else None,
            mounting=motion_mounting(load, motion, frame, self.bolts) if self.mounted else None,
            grip=None if holder is None else grip_support(holder, load, motion, report.limits.effort),
        )


def _ground(load: StandingCase, motion: Motion, differentiation: Differentiation) -> GroundSupport:
    found = ground_support(load, motion)
    return replace(found, noise=support_noise(found, differentiation))


def with_limits(load: LoadCase, limits: Limits) -> LoadCase:
    """Load case whose contact forces keep the torque limits where they can."""
    return replace(load, effort=limits.effort) if isinstance(load, StandingCase) else load
