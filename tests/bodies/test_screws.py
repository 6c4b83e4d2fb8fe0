"""Twists, wrenches and poses with the names of their frames: the laws of part A, and mistakes that must not pass."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import twistwrench as tw
from twistwrench.mechanics.lie import se3, so3
from twistwrench.mechanics.lie.axis import axis_of, line_of_action, reciprocal_product, screw_axis, wrench_along
from twistwrench.mechanics.lie.twist_wrench import move_covariance
from twistwrench.testing.strategies import seeds

EPS = np.finfo(float).eps
quick = settings(max_examples=50, deadline=None)


def random(seed: int, *size: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=size)


def pose(seed: int, to: str, of: str, *batch: int) -> tw.Pose:
    return tw.Pose(se3.exp(random(seed, *batch, 6)), to=to, of=of)


def gap(a, b) -> float:
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b)), initial=0.0))


# ── the worked example: a hand and an apple on a six-axis sensor ──

T_HF = tw.Pose([[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], to="h", of="f")
T_AF = tw.Pose([[1, 0, 0, -0.25], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], to="a", of="f")
F_H = tw.Wrench([0, 0, 0, 0, -5, 0], "h")
F_A = tw.Wrench([0, 0, 0, 0, 0, 1], "a")


def test_hand_and_apple_to_the_last_digit():
    F_f = T_HF.inverse @ F_H + T_AF.inverse @ F_A
    assert F_f.frame == "f"
    assert F_f.values.tolist() == [0, 0, -0.75, 0, -6, 0]
    assert (tw.Ad(T_HF.matrix).T @ F_H.values + tw.Ad(T_AF.matrix).T @ F_A.values).tolist() == F_f.values.tolist()
    assert sum([T_HF.inverse @ F_H, T_AF.inverse @ F_A]).values.tolist() == F_f.values.tolist()


def test_the_wrong_forms_give_other_numbers():
    right = np.array([0, 0, -0.75, 0, -6, 0])
    h, a = T_HF.matrix, T_AF.matrix
    without_transpose = tw.Ad(h) @ F_H.values + tw.Ad(a) @ F_A.values
    inverse_instead = tw.Ad(se3.inverse(h)).T @ F_H.values + tw.Ad(se3.inverse(a)).T @ F_A.values
    without_frames = F_H.values + F_A.values
    for wrong in (without_transpose, inverse_instead, without_frames):
        assert gap(wrong, right) > 0.2


# ── laws ──


def test_power_is_the_same_in_a_thousand_frames():
    V_b, F_b = tw.Twist(random(0, 6), "b"), tw.Wrench(random(1, 6), "b")
    T_ab = pose(2, "a", "b", 1000)
    power = (T_ab @ F_b) @ (T_ab @ V_b)
    assert power.shape == (1000,)
    assert gap(power, F_b @ V_b) <= 1e-12
    assert (T_ab @ V_b) @ (T_ab @ F_b) == pytest.approx(power, abs=1e-13)
    forces_only = np.sum((T_ab @ F_b).f * (T_ab @ V_b).v, axis=-1)  # "power is F v" leaves the moment out
    without_transpose = np.sum((tw.Ad(T_ab.matrix) @ F_b.values) * (T_ab @ V_b).values, axis=-1)
    assert np.median(np.abs(forces_only - F_b.f @ V_b.v)) > 0.1
    assert np.median(np.abs(without_transpose - F_b @ V_b)) > 0.1


@quick
@given(seeds())
def test_poses_compose_and_undo(seed):
    T_ab, T_bc = pose(seed, "a", "b"), pose(seed + 1, "b", "c")
    V_c, F_c = tw.Twist(random(seed + 2, 6), "c"), tw.Wrench(random(seed + 3, 6), "c")
    T_ac = T_ab @ T_bc
    assert (T_ac.to, T_ac.of) == ("a", "c")
    for x in (V_c, F_c):
        moved = T_ab @ (T_bc @ x)
        assert moved.frame == "a"
        assert gap((T_ac @ x).values, moved.values) <= 1e-12
        assert gap((T_ac.inverse @ moved).values, x.values) <= 1e-12
    assert gap((T_ac.inverse @ T_ac).matrix, np.eye(4)) <= 1e-14
    assert (T_ac.inverse.to, T_ac.inverse.of) == ("c", "a")


@quick
@given(seeds())
def test_the_bracket_is_a_lie_bracket_and_moves_with_the_frame(seed):
    U, V, W = (tw.Twist(x, "b") for x in random(seed, 3, 6))
    T_ab = pose(seed, "a", "b")
    assert np.array_equal(U.bracket(V).values, -V.bracket(U).values)
    jacobi = U.bracket(V.bracket(W)) + V.bracket(W.bracket(U)) + W.bracket(U.bracket(V))
    assert gap(jacobi.values, 0) <= 1e-12
    assert gap((T_ab @ U.bracket(V)).values, (T_ab @ U).bracket(T_ab @ V).values) <= 1e-11
    # A7 with its blocks exchanged, [[ω], [v]; 0, [ω]], is not the bracket.
    wrong = np.concatenate([so3.cross(U.omega, V.omega) + so3.cross(U.v, V.v), so3.cross(U.omega, V.v)])
    assert gap(wrong, U.bracket(V).values) > 1e-3


@quick
@given(seeds())
def test_sums_are_linear_and_keep_their_frame(seed):
    A, B = tw.Wrench(random(seed, 3, 6), "b"), tw.Wrench(random(seed + 1, 3, 6), "b")
    assert gap((2 * A - B / 4 + -A).values, A.values - B.values / 4) <= 2e-14
    assert (np.array([1.0, 2.0, 3.0]) * A).values[2] == pytest.approx(3 * A.values[2])
    T_ab = pose(seed, "a", "b")
    assert gap((T_ab @ (A + B)).values, ((T_ab @ A) + (T_ab @ B)).values) <= 1e-12


# ── adjoints of what has names ──


@quick
@given(seeds())
def test_adjoints_keep_the_names_of_the_frames(seed):
    T_ab, V_b, W_b = pose(seed, "a", "b", 3), tw.Twist(random(seed + 1, 6), "b"), tw.Twist(random(seed + 2, 6), "b")
    F_a, P_b = tw.Wrench(random(seed + 3, 6), "a"), tw.Wrench(random(seed + 4, 6), "b")
    X = tw.Ad(T_ab)
    moved = (X @ V_b, X.T @ F_a, tw.ad(V_b) @ W_b, tw.ad(V_b).T @ P_b, X.T.T @ V_b)
    assert [(type(x).__name__, x.frame) for x in moved] == [
        ("Twist", "a"), ("Wrench", "b"), ("Twist", "b"), ("Wrench", "b"), ("Twist", "a"),
    ]  # fmt: skip
    assert gap((X @ V_b).values, np.einsum("nij,j->ni", X.matrix, V_b.values)) <= 1e-13
    assert gap((T_ab @ V_b).values, (X @ V_b).values) == 0
    assert gap((T_ab.inverse @ F_a).values, (X.T @ F_a).values) <= 1e-13
    assert gap((X.T @ F_a) @ V_b, F_a @ (X @ V_b)) <= 1e-12
    assert gap((tw.ad(V_b).T @ P_b) @ W_b, P_b @ (tw.ad(V_b) @ W_b)) <= 1e-12
    assert type(X @ V_b.values) is np.ndarray  # arrays stay arrays
    assert gap(X @ V_b.values, (X @ V_b).values) == 0


def test_a_pose_of_many_products_still_moves_and_inverts():
    # Each is as far from a rotation as a pose may be; their product is further, and follows from poses all the same.
    bent = np.eye(4)
    bent[0, 0] += 4.9e-7
    T = tw.Pose(bent, "a", "b") @ tw.Pose(bent, "b", "c") @ tw.Pose(bent, "c", "d")
    with pytest.raises(tw.ValueRangeError, match="not a rotation"):
        tw.Pose(T.matrix, "a", "d")
    F = tw.Wrench(random(0, 6), "d")
    assert gap((T.inverse @ (T @ F)).values, F.values) <= 2e-5
    assert move_covariance(T, np.eye(6)).shape == (6, 6)


# ── axes ──


@quick
@given(seeds(), st.floats(-3, 3) | st.just(np.inf))
def test_axes_there_and_back(seed, pitch):
    direction, point = random(seed, 2, 3)
    axis = axis_of(2.5 * screw_axis(direction, point, pitch))
    s = direction / np.linalg.norm(direction)
    assert gap(axis.direction, s) <= 4 * EPS
    assert axis.magnitude == pytest.approx(2.5)
    assert axis.pitch == pytest.approx(pitch, abs=1e-14)
    assert np.isinf(pitch) or gap(so3.cross(axis.point - point, s), 0) <= 1e-13  # on the same line
    assert abs(axis.point @ s) <= 1e-14  # its nearest point
    action = line_of_action(2.5 * wrench_along(direction, point, pitch))
    assert all(gap(a, b) == 0 for a, b in zip(action[:2], axis[:2], strict=True))


@quick
@given(seeds())
def test_the_screw_of_an_axis_fixes_it_and_its_axis_moves_with_the_frame(seed):
    direction, point = random(seed, 2, 3)
    V = screw_axis(direction, point, pitch=0.3)
    s, q = axis_of(V)[:2]
    assert gap(se3.exp(0.7 * V)[:3, :3] @ q + se3.exp(0.7 * V)[:3, 3], q + 0.7 * 0.3 * s) <= 1e-13
    T = pose(seed + 5, "a", "b")
    moved = (T @ tw.Twist(V, "b")).axis
    assert gap(moved.direction, T.rotation @ s) <= 1e-14
    assert moved.pitch == pytest.approx(0.3, abs=1e-13)
    assert gap(so3.cross(T.rotation @ q + T.position - moved.point, moved.direction), 0) <= 1e-13


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_infinite_pitch_is_the_limit_of_large_ones(sign):
    """S / |h| → (0, ± ŝ): a thread to the left of no end slides against its direction."""
    direction, point = [1, 2, -2], [0.3, -0.7, 1.1]
    near = screw_axis(direction, point, sign * 1e12) / 1e12
    assert gap(screw_axis(direction, point, sign * np.inf), near) <= 2e-12
    assert gap(wrench_along(direction, point, sign * np.inf), np.roll(near, 3)) <= 2e-12


def test_tiny_screws_have_axes():
    axis = axis_of([0, 0, 1e-200, 0, -1e-200, 0])
    assert axis.point.tolist() == [1, 0, 0]
    assert axis.magnitude == 1e-200


def test_kinds_are_named():
    force, couple = tw.Wrench.of_force([1, 2, 3], "b", at=[0.3, -0.7, 1.1]), tw.Wrench.of_couple([1, 0, 0], "b")
    kinds = [F.kind for F in (force, couple, force + couple, 0 * force)]
    assert kinds == ["pure force", "pure couple", "wrench", "nothing"]
    T_ab = pose(3, "a", "b")
    assert (T_ab @ couple).m == pytest.approx(T_ab.rotation @ couple.m)  # a couple is the same about every point
    assert ((T_ab @ couple).kind, (T_ab @ couple).axis.pitch) == ("pure couple", np.inf)
    rows = tw.Twist([[0, 0, 1, 0, 2, 0], [0, 0, 0, 0, 2, 0], [0, 0, 1, 0, 0, 1], [0] * 6], "b")
    assert rows.kind.tolist() == ["pure rotation", "pure translation", "screw motion", "rest"]


@pytest.mark.parametrize("pitch", [1e-9, -1e-9, 1e-3])
def test_a_small_pitch_is_no_rounding(pitch):
    """A lead of nanometres beside a lever of a metre is a million times what doubles round, and named a screw's."""
    S = screw_axis([1, 2, -2], point=[0.3, -0.7, 1.1], pitch=pitch)
    assert tw.Twist(S, "b").kind == "screw motion"
    assert tw.Wrench(np.roll(S, 3), "b").kind == "wrench"
    assert (pose(3, "a", "b") @ tw.Twist(S, "b")).kind == "screw motion"
    assert tw.Twist(screw_axis([1, 2, -2], point=[0.3, -0.7, 1.1]), "b").kind == "pure rotation"


def test_reciprocity():
    hinge = tw.Twist(screw_axis([0, 0, 1], point=[1, 0, 0]), "b")
    through, beside = (tw.Wrench.of_force([0.3, 1, 0.5], "b", at=p) for p in ([1, 0, 7], [0, 0, 0]))
    assert through.is_reciprocal_to(hinge)
    assert not beside.is_reciprocal_to(hinge)
    lines = screw_axis([0, 0, 1], [1, 0, 0]), screw_axis([1, 2, 3], [1, 0, 5])  # they meet
    assert abs(reciprocal_product(*lines)) <= 4 * EPS
    assert reciprocal_product(lines[0], lines[0]) == 0


# ── covariance ──


def test_covariance_moves_like_the_wrench():
    T_ab = pose(4, "a", "b", 3)
    L = random(5, 6, 6)
    C_b = L @ L.T
    C_a = move_covariance(T_ab, C_b)
    assert np.array_equal(C_a, np.swapaxes(C_a, -1, -2))
    assert gap(move_covariance(T_ab.inverse, C_a), C_b) <= 1e-10
    assert gap(np.linalg.det(C_a) / np.linalg.det(C_b), 1) <= 1e-8  # det Ad = 1
    noise = np.random.default_rng(6).normal(size=(200_000, 6)) @ L.T
    moved = tw.Pose(T_ab.matrix[0], "a", "b") @ tw.Wrench(noise, "b")
    assert gap(np.cov(moved.values.T), C_a[0]) <= 0.02 * np.abs(C_a[0]).max()  # 1 / sqrt(200 000) = 0.0022


# ── labels: arrays in, arrays out ──


def test_labels_wrap_arrays_and_keep_their_own_copy():
    values = np.arange(12.0).reshape(2, 6)
    F = tw.Wrench(values, "b")
    values[:] = 0
    assert F.shape == (2,)
    assert np.asarray(F)[1].tolist() == [6, 7, 8, 9, 10, 11]
    assert [row.values[0] for row in F] == [0, 6]
    assert F[1].f.tolist() == [9, 10, 11]
    assert F[:1].shape == (1,)
    with pytest.raises(ValueError, match="read-only"):
        F.values[0] = 1
    assert tw.Twist(np.zeros(6, np.float32), "b").values.dtype == np.float32
    for x in (F, T_HF):
        for again in (copy.deepcopy(x), pickle.loads(pickle.dumps(x))):
            assert gap(again, x) == 0
    assert np.asarray(T_HF).shape == (4, 4)


# ── what is refused ──

F_B, V_B = tw.Wrench([1, 2, 3, 4, 5, 6], "b"), tw.Twist([1, 2, 3, 4, 5, 6], "b")
T_AB = tw.Pose(np.eye(4), to="a", of="b")
BENT = np.diag([1.01, 1, 1, 1])
REFUSED = {
    "two frames": (
        lambda: F_H + tw.Wrench(np.zeros(6), "f"),
        "wrench in 'h' + wrench in 'f': move one first, T_fh @ F_h with Pose(…, to='f', of='h').",
    ),
    "a difference": (
        lambda: tw.Twist(np.zeros(6), "base") - V_B,
        "twist in 'base' − twist in 'b': move one first, T_b_base @ V_base with Pose(…, to='b', of='base').",
    ),
    "power": (
        lambda: F_H @ V_B,
        "wrench in 'h' @ twist in 'b': move one first, T_bh @ F_h with Pose(…, to='b', of='h').",
    ),
    "a bracket": (
        lambda: V_B.bracket(tw.Twist(np.zeros(6), "s")),
        "bracket of a twist in 'b' and a twist in 's': move one first, T_sb @ V_b with Pose(…, to='s', of='b').",
    ),
    "a bracket of a wrench": (lambda: V_B.bracket(F_B), "the bracket is of two twists, not of a twist and a Wrench."),
    "a plain array": (
        lambda: F_B + np.zeros(6),
        "wrench in 'b' + ndarray: plain numbers name no frame; write Wrench(…, 'b'), or work on F_b.values.",
    ),
    "a plain array first": (lambda: np.zeros(6) + V_B, "write Twist(…, 'b'), or work on V_b.values."),
    "a wrench and a twist": (lambda: F_B + V_B, "wrench + twist: a wrench goes with another wrench"),
    "a product": (lambda: F_B * V_B, "wrench * twist: power is F @ V, and * is for numbers."),
    "two wrenches": (lambda: F_B @ F_B, "wrench @ wrench: power is wrench @ twist"),
    "two twists": (lambda: V_B @ V_B, "the Lie bracket of two twists is V1.bracket(V2)"),
    "power with an array": (lambda: F_B @ np.zeros(6), "wrench @ ndarray: power is wrench @ twist"),
    "a pose that does not cancel": (
        lambda: T_AB @ F_H,
        "T_ab @ F_h: the inner frames 'b' and 'h' do not cancel; missing is T_bh = Pose(…, to='b', of='h').",
    ),
    "two poses": (lambda: T_AB @ T_HF, "T_ab @ T_hf: the inner frames 'b' and 'h' do not cancel; missing is T_bh = "),
    "a pose and an array": (
        lambda: T_AB @ np.zeros(6),
        "T_ab @ ndarray: plain numbers name no frame; write Twist(…, 'b') or Wrench(…, 'b'), or use Ad(T) @ V",
    ),
    "an adjoint that does not cancel": (
        lambda: tw.Ad(T_AB) @ tw.Twist(np.zeros(6), "h"),
        "Ad(…) @ twist in 'h': the operator takes a twist in 'b' to 'a'; missing is T_bh = Pose(…, to='b', of='h').",
    ),
    "a transposed adjoint that does not cancel": (
        lambda: tw.Ad(T_AB).T @ F_B,
        "Ad(…).T @ wrench in 'b': the operator takes a wrench in 'a' to 'b'; missing is T_ab = Pose(…, to='a', of='b').",
    ),
    "a wrench that goes a twist's way": (
        lambda: tw.Ad(T_AB) @ F_B,
        "Ad(…) @ wrench: Ad(T) and ad(V) act on twists, their transposes .T on wrenches.",
    ),
    "a twist that goes a wrench's way": (lambda: tw.ad(V_B).T @ V_B, "ad(…).T @ twist: Ad(T) and ad(V) act on twists"),
    "an adjoint without names": (
        lambda: tw.Ad(np.eye(4)) @ V_B,
        "Ad(…) of plain numbers @ twist in 'b': they name no frames. Make it of a Pose or a Twist, write Pose(…) @ V_b, or "
        "work on V_b.values.",
    ),
    "a bracket without names": (lambda: tw.ad(V_B.values) @ V_B, "ad(…) of plain numbers @ twist in 'b'"),
    "a bracket of two frames": (
        lambda: tw.ad(V_B) @ tw.Twist(np.zeros(6), "s"),
        "ad(…) @ twist in 's': the operator takes a twist in 'b' to 'b'; missing is T_bs",
    ),
    "the adjoint of a twist": (lambda: tw.Ad(V_B), "Ad: T has shape (6,), expected (..., 4, 4)."),
    "the bracket of a wrench": (lambda: tw.ad(F_B), "ad: V is a wrench, and ad(V) is of a twist."),
    "a new name on a name": (lambda: tw.Pose(T_AB, "c", "d"), "a pose of T_ab, which has names already"),
    "a product with a text": (lambda: F_B * "abc", "the factor of a wrench has shape () of text, expected (...) of real numbers."),
    "a division by zero": (lambda: F_B / 0, "a wrench, angular part first, has the entry inf at (0,)"),
    "a batch of poses": (
        lambda: pose(0, "a", "b", 2) @ pose(0, "b", "c", 3),
        "these batches do not broadcast: T_ab (2, 4, 4), T_bc (3, 4, 4).",
    ),
    "a bent pose": (lambda: tw.Pose(BENT, "a", "b"), "not a rotation: R' R is 0.0201 off the identity"),
    "a pose of NaN": (lambda: tw.Pose(np.full((4, 4), np.nan), "a", "b"), "a pose has the entry nan at (0, 0)"),
    "a pose without a name": (lambda: tw.Pose(np.eye(4), to="", of="b"), "the frame that a pose leads to is ''"),
    "a frame that is not a name": (lambda: tw.Wrench(np.zeros(6), 3), "the frame of a wrench is 3; a frame's name is a text"),
    "five numbers": (lambda: tw.Twist(np.zeros(5), "b"), "a twist, angular part first, has shape (5,), expected (..., 6)."),
    "a row of one": (lambda: F_B[0], "no row 0 in a wrench of batch shape ()"),
    "rows of one": (lambda: list(F_B), "one wrench has no rows to go through"),
    "no axis": (lambda: (0 * F_B).axis, "a wrench needs six finite numbers that are not all zero to have an axis."),
    "no direction": (lambda: screw_axis([0, 0, 0]), "an axis needs a direction"),
    "an infinite direction": (lambda: screw_axis([1, np.inf, 0]), "an axis needs a direction: three finite numbers"),
    "an infinite twist": (lambda: axis_of([0, np.inf, 0, 0, 0, 1]), "a twist needs six finite numbers"),
    "an infinite wrench": (lambda: line_of_action([1, 0, 0, 0, -np.inf, 0]), "a wrench needs six finite numbers"),
    "a screw of five": (lambda: axis_of(np.zeros(5)), "a screw, angular part first, has shape (5,), expected (..., 6)."),
    "a covariance of five": (lambda: move_covariance(T_AB, np.eye(5)), "the covariance of a wrench has shape (5, 5), expected (..., 6, 6)."),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_the_frames_and_what_is_missing(case):
    action, message = REFUSED[case]
    with pytest.raises(tw.TwistWrenchError) as caught:
        action()
    assert message in str(caught.value)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("product", [lambda: np.eye(4) @ T_AB, lambda: np.eye(6) @ F_B], ids=["pose", "wrench"])
def test_a_matrix_on_the_left_of_a_label_is_refused(product):
    with pytest.raises(tw.FrameError, match="plain numbers name no frame"):
        product()


# ── what is printed ──


def test_labels_print_their_parts_units_and_frames():
    assert (
        repr(tw.Wrench([0.1 + 0.2, 1e-18, -2, 0, 0, 3], "tool0"))
        == "Wrench in 'tool0': m = (0.3, 0, -2) N m, f = (0, 0, 3) N"
    )
    assert str(V_B) == "Twist in 'b': omega = (1, 2, 3) rad/s, v = (4, 5, 6) m/s"
    batch = tw.Wrench([[3, 4, 0, 0, 0, 0], [0, 0, 0, 0, 5, 12.0]], "b")
    assert repr(batch) == "Wrench in 'b', batch (2,): |m| up to 5 N m, |f| up to 13 N"
    assert repr(batch[:0]) == "Wrench in 'b', batch (0,)"


def test_a_pose_prints_where_it_is_and_how_it_is_turned():
    T = tw.Pose(se3.pose(so3.exp([0, 0, np.pi / 2]), [1, 2, 3]), to="a", of="b")
    assert repr(T) == "Pose T_ab of 'b' seen from 'a': at (1, 2, 3) m, turned 1.5708 rad about (0, 0, 1)"
    assert repr(T_AB).endswith("at (0, 0, 0) m, not turned")
    assert repr(pose(0, "a", "b", 2)) == "Pose T_ab of 'b' seen from 'a', batch (2,)"


def test_symbols_are_printed_too():
    from twistwrench.compiler.ir.tracer import Trace

    trace = Trace()
    x = np.array([trace.constant(float(k)) for k in range(16)], object)
    assert repr(tw.Twist(x[:6], "b")).startswith(f"Twist in 'b': omega = ({x[0]}, {x[1]}")
    assert repr(tw.Pose(x.reshape(4, 4), "a", "b")).startswith(f"Pose T_ab of 'b' seen from 'a': at ({x[3]}, {x[7]}")
    assert str(x[9]) in repr(tw.SpatialInertia(x[:10]))


def test_what_comes_out_of_a_pickle_cannot_be_changed_either():

    for made, name in (
        (tw.Twist(np.ones(6), "a"), "values"),
        (tw.Wrench(np.ones(6), "a"), "values"),
        (tw.Pose(np.eye(4), to="a", of="b"), "matrix"),
        (tw.SpatialInertia.from_com(1.0), "parameters"),
    ):
        with pytest.raises(ValueError, match="read-only"):
            getattr(pickle.loads(pickle.dumps(made)), name)[:] = 2.0


def test_equal_numbers_in_one_frame_are_equal_and_have_one_hash():
    numbers = np.array([0.5, 0.0, -1.0, 2.0, 0.25, 3.0])
    signs = np.array([1, -1, 1, 1, 1, 1], np.float32)  # a zero of minus
    for kind in (tw.Twist, tw.Wrench):
        one, other = kind(numbers, "b"), kind(signs * numbers.astype(np.float32), "b")
        assert one == other
        assert hash(one) == hash(other)
        assert {one: "found"}[other] == "found"
        assert one != kind(numbers, "c")
        assert one != kind(numbers + 1e-15, "b")
        assert one != kind([numbers, numbers], "b")
        assert kind([numbers, numbers], "b") == kind([numbers, numbers], "b")  # one answer for a batch
        assert one != numbers.tolist()
        assert one != "b"
    assert tw.Twist(numbers, "b") != tw.Wrench(numbers, "b")
    T, again = (tw.Pose(se3.exp(numbers), to="a", of="b") for _ in range(2))
    assert again == T
    assert hash(again) == hash(T)
    assert tw.Pose(se3.exp(numbers), to="b", of="a") != T
    assert T.inverse != T
    assert T.matrix.tolist() != T
