"""Algorithms of robot dynamics, written once in NumPy notation: evaluated on floats, traced on symbols.

One state at a time; batches are the kernels' business. ``q``, ``dq``, ``ddq`` are arrays of numbers or of symbols.
"""
