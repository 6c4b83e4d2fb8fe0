"""Report of an exciting motion, in blocks: verdict, distances, a row for each joint, and what a log of it determines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...core.answers.blocks import Block, Headline, Level, Line, More, Table, numbers, words
from ...core.colours import Style
from ...core.numbers import number, percent, percent_of_limit
from ...core.typing import Array
from ...mechanics.joints.units import heading_unit
from ...motion.coordinates import Coordinates
from ..parameters import group_units

if TYPE_CHECKING:
    from ..exciting_trajectory import ExcitingMotion

_MOST_ROWS = 12
_MOST_REASONS = 4
_MAX_GOOD_DEVIATION, _ROUNDING = 0.1, 1e-9
"""Deviation of a well determined group as a share of its value, and values that are 0, as a share of the plausible size."""


def excitation_view(found: ExcitingMotion) -> Iterator[Block]:
    """Verdict, closest links, heading, one row per joint, what a log determines, and one row per group."""
    yield from _verdict(found)
    if found.clearance is not None:
        yield from found.clearance.lines
    yield ""
    yield Line(
        (found.robot.name, Style.STRONG),
        f"  ·  {number(found.duration)} s, {found.series.harmonics} harmonics, at rest at both ends",
    )
    yield Line(
        f"condition {number(found.condition)}  ·  log det {number(found.log_det)}  ·  median deviation "
        f"{number(np.median(found.predicted_deviations), 2)}",
        level=Level.ALL,
    )
    yield _joints(found)
    yield from _information(found)
    yield More(f"{found.information.base.count} groups of parameters with their deviations")
    yield _groups(found)


def _verdict(found: ExcitingMotion) -> Iterator[Block]:
    """Verdict with the least distances or its reasons, one per line."""
    obstacles = {"itself": "of capsules around links from each other", "floor": "from the floor"}
    least = [f"{number(1000.0 * value)} mm {obstacles[name]}" for name, value in found.clearances.items()]
    distances = f"least distances: {', '.join(least)}" if least else "nothing can touch"
    first, *others = found.verdict.reasons or (distances,)
    yield Headline(found.verdict.word, f"{first}.")
    for k, reason in enumerate(others):
        yield Line(f"  - {reason}.", level=Level.SHORT if k < _MOST_REASONS else Level.ALL)
    if len(others) > _MOST_REASONS:
        yield More(f"{len(others) - _MOST_REASONS} more reasons")
    if found.verdict.reasons and least:
        yield f"{distances[0].upper()}{distances[1:]}."


def _shares(peaks: Array, limits: Array) -> list[float | None]:
    """Peaks (nv,) as shares of their limits; None without a limit."""
    shares: list[float | None] = []
    for peak, limit in zip(peaks, limits, strict=True):
        has_limit = math.isfinite(limit) and limit > 0
        shares.append(peak / limit if has_limit else None)
    return shares


def _joints(found: ExcitingMotion) -> Table:
    robot, peaks, degrees = found.robot, found.peaks, found.degrees
    turning = Coordinates.from_model(robot.model).angular_velocity
    factor = np.where(turning & degrees, math.degrees(1.0), 1.0)
    place, speed, rate, torque = (heading_unit(part, turning, degrees=degrees) for part in ("q", "dq", "ddq", "tau"))

    of_velocity = _shares(peaks["velocity"], robot.limits.velocity)
    of_torque = _shares(peaks["torque"], robot.limits.effort)
    return Table(
        "",
        words("joint", robot.model.velocity_names, fold=False),
        numbers("from", peaks["lower"] * factor, unit=place),
        numbers("to", peaks["upper"] * factor, unit=place, headed=False),
        numbers("peak", peaks["velocity"] * factor, unit=speed),
        numbers("share", of_velocity, percent_of_limit),
        numbers("peak", peaks["acceleration"] * factor, unit=rate),
        numbers("peak", peaks["torque"], unit=torque),
        numbers("share", of_torque, percent_of_limit),
        most=_MOST_ROWS,
        by=[max(a or 0.0, b or 0.0) for a, b in zip(of_velocity, of_torque, strict=True)],
    )


def _information(found: ExcitingMotion) -> Iterator[Line]:
    """Number of groups that a log of the motion determines well, compared with the file's values, and the worst of them."""
    base = found.information.base
    values = np.abs(base.project(base.unknown.file_values))
    known = values > _ROUNDING * found.information.prior
    shares = np.where(known, found.predicted_deviations / np.where(known, values, 1.0), 0.0)
    count = int(known.sum())
    if not count:
        return
    worst = int(shares.argmax())
    how = "not at all" if shares[worst] > 1.0 else f"to {percent(shares[worst], 2)}"
    beside = f"; {len(values) - count} groups are 0 there" if count < len(values) else ""
    good_count = int((shares[known] < _MAX_GOOD_DEVIATION).sum())
    yield Line(
        f"A log of it determines {good_count} of {count} groups to better than 10 % of the file's value"
        f"{beside}. Worst: {found.groups[worst]} ({how})."
    )
    if shares[worst] > _MAX_GOOD_DEVIATION:
        yield Line("→ A longer duration, or several logs of the motion, determine more.")


def _groups(found: ExcitingMotion) -> Table:
    base = found.information.base
    units = [unit.replace("^2", "²") for unit in group_units(found.groups, found.robot.model)]
    of_groups = partial(numbers, unit=", ".join(dict.fromkeys(units)), headed=False)
    return Table(
        f"{base.count} groups of parameters, and how sure a log of the motion makes them",
        words("group", found.groups),
        words("unit", units, fold=False),
        of_groups("file", base.project(base.unknown.file_values)),
        of_groups("deviation", found.predicted_deviations, lambda sigma: number(sigma, 2)),
        numbers("of prior", found.shares_of_prior, lambda share: percent(share, 2)),
        level=Level.ALL,
    )
