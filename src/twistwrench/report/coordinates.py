"""Names and units of coordinates; they live in :mod:`twistwrench.motion.coordinates`."""

from ..motion.coordinates import Coordinates, joint_rates

__all__ = ["Coordinates", "joint_rates"]
