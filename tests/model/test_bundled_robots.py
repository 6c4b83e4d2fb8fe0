"""The bundled robots: their files load in silence, and have the numbers of the sources they name."""

from __future__ import annotations

import warnings
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from twistwrench import robots
from twistwrench.core.errors import ModelWarning, UnknownNameError
from twistwrench.formats import load_model
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.model import Model

FLOATING = {"floating_box", "quadruped"}


def model_of(name: str) -> Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return load_model(robots.path_of(name), floating_base=name in FLOATING)


def example_robot(file: str) -> Path:
    """A file of the package example-robot-data, which has no Python module to ask."""
    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")
    return next(Path(str(f.locate())) for f in files if str(f).endswith(file))


def test_every_file_has_a_function_of_its_name():
    assert set(robots.names()) == set(robots.__all__) - {"known", "names", "path_of"}


def test_an_unknown_name_lists_the_names():
    with pytest.raises(UnknownNameError, match=r"'ur6'.*Did you mean 'ur5'.*cart_pole, floating_box"):
        robots.path_of("ur6")


@pytest.mark.parametrize("name", robots.names())
def test_the_only_remarks_are_on_point_masses(name):
    assert all(defect.endswith("as a point mass has") for defect in model_of(name).defects)


@pytest.mark.parametrize(
    ("name", "nv", "tip", "mass"),
    [
        ("cart_pole", 2, "tip", 1.1),
        ("floating_box", 6, "box", 6.0),
        ("panda", 7, "panda_hand_tcp", 16.822132),
        ("pendulum", 1, "bob", 1.0),
        ("planar_2r", 2, "tip", 2.0),
        ("planar_3r", 3, "tip", 3.0),
        ("quadruped", 18, None, 15.017),
        ("ur5", 6, "tool0", 16.9939),
    ],
)
def test_each_robot_is_the_one_described(name, nv, tip, mass):
    model = model_of(name)
    assert (model.nv, model.tip) == (nv, tip)
    assert sum(body.inertia.mass for body in model.bodies) == pytest.approx(mass, rel=1e-12)


WRISTS = {("ur5", f"wrist_{k}_link") for k in (1, 2, 3)}
"""Links whose source has the tensor of a cylinder of radius 0.6 m; ours have one of 0.06 m, as the maker's has since."""


@pytest.mark.parametrize("k", [1, 2, 3])
def test_the_wrists_of_the_ur5_turn_as_cylinders_of_their_size(k):
    """Solid cylinders along z, of radius 0.06 m and height 0.12 m, to the digits of the file."""
    [G] = [b.inertia for b in model_of("ur5").bodies if b.link == f"wrist_{k}_link"]
    r, h = 0.06, 0.12
    expected = G.mass * np.array([(3 * r**2 + h**2) / 12, (3 * r**2 + h**2) / 12, r**2 / 2])
    np.testing.assert_allclose(np.diag(G.moment_about_com), expected, rtol=1e-4)


@pytest.mark.parametrize(
    ("name", "file", "lock"),
    [
        ("ur5", "/ur_description/urdf/ur5_robot.urdf", {}),
        ("panda", "/panda_description/urdf/panda.urdf", {"panda_finger_joint1": 0.0}),
    ],
)
def test_the_arms_have_the_numbers_of_their_sources(name, file, lock):
    ours, theirs = model_of(name), load_model(example_robot(file), lock=lock)
    for a, b in zip(ours.bodies, theirs.bodies, strict=True):
        assert a.joint.name == b.joint.name
        assert np.array_equal(a.joint.axes, b.joint.axes)
        # The same figures on both sides; the hand's links are summed in another order.
        assert np.allclose(a.placement, b.placement, rtol=0, atol=1e-15)
        if (name, a.link) in WRISTS:
            assert a.inertia.mass == b.inertia.mass
            assert a.inertia.com.tolist() == b.inertia.com.tolist() == [0, 0, 0]
            continue
        assert np.allclose(a.inertia.parameters, b.inertia.parameters, rtol=0, atol=1e-15)
    for limit in ("lower", "upper", "effort"):
        assert np.allclose(getattr(ours.limits, limit), getattr(theirs.limits, limit), rtol=1e-11)
    assert np.allclose(ours.frames[str(ours.tip)].pose, theirs.frames[str(ours.tip)].pose, rtol=0, atol=1e-15)


@pytest.mark.parametrize("name", ["planar_2r", "planar_3r"])
def test_the_planar_arms_turn_upwards_in_a_vertical_plane(name):
    model = model_of(name)
    T = model.bodies[0].placement
    axis = T[:3, :3] @ model.bodies[0].joint.axes[0, :3]
    assert axis.tolist() == [0, -1, 0]
    stretched = T @ model.bodies[0].joint.pose(np.array([np.pi / 2])) @ se3.pose(np.eye(3), [1.0, 0, 0])
    assert np.allclose(stretched[:3, 3], [0, 0, 1], atol=1e-16)
