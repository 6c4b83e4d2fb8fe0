"""Documentation, docstrings, messages and option help are in plain English: the rules of the style guide that a test can check."""

from __future__ import annotations

import ast
import functools
import re
import runpy
import tomllib
from collections.abc import Iterator

import click
import pytest
from places import ROOT
from source_trees import syntax_nodes

from twistwrench.cli.main import main

_PROSE = runpy.run_path(str(ROOT / "docs" / "prose.py"))
PAGES, sentences, cells = _PROSE["PAGES"], _PROSE["sentences"], _PROSE["cells"]
VERBS = re.compile(r"\b(say|says|said|knows?|feels?|felt|asks?|asked|tells?|told|goes home)\b")
IS_NO = re.compile(r"(?<!there )(?<!There )\b(is|are) no (?!(longer|slower|faster|more|less|larger|smaller)\b)[a-z]+")
ALLOWED = ("know what an option does", "functions named of, at, take")
"""Parts of sentences in which a person says, knows, feels, asks or tells."""


def plain(sentence: str) -> str:
    """The sentence without code, quotations and targets of links."""
    return re.sub(r"`[^`]*`|“[^”]*”|\"[^\"]*\"|\]\([^)]*\)", "", sentence)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_nothing_is_no_thing(page):
    """'is not a', never 'is no'."""
    found = [sentence for sentence in sentences(page) if IS_NO.search(plain(sentence))]
    assert not found, (page.name, found)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_no_sentence_begins_with_of(page):
    """Subject, verb, object; but a count may be 'Of the 70 faults, 53 …'."""
    found = [s for s in sentences(page) if re.match(r"\**Of (?!(the |all )?[\d.,]*\d)", s)]
    assert not found, (page.name, found)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_software_returns_and_reports(page):
    """It does not say, know, feel, ask or tell, in tables neither."""
    found = [
        sentence
        for sentence in (*sentences(page), *cells(page))
        if VERBS.search(plain(sentence).replace("told apart", "")) and not any(part in sentence for part in ALLOWED)
    ]
    assert not found, (page.name, found)


# ── the source: docstrings, messages and option help ──

SOURCE = ROOT / "src" / "twistwrench"
RELATIVE = {"What", "How", "Where", "Whether", "Which", "Of", "That", "Those", "Whatever", "Whoever", "Likewise"}
PREPOSITION = re.compile(r"(Of|In|On|At|By|For|From|With|How|What|Where|Whether|Also|Likewise)\b")


@functools.cache
def literals() -> list[tuple[str, str, bool]]:
    """Place, text, and True for a docstring: each text with a space in the source, parts of f-strings and doubts too."""
    found = []
    for path in sorted(SOURCE.rglob("*.py")):
        nodes = syntax_nodes(path)
        documented = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        for node in nodes:
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip():
                text = " ".join(re.sub(r"``.*?``", "x", node.value).split())
                found.append((f"{path.relative_to(SOURCE)}:{node.lineno}", text, id(node) in documented))
    for name, entry in tomllib.loads((SOURCE / "core" / "doubts.toml").read_text("utf-8")).items():
        texts = (" ".join(entry[part].split()) for part in {"sentence", "remedy"} & entry.keys())
        found += [(f"doubts.toml: {name}", re.sub(r"{.*?}", "x", text), False) for text in texts]
    return found


def rules(text: str, docstring: bool) -> Iterator[str]:
    """Rules that a text breaks; verbs count in the first sentence of a docstring."""
    if docstring and text.split(maxsplit=1)[0].strip("*.,:") in RELATIVE:
        yield "begin with a verb or a noun of the field"
    if VERBS.search(re.split(r"(?<=[.!?]) ", text)[0] if docstring else text):
        yield "software returns, evaluates, reports"
    if IS_NO.search(text):
        yield "'is not a', never 'is no'"
    if not docstring and re.search(r"(?:^|[.:] )Of (?![0-9{]|the [0-9{])", text):
        yield "subject first, not 'Of …'"


def test_docstrings_and_messages_follow_the_style_guide():
    assert len(literals()) > 8000  # the walk finds them
    broken = [f"{place}: {text[:100]}: {rule}" for place, text, doc in literals() for rule in rules(text, doc)]
    assert not broken, "\n".join(broken)


@pytest.mark.parametrize(
    "text, docstring, rule",
    [
        ("What is given for a step.", True, "begin with"),
        ("Text that the log tells.", True, "software returns"),
        ("T is no pose: give one.", False, "is not a"),
        ("Of long logs fewer rows are used.", False, "subject first"),
        ("Torque of a joint [N m].", True, None),
        ("there is no column 'time'", False, None),
    ],
)
def test_each_rule_is_tested(text, docstring, rule):
    found = list(rules(text, docstring))
    assert (len(found) == 1 and rule in found[0]) if rule else not found


def options(group: click.Group = main, path: tuple[str, ...] = ()) -> Iterator[tuple[str, click.Option]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from options(command, (*path, name))
        elif command is not None:
            yield from ((" ".join((*path, name)), p) for p in command.params if isinstance(p, click.Option))


def test_option_help_can_be_read_alone():
    """A noun phrase or an imperative; a number has a unit or a named placeholder, unless it is a count or a ratio."""
    for command, option in options():
        text = option.help or ""
        assert text and not PREPOSITION.match(text), f"{command} {option.opts[0]}: {text}"
        unit = "[" in text or option.metavar or re.match(r"Number|Fraction|Seed|Relative|.* multiples of", text)
        assert unit or not option.type.name.startswith(("float", "integer")), f"{command} {option.opts[0]}: {text}"
