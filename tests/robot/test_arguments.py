"""The door for arrays: data frames by the names of their columns or refused, Dask arrays lazily, all else as np.asarray."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from quick import mostly_slow

import twistwrench as tw
from twistwrench import robots, statics, trajectories
from twistwrench.core import arguments
from twistwrench.robot.quantities import QUANTITIES

pd = pytest.importorskip("pandas")
ROWS = (1, 2, 3, 30)
"""Of which three are as many as the arm has joints."""
ONE = (
    "forward_kinematics", "link_poses", "jacobian", "mass_matrix", "gravity_forces", "holding_torques", "potential_energy",
    "center_of_mass", "com_jacobian", "christoffel", "jacobian_derivative", "mass_matrix_derivative", "task_inertia",
    "friction_forces",
)  # fmt: skip
TWO = (
    "bias_forces", "coriolis_forces", "coriolis_matrix", "kinetic_energy", "momentum", "jacobian_rate", "frame_velocity",
    "task_bias",
)  # fmt: skip
THREE = (
    "inverse_dynamics", "forward_dynamics", "regressor", "joint_wrenches", "frame_acceleration", "drive_torques",
    "inverse_dynamics_derivatives", "forward_dynamics_derivatives", "power_balance",
)  # fmt: skip
QUANTITY = [*((name, 1) for name in ONE), *((name, 2) for name in TWO), *((name, 3) for name in THREE)]


@pytest.fixture(scope="module")
def robot():
    return robots.ur5()


@pytest.fixture(scope="module")
def arm():
    return robots.planar_3r()


@pytest.fixture(scope="module")
def states():
    """q, dq and a third, thirty rows of six."""
    return np.random.default_rng(0).normal(size=(3, 30, 6))


def shuffled(robot, values, seed=1):
    """The values with named columns in another order."""
    names = list(robot.joint_names)
    order = np.random.default_rng(seed).permutation(len(names))
    return pd.DataFrame(np.asarray(values)[:, order], columns=[names[k] for k in order])


def same(found, expected):
    if isinstance(expected, tuple):
        for one, other in zip(found, expected, strict=True):
            same(one, other)
    else:
        assert type(found) in (np.ndarray, np.float64)
        assert_array_equal(found, expected)


# ── tables ──


@pytest.mark.filterwarnings("ignore:.*rows of 'tip':twistwrench.ModelWarning")
@pytest.mark.parametrize(("name", "count"), mostly_slow(QUANTITY, 2))
def test_shuffled_columns_give_the_rows_of_the_array(arm, states, name, count):
    method = getattr(arm, name)
    for rows in ROWS:
        given = states[:count, :rows, :3]
        frames = [shuffled(arm, x, seed) for seed, x in enumerate(given)]
        same(method(*frames), method(*given))
        same(method(frames[0], *given[1:]), method(*given))


def test_a_row_of_a_frame_is_one_state(robot, states):
    same(robot.gravity_forces(shuffled(robot, states[0]).iloc[3]), robot.gravity_forces(states[0, 3]))
    same(
        robot.reference("gravity_forces", shuffled(robot, states[0]).iloc[3]),
        robot.reference("gravity_forces", states[0, 3]),
    )


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda df: df.assign(time=0.0), "Foreign: time."),
        (lambda df: df.rename(columns={"elbow_joint": "elbow"}), "Foreign: elbow; missing: elbow_joint."),
        (lambda df: df.drop(columns="elbow_joint"), "Missing: elbow_joint."),
        (lambda df: pd.concat([df, df[["elbow_joint"]]], axis=1), "Twice: elbow_joint."),
        (lambda df: pd.DataFrame(df.to_numpy()), "Foreign: 0, 1, 2, 3, 4, 5; missing: shoulder_pan_joint, "),
        (lambda df: df.T, "Foreign: 0, 1, 2, 3, 4, 5; missing: shoulder_pan_joint, "),
        (lambda df: df["elbow_joint"], "Foreign: 0, 1, 2, 3, 4, 5; missing: shoulder_pan_joint, "),
    ],
)
@pytest.mark.parametrize("called_before", [0, 3])
def test_other_columns_are_named(robot, states, spoil, words, called_before):
    """As many rows as joints, so that a transpose would fit; through the builtin in front of the method, too."""
    for _ in range(called_before):
        robot.gravity_forces(states[0, 0])
    table = spoil(shuffled(robot, states[0, :6]))
    for call in (
        lambda: robot.gravity_forces(table),
        lambda: robot.inverse_dynamics(states[0, :6], table, states[2, :6]),
        lambda: robot.add(table, states[1, :6]),
        lambda: robot.power_balance(states[0, :6], states[1, :6], table),
        lambda: robot.inverse_kinematics(np.eye(4), q0=table),
    ):
        with pytest.raises(tw.UnknownNameError, match="has columns that are not the robot's") as told:
            call()
        assert words in str(told.value)
        assert "df.to_numpy()" in str(told.value)


def test_tables_of_what_has_no_names_are_refused(robot, states):
    forces = pd.DataFrame(states[1], columns=["fx", "fy", "fz", "mx", "my", "mz"])  # the force first
    for call in (
        lambda: robot.wrench_torques(states[0], forces),
        lambda: robot.holding_torques(states[0], wrench_by_robot={"tool0": forces}),
        lambda: tw.se3.exp(forces),
        lambda: tw.Wrench(forces, "tool0"),
    ):
        with pytest.raises(
            tw.ValueRangeError, match=r"has named columns \(fx, fy, fz, mx, my, mz\), and is read by position"
        ):
            call()
    same(tw.se3.exp(pd.DataFrame(states[1])), tw.se3.exp(states[1]))  # no names, nothing to mistake


def test_a_floating_robot_has_names_for_coordinates_and_others_for_rates(bundled):
    box = bundled("floating_box")
    rng = np.random.default_rng(2)
    q, dq, ddq = box.random_configuration(rng, 7), rng.normal(size=(7, 6)), rng.normal(size=(7, 6))
    frames = [
        pd.DataFrame(x[:, ::-1], columns=names[::-1])
        for x, names in ((q, box.coordinate_names), (dq, box.model.velocity_names), (ddq, box.model.velocity_names))
    ]
    same(box.inverse_dynamics(*frames), box.inverse_dynamics(q, dq, ddq))
    same(box.add(frames[0], frames[1]), box.add(q, dq))
    same(box.subtract(frames[0], frames[0].iloc[0]), box.subtract(q, q[0]))
    with pytest.raises(tw.UnknownNameError):
        box.mass_matrix(frames[1])


def test_every_other_door_reads_names(robot, states):
    q, dq, tau = (shuffled(robot, x) for x in states)
    Q, DQ, TAU = states
    law = tw.control.PD(robot, q.iloc[0], kp=100.0, kd=10.0)
    same(law(0.0, q.iloc[1], dq.iloc[1]), tw.control.PD(robot, Q[0], kp=100.0, kd=10.0)(0.0, Q[1], DQ[1]))
    same(
        statics.wrench_from_torques(robot, q.iloc[0], tau.iloc[0]).wrench,
        statics.wrench_from_torques(robot, Q[0], TAU[0]).wrench,
    )
    same(
        trajectories.joint_line(robot, q.iloc[0], q.iloc[1])(0.3)[0], trajectories.joint_line(robot, Q[0], Q[1])(0.3)[0]
    )
    same(robot.rollout(q, dq, tau.iloc[0], steps=3).q, robot.rollout(Q, DQ, TAU[0], steps=3).q)
    same(
        robot.simulate(q.iloc[0], dq.iloc[0], 0.002, 1e-3, method="rk4").q,
        robot.simulate(Q[0], DQ[0], 0.002, 1e-3, method="rk4").q,
    )
    same(robot.explain(q, dq, tau).torque, robot.explain(Q, DQ, TAU).torque)
    same(robot.closed_form(q.iloc[0], dq.iloc[0]).M, robot.closed_form(Q[0], DQ[0]).M)
    arm = robots.planar_3r()
    held = arm.close("ground", arm.tip, rows="vx vz", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
    near = np.array([[-0.6, 0.2, 2.2]] * 3)
    same(held.consistent(pd.DataFrame(near[:, ::-1], columns=arm.coordinate_names[::-1])), held.consistent(near))


def test_an_axis_with_labels_is_read_by_them(robot, states):
    """As xarray has them: the last of ``dims``, its labels in ``coords``."""
    names = list(robot.joint_names)[::-1]
    table = SimpleNamespace(
        dims=("time", "joint"),
        coords={"joint": SimpleNamespace(values=np.array(names))},
        data=states[0][:, ::-1].copy(),
    )
    same(robot.gravity_forces(table), robot.gravity_forces(states[0]))
    table.coords["joint"].values[0] = "elbow"
    with pytest.raises(tw.UnknownNameError, match="Foreign: elbow; missing: wrist_3_joint"):
        robot.gravity_forces(table)


# ── other arrays ──


def test_masked_entries_are_refused_and_others_are_plain(robot, states):
    q = states[0]
    expected = robot.gravity_forces(q)
    for given in (np.ma.masked_less(q, -99.0), q.view(np.matrix), q.tolist(), np.asfortranarray(q), list(q)):
        found = robot.gravity_forces(given)
        same(found, expected)
    with pytest.raises(tw.ValueRangeError, match=r"gravity_forces: q has \d+ masked entries"):
        robot.gravity_forces(np.ma.masked_less(q, 0.0))
    with pytest.raises(tw.ValueRangeError, match="masked entries"):
        tw.se3.exp(np.ma.masked_less(q, 0.0))


def test_float32_stays_float32(robot, states):
    single = shuffled(robot, states[0].astype(np.float32))
    assert robot.gravity_forces(single).dtype == np.float32
    assert robot.mass_matrix(states[0].astype(np.float32)).dtype == np.float32


def test_results_are_fresh(robot, states):
    table = shuffled(robot, states[0])
    before = table.copy()
    for method in (robot.gravity_forces, robot.mass_matrix, lambda q: robot.add(q, np.zeros(6))):
        found = method(table)
        found[...] = 0.0
        assert table.equals(before)


def test_every_quantity_has_a_door():
    """A method of every quantity brings its arrays in: the table of quantities grows, and this list with it."""
    known = {name for name, _ in QUANTITY} | {"mass_matrix", "momentum", "add", "subtract", "coordinate_rates"}
    without_frames = {  # inputs without names, or parts of other methods
        "wrench_torques", "closure_poses", "constrained_dynamics", "constraint_bias", "constraint_jacobian",
        "friction_under_load", "torque_past_friction", "momentum_about_com",
    }  # fmt: skip
    assert set(QUANTITIES) <= known | without_frames


def test_whole_and_positive():
    assert arguments.whole(3.0, "n") == 3
    assert arguments.positive(0, "x", zero=True) == 0.0
    for call in (
        lambda: arguments.whole(2.5, "n"),
        lambda: arguments.whole(1, "n", 2),
        lambda: arguments.whole("two", "n"),
        lambda: arguments.positive(0, "x", "m"),
        lambda: arguments.positive(np.inf, "x"),
        lambda: arguments.positive(np.nan, "x"),
    ):
        with pytest.raises(tw.ValueRangeError, match=r"^[nx] is "):
            call()


# ── a robot without mass ──


def test_a_robot_without_mass_has_no_centre_of_mass():
    text = (
        '<robot name="empty"><link name="a"/><link name="b"/><joint name="j" type="continuous"><parent link="a"/>'
        '<child link="b"/></joint></robot>'
    )
    empty = tw.load(text)
    for call in (
        lambda: empty.center_of_mass([0.0]),
        lambda: empty.com_jacobian([0.0]),
        lambda: empty.momentum([0.0], [1.0], "com"),
        lambda: empty.reference("center_of_mass", [0.0]),
        lambda: empty.kernel("center_of_mass", by="q"),
    ):
        with pytest.raises(tw.ValueRangeError, match=r"no moving body of robot 'empty' has mass \(b\)"):
            call()
    assert empty.kernel("center_of_mass", parameters=("b.mass", "b.com_x"))([0.0], [2.0, 1.0]).tolist() == [
        1.0,
        0.0,
        0.0,
    ]


@pytest.mark.parametrize("batch", [(), (2,)], ids=["one", "batch"])
@pytest.mark.parametrize("place", list(np.ndindex(3, 3)))
def test_each_entry_of_a_rotation_is_looked_at(place, batch):
    R = np.tile(tw.so3.exp([0.3, -0.5, 0.7]), (*batch, 1, 1))
    assert arguments.rotation(R, "R") is R
    R[..., *place] += 1e-3
    with pytest.raises(tw.ValueRangeError, match="R is not a rotation"):
        arguments.rotation(R, "R")


@pytest.mark.parametrize(
    "name, kind", [("LOCAL", "body"), ("WORLD", "space"), ("LOCAL_WORLD_ALIGNED", "world_aligned")]
)
def test_frames_of_jacobians_by_their_names_in_pinocchio_are_translated(name, kind):
    arm = tw.robots.planar_2r()
    with pytest.raises(tw.UnknownNameError, match=f"Pinocchio's name for kind='{kind}', which has angular rows first"):
        arm.jacobian([0, 0], kind=name)


OTHERS = {
    "rnea": ("inverse_dynamics", "robot.inverse_dynamics(q, dq, ddq)"),
    "crba": ("mass_matrix", "robot.mass_matrix(q)"),
    "aba": ("forward_dynamics", "robot.forward_dynamics(q, dq, tau)"),
    "mj_inverse": ("inverse_dynamics", "robot.inverse_dynamics(q, dq, ddq)"),
    "centroidal_momentum": ("momentum_about_com", 'robot.momentum(q, dq, frame="com")'),
}


@pytest.mark.parametrize("name", OTHERS)
def test_names_of_other_libraries_lead_to_ours(name):
    robot, (quantity, call) = tw.robots.planar_2r(), OTHERS[name]
    for ask in (robot.kernel, robot.to_jax):
        with pytest.raises(tw.UnknownNameError, match=f"name for '{quantity}'"):
            ask(name)
    with pytest.raises(AttributeError) as caught:
        getattr(robot, name)
    assert f": use {call}" in str(caught.value) and not hasattr(robot, name)


def test_each_quantity_is_a_method_or_its_error_names_the_call():
    robot = tw.robots.planar_2r()
    without = {name for name in QUANTITIES if not hasattr(type(robot), name)}
    assert "momentum_about_com" in without and "mass_matrix" not in without
    for name in without:
        with pytest.raises(AttributeError, match=r"use robot\.(kernel|momentum)\("):
            getattr(robot, name)
    with pytest.raises(AttributeError, match=r"object has no attribute 'elbow'$"):
        robot.elbow  # noqa: B018
