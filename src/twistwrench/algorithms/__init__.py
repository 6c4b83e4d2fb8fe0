"""The algorithms, each its equations, written once in NumPy notation: on floats a reference, on symbols a program.

One state at a time; batches are the kernels' business. ``q``, ``dq``, ``ddq`` are arrays of numbers or of symbols.
"""
