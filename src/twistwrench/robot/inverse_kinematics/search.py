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
"""Largest number of steps of the first search for a single pose, in one lane of a vector register.

If it fails, all lanes search, each from another start."""
AT_ONCE = 1 << 18
"""Largest number of starts in one call of the kernel; Ctrl-C takes effect between calls."""
MIN_POSES_AT_ONCE = 64
"""Smallest number of poses in one call, whatever the number of starts."""
Frames = tuple[tuple[str, tuple[int, ...]], ...]
"""Frame names, each with rows of the frame's twist."""

# Columns of a status.
ATTEMPT_COUNT = 0
OUTCOME = 1
"""1 for a pose that was reached, 0 for a pose that was not reached, -1 or NaN for an invalid pose."""
POSE_ERROR = 2
FIRST_ROW = 3
"""First of the errors of the frames' rows; then follow the gaps of the loops, and 1 for each joint held by a limit."""
_TOLERANCE_MARGIN = 1e-9
"""Part by which squared tolerances are reduced, against rounding errors."""


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
        """``farthest`` is the displacement of a frame for one radian of the farthest joint [m]; ``loops`` stay closed.

        ``poses`` has a kernel for each frame, which returns its poses at q. The kernel ``difference`` returns the joint twists
        from one q to another.
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
        single_bodies = [body for body in model.leaders if body.joint.nv == 1]
        self.single_q = np.array([body.q_index for body in single_bodies], int)
        """Indices in q of the joints of one degree of freedom, which alone have limits."""
        single_v = np.array([body.v_index for body in single_bodies], int)
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
        coordinate_of_velocity = np.full(model.nv, -1)  # index in q; -1 for joints of several degrees
        coordinate_of_velocity[single_v] = self.single_q
        self._step = NewtonStep(
            model, frames, scale, lower_by_velocity, upper_by_velocity, tuple(coordinate_of_velocity.tolist()),
            loops=None if loops is None else loops.rows, gaps=() if loops is None else loops.allowed,
        )  # fmt: skip
        search = self._search(self._step)
        self.status_size = search.status.size
        self.kernel = compile_form(search, "inverse_kinematics", f"Search of {model.name} for poses, compiled.")
        weights = []  # of pose entries in the distance of starts
        for _, rows in frames:
            has_angular_row = min(rows, default=3) < 3
            has_linear_row = max(rows, default=0) >= 3
            rotation_weight = float(has_angular_row)
            position_weight = has_linear_row / self.length**2
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
        """Kernel of one lane for one pose, which gives up if a joint meets a limit (``rounds=1``).

        Otherwise its result equals the general kernel's.
        """
        doc = f"Look of {self.model.name} for one pose near by, compiled."
        search = self._search(replace(self._step, rounds=1))
        return compile_form(search, "look", doc, scalar=True)

    @cached_property
    def to_posture(self) -> Any:
        """Kernel that moves from reached poses towards a posture, as near as the poses allow."""
        doc = f"Search of {self.model.name} for postures, compiled."
        search = self._search(replace(self._step, posture=True))
        return compile_form(search, "posture", doc)

    def settings(self, tolerances: tuple[float, float], restarts: int, steps: int = STEPS) -> Array:
        """Input of the kernel with numbers of steps and restarts, squared tolerances and weights."""
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
        """Best configuration (n, nq) of all starts, the first at ``start``, and its status (n, status), for T (n, *core)."""
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
        table_number = 1  # of the next table of starts
        restarts_done = PLACES
        while restarts_done < restarts:  # each run has a first start and those of a table
            unsolved = np.flatnonzero(status[:, OUTCOME] == 0.0)
            if not len(unsolved):
                break
            settings = self.settings(tolerances, min(restarts - restarts_done - 1, PLACES))
            first_start = np.broadcast_to(starts.first(table_number), (len(unsolved), self.model.nq))
            new_q, new_status = self.run(T[unsolved], first_start, starts.table(table_number), settings)
            new_status[:, ATTEMPT_COUNT] += status[unsolved, ATTEMPT_COUNT]
            status[unsolved, ATTEMPT_COUNT] = new_status[:, ATTEMPT_COUNT]  # also of poses that did not improve
            is_nearer = new_status[:, POSE_ERROR] < status[unsolved, POSE_ERROR]
            is_better = (new_status[:, OUTCOME] != 0.0) | is_nearer
            q[unsolved[is_better]] = new_q[is_better]
            status[unsolved[is_better]] = new_status[is_better]
            table_number += 1
            restarts_done += PLACES + 1
        return q, status

    def nearest(
        self, T: Array, posture: Array, solution: tuple[Array, Array], tolerances: tuple[float, float]
    ) -> tuple[Array, Array]:
        """Solutions, as q and status, moved towards postures (n, nq) with the frames fixed, until no step improves."""
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
        is_better = (new_status[:, OUTCOME] > 0.0) & (new_distance < old_distance)
        new_status[:, ATTEMPT_COUNT] = status[solved, ATTEMPT_COUNT]
        q[solved[is_better]] = new_q[is_better]
        status[solved[is_better]] = new_status[is_better]
        return q, status

    def run(
        self, T: Array, start: Array, table: tuple[Array, Array], settings: Array, kernel: Any = None
    ) -> tuple[Array, Array]:
        """Run the general or another ``kernel`` on any number of poses, in parts; returns q and status."""
        q = np.empty((len(T), self.model.nq))
        status = np.empty((len(T), self.status_size))
        _, restarts, *_ = settings
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
        """Start configurations of a seed; the configurations of the last seed are cached."""
        if seed not in self._starts_by_seed:
            self._starts_by_seed = {seed: _StartConfigurations(self, seed)}
        return self._starts_by_seed[seed]


class _StartConfigurations:
    """Tables of random start configurations, shared by all poses, with the poses of the frames there."""

    def __init__(self, search: PoseSearch, seed: int) -> None:
        self.search = search
        self.rng = np.random.default_rng(seed)
        self._first_starts: list[Array] = []
        self._tables: list[tuple[Array, Array]] = []

    def first(self, number: int) -> Array:
        """Start configuration (nq,) before those of a table."""
        self.table(number)  # makes it
        return self._first_starts[number]

    def table(self, number: int) -> tuple[Array, Array]:
        """Configurations (PLACES, nq), and the entries of their poses (12 for each frame, PLACES)."""
        while len(self._tables) <= number:
            count_before = min(1, len(self._tables))  # every table but the first has a start before it
            starts = random_configuration(self.search.model, self.rng, (PLACES + count_before,))
            if self.search.loops is None:
                starts = self.search.inside(starts)
            else:
                starts = self.search.loops.closed_starts(starts, self.search.inside)
            self._first_starts.append(starts[0])
            q = np.ascontiguousarray(starts[count_before:])
            pose_entries = [poses_at(q)[:, :3].reshape(PLACES, 12).T for poses_at in self.search.poses]
            self._tables.append((q, np.ascontiguousarray(np.concatenate(pose_entries))))
        return self._tables[number]


class SinglePose:
    """Fast path for one pose, for arrays of plain float64 and validated options.

    One lane searches first, with steps that ignore limits; nearby solutions take a few steps. If it fails, all lanes
    search from the beginning. Both ways have equal results.
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
        if not status[OUTCOME] > 0.0:  # also for NaN
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
        if solution is None or not solution[1][OUTCOME] >= 0.0:  # also for NaN
            return None
        return solution


class _NoFallback:
    """Fallback of the builtin call, which returns None."""

    def reject(self, T: Any, start: Any, settings: Array, starts: Array, poses: Array) -> None:
        """None: the general search follows."""
