"""Search for the motion that tells most of the base parameters: the merit as large as the room of the robot lets it be.

What is made small is  -merit  with multipliers of all limits at some hundred instants (``motion_edges``), by SciPy's L-BFGS-B;
multipliers follow, the pull ρ grows, and a last round looks at more instants. Coefficients z are scaled so that each of them
alone moves a joint by 1, in shares of its limits (root mean square). Slopes by the states are central differences of torques
and regressor, one joint displaced at a time, all instants in one call; slopes by z follow, as states are linear in z.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..typing import Array
from .motion_edges import Edges, Round
from .motion_information import MotionInformation
from .motion_room import DENSE, MotionRoom
from .rest_series import RestSeries

_PER_PERIOD = 32
"""Instants per period of the highest harmonic at which limits are looked at in the search."""
_FINER = 10
"""Times as many, at least, at which a motion is judged in the end."""
_MARGIN = 1e-4
"""Share of each limit that is left: what may happen between those."""
_ROUNDS = (Round(5.0, 60), Round(20.0, 50), Round(80.0, 50), Round(320.0, 50), Round(1000.0, 30, 2))
_REPAIRS = 6
"""Times that a motion which passes a limit between the instants of the search is asked to stay farther from it."""
_STEP = 1e-5
"""By which states are displaced."""
_STARTS = 20
"""Random motions of which a search begins at the best."""
_TRIES = 400
_NARROW = 0.02
"""Share of a motion's width, below which it is none."""
_HALVINGS = 12

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
    def _bases(self) -> dict[int, Array]:
        return {}

    @property
    def _fine(self) -> int:
        return max(_FINER, math.ceil(self.series.duration / (DENSE * _PER_PERIOD * self.series.harmonics)))

    def _basis(self, finer: int) -> Array:
        """(3, n, K) at the instants of the search, or as many times finer ones."""
        if finer not in self._bases:
            count = finer * _PER_PERIOD * self.series.harmonics + 1
            self._bases[finer] = self.series.basis(np.linspace(0.0, self.series.duration, count))
        return self._bases[finer]

    @cached_property
    def _units(self) -> Array:
        """(nv, K, K) coefficients of unit z: [Φ / q, Φ' / dq, Φ'' / ddq] / sqrt(n) = U S V', units V / S; q_0 apart."""
        found = np.zeros((self.typical.shape[1], self.series.count, self.series.count))
        basis = self._basis(1)
        for j, sizes in enumerate(self.typical.T):
            stacked = (basis[:, :, 1:] / sizes[:, None, None]).reshape(-1, self.series.count - 1)
            _, s, Vt = np.linalg.svd(stacked / np.sqrt(basis.shape[1]), full_matrices=False)
            found[j, 0, 0] = sizes[0]
            found[j, 1:, 1:] = Vt.T / s
        return found

    def coefficients(self, z: Array) -> Array:
        """(nv, K) of the series, from (nv, K) scaled ones."""
        found = np.einsum("jkl,jl->jk", self._units, z)
        found[:, 0] += self.middle
        return np.asarray(found)

    def _states(self, z: Array, finer: int = 1) -> Array:
        """(3, n, nv) positions, velocities and accelerations."""
        return np.asarray(self._basis(finer) @ self.coefficients(z).T)

    def merit(self, z: Array) -> float:
        """What is made large, at the instants of the search."""
        return self.information.merit(self.information.rows(*self._states(z)))

    # ── motions that fit ──

    def random(self, rng: np.random.Generator) -> Array | None:
        """A random motion (nv, K) as wide as its limits let it be, at the instants of the search; None after many tries."""
        for _ in range(_TRIES):
            z = rng.normal(size=(len(self.middle), self.series.count))
            z[:, 0] = rng.uniform(-0.6, 0.6, len(z))
            if (found := self.fitted(z, widen=True, finer=1)) is not None:
                return found
        return None

    def fitted(self, z: Array, *, widen: bool = False, finer: int | None = None) -> Array | None:
        """The motion with each joint as narrow as its own limits ask for, then all together as the others do; None if none is.

        Parameters
        ----------
        z : (nv, K) array
        widen : bool, whether joints are made wider, too
        finer : int, times as many instants as the search's; None: those at which a motion is judged in the end

        Returns
        -------
        z : (nv, K) array or None
        """
        finer = self._fine if finer is None else finer
        q, dq, ddq = self._states(z, finer)
        rest, bounds = self.coefficients(z)[:, 0], self.room.bounds
        with np.errstate(divide="ignore", invalid="ignore"):
            wide = [
                (bounds.upper - rest) / np.maximum((q - rest).max(axis=0), 1e-12),
                (rest - bounds.lower) / np.maximum((rest - q).max(axis=0), 1e-12),
                bounds.velocity / np.abs(dq).max(axis=0),
                bounds.acceleration / np.abs(ddq).max(axis=0),
            ]
        share = (1.0 - 2.0 * _MARGIN) * np.min(wide, axis=0)
        if not (share > _NARROW * 1e-3).all():
            return None
        z = z.copy()
        z[:, 1:] *= (share if widen else np.minimum(share, 1.0))[:, None]
        return self._together(z, finer)

    def _together(self, z: Array, finer: int) -> Array | None:
        """The motion as much narrower about where it rests as all limits ask for; None where it cannot rest there."""

        def narrowed(share: float) -> Array:
            found = z.copy()
            found[:, 1:] *= share
            return found

        def fits(share: float) -> bool:
            return self.room.least(*self._states(narrowed(share), finer)) >= _MARGIN

        rests = np.stack([self.coefficients(z)[None, :, 0], *np.zeros((2, 1, len(z)))])
        if self.room.least(*rests) < _MARGIN:
            return None
        if fits(1.0):
            return z
        if not fits(_NARROW):
            return None
        low, high = _NARROW, 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            low, high = (share, high) if fits(share) else (low, share)
        return narrowed(low)

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
        start = max(starts, key=self.merit)
        most = sum(round_.steps for round_ in _ROUNDS)
        z, edges, done = start, self._edges(start), 0
        for round_ in _ROUNDS:
            edges = replace(edges, rho=round_.rho).at(round_.finer)
            z = self._descended(z, edges, round_.steps, lambda k, done=done: told((done + k) / most))  # type: ignore[misc]
            edges = edges.followed(self._shares(z, edges.finer))
            done += round_.steps
        for _ in range(_REPAIRS):
            beyond = _MARGIN - self.room.least(*self._states(z, self._fine))
            if beyond <= 0.0:
                break
            edges = replace(edges, aim=edges.aim + 1.5 * beyond)
            z = self._descended(z, edges, _ROUNDS[-1].steps, lambda _: None)
            edges = edges.followed(self._shares(z, edges.finer))
        fits = [found for found in (self.fitted(z), self.fitted(start)) if found is not None]
        told(1.0)
        return max(fits, key=self.merit, default=None)

    def _edges(self, z: Array) -> Edges:
        """Edges of which none holds anything yet."""
        return Edges(tuple(np.zeros_like(s) for s in self._shares(z, 1)))

    def _shares(self, z: Array, finer: int) -> tuple[Array, ...]:
        """Distances from all edges at the instants of the search."""
        states = self._states(z, finer)
        values = (*states, self.room.smooth_torques(*states), self.room.clearances(states[0]))
        return tuple(band.shares(x) for band, x in zip(self.room.bands, values, strict=True))

    def _descended(self, z: Array, edges: Edges, steps: int, told: Callable[[int], None]) -> Array:
        from scipy.optimize import minimize

        count = 0

        def tick(_: Array) -> None:
            nonlocal count
            count += 1
            told(count)

        def cost(x: Array) -> tuple[float, Array]:
            value, slope = self.cost_and_slope(x.reshape(z.shape), edges)
            return value, slope.ravel()

        options: Any = {"maxiter": steps, "maxcor": 30, "ftol": 1e-9, "gtol": 1e-4}
        called: Any = tick  # the stubs of SciPy know no callback of arrays of any rank
        found = minimize(cost, z.ravel(), jac=True, method="L-BFGS-B", callback=called, options=options)
        return np.asarray(found.x.reshape(z.shape))

    def cost_and_slope(self, z: Array, edges: Edges) -> tuple[float, Array]:
        """-merit with the edges' part, and its derivative by z (nv, K)."""
        states = self._states(z, edges.finer)
        merit, G = self.information.merit_and_slope(self.information.rows(*states))
        values = (*states, self.room.smooth_torques(*states), self.room.clearances(states[0]))
        cost, slopes = -merit, list[Array]()
        for band, x, m in zip(self.room.bands, values, edges.multipliers, strict=True):
            value, forces = edges.pushed(band.shares(x), m)
            cost += value
            slopes.append(band.slope(-forces))
        by_states = np.stack(slopes[:3]) + self._slopes(states, -G, slopes[3])
        by_states[0] += self.room.clearance_slopes(states[0], slopes[4])
        by_coefficients = np.einsum("mnj,mnk->jk", by_states, self._basis(edges.finer))
        return cost, np.einsum("jk,jkl->jl", by_coefficients, self._units)

    def _slopes(self, states: Array, of_rows: Array, of_torques: Array) -> Array:
        """(3, n, nv) derivatives by the states of Σ of_rows · W + Σ of_torques · τ, each instant for itself."""
        found = self.information.drive_slopes(states, of_rows)
        n, nv = states.shape[1:]
        weigh = self.information.weighing(of_rows, 6)
        for j in range(nv):
            moved = np.repeat(states[:, None], 6, axis=1)  # forth and back in q_j, dq_j and ddq_j
            for m in range(3):
                moved[m, 2 * m, :, j] += _STEP
                moved[m, 2 * m + 1, :, j] -= _STEP
            q, dq, ddq = moved.reshape(3, 6 * n, nv)
            tau = self.room.smooth_torques(q, dq, ddq).reshape(6, n, nv)
            value = weigh(q, dq, ddq) + np.einsum("snj,nj->sn", tau, of_torques)
            found[:, :, j] += (value[::2] - value[1::2]) / (2.0 * _STEP)
        return found
