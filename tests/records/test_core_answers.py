"""Surfaces of answers on record: text in several widths, colours, card, page, data and tables, for all kinds of blocks."""

from __future__ import annotations

import contextlib
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from recorded_answers import Records

from twistwrench.core.answers import answer, blocks, card, data, page, shown_blocks, terminal
from twistwrench.core.answers.blocks import (
    Aligned,
    Bar,
    Branch,
    Column,
    Glyphs,
    Headline,
    Level,
    Line,
    More,
    Remark,
    Table,
)
from twistwrench.core.answers.card import Shares
from twistwrench.core.answers.page import MarkedJoint, Picture, ReportPage, Viewer
from twistwrench.core.colours import Style, strong
from twistwrench.core.text import ReadingNote
from twistwrench.core.verdict import Reason, Verdict, Word

records = Records(__file__)

SHARES = [0.1, 0.79, 0.801, 0.999, 1.0, 1.0000003, 1.0000023, 1.3, float("nan"), 0.45]
NAMES = [
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow",
    "wrist_1.flex",
    "wrist-2",
    "tool/a",
    "b",
    "c",
    "d",
    "gripper_finger_left_inner_knuckle_joint",
]


def torques(**options):
    return Table(
        "Torques of all joints",
        blocks.words("joint", NAMES),
        blocks.numbers("peak", [1.23456, -20.5, 3e6, 0.0, None, 5, np.int64(7), float("nan"), 9.125, 10.0], unit="N m", limits=[28, 150.0, 3, 4, float("inf"), 6, 7, 8, 9, 10]),
        Column("", SHARES, lambda share: Bar(share, "x" if share < 1 else "over") if share == share else "–", narrow=Column("share", SHARES, blocks.share_cell, unit="%")),
        blocks.numbers("all", range(10), lambda k: f"{k} {10 * k} {100 * k}", min_width=4, wide_only=True),
        None,
        blocks.words("mark", ["", "x", "", "", "y", "", "", "", "", "z"]),
        blocks.words("", ["┃"] * 10, style=Style.QUIET),
        Column("glyphs", range(10), lambda k: Glyphs("▁▂▃"[k % 3], Style.NEAR)),
        styles=[Style.OVER if share > 1 else "" for share in SHARES],
        unit="N m",
        **options,
    )  # fmt: skip


def shares_table():
    """Bars without a form for narrow terminals, and lines with numbers."""
    return Table("Shares", Column("share", [0.5, 0.9, 1.2], lambda x: Bar(x, "" if x > 1 else f" {x} ")), Column("peak", ["a", "b", "c"], lambda v: Line(v, value=len(v) + 0.5)), Column("gap", [None, "–", "x"]), blocks.words("word", ["–", "", "y"]), Column("none", ["", "", ""]))  # fmt: skip


def tree():
    root = Branch(Line("root ", ("link", strong(Style.POINTED))))
    first = root.add(Line(("first", Style.GOOD)))
    first.add(Line("deep"))
    root.add(Line("second & <last>"))
    return root


def every_block():
    return [
        Headline.from_verdict(Verdict(Word.OVER_LIMIT, ("elbow needs 30 N m", "wrist needs more.", "", Reason("no limit; give it", "give it"))), further=[Line("Maximum payload: ", ("2 kg", Style.STRONG))]),
        Line("Longest of the motion, a sentence that is longer than eighty columns so that it has to be broken into lines.", indent=4),
        "", torques(most=4, by=SHARES), Remark("a doubt", "look again"), Remark("how it was read", reading=True), Remark("also read", reading=True), tree(), Line("/a/very/long/path/that/must/never/be/broken/into/lines/however/narrow/the/terminal/may/be.csv", whole=True),
        Table("", blocks.words("word", ["alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu", "x"], fold=False), blocks.numbers("n", [1e-9, -2.5]), level=Level.ALL), Aligned("Symbols and their meanings", [("q̇", "rates"), ("M(q)", "mass matrix that is long enough to be folded in narrow terminals"), ("c", "")], lambda text, width: [text[k : k + max(width, 1)] for k in range(0, len(text), max(width, 1))], gap=" = "),
        Line("only on pages", level=Level.PAGE), Table("Details of it: more", blocks.words("a", ["b\x1b[2J"]), level=Level.PAGE), More("All 20 findings"), "plain text with control \x07",
    ]  # fmt: skip


class Sample(answer.Answer):
    call = "sample"

    def __init__(self, verdict, made=None, brief="30 N m", shares=None, files=()):
        self._verdict, self._made, self._brief, self._shares, self._files = verdict, made, brief, shares, files

    @property
    def verdict(self):
        return self._verdict

    def blocks(self):
        return every_block() if self._made is None else self._made

    @property
    def robot_name(self):
        return "ur<5>"

    @property
    def subject(self):
        return "ur<5>, demo.csv " + "y" * 200

    @property
    def brief(self):
        return self._brief

    def facts(self):
        return {"limit": "28 N m", "share & all": "107 %"}

    def sources(self):
        return dict(self._files)

    def origin(self):
        return [
            ("friction", "left out"),
            Table("Limits used", blocks.words("joint", ["a"]), blocks.numbers("limit", [3.0], unit="N")),
        ]

    def shares(self):
        return self._shares

    def pictures(self):
        return [Picture("robot <1>", b"\x89PNG"), Picture("curves", "<svg></svg>")]

    def viewer(self):
        return Viewer("<html>" + "Q" * 210 + "/folder/robot.urdf</html>", ("'sha256-x'",))


OVER = Verdict(Word.OVER_LIMIT, ("elbow needs 30 N m", Reason("no limit; give it", "give it")))


def in_width(made, width, colours=None):
    output = terminal._Output(
        width=width, file=io.StringIO(), highlight=False, color_system=colours, force_terminal=bool(colours)
    )
    with output.capture() as captured:
        terminal._print(made, output)
    return [line.rstrip() for line in captured.get().splitlines()]


@records.of
def texts_of_all_blocks():
    made = every_block()
    full = shown_blocks.shown_blocks(made, every=True, hint="h")
    with contextlib.redirect_stdout(io.StringIO()) as printed, pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "70")
        terminal.print_blocks(made[:4])
        terminal.print_blocks(made[:4], every=True)
    return {"as text": terminal.as_text(made).splitlines(), "full": in_width(full, 100), "narrow": in_width(full, 46), "narrower": in_width([torques()], 30), "wide": in_width([torques()], 140)[:5], "printed": printed.getvalue().splitlines()[-12:], "in colours": in_width([made[0], made[4], tree()], 90, "standard")}  # fmt: skip


@records.of
def short_forms():
    many = [
        torques(most=4, by=SHARES),
        Table("Second (of two)", blocks.words("a", [str(k) for k in range(30)]), most=3),
        tree(),
        torques(most=9, by=SHARES, of_limits=False),
        Table("Third: x", blocks.words("a", [str(k) for k in range(25)])),
    ]

    def rows(form):
        return [
            (len(b.columns[0].values), b.columns[1].limits if len(b.columns) > 1 else "")
            if isinstance(b, Table)
            else data.plain(b)[:40]
            for b in form
        ]

    shorten = shown_blocks.shorten_table
    return {
        "many": rows(terminal.short_form(many, "hint")), "forms": [len(rows(f)) for f in terminal._short_forms(many, "hint")][:12], "counts": [rows(shorten(torques(most=m, by=SHARES, of_limits=o), h, r, u)) for m, o, h, r, u in ((4, True, "h", None, 6), (4, False, "h", None, 6), (4, True, "", None, 6), (8, True, "h", None, 6), (8, True, "h", 3, 3), (9, True, "h", None, 6), (4, True, "h", None, 9), (4, True, "h", None, 8))],
        "without shares": rows(shorten(torques(most=2), "h")), "selected": shorten(torques(most=2, by=SHARES), "h")[0].columns[0].values, "narrow": shorten(torques(most=2, by=SHARES), "h")[0].columns[2].narrow.values, "styles": shorten(torques(most=3, by=SHARES), "h")[0].styles, "whole": rows(shorten(torques(), "h")),
        "shown": {f"{e} {h}": [type(b).__name__ + ":" + data.plain(b)[:30] if not isinstance(b, Table) else len(b.styles) for b in shown_blocks.shown_blocks(every_block(), every=e, hint=h)] for e in (True, False) for h in ("hint", "")}, "one note": [data.plain(b) for b in shown_blocks.shown_blocks(every_block()[5:6], every=False, hint="h")],
        "fits": [terminal._fits_on_a_screen(["x"] * k, terminal._plain_output()) for k in (45, 46)], "titles": [b.sentence for b in terminal._with_first_tables(many, 1) if isinstance(b, More)], "levels": [getattr(b, "title", type(b).__name__) for b in terminal._with_first_tables([tree(), Table("A page", blocks.words("a", ["b"]), level=Level.PAGE), *many, tree(), tree()], 2)], "names": [terminal._fold_name(*n) for n in (("shoulder_pan_joint", 18), ("shoulder_pan_joint", 12), ("shoulder_pan_joint", 3), ("a b_c_d", 3), ("", 3))], "parts": [terminal._name_parts(n) for n in ("a_b-c.d/e", "x", "", "_a")],
    }  # fmt: skip


@records.of
def pieces_of_blocks():
    return {
        "headlines": [Headline(Word.STOPPED, "it fell.", " at t = 1 s", reasons=("a.", "b."), further=[Line("c", ("d", "good"))]).pieces, Headline(Word.OK).pieces, Headline.from_verdict(Verdict(Word.DONE)).pieces],
        "bars": [[b.pieces, b.style] for b in (Bar(0.0), Bar(0.5, "50 %"), Bar(0.96), Bar(2.0, "x"))], "cells": [c if isinstance(c := blocks.cell_text(v), str) else type(c).__name__ for v in ("a", 12345678, np.int32(7), 1 / 3, None, Line("x"), True)], "styles": [[blocks.limit_style(x), blocks.mark_style(x)] for x in (0.8, 0.81, 1.0, 1.000002, float("nan"))],
        "shares": [c if isinstance(c := blocks.share_cell(x), str) else [c.pieces, c.value] for x in (0.5, 0.999, float("nan"), float("inf"), 1.2)], "remarks": [[r.words, r.reading] for r in blocks.remarks(["a", ReadingNote("b"), "c"])], "heads": [Column("a", [1], unit="N").head, Column("a", [1], unit="N", headed=False).head, Column("a", [1]).head], "words": blocks.word_cell("OK").pieces,
        "columns": [[c.words, c.whole, c.min_width, c.style, c.wide_only] for c in (blocks.words("a", ["b"]), blocks.words("a", ["b"], fold=False, style="x"), blocks.numbers("a", [1]), blocks.numbers("a", [1], min_width=3, wide_only=True))], "aligned": [Aligned("t", [("a", "b c"), ("q̇x", "")], lambda t, w: [*t.split(), str(w)]).lines(30), Aligned("long title of it", [], lambda t, w: [t]).title_lines(8)],
        "plain": [data.plain(b) for b in (tree(), Glyphs("x"), Bar(0.5, "50 %"), Bar(0.5), Remark("a", "b"), "text", Aligned("t", [("a", "b")], lambda t, w: [t]), Headline(Word.OK, "fine."))], "marks": [MarkedJoint("a", "a, 5 %").caption, MarkedJoint("a", "b", Style.OVER).caption],
    }  # fmt: skip


@records.of
def data_of_answers(folder):
    sample = Sample(OVER)
    with contextlib.chdir(folder):
        written = sample.to_json("a.json")
        again = Path("a.json").read_text()
        try:
            sample.to_json("a.json")
        except ValueError as error:
            refused = str(error)
        sample.to_json("a.json", overwrite=True)
    tables = sample.tables
    first = tables["Torques of all joints"]
    other = Sample(Verdict(Word.OK), [Line("x"), Headline(Word.OK, "fine.")], brief="")
    found = sample.to_dict()
    try:
        bool(sample)
    except TypeError as error:
        truth = str(error)
    return {
        "dict": {k: v for k, v in found.items() if k != "version"}, "json": [str(written), again == sample.to_json(), json.loads(again)["verdict"], again[:40]], "refused": refused, "shown": [repr(sample), repr(other), truth], "headlines": [sample.headline, other.headline, Sample(Verdict(Word.OK), []).headline], "titles": list(tables),
        "table": [first.rows()[1], first.to_dict()["joint"][:2], first.to_pandas().attrs, first.to_pandas().shape], "other": {k: v for k, v in other.to_dict().items() if k in ("verdict", "sentences", "reasons", "ok", "exit_code", "remedies", "schema")}, "defaults": [list(answer.Answer.facts(sample)), list(answer.Answer.origin(sample)), answer.Answer.shares(sample), answer.Answer.sources(sample)],
        "two headlines": data.report_data([Headline(Word.UNSURE, "a"), Headline(Word.OK, "b")]), "bars": data.table_data(shares_table()), "bars on a page": page.table_html(shares_table()), "surfaces": surfaces(),
        "print": printed_answer(sample)[:3], "text": str(other).splitlines(),
    }  # fmt: skip


class Plain(answer.Answer):
    verdict = Verdict(Word.OK)

    def blocks(self):
        return ["x"]


def surfaces():
    """Calls of the rooms above, and what an answer has without a robot."""
    given = []
    with pytest.MonkeyPatch.context() as patch:
        for name in ("pictures_of", "viewer_of", "plot"):
            patch.setattr(
                f"twistwrench.viz.answers.{name}",
                lambda *p, name=name: given.append([name, *[x for x in p if not isinstance(x, Plain)]]),
            )
        plain = Plain()
        plain.pictures()
        plain.viewer()
        plain.plot()
        plain.plot("causes", "a.svg")
    return [given, plain.subject, plain.brief, plain.robot_name, repr(plain), plain.to_dict()["call"]]


def printed_answer(sample):
    text = io.StringIO()
    sample.print(file=text)
    return text.getvalue().splitlines()


def motion_shares(n=9, scale=1.0):
    t = np.linspace(2.0, 5.0, n)
    return Shares(
        t,
        scale * np.stack([0.5 + 0.1 * np.sin(t), 0.9 + 0.15 * np.cos(3 * t), np.full(n, np.nan), 0.2 * t], 1),
        ["a", "b<c>", "c", "d"],
    )


@records.of
def cards_of_answers():
    def without_style(sample):
        return re.sub(r"<style>.*?</style>", "", sample._repr_html_())

    tables = [
        Headline(Word.OK, "fine."),
        *[Line(f"line {k}") for k in range(10)],
        torques(),
        *[Remark(f"note {k}") for k in range(6)],
        torques(),
    ]
    broken = Sample(OVER, [Headline(Word.OK, "a < b")])
    broken.shares = lambda: 1 / 0
    long = Sample(OVER, [Headline(Word.OK, "fine."), Table("", blocks.words("a", ["x" * 1000] * 130))])
    return {
        "all": without_style(Sample(OVER, shares=motion_shares())), "lines": without_style(Sample(OVER, tables)), "without table": without_style(Sample(OVER, tables[:11])), "broken": broken._repr_html_(), "long": without_style(long)[:120], "style": card._STYLE, "no limit": without_style(Sample(OVER, [], shares=Shares(np.arange(2.0), np.full((2, 1), np.nan), ["a"]))),
        "curves": [card.shares_svg(motion_shares(500, 0.5))[-420:], card.shares_svg(motion_shares(1))[:900], len(re.findall(r"\d+\.\d+,", card.shares_svg(motion_shares(481))))], "counts": [card._count_text(b) for b in ([torques()], [torques(), torques(), "x"], ["a", "b"], [])],
    }  # fmt: skip


def without_versions(html):
    html = re.sub(r"<style>.*?</style>", "<style/>", html, flags=re.S)
    html = re.sub(r"<dt>(versions|date)</dt><dd>.*?</dd>", "", html)
    return re.sub(r'"(versions|date)":".*?"(?=[,}])', "", html).splitlines()


@records.of
def pages_of_answers(folder):
    with contextlib.chdir(folder):
        Path("deep").mkdir()
        Path("deep/robot.urdf").write_text("<robot/>")
        sample = Sample(OVER, files={"ROBOT": "deep/robot.urdf", "MOTION": "no.csv"}.items())
        whole = without_versions(
            page.answer_page(
                sample,
                command=["sample", "deep/robot.urdf", "--x=a b"],
                notes=["read deep/robot.urdf"],
                files={"LOG (x)": "deep/robot.urdf", "CSV": None, "HTML": "deep/out.html"},
            ).html()
        )
        full = without_versions(page.answer_page(sample, full_paths=True).html())
        written = Sample(Verdict(Word.OK), [Line("x")]).to_html("p.html").name
        plain = ReportPage("torques", "ur5 < 6", [], provenance=[("a", "b")]).html()
        shorten = page.without_folders(
            ["deep/robot.urdf+deep/other.csv", "x=deep/z.csv", "plain", "none/y.csv", "link:=deep/w.csv"]
        )
        shortened = shorten("deep/robot.urdf deep/other.csv deep/z.csv none/y.csv deep/w.csv")
        Path("deep/x").mkdir()
        nested = page.without_folders(["deep/x", "deep/x/a.csv"])("deep/x/a.csv in deep/x")
        provenance = [
            [name, text[:60]] for name, text in page.provenance({"LOG (x)": "deep/robot.urdf", "A": None, "B": "no"})
        ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "1600000000")
        dated = dict(page.versions())["date"]
    details = ReportPage(
        "c",
        "s",
        [Headline(Word.OK, "fine.\nb"), "x", "", torques(), Line("i", indent=2), More("m")],
        details=[tree(), Aligned("t <u>", [("a", "b")], lambda t, w: [t])],
        notes=["n & m"],
        facts=[("a", "<1>")],
    ).html()
    return {
        "whole": whole, "full": next(line for line in full if "SHA" in line)[-700:], "written": written, "empty": without_versions(plain), "shortened": [shortened, nested], "provenance": provenance, "date": dated, "details": without_versions(details)[9:-4], "digest": page.digest("let a = 1;"),
        "terms": [[t for t, _ in page._terms_in(h)] for h in ("<td>gravity and OK</td>", '<td class="word">gravity</td>', "<th>peak</th> UNSURE", "<p>peak σ</p>", "<svg>COLLISION</svg>", "<h1>drift</h1>", "<p>LOOK AGAINST LOOK AGAIN, γ</p>")], "paragraphs": [page.paragraphs(Line("a\nb", ("c\nd\ne", "good"), "f")), page.paragraphs(Line(("x", "")))], "styles": len(page.page_colours()),
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
