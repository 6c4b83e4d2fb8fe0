"""Identification from logs of any length: one pass accumulates normal equations by chunk, and the robot is fitted to them."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial, reduce
from itertools import groupby
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..core.doubts import Doubt, doubt
from ..core.errors import ShapeError, TrajectoryError, UnknownNameError
from ..core.estimation.cross_validation import HeldOut, HeldOutRows
from ..core.estimation.least_squares import Method
from ..core.numbers import percent
from ..core.third_party import Failure, Workers
from ..motion.motion import Motion
from ..robot import Robot
from ..robot.task_space_methods import require_robot
from .chunks import CHUNK, LogClock, LogSource, RowFrame, rows_of, steady_windows
from .fit_doubts import NOTABLE_IN_OTHERS, OTHERS, of_reading
from .identify import METHODS, checked_motions, fit_options, identified
from .normal_equation_blocks import MOST_BLOCKS, JointBlocks, NormalEquationBlocks, block_residuals, block_solution
from .parameters import FRICTION, STRIBECK_SPEED, UnknownParameters
from .payload import MotorSide, unknown_of
from .rows import STATE_RATE

# ── Chunks of a log as units of work

CORE, LEAST_CORE = 8192, 1 << 15
"""Minimum size of a chunk without its margins, in states and in rows."""
_MOST_CORE = 1 << 18  # maximum number of rows of a window, unless margins need more


@dataclass(frozen=True, eq=False)
class Chunk:
    """Unit of work: a range of rows of a log, with its number of blocks of time."""

    frame: RowFrame
    source: LogSource
    clock: LogClock
    begin: int
    end: int
    blocks: int

    def moments(self) -> tuple[JointBlocks, tuple[Doubt, ...]]:
        """Accumulate sums over the rows of the chunk; the last chunk of a log also returns the doubts about the log."""
        frame, clock = self.frame, self.clock
        margin = frame.margin(clock.rate)
        every = max(1, int(clock.rate / (STATE_RATE * frame.settings.cutoff)))
        core = max(LEAST_CORE, min(CORE * every, _MOST_CORE), 2 * margin)
        ends = self.source.rows(slice(self.begin, self.begin + 1)), self.source.rows(slice(self.end - 1, self.end))
        edges = np.linspace(ends[0].time[0], ends[1].time[0], self.blocks + 1)[1:-1]
        found = JointBlocks.none(frame, self.blocks)
        for window in steady_windows(self.source, clock, core, margin, self.begin, self.end):
            for time, cells, entries in rows_of(frame, window):
                found = found.added(frame, entries, np.searchsorted(edges, time, side="right"), cells)
        return found, self.source.doubts() if self.end == clock.rows else ()


# ── Pass over all rows

_WINDOWS, WINDOW = 16, 4096  # number of runs of rows on which settings are chosen, and rows per run
_OF_JOINT = 0.35  # residual of a joint, as a share of its torques, from which a log counts as another joint's
_MOST_ROWS = 3000  # maximum number of rows of equations of an excerpt


def accumulate(
    robot: Robot,
    logs: Motion | str | Path | Sequence[Motion | str | Path],
    *,
    like: NormalEquationBlocks | None = None,
    motor_inertia: bool = True,
    friction: Sequence[str] = FRICTION,
    cutoff: float | None = None,
    friction_speed: float | None = None,
    shift: float | None = None,
    method: Method = "irls",
    motor_side: MotorSide | None = None,
    known: Mapping[str, float] | None = None,
    payload_only: str | None = None,
    stribeck_speed: float = STRIBECK_SPEED,
    columns: Mapping[str, str] | None = None,
    rate: float | None = None,
    degrees: bool = False,
    gain: Mapping[str, float] | None = None,
    topic: str | None = None,
    episode: int | None = None,
    client: Any = None,
    progress: Callable[[float], None] | None = None,
) -> NormalEquationBlocks:
    """Accumulate normal equations of logs of any length, in bounded memory.

    Parameters
    ----------
    robot : Robot
        Robot without actuators, with the values of its file.
    logs : Motion, path, or sequence of them
        Files are read in portions where their format allows it: CSV, npy, parquet, HDF5.
    like : NormalEquationBlocks, optional
        Use its settings instead of those of an excerpt, so that the new information can be added to it.
    motor_inertia : bool
    friction : sequence of str, ``viscous``, ``coulomb``, ``stribeck``, ``offset``
    cutoff : float, optional, cut-off of the low-pass [Hz]; None: chosen
    friction_speed : float, optional, Coulomb smoothing speed [rad/s, m/s]; None: chosen for each joint
    shift : float, optional, delay of torques relative to positions [s]; None: chosen
    method : "irls", "wls" or "ols", weights of the rows
    motor_side : MotorSide, optional; motors that turn with several joints have their own friction and inertia
    known : {name: float}, optional, known values of parameters, as for :func:`identify`
    payload_only : str, optional, frame of a payload that alone is identified, as for :func:`identify`
    stribeck_speed : float, as for :func:`identify`
    columns, rate, degrees, gain, topic, episode : options for reading files, as for
        :meth:`Motion.from_file <twistwrench.Motion.from_file>`
    client : dask.distributed.Client, optional, whose workers read the files; results do not depend on it, to the bit
    progress : callable, optional, called with the completed share

    Returns
    -------
    information : NormalEquationBlocks

    Raises
    ------
    ShapeError
        There is no log, or one has no torques.
    TrajectoryError
        No log can be read. If one of several logs cannot be read, it is left out with a doubt.

    Notes
    -----
    Settings are chosen on 16 runs of 4096 rows spread over the logs. Corrections of the settings are unknowns of the
    fit of all rows, to first order. Robust weights come from the residuals of the excerpt's fit, so that one pass is
    enough.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm, t = tw.robots.pendulum(), np.arange(0, 40, 0.01)
    >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
    >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
    >>> log = tw.Motion(t, q, tau=tau, robot=arm)
    >>> week = tw.identification.accumulate(arm, log[:2000], friction=())
    >>> both = week + tw.identification.accumulate(arm, log[2000:], like=week)
    >>> both.samples, bool(abs(both.identified().held_out.all) < 0.01)
    (4000, True)
    """
    require_robot(robot, "accumulate")
    given = [logs] if isinstance(logs, Motion | str | Path) else list(logs)
    if not given:
        raise ShapeError("accumulate: there is no log. Give one with torques at least.")
    if method not in METHODS:
        raise UnknownNameError.from_choices("method", method, METHODS)
    reading: dict[str, Any] = {"columns": columns, "rate": rate, "degrees": degrees, "gain": gain, "side": motor_side}
    reading |= {"topic": topic, "episode": episode}
    sources = [LogSource.from_log(robot, log, k, **reading) for k, log in enumerate(given, start=1)]
    checked_motions(robot, [s.motion for s in sources if s.motion is not None], "logs")
    team, tell = Workers.from_client(client), progress or (lambda _share: None)
    failed: dict[str, str] = {}
    clocks = _succeeded(sources, team.results(LogSource.clock, sources, lambda s: tell(0.1 * s)), failed)
    if like is None:
        asked = fit_options(cutoff, friction_speed, shift)
        sought: dict[str, Any] = {"motor_inertia": motor_inertia, "friction": friction, "motor_side": motor_side}
        sought |= {"known": known, "stribeck_speed": stribeck_speed}
        unknown = unknown_of(robot, **sought, payload_only=payload_only)
        start = _from_excerpt(unknown, robot, [s for s, _ in clocks], asked, method, failed, payload_only)
    else:
        start = replace(like, moments=JointBlocks.none(like.frame, 0), doubts=(), logs=())
    tell(0.2)
    work = _chunks(start.frame, clocks)
    return _sum_of_logs(start, like, work, team.results(Chunk.moments, work, lambda s: tell(0.2 + 0.8 * s)), failed)


def _sum_of_logs(
    start: NormalEquationBlocks,
    like: NormalEquationBlocks | None,
    work: Sequence[Chunk],
    made: Iterable[tuple[JointBlocks, tuple[Doubt, ...]] | Failure],
    failed: dict[str, str],
) -> NormalEquationBlocks:
    """Sum of all chunks, with doubts about logs that are left out, inconsistent in themselves, or unlike the other logs."""
    # Logs are compared at the parameters from the previous logs, or from the excerpt.
    frame = start.frame
    x = np.pad(frame.x, (0, frame.width - len(frame.x))) if like is None else block_solution(like)[0]
    whole: NormalEquationBlocks | None = None  # running sum, because the parts of many logs need much memory
    left, said = dict[str, HeldOut](), list[Doubt]()
    for part, doubts in _parts(start, work, made, failed):
        whole = part if whole is None else whole + part
        left[part.logs[0]] = block_residuals(part, x)
        said += of_reading(doubts, part.logs[0])
    if whole is None:
        raise TrajectoryError(
            next(iter(failed.values()), "accumulate: the logs are too short to identify a robot from.")
        )
    lost = [doubt("left-out", path=path, reason=reason) for path, reason in failed.items()]
    usual = [block_residuals(like, x)] if like is not None else list(left.values())
    return replace(whole, doubts=(*start.doubts, *lost, *said, *_others(left, usual)))


def _parts(
    start: NormalEquationBlocks,
    work: Sequence[Chunk],
    made: Iterable[tuple[JointBlocks, tuple[Doubt, ...]] | Failure],
    failed: dict[str, str],
) -> Iterator[tuple[NormalEquationBlocks, list[Doubt]]]:
    """Yield the normal equations of each log with the doubts about it; collect reasons of failed logs in ``failed``."""
    for source, of_log in groupby(zip(work, made, strict=True), lambda pair: pair[0].source):
        chunks, results = zip(*of_log, strict=True)
        if broken := [result.reason for result in results if isinstance(result, Failure)]:
            failed[source.path] = broken[0]
            continue
        moments = reduce(operator.add, (one for one, _ in results))
        if not moments.counts.any():
            failed[source.path] = "it is too short for its cut-off"
            continue
        clock = chunks[0].clock
        part = replace(
            start,
            moments=moments,
            doubts=(),
            seconds=clock.seconds,
            samples=clock.rows,
            logs=(source.path,),
            notes=(*source.notes(), *clock.notes),
        )
        yield part, [doubt for _, doubts in results for doubt in doubts]


def _others(left: Mapping[str, HeldOut], usual: Sequence[HeldOut]) -> list[Doubt]:
    """Logs whose residual, at the same parameters, is far larger than the median of the other logs."""
    found = []
    half = float(np.quantile([one.all for one in usual], 0.5, method="lower"))
    names = usual[0].names
    of_joints = np.quantile([[one.joints[name] for name in names] for one in usual], 0.5, axis=0, method="lower")
    for path, one in left.items():
        worse = [n for n, u in zip(names, of_joints, strict=True) if one.joints[n] > max(OTHERS * float(u), _OF_JOINT)]
        if worse or one.all > max(OTHERS * half, NOTABLE_IN_OTHERS):
            worst = max(worse, key=lambda name: one.joints[name], default="")
            most = f", at {worst} to {percent(one.joints[worst], 3)}" if worst else ""
            found.append(
                Doubt(
                    "other-torques",
                    f"{path} is explained to {percent(one.all, 3)}{most} by what explains others to {percent(half, 3)}: its "
                    "torques are not those of the same rigid bodies. Was friction compensated, or something carried, in one of "
                    "them?",
                    tuple(worse),
                )
            )
    return found


Result = TypeVar("Result")


def _succeeded(
    sources: Sequence[LogSource], results: Iterable[Result | Failure], failed: dict[str, str]
) -> list[tuple[LogSource, Result]]:
    """Yield sources with their results; collect reasons of failures in ``failed``."""
    pairs = list(zip(sources, results, strict=True))
    failed |= {source.path: result.reason for source, result in pairs if isinstance(result, Failure)}
    found = [(source, result) for source, result in pairs if not isinstance(result, Failure)]
    if not found:
        raise TrajectoryError(next(iter(failed.values())))
    return found


def _chunks(frame: RowFrame, clocks: Sequence[tuple[LogSource, LogClock]]) -> list[Chunk]:
    """Chunks of all logs, independent of the number of workers."""
    cuts = [(*one, k, min(k + CHUNK, one[1].rows)) for one in clocks for k in range(0, one[1].rows, CHUNK)]
    found = []
    for source, clock, begin, end in cuts:
        seconds = clock.seconds * (end - begin) / clock.rows
        blocks = int(np.clip(min(MOST_BLOCKS // len(cuts), seconds / _BLOCK), 1, MOST_BLOCKS))
        found.append(Chunk(frame, source, clock, begin, end, blocks))
    return found


_BLOCK = 2.0  # minimum duration of a block of time [s]


def _from_excerpt(
    unknown: UnknownParameters,
    robot: Robot,
    sources: Sequence[LogSource],
    asked: Any,
    method: Method,
    failed: dict[str, str],
    payload_only: str | None,
) -> NormalEquationBlocks:
    """Empty blocks with the settings of an excerpt of the logs."""
    some = [sources[k] for k in np.unique(np.linspace(0, len(sources) - 1, _WINDOWS).astype(int))]
    excerpts = partial(LogSource.excerpts, count=-(-_WINDOWS // len(some)), rows=WINDOW)
    windows = [w for _, of_log in _succeeded(some, Workers().results(excerpts, some), failed) for w in of_log]
    if not windows:
        raise TrajectoryError(next(iter(failed.values())))
    moving = [w for w in windows if np.ptp(w.q, axis=0).any()] or windows
    found, dead, length = identified(
        unknown, robot, moving, (), asked, method, lambda _share: None,
        payload_only=payload_only, anew=False, most_rows=_MOST_ROWS,
    )  # fmt: skip
    free = asked.shift is None, asked.friction_speed is None and "coulomb" in unknown.friction
    sigma = np.where(dead, 1.0, found.sigma)
    told, none = found.covariance, np.zeros((0, found.base.count))
    frame = RowFrame(found.base, found.settings, found.values, sigma, dead, *free, method == "irls", told.cells)
    shown = (np.concatenate(columns) for columns in zip(*map(astuple, found.held_out.rows), strict=True))
    return NormalEquationBlocks(
        robot, frame, JointBlocks.none(frame, 0), found.prior, found.sizes, none if told.changes is None else told.changes,
        method, 0.0, 0, length, (), found.doubts, HeldOutRows(*shown) if found.held_out.rows else None, payload_only,
    )  # fmt: skip
