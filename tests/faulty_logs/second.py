"""Second generator of faulty logs: kinds of field reports, on robots that the first one does not have, in two halves.

Kinds were divided before any of them was run. Rules may be mended by the tuned half; the untouched half is only counted. No
threshold of a doubt is set on either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.signal import butter, lfilter

from .cases import (
    Case,
    Change,
    Recording,
    copied,
    exchanged,
    held,
    late,
    laws,
    loaded_after,
    positions_scaled,
    scaled,
    sprung,
    swaying,
    tilted,
    unsigned,
    zero_off,
)
from .truth import RATE, SECONDS, Array, States, Truth

SECOND_ROBOTS = ("gen3", "iiwa7", "qarm", "lift")
"""Robots of the second generator: two arms of seven joints, one of four, and one on a vertical slide."""
TURNS = 2
"""Logs of each kind, on different robots."""


# ── The world


def as_in_file(truth: Truth, _states: States, _rng: np.random.Generator) -> Truth:
    """Bodies as in the file."""
    return replace(truth, robot=truth.file)


# ── The log


def weakening(log: Recording, *, share: float, joint: int | None = None) -> None:
    """Constants that fall to their end by an exponential law, as of motors that warm."""
    which = slice(None) if joint is None else [joint]
    log.tau[:, which] *= 1.0 - share * (1.0 - np.exp(-3.0 * log.t / SECONDS))[:, None] / (1.0 - np.exp(-3.0))


def pulled_along(log: Recording, *, newtons: float, direction: tuple[float, float, float]) -> None:
    """A force on the tip throughout, along one direction of the world."""
    force = newtons * np.array(direction) / np.linalg.norm(direction)
    states = log.motion(log.t)
    log.tau += log.truth.rigid(*states, force=np.broadcast_to(force, (len(log.t), 3))) - log.truth.rigid(*states)
    log.value |= {"force": newtons}


def offset_after(log: Recording, *, joint: int, share: float, part: float) -> None:
    """An offset of a share of a torque's deviation, from a part of the log on."""
    log.tau[log.t >= part * SECONDS, joint] += share * log.size[joint]


def rezeroed(log: Recording, *, joint: int, degrees: float, part: float) -> None:
    """A position that counts from another zero from a part of the log on, as after a belt has slipped."""
    log.q[log.t >= part * SECONDS, joint] += np.radians(degrees)
    log.value |= {"from": part * SECONDS}


def with_play(log: Recording, *, joint: int, degrees: float) -> None:
    """Positions of a motor whose link lags behind it by half the play of the gear, and which crosses it below 0.05 rad/s."""
    dq = log.motion(log.t)[1][:, joint]
    log.q[:, joint] += np.radians(degrees) * np.tanh(dq / 0.05)


def counting_the_one_before(log: Recording, *, joint: int, sign: float) -> None:
    """A position that counts that of the joint before as well, with a sign."""
    log.q[:, joint] += sign * log.q[:, joint - 1]


def averaged(log: Recording, *, seconds: float) -> None:
    """Torques as means over the time before each row."""
    _filtered(log, np.full(round(seconds * RATE), 1.0 / round(seconds * RATE)), np.ones(1))


def butterworth(log: Recording, *, hertz: float) -> None:
    """Torques through a filter of second order."""
    _filtered(log, *butter(2, hertz, fs=RATE))


def _filtered(log: Recording, b: Array, a: Array) -> None:
    whole = log.torques_at(np.concatenate([np.arange(-3.0, 0.0, 1 / RATE), log.t]))
    log.tau = whole[:1] + lfilter(b, a, whole - whole[:1], axis=0)
    log.tau = log.tau[-len(log.t) :] + log.noise


def torques_held(log: Recording, *, every: int) -> None:
    """Torques of every so manieth row, written into those that follow."""
    log.tau = log.tau[np.arange(len(log.t)) // every * every]


def reversed_columns(log: Recording) -> None:
    """Torques in the order from the tip to the base."""
    log.tau = log.tau[:, ::-1].copy()


def both_exchanged(log: Recording, *, joints: tuple[int, int]) -> None:
    """Names of two joints exchanged: positions and torques."""
    exchanged(log, column="q", joints=joints)
    exchanged(log, column="tau", joints=joints)


def in_percent(log: Recording) -> None:
    """Torques in per cent of a rated torque of each joint, which is 1.5 times the largest."""
    log.tau = 100.0 * log.tau / (1.5 * np.abs(log.tau).max(axis=0))


def wrapped(log: Recording, *, joint: int) -> None:
    """A torque whose register overflows at 70 % of the largest, and goes on at the other end."""
    most = 0.7 * np.abs(log.tau[:, joint]).max()
    log.tau[:, joint] = (log.tau[:, joint] + most) % (2.0 * most) - most


def rippled(log: Recording, *, joint: int) -> None:
    """Cogging of eight ripples a turn, of 30 % of a torque's deviation."""
    q = log.motion(log.t)[0][:, joint]
    log.tau[:, joint] += 0.3 * np.sqrt(2.0) * log.size[joint] * np.sin(8.0 * q)


# ── Halves


def _one(joint: int, times: float) -> Change:
    return partial(scaled, times=times, joints=(joint,))


def _tuned() -> tuple[Case, ...]:
    return (
        Case("current of joint 2 in place of its torque", ("gain",), log=(_one(1, 0.12),), value={"gain": 0.12}),
        Case("play of 1.2 deg at 2", ("backlash",), log=(partial(with_play, joint=1, degrees=0.6),), joints=(1,)),
        Case("cable spring at 1", ("spring",), log=(partial(sprung, joint=0),), joints=(0,)),
        Case("hose of 25 N, level", ("force",), log=(partial(pulled_along, newtons=25.0, direction=(1.0, 0.4, 0.0)),)),
        Case("offset of 3 steps early", ("offset-step",), log=(partial(offset_after, joint=2, share=0.6, part=0.3),)),
        Case("constant of 4 falls 30 %", ("gain-drift",), log=(partial(weakening, share=0.3, joint=3),), joints=(3,)),
        Case("torque 4 without sign", ("unsigned",), log=(partial(unsigned, joint=3),), joints=(3,)),
        Case("torques in kgf cm", ("gain", "unit"), log=(partial(scaled, times=10.19716),)),
        Case(
            "bodies of the file, torques in lbf ft", ("unit", "gain"), (as_in_file,), (partial(scaled, times=0.737562),)
        ),
        Case("torque 1 in the column of 2", ("copied",), log=(partial(copied, joint=1, times=1.0),), joints=(0, 1)),
        Case(
            "encoder of 4 counts 3 backwards", ("coupled",), log=(partial(counting_the_one_before, joint=3, sign=-1.0),)
        ),
        Case("torques over 100 ms", ("low-pass", "late"), log=(partial(averaged, seconds=0.1),)),
        Case("torques held for 50 ms", ("repeated", "late", "low-pass"), log=(partial(torques_held, every=12),)),
        Case("torques from the tip to the base", ("exchanged-torques",), log=(reversed_columns,)),
        Case("belt of 2 slips by 6 deg", ("zero-change",), log=(partial(rezeroed, joint=1, degrees=6.0, part=0.5),)),
        Case("names of 2 and 3 exchanged", ("exchanged-joints",), log=(partial(both_exchanged, joints=(1, 2)),)),
        Case(
            "tilt 6 deg and constant of 3 falls 25 %",
            ("tilt", "gain-drift"),
            (partial(tilted, degrees=6.0),),
            (partial(weakening, share=0.25, joint=2),),
        ),
        Case(
            "zero of 2 off 8 deg and a hose of 20 N",
            ("zero", "force"),
            log=(
                partial(zero_off, degrees=8.0, joint=1),
                partial(pulled_along, newtons=20.0, direction=(0.0, 1.0, 0.5)),
            ),
        ),
        Case(
            "load friction 12 % and gain 1.4 on 2",
            ("load-friction", "gain"),
            (partial(laws, load=0.12),),
            (_one(1, 1.4),),
        ),
    )


def _untouched() -> tuple[Case, ...]:
    return (
        Case("gain 0.6 on 4", ("gain",), log=(_one(3, 0.6),), value={"gain": 0.6}, joints=(3,)),
        Case("play of 1.6 deg at 3", ("backlash",), log=(partial(with_play, joint=2, degrees=0.8),), joints=(2,)),
        Case("spring at 4", ("spring",), log=(partial(sprung, joint=3),), joints=(3,)),
        Case(
            "hose of 30 N, aslant", ("force",), log=(partial(pulled_along, newtons=30.0, direction=(-1.0, 0.5, 0.8)),)
        ),
        Case("offset of 4 steps late", ("offset-step",), log=(partial(offset_after, joint=3, share=-0.5, part=0.7),)),
        Case("all constants fall 20 %", ("gain-drift",), log=(partial(weakening, share=0.2),)),
        Case("torque 3 without sign", ("unsigned",), log=(partial(unsigned, joint=2),), joints=(2,)),
        Case(
            "bodies of the file, torques in lbf in", ("unit", "gain"), (as_in_file,), (partial(scaled, times=8.85075),)
        ),
        Case("torques in per cent", ("gain",), log=(in_percent,)),
        Case("torque 3 in the column of 4", ("copied",), log=(partial(copied, joint=3, times=1.0),), joints=(2, 3)),
        Case("encoder of 2 counts 1", ("coupled",), log=(partial(counting_the_one_before, joint=1, sign=1.0),)),
        Case("torques through a filter of 4 Hz", ("low-pass", "late"), log=(partial(butterworth, hertz=4.0),)),
        Case("positions held for 40 ms", ("repeated",), log=(held,)),
        Case(
            "positions of 2 and 4 exchanged",
            ("exchanged-positions",),
            log=(partial(exchanged, column="q", joints=(1, 3)),),
        ),
        Case(
            "encoder of 3 set anew by -4 deg",
            ("zero-change",),
            log=(partial(rezeroed, joint=2, degrees=-4.0, part=0.4),),
        ),
        Case("1.5 kg taken up late", ("load-change",), log=(partial(loaded_after, part=0.6, mass=1.5),)),
        Case("register of torque 2 overflows", ("wrapped",), log=(partial(wrapped, joint=1),), joints=(1,)),
        Case("cogging of 3", ("ripple",), log=(partial(rippled, joint=2),), joints=(2,)),
        Case(
            "zero of 3 off 7 deg and gain 0.7 on 2",
            ("zero", "gain"),
            log=(partial(zero_off, degrees=7.0, joint=2), _one(1, 0.7)),
        ),
        Case(
            "swaying base and load friction 15 %", ("swaying", "load-friction"), (partial(laws, load=0.15),), (swaying,)
        ),
        Case(
            "late 25 ms and tilt 5 deg",
            ("late", "tilt"),
            (partial(tilted, degrees=5.0),),
            (partial(late, seconds=0.025),),
        ),
        Case("position of 2 times 1.2", ("position-scale",), log=(partial(positions_scaled, times=1.2, joints=(1,)),)),
    )


TUNED: Mapping[str, Case] = {case.name: case for case in _tuned()}
UNTOUCHED: Mapping[str, Case] = {case.name: case for case in _untouched()}
