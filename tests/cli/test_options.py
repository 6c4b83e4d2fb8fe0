"""Options of a command are the parameters of its function: same names, defaults and help, from one declaration."""

from __future__ import annotations

import inspect
import json

import click
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.cli.parameters import SPELLINGS, parameters_of
from twistwrench.cli.shared import LOADING, RobotOptions
from twistwrench.diagnosis import doctor
from twistwrench.symbolic import derive
from twistwrench.testing.verify import verify

ASKED = {
    "torques": tw.check,
    "payload": tw.payload,
    "size": tw.size_drives,
    "move": tw.move,
    "doctor": doctor,
    "info": tw.info,
    "verify": verify,
    "derive": derive,
    "simulate": tw.Robot.simulate,
    "identify": tw.identify,
    "excite": tw.excite,
    "calibrate": tw.calibration.calibrate,
    "sensor identify": tw.sensing.identify,
    "sensor compensate": tw.sensing.compensate,
    "sensor poses": tw.sensing.propose_poses,
    "convert": tw.save,
    "export": tw.Robot.export_c,
    "robots": tw.robots.known,
}
NOT_TYPED = {
    "every": {"robot", "self", "motion", "log", "logs", "measurements", "progress"},
    "calibrate": {"seed"},
    "identify": {"friction_speed", "motor_side", "client"},
    "excite": {"velocity", "effort", "clear", "friction_speed"},
    "sensor identify": {"confidence"},
    "sensor compensate": {"noise", "uncertainty"},
    "sensor poses": {"candidates"},
    "size": {"draws"},
    "doctor": {"max_bodies"},
    "simulate": {"controller", "creep", "events", "atol", "max_step"},
    "convert": {"path", "overwrite"},
    "robots": {"word"},
}
"""Parameters that are no options: arguments, functions, arrays of arrays, and settings of programs."""
OF_ROBOT = {"actuators", "degrees", "overwrite", *LOADING.parameters}
"""Parameters whose help is that of all commands."""
OTHER = {
    "export": {"quantities": "--quantity", "path": "--c", "precision": "--float", "test": "--no-test-program"},
    "simulate": {
        "q0": "--at", "dq0": "--velocity", "tau": "--torque", "limits": "--stop-at-limits", "contacts": "--touch",
        "wrench_on_robot": "--wrench-on-robot", "friction": "--no-friction",
    },
    "identify": {"method": "--weights", "friction": "--friction-model"},
    "excite": {"friction": "--friction-model", "clear_of_itself": "--ignore-self", "noise": "--torque-noise"},
    "calibrate": {"outliers": "--keep-outliers"},
    "sensor identify": {"inertia": "--with-inertia", "outliers": "--keep-outliers"},
    "sensor compensate": {"false_alarms": "--contacts"},
    "sensor poses": {"within": "--within"},
}  # fmt: skip
"""Options that read what the shell types into arrays of the joints, or are spelled otherwise in one command."""


def options_of(name):
    command = main
    for word in name.split():
        command = command.get_command(click.Context(command), word)
    return {option: p for p in command.params if isinstance(p, click.Option) for option in p.opts}


@pytest.mark.parametrize("name", ASKED)
def test_every_parameter_of_the_function_is_an_option(name):
    options = options_of(name)
    for parameter in parameters_of(ASKED[name]).values():
        if parameter.name in NOT_TYPED["every"] | NOT_TYPED.get(name, set()):
            continue
        spelled = OTHER.get(name, {}).get(parameter.name)
        spelling = SPELLINGS.get(parameter.name)
        spelled = spelled or (spelling.form.partition(" ")[0] if spelling else parameter.flag)
        flags = {spelled} if parameter.default is not True else {spelled, f"--no-{parameter.flag[2:]}"}
        assert flags & options.keys(), (name, parameter.name)


@pytest.mark.parametrize("name", sorted(ASKED.keys() - {"simulate"}))
def test_every_option_is_a_parameter_or_of_the_robot_the_log_or_a_file(name):
    """Beside them there are the few that a row names, since only a shell has them."""
    of_robot = {"source", "actuators", "degrees", "chain", "not_floating_base", *LOADING.defaults} | {
        "lock_missing",
        "trajectory",
        "whole_report",
        "overwrite",
        "full_paths",
    }
    of_shell = {
        "torques": {"workers", "scheduler", "kind", "joints"},
        "export": {"st", "ros2", "payloads", "gravity_input", "style", "torque", "license"},
        "calibrate": {"factory_file", "plan", "towards", "floor"},
        "identify": {"workers", "scheduler", "force", "add", "from_commands", "command_hold"},
        "sensor identify": {"arm", "frame"},
        "sensor compensate": {"arm", "frame"},
    }.get(name, set())
    for option in options_of(name).values():
        known = {*parameters_of(ASKED[name]), *of_robot, *of_shell, "columns", "gain"}
        assert option.name in known or option.name.startswith("file_"), (name, option.name)


@pytest.mark.parametrize("name", ASKED)
def test_the_help_is_written_once_in_the_docstring(name):
    for parameter in parameters_of(ASKED[name]).values():
        option = options_of(name).get(parameter.flag)
        if option is not None and option.name == parameter.name and parameter.name not in OF_ROBOT:
            words = parameter.text.rstrip(".")
            if parameter.annotation == "bool" and parameter.default:
                words = f"Do not {words[0].lower()}{words[1:]}"
            assert (words and option.help.startswith(words)) or name == "simulate" or parameter.name in LOG, parameter


LOG = {"columns", "gain", "rate", "topic", "episode", "plan"}
"""Options of the log, whose text forms the shell explains."""


@pytest.mark.parametrize("name", ASKED)
def test_an_option_that_is_left_out_leaves_the_default_of_the_function(name):
    for parameter in parameters_of(ASKED[name]).values():
        option = options_of(name).get(parameter.flag)
        if option is not None and option.name == parameter.name and option.name not in OF_ROBOT:
            assert option.default in (None, False, ()) or type(option.default).__name__ == "Sentinel", parameter.name
            if isinstance(parameter.default, float | int) and parameter.default not in (True, False):
                assert f"[default: {parameter.default}]" in option.help, parameter.name


def test_few_options_are_spelled_otherwise_than_their_parameters():
    assert len(SPELLINGS) <= 10 and len({*OTHER["simulate"].values()}) <= 8
    functions = [*ASKED.values(), tw.load]
    every = {name for function in functions for name in inspect.signature(function).parameters}
    assert SPELLINGS.keys() <= every


def test_the_options_of_the_robot_are_the_parameters_of_load():
    """Their forms, defaults and help are those of its signature and docstring."""
    left_out = {"source", "format", "max_bodies", "snap", "gravity"}
    assert LOADING.parameters.keys() == inspect.signature(tw.load).parameters.keys() - left_out
    texts = {name: parameter.text.rstrip(".") for name, parameter in parameters_of(tw.load).items()}
    for command in ("torques", "convert", "view", "derive"):
        options = {p.name: p for p in options_of(command).values()}
        assert all(options[name].help.startswith(texts[name]) for name in LOADING.parameters), command
    loaded = RobotOptions.of(
        {
            **dict.fromkeys([*LOADING.parameters, "chain", "actuators", "not_floating_base"]),
            "source": "planar_2r", "mimic": "independent", "lock": ("joint1=0.5",), "not_floating_base": True,
        }
    )  # fmt: skip
    assert loaded.loading == {"mimic": "independent", "lock": {"joint1": 0.5}, "floating_base": False}
    assert loaded.load().joint_names == ("joint2",)


def test_a_value_of_the_shell_is_the_value_of_the_function(tmp_path):
    """Of each kind of option: texts, numbers with units, vectors, loads, choices, flags and files."""
    from click.testing import CliRunner

    out = tmp_path / "a.json"
    words = "move ur5 --by 0,0,0.1 --from elbow_joint=60 --payload 2,0,0,0.1@tool0 --scaling cubic --duration 1500ms --degrees"
    done = CliRunner().invoke(main, [*words.split(), "--no-friction", "--clearance", "--json", str(out)])
    answer = tw.move(
        "ur5", by=[0, 0, 0.1], start={"elbow_joint": 60}, payload="2,0,0,0.1@tool0", scaling="cubic", duration=1.5, degrees=True,
        friction=False, clearance=0.0,
    )  # fmt: skip
    import json

    shown, data = json.loads(out.read_text()), answer.to_dict()
    assert done.exit_code == int(answer.verdict.exit_code)
    assert {key: shown[key] for key in ("verdict", "reasons", "facts", "tables")} == {
        key: data[key] for key in ("verdict", "reasons", "facts", "tables")
    }


def test_joints_beside_a_chain_are_held_where_a_lock_says_and_else_at_neutral():
    """The largest payload of a shoulder depends on the bend of the elbow beside the chain."""

    def most(*words):
        found = CliRunner().invoke(main, ["payload", "ur5", *words, "--json", "-"])
        return json.loads(found.stdout)["sentences"]

    wrists = [f"--lock=wrist_{k}_joint=0" for k in (1, 2, 3)]
    chain = ["--chain", "base_link", "upper_arm_link"]
    bent = most(*chain, "--lock", "elbow_joint=1.0")
    assert bent == most(*wrists, "--lock", "elbow_joint=1.0")
    assert most(*chain) == most(*wrists, "--lock", "elbow_joint=0") != bent


def test_the_bundled_motion_is_not_read_in_degrees():
    refused = CliRunner().invoke(main, ["torques", "ur5", "demo", "--degrees"])
    assert refused.exit_code == 2
    assert "the bundled motion 'demo' is in radians" in refused.stderr
