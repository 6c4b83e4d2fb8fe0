"""Export of a robot's quantities as C99 functions with a self-test, and as CUDA kernels."""

from __future__ import annotations

from .c99 import export_c, export_cuda

__all__ = ["export_c", "export_cuda"]
