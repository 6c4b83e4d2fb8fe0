"""The documentation is in plain English: short sentences, idiomatic verbs, every sentence once."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import pytest
from places import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LONG = 35
"""Words of a sentence from which on it counts as long."""

UNSAID = (
    r"```.*?```",  # code and printed output
    r"^---\n.*?^---$",
    r"^\|.*$",
    r"^#.*$",
    r"^>.*$",  # messages as they are printed
    r"\$\$.*?\$\$",
    r"<!--.*?-->",
)
VERBS = re.compile(r"\b(say|says|said|knows?|feels?|felt|asks?|asked|tells?|told|goes home)\b")
IS_NO = re.compile(r"(?<!there )(?<!There )\b(is|are) no (?!(longer|slower|faster|more|less|larger|smaller)\b)[a-z]+")
LATER = frozenset(
    [
        "actuation",
        "compare",
        "constraints",
        "control",
        "derivatives",
        "errata",
        "export",
        "gallery",
        "modern-robotics",
        "quantities",
        "questions",
        "rollouts",
        "simulation",
        "sizing",
        "torques",
        "viewer",
    ]
)
"""Pages that are still to be rewritten."""

ALLOWED: tuple[str, ...] = ()
"""Parts of sentences in which a person says, knows, feels, asks or tells, at most 20."""


def sentences(page: Path) -> list[str]:
    """Sentences of a page's paragraphs and lists, without code, tables, headings and formulas of their own."""
    text = page.read_text("utf-8")
    for pattern in UNSAID:
        text = re.sub(pattern, "", text, flags=re.DOTALL | re.MULTILINE if "?" in pattern else re.MULTILINE)
    text = re.sub(r"^ *(?:[-*]|\d+\.) ", "\n\n", text, flags=re.MULTILINE)
    found = [
        " ".join(sentence.split())
        for paragraph in re.split(r"\n\s*\n", text)
        for sentence in re.split(r"(?<=[.!?:])\s+(?=[A-Z`*\[])", paragraph.strip())
    ]
    return [sentence for sentence in found if len(sentence.split()) > 2]


def plain(sentence: str) -> str:
    """The sentence without code, quotations and targets of links."""
    return re.sub(r"`[^`]*`|“[^”]*”|\"[^\"]*\"|\]\([^)]*\)", "", sentence)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_sentences_are_short(page):
    """At most 20 words on average, and few of more than 35."""
    lengths = [len(sentence.split()) for sentence in sentences(page)]
    long = [sentence for sentence in sentences(page) if len(sentence.split()) > LONG]
    mean, most = (22.3, 0.21) if page.stem in LATER else (20.0, 0.03)
    assert sum(lengths) <= mean * len(lengths), f"{page.name}: {sum(lengths) / len(lengths):.1f} words a sentence"
    assert len(long) <= max(1, most * len(lengths)), (page.name, long)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_nothing_is_no_thing(page):
    """'is not a', never 'is no'."""
    found = [sentence for sentence in sentences(page) if IS_NO.search(plain(sentence))]
    assert page.stem in LATER or not found, (page.name, found)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_no_sentence_begins_with_of(page):
    """Subject, verb, object; but a count may be 'Of the 70 faults, 53 …'."""
    found = [s for s in sentences(page) if re.match(r"\**Of (?!(the |all )?[\d.,]*\d)", s)]
    assert page.stem in LATER or not found, (page.name, found)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_software_returns_and_reports(page):
    """It does not say, know, feel, ask or tell."""
    found = [
        sentence
        for sentence in sentences(page)
        if VERBS.search(plain(sentence).replace("told apart", "")) and not any(part in sentence for part in ALLOWED)
    ]
    assert page.stem in LATER or not found, (page.name, found)


def test_few_sentences_are_excepted():
    texts = [sentence for page in PAGES for sentence in sentences(page)]
    assert len(ALLOWED) <= 20
    for part in ALLOWED:
        assert any(part in sentence for sentence in texts), f"{part!r} is on no page"


def test_no_sentence_is_on_two_pages():
    """One page has it, the others link to it."""
    places = defaultdict(set)
    for page in PAGES:
        for sentence in sentences(page):
            if len(sentence.split()) >= 12:
                places[sentence].add(page.name)
    assert not {sentence: names for sentence, names in places.items() if len(names) > 1}
