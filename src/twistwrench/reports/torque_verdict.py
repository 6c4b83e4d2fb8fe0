"""Verdict on a motion's torques: limits, doubts about log and limits, and confidence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ..core.answers.sentences import sentence
from ..core.colours import NEAR_LIMIT
from ..core.doubts import Doubt, Level, doubt_table
from ..core.numbers import deviation, number, over_limit, percent, percent_of_limit, seconds, torque
from ..core.text import Argument, ReadingNote, listed, spell
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
    as_it_hangs,
    base_doubts,
    missing_force,
    model_warnings,
    open_loop_joints,
    with_open_loops,
)
from ..motion.plausibility import Origin
from .log_quality import MeasuredTorque
from .statistics import INTERVAL
from .support.judgement import support_notes, support_verdict
from .torque_report import NEGLIGIBLE, Excess, JointTorque, TorqueReport

# ── The verdict

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
_SURE = 5.0
"""Standard deviations not exceeded by any of some million samples."""
_HALF = 0.5
"""Fraction of a peak above which half its 95 % interval, or its noise correction, makes it unsure."""
_COUNTS, _SMALL = 0.5, 0.02
"""Fraction of a joint's limit, or without one of the largest torque, above which an unsure peak matters."""
HIDDEN = 0.15
"""Fraction of the time above which a gap with motion hides too much; near a limit any such gap does."""
_BESIDE = 3
"""Distance in median steps of the log within which a peak is at the end of a gap."""
_MOST_LISTED = 4


def verdict_of(report: TorqueReport, *, degrees: bool = False) -> Verdict:
    """Verdict of a report; angles in degrees if ``degrees``.

    A limit is certainly exceeded if the excess is larger than noise explains, including the selection of the largest value and
    of the worst joint. An excess that noise may hide or cause is unsure; one that smoothing certainly removes is neither.
    """
    over, unsure = _judge_torques(report)
    passed, _ = _judge_motion(report, degrees=degrees)
    wound = _wound(report, level="note")
    passed = [(e, text) for e, text in passed if not (e.kind in _STOPS and e.joint in wound)]
    doubted, hanging = doubted_excesses(report), base_doubts(report.load.robot.model, "hanging, feet")
    certain = [(e, text) for e, text in (*over, *passed) if (e.joint, e.kind) not in doubted]
    loaded = open_loop_joints(report.load.robot.model)
    certain = [(e, text) for e, text in certain if not (e.kind in _LOADS and (hanging or e.joint in loaded))]
    stated = _grouped(certain)
    typed = [str(found) for found in (*doubts_of_limits(report), *report.load.doubts) if found.level == "unsure"]
    instead = [*typed, *rows_in_doubt(report)]
    if not certain and (over or passed):
        excess = _grouped([*over, *passed])[0]
        doubtful = as_it_hangs(excess) if hanging else with_open_loops(excess)
        instead.append(f"{as_it_stands(report)} {Word.OVER_LIMIT}: {excess}" if doubted else doubtful)
    small = [f"the motor of {use.words} is too small" for use in report.motors if use.too_small]
    stated += [] if hanging else small
    instead += map(as_it_hangs, small) if hanging else ()
    limits = limit_doubts(report.load.robot, report.limits, [j.peak for j in report.joints])
    near = max((j.share for j in report.joints), default=0.0) > NEAR_LIMIT
    before, after = carried_doubts(report, report.joints)
    gaps = [report.gaps.hidden_words] if report.gaps.hidden > (0.0 if near else most_hidden(report)) else []
    own = Verdict.from_reasons(
        look_again=contradictions(report),
        over=stated,
        unsure=[
            *hanging,
            *instead,
            *limits,
            *unsure,
            *before,
            *gaps,
            *(text for text in after if text not in instead),
        ],
    )
    if report.held.grip is not None:
        own = report.held.grip.verdict.joined(own)
    if report.held.mounting is not None:
        own = report.held.mounting.verdict.joined(own)
    if report.held.support is not None:
        own = support_verdict(report.held.support).joined(own)
    return own if report.clearance is None else own.joined(report.clearance.verdict)


# ── Doubts about an instant stand before an excess at that instant

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
_POINTS = 0.05
"""Change of a share of a limit that makes rows in doubt decisive."""


def doubted_excesses(report: TorqueReport) -> set[tuple[str, str]]:
    """Joint and kind of the excesses that stand only at instants, or in a log, whose rows are in doubt."""
    every = {(e.joint, e.kind) for e in report.excesses}
    if any(found.kind in ("effort-unit", "effort-weight") for found in doubts_of_limits(report)):
        return {(joint, kind) for joint, kind in every if kind == "effort"} | _doubted_by_log(report)
    return _doubted_by_log(report)


def _doubted_by_log(report: TorqueReport) -> set[tuple[str, str]]:
    every = {(e.joint, e.kind) for e in report.excesses}
    if report.differentiation.trajectory.origin is Origin.PLAN:
        return set()
    if any(found.kind in _EVERYWHERE for found in report.doubts):
        return every
    sound = every if report.sound is None else {(e.joint, e.kind) for e in report.sound.excesses}
    return _refuted(report) | (every - sound)


def _refuted(report: TorqueReport) -> set[tuple[str, str]]:
    """Joint and kind of the excesses that a measured torque or a turn more or less contradicts."""
    every = {(e.joint, e.kind) for e in report.excesses}
    wound = _wound(report, level="unsure")
    measured = {(m.joint, "effort") for m in report.measured if m.refutes}
    return every & (measured | {(joint, kind) for joint in wound for kind in _STOPS})


_STOPS = "lower", "upper"


def _wound(report: TorqueReport, *, level: Level) -> set[str]:
    """Joints whose angles are compared with their stops after a turn more or less."""
    return {
        joint for found in report.doubts if found.kind == "wound" and found.level == level for joint in found.joints
    }


def rows_in_doubt(report: TorqueReport) -> list[str]:
    """Sentences on rows that are missing, repeated or wrong, if they decide a figure; empty otherwise."""
    doubted = _doubted_by_log(report)
    if everywhere := [str(found) for found in report.doubts if found.kind in _EVERYWHERE and not found.refuses]:
        return everywhere if doubted else []
    refuted = [m.refuting_words for m in report.measured if m.refutes and (m.joint, "effort") in doubted]
    others = [*(str(found) for found in report.doubts if found.kind == "wound" and found.level == "unsure"), *refuted]
    explained = _refuted(report)
    if report.sound is None or (doubted and explained >= doubted):
        return others
    limits = np.array([j.limit for j in report.joints])
    largest = np.array([abs(j.largest) for j in report.joints])
    changed = float((largest / limits).max(initial=0.0) - (report.sound.peaks / limits).max(initial=0.0))
    if not doubted and changed < _POINTS:
        return others
    times = [e.time for e in report.excesses if (e.joint, e.kind) in doubted - explained]
    times += [report.joints[report.worst].time] if report.worst is not None and not times else []
    return [str(report.spans.doubt_at(times)), *others]


def as_it_stands(report: TorqueReport) -> str:
    """Condition under which the excesses of a log in doubt are certain."""
    either = report.differentiation.trajectory.origin is Origin.EITHER
    if not _doubted_by_log(report):
        return "by these limits"
    return "as a plan" if either else "as it stands"


def most_hidden(report: TorqueReport) -> float:
    """Longest gap [s] with motion that leaves the verdict sure; 0 if a peak may continue in a gap, or be in it."""
    peaks = [j for j in report.joints if not report.is_zero(j.largest)]
    beside = any(report.gaps.beside(j.time, _BESIDE * report.quality.step) for j in peaks)
    return 0.0 if beside or report.gaps.exceeds_logged_motion else HIDDEN * (report.end - report.begin)


def contradictions(report: TorqueReport) -> list[str]:
    """Reasons to look again at the input that do not depend on payload and speed."""
    refused = [str(found) for found in report.doubts if found.refuses]
    contradicted = [m for m in _different(report) if m.contradicts]
    limits = [str(found) for found in doubts_of_limits(report) if found.refuses]
    return [*report.load.contradictions, *limits, *refused, *_against(report, contradicted)]


def doubts_of_limits(report: TorqueReport) -> list[Doubt]:
    """Doubts about the limits of the comparison; those of the weight only if a torque limit is exceeded."""
    exceeds = any(e.kind == "effort" for e in report.excesses)
    return credible_limits(report.limits, report.load.robot, weight=exceeds)


def carried_doubts(report: TorqueReport, joints: Sequence[PeakTorque] = ()) -> tuple[list[str], list[str]]:
    """Reasons to be unsure for all slider positions of a page, listed before and after those on gaps of the log.

    If ``joints`` holds the peaks of all velocities, they include the missing force of a floating base.
    """
    before = _wide_peaks(report) + _judge_motion(report)[1] + model_warnings(report.load.with_load.model, joints)
    return before, _after(report)


def log_doubts(report: TorqueReport) -> list[str]:
    """Reasons to be unsure of all loads of a log, whatever is judged by them."""
    gaps = [report.gaps.hidden_words] if report.gaps.hidden > most_hidden(report) else []
    return [*gaps, *_after(report)]


def _after(report: TorqueReport) -> list[str]:
    after = []
    if any(outlier.matters for outlier in report.outliers):
        after.append(
            "samples that look like glitches were smoothed away; if the robot moved so, torques there are too low"
        )
    after += [str(found) for found in report.doubts if found.level == "unsure"]
    after += [m.above_words for m in report.measured if m.lasting and not m.contradicts]
    after += [m.cut_words for m in report.measured if m.cut and m.matters]
    different = _different(report)
    named = [c for c in report.causes if _alarms(c) and not any(explains(c, m.joint) for m in different)]
    doubted = [m for m in different if not m.contradicts]
    return [*after, *(cause.sentence.rstrip(".") for cause in named), *_against(report, doubted)]


def _different(report: TorqueReport) -> list[MeasuredTorque]:
    """Measured torques whose difference from the computed ones affects the verdict."""
    limits = {j.joint: j.limit for j in report.joints if math.isfinite(j.limit)}
    return [m for m in report.measured if m.disagrees and m.residual > _CONCERNS * limits.get(m.joint, 0.0)]


_CONCERNS = 0.02
"""Fraction of a joint's limit above which the difference of measured and computed torques affects the verdict."""
_OF_TORQUES, _LITTLE = ("torque-sign", "exchanged-torques", "gain"), ("late", "low-pass")
"""Causes that affect only measured torques of their joints, and causes with small effects."""


def explains(cause: Doubt, joint: str) -> bool:
    """True if a cause makes a joint's measured torque differ grossly from the computed one; joint laws do not."""
    gross = doubt_table()[cause.kind].stage in (2, 3) and cause.kind not in _LITTLE
    return gross and (cause.kind not in _OF_TORQUES or joint in cause.joints)


def _alarms(cause: Doubt) -> bool:
    """True if a cause also affects the torques of other motions, so that the computed ones are in doubt."""
    return cause.refuses and doubt_table()[cause.kind].stage in (2, 3) and cause.kind not in _LITTLE


def _against(report: TorqueReport, different: Sequence[MeasuredTorque]) -> list[str]:
    """Reasons from differing measured torques: named causes, and figures of joints without a cause."""
    named = [cause for cause in report.causes if any(explains(cause, m.joint) for m in different)]
    rest = [m.words for m in different if not any(explains(cause, m.joint) for cause in named)]
    against = "the file's own torque column disagrees with the torques computed"
    return [
        *(cause.sentence.rstrip(".") for cause in named),
        *([f"{against}: {listed(rest, _MOST_LISTED, '; ')}"] if rest else []),
    ]


def confidence(joints: int) -> float:
    """Standard deviations that bound the peaks of that many joints simultaneously; () → ()."""
    from scipy.special import ndtri

    return float(ndtri(1.0 - _ERROR / max(1, joints)))


def _judge_torques(report: TorqueReport) -> tuple[list[tuple[Excess, str]], list[str]]:
    """Joints over their torque limits, worst first, and sentences on joints for which noise leaves this open."""
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    factor = confidence(len(limited))
    excesses = {e.joint: e for e in report.excesses if e.kind == "effort"}
    over, unsure = [], []
    for j in sorted(limited, key=lambda j: -j.share):
        reach, excess = factor * report.reach(j), excesses.get(j.joint)
        if excess is not None and abs(j.peak) - reach > j.limit:
            over.append((excess, _torque_in_words(report, j)))
        elif _is_open(j, reach, excess):
            unsure.append(
                sentence(
                    "open",
                    joint=j.joint,
                    end=sentence("end") if report.at_an_end(j) else "",
                    peak=torque(j.peak),
                    sigma=deviation(report.reach(j)),
                    unit=j.unit,
                    limit=number(j.limit),
                )
            )
    followers = _judge_followers(report)
    over += [(e, words) for e, words in followers if e is not None]
    return over, [*unsure, *(words for e, words in followers if e is None)]


def _is_open(j: JointTorque, reach: float, excess: Excess | None) -> bool:
    """True if noise within ``reach`` of the peak decides whether the limit is exceeded."""
    return bool(over_limit((abs(j.peak) + reach) / j.limit)) and (reach > 0 or excess is not None)


def _wide_peaks(report: TorqueReport) -> list[str]:
    """Sentence on peaks too uncertain due to noise, of joints without another verdict; empty if there are none."""
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    factor, excesses = confidence(len(limited)), {e.joint: e for e in report.excesses if e.kind == "effort"}
    wide = [
        j
        for j in sorted(limited, key=lambda j: -j.share)
        if not _is_open(j, factor * report.reach(j), excesses.get(j.joint)) and _is_wide(report, j)
    ]
    wide += [j for j in report.joints if not math.isfinite(j.limit) and _is_wide(report, j)]
    if not wide:
        return []
    peaks = listed([_in_words(report, j) for j in wide], _MOST_LISTED, "; ")
    return [f"noise is too large a part of the peak: {peaks}"]


def _judge_followers(report: TorqueReport) -> list[tuple[Excess | None, str]]:
    """Mimic joints over their torque limits, as uncertain as their leaders; without the excess if noise may explain it."""
    factor = confidence(sum(math.isfinite(j.limit) for j in report.joints))
    leaders = {j.joint for j in report.joints}
    found: list[tuple[Excess | None, str]] = []
    for e in (e for e in report.excesses if e.kind == "effort" and e.joint not in leaders):
        body = next(b for b in report.load.robot.model.bodies if b.joint.name == e.joint)
        reach = report.reach(report.joints[body.v_index]) / abs(body.ratio) if body.ratio else 0.0
        leader, share = report.joints[body.v_index].joint, percent_of_limit(abs(e.value) / e.limit)
        takes = {"peak": torque(e.value), "unit": e.unit, "limit": number(e.limit), "share": share}
        if abs(e.value) - factor * reach > e.limit:
            found.append((e, sentence("follower", joint=e.joint, leader=leader, time=seconds(e.time), **takes)))
        else:
            found.append((None, sentence("open follower", joint=e.joint, **takes)))
    return found


def _is_wide(report: TorqueReport, j: JointTorque) -> bool:
    """True if the interval of the peak is too wide for its limit, or, without a limit, most of the peak is noise."""
    if j.estimate is None:
        return False
    half, raw, size = INTERVAL * report.reach(j), abs(j.raw if j.raw is not None else j.largest), abs(j.peak)
    if math.isfinite(j.limit):
        return half > _HALF * size and size + half > _COUNTS * j.limit
    largest = max(abs(x.peak) for x in report.joints if x.unit == j.unit)
    return (half > _HALF * size or raw - size > _HALF * raw) and max(size + half, raw) > _SMALL * largest


def _in_words(report: TorqueReport, j: JointTorque) -> str:
    """Text of the estimated, derived and measured peak."""
    raw = f", {torque(j.raw)} as derived" if j.raw is not None else ""
    own = next((m for m in report.measured if m.joint == j.joint and m.differs), None)
    measured = "" if own is None else f", {torque(own.peak)} in the file's own torque column"
    return f"{j.joint} {torque(j.peak)} ± {deviation(report.reach(j))} {j.unit}{raw}{measured}"


def _torque_in_words(report: TorqueReport, j: JointTorque) -> str:
    reach = report.reach(j)
    doubts = reach > NEGLIGIBLE * report.reference(j)
    return sentence(
        "over",
        joint=j.joint,
        time=seconds(j.time),
        peak=torque(j.peak),
        doubt=sentence("doubt", sigma=deviation(reach)) if doubts else "",
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
    found = {(e.joint, e.kind): e for e in report.excesses if e.kind != "effort"}
    derived = () if report.derived is None else report.derived.excesses
    near = [e for e in derived if (e.joint, e.kind) not in found and e.kind == "velocity" and _reaches(report, e)]
    for e in [*found.values(), *near]:
        if e in near or is_noise(report, e):
            doubtful.setdefault(KINDS[e.kind], []).append(e.joint)
        else:
            over.append((e, _excess_in_words(e, degrees=degrees)))
    return over, [
        f"noise explains why the {kind} limit of {listed(joints, _MOST_LISTED)} is passed"
        for kind, joints in doubtful.items()
    ]


def _excess_in_words(e: Excess, *, degrees: bool) -> str:
    """Sentence on a position, velocity or load of a bearing beyond its limit."""
    if e.kind in BEARINGS:
        load = {"value": torque(e.value), "limit": number(e.limit, 5), "unit": e.unit, "time": seconds(e.time)}
        return sentence("bearing", joint=e.joint, kind=KINDS[e.kind], **load)
    speed, scale = e.kind == "velocity", math.degrees(1.0) if degrees and e.angular else 1.0
    by = abs(e.value) - e.limit if speed else abs(e.value - e.limit)
    return sentence(
        "motion",
        joint=e.joint,
        time=seconds(e.time),
        kind=KINDS[e.kind],
        by=number(scale * by, 3),
        unit=unit_of("dq" if speed else "q", e.angular, degrees=degrees),
        value=number(scale * e.value, 5),
        limit=number(scale * e.limit, 5),
    )


def _reaches(report: TorqueReport, e: Excess) -> bool:
    """True if a velocity within its limit after smoothing may exceed it."""
    estimate = report.joints[report.differentiation.model.velocity_names.index(e.joint)].estimate
    return estimate is None or abs(estimate.speed) + _SURE * estimate.speed_sigma > e.limit


def is_noise(report: TorqueReport, e: Excess) -> bool:
    """True if noise explains an exceeded position or velocity limit."""
    d = report.differentiation
    places = d.model.velocity_names
    k = places.index(e.joint)
    if e.kind == "velocity":
        estimate = report.joints[k].estimate
        if estimate is None or not d.derives_velocities:
            return False
        return abs(estimate.speed) - _SURE * estimate.speed_sigma <= e.limit
    if e.kind in BEARINGS or not (d.derives and d.derives_velocities):
        return False  # noise of these was not estimated
    body = next(b for b in d.model.leaders if b.v_index <= k < b.v_index + b.joint.nv)
    return abs(e.value - e.limit) <= _SURE * float(d.errors.at_rest[body.q_index])


def _grouped(over: list[tuple[Excess, str]]) -> list[str]:
    """Sentences on the worst excess and on the other joints."""
    if not over:
        return []
    first, text = over[0]
    others: dict[str, list[str]] = {}
    for e, _ in over[1:]:
        kinds = others.setdefault(e.joint, [])
        if KINDS[e.kind] not in kinds and (e.joint, KINDS[e.kind]) != (first.joint, KINDS[first.kind]):
            kinds.append(KINDS[e.kind])
    rest = [sentence("other", joint=joint, kinds=", ".join(kinds)) for joint, kinds in others.items() if kinds]
    return [text, *([sentence("also", others=listed(rest, _MOST_LISTED))] if rest else [])]


# ── Notes on the log

_NOISY = 0.02
"""Relative uncertainty of a peak above which a better log is recommended."""


def notes_of(report: TorqueReport) -> Iterator[str]:
    """Notes on the log that affect the accuracy of the figures."""
    d, q = report.differentiation, report.quality
    derived = {"positions": "accelerations", "velocities": "accelerations (from the velocity columns)", "given": ""}[
        d.source
    ]
    what = " and ".join(x for x in ("velocities" if d.derives_velocities else "", derived) if x)
    if what:
        smoothed = ", after smoothing to the noise found" if d.smooths else ""
        derivation = f"The file has no {what.split(' (')[0]}: derived by a quintic spline{smoothed}."
        yield derivation if d.smooths else ReadingNote(derivation)  # smoothing changes figures
        yield from _quality_notes(report)
    if report.gaps.count:
        times = "time" if report.gaps.count == 1 else "times"
        yield (
            f"Time jumps {report.gaps.count} {times} by more than {number(report.gaps.threshold / q.step)} usual steps; "
            f"the longest gap is {number(report.gaps.longest)} s, after t = {seconds(report.gaps.longest_at, 4)} s."
            + (" Derived rates near gaps are guesses." if d.derives else "")
        )
    yield from report.load.unit_hints
    yield from notes_on_limits(report.limits)
    floating = list(dict.fromkeys(b.joint.name for b in report.load.robot.model.bodies if not b.joint.driven))
    if report.held.support is not None:
        yield from support_notes(report.held.support)
    elif floating and not missing_force(report.load.with_load.model, report.joints):  # otherwise the verdict has it
        yield f"Nothing drives {', '.join(floating)}: its rows are the wrench that contacts would have to give."
    model = report.load.with_load.model
    missing = drives_without_limit(model, report.limits.effort, [j.peak for j in report.joints])
    if missing and report.verdict.word is not Word.UNSURE:  # otherwise among the reasons
        yield f"No torque limit is known for {listed(missing)}: {limits_remedy(model.source)}."
    if resting := [
        f"{p.frame or report.load.robot.model.tip}"
        for p in report.load.payloads
        if report.load.robot.model.frame(p.frame or report.load.robot.model.tip).body == BASE
    ]:
        yield f"The payload at {', '.join(resting)} rests on the fixed base and loads no joint."
    if report.idle_payload:
        yield (
            "What is carried makes no torque in any joint: its place stays on their axes. Say where it is, in metres from its "
            f"frame: {spell(Argument('payload', 'MASS,x,y,z@FRAME'))}."
        )
    yield from _friction_notes(report)
    yield from _measured_notes(report)
    yield from _stray_notes(report)
    yield from d.trajectory.notes


def notes_on_log(report: TorqueReport) -> Iterator[str]:
    """Notes on the log that affect all loads, whatever is judged by them."""
    if report.noisy:
        yield from _quality_notes(report)
    yield from _stray_notes(report)
    yield from report.differentiation.trajectory.notes


def _friction_notes(report: TorqueReport) -> Iterator[str]:
    model = report.load.robot.model
    friction, still = model.friction.static, np.array(report.stationary)
    for at, _, _ in model.coupled:  # a motor is at rest if all its joints are at rest
        still[at] = still[at].min()
    found = [
        f"{j.joint} (±{number(friction[k])} {j.unit}, {percent(still[k], 3)} of the rows)"
        for k, j in enumerate(report.joints)
        if friction[k] > 0 and still[k] > 0
    ]
    if found and report.load.friction:
        yield (
            "Coulomb friction is undetermined for joints at rest within the noise of their derived velocities, and "
            f"left out there: {', '.join(found)}."
        )


def _measured_notes(report: TorqueReport) -> Iterator[str]:
    for cause in report.causes:
        if cause.sentence.rstrip(".") not in report.verdict.reasons:
            yield f"{cause.sentence[0].upper()}{cause.sentence[1:]}"
    if differ := [
        m.joint for m in report.measured if m.disagrees and not any(explains(c, m.joint) for c in report.causes)
    ]:
        yield (
            f"The file's own torques are grossly different from those computed for {', '.join(differ)}: friction or load that "
            "the model lacks, another robot, or another unit."
        )
    if hidden := [m.joint for m in report.measured if m.differs and not m.disagrees]:
        yield (
            f"The file's own torques are grossly different from those computed for {', '.join(hidden)}, as noise of the log "
            "may explain: trust the file's own."
        )
    for m in report.measured:
        if m.above and not m.lasting:
            yield (
                f"The measured torque of {m.joint} has a peak of {number(1e3 * m.above, 2)} ms above its limit, "
                f"{torque(m.peak)} {m.unit} of {number(m.limit)}, as in an impact."
            )
    if dead := [m.joint for m in report.measured if m.dead]:
        yield f"The torque column never changes, and is not compared, for {', '.join(dead)}."


def _stray_notes(report: TorqueReport) -> Iterator[str]:
    d = report.differentiation
    shown = []
    for s in report.outliers[:_MOST_LISTED]:
        place = int(d.places[s.column])
        size = s.off / d.trajectory.columns.factors["dq" if d.source == "velocities" else "q"][s.column]
        count = f", {s.count} samples, the farthest" if s.count > 1 else ""
        shown.append(
            f"{d.trajectory.columns.header[place]}{count} at t = {seconds(s.time, 4)} s off by {number(size)} "
            f"({number(abs(s.sigmas), 2)} σ)"
        )
    if shown:
        more = f"; and {len(report.outliers) - len(shown)} columns more" if len(report.outliers) > len(shown) else ""
        yield (
            f"WARNING: smoothing flattened samples that noise does not explain: {'; '.join(shown)}{more}, in the file's "
            "unit. If the robot did move so, the torques there are far too low; if the log is wrong, remove the samples."
        )


def _quality_notes(report: TorqueReport) -> Iterator[str]:
    d, q = report.differentiation, report.quality
    if d.source == "given":
        return
    if not report.noisy:
        yield f"Noise of the log moves no torque by more than {percent(NEGLIGIBLE, 1)} of its peak."
        return
    derived = d if report.derived is None else report.derived.differentiation
    worst = int(q.noise.argmax())
    grid = f", on a grid of {number(q.quantum[worst])}" if q.quantum[worst] else ""
    joint = report.joints[int(derived.sigma_ddq.argmax())]
    unit = unit_of("ddq", bool(Coordinates.from_model(d.model).angular_velocity[derived.sigma_ddq.argmax()]))
    loudest = max(report.joints, key=lambda j: j.noise)
    late = d.errors.stamp
    delay = f", and stamp errors of {number(1e3 * np.median(late[late > 0]), 2)} ms" if _stamps_matter(report) else ""
    yield (
        f"The log has noise of {number(q.noise[worst], 2)} (1 σ, {d.trajectory.columns.header[d.places[worst]]}, "
        f"in the file's unit{grid}){delay}. {'As it is, it' if report.derived else 'Smoothed, it still'} makes accelerations "
        f"unsure by {number(derived.sigma_ddq.max(), 2)} {unit} ({joint.joint}) and single torques by up to "
        f"{deviation(loudest.noise)} {loudest.unit} ({loudest.joint})."
    )
    beside = "" if report.derived is None else " The raw peak is that of the log as it is, at an instant of its own."
    yield (
        "Peaks, their causes, shares of limits and the verdict are of the smoothed motion, less what noise adds to a largest "
        f"value; ± 1σ is the peak's standard deviation.{beside}"
    )
    if ends := [j.joint for j in report.joints if report.at_an_end(j)]:
        yield (
            f"The peak of {', '.join(ends)} lies at an end of the log or beside a gap, where derived accelerations are several "
            "times as uncertain, for want of neighbours. Log a little more before and after."
        )
    if any(report.reach(j) > _NOISY * report.reference(j) for j in report.joints):
        yield (
            f"Noise leaves more than {percent(_NOISY)} of a peak unknown. Log velocities and accelerations as well, if the "
            "controller has them, or more slowly changing motions."
        )


def _stamps_matter(report: TorqueReport) -> bool:
    """True if most moving columns have time stamp errors beyond their noise."""
    errors = report.differentiation.errors
    moving = report.quality.noise > 0
    shows = errors.stamp > 0
    return bool(moving.any() and (shows & moving).sum() > 0.5 * moving.sum())
