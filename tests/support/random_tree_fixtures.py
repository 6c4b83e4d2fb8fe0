"""Fixtures over the random trees: a pytest plugin of the tests of laws."""

from __future__ import annotations

import numpy as np
import pytest
from quick import mostly_slow
from random_trees import SIMPLE_TREES, TREES, tree

from twistwrench.testing import random_state

pytest_plugins = ("numpy_fixtures",)


@pytest.fixture(params=[*mostly_slow(list(TREES)[:12], 4), *list(TREES)[12:]])
def robot(request):
    return tree(request.param)


@pytest.fixture(params=mostly_slow(SIMPLE_TREES, 2))
def simple_robot(request):
    """A robot whose velocities are the rates of its coordinates."""
    return tree(request.param)


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture
def state(robot, rng):
    return random_state(robot, rng)
