"""Rollouts of closed robots: the steps of simulations, many at a time, their drift, and motions that lose their constraints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import GROUND, closed_platform, four_bar

import twistwrench as tw
from twistwrench.mechanics.model.limits import Friction


@pytest.fixture(scope="module")
def linkage():
    return four_bar().close("rocker_pin", "coupler_pin", "vx vz")


@pytest.fixture(scope="module")
def starts(linkage):
    q = linkage.consistent([[0.0, 0.8, 1.6], [0.3, 0.4, 1.2], [-0.5, 1.2, 1.5]], within=np.inf)
    return q, linkage.project_velocity(q, [6.0, 0.0, 0.0])


@pytest.mark.parametrize("method", ["rk4", "semi_implicit"])
def test_a_rollout_is_its_simulations(linkage, starts, method):
    tau = [0.5, 0.0, -0.2]
    many = linkage.rollout(*starts, tau, duration=0.5, method=method, every=5)
    for k, (q, dq) in enumerate(zip(*starts, strict=True)):
        one = linkage.simulate(q, dq, duration=0.5, tau=tau, method=method, every=5)
        assert np.abs(many.q[k] - one.q).max() < 1e-12 and np.abs(many.dq[k] - one.dq).max() < 1e-10
        assert np.isclose(many.gap_before[k], one.gap_before, rtol=1e-3)
        assert np.isclose(many.slip_before[k], one.slip_before, rtol=1e-3)
    assert many.gap.max() <= 1e-12 and np.isinf(many.lost_from).all() and not many.unstable.any()
    assert np.abs(linkage.constraint_error(many.q)).max() <= 1e-12
    assert np.abs(linkage.constraint_jacobian(many.q) @ many.dq[..., None]).max() < 1e-12


def test_gap_and_slip_of_a_motion_are_the_largest_of_its_steps(linkage, starts):
    """Each step by itself, from the states of the motion; the largest is not that of the last."""
    whole = linkage.rollout(*starts, duration=0.3, method="rk4")
    single = linkage.rollout(whole.q[:, :-1], whole.dq[:, :-1], dt=whole.dt, steps=1, method="rk4")
    for name in ("gap_before", "slip_before"):
        steps = getattr(single, name)
        assert (steps[:, -1] < 0.9 * steps.max(axis=1)).any()
        np.testing.assert_allclose(getattr(whole, name), steps.max(axis=1), rtol=1e-6, atol=1e-15)


def test_wrenches_limits_friction_and_torques_enter_as_in_simulations(starts):
    friction = Friction.plain([0.2, 0.1, 0.3], [0.4, 0.2, 0.0])
    closed = tw.Robot(replace(four_bar().model, friction=friction)).close("rocker_pin", "coupler_pin", "vx vz")
    q, dq = (x[0] for x in starts)
    F = {"coupler_pin": [0, 0.5, 0, 2.0, 0, -3.0]}
    given = {"duration": 0.2, "method": "rk4", "wrench_on_robot": F, "friction": True}
    one = closed.simulate(q, dq, tau=[1.0, 0.0, 0.0], **given)
    many = closed.rollout(q, dq, [7.0, 0.0, 0.0], torque_limits=[1.0, 2.0, 2.0], torques=True, **given)
    assert np.abs(many.q - one.q).max() < 1e-10 and np.abs(many.tau - [1.0, 0.0, 0.0]).max() == 0.0
    assert one.work["wrenches"][-1] != 0.0 and one.relative_drift < 1e-6, "compiled wrenches are counted as work"


def test_constant_wrenches_run_compiled_as_from_python(linkage, starts):
    F = np.array([0, 0.5, 0, 2.0, 0, -3.0])
    q, dq = (x[0] for x in starts)
    one, other = (
        linkage.simulate(q, dq, duration=0.3, wrench_on_robot={"coupler_pin": given})
        for given in (F, lambda t, q, dq: F)
    )
    for name in ("q", "dq", "ddq", "lam"):
        assert np.abs(getattr(one, name) - getattr(other, name)).max() < 1e-9, name
    assert np.abs(one.work["wrenches"] - other.work["wrenches"]).max() < 1e-12
    assert one.evaluations == other.evaluations


def test_laws_and_parameters_differ_from_sample_to_sample(linkage, starts):
    """Gains as in a simulation that asks Python for the torques; a coupler's mass as it is, and another."""
    q, dq = (x[0] for x in starts)
    law = tw.simulation.BatchPD(q, [[[4.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]]], [0.5, 0.0, 0.0], gravity=False)
    many = linkage.rollout(q, dq, law, duration=0.2, method="rk4")
    one = linkage.simulate(q, dq, duration=0.2, tau=lambda t, x, v: [4.0 * (q[0] - x[0]) - 0.5 * v[0], 0.0, 0.0])
    assert np.abs(many.q[0] - one.q).max() < 1e-10 and np.abs(many.q[1] - one.q).max() > 1e-4
    many = linkage.rollout(q, dq, steps=100, parameters={"coupler.mass": [2.0, 3.0]})
    same = linkage.rollout(q, dq, steps=100)
    assert np.abs(many.q[0] - same.q).max() < 1e-12 and np.abs(many.q[1] - same.q).max() > 1e-6
    assert many.gap.max() <= 1e-12
    with pytest.raises(tw.ValueRangeError, match="move joints"):
        linkage.rollout(q, dq, steps=10, parameters={"b.x": [0.3]})


def test_a_motion_that_loses_its_constraints_leaves_the_others_alone():
    level = 0.5
    closed = four_bar((level, GROUND, level, GROUND)).close(
        "rocker_pin", "coupler_pin", "vx vz", near=[-1.5, 1.5, -1.5]
    )
    bottom = np.array([-np.pi / 2, np.pi / 2, -np.pi / 2])
    many = closed.rollout(bottom, [[9.0, -9.0, 9.0], [1.0, -1.0, 1.0]], duration=1.0, method="rk4")
    with pytest.raises(tw.SimulationError, match="lose rank") as caught:
        closed.simulate(bottom, [9.0, -9.0, 9.0], duration=1.0)
    ended = caught.value.result
    assert abs(many.lost_from[0] - ended.times[-1]) < 1.5e-3 and np.isinf(many.lost_from[1])
    before = many.times < many.lost_from[0]
    assert np.isfinite(many.q[0, before]).all() and np.isnan(many.q[0, ~before]).all()
    assert np.abs(many.q[0, before][-1] - ended.q[before.sum() - 1]).max() < 1e-9
    assert np.isfinite(many.q[1]).all() and many.gap.max() <= 1e-12
    assert many.unstable.tolist() == [True, False] and "1 of the motions lose rank" in repr(many)


@pytest.mark.slow
def test_a_plate_that_floats_is_rolled_out():
    closed, q = closed_platform()
    found = closed.rollout(q, np.zeros(closed.nv), duration=0.05)
    one = closed.simulate(q, duration=0.05, method="semi_implicit")
    assert np.abs(found.q - one.q).max() < 1e-10 and found.gap <= 1e-12


def test_what_is_refused(linkage, starts):
    q, dq = starts
    with pytest.raises(tw.ConstraintError, match="leaves loops open"):
        linkage.rollout(np.concatenate([q, [[0.5, 0.5, 0.5]]]), [0, 0, 0], steps=3)
    with pytest.raises(tw.ConstraintError, match="dq breaks the constraints"):
        linkage.rollout(q, [1.0, 1.0, 1.0], steps=3)
    parallelogram = four_bar((0.5, GROUND, 0.5, GROUND)).close(
        "rocker_pin", "coupler_pin", "vx vz", near=[-1.5, 1.5, -1.5]
    )
    with pytest.raises(tw.ValueRangeError, match=r"singular configuration \(motion 1"):
        parallelogram.rollout([[-np.pi / 2, np.pi / 2, -np.pi / 2], [0.0, 0.0, 0.0]], [0, 0, 0], steps=3)
    with pytest.raises(tw.UnknownNameError):
        linkage.rollout(q, dq, steps=3, method="euler")


def test_rows_that_never_move_hold_nothing():
    idle = tw.robots.planar_3r().close("ground", "tip", rows="vy", redundant="accept")
    many = idle.rollout([0.1, 0.2, 0.3], [0, 0, 0], steps=20)
    assert np.array_equal(many.q, tw.robots.planar_3r().rollout([0.1, 0.2, 0.3], [0, 0, 0], steps=20).q)
    assert many.gap == 0.0
