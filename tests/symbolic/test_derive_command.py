"""``twistwrench derive``: what it prints, what it writes, and what it refuses."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import text_width


def derive(*arguments):
    return CliRunner().invoke(main, ["derive", *map(str, arguments)])


def test_prints_the_books_equations_and_the_check():
    result = derive("planar_2r")
    assert result.exit_code == 0, result.output
    assert result.output.startswith("DONE: equations of motion of planar_2r, 2 joints, 5 symbols with values;")
    words = " ".join(result.output.split())
    assert "(m₁ + m₂) L₁ g cos(θ₁) + m₂ L₂ g cos(θ₁ + θ₂)" in words
    assert "M₁₂ = m₂ (L₁ L₂ cos(θ₂) + L₂²)" in words
    assert "checked against Newton–Euler" in words
    assert "Positions" not in words  # the terms and the equations; steps on request


def test_steps_can_be_chosen():
    assert "K₁ = ½ m₁ L₁² θ̇₁²" in derive("planar_2r", "--steps", "kinetic_energies").output
    every = derive("planar_2r", "--steps", "all").output
    assert all(word in every for word in ("Positions", "Momenta", "Christoffel", "Equations of motion"))
    refused = derive("planar_2r", "--steps", "kinetic")
    assert refused.exit_code == 2
    assert "kinetic_energies" in refused.stderr


def test_writes_every_file_whole(tmp_path):
    names = {"--latex": "arm.tex", "--html": "arm.html", "--markdown": "arm.md", "--c": "arm.c", "--numpy": "arm.py"}
    options = [part for option, name in names.items() for part in (option, tmp_path / name)]
    result = derive("cart_pole", *options)
    assert result.exit_code == 0, result.output
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names.values())  # no scratch files left
    assert (tmp_path / "arm.tex").read_text("utf-8").rstrip().endswith(r"\end{document}")
    assert "</html>" in (tmp_path / "arm.html").read_text("utf-8")
    assert "#include <math.h>" in (tmp_path / "arm.c").read_text("utf-8")
    compile((tmp_path / "arm.py").read_text("utf-8"), "arm.py", "exec")
    for name in names.values():
        assert f"wrote {tmp_path / name}" in result.output


def test_a_dash_prints_the_text_and_nothing_else():
    result = derive("pendulum", "--latex", "-")
    assert result.exit_code == 0
    assert result.stdout.startswith(r"\documentclass")
    assert result.stdout.rstrip().endswith(r"\end{document}")
    both = derive("pendulum", "--latex", "-", "--c", "-")
    assert both.exit_code == 2
    assert "--latex - and --c -" in both.stderr


def test_numbers_in_place_of_symbols():
    assert "19.62 cos(θ₁) + 9.81 cos(θ₁ + θ₂)" in derive("planar_2r", "--symbols", "none").output
    assert "9.81 (m₁ + m₂) cos(θ₁)" in derive("planar_2r", "--symbols", "masses").output


def test_robot_options_are_those_of_all_commands():
    result = derive(
        "ur5", "--lock", "wrist_1_joint=0", "--lock", "wrist_2_joint=0", "--lock", "wrist_3_joint=0", "--all"
    )
    assert result.exit_code == 0
    assert "cos²(θ₂ + θ₃)" in result.output


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("planar_2r", "--symbols", "L_7"), ("L_7", "L_1", "masses")),
        (("panda", "--form", "expanded"), ("too large", "form", "lock")),
        (("planar_2r", "--latex", "nowhere/arm.tex"), ("nowhere", "folder")),
        (("planar_2r", "--c", "."), ("folder",)),
        (("planar_2r", "--c", "a.c", "--numpy", "a.c"), ("--numpy", "overwrite", "--c")),
        (("nobody",), ("nobody", "twistwrench robots")),
    ],
)
def test_bad_input_is_one_line(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = derive(*arguments)
    assert result.exit_code == 2
    assert len(result.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in result.stderr
    assert not list(tmp_path.iterdir())


def test_unwritable_output_is_refused_before_deriving(tmp_path, monkeypatch):
    monkeypatch.setattr("twistwrench.cli.derive.derive", lambda *_, **__: pytest.fail("derived"))
    assert derive("planar_2r", "--html", tmp_path / "no" / "arm.html").exit_code == 2


def test_input_file_is_not_overwritten(tmp_path):
    import twistwrench as tw

    copy = tmp_path / "arm.urdf"
    copy.write_bytes(tw.robots.path_of("planar_2r").read_bytes())
    result = derive(copy, "--latex", copy)
    assert result.exit_code == 2
    assert "ROBOT" in result.stderr


def test_without_sympy_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    result = derive("planar_2r")
    assert result.exit_code == 2
    assert "'.[symbolic]'" in result.stderr


def test_step_names_take_hyphens():
    assert derive("planar_2r", "--steps", "mass-matrix").output == derive("planar_2r", "--steps", "mass_matrix").output


@pytest.mark.parametrize("columns", [60, 80, 200])
def test_lines_are_as_wide_as_said_and_break_before_plus_and_minus(columns, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = derive("planar_3r", "--steps", "all").output.splitlines()
    assert max(map(text_width, lines)) <= columns
    assert not [line for line in lines[2:] if line != line.rstrip()]
    start = next(k for k, line in enumerate(lines) if line.startswith("Equations of motion:"))
    goes_on = [line.strip() for line in lines[start + 1 :] if line.startswith("    ")]
    assert all(line.startswith(("+ ", "− ")) for line in goes_on)
    assert len(goes_on) > 5


def test_lines_are_eighty_wide_in_a_pipe(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr("os.get_terminal_size", lambda *_: (_ for _ in ()).throw(OSError("no terminal")))
    widest = max(map(text_width, derive("planar_3r", "--steps", "equations").output.splitlines()))
    assert 70 < widest <= 80


def test_friction_left_out_is_said(tmp_path):
    text = tw.robots.path_of("planar_2r").read_text("utf-8").replace("<axis", '<dynamics damping="0.5"/><axis')
    assert text.count("damping") == 2
    (tmp_path / "rough.urdf").write_text(text, "utf-8")
    pages = ("--markdown", tmp_path / "rough.md", "--c", tmp_path / "rough.c")
    result = derive(tmp_path / "rough.urdf", "--symbols", "none", *pages)
    assert "! Friction is left out" in result.stdout
    assert "joint1" in result.stdout
    for name in ("rough.md", "rough.c"):
        assert "Friction is left out of these equations" in (tmp_path / name).read_text("utf-8")
    assert "riction" not in derive("planar_2r").output


def test_friction_of_a_planar_joint_is_said_once():
    """It has three velocities, each with friction, and is one joint."""
    inertial = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    robot = tw.load(
        f"""<robot name="table"><link name="base"/><link name="puck">{inertial}</link><joint name="glide" type="planar">
        <parent link="base"/><child link="puck"/><axis xyz="0 0 1"/><dynamics damping="0.4"/></joint></robot>"""
    )
    assert tw.symbolic.derive(robot).remarks == (
        "Friction is left out of these equations; the robot has some at glide.",
    )


@pytest.mark.parametrize(
    ("robot", "settings", "options"),
    [
        ("planar_2r", {}, ()),
        ("cart_pole", {"symbols": "none"}, ("--symbols", "none")),
        ("planar_2r", {"steps": ["mass_matrix"], "form": "named"}, ("--steps", "mass_matrix", "--form", "named")),
        ("planar_3r", {"symbols": ["masses"]}, ("--symbols", "masses")),
    ],
)
def test_function_and_command_give_the_same_answer(robot, settings, options, tmp_path):
    answer, file = tw.derive(robot, **settings), tmp_path / "answer.json"
    printed = derive(robot, *options, "--json", file)
    assert printed.exit_code == answer.verdict.exit_code
    assert printed.stdout.splitlines()[0].startswith(answer.headline.split(";")[0])
    data, own = json.loads(file.read_text("utf-8")), answer.to_dict()
    assert {key: data[key] for key in own} == json.loads(json.dumps(own))


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["ur5", "panda"])
def test_a_long_derivation_is_a_table_of_its_steps(robot):
    lines = derive(robot).output.splitlines()
    assert len(lines) <= 45
    words = " ".join(lines)
    assert "Christoffel symbols" in words
    assert "lines of symbols and steps: --all" in words
    answer = tw.derive(robot)
    assert [row["step"] for row in answer.tables["Steps"].rows()][-1] == "Equations of motion"
    assert len(derive(robot, "--all").output.splitlines()) > 700
    assert "checked against" in answer.to_json()


def test_the_terms_of_a_step_are_those_of_all_its_entries():
    """A slide that carries one along (0.6, 0.8): M_11 = m_1 + m_2, M_12 = 0.6 m_2, M_22 = m_2, four terms in three entries."""
    builder = tw.ModelBuilder("gantry")
    builder.add_link("base")
    for parent, link, axis in (("base", "bridge", [1, 0, 0]), ("bridge", "trolley", [0.6, 0.8, 0])):
        builder.add_link(link, tw.SpatialInertia.from_com(2.0, [0, 0, 0], np.eye(3)))
        builder.add_joint(f"to {link}", "prismatic", parent, link, axis=axis)
    rows = tw.derive(tw.Robot(builder.build()), symbols="masses").tables["Steps"].rows()
    (mass_matrix,) = [row for row in rows if row["step"] == "Mass matrix"]
    assert (mass_matrix["entries"], mass_matrix["terms"]) == (3, 4)


def test_equations_that_disagree_are_not_written(tmp_path, monkeypatch):
    right = tw.derive("pendulum")
    wrong = replace(right, check=replace(right.check, mass_matrix=1e-3))
    monkeypatch.setattr("twistwrench.cli.derive.derive", lambda *_, **__: wrong)
    result = derive("pendulum", "--c", tmp_path / "pendulum.c")
    assert result.exit_code == 1
    assert result.output.startswith("LOOK AGAIN: the equations disagree with Newton–Euler by 1.0e-03")
    assert not list(tmp_path.iterdir())
    page = wrong.to_html(tmp_path / "page.html").read_text("utf-8")
    assert "LOOK AGAIN" in page
    assert "Mass matrix" in page
