"""docs/reading.md: its eight files are those that a torque passes through, and its lines stand in them."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

import twistwrench as tw

SOURCE = Path(tw.__file__).parent
PAGE = (ROOT / "docs" / "reading.md").read_text("utf-8")
ROWS = re.findall(r"^\| \d \| `([\w/.]+)` \|.*\| ([^|]+) \|$", PAGE, re.MULTILINE)
FUNCTIONS = {file: re.findall(r"`([\w.]+)`", names) for file, names in ROWS}
SECTIONS = re.findall(r"^## \d\. [^`]*`([\w/.]+)`\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL)
LINES_OF_AN_HOUR = 420
"""Lines that a reader takes in within an hour: seven a minute."""
FLOW = """
import sys
from pathlib import Path
import numpy as np
import twistwrench as tw

files = {}
root = str(Path(tw.__file__).parent)

def profile(frame, event, _):
    code = frame.f_code
    if event == "call" and code.co_name != "<module>" and code.co_filename.startswith(root):
        files.setdefault(Path(code.co_filename).relative_to(root).as_posix(), set()).add(code.co_qualname)

path = tw.robots.path_of("ur5")
sys.setprofile(profile)
tw.load(path).inverse_dynamics(np.zeros(6), np.zeros(6), np.zeros(6))
sys.setprofile(None)
for file, names in files.items():
    print(file, *names)
"""


def definitions(file: str) -> dict[str, ast.FunctionDef]:
    """Functions of a file by name, methods with their class."""
    found = {}
    for node in ast.parse((SOURCE / file).read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            found[node.name] = node
        if isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}.{method.name}": method for method in node.body if isinstance(method, ast.FunctionDef)
            }
    return found


def test_the_page_has_eight_files_each_with_a_section():
    assert len(FUNCTIONS) == 8 and [file for file, _ in SECTIONS] == list(FUNCTIONS)


@pytest.mark.parametrize(("file", "section"), SECTIONS, ids=[file for file, _ in SECTIONS])
def test_lines_of_the_page_stand_in_their_file(file, section):
    text = (SOURCE / file).read_text("utf-8")
    for excerpt in re.findall(r"^```python no-run\n(.*?)^```", section, re.MULTILINE | re.DOTALL):
        assert excerpt in text, f"{file} has changed; docs/reading.md shows\n{excerpt}"


def test_the_functions_can_be_read_in_an_hour():
    nodes = [definitions(file)[name] for file, names in FUNCTIONS.items() for name in names]
    assert sum(node.end_lineno - node.lineno + 1 for node in nodes) <= LINES_OF_AN_HOUR


def test_a_torque_of_a_robot_file_enters_each_function(tmp_path):
    """In a process of its own without a cache, from ``tw.load`` on."""
    pytest.importorskip("llvmlite")
    environment = {**os.environ, "TWISTWRENCH_CACHE_DIR": "off"}
    command = [sys.executable, "-W", "ignore", "-c", FLOW]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=True)
    entered = {line.split()[0]: line.split()[1:] for line in run.stdout.splitlines()}
    not_entered = {
        (file, name) for file, names in FUNCTIONS.items() for name in names if name not in entered.get(file, ())
    }
    assert not not_entered
