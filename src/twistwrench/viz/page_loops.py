"""Loop closures of a page, maintained by its sliders: closed robots, and feet on the floor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import ConstraintError, ValueRangeError
from ..core.numbers import number
from ..core.text import spell_out
from ..core.typing import Array
from ..mechanics.algorithms.constraints import GROUND, Closure, independent_constraints
from ..mechanics.lie import se3
from ..mechanics.model.legs import hanging_base
from ..mechanics.model.model import BASE, Frame, Model
from ..robot import Robot
from ..robot.constraints.closures import some_configurations
from ..robot.constraints.projections import motor_mask, named_motors
from ..robot.constraints.tolerances import joints
from ..shapes.visuals import read_visuals
from ..statics.contacts import Contact
from ..statics.torque_limits import effort_limits
from .starting_pose import clear_of_stops, starting_pose

if TYPE_CHECKING:
    from ..robot.doors import ConstrainedRobot
    from .scene import Scene

FRICTION = 0.6
"""Friction coefficient between feet and floor."""


@dataclass(frozen=True, eq=False)
class PageLoops:
    """Closures of a page and its initial pose, with their header entries."""

    closures: tuple[Closure, ...]
    """Closures reduced to independent rows."""
    start: Array
    """(nq,) initial configuration, with the loops closed."""
    loops: dict[str, Any]
    standing: dict[str, Any] | None = None
    frames: Mapping[str, Frame] = field(default_factory=dict)
    """Frames used by closures that the robot does not have."""
    feet: tuple[int, ...] = ()
    """Indices of the bodies that stand on the floor."""
    remarks: tuple[str, ...] = ()
    """Assumptions for the page's notes."""


# ── Closed robots


def closed_by_file(robot: Robot) -> ConstrainedRobot | None:
    """Robot with the loops of its file closed; None if it has no loops or they cannot be closed."""
    found: Any = robot
    try:
        for closure in robot.closures.values():
            found = found.close(closure.frame_a, closure.frame_b, closure.rows, redundant="accept")
    except ConstraintError:
        return None
    return None if found is robot else found


def loops_of(closed: ConstrainedRobot, q: Array | None, actuated: Iterable[str] | None) -> PageLoops:
    """Loops of a closed robot. Raises ValueRangeError for a constraint on velocities only."""
    if not all(isinstance(c, Closure) for c in closed.constraints):
        raise ValueRangeError(
            f"robot {closed.name!r}: a page closes loops, and some of its constraints hold velocities alone. Show the "
            "robot without them: take robot.open()."
        )
    robot, free = closed.open(), closed.nv - len(closed.independent)
    start = closed.consistent(q) if q is not None else _closed_start(closed)
    able = np.array([body.joint.driven for body in robot.model.leaders for _ in range(body.joint.nv)], bool)
    named = named_motors(robot) if actuated is None else actuated
    motors = motor_mask(robot, named) if named else able & (np.cumsum(able) <= free)
    A = closed.constraint_jacobian(start)[list(closed.independent)]
    dependent = _dependent(A, 1.0 * able + motors)
    remarks: tuple[str, ...] = ()
    if not named:
        motors = able & ~dependent  # as many motors as degrees of freedom
        assumed = ", ".join(joints(robot, motors)) or "none"
        remarks = (f"The file names no motors; assumed: {assumed}. In Python, show(actuated=[…]) names others.",)
    rows = independent_constraints(closed.constraints, closed.independent)
    found = tuple(c for c in rows if isinstance(c, Closure))
    loops = {
        "rows": [list(c.rows) for c in found],
        "dependent": dependent.tolist(),
        "actuated": motors.tolist(),
        "legs": [],
        "base": [],
    }
    return PageLoops(found, start, loops, remarks=remarks)


def _closed_start(closed: ConstrainedRobot) -> Array:
    """Closed configuration within the limits: of several, the one farthest from singular configurations."""
    robot, rows = closed.open(), list(closed.independent)
    Q = some_configurations(closed, None)
    A = closed.constraint_jacobian(Q)[:, rows] / closed.sizes[rows, None]
    outside = robot.limits.exceeded(robot.model.positions(Q)).sum(axis=-1)
    return np.asarray(Q[np.argmax(np.linalg.svd(A, compute_uv=False)[:, -1] - 1e3 * outside)])


def _dependent(A: Array, rank: Array) -> Array:
    """Mask of dependent velocities (nv,) under A (m, nv), with as few as possible of high ``rank``."""
    from scipy.linalg import qr

    order = qr(A * 1e-2**rank, mode="r", pivoting=True)[1]
    return np.isin(np.arange(A.shape[1]), order[: len(A)])


# ── Feet on the floor


def standing_of(robot: Robot, scene: Scene) -> PageLoops | None:
    """Robot with a floating base on its feet (the lowest shapes of its last bodies); None for other robots."""
    model = robot.model
    roots = [k for k, body in enumerate(model.bodies) if body.parent == BASE]
    if len(roots) != 1 or model.bodies[0].joint.nv != 6 or model.nv < 7 or not model.gravity[2] < 0:
        return None
    if np.any(model.gravity[:2]) or any(body.joint.nv != 1 for body in model.leaders if body is not model.bodies[0]):
        return None
    q = starting_pose(robot)
    shapes = _solids(model, scene)
    last = set(shapes) - {body.parent for body in model.bodies}
    poses = scene.body_poses(q)
    low = {k: float((shapes[k] @ poses[k][2, :3] + poses[k][2, 3]).min()) for k in last}
    feet = [k for k in sorted(low) if low[k] < min(low.values()) + 0.08 * scene.size]
    if not feet:
        return None
    start, lift, soles = _stance_on(robot, scene, q, feet, shapes)
    start[model.bodies[0].q_index + 6] += lift
    T = scene.body_poses(start)
    frames, closures = {}, []
    for k, sole in zip(feet, soles, strict=True):
        name = f"sole of {model.bodies[k].link}"
        frames[name] = Frame(k, se3.pose(np.eye(3), sole.mean(axis=0)))
        rows = tuple(range(6)) if len(sole) > 2 else (3, 4, 5)
        closures.append(Closure(GROUND, name, rows, tuple(map(tuple, (T[k] @ frames[name].pose).tolist()))))
    chains = [_chain(model, k) for k in feet]
    legs = sorted({j for chain in chains for j in chain} - set(roots))
    return PageLoops(
        tuple(closures),
        start,
        {"rows": [list(c.rows) for c in closures], "dependent": None, "actuated": None}
        | {"legs": _moved_by(model, legs), "base": _moved_by(model, roots)},
        _standing_data(robot, feet, soles),
        frames,
        tuple(feet),
    )


HELD = "base fixed in the air by the file; with <floating_base=True> the feet carry"
_LEVEL = 1e-3
"""Greatest height of a sole's corner off the floor in a standing pose [m]."""


def held_pose(robot: Robot, scene: Scene) -> tuple[Array, str] | None:
    """Standing pose of a legged robot whose file fixes the base, with a remark; None for other robots.

    Without a standing pose within the limits, the neutral pose, clear of stops, and the reason.
    """
    held = hanging_base(robot.model)
    if held is None:
        return None
    q, shapes = starting_pose(robot), _solids(robot.model, scene)
    feet = [chain[-1] for chain in held.legs if chain[-1] in shapes]
    if len(feet) < len(held.legs) or any(body.joint.nv != 1 for body in robot.model.leaders):
        missing = ", ".join(robot.model.bodies[chain[-1]].link for chain in held.legs if chain[-1] not in shapes)
        why = f"no shape of {missing}" if missing else "joints of several degrees of freedom"
        return q, f"{spell_out(HELD)}; no standing pose found: {why}"
    start, lift, soles = _stance_on(robot, scene, q, feet, shapes)
    T = scene.body_poses(start)
    heights = np.concatenate([sole @ T[k][2, :3] + T[k][2, 3] + lift for k, sole in zip(feet, soles, strict=True)])
    off = float(np.abs(heights).max())
    if off > _LEVEL:
        return (
            q,
            f"{spell_out(HELD)}; no standing pose found: within the limits a foot stays {number(1e3 * off, 2)} mm off the "
            "floor",
        )
    return start, spell_out(HELD)


def _stance_on(
    robot: Robot, scene: Scene, q: Array, feet: Sequence[int], shapes: Mapping[int, Array]
) -> tuple[Array, float, list[Array]]:
    """Configuration near q with the feet on a level floor, the height by which it is above the base frame's, and the soles."""
    flat, start, lift = scene.body_poses(robot.neutral), q, 0.0
    for _ in range(2):  # the contact point of a round foot moves as the foot rotates
        T = scene.body_poses(start)
        soles = [_sole(shapes[k], flat[k], scene.size) for k in feet]
        soles = [
            sole if len(sole) > 2 else _sole(shapes[k], T[k], scene.size) for k, sole in zip(feet, soles, strict=True)
        ]
        start, lift = _stance(robot, scene, start, feet, soles)
    return start, lift, soles


def contacts_of(robot: Robot, standing: Mapping[str, Any]) -> list[Contact]:
    """Contacts of a page header in the form used by ``statics``."""
    links = [body.link for body in robot.model.bodies]
    return [Contact(c["point"], friction=FRICTION, frame=links[c["body"]]) for c in standing["contacts"]]


def _standing_data(robot: Robot, feet: Sequence[int], soles: Sequence[Array]) -> dict[str, Any]:
    try:
        limits = effort_limits(robot)
    except ValueRangeError:  # without limits, joints bear any torque
        limits = effort_limits(robot, np.full(robot.nv, np.inf))
    return {
        "feet": list(feet),
        "contacts": [{"body": k, "point": p.tolist()} for k, sole in zip(feet, soles, strict=True) for p in sole],
        "limits": [limit if np.isfinite(limit) else None for limit in limits.tolist()],
        "friction": FRICTION,
    }


def _chain(model: Model, body: int) -> list[int]:
    found = [body]
    while model.bodies[found[-1]].parent != BASE:
        found.append(model.bodies[found[-1]].parent)
    return found


def _moved_by(model: Model, bodies: Sequence[int]) -> list[bool]:
    mine = {k for b in bodies for k in range(model.nv)[model.bodies[b].places[1]]}
    return [k in mine for k in range(model.nv)]


def _solids(model: Model, scene: Scene) -> dict[int, Array]:
    """Points (n, 3) of each body's collision shapes in its frame, or of its visuals if the file has none."""
    found: dict[int, list[Array]] = {}
    for visual in read_visuals(model, "collision")[0]:
        T = model.frames[visual.link].pose @ visual.pose
        found.setdefault(model.frames[visual.link].body, []).append(visual.surface.placed(T).vertices)
    for shape in scene.shapes:
        if shape.layer == "looks" and shape.body != BASE and shape.body not in found:
            found.setdefault(-2 - shape.body, []).append(shape.surface.placed(shape.pose).vertices)
    return {k if k >= 0 else -2 - k: np.concatenate(parts) for k, parts in found.items()}


def _sole(points: Array, T: Array, size: float) -> Array:
    """Corners (n, 3) of the lowest points of a body at pose T, in its frame: at most four, or one if they are close."""
    placed = points @ T[:3, :3].T
    lowest = np.flatnonzero(placed[:, 2] < placed[:, 2].min() + 2e-3 * size)
    x, y = placed[lowest, 0], placed[lowest, 1]
    if max(np.ptp(x), np.ptp(y)) < 0.04 * size:
        return np.asarray(points[lowest].mean(axis=0, keepdims=True))
    corners = {int(lowest[np.argmax(a * x + b * y)]): None for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))}
    return np.asarray(points[list(corners)])


def _stance(robot: Robot, scene: Scene, q: Array, feet: Sequence[int], soles: Sequence[Array]) -> tuple[Array, float]:
    """Joints (nq,) near q and lift of the robot with all soles on z = 0 and its centre of mass above their middle.

    By damped least squares.
    """
    from scipy.optimize import least_squares

    joints = [body.q_index for body in robot.model.leaders if body.joint.nv == 1]
    low, high = (
        np.concatenate([[end], ends]) for end, ends in zip((-np.inf, np.inf), clear_of_stops(robot), strict=True)
    )
    at = scene.body_poses(q)
    lowest = min(float((sole @ at[k][2, :3] + at[k][2, 3]).min()) for k, sole in zip(feet, soles, strict=True))
    start = np.concatenate([[-lowest], q[joints]])

    def residuals(X: Array) -> Array:
        Q = np.repeat(q[None], len(X), axis=0)
        Q[:, joints] = X[:, 1:]
        T = scene.body_poses(Q)
        places = [
            sole @ np.swapaxes(T[:, k, :3, :3], 1, 2) + T[:, k, None, :3, 3]
            for k, sole in zip(feet, soles, strict=True)
        ]
        points = np.concatenate(places, axis=1)
        middles = np.stack([place[..., :2].mean(axis=1) for place in places], axis=1)
        off = np.asarray(robot.center_of_mass(Q))[:, :2] - middles.mean(axis=1)
        spread = middles - middles.mean(axis=1, keepdims=True)
        heights = 300 * (points[..., 2] + X[:, :1])
        parts = (heights, 10 * off, spread.reshape(len(X), -1), 0.1 * scene.size * (X - start)[:, 1:])
        return np.concatenate(parts, axis=1) / scene.size

    first = residuals(start[None])[0]
    spread = np.arange(len(first)) - (len(first) - len(joints) - 2 * len(feet))
    wanted = np.where((spread >= 0) & (spread < 2 * len(feet)), first, 0.0)

    def off_stance(x: Array) -> Array:
        return np.asarray(residuals(x[None])[0] - wanted)

    def slopes(x: Array) -> Array:
        r = residuals(x + np.vstack([np.zeros(len(x)), 1e-6 * np.eye(len(x))]))
        return (r[1:] - r[0]).T / 1e-6

    x = np.clip(start, low + 1e-9, high - 1e-9)
    found = least_squares(off_stance, x, slopes, bounds=(low, high), max_nfev=60)
    posed = q.copy()
    posed[joints] = found.x[1:]
    return posed, float(found.x[0])
