"""Fourier series that begin and end at rest: what exciting motions are made of.

With ω = 2π / T and k = 1 … N, each joint moves as

    q(t) = q_0 + Σ_k a_k (sin kωt - p_k(t)) + b_k (cos kωt - r_k(t))

where p_k and r_k are the polynomials of fifth order that have value, rate and acceleration of their sine or cosine at 0 and
at T. So q = q_0 and dq = ddq = 0 at both ends.

Source: Swevers et al., "Optimal robot excitation and identification", IEEE T-RA 13(5), 1997, for the series; Park,
"Fourier-based optimal excitation trajectories for the dynamic identification of robots", Robotica 24(5), 2006, for the ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial

from ..typing import Array

_ORDER = 5
"""Of the polynomials: six conditions, three at each end."""


@dataclass(frozen=True)
class RestSeries:
    """Functions of time that every joint's motion is a sum of: 1, then N sines and N cosines without their ends.

    Attributes
    ----------
    duration : float, T [s]
    harmonics : int, N
    """

    duration: float
    harmonics: int

    @property
    def count(self) -> int:
        """1 + 2 N."""
        return 1 + 2 * self.harmonics

    @cached_property
    def _rates(self) -> Array:
        """(N,) k ω T, of x = t / T."""
        return 2.0 * np.pi * np.arange(1, self.harmonics + 1)

    @cached_property
    def _ends(self) -> Array:
        """(6, 2 N) coefficients of p_k and r_k in x = t / T."""
        w, n = self._rates, self.harmonics
        powers = np.eye(_ORDER + 1)
        derivatives = [polynomial.polyder(powers, m) if m else powers for m in range(3)]
        conditions = np.array([polynomial.polyval(x, d) for x in (0.0, 1.0) for d in derivatives])
        wanted = np.zeros((6, 2 * n))
        wanted[[1, 4], :n] = w
        wanted[[0, 3], n:] = 1.0
        wanted[[2, 5], n:] = -(w**2)
        return np.linalg.solve(conditions, wanted)

    def basis(self, t: Array) -> Array:
        """Functions and their first and second rates at times.

        Parameters
        ----------
        t : (n,) array [s]; before 0 and after T all rest

        Returns
        -------
        basis : (3, n, 1 + 2 N) array

        Examples
        --------
        >>> found = RestSeries(10.0, 3).basis(np.array([0.0, 10.0]))
        >>> bool(np.abs(found[:, :, 1:]).max() < 1e-12), found[0, :, 0].tolist()
        (True, [1.0, 1.0])
        """
        t = np.asarray(t, float)
        x, w = np.clip(t / self.duration, 0.0, 1.0), self._rates
        sin, cos = np.sin(np.outer(x, w)), np.cos(np.outer(x, w))
        found = np.zeros((3, len(x), self.count))
        found[0, :, 0] = 1.0
        waves = ((sin, cos), (cos * w, -sin * w), (-sin * w**2, -cos * w**2))
        for m, (of_sine, of_cosine) in enumerate(waves):
            ends = polynomial.polyder(self._ends, m) if m else self._ends
            found[m, :, 1:] = np.concatenate([of_sine, of_cosine], axis=1) - polynomial.polyval(x, ends).T
            found[m] /= self.duration**m
        found[:, (t <= 0.0) | (t >= self.duration), 1:] = 0.0
        return found

    def states(self, coefficients: Array, t: Array) -> tuple[Array, Array, Array]:
        """States of joints at times.

        Parameters
        ----------
        coefficients : (nv, 1 + 2 N) array
        t : (n,) array [s]

        Returns
        -------
        q, dq, ddq : (n, nv) arrays

        Examples
        --------
        >>> q, dq, ddq = RestSeries(10.0, 1).states(np.array([[0.5, 0.1, 0.2]]), np.array([0.0, 5.0]))
        >>> round(float(q[0, 0]), 12), float(dq[0, 0])
        (0.5, 0.0)
        """
        q, dq, ddq = self.basis(t) @ coefficients.T
        return q, dq, ddq
