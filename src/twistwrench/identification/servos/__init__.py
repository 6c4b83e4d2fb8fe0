"""Identification of position servos from commands and positions, without torques."""
