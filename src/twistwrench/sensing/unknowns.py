"""Unknowns of a sensor's fit: bias, load, inertia, mounting, drift, tilt of gravity and delay, and their design matrix."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from ..core.typing import Array
from ..mechanics.lie import so3
from ..mechanics.lie.labelled import WRENCH
from .log import ReadingLog
from .sensor import load_regressor

_NAMES_BY_KIND = {
    "bias": tuple(f"bias {axis}" for axis in WRENCH),
    "load": ("mass", "m cx", "m cy", "m cz"),
    "inertia": ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"),
    "turn": ("turn x", "turn y", "turn z"),
    "drift": tuple(f"drift {axis}" for axis in WRENCH),
    "tilt": ("tilt 1", "tilt 2"),
    "delay": ("delay",),
}
"""Names of the unknowns of each kind, in the order of their columns."""
MAX_DELAY = 0.5
"""Longest delay [s] that is tried."""
_SCALE_BY_KIND = {"bias": 1.0, "load": 1.0, "inertia": 0.1, "turn": 0.1, "drift": 1.0, "tilt": 0.1, "delay": 0.1}
"""Typical size of the unknowns of each kind, in their SI units."""


@dataclass(frozen=True, eq=False)
class SensorState:
    """Values of the unknowns on which readings depend nonlinearly."""

    mounting: Array = field(default_factory=lambda: np.eye(3))
    """Rotation R_fs (3, 3)."""
    tilt: Array = field(default_factory=lambda: np.eye(3))
    """Rotation (3, 3) from the given to the actual gravity, in {w}."""
    delay: float = 0.0
    """Delay of the reading in a row after the pose in this row [s]."""
    load: Array | None = None
    """Parameters (10,) of the load; None until they are estimated."""
    middle: float | None = None
    """Time [s] to which a drifting bias refers; the middle of the log if None."""


@dataclass(frozen=True)
class Unknowns:
    """Unknowns of a fit: mass and first moment always, the bias unless it is known, others if requested.

    ``drift`` is a linear change of the bias, which then refers to the middle of the log. ``tilt`` rotates gravity about
    two level axes of {w}. ``delay`` is the delay of readings after poses.
    """

    bias: bool = True
    inertia: bool = False
    turn: bool = False
    drift: bool = False
    tilt: bool = False
    delay: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the unknowns, in the order of their columns."""
        return tuple(kind for kind in _NAMES_BY_KIND if kind == "load" or getattr(self, kind))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of the design, in order."""
        return tuple(chain.from_iterable(_NAMES_BY_KIND[kind] for kind in self.kinds))

    @property
    def scales(self) -> Array:
        """Typical sizes (p,) of the unknowns, which make these comparable."""
        return np.concatenate([np.full(len(_NAMES_BY_KIND[kind]), _SCALE_BY_KIND[kind]) for kind in self.kinds])

    @property
    def load(self) -> slice:
        """Columns of mass and first moment, and of the inertia if it is unknown."""
        start = 6 if self.bias else 0
        count = 10 if self.inertia else 4
        return slice(start, start + count)

    @property
    def nonlinear_columns(self) -> Array:
        """Columns (k,) of unknowns on which readings depend nonlinearly."""
        columns: list[int] = []
        for kind in ("turn", "tilt", "delay"):
            if getattr(self, kind):
                kind_columns = self.part(kind)
                columns += range(kind_columns.start, kind_columns.stop)
        return np.array(columns, int)

    def part(self, kind: str) -> slice:
        """Columns of the unknowns of one kind."""
        earlier_kinds = self.kinds[: self.kinds.index(kind)]
        start = sum(len(_NAMES_BY_KIND[earlier_kind]) for earlier_kind in earlier_kinds)
        return slice(start, start + len(_NAMES_BY_KIND[kind]))

    def design(self, log: ReadingLog, factor: float, state: SensorState) -> Array:
        """Design matrix A (n, 6, p) of the readings; columns of turn, tilt and delay are zero without a load."""
        load = np.zeros(10) if state.load is None else state.load
        R, world_gravity = _world_gravity(log)
        world_gravity = world_gravity @ state.tilt.T
        gravity = log.gravity
        if self.tilt:
            gravity = (R @ world_gravity[..., None])[..., 0]
        Y = factor * load_regressor(gravity, log.V, log.dV)
        columns: dict[str, Array] = {}
        if self.delay:  # F(t - d) changes by -Ḟ
            from scipy.interpolate import CubicSpline

            spline = CubicSpline(log.clock, Y)
            pose_times = log.clock - state.delay
            Y = np.asarray(spline(pose_times))
            dY = np.asarray(spline(pose_times, 1))
            columns["delay"] = -_to_sensor_axes(dY, state.mounting) @ load[:, None]
        Y = _to_sensor_axes(Y, state.mounting)  # F_s = Y π
        columns["bias"] = np.broadcast_to(np.eye(6), (len(log), 6, 6))
        columns["load"] = Y[..., :4]
        columns["inertia"] = Y[..., 4:]
        if self.turn:  # R exp([δ]): the wrench in the turned axes changes by F × δ
            F = Y @ load
            columns["turn"] = np.concatenate([so3.hat(F[:, :3]), so3.hat(F[:, 3:])], axis=1)
        if self.drift:  # b + ḃ (t - t_middle)
            t = log.clock
            middle = state.middle
            if middle is None:
                middle = 0.5 * (t[0] + t[-1])
            columns["drift"] = (t - middle)[:, None, None] * np.eye(6)
        if self.tilt:  # g = R' exp([δ]) g_w: it changes by R' (δ × g_w)
            changes = []
            for axis in level_axes(log):
                world_change = so3.cross(axis, world_gravity)
                dg = (R @ world_change[..., None])[..., 0]
                changes.append(factor * load_regressor(dg) @ load)
            columns["tilt"] = _to_sensor_axes(np.stack(changes, axis=-1), state.mounting)
        return np.concatenate([columns[kind] for kind in self.kinds], axis=-1)

    def next_state(self, state: SensorState, log: ReadingLog, x: Array) -> SensorState:
        """State after a Gauss-Newton step x (p,)."""
        estimated_load = x[self.load]
        load = np.concatenate([estimated_load, np.zeros(10 - len(estimated_load))])
        mounting, tilt, delay = state.mounting, state.tilt, state.delay
        if self.turn:
            mounting = mounting @ so3.exp(x[self.part("turn")])
        if self.tilt:
            tilt = so3.exp(x[self.part("tilt")] @ level_axes(log)) @ tilt
        if self.delay:
            change = float(x[self.part("delay")][0])
            delay = float(np.clip(delay + change, -MAX_DELAY, MAX_DELAY))
        return SensorState(mounting, tilt, delay, load, state.middle)


def level_axes(log: ReadingLog) -> Array:
    """The two most level coordinate axes of {w}, (2, 3), about which a base may be tilted."""
    _, gravity = _world_gravity(log)
    most_level = np.argsort(np.abs(gravity[0]))[:2]  # with the smallest components of gravity
    return np.eye(3)[np.sort(most_level)]


def _world_gravity(log: ReadingLog) -> tuple[Array, Array]:
    """R_fw (n, 3, 3), and gravity (n, 3) in {w}; {w} is {f} if no orientations were logged."""
    R_wf = log.rotations
    if R_wf is None:
        R_wf = np.broadcast_to(np.eye(3), (len(log), 3, 3))
    world_gravity = (R_wf @ log.gravity[..., None])[..., 0]
    return np.swapaxes(R_wf, 1, 2), np.asarray(world_gravity)


def _to_sensor_axes(Y: Array, mounting: Array) -> Array:
    """Transform columns of wrenches (n, 6, k) from {f} to the sensor's axes: F_s = R_fs' F_f."""
    moments = mounting.T @ Y[:, :3]
    forces = mounting.T @ Y[:, 3:]
    return np.concatenate([moments, forces], axis=1)
