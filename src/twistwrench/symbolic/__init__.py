"""Lagrange's equations in symbols: derivation, check, text and source code. Modern Robotics section 8.1."""

from __future__ import annotations

from .derivation import Derivation, derive
from .derivation_check import DerivationCheck
from .equations import Equations, Step
from .lagrange import lagrange
from .parameters import Parameter

__all__ = ["Derivation", "DerivationCheck", "Equations", "Parameter", "Step", "derive", "lagrange"]
