"""Accuracy of a simulation: errors of its steps, missed impulses of its forces, and contacts that are too short."""
