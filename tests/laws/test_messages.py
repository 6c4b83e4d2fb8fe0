"""Messages of the library name arguments of functions; the shell spells them as options."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import twistwrench
from twistwrench.core.errors import TrajectoryError, ValueRangeError
from twistwrench.core.text import Argument, Placeholder, spelled

PACKAGE = Path(twistwrench.__file__).parent
STILL_TYPED = {
    "answers/sentences.py",
    "calibration/measurements.py",
    "compiler/printers/cuda.py",
    "core/files.py",
    "core/text.py",
    "formats/xacro/__init__.py",
    "identification/consistent.py",
    "identification/diagnosis.py",
    "motion/column_names.py",
    "motion/contradictions.py",
    "motion/coordinates.py",
    "motion/load_case.py",
    "motion/model_doubts.py",
    "motion/motion_io.py",
    "motion/readers/csv_reader.py",
    "motion/readers/ros_recordings.py",
    "reports/robot_summary.py",
    "reports/torque_verdict.py",
    "robot/export/structured_text.py",
    "sensing/files.py",
    "simulation/judgement.py",
    "sizing/sizing.py",
    "statics/payload_report.py",
    "statics/torque_limits.py",
    "trajectories/limit_rows.py",
    "trajectories/move_view.py",
    "viz/movie.py",
    "viz/plots/torques.py",
    "viz/section_pages.py",
    "viz/style.py",
}
"""Files whose sentences still have an option; this set may only shrink."""


def options_in(path):
    """Texts of a file with an option, without docstrings."""
    tree = ast.parse(path.read_text("utf-8"))
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
    assert found - STILL_TYPED == set(), "name the argument: Argument of core/text.py"
    assert STILL_TYPED - found == set(), "free of options now: take it out of the set"


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
    assert (spelled(argument), spelled(argument, shell=True)) == (python, shell)


def test_an_error_speaks_python_and_the_shell_asks_for_its_own_words():
    import pickle

    error = TrajectoryError(
        "log.csv: several episodes. Choose one: {0}, or all: {1}.", Argument("episode", 2), Argument("all", True)
    )
    for one in (error, pickle.loads(pickle.dumps(error))):
        assert str(one) == "log.csv: several episodes. Choose one: episode=2, or all: all=True."
        assert one.in_shell() == "log.csv: several episodes. Choose one: --episode 2, or all: --all."
    assert str(ValueRangeError("braces {0} of a name stay")) == "braces {0} of a name stay"
