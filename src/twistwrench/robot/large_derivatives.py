"""∂q̈/∂(q, q̇, τ) of long robots, from compiled parts and LAPACK: M ∂q̈/∂x = -∂τ/∂x, solved as a matrix.

Unrolled, the solutions alone take some 2 nv³ operations a state: 3.4 million instructions for a chain of 100 links, more than
a trace may have. A matrix product of that size is what LAPACK is for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..typing import Array

if TYPE_CHECKING:
    from ..model.model import Model
    from .model_kernels import ModelKernels

FROM = 64
"""Velocities of the smallest robot whose derivatives are put together this way; unrolled they would be a million operations."""


def applies(model: Model, wanted: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether these are derivatives that would be too long unrolled."""
    plain = all(set(options) <= {"wrenches"} for options in wanted.values())
    return plain and tuple(wanted) == ("forward_dynamics_derivatives",) and model.nv >= FROM


class LargeDerivatives:
    """Callable like the kernel of ``forward_dynamics_derivatives``: broadcasting, ``out=``, float32 in and out."""

    def __init__(self, engine: ModelKernels, options: Mapping[str, Any]) -> None:
        self._mass, self._acceleration = (
            engine.kernel(["mass_matrix"], {}),
            engine.kernel(["forward_dynamics"], options),
        )
        self._torque_derivatives = engine.kernel(["inverse_dynamics_derivatives"], options)
        self.__name__, n = "forward_dynamics_derivatives", engine.model.nv
        self.__doc__ = f"forward_dynamics_derivatives of {engine.model.name}, from its mass matrix and ∂τ."
        inputs = str(self._acceleration.signature).split("->")[0]
        self.signature = f"{inputs}->({n},{n}),({n},{n}),({n},{n})"
        self.nin, self.nout = self._acceleration.nin, 3

    def __repr__(self) -> str:
        return f"<LargeDerivatives {self.signature}>"

    def __call__(self, *args: ArrayLike, out: tuple[Array, Array, Array] | None = None) -> tuple[Array, ...]:
        """Evaluate on arrays whose last axes are the signature's."""
        ddq = self._acceleration(*args)  # refuses what does not fit, as all kernels do
        q, dq, _, *wrenches = args
        by_q, by_dq = self._torque_derivatives(q, dq, ddq, *wrenches)
        inverse = _inverse(self._mass(q).astype(ddq.dtype, copy=False))
        found = -(inverse @ by_q), -(inverse @ by_dq), np.broadcast_to(inverse, by_q.shape)
        if out is None:
            return found[0], found[1], found[2].copy()
        for given, made in zip(out, found, strict=True):
            given[...] = made
        return out


def _inverse(M: Array) -> Array:
    """M⁻¹, NaN where there is none: one state without must not cost the others theirs."""
    try:
        return np.linalg.inv(M)
    except np.linalg.LinAlgError:
        found = np.full_like(M, np.nan)
        for where in np.ndindex(M.shape[:-2]):
            if np.linalg.matrix_rank(M[where]) == M.shape[-1]:
                found[where] = np.linalg.inv(M[where])
        return found
