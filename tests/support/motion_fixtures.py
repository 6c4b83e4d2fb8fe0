"""A small arm's model, and motion files of it, for the tests of readers.

PYTEST_DONT_REWRITE: tests import from it before it is a plugin.
"""

from __future__ import annotations

import warnings

import pytest

from twistwrench import robots
from twistwrench.core.errors import ModelWarning
from twistwrench.formats import load_model
from twistwrench.motion.coordinates import Coordinates
from twistwrench.motion.motion_log import MotionLog

GOOD = "time,joint1,joint2\n0.0,0.1,0.2\n0.1,0.3,0.4\n"


@pytest.fixture(scope="module")
def model():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        model = load_model(robots.path_of("planar_2r"))
    assert Coordinates.from_model(model).names == ("joint1", "joint2")
    return model


@pytest.fixture
def write(tmp_path):
    def write(text: str | bytes):
        path = tmp_path / "motion.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def read(path, model, **options):
    """The motion of a whole file."""
    trajectory = MotionLog.open(path, model, **options)
    return trajectory.motion(trajectory.table)
