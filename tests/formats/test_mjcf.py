"""MJCF against MuJoCo's own compiler: M with armature, bias, springs, poses, limits, centre of mass, at random states."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from mjcf_random import random_mjcf
from mjcf_texts import MESHES, TEXTS, arm
from mujoco_models import differences, load_both, rates, to_theirs
from places import SHARED
from quick import mostly_slow
from quiet_loading import load_quietly

import twistwrench as tw

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed", exc_type=ImportError)

FOLDER = SHARED / "robots" / "mjcf"
FILES = sorted(str(path.relative_to(FOLDER)) for path in FOLDER.rglob("*.xml")) if FOLDER.is_dir() else []
NONE = [pytest.param("", marks=pytest.mark.skip(reason="../shared/robots/mjcf is not there"))]
SAID = {
    r"springs: ": "(with a stiffness, which is left out|slack over a range|spatial tendon)",
    r"(M|h): ": "(tendon|actuator).* armature|has an armature|forces and inertia are left out",
}
"""What may differ where the robot's remarks say so."""


def unsaid(found, robot):
    """The differences that no remark of the robot speaks of."""
    remarks = " ".join(robot.defects)
    return [one for one in found if not any(re.match(k, one) and re.search(v, remarks) for k, v in SAID.items())]


@pytest.mark.parametrize("name", TEXTS)
def test_a_small_model_means_what_mujoco_means(name):
    robot, model = load_both(TEXTS[name], mujoco)
    assert robot.nv
    assert differences(robot, model, mujoco, tolerance=1e-8 if name in MESHES else 1e-9) == []


@pytest.mark.parametrize("seed", mostly_slow(range(12), 3))
def test_a_random_model_means_what_mujoco_means(seed):
    """Everything at once; a few of the texts MuJoCo does not take, such as a position beside the ends of an axis."""
    text = random_mjcf(seed)
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError:
        pytest.skip("MuJoCo does not compile it")
    robot, model = load_both(text, mujoco)
    assert differences(robot, model, mujoco, states=1) == []


@pytest.mark.parametrize("name", FILES or NONE)
def test_a_file_means_what_mujoco_means(name):
    path = FOLDER / name
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        pytest.skip("MuJoCo does not compile it")
    robot, model = load_both(path, mujoco)
    assert unsaid(differences(robot, model, mujoco), robot) == []


@pytest.mark.parametrize("name", [n for n in FILES if n.replace(".xml", "_nomesh.xml") in FILES] or NONE)
def test_without_its_meshes_a_file_is_its_twin(name):
    """MuJoCo needs the meshes to be there; masses are in the file, so nothing of them is read here."""
    pair = [load_quietly(FOLDER / one) for one in (name, name.replace(".xml", "_nomesh.xml"))]
    q = pair[0].random_configuration(np.random.default_rng(1))
    one, other = (robot.reference("mass_matrix", q) for robot in pair)
    np.testing.assert_array_equal(one, other)
    assert pair[0].frame_names == pair[1].frame_names


@pytest.mark.parametrize(
    ("joint", "drives", "most"),
    [
        ("", '<motor joint="b" ctrlrange="-2 3" gear="10"/>', 20.0),
        ("", '<motor joint="b" ctrlrange="-2 3" gear="10"/><motor joint="b" ctrlrange="-2 3" gear="-10"/>', 50.0),
        ("", '<motor joint="b" ctrlrange="0 3" gear="10"/><motor joint="b" ctrlrange="0 2" gear="-10"/>', 20.0),
        ("", '<motor joint="b" ctrlrange="-2 3" forcerange="-9 1" gear="10"/>', 10.0),
        ("", '<motor joint="b" forcerange="-4 4" ctrlrange="-9 9" gear="-5"/>', 20.0),
        ("", '<motor joint="b" forcerange="-4 4" ctrlrange="-2 2" gear="-5"/>', 10.0),
        ("", '<motor joint="b" forcerange="-4 4"/><motor joint="b" ctrlrange="-1 1"/>', 5.0),
        ('actuatorfrcrange="-7 7"', '<motor joint="b" ctrlrange="-2 3" gear="10"/>', 7.0),
        ('actuatorfrcrange="-7 5"', '<motor joint="b" ctrlrange="-2 3" gear="10"/>', 5.0),
        ('actuatorfrcrange="-70 70"', '<motor joint="b" ctrlrange="-2 3" gear="10"/>', 20.0),
        ('actuatorfrcrange="-70 60"', '<position joint="b" kp="3"/>', 60.0),
        ("", '<general joint="b" ctrlrange="-2 2" gainprm="3"/>', 6.0),
        ("", '<general joint="b" ctrlrange="-2 2" gainprm="-3"/>', 6.0),
        ("", '<general joint="b" ctrlrange="-2 2" gainprm="3" biastype="affine"/>', np.inf),
        ("", '<position joint="b" ctrlrange="-2 2" kp="3"/>', np.inf),
        ("", '<position joint="b" ctrlrange="-2 2" kp="3" forcerange="-6 6"/>', 6.0),
        ("", '<motor joint="b" ctrlrange="-2 2" ctrllimited="false"/>', np.inf),
        ("", "", np.inf),
    ],
)
def test_efforts_are_what_the_actuators_can_give_to_either_side(joint, drives, most):
    """Also MuJoCo's: the actuator force it lets through at that joint, found by asking for far too much each way."""
    text = arm(joint2=f'<joint name="b" {joint}/>', tail=f"<actuator>{drives}</actuator>")
    robot, model = load_quietly(text), mujoco.MjModel.from_xml_string(text)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        same = tw.from_mujoco(model)
    assert robot.limits.effort.tolist() == same.limits.effort.tolist() == [np.inf, most]
    told = [any(words in text for text in robot.defects) for words in ("largest force is not given", "to one side")]
    assert [any(w in text for text in same.defects) for w in ("largest force is not given", "to one side")] == told
    if not np.isfinite(most):
        assert told == [bool(drives), False]
        return
    reached = _forced(model)
    assert reached.min() == pytest.approx(most)
    assert told == [False, bool(np.ptp(reached) > 0)]


def _forced(model):
    """The largest forces at the second joint, either way."""
    data, reached = mujoco.MjData(model), []
    for asked in np.array(np.meshgrid(*[[-1e6, 1e6]] * model.nu)).reshape(model.nu, -1).T:
        data.ctrl[:] = asked
        mujoco.mj_forward(model, data)
        reached.append(data.qfrc_actuator[1])
    return np.array([-min(reached), max(reached)])


def test_a_joint_driven_to_one_side_only_has_the_limit_of_that_side_and_a_remark():
    text = arm(joint2='<joint name="b"/>', tail='<actuator><motor joint="b" ctrlrange="0 3" gear="-10"/></actuator>')
    robot = load_quietly(text)
    assert robot.limits.effort.tolist() == [np.inf, 30.0]
    assert any("is driven to one side only, by up to 30" in said for said in robot.defects)


def test_following_joints_share_a_coordinate_or_not():
    tail = '<equality><joint joint1="b" joint2="a" polycoef="0.3 2 0 0 0"/></equality>'
    joints = {"joint1": '<joint name="a" ref="10"/>', "joint2": '<joint name="b" ref="30" armature="0.5"/>'}
    text = arm(tail=tail, **joints)
    robot, free = load_quietly(text), load_quietly(text, mimic="independent")
    assert (robot.joint_names, free.joint_names) == (("a",), ("a", "b"))
    qa = 0.4
    qb = np.radians(30) + 0.3 + 2 * (qa - np.radians(10))
    np.testing.assert_allclose(
        robot.forward_kinematics([qa], "lower"), free.forward_kinematics([qa, qb], "lower"), atol=1e-14
    )
    J = np.array([1.0, 2.0])
    assert robot.mass_matrix([qa])[0, 0] == pytest.approx(J @ free.mass_matrix([qa, qb]) @ J, rel=1e-12)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = qa, qb
    mujoco.mj_forward(model, data)
    assert abs(data.efc_pos[0]) < 1e-12  # MuJoCo's constraint is met


@pytest.mark.parametrize(
    ("constraint", "closed"),
    [
        ('<connect name="c" body1="lower" body2="other" anchor="0 0.1 0.5"/>', True),
        ('<weld name="c" body1="lower" body2="other"/>', True),
        ('<weld name="c" body1="lower" body2="other" relpose="0.1 0.2 0.3 1 1 0 0" anchor="0.3 0 0"/>', False),
        ('<connect name="c" site1="s" site2="t"/>', False),
        ('<connect name="c" body1="lower" anchor="0.1 0.2 0.3"/>', True),
    ],
)
def test_loops_are_offered_where_mujoco_closes_them(constraint, closed):
    """The two frames of a closure lie on each other where, and only where, MuJoCo finds its constraint met."""
    more = """<body name="other" pos="0.2 0.1 0.6"><joint name="m"/><joint name="n" axis="1 0 0"/><geom size="0.1"/>
      <site name="t" pos="0 0 0.1"/></body>"""
    text = arm(
        world=more, joint2='<joint name="b"/><site name="s" pos="0.1 0 0"/>', tail=f"<equality>{constraint}</equality>"
    )
    robot, model = load_both(text, mujoco)
    (closure,) = robot.closures.values()
    assert any("robot.close(" in text for text in robot.defects)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    for _ in range(3):
        q = rng.uniform(-1, 1, robot.nq)
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        a, b = (robot.forward_kinematics(q, frame) for frame in (closure.frame_a, closure.frame_b))
        mine = np.linalg.norm(a[:3, 3] - b[:3, 3])
        assert mine == pytest.approx(np.linalg.norm(data.efc_pos[:3]), abs=1e-9)
    if "weld" in constraint:
        turn = tw.so3.log(a[:3, :3].T @ b[:3, :3])
        assert np.linalg.norm(data.efc_pos[3:6]) == pytest.approx(np.sin(np.linalg.norm(turn) / 2), rel=1e-6)
    if closed:  # as the file has the bodies
        held = robot.close(closure.frame_a, closure.frame_b, closure.rows, near=[0.0] * 4, redundant="accept")
        assert np.abs(held.constraint_error(np.zeros(4))).max() < 1e-12


def test_states_are_translated_for_joints_without_names_too():
    from twistwrench.robot.convert import from_mujoco, mujoco_rates, to_mujoco

    robot, model = load_both(TEXTS["nameless"], mujoco)
    rng = np.random.default_rng(6)
    q, dq = robot.random_configuration(rng), rng.uniform(-1, 1, robot.nv)
    theirs = to_mujoco(robot, model, q, dq)
    np.testing.assert_allclose(theirs[0], to_theirs(robot, q), atol=1e-15)
    np.testing.assert_allclose(mujoco_rates(robot, model, q), rates(robot, q), atol=1e-15)
    np.testing.assert_allclose(from_mujoco(robot, model, *theirs)[1], dq, atol=1e-12)


def test_dynamics_with_losses_are_mujocos():
    """τ with damping and springs, where MuJoCo's constraints are off."""
    text = TEXTS["spring, damper, drive"].replace(
        "<worldbody>", '<option><flag constraint="disable"/></option><worldbody>', 1
    )
    robot, model = load_both(text, mujoco)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(4)
    q, dq, ddq = rng.uniform(-1, 1, (3, 2))
    data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
    mujoco.mj_inverse(model, data)
    tau = robot.inverse_dynamics(q, dq, ddq) + robot.model.friction.viscous * dq
    np.testing.assert_allclose(tau, data.qfrc_inverse, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("name", TEXTS)
def test_a_compiled_model_is_the_robot_of_its_file(name):
    try:
        model = mujoco.MjModel.from_xml_string(TEXTS[name])
    except ValueError:
        pytest.skip("MuJoCo does not compile it")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.from_mujoco(model, snap=0, inertia="accept", mimic="independent")
    filed = load_quietly(TEXTS[name], snap=0, inertia="accept", mimic="independent")
    assert differences(robot, model, mujoco) == []
    assert (robot.joint_names, robot.frame_names) == (filed.joint_names, filed.frame_names)
    np.testing.assert_allclose(robot.limits.upper, filed.limits.upper)
    np.testing.assert_allclose(robot.limits.effort, filed.limits.effort)
    np.testing.assert_allclose(robot.armature, filed.armature)
    np.testing.assert_allclose(robot.model.friction.viscous, filed.model.friction.viscous)
    assert [(s.terms, s.stiffness) for s in robot.model.springs] == [
        (s.terms, s.stiffness) for s in filed.model.springs
    ]
    np.testing.assert_allclose([s.rest for s in robot.model.springs], [s.rest for s in filed.model.springs], atol=1e-15)


FORCES = """<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="j" ref="0.2" axis="0 1 0"/><geom size=".1"/>
  <site name="s" pos="0 0 0.3"/><body name="b" pos="1 0 0.5" euler="0 0.3 0"><joint name="k" axis="0 1 0" ref="-0.1"/><geom size=".1"/>
  <site name="t" pos="0.1 0 0"/><body name="c" pos="0.2 0 0"><joint name="l" axis="0 1 0"/><geom size=".1"/></body></body></body>
  </worldbody>
  <tendon><fixed stiffness="3" springlength="0.2"><joint joint="j" coef="1"/><joint joint="l" coef="-2"/></fixed>
  <fixed name="lossy" damping="1"><joint joint="j" coef="1"/></fixed></tendon>
  <equality><joint joint1="k" joint2="j" polycoef="0.1 2 0 0 0"/><connect name="pin" body1="a" body2="b" anchor="0.5 0 0.2"/>
  <weld body1="a" body2="c"/><connect site1="s" site2="t"/><weld name="off" body1="a" body2="b" active="false"/></equality>
  <actuator><motor joint="j" gear="-20" ctrlrange="-1 1"/><motor joint="j" forcerange="-3 4"/><position joint="k" kp="10"/>
  <general joint="l" gainprm="5" ctrlrange="-2 1" forcerange="-7 7" gear="2"/></actuator></mujoco>"""


@pytest.mark.parametrize("mimic", ["follow", "independent"])
def test_forces_and_constraints_of_a_compiled_model_are_those_of_its_file(mimic):
    """Actuators, tendons, equality constraints: of both the same efforts, springs, followers and offered loops."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.from_mujoco(mujoco.MjModel.from_xml_string(FORCES), snap=0, mimic=mimic)
    filed = load_quietly(FORCES, snap=0, mimic=mimic)
    assert robot.joint_names == filed.joint_names == (("j", "l") if mimic == "follow" else ("j", "k", "l"))
    np.testing.assert_allclose(robot.limits.effort, filed.limits.effort)
    assert robot.limits.effort[[0, -1]].tolist() == [23.0, 10.0]  # the weaker sides of -23 to 24 and -14 to 10
    for body, other in zip(robot.model.bodies, filed.model.bodies, strict=True):
        assert (body.ratio, body.follows) == (other.ratio, other.follows)
        assert body.offset == pytest.approx(other.offset)
    assert [(s.terms, s.stiffness) for s in robot.model.springs] == [
        (s.terms, s.stiffness) for s in filed.model.springs
    ]
    assert robot.model.springs[0].rest == pytest.approx(filed.model.springs[0].rest)
    assert [c.rows for c in robot.closures.values()] == [c.rows for c in filed.closures.values()]
    assert len(robot.closures) == 3
    q = robot.random_configuration(0)
    for mine, theirs in zip(robot.closures.values(), filed.closures.values(), strict=True):
        between = [
            tw.se3.inverse(r.forward_kinematics(q, c.frame_a)) @ r.forward_kinematics(q, c.frame_b)
            for r, c in ((robot, mine), (filed, theirs))
        ]
        rows = slice(None, 3) if mine.rows.startswith("w") else (slice(None, 3), 3)  # a point has no orientation
        np.testing.assert_allclose(between[0][rows], between[1][rows], atol=1e-9)
    assert any("lossy" in said for said in robot.defects)


def test_what_is_no_compiled_model_is_refused():
    with pytest.raises(tw.ModelError, match=r"not a model of MuJoCo's: object"):
        tw.from_mujoco(object())


@pytest.mark.parametrize(
    ("joint", "words"),
    [
        ('stiffness="3" damping="2"', []),
        ('stiffness="3 0 0" damping="2 0 0"', []),
        ('stiffness="3 1 0"', ["stiffness that is a polynomial"]),
        ('stiffness="3 0 1"', ["stiffness that is a polynomial"]),
        ('damping="2 1"', ["damping that is a polynomial"]),
        ('damping="0 0 1"', ["damping that is a polynomial"]),
    ],
)
def test_springs_and_dampers_beyond_the_linear_term_are_said_to_be_left_out(joint, words):
    robot = load_quietly(hinge_with(joint))
    assert [
        w for w in ("stiffness that is a polynomial", "damping that is a polynomial") if w in str(robot.defects)
    ] == words


def hinge_with(joint="", actuator=""):
    return (
        f'<mujoco><worldbody><body><joint name="j" {joint}/><geom size="0.1" mass="2"/></body></worldbody>'
        f"<actuator>{actuator}</actuator></mujoco>"
    )


@pytest.mark.parametrize("gear", [1.0, -50.0])
def test_data_of_a_dc_motor_follow_from_its_voltage_stall_torque_and_time_constant(gear):
    """R = K U / τ and L = t R; a zero is not given. Friction is that of the rotor, through the gear."""
    data = 'motorconst="0 0.05" nominal="24 1.5 0" inductance="0 0.002" saturation="3 0 0" lugre="100 1 0.1 0.2 5"'
    robot = load_quietly(hinge_with('frictionloss="0.3"', f'<dcmotor joint="j" gear="{gear}" {data}/>'))
    motor, law = robot.actuators["j"].motor, robot.model.friction
    found = (motor.torque_constant, motor.resistance, motor.inductance, motor.voltage)
    np.testing.assert_allclose(found, [0.05, 0.8, 0.0016, 24.0], rtol=1e-12)
    size = abs(gear)
    np.testing.assert_allclose((law.coulomb[0], law.static[0]), (0.3 + 0.1 * size, 0.3 + 0.2 * size), rtol=1e-12)
    np.testing.assert_allclose(law.stribeck[0], 5.0 / size, rtol=1e-12)
    assert "LuGre friction, whose bristles are left out" in str(robot.defects)
    given = load_quietly(hinge_with("", f'<dcmotor joint="j" {data} resistance="3"/>')).actuators["j"].motor
    np.testing.assert_allclose((given.resistance, given.inductance), (3.0, 0.006), rtol=1e-12)
    bare = (
        load_quietly(hinge_with("", '<dcmotor joint="j" motorconst="0.05" saturation="3 0 0"/>')).actuators["j"].motor
    )
    assert (bare.resistance, bare.inductance, bare.voltage) == (0.0, 0.0, np.inf)
