"""A planner passes its own judges: no motion planned within limits is over one, by its own check or by ``torques``."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.verdict import Word
from twistwrench.mechanics.model.couplings import Coupling, with_couplings
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import LoadCase, Payload
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.torque_analysis import analyse
from twistwrench.trajectories import bounds_of, fastest, fitted, joint_line, spline

PLANNERS = ("fastest", "jerk", "quintic", "cubic", "trapezoid", "s-curve")
MOTIONS = 44
"""Motions of one robot in the long form; 23 robots make 1,012."""


def loaded_robot(seed):
    """An arm with random Coulomb and viscous friction, a payload, and on every other one a coupled wrist."""
    rng = np.random.default_rng(seed)
    robot = (tw.robots.ur5, tw.robots.planar_3r)[seed % 3 == 2]()
    if seed % 2:
        one, two = robot.joint_names[-2:]
        A = np.array([[1.0, rng.uniform(0.3, 1.0)], [1.0, -rng.uniform(0.3, 1.0)]])
        model = with_couplings(robot.model, [Coupling("wrist", ("m1", "m2"), (one, two), A)])
        robot = tw.Robot(model)
    size = np.where(np.isfinite(robot.limits.effort), robot.limits.effort, 60.0)
    dry, wet = rng.uniform(0.02, 0.15, robot.nv) * size, rng.uniform(0.0, 0.05, robot.nv) * size
    model = robot.model
    friction = replace(model.friction, coulomb=dry, static=dry, viscous=wet)
    limits = replace(model.limits, effort=size, velocity=np.minimum(model.limits.velocity, 4.0))
    return tw.Robot(replace(model, friction=friction, limits=limits)), float(rng.uniform(0.0, 1.5))


def planned(robot, rng, planner):
    """A motion between random poses near the robot's own weight limits, or None if it cannot hold itself there."""
    middle = np.where(np.arange(robot.nv) == 1, -1.4, rng.uniform(-1, 1, robot.nv))
    poses = middle + rng.uniform(-0.6, 0.6, (3, robot.nv))
    path = (
        spline(robot, poses)
        if rng.random() < 0.3 and planner in ("fastest", "quintic")
        else joint_line(robot, *poses[:2])
    )
    acceleration, jerk = (15.0, 400.0) if planner in ("jerk", "s-curve") else (np.inf, np.inf)
    bounds = bounds_of(robot, acceleration=acceleration, jerk=jerk)
    try:
        if planner in ("fastest", "jerk"):
            kinds = ("velocity", "effort", "acceleration", "jerk")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return fastest(robot, path, friction=True, **{kind: getattr(bounds, kind) for kind in kinds}), bounds
        shapes = {"quintic": tw.trajectories.quintic(1.0), "cubic": tw.trajectories.cubic(1.0)}
        shapes |= {"trapezoid": tw.trajectories.trapezoid(v=1.5, duration=1.0), "s-curve": tw.trajectories.s_curve(1.0)}
        scaling = fitted(robot, path, shapes[planner], bounds, friction=True)
        return tw.trajectories.Trajectory(robot, path, scaling, friction=True), bounds
    except tw.PathError:
        return None


def judged(seed, count, folder):
    """Verdicts of both judges on the motions of one robot."""
    bare, mass = loaded_robot(seed)
    load = LoadCase(bare, (Payload(mass),), {}, friction=True)
    robot, rng, found = load.with_load, np.random.default_rng(1000 + seed), []
    for k in range(count):
        planner = PLANNERS[int(rng.integers(len(PLANNERS)))] if k else "fastest"
        if (made := planned(robot, rng, planner)) is None:
            continue
        moving, bounds = made
        own = [v for v in moving.violations(bounds) if v.kind != "position"]
        sampled = [v for v in moving.sample(0.004).violations(bounds) if v.kind not in ("position", "jerk")]
        log = MotionLog.open(moving.to_csv(folder / "plan.csv", 0.004), bare.model)
        report = analyse(load, Differentiation.plan(log, bare.model), bare.limits)
        over = [e for e in report.excesses if e.kind in ("effort", "velocity")]
        found.append((planner, own, sampled, over if report.verdict.word is Word.OVER_LIMIT else []))
    return found


@pytest.mark.parametrize(
    "seed", [1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(23) if seed not in (1, 2))]
)
def test_a_planned_motion_is_within_its_limits_for_every_judge(seed, tmp_path, request):
    """By ``violations`` of plan and samples, and by ``torques`` of the written file, with friction, couplings and payload."""
    long = request.node.get_closest_marker("slow") is not None
    count = MOTIONS if long else 5
    found = judged(seed, count, tmp_path)
    assert len(found) > count // 2
    bad = [one for one in found if any(one[1:])]
    assert not bad, bad[:3]


def test_a_plan_remembers_the_friction_it_was_made_with():
    """Without an argument, its check counts the friction of the plan; friction left out is also on request."""
    robot, _ = loaded_robot(2)
    path = joint_line(robot, [0.1, 0.2, 0.3], [0.9, -0.5, 0.6])
    moving = fastest(robot, path, friction=True)
    assert moving.violations() == moving.violations(friction=True) == moving.sample(0.002).violations() == ()
    plain = fastest(robot, path)
    assert plain.violations() == ()
    assert plain.violations(friction=True)
    assert moving.sample(0.1).friction and not plain.sample(0.1).friction
