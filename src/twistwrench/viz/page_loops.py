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
from ..robot.constraints.drives import motor_mask, named_motors
from ..robot.constraints.states import joints
from ..shapes.visuals import read_visuals
from ..statics.contacts import Contact
from ..statics.torque_limits import effort_limits
from .page_programs import driven_velocities, last_bodies
from .sliders import finite_or_none
from .starting_pose import chain_to_base, clear_of_stops, single_joints, starting_pose

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


def closed_by_file(robot: Robot) -> ConstrainedRobot | None:
    """Robot with the loops of its file closed; None if it has no loops or they cannot be closed."""
    closed: Any = robot
    try:
        for closure in robot.closures.values():
            closed = closed.close(closure.frame_a, closure.frame_b, closure.rows, redundant="accept")
    except ConstraintError:
        return None
    return None if closed is robot else closed


def loops_of(closed: ConstrainedRobot, q: Array | None, actuated: Iterable[str] | None) -> PageLoops:
    """Loops of a closed robot; raises ValueRangeError if a constraint holds velocities alone."""
    if not all(isinstance(c, Closure) for c in closed.constraints):
        raise ValueRangeError(
            f"robot {closed.name!r}: a page closes loops, and some of its constraints hold velocities alone. Show the "
            "robot without them: take robot.open()."
        )
    robot = closed.open()
    start = _closed_start(closed) if q is None else closed.consistent(q)
    driven = driven_velocities(robot.model)
    motor_names = named_motors(robot) if actuated is None else actuated
    if motor_names:
        motors = motor_mask(robot, motor_names)
    else:  # as many motors as degrees of freedom
        motors = driven & (np.cumsum(driven) <= closed.nv - len(closed.independent))
    A = closed.constraint_jacobian(start)[list(closed.independent)]
    dependent = _dependent_velocities(A, 1.0 * driven + motors)  # sliders move motors, then other drives
    remarks: tuple[str, ...] = ()
    if not motor_names:
        motors = driven & ~dependent
        assumed = ", ".join(joints(robot, motors)) or "none"
        remarks = (f"The file names no motors; assumed: {assumed}. In Python, show(actuated=[…]) names others.",)
    rows = independent_constraints(closed.constraints, closed.independent)
    closures = tuple(constraint for constraint in rows if isinstance(constraint, Closure))
    loops = {
        "rows": _rows_of(closures),
        "dependent": dependent.tolist(),
        "actuated": motors.tolist(),
        "legs": [],
        "base": [],
    }
    return PageLoops(closures, start, loops, remarks=remarks)


def _closed_start(closed: ConstrainedRobot) -> Array:
    """Closed configuration with the fewest joints outside their limits; among these, the one farthest from singular ones."""
    robot = closed.open()
    rows = list(closed.independent)
    Q = some_configurations(closed, None)
    A = closed.constraint_jacobian(Q)[:, rows] / closed.sizes[rows, None]
    min_singular_values = np.linalg.svd(A, compute_uv=False)[:, -1]
    exceeded_limits = robot.limits.exceeded(robot.model.positions(Q)).sum(axis=-1)
    merit = min_singular_values - 1e3 * exceeded_limits  # a limit outweighs any singular value
    return np.asarray(Q[np.argmax(merit)])


def _dependent_velocities(A: Array, rank: Array) -> Array:
    """Mask of dependent velocities (nv,) under A (m, nv); velocities of high ``rank`` (nv,) are independent if possible."""
    from scipy.linalg import qr

    # Pivoting takes the largest columns first, so columns of high rank are made small.
    _, pivots = qr(A * 1e-2**rank, mode="r", pivoting=True)
    return np.isin(np.arange(A.shape[1]), pivots[: len(A)])


def _rows_of(closures: Iterable[Closure]) -> list[list[int]]:
    """Rows of the twist that each closure holds at zero."""
    return [list(closure.rows) for closure in closures]


def standing_of(robot: Robot, scene: Scene) -> PageLoops | None:
    """Standing pose and closures of a robot with a floating base, on its feet; None for other robots.

    Its feet are the last bodies with the lowest shapes.
    """
    model = robot.model
    if not _may_stand(model):
        return None
    q = starting_pose(robot)
    shapes = _points_of_bodies(model, scene)
    feet = _lowest_last_bodies(model, scene, q, shapes)
    if not feet:
        return None
    start, lift, soles = _stance_and_soles(robot, scene, q, feet, shapes)
    start[model.bodies[0].q_index + 6] += lift
    T = scene.body_poses(start)
    frames = {}
    closures = []
    for k, sole in zip(feet, soles, strict=True):
        name = f"sole of {model.bodies[k].link}"
        frames[name] = Frame(k, se3.pose(np.eye(3), sole.mean(axis=0)))
        rows = (0, 1, 2, 3, 4, 5) if len(sole) > 2 else (3, 4, 5)  # an edge or a point may turn
        sole_pose = T[k] @ frames[name].pose
        closures.append(Closure(GROUND, name, rows, tuple(map(tuple, sole_pose.tolist()))))
    leg_bodies = {body for foot in feet for body in chain_to_base(model, foot)} - {0}
    loops = {
        "rows": _rows_of(closures),
        "dependent": None,
        "actuated": None,
        "legs": _velocity_mask(model, leg_bodies),
        "base": _velocity_mask(model, {0}),
    }
    standing = _standing_data(robot, feet, soles)
    return PageLoops(tuple(closures), start, loops, standing, frames, tuple(feet))


def _may_stand(model: Model) -> bool:
    """True for one floating base with joints of one degree of freedom, under gravity along −z."""
    roots = [k for k, body in enumerate(model.bodies) if body.parent == BASE]
    if len(roots) != 1 or model.bodies[0].joint.nv != 6 or model.nv < 7:
        return False
    if not model.gravity[2] < 0 or np.any(model.gravity[:2]):
        return False
    return all(body.joint.nv == 1 for body in model.leaders if body is not model.bodies[0])


def _lowest_last_bodies(model: Model, scene: Scene, q: Array, shapes: Mapping[int, Array]) -> list[int]:
    """Last bodies whose lowest points are about as low as the lowest of all."""
    poses = scene.body_poses(q)
    heights = {k: _lowest_height(shapes[k], poses[k]) for k in sorted(last_bodies(model) & shapes.keys())}
    max_height = min(heights.values(), default=0.0) + _MAX_FOOT_HEIGHT * scene.size
    return [k for k, height in heights.items() if height < max_height]


def _heights(points: Array, T: Array) -> Array:
    """Heights (n,) of points (n, 3) of a body at pose T."""
    return np.asarray(points @ T[2, :3] + T[2, 3])


def _lowest_height(points: Array, T: Array) -> float:
    """Height of the lowest point of a body at pose T."""
    return float(_heights(points, T).min())


_SOLE_DEPTH = 2e-3
"""Height over a foot's lowest point up to which points are of its sole, as a share of the robot's size."""
_MAX_POINT_FOOT = 0.04
"""Width of a sole up to which it is one point, as a share of the robot's size."""
_MAX_FOOT_HEIGHT = 0.08
"""Greatest height of a foot over the lowest foot in the starting pose, as a share of the robot's size."""
HELD = "base fixed in the air by the file; with <floating_base=True> the feet carry"
_MAX_HEIGHT = 1e-3
"""Greatest height of a sole's corner off the floor in a standing pose [m]."""


def held_pose(robot: Robot, scene: Scene) -> tuple[Array, str] | None:
    """Standing pose of a legged robot whose file fixes the base, with a remark; None for other robots.

    If no standing pose is within the limits, the pose is the neutral one, clear of stops, and the remark has the reason.
    """
    hanging = hanging_base(robot.model)
    if hanging is None:
        return None
    q = starting_pose(robot)
    shapes = _points_of_bodies(robot.model, scene)
    feet = [leg[-1] for leg in hanging.legs]
    missing = [robot.model.bodies[foot].link for foot in feet if foot not in shapes]  # without a shape
    if missing:
        return q, f"{spell_out(HELD)}; no standing pose found: no shape of {', '.join(missing)}"
    if any(body.joint.nv != 1 for body in robot.model.leaders):
        return q, f"{spell_out(HELD)}; no standing pose found: joints of several degrees of freedom"
    start, lift, soles = _stance_and_soles(robot, scene, q, feet, shapes)
    T = scene.body_poses(start)
    max_height = 0.0  # of a corner above or below the floor
    for k, sole in zip(feet, soles, strict=True):
        max_height = max(max_height, float(np.abs(_heights(sole, T[k]) + lift).max()))
    if max_height <= _MAX_HEIGHT:
        return start, spell_out(HELD)
    gap = number(1e3 * max_height, 2)
    return (
        q,
        f"{spell_out(HELD)}; no standing pose found: within the limits a foot stays {gap} mm off the floor",
    )


def _stance_and_soles(
    robot: Robot, scene: Scene, q: Array, feet: Sequence[int], shapes: Mapping[int, Array]
) -> tuple[Array, float, list[Array]]:
    """Configuration (nq,) near q with the feet on a level floor, lift of the base to this floor, and soles of the feet."""
    neutral_poses = scene.body_poses(robot.neutral)
    start = q
    lift = 0.0
    for _ in range(2):  # the contact point of a round foot moves as the foot rotates
        poses = scene.body_poses(start)
        soles = []
        for k in feet:
            sole = _sole(shapes[k], neutral_poses[k], scene.size)
            if len(sole) < 3:  # not flat in the neutral pose
                sole = _sole(shapes[k], poses[k], scene.size)
            soles.append(sole)
        start, lift = _stance(robot, scene, start, feet, soles)
    return start, lift, soles


def contacts_of(robot: Robot, standing: Mapping[str, Any]) -> list[Contact]:
    """Contacts of a page header in the form used by ``statics``."""
    contacts = []
    for contact in standing["contacts"]:
        link = robot.model.bodies[contact["body"]].link
        contacts.append(Contact(contact["point"], friction=FRICTION, frame=link))
    return contacts


def _standing_data(robot: Robot, feet: Sequence[int], soles: Sequence[Array]) -> dict[str, Any]:
    """Header entry of the feet: contacts, torque limits and friction."""
    try:
        limits = effort_limits(robot)
    except ValueRangeError:  # without limits, joints bear any torque
        limits = effort_limits(robot, np.full(robot.nv, np.inf))
    contacts = []
    for k, sole in zip(feet, soles, strict=True):
        contacts += [{"body": k, "point": point} for point in sole.tolist()]
    return {
        "feet": list(feet),
        "contacts": contacts,
        "limits": list(map(finite_or_none, limits.tolist())),
        "friction": FRICTION,
    }


def _velocity_mask(model: Model, bodies: Iterable[int]) -> list[bool]:
    """Mask (nv,) of the velocities of the joints of some bodies."""
    mask = np.zeros(model.nv, bool)
    for k in bodies:
        mask[model.bodies[k].places[1]] = True
    return mask.tolist()


def _points_of_bodies(model: Model, scene: Scene) -> dict[int, Array]:
    """Points (n, 3) of each body's collision shapes in its frame, or of its visuals if the file has none."""
    collisions: dict[int, list[Array]] = {}
    for visual in read_visuals(model, "collision")[0]:
        frame = model.frames[visual.link]
        collisions.setdefault(frame.body, []).append(visual.surface.placed(frame.pose @ visual.pose).vertices)
    visuals: dict[int, list[Array]] = {}
    for shape in scene.shapes:
        if shape.layer == "looks" and shape.body != BASE and shape.body not in collisions:
            visuals.setdefault(shape.body, []).append(shape.surface.placed(shape.pose).vertices)
    return {body: np.concatenate(parts) for body, parts in (collisions | visuals).items()}


def _sole(points: Array, T: Array, size: float) -> Array:
    """Corners (n, 3) of the lowest points of a body at pose T, in its frame: at most four, or their mean if they are close."""
    rotated = points @ T[:3, :3].T
    lowest = np.flatnonzero(rotated[:, 2] < rotated[:, 2].min() + _SOLE_DEPTH * size)
    x, y = rotated[lowest, 0], rotated[lowest, 1]
    if max(np.ptp(x), np.ptp(y)) < _MAX_POINT_FOOT * size:
        return np.asarray(points[lowest].mean(axis=0, keepdims=True))
    farthest = [np.argmax(x + y), np.argmax(x - y), np.argmax(-x - y), np.argmax(y - x)]
    corners = dict.fromkeys(lowest[farthest].tolist())
    return np.asarray(points[list(corners)])


def _stance(robot: Robot, scene: Scene, q: Array, feet: Sequence[int], soles: Sequence[Array]) -> tuple[Array, float]:
    """Configuration (nq,) near q and lift of the robot, by damped least squares.

    All soles are on z = 0, and the centre of mass is above the mean of their middles. The unknowns X are the lift and the
    positions of the joints.
    """
    from scipy.optimize import least_squares

    joints = [body.q_index for body in single_joints(robot.model)]
    lower, upper = clear_of_stops(robot)
    low = np.concatenate([[-np.inf], lower])
    high = np.concatenate([[np.inf], upper])
    poses = scene.body_poses(q)
    min_height = min(_lowest_height(sole, poses[k]) for k, sole in zip(feet, soles, strict=True))
    start = np.concatenate([[-min_height], q[joints]])

    def residuals(X: Array) -> Array:
        """Residuals (n, m) at unknowns (n, 1 + joints): of heights, centre of mass, spread of the feet, and joints."""
        Q = np.repeat(q[None], len(X), axis=0)
        Q[:, joints] = X[:, 1:]
        T = scene.body_poses(Q)
        corners_by_foot = []
        for k, sole in zip(feet, soles, strict=True):
            corners_by_foot.append(sole @ np.swapaxes(T[:, k, :3, :3], 1, 2) + T[:, k, None, :3, 3])
        corners = np.concatenate(corners_by_foot, axis=1)
        middles = np.stack([foot_corners[..., :2].mean(axis=1) for foot_corners in corners_by_foot], axis=1)
        com_error = np.asarray(robot.center_of_mass(Q))[:, :2] - middles.mean(axis=1)
        spread = middles - middles.mean(axis=1, keepdims=True)
        heights = corners[..., 2] + X[:, :1]
        joint_changes = (X - start)[:, 1:]
        parts = (300 * heights, 10 * com_error, spread.reshape(len(X), -1), 0.1 * scene.size * joint_changes)
        return np.concatenate(parts, axis=1) / scene.size

    # The feet keep their spread, and all other residuals should be zero.
    residuals_at_start = residuals(start[None])[0]
    row_of_spread = np.arange(len(residuals_at_start)) - (len(residuals_at_start) - len(joints) - 2 * len(feet))
    is_spread = (row_of_spread >= 0) & (row_of_spread < 2 * len(feet))
    target = np.where(is_spread, residuals_at_start, 0.0)

    def stance_error(x: Array) -> Array:
        return np.asarray(residuals(x[None])[0] - target)

    def jacobian(x: Array) -> Array:
        step = 1e-6
        r = residuals(x + np.vstack([np.zeros(len(x)), step * np.eye(len(x))]))
        return (r[1:] - r[0]).T / step

    inner_start = np.clip(start, low + 1e-9, high - 1e-9)  # least_squares begins inside the bounds
    solution = least_squares(stance_error, inner_start, jacobian, bounds=(low, high), max_nfev=60).x
    stance = q.copy()
    stance[joints] = solution[1:]
    return stance, float(solution[0])
