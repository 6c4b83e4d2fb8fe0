"""Causes that a fit assumes: names, values with their intervals, parameters, and torques of another motion."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from quick import mostly_slow

import twistwrench as tw
from twistwrench import SpatialInertia
from twistwrench.cli.main import main
from twistwrench.core.errors import UnknownNameError, ValueRangeError
from twistwrench.identification.assumed import JOINTS_OF_CAUSE, WantedCause, wanted_causes
from twistwrench.identification.diagnosis.causes import laws, time_scale
from twistwrench.identification.diagnosis.diagnose import _is_part

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

ARM = tw.robots.planar_2r()
NAMES = ARM.model.velocity_names


@pytest.fixture(scope="module")
def log():
    """Ten seconds of two joints with friction and noise."""
    t = np.arange(0, 10, 0.01)
    q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    motion = tw.Motion(t, q, robot=ARM)
    noise = 0.1 * np.random.default_rng(0).normal(size=q.shape)
    return tw.Motion(t, q, tau=motion.torques() + 0.4 * motion.dq + noise, robot=ARM)


def test_causes_are_named_with_their_joints():
    wanted = wanted_causes(["gain:joint2", " tilt", "exchanged-torques:joint2:joint1"], ("joint1", "joint2"))
    assert wanted == (
        WantedCause("exchanged-torques", (0, 1)),
        WantedCause("tilt", ()),
        WantedCause("gain", (1,)),
    )
    assert wanted_causes("load-friction", NAMES) == (WantedCause("load-friction", ()),)
    assert wanted_causes((), NAMES) == ()


@pytest.mark.parametrize(
    ("assume", "error", "said"),
    [
        ("gian:joint1", UnknownNameError, "Did you mean 'gain'"),
        ("gain:joint9", UnknownNameError, "no joint named 'joint9'"),
        ("gain", ValueRangeError, "write gain:JOINT"),
        ("tilt:joint1", ValueRangeError, "write tilt"),
        ("exchanged-torques:joint1", ValueRangeError, "JOINT:JOINT"),
        ("exchanged-torques:joint1:joint1", ValueRangeError, "JOINT:JOINT"),
        ("low-pass", ValueRangeError, "before the filter"),
        ("late-joint:joint1", ValueRangeError, "friction and elasticity"),
        (["tilt", "tilt"], ValueRangeError, "twice"),
        (["warming", "warming:joint1"], ValueRangeError, "twice"),
    ],
)
def test_other_causes_are_refused(assume, error, said):
    names = ("joint1", "joint2")
    with pytest.raises(error, match=said):
        wanted_causes(assume, names)


def test_every_cause_that_can_be_assumed_is_a_row_of_the_table():
    from twistwrench.core.doubts import doubt_table

    assert JOINTS_OF_CAUSE.keys() <= doubt_table().keys()


def test_a_gain_is_an_unknown_of_the_fit(log):
    scaled = tw.Motion(log.time, log.q, tau=np.asarray(log.tau) * [1.0, 1.5], robot=ARM)
    fixed = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
    right = tw.identification.identify(ARM, log, **fixed)
    found = tw.identification.identify(ARM, scaled, assume=f"gain:{NAMES[1]}", **fixed)
    (gain,) = found.settings.assumed
    assert gain.kind == "gain" and gain.joints == (NAMES[1],)
    assert gain.interval[0] <= 1.5 <= gain.interval[1] and abs(gain.value - 1.5) < 0.02
    assert "gain" not in {doubt.kind for doubt in found.doubts}
    np.testing.assert_allclose(found.values, right.values, rtol=0.05, atol=0.02)
    wider = found.covariance.textbook / right.covariance.textbook
    assert (wider > 0.99).all() and wider.max() > 1.1
    assert found.to_dict()["assumed"][0]["value"] == gain.value and "assuming gain" in repr(found)
    assert any(note.startswith("Assumed: gain") for note in found.notes)


def test_a_cause_that_a_log_does_not_tell_is_refused(log):
    with pytest.raises(ValueRangeError, match="do not separate"):
        tw.identification.identify(ARM, log, assume="tilt", cutoff=10.0, friction_speed=0.05, shift=0.0)
    with pytest.raises(ValueRangeError, match="late is assumed"):
        tw.identification.identify(ARM, log, assume="late", shift=0.0)


def test_a_clock_that_runs_twice_too_fast_is_taken_off(log):
    """Times that are twice the true ones halve velocities and quarter accelerations; without that, the groups are the same."""
    fixed = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
    doubled = tw.Motion(2.0 * log.time, log.q, tau=log.tau, robot=ARM)
    right = tw.identification.identify(ARM, log, **fixed)
    found = tw.identification.identify(ARM, doubled, assume="time-scale", **fixed)
    (scale,) = found.settings.assumed
    assert scale.value == 2.0
    np.testing.assert_allclose(found.values, right.values, rtol=0.02, atol=0.02)


def test_a_drift_of_the_training_log_is_not_taken_off_a_test_log(log):
    """Another log has another drift, here none: the test log is predicted as well as by a training log without drift."""
    fixed = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
    drift = 20.0 * np.array([0.0, 1.0]) * (log.time / log.time[-1])[:, None]
    drifting = tw.Motion(log.time, log.q, tau=np.asarray(log.tau) + drift, robot=ARM)
    right = tw.identification.identify(ARM, log, test=log, **fixed)
    found = tw.identification.identify(ARM, drifting, test=log, assume=f"drift:{NAMES[1]}", **fixed)
    assert found.settings.assumed[0].value == pytest.approx(20.0, rel=0.05)
    assert found.held_out.joints[NAMES[1]] < 1.5 * right.held_out.joints[NAMES[1]]


def test_each_of_two_causes_has_its_own_interval(log):
    """A gain of one joint and a drift of the other hardly meet: each is as sure beside the other as it is alone."""
    fixed = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}
    tau = np.asarray(log.tau) * [1.0, 1.5] + np.array([20.0, 0.0]) * (log.time / log.time[-1])[:, None]
    both = [f"gain:{NAMES[1]}", f"drift:{NAMES[0]}"]
    faulty = tw.Motion(log.time, log.q, tau=tau, robot=ARM)
    gain, drift = tw.identification.identify(ARM, faulty, assume=both, **fixed).settings.assumed
    alone = tw.Motion(log.time, log.q, tau=tau / [1.0, 1.5], robot=ARM)
    (other,) = tw.identification.identify(ARM, alone, assume=both[1], **fixed).settings.assumed
    assert gain.interval[0] <= 1.5 <= gain.interval[1] and drift.interval[0] <= 20.0 <= drift.interval[1]
    assert np.ptp(drift.interval) == pytest.approx(np.ptp(other.interval), rel=0.3)
    assert np.ptp(gain.interval) < 0.2 * np.ptp(drift.interval)


TIME = np.linspace(0.0, 4.0, 401)
SWINGING = SimpleNamespace(
    gain=np.ones(1), time=TIME, dq=np.sin(np.pi * TIME)[:, None], ddq=np.pi * np.cos(np.pi * TIME)[:, None],
    friction_speed=np.array([0.01]), slope=lambda x: np.gradient(x, TIME, axis=0), with_fields=dict,
)  # fmt: skip
"""A joint that swings at 0.5 Hz for 4 s."""


def law_column(kind, fitted):
    law = next(one for one in laws(SWINGING) if one.kind == kind)
    return law.columns(SWINGING, fitted)[:, 0, 0]


def test_rates_of_a_clock_change_by_the_chain_rule():
    """Times that are twice the true ones: dq/dt doubles, and d²q/dt² is four times as large."""
    found = time_scale(SWINGING, 2.0)
    np.testing.assert_allclose(found["dq"], 2.0 * SWINGING.dq)
    np.testing.assert_allclose(found["ddq"], 4.0 * SWINGING.ddq)


def test_a_late_torque_is_less_by_its_slope():
    """τ(t - δ) = τ(t) - δ dτ/dt, here of a sine: the difference of a torque that is late by 1 ms."""
    whole = np.sin(3.0 * TIME)[:, None]
    column = law_column("late-joint", SimpleNamespace(whole=whole))
    np.testing.assert_allclose(1e-3 * column[5:-5], np.sin(3.0 * (TIME - 1e-3))[5:-5] - whole[5:-5, 0], atol=2e-5)


def test_friction_that_warms_up_works_against_the_motion():
    """It grows with time from none to Coulomb's friction, 7 N m, and its power is never negative."""
    column = law_column("warming", SimpleNamespace(coulomb=np.array([7.0])))
    assert (column * SWINGING.dq[:, 0] >= 0.0).all()
    fast = abs(SWINGING.dq[:, 0]) > 0.1
    np.testing.assert_allclose(abs(column)[fast], 7.0 * TIME[fast] / 4.0, rtol=1e-6)


def test_two_changes_of_a_joint_within_a_second_are_one():
    """A gain that changes scales the offset too; what changes three seconds later, or at another joint, is another cause."""
    gain = SimpleNamespace(kind="gain-change", span=(9.0, 20.0), joints=(1,), log=0)
    for begin, joint, is_part in ((9.4, 1, True), (12.0, 1, False), (9.4, 0, False)):
        offset = SimpleNamespace(kind="offset-step", span=(begin, 20.0), joints=(joint,), log=0)
        assert _is_part(offset, [gain]) == is_part


# ── Values, parameters and another motion: the first three joints of an arm, against torques of a robot with other bodies

SPEED = 0.05
"""Speed that friction turns at, which the fits are told as well [rad/s]."""
FIXED = {"cutoff": 10.0, "friction_speed": SPEED, "shift": 0.0}
FAULTS = {"gain": "gain:elbow_joint", "zero": "zero:shoulder_lift_joint", "tilt": "tilt", "load": "load-friction"}


@pytest.fixture(scope="module")
def arm():
    """The robot as its file has it, of three joints, without stops, which the motions of this file pass."""
    held = tw.robots.ur5().lock({"wrist_1_joint": -1.0, "wrist_2_joint": 0.7, "wrist_3_joint": 0.0})
    endless = replace(held.model.limits, lower=np.full(3, -np.inf), upper=np.full(3, np.inf))
    return tw.Robot(replace(held.model, limits=endless))


class World:
    """A robot that is a fifth heavier and leans, with friction, and logs of it."""

    def __init__(self, arm, fault, seed):
        self.fault, self.rng = fault, np.random.default_rng(seed)
        self.turn = self.rng.uniform(0, 2 * np.pi)
        lean = np.radians(10.0) if fault == "tilt" else 0.0
        gravity = 9.81 * np.array([np.sin(lean) * np.cos(self.turn), np.sin(lean) * np.sin(self.turn), -np.cos(lean)])
        bodies = tuple(
            replace(body, inertia=SpatialInertia(1.2 * body.inertia.parameters)) for body in arm.model.bodies
        )
        self.arm, self.robot = arm, tw.Robot(replace(arm.model, bodies=bodies)).with_gravity(gravity)

    def states(self, t):
        """Positions, velocities and accelerations of a sum of harmonics."""
        w = 0.5 * np.arange(1, 6)
        a, b = self.rng.normal(size=(2, 5, 3)) / w[:, None]
        s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        q = s @ a + c @ b + [0.0, -1.0, 1.0]
        return q, (c * w) @ a - (s * w) @ b, -(s * w**2) @ a - (c * w**2) @ b

    def torques(self, q, dq, ddq):
        rigid = np.asarray(self.robot.inverse_dynamics(q, dq, ddq))
        dry = np.array([4.0, 5.0, 3.0]) + (0.1 * np.abs(rigid) if self.fault == "load" else 0.0)
        return rigid + 2.0 * dq + dry * np.tanh(dq / SPEED)

    def log(self):
        """Twenty seconds at 100 Hz, with noise of 2 % of the torques."""
        t = np.arange(0, 20, 0.01)
        states = self.states(t)
        tau = self.torques(*states)
        tau = tau + 0.02 * tau.std(axis=0) * self.rng.normal(size=tau.shape)
        q = states[0] + np.radians(5.0) * (self.fault == "zero") * np.array([0.0, 1.0, 0.0])
        return tw.Motion(t, q, tau=tau * np.where([0, 0, self.fault == "gain"], 1.5, 1.0), robot=self.arm)

    def groups(self, base):
        """True groups of a fit."""
        drives = {"viscous": [2.0] * 3, "coulomb": [4.0, 5.0, 3.0], "offset": [0.0] * 3, "motor_inertia": [0.0] * 3}
        own, names = 1.2 * self.arm.parameters, self.arm.model.velocity_names
        values = [
            own[place] if place >= 0 else drives[kind][names.index(name.split(".")[0])]
            for name, kind, place in zip(base.unknown.names, base.unknown.kinds, base.unknown.of_bodies, strict=True)
        ]
        return base.project(np.array(values))


VALUES = {"gain": 1.5, "zero": 5.0, "tilt": 10.0, "load": 10.0}


def judged(arm, fault, seed):
    """Groups whose intervals hold the truth, of how many; the fit; and the world."""
    world = World(arm, fault, seed)
    found = tw.identification.identify(arm, world.log(), assume=FAULTS[fault], **FIXED)
    low, high = found.interval().T
    truth = world.groups(found.base)
    return ((low <= truth) & (truth <= high)), found, world


@pytest.mark.parametrize("fault", mostly_slow(FAULTS, 2))
def test_a_robot_is_identified_beside_a_cause(arm, fault):
    held, found, world = judged(arm, fault, 1)
    (cause,) = found.settings.assumed
    assert abs(cause.value - VALUES[fault]) < 0.03 * VALUES[fault]
    assert cause.interval[0] < cause.value < cause.interval[1] and held.mean() > 0.8
    assert str(found.verdict.word) == "OK", found.doubts
    states = world.states(np.arange(0, 20, 0.05))
    fast = (np.abs(states[1]) > 3 * SPEED).all(axis=1)  # dry friction of a robot changes its sign at once
    states = tuple(x[fast] for x in states)
    assert len(states[0]) > 150
    real = world.torques(*states)
    predicted = np.asarray(found.robot.inverse_dynamics(*states, friction=True))
    assert np.sqrt(((predicted - real) ** 2).sum() / (real**2).sum()) < 0.02


@pytest.mark.slow
def test_intervals_beside_causes_hold_the_truth(arm):
    held = np.concatenate([judged(arm, fault, seed)[0] for fault in FAULTS for seed in range(8)])
    assert 0.93 <= held.mean() <= 0.98, (held.mean(), len(held))


def test_load_friction_is_written_into_the_actuator_file(arm, tmp_path):
    _, found, _ = judged(arm, "load", 1)
    notes = found.write(actuators=tmp_path / "drives.yaml")
    load = arm.with_actuators(tmp_path / "drives.yaml").model.friction.load
    np.testing.assert_allclose(load, found.settings.assumed[0].value / 100)
    np.testing.assert_allclose(found.robot.model.friction.load, load)
    assert not any("load friction" in note for note in notes)


def test_files_after_a_turned_gravity_say_so(arm, tmp_path):
    _, found, world = judged(arm, "tilt", 1)
    notes = found.write(actuators=tmp_path / "drives.yaml")
    assert any("without tilt" in note for note in notes)
    np.testing.assert_allclose(found.robot.gravity, world.robot.gravity, atol=0.1)


def test_the_command_takes_causes(tmp_path):
    log = tmp_path / "log.csv"
    t = np.arange(0, 10, 0.01)
    q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    motion = tw.Motion(t, q, robot=ARM)
    tau = (motion.torques() + 0.05 * np.random.default_rng(0).normal(size=q.shape)) * [1.0, 2.0]
    tw.Motion(t, q, tau=tau, robot=ARM).to_csv(log)
    fixed = ["--cutoff", "10", "--shift", "0", "--json", str(tmp_path / "found.json"), "--overwrite"]
    given = ["identify", "planar_2r", str(log), "--assume", f"gain:{NAMES[1]}", *fixed]
    ran = CliRunner().invoke(main, given)
    assert ran.exit_code == 0 and f"Assumed: gain of {NAMES[1]} " in ran.output, ran.output
    (cause,) = json.loads((tmp_path / "found.json").read_text("utf-8"))["assumed"]
    assert abs(cause["value"] - 2.0) < 0.02 and cause["interval"][0] < cause["value"]
