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

_MAX_ROWS = 12
"""Largest number of table rows in the short form."""
_MAX_REASONS = 4
"""Largest number of reasons in the short form."""
_MAX_GOOD_DEVIATION = 0.1
"""Largest deviation of a well determined group, as a share of its value."""
_ROUNDING = 1e-9
"""Value of a group that counts as 0, as a share of its largest plausible size."""


def excitation_view(found: ExcitingMotion) -> Iterator[Block]:
    """Verdict, closest links, heading, joints, groups that a log determines well, and all groups in the full form."""
    yield from _verdict_blocks(found)
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
    yield _joint_table(found)
    yield from _information_lines(found)
    yield More(f"{found.information.base.count} groups of parameters with their deviations")
    yield _group_table(found)


def _verdict_blocks(found: ExcitingMotion) -> Iterator[Block]:
    """Verdict with its reasons, one per line, and the least distances."""
    obstacle_texts = {
        "itself": "of capsules around links from each other",
        "floor": "from the floor",
    }
    distances = []
    for name, distance in found.clearances.items():
        millimetres = 1000.0 * distance
        distances.append(f"{number(millimetres)} mm {obstacle_texts[name]}")
    summary = f"least distances: {', '.join(distances)}" if distances else "nothing can touch"
    headline, *other_reasons = found.verdict.reasons or (summary,)  # without reasons, the headline has the distances
    yield Headline(found.verdict.word, f"{headline}.")
    for k, reason in enumerate(other_reasons):
        level = Level.SHORT if k < _MAX_REASONS else Level.ALL
        yield Line(f"  - {reason}.", level=level)
    if len(other_reasons) > _MAX_REASONS:
        yield More(f"{len(other_reasons) - _MAX_REASONS} more reasons")
    if found.verdict.reasons and distances:
        yield f"{summary[0].upper()}{summary[1:]}."


def _shares(peaks: Array, limits: Array) -> list[float | None]:
    """Peaks (nv,) as shares of their limits; None without a limit."""
    shares: list[float | None] = []
    for peak, limit in zip(peaks, limits, strict=True):
        has_limit = math.isfinite(limit) and limit > 0
        shares.append(peak / limit if has_limit else None)
    return shares


def _joint_table(found: ExcitingMotion) -> Table:
    """Range, peaks and shares of the limits of each joint; the short form has the joints nearest to their limits."""
    robot = found.robot
    peaks = found.peaks
    degrees = found.degrees
    is_angular = Coordinates.from_model(robot.model).angular_velocity
    factor = np.where(is_angular & degrees, math.degrees(1.0), 1.0)
    position_unit = heading_unit("q", is_angular, degrees=degrees)
    velocity_unit = heading_unit("dq", is_angular, degrees=degrees)
    acceleration_unit = heading_unit("ddq", is_angular, degrees=degrees)
    torque_unit = heading_unit("tau", is_angular, degrees=degrees)
    velocity_shares = _shares(peaks["velocity"], robot.limits.velocity)
    torque_shares = _shares(peaks["torque"], robot.limits.effort)
    largest_shares = []
    for velocity_share, torque_share in zip(velocity_shares, torque_shares, strict=True):
        largest_shares.append(max(velocity_share or 0.0, torque_share or 0.0))  # a share without a limit counts as 0
    return Table(
        "",
        words("joint", robot.model.velocity_names, fold=False),
        numbers("from", peaks["lower"] * factor, unit=position_unit),
        numbers("to", peaks["upper"] * factor, unit=position_unit, headed=False),
        numbers("peak", peaks["velocity"] * factor, unit=velocity_unit),
        numbers("share", velocity_shares, percent_of_limit),
        numbers("peak", peaks["acceleration"] * factor, unit=acceleration_unit),
        numbers("peak", peaks["torque"], unit=torque_unit),
        numbers("share", torque_shares, percent_of_limit),
        most=_MAX_ROWS,
        by=largest_shares,
    )


def _information_lines(found: ExcitingMotion) -> Iterator[Line]:
    """Number of groups that a log determines well, relative to the file's values, and the worst one. Empty if all are 0."""
    base = found.information.base
    values = np.abs(base.project(base.unknown.file_values))
    has_value = values > _ROUNDING * found.information.prior
    divisors = np.where(has_value, values, 1.0)
    shares = np.where(has_value, found.predicted_deviations / divisors, 0.0)
    nonzero_count = int(has_value.sum())
    if not nonzero_count:
        return
    worst = int(shares.argmax())
    accuracy = "not at all" if shares[worst] > 1.0 else f"to {percent(shares[worst], 2)}"
    zeros_text = f"; {len(values) - nonzero_count} groups are 0 there" if nonzero_count < len(values) else ""
    good_count = int((shares[has_value] < _MAX_GOOD_DEVIATION).sum())
    yield Line(
        f"A log of it determines {good_count} of {nonzero_count} groups to better than 10 % of the file's value"
        f"{zeros_text}. Worst: {found.groups[worst]} ({accuracy})."
    )
    if shares[worst] > _MAX_GOOD_DEVIATION:
        yield Line("→ A longer duration, or several logs of the motion, determine more.")


def _group_table(found: ExcitingMotion) -> Table:
    """Value in the file and predicted deviation of each group."""
    base = found.information.base
    units = [unit.replace("^2", "²") for unit in group_units(found.groups, found.robot.model)]
    all_units = ", ".join(dict.fromkeys(units))  # each unit once
    column = partial(numbers, unit=all_units, headed=False)
    return Table(
        f"{base.count} groups of parameters",
        words("group", found.groups),
        words("unit", units, fold=False),
        column("file", base.project(base.unknown.file_values)),
        column("deviation", found.predicted_deviations, lambda sigma: number(sigma, 2)),
        numbers("of prior", found.shares_of_prior, lambda share: percent(share, 2)),
        detail=", and how sure a log of the motion makes them",
        level=Level.ALL,
    )
