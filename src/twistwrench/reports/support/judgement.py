"""Verdict on the support of a robot along a motion: where it tips, slips or leaves the ground, and its margins."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np

from ...core.numbers import number, seconds
from ...core.text import listed
from ...core.typing import Array
from ...core.verdict import Verdict
from ...motion.model_doubts import SHARE
from ...statics.contacts import contact_maps
from ...statics.feet import upward
from ...statics.support import Support, support
from ...statics.torque_limits import floating_entries
from .ground import ASSUMED, Ground
from .standing import StandingCase

if TYPE_CHECKING:
    from ...motion.differentiation import MotionSamples
    from ...motion.motion import Motion
    from ...robot import Robot
    from ...statics.contacts import Contact

_ROWS = 4096
"""States of one batch."""
_STILL = 1e-6
"""Velocity of a contact relative to the fastest below which it does not move."""
_SLIDING = 0.1
"""Speed of a foot on the ground that should stand [m/s]."""
_PLANE = 0.01
"""Distance from one plane above which contacts are remarked [m]."""
_NONE = 0.005
"""Coefficient of friction that counts as none."""
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

    @property
    def aground(self) -> Array:
        """(n,) of bool: instants with a contact that carries."""
        return np.asarray(self.in_contact.any(axis=1))

    @property
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
    parts, active, needs = [], [], []
    for start in range(0, len(motion), _ROWS):
        s = _states(motion, slice(start, start + _ROWS))
        carrying = load.ground.carrying(load.robot, s)
        parts.append(_support(load, s, load.ground.contacts, carrying))
        active.append(carrying)
        needs.append(np.linalg.norm(load.torques_in_the_air(s)[:, _base(load.robot)[3:]], axis=1))
    joined = {
        f.name: np.concatenate([getattr(part, f.name) for part in parts])
        for f in fields(Support)
        if f.name != "contacts"
    }
    in_contact = np.concatenate(active)
    sliding = _sliding_foot(load, motion, in_contact)
    return GroundSupport(
        **joined, contacts=load.ground.contacts, in_contact=in_contact, case=load, states=motion, need=np.concatenate(needs),
        sliding=sliding,
    )  # fmt: skip


def _base(robot: Robot) -> Array:
    return np.flatnonzero(floating_entries(robot))


def _support(load: StandingCase, s: MotionSamples, contacts: tuple[Contact, ...], carrying: Array) -> Support:
    payload = load.payloads[0] if load.payload_mass else None
    tip = load.robot.model.tip
    frame = tip if payload is None else payload.frame or tip
    return support(
        load.with_load, s.q, s.dq, s.ddq, contacts, in_contact=carrying, wrench_on_robot=load.wrenches_on(s),
        payload_frame=None if frame in load.ground.frames else frame,
        payload_com=(0.0, 0.0, 0.0) if payload is None else payload.place,
    )  # fmt: skip


def _states(motion: Motion, rows: slice) -> MotionSamples:
    from ...motion.differentiation import MotionSamples

    time, q, dq, ddq = (getattr(motion, name)[rows] for name in ("time", "q", "dq", "ddq"))
    return MotionSamples(time, q, dq, ddq, q, np.zeros(dq.shape, bool), np.zeros((len(time), 0)))


def _sliding_foot(load: StandingCase, motion: Motion, in_contact: Array) -> tuple[str, float, float] | None:
    """Foot on the floor that moves although no other carries: its speed and time at the fastest."""
    alone = np.flatnonzero(~in_contact.any(axis=1))
    if not len(alone):
        return None
    up, contacts = upward(load.robot), load.ground.contacts
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
    """Verdict on the ground: OVER LIMIT where it certainly tips, slips or pulls off, UNSURE where its friction is unknown."""
    unsure = list(_doubts(found))
    failing = found.aground & found.decided & ~found.holds & ~found.balancing
    certain = failing if found.ground.given else failing & ~np.isfinite(found.friction)
    over = [_failure(found, certain)] if certain.any() else []
    if not found.ground.given and not over and (need := _need(found)) > ASSUMED:
        k = _row_of_need(found)
        unsure.append(f"needs friction {_upward(need)} at t = {seconds(float(found.time[k]))} s, and none is given")
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
            yield (
                f"feet are points, so it can only balance: {listed(frames, _LISTED)}. Give the sizes of their soles, "
                "feet=LxW@FRAME"
            )
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


def _upward(coefficient: float) -> str:
    """Two digits, rounded up."""
    return number(math.ceil(100 * coefficient - 1e-6) / 100, 3)


def _failure(found: GroundSupport, rows: Array) -> str:
    """Sentence on the instant that sets the speed: how it fails, where, and what would hold."""
    speeds = np.where(np.isnan(found.speed), np.where(np.isfinite(found.friction), -1.0, -2.0), found.speed)
    k = int(np.where(rows, speeds, np.inf).argmin())
    how, frames = _how(found, k)
    time = seconds(float(found.time[k]))
    if how == "slips":
        given = max(c.friction for c in found.contacts)
        needed = float(found.friction[k])
        need = f": it needs friction {_upward(needed)}, given {number(given)}" if math.isfinite(needed) else ""
        words = f"slips{_at(frames)} at t = {time} s{need}"
    else:
        over = (
            f" over {' and '.join(frames)}" if frames and how == "tips" else _at(frames) if how == "pulls off" else ""
        )
        words = f"{how}{over} at t = {time} s"
    speed = float(found.speed[k])
    less = -float(found.payload[rows].min(initial=np.inf))
    remedies = [f"up to {_down(speed)} × this speed"] if math.isfinite(speed) else []
    remedies += [f"with {_more(less)} kg less"] if 0 < less <= found.case.payload_mass else []
    if not remedies:
        return f"{words}. It does not stand in this pose at rest either"
    return f"{words}. It stands {', or '.join(remedies)}"


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
    chosen = {
        "tips": speeds <= small,
        "slips": (slide > small) & (rise - np.array([c.friction for c in found.contacts]) * slide < small),
    }.get(how, rise > small)
    frames = [found.contacts[c].frame or "" for c in np.flatnonzero(active & chosen)]
    return how, list(dict.fromkeys(frames))


def _on_unlimited_ground(found: GroundSupport, k: int) -> tuple[str, Array]:
    """Name of the failure of an instant that no friction holds, and its motion."""
    s = _states(found.states, slice(k, k + 1))
    again = _support(found.case, s, found.ground.unlimited, found.in_contact[k : k + 1])
    return str(again.how[0]), again.motion[0]


# ── What an answer says of a robot that stands


def standing_words(found: GroundSupport) -> str:
    """Sentence on a robot that stands: the friction it needs, and how much faster or heavier it still stands."""
    judged = _judged(found)
    need, speed = _need(found), float(found.speed[judged].min(initial=np.inf))
    payload = float(found.payload[judged].min(initial=np.inf))
    margins = [f"{_down(speed)} × this speed"] if math.isfinite(speed) else []
    margins += [f"{_down(payload)} kg more"] if math.isfinite(payload) else []
    upto = f" up to {' or '.join(margins)}" if margins else ""
    if found.ground.given:
        given = number(max(c.friction for c in found.contacts))
        return f"stands. It needs friction {_upward(need)} (given {given})" + (f" and holds{upto}" if upto else "")
    if need < _NONE:
        return "stands, without any friction" + (f", and{upto}" if upto else "")
    with_it = f". With {number(ASSUMED)} it holds{upto}" if upto else ""
    return f"stands, if the ground gives friction {_upward(need)}{with_it}"


def support_notes(found: GroundSupport) -> Iterator[str]:
    """Remarks: what "stands" means with many contacts, and feet out of one plane."""
    if int(found.in_contact.sum(axis=1).max(initial=0)) > _FEW:
        yield (
            "'Stands' means that some forces within the friction cones balance. How a stiff body shares its weight among more "
            "than three contacts depends on its stiffness: one foot may unload earlier without the body tipping."
        )
    _, points = contact_maps(found.robot, found.states.q[:1], found.contacts)
    heights = points[0] @ upward(found.robot)
    spread = heights[found.in_contact[0]]
    if len(spread) and not any(found.ground.automatic) and float(np.ptp(spread)) > _PLANE:
        by_frame = {c.frame: number(float(h), 3) for c, h in zip(found.contacts, heights, strict=True)}
        texts = [f"{frame} {height} m" for frame, height in by_frame.items()]
        yield f"The contacts are not in one plane at the first instant: {listed(texts, _LISTED)}. Normals stay vertical."
