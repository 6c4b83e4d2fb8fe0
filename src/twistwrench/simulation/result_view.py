"""Simulation as blocks: verdict, coordinates, velocities, energies, accuracy, events and remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from ..core.answers.blocks import Block, Headline, Level, Line, Table, numbers, remarks, words
from ..core.colours import Style
from ..core.numbers import number, residual, seconds
from ..core.typing import Array
from ..core.verdict import Word
from ..mechanics.joints.units import heading_unit
from ..motion.coordinates import Coordinates
from ..motion.model_doubts import friction_words
from .judgement import limits_passed, simulation_verdict

if TYPE_CHECKING:
    from .result import SimulationResult

MAX_EVENTS = 20
"""Largest number of events that the full report lists."""
MAX_EVENTS_IN_SHORT = 3
"""Largest number of events that the short form of the report lists."""
MAX_ROWS_IN_SHORT = 8
"""Largest number of rows of a table in the short form."""
_TURNING_AND_SLIDING = (True, False)
"""Flags of both kinds of joints, for a heading with the units of both."""
_DECIMALS = 12
"""Number of decimals of coordinates, velocities and energies; smaller values are rounding errors."""


def simulation_view(result: SimulationResult) -> Iterator[Block]:
    """Blocks of a simulation, verdict first."""
    yield from _headlines(result)
    is_driven_to_end = result.driven and result.completed
    if not is_driven_to_end:
        yield from remarks(limits_passed(result))
    yield ""
    yield _heading(result)
    yield _coordinates(result)
    yield _velocities(result)
    yield _energies(result)
    if np.isfinite(result.relative_error):
        yield f"error of the steps: {residual(result.relative_error)} of the motion"
    yield from _events(result)
    yield from remarks(result.remarks)


def _headlines(result: SimulationResult) -> Iterator[Block]:
    """Verdict on clearances if links come too near; verdict on the motion, or a line without it; lines on the closest links."""
    verdict = simulation_verdict(result)
    clearance = result.clearance
    drift_sentence = f"Energy drift {residual(result.relative_drift)} of the energy exchanged."
    end_time = f"{number(result.times[-1], 6)} s"
    links_too_near = clearance is not None and not clearance.verdict.ok
    if clearance is not None and links_too_near:
        yield Headline.from_verdict(clearance.verdict)
    if not verdict.ok:
        time_text = "" if verdict.word is Word.OVER_LIMIT else f" at t = {end_time}"
        yield Headline(verdict.word, f"{verdict.reasons[0]}. {drift_sentence}", time_text)
    elif links_too_near:
        yield f"Simulated {end_time}. {drift_sentence}"
    else:
        word = verdict.word if clearance is None else Word.OK
        yield Headline(word, f"simulated {end_time}. {drift_sentence}")
    if clearance is not None:
        yield from clearance.lines


def _heading(result: SimulationResult) -> Line:
    """Robot, method, number of states and steps, and whether friction is counted."""
    rejected_text = ""
    if result.rejected:
        rejected_text = f", {result.rejected} rejected"
    friction_text = ""
    if result.simulated is not None:
        friction_text = f"  ·  {friction_words(result.simulated.model, counted=result.friction)}"
    return Line(
        (result.robot, Style.STRONG),
        f"  ·  {result.method}  ·  {len(result)} states to {number(result.times[-1], 6)} s  ·  {result.steps} steps",
        rejected_text,
        friction_text,
    )


def _unit_factors(result: SimulationResult, mask: Literal["angular", "angular_velocity"]) -> Array | float:
    """Factor of each coordinate or velocity from SI units to units of the report.

    ``mask`` names the field of :class:`.Coordinates` that marks angles.
    """
    if not result.degrees or result.simulated is None:
        return 1.0
    coordinates = Coordinates.from_model(result.simulated.model)
    is_angle = getattr(coordinates, mask)
    degrees_per_radian = math.degrees(1.0)
    return np.where(is_angle, degrees_per_radian, 1.0)


def _coordinates(result: SimulationResult) -> Table:
    """First, last, lowest and highest value of each coordinate."""
    q = result.q * _unit_factors(result, "angular")
    unit = heading_unit("q", _TURNING_AND_SLIDING, degrees=result.degrees)
    column = partial(numbers, show=_rounded_text, unit=unit, headed=False)
    return Table(
        "Coordinates",
        words("coordinate", result.coordinate_names),
        column("start", q[0]),
        column("end", q[-1]),
        column("lowest", q.min(axis=0)),
        column("highest", q.max(axis=0)),
        unit=unit,
        most=MAX_ROWS_IN_SHORT,
    )


def _velocities(result: SimulationResult) -> Table:
    """First, last and fastest value of each velocity, and the time of the fastest."""
    dq = result.dq * _unit_factors(result, "angular_velocity")
    peak_rows = np.abs(dq).argmax(axis=0)
    fastest = dq[peak_rows, np.arange(len(peak_rows))]
    unit = heading_unit("dq", _TURNING_AND_SLIDING, degrees=result.degrees)
    column = partial(numbers, show=_rounded_text, unit=unit, headed=False)
    return Table(
        "Velocities",
        words("velocity", result.velocity_names),
        column("start", dq[0]),
        column("end", dq[-1]),
        column("fastest", fastest),
        numbers("at", result.times[peak_rows], seconds, "s"),
        unit=unit,
        most=MAX_ROWS_IN_SHORT,
    )


def _energies(result: SimulationResult) -> Table:
    """First value, last value and value of largest magnitude of each energy, of each nonzero work, and of the drift."""
    energies = {"kinetic": result.kinetic_energy, "potential": result.potential_energy, "both": result.energy}
    for name, work in result.work.items():
        if np.any(work):
            energies[f"work of {name}"] = work
    rows = []  # cells at the start, at the end, and of largest magnitude
    for energy in energies.values():
        peak_row = int(np.abs(energy).argmax())
        values = energy[[0, -1, peak_row]]
        rows.append([Line(_rounded_text(value), value=value) for value in values])
    drift = result.drift
    largest_drift = drift[np.abs(drift).argmax()]
    rows.append([Line(residual(value), value=value) for value in (0.0, drift[-1], largest_drift)])  # from zero on
    start, end, largest = zip(*rows, strict=True)
    column = partial(numbers, unit="J", headed=False)
    names = words("", [*energies, "drift"])
    columns = [column("start", start), column("end", end), column("largest", largest)]
    return Table("Energies", names, *columns, unit="J")


def _events(result: SimulationResult) -> Iterator[Block]:
    """The first events, and the number of all if there are more."""
    for k, event in enumerate(result.events[:MAX_EVENTS]):
        level = Level.SHORT if k < MAX_EVENTS_IN_SHORT else Level.ALL
        yield Line(f"· {event}", level=level)
    if len(result.events) > MAX_EVENTS_IN_SHORT:
        yield f"· … {len(result.events)} events in all"


def _rounded_text(value: float) -> str:
    """Value with four significant digits; rounding errors print as zero."""
    return number(value, decimals=_DECIMALS)
