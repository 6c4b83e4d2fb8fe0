"""What users write, for mypy to check: options are seen, words are words, results have their types."""

from __future__ import annotations

from typing import TYPE_CHECKING, assert_type

import numpy as np

import twistwrench as tw
from twistwrench import trajectories
from twistwrench.mechanics.algorithms.constraints import ConstrainedMotion, ConstrainedTorques
from twistwrench.simulation import ClosedSimulation, SimulationBatch, SimulationResult
from twistwrench.simulation.closed import ClosedRollout
from twistwrench.simulation.rollout import Rollout

if TYPE_CHECKING:  # mypy reads what stands below; nobody runs it
    robot = tw.load("robot.urdf", floating_base=True, mimic="independent", inertia="repair")
    bundled = tw.robots.ur5(tip="tool0", gravity=[0.0, 0.0, -1.62])
    planar = tw.from_dh({"a": [1.0, 1.0]}, convention="modified", masses=[1.0, 1.0])
    q = [0.0] * 6

    tau = bundled.inverse_dynamics(q, q, q, wrench_on_robot={"tool0": [0, 0, 0, 0, 0, 1.0]}, friction=True)
    tau[0] += 1.0
    J = bundled.jacobian(q, "tool0", kind="world_aligned")
    carried, rotor = bundled.drive_torques(q, q, q)
    kernel = bundled.kernel("jacobian", frame="tool0", kind="space")
    slopes = bundled.kernel("inverse_dynamics", by=("q", "dq"), form="jacobian", friction=True)

    found = bundled.simulate(q, duration=1.0, method="rk4", friction=True, limits="stop")
    assert_type(found, SimulationResult)
    assert_type(bundled.simulate_batch([q, q], friction=True, method="rk4"), SimulationBatch)
    held = bundled.close("ground", "tool0").constrain("forearm_link", "vx")
    assert_type(held.simulate(q, method="rk4"), ClosedSimulation)
    assert_type(held.rollout(q, q, steps=10), ClosedRollout)
    assert_type(held.forward_dynamics(q, q, q), ConstrainedMotion)
    assert_type(held.holding_torques(q, ["wrist_1_joint"]), ConstrainedTorques)
    opened: tw.Robot = held.open()
    wrong_method = held.simulate(q, method="variational")  # type: ignore[arg-type]
    many = bundled.rollout([q, q], q, steps=10, method="rk4", torque_limits=True)
    assert_type(many, Rollout)
    motion: tw.Motion = found.motion
    worst = motion.violations()[0]
    text: str = f"{worst.joint} {worst.kind} {worst.by:.3g}"
    moving = trajectories.move(bundled, q, q).sample(0.01)
    assert_type(moving, tw.Motion)
    reached = bundled.inverse_kinematics(np.eye(4), rows="vx vy vz", restarts=3)

    lost: list[str] = tw.save(bundled, tw.find("ur5"), overwrite=True)
    joined = bundled.attach(planar, "tool0", np.eye(4), prefix="hand_")
    assert_type(joined.chain("tool0").to_urdf(), str)

    V = tw.Twist([0, 0, 1, 0, 0, 0], "tool0")
    F = tw.Wrench([0, 0, 0, 0, 0, 1.0], "tool0")
    power = F @ V
    wrong_kind = bundled.jacobian(q, kind="bodily")  # type: ignore[arg-type]
    wrong_option = bundled.simulate(q, timestep=1e-3)  # type: ignore[call-arg]
    wrong_batch_option = bundled.simulate_batch([q, q], timestep=1e-3)  # type: ignore[call-arg]
    wrong_kernel = bundled.kernel("jacobian", framee="tool0")  # type: ignore[call-arg]
    wrong_load = tw.robots.panda(floating=True)  # type: ignore[call-arg]

    skew = tw.modern_robotics.VecToso3(omg=[1.0, 2.0, 3.0])
    torques = tw.modern_robotics.InverseDynamics(q, q, q, [0, 0, -9.81], np.zeros(6), [], [], skew)
    torques[0] += 1.0
    wrong_name = tw.modern_robotics.VecToso3(w=[1.0, 2.0, 3.0])  # type: ignore[call-arg]
    too_few = tw.modern_robotics.GravityForces(q, [0, 0, -9.81])  # type: ignore[call-arg]
