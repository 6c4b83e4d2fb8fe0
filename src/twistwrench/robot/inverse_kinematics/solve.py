"""Inverse kinematics: damped Newton method on SE(3) for batches of poses within the joint limits, and the result."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...compiler.ir.loops import PLACES
from ...core import arguments
from ...core.errors import ShapeError, ValueRangeError
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.algorithms.kinematics import row_numbers
from ...mechanics.lie import se3, so3
from ...mechanics.model.configurations import random_configuration
from .search import ATTEMPT_COUNT, FIRST_ROW, OUTCOME, Frames, PoseSearch, SinglePose

if TYPE_CHECKING:
    from ..constraints.loop_closure_solver import LoopClosureSolver
    from ..robot import Robot

_MIN_REPORTED_GAP = 1e-9
"""Gap (rad or m) above which it is reported with the remaining pose error."""
_SAMPLED_CONFIGURATIONS = 8
"""Number of random configurations at which Jacobians are sampled."""


@dataclass(frozen=True)
class PoseRequest:
    """Inverse-kinematics request: joints, rows of the frames, number of loop rows."""

    joint_names: tuple[str, ...]
    """Name of the joint of each velocity."""
    frames: tuple[tuple[int, ...], ...]
    """Selected rows of each frame."""
    loops: int = 0
    """Number of loop rows to close."""


@dataclass(eq=False, repr=False, slots=True)  # not frozen: creation would take as long as a step of the search
class IKResult:
    """Result of inverse kinematics: for each pose, the configuration that reaches it or the nearest one found.

    The leading axes (...) are those of the poses.
    """

    q: Array
    """(..., nq): best configuration found, inside the limits; nan if the pose is nan."""

    _status: Array
    """Status of each pose by the search; see its columns, such as :data:`OUTCOME`."""
    _request: PoseRequest
    _rejection_reasons: Mapping[tuple[int, ...], str] | None = None
    """Reasons why configurations that reach their poses were rejected, by index of the pose."""

    @property
    def converged(self) -> Array:
        """(...) of bool: True if the pose is reached to the tolerances."""
        return np.asarray(self._status[..., OUTCOME] > 0.0)

    @property
    def angle(self) -> Array:
        """(...) rad, remaining angle. ``angle``, ``distance`` and ``converged`` refer to ``q`` before rounding to float32."""
        return self._remaining_error(angular=True)

    @property
    def distance(self) -> Array:
        """(...) m, remaining distance between the origins of frame and pose, or along the selected rows."""
        return self._remaining_error(angular=False)

    @property
    def gap(self) -> Array:
        """(...) rad or m, largest gap of the loops of a closed robot; zero for an open one."""
        first_gap = FIRST_ROW + len(self.rows)  # column
        gaps = self._status[..., first_gap : first_gap + self._request.loops]
        return np.asarray(np.abs(gaps).max(axis=-1, initial=0.0))

    @property
    def starts(self) -> Array:
        """(...) of int: number of starts used."""
        return np.asarray(self._status[..., ATTEMPT_COUNT].astype(int))

    @property
    def held(self) -> Array:
        """(..., nv) of bool: joints whose limits prevent a smaller error."""
        first_joint = self._status.shape[-1] - len(self.joint_names)  # column
        is_at_limit: Array = self._status[..., first_joint:] > 0.5  # 0.0 or 1.0
        return is_at_limit & ~self.converged[..., None]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Name of each entry of ``held``."""
        return self._request.joint_names

    @property
    def rows(self) -> tuple[int, ...]:
        """Selected rows of the twist, 0 to 5."""
        return tuple(row for rows in self._request.frames for row in rows)

    def _remaining_error(self, *, angular: bool) -> Array:
        """Norm of the remaining angles, or of the distances between the origins, over all frames."""
        sum_of_squares = np.zeros(self._status.shape[:-1])
        column = FIRST_ROW
        for rows in self._request.frames:
            next_column = column + len(rows)
            error = self._status[..., column:next_column]
            column = next_column
            if len(rows) == 6 and not angular:
                # The linear part of a twist with rotation is longer than the distance, so that exp([V]) is needed.
                displacement = se3.exp(error)[..., :3, 3]
                error = np.concatenate([error[..., :3], displacement], axis=-1)
            for k, row in enumerate(rows):
                is_angular = row < 3
                if is_angular == angular:
                    sum_of_squares = sum_of_squares + error[..., k] ** 2
        return np.asarray(np.sqrt(sum_of_squares), self.q.dtype)

    def reason(self, *index: int) -> str:
        """Reason why a pose was not reached, as text.

        Parameters
        ----------
        *index : int, index of the pose in the batch

        Returns
        -------
        text : str, empty if the pose was reached

        Examples
        --------
        >>> import twistwrench as tw
        >>> far = tw.se3.exp([0, 0, 0, 5, 0, 0])
        >>> tw.robots.planar_2r().inverse_kinematics(far, rows="vx vz", restarts=2).reason()[:12]
        'out of reach'
        """
        if bool(self.converged[index]):
            return ""
        if self._rejection_reasons and index in self._rejection_reasons:
            return self._rejection_reasons[index]
        distance = float(self.distance[index])
        angle = float(self.angle[index])
        if np.isnan(distance) or np.isnan(angle):
            return "the pose has entries that are not numbers"
        error_text = f"{printed(distance, 3)} m and {printed(angle, 3)} rad away"
        nearest = f"the nearest found is {error_text}, after {int(self.starts[index])} starts"
        gap = float(self.gap[index])
        if gap > _MIN_REPORTED_GAP:
            nearest += f", with loops open by {printed(gap, 3)} (rad or m)"
        joints_at_limit = list(compress(self.joint_names, self.held[index]))
        if joints_at_limit:
            verb = "is at its limit" if len(joints_at_limit) == 1 else "are at their limits"
            return f"{', '.join(joints_at_limit)} {verb}: {nearest}"
        return f"out of reach, or of this search: {nearest}"

    def __repr__(self) -> str:
        return f"<IKResult: {self}>"

    def __str__(self) -> str:
        if self.converged.ndim > 0:
            return f"{int(self.converged.sum())} of {self.converged.size} poses reached"
        if not self.converged:
            return self.reason()
        return f"reached: {printed(self.distance, 2)} m, {printed(self.angle, 2)} rad left"


def select_poses(result: IKResult, which: Array, q: Array) -> IKResult:
    """Select poses of a batch with one axis, in a given order, with configurations ``q``."""
    return IKResult(q, result._status[which], result._request)


def clear_of_links(
    result: IKResult,
    targets: Array,
    search: Callable[[Array, Array], IKResult],
    clearance: Callable[[Array], Any],
    min_distance: float,
    starts: Array,
) -> IKResult:
    """Result whose solutions keep a distance ``min_distance`` [m] between links.

    A solution with a smaller distance is replaced by the nearest sufficient solution from other ``starts`` (k, nq). A pose
    without a sufficient solution counts as not reached. ``targets`` are the poses, with the leading axes of q. ``search``
    solves one pose from many starts.
    """
    q = result.q.copy()
    status = result._status.copy()
    rejection_reasons: dict[tuple[int, ...], str] = {}
    for entry in np.argwhere(result.converged):
        index = tuple(entry.tolist())
        closest = clearance(q[index])
        if closest.distance >= min_distance:
            continue
        other_results = search(targets[index], starts)
        solutions = np.flatnonzero(other_results.converged)  # indices of the starts
        link_distances = clearance(other_results.q[solutions]).distance
        sufficient = solutions[link_distances >= min_distance]
        status[index][ATTEMPT_COUNT] += len(starts)
        if len(sufficient):
            largest_joint_distances = np.abs(other_results.q[sufficient] - q[index]).max(axis=1)
            nearest = sufficient[largest_joint_distances.argmin()]
            q[index] = other_results.q[nearest]
            status[index][OUTCOME:] = other_results._status[nearest][OUTCOME:]
            continue
        status[index][OUTCOME] = 0.0
        gap_text = f"{printed(closest.distance, 3)} m apart" if closest.distance > 0 else "in contact"
        rejection_reasons[index] = (
            f"reached, but {' and '.join(closest.pair)} are {gap_text} there, and {printed(min_distance)} m are required; "
            f"none of {len(solutions)} other solutions from {len(starts)} starts keeps it"
        )
    return IKResult(q, status, result._request, rejection_reasons)


# Newton steps are in :mod:`..algorithms.newton_step`. The whole search is compiled, with samples side by side. A joint
# at its limit is left out of the steps until a step would move it inwards. Poses not yet reached restart from other
# configurations, the nearest ones first. The result for a pose does not depend on the other poses of the batch.
# Everything is computed in float64; results for float32 poses and starts are rounded at the end.

Rows = str | Iterable[int | str] | None

MAX_LOOP_GAP = 1e-6
"""Largest gap of a closed loop: in rad, or as a fraction of the robot's length. A converged loop with a larger one is flipped
by π."""
MAX_REMEMBERED_OPTIONS = 16
"""Largest number of option sets that are remembered for searches of single poses."""


def solve(
    robot: Robot,
    T: ArrayLike,
    frame: str | Sequence[str] | None,
    q0: ArrayLike | None,
    rows: Rows | Mapping[str, Rows],
    restarts: int,
    rng: np.random.Generator | int | None,
    angle: float,
    distance: float,
    nearest: bool,
    loops: LoopClosureSolver | None = None,
) -> IKResult:
    """Configurations at which a frame has the pose T; see :meth:`twistwrench.Robot.inverse_kinematics`.

    ``loops``: loops of a closed robot to close at the same time.
    """
    # Calls with plain options take a fast path from the third one on; this part takes a large share of its time.
    remembered_searches = robot.engine.single_poses
    memory_key = None
    is_plain = (frame is None or type(frame) is str) and (rows is None or type(rows) is str) and not nearest
    if is_plain and loops is None and type(rng) is int and type(restarts) is int and type(angle) is float:
        memory_key = (frame, rows, restarts, rng, angle, distance)
        remembered = remembered_searches.get(memory_key)
        if remembered is not None:
            single_pose, request = remembered
            solution = single_pose.solve(T, q0)
            if solution is not None:
                q, status = solution
                return IKResult(q, status, request)
    request, search, settings = _checked_request(robot, frame, rows, restarts, rng, angle, distance, loops)
    restart_count, _, tolerances = settings
    target_shape = search.target_shape
    is_list_of_one_frame = len(target_shape) == 2 and frame is not None and not isinstance(frame, str)
    if is_list_of_one_frame:
        target = arguments.real(T, "inverse_kinematics: T", 1, *target_shape)[..., 0, :, :]
    else:
        target = arguments.real(T, "inverse_kinematics: T", *target_shape)
    result_type = target.dtype
    if q0 is None:
        start = robot.neutral
        if loops is not None:
            start = loops.start
    else:
        start = arguments.finite(q0, "inverse_kinematics: q0", robot.nq, names=robot.coordinate_names)
        result_type = np.result_type(result_type, start)
    batch_shape = _batch_shape(target, start, target_shape)
    start = np.broadcast_to(start, (*batch_shape, robot.nq)).reshape(-1, robot.nq)
    exact_target = target if target.dtype == float else _rigid(target)
    poses = np.broadcast_to(exact_target, (*batch_shape, *target_shape)).reshape(-1, *target_shape)
    q, status = search.best(poses, start, *settings)
    is_unsolved = ~(status[:, OUTCOME] >= 0.0)  # NaN too
    if is_unsolved.any():  # these poses are not rigid, or not to the last digit
        rigid_poses = _rigid(target, (*batch_shape, *target_shape)).reshape(-1, *target_shape)
        q[is_unsolved], status[is_unsolved] = search.best(rigid_poses[is_unsolved], start[is_unsolved], *settings)
        _erase_invalid(q, status)
    elif memory_key is not None and not batch_shape and restart_count <= PLACES:
        _remember_search(remembered_searches, memory_key, search, settings, request)
    if nearest:
        q, status = search.nearest(_rigid(poses), start, (q, status), tolerances)
    if loops is not None:
        q, status = _close_loops(search, _frames(robot, frame, rows), loops, poses, (q, status))
    q = search.round_to_type(q.reshape(*batch_shape, robot.nq), result_type)
    return IKResult(q, status.reshape(*batch_shape, -1), request)


def _erase_invalid(q: Array, status: Array) -> None:
    """Fill the rows of poses that are not valid with NaN, in place; their number of attempts is 0."""
    is_invalid = ~np.isfinite(status[:, OUTCOME])
    q[is_invalid] = np.nan
    status[is_invalid] = np.nan
    status[is_invalid, ATTEMPT_COUNT] = 0.0


def _remember_search(
    remembered_searches: dict[Any, Any], key: Any, search: PoseSearch, settings: tuple[int, int, tuple[float, float]],
    request: PoseRequest,
) -> None:  # fmt: skip
    """Remember the options of a call for one pose; at the second call with them also the fast path, if there is one."""
    if len(remembered_searches) >= MAX_REMEMBERED_OPTIONS and key not in remembered_searches:
        remembered_searches.clear()
    fast_path = None
    if key in remembered_searches:
        single_pose = SinglePose(search, *settings)
        if single_pose.call is not None:
            fast_path = (single_pose, request)
    remembered_searches[key] = fast_path


def _batch_shape(target: Array, start: Array, target_shape: tuple[int, ...]) -> tuple[int, ...]:
    """Common leading axes of poses (..., *target_shape) and start configurations (..., nq); raises ShapeError."""
    target_batch = target.shape[: -len(target_shape)]
    start_batch = start.shape[:-1]
    if start_batch == target_batch:
        return target_batch
    try:
        return np.broadcast_shapes(target_batch, start_batch)
    except ValueError:
        raise ShapeError(
            f"inverse_kinematics: T {target.shape} and q0 {start.shape} do not broadcast over their leading axes."
        ) from None


def pose_finder(robot: Robot, frame: str | None, tolerance: float) -> Callable[[Array, Array], Array | None]:
    """Function (T, q) that returns the configuration near q at the pose T.

    It returns None if the search takes more than a few steps or meets a limit.
    """
    search = _search(robot, _frames(robot, frame, None))
    return SinglePose(search, 0, _draw_seed(0), (tolerance, tolerance)).near_by


def _checked_request(
    robot: Robot,
    frame: Any,
    rows: Any,
    restarts: Any,
    rng: Any,
    angle: Any,
    distance: Any,
    loops: LoopClosureSolver | None,
) -> tuple[PoseRequest, PoseSearch, tuple[int, int, tuple[float, float]]]:
    """Validate the options; returns the request, its search, and (restarts, seed, tolerances)."""
    frames = _frames(robot, frame, rows)
    try:
        restart_count = operator.index(restarts)
        if type(rng) is int and rng >= 0:
            seed = _draw_seed(rng)
        else:
            seed = int(np.random.default_rng(rng).integers(2**63))
    except (TypeError, ValueError):
        restart_count = seed = -1  # raises the error below
    if restart_count < 0:
        raise ValueRangeError(
            f"restarts={arguments.value_text(restarts)}, rng={arguments.value_text(rng)}: give a whole number of at least 0, "
            "and a seed."
        )
    angle = arguments.number(angle, "angle")
    distance = arguments.number(distance, "distance")
    if not (0 < angle < np.inf and 0 < distance < np.inf):
        raise ValueRangeError(
            f"angle={printed(angle)}, distance={printed(distance)}: give what may be left, finite and above 0."
        )
    if robot.nv == 0:
        raise ValueRangeError(
            f"robot {robot.name!r} has no joint that moves, so it reaches one pose only. Lock fewer joints."
        )
    search = _search(robot, frames, loops)
    loop_row_count = 0 if loops is None else len(loops.kinds)
    rows_by_frame = tuple(own_rows for _, own_rows in frames)
    request = PoseRequest(robot.model.velocity_names, rows_by_frame, loop_row_count)
    tolerances = (angle, distance * max(1.0, search.length))  # large robots: relative to their length
    return request, search, (restart_count, seed, tolerances)


def _rigid(target: Array, shape: tuple[int, ...] = ()) -> Array:
    """Poses with rotations that are orthonormal in float64, broadcast to a ``shape`` if it is given; raises for non-poses."""
    T = np.array(arguments.pose(target, "inverse_kinematics: T"), float)
    T[..., :3, :3] = so3.project(T[..., :3, :3])
    T[..., 3, :] = [0.0, 0.0, 0.0, 1.0]
    return np.broadcast_to(T, shape) if shape else T


@lru_cache(16)
def _draw_seed(seed: int) -> int:
    """Seed of the starts: one number drawn from the generator, independent of the length of the search."""
    return int(np.random.default_rng(seed).integers(2**63))


def _frames(robot: Robot, frame: Any, rows: Any) -> Frames:
    """Frames by name, each with its rows."""
    is_single = frame is None or isinstance(frame, str)
    names = [frame] if is_single else list(frame)
    are_texts = is_single or all(isinstance(name, str) for name in names)
    if not names or not are_texts:
        raise ValueRangeError(f"frame={frame!r}: give the name of a link, or several, one for each pose.")
    if len(set(names)) < len(names):
        raise ValueRangeError(f"frame={frame!r}: a frame is there twice.")
    if isinstance(rows, Mapping) and not {*rows} <= {*names}:
        raise ValueRangeError(f"rows={rows!r}: its keys must be among the given frames, {names!r}.")
    frames = []
    for name in names:
        robot.model.frame(name)  # raises an error for an unknown name
        rows_of_frame = rows.get(name) if isinstance(rows, Mapping) else rows
        known_name = robot.model.tip if name is None else name
        frames.append((str(known_name), row_numbers(rows_of_frame)))
    return tuple(frames)


def _search(robot: Robot, frames: Frames, loops: LoopClosureSolver | None = None) -> PoseSearch:
    """Search of a robot for the given frames and rows, created once and cached."""

    def sample_jacobians(frame: str) -> list[Array]:
        """Jacobians of a frame at random configurations."""
        samples = random_configuration(robot.model, np.random.default_rng(0), (_SAMPLED_CONFIGURATIONS,))
        return [robot.engine.reference("jacobian", (q,), {"frame": frame}) for q in samples]

    def build() -> PoseSearch:
        J = np.array([sample_jacobians(name) for name, _ in frames])
        J_v = J[..., 3:, :]
        levers = np.linalg.norm(J_v, axis=-2)  # displacement per radian or metre of a joint
        largest_lever = float(levers.max(initial=0.0))
        pose_kernels = tuple(robot.engine.kernel(("forward_kinematics",), {"frame": name}) for name, _ in frames)
        subtract = robot.engine.kernel(("subtract",), {})
        return PoseSearch(robot.model, frames, largest_lever, pose_kernels, subtract, loops)

    loops_key = None if loops is None else loops.key
    search: PoseSearch = robot.engine.cache(("inverse kinematics", frames, loops_key), build)
    return search


def _close_loops(
    search: PoseSearch, frames: Frames, loops: LoopClosureSolver, targets: Array, solution: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Close the loops near configurations q (n, nq) whose poses were not reached; returns q and the search's status.

    ``solution`` has both before; its arrays are overwritten.
    """
    q, status = solution
    finite_indices = np.flatnonzero(np.isfinite(q).all(axis=-1))
    row_count = sum(len(own_rows) for _, own_rows in frames)
    row_columns = slice(FIRST_ROW, FIRST_ROW + row_count)
    gap_columns = slice(row_columns.stop, row_columns.stop + len(loops.kinds))
    status[finite_indices, gap_columns], largest_gaps = loops.search_gaps(q[finite_indices])
    is_reached = (status[finite_indices, OUTCOME] > 0.0) & (largest_gaps <= MAX_LOOP_GAP)
    failed_indices = finite_indices[~is_reached]
    status[failed_indices, OUTCOME] = 0.0
    q_closed = loops.close(q[failed_indices])
    _, largest_gaps = loops.search_gaps(q_closed)
    is_inside = (search.inside(q_closed) == q_closed).all(axis=-1)
    is_usable = (largest_gaps <= MAX_LOOP_GAP) & is_inside
    closed_indices = failed_indices[is_usable]
    q[closed_indices] = q_closed[is_usable]
    status[closed_indices, gap_columns], _ = loops.search_gaps(q[closed_indices])
    if len(closed_indices):
        frame_targets = np.moveaxis(targets.reshape(len(q), -1, 4, 4), 1, 0)
        errors = []
        for (_, own_rows), pose_kernel, target in zip(frames, search.poses, frame_targets, strict=True):
            T = pose_kernel(q[closed_indices])
            errors.append(twist_left(T, target[closed_indices], own_rows))
        status[closed_indices, row_columns] = np.concatenate(errors, axis=-1)
    return q, status


def twist_left(T: Array, target: Array, rows: tuple[int, ...]) -> Array:
    """Body twist V with T exp([V]) = target, MR section 6.2; (n, 4, 4), (n, 4, 4) → (n, number of rows).

    If fewer than six rows are selected, they are rows of the rotation vector and the displacement instead.
    """
    R, p = T[:, :3, :3], T[:, :3, 3]
    R_inverse = np.swapaxes(R, -1, -2)
    rotation = so3.project(R_inverse @ target[:, :3, :3])
    displacement = (R_inverse @ (target[:, :3, 3] - p)[..., None])[..., 0]
    if len(rows) == 6:
        return np.asarray(se3.log(se3.pose(rotation, displacement)))
    all_rows = np.concatenate([so3.log(rotation), displacement], axis=-1)
    return np.take(all_rows, rows, axis=1)
