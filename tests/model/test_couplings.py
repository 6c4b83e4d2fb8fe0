"""Coupled drives, q̇_m = A q̇_j and τ_j = A'τ_m: laws of mechanics and power, limits as polygons, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from motions import report_of
from places import SHARED
from random_trees import ROUNDING, tree
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

import twistwrench as tw
from twistwrench import statics, trajectories
from twistwrench.cli.main import main
from twistwrench.mechanics.model.couplings import motor_torques, motor_velocities
from twistwrench.motion.limits_file import read_limits
from twistwrench.reports.recordings.recording import Recording
from twistwrench.reports.robot_summary import joint_rows, limits_csv
from twistwrench.testing import assert_close, derivative, random_state
from twistwrench.viz.page import write_page

pytest_plugins = ("small_trees",)

WRIST = ("wrist_2_joint", "wrist_3_joint")
DIFFERENTIAL = [[1.0, 1.0], [1.0, -1.0]]
FILE = """
couplings:
  wrist:
    motors: [m5, m6]
    joints: [wrist_2_joint, wrist_3_joint]
    motor_per_joint: [[1, 1], [1, -1]]
motors:
  small: {torque_constant: 0.1 N m/A, current_peak: 5 A}
actuators:
  m5:
    ratio: 101
    rotor: {inertia: 20 g cm^2}
    effort: 28 N m
    motor: small
    friction: {viscous: 0.5 N m s/rad, coulomb: 1 N m, load: 0.05}
  m6: {ratio: -50, reflected_inertia: 0.03 kg m^2, effort: 28 N m, friction: {coulomb: 2 N m}}
  elbow_joint: {ratio: 101, friction: {viscous: 3 N m s/rad}}
"""


def differential(effort=28.0, **more):
    """The UR5 with a differential wrist of two equal motors."""
    entry = {"effort": f"{effort} N m", **more}
    coupling = {"motors": ["m5", "m6"], "joints": list(WRIST), "motor_per_joint": DIFFERENTIAL}
    return tw.robots.ur5().with_actuators({"couplings": {"wrist": coupling}, "actuators": {"m5": entry, "m6": entry}})


def coupled_at_random(robot, seed, form="motor_per_joint"):
    """All one-degree joints of a robot coupled by a random matrix, with inertia and friction; the robot, A and the places."""
    rng = np.random.default_rng(seed)
    joints = [b for b in robot.model.leaders if b.joint.nv == 1]
    at, n = [b.v_index for b in joints], len(joints)
    A = rng.normal(size=(n, n)) + 2.0 * np.eye(n)
    motors = [f"motor{k}" for k in range(n)]
    law = {"viscous": "0.2 N m s/rad", "coulomb": "0.3 N m", "load": 0.1}
    given = A if form == "motor_per_joint" else np.linalg.inv(A)
    coupling = {"motors": motors, "joints": [b.joint.name for b in joints], form: given.tolist()}
    drives = {m: {"reflected_inertia": f"{rng.uniform(0.1, 1):.3f} kg m^2", "friction": law} for m in motors}
    return robot.with_actuators({"couplings": {"all": coupling}, "actuators": drives}), A, at


@pytest.fixture(scope="module")
def robot():
    return tw.robots.ur5().with_actuators(FILE)


# ── mechanics


@pytest.mark.usefixtures("each_on_numpy")
@pytest.mark.parametrize(
    "name", ["one_degree1", *(pytest.param(name, marks=pytest.mark.slow) for name in ("ur5", "tree3"))]
)
def test_a_coupling_adds_the_inertia_of_its_motors_and_nothing_else(name):
    """M, τ, q̈, K, c and their derivatives are those of the robot alone with J = A' diag(J_rotor) A on top."""
    alone = tw.robots.ur5() if name == "ur5" else tree(name)
    alone = alone.with_armature({b.joint.name: 0.0 for b in alone.model.leaders if b.joint.nv == 1})
    robot, A, at = coupled_at_random(alone, 3)
    J = np.zeros((robot.nv, robot.nv))
    J[np.ix_(at, at)] = A.T @ np.diag(robot.armature[at]) @ A
    q, dq, ddq = random_state(robot, np.random.default_rng(1))
    M, tau = alone.mass_matrix(q) + J, alone.inverse_dynamics(q, dq, ddq) + J @ ddq
    assert_close(robot.mass_matrix(q), M, ROUNDING, "M")
    assert_close(robot.inverse_dynamics(q, dq, ddq), tau, ROUNDING, "τ")
    assert_close(robot.forward_dynamics(q, dq, tau), ddq, 1e-9, "q̈")
    assert_close(robot.kinetic_energy(q, dq), alone.kinetic_energy(q, dq) + 0.5 * dq @ J @ dq, ROUNDING, "K")
    assert_close(robot.closed_form(q, dq).inverse_dynamics(ddq), tau, ROUNDING, "block matrices")
    assert_close(robot.explain(q, dq, ddq).torque, tau, ROUNDING, "explained")
    assert_close(np.sum(robot.drive_torques(q, dq, ddq), axis=0), tau, ROUNDING, "gears and rotors")
    by_q, by_dq, by_tau = robot.forward_dynamics_derivatives(q, dq, tau)
    assert_close(by_tau, np.linalg.inv(M), 1e-9, "∂q̈/∂τ")
    for by, x in ((by_q, 0), (by_dq, 1)):
        for k in at[:2]:
            e = np.eye(robot.nv)[k]

            def moved(t, x=x, e=e):
                step = np.multiply.outer(t, e)
                return robot.forward_dynamics(robot.add(q, step) if x == 0 else q, dq + x * step, tau)

            assert_close(by[:, k], derivative(moved, 1.0), 1e-6, "by differences", scale=1.0 + np.abs(by).max())


@pytest.mark.usefixtures("each_on_numpy")
@pytest.mark.parametrize("seed", range(4))
def test_power_is_the_same_at_motors_and_joints(seed):
    """τ_m'q̇_m = τ_j'q̇_j, exact up to rounding: A' and A⁻ᵀ cancel, at a condition of A below 1e3."""
    alone = tree("one_degree1")
    robot, A, at = coupled_at_random(alone, seed)
    q, dq, ddq = random_state(robot, np.random.default_rng(seed))
    tau = robot.inverse_dynamics(q, dq, ddq, friction=True)
    u, motors = motor_velocities(robot.model, dq), motor_torques(robot.model, tau)
    assert_close(u[at], A @ dq[at], 1e-14, "q̇_m = A q̇_j")
    assert abs(motors @ u - tau @ dq) <= 1e-12 * np.abs(tau * dq).sum()
    loads = robot.motor_loads(q, dq, ddq, friction=True)
    assert_close(np.sum(loads.torque * loads.speed), tau[at] @ dq[at], 1e-12, "power into the gears")


def test_friction_is_that_of_the_motors():
    """A' f(A q̇), by hand, with friction that grows with the torque carried; forward dynamics takes the same off."""
    robot = tw.robots.ur5().with_actuators(FILE)
    q, dq, ddq = random_state(robot, np.random.default_rng(5))
    tau = robot.inverse_dynamics(q, dq, ddq)
    A = np.array(DIFFERENTIAL)
    u, carried = A @ dq[4:], np.linalg.solve(A.T, tau[4:])
    law = np.array([0.5, 0.0]) * u + np.sign(u) * (np.array([1.0, 2.0]) + np.array([0.05, 0.0]) * np.abs(carried))
    lost = robot.inverse_dynamics(q, dq, ddq, friction=True) - tau
    assert_close(lost, np.r_[0, 0, 3 * dq[2], 0, A.T @ law], 1e-11, "friction")
    assert_close(robot.friction_forces(dq, load=tau), lost, 1e-11, "friction by itself")
    assert_close(robot.forward_dynamics(q, dq, tau + lost, friction=True), ddq, 1e-9, "q̈")


def test_a_coupling_by_the_identity_is_no_coupling():
    """Motors in the places of their joints: every figure is that of the same numbers given to the joints."""
    law = {"coulomb": "2 N m", "viscous": "1 N m s/rad"}
    coupling = {"motors": ["a", "b"], "joints": list(WRIST), "motor_per_joint": [[1, 0], [0, 1]]}
    entry = {"reflected_inertia": "0.1 kg m^2", "friction": law}
    mine = tw.robots.ur5().with_actuators(
        {"couplings": {"none": coupling}, "actuators": dict.fromkeys("ab", entry | {"effort": "28 N m"})}
    )
    same = tw.robots.ur5().with_actuators({"actuators": dict.fromkeys(WRIST, entry)})
    q, dq, ddq = random_state(same, np.random.default_rng(2))
    for options in ({}, {"friction": True}):
        tau = same.inverse_dynamics(q, dq, ddq, **options)
        assert_close(mine.inverse_dynamics(q, dq, ddq, **options), tau, 1e-13, "τ")
    assert_close(statics.largest_payload(mine, q).mass, statics.largest_payload(same, q).mass, 1e-12, "payload")
    path = trajectories.joint_line(same, q, q + 0.5)
    times = [trajectories.fastest(r, path, friction=True).duration for r in (mine, same)]
    assert_close(times[0], times[1], 1e-7, "fastest timing")
    times = [trajectories.fitted(r, path, friction=True).duration for r in (mine, same)]
    assert_close(times[0], times[1], 1e-9, "fitted timing")


def test_either_matrix_gives_the_same_robot():
    alone = tree("one_degree1")
    (one, _, _), (other, _, _) = (coupled_at_random(alone, 7, f) for f in ("motor_per_joint", "joint_per_motor"))
    q, dq, ddq = random_state(one, np.random.default_rng(0))
    tau = one.inverse_dynamics(q, dq, ddq, friction=True)
    assert_close(other.inverse_dynamics(q, dq, ddq, friction=True), tau, 1e-10, "τ")


def test_the_rotor_counts_by_its_ratio_squared_and_a_remark_says_what_is_left_out(robot):
    assert robot.armature[4:].tolist() == pytest.approx([101**2 * 20e-7, 0.03])
    assert [text for text in robot.defects if "gyroscopic" in text]
    assert not tw.robots.ur5().with_actuators(FILE.replace("rotor: {inertia: 20 g cm^2}", "efficiency: 1")).defects


@pytest.mark.slow
def test_mujoco_with_a_rotor_joint_for_each_motor_and_a_stiff_equality_agrees():
    """Two free rotors held to q̇_m = A q̇_j by MuJoCo's soft constraints, 1e-4: accelerations of the joints."""
    mujoco = pytest.importorskip("mujoco")
    arm = """<body pos="0 0 0.5"><joint name="a" axis="0 1 0"/><geom size="0.05 0.2" type="capsule" mass="2"/>
      <body pos="0 0 0.3"><joint name="b" axis="1 0 0"/><geom size="0.04 0.1" pos="0 0 0.1" type="capsule" mass="1"/></body></body>"""
    turning = "".join(
        f'<body pos="{k} 5 0"><joint name="m{k}" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 {J}"/></body>'
        for k, J in ((1, 0.3), (2, 0.7))
    )
    ties = "".join(
        f'<fixed name="t{k}"><joint joint="m{k}" coef="-1"/><joint joint="a" coef="{a}"/><joint joint="b" coef="{b}"/></fixed>'
        for k, a, b in ((1, 1.5, 1.0), (2, 0.5, -2.0))
    )
    held = "".join(f'<tendon tendon1="t{k}" solref="1e-4 1" solimp="0.9999 0.9999 0.001"/>' for k in (1, 2))
    text = (
        "<mujoco><option gravity='0 0 -9.81' tolerance='1e-14' iterations='500'/><worldbody>{}</worldbody>{}</mujoco>"
    )
    theirs = mujoco.MjModel.from_xml_string(
        text.format(arm + turning, f"<tendon>{ties}</tendon><equality>{held}</equality>")
    )
    coupling = {"motors": ["m1", "m2"], "joints": ["a", "b"], "motor_per_joint": [[1.5, 1.0], [0.5, -2.0]]}
    drives = {f"m{k}": {"reflected_inertia": f"{J} kg m^2"} for k, J in ((1, 0.3), (2, 0.7))}
    ours = tw.load(text.format(arm, "")).with_actuators({"couplings": {"both": coupling}, "actuators": drives})
    theirs.tendon_invweight0[:] *= 1e-6  # the regularisation of soft constraints is proportional to it
    data, rng = mujoco.MjData(theirs), np.random.default_rng(0)
    A = np.array(coupling["motor_per_joint"])
    for _ in range(5):
        q, dq, motors = rng.normal(size=(3, 2))
        data.qpos[:], data.qvel[:] = np.r_[q, A @ q], np.r_[dq, A @ dq]
        data.qfrc_applied[:] = np.r_[0.0, 0.0, motors]
        mujoco.mj_forward(theirs, data)
        expected = ours.forward_dynamics(q, dq, A.T @ motors)
        assert_close(data.qacc[:2], expected, 1e-4, "q̈ of the joints")


def test_a_simulation_with_friction_of_coupled_motors_balances_its_energy():
    """Compiled steps, steps by a callback, and rollouts; friction takes A' f(A q̇), eased at rest, from the joints' torques."""
    law = {"viscous": "0.4 N m s/rad", "coulomb": "0.6 N m"}
    coupling = {"motors": ["a", "b"], "joints": ["joint1", "joint2"], "motor_per_joint": [[1.0, 0.5], [1.0, -1.0]]}
    drives = {m: {"friction": law, "reflected_inertia": "0.2 kg m^2"} for m in "ab"}
    arm = tw.robots.planar_2r().with_actuators({"couplings": {"both": coupling}, "actuators": drives})
    q0, dq0, A = np.array([0.3, -0.5]), np.array([1.0, 2.0]), np.array(coupling["motor_per_joint"])
    options = {"duration": 0.5, "dt": 1e-3, "friction": True, "creep": 0.05}
    compiled = arm.simulate(q0, dq0, method="rk4", **options)
    called = arm.simulate(q0, dq0, method="rk4", tau=lambda t, q, dq: np.zeros(2), **options)
    assert_close(compiled.q[-1], called.q[-1], 1e-9, "compiled steps and steps by a callback")

    def rates(t, y):
        u = A @ y[2:]
        lost = A.T @ (0.4 * u + 0.6 * np.tanh(np.abs(u) / 0.05) * np.sign(u))
        return np.r_[y[2:], arm.forward_dynamics(y[:2], y[2:], -lost)]

    expected = solve_ivp(rates, (0, 0.5), np.r_[q0, dq0], rtol=1e-10, atol=1e-12).y[:, -1]
    assert_close(np.r_[compiled.q[-1], compiled.dq[-1]], expected, 1e-6, "an integrator of its own")
    assert np.abs(compiled.drift).max() < 1e-6 * compiled.kinetic_energy[0]


# ── limits: a polygon of joint torques, a box of motor torques


def test_the_differential_wrist_bears_56_on_one_joint_and_28_on_both():
    """|τ₅| + |τ₆| ≤ 56 for motors of 28 N m: the corners of the square of motor torques."""
    robot = differential()
    box = np.array([[28.0, 28.0], [28.0, -28.0]])
    assert_close(box @ np.array(DIFFERENTIAL), [[56.0, 0.0], [0.0, 56.0]], 1e-14, "corners")
    for joints, share in (([56.0, 0.0], 1.0), ([0.0, 56.0], 1.0), ([28.0, 28.0], 1.0), ([42.0, 28.0], 1.25)):
        motors = motor_torques(robot.model, np.r_[np.zeros(4), joints])
        assert_close(np.abs(motors[4:] / robot.limits.effort[4:]).max(), share, 1e-14, "share")


@pytest.mark.parametrize("seed", range(3))
def test_the_largest_payload_is_that_of_a_linear_programme(seed):
    """max m with A'τ_m = g + m w and |τ_m| ≤ L, by a solver that does not use A⁻¹."""
    robot, A, _ = coupled_at_random(tw.robots.ur5(), seed)
    drives = {f"motor{k}": {"effort": f"{80 + 20 * k} N m"} for k in range(6)}
    coupling = {"motors": list(drives), "joints": list(robot.joint_names), "motor_per_joint": A.tolist()}
    robot = tw.robots.ur5().with_actuators({"couplings": {"all": coupling}, "actuators": drives})
    q = robot.random_configuration(seed)
    g, w = robot.gravity_forces(q), statics.torques_per_kilogram(robot, q)
    box = [(0, None), *((-L, L) for L in robot.limits.effort)]
    found = linprog([-1.0, *np.zeros(6)], A_eq=np.column_stack([-w, A.T]), b_eq=g, bounds=box, method="highs")
    mine = statics.largest_payload(robot, q)
    assert bool(mine.holds)
    assert_close(mine.mass, found.x[0], 1e-7, "payload")
    assert all(name.startswith("motor motor") for name in mine.joint_names)


def test_forces_at_the_tip_are_limited_by_motors():
    """The largest force along a direction touches the polytope, and both name motors."""
    robot, q = differential(effort=3.0), np.array([0.1, -1.0, 1.2, 0.3, 0.8, 0.2])
    polytope = statics.wrench_polytope(robot, q)
    for d in np.eye(3):
        found = statics.largest_wrench(robot, q, d)
        tau = robot.holding_torques(q, wrench_on_robot={"tool0": np.zeros(6)}) + robot.wrench_torques(
            q, np.r_[np.zeros(3), robot.forward_kinematics(q)[:3, :3].T @ d * found.magnitude]
        )
        shares = np.abs(motor_torques(robot.model, tau)) / robot.limits.effort
        assert_close(shares.max(), 1.0, 1e-9, "the limit is touched")
        assert bool(polytope.contains(d * found.magnitude)) and not bool(polytope.contains(1.001 * d * found.magnitude))
    assert any("motor m5 (wrist_2_joint and wrist_3_joint)" in side for side in polytope.sides)


def test_the_ellipsoid_with_limits_has_shares_of_motors_whose_squares_sum_to_one():
    robot, q = differential(effort=3.0), np.array([0.1, -1.0, 1.2, 0.3, 0.8, 0.2])
    ellipsoid = statics.wrench_ellipsoid(robot, q, limits=robot.limits.effort)
    R = robot.forward_kinematics(q)[:3, :3]
    for d in np.eye(3):
        tau = robot.wrench_torques(q, np.r_[np.zeros(3), R.T @ d * ellipsoid.reach(d)])
        shares = motor_torques(robot.model, tau) / robot.limits.effort
        assert_close(np.linalg.norm(shares), 1.0, 1e-9, "shares")


def test_a_motor_is_named_with_the_joints_that_it_loads():
    """τ_j = A'τ_m: with A = [[1, 0], [1, 1]] the first motor loads the first joint alone, the second one both."""
    coupling = {"motors": ["m5", "m6"], "joints": list(WRIST), "motor_per_joint": [[1, 0], [1, 1]]}
    drives = {motor: {"effort": "28 N m"} for motor in coupling["motors"]}
    robot = tw.robots.ur5().with_actuators({"couplings": {"wrist": coupling}, "actuators": drives})
    names = statics.largest_payload(robot, robot.neutral).joint_names
    assert names[4:] == ("motor m5 (wrist_2_joint)", "motor m6 (wrist_2_joint and wrist_3_joint)")


@pytest.mark.parametrize("friction", [False, True])
def test_the_fastest_motion_keeps_the_motors_within_their_limits(friction):
    """Largest share 1 up to what the search leaves free, on a grid that is not the search's; a motor limits part of it."""
    law = {"coulomb": "0.4 N m", "viscous": "0.2 N m s/rad"}
    robot = differential(effort=1.5, ratio=101, rotor={"inertia": "20 g cm^2"}, friction=law)
    path = trajectories.joint_line(robot, [0, -1, 1, 0, 0.5, 0], [0.5, -0.6, 1.2, -0.3, 1.4, -1.0])
    quick = trajectories.fastest(robot, path, friction=friction)
    q, dq, ddq = quick(np.linspace(0, quick.duration, 1777)[1:-1])  # at rest the law of friction gives 0
    motors = motor_torques(robot.model, robot.inverse_dynamics(q, dq, ddq, friction=friction))
    share = np.abs(motors / robot.limits.effort).max(axis=0)
    assert share.max() <= 1.0 + 1e-9 and share[4:].max() >= 1 - 1e-3
    assert any(t.joint == "motor m6 (wrist_2_joint and wrist_3_joint)" for t in quick.limit_contacts)
    assert friction or not quick.violations()
    fitted = trajectories.move(robot, path(0.0)[0], path(1.0)[0])
    assert fitted.duration >= quick.duration and not fitted.violations()


def test_a_motion_beyond_a_motor_is_a_violation_of_that_motor():
    robot = differential(effort=0.004)
    motion = trajectories.move(tw.robots.ur5(), [0, -1, 1, 0, 0.5, 0], [0.5, -0.6, 1.2, -0.3, 2.4, -1.0]).sample(0.01)
    mine = tw.Motion(motion.time, motion.q, motion.dq, motion.ddq, robot=robot)
    names = {v.joint for v in mine.violations()}
    assert names == {f"motor {m} (wrist_2_joint and wrist_3_joint)" for m in ("m5", "m6")} and not motion.violations()


def test_the_command_torques_judges_motors(tmp_path, capsys):
    def run():
        with pytest.raises(SystemExit) as end:
            main(arguments)
        return end.value.code, " ".join(capsys.readouterr().out.split())

    path, table = tmp_path / "drives.yaml", tmp_path / "out.csv"
    path.write_text(FILE.replace("effort: 28 N m", "effort: 1.2 N m"))
    arguments = ["torques", "ur5", "--trajectory", "demo", "--actuators", str(path), "--csv", str(table)]
    code, out = run()
    assert code == 1 and "OVER LIMIT: motor m" in out and "(wrist_2_joint and wrist_3_joint) needs" in out
    rows = np.genfromtxt(table, delimiter=",", names=True)
    robot = tw.robots.ur5().with_actuators(path)
    motion = tw.Motion.from_file(tw.robots.path_of("ur5").with_name("ur5_demo.csv"), robot)
    motors = motor_torques(robot.model, motion.torques(friction=True))
    assert_close(np.stack([rows["m5torque"], rows["m6torque"]], axis=1), motors[:, 4:], 1e-6, "columns of motors")
    path.write_text(FILE.replace("    effort: 28 N m\n", ""))
    arguments = [*arguments[:-2], "--why"]
    code, out = run()
    assert code == 1 and "give each coupled motor an effort" in out


def test_a_report_has_figures_of_motors_with_their_noise(tmp_path):
    """Of a noisy log: those of the uncoupled robot for A = 1, half of them for A = 2; shares of recordings are the motors'."""
    coupling = {"motors": ["a", "b"], "joints": list(WRIST), "motor_per_joint": [[1, 0], [0, 2]]}
    drives = {motor: {"effort": "28 N m"} for motor in "ab"}
    same = tw.robots.ur5()
    robot = same.with_actuators({"couplings": {"apart": coupling}, "actuators": drives})
    t = np.arange(0, 1, 0.01)
    q = 0.4 * np.sin(np.outer(t, [1.0, 1.3, 1.7, 2.0, 2.3, 2.9])) + 1e-5 * np.random.default_rng(0).normal(
        size=(100, 6)
    )
    path, header = tmp_path / "log.csv", ",".join(["time", *same.joint_names])
    np.savetxt(path, np.column_stack([t, q]), delimiter=",", comments="", fmt="%.12g", header=header)
    mine, theirs = report_of(robot, path), report_of(same, path)
    for one, other, per in zip(mine.joints, theirs.joints, [1, 1, 1, 1, 1, 2], strict=True):
        for name in ("peak", "noise", "uncertainty", "rms"):
            assert_close(getattr(one, name), getattr(other, name) / per, 1e-9, f"{one.joint} {name}")
        assert one.limit == other.limit
    portions = zip(Recording.from_report(mine).portions, Recording.from_report(theirs).portions, strict=True)
    for (_, _, ours), (_, _, others) in portions:
        assert_close(ours["share"].tau, others["share"].tau / [1, 1, 1, 1, 1, 2], 1e-9, "shares")
        assert_close(ours["torque"].tau, others["torque"].tau, 1e-9, "torques of the joints")


def test_a_joint_of_a_recording_has_the_largest_share_of_the_motors_that_drive_it(tmp_path):
    """m5 turns with the first joint, m6 with the sum of both: τ_j = A'τ_m, so m6 bears τ_2, and m5 bears τ_1 - τ_2."""
    coupling = {"motors": ["m5", "m6"], "joints": list(WRIST), "motor_per_joint": [[1, 0], [1, 1]]}
    drives = {"m5": {"effort": "28 N m"}, "m6": {"effort": "28 N m"}}
    robot = tw.robots.ur5().with_actuators({"couplings": {"wrist": coupling}, "actuators": drives})
    t = np.arange(0, 1, 0.05)
    q = 0.4 * np.sin(np.outer(t, [1.0, 1.3, 1.7, 2.0, 2.3, 2.9]))
    path, header = tmp_path / "log.csv", ",".join(["time", *robot.joint_names])
    np.savetxt(path, np.column_stack([t, q]), delimiter=",", comments="", fmt="%.12g", header=header)
    ((_, _, series),) = Recording.from_report(report_of(robot, path)).portions
    share, tau = series["share"].tau[:, 4:], series["torque"].tau
    m5, m6 = np.abs(tau[:, 4] - tau[:, 5]) / 28.0, np.abs(tau[:, 5]) / 28.0
    assert (m5 > m6).any() and (m6 > m5).any()
    assert_close(share, np.stack([np.maximum(m5, m6), m6], axis=1), 1e-12, "shares")


def test_limits_of_torque_in_a_table_are_not_those_of_coupled_joints(robot, tmp_path):
    """``info --csv`` leaves them blank, which ``--limits`` reads again; a number there is refused."""
    table = tmp_path / "limits.csv"
    table.write_text(limits_csv(robot))
    assert_close(read_limits(table, robot.model).effort, robot.limits.effort, 1e-15, "read again")
    rows = [row for row in joint_rows(robot.model) if row["joint"] in WRIST]
    assert all(row[name] is None for row in rows for name in ("effort", "damping", "friction", "armature"))
    table.write_text("joint,effort\nwrist_2_joint,28\n")
    with pytest.raises(tw.ModelError, match=r"moved by motors m5, m6 together .* has no effort by itself"):
        read_limits(table, robot.model)


# ── logs and identification


def logged(robot, path, tau, names):
    """A log with positions of the joints, and torques under some names."""
    t = np.arange(0, 8, 0.01)
    q = 0.6 * np.sin(np.outer(t, [1.1, 1.7]) + np.array([0.0, 0.5])) + 0.3 * np.sin(np.outer(t, [2.9, 2.3]))
    motion = tw.Motion(t, q, robot=robot)
    header = ",".join(["time", *robot.joint_names, *names])
    np.savetxt(path, np.column_stack([t, q, tau(motion)]), delimiter=",", comments="", fmt="%.17g", header=header)
    return path


@pytest.fixture
def two_motors():
    """The planar arm with both joints coupled; torques with friction of the motors and none of the joints."""
    law = {"viscous": "0.7 N m s/rad", "coulomb": "1.5 N m"}
    coupling = {"motors": ["a", "b"], "joints": ["joint1", "joint2"], "motor_per_joint": [[1.4, 0.5], [1.0, -0.8]]}
    alone = {"couplings": {"both": coupling}, "actuators": {}}
    return tw.robots.planar_2r().with_actuators(alone | {"actuators": {"a": {"friction": law}, "b": {}}}), alone


def test_torque_columns_named_by_motors_are_combined(two_motors, tmp_path):
    """τ_j = A'τ_m, by names in the file, by --columns, and of currents with a gain."""
    robot, _ = two_motors
    path = logged(
        robot, tmp_path / "log.csv", lambda m: motor_torques(robot.model, m.torques()), ["a.torque", "b.torque"]
    )
    motion = tw.Motion.from_file(path, robot)
    assert_close(motion.tau, motion.torques(), 1e-9, "τ by names of motors")
    path = logged(robot, path, lambda m: motor_torques(robot.model, m.torques()) / [2.0, 1.0], ["Ia [A]", "other"])
    read = {"a.current": "Ia [A]", "b.tau": "other"}
    motion = tw.Motion.from_file(path, robot, columns=read, gain={"a": 2.0})
    assert_close(motion.tau, motion.torques(), 1e-9, "τ by columns=")
    path = logged(robot, path, lambda m: m.torques(), ["joint1.torque", "joint2.torque"])
    assert_close(tw.Motion.from_file(path, robot).tau, motion.torques(), 1e-9, "τ of the joints themselves")
    path = logged(robot, path, lambda m: m.torques(), ["a.torque", "joint2.torque"])
    assert tw.Motion.from_file(path, robot).tau is None


@pytest.mark.parametrize("ending", [".tau", ".torque", ".effort", ".current"])
@pytest.mark.parametrize("by", ["header", "columns", "columns of a log"])
def test_each_ending_of_a_motor_s_column_names_its_torque(two_motors, tmp_path, ending, by):
    """Of currents with gains, which are what the motors give per ampere."""
    robot, _ = two_motors
    gain = {"a": 2.0, "b": -4.0} if ending == ".current" else None
    names = [f"a{ending}", f"b{ending}"]
    header, columns = names, None
    if by != "header":
        header = ["first", "second"]
        log = "" if by == "columns" else "log.csv:"
        columns = {f"{log}{name}": column for name, column in zip(names, header, strict=True)}
    path = logged(
        robot,
        tmp_path / "log.csv",
        lambda m: motor_torques(robot.model, m.torques()) / ([2.0, -4.0] if gain else [1.0, 1.0]),
        header,
    )
    motion = tw.Motion.from_file(path, robot, columns=columns, gain=gain)
    assert_close(motion.tau, motion.torques(), 1e-9, "τ by names of motors")


@pytest.mark.parametrize("more", [["a", "b"], ["a [rad]", "b [rad]"], ["a.pos", "b.pos"], ["a.vel", "b.vel"]])
def test_positions_of_motors_beside_torques_of_the_joints_make_these_no_torques_of_motors(two_motors, tmp_path, more):
    robot, _ = two_motors
    path = logged(
        robot,
        tmp_path / "log.csv",
        lambda m: np.column_stack([m.q, m.torques()]),
        [*more, "joint1.torque", "joint2.torque"],
    )
    motion = tw.Motion.from_file(path, robot)
    assert_close(motion.tau, motion.torques(), 1e-9, "τ of the joints themselves")


def test_friction_of_coupled_motors_is_identified(two_motors, tmp_path):
    """Torques with friction of motor a: predicted to rounding of the fit with columns for motors, and not without."""
    robot, alone = two_motors
    path = logged(
        robot,
        tmp_path / "log.csv",
        lambda m: motor_torques(robot.model, m.torques(friction=True)),
        ["a.torque", "b.torque"],
    )
    seen = tw.robots.planar_2r().with_actuators(alone)
    options = {"cutoff": 20.0, "shift": 0.0, "friction_speed": 1e-3}
    found = tw.identification.identify(seen, tw.Motion.from_file(path, seen), **options)
    for name, value in (("a.viscous", 0.7), ("a.coulomb", 1.5)):  # behind the gears of A, whose diagonal is not 1
        (k,) = (k for k, group in enumerate(found.groups) if group.split(" ")[0] == name)
        assert abs(found.values[k] - value) < 0.01 * value, found.groups[k]
    motion = tw.Motion.from_file(
        path, tw.robots.planar_2r(), columns={"joint1.tau": "a.torque", "joint2.tau": "b.torque"}
    )
    joints = tw.Motion(motion.time, motion.q, tau=tw.Motion.from_file(path, seen).tau, robot=tw.robots.planar_2r())
    without = tw.identification.identify(tw.robots.planar_2r(), joints, **options)
    assert found.held_out.all < 0.1 * without.held_out.all
    with pytest.raises(tw.ValueRangeError, match="coupled motors have friction beside"):
        found.write(None, tmp_path / "new.yaml", force=True)


STAUBLI = """
couplings:
  wrist: {motors: [m5, m6], joints: [joint_5, joint_6], motor_per_joint: [[1, 0], [1, 1]]}
actuators:
  joint_1: {ratio: 32}
  joint_2: {ratio: 32}
  joint_3: {ratio: 45}
  joint_4: {ratio: -48}
  m5: {ratio: 45}
  m6: {ratio: 32}
log:
  side: motor
  joints:
    joint_2: {zero: -90 deg}
    joint_3: {zero: 90 deg}
"""


@pytest.mark.skipif(not (SHARED / "logs").is_dir(), reason="the shared logs are not here")
@pytest.mark.filterwarnings("ignore::twistwrench.ModelWarning")
def test_a_log_of_the_tx40_per_motor_identifies_as_its_joint_columns_do(tmp_path):
    """Motor columns, by their names before the gears, against joint positions and torques; 1e-9 of the largest group."""
    robot, folder = tw.load(SHARED / "robots" / "staubli_tx40.urdf"), SHARED / "logs" / "staubli_tx40"
    q, tau = (np.loadtxt(folder / f"{n}_data.csv", delimiter=",", skiprows=1)[:4000, -6:] for n in ("pos_read", "curr"))
    names = [*(f"joint_{k}" for k in range(1, 5)), "m5", "m6"]
    header, path = ",".join([*names, *(f"{n}.torque" for n in names)]), tmp_path / "motors.csv"
    np.savetxt(path, np.hstack([q, tau]), delimiter=",", comments="", fmt="%.17g", header=header)
    side = tw.identification.motor_side(robot.model, STAUBLI)
    R = np.diag([32.0, 32, 45, -48, 45, 32])
    R[5, 4] = 32
    zero = np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0])
    joints = tw.Motion(np.arange(4000) / 5000, q @ np.linalg.inv(R).T + zero, tau=tau @ R, robot=robot)
    motors = tw.identification.read_motion(path, robot, side=side, rate=5000)
    options = {"cutoff": 100.0, "shift": 0.0, "friction_speed": 0.01}
    one = tw.identification.identify(robot, motors, motor_side=side, **options)
    two = tw.identification.identify(robot, joints, motor_side=side, **options)
    assert_close(one.values, two.values, 1e-9, "groups")
    assert "m6.coulomb" in one.base.unknown.names


def test_signs_and_gains_of_a_log_go_by_motors_and_zeros_by_joints():
    arm = tw.robots.planar_2r().model
    file = {
        "couplings": {"both": {"motors": ["a", "b"], "joints": ["joint1", "joint2"], "motor_per_joint": DIFFERENTIAL}},
        "actuators": {"a": {"ratio": 10}, "b": {"ratio": 20}},
        "log": {"side": "motor", "joints": {"b": {"sign": -1, "gain": "2 N m/A"}, "joint2": {"zero": "0.5 rad"}}},
    }
    side = tw.identification.motor_side(arm, file)
    assert (
        side.ratios.tolist() == [[10, 10], [-20, 20]]
        and side.gain.tolist() == [1, 2]
        and side.zero.tolist() == [0, 0.5]
    )
    for wrong in ({"joint2": {"gain": "2 N m/A"}}, {"b": {"zero": "0.5 rad"}}, {"joint1": {"coupled": {"joint2": 1}}}):
        with pytest.raises(tw.UnknownNameError, match="no entry of log"):
            tw.identification.motor_side(arm, file | {"log": {"side": "motor", "joints": wrong}})
    with pytest.raises(tw.ModelError, match="is a coupled motor, and the log has the side of the joints"):
        tw.identification.motor_side(arm, file | {"log": {"joints": {"b": {"sign": -1}}}})


# ── edits


def test_edits_keep_the_coupling(robot):
    q, dq, ddq = random_state(robot, np.random.default_rng(4))
    tau = robot.inverse_dynamics(q, dq, ddq, friction=True)
    again = pickle.loads(pickle.dumps(robot))
    assert_close(again.inverse_dynamics(q, dq, ddq, friction=True), tau, 1e-15, "pickled")
    hand = tw.robots.pendulum()
    whole = robot.attach(hand, prefix="hand_")
    assert whole.model.drive_names[4:6] == ("m5", "m6") and whole.limits.effort[4:6].tolist() == [28.0, 28.0]
    assert_close(whole.armature[:6], robot.armature, 1e-15, "armature")
    other = hand.attach(robot, prefix="arm_")
    assert other.model.drive_names[-2:] == ("arm_m5", "arm_m6")
    held = robot.lock(dict.fromkeys(WRIST, 0.0))
    assert held.model.couplings == () and list(held.actuators) == ["elbow_joint"] and held.nv == 4
    assert robot.with_armature({"m6": 0.5}).armature[5] == 0.5
    with pytest.raises(tw.ModelError, match="cannot be locked alone"):
        robot.lock({"wrist_3_joint": 0.0})
    with pytest.raises(tw.ModelError, match="is not in that part of the robot"):
        robot.chain(None, "wrist_2_link")
    with pytest.raises(tw.ModelError, match="Describe those instead"):
        robot.with_armature({"wrist_2_joint": 0.1})
    coupling = {"motors": ["m5"], "joints": ["hinge"], "motor_per_joint": [[2.0]]}
    with pytest.raises(tw.ModelError, match="both robots have a motor called 'm5'"):
        robot.attach(hand.with_actuators({"couplings": {"one": coupling}, "actuators": {}}))


def test_parameters_of_friction_go_by_motors(robot):
    f = robot.kernel("friction_forces", parameters=("m5.viscous",))
    dq = np.array([0, 0, 0, 0, 0.4, 0.3])
    change = f(dq, np.array([1.5])) - robot.friction_forces(dq)
    assert_close(change, np.r_[np.zeros(4), 0.7, 0.7], 1e-13, "1 N m s/rad more at a motor of 0.7 rad/s")


# ── what is refused

BAD = {
    "both": ("motor_per_joint: [[1, 1], [1, -1]]", "motor_per_joint: [[1, 0], [0, 1]]\n    joint_per_motor: [[1, 0], [0, 1]]", "has both motor_per_joint and joint_per_motor"),
    "neither": ("    motor_per_joint: [[1, 1], [1, -1]]\n", "", "has neither motor_per_joint nor joint_per_motor"),
    "singular": ("[1, -1]]", "[2, 2]]", "singular matrix, of rank 1 for 2 joints"),
    "not square": ("[[1, 1], [1, -1]]", "[[1, 1]]", "has a matrix of 1 × 2 for 2 motors and 2 joints"),
    "ragged": ("[1, -1]]", "[1]]", "has rows of 2, 1 numbers"),
    "no rows": ("[[1, 1], [1, -1]]", "5", "expected rows of numbers such as"),
    "no number": ("[1, -1]]", "[1, one]]", "couplings → wrist → motor_per_joint is 'one', expected a number"),
    "infinite": ("[1, -1]]", "[1, 1e400]]", "expected a number"),
    "more motors": ("[m5, m6]", "[m5, m6, m7]", "for 3 motors and 2 joints"),
    "motor twice": ("[m5, m6]", "[m5, m5]", "names motor 'm5' twice"),
    "no list": ("[m5, m6]", "m5", "couplings → wrist → motors is 'm5', expected names in brackets"),
    "unknown joint": ("[wrist_2_joint,", "[wrist2,", "no joint named 'wrist2'"),
    "name of a joint": ("[m5, m6]", "[m5, elbow_joint]", "has the name of a joint"),
    "unknown motor": ("  m6:", "  m7:", "no joint named 'm7'"),
    "joint with its own actuator": ("  m6:", "  wrist_3_joint:", "is moved by motors m5, m6 of coupling 'wrist'"),
    "unknown entry": ("    motors: [m5", "    engines: [m5", "couplings → wrist named 'engines'"),
    "two couplings": ("motors:\n", "  again: {motors: [m1], joints: [wrist_3_joint], motor_per_joint: [[1]]}\nmotors:\n", "joint 'wrist_3_joint' is in couplings 'wrist' and 'again'"),
    "elastic": ("reflected_inertia: 0.03 kg m^2", "stiffness: 1 kN m/rad", "named 'stiffness'"),
    "rotor elsewhere": ("inertia: 20 g cm^2", "inertia: 20 g cm^2, axis: [0, 0, 1]", "counts by its inertia about its axis alone"),
    "effort of a joint": ("ratio: 101, friction: {viscous: 3 N m s/rad}", "effort: 3 N m", "named 'effort'"),
    "rotor and armature": ("rotor: {inertia: 20 g cm^2}", "rotor: {inertia: 20 g cm^2}\n    reflected_inertia: 1 kg m^2", "twice"),
    "negative effort": ("effort: 28 N m", "effort: -28 N m", "must be above 0"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_meant_is_one_clear_error(case):
    old, new, text = BAD[case]
    assert old in FILE
    with pytest.raises((tw.ModelError, tw.UnknownNameError, tw.ValueRangeError)) as problem:
        tw.robots.ur5().with_actuators(FILE.replace(old, new, 1))
    assert text in str(problem.value) and "the text given" in str(problem.value)


def still(q, robot):
    rest = np.zeros((8, 6))
    return tw.Motion(np.arange(8.0), rest + q, rest, rest, robot=robot)


REFUSED = {
    "simulate with friction": lambda r, q: r.simulate(q, 0 * q, 0.01, method="semi_implicit", friction=True),
    "rollout with friction": lambda r, q: r.rollout(
        q, 0 * q, np.zeros((3, 6)), dt=1e-3, method="semi_implicit", friction=True
    ),
    "rollout with limits": lambda r, q: r.rollout(q, 0 * q, np.zeros((3, 6)), dt=1e-3, torque_limits=True),
    "derive": lambda r, q: tw.symbolic.derive(r),
    "close": lambda r, q: r.close("ground", "tool0"),
    "equilibrium": lambda r, q: statics.robot_equilibrium(r, q, []),
    "excite": lambda r, q: tw.identification.exciting_trajectory(r, 2.0, 2),
    "size": lambda r, q: tw.size_drives(r, still(q, r), {"motors": {}}),
    "page": lambda r, q: write_page(r, "page.html"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_does_not_count_couplings_refuses_them(robot, what, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(tw.ModelError, match="does not support coupled drives"):
        REFUSED[what](robot, np.full(6, 0.3))


def test_files_of_other_formats_lose_the_coupling_and_say_so(robot):
    for write in ("to_urdf", "to_mjcf", "to_sdf"):
        with pytest.warns(tw.ModelWarning, match="is moved by coupled motors m5, m6"):
            text = getattr(robot, write)()
        again = tw.load(text)
        assert not again.armature[4:].any() and np.isinf(again.limits.effort[4:]).all()
