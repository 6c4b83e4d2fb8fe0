"""Random trees of few joints, every kind among them, for tests whose programs grow with the square of the velocities.

PYTEST_DONT_REWRITE: other tests import it before it is a plugin.
"""

from __future__ import annotations

import numpy as np
import pytest
from random_trees import ONE_DEGREE, driven
from shared_robots import shared

from twistwrench.testing import random_robot, random_state

TREES = {
    "floating base": {"rng": 0, "joints": 3, "floating_base": True},
    "floating": {"rng": 100, "joints": 2, "kinds": ("floating", "helical")},
    "planar": {"rng": 3, "joints": 3, "kinds": ("planar", "revolute")},
    "one degree": {"rng": 4, "joints": 5, "kinds": ONE_DEGREE},
    "mimic": {"rng": 5, "joints": 5, "kinds": ("revolute", "prismatic", "mimic")},
    "driven": {"rng": 6, "joints": 3},
}
SIMPLE = ("one degree", "mimic")
"""Those whose velocities are the rates of their coordinates."""


@shared
def tree(name):
    robot = random_robot(**TREES[name])
    return driven(robot, 6, stiffness="300 N m/rad") if name == "driven" else robot


# Plugins serve all modules of a run, so no name here is one of random_tree_fixtures'.


@pytest.fixture(params=TREES)
def small_robot(request):
    return tree(request.param)


@pytest.fixture
def small_state(small_robot):
    return random_state(small_robot, np.random.default_rng(20))


@pytest.fixture
def each_on_numpy(monkeypatch):
    """Programs run on NumPy: nothing to compile, and that compiled ones agree is another test's business."""
    monkeypatch.setenv("TWISTWRENCH_JIT", "0")
