"""Inverse kinematics: Newton's method on SE(3), damped, for many poses at once, inside the joints' limits.

The steps are :mod:`..algorithms.newton_step`, and the whole search around them is compiled, samples side by side; a joint
that its limit holds back leaves the step, and comes back when the step leads it inwards. What has not arrived starts again
from other places, those that lead nearest to its pose first: what is found for a pose depends on no other pose of the batch.
All is computed in float64; float32 poses and starts give float32 results, rounded at the end.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.operational_space import row_numbers
from ..core import arguments
from ..errors import ShapeError, ValueRangeError
from ..lie import se3, so3
from ..model.configuration import random_configuration
from ..program.search import PLACES
from ..typing import Array
from .pose_search import PoseSearch, SinglePose

if TYPE_CHECKING:
    from .robot import Robot

Rows = str | Iterable[int | str] | None

MOST_WAYS = 16
"""Sets of options that single poses are looked for with, so many of which are remembered."""


@dataclass(frozen=True)
class _Asked:
    """What was looked for: all that results have in common."""

    joint_names: tuple[str, ...]
    rows: tuple[int, ...]


@dataclass(eq=False, repr=False, slots=True)  # and not frozen, which takes as long as a step of the search
class InverseKinematics:
    """Result of inverse kinematics: configurations that reach poses, or come as near as was found.

    Leading axes are the poses'.
    """

    q: Array
    """(..., nq): the best configuration found, inside the limits; nan where the pose is."""

    _said: Array
    _asked: _Asked

    @property
    def converged(self) -> Array:
        """(...) of bool: whether it is there to the tolerances, and nothing less counts."""
        return np.asarray(self._said[..., 1] > 0.0)

    @property
    def angle(self) -> Array:
        """(...) rad that are left; of a float32 ``q`` before it was rounded to that, as ``distance`` and ``converged``."""
        return self._length(turning=True)

    @property
    def distance(self) -> Array:
        """(...) m that are left."""
        return self._length(turning=False)

    @property
    def starts(self) -> Array:
        """(...) of int: how many starts it took."""
        return np.asarray(self._said[..., 0].astype(int))

    @property
    def held(self) -> Array:
        """(..., nv) of bool: joints whose limits keep this from coming nearer."""
        held: Array = self._said[..., self._said.shape[-1] - len(self.joint_names) :] > 0.5
        return held & ~self.converged[..., None]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """A name for each entry of ``held``."""
        return self._asked.joint_names

    @property
    def rows(self) -> tuple[int, ...]:
        """Rows of the twist that were asked for, 0 to 5."""
        return self._asked.rows

    def _length(self, *, turning: bool) -> Array:
        """Of the part of the twist that is left."""
        total = np.zeros(self._said.shape[:-1])
        for k, row in enumerate(self.rows):
            if (row < 3) == turning:
                total = total + self._said[..., 3 + k] ** 2
        return np.asarray(np.sqrt(total), self.q.dtype)

    def reason(self, *index: int) -> str:
        """Why a pose was not reached, in words.

        Parameters
        ----------
        *index : int, of the pose in the batch

        Returns
        -------
        text : str, empty where the pose was reached

        Examples
        --------
        >>> import twistwrench as tw
        >>> far = tw.se3.exp([0, 0, 0, 5, 0, 0])
        >>> tw.robots.planar_2r().inverse_kinematics(far, rows="vx vz", restarts=2).reason()[:12]
        'out of reach'
        """
        if bool(self.converged[index]):
            return ""
        d, a = float(self.distance[index]), float(self.angle[index])
        if np.isnan(d) or np.isnan(a):
            return "the pose has entries that are not numbers"
        left = f"the nearest found is {d:.3g} m and {a:.3g} rad away, after {int(self.starts[index])} starts"
        held = [n for n, h in zip(self.joint_names, self.held[index], strict=True) if h]
        if held:
            return f"{', '.join(held)} {'is at its limit' if len(held) == 1 else 'are at their limits'}: {left}"
        return f"out of reach, or of this search: {left}"

    def __repr__(self) -> str:
        return f"<InverseKinematics: {self}>"

    def __str__(self) -> str:
        if self.converged.ndim == 0:
            return f"reached: {self.distance:.2g} m, {self.angle:.2g} rad left" if self.converged else self.reason()
        return f"{int(self.converged.sum())} of {self.converged.size} poses reached"


def solve(
    robot: Robot,
    T: ArrayLike,
    frame: str | None,
    q0: ArrayLike | None,
    rows: Rows,
    restarts: int,
    rng: np.random.Generator | int | None,
    angle: float,
    distance: float,
) -> InverseKinematics:
    """Configurations at which a frame has the pose T; see :meth:`twistwrench.Robot.inverse_kinematics`."""
    often, key = robot.engine.single_poses, None
    if type(rng) is int and type(restarts) is int and type(angle) is float and (rows is None or type(rows) is str):
        key = frame, rows, restarts, rng, angle, distance
        if (way := often.get(key)) is not None and (found := way[0].found(T, q0)) is not None:
            return InverseKinematics(found[0], found[1], way[1])
    target = arguments.real(T, "inverse_kinematics: T", 4, 4)
    asked, search, given = _looked_at(robot, frame, rows, restarts, rng, angle, distance)
    shape, kind, start = target.shape[:-2], target.dtype, robot.neutral
    if q0 is not None:
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
    poses = np.broadcast_to(_rigid(target) if target.dtype != float else target, (*shape, 4, 4)).reshape(-1, 4, 4)
    q, said = search.best(poses, start, *given)
    odd = ~(said[:, 1] >= 0.0)
    if odd.any():  # no poses, or not to the last digit
        q[odd], said[odd] = search.best(_rigid(target, (*shape, 4, 4)).reshape(-1, 4, 4)[odd], start[odd], *given)
        lost = ~np.isfinite(said[:, 1])
        q[lost], said[lost] = np.nan, np.nan
        said[lost, 0] = 0.0
    elif key is not None and not shape and given[0] <= PLACES:
        if len(often) >= MOST_WAYS and key not in often:
            often.clear()
        alone = SinglePose(search, *given) if key in often else None  # from the second time on
        often[key] = (alone, asked) if alone is not None and alone.call is not None else None
    q = search.rounded(q.reshape(*shape, robot.nq), kind)
    return InverseKinematics(q, said.reshape(*shape, -1), asked)


def _looked_at(
    robot: Robot, frame: str | None, rows: Rows, restarts: Any, rng: Any, angle: Any, distance: Any
) -> tuple[_Asked, PoseSearch, tuple[int, int, tuple[float, float]]]:
    """The options, checked: what is asked, who looks for it, and how often, the seed, and what may be left."""
    chosen = row_numbers(rows)
    try:
        again, seed = operator.index(restarts), _seed(rng)
    except (TypeError, ValueError):
        again = seed = -1
    if again < 0:
        raise ValueRangeError(f"restarts={restarts!r}, rng={rng!r}: give a whole number of at least 0, and a seed.")
    allowed = [arguments.number(x, name) for name, x in (("angle", angle), ("distance", distance))]
    if not all(0 < x < np.inf for x in allowed):
        raise ValueRangeError(f"angle={angle!r}, distance={distance!r}: give what may be left, finite and above 0.")
    if robot.nv == 0:
        raise ValueRangeError(
            f"robot {robot.name!r} has no joint that moves, so it reaches one pose only. Lock fewer joints."
        )
    search = _search(robot, frame, chosen)
    most = allowed[0], allowed[1] * max(1.0, search.length)
    return _Asked(robot.model.velocity_names, chosen), search, (again, seed, most)


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


def _search(robot: Robot, frame: str | None, chosen: tuple[int, ...]) -> PoseSearch:
    """Made once for each frame and rows of a robot."""
    robot.model.frame(frame)
    name = robot.model.tip if frame is None else frame

    def made() -> PoseSearch:
        some = random_configuration(robot.model, np.random.default_rng(0), (8,))
        J = np.array([robot.engine.reference("jacobian", (q,), {"frame": name}) for q in some])
        farthest = float(np.linalg.norm(J[:, 3:], axis=1).max(initial=0.0))
        poses = robot.engine.kernel(("forward_kinematics",), {"frame": name})
        return PoseSearch(robot.model, str(name), chosen, farthest, poses)

    found: PoseSearch = robot.engine.kept(("inverse kinematics", name, chosen), made)
    return found


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
