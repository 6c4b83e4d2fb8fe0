"""Writing a robot gives a list of lost properties that is also the answer of ``convert``."""

import json

import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main


@pytest.mark.parametrize(
    ("robot", "name", "strict"),
    [("planar_2r", "a.xml", False), ("panda", "a.urdf", False), ("ur5", "a.sdf", False), ("panda", "a.xml", True)],
)
def test_the_function_and_the_command_give_the_same_answer(robot, name, strict, tmp_path):
    path, data = tmp_path / name, tmp_path / "answer.json"
    result = CliRunner().invoke(main, ["convert", robot, str(path), "--json", str(data), *["--strict"] * strict])
    printed, text = json.loads(data.read_text("utf-8")), path.read_text("utf-8")
    saved = tw.save(tw.load(robot), path, overwrite=True, strict=strict)
    assert path.read_text("utf-8") == text
    assert saved.verdict.exit_code == result.exit_code == printed["exit_code"]
    assert result.output.startswith(saved.headline)
    for key in ("verdict", "reasons", "sentences", "call", "robot"):
        assert saved.to_dict()[key] == printed[key], key


def test_it_is_a_list_with_a_verdict(tmp_path):
    saved = tw.save(tw.robots.planar_2r(), tmp_path / "arm.urdf")
    assert isinstance(saved, list) and saved == [] and not saved and saved.path == tmp_path / "arm.urdf"
    assert saved.verdict.word == "DONE" and str(saved).startswith("DONE: wrote ")
    lost = type(saved)(["the tip is not kept"], tmp_path / "arm.urdf", "arm", strict=True)
    assert lost and lost.verdict.word == "UNSURE" and lost.verdict.exit_code == 1
    assert json.loads(lost.to_json())["ok"] is False
    kept = type(saved)(["the tip is not kept"], tmp_path / "arm.urdf", "arm")  # nobody asked for all of it
    assert kept and kept.verdict.word == "DONE" and kept.verdict.exit_code == 0
