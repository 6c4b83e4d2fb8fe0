"""First words of logs as they are: what was fitted or taken off is a note, and what does not change torques is no doubt."""

from __future__ import annotations

import importlib
from types import SimpleNamespace

import numpy as np
import pytest
from identification_logs import known_log
from scipy import stats

import twistwrench as tw
from twistwrench.core.estimation.cross_validation import HeldOut, HeldOutRows
from twistwrench.identification import identify
from twistwrench.identification.diagnosis.cause_doubts import _delay_taken_off
from twistwrench.identification.diagnosis.cause_fit import CauseFit
from twistwrench.identification.doubts.common_gain import unit_doubts
from twistwrench.identification.doubts.fit_doubts import _largest_at, _residual_above_noise, left_unexplained
from twistwrench.identification.hyperparameters import FitSettings, SettingRows
from twistwrench.identification.views.identified_robot import _open_groups

ARM = tw.robots.planar_2r()
CLOCK_SOUGHT = {"cutoff": 10.0, "friction_speed": 0.05}
GIVEN = CLOCK_SOUGHT | {"shift": 0.0}


@pytest.mark.parametrize(("rows", "word", "level"), [(4, "OK", "note"), (12, "UNSURE", "unsure")])
def test_a_delay_of_a_bus_that_was_taken_off_is_a_note(rows, word, level):
    """Up to 30 ms; beyond, positions may be commands."""
    log = known_log(ARM, 1)  # 200 Hz
    found = identify(ARM, log.changed(tau=np.roll(log.motion.tau, rows, axis=0), rows=slice(20, None)), **CLOCK_SOUGHT)
    (doubt,) = found.doubts
    assert (doubt.kind, doubt.level, found.verdict.word) == ("late", level, word), doubt
    assert ("commands" in doubt.sentence) == (level == "unsure")
    assert abs(found.settings.shift - rows / 200.0) < 2e-3


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("delay", "taken_off", "word", "level"),
    [
        (0.010, 0.0121, "in its place", "unsure"),  # ms apart: 2.1, and 2 are allowed
        (0.010, 0.0119, "is taken off", "note"),
        (0.010, 0.0079, "in its place", "unsure"),
        (0.025, 0.0276, "in its place", "unsure"),  # of 25 ms, a tenth
        (0.025, 0.0274, "is taken off", "note"),
        (0.0299, 0.0299, "is taken off.", "note"),
        (0.0301, 0.0301, "Are positions commands?", "unsure"),
    ],
)
def test_a_delay_is_taken_off_where_the_fit_has_it_to_2_ms_or_a_tenth_before_or_after(
    sign, delay, taken_off, word, level
):
    sentence, found = _delay_taken_off(sign * delay, sign * taken_off, "unsure")
    assert found == level
    assert word in sentence
    if word == "in its place":
        assert sentence == f"The fit has {sign * taken_off:.3f} s in its place: give shift={sign * delay:.3f}."


def with_load_friction(share):
    log = known_log(ARM, 1)
    m = log.motion
    rigid = np.asarray(ARM.inverse_dynamics(m.q, m.dq, m.ddq))
    return log, log.changed(tau=m.tau + share * np.abs(rigid) * np.tanh(m.dq / 0.05))


def test_load_friction_that_held_out_rows_confirm_is_fitted():
    """Unasked, with both residuals; the written robot has it, and ``none`` prevents it."""
    log, loaded = with_load_friction(0.1)
    found, plain = identify(ARM, loaded, **GIVEN), identify(ARM, loaded, **GIVEN, assume="none")
    (cause,) = found.settings.assumed
    assert found.verdict.ok and cause.kind == "load-friction" and cause.interval[0] < 10.0 < cause.interval[1]
    assert found.held_out.all < 0.95 * plain.held_out.all and found.load_friction["joint1"] > 0.09
    assert found.notes[0].startswith("Fitted: load-friction ") and "in place of" in found.notes[0]
    assert not plain.settings.assumed
    inside = np.abs(found.values - log.truth(found)) < np.diff(found.interval(), axis=1)[:, 0] / 2
    assert inside.mean() >= 0.85


def test_a_law_that_held_out_rows_do_not_confirm_is_a_note(monkeypatch):
    """The same log under a bound that nothing reaches."""
    _, loaded = with_load_friction(0.1)
    monkeypatch.setattr(importlib.import_module("twistwrench.identification.identify"), "_MIN_DECREASE", 0.99)
    found = identify(ARM, loaded, **GIVEN)
    assert not found.settings.assumed
    assert "Not fitted: load-friction, which would leave 2.43 %" in found.notes[-1]
    assert [one.level for one in found.doubts if one.kind == "load-friction"] == ["note"]


@pytest.mark.parametrize(("times", "word"), [(1.02, "OK"), (1.3, "UNSURE")])
def test_a_negative_value_counts_if_held_out_rows_need_it(times, word):
    """Coulomb friction of joint 1 overcompensated by 2 % of itself changes no prediction; by 30 %, it does."""
    log = known_log(ARM, 1, noise=0.005, seconds=40.0)
    tau = log.motion.tau.copy()
    tau[:, 0] -= times * log.drives["coulomb"][0] * np.tanh(log.motion.dq[:, 0] / 0.05)
    found = identify(ARM, log.changed(tau=tau), **GIVEN)
    (doubt,) = found.doubts
    assert "joint1.coulomb = -" in doubt.sentence and found.verdict.word == word


def test_groups_that_leave_torques_open_are_told_with_the_motion_that_tells_them():
    """By their effect on the torques of another motion, not by the share of their own value."""
    short = known_log(ARM, 1, seconds=6.0, noise=0.1)
    found = identify(ARM, short.motion, **GIVEN)
    assert found.open_for_torques and set(found.open_for_torques) <= set(found.groups)
    for name, (joint, share) in found.open_for_torques.items():
        k, j = found.groups.index(name), ARM.joint_names.index(joint)
        assert share == found.torque_shares[j, k] > 0.02
    text = str(found)
    assert "poorly determined" not in text and "of another motion's torques open, most" in " ".join(text.split())
    assert "poorly_determined" in found.to_dict()


def test_the_other_motion_is_as_fast_as_the_log_and_as_quick_to_turn():
    """An offset's column is 1, a damping's is the speed, an inertia's the acceleration; 200 random states give 5 % of it."""
    log = known_log(ARM, 1, seconds=4.0).motion
    found = identify(ARM, log, **GIVEN)
    effects = found.torque_shares / found.standard_deviations  # of a unit of each group
    for joint, name in enumerate(ARM.joint_names):
        (offset,) = (k for k, group in enumerate(found.groups) if group == f"{name}.offset")
        for parameter, rates in (("viscous", log.dq), ("motor_inertia", log.ddq), ("coulomb", np.sign(log.dq))):
            (group,) = (k for k, group in enumerate(found.groups) if f"{name}.{parameter}" in group)
            ratio = effects[joint, group] / effects[joint, offset]
            assert ratio == pytest.approx(np.sqrt((rates[:, joint] ** 2).mean()), rel=0.2), (name, parameter)


def test_laws_widen_intervals_by_what_is_uncertain_of_them():
    """A law that is certain is fitted or told, and one below two deviations of its own is noise."""
    from twistwrench.identification.diagnosis.cause_fit import log_fit
    from twistwrench.identification.diagnosis.diagnose import law_changes
    from twistwrench.identification.hyperparameters import FitSettings
    from twistwrench.identification.parameters import UnknownParameters
    from twistwrench.identification.rows import SteadySamples

    log, loaded = with_load_friction(0.3)
    settings, unknown = FitSettings(5.0, np.full(2, 0.05), 0.0), UnknownParameters(ARM)
    sizes = []
    for motion in (log.motion, loaded):
        samples = SteadySamples.pieces(motion.time, motion.q, np.asarray(motion.tau), "log")
        fit = log_fit(unknown, samples, settings, np.zeros(2, bool))
        whole = max((np.linalg.norm(fit.change(one.e, one.beta)) for one in fit.joint_causes if one.S > 0), default=0.0)
        sizes.append((np.linalg.norm(law_changes(fit), axis=1).max(initial=0.0), whole, fit))
    (clean, clean_whole, _), (certain, whole, fit) = sizes
    assert max(one.S for one in fit.joint_causes) > 1.0
    assert certain < 0.1 * whole and clean <= 0.5 * clean_whole


@pytest.mark.parametrize(("start", "named"), [(0.5, False), (0.0, True)])
def test_a_copied_column_has_the_values_and_not_only_the_motion_of_another_joint(start, named):
    """Two joints that a plan moves alike from different positions have columns of their own."""
    t = np.arange(0.0, 20.0, 0.01)
    first = np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t)
    q = np.stack([first, first + start], axis=1)
    tau = tw.Motion(t, q, robot=ARM, in_seconds=True).torques()
    tau += 0.05 * np.random.default_rng(0).normal(size=tau.shape)
    found = identify(ARM, tw.Motion(t, q, tau=tau, robot=ARM, in_seconds=True), **GIVEN)
    assert ("copied" in [doubt.kind for doubt in found.doubts]) == named


def test_the_more_causes_are_tried_the_surer_each_must_be():
    """Bonferroni: of eleven blocks of time, Student's t at 1 % over the number of causes, on both sides."""
    fit = SimpleNamespace(blocks=np.zeros(11))
    for tried in (1, 50):
        assert CauseFit.critical_t(fit, tried) == pytest.approx(stats.t.isf(0.005 / tried, 10))


def test_fifths_of_the_time_go_through_all_logs():
    """Two logs of 10 s on clocks of their own: each fifth has 4 s, the third the end of the first log and the begin of the second."""
    logs = SimpleNamespace(
        samples=[SimpleNamespace(start=0.0, seconds=10.0), SimpleNamespace(start=100.0, seconds=10.0)]
    )
    log, time = np.array([0, 0, 0, 1, 1, 1]), np.array([1.0, 5.0, 9.0, 101.0, 103.0, 109.9])
    assert SettingRows.folds(logs, log, time).tolist() == [0, 1, 2, 2, 3, 4]


@pytest.mark.parametrize(
    ("among", "held", "is_doubted"), [(0.02, 0.11, False), (0.10, 0.20, False), (0.05, 0.20, True), (0.02, 0.13, True)]
)
def test_other_logs_are_doubted_if_they_are_far_worse_and_bad(among, held, is_doubted):
    """More than 2.5 times the residual of the training logs, and more than 12 % of the torques."""
    test, own = (
        HeldOut(kind, np.array([x**2]), np.ones(1), ["j"]) for kind, x in (("test", held), ("five-fold", among))
    )
    assert [one.kind for one in left_unexplained(test, own)] == ["other-torques"] * is_doubted


def test_torques_that_are_logged_early_come_before_positions():
    assert "torques 2 ms before positions" in str(FitSettings(10.0, np.array([0.05]), -0.002))
    assert "torques 2 ms after positions" in str(FitSettings(10.0, np.array([0.05]), 0.002))


def test_the_largest_residual_may_have_either_sign():
    """-3 N m at 2 s is larger than 1 N m at 1 s."""
    measured = np.array([[0.0], [1.0], [-3.0], [0.5]])
    rows = HeldOutRows(np.arange(4.0), np.zeros(4, int), measured, np.zeros((4, 1)))
    assert _largest_at(HeldOut.from_rows("five-fold", rows, ["j"]), 0) == ", largest at t = 2.0000 s"


@pytest.mark.parametrize(("times", "loud"), [(2.6, False), (3.4, True)])
def test_a_residual_is_loud_from_three_times_the_noise_below_the_cut_off(times, loud):
    """White noise of deviation 1 at the rate r has a part of deviation √(2 f / r) below the cut-off f; filters: to 10 %."""
    cutoff, rate = 20.0, 200.0
    noise = np.random.default_rng(0).normal(size=(20_000, 1))
    residual = np.full((100, 1), times * np.sqrt(2 * cutoff / rate))
    log = SimpleNamespace(samples=[SimpleNamespace(rate=rate, tau=noise)])
    fit = {"W": np.zeros((100, 1, 1)), "x": np.zeros(1), "tau": residual, "dead": np.array([False]), "names": ("j",)}
    seen = SimpleNamespace(settings=SimpleNamespace(cutoff=cutoff), logs=[log], **fit)
    assert _residual_above_noise(seen) == loud


def test_a_unit_of_torques_is_named_by_its_own_factor():
    """1 N m is 0.73756 lbf ft; torques that are larger by the inverse are N m, converted from N m once more."""
    for gain, said in ((0.73756, "look like lbf ft"), (1.35582, "look like N m if they were in lbf ft")):
        (doubt,) = unit_doubts(SimpleNamespace(names=("j",)), gain)
        assert said in doubt.sentence, doubt.sentence
    assert unit_doubts(SimpleNamespace(names=("j",)), 1.2) == []


def test_the_speed_at_which_static_friction_fades_is_the_one_that_was_given():
    laws = ("viscous", "coulomb", "stribeck")
    found = identify(ARM, known_log(ARM, 1).motion, friction=laws, stribeck_speed=0.3, **GIVEN)
    assert found.base.unknown.stribeck_speed == 0.3


@pytest.mark.parametrize(
    ("group", "way"),
    [
        ("j.viscous", "fast and steadily"),  # a torque by the speed
        ("j.coulomb + 2 k.coulomb", "slowly in both directions"),  # the sign of the speed, and little else
        ("j.motor_inertia", "with large accelerations"),
        ("rod.mcx + 0.3 arm.m", "far and fast"),
    ],
)
def test_a_joint_is_to_move_as_its_parameter_shows(group, way):
    said = _open_groups(SimpleNamespace(open_for_torques={group: ("j", 0.05)}))
    assert said.endswith(f"move j {way}.") and "1 group leaves more than 2 %" in said and "5 % at j" in said
