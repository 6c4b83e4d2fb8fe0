"""Motion for display: a limited number of states, their torques, and limit violations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.doubts import Doubt
from ..core.errors import ShapeError, ValueRangeError
from ..core.numbers import number, percent, printed, seconds
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..mechanics.model.couplings import joint_effort
from ..motion.bounds import LimitCheck, Violation, bounds_of, velocities_inside
from ..motion.coordinates import joint_rates
from ..motion.differentiation import Differentiation, MotionSamples
from ..motion.load_case import LoadCase
from ..motion.motion import Motion
from ..motion.motion_log import ASKED
from ..motion.smoothing import FEWEST, between, continuous, spline_rates
from ..shapes.surface import Decimation

if TYPE_CHECKING:
    from ..mechanics.model.limits import Limits
    from ..mechanics.model.model import Model
    from ..motion.motion_log import MotionLog
    from ..robot import Robot
    from ..statics.clearance import PathClearance
    from .torque_report import TorqueReport

_MAX_STATES = 16_000
"""Number of states that are kept of a long motion: a quarter evenly spaced, the others at peaks."""
_ROWS_PER_BATCH = 8192
"""Number of rows that are computed at once."""


@dataclass(frozen=True, eq=False)
class DrawnMotion:
    """Motion for display: states of a robot over time.

    Long motions are reduced to evenly spaced states and those at peaks of a curve.
    """

    load: LoadCase
    """Robot with its payloads and loads."""
    time: Array
    """(n,) s, increasing."""
    q: Array
    """Configurations (n, nq)."""
    dq: Array
    """Velocities (n, nv), rad/s or m/s."""
    ddq: Array
    """Accelerations (n, nv), rad/s² or m/s²."""
    torques: Array
    """Torques (n, nv), including everything in ``load``; N m or N."""
    peaks: Array
    """(nv,) largest magnitude of each torque over all rows."""
    rows: int
    """Number of rows of the whole motion."""
    warnings: tuple[str, ...]
    """Sentences on limit violations, and on contradictions in the input."""
    still: Array
    """(n, nv) of bool: True where the derived velocity is within its uncertainty, so that its sign causes no friction."""
    verdict: Verdict = field(default_factory=lambda: Verdict(Word.OK))
    """LOOK AGAIN if the input contradicts itself. Limit violations only give warnings."""
    clearance: PathClearance | None = None
    """Smallest distance between links; None if not requested."""
    violations: tuple[Violation, ...] = ()
    """Limit violations in the whole motion."""
    refused: tuple[str, ...] = ()
    """Contradictions in the input, one sentence each."""
    report: TorqueReport | None = None
    """Report of the command ``torques`` on the motion; None for arrays and without a verdict."""
    judged: bool = True
    """True if a page shows a verdict on the motion; False if its page answers another question."""

    @property
    def passed(self) -> tuple[str, ...]:
        """Sentences on limit violations; part of ``warnings``."""
        return tuple(map(_sentence, self.violations))

    @property
    def limits(self) -> Limits:
        """Limits of the motion; joints with coupled motors have no separate torque limit."""
        model = self.load.robot.model
        limits = self.load.robot.limits if self.report is None else self.report.limits
        if model.couplings:
            limits = replace(limits, effort=joint_effort(model, limits.effort))
        return limits

    @property
    def states(self) -> MotionSamples:
        """States in the form used by :class:`~twistwrench.motion.load_case.LoadCase`."""
        no_outliers = np.zeros((len(self.time), 0))
        return MotionSamples(self.time, self.q, self.dq, self.ddq, self.q, self.still, no_outliers)

    def require(self, robot: Robot) -> None:
        """Check that the motion belongs to this robot, with any load.

        Parameters
        ----------
        robot : Robot

        Examples
        --------
        >>> import twistwrench as tw
        >>> t = np.linspace(0, 1, 21)
        >>> motion_of(tw.robots.pendulum(), t, t[:, None] ** 2).require(tw.robots.pendulum())
        """
        own_robot = self.load.robot
        if own_robot.coordinate_names != robot.coordinate_names:
            raise ValueRangeError(
                f"the motion is of robot {own_robot.name!r}, and the one to be shown is {robot.name!r}. Make it with "
                "motion_of(robot, …)."
            )

    def at(self, time: float) -> tuple[Array, Array]:
        """Configuration and torques at a time, by linear interpolation between samples.

        Parameters
        ----------
        time : float [s]

        Returns
        -------
        q : (nq,) array
        torques : (nv,) array [N m, sliding joints: N]

        Examples
        --------
        >>> import twistwrench as tw
        >>> t = np.linspace(0, 1, 21)
        >>> q, torques = motion_of(tw.robots.pendulum(), t, t[:, None] ** 2).at(0.5)
        >>> q.round(3).tolist()
        [0.25]
        """
        q, row_before, row_after, share = between(self.load.with_load, self.time, self.q, np.asarray(time))
        tau_before = self.torques[row_before]
        tau_after = self.torques[row_after]
        return q, tau_before + share * (tau_after - tau_before)


def motion_of(
    robot: Robot | LoadCase,
    time: Any,
    q: ArrayLike | None = None,
    dq: ArrayLike | None = None,
    ddq: ArrayLike | None = None,
) -> DrawnMotion:
    """Motion for display from a :class:`twistwrench.Motion`, from a result that contains one, or from arrays.

    Fewer than six samples are treated as states at rest, with a warning if positions change.

    Parameters
    ----------
    robot : Robot, or a LoadCase with payloads and loads
    time : (n,) array_like [s], a Motion, or a result that contains one
    q : (n, nq) array_like, configurations
    dq : (n, nv) array_like, optional, velocities [rad/s, m/s]; default: derived by a spline
    ddq : (n, nv) array_like, optional, accelerations [rad/s², m/s²], likewise

    Returns
    -------
    motion : DrawnMotion, with joint friction included in the torques, as in the command ``torques``

    Examples
    --------
    >>> import twistwrench as tw
    >>> t = np.linspace(0, 1, 21)
    >>> motion = motion_of(tw.robots.pendulum(), t, np.sin(t)[:, None])
    >>> motion.torques.shape, motion.rows
    ((21, 1), 21)
    """
    doubts: tuple[Doubt, ...] = ()
    if q is None:
        source = getattr(time, "motion", time)  # a result has its motion as attribute
        if not isinstance(source, Motion):
            raise ShapeError(
                "motion_of: q is missing: give time and q, a twistwrench.Motion, or a result that has one."
            )
        time, q, dq, ddq = source.time, source.q, source.dq, source.ddq
        doubts = source.contradictions
    load = robot if isinstance(robot, LoadCase) else LoadCase(robot)
    model = load.robot.model
    t = arguments.finite(time, "time")
    q = arguments.finite(q, "q", model.nq, names=load.robot.coordinate_names)
    has_states = t.ndim == 1 and len(t) > 0
    if not has_states or q.shape != (len(t), model.nq):
        raise ShapeError(f"a motion has time (n,) and q (n, {model.nq}), got {t.shape} and {q.shape}.")
    does_not_increase = np.diff(t) <= 0
    if does_not_increase.any():
        k = int(np.argmax(does_not_increase))  # first such step
        raise ValueRangeError(
            f"time does not increase from sample {k} ({printed(t[k])} s) to the next ({printed(t[k + 1])} s)."
        )
    lacks_rates = dq is None or ddq is None
    given_dq = None if dq is None else _check_rates("dq", dq, len(t), model)
    given_ddq = None if ddq is None else _check_rates("ddq", ddq, len(t), model)
    zeros = np.zeros((len(t), model.nv))
    derived_dq = zeros  # too few samples are states at rest
    derived_ddq = zeros
    if lacks_rates and len(t) >= FEWEST:
        q = continuous(model, q)
        first_derivative, second_derivative = spline_rates(t, q)
        derived_dq, derived_ddq = joint_rates(model, q, first_derivative, second_derivative)
        if given_dq is not None:
            derived_ddq, _ = spline_rates(t, given_dq)
    dq = derived_dq if given_dq is None else given_dq
    ddq = derived_ddq if given_ddq is None else given_ddq
    dq = velocities_inside(t, dq, ddq, t[0], t[-1])
    never_still = np.zeros_like(zeros, bool)
    no_outliers = zeros[:, :0]
    states = MotionSamples(t, q, dq, ddq, q, never_still, no_outliers)
    motion = _read_states(load, iter([states]))  # one batch
    contradictions = tuple(map(str, doubts))
    warnings = [*_look_again_warnings(contradictions), *motion.warnings]
    has_moved = (q != q[0]).any()
    if lacks_rates and len(t) < FEWEST and has_moved:
        warnings.append(
            f"{len(t)} samples are too few to derive rates from, so torques are those at rest: give {FEWEST}, or dq and "
            "ddq"
        )
    return replace(motion, refused=contradictions, warnings=tuple(warnings))


def _check_rates(name: str, values: ArrayLike, rows: int, model: Model) -> Array:
    """Velocities or accelerations (n, nv) as an array; raises ShapeError."""
    rates = arguments.finite(values, name, model.nv, names=model.velocity_names)
    if rates.shape != (rows, model.nv):
        raise ShapeError(f"{name} has shape {rates.shape}, expected ({rows}, {model.nv}).")
    return rates


def _look_again_warnings(contradictions: Iterable[str]) -> list[str]:
    return [f"{Word.LOOK_AGAIN}: {contradiction}" for contradiction in contradictions]


def read_motion(
    load: LoadCase, trajectory: MotionLog, progress: Callable[[int], None] | None = None, *, smoothing: bool = False
) -> DrawnMotion:
    """Motion from a file, read as by the command ``torques``.

    Parameters
    ----------
    load : LoadCase
    trajectory : MotionLog, the file
    progress : callable, optional, called with the number of rows read
    smoothing : bool, smooth by the estimated noise before differentiation

    Returns
    -------
    motion : DrawnMotion

    Raises
    ------
    TrajectoryError
        The file cannot be used.
    """
    differentiation = Differentiation.plan(trajectory, load.robot.model, smoothing=smoothing)
    motion = _read_states(load, differentiation.states(_ROWS_PER_BATCH, progress))
    return _with_doubts(motion, trajectory)


def reported_motion(report: TorqueReport) -> DrawnMotion:
    """Motion of a report, smoothed if the report used the smoothed motion.

    Parameters
    ----------
    report : TorqueReport

    Returns
    -------
    motion : DrawnMotion
    """
    differentiation = report.differentiation
    motion = _read_states(report.load, differentiation.states(_ROWS_PER_BATCH, None))
    motion = _with_doubts(motion, differentiation.trajectory)
    return replace(motion, report=report, clearance=report.clearance)


def _with_doubts(motion: DrawnMotion, trajectory: MotionLog) -> DrawnMotion:
    """Motion with doubts about its log, and a verdict of LOOK AGAIN for contradictions."""
    doubts = trajectory.doubts(motion.load.robot.limits)
    contradictions = list(motion.load.contradictions)
    contradictions += [str(doubt) for doubt in doubts if doubt.refuses]
    warnings = _look_again_warnings(contradictions)
    for doubt in doubts:
        is_question = doubt.level == "note" and doubt.kind in ASKED
        if doubt.level == "unsure" or is_question:
            warnings.append(str(doubt))
    warnings += motion.warnings
    verdict = Verdict.from_reasons(look_again=contradictions)
    return replace(motion, warnings=tuple(warnings), verdict=verdict, refused=tuple(contradictions))


def _read_states(load: LoadCase, batches: Iterator[MotionSamples]) -> DrawnMotion:
    """Read the motion in one pass and bounded memory, keeping the peaks of torques, velocities and power."""
    nq, nv = load.robot.nq, load.robot.nv
    peak_columns = slice(1, 1 + 1 + nv + nv)  # peaks are kept of the columns after the time: power, torques, velocities
    states = Decimation(_MAX_STATES, peak_columns)
    peaks = np.full(nv, -np.inf)
    check = LimitCheck(load.robot.model, bounds_of(load.robot))
    for batch in batches:
        torques = load.torques(batch)
        peaks = np.maximum(peaks, np.abs(torques).max(axis=0))
        check.add(batch.time, batch.measured, batch.dq, tau=torques)
        if load.robot.model.limited_followers:
            check.add_borne(batch.time, load.follower_torques(batch))
        power = (torques * batch.dq).sum(axis=1)
        columns = [batch.time, power, torques, batch.dq, batch.q, batch.ddq, batch.stationary]
        states.add(np.column_stack(columns))
    widths = [1, 1, nv, nv, nq, nv]  # of ``columns`` but for the last one
    time, _, torques, dq, q, ddq, stationary = np.split(states.result(), np.cumsum(widths), axis=1)
    violations = check.violations()
    return DrawnMotion(
        load,
        time=time[:, 0],
        q=q,
        dq=dq,
        ddq=ddq,
        torques=torques,
        peaks=peaks,
        rows=states.count,
        warnings=tuple(map(_sentence, violations)),
        still=stationary.astype(bool),
        violations=violations,
    )


def _sentence(violation: Violation) -> str:
    """Sentence on a limit violation: amount and time."""
    if violation.kind in ("velocity", "torque"):
        limit = f"{violation.kind} limit"
    else:
        limit = "upper limit" if violation.value > violation.limit else "lower limit"
    excess = number(violation.by, 3)
    if violation.limit != 0.0:  # there is no share of a limit of zero
        share = violation.by / abs(violation.limit)
        excess += f" ({percent(share, 3)})"
    return f"{violation.joint} exceeds its {limit} by {excess} at t = {seconds(violation.time)} s"
