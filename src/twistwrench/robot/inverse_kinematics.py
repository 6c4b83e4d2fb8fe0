"""Inverse kinematics: Newton's method on SE(3), damped, for many poses at once, inside the joints' limits.

The error is the body twist V that leads from where the frame is to where it shall be, T_sb exp([V]) = T_sd, and the step
dq = J'(J J' + λ 1)⁻¹ V. Modern Robotics section 6.2.2; λ proportional to the squared error: Sugihara, "Solvability-unconcerned
inverse kinematics by the Levenberg–Marquardt method", IEEE T-RO 27(5), 2011. A joint that its limit holds back leaves the
step, and comes back when the step leads it inwards. What has not arrived starts again from other places, the same for every
pose: what is found for a pose depends on no other pose of the batch. All is computed in float64; float32 poses and starts
give float32 results, rounded at the end.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.operational_space import row_numbers
from ..core import arguments
from ..errors import ShapeError, ValueRangeError
from ..lie import se3, so3
from ..typing import Array

if TYPE_CHECKING:
    from .robot import Robot

Rows = str | Iterable[int | str] | None

STEPS = 60
"""The most steps from one start."""
RESTARTS = 30
"""How often what has not arrived starts again."""
ANGLE, DISTANCE = 1e-10, 1e-10
"""rad and m, the latter times the robot's size where that is above 1 m: nearer than this is there."""
_LONGEST_STEP = 1.0
_PUSHES = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class InverseKinematics:
    """Result of inverse kinematics: configurations that reach poses, or come as near as was found.

    Leading axes are the poses'.
    """

    q: Array
    """(..., nq): the best configuration found, inside the limits; nan where the pose is."""
    converged: Array
    """(...) of bool: whether it is there to the tolerances, and nothing less counts."""
    angle: Array
    """(...) rad that are left; of a float32 ``q`` before it was rounded to that, as ``distance`` and ``converged``."""
    distance: Array
    """(...) m that are left."""
    starts: Array
    """(...) of int: how many starts it took."""
    held: Array
    """(..., nv) of bool: joints whose limits keep this from coming nearer."""
    joint_names: tuple[str, ...]
    """A name for each entry of ``held``."""
    rows: tuple[int, ...]
    """Rows of the twist that were asked for, 0 to 5."""

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
    frame: str | None = None,
    q0: ArrayLike | None = None,
    *,
    rows: Rows = None,
    restarts: int = RESTARTS,
    rng: np.random.Generator | int | None = 0,
    angle: float = ANGLE,
    distance: float = DISTANCE,
) -> InverseKinematics:
    """Configurations at which a frame has the pose T; see :meth:`twistwrench.Robot.inverse_kinematics`."""
    given_T = arguments.pose(arguments.real(T, "inverse_kinematics: T", 4, 4), "inverse_kinematics: T")
    target, kind = np.asarray(given_T, float), given_T.dtype
    chosen = row_numbers(rows)
    try:
        again = operator.index(restarts)
        seed = np.random.default_rng(rng).integers(2**63)  # one number drawn from a generator, however long the search
    except (TypeError, ValueError):
        again = -1
    if again < 0:
        raise ValueRangeError(f"restarts={restarts!r}, rng={rng!r}: give a whole number of at least 0, and a seed.")
    allowed = [arguments.number(x, name) for name, x in (("angle", angle), ("distance", distance))]
    if not all(0 < x < np.inf for x in allowed):
        raise ValueRangeError(f"angle={angle!r}, distance={distance!r}: give what may be left, finite and above 0.")
    if robot.nv == 0:
        raise ValueRangeError(
            f"robot {robot.name!r} has no joint that moves, so it reaches one pose only. Lock fewer joints."
        )
    search = _Search(robot, frame, chosen, allowed[0], allowed[1])
    shape = target.shape[:-2]
    if q0 is None:
        start = search.inside(np.broadcast_to(robot.neutral, (*shape, robot.nq)))
    else:
        given = arguments.finite(q0, "inverse_kinematics: q0", robot.nq, names=robot.coordinate_names)
        kind = np.result_type(kind, given)
        try:
            shape = np.broadcast_shapes(shape, given.shape[:-1])
        except ValueError:
            raise ShapeError(
                f"inverse_kinematics: T {target.shape} and q0 {given.shape} do not broadcast over their leading axes."
            ) from None
        start = search.inside(np.broadcast_to(given, (*shape, robot.nq)))
    flat_T = np.broadcast_to(target, (*shape, 4, 4)).reshape(-1, 4, 4)
    q, left, held, starts = search.best(flat_T, start.reshape(-1, robot.nq), again, np.random.default_rng(seed))
    turn, way = (x.astype(kind, copy=False).reshape(shape) for x in search.away(left))
    return InverseKinematics(
        search.rounded(q, kind).reshape(*shape, robot.nq),
        search.there(left).reshape(shape),
        turn,
        way,
        starts.reshape(shape),
        held.reshape(*shape, robot.nv),
        robot.model.velocity_names,
        chosen,
    )


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


class _Search:
    """One robot, frame and set of rows."""

    def __init__(self, robot: Robot, frame: str | None, chosen: tuple[int, ...], angle: float, distance: float) -> None:
        self.robot, self.frame, self.chosen = robot, frame, chosen
        robot.model.frame(frame)
        leaders = robot.model.leaders
        one = [b for b in leaders if b.joint.nv == 1]
        self.q_of = np.array([b.q_index for b in one], int)
        self.v_of = np.array([b.v_index for b in one], int)
        self.low, self.high = robot.limits.lower[self.v_of], robot.limits.upper[self.v_of]
        some = robot.jacobian(robot.random_configuration(0, 8), frame)
        size = float(np.linalg.norm(some[:, 3:], axis=1).max(initial=0.0))
        self.length = size if size > 0 else 1.0
        """m that count as much as a radian: what the frame moves per radian of the joint it is farthest from."""
        self.scale = np.array([1.0 if k < 3 else 1.0 / self.length for k in chosen])
        self.angle, self.distance = angle, distance * max(1.0, self.length)

    def inside(self, q: Array) -> Array:
        """q with the joints of one degree of freedom moved into their limits."""
        q = np.array(q, float)
        q[..., self.q_of] = np.clip(q[..., self.q_of], self.low, self.high)
        return q

    def rounded(self, q: Array, kind: np.dtype[Any]) -> Array:
        """q as numbers of another type, those of them that left the limits so brought back to the last ones inside."""
        found = q.astype(kind, copy=False)
        mine = found[..., self.q_of]
        mine = np.where(mine > self.high, np.nextafter(mine, np.asarray(-np.inf, kind)), mine)
        found[..., self.q_of] = np.where(mine < self.low, np.nextafter(mine, np.asarray(np.inf, kind)), mine)
        return found

    def away(self, left: Array) -> tuple[Array, Array]:
        """rad and m of the twists left (n, r)."""
        turn = np.array([k < 3 for k in self.chosen])
        return np.linalg.norm(left[:, turn], axis=1), np.linalg.norm(left[:, ~turn], axis=1)

    def there(self, left: Array) -> Array:
        """Which are within the tolerances."""
        a, d = self.away(left)
        return (a <= self.angle) & (d <= self.distance)

    def left(self, q: Array, target: Array) -> Array:
        """The twists left."""
        return twist_left(np.asarray(self.robot.forward_kinematics(q, self.frame), float), target, self.chosen)

    def best(
        self, target: Array, q: Array, restarts: int, rng: np.random.Generator
    ) -> tuple[Array, Array, Array, Array]:
        """The best configurations, the twists they leave, the joints held, and how many starts it took."""
        n, nv = len(target), self.robot.nv
        best = np.full((n, self.robot.nq), np.nan)
        left, held = np.full((n, len(self.chosen)), np.nan), np.zeros((n, nv), bool)
        starts, cost = np.zeros(n, int), np.full(n, np.inf)
        todo = np.flatnonzero(np.isfinite(target).all(axis=(1, 2)))
        start = q[todo]
        for _ in range(restarts + 1):
            if not len(todo):
                break
            found, e, h = self.descend(target[todo], start)
            starts[todo] += 1
            c = np.linalg.norm(e * self.scale, axis=1)
            better = (c < cost[todo]) | self.there(e)
            at = todo[better]
            best[at], left[at], held[at], cost[at] = found[better], e[better], h[better], c[better]
            todo = todo[~self.there(e)]
            again = self.inside(self.robot.random_configuration(rng))  # one place for all: none depends on the others
            start = np.broadcast_to(again, (len(todo), self.robot.nq))
        return best, left, held, starts

    def descend(self, target: Array, q: Array) -> tuple[Array, Array, Array]:
        """Damped Newton steps from q (n, nq) until there, or until nothing gets nearer; the best of the way."""
        q = q.copy()
        e = self.left(q, target)
        held = np.zeros((len(q), self.robot.nv), bool)
        best, least, kept = q.copy(), e.copy(), held.copy()
        cost = np.linalg.norm(e * self.scale, axis=1)
        idle = np.zeros(len(q), int)
        run = np.flatnonzero(~self.there(e))
        for _ in range(STEPS):
            if not len(run):
                break
            step, at_limit = self.step(q[run], e[run])
            moved = self.robot.add(q[run], step)
            q[run] = self.inside(moved)
            e[run] = self.left(q[run], target[run])
            new = np.linalg.norm(e[run] * self.scale, axis=1)
            idle[run] = np.where(new < 0.99 * cost[run], 0, idle[run] + 1)
            better = new < cost[run]
            at = run[better]
            best[at], least[at], cost[at] = q[at], e[at], new[better]
            kept[run] = at_limit
            run = run[~self.there(e[run]) & (idle[run] < 12)]
        return best, least, np.where(self.there(least)[:, None], False, kept)

    def step(self, q: Array, e: Array) -> tuple[Array, Array]:
        """dq = J'(J J' + λ 1)⁻¹ V without the joints whose limits hold them; (n, nv), and which these are."""
        J = np.take(np.asarray(self.robot.jacobian(q, self.frame), float), self.chosen, axis=1) * self.scale[:, None]
        V = e * self.scale
        damping = (0.5 * (V * V).sum(axis=1) + 1e-14)[:, None, None] * np.eye(len(self.chosen))
        free = np.ones(J.shape[::2], bool)
        at = q[:, self.q_of]
        low, high = at <= self.low + 1e-12, at >= self.high - 1e-12
        dq = np.zeros((len(q), self.robot.nv))
        for _ in range(3):
            F = J * free[:, None, :]
            dq = (np.swapaxes(F, 1, 2) @ np.linalg.solve(F @ np.swapaxes(F, 1, 2) + damping, V[..., None]))[..., 0]
            mine = dq[:, self.v_of]
            out = (low & (mine < -_PUSHES)) | (high & (mine > _PUSHES))
            if not out.any():
                break
            free[:, self.v_of] &= ~out
        longest = np.abs(dq).max(axis=1, keepdims=True)
        return dq * np.minimum(1.0, _LONGEST_STEP / np.maximum(longest, 1e-300)), ~free
