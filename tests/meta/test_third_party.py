"""THIRD_PARTY.md names files that exist, and each file of the package with a notice of others."""

from __future__ import annotations

import re

import pytest
from places import ROOT

TEXT = (ROOT / "THIRD_PARTY.md").read_text("utf-8")
PACKAGE = ROOT / "src" / "twistwrench"


def test_every_place_in_the_table_exists():
    places = re.findall(r"`(src/[^`]+)`", TEXT)
    assert len(places) >= 4
    assert all((ROOT / place).exists() for place in places)


SOURCES = {
    path: found
    for path in sorted(PACKAGE.rglob("*"))
    if path.suffix in (".urdf", ".xml", ".yaml", ".csv", ".json", ".toml")
    and (found := re.search(r"Source of the figures: [^()]*package (\w+) \(([\w.-]+)\)", path.read_text("utf-8")))
}
"""Files that name the package of others from which their figures are."""


def test_rows_have_the_source_and_the_licence_that_the_files_name():
    rows = {path: row for row in TEXT.splitlines() for path in re.findall(r"`(src/[^`]+)`", row)}
    assert {path.stem for path in SOURCES} == {"panda", "quadruped", "ur5"}
    for path, (package, licence) in ((path, found.groups()) for path, found in SOURCES.items()):
        row = rows.get(path.relative_to(ROOT).as_posix(), "")
        assert f"`{package}`" in row and row.rstrip(" |").endswith(licence), f"{path.name}: {package}, {licence}"


def test_every_row_names_its_place_and_every_robot_is_our_own_or_has_a_row():
    rows = [line for line in TEXT.splitlines() if line.startswith("| ")][2:]
    assert all(re.search(r"`src/[^`]+`", row) and row.count("|") == 5 for row in rows)
    own = {"cart_pole", "floating_box", "pendulum", "planar_2r", "planar_3r"}  # the book's, and mechanisms of textbooks
    assert {path.stem for path in PACKAGE.rglob("*.urdf")} == own | {path.stem for path in SOURCES}


@pytest.mark.parametrize("notice", ["Copyright (c)", "SPDX-License-Identifier", "Licensed under"])
def test_files_with_a_notice_of_others_are_in_the_table(notice):
    suffixes = (".py", ".js", ".css", ".html", ".urdf", ".xml", ".c", ".h")
    found = [
        path for path in sorted(PACKAGE.rglob("*")) if path.suffix in suffixes and notice in path.read_text("utf-8")
    ]
    assert [str(path.relative_to(ROOT)) for path in found if str(path.relative_to(ROOT)) not in TEXT] == []
