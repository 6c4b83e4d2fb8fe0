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
        self._starts_by_seed: dict[int, _StartConfigurations] = {}
        self.length = farthest if farthest > 0 else 1.0
        """Length in m that is weighted like one radian."""
        error_rows: list[int] = []  # rows of twists: below 3 angular, from 3 on linear
        for _, rows in frames:
            error_rows += rows
        if loops is not None:
            error_rows += loops.kinds
        scale = np.where(np.array(error_rows) < 3, 1.0, 1.0 / self.length)
        single = [body for body in model.leaders if body.joint.nv == 1]
        self.single_q = np.array([body.q_index for body in single], int)
        """Coordinates of the joints of one degree of freedom, which alone have limits."""
        single_v = np.array([body.v_index for body in single], int)
        self.lower = model.limits.lower[single_v]
        self.upper = model.limits.upper[single_v]
        lower_by_velocity = np.full(model.nv, -np.inf)
        upper_by_velocity = np.full(model.nv, np.inf)
        lower_by_velocity[single_v] = self.lower
        upper_by_velocity[single_v] = self.upper
        self._lower_by_coordinate = np.full(model.nq, -np.inf)
        self._upper_by_coordinate = np.full(model.nq, np.inf)
        self._lower_by_coordinate[self.single_q] = self.lower
        self._upper_by_coordinate[self.single_q] = self.upper
        coordinates = np.full(model.nv, -1)  # coordinate of each velocity; -1 for joints of several degrees
        coordinates[single_v] = self.single_q
        self._step = NewtonStep(
            model, frames, scale, lower_by_velocity, upper_by_velocity, tuple(coordinates.tolist()),
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
        """Loop of the compiled search over one step."""
        nq = self.model.nq
        pose_count = len(self.poses)
        target = TensorSpec("T", self.target_shape)
        if step.posture:
            target = TensorSpec("T and posture", (16 * pose_count + nq,))
        given_size = target.size + 2  # and the two tolerances
        inputs = [("angles", (nq,)), ("q", (nq,)), ("passed on", (sum(step.sizes),)), ("given", (given_size,))]
        program = trace(step, inputs, ["q", "passed on"])
        entries_by_pose = np.arange(16 * pose_count).reshape(pose_count, 16)
        compared = entries_by_pose[:, :12]  # entries (R, p) of each pose, without the last row
        return Search(
            program,
            target,
            tuple(compared.ravel().tolist()),
            step.begins,
            tuple(self._lower_by_coordinate.tolist()),
            tuple(self._upper_by_coordinate.tolist()),
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
        factor = 1.0 - _TOLERANCE_MARGIN
        return np.array([steps, restarts, factor * angle * angle, factor * distance * distance, *self.weights])

    def inside(self, q: Array) -> Array:
        """q with joints of one degree of freedom clipped to their limits."""
        q = np.array(q, float)
        q[..., self.single_q] = np.clip(q[..., self.single_q], self.lower, self.upper)
        return q

    def round_to_type(self, q: Array, dtype: np.dtype[Any]) -> Array:
        """q rounded to another type; numbers that leave the limits by rounding are moved to the nearest value inside."""
        rounded = q.astype(dtype, copy=False)
        if dtype == q.dtype:
            return rounded
        x = rounded[..., self.single_q]
        next_below = np.nextafter(x, np.asarray(-np.inf, dtype))
        x = np.where(x > self.upper, next_below, x)
        next_above = np.nextafter(x, np.asarray(np.inf, dtype))
        rounded[..., self.single_q] = np.where(x < self.lower, next_above, x)
        return rounded

    def best(
        self, T: Array, start: Array, restarts: int, seed: int, tolerances: tuple[float, float]
    ) -> tuple[Array, Array]:
        """Best result of all starts (n, nq), the first at ``start``, and its status (n, status); T (n, *core)."""
        settings = self.settings(tolerances, min(restarts, PLACES))
        if seed not in self._starts_by_seed:  # the start table takes longer than most searches, which need none
            q, status = self.run(T, start, self._no_starts, self.settings(tolerances, 0))
            unsolved = np.flatnonzero(status[:, OUTCOME] == 0.0)
            if not restarts or not len(unsolved):
                return q, status
            table = self.start_configurations(seed).table(0)
            q[unsolved], status[unsolved] = self.run(T[unsolved], start[unsolved], table, settings)
        else:
            q, status = self.run(T, start, self.start_configurations(seed).table(0), settings)
        starts = self.start_configurations(seed)
        number = 1  # of the next table of starts
        restarts_done = PLACES
        while restarts_done < restarts:  # a start before those of a table, then the table's
            unsolved = np.flatnonzero(status[:, OUTCOME] == 0.0)
            if not len(unsolved):
                break
            settings = self.settings(tolerances, min(restarts - restarts_done - 1, PLACES))
            first = np.broadcast_to(starts.first(number), (len(unsolved), self.model.nq))
            new_q, new_status = self.run(T[unsolved], first, starts.table(number), settings)
            new_status[:, ATTEMPT_COUNT] += status[unsolved, ATTEMPT_COUNT]
            status[unsolved, ATTEMPT_COUNT] = new_status[:, ATTEMPT_COUNT]  # also of poses that did not improve
            is_nearer = new_status[:, POSE_ERROR] < status[unsolved, POSE_ERROR]
            improved = (new_status[:, OUTCOME] != 0.0) | is_nearer
            q[unsolved[improved]] = new_q[improved]
            status[unsolved[improved]] = new_status[improved]
            number += 1
            restarts_done += PLACES + 1
        return q, status

    def nearest(
        self, T: Array, posture: Array, solution: tuple[Array, Array], tolerances: tuple[float, float]
    ) -> tuple[Array, Array]:
        """Move solutions towards postures (n, nq) with the frames fixed, until no step improves."""
        q, status = solution
        solved = np.flatnonzero(status[:, OUTCOME] > 0.0)
        no_starts = self._no_starts
        settings = self.settings(tolerances, 0, POSTURE_STEPS)
        pose_entries = T[solved].reshape(len(solved), 16 * len(self.poses))
        target = np.concatenate([pose_entries, posture[solved]], axis=1)
        near_q, _ = self.run(target, q[solved], no_starts, settings, self.to_posture)
        new_q, new_status = self.run(T[solved], near_q, no_starts, settings)  # to full precision
        old_distance = np.linalg.norm(self.difference(posture[solved], q[solved]), axis=1)
        new_distance = np.linalg.norm(self.difference(posture[solved], new_q), axis=1)
        improved = (new_status[:, OUTCOME] > 0.0) & (new_distance < old_distance)
        new_status[:, ATTEMPT_COUNT] = status[solved, ATTEMPT_COUNT]
        q[solved[improved]] = new_q[improved]
        status[solved[improved]] = new_status[improved]
        return q, status

    def run(
        self, T: Array, start: Array, table: tuple[Array, Array], settings: Array, kernel: Any = None
    ) -> tuple[Array, Array]:
        """Run the kernel, or another one, on any number of poses, in parts."""
        q = np.empty((len(T), self.model.nq))
        status = np.empty((len(T), self.status_size))
        restarts = settings[1]
        part_size = max(MIN_POSES_AT_ONCE, int(AT_ONCE / (1.0 + restarts)))
        parts = []
        for first in range(0, len(T), part_size):
            rows = slice(first, first + part_size)
            parts.append(Part((T[rows], start[rows], settings, *table), (q[rows], status[rows])))
        with np.errstate(all="ignore"):  # steps near a singularity may overflow; the best iterate counts
            batch_threads.share(kernel or self.kernel, parts)
        return q, status

    @property
    def _no_starts(self) -> tuple[Array, Array]:
        """Table of starts for a search without restarts, which reads none."""
        return np.zeros((PLACES, self.model.nq)), np.zeros((len(self.weights), PLACES))

    def start_configurations(self, seed: int) -> _StartConfigurations:
        """Start configurations of a seed; those of the last seed are cached."""
        if seed not in self._starts_by_seed:
            self._starts_by_seed = {seed: _StartConfigurations(self, seed)}
        return self._starts_by_seed[seed]


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
            if self.search.loops is None:
                starts = self.search.inside(starts)
            else:
                starts = self.search.loops.closed_starts(starts, self.search.inside)
            self._firsts.append(starts[0])
            q = np.ascontiguousarray(starts[count_before:])
            pose_rows = [poses_at(q)[:, :3].reshape(PLACES, 12).T for poses_at in self.search.poses]
            self._tables.append((q, np.ascontiguousarray(np.concatenate(pose_rows))))
        return self._tables[number]


class SinglePose:
    """Fast path for one pose: arrays of plain float64, options validated before.

    One lane searches first, with steps that ignore limits; nearby solutions take a few steps. If it fails, all lanes
    search from the beginning. The result is the same either way.
    """

    def __init__(self, search: PoseSearch, restarts: int, seed: int, tolerances: tuple[float, float]) -> None:
        self.kernel = search.kernel
        self.table = search.start_configurations(seed).table(0)
        self.settings = search.settings(tolerances, restarts)
        self.look_settings = search.settings(tolerances, 0, FIRST_LOOK)
        self.start = search.model.neutral
        self.call: Any = make_call(search.look, _NoFallback().reject, "inverse_kinematics")  # None without the builtin

    def near_by(self, T: Array, q0: Array) -> Array | None:
        """Configuration that one lane finds in a few steps without meeting a limit; None otherwise."""
        if self.call is None:
            return None
        solution: tuple[Array, Array] | None = self.call(T, q0, self.look_settings, *self.table)
        if solution is None:
            return None
        q, status = solution
        if not status[OUTCOME] > 0.0:  # NaN too
            return None
        return q

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
