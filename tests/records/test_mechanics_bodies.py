"""Inertias, meshes and free bodies: complete answers on record."""

from __future__ import annotations

import json
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
import sympy
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.mechanics.bodies import (
    consistency,
    enclosure,
    free_body,
    free_body_steps,
    inertia,
    mesh,
    mesh_files,
    rigid_body,
    shells,
    solids,
)
from twistwrench.mechanics.lie import se3, so3

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

Inertia = tw.SpatialInertia
I_COM = np.array([[0.9, 0.1, -0.2], [0.1, 1.1, 0.05], [-0.2, 0.05, 1.3]])
G = Inertia.from_com(1.7, (0.2, -0.5, 0.9), I_COM)
V = np.array([0.31, -0.52, 0.87, 1.4, -2.3, 0.6])
DV = np.array([-0.7, 1.1, 0.4, 0.3, 0.8, -1.9])
F = np.array([0.7, -1.9, 2.3, -4.1, 0.9, 3.3])
T = se3._exp(V)
BAD = {
    "triangle": Inertia.from_com(2.0, (0.1, 0.2, 0.3), np.diag([1.0, 1.5, 3.25])),
    "negative": Inertia.from_com(2.0, (0.1, 0.2, 0.3), np.diag([-0.5, 1.5, 1.25])),
    "negative, turned": Inertia.from_com(2.0, (0.0, 0.0, 0.0), np.diag([-0.5, 1.5, 1.75])).in_frame(T),
    "negative mass": Inertia.from_com(-2.0, (0.1, 0.2, 0.3), I_COM),
    "no mass": Inertia.from_parameters([0, 0, 0, 0, 1.0, 0, 2.0, 0, 0, 2.5]),
    "no mass, first moment": Inertia.from_parameters([0, 0.1, 0, 0, 0, 0, 0, 0, 0, 0]),
    "nothing": Inertia.zero(),
    "not finite": Inertia.from_parameters([1.0, 0, 0, 0, np.nan, 0, 2.0, 0, 0, 2.5]),
    "point": Inertia.from_com(2.0),
    "rod": Inertia.from_com(2.0, (0, 0, 0), np.diag([0.0, 1.5, 1.5])),
    "plate": Inertia.from_com(2.0, (0, 0, 0), np.diag([1.0, 1.5, 2.5])),
    "good": G,
}


def principal(one):
    """Principal moments, and axes without the signs that LAPACK chooses."""
    moments, axes = one.principal()
    return moments, np.abs(axes), np.linalg.det(axes)


def tried(call):
    """Result of a call, or its error."""
    try:
        return call()
    except Exception:
        return refusal(call)


def caught(call):
    """Result and texts of warnings."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result = tried(call)
    return {
        "result": result,
        "warnings": [f"{x.category.__name__}: {x.message}" for x in found],
        "where": {Path(x.filename).name for x in found},
    }


# ── Inertias


@records.of
def parts_of_an_inertia():
    return {
        name: [
            one.parameters,
            one.mass,
            one.com,
            one.moment_about_origin,
            one.moment_about_com,
            one.second_moment,
            repr(one),
        ]
        for name, one in BAD.items()
        if name in ("good", "triangle", "no mass", "nothing", "negative mass")
    } | {
        "matrix": G.matrix,
        "pseudo inertia": G.pseudo_inertia,
        "principal": principal(G),
        "html": G._repr_html_(),
        "not finite": repr(BAD["not finite"]),
        "almost diagonal": repr(Inertia.from_com(2.0, (0.1, 0.2, 0.3), np.diag([1.0, 1.5, 1.75]) + 1e-17)),
        "symbols": [
            repr(Inertia(np.array(sympy.symbols("a:10")))),
            Inertia(np.array(sympy.symbols("a:10")))._repr_html_(),
        ],
    }


@records.of
def inertias_from_numbers():
    return {
        "com alone": Inertia.from_com(2.0),
        "com and place": Inertia.from_com(2.0, (0.3, -0.4, 0.7)),
        "no place": Inertia.from_com(2.0, moment_about_com=I_COM),
        "place along x": Inertia.from_com(2.0, (0.3, 0, 0), I_COM),
        "place along y": Inertia.from_com(2.0, (0, 0.3, 0), I_COM),
        "place along z": Inertia.from_com(2.0, (0, 0, 0.3), I_COM),
        "almost symmetric": Inertia.from_com(2.0, (0, 0, 0.3), I_COM + 0.5e-9 * np.eye(3)[[1, 2, 0]]),
        "not symmetric": [
            tried(lambda e=e: Inertia.from_com(2.0, (0, 0, 0), I_COM + 1e-3 * e))
            for e in (
                np.eye(3)[[1, 0, 2]] * [[1], [0], [0]],
                np.eye(3)[[2, 1, 0]] * [[1], [0], [0]],
                np.eye(3)[[0, 2, 1]] * [[0], [1], [0]],
            )
        ],
        "not finite": Inertia.from_com(2.0, (0, 0, 0), np.full((3, 3), np.nan)),
        "three moments": tried(lambda: Inertia.from_com(2.0, (0, 0, 0), [1, 2, 3])),
        "two moments": tried(lambda: Inertia.from_com(2.0, (0, 0, 0), [1, 2])),
        "matrix": Inertia.from_matrix(G.matrix),
        "as a matrix": tried(lambda: Inertia(G.matrix)),
        "as three": tried(lambda: Inertia(1, 2, 3)),
        "nine": tried(lambda: Inertia(np.ones(9))),
        "pseudo inertia": Inertia.from_pseudo_inertia(G.pseudo_inertia + 0.01 * np.triu(np.ones((4, 4)), 1)),
        "points": Inertia.from_points([1.0, 2.0, 0.5], [[0.1, 0.2, 0.3], [-0.4, 0.5, 0.9], [0.7, -0.8, 0.6]]),
        "points that cannot be": [
            tried(lambda: Inertia.from_points([1.0, -2.0], np.eye(3)[:2])),
            tried(lambda: Inertia.from_points([1.0, 2.0], np.full((2, 3), np.inf))),
            tried(lambda: Inertia.from_points([1.0, 2.0], np.eye(3))),
            tried(lambda: Inertia.from_points([1.0, np.inf], np.eye(3)[:2])),
        ],
        "zero": Inertia.zero(),
    }


@records.of
def matrices_that_are_not_of_a_body():
    swapped = G.matrix[[3, 4, 5, 0, 1, 2]][:, [3, 4, 5, 0, 1, 2]]
    answers = {
        "swapped": tried(lambda: Inertia.from_matrix(swapped)),
        "not finite": tried(lambda: Inertia.from_matrix(G.matrix + np.diag([np.nan, 0, 0, 0, 0, 0]))),
    }
    for place in ((0, 1), (0, 3), (0, 4), (4, 0), (3, 4), (3, 3)):
        for share in (0.3e-6, 3e-6, 0.02):
            bad = G.matrix
            bad[place] += share * 1.5
            answers[f"{place} {share}"] = tried(lambda bad=bad: Inertia.from_matrix(bad).mass)
    for radius in (99.0, 101.0):
        answers[f"radius {radius}"] = tried(
            lambda r=radius: Inertia.from_matrix(np.diag([2.0 * r * r] * 3 + [2.0] * 3)).mass
        )
    answers["small, linear part first"] = tried(lambda: Inertia.from_matrix(np.diag([3.0] * 3 + [1e-6] * 3)))
    return answers


@records.of
def inertias_that_move():
    return {
        "in frame": G.in_frame(T),
        "shifted": G.in_frame(se3.pose(np.eye(3), [0.3, -0.7, 0.4])),
        "turned": [G.turned(k, 0.4 * (k + 1)) for k in range(3)],
        "no axis": tried(lambda: G.turned(3, 0.1)),
        "not a pose": tried(lambda: G.in_frame(2 * T)),
        "momentum": [G @ V, G @ np.stack([V, DV, F])],
        "labelled": tried(lambda: G @ tw.Twist(V, "b")),
        "sums": [G + G.turned(1, 0.3), G - G.turned(2, 0.5), sum([G, G])],
        "not sums": [tried(lambda: G + 1), tried(lambda: G - "a"), tried(lambda: 1 + G), tried(lambda: "" + G)],
        "of symbols": str(
            Inertia(np.array(sympy.symbols("a:10"))).in_frame(se3.pose(np.eye(3), [1.0, 2.0, 3.0])).parameters.tolist()
        ),
    }


@records.of
def consistency_of_inertias():
    answers = {
        name: [
            one.defects(),
            one.defects(size=1e9),
            tried(one.nearest_consistent),
            tried(lambda one=one: str(one.repair())),
            tried(lambda one=one: [one.repair().largest, one.repair().moved, one.repair().reasons]),
            tried(one.log_cholesky),
            tried(lambda one=one: principal(one)),
        ]
        for name, one in BAD.items()
    }
    for share in (0.9e-6, 1.1e-6):
        answers[f"triangle {share}"] = Inertia.from_com(
            1.0, (0, 0, 0), np.diag([1.0, 1.0, 2.0 * (1 + 2 * share)])
        ).defects()
        answers[f"negative {share}"] = Inertia.from_com(1.0, (0, 0, 0), np.diag([-2.0 * share, 1.0, 1.0])).defects()
    return answers


@records.of
def logarithmic_parameters():
    theta = np.array([0.2, -0.3, 0.1, -0.5, 0.4, -0.6, 0.7, 0.3, -0.8, 1.1])
    return {
        "from": Inertia.from_log_cholesky(theta),
        "to": G.log_cholesky(),
        "back": Inertia.from_log_cholesky(theta).log_cholesky(),
        "not finite": tried(lambda: Inertia.from_log_cholesky([np.nan] * 10)),
        "overflow": tried(lambda: Inertia.from_log_cholesky([400.0] + [0.0] * 9)),
        "overflow of a moment": tried(lambda: Inertia.from_log_cholesky([0.0, 400.0] + [0.0] * 8)),
    }


@records.of
def axes_of_repeated_moments():
    R = so3._exp(np.array([0.7, -0.4, 1.1]))
    answers = {}
    for name, moments in {
        "all equal": (2.0, 2.0, 2.0),
        "first two equal": (1.0, 1.0, 1.5),
        "last two equal": (1.0, 1.5, 1.5),
        "different": (1.0, 1.25, 1.5),
        "almost equal": (1.0, 1.0 + 1e-9, 1.5),
    }.items():
        answers[name] = Inertia.from_com(1.0, (0, 0, 0), np.diag(moments)).principal()
        exact = (np.array(moments), R)
        answers[f"{name}, axes"] = consistency.principal_axes(*exact)
        answers[f"{name}, mirrored axes"] = consistency.principal_axes(exact[0], -R)
    return answers


@records.of
def uniform_solids():
    answers = {}
    for options in ({"mass": 2.5}, {"density": 700.0}):
        key = next(iter(options))
        answers[key] = [
            Inertia.box((0.2, 0.3, 0.7), **options),
            Inertia.ellipsoid((0.2, 0.3, 0.7), **options),
            Inertia.sphere(0.3, **options),
            Inertia.cylinder(0.2, 0.7, **options),
            Inertia.capsule(0.2, 0.7, **options),
            Inertia.cone(0.2, 0.7, **options),
        ]
    makers = {
        "box": ((1, 2, 3),),
        "ellipsoid": ((1, 2, 3),),
        "sphere": (1,),
        "cylinder": (1, 2),
        "capsule": (1, 2),
        "cone": (1, 2),
    }
    for name, arguments in makers.items():
        make = getattr(Inertia, name)
        answers[name] = [
            tried(lambda m=make, a=arguments: m(*a)),
            tried(lambda m=make, a=arguments: m(*a, mass=1, density=2)),
            tried(lambda m=make, a=arguments: m(*a, mass=-1.5)),
            tried(lambda m=make, a=arguments: m(*a, density=np.inf)),
            tried(
                lambda m=make, a=arguments: m(
                    *(np.array(a[0]) * [1, 1, -1] if np.ndim(a[0]) else -a[0], *a[1:]), mass=1
                )
            ),
        ]
    answers["too long"] = [
        tried(lambda: Inertia.cylinder(1, 1e101, mass=1)),
        tried(lambda: Inertia.cone(1e-101, 1, mass=1)),
        tried(lambda: Inertia.capsule(1, np.nan, mass=1)),
        tried(lambda: Inertia.cylinder(np.inf, 1, mass=1)),
    ]
    answers["limits"] = [Inertia.box((1e-100, 1.0, 1.0), mass=1.0), solids._lengths("a", 1e100, 1)]
    answers["clipped"] = [solids.clip_eigenvalues(I_COM - np.eye(3)), solids.clip_eigenvalues(I_COM - np.eye(3), 0.25)]
    answers["moments"] = [solids.second_moments(I_COM), solids.rotational_inertia(I_COM), solids.moment_matrix(I_COM)]
    return answers


# ── Rigid bodies


@records.of
def dynamics_of_a_rigid_body():
    body = tw.RigidBody(G)
    many = np.stack([V, DV, F, -V])
    return {
        "wrench": [body.wrench(V, DV), body.wrench(many, DV), body.wrench(many[:, None], many[None, :3])],
        "acceleration": [body.acceleration(V, F), body.acceleration(many, F)],
        "momentum": [body.momentum(V), body.momentum(many)],
        "energy": [body.kinetic_energy(V), body.kinetic_energy(many)],
        "weight of many": body.weight(np.stack([T, se3._exp(DV), se3._exp(F)]), np.arange(9.0).reshape(3, 3) - 4.5),
        "weight": [
            body.weight(T),
            body.weight(T, (1.0, -2.0, 3.0)),
            body.weight(np.stack([T, T.T * 0 + se3._exp(DV)])),
        ],
        "points": [body.point_velocity(V, (0.3, -0.2, 0.7)), body.point_velocity(many, (0.3, -0.2, 0.7))],
        "accelerations of points": [
            body.point_acceleration(V, DV, (0.3, -0.2, 0.7)),
            body.point_acceleration(many, DV, (0.3, -0.2, 0.7)),
        ],
        "in frame": body.in_frame(T).inertia,
        "labelled": [body.wrench(tw.Twist(V, "b"), DV), body.acceleration(tw.Twist(V, "b"), tw.Wrench(F, "b"))],
        "rows": body.momentum(np.resize(np.concatenate([V, DV * 1.1]), (2050, 6)))[[0, 1, 2047, 2048, 2049]],
        "float32": body.momentum(V.astype(np.float32)).dtype.name,
        "ad transposed": rigid_body._ad_transposed(many.T[:, :3], many.T[:, 1:]),
    }


@records.of
def rigid_bodies_that_cannot_be():
    body = tw.RigidBody(G)
    answers = {name: tried(lambda one=one: tw.RigidBody(one).inertia.mass) for name, one in BAD.items()}
    answers["matrix"] = tried(lambda: tw.RigidBody(np.eye(6)))
    for moments in ((0.0, 1.0, 1.0), (1e-15, 1.0, 1.0), (1e-13, 1.0, 1.0), (0.0, 0.0, 0.0)):
        thin = tw.RigidBody(Inertia.from_com(1.0, (0, 0, 0), np.diag(moments)))
        answers[f"thin {moments}"] = tried(lambda thin=thin: thin.acceleration(V, F)[1:])
    twist, wrench = tw.Twist(V, "b"), tw.Wrench(F, "b")
    answers["frames"] = [
        tried(lambda: body.wrench(twist, tw.Twist(DV, "c"))),
        tried(lambda: body.acceleration(wrench, wrench)),
        tried(lambda: body.acceleration(twist, twist)),
        tried(lambda: body.acceleration(twist, tw.Wrench(F, "c"))),
        tried(lambda: body.fly(tw.Pose(T, "s", "b"), tw.Twist(V, "c"), 1, 0.1)),
        tried(lambda: body.fly(twist, V, 1, 0.1)),
        tried(lambda: body.weight(2 * T)),
        tried(lambda: body.weight(np.stack([T, T, T]), np.ones((2, 3)))),
        tried(lambda: rigid_body.common_frame("b", F=tw.Wrench(F, "c"))),
        rigid_body.common_frame("b", F=wrench, V=V),
        rigid_body.common_frame(None, T0=tw.Pose(T, "s", "b")),
        rigid_body.common_frame(),
    ]
    return answers


# ── Free bodies


def law(t, T_sb, V_b):
    """Wrench that depends on everything."""
    return F * (1.0 + 0.5 * t) + 0.2 * T_sb[:3, 3].sum() - 0.3 * V_b


def flown(inertia=G, **options):
    flight = tw.RigidBody(inertia).fly(T, V, **({"duration": 0.6, "dt": 0.05} | options))
    values = {
        name: getattr(flight, name)[[0, 1, -2, -1]]
        for name in ("times", "poses", "twists", "momentum", "energy", "impulse", "work")
    }
    values["poses"] = values["poses"][:, :3, 1:]
    return values | {
        "count": len(flight.times),
        "step": flight.step,
        "dt": flight.dt,
        "turn": flight.turn,
        "remarks": flight.remarks,
        "drifts": [flight.drift.momentum < 1e-12, flight.drift.rotation < 1e-13],
    }


@records.of
def flights_of_a_free_body():
    answers = {f"order {order}": flown(order=order) for order in (2, 4, 6)}
    answers["every"] = flown(every=5)
    answers["dt that does not fit"] = flown(dt=0.07)
    answers["long step"] = flown(dt=0.6)
    answers["two equal moments"] = flown(Inertia.from_com(1.7, (0.2, -0.5, 0.9), np.diag([1.0, 1.0, 1.5])), dt=0.6)
    return answers


@records.of(relative=1e-6)
def flights_of_a_body_that_is_pushed():
    return {f"order {order}": flown(order=order, wrench=law, dt=0.1) for order in (2, 4)} | {
        "constant": flown(wrench=F, every=4),
        "labelled": flown(wrench=tw.Wrench(F, "b"), dt=0.3),
        "pulse": flown(wrench=lambda t, T, V: F * 40.0 * (0.21 < t < 0.24), dt=0.3),
        "pulse seen": flown(wrench=lambda t, T, V: F * (0.01 < t < 0.4), dt=0.3),
    }


@records.of(relative=1e-6)
def flights_with_a_tolerance():
    return {
        "free": flown(tolerance=1e-8, duration=0.2, dt=0.1),
        "pushed": flown(tolerance=1e-6, duration=0.2, dt=0.1, wrench=law),
    }


@records.of
def texts_of_flights():
    flight = tw.RigidBody(G).fly(T, V, 0.7, 0.3)
    drift = free_body.Drift(1.234e-5, 0.0234, -0.012, 3e-16, ("one", "two"))
    still = free_body.Flight(
        times=np.array([0.0, 1.0, 3.0]),
        poses=np.stack([T, T, 1.001 * T]),
        twists=np.zeros((3, 6)),
        momentum=np.stack([F, 1.5 * F, F]),
        energy=np.array([1.0, 1.25, 2.0]),
        impulse=np.stack([0 * F, 0.25 * F, 0.125 * F]),
        work=np.array([0.0, 0.125, 0.5]),
        dt=0.5,
        step=0.375,
        turn=1.5,
        unseen="unseen",
    )
    return {
        "flight": [repr(flight).split("; drift")[0], flight.remarks],
        "drift": [str(drift), str(free_body.Drift(0.0, 0.0, 0.0, 0.0))],
        "made": [repr(still), still.drift, still.remarks],
        "no steps": repr(
            free_body.Flight(
                still.times, still.poses, still.twists, 0 * still.momentum, 0 * still.energy, still.impulse, still.work
            )
        ),
    }


@records.of
def limits_of_flights():
    body = tw.RigidBody(G)
    answers = {}
    for name, options in {
        "duration": {"duration": -1.0},
        "infinite": {"duration": np.inf},
        "dt": {"dt": 0.0},
        "every": {"every": 0},
        "half": {"every": 1.5},
        "order": {"order": 3},
        "tolerance": {"tolerance": 0.5},
        "small tolerance": {"tolerance": 1e-14},
        "no arguments": {"wrench": lambda: F},
        "bad wrench": {"wrench": lambda t, T, V: [1, 2]},
        "infinite wrench": {"wrench": lambda t, T, V: F * np.inf},
        "other frame": {"wrench": tw.Wrench(F, "c")},
        "law in another frame": {"wrench": lambda t, T, V: tw.Wrench(F, "c")},
        "steep": {"wrench": lambda t, T, V: -1e4 * V},
        "too many": {"duration": 1e9, "dt": 1e-3},
        "fast": {"V0": np.array([1e101, 0, 0, 0, 0, 0])},
    }.items():
        given = {"T0": tw.Pose(T, "s", "b"), "V0": V, "duration": 0.3, "dt": 0.1} | options
        answers[name] = tried(lambda given=given: len(body.fly(**given).times))
    answers["thin"] = [
        tried(lambda one=one: one.fly(T, V, 0.3, 0.1))
        for one in (tw.RigidBody(Inertia.from_com(1.0, (0, 0, 0), np.diag([1e-15, 1.0, 1.0]))),)
    ]
    answers["steps"] = [
        free_body.step_count(*x)
        for x in ((1.0, 0.1, 1), (1.0, 0.3, 1), (0.01, 0.1, 1), (1.0 + 1e-13, 0.1, 3), (1.0 + 1e-11, 0.1, 3))
    ]
    return answers


@records.of
def steps_of_a_rotor():
    rotor = inertia.SplitRotor.from_moments((0.4, 0.7, 0.9))
    q, l = (0.8, 0.1, -0.3, 0.5), (0.6, -0.2, 0.9)
    answers = {"rotor": rotor, "momentum": inertia.body_momentum(q, l), "compositions": inertia.COMPOSITIONS}
    for order, fractions in inertia.COMPOSITIONS.items():
        turns, last = rotor.schedule(0.3, fractions)
        answers[str(order)] = [turns, last, rotor.step(q, l, 0.3, turns, last)]
    answers["at rest"] = rotor.step(q, (0.0, 0.0, 0.0), 0.3, *rotor.schedule(0.3, (1.0,)))
    body = free_body_steps.FreeBody(1.7, np.array([0.4, 0.7, 0.9]), T)
    state = body.state(se3._exp(DV), V)
    answers["state"] = state
    answers["motion"] = body.motion(*state)
    answers["push"] = body.push(law, 0.3, *state)
    answers["midpoint"] = free_body_steps._midpoint_wrench(body, law, 0.3, *state, 0.05)
    return answers


@records.of
def impulses_that_steps_miss():
    answers = {}
    for fractions, spacing in (((1.0,), 0.05), ((0.4, -0.2, 0.8), 0.05), ((1.0,), np.inf), ((1.0,), 1.0)):
        missed = free_body_steps.MissedImpulse(fractions, 0.4, spacing)
        state = (np.array([1.0, 0, 0, 0]), np.zeros(3), np.ones(3), np.ones(3))
        other = (np.array([0.8, 0.6, 0, 0]), np.ones(3), 2 * np.ones(3), 3 * np.ones(3))
        missed.record(0.2, lambda t, q, p, l, f: np.concatenate([l * t**3 + q[1], f * (t > 0.31) + p]), state, other)
        missed.record(0.6, lambda t, q, p, l, f: np.concatenate([l * t + q[2], f + 0.1 * p]), other, state)
        answers[f"{fractions} {spacing}"] = [
            missed.needs_probes,
            missed.sum,
            missed.largest,
            missed.time_of_largest,
            missed.remark(1e-9, 1.0),
            missed.remark(1e9, 1e-9),
            missed.remark(1e9, 1e9),
        ]
    return answers


# ── Meshes


BOX_FACES = np.array(
    [
        [0, 2, 1],
        [0, 3, 2],
        [4, 5, 6],
        [4, 6, 7],
        [0, 1, 5],
        [0, 5, 4],
        [1, 2, 6],
        [1, 6, 5],
        [2, 3, 7],
        [2, 7, 6],
        [3, 0, 4],
        [3, 4, 7],
    ]
)


def box(size, centre=(0.0, 0.0, 0.0), inward=False):
    corners = (
        np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])
        / 2.0
    )
    return corners * size + centre, BOX_FACES[:, ::-1] if inward else BOX_FACES


def together(*meshes):
    vertices, faces, count = [], [], 0
    for v, f in meshes:
        vertices.append(v)
        faces.append(f + count)
        count += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


TETRAHEDRON = (
    np.array([[0.1, 0.2, 0.3], [0.9, 0.1, 0.2], [0.3, 0.8, 0.1], [0.2, 0.4, 1.3]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
)
OUTER = box((1.0, 0.8, 0.6), (0.1, 0.2, 0.3))
INNER = box((0.4, 0.3, 0.2), (0.2, 0.1, 0.25), inward=True)
CORE = box((0.2, 0.15, 0.1), (0.2, 0.1, 0.25))
ASIDE = box((0.3, 0.4, 0.5), (2.0, 0.2, 0.3))
ACROSS = box((0.4, 0.3, 0.2), (0.6, 0.2, 0.3))


@records.of
def inertias_of_meshes():
    cases = {
        "box": OUTER,
        "inward box": box((1.0, 0.8, 0.6), (0.1, 0.2, 0.3), inward=True),
        "tetrahedron": TETRAHEDRON,
        "with a cavity": together(OUTER, INNER),
        "with a cavity that is oriented outward": together(OUTER, box((0.4, 0.3, 0.2), (0.2, 0.1, 0.25))),
        "with a core": together(OUTER, INNER, CORE),
        "two solids": together(OUTER, ASIDE),
        "cutting": together(OUTER, ACROSS),
        "twice the same": together(OUTER, OUTER),
    }
    answers = {}
    for name, surface in cases.items():
        answers[name] = [
            caught(lambda s=surface: Inertia.mesh(s, mass=2.5)),
            caught(lambda s=surface: Inertia.mesh(s, density=700.0, scale=0.5).mass),
        ]
    for scale in (0.9e-4, 1.1e-4, 9.9, 10.1):
        answers[f"scale {scale}"] = caught(lambda scale=scale: Inertia.mesh(OUTER, density=700.0, scale=scale).mass)
    for density in (0.9, 1.1, 22900.0, 23100.0):
        answers[f"density {density}"] = caught(lambda density=density: Inertia.mesh(OUTER, density=density).mass)
    return answers


@records.of
def meshes_that_are_not_closed():
    vertices, faces = OUTER
    doubled = np.concatenate([faces, faces])
    flipped = faces.copy()
    flipped[3] = flipped[3][::-1]
    flat = (vertices * [1, 1, 0], faces)
    cases = {
        "open": (vertices, faces[1:]),
        "flipped": (vertices, flipped),
        "doubled": (vertices, doubled),
        "flat": flat,
        "not finite": (vertices * np.nan, faces),
        "fraction": (vertices, faces * 1.0),
        "no such vertex": (vertices, faces + 1),
        "negative vertex": (vertices, faces - 1),
        "shape": (vertices[:, :2], faces),
        "edges": (vertices, faces[:, :2]),
        "no faces": (vertices, np.zeros((0, 3), int)),
        "three": (vertices, faces, 1),
        "number": 3.0,
    }
    answers = {name: tried(lambda s=surface: Inertia.mesh(s, mass=1.0)) for name, surface in cases.items()}
    answers["scale"] = [tried(lambda s=s: Inertia.mesh(OUTER, mass=1.0, scale=s)) for s in (0.0, -1.0, np.inf)]
    answers["mass"] = [
        tried(lambda: Inertia.mesh(OUTER)),
        tried(lambda: Inertia.mesh(OUTER, mass=1, density=1)),
        tried(lambda: Inertia.mesh(OUTER, mass=0.0)),
    ]
    for thickness in (5e-16, 1.5e-15):  # the edge of a cube of that volume is 0.8e-5 and 1.1e-5
        answers[f"thin {thickness}"] = tried(lambda t=thickness: Inertia.mesh(box((1.0, 1.0, t)), mass=1.0).mass)
    return answers


@records.of
def hulls_of_points():
    points = np.concatenate([OUTER[0], [[0.1, 0.2, 0.3]], TETRAHEDRON[0]])
    vertices, faces = mesh.convex_hull(points)
    return {
        "volume": mesh.mass_com_and_inertia((vertices, faces), None, 1000.0, 1.0),
        "vertices": sorted(map(tuple, vertices.tolist())),
        "count": len(faces),
        "flat": [mesh.convex_hull(points * [1, 1, 0]), mesh.hull_faces(points[:2, :2])],
        "in a plane": sorted(
            map(
                sorted, mesh.hull_faces(points[:, :2] + [[0.01 * k, 0.02 * k * k] for k in range(len(points))]).tolist()
            )
        ),
        "tetrahedron": sorted(sorted(face) for face in mesh.hull_faces(TETRAHEDRON[0]).tolist()),
    }


@records.of
def shells_and_their_nesting():
    solid = together(OUTER, INNER, CORE, ASIDE, ACROSS)
    count, numbers = shells.shell_numbers(solid[1])
    outward = [OUTER, (INNER[0], BOX_FACES), CORE, ASIDE, ACROSS]
    triangles = np.concatenate([v[f] for v, f in outward])
    points = np.array(
        [[0.1, 0.2, 0.3], [0.2, 0.1, 0.25], [3.0, 0.0, 0.0], [0.6, 0.2, 0.3], [-0.4, 0.2, 0.3], [0.1, 0.2, 0.6]]
    )
    nested = shells.nest(triangles, numbers, count)
    return {
        "numbers": [count, numbers],
        "edges": shells.edges_of(np.array([[0, 2, 1], [3, 4, 5]])),
        "nest": [nested.depth, nested.cutting, nested.sign],
        "winding": shells.winding(points, OUTER[0][OUTER[1]]),
        "winding of an inward shell": shells.winding(points, INNER[0][INNER[1]]),
        "inside": [[shells._is_inside(a[0][a[1]], b[0][b[1]]) for b in outward] for a in outward],
        "cut": [[shells._edges_cut(a[0][a[1]], b[0][b[1]]) for b in outward] for a in outward],
        "inside of an inward shell": [
            shells._is_inside(CORE[0][CORE[1]], OUTER[0][f]) for f in (OUTER[1], OUTER[1][:, ::-1])
        ],
        "touching": shells._edges_cut(OUTER[0][OUTER[1]], (OUTER[0] + [1.0, 0, 0])[OUTER[1]]),
        "boxes": shells._intersecting_boxes(
            np.array([[0.0, 0, 0], [2, 2, 2]]),
            np.array([[1.0, 1, 1], [3, 3, 3]]),
            np.array([[1.0, 0.5, 0.5], [2.5, 2.5, 3.5], [0.2, 0.3, 1.5]]),
            np.array([[2.0, 0.9, 0.9], [3, 3, 4], [0.4, 0.5, 2.5]]),
        ),
        "edges through faces": shells._edges_through_faces(
            np.array([[0.2, 0.3, -1.0], [0.2, 0.3, -1.0], [0.9, 0.8, -1.0], [0.2, 0.3, 1.0], [0.2, 0.3, 1e-9]]),
            np.array([[0.25, 0.3, 1.0], [0.25, 0.3, -0.5], [0.9, 0.8, 1.0], [0.2, 0.3, -0.5], [0.2, 0.3, -1.0]]),
            np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]] * 4 + [[[0.0, 0, 0], [0, 1, 0], [1, 0, 0]]]),
            1e-6,
        ),
    }


@records.of
def points_inside_of_shells():
    vertices, faces = together(OUTER, INNER, CORE, ASIDE)
    open_box = (ACROSS[0] + [4.0, 0, 0], ACROSS[1][1:])
    closed = enclosure.Enclosure(vertices, faces)
    mixed = enclosure.Enclosure(*together(OUTER, open_box))
    points = {
        "in the solid": [-0.3, 0.2, 0.3],
        "in the cavity": [0.35, 0.1, 0.25],
        "in the core": [0.2, 0.1, 0.25],
        "aside": [2.0, 0.2, 0.3],
        "outside": [1.2, 0.2, 0.3],
        "far": [5.0, 5.0, 5.0],
        "on a face": [-0.4, 0.2, 0.3],
        "in the open box": [4.6, 0.2, 0.3],
    }
    return {
        "closed": {name: closed.holds(np.array([p])) for name, p in points.items()},
        "mixed": {name: mixed.holds(np.array([p])) for name, p in points.items()},
        "several": [
            closed.holds(np.array([points["in the solid"], points["aside"]])),
            closed.holds(np.array([points["in the solid"], points["far"]])),
        ],
        "reaches": closed.reaches(np.array([*points.values()])),
        "tetrahedron": [
            enclosure.Enclosure(*TETRAHEDRON).holds(np.array([p]))
            for p in (
                [0.3, 0.3, 0.4],
                [0.8, 0.7, 1.2],
                [0.85, 0.15, 0.25],
                [0.6, 0.45, 0.15],
                TETRAHEDRON[0][:3].mean(axis=0),
            )
        ],
        "inward tetrahedron": [
            enclosure.Enclosure(TETRAHEDRON[0], TETRAHEDRON[1][:, ::-1]).holds(np.array([p]))
            for p in ([0.3, 0.3, 0.4], [0.8, 0.7, 1.2])
        ],
        "inward": enclosure.Enclosure(OUTER[0], OUTER[1][:, ::-1]).holds(np.array([[0.1, 0.2, 0.3]])),
        "cutting": enclosure.Enclosure(*together(OUTER, ACROSS)).holds(np.array([[0.55, 0.2, 0.3]])),
        "shells": [[len(shell.triangles), shell.closed, *shell.box] for shell in mixed.shells],
        "none": [
            enclosure.Enclosure(np.zeros((0, 3)), np.zeros((0, 3), int)).shells,
            enclosure.Enclosure(np.zeros((0, 3)), np.zeros((0, 3), int)).holds(np.zeros((1, 3))),
        ],
        "around": [
            None if (found := shell.around(np.array([0.2, 0.1, 0.25]))) is None else found[0] for shell in closed.shells
        ],
    }


def stl(surface):
    """Text of an STL file."""
    vertices, faces = surface
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corner) for corner in vertices[face])
        + "endloop\nendfacet\n"
        for face in faces
    )
    return f"solid a\n{facets}endsolid a\n"


def gltf(**more):
    """Text of a glTF file of one triangle, with a buffer inside."""
    import base64

    data = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 2, 0)
    content = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "translation": [1.0, 2.0, 3.0]}, {"mesh": 0, "rotation": [0.0, 0.0, 0.6, 0.8]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 2, 0]}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [
            {"byteLength": 36, "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
        ],
    }
    return json.dumps(content | more)


@records.of
def meshes_in_files(folder):
    obj = "mtllib a.mtl\no one\nv 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nusemtl red\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    texts = {
        "box.stl": stl(OUTER),
        "tetra.obj": obj,
        "a.mtl": "newmtl red\nKd 0.8 0.4 0.2\n",
        "outside.obj": obj.replace("a.mtl", "../b.mtl"),
        "points.obj": "v 0 0 0\nv 1 0 0\n",
        "colour.ply": "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 255 51 0\n1 0 0 255 51 0\n0 1 0 255 51 0\n3 0 1 2\n",
        "flat.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0.5\n3 0 1 2\n",
        "a.gltf": gltf(),
        "empty.gltf": gltf(accessors=[{"componentType": 5126, "count": 3, "type": "VEC3"}]),
        "two_parents.gltf": gltf(nodes=[{"children": [1, 2]}, {"mesh": 0}, {"children": [1]}]),
        "entity.dae": '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>',
    }
    answers = {}
    for name, text in texts.items():
        (folder / name).write_text(text, "utf-8")
    for name in texts:
        if not name.endswith(".mtl"):
            answers[name] = caught(
                lambda name=name: [
                    [sorted(part.vertices.tolist()), len(part.faces), part.colour]
                    for part in mesh_files.read_parts(folder / name)
                ]
            )["result"]
    answers["missing"] = tried(lambda: mesh_files.read_parts(folder / "none.stl"))
    answers["surface"] = [
        sorted(map(tuple, mesh.read_surface(folder / "box.stl")[0].round(9).tolist())),
        tried(lambda: mesh.read_surface(folder / "points.obj")),
    ]
    answers["inertia"] = [
        Inertia.mesh(folder / "box.stl", mass=2.0),
        Inertia.mesh(str(folder / "tetra.obj"), density=500.0),
        tried(lambda: Inertia.mesh(folder / "flat.off", mass=1.0)),
    ]
    answers["suffixes"] = mesh_files.SUFFIXES
    answers["faces"] = [
        tried(lambda f=f: mesh_files.check_faces(np.array(f), 4))
        for f in ([[0, 1, 3]], [[0, 1, 4]], [[-1, 2, 3]], [[-2, 2, 5]])
    ]
    return answers


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
