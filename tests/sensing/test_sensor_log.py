"""Logs that are none, and units that look wrong when they are read."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from sensor_logs import NOISES as NOISE
from sensor_logs import tool

import twistwrench as tw
from twistwrench.sensing import identify, propose_poses, read_log, read_sensor, write_log, write_sensor
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.sensor import rotations_to_gravity
from twistwrench.sensing.simulated_logs import simulate


def _log(**changes):
    given = {"readings": np.zeros((4, 6)), "pose": np.tile(np.eye(3), (4, 1, 1))} | changes
    return ReadingLog.from_arrays(given.pop("readings"), **given)


SHEARED = np.eye(3) + np.array([[0, 0.2, 0], [0, 0, 0], [0, 0, 0]])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"readings": []}, "empty"),
        ({"readings": np.zeros((4, 5))}, r"\(n, 6\)"),
        ({"readings": np.where(np.arange(24) == 9, np.nan, 0.0).reshape(4, 6)}, "fx of reading 1 is nan"),
        ({"pose": np.tile(SHEARED, (4, 1, 1))}, "is 0.2 off the identity"),
        ({"pose": np.tile(np.diag([1, 1, -1]), (4, 1, 1))}, "mirrors"),
        ({"pose": np.full((4, 3, 3), np.nan)}, "must be a finite number"),
        ({"pose": np.zeros((4, 3))}, "expected rotations"),
        ({"pose": None, "quaternion": np.full((4, 4), 0.6)}, "not of unit length: off from 1 by 0.2"),
        ({"quaternion": np.full((4, 4), 0.5)}, "Keep one"),
        ({"pose": np.tile(np.eye(3), (3, 1, 1))}, "a row for each reading"),
        ({"pose": None, "gravity": [0, 0, 0]}, "gravity is zero"),
        ({"V": np.zeros((4, 6))}, "V and dV belong together"),
        ({"time": [0, 1]}, "time has shape"),
        ({"time": [0, 1, 1, 2]}, "time of reading 2 is 1 s, not after the 1 s"),
        ({"time": [0, 1, 3, 2]}, "time of reading 3 is 2 s, not after the 3 s"),
    ],
)
def test_bad_logs_say_what_to_do(changes, said):
    with pytest.raises(tw.TwistWrenchError, match=said):
        _log(**changes)


def test_units_that_look_wrong_warn():
    log = simulate(tool(), 12)
    R = rotations_to_gravity(log.gravity)
    for factor, said in (
        (np.array([1, 1, 1, 102, 102, 102]), "grams"),
        (np.array([1000, 1000, 1000, 1, 1, 1]), "N mm"),
    ):
        with pytest.warns(tw.ModelWarning, match=said):
            ReadingLog.from_arrays(log.readings * factor, pose=R)
    with pytest.warns(tw.ModelWarning, match="degrees per second"):
        _log(V=np.full((4, 6), 60.0), dV=np.zeros((4, 6)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ReadingLog.from_arrays(log.readings, pose=R)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda log, path: write_log(path, log), "the log first, then the path"),
        (lambda log, path: write_log(log.readings, path), "write_log takes a ReadingLog, got an array of shape"),
        (lambda log, path: write_log(log, 3), "takes a path after the log, got a int"),
        (lambda log, path: read_log(log), "takes the path of a CSV file, got a ReadingLog"),
        (lambda log, path: identify(np.zeros((3, 6))), r"identify takes a ReadingLog, got an array of shape \(3, 6\)"),
        (lambda log, path: identify(None), "identify takes a ReadingLog, got None"),
        (
            lambda log, path: identify([1, 2]),
            r"got \[1, 2\]. Make one with ReadingLog.from_arrays\(readings, pose=T_wf\)",
        ),
        (lambda log, path: propose_poses(3, log=[1]), "propose_poses takes a ReadingLog"),
        (lambda log, path: log.compensated(log), "takes a ForceTorqueSensor, got a ReadingLog"),
        (lambda log, path: simulate(log, 3), "takes a ForceTorqueSensor, got a ReadingLog"),
        (lambda log, path: write_sensor(path, tool(), NOISE), "takes a ForceTorqueSensor, then a path"),
        (lambda log, path: read_sensor(tool()), "takes the path of a sensor file"),
    ],
)
def test_arguments_of_another_kind_say_what_is_wanted(tmp_path, wrong, said):
    with pytest.raises(tw.ShapeError, match=said):
        wrong(simulate(tool(), 3), tmp_path / "log.csv")


def test_results_are_written_in_a_line():
    log = simulate(tool(), 12)
    found = identify(log)
    for thing in (found, log, found.fit):
        assert len(repr(thing)) < 200
        assert "\n" not in repr(thing)
    low, high = found.mass_interval
    assert f"{found.sensor.load.mass:.4g} ± {(high - low) / 2:.2g} kg (95 %)" in repr(found)
