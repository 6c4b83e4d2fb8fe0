"""One law of colours on every surface: red is beyond a limit, and never stands in a report that is OK or DONE."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.answers.blocks import limit_style, mark_style, word_cell
from twistwrench.core.colours import COLOURS, Style
from twistwrench.core.verdict import Word

RED = re.compile(r"\x1b\[(?:\d+;)*31(?:;\d+)*m")
CONTRAST = 4.5
"""Least contrast of text with its background (WCAG 2, level AA)."""


def luminance(colour: str) -> float:
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("style", COLOURS)
def test_text_in_every_colour_can_be_read_on_light_and_on_dark_paper(style):
    for text, paper in ((COLOURS[style].light, "#ffffff"), (COLOURS[style].dark, "#1e252d")):
        bright, dim = sorted((luminance(text), luminance(paper)), reverse=True)
        assert (bright + 0.05) / (dim + 0.05) >= CONTRAST


def test_a_share_is_green_then_amber_then_red_and_a_named_joint_is_blue_until_amber():
    assert [limit_style(x) for x in (0.5, 0.9, 1.0, 1.1)] == [Style.GOOD, Style.NEAR, Style.NEAR, Style.OVER]
    assert [mark_style(x) for x in (float("nan"), 0.5, 0.9, 1.1)] == [
        Style.POINTED,
        Style.POINTED,
        Style.NEAR,
        Style.OVER,
    ]


def test_only_an_accepting_word_is_without_warning_and_done_has_no_colour():
    styles = {word: word_cell(word).pieces[0][1] for word in Word}
    assert [word for word in Word if "good" in styles[word]] == [Word.OK]
    assert [word for word in Word if styles[word] == "strong"] == [Word.DONE]
    assert [word for word in Word if "near" in styles[word]] == [Word.UNSURE, Word.CONTACT]


ACCEPTED = {
    "torques": ("torques", "ur5", "--trajectory", "demo", "--payload", "5"),
    "move": ("move", "ur5", "--to", "0.9,-0.9,1.0,-0.4,1.2,1.0", "--fastest"),
    "payload": ("payload", "ur5", "--at", "shoulder_lift_joint=-0.6"),
    "simulate": ("simulate", "ur5", "--duration", "0.5"),
    "size": (
        "size",
        "ur5",
        "demo",
        "--catalog",
        "demo",
        "--payload",
        "5",
        "--pause",
        "0.8",
        "--ambient",
        "40",
        "--masses-included",
    ),
    "identify": ("identify", "planar_2r", "demo"),
}


SLOW = ("size", "identify")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in ACCEPTED]
)
def test_nothing_is_red_in_an_accepting_report(monkeypatch, name):
    """The joint nearest to its limit is amber or blue, and a passive fall is not judged."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    done = CliRunner().invoke(main, ACCEPTED[name], color=True)
    assert done.exit_code == 0, done.output
    assert "\x1b[" in done.stdout, "the report has no colours at all"
    assert not RED.search(done.stdout)


def test_red_is_in_a_report_over_a_limit(monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    done = CliRunner().invoke(main, ("torques", "ur5", "--trajectory", "demo", "--payload", "10"), color=True)
    assert done.exit_code == 1 and RED.search(done.stdout)


def test_torques_given_beyond_a_limit_are_over_limit_and_a_passive_fall_is_done():
    fall = CliRunner().invoke(main, ("simulate", "ur5", "--duration", "0.2"))
    given = CliRunner().invoke(main, ("simulate", "ur5", "--duration", "0.2", "--torque", "elbow_joint=500"))
    assert (fall.exit_code, fall.stdout[:5]) == (0, "DONE:")
    assert given.exit_code == 1 and given.stdout.startswith("OVER LIMIT: elbow_joint")


@pytest.mark.parametrize(
    "words",
    [
        ("move", "ur5", "--to", "40,-40,50,0,0,0", "--duration", "0.1"),
        ("simulate", "ur5", "--duration", "0.2", "--torque", "elbow_joint=500"),
        ("simulate", "ur5", "--duration", "3", "--stop-at-limits"),
    ],
    ids=("move", "simulate", "stop"),
)
def test_the_unit_of_the_question_is_the_unit_of_the_answer(words):
    done = CliRunner().invoke(main, (*words, "--degrees"))
    first = done.stdout.split("\n\n")[0]
    assert done.exit_code == 1 and "°" in first and " rad" not in first, first


def test_the_limit_of_a_sliding_joint_is_in_metres_whatever_the_angles_are_in(tmp_path):
    """A body of 1 kg falls by 0.2 m."""
    body = '<link name="body"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    (tmp_path / "lift.urdf").write_text(
        f'<robot name="lift"><link name="base"/>{body}<joint name="lift" type="prismatic"><parent link="base"/><child link="body"/>'
        '<axis xyz="0 0 1"/><limit lower="-0.2" upper="3" velocity="9" effort="99"/></joint></robot>'
    )
    asked = ("simulate", str(tmp_path / "lift.urdf"), "--duration", "0.5", "--stop-at-limits")
    for more in ((), ("--degrees",)):
        first = CliRunner().invoke(main, (*asked, *more)).stdout.split("\n\n")[0]
        assert "lift reached its lower position limit, -0.2 m" in " ".join(first.split()), first


def test_a_log_in_degrees_has_its_verdict_in_degrees(tmp_path):
    arm, t = tw.robots.ur5(), np.linspace(0.0, 4.0, 201)
    q = np.zeros((201, 6))
    q[:, 5] = 300 + 65 * (1 - np.cos(np.pi * t / 4)) / 2  # its stop is at 360 degrees
    header = "time," + ",".join(f"{name} [deg]" for name in arm.joint_names)
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([t, q]), delimiter=",", header=header, comments="", fmt="%.9g")
    first = CliRunner().invoke(main, ("torques", "ur5", "--trajectory", str(log))).stdout.split("\n\n")[0]
    assert "360" in first and "°" in first and " rad" not in first, first


def test_a_lossy_conversion_is_done_and_unsure_only_if_strict(tmp_path):
    lossy = ("convert", "panda", str(tmp_path / "a.xml"))
    done = CliRunner().invoke(main, lossy)
    strict = CliRunner().invoke(main, (*lossy, "--strict", "--overwrite"))
    assert (done.exit_code, done.stdout[:5]) == (0, "DONE:")
    assert (strict.exit_code, strict.stdout[:7]) == (1, "UNSURE:")


TABLES = ("core/colours.py", "viz/style.py", "viz/colours.py")
"""Meanings, colours of plots, and colours of scenes and articles."""
HEX = re.compile(r"[\"'`: ]#(?:[0-9a-fA-F]{8}|[0-9a-fA-F]{6}|[0-9a-fA-F]{3})\b(?!;?\d)")
NAMED = re.compile(
    r"(?:colou?rs?|fill|stroke|foreground|background|style)[\"']?\s*[=:]\s*[\"'](?:bold |dim )?([a-z_:0-9]+)[\"']"
)
NAMES = frozenset(
    [
        "black",
        "white",
        "red",
        "green",
        "blue",
        "yellow",
        "orange",
        "amber",
        "grey",
        "gray",
        "cyan",
        "magenta",
        "purple",
        "k",
        "w",
        "r",
        "g",
        "b",
        "c",
        "m",
        "y",
    ]
)


def test_colours_are_written_in_their_tables_alone():
    """No code and no script has a colour of its own; a style sheet has them as variables of its root."""
    package = Path(tw.__file__).parent
    found = []
    for path in sorted(package.rglob("*")):
        name = path.relative_to(package).as_posix()
        if name in TABLES or path.suffix not in (".py", ".js", ".css", ".html"):
            continue
        for k, line in enumerate(path.read_text("utf-8").splitlines(), 1):
            if path.suffix == ".css" and line.lstrip().startswith(":root {"):
                continue
            if HEX.search(line) or NAMES & set(NAMED.findall(line)):
                found.append(f"{name}:{k}: {line.strip()[:90]}")
    assert not found


def test_no_style_sheet_repeats_a_colour_that_has_a_meaning():
    """Over, near, good, pointed and quiet come from one table on every page."""
    own = {colour for each in COLOURS.values() for colour in (each.light, each.dark)}
    for path in Path(tw.__file__).parent.rglob("*.css"):
        variables = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6});", path.read_text("utf-8")))
        assert not {name for name, colour in variables.items() if colour in own and name in set(map(str, Style))}, path
