"""Support of a robot along a motion by feet, wheels, a mounting or a grip, as a part of the torque report."""
