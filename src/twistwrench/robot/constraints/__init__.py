"""Loops and other velocity constraints of a robot."""
