"""Task space, F = Λ dV + η: the book's numbers, laws on random trees, and what happens where directions are lost."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from random_trees import ROUNDING, frames

import twistwrench as tw
from twistwrench.mechanics.algorithms.kinematics import row_numbers
from twistwrench.mechanics.lie.labelled import TWIST
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.testing import assert_close, derivative, random_robot, random_state

pytest_plugins = ("random_tree_fixtures",)

PLANE = {"kind": "world_aligned", "rows": "vx vz"}
"""The two rows of J that a planar arm uses, in the axes of the book's drawing."""
LOST = r"of the 6 rows of 'tip' \('body'\) only 2 .*: wx wy vz never move and the others determine wz\..*rows='vx vy'"
KINDS = ("body", "space", "world_aligned")


@pytest.fixture(scope="module")
def arm():
    return tw.robots.planar_2r()


@pytest.fixture(scope="module")
def ur5():
    return tw.robots.ur5()


# ── numbers ──


def test_the_book_s_2r_arm_with_the_elbow_at_a_right_angle(arm):
    q = np.array([0.0, np.pi / 2])
    assert_close(arm.mass_matrix(q), [[3, 1], [1, 1]], 1e-15, "M")
    assert_close(arm.task_inertia(q, **PLANE), np.diag([1.0, 2.0]), 1e-15, "Λ")


def test_the_book_s_2r_arm_with_the_elbow_at_150_degrees(arm):
    q = np.radians([0.0, 150.0])
    assert arm.mass_matrix(q).round(3).tolist() == [[1.268, 0.134], [0.134, 1.0]]
    assert arm.task_inertia(q, **PLANE).round(3).tolist() == [[4.0, -1.732], [-1.732, 2.0]]


# ── laws ──


@pytest.mark.parametrize("kind", KINDS)
def test_with_a_square_jacobian_the_terms_are_the_book_s(ur5, kind):
    q, dq, _ = random_state(ur5, 3, size=5)
    J, dJ, M, h = (
        ur5.jacobian(q, kind=kind),
        ur5.jacobian_rate(q, dq, kind=kind),
        ur5.mass_matrix(q),
        ur5.bias_forces(q, dq),
    )
    Ji = np.linalg.inv(J)
    Lambda = np.swapaxes(Ji, 1, 2) @ M @ Ji  # J⁻ᵀ M J⁻¹
    V = J @ dq[..., None]
    eta = np.swapaxes(Ji, 1, 2) @ h[..., None] - Lambda @ dJ @ Ji @ V
    tolerance = 1e-15 * np.linalg.cond(J).max() ** 2
    assert_close(ur5.task_inertia(q, kind=kind), Lambda, tolerance, "Λ")
    assert_close(ur5.task_bias(q, dq, kind=kind), eta[..., 0], tolerance, "η")


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrench_at_the_hand_moves_it_as_task_space_says(ur5, kind):
    """F = Λ dV + η along motions: torques J'F, accelerations from forward dynamics, dV by differences along the motion."""
    rng = np.random.default_rng(4)
    q, dq, _ = random_state(ur5, rng)
    rows = [0, 2, 4, 5]
    J = ur5.jacobian(q, kind=kind)[rows]
    F = 10 * rng.standard_normal(4)
    ddq = ur5.forward_dynamics(q, dq, J.T @ F)

    def V(t):
        t = t[:, None]
        return ur5.frame_velocity(q + t * dq + 0.5 * t**2 * ddq, dq + t * ddq, kind=kind)[:, rows]

    dV = derivative(V, np.abs(dq).sum() + np.sqrt(np.abs(ddq).sum()))
    Lambda, eta = ur5.task_inertia(q, kind=kind, rows=rows), ur5.task_bias(q, dq, kind=kind, rows=rows)
    scale = np.abs(Lambda).max() * np.abs(dV).max()
    assert_close(Lambda @ dV + eta, F, 1e-9, "F = Λ dV + η", scale=max(scale, np.abs(F).max()))


def test_torques_the_hand_cannot_feel_change_nothing_there(ur5):
    """With fewer rows than joints: torques in the null space of J M⁻¹ leave dV as it was, so F = Λ dV + η for the rest."""
    rng = np.random.default_rng(6)
    q, dq, _ = random_state(ur5, rng)
    J, M = ur5.jacobian(q)[3:], ur5.mass_matrix(q)
    Lambda, eta = ur5.task_inertia(q, rows=TWIST[3:]), ur5.task_bias(q, dq, rows="vx, vy, vz")
    tau = 10 * rng.standard_normal(6)
    dV = ur5.frame_acceleration(q, dq, ur5.forward_dynamics(q, dq, tau))[3:]
    felt = Lambda @ J @ np.linalg.solve(M, tau)  # the F with the same dV
    assert_close(Lambda @ dV + eta, felt, 1e-10, "F = Λ dV + η", scale=np.abs(eta).max())


def test_rows_choose_before_the_inverse_is_taken(arm, ur5):
    q = np.array([0.3, 1.0])
    both = arm.task_inertia(q, **PLANE)
    one = arm.task_inertia(q, kind="world_aligned", rows="vx")
    assert_close(one, [[np.linalg.det(both) / both[1, 1]]], 1e-14, "the free z makes x lighter: a Schur complement")
    turned = arm.task_inertia(q, kind="world_aligned", rows=("vz", "vx"))
    assert_close(turned, both[::-1, ::-1], 1e-15, "in the order given")
    q = ur5.random_configuration(0)
    assert_close(ur5.task_inertia(q, rows=range(6)), ur5.task_inertia(q), 0.0)


# ── singular configurations ──


def test_a_stretched_arm_is_infinitely_heavy_along_itself_and_says_so(arm):
    q = np.zeros(2)
    assert_close(arm.task_inertia(q, **PLANE), np.diag([0.0, 1.0]), 1e-12, "Λ")
    assert_close(np.abs(arm.lost_directions(q, **PLANE)), [[1.0, 0.0]], 1e-12, "along the arm")
    assert arm.lost_directions([0, 0.5], **PLANE).shape == (0, 2)
    assert_close(arm.task_bias(q, [1, 1], **PLANE), [0, 9.81], 1e-12, "η: the weight of the outer mass")
    assert len(arm.lost_directions([0.3, 1.0])) == 4  # wx, wz, vy, and one of wy, vx, vz


def test_rows_that_are_lost_everywhere_are_named_once_with_independent_ones():
    arm = tw.robots.planar_2r()
    with pytest.warns(tw.ModelWarning, match=LOST) as told:
        Lambda = arm.task_inertia([0.3, 1.0])
        arm.task_inertia([0.3, 1.1])
        arm.task_bias([0.3, 1.1], [1.0, 1.0])
    assert len(told) == 1
    assert told[0].filename == __file__
    assert_close(Lambda[[0, 1, 5]], np.zeros((3, 6)), 1e-14, "no motion, no inertia", scale=1.0)
    with pytest.warns(
        tw.ModelWarning, match=r"of the 3 rows of 'tip' \('world_aligned'\) only 2 .*: vy never move\. .*'vx vz'"
    ):
        arm.task_inertia([0.3, 1.0], kind="world_aligned", rows="vx vy vz")
    with pytest.warns(tw.ModelWarning, match=": the others determine wy"):
        arm.task_inertia([0.3, 1.0], kind="world_aligned", rows="wy vx vz")
    with pytest.warns(tw.ModelWarning, match="does not move along any of them"):
        arm.task_bias([0.3, 1.0], [1.0, 1.0], kind="world_aligned", rows="vy")


def test_rows_that_are_lost_at_single_configurations_are_not_called_lost(arm, ur5):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.task_inertia([[0.0, 0.0], [0.0, np.pi / 2]], **PLANE)
        ur5.task_inertia(ur5.neutral)


def test_lost_directions_of_a_batch_are_those_of_its_samples_and_then_zeros(arm, ur5):
    q = np.array([[[0.3, 1.0], [0.7, 0.0], [0.2, np.pi]], [[0.1, 0.5], [0.0, 0.0], [1.0, 1.0]]])
    lost = arm.lost_directions(q, **PLANE)
    assert lost.shape == (2, 3, 1, 2)
    for index in np.ndindex(2, 3):
        alone = arm.lost_directions(q[index], **PLANE)
        assert len(alone) == int(q[index][1] in (0.0, np.pi))
        assert_close(lost[index][: len(alone)], alone, 1e-12, "its own")
        assert not lost[index][len(alone) :].any()
    assert arm.lost_directions(q[:, ::2][..., :1, :], **PLANE).shape == (2, 1, 0, 2)
    assert arm.lost_directions(np.zeros((0, 2)), **PLANE).shape == (0, 0, 2)
    some = ur5.lost_directions(np.stack([ur5.neutral, ur5.random_configuration(0)]))
    assert some.shape == (2, 1, 6)
    assert not some[1].any()


@pytest.mark.parametrize("angle", [1e-2, 1e-4, 1e-5, 1e-6])
def test_near_the_singular_configuration_the_inertia_grows_as_it_should(arm, angle):
    """Elimination, then singular values: both against the exact Λ = J⁻ᵀ M J⁻¹ of the 2R arm in fifty digits.

    The arm points aslant, so that the lost direction is in both rows and the pivot is what is left of a cancellation.
    """
    mpmath = pytest.importorskip("mpmath")
    q = np.array([0.7, angle])
    with mpmath.workdps(50):
        a, t = mpmath.mpf(q[0]), mpmath.mpf(q[1])
        c = mpmath.cos(t)
        M = mpmath.matrix([[3 + 2 * c, 1 + c], [1 + c, 1]])
        x, z = -mpmath.sin(a + t), mpmath.cos(a + t)
        inverse = mpmath.matrix([[x - mpmath.sin(a), x], [z + mpmath.cos(a), z]]) ** -1
        exact = inverse.T * M * inverse
        expected = np.array([[float(exact[i, j]) for j in range(2)] for i in range(2)])
    # Rounding of q and J moves the singular value, which is some `angle`, by 1e-16.
    assert_close(arm.task_inertia(q, **PLANE), expected, max(1e-9, 1e-14 / angle), "Λ")


def test_singular_samples_of_a_batch_leave_the_others_alone(arm):
    q = np.array([[[0.0, 0.5], [0.0, 0.0]], [[0.3, np.pi], [0.1, 1.0]]])
    dq = np.array([1.0, -1.0])
    Lambda, eta = arm.task_inertia(q, **PLANE), arm.task_bias(q, dq, **PLANE)
    assert np.isfinite(Lambda).all()
    for index in np.ndindex(2, 2):
        assert_close(Lambda[index], arm.task_inertia(q[index], **PLANE), ROUNDING)
        assert_close(eta[index], arm.task_bias(q[index], dq, **PLANE), ROUNDING)


def test_at_a_singular_configuration_the_terms_give_what_the_hand_feels(ur5):
    """F = Λ dV + η without the part of F that the structure bears."""
    q, dq = ur5.neutral, np.random.default_rng(0).standard_normal(6)
    lost = ur5.lost_directions(q)
    assert len(lost) == 1
    F = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    felt = F - lost.T @ (lost @ F)
    dV = ur5.frame_acceleration(q, dq, ur5.forward_dynamics(q, dq, ur5.jacobian(q).T @ F))
    Lambda, eta = ur5.task_inertia(q), ur5.task_bias(q, dq)
    assert_close(Lambda @ dV + eta, felt, 1e-8, "F = Λ dV + η", scale=np.abs(Lambda).max() * np.abs(dV).max())


def test_single_precision_stays_single_and_is_as_good_as_it_can(arm):
    q = np.array([[0.2, 1.0], [0.0, 0.0], [0.0, 1e-2]], np.float32)
    Lambda = arm.task_inertia(q, **PLANE)
    assert Lambda.dtype == np.float32
    assert_close(Lambda, arm.task_inertia(q.astype(float), **PLANE), 1e-4, "float32")


def test_single_precision_is_as_good_near_a_singular_configuration_as_away_from_it(arm):
    """Elimination of A M⁻¹ A' loses 1/σ² of float32's rounding, 1e-2 at an elbow 3 mrad from straight; singular values 1/σ."""
    elbow = 10.0 ** np.linspace(-3.5, 0, 60)
    q = np.stack([np.full_like(elbow, 0.2), elbow], axis=-1).astype(np.float32)
    exact = arm.task_inertia(q.astype(float), **PLANE)
    off = np.abs(arm.task_inertia(q, **PLANE) - exact).max(axis=(1, 2)) / np.abs(exact).max(axis=(1, 2))
    assert off.max() < 1e-5  # 80 units in the last place; 1.4e-6 was measured


# ── rows, and what is refused ──


def test_rows_by_name_number_and_all():
    assert row_numbers(None) == (0, 1, 2, 3, 4, 5)
    assert (
        row_numbers("wx vz")
        == row_numbers(["wx", "vz"])
        == row_numbers((0, np.int64(5)))
        == row_numbers("wx,vz")
        == (0, 5)
    )


@pytest.mark.parametrize(
    ("rows", "error", "told"),
    [
        ("vx vw", tw.UnknownNameError, "no row of a twist named 'vw'.*Known: wx, wy, wz, vx, vy, vz"),
        ((0, 7), tw.ValueRangeError, "row 7 is out of range.*0 to 5"),
        ((-1,), tw.ValueRangeError, "row -1 is out of range"),
        ("vx vx", tw.ValueRangeError, "names a row twice: vx, vx"),
        ("", tw.ValueRangeError, "names no row"),
        ([[0, 1]], tw.ShapeError, "a name or a number"),
        (True, tw.ShapeError, "give names"),
        ((True,), tw.ShapeError, "got True"),
    ],
)
def test_rows_that_cannot_be_meant(arm, rows, error, told):
    for call in (arm.task_inertia, arm.lost_directions, lambda q, rows: arm.kernel("task_inertia", rows=rows)):
        with pytest.raises(error, match=told):
            call([0, 1], rows=rows)


def test_shapes_frames_and_kinds_are_checked(arm):
    with pytest.raises(tw.ShapeError, match=r"task_inertia: q has shape \(3,\)"):
        arm.task_inertia([0, 1, 2])
    with pytest.raises(tw.ShapeError, match=r"task_bias: dq has shape \(1,\)"):
        arm.task_bias([0, 1], [1])
    with pytest.raises(tw.UnknownNameError, match="no frame named 'hand'"):
        arm.task_inertia([0, 1], "hand")
    with pytest.raises(tw.UnknownNameError, match="spatial"):
        arm.task_bias([0, 1], [0, 0], kind="spatial")
    with pytest.raises(tw.ShapeError, match=r"lost_directions: q has shape \(2, 3\)"):
        arm.lost_directions(np.zeros((2, 3)))


def test_a_robot_without_inertia_says_so():
    builder = ModelBuilder("nothing")
    builder.add_link("base")
    builder.add_link("ghost")
    builder.add_joint("turn", "continuous", "base", "ghost")
    ghost = tw.Robot(builder.build())
    for call in (ghost.task_inertia, ghost.lost_directions):
        with pytest.raises(tw.SingularMassMatrixError, match="turn"):
            call([0.0], "ghost", rows="wx")
    with pytest.raises(tw.SingularMassMatrixError, match="turn"):
        ghost.close("ground", "ghost", "wx")


def test_what_comes_in_as_nan_goes_out_as_nan(arm):
    Lambda = arm.task_inertia([[0.0, 0.0], [np.nan, 1.0], [0.0, np.pi / 2]], **PLANE)
    assert np.isnan(Lambda[1]).all()
    assert_close(Lambda[[0, 2]], [np.diag([0.0, 1.0]), np.diag([1.0, 2.0])], 1e-12)
    with pytest.raises(tw.ValueRangeError, match="lost_directions: q has the entry nan"):
        arm.lost_directions([0.0, np.nan])


def test_a_robot_that_cannot_move_has_no_inertia_to_show(arm):
    fixed = arm.lock({"joint1": 0.0, "joint2": 0.5})
    assert fixed.nv == 0
    assert_close(fixed.task_inertia(np.zeros(0), "tip", rows="vx vz"), np.zeros((2, 2)), 0.0, scale=1.0)
    assert_close(fixed.task_bias(np.zeros((3, 0)), np.zeros(0), "tip", rows="vx"), np.zeros((3, 1)), 0.0, scale=1.0)
    assert fixed.lost_directions(np.zeros(0), "tip").shape == (6, 6)
    with pytest.raises(tw.KernelError, match="no joint that moves"):
        fixed.kernel("task_inertia", frame="tip")


def test_the_reference_says_where_it_stops(arm):
    with pytest.raises(tw.ValueRangeError, match=r"task_inertia: .* singular"):
        arm.reference("task_inertia", [0.0, 0.0], **PLANE)


def test_the_kernel_has_the_pivots_beside_the_result(arm):
    kernel = arm.kernel("task_inertia", **PLANE)
    assert kernel.signature == "(2)->(2,2),(2)"
    Lambda, pivots = kernel([0.0, np.pi / 2])
    assert_close(np.prod(pivots), 1 / np.linalg.det(Lambda), 1e-14, "det J M⁻¹ J' is the product of its pivots")
    reference = arm.reference("task_inertia", [0.0, np.pi / 2], **PLANE)
    assert_close(reference[0], Lambda, ROUNDING, "Λ"), assert_close(reference[1], pivots, ROUNDING, "pivots")


# ── any tree; last, for what uses on_numpy leaves the rest of a file without compiled code ──


@pytest.mark.usefixtures("on_numpy")
def test_task_inertia_is_the_inverse_of_the_mobility_on_any_tree(robot, state):
    q, _, _ = state
    frame = frames(robot)[0]
    J, M = robot.jacobian(q, frame), robot.mass_matrix(q)
    S = J @ np.linalg.solve(M, J.T)
    # Pseudo-inverses: on every row, in whatever number of directions the frame can be moved in.
    rows = [k for k in range(6) if np.abs(J[k]).max() > 1e-9]
    kept = _independent(S, rows)
    Lambda = robot.task_inertia(q, frame, rows=kept)
    part = S[np.ix_(kept, kept)]
    assert_close(Lambda, np.linalg.inv(part), 1e-14 * np.linalg.cond(part) * np.linalg.cond(M), "Λ")
    assert (Lambda == Lambda.T).all()
    every = robot.task_inertia(q, frame)
    assert_close(S @ every @ S, S, 1e-9, "S Λ S = S on all rows")
    lost = robot.lost_directions(q, frame)
    assert lost.shape == (6 - np.linalg.matrix_rank(J, tol=1e-8), 6)
    assert_close(lost @ J, np.zeros((len(lost), robot.nv)), 1e-8, "F'J = 0", scale=np.abs(J).max())
    assert_close(every @ lost.T, np.zeros((6, len(lost))), 1e-7, "Λ F = 0", scale=np.abs(every).max())


def _independent(S, rows):
    """Some rows on which S is well away from singular."""
    kept = []
    for k in rows:
        d = np.sqrt(np.diagonal(S)[[*kept, k]])
        if np.linalg.eigvalsh(S[np.ix_([*kept, k], [*kept, k])] / np.outer(d, d)).min() > 1e-3:
            kept.append(k)
    return kept


@pytest.mark.usefixtures("on_numpy")
def test_any_robot_any_rows_never_end_in_a_raw_error():
    for seed in range(2):
        robot = random_robot(seed, joints=5, floating_base=seed % 2 == 0)
        q, dq, _ = random_state(robot, seed)
        for frame in frames(robot):
            assert np.isfinite(robot.task_inertia(q, frame)).all()
            assert np.isfinite(robot.task_bias(q, dq, frame)).all()
