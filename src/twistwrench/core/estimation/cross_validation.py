"""Cross-validation: residuals of rows that were held out of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array

FOLDS = 5
"""Number of blocks of time that are held out, one after the other."""
_TINY_SIZE = 1e-300
"""Sum of squared torques in place of 0, as a divisor."""


@dataclass(frozen=True, eq=False)
class HeldOutRows:
    """Measured torques of held-out rows, and their predictions by a fit without these rows.

    Attributes
    ----------
    time : (n,) array [s], time within the log
    log : (n,) array, index of the log
    measured : (n, nv) array, low-passed torques
    predicted : (n, nv) array
    """

    time: Array
    log: Array
    measured: Array
    predicted: Array


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Relative residuals |τ - τ̂| / |τ| of held-out rows.

    Attributes
    ----------
    kind : str, ``test`` for separate logs, ``five-fold`` for fifths of the training logs
    squares : (nv,) array, sums of squared residuals by joint
    sizes : (nv,) array, sums of squared measured torques by joint
    names : sequence of str, joint names
    rows : tuple of HeldOutRows
    """

    kind: str
    squares: Array
    sizes: Array
    names: Sequence[str]
    rows: tuple[HeldOutRows, ...] = ()

    @classmethod
    def from_rows(cls, kind: str, rows: HeldOutRows, names: Sequence[str]) -> HeldOut:
        """Residuals from rows with predictions.

        Parameters
        ----------
        kind : str
        rows : HeldOutRows
        names : sequence of str

        Returns
        -------
        found : HeldOut

        Examples
        --------
        >>> rows = HeldOutRows(np.arange(4.0), np.zeros(4), np.full((4, 1), 2.0), np.ones((4, 1)))
        >>> print(HeldOut.from_rows("test", rows, ["elbow"]))
        elbow      50 %
        all        50 %
        """
        residuals = rows.measured - rows.predicted
        squares = (residuals**2).sum(axis=0)
        sizes = (rows.measured**2).sum(axis=0)
        return cls(kind, squares, sizes, names, (rows,))

    def __str__(self) -> str:
        """Table of the residuals of each joint, and of all joints together."""
        relative_residuals = {**self.joints, "all": self.all}
        width = max(map(len, relative_residuals))
        lines = [f"{name:<{width}}  {100 * residual:6.3g} %" for name, residual in relative_residuals.items()]
        return "\n".join(lines)

    def __add__(self, other: HeldOut) -> HeldOut:
        """Residuals of the rows of both."""
        squares = self.squares + other.squares
        sizes = self.sizes + other.sizes
        return HeldOut(self.kind, squares, sizes, self.names, self.rows + other.rows)

    @property
    def all(self) -> float:
        """Residual of all joints together, |τ - τ̂| / |τ|."""
        size = float(self.sizes.sum()) or _TINY_SIZE
        return float(np.sqrt(self.squares.sum() / size))

    @property
    def joints(self) -> dict[str, float]:
        """Residual of each joint, |τ - τ̂| / |τ|; NaN if its torque is zero."""
        with np.errstate(invalid="ignore", divide="ignore"):
            residuals = np.sqrt(self.squares / self.sizes)
        return dict(zip(self.names, residuals.tolist(), strict=True))
