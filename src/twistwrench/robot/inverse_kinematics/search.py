"""Kernel of the inverse-kinematics search with restarts."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...compiler.ir.loops import PLACES, Search
from ...compiler.ir.program import TensorSpec
from ...compiler.ir.tracer import trace
from ...compiler.runtime import batch_threads
from ...compiler.runtime.batch_threads import Part
from ...compiler.runtime.dispatch import make_call
from ...core.typing import Array
from ...mechanics.algorithms.newton_step import NewtonStep
from ...mechanics.model.configurations import random_configuration
from ...mechanics.model.model import Model
from ..engine import compile_form

if TYPE_CHECKING:
    from ..constraints.loop_closure_solver import LoopClosureSolver

STEPS = 60
"""Largest number of steps from one start."""
POSTURE_STEPS = 240
"""Largest number of steps towards a posture."""
FIRST_LOOK = 8
"""Steps of the search for a single pose in one lane of a vector register, before all lanes search from a start each."""
AT_ONCE = 1 << 18
"""Largest number of starts in one call of the kernel; Ctrl-C takes effect between calls."""
MIN_POSES_AT_ONCE = 64
"""Smallest number of poses in one call, whatever the number of starts."""
Frames = tuple[tuple[str, tuple[int, ...]], ...]
"""Frame names, each with rows of the frame's twist."""
ATTEMPT_COUNT, OUTCOME, POSE_ERROR, FIRST_ROW = 0, 1, 2, 3
"""Columns of a status. The outcome is 1 for a pose that was reached, 0 for one that was not, -1 or NaN for no valid pose.

From ``FIRST_ROW`` on follow the errors of the frames' rows, the gaps of the loops, and 1 for each joint held by a limit.
"""
_TOLERANCE_MARGIN = 1e-9
"""Margin below 1 of squared tolerances, against rounding errors."""


class PoseSearch:
    """Search for the poses of some frames of one robot, each with selected rows."""

    def __init__(
        self,
        model: Model,
        frames: Frames,
        farthest: float,
        poses: tuple[Any, ...],
        difference: Any,
        loops: LoopClosureSolver | None = None,
    ) -> None:
        """``farthest``: displacement of a frame per radian of the farthest joint [m]; ``poses``, ``difference``: kernels.

        ``poses`` return those of q; ``difference`` returns the joint twists from one q to another. ``loops`` are closed.
        """
        self.model, self.poses, self.difference, self.loops = model, poses, difference, loops
        self.target_shape = (4, 4) if len(frames) == 1 else (len(frames), 4, 4)
        self._starts: dict[int, _StartConfigurations] = {}
        self.length = farthest if farthest > 0 else 1.0
        """Length in m that is weighted like one radian."""
        error_rows: list[int] = []  # rows of twists: below 3 angular, from 3 on linear
        for _, rows in frames:
            error_rows += rows
        if loops is not None:
            error_rows += loops.kinds
        scale = np.where(np.array(error_rows) < 3, 1.0, 1.0 / self.length)
        simple = [b for b in model.leaders if b.joint.nv == 1]
        self.q_of = np.array([b.q_index for b in simple], int)
        v_of = np.array([b.v_index for b in simple], int)
        self.low, self.high = model.limits.lower[v_of], model.limits.upper[v_of]
        v_low, v_high = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)  # limits by velocity, then by coordinate
        v_low[v_of], v_high[v_of] = self.low, self.high
        self._q_low, self._q_high = np.full(model.nq, -np.inf), np.full(model.nq, np.inf)
        self._q_low[self.q_of], self._q_high[self.q_of] = self.low, self.high
        coordinates = np.full(model.nv, -1)  # coordinate of each velocity; -1 for joints of several degrees
        coordinates[v_of] = self.q_of
        self._step = NewtonStep(
            model, frames, scale, v_low, v_high, tuple(coordinates.tolist()),
            loops=None if loops is None else loops.rows, gaps=() if loops is None else loops.allowed,
        )  # fmt: skip
        search = self._search(self._step)
        self.status_size = search.status.size
        self.kernel = compile_form(search, "inverse_kinematics", f"Search of {model.name} for poses, compiled.")
        weights = []
        for _, rows in frames:
            rotation_weight = float(min(rows, default=3) < 3)
            position_weight = (max(rows, default=0) >= 3) / self.length**2
            entry_weights = np.full((3, 4), rotation_weight)  # of (R, p)
            entry_weights[:, 3] = position_weight
            weights.append(entry_weights.ravel())
        self.weights = np.concatenate(weights)

    def _search(self, step: NewtonStep) -> Search:
        nq, count = self.model.nq, len(self.poses)
        target = TensorSpec("T", self.target_shape)
        if step.posture:
            target = TensorSpec("T and posture", (16 * count + nq,))
        given_size = target.size + 2  # and the two tolerances
        ports = [("angles", (nq,)), ("q", (nq,)), ("passed on", (sum(step.sizes),)), ("given", (given_size,))]
        program = trace(step, ports, ["q", "passed on"])
        compared = np.arange(16 * count).reshape(count, 16)[:, :12]  # entries (R, p) of each pose, without the last row
        return Search(
            program,
            target,
            tuple(compared.ravel().tolist()),
            step.begins,
            tuple(self._q_low.tolist()),
            tuple(self._q_high.tolist()),
        )

    @cached_property
    def look(self) -> Any:
        """Kernel of one lane for one pose; ``rounds=1``: it gives up if a joint meets a limit.

        Otherwise its result equals the general kernel's.
        """
        doc = f"Look of {self.model.name} for one pose near by, compiled."
        return compile_form(self._search(replace(self._step, rounds=1)), "look", doc, scalar=True)

    @cached_property
    def to_posture(self) -> Any:
        """Kernel that moves from reached poses towards a posture, as near as the poses allow."""
        doc = f"Search of {self.model.name} for postures, compiled."
        return compile_form(self._search(replace(self._step, posture=True)), "posture", doc)

    def settings(self, tolerances: tuple[float, float], restarts: int, steps: int = STEPS) -> Array:
        """Settings of the kernel other than poses and starts."""
        angle, distance = tolerances
        share = 1.0 - _TOLERANCE_MARGIN
        return np.array([steps, restarts, share * angle * angle, share * distance * distance, *self.weights])

    def inside(self, q: Array) -> Array:
        """q with joints of one degree of freedom clipped to their limits."""
        q = np.array(q, float)
        q[..., self.q_of] = np.clip(q[..., self.q_of], self.low, self.high)
        return q

    def round_to_type(self, q: Array, kind: np.dtype[Any]) -> Array:
        """q rounded to another type; numbers that leave the limits by rounding are moved to the nearest value inside."""
        rounded = q.astype(kind, copy=False)
        if kind == q.dtype:
            return rounded
        x = rounded[..., self.q_of]
        x = np.where(x > self.high, np.nextafter(x, np.asarray(-np.inf, kind)), x)
        rounded[..., self.q_of] = np.where(x < self.low, np.nextafter(x, np.asarray(np.inf, kind)), x)
        return rounded

    def best(
        self, T: Array, start: Array, restarts: int, seed: int, tolerances: tuple[float, float]
    ) -> tuple[Array, Array]:
        """Best result of all starts (n, nq), the first at ``start``, and its status (n, status); T (n, *core)."""
        settings = self.settings(tolerances, min(restarts, PLACES))
        if seed not in self._starts:  # the start table takes longer than most searches, which need none
            q, status = self.run(T, start, self._no_starts, self.settings(tolerances, 0))
            rows = np.flatnonzero(status[:, OUTCOME] == 0.0)
            if not restarts or not len(rows):
                return q, status
            q[rows], status[rows] = self.run(T[rows], start[rows], self.start_configurations(seed).table(0), settings)
        else:
            q, status = self.run(T, start, self.start_configurations(seed).table(0), settings)
        starts = self.start_configurations(seed)
        number, done = 1, PLACES  # table of starts; restarts so far
        while done < restarts:  # a start before those of a table, then the table's
            rows = np.flatnonzero(status[:, OUTCOME] == 0.0)
            if not len(rows):
                break
            settings = self.settings(tolerances, min(restarts - done - 1, PLACES))
            first = np.broadcast_to(starts.first(number), (len(rows), self.model.nq))
            new_q, new_status = self.run(T[rows], first, starts.table(number), settings)
            new_status[:, ATTEMPT_COUNT] += status[rows, ATTEMPT_COUNT]
            status[rows, ATTEMPT_COUNT] = new_status[:, ATTEMPT_COUNT]  # also of poses that did not improve
            improved = (new_status[:, OUTCOME] != 0.0) | (new_status[:, POSE_ERROR] < status[rows, POSE_ERROR])
            number, done = number + 1, done + PLACES + 1
            q[rows[improved]], status[rows[improved]] = new_q[improved], new_status[improved]
        return q, status

    def nearest(
        self, T: Array, posture: Array, solution: tuple[Array, Array], tolerances: tuple[float, float]
    ) -> tuple[Array, Array]:
        """Move solutions towards postures (n, nq) with the frames fixed, until no step improves."""
        q, status = solution
        rows = np.flatnonzero(status[:, OUTCOME] > 0.0)
        no_starts, settings = self._no_starts, self.settings(tolerances, 0, POSTURE_STEPS)
        target = np.concatenate([T[rows].reshape(len(rows), 16 * len(self.poses)), posture[rows]], axis=1)
        new_q, _ = self.run(target, q[rows], no_starts, settings, self.to_posture)
        new_q, new_status = self.run(T[rows], new_q, no_starts, settings)  # to full precision
        old_distance = np.linalg.norm(self.difference(posture[rows], q[rows]), axis=1)
        new_distance = np.linalg.norm(self.difference(posture[rows], new_q), axis=1)
        improved = (new_status[:, OUTCOME] > 0.0) & (new_distance < old_distance)
        new_status[:, ATTEMPT_COUNT] = status[rows, ATTEMPT_COUNT]
        q[rows[improved]], status[rows[improved]] = new_q[improved], new_status[improved]
        return q, status

    def run(
        self, T: Array, start: Array, table: tuple[Array, Array], settings: Array, kernel: Any = None
    ) -> tuple[Array, Array]:
        """Run the kernel, or another one, on any number of poses, in parts."""
        q, status = np.empty((len(T), self.model.nq)), np.empty((len(T), self.status_size))
        restarts = settings[1]
        size = max(MIN_POSES_AT_ONCE, int(AT_ONCE / (1.0 + restarts)))
        parts = []
        for first in range(0, len(T), size):
            rows = slice(first, first + size)
            parts.append(Part((T[rows], start[rows], settings, *table), (q[rows], status[rows])))
        with np.errstate(all="ignore"):  # steps near a singularity may overflow; the best iterate counts
            batch_threads.share(kernel or self.kernel, parts)
        return q, status

    @property
    def _no_starts(self) -> tuple[Array, Array]:
        return np.zeros((PLACES, self.model.nq)), np.zeros((len(self.weights), PLACES))

    def start_configurations(self, seed: int) -> _StartConfigurations:
        """Start configurations of a seed; those of the last seed are cached."""
        if seed not in self._starts:
            self._starts = {seed: _StartConfigurations(self, seed)}
        return self._starts[seed]


class _StartConfigurations:
    """Tables of random start configurations, shared by all poses, with the poses of the frames there."""

    def __init__(self, search: PoseSearch, seed: int) -> None:
        self.search, self.rng = search, np.random.default_rng(seed)
        self._firsts: list[Array] = []
        self._tables: list[tuple[Array, Array]] = []

    def first(self, number: int) -> Array:
        """Start configuration that precedes those of a table."""
        self.table(number)
        return self._firsts[number]

    def table(self, number: int) -> tuple[Array, Array]:
        """Configurations (PLACES, nq), and the rows of their poses (12 for each frame, PLACES)."""
        while len(self._tables) <= number:
            count_before = min(1, len(self._tables))  # a start precedes every table but the first
            starts = random_configuration(self.search.model, self.rng, (PLACES + count_before,))
            loops, inside = self.search.loops, self.search.inside
            if loops is None:
                starts = inside(starts)
            else:
                starts = loops.closed_starts(starts, inside)
            q = np.ascontiguousarray(starts[count_before:])
            self._firsts.append(starts[0])
            pose_rows = [poses(q)[:, :3].reshape(PLACES, 12).T for poses in self.search.poses]
            self._tables.append((q, np.ascontiguousarray(np.concatenate(pose_rows))))
        return self._tables[number]


class SinglePose:
    """Fast path for one pose: arrays of plain float64, options validated before.

    One lane searches first, with steps that ignore limits; nearby solutions take a few steps. If it fails, all lanes
    search from the beginning. The result is the same either way.
    """

    def __init__(self, search: PoseSearch, restarts: int, seed: int, tolerances: tuple[float, float]) -> None:
        self.kernel, self.table = search.kernel, search.start_configurations(seed).table(0)
        self.settings = search.settings(tolerances, restarts)
        self.look_settings = search.settings(tolerances, 0, FIRST_LOOK)
        self.start = search.model.neutral
        self.call: Any = make_call(search.look, _NoFallback().reject, "inverse_kinematics")  # None without the builtin

    def near_by(self, T: Array, q0: Array) -> Array | None:
        """Configuration that one lane finds in a few steps without meeting a limit; None otherwise."""
        if self.call is None:
            return None
        solution: tuple[Array, Array] | None = self.call(T, q0, self.look_settings, *self.table)
        if solution is None or not solution[1][OUTCOME] > 0.0:
            return None
        return solution[0]

    def solve(self, T: Any, q0: Any) -> tuple[Array, Array] | None:
        """Return q and the search's status; None if the general search is needed."""
        start = self.start if q0 is None else q0
        solution: tuple[Array, Array] | None = self.call(T, start, self.look_settings, *self.table)
        if solution is None or solution[1][OUTCOME] > 0.0:
            return solution
        with np.errstate(all="ignore"):
            solution = self.kernel(T, start, self.settings, *self.table)
        if solution is None or not solution[1][OUTCOME] >= 0.0:  # NaN too
            return None
        return solution


class _NoFallback:
    """Fallback of the builtin call, which returns None."""

    def reject(self, T: Any, start: Any, settings: Array, starts: Array, poses: Array) -> None:
        """None: the general search follows."""
