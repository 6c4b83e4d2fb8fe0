"""Identified servos in files: MuJoCo replays the log with the written actuators, and what is not determined is not written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import twistwrench as tw

VALUES = {"armature": [0.5, 0.3], "damping": [4.0, 2.0], "coulomb": [0.6, 0.4], "kp": [120.0, 70.0]}
QUANTUM = 2.0 * np.pi / 2**16
MJCF = """<mujoco model="planar_2r">
  <!-- kept -->
  <worldbody><body name="link1"><joint name="joint1" axis="0 1 0" damping="9"/>
    <inertial pos="0.25 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>
    <body name="link2" pos="0.5 0 0"><joint name="joint2" axis="0 1 0"/>
      <inertial pos="0.2 0 0" mass="1" diaginertia="0.05 0.05 0.05"/></body></body></worldbody>
</mujoco>"""
URDF = """<robot name="planar_2r"><link name="base"/>
<link name="link1"><inertial><origin xyz="0.25 0 0"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="joint1" type="continuous"><parent link="base"/><child link="link1"/><axis xyz="0 1 0"/></joint>
<link name="link2"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link>
<joint name="joint2" type="continuous"><parent link="link1"/><child link="link2"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
</joint></robot>"""
ARM = tw.load(URDF)


@pytest.fixture(scope="module")
def log():
    return tw.identification.simulated_servo_log(ARM, **VALUES, delay=0.01, seconds=6.0, seed=3)


@pytest.fixture(scope="module")
def found(log):
    return tw.identification.identify_servos(ARM, log, hold="zero")


def replayed(path, found, log):
    """Positions by MuJoCo with the file's actuators, commands delayed as the notes say, from the replay's first state."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep = 1e-4
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    data, (servo_log,) = mujoco.MjData(model), found.fit.replay.logs
    data.qpos[:], data.qvel[:] = log.q[0], servo_log.begin_velocity
    q = np.empty_like(log.q)
    per_row = round(0.01 / model.opt.timestep)
    for k in range(len(log) * per_row):
        if k % per_row == 0:
            q[k // per_row] = data.qpos
        row = int(np.searchsorted(log.time, k * model.opt.timestep - found.delay + 1e-9, side="right")) - 1
        data.ctrl[:] = log.command[max(row, 0)]
        mujoco.mj_step(model, data)
    return q


def test_mujoco_replays_the_log_with_the_written_servos(found, log, tmp_path):
    """Within two quanta of the own replay once both have forgotten the first half second."""
    notes = found.write(tmp_path / "arm.xml")
    (own,) = found.fit.replay.positions(found.fit.p[None])
    off = np.abs(replayed(tmp_path / "arm.xml", found, log) - own[0])[50:]
    assert off.max() < 2.0 * QUANTUM
    assert "delay them" in notes[0]


def test_an_mjcf_file_keeps_its_text_and_gets_actuators(found, tmp_path):
    path = tmp_path / "own.xml"
    path.write_text(MJCF)
    own = replace(found, original=tw.load(path))
    own.write(tmp_path / "out.xml")
    text = (tmp_path / "out.xml").read_text()
    assert "<!-- kept -->" in text
    again = tw.load(tmp_path / "out.xml")
    np.testing.assert_allclose(again.armature, found.armature, rtol=1e-12)
    np.testing.assert_allclose(again.model.friction.coulomb, found.coulomb, rtol=1e-12)
    np.testing.assert_array_equal(again.model.friction.viscous, [0.0, 0.0])
    assert f'kp="{found.kp[0]!r}"'.replace("np.float64(", "").replace(")", "") in text


def test_an_actuator_file_has_armature_and_friction(found, tmp_path):
    found.write(actuators=tmp_path / "arm.yaml")
    robot = ARM.with_actuators(tmp_path / "arm.yaml")
    np.testing.assert_allclose(robot.armature, found.armature, rtol=1e-12)
    np.testing.assert_allclose(robot.model.friction.coulomb, found.coulomb, rtol=1e-12)


def test_joints_that_are_not_determined_are_written_by_force_alone(found, tmp_path):
    one = replace(found, live=np.array([True, False]))
    notes = one.write(tmp_path / "one.xml", tmp_path / "one.yaml")
    assert notes[1] == "values of joint2 are not determined, and not written"
    assert 'joint="joint2"' not in (tmp_path / "one.xml").read_text()
    one.write(tmp_path / "both.xml", force=True)
    assert 'joint="joint2"' in (tmp_path / "both.xml").read_text()
    with pytest.raises(tw.ValueRangeError, match="no joint has all values determined"):
        replace(found, live=np.zeros(2, bool)).write(tmp_path / "none.xml", tmp_path / "none.yaml")
    with pytest.raises(tw.ValueRangeError, match=r"does not end in \.xml"):
        found.write(tmp_path / "arm.urdf", tmp_path / "none.yaml")
    assert not list(tmp_path.glob("none.*"))


def test_identify_of_a_log_with_commands_and_no_torques_names_the_way(log, tmp_path):
    with pytest.raises(tw.ShapeError, match="the log has commands: identify_servos identifies gains"):
        tw.identify(ARM, log)
    path = log.to_csv(tmp_path / "log.csv")
    with pytest.raises(tw.TrajectoryError, match="the log has commands: identify_servos identifies gains"):
        tw.identify(ARM, path)
