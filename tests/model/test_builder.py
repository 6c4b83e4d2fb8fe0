"""The builder: fusing, order, mimic, judging and tips, and what they must leave unchanged."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from chains import FLAT, ROUND, ROUNDING, assert_same_model, chain, two_links

from twistwrench.core.errors import (
    FrameError,
    InertiaError,
    ModelWarning,
    UnknownNameError,
    ValueRangeError,
)
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.lie.se3 import Ad
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.edit import lock
from twistwrench.mechanics.model.model import BASE
from twistwrench.mechanics.model.parts import disassemble, reassemble

pytestmark = pytest.mark.filterwarnings("ignore::twistwrench.core.errors.ModelWarning")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20170501)


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
    assert model.friction.viscous.tolist() == [1 + 2**2 + 6**2]
    assert model.friction.coulomb.tolist() == [1 + 2 + 6]


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


def limited_followers(rng: np.random.Generator, **limits: dict[str, float]) -> ModelBuilder:
    """As :func:`followers`, with limits: j2 = 2 j1 + 0.1, j3 = -6 j1 + 0.2."""
    mimics = {"j2": ("j1", 2.0, 0.1), "j3": ("j2", -3.0, 0.5)}
    return chain(rng, "rrr", lambda name, o: o.update({"mimic": mimics.get(name), **limits.get(name, {})}))


def test_followers_keep_their_limits_where_their_leader_does(rng):
    """At each end of the leader's range one of the three joints is at its own limit, and none is beyond."""
    own = {
        "j1": {"lower": -1.0, "upper": 1.0, "velocity": 2.0, "effort": 5.0},
        "j2": {"lower": -1.1, "upper": 1.6, "velocity": 6.0, "effort": 1.0},
        "j3": {"lower": -0.9, "upper": 10.0, "velocity": 3.0},
    }
    limits = limited_followers(rng, **own).build().limits
    for q, at, end in ((limits.lower[0], "j2", "lower"), (limits.upper[0], "j3", "lower")):
        places = {"j1": q, "j2": 2 * q + 0.1, "j3": -6 * q + 0.2}
        assert all(own[j]["lower"] - 1e-12 <= x <= own[j]["upper"] + 1e-12 for j, x in places.items())
        assert places[at] == pytest.approx(own[at][end], abs=1e-12)
    assert limits.velocity.tolist() == [3.0 / 6]
    assert limits.effort.tolist() == [5.0]


def test_limits_of_a_follower_that_no_place_of_its_leader_suits_are_left_out_and_told(rng):
    own = {"j1": {"lower": 0.0, "upper": 0.5}, "j3": {"lower": 0.2, "upper": 3.0}}  # j3 goes down from 0.2
    model = limited_followers(rng, **own).build()
    assert (model.limits.lower.tolist(), model.limits.upper.tolist()) == ([0.0], [0.5])
    (said,) = (text for text in model.defects if "follows" in text)
    assert "'j3'" in said and "-6" in said and "0.2 to 3" in said


def test_edits_keep_the_limits_of_leaders(rng):
    model = limited_followers(rng, j1={"lower": -1.0, "upper": 1.0}, j2={"lower": -0.7, "upper": 0.7}).build()
    again = reassemble(disassemble(model)).limits
    assert (again.lower.tolist(), again.upper.tolist()) == (model.limits.lower.tolist(), model.limits.upper.tolist())


def test_a_follower_cannot_be_locked_by_itself(rng):
    with pytest.raises(ValueRangeError, match="'j3' mimics 'j1'"):
        followers(rng).build(lock={"j3": 0.0})


def test_independent_mimic_joints_are_joints_like_any_other(rng):
    model = followers(rng).build(mimic="independent")
    assert model.nv == 3
    assert not any(b.follows for b in model.bodies)


# ── inertia ──
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
    for mass in (-1.0, np.nan, np.inf):
        with pytest.raises(InertiaError, match="'first'"):
            two_links(SpatialInertia.from_parameters([mass, *np.zeros(9)]), None).build(inertia=policy)


def test_a_massless_moving_link_of_a_file_is_named():
    (remark,) = two_links(None, None).build().defects
    assert "no mass: " in remark


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
    assert lock(model, {"p": 0.0}).tip == "tool"
    assert lock(model, {"j": 0.0}).tip is None


def test_a_tip_may_be_any_link():
    assert branched(fixed=False).build(tip="camera").tip == "camera"
    with pytest.raises(UnknownNameError, match="Did you mean 'camera'"):
        branched(fixed=False).build(tip="camara")


# ── options ──


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
