"""What the torques command says of logs as they are: noise, the log's own torques, units, delays, other robots' logs."""

from __future__ import annotations

import re

import numpy as np
import pytest
from motions import report_of, write_motion, write_positions
from places import SHARED

import twistwrench as tw
from twistwrench.core.errors import TrajectoryError
from twistwrench.mechanics.model.model import Limits
from twistwrench.motion import MotionLog
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.reports.drawn_motion import motion_of
from twistwrench.reports.torque_analysis import analyse

pytest_plugins = ("torque_fixtures",)
LOGS = SHARED / "logs"
PENDULUM = LOGS / "dfki_simple_pendulum"
real = pytest.mark.skipif(not PENDULUM.is_dir(), reason="the folder ../shared/logs is not there")


def first_lines(text):
    """What stands before the first blank line: the verdict and its reasons, in one line. Notes of loading go before it."""
    start = re.search(r"^(OK|UNSURE|OVER LIMIT|LOOK AGAIN)", text, re.MULTILINE).start()
    return " ".join(text[start:].split("\n\n")[0].split())


@pytest.fixture(scope="module")
def arm():
    return tw.robots.planar_2r()


def swing(seconds=4.0, hz=200):
    """A motion of two joints and its rates: t (n,), q, dq, ddq (n, 2)."""
    t = np.arange(0.0, seconds, 1.0 / hz)
    w, size = np.array([2.0, 3.1]), np.array([0.6, 0.8])
    s = np.outer(t, w) + np.array([0.3, 1.0])
    return t, size * np.sin(s), size * w * np.cos(s), -size * w**2 * np.sin(s)


# ── the log's own torques ──


@real
def test_a_real_log_whose_own_torques_are_others_is_no_ok(run):
    """Rattling gears: computed torques of some 100 N m and as much noise, where the log's own column has 17.6 at most."""
    flags = ("--trajectory", PENDULUM / "sysid_pd_measured.csv")
    code, text = run("torques", PENDULUM / "dfki_simple_pendulum.urdf", *flags)
    assert code == 1
    assert first_lines(text).startswith("UNSURE: noise is too large a part of the peak: Joint_1")
    assert "-17.59 in the file's own torque column" in first_lines(text)


@real
@pytest.mark.parametrize("log, announced", [("060143", False), ("063536", True)])
def test_a_real_log_with_friction_compensation_is_told_from_one_without(run, tmp_path, log, announced):
    """A double pendulum of the published parameters; what the controller made up for is missing in the second log."""
    path = LOGS / "dfki_double_pendulum" / f"20220812-{log}-PM_measured.csv"
    robot = tmp_path / "pendulum.urdf"
    robot.write_text(
        f'<robot name="double"><link name="base"/>{rod(1, "base", 0, 0.278, 0.608, 0.0069)}'
        f"{rod(2, 'link1', -0.3, 0.185, 0.6, 0.0034)}</robot>"
    )
    _, text = run("torques", robot, "--trajectory", path)
    assert ("own torque column disagrees" in first_lines(text)) == announced


def rod(k, parent, z, com, mass, moment):
    return (
        f'<link name="link{k}"><inertial><origin xyz="0 0 {-com}"/><mass value="{mass}"/><inertia ixx="{moment}" iyy="{moment}" '
        f'izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="joint{k}" type="continuous"><parent '
        f'link="{parent}"/><child link="link{k}"/><axis xyz="0 1 0"/><origin xyz="0 0 {z}"/><limit effort="8" velocity="20"/>'
        '<dynamics damping="0.005" friction="0.08"/></joint>'
    )


def with_torques(path, robot, tau, columns=None):
    t, *motion = swing()
    return write_motion(path, robot, t, [*(columns or motion), tau], ("", ".vel", ".acc", ".tau"))


def own_torques(robot):
    return np.asarray(robot.inverse_dynamics(*swing()[1:], friction=True))


def verdict_of(robot, path, **load):
    return report_of(robot, path, **load).verdict


def test_torques_that_agree_are_compared_and_change_no_verdict(arm, tmp_path):
    rng = np.random.default_rng(2)
    tau = own_torques(arm)
    measured = 1.1 * tau + 0.1 * np.abs(tau).max() * rng.normal(size=tau.shape)
    report = report_of(arm, with_torques(tmp_path / "m.csv", arm, measured))
    assert report.verdict == report_of(arm, with_torques(tmp_path / "n.csv", arm, tau)).verdict
    for k, m in enumerate(report.measured):
        assert not m.disagrees
        assert m.measured == pytest.approx(np.sqrt(np.mean(measured[:, k] ** 2)))
        assert m.computed == pytest.approx(np.sqrt(np.mean(tau[:, k] ** 2)))
        assert m.residual == pytest.approx(np.sqrt(np.mean((measured - tau)[:, k] ** 2)))
        assert m.peak == measured[np.abs(measured[:, k]).argmax(), k]


@pytest.mark.parametrize(
    "factor, said", [(-1.0, "has the opposite sign of what is computed"), (0.02, "is 0.02 times what is computed")]
)
def test_torques_of_another_sign_or_unit_are_looked_at_again(arm, tmp_path, factor, said):
    verdict = verdict_of(arm, with_torques(tmp_path / "m.csv", arm, factor * own_torques(arm)))
    assert verdict.word == "LOOK AGAIN"
    assert said in str(verdict)


def test_torques_that_friction_explains_are_unsure(arm, tmp_path):
    """Friction that the robot's file lacks only adds to what is measured."""
    tau = own_torques(arm)
    friction = 3 * np.abs(tau).max(axis=0) * np.sign(swing()[2])
    verdict = verdict_of(arm, with_torques(tmp_path / "m.csv", arm, tau + friction))
    assert verdict.word == "UNSURE"
    assert "the file's own torque column disagrees" in str(verdict)


def test_a_dead_torque_column_is_noted_and_not_compared(run, arm, tmp_path):
    path = with_torques(tmp_path / "m.csv", arm, np.zeros((len(swing()[0]), 2)))
    code, text = run("torques", "planar_2r", "--trajectory", path)
    assert (code, "UNSURE: no torque limit for 2 of 2 joints" in text) == (1, True), text
    assert "never changes, and is not compared, for joint1, joint2" in " ".join(text.split())


def test_a_log_may_have_been_recorded_with_the_payload_or_without(arm, tmp_path):
    """What a payload would add to a log of the empty robot contradicts nothing."""
    carried = Payload(5.0, (0.2, 0.0, 0.1))
    loaded = LoadCase(arm, (carried,)).with_load
    for robot in (arm, loaded):
        path = with_torques(tmp_path / "m.csv", arm, own_torques(robot))
        assert not any(m.disagrees for m in report_of(arm, path, payloads=(carried,)).measured)


# ── noise ──


def noisy(path, robot, sigma=1e-3, seed=4):
    t, q, *_ = swing()
    return write_positions(path, robot, t, q + sigma * np.random.default_rng(seed).normal(size=q.shape))


def test_a_peak_that_is_mostly_noise_is_unsure_where_no_limit_is_known(arm, tmp_path):
    path = noisy(tmp_path / "m.csv", arm, 3e-3)
    free = Limits(np.full(2, -99.0), np.full(2, 99.0), np.full(2, 99.0), np.full(2, np.inf))
    report = report_of(arm, path, limits=free)
    assert report.verdict.word == "UNSURE"
    assert "noise is too large a part of the peak" in str(report.verdict)
    clean = write_positions(tmp_path / "c.csv", arm, *swing()[:2])
    [reason] = report_of(arm, clean, limits=free).verdict.reasons
    assert reason.startswith("no torque limit for 2 of 2 joints")


@pytest.mark.parametrize("sigma", [1e-5, 1e-3, 1e-2])
def test_the_report_of_a_noisy_log_is_of_one_instant_and_one_estimate(arm, tmp_path, sigma):
    out = tmp_path / "o.csv"
    report = report_of(arm, noisy(tmp_path / "m.csv", arm, sigma), csv=out, split=True)
    names = out.read_text().splitlines()[0].split(",")
    table = dict(zip(names, np.loadtxt(out, delimiter=",", skiprows=1).T, strict=True))
    assert report.noisy
    for k, j in enumerate(report.joints):
        # The causes, and what noise added, make the peak.
        assert sum(j.terms.values()) == pytest.approx(j.largest, rel=1e-9)
        assert j.largest + j.chance == pytest.approx(j.peak)
        # What is taken off turns no sign about, and adds nothing.
        assert 0 <= j.peak * np.sign(j.largest) <= abs(j.largest)
        torque = table[f"{j.joint}.torque"]
        row = int(np.abs(torque).argmax())
        assert (table["time"][row], torque[row]) == (j.time, pytest.approx(j.largest))
        for term, value in j.terms.items():
            assert table[f"{j.joint}.{term}"][row] == pytest.approx(value, abs=1e-9 * report.scale)
        raw = table[f"{j.joint}.torque.derived"]
        row = int(np.abs(raw).argmax())
        assert (table["time"][row], raw[row]) == (j.raw_time, pytest.approx(j.raw))
        if k == report.worst:
            at = int(np.argmin(np.abs(report.around.time - j.time)))
            assert report.around.time[at] == j.time
            assert report.load.explain(report.around[at]).torque[k] == pytest.approx(j.largest)
        least, greatest = (edge[:, k] for edge in report.envelope[1:])
        assert max(-least.min(), greatest.max()) == pytest.approx(abs(j.largest))


def test_noise_takes_no_more_off_a_peak_than_accelerations_make(arm, tmp_path):
    """Velocities with noise of 5 rad/s: of the largest torque, what holds the arm up is certain, and the interval tells the
    rest."""
    t, q, dq, _ = swing()
    dq = dq + 5.0 * np.random.default_rng(4).normal(size=q.shape)
    report = report_of(arm, write_motion(tmp_path / "m.csv", arm, t, [q, dq], ("", ".vel")))
    true = np.abs(own_torques(arm)).max(axis=0)
    for k, j in enumerate(report.joints):
        way = np.sign(j.largest)
        assert way * j.peak >= min(max(0.0, way * j.terms["gravity"]), abs(j.largest)) - 1e-9
        assert abs(abs(j.peak) - true[k]) < 1.96 * j.uncertainty
    assert abs(report.joints[0].chance) > 0.3 * abs(report.joints[0].largest), "the case is one of noise"


def test_why_adds_up_to_the_peak_of_the_table(run, arm, tmp_path):
    path = noisy(tmp_path / "m.csv", arm)
    report = report_of(arm, path)
    j = report.joints[report.worst]
    _, text = run("torques", "planar_2r", "--trajectory", path, "--why")
    assert f"Why {j.joint} at t = {j.time:.3f} s" in text
    together = next(line for line in text.splitlines() if line.strip().startswith("together"))
    assert float(together.split()[-1]) == pytest.approx(j.peak, rel=1e-3)


def test_smooth_leaves_out_what_is_raw_and_changes_no_estimate(arm, tmp_path):
    path = noisy(tmp_path / "m.csv", arm)
    plain, smoothed = (report_of(arm, path, smoothing=x, csv=tmp_path / f"{x}.csv") for x in (False, True))
    assert [(j.peak, j.time, j.uncertainty) for j in smoothed.joints] == [
        (j.peak, j.time, j.uncertainty) for j in plain.joints
    ]
    assert all(j.raw is None for j in smoothed.joints)
    assert "derived" in (tmp_path / "False.csv").read_text().splitlines()[0]
    assert "derived" not in (tmp_path / "True.csv").read_text().splitlines()[0]


def test_the_picture_of_a_noisy_log_shows_the_estimate_and_cuts_off_what_is_raw(arm, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    from twistwrench.viz import style
    from twistwrench.viz.plots.torques import plot_report

    drawn = []
    monkeypatch.setattr(style, "save", lambda figure, path: drawn.append(figure))
    report = report_of(arm, noisy(tmp_path / "m.csv", arm))
    plot_report(report, tmp_path / "o.png")
    for k, axis in enumerate(drawn[0].axes[:2]):
        j = report.joints[k]
        low, high = axis.get_ylim()
        assert low <= -abs(j.largest) * (j.largest < 0)
        assert high >= abs(j.largest) * (j.largest > 0)
        assert abs(j.raw) > 2 * max(-low, high), "raw peaks would flatten the curve"
        at = [line.get_xydata() for line in axis.lines if line.get_marker() == "o"]
        assert [tuple(x[0]) for x in at] == [(j.time, pytest.approx(j.peak))]


# ── payloads ──


def test_a_payload_that_loads_no_joint_is_remarked(run, tmp_path):
    robot = tw.robots.pendulum()
    t = np.arange(0.0, 2.0, 0.01)
    path = write_positions(tmp_path / "m.csv", robot, t, 0.5 * np.sin(t)[:, None])
    on_axis = f"1@{robot.link_names[1]}"
    said = "What is carried makes no torque in any joint"
    assert said in " ".join(run("torques", "pendulum", "--trajectory", path, "--payload", on_axis)[1].split())
    beside = on_axis.replace("@", ",0.1,0.1,0.1@")
    assert said not in " ".join(run("torques", "pendulum", "--trajectory", path, "--payload", beside)[1].split())


# ── units ──


def poses(size):
    """Six joints that swing by ``size`` each: t (n,), q (n, 6)."""
    t = np.arange(0.0, 4.0, 0.01)
    return t, size * np.sin(np.outer(t, [1.0, 1.2, 0.8, 0.5, 0.9, 1.1]))


def test_angles_of_the_motors_are_looked_at_again_in_the_first_lines(run, ur5, tmp_path):
    t, q = poses(0.5)
    code, text = run("torques", "ur5", "--trajectory", write_positions(tmp_path / "m.csv", ur5, t, 101 * q))
    assert code == 1
    said = first_lines(text)
    assert said.startswith("LOOK AGAIN: ")
    assert "those of the motors, before their gears" in said
    code, text = run("torques", "ur5", "--trajectory", write_positions(tmp_path / "n.csv", ur5, t, q))
    assert code == 0, text
    assert "UNIT" not in text


@real
def test_real_positions_of_motors_are_looked_at_again(run, tmp_path):
    """The first 0.4 s of them, before the gears of 32 to 48."""
    robot, path = LOGS.parent / "robots" / "staubli_tx40.urdf", tmp_path / "m.csv"
    lines = (LOGS / "staubli_tx40" / "pos_read_data.csv").read_text().splitlines()
    path.write_text("\n".join(lines[:2001]) + "\n")
    flags = ("--trajectory", path, "--rate", "5000")
    assert "before their gears" in first_lines(run("torques", robot, *flags)[1])


def test_degrees_that_are_radians_are_looked_at_again_in_the_first_lines(run, ur5, tmp_path):
    t, q = poses(1.5)
    path = write_positions(tmp_path / "m.csv", ur5, t, q)
    code, text = run("torques", "ur5", "--trajectory", path, "--degrees")
    assert code == 1
    assert first_lines(text).startswith("LOOK AGAIN: read in degrees, no angle is beyond 1.5 degrees")
    turned = write_positions(tmp_path / "d.csv", ur5, t, np.degrees(q))
    assert run("torques", "ur5", "--trajectory", turned, "--degrees")[0] == 0


def test_a_unit_that_is_odd_and_may_be_meant_is_asked_about_in_the_first_lines(run, arm, tmp_path):
    """Two joints may well stay within two degrees; their verdict stands."""
    t, q, *_ = swing()
    path = write_positions(tmp_path / "m.csv", arm, t, q)
    code, text = run("torques", "planar_2r", "--trajectory", path, "--degrees")
    assert (code, "UNSURE: no torque limit for 2 of 2 joints" in text) == (1, True), text
    assert "IS THE UNIT RIGHT?" in first_lines(text)
    assert "seems to be in radians" in first_lines(text)


def test_a_unit_of_the_header_is_believed_if_the_option_confirms_it(run, ur5, tmp_path):
    """Small angles in degrees are more often radians under a wrong head: alone it is asked about."""
    t, q = poses(1.5)
    path = write_positions(tmp_path / "m.csv", ur5, t, q)
    path.write_text(re.sub(r"(\w+_joint)", r"\1 [deg]", path.read_text(), count=6))
    code, text = run("torques", "ur5", "--trajectory", path)
    assert code == 1 and "seems to be in radians" in first_lines(text)
    code, text = run("torques", "ur5", "--trajectory", path, "--degrees")
    assert code == 0, text
    assert "UNIT" not in text


def test_a_motion_in_milliseconds_contradicts_itself(ur5):
    t, q = poses(1.0)
    assert tw.Motion(t, q, robot=ur5).contradictions == ()
    slow = tw.Motion(1e3 * t, q, robot=ur5)
    (said,) = slow.contradictions
    assert "time seems to be in ms" in str(said)
    assert motion_of(ur5, slow).warnings[0] == f"LOOK AGAIN: {said}"


def test_a_motion_in_degrees_contradicts_itself(ur5):
    t, q = poses(1.0)
    assert any("another unit" in str(said) for said in tw.Motion(t, np.degrees(q), robot=ur5).contradictions)


# ── delays ──


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.2, 0.3, 0.4])
@pytest.mark.parametrize("w", [1.0, 3.0, 6.0])
def test_a_late_velocity_is_told_as_late_and_by_how_much(run, arm, tmp_path, delay, w):
    """Of one joint only, whose slope is then that of another time, and no other wrong one."""
    t = np.arange(0.0, 6.0, 0.01)

    def at(t):
        return np.stack([np.sin(w * t) + 0.3 * np.sin(0.37 * w * t + 1), 0.5 * np.cos(0.8 * w * t + 0.3)], axis=1)

    def rates(t):
        return w * np.stack(
            [np.cos(w * t) + 0.111 * np.cos(0.37 * w * t + 1), -0.4 * np.sin(0.8 * w * t + 0.3)], axis=1
        )

    dq = np.column_stack([rates(t - delay)[:, 0], rates(t)[:, 1]])
    path = write_motion(tmp_path / "m.csv", arm, t, [at(t), dq], ("", ".vel"))
    code, text = run("torques", "planar_2r", "--trajectory", path)
    assert code == 1
    found = re.match(
        r"LOOK AGAIN: joint1: the velocity column is (\S+) s late against the positions", first_lines(text)
    )
    assert float(found[1]) == pytest.approx(delay, abs=0.005)
    assert "slope" not in first_lines(text)


# ── logs of other robots ──


def header_of(tmp_path, *names):
    path = tmp_path / "m.csv"
    path.write_text(",".join(["time", *names]) + "\n" + ",".join(["0"] * (len(names) + 1)) + "\n")
    return path


def test_a_log_of_another_robot_is_called_that(ur5, tmp_path):
    path = header_of(tmp_path, *(f"panda_joint{k}" for k in range(1, 8)))
    with pytest.raises(TrajectoryError, match="the file seems to be a log of another one") as caught:
        MotionLog.open(path, ur5.model)
    assert "=panda_joint" not in str(caught.value), "no column is proposed for a joint that it has nothing to do with"


@pytest.mark.parametrize("names", [["arm_joint"], [f"iiwa_axle_{k}" for k in range(1, 8)]])
def test_no_column_is_proposed_twice(tmp_path, names):
    with pytest.raises(TrajectoryError) as caught:
        MotionLog.open(header_of(tmp_path, *names), tw.robots.panda().model)
    option = re.search(r"--columns '([^']+)'", caught.value.in_shell())[1]
    proposed = [column for column in re.findall(r"=(\w+)", option) if column != "COLUMN"]
    assert option.count("=") == 7
    assert len(set(proposed)) == len(proposed)


# ── progress ──


@pytest.mark.parametrize("sigma", [0.0, 1e-4])
@pytest.mark.parametrize("smoothing", [False, True])
def test_the_share_done_rises_from_0_to_1(arm, tmp_path, sigma, smoothing):
    log = MotionLog.open(noisy(tmp_path / "m.csv", arm, sigma), arm.model)
    told = []
    plan = Differentiation.plan(log, arm.model, smoothing=smoothing, progress=told.append)
    assert all(0 <= x <= 1 for x in told)
    told = []
    analyse(LoadCase(arm), plan, arm.limits, chunk=200, progress=told.append)
    assert len(told) > (2 if sigma else 1)
    assert (np.diff(told) >= 0).all()
    assert 0 < told[0] < 1
    assert told[-1] == 1.0
