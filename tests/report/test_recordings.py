"""Recordings for other viewers: what our own reader of MCAP, and rerun's of .rrd, find in them."""

import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.reports.recordings.description import MovingJoints, robot_description
from twistwrench.reports.recordings.mcap import write_mcap
from twistwrench.reports.recordings.recording import Recording

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

EPOCH = 1_700_000_000_123_456_789
DEMO = tw.robots.path_of("ur5").with_name("ur5_demo.csv")
UR5 = tw.robots.ur5()
LINK = '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
MIMIC = f"""<robot name="gripper">{LINK.format("a")}{LINK.format("b")}{LINK.format("c")}
  <joint name="left" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" velocity="1" effort="20"/></joint>
  <joint name="right" type="prismatic"><parent link="a"/><child link="c"/><origin xyz="0.1 0 0" rpy="0 0 1"/>
    <axis xyz="0 1 0"/><limit lower="0" upper="0.04" velocity="1" effort="20"/>
    <mimic joint="left" multiplier="-0.5" offset="0.01"/></joint></robot>"""
BALL = """<mujoco model="hand"><worldbody><body name="base" pos="0 0 1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <joint name="elbow" type="hinge" axis="0 1 0"/><body name="b" pos="0.1 0 0.2">
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint name="wrist" type="ball"/>
  </body></body></worldbody></mujoco>"""


def motion_of(robot, *, epoch=0, rows=41):
    t = np.cumsum(np.random.default_rng(3).integers(900_000, 1_100_000, rows)) * 1e-9
    rng = np.random.default_rng(4)
    dq = rng.normal(size=robot.nv) * np.cos(3 * t)[:, None]
    q = np.array([robot.add(robot.neutral, x) for x in rng.normal(size=robot.nv) * np.sin(3 * t)[:, None]])
    return tw.Motion(t, q, dq, -9 * dq, tau=rng.normal(size=dq.shape), robot=robot, in_seconds=True, epoch=epoch)


def messages(path, topic):
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    with path.open("rb") as file:
        found = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        return [(record.log_time, message) for _, _, record, message in found.iter_decoded_messages(topics=[topic])]


# ── MCAP


@pytest.mark.parametrize("epoch", [0, EPOCH])
def test_a_motion_comes_back_from_mcap(tmp_path, epoch):
    pytest.importorskip("mcap_ros2")
    motion = motion_of(UR5, epoch=epoch)
    again = tw.Motion.from_file(motion.to_mcap(tmp_path / "m.mcap"), UR5)
    for part in ("q", "dq", "tau"):
        assert np.abs(getattr(again, part) - getattr(motion, part)).max() <= 1e-9
    stamps = [m.epoch + np.rint(m.time * 1e9).astype(np.int64) for m in (motion, again)]
    assert np.abs(stamps[1] - stamps[0]).max() <= 1
    third = tw.Motion.from_file(again.to_mcap(tmp_path / "n.mcap"), UR5)  # a recording of a recording
    assert third.epoch == again.epoch
    assert np.array_equal(third.time, again.time)


def test_the_date_of_a_table_is_kept(tmp_path):
    pytest.importorskip("mcap_ros2")
    motion = motion_of(UR5)
    columns = motion.columns()
    columns["time"] = 1_700_000_000.25 + columns["time"]
    rows = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "m.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    read = tw.Motion.from_file(tmp_path / "m.csv", UR5)
    (first, _), *_ = messages(read.to_mcap(tmp_path / "m.mcap"), "/joint_states")
    assert abs(first - 1e9 * rows[0, 0]) < 500  # ns: half of the last digit that a float of seconds since 1970 has


def test_the_report_has_torques_causes_limits_and_the_verdict(tmp_path, capsys):
    pytest.importorskip("mcap_ros2")
    out = tmp_path / "out.mcap"
    with pytest.raises(SystemExit) as ended:
        main(["torques", "ur5", "--trajectory", str(DEMO), "--payload", "10", "--mcap", str(out)])
    assert ended.value.code == 1
    printed = capsys.readouterr().out
    assert f"wrote {out}" in printed
    log, computed = (tw.Motion.from_file(out, UR5, topic=t) for t in (None, "/twistwrench/torque"))
    source = tw.Motion.from_file(DEMO, UR5)
    assert np.abs(log.q - source.q).max() <= 1e-9
    loaded = UR5.with_payload(tw.SpatialInertia.from_com(10.0))
    expected = loaded.inverse_dynamics(source.q, source.dq, source.ddq, friction=True)
    assert np.abs(computed.tau - expected).max() <= 1e-9 * np.abs(expected).max()
    causes = ["inertia", "coriolis", "gravity", "payload", "friction"]
    parts = [np.array([m.effort for _, m in messages(out, f"/twistwrench/torque/{name}")]) for name in causes]
    assert np.abs(sum(parts) - expected).max() <= 1e-9 * np.abs(expected).max()
    assert messages(out, "/twistwrench/torque/spring") == []
    share = np.array([m.effort for _, m in messages(out, "/twistwrench/share")])
    assert np.allclose(share, np.abs(expected) / UR5.limits.effort, atol=1e-12)
    limits = [m for _, m in messages(out, "/twistwrench/limits")]
    assert [list(m.effort) for m in limits] == [UR5.limits.effort.tolist()] * 2
    ((_, said),) = messages(out, "/rosout")
    assert (said.level, said.name) == (40, "twistwrench")
    assert " ".join(said.msg.split()) in " ".join(printed.split())
    assert said.msg.startswith("OVER LIMIT: ")


@pytest.mark.parametrize("name", ["ur5", "quadruped", "panda"])
def test_the_description_is_the_robot_as_it_moves(name, tmp_path):
    pytest.importorskip("mcap_ros2")
    robot = getattr(tw.robots, name)()
    last = robot.model.leaders[-1].joint.name
    robot = robot.lock({last: 0.25})
    motion = motion_of(robot, rows=7)
    ((_, text),) = messages(motion.to_mcap(tmp_path / "m.mcap"), "/robot_description")
    again = tw.load(text.data)
    assert again.coordinate_names == robot.coordinate_names
    assert set(robot.link_names) <= set(again.link_names)
    M, N = (np.asarray(r.mass_matrix(motion.q)) for r in (robot, again))
    assert np.abs(M - N).max() <= 1e-9 * np.abs(M).max()


@pytest.mark.parametrize("name", ["floating", "ball"])
def test_joints_of_several_coordinates_move_in_tf(name, tmp_path):
    pytest.importorskip("mcap_ros2")
    robot = tw.robots.quadruped() if name == "floating" else tw.load(BALL)
    link, parent, child = ("trunk", "world", "trunk") if name == "floating" else ("b", "base", "b:wrist.x")
    motion = motion_of(robot, rows=7)
    poses, names = np.asarray(robot.link_poses(motion.q)), list(robot.link_names)
    below = np.eye(4) if name == "floating" else poses[:, names.index(parent)]
    poses = np.linalg.inv(below) @ poses[:, names.index(link)]
    sent = [m.transforms for _, m in messages(motion.to_mcap(tmp_path / "m.mcap"), "/tf")]
    assert [len(each) for each in sent] == [1] * 7
    for pose, (one,) in zip(poses, sent, strict=True):
        at, turn = one.transform.translation, one.transform.rotation
        assert (one.header.frame_id, one.child_frame_id) == (parent, child)
        assert np.allclose([at.x, at.y, at.z], pose[:3, 3], atol=1e-12)
        assert np.allclose(Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix(), pose[:3, :3], atol=1e-12)
    (_, states), *_ = messages(tmp_path / "m.mcap", "/joint_states")
    assert list(states.name) == [n for n in robot.coordinate_names if "." not in n]


def test_a_mimic_joint_of_a_recording_stands_at_ratio_times_its_leader_and_offset():
    robot = tw.load(MIMIC)
    description = robot_description(robot.model, local=False)
    found = MovingJoints(robot, description).coordinates(np.array([[0.0], [0.02], [0.04]]))
    np.testing.assert_allclose(found["left"], [0.0, 0.02, 0.04], atol=1e-15)
    np.testing.assert_allclose(found["right"], [0.01, 0.0, -0.01], atol=1e-15)


def test_meshes_of_the_robots_file_are_in_the_description(tmp_path):
    (tmp_path / "box.stl").write_bytes(b"")
    path = tmp_path / "arm.urdf"
    mesh = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    text = tw.robots.path_of("pendulum").read_text()
    first = text.index("</link>")
    added = "".join(map(mesh.format, ("box.stl", "package://none/there.stl", "missing.stl")))
    path.write_text(f"{text[:first]}{added}{text[first:]}")
    model = tw.load(path).model
    names = [
        [e.attributes["filename"] for e in robot_description(model, local=local).walk() if e.tag == "mesh"]
        for local in (False, True)
    ]
    box = (tmp_path / "box.stl").resolve()
    assert names == [[box.as_uri(), "package://none/there.stl", "missing.stl"], [str(box)]]


def test_nothing_is_left_half_written(tmp_path):
    pytest.importorskip("mcap_ros2")
    motion = motion_of(UR5)
    path = tmp_path / "m.mcap"
    path.write_text("before")

    def portions():
        yield next(Recording.from_motion(motion).portions)
        raise ValueError("the disk is gone")

    with pytest.raises(ValueError, match="gone"):
        write_mcap(path, Recording(UR5, 0, (0.0, 1.0), portions()))
    with pytest.raises(tw.ValueRangeError, match="from 0 to"):
        tw.Motion(motion.time - 1.0, motion.q, motion.dq, motion.ddq, robot=UR5, in_seconds=True).to_mcap(path)
    assert [p.name for p in tmp_path.iterdir()] == ["m.mcap"]
    assert path.read_text() == "before"


@pytest.mark.parametrize(
    ("option", "module", "extra"), [("--mcap", "mcap_ros2.writer", "logs"), ("--rerun", "rerun", "rerun")]
)
def test_a_missing_extra_is_named_before_the_motion_is_read(option, module, extra, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(SystemExit) as ended:
        main(["torques", "ur5", "--trajectory", str(DEMO), option, str(tmp_path / "out")])
    assert ended.value.code == 2
    assert f"'.[{extra}]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


# ── rerun


def chunks(path):
    reader = pytest.importorskip("rerun.chunk").RrdReader(str(path))
    return list(reader.stream())


def rows_of(found, entity):
    return sum(chunk.num_rows for chunk in found if chunk.entity_path == entity)


def test_rerun_counts_every_row_and_curve(tmp_path):
    pytest.importorskip("rerun.chunk")
    out = tmp_path / "out.rrd"
    main(["torques", "ur5", "--trajectory", str(DEMO), "--rerun", str(out)], standalone_mode=False)
    found, rows = chunks(out), 751
    assert rows_of(found, "/transforms") == UR5.nv * rows
    for entity in ("torque/{}", "torque/gravity/{}", "share/{}", "joint_states/position/{}"):
        assert {rows_of(found, f"/{entity.format(name)}") for name in UR5.joint_names} == {rows + 1}, entity
    assert {rows_of(found, f"/limits/effort/{name}") for name in UR5.joint_names} == {2 + 1}
    labels = [c.to_record_batch().to_pydict() for c in found if c.is_static and c.entity_path == "/torque/elbow_joint"]
    assert labels[0]["SeriesLines:names"] == [["torque elbow_joint [N m]"]]
    assert rows_of(found, "/verdict") == 1


ROBOTS = {"arm": tw.robots.panda, "mimic": lambda: tw.load(MIMIC), "floating": tw.robots.quadruped}


@pytest.mark.parametrize("name", ROBOTS)
def test_rerun_shows_joints_beyond_their_limits_where_they_are(name, tmp_path):
    pytest.importorskip("rerun.chunk")
    robot = ROBOTS[name]()
    motion = motion_of(robot, epoch=EPOCH, rows=7)
    assert name == "floating" or any(v.kind == "position" for v in motion.violations())
    found = chunks(motion.to_rerun(tmp_path / "m.rrd"))
    poses, names = np.asarray(robot.link_poses(motion.q)), list(robot.link_names)
    moved = [c.to_record_batch() for c in found if c.entity_path == "/transforms"]
    assert len(moved) == len(robot.model.bodies)
    assert {str(batch.schema.field("time").type) for batch in moved} == {"timestamp[ns]"}
    for batch in moved:
        columns = batch.to_pydict()
        parent, child = (columns[f"Transform3D:{end}_frame"][0][0] for end in ("parent", "child"))
        below = np.eye(4) if parent == "world" else poses[:, names.index(parent)]
        T = np.linalg.inv(below) @ poses[:, names.index(child)]
        place, turn = (np.array(columns[f"Transform3D:{part}"])[:, 0] for part in ("translation", "quaternion"))
        assert np.allclose(place, T[:, :3, 3], atol=1e-6)  # single precision
        assert np.allclose(Rotation.from_quat(turn).as_matrix(), T[:, :3, :3], atol=1e-6)
