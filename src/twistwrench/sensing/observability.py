"""Observability of a sensor's unknowns from a log, with advice on the rotations that it lacks."""

from __future__ import annotations

import numpy as np

from ..core.estimation.least_squares import null_combinations
from ..core.numbers import number, printed
from ..core.typing import Array
from ..mechanics.lie import so3
from .log import ReadingLog
from .unknowns import SensorState, Unknowns

MIN_ANGLE = 1e-3  # rad; directions of gravity nearer to each other than this count as one
_UNITS = {
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

    >>> upright = ReadingLog.from_arrays(np.zeros((3, 6)), gravity=[0, 0, -9.81])
    >>> print(blind_spots(upright, Unknowns(), 1.0)[0])
    mass +1 kg with bias fz +9.81 N changes no reading: these cannot be distinguished.
    """
    # If the columns depend on the load: a load without symmetry, whose moments depend on every turn.
    load = None
    if unknowns.nonlinear_columns.size:
        load = np.array([1.0, 0.05, 0.08, 0.1, *np.zeros(6)])
    A = unknowns.design(log, factor, SensorState(load=load)).reshape(6 * len(log), -1) * unknowns.scales
    names = unknowns.names
    # Load first and bias last: each combination is reported as a change of the load that the bias can cancel.
    order = [*range(6 * unknowns.bias, len(names)), *range(6 * unknowns.bias)]
    combinations = null_combinations(A[:, order]) * unknowns.scales[order]
    ordered_names = [names[k] for k in order]
    return [_sentence(row, ordered_names) for row in combinations]


def advice(log: ReadingLog, unknowns: Unknowns) -> str:
    """Advice on the rotations that the log lacks."""
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    centre = unit.mean(axis=0)
    spread, axes = np.linalg.svd(unit - centre)[1:]
    spread = np.concatenate([spread, np.zeros(3)])[:3] / np.sqrt(len(unit))
    if spread[0] < MIN_ANGLE:
        return (
            f"In all readings gravity points along ({_vector(centre / np.linalg.norm(centre))}) of the sensor's frame. "
            "Tilt the tool about two different axes between readings, by tens of degrees; `poses` proposes some."
        )
    if spread[1] < MIN_ANGLE:
        axis = so3.cross(axes[0], centre)
        direction = ""
        if np.linalg.norm(axis) > MIN_ANGLE:
            direction = f" about ({_vector(axis / np.linalg.norm(axis))})"
        return (
            f"Gravity takes only two directions in the sensor's frame: the tool was turned{direction} only. "
            "Add readings tilted about another axis; `poses` proposes some."
        )
    if unknowns.inertia:
        return (
            "Readings at rest or turning about one axis determine the inertia poorly. Log faster turns about three axes, "
            "or do not identify the inertia."
        )
    return "Add readings in other orientations; `poses` proposes some."


def _sentence(row: Array, names: list[str]) -> str:
    """Sentence on a combination of unknowns (p,) without effect."""
    terms = []
    for name, value in zip(names, row, strict=True):
        if value:
            terms.append(f"{name} {printed(value, 3, signed=True)} {_unit(name)}")
    if len(terms) == 1:
        return f"{terms[0]} changes no reading: it cannot be identified."
    return f"{terms[0]} with {', '.join(terms[1:])} changes no reading: these cannot be distinguished."


def _unit(name: str) -> str:
    """Unit of an unknown, by the first entry that its name begins with."""
    return next(unit for start, unit in _UNITS.items() if name.startswith(start))


def _vector(x: Array) -> str:
    return ", ".join(number(v, 2) for v in x + 0.0)
