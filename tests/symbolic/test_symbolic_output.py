"""What derivations are printed as and turned into: LaTeX, Markdown, a page, NumPy and C."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
import sympy
from quick import mostly_slow

import twistwrench as tw
from twistwrench.core.errors import ValueRangeError
from twistwrench.symbolic import derive, lagrange
from twistwrench.testing import assert_close

FUNCTIONS = {
    "inverse_dynamics": ("q", "dq", "ddq"),
    "bias_forces": ("q", "dq"),
    "mass_matrix": ("q",),
    "coriolis_forces": ("q", "dq"),
    "coriolis_matrix": ("q", "dq"),
    "gravity_forces": ("q",),
}


def states(robot, count=10):
    return dict(zip(("q", "dq", "ddq"), np.random.default_rng(11).uniform(-2, 2, (3, count, robot.nv)), strict=True))


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("name", mostly_slow(["planar_2r", "cart_pole", "ur5"], 3))
def test_c_compiles_without_a_warning_and_equals_the_kernels(name, tmp_path):
    """Round-off of both sides: 1e-13 of the largest entry; 1e-12 of the torque where gravity and inertia cancel."""
    robot = getattr(tw.robots, name)()
    equations = derive(robot)
    source, library = tmp_path / "arm.c", tmp_path / "arm.so"
    source.write_text(equations.c_source("arm"), encoding="utf-8")
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Wpedantic", "-Wmissing-prototypes", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, str(source), "-o", str(library), "-lm"], check=True)
    code, given = ctypes.CDLL(str(library)), states(robot)
    p = np.array([p.value for p in equations.parameters])
    assert np.array_equal(np.ctypeslib.as_array((ctypes.c_double * len(p)).in_dll(code, "arm_parameters")), p)
    torque = np.abs(robot.inverse_dynamics(*given.values())).max()
    pointer = ctypes.POINTER(ctypes.c_double)
    for function, arrays in FUNCTIONS.items():
        wanted = getattr(robot, function)(*(given[a] for a in arrays))
        found = np.empty_like(wanted)
        for k in range(len(wanted)):
            rows = [np.ascontiguousarray(given[a][k]) for a in arrays]
            out = np.full(wanted[k].size, np.nan)
            getattr(code, f"arm_{function}")(*(a.ctypes.data_as(pointer) for a in (*rows, p, out)))
            found[k] = out.reshape(wanted[k].shape)
        assert_close(found, wanted, 1e-13, function, scale=None if function == "mass_matrix" else torque)


def test_c_has_no_allocation_and_only_math_h():
    source = derive(tw.robots.planar_3r()).c_source()
    assert re.findall(r"#include.*", source) == ["#include <math.h>"]
    assert "alloc" not in source
    assert re.search(r"void planar_3r_inverse_dynamics\(const double q\[3\]", source)
    with pytest.raises(ValueRangeError, match="prefix='2r'"):
        derive(tw.robots.planar_2r()).c_source("2r")


@pytest.mark.parametrize("name", ["planar_2r", "ur5"])
def test_numpy_equals_the_kernels_and_broadcasts(name):
    robot = getattr(tw.robots, name)()
    equations, given = derive(robot), states(robot)
    torque = np.abs(robot.inverse_dynamics(*given.values())).max()
    for function, arrays in FUNCTIONS.items():
        chosen = [given[a] for a in arrays]
        found = equations.function(function)(*chosen)
        wanted = getattr(robot, function)(*chosen)
        assert_close(found, wanted, 1e-13, function, scale=None if function == "mass_matrix" else torque)
        assert equations.function(function)(*(a[3] for a in chosen)).shape == wanted.shape[1:]
    q, dq, ddq = given.values()
    one = equations.function("inverse_dynamics")(q[:, None], dq[0], ddq[None, :3])
    assert one.shape == (len(q), 3, robot.nv)


def test_parameters_can_be_changed_in_the_source():
    robot = tw.robots.planar_2r()
    equations, given = derive(robot), states(robot)
    values = {p.name: p.value for p in equations.parameters} | {"m_2": 3.0}
    heavier = robot.with_payload(tw.SpatialInertia.from_com(2.0), "tip")
    assert_close(
        equations.function("inverse_dynamics")(*given.values(), values),
        heavier.inverse_dynamics(*given.values()),
        1e-13,
    )


def test_source_says_which_shape_it_wants():
    with pytest.raises(ValueError, match=r"dq has shape \(3,\), wanted \(\.\.\., 2\)"):
        derive(tw.robots.planar_2r()).function("coriolis_forces")([0.0, 0.0], [0.0, 0.0, 0.0])


def test_names_from_robot_files_are_harmless():
    """Names with quotes, ends of comments, tags and TeX commands, in all outputs."""
    rude = """a"b*/ </math>\\end{document} $x_1^2$ \\ 'c' #"""
    text = (
        tw.robots.path_of("pendulum")
        .read_text("utf-8")
        .replace('"hinge"', '"' + rude.replace('"', "&quot;").replace("<", "&lt;") + '"')
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(text)
    equations = derive(robot)
    assert rude in equations.meanings[0][1]
    compile(equations.numpy_source(), "pendulum.py", "exec")
    code = equations.c_source()
    assert code.count("*/") == code.count("/*")
    assert equations.html().count("</math>") == equations.html().count("<math>")
    assert equations.latex().count("\\end{document}") == 1


def test_names_that_languages_reserve_are_avoided():
    """A constant called g beside the gravity vector g, and one called double, in a source that still runs."""
    q, qdot, double, g = sympy.symbols("q qdot double g")
    made = lagrange(double * qdot**2 / 2 - g * q, q)
    assert made.function("inverse_dynamics")([1.0], [0.0], [2.0], {"double": 3.0, "g": 4.0}).tolist() == [10.0]
    assert "const double double =" not in made.c_source()


@pytest.mark.parametrize("name", ["planar_2r", "ur5"])
def test_page_is_whole_and_needs_no_network(name):
    page = derive(getattr(tw.robots, name)(), symbols="all").html()
    assert page.startswith("<!doctype html>")
    assert page.rstrip().endswith("</html>")
    assert "http" not in page.replace("http-equiv", "")
    assert "<script" not in page
    formulas = re.findall(r"<math>.*?</math>", page, re.DOTALL)
    assert len(formulas) > 30
    for formula in formulas:
        ElementTree.fromstring(formula)  # well formed


def test_page_shows_the_books_terms():
    page = derive(tw.robots.planar_2r()).html("equations")
    text = re.sub(r"<mspace[^>]*>", " ", page)
    text = re.sub(r"<[^>]+>", "", text)
    assert "cos(θ2)" in text
    assert "cos(θ1+θ2)" in text
    assert "(m1+m2) L1 g cos(θ1)" in text.replace("−", "-")


def test_latex_is_balanced():
    for robot in (tw.robots.planar_2r(), tw.robots.ur5()):
        latex = derive(robot).latex()
        assert latex.count("{") == latex.count("}")
        assert latex.count("\\begin{") == latex.count("\\end{")
        assert latex.count("$") % 2 == 0
        assert latex.isascii()  # older LaTeX refuses the rest


def test_sympy_is_imported_by_those_who_need_it():
    code = "import sys, twistwrench as tw, twistwrench.cli.main; tw.symbolic; assert 'sympy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_markdown_has_formulas_between_dollars():
    page = derive(tw.robots.planar_2r()).markdown()
    assert page.count("$$") % 2 == 0
    assert r"\cos(\theta_{1} + \theta_{2})" in page
    assert page.startswith("# Equations of motion of planar_2r")


def test_long_sums_break_into_lines():
    longest = max(len(line) for line in derive(tw.robots.ur5()).latex().splitlines())
    assert longest < 1200


def test_check_is_stated_wherever_it_is_printed():
    arm = derive(tw.robots.planar_2r())
    for text in (arm.latex(), arm.markdown(), arm.html(), arm.c_source(), arm.numpy_source()):
        assert "hecked against Newton" in text


def test_brackets_of_matrices_need_no_font(tmp_path):
    """Stretched brackets are short on systems without a mathematical font; the page draws its own."""
    page = tw.symbolic.derive(tw.robots.planar_2r()).html()
    style, body = page.split("</style>")
    assert "mtable.matrix" in style and "border-width: 0 1.5px" in style
    assert body.count("<mtable") == body.count('<mtable class="matrix">') > 0
    assert "<mo>[</mo>" not in body
