"""Small robots made by hand, and what it means for two models to be the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.model import Model

# Numbers here are of order 1 and pass through a few dozen operations each.
ROUNDING = 1e-13

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


def random_inertia(rng: np.random.Generator) -> SpatialInertia:
    """That of a cloud of point masses, so one that a body can have."""
    clouds = [
        SpatialInertia.from_com(m, r) for m, r in zip(rng.uniform(0.1, 1, 6), rng.normal(size=(6, 3)), strict=True)
    ]
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
    assert np.allclose(a.friction.viscous, b.friction.viscous)
    assert np.allclose(a.friction.coulomb, b.friction.coulomb)
