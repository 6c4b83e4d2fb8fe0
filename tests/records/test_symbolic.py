"""Equations in symbols: complete answers on record."""

from __future__ import annotations

import importlib
from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
import sympy
from recorded_answers import refusal
from recorded_models import ShortRecords

import twistwrench as tw
from twistwrench import SpatialInertia
from twistwrench.formats.actuators import add_actuators
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.robot import Robot
from twistwrench.symbolic import derivation_size, documents, equations, line_breaks, names, source_code
from twistwrench.symbolic.coordinates import coordinates_of, rate_symbol, to_robot
from twistwrench.symbolic.derivation_check import TOLERANCE
from twistwrench.symbolic.expanded_form import motion_of, ring_of
from twistwrench.symbolic.parameters import model_entries
from twistwrench.symbolic.trig_polynomial import Ring, ShortestForms
from twistwrench.symbolic.web_page import MathML

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = ShortRecords(__file__)
lagrange = importlib.import_module("twistwrench.symbolic.lagrange")  # the package has a function of that name


def body(mass, com=(0.0, 0.0, 0.0), moments=(0.0, 0.0, 0.0), products=(0.0, 0.0, 0.0)):
    ixx, iyy, izz = moments
    ixy, ixz, iyz = products
    return SpatialInertia.from_com(mass, com, np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]))


def at(x=0.0, y=0.0, z=0.0, R=None):
    return se3.pose(np.eye(3) if R is None else np.asarray(R, float), (x, y, z))


QUARTER = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]


def arm():
    """Two hinges and a slide, centres of mass beside the axes, springs and a drive, in an inclined field."""
    builder = ModelBuilder("arm")
    builder.gravity = (1.5, -9.0, 0.0)
    builder.add_link("base")
    builder.add_link("upper", body(3.0, (0.25, -0.125, 0.0), (0.1, 0.2, 0.3)))
    builder.add_joint(
        "shoulder", "revolute", "base", "upper", placement=at(0.0, 0.75), axis=(0, 0, 1), damping=0.5, armature=0.375
    )
    builder.add_link("lower", body(2.0, (0.5, 0.0, 0.0), (0.02, 0.03, 0.04)))
    builder.add_joint("elbow", "revolute", "upper", "lower", placement=at(0.5), axis=(0, 0, -1))
    builder.add_spring({"shoulder": 1.0, "elbow": -0.5}, 40.0, 0.25)
    return Robot(builder.build(quiet=True))


def machine(mimic=True, gears=True):
    """Slide, screw, hinge off its link's origin, follower and rotor: joints of one degree of all kinds."""
    builder = ModelBuilder("machine")
    builder.gravity = (0.5, -1.0, -9.0)
    builder.add_link("base")
    builder.add_link("cart", body(5.0, (0.0, 0.25, 0.0)))
    builder.add_joint(
        "rail",
        "prismatic",
        "base",
        "cart",
        placement=at(0.0, 0.0, 0.5),
        axis=(0.6, 0.0, 0.8),
        armature=0.0 if gears else 2.0,
    )
    builder.add_link("drill", body(2.0, (0.0, 0.0, 0.375), (0.2, 0.25, 0.3), (0.01, -0.02, 0.03)))
    builder.add_joint(
        "screw", "helical", "cart", "drill", placement=at(0.5, 0.0, -0.25, QUARTER), axis=(0, 0, 1, 0.2, 0.1, 0.05)
    )
    builder.add_link("flap", body(1.0, (0.125, 0.0, 0.25), (0.02, 0.03, 0.04)))
    builder.add_joint(
        "hinge", "revolute", "drill", "flap", placement=at(0.0, 0.375), axis=(0.0, 0.6, 0.8, 0.3, 0.0, 0.0)
    )
    if mimic:
        builder.add_link("tab", body(0.5, (0.0, 0.125, 0.0)))
        builder.add_joint(
            "tab", "revolute", "flap", "tab", placement=at(0.25), axis=(1, 0, 0), mimic=("screw", -0.5, 0.25)
        )
    model = builder.build(quiet=True)
    if gears:
        model = add_actuators(model, {"actuators": {"hinge": {"ratio": 20, "rotor": {"inertia": "30 kg cm^2"}}}})
    return Robot(model)


def chain(n):
    """Hinges one after the other."""
    builder = ModelBuilder("chain")
    builder.add_link("l0")
    for k in range(n):
        builder.add_link(f"l{k + 1}", body(1.0, (0.5, 0, 0)))
        builder.add_joint(f"j{k}", "revolute", f"l{k}", f"l{k + 1}", placement=at(1.0), axis=(0, 0, 1))
    return Robot(builder.build(quiet=True))


@cache
def derived(name, **options):
    robots = {"arm": arm, "machine": machine, "raft": raft, "box": box, "small": small}
    return tw.derive(robots[name](), **options)


def raft():
    """A planar joint with a hinge on it."""
    builder = ModelBuilder("raft")
    builder.gravity = (0.0, -9.0, 0.0)
    builder.add_link("base")
    builder.add_link("deck", body(4.0, (0.25, 0.0, 0.0), (0.1, 0.2, 0.3)))
    builder.add_joint("glide", "planar", "base", "deck", placement=at(0.5), axis=(0, 0, 1), damping=0.5)
    builder.add_link("oar", body(1.0, (0.0, 0.5, 0.0)))
    builder.add_joint("oar", "revolute", "deck", "oar", placement=at(0.0, 0.75), axis=(0, 0, 1))
    return Robot(builder.build(quiet=True))


def box():
    """A floating body and a ball on it."""
    builder = ModelBuilder("box")
    builder.gravity = (0.0, 0.0, -9.0)
    builder.add_link("base")
    builder.add_link("box", body(4.0, (0.25, 0.0, 0.0), (0.1, 0.2, 0.3)))
    builder.add_joint("float", "floating", "base", "box")
    return Robot(builder.build(quiet=True))


def steps_of(equations):
    return {step.name: equations.text([step.name]).splitlines() for step in equations.steps}


def state(n):
    """Three states of n coordinates, with their rates and accelerations."""
    k = np.arange(1.0, n + 1)
    q = np.array([0.3 * np.sin(1.7 * k + s) + 0.2 * s for s in range(3)])
    return q, np.cos(2.3 * k) + 0.5 * q, np.sin(0.9 * k) - q


def values_of(found, **parameters):
    """Results of all functions at three states."""
    q, dq, ddq = state(len(found.q))
    arguments = {"q": q, "dq": dq, "ddq": ddq}
    results = {}
    for name, (inputs, *_) in source_code.FUNCTIONS.items():
        results[name] = found.function(name)(*(arguments[key] for key in inputs), **parameters)
    return results


def without_check(text):
    """Lines without the deviation from the kernels, which is rounding."""
    return [line for line in text.splitlines() if "Newton" not in line and "of the largest entry" not in line]


@records.of
def an_arm_written_out():
    found = derived("arm")
    return {
        "steps": steps_of(found), "values": values_of(found), "parameters": found.parameters, "meanings": found.meanings, "remarks": found.remarks,
        "centripetal": {str(key): str(sympy.N(value.subs(found.values).subs(found.q[1], 0.5), 8)) for key, value in found.centripetal.items()},
        "coriolis": {str(key): str(sympy.N(value.subs(found.values).subs(found.q[1], 0.5), 8)) for key, value in found.coriolis.items()},
        "repr": repr(found), "split": found.split, "form": found.form, "deviates": found.check.worst < 1e-12, "facts": sorted(found.facts())[:3], "sources": dict(found.sources()),
    }  # fmt: skip


@records.of
def a_machine_with_named_results():
    found = derived("machine", form="named")
    return {
        "steps": steps_of(found),
        "parameters": [[p.name, p.value, sorted(p.kinds), p.meaning] for p in found.parameters],
        "values": values_of(found),
        "form": found.form,
        "repr": repr(found),
    }


@records.of
def a_machine_written_out():
    found = tw.derive(machine(mimic=False, gears=False), form="expanded")
    keep = (
        "positions",
        "velocities",
        "angular_velocities",
        "drive_energies",
        "potential_energies",
        "gravity_forces",
        "mass_matrix",
        "centripetal",
    )
    steps = steps_of(found)
    return {
        "steps": {name: steps[name] for name in keep},
        "columns": [line[:24] for line in found.latex(["positions", "velocities"], document=False).splitlines()],
        "values": values_of(found),
        "parameters": [[p.name, p.value, sorted(p.kinds), p.meaning] for p in found.parameters],
        "names": list(steps),
    }


@records.of
def forms_give_the_same_numbers():
    """Values of the other form of each robot, and of a robot with a follower."""
    answers = {}
    for robot in (raft(), box(), arm()):
        for form in ("expanded", "named", "auto"):
            if robot.name == "box" and form != "auto":
                continue
            found = tw.derive(robot, form=form, symbols="none" if robot.name == "box" else "all")
            answers[f"{robot.name} {form}"] = [
                found.form,
                len(found.steps),
                len(found.definitions),
                found.function("inverse_dynamics")(*state(len(found.q))),
                found.function("coriolis_matrix")(*state(len(found.q))[:2])[0],
                [p.name for p in found.parameters],
            ]
    return answers


@records.of
def a_raft_on_a_plane():
    found = tw.derive(raft(), symbols=["masses", "lengths"])
    return {
        "steps": {
            name: lines
            for name, lines in steps_of(found).items()
            if name in ("positions", "velocities", "mass_matrix", "coriolis", "equations")
        },
        "meanings": found.meanings,
        "remarks": found.remarks,
        "values": values_of(found),
    }


def pair():
    """A hinge and one that follows it with an offset, lengths of equal axis, and a centre of mass at a joint."""
    builder = ModelBuilder("pair")
    builder.gravity = (0.0, -9.0, 0.0)
    builder.add_link("base")
    builder.add_link("one", body(2.0, (0.5, 0.0, 0.0), (0.1, 0.2, 0.25)))
    builder.add_joint("lead", "revolute", "base", "one", placement=at(0.0, 0.25), axis=(0, 0, 1))
    builder.add_link("two", body(1.0, (0.125, 0.0, 0.0), (0.1, 0.2, 0.25)))
    builder.add_joint("follow", "revolute", "one", "two", placement=at(0.5), axis=(0, 0, 1), mimic=("lead", -2.0, 0.5))
    builder.add_link("three", body(1.5, (0.0, 0.375, 0.0)))
    builder.add_joint("other", "revolute", "one", "three", placement=at(0.75, -0.5), axis=(0, 0, 1))
    return Robot(builder.build(quiet=True))


@records.of
def a_pair_with_a_follower():
    answers = {}
    for form in ("expanded", "named"):
        found = tw.derive(pair(), form=form)
        answers[form] = [
            found.text(["equations"]).splitlines(),
            found.function("inverse_dynamics")(*state(2)),
            [[p.name, p.value, sorted(p.kinds), p.meaning] for p in found.parameters],
        ]
    table = tw.from_dh(
        {"a": [0.5, 0.25], "alpha": [0.0, 0.0]},
        masses=[2.0, 1.0],
        coms=[[-0.125, 0.0, 0.0], [-0.0625, 0.03125, 0.0]],
        gravity=(0, -9, 0),
    )
    answers["table"] = [
        tw.derive(table).text(["positions"]).splitlines(),
        [[p.name, p.meaning] for p in model_entries(table.model).parameters],
    ]
    answers["by name"] = [(found := tw.derive("pendulum")).name, without_check(str(found)), sorted(found.sources())]
    return answers


@records.of
def symbols_that_are_chosen():
    robot = machine()
    words = [
        "all",
        "none",
        ["lengths"],
        ["coms"],
        ["masses"],
        ["inertias"],
        ["gravity"],
        ["gears"],
        ["m_1", " L_1x "],
        ["springs"],
        [],
        "m_2",
    ]
    answers = {str(word): [[p.name, p.value] for p in model_entries(robot.model, word).parameters] for word in words}
    spring = model_entries(arm().model, "springs")
    answers["spring"] = [[p.name, p.value, p.meaning] for p in spring.parameters]
    entries = model_entries(robot.model)
    answers["entries"] = [
        [b.tag, *(_entry(e) for e in (*b.place, *b.point, b.pitch, b.mass, *b.com, b.ratio))] for b in entries.bodies
    ]
    answers["inertia"] = [[_entry(e) for row in b.inertia for e in row] for b in entries.bodies]
    answers["others"] = [[_entry(e) for e in values] for values in (entries.gravity, entries.springs, entries.armature)]
    answers["wrong"] = [refusal(lambda w=w: model_entries(robot.model, w)) for w in (["m_9"], 3, ["length"])]
    return answers


def _entry(entry):
    return entry.value if entry.parameter is None else [entry.value, entry.parameter.name, entry.sign]


@records.of
def reports_of_derivations():
    texts = {}
    for name, options in (
        ("arm", {}),
        ("arm", {"steps": "all"}),
        ("arm", {"steps": ("gravity_forces", "mass-matrix")}),
        ("machine", {"form": "named"}),
        ("raft", {"steps": ("equations",), "symbols": "none"}),
    ):
        found = derived(name, **options)
        robot = found
        text = without_check(str(found))
        texts[f"{robot.name} {options}"] = [
            text if len(text) < 30 else text[::5],
            len(text),
            found.selected,
            found.brief,
            str(found.verdict.word),
        ]
    return texts


def disagreement(found):
    """Verdict, and refusals, of equations that are not those of the kernels."""
    lines = []
    for deviation in (0.9, 1.1):
        check = replace(
            found.check,
            **{
                field.name: deviation * TOLERANCE
                for field in fields(found.check)
                if isinstance(getattr(found.check, field.name), float)
            },
        )
        wrong = replace(found, check=check, selected=("gravity_forces",))
        lines += [
            str(wrong.verdict.word),
            list(wrong.verdict.reasons),
            str(wrong).splitlines()[0],
            check.worst / TOLERANCE,
            str(check),
        ]
        if deviation > 1:
            lines += [refusal(wrong.numpy_source), refusal(wrong.c_source)]
    return lines


@records.of
def refused_derivations():
    locked = Robot(arm().model).lock({"shoulder": 0, "elbow": 0})
    found = derived("arm")
    function = found.function("gravity_forces")
    coupled = Robot(
        add_actuators(
            arm().model,
            {
                "couplings": {
                    "c": {"motors": ["a", "b"], "joints": ["shoulder", "elbow"], "motor_per_joint": [[2, 1], [0, 3]]}
                },
                "actuators": {},
            },
        )
    )
    heavy = raft().with_armature({"glide": [1, 2, 3]})
    return [
        refusal(lambda: tw.derive(arm(), form="long")), refusal(lambda: tw.derive(3)), refusal(lambda: tw.derive(locked)), *disagreement(found), refusal(lambda: derivation_size.check_named(chain(20))), derivation_size.check_named(chain(13)),
        refusal(lambda: tw.derive(coupled)), refusal(lambda: tw.derive(heavy)), refusal(lambda: tw.derive(arm(), steps=["moments"])), refusal(lambda: found.step("M")), refusal(lambda: found.function("mass")), refusal(lambda: found.function(3)),
        refusal(lambda: function([0, 0], parameters={"m_1": 1})), refusal(lambda: function([0, 0], parameters={"m_9": 1})), refusal(lambda: function([0, 0], parameters=3)), refusal(lambda: found.c_source("1a")), refusal(lambda: found.c_source("é")),
    ]  # fmt: skip


@records.of
def sizes_and_their_limits():
    sizes = {
        name: derivation_size.named_lines(tw.robots.__dict__[name]())
        for name in ("planar_3r", "ur5", "panda", "quadruped", "floating_box")
    }
    checks = [
        refusal(lambda: derivation_size.check_expanded("x", 250_001, 4)),
        derivation_size.check_expanded("x", 250_000, 4),
        refusal(lambda: derivation_size.check_expanded("y", float("inf"), 2)),
    ]
    model = machine(mimic=False).model
    entries = model_entries(model)
    coordinates = coordinates_of(model)
    motions = {}
    for positions, rotations in ((1500, 100), (11, 100), (30, 5), (1500, 2), (3, 3)):
        motion = motion_of(model, entries, coordinates, ring_of(entries, coordinates), positions, rotations)
        motions[f"{positions} {rotations}"] = (
            None
            if motion is None
            else [motion.products([b.inertia for b in entries.bodies]), [len(p) for p in motion.positions[-1]]]
        )
    return {"lines": sizes, "checks": checks, "motions": motions}


@records.of
def states_of_charts():
    answers = {}
    for robot in (raft(), box(), machine()):
        u, du, ddu = (x[0] for x in state(robot.nv))
        answers[robot.name] = [
            *to_robot(robot.model, u, du, ddu),
            [[c.name, c.rate, c.acceleration, c.angle, c.meaning] for c in coordinates_of(robot.model)],
        ]
    answers["rates"] = [rate_symbol(name, mark) for name in ("x", "theta_1", "a_b_c") for mark in ("dot", "ddot")]
    return answers


# ── Lagrangians


def lagrangians():
    m, M, R, g, k, a, Omega, t, B, e = sympy.symbols("m M R g k a Omega t B e")
    x, y, theta, phi, xdot, ydot, thetadot, phidot = sympy.symbols("x y theta phi xdot ydot thetadot phidot")
    cart = (
        (M + m) * xdot**2 / 2
        + m * a * xdot * thetadot * sympy.cos(theta)
        + m * a**2 * thetadot**2 / 2
        - m * g * a * sympy.cos(theta)
        - k * x**2 / 2
    )
    return {
        "cart": (cart, [x, theta], {}),
        "bead": (m * R**2 / 2 * (thetadot**2 + Omega**2 * sympy.sin(theta) ** 2) + m * g * R * sympy.cos(theta), theta, {"name": "bead"}),
        "magnet": (m * (xdot**2 + 2 * ydot**2) / 2 + B * e * (x * ydot - y * xdot) / 3 - k * x * y, [x, y], {}),
        "time": (m * (xdot + Omega * a * sympy.cos(Omega * t)) ** 2 / 2 - k * x**2 / 2 + t * x, [x], {"time": t}),
        "root": (m * xdot**2 / 2 * sympy.sqrt(1 + x**2) - g * sympy.exp(a * x) * sympy.log(x) + sympy.sqrt(1 + a) * x, [x], {}),
        "cubic": (m * xdot**2 * (x + a) ** 3 / 2 - k * x**7 / 7, [x], {}),
        "sphere": (m * R**2 / 2 * (thetadot**2 + sympy.sin(theta) ** 2 * phidot**2) - m * g * R * sympy.cos(theta), [theta, phi], {}),
        "double angle": (m * xdot**2 * (2 + sympy.cos(2 * x - 3 * y)) / 2 + M * ydot**2 * (3 + sympy.sin(y)) - k * sympy.sin(x + y), [x, y], {}),
        "shifted": (m * xdot**2 / 2 - k * sympy.cos(x + a) - k * sympy.cos(x / 2), [x], {}),
        "other rates": (m * e**2 / 2 - k * x, [x], {"rates": [e]}),
    }  # fmt: skip


@records.of
def equations_of_lagrangians():
    answers = {}
    for name, (L, q, options) in lagrangians().items():
        found = lagrange.lagrange(L, q, **options)
        numbers = {symbol.name: 0.7 + 0.3 * k for k, symbol in enumerate(source_code.constants(found))}
        q0, dq0, ddq0 = state(len(found.q))
        torques = found.function("inverse_dynamics")(np.abs(q0) + 0.1, dq0, ddq0, parameters=numbers)
        answers[name] = {
            "steps": steps_of(found),
            "split": found.split,
            "torques": torques,
            "repr": repr(found),
            "constants": list(numbers),
        }
        answers[name]["bias"] = found.function("bias_forces")(np.abs(q0) + 0.1, dq0, parameters=numbers)
    return answers


@records.of
def refused_lagrangians():
    m, k, t, x, y, xdot, ydot, v = sympy.symbols("m k t x y xdot ydot v")
    theta = sympy.Function("theta")(t)
    K = m * xdot**2 / 2
    calls = [
        (K, 3, {}), (K, [x, x], {}), (K, [x, 2], {}), (K, [], {}), (K, x, {"time": x}), (K, x, {"time": 3}), (K - theta, x, {}), (K - sympy.Symbol("x", real=True), x, {}), (K + ydot, x, {}), (K + sympy.Symbol("x_dot"), x, {}), (K + sympy.Symbol("xddot_1"), x, {}), (K * t, x, {}), (k * x, x, {}),
        ("K", x, {}), (sympy.Matrix([K]), x, {}), (3, x, {}), (True, x, {}), (K, x, {"rates": [x]}), (K, x, {"rates": [v, k]}), (K, [x, y], {"rates": v}), (m * xdot**3, x, {}), (m * sympy.sqrt(1 + xdot**2), x, {}), (sympy.Eq(K, k), x, {}),
    ]  # fmt: skip
    return [refusal(lambda L=L, q=q, o=o: lagrange.lagrange(L, q, **o)) for L, q, o in calls]


@records.of
def forms_that_lagrange_reads():
    """Which Lagrangians are read as sums of products: all others take SymPy's derivatives."""
    x, y, xdot, ydot, a = sympy.symbols("x y xdot ydot a")
    q, dq, ddq = (x, y), (xdot, ydot), tuple(sympy.symbols("xddot yddot"))
    expressions = [
        xdot**2, xdot**7, xdot * ydot, xdot**3 * x, x**7 * xdot**2, x**8 * xdot**2, sympy.sin(x) * xdot, sympy.cos(2 * x + y), sympy.cos(x + a), sympy.cos(x / 2), sympy.tan(x), sympy.sin(a) * x, sympy.sqrt(a) * x, 1 / a, 1 / x, (x + a) ** 2, (x**7) ** 7 * x, (x**7) ** 7 * (y**7) ** 7 * (x**7) ** 7 * (x**7) ** 7 * (x**7) ** 7,
        (x**7) ** 7 * (x**7) ** 7 * (x**7) ** 7 * (x**7) ** 7 * (x**7) ** 7 * x**6, (x**7) ** 7 * (x**7) ** 7 * (x**7) ** 7 * (x**7) ** 7 * (x**7) ** 7 * x**7, sympy.Symbol("x", real=True), sympy.sin(x * y), sympy.cos(x + sympy.pi), sympy.Rational(1, 3) * x, 0.5 * x, sympy.cos(sympy.cos(x)),
    ]  # fmt: skip
    answers = []
    for expression in expressions:
        found = lagrange._read_sum_of_products(sympy.sympify(expression), q, dq, ddq)
        atoms = dict.fromkeys((*q, *dq, *ddq), "")
        collected = lagrange._collect_atoms(sympy.sympify(expression), {*q, *dq}, atoms)
        answers.append(
            [
                str(expression),
                None if found is None else [len(found[0].kinetic), len(found[1])],
                collected,
                lagrange._max_exponent(sympy.sympify(expression), atoms) if collected else None,
                list(map(str, atoms.values()))[6:],
            ]
        )
    return answers


# ── output


def small():
    """One hinge in an inclined field: equations without common subexpressions."""
    builder = ModelBuilder("swing & <co> 1_2")
    builder.gravity = (0.0, -9.0, 1.0)
    builder.add_link("base")
    builder.add_link("seat_1|2", body(3.0, (0.25, -0.125, 0.0), (0.1, 0.2, 0.3)))
    builder.add_joint("rope", "revolute", "base", "seat_1|2", axis=(0, 0, 1), friction=0.5)
    return Robot(builder.build(quiet=True))


@records.of
def documents_of_all_kinds():
    found = derived("small")
    texts = {
        "latex": found.latex(),
        "body": found.latex(["gravity_forces", "equations"], document=False),
        "markdown": found.markdown(),
        "html": found.html(["positions", "lagrangian", "gravity_forces", "equations"]),
        "text": found.text(),
    }
    answers = {name: without_check(text) for name, text in texts.items()}
    bare = lagrange.lagrange(-sympy.Symbol("x") + sympy.Symbol("xdot") ** 2, sympy.Symbol("x"))
    answers["bare page"] = [
        line for line in replace(bare, meanings=()).html().splitlines() if "<div" in line or "<td" in line
    ]
    answers["html"] = answers["html"][:3] + [line for line in answers["html"] if "math" in line or "<td" in line]
    machine_text = derived("machine", form="named").latex(["mass_matrix", "equations"], document=False)
    machine_text += found.latex(document=False) + derived("raft").latex(
        ["kinetic_energies", "lagrangian", "positions"], document=False
    )
    answers["breaks"] = [[documents.latex_symbols(line), line[:30]] for line in machine_text.splitlines()]
    return answers


@records.of
def sources_of_all_kinds():
    m, k, a = sympy.symbols("m lambda 2a")
    x, xdot = sympy.symbols("q qdot")
    L = m * xdot**2 / 2 - k * x**2 * sympy.Rational(1, 3) - a * sympy.cos(x) / 7
    found = lagrange.lagrange(L, x, name="odd name 1*/")
    digits = lagrange.lagrange(L, x, name="2 ärms")
    robot = derived("small")
    sources = {
        "c": found.c_source(),
        "numpy": found.numpy_source(),
        "digits": "\n".join(line for line in digits.c_source().splitlines() if line.startswith("void")),
        "robot c": robot.c_source("sw"),
        "robot numpy": robot.numpy_source(),
    }
    return {name: without_check(text) for name, text in sources.items()}


@records.of
def expressions_as_source():
    x, y, z = sympy.symbols("x y z")
    real = sympy.Symbol("r", real=True)
    S = sympy
    expressions = [
        x + y, x - y, -x, -x * y, 2 * x, -2 * x * y, x * (y + z), -(x + y) * z, x**2, x**8, x**9, (x + y) ** 2, 1 / x, 1 / (x + y), x / y**2, S.sqrt(x), 1 / S.sqrt(x), x ** S.Rational(3, 2), x**y, S.sin(x), S.cos(x + y), S.tan(x) * S.sinh(y), S.exp(x), S.log(x), S.asin(x), S.acos(x), S.atan(x), S.atan2(y, x), S.acosh(x), S.asinh(x),
        S.atanh(x), S.cosh(x), S.tanh(x), S.Abs(real), S.sign(real), S.Integer(7), S.Rational(1, 4), S.Rational(1, 3), S.Rational(-2, 7), S.Float(0.1), S.pi, S.E, 3 * S.pi * x, S.Rational(2**52 + 1, 4), S.Rational(2**60 + 1, 2**61), -S.sqrt(x) / 3, (x * y) ** 2, x ** (-3), (-x) ** 2, S.Rational(1, 2) * x, S.sin(x) ** 2, 1 / S.sin(x), S.Rational(2) ** S.Rational(1, 2) * x, S.Rational(2**1001 + 1, 3), S.Rational(3, 2**52), S.Rational(2**49 + 1, 4),
    ]  # fmt: skip
    wrong = [
        S.gamma(x),
        S.Max(x, y),
        S.oo,
        S.Integer(10) ** 400,
        S.Piecewise((x, x > 0), (y, True)),
        S.I * x,
        S.Derivative(S.Function("f")(x), x),
    ]
    from twistwrench.symbolic.c_source import _C
    from twistwrench.symbolic.numpy_source import _NUMPY_PATTERNS

    answers = {str(e): [source_code.expression_text(e, forms) for forms in (_C, _NUMPY_PATTERNS)] for e in expressions}
    return {"written": answers, "wrong": [refusal(lambda e=e: source_code.expression_text(e, _C)) for e in wrong]}


@records.of
def names_in_source():
    symbols = [
        sympy.Symbol(name)
        for name in (
            "q",
            "x",
            "x_",
            "sin",
            "M_PI",
            "M_x",
            "2a",
            "_b",
            "a b",
            "é",
            "lambda",
            "E2BIG",
            "ERANGE",
            "INT_x",
            "k0",
            "Γ",
            "p",
            "class",
            "np",
            "m_1",
        )
    ]
    found = equations.Equations(
        name="n", q=tuple(symbols[:2]), dq=tuple(symbols[2:4]), ddq=tuple(symbols[4:6]), lagrangian=0, mass_matrix=sympy.ImmutableMatrix([[symbols[6], 0], [0, symbols[7]]]), christoffel=None, coriolis_matrix=None, coriolis_forces=None, gravity_forces=None,
        tau=sympy.ImmutableMatrix([sum(symbols[6:14]), sum(symbols[14:])]), steps=(),
    )  # fmt: skip
    safe = source_code.ordered_names(found)
    return [[symbol.name, name] for symbol, name in safe.items()]


@records.of
def expressions_in_all_notations():
    S = sympy
    names_ = "m_1 m_2 I_1zz L_1 r_2x g g_x theta_1 theta_2 thetadot_1 thetaddot_2 xdot k J_1 G_r1 h_3 a t Omega phi_12_3 bcd ydot_2 m_r1 alpha"
    v = {name: S.Symbol(name) for name in names_.split()}
    m1, m2, I1, L1, r2, g, th1, th2, d1, dd2 = (
        v[name]
        for name in ("m_1", "m_2", "I_1zz", "L_1", "r_2x", "g", "theta_1", "theta_2", "thetadot_1", "thetaddot_2")
    )
    expressions = [
        m1 * L1 * g * S.cos(th1), -(m1 + m2) * L1**2 * d1, dd2 * (I1 + m2 * r2**2), m1 / 2, m1 / 4, 3 * m1 / 4, m1 / 3, -m1 / 7 * g, m1 / (L1 + r2), (m1 + m2) / g, 1 / g, 1 / g**2, g**-1 * m1**2, S.sin(th1) ** 2 * S.cos(th1 + th2), (m1 - m2) ** 2, (-m1 + m2) ** 3, S.sqrt(m1), g ** S.Rational(3, 2), S.Float(0.125) * m1, S.Float(1.5e-7) * m1, S.Float(-2.5e10),
        S.Integer(-3), S.Rational(-5, 7), d1 * dd2 * S.sin(th1 - th2) * m2 + d1**2 - dd2 * I1 + g, v["phi_12_3"] * v["bcd"] * v["ydot_2"], v["m_r1"] * v["G_r1"] ** 2 * v["J_1"], v["Omega"] * v["t"] + v["a"] * v["k"] * v["h_3"], S.exp(th1), S.ImmutableMatrix([m1, -g, 0]), S.ImmutableMatrix([[m1, 2], [g, m2 - m1]]), -(m1 - m2), -m1 - m2, (m1 + m2) * (L1 + r2) * (d1 + 1), m1 * (d1 + dd2), S.cos(-th1), S.Integer(0), v["g_x"] * v["alpha"], v["xdot"] ** 2 * m1 / 2,
        (m1 + m2 * S.cos(th2)) * L1, S.sin(2 * th1), S.cos(th1) ** -2, m1 * S.exp(g) * L1, (L1 * m1) ** 2 * (g + 1) ** 2,
    ]  # fmt: skip
    notations = {"text": names.Text(), "latex": documents.Latex(), "mathml": MathML()}
    answers = {
        str(k): [notation.write(expression) for notation in notations.values()]
        for k, expression in enumerate(expressions)
    }
    labels = [
        equations.Label("L", "thetadot_1"),
        equations.Label("L", "x", rate=True),
        equations.Label("K", "xdot", time="t"),
        equations.Label("M_12"),
        equations.Label("Gamma_1_12_3"),
    ]
    answers["labels"] = [[label.write(notation) for notation in notations.values()] for label in labels]
    answers["parts"] = [
        names.name_parts(name) for name in ("thetadot_1", "xddot", "dot", "dot_1", "a_b_c", "ddot_2", "xdotdot")
    ]
    answers["numbers"] = [names.link_number(index) for index in ("12x", "r3", "x", "r", "", "1r2")]
    answers["entries"] = [
        equations.entry_name("M", 0, 1),
        equations.entry_name("M", 8, 9),
        equations.entry_name("g", 9),
        equations.entry_name("g", 8),
    ]
    answers["shortest"] = [
        names.shortest(x, s)
        for x, s in (
            (0.1 + 0.2, 0),
            (1 / 3, 0),
            (1e-17, 1.0),
            (0.30000000000000016, 1.0),
            (-2.5000000000000004, 0),
            (0, 0),
            (123456.78901234568, 0),
        )
    ]
    answers["headings"] = [
        documents.heading(equations.Step(name, "", ())) for name in ("momenta", "mass_matrix", "coriolis", "x_y")
    ]
    answers["sentences"] = [documents.sentence(text) for text in ("the sum", "a sum", "Γ_ijk = 3", "x", "½ m")]
    answers["escaped"] = [
        documents._latex_text("a_b % & # $ { } ^ ~ \\ Γτ Σ½∂−·≤q̇ q̈²–… ωq̇q̇"),
        documents._markdown_text("a [b](c) <d> | e"),
    ]
    return answers


@records.of
def columns_that_are_too_wide():
    """Columns of entries on both sides of the width of a page, beside labels of two lengths."""
    terms = sympy.symbols("a_1:29")
    answers = {}
    for label in ("p_2", "omega_12"):
        for count in range(17, 23):
            column = sympy.ImmutableMatrix([sympy.Add(*terms[:count]), terms[0], -terms[1]])
            step = equations.Step(
                "positions",
                "",
                ((equations.Label(label), column), (equations.Label("p_1"), sympy.ImmutableMatrix(terms[:3]))),
            )
            lines = documents._aligned_lines(step, documents.Latex())
            answers[f"{label} {count}"] = [[line[:16], len(line), line.count("quad")] for line in lines]
    return answers


@records.of
def numbers_that_are_rounding():
    """A centre of mass and products of inertia that are rounding errors have no symbols."""
    answers = {}
    for dust in (1e-18, 2e-15, 4e-15, 1e-12):
        builder = ModelBuilder("dust")
        builder.add_link("base")
        builder.add_link("arm", body(1.0, (0.25, dust, 0.0), (0.1, 0.2, 0.25), (dust, 0.0, -dust)))
        builder.add_joint("j", "revolute", "base", "arm", placement=at(0.5, dust), axis=(0, 0, 1))
        answers[str(dust)] = [[p.name, p.meaning] for p in model_entries(builder.build(quiet=True)).parameters]
    return answers


@records.of
def lines_of_routines():
    """Numbers of inputs and of lines of each function: only what its results need."""
    answers = {}
    for name, options in (("machine", {"form": "named"}), ("arm", {})):
        found = derived(name, **options)
        safe = source_code.ordered_names(found)
        routines = [source_code.routine(found, function, safe) for function in source_code.FUNCTIONS]
        answers[name] = [
            [r.name, len(r.inputs), len(r.lines) if found.definitions else 0, len(r.results)] for r in routines
        ]
    return answers


@records.of
def lines_that_are_broken():
    text = "a + b (c + d − sin(e + f)) − g_{h + i} (j + k (l − m) + n) + oooooooooooooooooooooo − p"
    answers = {str(width): line_breaks.break_lines(text, width, len) for width in (1, 8, 15, 25, 40, 90)}
    answers["places"] = line_breaks._possible_breaks(text)
    formulas = [
        "\\frac{a}{b}",
        "\\tfrac{1}{2} m_{1} \\, \\sin^{2}{\\theta}",
        "\\dot{\\theta}_{12} \\ddot{x}",
        "\\mathit{abc} + \\cos(x)",
        "\\Gamma_{1,2} - 3 \\cdot 10^{-7}",
        "\\quad a",
        "",
    ]
    answers["symbols"] = [line_breaks.latex_symbols(formula) for formula in formulas]
    return answers


# ── sums of products


def terms_of(polynomial):
    """Terms of a sum by their symbols and wave."""
    ring = polynomial.ring
    found = []
    for (monomial, base), value in polynomial.terms.items():
        kind, multiples = ring.bases[base]
        found.append([str(sorted(ring.exponents(monomial).items())), f"{kind}{list(multiples)}", float(value)])
    return sorted(found)


@records.of
def sums_of_products():
    answers = {}
    for exact in (False, True):
        ring = Ring(["a", "b", "x", "y"], ["x", "y"], exact=exact)
        a, b, x, y = map(ring.symbol, ("a", "b", "x", "y"))
        waves = {
            "c": ring.wave("cos", (1, 0)),
            "s": ring.wave("sin", (1, -2)),
            "d": ring.wave("cos", (-1, 1)),
            "t": ring.wave("sin", (-2, 1)),
            "one": ring.wave("cos", (0, 0)),
            "zero": ring.wave("sin", (0, 0)),
        }
        sums = dict(waves)
        for first in "csdt":
            for second in "csdt":
                if first <= second:
                    sums[first + second] = waves[first] * waves[second]
        P = 3 * a * a * b * waves["c"] + x * x * y * waves["s"] - 2 * b + ring.number(5)
        sums |= {
            "P": P,
            "-P": -P,
            "P-P": P - P,
            "1-P": 1 - P,
            "P-1": P - 1,
            "P+a": P + a,
            "2P": P * 2,
            "0P": P * 0,
            "PP": P * (a - waves["t"]),
        }
        sums |= {f"d{name}": P.diff(name) for name in ("a", "b", "x", "y")}
        sums |= {f"part {ring.exponents(key)}": part for key, part in P.split(["x", "b"]).items()}
        sums["dust"] = (P + ring.number(1e-13) * y).without_dust(1e-12) if not exact else P.without_dust(0.5)
        sums["half"] = (P + ring.number(2.5) * y).without_dust(0.5)
        answers[str(exact)] = {name: terms_of(value) for name, value in sums.items()}
        answers[f"{exact} others"] = [
            len(P),
            bool(P),
            bool(P - P),
            repr(P),
            ring.exponents(ring.monomial({"a": 255, "y": 3})),
            [type(v).__name__ for v in P.terms.values()][:1],
        ]
    return answers


@records.of
def shortest_forms_of_waves():
    joint, chain = np.eye(2, dtype=int), np.array([[1, 0], [1, 1]])
    forms = ShortestForms([joint, chain])
    cos, sin = "cos", "sin"
    cases = [
        {(cos, (1, 1)): 1.0}, {(cos, (1, 1)): 0.5, (cos, (1, -1)): 0.5}, {(cos, (1, 1)): 0.5, (cos, (1, -1)): -0.5}, {(sin, (1, 1)): 0.5, (sin, (1, -1)): 0.5}, {(cos, (2, 0)): 1.0}, {(cos, (2, 0)): 0.5, (cos, (0, 0)): 0.5}, {(cos, (2, 0)): -0.5, (cos, (0, 0)): 0.5}, {(sin, (2, 0)): 0.5}, {(sin, (2, 2)): 1.0, (cos, (2, 2)): 3.0},
        {(cos, (0, 0)): 2.0, (cos, (2, 1)): 1.0, (cos, (0, 1)): 1.0}, {(cos, (3, 0)): 1.0, (cos, (1, 0)): 3.0}, {(cos, (4, 0)): 1.0}, {(cos, (5, 0)): 1.0, (cos, (0, 0)): 1.0}, {(cos, (2, 2)): 0.5, (cos, (0, 0)): 0.5, (sin, (1, 0)): 2.0}, {(cos, (0.5, 0)): 1.0, (cos, (1, 0)): 1.0}, {(cos, (2, -1)): 1.0, (sin, (1, 2)): -1.0},
    ]  # fmt: skip
    return [sorted([str(waves), float(value)] for waves, value in forms.shortest(case).items()) for case in cases]


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
