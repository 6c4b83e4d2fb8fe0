"""Inverse kinematics: Newton's method on SE(3), damped, for many poses at once, inside the joints' limits.

The steps are :mod:`..algorithms.newton_step`, compiled, samples side by side; a joint that its limit holds back leaves the
step, and comes back when the step leads it inwards. What has not arrived starts again from other places, those that lead
nearest to its pose first: what is found for a pose depends on no other pose of the batch. All is computed in float64; float32
poses and starts give float32 results, rounded at the end.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..algorithms.newton_step import FAR, NewtonStep
from ..algorithms.operational_space import row_numbers
from ..core import arguments
from ..errors import ShapeError, ValueRangeError
from ..lie import se3, so3
from ..model.configuration import random_configuration
from ..model.model import Model
from ..program.recurrence import Recurrence, Source
from ..program.trace import trace
from ..typing import Array
from .engine import compiled

if TYPE_CHECKING:
    from .robot import Robot

Rows = str | Iterable[int | str] | None

STEPS = 60
"""The most steps from one start."""
RESTARTS = 30
"""How often what has not arrived starts again."""
ANGLE, DISTANCE = 1e-10, 1e-10
"""rad and m, the latter times the robot's size where that is above 1 m: nearer than this is there."""
FEW = 64
"""Poses so many of which go on together, whether they are there or not, for :data:`MANY_STEPS`; more for :data:`FEW_STEPS`."""
FEW_STEPS, MANY_STEPS = 6, 10
AT_ONCE = 1 << 15
"""Poses that are looked for together: the memory of more is bounded, and Ctrl-C is heard between."""
FEWEST_PLACES = 64
"""Random places, at least, of which the nearest are where to start again."""
_HAIR = 1e-9
"""What is there in squares is there by more than rounding."""


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
        again, seed = operator.index(restarts), _seed(rng)
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
    search = _search(robot, frame, chosen)
    most = allowed[0], allowed[1] * max(1.0, search.length)
    shape = target.shape[:-2]
    if q0 is None:
        start = robot.neutral
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
        target, start = np.broadcast_to(target, (*shape, 4, 4)), np.broadcast_to(start, (*shape, robot.nq))
    target, start = target.reshape(-1, 4, 4), search.inside(start).reshape(-1, robot.nq)
    parts = [slice(k, k + AT_ONCE) for k in range(0, max(len(target), 1), AT_ONCE)]
    found = [search.best(target[some], start[some], again, seed, most) for some in parts]

    def whole(what: str, *core: int) -> Array:
        if len(found) > 1:
            return np.concatenate([getattr(part, what) for part in found]).reshape((*shape, *core))
        only: Array = getattr(found[0], what)
        return only.reshape((*shape, *core))

    away = whole("away", 2).astype(kind, copy=False)
    return InverseKinematics(
        search.rounded(whole("q", robot.nq), kind),
        whole("there"),
        away[..., 0],
        away[..., 1],
        whole("starts"),
        whole("held", robot.nv),
        robot.model.velocity_names,
        chosen,
    )


def _seed(rng: np.random.Generator | int | None) -> Callable[[], int]:
    """Gives the seed of the starts: one number drawn from a generator, however long the search."""
    if type(rng) is int and rng >= 0:
        return lambda: _drawn(rng)
    drawn = int(np.random.default_rng(rng).integers(2**63))
    return lambda: drawn


@lru_cache(16)
def _drawn(seed: int) -> int:
    return int(np.random.default_rng(seed).integers(2**63))


def _search(robot: Robot, frame: str | None, chosen: tuple[int, ...]) -> _Search:
    """Made once for each frame and rows of a robot."""
    robot.model.frame(frame)
    name = robot.model.tip if frame is None else frame

    def made() -> _Search:
        some = random_configuration(robot.model, np.random.default_rng(0), (8,))
        J = np.array([robot.engine.reference("jacobian", (q,), {"frame": name}) for q in some])
        farthest = float(np.linalg.norm(J[:, 3:], axis=1).max(initial=0.0))
        poses = robot.engine.kernel(("forward_kinematics",), {"frame": name})
        return _Search(robot.model, str(name), chosen, farthest, poses)

    found: _Search = robot.engine.kept(("inverse kinematics", name, chosen), made)
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


class _Search:
    """What looks for one frame of one robot, and one set of rows: the steps, compiled, and the driver around them."""

    def __init__(self, model: Model, frame: str, chosen: tuple[int, ...], farthest: float, poses: Any) -> None:
        """``farthest``: what the frame moves per radian of the joint it is farthest from [m]; ``poses``: gives those of q."""
        self.model, self.chosen, self.poses = model, chosen, poses
        self._places: dict[tuple[int, int], _Places] = {}
        one = [b for b in model.leaders if b.joint.nv == 1]
        self.q_of, self.v_of = (np.array([getattr(b, name) for b in one], int) for name in ("q_index", "v_index"))
        self.low, self.high = model.limits.lower[self.v_of], model.limits.upper[self.v_of]
        self.length = farthest if farthest > 0 else 1.0
        """m that count as much as a radian."""
        self.scale = np.array([1.0 if k < 3 else 1.0 / self.length for k in chosen])
        self.kinds = np.array([[k < 3, k >= 3] for k in chosen], float)
        low, high = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
        low[self.v_of], high[self.v_of] = self.low, self.high
        self.least, self.most = self.low[np.argsort(self.q_of)], self.high[np.argsort(self.q_of)]
        coordinates = np.full(model.nv, -1)
        coordinates[self.v_of] = self.q_of
        step = NewtonStep(model, frame, chosen, self.scale, low, high, tuple(coordinates.tolist()))
        nq, self.parts = model.nq, np.cumsum(step.sizes).tolist()
        ports = [("angles", (nq,)), ("q", (nq,)), ("passed on", (self.parts[-1],)), ("given", (14,))]
        sources = Source("state", 0), Source("state", 0), Source("state", 1), Source("given")
        steps = Recurrence(trace(step, ports, ["q", "passed on"]), sources, visible=2)
        self.steps = compiled(steps, "inverse_kinematics", f"Steps of {model.name} to poses of {frame}, compiled.")

    def inside(self, q: Array) -> Array:
        """q with the joints of one degree of freedom moved into their limits."""
        q = np.array(q, float)
        if len(self.q_of) == self.model.nq:  # no other joints
            return np.minimum(np.maximum(q, self.least), self.most, out=q)
        q[..., self.q_of] = np.clip(q[..., self.q_of], self.low, self.high)
        return q

    def rounded(self, q: Array, kind: np.dtype[Any]) -> Array:
        """q as numbers of another type, those of them that left the limits so brought back to the last ones inside."""
        found = q.astype(kind, copy=False)
        if kind == q.dtype:
            return found
        mine = found[..., self.q_of]
        mine = np.where(mine > self.high, np.nextafter(mine, np.asarray(-np.inf, kind)), mine)
        found[..., self.q_of] = np.where(mine < self.low, np.nextafter(mine, np.asarray(np.inf, kind)), mine)
        return found

    def best(
        self, target: Array, q: Array, restarts: int, seed: Callable[[], int], allowed: tuple[float, float]
    ) -> _Found:
        """The best of all starts, the first at q."""
        given = np.empty((len(target), 14))
        given[:, :12] = target[:, :3].reshape(-1, 12)
        given[:, 12:] = [(1.0 - _HAIR) * x * x for x in allowed]
        finite = np.asarray(np.isfinite(given).all(axis=1))
        if finite.all():
            passed = self.descend(given, q)
        else:
            passed = np.full((len(q), self.parts[-1]), np.nan)
            passed[finite] = self.descend(given[finite], q[finite])
        found = _Found(self, passed, finite, allowed)
        todo = np.flatnonzero(finite & ~found.there) if restarts and not found.there.all() else ()
        if len(todo):
            places = self.places(max(restarts, FEWEST_PLACES), seed())
            far = places.far(given[todo, :12])
            rows = np.arange(len(todo))
            for _ in range(restarts):
                nearest = np.argmin(far[rows], axis=1)
                far[rows, nearest] = np.inf
                left = found.take(todo[rows], self.descend(given[todo[rows]], places.q[nearest]))
                rows = rows[left]
                if not len(rows):
                    break
        return found

    def places(self, count: int, seed: int) -> _Places:
        """Where to start again; those of the last seed are kept."""
        if (count, seed) not in self._places:
            self._places = {(count, seed): _Places(self, count, seed)}
        return self._places[count, seed]

    def descend(self, given: Array, start: Array) -> Array:
        """Steps from starts (n, nq) until there, or until nothing gets nearer: what the last ones pass on (n, parts)."""
        n, nq, last = len(given), self.model.nq, self.parts[-1]
        q, passed = np.array(start), np.zeros((n, last))
        passed[:, :nq], passed[:, -3:] = q, (FAR, 0.0, 1.0)
        whole, rows, taken = passed, np.arange(n), 0
        while taken < STEPS:
            count = min(MANY_STEPS if taken and len(rows) <= FEW else FEW_STEPS, STEPS - taken)
            same = np.ndarray((len(rows), count, 14), float, given, strides=(given.strides[0], 0, 8))  # at every step
            moved, found = np.empty((len(rows), 1, nq)), np.empty((len(rows), 1, last))
            with np.errstate(all="ignore"):  # next to a singular place a step may go far; the best of the way counts
                self.steps(q, passed, same, out=(moved, found))
            taken += count
            q, passed = moved[:, 0], found[:, 0]
            if len(rows) == n:
                whole = passed
            else:
                whole[rows] = passed
            runs = passed[:, -1] > 0.0
            if not runs.any():
                break
            if not runs.all():
                rows, given, q, passed = rows[runs], given[runs], q[runs], passed[runs]
        return whole


class _Places:
    """Where to start again: random configurations, the same for all, for each pose in the order of how near they lead."""

    def __init__(self, search: _Search, count: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.q = search.inside(random_configuration(search.model, rng, (count,)))
        turning, moving = np.any(search.kinds, axis=0) / np.array([1.0, search.length**2])
        self.weights = np.where(np.arange(12) % 4 < 3, turning, moving)
        self.columns = np.ascontiguousarray(search.poses(self.q)[:, :3].reshape(count, 12).T)

    def far(self, poses: Array) -> Array:
        """How far the places are from poses (n, 12), squared and weighted; (n, places)."""
        found = np.empty((len(poses), len(self.q)))
        for first in range(0, len(poses), 64):  # what stays in the cache
            gap = poses[first : first + 64].T[:, :, None] - self.columns[:, None]
            gap *= gap
            gap *= self.weights[:, None, None]
            gap.sum(axis=0, out=found[first : first + 64])  # a matrix product would round by how many poses there are
        return found


class _Found:
    """The best of all starts so far, a row for each pose."""

    def __init__(self, search: _Search, passed: Array, tried: Array, allowed: tuple[float, float]) -> None:
        """``passed``: what the first start passed on; ``tried``: where there was one."""
        self.search, self.passed, self.allowed = search, passed, allowed
        self.starts = tried.astype(int)
        self.away, self.there = self.judged(passed)

    def judged(self, passed: Array) -> tuple[Array, Array]:
        """rad and m that are left (n, 2), and whether that is allowed."""
        a, b, _, _ = self.search.parts
        left = passed[:, a:b]
        away: Array = np.sqrt((left * left) @ self.search.kinds)
        return away, np.asarray((away <= self.allowed).all(axis=1))

    def take(self, at: Array, passed: Array) -> Array:
        """Keep what another start found better for some poses; which of these are not there yet."""
        away, there = self.judged(passed)
        cost = self.search.parts[2]
        better = there | (passed[:, cost] < self.passed[at, cost])
        self.starts[at] += 1
        if not better.any():
            return ~there
        at = at[better]
        self.passed[at], self.away[at], self.there[at] = passed[better], away[better], there[better]
        return ~there

    @property
    def q(self) -> Array:
        """(n, nq)."""
        return self.passed[:, : self.search.parts[0]]

    @property
    def held(self) -> Array:
        """(n, nv): joints whose limits keep a pose from being reached."""
        _, b, c, _ = self.search.parts
        return (self.passed[:, b:c] > 0.5) & ~self.there[:, None]
