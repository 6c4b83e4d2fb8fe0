"""The largest payload over a slice of the workspace, from sampled configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import number, printed
from ..errors import UnknownNameError, ValueRangeError
from ..typing import Array
from .payload import largest_payload
from .torque_limits import require_fixed_base

if TYPE_CHECKING:
    from ..robot import Robot

SLICES = {"xz": (0, 2, 1), "yz": (1, 2, 0), "xy": (0, 1, 2)}
"""The two axes of a plane slice, and the one across it; beside them "rz" is radius and height, any direction around z."""
_CHUNK = 1 << 15
_CELLS, _PER_CELL = (8, 60), 40
"""Cells along the longer side, and configurations for each cell of a square; slices fill half of theirs, as arms go."""


@dataclass(frozen=True, eq=False)
class PayloadMap:
    """Payload map: largest payloads of the sampled configurations whose tip falls in each cell of a slice of the workspace.

    Sampling bounds: the true best of a cell is at least ``best``, the true worst at most ``worst``. No inverse
    kinematics is involved, so an empty cell may still be reachable by configurations that were not drawn.
    """

    plane: str
    """"xz", "yz", "xy" or "rz"."""
    across: float
    """Where the slice lies on the axis across it [m]; 0 for "rz"."""
    thickness: float
    """Of the slice [m]; inf for "rz", which has none."""
    edges: tuple[Array, Array]
    """Cell borders along both axes, (nx + 1,) and (ny + 1,) m."""
    best: Array
    """(ny, nx) kg: the largest payload over the cell's configurations; nan where no tip fell."""
    worst: Array
    """(ny, nx) kg: the least of their largest payloads."""
    count: Array
    """(ny, nx): how many configurations fell in the cell."""

    @property
    def samples(self) -> int:
        """How many configurations fell in the slice."""
        return int(self.count.sum())

    def __str__(self) -> str:
        filled = int((self.count > 0).sum())
        return (
            f"{self.plane} slice: {self.samples} configurations in {filled} cells of "
            f"{number(1e3 * float(np.diff(self.edges[0])[0]), 3)} mm, best {number(np.nanmax(self.best))} kg, "
            f"worst {number(np.nanmin(self.worst))} kg"
        )


def payload_map(
    robot: Robot,
    plane: str = "rz",
    *,
    at: float = 0.0,
    thickness: float = 0.1,
    cells: int | None = None,
    samples: int = 200_000,
    com: ArrayLike = (0.0, 0.0, 0.0),
    frame: str | None = None,
    limits: ArrayLike | None = None,
    rng: np.random.Generator | int | None = 0,
) -> PayloadMap:
    """Payload map: the best and worst :func:`largest_payload` in each cell of a slice of the workspace.

    Parameters
    ----------
    robot : Robot
    plane : "xz", "yz" or "xy" of the base frame, or "rz"
        A slab of ``thickness`` about ``at`` on the axis across it; "rz", the distance from the base's z axis and the
        height, wastes no sample.
    at : float, where the slab lies [m]
    thickness : float, of the slab [m]
    cells : int, optional, along the longer side
        If None as many as the configurations in the slice fill, 8 to 60, so that extremes are not those of a handful.
    samples : int, random configurations within the limits
    com : (3,) array_like, centre of mass of the payload in the frame [m]
    frame : str, optional, a link of the robot; its tip if None
    limits : (nv,) array_like, optional, torque limits that stand in for the robot's own [N m, sliding joints: N]
    rng : numpy Generator or seed

    Returns
    -------
    found : PayloadMap

    Raises
    ------
    ValueRangeError, UnknownNameError
        An argument is invalid, or as :func:`largest_payload`.

    Examples
    --------
    >>> import twistwrench as tw
    >>> found = payload_map(tw.robots.planar_2r(), "xz", cells=8, samples=4000, limits=[50.0, 20.0])
    >>> found.best.shape, bool(np.nanmax(found.best) > np.nanmin(found.worst))
    ((8, 8), True)
    """
    plane, samples = plane_and_samples(plane, samples)
    cells = None if cells is None else arguments.whole(cells, "cells", 1)
    thickness = arguments.positive(thickness, "thickness [m]")
    at = arguments.number(at, "at [m]")
    if not np.isfinite(at):
        raise ValueRangeError(f"at is {printed(at)}. Give where the slice lies on the axis across it [m].")
    require_fixed_base(robot, "a payload map")
    try:
        rng = np.random.default_rng(rng)
    except (TypeError, ValueError):
        raise ValueRangeError(f"rng={rng!r}: give a seed or a numpy Generator.") from None
    parts = []
    for begin in range(0, samples, _CHUNK):
        q = robot.random_configuration(rng, min(_CHUNK, samples - begin))
        p = np.asarray(robot.forward_kinematics(q, frame))[:, :3, 3]
        if plane == "rz":
            place = np.column_stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]])
        else:
            first, second, third = SLICES[plane]
            inside = np.abs(p[:, third] - at) <= 0.5 * thickness
            q, place = q[inside], p[inside][:, [first, second]]
        if len(q):
            parts.append(np.column_stack([place, largest_payload(robot, q, com, frame=frame, limits=limits).mass]))
    if not parts:
        raise ValueRangeError(
            f"none of {samples} configurations has its tip in the {plane} slice {printed(thickness)} m thick at "
            f"{printed(at)} m. Move the slice, make it thicker, or draw more samples."
        )
    found = np.concatenate(parts)
    if cells is None:
        fewest, most = _CELLS
        cells = int(np.clip(np.sqrt(len(found) / _PER_CELL), fewest, most))
    slab = (0.0, np.inf) if plane == "rz" else (at, thickness)
    edges, best, worst, count = _binned(found, cells)
    return PayloadMap(plane, *slab, edges, best, worst, count)


def plane_and_samples(plane: str, samples: int) -> tuple[str, int]:
    """Both as they have to be, before anything runs. Raises UnknownNameError, ValueRangeError."""
    if not isinstance(plane, str) or plane not in (*SLICES, "rz"):
        raise UnknownNameError.of("slice", plane, (*SLICES, "rz"))
    return plane, arguments.whole(samples, "samples", 1)


def _binned(found: Array, cells: int) -> tuple[tuple[Array, Array], Array, Array, Array]:
    """Rows (x, y, mass) into square cells: borders, largest, least, and how many."""
    low, high = found[:, :2].min(axis=0), found[:, :2].max(axis=0)
    size = max(float((high - low).max()), 1e-9) / cells
    nx, ny = (np.maximum(np.ceil((high - low) / size - 1e-9), 1)).astype(int)
    column = np.clip(((found[:, 0] - low[0]) / size).astype(int), 0, nx - 1)
    row = np.clip(((found[:, 1] - low[1]) / size).astype(int), 0, ny - 1)
    best, worst = np.full((ny, nx), -np.inf), np.full((ny, nx), np.inf)
    np.maximum.at(best, (row, column), found[:, 2])
    np.minimum.at(worst, (row, column), found[:, 2])
    count = np.zeros((ny, nx), int)
    np.add.at(count, (row, column), 1)
    best[count == 0] = worst[count == 0] = np.nan
    edges = (low[0] + size * np.arange(nx + 1), low[1] + size * np.arange(ny + 1))
    return edges, best, worst, count
