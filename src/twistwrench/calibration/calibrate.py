"""Function of the command ``calibrate``: fit the geometry of an arm to measurements, with a verdict on what they determine."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import complete
from ..robot import Robot, load
from .chain import TipChain
from .doubts import doubts_of
from .fit import CalibrationProblem
from .groups import fitted_in_groups
from .held_out import cross_validated, error_of_test
from .measurements import MIN_CONFIGURATIONS, Measurements, ReadingKind, length_and_angle, read_measurements
from .result import CalibratedRobot

MeasurementsGiven: TypeAlias = str | Path | Measurements
"""One measurement: a path, or its arrays."""
Cause: TypeAlias = Literal["sag", "gears"]
Causes: TypeAlias = Cause | Collection[Cause]
Outliers: TypeAlias = Literal["trim", "keep"]
NoiseGiven: TypeAlias = float | tuple[float, float]
"""Standard deviation of lengths [m], or of lengths [m] and angles [rad]."""
AccuracyGiven: TypeAlias = tuple[float, float]
"""Standard deviations of lengths [m] and angles [rad]."""
CONFIGURATIONS = 500
"""Number of configurations of the predicted error."""


def calibrate(
    robot: Robot | str | Path,
    measurements: MeasurementsGiven | Sequence[MeasurementsGiven],
    *,
    kind: ReadingKind | None = None,
    tip: str | None = None,
    assume: Causes = (),
    test: MeasurementsGiven | Sequence[MeasurementsGiven] | None = None,
    length: float | None = None,
    noise: NoiseGiven | None = None,
    file_accuracy: AccuracyGiven = (1e-3, 2e-3),
    outliers: Outliers = "trim",
    seed: int = 0,
    degrees: bool = False,
) -> CalibratedRobot:
    """Fit zeros, axes, lengths, tip and target of an arm to measurements, with intervals and held-out error.

    Parameters
    ----------
    robot : Robot, path of a robot file, or name of a known robot
    measurements : path, Measurements, or a sequence of these, which are fitted together
    kind : str, optional
        Kind of the readings; default: by the columns. Touches need it.
    tip : str, optional, frame nearest to the target; default: the tip
    assume : "sag", "gears" or both
        Estimate this cause too: sag of joints under gravity, or errors of gears.
    test : as ``measurements``, optional
        Log to predict, not to fit; default: six folds.
    length : float, optional, known length of touches [m]
    noise : float [m], or (float [m], float [rad])
        Standard deviation of a reading; default: estimated.
    file_accuracy : (float [m], float [rad])
        Standard deviations of lengths and axes in the robot's file [m, rad].
    outliers : "trim" leaves out readings that contradict the others, "keep" uses all
    seed : int, of the folds and of the configurations of the predicted error
    degrees : bool, joint positions and angles without a unit are in degrees

    Returns
    -------
    found : CalibratedRobot
        ``found.verdict``, ``found.robot``, ``found.write(path)``.

    Raises
    ------
    ModelError
        The robot has no single tip, or a joint on the way cannot be calibrated.
    NotFoundError, ShapeError, TrajectoryError, UnknownNameError, ValueRangeError
        The measurements cannot be read, or an option is not valid.

    Notes
    -----
    Product of exponentials in local frames with six corrections for each joint. Sources: Lynch and Park, Modern Robotics,
    4.1; Wu et al., "An analytical approach for the calibration of robots", IEEE T-ASE 12(2), 2015.

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = tw.calibration.calibrate("ur5", "demo")
    >>> found.verdict.ok, found.held_out.rms < 0.2e-3 < 3e-3 < found.before
    (True, True)
    """
    arguments.choice(outliers, "outliers", ("trim", "keep"))
    accuracy = length_and_angle(file_accuracy, "file_accuracy")
    if not isinstance(robot, Robot):
        robot = load(robot)
    arm = robot
    causes = [assume] if isinstance(assume, str) else assume
    chain = TipChain.from_robot(arm, tip, causes)

    def read(given: MeasurementsGiven | Sequence[MeasurementsGiven]) -> tuple[Measurements, ...]:
        """Measurements of the argument ``measurements`` or ``test``, with the other arguments of the call."""
        if not isinstance(given, str | Path | Measurements | Iterable):
            raise ValueRangeError(
                f"measurements={given!r}: give a path, Measurements(q, positions=…), or a list of them."
            )
        sources = [given] if isinstance(given, str | Path | Measurements) else list(given)
        read_sources = []
        for source in sources:
            measurement = read_measurements(source, arm, kind, tip, degrees=degrees)
            read_sources.append(_with_options(measurement, length, noise))
        return tuple(_require_readings(measurement, arm) for measurement in read_sources)  # after all files are read

    measured = read(measurements)
    if not measured:
        raise ValueRangeError("no measurements are given. Give a path, or Measurements(q, positions=…).")
    problem = CalibrationProblem(chain, measured, keep_outliers=outliers == "keep")
    file_fit = problem.solve(frames_only=True)  # targets and tip alone
    fit = fitted_in_groups(problem.solve())
    held_out = cross_validated(fit, seed) if test is None else error_of_test(fit, read(test))
    settings = {
        "kind": kind, "tip": chain.frame, "assume": list(chain.assume), "length": length, "noise": noise,
        "file_accuracy": list(accuracy), "outliers": outliers, "seed": seed,
    }  # fmt: skip
    files = {}
    for index, measurement in enumerate(measured, 1):
        name = "MEASUREMENTS" if index == 1 else f"MEASUREMENTS{index}"
        if measurement.path:
            files[name] = measurement.path
    configurations = arm.random_configuration(seed, CONFIGURATIONS)
    no_doubts = ()
    without_doubts = CalibratedRobot(arm, fit, file_fit, held_out, no_doubts, accuracy, configurations, settings, files)
    return replace(without_doubts, doubts=tuple(doubts_of(without_doubts)))


def _with_options(m: Measurements, length: float | None, noise: float | tuple[float, float] | None) -> Measurements:
    """Measurements with the length and the noise of the call, unless they have their own."""
    if noise is not None and m.noise is None:
        m = replace(m, noise=noise)
    if length is not None and m.length is None:
        m = replace(m, length=length)
    return m


def _require_readings(m: Measurements, robot: Robot) -> Measurements:
    """The measurements; raises ShapeError if they are of another robot, and ValueRangeError if they are too few."""
    has_rows_of_robot = m.q.ndim == 2 and m.q.shape[1] == robot.nq
    if not has_rows_of_robot:
        raise ShapeError(
            f"q has the shape {m.q.shape}, and robot {robot.name!r} has {robot.nq} coordinates. Give (n, {robot.nq})."
        )
    if m.count < MIN_CONFIGURATIONS:
        raise ValueRangeError(f"{m.count} readings determine nothing. Give at least {MIN_CONFIGURATIONS}, better 30.")
    return m


complete(globals())
