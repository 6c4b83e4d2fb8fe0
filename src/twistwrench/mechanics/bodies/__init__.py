"""Rigid bodies: their spatial inertia."""

from __future__ import annotations
