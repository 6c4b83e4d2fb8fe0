"""A robot's quantities as C99 functions in files of their own: one header, one source, and a program that checks them."""

from __future__ import annotations

from .package import export_c

__all__ = ["export_c"]
