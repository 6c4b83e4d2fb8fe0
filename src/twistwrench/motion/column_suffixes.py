"""The ends of the names of columns: which say that they are velocities, accelerations or torques. One table for all files."""

from __future__ import annotations

SUFFIX = {"q": "", "dq": ".vel", "ddq": ".acc", "tau": ".torque"}
"""What our files write behind a joint's name, for each part of a motion."""

READ = {"q": ("",), "dq": (".vel",), "ddq": (".acc",), "tau": (".tau", ".torque", ".effort")}
"""What is read, the shortest first."""

DEGREES = {"q": "deg", "dq": "deg/s", "ddq": "deg/s^2"}
"""What columns say that they are in, in brackets, where angles are in degrees."""
