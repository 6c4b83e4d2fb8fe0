"""A reader that has ended, such as `head`, stops what is printed and nothing else."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from contextlib import redirect_stdout

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.verdict import ExitCode

ARM = tw.robots.planar_2r()


class Unread(io.StringIO):
    """A pipe whose reader has ended."""

    def write(self, text):
        raise BrokenPipeError(32, "Broken pipe")

    def fileno(self):
        raise OSError


@pytest.fixture
def log(tmp_path):
    t = np.arange(0, 4, 0.01)
    q = np.stack([np.sin(3 * t), np.cos(2 * t) - 0.3 * np.sin(5 * t)], axis=1)
    motion = tw.Motion(t, q, robot=ARM)
    tau = ARM.inverse_dynamics(motion.q, motion.dq, motion.ddq)
    return tw.Motion(t, q, tau=tau, robot=ARM).to_csv(tmp_path / "log.csv")


COMMANDS = {
    "torques": "torques planar_2r --trajectory {log} --csv {folder}/a.csv --json {folder}/b.json",
    "identify": "identify planar_2r {log} --csv {folder}/a.csv --json {folder}/b.json --out {folder}/c.urdf --cutoff 10 --shift 0 --force",
    "excite": "excite planar_2r --duration 4 --harmonics 1 --acceleration 5 --restarts 1 --csv {folder}/a.csv --json {folder}/b.json",
    "log": "log {log} --json {folder}/b.json",
    "payload": "payload planar_2r --json {folder}/b.json --csv {folder}/a.csv",
    "doctor": "doctor planar_2r --json {folder}/b.json",
    "simulate": "simulate planar_2r --duration 0.1 --csv {folder}/a.csv --json {folder}/b.json",
    "move": "move planar_2r --to 0.2,0.3 --duration 3 --csv {folder}/a.csv --json {folder}/b.json",
    "info": "info planar_2r --csv {folder}/a.csv",
}


SLOW = ("excite", "simulate", "move", "doctor")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in COMMANDS]
)
def test_files_are_written_although_nobody_reads_the_report(name, log, tmp_path):
    words = COMMANDS[name].format(log=log, folder=tmp_path).split()
    wanted = [word for word in words if word.startswith(str(tmp_path)) and word != str(log)]
    with redirect_stdout(Unread()), pytest.raises(SystemExit) as ended:
        main.main(words)
    assert ended.value.code == ExitCode.PIPE_CLOSED
    assert [path for path in wanted if not os.path.getsize(path)] == []


@pytest.mark.skipif(os.name != "posix", reason="pipes are POSIX's")
def test_a_pipe_of_the_system_that_is_closed_is_no_error(log, tmp_path):
    words = ["log", str(log), "--json", str(tmp_path / "b.json")]
    running = subprocess.Popen(
        [sys.executable, "-m", "twistwrench", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    running.stdout.close()
    assert running.wait() == ExitCode.PIPE_CLOSED
    assert running.stderr.read() == ""
    running.stderr.close()
    assert json.loads((tmp_path / "b.json").read_text())
