"""How derived equations are written: squares and products, numbers as the file has them, names of rotors, lines that fit."""

from __future__ import annotations

import re

import numpy as np
import pytest
import sympy

import twistwrench as tw
from twistwrench.core.errors import ValueRangeError
from twistwrench.core.text import text_width
from twistwrench.mechanics.model.builder import ModelBuilder
from twistwrench.symbolic import derive, lagrange
from twistwrench.symbolic.line_breaks import break_lines
from twistwrench.symbolic.names import shortest


def rrp(general: bool, reach: float = 0.5) -> tw.Robot:
    """Waist, shoulder, and a slide along the arm; with ``general``, every inertia full and no centre on an axis."""
    rng = np.random.default_rng(0)
    builder = ModelBuilder("rrp")
    builder.add_link("base")
    places, coms = [(0, 0, 0.4), (0, 0, 0.2), (reach, 0, 0)], [(0, 0, 0.1), (0.2, 0, 0), (0.15, 0, 0)]
    joints = [("continuous", (0, 0, 1)), ("continuous", (0, 1, 0)), ("prismatic", (1, 0, 0))]
    for k, (place, com, (kind, axis)) in enumerate(zip(places, coms, joints, strict=True), 1):
        I = np.diag([0.1, 0.12, 0.05])
        if general:
            A = 0.2 * rng.standard_normal((3, 3))
            I, com = (A @ A.T).trace() * np.eye(3) - A @ A.T, np.add(com, (0.01, 0.02, 0.03))
        T = np.eye(4)
        T[:3, 3] = place
        builder.add_link(f"link{k}", tw.SpatialInertia.from_com(4.0 - k, com, I))
        parent = "base" if k == 1 else f"link{k - 1}"
        builder.add_joint(f"joint{k}", kind, parent, f"link{k}", placement=T, axis=axis)
    return tw.Robot(builder.build())


# ── squares, products, signs ──


def test_squares_are_written_as_squares():
    lines = derive(rrp(general=False)).text("mass_matrix")
    assert "m₃ (L₂ + r₃ + x₃)² cos²(θ₂)" in lines
    assert "M₂₂ = m₂ r₂² + I₂yy + m₃ (L₂ + r₃ + x₃)² + I₃yy" in lines


def test_squares_stand_beside_what_is_none():
    lines = derive(rrp(general=True)).text("mass_matrix")
    assert "m₃ ((L₂ + r₃x + x₃)² + r₃z²)" in lines
    assert "2 r₃z (L₂ + r₃x + x₃) cos(θ₂) sin(θ₂)" in lines


def test_sums_that_all_terms_share_are_written_once():
    arm = derive(tw.robots.ur5(lock={"wrist_1_joint": 0, "wrist_2_joint": 0, "wrist_3_joint": 0}))
    M13 = arm.text("mass_matrix").splitlines()[3]
    assert "m₃ (L₁ − L₂y + r₃y) (r₃x cos(θ₂ + θ₃) + r₃z sin(θ₂ + θ₃))" in M13


def test_masses_are_written_once_in_a_bracket():
    assert "g₂ = −(m₂ r₂ + m₃ (L₂ + r₃ + x₃)) g cos(θ₂)" in derive(rrp(general=False)).text("gravity_forces")
    short = derive(rrp(general=False, reach=0.0)).text("gravity_forces")
    assert "g₂ = −(m₂ r₂ + m₃ (r₃ + x₃)) g cos(θ₂)" in short


@pytest.mark.parametrize("general", [False, True])
def test_no_bracket_begins_with_a_minus(general):
    equations = derive(rrp(general))
    assert "(−" not in equations.text(["mass_matrix", "christoffel", "coriolis_matrix", "gravity_forces", "equations"])
    assert r"\, (-" not in equations.latex("christoffel")


def test_factors_are_the_sum_they_were():
    """Written short is not written otherwise: each entry expands to the second derivative of the L printed."""
    equations = derive(rrp(general=True))
    for i, v in enumerate(equations.dq):
        for j, w in enumerate(equations.dq):
            assert sympy.expand(equations.lagrangian.diff(v).diff(w) - equations.mass_matrix[i, j]) == 0


# ── numbers ──


def test_shortest_decimal_within_round_off():
    assert shortest(0.010000000000000002) == 0.01
    assert shortest(0.1 + 0.2) == 0.3
    assert shortest(-1e-300 * 3) == -3e-300
    assert shortest(0.0) == 0.0
    for x in np.random.default_rng(1).uniform(-1, 1, 500):  # seventeen digits: none within round-off is far
        assert abs(shortest(x) - x) <= 4e-16 * abs(x)
    assert shortest(0.1 + 1e-15) == 0.1 + 1e-15  # five units away is another number
    assert shortest(0.1 + 1e-15, 10.0) == 0.1  # but not after the difference of two numbers near ten


@pytest.mark.slow
def test_numbers_of_the_file_come_back():
    """Through fusing a fixed link, and through the origin and back by Steiner's theorem."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        m, x, I = (
            rng.uniform(0.1, 9).__round__(3),
            rng.uniform(0.05, 0.6).__round__(3),
            rng.uniform(0.001, 0.1).__round__(4),
        )
        inertia = f'ixx="{I}" iyy="{I}" izz="{I}" ixy="0" ixz="0" iyz="0"'
        robot = tw.load(
            f"""<robot name="one"><link name="base"/><link name="arm"><inertial><origin xyz="{x} 0 0"/><mass value="{m}"/>
            <inertia {inertia}/></inertial></link><link name="plate"/>
            <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/></joint>
            <joint name="bolt" type="fixed"><origin xyz="0.7 0.8 0.9"/><parent link="arm"/><child link="plate"/></joint>
            </robot>"""
        )
        equations = derive(robot)
        values = {p.name: p.value for p in equations.parameters}
        assert (values["m_1"], values["r_1"], values["I_1zz"]) == (m, x, I)
        assert f"{I!r}, /* I_1zz */" in equations.c_source()


# ── rotors ──


DRIVES = {
    "joint1": {"ratio": 100, "rotor": {"inertia": "200 g cm^2", "extra": True}},
    "joint2": {"ratio": -50, "stiffness": "800 N m/rad", "rotor": {"inertia": "1 kg cm^2", "extra": True}},
}


@pytest.mark.parametrize("form", ["expanded", "named"])
def test_gear_ratios_are_symbols_and_rotors_have_the_number_of_their_joint(form):
    """By hand: G² I_r at its own joint, and I_r of the second, on the first link, with its own sign of turning."""
    equations = derive(tw.robots.planar_2r().with_actuators({"actuators": DRIVES}), form=form)
    M = equations.mass_matrix.subs(list(reversed(equations.definitions)))
    G1, G2, J1, J2 = sympy.symbols("G_1 G_2 I_r1zz I_r2zz")
    assert M[0, 0].coeff(J1) == G1**2
    assert sympy.expand(M[0, 2]) == -G2 * J2
    assert sympy.expand(M[2, 2]) == G2**2 * J2
    values = {p.name: p.value for p in equations.parameters}
    assert (values["G_1"], values["G_2"], values["I_r1zz"], values["I_r2zz"]) == (100.0, 50.0, 2e-5, 1e-4)
    assert not {"I_3zz", "I_4zz", "m_3", "m_4"} & set(values)


def test_gear_ratios_can_be_numbers():
    robot = tw.robots.planar_2r().with_actuators({"actuators": {"joint1": DRIVES["joint1"]}})
    assert "G₁² Iᵣ₁zz" in derive(robot, symbols=["gears", "inertias"]).text("mass_matrix")
    assert "10000 Iᵣ₁zz" in derive(robot, symbols=["inertias"]).text("mass_matrix")


# ── too large ──


def test_a_floating_base_written_out_is_refused_before_starting(monkeypatch):
    monkeypatch.setattr("twistwrench.symbolic.derivation.energies", lambda *_: pytest.fail("started"))
    with pytest.raises(ValueRangeError, match=r"18\s+coordinates; allowed.*form='expanded'"):
        derive(tw.robots.quadruped(), form="expanded")


# ── lines ──


def test_lines_break_before_plus_and_minus_outside_brackets_first():
    text = "m₁ cos(θ₁ + θ₂) + m₂ (a + b) x − m₃ (c − d) y"
    lines = break_lines(text, 24, text_width)
    assert lines == ["m₁ cos(θ₁ + θ₂)", "+ m₂ (a + b) x", "− m₃ (c − d) y"]
    assert break_lines("m₁ (a₁ + a₂ + a₃) x", 12, text_width) == ["m₁ (a₁ + a₂", "+ a₃) x"]
    assert break_lines("cos(θ₁ + θ₂)", 5, text_width) == ["cos(θ₁ + θ₂)"]  # never inside a function
    assert break_lines(r"\frac{a + b}{c} + d", 3, lambda x: float(len(x))) == [r"\frac{a + b}{c}", "+ d"]
    assert break_lines(r"\sin^{2}(a + b) + d", 3, lambda x: float(len(x))) == [r"\sin^{2}(a + b)", "+ d"]


def widths(latex: str) -> list[float]:
    """Of the rows of all displays, in points, measured by Matplotlib with the same fonts: left, equals sign and right."""
    pytest.importorskip("matplotlib")
    from matplotlib import rc_context
    from matplotlib.font_manager import FontProperties
    from matplotlib.mathtext import MathTextParser

    parser = MathTextParser("path")

    def measured(formula: str) -> float:
        if matrix := re.fullmatch(r"\\begin\{bmatrix\} (.*) \\end\{bmatrix\}", formula.strip()):
            return 21.0 + max(map(measured, matrix.group(1).split(r" \\ ")))
        with rc_context({"mathtext.fontset": "cm"}):
            text = formula.strip().replace(r"\tfrac", r"\frac")
            return float(parser.parse(f"${text}$", 72, FontProperties(size=10)).width) if text else 0.0

    found = []
    for block in re.findall(r"\\begin\{align\*\}\n(.*?)\n\\end\{align\*\}", latex, re.DOTALL):
        rows = [row.split("&", 1) for row in block.split("\\\\\n")]
        left = max(measured(row[0]) for row in rows)
        found += [left + measured(row[1].removeprefix("=")) + (13.4 if row[1].startswith("=") else 0) for row in rows]
    return found


@pytest.mark.parametrize("form", [pytest.param("expanded", marks=pytest.mark.slow), "named"])
def test_latex_stays_on_the_page(form):
    """170 mm of A4 are 482 points; lines break by the count of their symbols."""
    equations = derive(rrp(general=True), form=form)
    found = widths(equations.latex())
    assert len(found) > 72
    assert max(found) <= 482
    if form == "expanded":
        assert max(found) > 380  # and the page is used


def test_constants_that_are_expressions_are_factored_as_they_are():
    """Factors of a Lagrangian whose constants are not polynomials."""
    m, a, b, x, xdot = sympy.symbols("m a b x xdot")
    root = sympy.sqrt(a)
    system = lagrange(m * xdot**2 * (x + root + b) ** 2 / 2, x)
    assert sympy.expand(system.mass_matrix[0, 0] - m * (x + root + b) ** 2) == 0
    assert system.mass_matrix[0, 0].is_Mul
