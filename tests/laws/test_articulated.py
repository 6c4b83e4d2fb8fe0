"""Articulated bodies against M q̈ = τ - h, and the choice between the two by counting."""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import TREES, tree

import twistwrench as tw
from twistwrench.compiler.ir.tracer import trace
from twistwrench.mechanics.algorithms.forward_dynamics import articulated_dynamics, articulated_pays
from twistwrench.mechanics.algorithms.inverse_dynamics import bias_forces
from twistwrench.mechanics.algorithms.mass_matrix import ldl_factors, mass_matrix, solve_ldl
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.parameters import regrouped
from twistwrench.testing import assert_close, random_state


def chain(n):
    builder = ModelBuilder(f"chain{n}")
    builder.add_link("link0")
    step = np.eye(4)
    step[0, 3] = 0.3
    for i in range(n):
        builder.add_link(f"link{i + 1}", tw.SpatialInertia.from_com(1.0, (0.1, 0.02, 0.03), 0.01 * np.eye(3)))
        builder.add_joint(
            f"joint{i + 1}", "revolute", f"link{i}", f"link{i + 1}", axis=np.eye(3)[i % 3], placement=step
        )
    return tw.Robot(builder.build())


@pytest.mark.parametrize("name", [n for n in TREES if not any(b.follows for b in tree(n).model.bodies)])
def test_it_solves_the_equation_of_motion(name):
    """Compared as torques: light fingers make M⁻¹ large, and rounding through it."""
    robot = tree(name)
    q, dq, ddq = random_state(robot, np.random.default_rng(1))
    F = {robot.frame_names[-1]: np.arange(1.0, 7.0)}
    tau = robot.reference("inverse_dynamics", q, dq, ddq, *F.values(), wrenches=tuple(F))
    found = articulated_dynamics(robot.model, q.astype(object), dq.astype(object), tau.astype(object), F).astype(float)
    M = robot.reference("mass_matrix", q)
    assert_close(M @ found, M @ ddq, 1e-13 * np.linalg.cond(M) * robot.nv, "M q̈", scale=np.abs(M * ddq).max())


def test_inertia_on_top_comes_beside_that_of_drives():
    """As damping of a semi-implicit step does: (M + A) q̈ = τ - h, the armature in M."""
    robot = chain(4)
    robot = robot.with_armature(dict(zip(robot.joint_names, (0.1, 0.2, 0.3, 0.4), strict=True)))
    q, dq, tau = (x.astype(object) for x in np.random.default_rng(3).standard_normal((3, 4)))
    more = np.array([0.5, 0.0, 0.7, 0.2])
    found = articulated_dynamics(robot.model, q, dq, tau, added=more).astype(float)
    q, dq, tau = (x.astype(float) for x in (q, dq, tau))
    wanted = np.linalg.solve(robot.mass_matrix(q) + np.diag(more), tau - robot.bias_forces(q, dq))
    assert_close(found, wanted, 1e-11, "q̈")


def counted(robot):
    """Multiplications by articulated bodies, and by M and its factors."""
    model = regrouped(robot.model)
    inputs = [("q", (robot.nq,)), ("dq", (robot.nv,)), ("tau", (robot.nv,))]

    def by_mass_matrix(q, dq, tau):
        return solve_ldl(*ldl_factors(mass_matrix(model, q)), tau - bias_forces(model, q, dq))

    programs = (lambda q, dq, tau: articulated_dynamics(model, q, dq, tau)), by_mass_matrix
    return [trace(p, inputs, ["ddq"]).multiplications for p in programs]


@pytest.mark.parametrize(
    "make", [tw.robots.panda, tw.robots.quadruped, lambda: chain(10), lambda: chain(20), lambda: chain(30)]
)
def test_the_cheaper_of_the_two_is_chosen(make):
    robot = make()
    articulated, by_mass_matrix = counted(robot)
    assert articulated_pays(robot.model) == (articulated < by_mass_matrix)
    assert robot.program("forward_dynamics").multiplications == min(articulated, by_mass_matrix)


def test_joints_that_share_a_coordinate_go_by_the_mass_matrix():
    gears = {"actuators": {f"joint{i + 1}": {"ratio": 50, "rotor": {"inertia": "1 g cm^2"}} for i in range(20)}}
    assert articulated_pays(chain(20).model)
    assert not articulated_pays(chain(20).with_actuators(gears).model)


def test_work_grows_with_the_number_of_bodies():
    small, large = (chain(n).program("forward_dynamics").multiplications for n in (40, 80))
    assert large < 2.05 * small
