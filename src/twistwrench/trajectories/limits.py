"""The limits a motion keeps, and where it does not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import arguments
from ..errors import ShapeError, ValueRangeError

if TYPE_CHECKING:
    from ..robot import Robot
    from .trajectory import Trajectory

Array = NDArray[Any]

__all__ = ["Bounds", "Violation", "beyond_positions", "bounds_of", "violations"]


@dataclass(frozen=True, eq=False)
class Bounds:
    """(nv,) each, inf where nothing is limited: rad or m, rad/s, rad/s², N m or N."""

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    effort: Array


@dataclass(frozen=True)
class Violation:
    """A limit that a motion passes, and where it does so most."""

    joint: str
    kind: str
    """``position``, ``velocity``, ``acceleration`` or ``torque``."""
    value: float
    limit: float
    time: float
    """s."""

    @property
    def by(self) -> float:
        """How far beyond, above zero, in the unit of the limit."""
        return abs(self.value - self.limit)

    def __str__(self) -> str:
        return f"{self.joint}: {self.kind} {self.value:.5g} beyond {self.limit:.5g} at {self.time:.4g} s"


def bounds_of(
    robot: Robot,
    *,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    effort: ArrayLike | None = None,
) -> Bounds:
    """The robot's limits with the given ones, (nv,) or one number each, in their places. Raises ShapeError, ValueRangeError."""
    found = {}
    given = {"velocity": velocity, "acceleration": acceleration, "effort": effort}
    own = {"velocity": robot.limits.velocity, "acceleration": np.full(robot.nv, np.inf), "effort": robot.limits.effort}
    for name, values in given.items():
        if values is None:
            found[name] = np.asarray(own[name], float)
            continue
        array = np.asarray(arguments.real(values, name, names=robot.model.velocity_names), float)
        if array.shape not in ((), (robot.nv,)):
            raise ShapeError(
                f"{name} has shape {array.shape}: give one number, or {robot.nv}, one for each of "
                f"{', '.join(robot.model.velocity_names[:12])}."
            )
        if not (array > 0).all():
            raise ValueRangeError(f"{name} has {array[~(array > 0)].flat[0]:g}: a limit is above 0, inf for none.")
        found[name] = np.broadcast_to(array, (robot.nv,)).copy()
    return Bounds(robot.limits.lower, robot.limits.upper, found["velocity"], found["acceleration"], found["effort"])


def violations(
    robot: Robot,
    trajectory: Trajectory,
    bounds: Bounds | None = None,
    *,
    friction: bool = False,
    samples: int = 2001,
    tolerance: float = 1e-6,
) -> tuple[Violation, ...]:
    """The limits that a motion passes by more than ``tolerance`` of them, worst first; looked at at ``samples`` instants.

    >>> import twistwrench as tw
    >>> from twistwrench import trajectories
    >>> arm = tw.robots.ur5()
    >>> hasty = trajectories.move(arm, [0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0], trajectories.cubic(0.3))
    >>> print(violations(arm, hasty)[0])
    shoulder_pan_joint: velocity 5 beyond 3.1416 at 0.15 s
    """
    bounds = bounds_of(robot) if bounds is None else bounds
    t = np.linspace(0.0, trajectory.duration, samples)
    q, dq, ddq = trajectory(t)
    tau = robot.inverse_dynamics(q, dq, ddq, friction=friction)
    names = robot.model.velocity_names
    found = [
        (share, Violation(name, "position", value, limit, float(t[i])))
        for name, value, limit, i, share in beyond_positions(robot, q, bounds, tolerance)
    ]
    for k in range(robot.nv):
        for kind, values, most in (
            ("velocity", dq, bounds.velocity),
            ("acceleration", ddq, bounds.acceleration),
            ("torque", tau, bounds.effort),
        ):
            over = _beyond(values[:, k], -float(most[k]), float(most[k]), tolerance)
            if over is not None:
                value, limit, i, share = over
                found.append((share, Violation(names[k], kind, value, limit, float(t[i]))))
    return tuple(v for _, v in sorted(found, key=lambda item: -item[0]))


def beyond_positions(
    robot: Robot, q: Array, bounds: Bounds, tolerance: float = 1e-6
) -> Iterator[tuple[str, float, float, int, float]]:
    """Joints that some row of q (n, nq) has beyond their positions: name, value, limit, row, and by which part of the limit."""
    for b in robot.model.leaders:
        k = b.v_index
        if b.joint.nv == 1:
            over = _beyond(q[:, b.q_index], float(bounds.lower[k]), float(bounds.upper[k]), tolerance)
            if over is not None:
                yield (b.joint.name, *over)


def _beyond(values: Array, low: float, high: float, tolerance: float) -> tuple[float, float, int, float] | None:
    """The value furthest beyond its limit, the limit, where, and by which part of the larger limit."""
    span = max(abs(x) for x in (low, high, 1e-9) if np.isfinite(x))
    over = np.maximum(values - high, low - values)
    i = int(over.argmax())
    if not over[i] > tolerance * span:
        return None
    return float(values[i]), high if values[i] > high else low, i, float(over[i] / span)
