"""Every unit that is read anywhere, against a table of its own: SI prefixes and definitions, written out once more."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special

from twistwrench.formats.yaml import UNITS, in_si
from twistwrench.motion.column_names import unit_factor
from twistwrench.motion.differentiation import residual_spread
from twistwrench.sensing.doubts.unit_doubts import MIXUPS
from twistwrench.sensing.files import read_log
from twistwrench.sensing.fit import Problem, fit
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.outliers import touched_in_static_poses
from twistwrench.sensing.poses import propose_poses
from twistwrench.sensing.static_poses import static_poses
from twistwrench.sensing.unknowns import Unknowns

MILLI, CENTI, KILO, MICRO = 0.001, 0.01, 1000.0, 0.000001
DEGREE, TURN_A_MINUTE = math.pi / 180, math.pi / 30
STANDARD_GRAVITY, POUND, INCH = 9.80665, 0.45359237, 0.0254  # m/s², kg, m: exact by definition

SI = {
    "inertia": {
        "kg m^2": 1.0, "kg cm^2": CENTI**2, "kg mm^2": MILLI**2,
        "g m^2": MILLI, "g cm^2": MILLI * CENTI**2, "g mm^2": MILLI * MILLI**2,
    },
    "torque constant": {"N m/A": 1.0, "mN m/A": MILLI, "V s/rad": 1.0},
    "resistance": {"ohm": 1.0, "Ω": 1.0, "mohm": MILLI, "mΩ": MILLI},
    "inductance": {"H": 1.0, "mH": MILLI, "uH": MICRO, "µH": MICRO},
    "voltage": {"V": 1.0, "mV": MILLI, "kV": KILO},
    "current": {"A": 1.0, "mA": MILLI},
    "rotor speed": {"rad/s": 1.0, "rpm": TURN_A_MINUTE, "/min": TURN_A_MINUTE, "deg/s": DEGREE},
    "mass": {"kg": 1.0, "g": MILLI},
    "length": {"m": 1.0, "mm": MILLI, "cm": CENTI},
    "torque": {
        "N m": 1.0, "mN m": MILLI, "kN m": KILO,
        "kgf cm": STANDARD_GRAVITY * CENTI, "ozf in": POUND / 16 * STANDARD_GRAVITY * INCH,
    },
    "thermal resistance": {"K/W": 1.0},
    "time": {"s": 1.0, "ms": MILLI, "min": 60.0, "h": 3600.0},
    "temperature": {"degC": 1.0, "°C": 1.0},
    "life": {"h": 1.0},
    "force": {"N": 1.0, "mN": MILLI, "kN": KILO},
    "viscous": {"N m s/rad": 1.0, "mN m s/rad": MILLI},
    "viscous, sliding": {"N s/m": 1.0, "kN s/m": KILO},
    "speed": {"rad/s": 1.0, "rpm": TURN_A_MINUTE, "deg/s": DEGREE},
    "speed, sliding": {"m/s": 1.0, "mm/s": MILLI},
    "stiffness": {"N m/rad": 1.0, "kN m/rad": KILO, "N m/deg": 1 / DEGREE},
    "stiffness, sliding": {"N/m": 1.0, "kN/m": KILO, "N/mm": 1 / MILLI},
    "angle": {"rad": 1.0, "deg": DEGREE},
}  # fmt: skip


def test_the_table_has_every_unit():
    assert {kind: set(units) for kind, units in UNITS.items()} == {kind: set(units) for kind, units in SI.items()}


ANGLES = {"rad": 1.0, "mrad": MILLI, "deg": DEGREE, "°": DEGREE, "degrees": DEGREE, "rev": math.tau, "turn": math.tau}
LENGTHS = {"m": 1.0, "cm": CENTI, "mm": MILLI, "um": MICRO}
LOGGED = {
    ("q", True): ANGLES,
    ("q", False): LENGTHS,
    ("dq", True): {**{f"{u}/s": x for u, x in ANGLES.items()}, "1/s": 1.0, "rpm": TURN_A_MINUTE},
    ("dq", False): {f"{u}/s": x for u, x in LENGTHS.items()},
    ("ddq", True): {**{f"{u}/s^2": x for u, x in ANGLES.items()}, "1/s^2": 1.0},
    ("ddq", False): {f"{u}/s^2": x for u, x in LENGTHS.items()},
    ("tau", True): {"N m": 1.0, "mN m": MILLI, "kN m": KILO, "N cm": CENTI},
    ("tau", False): {"N": 1.0, "mN": MILLI, "kN": KILO},
}
"""Of columns of logs: positions, velocities, accelerations and torques, of what turns and of what slides."""


@pytest.mark.parametrize(("of", "unit"), [(of, unit) for of, units in LOGGED.items() for unit in units])
def test_every_unit_of_a_log_has_its_factor(of, unit):
    assert unit_factor(unit, *of, "the log") == pytest.approx(LOGGED[of][unit], rel=1e-14)


@pytest.mark.parametrize(("kind", "unit"), [(kind, unit) for kind, units in SI.items() for unit in units])
def test_every_unit_has_its_factor(kind, unit):
    assert in_si(f"7 {unit}", kind, "it") == pytest.approx(7 * SI[kind][unit], rel=1e-14)


@pytest.mark.parametrize(
    ("said", "force", "moment"),
    [
        ("forces are in grams", MILLI * STANDARD_GRAVITY, 1.0),
        ("forces are in kilograms", STANDARD_GRAVITY, 1.0),
        ("moments are in N mm", 1.0, MILLI),
        ("moments are in N cm", 1.0, CENTI),
        ("forces are in kilograms and moments in kg cm", STANDARD_GRAVITY, STANDARD_GRAVITY * CENTI),
        ("forces are in grams and moments in g cm", MILLI * STANDARD_GRAVITY, MILLI * STANDARD_GRAVITY * CENTI),
        ("forces are in pounds and moments in pound inches", POUND * STANDARD_GRAVITY, POUND * STANDARD_GRAVITY * INCH),
    ],
)
def test_every_unit_that_a_sensor_log_may_be_in_has_its_factor(said, force, moment):
    (way,) = [way for way in MIXUPS if way.cause == said]
    assert way.force == pytest.approx(force, rel=3e-5)  # pounds are told with five digits
    assert way.moment == pytest.approx(moment, rel=3e-5)
    digits = [float(word) for word in way.cure.replace(",", " ").split() if word[0].isdigit()]
    told = [x if "multiply" in way.cure else 1 / x for x in digits]
    assert told == pytest.approx([x for x in (force, moment) if x != 1.0], rel=1e-3)


def test_the_table_has_every_unit_of_sensor_logs():
    assert len(MIXUPS) == 7


@pytest.mark.parametrize(
    ("column", "units", "refused"),
    [
        ("mx", ["N m", "Nm", "N·m"], ["N mm", "N cm", "kg m"]),
        ("fx", ["N"], ["kN", "mN", "g", "kg", "lbf"]),
        ("wx", ["rad/s"], ["deg/s", "rpm"]),
        ("vx", ["m/s"], ["mm/s"]),
        ("dwx", ["rad/s²", "rad/s^2"], ["deg/s²"]),
        ("dvx", ["m/s²"], ["mm/s²", "g"]),
        ("time", ["s"], ["ms", "min"]),
        ("px", ["m"], ["mm"]),
    ],
)
def test_columns_of_sensor_logs_are_in_si_or_refused(tmp_path, column, units, refused):
    names = [
        "time",
        "gx",
        "gy",
        "gz",
        "px",
        "py",
        "pz",
        *(f"{d}{k}{a}" for d in ("", "d") for k in "wv" for a in "xyz"),
    ]
    names += [f"{k}{a}" for k in "mf" for a in "xyz"]
    row = ",".join("-1" if name == "gz" else "0" for name in names)
    for unit, good in [(u, True) for u in units] + [(u, False) for u in refused]:
        head = ",".join(f"{name} [{unit}]" if name == column else name for name in names)
        (tmp_path / "log.csv").write_text(f"{head}\n{row}\n")
        if good:
            assert len(read_log(tmp_path / "log.csv")) == 1
        else:
            with pytest.raises(ValueError, match="Convert it to"):
                read_log(tmp_path / "log.csv")


# ── the factor of the median absolute deviation: 1 / Φ⁻¹(3/4) ──

MAD = 1 / float(special.ndtri(0.75))


def test_the_spread_about_a_smoothed_curve_is_the_standard_deviation_of_normal_noise():
    # The median of n values of |x| has a deviation of 1 / (2 n^½ φ(0.6745) 2) of σ: 0.8 % of 40,000; without the factor 33 % less.
    rng = np.random.default_rng(0)
    time = np.arange(20_000) * 1e-2
    noise = 0.3 * rng.normal(size=(20_000, 2))
    spread = residual_spread([time], [noise], np.array([1e10, 1e10]), 1e-2, np.zeros(2))
    np.testing.assert_allclose(spread, 0.3, rtol=0.04)
    exact = MAD * np.median(np.abs(noise), axis=0)
    np.testing.assert_allclose(spread, exact, rtol=0.03)


def test_the_robust_noise_of_a_fit_is_that_of_normal_noise():
    rng, g = np.random.default_rng(1), propose_poses(400).gravity
    noise = np.repeat([0.01, 0.3], 3)
    log = ReadingLog(noise * rng.normal(size=(400, 6)), g, time=np.arange(400.0))
    asked = Problem(log, Unknowns(), 1.0, np.zeros(6), None, np.ones(400), np.zeros(6), 0.0, np.arange(400))
    found = fit(asked, keep=np.ones(400, bool), huber=True)
    # A median of 400 has a deviation of 5.8 % of σ; four of them.
    np.testing.assert_allclose(found.sigma / noise, 1.0, atol=0.23)
    assert np.mean(found.sigma / noise) == pytest.approx(1.0, abs=0.1)


def test_as_many_readings_of_a_dwell_are_far_as_is_said():
    rng = np.random.default_rng(2)
    g = np.repeat(propose_poses(12).gravity, 100, axis=0)
    counts = []
    for _ in range(40):
        log = ReadingLog(rng.normal(size=(1200, 6)), g)
        counts.append(int(touched_in_static_poses(log, static_poses(log)).sum()))
    assert sum(counts) <= 2  # a chance of 1e-3 a log; with a factor of 1 for 1.4826 there are hundreds
