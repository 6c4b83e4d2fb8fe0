"""Function of the command ``payload``: the largest payload that a robot holds at a pose, and the verdict on it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, TypeAlias

import numpy as np

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt
from ..core.errors import FrameError, UnknownNameError, ValueRangeError
from ..core.numbers import rounded_down, without_noise
from ..core.tables import csv_table
from ..core.text import Argument, argument, listed, spell
from ..core.typing import Array, Frame, Vector
from ..core.verdict import Verdict, Word
from ..mechanics.model.limits import Limits
from ..motion import limits_file
from ..motion.coordinates import ConfigurationGiven, configuration_of
from ..motion.credible_values import credible_limits, credible_load
from ..motion.limits_file import robot_origin
from ..motion.load_case import LoadCase, LoadsGiven, Payload, drives_without_limit, limit_doubts, payloads_of, reach
from ..motion.model_doubts import assumed_words, assumptions, base_doubts, model_warnings
from ..robot import Robot, load
from .equilibrium import BeyondStop, joints_beyond_stops
from .payload import LargestPayload, PayloadMap, largest_payload, payload_map, plane_and_samples, points
from .torque_limits import require_fixed_base

if TYPE_CHECKING:
    from ..core.answers.page import Setting

SAMPLES = 200_000
"""Number of random configurations of a map."""
Plane: TypeAlias = Literal["rz", "xz", "yz", "xy"]
"""Planes of a map: of two axes of the base frame, or of height z and distance r from the z-axis."""


@dataclass(frozen=True, eq=False, repr=False)
class PayloadReport(Answer):
    """Largest payload at a pose, held at rest, and what limits it: result of :func:`twistwrench.payload`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> answer = tw.payload(tw.robots.ur5(), {"shoulder_lift_joint": -0.6})
    >>> answer
    <PayloadReport of ur5: OK, 14.15 kg>
    >>> float(answer.largest.mass.round(3)), dict(answer.facts()), answer.sources()["ROBOT"].endswith("ur5.urdf")
    (14.153, {'largest payload': '14.15 kg', 'limited by': 'shoulder_lift_joint'}, True)
    >>> len(list(answer.blocks()))
    8
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     answer.to_csv(f"{folder}/payload.csv").read_text().partition(",")[0]
    'joint'
    """

    call: ClassVar[str] = "payload"

    largest: LargestPayload
    """Largest mass, the joint that limits it, and holding torques."""
    load: LoadCase
    """Robot with its tools."""
    q: Array
    """(nq,) configuration."""
    frame: str
    """Frame of the payload."""
    com: Array
    """(3,) centre of mass of the payload in the frame [m]."""
    limits: Limits
    """Limits of the comparison."""
    map: PayloadMap | None
    """Largest payload over a slice of the workspace; None without ``map``, or if torque limits are missing."""
    is_default_pose: bool
    """True if no pose was given."""
    names_frame: bool
    """True if the frame was given."""
    degrees: bool
    """True if angles of the report are in degrees."""

    @property
    def robot(self) -> Robot:
        """Robot with its tools."""
        return self.load.with_load

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def subject(self) -> str:
        """Robot and place of the payload."""
        from .payload_view import place_words

        return f"{self.robot.name} · payload at {place_words(self.frame, self.com)}"

    @property
    def brief(self) -> str:
        """Largest payload, if the answer is OK."""
        if self.limiting is None or not self.verdict.ok:
            return ""
        return f"{rounded_down(self.largest.mass)} kg"

    # ── The verdict

    @cached_property
    def beyond(self) -> tuple[BeyondStop, ...]:
        """Joints beyond their position limits, the farthest first."""
        return tuple(joints_beyond_stops(self.robot, self.q, self.limits))

    @property
    def loads(self) -> Array:
        """(nv,) torques [N m or N] by which a joint counts as loaded: without the payload and with one kilogram."""
        return (np.abs(self.largest.unloaded) + np.abs(self.largest.per_kilogram))[: self.robot.nv]

    @cached_property
    def judged(self) -> bool:
        """True if every joint that is loaded has a torque limit, so that the payload can be compared with limits."""
        return not drives_without_limit(self.robot.model, self.limits.effort, self.loads)

    @property
    def limiting(self) -> str | None:
        """Joint that limits the payload; None if none does, or limits are missing."""
        k = int(self.largest.joint)  # -1 if no joint limits the payload
        if self.judged and k >= 0 and self.largest.holds:
            return self.largest.joint_names[k]
        return None

    @cached_property
    def contradictions(self) -> tuple[str, ...]:
        """Sentences on limits and loads that contradict themselves."""
        return tuple(str(doubt) for doubt in self._input_doubts if doubt.refuses)

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to be unsure, sentences without a full stop."""
        model, largest = self.robot.model, self.largest
        doubts = [str(doubt) for doubt in self._input_doubts if not doubt.refuses]
        doubts += base_doubts(model, "hangs, payload")
        doubts += limit_doubts(self.load.robot, self.limits, self.loads)
        no_joint_limits = largest.joint < 0
        if no_joint_limits and largest.holds and self.is_default_pose:
            doubts.append(
                "at the default pose the load stands on the axes of the joints, so no torque depends on it: give "
                f"{spell(Argument('at'))}"
            )
        warnings = model_warnings(model)
        if warnings:
            doubts.append(f"{'; '.join(warnings)}: the payload may be less")
        return tuple(doubts)

    @property
    def _input_doubts(self) -> list[Doubt]:
        """Doubts about limits, tools and the place of the payload.

        If the robot cannot hold its tools, doubts about their size are left out unless they refuse the answer.
        """
        frame = self.frame if self.names_frame else None
        robot_reach = reach(self.robot.model)
        payload_doubts = credible_load(None, self.com, frame, self.robot, robot_reach)
        tool_doubts = [doubt for doubt in self.load.doubts if doubt.refuses or self.largest.holds]
        return [*credible_limits(self.limits, self.load.robot), *tool_doubts, *payload_doubts]

    @property
    def assumed(self) -> str:
        """Text with the assumptions of the verdict; empty if there are none."""
        payload = Payload(1.0, frame=self.frame if self.names_frame else None)  # any mass: only the frame is assumed
        return assumed_words(assumptions(self.robot.model, (payload, *self.load.payloads)))

    @cached_property
    def verdict(self) -> Verdict:
        """LOOK AGAIN, OVER LIMIT for a pose that the robot cannot take or hold, UNSURE, or OK."""
        from .payload_view import findings

        results = findings(self)  # pairs (word, sentences), the gravest first
        word, _ = results[0]
        if word is Word.OK:
            return Verdict(word)
        reasons: list[str] = []
        for other_word, sentences in results:
            if other_word is word:
                reasons += sentences
        return Verdict(word, tuple(reasons))

    # ── The answer on every surface

    def blocks(self) -> Iterator[Block]:
        """Verdict, holding torques of each joint, largest forces and remarks."""
        from .payload_view import payload_view

        return payload_view(self)

    def facts(self) -> Mapping[str, str]:
        """Largest payload and the joint that limits it.

        Returns
        -------
        facts : {name: text}
        """
        if self.limiting is None:
            return {}
        return {"largest payload": f"{rounded_down(self.largest.mass)} kg", "limited by": self.limiting}

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}
        """
        return {"ROBOT": self.robot.model.source}

    def origin(self) -> Iterator[Setting]:
        """Robot, and the limits used.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        return robot_origin(self.robot, self.limits, degrees=self.degrees)

    def to_csv(self, path: str | Path) -> Path:
        """Write a row for each joint: name, position, torques, limit; with limits also the largest mass and the share.

        Numbers have all digits; rounding errors of zero are written as zero, unknown numbers as empty cells.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        from .payload_view import joint_positions

        largest = self.largest
        columns = {
            "q_degrees" if self.degrees else "q": joint_positions(self),
            "alone": without_noise(largest.unloaded),
            "per_kilogram": without_noise(largest.per_kilogram),
        }
        if self.judged:
            columns["with_payload"] = without_noise(largest.torques)
        columns["limit"] = largest.limits
        if self.judged:
            columns |= {"holds_up_to": largest.per_joint, "share": without_noise(largest.share)}
        with csv_table(path, ["joint", *columns]) as table:
            for k, name in enumerate(largest.joint_names):
                values = [column[k] for column in columns.values()]
                table.row([name, *(None if math.isnan(value) else value for value in values)])
        return Path(path)


def payload(
    robot: Robot | str | Path,
    at: ConfigurationGiven = None,
    *,
    tool: LoadsGiven = (),
    frame: Frame | None = None,
    com: Vector = (0, 0, 0),
    limits: limits_file.Given = None,
    map: Plane | None = None,  # noqa: A002  the option's name
    samples: int | None = None,
    degrees: bool = False,
) -> PayloadReport:
    """Find the largest payload held at rest at a pose, the joint that limits it, and the forces at the tip.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    at : (nq,) array, {joint: position}, name of a configuration, or texts of these, optional [rad, m]
        Configuration: all coordinates, a configuration of the file by its name, or the position of a joint, the others at
        zero.
    tool : float [kg], "kg,x,y,z@frame", SpatialInertia in the axes of its frame, {frame: one of these}, or a list
        Load attached already, in the form of ``payload`` of :func:`check`.
    frame : str, optional
        Frame of the payload; default: the tip.
    com : (3,) array_like
        Centre of mass of the payload in this frame [m].
    limits : path of a limits file, Limits, {joint: effort} [N m or N], or {kind: (nv,) array}, optional
        Limits of the joints, in place of the robot file's; the table of :func:`info` is a template.
    map : "rz", "xz", "yz" or "xy", optional
        Map the largest payload over this plane of the workspace.
    samples : int, optional
        Number of random configurations of the map; default: 200,000.
    degrees : bool, angles of ``at``, of a limits file and of the answer are in degrees

    Returns
    -------
    report : PayloadReport
        ``report.verdict``, ``report.largest``, ``report.plot()``.

    Raises
    ------
    FrameError
        The robot has no single tip, and no frame is given.
    NotFoundError, ShapeError, UnknownNameError, ValueRangeError
        The robot, the pose, the loads or the limits cannot be read, or the base floats.

    Examples
    --------
    >>> import twistwrench as tw
    >>> print(tw.payload("ur5", {"shoulder_lift_joint": -0.6}).headline)
    OK: largest payload at rest in this pose: 14.15 kg at tool0. Limited by shoulder_lift_joint, lower limit: -150.0 N m, of which -48.93 carry the robot itself.
    """  # noqa: E501  the verdict in full
    if samples is not None and map is None:
        raise ValueRangeError(
            f"{argument('samples')} is about the map, and there is none. Add {argument('map', 'rz')}."
        )
    plane, sample_count = None, 0
    if map is not None:
        plane, sample_count = plane_and_samples(map, SAMPLES if samples is None else samples)
    if not isinstance(robot, Robot):
        robot = load(robot)
    load_case = LoadCase(robot, payloads_of(tool))
    robot = load_case.with_load
    centre = arguments.one(points(com), "com", 3)
    frame_name = _frame_name(robot, frame)
    q = configuration_of(robot, at, degrees=degrees)
    used_limits = limits_file.limits_of(limits, robot.model, degrees=degrees)
    largest = largest_payload(robot, q, centre, frame=frame, limits=used_limits.effort)
    report = PayloadReport(
        largest, load_case, q, frame_name, centre, used_limits, None, is_default_pose=at is None,
        names_frame=frame is not None, degrees=degrees,
    )  # fmt: skip
    if plane is None or not report.judged:
        return report
    chart = payload_map(robot, plane, samples=sample_count, com=centre, frame=frame, limits=used_limits.effort)
    return replace(report, map=chart)


def _frame_name(robot: Robot, frame: str | None) -> str:
    """Name of the given frame, or of the tip if None is given.

    Raises UnknownNameError for an unknown frame, and FrameError if a robot has no single tip, or ValueRangeError if
    its base floats, too.
    """
    if frame is None and robot.tip is None:
        require_fixed_base(robot, "the largest payload")  # with a floating base, naming a frame does not help
        tips = robot.model.possible_tips
        raise FrameError(
            f"robot {robot.name!r} has no single tip, so the frame of the payload must be named: {argument('frame', tips[0])}. "
            f"It may be one of {listed(tips, 12)}."
        )
    try:
        robot.model.frame(frame)
    except UnknownNameError as error:
        raise UnknownNameError(f"{argument('frame')}: {error}") from None
    return str(robot.tip if frame is None else frame)
