"""Units that column names give in brackets, as in ``elbow [deg]``, and what takes them to SI units."""

from __future__ import annotations

import math
import re

import numpy as np

from ..errors import TrajectoryError
from ..typing import Array

_DEG, _TURN = math.radians(1.0), math.tau
_ANGLES = {"rad": 1.0, "mrad": 1e-3, "deg": _DEG, "°": _DEG, "rev": _TURN, "turn": _TURN}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_ANGLES |= {
    long: _ANGLES[short]
    for long, short in (("radian", "rad"), ("radians", "rad"), ("degree", "deg"), ("degrees", "deg"))
}
_TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    "min": 60.0,
}
_DATE_NS, _STEP_NS = 1e17, 1e4
"""1973 in ns, and 10 us: no log is as fast, and none in whole seconds or milliseconds has steps as long."""
_UNITS: dict[tuple[str, bool], dict[str, float]] = {
    ("q", True): _ANGLES,
    ("q", False): _LENGTHS,
    ("dq", True): {f"{u}/s": f for u, f in _ANGLES.items()} | {"1/s": 1.0, "rpm": _TURN / 60},
    ("dq", False): {f"{u}/s": f for u, f in _LENGTHS.items()},
    ("ddq", True): {f"{u}/s2": f for u, f in _ANGLES.items()} | {"1/s2": 1.0},
    ("ddq", False): {f"{u}/s2": f for u, f in _LENGTHS.items()},
    ("tau", True): {"nm": 1.0, "mnm": 1e-3, "knm": 1e3, "ncm": 1e-2},
    ("tau", False): {"n": 1.0, "mn": 1e-3, "kn": 1e3},
}
_SHOWN = {
    ("q", True): "rad, deg, rev",
    ("q", False): "m, cm, mm",
    ("dq", True): "rad/s, deg/s, rpm",
    ("dq", False): "m/s, mm/s",
    ("ddq", True): "rad/s^2, deg/s^2",
    ("ddq", False): "m/s^2, mm/s^2",
    ("tau", True): "N m, mN m, kN m",
    ("tau", False): "N, mN, kN",
}


def split_unit(text: str) -> tuple[str, str | None]:
    """A column's name without the unit in brackets at its end, and that unit; numbers in brackets are indices.

    >>> split_unit("elbow [deg]"), split_unit("Time (ms)"), split_unit("position[0]")
    (('elbow', 'deg'), ('Time', 'ms'), ('position[0]', None))
    """
    found = re.fullmatch(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))", text.strip(), re.DOTALL)
    if not found:
        return text.strip(), None
    unit = (found[2] if found[2] is not None else found[3]).strip()
    if not unit or unit.isdigit() or not found[1].strip():
        return text.strip(), None
    return found[1].strip(), unit


def unit_factor(unit: str, part: str, angular: bool, where: str) -> float:
    """What takes a column of that unit to SI units; ``part`` is q, dq, ddq or tau. TrajectoryError begins with ``where``."""
    known = _UNITS[part, angular]
    factor = known.get(_plain(unit, products=part == "tau"))
    if factor is None:
        raise TrajectoryError(
            f"{where}: the unit {unit!r} is not one of this column's kind. Known: {_SHOWN[part, angular]}. Convert the column, "
            "or write its unit without brackets if it means something else."
        )
    return factor


def time_factor(unit: str) -> float | None:
    """What takes a time of that unit to seconds; None for what is no unit of time.

    >>> time_factor("ms"), time_factor("kg")
    (0.001, None)
    """
    return _TIMES.get(_plain(unit))


def ros_nanoseconds(stamps: Array) -> bool:
    """Whether stamps (n,) are nanoseconds: whole numbers as large as those of a date, or with steps of 10 us at least.

    Fractions are seconds, unless they are as large as only nanoseconds of a date are.

    >>> import numpy as np
    >>> ros_nanoseconds(np.array([1.7e18, 1.7e18 + 1e7])), ros_nanoseconds(np.array([1.7e9, 1.7e9 + 0.01]))
    (True, False)
    """
    if not len(stamps):
        return True
    if np.abs(stamps).max() >= _DATE_NS:
        return True
    whole = bool((stamps == np.round(stamps)).all())
    return whole and (len(stamps) == 1 or float(np.median(np.diff(stamps))) >= _STEP_NS)


def _plain(unit: str, *, products: bool = False) -> str:
    text = (
        unit.strip().casefold().replace("²", "2").replace("^", "").replace("**", "").replace("µ", "u").replace("μ", "u")
    )
    text = text.replace("deg.", "deg").replace("sec", "s") if "/" in text else text
    text = re.sub(r"[\s·*.⋅-]" if products else r"\s", "", text)
    return re.sub(r"/s/s$", "/s2", text)
