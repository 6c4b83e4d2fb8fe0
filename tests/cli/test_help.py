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
@pytest.mark.parametrize("words, command", [c for c in commands() if c[0] not in (("identify",), ("log",))])
def test_the_examples_run_as_they_stand(words, command, tmp_path, monkeypatch):
    """All but those of logs that a user has to bring. Exit code 1 is an answer: no."""
    monkeypatch.chdir(tmp_path)
    for example in examples(command):
        done = CliRunner().invoke(main, example)
        assert done.exit_code in (0, 1), (example, done.output)


def test_a_commands_own_options_come_before_the_robots():
    for words, command in commands():
        if any(option.name == "floating_base" for option in command.params) and words != ("doctor",):
            own, _, shared = helped(*words).partition("Robot options:")
            assert "--floating-base" in shared and "Let the base move" not in shared, words
            assert "--floating-base" not in own, words
            whole = CliRunner().invoke(main, [*words, "--help-all"]).output.partition("Robot options:")[2]
            assert "Let the base move freely" in " ".join(whole.split()), words


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
