"""Laws of invariance: a log that is written otherwise, with the same content, gets the same words."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from identification_logs import known_log
from leaning_arm import short_arm
from quick import mostly_slow

import twistwrench as tw
from twistwrench.identification import identify
from twistwrench.identification.diagnosis.causes import Law, side_in_play, unit_of_value
from twistwrench.identification.diagnosis.log_states import jump_of
from twistwrench.identification.parameters import turning_joints

ARM = tw.robots.planar_2r()
LOG = known_log(ARM, 1)
GIVEN = {"cutoff": 10.0, "friction_speed": 0.05, "shift": 0.0}


def gain(q, tau):
    """Torque of joint 2 times 1.5."""
    return q, tau * [1.0, 1.5]


def zero_that_changes(q, tau):
    """Belt of joint 2 that slips by 8 degrees."""
    return q + np.radians(8.0) * np.outer(LOG.motion.time >= 9.0, [0.0, 1.0]), tau


def play(q, tau):
    """Gear of joint 1 with a play of 1.6 degrees."""
    return q + np.radians(0.8) * np.tanh(LOG.motion.dq / 0.05) * [1.0, 0.0], tau


FAULTS = {"clean": lambda q, tau: (q, tau), "gain": gain, "zero-change": zero_that_changes, "backlash": play}
_UNITS = {
    "q": ("joint1", "joint2"), "deg": ("joint1 [deg]", "joint2 [deg]"), "tau": ("joint1.torque", "joint2.torque"),
    "N cm": ("joint1.torque [N cm]", "joint2.torque [N cm]"),
}  # fmt: skip


def columns_of(fault):
    """Columns of the log with a fault, by their headers."""
    q, tau = FAULTS[fault](LOG.motion.q.copy(), LOG.motion.tau.copy())
    return (
        {"time": LOG.motion.time}
        | dict(zip(_UNITS["q"], q.T, strict=True))
        | dict(zip(_UNITS["tau"], tau.T, strict=True))
    )


def in_other_units(columns):
    found = {"time": columns["time"]}
    found |= {new: np.degrees(columns[old]) for old, new in zip(_UNITS["q"], _UNITS["deg"], strict=True)}
    return found | {new: 100.0 * columns[old] for old, new in zip(_UNITS["tau"], _UNITS["N cm"], strict=True)}


def in_another_order(columns):
    return dict(reversed(columns.items()))


def later(columns):
    return columns | {"time": columns["time"] + 1024.0}


def in_milliseconds(columns):
    return {"time [ms]": 1e3 * columns["time"]} | {name: x for name, x in columns.items() if name != "time"}


def a_turn_on(columns):
    return columns | {"joint1": columns["joint1"] + 2.0 * np.pi}


def words_of(columns, path):
    """Verdict, and kinds of doubts with their joints."""
    header = ",".join(columns)
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=header, comments="", fmt="%.12g")
    found = identify(ARM, path, **GIVEN)
    return found.verdict.word, [(one.kind, one.joints, one.level) for one in found.doubts]


@pytest.mark.parametrize("fault", mostly_slow(FAULTS, 4))
def test_the_same_log_written_otherwise_gets_the_same_words(fault, tmp_path):
    """Units, order of columns, begin of the clock, unit of time, and a turn of a joint."""
    columns = columns_of(fault)
    plain = words_of(columns, tmp_path / "plain.csv")
    assert [kind for kind, _, level in plain[1] if level != "note"][:1] == ([] if fault == "clean" else [fault]), plain
    for change in (in_other_units, in_another_order, later, in_milliseconds, a_turn_on):
        assert words_of(change(columns), tmp_path / f"{change.__name__}.csv") == plain, change.__name__


def test_a_play_and_a_zero_that_changes_have_their_sizes():
    """Degrees, though a motor that crosses its play takes some time."""
    for fault, size in (("zero-change", 8.0), ("backlash", 1.6)):
        q, tau = FAULTS[fault](LOG.motion.q.copy(), LOG.motion.tau.copy())
        found = identify(ARM, tw.Motion(LOG.motion.time, q, tau=tau, robot=ARM, in_seconds=True), **GIVEN)
        first = found.doubts[0]
        assert first.kind == fault and first.unit == "deg" and not found.verdict.ok
        assert first.value == pytest.approx(size, rel=0.15), first


def test_a_displacement_of_a_sliding_joint_is_a_length():
    """A belt that slips by 80 mm and a rack with a play of 40 mm are not told in degrees."""
    arm = short_arm()
    log = known_log(arm, 1).motion
    is_slide = ~turning_joints(arm.model)
    slip = 0.08 * np.outer(log.time >= 9.0, is_slide)
    half_play = 0.02 * np.tanh(log.dq / 0.02) * is_slide
    for kind, q, size in (("zero-change", log.q + slip, 80.0), ("backlash", log.q + half_play, 40.0)):
        found = identify(arm, tw.Motion(log.time, q, tau=log.tau, robot=arm, in_seconds=True), **GIVEN)
        first = next(doubt for doubt in found.doubts if doubt.kind == kind)
        assert first.joints == ("slide",) and first.unit == "mm"
        assert first.value == pytest.approx(size, rel=0.15), first
        assert f" {first.value:.3g} mm" in first.sentence and "degrees" not in first.sentence


def test_an_elasticity_of_all_joints_has_the_units_of_its_joints():
    """One value for joints that turn and joints that slide is a displacement in rad or m."""
    model = short_arm().model
    units = [unit_of_value("elasticity", joints, model) for joints in ((0,), (1,), (0, 2), ())]
    assert units == ["deg", "mm", "deg", "rad or m"]


def test_a_jump_is_at_the_first_sample_of_the_new_zero():
    """A steady motion with 0.5 rad more from sample 30 on; without that, nothing jumps."""
    steady = 0.01 * np.arange(60.0)
    assert jump_of(steady + 0.5 * (np.arange(60) >= 30)) == 30
    assert jump_of(steady + 1e-4 * np.random.default_rng(0).normal(size=60)) is None


def test_a_step_within_a_few_samples_is_no_jump():
    """In 11 samples all other steps are beside it, so nothing tells how large steps usually are; in 21 samples they rest."""
    assert jump_of(np.repeat([0.0, 1.0], [5, 6])) is None
    assert jump_of(np.repeat([0.0, 1.0], [10, 11])) == 10


def test_a_change_lasts_to_the_end_of_the_last_piece():
    """It begins 5 s into the first of two pieces, so the second has it from its first row on, whatever its clock says."""
    states = SimpleNamespace(piece=np.array([0, 0, 0, 1, 1]), time=np.array([4.0, 5.0, 6.0, 1.0, 9.0]))
    law = Law("offset-step", (0,), lambda *_: np.ones((5, 1)), since=(0, 5.0))
    assert law.acting(states).tolist() == [False, True, True, True, True]


def test_a_link_in_a_play_follows_its_motor_half_a_play_behind():
    """Forward it is pushed at one end of the play and backward at the other; in between it rests while the motor crosses it."""
    motor = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101)])
    side = side_in_play(motor, 0.05)
    np.testing.assert_allclose([side[50], side[151]], [1.0, -1.0], atol=1e-9)
    crossing = motor - 0.05 * side
    np.testing.assert_allclose(crossing[101:111], 0.95, atol=1e-9)
