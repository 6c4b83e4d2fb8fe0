"""Docstrings completed from the glossary: at import, in files of the wheel, and nowhere written twice."""

from __future__ import annotations

import ast
import importlib
import re
import sys
from types import ModuleType

import pytest
from places import ROOT
from source_trees import syntax_nodes

import twistwrench as tw
from twistwrench.core.answers.page import TERMS
from twistwrench.core.glossary import ENTRIES, ROOMS, complete_docstring, room_of

SOURCE = ROOT / "src" / "twistwrench"
CALLING = [p for p in sorted(SOURCE.rglob("*.py")) if p.read_text("utf-8").endswith("\ncomplete(globals())\n")]

PLAIN = """Torque.

    Parameters
    ----------
    gain : float, of the motor

    Returns
    -------
    tau : array
    """


def test_arguments_and_errors_are_filled_in_by_the_signature():
    found = complete_docstring(PLAIN, ["q", "gain", "frame"], "robot")

    entries = [f"q : {ENTRIES['q']}", "gain : float, of the motor", f"frame : {ENTRIES['frame']}"]
    assert "Parameters\n    ----------\n    " + "\n    ".join(entries) + "\n\n    Returns" in found
    assert found.index("ShapeError") < found.index("UnknownNameError") < found.index("FrameError")
    assert complete_docstring(found, ["q", "gain", "frame"], "robot") == found


def test_errors_that_a_docstring_lists_together_are_not_said_again():
    told = f"{PLAIN.rstrip()}\n\n    Raises\n    ------\n    FrameError, UnknownNameError\n        No such frame.\n    "
    found = complete_docstring(told, ["q", "gain", "frame"], "robot")

    assert found.count("FrameError") == found.count("UnknownNameError") == found.count("ShapeError") == 1


def test_a_room_has_words_of_its_own():
    assert f"q : {ROOMS['joints']['q']}" in complete_docstring(PLAIN, ["q", "gain"], "joints")


def test_a_docstring_without_sections_stays():
    assert complete_docstring("Torque of q.\n\nMore.", ["q"], "robot") == "Torque of q.\n\nMore."


def test_help_shows_what_the_source_leaves_out():
    assert "joint velocities [rad/s, m/s]" in (tw.Robot.inverse_dynamics.__doc__ or "")


def docstrings(nodes):
    for node in nodes:
        if isinstance(node, ast.FunctionDef) and (doc := ast.get_docstring(node)):
            yield node, doc


def parameters(doc):
    return doc.partition("\nParameters\n---")[2].partition("\n\n")[0] + "\n"


def build_hooks(monkeypatch):
    """Module hatch_build, whose base classes are those of a package that is present only while a wheel is built."""
    for place, base in (("builders.hooks", "BuildHookInterface"), ("metadata", "MetadataHookInterface")):
        plugin = ModuleType(f"hatchling.{place}.plugin.interface")
        setattr(plugin, base, object)
        monkeypatch.setitem(sys.modules, plugin.__name__, plugin)
    monkeypatch.syspath_prepend(str(ROOT))
    return importlib.import_module("hatch_build")


@pytest.mark.parametrize("repository", ["", "https://forge.example/tw"])
def test_readme_of_a_package_index_has_no_relative_link(repository, monkeypatch):
    source = (ROOT / "README.md").read_text("utf-8")
    found = build_hooks(monkeypatch).indexed_readme(source, repository)

    relative = r"\]\((?!https?:|#)|src(?:set)?=\"(?!https?:)|<!--|^```\w+ "
    assert re.search(relative, source, re.MULTILINE) and not re.search(relative, found, re.MULTILINE)
    assert found.count("](https:") == (source.count("](") if repository else source.count("](https:"))
    assert source.partition("(README")[0][:60] == found[:60] and "## How fast and how right" in found


@pytest.mark.parametrize("path", CALLING, ids=lambda p: p.relative_to(SOURCE).as_posix())
def test_no_docstring_repeats_the_glossary(path):
    words = {**ENTRIES, **ROOMS.get(room_of(path.relative_to(SOURCE).parts[:-1]), {})}
    twice = [
        f"{node.name}: {name}"
        for node, doc in docstrings(syntax_nodes(path))
        for name, text in words.items()
        if re.search(rf"^{re.escape(f'{name} : {text}')}\n(?! )", parameters(doc), re.MULTILINE)
    ]
    assert twice == []


@pytest.mark.parametrize("path", CALLING, ids=lambda p: p.relative_to(SOURCE).as_posix())
def test_files_of_the_wheel_have_whole_docstrings_and_the_same_code(path, monkeypatch):
    hook = build_hooks(monkeypatch)
    built, room = hook.completed_source(path), path.relative_to(SOURCE).parts[0].removesuffix(".py")

    def code(tree):
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and ast.get_docstring(node):
                node.body[0].value.value = ""
        return ast.dump(tree)

    tree = ast.parse(built)
    documented = [*docstrings(ast.walk(tree))]
    assert code(tree) == code(ast.parse(path.read_text("utf-8")))
    for node, doc in documented:
        given = node.args
        names = [a.arg for a in (*given.args, *given.kwonlyargs) if a.arg not in ("self", "cls")]
        assert len(complete_docstring(doc, names, room)) <= len(doc) + 1, node.name


# ── The glossary of the documentation


def test_terms_that_reports_explain_are_those_of_the_glossary_word_for_word():
    text = (ROOT / "docs" / "glossary.md").read_text("utf-8")
    rows = re.findall(r"^\| \*\*(.+?)\*\* \| (.+?) \|", text.partition("## One word, one meaning")[0], re.MULTILINE)
    assert {word: said for word, said in rows if word in TERMS} == TERMS
    assert sorted(word for word, _ in rows if word in TERMS) == sorted(TERMS)
