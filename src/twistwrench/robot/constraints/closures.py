"""Constraints of a closed robot: A and projections, scaling, checks, forces on links. Modern Robotics section 8.7."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments, third_party
from ...core.errors import ConstraintError, ConstraintWarning, UnknownNameError
from ...core.glossary import complete
from ...core.numbers import printed
from ...core.typing import Array
from ...mechanics.algorithms.constraints import (
    SINGULAR,
    UNBALANCED,
    Closure,
    Constraint,
    MotionForceSplit,
    Rolling,
    independent_constraints,
    names,
    place_of,
    row_names,
    with_gaps,
)
from ...mechanics.algorithms.kinematics import KINDS
from ...mechanics.algorithms.loop_closure import ConstraintProjector, through, usual_sizes
from ...mechanics.algorithms.operational_space import row_numbers
from ...mechanics.joints import Planar
from ...mechanics.lie.labelled import TWIST
from ...mechanics.model.couplings import refuse_couplings
from ...mechanics.model.model import BASE, Body, Model
from ..arguments import Rows, finite_states

if TYPE_CHECKING:
    from ..robot import Robot
    from .closed_robot import ClosedRobot


@dataclass(frozen=True, eq=False, repr=False)
class ConstrainedRobot:
    """A robot and its constraints: A, its rank, and projections; see :class:`.closed_robot.ClosedRobot`."""

    robot: Robot
    """The same robot with its loops open."""
    constraints: tuple[Constraint, ...] = ()
    """Closures and constraints, in the order of their creation."""
    sizes: Array = field(default_factory=lambda: np.zeros(0))
    """Typical size of each row of A, scaled by the mass matrix; singular values are compared with it."""
    independent: tuple[int, ...] = ()
    """Indices of the rows of A that do not depend on earlier rows."""
    spans: Array = field(default_factory=lambda: np.zeros(0))
    """Scale of each row's gap: 1 rad, or the typical lever of its joints in m, at most 1 m."""

    def __post_init__(self) -> None:
        for array in (self.sizes, self.spans):
            array.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.__post_init__()  # unpickled arrays are writable

    # ── properties ──

    @property
    def nq(self) -> int:
        """Number of coordinates nq of the open robot."""
        return self.robot.nq

    @property
    def nv(self) -> int:
        """Number of velocities nv of the open robot."""
        return self.robot.nv

    @property
    def row_names(self) -> tuple[str, ...]:
        """A name for each row of A and each entry of λ."""
        return row_names(self.constraints)

    @property
    def redundant_rows(self) -> tuple[str, ...]:
        """Rows that depend on the others at every configuration with closed loops."""
        return tuple(name for k, name in enumerate(self.row_names) if k not in self.independent)

    @cached_property
    def _independent_constraints(self) -> tuple[Constraint, ...]:
        """Constraints reduced to their independent rows."""
        return independent_constraints(self.constraints, self.independent)

    # ── A, its rank, and projections ──

    @third_party.by_blocks(lambda closed, _: [(len(closed.sizes), closed.nv)])
    def constraint_jacobian(self, q: ArrayLike) -> Array:
        """Constraint Jacobian A, with A dq = 0.

        Returns
        -------
        A : (k, nv) array, rows as in :attr:`row_names`
        """
        (q,) = finite_states(self.robot.model, "constraint_jacobian", q=q)
        if not self.constraints:
            return np.zeros((*q.shape[:-1], 0, self.nv))
        return np.asarray(self.robot.engine.call("constraint_jacobian", q, constraints=self.constraints))

    @third_party.by_blocks(lambda closed, _: [(len(closed.sizes),)])
    def constraint_bias(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Constraint bias (dA/dt) dq, so that A q̈ + (dA/dt) dq = 0.

        Returns
        -------
        b : (k,) array, rows as in :attr:`row_names` [rad/s², m/s²]
        """
        q, dq = finite_states(self.robot.model, "constraint_bias", q=q, dq=dq)
        if not self.constraints:
            return np.zeros((*np.broadcast_shapes(q.shape[:-1], dq.shape[:-1]), 0))
        return np.asarray(self.robot.engine.call("constraint_bias", q, dq, constraints=self.constraints))

    @third_party.by_blocks(lambda *_: [()], dtype=int)
    def rank(self, q: ArrayLike) -> Array:
        """Rank of A at q: number of independent rows; lower than usual if the configuration is singular.

        Returns
        -------
        count : () array of int
        """
        return self._projector(*finite_states(self.robot.model, "rank", q=q))[1].rank

    @third_party.by_blocks(lambda *_: [()], dtype=int)
    def degrees_of_freedom(self, q: ArrayLike) -> Array:
        """Degrees of freedom at q: nv minus the rank of A.

        Returns
        -------
        count : () array of int
        """
        return self.nv - self.rank(q)

    @third_party.by_blocks(lambda closed, _: [(closed.nv, closed.nv)])
    def projector(self, q: ArrayLike) -> Array:
        """Projector P = 1 - A'(A M⁻¹ A')⁻¹ A M⁻¹, which removes the part of the torques that the constraints bear.

        Its transpose removes the part of velocities that violates the constraints.

        Returns
        -------
        P : (nv, nv) array
        """
        (q,) = finite_states(self.robot.model, "projector", q=q)
        return self._projector(q)[1].projector.astype(q.dtype, copy=False)

    @third_party.by_blocks(lambda closed, _: [(closed.nv,)] * 2, MotionForceSplit)
    def split(self, q: ArrayLike, tau: ArrayLike) -> MotionForceSplit:
        """Torques split into those that move the robot, Pτ, and those that the constraints bear.

        Returns
        -------
        parts : MotionForceSplit, ``motion`` and ``force`` (nv,) [N m, sliding joints: N]
        """
        q, tau = finite_states(self.robot.model, "split", q=q, tau=tau)
        P = self._projector(q)[1].projector
        motion = (P @ tau[..., None])[..., 0].astype(np.result_type(q, tau), copy=False)
        return MotionForceSplit(motion, tau - motion)

    @third_party.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_velocity(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Velocity nearest to dq in the kinetic metric that satisfies A dq = 0: P'dq.

        Returns
        -------
        dq : (nv,) array [rad/s, m/s]
        """
        q, dq = finite_states(self.robot.model, "project_velocity", q=q, dq=dq)
        return self._nearest(q, dq, 0.0)

    @third_party.by_blocks(lambda closed, _: [(closed.nv,)])
    def project_acceleration(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Acceleration nearest to ddq in the kinetic metric that satisfies A q̈ + (dA/dt) dq = 0.

        Returns
        -------
        ddq : (nv,) array [rad/s², m/s²]
        """
        q, dq, ddq = finite_states(self.robot.model, "project_acceleration", q=q, dq=dq, ddq=ddq)
        return self._nearest(q, ddq, self.constraint_bias(q, dq))

    def _projector(self, q: Array) -> tuple[Array, ConstraintProjector]:
        """A at q and its projector, weighted with the mass matrix."""
        A = self.constraint_jacobian(q)
        return A, ConstraintProjector.from_rows(A, self.robot.mass_matrix(q), self.sizes, len(self.independent))

    def _nearest(self, q: Array, v: Array, b: Array | float) -> Array:
        A, projector = self._projector(q)
        return projector.nearest(v, (A @ v[..., None])[..., 0] + b).astype(np.result_type(q, v), copy=False)

    def wrenches(self, lam: ArrayLike) -> dict[str, Array]:
        """Constraint wrenches: λ as wrenches (m, f) that the robot exerts on its constraints.

        The wrench of a closure is exerted by {b} on {a}, at the origin of {b}, along the axes of {c}.

        Parameters
        ----------
        lam : (k,) array_like, λ of :meth:`forward_dynamics` or :meth:`inverse_dynamics` [N m, N]

        Returns
        -------
        wrenches : {name of the constraint: (6,) array} [N m, N]
        """
        lam = arguments.finite(lam, "lam", len(self.sizes))
        found, first = {}, 0
        for name, c in zip(names(self.constraints), self.constraints, strict=True):
            found[name] = np.zeros((*lam.shape[:-1], 6))
            found[name][..., list(c.rows)] = lam[..., first : first + len(c.rows)]
            first += len(c.rows)
        return found


# ── Scaling of constraint rows, and tolerances of gaps and rates

CLOSED = 1e-12
"""rad, and fraction of the robot's length: loops with a smaller gap count as closed; positions round at about 1e-15."""
SHORTEST = 1e-4
"""Fraction of the robot's length: for shorter levers, single-precision rounding errors of positions exceed the largest
allowed gap."""
LONGEST = 1.0
"""m: loops of larger robots are closed to the same absolute gap as those of this size."""
ROUNDED = 4e-3
"""Fraction of a robot's whole length: 1e-12 of it is 18 units in the last place of positions, the smallest tolerance used."""


def row_sizes(closed: ClosedRobot, new: Constraint) -> tuple[Array, Array]:
    """Typical sizes of the rows of A, scaled by the mass matrix, and their spans, with one more constraint appended."""
    sizes, rows = six_sizes(closed.robot, new), list(new.rows)
    length = robot_length(closed.robot.model)
    spans = np.repeat([1.0, np.clip(sizes[3] / sizes[0], SHORTEST * length, LONGEST)], 3)
    return np.concatenate([closed.sizes, sizes[rows]]), np.concatenate([closed.spans, spans[rows]])


def robot_length(model: Model) -> float:
    """Length in m that scales gaps: distance that links can have from the base, at most :data:`LONGEST`."""
    return min(_whole_length(model), LONGEST)


def _whole_length(model: Model) -> float:
    """Sum of the levers along the longest chain with the strokes of sliding joints, in m; scale of rounding errors."""
    reach: list[float] = []
    for body in model.bodies:
        sliding = body.joint.axes[:, 3:].any(axis=1)
        most = 0.0
        if sliding.any():
            k = body.v_index
            way = [max(abs(model.limits.lower[k + n]), abs(model.limits.upper[k + n])) for n in np.flatnonzero(sliding)]
            most = float(sum(x if np.isfinite(x) else LONGEST for x in way))
        before = 0.0 if body.parent == BASE else reach[body.parent]
        reach.append(before + float(np.linalg.norm(body.placement[:3, 3])) + abs(body.ratio) * most)
    frames = [
        (0.0 if f.body == BASE else reach[f.body]) + float(np.linalg.norm(f.pose[:3, 3])) for f in model.frames.values()
    ]
    return max([*reach, *frames], default=0.0) or LONGEST


def gap_length(model: Model) -> float:
    """Length in m that corresponds to a relative gap of 1."""
    return max(robot_length(model), ROUNDED * _whole_length(model))


def gap_units(closed: ClosedRobot) -> Array:
    """Unit of the gap of each position row: 1 rad, or the robot's length in m, or the bound by rounding errors."""
    turning = np.array([k < 3 for c in closed.constraints if isinstance(c, Closure) for k in c.rows], bool)
    return np.where(turning, 1.0, gap_length(closed.robot.model))


def all_rows(constraint: Constraint) -> Constraint:
    """The same constraint with all six rows."""
    return replace(constraint, rows=tuple(range(6)))


def six_sizes(robot: Robot, constraint: Constraint) -> Array:
    """Typical sizes of the six rows of a constraint, scaled by the mass matrix; (6,)."""
    robot.engine.require_invertible()
    some = robot.random_configuration(0, 8)
    J = np.stack([robot.reference("constraint_jacobian", q, constraints=(all_rows(constraint),)) for q in some])
    return usual_sizes(J, robot.mass_matrix(some))


def rate_units(closed: ClosedRobot) -> Array:
    """Unit of the rate of each velocity: 1 rad/s, or the robot's length per second."""
    axes = np.concatenate([np.zeros((0, 6)), *(body.joint.axes for body in closed.robot.model.leaders)])
    return np.where(axes[:, :3].any(axis=1), 1.0, robot_length(closed.robot.model))


# ── Constraint forces as wrenches on the links of the open robot

# With T_cb = (R, p), a closure's λ is the wrench F = (m, f) that {b} applies to {a} at the origin of {b}, along the axes
# of {c}:
#
#     by the robot at {b}:  (R'm, R'f),        by the robot at {a}:  -(R_ac (m + p × f) + p_ac × R_ac f, R_ac f)


def applied(closed: ClosedRobot, q: Array, lam: Array) -> list[tuple[str, Array]]:
    """Pairs (frame, (..., 6)): wrenches by the robot equivalent to λ (..., k) on its links; none for the ground."""
    found: list[tuple[str, Array]] = []
    poses: Iterator[Array] = iter(())
    if any(isinstance(c, Closure) for c in closed.constraints):
        T = closed.robot.engine.call("closure_poses", q, constraints=closed.constraints)
        poses = iter(np.moveaxis(T, -3, 0))
    for name, c in zip(names(closed.constraints), closed.constraints, strict=True):
        F = closed.wrenches(lam)[name]
        if isinstance(c, Rolling):  # at the point and along the axes of the Jacobian's kind
            T = closed.robot.forward_kinematics(q, c.frame)
            F = _moved(np.eye(3), -T[..., :3, 3], F) if c.kind == "space" else F
            found.append((c.frame, F if c.kind == "body" else _turned(np.swapaxes(T[..., :3, :3], -1, -2), F)))
            continue
        T_cb = next(poses)
        R = np.swapaxes(T_cb[..., :3, :3], -1, -2)
        if place_of(closed.robot.model, c.frame_b).body != BASE:
            found.append((c.frame_b, _turned(R, F)))
        if place_of(closed.robot.model, c.frame_a).body != BASE:
            found.append((c.frame_a, -_moved(c.T_ac[:3, :3], c.T_ac[:3, 3], _moved(np.eye(3), T_cb[..., :3, 3], F))))
    return found


def _turned(R: Array, F: Array) -> Array:
    m, f = ((R @ x[..., None])[..., 0] for x in (F[..., :3], F[..., 3:]))
    return np.concatenate([m, f], axis=-1)


def _moved(R: Array, p: Array, F: Array) -> Array:
    """Wrench transformed to another frame, in which the original frame has the pose (R, p)."""
    turned = _turned(R, F)
    return np.concatenate([turned[..., :3] + np.cross(p, turned[..., 3:]), turned[..., 3:]], axis=-1)


# ── Closures and velocity constraints from frames and rows


def closure(model: Model, frame_a: str, frame_b: str, rows: Rows, pose: ArrayLike | None) -> Closure:
    """Closure of :meth:`twistwrench.Robot.close`."""
    refuse_couplings(model, "close")
    frame_a, frame_b = _named(model, frame_a), _named(model, frame_b)
    if place_of(model, frame_a).body == place_of(model, frame_b).body:
        raise ConstraintError(
            f"{frame_a!r} and {frame_b!r} are fixed to one body, so nothing between them can be closed."
        )
    T_ac = np.eye(4) if pose is None else arguments.pose(arguments.one(pose, "pose", 4, 4), "pose")
    return Closure(frame_a, frame_b, row_numbers(rows), tuple(tuple(row) for row in T_ac.tolist()))


def rolling(model: Model, frame: str, rows: Rows, kind: str) -> Rolling:
    """Constraint of :meth:`twistwrench.Robot.constrain`."""
    if kind not in KINDS:
        raise UnknownNameError.from_choices("kind", kind, KINDS)
    refuse_couplings(model, "constrain")
    frame = _named(model, frame)
    if model.frame(frame).body == BASE:
        raise ConstraintError(f"{frame!r} is fixed to the base, so nothing about it can be constrained.")
    return Rolling(frame, row_numbers(rows), kind)


def _named(model: Model, frame: str | None) -> str:
    """Name of the frame, or the tip for None; raises the errors of :meth:`Model.frame`."""
    if frame is None:
        model.frame(None)
        return str(model.tip)
    return frame


# ── Checks: closure, independence of constraints, and states that satisfy them

STARTS = 32
"""Number of random start configurations in the search for closed ones; one in a few converges for common mechanisms."""
FOUND = 1e-10
"""rad, and fraction of the robot's length: gap far below which the row of A equals that of a closed configuration."""
OPEN, ASTRAY = 1e-2, 0.1
"""Largest gap of the loops (rad, and fraction of their span), and largest fraction of a rate that may violate the
constraints, in constrained dynamics. Intermediate stages of an integrator have small errors: gaps grow with the square
of the step, rates with the step."""
STILL = 1e-3
"""rad/s, and fraction of the robot's length per s: slower joints count as at rest. Where a motion reverses, velocities are as
small as integration errors, so that any fraction of them may violate the constraints."""
FADED = 1e-2
"""Rows whose response to a motion is below this fraction of its typical size are near a singular configuration; rounding and
integration errors dominate them."""
NEAR = 0.5
"""Largest displacement (rad and m) at which a closed configuration still counts as near."""


def some_configurations(closed: ClosedRobot, near: ArrayLike | None) -> Array:
    """Configurations with closed loops, found from stored and random ones or from around ``near``; (n, nq)."""
    rng, robot = np.random.default_rng(0), closed.robot
    if near is None:
        known = [robot.add(q, _spread(rng, robot, 4)) for q in robot.model.configurations.values()]
        starts = np.concatenate([*known, robot.random_configuration(rng, STARTS - 1), robot.neutral[None]])
    else:
        q = arguments.one(near, "near", robot.nq, names=robot.coordinate_names)
        starts = robot.add(q, _spread(rng, robot, STARTS))
    q, left = closed.settled(starts, 0.01 * FOUND)
    if not (left <= FOUND).any():
        raise ConstraintError(
            f"no configuration found at which {closed.constraints[-1].name!r} closes: from {len(starts)} starts the nearest "
            f"leaves a gap of {printed(left.min(), 3)} ({_in_units(closed)}). Check pose and rows, or give near=q, one near it."
        )
    return np.asarray(q[left <= FOUND])


def _spread(rng: np.random.Generator, robot: Robot, n: int) -> Array:
    """Random displacements (n, nv) of different size; the first is zero."""
    return np.repeat([0.0, 0.01, 0.1, 0.3], n // 4)[:, None] * rng.standard_normal((n, robot.nv))


def require_angle(closed: ClosedRobot, q: Array) -> None:
    """Raise an error if one angular row is held alone while other axes rotate too: its rate is not the rate of an angle."""
    new, robot = closed.constraints[-1], closed.robot
    turning = [k for k in new.rows if k < 3]
    if not isinstance(new, Closure) or len(turning) != 1:
        return
    J = robot.kernel("constraint_jacobian", constraints=(all_rows(new),))(q)
    others = np.delete(through(J, robot.mass_matrix(q))[:, :3], turning[0], axis=1)
    if np.abs(others).max() > 1e-9 * six_sizes(robot, new)[0]:
        raise ConstraintError(
            f"{new.name}: {TWIST[turning[0]]} is the only row of turning, and {new.frame_b!r} also turns about other axes, "
            "so it is the rate of no angle. Hold two rows of turning (a hinge) or three, or this rate alone with constrain."
        )


def refuse_redundant(closed: ClosedRobot) -> None:
    """Raise ConstraintError that names the dependent rows and an independent choice."""
    new = closed.constraints[-1]
    first = len(closed.sizes) - len(new.rows)
    keep = " ".join(TWIST[new.rows[k - first]] for k in closed.independent if k >= first)
    advice = f"Independent ones are rows={keep!r}: close with these" if keep else "It adds nothing: leave it out"
    raise ConstraintError(
        f"of the {len(new.rows)} rows of {new.name!r} {len(keep.split())} are independent constraints; the others never move, "
        f"or follow from rows before them: {', '.join(closed.redundant_rows)}. {advice}, or with redundant='accept', which "
        "takes the λ of least norm."
    )


def _in_units(closed: ClosedRobot) -> str:
    length = gap_length(closed.robot.model)
    return "rad or m" if length == 1.0 else f"rad, or part of {printed(length, 3)} m"


def require_found(closed: ClosedRobot, left: Array, tolerance: float, batch: tuple[int, ...]) -> None:
    """Raise ConstraintError that names the start with the largest gap of ``left`` (n,), if it exceeds ``tolerance``."""
    if not (left > tolerance).any():
        return
    worst = int(left.argmax())
    raise ConstraintError(
        f"no configuration with closed loops found from here: a gap of {printed(left[worst], 3)} ({_in_units(closed)}) is left"
        f"{_place(worst, batch)}, allowed {printed(tolerance)}. Start nearer to one, or allow more: consistent(q, tolerance=…)."
    )


def warn_of_far(robot: Robot, q: Array, found: Array, within: float) -> None:
    """Warn if a joint moved further than ``within`` from q to ``found`` (..., nq); names the joint that moved furthest."""
    moved = np.abs(robot.subtract(found, q))
    if not (moved > within).any():
        return
    *row, k = np.unravel_index(int(moved.argmax()), moved.shape)
    (joint,) = joints(robot, np.arange(robot.nv) == k)
    warnings.warn(
        f"the closed configuration found is not near: joint {joint!r} moved by {printed(moved.max(), 3)} (rad or m)"
        f"{_in_words(row)}, and {printed(within)} is called near. robot.subtract(found, q) is how far each one went; start "
        "nearer to the configuration meant, or allow more: consistent(q, within=…).",
        ConstraintWarning,
        stacklevel=4,
    )


def warn_of_singular(rank: Array, usual: int) -> None:
    """Warn of states at which the rank of the constraints is lower than usual."""
    if (lost := rank < usual).any():
        warnings.warn(
            f"singular configuration: {lost.sum()} of these states hold the constraints by {rank.min()} "
            f"directions, not {usual}; λ is the one of least norm.",
            ConstraintWarning,
            stacklevel=5,
        )


def _place(flat: int, batch: tuple[int, ...]) -> str:
    return _in_words(np.unravel_index(flat, batch))


def _in_words(row: Iterable[Any]) -> str:
    numbers = ", ".join(map(str, row))
    return f" (row {numbers} of the batch)" if numbers else ""


def require_met(closed: ClosedRobot, q: Array, dq: Array, ddq: Array | None = None) -> None:
    """Raise ConstraintError with the constraint violation of a state, if it is too large."""
    mine = with_gaps(closed.constraints)
    gap, allowed = np.abs(closed.gaps(q)), OPEN * closed.spans[mine]
    if not (gap <= allowed).all():
        *row, k = np.unravel_index(int((gap / allowed).argmax()), gap.shape)
        name = [name for name, has in zip(row_names(closed.constraints), mine, strict=True) if has][k]
        raise ConstraintError(
            f"q leaves loops open by {printed(gap[(*row, k)], 3)} (rad or m) in {name!r}{_in_words(row)}, allowed "
            f"{printed(allowed[k], 3)}: begin with closed.consistent(q)."
        )
    A = closed.constraint_jacobian(q)
    _require_rate(closed, q, "dq", A, dq, np.zeros(1), "closed.project_velocity(q, dq)")
    if ddq is not None:
        bias = closed.constraint_bias(q, dq)
        _require_rate(closed, q, "ddq", A, ddq, bias, "closed.project_acceleration(q, dq, ddq)")


def _require_rate(closed: ClosedRobot, q: Array, name: str, A: Array, v: Array, b: Array, remedy: str) -> None:
    rate = (np.abs((A @ v[..., None])[..., 0] + b) / closed.sizes).max(axis=-1, initial=0.0)
    terms = (np.abs(A) @ (np.abs(v) + STILL * rate_units(closed))[..., None])[..., 0] + np.abs(b)
    usual = (terms / closed.sizes).max(axis=-1, initial=0.0)
    if (rate <= ASTRAY * usual).all():
        return
    # Scaled by the mass matrix, a row of typical size is 1; this is the typical response of rows to such a motion.
    seen = np.sqrt(np.maximum((v * (closed.robot.mass_matrix(q) @ v[..., None])[..., 0]).sum(axis=-1), 0.0))
    usual = np.maximum(usual, FADED * seen)
    if (rate <= ASTRAY * usual).all():
        return
    part = np.divide(rate, usual, out=np.zeros_like(rate), where=usual > 0)
    worst = int(part.argmax())
    raise ConstraintError(
        f"{name} breaks the constraints by {printed(part.flat[worst], 3)} of its size{_place(worst, part.shape)}, "
        f"allowed {printed(ASTRAY)}. Take the nearest that meets them: {remedy}."
    )


def require_made(closed: ClosedRobot, left: Array, f: Array, driven: Array) -> None:
    """Raise an error if residual torques ``left`` (..., n) at joints without motors exceed rounding errors of f (..., nv)."""
    rest = np.abs(left).max(axis=-1, initial=0.0)
    allowed = UNBALANCED * np.abs(f).max(axis=-1, initial=0.0)
    if (rest <= allowed).all():
        return
    worst = int((rest - allowed).argmax())
    idle, moving = (joints(closed.robot, which) for which in (~driven, driven))
    bases = {b.joint.name for b in closed.robot.model.leaders if b.parent == BASE and not b.joint.driven}
    loose = [name for name in idle if name in bases]
    remedy = (
        f"Nothing drives {', '.join(loose)}, and the closures cannot hold it: close with the ground what else holds it, such "
        "as another foot, or give the missing force as wrench_on_robot."
        if loose
        else f"Degrees of freedom: {closed.nv - len(closed.independent)}; name as many joints that move them."
    )
    raise ConstraintError(
        f"joints {', '.join(idle)} have no motor, and no torques at {', '.join(moving) or 'no joint'} make this motion: "
        f"{printed(rest.flat[worst], 3)} N m or N is left over{_place(worst, rest.shape)}. {remedy}"
    )


def require_independent(closed: ClosedRobot, q: Array, driven: Array) -> None:
    """Raise an error unless the joints ``driven`` (nv,) determine all others and match the degrees of freedom in number."""
    free, named = closed.nv - len(closed.independent), int(driven.sum())
    mine = ", ".join(joints(closed.robot, driven)) or "no joint"
    if named != free:
        raise ConstraintError(
            f"{mine}: {named} velocities, and there are {free} degrees of freedom. Name joints of as many velocities, the "
            "independent ones."
        )
    if not closed.independent or not (~driven).any():
        return
    rows = list(closed.independent)
    A = closed.constraint_jacobian(q)[..., rows, :][..., ~driven] / closed.sizes[rows, None]
    sigma = np.linalg.svd(A, compute_uv=False)
    part = sigma[..., -1] / sigma[..., 0]
    if not (part > SINGULAR).all():
        worst = int(np.argmin(part))
        raise ConstraintError(
            f"{mine} do not determine the other joints{_place(worst, part.shape)}: a dead centre, or a singular configuration. "
            "Choose other joints, or go round it."
        )


def driven(robot: Robot, actuated: Iterable[str] | None) -> Array:
    """Mask of the velocities of the named joints (None: all with a motor, see :func:`motor_joints`); (nv,)."""
    leaders = {b.joint.name: b for b in robot.model.leaders}
    names = motor_joints(robot) if actuated is None else [actuated] if isinstance(actuated, str) else list(actuated)
    found = np.zeros(robot.nv, bool)
    for name in names:
        if name not in leaders:
            raise UnknownNameError.from_choices("joint", name, leaders)
        found[leaders[name].v_index : leaders[name].v_index + leaders[name].joint.nv] = True
    return found


def motor_joints(robot: Robot) -> list[str]:
    """Joints that a motor may drive: those of the file's actuators, or all except free joints and a planar base.

    Joints with an actuator of their own are driven in any case. If a follower of a mimic joint is driven, its leader is.
    """
    model = robot.model
    if not model.motor_joints:
        return [b.joint.name for b in model.leaders if b.joint.driven and not _is_planar_base(b)]
    return named_motors(robot)


def named_motors(robot: Robot) -> list[str]:
    """Joints driven by the actuators of the robot's own file or of an actuator file; empty without both."""
    model = robot.model
    at = {b.v_index for b in model.bodies if b.joint.name in model.motor_joints}
    return [b.joint.name for b in model.leaders if b.v_index in at or b.joint.name in robot.actuators]


def _is_planar_base(body: Body) -> bool:
    """True for a base that glides in a plane, such as a cart's: nothing drives it."""
    return body.parent == BASE and isinstance(body.joint, Planar)


def joints(robot: Robot, which: Array) -> list[str]:
    """Joints of the velocities selected by the mask ``which`` (nv,)."""
    names = [b.joint.name for b in robot.model.leaders for _ in range(b.joint.nv)]
    return list(dict.fromkeys(name for name, yes in zip(names, which, strict=True) if yes))


complete(globals())
