"""Identified numbers in the text of URDF, MJCF and SDF: what is read again is what was identified, and nothing else changed."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from identification_logs import known_log
from numpy.testing import assert_allclose
from places import SHARED
from quick import mostly_slow

import twistwrench as tw
from twistwrench.identification import identify
from twistwrench.identification.write import _deviations

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

GIVEN = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
SAME = 1e-12
"""Share of the largest torque: numbers are written with all their digits, and turned by rotations at most."""


def written(path, out, *, seed=0, more=None, **given):
    """What was identified of a file, and the file that was written, read as the first was."""
    given = dict(given)
    robot = tw.load(path, inertia="accept", **given)
    found = identify(robot, known_log(robot, seed, seconds=8.0).motion, **GIVEN, **(more or {}))
    notes = found.write(out, force=True)
    return found, tw.load(out, include_paths=[path.parent], inertia="accept", **given), notes


def difference(found, again, *, drives=True, friction=True):
    """Of torques with friction, and with what motors add where the format has a place for it."""
    robot = found.robot if drives else found.robot.with_armature(dict.fromkeys(found.robot.velocity_names, 0.0))
    rng = np.random.default_rng(3)
    q = np.stack([robot.random_configuration(rng) for _ in range(50)])
    dq, ddq = rng.normal(size=(2, 50, robot.nv))
    right, left = (r.inverse_dynamics(q, dq, ddq, friction=friction) for r in (robot, again))
    return np.abs(right - left).max() / np.abs(right).max()


def in_mujoco(path, robot):
    """Largest difference of M, of gravity's torques (as shares of the largest), and of drives, by MuJoCo's own reading."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= sum(
        getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}") for name in ("CONTACT", "EQUALITY", "LIMIT", "SPRING")
    )
    data, M, off = mujoco.MjData(model), np.zeros((model.nv, model.nv)), [0.0]
    joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in robot.velocity_names]
    dofs = [model.jnt_dofadr[j] for j in joints]
    rng = np.random.default_rng(2)
    for _ in range(5):
        q = robot.random_configuration(rng)
        data.qpos[[model.jnt_qposadr[j] for j in joints]] = q
        mujoco.mj_forward(model, data)
        if int(mujoco.__version__.split(".")[0]) < 4:
            mujoco.mj_fullM(model, M, data.qM)
        else:
            mujoco.mj_fullM(model, data, M)
        ours, g = robot.mass_matrix(q), robot.gravity_forces(q)
        off.append(np.abs(M[np.ix_(dofs, dofs)] - ours).max() / np.abs(ours).max())
        off.append(np.abs(data.qfrc_bias[dofs] - g).max() / np.abs(g).max())
    friction = robot.model.friction
    pairs = (
        (model.dof_damping[dofs], friction.viscous),
        (model.dof_frictionloss[dofs], friction.coulomb),
        (model.dof_armature[dofs], robot.model.armature),
    )
    return max(off), max(float(np.abs(a - b).max()) for a, b in pairs)


# ── MJCF ──

ARM = """<mujoco model="arm">
  <compiler {compiler}/>
  <default>{default}</default>
  <worldbody>
    <!-- the stand -->
    <body name="upper" pos="0 0 1" {childclass}>
      <joint name="shoulder" axis="0 1 0" {shoulder}/>
      {inertial}
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1.2"/>
      <body name="lower" pos="0.3 0 0" euler="0 0.2 0">
        {joints}
        <geom type="box" size="0.1 0.02 0.03" pos="0.1 0 0" mass="0.8"/>
        <body name="tool" pos="0.2 0 0"><inertial pos="0 0 0.01" mass="0.05" diaginertia="1e-5 1e-5 2e-5"/></body>
      </body>
    </body>
    <body name="table" pos="2 0 0"><inertial pos="0 0 0" mass="0.02" diaginertia="1e-6 1e-6 1e-6"/>
      <geom type="box" size="1 1 0.1"/></body>
  </worldbody>
  {rest}
</mujoco>
"""
ELBOW = '<joint name="elbow" axis="0 0.6 0.8"/>'
FILLED = {"compiler": "", "default": "", "childclass": "", "shoulder": "", "inertial": "", "joints": ELBOW, "rest": ""}
CASES = {
    "inertias of geoms": {},
    "diagonal, turned": {
        "inertial": '<inertial pos="0.1 0 0" quat="0.9 0.1 0.2 0" mass="1" diaginertia="0.004 0.02 0.021"/>'
    },
    "full": {"inertial": '<inertial pos="0.1 0 0" mass="1" fullinertia="0.004 0.02 0.021 1e-4 -2e-4 3e-4"/>'},
    "euler in radians, fixed axes": {
        "compiler": 'angle="radian" eulerseq="XYZ"',
        "inertial": '<inertial pos="0.1 0 0" euler="0.2 0.3 0.4" mass="1" diaginertia="0.004 0.02 0.021"/>',
    },
    "geoms overrule": {
        "compiler": 'inertiafromgeom="true"',
        "inertial": '<inertial pos="0.1 0 0" mass="5" diaginertia="0.4 0.2 0.21"/>',
    },
    "no geoms": {
        "compiler": 'inertiafromgeom="false"',
        "inertial": '<inertial pos="0.1 0 0" mass="5" diaginertia="0.4 0.2 0.21"/>',
    },
    "total mass": {"compiler": 'settotalmass="3"'},
    "least mass and inertia": {"compiler": 'boundmass="4" boundinertia="0.01"'},
    "balanced": {
        "compiler": 'balanceinertia="true"',
        "inertial": '<inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.2 0.8"/>',
    },
    "within a frame": {
        "joints": f'<frame pos="0.01 0 0.02" euler="10 20 30">{ELBOW}</frame>',
        "compiler": 'autolimits="false"',
    },
    "classes": {
        "default": '<joint damping="0.4" armature="0.02" frictionloss="0.1"/><default class="light"><joint damping="0.1"/></default>',
        "childclass": 'childclass="light"',
        "shoulder": 'armature="0.3"',
    },
    "two joints of a body": {"joints": f'{ELBOW}<joint name="slide" type="slide" axis="1 0 0"/>'},
    "losses of actuators": {
        "rest": '<actuator><motor joint="shoulder" gear="2" armature="0.001" damping="0.002"/></actuator>',
        "shoulder": 'damping="0.05"',
    },
}


@pytest.mark.parametrize("case", mostly_slow(CASES, 6))
def test_mjcf_comes_back(case, tmp_path):
    """Of one file with what the format can do to inertias and to joints, by our reading and by MuJoCo's."""
    path, out = tmp_path / "arm.xml", tmp_path / "new.xml"
    path.write_text(ARM.format(**FILLED | CASES[case]))
    before = tw.load(path, inertia="accept").model
    found, again, _ = written(path, out)
    assert difference(found, again) <= SAME
    off, drives = in_mujoco(out, found.robot)
    assert off <= 1e-9  # MuJoCo finds principal axes to a tolerance of its own
    assert drives <= SAME or case == "losses of actuators"  # which MuJoCo keeps apart from those of joints
    still = [name for name, frame in before.frames.items() if frame.body < 0 and name in before.link_inertias]
    for name in still:  # what no joint moves keeps what <compiler> made of it
        assert np.allclose(
            again.model.link_inertias[name].parameters, before.link_inertias[name].parameters, rtol=SAME, atol=1e-15
        )


def test_a_point_that_boundmass_made_heavy_is_read_by_mujoco(tmp_path):
    """It has 4 kg and no moments, which MuJoCo rejects as fullinertia, even on a body that moves with others."""
    point = '<body name="point"><inertial pos="0.03 0.02 0.01" mass="0" diaginertia="0 0 0"/></body>'
    path, out = tmp_path / "arm.xml", tmp_path / "new.xml"
    path.write_text(ARM.format(**FILLED | {"compiler": 'boundmass="4"', "joints": ELBOW + point}))
    found, again, _ = written(path, out)
    assert '<inertial pos="0.03 0.02 0.01" mass="4.0" diaginertia="0 0 0"/>' in out.read_text()
    assert difference(found, again) <= SAME
    off, _ = in_mujoco(out, found.robot)
    assert off <= 1e-9


def test_only_numbers_change(tmp_path):
    path, out = tmp_path / "arm.xml", tmp_path / "new.xml"
    path.write_text(ARM.format(**FILLED | CASES["full"]))
    written(path, out)
    added = r"<!-- twistwrench identify.*?-->\n? *|<inertial [^>]*/>| (damping|frictionloss|armature)=\"[^\"]*\""

    def kept(file):
        return [line.strip() for line in re.sub(added, "", file.read_text()).splitlines() if line.strip()]

    assert kept(out) == kept(path)
    assert '<inertial pos="0 0 0.01" mass="0.05" diaginertia="1e-5 1e-5 2e-5"/>' in out.read_text()  # the tool


def test_without_motor_inertia_the_file_has_none(tmp_path):
    """The fit has none, so the armature of the file would count twice."""
    path, out = tmp_path / "arm.xml", tmp_path / "new.xml"
    path.write_text(ARM.format(**FILLED | CASES["classes"]))
    found, again, _ = written(path, out, more={"motor_inertia": False})
    assert not again.model.armature.any() and difference(found, again) <= SAME


def test_bodies_of_included_files_are_not_written(tmp_path):
    whole = ARM.format(**FILLED)
    start, end = (
        whole.index('<body name="lower"'),
        whole.index("</body>", whole.index('"tool"')) + len("</body>\n      </body>"),
    )
    (tmp_path / "parts.xml").write_text(f"<mujocoinclude>{whole[start:end]}</mujocoinclude>")
    path = tmp_path / "arm.xml"
    path.write_text(f'{whole[:start]}<include file="parts.xml"/>{whole[end:]}')
    with pytest.raises(tw.ModelError, match=r"stands in the included file 'parts\.xml'"):
        written(path, tmp_path / "new.xml")
    assert not (tmp_path / "new.xml").exists()


def test_a_file_that_names_others_says_where_it_belongs(tmp_path):
    (tmp_path / "colours.xml").write_text("<mujocoinclude><asset/></mujocoinclude>")
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(**FILLED | {"rest": '<include file="colours.xml"/>'}))
    (tmp_path / "elsewhere").mkdir()
    _, _, here = written(path, tmp_path / "new.xml")
    _, _, there = written(path, tmp_path / "elsewhere" / "new.xml")
    assert not any("keep the new one there" in note for note in here)
    assert any("keep the new one there" in note for note in there)


# ── SDF ──

LINK = """<link name="{name}"><pose>{at}</pose>{inertial}</link>
  <joint name="{joint}" type="revolute"><parent>{parent}</parent><child>{name}</child>
    <axis><xyz>0 1 0</xyz>{dynamics}</axis>{more}</joint>"""
TENSOR = "<ixx>0.004</ixx><ixy>1e-4</ixy><ixz>-2e-4</ixz><iyy>0.02</iyy><iyz>3e-4</iyz><izz>0.021</izz>"
WHOLE = f"<mass>1.1</mass><inertia>{TENSOR}</inertia>"
SDF_CASES = {
    "no pose": (f"<inertial>{WHOLE}</inertial>", "", ""),
    "an empty pose": (f"<inertial><pose/>{WHOLE}</inertial>", "<dynamics/>", ""),
    "turned": (
        f"<inertial><pose>0.1 0 0 0.2 0.3 0.4</pose>{WHOLE}</inertial>",
        "<dynamics><damping>0.1</damping></dynamics>",
        "",
    ),
    "in degrees": (f'<inertial><pose degrees="true">0.1 0 0  20 30 40</pose>{WHOLE}</inertial>', "", ""),
    "a quaternion": (
        f'<inertial><pose rotation_format="quat_xyzw">0.1 0 0  0.1 0.2 0.3 0.9</pose>{WHOLE}</inertial>',
        "<dynamics><friction>0.1</friction><damping>0.2</damping></dynamics>",
        "",
    ),
    "an empty quaternion": (f'<inertial><pose rotation_format="quat_xyzw"/>{WHOLE}</inertial>', "", ""),
    "a comment inside": (f"<inertial><pose><!-- 1 2 3 -->0.1 0 0 0.2 0 0</pose>{WHOLE}</inertial>", "", ""),
    "no products": (
        "<inertial><mass>1</mass><inertia><ixx>0.01</ixx><iyy>0.02</iyy><izz>0.02</izz></inertia></inertial>", "", "",
    ),
    "nothing": ("", "", ""),
    "a rotor": (
        f"<inertial>{WHOLE}</inertial>",
        "",
        "<drake:rotor_inertia>1e-5</drake:rotor_inertia><drake:gear_ratio>50</drake:gear_ratio>",
    ),
}  # fmt: skip


def sdf_model(case, name="arm"):
    inertial, dynamics, more = SDF_CASES[case]
    same = {"inertial": inertial, "dynamics": dynamics, "more": more}
    parts = LINK.format(name="upper", joint="shoulder", parent="world", at="0 0 1 0 0 0", **same)
    parts += LINK.format(name="lower", joint="elbow", parent="upper", at="0.3 0 1 0 0.2 0", **same)
    return f'<model name="{name}">{parts}</model>'


@pytest.mark.parametrize("case", mostly_slow(SDF_CASES, 5))
def test_sdf_comes_back(case, tmp_path):
    path, out = tmp_path / "arm.sdf", tmp_path / "new.sdf"
    path.write_text(f'<?xml version="1.0"?>\n<sdf version="1.9"><world name="w">{sdf_model(case)}</world></sdf>')
    found, again, notes = written(path, out)
    rotor = case == "a rotor"
    assert difference(found, again, drives=rotor) <= SAME
    assert any("no place for this motor inertia" in note for note in notes) is not rotor


def test_the_model_meant_is_written_and_no_other(tmp_path):
    path, out = tmp_path / "arms.sdf", tmp_path / "new.sdf"
    path.write_text(f'<sdf version="1.9">{sdf_model("turned", "left")}{sdf_model("turned", "right")}</sdf>')
    found, again, _ = written(path, out, model="right")
    assert difference(found, again, drives=False) <= SAME
    left, before = (tw.load(file, model="left") for file in (out, path))
    assert np.array_equal(left.parameters, before.parameters)


def test_every_link_of_an_sdf_file_keeps_mass(tmp_path):
    """A fixed link heavier than what is found for its body cannot stay: libsdformat refuses a mass that is not positive."""
    tool = (
        '<link name="tool"><pose relative_to="lower">0.1 0 0.1 0 0.4 0</pose><inertial><mass>4</mass><inertia><ixx>0.1</ixx>'
        '<iyy>0.1</iyy><izz>0.1</izz></inertia></inertial></link><link name="mark"/>'
        '<joint name="mount" type="fixed"><parent>lower</parent><child>tool</child></joint>'
        '<joint name="label" type="fixed"><parent>lower</parent><child>mark</child></joint></model>'
    )
    path, out = tmp_path / "arm.sdf", tmp_path / "new.sdf"
    light = sdf_model("turned")
    path.write_text(f'<sdf version="1.9">{light}</sdf>')
    motion = known_log(tw.load(path), 0, seconds=8.0).motion
    path.write_text(f'<sdf version="1.9">{light.replace("</model>", tool)}</sdf>')
    found = identify(tw.load(path), motion, **GIVEN)
    notes = found.write(out, force=True)
    assert any("'tool'" in note or "tool is part of" in note for note in notes)
    again = tw.load(out)
    assert difference(found, again, drives=False) <= SAME
    for name in ("upper", "lower", "tool"):
        G = again.model.link_inertias[name]
        assert G.mass > 0 and not G.defects()


# ── URDF ──


def test_friction_of_joints_that_follow_goes_to_their_leader(tmp_path):
    """A follower's damping counts for its leader: left as it is, it would come on top of what was identified."""
    text = tw.robots.path_of("planar_2r").read_text()
    third = (
        '<link name="link3"><inertial><origin xyz="0.1 0 0"/><mass value="0.3"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" '
        'iyz="0" izz="0.002"/></inertial></link><joint name="joint3" type="revolute"><parent link="link2"/><child link="link3"/>'
        '<origin xyz="0.5 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="9"/>'
        '<mimic joint="joint2" multiplier="-2"/><dynamics damping="0.7" friction="0.4"/></joint></robot>'
    )
    path, out = tmp_path / "arm.urdf", tmp_path / "new.urdf"
    path.write_text(text.replace("</robot>", third))
    found, again, _ = written(path, out)
    assert difference(found, again, drives=False) <= SAME


def test_dynamics_that_lack_a_number_get_it(tmp_path):
    text = tw.robots.path_of("planar_2r").read_text()
    path, out = tmp_path / "arm.urdf", tmp_path / "new.urdf"
    path.write_text(re.sub(r"<dynamics[^>]*/>", "", text).replace("</joint>", '<dynamics damping="0.3"/></joint>'))
    found, again, _ = written(path, out)
    assert difference(found, again, drives=False) <= SAME


def test_a_repaired_robot_is_written_as_repaired(tmp_path):
    """A fixed link that cannot exist is repaired while loading, and keeps that in the new file."""
    text = tw.robots.path_of("planar_2r").read_text()
    tool = (
        '<link name="tool"><inertial><origin xyz="0.1 0 0"/><mass value="0.1"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" '
        'iyz="0" izz="9e-4"/></inertial></link><joint name="mount" type="fixed"><parent link="link2"/><child link="tool"/>'
        "</joint></robot>"
    )
    path, out = tmp_path / "arm.urdf", tmp_path / "new.urdf"
    path.write_text(text.replace("</robot>", tool))
    robot = tw.load(path, inertia="repair")
    found = identify(robot, known_log(robot, 0, seconds=8.0).motion, **GIVEN)
    found.write(out, force=True)
    assert difference(found, tw.load(out), drives=False) <= SAME


# ── real files ──

REAL = [
    "mjcf/dm_control_suite/acrobot.xml", "mjcf/mj_car.xml", "mjcf/brax_prismaversal_3dof_joint.xml",
    "sdf/gzphysics_mimic_pendulum_world.sdf", "two_joint_fixed.urdf",
]  # fmt: skip
SLOW = [
    "mjcf/gym_half_cheetah.xml", "mjcf/dmc_arm_eulerseq.xml", "mjcf/menagerie/franka_emika_panda__panda.xml",
    "mjcf/menagerie/unitree_go1__go1.xml", "mjcf/menagerie/shadow_hand__right_hand_nomesh.xml", "mjcf/mj_humanoid.xml",
    "mjcf/menagerie/robotis_op3__op3_nomesh.xml", "mjcf/unitree/g1_29dof_nomesh.xml", "mjcf/dm_control_suite/manipulator.xml",
    "mjcf/gym_ant.xml", "sdf/bullet_kuka_iiwa_model.sdf", "sdf/drake_planar_gripper.sdf", "sdf/gazebo_cart_soft_suspension.sdf",
    "kinova_gen3_2f85.urdf", "unitree_b2.urdf", "kuka_dual_iiwa14.urdf", "rethink_sawyer.urdf", "quanser_qarm.urdf",
]  # fmt: skip


@pytest.mark.parametrize(
    "name", [*mostly_slow(REAL, 3), *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
def test_files_as_they_are_met_come_back(name, tmp_path):
    path = SHARED / "robots" / name
    if not path.is_file():
        pytest.skip("the shared robots are not here")
    fixed = {"floating_base": False} if path.suffix == ".xml" else {}
    found, again, notes = written(path, tmp_path / f"new{path.suffix}", **fixed)
    lost = any("no place for this Coulomb friction" in note for note in notes)
    assert lost is ('constraint="disable"' in path.read_text("utf-8"))  # which disables frictionloss too
    if lost:
        assert not again.model.friction.coulomb.any()
        assert_allclose(again.model.friction.viscous, found.robot.model.friction.viscous, rtol=SAME)
    assert difference(found, again, drives=Path(name).suffix == ".xml", friction=not lost) <= SAME


def test_what_a_model_lacks_of_identified_drives_is_named_by_kind_and_joint_and_rounding_is_not():
    """Static friction is read as a sum, 0.1 + 0.2, whose last place is not that of 0.3; a value of zero allows no rounding."""
    laws = {"viscous": "0.5 N m s/rad", "coulomb": "0.1 N m", "static": "0.3 N m", "stribeck": "0.1 rad/s"}
    model = tw.robots.planar_2r().with_actuators({"actuators": {"joint1": {"friction": laws}}}).model
    same = {
        "viscous": {"joint1": 0.5, "joint2": 0.0},
        "coulomb": {"joint1": 0.1, "joint2": 0.0},
        "stribeck": {"joint1": 0.2, "joint2": 0.0},
        "motor_inertia": dict(zip(model.velocity_names, model.armature.tolist(), strict=True)),
    }
    assert (model.friction.static - model.friction.coulomb)[0] != 0.2
    assert _deviations(model, same) == {}
    for kind, values in same.items():
        for joint, value in values.items():
            found = _deviations(model, same | {kind: values | {joint: value + 0.25}})
            assert list(found) == [kind] and list(found[kind]) == [joint]
            assert_allclose(found[kind][joint], -0.25)
    assert _deviations(model, {"viscous": {"joint1": 0.5, "joint3": 0.75}}) == {"viscous": {"joint3": -0.75}}
