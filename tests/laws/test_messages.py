"""Messages of the library name arguments of functions; the shell spells them as options."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import twistwrench
import twistwrench as tw
from twistwrench.core.errors import TrajectoryError, ValueRangeError
from twistwrench.core.text import Argument, Placeholder, spell

PACKAGE = Path(twistwrench.__file__).parent
OTHER_PROGRAMS = {
    "compiler/printers/cuda.py",
    "core/text.py",
    "motion/readers/csv_reader.py",
    "viz/article.py",
}
"""Files with options of other programs, the place that spells options, and a page that shows a command to type."""


def options_in(path):
    """Texts of a file with an option, without docstrings."""
    source = path.read_text("utf-8")
    if "--" not in source:
        return []
    tree = ast.parse(source)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docs = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and isinstance(node.body[0], ast.Expr)
    }
    docs |= {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return [node.value for node in texts if id(node) not in docs and "--" in node.value and any(
        part[:1].isalpha() for part in node.value.split("--")[1:]
    )]  # fmt: skip


def test_no_sentence_of_the_library_has_an_option_of_the_shell():
    found = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if options_in(path)}
    found = {name for name in found if not name.startswith("cli/")}
    assert found == OTHER_PROGRAMS, "name the argument: Argument of core/text.py"


@pytest.mark.parametrize(
    ("argument", "python", "shell"),
    [
        (Argument("limits", "my limits.csv"), "limits='my limits.csv'", "--limits 'my limits.csv'"),
        (Argument("lock", {"a": 0, "b": 1.5}), "lock={'a': 0, 'b': 1.5}", "--lock a=0,b=1.5"),
        (Argument("columns", {"a": 'x, "y"'}), "columns={'a': 'x, \"y\"'}", '--columns \'a="x, ""y"""\''),
        (Argument("wrench_on_robot"), "wrench_on_robot=…", "--wrench-on-robot"),
        (Argument("friction", False), "friction=False", "--no-friction"),
        (Argument("degrees", True), "degrees=True", "--degrees"),
        (Argument("chain", ("base", "tool0")), "chain=('base', 'tool0')", "--chain base tool0"),
        (Argument("rate", Placeholder("HZ")), "rate=HZ", "--rate HZ"),
    ],
)
def test_one_rule_spells_an_argument_in_python_and_in_the_shell(argument, python, shell):
    assert (spell(argument), spell(argument, shell=True)) == (python, shell)


def test_an_error_speaks_python_and_the_shell_asks_for_its_own_words():
    import pickle

    error = TrajectoryError(
        "log.csv: several episodes. Choose one: {0}, or all: {1}.", Argument("episode", 2), Argument("all", True)
    )
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert str(one) == "log.csv: several episodes. Choose one: episode=2, or all: all=True."
        assert one.in_shell() == "log.csv: several episodes. Choose one: --episode 2, or all: --all."
    assert str(ValueRangeError("braces {0} of a name stay")) == "braces {0} of a name stay"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("payload quadruped --fixed-base", "must be named: --frame FL_foot"),
        ("move planar_2r --to 1,0.5 --fastest --duration 2", "--fastest computes the duration, and --duration sets it"),
        ("move planar_2r", "Give --to for the joints, or --by for the tip"),
        ("move planar_2r --from 1,2,3 --to 1,0.5", "--from '1,2,3'"),
        ("info ur5 --keep arm", "--keep arm is of MJCF files"),
        ("payload ur5 --samples 9", "--samples is about the map, and there is none. Add --map rz"),
        (
            "export planar_2r --st a.st --style codesys --quantity mass_matrix",
            "--style codesys writes inverse_dynamics alone",
        ),
        ("convert planar_2r old.xml", "or --overwrite."),
        ("simulate planar_2r --duration 1 --srdf x", "--srdf leaves out pairs of links for --clearance"),
    ],
)
def test_the_shell_hears_of_options_and_python_of_arguments(words, said, tmp_path, monkeypatch):
    from click.testing import CliRunner

    from twistwrench.cli.main import main

    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.xml").write_text("old")
    done = CliRunner().invoke(main, words.split())
    assert done.exit_code == 2 and said in done.stderr, done.stderr
    assert "=…" not in done.stderr


def test_sentences_of_a_verdict_are_those_of_the_caller():
    """A robot without limits: Python names the argument and the function, the shell the option and the command."""
    from twistwrench.core.text import words_of_the_shell

    def reason():
        return tw.payload("planar_2r").verdict.reasons[0]

    assert reason().endswith(
        "tw.info('planar_2r').to_csv('limits.csv'), fill in its efforts, and add limits='limits.csv'"
    )
    with words_of_the_shell():
        assert reason().endswith(
            "'twistwrench info planar_2r --csv limits.csv', fill in its efforts, and add --limits limits.csv"
        )
