"""What a log cannot tell: combinations of the unknowns that change no reading, in words."""

from __future__ import annotations

import numpy as np

from ..core.printed_numbers import number, printed
from ..lie import so3
from ..typing import Array
from .log import ReadingLog
from .unknowns import SensorState, Unknowns

_NONE = 1e-6  # singular values below this share of the largest are rounding of the poses, not information
_NEAR = 1e-3  # gravity directions nearer than this to each other [rad] are one
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
    """Each combination of unknowns that no reading of this log changes with, as a sentence; empty if all can be told.

    >>> upright = ReadingLog.of(np.zeros((3, 6)), gravity=[0, 0, -9.81])
    >>> print(blind_spots(upright, Unknowns(), 1.0)[0])
    mass +1 kg with bias fz +9.81 N changes no reading: these cannot be told apart.
    """
    # A load whose moments depend on every turn, where the rows depend on the load.
    load = np.array([1.0, 0.05, 0.08, 0.1, *np.zeros(6)]) if unknowns.curved else None
    A = unknowns.design(log, factor, SensorState(load=load)).reshape(6 * len(log), -1) * unknowns.scales
    names = unknowns.names
    # Load first, bias last: each combination is then told as a change of the load that the bias can hide.
    order = [*range(6 * unknowns.bias, len(names)), *range(6 * unknowns.bias)]
    A = A[:, order]
    if len(A) > len(names):
        A = np.asarray(np.linalg.qr(A)[1])  # the same singular values and rows, of a small matrix
    _, values, rows = np.linalg.svd(A)
    rank = int((values > _NONE * values[0]).sum()) if values.size else 0
    combinations = _reduced(rows[rank:]) * unknowns.scales[order]
    return [_sentence(row, [names[k] for k in order]) for row in combinations]


def advice(log: ReadingLog, unknowns: Unknowns) -> str:
    """What to do about it: which turns the log lacks."""
    unit = log.gravity / np.linalg.norm(log.gravity, axis=1, keepdims=True)
    centre = unit.mean(axis=0)
    spread, axes = np.linalg.svd(unit - centre)[1:]
    spread = np.concatenate([spread, np.zeros(3)])[:3] / np.sqrt(len(unit))
    if spread[0] < _NEAR:
        return (
            f"In all readings gravity points along ({_vector(centre / np.linalg.norm(centre))}) of the sensor's frame. "
            "Tilt the tool about two different axes between readings, by tens of degrees; `poses` proposes some."
        )
    if spread[1] < _NEAR:
        axis = so3.cross(axes[0], centre)
        about = f" about ({_vector(axis / np.linalg.norm(axis))})" if np.linalg.norm(axis) > _NEAR else ""
        return (
            f"Gravity takes only two directions in the sensor's frame: the tool was turned{about} only. "
            "Add readings tilted about another axis; `poses` proposes some."
        )
    if unknowns.inertia:
        return (
            "Readings at rest or turning about one axis say little of inertia. Log faster turns about three axes, "
            "or ask for no inertia."
        )
    return "Add readings in other orientations; `poses` proposes some."


def _reduced(rows: Array) -> Array:
    """The same row space in reduced echelon form: few nonzeros, leading ones; tiny entries are cleared."""
    rows = rows.copy()
    lead = 0
    for column in range(rows.shape[1]):
        if lead == len(rows):
            break
        pivot = lead + int(np.abs(rows[lead:, column]).argmax())
        if abs(rows[pivot, column]) < 1e-6:
            continue
        rows[[lead, pivot]] = rows[[pivot, lead]]
        rows[lead] /= rows[lead, column]
        others = np.arange(len(rows)) != lead
        rows[others] -= np.outer(rows[others, column], rows[lead])
        lead += 1
    rows[np.abs(rows) < 1e-5 * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)] = 0.0
    return rows


def _sentence(row: Array, names: list[str]) -> str:
    terms = [f"{name} {printed(row[k], 3, signed=True)} {_unit(name)}" for k, name in enumerate(names) if row[k]]
    if len(terms) == 1:
        return f"{terms[0]} changes no reading: it cannot be told."
    return f"{terms[0]} with {', '.join(terms[1:])} changes no reading: these cannot be told apart."


def _unit(name: str) -> str:
    return next(unit for start, unit in _UNITS.items() if name.startswith(start))


def _vector(x: Array) -> str:
    return ", ".join(number(v, 2) for v in x + 0.0)
