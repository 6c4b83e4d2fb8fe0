"""What no robot does: rows that are missing, repeated or wrong are doubts about a log, and never a certain excess."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from quick import mostly_slow

import twistwrench as tw
from twistwrench import Motion, trajectories
from twistwrench.cli.main import main

pytest_plugins = ("torque_fixtures", "numpy_fixtures")
pytestmark = pytest.mark.usefixtures("on_numpy")

T = np.arange(0, 8, 0.01)
Q = 0.8 * np.sin(T[:, None] * np.arange(1, 7) / 3)
HELD = 0.9 * np.sin(T[:, None] * 2 + np.arange(6))


def cut():
    kept = (T < 3) | (T >= 3.3)
    return T[: kept.sum()], Q[kept]


def zeros():
    return T, np.where(np.arange(len(T))[:, None] >= len(T) - 3, 0.0, Q)


def stuck():
    return T, np.concatenate([Q[:300], Q[300:301].repeat(3, axis=0), Q[303:]])


def hold():
    return T, HELD[np.arange(len(T)) // 10 * 10]


def frozen():
    """The recording repeats its last row to the end."""
    return T, np.concatenate([Q[:400], Q[400:401].repeat(len(T) - 400, axis=0)])


def last_row():
    """The last row alone is wrong: its speed is its neighbours' median only if the ends are repeated."""
    q = Q.copy()
    q[-1] += 0.03
    return T, q


def first_row():
    """The first row is that of another pose, as of a message before the first."""
    q = Q.copy()
    q[0] = 0.03
    return T, q


FAULTS = {f.__name__: f for f in (cut, zeros, stuck, hold, frozen, first_row, last_row)}


@pytest.fixture
def said(run, tmp_path, ur5):
    """First line of ``torques`` on a motion of the UR5, whose largest share of a limit is 40 %."""

    def said(t, q, *options, tau=None):
        names = ["time", *ur5.joint_names] + ([f"{n}.tau" for n in ur5.joint_names] if tau is not None else [])
        table = np.column_stack([t, q] if tau is None else [t, q, tau])
        np.savetxt(tmp_path / "m.csv", table, "%.9g", ",", header=",".join(names), comments="")
        code, text = run("torques", "ur5", "--trajectory", tmp_path / "m.csv", *options)
        assert (code == 0) == text.startswith("OK"), text
        return " ".join(text.split("\n\n")[0].split())

    return said


@pytest.mark.parametrize("fault", FAULTS)
def test_rows_that_no_robot_makes_are_not_a_certain_excess(said, fault):
    """Each was OVER LIMIT, by up to 131,834 %; a robot with measured torques was not planned, so that the log is wrong."""
    t, q = FAULTS[fault]()
    verdict = said(t, q)
    assert verdict.startswith("UNSURE") and "as a plan OVER LIMIT" in verdict
    assert said(t, q, "--plan").startswith("OVER LIMIT")


@pytest.mark.parametrize("fault", ["cut", "zeros", "hold"])
def test_a_log_with_measured_torques_that_no_robot_makes_is_looked_at_again(said, ur5, fault):
    t, q = FAULTS[fault]()
    tau = np.asarray(ur5.gravity_forces(q))
    assert said(t, q, tau=tau).startswith("LOOK AGAIN") or "no robot moves so" in said(t, q, tau=tau)


def test_a_clean_log_with_too_much_to_carry_is_over_its_limit(said, ur5):
    tau = Motion(T, Q, robot=ur5).torques()
    for mass in (20, 100, 1000):
        assert said(T, Q, "--payload", mass, tau=tau).startswith("OVER LIMIT: ")
    assert said(T, Q, tau=tau).startswith("OK")


def test_an_excess_among_sound_rows_is_certain(said):
    """Rows are stuck at 3 s; with 60 kg the limits are passed elsewhere too."""
    t, q = stuck()
    assert said(t, q, "--payload", "60").startswith("OVER LIMIT: ")


def test_what_a_planner_asks_for_is_not_a_log(ur5):
    moving = trajectories.move(ur5, np.zeros(6), np.full(6, 0.8), trajectories.cubic(0.05)).sample(0.001)
    assert moving.plan and moving.contradictions == ()
    assert {v.kind for v in moving.violations()} >= {"velocity", "torque"}
    fast = Motion(moving.time, moving.q, robot=ur5, tau=moving.torques())
    assert [found.kind for found in fast.contradictions] == ["impossible-speed"]


def test_a_log_may_begin_and_end_in_motion(ur5):
    """Speeding up, braking, at top speed and while turning round, with few rows and many."""
    for rows in (25, 60, 400):
        for phase in np.linspace(0.0, np.pi, 9):
            u = np.linspace(0.0, 1.0, rows)
            curves = np.sin(3.0 * u + phase), u**3 + phase * u, (1.0 - u) ** 3, np.minimum(u, 0.5) ** 2 + phase * u
            for curve in curves:
                motion = Motion(4.0 * u, 0.5 * curve[:, None] * np.ones(6), robot=ur5)
                assert not [i for i in motion.instants if i.cause == "rows"]


def test_starts_stops_and_impacts_are_not_missing_rows(ur5):
    swing = np.sin(2 * np.pi * T / 4)
    for curve in (np.where(swing > 0.6, 1.2 - swing, swing), np.clip(T - 3, 0, 1), np.abs(swing)):
        motion = Motion(T, 0.5 * curve[:, None] * np.ones(6), robot=ur5)
        assert not [i for i in motion.instants if i.cause == "rows"] and motion.doubts == ()


@pytest.mark.parametrize("row", [0, -1])
def test_a_wrong_row_of_a_joint_at_rest_is_not_a_certain_excess(tmp_path, row):
    """The one step of the joint is the wrong one, and not that of its encoder; a tick of an encoder is no doubt."""
    arm, t = tw.robots.ur5(), np.arange(0.0, 8.0, 0.01)
    for step, word in ((0.2, "UNSURE"), (2 * np.pi / 4096, "OK")):
        q = 0.8 * np.sin(t[:, None] * np.arange(1, 7) / 3)
        q[:, 5] = 0.3
        q[row, 5] += step
        log = tmp_path / "log.csv"
        header = "time," + ",".join(arm.joint_names)
        np.savetxt(log, np.column_stack([t, q]), delimiter=",", header=header, comments="", fmt="%.9g")
        done = CliRunner().invoke(main, ["torques", "ur5", "--trajectory", str(log)])
        assert done.stdout.startswith(f"{word}:"), done.stdout[:200]


def test_joints_that_hit_something_some_rows_apart_are_impacts(ur5):
    """Two bounces four rows apart were one long event, and so none."""
    t = np.arange(0, 4, 0.001)
    bounces = [0.5 * np.abs(np.sin(1.5 * (t - when))) for when in (2.0, 2.004)]
    q = np.column_stack([*bounces, *(0.3 * np.sin(t + k) for k in range(4))])
    found = [(instant.cause, instant.joint, round(instant.begin, 2)) for instant in Motion(t, q, robot=ur5).instants]
    assert found == [("impact", 0, 2.0), ("impact", 1, 2.0)]


def test_a_wrong_stamp_within_a_short_move_is_not_a_wrong_row(ur5):
    """Joints stand but for 0.6 s, so that usual departures are those of rest; stamps are off by up to 30 % of a step."""
    random = np.random.default_rng(3)
    u = np.clip((T - 4) / 0.6 + 0.5, 0, 1)
    q = 0.8 * (10 * u**3 - 15 * u**4 + 6 * u**5)[:, None] * np.ones(6)
    for _ in range(5):
        stamps = T + 0.006 * random.uniform(-0.5, 0.5, len(T))
        assert not [i for i in Motion(stamps, q, robot=ur5).instants if i.cause == "rows"]
    kept = np.r_[0:400, 406 : len(T)]
    assert [i for i in Motion(T[: len(kept)], q[kept], robot=ur5).instants if i.cause == "rows"]


# ── Measured torques are compared where the computed ones are those of the motors


def swing_to_a_stop(step=0.01):
    """Times and angles of a free pendulum of 1 m, which hits a stop at 0.5 rad and keeps 60 % of its speed."""
    parts, q, dq, found = round(1e4 * step), -0.9, 0.0, []
    count = round(4.0 / step)
    for _ in range(count):
        found.append(q)
        for _ in range(parts):
            dq -= 9.81 * np.sin(q) * step / parts
            q += dq * step / parts
            dq = -0.6 * dq if q > 0.5 and dq > 0 else dq
    return step * np.arange(count), np.array(found)


def pendulum_with_limits(folder):
    """File of the bundled pendulum, turning between stops with a limit of 20 N m."""
    text = tw.robots.path_of("pendulum").read_text()
    limited = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="10" effort="20"/>'
    text = text.replace('"continuous"', '"revolute"').replace('<axis xyz="0 1 0"/>', limited)
    for moment in ("ixx", "iyy", "izz"):
        text = text.replace(f'{moment}="0"', f'{moment}="1e-9"')
    (folder / "pendulum.urdf").write_text(text)
    return folder / "pendulum.urdf"


@pytest.mark.parametrize(("step", "counts"), [(0.002, 8192), (0.004, 16384), (0.01, 65536)])
def test_an_impact_that_an_encoder_divides_between_two_rows_is_an_impact(run, tmp_path, step, counts):
    """The joint turns back within a row, of which the rows before and after have a part each: a clean log of a stop."""
    t, q = swing_to_a_stop(step)
    grid = 2 * np.pi / counts
    tau = 0.02 * np.random.default_rng(0).standard_normal(len(t))
    table = np.column_stack([t, np.round(q / grid) * grid, tau])
    np.savetxt(tmp_path / "m.csv", table, "%.9g", ",", header="time,hinge,hinge.tau", comments="")
    _, said = run("torques", pendulum_with_limits(tmp_path), "--trajectory", tmp_path / "m.csv")
    assert said.startswith("UNSURE: speeds change"), said[:300]


@pytest.mark.parametrize(
    ("gain", "word"), [(1.0, "UNSURE: speeds change"), (-1.0, "LOOK AGAIN: the file's own torque")]
)
def test_measured_torques_are_compared_in_rows_that_are_not_an_impact(run, tmp_path, gain, word):
    """A stop takes the pendulum's momentum, and not its motor, which gives 0.02 N m, or the torque of a spring."""
    t, q = swing_to_a_stop()
    tau = 0.02 * np.random.default_rng(0).standard_normal(len(t))
    if gain < 0:  # a driven swing, whose torque column has the opposite sign
        q = 0.5 - 0.8 * np.abs(np.sin(4.0 * t))
        tau -= 9.81 * np.sin(q) - 16.0 * (q - 0.5)  # M = 1 kg m², and d²q/dt² = -16 (q - 0.5) between the stops
    np.savetxt(
        tmp_path / "m.csv", np.column_stack([t, q, tau]), "%.9g", ",", header="time,hinge,hinge.tau", comments=""
    )
    _, said = run("torques", pendulum_with_limits(tmp_path), "--trajectory", tmp_path / "m.csv")
    assert said.startswith(word), said[:300]


@pytest.mark.parametrize(("head", "word"), [("t", "UNSURE"), ("time [s]", "OK"), ("seconds", "OK")])
def test_a_column_of_time_that_may_count_rows_is_not_ok_and_its_remedy_is_answered(run, tmp_path, ur5, head, word):
    """800 rows at 100 Hz numbered by row are those of a log of 800 s at 1 Hz, whose torques are those of a robot at rest."""
    path, stamps = tmp_path / "m.csv", tmp_path / "stamps.csv"
    for file, name, t in ((path, head, np.arange(800)), (stamps, "time", np.arange(800) / 100)):
        header = ",".join([name, *ur5.joint_names])
        np.savetxt(file, np.column_stack([t, Q]), "%.9g", ",", header=header, comments="")
    _, said = run("torques", "ur5", "--trajectory", path)
    assert said.startswith(word)
    assert (
        ("as row numbers do" in " ".join(said.split()))
        == ("Row numbers: --rate" in " ".join(said.split()))
        == (word == "UNSURE")
    )
    if word == "UNSURE":
        (first, of_rows), (_, of_stamps) = (
            (said.split("\n")[0], said)
            for _, said in (
                run("torques", "ur5", "--trajectory", path, "--rate", "100"),
                run("torques", "ur5", "--trajectory", stamps),
            )
        )
        assert first.startswith("OK")
        assert first == of_stamps.split("\n")[0], of_rows


@pytest.mark.parametrize(
    ("head", "unit", "step"),
    [
        ("time_ms", 1e-3, 1),
        ("time [ms]", 1e-3, 1),
        ("time [ms]", 1e-3, 10),
        ("time_us", 1e-6, 10_000),
        ("t [ns]", 1e-9, 1_000_000),
    ],
)
def test_clean_logs_of_whole_units_of_time_are_not_taken_for_row_numbers(run, tmp_path, ur5, head, unit, step):
    count = np.arange(800) * step
    q = 0.8 * np.sin(count[:, None] * unit * np.arange(1, 7) / 3)
    header = ",".join([head, *ur5.joint_names])
    np.savetxt(tmp_path / "m.csv", np.column_stack([count, q]), "%.12g", ",", header=header, comments="")
    code, said = run("torques", "ur5", "--trajectory", tmp_path / "m.csv")
    assert code == 0 and said.startswith("OK"), said[:300]


@pytest.mark.parametrize("kind", ["fast", "with velocities", "plan"])
def test_clean_motions_of_whole_seconds_are_not_taken_for_row_numbers(run, tmp_path, ur5, kind):
    """At ten rows a second the joints would be too fast; the logged velocities are in seconds; a plan has points of its own."""
    t = np.arange(60.0)
    w, size = (0.5, 2.0) if kind == "fast" else (0.5, 0.5)
    q, dq = size * np.sin(w * t)[:, None] * np.ones(6), size * w * np.cos(w * t)[:, None] * np.ones(6)
    names = ur5.joint_names
    heads = ["t", *names, *(f"{name}.vel" for name in names if kind == "with velocities")]
    columns = [t, q, dq] if kind == "with velocities" else [t, q]
    np.savetxt(tmp_path / "m.csv", np.column_stack(columns), "%.9g", ",", header=",".join(heads), comments="")
    _, said = run("torques", "ur5", "--trajectory", tmp_path / "m.csv", *(["--plan"] if kind == "plan" else []))
    assert "row numbers" not in said, said[:400]


@pytest.mark.parametrize("noise", mostly_slow([0.0, 1e-7, 3e-6, 1e-6, 1e-5], 2))
def test_a_brief_stop_on_the_way_is_no_wrong_row(noise, tmp_path):
    """The bundled motion passes its poses at rest within four rows: whatever its noise, it keeps its word."""
    robot = tw.robots.ur5()
    motion = tw.Motion.from_file(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), robot)
    q = motion.q + noise * np.random.default_rng(0).standard_normal(motion.q.shape)
    path = tmp_path / "log.csv"
    header = ",".join(["time", *robot.coordinate_names])
    np.savetxt(path, np.column_stack([motion.time, q]), "%.12f", ",", header=header, comments="")
    assert tw.Motion.from_file(path, robot).instants == ()
    assert tw.check(robot, path).verdict.word == "OK"
