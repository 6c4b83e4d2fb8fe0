"""Editing models: a locked joint is a fixed one, a payload is a fixed link, and the old model stays as it was."""

from __future__ import annotations

import numpy as np
import pytest
from chains import FLAT, ROUND, assert_same_model, chain, random_inertia, two_links

from twistwrench.core.errors import (
    InertiaError,
    ShapeError,
    UnknownNameError,
    ValueRangeError,
)
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.model.edit import lock, with_gravity, with_payload

pytestmark = pytest.mark.filterwarnings("ignore::twistwrench.core.errors.ModelWarning")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20170501)


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
    assert locked.friction.viscous.tolist() == [31, 33]
    assert locked.friction.coulomb.tolist() == [41, 43]
    assert [b.q_index for b in locked.bodies] == [0, 1]
    assert model.nv == 3  # as it was


def test_locking_everything_leaves_the_base(rng):
    model = chain(rng, "rr").build(lock={"j1": 0.0, "j2": 0.0})
    assert (model.nv, model.bodies) == (0, ())
    assert model.base_inertia.mass == pytest.approx(sum(G.mass for G in model.link_inertias.values()), rel=1e-14)
    assert model.tip == "l2"


@pytest.mark.parametrize(
    ("value", "error"),
    [((0.0, 1.0), ShapeError), ("up", ShapeError), (np.nan, ValueRangeError), (None, ValueRangeError)],
)
def test_a_lock_needs_a_position(rng, value, error):
    with pytest.raises(error, match="'j1'"):
        chain(rng, "r").build(lock={"j1": value})


def test_only_moving_joints_can_be_locked(rng):
    with pytest.raises(UnknownNameError, match=r"'j3'.*mean.*'j1'"):
        chain(rng, "rf").build(lock={"j3": 0.0})
    with pytest.raises(UnknownNameError, match="'j2'"):
        chain(rng, "rf").build(lock={"j2": 0.0})


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


def test_a_payload_on_the_base_is_where_its_frame_is(rng):
    model = chain(rng, "fr").build()
    pose = model.frame("l1").pose
    gained = with_payload(model, ROUND, "l1").base_inertia.parameters - model.base_inertia.parameters
    assert np.abs(ROUND.in_frame(pose).parameters - ROUND.parameters).max() > 0.1
    np.testing.assert_allclose(gained, ROUND.in_frame(pose).parameters, rtol=0, atol=1e-12)


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
