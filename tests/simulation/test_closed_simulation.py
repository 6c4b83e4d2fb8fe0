"""Simulations of closed robots: gaps, energies, minimal coordinates, loss of rank, and what is refused."""

from __future__ import annotations

import runpy
from dataclasses import replace

import numpy as np
import pytest
from mechanisms import GROUND, MASSES, G, along, closed_platform, crank_only, four_bar, pins
from places import ROOT
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

import twistwrench as tw
from twistwrench.mechanics.algorithms.loop_closure import small_gaps
from twistwrench.mechanics.model.limits import Friction
from twistwrench.simulation import SimulationResult

LEVEL = 0.5
"""m, both cranks of the parallelogram."""


@pytest.fixture(scope="module")
def linkage():
    return four_bar().close("rocker_pin", "coupler_pin", "vx vz")


@pytest.fixture(scope="module")
def parallelogram():
    """Hanging: crank and rocker at -90°, the coupler level."""
    return four_bar((LEVEL, GROUND, LEVEL, GROUND)).close("rocker_pin", "coupler_pin", "vx vz", near=[-1.5, 1.5, -1.5])


@pytest.fixture(scope="module")
def start(linkage):
    q = linkage.consistent([0.0, 0.8, 1.6])
    return q, linkage.project_velocity(q, [6.0, 0.0, 0.0])


def slip(closed, found):
    return np.abs(closed.constraint_jacobian(found.q) @ found.dq[..., None]).max()


@pytest.mark.parametrize("method", ["rk4", "semi_implicit", "euler", "dopri5"])
def test_loops_stay_closed_after_every_step(linkage, start, method):
    found = linkage.simulate(*start, duration=1.0, dt=1e-3, method=method)
    assert found.completed and len(found) == 1001
    assert np.abs(linkage.constraint_error(found.q)).max() <= 1e-12 and found.gap.max() <= 1e-12
    assert slip(linkage, found) < 1e-13
    assert 1e-12 < found.gap_before < 1e-3, "and what the steps left is said"


def test_errors_are_known_where_compiled_steps_end_off_the_constraints(linkage):
    B, C = pins(1.2)
    (x, z), (u, w) = C - B, C - [GROUND, 0.0]
    q = linkage.consistent([1.2, np.arctan2(z, x) - 1.2, np.arctan2(w, u)])
    dq = linkage.project_velocity(q, [9.0, 0.0, 0.0])
    found = linkage.simulate(q, dq, duration=0.09, dt=0.01, method="semi_implicit")
    assert found.completed and 0.01 < found.relative_error < 0.1


def test_energy_is_conserved_to_the_order_of_the_method(linkage, start):
    coarse, fine = (np.abs(linkage.simulate(*start, duration=2.0, dt=dt).drift).max() for dt in (0.008, 0.004))
    assert fine < coarse / 12, "an order of four is a sixteenth"
    assert fine < 1e-6


@pytest.mark.parametrize("watched", [False, True])
@pytest.mark.parametrize("method", ["semi_implicit", "euler"])
def test_error_estimates_follow_the_errors(linkage, start, method, watched):
    """Both of one size, by a run of dopri5 far finer, and both as many times less at half the step as the order says.

    Velocities half a step late leave the constraints by as much as these turn: an estimate that counts it never shrinks.
    """
    fine = linkage.simulate(*start, duration=0.3, method="dopri5", rtol=1e-12, atol=1e-13)
    events = [lambda t, q, dq: 1.0] if watched else []  # with one the steps are taken in Python
    estimates = []
    for dt in (1e-3, 5e-4):
        found = linkage.simulate(*start, duration=0.3, dt=dt, method=method, events=events)
        error, estimate = np.abs(found.q[-1] - fine.q[-1]).max(), found.error_estimate.max()
        assert 0.2 * error < estimate < 20 * error
        estimates.append(estimate)
    assert estimates[0] > 1.8 * estimates[1]


def test_a_parallelogram_is_a_pendulum(parallelogram):
    """Both cranks turn by one angle and the coupler goes along without turning: θ'' = -(g/l) sin θ, by Jacobi's sn."""
    amplitude = 0.8
    bottom = np.array([-np.pi / 2, np.pi / 2, -np.pi / 2])
    found = parallelogram.simulate(bottom + amplitude * np.array([1, -1, 1]), duration=3.0)
    crank, coupler, rocker = MASSES
    inertia = (crank + rocker) * LEVEL**2 / 3 + 2e-4 + coupler * LEVEL**2
    w = np.sqrt(G * LEVEL * (0.5 * (crank + rocker) + coupler) / inertia)
    k = np.sin(amplitude / 2)
    theta = 2 * np.arcsin(k * ellipj(ellipk(k**2) - w * found.times, k**2)[0])
    off = found.q - bottom - theta[:, None] * np.array([1, -1, 1])
    assert np.abs(off).max() < 1e-8, "steps of 1 ms are good to some 1e-10 here"


def test_a_four_bar_moves_as_its_reduced_equation(linkage):
    """I φ'' + ½ I' φ'² + V' = 0, I and V by plane geometry; slopes by differences good to 1e-9."""
    q = linkage.consistent([0.3, 0.4, 1.2])
    n = linkage.project_velocity(q, [1.0, 0.0, 0.0])
    found = linkage.simulate(q, 6.0 * n / n[0], duration=1.0)

    def rate(_t, y):
        (up, V_up, _), (down, V_down, _) = crank_only(y[0] + 1e-5), crank_only(y[0] - 1e-5)
        return y[1], -((V_up - V_down) + 0.5 * (up - down) * y[1] ** 2) / 2e-5 / crank_only(y[0])[0]

    exact = solve_ivp(rate, (0, 1), [q[0], 6.0], rtol=1e-11, atol=1e-12, t_eval=found.times, method="DOP853")
    assert np.abs(found.q[:, 0] - exact.y[0]).max() < 1e-7
    assert np.abs(found.dq[:, 0] - exact.y[1]).max() < 1e-6
    assert abs(found.dq[-1, 2] - crank_only(exact.y[0, -1])[2] * exact.y[1, -1]) < 1e-6


PINNED = """<mujoco model="linkage"><compiler angle="radian"/>
<option timestep="1e-4" integrator="RK4" iterations="200" tolerance="1e-14"><flag refsafe="disable"/></option>
<worldbody>
<body name="crank"><joint name="a" axis="0 -1 0"/>
<inertial pos="0.15 0 0" mass="1" diaginertia="0.0005 0.0075 0.0075"/>
<body name="coupler" pos="0.3 0 0" euler="0 {b} 0"><joint name="b" axis="0 -1 0"/>
<inertial pos="0.4 0 0" mass="2" diaginertia="0.0005 0.107 0.107"/></body></body>
<body name="rocker" pos="0.7 0 0" euler="0 {d} 0"><joint name="d" axis="0 -1 0"/>
<inertial pos="0.3 0 0" mass="1.5" diaginertia="0.0005 0.045 0.045"/></body>
</worldbody>
<equality><connect body1="coupler" body2="rocker" anchor="0.8 0 0" solref="1e-3 1" solimp="0.99999 0.99999 0.001"/></equality>
</mujoco>"""
"""The linkage with its pin as MuJoCo has it, a spring and damper of 1 ms; its coordinates are zero where the pin is closed."""


@pytest.mark.filterwarnings("ignore:robot 'linkage'")
def test_a_four_bar_moves_as_mujoco_has_it_with_a_stiff_pin(tmp_path):
    """The pin gives by some 1e-5 of what it carries over its stiffness, and the motion by 1e-8; the crank turns by a radian."""
    mujoco = pytest.importorskip("mujoco")
    B, C = pins(0.0)
    text = PINNED.format(b=-np.arctan2(*(C - B)[::-1]), d=-np.arctan2(C[1], C[0] - GROUND))
    model = mujoco.MjModel.from_xml_string(text)
    state = mujoco.MjData(model)
    for _ in range(5000):
        mujoco.mj_step(model, state)
    path = tmp_path / "linkage.xml"
    path.write_text(text)
    closed = tw.load(path).close("connect0:coupler", "connect0:rocker", "vx vz")
    found = closed.simulate(np.zeros(3), duration=0.5)
    assert np.abs(state.qpos).max() > 1.0
    assert np.abs(found.q[-1] - state.qpos).max() < 1e-7


def test_power_is_balanced(start):
    friction = Friction.plain([0.2, 0.1, 0.3], [0.0, 0.0, 0.0])
    closed = tw.Robot(replace(four_bar().model, friction=friction)).close("rocker_pin", "coupler_pin", "vx vz")
    found = closed.simulate(*start, duration=1.0, tau=lambda t, q, dq: [3 * np.sin(5 * t), 0, 0.5], friction=True)
    assert np.abs(found.drift).max() < 1e-8, "energy is what torques and friction did, and constraints do no work"
    done = np.trapezoid((found.tau * found.dq).sum(axis=1), found.times)
    assert abs(done - found.work["torques"][-1]) < 1e-5, (
        "the trapezoidal rule is good to h²/12 of the second derivative"
    )
    assert found.work["friction"][-1] < -0.1


@pytest.mark.parametrize("method", ["rk4", "semi_implicit", "euler"])
@pytest.mark.parametrize("rubs", [False, True])
def test_compiled_steps_are_those_of_the_method(start, method, rubs):
    """Torques that are a function are asked from Python, constant ones are not; the same but for rounding."""
    friction = Friction.plain([0.02, 0.01, 0.03], [0.04, 0.02, 0.0])
    rough = tw.Robot(replace(four_bar().model, friction=friction)).close("rocker_pin", "coupler_pin", "vx vz")
    tau = np.array([0.5, 0.0, -0.2])
    given = {"duration": 0.3, "method": method, "friction": rubs, "every": 3}
    compiled, asked = (rough.simulate(*start, tau=x, **given) for x in (tau, lambda t, q, dq: tau))
    for name in ("times", "q", "dq", "ddq", "tau", "lam", "error_estimate"):
        one, other = getattr(compiled, name), getattr(asked, name)
        assert np.abs(one - other).max() <= 1e-10 * (1 + np.abs(other).max()), name
    assert all(np.abs(compiled.work[w] - asked.work[w]).max() < 1e-12 for w in compiled.work)
    assert (compiled.steps, compiled.evaluations) == (asked.steps, asked.evaluations)
    assert np.isclose(compiled.gap_before, asked.gap_before, rtol=1e-3) and compiled.remarks == asked.remarks


def test_long_runs_go_on_where_a_block_of_steps_ends(linkage, start):
    told = []
    whole = linkage.simulate(*start, duration=4.5, dt=1e-3, every=7, progress=told.append)
    half = linkage.simulate(*start, duration=2.1, dt=1e-3)
    assert told == sorted(told) and told[-1] == 1.0 and len(told) >= 3
    assert np.array_equal(whole.q[:300], half.q[:2100:7])
    assert np.allclose(np.diff(whole.times)[:-1], 0.007) and whole.times[-1] == 4.5


def test_multipliers_balance_every_state(linkage, start):
    robot, F = linkage.open(), [0, 0.5, 0, 2.0, 0, -3.0]
    found = linkage.simulate(*start, duration=0.2, tau=[1, 0, 0], wrench_on_robot={"coupler_pin": F})
    needed = robot.inverse_dynamics(found.q, found.dq, found.ddq, wrench_on_robot={"coupler_pin": F})
    held = (found.lam[:, None] @ linkage.constraint_jacobian(found.q))[:, 0]
    assert np.abs(needed + held - found.tau).max() < 1e-10
    assert found.row_names == linkage.row_names


@pytest.mark.slow
def test_a_platform_that_floats_on_three_legs():
    closed, q = closed_platform()
    found = closed.simulate(q, duration=0.15, dt=1e-3)
    assert found.gap.max() <= 1e-12 and slip(closed, found) < 1e-12 and found.relative_drift < 1e-8
    quaternion = found.q[:, :4]
    assert np.abs(np.linalg.norm(quaternion, axis=1) - 1).max() < 1e-15


@pytest.mark.parametrize("rows", ["wx wy", "wx wy wz"])
def test_a_tool_that_may_only_spin_or_not_turn_at_all(rows):
    arm = tw.robots.ur5().lock({"shoulder_lift_joint": -1.0, "elbow_joint": 1.0})
    q = arm.random_configuration(3)
    T = arm.forward_kinematics(q)
    closed = arm.close("ground", arm.tip, rows=rows, pose=T, near=q)
    dq = closed.project_velocity(q, [1, -1, 0.5, 2])
    found = closed.simulate(q, dq, duration=0.2, dt=0.01)
    R = arm.forward_kinematics(found.q)[:, :3, :3]
    assert found.gap.max() <= 1e-12 and found.gap_before > 1e-12 and found.relative_drift < 1e-6
    assert np.abs(R[:, :, 2] - T[:3, 2]).max() < 1e-12, "its axis stands still"
    assert (np.abs(R - T[:3, :3]).max() < 1e-12) == (rows == "wx wy wz")


@pytest.mark.parametrize("rows", ["wx wy", "wx wz", "wy wz", "wx wy wz", "vx vy vz", "wx wy wz vz"])
def test_gaps_of_steps_are_those_of_the_search_to_the_third_order(rows):
    arm = tw.robots.ur5()
    q = arm.random_configuration(3)
    closed = arm.close("ground", arm.tip, rows=rows, pose=arm.forward_kinematics(q), near=q)
    ajar = q + 1e-3 * np.array([1.0, -1.0, 0.5, 2.0, 1.0, -1.0])
    exact = closed.constraint_error(ajar)
    assert np.abs(exact).max() > 1e-4
    assert np.abs(small_gaps(arm.model, ajar.astype(object), closed.constraints) - exact).max() < 1e-7


def test_a_blade_runs_in_a_circle():
    blade = tw.robots.floating_box(gravity=(0, 0, 0)).constrain("box", "vy")
    found = blade.simulate(blade.open().neutral, [0, 0, 2.0, 3.0, 0, 0], duration=1.0)
    places = blade.open().forward_kinematics(found.q, "box")[:, :2, 3]
    angle = 2.0 * found.times
    assert np.abs(places - 1.5 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])).max() < 1e-9


def test_rows_too_many_change_nothing(linkage, start):
    spatial = linkage.open().close("rocker_pin", "coupler_pin", "wx wz vx vy vz", redundant="accept")
    one, other = (c.simulate(*start, duration=0.5) for c in (linkage, spatial))
    assert np.abs(one.q - other.q).max() < 1e-10 and np.abs(one.lam - other.lam[:, [2, 4]]).max() < 1e-7


def test_rows_that_never_move_hold_nothing():
    arm = tw.robots.planar_3r()
    idle = arm.close("ground", "tip", rows="vy", redundant="accept")
    found, free = (r.simulate([0.1, 0.2, 0.3], duration=0.1, method="rk4") for r in (idle, arm))
    assert np.array_equal(found.q, free.q) and found.lam.shape == (101, 1) and not found.lam.any()


def test_loss_of_rank_on_the_way_keeps_what_was_computed(parallelogram):
    """Fast enough to come up to where the bars are in one line, the parallelogram may go on crossed."""
    bottom = np.array([-np.pi / 2, np.pi / 2, -np.pi / 2])
    with pytest.raises(tw.SimulationError, match="constraints lose rank") as caught:
        parallelogram.simulate(bottom, [9.0, -9.0, 9.0], duration=3.0)
    found = caught.value.result
    assert isinstance(found, SimulationResult) and not found.completed and 0.05 < found.times[-1] < 1.0
    assert np.cos(found.q[-1, 0]) > 0.98 and found.gap.max() <= 1e-12


def test_what_is_refused(linkage, parallelogram, start):
    with pytest.raises(tw.UnknownNameError, match="rk4"):
        linkage.simulate(*start, method="variational")
    with pytest.raises(tw.ConstraintError, match="leaves loops open"):
        linkage.simulate([0.5, 0.5, 0.5])
    with pytest.raises(tw.ConstraintError, match="dq breaks the constraints"):
        linkage.simulate(start[0], [1.0, 1.0, 1.0])
    with pytest.raises(tw.ValueRangeError, match="singular"):
        parallelogram.simulate([0.0, 0.0, 0.0])
    with pytest.raises(tw.SimulationError, match="smaller dt"):
        linkage.simulate(*start, duration=5.0, dt=0.25)


def test_results_compose(linkage, start, tmp_path):
    told = []
    found = linkage.simulate(*start, duration=0.1, every=5, progress=told.append)
    assert len(found) == 21 and told[-1] == 1.0
    assert np.array_equal(SimulationResult.load(found.to_csv(tmp_path / "swing.csv")).q, found.q)
    assert found.motion.q.shape == (21, 3) and found.plot(tmp_path / "swing.svg").exists()
    assert "before projection" in repr(found)


def test_holding_torques_hold(linkage, start):
    """Under them a robot at rest stays, by the one motor; and they are the slope of the potential energy along the motion."""
    q, F = start[0], {"coupler_pin": [0, 0, 0, 0, 0, -5.0]}
    tau, _ = linkage.holding_torques(q, ["a"], wrench_on_robot=F)
    assert tau[1:].tolist() == [0.0, 0.0]
    still = linkage.simulate(q, duration=0.1, tau=tau, wrench_on_robot=F)
    assert np.abs(still.q - q).max() < 1e-12
    n = linkage.project_velocity(q, [1.0, 0.0, 0.0])
    ahead, behind = (linkage.open().potential_energy(linkage.consistent(q + s * n)) for s in (1e-5, -1e-5))
    free = linkage.holding_torques(q, ["a"]).tau
    assert abs(free @ n - (ahead - behind) / 2e-5) < 1e-7
    with pytest.raises(tw.ConstraintError, match="have no motor"):
        linkage.holding_torques(q, [])


def test_closing_begins_at_configurations_that_the_model_knows(monkeypatch):
    """With no random starts: the stretched arm alone, the neutral one, finds nothing."""
    monkeypatch.setattr("twistwrench.robot.constraints.closures.STARTS", 1)
    arm = tw.robots.planar_3r()
    asked = {"frame_a": "ground", "frame_b": arm.tip, "rows": "vx vz", "pose": along(1.5)}
    with pytest.raises(tw.ConstraintError, match="from 1 starts"):
        arm.close(**asked)
    bent = tw.Robot(replace(arm.model, configurations={"bent": np.array([-0.6, 0.2, 2.2])}))
    assert bent.close(**asked).degrees_of_freedom([-0.6, 0.2, 2.2]) == 1


@pytest.mark.slow
def test_the_delta_robot_of_the_examples_keeps_its_platform_level(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(ROOT / "examples" / "delta_robot.py"))
    example["main"](tmp_path, travel=0.3, duration=0.31)
    assert (tmp_path / "delta_robot.png").read_bytes().startswith(b"\x89PNG")
    said = capsys.readouterr().out
    gap, turn, energy = (
        float(said.split(before)[1].split()[0]) for before in ("gap ", "turned by ", "unaccounted for ")
    )
    assert "3 degrees of freedom" in said and gap <= 1e-12 and turn < 1e-12 and energy < 1e-5


def test_events_and_limits_end_on_the_constraints(linkage, start):
    up = tw.simulation.Event(lambda t, q, dq: q[0] + 0.5, "up", terminal=True)
    found = linkage.simulate(*start, duration=1.0, events=up)
    assert found.events and abs(found.q[-1, 0] + 0.5) < 1e-12 and found.gap[-1] <= 1e-12


def test_no_first_configuration_is_a_closed_one():
    arm = tw.robots.planar_3r()
    held = arm.close("ground", arm.tip, rows="vx vz", pose=along(1.5))
    assert held.simulate(duration=0.01).gap.max() <= 1e-12
