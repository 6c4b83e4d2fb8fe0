"""Verdict on the support of a robot along a motion: where it tips, slips or leaves the ground, and its margins."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.numbers import number, seconds
from ...core.text import Argument, Placeholder, listed, spell
from ...core.typing import Array
from ...core.verdict import Reason, Verdict
from ...motion.model_doubts import SHARE
from ...statics.contacts import contact_maps
from .ground import ASSUMED_FRICTION
from .ground_support import MAX_DETERMINATE_CONTACTS
from .slope import samples, slope

if TYPE_CHECKING:
    from .ground_support import GroundSupport

_MAX_STILL_VELOCITY = 1e-6
"""Velocity of a contact relative to the fastest below which it does not move."""
_FRICTION_STEP = 0.001
"""Least coefficient of friction that is stated, unless none is needed."""
_EQUAL_MARGINS = 1e-3
"""Difference of two margins in speed that counts as none."""
_MIN_SPEED_FACTOR = 0.005
"""Factor of the speed that counts as none."""
_MAX_LISTED = 4
"""Largest number of frames that a sentence names."""
_ROUND_OFF = 1e-6
"""Share of a step of rounding by which a number may exceed a step without the next one being stated."""


def support_verdict(found: GroundSupport) -> Verdict:
    """Verdict on the ground: OVER LIMIT where it certainly tips, slips or pulls off.

    UNSURE where its friction or its slope is unknown, and where noise of the log decides.
    """
    if found.ground_doubt:
        return Verdict.from_reasons(unsure=[found.ground_doubt])
    unsure = list(_doubts(found))
    failing = _judged_rows(found) & ~found.holds
    if not found.ground.given:  # then only failures that no friction prevents
        failing = failing & ~np.isfinite(found.friction)
    beyond_noise = failing if found.noise is None else failing & found.noise.certain
    over = []
    if beyond_noise.any():
        over.append(_failure(found, beyond_noise))
    elif failing.any():
        unsure.append(f"within the noise of the log it {_failure(found, failing)}")
    if not found.ground.given and not over and _needed_friction(found) > ASSUMED_FRICTION:
        unsure.append(_friction_question(found))
    if found.noise is not None and found.noise.hides and not failing.any():
        unsure.append(found.noise.words)
    return Verdict.from_reasons(over=over, unsure=unsure)


def _friction_question(found: GroundSupport) -> str:
    """Reason to be unsure on ground whose friction is not given: how much is needed, and when."""
    k = int(np.where(_judged_rows(found), found.friction, -1.0).argmax())
    stated = spell(Argument("contact_friction", Placeholder("VALUE")))
    need = _friction_text(_needed_friction(found))
    text = f"needs friction {need} at t = {seconds(float(found.time[k]))} s, and none is given"
    return Reason(text, stated)


def _doubts(found: GroundSupport) -> Iterator[str]:
    """Reasons to be unsure that do not depend on friction and noise."""
    if found.sliding is not None:
        frame, speed, time = found.sliding
        yield f"{frame} slides at {number(speed, 2)} m/s at t = {seconds(time)} s, where it should stand"
    if found.balancing.any():
        yield _balancing_doubt(found)
    in_flight = ~found.aground
    weight = found.robot.model.moving_mass * float(np.linalg.norm(found.robot.model.gravity))
    needed_force = float(found.need[in_flight].max(initial=0.0))
    if needed_force > SHARE * weight and found.sliding is None:
        yield f"no foot is down {_span_text(found.time, in_flight)}, and the base needs {number(needed_force, 3)} N there"
    undecided = int((found.aground & ~found.decided).sum())
    if undecided:
        yield f"rounding prevents an answer at {undecided} of {len(found.time)} instants"


def _balancing_doubt(found: GroundSupport) -> str:
    """Reason to be unsure of a robot whose contacts lie on one line."""
    contacts = np.flatnonzero(found.in_contact[found.balancing].any(axis=0))
    frames = sorted({found.ground.contacts[k].frame or "" for k in contacts})
    if len(frames) != len(found.contacts):
        return f"it can only balance {_span_text(found.time, found.balancing)}, on one line of contacts"
    sizes = spell(Argument("feet", Placeholder(f"LxW@{frames[0]}")))
    text = f"feet are points, so it can only balance: {listed(frames, _MAX_LISTED)}. Give the sizes of their soles"
    return Reason(f"{text} in metres, {sizes}", sizes)


def _span_text(time: Array, rows: Array) -> str:
    """Text of the first and last time of some rows."""
    times = time[rows]
    first, last = float(times[0]), float(times[-1])
    if first == last:
        return f"at t = {seconds(first)} s"
    return f"from t = {seconds(first)} to {seconds(last)} s"


def _needed_friction(found: GroundSupport) -> float:
    """Least coefficient of friction of the whole motion."""
    return float(found.friction[_judged_rows(found)].max(initial=0.0))


def _judged_rows(found: GroundSupport) -> Array:
    """Mask (n,) of instants at which the robot is on the ground, decided, and not only balancing."""
    return np.asarray(found.aground & found.decided & ~found.balancing)


def _friction_text(coefficient: float) -> str:
    """Two significant digits, rounded up, in steps of a thousandth at least."""
    if coefficient <= 0:
        return number(0.0)
    second_digit = 10.0 ** (math.floor(math.log10(coefficient)) - 1)
    step = max(second_digit, _FRICTION_STEP)
    steps = math.ceil(coefficient / step - _ROUND_OFF)
    return number(steps * step, 3)


def _failure(found: GroundSupport, rows: Array) -> str:
    """Sentence on the instant that sets the speed: how it fails, where, and what would hold."""
    k = _worst_instant(found, rows)
    words = _failure_words(found, k)
    remedies = []
    speed = float(found.speed[k])
    if math.isfinite(speed) and speed > _MIN_SPEED_FACTOR:
        remedies.append(f"up to {_margin_text(speed)} × this speed")
    mass_margin = float(found.payload[rows].min(initial=np.inf))
    excess_mass = -mass_margin
    if 0 < excess_mass <= found.case.payload_mass:
        remedies.append(f"with {_mass_text(excess_mass)} kg less")
    if not remedies:
        return words + _resting_pose_words(found, k)
    words += f". It stands {', or '.join(remedies)}"
    if _has_friction(found) and not found.ground.given:
        words += f" on ground of friction {number(ASSUMED_FRICTION)}"
    return words


def _worst_instant(found: GroundSupport, rows: Array) -> int:
    """Among some instants with the least margin in speed, the one that needs most friction.

    Instants without a margin come first, those that no friction holds before the others.
    """
    rank_without_margin = np.where(np.isfinite(found.friction), -1.0, -2.0)
    ranks = np.where(np.isnan(found.speed), rank_without_margin, found.speed)
    ranks = np.where(rows, ranks, np.inf)
    is_worst = ranks <= ranks.min() + _EQUAL_MARGINS
    return int(np.where(is_worst, found.friction, -1.0).argmax())


def _failure_words(found: GroundSupport, k: int) -> str:
    """Name, frames and time of the failure of an instant, and the friction that it needs."""
    how, frames = _failure_and_frames(found, k)
    time = f"at t = {seconds(float(found.time[k]))} s"
    place = f" at {listed(frames, _MAX_LISTED)}" if frames else ""
    if how == "slips":
        needed = float(found.friction[k])
        if not math.isfinite(needed):
            return f"slips{place} {time}"
        return f"slips{place} {time}: it needs friction {_friction_text(needed)}, given {_given_friction(found)}"
    if how == "pulls off":
        return f"{how}{place} {time}"
    if how == "tips" and frames:
        return f"{how} over {' and '.join(frames)} {time}"
    return f"{how} {time}"


def _resting_pose_words(found: GroundSupport, k: int) -> str:
    """Sentence on whether the robot stands at rest in the pose of an instant.

    Empty if the robot is at rest at this instant, or if rounding prevents an answer.
    """
    state = samples(found.states, slice(k, k + 1))
    if not (state.dq.any() or state.ddq.any()):
        return ""
    resting = replace(state, dq=np.zeros_like(state.dq), ddq=np.zeros_like(state.ddq))
    support = found.again(resting, found.contacts, found.in_contact[k : k + 1])
    if not support.decided[0]:
        return ""
    if support.holds[0]:
        return ". At rest it stands in this pose"
    return ". It does not stand in this pose at rest either"


def _given_friction(found: GroundSupport) -> str:
    """Text of the largest coefficient of friction of the contacts."""
    return number(float(found.ground.frictions.max()))


def _has_friction(found: GroundSupport) -> bool:
    """True if any contact carries friction."""
    return bool((found.ground.frictions > 0).any())


def _margin_text(value: float) -> str:
    """Three digits, rounded down."""
    if value <= 0:
        return number(0.0)
    third_digit = 10.0 ** (math.floor(math.log10(value)) - 2)
    steps = math.floor(value / third_digit * (1 + 1e-9))  # 1e-9: a whole number of steps stays whole
    return number(steps * third_digit, 3)


def _mass_text(mass: float) -> str:
    """Hundredths of a kilogram, rounded up."""
    return number(math.ceil(100 * mass - _ROUND_OFF) / 100, 4)


def _failure_and_frames(found: GroundSupport, k: int) -> tuple[str, list[str]]:
    """Name of the failure of an instant, and the frames about which it tips, that slip or that pull off."""
    if math.isfinite(float(found.friction[k])):
        how, motion = str(found.how[k]), found.motion[k]
    else:
        how, motion = _failure_without_slip(found, k)
    maps, _ = contact_maps(found.robot, found.states.q[k : k + 1], found.contacts)
    velocity = np.einsum("vck,v->ck", maps[0], motion)
    normals = found.ground.normals
    friction = found.ground.frictions
    active = found.in_contact[k]
    speeds = np.linalg.norm(velocity, axis=1)
    max_still = _MAX_STILL_VELOCITY * float(speeds[active].max(initial=0.0))
    rise = (velocity * normals).sum(axis=1)
    if how == "tips":
        involved = speeds <= max_still
    elif how == "slips":
        slide = np.linalg.norm(velocity - rise[:, None] * normals, axis=1)
        takes_power = rise - friction * slide < max_still  # a contact force whose friction opposes the slide
        involved = (slide > max_still) & takes_power
        with_friction = involved & active & (friction > 0)
        if with_friction.any():
            involved = with_friction
    else:
        involved = rise > max_still
    frames = [found.contacts[c].frame or "" for c in np.flatnonzero(active & involved)]
    return how, list(dict.fromkeys(frames))


def _failure_without_slip(found: GroundSupport, k: int) -> tuple[str, Array]:
    """Name of the failure of an instant that no friction holds, and its motion."""
    state = samples(found.states, slice(k, k + 1))
    support = found.again(state, found.ground.unlimited_contacts, found.in_contact[k : k + 1])
    return str(support.how[0]), support.motion[0]


def standing_words(found: GroundSupport) -> str:
    """Sentence on a robot that stands: the friction it needs, and how much faster or heavier it still stands.

    A robot at rest has no margin in speed; its zero moment point has one.
    """
    judged = _judged_rows(found)
    speed = float(found.speed[judged].min(initial=np.inf))
    payload = float(found.payload[judged].min(initial=np.inf))
    margins = []
    if math.isfinite(speed):
        noise = "" if found.noise is None else found.noise.interval_words(speed)
        margins.append(f"{_margin_text(speed)} × this speed{noise}")
    if math.isfinite(payload):
        margins.append(f"{_margin_text(payload)} kg more")
    words = _friction_words(found, f"stands{_slope_words(found)}", " or ".join(margins))
    zmp_margins = found.zmp_margin[judged & np.isfinite(found.zmp_margin)]
    if not math.isfinite(speed) and len(zmp_margins):
        margin = _margin_text(1e3 * float(zmp_margins.min()))
        words += f". Its zero moment point is {margin} mm inside its support"
    return words


def ground_words(found: GroundSupport) -> str:
    """Sentence of :func:`standing_words`, or the reasons why the robot does not stand, or may not."""
    verdict = support_verdict(found)
    if verdict.ok:
        return standing_words(found)
    return "; ".join(verdict.reasons)


def _friction_words(found: GroundSupport, stands: str, margins: str) -> str:
    """Sentence with the friction that is needed, and its source; margins follow where it is known."""
    need = _needed_friction(found)
    given = _given_friction(found)
    assumed = number(ASSUMED_FRICTION)
    before_margins = ", and holds"
    if not _has_friction(found):
        words = f"{stands}, without any friction"
    elif found.ground.given and found.strained and need == 0:
        words = f"{stands} with the friction given, {given}"
    elif found.ground.given:
        needed = f"friction {_friction_text(need)}" if need else "no friction"
        words = f"{stands}. It needs {needed} (given {given})"
        before_margins = " and holds"
    elif need > 0:
        words = f"{stands}, if the ground gives friction {_friction_text(need)}"
        before_margins = f". With {assumed} it holds"
    elif found.strained:
        words = f"{stands} on ground of friction {assumed}"
    else:
        words = f"{stands}, without any friction"
        before_margins = f". With friction {assumed} it holds"
    if margins:
        words += f"{before_margins} up to {margins}"
    return words


def _slope_words(found: GroundSupport) -> str:
    """End of a sentence with the angle of the slope; empty on level ground."""
    angle = slope(found.case)
    return f" on a slope of {number(math.degrees(angle), 3)}°" if angle else ""


def support_notes(found: GroundSupport) -> Iterator[str]:
    """Remark: what "stands" means with many contacts."""
    if int(found.in_contact.sum(axis=1).max(initial=0)) > MAX_DETERMINATE_CONTACTS:
        yield (
            "'Stands' means that some forces within the friction cones balance. How a stiff body shares its weight among more "
            "than three contacts depends on its stiffness: one foot may unload earlier without the body tipping."
        )
