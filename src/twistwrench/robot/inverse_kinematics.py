"""Inverse kinematics: Newton's method on SE(3), damped, for many poses at once, inside the joints' limits.

The steps are :mod:`..algorithms.newton_step`, and the whole search around them is compiled, samples side by side; a joint
that its limit holds back leaves the step, and comes back when the step leads it inwards. What has not arrived starts again
from other places, those that lead nearest to its pose first: what is found for a pose depends on no other pose of the batch.
All is computed in float64; float32 poses and starts give float32 results, rounded at the end.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.operational_space import row_numbers
from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..lie import se3, so3
from ..model.configuration import random_configuration
from ..program.search import PLACES
from ..typing import Array
from .pose_search import Frames, PoseSearch, SinglePose
from .reached_poses import InverseKinematics, Searched

if TYPE_CHECKING:
    from .robot import Robot
    from .searched_loops import SearchedLoops

Rows = str | Iterable[int | str] | None

NO_LOOP = 1e-6
"""rad, and part of the robot's length: what the search calls closed, and is open by more, is turned over by π."""
MOST_WAYS = 16
"""Sets of options that single poses are looked for with, so many of which are remembered."""


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
    loops: SearchedLoops | None = None,
) -> InverseKinematics:
    """Configurations at which a frame has the pose T; see :meth:`twistwrench.Robot.inverse_kinematics`.

    ``loops`` of a closed robot are to be closed there.
    """
    often, key = robot.engine.single_poses, None
    plain = (frame is None or type(frame) is str) and (rows is None or type(rows) is str) and not nearest
    if plain and loops is None and type(rng) is int and type(restarts) is int and type(angle) is float:
        key = frame, rows, restarts, rng, angle, distance
        if (way := often.get(key)) is not None and (found := way[0].found(T, q0)) is not None:
            return InverseKinematics(found[0], found[1], way[1])
    asked, search, given = _looked_at(robot, frame, rows, restarts, rng, angle, distance, loops)
    core = search.core
    if len(core) == 2 and frame is not None and not isinstance(frame, str):  # a sequence of one name
        target = arguments.real(T, "inverse_kinematics: T", 1, *core)[..., 0, :, :]
    else:
        target = arguments.real(T, "inverse_kinematics: T", *core)
    shape, kind = target.shape[: -len(core)], target.dtype
    if q0 is None:
        start = robot.neutral if loops is None else loops.start
    else:
        start = arguments.finite(q0, "inverse_kinematics: q0", robot.nq, names=robot.coordinate_names)
        kind = np.result_type(kind, start)
    if start.shape[:-1] != shape:
        try:
            shape = np.broadcast_shapes(shape, start.shape[:-1])
        except ValueError:
            raise ShapeError(
                f"inverse_kinematics: T {target.shape} and q0 {start.shape} do not broadcast over their leading axes."
            ) from None
    start = np.broadcast_to(start, (*shape, robot.nq)).reshape(-1, robot.nq)
    poses = np.broadcast_to(_rigid(target) if target.dtype != float else target, (*shape, *core)).reshape(-1, *core)
    q, said = search.best(poses, start, *given)
    odd = ~(said[:, 1] >= 0.0)
    if odd.any():  # no poses, or not to the last digit
        q[odd], said[odd] = search.best(_rigid(target, (*shape, *core)).reshape(-1, *core)[odd], start[odd], *given)
        lost = ~np.isfinite(said[:, 1])
        q[lost], said[lost] = np.nan, np.nan
        said[lost, 0] = 0.0
    elif key is not None and not shape and given[0] <= PLACES:
        if len(often) >= MOST_WAYS and key not in often:
            often.clear()
        alone = SinglePose(search, *given) if key in often else None  # from the second time on
        often[key] = (alone, asked) if alone is not None and alone.call is not None else None
    if nearest:
        q, said = search.nearest(_rigid(poses), start, (q, said), given[2])
    if loops is not None:
        q, said = _on_loops(search, _frames(robot, frame, rows), loops, poses, (q, said))
    q = search.rounded(q.reshape(*shape, robot.nq), kind)
    return InverseKinematics(q, said.reshape(*shape, -1), asked)


def pose_finder(robot: Robot, frame: str | None, left: float) -> Callable[[Array, Array], Array | None]:
    """What finds the configuration near one q at which a frame has one pose, in a few steps that meet no limit, or None."""
    alone = SinglePose(_search(robot, _frames(robot, frame, None)), 0, _drawn(0), (left, left))
    return alone.near_by


def _looked_at(
    robot: Robot, frame: Any, rows: Any, restarts: Any, rng: Any, angle: Any, distance: Any, loops: SearchedLoops | None
) -> tuple[Searched, PoseSearch, tuple[int, int, tuple[float, float]]]:
    """The options, checked: what is asked, who looks for it, and how often, the seed, and what may be left."""
    frames = _frames(robot, frame, rows)
    try:
        again, seed = operator.index(restarts), _seed(rng)
    except (TypeError, ValueError):
        again = seed = -1
    if again < 0:
        raise ValueRangeError(
            f"restarts={arguments.shown(restarts)}, rng={arguments.shown(rng)}: give a whole number of at least 0, and a seed."
        )
    allowed = [arguments.number(x, name) for name, x in (("angle", angle), ("distance", distance))]
    if not all(0 < x < np.inf for x in allowed):
        raise ValueRangeError(
            f"angle={printed(allowed[0])}, distance={printed(allowed[1])}: give what may be left, finite and above 0."
        )
    if robot.nv == 0:
        raise ValueRangeError(
            f"robot {robot.name!r} has no joint that moves, so it reaches one pose only. Lock fewer joints."
        )
    search = _search(robot, frames, loops)
    most = allowed[0], allowed[1] * max(1.0, search.length)
    return (
        Searched(
            robot.model.velocity_names,
            tuple(mine for _, mine in frames),
            0 if loops is None else len(loops.kinds),
        ),
        search,
        (again, seed, most),
    )


def _rigid(target: Array, shape: tuple[int, ...] = ()) -> Array:
    """Poses whose rotations are such to the last digit of float64; raises for what are none."""
    T = np.array(arguments.pose(target, "inverse_kinematics: T"), float)
    T[..., :3, :3] = so3.project(T[..., :3, :3])
    T[..., 3, :] = 0.0, 0.0, 0.0, 1.0
    return np.broadcast_to(T, shape) if shape else T


def _seed(rng: np.random.Generator | int | None) -> int:
    """The seed of the starts: one number drawn from a generator, however long the search."""
    return _drawn(rng) if type(rng) is int and rng >= 0 else int(np.random.default_rng(rng).integers(2**63))


@lru_cache(16)
def _drawn(seed: int) -> int:
    return int(np.random.default_rng(seed).integers(2**63))


def _frames(robot: Robot, frame: Any, rows: Any) -> Frames:
    """The frames by name, each with its rows."""
    several = frame is not None and not isinstance(frame, str)
    given = list(frame) if several else [frame]
    if not given or not all(name is None or isinstance(name, str) for name in given) or (several and None in given):
        raise ValueRangeError(f"frame={frame!r}: give the name of a link, or several, one for each pose.")
    if len(set(given)) < len(given):
        raise ValueRangeError(f"frame={frame!r}: a frame is there twice.")
    if isinstance(rows, Mapping) and not {*rows} <= {*given}:
        raise ValueRangeError(f"rows={rows!r}: its keys are to be frames that were asked for, {given!r}.")
    found = []
    for name in given:
        robot.model.frame(name)
        mine = row_numbers(rows.get(name) if isinstance(rows, Mapping) else rows)
        found.append((str(robot.model.tip if name is None else name), mine))
    return tuple(found)


def _search(robot: Robot, frames: Frames, loops: SearchedLoops | None = None) -> PoseSearch:
    """Made once for each frames and rows of a robot."""

    def made() -> PoseSearch:
        some = random_configuration(robot.model, np.random.default_rng(0), (8,))
        J = np.array([[robot.engine.reference("jacobian", (q,), {"frame": name}) for q in some] for name, _ in frames])
        farthest = float(np.linalg.norm(J[..., 3:, :], axis=-2).max(initial=0.0))
        poses = tuple(robot.engine.kernel(("forward_kinematics",), {"frame": name}) for name, _ in frames)
        return PoseSearch(robot.model, frames, farthest, poses, robot.engine.kernel(("subtract",), {}), loops)

    found: PoseSearch = robot.engine.kept(("inverse kinematics", frames, loops and loops.key), made)
    return found


def _on_loops(
    search: PoseSearch, frames: Frames, loops: SearchedLoops, targets: Array, found: tuple[Array, Array]
) -> tuple[Array, Array]:
    """What was found, q (n, nq) and what is said of it; where poses were not reached, the loops are closed next to it."""
    q, said = found
    some = np.flatnonzero(np.isfinite(q).all(axis=-1))
    count = sum(len(mine) for _, mine in frames)
    gaps = slice(3 + count, 3 + count + len(loops.kinds))
    said[some, gaps], widest = loops.open_by(q[some])
    lost = some[~((said[some, 1] > 0.0) & (widest <= NO_LOOP))]
    said[lost, 1] = 0.0
    near = loops.settled(q[lost])
    fit = (loops.open_by(near)[1] <= NO_LOOP) & (search.inside(near) == near).all(axis=-1)
    rows = lost[fit]
    q[rows] = near[fit]
    said[rows, gaps] = loops.open_by(q[rows])[0]
    each = zip(frames, search.poses, np.moveaxis(targets.reshape(len(q), -1, 4, 4), 1, 0), strict=True)
    if len(rows):
        left = [twist_left(poses(q[rows]), target[rows], mine) for (_, mine), poses, target in each]
        said[rows, 3 : 3 + count] = np.concatenate(left, axis=-1)
    return q, said


def twist_left(T: Array, target: Array, chosen: tuple[int, ...]) -> Array:
    """The body twist V with T exp([V]) = target, MR section 6.2; of some rows, turning and moving each by itself.

    (n, 4, 4), (n, 4, 4) → (n, r).
    """
    R, p = T[:, :3, :3], T[:, :3, 3]
    across = np.swapaxes(R, -1, -2)
    between, way = across @ target[:, :3, :3], (across @ (target[:, :3, 3] - p)[..., None])[..., 0]
    if len(chosen) == 6:
        return np.asarray(se3.log(se3.pose(so3.project(between), way)))
    return np.take(np.concatenate([so3.log(so3.project(between)), way], axis=-1), chosen, axis=1)
