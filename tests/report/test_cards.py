"""Cards of notebooks: for every answer, without scripts, of limited size, with names from files as text."""

from __future__ import annotations

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.core.answers.answer import Answer
from twistwrench.core.answers.blocks import Headline, Line, Remark, Table, numbers, words
from twistwrench.core.verdict import Verdict, Word

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

LARGEST = 120_000
"""Bytes."""
HOSTILE = ["<script>x</script>", "a" * 10_000, "\x1b[31mred\x07", '"><img src=x onerror=y>', "𝄞‮"]


class Findings(Answer):
    """Answer with names from a file of a stranger."""

    def __init__(self, name: str, *, table: bool) -> None:
        self.name, self.table = name, table

    @property
    def verdict(self):
        return Verdict(Word.UNSURE, (f"{self.name} is not known.",))

    @property
    def robot_name(self):
        return self.name

    def blocks(self):
        yield Headline.from_verdict(self.verdict)
        if self.table:
            yield Table(self.name, words("joint", [self.name] * 40), numbers("peak", np.arange(40.0)), most=12)
        yield from (Line(self.name) for _ in range(20))
        yield Remark(self.name)


@pytest.mark.parametrize("table", [True, False])
@pytest.mark.parametrize("name", HOSTILE, ids=["script", "long", "control", "image", "bidirectional"])
def test_a_card_shows_names_as_text_and_stays_small(name, table):
    card = Findings(name, table=table)._repr_html_()
    assert len(card.encode()) <= LARGEST
    assert "<script" not in card and "<img" not in card and "\x1b" not in card
    assert "UNSURE" in card


def test_a_card_of_a_report_without_a_table_has_its_first_lines():
    """Twenty lines and a remark: eight on the card, and a word on the rest."""
    body = Findings("elbow", table=False)._repr_html_().partition("</style>")[2]
    assert body.count("<p>elbow</p>") == 8
    assert "13 notes more" in body


ANSWERS = {
    "doctor": lambda: tw.doctor("quadruped"),
    "info": lambda: tw.info("panda"),
    "log": lambda: tw.check_log(tw.robots.path_of("ur5").with_name("ur5_demo.csv")),
    "payload": lambda: tw.payload("ur5"),
    "robots": tw.robots.known,
    "verify": lambda: tw.verify("pendulum"),
    "derive": lambda: tw.derive("pendulum"),
    "sensor": lambda: tw.sensing.identify("demo"),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_every_card_has_content_below_its_headline(name):
    """A table, or the first lines of the report: a word alone is not an answer."""
    card = ANSWERS[name]()._repr_html_()
    assert card.startswith('<div class="twistwrench">') and "<script" not in card
    body = card.partition("</style>")[2]
    assert body.count("<p") + body.count("<table") >= 2
    assert len(card.encode()) <= LARGEST


def test_the_card_says_how_many_tables_it_leaves_out():
    assert "2 tables more: .print()" in tw.robots.ur5().simulate([0.0] * 6, [0.0] * 6, duration=0.2)._repr_html_()
