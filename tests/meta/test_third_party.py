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


@pytest.mark.parametrize("notice", ["Copyright (c)", "SPDX-License-Identifier", "Licensed under"])
def test_files_with_a_notice_of_others_are_in_the_table(notice):
    suffixes = (".py", ".js", ".css", ".html", ".urdf", ".xml", ".c", ".h")
    found = [
        path for path in sorted(PACKAGE.rglob("*")) if path.suffix in suffixes and notice in path.read_text("utf-8")
    ]
    assert [str(path.relative_to(ROOT)) for path in found if str(path.relative_to(ROOT)) not in TEXT] == []
