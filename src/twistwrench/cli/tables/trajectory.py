"""A motion as text: a verdict, what each joint does of what it may, and what limits it when."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...core.printed_numbers import number, percent, percent_of_limit, seconds, torque
from ...joints.units import heading_unit
from ...listing import listed
from ...model.limits import over_limit
from ...motion.bounds import Bounds
from ...motion.coordinates import Coordinates
from ...motion.violations import Violation
from ...trajectories.fastest import Fastest
from ...trajectories.trajectory import Trajectory
from ...verdict import Word
from .plain_table import PlainTable, friction_words, remarks, share_bar, verdict_word

_SAMPLES = 2001
_LISTED = 12
_PASSED = 6
"""Limits passed that are listed."""


@dataclass(frozen=True)
class JointUse:
    """The most a joint does in a motion, as values and as shares of its limits (nan where there is none)."""

    joint: str
    way: float
    velocity: float
    velocity_share: float
    peak: float
    """The largest torque, with its sign."""
    torque_share: float
    unit: str
    """Of the torque."""
    limiting: float
    """The part of the time during which it is at a limit, in a fastest motion."""
    uncertainty: float = 0.0
    """Of the torque: a motion that is made has no noise."""


def joint_uses(trajectory: Trajectory, bounds: Bounds, *, friction: bool) -> list[JointUse]:
    """One for each entry of dq."""
    robot = trajectory.robot
    q, dq, ddq = trajectory(np.linspace(0.0, trajectory.duration, _SAMPLES))
    tau = robot.inverse_dynamics(q, dq, ddq, friction=friction)
    way, units = robot.subtract(q[-1], q[0]), Coordinates.of(robot.model).torque_units
    at_limit = dict.fromkeys(robot.model.velocity_names, 0.0)
    if isinstance(trajectory, Fastest):
        for touch in trajectory.touches:
            at_limit[touch.joint] += (touch.end - touch.begin) / trajectory.duration
    found = []
    for k, name in enumerate(robot.model.velocity_names):
        v, t = (x[int(np.abs(x).argmax())] for x in (dq[:, k], tau[:, k]))
        shares = [
            abs(x) / m if math.isfinite(m) else math.nan for x, m in ((v, bounds.velocity[k]), (t, bounds.effort[k]))
        ]
        use = (name, float(way[k]), float(v), shares[0], float(t), shares[1], units[k], at_limit[name])
        found.append(JointUse(*use))
    return found


def move_view(
    trajectory: Trajectory,
    bounds: Bounds,
    violations: tuple[Violation, ...],
    uses: list[JointUse],
    doubts: list[str],
    *,
    friction: bool,
    degrees: bool,
    carried: str = "",
    cannot: str = "",
    assumed: str = "",
) -> RenderableType:
    """The verdict, heading, a row per joint, and what limits the fastest motion when.

    ``uses`` are those of :func:`joint_uses`, ``doubts`` what makes torques unsure, ``assumed`` what an OK takes for granted,
    and ``cannot`` says why the motion ends
    before its path does.
    """
    robot = trajectory.robot
    names = Coordinates.of(robot.model)
    unit = np.where(names.angular_velocity & degrees, math.degrees(1.0), 1.0)
    way, speed, force = (heading_unit(part, names.angular_velocity, degrees=degrees) for part in ("q", "dq", "tau"))
    table = PlainTable()
    table.words("joint", fold=False)
    fast = isinstance(trajectory, Fastest)
    table.numbers(f"way [{way}]", f"peak [{speed}]", "share", f"peak [{force}]", "share", *(["at limit"] * fast))
    table.words("", fold=False)
    for k, use in enumerate(uses):
        most = max((x for x in (use.velocity_share, use.torque_share) if not math.isnan(x)), default=0.0)
        table.row(
            use.joint,
            number(use.way * unit[k], decimals=3),
            number(use.velocity * unit[k], decimals=3),
            percent_of_limit(use.velocity_share),
            torque(use.peak),
            percent_of_limit(use.torque_share),
            *([percent(use.limiting)] * fast),
            share_bar(most),
            style="bold red" if over_limit(most) else "",
        )
    s = trajectory.path.name
    first = Text.assemble(
        (robot.name, "bold"),
        f"  ·  {s}, {trajectory.scaling.name} timing: {number(trajectory.duration, 6)} s",
        f"  ·  carrying {carried}" if carried else "",
        f"  ·  {friction_words(robot.model, counted=friction)}",
    )
    parts: list[RenderableType] = [first, table]
    if isinstance(trajectory, Fastest):
        parts.extend(_timeline(trajectory))
    return Group(*_verdict(trajectory, bounds, violations, doubts, cannot, assumed), Text(), *parts)


def _timeline(trajectory: Fastest) -> list[RenderableType]:
    table = PlainTable("What limits it when")
    table.numbers("from [s]", "to [s]")
    table.words("joint", "limit", "", fold=False)
    T, touches = trajectory.duration, trajectory.touches
    shown = sorted(sorted(touches, key=lambda t: t.begin - t.end)[:_LISTED], key=lambda t: t.begin)
    for t in shown:
        a, b = round(24 * t.begin / T), max(round(24 * t.end / T), round(24 * t.begin / T) + 1)
        bar = Text("·" * min(a, 23) + "█" * (min(b, 24) - min(a, 23)) + "·" * (24 - min(b, 24)), style="cyan")
        table.row(seconds(t.begin, 4), seconds(t.end, 4), t.joint, f"{'+' if t.side > 0 else '-'} {t.kind}", bar)
    rest = len(touches) - len(shown)
    return [table, *([Text(f"and {rest} shorter parts", style="dim")] if rest else [])]


def _verdict(
    trajectory: Trajectory,
    bounds: Bounds,
    violations: tuple[Violation, ...],
    doubts: list[str],
    cannot: str,
    assumed: str,
) -> list[Text]:
    first = [Text.assemble(("CANNOT", "bold red"), f": {cannot}")] if cannot else []
    if violations:
        over = [Text.assemble(verdict_word(Word.OVER_LIMIT), f": {v}.") for v in violations[:_PASSED]]
        return [*first, *over, *([Text(f"and {len(violations) - _PASSED} more")] if len(violations) > _PASSED else [])]
    unknown = _unknown_velocities(trajectory, bounds)
    unlimited = unknown or np.isinf(bounds.effort).any()
    within = f"{'until there, ' if cannot else ''}within {'the limits that are known' if unlimited else 'all limits'}"
    if isinstance(trajectory, Fastest):
        within += ", and at one of them at all times: it cannot be done faster on this path"
    word = Word.UNSURE if doubts else Word.OK
    within = "; ".join([*doubts, f"otherwise {within}"] if doubts else [within + assumed])
    said = Text(f"{within[0].upper()}{within[1:]}.") if cannot else Text.assemble(verdict_word(word), f": {within}.")
    return [*first, said, *remarks(unknown)]


def _unknown_velocities(trajectory: Trajectory, bounds: Bounds) -> list[str]:
    """A sentence on the joints without a limit of velocity."""
    names = np.array(trajectory.robot.model.velocity_names)
    missing = names[~np.isfinite(bounds.velocity)]
    if not len(missing):
        return []
    of = "any joint" if len(missing) == len(names) else listed(missing, 6)
    return [f"No velocity limit of {of} is known, so none was asked for: --limits FILE.csv gives them (velocity)."]
