"""Names of the six components of twists and wrenches, angular part first."""

TWIST = ("wx", "wy", "wz", "vx", "vy", "vz")
WRENCH = ("mx", "my", "mz", "fx", "fy", "fz")
