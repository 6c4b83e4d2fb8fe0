"""Rigid bodies: their spatial inertia."""
