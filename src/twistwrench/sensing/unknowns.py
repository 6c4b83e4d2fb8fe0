"""What is asked of a log, and how its readings change with each."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..lie import so3
from ..screws.component_names import WRENCH
from ..typing import Array
from .log import ReadingLog
from .sensor import load_regressor

_NAMES = {
    "bias": tuple(f"bias {axis}" for axis in WRENCH),
    "load": ("mass", "m cx", "m cy", "m cz"),
    "inertia": ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"),
    "turn": ("turn x", "turn y", "turn z"),
    "drift": tuple(f"drift {axis}" for axis in WRENCH),
    "tilt": ("tilt 1", "tilt 2"),
    "delay": ("delay",),
}
_SIZES = {"bias": 1.0, "load": 1.0, "inertia": 0.1, "turn": 0.1, "drift": 1.0, "tilt": 0.1, "delay": 0.1}


@dataclass(frozen=True, eq=False)
class SensorState:
    """Where the unknowns that readings are not linear in stand."""

    mounting: Array = field(default_factory=lambda: np.eye(3))
    """R_fs (3, 3)."""
    tilt: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) turns the gravity of {w} that was given into the one that is there."""
    delay: float = 0.0
    """s by which readings come later than the poses of the same row."""
    load: Array | None = None
    """(10,) parameters, once there are any."""
    middle: float | None = None
    """s, the time at which a drifting bias is the one estimated; the middle of the log where none is given."""


@dataclass(frozen=True)
class Unknowns:
    """What is asked: bias unless known, mass and first moment always, and the rest if asked for.

    ``drift`` is a linear change of the bias, which is then that of the middle of the log; ``tilt`` turns gravity about two
    level axes of {w}; ``delay`` is the time by which readings are late.
    """

    bias: bool = True
    inertia: bool = False
    turn: bool = False
    drift: bool = False
    tilt: bool = False
    delay: bool = False

    @property
    def kinds(self) -> tuple[str, ...]:
        """The groups asked, in the order of their columns."""
        return tuple(kind for kind in _NAMES if kind == "load" or getattr(self, kind))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns of the design, in order."""
        return tuple(name for kind in self.kinds for name in _NAMES[kind])

    @property
    def scales(self) -> Array:
        """A size (p,) for each unknown that makes them comparable."""
        return np.concatenate([np.full(len(_NAMES[kind]), _SIZES[kind]) for kind in self.kinds])

    @property
    def load(self) -> slice:
        """Where mass, first moment (and inertia) are."""
        start = 6 * self.bias
        return slice(start, start + 4 + 6 * self.inertia)

    @property
    def curved(self) -> bool:
        """Whether readings are not linear in some of them."""
        return self.turn or self.tilt or self.delay

    def part(self, kind: str) -> slice:
        """Where the unknowns of one group are."""
        before = self.kinds[: self.kinds.index(kind)]
        start = sum(len(_NAMES[k]) for k in before)
        return slice(start, start + len(_NAMES[kind]))

    def design(self, log: ReadingLog, factor: float, state: SensorState) -> Array:
        """A (n, 6, p): how readings change with the unknowns; those of turn, tilt and delay are zero without a load."""
        g = log.gravity if not self.tilt else _tilted(log, state.tilt)
        Y = factor * load_regressor(g, log.V, log.dV)  # F_f = Y π
        dY = None
        if self.delay:
            Y, dY = _late(Y, clock(log), state.delay)
        Y = _in_sensor(Y, state.mounting)
        columns = {"bias": np.broadcast_to(np.eye(6), (len(log), 6, 6)), "load": Y[..., :4], "inertia": Y[..., 4:]}
        load = np.zeros(10) if state.load is None else state.load
        if self.turn:  # R exp([δ]): the wrench in the turned axes changes by F × δ
            F = Y @ load
            columns["turn"] = np.concatenate([so3.hat(F[:, :3]), so3.hat(F[:, 3:])], axis=1)
        if self.drift:  # b + ḃ (t - t_middle)
            columns["drift"] = drifts(log, state.middle)
        if self.tilt:  # g = R' exp([δ]) g_w: it changes by R' (δ × g_w)
            turned = [factor * load_regressor(dg) @ load for dg in _tilts(log, state.tilt)]
            columns["tilt"] = _in_sensor(np.stack(turned, axis=-1), state.mounting)
        if dY is not None:  # F(t - d) changes by -Ḟ
            columns["delay"] = -_in_sensor(dY, state.mounting) @ load[:, None]
        return np.concatenate([columns[kind] for kind in self.kinds], axis=-1)

    def moved(self, state: SensorState, log: ReadingLog, x: Array) -> SensorState:
        """The state after a step x (p,) of Gauss and Newton."""
        load = np.concatenate([x[self.load], np.zeros(10 - len(x[self.load]))])
        mounting, tilt, delay = state.mounting, state.tilt, state.delay
        if self.turn:
            mounting = mounting @ so3.exp(x[self.part("turn")])
        if self.tilt:
            tilt = so3.exp(x[self.part("tilt")] @ level_axes(log)) @ tilt
        if self.delay:
            delay = delay + float(x[self.part("delay")][0])
        return SensorState(mounting, tilt, delay, load, state.middle)


def clock(log: ReadingLog) -> Array:
    """Times (n,) of the readings [s], or their numbers where no time was logged."""
    return np.arange(float(len(log))) if log.time is None else log.time


def drifts(log: ReadingLog, middle: float | None = None) -> Array:
    """Columns (n, 6, 6) of a bias that changes linearly, and is none in the middle."""
    t = clock(log)
    return np.asarray((t - (0.5 * (t[0] + t[-1]) if middle is None else middle))[:, None, None] * np.eye(6))


def level_axes(log: ReadingLog) -> Array:
    """(2, 3) the two axes of {w} that are most level, about which a base may be tilted."""
    g = np.abs(_world_gravity(log)[0])
    return np.eye(3)[np.sort(np.argsort(g)[:2])]


def _world_gravity(log: ReadingLog) -> Array:
    R = np.broadcast_to(np.eye(3), (len(log), 3, 3)) if log.rotations is None else log.rotations
    return np.asarray((R @ log.gravity[..., None])[..., 0])


def _tilted(log: ReadingLog, tilt: Array) -> Array:
    R = np.broadcast_to(np.eye(3), (len(log), 3, 3)) if log.rotations is None else log.rotations
    return np.asarray((np.swapaxes(R, 1, 2) @ (_world_gravity(log) @ tilt.T)[..., None])[..., 0])


def _tilts(log: ReadingLog, tilt: Array) -> list[Array]:
    R = np.broadcast_to(np.eye(3), (len(log), 3, 3)) if log.rotations is None else log.rotations
    g = _world_gravity(log) @ tilt.T
    return [(np.swapaxes(R, 1, 2) @ so3.cross(axis, g)[..., None])[..., 0] for axis in level_axes(log)]


def _late(Y: Array, t: Array, delay: float) -> tuple[Array, Array]:
    """Y (n, 6, 10) a delay earlier, and its rate, by cubic splines through the readings' times."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(t, Y)
    return np.asarray(spline(t - delay)), np.asarray(spline(t - delay, 1))


def _in_sensor(Y: Array, mounting: Array) -> Array:
    """Columns of wrenches (n, 6, k) in {f} in the sensor's axes: F_s = R_fs' F_f."""
    return np.concatenate([mounting.T @ Y[:, :3], mounting.T @ Y[:, 3:]], axis=1)
