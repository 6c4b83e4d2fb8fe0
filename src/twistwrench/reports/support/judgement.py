"""Verdict on the support of a robot along a motion: where it tips, slips or leaves the ground, and its margins."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.numbers import number, seconds
from ...core.text import Argument, Placeholder, listed, spell
from ...core.typing import Array
from ...core.verdict import Reason, Verdict
from ...motion.model_doubts import SHARE
from ...statics.contacts import contact_maps
from ...statics.support import Support, exceeding, friction_within, support
from ...statics.torque_limits import floating_entries
from .ground import ASSUMED, UNLIMITED, Ground
from .slope import ground_doubt, samples, slope
from .standing import StandingCase

if TYPE_CHECKING:
    from ...motion.differentiation import MotionSamples
    from ...motion.motion import Motion
    from ...robot import Robot
    from ...statics.contacts import Contact
    from .noise import SupportNoise

_ROWS = 4096
"""States of one batch."""
_STILL = 1e-6
"""Velocity of a contact relative to the fastest below which it does not move."""
_SLIDING = 0.1
"""Speed of a foot on the ground that should stand [m/s]."""
_PLANE = 0.01
"""Height above the floor up to which a foot is on it [m]."""
_FINEST = 0.001
"""Least coefficient of friction that is stated, unless none is needed."""
_ALIKE = 1e-3
"""Difference of two margins in speed that counts as none."""
_SLOWEST = 0.005
"""Factor of the speed that counts as none."""
_FEW = 3
"""Contacts whose forces follow from the balance alone."""
_LISTED = 4


@dataclass(frozen=True, eq=False, repr=False)
class GroundSupport(Support):
    """Support of a robot by the ground along a motion, with the times and the contacts that carry."""

    in_contact: Array = field(kw_only=True)
    """(n, c) of bool: contacts that carry."""
    case: StandingCase = field(kw_only=True)
    """Robot with its payloads and its ground."""
    states: Motion = field(kw_only=True)
    """States of the motion."""
    need: Array = field(kw_only=True)
    """(n,): force that the base needs [N]."""
    sliding: tuple[str, float, float] | None = field(kw_only=True)
    """Foot on the ground that moves although none else carries, with its speed [m/s] and time [s]."""
    strained: bool = field(kw_only=True)
    """True if torques exceed their limits at some instant, whatever forces within the cones are chosen."""
    noise: SupportNoise | None = field(kw_only=True, default=None)
    """Effect of the log's noise; None if its accelerations have none."""

    @property
    def ground(self) -> Ground:
        """Contacts, and the rule by which they carry."""
        return self.case.ground

    @property
    def robot(self) -> Robot:
        """Robot with its payloads."""
        return self.case.with_load

    @property
    def time(self) -> Array:
        """(n,) [s]."""
        return self.states.time

    def again(self, s: MotionSamples, contacts: tuple[Contact, ...], in_contact: Array) -> Support:
        """Support of other states, or on other contacts, of the same robot with its loads."""
        return _support(self.case, s, contacts, in_contact)

    def failing_motions(self, s: MotionSamples, rows: Array) -> tuple[Array, Array]:
        """Motions (k, nv) that prove that some states fail, and their power; on unlimited ground if none is given."""
        if self.ground.given:
            return self.motion[rows], self.power[rows]
        found = self.again(s, self.ground.unlimited, self.in_contact[rows])
        return np.nan_to_num(found.motion), np.nan_to_num(found.power)

    @cached_property
    def ground_doubt(self) -> str:
        """Reason why the ground is not as assumed; empty if it fits."""
        return ground_doubt(self.case, self.states, self.in_contact, self.aground & ~self.holds)

    @property
    def aground(self) -> Array:
        """(n,) of bool: instants with a contact that carries."""
        return np.asarray(self.in_contact.any(axis=1))

    @property
    def balanced(self) -> Array:
        """(n,) of bool: instants at which forces balance, with any friction if none is given."""
        return self.holds if self.ground.given else self.aground & np.isfinite(self.friction)

    @cached_property
    def balanced_forces(self) -> Array:
        """(n, c, 3): ``forces``, and at instants that need more friction than is assumed those on such ground [N]."""
        found = self.forces.copy()
        more = np.flatnonzero(self.balanced & ~self.holds)
        for start in range(0, len(more), _ROWS):
            rows = more[start : start + _ROWS]
            found[rows] = self.case.contact(samples(self.states, rows))[0].forces
        return found

    @cached_property
    def balancing(self) -> Array:
        """(n,) of bool: instants whose contacts lie on one line, so that the robot can only balance."""
        _, points = contact_maps(self.robot, self.states.q, self.contacts)
        found = np.zeros(len(self.time), bool)
        for k in np.flatnonzero(self.aground & ~self.holds):
            mine = points[k, self.in_contact[k]]
            widths = np.linalg.svd(mine - mine.mean(axis=0), compute_uv=False)
            found[k] = len(mine) < _FEW or widths[1] < 1e-3 * max(1e-3, widths[0])
        return found


def ground_support(load: StandingCase, motion: Motion) -> GroundSupport:
    """Support along the states of a motion."""
    parts, active, needs, strained = [], [], [], False
    for start in range(0, len(motion), _ROWS):
        s = samples(motion, slice(start, start + _ROWS))
        carrying = load.ground.carrying(load.robot, s)
        part = _support(load, s, load.ground.contacts, carrying)
        if load.effort is not None:
            part, beyond = _within_limits(load, s, part, carrying, load.effort)
            strained |= beyond
        parts.append(part)
        active.append(carrying)
        needs.append(np.linalg.norm(load.torques_in_the_air(s)[:, _base(load.robot)[3:]], axis=1))
    joined: dict[str, Any] = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts])
        for f in fields(Support)
        if f.name != "contacts"
    }
    in_contact = np.concatenate(active)
    sliding = _sliding_foot(load, motion, in_contact)
    return GroundSupport(
        **joined, contacts=load.ground.contacts, in_contact=in_contact, case=load, states=motion, need=np.concatenate(needs),
        sliding=sliding, strained=strained,
    )  # fmt: skip


def _within_limits(
    load: StandingCase, s: MotionSamples, part: Support, carrying: Array, limits: Array
) -> tuple[Support, bool]:
    """Support whose friction keeps the torque limits (nv,) too, and True if they are exceeded whatever friction there is."""
    robot, effort = load.with_load, np.where(floating_entries(load.robot), np.inf, limits)
    tau = load.torques_in_the_air(s)
    most = max(c.friction for c in load.ground.contacts) if load.ground.given else UNLIMITED
    friction = part.friction.copy()
    rows = np.flatnonzero(part.holds if load.ground.given else np.isfinite(friction) & carrying.any(axis=1))
    if len(rows):
        friction[rows] = friction_within(
            robot, s.q[rows], tau[rows], load.ground.contacts, carrying[rows], friction[rows], effort, most
        )
    torques = part.torques
    if not load.ground.given:
        forces, _ = load.contact(s)
        torques = tau - np.einsum("nvck,nck->nv", forces.maps, forces.forces)
        torques = np.where(forces.holds[:, None], torques, np.nan)
    return replace(part, friction=friction), bool(exceeding(torques, effort).any())


def _base(robot: Robot) -> Array:
    return np.flatnonzero(floating_entries(robot))


def _support(load: StandingCase, s: MotionSamples, contacts: tuple[Contact, ...], carrying: Array) -> Support:
    payload = load.payloads[0] if load.payload_mass else None
    tip = load.robot.model.tip
    frame = tip if payload is None else payload.frame or tip
    return support(
        load.with_load, s.q, s.dq, s.ddq, contacts, in_contact=carrying, wrench_on_robot=load.wrenches_on(s),
        payload_frame=None if frame in load.ground.frames else frame,
        payload_com=(0.0, 0.0, 0.0) if payload is None else payload.place, limits=load.effort,
    )  # fmt: skip


def _sliding_foot(load: StandingCase, motion: Motion, in_contact: Array) -> tuple[str, float, float] | None:
    """Foot on the floor that moves although no other carries: its speed and time at the fastest."""
    alone = np.flatnonzero(~in_contact.any(axis=1))
    if not len(alone):
        return None
    up, contacts = load.ground.normal, load.ground.contacts
    floor = min(
        float((contact_maps(load.robot, motion.q[k : k + _ROWS], contacts)[1] @ up).min())
        for k in range(0, len(motion), _ROWS)
    )
    maps, points = contact_maps(load.robot, motion.q[alone], contacts)
    speeds = np.linalg.norm(np.einsum("nvck,nv->nck", maps, motion.dq[alone]), axis=-1)
    on_floor = np.where(points @ up <= floor + _PLANE, speeds, 0.0)
    row, contact = np.unravel_index(int(on_floor.argmax()), on_floor.shape)
    speed = float(on_floor[row, contact])
    return (str(contacts[contact].frame), speed, float(motion.time[alone[row]])) if speed > _SLIDING else None


# ── The verdict


def support_verdict(found: GroundSupport) -> Verdict:
    """Verdict on the ground: OVER LIMIT where it certainly tips, slips or pulls off.

    UNSURE where its friction or its slope is unknown, and where noise of the log decides.
    """
    if found.ground_doubt:
        return Verdict.from_reasons(unsure=[found.ground_doubt])
    unsure = list(_doubts(found))
    failing = found.aground & found.decided & ~found.holds & ~found.balancing
    certain = failing if found.ground.given else failing & ~np.isfinite(found.friction)
    beyond = certain if found.noise is None else certain & found.noise.certain
    over = [_failure(found, beyond)] if beyond.any() else []
    if certain.any() and not over:
        unsure.append(f"within the noise of the log it {_failure(found, certain)}")
    if not found.ground.given and not over and (need := _need(found)) > ASSUMED:
        k = _row_of_need(found)
        stated = spell(Argument("contact_friction", Placeholder("VALUE")))
        text = f"needs friction {_rounded_up(need)} at t = {seconds(float(found.time[k]))} s, and none is given"
        unsure.append(Reason(text, stated))
    if found.noise is not None and found.noise.hides and not certain.any():
        unsure.append(found.noise.words)
    return Verdict.from_reasons(over=over, unsure=unsure)


def _doubts(found: GroundSupport) -> Iterator[str]:
    if found.sliding is not None:
        frame, speed, time = found.sliding
        yield f"{frame} slides at {number(speed, 2)} m/s at t = {seconds(time)} s, where it should stand"
    balancing = found.balancing
    if balancing.any():
        frames = sorted(
            {found.ground.contacts[k].frame or "" for k in np.flatnonzero(found.in_contact[balancing].any(axis=0))}
        )
        if len(frames) == len(found.contacts):
            sizes = spell(Argument("feet", Placeholder(f"LxW@{frames[0]}")))
            text = f"feet are points, so it can only balance: {listed(frames, _LISTED)}. Give the sizes of their soles"
            yield Reason(f"{text} in metres, {sizes}", sizes)
        else:
            yield f"it can only balance {_span(found.time, balancing)}, on one line of contacts"
    flight = ~found.aground
    weight = found.robot.model.moving_mass * float(np.linalg.norm(found.robot.model.gravity))
    needed = float(found.need[flight].max(initial=0.0))
    if needed > SHARE * weight and found.sliding is None:
        yield f"no foot is down {_span(found.time, flight)}, and the base needs {number(needed, 3)} N there"
    if (undecided := int((found.aground & ~found.decided).sum())) > 0:
        yield f"rounding prevents an answer at {undecided} of {len(found.time)} instants"


def _span(time: Array, rows: Array) -> str:
    which = np.flatnonzero(rows)
    first, last = float(time[which[0]]), float(time[which[-1]])
    return f"at t = {seconds(first)} s" if first == last else f"from t = {seconds(first)} to {seconds(last)} s"


def _need(found: GroundSupport) -> float:
    """Least coefficient of friction of the whole motion."""
    return float(found.friction[_judged(found)].max(initial=0.0))


def _judged(found: GroundSupport) -> Array:
    return np.asarray(found.aground & found.decided & ~found.balancing)


def _row_of_need(found: GroundSupport) -> int:
    return int(np.where(_judged(found), found.friction, -1.0).argmax())


def _rounded_up(coefficient: float) -> str:
    """Two significant digits, rounded up, in steps of a thousandth at least."""
    if coefficient <= 0:
        return number(0.0)
    unit = max(10.0 ** (math.floor(math.log10(coefficient)) - 1), _FINEST)
    return number(math.ceil(coefficient / unit - 1e-6) * unit, 3)


def _failure(found: GroundSupport, rows: Array) -> str:
    """Sentence on the instant that sets the speed: how it fails, where, and what would hold."""
    speeds = np.where(np.isnan(found.speed), np.where(np.isfinite(found.friction), -1.0, -2.0), found.speed)
    speeds = np.where(rows, speeds, np.inf)
    least = speeds <= speeds.min() + _ALIKE
    k = int(np.where(least, found.friction, -1.0).argmax())
    how, frames = _how(found, k)
    time = seconds(float(found.time[k]))
    if how == "slips":
        needed = float(found.friction[k])
        need = f": it needs friction {_rounded_up(needed)}, given {_given(found)}" if math.isfinite(needed) else ""
        words = f"slips{_at(frames)} at t = {time} s{need}"
    else:
        over = (
            f" over {' and '.join(frames)}" if frames and how == "tips" else _at(frames) if how == "pulls off" else ""
        )
        words = f"{how}{over} at t = {time} s"
    speed = float(found.speed[k])
    less = -float(found.payload[rows].min(initial=np.inf))
    remedies = [f"up to {_down(speed)} × this speed"] if math.isfinite(speed) and speed > _SLOWEST else []
    remedies += [f"with {_more(less)} kg less"] if 0 < less <= found.case.payload_mass else []
    if remedies:
        assumed = "" if found.ground.given or not _rubs(found) else f" on ground of friction {number(ASSUMED)}"
        return f"{words}. It stands {', or '.join(remedies)}{assumed}"
    return words + _at_rest(found, k)


def _at_rest(found: GroundSupport, k: int) -> str:
    """Sentence on the pose of an instant at rest, as an answer has shown it; empty if the robot is at rest, or undecided."""
    s = samples(found.states, slice(k, k + 1))
    if not (s.dq.any() or s.ddq.any()):
        return ""
    still = replace(s, dq=np.zeros_like(s.dq), ddq=np.zeros_like(s.ddq))
    again = found.again(still, found.contacts, found.in_contact[k : k + 1])
    if not again.decided[0]:
        return ""
    return ". At rest it stands in this pose" if again.holds[0] else ". It does not stand in this pose at rest either"


def _given(found: GroundSupport) -> str:
    return number(max(c.friction for c in found.contacts))


def _rubs(found: GroundSupport) -> bool:
    """True if any contact carries friction."""
    return any(c.friction > 0 for c in found.contacts)


def _at(frames: Sequence[str]) -> str:
    return f" at {listed(frames, _LISTED)}" if frames else ""


def _down(value: float) -> str:
    """Three digits, rounded down."""
    if value <= 0:
        return number(0.0)
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return number(math.floor(value / unit * (1 + 1e-9)) * unit, 3)


def _more(mass: float) -> str:
    return number(math.ceil(100 * mass - 1e-6) / 100, 4)


def _how(found: GroundSupport, k: int) -> tuple[str, list[str]]:
    """Name of the failure of an instant, and the frames about which it tips, that slip or that pull off."""
    how, motion = str(found.how[k]), found.motion[k]
    if not math.isfinite(float(found.friction[k])):
        how, motion = _on_unlimited_ground(found, k)
    maps, _ = contact_maps(found.robot, found.states.q[k : k + 1], found.contacts)
    velocity = np.einsum("vck,v->ck", maps[0], motion)
    normals = np.array([c.normal for c in found.contacts])
    active = found.in_contact[k]
    speeds = np.linalg.norm(velocity, axis=1)
    small = _STILL * float(speeds[active].max(initial=0.0))
    rise = (velocity * normals).sum(axis=1)
    slide = np.linalg.norm(velocity - rise[:, None] * normals, axis=1)
    friction = np.array([c.friction for c in found.contacts])
    slips = (slide > small) & (rise - friction * slide < small)
    rubs = slips & active & (friction > 0)
    chosen = {"tips": speeds <= small, "slips": rubs if rubs.any() else slips}.get(how, rise > small)
    frames = [found.contacts[c].frame or "" for c in np.flatnonzero(active & chosen)]
    return how, list(dict.fromkeys(frames))


def _on_unlimited_ground(found: GroundSupport, k: int) -> tuple[str, Array]:
    """Name of the failure of an instant that no friction holds, and its motion."""
    s = samples(found.states, slice(k, k + 1))
    again = found.again(s, found.ground.unlimited, found.in_contact[k : k + 1])
    return str(again.how[0]), again.motion[0]


# ── What an answer says of a robot that stands


def standing_words(found: GroundSupport) -> str:
    """Sentence on a robot that stands: the friction it needs, and how much faster or heavier it still stands.

    A robot at rest has no margin in speed; its zero moment point has one.
    """
    judged = _judged(found)
    speed = float(found.speed[judged].min(initial=np.inf))
    payload = float(found.payload[judged].min(initial=np.inf))
    noise = "" if found.noise is None else found.noise.interval_words(speed)
    margins = [f"{_down(speed)} × this speed{noise}"] if math.isfinite(speed) else []
    margins += [f"{_down(payload)} kg more"] if math.isfinite(payload) else []
    upto = f" up to {' or '.join(margins)}" if margins else ""
    inside = found.zmp_margin[judged & np.isfinite(found.zmp_margin)]
    rests = not math.isfinite(speed) and len(inside)
    edge = f". Its zero moment point is {_down(1e3 * float(inside.min()))} mm inside its support" if rests else ""
    return _friction_words(found, f"stands{_sloping(found)}", upto) + edge


def ground_words(found: GroundSupport) -> str:
    """Sentence of :func:`standing_words`, or the reasons why the robot does not stand, or may not."""
    verdict = support_verdict(found)
    return standing_words(found) if verdict.ok else "; ".join(verdict.reasons)


def _friction_words(found: GroundSupport, stands: str, upto: str) -> str:
    """Sentence with the friction that is needed, and its source; margins follow where it is known."""
    need, given = _need(found), _given(found)
    if not _rubs(found):
        return f"{stands}, without any friction" + (f", and holds{upto}" if upto else "")
    if found.ground.given:
        if found.strained and need == 0:
            return f"{stands} with the friction given, {given}" + (f", and holds{upto}" if upto else "")
        needs = f"friction {_rounded_up(need)}" if need else "no friction"
        return f"{stands}. It needs {needs} (given {given})" + (f" and holds{upto}" if upto else "")
    if need > 0:
        return f"{stands}, if the ground gives friction {_rounded_up(need)}" + (
            f". With {number(ASSUMED)} it holds{upto}" if upto else ""
        )
    if found.strained:
        return f"{stands} on ground of friction {number(ASSUMED)}" + (f", and holds{upto}" if upto else "")
    return f"{stands}, without any friction" + (f". With friction {number(ASSUMED)} it holds{upto}" if upto else "")


def _sloping(found: GroundSupport) -> str:
    angle = slope(found.case)
    return f" on a slope of {number(math.degrees(angle), 3)}°" if angle else ""


def support_notes(found: GroundSupport) -> Iterator[str]:
    """Remark: what "stands" means with many contacts."""
    if int(found.in_contact.sum(axis=1).max(initial=0)) > _FEW:
        yield (
            "'Stands' means that some forces within the friction cones balance. How a stiff body shares its weight among more "
            "than three contacts depends on its stiffness: one foot may unload earlier without the body tipping."
        )
