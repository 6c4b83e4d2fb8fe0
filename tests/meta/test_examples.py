"""Every example runs, and writes what it says it writes."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from places import ROOT

EXAMPLES = ROOT / "examples"


def test_the_intermediate_axis(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(EXAMPLES / "intermediate_axis.py"))
    example["main"](tmp_path, frames=2)
    assert (tmp_path / "intermediate_axis.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "intermediate_axis.gif").read_bytes().startswith(b"GIF")
    said = capsys.readouterr().out
    assert "drift over 1800 steps" in said
    assert [Path(line[6:]) for line in said.splitlines()[1:]] == [
        tmp_path / f"intermediate_axis.{s}" for s in ("png", "gif")
    ]


def test_the_intermediate_axis_hides_what_the_surfaces_hide():
    """Against rays walked point by point through the union of sphere and ellipsoid."""
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(EXAMPLES / "intermediate_axis.py"))
    I, energy, towards = example["I"], 1.0 / example["I"][1], np.array([0.6, 0.64, 0.48])
    rng = np.random.default_rng(0)
    points = rng.standard_normal((400, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= 1.01 * example["hull"](points, energy)[:, None]
    walked = points[:, None] + np.linspace(1e-3, 3, 3000)[:, None] * towards
    inside = ((walked**2).sum(axis=-1) < 1) | ((walked**2 / (energy * I)).sum(axis=-1) < 1)
    hidden = inside.any(axis=1)
    assert 100 < hidden.sum() < 300
    assert (example["visible"](points, towards, energy) == ~hidden).all()


def test_the_intermediate_axis_answers_help_and_refuses_what_is_no_folder(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "taken").write_text("")
    for argument, code, words in (("--help", 0, "usage: "), ("taken", 2, "cannot write to the folder taken")):
        done = subprocess.run(
            [sys.executable, EXAMPLES / "intermediate_axis.py", argument], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == code
        assert words in done.stdout + done.stderr
        assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["taken"]
