"""Motions, timing and limits.

Pages: [The fastest timing](trajectories.md#the-fastest-timing), [limits of jerk](trajectories.md#limits-of-jerk), [torques of a motion](torques.md),
[plans of MoveIt](logs.md#files-of-other-programs-ros-bags-lerobot-robot-controllers), [simulation](simulation.md).
"""

from __future__ import annotations

import numpy as np
from pytest import approx

import twistwrench as tw


def test_fastest_timing_with_friction():
    """How do I time a path under torque limits, with friction?

    `trajectories.fastest(robot, path, friction=True)`; in the shell `twistwrench move … --fastest`. A mass of 1 kg at 1 m turns by
    2 rad, driven by 8 N m against 2 N m of friction:

    Source: toppra#236.
    Number: the double integrator with 6 rad/s² up and 10 rad/s² down, √(2 d (1/6 + 1/10)).
    """
    drive = {"actuators": {"hinge": {"ratio": "1", "friction": {"coulomb": "2 N m"}}}}
    mass = tw.robots.pendulum().with_gravity([0, 0, 0]).with_actuators(drive)
    path = tw.trajectories.joint_line(mass, [0], [2.0])
    quick = tw.trajectories.fastest(mass, path, effort=8.0, friction=True)
    print(f"{quick.duration:.4f} s")
    assert quick.duration == approx((2 * 2.0 * (1 / 6 + 1 / 10)) ** 0.5, rel=1e-6)


def test_limits_between_grid_points():
    """Are limits kept between the grid points?

    Yes. The active limit is solved by collocation, without a grid of constraints, and holds at any time.

    Source: toppra#41, toppra#56.
    Number: the share of the most used limit, which is 1 at every instant of the fastest motion.
    """
    ur5 = tw.robots.ur5()
    home, there = np.array([-0.5, -1.9, 1.9, -0.3, 1.5, 0]), np.array([0.9, -0.9, 1.0, -0.4, 1.2, 1.0])
    quick = tw.trajectories.fastest(ur5, tw.trajectories.joint_line(ur5, home, there))
    shares = quick.shares(np.random.default_rng(0).uniform(0, quick.duration, 5000))
    print(
        f"{quick.duration:.3f} s; between {shares.min():.6f} and {shares.max():.6f} of the active limit at 5000 random times"
    )
    assert np.abs(shares - 1).max() < 1e-6


def test_limits_of_jerk():
    """How do I limit jerk?

    `jerk=` of `trajectories.fastest`, `--jerk` in the shell, or `<limit jerk="…">` in the robot file.

    Source: toppra#133.
    Number: the shortest time from rest to rest with bounded jerk alone, ∛(32 d / j).
    """
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    path = tw.trajectories.joint_line(mass, [0], [2.0])
    gentle = tw.trajectories.fastest(mass, path, effort=1000.0, jerk=8.0)
    t = np.linspace(0, gentle.duration, 10_000)
    print(f"{gentle.duration:.3f} s with at most {np.abs(gentle.jerk(t)).max():.2f} rad/s³")
    assert 2.0 <= gentle.duration < 1.03 * (32 * 2.0 / 8.0) ** (1 / 3)
    assert np.abs(gentle.jerk(t)).max() <= 8 * (1 + 1e-6)


def test_plan_within_torque_limits():
    """Does my plan respect the torque limits of the arm?

    `twistwrench torques ROBOT --trajectory plan.mcap`, for `JointTrajectory`, `RobotTrajectory` and `DisplayTrajectory` messages too. In
    Python the points of a plan, executed as ros2_controllers does:

    Source: moveit#3412, moveit#3670, kuka_experimental#89.
    Number: 5 kg m² · q̈ + 29.43 N m · cos q of two stretched links, for the quintic that joins the points.
    """
    from twistwrench.motion import between_points

    arm = tw.robots.planar_2r()
    points, rest = np.array([[-np.pi / 2, 0.0], [1 - np.pi / 2, 0.0]]), np.zeros((2, 2))
    rows = between_points(np.array([0.0, 1.0]), points, rest, rest, 2e-3)
    plan = tw.Motion(rows[:, 0], *np.split(rows[:, 1:], 3, axis=1), robot=arm)
    answer = tw.check(arm, plan, limits={"effort": np.array([20.0, 10.0])}, plan=True)
    print(answer.headline)
    s = np.linspace(0, 1, 100_001)
    ddq, q = 60 * s - 180 * s**2 + 120 * s**3, -np.pi / 2 + 10 * s**3 - 15 * s**4 + 6 * s**5
    assert answer.joints["joint1"].peak == approx(np.max(5 * ddq + 29.43 * np.cos(q)), rel=1e-4)


def test_stopping_time():
    """How far does the arm move until it stands still?

    Slow down all joints together and take the shortest time whose torques keep the limits.

    Source: gbr#185, RoboCup RuleBook#1058, manuals of UR and Doosan.
    Number: one mass without gravity, I ω / τ = 1 kg m² · 2 rad/s / 8 N m.
    """

    def stop(robot, q, dq, effort):
        """Stopping time [s], and the angles [rad] that the joints turn meanwhile."""
        T, s = np.linspace(0.01, 2, 400)[:, None, None], np.linspace(0, 1, 50)[:, None]
        tau = robot.inverse_dynamics(q + dq * T * (s - s**2 / 2), dq * (1 - s), -dq / T)
        time = T[(np.abs(tau) <= effort).all(axis=(1, 2)).argmax()].item()
        return time, dq * time / 2

    ur5 = tw.robots.ur5()
    print(stop(ur5, np.zeros(6), np.array([0, 2.0, 1.0, 0, 0, 0]), ur5.limits.effort))
    time, turned = stop(tw.robots.pendulum().with_gravity([0, 0, 0]), np.zeros(1), np.array([2.0]), 8.0)
    assert time == approx(0.25, abs=0.01)
    assert turned == approx([0.25], abs=0.01)


def test_energy_of_a_motion():
    """What energy and power does a motion need?

    Power of the joints is τ · q̇, and `viz.energies` has its work. `twistwrench size` adds the losses of motors and the peak of the
    supply.

    Source: maniskill#144, kortex2#108, openarm#229.
    Number: m g h for a mass of 1 kg that is raised by 1 m and is at rest again.
    """
    mass = tw.robots.pendulum()
    path = tw.trajectories.joint_line(mass, [0], [np.pi / 2])
    motion = tw.trajectories.Trajectory(mass, path, tw.trajectories.quintic(1.0)).sample(0.001)
    energy = tw.viz.energies(tw.viz.motion_of(mass, motion))
    power = np.sum(motion.torques() * motion.dq, axis=1)
    print(f"{energy.work[-1]:.2f} J, at most {power.max():.1f} W")
    assert energy.work[-1] == approx(9.81, abs=1e-3)
    hasty = tw.trajectories.Trajectory(mass, path, tw.trajectories.quintic(0.5)).sample(0.001)
    energy = tw.viz.energies(tw.viz.motion_of(mass, hasty))  # the joint brakes, and gets back what it had put in
    assert energy.work.max() > 10.0
    assert energy.work[-1] == approx(9.81, abs=1e-3)


def test_joint_forces_of_a_motion():
    """What load do the bearings carry over a motion?

    `robot.joint_wrenches(q, dq, ddq)` for any number of rows: moment and force at each joint, in the frame of its link.

    Source: raisim#3, PredSim#189, drake#11723.
    Number: a mass on a circle: m (g + L ω²) at the bottom.
    """
    mass = tw.robots.pendulum()
    F = mass.joint_wrenches([[0.0], [0.0]], [[0.0], [3.0]], np.zeros((2, 1)))
    print(F[:, 0, 3:])
    assert F[:, 0, 5] == approx([9.81, 9.81 + 3.0**2])


def test_six_components_in_every_joint():
    """How do I get all six components of force in every joint?

    `robot.joint_wrenches(q, dq, ddq)` has a row (m, f) for each moving link, and the torque of the motor is one of its components.

    Source: pymanoid#25, idyntree#853.
    Number: the torques of `inverse_dynamics`, which are the components along the axes.
    """
    panda = tw.robots.panda()
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, panda.nv))
    F = panda.joint_wrenches(q, dq, ddq)
    print(F.shape, F[0].round(2))
    assert F[:7, 2] == approx(panda.inverse_dynamics(q, dq, ddq)[:7])


def test_simulate_own_torque():
    """How do I simulate with my own torque law?

    `tau=` of `robot.simulate` is evaluated at every stage of the integrator, `controller=` once per step.

    Source: RigidBodyDynamics.jl#341.
    Number: a damped oscillator, e^(−ζωt) (cos ω_d t + ζω/ω_d sin ω_d t) with 1 kg m², 20 N m/rad and 2 N m s/rad.
    """
    mass = tw.robots.pendulum().with_gravity([0, 0, 0])
    run = mass.simulate([1.0], duration=2.0, dt=0.01, tau=lambda t, q, dq: -20.0 * q - 2.0 * dq)
    print(f"{run.q[-1, 0]:.6f} rad")
    w = np.sqrt(20 - 1)
    assert run.q[-1, 0] == approx(np.exp(-2.0) * (np.cos(2 * w) + np.sin(2 * w) / w), abs=1e-7)


def test_swing_of_n_links():
    """How do I step an arm of n links in time, with friction?

    `robot.simulate(…, friction=True)` for one motion, `robot.rollout` for many.

    Source: dynamics_step, an exercise at Columbia University.
    Number: the balance of energy: friction has taken what is missing.
    """
    joint = {"ratio": "1", "friction": {"viscous": "0.5 N m s/rad"}}
    arm = tw.robots.planar_3r()
    arm = arm.with_actuators({"actuators": dict.fromkeys(arm.joint_names, joint)})
    run = arm.simulate([0.5, 0.3, -0.2], duration=2.0, dt=0.001, friction=True)
    lost = np.trapezoid(0.5 * np.sum(run.dq**2, axis=1), run.times)
    print(f"energy {run.energy[0]:.3f} J, after 2 s {run.energy[-1]:.3f} J; friction took {lost:.3f} J")
    assert run.energy[0] - run.energy[-1] == approx(lost, rel=1e-4)
