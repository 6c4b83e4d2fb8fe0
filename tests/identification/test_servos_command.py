"""``identify --from-commands`` is ``identify_servos``: the same data, files, and one error for what does not belong together."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("servo") / "log.csv"
    values = {"armature": 0.4, "damping": 3.0, "coulomb": 0.5, "kp": 90.0, "delay": 0.012}
    tw.identification.simulated_servo_log(tw.robots.planar_2r(), **values).to_csv(path)
    return path


def run(*words):
    return CliRunner().invoke(main, ["identify", *map(str, words)])


@pytest.mark.parametrize(
    ("words", "options"),
    [
        ([], {}),
        (
            ["--known", "joint1.kp=90 N m/rad", "--command-hold", "linear"],
            {"known": {"joint1.kp": 90.0}, "hold": "linear"},
        ),
    ],
)
def test_the_command_is_the_function(tmp_path, log, words, options):
    """Verdict, reasons, facts, sentences, tables and values with all digits; both files are written together."""
    done = run(
        "planar_2r", log, "--from-commands", *words, "--json", tmp_path / "a.json", "--out", tmp_path / "arm.xml",
        "--out-actuators", tmp_path / "arm.yaml",
    )  # fmt: skip
    robot = tw.robots.planar_2r()
    found = tw.identification.identify_servos(robot, tw.Motion.from_file(log, robot), **options)
    data, wanted = json.loads((tmp_path / "a.json").read_text()), json.loads(found.to_json())
    assert done.exit_code == int(found.verdict.exit_code) == 0, done.output
    assert all(data[name] == wanted[name] for name in ("verdict", "reasons", "facts", "sentences", "tables", "servos"))
    assert (
        abs(tw.load(tmp_path / "arm.xml").armature[0] - 0.4) < 0.01 and "armature" not in done.output.splitlines()[-1]
    )
    assert (tmp_path / "arm.yaml").read_text().strip()


def test_a_log_of_commands_leads_to_the_option(log):
    """Without torques ``identify`` names the option, and the option exists."""
    done = run("planar_2r", log)
    assert done.exit_code == 2 and "--from-commands identifies gains, friction and armature" in done.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--command-hold", "zero"], "belongs to --from-commands"),
        (["--from-commands", "--friction-model", "none"], "is for torques"),
        (["--from-commands", "--known", "joint1.m=1"], "no known value named 'joint1.m'"),
        (["--from-commands", "--known", "joint1.kp=1 kg"], "unit 'kg'"),
    ],
)
def test_options_that_do_not_belong_together_are_one_error(log, words, said):
    done = run("planar_2r", log, *words)
    assert done.exit_code == 2 and said in done.output.splitlines()[-1], done.output
