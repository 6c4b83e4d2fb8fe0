"""Output to files and pipes of systems whose encoding has no Greek letters, as Windows' code pages have none."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

COMMAND = (sys.executable, "-m", "twistwrench", "torques", "ur5", "--trajectory", "demo", "--payload", "5")


def said(**variables: str) -> subprocess.CompletedProcess[bytes]:
    ours = {k: v for k, v in os.environ.items() if k not in ("PYTHONUTF8", "PYTHONIOENCODING", "LC_ALL", "LANG")}
    return subprocess.run(COMMAND, capture_output=True, env=ours | variables, check=False)


@pytest.fixture(scope="module")
def expected() -> str:
    return said(PYTHONUTF8="1").stdout.decode("utf-8")


def test_a_pipe_gets_utf_8_whatever_the_locale(expected):
    done = said(LC_ALL="C", PYTHONCOERCECLOCALE="0", PYTHONUTF8="0")
    assert (done.returncode, done.stderr) == (0, b"")
    assert not expected.isascii()
    assert done.stdout.decode("utf-8").splitlines() == expected.splitlines()


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_an_encoding_that_was_asked_for_is_kept(expected, encoding):
    done = said(PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, b"")
    text = done.stdout.decode(encoding)
    assert text.splitlines()[0] == expected.splitlines()[0]
    assert "|shoulder_lift_joint | -114.6 |" in text and "-114.6" in expected
