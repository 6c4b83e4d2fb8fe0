"""First lines of strangers, in Python and in the shell, lead to what exists: the table, its hints and its page."""

from __future__ import annotations

import importlib.util
import re
import shlex
import tomllib
from functools import cache, reduce
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from places import ROOT

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.first_calls import first_calls, missing_attribute, plain_text
from twistwrench.robot.quantities import QUANTITIES

WANTED = tomllib.loads(Path(__file__).with_name("wanted.toml").read_text(encoding="utf-8"))
NOT_THERE_YET: set[str] = set()
"""Functions that the table names before they exist. A function that exists is taken off."""
ROWS = first_calls()
LONGEST = 200
"""Most letters of a message."""
NAME = re.compile(r"\b(?:tw|robot)(?:\.[A-Za-z_]\w*)+")
STATE = np.array([0.1, -1.0, 1.0, 0.2, 0.3, 0.0])


@cache
def meanings() -> dict[str, object]:
    """Values of the names of the lines in Python."""
    robot = tw.robots.ur5()
    return {
        "tw": tw, "r": robot, "p": "arm.urdf", "c": "demo", "g": (0, 0, -1.6), "T": robot.forward_kinematics(STATE),
        "q": STATE, "dq": STATE, "v": STATE, "a": STATE, "tau": STATE, "com": (0, 0, 0.1), "I": np.eye(3),
        "m": tw.Motion(np.linspace(0, 1, 11), np.outer(np.linspace(0, 1, 11) ** 2, STATE), robot=robot),
    }  # fmt: skip


def answer(line: str) -> str:
    """Type and text of the error of a line, or "works"."""
    try:
        eval(line, dict(meanings()))
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "works"


@pytest.mark.parametrize(("line", "wanted"), WANTED["python"], ids=[line for line, _ in WANTED["python"]])
def test_a_first_line_in_python_works_or_leads_to_what_does(line, wanted):
    found = answer(line)
    assert wanted in found
    assert len(found) <= LONGEST + len("AttributeError: ") or "NotFoundError" in found
    assert "\n" not in found
    assert "Methods." not in found


@pytest.fixture
def other(tmp_path):
    """Limits of another robot."""
    path = tmp_path / "other.csv"
    path.write_text("joint,effort\nhip_of_another,10\n")
    return str(path)


@pytest.mark.parametrize(("line", "wanted"), WANTED["shell"], ids=[line for line, _ in WANTED["shell"]])
def test_a_first_line_in_the_shell_works_or_leads_to_what_does(line, wanted, other, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, shlex.split(line.replace("{other}", other)))
    if wanted == "works":
        assert done.exit_code in (0, 1), done.output
        return
    assert wanted in " ".join(done.output.split())
    assert done.exit_code == 2
    assert done.output.count("\n") == 1


def exists(name: str) -> bool:
    """True if a dotted name, from ``tw`` or ``robot`` on, exists."""
    first, *others = name.split(".")
    try:
        reduce(getattr, others, tw if first == "tw" else tw.robots.ur5())
    except AttributeError:
        return False
    return True


def names_used() -> set[str]:
    return {name for row in ROWS for name in NAME.findall(f"{row.use} {row.differs}")}


def test_a_hint_names_nothing_that_does_not_exist():
    missing = {name for name in names_used() if not exists(name)}
    assert missing <= NOT_THERE_YET, missing - NOT_THERE_YET
    assert not (there := NOT_THERE_YET - missing), f"take these from NOT_THERE_YET: {there}"


def test_commands_options_and_quantities_of_hints_exist():
    commands = {word for row in ROWS for word in re.findall(r"twistwrench ([a-z]+)", row.use + row.differs)}
    assert commands - {"robots"} <= set(main.list_commands(None)) - {"robots"}
    known = {
        name
        for command in main.list_commands(None)
        for param in main.get_command(None, command).params
        for name in (*param.opts, *param.secondary_opts)
    }
    options = [row.use.split()[0] for row in ROWS if "option" in row.where]
    assert {option for option in options if option.startswith("--")} <= known
    asked = {name for row in ROWS for name in re.findall(r'robot\.kernel\("(\w+)"', row.use)}
    assert asked | {row.quantity for row in ROWS} - {""} <= {*QUANTITIES, *dir(tw.Robot)}


def test_a_missing_name_is_no_name_that_exists():
    places = {"robot": tw.Robot, "module": tw, "motion": tw.Motion, "inertia": tw.SpatialInertia}
    there = [
        (place, word) for row in ROWS for place in row.where if place in places
        for word in row.words if word in dir(places[place])
    ]  # fmt: skip
    assert there == []


def test_a_name_stands_once_at_a_place():
    keys = [(place, word, row.only) for row in ROWS for place in row.where if place != "page" for word in row.words]
    twice = {key for key in keys if keys.count(key) > 1 and key[0] != "option"}
    assert not twice


def test_every_hint_is_one_line_of_at_most_200_letters():
    for row in ROWS:
        for word in row.words:
            text = str(missing_attribute("module 'twistwrench'", word, row.where[0], []))
            assert len(text) <= LONGEST and "\n" not in text and "`" not in text, text
            assert "(guess)" not in text, text


def test_all_functions_of_the_book_have_a_row():
    words = {word for row in ROWS if row.of == "modern_robotics" for word in row.words}
    assert words == set(tw.modern_robotics.__all__)


def test_the_table_of_the_page_equals_the_data():
    spec = importlib.util.spec_from_file_location("first_calls_page", ROOT / "docs" / "first_calls.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = module.PAGE.read_text(encoding="utf-8")
    assert module.page(text) == text, "run python docs/first_calls.py"
    assert all(plain_text(row.use) in plain_text(text) for row in ROWS if row.of in ("Pinocchio", "Drake"))


def test_the_table_is_read_only_when_a_name_is_missing(tmp_path):
    import subprocess
    import sys

    code = (
        "import sys, twistwrench as tw; r = tw.robots.ur5(); r.gravity_forces(r.neutral); r.momentum(r.neutral, r.neutral, 'com')\n"
        "tw.Motion, tw.SpatialInertia; print('twistwrench.core.first_calls' in sys.modules, hasattr(r, 'rnea'))\n"
        "print('twistwrench.core.first_calls' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False", "True"]
