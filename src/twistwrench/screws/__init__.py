"""Twists, wrenches and poses that carry the names of their frames, and the axes of screws."""
