"""Motion: one class for states over time, wherever they come from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import twistwrench as tw
from twistwrench import trajectories, viz
from twistwrench.motion.bounds import LimitCheck, bounds_of
from twistwrench.testing import random_robot

T = np.linspace(0.0, 1.0, 201)


def ur5_motion(size=1.0):
    robot = tw.robots.ur5()
    q = size * np.sin(T)[:, None] * np.linspace(0.2, 0.7, 6) + np.array([0, -1, 1, 0, 0, 0])
    return tw.Motion(T, q, robot=robot), robot


def test_rates_are_derived_by_a_spline():
    motion, _ = ur5_motion()
    shape = np.linspace(0.2, 0.7, 6)
    assert np.abs(motion.dq - np.cos(T)[:, None] * shape).max() < 1e-6  # of order 3 in steps of 5 ms, times 0.7
    assert np.abs(motion.ddq + np.sin(T)[:, None] * shape)[5:-5].max() < 1e-4


@pytest.mark.parametrize("kinds", [("revolute",), ("continuous",), ("planar",), ("ball",), ("floating",)])
def test_a_state_between_two_is_on_the_way(kinds):
    robot = random_robot(4, 3, kinds)
    q0, v = robot.random_configuration(1), np.random.default_rng(2).normal(size=robot.nv)
    way = robot.add(q0, np.linspace(0, 1, 11)[:, None] * v)
    still = np.zeros((11, robot.nv))
    motion = tw.Motion(np.linspace(0, 1, 11), way, still + v, still, robot=robot)
    t = np.array([0.0, 0.123, 0.5, 0.999, 1.0])
    q, dq, ddq = motion.at(t)
    assert np.abs(robot.subtract(q, robot.add(q0, t[:, None] * v))).max() < 1e-13
    assert np.abs(dq - v).max() < 1e-15
    assert not ddq.any()
    before, after = motion.at(-1.0), motion.at(2.0)
    assert np.array_equal(before[0], way[0])
    assert not before[1].any()
    assert np.abs(robot.subtract(after[0], way[-1])).max() < 1e-13


def test_terms_add_up_to_the_torques():
    motion, robot = ur5_motion()
    for friction in (False, True):
        terms = motion.terms(friction=friction)
        assert np.abs(sum(terms.values()) - motion.torques(friction=friction)).max() < 1e-11
        assert np.allclose(
            motion.torques(friction=friction),
            robot.inverse_dynamics(motion.q, motion.dq, motion.ddq, friction=friction),
        )


def test_every_result_over_time_is_one_or_has_one():
    robot = tw.robots.planar_2r()
    simulated = robot.simulate([0.5, 0.2], [0, 0], duration=0.2)
    rolled = robot.rollout([[0.5, 0.2], [0.1, 0.0]], [0, 0], tau=[1.0, 0.5], steps=200, torques=True)
    moving = trajectories.move(robot, [0, 0], [1, 1], trajectories.cubic(1.0)).sample(0.01)
    for motion, n in ((simulated.motion, len(simulated)), (rolled.motion(1), 201), (moving, 101)):
        assert isinstance(motion, tw.Motion)
        assert len(motion) == n
        assert motion.torques().shape == (n, 2)
    assert np.allclose(rolled.motion(1).tau, [1.0, 0.5])
    assert np.abs(simulated.motion.torques() - simulated.tau).max() < 1e-9  # what was applied is what the motion takes


def test_results_compose():
    robot = tw.robots.ur5()
    result = robot.simulate(duration=0.3, dt=1e-3)
    found = trajectories.violations(robot, result)
    assert found == result.motion.violations()
    assert viz.motion_of(robot, result).rows == len(result)
    law = tw.control.PD(robot, result, 100.0, 10.0)
    assert np.isfinite(law(0.1, result.q[0], result.dq[0])).all()
    heavy = robot.with_payload(tw.SpatialInertia.from_com(5.0))
    assert np.abs(result.motion.with_robot(heavy).torques()).max() > np.abs(result.motion.torques()).max()


def test_limits_are_checked_with_one_tolerance():
    """A joint past its limit by half the tolerance is at it, for every kind of limit; by twice the tolerance it is past."""
    robot = tw.robots.panda()
    limits = robot.limits
    zero = np.zeros((5, 7))
    t = np.linspace(0, 1, 5)
    middle = 0.5 * (limits.lower + limits.upper)
    for share, passed in ((0.5e-6, False), (2e-6, True)):
        q = np.tile(middle, (5, 1))
        largest = np.maximum(np.abs(limits.lower), np.abs(limits.upper))
        q[2, 0] = limits.upper[0] + share * largest[0]
        v = zero.copy()
        v[3, 1] = -limits.velocity[1] * (1 + share)
        found = {(x.kind, x.joint): x for x in tw.Motion(t, q, v, zero, robot=robot).violations()}
        assert (("position", "panda_joint1") in found) == passed
        assert (("velocity", "panda_joint2") in found) == passed
        assert bool(limits.exceeded(robot.model.positions(q)).any()) == passed
        if passed:
            assert found["velocity", "panda_joint2"].limit < 0
            assert found["velocity", "panda_joint2"].time == t[3]


def test_the_limit_that_is_named_is_the_one_to_speed_up_or_the_one_to_brake():
    """Limits of 2 and 5 rad/s²: 3 rad/s² on the way up are beyond the first, and 6 on the way down beyond the second."""
    robot = tw.robots.pendulum()
    bounds = replace(robot.limits, acceleration=np.array([2.0]), deceleration=np.array([5.0]))
    t = np.linspace(0.0, 1.0, 11)[:, None]
    for speed, rate, limit in ((3.0 * t, 3.0, 2.0), (6.0 * (1.0 - t), -6.0, 5.0)):
        motion = tw.Motion(t[:, 0], 0.0 * t, speed, np.full_like(t, rate), robot=robot)
        (found,) = [each for each in motion.violations(bounds, tau=0.0 * t) if each.kind == "acceleration"]
        assert abs(found.value) == abs(rate) and abs(found.limit) == limit


def columns(path):
    header, *rows = path.read_text().splitlines()
    return dict(zip(header.split(","), np.array([row.split(",") for row in rows], float).T, strict=True))


def test_files_and_tables_give_the_numbers_back(tmp_path):
    pytest.importorskip("pandas")
    motion, robot = ur5_motion()
    motion = tw.Motion(motion.time, motion.q, motion.dq, motion.ddq, motion.torques(), robot)
    table = motion.to_pandas()
    assert np.array_equal(table[list(robot.coordinate_names)], motion.q)
    read = columns(motion.to_csv(tmp_path / "motion.csv"))
    assert np.array_equal(read["elbow_joint.torque"], motion.tau[:, 2])
    degrees = columns(motion.to_csv(tmp_path / "degrees.csv", degrees=True))
    assert np.allclose(np.radians(degrees["elbow_joint [deg]"]), motion.q[:, 2], atol=1e-14)
    assert np.allclose(np.radians(degrees["elbow_joint.vel [deg/s]"]), motion.dq[:, 2], atol=1e-14)
    for said in (False, True):  # the unit in the header counts, whatever is said of the file
        again = tw.Motion.from_file(tmp_path / "degrees.csv", robot, degrees=said)
        for name in ("q", "dq", "ddq", "tau"):
            np.testing.assert_allclose(getattr(again, name), getattr(motion, name), rtol=1e-14, atol=1e-14)


def test_named_axes_give_the_numbers_back_to_every_method():
    pytest.importorskip("xarray")
    motion, robot = ur5_motion()
    motion = tw.Motion(motion.time, motion.q, motion.dq, motion.ddq, motion.torques(), robot)
    data = motion.to_xarray()
    assert data.tau.attrs["units"] == "N m"
    assert data.ddq.sel(joint="elbow_joint").values.tolist() == motion.ddq[:, 2].tolist()
    turned = data.isel(coordinate=slice(None, None, -1), joint=slice(None, None, -1))  # read by name, not by place
    np.testing.assert_array_equal(robot.inverse_dynamics(turned.q, turned.dq, turned.ddq), motion.tau)


def test_named_axes_of_a_rollout():
    pytest.importorskip("xarray")
    robot = tw.robots.quadruped()
    start = robot.random_configuration(0, 3)
    one = robot.rollout(start, np.zeros(robot.nv), steps=5, torques=True).to_xarray()
    assert dict(one.sizes) == {"sample": 3, "time": 6, "coordinate": robot.nq, "joint": robot.nv}
    assert one.tau.isel(time=-1).isnull().all() and not one.tau.isel(time=slice(-1)).isnull().any()
    assert one.q.attrs["units"] == ", ".join(["1"] * 4 + ["m"] * 3 + ["rad"] * (robot.nq - 7))
    several = robot.rollout(start.reshape(3, 1, -1), np.zeros(robot.nv), steps=2).to_xarray()
    assert several.q.dims == ("sample_0", "sample_1", "time", "coordinate")
    np.testing.assert_array_equal(several.q.isel(sample_1=0, time=0), start)


def test_a_file_gives_the_motion_back(tmp_path):
    motion, robot = ur5_motion()
    motion = tw.Motion(motion.time, motion.q, motion.dq, motion.ddq, motion.torques(), robot)
    read = tw.Motion.from_file(motion.to_csv(tmp_path / "motion.csv"), robot)
    for name in ("time", "q", "dq", "ddq", "tau"):
        assert np.array_equal(getattr(read, name), getattr(motion, name)), name
    assert read.notes == ()
    late = tw.Motion(motion.time, motion.q, 2 * motion.dq, motion.ddq, robot=robot)
    doubted = tw.Motion.from_file(late.to_csv(tmp_path / "late.csv"), robot)
    assert any(note.startswith("LOOK AGAIN") for note in doubted.notes)
    (tmp_path / "raw.csv").write_text("a;b\n0;0\n1,5;2\n3;4\n4,5;6\n6;8\n7,5;10\n", "utf-8")
    arm = tw.robots.planar_2r()
    raw = tw.Motion.from_file(
        tmp_path / "raw.csv", arm, columns={"joint1": "a", "joint2": "b"}, rate=10.0, degrees=True
    )
    assert np.allclose(np.degrees(raw.q[1]), [1.5, 2.0])
    assert np.allclose(raw.time, 0.1 * np.arange(6))
    with pytest.raises(tw.NotFoundError):
        tw.Motion.from_file(tmp_path / "none.csv", arm)


def same(a, b, names=("time", "q", "dq", "ddq", "tau")):
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)


def test_a_data_frame_gives_the_motion_back():
    pd = pytest.importorskip("pandas")
    motion, robot = ur5_motion()
    motion = tw.Motion(motion.time, motion.q, motion.dq, motion.ddq, motion.torques(), robot)
    table = motion.to_pandas()
    for frame in (table, table.reset_index(), table[table.columns[::-1]], table.assign(mode="auto")):
        again = tw.Motion.from_dataframe(frame, robot)
        assert same(again, motion) and any("mode" in note for note in again.notes) == ("mode" in frame)
    dated = table.set_index(pd.to_datetime("2026-01-01") + pd.to_timedelta(motion.time.round(3), unit="s"))
    assert np.allclose(tw.Motion.from_dataframe(dated, robot).time, motion.time, atol=1e-6)
    bare = table[list(robot.coordinate_names)].reset_index(drop=True)
    counted = tw.Motion.from_dataframe(np.degrees(bare), robot, rate=100.0, degrees=True)
    assert np.allclose(counted.q, motion.q, atol=1e-14) and counted.time[1] == 0.01
    for junk in (None, np.zeros((3, 6)), "motion.csv", pd.DataFrame):
        with pytest.raises(tw.ShapeError, match="give a pandas DataFrame"):
            tw.Motion.from_dataframe(junk, robot)
    with pytest.raises(tw.TwistWrenchError, match="the DataFrame"):
        tw.Motion.from_dataframe(bare.drop(columns="elbow_joint"), robot, rate=100.0)
    with pytest.raises(tw.TwistWrenchError, match="finite"):
        tw.Motion.from_dataframe(table.where(table > 0), robot)


def test_dates_and_spans_are_seconds_wherever_they_stand():
    """In a column or in the index, with a time zone or without: they came out as nanoseconds."""
    pd = pytest.importorskip("pandas")
    motion, robot = ur5_motion()
    table = motion.to_pandas()[list(robot.coordinate_names)]
    spans = pd.Series(pd.to_timedelta(motion.time.round(6), unit="s"))
    dates = pd.Timestamp("2026-01-01") + spans
    for stamps in (spans, dates, dates.dt.tz_localize("Europe/Berlin"), dates.astype("datetime64[us]")):
        for frame in (table.assign(time=stamps.to_list()), table.set_index(pd.Index(stamps, name="stamp"))):
            again = tw.Motion.from_dataframe(frame, robot)
            np.testing.assert_allclose(again.time, motion.time - motion.time[0], atol=2e-6)
            assert again.contradictions == ()
    gap = table.assign(time=dates.where(dates.index != 3).to_list())
    with pytest.raises(tw.TwistWrenchError, match="time"):
        tw.Motion.from_dataframe(gap, robot)


def test_a_column_that_is_there_twice_is_refused():
    """Also by a name that another column has with its unit; the last one used to win."""
    pd = pytest.importorskip("pandas")
    motion, robot = ur5_motion()
    table = motion.to_pandas()
    for more in (0.0 * table[["elbow_joint"]], (0.0 * table[["elbow_joint"]]).add_suffix(" [deg]")):
        with pytest.raises(tw.TrajectoryError, match="'elbow_joint' is there 2 times"):
            tw.Motion.from_dataframe(pd.concat([table, more], axis=1), robot)


def test_a_motion_is_cut_by_rows_and_by_time():
    motion, robot = ur5_motion()
    motion = tw.Motion(motion.time, motion.q, motion.dq, motion.ddq, motion.torques(), robot)
    part = motion[10:20]
    assert same(part, tw.Motion(*(getattr(motion, n)[10:20] for n in ("time", "q", "dq", "ddq", "tau")), robot))
    assert same(motion.between(motion.time[10], motion.time[19]), part)
    assert same(motion[::4][2:4], motion[8:16:4]) and len(motion[-3:]) == 3
    for wrong in (
        lambda: motion[5],
        lambda: motion["a"],
        lambda: motion[50:10],
        lambda: motion[::-1],
        lambda: motion[:0.5],
    ):
        with pytest.raises(tw.ValueRangeError, match="Motion"):
            wrong()
    with pytest.raises(tw.ValueRangeError, match="no state lies between"):
        motion.between(motion.time[-1] + 1, motion.time[-1] + 2)


def test_a_motion_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    motion, _ = ur5_motion()
    assert motion.plot(tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(tw.ValueRangeError, match="path is None"):
        motion.plot(None)


def test_before_and_after_a_motion_it_rests_at_its_ends():
    motion, _ = ur5_motion()
    for t, end in ((motion.time[0] - 1.0, 0), (motion.time[-1] + 1.0, -1)):
        q, dq, ddq = motion.at(t)
        assert np.array_equal(q, motion.q[end]) and not dq.any() and not ddq.any()


def test_times_in_milliseconds_are_doubted():
    motion, robot = ur5_motion()
    ms = 1e3 * motion.time
    for given in ({"dq": motion.dq}, {"dq": motion.dq, "ddq": motion.ddq}, {}):
        with pytest.warns(tw.ModelWarning, match="time seems to be in ms"):
            doubted = tw.Motion(ms, motion.q, robot=robot, **given)
        assert doubted.notes[0].startswith("LOOK AGAIN") and "in ms" in repr(doubted)
        assert "in ms" in repr(doubted[5:])
        assert tw.Motion(motion.time, motion.q, robot=robot, **given).notes == ()


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        (lambda r: tw.Motion(T, np.zeros((200, 6)), robot=r), tw.ShapeError, "time has shape"),
        (lambda r: tw.Motion(T[::-1], np.zeros((201, 6)), robot=r), tw.ValueRangeError, "does not increase"),
        (lambda r: tw.Motion(T[:3], np.zeros((3, 6)), robot=r), tw.ValueRangeError, "too few"),
        (lambda r: tw.Motion(T, np.full((201, 6), np.nan), robot=r), tw.ValueRangeError, "Motion: q"),
        (lambda r: tw.Motion(T, np.zeros((201, 6)), np.zeros((201, 5)), robot=r), tw.ShapeError, "dq"),
        (lambda _: tw.Motion(T, np.zeros((201, 6))), tw.ShapeError, "robot="),
        (lambda _: tw.Motion(T, np.zeros((201, 6)), robot="ur5.urdf"), tw.ValueRangeError, "give a tw.Robot"),
        (lambda r: tw.Motion.from_file(r, "move.csv"), tw.ValueRangeError, "give a tw.Robot"),
        (
            lambda r: tw.Motion(T, np.zeros((201, 6)), np.full((201, 6), np.nan), robot=r),
            tw.ValueRangeError,
            "Motion: dq",
        ),
        (
            lambda _: tw.Motion(T, np.zeros((201, 7)), robot=tw.robots.floating_box()),
            tw.ValueRangeError,
            "quaternion of zeros",
        ),
        (lambda _: ur5_motion()[0].at(np.nan), tw.ValueRangeError, "Motion.at"),
        (lambda r: r.rollout([0] * 6, [0] * 6, steps=2).motion("a"), tw.ValueRangeError, "one index"),
        (lambda r: ur5_motion()[0].with_robot(tw.robots.panda()), tw.ValueRangeError, "coordinates differ"),
    ],
)
def test_what_is_no_motion_is_refused(given, error, words):
    with pytest.raises(error, match=words):
        given(tw.robots.ur5())


@pytest.mark.parametrize("name", ["Zeit", "time", "t [s]", None])
def test_an_index_of_increasing_floats_is_the_time_whatever_its_name(name):
    pandas = pytest.importorskip("pandas")
    t = np.linspace(0, 1, 50)
    frame = pandas.DataFrame({"joint1": t**2, "joint2": -t}, index=pandas.Index(t, name=name))
    np.testing.assert_array_equal(tw.Motion.from_dataframe(frame, tw.robots.planar_2r()).time, t)


def test_a_column_of_time_is_believed_before_an_index_of_another_name():
    pandas = pytest.importorskip("pandas")
    t = np.linspace(0, 1, 50)
    frame = pandas.DataFrame({"joint1": t**2, "joint2": -t, "time": 2 * t}, index=pandas.Index(t, name="run"))
    np.testing.assert_array_equal(tw.Motion.from_dataframe(frame, tw.robots.planar_2r()).time, 2 * t)


@pytest.mark.parametrize(
    "names, says",
    [
        (["time", "jiont1", "joint2"], "Say which they are: columns={'joint1': 'jiont1'} (columns that vary"),
        (["time", "joint2"], "when the robot is loaded: lock={'joint1': 0}"),
        (["joint1", "joint2"], "columns={'time': 'COLUMN'}, or the rows per second, rate=HZ"),
    ],
)
def test_errors_on_a_data_frame_advise_in_python(names, says):
    pd = pytest.importorskip("pandas")
    frame = pd.DataFrame({name: np.arange(10) / 10 for name in names})
    with pytest.raises(tw.TrajectoryError) as caught:
        tw.Motion.from_dataframe(frame, tw.robots.planar_2r())
    assert says in str(caught.value)
    assert "--" not in str(caught.value)


def test_a_limit_that_is_passed_twice_alike_is_told_by_the_first_time():
    robot = tw.robots.panda()
    t, zero = np.linspace(0, 1, 5), np.zeros((5, 7))
    v = zero.copy()
    v[[1, 3], 1] = 2 * robot.limits.velocity[1]
    q = zero + 0.5 * (robot.limits.lower + robot.limits.upper)
    check = LimitCheck(robot.model, bounds_of(robot))
    for rows in (slice(0, 3), slice(3, 5)):  # a long log comes in portions
        check.add(t[rows], q[rows], v[rows], zero[rows], zero[rows])
    assert {x.kind: x.time for x in check.violations()}["velocity"] == t[1]
