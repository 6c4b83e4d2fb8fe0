"""Questions about what holds a robot: ground, mounting and grip, from the options of a user to the parts of the report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.errors import ValueRangeError
from ...core.text import Argument
from ...motion.load_case import LoadCase
from ...motion.motion_file import open_motion_file
from ...robot import Robot
from ...robots.finding import bundled_file
from .answers import SupportAnswers
from .grip import Holder, HolderGiven, grip_support
from .ground import ContactGiven, FeetGiven, FramesGiven, FrictionGiven, GroundGiven
from .judgement import ground_support
from .mounting import BoltsGiven, FrameOrTrue, motion_mounting
from .standing import StandingCase
from .standing_log import robot_of_log, standing_case

if TYPE_CHECKING:
    from ...mechanics.model.limits import Limits
    from ...motion.motion_log import MotionLog
    from ..torque_report import TorqueReport


@dataclass(frozen=True, kw_only=True)
class SupportQuestion:
    """Options of a user about what holds the robot and its payload."""

    feet: FeetGiven | None = None
    wheels: FramesGiven | None = None
    casters: FramesGiven | None = None
    contact_friction: FrictionGiven | None = None
    in_contact: ContactGiven = "auto"
    mounting: FrameOrTrue | None = None
    bolts: BoltsGiven | None = None
    grip: HolderGiven | None = None
    cup: HolderGiven | None = None

    @property
    def ground(self) -> GroundGiven | None:
        """Feet and wheels on the ground; None without any."""
        return GroundGiven.of(self.feet, self.wheels, self.casters, self.contact_friction, self.in_contact)

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
        if self.mounted:
            return Robot(replace(robot.model, mounted=True))
        if ground is None or not isinstance(motion, str | Path):
            return robot
        path = bundled_file(str(motion), named, ".csv", "motion")
        return robot_of_log(robot, open_motion_file(path, reading["topic"], reading["episode"]), reading["columns"])

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
            support=ground_support(load, motion) if isinstance(load, StandingCase) else None,
            mounting=motion_mounting(load, motion, frame, self.bolts) if self.mounted else None,
            grip=None if holder is None else grip_support(holder, load, motion),
        )


def with_limits(load: LoadCase, limits: Limits) -> LoadCase:
    """Load case whose contact forces keep the torque limits where they can."""
    return replace(load, effort=limits.effort) if isinstance(load, StandingCase) else load
