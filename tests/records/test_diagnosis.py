"""The doctor: findings about robot files, on both sides of each limit, with their repairs."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.core.errors import ModelWarning
from twistwrench.diagnosis import entry_errors, symmetric_links
from twistwrench.diagnosis.findings import Effect, Effects, Finding, Severity
from twistwrench.diagnosis.options import Options
from twistwrench.diagnosis.tensor_checks import reference_of
from twistwrench.diagnosis.unit_checks import _neighbour_frames
from twistwrench.testing import random_robot

from .report_cases import CRANE, TRIPOD, said, shown

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

EDGES = (0.4, 0.12, 0.09)
MASS = 3.9
NAMES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def box(mass=MASS, edges=EDGES):
    a, b, c = edges
    return np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2]) * mass / 12


def turned(tensor, angles=(0.21, -0.17, 0.26)):
    x, y, z = angles
    Rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    Ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    Rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    R = Rx @ Ry @ Rz
    return R @ tensor @ R.T


def inertial(mass, com, tensor, rpy="0.1 0.2 -0.15"):
    entries = " ".join(
        f'{name}="{float(f"{x:.9g}")!r}"' for name, x in zip(NAMES, tensor[np.triu_indices(3)], strict=True)
    )
    return f'<inertial><origin xyz="{com}" rpy="{rpy}"/><mass value="{mass!r}"/><inertia {entries}/></inertial>'


def shape(kind="box", size=None, xyz="0.2 0.01 0.02", tag="collision"):
    size = size or 'size="{} {} {}"'.format(*EDGES)
    return f'<{tag}><origin xyz="{xyz}"/><geometry><{kind} {size}/></geometry></{tag}>'


REST = """
<link name="hand"><inertial><origin xyz="0.03 0.02 0.05"/><mass value="1.3"/><inertia ixx="0.004" iyy="0.005" izz="0.003" ixy="0.0003" ixz="-0.0002" iyz="0.0004"/></inertial></link>
<joint name="wrist" type="revolute"><parent link="beam"/><child link="hand"/><origin xyz="0.42 0.02 0.1" rpy="0.2 0.1 0"/><axis xyz="0 0.6 0.8"/><limit lower="-1.1" upper="1.7" effort="17" velocity="3"/><dynamics damping="0.2"/></joint>"""
JOINT = '<joint name="hinge" type="revolute"><parent link="stand"/><child link="beam"/><origin xyz="0.1 0 0.5" rpy="0.3 0 0.1"/><axis xyz="0 1 0"/><limit lower="-2" upper="1.5" effort="90" velocity="2"/><dynamics damping="0.4" friction="0.3"/></joint>'
STAND = '<link name="stand"><inertial><mass value="5.5"/><inertia ixx="0.2" iyy="0.3" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link>'


def robot(beam, joint=JOINT, rest=REST, stand=STAND):
    return f'<robot name="lever">\n{stand}\n<link name="beam">{beam}</link>\n{joint}{rest}\n</robot>'


def examine(text, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        return tw.doctor(text, **options)


def finding_of(finding):
    repair = finding.repair
    what = None
    if repair is not None:
        inertias = {name: inertia.parameters for name, inertia in repair.inertias.items()}
        what = [repair.kind, repair.sentence, [edit.text for edit in repair.edits], repair.metric, inertias]
    return [str(finding), str(finding.effect), dict(finding.numbers), finding.collective, finding.check, what]


def findings(text, **options):
    return [finding_of(finding) for finding in examine(text, **options).findings]


def beam(tensor=None, mass=MASS, com="0.2 0.01 0.02", solid=None, rpy="0 0 0"):
    return robot(
        inertial(mass, com, box(mass) if tensor is None else tensor, rpy) + (shape() if solid is None else solid)
    )


def entry(tensor, name, factor):
    changed = tensor.copy()
    row, column = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}[name]
    changed[row, column] *= factor
    changed[column, row] = changed[row, column]
    return changed


# ── Tensors


@records.of(relative=1e-6)
def tensors_that_cannot_exist():
    full = turned(box())
    flat = np.array([[0.04, 0.013, -0.011], [0.013, 0.021, 0.009], [-0.011, 0.009, 0.022]])
    cases = {
        f"{name} x {factor}": beam(entry(full, name, factor), rpy="0.1 0 0.2")
        for name in NAMES
        for factor in (100.0, 0.01)
    }
    cases |= {
        "sign of a product": beam(flat * [[1, -1, 1], [-1, 1, 1], [1, 1, 1]]), "signs of all": beam(2 * np.diag(flat.diagonal()) - flat),
        "negative moment": beam(entry(full, "iyy", -1.0)), "triangle": beam(np.diag([0.05, 0.02, 0.0299])), "nearly": beam(np.diag([0.05, 0.02, 0.0301])),
        "without shapes": beam(entry(full, "iyy", 100.0), solid=" "), "of the base": robot(inertial(MASS, "0.2 0 0", box()), stand=STAND.replace('izz="0.25"', 'izz="0.7"')),
        "light": beam(entry(turned(box(0.02)), "izz", 50.0), mass=0.02),
    }  # fmt: skip
    table = {name: findings(text, only="impossible") for name, text in cases.items()}
    fixed = robot(inertial(MASS, "0.2 0.01 0.02", np.diag([0.05, 0.02, 0.02]))).replace(
        "</robot>",
        '<link name="lid"><inertial><origin xyz="0 0.3 0"/><mass value="2"/><inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="on" type="fixed"><parent link="beam"/><child link="lid"/></joint></robot>',
    )
    table["absorbed"] = findings(fixed, only="impossible")
    bad = beam(entry(full, "iyy", 7.0))
    for metric in ("frobenius", "entropic", "affine", "log-det", "riemannian"):
        try:
            table[metric] = findings(bad, only="impossible", metric=metric)
        except Exception:
            table[metric] = refusal(lambda metric=metric: findings(bad, only="impossible", metric=metric))
    report = examine(bad)
    table["repaired"] = [
        report.repaired_text().splitlines()[2],
        report.repaired().model.link_inertias["beam"].parameters,
    ]
    return table  # fmt: skip


@records.of(relative=1e-6)
def tensors_beside_their_shapes():
    """Too large, too small, about the origin, in other units, of solids with one wrong dimension, placeholders and none."""
    com = np.array([0.2, 0.01, 0.02])
    steiner = MASS * (com @ com * np.eye(3) - np.outer(com, com))
    corner = np.array([0.2, 0.06, 0.045])
    most = MASS * (corner @ corner - corner**2)
    full = turned(box())
    cylinder = np.array([0.5 * 0.05**2, (3 * 0.05**2 + 0.3**2) / 12, (3 * 0.05**2 + 0.3**2) / 12]) * MASS
    tall = np.array([0.5 * 0.05**2, (3 * 0.05**2 + 3.0**2) / 12, (3 * 0.05**2 + 3.0**2) / 12]) * MASS
    wide = np.array([0.5 * 5.0**2, (3 * 5.0**2 + 0.3**2) / 12, (3 * 5.0**2 + 0.3**2) / 12]) * MASS
    diagonal = float(np.linalg.norm(EDGES))
    small = MASS * (diagonal / 30) ** 2
    cases = {
        "right": beam(), "about the origin": beam(box() + steiner), "about the origin, large": beam(box() + 9 * steiner, com="0.6 0.03 0.06", solid=shape(xyz="0.6 0.03 0.06")),
        "twice the most": beam(np.diag([0.01, 1.98 * most[1], 1.98 * most[1]])), "more": beam(np.diag([0.01, 2.02 * most[1], 2.02 * most[1]])),
        "identified": beam(9.0 * full), "beyond identified": beam(40.0 * full), "identified at 9.8": beam(turned(np.diag([2.0, 9.8 * most[1], 9.8 * most[1]]), (0.02, 0.03, 0.04))),
        **{f"units 1e{k}": beam(box() * 10.0**k) for k in (2, 3, 4, 5, 6, 7, 9, -3, -4, -6, -7)},
        "long box": beam(box(edges=(4.0, 0.12, 0.09))), "longer box": beam(box(edges=(40.0, 0.12, 0.09))), "cylinder": beam(np.diag(cylinder)), "tall": beam(np.diag(tall)), "wide": beam(np.diag(wide)),
        "too small": beam(np.diag([0.8, 0.99, 0.9]) * small), "not too small": beam(np.diag([0.8, 1.01, 0.9]) * small), "flat": beam(box() * 50, solid=shape(size='size="0.4 0 0.2"')),
        **{f"placeholder {x}": beam(np.eye(3) * x) for x in (1.0, 0.01, 0.02, 1e-4)}, "placeholder with products": beam(np.full((3, 3), 0.1) + np.diag([0.0] * 3)), "unequal": beam(np.diag([0.1, 0.1, 0.01])),
        "zero": beam(np.zeros((3, 3))), "nearly zero": beam(np.eye(3) * MASS * 0.9e-12), "hardly zero": beam(np.eye(3) * MASS * 1.7e-12), "no mass": beam(box(), mass=0.0), "no mass, no tensor": beam(np.zeros((3, 3)), mass=0.0),
        "zero without shapes": beam(np.zeros((3, 3)), solid=" "), "light placeholder": beam(np.eye(3) * 0.01, mass=0.09), "no inertia": robot(shape()),
        "sphere": beam(np.eye(3) * 0.4 * MASS * 0.01, solid=shape("sphere", 'radius="0.1"')), "visual": beam(box() * 1000, solid=shape(tag="visual")),
    }  # fmt: skip
    only = ("too-large", "too-small", "placeholder", "no-inertia", "no-mass", "massless", "impossible")
    return {name: findings(text, only=only) for name, text in cases.items()}


@records.of(relative=1e-6)
def entry_errors_of_a_tensor():
    """Single slips, each with the tensor that it leaves."""
    full = turned(box())
    reference = turned(box(), (0.2, -0.16, 0.25))

    def rows(errors):
        return [[error.kind, error.sentence, error.certain, error.family, error.tensor.diagonal()] for error in errors]

    solids = {
        "box": np.diag(box(edges=(0.3, 0.2, 5.0)).diagonal()), "cylinder": np.diag(np.array([0.5 * 4.0, (12.0 + 0.09) / 12, (12.0 + 0.09) / 12]) * MASS),
        "cylinder about z": np.diag(np.array([(3 * 0.04 + 9.0) / 12, (3 * 0.04 + 9.0) / 12, 0.02]) * MASS), "not round": np.diag(box(edges=(0.3, 0.2137, 5.0)).diagonal()), "with products": full,
    }  # fmt: skip
    table = {
        "signs": rows(entry_errors.sign_errors(full)), "powers": rows(entry_errors.power_errors(entry(full, "iyy", 1000.0))),
        "unit": [rows(entry_errors.unit_errors(reference * 10.0**x, reference)) for x in (2.66, 3.34, 3.36, 4.0, 5.0, 5.8, 7.2, 9.1, -6.1, -0.4, 0.3)],
        "dimensions": {name: rows(entry_errors.dimension_errors(tensor, MASS)) for name, tensor in solids.items()},
        "no mass": rows(entry_errors.dimension_errors(solids["box"], 0.0)), "rounding": [entry_errors._round_dimension(x) for x in (0.3, 0.30002, 0.3001, 0.123, 0.12, 1200.01)],
        "possible": [entry_errors.possible(x) for x in (full, -full, np.zeros((3, 3)), np.diag([1, 1, 2.1]), full * np.nan)], "units": entry_errors.UNITS,
    }  # fmt: skip
    error = entry_errors.EntryError
    candidates = {
        "one": [error("a", "one", full, family="x")], "two": [error("a", "near", reference * 1.1, family="x"), error("b", "far", reference * 1.9, family="y")],
        "too near each other": [error("a", "near", reference * 1.1, family="x"), error("b", "far", reference * 1.19, family="y")], "both far": [error("a", "near", reference * 1.52, family="x"), error("b", "far", reference * 2.9, family="y")],
        "same family": [error("a", "first", reference * 1.6, family="x"), error("b", "second", reference * 1.7, family="x")], "certain": [error("a", "near", reference, family="x"), error("b", "sure", reference * 2, certain=True, family="y")],
        "implausible": [error("a", "first", reference * 3.9, family="x"), error("b", "second", reference * 4.1, family="y")], "impossible": [error("a", "no", -reference, family="x"), error("b", "yes", reference, family="y")],
        "far alone": [error("a", "no", 4.1 * reference, family="x")], "none": [],
    }  # fmt: skip
    for name, errors in candidates.items():
        found = [entry_errors.explain(errors, reference), entry_errors.explain(errors, None)]
        table[f"explained {name}"] = [None if one is None else one.sentence for one in found]
    return table


# ── Masses, units and places


@records.of(relative=1e-6)
def masses_and_places_on_both_sides():
    def of_mass(mass, solid=None, com="0.2 0.01 0.02", tensor=None):
        return beam(tensor if tensor is not None else box(mass), mass=mass, solid=solid, com=com)

    volume = float(np.prod(EDGES))
    diagonal = float(np.linalg.norm(EDGES))
    out = 0.1 * diagonal + 0.01
    far = '<link name="far"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="f" type="fixed"><parent link="hand"/><child link="far"/><origin xyz="{} 0 0"/></joint>'
    cases = {
        **{f"density {x}": of_mass(x * volume) for x in (49.5, 50.5, 7950.0, 8060.0)},
        **{f"outside {x}": of_mass(MASS, com=f"{0.4 + x * out} 0.01 0.02") for x in (0.99, 1.01, 3.0, 9.0)},
        "outside, identified": of_mass(MASS, com="0.55 0.01 0.02", tensor=turned(box())), "outside, identified and far": of_mass(MASS, com="0.6 0.2 0.5", tensor=turned(box())), "in the frame of the hand": of_mass(MASS, com="-0.2 -0.05 -0.1"),
        "diagonal 20": of_mass(MASS, solid=shape(size='size="19.7 1 1"')), "diagonal 20.1": of_mass(MASS, solid=shape(size='size="20.1 1 1"')), "small shapes": of_mass(MASS, solid=shape(size='size="0.0009 0.0002 0.0001"')),
        "com in mm": of_mass(MASS, solid=" ", com="200 10 20"), "com far": of_mass(MASS, solid=" ", com="2.9 0 0.2"), "com farther": of_mass(MASS, solid=" ", com="3.1 0 0.2"), "com in nm": of_mass(MASS, solid=" ", com="2e6 0 0"),
        "grams": of_mass(3900.0, solid=" "), "heavy 149": of_mass(5.5 * 149, solid=" "), "heavy 151": of_mass(5.5 * 151, solid=" "), "grams of a small part": of_mass(90000.0, solid=" ", tensor=box(90.0)),
        "compact": of_mass(MASS, solid=" ", tensor=np.diag([0.8, 1, 0.9]) * MASS * (0.0079 * 0.51) ** 2), "not compact": of_mass(MASS, solid=" ", tensor=np.diag([0.8, 1, 0.9]) * MASS * (0.0081 * 0.75) ** 2),
        **{f"gyration {x}": of_mass(MASS, solid=" ", tensor=np.diag([0.8, 1, 0.9]) * MASS * x**2) for x in (0.99, 1.01, 9.0, 31.0, 300.0)}, "spread": beam(np.eye(3) * MASS * 1.2, solid=" ").replace("</robot>", far.format(1.5) + "</robot>"),
        "light": of_mass(0.004, solid=" ").replace('value="1.3"', 'value="0.003"').replace('ixx="0.004" iyy="0.005" izz="0.003" ixy="0.0003" ixz="-0.0002" iyz="0.0004"', 'ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"'),
        "massless": beam().replace('<mass value="1.3"/>', '<mass value="0"/>').replace('ixx="0.004" iyy="0.005" izz="0.003" ixy="0.0003" ixz="-0.0002" iyz="0.0004"', 'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"'),
        "massless between": robot(shape()), "stand in grams": beam().replace('value="5.5"', 'value="5500"'),
    }  # fmt: skip
    only = ("com-outside", "density", "units", "light", "massless", "assumed")
    table = {name: findings(text, only=only) for name, text in cases.items()}
    contents = examine(beam()).contents.robot
    table["neighbours"] = {name: sorted(_neighbour_frames(contents, link)) for name, link in contents.links.items()}
    table["file"] = [
        contents.span,
        contents.mass,
        [contents.moves(x) for x in ("stand", "beam", "hand", "none")],
        [contents.heavy(link, 0.36) for link in contents.links.values()],
    ]
    table["references"] = [reference_of(link) for link in contents.links.values()]
    return table  # fmt: skip


@records.of(relative=1e-6)
def effects_of_changes():
    contents = examine(CRANE).contents.robot
    model = contents.model
    effects = Effects(model, count=40)
    G = tw.SpatialInertia.from_com
    table = {
        "none": effects.evaluate({}), "base": effects.evaluate({"post": G(1.0)}), "heavier": effects.evaluate({"jib": G(9.0, (0.3, 0.1, 0), np.diag([0.1, 0.2, 0.15]))}),
        "two": effects.evaluate({"jib": G(1.0, (0.3, 0.1, 0), np.diag([0.1, 0.2, 0.15])), "hook": G(2.0)}), "finger": effects.evaluate({"claw_a": G(0.9, (0.02, 0.1, 0))}), "nothing left": effects.evaluate({k: tw.SpatialInertia.zero() for k in model.link_inertias}),
        "diagonal": effects.diagonal, "gravity": effects.gravity_torques, "count": [Effects(model).count, Effects(model, count=7).count], "poses": effects.poses[3][2],
    }  # fmt: skip
    floating = Effects(examine(TRIPOD, floating_base=True).contents.robot.model, count=5)
    table["floating"] = [
        floating.diagonal,
        floating.gravity_torques,
        floating.evaluate({"thigh0": G(3.0, (0.1, 0, 0))}),
    ]
    words = [
        Effect(), Effect(0.5, "a"), Effect(9999.0, "a"), Effect(10001.0, "a"), Effect(0.99e8, "a"), Effect(1.01e8, "a"), Effect(0.0, "", 3.21, "b"), Effect(2.0, "a", 3.0, "b", 12.3, "c"), Effect(2.0, "a", 3.0, "b", 20000.0, "c"),
    ]  # fmt: skip
    table["words"] = [
        [str(one), one.reaches(2.0), one.reaches(2.01), one.reaches(100.0, 12.3), one.reaches(100.0, 12.4)]
        for one in words
    ]
    table["findings"] = [
        str(Finding("c", Severity.NOTE, "link 'a'", line, "text", file=file))
        for line, file in ((0, ""), (7, ""), (7, "b.xml"))
    ]
    return table  # fmt: skip


# ── Joints


@records.of(relative=1e-6)
def joints_of_all_defects():
    def joint(text):
        return robot(
            inertial(MASS, "0.2 0.01 0.02", box()),
            joint=JOINT.replace('lower="-2" upper="1.5" effort="90" velocity="2"', text),
        )

    base = 'effort="90" velocity="2"'
    cases = {
        **{f"limits {a} {b}": joint(f'lower="{a}" upper="{b}" {base}') for a, b in ((-90, 120), (-12, 12), (-13, 12.5), (-13, 12), (0, 999), (-1001, 1000), (0.2, 1.5), (-2, -0.1), (0, 1))},
        **{f"effort {e} {v}": joint(f'lower="-2" upper="1.5" effort="{e}" velocity="{v}"') for e, v in ((0, 0), (1000, 999), (1001, 1000), (9999, 10000), (1e5, 2), (4.0, 2), (1.5, 2), (40, 0), (14.5, 2))},
        **{f"axis {a}": beam().replace('xyz="0 0.6 0.8"', f'xyz="{a}"') for a in ("0 0.6 0.8009", "0 0.6 0.8014", "0 3 4", "0 0 0.5")},
        "stroke": joint(f'lower="-2" upper="3.01" {base}').replace('name="hinge" type="revolute"', 'name="hinge" type="prismatic"'), "short stroke": joint(f'lower="-2" upper="2.99" {base}').replace('name="hinge" type="revolute"', 'name="hinge" type="prismatic"'),
        "endless stroke": joint(f'lower="-600" upper="600" {base}').replace('name="hinge" type="revolute"', 'name="hinge" type="prismatic"'), "no friction": beam().replace('<dynamics damping="0.2"/>', "").replace('<dynamics damping="0.4" friction="0.3"/>', ""),
        "no limit": joint("").replace("<limit />", ""), "continuous": joint("").replace("<limit />", "").replace('type="revolute"', 'type="continuous"', 1), "degrees of both": joint(f'lower="-90" upper="120" {base}').replace('lower="-1.1" upper="1.7"', 'lower="-180" upper="45"'),
        "placeholders": joint('lower="-2" upper="1.5" effort="1000" velocity="2"').replace('effort="17"', 'effort="1000"').replace("</robot>", '<link name="tip"><inertial><mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="twist" type="revolute"><parent link="hand"/><child link="tip"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1000" velocity="1"/></joint></robot>'),
        "mimic without a leader": beam().replace('<dynamics damping="0.2"/>', '<mimic joint="hing"/>'), "mimic": beam().replace('<dynamics damping="0.2"/>', '<mimic joint="hinge" multiplier="2"/>'),
    }  # fmt: skip
    only = ("mimic", "degrees", "limits", "effort", "placeholder-limits", "axis", "friction")
    table = {name: findings(text, only=only) for name, text in cases.items()}
    table["with limits"] = findings(
        joint(f'lower="-2" upper="1.5" {base}'), only="effort", limits={"hinge": 5.0, "wrist": 1000.0}
    )
    table["infinite"] = findings(joint(f'lower="-2" upper="1.5" {base}'), only="effort", limits={"hinge": float("inf")})
    report = examine(cases["degrees of both"])
    table["repaired"] = [line for line in report.repaired_text().splitlines() if "limit" in line or "<!--" in line]
    broken = (
        cases["limits -90 120"]
        .replace('<parent link="beam"/>', '<parent link="bean"/>')
        .replace('type="revolute"><parent link="stand"/>', 'type="revolut"><parent link="stand"/>')
    )
    table["broken"] = refusal(lambda: examine(broken))
    twice = beam().replace(
        "</robot>",
        '<joint name="again" type="fixed"><parent link="stand"/><child link="hand"/></joint><joint name="more" type="fixed"><parent link="x"/><child link="hand"/></joint></robot>',
    )
    table["twice"] = refusal(lambda: examine(twice))
    return table  # fmt: skip


# ── Left and right


def pair(
    left, right, rpy="0 0 0", place=(0.2, 0.15, 0.1), shapes=("", ""), names=("left_arm", "right_arm"), axis="0 1 0"
):
    x, y, z = place
    links = "".join(
        f'<link name="{name}">{inertia}{solid}</link>'
        for name, inertia, solid in zip(names, (left, right), shapes, strict=True)
    )
    joints = "".join(
        f'<joint name="{name}_joint" type="revolute"><parent link="trunk"/><child link="{name}"/><origin xyz="{x} {sign * y} {z}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="-1" upper="1" effort="20" velocity="3"/></joint>'
        for name, sign in zip(names, (1, -1), strict=True)
    )
    trunk = '<link name="trunk"><inertial><mass value="6"/><inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    return f'<robot name="twins">\n{trunk}\n{links}\n{joints}</robot>'


@records.of(relative=1e-6)
def mirrored_links():
    T = np.array([[0.02, 0.001, -0.002], [0.001, 0.03, 0.003], [-0.002, 0.003, 0.025]])
    M = T * [[1, -1, 1], [-1, 1, -1], [1, -1, 1]]

    def left(mass=2.0, com="0.1 0.03 -0.05", tensor=T):
        return inertial(mass, com, tensor, "0 0 0")

    def right(mass=2.0, com="0.1 -0.03 -0.05", tensor=M):
        return inertial(mass, com, tensor, "0 0 0")

    meshes = [
        '<collision><geometry><mesh filename="{}.stl"{}/></geometry></collision>'.format(*x)
        for x in (("l", ""), ("r", ""), ("l", ' scale="1 -1 1"'), ("l", ""))
    ]
    boxes = [
        shape(xyz="0.1 0.03 -0.05", size='size="0.2 0.1 0.1"'),
        shape(xyz="0.1 -0.03 -0.05", size='size="0.2 0.1 0.1"'),
    ]
    cases = {
        "equal": pair(left(), right()), "mass": pair(left(2.0019), right()), "mass more": pair(left(2.0021), right()), "com": pair(left(com="0.1 0.0319 -0.05"), right()), "com more": pair(left(com="0.1 0.0321 -0.05"), right()),
        "tensor": pair(left(tensor=T + np.diag([0.0037, 0, 0])), right()), "tensor more": pair(left(tensor=T + np.diag([0.0042, 0, 0])), right()), "sign": pair(left(), right(tensor=T)), "all": pair(left(2.3, "0.12 0.03 -0.05", 1.4 * T), right()),
        "same part": pair(left(), left()), "same part with shapes": pair(left(), left(), shapes=(boxes[0], boxes[0])), "same part of two meshes": pair(left(), left(), shapes=(meshes[0], meshes[1])), "same part of one mesh": pair(left(), left(), shapes=(meshes[0], meshes[3])), "meshes": pair(left(2.3), right(), shapes=meshes[:2]), "mirrored mesh": pair(left(2.3), right(), shapes=(meshes[0], meshes[2])), "one mesh": pair(left(2.3), right(), shapes=(meshes[0], meshes[3])),
        "evidence": pair(left(2.0, "0.15 0.03 -0.05"), right(), shapes=boxes), "evidence for left": pair(left(), right(2.0, "0.15 -0.05 -0.05"), shapes=boxes), "no evidence": pair(left(2.0, "0.13 0.03 -0.05"), right(2.0, "0.08 -0.03 -0.05"), shapes=boxes),
        "near the plane": pair(left(2.3), right(), place=(0.2, 0.0049, 0.1)), "farther": pair(left(2.3), right(), place=(0.2, 0.0102, 0.1)), "not mirrored": pair(left(2.3), right(), rpy="0.1 0 0"), "rolled": pair(left(2.3), right(), rpy="0 0.3 0"),
        "other names": pair(left(2.3), right(), names=("FL_hip", "FR_hip")), "unrelated": pair(left(2.3), right(), names=("a", "b")), "light": pair(left(0.004, tensor=T / 500), right(0.005, tensor=M / 500)), "impossible": pair(left(2.3, tensor=np.diag([0.1, 0.01, 0.01])), right()),
    }  # fmt: skip
    table = {name: findings(text, only="mirror", meshes=False) for name, text in cases.items()}
    for side in ("left", "right"):
        for name in ("all", "meshes", "impossible", "mirrored mesh"):
            report = examine(cases[name], only="mirror", mirror_from=side, meshes=False)
            table[f"{name} from {side}"] = [
                [finding_of(one) for one in report.findings],
                report.repaired_text().splitlines()[2][:420],
            ]
    words = (
        "arm_left_4_link",
        "LElbow",
        "l_hand",
        "lshoulder",
        "left",
        "leftover_part",
        "FL_hip",
        "RL_calf",
        "hl",
        "BL2",
        "lf_foot",
        "LH",
        "lr_x",
        "tool",
        "Left3",
        "elbow_l_left",
        "lab",
        "labs",
    )
    table["names"] = {word: list(symmetric_links.right_side_names(word)) for word in words}
    T_a, T_b = np.eye(4), np.eye(4)
    maps = {}
    for name, a, b in (
        ("y", (0.1, 0.2, 0.3), (0.1, -0.2, 0.3)),
        ("x", (0.1, 0.2, 0.3), (-0.1, 0.2, 0.3)),
        ("gap", (0.1, 0.2, 0.3), (0.1, -0.2009, 0.3)),
        ("wider gap", (0.1, 0.2, 0.3), (0.1, -0.2011, 0.3)),
        ("near", (0.1, 0.0099, 0.3), (0.1, -0.0099, 0.3)),
        ("not near", (0.1, 0.0101, 0.3), (0.1, -0.0101, 0.3)),
        ("none", (0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
    ):
        T_a[:3, 3], T_b[:3, 3] = a, b
        maps[name] = symmetric_links._mirror_map(T_a, T_b)
    return table | {"maps": maps}  # fmt: skip


# ── Whole reports


@records.of(relative=1e-6)
def whole_reports(folder):
    bad = (
        beam(entry(turned(box()), "iyy", 100.0), com="0.6 0.2 0.02")
        .replace('lower="-1.1" upper="1.7"', 'lower="-180" upper="45"')
        .replace('xyz="0 0.6 0.8"', 'xyz="0 3 4"')
    )
    path = folder / "lever.urdf"
    path.write_text(bad)
    report = examine(path)
    answers = {
        "bad": report,
        "fine": examine(beam()),
        "strict": examine(beam(), strict=True),
        "legged": examine(TRIPOD),
        "of a robot": examine(tw.load(path, inertia="accept")),
        "of a model": examine(random_robot(4, 3)),
    }
    table = {name: [said(answer), shown(answer.blocks())] for name, answer in answers.items()}
    table["properties"] = [
        [
            answer.summary,
            answer.brief,
            answer.exit_code(),
            answer.exit_code(strict=True),
            answer.source,
            list(answer.sources()),
            answer.effect,
            len(answer.paragraphs),
        ]
        for answer in answers.values()
    ]
    target = folder / "mended.urdf"
    table["written"] = [
        [str(finding) for finding in report.write(target)],
        target.read_text().splitlines(),
        refusal(lambda: report.write(target)),
        len(report.write(target, overwrite=True)),
    ]
    table["no file"] = refusal(lambda: examine(random_robot(4, 3)).repaired_text())
    several = "".join(
        f'<link name="part{k}"><inertial><mass value="{1 + 0.1 * k}"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j{k}" type="revolute"><parent link="{"hand" if k == 0 else f"part{k - 1}"}"/><child link="part{k}"/><origin xyz="0.1 0 0"/><axis xyz="0 1 0"/><limit lower="0.1" upper="1" effort="0" velocity="0"/></joint>'
        for k in range(9)
    )
    table["many"] = shown(examine(beam().replace("</robot>", several + "</robot>")).blocks())
    sdf = '<sdf version="1.8"><model name="m"><link name="a"/><link name="b"><inertial><mass>2</mass></inertial></link><joint name="j" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz></axis></joint></model></sdf>'
    mjcf = '<mujoco><compiler settotalmass="7" balanceinertia="true" boundmass="0.5"/><worldbody><body name="a"><joint name="j"/><inertial pos="0 0 0.1" mass="0.1" diaginertia="0.5 0.1 0.1"/><geom size="0.1"/></body></worldbody></mujoco>'
    table["sdf"] = findings(sdf)
    table["mjcf"] = findings(mjcf)
    table["options"] = {
        name: refusal(lambda options=options: examine(beam(), **options))
        for name, options in {
            "only": {"only": "densty"},
            "metric": {"metric": "x"},
            "side": {"mirror_from": "top"},
        }.items()
    }
    table["names"] = [list(examine(beam(), only=("density", "axis")).checks), Options(), list(examine(beam()).checks)]
    (folder / "a.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="x"><xacro:property name="a" value="1"/></robot>'
    )
    table["xacro"] = refusal(lambda: examine(folder / "a.xacro"))
    table["usd"] = refusal(lambda: examine(folder / "a.usda")) if (folder / "a.usda").write_text("#usda 1.0") else None
    return table  # fmt: skip


@records.of(relative=1e-6)
def further_findings():
    """Limits in degrees of other formats, load errors of each kind, moments in each unit, and many findings."""
    mjcf = '<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="j" axis="0 1 0" range="-90 120"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.05" mass="1.2"/></body></worldbody></mujoco>'
    table = {"mjcf in degrees": findings(mjcf, only="degrees")}
    for x in (0.9, 2.1, 12.0, 45.0, 130.0, 900.0):
        text = robot(
            inertial(MASS, "0.2 0.01 0.02", np.diag([0.8, 1, 0.9]) * MASS * x**2),
            rest=REST.replace('xyz="0.42 0.02 0.1"', 'xyz="0.05 0.02 0.01"'),
            joint=JOINT.replace('xyz="0.1 0 0.5"', 'xyz="0.02 0 0.03"'),
        )
        table[f"gyration {x}"] = findings(text, only="units")
    world = "".join(
        f'<link name="w{k}"><inertial><mass value="{m}"/><inertia ixx="1" iyy="1" izz="{1.3 + k}" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="k{k}" type="revolute"><parent link="hand"/><child link="w{k}"/><axis xyz="0 0 2"/><limit lower="-90" upper="90" effort="1" velocity="1"/></joint>'
        for k, m in enumerate((1.1, 0.4, 2.2, 3.1, 0.7, 0.9, 5.0, 1.6))
    )
    report = examine(beam().replace("</robot>", world + "</robot>"))
    table["many"] = [shown(report.blocks()), report.summary, [str(finding) for finding in report.repairs]]
    bad = "".join(
        f'<joint name="x{k}" type="revolute"><parent link="hand"/><child link="lost{k}"/></joint>\n' for k in range(16)
    )
    table["many errors"] = refusal(lambda: examine(beam().replace("</robot>", bad + "</robot>")))
    table["no parent"] = refusal(lambda: examine(beam().replace('<parent link="beam"/>', "")))
    table["two parents of a joint"] = refusal(
        lambda: examine(beam().replace('<parent link="beam"/>', '<parent link="beam"/><parent link="stand"/>'))
    )
    table["name"] = examine("pendulum").summary
    table["not a robot"] = refusal(lambda: examine("<a/>"))
    table["broken text"] = refusal(lambda: examine("<robot name='a'><link"))
    models = '<sdf version="1.8"><world name="w"><model name="m"><link name="a"><inertial><mass>2</mass></inertial></link></model><model name="n"><link name="b"><inertial><mass>3</mass></inertial></link></model></world></sdf>'
    table["one of two models"] = examine(models, model="n").robot
    table["which model"] = refusal(lambda: examine(models))
    return table


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
