"""Wrench on the mounting, loads of bolts and of bearings: sums, statics by hand, and a floating copy of the robot."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import twistwrench as tw
from twistwrench import statics


def moving(robot, seed=0, rows=5):
    rng = np.random.default_rng(seed)
    q = robot.random_configuration(rng, (rows,))
    return q, *rng.standard_normal((2, rows, robot.nv))


@pytest.mark.parametrize("name", ["ur5", "panda", "quadruped"])
def test_the_mounting_carries_what_drives_a_free_root_at_rest(name):
    """The same file with a floating base that does not move: its six rows are the wrench of the foundation on the robot."""
    path = tw.robots.path_of(name)
    fixed, free = tw.load(path, floating_base=False), tw.load(path, floating_base=True)
    q, dq, ddq = moving(fixed)
    load = statics.mounting_load(fixed, q, dq, ddq)
    at_rest = np.zeros((len(q), 6))
    root = np.repeat(free.neutral[None, :7], len(q), axis=0)
    tau = free.inverse_dynamics(np.c_[root, q], np.c_[at_rest, dq], np.c_[at_rest, ddq])
    assert_allclose(load.wrench, -tau[:, :6], rtol=1e-9, atol=1e-9)


def test_at_rest_the_mounting_carries_the_whole_weight():
    ur5 = tw.robots.ur5()
    load = statics.mounting_load(ur5, ur5.neutral, np.zeros(6), np.zeros(6))
    mass = ur5.model.moving_mass + ur5.model.base_inertia.mass
    assert_allclose(load.wrench[0, 3:], [0, 0, -9.81 * mass], atol=1e-9)
    assert load.largest["fz"] == (load.wrench[0, 5], 0)


RAIL = """<robot name="rail"><link name="track"/><link name="carriage"><inertial><mass value="40"/>
<inertia ixx="1" iyy="1" izz="1.5" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="rail" type="prismatic">
<parent link="track"/><child link="carriage"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="2000" velocity="1.5"/>
</joint></robot>"""
PEDESTAL = """<robot name="pedestal"><link name="foot"><inertial><mass value="80"/>
<inertia ixx="2" iyy="2" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="top"/>
<joint name="up" type="fixed"><parent link="foot"/><child link="top"/><origin xyz="0.2 0 0.7"/></joint></robot>"""


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """UR5 on the carriage of a locked rail, on a heavy pedestal, and beside a second arm; with the frame each stands on."""
    folder = tmp_path_factory.mktemp("cells")
    for name, text in (("rail", RAIL), ("pedestal", PEDESTAL)):
        (folder / f"{name}.urdf").write_text(text)
    return {
        "rail": (tw.join(folder / "rail.urdf", "ur5@carriage").robot.lock({"rail": 0.6}), "base_link"),
        "pedestal": (tw.join(folder / "pedestal.urdf", "ur5@top").robot, "base_link"),
        "two arms": (tw.join("ur5@floor:left_", "ur5@floor+0,1,0,0,30deg,0:right_").robot, "left_base_link"),
    }


@pytest.mark.parametrize("name", ["rail", "pedestal", "two arms"])
def test_what_lies_below_a_mounting_or_beside_it_does_not_load_it(cells, name):
    """The wrench on a frame is that of what stands on it: the wrench of the same robot alone, on a fixed base."""
    cell, frame = cells[name]
    q, dq, ddq = moving(cell)
    alone = statics.mounting_load(tw.robots.ur5(), q[:, :6], dq[:, :6], ddq[:, :6]).wrench
    load = statics.mounting_load(cell, q, dq, ddq, frame)
    assert_allclose(load.wrench, alone, rtol=1e-9, atol=1e-9)
    assert load.frame == frame
    motion = tw.Motion(np.arange(len(q)) / 100, q, dq, ddq, robot=cell, in_seconds=True)
    answer = tw.check(cell, motion, mounting=frame, bolts="4x0.17")
    assert_allclose(answer.bolt_loads[..., 0].sum(axis=1), alone[:, 5], rtol=1e-9)


@pytest.mark.parametrize("name", ["rail", "pedestal", "two arms"])
def test_the_root_of_a_cell_carries_the_weight_of_all(cells, name):
    cell, _ = cells[name]
    still = np.zeros(cell.nv)
    load = statics.mounting_load(cell, cell.neutral, still, still)
    assert_allclose(load.wrench[0, 5], -9.81 * (cell.model.moving_mass + cell.model.base_inertia.mass), rtol=1e-9)


def test_the_rotors_of_a_robot_load_the_mounting_by_their_change_of_momentum():
    """A rotor of inertia J on the base, which turns G times as fast as the joint: G J ddq about the axis more."""
    plain = tw.robots.ur5()
    rotor = {"inertia": "1e-4 kg m^2", "extra": True, "mass": "0.5 kg"}
    driven = plain.with_actuators({"actuators": {"shoulder_pan_joint": {"ratio": 100, "rotor": rotor}}})
    q, dq, ddq = moving(plain)
    more = statics.mounting_load(driven, q, dq, ddq).wrench - statics.mounting_load(plain, q, dq, ddq).wrench
    weight = np.tile([0, 0, -0.5 * 9.81], (len(q), 1))
    assert_allclose(more[:, 3:], weight, atol=1e-9)
    assert_allclose(more[:, 2], -100 * 1e-4 * ddq[:, 0], atol=1e-9)


def test_a_push_on_a_fixed_link_loads_the_mounting_that_the_link_stands_on(cells):
    cell, frame = cells["pedestal"]
    still, push = np.zeros(cell.nv), np.array([0, 0, 0, 0, 0, -50.0])
    plain, on_arm, on_foot = (
        statics.mounting_load(cell, cell.neutral, still, still, frame, wrench_on_robot=pushed).wrench
        for pushed in (None, {frame: push}, {"foot": push})
    )
    assert_allclose(on_arm - plain, [push], atol=1e-9)
    assert_allclose(on_foot, plain, atol=1e-9)


def test_bolts_add_up_to_the_wrench():
    ur5 = tw.robots.ur5()
    load = statics.mounting_load(ur5, *moving(ur5))
    places = np.array([[0.1, 0.0], [-0.05, 0.09], [-0.07, -0.08], [0.03, 0.02]])  # neither symmetric nor centred
    axial = load.bolts(places)[..., 0]
    assert_allclose(axial.sum(axis=1), load.wrench[:, 5], rtol=1e-9)
    assert_allclose(axial @ places[:, 1], load.wrench[:, 0], rtol=1e-9, atol=1e-9)
    assert_allclose(-axial @ places[:, 0], load.wrench[:, 1], rtol=1e-9, atol=1e-9)
    assert_allclose(load.bolts(places, preload=500.0)[..., 0], axial + 500.0)


def test_bolts_on_a_circle_by_hand():
    """A tilting moment M on k bolts of a circle of diameter D: largest axial load 4 M / (k D); torsion: 2 M / (k D)."""
    tilted = statics.MountingLoad(
        np.array([[0, 12.0, 0, 0, 0, 0], [0, 0, 12.0, 0, 0, 0], [0, 0, 0, 8.0, 0, 0]]), "base"
    )
    loads = tilted.bolts(statics.bolt_circle(4, 0.2))
    assert_allclose(np.abs(loads[0, :, 0]).max(), 4 * 12.0 / (4 * 0.2))
    assert_allclose(loads[1, :, 1], 2 * 12.0 / (4 * 0.2))
    assert_allclose(loads[2, :, 1], 2.0)


def test_bolts_beside_the_origin_bear_torsion_about_their_own_centre():
    """A force through their centre is shared equally, and a couple is, wherever the frame's origin lies."""
    centre, force = np.array([0.3, -0.2, 0.0]), np.array([30.0, 40.0, 0.0])
    wrenches = np.array([[*np.cross(centre, force), *force], [0, 0, 12.0, 0, 0, 0]])
    shear = statics.MountingLoad(wrenches, "base").bolts(statics.bolt_circle(5, 0.2) + centre[:2])[..., 1]
    assert_allclose(shear[0], 50.0 / 5)
    assert_allclose(shear[1], 2 * 12.0 / (5 * 0.2))


def test_bearings_carry_what_the_motor_does_not():
    """Force and moment across each joint, less the part along its axis, which is the motor's torque."""
    ur5 = tw.robots.ur5()
    q, dq, ddq = moving(ur5)
    loads = statics.bearing_loads(ur5, q, dq, ddq)
    F, tau = ur5.joint_wrenches(q, dq, ddq), ur5.inverse_dynamics(q, dq, ddq)
    assert loads.joints == ur5.joint_names
    assert_allclose(np.hypot(loads.axial, loads.radial), np.linalg.norm(F[..., 3:], axis=-1), rtol=1e-9)
    assert_allclose(np.hypot(loads.tilting, tau), np.linalg.norm(F[..., :3], axis=-1), rtol=1e-9)


def test_impossible_mountings_are_errors():
    ur5, box = tw.robots.ur5(), tw.robots.floating_box()
    z = np.zeros(6)
    with pytest.raises(tw.ValueRangeError, match="floating_base=False"):
        statics.mounting_load(box, box.neutral, z, z)
    for way in ("fixed to the base", "columns radial, axial, tilting", "statics.bearing_loads"):
        with pytest.raises(tw.ValueRangeError, match=way):
            statics.mounting_load(ur5, ur5.neutral, z, z, "tool0")
    with pytest.raises(tw.ValueRangeError, match="one line"):
        statics.mounting_load(ur5, ur5.neutral, z, z).bolts([[0, 0], [1, 0], [2, 0]])
    with pytest.raises(tw.ShapeError, match=r"\(k, 2\)"):
        statics.mounting_load(ur5, ur5.neutral, z, z).bolts([0.0, 0.0])


# ── Limits of bearings


def checked(limits, **options):
    return tw.check("ur5", "demo", payload=5, limits=limits, **options)


def largest_loads():
    """Largest loads of the elbow's bearing in the demo with 5 kg, by the reactions of its samples."""
    motion = checked(None).motion
    loaded = tw.robots.ur5().with_payload(tw.SpatialInertia.from_com(5.0))
    loads = statics.bearing_loads(loaded, motion.q, motion.dq, motion.ddq)
    k = loads.joints.index("elbow_joint")
    return {kind: float(getattr(loads, kind)[:, k].max()) for kind in ("axial", "radial", "tilting")}


@pytest.mark.parametrize("kind", ["axial", "radial", "tilting"])
def test_a_bearing_is_over_its_limit_where_its_largest_load_is(kind, tmp_path):
    largest = largest_loads()[kind]
    file = tmp_path / "limits.csv"
    for share, word in ((0.999, "OVER LIMIT"), (1.001, "OK")):
        file.write_text(f"joint,{kind}\nelbow_joint,{share * largest:.9g}\n")
        assert checked(file).verdict.word == word
    file.write_text(f"joint,{kind} [{'kN m' if kind == 'tilting' else 'kN'}]\nelbow_joint,{0.5e-3 * largest:.9g}\n")
    found = checked(file)
    (excess,) = found.excesses
    assert excess.kind == kind and excess.limit == pytest.approx(0.5 * largest)
    assert excess.value == pytest.approx(largest, rel=1e-6)
    words = {"axial": "axial force", "radial": "radial force", "tilting": "tilting moment"}[kind]
    assert str(found.verdict).startswith(f"OVER LIMIT: the bearing of elbow_joint: {words} ")


def test_bearings_are_limits_of_a_robot_and_of_a_call():
    ur5 = tw.robots.ur5()
    assert np.isinf(ur5.limits.tilting).all()
    answer = checked({"tilting": np.full(6, 1.0)})
    assert {e.joint for e in answer.excesses if e.kind == "tilting"} > {"elbow_joint"}
    assert answer.largest_payload == pytest.approx(checked(None).largest_payload)  # by torques alone


def test_units_of_bearings_are_those_of_forces_and_moments(tmp_path):
    file = tmp_path / "limits.csv"
    file.write_text("joint,tilting [N]\nelbow_joint,3\n")
    with pytest.raises(tw.ValueRangeError, match="tilting"):
        checked(file)


def test_an_actuator_file_limits_bearings():
    ur5 = tw.robots.ur5().with_actuators(
        {"actuators": {"elbow_joint": {"ratio": 100, "tilting": "12 N m", "axial": "2 kN"}}}
    )
    k = ur5.model.velocity_names.index("elbow_joint")
    assert (ur5.limits.tilting[k], ur5.limits.axial[k], ur5.limits.radial[k]) == (12.0, 2000.0, np.inf)
    (excess,) = tw.check(ur5, checked(None).motion, payload=5).excesses
    assert (excess.joint, excess.kind, excess.limit) == ("elbow_joint", "tilting", 12.0)
    with pytest.raises(tw.ModelError, match="tilting"):
        tw.robots.ur5().with_actuators({"actuators": {"elbow_joint": {"ratio": 100, "tilting": "0 N m"}}})
