"""Joint types: every method of every kind on record."""

from __future__ import annotations

import numpy as np
import pytest
from recorded_answers import Records, refusal
from recorded_robots import flat

import twistwrench as tw
from twistwrench.mechanics.joints import JOINT_TYPES, RotorJoint, joint, screw_joint, units
from twistwrench.mechanics.joints.fixed_joint import Fixed
from twistwrench.mechanics.lie import se3, so3

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

KINDS = {**JOINT_TYPES, "fixed": Fixed}
TILTED = (2.0, -3.0, 6.0)
G = tw.SpatialInertia.from_com(1.7, (0.2, -0.5, 0.9), [[0.9, 0.1, -0.2], [0.1, 1.1, 0.05], [-0.2, 0.05, 1.3]])


def tried(call):
    """Result of a call, or its error."""
    try:
        return call()
    except Exception:
        return refusal(call)


def made(kind, axis=TILTED, pitch=0.0, normalise=True):
    joint_type = KINDS[kind]
    return joint_type(f"{kind}1", joint_type.axes_from(axis, pitch, normalise, f"joint {kind}1"))


def joints():
    found = {kind: made(kind, pitch=0.3 if kind == "helical" else 0.0) for kind in KINDS}
    found["offset revolute"] = made("revolute", (0.0, 0.6, -0.8, 0.4, 0.1, -0.2))
    found["revolute about -y"] = made("revolute", (0.0, -2.0, 0.0))
    found["long revolute"] = made("revolute", (1.0, -2.0, 2.0, 0.3, 0.5, 0.7), normalise=False)
    found["prismatic along z"] = made("prismatic", (0.0, 0.0, 3.0))
    found["planar in xy"] = made("planar", (0.0, 0.0, 1.0))
    found["planar in zx"] = made("planar", (0.0, 4.0, 0.0))
    found["planar, upside down"] = made("planar", (0.0, 0.0, -1.0))
    found["rotor"] = RotorJoint("rotor1", np.array([[0.6, 0.0, -0.8, 0.0, 0.0, 0.0]]))
    return found


def coordinates(one, shift=0.0):
    """Coordinates of a joint, not normalised."""
    numbers = np.array([0.6, -0.5, 0.3, 0.8, 1.2, -0.7, 0.4]) + shift * np.array([0.2, 0.1, -0.3, 0.05, -0.4, 0.5, 0.3])
    return numbers[: one.nq] if one.quaternion is not None else numbers[1 : 1 + one.nq]


def of_each(call):
    return {name: tried(lambda one=one: call(one)) for name, one in joints().items()}


@records.of
def what_each_kind_is():
    return of_each(
        lambda one: {
            "kind": one.kind,
            "axes": one.axes,
            "sizes": [one.nq, one.nv],
            "names": [one.coordinate_suffixes, one.velocity_suffixes],
            "neutral": one.neutral,
            "turning": one.turning,
            "units": one.coordinate_units if one.nv else None,
            "angle": one.angle,
            "flags": [one.plain_rates, one.moves_body, one.driven, one.wraps, one.pinocchio_order, one.quaternion],
        }
    )


@records.of
def tables_of_each_kind():
    return {
        name: {"chart": tried(lambda one=one: one.chart), "sliders": tried(lambda one=one: one.sliders)}
        for name, one in joints().items()
    }


@records.of
def poses_and_inertias_of_each_kind():
    return of_each(lambda one: flat(one.pose(coordinates(one))[:3], one.carry(G, coordinates(one)).parameters))


@records.of
def motions_of_each_kind():
    def answers(one):
        q = coordinates(one)
        dv = np.array([0.4, -0.7, 0.9, 0.5, 1.1, -0.3])[: one.nv]
        other = coordinates(one, 1.0)
        near_turn = dv * 3.1
        return flat(
            {
                "add": one.add(q, dv, q),
                "add at other angles": one.add(q, dv, other),
                "subtract": one.subtract(q, other),
                "subtract back": one.subtract(other, q),
                "subtract the long way": one.subtract(np.asarray(one.add(q, near_turn, q), float), q),
                "rates": one.rates(q),
                "slopes": [[R, dR] for R, dR in one.rotation_slopes(q)],
            }
        )

    return of_each(answers)


@records.of
def velocities_of_rows_of_each_kind():
    def answers(one):
        q, q1, q2 = (np.stack([coordinates(one, s), coordinates(one, s + 1.7)]) for s in (0.0, 0.6, -0.9))
        return flat(one.velocities(q, q1, q2))

    return of_each(answers)


@records.of
def uncertainties_of_each_kind():
    error = np.array([0.01, 0.04, 0.02, 0.03, 0.07, 0.05, 0.06])
    return of_each(
        lambda one: [one.spread(error[: one.nq]), one.bound(error[: one.nq] * [1, -1, 1, -1, 1, -1, 1][: one.nq])]
    )


@records.of
def random_coordinates_of_each_kind():
    low, high = np.array([-0.5, 1.0, -3.0, 0.1, 5.0, 7.0]), np.array([0.4, 1.5, -2.0, 0.7, 6.0, 9.0])
    return of_each(lambda one: one.random(np.random.default_rng(7), (2, 3), low[: one.nv], high[: one.nv]))


@records.of
def coordinates_in_other_libraries():
    def answers(one):
        q = np.stack([coordinates(one), coordinates(one, 1.0)])
        dq = np.array([0.4, -0.7, 0.9, 0.5, 1.1, -0.3])[: one.nv]
        return {
            "pinocchio": [one.to_pinocchio(q), one.from_pinocchio(q), tried(one.require_pinocchio)],
            "mujoco": [one.to_mujoco(q), one.from_mujoco(q), one.mujoco_rates(q[0]), one.mujoco_turning(dq)],
        }

    return of_each(answers)


@records.of
def charts_of_each_kind():
    R = so3._exp(np.array([0.3, -0.4, 0.7]))

    def answers(one):
        u = np.array([0.3, -0.6, 0.9, 0.5, 1.1, -0.8])[: one.nv]
        du = np.array([1.3, 0.4, -0.7, 0.2, 0.6, -1.5])[: one.nv]

        def cosine_sine(k):
            return np.cos(u[k]), np.sin(u[k])

        return {
            "from": one.from_chart(u, du),
            "pose": tried(lambda: one.chart_pose(cosine_sine, lambda k: u[k])),
            "columns": [tried(lambda k=k: one.chart_column(k, lambda v: R @ v, cosine_sine)) for k in range(one.nv)],
        }

    return of_each(answers)


@records.of
def exact_numbers():
    u = np.array([0.3, -0.6, 0.9, 0.5])

    def cosine_sine(k):
        return np.cos(u[k]), np.sin(u[k])

    return {
        "exact": [joint.exact(2.0), joint.exact(2.5), joint.exact(np.array([[1.0, 0.5], [-3.0, 0.0]]))],
        "rodrigues": joint.exact_rodrigues(np.array([0.0, 0.6, -0.8]), 0.28, 0.96),
        "euler rotation": [joint.euler_rotation(0, cosine_sine), joint.euler_rotation(1, cosine_sine)],
        "euler axes": [joint.euler_axis(k, first, cosine_sine) for k in range(3) for first in (0, 1)],
        "euler rates": joint.euler_rates(u[:3], np.array([0.7, -1.3, 0.4])),
        "types": [type(joint.exact(2.0)).__name__, type(joint.exact(2.5)).__name__],
    }


@records.of
def configurations_that_are_possible():
    ball, floating, revolute = made("ball"), made("floating"), made("revolute")
    return [
        ball.is_configuration(np.array([0.0, 0, 0, 0])),
        ball.is_configuration(np.array([[0.0, 0, 0, 1e-9], [0, 0, 0, 0]])),
        ball.is_configuration(np.array([[0.0, 0, 0, 1e-9], [1, 0, 0, 0]])),
        floating.is_configuration(np.array([0.0, 0, 0, 0, 1, 2, 3])),
        floating.is_configuration(np.array([0.0, 0, 0, 2.0, 0, 0, 0])),
        revolute.is_configuration(np.array([0.0])),
    ]


@records.of
def axes_that_are_given_in_many_ways():
    answers = {}
    for kind in KINDS:
        for name, arguments in {
            "direction": ((0.0, 3.0, -4.0),),
            "negative coordinate axis": ((0.0, 0.0, -7.0),),
            "not normalised": ((0.0, 3.0, -4.0), 0.0, False),
            "pitch": ((0.0, 3.0, -4.0), 0.25),
            "pitch, not normalised": ((0.0, 3.0, -4.0), 0.25, False),
            "screw": ((0.0, 3.0, -4.0, 1.0, 2.0, 0.5),),
            "screw, not normalised": ((0.0, 3.0, -4.0, 1.0, 2.0, 0.5), 0.0, False),
            "screw and pitch": ((0.0, 3.0, -4.0, 1.0, 2.0, 0.5), 0.25),
            "translation": ((0.0, 0.0, 0.0, 1.0, 2.0, -2.0),),
            "translation, not normalised": ((0.0, 0.0, 0.0, 1.0, 2.0, -2.0), 0.0, False),
            "zero": ((0.0, 0.0, 0.0),),
            "zero screw": ((0.0,) * 6,),
            "text": ("x",),
            "four": ((1.0, 2.0, 3.0, 4.0),),
            "infinite": ((1.0, np.inf, 3.0),),
            "pitch that is not a number": ((1.0, 2.0, 3.0), np.nan),
            "tiny": ((3e-200, 0.0, -4e-200),),
        }.items():
            answers[f"{kind}: {name}"] = tried(lambda kind=kind, a=arguments: made(kind, *a).axes.tolist())
    return answers


@records.of
def parts_of_screws():
    S = np.array([1.0, -2.0, 2.0, 0.3, 0.5, 0.7])
    rounded = np.array([0.6, 0.0, 0.8 + 1e-16, 0.1, 0.2, 0.3])
    return {
        "motion": [
            screw_joint.screw_motion(S, 0.4),
            screw_joint.screw_motion(S / 3.0, 0.4),
            screw_joint.screw_motion(rounded, -1.3),
        ],
        "translation": screw_joint.screw_motion(np.array([0, 0, 0, 1.0, 2.0, 3.0]), 0.5),
        "almost a unit vector": screw_joint.screw_motion(np.array([0.6, 0, 0.8 + 1e-9, 0.1, 0.2, 0.3]), 2.0),
        "equal to exp": abs(screw_joint.screw_motion(S, 0.4) - se3._exp(0.4 * S)).max() < 1e-14,
        "rodrigues": screw_joint.rodrigues(np.array([0.6, 0.0, 0.8]), 0.28, 0.96),
        "through": [
            screw_joint.screw_through(kind, np.array([0.6, 0.0, 0.8]), np.array([0.3, 0.5, -0.7]))
            for kind in ("revolute", "prismatic")
        ],
        "unit vectors": [
            screw_joint.unit_vector(np.array(v))
            for v in ([0.0, -5.0, 0.0], [3.0, 0.0, 4.0], [1e-300, -1e-300, 0.0], [1e300, 2e300, 2e300])
        ],
        "planes": [
            screw_joint.plane_of(np.array(v))
            for v in (
                [1.0, 0, 0],
                [0, 1.0, 0],
                [0, 0, 1.0],
                [-1.0, 0, 0],
                [0, 0, -1.0],
                [0.6, 0, -0.8],
                [2 / 3, -1 / 3, 2 / 3],
            )
        ],
        "numbers": [
            screw_joint.number(2.5, "a"),
            screw_joint.number(np.array(3), "a"),
            tried(lambda: screw_joint.number(np.inf, "the mass")),
            tried(lambda: screw_joint.number("x", "the mass")),
            tried(lambda: screw_joint.numbers([1, 2], (3,), "the axis")),
            tried(lambda: screw_joint.numbers([1, np.nan], (2,), "the pair")),
        ],
    }


@records.of
def units_of_quantities():
    parts = ("q", "dq", "ddq", "dddq", "tau", "command")
    return {
        "units": {
            part: [units.unit_of(part, turns, degrees=d) for turns in (True, False) for d in (False, True)]
            for part in parts
        },
        "many": units.units_of("tau", np.array([True, False, True])),
        "headings": {
            part: [
                units.heading_unit(part, t, degrees=d)
                for t in ((True, True), (False, True), (False,), ())
                for d in (False, True)
            ]
            for part in parts
        },
        "words": [units.torque_word("N m"), units.torque_word("N")],
        "kinds": list(JOINT_TYPES),
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
