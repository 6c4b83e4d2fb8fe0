"""What --help shows: a line for each command that is not cut off, examples that run, and the command's own options first."""

from __future__ import annotations

import re
import shlex

import click
import pytest
from click.testing import CliRunner

from twistwrench.cli.main import main


def commands(group=main, path=()):
    """Every command that is not a group, with the words that call it."""
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            yield from commands(command, (*path, name))
        else:
            yield (*path, name), command


def examples(command):
    return [
        line.split()[1:] and shlex.split(line)[1:]
        for line in (command.epilog or "").splitlines()
        if "twistwrench" in line
    ]


def helped(*words, width=80):
    done = CliRunner().invoke(main, [*words, "--help"], terminal_width=width, max_content_width=width)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize("words", [(), ("log",), ("sensor",)])
def test_no_summary_is_cut_off_in_a_narrow_terminal(words):
    assert "..." not in helped(*words).partition("Commands:")[2]


@pytest.mark.parametrize("words, command", list(commands()))
def test_every_command_shows_examples_of_itself(words, command):
    assert examples(command)
    assert all(tuple(example[: len(words)]) == words for example in examples(command))
    assert "Examples:\n    twistwrench " in helped(*words)


@pytest.mark.slow
@pytest.mark.parametrize("words, command", [c for c in commands() if c[0] not in (("identify",), ("log",), ("mcp",))])
def test_the_examples_run_as_they_stand(words, command, tmp_path, monkeypatch):
    """All but those of logs and folders that a user has to bring. Exit code 1 is an answer: no.

    A server of assistants would also confine this process to its folder: tests/cli/test_assistant_server.py starts its own.
    """
    monkeypatch.chdir(tmp_path)
    for example in examples(command):
        done = CliRunner().invoke(main, example)
        assert done.exit_code in (0, 1), (example, done.output)


HEADINGS = ("Question", "Reading the log", "Robot", "Writing")


@pytest.mark.parametrize(("words", "command"), list(commands()))
def test_the_help_has_an_option_a_line_under_headings_and_at_most_45_lines(words, command):
    lines = helped(*words).splitlines()
    assert len(lines) <= 45 and max(map(len, lines)) <= 100
    headings = [line[:-1] for line in lines if line.endswith(":") and not line.startswith(" ")]
    assert set(headings) <= {*HEADINGS, "Options", "Commands"}, headings
    assert [each for each in HEADINGS if each in headings] == [each for each in headings if each in HEADINGS]


@pytest.mark.parametrize(("words", "command"), list(commands()))
def test_the_whole_help_has_every_option(words, command):
    whole = CliRunner().invoke(main, [*words, "--help-all"]).output
    shown = set(re.findall(r"(?<=[\s/])--[a-z][\w-]*", whole))
    assert {p.opts[0] for p in command.params if isinstance(p, click.Option) and not p.hidden} <= shown


def test_every_command_that_reads_motions_chooses_their_topic_and_episode():
    named = {words: {option for p in command.params for option in p.opts} for words, command in commands()}
    reading = {words for words, options in named.items() if "--columns" in options} | {("log",)}
    assert {("torques",), ("identify",), ("size",), ("view",)} < reading
    assert not [words for words in reading if not {"--topic", "--episode"} <= named[words]]


@pytest.mark.parametrize("topic", ["assistant", "columns", "limits", "unsure", "verdicts", "robot"])
def test_topics_are_explained_without_links_to_files(topic):
    done = CliRunner().invoke(main, ["help", topic])
    assert done.exit_code == 0 and len(done.output.splitlines()) > 15
    assert not re.search(r"\]\((?!https?:)|^---$|^```\w+ ", done.output, re.MULTILINE)


OTHER_FORMS = {"--plot": "KIND= of torques", "--html": "derive prints it too", "--c": "derive prints it too"}
OTHER_FORMS |= {
    "--from": "a file of calibrate, a pose of move",
    "--kind": "of readings, of pictures",
    "--noise": "m and rad, or N m and N",
    "--plan": "a motion that is a plan, number of readings to plan",
}
"""Options whose values have another form in one of the commands."""


def test_no_option_name_has_two_meanings():
    """Options of one name take the same values, and their help begins with the same word."""
    forms, firsts = {}, {}
    for words, command in commands():
        for option in (p for p in command.params if isinstance(p, click.Option)):
            form = option.metavar, tuple(getattr(option.type, "choices", ())) if option.metavar is None else ()
            for name in (*option.opts, *option.secondary_opts):
                forms.setdefault(name, {}).setdefault((*form, option.multiple), []).append(words)
                firsts.setdefault(name, {}).setdefault(option.help.split()[0].rstrip(",:."), []).append(words)
    assert {name for name, found in forms.items() if len(found) > 1} <= set(OTHER_FORMS), forms
    assert not {name: found for name, found in firsts.items() if len(found) > 1}


def test_an_old_name_is_answered_by_the_new_one_where_it_exists():
    def said(*words):
        return CliRunner().invoke(main, words).stderr

    assert "Did you mean --torque-side?" in said("export", "ur5", "--torque", "motor")
    assert "Did you mean --weights?" in said("identify", "planar_2r", "demo", "--method", "ols")
    assert "Did you mean --torque-noise?" in said("excite", "planar_2r", "--noise", "1")
    assert "Did you mean --no-test-program?" in said("export", "ur5", "--no-test")
    assert "Did you mean --step?" in said("simulate", "ur5", "--dt", "0.1")
    assert "Did you mean --plot OUT.png --kind motors?" in said("torques", "ur5", "--motor-plot", "a.png")
    assert "--torque-side" not in said("payload", "ur5", "--torque", "motor")


def test_help_without_a_topic_lists_the_topics():
    found = CliRunner().invoke(main, ["help"])
    assert found.exit_code == 0
    assert all(
        f"{topic}:" in found.output for topic in ("columns", "limits", "unsure", "verdicts", "robot", "assistant")
    )


@pytest.mark.parametrize(
    ("words", "command"), list(commands()), ids=lambda value: " ".join(value) if type(value) is tuple else ""
)
def test_no_two_options_of_a_command_share_a_value(words, command):
    names = [param.name for param in command.params]
    assert len(set(names)) == len(names), sorted(name for name in names if names.count(name) > 1)
