"""Doubts about readings of a force-torque sensor: poses, motion, units, and departure from the sensor's file."""
