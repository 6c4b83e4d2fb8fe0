"""What the questions share: a folder of their own, the shell, and the comparison with the output that docs/questions.md shows."""

from __future__ import annotations

import functools
import runpy
import shlex
from collections.abc import Callable, Iterator

import pytest
from click.testing import CliRunner
from places import ROOT

from twistwrench.cli.main import main

OUTPUTS = runpy.run_path(str(ROOT / "docs" / "outputs.py"))


QUESTIONS = runpy.run_path(str(ROOT / "docs" / "questions.py"))


@functools.cache
def outputs_shown() -> dict[str, str]:
    return QUESTIONS["outputs_shown"](QUESTIONS["PAGE"].read_text("utf-8"))


@pytest.fixture(autouse=True)
def output_is_that_of_the_page(
    request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str], tmp_path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Run in an empty folder; afterwards compare what was printed with the page, or hand it to docs/questions.py."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    yield
    printed = "".join(f"{line.rstrip()}\n" for line in capsys.readouterr().out.splitlines())
    place = f"{request.path.name}::{request.node.name}"
    writer = request.config.pluginmanager.get_plugin("questions")
    if writer is not None:
        writer.outputs[place] = printed
        return
    shown = outputs_shown()[place]
    assert OUTPUTS["agree"](shown, printed), f"shown:\n{shown}\nprinted:\n{printed}\nrun `python docs/questions.py`"


@pytest.fixture
def shell() -> Callable[..., str]:
    """Run a command as a user would; print the first lines of its output and return all of it."""

    def run(command: str, *, lines: int = 1, code: int = 0) -> str:
        program, *arguments = shlex.split(command)
        assert program == "twistwrench"
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == code, result.output
        print("\n".join(line.strip() for line in result.output.strip().splitlines()[:lines]))
        return result.output

    return run
