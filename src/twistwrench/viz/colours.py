"""Colours, marks and arrows shared by all views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.colours import COLOURS as MEANINGS
from ..core.colours import NEAR_LIMIT, Style
from ..core.typing import Array
from ..mechanics.lie import se3, so3
from . import style
from .scene import Scene, turned_z

if TYPE_CHECKING:
    from ..mechanics.model.model import Model
    from ..robot import Robot

_STEP_WIDTH = 1e-3
"""Width of the change from one colour to the next, as a share of a limit."""
SHARES = (
    (0.0, MEANINGS[Style.QUIET].scene),
    (NEAR_LIMIT, MEANINGS[Style.QUIET].scene),
    (NEAR_LIMIT + _STEP_WIDTH, MEANINGS[Style.NEAR].scene),
    (1.0, MEANINGS[Style.NEAR].scene),
    (1.0 + _STEP_WIDTH, MEANINGS[Style.OVER].scene),
)
"""Pairs (share of a limit, colour): neutral, amber from 80 % of the limit, red beyond it, with sharp steps."""
COLOURS: MappingProxyType[str, Any] = MappingProxyType(
    {
        "unlimited": MEANINGS[Style.QUIET].scene,
        "com": (0.10, 0.12, 0.16),
        "wrench": (0.62, 0.30, 0.55),
        "ellipsoid": (0.90, 0.60, 0.0),
        "polytope": (0.16, 0.50, 0.85),
        "mass": (0.0, 0.62, 0.45),
        "grasp": (0.10, 0.34, 0.62),
        "path": (0.12, 0.31, 0.47),
        "axes": ((0.82, 0.18, 0.20), (0.10, 0.60, 0.27), (0.12, 0.35, 0.80)),
        "lines": style.SERIES,
    }
)
"""Colours of drawn quantities by name: red, green, blue from 0 to 1; ``axes`` has three, ``lines`` those of a chart."""
SEQUENTIAL = (
    (0.230, 0.322, 0.546), (0.164, 0.471, 0.558), (0.119, 0.611, 0.539),
    (0.267, 0.749, 0.441), (0.606, 0.851, 0.237), (0.993, 0.906, 0.144),
)  # fmt: skip
"""Steps of a quantity without a limit: Matplotlib's viridis from a quarter on, even in lightness for readers
who do not see the colours, and lighter than a dark scene."""


def quantity_steps() -> Any:
    """Colormap of :data:`SEQUENTIAL`, the steps of pages, for charts.

    >>> quantity_steps().N
    6
    """
    from matplotlib.colors import ListedColormap

    return ListedColormap(SEQUENTIAL)


QUANTITIES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "twist": ("#00775a", "#35c9a0"),
        "momentum": ("#8b3a9b", "#d79fe8"),
        "wrench": ("#b05a00", "#f2a84e"),
        "change": ("#5b6672", "#b4bfca"),
        "link": (MEANINGS[Style.POINTED].light, MEANINGS[Style.POINTED].dark),
    }
)
"""Colours of words and arrows in articles, on light and on dark paper: hues of Okabe and Ito, with 4.5 : 1 as text."""
_SAMPLED_POSES = 16
"""Number of random configurations from which a drawing scale follows."""
_ELLIPSOID_SHARE = 0.13
"""Semi-axis of a typical ellipsoid, as a share of the robot's size: about an eighth."""
_MIN_MASS_RATIO = 1e-9
"""Inverse mass in a direction, over the largest, up to which the tip cannot move in this direction."""


def quantity_colours() -> str:
    """Style sheet with the colours of quantities as variables of a page.

    >>> quantity_colours().split(";")[0]
    ':root { --twist: #00775a'
    """
    light = " ".join(f"--{name}: {colour};" for name, (colour, _) in QUANTITIES.items())
    dark = " ".join(f"--{name}: {colour};" for name, (_, colour) in QUANTITIES.items())
    return f":root {{ {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"


@dataclass(frozen=True, eq=False)
class Mark:
    """Pose of a joint's torque arrow in the body's frame; the arrow's axis is z."""

    torque: int
    """Index of the torque."""
    body: int
    """Index of the body."""
    pose: Array
    """Pose (4, 4) of the arrow in the body's frame."""
    turns: bool
    """True for rotation about the axis, False for translation along it."""


def torque_marks(model: Model) -> list[Mark]:
    """Marks of the joints with one degree of freedom that have their own coordinate and move a link."""
    marks = []
    for k, body in enumerate(model.bodies):
        if body.follows or body.joint.nv != 1 or not body.joint.moves_body:
            continue
        screw = body.joint.axes[0]
        w, v = screw[:3], screw[3:]
        turns = bool(w.any())
        if turns:
            axis = w
            point = so3.cross(w, v) / (w @ w)  # of the screw axis, nearest to the origin
        else:
            axis = v
            point = np.zeros(3)
        pose = se3.pose(turned_z(axis), point)
        marks.append(Mark(body.v_index, k, pose, turns))
    marks.sort(key=lambda mark: mark.torque)
    return marks


def share_colours(shares: ArrayLike) -> Array:
    """Red, green, blue (..., 3) of shares (...) of a limit; NaN (no limit) is grey."""
    sizes = np.abs(np.asarray(shares, float))
    steps = [share for share, _ in SHARES]
    step_colours = np.array([colour for _, colour in SHARES])
    channels = [np.interp(sizes, steps, channel) for channel in step_colours.T]
    colours = np.stack(channels, axis=-1)
    has_no_limit = np.isnan(sizes)[..., None]
    return np.where(has_no_limit, COLOURS["unlimited"], colours)


def force_scale(robot: Robot, scene: Scene) -> float:
    """Drawing scale of forces [m/N]: the tip's force ellipsoid is about an eighth of the robot; 0 without an ellipsoid.

    The ellipsoid needs a tip, limits and a fixed base, and a pose without unbounded forces.
    """
    from ..statics.force_capability import wrench_ellipsoid

    model = robot.model
    effort = robot.limits.effort
    has_undriven_joint = any(not body.joint.driven for body in model.bodies)
    has_limits = np.isfinite(effort).any() and (effort > 0).all()
    if model.tip is None or has_undriven_joint or not has_limits:
        return 0.0
    q = robot.random_configuration(0, _SAMPLED_POSES)
    semi_axes = wrench_ellipsoid(robot, q, limits=effort).semi_axes  # (poses, 3), sorted
    typical_force = float(np.median(semi_axes[:, 1]))  # of the middle axes
    if not np.isfinite(semi_axes).all() or not typical_force > 0:
        return 0.0
    return _ELLIPSOID_SHARE * scene.size / typical_force


def mass_scale(robot: Robot, scene: Scene) -> tuple[float, int]:
    """Drawing scale of mass [m/kg], and largest number of directions in which the tip can move; both 0 without a tip.

    A typical ellipsoid of the tip's mass is about an eighth of the robot.
    """
    if robot.model.tip is None:
        return 0.0, 0
    q = robot.random_configuration(0, _SAMPLED_POSES)
    J_v = np.asarray(robot.jacobian(q, kind="world_aligned"))[:, 3:]
    M = np.asarray(robot.mass_matrix(q))
    inverse_masses = np.linalg.eigvalsh(J_v @ np.linalg.solve(M, np.swapaxes(J_v, 1, 2)))  # of Λ⁻¹, ascending
    is_movable = inverse_masses > _MIN_MASS_RATIO * inverse_masses[:, -1:]
    directions = int(is_movable.sum(axis=1).max())
    if directions == 0:
        return 0.0, 0
    rank = min(2, directions)  # the second smallest mass, the only one of a single direction
    typical_mass = float(np.median(1 / inverse_masses[:, -rank]))
    return _ELLIPSOID_SHARE * scene.size / typical_mass, directions
