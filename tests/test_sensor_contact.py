"""Where a wrench comes from, and how large one must be to be no noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import twistwrench as tw
from twistwrench.sensing import contact

NOISE = (0.01, 0.3)


def test_the_contact_point_is_found_on_planes_and_balls():
    rng = np.random.default_rng(0)
    r, f = rng.normal(size=(2, 50, 3))
    F = np.concatenate([np.cross(r, f), f], axis=1)
    np.testing.assert_allclose(contact.stray_couple(F), 0, atol=1e-12)
    normal = rng.normal(size=3)
    np.testing.assert_allclose(contact.contact_on_plane(F, r, normal), r, atol=1e-9)
    np.testing.assert_allclose(contact.contact_nearest(F, r), r, atol=1e-9)
    outward = r / np.linalg.norm(r, axis=1, keepdims=True)
    inward = np.where((f * outward).sum(1, keepdims=True) > 0, -f, f)
    F = np.concatenate([np.cross(outward, inward), inward], axis=1)
    np.testing.assert_allclose(contact.contact_on_sphere(F, (0, 0, 0), 1.0), outward, atol=1e-6)


def test_no_contact_point_without_a_force():
    assert np.isnan(contact.contact_on_plane(np.zeros(6), (0, 0, 0), (0, 0, 1))).all()
    assert np.isnan(contact.contact_on_plane([0, 0, 0, 1, 0, 0], (0, 0, 1), (0, 0, 1))).all()
    assert np.isnan(contact.contact_on_sphere([0, 0, 5, 1, 0, 0], (0, 0, 9), 1.0)).all()
    assert contact.stray_couple([0.5, 0, 0, 2, 0, 0]) == pytest.approx(0.5)


def test_false_alarms_come_as_often_as_stated():
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(200_000, 6)) * np.repeat(NOISE, 3)
    known = contact.CollisionThreshold.of_noise(NOISE, 1e-2)
    assert known(noise).mean() == pytest.approx(1e-2, rel=0.1)
    shares = [
        contact.CollisionThreshold.of_residuals(noise[k * 40 : k * 40 + 40], 1e-2)(noise[100_000:104_000]).mean()
        for k in range(400)
    ]
    assert np.mean(shares) == pytest.approx(
        1e-2, rel=0.15
    )  # Hotelling's factor: 40 readings would alarm 3 times as often
    assert known(np.array([0, 0, 0, 0, 0, 1.01 * known.per_axis[5]]))
    assert not known(np.array([0, 0, 0, 0, 0, 0.99 * known.per_axis[5]]))
    with pytest.raises(tw.ValueRangeError, match="at least 8"):
        contact.CollisionThreshold.of_residuals(noise[:5])
    with pytest.raises(tw.ValueRangeError, match="one in a million"):
        contact.CollisionThreshold.of_noise(NOISE, 0.0)


def test_a_collision_threshold_errs_on_the_safe_side():
    threshold = tw.sensing.CollisionThreshold.of_noise((0.01, 0.3))
    assert threshold(np.full(6, np.nan)) and not threshold(np.zeros(6))
    noise = np.random.default_rng(0).normal(size=(40, 6))
    noise[:, 4] = 0.0
    with pytest.raises(tw.ValueRangeError, match="fy never changes"):
        tw.sensing.CollisionThreshold.of_residuals(noise)


def test_forces_alone_can_be_tested():
    forces = contact.CollisionThreshold.of_noise(NOISE, 1e-3, axes=slice(3, 6))
    assert not forces([9, 9, 9, 0, 0, 0])
    assert forces([0, 0, 0, 0, 0, 2.0])
    assert np.isinf(forces.per_axis[:3]).all()
    np.testing.assert_allclose(forces.per_axis[3:], 0.3 * np.sqrt(stats.chi2.isf(1e-3, 3)))
    noise = np.random.default_rng(0).normal(size=(100_000, 6)) * np.repeat(NOISE, 3)
    assert abs(forces(noise).mean() - 1e-3) < 4e-4  # four deviations of 100 expected
