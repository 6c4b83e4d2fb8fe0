"""Identification: parameters, rows, settings, fits and consistent bodies of an arm in which nothing is equal, on record."""

from __future__ import annotations

import functools
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from leaning_arm import leaning_arm, packed, short_arm, states_at, torques_at
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.estimation.least_squares import NormalEquations, Prior
from twistwrench.identification import consistent as consistent_module
from twistwrench.identification import parameters as parameters_module
from twistwrench.identification import rows as rows_module
from twistwrench.identification.base_columns import BaseColumns, consecutive_slices
from twistwrench.identification.consistent import (
    ConsistentRobot,
    PositiveFit,
    PositivePrior,
    PositiveProblem,
    consistent_robot,
    file_with_drives,
    model_residuals,
)
from twistwrench.identification.essential_groups import essential_groups
from twistwrench.identification.hyperparameters import (
    AssumedCause,
    FitOptions,
    FitSettings,
    SettingRows,
    Trial,
    _typical_sizes,
)
from twistwrench.identification.parameters import (
    BaseParameters,
    UnknownParameters,
    first_parameters,
    group_units,
    parameter_unit,
    turning_joints,
)
from twistwrench.identification.payload import (
    MotorSide,
    known_but_for,
    motor_side,
    payload_body,
    payload_from,
    unknown_of,
)
from twistwrench.identification.rows import FilteredRows, JudgedStates, SteadySamples
from twistwrench.identification.undetermined import undetermined_quantities
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.model.model import Spring
from twistwrench.motion import LogRows

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


ALL_FRICTION = ("offset", "stribeck", "viscous", "coulomb")
COUPLED = MotorSide(
    np.array([[50.0, 0, 0], [0, 30.0, -7.0], [4.0, 0, -20.0]]), np.array([0.1, -0.2, 0.3]), np.array([2.0, 3.0, 5.0])
)


@functools.cache
def robot():
    return short_arm()


@functools.cache
def unknown_with(name):
    known = {"boom.m": 3.3, "elbow.coulomb": 0.7, "slide.motor_inertia": 0.0}
    return {
        "plain": lambda: UnknownParameters(robot()),
        "all friction": lambda: UnknownParameters(robot(), friction=ALL_FRICTION, stribeck_speed=0.17),
        "rigid": lambda: UnknownParameters(robot(), False, ()),
        "known": lambda: UnknownParameters(robot(), known=known),
        "coupled": lambda: UnknownParameters(robot(), friction=ALL_FRICTION, motor_side=COUPLED, stribeck_speed=0.13),
        "weightless": lambda: UnknownParameters(robot().with_gravity([0, 0, 0]), friction=("viscous",)),
        "branched": lambda: UnknownParameters(leaning_arm(), friction=("coulomb", "offset")),
    }[name]()


UNKNOWNS = ("plain", "all friction", "rigid", "known", "coupled", "weightless", "branched")


@functools.cache
def base_with(name):
    return BaseParameters.from_unknowns(unknown_with(name))


# ── Parameters


@records.of
def unknown_parameters_and_their_sizes():
    found = {}
    for name in UNKNOWNS:
        unknown = unknown_with(name)
        nv = unknown.model.nv
        typical = np.arange(1.0, nv + 1), np.arange(2.0, nv + 2) * 3, np.arange(4.0, nv + 4) * 0.7
        found[name] = {
            "names": unknown.names, "of bodies": packed(unknown.of_bodies), "file": packed(unknown.file_values),
            "held": np.flatnonzero(unknown.held), "bodies": unknown.bodies, "coupled": unknown.coupled, "lengths": unknown.lengths,
            "scales": packed(unknown.scales(*typical)), "shares": packed(unknown.shares), "kinds": unknown.kinds[-3:],
            "dry": unknown.coulomb_columns(np.arange(len(unknown.names))[::-1]), "turning": turning_joints(unknown.model),
        }  # fmt: skip
    return found


@records.of
def columns_of_unknown_parameters():
    found = {}
    for name in ("all friction", "coupled", "branched"):
        unknown = unknown_with(name)
        nv, p = unknown.model.nv, len(unknown.names)
        q, dq, ddq = drawn(4, nv, seed=1), 0.3 * drawn(4, nv, seed=2), drawn(4, nv, seed=3)
        speeds = 0.05 + 0.02 * np.arange(nv)
        which = np.arange(p)[::-1][: p // 2 * 2 : 2]
        W = unknown.columns(np.arange(p), q, dq, ddq, speeds)
        found[name] = [
            W, unknown.columns(which, q, dq, ddq, speeds), unknown.columns(np.arange(p), q, dq, ddq, speeds, np.array([1.0, -2.0, 3.0])),
            unknown.drives(np.flatnonzero(unknown.of_bodies < 0), dq, ddq, speeds), W[1, :, unknown.of_bodies < 0],
        ]  # fmt: skip
    return found


@records.of
def groups_of_parameters():
    found = {}
    for name in UNKNOWNS:
        base = base_with(name)
        sizes = 0.5 + np.arange(len(base.unknown.names)) % 7
        found[name] = {
            "names": base.names, "kept": base.kept, "count": base.count, "grouping": packed(base.grouping), "felt": packed(base.felt),
            "held": np.flatnonzero(base.held), "drives": base.drives, "weak": packed(base.weak_sizes(sizes)),
            "file": packed(base.project(base.unknown.file_values)), "units": group_units(base.names, base.unknown.model),
        }  # fmt: skip
    tilted = BaseParameters.from_unknowns(unknown_with("rigid"), seed=3, gravity=np.array([3.0, -4.0, 5.0]))
    upright = BaseParameters.from_unknowns(unknown_with("rigid"), gravity=np.zeros(3))
    return found | {"tilted": tilted.names, "without gravity": upright.names}


@records.of
def independent_columns_and_their_limits():
    a, b, c = drawn(9, 3, seed=4).T
    dependent = [a, np.zeros(9), b, 2 * a - 0.5 * b, 0.9e-9 * c, c + a, 3e-8 * c]
    nearly = [a, b, a + 0.9e-6 * c, a + 1.2e-6 * c * np.linalg.norm(a) / np.linalg.norm(c)]
    found = {"dependent": np.stack(dependent, axis=1), "nearly": np.stack(nearly, axis=1), "none": np.zeros((4, 2))}
    found["small coefficient"] = np.stack([a, b, a + 0.9e-7 * b, b + 1.2e-7 * a], axis=1)
    return {name: parameters_module._independent_columns(W) for name, W in found.items()} | {
        "rounding": parameters_module._without_rounding_errors(np.array([0.9e-12, -1.1e-12, 1.0]))
    }


@records.of
def units_and_first_parameters():
    kinds = ("m", "mcx", "Ixy", "motor_inertia", "viscous", "coulomb", "stribeck", "offset")
    return {
        "units": {kind: [parameter_unit(kind, turning=True), parameter_unit(kind, turning=False)] for kind in kinds},
        "first": first_parameters(["a.m", "b.mcx + 0.2 c.m", "-d.Ixx - e.Iyy"]),
        "of groups": group_units(
            ["slide.viscous + a.m", "waist.viscous", "arm.Ixx + 2 boom.m", "slide.motor_inertia"], robot().model
        ),
        "owner": [parameters_module.speed_owner(np.array(mask)) for mask in ([True, False, True], [True, True, False])],
        "speed": parameters_module.check_speed(3),
    }


@records.of
def unknowns_that_are_refused():
    plain = robot()
    floating = tw.load('<mujoco><worldbody><body><freejoint/><geom size="0.1"/></body></worldbody></mujoco>')
    everything = dict.fromkeys(unknown_with("rigid").names, 1.0)
    return {
        "friction": refusal(lambda: UnknownParameters(plain, friction=("coulomb", "motor_inertia"))),
        "known": refusal(lambda: UnknownParameters(plain, known={"boom.mass": 1.0})),
        "nan": refusal(lambda: UnknownParameters(plain, known={"boom.m": float("nan")})),
        "all": refusal(lambda: UnknownParameters(plain, False, (), known=everything)),
        "speed": [
            refusal(lambda speed=speed: UnknownParameters(plain, stribeck_speed=speed))
            for speed in (0.0, -1.0, float("inf"))
        ],
        "floating": refusal(lambda: UnknownParameters(floating)),
        "still": refusal(lambda: UnknownParameters(tw.load('<robot name="r"><link name="a"/></robot>'))),
    }


@records.of
def names_of_groups():
    base = base_with("rigid")
    p = len(base.unknown.names)
    row = np.zeros((1, p))
    row[0, [3, 7, 12, 20]] = -1.0, 0.123456789, -2.5, 1.0 + 0.9e-6
    positive = np.zeros((1, p))
    positive[0, [5, 3]] = 2.0, -1.0 + 1.1e-6
    found = [
        replace(base, kept=np.array([3]), grouping=row).names,
        replace(base, kept=np.array([5]), grouping=positive).names,
    ]
    return [*found, replace(base, kept=np.array([9]), grouping=0 * row).names]


@records.of
def entries_of_rows():
    found = {"slices": [[s.start, s.stop] for s in consecutive_slices([2, 0, 5])]}
    for name in ("all friction", "coupled", "rigid"):
        base = base_with(name)
        columns = BaseColumns.from_parameters(base)
        q, dq, ddq = drawn(5, 3, seed=5), 0.2 * drawn(5, 3, seed=6), drawn(5, 3, seed=7)
        found[name] = [
            columns.count,
            [len(groups) for groups in columns.groups],
            columns.rows(q, dq, ddq, np.array([0.03, 0.05, 0.08])),
        ]
    return found


# ── Rows of logs


@functools.cache
def samples_of(seconds=9.0, rate=50.0, start=2.5, log=0, cut=False):
    time = start + np.arange(round(seconds * rate)) / rate
    q, _, _ = states_at(time)
    return SteadySamples(start, rate, q, torques_at(robot(), time), 0.0, cut, log)


def summary(samples):
    return [
        samples.start,
        samples.rate,
        len(samples),
        packed(samples.q, samples.tau),
        samples.moved,
        samples.cut,
        samples.log,
        samples.seconds,
    ]


@records.of
def samples_on_a_steady_clock():
    rng = np.random.default_rng(3)
    even = 1.5 + np.arange(200) * 0.02
    times = {
        "even": even, "nearly even": even + 0.9e-3 * 0.02 * np.cos(np.arange(200)), "uneven": even + 1.2e-3 * 0.02 * np.cos(np.arange(200)),
        "moved": even + np.where(np.arange(200) % 9 == 4, 0.0025, 0.0), "jittered": even + 0.004 * rng.uniform(-1, 1, 200),
        "gap": even + np.where(np.arange(200) >= 80, 0.09, 0.0), "pause": even + np.where(np.arange(200) >= 80, 0.11, 0.0),
        "long pause": even + np.where(np.arange(200) >= 190, 3.0, 0.0) + np.where(np.arange(200) >= 65, 1.0, 0.0),
        "short piece": even + np.where(np.arange(200) >= 59, 1.0, 0.0), "piece": even + np.where(np.arange(200) >= 60, 1.0, 0.0),
    }  # fmt: skip
    found = {}
    for name, time in times.items():
        q, _, _ = states_at(time)
        pieces = SteadySamples.pieces(time, q, torques_at(robot(), time), "log.csv")
        found[name] = [summary(piece) for piece in pieces] + [rows_module.pause_lengths(time)]
    long_and_short = np.concatenate([np.arange(700) * 0.01, 20.0 + np.arange(65) * 0.01, 30.0 + np.arange(75) * 0.01])
    q, _, _ = states_at(long_and_short)
    found["tenth of the longest"] = [len(piece) for piece in SteadySamples.pieces(long_and_short, q, q, "log.csv")]
    few = np.arange(59) * 0.02
    found["few"] = refusal(lambda: SteadySamples.pieces(few, q[:59], q[:59], "log.csv"))
    found["notes"] = [rows_module.gap_notes(np.array(lengths)) for lengths in ([], [0.1234], [1.5, 2.25])]
    logs = [samples_of(), samples_of(5.0, 80.0)]
    found["together"] = [rows_module.total_seconds(logs), rows_module.lowest_rate(logs)]
    found["interpolated"] = rows_module.interpolate(np.array([0.5, -1.0, 2.5]), np.arange(3.0), drawn(3, 2))
    return found


@records.of
def states_below_a_cutoff():
    found = {}
    for cutoff, rate in ((3.0, None), (1.0, None), (3.0, 11.0), (0.4, 3.0)):
        s = rows_module.states_below(samples_of(), cutoff, rate)
        time, tau = rows_module.torques_below(samples_of(), cutoff)
        found[f"{cutoff} {rate}"] = [
            s.rate, len(s.time), packed(s.time), packed(s.q), packed(s.dq), packed(s.ddq), packed(s.tau), packed(time), packed(tau),
            [[(k := rows_module.kept_rows(s, cutoff, most, cut=cut)).start, k.stop, k.step] for most in (12, 1e4) for cut in (False, True)],
        ]  # fmt: skip
    found["borders"] = [
        rows_module.border_of(rate, 3.0, count, cut=cut)
        for rate in (50.0, 9.0, 9.1)
        for count in (300, 39)
        for cut in (False, True)
    ]
    two = [samples_of(), samples_of(4.0, 50.0, 30.0, cut=True)]
    for most, whole in ((40, False), (30, True)):
        listed = rows_module.states_with_rows(two, 2.0, most, whole=whole)
        found[f"together {most} {whole}"] = [[len(s.time), rows.start, rows.stop, rows.step] for _, s, rows in listed]
    return found


@records.of
def candidate_cutoffs():
    cases = {
        "one": ([samples_of()], 10), "many rows": ([samples_of()], 200), "none": ([samples_of()], 2000), "fast": ([samples_of(9.0, 500.0)], 10),
        "two": ([samples_of(), samples_of(2.0)], 10), "pieces": ([samples_of(cut=True), samples_of(6.0, cut=True)], 10),
        "piece and log": ([samples_of(3.0), samples_of(9.0, cut=True)], 10), "long": ([samples_of(41.0)], 10),
    }  # fmt: skip
    return {name: rows_module.cutoffs(samples, rows) for name, (samples, rows) in cases.items()}


@functools.cache
def base_with_spring():
    model = replace(
        robot().model,
        springs=(Spring((("waist", 1.0), ("elbow", -0.5)), 40.0, 0.3), Spring((("slide", 1.0),), 90.0, -0.1)),
    )
    return BaseParameters.from_unknowns(UnknownParameters(tw.Robot(model), friction=ALL_FRICTION))


@records.of
def rows_of_equations():
    found = {}
    logs = [samples_of(), samples_of(5.0, 40.0, 100.0)]
    for name, base in (
        ("plain", base_with("all friction")),
        ("springs", base_with_spring()),
        ("coupled", base_with("coupled")),
    ):
        speeds = np.array([0.03, 0.05, 0.08])
        rows = FilteredRows.from_samples(base, logs, 2.0, speeds, 120)
        other = np.array([0.01, 0.2, 0.02])
        dry = base.unknown.coulomb_columns(base.kept)
        found[name] = {
            "W": rows.W, "time": packed(rows.time), "log": packed(rows.log), "known": rows.known, "torques": rows.torques(0.0),
            "earlier": rows.torques(-0.03), "later": rows.torques(0.17), "position": packed(rows.position), "speed": packed(rows.speed),
            "acceleration": packed(rows.acceleration), "dry": [packed(rows.coulomb(column, joints, other)) for column, joints in dry],
        }  # fmt: skip
        rows.dead = np.array([False, True, False])
        rows._coulomb.clear()
        found[name] |= {
            "dead": rows.torques(0.01),
            "dead dry": [packed(rows.coulomb(column, joints, speeds)) for column, joints in dry],
        }
        judged = JudgedStates.from_samples(base, [samples_of(), samples_of(3.0)], 1.5, speeds)
        found[name] |= {
            "judged": [
                judged.W,
                judged.known,
                packed(judged.log),
                packed(judged.time),
                [len(s.time) for s in judged.states],
            ]
        }
    q, dq, ddq = drawn(3, 3, seed=8), drawn(3, 3, seed=9), drawn(3, 3, seed=10)
    found["spring torques"] = rows_module.spring_torques(base_with_spring(), q, dq, ddq)
    return found


# ── Settings


@functools.cache
def setting_rows(**options):
    logs = [samples_of(), samples_of(6.0, 50.0, 100.0)]
    dead = np.array([False, False, False])
    return SettingRows(base_with("plain"), logs, FitOptions(**options), dead)


def weak_prior(source):
    sizes = source.base.unknown.scales(*source.typical())
    return Prior(source.base.project(source.base.unknown.file_values), source.base.weak_sizes(sizes))


def shown(settings):
    return [settings.cutoff, settings.friction_speed, settings.shift, str(settings)]


@records.of(relative=1e-5)
def settings_of_fits():
    found = {}
    for options in ({}, {"cutoff": 3.0}, {"friction_speed": 0.02, "cutoff": 2.0}, {"shift": -0.004, "cutoff": 2.0}):
        source = setting_rows(**options)
        prior = weak_prior(source)
        shares = []
        chosen = source.choose(prior, [range(5)] if options else [range(5), (0, 1, 3)], shares.append)
        found[str(options)] = {
            "tried": source.tried, "usual": source.usual_speed, "typical": source.typical(), "chosen": list(map(shown, chosen)),
            "dry": source.coulomb, "progress": shares,
        }  # fmt: skip
    return found


@records.of
def scores_of_settings():
    source = setting_rows()
    prior = weak_prior(source)
    speeds = np.array([0.02, 0.05, 0.1])
    found = {}
    for cutoff in (2.0, 5.0):
        for shift in (0.0, 0.01):
            for speed in (source.usual_speed, speeds):
                for blocks in ((0, 1, 2, 3, 4), (0, 2, 4), (3,)):
                    settings = FitSettings(cutoff, speed, shift)
                    scores = [source._score(settings, prior, blocks), source._judged_score(prior, blocks, settings)]
                    found[f"{cutoff} {shift} {speed} {blocks}"] = scores
    time = np.array([2.5, 4.3, 11.4, 100.0, 105.9])
    found["folds"] = source.folds(np.array([0, 0, 0, 1, 1]), time)
    trial = Trial(source, FitSettings(2.0, speeds, 0.01), 60)
    x = prior.mean + 0.1 * prior.size * drawn(source.base.count, seed=11)
    found["trial"] = [
        packed(trial.fold),
        [[s.start, s.stop] for s in trial.places],
        trial.W,
        trial.tau,
        trial.changes(x),
    ]
    fixed = Trial(setting_rows(cutoff=2.0, friction_speed=0.02, shift=0.0), FitSettings(2.0, np.full(3, 0.02), 0.0), 60)
    found["fixed"] = [fixed.changes(x).shape, fixed.W]
    partly = Trial(setting_rows(cutoff=2.0, shift=0.0), FitSettings(2.0, np.array([0.02, 0.05, 0.03]), 0.0), 60)
    found["partly"] = partly.changes(x)
    found["sizes"] = _typical_sizes(np.array([[3.0, 0.001, 0.0], [4.0, -0.002, 0.0]])), _typical_sizes(np.zeros((2, 2)))
    return found


@records.of
def better_settings():
    """The other settings are preferred if the gain exceeds 0.002 per joint, and what chance gives in so many rows."""
    found = {}
    for seconds, gain in ((1e4, 0.0059), (1e4, 0.0061), (10.0, 0.14), (10.0, 0.16)):
        scores = {"present": gain, "other": 0.0}
        logs = [SimpleNamespace(seconds=seconds)]
        source = SimpleNamespace(
            samples=logs, dead=np.zeros(3), _score=lambda s, prior, blocks, scores=scores: scores[s.name]
        )
        present, other = SimpleNamespace(name="present", cutoff=2.0), SimpleNamespace(name="other", cutoff=2.0)
        found[f"{seconds} {gain}"] = SettingRows._better(source, present, other, None, ()).name
    return found


@records.of
def texts_of_settings_and_assumed_causes():
    causes = [
        AssumedCause("tilt", (), 1.23456, (1.0, 1.5), "°", (0.1, -0.2, -9.8)), AssumedCause("gain", ("waist",), 1.05, None, ""),
        AssumedCause("torque-sign", ("slide", "elbow")), AssumedCause("zero", tuple("abcdef"), -3.21, (-4.0, -2.0), "°"),
    ]  # fmt: skip
    settings = FitSettings(3.0, np.array([0.02, 0.05, 0.1]), -0.0034)
    return [
        list(map(str, causes)),
        str(settings),
        str(replace(settings, shift=0.0034)),
        str(replace(settings, shift=0.0)),
    ]


# ── Essential groups


@records.of
def essential_groups_of_rows():
    rng = np.random.default_rng(5)
    W = rng.normal(size=(60, 1, 7)) * [3.0, 1.0, 0.02, 2.0, 0.5, 1.0, 0.1]
    x = np.array([1.0, -2.0, 0.5, 0.0, 0.7, 3.0, 0.2])
    tau = W @ x + 0.05 * rng.normal(size=(60, 1))
    folds = [NormalEquations.from_rows(W, tau, rows=slice(12 * k, 12 * (k + 1))).together() for k in range(5)]
    empty = (0 * folds[0][0], 0 * folds[0][1], 0.0)
    names = [f"g{k}" for k in range(7)]
    size = np.array([4.0, 3.0, 5.0, 2.0, 6.0, 7.0, 1.0])
    held = np.arange(7) == 5
    values = np.array([9.0, 9, 9, 9, 9, 2.9, 9])
    return [
        essential_groups(names, folds, size, held, values),
        essential_groups(names, [*folds, empty], size, ~(np.arange(7) < 4), x),
        essential_groups(names, folds, 0.01 * size, np.zeros(7, bool), x),
    ]


# ── Consistent bodies


@functools.cache
def folds_of(name="plain"):
    """Normal equations of fifths of rows of a log, in units of a thousandth of each joint's torque."""
    base = base_with(name)
    rows = FilteredRows.from_samples(base, [samples_of()], 3.0, np.full(3, 0.03), 300)
    tau = rows.torques(0.0)
    root = np.ones(tau.shape) / (0.01 * np.sqrt((tau**2).mean(axis=0)))
    edges = np.linspace(0, len(tau), 6).astype(int)
    return [NormalEquations.from_rows(rows.W, tau, base.felt, root, slice(a, b)) for a, b in pairwise(edges)]


def consistent_inputs(name="plain"):
    base = base_with(name)
    folds = folds_of(name)
    sizes = base.unknown.scales(np.array([20.0, 50.0, 5.0]), np.array([1.0, 0.3, 1.2]), np.array([6.0, 2.0, 8.0]))
    prior = Prior(base.project(base.unknown.file_values), base.weak_sizes(sizes))
    N, c, _ = consistent_module.sum_of([fold.together() for fold in folds])
    return base, prior.solve(N, c), sizes, folds, prior


@records.of
def bodies_made_thick():
    moment = np.array([[0.03, 0.002, -0.001], [0.002, 0.05, 0.003], [-0.001, 0.003, 0.04]])
    bodies = {
        "solid": SpatialInertia.from_com(2.0, (0.1, -0.2, 0.3), moment), "none": SpatialInertia.zero(),
        "point": SpatialInertia.from_com(2.0, (0.1, -0.2, 0.3), np.zeros((3, 3))), "light": SpatialInertia.from_com(9e-9, (0.1, 0, 0), 1e-9 * moment),
        "heavier": SpatialInertia.from_com(11e-9, (0.1, 0, 0), 1e-9 * moment), "rod": SpatialInertia.from_com(2.0, (0, 0, 0.3), np.diag([0.05, 0.05, 0.0])),
        "plate": SpatialInertia.from_com(2.0, (0, 0.1, 0.3), np.diag([0.03, 0.05, 0.08])), "small": SpatialInertia.from_com(2.0, (0.1, 0, 0), 1e-6 * moment),
        "thin": SpatialInertia.from_com(2.0, (0, 0, 0.3), np.diag([0.05, 0.05 + 8e-5, 1.3e-4])),
    }  # fmt: skip
    found = {name: consistent_module._thicken(G, 10.0, 0.9) for name, G in bodies.items()}
    return found | {"pseudo": consistent_module.pseudo_inertia(bodies["solid"].parameters)}


@records.of
def problem_of_consistent_bodies():
    found = {}
    for name in ("plain", "known", "all friction"):
        base, values, sizes, folds, _ = consistent_inputs(name)
        prior = PositivePrior.from_values(base, values, sizes)
        problem = PositiveProblem(base, prior, *consistent_module.sum_of([fold.together() for fold in folds]), sizes)
        J = 1.02 * prior.bodies + np.diag([0.001, 0.002, 0.003, 0.01])
        x = np.where(prior.positive, prior.drives * 1.3, 0.01 * sizes * drawn(len(sizes), seed=12))
        L = np.linalg.cholesky(J)
        gradient, hessian = problem._derivatives(J, L, x, 30.0)
        step = 0.05 * drawn(len(gradient), seed=13)
        J_new, x_new = problem._take_step(L, x, step)
        found[name] = {
            "drives": packed(prior.drives), "bodies": packed(prior.bodies), "positive": np.flatnonzero(prior.positive), "repaired": prior.repaired,
            "H": problem.H, "g": packed(problem.g), "y": problem.y, "values": packed(problem._values(J, x)), "gradient": packed(gradient),
            "hessian": hessian, "J": packed(J_new), "x": packed(x_new), "costs": [problem.cost(J, x, strength) for strength in (1.0, 30.0)],
            "no cost": [problem.cost(J, -x, 1.0), problem.cost(-J, x, 1.0), problem.cost(J * np.array([1, 1, 1, 0.0]), x, 1.0)],
            "tangents": problem._tangents(L, x),
        }  # fmt: skip
    return found


@records.of(relative=1e-4)
def consistent_robots():
    found = {}
    for name, strength in (("plain", None), ("known", 3.0), ("all friction", 100.0), ("coupled", 50.0)):
        base, values, sizes, folds, prior = consistent_inputs(name)
        together = [fold.together() for fold in folds]
        robot_found = consistent_robot(base, values, sizes, together, prior, strength)
        residuals = model_residuals(base, folds, prior, values, sizes, robot_found.fit.strength)
        model = robot_found.robot.model
        fit = robot_found.fit
        problem = PositiveProblem(
            base, PositivePrior.from_values(base, values, sizes), *consistent_module.sum_of(together), sizes
        )
        C = 0.01 * np.diag(prior.size**2) / (1 + prior.size**2)
        found[f"{name} {strength}"] = {
            "strength": fit.strength, "values": packed(fit.values), "cost": fit.cost, "curve": robot_found.curve,
            "of file": robot_found.of_file, "held out": robot_found.held_out, "repaired": robot_found.repaired,
            "residuals": [residuals.file, residuals.with_friction, residuals.identified, residuals.consistent],
            "masses": [float(G.mass) for G in robot_found.inertias], "armature": model.armature,
            "friction": [model.friction.viscous, model.friction.coulomb, model.friction.static, model.friction.stribeck],
            "kinds": {kind: robot_found.of_joints(kind) for kind in ("viscous", "stribeck", "offset", "motor_inertia")},
            "several": robot_found.of_several_joints, "mass": robot_found.value("boom.m"),
            "covariance": packed(problem.covariance(fit, C)), "drives": packed(file_with_drives(base, together[0], prior)),
        }  # fmt: skip
    return found


@records.of
def groups_outside_their_intervals():
    base = base_with("plain")
    values = base.unknown.file_values.copy()
    fit = PositiveFit(2.0, values, 0.0, 0)
    found = ConsistentRobot(base, fit, ((2.0, 0.1),), 0.2, ())
    x = base.project(values)
    deviations = 0.1 + 0.05 * (np.arange(base.count) % 3)
    inside = np.stack([x - 0.2, x + 0.3], axis=1)
    some = inside.copy()
    some[[2, 5, 9, 11, 14]] += np.array([[0.5], [-0.6], [0.9], [0.31], [-1.5]])
    one = inside.copy()
    one[7] -= 0.31
    return [found.outside(inside, deviations), found.outside(some, deviations), found.outside(one, deviations)]


@records.of
def strengths_that_are_offered():
    check = consistent_module.check_strength
    refused = [refusal(lambda strength=strength: check(strength)) for strength in (0.0099, 100001.0)]
    return [
        refused,
        [check(strength) for strength in (None, 0.01, 1e5)],
        consistent_module._path_to(3.0),
        consistent_module._path_to(10.0),
    ]


# ── Motors' side, payload


@records.of
def sides_of_motors():
    rows = LogRows(
        np.arange(4.0), drawn(4, 3, seed=14), drawn(4, 3, seed=15), drawn(4, 3, seed=16), drawn(4, 3, seed=17)
    )
    named = replace(COUPLED, names=("m1", "m2", "m3"), rates=np.array([[1.0, 0, 0], [0, 2.0, 3.0], [4.0, 0, 5.0]]))
    no_own = MotorSide(np.array([[0.0, 3.0, -6.0], [2.0, 0, 0], [0, 0, 4.0]]), np.zeros(3), np.ones(3))
    found = {}
    for name, side in (("coupled", COUPLED), ("named", named), ("no own joint", no_own)):
        converted = side.of_joints(rows)
        bare = side.of_joints(replace(rows, dq=None, ddq=None, tau=None))
        found[name] = [
            converted.q, converted.dq, converted.ddq, converted.tau, bare.q, bare.dq, bare.tau, side.coupled_rates, side.coupled_motors, side.is_of_joints,
        ]  # fmt: skip
    ones = np.ones(3)
    sides = [
        MotorSide(np.eye(3), 0 * ones, ones),
        MotorSide(np.eye(3), 0.1 * ones, ones),
        MotorSide(np.eye(3), 0 * ones, 2 * ones),
    ]
    sides.append(MotorSide(np.diag([1.0, -1.0, 1.0]), 0 * ones, ones))
    found["of joints"] = [side.is_of_joints for side in sides]
    found["singular"] = [
        refusal(lambda R=R: MotorSide(R, 0 * ones, ones)) for R in (np.diag([1.0, 0, 1]), np.diag([1.0, np.nan, 1]))
    ]
    return found


@records.of
def motor_sides_from_actuator_files():
    model = robot().model
    texts = {
        "all": "actuators:\n  waist: {ratio: 50}\n  elbow: {ratio: -20}\n  slide: {ratio: 300 rad/m}\n"
        "log: {side: motor, joints: {waist: {zero: 0.1 rad, sign: -1, gain: 2 N m/A}, elbow: {coupled: {waist: 3}}}}\n",
        "motor": "actuators:\n  waist: {ratio: 50}\n  elbow: {ratio: -20}\nlog: {side: motor}\n",
        "joint": "actuators:\n  waist: {ratio: 50}\nlog: {side: joint}\n",
        "coupled": "actuators:\n  waist: {ratio: 50}\n  elbow: {ratio: -20, coupled: {waist: 3}}\nlog: {side: motor}\n",
    }
    found = {}
    for name, text in texts.items():
        try:
            side = motor_side(model, text)
        except tw.ModelError as problem:
            found[name] = str(problem)
            continue
        found[name] = [side.ratios, side.zero, side.gain, side.names, side.rates]
    return found


@records.of
def payloads():
    arm = robot()
    found = {
        "body": payload_body(arm, "grip"),
        "known": known_but_for(arm.with_armature({"waist": 0.3, "elbow": 0.05}), "arm"),
    }
    found["base"] = refusal(lambda: payload_body(arm, "plinth"))
    options = {"motor_inertia": False, "friction": ("viscous",), "motor_side": None, "stribeck_speed": 0.2}
    unknown = unknown_of(arm, known={"waist.viscous": 3.0}, payload_only="grip", **options)
    found["held"] = {
        name: unknown.file_values[k]
        for k, name in enumerate(unknown.names)
        if unknown.held[k] and not name.startswith("pillar")
    }
    plain = unknown_of(arm, known={"waist.viscous": 3.0}, payload_only=None, **options)
    found["plain"] = [plain.motor_inertia, plain.friction, dict(plain.known), plain.stribeck_speed]
    base = BaseParameters.from_unknowns(unknown)
    load = SpatialInertia.from_com(1.3, (0.03, -0.05, 0.08), np.diag([0.004, 0.005, 0.006]))
    heavier = arm.with_payload(load, "grip")
    values = unknown.file_values.copy()
    i = arm.model.frame("grip").body
    own = unknown.of_bodies // 10 == i
    values[own] = heavier.parameters[unknown.of_bodies[own]]
    A = drawn(base.count, base.count, seed=18)
    payload = payload_from(arm, "grip", base, base.project(values), 1e-4 * A @ A.T)
    found["payload"] = payload.to_dict()
    found["groups"] = base.names
    return found


# ── What no log determines


@records.of
def quantities_that_no_log_determines():
    found = {name: undetermined_quantities(base_with(name), 0.02) for name in UNKNOWNS}
    found["fed forward"] = undetermined_quantities(base_with("rigid"), 0.99e-3)
    found["just measured"] = list(undetermined_quantities(base_with("rigid"), 1.01e-3))
    vertical = tw.load(
        '<robot name="v"><link name="a"/><link name="b"><inertial><origin xyz="0.2 0.1 0.3"/><mass value="2"/>'
        '<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0.02" iyz="0.03"/></inertial></link>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    found["vertical"] = undetermined_quantities(BaseParameters.from_unknowns(UnknownParameters(vertical)), 0.02)
    return found


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
