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

KINDS = {"lower": "position", "upper": "position", "velocity": "velocity", "effort": "torque"} | {
    "axial": "axial force",
    "radial": "radial force",
    "tilting": "tilting moment",
}
"""Quantity of each kind of limit."""
_LOADS = ("effort", *BEARINGS)
"""Kinds of limits that depend on what holds the robot."""
_ERROR = 0.025
"""Probability that noise makes some joint appear over its limit, or hides that one is."""
_MAX_SIGMAS_OF_NOISE = 5.0
"""Standard deviations not exceeded by any of some million samples."""
_MAX_UNCERTAIN_SHARE = 0.5
"""Fraction of a peak above which half its 95 % interval, or its noise correction, makes it unsure."""
_MIN_SHARE_OF_LIMIT, _MIN_SHARE_OF_LARGEST = 0.5, 0.02
"""Fraction of a joint's limit, or without one of the largest torque, above which an unsure peak matters."""
_MAX_HIDDEN_SHARE = 0.15
"""Fraction of the time above which a gap with motion hides too much; near a limit any such gap does."""
_MAX_STEPS_TO_GAP = 3
"""Distance in median steps of the log within which a peak is at the end of a gap."""
_MAX_LISTED = 4


def verdict_of(report: TorqueReport, *, degrees: bool = False) -> Verdict:
    """Verdict of a report; angles in degrees if ``degrees``.

    A limit is certainly exceeded if the excess is larger than noise explains, including the selection of the largest value and
    of the worst joint. An excess that noise may hide or cause is unsure; one that smoothing certainly removes is neither.
    """
    over, open_torques = _judge_torques(report)
    over += _motion_excesses(report, degrees=degrees)
    hanging = base_doubts(report.load.robot.model, "hanging, feet")
    certain = _certain_excesses(report, over, loads_doubted=bool(hanging))
    excess_reasons = _excess_sentences(certain)
    doubts = _unsure_doubts([*doubts_of_limits(report), *report.load.doubts]) + rows_in_doubt(report)
    if over and not certain:
        doubts.append(_doubtful_excess(report, _excess_sentences(over)[0], hanging=bool(hanging)))
    for use in report.motors:
        if not use.too_small:
            continue
        excess = f"the motor of {use.words} is too small"
        if hanging:
            doubts.append(hanging_excess(excess))
        else:
            excess_reasons.append(excess)
    missing_limits = limit_doubts(report.load.robot, report.limits, report.peaks)
    before, after = carried_doubts(report, report.joints)
    max_hidden = most_hidden(report)
    if max((j.share for j in report.joints), default=0.0) > NEAR_LIMIT:
        max_hidden = 0.0
    gaps = _gap_doubts(report, max_hidden)
    after = [reason for reason in after if reason not in doubts]
    own = Verdict.from_reasons(
        look_again=contradictions(report),
        over=excess_reasons,
        unsure=[*hanging, *doubts, *missing_limits, *open_torques, *before, *gaps, *after],
    )
    return _join_further_verdicts(report, own)


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
    """Exceeded position and velocity limits; not the stops of joints that are read after a turn more or less."""
    excesses = []
    turned_joints = _turned_joints(report, level="note")
    for e, text in _judge_motion(report, degrees=degrees)[0]:
        if e.kind not in _STOPS or e.joint not in turned_joints:
            excesses.append((e, text))
    return excesses


def _certain_excesses(
    report: TorqueReport, over: list[tuple[Excess, str]], *, loads_doubted: bool
) -> list[tuple[Excess, str]]:
    """Excesses without doubts about their rows and, for loads, about what holds the robot."""
    doubted = doubted_excesses(report)
    open_joints = open_loop_joints(report.load.robot.model)
    certain = []
    for e, text in over:
        load_doubted = e.kind in _LOADS and (loads_doubted or e.joint in open_joints)
        if (e.joint, e.kind) not in doubted and not load_doubted:
            certain.append((e, text))
    return certain


def _doubtful_excess(report: TorqueReport, excess: str, *, hanging: bool) -> str:
    """Sentence on the worst excess with the condition under which it is certain."""
    if doubted_excesses(report):
        return f"{condition_of_excesses(report)} {Word.OVER_LIMIT}: {excess}"
    if hanging:
        return hanging_excess(excess)
    return open_loop_excess(excess)


def _gap_doubts(report: TorqueReport, max_hidden: float) -> list[str]:
    """Sentence on the longest gap with motion, if it is longer than ``max_hidden`` [s]."""
    if report.gaps.hidden > max_hidden:
        return [report.gaps.hidden_words]
    return []


def _unsure_doubts(doubts: Iterable[Doubt], kind: str | None = None) -> list[str]:
    """Sentences of the doubts that make a verdict unsure, of one ``kind`` if given."""
    return [str(doubt) for doubt in doubts if doubt.level == "unsure" and kind in (None, doubt.kind)]


def _kinds_of_doubts(doubts: Iterable[Doubt]) -> set[str]:
    return {doubt.kind for doubt in doubts}


_EVERYWHERE = (
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
    """Joint and kind of the excesses that stand only at instants, or in a log, whose rows are in doubt."""
    doubted = _doubted_by_log(report)
    if not _kinds_of_doubts(doubts_of_limits(report)).isdisjoint(("effort-unit", "effort-weight")):
        doubted = doubted | _joints_and_kinds(report.excesses, ["effort"])
    return doubted


def _doubted_by_log(report: TorqueReport) -> set[tuple[str, str]]:
    if report.differentiation.trajectory.origin is Origin.PLAN:
        return set()
    excesses = _joints_and_kinds(report.excesses)
    if not _kinds_of_doubts(report.doubts).isdisjoint(_EVERYWHERE):
        return excesses
    refuted = _refuted_excesses(report)
    if report.sound is None:
        return refuted
    return refuted | (excesses - _joints_and_kinds(report.sound.excesses))


def _joints_and_kinds(excesses: Iterable[Excess], kinds: Collection[str] = tuple(KINDS)) -> set[tuple[str, str]]:
    return {(e.joint, e.kind) for e in excesses if e.kind in kinds}


def _refuted_excesses(report: TorqueReport) -> set[tuple[str, str]]:
    """Joint and kind of the excesses that a measured torque or a turn more or less contradicts."""
    refuted = set(itertools.product(_turned_joints(report, level="unsure"), _STOPS))
    for m in report.measured:
        if m.refutes:
            refuted.add((m.joint, "effort"))
    return _joints_and_kinds(report.excesses) & refuted


_STOPS = "lower", "upper"


def _turned_joints(report: TorqueReport, *, level: Level) -> set[str]:
    """Joints whose angles are compared with their stops after a turn more or less."""
    joints = set[str]()
    for doubt in report.doubts:
        if doubt.kind == "wound" and doubt.level == level:
            joints.update(doubt.joints)
    return joints


def rows_in_doubt(report: TorqueReport) -> list[str]:
    """Sentences on rows that are missing, repeated or wrong, if they decide a figure; empty otherwise."""
    doubted = _doubted_by_log(report)
    everywhere = [str(doubt) for doubt in report.doubts if doubt.kind in _EVERYWHERE and not doubt.refuses]
    if everywhere and not doubted:
        return []
    if everywhere:
        return everywhere
    others = _unsure_doubts(report.doubts, "wound")
    for m in report.measured:
        if m.refutes and (m.joint, "effort") in doubted:
            others.append(m.refuting_words)
    unexplained = doubted - _refuted_excesses(report)
    if report.sound is None or (doubted and not unexplained):
        return others
    if not doubted and _change_of_share(report, report.sound.peaks) < _MIN_DECISIVE_CHANGE:
        return others
    times = [e.time for e in report.excesses if (e.joint, e.kind) in unexplained]
    if not times and report.worst is not None:
        times = [report.joints[report.worst].time]
    return [str(report.spans.doubt_at(times)), *others]


def _change_of_share(report: TorqueReport, sound_peaks: Array) -> float:
    """Largest share of a torque limit, less that of the peaks in sound rows."""
    largest, limits = np.array([(abs(j.largest), j.limit) for j in report.joints]).reshape(-1, 2).T
    return float((largest / limits).max(initial=0.0) - (sound_peaks / limits).max(initial=0.0))


def condition_of_excesses(report: TorqueReport) -> str:
    """Condition under which the excesses of a log in doubt are certain."""
    if not _doubted_by_log(report):
        return "by these limits"
    if report.differentiation.trajectory.origin is Origin.EITHER:
        return "as a plan"
    return "as it stands"


def most_hidden(report: TorqueReport) -> float:
    """Longest gap [s] with motion that leaves the verdict sure; 0 if a peak may continue in a gap, or be in it."""
    reach = _MAX_STEPS_TO_GAP * report.quality.step
    if report.gaps.exceeds_logged_motion:
        return 0.0
    for j in report.joints:
        if not report.is_zero(j.largest) and report.gaps.beside(j.time, reach):
            return 0.0
    return _MAX_HIDDEN_SHARE * (report.end - report.begin)


def contradictions(report: TorqueReport) -> list[str]:
    """Reasons to look again at the input that do not depend on payload and speed."""
    refusing = [str(doubt) for doubt in (*doubts_of_limits(report), *report.doubts) if doubt.refuses]
    return [*report.load.contradictions, *refusing, *_against(report, contradicting=True)]


def doubts_of_limits(report: TorqueReport) -> list[Doubt]:
    """Doubts about the limits of the comparison; those of the weight only if a torque limit is exceeded."""
    return credible_limits(report.limits, report.load.robot, weight=bool(_torque_excesses(report)))


def carried_doubts(report: TorqueReport, joints: Sequence[PeakTorque] = ()) -> tuple[list[str], list[str]]:
    """Reasons to be unsure for all slider positions of a page, listed before and after those on gaps of the log.

    If ``joints`` holds the peaks of all velocities, they include the missing force of a floating base.
    """
    before = _wide_peaks(report) + _judge_motion(report)[1] + model_warnings(report.load.with_load.model, joints)
    return before, _reasons_of_log(report)


def log_doubts(report: TorqueReport) -> list[str]:
    """Reasons to be unsure of all loads of a log, whatever is judged by them."""
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
    different = _different(report)
    for cause in report.causes:
        if _alarms(cause) and not _explains_some(cause, different):
            reasons.append(cause.sentence.rstrip("."))
    return reasons + _against(report, contradicting=False)


def _different(report: TorqueReport) -> list[MeasuredTorque]:
    """Measured torques whose difference from the computed ones affects the verdict."""
    least = {j.joint: _MIN_RESIDUAL * j.limit for j in _limited_joints(report)}
    return [m for m in report.measured if m.disagrees and m.residual > least.get(m.joint, 0.0)]


_MIN_RESIDUAL = 0.02
"""Fraction of a joint's limit above which the difference of measured and computed torques affects the verdict."""
_CAUSES_OF_OWN_TORQUES, _MINOR_CAUSES = ("torque-sign", "exchanged-torques", "gain"), ("late", "low-pass")
"""Causes that affect only measured torques of their joints, and causes with small effects."""


def explains(cause: Doubt, joint: str) -> bool:
    """True if a cause makes a joint's measured torque differ grossly from the computed one; joint laws do not."""
    if doubt_table()[cause.kind].stage not in (2, 3) or cause.kind in _MINOR_CAUSES:
        return False
    return cause.kind not in _CAUSES_OF_OWN_TORQUES or joint in cause.joints


def _explains_some(cause: Doubt, measured: Iterable[MeasuredTorque]) -> bool:
    return any(explains(cause, m.joint) for m in measured)


def _is_explained(joint: str, causes: Iterable[Doubt]) -> bool:
    return any(explains(cause, joint) for cause in causes)


def _alarms(cause: Doubt) -> bool:
    """True if a cause also affects the torques of other motions, so that the computed ones are in doubt."""
    return cause.refuses and doubt_table()[cause.kind].stage in (2, 3) and cause.kind not in _MINOR_CAUSES


def _against(report: TorqueReport, *, contradicting: bool) -> list[str]:
    """Reasons from differing measured torques: named causes, and figures of joints without a cause.

    They are those of the torques that contradict the model, or of those that do not.
    """
    different = [m for m in _different(report) if m.contradicts == contradicting]
    causes, reasons = list[Doubt](), list[str]()
    for cause in report.causes:
        if _explains_some(cause, different):
            causes.append(cause)
            reasons.append(cause.sentence.rstrip("."))
    unexplained = [m.words for m in different if not _is_explained(m.joint, causes)]
    if unexplained:
        figures = listed(unexplained, _MAX_LISTED, "; ")
        reasons.append(f"the file's own torque column disagrees with the torques computed: {figures}")
    return reasons


def confidence(joints: int) -> float:
    """Standard deviations that bound the peaks of that many joints simultaneously; () → ()."""
    from scipy.special import ndtri

    return float(ndtri(1.0 - _ERROR / max(1, joints)))


def _judge_torques(report: TorqueReport) -> tuple[list[tuple[Excess, str]], list[str]]:
    """Joints over their torque limits, worst first, and sentences on joints for which noise leaves this open."""
    limited = _limited_joints(report)
    factor = confidence(len(limited))
    excesses = _torque_excesses(report)
    over, unsure = [], []
    for j in limited:
        reach, excess = factor * report.reach(j), excesses.get(j.joint)
        if excess is not None and abs(j.peak) - reach > j.limit:
            over.append((excess, _over_sentence(report, j)))
        elif _is_open(j, reach, excess):
            unsure.append(_open_sentence(report, j))
    for excess, text in _judge_followers(report):
        if excess is None:
            unsure.append(text)
        else:
            over.append((excess, text))
    return over, unsure


def _limited_joints(report: TorqueReport) -> list[JointTorque]:
    """Joints with a torque limit, the largest share first."""
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    return sorted(limited, key=lambda j: -j.share)


def _torque_excesses(report: TorqueReport) -> dict[str, Excess]:
    return {e.joint: e for e in report.excesses if e.kind == "effort"}


def _open_sentence(report: TorqueReport, j: JointTorque) -> str:
    """Sentence on a joint for which noise decides whether its limit is exceeded."""
    end = ""
    if report.at_an_end(j):
        end = sentence("end")
    return sentence(
        "open",
        joint=j.joint,
        end=end,
        peak=torque(j.peak),
        sigma=deviation(report.reach(j)),
        unit=j.unit,
        limit=number(j.limit),
    )


def _is_open(j: JointTorque, reach: float, excess: Excess | None) -> bool:
    """True if noise within ``reach`` of the peak decides whether the limit is exceeded."""
    return bool(over_limit((abs(j.peak) + reach) / j.limit)) and (reach > 0 or excess is not None)


def _wide_peaks(report: TorqueReport) -> list[str]:
    """Sentence on peaks too uncertain due to noise, of joints without another verdict; empty if there are none."""
    limited = _limited_joints(report)
    factor, excesses = confidence(len(limited)), _torque_excesses(report)
    candidates = [j for j in limited if not _is_open(j, factor * report.reach(j), excesses.get(j.joint))]
    candidates += [j for j in report.joints if not math.isfinite(j.limit)]
    peaks = [_peak_text(report, j) for j in candidates if _is_wide(report, j)]
    if not peaks:
        return []
    return [f"noise is too large a part of the peak: {listed(peaks, _MAX_LISTED, '; ')}"]


def _judge_followers(report: TorqueReport) -> list[tuple[Excess | None, str]]:
    """Mimic joints over their torque limits, as uncertain as their leaders; without the excess if noise may explain it."""
    factor = confidence(len(_limited_joints(report)))
    leaders = {j.joint for j in report.joints}
    bodies = {body.joint.name: body for body in report.load.robot.model.bodies}
    judged: list[tuple[Excess | None, str]] = []
    for name, e in _torque_excesses(report).items():
        if name in leaders:
            continue
        body = bodies[name]
        leader = report.joints[body.v_index]
        reach = 0.0
        if body.ratio:
            reach = report.reach(leader) / abs(body.ratio)
        share = percent_of_limit(abs(e.value) / e.limit)
        figures = {"peak": torque(e.value), "unit": e.unit, "limit": number(e.limit), "share": share}
        if abs(e.value) - factor * reach > e.limit:
            text = sentence("follower", joint=e.joint, leader=leader.joint, time=seconds(e.time), **figures)
            judged.append((e, text))
        else:
            judged.append((None, sentence("open follower", joint=e.joint, **figures)))
    return judged


def _is_wide(report: TorqueReport, j: JointTorque) -> bool:
    """True if the interval of the peak is too wide for its limit, or, without a limit, most of the peak is noise."""
    if j.estimate is None:
        return False
    half_width, size = INTERVAL * report.reach(j), abs(j.peak)
    too_wide = half_width > _MAX_UNCERTAIN_SHARE * size
    if math.isfinite(j.limit):
        return too_wide and size + half_width > _MIN_SHARE_OF_LIMIT * j.limit
    raw = abs(j.largest)
    if j.raw is not None:
        raw = abs(j.raw)
    mostly_noise = raw - size > _MAX_UNCERTAIN_SHARE * raw
    largest = max(abs(other.peak) for other in report.joints if other.unit == j.unit)
    return (too_wide or mostly_noise) and max(size + half_width, raw) > _MIN_SHARE_OF_LARGEST * largest


def _peak_text(report: TorqueReport, j: JointTorque) -> str:
    """Text of the estimated, derived and measured peak."""
    text = f"{j.joint} {torque(j.peak)} ± {deviation(report.reach(j))} {j.unit}"
    if j.raw is not None:
        text += f", {torque(j.raw)} as derived"
    for m in report.measured:
        if m.joint == j.joint and m.differs:
            text += f", {torque(m.peak)} in the file's own torque column"
            break
    return text


def _over_sentence(report: TorqueReport, j: JointTorque) -> str:
    reach = report.reach(j)
    doubt = ""
    if reach > MIN_NOISE_SHARE * report.reference(j):
        doubt = sentence("doubt", sigma=deviation(reach))
    return sentence(
        "over",
        joint=j.joint,
        time=seconds(j.time),
        peak=torque(j.peak),
        doubt=doubt,
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
    """Exceeded position and velocity limits, and sentences on those explained by noise."""
    over: list[tuple[Excess, str]] = []
    doubtful: dict[str, list[str]] = {}
    for e in report.excesses:
        if e.kind == "effort":
            continue
        if is_noise(report, e):
            doubtful.setdefault(KINDS[e.kind], []).append(e.joint)
        else:
            over.append((e, _excess_sentence(e, degrees=degrees)))
    if report.derived is not None:
        exceeded = _joints_and_kinds(report.excesses)
        for e in report.derived.excesses:
            if e.kind == "velocity" and (e.joint, e.kind) not in exceeded and _reaches(report, e):
                doubtful.setdefault(KINDS[e.kind], []).append(e.joint)
    doubts = []
    for kind, joints in doubtful.items():
        doubts.append(f"noise explains why the {kind} limit of {listed(joints, _MAX_LISTED)} is passed")
    return over, doubts


def _excess_sentence(e: Excess, *, degrees: bool) -> str:
    """Sentence on a position, velocity or load of a bearing beyond its limit."""
    if e.kind in BEARINGS:
        load = {"value": torque(e.value), "limit": number(e.limit, 5), "unit": e.unit, "time": seconds(e.time)}
        return sentence("bearing", joint=e.joint, kind=KINDS[e.kind], **load)
    if e.kind == "velocity":
        coordinate, excess = "dq", abs(e.value) - e.limit
    else:
        coordinate, excess = "q", abs(e.value - e.limit)
    scale = 1.0
    if degrees and e.angular:
        scale = math.degrees(1.0)
    return sentence(
        "motion",
        joint=e.joint,
        time=seconds(e.time),
        kind=KINDS[e.kind],
        by=number(scale * excess, 3),
        unit=unit_of(coordinate, e.angular, degrees=degrees),
        value=number(scale * e.value, 5),
        limit=number(scale * e.limit, 5),
    )


def _reaches(report: TorqueReport, e: Excess) -> bool:
    """True if a velocity within its limit after smoothing may exceed it."""
    estimate = report.joints[report.differentiation.model.velocity_names.index(e.joint)].estimate
    return estimate is None or abs(estimate.speed) + _MAX_SIGMAS_OF_NOISE * estimate.speed_sigma > e.limit


def is_noise(report: TorqueReport, e: Excess) -> bool:
    """True if noise explains an exceeded position or velocity limit."""
    d = report.differentiation
    k = d.model.velocity_names.index(e.joint)
    if e.kind == "velocity":
        estimate = report.joints[k].estimate
        if estimate is None or not d.derives_velocities:
            return False
        return abs(estimate.speed) - _MAX_SIGMAS_OF_NOISE * estimate.speed_sigma <= e.limit
    if e.kind in BEARINGS or not (d.derives and d.derives_velocities):
        return False  # noise of these was not estimated
    body = next(b for b in d.model.leaders if b.v_index <= k < b.v_index + b.joint.nv)
    return abs(e.value - e.limit) <= _MAX_SIGMAS_OF_NOISE * float(d.errors.at_rest[body.q_index])


def _excess_sentences(over: list[tuple[Excess, str]]) -> list[str]:
    """Sentences on the worst excess and on the other joints."""
    if not over:
        return []
    first, text = over[0]
    kinds_of_joints: dict[str, dict[str, None]] = {}
    for e, _ in over[1:]:
        kinds = kinds_of_joints.setdefault(e.joint, {})
        if (e.joint, KINDS[e.kind]) != (first.joint, KINDS[first.kind]):
            kinds[KINDS[e.kind]] = None
    others = [sentence("other", joint=name, kinds=", ".join(kinds)) for name, kinds in kinds_of_joints.items() if kinds]
    if not others:
        return [text]
    return [text, sentence("also", others=listed(others, _MAX_LISTED))]


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
    missing = drives_without_limit(model, report.limits.effort, report.peaks)
    if missing and report.verdict.word is not Word.UNSURE:  # otherwise among the reasons
        yield f"No torque limit is known for {listed(missing)}: {limits_remedy(model.source)}."
    yield from _payload_notes(report)
    yield from _friction_notes(report)
    yield from _measured_notes(report)
    yield from _stray_notes(report)
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
    missing = " and ".join(rates)
    if d.smooths:  # smoothing changes figures
        yield f"The file has no {missing}: derived by a quintic spline, after smoothing to the noise found."
    else:
        yield ReadingNote(f"The file has no {missing}: derived by a quintic spline.")
    yield from _quality_notes(report)


def _gap_note(report: TorqueReport) -> str:
    gaps = report.gaps
    times = "times"
    if gaps.count == 1:
        times = "time"
    note = (
        f"Time jumps {gaps.count} {times} by more than {number(gaps.threshold / report.quality.step)} usual steps; "
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
    floating = list(dict.fromkeys(b.joint.name for b in report.load.robot.model.bodies if not b.joint.driven))
    if floating and not missing_force(report.load.with_load.model, report.joints):  # otherwise the verdict has it
        yield f"Nothing drives {', '.join(floating)}: its rows are the wrench that contacts would have to give."


def _payload_notes(report: TorqueReport) -> Iterator[str]:
    """Notes on payloads that do not load any joint."""
    model = report.load.robot.model
    frames_at_base = []
    for payload in report.load.payloads:
        frame = f"{payload.frame or model.tip}"
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
    """Notes on the log that affect all loads, whatever is judged by them."""
    if report.noisy:
        yield from _quality_notes(report)
    yield from _stray_notes(report)
    yield from report.differentiation.trajectory.notes


def _friction_notes(report: TorqueReport) -> Iterator[str]:
    if not report.load.friction:
        return
    model = report.load.robot.model
    friction, rest_shares = model.friction.static, np.array(report.stationary)
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
    for cause in report.causes:
        if cause.sentence.rstrip(".") not in report.verdict.reasons:
            yield f"{cause.sentence[0].upper()}{cause.sentence[1:]}"
    different, within_noise, constant = list[str](), list[str](), list[str]()
    for m in report.measured:
        if m.disagrees and not _is_explained(m.joint, report.causes):
            different.append(m.joint)
        if m.differs and not m.disagrees:
            within_noise.append(m.joint)
        if m.dead:
            constant.append(m.joint)
    if different:
        yield (
            f"The file's own torques are grossly different from those computed for {', '.join(different)}: friction or load "
            "that the model lacks, another robot, or another unit."
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


def _stray_notes(report: TorqueReport) -> Iterator[str]:
    d = report.differentiation
    columns = d.trajectory.columns
    factors = columns.factors["q"]
    if d.source == "velocities":
        factors = columns.factors["dq"]
    samples = []
    for outlier in report.outliers[:_MAX_LISTED]:
        name = columns.header[int(d.places[outlier.column])]
        if outlier.count > 1:
            name += f", {outlier.count} samples, the farthest"
        deviation_in_file = outlier.off / factors[outlier.column]
        samples.append(
            f"{name} at t = {seconds(outlier.time, 4)} s off by {number(deviation_in_file)} "
            f"({number(abs(outlier.sigmas), 2)} σ)"
        )
    if not samples:
        return
    text = "; ".join(samples)
    if len(report.outliers) > len(samples):
        text += f"; and {len(report.outliers) - len(samples)} columns more"
    yield (
        f"WARNING: smoothing flattened samples that noise does not explain: {text}, in the file's "
        "unit. If the robot did move so, the torques there are far too low; if the log is wrong, remove the samples."
    )


def _quality_notes(report: TorqueReport) -> Iterator[str]:
    d = report.differentiation
    if d.source == "given":
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
    d, survey = report.differentiation, report.quality
    column = int(survey.noise.argmax())
    noise = (
        f"{number(survey.noise[column], 2)} (1 σ, {d.trajectory.columns.header[d.places[column]]}, in the file's unit"
    )
    if survey.quantum[column]:
        noise += f", on a grid of {number(survey.quantum[column])}"
    noise += ")"
    if _stamps_matter(report):
        stamp_errors = d.errors.stamp
        noise += f", and stamp errors of {number(1e3 * np.median(stamp_errors[stamp_errors > 0]), 2)} ms"
    if report.derived is None:
        derived, motion = d, "Smoothed, it still"
    else:
        derived, motion = report.derived.differentiation, "As it is, it"
    worst = int(derived.sigma_ddq.argmax())
    unit = unit_of("ddq", bool(Coordinates.from_model(d.model).angular_velocity[worst]))
    noisiest = max(report.joints, key=lambda j: j.noise)
    return (
        f"The log has noise of {noise}. {motion} makes accelerations "
        f"unsure by {number(derived.sigma_ddq.max(), 2)} {unit} ({report.joints[worst].joint}) and single torques by up to "
        f"{deviation(noisiest.noise)} {noisiest.unit} ({noisiest.joint})."
    )


def _stamps_matter(report: TorqueReport) -> bool:
    """True if most moving columns have time stamp errors beyond their noise."""
    moving = report.quality.noise > 0
    with_stamp_errors = report.differentiation.errors.stamp > 0
    return bool(moving.any() and (with_stamp_errors & moving).sum() > 0.5 * moving.sum())
