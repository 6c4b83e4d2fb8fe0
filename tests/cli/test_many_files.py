"""Folders of files in `torques`, `identify` and `log info`: each file reported, failed ones too, whoever works on them."""

from __future__ import annotations

import csv
import json
import os
import signal
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from identification_logs import known_log
from motions import report_of, write_positions

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.third_party.workers import Failure, Workers, workers_of
from twistwrench.motion.limits_file import read_limits
from twistwrench.motion.load_case import Payload

ARM = tw.robots.planar_2r()
pytestmark = pytest.mark.filterwarnings("ignore")  # of Dask's processes that end


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three logs, one cut in the middle of a row, and one of another robot."""
    path = tmp_path_factory.mktemp("logs")
    for seed in (1, 2, 3):
        known_log(ARM, seed, seconds=12.0, rate=100.0).motion.to_csv(path / f"log{seed}.csv")
    text = (path / "log3.csv").read_text()
    (path / "log3.csv").write_text(text[: len(text) // 2].rpartition(",")[0] + "\n")
    (path / "other.csv").write_text("time,elbow\n0,1\n1,2\n2,3\n")
    return path


@pytest.fixture(scope="module")
def team():
    pytest.importorskip("distributed")
    with workers_of(2) as found:
        yield found


def fails_once(path):
    """Takes its process with it the first time."""
    if not os.path.exists(path):
        open(path, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return 7


def refuses(value):
    if value < 0:
        raise tw.ValueRangeError("below zero")
    return value


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="has no such signals")
def test_a_killed_worker_loses_nothing(team, tmp_path):
    assert list(team.results(fails_once, [str(tmp_path / "begun")])) == [7]


def test_results_come_in_order_and_failures_stay_their_own(team):
    for workers in (Workers(), team):
        found = list(workers.results(refuses, [1, -1, 3]))
        assert found == [1, Failure("below zero"), 3]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="has no such signals")
def test_bits_do_not_depend_on_workers_nor_on_their_death(team, tmp_path):
    logs = [known_log(ARM, seed, seconds=20.0, rate=200.0).motion.to_csv(tmp_path / f"{seed}.csv") for seed in range(6)]
    alone = tw.identification.identify(ARM, logs, cutoff=8.0)
    killed = []

    def kill(share):
        if share > 0.05 and not killed:
            killed.append(team.client.submit(os.getpid, pure=False).result())
            os.kill(killed[0], signal.SIGKILL)

    shared = tw.identification.identify(ARM, logs, cutoff=8.0, client=team.client, progress=kill)
    assert killed
    np.testing.assert_array_equal(shared.values, alone.values)
    np.testing.assert_array_equal(shared.standard_deviations, alone.standard_deviations)


def test_identify_reports_a_log_that_it_leaves_out(folder, tmp_path):
    out = tmp_path / "found.json"
    result = run("identify", "planar_2r", folder, "--cutoff", 8, "--json", out)
    assert result.exit_code == 1, result.output
    found = json.loads(out.read_text())
    left = [d["sentence"] for d in found["doubts"] if d["kind"] == "left-out"]
    assert found["verdict"] == "UNSURE" and len(left) == 2
    assert "log3.csv" in left[0] and "other.csv" in left[1]


def test_torques_of_a_folder(folder, tmp_path):
    table = tmp_path / "table.csv"
    result = run("torques", "planar_2r", "--trajectory", folder, "--csv", table)
    assert result.exit_code == 1, result.output
    rows = table.read_text().splitlines()
    assert [row.split(",")[1] for row in rows[1:]].count("failed") == 2 and len(rows) == 5
    assert run("torques", "planar_2r", "--trajectory", folder, "--plot", tmp_path / "a.png").exit_code == 2
    before = {path: path.read_bytes() for path in folder.iterdir()}
    (log, *_) = [path for path in before if path.suffix == ".csv"]
    assert run("torques", "planar_2r", "--trajectory", folder, "--csv", log, "--overwrite").exit_code == 2
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_columns_may_be_those_of_one_file_of_a_folder(tmp_path):
    """The other file of it has columns named as the joints."""
    rows = "".join(f"{0.1 * k:.1f},{0.01 * k * k:.2f},{0.02 * k:.2f}\n" for k in range(20))
    (tmp_path / "plain.csv").write_text(f"time,joint1,joint2\n{rows}")
    (tmp_path / "other.csv").write_text(f"time,p1,p2\n{rows}")
    table = tmp_path / "table.csv"
    asked = "other.csv:joint1=p1,other.csv:joint2=p2"
    result = run("torques", "planar_2r", tmp_path / "*.csv", "--columns", asked, "--csv", table)
    lines = [line.split(",") for line in table.read_text().splitlines()[1:]]
    assert len(lines) == 2 and lines[0][1:] == lines[1][1:], result.output
    assert "failed" not in table.read_text()


def test_every_file_of_a_folder_is_judged_as_the_options_say(tmp_path):
    """As it would be alone: with its payload, against the limits of a file, noise taken off."""
    folder, rng, t = tmp_path / "motions", np.random.default_rng(0), np.arange(400) * 5e-3
    folder.mkdir()
    paths = [
        write_positions(folder / f"{k}.csv", ARM, t, np.sin(np.outer(t, (k, 2))) + 1e-5 * rng.normal(size=(400, 2)))
        for k in (1, 3)
    ]
    limits, table = tmp_path / "limits.csv", tmp_path / "table.csv"
    limits.write_text("joint,effort\njoint2,7\n")
    options = ("--smooth", "--payload", "1.5", "--limits", limits, "--csv", table)
    assert run("torques", "planar_2r", "--trajectory", folder, *options).exit_code == 1
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for path, row in zip(paths, rows, strict=True):
        found = report_of(ARM, path, smoothing=True, payloads=(Payload(1.5),), limits=read_limits(limits, ARM.model))
        worst = found.joints[found.worst]
        assert (row["joint"], float(row["peak"]), float(row["limit"])) == (worst.joint, worst.peak, worst.limit)
        assert (worst.joint, worst.limit) == ("joint2", 7.0)


def test_log_info_of_a_folder_reports_what_cannot_be_read(folder):
    result = run("log", folder, "--json", "-")
    assert result.exit_code == 2 and "log3.csv" in result.stderr
    assert [os.path.basename(q["path"]) for q in json.loads(result.stdout)] == ["log1.csv", "log2.csv", "other.csv"]


def test_a_scheduler_that_is_not_there(folder, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("twistwrench.core.third_party.workers._CONNECTION_TIMEOUT", 0.5)
    result = run("identify", "planar_2r", folder / "log1.csv", "--scheduler", "tcp://127.0.0.1:9")
    assert result.exit_code == 2 and "no Dask scheduler answers at 'tcp://127.0.0.1:9'" in result.output
    both = run("identify", "planar_2r", folder / "log1.csv", "--scheduler", "tcp://127.0.0.1:9", "--workers", 2)
    assert both.exit_code == 2 and "Choose one" in both.output
