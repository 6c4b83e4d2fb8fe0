"""Plots of results in a common style."""
