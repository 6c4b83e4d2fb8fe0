"""Lagrange's equations in symbols: derived, checked, printed, and turned into source. Modern Robotics section 8.1."""

from __future__ import annotations

from .check import Check
from .derivation import Derivation, derive
from .equations import Equations, Step
from .lagrangian import lagrange
from .parameters import Parameter

__all__ = ["Check", "Derivation", "Equations", "Parameter", "Step", "derive", "lagrange"]
