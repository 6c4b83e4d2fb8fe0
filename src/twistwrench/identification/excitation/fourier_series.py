"""Windowed Fourier series with rest at both ends.

With ω = 2π / T and k = 1 … N, each joint moves as

    q(t) = q_0 + Σ_k a_k (sin kωt - p_k(t)) + b_k (cos kωt - r_k(t))

where p_k and r_k are fifth-order polynomials with the value, rate and acceleration of the sine or cosine at 0 and T.
So q = q_0 and dq = ddq = 0 at both ends.

Source: Swevers et al., "Optimal robot excitation and identification", IEEE T-RA 13(5), 1997, for the series; Park,
"Fourier-based optimal excitation trajectories for the dynamic identification of robots", Robotica 24(5), 2006, for the ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import polynomial

from ...core.typing import Array

_ORDER = 5
"""Order of the polynomials, which meet six conditions: three at each end."""


@dataclass(frozen=True)
class WindowedFourierSeries:
    """Basis functions of the motion of every joint: 1, then N sines and N cosines without their ends."""

    duration: float  # T [s]
    harmonics: int  # N

    @property
    def count(self) -> int:
        """Number of functions, 1 + 2 N."""
        return 1 + 2 * self.harmonics

    @cached_property
    def _rates(self) -> Array:
        """(N,) angular frequencies k ω T = 2π k of the sines and cosines as functions of x = t / T."""
        return 2.0 * np.pi * np.arange(1, self.harmonics + 1)

    @cached_property
    def _end_polynomials(self) -> Array:
        """(6, 2 N) coefficients of p_k, then of r_k, as polynomials in x = t / T."""
        w = self._rates
        n = self.harmonics
        powers = np.eye(_ORDER + 1)
        derivatives = [powers, polynomial.polyder(powers, 1), polynomial.polyder(powers, 2)]
        # rows: value, rate and acceleration at x = 0, then value, rate and acceleration at x = 1
        conditions_at_start = [polynomial.polyval(0.0, derivative) for derivative in derivatives]
        conditions_at_end = [polynomial.polyval(1.0, derivative) for derivative in derivatives]
        conditions = np.array(conditions_at_start + conditions_at_end)
        end_values = np.zeros((6, 2 * n))
        end_values[[1, 4], :n] = w  # rates of sines
        end_values[[0, 3], n:] = 1.0  # values of cosines
        end_values[[2, 5], n:] = -(w**2)  # accelerations of cosines
        return np.linalg.solve(conditions, end_values)

    def basis(self, t: Array) -> Array:
        """(3, n, 1 + 2 N) functions and their first and second derivatives at times (n,)."""
        t = np.asarray(t, float)
        x = np.clip(t / self.duration, 0.0, 1.0)
        w = self._rates
        angles = np.outer(x, w)
        sin, cos = np.sin(angles), np.cos(angles)
        basis = np.zeros((3, len(x), self.count))
        basis[0, :, 0] = 1.0
        wave_derivatives = (  # of sines and of cosines by x
            (sin, cos),
            (cos * w, -sin * w),
            (-sin * w**2, -cos * w**2),
        )
        polynomials = self._end_polynomials
        for order, (of_sine, of_cosine) in enumerate(wave_derivatives):
            waves = np.concatenate([of_sine, of_cosine], axis=1)
            basis[order, :, 1:] = waves - polynomial.polyval(x, polynomials).T
            basis[order] /= self.duration**order  # derivatives by t instead of x
            polynomials = polynomial.polyder(polynomials)
        is_at_rest = (t <= 0.0) | (t >= self.duration)
        basis[:, is_at_rest, 1:] = 0.0
        return basis
