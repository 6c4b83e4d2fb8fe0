"""Straight-line programs: expressions, tracing, derivatives, loops."""
