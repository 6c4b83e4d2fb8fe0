"""Labelled poses, twists and wrenches of a sensor: frames that agree change nothing, others are refused."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.sensing.files import read_sensor, write_sensor
from twistwrench.sensing.log import ReadingLog
from twistwrench.sensing.sensor import ForceTorqueSensor
from twistwrench.sensing.simulated_logs import lively_motion, simulate

T, V, dV = (x[0] for x in lively_motion([0.4]))
R = tw.so3.exp([0.3, -0.2, 0.5])
F = np.array([0.1, 0.2, 0.3, 4.0, 5.0, 6.0])


def sensor(frame=None, mounting=None):
    load = tw.SpatialInertia.from_com(3.0, (0.02, -0.01, 0.1), np.diag([0.02, 0.025, 0.01]))
    return ForceTorqueSensor(load, mounting=np.eye(3) if mounting is None else mounting, frame=frame)


def labelled(pose="f", V_in="f", dV_in="f"):
    return tw.Pose(T, to="w", of=pose), tw.Twist(V, V_in), tw.Twist(dV, dV_in)


@pytest.mark.parametrize("frame", [None, "f"])
@pytest.mark.parametrize("mounting", [None, R])
def test_labels_that_agree_change_no_number(frame, mounting):
    s, of = sensor(frame, mounting), "f" if mounting is None else "s"
    np.testing.assert_array_equal(s.predict(*labelled()), s.predict(T, V, dV))
    np.testing.assert_array_equal(s.compensate(tw.Wrench(F, of), *labelled()), s.compensate(F, T, V, dV))
    np.testing.assert_array_equal(s.contact_wrench(tw.Wrench(F, of)), s.contact_wrench(F))


@pytest.mark.parametrize(
    ("frame", "names"),
    [(None, ("f", "s", "f")), (None, ("f", "f", "s")), (None, ("b", "f", "f")), ("f", ("b", "b", "b"))],
)
def test_labels_that_disagree_are_refused_by_name(frame, names):
    with pytest.raises(tw.FrameError, match=r"pose of '\w'.*holds in one frame"):
        sensor(frame).predict(*labelled(*names))
    with pytest.raises(tw.FrameError, match="holds in one frame"):
        sensor(frame).compensate(F, *labelled(*names))


def test_a_reading_is_in_the_sensors_axes():
    with pytest.raises(tw.FrameError, match="readings in 'b'"):
        sensor().compensate(tw.Wrench(F, "b"), *labelled())
    with pytest.raises(tw.FrameError, match="the sensor in 'f', compensated in 'b'"):
        sensor("f").contact_wrench(tw.Wrench(F, "b"))
    with pytest.raises(tw.FrameError, match="which the mounting turns against 'f'"):
        sensor(mounting=R).compensate(tw.Wrench(F, "f"), *labelled())
    with pytest.raises(tw.FrameError, match="which the mounting turns against 'f'"):
        sensor("f", R).contact_wrench(tw.Wrench(F, "f"))


def test_a_label_of_the_wrong_kind_is_refused():
    with pytest.raises(tw.FrameError, match="V is a Wrench, expected a Twist"):
        sensor().predict(T, tw.Wrench(F, "f"))
    with pytest.raises(tw.FrameError, match="compensated is a Twist, expected a Wrench"):
        sensor().contact_wrench(tw.Twist(V, "f"))
    with pytest.raises(tw.FrameError, match="the frame of a sensor"):
        sensor("")


def test_logs_and_simulations_check_labels_too():
    many, Vs, dVs = lively_motion(np.linspace(0, 1, 4))
    pose, twist = tw.Pose(many, to="w", of="f"), tw.Twist(Vs, "f")
    log = ReadingLog.from_arrays(np.zeros((4, 6)), pose=pose, V=twist, dV=tw.Twist(dVs, "f"))
    np.testing.assert_array_equal(log.V, Vs)
    with pytest.raises(tw.FrameError, match="dV in 's'"):
        ReadingLog.from_arrays(np.zeros((4, 6)), pose=pose, V=twist, dV=tw.Twist(dVs, "s"))
    np.testing.assert_array_equal(simulate(sensor("f"), pose).readings, simulate(sensor(), many).readings)
    with pytest.raises(tw.FrameError, match="pose of 'f'"):
        simulate(sensor("s"), pose)


def test_the_name_of_the_frame_goes_through_the_file(tmp_path):
    for frame in (None, "wrist"):
        write_sensor(sensor(frame), tmp_path / "sensor.json", (0.01, 0.3))
        assert read_sensor(tmp_path / "sensor.json")[0].frame == frame


def test_shapes_that_do_not_fit_are_said():
    with pytest.raises(tw.ShapeError, match="do not broadcast: gravity"):
        sensor().predict(np.tile(T, (3, 1, 1)), np.zeros((2, 6)))
    with pytest.raises(tw.ShapeError, match="do not broadcast: readings"):
        sensor().compensate(np.zeros((2, 6)), np.tile(T, (3, 1, 1)))
    with pytest.raises(tw.ShapeError, match="compensated has shape"):
        sensor().contact_wrench(np.zeros(5))


@pytest.mark.parametrize("name", ["", " ", "\t"])
def test_a_frame_has_a_name_that_can_be_read(name):
    with pytest.raises(
        tw.FrameError, match=r"the frame of a sensor is '.*'; a frame's name is a text that is not blank"
    ):
        sensor(name)
    with pytest.raises(tw.FrameError, match="the frame that a pose is of"):
        tw.Pose(np.eye(4), to="w", of=name)
