"""Verdicts on torques, from reports that differ in one figure: every word, every reason, both sides of every limit."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from recorded_answers import Records

import twistwrench as tw
from twistwrench.core.doubts import Doubt, doubt_table
from twistwrench.motion.differentiation import Outlier
from twistwrench.motion.load_case import PayloadMargin
from twistwrench.motion.plausibility import DoubtfulSpans, Instant, InstantKind
from twistwrench.reports import torque_verdict
from twistwrench.reports.drawn_motion import motion_of, read_motion, reported_motion
from twistwrench.reports.measured_torque import MeasuredTorque
from twistwrench.reports.motors import Demand, MotorUse
from twistwrench.reports.spoken_verdict import verdict_data, verdict_view, why_doubted, why_fixed
from twistwrench.reports.statistics import Gaps, PeakEstimate, _Gap
from twistwrench.reports.torque_report import BearingUse, Excess, Joints, NearLimit, SoundFigures
from twistwrench.reports.torque_verdict import notes_of
from twistwrench.reports.torque_view import motors_table, motors_verdict, report_view

from .report_cases import TRIPOD, crane, motion, quietly, said, shown, styled, swing, uneven, words_of

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

MIDDLE, END = 0.61, 0.021
NAMES = ("swivel", "luff", "boom", "pinch_b")
LIMITS = (61.0, 47.0, 83.0, 29.0)


@functools.cache
def plain():
    """A report on a motion with all rates: nothing is uncertain."""
    return tw.check(crane(), motion(), payload=1.3)


@functools.cache
def noisy():
    """A report on a log of positions whose noise matters, without its own estimates."""
    t = uneven(60)
    q, _, _ = swing(t)
    q = q + np.random.default_rng(3).normal(0, 1e-4, q.shape)
    report = tw.check(crane(), tw.Motion(t, q, robot=crane(), in_seconds=True), payload=1.3)
    joints = [replace(joint, time=MIDDLE, estimate=estimate(joint.largest, 0.0)) for joint in report.joints]
    return replace(report, joints=Joints(joints), derived=replace(report.derived, excesses=()))


def estimate(value, sigma=0.0, speed=0.3, speed_sigma=0.01):
    return PeakEstimate(value, sigma, speed, speed_sigma)


def peaks(report, *figures, **changes):
    """Report whose joints have other figures, in their order; None leaves a joint as it is."""
    joints = []
    for joint, figure in zip(report.joints, figures + (None,) * len(report.joints), strict=False):
        joints.append(joint if figure is None else replace(joint, **figure))
    return replace(report, joints=Joints(joints), **changes)


def over(joint, kind="effort", value=None, limit=None, time=MIDDLE, unit="N m", angular=True):
    k = NAMES.index(joint) if joint in NAMES else 3
    limit = LIMITS[k] if limit is None else limit
    return Excess(joint, kind, 1.07 * limit if value is None else value, limit, time, unit, angular)


def judged(report, *, degrees=False, notes=True):
    verdict = torque_verdict.verdict_of(report, degrees=degrees)
    headline = styled(verdict_view(report, verdict).pieces)
    return [headline, *(str(note) for note in notes_of(report))] if notes else headline


# ── Torques and their noise


@records.of
def peaks_on_both_sides_of_a_limit_within_noise():
    """Two joints have limits, which decides how many deviations are counted."""
    few = replace(noisy().limits, effort=np.array([61.0, 47.0, math.inf, math.inf]))
    table = {}
    for joints in (4, 2):
        base = noisy() if joints == 4 else replace(noisy(), limits=few)
        base = peaks(base, None, None, *[{"limit": math.inf}] * 2) if joints == 2 else base
        deviations = torque_verdict.confidence(joints)
        table[f"deviations of {joints}"] = deviations
        for time, factor in ((MIDDLE, 1.0), (END, 5.0)):
            half_width = deviations * factor * 0.8
            for place, share in (("sure", 1.02), ("just open", 0.98), ("below, open", -0.98), ("below", -1.02)):
                peak = -(47.0 + share * half_width)
                figure = {"largest": peak - 0.4, "time": time, "estimate": estimate(peak, 0.8), "raw": peak - 2.2}
                excesses = (over("luff", value=peak, time=time),) if share > 0 else ()
                report = peaks(base, None, figure, excesses=excesses)
                table[f"{joints} at {time}, {place}"] = judged(report, notes=False)
    no_excess = peaks(noisy(), {"estimate": estimate(63.0, 0.0), "largest": 63.0})
    table["above without an excess"] = judged(no_excess, notes=False)
    table["no width, and an excess"] = judged(replace(no_excess, excesses=(over("swivel", value=63.0),)), notes=False)
    table["an excess that is gone"] = judged(
        peaks(noisy(), {"estimate": estimate(60.0)}, excesses=(over("swivel"),)), notes=False
    )
    little = peaks(
        noisy(), {"estimate": estimate(64.0, 0.063), "largest": 64.0}, excesses=(over("swivel", value=64.0),)
    )
    table["a noise that is not stated"] = judged(little, notes=False)
    table["a noise that is stated"] = judged(
        peaks(little, {"estimate": estimate(64.0, 0.065), "largest": 64.0}), notes=False
    )
    return table


@records.of
def peaks_that_are_mostly_noise():
    table = {}
    for share in (0.49, 0.51):  # half of the interval over the peak
        for of_limit in (0.495, 0.505):
            peak = of_limit * 47.0 / (1 + share)
            wide = {"estimate": estimate(-peak, share * peak / 1.96), "raw": -peak - 3.0}
            table[f"limit {share} {of_limit}"] = judged(peaks(noisy(), None, wide), notes=False)
    open_limits = replace(noisy().limits, effort=np.full(4, math.inf))
    free = replace(
        peaks(noisy(), *[{"limit": math.inf, "estimate": estimate(40.0 + k, 0.1)} for k in range(4)]),
        limits=open_limits,
    )
    for share in (0.49, 0.51):
        wide = {"estimate": estimate(12.0, share * 12.0 / 1.96), "raw": 13.0}
        noise = {"estimate": estimate(12.0, 0.1), "raw": 12.0 / (1 - share)}
        noise_without_raw = {"estimate": estimate(12.0, 0.1), "raw": None, "largest": -12.0 / (1 - share)}
        for name, figure in (("wide", wide), ("noise", noise), ("noise of the largest", noise_without_raw)):
            table[f"free, {name} {share}"] = judged(peaks(free, figure), notes=False)
    for of_largest in (0.0198, 0.0202):  # of the largest torque with the unit, 41
        small = {"estimate": estimate(0.2, 0.001), "raw": of_largest * 41.0}
        table[f"free, small {of_largest}"] = judged(peaks(free, small), notes=False)
        slides = {"estimate": estimate(0.2, 0.001), "raw": of_largest * 43.0}
        table[f"free, sliding {of_largest}"] = judged(peaks(free, None, None, slides), notes=False)
    everything = [{"estimate": estimate(30.0 + k, 12.0), "raw": 50.0 + k} for k in range(4)]
    measured = (replace(good("luff"), matters=True, residual=20.0, computed=20.0, noise=16.0, peak=-7.7), good("boom"))
    table["all"] = judged(peaks(noisy(), *everything, measured=measured), notes=False)
    return table


@records.of
def followers_within_noise():
    """The finger that follows has the leader's deviation over its ratio."""
    deviations = torque_verdict.confidence(4)
    table = {}
    for share in (1.02, 0.98):
        value = -(17.0 + share * deviations * 0.5 / 1.2)
        report = peaks(noisy(), None, None, None, {"estimate": estimate(2.0, 0.5)})
        excess = over("pinch_a", value=value, limit=17.0, unit="N", angular=False)
        table[str(share)] = judged(
            replace(report, excesses=(excess, over("luff", "velocity", -3.1, 1.9, unit="rad/s"))), notes=False
        )
    return table


@records.of
def several_excesses():
    every = [
        over("boom", unit="N", value=-91.0, angular=False), over("luff", value=48.1), over("luff", "velocity", -2.3, 1.9, unit="rad/s"),
        over("luff", "upper", 1.93, 1.7, unit="rad"), over("luff", "lower", -1.31, -1.1, unit="rad"),
        over("boom", "velocity", 0.81, 0.7, unit="m/s", angular=False), over("swivel", "axial", 130.0, 111.0, unit="N"),
        over("swivel", "radial", 230.0, 211.0, unit="N"), over("pinch_b", "tilting", 3.3, 2.1, unit="N m"),
        over("pinch_b", "lower", -0.013, -0.01, unit="m", angular=False), over("turn 5", unit="N m", limit=3.0),
    ]  # fmt: skip
    figures = ({"largest": 57.0}, {"largest": 48.1}, {"largest": -91.0})
    tall = peaks(plain(), *figures)
    table = {
        "all": judged(replace(tall, excesses=tuple(every[:-1]))),
        "degrees": judged(replace(plain(), excesses=tuple(every[2:5])), degrees=True, notes=False),
        "no torques": judged(replace(plain(), excesses=tuple(every[2:-1])), notes=False),
        "both stops": judged(replace(plain(), excesses=(every[3], every[4])), notes=False),
        "bearings": judged(replace(plain(), excesses=tuple(every[6:9])), notes=False),
        "slides": judged(replace(plain(), excesses=(every[9], every[5])), degrees=True, notes=False),
        "one torque": judged(replace(tall, excesses=(every[1],)), notes=False),
    }  # fmt: skip
    table["tables"] = shown(report_view(replace(tall, excesses=tuple(every[:-1]), degrees=True)))[-2:]
    return table


@records.of
def motion_limits_within_noise():
    table = {}
    sigma = float(noisy().differentiation.errors.at_rest[1])
    for share in (0.99, 1.01):
        stop = over("luff", "upper", 1.7 + 5 * share * sigma, 1.7, unit="rad")
        table[f"position {share}"] = judged(replace(noisy(), excesses=(stop,)), notes=False)
        low = over("luff", "lower", -1.1 - 5 * share * sigma, -1.1, unit="rad")
        table[f"lower {share}"] = judged(replace(noisy(), excesses=(low,)), notes=False)
        fast = {"estimate": estimate(3.0, 0.1, speed=-(1.9 + 5 * share * 0.03), speed_sigma=0.03)}
        velocity = over("luff", "velocity", -2.2, 1.9, unit="rad/s")
        table[f"velocity {share}"] = judged(peaks(noisy(), None, fast, excesses=(velocity, stop)), notes=False)
        slow = {"estimate": estimate(3.0, 0.1, speed=-(1.9 - 5 * share * 0.03), speed_sigma=0.03)}
        removed = replace(noisy().derived, excesses=(velocity, over("boom", unit="N"), stop))
        table[f"removed {share}"] = judged(peaks(noisy(), None, slow, derived=removed), notes=False)
    both = replace(noisy().derived, excesses=(velocity,))
    table["not removed"] = judged(peaks(noisy(), None, fast, derived=both, excesses=(velocity,)), notes=False)
    table["unknown speed"] = judged(peaks(noisy(), None, {"estimate": None}, derived=both), notes=False)
    table["given"] = judged(replace(plain(), excesses=(stop, velocity)), notes=False)
    table["bearing"] = judged(replace(noisy(), excesses=(over("luff", "axial", 111.1, 111.0, unit="N"),)), notes=False)
    table["as data"] = {
        key: value for key, value in verdict_data(noisy().load, noisy().limits, peaks(noisy(), None, fast, excesses=(velocity, stop, low))).items()
        if key in ("passed", "noisy", "joints", "near", "asLogged")
    }  # fmt: skip
    return table


# ── Doubts about the log


def row(kind, level=None, joints=("luff",)):
    return Doubt(kind, f"a doubt of {kind}", joints, level or "unsure", remedy=f"mend {kind}")


def with_origin(report, origin):
    trajectory = replace(report.differentiation.trajectory, plan=origin == "plan")
    if origin == "log":
        trajectory.__dict__["origin"] = torque_verdict.Origin.LOG
    return replace(report, differentiation=replace(report.differentiation, trajectory=trajectory))


@records.of
def doubts_about_a_log():
    kinds = (*torque_verdict._DOUBTS_OF_WHOLE_LOG, "gap", "doubtful-rows", "dropout")
    excess = over("luff", value=-50.0)
    high = peaks(plain(), None, {"largest": -50.0, "time": MIDDLE})
    table = {}
    for kind in kinds:
        for level in ("unsure", "note", "refuse"):
            for name, excesses in (("over", (excess,)), ("fine", ())):
                report = replace(
                    high if excesses else plain(), doubts=(row(kind, level), row("pause", "note")), excesses=excesses
                )
                table[f"{kind} {level} {name}"] = judged(report, notes=False)
    for origin in ("plan", "log", "either"):
        report = with_origin(replace(high, doubts=(row("impact"),), excesses=(excess,)), origin)
        table[f"origin {origin}"] = judged(report, notes=False)
        table[f"page of {origin}"] = why_doubted(report)
    stop = over("luff", "upper", 4.1, 1.7, unit="rad")
    lower = over("boom", "lower", -0.4, -0.15, unit="m", angular=False)
    for level in ("note", "unsure", "refuse"):
        report = replace(
            plain(), doubts=(row("wound", level), row("wound", "note", ("swivel",))), excesses=(stop, lower)
        )
        table[f"wound {level}"] = judged(report, notes=False)
        table[f"wound {level}, fine"] = judged(replace(report, excesses=()), notes=False)
    asked = tuple(row(kind, "note") for kind in ("time-step", "angle-unit", "degrees-option", "held"))
    table["questions"] = shown([verdict_view(replace(plain(), doubts=asked))])
    return table


@records.of
def rows_in_doubt_on_both_sides():
    instants = (
        Instant(0.1, 0.12, 0, InstantKind.IMPACT), Instant(0.3, 0.32, 1, InstantKind.ROWS), Instant(0.41, 0.43, 2, InstantKind.FREEZE),
    )  # fmt: skip
    spans = DoubtfulSpans(instants, 0.02)
    peak = np.abs([joint.largest for joint in plain().joints])
    table = {}
    largest = max(peak / LIMITS)
    for change in (0.049, 0.051):
        sound = np.minimum(peak, (largest - change) * np.array(LIMITS))
        report = replace(plain(), spans=spans, sound=SoundFigures(sound, ()))
        table[f"change {change}"] = judged(report, notes=False)
    luff, boom = over("luff", value=-50.0, time=0.31), over("boom", value=90.0, time=0.42, unit="N")
    fast = over("luff", "velocity", -2.3, 1.9, unit="rad/s", time=0.11)
    high = peaks(plain(), None, {"largest": -50.0}, {"largest": 90.0}, spans=spans, excesses=(luff, boom, fast))
    for name, sound in (
        ("none", ()),
        ("one", (luff,)),
        ("all", (luff, boom, fast)),
        ("speed", (fast,)),
        ("torques", (luff, boom)),
    ):
        report = replace(high, sound=SoundFigures(peak, sound))
        table[f"sound {name}"] = judged(report, notes=False)
        table[f"doubted {name}"] = sorted(torque_verdict.doubted_excesses(report))
    refuting = replace(good("luff"), computed_peak=-50.0, beside=20.0, limit=47.0)
    table["refuted too"] = judged(
        replace(high, sound=SoundFigures(peak, (luff, boom, fast)), measured=(refuting,)), notes=False
    )
    table["plan"] = judged(with_origin(replace(high, sound=SoundFigures(peak, ())), "plan"), notes=False)
    table["within"] = spans.within(np.array([0.079, 0.0801, 0.139, 0.141, 0.279, 0.281, 0.449, 0.451]))
    return table


# ── Measured torques


def good(joint="luff", **figures):
    """Measured torque that agrees, with all figures different."""
    k = NAMES.index(joint)
    given = {
        "joint": joint, "unit": ("N m", "N m", "N", "N")[k], "computed": 12.0 + k, "measured": 11.0 + k, "residual": 2.0 + k, "noise": 0.1,
        "gain": 0.93, "correlation": 0.97, "peak": -21.5 - k, "time": 0.37, "dead": False, "matters": True, "limit": LIMITS[k],
        "computed_peak": 24.0, "beside": 21.0,
    }  # fmt: skip
    return MeasuredTorque(**(given | figures))


MEASURED = {
    "agrees": {},
    "residual below": {"residual": 0.599 * 13},
    "residual above": {"residual": 0.601 * 13},
    "measured is larger": {"measured": 20.0, "residual": 0.599 * 20.0},
    "measured is larger and differs": {"measured": 20.0, "residual": 0.601 * 20.0},
    "does not matter": {"residual": 12.0, "matters": False},
    "dead": {"residual": 12.0, "dead": True},
    "noise explains": {"residual": 9.0, "noise": 3.7},
    "noise hardly explains": {"residual": 9.0, "noise": 3.5},
    "noise does not": {"residual": 9.0, "noise": 2.0},
    "opposite": {"residual": 22.0, "correlation": -0.901},
    "hardly opposite": {"residual": 22.0, "correlation": -0.899},
    "scaled up": {"measured": 40.0, "residual": 28.0, "gain": 3.03},
    "hardly scaled up": {"measured": 38.0, "residual": 26.0, "gain": 2.97},
    "scaled down": {"measured": 4.5, "residual": 9.0, "gain": 0.33},
    "hardly scaled down": {"measured": 4.5, "residual": 9.0, "gain": 0.34},
    "scaled without correlation": {"measured": 40.0, "residual": 28.0, "gain": 3.03, "correlation": 0.899},
    "too large": {"measured": 13.0 / 3.03, "residual": 11.0, "correlation": 0.3},
    "hardly too large": {"measured": 13.0 / 2.97, "residual": 11.0, "correlation": 0.3},
    "small against the limit": {"computed": 1.2, "measured": 1.1, "residual": 0.93},
    "larger against the limit": {"computed": 1.2, "measured": 1.1, "residual": 0.95},
    "refutes": {"computed_peak": -48.0, "beside": 23.9},
    "supports": {"computed_peak": -48.0, "beside": 24.1},
    "measured beyond the limit": {"computed_peak": -100.0, "beside": 47.5},
    "computed within the limit": {"computed_peak": -46.0, "beside": 2.0},
    "lasting": {"above": 0.0123, "lasting": True, "peak": 52.3},
    "lasting and opposite": {"above": 0.0123, "lasting": True, "residual": 22.0, "correlation": -0.95},
    "impact": {"above": 0.0083, "peak": -52.3},
    "cut": {"cut": 0.213, "cut_at": -9.5},
    "cut and small": {"cut": 0.213, "cut_at": -9.5, "matters": False},
}


@records.of
def measured_torques_of_each_kind():
    high = peaks(plain(), None, {"largest": -48.0}, excesses=(over("luff", value=-48.0),))
    properties = (
        "share",
        "refutes",
        "differs",
        "disagrees",
        "contradicts",
        "words",
        "refuting_words",
        "above_words",
        "cut_words",
    )
    table = {}
    for name, figures in MEASURED.items():
        m = good(**figures)
        words = {p: getattr(m, p) for p in properties[:6]}
        report = replace(plain(), measured=(good("boom"), m))
        table[name] = [words, judged(report), judged(replace(high, measured=(m,)), notes=False)]
    table["words"] = {p: getattr(good(above=0.02, cut=0.4, cut_at=-3.3), p) for p in properties[6:]}
    free = good(limit=math.inf, residual=9.5, computed=1.0, measured=10.0)
    table["without a limit"] = [
        free.share,
        judged(replace(peaks(plain(), None, {"limit": math.inf}), measured=(free,)), notes=False),
    ]
    every = tuple(good(name, residual=9.0 + k) for k, name in enumerate(NAMES))
    table["all"] = judged(replace(plain(), measured=every))
    table["table"] = shown(
        report_view(
            replace(
                plain(),
                measured=(*every[1:3], good("swivel", residual=22.0, correlation=-0.95), good("pinch_b", dead=True)),
            )
        )
    )[-2:]
    table["all dead"] = len(list(report_view(replace(plain(), measured=(good(dead=True),)))))
    return table  # fmt: skip


@records.of
def causes_of_measured_torques():
    """Each kind of cause, of the joint that differs and of another one."""
    table = {}
    differs = (good("luff", residual=9.0), good("boom"))
    opposite = (good("luff", residual=22.0, correlation=-0.95), good("boom"))
    for kind, kind_row in doubt_table().items():
        if "torques" not in kind_row.reads and kind_row.stage not in (2, 3):
            continue
        cause = Doubt(kind, f"the cause is {kind}.", ("luff", "swivel"), "refuse")
        table[kind] = [torque_verdict.explains(cause, "luff"), torque_verdict.explains(cause, "boom")]
    for kind in ("gain", "torque-sign", "tilt", "late", "low-pass", "zero", "load-friction"):
        for level in ("refuse", "unsure"):
            cause = Doubt(kind, f"the cause is {kind}.", ("luff",), level)
            table[f"{kind} {level}"] = [
                judged(replace(plain(), measured=measured, causes=(cause,)))
                for measured in (differs, opposite, (good("boom", residual=12.0),), ())
            ]
    return table


# ── Gaps, outliers, motors, payloads and questions


def hidden(*gaps, length=0.7, rates=None):
    rates = np.array([[2.0, 2.0, 2.0, 2.0], [9.0, 9.0, 9.0, 9.0]]) if rates is None else rates
    return Gaps(0.06, len(gaps), length, 0.13, gaps, rates, (np.full(4, -4.0), np.full(4, 4.0)))


def gap(begin=0.15, length=0.2, change=0.1, speed=0.01, least=0.5, extent=1.0):
    speeds = np.full((2, 4), speed)
    return _Gap(
        begin, length, change, speeds, np.full((2, 4), least), np.array([np.full(4, -extent), np.full(4, extent)])
    )


@records.of
def gaps_with_motion_on_both_sides():
    away = peaks(plain(), *[{"time": 0.02}] * 4)
    duration = away.end - away.begin
    step = away.quality.step
    table = {}
    for share in (0.149, 0.151):
        table[f"length {share}"] = judged(replace(away, gaps=hidden(gap(length=share * duration))))
        near = peaks(away, {"largest": 0.81 * 61.0})
        table[f"near the limit {share}"] = judged(replace(near, gaps=hidden(gap(length=share * duration))), notes=False)
    far = peaks(away, {"largest": 0.79 * 61.0})
    table["not near the limit"] = judged(replace(far, gaps=hidden(gap(length=0.05))), notes=False)
    for steps in (2.95, 3.05):
        for side, time in (("before", 0.15 - steps * step), ("after", 0.2 + steps * step)):
            at = peaks(away, None, None, {"time": time})
            table[f"{side} {steps}"] = judged(replace(at, gaps=hidden(gap(length=0.05))), notes=False)
    zero = peaks(away, None, None, None, {"time": 0.149, "largest": 1e-12})
    table["beside the peak of a zero"] = judged(replace(zero, gaps=hidden(gap(length=0.05))), notes=False)
    for name, one in {
        "still": gap(change=0.99e-3, speed=0.19), "moved": gap(change=1.01e-3, speed=0.0), "quick": gap(change=0.0, speed=0.21),
        "too fast": gap(least=9.3, length=0.05), "not too fast": gap(least=1.9, length=0.05), "beyond": gap(extent=4.01, length=0.05), "within": gap(extent=3.99, length=0.05),
    }.items():  # fmt: skip
        gaps = hidden(one)
        table[name] = [gaps.hidden, gaps.exceeds_logged_motion, judged(replace(away, gaps=gaps), notes=False)]
    two = hidden(gap(length=0.2), gap(0.4, 0.3), gap(0.8, 0.9, change=0.0))
    table["two"] = [two.hiding, two.hidden, two.hidden_words, judged(replace(away, gaps=two))]
    table["of a log"] = [
        str(x) for x in judged(replace(noisy(), gaps=hidden(gap(length=0.02)))) if "gap" in str(x) or "logged" in str(x)
    ]
    table["beside"] = [two.beside(t, 0.05) for t in (0.099, 0.101, 0.399, 0.401, 0.349, 0.451, 0.749, 0.751, 0.9)]
    table["page"] = {
        key: value
        for key, value in verdict_data(away.load, away.limits, replace(away, gaps=two)).items()
        if key in ("gap", "near")
    }
    table["doubts of other loads"] = torque_verdict.log_doubts(replace(away, gaps=two))
    return table  # fmt: skip


@records.of
def outliers_that_matter_or_not():
    base = noisy()
    off = [Outlier(k % 4, 1 + k, 0.1 * (k + 1), -7.3 + 3 * k, 0.011 * (k + 1), matters=k == 1) for k in range(6)]
    return {
        "none matters": judged(replace(base, outliers=(off[0], off[2]))),
        "one matters": judged(replace(base, outliers=(off[0], off[1]))),
        "six": judged(replace(base, outliers=tuple(off))),
        "five": judged(replace(base, outliers=tuple(off[:5])))[-3:],
        "notes for other loads": [str(x) for x in torque_verdict.notes_on_log(replace(base, outliers=tuple(off[:1])))],
    }


def use(joint, share, time=0.3, limit=10.0, unit="A", what="current"):
    demands = (
        Demand("peak current", 0.5 * share * limit, limit, "A", 0.21),
        Demand(what, share * limit, limit, unit, time),
    )
    return MotorUse(joint, None, demands, 12.3456789, 0.00000123, np.arange(3.0), np.arange(3.0), np.arange(3.0))


@records.of
def motors_on_both_sides_of_a_rating():
    sides = (1.0, 1.0 + 0.9e-6, 1.0 + 1.1e-6, 0.97, 1.21)
    table = {
        str(share): [
            judged(replace(plain(), motors=(use("luff", share),)), notes=False),
            styled(motors_verdict([use("luff", share)]).pieces),
        ]
        for share in sides
    }
    many = [use("luff", 1.1), use("boom", 1.3), use("swivel", 0.9), use("pinch_b", 1.2), use("pinch_a", 1.05)]
    table["many"] = [styled(motors_verdict(many).pieces), judged(replace(plain(), motors=tuple(many)), notes=False)]
    free = use("boom", 0.5, limit=math.inf)
    table["one is free"] = [styled(motors_verdict([replace(free, demands=free.demands[:1]), use("luff", 0.4)]).pieces)]
    table["table"] = shown(
        [
            motors_table(
                [
                    *many,
                    replace(
                        use("free", 1.0),
                        demands=(Demand("peak current", 3.0, math.inf, "A"), Demand("current", 2.0, math.inf, "A")),
                    ),
                ]
            )
        ]
    )
    demands = {}
    for name, demand in {
        "mean": Demand("rms current", 4.5, 9.0, "A"), "temperature": Demand("winding", 88.0, 130.0, "°C", 4.2, base=25.0),
        "no rise": Demand("winding", 88.0, 25.0, "°C", 4.2, base=25.0), "sure": Demand("current", 10.31, 10.0, "A", 1.0, sigma=0.1),
        "open above": Demand("current", 10.29, 10.0, "A", 1.0, sigma=0.1), "open below": Demand("current", 9.71, 10.0, "A", 1.0, sigma=0.1),
        "fits": Demand("current", 9.69, 10.0, "A", 1.0, sigma=0.1), "free": Demand("speed", 3.0, math.inf, "rad/s", 0.1),
    }.items():  # fmt: skip
        demands[name] = [demand.over, demand.open, demand.share, demand.words]
    return table | {"demands": demands}  # fmt: skip


@records.of
def payload_margins_and_further_lines():
    heavy = PayloadMargin(1.8765, "luff", 0.3, "hook")
    light = PayloadMargin(1.29, "luff", 0.3, "hook")
    high = peaks(plain(), None, {"largest": -50.0}, excesses=(over("luff", value=-50.0),))
    bearing = replace(plain().limits, axial=np.array([300.0, np.inf, np.inf, np.inf]))
    return {
        "fits": judged(replace(plain(), payload_margin=heavy), notes=False),
        "exactly": judged(replace(plain(), payload_margin=replace(heavy, mass=1.3)), notes=False),
        "contradicts": judged(replace(plain(), payload_margin=light), notes=False),
        "over": judged(replace(high, payload_margin=light), notes=False),
        "over contradicts": judged(replace(high, payload_margin=heavy), notes=False),
        "bearings": judged(replace(plain(), payload_margin=heavy, limits=bearing), notes=False),
        "page with bearings": why_doubted(replace(plain(), limits=bearing)),
        "unsure": judged(replace(plain(), payload_margin=heavy, doubts=(row("gap"),)), notes=False),
        "other limit": judged(
            replace(plain(), payload_margin=heavy, excesses=(over("luff", "velocity", 2.2, 1.9, unit="rad/s"),)),
            notes=False,
        ),
        "idle": judged(replace(plain(), idle_payload=True)),
        "brief": [
            replace(high, excesses=e).brief
            for e in (
                high.excesses,
                (over("boom", "velocity", 2.2, 1.9),),
                (over("boom", "lower", 2.2, 1.9), over("luff")),
            )
        ],
        "brief without limits": peaks(plain(), *[{"limit": math.inf}] * 4).brief,
        "facts without limits": peaks(plain(), *[{"limit": math.inf}] * 4).facts(),
    }


@records.of
def nearest_limits_of_an_ok():
    """What is named beside the torque nearest to its limit, on both sides of each share."""
    table = {}

    def near(kind, share, joint="boom"):
        return NearLimit(joint, kind, share, 0.27)

    for kind, least in (("velocity", 0.8), ("position", 0.99)):
        for share in (least - 0.004, least + 0.004):
            table[f"{kind} {share}"] = judged(replace(plain(), near=(near(kind, share),)), notes=False)
    tall = peaks(plain(), {"largest": 0.995 * 61.0})
    table["torque is nearer"] = judged(
        replace(tall, near=(near("velocity", 0.98), near("position", 0.994))), notes=False
    )
    table["torque is farther"] = judged(
        replace(tall, near=(near("velocity", 0.997), near("position", 0.996, "luff"))), notes=False
    )
    two = (
        near("position", 0.998, "luff"),
        near("position", 0.993),
        near("velocity", 0.991),
        near("velocity", 0.85, "luff"),
    )
    table["two of a kind"] = judged(replace(plain(), near=two), notes=False)
    for peak in (0.79, 0.81):
        table[f"measured {peak}"] = judged(
            replace(plain(), measured=(good("boom", peak=-peak * 83.0), good("luff", peak=3.0))), notes=False
        )
    bearings = (BearingUse("swivel", "radial", 60.0, 100.0, 0.11), BearingUse("luff", "axial", 35.0, 50.0, 0.12))
    table["bearing"] = judged(replace(plain(), bearings=bearings), notes=False)
    table["bearing farther"] = judged(replace(tall, bearings=bearings), notes=False)
    table["no limits"] = judged(peaks(plain(), *[{"limit": math.inf}] * 4), notes=False)
    table["no torque"] = judged(peaks(plain(), *[{"largest": 0.0, "limit": k + 1.0} for k in range(4)]), notes=False)
    smoothed = replace(noisy().derived, excesses=(over("luff"), over("luff", "velocity", 2.0, 1.9)))
    sure = {"estimate": estimate(30.0, 0.7), "largest": 31.0}
    table["smoothed, one joint"] = judged(peaks(noisy(), None, sure, derived=smoothed), notes=False)
    more = replace(smoothed, excesses=(over("luff"), over("swivel")))
    table["smoothed, two joints"] = judged(peaks(noisy(), None, sure, derived=more, bearings=bearings), notes=False)
    table["gap"] = judged(replace(peaks(plain(), *[{"time": 0.02}] * 4), gaps=hidden(gap(length=0.05))), notes=False)
    page = verdict_data(
        plain().load, plain().limits, replace(plain(), near=two, measured=(good("boom"), good("luff", peak=40.0)))
    )
    table["page"] = {"near": page["near"], "text": page["text"]}
    return table  # fmt: skip


@records.of
def notes_on_noise():
    base = noisy()
    quality = replace(
        base.quality, noise=np.array([0.001, 0.004, 0.002, 0.0]), quantum=np.array([0.0, 0.0015, 0.0, 0.0])
    )
    table = {"grid": judged(replace(base, quality=quality))[1:]}
    errors = base.differentiation.errors
    for stamps in ((0.001, 0.0, 0.0, 0.002), (0.001, 0.003, 0.0, 0.0)):
        plan = replace(base.differentiation, errors=replace(errors, stamp=np.array(stamps)))
        table[f"stamps {stamps}"] = judged(replace(base, quality=quality, differentiation=plan))[2]
    table["without raw"] = judged(replace(base, derived=None))[1:]
    for share in (0.0199, 0.0201):
        report = peaks(base, {"estimate": estimate(10.0, share * 10.0)})
        table[f"unknown {share}"] = judged(report)[-3:]
    shares = replace(base, stationary=(0.0, 0.123, 0.456, 0.0))
    table["friction"] = judged(shares)[-1]
    table["friction left out"] = judged(replace(shares, load=replace(shares.load, friction=False)))[-1]
    table["ends"] = judged(peaks(base, {"time": END}, None, {"time": END}))[-3:]
    return table


# ── Other robots


TREES = {
    "drone": '<mujoco><compiler angle="radian"/><worldbody><body name="hull" pos="0 0 1"><freejoint name="root"/><geom type="box" size="0.2 0.11 0.07" mass="3.1" pos="0.02 0.01 0"/>'
    '<body name="arm" pos="0.1 0.05 -0.1"><joint name="tilt" axis="0 1 0.2" range="-2 2"/><geom type="capsule" fromto="0 0 0 0.1 0.02 -0.3" size="0.03" mass="0.7"/></body></body></worldbody></mujoco>',
    "tripod": TRIPOD,
    "loop": '<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="ja" axis="0 1 0" actuatorfrcrange="-3 3" range="-3 3"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1.1"/>'
    '<body name="b" pos="0.3 0 0"><joint name="jb" axis="0 1 0" actuatorfrcrange="-9 9" range="-3 3"/><geom type="capsule" fromto="0 0 0 0.2 0 0.1" size="0.02" mass="0.7"/></body></body>'
    '<body name="c" pos="0.1 0 0.4"><joint name="jc" axis="0 1 0" actuatorfrcrange="-7 7" range="-3 3"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.9"/></body></worldbody>'
    '<equality><connect name="pin" body1="b" body2="c" anchor="0.2 0 0.1"/></equality></mujoco>',
}  # fmt: skip


@records.of
def robots_that_nothing_holds_or_closes():
    table = {}
    robots = {name: quietly(tw.load)(text) for name, text in TREES.items()}
    q = {
        "drone": [0.9, 0.1, 0.2, -0.3, 0.4, 0.2, 0.1, 0.3],
        "tripod": [0.2, -0.9, 0.3, 0.1, -0.2, -0.3],
        "loop": [0.4, 0.3, -0.2],
    }
    for name, robot in robots.items():
        pose = np.array(q[name])
        if name == "drone":
            pose[:4] /= np.linalg.norm(pose[:4])
        answer = quietly(tw.check)(robot, at=pose)
        table[name] = words_of(answer) | {"page": why_fixed(answer.load), "tables": said(answer)["tables"]}
        low = quietly(tw.check)(robot, at=pose, limits={"effort": 0.11 * np.arange(1.0, robot.nv + 1)})
        table[f"{name} over"] = words_of(low)
        if name == "drone":
            data = verdict_data(answer.load, answer.limits, answer)
            table["drone's page"] = {
                key: data[key] for key in ("force", "driven", "doubts", "questions", "assumed", "velocities")
            }
    motors = tuple(replace(use("ja", 1.3)) for _ in range(1))
    table["motor of a hanging robot"] = words_of(
        replace(quietly(tw.check)(robots["tripod"], at=q["tripod"]), motors=motors)
    )
    return table


@records.of
def clearance_beside_torques():
    """The distance of two links joins the verdict on torques; distances themselves are another subject."""
    found = tw.check(crane(), motion(), payload=1.3, clearance=0.02).clearance
    known = replace(found.pairs, unknown=(), shapes=())
    near = replace(found, pairs=known, pair=("jib", "post"), time=0.23, step=0.01, distance=0.0213)
    high = peaks(plain(), None, {"largest": -50.0}, excesses=(over("luff", value=-50.0),))
    unsure = replace(plain(), doubts=(row("gap"),))
    refused = replace(plain(), doubts=(row("gap", "refuse"),))
    table = {"unknown shapes": judged(replace(plain(), clearance=found), notes=False)}
    for name, one in {
        "far": near,
        "near": replace(near, distance=0.0187),
        "touches": replace(near, distance=0.0),
    }.items():
        for kind, report in {"ok": plain(), "over": high, "unsure": unsure, "refused": refused}.items():
            table[f"{name} {kind}"] = judged(replace(report, clearance=one), notes=False)
    page = verdict_data(plain().load, plain().limits, plain(), clearance=replace(near, distance=0.0187))
    drawn = reported_motion(replace(plain(), clearance=near))
    return table | {"page": [page["closest"], page["clearance"]], "drawn": drawn.clearance.distance}


@records.of
def why_a_page_cannot_judge():
    robot = crane()
    at = {"luff": 0.3}
    body = tw.SpatialInertia.from_com(1.2, (0.01, 0.02, 0.03), np.diag([0.01, 0.02, 0.025]))
    return {
        "fixed": {
            "plain": why_fixed(tw.check(robot, at=at, payload=2).load),
            "two": why_fixed(tw.check(robot, at=at, payload=[2, "1@claw_b"]).load),
            "body": why_fixed(tw.check(robot, at=at, payload={"hook": body}).load),
            "mass": why_fixed(tw.check(robot, at=at, payload="2,0.1,0,0@hook").load),
        },
        "none": why_doubted(None),
        "arrays": verdict_data(plain().load, plain().limits, None, ["a contradiction"], reported_motion(replace(plain(), limits=plain().limits)).violations),
        "payloads": [words_of(tw.check(robot, at=at, payload=given)) for given in (900, "1@turret", "0.4,5.1,0,0@hook")],
    }  # fmt: skip


# ── Motions that are drawn


@records.of
def drawn_motions(folder):
    robot = crane()
    t = uneven(14)
    q, dq, ddq = swing(t, 1.9)

    def figures(drawn):
        return {
            name: getattr(drawn, name)
            for name in ("time", "q", "dq", "ddq", "torques", "peaks", "rows", "warnings", "still", "verdict", "violations", "refused", "judged", "passed")
        } | {"at": drawn.at(0.5 * (drawn.time[3] + drawn.time[4]))}  # fmt: skip

    tight = replace(
        robot.limits,
        velocity=robot.limits.velocity * 0.5,
        lower=np.array([0.0, -1.1, -0.02, -0.01]),
        upper=np.array([0.9, 0.3, 0.2, 0.02]),
    )
    limited = replace(robot.model, limits=tight)
    other = tw.Robot(limited)
    noise = tw.Motion(uneven(60), noisy().motion.q, robot=robot, in_seconds=True)
    drawn = {
        "all": motion_of(robot, t, q, dq, ddq),
        "positions": motion_of(robot, t, q),
        "velocities": motion_of(robot, t, q, dq),
        "accelerations": motion_of(robot, t, q, None, ddq),
        "limits": motion_of(other, t, q, dq, ddq),
        "with a load": motion_of(
            tw.check(robot, motion(), payload=2.2).load, tw.Motion(t, q, dq, ddq, robot=robot, in_seconds=True)
        ),
        "few": motion_of(robot, t[:5], q[:5]),
        "few at rest": motion_of(robot, t[:5], np.tile(q[0], (5, 1))),
    }
    table = {
        name: figures(one) if name in ("all", "limits") else [one.torques, one.warnings, one.dq[1], one.ddq[1]]
        for name, one in drawn.items()
    }
    log = tw.check(robot, noise).differentiation.trajectory
    table["read"] = [read_motion(plain().load, log).peaks, read_motion(plain().load, log, smoothing=True).peaks]
    table["report"] = [reported_motion(noisy()).peaks, reported_motion(noisy()).limits.effort]
    from recorded_answers import refusal

    return table | {
        "no q": refusal(lambda: motion_of(robot, t)),
        "shape": refusal(lambda: motion_of(robot, t, q[:-1])),
        "dq": refusal(lambda: motion_of(robot, t, q, dq[:, :3])),
        "back": refusal(lambda: motion_of(robot, t[::-1], q)),
        "other robot": refusal(lambda: drawn["all"].require(tw.robots.planar_2r())),
    }  # fmt: skip


@records.of
def further_reasons_and_notes():
    """Notes on drives without limits and undriven bases, peaks beside measured ones, and pages of other robots."""
    robots = {name: quietly(tw.load)(text) for name, text in TREES.items()}
    wide = [{"estimate": estimate(12.0, 9.0), "raw": 20.0}]
    measured = (good("swivel", residual=9.0, peak=-3.3),)
    table = {"measured peak": judged(peaks(noisy(), *wide, measured=measured), notes=False)}
    open_limits = replace(plain().limits, effort=np.array([61.0, 47.0, math.inf, math.inf]))
    high = peaks(plain(), None, {"largest": -50.0}, excesses=(over("luff", value=-50.0),), limits=open_limits)
    table["over and without limits"] = judged(high)
    tripod_at = [0.2, -0.9, 0.3, 0.1, -0.2, -0.3]
    low = {f"{part}{k}": 0.51 + 0.1 * k for part in ("hip", "knee") for k in range(3)}
    table["hanging excess"] = words_of(quietly(tw.check)(robots["tripod"], at=tripod_at, limits={"hip1": 0.7}))
    table["hanging, all"] = words_of(quietly(tw.check)(robots["tripod"], at=tripod_at, limits=low))
    weightless = quietly(tw.load)(TREES["drone"], gravity=(0, 0, 0))
    pose = np.array([1.0, 0, 0, 0, 0.4, 0.2, 0.1, 0.3])
    table["weightless"] = words_of(quietly(tw.check)(weightless, at=pose))
    driven = quietly(crane().with_actuators)("actuators: {luff: {ratio: 5}}")
    table["fixed"] = [
        why_fixed(tw.check(driven, at={"luff": 0.3}).load),
        why_fixed(quietly(tw.check)(robots["tripod"], at=tripod_at, feet=["foot0", "foot1", "foot2"]).load),
    ]
    violations = motion_of(
        tw.Robot(
            replace(
                crane().model,
                limits=replace(
                    crane().limits, upper=np.array([0.6, 0.2, 0.1, 0.01]), lower=np.array([0.55, -0.1, 0.05, 0.005])
                ),
            )
        ),
        uneven(14),
        *swing(uneven(14)),
    ).violations
    stops = [violation for violation in violations if violation.kind == "position"]
    table["arrays"] = verdict_data(plain().load, plain().limits, None, [], stops)["passed"]
    fast = {"estimate": estimate(3.0, 0.1, speed=-1.85, speed_sigma=0.03)}
    velocity = over("luff", "velocity", -2.2, 1.9, unit="rad/s")
    table["noisy velocity"] = verdict_data(
        noisy().load, noisy().limits, peaks(noisy(), None, fast, excesses=(velocity,))
    )["noisy"]
    why = replace(
        peaks(noisy(), None, {"estimate": estimate(-30.0, 0.5), "largest": -31.4, "limit": 20.0}), with_why=True
    )
    table["why with noise"] = [
        block for block in shown(report_view(why)) if isinstance(block, dict) and block["title"].startswith("Why")
    ]
    two = _drawn_with_held_rows()
    table["drawn with doubts"] = [two.warnings, two.refused, two.verdict]
    coupled = quietly(crane().with_actuators)(
        "couplings: {w: {motors: [a, b], joints: [swivel, luff], motor_per_joint: [[1, 0.5], [0, 1]]}}\nactuators: {a: {ratio: 3, effort: 20 N m}, b: {ratio: 4, effort: 30 N m}}"
    )
    drawn = motion_of(coupled, uneven(14), *swing(uneven(14)))
    table["drawn with couplings"] = [drawn.limits.effort, drawn.torques[3], drawn.states.dq[2]]
    return table


def _drawn_with_held_rows():
    t = 0.02 * np.arange(60)
    q, _, _ = swing(t)
    q[20:23] = q[20]
    return read_motion(
        plain().load, tw.check(crane(), tw.Motion(t, q, robot=crane(), in_seconds=True)).differentiation.trajectory
    )


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
