"""Algorithms of robot dynamics, written once in NumPy notation: evaluated on floats, traced on symbols.

Functions take one state; kernels evaluate batches. ``q``, ``dq``, ``ddq`` are arrays of numbers or symbols.
"""

from __future__ import annotations
