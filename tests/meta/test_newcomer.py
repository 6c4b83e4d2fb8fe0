"""A newcomer adds a file: a copy of the project with it passes the rules of structure, and tells all faults in one run."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

RULES = ("tests/meta/test_structure.py", "tests/meta/test_house.py", "tests/meta/test_paths.py")
BROKEN_RULES = (
    "tests/meta/test_structure.py::test_no_room_imports_from_a_room_above_or_beside_it",
    "tests/meta/test_structure.py::test_a_function_fits_a_screen",
    "tests/meta/test_structure.py::test_new_names_say_what_something_is",
    "tests/meta/test_paths.py::test_every_path_that_a_page_names_exists",
)
"""Those that the faulty files break."""
COPIED = ("src", "tests/meta", "tests/support", "tests/conftest.py")
"""What finds the project by its own place; all else of the copy is linked."""

READERS = "src/twistwrench/motion/readers"
READER = '''"""Motion logs of a maker's controller."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...core import arguments
from ...core.errors import RobotFileError
from ...core.numbers import printed
from ...core.text import listed
from ...core.typing import Array


def read_maker_log(path: Path, joints: int) -> Array:
    """Joint positions of a log, one row for each sample."""
    count = arguments.whole(joints, "joints")

    def rows() -> Iterator[list[Any]]:
        with path.open(newline="") as file:
            for row in csv.reader(file, delimiter=";"):
                if row and not row[0].startswith("#"):
                    yield row

    found = list(rows())
    short = [printed(k) for k, row in enumerate(found) if len(row) < count]
    if short:
        raise RobotFileError(
            f"{path.name} has rows with fewer than {count} numbers: {listed(short)}. Export the log again, with a column "
            "for each joint."
        )
    if not found:
        raise RobotFileError(f"{path.name} has no rows. Export the log again.")
    q = np.array([row[:count] for row in found], float)
    return np.deg2rad(q)
'''
FAULTY = (
    """from ...viz.page import show


def scrambled(x):
    show(x)
"""
    + "    x = x + 1\n" * 70
)
PAGE = "# Logs of a maker\n\n`nowhere/x.py` reads them.\n"


def linked(source: Path, target: Path) -> None:
    target.mkdir(exist_ok=True)
    for entry in source.iterdir():
        if not (target / entry.name).exists():
            (target / entry.name).symlink_to(entry)


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A copy of the project."""
    folder = tmp_path_factory.mktemp("project")
    for name in COPIED:
        source, target = ROOT / name, folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("*.pyc.*"))  # bytecode saves seconds
        else:
            shutil.copy(source, target)
    for name in ("tests", "docs", "."):
        linked(ROOT / name, folder / name)
    return folder


def run_rules(project: Path, files: dict[str, str], rules: tuple[str, ...] = RULES) -> subprocess.CompletedProcess[str]:
    """Rules on the copy with files of a newcomer, which are taken away again."""
    for name, text in files.items():
        (project / name).write_text(text, "utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *rules]
    environment = {**os.environ, "PYTHONPATH": f"{project / 'src'}", "COLUMNS": "200"}
    done = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True)
    for name in files:
        (project / name).unlink()
    return done


@pytest.mark.slow
def test_an_empty_file_and_one_of_a_function_are_green(project):
    done = run_rules(project, {f"{READERS}/maker_log.py": READER, f"{READERS}/maker_units.py": ""})
    assert done.returncode == 0, done.stdout


def test_faults_are_told_in_one_run_with_their_remedies(project):
    told = run_rules(project, {f"{READERS}/maker_log.py": FAULTY, "docs/maker.md": PAGE}, BROKEN_RULES).stdout

    for fault, remedy in [
        ("motion/readers/maker_log.py -> viz/page.py", "Move the function down, or call it from doors.py"),
        ("'motion/readers/maker_log.py:scrambled': 72", "Name a part that is a step of its own, and call it"),
        ("maker.md names ['nowhere/x.py']", "Correct the name, or take it from the page"),
        ("UserWarning: `scrambled`", "what does it return or bound?"),
    ]:
        assert fault in told and remedy in told, told
