"""``tw.calibration.calibrate`` and the command ``calibrate`` give the same answer, also with a factory calibration."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.calibration import FactoryCalibration
from twistwrench.cli.main import main

DEMO = tw.robots.path_of("ur5").with_name("ur5_demo_calibration.csv")
RUNS = {
    "demo": (["demo"], {}, []),
    "one noise": (["demo"], {"noise": 5e-5}, ["--noise", "0.05mm"]),
    "two noises": (["demo"], {"noise": (5e-5, 1e-3)}, ["--noise", "0.05mm,1mrad"]),
    "accuracy": (["demo"], {"file_accuracy": (2e-3, 1e-3)}, ["--file-accuracy", "2mm,1mrad"]),
    "outliers": (["demo"], {"outliers": "keep"}, ["--keep-outliers"]),
    "sag": (["demo"], {"assume": "sag"}, ["--assume", "sag"]),
    "sag and gears": (["demo"], {"assume": ["sag", "gears"]}, ["--assume", "sag", "--assume", "gears"]),
    "test": (["first.csv"], {"test": ["last.csv"]}, ["--test", "last.csv"]),
    "two files": (["first.csv", "last.csv"], {}, []),
    "kind": (["first.csv"], {"kind": "position"}, ["--kind", "position"]),
    "tip": (["first.csv"], {"tip": "wrist_3_link"}, ["--tip", "wrist_3_link"]),
    "degrees": (["bare.csv"], {"degrees": True}, ["--degrees"]),
    "degrees taken for radians": (["bare.csv"], {}, []),
}
"""Files, arguments of the function, and words of the command."""
QUICK = {"demo", "outliers"}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Working folder with the first and the last readings of the demo, and with the first without units of angles."""
    monkeypatch.chdir(tmp_path)
    _, head, *rows = DEMO.read_text("utf-8").splitlines()
    first, last = rows[:30], rows[30:]
    for name, header, lines in (
        ("first", head, first),
        ("last", head, last),
        ("bare", head.replace(" [deg]", ""), first),
    ):
        (tmp_path / f"{name}.csv").write_text("\n".join([header, *lines]) + "\n")
    return tmp_path


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in RUNS])
def test_calibrate_is_the_command(name, folder):
    files, options, words = RUNS[name]
    result = CliRunner().invoke(main, ["calibrate", "ur5", *files, *words, "--json", "found.json"])
    assert result.exit_code in (0, 1), result.output
    printed = json.loads((folder / "found.json").read_text("utf-8"))
    answer = tw.calibration.calibrate("ur5", files, **options)
    data = json.loads(answer.to_json())
    assert answer.verdict.exit_code == result.exit_code
    assert {key: printed[key] for key in data.keys() - {"notes"}} == {key: data[key] for key in data.keys() - {"notes"}}
    assert len(str(answer).splitlines()) <= 45


def test_a_factory_calibration_is_an_answer_too(folder):
    lists = "\n".join(f"delta_{name} = [0, 0.001, 0, 0, 0, 0]" for name in ("theta", "a", "d", "alpha"))
    (folder / "calibration.conf").write_text(f"[mounting]\n{lists}\n")
    answer = FactoryCalibration.from_file(tw.robots.ur5(), "calibration.conf")
    words = ["calibrate", "ur5", "--from", "calibration.conf", "--out", "mine.urdf", "--json", "found.json"]
    result = CliRunner().invoke(main, words)
    assert (result.exit_code, answer.verdict.word) == (0, "DONE")
    printed, data = json.loads((folder / "found.json").read_text("utf-8")), json.loads(answer.to_json())
    assert {key: printed[key] for key in data} == data
    assert answer.headline in " ".join(result.output.split())
    moved = tw.load("mine.urdf").forward_kinematics(np.ones(6))
    np.testing.assert_allclose(moved, answer.robot.forward_kinematics(np.ones(6)), atol=1e-9)
    assert answer.write("other.urdf").read_bytes() == (folder / "mine.urdf").read_bytes()


def test_files_that_a_factory_calibration_has_not_are_not_written(folder):
    lists = "\n".join(f"delta_{name} = [0, 0, 0, 0, 0, 0]" for name in ("theta", "a", "d", "alpha"))
    (folder / "calibration.conf").write_text(f"[mounting]\n{lists}\n")
    words = ["calibrate", "ur5", "--from", "calibration.conf", "--csv", "a.csv", "--plot", "a.png"]
    assert CliRunner().invoke(main, words).exit_code == 0
    assert not [*folder.glob("a.*")]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("ur5", "Missing MEASUREMENTS"),
        ("ur5 demo --from calibration.conf", "in place of MEASUREMENTS"),
        ("ur5 demo --noise 3x", "--noise '3x' is not a length and an angle above 0"),
        ("ur5 demo --file-accuracy 1mm", "--file-accuracy '1mm' is not a length and an angle"),
        ("ur5 none.csv", "none.csv"),
        ("ur5 --from none.conf", "none.conf"),
        ("ur5 first.csv --csv first.csv", "would overwrite the file of MEASUREMENTS"),
        ("ur5 first.csv --test last.csv --out last.csv", "would overwrite the file of MEASUREMENTS"),
        ("ur5 demo --kind torque", "'torque' is not one of"),
    ],
)
def test_bad_options_are_one_line(words, said, folder):
    result = CliRunner().invoke(main, ["calibrate", *words.split()])
    assert result.exit_code == 2
    assert said in " ".join(result.output.split())
