"""Verdict on a motion as text, and as data from which a page judges other payloads, pushes and speeds."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.answers.blocks import Headline, Line
from ..core.answers.data import plain
from ..core.answers.sentences import sentence, spoken_sentences
from ..core.colours import NEAR_LIMIT, Style, strong
from ..core.gravity import STRENGTH
from ..core.numbers import TOLERANCE, percent, percent_of_limit, seconds
from ..core.verdict import Verdict, Word
from ..mechanics.joints.units import unit_of
from ..mechanics.model.limits import bears
from ..motion import load_case
from ..motion.coordinates import Coordinates
from ..motion.credible_values import driven_entries
from ..motion.load_case import LoadCase, Payload, PayloadMargin, cause_label
from ..motion.model_doubts import (
    SHARE,
    SHARE_OF_WEIGHT_ON_EARTH,
    SURE_FORCE,
    assumed_words,
    assumptions,
    base_doubts,
    base_velocities,
    force_remark,
    model_warnings,
    open_loop_joints,
)
from ..motion.motion_log import ASKED
from .statistics import INTERVAL
from .support.judgement import standing_words, support_verdict
from .torque_report import MIN_NOISE_SHARE, MIN_REFERENCE_SHARE, ZERO, BearingUse, TorqueReport
from .torque_verdict import (
    KINDS,
    because,
    carried_doubts,
    confidence,
    contradictions,
    doubted_excesses,
    is_noise,
    most_hidden,
    rows_in_doubt,
    verdict_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..mechanics.model.limits import Limits
    from ..mechanics.model.model import Model
    from ..motion.bounds import Violation
    from ..statics.clearance import PathClearance


MISSING_CONTACT = "IS A CONTACT MISSING?"
"""Question about a force that a floating base lacks."""


def verdict_view(report: TorqueReport, verdict: Verdict | None = None) -> Headline:
    """Headline with the reasons of a verdict and further sentences, one per line.

    The default ``verdict`` is the report's own, in its unit of angles.
    """
    if verdict is None:
        verdict = report.verdict
    load = report.load
    supports = report.held  # what holds the robot on the ground, the payload, and the base
    reasons = verdict.reasons
    if not reasons:
        reasons = (_ok_sentence(report),)
    first_reason, *other_reasons = reasons
    assumed = ""
    if verdict.ok:
        clauses = assumptions(load.robot.model, load.payloads, friction=load.friction, unjudged=report.limits)
        assumed = assumed_words(clauses)
    further_lines = []
    margin = _payload_margin(report)
    if margin is not None:
        margin_words = margin.words_alone if _has_other_limits(report) else margin.words
        further_lines.append(Line(margin_words))
    # The sentence of the verdict OK includes the support of the robot. Under another verdict it is a further sentence.
    if supports.support is not None and not verdict.ok and support_verdict(supports.support).ok:
        support_words = _capitalised(standing_words(supports.support))
        further_lines.append(Line(f"{support_words}."))
    if supports.grip is not None and supports.grip.verdict.ok:
        further_lines.append(Line(supports.grip.line))
    if supports.mounting is not None:
        further_lines.append(Line(supports.mounting.line))
    if report.clearance is not None:
        further_lines += map(Line, report.clearance.lines)
    for question, remark in _questions(report):
        further_lines.append(Line((question, strong(Style.NEAR)), f" {remark}"))
    other_sentences = [f"{reason}." for reason in other_reasons]
    return Headline(verdict.word, f"{first_reason}{assumed}.", reasons=other_sentences, further=further_lines)


def verdict_text(report: TorqueReport) -> str:
    """Text of the verdict with angles in radians, as pages judge it."""
    return plain(verdict_view(report, verdict_of(report)))


def _questions(report: TorqueReport) -> list[tuple[str, str]]:
    """Questions to the user, each with the remark that raises it."""
    unit_notes = [doubt for doubt in report.doubts if doubt.level == "note" and doubt.kind in ASKED]
    questions = [("IS THE UNIT RIGHT?", f"{doubt}.") for doubt in unit_notes]
    remark = force_remark(report.load.with_load.model, report.joints)
    if remark:
        questions.append((MISSING_CONTACT, remark))
    return questions


def _payload_margin(report: TorqueReport) -> PayloadMargin | None:
    """Largest payload, if the verdict is certain and consistent with the peaks of a noisy log."""
    if report.payload_margin is None or report.verdict.word not in (Word.OK, Word.OVER_LIMIT):
        return None
    payload_fits = report.payload_margin.mass >= report.load.payloads[0].mass
    torques_exceed_limits = any(excess.kind == "effort" for excess in report.excesses)
    if payload_fits == torques_exceed_limits:  # the margin contradicts the peaks
        return None
    return report.payload_margin


def _has_other_limits(report: TorqueReport) -> bool:
    """True if the payload must also keep limits of a grip, of bolts or of bearings."""
    has_bolts = report.held.mounting is not None and report.held.mounting.pattern is not None
    has_bearing_limits = bears(report.limits)
    return report.held.grip is not None or has_bolts or has_bearing_limits


def _ok_sentence(report: TorqueReport) -> str:
    """Sentences of the verdict OK, without the final stop."""
    nearest = _nearest_sentences(report)
    if report.held.support is None:
        return nearest
    return f"{standing_words(report.held.support)}. {nearest.removeprefix(_ALL_LIMITS_KEPT)}"


_ALL_LIMITS_KEPT = "all limits kept. "
"""First words of the sentences on the nearest limit; words on the robot's support replace them."""


def _nearest_sentences(report: TorqueReport) -> str:
    """Sentences on the joint nearest to its limit, on smoothed noise, and on motion in gaps of the log."""
    limited_joints = [j for j in report.joints if math.isfinite(j.limit)]
    if not limited_joints:
        return sentence("no motor")
    j = max(limited_joints, key=lambda joint: joint.share)
    if report.is_zero(j.largest):
        return sentence("no torque")
    joints_over = _joints_over_before_smoothing(report)
    uncertainty = ""
    if joints_over:
        half_width = INTERVAL * report.reach(j)
        uncertainty = sentence("sure", share=percent(half_width / j.limit, 2))
    share = percent_of_limit(j.share)
    time = seconds(j.time)
    nearest = sentence("nearest", joint=j.joint, share=share, sure=uncertainty, time=time, because=because(j))
    bearing = max(report.bearings, key=lambda use: use.share, default=None)
    if bearing is not None and bearing.share > j.share:
        torque_sentence = sentence("near", kind="Torque", joint=j.joint, share=share + uncertainty, time=time)
        nearest = f"{_nearest_bearing(bearing)}. {torque_sentence}"
    sentences = [nearest, *_nearer_sentences(report, j.share)]
    if joints_over:
        sentences.append(sentence("smoothed", joints=joints_over))
    if report.gaps.hidden:
        sentences.append(_capitalised(report.gaps.hidden_words))
    return ". ".join(sentences)


def _capitalised(text: str) -> str:
    """Text with a capital first letter."""
    return f"{text[0].upper()}{text[1:]}"


def _nearest_bearing(use: BearingUse) -> str:
    """Sentence on a bearing that is nearer to its limit than every torque."""
    return sentence(
        "nearest bearing",
        joint=use.joint,
        share=percent_of_limit(use.share),
        kind=KINDS[use.kind],
        time=seconds(use.time),
    )


AT_STOP = 0.99
"""Distance from the middle of a range, as a share of half the range, above which a joint is at its stop."""


def _near_limits(report: TorqueReport) -> list[dict[str, Any]]:
    """Velocity, position and measured torque nearest to a limit, as data for the page.

    The entry ``least`` is the share of the limit above which the report names the quantity.
    """
    # The first entry of a kind has the largest share; in reversed order it is set last.
    near_by_kind = {near.kind: near for near in reversed(report.near)}
    nearest = []
    for kind, least_share in (("velocity", NEAR_LIMIT), ("position", AT_STOP)):
        if kind in near_by_kind:
            entries = vars(near_by_kind[kind])
            nearest.append({**entries, "least": least_share})
    if report.measured:
        use = max(report.measured, key=lambda use: use.share)
        nearest.append({
            "joint": use.joint, "kind": "measured torque", "share": use.share, "time": use.time, "least": NEAR_LIMIT,
        })  # fmt: skip
    return nearest


def _nearer_sentences(report: TorqueReport, share: float) -> list[str]:
    """Sentences on quantities that are nearer to a limit than a torque with this ``share`` of its limit."""
    sentences = []
    for near in _near_limits(report):
        if near["share"] > max(share, near["least"]):
            kind = _capitalised(near["kind"])
            near_share = percent_of_limit(near["share"])
            time = seconds(near["time"])
            sentences.append(sentence("near", kind=kind, joint=near["joint"], share=near_share, time=time))
    return sentences


def _joints_over_before_smoothing(report: TorqueReport) -> str:
    """Text with the number of joints over a limit before smoothing; empty if there are none."""
    if report.derived is None or not report.derived.excesses:
        return ""
    joint_count = len({excess.joint for excess in report.derived.excesses})
    if joint_count == 1:
        return "1 joint"
    return f"{joint_count} joints"


# ── Verdict as data


def verdict_data(
    load: LoadCase,
    limits: Limits,
    report: TorqueReport | None,
    refused: Sequence[str] = (),
    positions: Sequence[Violation] = (),
    clearance: PathClearance | None = None,
) -> dict[str, Any]:
    """Sentences, limits and doubts from which a page judges a motion with other payloads, pushes and speeds.

    A motion without a ``report``, such as arrays, has no noise. ``refused`` are its contradictions, and ``positions`` its
    exceeded position limits.
    """
    model = load.robot.model
    coordinates = Coordinates.from_model(model)
    payload = Payload(1.0)  # the page sets its mass
    if load.payloads:
        payload = replace(load.payloads[0], mass=1.0)
    assumptions_of = partial(assumptions, model, friction=load.friction, unjudged=limits, mass="{mass}")
    look_again, doubts_before, doubts_after = _doubts_of_all_loads(load, report, refused)
    closest: Sequence[str] = []  # sentences
    clearance_reasons: dict[str, Sequence[str]] = {}
    if clearance is not None:
        closest = clearance.lines
        clearance_reasons = {clearance.verdict.word: clearance.verdict.reasons}
    velocities = np.where(np.isfinite(limits.velocity), limits.velocity, -1.0)  # -1 without a limit
    limit_count = int(np.isfinite(limits.effort).sum())
    data = {
        "fixed": why_fixed(load) or why_doubted(report),
        "sentences": spoken_sentences(),
        "words": {
            "kinds": KINDS, "causes": {term: cause_label(term) for term in load_case.TERMS},
            "remedy": load_case.limits_remedy(model.source),
        },
        "bounds": {
            "tolerance": TOLERANCE, "loaded": load_case.MIN_SHARE_OF_LARGEST, "zero": ZERO,
            "negligible": MIN_NOISE_SHARE, "small": MIN_REFERENCE_SHARE, "near": NEAR_LIMIT, "interval": INTERVAL,
            "confidence": confidence(limit_count),
        },
        "driven": driven_entries(model).tolist(),
        "followers": [_follower(model, k) for k in model.limited_followers],
        "force": _force_at_base(model),
        "lookAgain": look_again,
        "doubts": {"first": base_doubts(model, "hanging, feet"), "before": doubts_before, "after": doubts_after},
        "placeholders": {
            "words": load_case.placeholder_doubt(load.robot, limits), "confirmed": limits.has_unit("effort").tolist(),
        },
        "assumed": {
            "empty": assumed_words(assumptions_of(())), "loaded": assumed_words(assumptions_of((payload,))),
            "tip": model.tip,
        },
        "velocities": velocities.tolist(),
        "turns": coordinates.angular_velocity.tolist(),
        "leastPerKilogram": load_case.least_torque_per_kilogram(model),
        "margin": not (load.friction and model.friction.load.any()),
        "passed": [_exceeded_stop(violation, model) for violation in positions],
        "noisy": [], "joints": None, "gap": None, "asLogged": "", "near": [], "questions": [],
        "closest": closest,
        "clearance": clearance_reasons,
    }  # fmt: skip
    if report is not None:
        data |= _log_data(report)
    return data


def _doubts_of_all_loads(
    load: LoadCase, report: TorqueReport | None, refused: Sequence[str]
) -> tuple[Sequence[str], Sequence[str], Sequence[str]]:
    """Reasons to look again; and reasons to be unsure, before and after the reasons on gaps of a log."""
    if report is None:
        return list(refused), model_warnings(load.with_load.model), []
    return contradictions(report), *carried_doubts(report)


def _exceeded_stop(violation: Violation, model: Model) -> dict[str, Any]:
    """Exceeded position limit, with the entries of :class:`Excess`."""
    k = model.velocity_names.index(violation.joint)
    is_angular = bool(Coordinates.from_model(model).angular_velocity[k])
    kind = "upper" if violation.value > violation.limit else "lower"
    return vars(violation) | {"kind": kind, "angular": is_angular}


def _follower(model: Model, k: int) -> dict[str, Any]:
    """Figures of the mimic joint of body k, which has a torque limit."""
    body = model.bodies[k]
    return {
        "joint": body.joint.name,
        "leader": body.v_index,
        "ratio": abs(body.ratio),
        "limit": body.effort,
        "unit": unit_of("tau", bool(body.joint.turning[0])),
        "body": k,
        "axis": body.joint.axes[0].tolist(),
    }


def _force_at_base(model: Model) -> dict[str, Any] | None:
    """Figures that show whether a floating base lacks a force; None if the base is driven."""
    rows = base_velocities(model)
    if not rows:
        return None
    return {
        "rows": rows,
        "mass": model.moving_mass,
        "strength": float(np.linalg.norm(model.gravity)),
        "question": MISSING_CONTACT,
        "share": SHARE,
        "least": SHARE_OF_WEIGHT_ON_EARTH * STRENGTH,
        "sure": SURE_FORCE,
    }


def _log_data(report: TorqueReport) -> dict[str, Any]:
    """Data available only for a log: noise of each joint's peak, gaps, exceeded limits of the motion."""
    exceeded_stops = []
    noisy_velocities = []  # names of joints
    for excess in report.excesses:
        is_stop = excess.kind in ("lower", "upper")
        if is_stop and not is_noise(report, excess):
            exceeded_stops.append(vars(excess))
        if excess.kind == "velocity" and is_noise(report, excess):
            noisy_velocities.append(excess.joint)
    noise_by_joint = None
    if report.noisy:
        noise_by_joint = []
        for j in report.joints:
            noise_by_joint.append({
                "chance": j.chance, "reach": report.reach(j), "end": report.at_an_end(j), "sigma": j.uncertainty,
            })  # fmt: skip
    gap = None
    if report.gaps.hidden:
        gap = {"hidden": report.gaps.hidden, "words": report.gaps.hidden_words, "most": most_hidden(report)}
    page_questions = [f"{question} {remark}" for question, remark in _questions(report) if question != MISSING_CONTACT]
    return {
        "passed": exceeded_stops,
        "noisy": noisy_velocities,
        "joints": noise_by_joint,
        "gap": gap,
        "asLogged": _joints_over_before_smoothing(report),
        "near": _near_limits(report),
        "questions": page_questions,
        "text": verdict_text(report),
    }


def why_doubted(report: TorqueReport | None) -> str | None:
    """Reason in a report why a page cannot judge other loads; None if there is none."""
    if report is None:
        return None
    if bears(report.limits):
        return "loads of bearings, which have limits, are not computed on the page"
    if doubted_excesses(report) or rows_in_doubt(report):
        return "rows of the log, or its unit, are in doubt"
    return None


def why_fixed(load: LoadCase) -> str | None:
    """Reason in a load case why the load is fixed, so that a page cannot judge others; None if there is none."""
    model = load.robot.model
    if load.fixed_words:
        return load.fixed_words
    if model.actuators:
        return "motors and gears are judged as well"
    if len(load.payloads) > 1:
        return f"there are {len(load.payloads)} payloads"
    if any(payload.body is not None for payload in load.payloads):
        return "the payload has moments of inertia"
    if open_loop_joints(model):
        return "loops of the robot's file are open"
    return None
