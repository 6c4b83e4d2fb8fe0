"""One road from a log to loads: noise, standing joints and units of a log choose no drive."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.reports import motors
from twistwrench.sizing import choice, cycle

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

FOLDER = tw.robots.path_of("ur5").parent
CATALOG = json.loads(json.dumps(yaml.safe_load((FOLDER / "ur5_demo.drives.yaml").read_text())))
ARM = tw.robots.planar_2r()
ARM = ARM.with_payload(tw.SpatialInertia.from_com(2.0), ARM.link_names[-1])
TIME = np.linspace(0, 4, 501)
PHASE = np.clip(TIME / 3, 0, 1)  # the arm stands in the last second
SCALE, RATE, BEND = (
    np.where(PHASE < 1, x, 0.0)
    for x in (np.zeros_like(PHASE), (30 * PHASE**2 - 60 * PHASE**3 + 30 * PHASE**4) / 3,
              (60 * PHASE - 180 * PHASE**2 + 120 * PHASE**3) / 9)
)  # fmt: skip
WAY = np.array([1.2, -1.6])
Q = np.outer(10 * PHASE**3 - 15 * PHASE**4 + 6 * PHASE**5, WAY) + np.array([0.2, 0.4])
EXACT = tw.Motion(TIME, Q, np.outer(RATE, WAY), np.outer(BEND, WAY), robot=ARM)
SETTINGS = {"pause": 0.4, "ambient": 40.0, "add_masses": False}


def noisy(size, seed=3):
    return tw.Motion(TIME, Q + size * np.random.default_rng(seed).normal(size=Q.shape), robot=ARM)


def drives_of(sizing):
    return {name: one.drive for name, one in sizing.joints.items()}


@pytest.fixture(scope="module")
def exact():
    return tw.size_drives(ARM, EXACT, CATALOG, **SETTINGS)


@pytest.mark.parametrize(
    "noise", [0.0, pytest.param(1e-6, marks=pytest.mark.slow), pytest.param(1e-5, marks=pytest.mark.slow), 1e-4]
)
def test_noise_of_a_log_chooses_no_drive(noise, exact):
    """Exact rates, rates of a spline, and rates of noisy positions: one word, one drive, loads within the noise said."""
    found = tw.size_drives(ARM, noisy(noise), CATALOG, **SETTINGS)
    undecided = [name for name in found.joints if f"{name}: noise of the log decides between" in str(found.verdict)]
    assert exact.verdict.ok and (found.verdict.ok or undecided)
    for name, one in found.joints.items():
        assert one.drive == exact.joints[name].drive or name in undecided
        for part, true in zip(("gear", "motor"), (exact.joints[name].gear, exact.joints[name].motor), strict=True):
            if one.drive != exact.joints[name].drive:
                continue
            for d, e in zip(getattr(one, part).demands, true.demands, strict=True):
                assert d.what == e.what and abs(d.value - e.value) <= 5 * d.sigma + 0.02 * abs(e.value), (name, d, e)


def test_what_noise_adds_to_a_demand_is_taken_off():
    """Noise adds its variance to a mean square: once in the log, and once more in what is drawn about the log."""
    rng, exact = np.random.default_rng(0), np.sin(np.linspace(0, 20 * np.pi, 4000, endpoint=False))

    def demand(x):
        return motors.Demand("mean square", float(np.mean(x**2)), 1.0, "A²")

    log = exact + 0.3 * rng.normal(size=exact.shape)
    draws = [[demand(log + 0.3 * rng.normal(size=exact.shape))] for _ in range(12)]
    assert demand(log).value == pytest.approx(0.5 + 0.09, abs=0.02)
    (found,) = cycle.with_noise([demand(log)], draws)
    assert found.value == pytest.approx(0.5, abs=0.03) and 0 < found.sigma < 0.03


def test_noise_decides_between_two_drives_near_a_rating(exact):
    """A rating within the noise of the peak: neither OK with the smaller drive, nor a certain excess."""
    joint = ARM.joint_names[0]
    peak = exact.joints[joint].gear.peak_torque
    whole = CATALOG | {"gears": {"A": CATALOG["gears"]["G32"] | {"mass": "1 kg"}, "B": CATALOG["gears"]["G32"]}}
    whole["gears"]["A"]["repeated_peak"] = f"{1.0005 * peak} N m"
    found = tw.size_drives(ARM, noisy(1e-4), whole, **SETTINGS)
    assert found.verdict.word == "UNSURE" and found.joints[joint].drive[1] == "B"
    assert f"{joint}: noise of the log decides between gear A" in str(found.verdict)
    given = whole | {"actuators": {joint: {"motor": found.joints[joint].drive[0], "gear": "A"}}}
    judged = tw.size_drives(ARM, noisy(1e-4), given, **SETTINGS)
    assert judged.verdict.word == "UNSURE" and "noise of the log decides" in str(judged.verdict)
    assert tw.size_drives(ARM, EXACT, given, **SETTINGS).verdict.ok


def test_the_command_takes_the_road_of_torques(tmp_path, exact):
    """The command on a file equals the function on the motion; a log that torques refuses is refused."""
    joints = list(ARM.joint_names)
    (tmp_path / "drives.yaml").write_text(yaml.safe_dump(CATALOG))
    log = tmp_path / "log.csv"
    noisy(1e-4).to_csv(log)
    table = np.loadtxt(log, delimiter=",", skiprows=1)[:, :3]
    np.savetxt(log, table, delimiter=",", header=",".join(["time", *joints]), comments="", fmt="%.12g")
    given = ["--catalog", str(tmp_path / "drives.yaml"), "--pause", "0.4", "--ambient", "40", "--masses-included"]
    result = CliRunner().invoke(main, ["size", "planar_2r", str(log), "--payload", "2@" + ARM.link_names[-1], *given])
    found = tw.size_drives(ARM, noisy(1e-4), CATALOG, **SETTINGS)
    assert result.output.startswith(str(found.verdict.word)), result.output
    assert result.exit_code == found.verdict.exit_code and "The log has noise of 0.0001" in " ".join(
        result.output.split()
    )
    for _, gear in drives_of(found).values():
        assert f" {gear} " in result.output
    table[:, 0] *= 1000  # milliseconds without a word: no command judges it
    np.savetxt(log, table, delimiter=",", header=",".join(["time", *joints]), comments="", fmt="%.12g")
    words = [
        CliRunner().invoke(main, [*command, *more]).output.partition(":")[0]
        for command, more in (
            (["torques", "planar_2r", "--trajectory", str(log)], []),
            (["size", "planar_2r", str(log)], given),
        )
    ]
    assert words == ["LOOK AGAIN"] * 2


def test_a_base_that_nothing_holds_is_asked_about():
    """Drives of a floating robot without contacts carry too little: UNSURE, in the words of torques."""
    robot = tw.load(tw.robots.path_of("planar_2r"), floating_base=True)
    t = np.linspace(0, 1, 51)
    q = np.tile(robot.neutral, (51, 1))
    q[:, -1] += 0.1 * np.sin(np.pi * t) ** 2
    still = np.zeros((51, robot.nv))
    s = tw.size_drives(robot, tw.Motion(t, q, still, still, robot=robot), CATALOG, **SETTINGS)
    assert s.verdict.word == "UNSURE" and "nothing drives the base" in str(s.verdict)
    assert "contacts are missing" in str(s.verdict)


def test_equally_likely_motions_are_those_of_the_smoothed_one():
    """Mean of the draws near the motion, spread near that of the noise left by smoothing; velocity 0 at rest."""
    states = choice.LoadStates.from_motion(ARM, noisy(1e-4))
    assert len(states.draws) == 12 and not choice.LoadStates.from_motion(ARM, EXACT).draws
    mean = np.mean([one.ddq for one in states.draws], axis=0)
    spread = np.std([one.ddq for one in states.draws], axis=0).mean()
    assert 0 < np.abs(mean - states.motion.ddq).mean() < spread
    assert (states.motion.dq[-80:-20] == 0).all()  # at rest within the noise


def test_ratings_exceeded_by_a_log_whose_rows_are_in_doubt_are_not_certain(tmp_path):
    """The demo with three samples held: no robot moves so, and no drive is too small for it."""
    ur5 = tw.robots.ur5()
    motion = tw.Motion.from_file(FOLDER / "ur5_demo.csv", ur5)
    q = motion.q.copy()
    q[300:303] = q[300]
    head = ",".join(["time", *ur5.joint_names])
    np.savetxt(
        tmp_path / "log.csv", np.column_stack([motion.time, q]), delimiter=",", header=head, comments="", fmt="%.9g"
    )
    given = ["--catalog", "demo", "--masses-included"]
    result = CliRunner().invoke(main, ["size", "ur5", str(tmp_path / "log.csv"), *given])
    assert result.exit_code == 1 and result.output.startswith(
        "UNSURE: rows are missing, repeated or wrong at t = 2.4000 s"
    )
    assert "as a plan OVER LIMIT" in " ".join(result.output.split())
