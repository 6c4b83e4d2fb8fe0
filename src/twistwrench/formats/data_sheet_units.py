"""Numbers with units, as data sheets give them: "33.3 g cm^2", "25.5 mN m/A", "4200 rpm"."""

from __future__ import annotations

import math
import re

from ..core.printed_numbers import printed
from ..errors import ModelError

_TURN = 2 * math.pi
UNITS: dict[str, dict[str, float]] = {
    "inertia": {"kg m^2": 1.0, "kg cm^2": 1e-4, "kg mm^2": 1e-6, "g m^2": 1e-3, "g cm^2": 1e-7, "g mm^2": 1e-9},
    "torque constant": {"N m/A": 1.0, "mN m/A": 1e-3, "V s/rad": 1.0},
    "resistance": {"ohm": 1.0, "Ω": 1.0, "mohm": 1e-3, "mΩ": 1e-3},
    "inductance": {"H": 1.0, "mH": 1e-3, "uH": 1e-6, "µH": 1e-6},
    "voltage": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
    "rotor speed": {"rad/s": 1.0, "rpm": _TURN / 60, "/min": _TURN / 60, "deg/s": _TURN / 360},
    "mass": {"kg": 1.0, "g": 1e-3},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "torque": {"N m": 1.0, "mN m": 1e-3, "kN m": 1e3},
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "viscous": {"N m s/rad": 1.0, "mN m s/rad": 1e-3},
    "viscous, sliding": {"N s/m": 1.0, "kN s/m": 1e3},
    "speed": {"rad/s": 1.0, "rpm": _TURN / 60, "deg/s": _TURN / 360},
    "speed, sliding": {"m/s": 1.0, "mm/s": 1e-3},
    "stiffness": {"N m/rad": 1.0, "kN m/rad": 1e3, "N m/deg": 360 / _TURN},
    "stiffness, sliding": {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3},
    "angle": {"rad": 1.0, "deg": _TURN / 360},
}
"""The units of each kind of quantity, SI first, and what one of them is in SI."""

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?!\d)(.*)", re.DOTALL)


def in_si(value: object, kind: str, where: str) -> float:
    """The number in SI units. Raises :class:`~twistwrench.ModelError` naming ``where``, and the units that are known.

    >>> in_si("33.3 g cm^2", "inertia", "the rotor")
    3.33e-06
    >>> in_si("1 mN·m/A", "torque constant", "the motor")
    0.001
    """
    known = UNITS[kind]
    first = next(iter(known))
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise ModelError(
            f"{where} is {printed(value)} without a unit. Write {printed(value)} {first}, or one of {_listed(known)}."
        )
    found = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        raise ModelError(f"{where} is {value!r}, expected a number with a unit, such as 1.5 {first}.")
    factors = {_plain(unit): factor for unit, factor in known.items()}
    unit = _plain(found[2])
    if unit not in factors:
        given = f"the unit {found[2].strip()!r}" if unit else "no unit"
        raise ModelError(f"{where} is {value!r}, with {given}. Known here: {_listed(known)}.")
    number = float(found[1]) * factors[unit]
    if not math.isfinite(number):
        raise ModelError(f"{where} is {value!r}, which is no finite number.")
    return float(f"{number:.15g}")  # 33.3 g cm² is 3.33e-6 kg m², whatever 1e-7 is in binary


def _listed(known: dict[str, float]) -> str:
    return ", ".join(known)


def _plain(unit: str) -> str:
    """Without spaces, dots and carets: kg·m², kg m^2 and kgm2 are one unit."""
    return re.sub(r"[\s·*^]", "", unit).replace("²", "2").replace("μ", "µ")
