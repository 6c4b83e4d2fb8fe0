"""Drive sizing: gear formulas and worked examples, temperature of windings, the choice from a catalogue, the command."""

from __future__ import annotations

import copy
import math
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner
from places import SHARED
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.formats.yaml import in_si
from twistwrench.mechanics.model.actuators import Thermal
from twistwrench.sizing import catalog as catalogs
from twistwrench.sizing import gear, winding
from twistwrench.sizing.sizing_view import worst_moment

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

RPM = 2 * math.pi / 60
UR5 = tw.robots.ur5().with_payload(tw.SpatialInertia.from_com(5.0), "tool0")
CATALOG = tw.robots.path_of("ur5").with_name("ur5_demo.drives.yaml")
MOTION = tw.Motion.from_file(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), UR5)
SETTINGS = {"pause": 0.8, "ambient": 40.0, "add_masses": False}


@pytest.fixture(scope="module")
def chosen():
    return tw.size_drives(UR5, MOTION, CATALOG, **SETTINGS)


# ── The page ──


def test_the_worst_moment_counts_from_the_first_row_of_the_log():
    """A log that begins at 100 s, and a demand half a second later."""
    cycle = tw.Motion(100.0 + MOTION.time, MOTION.q, robot=UR5)
    demand = SimpleNamespace(what="torque", share=0.9, time=0.5)
    joint = SimpleNamespace(joint="elbow_joint", tightest=("motor", demand))
    q, marked, title = worst_moment(SimpleNamespace(motion=cycle, joints={"elbow_joint": joint}))
    np.testing.assert_array_equal(q, MOTION.q[np.abs(MOTION.time - 0.5).argmin()])
    assert title.endswith("at t = 100.500 s") and marked.joint == "elbow_joint"


# ── Gears: worked examples of makers ──


def test_average_torque_of_a_makers_example():
    """HONPINE, How to select harmonic reduction gear: 89 N m printed."""
    torque, seconds, speed = np.array([150.0, 82, 130, 0]), np.array([0.2, 3, 0.3, 0.2]), np.array([10.0, 20, 10, 0])
    assert gear.average_torque(torque, speed, seconds) == pytest.approx(89.39, abs=0.005)


def test_selection_of_a_strain_wave_gear_as_recomputed():
    """The CSF & CSG catalogue's example for CSF-40-120, recomputed: the catalogue rounds T_av to 319 and n to 1,440."""
    torque, seconds, speed = np.array([400.0, 320, 200, 0]), np.array([0.3, 3, 0.4, 0.2]), np.array([7.0, 14, 7, 0])
    csf = gear.Gear("CSF-40-120", ratio=120, rated_torque=294, rated_speed=2000, life=35000)
    mean, turning = gear.average_torque(torque, speed, seconds), 120 * gear.average_speed(speed, seconds)
    assert (round(mean, 2), round(turning, 1)) == (319.74, 1443.1) and 120 * speed.max() == 1680
    assert round(gear.life_hours(csf, mean, turning)) == 7542
    assert round(gear.life_hours(csf, 319, 1440)) == 7611  # 7,610 printed
    assert round(gear.emergency_events(14 * RPM, 0.15, 120)) == 1190


def test_a_joint_that_only_holds_has_no_average_torque():
    assert math.isnan(gear.average_torque(np.array([5.0]), np.zeros(1), np.ones(1)))


@pytest.mark.parametrize("kind", ["axial", "radial", "tilting"])
def test_a_gear_whose_bearing_bears_too_little_is_over_its_limit(kind):
    """The largest load of the joint's bearing without drive masses is that of the robot itself."""
    loads = tw.statics.bearing_loads(UR5, MOTION.q, MOTION.dq, MOTION.ddq)
    largest = float(getattr(loads, kind)[:, loads.joints.index("elbow_joint")].max())
    for share, over in ((0.98, True), (1.02, False)):
        catalog = yaml.safe_load(CATALOG.read_text())
        for entry in catalog["gears"].values():
            entry[kind] = f"{share * largest} {'N m' if kind == 'tilting' else 'N'}"
        catalog["actuators"] = {"elbow_joint": {"motor": [*catalog["motors"]][-1], "gear": [*catalog["gears"]][-1]}}
        catalog.pop("pairs", None)
        sizing = tw.size_drives(UR5, MOTION, catalog, **SETTINGS)
        assert "bearings without limits in the catalogue" in " ".join(str(sizing).split())  # the others are counted
        demands = sizing.joints["elbow_joint"].gear.demands
        (found,) = (d for d in demands if "bearing" in d.what)
        assert found.over is over
        assert found.value == pytest.approx(largest, rel=1e-3)


# ── Temperature ──

PAIR = Thermal(housing_ambient=5.0, housing_time=900.0, winding_housing=3.0, winding_time=30.0, maximum=125.0)
PHASES = np.array([36.0, 4.0, 25.0, 0.0]), np.array([0.5, 1.0, 0.5, 2.0])


def test_worked_example_of_a_cycle():
    heated = winding.periodic_temperatures(PAIR, 0.5, *PHASES, 25.0)
    assert heated[0] == pytest.approx([65.077, 50.401], abs=5e-4)
    assert heated[:, 0].max() == pytest.approx(66.089, abs=5e-4)
    assert winding.runaway_current(PAIR, 0.5) == pytest.approx(8.006, abs=5e-4)
    assert winding.allowed_current(PAIR, 0.5, 25.0) == pytest.approx(4.212, abs=5e-4)


def test_it_repeats_and_solves_its_differential_equations():
    heated = winding.periodic_temperatures(PAIR, 0.5, *PHASES, 25.0)
    ends = np.concatenate([[0.0], np.cumsum(PHASES[1])])

    def rates(t, T):
        square = PHASES[0][min(np.searchsorted(ends, t, "right") - 1, 3)]
        flow = (T[0] - T[1]) / 3.0
        heat = 0.5 * (1 + 0.0039 * (T[0] - 20.0)) * square
        return [(heat - flow) / (30.0 / 3.0), (flow - (T[1] - 25.0) / 5.0) / (900.0 / 5.0)]

    for k in range(4):
        found = solve_ivp(rates, ends[k : k + 2] - [0, 1e-12], heated[k], rtol=1e-11, atol=1e-11).y[:, -1]
        assert np.abs(found - heated[k + 1]).max() < 1e-7
    assert np.abs(heated[-1] - heated[0]).max() < 1e-9


def test_one_mass_on_and_off_has_a_closed_form():
    """θ_max = θ_∞ (1 - e^(-a / τ)) / (1 - e^(-(a + b) / τ)) for a seconds on and b off, at a constant resistance."""
    one = Thermal(housing_ambient=2.0, housing_time=100.0, maximum=200.0, coefficient=0.0)
    heated = winding.periodic_temperatures(one, 0.7, np.array([9.0, 0.0]), np.array([40.0, 70.0]), 30.0)[:, 0]
    peak = 0.7 * 9.0 * 2.0 * (1 - math.exp(-0.4)) / (1 - math.exp(-1.1))
    assert heated == pytest.approx([30 + peak * math.exp(-0.7), 30 + peak, 30 + peak * math.exp(-0.7)], abs=1e-9)


def test_constant_current_has_a_closed_form_and_transitions_are_exponentials():
    heated = winding.periodic_temperatures(PAIR, 0.5, np.array([9.0, 9.0]), np.array([3.0, 4.0]), 25.0)
    loss = 0.5 * 9.0 * (1 + 0.0039 * 5.0)
    rise = loss * 8.0 / (1 - 0.5 * 9.0 * 0.0039 * 8.0)
    assert heated[:, 0] == pytest.approx(25 + rise, abs=1e-6)
    for square, seconds in ((0.0, 1e-3), (30.0, 5.0), (64.0, 2000.0), (64.1026, 10.0), (90.0, 60.0)):
        C_w, C_h = 10.0, 180.0
        A = np.array([
            [(0.5 * 0.0039 * square - 1 / 3) / C_w, 1 / (3 * C_w), 0.5 * (1 + 0.0039 * 5) * square / C_w],
            [1 / (3 * C_h), -(1 / 3 + 1 / 5) / C_h, 0.0],
            [0.0, 0.0, 0.0],
        ])  # fmt: skip
        found = winding.transitions(PAIR, 0.5, np.array([square]), np.array([seconds]), 25.0)[0]
        assert np.abs(found - expm(A * seconds)).max() < 1e-9 * np.abs(expm(A * seconds)).max()


def test_runaway_begins_at_its_current():
    for share, finite in ((0.999, True), (1.001, False)):
        square = np.array([(share * winding.runaway_current(PAIR, 0.5)) ** 2])
        assert np.isfinite(winding.periodic_temperatures(PAIR, 0.5, square, np.array([2.0]), 25.0)).all() == finite


# ── Loads ──


def test_loads_are_those_of_the_robot_with_these_actuators(chosen):
    """Motor torques against motor_loads of a robot with all rotors as bodies."""
    driven = UR5.with_actuators(chosen.actuators())
    loads = driven.motor_loads(MOTION.q, MOTION.dq, MOTION.ddq)
    for k, one in enumerate(chosen.joints.values()):
        n = len(MOTION)
        assert np.abs(one.motor.torque[:n] - loads.torque[:, k]).max() < 1e-9 * np.abs(loads.torque[:, k]).max()


def test_masses_of_drives_load_joints_nearer_the_base_alone():
    with_mass, without = (tw.size_drives(UR5, MOTION, CATALOG, pause=0.8, add_masses=x) for x in (True, False))
    heavier = [np.abs(a.cycle.torque).max() - np.abs(b.cycle.torque).max()
               for a, b in zip(with_mass.joints.values(), without.joints.values(), strict=True)]  # fmt: skip
    assert heavier[1] > 5.0 and abs(heavier[-1]) < 1e-3
    assert with_mass.choice["wrist_3_joint"].drive == without.choice["wrist_3_joint"].drive


def test_the_pause_holds_the_robot_unless_brakes_do(chosen):
    braked = tw.size_drives(UR5, MOTION, CATALOG, brake=True, **SETTINGS)
    name = "elbow_joint"
    held = chosen.joints[name].motor.torque[-1]
    load = UR5.gravity_forces(MOTION.q[-1])[2]
    gear = chosen.catalog.gears[chosen.joints[name].drive[1]]
    assert held == pytest.approx(load / gear.efficiency / gear.ratio)
    assert braked.joints[name].motor.torque[-1] == 0.0
    assert (
        braked.joints[name].motor.rms_torque < chosen.joints[name].motor.rms_torque
        or braked.joints[name].drive != chosen.joints[name].drive
    )


def test_supply_of_a_cycle_adds_up(chosen):
    power = sum(one.motor.power for one in chosen.joints.values())
    s, time = chosen.supply, next(iter(chosen.joints.values())).cycle.time
    assert s.drawn - s.braked == pytest.approx(np.trapezoid(power, time), rel=1e-9)
    assert s.peak == pytest.approx(power.max()) and s.mean == pytest.approx(s.drawn / time[-1])
    apart = tw.size_drives(UR5, MOTION, CATALOG, shared_supply=False, **SETTINGS).supply
    assert apart.drawn >= s.drawn and apart.drawn - apart.braked == pytest.approx(s.drawn - s.braked)


# ── The choice ──


def figures(one, entry, gear, life):
    """Whether a pair keeps all its ratings under the loads of a joint, by formulas written out here."""
    c, n = one.cycle, one.cycle.duration
    speed, torque = np.abs(c.speed[1:] + c.speed[:-1]) / 2, np.abs(c.torque)
    turned = (np.abs(c.speed[1:]) + np.abs(c.speed[:-1])) / 2 * n
    p, mid = gear.mean_exponent, (torque[1:] + torque[:-1]) / 2
    mean = (turned @ mid**p / turned.sum()) ** (1 / p) if turned.sum() else 0.0
    turning = gear.ratio * turned.sum() / n.sum()
    fits = mean <= gear.average_torque and torque.max() <= gear.repeated_peak
    fits &= turning <= gear.average_speed and gear.ratio * np.abs(c.speed).max() <= gear.maximum_speed
    if life and gear.kind == "strain_wave" and mean:
        fits &= gear.life / 5 * (gear.rated_torque / mean) ** 3 * gear.rated_speed / turning >= life
    driving = c.torque * c.speed >= 0
    through = c.torque * np.where(driving, 1 / gear.efficiency, gear.efficiency)
    G, J = gear.ratio, entry.inertia
    tau = through / G + J * (G * c.acceleration + c.carrier) + gear.no_load_torque * np.sign(c.speed)
    m, heat = entry.motor, entry.motor.thermal
    hot = m.resistance * (1 + heat.coefficient * (heat.maximum - heat.reference))
    volts = m.torque_constant * G * c.speed + hot * tau / m.torque_constant
    fits &= np.abs(volts).max() <= m.voltage and np.abs(tau).max() / m.torque_constant <= m.current_peak
    fits &= G * np.abs(c.speed).max() <= m.speed
    i = tau / m.torque_constant
    squares = (i[1:] ** 2 + i[1:] * i[:-1] + i[:-1] ** 2) / 3
    warm = winding.periodic_temperatures(heat, m.resistance, squares, n, SETTINGS["ambient"])[:, 0].max()
    return bool(fits and warm <= heat.maximum), speed


@pytest.mark.parametrize("life", [None, 8000.0])
def test_the_choice_is_that_of_an_exhaustive_search(life):
    s = tw.size_drives(UR5, MOTION, CATALOG, life=life, **SETTINGS)
    assert len(s.catalog.pairs) == 36 and len(s.catalog.motors) == 6
    for name, one in s.joints.items():
        fitting = [pair for pair in s.catalog.pairs if figures(one, *s.catalog.pair(pair), life)[0]]
        assert one.drive == min(fitting, key=s.catalog.size), name
    assert s.verdict.ok


def test_the_next_smaller_drive_fails_for_the_reason_printed(chosen):
    told = {name: c.smaller for name, c in chosen.choice.items() if c.smaller}
    assert len(told) >= 3
    for name, (pair, reason) in told.items():
        drives_ = {n: {"motor": j.drive[0], "gear": j.drive[1]} for n, j in chosen.joints.items()}
        drives_[name] = {"motor": pair[0], "gear": pair[1]}
        whole = yaml.safe_load(CATALOG.read_text()) | {"actuators": drives_}
        s = tw.size_drives(UR5, MOTION, whole, **SETTINGS)
        assert not figures(s.joints[name], *s.catalog.pair(pair), None)[0]
        assert s.verdict.word == "OVER LIMIT" and reason in s.joints[name].excess
        assert s.choose().joints[name].drive == chosen.joints[name].drive


def test_missing_ratings_are_named_and_a_complete_drive_is_preferred():
    whole = yaml.safe_load(CATALOG.read_text())
    del whole["gears"]["G14"]["average_torque"]
    s = tw.size_drives(UR5, MOTION, whole, **SETTINGS)
    assert all(j.drive[1] != "G14" for j in s.joints.values()) and s.verdict.ok
    whole["actuators"] = {"wrist_1_joint": {"motor": "M40", "gear": "G14"}}
    s = tw.size_drives(UR5, MOTION, whole, **SETTINGS)
    assert str(s.verdict) == "UNSURE: wrist_1_joint, gear G14: average_torque not given"
    assert "shoulder_pan_joint" in s.left_out


def test_an_emergency_asks_for_the_momentary_peak():
    stop = tw.Motion(MOTION.time / 4, MOTION.q, robot=UR5)
    whole = yaml.safe_load(CATALOG.read_text())
    whole["actuators"] = {"shoulder_lift_joint": {"motor": "M115", "gear": "G25"}}
    s = tw.size_drives(UR5, MOTION, whole, emergency=stop, **SETTINGS)
    shock = next(d for d in s.joints["shoulder_lift_joint"].gear.demands if d.what == "emergency torque")
    assert shock.limit == 284 and shock.value > s.joints["shoulder_lift_joint"].gear.peak_torque


def test_servos_of_a_small_arm_are_unsure():
    path = SHARED / "robots" / "trossen_wx250s.urdf"
    if not path.is_file():
        pytest.skip("the folder of robot files is not there")
    arm = tw.load(path)
    t = np.linspace(0.0, 4.0, 401)
    sway = 0.3 * np.sin(np.pi * t / 4)[:, None] ** 2
    q = arm.neutral + sway * np.array([1.0 if k < 6 else 0.0 for k in range(arm.nq)])
    s = tw.size_drives(arm, tw.Motion(t, q, robot=arm), "servos")
    assert s.verdict.word == "UNSURE" and all("stall data only" in reason for reason in s.verdict.reasons)


def test_units_of_makers():
    assert in_si("30 kgf cm", "torque", "x") == pytest.approx(30 * 9.80665 / 100)
    assert in_si("100 ozf in", "torque", "x") == pytest.approx(100 * 0.028349523125 * 9.80665 * 0.0254)
    assert (in_si("2 min", "time", "x"), in_si("3 K/W", "thermal resistance", "x"), in_si("125 degC", "temperature", "x")) == (
        120.0, 3.0, 125.0)  # fmt: skip


# ── Bad input ──

GOOD = {
    "motors": {"B": {
        "torque_constant": "0.05 N m/A", "resistance": "0.5 ohm", "voltage": "48 V", "mass": "0.4 kg", "price": 180,
        "rotor": {"inertia": "120 g cm^2"}, "thermal": {"housing_ambient": "5 K/W", "housing_time": "900 s"},
    }},
    "gears": {"G": {"ratio": 100, "efficiency": 0.7, "average_torque": "108 N m"}},
}  # fmt: skip


def test_of_drives_of_equal_mass_the_cheaper_one_is_the_smaller():
    gears = {
        name: GOOD["gears"]["G"] | {"mass": "1 kg", "price": price} for name, price in (("dear", 300), ("cheap", 200))
    }
    catalog = catalogs.read_catalog(GOOD | {"gears": gears})
    assert min(catalog.pairs, key=catalog.size) == ("B", "cheap")


BAD = {
    "no unit": (("motors", "B", "mass"), 0.4, "without a unit"),
    "unit of another kind": (("motors", "B", "thermal", "housing_time"), "900 K/W", "Known here: s"),
    "unknown entry": (("motors", "B", "torqe"), "1 N m", "torqe"),
    "unknown rating": (("gears", "G", "peak"), "1 N m", "peak"),
    "no torque constant": (("motors", "B", "torque_constant"), None, "no torque_constant"),
    "no ratio": (("gears", "G", "ratio"), None, "has no ratio"),
    "ratio of zero": (("gears", "G", "ratio"), 0, "ratio 0"),
    "efficiency above one": (("gears", "G", "efficiency"), 1.2, "efficiency 1.2"),
    "kind": (("gears", "G", "kind"), "cycloid", "strain_wave"),
    "negative rating": (("gears", "G", "average_torque"), "-5 N m", "must be above 0"),
    "negative mass": (("motors", "B", "mass"), "-1 kg", "at least 0"),
    "negative resistance": (("motors", "B", "resistance"), "-1 ohm", "resistance -1"),
    "rotor without inertia": (("motors", "B", "rotor"), {}, "inertia must be given"),
    "half a winding": (("motors", "B", "thermal", "winding_time"), "30 s", "thermal data"),
    "thermal without time": (("motors", "B", "thermal", "housing_time"), None, "no housing_time"),
    "cold maximum": (("motors", "B", "thermal", "maximum"), "10 degC", "thermal data"),
    "pair of one": (("pairs",), [["B"]], "expected a motor and a gear"),
    "pairs as text": (("pairs",), "B G", "expected pairs"),
    "pair of unknown motor": (("pairs",), [["C", "G"]], "motor of the catalogue"),
    "pair of unknown gear": (("pairs",), [["B", "H"]], "gear of the catalogue"),
    "joint that is not there": (("actuators",), {"knee": {"motor": "B", "gear": "G"}}, "knee"),
    "drive without motor": (("actuators",), {"hinge": {"gear": "G"}}, "has no motor"),
    "motors of nothing": (("motors",), {}, "no entry 'motors:'"),
    "no motors": (("motors",), None, "no entry 'motors:'"),
    "no gears": (("gears",), None, "no entry 'gears:'"),
    "motors as a list": (("motors",), ["B"], "expected entries"),
    "servo without speed": (("motors",), {"S": {"stall_torque": "1 N m", "voltage": "5 V"}}, "no no_load_speed"),
    "servo of nothing": (("motors",), {"S": {"stall_torque": "0 N m", "voltage": "5 V", "no_load_speed": "1 rpm"}}, "above 0"),
}  # fmt: skip


def broken(place, value):
    content = copy.deepcopy(GOOD)
    at = content
    for key in place[:-1]:
        at = at[key]
    if value is None:
        del at[place[-1]]
    else:
        at[place[-1]] = value
    return content


PENDULUM = tw.robots.pendulum()
SWING = tw.Motion(t := np.linspace(0, 2, 101), np.sin(np.pi * t / 2)[:, None] ** 2, robot=PENDULUM)


@pytest.mark.parametrize("name", BAD)
def test_bad_catalogues_are_one_error_that_names_the_entry(name, tmp_path):
    place, value, words = BAD[name]
    with pytest.raises(tw.TwistWrenchError) as error:
        tw.size_drives(PENDULUM, SWING, broken(place, value))
    assert words in str(error.value), str(error.value)
    file = tmp_path / "drives.yaml"
    file.write_text(yaml.safe_dump(broken(place, value)))
    words = "no unit" if name == "no unit" else words  # YAML's numbers are read as text
    with pytest.raises(type(error.value)) as error:
        catalogs.read_catalog(file) if place != ("actuators",) or "hinge" in value else tw.size_drives(
            PENDULUM, SWING, file
        )
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [({"pause": -1.0}, "pause"), ({"pause": math.nan}, "pause"), ({"life": 0.0}, "life"), ({"ambient": 2000.0}, "ambient"),
     ({"ambient": "warm"}, "ambient")],
)  # fmt: skip
def test_bad_settings(settings, words):
    with pytest.raises(tw.TwistWrenchError, match=words):
        tw.size_drives(PENDULUM, SWING, GOOD, **settings)


def test_robots_with_actuators_and_missing_files_are_refused():
    driven = PENDULUM.with_actuators({"actuators": {"hinge": {"ratio": 5}}})
    with pytest.raises(tw.ModelError, match="has actuators already"):
        tw.size_drives(driven, SWING, GOOD)
    with pytest.raises(tw.NotFoundError, match="no catalogue"):
        tw.size_drives(PENDULUM, SWING, "nowhere.yaml")


@pytest.mark.parametrize(
    "given", [(5, SWING, GOOD), (PENDULUM, SWING.q, GOOD), (PENDULUM, SWING, 5), (UR5, SWING, GOOD)]
)
def test_arguments_of_another_type_are_refused(given):
    with pytest.raises(tw.TwistWrenchError, match=r"size_drives|motors come from|the motion belongs to robot"):
        tw.size_drives(*given)


def test_a_motor_that_is_too_fast_is_said_to_be_so():
    content = broken(("gears", "G", "ratio"), 900)
    content["motors"]["B"]["speed"] = "3000 rpm"
    content["actuators"] = {"hinge": {"motor": "B", "gear": "G"}}
    s = tw.size_drives(PENDULUM, SWING, content)
    assert any("speed 13500 rpm of 3000 (450 %)" in reason for reason in s.verdict.reasons), s.verdict


# ── The command ──


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        result = CliRunner().invoke(main, ["size", *map(str, arguments)])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.output

    return run


COMMON = ("ur5", "demo", "--payload", "5", "--pause", "0.8", "--ambient", "40", "--masses-included")


def test_the_command_chooses_and_writes(run, tmp_path, chosen):
    code, output = run(*COMMON, "--catalog", "demo", "--csv", "f.csv", "--plot", "p.png", "--out-actuators", "a.yaml")
    assert code == 0 and output.startswith("OK: all ratings kept. Closest: elbow_joint, gear G17: peak torque"), output
    said = " ".join(output.split())
    assert "shoulder_pan_joint: the next smaller (gear G14 with motor M50) fails: gear G14: average torque" in said
    assert (tmp_path / "p.png").stat().st_size > 20_000
    assert (
        (tmp_path / "f.csv")
        .read_text()
        .startswith("joint,part,name,figure,value,limit,unit,share\nshoulder_pan_joint,gear,G17")
    )
    again = UR5.with_actuators(tmp_path / "a.yaml").actuators
    assert again["elbow_joint"].motor.thermal.maximum == 125.0 and again["elbow_joint"].ratio == 100


def test_given_drives_are_judged_and_the_smallest_that_does_it_is_named(run, tmp_path):
    whole = yaml.safe_load(CATALOG.read_text())
    whole["actuators"] = {"elbow_joint": {"motor": "M50", "gear": "G14"}}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(whole))
    code, output = run(*COMMON, "--catalog", "mine.yaml")
    said = " ".join(output.split())
    assert code == 1 and said.startswith("OVER LIMIT: elbow_joint, "), output
    assert "elbow_joint: smallest that does it: gear G17 with motor M70 (+0.55 kg)" in said
    code, output = run(*COMMON, "--catalog", "mine.yaml", "--choose")
    assert code == 0 and output.startswith("OK"), output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--catalog", "nowhere.yaml"], "nowhere.yaml"),
        ([], "--catalog"),
        (["--catalog", "demo", "--actuators", "demo"], "Leave --actuators out"),
        (["--catalog", "demo", "--pause=-1"], "pause"),
        (["--catalog", "demo", "--life", "0"], "life"),
    ],
)
def test_bad_options_are_one_line(arguments, words, run, tmp_path):
    code, output = run("ur5", "demo", *arguments)
    assert code == 2 and words in output and not list(tmp_path.iterdir()), output


def test_drives_are_chosen_by_the_names_that_a_catalogue_made_in_python_gives_them():
    """Keys of such a catalogue need not be the names inside its motors and gears."""
    named = catalogs.read_catalog(CATALOG)
    pairs = tuple((f"my {motor}", gear) for motor, gear in named.pairs)
    renamed = catalogs.Catalog({f"my {name}": motor for name, motor in named.motors.items()}, named.gears, pairs)
    by_name = tw.size_drives("ur5", "demo", named, **SETTINGS)
    by_key = tw.size_drives("ur5", "demo", renamed, **SETTINGS)
    assert by_key.verdict.word == by_name.verdict.word
    assert [joint.mass for joint in by_key.joints.values()] == [joint.mass for joint in by_name.joints.values()]
