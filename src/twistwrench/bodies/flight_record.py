"""A recorded free motion, and how far its invariants drifted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..core.printed_numbers import number, percent, printed, residual
from ..typing import Array

_LARGE_TURN, _LARGE_LOSS = 1.0, 0.01
"""rad a step, and share of the energy, from which flights of a box were seen to go astray within some turns."""


@dataclass(frozen=True)
class Drift:
    """How far a flight is from what mechanics keeps: momentum less impulse, energy less work. All relative; 0 is exact."""

    momentum: float
    """Largest change of the spatial momentum about the origin of {s}, over the largest of the terms it is made of."""
    energy: float
    """Largest change of the kinetic energy, over its largest value."""
    energy_trend: float
    """The part of that which grows: the slope of the straight line through it, times the duration."""
    rotation: float
    """Largest entry of RᵀR − 1 over all poses."""
    remarks: tuple[str, ...] = ()
    """Steps too large to be trusted, or other than asked for, in words; see :func:`fly`."""

    def __str__(self) -> str:
        return "; note: ".join(
            (
                f"momentum {residual(self.momentum)}, energy {residual(self.energy)} (trend "
                f"{printed(self.energy_trend, 2, signed=True)}), rotation {residual(self.rotation)}",
                *self.remarks,
            )
        )


@dataclass(frozen=True, eq=False, repr=False)
class Flight:
    """A recorded free motion: n + 1 states, the first at time 0. Printing it says how many, and what drifted."""

    times: Array
    """(n + 1,) [s]."""
    poses: Array
    """(n + 1, 4, 4), T_sb."""
    twists: Array
    """(n + 1, 6), of the body in {b}, angular part first [rad/s, m/s]."""
    momentum: Array
    """(n + 1, 6), Ad(T_bs)ᵀ G V about the origin of {s} [N m s, N s], from the poses and twists above."""
    energy: Array
    """(n + 1,), ½ Vᵀ G V [J]."""
    impulse: Array
    """(n + 1, 6), of the wrench so far, about the origin of {s} [N m s, N s]."""
    work: Array
    """(n + 1,), of the wrench so far [J]."""
    dt: float = np.nan
    """s: the step asked for."""
    step: float = np.nan
    """s: the step taken, or with a tolerance the spacing of the record; the duration is a whole number of them."""
    turn: float = 0.0
    """rad: the largest turn in one step; 0 where steps adapt, or are exact."""
    unseen: str = ""
    """What the wrench does within steps that the method does not see, in words; empty if nothing."""
    drift: Drift = field(init=False)
    """How far the flight is from what mechanics keeps."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """What to know before the flight is used, in words; empty if nothing. Those of :attr:`drift`."""
        return self.drift.remarks

    def __repr__(self) -> str:
        steps = "" if np.isnan(self.step) else f", steps of {number(self.step, 6)} s"
        return f"Flight of {printed(self.times[-1])} s: {len(self.times)} states{steps}; drift: {self.drift}"

    def __post_init__(self) -> None:
        R, p = self.poses[:, :3, :3], self.poses[:, :3, 3]
        l, f = self.momentum[:, :3], self.momentum[:, 3:]
        dP = self.momentum - self.impulse - self.momentum[0]
        terms = np.abs(l).max() + np.abs(p).max() * np.abs(f).max(), np.abs(f).max()
        moved = (np.abs(dP[:, :3]).max(), np.abs(dP[:, 3:]).max())
        momentum = max(float(d / s) if s else 0.0 for d, s in zip(moved, terms, strict=True))
        scale = float(self.energy.max()) or 1.0
        dE = (self.energy - self.work - self.energy[0]) / scale
        t = self.times / self.times[-1] - 0.5
        trend = float((t - t.mean()) @ dE / ((t - t.mean()) @ t))
        rotation = float(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max())
        lost = float(np.abs(dE).max())
        remarks = tuple(self._remarks(lost))
        object.__setattr__(self, "drift", Drift(momentum, lost, trend, rotation, remarks))

    def _remarks(self, lost: float) -> Iterator[str]:
        if abs(self.step - self.dt) > 1e-9 * self.dt:
            yield (
                f"steps of {number(self.step, 6)} s, not {number(self.dt, 6)} s, so that a whole number fills "
                f"{printed(self.times[-1])} s"
            )
        if self.turn > _LARGE_TURN:
            yield (
                f"dt is too large to trust the motion: the body turns up to {number(self.turn, 3)} rad in a step; keep it "
                "below 1"
            )
        if self.unseen:
            yield self.unseen
        if lost > _LARGE_LOSS:
            yield f"the energy is off by {percent(lost, 2)}, so the motion is wrong: take a smaller dt, or a tolerance"
