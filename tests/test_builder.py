"""The builder and the edits of models: what fusing, locking, mimicking and loading must leave unchanged."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest

from twistwrench.bodies.inertia import SpatialInertia
from twistwrench.errors import (
    FrameError,
    InertiaError,
    ModelError,
    ModelWarning,
    ShapeError,
    UnknownNameError,
    ValueRangeError,
)
from twistwrench.lie import se3
from twistwrench.lie.se3 import Ad
from twistwrench.model.builder import ModelBuilder
from twistwrench.model.edit import lock, with_gravity, with_payload
from twistwrench.model.model import BASE, Model
from twistwrench.model.snap import snap_rotation

pytestmark = pytest.mark.filterwarnings("ignore::twistwrench.errors.ModelWarning")

# Numbers below are of order 1 and pass through a few dozen operations each.
ROUNDING = 1e-13


def random_inertia(rng: np.random.Generator) -> SpatialInertia:
    """That of a cloud of point masses, so one that a body can have."""
    clouds = [SpatialInertia.from_com(m, r) for m, r in zip(rng.uniform(0.1, 1, 6), rng.normal(size=(6, 3)), strict=True)]
    return sum(clouds[1:], clouds[0])


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return se3.exp(rng.normal(size=6))


def chain(rng: np.random.Generator, kinds: str, change: Callable[[str, dict], None] | None = None) -> ModelBuilder:
    """A chain of links l0, l1, … by joints j1, j2, …: r(evolute), p(rismatic), f(ixed), P(lanar) or F(loating)."""
    names = {"r": "revolute", "p": "prismatic", "f": "fixed", "P": "planar", "F": "floating"}
    builder = ModelBuilder("chain")
    builder.add_link("l0", random_inertia(rng))
    for i, letter in enumerate(kinds, 1):
        builder.add_link(f"l{i}", random_inertia(rng))
        options = {"kind": names[letter], "placement": random_pose(rng), "axis": rng.normal(size=3)}
        if change is not None:
            change(f"j{i}", options)
        builder.add_joint(f"j{i}", parent=f"l{i - 1}", child=f"l{i}", **options)
    return builder


def assert_same_model(a: Model, b: Model) -> None:
    """The same moving bodies, frames and columns, up to rounding; sources and remarks may differ."""
    assert [x.joint.name for x in a.bodies] == [x.joint.name for x in b.bodies]
    for x, y in zip(a.bodies, b.bodies, strict=True):
        assert (x.parent, x.q_index, x.v_index, x.follows) == (y.parent, y.q_index, y.v_index, y.follows)
        assert np.allclose(x.placement, y.placement, atol=ROUNDING)
        assert np.allclose(x.inertia.parameters, y.inertia.parameters, atol=100 * ROUNDING)
        assert np.allclose([x.ratio, x.offset], [y.ratio, y.offset], atol=ROUNDING)
    assert np.allclose(a.base_inertia.parameters, b.base_inertia.parameters, atol=100 * ROUNDING)
    for name in a.frames.keys() & b.frames.keys():
        assert a.frames[name].body == b.frames[name].body
        assert np.allclose(a.frames[name].pose, b.frames[name].pose, atol=ROUNDING)
    for field in ("lower", "upper", "velocity", "effort"):
        assert np.array_equal(getattr(a.limits, field), getattr(b.limits, field))
    assert np.allclose(a.damping, b.damping)
    assert np.allclose(a.friction, b.friction)


# ── fusing ──


def test_a_fused_body_has_the_inertia_of_its_links(rng):
    builder = chain(rng, "rff")
    model = builder.build(snap=0)
    T = model.frames["l3"].pose
    G = model.link_inertias
    # G_a = Ad(T_ba)' G_b Ad(T_ba), MR eq. 8.42, by 6x6 matrices.
    expected = G["l1"].matrix
    for link in ("l2", "l3"):
        X = Ad(se3.inverse(model.frames[link].pose)).matrix
        expected = expected + X.T @ G[link].matrix @ X
    assert np.allclose(model.bodies[0].inertia.matrix, expected, atol=100 * ROUNDING)
    assert model.bodies[0].inertia.mass == pytest.approx(G["l1"].mass + G["l2"].mass + G["l3"].mass, rel=1e-14)
    assert T.shape == (4, 4)


def test_fixed_links_keep_their_frames(rng):
    poses = {}
    model = chain(rng, "rff", lambda name, options: poses.update({name: options["placement"]})).build(snap=0)
    assert list(model.frames) == ["l0", "l1", "l2", "l3"]
    assert [f.body for f in model.frames.values()] == [BASE, 0, 0, 0]
    assert np.allclose(model.frames["l3"].pose, poses["j2"] @ poses["j3"], atol=ROUNDING)


def test_links_fixed_to_the_base_are_the_base(rng):
    model = chain(rng, "ffr").build()
    masses = [G.mass for G in model.link_inertias.values()]
    assert model.base_inertia.mass == pytest.approx(sum(masses[:3]), rel=1e-14)
    assert model.bodies[0].parent == BASE
    assert np.allclose(model.bodies[0].inertia.parameters, model.link_inertias["l3"].parameters, rtol=0, atol=0)


def test_a_joint_behind_a_fixed_one_is_placed_through_it(rng):
    poses = {}
    model = chain(rng, "rfr", lambda name, options: poses.update({name: options["placement"]})).build(snap=0)
    assert np.allclose(model.bodies[1].placement, poses["j2"] @ poses["j3"], atol=ROUNDING)


# ── order ──


def test_joints_are_ordered_depth_first_in_document_order_among_siblings():
    builder = ModelBuilder("tree")
    for name in ("root", "z", "a", "z1", "a1", "hub", "m"):
        builder.add_link(name)
    for name, parent, child in [
        ("jm", "hub", "m"), ("jz", "root", "z"), ("ja1", "a", "a1"), ("jz1", "z", "z1"), ("ja", "root", "a"),
    ]:  # fmt: skip
        builder.add_joint(name, "revolute", parent, child)
    builder.add_joint("jhub", "fixed", "root", "hub")
    model = builder.build()
    assert [b.joint.name for b in model.bodies] == ["jz", "jz1", "ja", "ja1", "jm"]
    assert [b.parent for b in model.bodies] == [BASE, 0, BASE, 2, BASE]
    assert list(model.frames) == ["root", "z", "a", "z1", "a1", "hub", "m"]
    assert model.leaves == ("z1", "a1", "m")


def test_a_chain_longer_than_the_call_stack_builds():
    builder = ModelBuilder("rope")
    builder.add_link("l0")
    for i in range(1, 2001):
        builder.add_link(f"l{i}")
        builder.add_joint(f"j{i}", "revolute", f"l{i - 1}", f"l{i}")
    assert builder.build().nv == 2000


def test_a_floating_base_comes_first(rng):
    model = chain(rng, "rp").build(floating_base=True)
    assert [b.joint.name for b in model.bodies] == ["root_joint", "j1", "j2"]
    assert (model.nq, model.nv) == (9, 8)
    assert model.frames["l0"].body == 0
    assert model.base_inertia.mass == 0
    assert np.array_equal(model.bodies[0].inertia.parameters, model.link_inertias["l0"].parameters)


def test_a_second_floating_base_is_remarked_on(rng):
    assert any("floats already" in d for d in chain(rng, "F").build(floating_base=True).defects)


# ── locking ──


@pytest.mark.parametrize("kinds", ["rrr", "rpr", "rPr", "rFr"])
def test_a_locked_joint_is_a_fixed_joint(rng, kinds):
    value = {"r": 0.7, "p": 0.3, "P": (0.1, -0.2, 0.5), "F": (0.9, 0.1, -0.2, 0.3, 1.0, 2.0, 3.0)}[kinds[1]]
    seed = rng.integers(2**31)
    builder = chain(np.random.default_rng(seed), kinds)
    moving = builder.build()
    pose = moving.bodies[1].joint.pose(np.atleast_1d(np.array(value, float)))

    def fixed(name, options):
        if name == "j2":
            options.update(kind="fixed", placement=options["placement"] @ pose)

    expected = chain(np.random.default_rng(seed), kinds, fixed).build()
    assert_same_model(builder.build(lock={"j2": value}), expected)
    assert_same_model(lock(moving, {"j2": value}), expected)
    assert_same_model(lock(lock(moving, {"j3": 0.2}), {"j2": value}), lock(moving, {"j2": value, "j3": 0.2}))


def test_locking_takes_the_columns_of_the_joint(rng):
    def limited(name, options):
        k = float(name[1:])
        options.update(lower=-k, upper=k, velocity=10 + k, effort=20 + k, damping=30 + k, friction=40 + k)

    model = chain(rng, "rrr", limited).build()
    locked = lock(model, {"j2": 0.1})
    assert locked.limits.upper.tolist() == [1, 3]
    assert locked.limits.effort.tolist() == [21, 23]
    assert locked.damping.tolist() == [31, 33]
    assert locked.friction.tolist() == [41, 43]
    assert [b.q_index for b in locked.bodies] == [0, 1]
    assert model.nv == 3  # as it was


def test_locking_everything_leaves_the_base(rng):
    model = chain(rng, "rr").build(lock={"j1": 0.0, "j2": 0.0})
    assert (model.nv, model.bodies) == (0, ())
    assert model.base_inertia.mass == pytest.approx(sum(G.mass for G in model.link_inertias.values()), rel=1e-14)
    assert model.tip == "l2"


@pytest.mark.parametrize(
    ("value", "error"), [((0.0, 1.0), ShapeError), ("up", ShapeError), (np.nan, ValueRangeError), (None, ValueRangeError)]
)
def test_a_lock_needs_a_position(rng, value, error):
    with pytest.raises(error, match="'j1'"):
        chain(rng, "r").build(lock={"j1": value})


def test_only_moving_joints_can_be_locked(rng):
    with pytest.raises(UnknownNameError, match=r"'j3'.*mean.*'j1'"):
        chain(rng, "rf").build(lock={"j3": 0.0})
    with pytest.raises(UnknownNameError, match="'j2'"):
        chain(rng, "rf").build(lock={"j2": 0.0})


# ── mimic ──


def followers(rng: np.random.Generator, **last: object) -> ModelBuilder:
    """j1 leads; j2 = 2 j1 + 0.1; j3 = -3 j2 + 0.5."""
    mimics = {"j2": ("j1", 2.0, 0.1), "j3": ("j2", -3.0, 0.5)}

    def change(name, options):
        options.update(mimic=mimics.get(name), damping=1.0, friction=1.0)
        if name in last:
            options["kind"] = last[name]

    return chain(rng, "rrr", change)


def test_chains_of_mimic_joints_end_at_their_leader(rng):
    model = followers(rng).build()
    assert model.nv == 1
    assert [(b.follows, b.v_index, b.ratio) for b in model.bodies] == [(False, 0, 1.0), (True, 0, 2.0), (True, 0, -6.0)]
    assert [b.offset for b in model.bodies] == pytest.approx([0, 0.1, 0.2], abs=1e-15)


def test_losses_of_followers_count_at_their_leader(rng):
    model = followers(rng).build()
    assert model.damping.tolist() == [1 + 2**2 + 6**2]
    assert model.friction.tolist() == [1 + 2 + 6]


def test_followers_of_a_locked_joint_are_locked(rng):
    seed = rng.integers(2**31)
    one = followers(np.random.default_rng(seed)).build(lock={"j1": 0.3})
    free = followers(np.random.default_rng(seed)).build(mimic="independent")
    assert one.nv == 0
    assert_same_model(one, lock(free, {"j1": 0.3, "j2": 0.7, "j3": -1.6}))


def test_followers_of_a_fixed_joint_are_fixed_at_their_offset(rng):
    seed = rng.integers(2**31)
    model = followers(np.random.default_rng(seed), j1="fixed").build()
    free = followers(np.random.default_rng(seed), j1="fixed").build(mimic="independent")
    assert model.nv == 0
    assert_same_model(model, lock(free, {"j2": 0.1, "j3": 0.2}))


def test_a_leader_may_come_after_its_follower(rng):
    model = chain(rng, "rr", lambda name, o: o.update(mimic=("j2", 0.5, 0.0) if name == "j1" else None)).build()
    assert [(b.v_index, b.follows) for b in model.bodies] == [(0, True), (0, False)]
    assert model.nv == 1


def test_a_follower_cannot_be_locked_by_itself(rng):
    with pytest.raises(ValueRangeError, match="'j3' mimics 'j1'"):
        followers(rng).build(lock={"j3": 0.0})


def test_independent_mimic_joints_are_joints_like_any_other(rng):
    model = followers(rng).build(mimic="independent")
    assert model.nv == 3
    assert not any(b.follows for b in model.bodies)


# ── inertia ──

FLAT = SpatialInertia.from_com(1.0, (0, 0, 0), np.diag([1, 1, 2.5]))  # 0.5 kg m² beyond the triangle inequality
ROUND = SpatialInertia.from_com(5.0, (0, 0, 0), np.eye(3))


def two_links(first: SpatialInertia | None, second: SpatialInertia | None) -> ModelBuilder:
    """A moving link with a second one fixed to it."""
    builder = ModelBuilder("two")
    builder.add_link("base")
    builder.add_link("first", first, "line 3")
    builder.add_link("second", second, "line 4")
    builder.add_joint("j", "revolute", "base", "first")
    builder.add_joint("k", "fixed", "first", "second")
    return builder


def test_a_moving_body_that_cannot_exist_is_refused():
    with pytest.raises(InertiaError, match=r"link 'first' \(line 3\).*'j'.*triangle inequality.*by 0\.5"):
        two_links(FLAT, None).build()


def test_accept_keeps_the_numbers():
    model = two_links(FLAT, None).build(inertia="accept")
    assert np.array_equal(model.bodies[0].inertia.parameters, FLAT.parameters)
    assert "accepted" in model.defects[0]


def test_repair_takes_the_nearest_valid_numbers_and_reports():
    model = two_links(FLAT, None).build(inertia="repair")
    assert not model.bodies[0].inertia.defects()
    assert np.array_equal(model.bodies[0].inertia.parameters, FLAT.nearest_consistent().parameters)
    assert "repaired" in model.defects[0]


def test_what_fusing_absorbs_is_a_warning():
    with pytest.warns(ModelWarning, match=r"'first' \(line 3\).*by itself.*triangle"):
        model = two_links(FLAT, ROUND).build()
    assert np.allclose(model.bodies[0].inertia.parameters, (FLAT + ROUND).parameters, rtol=1e-15)
    assert len(model.defects) == 1


@pytest.mark.parametrize(
    ("inertia", "says"),
    [
        (SpatialInertia.from_com(1.0, (0.1, 0.2, 0.3)), "mass but zero inertia"),
        (SpatialInertia.from_com(0.0, (0, 0, 0), np.eye(3)), "rotational inertia but no mass"),
    ],
)
def test_mass_without_inertia_and_inertia_without_mass_are_warnings(inertia, says):
    with pytest.warns(ModelWarning, match=says):
        model = two_links(inertia, None).build()
    assert [says in defect for defect in model.defects] == [True]


def test_inertia_without_mass_must_still_be_a_body_s():
    with pytest.raises(InertiaError, match="triangle"):
        two_links(SpatialInertia.from_com(0.0, (0, 0, 0), np.diag([1, 1, 3])), None).build()
    repaired = two_links(SpatialInertia.from_com(0.0, (0, 0, 0), np.diag([1, 1, 3])), None).build(inertia="repair")
    assert repaired.bodies[0].inertia.mass == 0
    assert np.linalg.eigvalsh(repaired.bodies[0].inertia.second_moment).min() > -ROUNDING


@pytest.mark.parametrize("policy", ["error", "accept", "repair"])
def test_no_policy_mends_numbers_that_are_none(policy):
    for bad in (SpatialInertia.from_com(-1.0), SpatialInertia.from_com(np.nan), SpatialInertia.from_com(np.inf)):
        with pytest.raises(InertiaError, match="'first'"):
            two_links(bad, None).build(inertia=policy)


def test_a_massless_moving_link_is_no_defect():
    assert two_links(None, None).build().defects == ()


# ── payload, gravity ──


def test_a_payload_is_a_link_fixed_to_the_frame(rng):
    seed = rng.integers(2**31)
    payload = random_inertia(rng)
    loaded = with_payload(chain(np.random.default_rng(seed), "rrf").build(), payload)
    builder = chain(np.random.default_rng(seed), "rrf")
    builder.add_link("payload", payload)
    builder.add_joint("grip", "fixed", "l3", "payload")
    assert_same_model(loaded, builder.build())


def test_a_payload_on_the_base_stays_with_the_base(rng):
    model = chain(rng, "fr").build()
    loaded = with_payload(model, ROUND, "l1")
    assert loaded.base_inertia.mass == pytest.approx(model.base_inertia.mass + 5.0)
    assert loaded.bodies == model.bodies


def test_a_payload_must_be_able_to_exist(rng):
    model = chain(rng, "r").build()
    with pytest.raises(InertiaError, match=r"payload at 'l1'.*triangle"):
        with_payload(model, FLAT)
    with pytest.raises(InertiaError, match="negative mass"):
        with_payload(model, SpatialInertia.from_com(-1.0))
    with pytest.raises(UnknownNameError, match=r"'l9'.*l0, l1"):
        with_payload(model, ROUND, "l9")


def test_a_body_accepted_as_impossible_takes_a_payload():
    model = two_links(FLAT, None).build(inertia="accept")
    assert with_payload(model, SpatialInertia.from_com(0.1), "first").bodies[0].inertia.mass == pytest.approx(1.1)


def test_gravity_is_a_copy_with_another_gravity(rng):
    model = chain(rng, "r").build()
    assert model.gravity.tolist() == [0, 0, -9.81]
    assert with_gravity(model, (0, -1.62, 0)).gravity.tolist() == [0, -1.62, 0]
    assert model.gravity.tolist() == [0, 0, -9.81]
    for bad, error in [((0, 0), ShapeError), ("down", ShapeError), ((0, 0, np.nan), ValueRangeError)]:
        with pytest.raises(error, match="gravity"):
            with_gravity(model, bad)


# ── tip ──


def branched(*, fixed: bool) -> ModelBuilder:
    builder = ModelBuilder("fork")
    for name in ("base", "camera", "arm", "tool", "probe", "table"):
        builder.add_link(name)
    builder.add_joint("j", "revolute", "base", "arm")
    builder.add_joint("t", "fixed" if fixed else "revolute", "arm", "tool")
    builder.add_joint("p", "fixed" if fixed else "revolute", "arm", "probe")
    builder.add_joint("c", "fixed", "base", "camera")
    builder.add_joint("b", "fixed", "base", "table")
    return builder


def test_the_tip_is_the_last_leaf_of_the_last_moving_body():
    model = branched(fixed=True).build()
    assert model.leaves == ("camera", "tool", "probe", "table")
    assert model.tip == "probe"


def test_a_tree_has_no_tip_and_the_error_lists_its_leaves():
    model = branched(fixed=False).build()
    assert model.tip is None
    with pytest.raises(FrameError, match="camera, tool, probe, table"):
        model.frame(None)
    assert lock(model, {"p": 0.0}).tip == "probe"
    assert lock(model, {"j": 0.0}).tip is None


def test_a_tip_may_be_any_link():
    assert branched(fixed=False).build(tip="camera").tip == "camera"
    with pytest.raises(UnknownNameError, match="Did you mean 'camera'"):
        branched(fixed=False).build(tip="camara")


# ── snapping ──


def test_right_angles_become_exact():
    R = np.round(se3.exp([np.pi / 2, 0, 0, 0, 0, 0])[:3, :3] @ se3.exp([0, np.pi / 2, 0, 0, 0, 0])[:3, :3])
    noisy = se3.exp([3e-10, -2e-10, 1e-10, 0, 0, 0])[:3, :3] @ R
    assert np.array_equal(snap_rotation(noisy, 1e-9), R)
    assert np.array_equal(snap_rotation(noisy, 0), noisy)


@pytest.mark.parametrize("angle", [2e-9, 1e-8, 1e-6, 1e-5, 1e-3])
def test_a_small_angle_is_left_to_the_last_bit(angle):
    R = se3.exp([0, 0, angle, 0, 0, 0])[:3, :3]
    assert np.array_equal(snap_rotation(R, 1e-9), R)


def test_products_of_fixed_rotations_are_snapped_too():
    eighth = se3.exp([0, 0, np.pi / 4, 0, 0, 0])
    builder = ModelBuilder("turns")
    for i in range(3):
        builder.add_link(f"l{i}")
    builder.add_joint("a", "fixed", "l0", "l1", placement=eighth)
    builder.add_joint("b", "revolute", "l1", "l2", placement=eighth)
    exact = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert builder.build().bodies[0].placement.tolist() == exact
    assert builder.build(snap=0).bodies[0].placement.tolist() != exact


# ── joints ──


def joint_axes(kind: str, **options: object) -> np.ndarray:
    builder = ModelBuilder("one")
    builder.add_link("a")
    builder.add_link("b")
    builder.add_joint("j", kind, "a", "b", **options)
    return builder.build().bodies[0].joint.axes


def test_a_screw_axis_keeps_its_length_only_when_asked():
    S = [1, 0, 1, 0, 1, 0]  # the book's own first screw, which is no unit screw
    assert np.allclose(joint_axes("helical", axis=S), [np.array(S) / np.sqrt(2)], atol=1e-16)
    assert joint_axes("helical", axis=S, normalise_axes=False).tolist() == [S]
    assert joint_axes("prismatic", axis=[0, 0, 0, 0, 3, 0]).tolist() == [[0, 0, 0, 0, 1, 0]]


def test_a_helical_joint_advances_by_its_pitch():
    assert joint_axes("helical", axis=(0, 0, 2), pitch=0.1).tolist() == [[0, 0, 1, 0, 0, 0.1]]


@pytest.mark.parametrize(
    ("kind", "options", "says"),
    [
        ("revolute", {"axis": (0, 0, 0)}, "zero axis"),
        ("revolute", {"axis": (0, 0, np.nan)}, "finite"),
        ("revolute", {"axis": (0, 0)}, "shape"),
        ("revolute", {"axis": "up"}, "the axis of joint 'j'"),
        ("revolute", {"axis": (0, 0, 0, 1, 0, 0)}, "nonzero omega"),
        ("prismatic", {"axis": (1, 0, 0, 1, 0, 0)}, "(0, 0, 0, v)"),
        ("helical", {"axis": (0, 0, 0, 0, 0, 0)}, "zero screw axis"),
        ("helical", {"axis": (1, 0, 0, 0, 0, 0), "pitch": 1.0}, "leave out pitch"),
        ("revolute", {"pitch": 1.0}, "only helical"),
        ("hinge", {}, "Allowed: revolute"),
        ("revolute", {"placement": 2 * np.eye(4)}, "no pose"),
        ("revolute", {"placement": np.eye(3)}, "(4, 4)"),
        ("revolute", {"lower": 1.0, "upper": -1.0}, "reversed"),
        ("revolute", {"lower": np.nan}, "lower=nan"),
        ("revolute", {"effort": -1.0}, "effort=-1"),
        ("revolute", {"damping": np.inf}, "damping"),
        ("revolute", {"mimic": ("k", np.nan, 0.0)}, "mimic"),
    ],
)
def test_a_joint_that_cannot_be_meant_is_refused_by_name(kind, options, says):
    with pytest.raises(ModelError) as caught:
        joint_axes(kind, **options)
    assert "'j'" in str(caught.value)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("option", "value"), [("mimic", "copy"), ("inertia", "ignore"), ("snap", -1.0), ("snap", np.nan), ("snap", 1.0)]
)
def test_options_that_are_not_allowed_are_named(rng, option, value):
    with pytest.raises(ValueRangeError, match=option):
        chain(rng, "r").build(**{option: value})


def test_building_twice_gives_the_same_model(rng):
    builder = followers(rng)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert_same_model(builder.build(), builder.build())
