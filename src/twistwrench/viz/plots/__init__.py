"""Plots of results in a common style."""

from __future__ import annotations
