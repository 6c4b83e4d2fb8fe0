"""The table of threats: every reader stands in it, every row has its test, and SECURITY.md is written from it."""

from __future__ import annotations

import ast
import sys
from functools import cache
from pathlib import Path

import pytest
from source_trees import syntax_nodes

import twistwrench as tw

SOURCE = Path(tw.__file__).parent
ROOT = SOURCE.parents[1]
if not (ROOT / "tools" / "threats.py").is_file():
    pytest.skip("the table is written by a tool of the source tree", allow_module_level=True)
sys.path.insert(0, str(ROOT / "tools"))
from threats import PAGE, page_with_threats, threats  # noqa: E402

TABLE = threats()
ROWS = TABLE["threat"]
OPENING = {
    "AnyReader", "File", "GzipFile", "NpzFile", "Open", "ParquetFile", "ZipFile", "connect", "dataset", "fromfile", "load_scene",
    "load_workbook", "loadmat", "loadtxt", "make_reader", "memmap", "open", "read_array", "read_bytes", "read_csv",
    "read_standard_input", "read_table", "read_text",
}  # fmt: skip
"""Functions and methods that open or decode files, of Python and of every library that the package uses."""


@cache
def names_in(file: str) -> set[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def opens(call: ast.Call) -> bool:
    """True for a call that opens or decodes a file; constructors of this package, such as MotionLog.open, ask another module."""
    function = call.func
    if isinstance(function, ast.Name):
        return function.id in OPENING
    if not isinstance(function, ast.Attribute):
        return False
    owner = ast.unparse(function.value)
    if (
        function.attr == "open"
        and not call.args
        and not call.keywords
        and owner.split(".")[-1] in ("closed", "robot", "self")
    ):
        return False  # Robot.open: the robot without its constraints
    if function.attr not in OPENING:
        return function.attr == "load" and owner in ("json", "np", "pickle", "tomllib", "trimesh", "yaml")
    writes = function.attr == "open" and any(
        isinstance(mode, ast.Constant) and str(mode.value) in ("wb", "w", "rb+", "ab")
        for mode in [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
    )
    return not writes and owner not in ("cls", "webbrowser", "MotionLog", "CsvFile", "JoinedFile", "page")


def test_every_module_that_opens_files_stands_in_the_table():
    known = {module for modules in TABLE["readers"].values() for module in modules} | set(TABLE["own"])
    found = set()
    for path in SOURCE.rglob("*.py"):
        calls = (node for node in syntax_nodes(path) if isinstance(node, ast.Call))
        if any(opens(call) for call in calls):
            found.add(path.relative_to(SOURCE).as_posix())
    assert found == known, f"not in the table: {sorted(found - known)}; opens no file: {sorted(known - found)}"


def test_every_format_has_threats_of_each_kind():
    there = {(name, row["kind"]) for row in ROWS for name in row["formats"]}
    wanted = {(name, kind) for name in TABLE["readers"] for kind in TABLE["kinds"]}
    assert there <= wanted, f"formats without a reader: {sorted(there - wanted)}"
    assert wanted <= there, f"no row: {sorted(wanted - there)}"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['formats'][0]}, {row['threat'][:40]}")
def test_the_test_of_every_row_exists(row):
    assert row.keys() == {"formats", "kind", "threat", "bound", "test"}
    file, _, name = row["test"].partition("::")
    assert (ROOT / file).is_file(), file
    assert name.rpartition("::")[2] in names_in(file), row["test"]


def test_the_page_on_security_is_written_from_the_table():
    page = PAGE.read_text(encoding="utf-8")
    assert page == page_with_threats(page), "run `python tools/threats.py`"
