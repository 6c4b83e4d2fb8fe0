"""Which numbers a drive can have."""

from __future__ import annotations

import numpy as np

from ..core.printed_numbers import printed
from ..errors import ValueRangeError
from .actuator import Actuator

_SMALLEST, LARGEST = 1e-18, 1e12
"""In SI units: no drive has a number beyond these, and their squares are still far from overflow."""

_RATIOS = 1e-6, 1e9
"""Of gears: rad/rad, or rad/m of a spindle; a thread of a nanometre has 6e9."""


def check_actuator(actuator: Actuator) -> None:
    """Raise ValueRangeError for a number that no drive has."""
    who, motor, rotor = f"the actuator of joint {actuator.joint!r}", actuator.motor, actuator.rotor
    if not _RATIOS[0] <= abs(actuator.ratio) <= _RATIOS[1]:
        raise ValueRangeError(
            f"{who} has the ratio {printed(actuator.ratio)}; it must be a number from {printed(_RATIOS[0])} to "
            f"{printed(_RATIOS[1])}, or minus one."
        )
    if not 0 < actuator.efficiency <= 1:
        raise ValueRangeError(
            f"{who} has the efficiency {printed(actuator.efficiency)}; it must be above 0 and at most 1."
        )
    if not (_real(actuator.stiffness) or actuator.stiffness == np.inf):
        raise ValueRangeError(
            f"{who} has the stiffness {printed(actuator.stiffness)}; it must be above 0 and at most {printed(LARGEST)}. "
            "Leave it out where the gear is rigid."
        )
    if rotor is not None and not (np.isfinite(rotor.place).all() and np.abs(rotor.place).max() <= LARGEST):
        raise ValueRangeError(f"{who} has a rotor at {np.asarray(rotor.place).tolist()}; its place must be finite.")
    if rotor is not None and not (_real(rotor.inertia) and 0 <= rotor.mass <= LARGEST):
        raise ValueRangeError(
            f"{who} has a rotor of {printed(rotor.inertia)} kg m² and {printed(rotor.mass)} kg; give positive ones."
        )
    if motor is not None:
        if motor.current_continuous > motor.current_peak:
            raise ValueRangeError(
                f"{who} has current continuous {printed(motor.current_continuous)} A above current peak "
                f"{printed(motor.current_peak)} A. Are they exchanged?"
            )
        if not _real(motor.torque_constant):
            raise ValueRangeError(
                f"{who} has the torque constant {printed(motor.torque_constant)} N m/A; it must be above 0."
            )
        for field, value in vars(motor).items():
            may_be_zero = field in ("resistance", "inductance")
            if not (_real(value) or (value == 0 if may_be_zero else value == np.inf)):
                allowed = f"{'at least' if may_be_zero else 'above'} 0 and at most {printed(LARGEST)}"
                raise ValueRangeError(f"{who} has {field.replace('_', ' ')} {printed(value)}; it must be {allowed}.")


def _real(x: float) -> bool:
    """Whether a drive can have this number."""
    return bool(_SMALLEST <= x <= LARGEST)
