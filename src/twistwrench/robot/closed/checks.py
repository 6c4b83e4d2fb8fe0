"""Checks of closed loops: closure, independence of constraints, and states that satisfy them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...algorithms.constraints import SINGULAR, UNBALANCED, Closure, row_names, with_gaps
from ...algorithms.loop_closure import through
from ...core import arguments
from ...core.numbers import printed
from ...errors import ConstraintError, ConstraintWarning, UnknownNameError
from ...lie.labelled import TWIST
from ...typing import Array
from .constraints import all_rows, gap_length, rate_units, six_sizes

if TYPE_CHECKING:
    from ..robot import Robot
    from .closed_robot import ClosedRobot

REDUNDANT = ("error", "accept")
STARTS = 32
"""Number of random configurations from which closed ones are searched; with common mechanisms one in a few converges."""
FOUND = 1e-10
"""rad, and part of the robot's length: far below this the row of A at a configuration is that of a closed one."""
OPEN, ASTRAY = 1e-2, 0.1
"""Largest gap of the loops (rad, and part of their span), and largest part of a rate that may break the constraints, for
constrained dynamics to be evaluated. Stages of an integrator's step are a little off both: gaps grow with the step's square,
rates with the step."""
STILL = 1e-3
"""rad/s, and part of the robot's length per s (and per s): joints this slow are at rest. Where a motion turns round, the stages
of an integrator's step add up to velocities as small as their errors, of which any part may break the constraints."""
FADED = 1e-2
"""Rows that see this part of what they usually see of a motion are near a singular configuration, where rounding and an
integrator's errors are all that is left of them."""
NEAR = 0.5
"""Largest displacement (rad and m) by which a closed configuration still counts as near."""


def some_configurations(closed: ClosedRobot, near: ArrayLike | None) -> Array:
    """Some configurations with the loops closed, found from known and random ones or from around ``near``; (n, nq)."""
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
    """Steps (n, nv) to places at and around a configuration, none first."""
    return np.repeat([0.0, 0.01, 0.1, 0.3], n // 4)[:, None] * rng.standard_normal((n, robot.nv))


def require_angle(closed: ClosedRobot, q: Array) -> None:
    """Raise where one turning row is held alone and the rest turns too: then its rate is the rate of no angle."""
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
    """Raise a ConstraintError that names the rows that depend on others, and an independent choice."""
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
    """Raise a ConstraintError that names the start that leaves the widest gap of ``left`` (n,), where that is too wide."""
    if not (left > tolerance).any():
        return
    worst = int(left.argmax())
    raise ConstraintError(
        f"no configuration with closed loops found from here: a gap of {printed(left[worst], 3)} ({_in_units(closed)}) is left"
        f"{_place(worst, batch)}, allowed {printed(tolerance)}. Start nearer to one, or allow more: consistent(q, tolerance=…)."
    )


def warn_of_far(robot: Robot, q: Array, found: Array, within: float) -> None:
    """Warn of the joint that went furthest from q to ``found`` (..., nq), if that is further than ``within``."""
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
    """Warn of states that hold the constraints by fewer directions than usual."""
    if (lost := rank < usual).any():
        warnings.warn(
            f"singular configuration: {lost.sum()} of these states hold the constraints by {rank.min()} "
            f"directions, not {usual}; λ is the one of least norm.",
            ConstraintWarning,
            stacklevel=5,
        )


def _place(flat: int, batch: tuple[int, ...]) -> str:
    return _in_words(np.unravel_index(flat, batch)) if batch else ""


def _in_words(row: Iterable[Any]) -> str:
    numbers = ", ".join(map(str, row))
    return f" (row {numbers} of the batch)" if numbers else ""


def require_met(closed: ClosedRobot, q: Array, dq: Array, ddq: Array | None = None) -> None:
    """Raise a ConstraintError with the amount by which a state breaks the constraints, if it is too large."""
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
    # Seen through the mass matrix a row of its usual size is 1; so this is what rows usually see of such a motion.
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
    """Raise if torques ``left`` (..., n) at joints without motors exceed rounding beside M q̈ + h = f (..., nv)."""
    rest = np.abs(left).max(axis=-1, initial=0.0)
    allowed = UNBALANCED * np.abs(f).max(axis=-1, initial=0.0)
    if (rest <= allowed).all():
        return
    worst = int((rest - allowed).argmax())
    idle, moving = (", ".join(joints(closed.robot, which)) for which in (~driven, driven))
    raise ConstraintError(
        f"joints {idle} have no motor, and no torques at {moving or 'no joint'} make this motion: "
        f"{printed(rest.flat[worst], 3)} N m or N is left over{_place(worst, rest.shape)}. Degrees of freedom: "
        f"{closed.nv - len(closed.independent)}; name as many joints that move them."
    )


def require_independent(closed: ClosedRobot, q: Array, driven: Array) -> None:
    """Raise unless the joints ``driven`` (nv,) have as many velocities as there are degrees of freedom, and make all others."""
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
    """Mask of the velocities of the joints named (None: all); (nv,)."""
    leaders = {b.joint.name: b for b in robot.model.leaders}
    names = list(leaders) if actuated is None else [actuated] if isinstance(actuated, str) else list(actuated)
    found = np.zeros(robot.nv, bool)
    for name in names:
        if name not in leaders:
            raise UnknownNameError.from_choices("joint", name, leaders)
        found[leaders[name].v_index : leaders[name].v_index + leaders[name].joint.nv] = True
    return found


def joints(robot: Robot, which: Array) -> list[str]:
    """The joints of the velocities that ``which`` (nv,) is true for."""
    names = [b.joint.name for b in robot.model.leaders for _ in range(b.joint.nv)]
    return list(dict.fromkeys(name for name, yes in zip(names, which, strict=True) if yes))
