"""The verdict on a motion's torques, from what was found and from how sure that is."""

from __future__ import annotations

import math

from ..model.massless import massless_links
from ..verdict import Verdict
from .figures import cause_label, number, spread
from .findings import NEGLIGIBLE, Excess, JointTorque, TorqueReport
from .motors_text import motor_in_words

__all__ = ["because", "confidence", "verdict_of"]

_KINDS = {"lower": "position", "upper": "position", "velocity": "velocity", "effort": "torque"}
"""What the limits that may be passed are about."""
_ERROR = 0.025
"""Chance that noise alone makes some joint pass for over its limit, or hides that some is."""
_SURE = 5.0
"""Standard deviations by which no one of some million samples is off."""
_OTHER = 0.05
"""Share of a peak from which the peak without noise is another."""
_MOST_LISTED = 4


def verdict_of(report: TorqueReport) -> Verdict:
    """The verdict of a report.

    A limit is passed for certain where the excess is more than noise explains, the choice of the largest value, and of the
    worst joint, counted in. What noise explains, and what it could hide, is unsure.
    """
    over: list[tuple[Excess, str]] = []
    unsure: list[str] = []
    excesses = {(e.joint, e.kind): e for e in report.excesses}
    _judge_torques(report, excesses, over, unsure)
    _judge_motion(report, over, unsure)
    stated = _grouped(over)
    small = [f"the motor of {motor_in_words(use)} is too small" for use in report.motors if use.too_small]
    if report.smoothed is not None and not report.differentiation.strengths.any():
        unsure += [f"{x}, but currents follow noisy accelerations: try --smooth" for x in small]
    else:
        stated += small
    if massless := massless_links(report.load.loaded.model):
        unsure.append(
            f"{_listed(massless)} {'have' if len(massless) > 1 else 'has'} no mass, so "
            f"{'their' if len(massless) > 1 else 'its'} weight is missing from the torques"
        )
    if report.strays:
        flattened = "were flattened" if report.differentiation.strengths.any() else "are left out of the peaks"
        unsure.append(f"samples {flattened} that are no noise")
    return Verdict.of(look_again=list(report.contradictions), over=stated, unsure=unsure)


def confidence(joints: int) -> float:
    """Standard deviations within which the peaks of that many joints lie, all together; () → ()."""
    from scipy.special import ndtri

    return float(ndtri(1.0 - _ERROR / max(1, joints)))


def _judge_torques(
    report: TorqueReport,
    excesses: dict[tuple[str, str], Excess],
    over: list[tuple[Excess, str]],
    unsure: list[str],
) -> None:
    limited = [j for j in report.joints if math.isfinite(j.limit)]
    factor = confidence(len(limited))
    explained = []
    for j in sorted(limited, key=lambda j: -j.share):
        reach, size = factor * report.reach(j), abs(j.likely)
        excess = excesses.get((j.joint, "effort"))
        if excess is not None and size - reach > j.limit:
            over.append((excess, _torque_in_words(report, j)))
        elif size + reach > j.limit and (reach > 0 or excess is not None):
            end = " at an end of the log" if report.at_an_end(j) else ""
            unsure.append(
                f"noise leaves open whether {j.joint} is over its limit{end}: {number(j.likely)} ± "
                f"{spread(report.reach(j))} {j.unit}, limit {j.limit:.4g}"
            )
        elif excess is not None:
            explained.append(j)
    if explained:
        shown = [
            f"{j.joint} {number(j.peak)} {j.unit} as derived, {number(j.likely)} ± {spread(report.reach(j))} without "
            f"noise, limit {j.limit:.4g}"
            for j in sorted(explained, key=lambda j: -abs(j.peak) / j.limit)[:_MOST_LISTED]
        ]
        more = len(explained) - len(shown)
        what = "samples that are no noise, or noise, explain" if report.strays else "noise explains"
        unsure.append(
            f"{what} why the limit of {len(explained)} joint{'s' if len(explained) > 1 else ''} is passed: "
            f"{'; '.join(shown)}{f'; and {more} more' if more else ''}"
        )


def _torque_in_words(report: TorqueReport, j: JointTorque) -> str:
    reach = report.reach(j)
    doubt = f" ± {spread(reach)}" if reach > NEGLIGIBLE * report.reference(j) else ""
    return (
        f"{j.joint} at t = {j.when:.3f} s takes {number(j.likely)}{doubt} {j.unit}, limit {j.limit:.4g} "
        f"({100 * j.share:.0f} %){because(j)}"
    )


def because(joint: JointTorque) -> str:
    """What the joint's peak is mostly made of; nothing where noise made the peak as derived another than the likely one."""
    if abs(joint.peak - joint.likely) > _OTHER * abs(joint.peak):
        return ""
    cause, share = joint.main_cause
    return f", mostly {cause_label(cause)} ({100 * share:.0f} %)"


def _judge_motion(report: TorqueReport, over: list[tuple[Excess, str]], unsure: list[str]) -> None:
    """Limits of position and velocity."""
    doubtful: dict[str, list[str]] = {}
    for e in report.excesses:
        if e.kind == "effort":
            continue
        if _is_noise(report, e):
            doubtful.setdefault(_KINDS[e.kind], []).append(e.joint)
        else:
            over.append((e, f"{e.joint} at t = {e.time:.3f} s passes its {_KINDS[e.kind]} limit"))
    for kind, joints in doubtful.items():
        unsure.append(f"noise explains why the {kind} limit of {_listed(joints)} is passed")


def _is_noise(report: TorqueReport, e: Excess) -> bool:
    d = report.differentiation if report.smoothed is None else report.smoothed
    places = d.model.velocity_names
    k = places.index(e.joint)
    if e.kind == "velocity":
        estimate = report.joints[k].estimate
        if estimate is None or not d.derives_velocities:
            return False
        return abs(estimate.speed) - _SURE * estimate.speed_sigma <= e.limit
    if not (d.derives and d.derives_velocities):
        return False  # the positions were not looked at
    body = next(b for b in d.model.leaders if b.v_index <= k < b.v_index + b.joint.nv)
    return abs(e.value - e.limit) <= _SURE * float(d.errors.at_rest[body.q_index])


def _grouped(over: list[tuple[Excess, str]]) -> list[str]:
    """The worst in full, and the others by name."""
    if not over:
        return []
    first, text = over[0]
    others: dict[str, list[str]] = {}
    for e, _ in over[1:]:
        kinds = others.setdefault(e.joint, [])
        if _KINDS[e.kind] not in kinds and (e.joint, _KINDS[e.kind]) != (first.joint, _KINDS[first.kind]):
            kinds.append(_KINDS[e.kind])
    rest = [f"{joint} ({', '.join(kinds)})" for joint, kinds in others.items() if kinds]
    return [text, *([f"also {_listed(rest)}"] if rest else [])]


def _listed(names: list[str] | tuple[str, ...]) -> str:
    shown = list(names[:_MOST_LISTED])
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")
