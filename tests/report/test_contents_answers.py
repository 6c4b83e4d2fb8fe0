"""Answers of ``info`` and ``log``: what the command prints and writes, as objects."""

import csv
import io
import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main

DEMO = tw.robots.path_of("ur5").with_name("ur5_demo.csv")


def command(*words):
    result = CliRunner().invoke(main, [*map(str, words)], env={"COLUMNS": "80"})
    assert result.exit_code == 0, result.output
    return result.stdout


def full(report):
    out = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        report.print(every=True, file=out)
    return out.getvalue()


@pytest.mark.parametrize(
    ("robot", "degrees"), [("ur5", False), ("ur5", True), ("planar_2r", False), ("quadruped", False), ("panda", True)]
)
def test_info_in_python_is_the_command(robot, degrees):
    report = tw.info(robot, degrees=degrees)
    assert report.verdict.word == "DONE" and report.verdict.ok and not report.headline
    words = ["info", robot, *["--degrees"] * degrees]
    assert full(report) == command(*words, "--all")
    assert max(len(str(report).splitlines()), len(command(*words).splitlines())) <= 45
    if not degrees:
        printed = json.loads(command("info", robot, "--json", "-"))
        data = report.to_dict()
        assert {key: printed[key] for key in data if key != "notes"} == {k: v for k, v in data.items() if k != "notes"}


@pytest.mark.parametrize("robot", ["ur5", "quadruped"])
def test_info_keeps_the_entries_of_the_robot(robot):
    robot = tw.load(robot)
    data = tw.info(robot).to_dict()
    assert {key: data[key] for key in robot.info()} == robot.info()
    assert data["robot"] == robot.name and data["call"] == "info"


def test_the_table_of_limits_of_info_is_what_limits_read(tmp_path):
    report = tw.info("ur5")
    path = report.to_csv(tmp_path / "limits.csv")
    command("info", "ur5", "--csv", tmp_path / "printed.csv")
    assert path.read_text("utf-8") == (tmp_path / "printed.csv").read_text("utf-8")
    assert tw.check("ur5", "demo", limits=path).headline == tw.check("ur5", "demo").headline
    with pytest.raises(tw.ValueRangeError, match=r"limits\.csv"):
        report.to_csv(path)


def test_the_full_form_of_info_and_its_page_have_all_links(tmp_path):
    report = tw.info("quadruped")
    page = report.to_html(tmp_path / "page.html").read_text("utf-8")
    table = report.tables["Links with mass, each in its own frame (kg, m, kg m²)"]
    for link in table.to_dict()["link"]:
        assert link in page
    assert "--all" not in page and ".print(" not in page


def written(folder, columns, count=400):
    rng, t = np.random.default_rng(0), np.arange(count) / 100
    rows = np.column_stack([t, *(np.sin((k + 1) * t) + 1e-3 * rng.normal(size=count) for k in range(columns))])
    with (folder / "log.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *(f"joint_{k}" for k in range(columns))])
        writer.writerows(rows.tolist())
    return folder / "log.csv"


@pytest.mark.parametrize("columns", [1, 6, 30])
def test_check_log_is_the_command(columns, tmp_path):
    path = written(tmp_path, columns)
    report = tw.check_log(path)
    assert report.verdict.word == "DONE" and report.verdict.exit_code == 0
    assert full(report) == command("log", path, "--all")
    (printed,) = json.loads(command("log", path, "--json", "-"))
    assert printed == json.loads(report.to_json())
    assert printed["rows"] == 400 and printed["rate"] == pytest.approx(100.0)
    assert [column["name"] for column in printed["columns"]] == [column.name for column in report.quality.columns]
    assert len(str(report).splitlines()) <= 45


def test_the_demo_log_is_described_alike():
    report = tw.check_log(DEMO)
    assert full(report) == command("log", DEMO, "--all")
    assert len(str(report).splitlines()) <= 45


@pytest.mark.parametrize(("head", "counted"), [("time,x", "1 row in 0 s"), ("x,y", "1 row, no column of time")])
def test_a_single_row_is_counted_in_the_singular(head, counted, tmp_path):
    (tmp_path / "log.csv").write_text(f"{head}\n0.5,1.5\n")
    assert counted in str(tw.check_log(tmp_path / "log.csv"))


def test_what_a_file_leaves_out_is_a_remark(tmp_path):
    (tmp_path / "log.csv").write_text("time,x,state\n" + "".join(f"{k / 10},{k % 7},run\n" for k in range(40)))
    report = tw.check_log(tmp_path / "log.csv")
    assert report.to_dict()["notes"] == ["Ignored, as they hold words: 'state'."]
    assert "! Ignored, as they hold words: 'state'." in re.sub(r"\s+", " ", str(report))


def test_bad_input_is_one_clear_error(tmp_path):
    with pytest.raises(tw.NotFoundError, match="no_such"):
        tw.check_log("no_such.csv")
    with pytest.raises(tw.NotFoundError, match="no_such"):
        tw.info("no_such.urdf")
