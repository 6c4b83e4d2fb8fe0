"""Robots with constraints: closed loops and held frames."""
