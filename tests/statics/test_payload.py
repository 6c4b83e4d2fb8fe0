"""The largest payload: closed forms, bisection, batches, regions and maps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from statics_fixtures import STRONG

import twistwrench as tw
from twistwrench import statics

pytest_plugins = ("statics_fixtures",)

G = 9.81


def limits_of(robot):
    return np.array(STRONG) if robot.name == "planar_2r" else robot.limits.effort


# ── one pose ──


def test_the_two_link_arm_stretched_out(arm):
    found = statics.largest_payload(arm, [0.0, 0.0], limits=STRONG)
    assert_allclose(found.unloaded, [3 * G, G], rtol=1e-12)
    assert_allclose(found.per_kilogram, [2 * G, G], rtol=1e-12)
    assert_allclose(found.per_joint, [(50 - 3 * G) / (2 * G), (20 - G) / G], rtol=1e-12)
    assert found.joint == 1
    assert found.side == 1


def test_the_robot_that_carries_the_largest_payload_is_at_its_limit(robot):
    rng = np.random.default_rng(12)
    L, com = limits_of(robot), np.array([0.05, -0.02, 0.1])
    for q in robot.random_configuration(rng, 8):
        found = statics.largest_payload(robot, q, com, limits=L)
        if not found.holds:
            assert found.mass == 0
            assert (np.abs(robot.gravity_forces(q)) > L).any()
            continue
        loaded = robot.with_payload(tw.SpatialInertia.from_com(float(found.mass), com), frame=robot.tip)
        tau = loaded.reference("gravity_forces", q)
        assert_allclose(tau, found.torques, rtol=1e-9, atol=1e-9)
        assert_allclose(np.abs(tau / L).max(), 1, rtol=1e-9)
        assert_allclose(tau[found.joint] / L[found.joint], found.side, rtol=1e-9)
        assert_allclose(found.share[found.joint], 1, rtol=1e-12)


def test_bisection_finds_the_same_payload(bundled):
    ur5 = bundled("ur5")
    q, com = np.array([0.1, -0.6, 0.9, 0.2, 0.3, 0.0]), np.array([0.0, 0.03, 0.1])
    low, high = 0.0, 1000.0
    for _ in range(45):
        middle = 0.5 * (low + high)
        loaded = ur5.with_payload(tw.SpatialInertia.from_com(middle, com))
        fits = (np.abs(loaded.reference("gravity_forces", q)) <= ur5.limits.effort).all()
        low, high = (middle, high) if fits else (low, middle)
    assert_allclose(statics.largest_payload(ur5, q, com).mass, low, rtol=1e-10)


def test_a_robot_too_weak_for_itself_holds_nothing(arm):
    found = statics.largest_payload(arm, [0.0, 0.0], limits=[20.0, 20.0])
    assert found.mass == 0
    assert not found.holds
    assert found.joint == -1
    assert "joint1 needs 29.43 of 20" in str(found)
    upright = statics.largest_payload(arm, [np.pi / 2, 0.0], limits=[20.0, 20.0])
    assert np.isinf(upright.mass)
    assert "not limited at this pose" in str(upright)


def test_it_says_on_which_side_the_limit_is_and_which_joint_cannot_hold_the_robot(arm):
    assert str(statics.largest_payload(arm, [np.pi, 0.0], limits=STRONG)).endswith("limited by joint2 at -20 N m")
    said = str(statics.largest_payload(arm, [0.0, 0.0], limits=[50.0, 5.0]))
    assert said.startswith("no payload: joint2 needs 9.81 of 5 ")  # joint1 needs more, and has it


def test_a_joint_that_gives_nothing_and_a_robot_without_joints(arm):
    found = statics.largest_payload(arm, [0.0, 0.0], limits=[50.0, 0.0])
    assert found.mass == 0
    assert np.isinf(found.share[1])
    with pytest.raises(tw.ValueRangeError, match="moving joints"):
        statics.largest_payload(arm.lock({"joint1": 0.0, "joint2": 0.0}), [], limits=[])


# ── many ──


def test_payloads_come_in_batches(bundled):
    ur5, rng = bundled("ur5"), np.random.default_rng(13)
    q, com = ur5.random_configuration(rng, (4, 1)), rng.uniform(-0.1, 0.1, (3, 3))
    found = statics.largest_payload(ur5, q, com)
    assert found.mass.shape == (4, 3)
    assert found.share.shape == (4, 3, 6)
    one = statics.largest_payload(ur5, q[2, 0], com[1])
    assert_allclose(found.mass[2, 1], one.mass, rtol=1e-13)
    assert "12 poses" in str(found)


def test_what_is_unknown_stays_unknown(bundled):
    ur5 = bundled("ur5")
    q = np.array([ur5.neutral, np.full(6, np.nan)])
    assert np.isnan(statics.largest_payload(ur5, q).mass).tolist() == [False, True]
    assert np.isnan(statics.largest_wrench(ur5, q, (0, 0, 1)).magnitude).tolist() == [False, True]
    weakest, known = statics.weakest_direction(ur5, q), statics.weakest_direction(ur5, q[0])
    assert_allclose(weakest.magnitude, [known.magnitude, np.nan])
    assert_allclose(weakest.wrench[0], known.wrench)
    assert weakest.joint.tolist() == [known.joint, -1]
    ellipsoid = statics.wrench_ellipsoid(ur5, q)
    assert_allclose(ellipsoid.semi_axes[0], statics.wrench_ellipsoid(ur5, q[0]).semi_axes)
    assert np.isnan(ellipsoid.semi_axes[1]).all()


def test_one_unknown_joint_leaves_no_answer_even_without_gravity(bundled):
    """Gravity's torques are then known, zero, but no lever is."""
    q = np.array([0, np.nan, 0, 0, 0, 0])
    for ur5 in (bundled("ur5"), bundled("ur5").with_gravity((0, 0, 0))):
        for found in (statics.weakest_direction(ur5, q), statics.largest_wrench(ur5, q, (0, 0, 1))):
            assert np.isnan(found.magnitude)
            assert (found.joint, found.side) == (-1, 0)
        assert np.isnan(statics.weakest_direction(ur5, q).wrench).all()
        payload = statics.largest_payload(ur5, q)
        assert np.isnan(payload.mass)
        assert (payload.joint, payload.side) == (-1, 0)


def test_what_is_unknown_is_called_so(bundled):
    ur5 = bundled("ur5")
    q = np.array([ur5.neutral, np.full(6, np.nan)])
    for call in (statics.largest_payload, statics.weakest_direction):
        assert str(call(ur5, q[1])) == "unknown: q has an entry that is not a number"
        both = str(call(ur5, q))
        assert "1 unknown" in both
        assert "nan" not in both
        assert "none known; 2 unknown" in str(call(ur5, q[[1, 1]]))


def test_a_region_is_as_weak_as_its_worst_corner_and_as_good_as_its_best_point(bundled):
    ur5, rng = bundled("ur5"), np.random.default_rng(14)
    q = np.array([0.1, -0.6, 0.9, 0.2, 0.3, 0.0])
    region = rng.uniform(-0.3, 0.3, (6, 3))
    found = statics.payload_in_region(ur5, q, region)
    mixtures = rng.dirichlet(np.ones(6), 4000) @ region
    masses = statics.largest_payload(ur5, q, mixtures).mass
    assert found.sure <= masses.min() + 1e-9
    assert_allclose(statics.largest_payload(ur5, q, found.worst_com).mass, found.sure, rtol=1e-12)
    assert found.best >= masses.max() - 1e-9
    assert_allclose(statics.largest_payload(ur5, q, found.best_com).mass, found.best, rtol=1e-7)


def test_the_map_keeps_to_the_samples_and_to_the_workspace(bundled):
    ur5 = bundled("ur5")
    found = statics.payload_map(ur5, "rz", cells=20, samples=5000)
    assert found.samples == 5000
    filled = found.count > 0
    assert (found.best[filled] >= found.worst[filled]).all()
    assert np.isnan(found.best[~filled]).all()
    masses = statics.largest_payload(ur5, ur5.random_configuration(np.random.default_rng(0), 5000)).mass
    assert np.nanmax(found.best) == masses.max()
    assert np.nanmin(found.worst) == masses.min()
    slab = statics.payload_map(ur5, "xz", thickness=0.2, cells=20, samples=5000)
    assert 0 < slab.samples < 5000


@pytest.mark.parametrize(("plane", "across", "along"), [("xz", 1, (0, 2)), ("yz", 0, (1, 2)), ("xy", 2, (0, 1))])
def test_a_slab_has_the_tips_within_half_its_thickness_on_the_axes_of_its_name(bundled, plane, across, along):
    ur5 = bundled("ur5")
    found = statics.payload_map(ur5, plane, at=0.2, thickness=0.3, cells=10, samples=2000)
    p = ur5.forward_kinematics(ur5.random_configuration(np.random.default_rng(0), 2000))[:, :3, 3]
    p = p[np.abs(p[:, across] - 0.2) <= 0.15]
    assert found.samples == len(p)
    for edges, axis in zip(found.edges, along, strict=True):
        assert edges[0] == p[:, axis].min()
        assert edges[-2] <= p[:, axis].max() <= edges[-1] + 1e-9


@pytest.mark.parametrize("plane", ["rz", "xz"])
def test_each_cell_of_a_map_has_the_best_and_the_worst_of_its_own_samples(bundled, plane):
    """Distances from the base's z axis, whichever way the arm points, or x in a slab; and heights."""
    ur5 = bundled("ur5")
    found = statics.payload_map(ur5, plane, thickness=0.5, cells=6, samples=1000, rng=3)
    q = ur5.random_configuration(np.random.default_rng(3), 1000)
    x, y, z = np.asarray(ur5.forward_kinematics(q))[:, :3, 3].T
    u, kept = (np.sqrt(x**2 + y**2), x == x) if plane == "rz" else (x, np.abs(y) <= 0.25)
    u, z, mass = u[kept], z[kept], statics.largest_payload(ur5, q[kept]).mass
    assert (found.across, found.thickness) == ((0.0, np.inf) if plane == "rz" else (0.0, 0.5))
    assert max(found.best.shape) == 6  # of squares
    assert_allclose(np.concatenate([np.diff(edges) for edges in found.edges]), np.diff(found.edges[0])[0], rtol=1e-9)
    column, row = (np.searchsorted(edges[1:-1], value) for edges, value in zip(found.edges, (u, z), strict=True))
    for (i, j), count in np.ndenumerate(found.count):
        here = mass[(row == i) & (column == j)]
        assert count == len(here)
        if count:
            assert_allclose([found.best[i, j], found.worst[i, j]], [here.max(), here.min()], rtol=1e-12)


def test_the_maps_cells_are_filled_however_few_samples_there_are(bundled):
    """Nearly every cell whose neighbours on all sides were reached was reached itself, and not by a handful at the median."""
    ur5 = bundled("ur5")
    sizes = []
    for samples in (5000, 20_000, 50_000):
        for plane in ("rz", "xz"):
            found = statics.payload_map(ur5, plane, samples=samples)
            full = np.pad(found.count > 0, 1)
            inside = full[:-2, 1:-1] & full[2:, 1:-1] & full[1:-1, :-2] & full[1:-1, 2:]
            assert (found.count > 0)[inside].mean() > 0.97
            sizes.append(max(found.best.shape))
            assert sizes[-1] == 8 or np.median(found.count[found.count > 0]) >= 20  # half of the 40 that a square has
    assert sizes[4] > sizes[2] > sizes[0]
    assert max(statics.payload_map(ur5, "xz", samples=1000).best.shape) == 8
    assert max(statics.payload_map(ur5, "rz", samples=1000, cells=50).best.shape) == 50
