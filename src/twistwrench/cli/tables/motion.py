"""Tables of motions: ``simulate`` and ``move``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...core.numbers import number, percent, percent_of_limit, residual, seconds, torque
from ...core.text import listed
from ...core.verdict import Word
from ...joints.units import heading_unit
from ...model.limits import over_limit
from ...motion.bounds import Bounds, LimitCheck, Violation, bounds_of
from ...motion.coordinates import Coordinates
from ...trajectories.fastest import Fastest
from ...trajectories.trajectory import Trajectory
from ...typing import Array
from .plain_table import PlainTable, friction_words, remarks, share_bar, verdict_word

if TYPE_CHECKING:
    from ...robot import Robot
    from ...simulation.result import SimulationResult

_MOST = 20
"""Events listed."""
_ROUNDING = 12
"""Decimals below which a coordinate, a velocity or an energy is zero."""


def simulation_view(
    robot: Robot, result: SimulationResult, *, degrees: bool = False, friction: bool = True
) -> RenderableType:
    """The verdict with what was not simulated, then rows for coordinates, velocities and energies, accuracy and events."""
    c = Coordinates.of(robot.model)
    word = ("DONE", "bold") if result.completed else ("STOPPED", "bold red")
    verdict = [
        Text.assemble(word, f": {result.stopped}."),
        *remarks(_limits_passed(robot, result)),
        Text(),
    ]
    heading = Text.assemble(
        (result.robot, "bold"),
        f"  ·  {result.method}  ·  {len(result)} states to {number(result.times[-1], 6)} s  ·  {result.steps} steps",
        f", {result.rejected} taken again" if result.rejected else "",
        f"  ·  {friction_words(robot.model, counted=friction)}",
    )
    parts: list[RenderableType] = [*verdict, heading, _coordinates(result, c, degrees=degrees)]
    parts += [_velocities(result, c, degrees=degrees), _energies(result), _accuracy(result)]
    parts += [Text(f"· {event}") for event in result.events[:_MOST]]
    if len(result.events) > _MOST:
        parts.append(Text(f"· … {len(result.events)} events in all"))
    return Group(*parts, *remarks(result.remarks))


_PASSED = {
    "position": ("Joints were not held at their limits", "--stop-at-limits ends where the first is reached."),
    "torque": (
        "The torques given are more than the motors have",
        "Give less, or raise the efforts in the robot's file.",
    ),
    "velocity": ("Joints are faster than their limits", "The robot's own drives would not let them."),
}
"""Of each kind of limit that a simulation does not keep: what it means that one is passed, and what to do."""


def _limits_passed(robot: Robot, result: SimulationResult) -> list[str]:
    """A sentence for each kind of limit that the states or the torques given pass."""
    check, said = LimitCheck(robot.model, bounds_of(robot)), []
    check.add(result.times, result.q, result.dq, None, result.tau)
    passed = check.violations()
    for kind, (meaning, remedy) in _PASSED.items():
        mine = [violation for violation in passed if violation.kind == kind]
        if not mine:
            continue
        more = len(mine) - 1
        others = f", and {more} more joint{'s pass' if more > 1 else ' passes'} theirs" if more else ""
        said.append(f"{meaning}: {mine[0]}{others}. {remedy}")
    return said


def _coordinates(result: SimulationResult, c: Coordinates, *, degrees: bool) -> PlainTable:
    table = PlainTable(f"Coordinates [{heading_unit('q', (True, False), degrees=degrees)}]")
    table.words("coordinate")
    table.numbers("start", "end", "lowest", "highest")
    for name, x, angular in zip(c.names, result.q.T, c.angular, strict=True):
        unit = math.degrees(1.0) if degrees and angular else 1.0
        table.row(name, *_cells(unit * np.array([x[0], x[-1], x.min(), x.max()])))
    return table


def _velocities(result: SimulationResult, c: Coordinates, *, degrees: bool) -> PlainTable:
    table = PlainTable(f"Velocities [{heading_unit('dq', (True, False), degrees=degrees)}]")
    table.words("velocity")
    table.numbers("start", "end", "fastest", "at [s]")
    for name, v, angular in zip(c.velocity_names, result.dq.T, c.angular_velocity, strict=True):
        unit, peak = math.degrees(1.0) if degrees and angular else 1.0, int(np.abs(v).argmax())
        table.row(name, *_cells(unit * v[[0, -1, peak]]), seconds(result.times[peak]))
    return table


def _energies(result: SimulationResult) -> PlainTable:
    table = PlainTable("Energies [J]")
    table.words("")
    table.numbers("start", "end", "largest")
    rows = {"kinetic": result.kinetic_energy, "potential": result.potential_energy, "both": result.energy}
    rows |= {f"work of {name}": work for name, work in result.work.items() if np.any(work)}
    for name, x in rows.items():
        table.row(name, *_cells(x[[0, -1, int(np.abs(x).argmax())]]))
    drift = result.drift
    table.row("drift", "0", residual(drift[-1]), residual(drift[np.abs(drift).argmax()]))
    return table


def _accuracy(result: SimulationResult) -> Text:
    """The drift and the error, each against what moved."""
    said = f"drift {residual(result.relative_drift)} of the energy that moved"
    if np.isfinite(result.relative_error):
        said += f"; error of the steps {residual(result.relative_error)} of the motion"
    return Text(said)


def _cells(values: Array) -> list[str]:
    return [number(x, decimals=_ROUNDING) for x in values]


# ── ``move``: use of each joint, and the limits that bind

_SAMPLES = 2001
_LISTED = 12
_MOST_PASSED = 6
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
        for touch in trajectory.limit_contacts:
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
    T, touches = trajectory.duration, trajectory.limit_contacts
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
        over = [Text.assemble(verdict_word(Word.OVER_LIMIT), f": {v}.") for v in violations[:_MOST_PASSED]]
        return [
            *first,
            *over,
            *([Text(f"and {len(violations) - _MOST_PASSED} more")] if len(violations) > _MOST_PASSED else []),
        ]
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
