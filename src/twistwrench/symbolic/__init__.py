"""Lagrange's equations in symbols: derived, checked, printed, and turned into source. Modern Robotics section 8.1."""

from __future__ import annotations

from .derivation import Derivation, DerivationCheck, derive
from .equations import Equations, Step
from .lagrange import lagrange
from .names import Parameter

__all__ = ["Derivation", "DerivationCheck", "Equations", "Parameter", "Step", "derive", "lagrange"]
