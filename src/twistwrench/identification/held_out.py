"""How well rows are predicted that a fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import Array


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Residuals of rows that a fit has not seen, as |τ - τ̂| / |τ|.

    Attributes
    ----------
    kind : str, ``test`` for logs of their own, ``five-fold`` for fifths of the training logs in time
    squares : (nv,) array, of residuals
    sizes : (nv,) array, squares of the torques
    names : sequence of str, of the joints
    """

    kind: str
    squares: Array
    sizes: Array
    names: Sequence[str]

    @classmethod
    def of(cls, kind: str, left: Array, tau: Array, names: Sequence[str]) -> HeldOut:
        """From residuals and torques, (n, nv) each.

        Parameters
        ----------
        kind : str
        left : (n, nv) array
        tau : (n, nv) array
        names : sequence of str

        Returns
        -------
        found : HeldOut

        Examples
        --------
        >>> HeldOut.of("test", np.ones((4, 1)), np.full((4, 1), 2.0), ["elbow"]).all
        0.5
        """
        return cls(kind, (left**2).sum(axis=0), (tau**2).sum(axis=0), names)

    def __add__(self, other: HeldOut) -> HeldOut:
        return HeldOut(self.kind, self.squares + other.squares, self.sizes + other.sizes, self.names)

    @property
    def all(self) -> float:
        """Of all joints together."""
        return float(np.sqrt(self.squares.sum() / max(float(self.sizes.sum()), 1e-300)))

    @property
    def joints(self) -> dict[str, float]:
        """Of each joint; not a number where its torque is zero."""
        with np.errstate(invalid="ignore", divide="ignore"):
            found = np.sqrt(self.squares / self.sizes)
        return dict(zip(self.names, found.tolist(), strict=True))
