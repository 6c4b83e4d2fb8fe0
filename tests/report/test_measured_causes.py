"""Causes of measured torques in the report of ``torques``: by name, in place of figures, and none for a right log."""

from dataclasses import replace

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.doubts import doubt_table
from twistwrench.identification.diagnosis.cause_doubts import _level_of_row
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.load_case import LoadCase
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.doors import measured_causes
from twistwrench.reports.torque_analysis import analyse
from twistwrench.reports.torque_report import TorqueReport
from twistwrench.reports.torque_verdict import notes_of

ARM = tw.robots.planar_3r()
T = np.arange(0, 20, 0.01)
Q = np.stack([np.sin(w * T + k) + 0.5 * np.sin(2.3 * w * T) for k, w in enumerate((1.1, 1.7, 2.3))], axis=1)
MOTION = tw.Motion(T, Q, robot=ARM)
TORQUES = MOTION.torques() + 0.3 * np.tanh(MOTION.dq / 0.01) + 0.1 * MOTION.dq
NOISE = 0.01 * TORQUES.std(axis=0) * np.random.default_rng(0).normal(size=TORQUES.shape)
MEASURED = TORQUES + NOISE


def report(tmp_path, q=Q, tau=MEASURED, *, load=None, limits=ARM.model.limits):
    tw.Motion(T, q, tau=tau, robot=ARM).to_csv(tmp_path / "log.csv")
    log = MotionLog.open(tmp_path / "log.csv", ARM.model)
    found = analyse(load or LoadCase(ARM), Differentiation.plan(log, ARM.model), limits)
    object.__setattr__(found, "causes", measured_causes(found, log))
    return found


def kinds(found: TorqueReport):
    return [cause.kind for cause in found.causes]


def test_a_right_log_has_none(tmp_path):
    found = report(tmp_path)
    assert not found.causes


def test_a_position_of_the_wrong_sign_replaces_the_comparison_of_all_joints(tmp_path):
    found = report(tmp_path, Q * [1, -1, 1])
    assert kinds(found) == ["position-sign"] and found.causes[0].joints == ("joint2",)
    assert any(m.disagrees for m in found.measured)
    words = " ".join(found.verdict.reasons)
    assert "position of joint2 has the wrong sign" in words and "disagrees" not in words


def test_a_torque_of_the_wrong_sign_is_look_again_in_its_own_words(tmp_path):
    found = report(tmp_path, tau=MEASURED * [1, -1, 1])
    assert kinds(found) == ["torque-sign"] and found.verdict.word == "LOOK AGAIN"
    assert found.verdict.reasons[0].startswith("the torque of joint2 has the wrong sign")
    assert "disagrees" not in " ".join(found.verdict.reasons)


def test_a_gain_that_changes_predictions_is_unsure_with_its_value(tmp_path):
    found = report(tmp_path, tau=MEASURED * [1, 1.3, 1])
    cause = found.causes[0]
    assert (cause.kind, cause.joints) == ("gain", ("joint2",)) and cause.interval[0] < 1.3 < cause.interval[1]
    assert any("joint2 is 1.3" in reason for reason in found.verdict.reasons)
    assert not any("1.3" in note for note in notes_of(found))


def test_a_gain_of_a_few_per_cent_is_a_note(tmp_path):
    found = report(tmp_path, tau=MEASURED * [1, 1.04, 1])
    assert kinds(found) == ["gain"] and found.causes[0].effect < 0.05
    assert any("joint2 is 1.04" in note for note in notes_of(found)) and "1.04" not in " ".join(found.verdict.reasons)


def test_a_difference_below_a_fiftieth_of_the_limit_is_a_note(tmp_path):
    off = 2.0 * np.abs(TORQUES[:, 2]).max()
    words = []
    for effort in (49.0 * off, 51.0 * off):
        limits = replace(ARM.model.limits, effort=np.full(3, effort))
        words.append(" ".join(report(tmp_path, tau=MEASURED + np.array([0, 0, off]), limits=limits).verdict.reasons))
    assert "disagrees" in words[0] and "disagrees" not in words[1]


def test_a_cause_that_is_seen_without_a_model_is_a_note_where_it_changes_nothing():
    """A push within a log: unsure by its row of the table, unless the predictions are the same without it."""
    row = doubt_table()["push"]
    assert (row.stage, row.level) == (1, "unsure")
    assert [_level_of_row(row, level) for level in ("note", "unsure", "refuse")] == ["note", "unsure", "unsure"]


def test_a_law_of_a_joint_is_a_note_whatever_its_size(tmp_path):
    warming = 0.3 * np.tanh(MOTION.dq / 0.01) * np.linspace(0, 4, len(T))[:, None]
    found = report(tmp_path, tau=MEASURED + warming * [0, 0, 1])
    assert kinds(found)[0] == "warming" and found.causes[0].joints == ("joint3",)
    assert any(note[1:] == str(found.causes[0])[1:] for note in notes_of(found))
    assert "changes during" not in " ".join(found.verdict.reasons)


def test_every_cause_is_in_the_verdict_or_in_the_notes(tmp_path):
    """Beyond the limits, too, where measured torques refute the excess; and of joints far below their limits."""
    words = []
    for effort in (10.0, 1e6):
        found = report(tmp_path, Q * [1, -1, 1], limits=replace(ARM.model.limits, effort=np.full(3, effort)))
        words.append(str(found.verdict.word))
        printed = " ".join([*found.verdict.reasons, *notes_of(found)])
        assert found.causes and all(cause.sentence[1:].rstrip(".") in printed for cause in found.causes)
    assert words == ["UNSURE", "UNSURE"]


@pytest.mark.parametrize("why", ["wrench", "cut off"])
def test_where_other_forces_act_or_torques_are_cut_off_no_cause_is_sought(tmp_path, why):
    q, tau, load = Q * [1, -1, 1], MEASURED, None
    if why == "wrench":
        load = LoadCase(ARM, (), {ARM.model.tip: np.ones(6)})
    else:
        tau = np.clip(tau, *(0.5 * np.stack([tau.min(axis=0), tau.max(axis=0)])))
    assert not report(tmp_path, q, tau, load=load).causes


def test_a_robot_whose_parameters_no_log_tells_has_no_causes():
    box, t = tw.robots.floating_box(), np.arange(0, 1, 0.01)
    still = tw.Motion(t, np.tile(box.neutral, (len(t), 1)), tau=np.ones((len(t), box.nv)), robot=box)
    assert tw.identification.measured_causes(box, still) == ()
    short = tw.Motion(T[:100], Q[:100] * [1, -1, 1], tau=MEASURED[:100], robot=ARM)
    assert tw.identification.measured_causes(ARM, short) == ()


def test_a_swaying_base_is_not_looked_for_if_it_would_not_load_the_joints(tmp_path):
    """A balanced wheel on an upright axis: its torque tells nothing about the base."""
    (tmp_path / "wheel.urdf").write_text(WHEEL)
    wheel, times = tw.load(tmp_path / "wheel.urdf"), T[:400]
    turned = tw.Motion(times, 3.0 * Q[:400, :1], robot=wheel)
    tau = turned.torques() + 1e-3 * NOISE[:400, :1]
    tw.Motion(times, turned.q, tau=tau, robot=wheel).to_csv(tmp_path / "log.csv")
    log = MotionLog.open(tmp_path / "log.csv", wheel.model)
    found = analyse(LoadCase(wheel), Differentiation.plan(log, wheel.model), wheel.model.limits)
    assert measured_causes(found, log) == ()


WHEEL = """<robot name="wheel"><link name="base"/><link name="disc"><inertial><mass value="2"/>
<inertia ixx="0.02" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="rotor" type="continuous"><parent link="base"/><child link="disc"/><axis xyz="0 0 1"/>
<limit effort="6" velocity="70"/></joint></robot>"""


def test_a_gain_that_may_be_any_is_no_cause(tmp_path):
    found = report(tmp_path, tau=1e3 * MEASURED)
    assert not [cause for cause in found.causes if cause.kind == "gain" and cause.interval[0] < 1.0]
    assert found.verdict.word == "LOOK AGAIN"
    assert "times what is computed" in found.verdict.reasons[0]
