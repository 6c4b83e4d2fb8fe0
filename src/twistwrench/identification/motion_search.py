"""Search for the motion that tells most of the base parameters: log det A as large as the room of the robot lets it be.

What is made small is  -log det A + μ B  with B the barrier of all limits at some hundred instants, for μ that falls, by SciPy's
L-BFGS-B. Coefficients z are scaled so that each of them alone moves a joint by 1, in shares of its limits (root mean square).
Slopes by the states are central differences of the rows' columns and the torques, one joint displaced at a time, all instants
in one call; slopes by z follow from them, as states are linear in z.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..typing import Array
from .motion_information import MotionInformation
from .motion_room import MotionRoom
from .rest_series import RestSeries

_PER_PERIOD = 40
"""Instants per period of the highest harmonic at which limits are looked at in the search."""
_FINER = 8
"""Times as many at which a motion is judged in the end."""
_MARGIN = 1e-4
"""Share of each limit that is left: what may happen between those."""
_STAGES = ((2.0, 0.05, 100), (0.4, 0.01, 150), (0.08, 0.002, 250))
"""μ, the width below which the barrier is a parabola, and the most steps."""
_STEP = 1e-5
"""By which states are displaced."""
_STARTS = 60
"""Random motions of which a search begins at the best."""
_TRIES = 400
_SHRINK = 0.99
_INSIDE = 0.95
"""Share of a random motion that a search begins with, about the place where it rests."""

Told = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class MotionSearch:
    """Search among motions of one robot.

    Attributes
    ----------
    series : RestSeries
    information : MotionInformation
    room : MotionRoom
    typical : (3, nv) array, sizes of positions, velocities and accelerations
    middle : (nv,) array, where joints are in the middle of their limits
    """

    series: RestSeries
    information: MotionInformation
    room: MotionRoom
    typical: Array
    middle: Array

    @cached_property
    def _basis(self) -> Array:
        """(3, n, K) at the instants of the search."""
        return self.series.basis(self._instants(1))

    @cached_property
    def _fine_basis(self) -> Array:
        return self.series.basis(self._instants(_FINER))

    def _instants(self, finer: int) -> Array:
        return np.linspace(0.0, self.series.duration, finer * _PER_PERIOD * self.series.harmonics + 1)

    @cached_property
    def _units(self) -> Array:
        """(nv, K, K) coefficients of unit z: [Φ / q, Φ' / dq, Φ'' / ddq] / sqrt(n) = U S V', units V / S; q_0 apart."""
        found = np.zeros((self.typical.shape[1], self.series.count, self.series.count))
        n = self._basis.shape[1]
        for j, sizes in enumerate(self.typical.T):
            stacked = (self._basis[:, :, 1:] / sizes[:, None, None]).reshape(-1, self.series.count - 1) / np.sqrt(n)
            _, s, Vt = np.linalg.svd(stacked, full_matrices=False)
            found[j, 0, 0] = sizes[0]
            found[j, 1:, 1:] = Vt.T / s
        return found

    def coefficients(self, z: Array) -> Array:
        """(nv, K) of the series, from (nv, K) scaled ones."""
        found = np.einsum("jkl,jl->jk", self._units, z)
        found[:, 0] += self.middle
        return np.asarray(found)

    def _states(self, z: Array, *, fine: bool = False) -> Array:
        """(3, n, nv) positions, velocities and accelerations."""
        return np.asarray((self._fine_basis if fine else self._basis) @ self.coefficients(z).T)

    def log_det(self, z: Array) -> float:
        """Log det A at the instants of the search."""
        return self.information.log_det(self.information.rows(*self._states(z)))

    def fits(self, z: Array, *, fine: bool = False) -> bool:
        """Whether all limits are kept, at the instants of the search or at finer ones."""
        return self.room.least(*self._states(z, fine=fine)) >= _MARGIN

    # ── random motions ──

    def random(self, rng: np.random.Generator) -> Array | None:
        """A random motion (nv, K) as wide as its limits let it be, at fine instants; None where there is none in many tries."""
        for _ in range(_TRIES):
            z = rng.normal(size=(len(self.middle), self.series.count))
            z[:, 0] = rng.uniform(-0.6, 0.6, len(z))
            if (found := self._fitted(z)) is not None:
                return found
        return None

    def _fitted(self, z: Array) -> Array | None:
        """The motion with each joint made as wide as its own limits let it be, then all together as torques do."""
        q, dq, ddq = self._states(z)
        rest = self.coefficients(z)[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            wide = [
                (self.room.bounds.upper - rest) / np.maximum((q - rest).max(axis=0), 1e-12),
                (rest - self.room.bounds.lower) / np.maximum((rest - q).max(axis=0), 1e-12),
                self.room.bounds.velocity / np.abs(dq).max(axis=0),
                self.room.bounds.acceleration / np.abs(ddq).max(axis=0),
            ]
        z = z.copy()
        z[:, 1:] *= np.min(wide, axis=0)[:, None]
        return self.shrunk(z)

    def shrunk(self, z: Array) -> Array | None:
        """The motion, as much narrower about where it rests as all limits ask for at fine instants; None where none is."""
        rest = self.coefficients(z)[None, :, 0]
        if self.room.least(rest, np.zeros_like(rest), np.zeros_like(rest)) < _MARGIN:
            return None
        z, coarse = z.copy(), True
        while np.abs(z[:, 1:]).max() > 1e-3:
            if self.fits(z, fine=not coarse):
                if not coarse:
                    return z
                coarse = False
                continue
            z[:, 1:] *= _SHRINK if coarse else 1.0 - (1.0 - _SHRINK) / 10.0
        return None

    # ── the search ──

    def best(self, rng: np.random.Generator, told: Told) -> Array | None:
        """The motion that a search from random ones comes to; None where no motion is possible."""
        starts = list[Array]()
        for _ in range(_STARTS):
            z = self.random(rng)
            if z is None:
                break
            starts.append(z)
        if not starts:
            return None
        start = max(starts, key=self.log_det)
        z = start.copy()
        z[:, 1:] *= _INSIDE
        most, done = sum(steps for *_, steps in _STAGES), 0
        for mu, width, steps in _STAGES:
            z = self._descended(z, mu, width, steps, lambda k, before=done: told((before + k) / most))  # type: ignore[misc]
            done += steps
        found = self.shrunk(z)
        told(1.0)
        return found if found is not None and self.log_det(found) > self.log_det(start) else start

    def _descended(self, z: Array, mu: float, width: float, steps: int, told: Callable[[int], None]) -> Array:
        from scipy.optimize import minimize

        count = 0

        def tick(_: Array) -> None:
            nonlocal count
            count += 1
            told(count)

        def cost(x: Array) -> tuple[float, Array]:
            value, slope = self.cost_and_slope(x.reshape(z.shape), mu, width)
            return value, slope.ravel()

        options: Any = {"maxiter": steps, "maxcor": 30, "ftol": 1e-8, "gtol": 1e-4}
        called: Any = tick  # the stubs of SciPy know no callback of arrays of any rank
        found = minimize(cost, z.ravel(), jac=True, method="L-BFGS-B", callback=called, options=options)
        return np.asarray(found.x.reshape(z.shape))

    def cost_and_slope(self, z: Array, mu: float, width: float) -> tuple[float, Array]:
        """-log det A + μ B, and its derivative by z (nv, K)."""
        states = self._states(z)
        W, reactions = self.information.rows(*states), self.room.smooth_reactions(*states)
        log_det, G = self.information.log_det_and_slope(W)
        barrier, of_reactions = self.room.reacting.barrier(reactions, width)
        by_states = self._slopes(states, -G.reshape(len(G), -1), mu * of_reactions)
        for m, band in enumerate(self.room.bands):
            value, slope = band.barrier(states[m], width)
            barrier += value
            by_states[m] += mu * slope
        by_coefficients = np.einsum("mnj,mnk->jk", by_states, self._basis)
        return mu * barrier - log_det, np.einsum("jk,jkl->jl", by_coefficients, self._units)

    def _slopes(self, states: Array, of_rows: Array, of_reactions: Array) -> Array:
        """(3, n, nv) derivatives by the states of Σ of_rows · W + Σ of_reactions · reactions, each instant for itself."""
        found = np.zeros(states.shape)
        n, nv = states.shape[1:]
        for j in range(nv):
            moved = np.repeat(states[:, None], 6, axis=1)  # forth and back in q_j, dq_j and ddq_j
            for m in range(3):
                moved[m, 2 * m, :, j] += _STEP
                moved[m, 2 * m + 1, :, j] -= _STEP
            q, dq, ddq = moved.reshape(3, 6 * n, nv)
            W = self.information.rows(q, dq, ddq).reshape(6, n, -1)
            reactions = self.room.smooth_reactions(q, dq, ddq).reshape(6, n, -1)
            value = np.einsum("snk,nk->sn", W, of_rows) + np.einsum("snk,nk->sn", reactions, of_reactions)
            found[:, :, j] = (value[::2] - value[1::2]) / (2.0 * _STEP)
        return found
