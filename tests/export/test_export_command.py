"""The export command: the files it writes, what it prints, its options and its exit codes."""

from __future__ import annotations

import json
import pickle
import shlex
import shutil
import subprocess

import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        result = CliRunner().invoke(main, ["export", *map(str, arguments)])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result.exit_code, result.output

    return run


def test_it_writes_what_the_library_writes(run, tmp_path):
    code, output = run("planar_2r", "--c", "arm.c")
    assert code == 0, output
    (tmp_path / "other").mkdir()
    for file in tw.robots.planar_2r().export_c("inverse_dynamics", tmp_path / "other" / "arm.c"):
        assert (tmp_path / file.name).read_text() == file.read_text()
        assert file.name in output
    assert output.startswith("DONE: wrote arm.c.")


def test_written_files_are_a_tuple_and_an_answer(tmp_path):
    robot = tw.robots.planar_2r()
    exports = [
        robot.export_c("inverse_dynamics", tmp_path),
        robot.export_st("inverse_dynamics", tmp_path),
        robot.export_ros2(tmp_path / "arm_dynamics"),
    ]
    for written, name in zip(exports, ("planar_2r.c", "planar_2r.st", "arm_dynamics"), strict=True):
        assert isinstance(written, tw.Written) and isinstance(written, tuple) and written
        assert all(file.is_file() for file in written) and written.path == tmp_path / name
        assert (str(written.verdict.word), written.verdict.exit_code, written.robot_name) == ("DONE", 0, "planar_2r")
        assert str(written).startswith(f"DONE: wrote {written.path}.".split("/")[0])
        files = written.to_dict()["tables"][0]["rows"]
        assert len(files) == len(written)
        copied = pickle.loads(pickle.dumps(written))
        assert (copied, copied.path) == (written, written.path)


@pytest.mark.parametrize(
    ("options", "export"),
    [
        (["--c", "arm.c"], lambda robot, folder: robot.export_c("inverse_dynamics", folder / "arm.c")),
        (["--st", "arm.st"], lambda robot, folder: robot.export_st("inverse_dynamics", folder / "arm.st")),
        (["--ros2", "arm_dyn"], lambda robot, folder: robot.export_ros2(folder / "arm_dyn")),
    ],
)
def test_the_data_of_the_command_are_those_of_the_function(options, export, run, tmp_path):
    code, output = run("planar_2r", *options, "--json", "answer.json")
    assert code == 0 and output.endswith("wrote answer.json\n"), output
    (tmp_path / "other").mkdir()
    told, found = json.loads((tmp_path / "answer.json").read_text()), export(tw.robots.planar_2r(), tmp_path / "other")
    assert {key: told[key] for key in ("call", "robot", "verdict", "exit_code", "tables")} == {
        key: found.to_dict()[key] for key in ("call", "robot", "verdict", "exit_code", "tables")
    }
    code, output = run("planar_2r", options[0], f"new_{options[1]}", "--json", "-")
    assert code == 0 and json.loads(output)["call"] == "export"


def test_a_folder_takes_files_of_the_robots_name(run, tmp_path):
    (tmp_path / "out").mkdir()
    code, output = run("planar_2r", "--c", "out", "--no-test-program", "--prefix", "two")
    assert code == 0, output
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["two.c", "two.h"]
    assert "to check it" not in output


def test_options_of_a_quantity_follow_its_name(run, tmp_path):
    code, output = run(
        "ur5", "--c", "ur5.c", "--float", "--no-test-program",
        "--quantity", "jacobian:frame=wrist_3_link,kind=space",
        "--quantity", "bias_forces:wrenches=tool0+forearm_link,gravity=input",
        "--quantity", "task_inertia:rows=vx+vz",
    )  # fmt: skip
    assert code == 0, output
    text = (tmp_path / "ur5.h").read_text()
    assert "void ur5_jacobian_wrist_3_link_space(const float q[6], float J[36]);" in text
    assert "ur5_bias_forces_wrench_tool0_wrench_forearm_link_gravity_input(" in text
    assert "void ur5_task_inertia_tool0_body_vx_vz(const float q[6], float Lambda[4], float pivots[2]);" in text


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler: cc is not on the path")
def test_the_command_it_prints_checks_the_export(run):
    code, output = run("planar_2r", "--c", "a robot.c", "--quantity", "mass_matrix")
    assert code == 0, output
    command = output.splitlines()[-1].removeprefix("to check it: ")
    assert "ok   planar_2r_mass_matrix, M" in subprocess.run(command, shell=True, capture_output=True, text=True).stdout
    assert shlex.split(command)[0] == "cc"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--c", "arm.c", "--quantity", "mass"], ["no quantity named 'mass'", "mass_matrix"]),
        (["--c", "arm.c", "--quantity", "jacobian:frame"], ["'frame' is not OPTION=VALUE"]),
        (["--c", "arm.c", "--quantity", "jacobian:"], ["is not OPTION=VALUE"]),
        (["--c", "arm.c", "--quantity", "jacobian:kind=body,kind=space"], ["kind is given twice"]),
        (["--c", "arm.c", "--quantity", "mass_matrix:color=red"], ["takes no option 'color'"]),
        (["--c", "nowhere/arm.c"], ["'nowhere/arm.c'", "no such folder"]),
        (["--c", "nowhere"], ["--c 'nowhere'", "neither a folder", "planar_2r.c"]),
        (["--c", "arm.c", "--prefix", "2r"], ["--prefix 2r", "letter first"]),
        ([], ["--c"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, words, run, tmp_path):
    code, output = run("planar_2r", *arguments)
    assert code == 2 and len(output.strip().splitlines()) == 1, output
    assert all(word in output for word in words), output
    assert not list(tmp_path.iterdir())


def test_no_file_that_was_read_is_overwritten(run, tmp_path):
    shutil.copy(tw.robots.path_of("planar_2r"), tmp_path / "arm.h")
    before = (tmp_path / "arm.h").read_bytes()
    code, output = run("arm.h", "--c", "arm.c")
    assert code == 2 and "overwrite the file of" in output, output
    assert (tmp_path / "arm.h").read_bytes() == before
    motors = tmp_path / "motors.c"
    motors.write_text("actuators: {joint1: {friction: {viscous: 1 N m s/rad}}}")
    code, output = run("planar_2r", "--actuators", "motors.c", "--c", "motors.c")
    assert code == 2 and "overwrite the file of --actuators" in output, output
    assert motors.read_text().startswith("actuators")


def test_inputs_to_differentiate_by_and_parameters_are_joined_by_plus(run, tmp_path):
    options = "by=q+parameters,parameters=link2.mass+joint2.x"
    code, output = run("planar_2r", "--c", "arm.c", "--quantity", f"inverse_dynamics:{options}")
    assert code == 0, output
    text = (tmp_path / "arm.h").read_text()
    assert "planar_2r_inverse_dynamics_by_q_parameters(" in text and "double parameters[2]" in text
