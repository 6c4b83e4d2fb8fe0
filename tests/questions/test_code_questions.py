"""Code, batches and other programs.

Pages: [Export](export.md), [bridges](bridges.md), [quantities](quantities.md), [rerun and Foxglove](viewer.md#rerun-and-foxglove).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytest import approx

import twistwrench as tw


def test_code_for_forward_dynamics():
    """How do I generate C code for forward dynamics and kinematics?

    `robot.export_c`, or `twistwrench export ROBOT --c DIR --quantity …`. C99 without allocation, with a test program.

    Source: SymPyBotics#38, SymPyBotics#14, SymPyBotics#9.
    Number: the sizes of the arm, 6 joints and a pose of 16 entries.
    """
    header, *_ = tw.robots.ur5().export_c(["forward_dynamics", "forward_kinematics"], "arm.c", prefix="arm")
    declared = [line for line in header.read_text().splitlines() if line.startswith("void")]
    print(*declared, sep="\n")
    assert "double ddq[6]" in declared[0]
    assert "double T[16]" in declared[1]


def test_ros2_plugin(shell):
    """How do I use the dynamics as a ROS 2 plug-in?

    `twistwrench export ROBOT --ros2 DIR` writes a package of a library with the robot's dynamics. It has been compiled, not run under ROS.

    Source: ros2_controllers#1956, ros2_controllers#1651, inverse-dynamics-solver#17.
    Number: the files of a package of ament_cmake.
    """
    shell("twistwrench export planar_2r --ros2 my_dynamics")
    assert {path.name for path in Path("my_dynamics").iterdir()} >= {"package.xml", "CMakeLists.txt"}


def test_screws_in_cpp():
    """How do I compute kinematics in C++ from a URDF file?

    `twistwrench export ROBOT --c DIR --quantity forward_kinematics --quantity jacobian`; C++ can include the header.

    Source: ModernRoboticsCpp#28.
    Number: the size of a Jacobian, 6 × 6 entries.
    """
    header, *_ = tw.robots.ur5().export_c([("jacobian", {"kind": "space"})], "arm.c", prefix="arm")
    declared = next(line for line in header.read_text().splitlines() if line.startswith("void"))
    print(declared, 'extern "C"' in header.read_text())
    assert "double J[36]" in declared
    assert 'extern "C"' in header.read_text()


def test_batches():
    """How do I evaluate M, c and g for a batch of states?

    All methods take any leading batch shape, in compiled code on the processor.

    Source: adam#142, ManiSkill#1186.
    Number: the matrix of each state by itself.
    """
    panda = tw.robots.panda()
    q = panda.random_configuration(rng=0, size=4096)
    M = panda.mass_matrix(q)
    print(M.shape, panda.gravity_forces(q).shape)
    assert M[17] == approx(panda.mass_matrix(q[17]))


def test_batch_of_robots_that_differ():
    """How do I evaluate a batch of robots that differ, and is M of a fixed base 12 × 12?

    Parameters may be inputs of a kernel, with a row for each robot. M of a fixed base has a row for each joint.

    Source: thunder_dynamics#52, adam#77.
    Number: gravity torques by hand, (m₁ L₁ + m₂ (L₁ + L₂)) g.
    """
    arm = tw.robots.planar_2r()
    g = arm.kernel("gravity_forces", parameters=("link2.mass",))
    masses = np.array([1.0, 2.0, 5.0])
    tau = g(np.zeros(2), masses[:, None])
    print(tau[:, 0], arm.mass_matrix([0, 0]).shape)
    assert tau[:, 0] == approx(9.81 * (1 + 2 * masses))


def test_rerun_and_foxglove(shell):
    """How do I show a motion in rerun or Foxglove?

    `--mcap OUT.mcap` and `--rerun OUT.rrd` of `twistwrench torques`: the robot, the motion, torques, limits and the verdict.

    Source: rerun-loader-urdf#4, dimos#845, lerobot#3982, lerobot#1375.
    Number: the first bytes of an MCAP file by its specification.
    """
    pytest.importorskip("mcap")
    shell("twistwrench torques ur5 --trajectory demo --payload 5 --mcap out.mcap")
    assert Path("out.mcap").read_bytes()[:8] == b"\x89MCAP0\r\n"


def test_fall_as_csv():
    """How do I write the fall of an arm to a CSV file, for CoppeliaSim?

    `robot.simulate(…).to_csv`; in the shell `twistwrench simulate ur5 --duration 3 --csv fall.csv`.

    Source: project of course 3 of the specialisation Modern Robotics.
    Number: the energy of the fall, which stays the same without friction.
    """
    fall = tw.robots.ur5().simulate(duration=1.0, dt=0.01)
    fall.to_csv("fall.csv")
    print(f"energy within {np.ptp(fall.energy):.0e} J")
    assert np.ptp(fall.energy) < 1e-4
