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
_PREFERENCE_FACTOR = 1e-2
"""Factor of a velocity's column for each unit of its preference."""
_LIMIT_PENALTY = 1e3
"""Penalty for a joint outside its limits, which outweighs any singular value of the scaled Jacobian."""


@dataclass(frozen=True, eq=False)
class PageLoops:
    """Closures of a page and its initial pose, with their header entries."""

    closures: tuple[Closure, ...]
    """Closures reduced to independent rows."""
    start: Array
    """(nq,) initial configuration, with the loops closed."""
    loops: dict[str, Any]
    """Entry of the page's header on the closures."""
    standing: dict[str, Any] | None = None
    """Entry of the header on the feet; None without feet."""
    frames: Mapping[str, Frame] = field(default_factory=dict)
    """Frames used by closures that the robot does not have."""
    feet: tuple[int, ...] = ()
    """Indices of the bodies that stand on the floor."""
    remarks: tuple[str, ...] = ()
    """Assumptions for the page's notes."""


def closed_by_file(robot: Robot) -> ConstrainedRobot | None:
    """Robot with the loops of its file closed; None if it has none, or if they cannot be closed."""
    closed: Any = robot
    try:
        for closure in robot.closures.values():
            closed = closed.close(closure.frame_a, closure.frame_b, closure.rows, redundant="accept")
    except ConstraintError:
        return None
    return None if closed is robot else closed


def loops_of(closed: ConstrainedRobot, q: Array | None, actuated: Iterable[str] | None) -> PageLoops:
    """Loops of a closed robot; raises ValueRangeError if a constraint holds velocities alone."""
    if not all(isinstance(constraint, Closure) for constraint in closed.constraints):
        raise ValueRangeError(
            f"robot {closed.name!r}: a page closes loops, and some of its constraints hold velocities alone. Show the "
            "robot without them: take robot.open()."
        )
    robot = closed.open()
    start = _closed_start(closed) if q is None else closed.consistent(q)
    is_driven = driven_velocities(robot.model)
    motor_names = named_motors(robot) if actuated is None else actuated
    if motor_names:
        is_motor = motor_mask(robot, motor_names)
    else:  # the first driven velocities, as many as degrees of freedom
        freedom_count = closed.nv - len(closed.independent)
        is_motor = is_driven & (np.cumsum(is_driven) <= freedom_count)
    A = closed.constraint_jacobian(start)[list(closed.independent)]
    preference = 1.0 * is_driven + is_motor  # sliders move motors, then other drives
    is_dependent = _dependent_velocities(A, preference)
    remarks: tuple[str, ...] = ()
    if not motor_names:
        is_motor = is_driven & ~is_dependent
        assumed_motors = ", ".join(joints(robot, is_motor)) or "none"
        remarks = (f"The file names no motors; assumed: {assumed_motors}. In Python, show(actuated=[…]) names others.",)
    reduced_constraints = independent_constraints(closed.constraints, closed.independent)
    closures = tuple(constraint for constraint in reduced_constraints if isinstance(constraint, Closure))
    loops = {
        "rows": _rows_of(closures),
        "dependent": is_dependent.tolist(),
        "actuated": is_motor.tolist(),
        "legs": [],
        "base": [],
    }
    return PageLoops(closures, start, loops, remarks=remarks)


def _closed_start(closed: ConstrainedRobot) -> Array:
    """Closed configuration with the fewest joints outside their limits; of several, the farthest from a singular one."""
    robot = closed.open()
    rows = list(closed.independent)
    Q = some_configurations(closed, None)
    A = closed.constraint_jacobian(Q)[:, rows] / closed.sizes[rows, None]
    min_singular_values = np.linalg.svd(A, compute_uv=False)[:, -1]
    is_outside = robot.limits.exceeded(robot.model.positions(Q))
    merit = min_singular_values - _LIMIT_PENALTY * is_outside.sum(axis=-1)
    return np.asarray(Q[np.argmax(merit)])


def _dependent_velocities(A: Array, preference: Array) -> Array:
    """True for dependent velocities (nv,) under A (m, nv); those of high ``preference`` (nv,) are independent if possible."""
    from scipy.linalg import qr

    # Pivoting takes the largest columns first, so columns of high preference are made small.
    _, pivots = qr(A * _PREFERENCE_FACTOR**preference, mode="r", pivoting=True)
    dependent_columns = pivots[: len(A)]
    return np.isin(np.arange(A.shape[1]), dependent_columns)


def _rows_of(closures: Iterable[Closure]) -> list[list[int]]:
    """Indices of the entries of the relative twist that each closure holds at zero."""
    return [list(closure.rows) for closure in closures]


def standing_of(robot: Robot, scene: Scene) -> PageLoops | None:
    """Standing pose and closures of a robot with a floating base, on its feet; None for other robots.

    The feet are those last bodies of the tree whose shapes are lowest.
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
    base_height_index = model.bodies[0].q_index + 6  # z, after the quaternion and x, y
    start[base_height_index] += lift
    T = scene.body_poses(start)
    frames = {}
    closures = []
    for k, sole in zip(feet, soles, strict=True):
        name = f"sole of {model.bodies[k].link}"
        frames[name] = Frame(k, se3.pose(np.eye(3), sole.mean(axis=0)))
        is_flat = len(sole) > 2
        rows = (0, 1, 2, 3, 4, 5) if is_flat else (3, 4, 5)  # an edge or a point may turn
        sole_pose = T[k] @ frames[name].pose
        pose_rows = tuple(map(tuple, sole_pose.tolist()))
        closures.append(Closure(GROUND, name, rows, pose_rows))
    leg_bodies = {body for foot in feet for body in chain_to_base(model, foot)} - {0}  # body 0 is the floating base
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
    has_floating_base = len(roots) == 1 and model.bodies[0].joint.nv == 6
    if not has_floating_base or model.nv < 7:
        return False
    points_down = model.gravity[2] < 0 and not np.any(model.gravity[:2])
    if not points_down:
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
"""Remark on a legged robot whose file fixes the base."""
_MAX_FLOOR_DISTANCE = 1e-3
"""Greatest distance of a sole's corner from the floor in a standing pose [m]."""


def held_pose(robot: Robot, scene: Scene) -> tuple[Array, str] | None:
    """Standing pose of a legged robot whose file fixes the base, with a remark; None for other robots.

    Without a standing pose within the limits, the pose is the neutral one, clear of stops, and the remark has the reason.
    """
    hanging = hanging_base(robot.model)
    if hanging is None:
        return None
    q = starting_pose(robot)
    shapes = _points_of_bodies(robot.model, scene)
    feet = [leg[-1] for leg in hanging.legs]  # the last body of each leg
    shapeless_feet = [robot.model.bodies[foot].link for foot in feet if foot not in shapes]
    if shapeless_feet:
        return q, f"{spell_out(HELD)}; no standing pose found: no shape of {', '.join(shapeless_feet)}"
    if any(body.joint.nv != 1 for body in robot.model.leaders):
        return q, f"{spell_out(HELD)}; no standing pose found: joints of several degrees of freedom"
    start, lift, soles = _stance_and_soles(robot, scene, q, feet, shapes)
    T = scene.body_poses(start)
    floor_distance = 0.0  # largest of a corner above or below the floor [m]
    for k, sole in zip(feet, soles, strict=True):
        heights = _heights(sole, T[k]) + lift
        floor_distance = max(floor_distance, float(np.abs(heights).max()))
    if floor_distance <= _MAX_FLOOR_DISTANCE:
        return start, spell_out(HELD)
    gap = number(1e3 * floor_distance, 2)
    return (
        q,
        f"{spell_out(HELD)}; no standing pose found: within the limits a foot stays {gap} mm off the floor",
    )


def _stance_and_soles(
    robot: Robot, scene: Scene, q: Array, feet: Sequence[int], shapes: Mapping[int, Array]
) -> tuple[Array, float, list[Array]]:
    """Configuration (nq,) near q with the feet on a level floor, lift of the base to this floor [m], and corners of soles."""
    neutral_poses = scene.body_poses(robot.neutral)
    start = q
    lift = 0.0
    for _ in range(2):  # the contact point of a round foot moves as the foot rotates
        poses = scene.body_poses(start)
        soles = []
        for k in feet:
            sole = _sole(shapes[k], neutral_poses[k], scene.size)
            if len(sole) < 3:  # an edge or a point in the neutral pose
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
    """True for the velocities (nv,) of the joints of these bodies."""
    is_selected = np.zeros(model.nv, bool)
    for k in bodies:
        _, dq_indices = model.bodies[k].places
        is_selected[dq_indices] = True
    return is_selected.tolist()


def _points_of_bodies(model: Model, scene: Scene) -> dict[int, Array]:
    """Points (n, 3) of each body's collision shapes in its frame, or of its visuals if the file has none."""
    collision_shapes, _ = read_visuals(model, "collision")
    collisions: dict[int, list[Array]] = {}
    for shape in collision_shapes:
        frame = model.frames[shape.link]
        placed_surface = shape.surface.placed(frame.pose @ shape.pose)
        collisions.setdefault(frame.body, []).append(placed_surface.vertices)
    visuals: dict[int, list[Array]] = {}
    for visual in scene.shapes:
        if visual.layer == "looks" and visual.body != BASE and visual.body not in collisions:
            placed_surface = visual.surface.placed(visual.pose)
            visuals.setdefault(visual.body, []).append(placed_surface.vertices)
    return {body: np.concatenate(parts) for body, parts in (collisions | visuals).items()}


def _sole(points: Array, T: Array, size: float) -> Array:
    """Corners (n, 3) of a body's sole in the body's frame, from its points at pose T.

    The corners are at most four of the lowest points. If these are close together, their mean is the only corner.
    """
    rotated = points @ T[:3, :3].T
    heights = rotated[:, 2]
    lowest = np.flatnonzero(heights < heights.min() + _SOLE_DEPTH * size)
    x, y = rotated[lowest, 0], rotated[lowest, 1]
    if max(np.ptp(x), np.ptp(y)) < _MAX_POINT_FOOT * size:
        return np.asarray(points[lowest].mean(axis=0, keepdims=True))
    farthest = [np.argmax(x + y), np.argmax(x - y), np.argmax(-x - y), np.argmax(y - x)]  # along the four diagonals
    corners = dict.fromkeys(lowest[farthest].tolist())  # each once
    return np.asarray(points[list(corners)])


# Weights of the residuals of a stance; the spread of the feet has the weight 1.
_HEIGHT_WEIGHT = 300.0
_COM_WEIGHT = 10.0
_JOINT_WEIGHT = 0.1
"""Weight of joint angles, which count by the robot's size per radian."""
_DIFFERENCE_STEP = 1e-6
"""Step of forward differences [rad or m]."""
_BOUND_MARGIN = 1e-9
"""Distance of the first unknowns from their bounds [rad or m]."""
_MAX_EVALUATIONS = 60
"""Largest number of evaluations of the search for a stance."""


def _stance(robot: Robot, scene: Scene, q: Array, feet: Sequence[int], soles: Sequence[Array]) -> tuple[Array, float]:
    """Configuration (nq,) near q and lift [m] of the robot, by damped least squares.

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
        parts = (
            _HEIGHT_WEIGHT * heights,
            _COM_WEIGHT * com_error,
            spread.reshape(len(X), -1),
            _JOINT_WEIGHT * scene.size * joint_changes,
        )
        return np.concatenate(parts, axis=1) / scene.size

    # The feet keep their spread, and all other residuals should be zero.
    (residuals_at_start,) = residuals(start[None])
    spread_end = len(residuals_at_start) - len(joints)
    spread_rows = slice(spread_end - 2 * len(feet), spread_end)
    target = np.zeros_like(residuals_at_start)
    target[spread_rows] = residuals_at_start[spread_rows]

    def stance_error(x: Array) -> Array:
        """Residuals (m,) of one stance, minus their targets."""
        return np.asarray(residuals(x[None])[0] - target)

    def jacobian(x: Array) -> Array:
        """Derivatives (m, 1 + joints) of the residuals, by forward differences."""
        steps = _DIFFERENCE_STEP * np.eye(len(x))
        neighbours = x + np.vstack([np.zeros(len(x)), steps])  # x itself, then one step of each unknown
        r = residuals(neighbours)
        return (r[1:] - r[0]).T / _DIFFERENCE_STEP

    inner_start = np.clip(start, low + _BOUND_MARGIN, high - _BOUND_MARGIN)  # least_squares begins inside the bounds
    search = least_squares(stance_error, inner_start, jac=jacobian, bounds=(low, high), max_nfev=_MAX_EVALUATIONS)
    lift, *positions = search.x.tolist()
    stance = q.copy()
    stance[joints] = positions
    return stance, lift
