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
CANDIDATES = 2_000
"""Number of random configurations to choose from."""
REFERENCE = 500
"""Number of random configurations over which the predicted error is averaged."""
OFF_AXIS = 0.05
"""Assumed distance of the target from the last axis [m] if the tip's frame lies on this axis.

A target on the axis would not show the zero of the last joint.
"""
_MAX_DISTANCE_ON_AXIS = 0.01
"""Distance from the last axis [m] up to which the tip's frame lies on it."""
FACING = np.cos(np.radians(60.0))
"""Cosine of the largest angle between the tip's z axis and the direction to a tracker."""
SHARE = 0.1
"""Largest share of the file's error that may remain for OK."""
_MIN_DISTANCE = 1e-6
"""Smallest expected distance of a reading [m], so that its direction is defined."""
_MAX_GAIN_OF_TIE = 1e-9
"""Difference of log det M below which two readings are equally good."""
_MAX_READINGS = 1_000
"""Largest number of readings that can be planned."""
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
    """Numbers of readings for which :attr:`remaining` has the error."""
    remaining: Array
    """(len(counts),) predicted error [m] (rms) after so many readings."""
    by_file: float
    """Predicted error [m] (rms) with the file as it is."""
    noise: tuple[float, float]
    """Assumed standard deviations of a reading [m, rad]."""
    moved_off_axis: bool
    """True if the target was assumed 50 mm off the last axis."""
    capsules: CapsuleDistances | None
    """Distances that the configurations keep; None if distances were not checked."""

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def kind(self) -> str:
        """Kind of the readings."""
        planned_readings = self.fit.problem.measured[-1]  # existing readings come first
        return str(planned_readings.kind)

    @property
    def count(self) -> int:
        """Number of readings that are planned."""
        planned_readings = self.fit.problem.measured[-1]
        return planned_readings.count

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
        header = coordinates.headers(degrees=degrees)
        factors = np.ones(len(coordinates.names))
        if degrees:
            factors[coordinates.angular] = np.degrees(1.0)
        is_of_pairs = self.kind == "pair"
        if is_of_pairs:
            header = [*header, "pair"]
        with csv_table(path, header) as table:
            for row, q in enumerate(self.q * factors):
                partner = row ^ 1  # rows 0 and 1 are a pair, 2 and 3, ...
                cells = [*q]
                if is_of_pairs:
                    cells.append(partner)
                table.row(cells)
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
    M is the information of the file and of the readings so far. A further reading has rows A over their deviations. It is
    chosen among 2,000 random configurations, such that log det M grows most: det(M + A'A) = det M · det(1 + A M⁻¹ A').
    Source: Fedorov, "Theory of Optimal Experiments", 1972.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.calibration.measuring_poses("ur5", 25, kind="pose", floor=0.0).rank
    30
    """
    reading_count = arguments.integer(count, "count")
    if not 3 <= reading_count <= _MAX_READINGS:
        raise ValueRangeError(f"count is {reading_count}. Plan 3 to {_MAX_READINGS:,} readings, better 30.")
    arguments.choice(kind, "kind", ("pose", "position", "distance", "pair"))
    length, angle = length_and_angle(NOISE if noise is None else noise, "noise")
    accuracy = length_and_angle(file_accuracy, "file_accuracy")
    arm = robot if isinstance(robot, Robot) else load(robot)
    chain = TipChain.from_robot(arm, tip, [assume] if isinstance(assume, str) else assume)
    goal = None  # place of the tracker, or fixed end of distances
    if towards is not None:
        goal = arguments.finite(arguments.one(towards, "towards", 3), "towards")
    if kind == "distance" and goal is None:
        raise ValueRangeError(
            "distances need their fixed end: give its place in the base frame [m], {0}.",
            Argument("towards", Placeholder("X,Y,Z")),
        )
    existing_fit = None
    if after is not None:
        existing_readings = read_measurements(after, arm, None, tip, degrees=degrees)
        existing_fit = CalibrationProblem(chain, (existing_readings,)).solve()
    corrections, is_off_axis = _start(chain, existing_fit)
    capsules = _capsules(arm, clear=clear, floor=floor)
    tracker = goal if kind != "distance" else None  # the tip need not point to the fixed end of distances
    q = _clear_configurations(chain, corrections, capsules, tracker, seed)
    design = _Design(chain, corrections, existing_fit, (length, angle), accuracy)
    candidates = _expected_readings(chain, corrections, q, kind, goal)
    if candidates.count < reading_count:
        raise ValueRangeError(
            f"only {candidates.count} of {CANDIDATES:,} random configurations are clear"
            f"{'' if goal is None else ' and point there'}. Ask for fewer, or lower the floor."
        )
    chosen_indices = design.choose(candidates, reading_count, goal)
    reference = arm.random_configuration(seed + 1, REFERENCE)
    milestones = [n for n in _MILESTONES if n < reading_count]
    counts = (*milestones, reading_count)
    fits = []
    for n in counts:
        first_chosen = candidates.taken(chosen_indices[:n])
        fits.append(design.fit(first_chosen, goal))
    remaining = np.array([Remaining(fit, reference, design.accuracy).rms for fit in fits])
    fit = fits[-1]  # of all chosen readings
    ordered_q = _in_order_of_moves(fit.problem.measured[-1])
    by_file = Remaining(fit, reference, design.accuracy).by_file
    return MeasuringPoses(arm, ordered_q, fit, counts, remaining, by_file, (length, angle), is_off_axis, capsules)


def _start(chain: TipChain, existing: CalibrationFit | None) -> tuple[Corrections, bool]:
    """Corrections at which readings are linearised, and True if the target was moved off the last axis.

    The corrections are those of the fit of existing readings. Without readings they are zero, with the target off the axis.
    """
    if existing is not None:
        return existing.state.corrections, False
    start = chain.start
    screw = chain.screws[-1]  # of the last joint
    if not chain.turning[-1]:
        return start, False
    axis = screw[:3]
    point = np.cross(axis, screw[3:])  # point of the axis nearest to the joint's frame
    difference = start.tip[:3, 3] - point
    distance = np.linalg.norm(difference - axis * (axis @ difference))
    if distance > _MAX_DISTANCE_ON_AXIS:
        return start, False
    _, _, directions = np.linalg.svd(axis[None])  # the axis, and two unit vectors perpendicular to it
    normal = directions[1]
    shift = np.eye(4)
    shift[:3, 3] = OFF_AXIS * (start.tip[:3, :3].T @ normal)
    return replace(start, tip=start.tip @ shift), True


def _capsules(robot: Robot, *, clear: bool, floor: float | None) -> CapsuleDistances | None:
    """Distances that configurations must keep; None if there are none."""
    if not arguments.flag(clear, "clear") and floor is None:
        return None
    height = None
    if floor is not None:
        height = float(arguments.finite(floor, "floor"))
    return CapsuleDistances.from_capsules(robot, LinkCapsules.from_robot(robot), floor=height, itself=clear)


def _clear_configurations(
    chain: TipChain, at: Corrections, capsules: CapsuleDistances | None, goal: Array | None, seed: int
) -> Array:
    """Random configurations (n, nq) that keep distances and in which the tip points to the goal.

    ``at`` are the corrections of the chain. Joints beside the chain stay neutral.
    """
    robot = chain.robot
    q = robot.random_configuration(seed, CANDIDATES)
    is_beside_chain = np.ones(robot.nq, bool)
    is_beside_chain[chain.columns] = False
    q[:, is_beside_chain] = robot.neutral[is_beside_chain]
    is_suitable = np.ones(len(q), bool)
    if capsules is not None:
        distances, _ = capsules.evaluate(q)
        min_distances = np.zeros(distances.shape[1])
        min_distances[: len(capsules.margins)] = capsules.margins
        is_suitable &= (distances >= min_distances).all(axis=1)
    if goal is not None:
        T = chain.tips(q, at)
        direction = goal - T[:, :3, 3]
        z_axis = T[:, :3, 2]
        distance_along_z = (direction * z_axis).sum(axis=1)
        is_suitable &= distance_along_z >= FACING * np.linalg.norm(direction, axis=1)
    return np.asarray(q[is_suitable])


def _expected_readings(chain: TipChain, at: Corrections, q: Array, kind: str, goal: Array | None) -> Measurements:
    """Readings of a kind that the corrected chain would give, in the base frame."""
    T = chain.tips(q, at)
    p = T[:, :3, 3]
    if kind == "pose":
        return Measurements(q, poses=T)
    if kind == "position":
        return Measurements(q, positions=p)
    if kind == "distance":
        distances = np.linalg.norm(p - goal, axis=1)
        return Measurements(q, distances=np.maximum(distances, _MIN_DISTANCE))
    pair_count = len(q) // 2
    pairs = np.arange(2 * pair_count).reshape(-1, 2)  # successive configurations
    distances = np.linalg.norm(p[pairs[:, 0]] - p[pairs[:, 1]], axis=1)
    is_measurable = distances > OFF_AXIS
    return Measurements(q, pairs=pairs[is_measurable], distances=distances[is_measurable], kind="pair")


def _target(planned: Measurements, goal: Array | None) -> MeasuredTarget:
    """Target of expected readings: the base frame, the fixed end of distances, or none."""
    if planned.kind == "distance":
        return CentreTarget(planned, np.asarray(goal))
    if planned.kind == "pair":
        return PairTarget(planned)
    return FrameTarget(planned, np.eye(4))


@dataclass(frozen=True, eq=False)
class _Design:
    """Choice of readings by their information."""

    chain: TipChain
    at: Corrections
    """Corrections at which readings are linearised."""
    existing: CalibrationFit | None
    """Fit of existing readings."""
    noise: tuple[float, float]
    """Standard deviations of a reading [m, rad]."""
    accuracy: tuple[float, float]
    """Standard deviations of the file's lengths [m] and axes [rad]."""

    def fit(self, planned: Measurements, goal: Array | None) -> CalibrationFit:
        """Existing and planned readings, linearised at the start, with weights 1/σ."""
        length_noise, angle_noise = self.noise
        # rows of a reading: angles first, then lengths
        planned_weights = np.full((planned.count, planned.rows_each), 1.0 / length_noise)
        planned_weights[:, : planned.angle_rows] = 1.0 / angle_noise
        measured = [planned]
        targets = [_target(planned, goal)]
        weights = [planned_weights]
        if self.existing is not None:
            measured = [*self.existing.problem.measured, *measured]
            targets = [*self.existing.state.targets, *targets]
            weights = [*self.existing.weights, *weights]
        problem = CalibrationProblem(self.chain, tuple(measured))
        state = Estimate(self.at, tuple(targets))
        return CalibrationFit(problem, state, problem.equations(state), tuple(weights))

    def choose(self, candidates: Measurements, count: int, goal: Array | None) -> Array:
        """Indices of ``count`` readings in the order of choice: each adds most to log det M.

        Parameters are in units of the file's accuracy, so that the file adds the unit matrix to M.
        """
        fit = self.fit(candidates, goal)
        any_configuration = candidates.q[:1]  # the following deviations do not depend on it
        wide = Remaining(fit, any_configuration, self.accuracy).wide  # deviations of the parameters by the file
        *existing_designs, design = fit.equations.design
        *existing_weights, weights = fit.weights
        A = design * weights[..., None] * wide
        M = np.eye(len(wide))
        for D, W in zip(existing_designs, existing_weights, strict=True):
            rows = (D * W[..., None]).reshape(-1, len(wide)) * wide
            M += rows.T @ rows
        C = np.linalg.inv(M)
        chosen_indices = list[int]()
        unit = np.eye(A.shape[1])
        for _ in range(count):
            _, gain = np.linalg.slogdet(unit + A @ C @ np.swapaxes(A, 1, 2))  # log det(1 + A M⁻¹ A')
            gain[chosen_indices] = -np.inf
            equally_good = np.flatnonzero(gain > gain.max() - _MAX_GAIN_OF_TIE)
            best = int(equally_good[0])  # the same on every machine, whatever its rounding errors
            chosen_indices.append(best)
            X = A[best] @ C
            C = C - X.T @ np.linalg.solve(unit + X @ A[best].T, X)  # (M + A'A)⁻¹
        return np.array(chosen_indices)


def _in_order_of_moves(planned: Measurements) -> Array:
    """Configurations (n, nq) of the readings, each followed by the nearest remaining one; pairs stay together."""
    blocks = planned.q[:, None]  # (readings, 1 or 2, nq)
    if planned.pairs is not None:
        blocks = planned.q[planned.pairs]
    remaining = list(range(len(blocks)))
    last_q = blocks[0, 0]
    ordered = list[Array]()
    while remaining:
        nearest = min(remaining, key=lambda k: float(np.abs(blocks[k, 0] - last_q).max()))
        remaining.remove(nearest)
        ordered.append(blocks[nearest])
        last_q = blocks[nearest, -1]
    return np.concatenate(ordered)


complete(globals())
