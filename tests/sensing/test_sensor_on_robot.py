"""Sensor logs with joint positions in place of orientations: forward kinematics, units, both at once, missing joints."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench import sensing
from twistwrench.cli.main import main

ARM = tw.robots.ur5()
RNG = np.random.default_rng(0)
Q = RNG.uniform(-2.0, 2.0, (14, 6))
TOOL = sensing.ForceTorqueSensor(tw.SpatialInertia.from_com(2.5, (0.01, 0.0, 0.08)), bias=[0.1, 0, 0, 3, -2, 1])
ROTATIONS = ARM.forward_kinematics(Q)[:, :3, :3]
LOG = sensing.ReadingLog.from_arrays(
    TOOL.predict(ROTATIONS) + RNG.normal(0.0, 1.0, (14, 6)) * [0.002] * 1, pose=ROTATIONS
)


def written(path, columns):
    np.savetxt(
        path, np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments="", fmt="%.17g"
    )
    return path


def columns(names, factor=1.0):
    readings = dict(zip(("mx", "my", "mz", "fx", "fy", "fz"), LOG.readings.T, strict=True))
    return readings | {name: factor * x for name, x in zip(names, Q.T, strict=True)}


@pytest.mark.parametrize(
    ("names", "factor", "degrees"),
    [
        (ARM.joint_names, 1.0, False),
        ([f"{name} [deg]" for name in ARM.joint_names], np.degrees(1.0), False),
        ([f"actual_q_{k}" for k in range(6)], np.degrees(1.0), True),
    ],
)
def test_joint_positions_give_the_orientations(names, factor, degrees, tmp_path):
    log = sensing.read_log(written(tmp_path / "log.csv", columns(names, factor)), robot=ARM, degrees=degrees)
    np.testing.assert_allclose(log.gravity, LOG.gravity, atol=1e-9)
    assert log.notes == ()
    found = sensing.identify(log)
    assert abs(found.sensor.load.mass - 2.5) < 0.01


def test_the_frame_of_the_sensor_may_be_another_one_than_the_tip(tmp_path):
    path = written(tmp_path / "log.csv", columns(ARM.joint_names))
    log = sensing.read_log(path, robot=ARM, frame="forearm_link")
    np.testing.assert_allclose(log.rotations, ARM.forward_kinematics(Q, "forearm_link")[:, :3, :3], atol=1e-12)


@pytest.mark.parametrize(("degrees", "kinds"), [(1.0, []), (5.0, ["sensor-kinematics"])])
def test_logged_orientations_count_and_a_difference_above_two_degrees_is_a_doubt(degrees, kinds, tmp_path):
    turned = ROTATIONS @ tw.so3.exp(np.radians([degrees, 0.0, 0.0]))
    matrix = {f"r{i + 1}{j + 1}": turned[:, i, j] for i in range(3) for j in range(3)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        log = sensing.read_log(written(tmp_path / "log.csv", columns(ARM.joint_names) | matrix), robot=ARM)
    np.testing.assert_allclose(log.rotations, turned, atol=1e-12)
    assert [one.kind for one in log.doubts()] == kinds


def test_a_log_without_orientations_or_without_a_joint_is_one_error(tmp_path):
    path = written(tmp_path / "log.csv", columns(ARM.joint_names))
    with pytest.raises(tw.ValueRangeError, match="or joint positions, and the robot: robot="):
        sensing.read_log(path)
    fewer = {name: x for name, x in columns(ARM.joint_names).items() if name != "elbow_joint"}
    with pytest.raises(tw.TrajectoryError, match="no column for elbow_joint"):
        sensing.read_log(written(tmp_path / "fewer.csv", fewer), robot=ARM)


def test_the_command_takes_the_robot(tmp_path):
    path = written(tmp_path / "log.csv", columns([f"actual_q_{k}" for k in range(6)], np.degrees(1.0)))
    said = CliRunner().invoke(main, ["sensor", "identify", str(path), "--robot", "ur5", "--degrees"])
    assert said.exit_code == 0 and said.output.startswith("OK: 2.5"), said.output
    alone = CliRunner().invoke(main, ["sensor", "identify", str(path), "--degrees"])
    assert alone.exit_code == 2 and "--robot ROBOT" in alone.output
