"""Everything shown is executed: the Python blocks and the commands of the README and of docs/."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner
from places import ROOT

from twistwrench.cli.main import main

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
EXIT = re.compile(r"\bexit=(\d+)")
"""Behind the language of a block of commands: what they end with, where that is not 0."""

WANTS = {"bridges.md": ("jax", "casadi"), "coming-from.md": ("pinocchio", "mujoco", "modern_robotics")}
"""Other packages that a page is about."""


def blocks(page: Path, language: str) -> list[str]:
    return [text for text, _ in marked_blocks(page, language)]


def marked_blocks(page: Path, language: str) -> list[tuple[str, int]]:
    """The blocks of a language, and the exit code that those of commands end with."""
    return [
        (text, int(code[1]) if (code := EXIT.search(rest)) else 0)
        for lang, rest, text in BLOCK.findall(page.read_text("utf-8"))
        if lang == language and "no-run" not in rest
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_python_blocks_run_one_after_another(page, capsys, tmp_path, monkeypatch):
    for name in WANTS.get(page.name, ()):
        pytest.importorskip(name)
    monkeypatch.chdir(tmp_path)
    scope: dict[str, object] = {}
    for text in blocks(page, "python"):
        exec(compile(text, str(page), "exec"), scope)


COMMANDS = [
    pytest.param(line[2:], code, id=line[2:])
    for page in PAGES
    for text, code in marked_blocks(page, "console")
    for line in text.splitlines()
    if line.startswith("$ ")
]


@pytest.mark.parametrize(("command", "code"), COMMANDS)
def test_commands_run(command, code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program, *arguments = shlex.split(command)
    assert program == "twistwrench"
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == code, result.output


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text("utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_pages_and_makefile_agree_on_the_commands():
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for word in re.findall(r"\bmake ([a-z-]+)", (ROOT / "README.md").read_text("utf-8")):
        assert re.search(rf"^{word}:", makefile, re.MULTILINE), f"make {word}"


def test_the_page_of_quantities_is_the_table():
    """But for the counts of operations, which may differ by what a processor's sine of an entry near zero is."""
    written = runpy.run_path(str(ROOT / "docs" / "quantities.py"))["page"]()
    committed = (ROOT / "docs" / "quantities.md").read_text("utf-8")
    counts = re.compile(r"(?<= )([\d,]+)(?= \|$)", re.MULTILINE)
    assert counts.sub("", committed) == counts.sub("", written), "run `python docs/quantities.py`"
    for old, new in zip(counts.findall(committed), counts.findall(written), strict=True):
        assert abs(int(old.replace(",", "")) - int(new.replace(",", ""))) <= 0.02 * int(new.replace(",", "")) + 2
