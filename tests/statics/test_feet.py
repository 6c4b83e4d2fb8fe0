"""Feet of legged robots, corners of soles, and the base of a robot that stands on its feet."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from robot_files import FILES, NONE

import twistwrench as tw
from twistwrench import statics
from twistwrench.mechanics.lie import quaternion, so3
from twistwrench.mechanics.model.joining import with_free_base
from twistwrench.statics.stance import stance_rates

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

FEET = {
    "talos_data/talos_reduced": ("left_sole_link", "right_sole_link"),
    "g1_description/g1_29dof_rev_1_0": ("left_ankle_roll_link", "right_ankle_roll_link"),
    "go2_description/go2": ("FL_foot", "FR_foot", "RL_foot", "RR_foot"),
    "anymal_c_simple_description/anymal": ("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"),
    "romeo_description/romeo": ("l_sole", "r_sole"),
    "beside/unitree_h1_2": ("left_ankle_roll_link", "right_ankle_roll_link"),
    "beside/atlas_drc_sdformat": ("l_foot", "r_foot"),
}
KNOWN = [name for name in FEET if name in FILES] or NONE


def opened(name, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(FILES[name], inertia="accept", **options)


def biped_text():
    """Two legs of hip, knee and ankle about y, with soles of 0.2 m x 0.1 m."""
    links = ['<link name="trunk"><inertial><mass value="10"/><inertia ixx="0.2" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.1"/>'
             "</inertial></link>"]  # fmt: skip
    for side, y in (("left", 0.1), ("right", -0.1)):
        parent, z = "trunk", 0.0
        for part, length in (("thigh", 0.4), ("shank", 0.4), ("foot", 0.05)):
            name = f"{side}_{part}"
            shape = '<collision><origin xyz="0.02 0 -0.04"/><geometry><box size="0.2 0.1 0.02"/></geometry></collision>'
            links.append(
                f'<link name="{name}"><inertial><origin xyz="0 0 {-length / 2}"/><mass value="1"/><inertia ixx="0.01" ixy="0" '
                f'ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>{shape if part == "foot" else ""}</link>'
                f'<joint name="{side}_{part}_joint" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin '
                f'xyz="0 {y if parent == "trunk" else 0} {-z}"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="200" '
                'velocity="20"/></joint>'
            )
            parent, z = name, length
    return f'<robot name="biped">{"".join(links)}</robot>'


@pytest.fixture(scope="module")
def biped(tmp_path_factory):
    """File of the biped: shapes are read from files."""
    path = tmp_path_factory.mktemp("biped") / "biped.urdf"
    path.write_text(biped_text())
    return path


def steps(robot, rows=401):
    """Times and joints of a robot that squats, then lifts one foot after the other."""
    t = np.linspace(0, 4, rows)
    q = np.zeros((rows, 6))

    def bump(begin, end):
        return np.where((t > begin) & (t < end), np.sin(np.pi * (t - begin) / (end - begin)) ** 4, 0.0)

    for k, bend in ((0, 0.4 + 0.2 * bump(0, 2) + 0.3 * bump(2, 3)), (3, 0.4 + 0.2 * bump(0, 2) + 0.3 * bump(3, 4))):
        q[:, k : k + 3] = bend[:, None] * [-1, 2, -1]
    return tw.Motion(t, q, robot=robot, in_seconds=True)


@pytest.mark.parametrize("name", KNOWN)
def test_each_leg_stands_on_its_lowest_frame_or_the_one_that_is_named_as_a_foot(name):
    held, free = opened(name), opened(name, floating_base=True)
    assert statics.find_feet(held) == statics.find_feet(free) == FEET[name]


@pytest.mark.parametrize(
    "name", [n for n in FILES if n.split("/")[0] in ("baxter_description", "ur_description")] or NONE
)
def test_robots_without_legs_have_no_feet(name):
    try:
        robot = opened(name)
    except tw.ModelError:
        pytest.skip("not read; with which reason is another test's business")
    assert statics.find_feet(robot) == ()


def test_a_sole_is_the_lowest_face_of_the_shape_a_rectangle_or_a_point(biped):
    robot = tw.load(biped)
    corners = np.array([c.point for c in statics.sole(robot, "left_foot", 0.6)])
    assert_allclose(
        corners[np.lexsort(corners.round(6).T[::-1])],
        [(x, y, -0.05) for x in (-0.08, 0.12) for y in (-0.05, 0.05)],
        atol=1e-12,
    )
    rectangle = np.array([c.point for c in statics.sole(robot, "left_foot", 0.6, (0.2, 0.1), (0.01, 0, -0.05))])
    assert_allclose(rectangle.mean(axis=0), [0.01, 0, -0.05])
    assert_allclose(np.ptp(rectangle, axis=0), [0.2, 0.1, 0.0])
    assert len(statics.sole(robot, "left_shank", 0.6)) == 1
    with pytest.raises(tw.ValueRangeError, match="fixed to the base"):
        statics.sole(robot, "trunk", 0.6)


@pytest.mark.parametrize("name", KNOWN[:2])
def test_a_base_that_is_freed_later_is_the_base_that_the_reader_frees(name):
    """Same coordinates, and same inverse dynamics to the last bit."""
    if name is None:
        pytest.skip("no files")
    read = opened(name, floating_base=True)
    freed = tw.Robot(with_free_base(opened(name).model))
    q, rates = read.random_configuration(1), np.random.default_rng(2).standard_normal((2, read.nv))
    assert freed.coordinate_names == read.coordinate_names
    assert_allclose(freed.inverse_dynamics(q, *rates), read.inverse_dynamics(q, *rates), rtol=0, atol=0)


def test_the_stance_foot_of_a_biped_does_not_move_and_the_rates_of_its_base_are_those_of_its_poses(biped):
    """Positions to 1e-9 m; rates against differences of fourth order, whose error at 10 ms is below 1e-4 of the largest."""
    held, free = tw.load(biped), tw.load(biped, floating_base=True)
    joints = steps(held)
    stance = np.where(joints.time < 2.0, "left_foot", np.where(joints.time < 3.0, "right_foot", "left_foot")).tolist()
    for choice, drift, steps_down in ((stance, 1e-9, 1e-9), ("auto", 6e-4, 1.2e-3)):  # 0.5 mm and a row each step
        motion = statics.base_from_stance(free, joints, ("left_foot", "right_foot"), choice)
        assert np.array_equal(motion.q[:, 7:], joints.q)
        assert_allclose(motion.q[0, 4:6], 0.0, atol=1e-12)
        for foot, begin, end in (("left_foot", 0.0, 1.99), ("right_foot", 2.0, 2.99), ("left_foot", 3.0, 4.0)):
            rows = (joints.time >= begin) & (joints.time <= end)
            place = np.asarray(free.forward_kinematics(motion.q[rows], foot))
            assert np.ptp(place[:, :3], axis=0).max() < drift
            assert abs(place[:, 2, 3] - 0.05).max() < steps_down  # the sole is 5 cm below the ankle, on the floor
    dt = joints.time[1] - joints.time[0]
    rows = slice(2, 190)
    p = motion.q[:, 4:7]
    slope = (8 * (p[3:-1] - p[1:-3]) - (p[4:] - p[:-4])) / (12 * dt)
    R = np.asarray(free.forward_kinematics(motion.q, "trunk"))[:, :3, :3]
    v = np.einsum("nij,nj->ni", R, motion.dq[:, 3:6])
    assert_allclose(v[2:-2][rows], slope[rows], atol=1e-4 * np.abs(slope).max())
    V = motion.dq
    change = (8 * (V[3:-1] - V[1:-3]) - (V[4:] - V[:-4])) / (12 * dt)
    assert_allclose(motion.ddq[2:-2][rows], change[rows], atol=2e-3 * np.abs(change).max())


@pytest.mark.parametrize("stance", ["auto", "right_foot"])
def test_a_trunk_that_sways_on_its_ankles_has_the_rates_of_an_inverted_pendulum(biped, stance):
    """Hips and knees keep straight: the trunk, 0.8 m above the ankles, turns about them, and feels no more in its own axes."""
    held, free = tw.load(biped), tw.load(biped, floating_base=True)
    t = np.linspace(0.0, 1.0, 30)
    q, dq, ddq = 0.1 * np.sin(3 * t), 0.3 * np.cos(3 * t), -0.9 * np.sin(3 * t)
    ankles = [0, 0, 1, 0, 0, 1]
    joints = tw.Motion(t, *(np.outer(x, ankles) for x in (q, dq, ddq)), robot=held, in_seconds=True)
    motion = statics.base_from_stance(free, joints, ("left_foot", "right_foot"), stance)
    about_y_and_along_x = [0, 1, 0, 0.8, 0, 0]
    assert_allclose(motion.dq[:, :6], np.outer(-dq, about_y_and_along_x), atol=1e-9)
    assert_allclose(motion.ddq[:, :6], np.outer(-ddq, about_y_and_along_x), atol=1e-9)


LIFTED = """<robot name="lifted"><link name="trunk"><inertial><mass value="10"/><inertia ixx="1" ixy="0" ixz="0" iyy="1"
iyz="0" izz="1"/></inertial></link>{legs}</robot>"""
LEG = """<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><geometry><box size="0.2 0.1 0.02"/></geometry></collision></link><joint name="{name}_down" type="prismatic">
<parent link="trunk"/><child link="{name}"/><origin xyz="0 {y} -0.5"/><axis xyz="0 0 -1"/><limit lower="-1" upper="1"
effort="9" velocity="9"/></joint>"""


@pytest.fixture(scope="module")
def lifted(tmp_path_factory):
    """A trunk on two legs that slide downwards, held and free: coordinates are how far the soles stand out."""
    path = tmp_path_factory.mktemp("lifted") / "lifted.urdf"
    legs = LEG.format(name="left", y=0.1) + LEG.format(name="right", y=-0.1)
    path.write_text(LIFTED.format(legs=legs))
    return tw.load(path), tw.load(path, floating_base=True)


def trunk(lifted, right, dt=0.005):
    """Rise of the trunk [mm] and its rate [mm/s], while the right leg goes out by ``right`` [mm] and the left one stays."""
    held, free = lifted
    n = len(right)
    q = np.column_stack([np.zeros(n), 1e-3 * np.asarray(right, float)])
    motion = tw.Motion(dt * np.arange(n), q, robot=held, in_seconds=True)
    motion = statics.base_from_stance(free, motion, ("left", "right"))
    return 1e3 * (motion.q[:, 6] - motion.q[0, 6]), 1e3 * motion.dq[:, 5]


@pytest.mark.parametrize(
    ("right", "takes_over"),
    [
        ([6.0] * 5, True),  # lower for 20 ms
        ([6.0] * 4, False),  # for 15 ms
        ([5.1] * 5, True),
        ([4.9] * 40, False),
        ([6.0] * 3 + [0.0] * 4 + [6.0] * 3, False),  # two short times are not one long time
        ([6.0] * 3 + [0.0] * 4 + [6.0] * 5, True),
    ],
)
def test_a_foot_takes_over_if_it_is_lower_by_5_mm_for_20_ms(lifted, right, takes_over):
    """A foot that took over stays where it has come to, in a dent of the ground: the trunk sinks when its leg draws in."""
    risen, _ = trunk(lifted, [0.0] * 3 + right + [0.0] * 30)
    assert_allclose(risen[: 3 + len(right)], 0.0, atol=1e-9)
    assert_allclose(risen[-30:], -right[-1] if takes_over else 0.0, atol=1e-9)


@pytest.mark.parametrize(("rows", "takes_over"), [(1, False), (2, True)])
def test_at_the_end_of_a_motion_two_rows_in_which_a_foot_is_lower_are_a_step_and_one_is_not(lifted, rows, takes_over):
    """The motion ends before the time is up for which the foot would be lower; one row alone may be a glitch."""
    right = [0.0] * 5 + [6.0, 7.0][:rows]
    risen, rate = trunk(lifted, right)
    assert_allclose(risen[-1], 1.0 if takes_over else 0.0, atol=1e-9)
    assert (abs(rate[-1]) > 1.0) == takes_over and abs(rate[:5]).max() < 1e-9


def test_a_foot_that_takes_over_stands_from_where_both_were_last_at_one_height(lifted):
    """It goes out at 0.1 mm a row: up to 0.5 mm both stand, and from there on it carries the trunk up."""
    right = 0.1 * np.arange(100)
    risen, _ = trunk(lifted, right)
    assert_allclose(risen[:5], 0.0, atol=1e-9)
    assert_allclose((right - risen)[10:], right[-1] - risen[-1], atol=1e-9)
    assert 0.35 < right[-1] - risen[-1] < 0.65


@pytest.mark.parametrize(("shape", "radius"), [("sphere", 0.03), ("sphere", 0.2), ("cylinder", 0.03)])
def test_a_wheel_touches_the_ground_below_its_centre_at_its_radius(tmp_path, shape, radius):
    """A ball caster, and a cylinder about y, which reaches as deep."""
    length = "" if shape == "sphere" else 'length="0.02"'
    path = tmp_path / "caster.urdf"
    path.write_text(
        f"""<robot name="caster"><link name="base"/><link name="wheel"><collision><origin rpy="1.5707963267948966 0 0"/>
        <geometry><{shape} radius="{radius}" {length}/></geometry></collision></link><joint name="axle" type="continuous"><parent link="base"/>
        <child link="wheel"/><axis xyz="0 1 0"/></joint></robot>"""
    )
    assert_allclose(statics.wheel(tw.load(path), "wheel", 0.0).radius, radius, rtol=1e-3)


def test_four_feet_that_are_points_stand_together():
    free = tw.robots.quadruped()
    held = tw.load(tw.robots.path_of("quadruped"), floating_base=False)
    t = np.linspace(0, 1, 101)
    bend = 0.2 * np.sin(np.pi * t)[:, None] ** 4
    joints = tw.Motion(t, np.tile([0.0, 0.7, -1.4], 4) + bend * np.tile([0.0, 1.0, -2.0], 4), robot=held)
    feet = statics.find_feet(free)
    motion = statics.base_from_stance(free, joints, feet)
    for foot in feet:
        assert np.ptp(np.asarray(free.forward_kinematics(motion.q, foot))[:, :3, 3], axis=0).max() < 1e-9
        J = np.asarray(free.jacobian(motion.q, foot))[:, 3:]
        assert np.abs(np.einsum("nij,nj->ni", J, motion.dq)).max() < 1e-9


def test_a_base_on_points_has_the_rates_for_which_the_points_neither_move_nor_speed_up():
    """Joint rates that the ground allows; the same points are given in the frames of the feet and of the shanks, which turn."""
    free, rng = tw.robots.quadruped(), np.random.default_rng(4)
    feet = [f"{leg}_foot" for leg in ("FL", "FR", "RL", "RR")]
    q = np.array(free.neutral)
    q[7:] = np.tile([0.0, 0.8, -1.6], 4) + 0.2 * rng.normal(size=12)
    q[:4] = quaternion.from_matrix(so3.exp([0.3, -0.2, 0.5]))
    J = np.concatenate([free.jacobian(q, foot)[3:] for foot in feet])
    allowed = np.eye(18) - np.linalg.pinv(J) @ J
    dq = allowed @ rng.normal(size=18)
    bias = np.concatenate([free.frame_acceleration(q, dq, np.zeros(18), foot)[3:] for foot in feet])  # the points rest
    ddq = allowed @ rng.normal(size=18) - np.linalg.pinv(J) @ bias
    in_shanks = {}
    for foot in feet:
        shank = free.model.bodies[free.model.frames[foot].body].link
        in_shanks[shank] = (np.linalg.inv(free.forward_kinematics(q, shank)) @ free.forward_kinematics(q, foot))[
            None, :3, 3
        ]
        assert np.linalg.norm(in_shanks[shank]) > 0.1
    for soles in ({foot: np.zeros((1, 3)) for foot in feet}, in_shanks):
        found = stance_rates(free, q[None], dq[None, 6:], ddq[None, 6:], soles, np.ones((1, 4), bool))
        assert_allclose(found[0][0], dq, atol=1e-9)
        assert_allclose(found[1][0], ddq, atol=1e-9)


ENDS = {  # frames at the end of a leg: name, height above its lowest [m], whether it has a shape; the last one is the farthest
    "the lowest": ([("tip", 0.0, False), ("above", 0.02, True)], "tip"),
    "the farthest of equals": ([("tip", 0.0, False), ("end", 0.0, False)], "end"),
    "a foot 9 mm above": ([("sole", 0.009, False), ("tip", 0.0, False)], "sole"),
    "a foot 11 mm above": ([("sole", 0.011, False), ("tip", 0.0, False)], "tip"),
    "a foot with a shape": ([("ankle", 0.009, True), ("sole", 0.0, False)], "ankle"),
    "a shape without a name": ([("Foot", 0.005, False), ("tip", 0.0, True)], "Foot"),
    "sensors alone": ([("foot_imu", 0.0, False), ("sole", 0.02, False)], "foot_imu"),
    **{
        f"a {word}": ([(word, 0.005, False), ("tip", 0.0, False)], word)
        for word in ("foot", "sole", "ankle", "wheel", "toe")
    },
    **{
        f"beside a {word}": ([("tip", 0.005, False), (f"Foot_{word}", 0.0, True)], "tip")
        for word in ("bumper", "sensor", "fsr", "tactel", "imu", "camera")
    },
}


@pytest.mark.parametrize("name", ENDS)
def test_a_leg_stands_on_a_frame_within_a_centimetre_that_is_named_as_a_foot_and_is_no_sensor(name):
    frames, chosen = ENDS[name]
    text = ""
    for side, y in (("left", 0.1), ("right", -0.1)):
        parent = "trunk"
        for part, z in (("thigh", 0.0), ("shank", -0.4)):
            text += (
                f'<link name="{side}_{part}"/><joint name="{side}_{part}_joint" type="continuous"><parent link="{parent}"/>'
                f'<child link="{side}_{part}"/><origin xyz="0 {y if parent == "trunk" else 0} {z}"/><axis xyz="0 1 0"/></joint>'
            )
            parent = f"{side}_{part}"
        for end, height, shaped in frames:
            shape = '<collision><geometry><sphere radius="0.01"/></geometry></collision>' if shaped else ""
            text += (
                f'<link name="{side}_{end}">{shape}</link><joint name="{side}_{end}_fixed" type="fixed"><parent link="{parent}"/>'
                f'<child link="{side}_{end}"/><origin xyz="0 0 {height - 0.4}"/></joint>'
            )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(f'<robot name="walker"><link name="trunk"/>{text}</robot>')
    assert statics.find_feet(robot) == (f"left_{chosen}", f"right_{chosen}")


@pytest.mark.parametrize(("pitch", "leans"), [(0.3, True), (0.77, True), (0.8, False), (-0.77, True), (-0.8, False)])
def test_a_base_leans_with_its_soles_up_to_45_degrees_and_stands_upright_on_edges_beyond(biped, pitch, leans):
    """Both soles in one plane: up to there, that plane is the floor; a robot whose toes point down stands on these."""
    held, free = tw.load(biped), tw.load(biped, floating_base=True)
    q = np.tile([0.0, 0.0, pitch, 0.0, 0.0, pitch], (4, 1))
    still = tw.Motion(0.01 * np.arange(4), q, np.zeros((4, 6)), np.zeros((4, 6)), robot=held, in_seconds=True)
    motion = statics.base_from_stance(free, still, ("left_foot", "right_foot"))
    turned = quaternion.rotation(motion.q[0, :4])
    assert_allclose(turned, so3.exp([0.0, -pitch if leans else 0.0, 0.0]), atol=1e-9)
    corners = np.concatenate([[c.point for c in statics.sole(held, foot, 0.6)] for foot in ("left_foot", "right_foot")])
    T = np.asarray(free.forward_kinematics(motion.q[0], "left_foot"))
    assert_allclose((corners @ T[:3, :3].T + T[:3, 3])[:, 2].min(), 0.0, atol=1e-9)


def test_a_pose_that_two_points_leave_open_is_an_error_and_a_foot_that_is_not_there_too(biped):
    held, free = tw.load(biped), tw.load(biped, floating_base=True)
    joints = steps(held)
    with pytest.raises(tw.UnknownNameError, match="left_foot"):
        statics.base_from_stance(free, joints, ("left_foot", "right_foot"), "left_hand")
    with pytest.raises(tw.ShapeError, match="floating_base"):
        statics.base_from_stance(held, joints, ("left_foot", "right_foot"))
    with pytest.raises(tw.ShapeError, match="3 frames for 401 rows"):
        statics.base_from_stance(free, joints, ("left_foot", "right_foot"), ["left_foot"] * 3)
