"""Verdict on a motion's torques: limits, doubts about log and limits, and confidence."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Sequence

import numpy as np

from ..core.answers.sentences import sentence
from ..core.colours import NEAR_LIMIT
from ..core.doubts import Doubt, Level, doubt_table
from ..core.numbers import deviation, number, over_limit, percent, percent_of_limit, seconds, torque
from ..core.text import Argument, ReadingNote, listed, spell
from ..core.typing import Array
from ..core.verdict import Verdict, Word
from ..mechanics.joints.units import unit_of
from ..mechanics.model.limits import BEARINGS
from ..mechanics.model.model import BASE
from ..motion.coordinates import Coordinates
from ..motion.credible_values import credible_limits
from ..motion.limits_file import notes_on_limits
from ..motion.load_case import cause_label, drives_without_limit, limit_doubts, limits_remedy
from ..motion.model_doubts import (
    PeakTorque,
    base_doubts,
    hanging_excess,
    missing_force,
    model_warnings,
    open_loop_excess,
    open_loop_joints,
)
from ..motion.plausibility import Origin
from .measured_torque import MeasuredTorque
from .statistics import INTERVAL
from .support.judgement import support_notes, support_verdict
from .torque_report import MIN_NOISE_SHARE, Excess, JointTorque, TorqueReport

KINDS = {
    "lower": "position",
    "upper": "position",
    "velocity": "velocity",
    "effort": "torque",
    "axial": "axial force",
    "radial": "radial force",
    "tilting": "tilting moment",
}
"""Quantity of each kind of limit."""
_LOAD_KINDS = ("effort", *BEARINGS)
"""Kinds of limits that depend on what holds the robot."""
_ERROR_PROBABILITY = 0.025
"""Probability that noise makes some joint appear over its limit, or hides that one is."""
_MAX_SIGMAS_OF_NOISE = 5.0
"""Number of standard deviations that none of some million samples exceeds."""
_MAX_UNCERTAIN_SHARE = 0.5
"""Fraction of a peak above which half its 95 % interval, or its noise correction, makes it unsure."""
_MIN_SHARE_OF_LIMIT = 0.5
"""Fraction of a joint's limit above which an unsure peak matters."""
_MIN_SHARE_OF_LARGEST = 0.02
"""Fraction of the largest torque above which an unsure peak of a joint without a limit matters."""
_MAX_HIDDEN_SHARE = 0.15
"""Fraction of the time above which a gap with motion hides too much. If a torque is near its limit, every such gap does."""
_MAX_STEPS_TO_GAP = 3
"""Distance in median steps of the log within which a peak is at the end of a gap."""
_MAX_LISTED_JOINTS = 4
"""Largest number of joints, and of samples, that a sentence lists."""


def verdict_of(report: TorqueReport, *, degrees: bool = False) -> Verdict:
    """Verdict of a report; angles in degrees if ``degrees``.

    A limit is certainly exceeded if the excess is larger than noise explains, including the selection of the largest value and
    of the worst joint. An excess that noise may hide or cause is unsure; one that smoothing certainly removes is neither.
    """
    excesses, open_torques = _judge_torques(report)
    excesses += _motion_excesses(report, degrees=degrees)
    doubts_of_base = base_doubts(report.load.robot.model, "hanging, feet")
    may_hang = bool(doubts_of_base)
    certain = _certain_excesses(report, excesses, loads_doubted=may_hang)
    excess_reasons = _excess_sentences(certain)
    doubts = _unsure_doubts([*doubts_of_limits(report), *report.load.doubts]) + rows_in_doubt(report)
    if excesses and not certain:
        worst_sentence, *_ = _excess_sentences(excesses)
        doubts.append(_doubtful_excess(report, worst_sentence, hanging=may_hang))
    for use in report.motors:
        if not use.too_small:
            continue
        motor_sentence = f"the motor of {use.words} is too small"
        if may_hang:
            doubts.append(hanging_excess(motor_sentence))
        else:
            excess_reasons.append(motor_sentence)
    missing_limits = limit_doubts(report.load.robot, report.limits, report.peaks)
    doubts_before, doubts_after = carried_doubts(report, report.joints)
    max_hidden = most_hidden(report)
    shares = [j.share for j in report.joints]
    if max(shares, default=0.0) > NEAR_LIMIT:  # then every gap with motion hides too much
        max_hidden = 0.0
    gaps = _gap_doubts(report, max_hidden)
    doubts_after = [reason for reason in doubts_after if reason not in doubts]
    verdict_on_torques = Verdict.from_reasons(
        look_again=contradictions(report),
        over=excess_reasons,
        unsure=[*doubts_of_base, *doubts, *missing_limits, *open_torques, *doubts_before, *gaps, *doubts_after],
    )
    return _join_further_verdicts(report, verdict_on_torques)


def _join_further_verdicts(report: TorqueReport, verdict: Verdict) -> Verdict:
    """Verdict on torques and on grip, mounting, support and clearance, if they are judged."""
    if report.held.grip is not None:
        verdict = report.held.grip.verdict.joined(verdict)
    if report.held.mounting is not None:
        verdict = report.held.mounting.verdict.joined(verdict)
    if report.held.support is not None:
        verdict = support_verdict(report.held.support).joined(verdict)
    if report.clearance is not None:
        verdict = verdict.joined(report.clearance.verdict)
    return verdict


def _motion_excesses(report: TorqueReport, *, degrees: bool) -> list[tuple[Excess, str]]:
    """Exceeded limits of positions, velocities and bearings, with their sentences.

    Position limits are left out for joints whose angles are compared with them after a turn more or less.
    """
    excesses, _ = _judge_motion(report, degrees=degrees)
    turned_joints = _turned_joints(report, level="note")
    comparable_excesses = []
    for e, text in excesses:
        is_of_turned_joint = e.kind in _STOP_KINDS and e.joint in turned_joints
        if not is_of_turned_joint:
            comparable_excesses.append((e, text))
    return comparable_excesses


def _certain_excesses(
    report: TorqueReport, excesses: list[tuple[Excess, str]], *, loads_doubted: bool
) -> list[tuple[Excess, str]]:
    """Excesses, with sentences, without doubts about their rows or, for loads, about what holds the robot."""
    doubted = doubted_excesses(report)
    open_joints = open_loop_joints(report.load.robot.model)
    unbalanced_times = _unbalanced_times(report)
    certain = []
    for e, text in excesses:
        load_is_doubted = loads_doubted or e.joint in open_joints or e.time in unbalanced_times
        if e.kind in _LOAD_KINDS and load_is_doubted:
            continue
        if (e.joint, e.kind) not in doubted:
            certain.append((e, text))
    return certain


def _unbalanced_times(report: TorqueReport) -> Array:
    """Times (k,) at which no forces of the ground balance the robot, so that its torques are of forces that do not exist."""
    support = report.held.support
    if support is None:
        return np.zeros(0)
    return np.asarray(support.time[support.aground & ~support.balanced])


def _doubtful_excess(report: TorqueReport, excess: str, *, hanging: bool) -> str:
    """Sentence ``excess`` on the worst excess, with the condition under which it is certain."""
    if doubted_excesses(report):
        return f"{condition_of_excesses(report)} {Word.OVER_LIMIT}: {excess}"
    if hanging:
        return hanging_excess(excess)
    if len(_unbalanced_times(report)):
        return f"as if the contacts stuck to the ground {Word.OVER_LIMIT}: {excess}"
    return open_loop_excess(excess)


def _gap_doubts(report: TorqueReport, max_hidden: float) -> list[str]:
    """Sentence on the longest gap with motion, if it is longer than ``max_hidden`` [s]."""
    if report.gaps.hidden > max_hidden:
        return [report.gaps.hidden_words]
    return []


def _unsure_doubts(doubts: Iterable[Doubt], kind: str | None = None) -> list[str]:
    """Sentences of the doubts that make a verdict unsure, of one ``kind`` if given."""
    return [str(doubt) for doubt in doubts if doubt.level == "unsure" and kind in (None, doubt.kind)]


def _has_kind(doubts: Iterable[Doubt], kinds: Collection[str]) -> bool:
    """True if one of the doubts is of one of the kinds."""
    return any(doubt.kind in kinds for doubt in doubts)


_DOUBTS_OF_WHOLE_LOG = (
    "repeated",
    "buffered",
    "impossible-speed",
    "impossible-torque",
    "impact",
    "lone-step",
    "zero-or-direction",
)
"""Doubts that concern all derived figures of the log."""
_MIN_DECISIVE_CHANGE = 0.05
"""Change of a share of a limit that makes rows in doubt decisive."""


def doubted_excesses(report: TorqueReport) -> set[tuple[str, str]]:
    """Joint and kind of the excesses that depend on rows or effort limits in doubt."""
    doubted = _doubted_by_log(report)
    if _has_kind(doubts_of_limits(report), ("effort-unit", "effort-weight")):
        doubted = doubted | _joints_and_kinds(report.excesses, ["effort"])
    return doubted


def _doubted_by_log(report: TorqueReport) -> set[tuple[str, str]]:
    """Joint and kind of all excesses if the whole log is in doubt, otherwise of excesses that only rows in doubt have."""
    if report.differentiation.trajectory.origin is Origin.PLAN:
        return set()
    excesses = _joints_and_kinds(report.excesses)
    if _has_kind(report.doubts, _DOUBTS_OF_WHOLE_LOG):
        return excesses
    refuted = _refuted_excesses(report)
    if report.sound is None:
        return refuted
    return refuted | (excesses - _joints_and_kinds(report.sound.excesses))


def _joints_and_kinds(excesses: Iterable[Excess], kinds: Collection[str] = tuple(KINDS)) -> set[tuple[str, str]]:
    """Joint and kind of the excesses of these kinds."""
    return {(e.joint, e.kind) for e in excesses if e.kind in kinds}


def _refuted_excesses(report: TorqueReport) -> set[tuple[str, str]]:
    """Joint and kind of the excesses that a measured torque or a turn more or less contradicts."""
    refuted = set(itertools.product(_turned_joints(report, level="unsure"), _STOP_KINDS))
    for m in report.measured:
        if m.refutes:
            refuted.add((m.joint, "effort"))
    return _joints_and_kinds(report.excesses) & refuted


_STOP_KINDS = "lower", "upper"
"""Kinds of limits that are position limits."""


def _turned_joints(report: TorqueReport, *, level: Level) -> set[str]:
    """Joints whose angles are compared with their stops after a turn more or less, by doubts of this level."""
    joints: set[str] = set()
    for doubt in report.doubts:
        if doubt.kind == "wound" and doubt.level == level:
            joints.update(doubt.joints)
    return joints


def rows_in_doubt(report: TorqueReport) -> list[str]:
    """Sentences on rows that are missing, repeated or wrong, if they decide a figure; empty otherwise."""
    doubted = _doubted_by_log(report)
    doubts_of_log = [str(doubt) for doubt in report.doubts if doubt.kind in _DOUBTS_OF_WHOLE_LOG and not doubt.refuses]
    if doubts_of_log:
        return doubts_of_log if doubted else []
    refutations = _unsure_doubts(report.doubts, "wound")
    for m in report.measured:
        if m.refutes and (m.joint, "effort") in doubted:
            refutations.append(m.refuting_words)
    if report.sound is None:
        return refutations
    doubted_by_rows = doubted - _refuted_excesses(report)
    if doubted:
        rows_are_decisive = bool(doubted_by_rows)
    else:
        change = _change_of_share(report, report.sound.peaks)
        rows_are_decisive = change >= _MIN_DECISIVE_CHANGE
    if not rows_are_decisive:
        return refutations
    times = [e.time for e in report.excesses if (e.joint, e.kind) in doubted_by_rows]
    if not times and report.worst is not None:
        times = [report.joints[report.worst].time]
    return [str(report.spans.doubt_at(times)), *refutations]


def _change_of_share(report: TorqueReport, sound_peaks: Array) -> float:
    """Largest share of a torque limit over all rows, less the largest share of the peaks (nv,) in sound rows."""
    peaks = np.array([abs(j.largest) for j in report.joints])
    limits = np.array([j.limit for j in report.joints])
    return float((peaks / limits).max(initial=0.0) - (sound_peaks / limits).max(initial=0.0))


def condition_of_excesses(report: TorqueReport) -> str:
    """Condition under which the excesses of a log in doubt are certain."""
    if not _doubted_by_log(report):
        return "by these limits"
    if report.differentiation.trajectory.origin is Origin.EITHER:
        return "as a plan"
    return "as it stands"


def most_hidden(report: TorqueReport) -> float:
    """Longest gap [s] with motion that leaves the verdict sure; 0 if a peak may lie in a gap or continue there."""
    max_distance = _MAX_STEPS_TO_GAP * report.quality.step
    if report.gaps.exceeds_logged_motion:
        return 0.0
    for j in report.joints:
        if not report.is_zero(j.largest) and report.gaps.beside(j.time, max_distance):
            return 0.0
    return _MAX_HIDDEN_SHARE * (report.end - report.begin)


def contradictions(report: TorqueReport) -> list[str]:
    """Reasons to look again at the input that do not depend on payload and speed."""
    refusing = [str(doubt) for doubt in (*doubts_of_limits(report), *report.doubts) if doubt.refuses]
    return [*report.load.contradictions, *refusing, *_reasons_of_differing_torques(report, contradicting=True)]


def doubts_of_limits(report: TorqueReport) -> list[Doubt]:
    """Doubts about the limits; limits that do not carry the weight count only if a torque limit is exceeded."""
    return credible_limits(report.limits, report.load.robot, weight=bool(_torque_excesses(report)))


def carried_doubts(report: TorqueReport, joints: Sequence[PeakTorque] = ()) -> tuple[list[str], list[str]]:
    """Reasons to be unsure for all slider positions of a page, to be listed before and after reasons on gaps of the log.

    If ``joints`` holds the peaks of all velocities, the reasons include the missing force of a floating base.
    """
    _, noisy_excesses = _judge_motion(report)
    before = _wide_peaks(report) + noisy_excesses + model_warnings(report.load.with_load.model, joints)
    return before, _reasons_of_log(report)


def log_doubts(report: TorqueReport) -> list[str]:
    """Reasons to be unsure of all loads of a log, for any verdict on these loads."""
    return [*_gap_doubts(report, most_hidden(report)), *_reasons_of_log(report)]


def _reasons_of_log(report: TorqueReport) -> list[str]:
    """Reasons to be unsure from glitches, doubts and measured torques of a log."""
    reasons = []
    if any(outlier.matters for outlier in report.outliers):
        reasons.append(
            "samples that look like glitches were smoothed away; if the robot moved so, torques there are too low"
        )
    reasons += _unsure_doubts(report.doubts)
    reasons += [m.above_words for m in report.measured if m.lasting and not m.contradicts]
    reasons += [m.cut_words for m in report.measured if m.cut and m.matters]
    differing = _differing_torques(report)
    for cause in report.causes:
        if _concerns_other_motions(cause) and not _explains_any(cause, differing):
            reasons.append(cause.sentence.rstrip("."))
    return reasons + _reasons_of_differing_torques(report, contradicting=False)


def _differing_torques(report: TorqueReport) -> list[MeasuredTorque]:
    """Measured torques whose difference from the computed torques affects the verdict."""
    min_differences = {j.joint: _MIN_DIFFERENCE_OF_LIMIT * j.limit for j in _limited_joints(report)}
    differing_torques = []
    for m in report.measured:
        min_difference = min_differences.get(m.joint, 0.0)  # any difference counts without a limit
        if m.disagrees and m.residual > min_difference:
            differing_torques.append(m)
    return differing_torques


_MIN_DIFFERENCE_OF_LIMIT = 0.02
"""Fraction of a joint's limit above which the difference of measured and computed torques affects the verdict."""
_CAUSES_OF_OWN_TORQUES = ("torque-sign", "exchanged-torques", "gain")
"""Causes that affect only measured torques of their joints."""
_MINOR_CAUSES = ("late", "low-pass")
"""Causes with small effects."""


def _is_gross(cause: Doubt) -> bool:
    """True if a cause has large effects on torques: a discrete or continuous change (stages 2 and 3), not a joint law."""
    return doubt_table()[cause.kind].stage in (2, 3) and cause.kind not in _MINOR_CAUSES


def explains(cause: Doubt, joint: str) -> bool:
    """True if a cause makes a joint's measured torque differ grossly from the computed one; joint laws do not."""
    if not _is_gross(cause):
        return False
    return cause.kind not in _CAUSES_OF_OWN_TORQUES or joint in cause.joints


def _explains_any(cause: Doubt, measured: Iterable[MeasuredTorque]) -> bool:
    """True if a cause explains one of the measured torques."""
    return any(explains(cause, m.joint) for m in measured)


def _is_explained(joint: str, causes: Iterable[Doubt]) -> bool:
    """True if one of the causes explains the measured torque of a joint."""
    return any(explains(cause, joint) for cause in causes)


def _concerns_other_motions(cause: Doubt) -> bool:
    """True if a cause also affects other motions, so that computed torques are in doubt."""
    return cause.refuses and _is_gross(cause)


def _reasons_of_differing_torques(report: TorqueReport, *, contradicting: bool) -> list[str]:
    """Reasons from differing measured torques: named causes, and figures of joints without a cause.

    If ``contradicting``, only torques that contradict the model are considered, otherwise only the other torques.
    """
    differing = [m for m in _differing_torques(report) if m.contradicts == contradicting]
    causes = [cause for cause in report.causes if _explains_any(cause, differing)]
    reasons = [cause.sentence.rstrip(".") for cause in causes]
    unexplained = [m.words for m in differing if not _is_explained(m.joint, causes)]
    if unexplained:
        figures = listed(unexplained, _MAX_LISTED_JOINTS, "; ")
        reasons.append(f"the file's own torque column disagrees with the torques computed: {figures}")
    return reasons


def confidence(joints: int) -> float:
    """Number of standard deviations that bounds the peaks of so many joints simultaneously."""
    from scipy.special import ndtri

    return float(ndtri(1.0 - _ERROR_PROBABILITY / max(1, joints)))


def _judge_torques(report: TorqueReport) -> tuple[list[tuple[Excess, str]], list[str]]:
    """Exceeded torque limits with sentences, worst first, and sentences on joints for which noise leaves this open."""
    limited = _limited_joints(report)
    deviations = confidence(len(limited))
    excess_by_joint = _torque_excesses(report)
    excesses: list[tuple[Excess, str]] = []
    open_sentences: list[str] = []
    for j in limited:
        half_width = deviations * report.reach(j)
        excess = excess_by_joint.get(j.joint)
        if excess is not None and abs(j.peak) - half_width > j.limit:
            excesses.append((excess, _over_sentence(report, j)))
        elif _is_open(j, half_width, excess):
            open_sentences.append(_open_sentence(report, j))
    for follower_excess, text in _judge_followers(report):
        if follower_excess is None:
            open_sentences.append(text)
        else:
            excesses.append((follower_excess, text))
    return excesses, open_sentences


def _limited_joints(report: TorqueReport) -> list[JointTorque]:
    """Joints with a torque limit, the largest share first."""
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    return sorted(limited, key=lambda j: -j.share)


def _torque_excesses(report: TorqueReport) -> dict[str, Excess]:
    """Exceeded torque limits by joint."""
    return {e.joint: e for e in report.excesses if e.kind == "effort"}


def _open_sentence(report: TorqueReport, j: JointTorque) -> str:
    """Sentence on a joint for which noise decides whether its limit is exceeded."""
    end_text = sentence("end") if report.at_an_end(j) else ""
    return sentence(
        "open",
        joint=j.joint,
        end=end_text,
        peak=torque(j.peak),
        sigma=deviation(report.reach(j)),
        unit=j.unit,
        limit=number(j.limit),
    )


def _is_open(j: JointTorque, half_width: float, excess: Excess | None) -> bool:
    """True if the limit may be exceeded, with the peak uncertain by ``half_width``."""
    if half_width == 0 and excess is None:
        return False
    return bool(over_limit((abs(j.peak) + half_width) / j.limit))


def _wide_peaks(report: TorqueReport) -> list[str]:
    """Sentence, as a list, on joints with peaks too uncertain due to noise; joints with an open limit are left out."""
    limited = _limited_joints(report)
    deviations = confidence(len(limited))
    excess_by_joint = _torque_excesses(report)
    candidates = []
    for j in limited:
        half_width = deviations * report.reach(j)
        if not _is_open(j, half_width, excess_by_joint.get(j.joint)):
            candidates.append(j)
    candidates += [j for j in report.joints if not math.isfinite(j.limit)]
    peaks = [_peak_text(report, j) for j in candidates if _is_wide(report, j)]
    if not peaks:
        return []
    return [f"noise is too large a part of the peak: {listed(peaks, _MAX_LISTED_JOINTS, '; ')}"]


def _judge_followers(report: TorqueReport) -> list[tuple[Excess | None, str]]:
    """Mimic joints over their torque limits, with sentences; the excess is None if noise may explain it.

    A mimic joint's torque is as uncertain as its leader's.
    """
    deviations = confidence(len(_limited_joints(report)))
    leaders = {j.joint for j in report.joints}
    bodies = {body.joint.name: body for body in report.load.robot.model.bodies}
    judged: list[tuple[Excess | None, str]] = []
    for name, e in _torque_excesses(report).items():
        if name in leaders:
            continue
        body = bodies[name]
        leader = report.joints[body.v_index]
        sigma = 0.0
        if body.ratio:
            sigma = report.reach(leader) / abs(body.ratio)
        share = percent_of_limit(abs(e.value) / e.limit)
        figures = {"peak": torque(e.value), "unit": e.unit, "limit": number(e.limit), "share": share}
        if abs(e.value) - deviations * sigma > e.limit:
            text = sentence("follower", joint=e.joint, leader=leader.joint, time=seconds(e.time), **figures)
            judged.append((e, text))
        else:
            judged.append((None, sentence("open follower", joint=e.joint, **figures)))
    return judged


def _is_wide(report: TorqueReport, j: JointTorque) -> bool:
    """True if the interval of the peak is too wide for its limit, or, without a limit, most of the peak is noise."""
    if j.estimate is None:
        return False
    peak = abs(j.peak)
    half_width = INTERVAL * report.reach(j)
    is_too_wide = half_width > _MAX_UNCERTAIN_SHARE * peak
    if math.isfinite(j.limit):
        return is_too_wide and peak + half_width > _MIN_SHARE_OF_LIMIT * j.limit
    raw_peak = abs(j.largest) if j.raw is None else abs(j.raw)
    is_mostly_noise = raw_peak - peak > _MAX_UNCERTAIN_SHARE * raw_peak
    largest_peak = max(abs(other.peak) for other in report.joints if other.unit == j.unit)
    matters = max(peak + half_width, raw_peak) > _MIN_SHARE_OF_LARGEST * largest_peak
    return matters and (is_too_wide or is_mostly_noise)


def _peak_text(report: TorqueReport, j: JointTorque) -> str:
    """Text of the estimated peak, the peak derived from the unsmoothed log, and the measured peak if it differs."""
    text = f"{j.joint} {torque(j.peak)} ± {deviation(report.reach(j))} {j.unit}"
    if j.raw is not None:
        text += f", {torque(j.raw)} as derived"
    for m in report.measured:
        if m.joint == j.joint and m.differs:
            text += f", {torque(m.peak)} in the file's own torque column"
            break
    return text


def _over_sentence(report: TorqueReport, j: JointTorque) -> str:
    """Sentence on a joint that is certainly over its torque limit."""
    sigma = report.reach(j)
    uncertainty = ""
    if sigma > MIN_NOISE_SHARE * report.reference(j):
        uncertainty = sentence("doubt", sigma=deviation(sigma))
    return sentence(
        "over",
        joint=j.joint,
        time=seconds(j.time),
        peak=torque(j.peak),
        doubt=uncertainty,
        unit=j.unit,
        limit=number(j.limit),
        share=percent_of_limit(j.share),
        because=because(j),
    )


def because(joint: JointTorque) -> str:
    """Text of the main cause of the joint's peak."""
    cause, share = joint.main_cause
    return sentence("because", cause=cause_label(cause), share=percent(share))


def _judge_motion(report: TorqueReport, *, degrees: bool = False) -> tuple[list[tuple[Excess, str]], list[str]]:
    """Exceeded limits of positions, velocities and bearings with sentences, and sentences on excesses that noise explains."""
    excesses: list[tuple[Excess, str]] = []
    noisy_joints: dict[str, list[str]] = {}  # by quantity
    for e in report.excesses:
        if e.kind == "effort":
            continue
        if is_noise(report, e):
            noisy_joints.setdefault(KINDS[e.kind], []).append(e.joint)
        else:
            excesses.append((e, _motion_sentence(e, degrees=degrees)))
    if report.derived is not None:  # velocities that smoothing has brought below their limits
        remaining = _joints_and_kinds(report.excesses)
        for e in report.derived.excesses:
            is_removed = e.kind == "velocity" and (e.joint, e.kind) not in remaining
            if is_removed and _may_exceed_limit(report, e):
                noisy_joints.setdefault(KINDS[e.kind], []).append(e.joint)
    doubts = []
    for quantity, joints in noisy_joints.items():
        doubts.append(f"noise explains why the {quantity} limit of {listed(joints, _MAX_LISTED_JOINTS)} is passed")
    return excesses, doubts


def _motion_sentence(e: Excess, *, degrees: bool) -> str:
    """Sentence on a position, velocity or load of a bearing beyond its limit."""
    if e.kind in BEARINGS:
        return sentence(
            "bearing",
            joint=e.joint,
            kind=KINDS[e.kind],
            value=torque(e.value),
            limit=number(e.limit, 5),
            unit=e.unit,
            time=seconds(e.time),
        )
    if e.kind == "velocity":
        quantity = "dq"
        excess = abs(e.value) - e.limit
    else:
        quantity = "q"
        excess = abs(e.value - e.limit)
    factor = 1.0
    if degrees and e.angular:
        factor = math.degrees(1.0)
    return sentence(
        "motion",
        joint=e.joint,
        time=seconds(e.time),
        kind=KINDS[e.kind],
        by=number(factor * excess, 3),
        unit=unit_of(quantity, e.angular, degrees=degrees),
        value=number(factor * e.value, 5),
        limit=number(factor * e.limit, 5),
    )


def _may_exceed_limit(report: TorqueReport, e: Excess) -> bool:
    """True if noise may hide that a smoothed velocity exceeds its limit."""
    k = report.differentiation.model.velocity_names.index(e.joint)
    estimate = report.joints[k].estimate
    if estimate is None:
        return True
    return abs(estimate.speed) + _MAX_SIGMAS_OF_NOISE * estimate.speed_sigma > e.limit


def is_noise(report: TorqueReport, e: Excess) -> bool:
    """True if noise explains an exceeded position or velocity limit."""
    d = report.differentiation
    k = d.model.velocity_names.index(e.joint)
    if e.kind == "velocity":
        estimate = report.joints[k].estimate
        if estimate is None or not d.derives_velocities:
            return False
        return abs(estimate.speed) - _MAX_SIGMAS_OF_NOISE * estimate.speed_sigma <= e.limit
    position_noise_is_known = d.derives and d.derives_velocities
    if e.kind in BEARINGS or not position_noise_is_known:
        return False
    body = next(b for b in d.model.leaders if b.v_index <= k < b.v_index + b.joint.nv)  # body of velocity k
    position_sigma = float(d.errors.at_rest[body.q_index])
    return abs(e.value - e.limit) <= _MAX_SIGMAS_OF_NOISE * position_sigma


def _excess_sentences(excesses: list[tuple[Excess, str]]) -> list[str]:
    """Sentence on the worst excess, and one on all others; empty without excesses."""
    if not excesses:
        return []
    (worst, worst_text), *other_excesses = excesses
    quantities_by_joint: dict[str, list[str]] = {}
    for e, _ in other_excesses:
        quantity = KINDS[e.kind]
        quantities = quantities_by_joint.setdefault(e.joint, [])
        is_in_text = (e.joint, quantity) == (worst.joint, KINDS[worst.kind])  # the other position limit of the joint
        if not is_in_text and quantity not in quantities:
            quantities.append(quantity)
    other_texts = []
    for joint, quantities in quantities_by_joint.items():
        if quantities:
            other_texts.append(sentence("other", joint=joint, kinds=", ".join(quantities)))
    if not other_texts:
        return [worst_text]
    return [worst_text, sentence("also", others=listed(other_texts, _MAX_LISTED_JOINTS))]


# ── Notes on the log

_MAX_RELATIVE_UNCERTAINTY = 0.02
"""Relative uncertainty of a peak above which a better log is recommended."""


def notes_of(report: TorqueReport) -> Iterator[str]:
    """Notes on the log that affect the accuracy of the figures."""
    yield from _derivation_notes(report)
    if report.gaps.count:
        yield _gap_note(report)
    yield from report.load.unit_hints
    yield from notes_on_limits(report.limits)
    yield from _contact_notes(report)
    model = report.load.with_load.model
    drives = drives_without_limit(model, report.limits.effort, report.peaks)
    if drives and report.verdict.word is not Word.UNSURE:  # the reasons of UNSURE name them
        yield f"No torque limit is known for {listed(drives)}: {limits_remedy(model.source)}."
    yield from _payload_notes(report)
    yield from _friction_notes(report)
    yield from _measured_notes(report)
    yield from _outlier_notes(report)
    yield from report.differentiation.trajectory.notes


def _derivation_notes(report: TorqueReport) -> Iterator[str]:
    """Rates that the file lacks, how they were derived, and their noise."""
    d = report.differentiation
    rates = []
    if d.derives_velocities:
        rates.append("velocities")
    if d.source != "given":
        rates.append("accelerations")
    if not rates:
        return
    rates_text = " and ".join(rates)
    if d.smooths:  # smoothing changes figures, so a short report shows this note
        yield f"The file has no {rates_text}: derived by a quintic spline, after smoothing to the noise found."
    else:
        yield ReadingNote(f"The file has no {rates_text}: derived by a quintic spline.")
    yield from _quality_notes(report)


def _gap_note(report: TorqueReport) -> str:
    """Note on the number of gaps in time and on the longest gap."""
    gaps = report.gaps
    noun = "time" if gaps.count == 1 else "times"
    note = (
        f"Time jumps {gaps.count} {noun} by more than {number(gaps.threshold / report.quality.step)} usual steps; "
        f"the longest gap is {number(gaps.longest)} s, after t = {seconds(gaps.longest_at, 4)} s."
    )
    if report.differentiation.derives:
        note += " Derived rates near gaps are guesses."
    return note


def _contact_notes(report: TorqueReport) -> Iterator[str]:
    """Notes on the support by feet and wheels, or on a base without support."""
    if report.held.support is not None:
        yield from support_notes(report.held.support)
        return
    joints = [body.joint for body in report.load.robot.model.bodies]
    undriven = dict.fromkeys(joint.name for joint in joints if not joint.driven)  # each name once
    if undriven and not missing_force(report.load.with_load.model, report.joints):  # the verdict names a missing force
        yield f"Nothing drives {', '.join(undriven)}: its rows are the wrench that contacts would have to give."


def _payload_notes(report: TorqueReport) -> Iterator[str]:
    """Notes on payloads that do not load any joint."""
    model = report.load.robot.model
    frames_at_base = []
    for payload in report.load.payloads:
        frame = str(payload.frame or model.tip)
        if model.frame(frame).body == BASE:
            frames_at_base.append(frame)
    if frames_at_base:
        yield f"The payload at {', '.join(frames_at_base)} rests on the fixed base and loads no joint."
    if report.idle_payload:
        yield (
            "What is carried makes no torque in any joint: its place stays on their axes. Say where it is, in metres from its "
            f"frame: {spell(Argument('payload', 'MASS,x,y,z@FRAME'))}."
        )


def notes_on_log(report: TorqueReport) -> Iterator[str]:
    """Notes on the log that affect all loads, for any verdict on these loads."""
    if report.noisy:
        yield from _quality_notes(report)
    yield from _outlier_notes(report)
    yield from report.differentiation.trajectory.notes


def _friction_notes(report: TorqueReport) -> Iterator[str]:
    """Note on joints with Coulomb friction that are at rest within the noise, with the share of the rows."""
    if not report.load.friction:
        return
    model = report.load.robot.model
    friction = model.friction.static
    rest_shares = np.array(report.stationary)
    for rows, _, _ in model.coupled:  # a motor is at rest if all its joints are at rest
        rest_shares[rows] = rest_shares[rows].min()
    resting = []
    for k, j in enumerate(report.joints):
        if friction[k] > 0 and rest_shares[k] > 0:
            resting.append(f"{j.joint} (±{number(friction[k])} {j.unit}, {percent(rest_shares[k], 3)} of the rows)")
    if resting:
        yield (
            "Coulomb friction is undetermined for joints at rest within the noise of their derived velocities, and "
            f"left out there: {', '.join(resting)}."
        )


def _measured_notes(report: TorqueReport) -> Iterator[str]:
    """Notes on measured torques: causes of differences, joints that differ, short peaks, and columns that never change."""
    for cause in report.causes:
        if cause.sentence.rstrip(".") not in report.verdict.reasons:
            yield f"{cause.sentence[0].upper()}{cause.sentence[1:]}"
    unexplained = [m.joint for m in report.measured if m.disagrees and not _is_explained(m.joint, report.causes)]
    within_noise = [m.joint for m in report.measured if m.differs and not m.disagrees]
    constant = [m.joint for m in report.measured if m.dead]
    if unexplained:
        yield (
            f"The file's own torques are grossly different from those computed for {', '.join(unexplained)}: friction or "
            "load that the model lacks, another robot, or another unit."
        )
    if within_noise:
        yield (
            f"The file's own torques are grossly different from those computed for {', '.join(within_noise)}, as noise of the "
            "log may explain: trust the file's own."
        )
    for m in report.measured:
        if m.above and not m.lasting:
            yield (
                f"The measured torque of {m.joint} has a peak of {number(1e3 * m.above, 2)} ms above its limit, "
                f"{torque(m.peak)} {m.unit} of {number(m.limit)}, as in an impact."
            )
    if constant:
        yield f"The torque column never changes, and is not compared, for {', '.join(constant)}."


def _outlier_notes(report: TorqueReport) -> Iterator[str]:
    """Note on samples that smoothing flattened although noise does not explain them."""
    d = report.differentiation
    columns = d.trajectory.columns
    smoothed_quantity = "dq" if d.source == "velocities" else "q"
    factors = columns.factors[smoothed_quantity]
    sample_texts = []
    for outlier in report.outliers[:_MAX_LISTED_JOINTS]:
        name = columns.header[int(d.places[outlier.column])]
        if outlier.count > 1:
            name += f", {outlier.count} samples, the farthest"
        offset_in_file = outlier.off / factors[outlier.column]
        sigmas = number(abs(outlier.sigmas), 2)
        sample_texts.append(f"{name} at t = {seconds(outlier.time, 4)} s off by {number(offset_in_file)} ({sigmas} σ)")
    if not sample_texts:
        return
    text = "; ".join(sample_texts)
    if len(report.outliers) > len(sample_texts):
        text += f"; and {len(report.outliers) - len(sample_texts)} columns more"
    yield (
        f"WARNING: smoothing flattened samples that noise does not explain: {text}, in the file's "
        "unit. If the robot did move so, the torques there are far too low; if the log is wrong, remove the samples."
    )


def _quality_notes(report: TorqueReport) -> Iterator[str]:
    """Notes on the noise of a log with derived rates, and on how it was removed."""
    if report.differentiation.source == "given":
        return
    if not report.noisy:
        yield f"Noise of the log moves no torque by more than {percent(MIN_NOISE_SHARE, 1)} of its peak."
        return
    yield _noise_note(report)
    note = (
        "Peaks, their causes, shares of limits and the verdict are of the smoothed motion, less what noise adds to a largest "
        "value; ± 1σ is the peak's standard deviation."
    )
    if report.derived is not None:
        note += " The raw peak is that of the log as it is, at an instant of its own."
    yield note
    joints_at_ends = [j.joint for j in report.joints if report.at_an_end(j)]
    if joints_at_ends:
        yield (
            f"The peak of {', '.join(joints_at_ends)} lies at an end of the log or beside a gap, where derived accelerations "
            "are several times as uncertain, for want of neighbours. Log a little more before and after."
        )
    if any(report.reach(j) > _MAX_RELATIVE_UNCERTAINTY * report.reference(j) for j in report.joints):
        yield (
            f"Noise leaves more than {percent(_MAX_RELATIVE_UNCERTAINTY)} of a peak unknown. Log velocities and accelerations "
            "as well, if the controller has them, or more slowly changing motions."
        )


def _noise_note(report: TorqueReport) -> str:
    """Noise of the noisiest column, and its effect on accelerations and torques."""
    d = report.differentiation
    quality = report.quality
    column = int(quality.noise.argmax())
    name = d.trajectory.columns.header[d.places[column]]
    noise_text = f"{number(quality.noise[column], 2)} (1 σ, {name}, in the file's unit"
    if quality.quantum[column]:
        noise_text += f", on a grid of {number(quality.quantum[column])}"
    noise_text += ")"
    if _stamps_matter(report):
        stamp_errors = d.errors.stamp
        usual_error = np.median(stamp_errors[stamp_errors > 0])
        noise_text += f", and stamp errors of {number(1e3 * usual_error, 2)} ms"
    if report.derived is None:
        subject = "Smoothed, it still"
        sigma_ddq = d.sigma_ddq
    else:
        subject = "As it is, it"
        sigma_ddq = report.derived.differentiation.sigma_ddq
    worst = int(sigma_ddq.argmax())
    is_angular = bool(Coordinates.from_model(d.model).angular_velocity[worst])
    unit = unit_of("ddq", is_angular)
    noisiest = max(report.joints, key=lambda j: j.noise)
    return (
        f"The log has noise of {noise_text}. {subject} makes accelerations "
        f"unsure by {number(sigma_ddq.max(), 2)} {unit} ({report.joints[worst].joint}) and single torques by up to "
        f"{deviation(noisiest.noise)} {noisiest.unit} ({noisiest.joint})."
    )


def _stamps_matter(report: TorqueReport) -> bool:
    """True if most noisy columns have errors of time stamps, too."""
    is_noisy = report.quality.noise > 0
    has_stamp_error = report.differentiation.errors.stamp > 0
    noisy_count = int(is_noisy.sum())
    noisy_count_with_error = int((has_stamp_error & is_noisy).sum())
    return noisy_count > 0 and noisy_count_with_error > 0.5 * noisy_count
