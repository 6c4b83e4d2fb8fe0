"""Lagrange's equations in symbols: derived, checked, printed, and turned into source. Modern Robotics section 8.1."""

from __future__ import annotations

from .check import DerivationCheck
from .derivation import Derivation, derive
from .equations import Equations, Step
from .lagrangian import lagrange
from .symbols import Parameter

__all__ = ["Derivation", "DerivationCheck", "Equations", "Parameter", "Step", "derive", "lagrange"]
