"""Everything shown is executed: the Python blocks and the commands of the README and of docs/.

The code and the commands of pages that compute for long run with ``-m slow``; their links and words are looked at always.
"""

from __future__ import annotations

import json
import operator
import re
import runpy
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from places import ROOT

import twistwrench as tw
from twistwrench.cli.main import main

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
EXIT = re.compile(r"\bexit=(\d+)")
"""Behind the language of a block of commands: what they end with, where that is not 0."""

FILES = {
    name: text
    for page in PAGES
    for name, text in re.findall(r"^```\w+ file=(\S+)\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
}
"""Files that pages show, for their commands to read."""
OUTPUTS = runpy.run_path(str(ROOT / "docs" / "outputs.py"))
WANTS = {
    "assistant.md": ("jax",),
    "bridges.md": ("jax", "casadi"),
    "mpc.md": ("casadi",),
    "coming-from.md": ("pinocchio", "mujoco", "modern_robotics"),
}
"""Other packages that a page is about."""
LONG_PAGES = {
    "assistant.md",
    "chapter-8.md",
    "coming-from.md",
    "control.md",
    "holds.md",
    "identification.md",  # tutorial-identification.md is run always
    "trajectories.md",
    "viewer.md",
}
"""Pages whose code takes half of the time of all; calls of the same functions are tested in the rooms' own folders."""

PAGES_ON_NUMPY = {"actuation.md", "errata.md", "sizing.md", "statics.md"}
"""Pages that call many functions once each, so that compiling takes most of their time."""


def blocks(page: Path, language: str) -> list[str]:
    return [text for text, _ in marked_blocks(page, language)]


def marked_blocks(page: Path, language: str) -> list[tuple[str, int]]:
    """The blocks of a language, and the exit code that those of commands end with."""
    return [
        (text, int(code[1]) if (code := EXIT.search(rest)) else 0)
        for lang, rest, text in BLOCK.findall(page.read_text("utf-8"))
        if lang == language and "no-run" not in rest
    ]


def usual_or_slow(values, is_slow):
    return [pytest.param(x, marks=pytest.mark.slow if is_slow(x) else ()) for x in values]


@pytest.mark.parametrize("page", usual_or_slow(PAGES, lambda p: p.name in LONG_PAGES), ids=lambda p: p.name)
def test_python_blocks_run_and_print_what_is_shown(page, tmp_path, monkeypatch):
    for name in WANTS.get(page.name, ()):
        pytest.importorskip(name)
    if page.name in PAGES_ON_NUMPY:
        monkeypatch.setenv("TWISTWRENCH_JIT", "0")
    monkeypatch.chdir(tmp_path)
    for block, printed in OUTPUTS["outputs"](page.read_text("utf-8"), page.name):
        shown = block["shown"] or ""
        assert OUTPUTS["agree"](shown, printed), f"shown:\n{shown}\nprinted:\n{printed}\n`make outputs` writes it there"


def test_outputs_agree_to_the_digits_shown():
    agree = OUTPUTS["agree"]
    assert agree("[0. 1.23]", "[0.   1.24]") and agree("a\n…\nb 3", "a\n x\nb 3") and agree("gap 2e-14", "gap 3e-15")
    assert not agree("1.23", "1.25") and not agree("a", "a b") and not agree("", "x") and not agree("a … b", "a c")


CODES = {
    line[2:]: code
    for page in PAGES
    for text, code in marked_blocks(page, "console")
    for line in text.splitlines()
    if line.startswith("$ ")
}
"""What each command of the pages ends with; one that several pages show is run once."""
USUAL = {
    line[2:]
    for page in PAGES
    if page.name not in LONG_PAGES
    for text, _ in marked_blocks(page, "console")
    for line in text.splitlines()
    if line.startswith("$ ")
}
SAID = [
    (command, text)
    for page in PAGES
    for command, text in re.findall(
        r"^```console[^\n]*\n\$ ([^\n]+)\n([^$`][^`]*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
] + [
    (command, text)
    for page in PAGES
    for command, text in re.findall(
        r"^```console[^\n]*\n\$ ([^\n]+)\n```\n\n```text\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
]


@pytest.mark.parametrize("command", usual_or_slow(CODES, lambda command: command not in USUAL))
def test_commands_run_and_say_what_is_shown(command, tmp_path, monkeypatch):
    """Every line that a page shows below a command is in its output, but for … and for how large rounding is."""

    def plain(words):
        return re.sub(r"[0-9.]+e-1[0-9]", "0", " ".join(words.split()))

    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    for name, text in FILES.items():
        if f"--csv {name}" not in command:
            Path(name).write_text(text, "utf-8")
    program, *arguments = shlex.split(command)
    assert program == "twistwrench"
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == CODES[command], result.output
    said = plain(result.output)
    for text in (text for shown, text in SAID if shown == command):
        for line in text.splitlines():
            assert line == "…" or plain(line) in said, line


def test_pages_that_run_with_the_slow_tests_are_pages():
    assert {page.name for page in PAGES} >= LONG_PAGES | PAGES_ON_NUMPY


def test_titles_of_pages_are_those_of_the_navigation():
    nav = dict(re.findall(r"^ +- (.+): ([\w-]+\.md)$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE))
    titles = {name: title for title, name in nav.items()}
    for page in PAGES[1:]:
        assert page.read_text("utf-8").partition("\n")[0] == f"# {titles[page.name]}", page.name


def test_synonyms_stand_on_a_last_line():
    """Words of other fields, which the search finds: a line at the end, before words for the search alone."""
    texts = [page.read_text("utf-8") for page in PAGES]
    found = [re.search(r"^Also: .+\.\n*(?:<!-- search: .+ -->\n)?\Z", text, re.MULTILINE) for text in texts]
    assert sum(map(bool, found)) == sum("\nAlso: " in text for text in texts) >= 12


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text("utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_anchors_are_headings_of_their_pages(page):
    """With MkDocs' rule for the names of headings."""
    for target, anchor in re.findall(r"\]\(([\w./-]*?\.md)?#([^)\s]+)\)", page.read_text("utf-8")):
        place = page.parent / target if target else page
        if place.exists():  # pages of the API are made with the site
            assert anchor in anchors_of(place), f"{page.name} links to {target}#{anchor}"


@cache
def anchors_of(page: Path) -> frozenset[str]:
    slugs = pytest.importorskip("markdown.extensions.toc")
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.+?)(?: \{#([\w-]+)\})?$", text, re.MULTILINE)
    used = set(re.findall(r'\bid="([^"]+)"', text))
    for title, own in titles:
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)|[`*]", lambda found: found[1] or "", title)
        used.add(own or slugs.unique(slugs.slugify(words, "-"), used))
    return frozenset(used)


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


def kept(name: str) -> dict:
    """Results that bench/ measured."""
    return json.loads((ROOT / "bench" / f"{name}.json").read_text("utf-8"))


def page(name: str) -> str:
    return (ROOT / "docs" / f"{name}.md").read_text("utf-8")


def test_the_page_of_doubts_has_the_sentences_of_the_program():
    written = runpy.run_path(str(ROOT / "docs" / "doubts.py"))["page"]()
    assert page("unsure") == written, "run `python docs/doubts.py`"


QUESTIONS = runpy.run_path(str(ROOT / "docs" / "questions.py"))


def test_the_page_of_questions_is_made_from_its_tests():
    """Outputs are compared by the tests in tests/questions, which run the code."""
    text = page("questions")
    assert QUESTIONS["page"](text, QUESTIONS["outputs_shown"](text)) == text, "run `python docs/questions.py`"
    assert set(QUESTIONS["files"]()) == {*(ROOT / "tests" / "questions").glob("test_*.py")}


def test_names_in_the_tables_of_common_questions_exist():
    """Functions of tw, methods of robots and motions, commands."""
    text = page("questions").partition("## Questions asked in public")[0]
    rows = re.findall(r"^\| .+\?.*? \| \[.+?\) \| (.+) \|$", text, re.MULTILINE)
    commands = main.list_commands(click.Context(main))
    quoted = [name for row in rows for name in re.findall(r"`([^`]+)`", row)]
    homes = (tw, tw.Robot, tw.Motion)
    for name in quoted:
        if command := re.match(r"twistwrench (\w+)", name):
            assert command[1] in commands, name
        elif dotted := re.match(r"(tw|robot)\.([\w.]+)", name):
            operator.attrgetter(dotted[2])(tw if dotted[1] == "tw" else tw.Robot)
        elif method := re.fullmatch(r"(\w+)(?:\(.*\))?", name):
            assert any(hasattr(home, method[1]) for home in homes), name
    assert len(rows) > 40 and len(quoted) > 100


def test_questions_differ_and_have_short_answers():
    found = [question for path in QUESTIONS["files"]() for question in QUESTIONS["questions_of"](path)]
    assert len({question.question for question in found}) == len(found)
    assert {q.place: q.lines for q in found if q.lines > QUESTIONS["LINES"]} == {}
    assert all(q.question.endswith("?") and len(q.answer.split()) <= 45 for q in found)


def test_every_error_and_warning_is_explained():
    from twistwrench.core import errors

    text = page("errors")
    for name in errors.__all__:
        assert f"### {name}\n" in text or f"| `{name}` |" in text or name == "TwistWrenchError", name


def test_what_no_log_tells_is_the_table():
    from twistwrench.core.doubts import undetermined_table
    from twistwrench.core.text import spell_out, words_of_the_shell

    words = {"joints": "JOINTS", "left": "a share"}
    with words_of_the_shell():
        told = [
            f"| `{name}` | {spell_out(a).format(**words)} | {spell_out(b)} |"
            for name, (a, b) in undetermined_table().items()
        ]
    assert "\n".join(told) in page("identification-method") + page("identification")


def test_the_drift_of_each_method_is_the_one_measured():
    text, (first, *shown) = page("simulation"), kept("drift")["relative drift"].values()
    assert f"at most {first['variational']:.1e} of the energy exchanged".replace("e-0", "e-") in text
    for method in first:
        row = next(line for line in text.splitlines() if line.startswith(f'| `"{method}"`')).split("|")
        assert [float(x) for x in row[4:6]] == [case[method] for case in shown], method


def test_figures_of_the_readme_are_those_measured():
    text, found = " ".join((ROOT / "README.md").read_text("utf-8").split()), kept("results")
    for figure in (*_figures_of_inverse_dynamics(found), *_figures_of_others(found), *_ranges(found)):
        assert figure in text, figure


def _best_build(timings: dict) -> float:
    return min(timing["median"] for name, timing in timings.items() if name.startswith("Pinocchio C++"))


def _figures_of_inverse_dynamics(found: dict) -> Iterator[str]:
    amd = found["robots"]["panda"]["quantities"]["inverse_dynamics"]["timings"]
    ours, loop = amd["twistwrench method, batch of 4096"]["median"], _best_build(amd)
    assert "AMD EPYC" in found["machine"]["cpu"] and "Intel" in found["generated"]["cpu"]
    batch, scalar, blocks, exported = (
        timing["median"] for timing in found["generated"]["robots"]["panda"]["inverse_dynamics"]["timings"].values()
    )
    narrow = kept("avx2/results")["robots"]["panda"]["quantities"]["inverse_dynamics"]["timings"]
    with_avx2 = _best_build(narrow) / narrow["twistwrench method, batch of 4096"]["median"]
    yield f"{batch:.1f} ns a state (Intel Xeon); {ours:.1f} ns (AMD EPYC)"
    yield f"eight states at a time {blocks:.1f} ns ({blocks / batch:.1f} ×), one at a time {scalar:.0f} ns ({scalar / batch:.1f} ×)"
    yield f"C++ in a loop, {loop:.0f} ns ({loop / ours:.0f} ×; [with AVX2](bench/avx2/RESULTS.md) only, {with_avx2:.0f} ×)"
    yield f"ours takes {exported:.0f} ns on the Intel Xeon"


def _figures_of_others(found: dict) -> Iterator[str]:
    one = found["robots"]["panda"]["quantities"]["inverse_dynamics"]["timings"]
    ours, theirs = (one[name]["median"] for name in ("twistwrench method, one state", "Pinocchio, Python call"))
    yield f"| {ours / 1e3:.2f} µs | Pinocchio from Python: {theirs / 1e3:.2f} µs |"
    ours, theirs = (found["rollout"]["batch"][name]["median"] for name in ("twistwrench", "MuJoCo"))
    yield f"| {ours:.1f} ns | `mujoco.rollout`, one thread, mechanics only: {theirs / 1e3:.2f} µs ({theirs / ours:.0f} ×) |"
    pose, batch = (found["inverse_kinematics"]["rows"][name] for name in ("one pose", "a batch of 4096"))
    ours, many = pose["ours"]["median"], batch["ours"]["median"]
    toolbox, ratio = pose["theirs"]["median"], batch["theirs"]["median"] / many
    yield f"| {ours / 1e3:.1f} µs a pose; {many / 1e3:.2f} µs in a batch |"
    yield f"pose by pose: {toolbox / 1e3:.0f} µs ({toolbox / ours:.0f} ×; {ratio:.0f} × the batch)"


def _ranges(found: dict) -> Iterator[str]:
    """Least and largest ratio over Pinocchio's loop, of arms, and of the humanoid at both sizes of batches."""

    def ratios(name: str) -> list[float]:
        measured = [
            each["timings"]
            for part in (found["robots"], found["derivatives"]["robots"])
            for each in part[name]["quantities"].values()
        ]
        return [
            _best_build(timings) / timing["median"]
            for timings in measured
            for way, timing in timings.items()
            if re.fullmatch(r"twistwrench method, batch of \d+", way)
        ]

    arms, humanoid = [*ratios("ur5"), *ratios("panda")], ratios("talos")
    assert len(arms) == 14 and len(humanoid) == 14
    yield f"1/{min(arms):.0f} to 1/{10 * round(max(arms) / 10)} of the time"
    yield f"1/{min(humanoid):.1f} to 1/{max(humanoid):.0f} for a humanoid"


def test_shares_of_intervals_are_those_measured():
    text, found = page("unsure"), kept("intervals")
    for name, kinds in found["peaks"]["rows"].items():
        shares = " | ".join(f"{100 * kind['held']:.0f} % ({kind['peaks']})" for kind in kinds.values())
        assert f"| {name} | {shares} |" in text
    every = found["peaks"]["all"]
    assert f"they held {100 * every['held']:.0f} % of {every['peaks']} peaks" in text
    for row in found["sensor"]:
        ends = [dict.fromkeys(f"{100 * x:.1f}" for x in row[key]) for key in ("bias", "mass", "first moment")]
        assert f"| {' | '.join('–'.join(x) for x in ends)} |" in page("sensor")


def test_exciting_motions_are_better_than_the_best_of_random_ones_as_measured():
    text, found = page("identification-method"), kept("excitation")
    for robot in ("ur5", "panda"):
        mine, best = found[robot]["found"], found[robot]["best of 500"]
        assert mine["condition"] <= best["condition"] and mine["worst deviation"] <= best["worst deviation"]
        assert mine["log det"] >= best["log det"]
        for name, x in (("found", mine), ("best of 500", best)):
            numbers = f"{x['condition']:.0f} | {100 * x['worst deviation']:.2f} % | {x['log det']:.0f}"
            assert f"| {robot}, {name} | {numbers} |" in text


def test_errors_of_a_real_arm_are_those_measured():
    text, found = page("calibration"), kept("calibration")["IRB 120 [mm]"]
    plain, sag = found["geometry"], found["sag"]
    assert f"off by {plain['before']} mm" in text and f"by {plain['held out']} mm, held out" in text
    assert f"by {sag['held out']} mm with sag" in text
    assert f"by {plain['30 separate']} and {sag['30 separate']} mm" in text
    twelve = kept("calibration")["planned [mm]"]["12"]
    assert twelve["chosen"]["median"] < 0.75 * twelve["random"]["median"]


def test_what_real_logs_leave_unexplained_is_what_was_measured():
    text, found = page("identification-method"), kept("real_logs")
    robot, one, other, simple = (
        found[name]["held out"]
        for name in (
            "TX40",
            "double pendulum, second from first",
            "double pendulum, first from second",
            "simple pendulum",
        )
    )
    assert f"fifths of the time: {100 * robot['all']:.1f} %" in text
    shoulder, elbow = ([100 * x["joints"][joint] for x in (one, other)] for joint in ("shoulder", "elbow"))
    assert f"shoulder {shoulder[0]:.1f} and {shoulder[1]:.1f} %, elbow {elbow[0]:.0f} and {elbow[1]:.0f} %" in text
    assert f"refused: {100 * simple['all']:.0f} % of the torques unexplained" in text
