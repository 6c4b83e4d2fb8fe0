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
"""Speed of a contact, as a share of the fastest contact's, up to which it does not move."""
_FRICTION_STEP = 0.001
"""Least coefficient of friction that is stated, unless none is needed."""
_EQUAL_MARGINS = 1e-3
"""Difference of two margins in speed that counts as none."""
_MIN_SPEED_FACTOR = 0.005
"""Factor of the speed up to which a slower motion is not offered as a remedy."""
_MAX_LISTED = 4
"""Largest number of frames that a sentence names."""
_ROUND_OFF = 1e-6
"""Excess over a whole number of steps, as a share of a step, up to which a number is not rounded up to the next step."""
_MILLI = 1e3
"""Factor of metres for millimetres."""


def support_verdict(found: GroundSupport) -> Verdict:
    """Verdict on the ground: OVER LIMIT where it certainly tips, slips or pulls off.

    UNSURE where its friction or its slope is unknown, and where noise of the log decides.
    """
    if found.ground_doubt:
        return Verdict.from_reasons(unsure=[found.ground_doubt])
    unsure = list(_doubts(found))
    fails = _judged_rows(found) & ~found.holds  # at each instant
    if not found.ground.given:  # then only failures that no friction prevents
        fails = fails & ~np.isfinite(found.friction)
    fails_beyond_noise = fails
    if found.noise is not None:
        fails_beyond_noise = fails & found.noise.certain
    over = []
    if fails_beyond_noise.any():
        over.append(_failure(found, fails_beyond_noise))
    elif fails.any():
        unsure.append(f"within the noise of the log it {_failure(found, fails)}")
    needs_more_friction = _needed_friction(found) > ASSUMED_FRICTION
    if needs_more_friction and not found.ground.given and not over:
        unsure.append(_friction_question(found))
    if found.noise is not None and found.noise.hides and not fails.any():
        unsure.append(found.noise.words)
    return Verdict.from_reasons(over=over, unsure=unsure)


def _friction_question(found: GroundSupport) -> str:
    """Reason to be unsure on ground whose friction is not given: how much is needed, and when."""
    friction_of_judged = np.where(_judged_rows(found), found.friction, -1.0)  # -1: less than any friction
    k = int(friction_of_judged.argmax())
    remedy = spell(Argument("contact_friction", Placeholder("VALUE")))
    needed = _friction_text(_needed_friction(found))
    text = f"needs friction {needed} at t = {seconds(float(found.time[k]))} s, and none is given"
    return Reason(text, remedy)


def _doubts(found: GroundSupport) -> Iterator[str]:
    """Reasons to be unsure that do not depend on friction and noise."""
    if found.sliding is not None:
        frame, speed, time = found.sliding
        yield f"{frame} slides at {number(speed, 2)} m/s at t = {seconds(time)} s, where it should stand"
    if found.balancing.any():
        yield _balancing_doubt(found)
    in_flight = ~found.aground
    model = found.robot.model
    weight = model.moving_mass * float(np.linalg.norm(model.gravity))
    needed_force = float(found.need[in_flight].max(initial=0.0))
    if needed_force > SHARE * weight and found.sliding is None:
        yield f"no foot is down {_span_text(found.time, in_flight)}, and the base needs {number(needed_force, 3)} N there"
    undecided = int((found.aground & ~found.decided).sum())
    if undecided:
        yield f"rounding prevents an answer at {undecided} of {len(found.time)} instants"


def _balancing_doubt(found: GroundSupport) -> str:
    """Reason to be unsure of a robot whose contacts lie on one line."""
    carries = found.in_contact[found.balancing].any(axis=0)  # of each contact
    frames = sorted({found.ground.contacts[k].frame or "" for k in np.flatnonzero(carries)})
    feet_are_points = len(frames) == len(found.contacts)  # each foot has one contact, and all of them carry
    if not feet_are_points:
        return f"it can only balance {_span_text(found.time, found.balancing)}, on one line of contacts"
    sizes = spell(Argument("feet", Placeholder(f"LxW@{frames[0]}")))
    text = f"feet are points, so it can only balance: {listed(frames, _MAX_LISTED)}. Give the sizes of their soles"
    return Reason(f"{text} in metres, {sizes}", sizes)


def _span_text(time: Array, rows: Array) -> str:
    """Text of the first and last time of the rows of a mask."""
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
    """Coefficient with two significant digits, rounded up, in steps of a thousandth at least."""
    if coefficient <= 0:
        return number(0.0)
    power_of_first_digit = math.floor(math.log10(coefficient))
    second_digit = 10.0 ** (power_of_first_digit - 1)
    step = max(second_digit, _FRICTION_STEP)
    steps = math.ceil(coefficient / step - _ROUND_OFF)
    return number(steps * step, 3)


def _failure(found: GroundSupport, rows: Array) -> str:
    """Sentence on the worst instant of a mask: how it fails, where, and the speed or payload at which it would hold."""
    k = _worst_instant(found, rows)
    words = _failure_words(found, k)
    remedies = []
    speed = float(found.speed[k])
    if math.isfinite(speed) and speed > _MIN_SPEED_FACTOR:
        remedies.append(f"up to {_margin_text(speed)} × this speed")
    mass_margin = float(found.payload[rows].min(initial=np.inf))  # kg more that hold, negative for less
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
    """Index of the instant with the least margin in speed; of several, the one that needs most friction.

    Instants without a margin rank below all margins, and those that no friction holds below these.
    """
    rank_without_margin = np.where(np.isfinite(found.friction), -1.0, -2.0)
    ranks_of_all = np.where(np.isnan(found.speed), rank_without_margin, found.speed)
    ranks = np.where(rows, ranks_of_all, np.inf)
    is_worst = ranks <= ranks.min() + _EQUAL_MARGINS
    friction_of_worst = np.where(is_worst, found.friction, -1.0)  # -1: less than any friction
    return int(friction_of_worst.argmax())


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
    instant = slice(k, k + 1)
    state = samples(found.states, instant)
    moves = state.dq.any() or state.ddq.any()
    if not moves:
        return ""
    resting_state = replace(state, dq=np.zeros_like(state.dq), ddq=np.zeros_like(state.ddq))
    resting_support = found.again(resting_state, found.contacts, found.in_contact[instant])
    if not resting_support.decided[0]:
        return ""
    if resting_support.holds[0]:
        return ". At rest it stands in this pose"
    return ". It does not stand in this pose at rest either"


def _given_friction(found: GroundSupport) -> str:
    """Text of the largest coefficient of friction of the contacts."""
    return number(float(found.ground.frictions.max()))


def _has_friction(found: GroundSupport) -> bool:
    """True if any contact carries friction."""
    return bool((found.ground.frictions > 0).any())


def _margin_text(value: float) -> str:
    """Margin with three significant digits, rounded down; 0 for a negative one."""
    if value <= 0:
        return number(0.0)
    power_of_first_digit = math.floor(math.log10(value))
    third_digit = 10.0 ** (power_of_first_digit - 2)
    steps = math.floor(value / third_digit * (1 + 1e-9))  # 1e-9: a whole number of steps stays whole
    return number(steps * third_digit, 3)


def _mass_text(mass: float) -> str:
    """Mass in hundredths of a kilogram, rounded up."""
    hundredths = math.ceil(100 * mass - _ROUND_OFF)
    return number(hundredths / 100, 4)


def _failure_and_frames(found: GroundSupport, k: int) -> tuple[str, list[str]]:
    """Name of the failure of an instant, and the frames about which it tips, that slip or that pull off."""
    if math.isfinite(float(found.friction[k])):
        how = str(found.how[k])
        motion = found.motion[k]
    else:
        how, motion = _failure_without_slip(found, k)
    maps, _ = contact_maps(found.robot, found.states.q[k : k + 1], found.contacts)
    velocities = np.einsum("vck,v->ck", maps[0], motion)  # of the contacts, (c, 3)
    normals = found.ground.normals
    friction = found.ground.frictions
    carries = found.in_contact[k]
    speeds = np.linalg.norm(velocities, axis=1)
    max_still_speed = _MAX_STILL_VELOCITY * float(speeds[carries].max(initial=0.0))
    rising_speeds = (velocities * normals).sum(axis=1)  # along the normals
    if how == "tips":
        fails = speeds <= max_still_speed  # the robot turns about contacts that stand
    elif how == "slips":
        sliding_speeds = np.linalg.norm(velocities - rising_speeds[:, None] * normals, axis=1)
        # a contact force whose friction opposes the slide takes power
        takes_power = rising_speeds - friction * sliding_speeds < max_still_speed
        fails = (sliding_speeds > max_still_speed) & takes_power
        fails_with_friction = fails & carries & (friction > 0)
        if fails_with_friction.any():
            fails = fails_with_friction
    else:
        fails = rising_speeds > max_still_speed
    frames = [found.contacts[c].frame or "" for c in np.flatnonzero(carries & fails)]
    return how, list(dict.fromkeys(frames))  # each frame once


def _failure_without_slip(found: GroundSupport, k: int) -> tuple[str, Array]:
    """Name of the failure of an instant with unlimited friction, and the motion (nv,) by which it fails."""
    instant = slice(k, k + 1)
    state = samples(found.states, instant)
    support = found.again(state, found.ground.unlimited_contacts, found.in_contact[instant])
    return str(support.how[0]), support.motion[0]


def standing_words(found: GroundSupport) -> str:
    """Sentence on a robot that stands: the friction it needs, and how much faster or heavier it still stands.

    A robot at rest has no margin in speed; its zero moment point has one.
    """
    is_judged = _judged_rows(found)
    speed_margin = float(found.speed[is_judged].min(initial=np.inf))
    mass_margin = float(found.payload[is_judged].min(initial=np.inf))
    margins = []
    if math.isfinite(speed_margin):
        noise_interval = "" if found.noise is None else found.noise.interval_words(speed_margin)
        margins.append(f"{_margin_text(speed_margin)} × this speed{noise_interval}")
    if math.isfinite(mass_margin):
        margins.append(f"{_margin_text(mass_margin)} kg more")
    beginning = f"stands{_slope_words(found)}"
    words = _friction_words(found, beginning, " or ".join(margins))
    zmp_margins = found.zmp_margin[is_judged & np.isfinite(found.zmp_margin)]  # [m]
    if not math.isfinite(speed_margin) and len(zmp_margins):
        least_margin = _MILLI * float(zmp_margins.min())  # [mm]
        words += f". Its zero moment point is {_margin_text(least_margin)} mm inside its support"
    return words


def ground_words(found: GroundSupport) -> str:
    """Sentence of :func:`standing_words` if the verdict is OK, else the reasons of the verdict."""
    verdict = support_verdict(found)
    if verdict.ok:
        return standing_words(found)
    return "; ".join(verdict.reasons)


def _friction_words(found: GroundSupport, beginning: str, margins: str) -> str:
    """Sentence with a beginning, then the friction that is needed, whether it is given or assumed, and the margins."""
    needed_friction = _needed_friction(found)
    given = _given_friction(found)
    assumed = number(ASSUMED_FRICTION)
    before_margins = ", and holds"
    if not _has_friction(found):
        words = f"{beginning}, without any friction"
    elif found.ground.given and found.strained and needed_friction == 0:
        words = f"{beginning} with the friction given, {given}"
    elif found.ground.given:
        needed = f"friction {_friction_text(needed_friction)}" if needed_friction else "no friction"
        words = f"{beginning}. It needs {needed} (given {given})"
        before_margins = " and holds"
    elif needed_friction > 0:
        words = f"{beginning}, if the ground gives friction {_friction_text(needed_friction)}"
        before_margins = f". With {assumed} it holds"
    elif found.strained:
        words = f"{beginning} on ground of friction {assumed}"
    else:
        words = f"{beginning}, without any friction"
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
    contact_counts = found.in_contact.sum(axis=1)
    if int(contact_counts.max(initial=0)) > MAX_DETERMINATE_CONTACTS:
        yield (
            "'Stands' means that some forces within the friction cones balance. How a stiff body shares its weight among more "
            "than three contacts depends on its stiffness: one foot may unload earlier without the body tipping."
        )
