"""Models of robots, how they are built, changed and joined: complete answers on record."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import warnings
from pathlib import Path

import numpy as np
import pytest
from recorded_answers import Records, refusal
from recorded_robots import (
    MODELS,
    builder_of_tree,
    chain,
    chain_builder,
    coupled,
    driven,
    flat,
    floating,
    inertia,
    laws,
    placed,
    state,
    tree,
)

import twistwrench as tw
from twistwrench.mechanics.bodies.inertia import SpatialInertia
from twistwrench.mechanics.lie import so3
from twistwrench.mechanics.model import (
    actuation,
    actuators,
    assembly,
    configurations,
    couplings,
    description,
    edit,
    inertia_checks,
    joining,
    legs,
    limits,
    mimic,
    parameters,
    parts,
    snapping,
)
from twistwrench.mechanics.model.actuators import Actuator, Motor, Rotor, Thermal
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.mechanics.model.couplings import Coupling
from twistwrench.mechanics.model.limits import Friction, Limits
from twistwrench.mechanics.model.model import OfferedClosure, Spring

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)


def tried(call):
    """Result of a call, or its error."""
    try:
        return call()
    except Exception:
        return refusal(call)


def fields(one):
    return {field.name: getattr(one, field.name) for field in dataclasses.fields(one)}


def shown(model):
    """Everything that a model holds."""
    return {
        "name": [model.name, model.source, model.snap, model.tip, model.leaves, model.defects, model.mounted],
        "bodies": [
            [b.joint.name, b.joint.kind, b.link, b.parent, b.q_index, b.v_index, b.ratio, b.offset, b.follows, b.effort]
            for b in model.bodies
        ],
        "numbers of bodies": np.array(
            [np.concatenate([b.placement[:3].ravel(), b.inertia.parameters]) for b in model.bodies], float
        ),
        "axes": np.concatenate([np.zeros((0, 6)), *[b.joint.axes for b in model.bodies]]),
        "frames": [[name, frame.body] for name, frame in model.all_frames.items()],
        "poses": np.array([frame.pose[:3] for frame in model.all_frames.values()]),
        "gravity": model.gravity,
        "base": model.base_inertia.parameters,
        "links": {name: float(G.parameters @ np.arange(1.0, 11.0)) for name, G in model.link_inertias.items()},
        "limits": fields(model.limits),
        "friction": fields(model.friction),
        "armature": model.armature,
        "springs": model.springs,
        "actuators": {name: [a.joint, a.ratio, a.stiffness] for name, a in model.actuators.items()},
        "payloads": [[frame, G.parameters] for frame, G in model.payloads],
        "configurations": model.configurations,
        "couplings": [[c.name, c.motors, c.joints, c.motor_per_joint] for c in model.couplings],
        "closures": model.closures,
        "sets": [model.shaped, model.motor_joints, model.mounts, model.locked],
    }


def brief(model):
    """What a change of a model may change."""
    return {
        "bodies": [
            f"{b.joint.name} {b.joint.kind} {b.link} {b.parent} {b.q_index} {b.v_index} {b.ratio:.6g} {b.offset:.6g} {b.follows} {b.effort:.6g}"
            for b in model.bodies
        ],
        "numbers": flat(
            [[b.placement, b.inertia.parameters, b.joint.axes] for b in model.bodies],
            [frame.pose for frame in model.all_frames.values()],
            [G.parameters for G in model.link_inertias.values()],
            model.base_inertia.parameters,
            model.armature,
        ),
        "limits": flat(fields(model.limits)),
        "friction": flat(fields(model.friction)),
        "frames": " ".join(f"{name}:{frame.body}" for name, frame in model.all_frames.items()),
        "mounts": " ".join(f"{link}<{carrier}/{joint}" for link, (carrier, joint) in model.mounts.items()),
        "actuators": [f"{name} {a.joint} {a.ratio:.6g} {a.stiffness:.6g}" for name, a in model.actuators.items()],
        "sets": [model.shaped, model.motor_joints, model.locked],
    }


def caught(call):
    """Result and texts of warnings."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        result = tried(call)
    texts = [f"{x.category.__name__}: {x.message}" for x in found]
    return {"result": result, "warnings": texts, "where": {Path(x.filename).name for x in found}}


# ── Models


@records.of
def whole_models():
    return {name: shown(make()) for name, make in MODELS.items()}


@records.of
def names_and_places_in_models():
    def answers(model):
        return {
            "sizes": [model.nq, model.nv, repr(model), model.moving_mass],
            "names": [model.joint_names, model.coordinate_names, model.velocity_names],
            "drives": [model.drive_names, model.drive_labels, model.coupled_motors],
            "leaders": [[name, body.link] for name, body in model.leaders_by_name.items()],
            "quaternions": [[s.start, s.stop] for s in model.quaternions],
            "neutral": model.neutral,
            "positions": [model.positions(state(model)[0]), model.positions(np.stack([state(model)[0]] * 2)).shape],
            "ancestors": [model.ancestors(i) for i in range(len(model.bodies))],
            "tips": model.possible_tips,
            "followers": model.limited_followers,
            "locked": model.all_locked,
            "coordinates": [b.coordinates(state(model)[0]) for b in model.bodies],
        }

    found = {name: answers(make()) for name, make in MODELS.items()}
    model = tree()
    found["frame"] = [
        model.frame("eye").body,
        model.frame(None).body,
        tried(lambda: model.frame("nowhere")),
        tried(lambda: model.frame(3)),
        tried(lambda: model.frame(["eye"])),
        tried(lambda: dataclasses.replace(model, tip=None).frame(None)),
    ]
    found["drive index"] = [
        tried(lambda j=j: model.drive_index(j)) for j in ("shoulder", "lift", "wrist", "mirrored", "pinch", "nothing")
    ]
    found["drive index of coupled"] = [
        tried(lambda j=j: coupled().drive_index(j)) for j in ("inner", "outer", "last", "joint4", "joint3", "nothing")
    ]
    return found


@records.of
def copies_of_models():
    answers = {}
    for name, make in MODELS.items():
        again = pickle.loads(pickle.dumps(make()))
        answers[name] = [
            float(np.abs(brief(again)["numbers"] - brief(make())["numbers"]).max()),
            again.armature.flags.writeable,
            again.limits.lower.flags.writeable,
            again.bodies[0].placement.flags.writeable,
            again.friction.viscous.flags.writeable,
            tried(
                lambda again=again: again.actuators.update({}) if hasattr(again.actuators, "update") else "read only"
            ),
        ]
    rotor = pickle.loads(pickle.dumps(Rotor(1.0, axis=(1, 2, 3))))
    answers["rotor"] = [rotor.axis.flags.writeable, rotor.place.flags.writeable, copy.deepcopy(rotor).axis]
    return answers


@records.of
def springs_with_joints_that_are_fixed():
    spring = Spring((("a", 0.5), ("b", -2.0), ("c", 3.0)), 40.0, 0.7)
    return [
        spring.joints,
        spring.with_fixed({"b": 0.3}),
        spring.with_fixed({"a": 1.0, "b": 2.0, "c": 3.0}),
        spring.with_fixed({"d": 9.0}),
    ]


# ── Building


@records.of
def options_of_building():
    def built(**options):
        builder = builder_of_tree()
        builder.add_actuator(Actuator("spin", 5.0, 0.9, 0.1, Motor(0.1)), {"viscous": 0.2, "coulomb": 0.4})
        builder.add_actuator(Actuator("lift", 3.0), {"coulomb": 0.6, "static": 0.9, "stribeck": 0.1})
        builder.add_motors(["lift", "spin"])
        return builder.build(quiet=True, **options)

    return {
        "as it is": brief(built()),
        "floating": brief(built(floating_base=True)),
        "independent": brief(built(mimic="independent")),
        "locked": brief(built(lock={"shoulder": 0.3, "drive": [0.1, 0.2, 0.3]})),
        "gravity": built(gravity=(1, 2, 3)).gravity,
        "tip": [built(tip="finger").tip, built().tip, built(tip="eye").tip, chain(3).tip],
        "not snapped": np.array([b.placement for b in built(snap=0).bodies]),
        "refused": {
            str(options): tried(lambda options=options: built(**options))
            for options in (
                {"mimic": "x"},
                {"inertia": "x"},
                {"snap": 0.1},
                {"snap": -1},
                {"tip": "nowhere"},
                {"lock": {"mirrored": 1}},
                {"gravity": [1, 2]},
            )
        },
    }


def small(**joint):
    """Builder of two links and a joint."""
    builder = ModelBuilder("small", "small.file")
    builder.add_link("base", inertia(1), "line 1")
    builder.add_link("arm", inertia(2), "line 2")
    builder.add_joint(
        **({"name": "j", "kind": "revolute", "parent": "base", "child": "arm", "where": "line 3"} | joint)
    )
    return builder


@records.of
def joints_that_are_given_in_many_ways():
    cases = {
        "plain": {},
        "limits": {"lower": -1, "upper": 2, "velocity": 3, "effort": 4, "acceleration": 5, "jerk": 6},
        "deceleration": {"deceleration": 5},
        "no range": {"lower": 0, "upper": 0},
        "lower alone": {"lower": -1},
        "upper alone": {"upper": 1},
        "equal": {"lower": 1, "upper": 1},
        "reversed": {"lower": 2, "upper": 1},
        "infinite lower": {"lower": np.inf},
        "infinite upper": {"upper": -np.inf},
        "not a number": {"upper": np.nan},
        "text": {"lower": "x"},
        "no velocity": {"velocity": 0},
        "negative effort": {"effort": -1},
        "jerk that is not a number": {"jerk": np.nan},
        "continuous with limits": {"kind": "continuous", "lower": -1, "upper": 1, "velocity": 2},
        "ball": {"kind": "ball", "damping": 0.2, "armature": 0.1},
        "ball with limits": {"kind": "ball", "velocity": 2.0},
        "fixed with limits": {"kind": "fixed", "velocity": 2.0},
        "helical": {"kind": "helical", "pitch": 0.1, "axis": (0, 3, 4)},
        "pitch": {"pitch": 0.1},
        "axis": {"axis": (0, -2, 0)},
        "long axis": {"axis": (0, -2, 1), "normalise_axes": False},
        "zero axis": {"axis": (0, 0, 0)},
        "kind": {"kind": "hinge"},
        "negative damping": {"damping": -0.1},
        "negative friction": {"friction": -0.2},
        "negative armature": {"armature": -0.3},
        "infinite damping": {"damping": np.inf},
        "placement": {"placement": placed((0.1, 0.2, 0.3), (1, 2, 3))},
        "rounded placement": {"placement": placed((0.1, 0.2, 0.3), (1, 2, 3)).round(8)},
        "rough placement": {"placement": placed((0.1, 0.2, 0.3), (1, 2, 3)).round(4)},
        "mirrored placement": {"placement": np.diag([1.0, 1, -1, 1])},
        "last row": {"placement": np.diag([1.0, 1, 1, 2])},
        "small placement": {"placement": np.eye(3)},
        "mimic of nothing": {"mimic": ("x", 1.0, 0.0)},
        "mimic of itself": {"mimic": ("j", 1.0, 0.0)},
        "mimic that is not a number": {"mimic": ("j", np.nan, 0.0)},
        "no name": {"name": ""},
        "number as name": {"name": 3},
        "no parent": {"parent": "nobody"},
        "no child": {"child": "nobody"},
        "from the world": {"parent": "world"},
        "its own child": {"child": "base"},
    }

    def answer(case):
        model = small(**case).build(quiet=True)
        body = model.bodies[0] if model.bodies else None
        return {
            "limits": [np.concatenate([getattr(model.limits, name) for name in fields(model.limits)])],
            "defects": model.defects,
            "body": None if body is None else [body.joint.axes, body.placement[:3]],
            "losses": [model.friction.viscous, model.friction.coulomb, model.armature],
        }

    return {name: tried(lambda case=case: answer(case)) for name, case in cases.items()}


@records.of
def mistakes_of_building():
    def with_more(change):
        builder = small()
        change(builder)
        return builder.build(quiet=True).defects

    calls = {
        "link twice": lambda b: b.add_link("arm", where="line 9"),
        "link without a name": lambda b: b.add_link(""),
        "joint twice": lambda b: b.add_joint("j", "fixed", "base", "arm"),
        "two parents": lambda b: b.add_joint("k", "fixed", "base", "arm"),
        "two roots": lambda b: b.add_link("other", where="line 8"),
        "cycle": lambda b: b.add_joint("k", "fixed", "arm", "base"),
        "cycle apart": lambda b: [
            b.add_link("x"),
            b.add_link("y"),
            b.add_joint("k", "fixed", "x", "y"),
            b.add_joint("l", "ball", "y", "x"),
        ],
        "not finite": lambda b: b.add_link("x", SpatialInertia.from_parameters([np.nan] * 10)),
        "negative mass": lambda b: b.add_link("x", SpatialInertia.from_com(-1.0), "line 7"),
        "site on nothing": lambda b: b.add_site("s", "x", where="line 6"),
        "site twice": lambda b: [b.add_site("s", "arm"), b.add_site("s", "base")],
        "spring on nothing": lambda b: b.add_spring({"x": 1.0}, 1.0, where="line 5"),
        "spring that is not a number": lambda b: b.add_spring({"j": 1.0}, np.nan, where="line 5"),
        "mimic cycle": lambda b: [
            b.add_link("x"),
            b.add_link("y"),
            b.add_joint("k", "revolute", "arm", "x", mimic=("l", 1.0, 0.0)),
            b.add_joint("l", "revolute", "x", "y", mimic=("k", 2.0, 0.0)),
        ],
        "mimic of a ball": lambda b: [
            b.add_link("x"),
            b.add_link("y"),
            b.add_joint("k", "ball", "arm", "x"),
            b.add_joint("l", "revolute", "x", "y", mimic=("k", 2.0, 0.0)),
        ],
        "ball that mimics": lambda b: [b.add_link("x"), b.add_joint("k", "ball", "arm", "x", mimic=("j", 2.0, 0.0))],
    }
    answers = {name: tried(lambda call=call: with_more(call)) for name, call in calls.items()}
    builder = small()
    answers["site with the name of a link"] = [builder.add_site("arm", "base"), builder.site_names, builder.link_names]
    builder.remark("a remark")
    builder.note("link 'arm'", "is green")
    builder.note("link 'base'", "is green")
    answers["remarks"] = caught(lambda: builder.build().defects)
    answers["nothing"] = tried(lambda: ModelBuilder("none").build())
    answers["root joint"] = tried(lambda: small(name="root_joint").build(floating_base=True))
    answers["floating twice"] = caught(lambda: small(kind="floating").build(floating_base=True).nv)
    answers["floating"] = caught(lambda: small(kind="floating").build().nv)
    return answers


@records.of
def links_without_mass_and_links_that_cannot_be():
    bad = SpatialInertia.from_com(1.0, (0.1, 0.2, 0.3), np.diag([1.0, 1.5, 3.0]))
    answers = {}
    for name, links in {
        "massless end": {"a": inertia(1), "b": None, "c": None},
        "massless middle": {"a": None, "b": inertia(1), "c": inertia(2)},
        "point": {"a": SpatialInertia.from_com(2.0, (0.1, 0.2, 0.3)), "b": inertia(1), "c": inertia(2)},
        "bad": {"a": bad, "b": inertia(1), "c": bad},
        "no mass": {
            "a": SpatialInertia.from_parameters([0, 0, 0, 0, 1, 0, 1, 0, 0, 1]),
            "b": inertia(1),
            "c": SpatialInertia.from_parameters([0, 0, 0, 0, 1, 0, 1, 0, 0, 3]),
        },
        "flat": {"a": SpatialInertia.from_com(1.0, (0, 0, 0), np.diag([0, 0, 0.4])), "b": inertia(1), "c": inertia(2)},
        "fused": {
            "a": inertia(1),
            "b": inertia(5),
            "c": SpatialInertia.from_com(0.01, (0.1, 0, 0), np.diag([0.001, 0.001, 0.003])),
        },
        "fused, bad": {"a": inertia(1), "b": bad, "c": bad},
    }.items():
        for policy in ("error", "accept", "repair"):
            builder = ModelBuilder(name)
            builder.add_link("base", bad if name == "fused" else None, "line 0")
            parent = "base"
            for k, (link, G) in enumerate(links.items()):
                builder.add_link(link, G, f"line {k + 1}", shaped=link == "b")
                kind = "fixed" if name.startswith("fused") and link == "c" else "revolute"
                builder.add_joint(f"to_{link}", kind, parent, link, placement=placed(p=(0.1 + k, 0, 0)))
                parent = link

            def answer(builder=builder, policy=policy):
                model = builder.build(inertia=policy, quiet=True)
                return [model.defects, np.array([b.inertia.parameters for b in model.bodies])]

            answers[f"{name}, {policy}"] = tried(answer)
    model = tree()
    answers["checks"] = [
        inertia_checks.massless_links(model),
        inertia_checks.massless_links(dataclasses.replace(model, shaped=frozenset())),
        [inertia_checks.moved_moments(model, i) for i in range(3)],
        inertia_checks._consistent_mask([inertia(3), bad, SpatialInertia.zero(), SpatialInertia.from_com(1.0)]),
        inertia_checks.reasons(SpatialInertia.from_parameters([0, 0, 0, 0, 1, 0, 1, 0, 0, 3])),
        [
            inertia_checks._has_one_moment(SpatialInertia.from_com(m, (0, 0, 0), np.diag([x, 0, 1.0])))
            for m, x in ((1.0, 0.0), (1.0, 0.5e-9), (1.0, 2e-9), (0.0, 0.0))
        ],
    ]
    many = ModelBuilder("many")
    many.add_link("base")
    for k in range(5):
        many.add_link(f"l{k}", bad)
        many.add_joint(f"j{k}", "revolute", "base", f"l{k}")
    answers["many"] = tried(many.build)
    return answers


@records.of
def remarks_of_models():
    note = description.ModelNote
    remarks = [
        "first",
        note("link 'a'", "is red"),
        note("link 'b'", "is blue"),
        "first",
        *(note(f"link '{k}'", "is red") for k in range(7)),
        note("c", "is blue"),
    ]
    return {
        "grouped": description.grouped(remarks),
        "sentences": description.sentences("robot", remarks[:2]),
        "copy": [pickle.loads(pickle.dumps(remarks[1])).subject, remarks[1].predicate, str(remarks[1])],
        "issued": caught(lambda: description.issue(["one.", "two."])),
        "labels": [
            description.label("joint", "a", "line 3"),
            description.label("joint", "a" * 300, ""),
            description.label("joint", 3, ""),
        ],
        "unused": [description.unused("a", {"a", "a_"}), description.unused("b", {"a"})],
        "types": list(description.TYPES),
    }


@records.of
def poses_that_are_snapped():
    answers = {}
    quarter = so3._exp(np.array([0, 0, np.pi / 2]))
    noise = np.array([[1.0, -2.0, 3.0], [2.0, 1.0, -1.0], [-3.0, 1.0, 2.0]])
    cases = {
        "quarter": quarter + 1e-12 * noise,
        "quarter, rough": quarter + 1e-8 * noise,
        "about x": so3._exp(np.array([0.7, 0, 0])) + 1e-11 * noise,
        "about y": so3._exp(np.array([0, 0.7, 0])) + 1e-11 * noise,
        "mirrored block": np.diag([1.0, 1.0, -1.0]) @ so3._exp(np.array([0, 0, 0.6])) + 1e-12 * noise,
        "one zero": so3._exp(np.array([0, 0.4, 0])) @ so3._exp(np.array([0.9, 0, 0]))
        + 1e-12 * noise * (np.eye(3)[[1, 0, 2]] == 1),
        "no zero": so3._exp(np.array([0.3, 0.4, 0.5])),
        "far": quarter + 1e-3 * noise,
    }
    for name, R in cases.items():
        answers[name] = [snapping.snap_rotation(R), snapping.snap_rotation(R, 1e-6), snapping.snap_rotation(R, 0)]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cases["quarter"], (1.0, -0.0, 3.0)
    upright = np.eye(4)
    upright[:3, 3] = (-0.0, 2.0, -0.0)
    answers["poses"] = [
        snapping.snap_pose(T),
        snapping.snap_pose(T, 0),
        snapping.snap_pose(upright),
        str(snapping.snap_pose(upright)[:3, 3].tolist()),
    ]
    answers["helpers"] = [
        snapping._nearest_orthogonal(np.array([[0.8, -0.6], [0.61, 0.8]])),
        snapping._nearest_orthogonal(np.array([[0.8, 0.6], [0.61, -0.8]])),
        snapping._orthonormalise_from_row(cases["no zero"] + 0.01 * noise, 1),
        snapping._is_rotation(cases["no zero"], 1e-12),
        snapping._is_rotation(cases["far"], 1e-12),
    ]
    return answers


@records.of(relative=1e-4)
def shifts_by_snapping():
    """What snapping moves, in billionths."""
    one_zero = so3._exp(np.array([0, 0.4, 0])) @ so3._exp(np.array([0.9, 0, 0]))
    shift = 1e-10 * np.array([[1.0, -2.0, 3.0], [2.0, 1.5, -1.0], [-3.0, 1.0, 2.0]])
    turned = [np.roll(np.roll(one_zero + shift, i, axis=0), j, axis=1) for i in range(3) for j in range(3)]
    block = so3._exp(np.array([0, 0.7, 0])) + shift
    return [1e9 * (snapping.snap_rotation(R) - R) for R in (*turned, block, block.T)]


@records.of
def what_is_compared_by_its_values():
    motor = Motor(0.05)
    pairs = {
        "actuators": [Actuator("a"), Actuator("a")],
        "motors": [motor, Motor(0.05)],
        "thermal": [Thermal(1.0, 2.0), Thermal(1.0, 2.0)],
        "rotors": [Rotor(1.0), Rotor(1.0)],
        "springs": [Spring((("a", 1.0),), 2.0), Spring((("a", 1.0),), 2.0)],
        "closures": [OfferedClosure("a", "b"), OfferedClosure("a", "b")],
        "couplings": [Coupling("c", ("a",), ("b",), [[1.0]]), Coupling("c", ("a",), ("b",), [[1.0]])],
        "models": [chain(3), copy.deepcopy(chain(3))],
        "bodies": [chain(3).bodies[0], copy.deepcopy(chain(3)).bodies[0]],
    }
    return {name: [one == one, one == other, hash(one) == hash(other)] for name, (one, other) in pairs.items()}


@records.of
def coordinates_by_name():
    model = tree()
    rng = np.random.default_rng(3)
    return {
        "names": configurations.from_names(model, {"lift": 0.2, "wrist": [1, 2, 3, 4], "drive": (0.1, 0.2, 0.3)}),
        "refused": [
            tried(lambda j=j: configurations.from_names(model, j))
            for j in ({"x": 1}, {"lift": [1, 2]}, {"lift": "x"}, {"wrist": 1.0}, {"mirrored": 1.0})
        ],
        "random": {name: configurations.random_configuration(make(), rng, (2,)) for name, make in MODELS.items()},
        "random, limits on one side": [
            configurations._random(
                dataclasses.replace(
                    chain(3),
                    limits=dataclasses.replace(chain(3).limits, lower=np.array([a] * 3), upper=np.array([b] * 3)),
                ),
                chain(3).bodies[k],
                np.random.default_rng(4),
                (),
            )
            for k in (1, 2)
            for a, b in (
                (-np.inf, np.inf),
                (2.0, np.inf),
                (-np.inf, -5.0),
                (-5.0, np.inf),
                (-np.inf, 9.0),
                (-1000.0, 1000.0),
                (-1001.0, 999.0),
                (-999.0, 1001.0),
            )
        ],
    }


# ── Limits, friction, followers


@records.of
def limits_and_their_tolerance():
    three = Limits(
        np.array([-1.0, -np.inf, 0.0]),
        np.array([2.0, 3.0, 0.0]),
        np.array([1.0, 70.0, 120.0]),
        np.array([5.0, 6.0, 7.0]),
        deceleration=np.array([4.0, np.inf, 2.0]),
        acceleration=np.array([np.inf, 3.0, 1.0]),
    )
    t = three.tolerance
    dq = np.array([[1.0, -2.0, 1e-7], [-0.5, 0.0, 3.0]])
    ddq = np.array([[-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]])
    stated = limits.StatedLimits(**fields(three), stated=np.zeros(3), with_unit=np.arange(30).reshape(10, 3) % 2 == 0)
    return {
        "fields": fields(three),
        "tolerance": t,
        "exceeded": [three.exceeded(three.upper + share * t) for share in (0.9, 1.1)]
        + [three.exceeded(np.where(np.isfinite(three.lower), three.lower, -9.0) - share * t) for share in (0.9, 1.1)],
        "selected": fields(three.select([2, 0])),
        "accelerations of different limits": [
            dataclasses.replace(
                three, acceleration=np.array([4.0, 3.0, 1.0]), deceleration=np.array([5.0, 6.0, 2.0])
            ).acceleration_at(a, b)
            for a in (dq, -dq)
            for b in (ddq, -ddq)
        ],
        "accelerations": [
            three.acceleration_at(dq, ddq),
            three.acceleration_at(dq[0], ddq[0]),
            three.acceleration_at(0 * dq[0], ddq[0]),
        ],
        "units": [
            three.has_unit("effort"),
            stated.has_unit("velocity"),
            stated.has_unit("lower"),
            stated.has_unit("tilting"),
        ],
        "known velocities": limits.known_velocities(
            np.array([59.0, 60.0, 61.0, 99.0, 100.0]), np.array([True, True, True, False, False])
        ),
        "bears": [
            limits.bears(three),
            limits.bears(dataclasses.replace(three, radial=np.array([np.inf, 3.0, np.inf]))),
        ],
        "keys": [tried(lambda: three["velocity"]), tried(lambda: three["torque"])],
        "names": [limits.BEARINGS, limits.BEARING_UNITS, limits.LAWS, limits.FASTEST_TURN, limits.FASTEST_SLIDE],
    }


@records.of
def friction_that_is_changed():
    plain = Friction.plain([0.1, 0.2, 0.3], [0.4, 0.5, 0.6])
    return {
        "plain": plain,
        "selected": plain.select([2, 0]),
        "replaced": plain.replaced(1, static=0.9, stribeck=0.2),
        "extended": plain.extended(),
        "moved": plain.extended().replaced(1, load=0.3, static=0.8, stribeck=0.4).moved(1, 3),
        "any": [
            plain.any,
            Friction.plain([0.0], [0.0]).any,
            Friction.plain([0.0], [0.1]).any,
            Friction.plain([0.0], [0.0]).replaced(0, load=0.1).any,
        ],
        "writeable": [plain.viscous.flags.writeable, pickle.loads(pickle.dumps(plain)).load.flags.writeable],
    }


@records.of
def followers_and_their_limits():
    answers = {}
    for name, follower in {
        "wider": {"lower": -9, "upper": 9},
        "narrower": {"lower": -0.3, "upper": 0.4},
        "other way": {"lower": -0.3, "upper": 0.4, "ratio": -2.0},
        "beyond": {"lower": 5.0, "upper": 6.0},
        "faster": {"velocity": 9.0, "acceleration": 9.0, "deceleration": 8.0, "jerk": 90.0},
        "slower": {"velocity": 0.9, "acceleration": 0.8, "deceleration": 0.7, "jerk": 0.6},
        "does not move": {"ratio": 0.0, "lower": -0.1, "upper": 0.1},
        "almost the same": {
            "lower": -2.0 - 1e-9,
            "upper": 3.0 + 1e-9,
            "ratio": 1.0,
            "offset": 0.0,
            "velocity": 4.0 * (1 - 1e-9),
        },
        "fixed leader": {"leader": {"lower": 0.5, "upper": 0.5}, "lower": -0.3, "upper": 0.4},
    }.items():
        options = dict(follower)
        leader = options.pop("leader", {"lower": -2.0, "upper": 3.0})
        ratio, offset = options.pop("ratio", 0.5), options.pop("offset", 0.1)
        builder = small(velocity=4.0, acceleration=5.0, jerk=50.0, damping=0.3, armature=0.2, friction=0.4, **leader)
        builder.add_link("finger", inertia(3))
        builder.add_joint(
            "follower",
            "revolute",
            "arm",
            "finger",
            mimic=("j", ratio, offset),
            damping=0.7,
            armature=0.6,
            friction=0.5,
            effort=3.0,
            where="line 4",
            **options,
        )
        model = builder.build(quiet=True)
        answers[name] = [
            fields(model.limits),
            model.defects,
            model.friction.viscous,
            model.friction.coulomb,
            model.armature,
            [b.effort for b in model.bodies],
        ]
    builder = builder_of_tree()
    answers["drives"] = mimic.find_drives(builder._joints.values())
    return answers


# ── Drives


@records.of
def laws_of_motors():
    motor = Motor(0.06, 0.7, 0.002, 24.0, 5.0, 15.0, 300.0)
    plain = Motor(0.06)
    w = np.array([-301.0, -300.0, -100.0, 0.0, 150.0, 300.0, 301.0, 500.0, np.nan])
    return {
        "current": motor.current([0.3, -0.6]),
        "voltage": [motor.voltage_at([1.0, -2.0], [10.0, 20.0]), motor.voltage_at(1.0, 10.0, 30.0)],
        "heat": motor.heat([1.0, -2.0]),
        "greatest torque": [
            motor.greatest_torque(w),
            motor.greatest_torque(w, 5.0),
            plain.greatest_torque(w),
            Motor(0.06, voltage=9.0).greatest_torque(w, 3.0),
        ],
        "moving": [actuators.moving([1e-6, 1.1e-6, -1e-6, -2.0, 0.0]), actuators.STANDING],
        "gear": actuators.gear_input(
            [3.0, 3.0, -3.0, 3.0, -3.0], [1.0, -1.0, 1.0, 0.0, 0.9e-6], [0.8, 0.8, 0.8, 0.8, 0.5]
        ),
        "ratings": actuators.RATINGS,
    }


@records.of
def actuators_that_cannot_be():
    def checked(**options):
        return actuators.check_actuator(Actuator("j", **options))

    motor = {"torque_constant": 0.05, "resistance": 0.8, "voltage": 24.0}
    thermal = {"housing_ambient": 3.0, "housing_time": 900.0}
    cases = {
        "good": {
            "ratio": -50.0,
            "efficiency": 1.0,
            "no_load_torque": 0.1,
            "stiffness": 300.0,
            "rotor": Rotor(1e-5, mass=0.2),
            "motor": Motor(**motor, thermal=Thermal(**thermal)),
        },
        "ratio": {"ratio": 0.0},
        "large ratio": {"ratio": 2e9},
        "efficiency": {"efficiency": 0.0},
        "large efficiency": {"efficiency": 1.1},
        "no-load torque": {"no_load_torque": -0.1},
        "large no-load torque": {"no_load_torque": 2e12},
        "stiffness": {"stiffness": 0.0},
        "place": {"rotor": Rotor(1e-5, place=(np.inf, 0, 0))},
        "far place": {"rotor": Rotor(1e-5, place=(2e12, 0, 0))},
        "rotor": {"rotor": Rotor(0.0)},
        "largest place": {"rotor": Rotor(1e-5, place=(0, -1e12, 0))},
        "least numbers": {"ratio": 1e-6, "stiffness": 1e-18, "rotor": Rotor(1e-18), "motor": Motor(1e-18)},
        "largest numbers": {
            "ratio": -1e9,
            "stiffness": 1e12,
            "no_load_torque": 1e12,
            "rotor": Rotor(1e12, mass=1e12),
            "motor": Motor(1e12, 1e12),
        },
        "equal currents": {"motor": Motor(**motor, current_continuous=4.0, current_peak=4.0)},
        "rotor of negative mass": {"rotor": Rotor(1e-5, mass=-1.0)},
        "currents": {"motor": Motor(**motor, current_continuous=5.0, current_peak=4.0)},
        "torque constant": {"motor": Motor(0.0)},
        "resistance": {"motor": Motor(0.05, -1.0)},
        "no resistance": {"motor": Motor(0.05, 0.0)},
        "inductance": {"motor": Motor(0.05, inductance=-1.0)},
        "voltage": {"motor": Motor(0.05, voltage=0.0)},
        "speed": {"motor": Motor(0.05, speed=-3.0)},
        "peak": {"motor": Motor(0.05, current_peak=0.0)},
        "thermal": {"motor": Motor(**motor, thermal=Thermal(0.0, 900.0))},
        "half a winding": {"motor": Motor(**motor, thermal=Thermal(**thermal, winding_time=3.0))},
        "other half": {"motor": Motor(**motor, thermal=Thermal(**thermal, winding_housing=3.0))},
        "winding": {"motor": Motor(**motor, thermal=Thermal(**thermal, winding_housing=2.0, winding_time=3.0))},
        "temperature": {"motor": Motor(**motor, thermal=Thermal(**thermal, maximum=20.0))},
        "coefficient": {"motor": Motor(**motor, thermal=Thermal(**thermal, coefficient=np.inf))},
    }
    return {name: tried(lambda case=case: checked(**case)) for name, case in cases.items()}


@records.of
def drives_that_are_added():
    free = edit.with_armature(chain(5), dict.fromkeys(("joint1", "joint2", "joint4", "joint5"), 0))
    rotors = {
        "armature": ("joint3", Rotor(1e-4)),
        "inside": ("joint4", Rotor(1e-5)),
        "extra": ("joint4", Rotor(1e-5, True, 0.3)),
        "on its own link": ("joint4", Rotor(1e-5, link="link5")),
        "on another link": ("joint4", Rotor(1e-5, link="link2")),
        "on another link, with an axis": ("joint4", Rotor(1e-5, True, 0.2, "link2", (1, 2, 2), (0.1, 0.2, 0.3))),
        "no axis": ("joint4", Rotor(1e-5, axis=(0, 0, 0))),
        "axis of two": ("joint4", Rotor(1e-5, axis=(0, 1))),
        "too large": ("joint4", Rotor(1e-1)),
        "on the base": ("joint5", Rotor(1e-5)),
        "follower": ("mirrored", Rotor(1e-5)),
    }
    answers = {
        name: tried(lambda j=joint, r=rotor: brief(actuation.with_actuators(free, [Actuator(j, 30.0, rotor=r)])))
        for name, (joint, rotor) in rotors.items()
    }
    answers["follower"] = tried(lambda: actuation.with_actuators(tree(), [Actuator("mirrored")]))
    answers["ball"] = tried(lambda: actuation.with_actuators(tree(), [Actuator("wrist")]))
    answers["nothing"] = tried(lambda: actuation.with_actuators(free, [Actuator("elbow")]))
    answers["twice"] = tried(lambda: actuation.with_actuators(free, [Actuator("joint1"), Actuator("joint1")]))
    answers["replaced"] = {
        n: a.ratio
        for n, a in actuation.with_actuators(
            actuation.with_actuators(free, [Actuator("joint1", 3.0), Actuator("joint2", 4.0)]),
            [Actuator("joint1", 9.0)],
        ).actuators.items()
    }
    answers["not replaced"] = tried(lambda: actuation.with_actuators(driven(), [Actuator("joint6", 9.0)]))
    answers["elastic without a rotor"] = tried(
        lambda: actuation.with_actuators(free, [Actuator("joint1", stiffness=9.0)])
    )
    elastic = actuation.with_friction(
        actuation.with_actuators(
            dataclasses.replace(free, configurations={"home": np.arange(5.0)}),
            [Actuator("joint4", 30.0, rotor=Rotor(1e-5), stiffness=90.0)],
        ),
        laws(["joint4.motor", "joint5"]),
    )
    answers["elastic"] = shown(elastic)
    two = actuation.with_actuators(
        free, [Actuator("joint4", 30.0, rotor=Rotor(2e-3)), Actuator("joint5", 10.0, rotor=Rotor(3e-3))]
    )
    answers["rotors in one link"] = [
        brief(two),
        tried(
            lambda: actuation.with_actuators(
                free,
                [
                    Actuator("joint4", 30.0, rotor=Rotor(4e-2, link="link5")),
                    Actuator("joint5", 10.0, rotor=Rotor(4e-2, link="link5", axis=(1, 0, 0))),
                ],
            )
        ),
    ]
    axis = np.array([0.0, 0.6, 0.8])
    largest = 1.0 / (axis @ np.linalg.inv(free.link_inertias["link5"].moment_about_com) @ axis)
    for share in (0.45, 0.55):
        rotor = Rotor(share * largest, link="link5", axis=axis)
        pair = [Actuator("joint4", 30.0, rotor=rotor), Actuator("joint5", 10.0, rotor=rotor)]
        answers[f"two rotors of {share}"] = tried(lambda pair=pair: len(actuation.with_actuators(free, pair).bodies))
    answers["in link mass"] = [
        actuation.is_in_link_mass(driven(), body) for body in driven().bodies if not body.joint.moves_body
    ]
    motor = {
        "elastic": Actuator("inner", stiffness=9.0),
        "place": Actuator("inner", rotor=Rotor(1e-4, place=(1, 0, 0))),
        "extra": Actuator("inner", rotor=Rotor(1e-4, True)),
        "rotor": Actuator("inner", 20.0, rotor=Rotor(1e-4)),
        "joint": Actuator("joint4"),
        "link": Actuator("inner", rotor=Rotor(1e-4, link="base")),
    }
    answers["motors of several joints"] = {
        name: tried(lambda a=a: actuation.with_actuators(coupled(), [a]).armature) for name, a in motor.items()
    }
    bare = edit.with_armature(coupled(), {"inner": 0.0})
    answers["rotor of a coupled motor"] = [
        (m := actuation.with_actuators(bare, [Actuator("inner", 20.0, rotor=Rotor(1e-4))])).armature,
        m.defects,
        list(m.actuators),
        tried(
            lambda: (
                actuation.with_actuators(
                    edit.with_armature(coupled(), {"inner": 0.04}), [Actuator("inner", 20.0, rotor=Rotor(1e-4))]
                ).armature
            )
        ),
    ]
    return answers


@records.of
def friction_laws_that_are_added():
    model = chain(5)
    cases = {
        "all kinds": laws(model.joint_names),
        "nothing": {},
        "unknown law": {"joint1": {"sticky": 1.0}},
        "unknown joint": {"elbow": {"viscous": 1.0}},
        "no stribeck": {"joint1": {"coulomb": 1.0, "static": 2.0}},
        "equal static": {"joint1": {"coulomb": 1.0, "static": 1.0}},
        "low static": {"joint1": {"coulomb": 1.0, "static": 0.5, "stribeck": 0.1}},
        "negative": {"joint1": {"viscous": -1.0}},
        "huge": {"joint1": {"viscous": 2e12}},
        "largest": {"joint1": {"viscous": 1e12}},
        "load": {"joint1": {"load": 1.0}},
        "zero stribeck": {"joint1": {"coulomb": 1.0, "static": 2.0, "stribeck": 0.0}},
    }
    answers = {
        name: [
            tried(lambda c=c: actuation.with_friction(model, c).friction),
            tried(lambda c=c: actuation.with_link_friction(model, c).friction),
        ]
        for name, c in cases.items()
    }
    gear = actuation.with_friction(
        model, {"joint5": {"coulomb": 1.0, "static": 2.0, "stribeck": 0.2, "load": 0.6}, "joint3": {"coulomb": 0.3}}
    )
    answers["both"] = [
        tried(lambda c=c: actuation.with_link_friction(gear, c).friction)
        for c in (
            {"joint5": {"viscous": 0.7, "load": 0.3}},
            {"joint5": {"load": 0.4}},
            {"joint5": {"coulomb": 0.5, "static": 0.9, "stribeck": 0.3}},
            {"joint5": {"coulomb": 0.5, "static": 0.9, "stribeck": 0.2}},
            {"joint3": {"coulomb": 0.5, "static": 0.9, "stribeck": 0.3}},
        )
    ]
    return answers


def nearly_parallel(angle):
    """Two columns with an angle between them: singular values √2 and angle/√2."""
    return [[1.0, 1.0], [0.0, angle]]


@records.of
def couplings_of_drives():
    model = chain(5)
    square = [[1.2, -0.4], [0.7, 2.1]]
    calls = {
        "singular": lambda: Coupling("c", ("a", "b"), ("x", "y"), [[1, 2], [2, 4]]),
        "almost singular": lambda: Coupling("c", ("a", "b"), ("x", "y"), [[1, 2], [2, 4 + 1e-7]]).name,
        "zero column": lambda: Coupling("c", ("a", "b"), ("x", "y"), [[1, 0], [2, 0]]),
        "shape": lambda: Coupling("c", ("a", "b"), ("x", "y"), [[1, 2, 3], [2, 4, 5]]),
        "motors": lambda: Coupling("c", ("a",), ("x", "y"), square),
        "none": lambda: Coupling("c", (), (), np.zeros((0, 0))),
        "repeated motor": lambda: Coupling("c", ("a", "a"), ("x", "y"), square),
        "repeated joint": lambda: Coupling("c", ("a", "b"), ("y", "y"), square),
        "infinite": lambda: Coupling("c", ("a", "b"), ("x", "y"), [[np.inf, 0], [0, 1]]),
        "largest": lambda: Coupling("c", ("a", "b"), ("x", "y"), [[1e12, 0], [0, 1]]).name,
        "barely singular": lambda: Coupling("c", ("a", "b"), ("x", "y"), nearly_parallel(1.6e-9)),
        "barely regular": lambda: Coupling("c", ("a", "b"), ("x", "y"), nearly_parallel(2.4e-9)).name,
        "huge": lambda: Coupling("c", ("a", "b"), ("x", "y"), [[2e12, 0], [0, 1]]),
        "inverted": lambda: Coupling("c", ("a", "b"), ("x", "y"), square, inverted=True).motor_per_joint,
        "inverse": lambda: Coupling("c", ("a", "b"), ("x", "y"), square).joint_per_motor,
        "labels": lambda: [
            Coupling("c", ("a", "b", "d"), ("x", "y", "z"), [[1, 0, 0], [1, 2, 0], [1, 2, 3]]).label(m) for m in "abd"
        ],
        "motor twice": lambda: couplings.with_couplings(
            coupled(), [Coupling("more", ("inner",), ("joint3",), [[2.0]])]
        ),
        "joint twice": lambda: couplings.with_couplings(coupled(), [Coupling("more", ("new",), ("joint4",), [[2.0]])]),
        "motor with the name of a joint": lambda: couplings.with_couplings(
            model, [Coupling("c", ("joint3",), ("joint4",), [[2.0]])]
        ),
        "joint with a rotor": lambda: couplings.with_couplings(driven(), [Coupling("c", ("m",), ("joint6",), [[2.0]])]),
        "joint with an actuator": lambda: [
            list((m := couplings.with_couplings(driven(), [Coupling("c", ("m",), ("joint3",), [[2.0]])])).actuators),
            m.limits.effort,
            m.armature,
            m.friction.viscous,
        ],
        "unknown joint": lambda: couplings.with_couplings(model, [Coupling("c", ("m",), ("elbow",), [[2.0]])]),
        "without": lambda: brief(couplings.without_couplings(coupled())),
        "refused": lambda: couplings.refuse_couplings(coupled(), "a thing"),
        "not refused": lambda: [
            couplings.refuse_couplings(model, "a thing"),
            couplings.refuse_coupled(coupled(), {"joint3"}, "x"),
        ],
        "refused joints": lambda: couplings.refuse_coupled(coupled(), {"joint1", "joint2"}, "cannot be so"),
    }
    answers = {name: tried(call) for name, call in calls.items()}
    _, dq, _, tau = state(coupled())
    many = np.stack([dq, tau])
    answers["products"] = [
        f(coupled(), many)
        for f in (
            couplings.motor_velocities,
            couplings.joint_velocities,
            couplings.motor_torques,
            couplings.joint_torques,
        )
    ]
    answers["plain"] = couplings.motor_velocities(model, dq) is dq
    answers["tables"] = [
        couplings.coupled_entries(coupled()),
        couplings.drive_turns(coupled()),
        couplings.joint_effort(coupled(), np.arange(5.0)),
        couplings.armature_matrix(coupled()),
    ]
    return answers


# ── Changes


@records.of
def payloads_gravity_and_armatures():
    model = tree()
    bad = SpatialInertia.from_com(1.0, (0, 0, 0), np.diag([1.0, 1.0, 3.0]))
    accepted = ModelBuilder("accepted")
    accepted.add_link("base")
    accepted.add_link("a", SpatialInertia.from_com(1.0, (0.1, 0.2, 0.3), np.diag([1.0, 1.5, 3.0])))
    accepted.add_joint("j", "revolute", "base", "a")
    loaded = edit.with_payload(edit.with_payload(model, inertia(1), "hand"), inertia(2), "hand")
    return {
        "payload": brief(edit.with_payload(model, inertia(4), "hand")),
        "two payloads": [
            [G.mass for G in loaded.link_inertias.values()],
            [[n, G.parameters] for n, G in loaded.payloads],
        ],
        "at the tip": [b.inertia.parameters[0] for b in edit.with_payload(model, inertia(4)).bodies],
        "on a site": [G.mass for G in edit.with_payload(model, inertia(4), "grasp").link_inertias.values()],
        "on the base": edit.with_payload(model, inertia(4), "eye").base_inertia,
        "refused": [
            tried(lambda: edit.with_payload(model, bad, "hand")),
            tried(lambda: edit.with_payload(model, inertia(1), "nowhere")),
        ],
        "on an impossible body": tried(
            lambda: (
                edit.with_payload(accepted.build(inertia="accept", quiet=True), SpatialInertia.from_com(0.1), "a")
                .bodies[0]
                .inertia
            )
        ),
        "gravity": [edit.with_gravity(model, g).gravity for g in ((1, 2, 3), (0, 0, 0))],
        "no gravity": tried(lambda: edit.with_gravity(model, [1, 2])),
        "armature": [
            edit.with_armature(model, {"lift": 0.4, "wrist": 0.3}).armature,
            edit.with_armature(coupled(), {"inner": 0.7}).armature,
            edit.with_armature(driven(), {"joint6": 0.0}).armature,
        ],
        "no armature": [
            tried(lambda j=j: edit.with_armature(model, j))
            for j in (
                {"lift": -1.0},
                {"lift": np.inf},
                {"lift": [1, 2]},
                {"lift": "x"},
                {"mirrored": 1.0},
                {"wrist": [0.1, -0.2, 0.3]},
                {"elbow": 1},
            )
        ]
        + [
            tried(lambda: edit.with_armature(driven(), {"joint6": 0.1})),
            tried(lambda: edit.with_armature(coupled(), {"joint4": 0.1})),
        ],
    }


@records.of
def joints_that_are_locked():
    model = tree()
    cases = {
        "one": (model, {"lift": 0.3}),
        "leader": (model, {"shoulder": 0.4}),
        "ball": (model, {"wrist": [0.9, 0.2, -0.3, 0.1]}),
        "planar and spin": (model, {"spin": 0.2, "drive": [0.1, -0.2, 0.3]}),
        "all": (
            model,
            dict(zip(model.joint_names, [0.4, 0.3, [1, 0, 0, 0], 0.2, 0.1, [0.1, 0.2, 0.3], 0.5], strict=False))
            | {"pinch": 0.2},
        ),
        "follower": (model, {"mirrored": 0.1}),
        "unknown": (model, {"elbow": 0.1}),
        "shape": (model, {"lift": [1, 2]}),
        "text": (model, {"lift": "x"}),
        "quaternion": (model, {"wrist": [0, 0, 0, 0]}),
        "three": (model, {"wrist": [1, 0, 0]}),
        "infinite": (model, {"lift": np.inf}),
        "floating": (floating(), {"root_joint": [0.9, 0.2, -0.3, 0.1, 1.0, 2.0, 3.0]}),
        "floating and hip": (floating(), {"hip": 0.3, "root_joint": [0.9, 0.2, -0.3, 0.1, 1.0, 2.0, 3.0]}),
        "elastic": (driven(), {"joint4": 0.3}),
        "coupled": (coupled(), {"joint4": 0.3}),
        "all coupled": (coupled(), {"joint4": 0.3, "joint2": -0.2}),
        "driven": (driven(), {"joint6": 0.3}),
        "first": (chain(4), {"joint4": 0.3}),
    }

    def answer(one, positions):
        try:
            positions = {name: q for name, q in positions.items() if positions is not None}
            locked = edit.lock(one, positions)
        except KeyError as error:
            return f"KeyError {error}"
        return brief(locked) | {
            "springs": locked.springs,
            "mounted": locked.mounted,
            "tip": locked.tip,
            "locked": list(locked.locked.items()),
            "couplings": [c.name for c in locked.couplings],
            "configurations": locked.configurations,
        }

    return {name: tried(lambda case=case: answer(*case)) for name, case in cases.items()}


@records.of
def parts_that_are_fused():
    model = tree()
    fused = assembly.fuse(model, {1: placed((0.1, 0.2, 0.3), (0.1, 0.2, 0.3)), 5: placed((0.3, -0.2, 0.1))})
    return {
        "fused": brief(fused),
        "nothing": assembly.fuse(model, {}) is model,
        "tips": [assembly.default_tip(x()) for x in MODELS.values()],
    }


@records.of
def models_taken_apart_and_put_together():
    answers = {}
    for name, make in MODELS.items():
        model = make()
        taken = parts.disassemble(model)
        answers[name] = {
            "parts": [
                taken.root,
                taken.floating,
                list(taken.links),
                {k: v.parameters[0] for k, v in taken.whole.items()},
                {k: v.viscous for k, v in taken.friction.items()},
                taken.armature,
                [a.joint for a in taken.actuators],
            ],
            "joints": [[j.name, j.parent, j.child, j.mimic, j.limits.lower, j.limits.effort] for j in taken.joints],
            "links": np.array([link.inertia.parameters for link in taken.links.values()]),
            "again": brief(parts.reassemble(parts.disassemble(model, extra=False)))["numbers"],
            "again, losses": [
                (m := parts.reassemble(parts.disassemble(model, extra=False))).armature,
                m.friction.coulomb,
                m.friction.load,
                m.tip,
                m.limits.lower,
                m.limits.effort,
            ],
        }
    locked = edit.lock(floating(), {"root_joint": [0.9, 0.2, -0.3, 0.1, 1.0, 2.0, 3.0]})
    taken = parts.disassemble(locked)
    answers["locked root"] = [
        taken.root,
        [[j.name, j.parent, j.child, j.placement[:3]] for j in taken.joints],
        taken.additions.locked,
        taken.additions.mounted,
    ]
    loaded = parts.disassemble(edit.with_payload(tree(), inertia(1), "tool"))
    answers["payload on a site"] = {k: v.inertia.parameters[0] for k, v in loaded.links.items()}
    return answers


@records.of
def robots_that_are_attached():
    hand_builder = chain_builder(3, "hand")
    hand_builder.add_site("grip", "link1", placed((0.1, 0.2, 0.3), (0.1, 0, 0)))
    hand_builder.add_site("link2", "link1", placed((0.1, 0.2, 0.3), (0.1, 0, 0.5)))
    hand_builder.add_spring({"joint2": 1.0}, 9.0, 0.1)
    hand_builder.add_configuration("home", {"joint1": 0.3})
    hand_builder.add_closure("hand loop", OfferedClosure("grip", "site:link2", "vx"))
    hand = actuation.with_actuators(
        edit.with_payload(hand_builder.build(quiet=True), inertia(0), "site:link2"),
        [Actuator("joint1", 5.0, rotor=None)],
    )
    pose = placed((0.2, 0.5, -0.3), (0.1, 0.2, 0.3))
    answers = {
        "at the tip": tried(lambda: shown(joining.attach(tree(), hand, None, pose, "hand_", "both"))),
        "at a link": tried(lambda: brief(joining.attach(tree(), hand, "wheel", pose, "", "both"))),
        "drives": brief(
            joining.attach(driven(), edit.with_armature(driven(), {"joint6": 0}), "link2", pose, "b_", "both")
        ),
        "coupled": tried(lambda: shown(joining.attach(coupled(), coupled(), "link1", pose, "b_", "both"))["couplings"]),
        "floating": tried(lambda: brief(joining.attach(floating(), hand, "right", pose, "h_", "both"))),
        "floating hand": tried(lambda: brief(joining.attach(hand, floating(), "link1", pose, "f_", "both"))),
        "names": [
            tried(lambda: joining.attach(hand, hand, None, pose, "", "x")),
            tried(lambda: joining.attach(hand, hand, None, pose, "y_", "x").name),
            tried(lambda: joining.attach(coupled(), coupled(), None, pose, "", "x")),
        ],
        "nowhere": tried(lambda: joining.attach(tree(), hand, "nowhere", pose, "a", "x")),
        "locked": brief(
            joining.attach(
                edit.lock(tree(), {"shoulder": 0.2}), edit.lock(hand, {"joint2": 0.3}), "wheel", pose, "h_", "both"
            )
        ),
        "payloads": [
            [frame, G.mass]
            for frame, G in joining.attach(
                edit.with_payload(tree(), inertia(3), "eye"), hand, "wheel", pose, "h_", "x"
            ).payloads
        ],
        "same prefix": tried(
            lambda: joining.attach(joining.attach(tree(), hand, None, pose, "h_", "x"), hand, "arm", pose, "h_", "x")
        ),
    }
    motors = dataclasses.replace(hand, motor_joints=frozenset({"joint1"}))
    answers["motors"] = [
        joining.attach(a, b, "wheel", pose, "h_", "x").motor_joints
        for a, b in (
            (tree(), motors),
            (dataclasses.replace(tree(), motor_joints=frozenset({"lift"})), hand),
            (tree(), hand),
        )
    ]
    return answers


@records.of
def chains_of_a_tree():
    model = tree()
    calls = {
        "from a link": lambda: joining.chain(model, "arm", None),
        "to a frame": lambda: joining.chain(model, None, "wheel"),
        "between": lambda: joining.chain(model, "arm", "hand"),
        "to a site": lambda: joining.chain(model, "torso", "tool"),
        "all": lambda: joining.chain(model, None, None),
        "of one that floats": lambda: joining.chain(floating(), "left", "lower"),
        "of one that floats, to a tip": lambda: joining.chain(floating(), None, "right"),
        "driven": lambda: joining.chain(driven(), "link5", "link3"),
        "coupled": lambda: joining.chain(coupled(), "base", "link1"),
        "payload": lambda: joining.chain(edit.with_payload(model, inertia(1), "wheel"), "cart", "wheel"),
        "leader outside": lambda: joining.chain(model, "hand", "thumb"),
        "leader on another branch": lambda: joining.chain(model, None, "thumb"),
        "coupled in part": lambda: joining.chain(coupled(), "link4", None),
        "not carried": lambda: joining.chain(model, "cart", "hand"),
        "no link": lambda: joining.chain(model, "tool", None),
        "no tip": lambda: joining.chain(model, "arm", "nowhere"),
        "rotor outside": lambda: joining.chain(driven(), "link6", None),
    }
    answers = {}
    for name, call in calls.items():
        answers[name] = tried(
            lambda call=call: (
                lambda m: (
                    brief(m)
                    | {
                        "gravity": m.gravity,
                        "tip": m.tip,
                        "mounted": m.mounted,
                        "springs": m.springs,
                        "payloads": len(m.payloads),
                        "configurations": m.configurations,
                        "closures": list(m.closures),
                        "couplings": len(m.couplings),
                    }
                )
            )(call())
        )
    return answers


@records.of
def bases_that_are_freed():
    locked = edit.lock(floating(), {"root_joint": [1.0, 0, 0, 0, 0, 0, 0]})
    moved = edit.lock(floating(), {"root_joint": [1.0, 0, 0, 0, 1.0, 0, 0]})
    named = small(name="root_joint").build(quiet=True)
    return {
        "tree": brief(joining.with_free_base(tree()))
        | {"configurations": joining.with_free_base(tree()).configurations},
        "chain": [(m := joining.with_free_base(chain(3))).tip, m.mounted, m.joint_names, m.armature],
        "locked": tried(lambda: brief(joining.with_free_base(locked))),
        "moved": tried(lambda: brief(joining.with_free_base(moved))),
        "named": tried(lambda: joining.with_free_base(named)),
        "floating": tried(lambda: joining.with_free_base(floating()).joint_names),
    }


# ── Parameters


@records.of
def parameters_of_models():
    answers = {}
    for name in ("tree", "driven", "coupled", "floating"):
        model = MODELS[name]()
        values = parameters.nominal(model)
        names = list(values)
        answers[name] = {
            "count": len(names),
            "names": names[:12] + names[-14:],
            "values": np.array([*values.values()]),
            "moves": [
                parameters.moves_joints(model, names[:3]),
                parameters.moves_joints(model, [names[-1], next((n for n in names if n.endswith(".x")), names[0])]),
            ],
            "regrouped": np.array([b.inertia.parameters for b in parameters.regrouped(model).bodies]),
        }
    answers["matching"] = [
        parameters.matching(tree(), ["arm.*", "*.stiffness", "arm.mass"]),
        tried(lambda: parameters.matching(tree(), ["arm.weight"])),
    ]
    return answers


@records.of
def models_with_other_parameters():
    answers = {}
    for make, changes in (
        (
            tree,
            {
                "arm.mass": 3.0,
                "arm.com_x": 0.3,
                "hand.Ixy": 0.01,
                "ball.Izz": 0.09,
                "lift.x": 0.7,
                "wrist.z": -0.2,
                "shoulder.viscous": 0.9,
                "lift.coulomb": 4.0,
                "spin.armature": 0.3,
                "spin.stiffness": 7.0,
                "pinch.static": 0.5,
            },
        ),
        (
            driven,
            {
                "joint6.rotor_inertia": 4e-5,
                "joint5.rotor_inertia": 5e-5,
                "joint4.stiffness": 500.0,
                "joint4.rotor_inertia": 2e-5,
                "joint2.coulomb": 2.0,
                "joint6.coulomb": 2.0,
                "joint3.load": 0.4,
                "link4.mass": 5.0,
            },
        ),
        (coupled, {"inner.armature": 0.2, "joint3.armature": 0.1, "outer.viscous": 0.8, "link2.com_y": 0.3}),
        (chain, {}),
    ):
        model = make(4) if make is chain else make()
        changed = parameters.with_symbolic_parameters(model, list(changes), list(changes.values()))
        answers[make.__name__] = {
            "bodies": np.array(
                [np.concatenate([b.placement[:3].ravel(), b.inertia.parameters]) for b in changed.bodies], float
            ),
            "friction": np.array([*fields(changed.friction).values()], float),
            "armature": np.asarray(changed.armature, float),
            "springs": changed.springs,
        }
    bare = actuation.with_actuators(
        edit.with_armature(coupled(), {"inner": 0.0}), [Actuator("inner", 20.0, rotor=Rotor(1e-4))]
    )
    answers["rotor of a coupled motor"] = np.asarray(
        parameters.with_symbolic_parameters(bare, ["inner.rotor_inertia"], [3e-4]).armature, float
    )
    return answers


@records.of
def parameters_that_cannot_be():
    model = tree()
    cases = {
        "negative mass": {"arm.mass": [-1.0]},
        "negative mass in a sample": {"arm.mass": [[1.0, 2.0], [3.0, -4.0]]},
        "no mass": {"arm.mass": [0.0]},
        "negative armature": {"spin.armature": -0.1},
        "negative stiffness": {"spin.stiffness": [1.0, -0.1]},
        "stribeck": {"spin.stribeck": [0.0]},
        "load": {"spin.load": [1.0]},
        "largest load": {"spin.load": [0.99]},
        "negative load": {"spin.load": [-0.1]},
        "viscous": {"spin.viscous": [-0.1]},
        "moment": {"arm.Ixx": [0.02, 0.9]},
        "negative moment": {"arm.Ixx": [[0.02], [-0.9]]},
        "moment of the base": {"torso.Ixx": [9.0]},
        "of a body of several links": {"ball.Ixx": [0.03, 3.0], "hand.Izz": 0.04},
        "not finite": {"arm.Ixx": [np.nan]},
        "products": {"arm.Ixy": [0.9]},
        "unknown": {"nothing.Ixx": [1.0]},
    }
    answers = {
        name: tried(
            lambda case=case: parameters.refuse_impossible(model, {k: np.asarray(v, float) for k, v in case.items()})
        )
        for name, case in cases.items()
    }
    answers["samples"] = parameters._impossible_samples(
        model,
        "arm",
        {
            "arm.Ixx": np.array([-1e-3, 1e-9, 0.03, 0.2]),
            "arm.Ixy": np.array(0.0),
            "arm.Ixz": np.array(0.0),
            "arm.Iyz": np.array(0.0),
            "arm.Iyy": np.array(0.05),
            "arm.Izz": np.array(0.05),
        },
    )
    return answers


# ── Legs


def branched(branches, turn=(0.0, 0.0, 0.0), base=5.0, mass=1.0, **options):
    """Robot of a base and branches (place, heading, steps): a joint about y at each step (dx, dz) along the heading."""
    builder = ModelBuilder("made")
    builder.gravity = so3._exp(np.asarray(turn, float)).T @ [0.0, 0.0, -9.81]
    builder.add_link(
        "base", tw.SpatialInertia.box([0.2, 0.2, 0.1], mass=base), shaped=True, hidden=options.get("hidden", False)
    )
    root = "base"
    for n in range(options.get("waist", 0)):
        builder.add_link(f"waist{n}", tw.SpatialInertia.box([0.2, 0.2, 0.1], mass=1.0))
        builder.add_joint(f"w{n}", "revolute", root, f"waist{n}", axis=(0, 0, 1))
        root = f"waist{n}"
    for k, (place, heading, steps) in enumerate(branches):
        carrier, T = root, placed((0, 0, heading), place)
        weight = mass if np.ndim(mass) == 0 else mass[k]
        for n, (dx, dz) in enumerate(steps):
            name = f"b{k}_{n}"
            builder.add_link(name, tw.SpatialInertia.from_com(weight, [dx / 2, 0, dz / 2], np.eye(3) * 0.01 * weight))
            builder.add_joint(
                f"j{k}_{n}",
                "revolute",
                carrier,
                name,
                axis=(1, 0, 0) if options.get("roll") and n == 1 else (0, 1, 0),
                placement=T,
            )
            carrier, T = name, placed(p=(dx, 0.0, dz))
        builder.add_link(f"end{k}")
        builder.add_joint(f"to_end{k}", "fixed", carrier, f"end{k}", placement=T)
    for a, b in options.get("closed", ()):
        builder.add_closure(f"loop{a}{b}", OfferedClosure(f"end{a}", f"end{b}", "vx vy vz"))
    if options.get("mounted"):
        builder.mount()
    return builder.build(quiet=True, floating_base=options.get("floating", False))


def around(count, radius, steps):
    angles = 2 * np.pi * np.arange(count) / count
    return [((radius * np.cos(a), radius * np.sin(a), 0.0), a, steps) for a in angles]


@records.of
def legs_that_are_found():
    down = [(0.0, -0.02), (0.0, -0.4), (0.0, -0.4)]
    knee = [(0.0, -0.02), (-0.1, -0.2), (0.1, -0.2)]
    flat = [(0.2, 0.0), (0.3, 0.01), (0.2, -0.01)]
    up = [(0.0, 0.3), (0.0, 0.4), (0.0, 0.3)]
    biped = [((0.0, 0.1, 0.0), 0.0, down), ((0.0, -0.1, 0.0), 0.0, down)]
    quad = [((x, y, 0.0), 0.0, knee) for x in (0.3, -0.3) for y in (0.2, -0.2)]
    models = {
        "biped": branched(biped),
        "biped that rolls": branched(biped, roll=True),
        "biped in a plane": branched([((0.1, 0.0, 0.0), 0.0, down), ((-0.1, 0.0, 0.0), 0.0, down)]),
        "biped in a plane, one foot higher": branched(
            [((0.05, 0.0, 0.0), 0.0, down), ((-0.05, 0.0, 0.0), 0.0, [(0.0, -0.02), (0.0, -0.4), (0.0, -0.38)])]
        ),
        "hidden base": branched(around(4, 0.2, flat), hidden=True),
        "hidden base of a quadruped": branched(quad, hidden=True),
        "quadruped": branched(quad),
        "quadruped with an arm": branched([*quad, ((0.0, 0.0, 0.1), 0.0, up)]),
        "mounted": branched(quad, mounted=True),
        "floating": branched(quad, floating=True),
        "one short leg": branched([*quad[:3], ((-0.3, -0.2, 0.0), 0.0, [(0.0, -0.02), (-0.1, -0.2), (0.1, -0.15)])]),
        "one leg a little short": branched(
            [*quad[:3], ((-0.3, -0.2, 0.0), 0.0, [(0.0, -0.02), (-0.1, -0.2), (0.1, -0.19)])]
        ),
        "one joint": branched([((x, y, 0.0), 0.0, [(0.0, -0.5)]) for x in (0.3, -0.3) for y in (0.2, -0.2)]),
        "one joint in one leg": branched(
            [
                ((0.0, 0.1, 0.0), 0.0, down),
                ((0.1, -0.1, 0.0), 0.0, [(0.0, -0.82)]),
                ((-0.1, -0.1, 0.0), 0.0, [(0.0, -0.82)]),
            ]
        ),
        "waist": branched(quad, waist=1),
        "waist of two": branched([*quad[:3], ((-0.3, -0.2, 0.0), 0.0, [(-0.1, -0.22), (0.1, -0.2)])], waist=2),
        "waist of three": branched([*quad[:3], ((-0.3, -0.2, 0.0), 0.0, [(-0.1, -0.22), (0.1, -0.2)])], waist=3),
        "lying": branched([*quad, ((0.0, 0.0, 0.1), 0.0, up)], turn=(0.0, np.pi / 2, 0.0), mass=[1, 1, 1, 1, 3]),
        "lying, light arm": branched(
            [*quad, ((0.0, 0.0, 0.1), 0.0, up)], turn=(0.0, np.pi / 2, 0.0), mass=[1, 1, 1, 1, 0.5]
        ),
        "spider": branched(around(6, 0.2, flat)),
        "spider of three": branched(around(3, 0.2, flat)),
        "spider of four": branched(around(4, 0.2, flat)),
        "half a spider": branched(around(8, 0.2, flat)[:4]),
        "spider of unlike legs": branched(around(4, 0.2, flat), mass=[1.0, 1.05, 1.3, 1.0]),
        "spider of almost like legs": branched(around(4, 0.2, flat), mass=[1.0, 1.05, 1.09, 1.0]),
        "spider with a loop": branched(around(4, 0.2, flat), closed=[(0, 1)]),
        "quadruped with a loop": branched(quad, closed=[(0, 1)]),
        "upside down": branched(quad, turn=(np.pi, 0.0, 0.0)),
        "tilted": branched(quad, turn=(0.3, 0.2, 0.0)),
        "hanging": branched([((0.0, 0.1, 0.0), 0.0, up), ((0.0, -0.1, 0.0), 0.0, up)]),
        "no gravity": edit.with_gravity(branched(quad), (0, 0, 0)),
        "arm": chain(5),
        "tree": tree(),
        "flyer": floating(),
        "massless base": branched(around(4, 0.2, flat), base=1e-9),
    }
    return {name: [legs.hanging_base(model), legs.legs_of(model)] for name, model in models.items()}


@records.of
def measures_of_a_stance():
    knee = [(0.0, -0.02), (-0.1, -0.2), (0.1, -0.2)]
    model = branched(
        [((0.3, 0.25, 0.0), 0.2, knee), ((-0.3, 0.2, 0.05), 0.0, knee), ((-0.2, -0.3, 0.0), 0.5, knee[:2])],
        turn=(0.1, 0.2, 0.0),
        mass=[1.0, 1.5, 2.0],
    )
    stance = legs._Stance(model)
    up = np.array([0.1, -0.2, 0.9])
    up /= np.linalg.norm(up)
    chains = list(stance.chains)
    return {
        "size": stance.size,
        "base": stance.base,
        "chains": [[chain, names] for chain, names in stance.chains.items()],
        "heights": stance.heights([*stance.positions], up),
        "hips": [stance._hip(c) for c in chains],
        "feet": [stance._foot(c, up) for c in chains],
        "masses": [stance._mass(c) for c in chains],
        "reach": [stance._outward_reach(c, up) for c in chains],
        "offsets": [stance._hip_offset(c, up) for c in chains],
        "axes": [stance._axis(i) for i in range(4)],
        "centre": stance._centre(),
        "alike": [[stance._are_alike(a, b) for a in chains] for b in chains],
        "surround": [stance._surround(set(chains), up), stance._surround(set(chains[:2]), up)],
        "poses": np.array([*legs.frame_poses(model, state(model)[0]).values()]),
        "hip counts": [legs._hip_count({(1, 2), (1, 3), (2, 5)}), legs._hip_count(set())],
        "joined": legs._bodies_joined_to({1}, [{2, 3}, {3, 1}, {7, 8}]),
        "tree": [legs._base_links(tree()), [[c, n] for c, n in legs._chains(tree()).items()]],
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
