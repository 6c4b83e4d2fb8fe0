"""Remarks of the torque report on the log, that bear on how far its figures can be trusted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...core.printed_numbers import deviation, number, percent, seconds
from ...joints.units import unit_of
from ...listing import listed
from ...model.model import BASE
from ...motion.coordinates import Coordinates
from ...report.limit_doubts import TEMPLATE, unlimited
from ...report.torque_findings import NEGLIGIBLE, TorqueReport
from ...verdict import Word

_NOISY = 0.02
"""Share of a peak from which what is not known of it is a reason to log better."""
_MOST_LISTED = 4


def notes(report: TorqueReport) -> Iterator[str]:
    """Remarks on the log that bear on how far the figures can be trusted, a sentence or two each."""
    d, q = report.differentiation, report.quality
    derived = {"positions": "accelerations", "velocities": "accelerations (from the velocity columns)", "given": ""}[
        d.source
    ]
    what = " and ".join(x for x in ("velocities" if d.derives_velocities else "", derived) if x)
    if what:
        smoothed = ", after smoothing to the noise found" if d.smooths else ""
        yield f"The file has no {what.split(' (')[0]}: derived by a quintic spline{smoothed}."
        yield from _quality_notes(report)
    if report.gaps.count:
        times = "time" if report.gaps.count == 1 else "times"
        yield (
            f"Time jumps {report.gaps.count} {times} by more than {number(report.gaps.threshold / q.step)} usual steps; "
            f"the longest gap is {number(report.gaps.longest)} s, after t = {seconds(report.gaps.longest_at, 4)} s."
            + (" Derived rates near gaps are guesses." if d.derives else "")
        )
    floating = {b.joint.name for b in report.load.bare.model.bodies if not b.joint.driven}
    if floating:
        yield f"Nothing drives {', '.join(floating)}: its rows are the wrench that contacts would have to give."
    model = report.load.loaded.model
    missing = unlimited(model, report.limits.effort, [j.peak for j in report.joints])
    if missing and report.verdict.word is not Word.UNSURE:  # where it is among the reasons
        yield f"No torque limit is known for {listed(missing)}: {TEMPLATE}."
    if resting := [
        f"{p.frame or report.load.bare.model.tip}"
        for p in report.load.payloads
        if report.load.bare.model.frame(p.frame or report.load.bare.model.tip).body == BASE
    ]:
        yield f"The payload at {', '.join(resting)} rests on the fixed base and loads no joint."
    if report.idle_payload:
        yield (
            "What is carried makes no torque in any joint: its place stays on their axes. Say where it is, in metres from its "
            "frame: --payload MASS,x,y,z@FRAME."
        )
    yield from _friction_notes(report)
    yield from _measured_notes(report)
    yield from _stray_notes(report)
    yield from _column_notes(report)


def _friction_notes(report: TorqueReport) -> Iterator[str]:
    friction = report.load.bare.model.friction.static
    found = [
        f"{j.joint} (±{number(friction[k])} {j.unit}, {percent(report.still[k], 3)} of the rows)"
        for k, j in enumerate(report.joints)
        if friction[k] > 0 and report.still[k] > 0
    ]
    if found and report.load.friction:
        yield (
            "Coulomb friction is undetermined for joints at rest within the noise of their derived velocities, and "
            f"left out there: {', '.join(found)}."
        )


def _measured_notes(report: TorqueReport) -> Iterator[str]:
    if differ := [m.joint for m in report.measured if m.disagrees]:
        yield (
            f"The file's own torques are grossly different from those computed for {', '.join(differ)}: friction or load that "
            "the model lacks, another robot, or another unit."
        )
    if hidden := [m.joint for m in report.measured if m.differs and not m.disagrees]:
        yield (
            f"The file's own torques are grossly different from those computed for {', '.join(hidden)}, as noise of the log "
            "may explain: trust the file's own."
        )
    if dead := [m.joint for m in report.measured if m.dead]:
        yield f"The torque column never changes, and is not compared, for {', '.join(dead)}."


def _stray_notes(report: TorqueReport) -> Iterator[str]:
    d = report.differentiation
    shown = []
    for s in report.strays[:_MOST_LISTED]:
        place = int(d.places[s.column])
        size = s.off / d.trajectory.columns.factors["dq" if d.source == "velocities" else "q"][s.column]
        count = f", {s.count} samples, the farthest" if s.count > 1 else ""
        shown.append(
            f"{d.trajectory.columns.header[place]}{count} at t = {seconds(s.time, 4)} s off by {number(size)} "
            f"({number(abs(s.sigmas), 2)} σ)"
        )
    if shown:
        more = f"; and {len(report.strays) - len(shown)} columns more" if len(report.strays) > len(shown) else ""
        yield (
            f"WARNING: smoothing flattened samples that noise does not explain: {'; '.join(shown)}{more}, in the file's "
            "unit. If the robot did move so, the torques there are far too low; if the log is wrong, remove the samples."
        )


def _column_notes(report: TorqueReport) -> Iterator[str]:
    yield from report.differentiation.trajectory.notes


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
    unit = unit_of("ddq", bool(Coordinates.of(d.model).angular_velocity[derived.sigma_ddq.argmax()]))
    loudest = max(report.joints, key=lambda j: j.noise)
    late = d.errors.stamp
    stamps = (
        f", and stamps that are off by {number(1e3 * np.median(late[late > 0]), 2)} ms"
        if _stamps_matter(report)
        else ""
    )
    yield (
        f"The log has noise of {number(q.noise[worst], 2)} (1 σ, {d.trajectory.columns.header[d.places[worst]]}, "
        f"in the file's unit{grid}){stamps}. {'As it is, it' if report.derived else 'Smoothed, it still'} makes accelerations "
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
            f"The peak of {', '.join(ends)} lies at an end of the log, where derived accelerations are several times "
            "as uncertain, for want of neighbours. Log a little more before and after."
        )
    if any(report.reach(j) > _NOISY * report.reference(j) for j in report.joints):
        yield (
            f"Noise leaves more than {percent(_NOISY)} of a peak unknown. Log velocities and accelerations as well, if the "
            "controller has them, or more slowly changing motions."
        )


def _stamps_matter(report: TorqueReport) -> bool:
    """Whether most columns that move show that stamps are off, by more than their noise."""
    errors = report.differentiation.errors
    moving = report.quality.noise > 0
    shows = errors.stamp > 0
    return bool(moving.any() and (shows & moving).sum() > 0.5 * moving.sum())
