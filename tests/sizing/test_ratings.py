"""Ratings of a catalogue: what a missing one does to the verdict, standing joints, hot windings, and the written drives."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp

import twistwrench as tw
from twistwrench.core.verdict import Word
from twistwrench.mechanics.model.actuators import Motor, Thermal, gear_input
from twistwrench.sizing import drives, winding

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

UR5 = tw.robots.ur5()
LOADED = UR5.with_payload(tw.SpatialInertia.from_com(5.0), "tool0")
CATALOG = json.loads(
    json.dumps(yaml.safe_load(tw.robots.path_of("ur5").with_name("ur5_demo.drives.yaml").read_text()))
)  # no aliases
MOTION = tw.Motion.from_file(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), LOADED)
COARSE = tw.Motion(MOTION.time[::15], MOTION.q[::15], MOTION.dq[::15], MOTION.ddq[::15], robot=LOADED)


def with_drives(**pairs):
    whole = copy.deepcopy(CATALOG)
    whole["actuators"] = {name: {"motor": m, "gear": g} for name, (m, g) in pairs.items()}
    return whole


def without(catalog, part, name, *keys):
    whole = copy.deepcopy(catalog)
    at = whole[part][name]
    for key in keys[:-1]:
        at = at[key]
    del at[keys[-1]]
    return whole


# ── Missing ratings ──

PAIRS = [("M40", "G14"), ("M60", "G17"), ("M85", "G25"), ("M70", "P60"), ("M115", "G32")]
RATINGS = {
    "motors": ["resistance", "voltage", "current_peak", "speed", "mass", "rotor", "thermal", ("thermal", "maximum"),
               ("thermal", "winding_time"), "torque_constant"],
    "gears": ["efficiency", "no_load_torque", "mass", "mean_exponent", "rated_torque", "rated_speed", "life",
              "average_torque", "repeated_peak", "momentary_peak", "average_speed", "maximum_speed"],
}  # fmt: skip
PENDULUM = tw.robots.pendulum()
TIME = np.linspace(0, 2, 41)


def swing(seconds, mass):
    arm = PENDULUM.with_payload(tw.SpatialInertia.from_com(mass), PENDULUM.link_names[-1])
    s = seconds / 2
    return arm, tw.Motion(s * TIME, 1.5 * np.sin(np.pi * TIME / 2)[:, None] ** 2, robot=arm)


CASES = [
    (*swing(4.0, 0.5), {"ambient": 25.0}), (*swing(2.0, 4.0), {"ambient": 60.0, "life": 20000.0, "pause": 0.5}),
    (*swing(1.0, 2.0), {"ambient": 40.0, "emergency": True, "add_masses": False}),
]  # fmt: skip


@pytest.mark.parametrize("case", [pytest.param(0, marks=pytest.mark.slow), 1, pytest.param(2, marks=pytest.mark.slow)])
def test_removing_a_rating_never_improves_a_verdict(case):
    arm, motion, settings = CASES[case]
    if "emergency" in settings:
        settings = {**settings, "emergency": motion}
    words = set()
    for pair in PAIRS:
        whole = with_drives(hinge=pair)
        before = tw.size_drives(arm, motion, whole, **settings)
        words.add(before.verdict.word)
        for part, name in zip(("motors", "gears"), pair, strict=True):
            for keys in RATINGS[part]:
                keys = keys if isinstance(keys, tuple) else (keys,)
                if keys[0] not in whole[part][name]:
                    continue
                try:
                    after = tw.size_drives(arm, motion, without(whole, part, name, *keys), **settings)
                except tw.TwistWrenchError as error:
                    assert name in str(error)  # a drive without it has no meaning
                    continue
                assert not (after.verdict.ok and not before.verdict.ok), (pair, name, keys)
                if keys[-1] in ("resistance", "speed", "efficiency", "average_torque"):
                    assert not after.verdict.ok and keys[-1] in str(after.joints["hinge"].missing), (pair, keys)
    assert words - {Word.UNSURE}


@pytest.mark.parametrize(
    ("part", "key", "words"),
    [
        ("motors", "resistance", "motor M85: resistance not given"),
        ("gears", "efficiency", "gear G25: efficiency not given"),
    ],
)
def test_a_missing_number_is_unsure_with_its_name(part, key, words):
    whole = without(with_drives(shoulder_lift_joint=("M85", "G25")), part, {"motors": "M85", "gears": "G25"}[part], key)
    s = tw.size_drives(LOADED, COARSE, whole, add_masses=False)
    assert s.verdict.word == "UNSURE" and words in str(s.verdict)


def test_a_planetary_gear_is_asked_for_its_life():
    whole = with_drives(wrist_1_joint=("M60", "P60"))
    free = tw.size_drives(LOADED, COARSE, whole, add_masses=False)
    wanted = tw.size_drives(LOADED, COARSE, whole, add_masses=False, life=1e6)
    assert (
        free.verdict.ok and wanted.verdict.word == "UNSURE" and "rated_torque, rated_speed, life" in str(wanted.verdict)
    )
    whole["gears"]["P60"] |= {"rated_torque": "40 N m", "rated_speed": "3000 rpm", "life": "20000 h"}
    known = {
        hours: tw.size_drives(LOADED, COARSE, whole, add_masses=False, life=hours).verdict.word for hours in (1e4, 3e4)
    }
    assert known == {1e4: "OK", 3e4: "OVER LIMIT"}
    for beyond in ({"rated_speed": "10 rpm"}, {"rated_torque": "0.1 N m"}):  # the maker's life is none of these loads
        less = copy.deepcopy(whole)
        less["gears"]["P60"] |= beyond
        unknown = tw.size_drives(LOADED, COARSE, less, add_masses=False, life=1e4)
        assert unknown.verdict.word == "UNSURE" and "life beyond the rated torque and speed" in str(unknown.verdict)


def test_the_exponent_of_a_planetary_gear_is_asked_for_if_some_exponent_would_exceed_the_mean_torque():
    """A mean torque is below the peak whatever its exponent is, and comes as near to it as one likes."""
    arm, motion, _ = CASES[1]
    whole = with_drives(hinge=("M115", "P60"))

    def sized(**changed):
        whole["gears"]["P60"].update(changed)
        found = tw.size_drives(arm, motion, whole, add_masses=False)
        return found.joints["hinge"].gear, found.verdict.word

    gear, word = sized()
    mean, peak = gear.average_torque, gear.peak_torque
    assert 0 < 1.05 * mean < peak < 60 and word == "OK"
    middle = 0.5 * (mean + peak)
    for kind, stated, limit, is_asked_for, expected in (
        ("planetary", True, middle, False, "OK"),
        ("planetary", False, 0.99 * mean, True, "OVER LIMIT"),
        ("planetary", False, middle, True, "UNSURE"),
        ("planetary", False, 0.99 * peak, True, "UNSURE"),
        ("planetary", False, 1.01 * peak, False, "OK"),
        ("strain_wave", False, middle, False, "OK"),
    ):
        if not stated:
            whole["gears"]["P60"].pop("mean_exponent", None)
        gear, word = sized(kind=kind, average_torque=f"{limit} N m")
        assert gear.missing == ("mean_exponent",) * is_asked_for
        assert word == expected


def test_a_continuous_current_is_no_answer_in_hot_air():
    whole = without(with_drives(wrist_1_joint=("M40", "G14")), "motors", "M40", "thermal")
    whole["motors"]["M40"]["current_continuous"] = "3 A"
    words = [str(tw.size_drives(LOADED, COARSE, whole, add_masses=False, ambient=x).verdict) for x in (25.0, 40.0)]
    assert words[0] == "OK" and words[1].startswith("UNSURE") and "current_continuous holds up to 25 degC" in words[1]


# ── Joints at rest ──


def test_rounding_errors_of_a_speed_do_not_choose_the_drive():
    """A joint that stands has rates of 0, or of some 1e-13 rad/s where a spline leads through a constant."""
    t = np.linspace(0, 5, 501)
    q = np.tile([0, -0.6, 0.9, 0.3, 0.2, 0.1], (501, 1))
    q[:, 5] += np.sin(2 * np.pi * t / 5) ** 2
    dq, ddq, w = np.zeros_like(q), np.zeros_like(q), 2 * np.pi / 5
    dq[:, 5], ddq[:, 5] = w * np.sin(2 * w * t), 2 * w * w * np.cos(2 * w * t)
    whole = with_drives(shoulder_lift_joint=("M85", "G20"))
    exact, derived = (
        tw.size_drives(UR5, m, whole) for m in (tw.Motion(t, q, dq, ddq, robot=UR5), tw.Motion(t, q, robot=UR5))
    )
    one, other = (s.joints["shoulder_lift_joint"] for s in (exact, derived))
    assert exact.verdict.word == derived.verdict.word
    assert one.motor.rms_torque == pytest.approx(other.motor.rms_torque, rel=1e-9)
    assert one.motor.temperature.max() == pytest.approx(other.motor.temperature.max(), rel=1e-9)
    assert np.isnan(one.gear.average_torque) and np.isnan(other.gear.average_torque)


def test_a_standing_gear_takes_the_larger_torque_whatever_the_sign_of_its_rounding_error():
    arm = UR5.with_actuators({"actuators": {n: {"ratio": 100, "efficiency": 0.7} for n in UR5.joint_names}})
    q = np.array([0.3, -0.6, 0.9, 0.3, 0.2, 0.1])
    still = arm.motor_loads(q, np.zeros(6), np.zeros(6)).torque
    for rate in (1e-13, -1e-13):
        assert arm.motor_loads(q, np.full(6, rate), np.zeros(6)).torque == pytest.approx(still, rel=1e-12)
    assert still == pytest.approx(arm.gravity_forces(q) / 0.7 / 100)
    assert gear_input(10.0, -1e-3, 0.7) == pytest.approx(7.0)


# ── Supply and temperature ──


def test_energy_and_peak_of_the_supply_are_those_of_the_hot_winding():
    """The periodic state by integration of the thermal equations and of the electrical power, independently."""
    s = tw.size_drives(LOADED, MOTION, CATALOG, pause=0.8, ambient=40.0, add_masses=False)
    name, joint = "elbow_joint", s.joints["elbow_joint"]
    motor = s.catalog.motors[joint.drive[0]].motor
    hot, time = motor.thermal, joint.cycle.time
    i, w = joint.motor.torque / motor.torque_constant, joint.motor.speed
    squares = (i[1:] ** 2 + i[1:] * i[:-1] + i[:-1] ** 2) / 3

    def resistance(T):
        return motor.resistance * (1 + hot.coefficient * (T - hot.reference))

    def rates(t, x):
        k = min(int(np.searchsorted(time, t, "right")) - 1, len(squares) - 1)
        flow = (x[0] - x[1]) / hot.winding_housing
        C_w, C_h = hot.winding_time / hot.winding_housing, hot.housing_time / hot.housing_ambient
        return [(resistance(x[0]) * squares[k] - flow) / C_w, (flow - (x[1] - 40.0) / hot.housing_ambient) / C_h]

    found = np.empty((2, len(time)))
    found[:, 0] = joint.motor.temperature[0]
    for k in range(len(squares)):  # current is constant in each segment
        span = time[k : k + 2] - [0, 1e-12]
        found[:, k + 1] = solve_ivp(rates, span, found[:, k]).y[:, -1] if span[1] > span[0] else found[:, k]
    assert np.abs(found.T - joint.motor.temperature).max() < 1e-3
    assert np.abs(found[:, -1] - found[:, 0]).max() < 1e-3  # the cycle repeats
    power = joint.motor.torque * w + resistance(found[0]) * i**2
    assert joint.motor.power == pytest.approx(power, rel=1e-5), name
    assert (round(s.supply.drawn, 1), round(s.supply.peak, 1)) == (410.5, 273.5)


def test_long_cycles_are_exact():
    """5,000 segments of which single ones heat the winding beyond the mean: against a loop over all of them."""
    rng, one = np.random.default_rng(1), Thermal(2.0, 60.0, 1.0, 0.5, 120.0)
    squares, duration = rng.uniform(0, 1, 5000) ** 8 * 900, rng.uniform(0.001, 0.2, 5000)
    heated = winding.periodic_temperatures(one, 0.5, squares, duration, 25.0)
    state = np.append(heated[0] - 25.0, 1.0)
    for k, step in enumerate(winding.transitions(one, 0.5, squares, duration, 25.0)):
        state = step @ state
        assert np.abs(state[:2] + 25.0 - heated[k + 1]).max() < 1e-8
    assert np.abs(heated[-1] - heated[0]).max() < 1e-8 and len(heated) == 5001


# ── Written drives ──

SERVO = {
    "stall_torque": "60 N m",
    "stall_current": "4.4 A",
    "no_load_speed": "30 rpm",
    "voltage": "24 V",
    "mass": "1.2 kg",
}


def plain(described):
    return {key: value for key, value in vars(described).items() if key != "thermal"}


@pytest.mark.parametrize("masses", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["servos", "motors and gears"])
def test_written_drives_give_the_torques_that_were_sized(kind, masses, tmp_path):
    names = UR5.joint_names
    whole = {"motors": {"S": SERVO}, "actuators": {n: {"motor": "S"} for n in names}}
    if kind != "servos":
        whole = with_drives(**{n: ("M85", ("G25", "P60")[k % 2]) for k, n in enumerate(names)})
        whole["motors"]["M85"] |= {"inductance": "0.3 mH", "current_continuous": "12 A"}
    robot = LOADED.with_armature({"elbow_joint": 0.3})
    motion = COARSE.with_robot(robot)
    s = tw.size_drives(robot, motion, whole, add_masses=masses)
    again = robot.with_actuators(s.write_actuators(tmp_path / "drives.yaml"))
    loads = again.motor_loads(motion.q, motion.dq, motion.ddq, friction=True)
    for k, (name, joint) in enumerate(s.joints.items()):
        motor, gear = s.catalog.pair(joint.drive)
        assert np.abs(loads.torque[:, k] - joint.motor.torque).max() < 1e-9 * np.abs(joint.motor.torque).max(), name
        written = again.actuators[name]
        assert (written.ratio, written.efficiency) == (gear.ratio, gear.efficiency)
        assert written.no_load_torque == pytest.approx(gear.no_load_torque, rel=1e-13)
        for one, other in ((written.motor, motor.motor), (written.motor.thermal, motor.motor.thermal)):
            assert (one is None) == (other is None)
            assert one is None or plain(one) == pytest.approx(plain(other), rel=1e-13)
    added = again.gravity_forces(motion.q) - LOADED.gravity_forces(motion.q)
    assert (np.abs(added).max() > 1.0) == masses


def test_no_load_torque_of_an_actuator_file_turns_with_the_motor():
    drive = {"ratio": -50, "no_load_torque": "0.05 N m", "motor": {"torque_constant": "0.1 N m/A"}}
    plain = {key: value for key, value in drive.items() if key != "no_load_torque"}
    q, dq = np.zeros(6), np.array([1.0, -1.0, 0.0, 1e-12, 2.0, -2.0])
    with_, without_ = (
        UR5.with_actuators({"actuators": dict.fromkeys(UR5.joint_names, d)}).motor_loads(q, dq, q)
        for d in (drive, plain)
    )
    assert with_.torque - without_.torque == pytest.approx(0.05 * np.array([-1, 1, 0, 0, -1, 1]))
    assert with_.current == pytest.approx(with_.torque / 0.1)
    with pytest.raises(tw.ValueRangeError, match="no-load torque"):
        UR5.with_actuators({"actuators": {"elbow_joint": {"ratio": 50, "no_load_torque": "-1 N m"}}})


def test_a_motor_of_the_library_is_that_of_its_data_sheet():
    assert drives.warm_resistance(
        Motor(0.1, 0.5, thermal=Thermal(2.0, 60.0)), np.array([[120.0, 60.0]])
    ) == pytest.approx(0.5 * 1.39)
