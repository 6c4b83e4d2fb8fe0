"""What cannot be meant is refused when a controller is made, or when it is asked, by an error that names it."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench import trajectories
from twistwrench.control import (
    PD,
    ComputedTorque,
    HybridMotionForce,
    Impedance,
    MomentumObserver,
    PoseMotion,
    TaskSpace,
)

Q = np.array([-0.9, 1.9, 0.4])
ARM = tw.robots.planar_3r()
T = ARM.forward_kinematics(Q)
WALL = ARM.close("ground", ARM.tip, rows="vx", pose=tw.se3.exp([0, 0, 0, 1.5, 0, 0]))
HOLD = PD(ARM, Q, 1.0, 1.0)
NOT_SYMMETRIC = [[1, 2, 0], [0, 1, 0], [0, 0, 1]]

REFUSED = {
    "gains of a wrong number": (lambda: PD(ARM, Q, [1, 2], 1), tw.ShapeError, "PD: kp has shape (2,)"),
    "gains that are a batch": (lambda: PD(ARM, Q, np.ones((2, 3, 3)), 1), tw.ShapeError, "shape (2, 3, 3)"),
    "a negative gain": (
        lambda: ComputedTorque(ARM, Q, 1, -2),
        tw.ValueRangeError,
        "ComputedTorque: kd has the eigenvalue -2",
    ),
    "one negative gain": (lambda: PD(ARM, Q, [1, -1e-3, 1], 1), tw.ValueRangeError, "eigenvalue -0.001"),
    "a gain that is not symmetric": (lambda: PD(ARM, Q, NOT_SYMMETRIC, 1), tw.ValueRangeError, "not symmetric"),
    "an indefinite matrix": (lambda: PD(ARM, Q, 2 - np.eye(3), 1), tw.ValueRangeError, "eigenvalue -1"),
    "a gain of nan": (lambda: PD(ARM, Q, np.nan, 1), tw.ValueRangeError, "kp has the entry nan"),
    "a gain of text": (lambda: PD(ARM, Q, "stiff", 1), tw.ValueRangeError, "kp"),
    "ragged gains": (lambda: PD(ARM, Q, [[1, 2], [3]], 1), tw.ShapeError, "kp"),
    "a reference of a wrong length": (lambda: PD(ARM, [0, 0], 1, 1), tw.ShapeError, "PD: reference has shape (2,)"),
    "a reference of nan": (lambda: PD(ARM, [0, 0, np.nan], 1, 1), tw.ValueRangeError, "reference has the entry nan"),
    "a function that gives one thing": (lambda: PD(ARM, lambda t: Q, 1, 1), tw.ShapeError, "gives three"),
    "a function of two things": (lambda: PD(ARM, lambda t, q: Q, 1, 1), tw.ValueRangeError, "called with the time"),
    "a motion of another robot": (
        lambda: PD(ARM, trajectories.move(tw.robots.planar_2r(), [0, 0], [1, 1], trajectories.cubic(1)), 1, 1),
        tw.ShapeError,
        "q of PD: reference at t = 0 s",
    ),
    "a closed robot": (lambda: PD(WALL, Q, 1, 1), tw.ValueRangeError, "robot.open()"),
    "no robot": (lambda: TaskSpace(None, T, 1, 1), tw.ValueRangeError, "the robot is None: give a tw.Robot"),
    "a robot that floats": (
        lambda: ComputedTorque(tw.robots.floating_box(), tw.robots.floating_box().neutral, 1, 1),
        tw.ValueRangeError,
        "a torque for every velocity",
    ),
    "an unknown frame": (lambda: TaskSpace(ARM, T, 1, 1, frame="tipp"), tw.UnknownNameError, "tipp"),
    "no frame to be meant": (
        lambda: TaskSpace(tw.robots.quadruped(floating_base=False), T, 1, 1),
        tw.FrameError,
        "",
    ),
    "a pose of another frame": (
        lambda: TaskSpace(ARM, tw.Pose(T, to="base", of="link2"), 1, 1),
        tw.FrameError,
        "the pose of 'link2', and 'tip' is controlled",
    ),
    "an unknown kind": (lambda: TaskSpace(ARM, T, 1, 1, kind="space"), tw.UnknownNameError, "'space'"),
    "an unknown row": (lambda: TaskSpace(ARM, T, 1, 1, rows="vq"), tw.UnknownNameError, "vq"),
    "gains for other rows": (lambda: TaskSpace(ARM, T, [1, 2, 3], 1, rows="vx vz"), tw.ShapeError, "vx, vz"),
    "what is not a pose": (
        lambda: TaskSpace(ARM, 2 * T, 1, 1),
        tw.ValueRangeError,
        "TaskSpace: reference is not a pose",
    ),
    "a pose of nan": (
        lambda: TaskSpace(ARM, np.full((4, 4), np.nan), 1, 1),
        tw.ValueRangeError,
        "TaskSpace: reference has the entry nan",
    ),
    "a pose seen from a frame that moves": (
        lambda: TaskSpace(ARM, tw.Pose(T, to="link2", of="tip"), 1, 1),
        tw.FrameError,
        "seen from 'link2', which moves",
    ),
    "a pose of a wrong shape": (lambda: TaskSpace(ARM, Q, 1, 1), tw.ShapeError, "reference has shape (3,)"),
    "a motion of poses without twists": (
        lambda: TaskSpace(ARM, lambda t: (T, 0, 0), 1, 1),
        tw.ShapeError,
        "V of TaskSpace",
    ),
    "a posture of a wrong length": (
        lambda: TaskSpace(ARM, T, 1, 1, posture=[0]),
        tw.ShapeError,
        "posture has shape (1,)",
    ),
    "a mass without a wrench": (lambda: Impedance(ARM, T, 1, 1, mass=2), tw.ValueRangeError, "go together"),
    "a wrench without a mass": (
        lambda: Impedance(ARM, T, 1, 1, wrench_on_robot=lambda t, q, dq: np.zeros(6)),
        tw.ValueRangeError,
        "go together",
    ),
    "a mass of zero": (
        lambda: Impedance(ARM, T, 1, 1, mass=0, wrench_on_robot=lambda t, q, dq: np.zeros(6)),
        tw.ValueRangeError,
        "must be above zero",
    ),
    "a wrench that is none": (
        lambda: Impedance(ARM, T, 1, 1, mass=1, wrench_on_robot=[0]),
        tw.ValueRangeError,
        "function",
    ),
    "an open robot": (lambda: HybridMotionForce(ARM, HOLD, [1]), tw.ValueRangeError, "closed robot, got Robot"),
    "a motion that is not a law": (lambda: HybridMotionForce(WALL, Q, [1]), tw.ValueRangeError, "law of (t, q, dq)"),
    "too many forces": (lambda: HybridMotionForce(WALL, HOLD, [1, 2]), tw.ShapeError, "ground–tip vx"),
    "a gain without a sensor": (
        lambda: HybridMotionForce(WALL, HOLD, [1], force_gain=1),
        tw.ValueRangeError,
        "go together",
    ),
    "a sensor that is none": (
        lambda: HybridMotionForce(WALL, HOLD, [1], force_gain=1, measured=[1.0]),
        tw.ValueRangeError,
        "measured is a function of (t, q, dq)",
    ),
    "a sample at no time": (
        lambda: MomentumObserver(ARM, 1).update(np.nan, Q, Q, Q),
        tw.ValueRangeError,
        "t has the entry nan",
    ),
    "an observer's gain of zero": (lambda: MomentumObserver(ARM, 0), tw.ValueRangeError, "rates [1/s] above zero"),
    "an observer's gains of a wrong number": (lambda: MomentumObserver(ARM, [1, 1]), tw.ValueRangeError, "3 of them"),
    "an observer of nothing": (
        lambda: MomentumObserver("ur5", 1),
        tw.ValueRangeError,
        "the robot is 'ur5': give a tw.Robot",
    ),
    "a controller that is none": (lambda: MomentumObserver(ARM, 1).watch(3), tw.ValueRangeError, "not a controller"),
    "a record of a wrong length": (
        lambda: MomentumObserver(ARM, 1).over([0, 1], np.zeros((3, 3)), np.zeros((2, 3)), np.zeros((2, 3))),
        tw.ShapeError,
        "q has shape (3, 3)",
    ),
    "a record without instants": (lambda: MomentumObserver(ARM, 1).over(0.0, Q, Q, Q), tw.ShapeError, "(n,)"),
    "an observer's frame": (lambda: MomentumObserver(ARM, 1).wrench(Q, "hand"), tw.UnknownNameError, "hand"),
    "an observer's kind": (lambda: MomentumObserver(ARM, 1).wrench(Q, kind="tip"), tw.UnknownNameError, "'tip'"),
    "a sample of nan": (
        lambda: MomentumObserver(ARM, 1).update(0.0, Q, [0, np.nan, 0], Q),
        tw.ValueRangeError,
        "dq has the entry nan",
    ),
    "the wrench of a residual of nan": (
        lambda: MomentumObserver(ARM, 1).wrench(Q, residual=[0, 0, np.nan]),
        tw.ValueRangeError,
        "residual has the entry nan",
    ),
    "the wrench at a state of nan": (
        lambda: MomentumObserver(ARM, 1).wrench([0, 0, np.nan]),
        tw.ValueRangeError,
        "q has the entry nan",
    ),
    "a scaling that gives one thing": (
        lambda: PoseMotion(trajectories.screw_path(T, T), lambda t: t)(0.5),
        tw.ShapeError,
        "PoseMotion: the scaling gave 0.5",
    ),
    "what is not a path": (lambda: PoseMotion(T, trajectories.cubic(1)), tw.ValueRangeError, "screw_path"),
    "what is not a scaling": (
        lambda: PoseMotion(trajectories.screw_path(T, T), 1.0),
        tw.ValueRangeError,
        "function of the time",
    ),
}


@pytest.mark.parametrize(("make", "kind", "said"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_meant_is_refused(make, kind, said):
    with pytest.raises(kind) as problem:
        make()
    assert said in str(problem.value)


LAWS = {
    "PD": HOLD,
    "ComputedTorque": ComputedTorque(ARM, Q, 1, 1),
    "TaskSpace": TaskSpace(ARM, T, 1, 1, rows="vx vz"),
    "Impedance": Impedance(ARM, T, 1, 1, rows="vx vz"),
    "HybridMotionForce": HybridMotionForce(WALL, HOLD, [1.0]),
}
JUNK = {"a short one": [0, 0], "a batch": np.zeros((2, 3)), "text": "abc", "nothing": None, "complex": [1j, 0, 0]}


@pytest.mark.parametrize("junk", JUNK.values(), ids=JUNK)
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_states_that_are_none_are_refused(law, junk):
    for state in ((junk, Q), (Q, junk)):
        with pytest.raises((tw.ShapeError, tw.ValueRangeError), match=r"q"):
            law(0.0, *state)


def test_an_observer_wants_its_samples_in_order():
    observer = MomentumObserver(ARM, 10.0)
    observer.update(0.1, Q, Q, Q)
    with pytest.raises(tw.ValueRangeError, match=r"t = 0\.1 s is not after the last time, 0\.1 s"):
        observer.update(0.1, Q, Q, Q)
    observer.reset()
    observer.update(0.0, Q, Q, Q)


def test_in_a_simulation_they_say_when():
    """A reference that breaks off is an error of the simulation, which keeps what was computed."""

    def until(t):
        return (Q, 0 * Q, 0 * Q) if t < 0.05 else (Q[:2], 0, 0)

    with pytest.raises(tw.SimulationError, match=r"at t = 0\.05 s with ShapeError: q of PD: reference") as problem:
        ARM.simulate(Q, duration=0.1, dt=0.01, controller=PD(ARM, until, 1, 1))
    assert len(problem.value.result) == 6


def test_a_damping_too_much_for_the_samples_is_blamed_on_them():
    """Held for h, a damping kd turns dq into (1 - kd h / M) dq, which grows from kd h = 2 M on; asked at every time it decays."""
    wheel = tw.robots.pendulum().with_gravity([0, 0, 0])
    kd = 3.0 * float(wheel.mass_matrix([0.0])[0, 0]) / 0.01
    brake = PD(wheel, [0.0], 0.0, kd)
    with pytest.raises(tw.SimulationError, match=r"held for 0\.01 s each, too long for a damping"):
        wheel.simulate([0.0], [1.0], 1.0, 0.01, controller=brake)
    assert abs(wheel.simulate([0.0], [1.0], 0.1, 0.01, tau=brake).dq[-1, 0]) < 1e-3


def test_gains_are_kept_from_later_changes():
    K = 100.0 * np.eye(3)
    law = PD(ARM, np.zeros(3), K, 1.0)
    before = law(0.0, Q, Q)
    K[:] = 0.0
    np.testing.assert_array_equal(law(0.0, Q, Q), before)


def test_references_are_kept_from_later_changes():
    """Arrays that already are float64 are copied too: of the joints, of a wall's force, of an observer's gain and its last sample."""
    q, force, K = np.zeros(3), np.array([1.0]), np.full(3, 50.0)
    follow, press, observer = PD(ARM, q, 9, 1), HybridMotionForce(WALL, HOLD, force), MomentumObserver(ARM, K)
    rubbing = tw.robots.panda()
    kept, other = (MomentumObserver(rubbing, 50.0, friction=True) for _ in range(2))
    before = follow(0.0, Q, Q), press(0.0, Q, Q)
    q[:], force[:], K[:] = 1.0, 2.0, 1.0
    np.testing.assert_array_equal(follow(0.0, Q, Q), before[0])
    np.testing.assert_array_equal(press(0.0, Q, Q), before[1])
    np.testing.assert_array_equal(observer.gain, 50.0)
    dq, rest = np.zeros(7), np.zeros(7)
    at = np.array([0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.4])
    for watching, speed in ((kept, dq), (other, dq.copy())):
        watching.update(0.0, at, speed, rest)
    dq += 1.0
    np.testing.assert_array_equal(kept.update(0.01, at, dq, rest), other.update(0.01, at, dq, rest))


@pytest.mark.parametrize("rows", ["vx vy", "vx vy vz", "wz vx", "wx"])
def test_rows_of_a_twist_that_turning_moves_are_not_taken_alone(rows):
    ur5 = tw.robots.ur5()
    T = ur5.forward_kinematics(ur5.neutral)
    with pytest.raises(tw.ValueRangeError, match="do not go by themselves"):
        tw.control.TaskSpace(ur5, T, 64.0, 16.0, kind="body", rows=rows)
    tw.control.TaskSpace(ur5, T, 64.0, 16.0, kind="world_aligned", rows=rows)
    tw.control.TaskSpace(ur5, T, 64.0, 16.0, kind="body", rows="vx wz vy")
