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
from .ground_support import ground_support
from .mounting import BoltsGiven, FrameOrTrue, motion_mounting
from .noise import support_noise
from .standing import StandingCase
from .standing_log import robot_of_log, standing_case, with_base_held

if TYPE_CHECKING:
    from ...core.typing import Array
    from ...mechanics.model.limits import Limits
    from ..torque_report import TorqueReport


@dataclass(frozen=True, kw_only=True)
class SupportQuestion:
    """Options of a user about what holds the robot and its payload."""

    feet: FeetGiven | None = None
    """Feet on the ground."""
    wheels: FramesGiven | None = None
    """Frames at the centres of wheels."""
    casters: FramesGiven | None = None
    """Frames at the centres of casters, which have no friction."""
    contact_friction: FrictionGiven | None = None
    """Coefficient of friction of the ground, or of each frame."""
    contact_normal: ArrayLike | None = None
    """Normal (3,) of the ground in the base frame."""
    in_contact: InContactGiven = "auto"
    """Source of the contacts that carry at each instant."""
    mounting: FrameOrTrue | None = None
    """Frame of the foundation, or True for the root."""
    bolts: BoltsGiven | None = None
    """Bolts of the foundation."""
    grip: HolderGiven | None = None
    """Gripper that holds the payload."""
    cup: HolderGiven | None = None
    """Suction cups that hold the payload."""

    @property
    def ground(self) -> GroundGiven | None:
        """Feet and wheels on the ground; None without any."""
        return GroundGiven.of(
            self.feet, self.wheels, self.casters, self.contact_friction, self.in_contact, self.contact_normal
        )

    @property
    def has_foundation(self) -> bool:
        """True if the robot is mounted on a foundation."""
        is_mounted = self.mounting not in (None, False)
        return is_mounted or self.bolts is not None

    def robot_of(self, robot: Robot, motion: Any, named: str, reading: Mapping[str, Any]) -> Robot:
        """Robot for a motion: its base is held if the robot is mounted, or if the motion has only the joints.

        ``named`` is the file or name of the robot, and ``reading`` are the options for reading the motion's file.
        """
        ground = self.ground
        if ground is not None and self.has_foundation:
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
        if self.has_foundation:
            return Robot(replace(robot.model, mounted=True))
        if ground is not None and motion is None:
            return with_base_held(robot)
        if ground is None or not isinstance(motion, str | Path):
            return robot
        path = bundled_file(str(motion), named, ".csv", "motion")
        file = open_motion_file(path, reading["topic"], reading["episode"])
        return robot_of_log(robot, file, reading["columns"])

    def motion_of(self, robot: Robot, motion: Any, at: ConfigurationGiven, *, degrees: bool) -> Any:
        """Given motion, or a log of one instant at rest ``at`` a configuration if no motion is given.

        The default configuration is neutral, moved within the position limits.
        """
        if motion is not None:
            if at is None:
                return motion
            raise ValueRangeError(
                "{0} is of a robot at rest, and a motion is given too. Leave out one.", Argument("at")
            )
        if at is None and self.ground is None:
            beginning = "Missing MOTION:" if in_the_shell() else "no motion is given. Give"
            example: dict[str, int] = {}
            if robot.nv:
                example = {robot.model.velocity_names[-1]: 0}
            raise ValueRangeError(
                f"{beginning} a log or plan, or 'demo'. Or give a configuration at rest, {{0}}.",
                Argument("at", example),
            )
        q = configuration_of(robot, at, degrees=degrees)
        if at is not None:
            return _log_at_rest(robot, q)
        for body in robot.model.leaders:
            if body.joint.nv == 1:
                k = body.v_index
                q[body.q_index] = np.clip(q[body.q_index], robot.limits.lower[k], robot.limits.upper[k])
        log = _log_at_rest(robot, q)
        form = "JOINT=VALUE" if in_the_shell() else "{joint: position}"
        option = spell(Argument("at", Placeholder(form)))
        note = f"At rest with each joint at zero, or at the nearest limit. Another configuration: {option}."
        columns = replace(log.columns, notes=(*log.columns.notes, note))
        return replace(log, columns=columns)

    def case(self, robot: Robot, log: MotionLog, loads: Mapping[str, Any]) -> tuple[LoadCase, MotionLog]:
        """Load case of the robot, standing if it is on the ground, and its log; the log of a standing robot has its base."""
        load: LoadCase
        if self.ground is None:
            load = LoadCase(robot, **loads)
        else:
            load, log = standing_case(robot, log, self.ground, loads)
        self._holder(load)  # raises errors now, before the motion is read
        return load, log

    def _holder(self, load: LoadCase) -> Holder | None:
        """Holder of the payload; None without one."""
        if self.grip is not None:
            return Holder.from_given("grip", self.grip, load)
        if self.cup is not None:
            return Holder.from_given("cup", self.cup, load)
        return None

    def answers(self, report: TorqueReport) -> SupportAnswers:
        """Parts of the report on ground, mounting and grip."""
        load = report.load
        holder = self._holder(load)
        is_standing = isinstance(load, StandingCase)
        if holder is None and not self.has_foundation and not is_standing:
            return SupportAnswers()
        motion = report.motion
        support = None
        mounting = None
        grip = None
        if isinstance(load, StandingCase):
            support = ground_support(load, motion)
            support = replace(support, noise=support_noise(support, report.differentiation))
        if self.has_foundation:
            frame = self.mounting if isinstance(self.mounting, str) else None
            mounting = motion_mounting(load, motion, frame, self.bolts)
        if holder is not None:
            grip = grip_support(holder, load, motion, report.limits.effort)
        return SupportAnswers(support=support, mounting=mounting, grip=grip)


def _log_at_rest(robot: Robot, q: Array) -> MotionLog:
    """Log of one instant at rest."""
    zeros = np.zeros((1, robot.nv))
    motion = Motion(np.zeros(1), q[None], zeros, zeros, robot=robot, in_seconds=True)
    return MotionLog.from_motion(motion)


def with_limits(load: LoadCase, limits: Limits) -> LoadCase:
    """Load case in which the contact forces of a standing robot respect the torque limits, if they can."""
    if isinstance(load, StandingCase):
        return replace(load, effort=limits.effort)
    return load
