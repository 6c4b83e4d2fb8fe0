"""Identification: states of logs, causes of a residual, their fits, their choice and their sentences, on record."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from leaning_arm import packed, short_arm, states_at, torques_at
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.doubts import doubt_table
from twistwrench.identification import assumed as assumed_module
from twistwrench.identification.assumed import JOINTS_OF_CAUSE, AssumedCauses, begin_settings, prior_with, wanted_causes
from twistwrench.identification.diagnosis import cause_doubts, cause_fit, causes, diagnose
from twistwrench.identification.diagnosis.cause_fit import CauseFit, log_fit
from twistwrench.identification.diagnosis.causes import FittedTorques
from twistwrench.identification.diagnosis.diagnose import FoundCause, WantedCause
from twistwrench.identification.diagnosis.log_states import LogStates, jump_of
from twistwrench.identification.hyperparameters import FitOptions, FitSettings
from twistwrench.identification.parameters import UnknownParameters
from twistwrench.identification.rows import SteadySamples

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
stub = SimpleNamespace


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


@functools.cache
def robot():
    return short_arm().with_gravity([2.0, -3.0, -9.0])


@functools.cache
def unknown():
    return UnknownParameters(robot(), friction=("viscous", "coulomb", "stribeck", "offset"), stribeck_speed=0.15)


@functools.cache
def samples_of(seconds=14.0, rate=50.0, start=2.5, log=0, cut=False):
    time = start + np.arange(round(seconds * rate)) / rate
    q, _, _ = states_at(time)
    return SteadySamples(start, rate, q, torques_at(robot(), time), 0.0, cut, log)


SETTINGS = FitSettings(3.0, np.array([0.03, 0.05, 0.08]), 0.0)
NONE_DEAD = np.zeros(3, bool)


@functools.cache
def start_fit(*, dead=(), shift=0.0, plain=True):
    parameters = UnknownParameters(robot()) if plain else unknown()
    is_dead = np.isin(np.arange(3), dead)
    return log_fit(parameters, [samples_of()], replace(SETTINGS, shift=shift), is_dead)


@functools.cache
def two_piece_states():
    base = cause_fit.askew_base(unknown())
    logs = [samples_of(6.0, log=1), samples_of(4.0, 40.0, 30.0, log=2, cut=True)]
    return LogStates.from_samples(base, logs, 2.0, SETTINGS.friction_speed, 60)


def fields_of(s):
    """Fields of states that corrections change; of gravity its size and its part along the robot's, as axes across it are arbitrary."""
    gravity = [np.linalg.norm(s.gravity), s.gravity @ [2.0, -3.0, -9.0]]
    return [s.q, s.dq, s.ddq, s.tau, s.gain, s.friction_speed, gravity, [s.lag, s.shift]]


def shown(s):
    """These fields, and the joints without weight."""
    motion, others = fields_of(s)[:4], fields_of(s)[4:]
    return [*map(packed, motion), *others, s.weightless]


# ── States


@records.of
def states_of_two_pieces():
    s = two_piece_states()
    x = drawn(s.base.count, seed=1)
    found = {
        "fields": [
            s.cutoff,
            [[p.start, p.stop] for p in s.pieces],
            s.rows,
            packed(s.time),
            packed(s.piece),
            packed(s.rate),
            s.logs,
        ]
    }
    found["shown"] = shown(s)
    found["unfiltered"] = packed(s.unfiltered)
    found["filters"] = [packed(s.low_passed(s.tau)), packed(s.slope(s.q)), packed(s.with_fields(pieces=()).slope(s.q))]
    cases = {
        "plain": s, "late": s.with_fields(shift=0.05), "early": s.with_fields(shift=-0.3), "lagging": s.with_fields(lag=0.04),
        "weightless": s.with_fields(weightless=(0, 2)), "gain": s.with_fields(gain=np.array([2.0, -1.0, 0.5])),
        "turned": s.with_fields(gravity=np.array([1.0, 4.0, -2.0])), "slow": s.with_fields(friction_speed=np.array([0.2, 0.1, 0.3])),
        "lagging gain": s.with_fields(lag=0.1, gain=np.array([2.0, -1.0, 0.5])),
    }  # fmt: skip
    for name, case in cases.items():
        total, bodies = case.torques(x)
        found[name] = [
            case.measured_torques, case.columns, case.predicted_torques(x), case.drives, packed(total), packed(bodies), case.lagging,
        ]  # fmt: skip
    whole = LogStates.from_samples(s.base, [samples_of(4.0)], 2.0, SETTINGS.friction_speed, 60, whole=True)
    found["whole"] = [shown(whole), len(whole.time), whole.rows]
    s.columns, s.bodies, s.drives  # noqa: B018
    kept = {}
    for field in ("q", "gravity", "weightless", "rows", "friction_speed", "lag", "tau", "gain", "shift"):
        copy = s.with_fields(**{field: np.array(getattr(s, field)) if field not in ("weightless", "lag", "shift") else {"weightless": (1,), "lag": 0.1, "shift": 0.2}[field]})  # fmt: skip
        kept[field] = sorted(set(copy.__dict__) & {"columns", "bodies", "drives"})
    return found | {"kept": kept}


@records.of
def jumps_of_positions():
    steps = 0.01 * np.sin(np.arange(60) * 0.4)
    found = {}
    for name, place, size in (
        ("middle", 30, 0.3),
        ("small", 30, 0.009),
        ("begin", 1, 0.3),
        ("end", 58, 0.3),
        ("negative", 22, -0.2),
        ("none", 30, 0.0),
    ):
        q = np.cumsum(steps)
        q[place:] += size
        found[name] = jump_of(q)
    twice = np.cumsum(steps)
    twice[20:] += 0.3
    twice[40:] += 0.11
    found["twice"] = jump_of(twice)
    twice[40:] -= 0.02
    found["second is smaller"] = jump_of(twice)
    jumped = np.r_[np.zeros(5), np.ones(5)]
    long = np.cumsum(0.01 * np.sin(np.arange(900) * 0.4))
    long[200:] += 0.3
    for second in (0.09, 0.11):
        also = long.copy()
        also[600:] += second
        found[f"second of {second}"] = jump_of(also)
    found["few"] = [jump_of(jumped), jump_of(np.r_[np.zeros(9), np.ones(9)])]
    sudden = samples_of(4.0)
    q = sudden.q.copy()
    q[120:, 1] += 0.5
    s = LogStates.from_samples(
        two_piece_states().base, [samples_of(3.0), replace(sudden, q=q)], 2.0, SETTINGS.friction_speed, 60
    )
    return found | {
        "of states": s.jumps,
        "causes": [[c.kind, c.joints, c.since, shown(c.correct(s, np.array([0.4])))] for c in causes.jumps(s)],
    }


# ── Causes


@records.of
def discrete_causes_of_all_kinds():
    s = two_piece_states()
    found = [[c.kind, c.joints, c.number, c.step, packed(*fields_of(c.correct(s))), c.correct(s).weightless] for c in causes.discrete_causes(s, [0, 1, 2])]  # fmt: skip
    some = [[c.kind, c.joints, c.number] for c in causes.discrete_causes(s, [2, 0])]
    weightless = [[c.kind, c.joints] for c in causes.discrete_causes(s.with_fields(gravity=np.zeros(3)), [1])]
    return [found, some, weightless]


@records.of
def continuous_causes_of_all_kinds():
    s = two_piece_states()
    found = {}
    for wide in (False, True):
        listed = []
        for cause in causes.continuous_causes(s, wide=wide):
            beta = np.array([0.07, -0.04])[: cause.size]
            listed.append(
                [
                    cause.kind,
                    cause.joints,
                    cause.step,
                    cause.size,
                    cause.starts,
                    cause.cost,
                    packed(*fields_of(cause.correct(s, beta))),
                ]
            )
        found[str(wide)] = listed
    found["no gravity"] = [c.kind for c in causes.continuous_causes(s.with_fields(gravity=np.zeros(3)), wide=False)]
    found["bounds"] = [causes._factor(np.array([beta])) for beta in (-9.0, 0.5, 9.0)]
    found["lag"] = [causes._with_lag(s, np.array([lag])).lag for lag in (-1.0, 0.03)]
    moved = s.with_fields(shift=0.1)
    found["later"] = causes._later(moved, np.array([0.02])).shift
    found["axes"] = [
        np.abs(axes @ np.array([1.0, -2.0, 3.0])).max()
        for axes in [causes._horizontal_axes(np.array([1.0, -2.0, 3.0]))]
    ]
    return found


@records.of
def elastic_and_loose_joints():
    s = two_piece_states()
    torque, _ = s.torques(drawn(s.base.count, seed=1))
    found = {}
    for largest in (None, np.array([20.0, 30.0, 4.0])):
        listed = [
            [c.kind, c.joints, c.step, packed(*fields_of(c.correct(s, 0.01))[:4])]
            for c in causes.compliances(s, torque, largest)
        ]
        found[str(largest)] = listed
    found["plays"] = [[c.kind, c.joints, c.step, c.starts, packed(*fields_of(c.correct(s, np.array([0.01])))[:4]), packed(c.correct(s, np.array([1e-5])).q)] for c in causes.plays(s)]  # fmt: skip
    found["no positions"] = [c.kind for c in causes.plays(s.with_fields(unfiltered=None))]
    bare = s.with_fields(pieces=())
    found["no pieces"] = [
        causes._remove_play(bare, np.array([0.1]), 1) is bare,
        causes.behind(bare, 0.1, s.q, s.q, s.q) is bare,
    ]
    found["side"] = causes.side_in_play(np.array([0.0, 0.05, 0.3, 0.25, 0.1, -0.2, -0.15, 0.4]), 0.1)
    found["sets"] = [causes._joint_sets(count) for count in (1, 3)]
    return found


@records.of
def laws_and_their_columns():
    s = two_piece_states()
    fitted = FittedTorques.from_groups(s, drawn(s.base.count, seed=2))
    found = {"fitted": [packed(fitted.whole), packed(fitted.rigid), fitted.coulomb]}
    laws = {"laws": causes.laws(s), "changes": causes.changes(s), "of the log": causes.laws_of_the_log(s)}
    for name, listed in laws.items():
        found[name] = [
            [law.kind, law.joints, law.speed, packed(law.columns(s, fitted)), law.columns(s, fitted).shape[-1]]
            for law in listed
        ]
    late = replace(next(causes.changes(s)), since=(1, 31.0))
    early = replace(next(causes.changes(s)), since=(0, 5.0))
    found["since"] = [int(law.acting(s).sum()) for law in (late, early)]
    found["elapsed"] = [packed(causes._elapsed_share(s)), causes._elapsed_share(s.with_fields(time=np.full(3, 2.0)))]
    found["loads"] = causes._unit_loads(np.asarray(tw.se3.exp(drawn(6, seed=3))))
    return found


@records.of
def torques_without_their_sign():
    s = two_piece_states()
    x = drawn(s.base.count, seed=2)
    predicted, _ = s.torques(x)
    found = {"shares": [float((column < -0.2 * np.sqrt((column**2).mean())).mean()) for column in predicted.T]}
    for k in range(3):
        cause = causes.torque_without_sign(s, k, x)
        found[str(k)] = (
            None
            if cause is None
            else [
                cause.kind,
                cause.joints,
                packed(cause.correct(s).tau),
                cause.correct(s.with_fields(pieces=())).tau is s.tau,
            ]
        )

    def of(torques):
        fake = stub(torques=lambda _: (np.array(torques)[:, None], None))
        return causes.torque_without_sign(fake, 0, None) is not None

    found["limits"] = [of([-1.0] * n + [1.0] * (40 - n)) for n in (4, 5, 35, 36)] + [
        of([-0.19] * 9 + [1.0] * 9),
        of([-0.21] * 9 + [1.0] * 9),
    ]
    return found


@records.of
def runs_of_high_rows():
    time = np.arange(60) * 0.1
    piece = (np.arange(60) >= 40).astype(int)
    high = np.isin(
        np.arange(60),
        [*range(5, 9), *range(12, 15), *range(16, 18), *range(30, 33), *range(38, 45), *range(50, 53), 55, 59],
    )
    uneven = np.where(np.arange(60) < 30, time, time + 0.15)
    return [
        causes.runs(time, piece, high),
        causes.runs(uneven, piece, high),
        causes.runs(time, piece, ~high),
        causes.runs(time, piece, time < 0),
    ]


@records.of
def values_in_their_units():
    def unit(kind, joints=(0,)):
        return causes.unit_of_value(kind, joints, robot().model)

    kinds = [
        "zero", "tilt", "elasticity", "zero-change", "backlash", "late", "late-change", "late-joint", "gain-change", "low-pass", "load-friction",
        "stribeck", "warming", "gain-drift", "gain", "position-scale", "spring", "offset-step", "drift", "force",
    ]  # fmt: skip
    found = {kind: causes.value_with_interval(kind, np.array([0.3]), np.array([0.04]), unit(kind)) for kind in kinds}
    found["vector"] = causes.value_with_interval("tilt", np.array([0.03, -0.04]), np.array([0.002, 0.005]), "deg")
    found["no vector"] = causes.value_with_interval("force", np.zeros(3), np.array([2.0, 5.0, 7.0]), "N")
    found["large"] = causes.value_with_interval("gain", np.array([40.0]), np.array([90.0]), "")
    for kind in ("elasticity", "zero-change", "backlash"):
        for joints in ((1,), ()):
            own_unit = unit(kind, joints)
            found[f"{kind} of {joints}"] = (
                causes.value_with_interval(kind, np.array([0.3]), np.array([0.04]), own_unit),
                own_unit,
            )
    return found | {"units": {kind: doubt_table()[kind].unit for kind in kinds}}


# ── Fits


@records.of(relative=1e-5)
def fits_of_rows_and_laws():
    found = {}
    cases = {
        "plain": start_fit(),
        "dead": start_fit(dead=(1,)),
        "late": start_fit(shift=0.02),
        "static": start_fit(plain=False),
    }
    m = len(start_fit().tau)
    law = np.zeros((m, 3))
    law[:, 2] = np.linspace(-1, 2, m) ** 2
    other = np.sin(np.arange(m))[:, None] * [0.0, 1.0, 0.5]
    cases["law"] = cases["plain"].refit(cases["plain"].states, law, other)
    for name, fit in cases.items():
        found[name] = {
            "x": packed(fit.x), "weight": fit.weight, "folds": [[f.start, f.stop] for f in fit.folds], "spread": fit.spread, "left": fit.left,
            "floor": fit.floor, "squares": fit.squares, "shares": fit.shares, "W": fit.W, "enough": fit.enough, "blocks": fit.blocks,
            "correlation": fit.correlation, "critical": [fit.critical_t(tried) for tried in (0, 1, 40)],
            "gain": [cases["plain"].gain(fit), fit.gain(cases["plain"])] if fit.live.all() else [], "rows": [len(fit.tau), fit.states.cutoff],
        }  # fmt: skip
    found["deviation"] = [
        cases["law"].law_deviation(2),
        cases["law"].law_deviation(1),
        cases["plain"].deviation(np.stack([law, other], axis=2)),
    ]
    found["t"] = cases["law"].t_value(cases["plain"])
    fit = cases["plain"]
    sets = np.stack(
        [np.stack([law, other], axis=2), np.stack([other, 2 * other], axis=2), np.stack([fit.W[:, :, 4], law], axis=2)],
        axis=2,
    )
    left, beta = fit.with_columns(sets)
    found["sets"] = [left, beta, *fit.gains_of_columns(sets)]
    found["single"] = fit.gains_of_sets([law[..., None], sets[:, :, 0], other[..., None]])
    found["dependent"] = fit.with_columns(sets[:, :, 1:])[1]
    found["change"] = packed(fit.change(sets[:, :, 0], np.array([0.3, -0.7])))
    return found


@records.of
def enough_rows_for_a_search():
    def enough(rows, live, count):
        fit = stub(tau=np.zeros((rows, 3)), live=np.arange(3) < live, states=stub(base=stub(count=count)))
        return CauseFit.enough.fget(fit)

    return [enough(39, 3, 10), enough(40, 3, 40), enough(40, 3, 41), enough(60, 2, 40), enough(60, 2, 41)]


@records.of(relative=1e-4)
def screened_causes_and_laws():
    fit = start_fit()
    s = fit.states
    found = {}
    screened = cause_fit.screen_causes(fit, causes.continuous_causes(s, wide=False))
    found["causes"] = [
        [
            c.cause.kind,
            c.cause.joints,
            c.S,
            np.linalg.norm(c.beta),
            np.linalg.norm(c.e),
            packed(c.e * (c.cause.size < 2)),
        ]
        for c in screened
    ]
    wide = [c for c in causes.continuous_causes(s, wide=True) if c.kind in ("low-pass", "late")]
    found["wide"] = [
        [c.cause.kind, c.S] for c in cause_fit.screen_causes(fit, [replace(c, starts=c.starts[:2]) for c in wide])
    ]
    found["laws"] = [[c.cause.kind, c.cause.joints, c.S, packed(c.beta)] for c in fit.joint_causes]
    found["changes"] = [[c.cause.kind, c.cause.joints, c.cause.since, c.S] for c in cause_fit.screen_changes(fit)]
    found["law changes"] = diagnose.law_changes(fit).shape, packed(diagnose.law_changes(fit))
    columns = [np.zeros((len(fit.tau), 3, 1))]
    columns[0][:, 1, 0] = 1.0
    lifted = CauseFit(s.with_fields(tau=s.tau + 9.0 * (s.time[:, None] > 8.0) * [0, 1, 0]), fit.groups, fit.live)
    found["begins"] = cause_fit._best_begins(lifted, columns)
    return found


# ── Choice of causes


@functools.cache
def states_of_the_robot():
    return stub(base=stub(unknown=stub(model=robot().model)))


def found_cause(kind="gain", joints=(1,), S=1.0, cost=0.0, **fields):
    return FoundCause(
        kind,
        joints,
        S,
        fields.pop("t", 9.0),
        stub(),
        fields.pop("fit", stub(blocks=range(8), critical_t=lambda n: float(n), states=states_of_the_robot())),
        cost=cost,
        **fields,
    )


@records.of
def parts_of_other_changes():
    first = found_cause("gain-change", (0, 2), span=(3.0, 9.0), log=1)
    cases = {
        "part": found_cause("offset-step", (2,), span=(3.99, 9.0), log=1), "later": found_cause("offset-step", (2,), span=(4.0, 9.0), log=1),
        "earlier": found_cause("offset-step", (2,), span=(2.01, 9.0), log=1), "joint": found_cause("offset-step", (1,), span=(3.0, 9.0), log=1),
        "kind": found_cause("gain-change", (2,), span=(3.0, 9.0), log=1), "log": found_cause("offset-step", (2,), span=(3.0, 9.0), log=2),
        "no span": found_cause("offset-step", (2,), log=1),
    }  # fmt: skip
    return {name: diagnose._is_part(case, [found_cause("zero", (2,)), first]) for name, case in cases.items()}


@records.of
def possible_and_large_causes():
    mass = stub(states=stub(base=stub(unknown=stub(robot=stub(model=stub(moving_mass=5.0))))), blocks=range(8))
    possible = {
        f"{kind} {value}": diagnose._is_possible(found_cause(kind, value=value and np.array([value]), fit=mass))
        for kind in ("load-change", "elasticity", "gain", "stribeck", "spring") for value in (15.0, 15.1, -15.0, -15.1, -0.1, None)
    }  # fmt: skip
    large = {}
    for S, blocks, value in (
        (1.49, 8, None),
        (1.5, 8, None),
        (1.5, 5, None),
        (1.5, 6, 0.41),
        (1.5, 6, -0.41),
        (1.5, 6, 0.39),
    ):
        fit = stub(blocks=range(blocks), states=states_of_the_robot())
        fields = {} if value is None else {"value": np.array([value]), "deviation": np.array([0.2])}
        large[f"{S} {blocks} {value}"] = diagnose._is_large(found_cause(S=S, fit=fit, **fields))
    determined = {}
    for kind, value, deviation in (("gain", 0.1, 0.9), ("gain", 0.1, 1.1), ("zero", 0.1, 5.0), ("gain", 0.1, 0.97)):
        fit = stub(blocks=range(9), states=states_of_the_robot())
        determined[f"{kind} {deviation}"] = diagnose._is_determined(
            found_cause(kind, value=np.array([value]), deviation=np.array([deviation]), fit=fit)
        )
    return [possible, large, determined, diagnose._is_determined(found_cause("gain"))]


@records.of
def strongest_causes():
    def strongest(cases, count=5):
        return [
            [c.kind, c.S]
            for c in diagnose._strongest([found_cause(*case[:3], cost=case[3], t=case[4]) for case in cases], count)
        ]

    return {
        "significant": strongest(
            [
                ("gain", (0,), 1.0, 0.0, 5.0),
                ("zero", (1,), 0.9, 0.0, 4.9),
                ("tilt", (), 0.71, 0.0, 6.0),
                ("late", (), 0.69, 0.0, 9.0),
            ]
        ),
        "small": strongest([("gain", (0,), 0.249, 0.0, 9.0), ("zero", (1,), 0.25, 0.0, 9.0)]),
        "certain": strongest([("gain", (0,), 1.5, 0.0, 1.0), ("zero", (1,), 1.49, 0.0, 4.9)]),
        "cost": strongest(
            [("force", (0,), 1.9, 1.0, 9.0), ("zero", (1,), 1.2, 0.0, 9.0), ("low-pass", (), 1.83, 1.0, 9.0)]
        ),
        "later is larger": strongest(
            [("gain", (0,), 1.0, 0.0, 9.0), ("zero", (1,), 2.0, 0.0, 9.0), ("tilt", (), 1.5, 0.0, 9.0)]
        ),
        "impossible": [
            c.kind for c in diagnose._strongest([found_cause("spring", (0,), 2.0, value=np.array([-1.0]))], 2)
        ],
    }


@records.of
def most_significant_cause():
    def most(cases, alone=None):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(diagnose, "_strongest", lambda tested, count: tested)
            patch.setattr(diagnose, "_cause_at_best_speed", lambda fit, candidate: candidate)
            patch.setattr(diagnose, "effect", lambda fit, found: 0.25)
            patch.setattr(diagnose, "_gained_with", lambda fit, best: alone)
            best = diagnose._most_significant(None, [found_cause(*case) for case in cases], 3)
        return best and [best.kind, best.joints, best.S, best.effect, [[c.kind, c.S] for c in best.rivals]]

    return {
        "none": most([]), "one": most([("gain", (0,), 1.0)]), "first of equal ones": most([("zero", (1,), 0.951), ("gain", (0,), 1.0), ("late", (), 0.96)], 1.0),
        "not equal": most([("zero", (1,), 0.949), ("gain", (0,), 1.0)]), "share": most([("zero", (1,), 3.89), ("gain", (0,), 4.0)]),
        "no share": most([("zero", (1,), 3.87), ("gain", (0,), 4.0)]), "cost": most([("force", (), 1.9, 1.0), ("gain", (0,), 0.94)]),
        "of one joint": most([("tilt", (), 2.0), ("zero", (1,), 1.81), ("gain", (0,), 1.7)], 0.19), "of the log": most([("tilt", (), 2.0), ("zero", (1,), 1.8)], 0.21),
        "negative": most([("late", (), 2.0), ("zero", (1,), 1.1), ("gain", (2,), 1.2)], -0.3), "mounting": most([("mounting", (), 2.0), ("gain", (2,), 1.9)], 0.1),
        "of the joints": most([("gain", (0,), 2.0), ("zero", (1,), 1.96)], 0.0),
    }  # fmt: skip


@records.of
def frequencies_signs_and_wanted_causes():
    time = np.arange(90) * 0.05
    signals = np.stack([np.sin(2 * np.pi * 1.3 * time), 0.3 * np.cos(2 * np.pi * 3.1 * time) + 5.0], axis=1)
    wanted = [WantedCause("gain", (1, 2)), WantedCause("gain", ()), WantedCause("zero", (1,))]
    found = [found_cause("gain", (1,)), found_cause("gain", (0,)), found_cause("zero", (0, 1)), found_cause("gain", ())]
    return [
        diagnose._dominant_frequency(time, signals), diagnose._dominant_frequency(time, signals * [0.1, 1.0]),
        [[cause.stands_for(other) for other in found] for cause in wanted],
        diagnose._begin(two_piece_states(), None), diagnose._begin(two_piece_states(), (1, 31.5)),
    ]  # fmt: skip


def faulty(fault):
    """Samples of a log with a fault."""
    log = samples_of()
    q, tau = log.q.copy(), log.tau.copy()
    time = log.start + np.arange(len(q)) / log.rate
    if fault == "gain":
        tau[:, 2] *= 1.3
    elif fault == "zero":
        q[:, 0] += 0.1
    elif fault == "sign":
        tau[:, 1] *= -1.0
    elif fault == "late":
        tau = np.roll(tau, 3, axis=0)
    elif fault == "tilt":
        with_tilt = robot().with_gravity([4.0, -2.0, -9.0])
        tau = torques_at(with_tilt, time)
    elif fault == "drift":
        tau[:, 0] += 12.0 * (time - time[0]) / np.ptp(time)
    elif fault == "exchanged":
        tau = tau[:, [2, 1, 0]]
    elif fault == "step":
        tau[350:, 1] += 25.0
    elif fault == "push":
        J = np.asarray(robot().jacobian(q, kind="world_aligned"))[:, 3:]
        tau += np.einsum("nij,i->nj", J, [60.0, -40.0, 80.0]) * ((time > 7.0) & (time < 8.1))[:, None]
    elif fault == "sway":
        for sign, axis in ((1.0, [1.0, 0.4, 0.2]),):
            swung = np.asarray(
                [robot().with_gravity(np.array([2.0, -3.0, -9.0]) - sign * np.array(axis)).gravity_forces(q)]
            )[0]
            still = np.asarray(robot().gravity_forces(q))
            tau += (swung - still) * 0.9 * np.sin(2 * np.pi * 0.9 * time)[:, None]
    elif fault == "jump":
        q[400:, 0] += 0.15
    return [replace(log, q=q, tau=tau)]


@functools.cache
def diagnosed(fault):
    fit = log_fit(UnknownParameters(robot()), faulty(fault), SETTINGS, NONE_DEAD)
    return diagnose.diagnose(fit)


@records.of(relative=2e-3)
def diagnoses_of_faulty_logs():
    found = {}
    names = robot().model.velocity_names
    for fault in ("zero", "push", "jump"):
        listed, _ = diagnosed(fault)
        found[fault] = [
            [c.kind, c.joints, round(c.S, 2), c.value_and_interval, c.span and [round(t, 2) for t in c.span], c.log, c.size, c.most, c.effect, [r.kind for r in c.rivals]]
            for c in listed
        ]  # fmt: skip
        found[f"{fault}, said"] = [str(cause_doubts.doubt_of_cause(names, c)) for c in listed]
    return found


# ── Sentences about causes


def said(kind="gain", joints=(1,), *, effect=0.03, value=0.05, deviation=0.01, taken=None, names=("waist", "slide", "elbow"), shares=(0.2, 0.6, 0.4), shift=0.0, **fields):  # fmt: skip
    before = stub(squares=np.ones(3))
    states = stub(gravity=np.array([1.0, -2.0, -9.5]), shift=shift, base=states_of_the_robot().base)
    fit = stub(live=np.ones(3, bool), squares=1.0 - np.array(shares), blocks=range(9), states=states)
    given = {
        "value": None if value is None else np.atleast_1d(value),
        "deviation": None if deviation is None else np.full(np.size(value), deviation),
    }
    cause = FoundCause(kind, joints, 1.23, 9.0, before, fit, effect=effect, **given, **fields)
    return cause_doubts.doubt_of_cause(names, cause, taken)


@records.of
def sentences_about_all_causes():
    kinds = [kind for kind, row in doubt_table().items() if "identify" in row.reads and row.stage in (2, 3, 4)]
    found = {}
    for kind in kinds:
        joints = (
            () if kind in ("tilt", "late", "mounting", "time-scale", "low-pass", "push", "force", "swaying") else (1,)
        )
        try:
            found[kind] = said(kind, joints, span=(1.25, 3.5), size=0.123, log=2)
        except KeyError as problem:
            found[kind] = f"other words: {problem}"
    return found


@records.of
def levels_of_causes():
    found = {}
    for kind in ("gain", "torque-sign", "load-friction", "drift", "mounting", "stribeck"):
        for effect in (0.01, 0.0101, 0.05, 0.0505):
            for taken in (None, 0.0):
                found[f"{kind} {effect} {taken}"] = said(kind, effect=effect, taken=taken).level
    return found


@records.of
def sentences_with_joints_values_and_rivals():
    rivals = [
        found_cause("zero", (0, 2)),
        found_cause("tilt", ()),
        found_cause("gain", ()),
        found_cause("zero", (0, 2)),
        found_cause("drift", (2,)),
        found_cause("late", ()),
    ]
    return [
        said("elasticity", (0, 1, 2)), said("elasticity", (0, 2)), said("gain", (0,), names=("waist",), shares=(0.6, 0.1, 0.2)),
        said("gain", (1,), rivals=tuple(rivals)), said("gain", (1,), rivals=tuple(rivals[:1])), said("tilt", (), value=(0.03, -0.04), rivals=tuple(rivals[1:2])),
        said("zero-turn", (2,), value=None, deviation=None, number=-90.0), said("gain", (1,), shares=(0.2, 0.3, 0.9)), said("late", (), value=-0.05),
    ]  # fmt: skip


@records.of
def delays_that_a_fit_has_taken_off():
    def delay(value, taken, **options):
        found = said("late", (), value=value, shift=value, taken=taken, effect=0.03, **options)
        return [found.level, str(found)]

    cases = [
        (0.02, 0.02),
        (0.02, 0.0221),
        (0.02, 0.0219),
        (0.0299, 0.0299),
        (0.0301, 0.0301),
        (-0.05, -0.0548),
        (-0.05, -0.0552),
        (0.02, -0.02),
    ]
    found = {str(case): delay(*case) for case in cases}
    late = [found_cause("late", (), value=np.array([value]), fit=stub()) for value in (0.0079, -0.0079)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cause_doubts, "doubt_of_cause", lambda names, cause, taken: cause.kind)
        long = found_cause("late", (), value=np.array([-0.0081]))
        kept = cause_doubts.cause_doubts((), [*late, long, found_cause("late", ()), found_cause("gain")], 0.0)
    return found | {"kept": kept}


@records.of
def laws_that_belong_to_the_robot():
    def law(kind, joints, ratio):
        fits = [
            stub(left=np.full((4, 3), size), spread=np.full((4, 3), 2.0), live=np.ones(3, bool))
            for size in (1.0, ratio)
        ]
        return FoundCause(kind, joints, 1.0, 9.0, fits[0], fits[1])

    cases = {
        "order": [law("stribeck", (1,), 0.9), law("load-friction", (0, 1, 2), 0.9), law("gain", (0,), 0.1)], "limit": [law("stribeck", (1,), 0.951)],
        "at": [law("stribeck", (1,), 0.949)], "twice": [law("stribeck", (1,), 0.9), law("stribeck", (2,), 0.8), law("load-friction", (1,), 0.7)],
        "three": [law("load-friction", (k,), 0.5) for k in range(3)],
    }  # fmt: skip
    return {name: cause_doubts.laws_of_the_robot(case) for name, case in cases.items()}


# ── Assumed causes


@records.of
def causes_that_are_assumed_in_words():
    names = ("waist", "slide", "elbow")
    good = [
        "tilt",
        ["zero:elbow", "tilt", "gain:slide"],
        ["exchanged-torques:elbow:waist"],
        ["drift : slide", "elasticity", "warming:waist"],
        ["gain:waist", "gain:slide"],
        [],
    ]
    bad = [
        "low-pass", "wind", "gain", "gain:hand", "gain:waist:slide", "tilt:waist", "exchanged-torques:waist", "exchanged-torques:waist:waist",
        ["gain:waist", "gain:waist"], ["elasticity", "elasticity:waist"], ["elasticity:waist", "elasticity"], "load-change", "no-gravity", "late-joint",
    ]  # fmt: skip
    return [
        [wanted_causes(given, names) for given in good],
        [refusal(lambda given=given: wanted_causes(given, names)) for given in bad],
        dict(JOINTS_OF_CAUSE),
    ]


@records.of
def settings_and_priors_of_assumed_causes():
    logs = [samples_of(), samples_of(5.0, 40.0)]
    options = (FitOptions(), FitOptions(2.0, 0.02, -0.01))
    settings = [begin_settings(3, logs, option) for option in options]
    from twistwrench.core.estimation.least_squares import Prior

    prior = prior_with(
        Prior(np.array([1.0, 2.0]), np.array([3.0, 4.0])),
        np.stack([drawn(6, 3), np.zeros((6, 3))], axis=2),
        drawn(6, 3, seed=1) * [5, 2, 1],
    )
    clocks = assumed_module._with_clock([samples_of()], 2.0)
    return [
        [[s.cutoff, s.friction_speed, s.shift] for s in settings],
        prior,
        [[s.start, s.rate, len(s)] for s in clocks],
    ]


@records.of(relative=1e-3)
def assumed_causes_at_their_first_values():
    found = {}
    cases = {
        "gain": ["gain:elbow"], "zero": ["zero:waist"], "tilt": ["tilt"], "late": ["late"], "drift": ["drift:waist", "tilt"], "sign": ["torque-sign:slide"],
        "exchanged": ["exchanged-torques:waist:elbow"], "none": ["elasticity:elbow", "stribeck", "load-friction", "time-scale", "zero-turn:elbow"],
    }  # fmt: skip
    other = samples_of(3.0, 40.0, 50.0)
    for fault, words in cases.items():
        wanted = wanted_causes(words, robot().model.velocity_names)
        assumed = AssumedCauses.from_logs(UnknownParameters(robot()), faulty(fault), wanted, SETTINGS, NONE_DEAD)
        samples, gravity = assumed.corrected_samples()
        tilts = "tilt" in words  # its two axes are arbitrary: only sizes are recorded
        sizes = [np.linalg.norm(c.beta) if c.wanted.kind == "tilt" else c.beta for c in assumed.causes]
        steps = 0.01 * np.arange(1.0, 1 + sum(len(c.beta) for c in assumed.causes))
        shifted = assumed.with_step(0.0 * steps if tilts else steps)
        columns = assumed.columns(100.0)
        (corrected,) = assumed.correct_other_logs([other])
        found[fault] = {
            "causes": [[c.wanted.kind, size, c.step, c.number] for c, size in zip(assumed.causes, sizes, strict=True)], "gravity": gravity, "rates": [s.rate for s in samples],
            "texts": [assumed.text_of(c.wanted) for c in assumed.causes], "q": packed(samples[0].q), "tau": packed(samples[0].tau),
            "shifted": packed(shifted.corrected_samples()[0][0].tau, shifted.corrected_samples()[0][0].q), "other": packed(corrected.q, corrected.tau),
            "columns": [columns.shape, np.linalg.norm(columns)] if tilts else packed(columns), "speed": assumed.base.unknown.stribeck_speed, "friction": assumed.base.unknown.friction,
        }  # fmt: skip
    return found


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
