"""Checks of logs: doubts from residuals of an identified robot, and from readings of a force-torque sensor."""
