"""Identification: doubts about a fit at both sides of their limits, verdicts, reports, payloads and written files, on record."""

from __future__ import annotations

import functools
import importlib
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from leaning_arm import SHORT, packed, short_arm, states_at, torques_at
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.doubts import doubt, verdict_from_doubts
from twistwrench.core.estimation.cross_validation import HeldOut, HeldOutRows
from twistwrench.core.estimation.least_squares import Prior
from twistwrench.core.third_party.workers import Failure
from twistwrench.identification import actuator_text, body_changes, log_windows, payload, pictures, write
from twistwrench.identification.body_changes import BodyChanges, LoneChange
from twistwrench.identification.consistent import ConsistentRobot, PositiveFit
from twistwrench.identification.diagnosis.diagnose import WantedCause
from twistwrench.identification.doubts import column_doubts, common_gain, fit_doubts
from twistwrench.identification.doubts.fitted_log import _position_ranges
from twistwrench.identification.hyperparameters import AssumedCause, FitOptions
from twistwrench.identification.log_windows import LogSource
from twistwrench.identification.parameters import BaseParameters, UnknownParameters
from twistwrench.identification.payload import MotorSide
from twistwrench.identification.result import _without_infinities, without_links
from twistwrench.identification.views import identified_robot as view
from twistwrench.mechanics.bodies.inertia import SpatialInertia

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
stub = SimpleNamespace
identify = importlib.import_module("twistwrench.identification.identify")  # the package has a function of this name


def drawn(*shape, seed=0):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, shape)


OPTIONS = {"cutoff": 4.0, "shift": 0.0, "friction_speed": 0.03}


@functools.cache
def robot():
    return short_arm()


def log_of(seconds=13.0, rate=50.0, start=0.5, of=None, **changes):
    """A log of the short arm, or of the robot ``of``."""
    time = start + np.arange(round(seconds * rate)) / rate
    q, _, _ = states_at(time)
    tau = torques_at(of or robot(), time)
    return tw.Motion(time, changes.get("q", q), tau=changes.get("tau", tau), robot=robot(), in_seconds=True)


@functools.cache
def identified():
    """An identification, and the rows with the fit to them from which its doubts come."""
    fits = []
    with pytest.MonkeyPatch.context() as patch:
        original = identify.doubts_of
        patch.setattr(identify, "doubts_of", lambda fit: fits.append(fit) or original(fit))
        found = identify.identify(robot(), log_of(), **OPTIONS)
    return found, fits[0]


def fitted():
    _, fit = identified()
    return fit


def kinds(doubts):
    return [[d.kind, d.level, list(d.joints), d.sentence] for d in doubts]


# ── Columns


def rows_stub(q=None, tau=None, log_count=1, **fields):
    """What doubts about columns read of a fit: three joints, of which the columns are given."""
    time = np.arange(400) * 0.02
    default_q, _, _ = states_at(time)
    q = default_q if q is None else q
    tau = torques_at(robot(), time) if tau is None else tau
    logs = [stub(q=q, tau=tau, windows=[stub(q=q)]) for _ in range(log_count)]
    names = ("waist", "slide", "elbow")
    base = {
        "logs": logs, "names": names, "dead": np.zeros(3, bool), "q": q, "settings": stub(cutoff=5.0), "rate": 50.0,
        "acceleration": np.full((10, 3), 2.0), "joints": lambda indices: [names[k] for k in indices],
    }  # fmt: skip
    return stub(**(base | fields))


@records.of
def doubts_about_columns():
    time = np.arange(400) * 0.02
    q, _, _ = states_at(time)
    tau = torques_at(robot(), time)
    still = np.tile(q[:1], (400, 1))
    one_still = np.where(np.arange(3) == 1, q[:1], q)
    clipped = np.clip(tau, -1e9, np.quantile(tau, 0.8, axis=0))
    copied = tau.copy()
    copied[:, 2] = -1.5 * tau[:, 0]
    copied[3, 2] = 0.0
    same = tau.copy()
    same[:, 1] = tau[:, 0]
    mostly = copied.copy()
    mostly[:5, 2] = 0.0
    moved_alike = q.copy()
    moved_alike[:, 2] = q[:, 0]
    scaled = q.copy()
    scaled[:, 2] = 0.5 * q[:, 0]
    cases = {
        "plain": rows_stub(), "still": rows_stub(still, np.tile(tau[:1], (400, 1))), "still with torques": rows_stub(still),
        "one still": rows_stub(one_still), "dead": rows_stub(dead=np.array([False, True, False])), "dead and still": rows_stub(one_still, dead=np.array([False, True, True])),
        "saturated": rows_stub(tau=clipped), "copied": rows_stub(tau=copied), "the same": rows_stub(tau=same), "mostly": rows_stub(tau=mostly),
        "copied, dead": rows_stub(tau=copied, dead=np.array([False, False, True])), "moved alike": rows_stub(moved_alike), "scaled": rows_stub(scaled),
    }  # fmt: skip
    found = {name: kinds(column_doubts.column_doubts(case)) for name, case in cases.items()}
    for grid, size in ((0.002, 2.0), (0.002, 0.3), (0.004, 0.3), (0.01, 2.0)):
        coarse = np.round(q / grid) * grid
        found[f"grid {grid} {size}"] = kinds(
            column_doubts._coarse_positions(rows_stub(coarse, acceleration=np.full((10, 3), size)))
        )
    return found


@records.of
def grids_at_their_limit():
    """Noise of accelerations at 15 % of them, a little below and above; no accelerations; no grid."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        for grid, size in ((1.0e-3, 1.0), (1.0e-3, 0.0), (0.0, 1.0)):
            patch.setattr(column_doubts, "quantum", lambda _, grid=grid: grid)
            noise = grid / np.sqrt(12.0) * (2 * np.pi * 5.0) ** 2 * np.sqrt(2 * 5.0 / 50.0 / 5.0)
            for ratio in (0.99, 1.01):
                accelerations = np.full((4, 3), size * noise / 0.15 / ratio)
                found[f"{grid} {size} {ratio}"] = kinds(
                    column_doubts._coarse_positions(rows_stub(acceleration=accelerations))
                )
    return found


# ── Common gain


@records.of
def gains_of_all_torques():
    fit = fitted()
    found = {}
    for gain in (1.0, -1.0, 0.2, 3.9, 0.5):
        scaled = replace(fit, tau=gain * fit.tau, x=gain * fit.x)
        found[str(gain)] = [[d.kind, d.level, d.value, d.sentence] for d in common_gain.gain_of_all(scaled)]
    dead = np.array([False, True, False])
    found["dead"] = [
        [d.kind, d.value] for d in common_gain.gain_of_all(replace(fit, tau=-fit.tau * ~dead, x=-fit.x, dead=dead))
    ]
    found["noise"] = kinds(common_gain.gain_of_all(replace(fit, tau=-fit.tau + 60 * drawn(*fit.tau.shape))))
    return found


@records.of
def units_of_all_torques():
    fit = fitted()
    gains = [1e3, 980.0, 979.0, 1e-3, 10.197, 0.10197, 9.80665, 4.4482, 0.73756, 8.8507, 1.35582, 0.112985, 1.3831, 2.0]
    return {str(gain): [[d.value, d.level, d.sentence] for d in common_gain.unit_doubts(fit, gain)] for gain in gains}


# ── Doubts about the fit


def held_out_of(kind, shares, effort_rms=1.0, rows=()):
    sizes = np.array([400.0, 100.0, 25.0]) * effort_rms
    return HeldOut(kind, np.array(shares) ** 2 * sizes, sizes, ("waist", "slide", "elbow"), rows)


def rows_at(residuals, logs=(0,)):
    """Rows of three joints with these residuals of the last joint, in parts."""
    found = []
    for k, residual in enumerate(residuals):
        count = len(residual)
        measured = np.zeros((count, 3))
        measured[:, 2] = residual
        found.append(
            HeldOutRows(
                1.25 + 2.0 * k + 0.5 * np.arange(count),
                np.full(count, logs[min(k, len(logs) - 1)]),
                measured,
                np.zeros((count, 3)),
            )
        )
    return tuple(found)


@records.of
def residuals_left_unexplained():
    def left(kind, share, training):
        return kinds(
            fit_doubts.left_unexplained(held_out_of(kind, [share] * 3), held_out_of("five-fold", [training] * 3))
        )

    cases = [("five-fold", 0.349, 0.1), ("five-fold", 0.351, 0.1), ("test", 0.351, 0.1), ("test", 0.249, 0.1), ("test", 0.251, 0.1), ("test", 0.119, 0.01),
             ("test", 0.121, 0.01), ("five-fold", 0.3, 0.01)]  # fmt: skip
    return {str(case): left(*case) for case in cases}


@records.of
def residual_doubts_of_fits():
    fit = fitted()
    rows = rows_at([[0.1, -0.7, 0.3], [0.5, 0.9]])
    several = rows_at([[0.1, -0.7, 0.3], [0.5, 0.9]], logs=(0, 1))
    cases = {
        "small": held_out_of("five-fold", [0.09, 0.09, 0.09]), "partly": held_out_of("five-fold", [0.11, 0.11, 0.3], rows=rows), "large": held_out_of("five-fold", [0.5, 0.4, 0.6]),
        "one joint": held_out_of("five-fold", [0.02, 0.02, 0.2]), "just": held_out_of("five-fold", [0.02, 0.101, 0.099]), "test": held_out_of("test", [0.3, 0.3, 0.3], rows=several),
        "no torque": HeldOut("five-fold", np.array([1.0, 2.0, 3.0]), np.array([100.0, 0.0, 200.0]), ("waist", "slide", "elbow")),
    }  # fmt: skip
    found = {}
    for name, held_out in cases.items():
        for loud in (False, True):
            case = replace(fit, held_out=held_out, trained=held_out_of("five-fold", [0.05] * 3))
            found[f"{name} {loud}"] = kinds(fit_doubts._residual_doubts(case, has_known_cause=False, is_loud=loud))
    dead = replace(fit, held_out=cases["one joint"], dead=np.array([False, False, True]))
    found["dead"] = kinds(fit_doubts._residual_doubts(dead, has_known_cause=False, is_loud=True))
    found["known cause"] = kinds(
        fit_doubts._residual_doubts(replace(fit, held_out=cases["large"]), has_known_cause=True, is_loud=True)
    )
    found["when"] = [
        fit_doubts._largest_at(held_out_of("test", [0.1] * 3, rows=r), 2)
        for r in (rows, several, rows_at([[], [0.2, 0.4]]), ())
    ]
    return found


@records.of
def poorly_predicted_joints():
    """Residuals beside 1 % of the effort limits, which are 90 N m, 200 N and 40 N m; ten rows."""
    fit = fitted()
    rows = rows_at([[0.0] * 10])
    found = {}
    for rms in (0.39, 0.41, 0.89, 0.91, 1.99, 2.01):
        sizes = np.full(3, 10.0 * (rms / 0.2) ** 2)
        held_out = HeldOut("five-fold", np.full(3, 10.0 * rms**2), sizes, ("waist", "slide", "elbow"), rows)
        found[str(rms)] = fit_doubts._poorly_predicted(replace(fit, held_out=held_out))
    return found


@records.of
def doubts_about_excitation():
    fit = fitted()
    r = fit.base.count
    size = fit.prior.size
    found = {}
    for count in (4, 5, 7):
        deviations = np.where(np.arange(r) % (r // count) == 0, 0.21 + 0.001 * np.arange(r), 0.19) * size
        found[f"groups {count}"] = kinds(fit_doubts._unexciting(replace(fit, covariance=np.diag(deviations**2))))
    unknown = UnknownParameters(robot(), known={"boom.m": 3.1, "waist.offset": 0.3})
    base = BaseParameters.from_unknowns(unknown)
    sizes = np.ones(base.count)
    held = replace(
        fit, base=base, prior=Prior(sizes, sizes), covariance=np.diag((0.5 + 0.01 * np.arange(base.count)) ** 2)
    )
    found["held"] = kinds(fit_doubts._unexciting(held))
    variance = np.einsum("njk,kl,njl->j", fit.other_motion, fit.covariance, fit.other_motion)
    squares = ((fit.other_motion @ fit.x) ** 2).sum(axis=0)
    shares = np.sqrt(variance / squares)
    found["shares"] = shares
    for joint in range(3):
        for ratio in (0.98, 1.02):
            case = replace(fit, covariance=fit.covariance * (ratio * 0.1 / shares[joint]) ** 2)
            found[f"poor {joint} {ratio}"] = kinds(fit_doubts._poor_predictions(case))
    dead = replace(fit, covariance=1e4 * fit.covariance, dead=np.array([True, False, False]))
    found["dead"] = kinds(fit_doubts._poor_predictions(dead))
    found["ranges"] = [
        _position_ranges(robot(), q)
        for q in (np.array([[0.1, -0.5, 2.5], [0.3, 0.1, 3.5]]), np.array([[-0.4, 0.1, -4.0], [-0.4, 0.3, 1.0]]))
    ]
    found["shares of torques"] = fit.torque_shares
    found["dead shares"] = packed(dead.torque_shares)
    found["names"] = [fit.first_parameters([3, 7]), fit.joints([2, 0])]
    return found


@records.of
def negative_friction_and_inertia():
    fit = fitted()
    names = list(fit.base.names)
    never = fit_doubts._is_never_negative(fit.base)
    found = {"never negative": [names[k] for k in np.flatnonzero(never)]}

    def case(values, deviation=4.01, matters=True, known=False, **fields):
        x = fit.x.copy()
        covariance = fit.covariance.copy()
        for name, value in values.items():
            k = names.index(name)
            x[k] = value
            covariance[k] = covariance[:, k] = 0.0
            covariance[k, k] = (value / deviation) ** 2
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(fit_doubts, "_negative_matters", lambda fit, groups: matters)
            changed = replace(fit, x=x, covariance=covariance, **fields)
            return kinds(fit_doubts._negative_doubts(changed, has_known_cause=known))

    waist = {"waist.coulomb": -0.5}
    found["friction"] = case(waist)
    found["not sure"] = case(waist, deviation=3.99)
    found["known"] = case(waist, known=True)
    found["does not matter"] = case(waist, matters=False)
    found["small"] = case({"waist.coulomb": -0.015})
    found["compensated"] = case({"waist.coulomb": -0.5, "slide.viscous": -2.0})
    found["two of one joint"] = case({"waist.coulomb": -0.5, "waist.viscous": -0.7})
    found["sign"] = case({"slide.coulomb": -1.5, "slide.motor_inertia": -2.0, "elbow.viscous": -0.7})
    found["inertia"] = case({"slide.motor_inertia": -2.0, "elbow.coulomb": -0.4})
    found["one live joint"] = case({"elbow.coulomb": -0.4}, dead=np.array([True, True, False]))
    groups = np.array([names.index("slide.motor_inertia"), names.index("elbow.offset")])
    found["matter"] = [fit_doubts._negative_matters(fit, groups), fit_doubts._negative_matters(fit, np.array([names.index("arm.Ixy - 0.162162 arm.Izz")]))] if "arm.Ixy - 0.162162 arm.Izz" in names else names  # fmt: skip
    found["text"] = fit_doubts._values_text(fit, [4, 2, 11, 12, 18])
    return found


@records.of
def negative_kinetic_energy():
    fit = fitted()
    names = list(fit.base.names)
    k = names.index("slide.motor_inertia")
    found = {"plain": kinds(fit_doubts._negative_energy(fit))}
    for value in (-30.0, -9.0):
        x = fit.x.copy()
        x[k] = value
        found[str(value)] = kinds(fit_doubts._negative_energy(replace(fit, x=x)))
    x[k] = -30.0
    found["not sure"] = kinds(fit_doubts._negative_energy(replace(fit, x=x, covariance=3e5 * fit.covariance)))
    found["dead"] = kinds(fit_doubts._negative_energy(replace(fit, x=x, dead=np.array([False, True, False]))))
    return found


@records.of
def links_that_a_robot_lacks():
    bare = without_links(robot(), ["grip"])
    fit = fitted()
    base = fit.base
    grip = robot().model.link_inertias["grip"].in_frame(robot().model.frames["grip"].pose)
    values = fit_doubts._values_without(base, 2, grip)
    values[base.kept[base.drives]] = 0.5  # without the inertia of the first motor, which is in a group of a body
    tau = fit.W @ base.project(values) + np.array([0.2, 0.3, 0.1]) * drawn(*fit.tau.shape)
    body = fit.base.unknown.file_values - fit_doubts._values_without(
        fit.base, 2, SpatialInertia.from_com(0.5, (0.1, 0.2, 0.3), 0.01 * np.eye(3))
    )
    return {
        "lacks": kinds(fit_doubts._missing_link(replace(fit, tau=tau))),
        "noise": kinds(fit_doubts._missing_link(replace(fit, tau=tau + 3.0 * drawn(*tau.shape, seed=1)))),
        "complete": kinds(fit_doubts._missing_link(fit)),
        "difference": packed(body),
        "masses": [float(b.inertia.mass) for b in bare.model.bodies],
        "no such link": refusal(lambda: without_links(robot(), ["plinth"])),
    }


@records.of
def residuals_above_noise():
    """Residuals beside three times the noise, and beside 5 % of the torque."""
    fit = fitted()
    rng = np.random.default_rng(2)
    found = {}
    for noise, residual in ((0.01, 0.06), (0.01, 0.04), (1.0, 0.9), (1.0, 2.0)):
        time = np.arange(600) * 0.01
        smooth = np.sin(np.outer(time, [3.0, 4.0, 5.0]))
        samples = stub(rate=100.0, tau=smooth + noise * rng.normal(size=(600, 3)))
        tau = smooth[::5]
        shares = residual * np.sqrt((tau**2).mean(axis=0)) * np.array([1.0, 0.1, 0.1])
        logs = [stub(samples=[samples])]
        case = stub(
            settings=stub(cutoff=5.0),
            names=fit.names,
            logs=logs,
            tau=tau,
            W=np.zeros((120, 3, 1)),
            x=shares[:1],
            dead=np.zeros(3, bool),
        )
        case.W[:, :, 0] = (tau + shares * np.sign(np.sin(np.arange(120)))[:, None]) / max(shares[0], 1e-9)
        found[f"{noise} {residual}"] = fit_doubts._residual_above_noise(case)
        case.dead = np.array([True, False, False])
        found[f"{noise} {residual}, dead"] = fit_doubts._residual_above_noise(case)
    samples.rate = 20.0
    found["slow"] = fit_doubts._residual_above_noise(case)
    return found


@records.of
def levels_of_reading_doubts():
    given = [
        doubt("saturated", ["waist"], extreme="5", rows="3 %"), doubt("calibration-few", rows=3, rank=4, more=2),
        doubt("servo-sign", ["waist"], level="refuse"), stub(kind="rows-left-out"),
    ]  # fmt: skip
    return [kinds(fit_doubts.reading_doubts(given)), kinds(fit_doubts.reading_doubts(given, "log 2.csv"))]


@records.of
def precedence_of_doubts_about_fits():
    """Each source of doubts by one doubt: which are kept beside which, and in which order."""
    saturated = doubt("saturated", ["waist"], extreme="5", rows="3 %")
    refusing = doubt("dead-position", ["waist"], named="all joints", level="refuse")
    dead = doubt("dead-torque", ["waist"])
    cause = doubt("unit", ["waist"], level="refuse", value="2", said="they look like N", named="all joints")
    gain = doubt(
        "gain", ("waist", "slide", "elbow"), level="refuse", value="2", interval="", evidence="so", named="all joints"
    )
    note = doubt("drift", ["waist"], level="note", value="2", interval="", evidence="so")
    unsure = replace(note, level="unsure")
    clock = doubt("time-scale", (), level="refuse", value="2", evidence="so")
    link = doubt("missing-link", link="grip", left="1 %", whole="3 %")
    moving = doubt("unexciting", said="moving.")
    poor = doubt("unexciting", ["elbow"], said="poor.")
    negative = doubt("negative-inertia", ["slide"], values="-2")
    energy = doubt("negative-inertia", ["elbow"], values="-3")
    left = doubt("partly-unexplained", ["elbow"], left="20 %", most="30 %", when="")
    sources = [
        "column_doubts",
        "gain_of_all",
        "_missing_link",
        "_unexciting",
        "_poor_predictions",
        "_negative_doubts",
        "_negative_energy",
        "_residual_doubts",
    ]
    cases = {
        "nothing": {}, "saturated": {"column_doubts": [saturated], "gain_of_all": [gain]}, "refusing column": {"column_doubts": [refusing], "_missing_link": [link]},
        "dead": {"column_doubts": [dead], "gain_of_all": [cause]}, "gain": {"gain_of_all": [gain], "_missing_link": [link]}, "unit": {"gain_of_all": [cause]},
        "cause": {"causes": [unsure], "gain_of_all": [cause]}, "clock": {"causes": [clock], "gain_of_all": [gain]}, "note": {"causes": [note], "gain_of_all": [cause]},
        "link": {"_missing_link": [link], "_unexciting": [moving], "_poor_predictions": [poor]}, "poor": {"_poor_predictions": [poor]}, "poor and left": {"_poor_predictions": [poor], "_residual_doubts": [left]},
        "loud": {"_poor_predictions": [poor], "_residual_doubts": [left], "loud": True}, "negative": {"_negative_doubts": [negative], "_negative_energy": [energy]},
        "energy": {"_negative_energy": [energy]}, "payload": {"_missing_link": [link], "gain_of_all": [gain], "payload_only": True}, "negative with cause": {"causes": [unsure], "_negative_doubts": [negative], "_negative_energy": [energy]},
        "left": {"_residual_doubts": [left]},
    }  # fmt: skip
    found = {}
    for name, case in cases.items():
        with pytest.MonkeyPatch.context() as patch:
            for source in sources:
                answer = case.get(source, [])
                patch.setattr(fit_doubts, source, lambda *_, answer=answer, **__: list(answer))
            is_loud = case.get("loud", False)
            patch.setattr(fit_doubts, "_residual_above_noise", lambda _, is_loud=is_loud: is_loud)
            fit = stub(
                logs=[],
                causes=case.get("causes", []),
                payload_only=case.get("payload_only", False),
                names=("waist", "slide", "elbow"),
            )
            found[name] = [[d.kind, d.level, *d.joints] for d in fit_doubts.doubts_of(fit)]
    return found


# ── Whole answers


@records.of(relative=1e-3)
def identification_of_an_arm_and_its_report(folder):
    found, _ = identified()
    data = found.to_dict()
    named = (
        "notes",
        "assumed",
        "undetermined",
        "base_parameters",
        "held_out",
        "training",
        "settings",
        "poorly_determined",
        "held",
        "essential",
        "bodies",
    )
    rows = [line.split(",") for line in found.to_csv(folder / "groups.csv").read_text().splitlines()]
    return {
        "text": str(found).splitlines(), "facts": dict(found.facts()), "brief": found.brief, "verdict": str(found.verdict),
        **{name: data[name] for name in named}, "parameters": packed([[p["value"], p["deviation"], *p["interval"], p["prior"]] for p in data["parameters"].values()]),
        "groups": found.groups, "units": found.units, "interval": packed(found.interval(0.5)), "offsets": found.offsets, "worst": found.worst,
        "csv": [rows[0], [row[:2] for row in rows[1:3]], packed([[float(x) for x in row[2:]] for row in rows[1:]])], "open": found.open_for_torques,
        "sigma": found.sigma, "residuals": [found.residuals.file, found.residuals.with_friction, found.residuals.identified, found.residuals.consistent],
        "origin": [str(entry) for entry in list(found.origin())[-1]], "sources": list(found.sources()),
        "details": [block if isinstance(block, str) else block.title for block in view._full_form(found)],
    }  # fmt: skip


@records.of(relative=1e-3)
def identifications_with_options():
    found = {}
    known = {"elbow.coulomb": 0.8, "waist.viscous": 1.3}
    heavy = robot().with_payload(SpatialInertia.from_com(0.9, (0.02, 0.03, 0.05), 0.002 * np.eye(3)), "grip")
    with_drives = robot().with_armature({"waist": 0.31, "slide": 1.9, "elbow": 0.12})
    cases = {
        "known": ({"known": known, "friction": ("coulomb", "viscous", "offset", "stribeck"), "stribeck_speed": 0.2, "assume": "none", "method": "wls"}, robot(), log_of()),
        "payload": ({"payload_only": "grip", "known": {f"{j}.viscous": v for j, v in zip(("waist", "slide", "elbow"), (1.3, 7.0, 0.45), strict=True)}}, with_drives, log_of(of=heavy)),
    }  # fmt: skip
    for name, (options, arm, log) in cases.items():
        answer = identify.identify(arm, log, **(OPTIONS | options))
        changes = None if answer.payload else answer.body_changes
        found[name] = {
            "text": str(answer).splitlines(), "doubts": kinds(answer.doubts), "held out": [answer.held_out.kind, answer.held_out.all], "trained": answer.trained.all,
            "values": packed(answer.values), "deviations": packed(answer.standard_deviations), "assumed": list(map(str, answer.settings.assumed)),
            "notes": answer.notes, "load friction": answer.load_friction, "brief": answer.brief, "free": answer.free_count,
            "tool": changes and changes.tool and [changes.tool.link, changes.tool.mass, changes.tool.deviation, changes.tool.held_out],
            "payload": answer.payload and answer.payload.to_dict(), "undetermined": list(answer.undetermined), "poor": answer.poorly_determined,
        }  # fmt: skip
    return found


@records.of
def calls_that_are_refused(folder):
    arm, log = robot(), log_of(3.0)
    still = tw.Motion(log.time, np.zeros_like(log.q), tau=np.zeros_like(log.q) + 1.0, robot=arm, in_seconds=True)
    return {
        "method": refusal(lambda: identify.identify(arm, log, method="lasso")), "no log": refusal(lambda: identify.identify(arm, [])),
        "number": refusal(lambda: identify.identify(arm, 3)), "strength": refusal(lambda: identify.identify(arm, log, keep_close=1e6)),
        "shift": refusal(lambda: identify.identify(arm, log, shift=float("nan"))), "cutoff": refusal(lambda: identify.identify(arm, log, cutoff=0.0)),
        "late": refusal(lambda: identify.identify(arm, log, shift=0.01, assume="late")), "torques": refusal(lambda: identify.identify(arm, tw.Motion(log.time, log.q, robot=arm, in_seconds=True))),
        "robot": refusal(lambda: identify.identify(arm, tw.Motion(log.time, log.q[:, :2], tau=log.q[:, :2], robot=tw.robots.planar_2r(), in_seconds=True))),
        "dead": refusal(lambda: identify.identify(arm, still)), "short": refusal(lambda: identify.identify(arm, log_of(1.0))),
        "commands": refusal(lambda: identify.identify(arm, tw.Motion(log.time, log.q, command=log.q, robot=arm, in_seconds=True))),
        "text": refusal(lambda: LogSource.from_log(arm, 3, "logs number 1", {})), "missing": refusal(lambda: identify.identify(arm, folder / "no.csv")),
    }  # fmt: skip


# ── Parts of the call


@records.of
def options_and_rows_of_fits():
    options = [identify.fit_options(*given) for given in ((None, None, None), (3, 0.02, -1), (2.5, None, 0))]
    without = [
        identify._without_delay(FitOptions(2.0), wanted)
        for wanted in ([WantedCause("late", ())], [WantedCause("tilt", ())])
    ]
    pieces = [stub(seconds=0.4, cut=True), stub(seconds=0.6, cut=True), stub(seconds=0.4, cut=False)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(identify, "steady_samples", lambda logs: list(logs))
        patch.setattr(identify, "_dead_torques", lambda logs: np.array([False, True]))
        kept = [
            [[p.seconds, p.cut] for p in identify._rows_of(given, FitOptions(cutoff))[0]]
            for given in (pieces, pieces[:1])
            for cutoff in (None, 2.0, 2.5)
        ]
    return [options, without, kept, [identify._three_digits(count) for count in (7, 1234, 123456, 99950)]]


@records.of
def dead_torques():
    def dead(tau, q):
        return identify._dead_torques([stub(tau=np.array(tau, float).T, q=np.array(q, float).T)])

    n = np.arange(20)
    moving, still = np.sin(n), 0.0 * n
    constant = 0.0 * n + 3.0
    mostly = np.where(n < 17, 3.0, n)
    limit = np.where(n < 16, 3.0, n)
    two = [stub(tau=np.c_[constant], q=np.c_[still]), stub(tau=np.c_[mostly], q=np.c_[moving])]
    return [
        dead([moving, constant, mostly, limit], [moving] * 4),
        dead([moving, constant, mostly, limit], [still] * 4),
        identify._dead_torques(two),
    ]


@records.of
def remarks_on_logs():
    def log(count, total, windows, gaps, doubts=()):
        return stub(doubts=doubts, count=count, checks=stub(count=total), windows=[None] * windows, gaps=np.array(gaps))

    left_out = [stub(kind="rows-left-out", sentence="3 rows are left out."), stub(kind="gain", sentence="no.")]
    return [
        identify._remarks([log(500, 500, 1, [])]), identify._remarks([log(5000, 90000, 3, [0.5], left_out), log(700, 1234, 2, [])]),
        identify._assumed_notes(stub(assumed=[AssumedCause("late", (), 3.0, None, "ms")])),
    ]  # fmt: skip


@records.of
def better_fit_with_laws():
    def result(share, notes=(), assumed=()):
        return replace(
            identified()[0],
            held_out=held_out_of("five-fold", [share] * 3),
            notes=notes,
            settings=replace(identified()[0].settings, assumed=assumed),
        )

    laws = [WantedCause("load-friction", ()), WantedCause("stribeck", ())]
    assumed = (
        AssumedCause("load-friction", (), 4.0, None, "%"),
        AssumedCause("tilt", (), 2.0, None, "°"),
        AssumedCause("stribeck"),
    )
    notes = tuple(f"Assumed: {cause}." for cause in assumed)
    found = []
    for share in (0.0951, 0.0949):
        better = identify._better_with(laws, result(0.1, ("a note.",)), result(share, (*notes, "another."), assumed))
        found.append([better.notes, better.held_out.all])
    return found


@records.of
def logs_that_cannot_be_read():
    good = stub(name="log")
    failed = [Failure("it is empty", None), Failure("it is short", tw.TrajectoryError("b.csv: it is short"))]
    sources = [stub(path="a.csv"), stub(path="b.csv"), stub(path="c.csv")]
    return [
        len(identify._readable([good, failed[0]])), refusal(lambda: identify._readable(failed)), refusal(lambda: identify._readable(failed[::-1])),
        kinds(identify._unreadable(sources, [good, *failed])), identify._readable([]),
    ]  # fmt: skip


# ── Windows of logs


@records.of
def windows_of_logs():
    def spread(counts):
        return [
            [*[[w.start, w.stop] for w in windows][:3], len(windows)] for windows in log_windows.spread_windows(counts)
        ]

    found = {
        str(counts): spread(counts)
        for counts in ((200_000,), (200_001,), (100_000, 100_000), (500_000, 40_000, 7_000), (3_600_000,))
    }
    many = log_windows.spread_windows([5000] * 60)
    return found | {"many": [len(windows) for windows in many], "first": [[w.start, w.stop] for w in many[0]]}


@records.of
def rows_of_windows():
    arm = robot()
    log = log_of(4.0)
    motion = tw.Motion(log.time, log.q.copy(), tau=log.tau.copy(), robot=arm, in_seconds=True)
    motion.q[50] += [0.0, 0.3, 0.0]
    motion.tau[120, 2] = 900.0
    found = {}
    source = LogSource.from_log(arm, motion, "logs number 1", {})
    checks = log_windows.checks_of(source)
    found["checks"] = [checks.count, kinds(checks.doubts), checks.wrong_times, checks.pause_lengths, source.count]
    for name, window in (("all", slice(0, 200)), ("part", slice(40, 130)), ("few", slice(40, 90))):
        rows = log_windows.rows_of_window(source, window, checks)
        found[name] = [
            len(rows.time),
            rows.count,
            packed(rows.q, rows.tau),
            [[len(p), p.cut, p.start] for p in rows.samples],
        ]
    part, window = source.part_for_window(slice(40, 130))
    found["sent"] = [len(part.motion), window.start, window.stop, source.part_for_window(slice(0, 200))[0] is source]
    flagged = replace(
        checks,
        doubts=tuple(stub(kind=kind) for kind in ("repeated", "pause", "held", "dropout")),
        wrong_times=log.time[[3, 9]],
    )
    rows = log_windows.rows_of_window(source, slice(0, 200), flagged)
    found["flagged"] = [len(rows.time), packed(rows.time)]
    time, q = np.arange(30) * 0.01, np.cumsum(np.full((30, 1), 0.01), axis=0)
    q[12:] += 0.2
    found["pauses"] = log_windows._with_pauses(time, q)
    read = log_windows.ReadLog(
        "a",
        checks,
        (
            log_windows.rows_of_window(source, slice(0, 90), checks),
            log_windows.rows_of_window(source, slice(110, 200), checks),
        ),
    )
    found["read"] = [
        len(read.time),
        read.count,
        read.gaps,
        [[len(p), p.start, p.log] for p in log_windows.steady_samples([read, read])],
        [p.log for p in log_windows.steady_samples([read])],
    ]
    found["closed"] = replace(read, checks=flagged).gaps
    return found


SIDE = MotorSide(
    np.array([[50.0, 0, 0], [0, 30.0, -7.0], [4.0, 0, -20.0]]), np.array([0.1, -0.2, 0.3]), np.array([2.0, 3.0, 5.0])
)


def csv_of(folder, names=("waist", "slide", "elbow"), count=80, **changes):
    """Log of the short arm as a CSV file."""
    time = 0.5 + np.arange(count) * 0.02
    q, _, _ = states_at(time)
    q = changes.get("q", q)
    header = ["time", *names, *(f"{name}.torque" for name in names)]
    rows = np.c_[time, q, torques_at(robot(), time)]
    path = folder / "log.csv"
    path.write_text("\n".join([",".join(header), *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n")
    return path


@records.of
def logs_of_joints_and_motors(folder):
    arm = robot()
    path = csv_of(folder)
    found = {}
    ones = np.ones(3)
    sides = {
        "none": None,
        "joints": MotorSide(np.eye(3), 0 * ones, ones),
        "motors": SIDE,
        "zeros": MotorSide(np.eye(3), 0.1 * ones, ones),
    }
    for name, side in sides.items():
        for degrees in (False, True):
            motion = payload.read_motion(path, arm, side=side, degrees=degrees)
            found[f"{name} {degrees}"] = [
                packed(motion.q),
                packed(motion.dq),
                packed(motion.tau),
                motion.notes,
                [d.kind for d in motion.doubts],
            ]
        source = LogSource(arm, str(path), side=side)
        rows = source.rows(slice(10, 20))
        checks = log_windows.checks_of(source)
        found[f"{name}, rows"] = [
            packed(rows.q, rows.tau),
            rows.time[0],
            source.count,
            [d.kind for d in checks.doubts],
            checks.count,
        ]
    time = 0.5 + np.arange(80) * 0.02
    q, _, _ = states_at(time)
    q[40, 1] += 0.3
    wrong = csv_of(folder, q=q)
    found["wrong row"] = [[d.sentence for d in LogSource(arm, str(wrong), side=side).doubts()] for side in (None, SIDE)]
    named = csv_of(folder, ("m1", "m2", "m3"))
    side = replace(SIDE, names=("m1", "m2", "m3"), rates=SIDE.ratios)
    found["named"] = packed(payload.read_motion(named, arm, side=side).q)
    found["options"] = [
        packed(payload.read_motion(csv_of(folder), arm, **options).tau)
        for options in ({"gain": {"waist": 2.0}}, {"columns": {"waist": "slide", "slide": "waist"}})
    ]
    return found


@records.of(relative=1e-3)
def predictions_of_test_logs():
    found, _ = identified()
    sources = [LogSource.from_log(robot(), log_of(4.0, 50.0, 40.0), "test number 1", {})]
    logs = identify.read_logs(sources, identify.Workers(), lambda _: None)
    settings = identify.SettingRows(
        found.base, log_windows.steady_samples(logs), FitOptions(4.0, 0.03, 0.0), np.zeros(3, bool)
    )
    held_out = identify._predict_tests(settings, logs, found.settings, found.values, None)
    other = identify._predict_tests(
        settings, logs, replace(found.settings, shift=0.02, friction_speed=np.full(3, 0.1)), found.values, None
    )
    return [[h.kind, h.all, h.joints, len(h.rows)] for h in (held_out, other)]


# ── Changes of bodies


@records.of
def sure_changes_of_bodies():
    before = np.array([5.0, 3.0, 1.0])
    covariance = np.array([[0.04, 0.01, -0.005], [0.01, 0.09, 0.002], [-0.005, 0.002, -0.01]])
    tool = LoneChange("grip", -0.4321, 0.05, 0.02, np.zeros(3))
    found = []
    for change in ((0.39, -0.59, 0.0), (0.41, -0.61, 0.01), (-0.41, 0.2, 0.3), (0.3, 0.3, 0.1), (-0.3, -0.3, -0.05)):
        changes = BodyChanges(
            ["a", "b", "c"],
            before,
            before + change,
            covariance,
            np.array([0.0123, np.nan, 0.0004]),
            np.array([True, False, True]),
            tool,
            np.zeros(3, bool),
        )
        found.append([changes.to_list(), changes.deviations, changes.is_heavier, changes.is_sum_heavier])
    more = replace(changes, tool=replace(tool, mass=0.25))
    table = view._body_table(changes, view.Level.SHORT, 5)
    return [found, view.tool_sentence(changes), view.tool_sentence(more), table.most, list(map(float, table.by))]


@records.of(relative=1e-3)
def lone_changes_and_tools():
    found, _ = identified()
    fits = body_changes._ComparisonFits(found)
    changes = [fits.lone_change(link) for link in ("arm", "boom", "pillar")]
    return [
        [[c.link, c.mass, c.deviation, c.held_out, packed(c.values)] for c in changes], fits.held_out_with_gain, fits.tool, len(fits.fifths),
        packed(fits.covariance), [found.body_changes.masses, found.body_changes.moved, found.body_changes.deviations],
    ]  # fmt: skip


@records.of
def tools_at_their_limits():
    """Shares of the file's excess residual, of the moving mass (10.7 kg), and deviations of the mass."""
    base = identified()[0].base

    def tool(held_out=0.1, mass=0.5, deviation=0.05, with_gain=0.5, known=()):
        unknown = stub(model=base.unknown.model, bodies=base.unknown.bodies, known={f"{link}.m": 1.0 for link in known})
        found = stub(base=stub(unknown=unknown), consistent=stub(of_file=0.5, held_out=0.1))
        fits = stub(
            found=found,
            lone_change=lambda link: LoneChange(link, mass, deviation, held_out, None),
            held_out_with_gain=with_gain,
        )
        return body_changes._ComparisonFits.tool.fget(fits) is not None

    limit = np.sqrt(0.25 - 0.95 * 0.24)
    return {
        "tool": tool(), "residual": [tool(limit * 0.99), tool(limit * 1.01)], "gain": [tool(with_gain=limit * 1.01), tool(with_gain=limit * 0.99)],
        "mass": [tool(mass=0.3211, deviation=0.01), tool(mass=0.3209, deviation=0.01), tool(mass=-0.33, deviation=0.01)], "sure": [tool(deviation=0.099), tool(deviation=0.101)],
        "known": tool(known=["arm"]),
    }  # fmt: skip


# ── Reports


@records.of
def lines_of_reports():
    found, _ = identified()
    groups = found.groups

    def seen(shares):
        torque_shares = np.zeros((3, len(groups)))
        for group, (joint, share) in shares.items():
            torque_shares[joint, groups.index(group)] = share
        return view._open_groups(replace(found, torque_shares=torque_shares))

    first = next(name for name in groups if "mc" in name)
    lines = [view.Line("x" * n) for n in (73, 74, 75, 149)]
    single = HeldOut("test", np.array([1.0]), np.array([100.0]), ("waist",))
    return {
        "none": seen({}), "limit": [seen({"waist.coulomb": (1, 0.02)}), seen({"waist.coulomb": (1, 0.0201)})],
        "kinds": [seen({f"slide.{kind}": (2, 0.05), first: (0, 0.03)}) for kind in ("viscous", "coulomb", "motor_inertia", "offset")], "body": seen({first: (0, 0.04)}),
        "rows": [view._rows_that_fit(lines[:k]) for k in range(5)] + [view._rows_that_fit(lines * 3)],
        "headlines": [
            view._headline(replace(found, held_out=held_out_of(kind, [0.01, 0.02, share]), doubts=doubts))
            for kind in ("test", "five-fold") for share in (0.005, 0.03) for doubts in ((), (doubt("unexciting", said="so."),))
        ],
        "one joint": view._headline(replace(found, held_out=single)), "units": [view._unit(q, np.array(mask)) for q in ("tau", "tau/dq") for mask in ([True, False], [True], [False])],
        "infinite": _without_infinities({"a": [1.0, np.inf, (2.0, float("nan"))], "b": {"c": -np.inf}}),
    }  # fmt: skip


# ── Files


def consistent_with(friction=("viscous", "coulomb", "stribeck", "offset"), motor_inertia=True, scale=1.1, folder=None):
    """Consistent robot whose values are those of the file, times a factor, with drives."""
    arm = robot()
    if folder is not None:
        (folder / "arm.urdf").write_text(SHORT)
        arm = tw.load(folder / "arm.urdf")
    unknown = UnknownParameters(arm, motor_inertia, friction, stribeck_speed=0.17)
    values = scale * unknown.file_values
    is_drive = np.flatnonzero(unknown.of_bodies < 0)
    values[is_drive] = 0.3 + 0.1 * np.arange(len(is_drive))
    base = BaseParameters.from_unknowns(unknown)
    return arm, ConsistentRobot(base, PositiveFit(2.0, values, 0.0, 0), ((2.0, 0.1),), 0.2, ("boom",))


@records.of
def actuator_files():
    found = {}
    given = {
        "actuators": {"waist": {"ratio": "50", "rotor": "3 kg mm^2", "friction": {"viscous": "1 N m s/rad"}}},
        "log": {"side": "motor"},
    }
    for name, options in {
        "all": {},
        "friction": {"motor_inertia": False, "friction": ("coulomb",)},
        "static": {"friction": ("stribeck",)},
    }.items():
        arm, consistent = consistent_with(**options)
        text = actuator_text.actuator_text(arm.model, consistent)
        found[name] = [text.splitlines(), actuator_text.same_actuators(text, consistent) < 1e-12]
    arm, consistent = consistent_with()
    found["given"] = actuator_text.actuator_text(arm.model, consistent, given, {"slide": 0.07}).splitlines()
    other = text.replace("0.3", "0.31")
    found["other"] = actuator_text.same_actuators(other, consistent)
    return found


def changed_lines(text, original=SHORT):
    kept = set(original.splitlines())
    return [line for line in text.splitlines() if line not in kept]


@records.of
def robot_files_with_identified_values(folder):
    found = {}
    for name, options in {
        "all": {},
        "light": {"scale": 0.05},
        "rigid": {"friction": (), "motor_inertia": False},
        "viscous": {"friction": ("viscous",)},
    }.items():
        arm, consistent = consistent_with(**options, folder=folder)
        written = write.written_robot(arm, consistent, "of a -- test")
        read = tw.load(written.text)
        found[name] = {
            "lines": len(changed_lines(written.text)), "first": [line for line in changed_lines(written.text) if "<!--" in line][:2], "folded": written.folded, "missing": written.missing,
            "masses": [float(b.inertia.mass) for b in read.model.bodies], "parameters": packed(read.parameters), "folder": written.folder,
            "friction": [read.model.friction.viscous, read.model.friction.coulomb], "links": {link: float(G.mass) for link, G in read.model.link_inertias.items()},
        }  # fmt: skip
    found["no file"] = refusal(
        lambda: write.written_robot(
            tw.from_screws(np.eye(4), np.array([[0, 0, 1, 0, 0, 0.0]]).T, [np.eye(4)] * 2, [np.eye(6)], name="s"),
            consistent,
            "",
        )
    )
    return found


@records.of
def checks_before_writing():
    _, consistent = consistent_with()

    def check(held_out, of_file, **fields):
        case = replace(consistent, curve=((2.0, held_out),), of_file=of_file, **fields)
        try:
            return write.check_written(case)
        except tw.ValueRangeError as problem:
            return f"refused: {problem}"

    _, light = consistent_with(scale=0.79)
    _, heavy = consistent_with(scale=1.21)
    negative = replace(consistent, fit=replace(consistent.fit, values=-consistent.fit.values))
    return {
        "better": check(0.1, 0.2), "equal": check(0.2, 0.2), "worse": check(0.209, 0.2), "too bad": check(0.2101, 0.2), "small": [check(0.0119, 0.01), check(0.0121, 0.01)],
        "not thick": check(0.1, 0.2, repaired=()), "masses": [write.check_written(light), write.check_written(heavy)],
        "impossible": refusal(lambda: write.check_written(negative)),
    }  # fmt: skip


@records.of
def notes_on_written_files(folder):
    several = {"m1.viscous": 0.5, "m2.coulomb": 1.25}
    consistent = stub(of_several_joints=several, fit=stub(strength=3.0))
    assumed = (AssumedCause("load-friction", ("slide",), 4.0, None, "%"), AssumedCause("tilt", (), 2.0, None, "°"))

    def result(**fields):
        base = {
            "consistent": consistent,
            "settings": stub(assumed=assumed),
            "load_friction": {"slide": 0.04},
            "base": stub(count=24),
            "held_out": held_out_of("test", [0.1] * 3),
        }
        return stub(**(base | fields))

    file = write.WrittenRobot(
        "",
        b"",
        0.0,
        ("grip",),
        {"stribeck": {"waist": 0.3}, "motor_inertia": {"slide": 1.9, "elbow": 0.1}},
        folder / "meshes",
    )
    headline = re.sub(r"version \S+, \S+", "VERSION", write._headline(result(), ["a.csv", "b.csv"]))
    motor_side = stub(names=("m1",))
    unknown = stub(motor_side=motor_side)
    refusing = verdict_from_doubts([doubt("unexplained", left="40 %")])
    fine = verdict_from_doubts([])
    cases = {
        "look again": stub(verdict=refusing),
        "payload": stub(verdict=fine, payload_frame="grip"),
        "coupled": stub(verdict=fine, payload_frame=None, base=stub(unknown=unknown)),
    }
    return {
        "losses": [write._notes_on_losses(result(), path) for path in (None, "a.yaml")], "few losses": write._notes_on_losses(result(consistent=stub(of_several_joints={}), settings=stub(assumed=()), load_friction={}), None),
        "file": [write._notes_on_robot_file(file, folder / "new.urdf", has_actuator_file=has) for has in (False, True)], "in its folder": write._notes_on_robot_file(replace(file, missing={}), folder / "meshes" / "new.urdf", has_actuator_file=True),
        "headline": headline, "refused": {name: refusal(lambda case=case: write._check_writable(case, "a.yaml", force=False)) for name, case in cases.items()},
        "forced": write._check_writable(stub(verdict=refusing, payload_frame=None, base=stub(unknown=unknown)), None, force=True),
        "relative": [write._is_relative(name) for name in ("", "a.stl", "/a.stl", "package://a.stl", "http://a")],
        "stored": write._without_stored_part({"viscous": {"a": 1.0, "b": 0.2, "c": 3.0}}, {"viscous": {"a": 0.25, "b": 0.5, "c": -1.0}}),
    }  # fmt: skip


@records.of(relative=1e-3)
def written_identification(folder):
    (folder / "arm.urdf").write_text(SHORT)
    arm = tw.load(folder / "arm.urdf")
    log = log_of()
    found = identify.identify(arm, tw.Motion(log.time, log.q, tau=log.tau, robot=arm, in_seconds=True), **OPTIONS)
    notes = found.write(folder / "new.urdf", folder / "new.yaml", logs=["log.csv"])
    back = tw.load(folder / "new.urdf").with_actuators(folder / "new.yaml")
    text = (folder / "new.yaml").read_text()
    return [
        notes,
        packed(back.parameters),
        back.armature,
        [back.model.friction.viscous, back.model.friction.coulomb],
        len(text.splitlines()),
    ]


@records.of
def load_friction_of_assumed_causes():
    found, _ = identified()
    assumed = [
        AssumedCause("load-friction", ("slide",), 4.0, None, "%"),
        AssumedCause("load-friction", ("elbow",), -1.0),
        AssumedCause("tilt", (), 2.0),
    ]
    cases = [
        assumed,
        [replace(assumed[0], joints=())],
        [replace(assumed[0], value=None)],
        [replace(assumed[0], value=0.0)],
    ]
    results = [replace(found, settings=replace(found.settings, assumed=tuple(case))) for case in cases]
    return [[r.load_friction, r.brief, list(r.robot.model.friction.load)] for r in results]


def axes_of(figure):
    """What the axes of a figure show: titles, labels, curves, bars and texts. Ticks are those of a version of matplotlib."""
    found = []
    for axes in figure.axes:
        lines = [
            [str(line.get_label()), str(line.get_linestyle()), packed(line.get_xdata(), line.get_ydata())]
            for line in axes.lines
        ]
        bars = [round(float(patch.get_height()), 6) for patch in axes.patches if hasattr(patch, "get_height")]
        legend = axes.get_legend()
        legend_texts = [text.get_text() for text in legend.get_texts()] if legend else []
        areas = [packed(area.get_paths()[0].vertices) for area in axes.collections if len(area.get_paths())]
        texts = [text.get_text() for text in axes.texts]
        found.append(
            [
                axes.get_title(loc="left"),
                axes.get_xlabel(),
                axes.get_ylabel(),
                lines,
                bars,
                legend_texts,
                areas,
                texts,
            ]
        )
    return found


@records.of(relative=1e-3)
def figures_of_an_identification():
    from matplotlib.figure import Figure

    found, _ = identified()
    rng = np.random.default_rng(6)
    rows = tuple(
        HeldOutRows(1.0 + np.arange(6) * 0.5, np.full(6, log), rng.normal(size=(6, 3)), rng.normal(size=(6, 3)))
        for log in (1, 0, 1)
    )
    few = replace(found, held_out=replace(found.held_out, rows=rows), sigma=np.array([0.2, 0.4, 0.3]))
    found_axes = {}
    draws = {
        "torques": (pictures._draw_torques, few), "groups": (lambda f, a: pictures._draw_groups(f.subplots(), a), few), "bars": (lambda f, a: pictures.draw_residual_bars(f.subplots(), a), found),
        "residuals": (lambda f, a: pictures.draw_residuals(pictures._panel_rows(f, a.held_out.names), a), few),
        "friction": (lambda f, a: pictures.draw_friction(pictures.style.panels(f, 3, 4), a), found), "prior": (lambda f, a: pictures._draw_prior_weights(f.subplots(), a), found),
    }  # fmt: skip
    for name, (draw, answer) in draws.items():
        figure = Figure()
        draw(figure, answer)
        found_axes[name] = axes_of(figure)
    names = ["arm.mcx + 2 boom.m", "a_very_long_name_of_a_link.Ixx + boom.m", "arm.m", "-arm.Ixx - 2 boom.Iyy"]
    return found_axes | {
        "short names": [pictures._short_name(name) for name in names], "joints": pictures.joints_with_friction(found), "begins": pictures._begins_of_logs(rows),
        "kinds": list(pictures.identification_plots(found)),
    }  # fmt: skip


@records.of
def progress_of_a_call():
    shares = []
    identify.identify(
        robot(), log_of(5.0), cutoff=4.0, shift=0.0, friction_speed=0.03, assume="none", progress=shares.append
    )
    return shares


@records.of(relative=1e-3)
def short_forms_of_reports():
    found, _ = identified()
    doubts = tuple(doubt("unexciting", said=f"number {k}.", level="refuse" if k == 1 else "note") for k in range(4))
    many = replace(found, doubts=doubts, notes=("note one.", "note two."))
    lines = view._remarks(many)
    threshold = stub(sentence="Thresholds.", doubts=[doubt("unexciting", said="short.")])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(view, "threshold_table", lambda _: "a table")
        thresholds = [block if isinstance(block, str) else block.pieces for block in view._thresholds(threshold)]
    blocks = {}
    tool = LoneChange("arm", 0.4, 0.01, 0.02, None)
    with_tool = replace(many)
    with_tool.__dict__["body_changes"] = replace(found.body_changes, tool=tool)
    fine = replace(found)
    fine.__dict__["body_changes"] = replace(found.body_changes, tool=tool)
    for name, case in (("many", with_tool), ("fine", fine)):
        listed = list(view.identification_view(case))
        blocks[name] = [
            [type(block).__name__, getattr(block, "title", "") or "".join(view._piece_texts(block) if hasattr(block, "pieces") else []), int(getattr(block, "level", 0)), ["".join(map(str, line.pieces)) for line in getattr(block, "further", ())]]
            for block in listed
        ]  # fmt: skip
    return [[[line.pieces, int(line.level)] for line in lines], thresholds, blocks]


@records.of
def payload_figures():
    one = payload.IdentifiedPayload(
        "tool",
        SpatialInertia.from_com(2.5, (0.01, -0.02, 0.1), np.diag([0.01, 0.02, 0.025])),
        0.034,
        np.array([0.001, 0.002, 0.003]),
        ("arm.Ixx",),
    )
    return [one.to_dict(), list(view._payload_lines(one)), list(view._payload_lines(replace(one, unidentifiable=())))]


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
