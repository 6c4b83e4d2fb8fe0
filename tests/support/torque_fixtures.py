"""Fixtures of the tests of the torques command: a robot, a motion and its file, and the shell."""

from __future__ import annotations

import warnings

import pytest
from click.testing import CliRunner
from motions import rough_motion, write_motion

from twistwrench import robots
from twistwrench.cli.main import main
from twistwrench.core.errors import ModelWarning


@pytest.fixture(scope="module")
def ur5():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return robots.ur5()


@pytest.fixture
def run():
    """Run the shell's commands: the exit code, and all that was printed."""

    def run(*arguments):
        result = CliRunner().invoke(main, [str(a) for a in arguments])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        assert "Traceback" not in result.output
        return result.exit_code, result.output

    return run


@pytest.fixture(scope="module")
def motion():
    return rough_motion()


@pytest.fixture
def motion_file(tmp_path, ur5, motion):
    t, *columns = motion
    return write_motion(tmp_path / "motion.csv", ur5, t, columns)
