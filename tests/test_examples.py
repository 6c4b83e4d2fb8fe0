"""Every example runs, and writes what it says it writes."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"


def test_the_intermediate_axis(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    example = runpy.run_path(str(EXAMPLES / "intermediate_axis.py"))
    example["main"](tmp_path, frames=2)
    assert (tmp_path / "intermediate_axis.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "intermediate_axis.gif").read_bytes().startswith(b"GIF")
    assert "drift over 1800 steps" in capsys.readouterr().out
