"""``--json``: the report as data has the verdict, the exit code and the numbers that are printed, with all digits."""

from __future__ import annotations

import json
import math
import re

import pytest
from click.testing import CliRunner

from twistwrench.cli.main import main
from twistwrench.core.answers.blocks import Bar, Headline, Line, Table, numbers, remarks, words
from twistwrench.core.answers.data import report_data
from twistwrench.core.verdict import Word

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

COMMANDS = {
    "torques": ["torques", "ur5", "--trajectory", "demo", "--payload", "10", "--actuators", "demo", "--why", "--all"],
    "torques, many": ["torques", "ur5", "--trajectory", "LOGS"],
    "move": ["move", "ur5", "--to", "0.9,-0.9,1.0,-0.4,1.2,1.0", "--degrees"],
    "move --fastest": ["move", "planar_2r", "--to", "1,0.5", "--fastest", "--acceleration", "2"],
    "simulate": ["simulate", "planar_2r", "--duration", "0.1", "--at", "joint1=0.5", "--degrees"],
    "payload": ["payload", "ur5", "--at", "shoulder_lift_joint=-0.6"],
    "sensor identify": ["sensor", "identify", "demo"],
    "sensor compensate": ["sensor", "compensate", "demo-motion", "--sensor", "demo", "--contacts", "1e-6"],
    "sensor poses": ["sensor", "poses", "demo", "--count", "3"],
    "size": ["size", "ur5", "demo", "--catalog", "demo", "--pause", "0.8", "--masses-included"],
    "excite": [
        "excite",
        "planar_2r",
        "--acceleration",
        "3",
        "--duration",
        "4",
        "--harmonics",
        "1",
        "--restarts",
        "1",
        "--all",
    ],
    "identify": ["identify", "planar_2r", "demo", "--all"],
    "verify": ["verify", "planar_2r"],
    "convert": ["convert", "planar_2r", "planar.xml", "--overwrite"],
}
"""A call of each command whose report --json writes."""
TOKEN = re.compile(r"(?<![\w.])(-?\d+(?:\.(\d+))?(?:e([+-]\d+))?)( %)?")


def run(*arguments: str):
    result = CliRunner().invoke(main, arguments, env={"COLUMNS": "240"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (0, 1), result.output
    return result


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=[pytest.mark.slow] * (name == "size")) for name in COMMANDS]
)
def report(request, tmp_path_factory):
    """Name of a command, its result, and the JSON of the same call."""
    folder = tmp_path_factory.mktemp("json")
    log = "time,shoulder_lift_joint,elbow_joint\n" + "".join(f"{0.1 * k:.1f},{0.01 * k * k},0.5\n" for k in range(9))
    (folder / "logs").mkdir()
    for name in "ab":
        (folder / "logs" / f"{name}.csv").write_text(log)
    words = [
        {"LOGS": str(folder / "logs"), "planar.xml": str(folder / "p.xml")}.get(w, w) for w in COMMANDS[request.param]
    ]
    if "LOGS" in COMMANDS[request.param]:
        words.append("--lock-missing")
    result = run(*words, "--json", str(folder / "report.json"))
    return request.param, result, json.loads((folder / "report.json").read_text("utf-8"))


def test_the_verdict_and_the_exit_code_are_those_of_the_report(report):
    _, result, data = report
    assert data["exit_code"] == result.exit_code
    printed = " ".join(result.stdout.split())
    assert printed.startswith(data["verdict"])
    assert (data["verdict"] in ("OK", "DONE")) == (result.exit_code == 0)
    assert printed.startswith(" ".join(data["sentences"][0].split()))


def test_sentences_and_notes_are_those_printed(report):
    _, result, data = report
    printed = " ".join((result.stdout + result.stderr).split())
    assert data["sentences"] or data["verdict"] is None
    for sentence in (*data["sentences"], *data["notes"]):
        assert " ".join(sentence.split()) in printed


def _rows_below(title: str, heads: list[str], output: str) -> list[str]:
    """Lines of the printed table with this title, or with these heads."""
    lines = output.splitlines()
    wanted = [title] if title else [head for head in heads if head][:1]
    start = next(k for k, line in enumerate(lines) if line.strip().startswith(wanted[0]))
    rule = next(k for k in range(start, len(lines)) if lines[k].strip() and set(lines[k].strip()) <= {"─", " "})
    end = next((k for k in range(rule, len(lines)) if not lines[k].strip()), len(lines))
    return lines[rule + 1 : end]


def _shows(line: str, x: float) -> bool:
    """True if a number of the line is x to its own last digit, which may be rounded down."""
    for text, decimals, exponent, per_cent in TOKEN.findall(line):
        unit = 10.0 ** (int(exponent or 0) - len(decimals))
        scale = 0.01 if per_cent else 1.0
        if abs(float(text) * scale - x) <= unit * scale * (1.0 + 1e-9):
            return True
    return False


def test_numbers_round_to_those_printed_in_their_row(report):
    name, result, data = report
    assert data["tables"] or name == "convert"
    for table in data["tables"]:
        heads = [column["name"] for column in table["columns"]]
        lines = _rows_below(table["title"], heads, result.stdout)
        if name == "verify":  # some cells have two lines
            lines = [line for line in lines if line.strip().startswith(tuple(row[0] for row in table["rows"]))]
        assert len(lines) == len(table["rows"])
        for row, line in zip(table["rows"], lines, strict=True):
            assert len(row) == len(heads)
            for x in row:
                if isinstance(x, str):
                    assert all(word in line or name == "verify" for word in x.split())
                elif x is not None:
                    assert _shows(line, x), (table["title"], x, line)


def test_units_are_those_printed_and_shares_have_none(report):
    _, result, data = report
    for table in data["tables"]:
        for k, column in enumerate(table["columns"]):
            values = [row[k] for row in table["rows"]]
            if column["unit"]:
                assert all(x is None or isinstance(x, int | float) for x in values), column
                assert all(unit in result.stdout for unit in column["unit"].split(", "))
            if any(word in column["name"].split() for word in ("share", "used")):
                assert column["unit"] == ""


@pytest.mark.parametrize("name", ["verify", "convert"])
def test_a_hyphen_prints_the_json_alone(name, tmp_path):
    words = [str(tmp_path / "p.xml") if word == "planar.xml" else word for word in COMMANDS[name]]
    result = run(*words, "--json", "-")
    data = json.loads(result.stdout)
    assert data["command"][0] == name
    assert data["command"][-2:] == ["--json", "-"]


def test_a_file_is_replaced_with_overwrite_only(tmp_path):
    path = tmp_path / "report.json"
    path.write_text("mine")
    refused = CliRunner().invoke(main, ["verify", "planar_2r", "--json", str(path)])
    assert refused.exit_code == 2
    assert "--overwrite" in refused.output
    assert path.read_text() == "mine"


def test_what_is_not_finite_is_null_and_bars_are_their_numbers():
    share = numbers("of\nlimit", [0.5, math.nan])
    table = Table(
        "Torques [N m]",
        words("joint", ["a", "b"]),
        numbers("limit", [math.inf, 3], unit="N m", headed=False),
        numbers(
            "peak", [Line("1.23", (" / 4", "dim"), value=1.2345), "–"], unit="N m", headed=False, limits=[4.0, math.inf]
        ),
        words("share of limit", [Bar(0.5, "50 %"), Line(("–", "dim"))], narrow=share),
        words("", [Bar(0.5), Bar(0.1)]),
    )
    data = report_data([Headline(Word.OVER_LIMIT, "a.", further=[Line("b")]), "", table, *remarks(["Look."])])
    assert (data["verdict"], data["sentences"], data["notes"]) == ("OVER LIMIT", ["OVER LIMIT: a.", "b"], ["Look."])
    (found,) = data["tables"]
    assert [(c["name"], c["unit"]) for c in found["columns"]] == [
        ("joint", ""), ("limit", "N m"), ("peak", "N m"), ("peak limit", "N m"), ("share of limit", ""),
    ]  # fmt: skip
    assert found["rows"] == [["a", None, 1.2345, 4.0, 0.5], ["b", 3, None, None, None]]
