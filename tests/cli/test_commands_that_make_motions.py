"""Commands that make motions: move, simulate, excite, and files that identify writes."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from robot_files import FILES

import twistwrench as tw
from twistwrench.cli.main import main

LINK = (
    '<link name="{}"><inertial><origin xyz=".5 0 0"/><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" '
    'ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{}" type="revolute"><origin xyz="{} 0 0"/><parent link="{}"/><child link="{}"/><axis xyz="0 1 0"/>'
    '<limit lower="-3.1" upper="3.1" velocity="5" effort="{}"/>{}</joint>'
)


def arm(efforts=(30, 10), dynamics=""):
    """Two links of 1 kg and 1 m that turn about y; stretched out, gravity takes 19.6 and 4.9 N m."""
    joints = JOINT.format("shoulder", 0, "base", "l1", efforts[0], dynamics)
    joints += JOINT.format("elbow", 1, "l1", "l2", efforts[1], dynamics)
    tool = '<link name="tool"/><joint name="tf" type="fixed"><origin xyz="1 0 0"/><parent link="l2"/><child link="tool"/></joint>'
    return f'<robot name="arm2"><link name="base"/>{LINK.format("l1")}{LINK.format("l2")}{joints}{tool}</robot>'


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A command run in a folder of its own: exit code and all that it prints, in one line."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        result = CliRunner().invoke(main, list(map(str, arguments)), env={"COLUMNS": "200"})
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return int(result.exit_code), " ".join(result.output.split())

    return run


# ── friction is counted where the file has it ──


def test_move_and_torques_agree_on_a_motion_with_friction(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(dynamics='<dynamics damping="50" friction="5"/>'))
    code, said = run("move", "arm.urdf", "--to", "1,0.8", "--duration", 4, "--csv", "m.csv")
    again, torques = run("torques", "arm.urdf", "--trajectory", "m.csv")
    assert code == again == 1
    assert said.startswith("OVER LIMIT: elbow: torque") and torques.startswith("OVER LIMIT: ")
    assert "with friction" in said
    code, said = run(
        "move", "arm.urdf", "--to", "1,0.8", "--duration", 4, "--csv", "m.csv", "--no-friction", "--overwrite"
    )
    again, torques = run("torques", "arm.urdf", "--trajectory", "m.csv", "--no-friction")
    assert code == again == 0
    assert said.startswith("OK: ") and torques.startswith("OK: ")
    assert "without friction" in said


LAWS = "{viscous: 2 N m s/rad, coulomb: 2 N m, static: 3 N m, stribeck: 0.1 rad/s, load: 0.1}"


@pytest.mark.parametrize("scaling", ["quintic", "cubic", "trapezoid"])
def test_the_shortest_motion_of_a_shape_keeps_limits_with_all_laws_of_friction(run, tmp_path, scaling):
    (tmp_path / "arm.urdf").write_text(arm(efforts=(40, 16)))
    (tmp_path / "a.yaml").write_text(f"actuators:\n  shoulder: {{friction: {LAWS}}}\n  elbow: {{friction: {LAWS}}}\n")
    motion = ("arm.urdf", "--actuators", "a.yaml", "--from=1.2,-0.5", "--to", "0.1,0.6", "--scaling", scaling)
    code, said = run("move", *motion, "--csv", "m.csv")
    assert (code, said.partition(":")[0]) == (0, "OK"), said
    robot = tw.load(tmp_path / "arm.urdf").with_actuators(tmp_path / "a.yaml")
    q, dq, ddq = (getattr(tw.Motion.from_file(tmp_path / "m.csv", robot), x) for x in ("q", "dq", "ddq"))
    share = np.abs(robot.inverse_dynamics(q, dq, ddq, friction=True)) / robot.limits.effort
    assert 0.9 < share.max() <= 1 + 1e-6  # load counts as of both parts of the torque, so it is not used up wholly


def test_a_long_motion_at_its_limits_is_at_them_between_the_samples_looked_at_too(run, tmp_path):
    """32 s on a spline: rows of 2 ms lie between the 2001 instants of 16 ms, 3e-4 over the limit there."""
    (tmp_path / "w.csv").write_text("joint1,joint2\n0.55,-0.3\n")
    (tmp_path / "l.csv").write_text("joint,velocity,effort\njoint1,0.05,200\njoint2,0.3,200\n")
    motion = ("--from=0,0.3", "--to", "0.7,0.4", "--waypoints", "w.csv", "--limits", "l.csv", "--scaling", "trapezoid")
    code, said = run("move", "planar_2r", *motion, "--csv", "m.csv")
    again, torques = run("torques", "planar_2r", "--trajectory", "m.csv", "--limits", "l.csv")
    assert (code, again) == (0, 0), torques
    assert said.startswith("OK: ") and torques.startswith("OK: ")


def test_the_fastest_timing_says_how_to_leave_out_friction_that_it_cannot_count(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm(efforts=(40, 16)))
    (tmp_path / "a.yaml").write_text(f"actuators:\n  shoulder: {{friction: {LAWS}}}\n")
    motion = ("move", "arm.urdf", "--actuators", "a.yaml", "--from=1.2,-0.5", "--to", "0.1,0.6", "--fastest")
    code, said = run(*motion)
    assert code == 2 and "--no-friction" in said
    code, said = run(*motion, "--no-friction")
    assert code == 0 and "without friction" in said


@pytest.mark.parametrize("method", ["dopri5", "semi_implicit", "variational"])
def test_simulate_counts_friction_by_default(run, tmp_path, method):
    """A pendulum with much damping, let go: it does not come back, and without friction it does."""
    (tmp_path / "arm.urdf").write_text(arm(dynamics='<dynamics damping="50"/>'))
    fall = ("simulate", "arm.urdf", "--at", "1,0", "--duration", 1, "--method", method, "--step", 0.002)
    code, said = run(*fall)
    assert code == 0 and "with friction" in said and "work of friction" in said
    code, said = run(*fall, "--no-friction")
    assert code == 0 and "without friction" in said and "work of friction" not in said
    (tmp_path / "bare.urdf").write_text(arm())
    code, said = run("simulate", "bare.urdf", *fall[2:])
    assert code == 0 and "no friction, as its file gives none" in said and "! friction" not in said


# ── small ones ──


def test_simulate_says_that_a_torque_given_is_above_the_effort_limit(run, tmp_path):
    (tmp_path / "arm.urdf").write_text(arm())
    fall = ("simulate", "arm.urdf", "--duration", 0.05)
    code, said = run(*fall, "--torque", "shoulder=1000")
    assert code == 1 and said.startswith("OVER LIMIT: shoulder is given 1000 N m at t = 0.000 s, limit 30")
    assert "is given" not in run(*fall, "--torque", "shoulder=30")[1]


# ── names and numbers of arrays are shown as what they are ──


def test_a_joint_is_named_as_its_file_names_it(run, tmp_path):
    (tmp_path / "free.urdf").write_text(
        arm().replace('type="revolute"', 'type="continuous"').replace(' velocity="5"', "")
    )
    code, said = run("excite", "free.urdf")
    assert code == 2
    assert "how fast joint 'shoulder' of 'arm2' moves" in said
    (tmp_path / "still.urdf").write_text(arm().replace('lower="-3.1" upper="3.1"', 'lower="0.5" upper="0.5"'))
    code, said = run("excite", "still.urdf")
    assert code == 2
    assert "joint 'shoulder' has no room to move" in said


ARM = tw.robots.planar_2r()
NOT = np.float64(-1.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: ARM.forward_kinematics(ARM.neutral, frame=np.str_("hand")),
        lambda: ARM.lock({np.str_("hand"): 0.0}),
        lambda: ARM.inverse_kinematics(np.eye(4), restarts=np.int64(-1)),
        lambda: ARM.inverse_kinematics(np.eye(4), angle=NOT),
        lambda: ARM.random_configuration(0, np.int64(-1)),
        lambda: ARM.random_configuration(NOT),
        lambda: ARM.with_payload(NOT),
        lambda: ARM.simulate(duration=1.0, method="semi_implicit", creep=np.float64(1.0)),
        lambda: ARM.simulate(duration=1.0, limits=np.str_("halt")),
        lambda: ARM.inverse_dynamics([0, 0], [0, 0], [0, 0], wrench_on_robot={np.str_("tool"): np.zeros(5)}),
        lambda: tw.trajectories.move(ARM, [0, 0], [1, 1], tw.trajectories.cubic(1.0)).sample(NOT),
        lambda: tw.identification.exciting_trajectory(ARM, seed=NOT),
        lambda: tw.set_threads(NOT),
    ],
)
def test_errors_show_numbers_and_names_of_numpy_without_their_types(call):
    with pytest.raises(tw.TwistWrenchError) as caught:
        call()
    assert "np." not in str(caught.value)


# ── an exciting motion whose clearance was looked at ──

FOLDING = """<link name="link{k}"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.005"/></inertial>{shape}</link>
<joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/><origin xyz="0 0 {z}"/>
  <axis xyz="{axis}"/><limit lower="-2.9" upper="2.9" velocity="3" effort="60"/></joint>"""
CYLINDER = '<visual><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.03" length="0.3"/></geometry></visual>'
BOX = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
QUICKLY = ("--duration", 4, "--harmonics", 2, "--acceleration", 10, "--restarts", 1, "--friction-model", "none")


def folding(shapes=True):
    """Three links of 0.4 m in one plane, which fold onto the base and onto each other."""
    links = "".join(
        FOLDING.format(
            k=k,
            parent=f"link{k - 1}" if k else "base",
            z=0.4,
            axis="0 1 0" if k else "0 1 0.001",
            shape=CYLINDER * shapes,
        )
        for k in range(3)
    )
    return f'<robot name="folding"><link name="base">{BOX * shapes}</link>{links}</robot>'


def axes_apart(robot, q, a, b):
    """Least distance between the axes of two links, 0.05 to 0.35 m along each."""
    poses, along = robot.link_poses(q), np.linspace(0.05, 0.35, 61)
    lines = [
        T[:, None, :3, 3] + along[:, None] * T[:, None, :3, 2]
        for T in (poses[:, robot.link_names.index(name)] for name in (a, b))
    ]
    return np.linalg.norm(lines[0][:, :, None] - lines[1][:, None, :], axis=-1).min()


def test_excite_is_unsure_where_capsules_are_assumed(run, tmp_path):
    (tmp_path / "bare.urdf").write_text(folding(shapes=False))
    code, said = run("excite", "bare.urdf", *QUICKLY, "--csv", "m.csv")
    assert code == 1
    assert said.startswith(
        "UNSURE: 3 links have no shapes in the robot's file, so clearances are those of assumed capsules"
    )
    assert "80 mm around link0, link1, link2" in said and "mm of capsules around links from each other" in said
    robot = tw.load(tmp_path / "bare.urdf")
    motion = tw.Motion.from_file(tmp_path / "m.csv", robot)
    assert (
        axes_apart(robot, motion.q, "link0", "link2") > 2 * 0.08
    )  # of assumed radii, 20 mm between them less the sampling


def test_excite_is_ok_where_shapes_of_the_file_keep_clear(run, tmp_path):
    (tmp_path / "shaped.urdf").write_text(folding())
    code, said = run("excite", "shaped.urdf", *QUICKLY, "--floor=-0.5", "--csv", "m.csv")
    assert code == 0
    assert said.startswith("OK: least distances: ") and float(said.split()[3]) >= 20.0
    robot = tw.load(tmp_path / "shaped.urdf")
    motion = tw.Motion.from_file(tmp_path / "m.csv", robot)
    assert axes_apart(robot, motion.q, "link0", "link2") > 2 * 0.03 + 0.019
    code, said = run("excite", "shaped.urdf", *QUICKLY, "--ignore-self")
    assert code == 1
    assert said.startswith("UNSURE: not looked at: distances of links from each other")


def test_links_at_a_fixed_height_are_named_where_the_floor_is_too_near(run):
    hold = [x for joint in ("wrist_1_joint=-1", "wrist_2_joint=0.3", "wrist_3_joint=0") for x in ("--lock", joint)]
    code, said = run("excite", "ur5", *hold, *QUICKLY, "--floor", 0.1)
    assert code == 1
    assert (
        "not looked at: the floor is too near shoulder_link, upper_arm_link wherever the joints are, at a fixed height"
        in said
    )
    assert "mm from the floor" in said


def test_the_help_does_not_contradict_its_options(run):
    code, said = run("excite", "--help")
    assert code == 0
    assert "Whether links touch each other is not looked at" not in said
    assert "--ignore-self" in said and "UNSURE" in said


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_no_real_shapes_touch_and_none_is_below_the_floor(run, tmp_path, name):
    """By Pinocchio's collision checks of the meshes of example-robot-data, in 1,001 samples of the bundled robot's motion.

    Pairs are all but those of links that one joint connects; heights are those of links whose frame changes its own.
    """
    pin = pytest.importorskip("pinocchio", exc_type=ImportError)
    file = {"ur5": "ur_description/ur5_robot", "panda": "panda_description/panda"}[name]
    if file not in FILES:
        pytest.skip("example-robot-data is not there")
    asked = ("--duration", 20, "--harmonics", 5, "--share", 0.9, "--acceleration", 10, "--floor", 0.1)
    code, said = run("excite", name, *asked, "--csv", "m.csv")
    assert code == 1 and said.startswith("UNSURE: ")
    assert ("base_link and upper_arm_link are near each other wherever" in said) == (name == "ur5")
    robot = getattr(tw.robots, name)()
    motion, path = tw.Motion.from_file(tmp_path / "m.csv", robot), str(FILES[file])
    t = np.linspace(motion.time[0], motion.time[-1], 1001)
    q = np.stack([np.interp(t, motion.time, x) for x in motion.q.T], axis=1)
    model, shapes, _ = pin.buildModelsFromUrdf(
        path, package_dirs=[path.split("/example-robot-data/robots", maxsplit=1)[0]]
    )
    joints = [min(shape.parentJoint, robot.nv) for shape in shapes.geometryObjects]  # the fingers are held
    shapes.addAllCollisionPairs()
    apart = [(p.first, p.second) for p in shapes.collisionPairs if abs(joints[p.first] - joints[p.second]) > 1]
    shapes.removeAllCollisionPairs()
    for first, second in apart:
        shapes.addCollisionPair(pin.CollisionPair(first, second))
    assert len(shapes.collisionPairs) >= 20
    data, seen = model.createData(), shapes.createData()
    heights, origins = np.full((len(t), len(joints)), np.inf), np.zeros((len(t), len(joints)))
    touching = 0
    for i, row in enumerate(q):
        pin.forwardKinematics(model, data, np.concatenate([row, np.zeros(model.nq - robot.nq)]))
        pin.updateGeometryPlacements(model, data, shapes, seen)
        touching += pin.computeCollisions(shapes, seen, True)
        for k, shape in enumerate(shapes.geometryObjects):
            origins[i, k] = data.oMi[joints[k]].translation[2]
            if hasattr(shape.geometry, "vertices"):
                M = seen.oMg[k]
                heights[i, k] = (np.asarray(shape.geometry.vertices()) @ M.rotation[2]).min() + M.translation[2]
    moving = np.ptp(origins, axis=0) > 1e-9
    assert moving.sum() >= 4
    assert touching == 0
    assert heights[:, moving].min() > 0.1


def test_a_position_beyond_its_limit_is_said_with_its_amount(run, tmp_path):
    """Half a milliradian at a stop: over its limit, and the first line says by how little."""
    (tmp_path / "arm.urdf").write_text(arm(efforts=(100, 100)))
    t = np.linspace(0, 4, 401)
    s = (t / 4) ** 3 * (10 - 15 * t / 4 + 6 * (t / 4) ** 2)
    table = np.column_stack([t, 2.0 + 1.1005 * s, 0.3 + 0.5 * s])
    np.savetxt(tmp_path / "m.csv", table, delimiter=",", header="time,shoulder,elbow", comments="", fmt="%.9g")
    code, said = run("torques", "arm.urdf", "--trajectory", "m.csv")
    assert code == 1
    assert said.startswith(
        "OVER LIMIT: shoulder exceeds its position limit at t = 4.000 s by 0.0005 rad: 3.1005, limit 3.1"
    )


def test_identify_writes_the_robot_that_explains_a_log_already(run, tmp_path):
    """The first word and the exit code agree: OK, 0, and the file is there."""
    (tmp_path / "arm.urdf").write_text(arm(efforts=(100, 100)))
    robot, rng = tw.load(tmp_path / "arm.urdf"), np.random.default_rng(0)
    t, w = np.arange(0, 5, 0.01), 2 * np.pi / 5 * np.arange(1, 5)
    k = w[:, None] * t
    a, b = rng.normal(size=(2, 2, 4)) * 0.3
    q = a @ np.sin(k) + b @ np.cos(k)
    dq = (a * w) @ np.cos(k) - (b * w) @ np.sin(k)
    ddq = -(a * w**2) @ np.sin(k) - (b * w**2) @ np.cos(k)
    tau = robot.inverse_dynamics(q.T, dq.T, ddq.T) + rng.normal(size=(len(t), 2)) * 0.001
    table = np.column_stack([t, q.T, tau])
    head = "time,shoulder,elbow,shoulder.torque,elbow.torque"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=head, comments="", fmt="%.9g")
    code, said = run("identify", "arm.urdf", "log.csv", "--out", "new.urdf")
    assert (code, said[:3]) == (0, "OK:"), said[-600:]
    assert (tmp_path / "new.urdf").exists() and "error" not in said


def test_simulate_with_friction_of_a_joint_without_inertia_is_one_error(run):
    text = arm(dynamics='<dynamics friction="1"/>').replace('value="1"', 'value="0"').replace('".01"', '"0"')
    code, said = run("simulate", _written("hollow.urdf", text), "--duration", 0.05)
    assert code == 2 and "has no inverse" in said


def _written(name, text):
    """Path of a file in the present folder with that text."""
    with open(name, "w") as file:
        file.write(text)
    return name


def simulated(folder, *words):
    """Result of the command, from its archive."""
    path = folder / "run.npz"
    done = CliRunner().invoke(main, ["simulate", *words, "--npz", str(path), "--overwrite"])
    assert done.exit_code in (0, 1), done.output
    return tw.SimulationResult.load(path)


def test_degrees_are_those_of_angles_and_their_rates_and_of_no_torque(tmp_path):
    words = ["planar_2r", "--duration", "0.01", "--degrees", "--at", "joint2=180", "--velocity", "joint1=90"]
    found = simulated(tmp_path, *words, "--torque", "joint2=9")
    np.testing.assert_allclose(found.q[0], [0.0, np.pi], rtol=1e-15)
    np.testing.assert_allclose(found.dq[0], [np.pi / 2, 0.0], rtol=1e-15)
    np.testing.assert_array_equal(found.tau[0], [0.0, 9.0])


def test_a_pose_that_looks_like_degrees_is_remarked(tmp_path):
    """Ninety radians are fourteen turns."""
    wild, usual = (
        simulated(tmp_path, "ur5", "--duration", "0.01", "--at", f"elbow_joint={angle}").remarks for angle in (90, 0.9)
    )
    assert any("degrees" in remark for remark in wild)
    assert not any("degrees" in remark for remark in usual)


def test_every_point_that_touches_the_ground_holds_the_box_up(tmp_path):
    """On two points at its ends it stays level; on one of them alone it would turn."""
    touch = [f"--touch=box:{x},0,0" for x in (0.1, -0.1)]
    level = simulated(tmp_path, "floating_box", "--duration", "0.1", "--ground", "0", *touch)
    assert level.work["contacts"][-1] != 0.0
    np.testing.assert_allclose(level.dq[-1, :3], 0.0, atol=1e-9)
