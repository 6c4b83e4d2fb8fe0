"""Conversions find what they are given by its shape, and name what they are not meant for."""

import numpy as np
import pytest

import twistwrench as tw

rng = np.random.default_rng(0)


@pytest.mark.parametrize("shape", [(6,), (4, 6), (2, 3, 6), (6, 7), (5, 6, 7), (6, 1)])
def test_halves_change_places_along_the_axis_of_six_and_back(shape):
    rows = rng.normal(size=shape)
    found = tw.convert.swap_halves(rows)
    axis = shape.index(6)
    np.testing.assert_array_equal(found, np.take(rows, [3, 4, 5, 0, 1, 2], axis=axis))
    np.testing.assert_array_equal(tw.convert.swap_halves(found), rows)


@pytest.mark.parametrize("axis", [-1, -2, 0, 1])
def test_an_axis_that_is_named_is_believed(axis):
    rows = rng.normal(size=(6, 6))
    np.testing.assert_array_equal(tw.convert.swap_halves(rows, axis), np.roll(rows, 3, axis=axis))


@pytest.mark.parametrize(
    ("shape", "said"), [((5,), "no axis"), ((3, 4), "no axis"), ((6, 3, 4), "no axis"), ((6, 6), "axis=-2")]
)
def test_halves_of_what_has_none_or_too_many_are_refused(shape, said):
    with pytest.raises(tw.ShapeError, match=said):
        tw.convert.swap_halves(np.zeros(shape))


@pytest.mark.parametrize("function", ["to_pinocchio", "from_pinocchio", "pinocchio_rates", "to_mujoco", "from_mujoco"])
def test_arguments_in_the_wrong_places_are_named(function):
    robot = tw.robots.ur5()
    for given in ((object(), robot), (robot, "ur5")):
        with pytest.raises(tw.ValueRangeError, match=r"wanted|Robot"):
            getattr(tw.convert, function)(*given, *([] if "rates" in function else [np.zeros(6)]))
