"""Names and units of log columns: suffixes of results, names used by loggers, and units in brackets."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from ..core.errors import TrajectoryError
from ..core.text import Argument, spell
from ..core.typing import Array
from ..mechanics.lie.labelled import WRENCH

SUFFIX = {"q": "", "dq": ".vel", "ddq": ".acc", "tau": ".torque", "command": ".command"}
"""Suffixes of a joint's name in written files, for each part of a motion."""

READ = {"q": ("",), "dq": (".vel",), "ddq": (".acc",), "tau": (".tau", ".torque", ".effort"), "command": (".command",)}
"""Accepted suffixes for each part of a motion, shortest first."""

DEGREES = {"q": "deg", "dq": "deg/s", "ddq": "deg/s^2", "command": "deg"}
"""Bracketed units of columns with angles in degrees."""

ENERGIES = ("kinetic_energy", "potential_energy")
"""Columns of energies in results of simulations."""
WORK = "work."
"""Prefix of the columns of work by cause in results of simulations."""
MOMENTUM = tuple(f"momentum.{component}" for component in WRENCH)
"""Columns of the spatial momentum in results of simulations."""


def is_result(name: str) -> bool:
    """True if a column is a result of a simulation and not a coordinate of the motion.

    >>> is_result("work.torques"), is_result("workpiece")
    (True, False)
    """
    return name in ENERGIES or name in MOMENTUM or name.startswith(WORK)


def is_command(name: str) -> bool:
    """True if a column has the name of a command in written files.

    >>> is_command("elbow.command"), is_command("elbow.command [deg]"), is_command("elbow_cmd")
    (True, True, False)
    """
    name_without_unit, _ = split_unit(name)
    return name_without_unit.endswith(SUFFIX["command"])


STATES = ("q", "dq", "ddq", "tau")
"""Keys of the parts of a motion: coordinates, velocities, accelerations and torques."""
PARTS = (*STATES, "command")
"""Keys of all parts of a motion, including commanded positions."""

CURRENT = "current"
"""Word for a motor current, which a gain converts to a torque."""
_WORDS_OF_PART = {
    "q": ("q", "qpos", "pos", "position", "positions", "angle", "angles", "jointposition"),
    "dq": ("dq", "qd", "qdot", "qvel", "vel", "velocity", "velocities", "speed", "jointvelocity"),
    "ddq": ("ddq", "qdd", "qddot", "acc", "accel", "acceleration", "accelerations", "jointacceleration"),
    "tau": ("tau", "torque", "torques", "effort", "efforts", "force", "jointtorque"),
    CURRENT: (CURRENT, "currents", "curr"),
}
PART_OF = {word: part for part, words in _WORDS_OF_PART.items() for word in words}
"""Part of a motion by the word that denotes it."""
COMMANDS = (
    "command", "commands", "commanded", "cmd", "action", "actions", "target", "desired", "des", "reference", "ref",
    "setpoint", "goal",
)  # fmt: skip
"""Words that make a position a commanded position, in the order in which they are looked for."""
NEUTRAL = frozenset((
    "joint", "joints", "jointstate", "jointstates", "state", "states", "actual", "act", "measured", "meas", "msr",
    "feedback", "sensor", "value", "values", "data", "observation", "observations",
))  # fmt: skip
"""Words that do not change the meaning of a name."""
JOINT = frozenset(("joint", "joints", "axis", "j", "rax", "achse", "gelenk", "axe", "eje", "asse", "giunto"))
"""Words for any joint, also in German, French, Spanish and Italian; ``rax`` is ABB's."""
UNITS = frozenset(("rad", "deg"))
"""Units that occur as words in names."""
ROS_TIME = "%time"
"""Time column of ``rostopic echo -p``, in integer nanoseconds; other programs write seconds in it."""
_CERTAIN_TIME_NAMES = ("time", "t")
_SECONDS_NAMES = ("seconds", "secs")
"""Names of times in seconds."""
_STAMP_NAMES = (  # names that are probably a time
    "timestamp", "timestamps", "stamp", "time_stamp", "elapsed", "elapsed_time", *_SECONDS_NAMES, "clock",
    "zeit", "zeitstempel", "temps", "tiempo", "tempo", "时间",
)  # fmt: skip
_CHARACTERS_AROUND_NAMES = "%_ "
"""Characters at both ends of a name that do not change its meaning."""
_NAME_IN_DEGREES = re.compile(r"A\d|rax_\d", re.IGNORECASE)
"""Position names of KUKA and ABB, which are in degrees."""


def time_meaning(text: str) -> tuple[int, str | None] | None:
    """Rank of a name for time (0 certain, 1 probable) and its unit suffix, if any; None for other names.

    >>> time_meaning("Time"), time_meaning("timestamp_ns"), time_meaning("elbow")
    ((0, None), (1, 'ns'), None)
    """
    name = text.casefold().strip(_CHARACTERS_AROUND_NAMES)
    if name in _CERTAIN_TIME_NAMES and text.strip() != ROS_TIME:
        return 0, None
    if name in (*_STAMP_NAMES, "time"):  # "time" is here ROS_TIME without its sign
        return 1, None
    name_without_unit, _, unit = name.rpartition("_")
    is_unit = unit in ("s", "sec", "ms", "us", "ns")
    if is_unit and name_without_unit in (*_CERTAIN_TIME_NAMES, *_STAMP_NAMES):
        return 1, unit
    return None


def is_called_seconds(text: str) -> bool:
    """True if the name of a time column is that of its unit, seconds.

    >>> is_called_seconds("Seconds"), is_called_seconds("t")
    (True, False)
    """
    return text.casefold().strip(_CHARACTERS_AROUND_NAMES) in _SECONDS_NAMES


def are_in_degrees(names: Sequence[str]) -> bool:
    """True if all ``names`` of positions without unit are names of KUKA or ABB, whose angles are in degrees.

    >>> are_in_degrees(["A1", "A2"]), are_in_degrees(["joint1", "joint2"])
    (True, False)
    """
    return bool(names) and all(_NAME_IN_DEGREES.fullmatch(name) for name in names)


def time_column(names: Sequence[str]) -> str:
    """Name of the time column in written files that none of the other columns' ``names`` has.

    >>> time_column(["elbow"]), time_column(["time", "elbow"])
    ('time', 'time [s]')
    """
    candidates = ("time", "time [s]", "timestamp [s]", "seconds [s]")
    return next(name for name in candidates if name not in names)


# ── Units in brackets, as in ``elbow [deg]``, and their factors to SI

_DEGREE = math.radians(1.0)
_TURN = math.tau
_ANGLES = {
    **dict.fromkeys(("rad", "radian", "radians"), 1.0),
    "mrad": 1e-3,
    **dict.fromkeys(("deg", "degree", "degrees", "°"), _DEGREE),
    **dict.fromkeys(("rev", "turn"), _TURN),
}
_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}
_TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    "min": 60.0,
}
_LAST_DATE = 2e11
"""Largest time [s since 1970] that counts as a date, in the year 8307."""
_MIN_DATE_NS = 1e17
"""Smallest stamp [ns since 1970] that is a date in nanoseconds, in the year 1973."""
_MIN_STEP_NS = 1e4
"""Smallest step of stamps in nanoseconds: 10 µs. Logs have longer steps, and steps in whole s or ms are smaller numbers."""


def _per_time(factors: dict[str, float], suffix: str) -> dict[str, float]:
    """Factors of the units with a suffix, such as /s."""
    return {f"{unit}{suffix}": factor for unit, factor in factors.items()}


_FACTORS: dict[tuple[str, bool], dict[str, float]] = {
    ("q", True): _ANGLES,
    ("q", False): _LENGTHS,
    ("dq", True): _per_time(_ANGLES, "/s") | {"1/s": 1.0, "rpm": _TURN / 60},
    ("dq", False): _per_time(_LENGTHS, "/s"),
    ("ddq", True): _per_time(_ANGLES, "/s2") | {"1/s2": 1.0},
    ("ddq", False): _per_time(_LENGTHS, "/s2"),
    ("jerk", True): _per_time(_ANGLES, "/s3"),
    ("jerk", False): _per_time(_LENGTHS, "/s3"),
    ("command", True): _ANGLES,
    ("command", False): _LENGTHS,
    ("tau", True): {"nm": 1.0, "mnm": 1e-3, "knm": 1e3, "ncm": 1e-2},
    ("tau", False): {"n": 1.0, "mn": 1e-3, "kn": 1e3},
}
"""Factors to SI units by unit, for each quantity of turning (True) and sliding (False) joints."""
_USUAL_UNITS = {  # by quantity, and True for turning joints
    ("q", True): "rad, deg, rev",
    ("q", False): "m, cm, mm",
    ("command", True): "rad, deg, rev",
    ("command", False): "m, cm, mm",
    ("dq", True): "rad/s, deg/s, rpm",
    ("dq", False): "m/s, mm/s",
    ("ddq", True): "rad/s^2, deg/s^2",
    ("ddq", False): "m/s^2, mm/s^2",
    ("jerk", True): "rad/s^3, deg/s^3",
    ("jerk", False): "m/s^3, mm/s^3",
    ("tau", True): "N m, mN m, kN m",
    ("tau", False): "N, mN, kN",
}


def split_unit(text: str) -> tuple[str, str | None]:
    """Name and unit of a column with its unit in brackets at the end; the unit is None without one.

    Numbers in brackets are indices, not units.

    >>> split_unit("elbow [deg]"), split_unit("Time (ms)"), split_unit("position[0]")
    (('elbow', 'deg'), ('Time', 'ms'), ('position[0]', None))
    """
    text = text.strip()
    match = _NAME_WITH_UNIT.fullmatch(text)
    if match is None:
        return text, None
    name = match["name"].strip()
    in_brackets = match["square"] or match["round"] or ""
    unit = in_brackets.strip()
    is_index = unit.isdigit()
    if not unit or is_index or not name:
        return text, None
    return name, unit


_NAME_WITH_UNIT = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))", re.DOTALL)
"""Name, then a text in square or round brackets."""


def si_factor(unit: str, part: str, angular: bool) -> float | None:
    """Factor from a unit to SI units; None for units of other quantities. ``part`` is q, dq, ddq, jerk, tau or command.

    >>> si_factor("deg/s^2", "ddq", True) == math.radians(1.0), si_factor("m/s", "dq", True)
    (True, None)
    """
    plain_unit = _plain(unit, products=part == "tau")  # only torques have units that are products
    return _FACTORS[part, angular].get(plain_unit)


def known_units(part: str, angular: bool) -> str:
    """Usual units of a quantity, for error messages."""
    return _USUAL_UNITS[part, angular]


def unit_factor(unit: str, part: str, angular: bool, where: str) -> float:
    """Factor of :func:`si_factor`; raises TrajectoryError, which starts with ``where``, for units of other quantities."""
    factor = si_factor(unit, part, angular)
    if factor is None:
        units = known_units(part, angular)
        if part == "tau":
            units += f", and of currents with {spell(Argument('gain'))} A, mA"
        raise TrajectoryError(
            f"{where}: the unit {unit!r} is not one of this column's kind. Known: {units}. Convert the column, or write its "
            "unit without brackets if it means something else."
        )
    return factor


def current_factor(unit: str) -> float | None:
    """Factor from a unit of current to ampere; None for other units."""
    factors = {"a": 1.0, "ma": 1e-3}
    return factors.get(_plain(unit))


def time_factor(unit: str) -> float | None:
    """Factor from a unit of time to seconds; None for other units.

    >>> time_factor("ms"), time_factor("kg")
    (0.001, None)
    """
    return _TIMES.get(_plain(unit))


SINCE_1970 = 1e8
"""Smallest time [s] that counts from 1970 instead of the begin of a log, in 1973: a log of three years is implausible."""


def date_note(begin: float) -> tuple[str, ...]:
    """Sentence about the date of the first time [s]; empty unless times count from 1970.

    >>> date_note(1.7e9), date_note(12.5)
    (('Time counts from 2023-11-14 22:13:20 UTC.',), ())
    """
    if not SINCE_1970 < begin < _LAST_DATE:
        return ()
    date = np.datetime64(int(begin), "s").item()  # a datetime of the standard library
    return (f"Time counts from {date:%Y-%m-%d %H:%M:%S} UTC.",)


def unit_since_1970(stamps: Array) -> str | None:
    """Unit of stamps (n,) that are plausible only as ns, us or ms since 1970, with dates from 2008 to 2039; otherwise None.

    >>> import numpy as np
    >>> [unit_since_1970(np.array([x, x + 1.0])) for x in (1.7e18, 1.7e15, 1.7e12, 1.7e9, 5.0)]
    ['ns', 'us', 'ms', None, None]
    """
    if not len(stamps):
        return None
    for unit, units_per_gigasecond in _UNITS_PER_GIGASECOND.items():
        first_date = units_per_gigasecond * _FIRST_DATE
        last_date = units_per_gigasecond * _LAST_RECORDING_DATE
        if first_date <= stamps.min() and stamps.max() <= last_date:
            return unit
    return None


_UNITS_PER_GIGASECOND = {"ns": 1e18, "us": 1e15, "ms": 1e12}
_FIRST_DATE = 1.2
"""Earliest date of a recording, in 2008 [10⁹ s since 1970]."""
_LAST_RECORDING_DATE = 2.2
"""Latest date of a recording, in 2039 [10⁹ s since 1970]."""


def ros_nanoseconds(stamps: Array) -> bool:
    """True if stamps (n,) are nanoseconds: integers of the size of a date, or with steps of at least 10 µs.

    Non-integers are seconds, unless they are so large that only nanoseconds are plausible.

    >>> import numpy as np
    >>> ros_nanoseconds(np.array([1.7e18, 1.7e18 + 1e7])), ros_nanoseconds(np.array([1.7e9, 1.7e9 + 0.01]))
    (True, False)
    """
    if not len(stamps):  # the unit of the format
        return True
    if np.abs(stamps).max() >= _MIN_DATE_NS:
        return True
    are_integers = (stamps == np.round(stamps)).all()
    if not are_integers:
        return False
    if len(stamps) == 1:
        return True
    usual_step = float(np.median(np.diff(stamps)))
    return usual_step >= _MIN_STEP_NS


_PLAIN_CHARACTERS = str.maketrans({"²": "2", "³": "3", "^": "", "µ": "u", "μ": "u"})
"""Replacements of characters in units; µ is the micro sign, μ the Greek letter."""
_BLANKS = re.compile(r"\s")
_BLANKS_AND_PRODUCT_SIGNS = re.compile(r"[\s·*.⋅-]")


def _plain(unit: str, *, products: bool = False) -> str:
    """Unit in lower case without blanks, with powers as digits; if ``products``, also without product signs, as in N·m."""
    text = unit.strip().casefold()
    text = text.translate(_PLAIN_CHARACTERS).replace("**", "")
    if "/" in text:  # such as deg./sec
        text = text.replace("deg.", "deg").replace("sec", "s")
    ignored_characters = _BLANKS_AND_PRODUCT_SIGNS if products else _BLANKS
    text = ignored_characters.sub("", text)
    return re.sub(r"/s/s$", "/s2", text)
