"""Plans and controllers' states that ROS recorded: each door gives the motion that ros2_controllers would execute."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from ros_logs import (
    HEADER,
    JOINT_STATE,
    PLAN,
    POINT,
    ROBOT_PLAN,
    SHOWN_PLAN,
    controller_state,
    defined,
    header,
    plan,
    point,
    typestore,
    write_database,
    write_folder,
    write_messages,
    write_ros1,
)
from scipy.interpolate import BPoly, CubicHermiteSpline

import twistwrench as tw
from twistwrench.cli.main import main

ARM = tw.robots.planar_2r()
NAMES = ARM.joint_names
TIME = np.linspace(0.0, 2.0, 21)
Q = np.stack([np.sin(2 * TIME), 1 - np.cos(3 * TIME)], axis=1)
DQ = np.stack([2 * np.cos(2 * TIME), 3 * np.sin(3 * TIME)], axis=1)
DDQ = np.stack([-4 * np.sin(2 * TIME), 9 * np.cos(3 * TIME)], axis=1)
TRAJECTORY, ROBOT, SHOWN = (
    "trajectory_msgs/msg/JointTrajectory",
    "moveit_msgs/msg/RobotTrajectory",
    "moveit_msgs/msg/DisplayTrajectory",
)
CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
WHOLE = plan(NAMES, TIME, Q, DQ, DDQ)


def halves():
    """The plan in two parts, the second of which begins where the first ended."""
    first, second = slice(0, 11), slice(10, 21)
    return [
        {"joint_trajectory": plan(NAMES, TIME[part] - TIME[part][0], Q[part], DQ[part], DDQ[part])}
        for part in (first, second)
    ]


def written_mcap(kind, definition, message):
    return lambda path: write_messages(path, {"/plan": (kind, definition, [(1.0, message)])})


def without_definitions(path):
    write_database(path, {"/plan": (TRAJECTORY, [(1.0, WHOLE)])}, typestore(), definitions=False)


def robot_trajectory_without_definitions(path):
    text = "trajectory_msgs/JointTrajectory joint_trajectory\ntrajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory"
    store = defined(typestore(), ROBOT, text)
    empty = {"header": header(), "joint_names": [], "points": []}
    message = {"joint_trajectory": WHOLE, "multi_dof_joint_trajectory": empty}
    write_database(path, {"/plan": (ROBOT, [(1.0, message)])}, store, definitions=False)


DOORS = {
    "trajectory.mcap": written_mcap(TRAJECTORY, f"{PLAN}{POINT}{HEADER}", WHOLE),
    "robot.mcap": written_mcap(ROBOT, ROBOT_PLAN, {"joint_trajectory": WHOLE}),
    "shown.mcap": written_mcap(SHOWN, SHOWN_PLAN, {"model_id": "arm", "trajectory": halves()}),
    "folder": lambda path: write_folder(path, {"/plan": (TRAJECTORY, [(1.0, WHOLE)])}, typestore()),
    "defined.db3": lambda path: write_database(path, {"/plan": (TRAJECTORY, [(1.0, WHOLE)])}, typestore()),
    "undefined.db3": without_definitions,
    "robot.db3": robot_trajectory_without_definitions,
    "ros1.bag": lambda path: write_ros1(path, TRAJECTORY, [(1.0, WHOLE)]),
}


def torques_at_the_points(motion):
    rows = [int(np.abs(motion.time - t).argmin()) for t in TIME]
    assert np.abs(motion.time[rows] - TIME).max() < 1e-9
    return motion.torques()[rows]


@pytest.mark.parametrize("name", DOORS)
def test_a_plan_gives_the_same_torques_by_every_door(name, tmp_path):
    DOORS[name](tmp_path / name)
    motion = tw.Motion.from_file(tmp_path / name, ARM)
    expected = ARM.inverse_dynamics(Q, DQ, DDQ)
    assert np.abs(torques_at_the_points(motion) - expected).max() < 1e-9 * np.abs(expected).max()
    assert "Plan of 21 points: between them each joint follows a quintic, evaluated every 2 ms" in " ".join(
        motion.notes
    )
    assert np.diff(motion.time).max() < 2e-3 + 1e-9


@pytest.mark.parametrize("name", DOORS)
def test_one_command_reads_each_door(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    DOORS[name](tmp_path / name)
    result = CliRunner().invoke(main, ["torques", "planar_2r", "--trajectory", name])
    assert result.exit_code == 1 and "UNSURE: no torque limit for 2 of 2 joints" in result.output, result.output
    assert "noise" not in result.output.replace("noise-", "")


@pytest.mark.parametrize("sandbox", ["0", "1"])
def test_a_plan_stays_a_plan_whether_it_is_decoded_here_or_in_a_child(sandbox, tmp_path, monkeypatch):
    """Excesses of a plan are certain; the states beside it are a recording."""
    monkeypatch.setenv("TWISTWRENCH_SANDBOX", sandbox)
    two_topics(tmp_path / "two.mcap")
    assert tw.Motion.from_file(tmp_path / "two.mcap", ARM, topic="/plan").plan
    assert not tw.Motion.from_file(tmp_path / "two.mcap", ARM, topic="/joint_states").plan


def test_between_points_is_the_quintic_or_cubic_of_their_rates(tmp_path):
    """One step of a motion whose polynomial is known: q = 3 s² − 2 s³, and 10 s³ − 15 s⁴ + 6 s⁵ with accelerations."""
    ends = np.array([[0.0, 0.0], [1.0, 2.0]])
    still = np.zeros((2, 2))
    s = np.linspace(0, 1, 501)
    for rates, shape in (((still,), 3 * s**2 - 2 * s**3), ((still, still), 10 * s**3 - 15 * s**4 + 6 * s**5)):
        message = plan(NAMES, [0.0, 1.0], ends, *rates)
        write_messages(tmp_path / "p.mcap", {"/plan": (TRAJECTORY, f"{PLAN}{POINT}{HEADER}", [(1.0, message)])})
        motion = tw.Motion.from_file(tmp_path / "p.mcap", ARM)
        assert np.abs(motion.q - shape[:, None] * ends[1]).max() < 1e-12
        assert np.abs(motion.dq - np.gradient(motion.q, motion.time, axis=0)).max() < 0.02
        assert motion.contradictions == ()


def test_rates_of_positions_alone_are_derived_and_said(tmp_path):
    message = plan(NAMES, TIME, Q)
    write_messages(tmp_path / "p.mcap", {"/plan": (TRAJECTORY, f"{PLAN}{POINT}{HEADER}", [(1.0, message)])})
    motion = tw.Motion.from_file(tmp_path / "p.mcap", ARM)
    assert "a quintic spline, as its points have no velocities" in " ".join(motion.notes)
    inner = (motion.time > 0.5) & (motion.time < 1.5)
    assert np.abs(motion.dq[inner, 0] - 2 * np.cos(2 * motion.time[inner])).max() < 1e-3


def states(form, *, error=0.01):
    """A controller's states: measured a little late, with efforts; the reference is the plan."""
    measured = Q - error * DQ
    found = []
    for k, t in enumerate(TIME):
        points = {
            "reference": point(0.0, Q[k], DQ[k], DDQ[k]),
            "feedback": point(0.0, measured[k], DQ[k], [], [1.0, 2.0]),
        }
        points = points | {"desired": points["reference"], "actual": points["feedback"]}
        points |= {name: point(0.0) for name in ("error", "output")}
        chosen = {name: points[name] for name in CONTROLLER_POINTS[form]}
        found.append((t, {"header": header(t), "joint_names": list(NAMES)} | chosen))
    return found


CONTROLLER_POINTS = {"new": ("reference", "feedback", "error", "output"), "old": ("desired", "actual", "error")}


@pytest.mark.parametrize("form", CONTROLLER_POINTS)
@pytest.mark.parametrize("name", ["states.mcap", "states.db3", "undefined.db3"])
def test_controller_states_are_measured_and_their_reference_is_chosen(form, name, tmp_path):
    kind, text = CONTROLLER, controller_state(form)
    if name.endswith(".mcap"):
        write_messages(tmp_path / name, {"/arm/state": (kind, f"{text}{POINT}{HEADER}", states(form))})
    else:
        store = defined(typestore(), kind, text)
        write_database(
            tmp_path / name, {"/arm/state": (kind, states(form))}, store, definitions="undefined" not in name
        )
    measured = tw.Motion.from_file(tmp_path / name, ARM)
    assert np.abs(measured.q - (Q - 0.01 * DQ)).max() < 1e-12 and (measured.tau == [1.0, 2.0]).all()
    planned = tw.Motion.from_file(tmp_path / name, ARM, topic="/arm/state:reference")
    assert np.abs(planned.q - Q).max() < 1e-12 and np.abs(planned.ddq - DDQ).max() < 1e-12 and planned.tau is None


def two_topics(path):
    state = [
        (t, {"header": header(t), "name": list(NAMES), "position": q.tolist(), "velocity": [], "effort": []})
        for t, q in zip(TIME, Q + 1, strict=True)
    ]
    write_messages(
        path,
        {
            "/plan": (TRAJECTORY, f"{PLAN}{POINT}{HEADER}", [(0.0, WHOLE)]),
            "/joint_states": ("sensor_msgs/msg/JointState", JOINT_STATE, state),
            "/said": ("std_msgs/msg/String", "string data", [(0.0, {"data": "x"})]),
        },
    )


def test_the_topic_with_most_messages_is_read_and_another_by_its_name(tmp_path, monkeypatch):
    two_topics(tmp_path / "two.mcap")
    motion = tw.Motion.from_file(tmp_path / "two.mcap", ARM)
    assert np.abs(motion.q - Q - 1).max() < 1e-12
    assert "Read from topic /joint_states, which has most messages; topic=… chooses another: /plan." in motion.notes
    planned = tw.Motion.from_file(tmp_path / "two.mcap", ARM, topic="/plan")
    assert len(planned) > 900 and not any("most messages" in note for note in planned.notes)
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["torques", "planar_2r", "--trajectory", "two.mcap", "--topic", "/plan"])
    assert result.exit_code == 1 and "Plan of 21 points" in " ".join(result.output.split()), result.output


def test_accelerations_at_some_points_bend_the_segments_between_them_alone(tmp_path):
    """As ros2_controllers: a quintic where both ends have accelerations, a cubic where one has none."""
    message = plan(NAMES, TIME, Q, DQ, DDQ)
    for k in (0, 1, 2, 7, 15):
        message["points"][k] = message["points"][k] | {"accelerations": []}
    write_messages(tmp_path / "p.mcap", {"/plan": (TRAJECTORY, f"{PLAN}{POINT}{HEADER}", [(1.0, message)])})
    motion = tw.Motion.from_file(tmp_path / "p.mcap", ARM)
    assert any("a quintic where both have accelerations, else a cubic" in note for note in motion.notes)
    cubic, quintic = CubicHermiteSpline(TIME, Q, DQ), BPoly.from_derivatives(TIME, np.stack([Q, DQ, DDQ], axis=1))
    for k in range(len(TIME) - 1):
        inside = (motion.time > TIME[k] + 1e-9) & (motion.time < TIME[k + 1] - 1e-9)
        curve = cubic if {k, k + 1} & {0, 1, 2, 7, 15} else quintic
        for x, order in ((motion.q, 0), (motion.dq, 1), (motion.ddq, 2)):
            assert np.abs(x[inside] - curve.derivative(order)(motion.time[inside])).max() < 1e-8, (k, order)


def bad_plan(path, message):
    write_messages(path, {"/plan": (TRAJECTORY, f"{PLAN}{POINT}{HEADER}", [(1.0, message)])})


def with_point(k, **changed):
    points = [dict(p) for p in WHOLE["points"]]
    points[k] |= changed
    return WHOLE | {"points": points}


BAD = {
    "a point without all joints": (
        with_point(3, positions=[1.0]),
        "a point has not one position for each of the 2 joints",
    ),
    "time runs back": (with_point(5, time_from_start={"sec": 0, "nanosec": 0}), "point 6 at 0 s does not come after"),
    "not a number": (with_point(2, velocities=[np.nan, 0.0]), "velocities of point 3 are [nan, 0.0]"),
    "one point": (WHOLE | {"points": WHOLE["points"][:1]}, "a plan of 1 points"),
    "no points": (WHOLE | {"points": []}, "a plan of 0 points"),
    "few positions": (plan(NAMES, TIME[:4], Q[:4]), "4 points without velocities are too few"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_plans_are_one_error(case, tmp_path):
    message, said = BAD[case]
    bad_plan(tmp_path / "plan.mcap", message)
    with pytest.raises(tw.TrajectoryError) as caught:
        tw.Motion.from_file(tmp_path / "plan.mcap", ARM)
    assert said in str(caught.value) and "plan.mcap, topic /plan" in str(caught.value)


def test_bad_topics_and_files_are_one_error(tmp_path):
    two_topics(tmp_path / "two.mcap")
    for topic in ("/none", "/said", "/plan:reference", "/joint_states:measured"):
        with pytest.raises(tw.TrajectoryError, match=r"two.mcap.*topic="):
            tw.Motion.from_file(tmp_path / "two.mcap", ARM, topic=topic)
    write_messages(tmp_path / "said.mcap", {"/said": ("std_msgs/msg/String", "string data", [(0.0, {"data": "x"})])})
    with pytest.raises(
        tw.TrajectoryError, match=r"said.mcap: has no messages of the types JointState, .*Topics: /said"
    ):
        tw.Motion.from_file(tmp_path / "said.mcap", ARM)
    (tmp_path / "log.csv").write_text("time,joint1,joint2\n0,0,0\n")
    with pytest.raises(tw.TrajectoryError, match="topic=… is for recordings of ROS"):
        tw.Motion.from_file(tmp_path / "log.csv", ARM, topic="/plan")
    DOORS["defined.db3"](tmp_path / "plan.db3")
    whole = (tmp_path / "plan.db3").read_bytes()
    for bad in (whole[:5000], b"SQLite format 3\0" + bytes(200), b"", b"no database"):
        (tmp_path / "bad.db3").write_bytes(bad)
        with pytest.raises(tw.TrajectoryError, match=r"bad.db3"):
            tw.Motion.from_file(tmp_path / "bad.db3", ARM)
    with pytest.raises(tw.NotFoundError, match="no recording"):
        tw.Motion.from_file(tmp_path / "none.db3", ARM)
