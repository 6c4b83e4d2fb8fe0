"""Inertia from shapes and meshes, other forms of the ten numbers, principal axes and repairs.

Round solids are compared with quadrature of their profile, meshes with solids, both independent of the closed formulas.
"""

from __future__ import annotations

import itertools
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import twistwrench as tw
from twistwrench import SpatialInertia, se3, so3
from twistwrench.testing import assert_close

seeds = st.integers(0, 2**32 - 1)
TOL = 1e-12


def random_inertia(rng: np.random.Generator) -> SpatialInertia:
    return SpatialInertia.from_points(rng.uniform(0.1, 2.0, 8), rng.normal(size=(8, 3)))


def random_pose(rng: np.random.Generator) -> np.ndarray:
    return se3.exp(rng.normal(size=6))


# ── shapes ──


def dumbbell() -> SpatialInertia:
    ball = SpatialInertia.sphere(0.1, density=7500)
    ends = [se3.pose(np.eye(3), [0, 0, z]) for z in (-0.2, 0.2)]
    return SpatialInertia.cylinder(0.02, 0.2, density=7500) + ball.in_frame(ends[0]) + ball.in_frame(ends[1])


def test_the_dumbbell_of_the_book():
    G = dumbbell()
    assert round(G.mass, 3) == 64.717
    assert G.principal()[0].round(5).tolist() == [0.25170, 2.77107, 2.77107]
    assert np.allclose(G.com, 0.0, atol=1e-16)
    # D4's axes: z is the bar.
    assert np.array_equal(np.abs(G.principal()[1][:, 0]), [0.0, 0.0, 1.0])


def revolved(radius, z0: float, z1: float, kinks=()) -> tuple[float, float, float, float]:
    """Volume, centroid height, and second moments ∫x² and ∫(z − z_c)² of a solid of revolution, by Gauss quadrature."""
    x, w = np.polynomial.legendre.leggauss(40)
    ends = [z0, *kinks, z1]
    z = np.concatenate([0.5 * (b - a) * x + 0.5 * (a + b) for a, b in itertools.pairwise(ends)])
    w = np.concatenate([0.5 * (b - a) * w for a, b in itertools.pairwise(ends)])
    r2 = radius(z) ** 2
    volume = np.pi * w @ r2
    centre = np.pi * w @ (r2 * z) / volume
    return volume, centre, np.pi / 4 * w @ r2**2, np.pi * w @ (r2 * (z - centre) ** 2)


ROUND = {
    "sphere": (SpatialInertia.sphere, (0.3,), lambda z: np.sqrt(0.09 - z**2), (-0.3, 0.3), ()),
    "cylinder": (SpatialInertia.cylinder, (0.3, 0.8), lambda z: 0.3 + 0 * z, (-0.4, 0.4), ()),
    "cone": (SpatialInertia.cone, (0.3, 0.8), lambda z: 0.3 * (0.75 - z / 0.8), (-0.2, 0.6), ()),
    "capsule": (
        SpatialInertia.capsule,
        (0.3, 0.8),
        lambda z: np.sqrt(np.maximum(0.09 - np.maximum(np.abs(z) - 0.4, 0) ** 2, 0)),
        (-0.7, 0.7),
        (-0.4, 0.4),
    ),
}


@pytest.mark.parametrize("shape", ROUND)
def test_round_solids_against_quadrature(shape):
    make, sizes, radius, (z0, z1), kinks = ROUND[shape]
    volume, centre, xx, zz = revolved(radius, z0, z1, kinks)
    G = make(*sizes, density=1000.0)
    # r² is a polynomial on each piece, so 40-point Gauss rules are exact to rounding.
    assert_close(G.mass, 1000 * volume, 1e-13)
    assert abs(centre) <= 1e-14, "the origin is the centre of mass"
    assert_close(G.moment_about_origin, 1000 * np.diag([xx + zz, xx + zz, 2 * xx]), 1e-13)
    assert_close(make(*sizes, mass=G.mass).parameters, G.parameters, 1e-13)


def ball_mesh(semi_axes, n: int) -> tuple[np.ndarray, np.ndarray]:
    """An octahedron refined n times and blown up to an ellipsoid."""
    v = [np.array(x, float) for x in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]]
    f = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    for _ in range(n):
        middle, finer = {}, []
        for tri in f:
            mids = []
            for i, j in zip(tri, (*tri[1:], tri[0]), strict=True):
                key = (min(i, j), max(i, j))
                if key not in middle:
                    middle[key] = len(v)
                    v.append((v[i] + v[j]) / np.linalg.norm(v[i] + v[j]))
                mids.append(middle[key])
            (a, b, c), (d, e, g) = tri, mids
            finer += [(a, d, g), (d, b, e), (g, e, c), (d, e, g)]
        f = finer
    return np.array(v) * semi_axes, np.array(f)


def test_the_mesh_of_an_ellipsoid_converges_to_it():
    exact = SpatialInertia.ellipsoid((0.1, 0.2, 0.3), density=1000)
    errors = []
    for n in (2, 3, 4):
        G = SpatialInertia.mesh(ball_mesh((0.1, 0.2, 0.3), n), density=1000)
        errors.append(np.abs(G.moment_about_com - exact.moment_about_com).max() / exact.moment_about_com.max())
    # Flat faces miss the surface by the square of their size, which halves: a factor 4 each time.
    assert errors[-1] < 0.02
    assert all(3.5 < a / b < 4.5 for a, b in itertools.pairwise(errors))


CUBE = (
    np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float),
    np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
              [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]),
)  # fmt: skip


@given(seeds)
def test_a_cube_mesh_is_a_box_wherever_it_is_and_inside_out_too(seed):
    rng = np.random.default_rng(seed)
    size, T = rng.uniform(0.1, 2.0, 3), random_pose(rng)
    corners = (CUBE[0] - 0.5) * size @ T[:3, :3].T + T[:3, 3]
    expected = SpatialInertia.box(size, density=700).in_frame(T)
    for faces in (CUBE[1], CUBE[1][:, ::-1]):
        G = SpatialInertia.mesh((corners, faces), density=700)
        assert_close(G.parameters, expected.parameters, TOL)
    far = SpatialInertia.mesh((corners + 100.0, CUBE[1]), density=700)
    # About an origin 170 m away the ten numbers hold m·170²; a body of 0.1 m keeps eps·(170/0.04)² = 4e-9 of its own.
    assert_close(far.moment_about_com, expected.moment_about_com, 1e-8)


def joined(*parts):
    """One mesh of several (corners, faces)."""
    corners = np.concatenate([c for c, _ in parts])
    first = np.cumsum([0] + [len(c) for c, _ in parts[:-1]])
    return corners, np.concatenate([f + n for n, (_, f) in zip(first, parts, strict=True)])


def cube(side, centre=(0.0, 0.0, 0.0), *, inside_out=False):
    """A cube of edge length ``side`` about ``centre``."""
    return side * (CUBE[0] - 0.5) + np.array(centre), CUBE[1][:, ::-1] if inside_out else CUBE[1]


@pytest.mark.parametrize("turned", list(itertools.product((False, True), repeat=2)))
def test_solids_side_by_side_add_whichever_way_their_faces_are_turned(turned):
    parts = cube(0.2, inside_out=turned[0]), cube(0.1, (0.5, 0.1, 0.0), inside_out=turned[1])
    G = SpatialInertia.mesh(joined(*parts), density=2000)
    sum_of_both = SpatialInertia.mesh(cube(0.2), density=2000) + SpatialInertia.mesh(
        cube(0.1, (0.5, 0.1, 0.0)), density=2000
    )
    assert_close(G.mass, 2000 * (0.2**3 + 0.1**3), 1e-13)
    assert_close(G.parameters, sum_of_both.parameters, 1e-13)


@pytest.mark.parametrize("turned", list(itertools.product((False, True), repeat=3)))
def test_a_shell_inside_another_is_a_cavity_and_one_inside_that_is_solid(turned):
    sides = 0.4, 0.3, 0.1
    at = np.array([0.01, 0.0, 0.02])
    parts = [cube(a, n * at, inside_out=t) for n, (a, t) in enumerate(zip(sides, turned, strict=True))]
    one, two, three = (SpatialInertia.mesh(part, density=1000) for part in parts)
    assert_close(SpatialInertia.mesh(joined(*parts[:2]), density=1000).parameters, (one - two).parameters, 1e-12)
    assert_close(SpatialInertia.mesh(joined(*parts), density=1000).parameters, (one - two + three).parameters, 1e-12)


def test_a_cavity_is_told_by_where_it_is_not_by_its_bounding_box():
    # A cube beside a pyramid's slope: within its bounding box, outside of it; and a cavity that touches the outer shell.
    pyramid = (
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
        np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
    )
    beside = SpatialInertia.mesh(joined(pyramid, cube(0.1, (0.9, 0.9, 0.9))), density=600)
    assert_close(beside.mass, 600 * (1 / 6 + 1e-3), 1e-13)
    touching = SpatialInertia.mesh(joined(cube(1.0), cube(0.2, (0.4, 0.0, 0.0))), density=1000)
    assert_close(touching.mass, 1000 * (1 - 0.008), 1e-13)
    stacked = SpatialInertia.mesh(joined(cube(1.0), cube(1.0, (1.0, 0.0, 0.0))), density=1000)
    assert_close(stacked.mass, 2000, 1e-13)


@pytest.mark.parametrize("second", [cube(0.2, (0.1, 0.05, 0.03)), cube(0.2), (cube(0.1)[0] * [9, 1, 1], CUBE[1])])
def test_shells_that_cut_each_other_both_count_and_are_remarked(second):
    with pytest.warns(tw.ModelWarning, match="cut each other or coincide"):
        G = SpatialInertia.mesh(joined(cube(0.2), second), density=1000)
    assert_close(G.mass, 8.0 + SpatialInertia.mesh(second, density=1000).mass, 1e-13)


def block(sides, centre):
    vertices, faces = cube(1.0)
    return vertices * sides + centre, faces


NEEDLE, PLATE, BAR = (0.02, 0.02, 2.0), (1.0, 1.0, 0.02), (0.2, 0.2, 2.0)
CROSSED = {
    "a needle through a plate": (NEEDLE, PLATE, (0.13, -0.21, 0.4), True),
    "a needle into a plate": (NEEDLE, PLATE, (0.13, -0.21, 1.003), True),
    "a needle that ends before a plate": (NEEDLE, PLATE, (0.13, -0.21, 1.02), False),
    "a needle beside a plate": (NEEDLE, PLATE, (0.52, -0.21, 0.4), False),
    "bars that cross": (BAR, (2.0, 0.2, 0.2), (0.05, 0.19, 0.03), True),
    "bars that pass": (BAR, (2.0, 0.2, 0.2), (0.05, 0.21, 0.03), False),
    "bars that pass on the other side": (BAR, (2.0, 0.2, 0.2), (0.05, -0.21, 0.03), False),
}


@pytest.mark.parametrize("name", CROSSED)
def test_shells_that_cross_without_a_corner_in_each_other_are_remarked_and_shells_that_pass_are_not(name):
    """In either order and along all axes; turned, those that pass have boxes that overlap."""
    first, second, centre, crosses = CROSSED[name]
    turned = so3.exp([0.4, -0.7, 0.5])
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        parts = [block(np.array(first)[[*order]], 0.0), block(np.array(second)[[*order]], np.array(centre)[[*order]])]
        for pair in (parts, parts[::-1]):
            for R in (np.eye(3), turned):
                vertices, faces = joined(*pair)
                with warnings.catch_warnings(record=True) as said:
                    warnings.simplefilter("always")
                    found = SpatialInertia.mesh((vertices @ R.T, faces), density=1000)
                assert any("1 pairs cut each other" in str(w.message) for w in said) == crosses, (order, R)
                assert_close(found.mass, 1000 * (np.prod(first) + np.prod(second)), 1e-12, "each counts whole")


def test_a_mesh_in_the_wrong_unit_is_remarked(recwarn):
    SpatialInertia.mesh(cube(0.18), density=1000)
    assert not recwarn.list
    with pytest.warns(tw.ModelWarning, match=r"180 m long and weighs 5.83e\+09 kg.*scale=0.001"):
        SpatialInertia.mesh(cube(180.0), density=1000)
    with pytest.warns(tw.ModelWarning, match="1e-05 m long"):
        SpatialInertia.mesh(cube(1e-5), mass=1e-12)
    with pytest.warns(tw.ModelWarning, match=r"5e\+06 kg/m³: not a plausible density"):
        SpatialInertia.mesh(cube(0.1), mass=5000.0)


def test_a_pyramid_whose_corners_are_not_about_its_centre():
    a, h, m = 0.4, 0.9, 3.0
    corners = [[0, 0, 0], [a, 0, 0], [a, a, 0], [0, a, 0], [a / 2, a / 2, h], [9, 9, 9]]  # the last belongs to no face
    G = SpatialInertia.mesh((corners, [[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]), mass=m)
    assert_close(G.com, [a / 2, a / 2, h / 4], 1e-14)
    across = m * (a * a / 20 + 3 * h * h / 80)
    assert_close(G.moment_about_com, np.diag([across, across, m * a * a / 10]), 1e-13)


def test_a_mesh_that_is_open_says_where():
    with pytest.raises(tw.ModelError, match=r"not watertight: 3 edges .* \[0.0, 0.0, 0.0\] to \[0.0, 1.0, 1.0\]"):
        SpatialInertia.mesh((CUBE[0], CUBE[1][1:]), mass=1.0)
    flipped = CUBE[1].copy()
    flipped[3] = flipped[3][::-1]
    with pytest.raises(tw.ModelError, match=r"watertight|same way"):
        SpatialInertia.mesh((CUBE[0], flipped), mass=1.0)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_mesh_files(tmp_path, suffix):
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / f"cube.{suffix}"
    trimesh.Trimesh(1000 * CUBE[0], CUBE[1], process=False).export(path)
    G = SpatialInertia.mesh(path, mass=6.0, scale=0.001)
    assert_close(G.com, [0.5, 0.5, 0.5], 1e-6)  # binary STL keeps float32
    assert_close(G.moment_about_com, np.eye(3), 1e-6)


def test_a_mesh_file_needs_its_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(tw.MissingExtraError, match=r"\[mesh\]"):
        SpatialInertia.mesh(tmp_path / "cube.stl", mass=1.0)


def test_a_missing_or_unreadable_mesh_file(tmp_path):
    pytest.importorskip("trimesh")
    with pytest.raises(tw.NotFoundError, match="no mesh file"):
        SpatialInertia.mesh(tmp_path / "cube.stl", mass=1.0)
    Path(tmp_path / "bad.obj").write_text("hello", "utf-8")
    with pytest.raises(tw.TwistWrenchError):
        SpatialInertia.mesh(tmp_path / "bad.obj", mass=1.0)


BAD_SHAPES = {
    "neither": (lambda: SpatialInertia.sphere(1.0), "exactly one of them; got neither"),
    "both": (lambda: SpatialInertia.sphere(1.0, mass=1.0, density=1.0), "got both"),
    "zero mass": (lambda: SpatialInertia.box((1, 1, 1), mass=0.0), "mass is 0"),
    "NaN density": (lambda: SpatialInertia.box((1, 1, 1), density=np.nan), "density is nan"),
    "flat": (lambda: SpatialInertia.box((1, 0, 1), mass=1.0), "size is"),
    "negative radius": (lambda: SpatialInertia.cone(-1.0, 1.0, mass=1.0), "radius is"),
    "two numbers": (lambda: SpatialInertia.ellipsoid((1, 1), mass=1.0), r"expected \(3,\)"),
    "a vector": (lambda: SpatialInertia.cylinder([1, 2], 1.0, mass=1.0), "expected one real number"),
    "negative point": (lambda: SpatialInertia.from_points([1, -1], np.eye(3)[:2]), "point 1, mass -1 kg"),
    "points": (lambda: SpatialInertia.from_points([1, 1], np.eye(3)), r"expected \(n,\) and \(n, 3\)"),
    "not a mesh": (lambda: SpatialInertia.mesh((np.eye(3), [[0.5, 1, 2]]), mass=1.0), "whole numbers"),
    "faces beyond": (lambda: SpatialInertia.mesh((np.eye(3), [[0, 1, 3]]), mass=1.0), "0 to 2"),
    "flat mesh": (lambda: SpatialInertia.mesh((np.eye(3), [[0, 1, 2], [0, 2, 1]]), mass=1.0), "no volume"),
    "scale": (lambda: SpatialInertia.mesh(CUBE, mass=1.0, scale=0), "scale is 0"),
}


@pytest.mark.parametrize("name", BAD_SHAPES)
def test_shapes_that_cannot_be_meant(name):
    make, message = BAD_SHAPES[name]
    with pytest.raises(tw.TwistWrenchError, match=message):
        make()


# ── other forms, principal axes, repair ──


@given(seeds)
def test_ten_numbers_and_back(seed):
    rng = np.random.default_rng(seed)
    G = random_inertia(rng)
    for back in (
        SpatialInertia.from_parameters(G.parameters),
        SpatialInertia.from_matrix(G.matrix),
        SpatialInertia.from_pseudo_inertia(G.pseudo_inertia),
        SpatialInertia.from_log_cholesky(G.log_cholesky()),
    ):
        assert_close(back.parameters, G.parameters, 1e-12)
    theta = rng.normal(size=10)
    H = SpatialInertia.from_log_cholesky(theta)
    assert H.defects() == []
    assert_close(H.log_cholesky(), theta, 1e-9)  # times the condition of the second moments, up to exp(2·6)
    alpha, d1, d2, d3, s12, s23, s13, *t = theta
    U = np.exp(alpha) * np.array(
        [[np.exp(d1), s12, s13, t[0]], [0, np.exp(d2), s23, t[1]], [0, 0, np.exp(d3), t[2]], [0, 0, 0, 1]]
    )
    assert_close(H.pseudo_inertia, U @ U.T, TOL)


@given(seeds, st.sampled_from([(1, 1, 1), (1, 1, 1.5), (1, 1.5, 1.5), (1, 1.2, 1.5), (1, 1 + 1e-13, 1 + 2e-13)]))
def test_principal_axes_are_a_rotation_that_diagonalises(seed, moments):
    rng = np.random.default_rng(seed)
    R = so3.exp(rng.normal(size=3))
    I = R @ np.diag(moments) @ R.T
    values, axes = SpatialInertia.from_com(1.0, moment_about_com=0.5 * (I + I.T)).principal()
    assert np.abs(axes.T @ axes - np.eye(3)).max() <= 1e-14
    assert np.linalg.det(axes) > 0
    assert_close(axes @ np.diag(values) @ axes.T, I, 1e-13)  # 8 eps of the trace count as repeated


def test_repeated_moments_follow_the_frame():
    assert np.array_equal(SpatialInertia.sphere(0.1, mass=1.0).principal()[1], np.eye(3))
    assert np.array_equal(SpatialInertia.cylinder(0.5, 0.1, mass=1.0).principal()[1], np.eye(3))


def test_what_a_repair_moved():
    sound = dumbbell().repair()
    assert str(sound) == "nothing to repair"
    assert sound.largest <= 1e-15
    bad = SpatialInertia.from_com(2.0, (0, 0, 1), np.diag([1.0, 1.0, 3.0])).repair()
    assert bad.after.defects() == []
    assert bad.after.mass == 2.0
    assert_close(bad.moved, np.diag([0.5, 0.5, 0.0]), TOL)
    assert "triangle" in str(bad)


def test_the_change_of_a_repair_is_a_share_of_the_largest_moment_before():
    bad = SpatialInertia.from_com(2.0, moment_about_com=np.diag([-3.0, 4.0, 5.0])).repair()
    assert_close(bad.after.moment_about_com, np.diag([0.0, 6.0, 6.0]), TOL)
    assert abs(bad.largest - 3 / 5) < 1e-12
