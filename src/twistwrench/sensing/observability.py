"""Observability of a sensor's unknowns from a log, with advice on the rotations that it lacks."""

from __future__ import annotations

import numpy as np

from ..core.estimation.least_squares import null_combinations
from ..core.numbers import number, printed, without_noise
from ..core.typing import Array
from ..mechanics.lie import so3
from .log import ReadingLog
from .unknowns import SensorState, Unknowns

MIN_ANGLE = 1e-3
"""Angle below which two directions of gravity count as one [rad]."""
_GENERIC_LOAD = np.array([1.0, 0.05, 0.08, 0.1, *np.zeros(6)])
"""Load whose moments depend on every turn: mass [kg], first moments [kg m], moments of inertia [kg m²]."""
_UNIT_BY_NAME_START = {
    "drift m": "N m/s",
    "drift f": "N/s",
    "bias m": "N m",
    "bias f": "N",
    "mass": "kg",
    "m c": "kg m",
    "I": "kg m²",
    "turn": "rad",
    "tilt": "rad",
    "delay": "s",
}


def blind_spots(log: ReadingLog, unknowns: Unknowns, factor: float) -> list[str]:
    """Combinations of unknowns without effect on any reading of the log, as sentences; empty if all are observable.

    ``factor`` is that of :func:`.sensor.sign_factor`.

    >>> upright = ReadingLog.from_arrays(np.zeros((3, 6)), gravity=[0, 0, -9.81])
    >>> print(blind_spots(upright, Unknowns(), 1.0)[0])
    mass +1 kg with bias fz +9.81 N changes no reading: these cannot be distinguished.
    """
    load = None
    if unknowns.nonlinear_columns.size:  # their columns depend on the load
        load = _GENERIC_LOAD
    design = unknowns.design(log, factor, SensorState(load=load))
    A = design.reshape(6 * len(log), -1) * unknowns.scales  # a row for each of the six numbers of a reading
    names = unknowns.names
    # Load first and bias last: each combination is reported as a change of the load that the bias can cancel.
    bias_count = 6 if unknowns.bias else 0
    load_first = [*range(bias_count, len(names)), *range(bias_count)]
    scaled_combinations = null_combinations(A[:, load_first])
    combinations = scaled_combinations * unknowns.scales[load_first]
    ordered_names = [names[k] for k in load_first]
    return [_sentence(changes, ordered_names) for changes in combinations]


def advice(log: ReadingLog, unknowns: Unknowns) -> str:
    """Sentences on the rotations that the log lacks."""
    directions = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    centre = directions.mean(axis=0)
    _, singular_values, axes = np.linalg.svd(directions - centre)
    # Root mean square distance from the centre along each axis, largest first; 0 beyond the number of directions.
    padded_values = np.concatenate([singular_values, np.zeros(3)])
    three_values = padded_values[:3]
    largest_spread, second_spread, _ = three_values / np.sqrt(len(directions))
    if largest_spread < MIN_ANGLE:
        unit_vector = centre / np.linalg.norm(centre)
        mean_direction = _vector_text(unit_vector)
        return (
            f"In all readings gravity points along ({mean_direction}) of the sensor's frame. "
            "Tilt the tool about two different axes between readings, by tens of degrees; `poses` proposes some."
        )
    if second_spread < MIN_ANGLE:
        axis = so3.cross(axes[0], centre)
        about_axis = ""
        if np.linalg.norm(axis) > MIN_ANGLE:  # zero for two opposite directions
            unit_axis = axis / np.linalg.norm(axis)
            about_axis = f" about ({_vector_text(unit_axis)})"
        return (
            f"Gravity takes only two directions in the sensor's frame: the tool was turned{about_axis} only. "
            "Add readings tilted about another axis; `poses` proposes some."
        )
    if unknowns.inertia:
        return (
            "Readings at rest or turning about one axis determine the inertia poorly. Log faster turns about three axes, "
            "or do not identify the inertia."
        )
    return "Add readings in other orientations; `poses` proposes some."


def _sentence(changes: Array, names: list[str]) -> str:
    """Sentence on changes of unknowns (p,) that together have no effect."""
    terms = []
    for name, change in zip(names, changes, strict=True):
        if change:
            terms.append(f"{name} {printed(change, 3, signed=True)} {_unit(name)}")
    first, *others = terms
    if not others:
        return f"{first} changes no reading: it cannot be identified."
    return f"{first} with {', '.join(others)} changes no reading: these cannot be distinguished."


def _unit(name: str) -> str:
    """Unit of an unknown, by the first entry that its name begins with."""
    return next(unit for start, unit in _UNIT_BY_NAME_START.items() if name.startswith(start))


def _vector_text(x: Array) -> str:
    """Entries with two digits, separated by commas; rounding errors are 0."""
    return ", ".join(number(entry, 2) for entry in without_noise(x))
