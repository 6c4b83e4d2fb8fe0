"""Motors and gears by the formulas of MR section 8.9, and the file that describes them: what it reads, what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.formats.yaml import UNITS, in_si
from twistwrench.mechanics.model.actuators import Motor
from twistwrench.testing import assert_close

FILE = """
robot: ur5
motors:
  small:
    torque_constant: 60 mN m/A
    resistance: 0.6 ohm
    inductance: 0.5 mH
    voltage: 48 V
    current_continuous: 4 A
    current_peak: 12 A
    speed: 6000 rpm
actuators:
  elbow_joint:
    ratio: 101:1
    efficiency: 0.75
    motor: small
    rotor: {inertia: 0.3 kg cm^2}
    friction: {viscous: 3 N m s/rad, coulomb: 2 N m, static: 4 N m, stribeck: 5 deg/s, load: 0.05}
  wrist_1_joint:
    ratio: -100
    motor: {torque_constant: 0.05 V s/rad}
"""


@pytest.fixture(scope="module")
def robot():
    return tw.robots.ur5().with_actuators(FILE)


def test_the_file_is_read_in_si(robot):
    elbow, wrist = robot.actuators["elbow_joint"], robot.actuators["wrist_1_joint"]
    assert (elbow.ratio, elbow.efficiency, wrist.ratio, wrist.efficiency) == (101.0, 0.75, -100.0, 1.0)
    assert elbow.rotor.inertia == 0.3e-4
    assert elbow.motor == Motor(0.06, 0.6, 0.5e-3, 48.0, 4.0, 12.0, pytest.approx(200 * np.pi))
    k = robot.joint_names.index("elbow_joint")
    friction = robot.model.friction
    assert (friction.viscous[k], friction.coulomb[k], friction.static[k], friction.load[k]) == (3, 2, 4, 0.05)
    assert friction.stribeck[k] == pytest.approx(np.pi / 36)


def test_a_file_on_disk_text_and_a_mapping_are_the_same(robot, tmp_path):
    import yaml

    path = tmp_path / "ur5.yaml"
    path.write_text(FILE)
    q = robot.random_configuration(1)
    mapping = yaml.safe_load(FILE.replace("101:1", "101"))
    for source in (path, str(path), mapping):
        same = tw.robots.ur5().with_actuators(source)
        np.testing.assert_array_equal(same.mass_matrix(q), robot.mass_matrix(q))


def test_motor_loads_follow_the_book(robot):
    """τ_m = (τ_gear / (η G)) + J_r (G ddq + …), i = τ_m / k, V = k ω + R i, P = V i: power in is shaft power and heat."""
    rng = np.random.default_rng(0)
    q = robot.random_configuration(rng, 500)
    dq, ddq = rng.normal(size=(2, 500, 6))
    loads = robot.motor_loads(q, dq, ddq, friction=True)
    assert loads.torque.shape == (500, 2)
    k = [robot.joint_names.index(j) for j in robot.actuators]
    assert_close(loads.speed, dq[:, k] * [101.0, -100.0], 1e-15, "ω = G dq")
    carried, rotor = robot.kernel("drive_torques")(q, dq, ddq)
    out = (carried + robot.friction_forces(dq, load=carried + rotor))[:, k[0]]
    motoring = out * dq[:, k[0]] > 0
    assert 50 < motoring.sum() < 450
    through = np.where(motoring, out / 0.75, out * 0.75)
    assert_close(loads.torque[:, 0], (through + rotor[:, k[0]]) / 101, 1e-13, "τ_m")
    assert_close(loads.current[:, 0], loads.torque[:, 0] / 0.06, 1e-14, "i")
    assert_close(loads.voltage[:, 0], 0.06 * loads.speed[:, 0] + 0.6 * loads.current[:, 0], 1e-13, "V")
    assert_close(loads.power, loads.torque * loads.speed + loads.heat, 1e-12, "P = τω + R i²")


def test_ways_to_write_a_ratio_and_an_efficiency():
    cart = tw.robots.cart_pole()
    slide, hinge = cart.joint_names
    for written, ratio in (
        ("200", 200.0),
        ("200 rad/m", 200.0),
        ("5 mm/turn", 2 * np.pi / 5e-3),
        ("-0.1 m/turn", -20 * np.pi),
    ):
        made = cart.with_actuators({"actuators": {slide: {"ratio": written, "efficiency": "75 %"}}})
        assert made.actuators[slide].ratio == pytest.approx(ratio, rel=1e-14)
        assert made.actuators[slide].efficiency == 0.75
    for joint, written in ((hinge, "5 mm/turn"), (slide, "0 mm/turn"), (slide, "fast rad/m"), (slide, "101:0")):
        with pytest.raises(tw.ModelError, match="ratio is"):
            cart.with_actuators({"actuators": {joint: {"ratio": written}}})


def test_elastic_gears_may_be_taken_as_stiff():
    entry = {"ratio": 50, "stiffness": "300 N m/rad", "rotor": {"inertia": "2 kg cm^2", "extra": True}}
    drives = {"actuators": {"joint2": entry}}
    arm = tw.robots.planar_2r()
    with pytest.warns(tw.ModelWarning, match="elastic gears of joint2 are taken to be stiff"):
        stiff = arm.with_actuators(drives, stiff=True)
    rigid = arm.with_actuators({"actuators": {"joint2": {k: v for k, v in entry.items() if k != "stiffness"}}})
    assert stiff.joint_names == arm.joint_names
    np.testing.assert_array_equal(stiff.mass_matrix([0.1, 0.2]), rigid.mass_matrix([0.1, 0.2]))


def test_wrenches_reach_the_motors(robot):
    q, dq, ddq = np.full(6, 0.3), np.full(6, 0.2), np.zeros(6)
    push = {"tool0": np.array([1.0, 2, 3, 40, 50, 60])}
    free, pushed = (robot.motor_loads(q, dq, ddq, wrench_by_robot=w) for w in (None, push))
    k = robot.joint_names.index("elbow_joint")
    more = robot.wrench_torques(q, push["tool0"], "tool0")[k]
    carried = robot.drive_torques(q, dq, ddq)[0][k]
    expected = [x / (0.75 * 101) if x * 0.2 > 0 else x * 0.75 / 101 for x in (carried, carried + more)]
    assert pushed.torque[0] - free.torque[0] == pytest.approx(expected[1] - expected[0], rel=1e-9)


def test_the_motor_of_an_elastic_joint_is_loaded_by_its_spring():
    """τ_m = (k (θ - q) / η + J G² ddθ) / G: link and motor move apart, and only the spring joins them."""
    entry = {"ratio": 50, "efficiency": 0.8, "stiffness": "300 N m/rad", "motor": {"torque_constant": "0.1 N m/A"}}
    entry["rotor"] = {"inertia": "2 kg cm^2", "extra": True}
    arm = tw.robots.planar_2r().with_actuators({"actuators": {"joint2": entry}})
    q, dq, ddq = np.array([0.1, 0.2, 0.25]), np.array([0.0, 0.3, 0.4]), np.array([0.0, 1.0, 2.0])
    loads = arm.motor_loads(q, dq, ddq)
    assert loads.speed == pytest.approx([50 * 0.4])
    assert loads.torque == pytest.approx([(300 * 0.05 / 0.8 + 2e-4 * 50**2 * 2.0) / 50])
    slide = {"ratio": "200", "friction": {"coulomb": "3 N", "viscous": "2 N s/m"}}
    cart = tw.robots.cart_pole()
    k = cart.joint_names[0]
    assert cart.with_actuators({"actuators": {k: slide}}).friction_forces([0.5, 0]).tolist() == [4.0, 0.0]


def test_the_speed_torque_region():
    """MR figure 8.10: flat by the current, then down to the no-load speed V / k, and nothing beyond the top speed."""
    motor = Motor(0.1, resistance=0.5, voltage=48.0, current_continuous=8.0, current_peak=20.0, speed=470.0)
    knee = (48.0 - 0.5 * 20.0) / 0.1
    w = np.array([0.0, knee - 1e-9, knee + 10, 469.0, 471.0])
    expected = [2.0, 2.0, 0.1 * (48 - 0.1 * (knee + 10)) / 0.5, 0.1 * (48 - 46.9) / 0.5, -np.inf]
    np.testing.assert_allclose(motor.greatest_torque(w), expected, rtol=1e-9)
    assert motor.greatest_torque([-471.0, -469.0, np.nan]) == pytest.approx([-np.inf, 2.0, np.nan], nan_ok=True)
    assert motor.greatest_torque(0.0, motor.current_continuous) == pytest.approx(0.8)
    assert Motor(0.1, voltage=48.0).greatest_torque([479.0, 481.0]).tolist() == [np.inf, -np.inf]  # no resistance
    assert motor.voltage_at(2.0, 100.0, current_rate=0.0) == pytest.approx(11.0)
    assert Motor(0.1, inductance=1e-3).voltage_at(0.0, 0.0, current_rate=500.0) == pytest.approx(0.5)


@pytest.mark.parametrize("kind", UNITS)
def test_every_unit_is_what_it_says(kind):
    si = next(iter(UNITS[kind]))
    for unit, factor in UNITS[kind].items():
        assert in_si(f"2.5 {unit}", kind, "it") == pytest.approx(2.5 * factor, rel=1e-14)
        assert in_si(f"-1e-3{unit.replace(' ', '·')}", kind, "it") == pytest.approx(-1e-3 * factor, rel=1e-14)
    with pytest.raises(tw.ModelError, match=r"without a unit|with no unit"):
        in_si(2.5, kind, "it")
    with pytest.raises(tw.ModelError, match="with no unit"):
        in_si("2.5", kind, "it")
    with pytest.raises(tw.ModelError) as problem:
        in_si("2.5 furlong", kind, "it")
    assert si in str(problem.value)


BAD = {
    "missing joint": ("elbow_joint:", "elbow:", tw.UnknownNameError, "no joint named 'elbow'. Did you mean 'elbow_joint'"),
    "no unit": ("60 mN m/A", "0.06", tw.ModelError, "motors → small → torque_constant is '0.06', with no unit"),
    "wrong unit": ("60 mN m/A", "60 N m", tw.ModelError, "with the unit 'N m'. Known here: N m/A, mN m/A"),
    "unknown entry": ("efficiency:", "eficiency:", tw.UnknownNameError, "'eficiency'. Did you mean 'efficiency'"),
    "unknown motor": ("motor: small", "motor: smal", tw.UnknownNameError, "Did you mean 'small'"),
    "unknown motor entry": ("resistance:", "ohms:", tw.UnknownNameError, "motors → small named 'ohms'"),
    "no torque constant": ("torque_constant: 0.05 V s/rad", "resistance: 1 ohm", tw.ModelError, "has no torque_constant"),
    "another robot": ("robot: ur5", "robot: ur10", tw.ModelError, "it is for robot 'ur10', and this one is 'ur5'"),
    "efficiency": ("0.75", "75", tw.ValueRangeError, "efficiency 75; it must be above 0 and at most 1"),
    "ratio": ("101:1", "fast", tw.ModelError, "ratio is 'fast', expected a number such as 101"),
    "ratio beyond any gear": ("-100", "1e308", tw.ValueRangeError, "ratio 1e+308; it must be a number from 1e-06 to 1e+09"),
    "ratio below any gear": ("-100", "-1e-9", tw.ValueRangeError, "ratio -1e-09; it must be"),
    "ratio whose square overflows": ("101:1", "1e160:1", tw.ValueRangeError, "ratio 1e+160"),
    "ratio that overflows": ("101:1", "1e308:1e-308", tw.ValueRangeError, "ratio inf"),
    "motor beyond any": ("60 mN m/A", "1e300 N m/A", tw.ValueRangeError, "torque constant 1e+300"),
    "rotor beyond any": ("0.3 kg cm^2", "1e-30 kg m^2", tw.ValueRangeError, "rotor of 1e-30"),
    "friction beyond any": ("coulomb: 2 N m", "coulomb: 1e300 N m", tw.ValueRangeError, "coulomb friction of joint"),
    "zero ratio": ("-100", "0", tw.ValueRangeError, "ratio 0"),
    "too big a rotor": ("0.3 kg cm^2", "0.3 kg m^2", tw.InertiaError, "cannot contain the rotor of joint 'elbow_joint'"),
    "negative rotor": ("0.3 kg cm^2", "-0.3 kg cm^2", tw.ValueRangeError, "give positive"),
    "friction": ("load: 0.05", "load: 1.5", tw.ValueRangeError, "load 1.5 below 1"),
    "friction entry": ("stribeck:", "stribek:", tw.UnknownNameError, "Did you mean 'stribeck'"),
    "no rotor inertia": ("inertia: 0.3 kg cm^2", "extra: true", tw.ModelError, "has no inertia"),
    "not true": ("inertia: 0.3 kg cm^2", "inertia: 0.3 kg cm^2, extra: maybe", tw.ModelError, "expected true or false"),
    "mass of no use": ("inertia: 0.3 kg cm^2", "inertia: 0.3 kg cm^2, mass: 1 kg", tw.ModelError, "unless the rotor is extra"),
    "axis": ("inertia: 0.3 kg cm^2", "inertia: 0.3 kg cm^2, axis: [0, 0]", tw.ModelError, "expected three entries"),
    "zero axis": ("inertia: 0.3 kg cm^2", "inertia: 0.3 kg cm^2, axis: [0, 0, 0]", tw.ModelError, "give a direction"),
    "link": ("inertia: 0.3 kg cm^2", "inertia: 0.3 kg cm^2, link: forarm_link", tw.UnknownNameError, "'forearm_link'"),
    "twice": ("  wrist_1_joint:", "  elbow_joint:", tw.ModelError, "elbow_joint given twice"),
    "no YAML": ("actuators:", "actuators: [", tw.ModelError, "is no YAML"),
    "no actuators": ("actuators:", "motor_list:", tw.UnknownNameError, "'motor_list'"),
    "an entry that is text": ("rotor: {inertia: 0.3 kg cm^2}", "rotor: big", tw.ModelError, "rotor is 'big', expected entries"),
    "no current": ("current_continuous: 4 A", "current_continuous: 0 A", tw.ValueRangeError, "current continuous 0; it must be above 0"),
    "exchanged": ("current_peak: 12 A", "current_peak: 2 A", tw.ValueRangeError, "above current peak 2 A"),
    "infinite": ("0.6 ohm", "1e999 ohm", tw.ModelError, "not a finite number"),
    "true is not a number": ("ratio: -100", "ratio: yes", tw.ModelError, "expected a number such as 101"),
    "negative resistance": ("0.6 ohm", "-0.6 ohm", tw.ValueRangeError, "resistance -0.6"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_meant_is_one_clear_error(case):
    old, new, kind, text = BAD[case]
    assert old in FILE
    with pytest.raises(kind) as problem:
        tw.robots.ur5().with_actuators(FILE.replace(old, new, 1))
    assert text in str(problem.value)
    assert "the text given" in str(problem.value)


def test_other_errors(robot, tmp_path):
    with pytest.raises(tw.NotFoundError, match="no actuator file"):
        tw.robots.ur5().with_actuators(tmp_path / "none.yaml")
    for junk in (None, 5, [1], b"abc"):
        with pytest.raises(tw.ModelError, match="come from a path"):
            tw.robots.ur5().with_actuators(junk)
    one_line = tw.robots.ur5().with_actuators("actuators: {elbow_joint: {ratio: 10}}")
    assert one_line.actuators["elbow_joint"].ratio == 10
    for long in ("x" * 5000, "\n" + "[" * 20000):
        with pytest.raises(tw.TwistWrenchError):
            tw.robots.ur5().with_actuators(long)
    with pytest.raises(tw.ModelError, match="has rotors"):
        robot.screws_at_com()
    with pytest.raises(tw.ModelError, match="has no actuators"):
        tw.robots.ur5().motor_loads(np.zeros(6), np.zeros(6), np.zeros(6))
    with pytest.raises(tw.ModelError, match="has an actuator already"):
        robot.with_actuators({"actuators": {"elbow_joint": {"ratio": 2}}})
    with pytest.raises(tw.ModelError, match="is floating; only joints of one degree"):
        tw.robots.floating_box().with_actuators({"actuators": {tw.robots.floating_box().joint_names[0]: {"ratio": 2}}})
    with pytest.raises(tw.ModelError, match="without a unit"):
        tw.robots.ur5().with_actuators({"actuators": {"elbow_joint": {"rotor": {"inertia": 1e-4}}}})
