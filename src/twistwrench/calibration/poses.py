"""Configurations to measure: chosen one by one from random ones, so that the readings determine most (D-optimal design)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.errors import ValueRangeError
from ..core.glossary import complete
from ..core.tables import csv_table
from ..core.text import Argument, Placeholder
from ..core.typing import Array
from ..core.verdict import Verdict
from ..motion.coordinates import Coordinates
from ..robot import Robot, load
from ..shapes.capsules import CapsuleDistances, LinkCapsules
from .chain import Corrections, TipChain
from .fit import CalibrationFit, CalibrationProblem, Estimate
from .groups import ParameterGroups, Remaining
from .measurements import Measurements, length_and_angle, read_measurements
from .targets import CentreTarget, FrameTarget, MeasuredTarget, PairTarget

PlannedKind = Literal["pose", "position", "distance", "pair"]
"""Kinds of readings that need no contact."""
NOISE = (1e-4, 5e-4)
"""Assumed standard deviations of a reading [m, rad]."""
CANDIDATES, REFERENCE = 2_000, 500
"""Numbers of random configurations: to choose from, and of the predicted error."""
OFF_AXIS = 0.05
"""Distance of the target from the last axis [m], if the tip's frame lies on it: there it would not see the last zero."""
_ON_AXIS = 0.01
FACING = np.cos(np.radians(60.0))
"""Cosine of the largest angle between the tip's z axis and the direction to a tracker."""
SHARE = 0.1
"""Largest share of the file's error that may remain for OK."""
_MAX_READINGS = 1_000
_MILESTONES = (6, 8, 10, 12, 16, 20, 25, 30, 40, 60, 100, 200, 400)
"""Numbers of readings whose predicted error is listed."""


@dataclass(frozen=True, eq=False, repr=False)
class MeasuringPoses(Answer):
    """Configurations to measure, and what their readings would determine: result of :func:`measuring_poses`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> plan = tw.calibration.measuring_poses("ur5", 20)
    >>> plan.q.shape, plan.rank, plan.theory, plan.counts
    ((20, 6), 27, 27, (6, 8, 10, 12, 16, 20))
    >>> plan.remaining[-1] < 0.15e-3 < 4e-3 < plan.by_file, plan.facts()["rank"]
    (True, '27 of 27')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     print(plan.to_csv(f"{folder}/poses.csv").read_text().splitlines()[0][:38])
    shoulder_pan_joint,shoulder_lift_joint
    """

    call: ClassVar[str] = "calibrate"

    robot: Robot
    """Robot as its file has it."""
    q: Array
    """(n, nq) configurations in the order of small moves; two for each reading of kind pair."""
    fit: CalibrationFit
    """Expected readings in the order of choice, linearised at the start."""
    counts: tuple[int, ...]
    """Numbers of readings of :attr:`remaining`."""
    remaining: Array
    """(len(counts),) predicted error [m] (rms) after so many readings."""
    by_file: float
    """Predicted error [m] (rms) with the file as it is."""
    noise: tuple[float, float]
    """Assumed standard deviations of a reading [m, rad]."""
    moved_off_axis: bool
    """True if the target was assumed 50 mm off the last axis."""
    capsules: CapsuleDistances | None
    """Distances that were kept; None if they were not looked at."""

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def kind(self) -> str:
        """Kind of the readings."""
        return str(self.fit.problem.measured[-1].kind)

    @property
    def count(self) -> int:
        """Number of readings that are planned."""
        return self.fit.problem.measured[-1].count

    @property
    def subject(self) -> str:
        """Robot and number of readings."""
        return f"{self.robot_name} · {self.count} readings of kind {self.kind}"

    @cached_property
    def _groups(self) -> ParameterGroups:
        return ParameterGroups(self.fit)

    @property
    def rank(self) -> int:
        """Number of groups of parameters that the readings determine, including the target's unknowns."""
        return self._groups.rank

    @property
    def theory(self) -> int:
        """Number of groups that many different readings of this kind determine."""
        return self._groups.theory

    @cached_property
    def verdict(self) -> Verdict:
        """OK if the readings determine all groups and leave a tenth of the file's error, and clearances are known."""
        from .poses_view import doubts_of_plan

        return Verdict.from_reasons(unsure=doubts_of_plan(self))

    def blocks(self) -> Iterator[Block]:
        """Verdict, and the predicted error by the number of readings."""
        from .poses_view import plan_view

        return plan_view(self)

    def facts(self) -> Mapping[str, str]:
        """Predicted errors, and rank.

        Returns
        -------
        facts : {name: text}
        """
        from .result_view import millimetres

        return {
            "predicted to remain": millimetres(float(self.remaining[-1])),
            "before, by the file": millimetres(self.by_file),
            "rank": f"{self.rank} of {self.theory}",
        }

    def sources(self) -> Mapping[str, str | Path]:
        """File of the robot.

        Returns
        -------
        files : {argument: path}
        """
        return {"ROBOT": self.robot.model.source}

    def to_csv(self, path: str | Path, *, degrees: bool = False) -> Path:
        """Write a row for each configuration; add columns with the readings, and give the file to ``calibrate``.

        Parameters
        ----------
        degrees : bool, angles in degrees, noted in the header

        Returns
        -------
        path : Path of the file

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        coordinates = Coordinates.from_model(self.robot.model)
        names, factors = coordinates.headers(degrees=degrees), np.ones(len(coordinates.names))
        if degrees:
            factors[coordinates.angular] = np.degrees(1.0)
        in_pairs = self.kind == "pair"
        with csv_table(path, [*names, "pair"] if in_pairs else names) as table:
            for row, q in enumerate(self.q * factors):
                partner = row ^ 1  # 0 and 1, 2 and 3, ...
                table.row([*q, partner] if in_pairs else q)
        return Path(path)


def measuring_poses(
    robot: Robot | str | Path,
    count: int,
    *,
    kind: PlannedKind = "position",
    tip: str | None = None,
    after: str | Path | Measurements | None = None,
    degrees: bool = False,
    assume: str | tuple[str, ...] = (),
    towards: ArrayLike | None = None,
    clear: bool = True,
    floor: float | None = None,
    noise: float | tuple[float, float] | None = None,
    file_accuracy: tuple[float, float] = (1e-3, 2e-3),
    seed: int = 0,
) -> MeasuringPoses:
    """Choose configurations whose readings determine the geometry best, within limits and clear of the robot itself.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    count : int, number of readings
    kind : "position", "pose", "distance" or "pair", of the readings; touches depend on where the thing stands
    tip : str, optional, frame nearest to the target; default: the tip
    after : path or Measurements, optional, readings that exist already
    degrees : bool, joint positions and angles of ``after`` without a unit are in degrees
    assume : "sag", "gears" or both, also determine joints that sag under gravity, or errors of gears
    towards : (3,) array_like, optional, place of the tracker, to which the tip's z axis points within 60°; for distances, of
        their fixed end; in the base frame [m]
    clear : bool, keep links 20 mm apart
    floor : float, optional, lowest height of the moving links in the base frame [m]
    noise : float [m], or (float [m], float [rad]), standard deviation of a reading; default: 0.1 mm and 0.5 mrad
    file_accuracy : (float [m], float [rad]), standard deviations of lengths and axes in the robot's file
    seed : int, of the random configurations

    Returns
    -------
    plan : MeasuringPoses
        ``plan.q``, ``plan.remaining``, ``plan.to_csv(path)``.

    Raises
    ------
    ModelError
        The robot has no single tip, or a joint on the way cannot be calibrated.
    NotFoundError, ShapeError, TrajectoryError, UnknownNameError, ValueRangeError
        The existing readings cannot be read, an option is not valid, or too few configurations are clear.

    Notes
    -----
    Each further reading, with rows A over its deviations, is the one of 2,000 random configurations that adds most to
    log det M: det(M + A'A) = det M · det(1 + A M⁻¹ A'), with the file as prior. Source: Fedorov, "Theory of Optimal
    Experiments", 1972.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.calibration.measuring_poses("ur5", 25, kind="pose", floor=0.0).rank
    30
    """
    most = arguments.integer(count, "count")
    if not 3 <= most <= _MAX_READINGS:
        raise ValueRangeError(f"count is {most}. Plan 3 to {_MAX_READINGS:,} readings, better 30.")
    arguments.choice(kind, "kind", ("pose", "position", "distance", "pair"))
    length, angle = length_and_angle(NOISE if noise is None else noise, "noise")
    accuracy = length_and_angle(file_accuracy, "file_accuracy")
    arm = robot if isinstance(robot, Robot) else load(robot)
    chain = TipChain.from_robot(arm, tip, [assume] if isinstance(assume, str) else assume)
    goal = None
    if towards is not None:
        goal = arguments.finite(arguments.one(towards, "towards", 3), "towards")
    if kind == "distance" and goal is None:
        raise ValueRangeError(
            "distances need their fixed end: give its place in the base frame [m], {0}.",
            Argument("towards", Placeholder("X,Y,Z")),
        )
    existing = None
    if after is not None:
        known = read_measurements(after, arm, None, tip, degrees=degrees)
        existing = CalibrationProblem(chain, (known,)).solve()
    at, off_axis = _start(chain, existing)
    capsules = _capsules(arm, clear=clear, floor=floor)
    q = _clear_configurations(chain, at, capsules, goal if kind != "distance" else None, seed)
    design = _Design(chain, at, existing, (length, angle), accuracy)
    candidates = _expected_readings(chain, at, q, kind, goal)
    if candidates.count < most:
        raise ValueRangeError(
            f"only {candidates.count} of {CANDIDATES:,} random configurations are clear"
            f"{'' if goal is None else ' and point there'}. Ask for fewer, or lower the floor."
        )
    chosen = design.choose(candidates, most, goal)
    reference = arm.random_configuration(seed + 1, REFERENCE)
    counts = (*(n for n in _MILESTONES if n < most), most)

    def remaining(n: int) -> float:
        return Remaining(design.fit(candidates.taken(chosen[:n]), goal), reference, design.accuracy).rms

    fit = design.fit(candidates.taken(chosen), goal)
    return MeasuringPoses(
        arm, _nearest_next(fit.problem.measured[-1]), fit, counts, np.array([remaining(n) for n in counts]),
        Remaining(fit, reference, design.accuracy).by_file, (length, angle), off_axis, capsules,
    )  # fmt: skip


def _start(chain: TipChain, existing: CalibrationFit | None) -> tuple[Corrections, bool]:
    """Corrections of existing readings, or none with a target off the last axis; True if it was moved there."""
    if existing is not None:
        return existing.state.corrections, False
    start = chain.start
    screw = chain.screws[-1]
    if not chain.turning[-1]:
        return start, False
    axis = screw[:3]
    point = np.cross(axis, screw[3:])  # of the axis, nearest to the joint's frame
    away = start.tip[:3, 3] - point
    if np.linalg.norm(away - axis * (axis @ away)) > _ON_AXIS:
        return start, False
    across = np.linalg.svd(axis[None])[2][1]  # a unit vector across the axis
    shift = np.eye(4)
    shift[:3, 3] = OFF_AXIS * (start.tip[:3, :3].T @ across)
    return replace(start, tip=start.tip @ shift), True


def _capsules(robot: Robot, *, clear: bool, floor: float | None) -> CapsuleDistances | None:
    """Distances to be kept; None for none."""
    if not arguments.flag(clear, "clear") and floor is None:
        return None
    height = None
    if floor is not None:
        height = float(arguments.finite(floor, "floor"))
    return CapsuleDistances.from_capsules(robot, LinkCapsules.from_robot(robot), floor=height, itself=clear)


def _clear_configurations(
    chain: TipChain, at: Corrections, capsules: CapsuleDistances | None, goal: Array | None, seed: int
) -> Array:
    """Random configurations (n, nq) that are clear and point to the goal."""
    robot = chain.robot
    q = robot.random_configuration(seed, CANDIDATES)
    fixed = np.ones(robot.nq, bool)
    fixed[chain.columns] = False
    q[:, fixed] = robot.neutral[fixed]
    kept = np.ones(len(q), bool)
    if capsules is not None:
        distances = capsules.evaluate(q)[0]
        least = np.zeros(distances.shape[1])
        least[: len(capsules.margins)] = capsules.margins
        kept &= (distances >= least).all(axis=1)
    if goal is not None:
        T = chain.tips(q, at)
        direction = goal - T[:, :3, 3]
        kept &= (direction * T[:, :3, 2]).sum(axis=1) >= FACING * np.linalg.norm(direction, axis=1)
    return np.asarray(q[kept])


def _expected_readings(chain: TipChain, at: Corrections, q: Array, kind: str, goal: Array | None) -> Measurements:
    """Readings of a kind that the corrected chain would give, in the base frame."""
    T = chain.tips(q, at)
    p = T[:, :3, 3]
    if kind == "pose":
        return Measurements(q, poses=T)
    if kind == "position":
        return Measurements(q, positions=p)
    if kind == "distance":
        return Measurements(q, distances=np.maximum(np.linalg.norm(p - goal, axis=1), 1e-6))
    rows = np.arange(len(q) // 2 * 2).reshape(-1, 2)
    apart = np.linalg.norm(p[rows[:, 0]] - p[rows[:, 1]], axis=1)
    return Measurements(q, pairs=rows[apart > OFF_AXIS], distances=apart[apart > OFF_AXIS], kind="pair")


def _target(planned: Measurements, goal: Array | None) -> MeasuredTarget:
    """Target of expected readings: the base frame, the fixed end of distances, or none."""
    if planned.kind == "distance":
        return CentreTarget(planned, np.asarray(goal))
    if planned.kind == "pair":
        return PairTarget(planned)
    return FrameTarget(planned, np.eye(4))


@dataclass(frozen=True, eq=False)
class _Design:
    """Information of existing and of expected readings."""

    chain: TipChain
    at: Corrections
    existing: CalibrationFit | None
    noise: tuple[float, float]
    accuracy: tuple[float, float]

    def fit(self, planned: Measurements, goal: Array | None) -> CalibrationFit:
        """Existing and planned readings, linearised at the start, with weights 1/σ."""
        planned_weights = np.full((planned.count, planned.rows_each), 1.0 / self.noise[0])
        planned_weights[:, : planned.angle_rows] = 1.0 / self.noise[1]
        measured, targets, weights = [planned], [_target(planned, goal)], [planned_weights]
        if self.existing is not None:
            measured = [*self.existing.problem.measured, *measured]
            targets = [*self.existing.state.targets, *targets]
            weights = [*self.existing.weights, *weights]
        problem, state = CalibrationProblem(self.chain, tuple(measured)), Estimate(self.at, tuple(targets))
        return CalibrationFit(problem, state, problem.equations(state), tuple(weights))

    def choose(self, candidates: Measurements, count: int, goal: Array | None) -> Array:
        """Readings in the order of choice: each adds most to log det M."""
        fit = self.fit(candidates, goal)
        wide = Remaining(fit, candidates.q[:1], self.accuracy).wide
        A = fit.equations.design[-1] * fit.weights[-1][..., None] * wide
        M = np.eye(len(wide))
        for D, W in zip(fit.equations.design[:-1], fit.weights[:-1], strict=True):
            rows = (D * W[..., None]).reshape(-1, len(wide)) * wide
            M += rows.T @ rows
        C, found = np.linalg.inv(M), list[int]()
        unit = np.eye(A.shape[1])
        for _ in range(count):
            gain = np.linalg.slogdet(unit + A @ C @ np.swapaxes(A, 1, 2))[1]  # det(1 + A M⁻¹ A')
            gain[found] = -np.inf
            best = int(np.flatnonzero(gain > gain.max() - 1e-9)[0])  # a tie: the first, on every machine
            found.append(best)
            X = A[best] @ C
            C = C - X.T @ np.linalg.solve(unit + X @ A[best].T, X)  # M⁻¹ after M + A'A
        return np.array(found)


def _nearest_next(planned: Measurements) -> Array:
    """Configurations of the readings, each next one the nearest that is left; both of a pair stay together."""
    blocks = planned.q[:, None]
    if planned.pairs is not None:
        blocks = planned.q[planned.pairs]
    left, place, found = list(range(len(blocks))), blocks[0, 0], list[Array]()
    while left:
        nearest = min(left, key=lambda k: float(np.abs(blocks[k, 0] - place).max()))
        left.remove(nearest)
        found.append(blocks[nearest])
        place = blocks[nearest, -1]
    return np.concatenate(found)


complete(globals())
