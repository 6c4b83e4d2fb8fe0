"""Files and folders that documents name are there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from places import ROOT

PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
NAMED = re.compile(r"`([\w.-]+(?:/[\w.*-]+)*(?:/|\.(?:py|toml|yml|yaml|txt|md|c|js|css|html|urdf|csv|ipynb)))`")
"""A path in back quotes: with a folder, or a folder that ends in a stroke."""
SETTINGS = re.compile(r"(?:src|tests|docs|tools|bench|examples|notebooks)/[\w./*-]+")
HOMES = (ROOT, ROOT / "src" / "twistwrench", ROOT / "tests", ROOT / "docs")
ELSEWHERE = {
    "xla/ffi/api/c_api.h", "meta/info.json", "build/site/index.html",
}  # fmt: skip
"""Files of other programs by their own names, and one that `make docs` writes."""


def names_of(page: Path) -> Iterator[str]:
    text = page.read_text(encoding="utf-8")
    for name in SETTINGS.findall(text) if page.suffix == ".toml" else NAMED.findall(text):
        if "/" in name and name not in ELSEWHERE:
            yield name.rstrip(".")


def exists(name: str) -> bool:
    return any(next(home.glob(name.rstrip("/")), None) is not None for home in HOMES)


@pytest.mark.parametrize("page", [ROOT / "pyproject.toml", *PAGES], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_path_that_a_page_names_exists(page):
    lost = [name for name in names_of(page) if not exists(name)]
    assert not lost, f"{page.name} names {lost}, which are not there. Correct the name, or take it from the page."


def test_paths_are_told_from_other_words():
    text = "`a/b.py` and `diagnosis/checks/`, `file.py`, `a / b`, `kg/m`, `robot.close`, `and/or`"
    assert NAMED.findall(text) == ["a/b.py", "diagnosis/checks/", "file.py"]
    assert exists("formats/xml.py") and exists("meta/test_paths.py") and not exists("diagnosis/checks/")
