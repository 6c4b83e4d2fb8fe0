"""The benchmark's section on one body and the groups: what it times, how its results are kept, and its table."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

pytest.importorskip("pinocchio", reason="the benchmark needs its peers")

ROOT = Path(__file__).parents[1]


@pytest.fixture
def bench(monkeypatch):
    """The benchmark's modules by name; they lie beside the package, not in it."""
    monkeypatch.syspath_prepend(str(ROOT))
    return lambda name: importlib.import_module(f"bench.{name}")


def kept() -> dict:
    results = json.loads((ROOT / "bench" / "results.json").read_text("utf-8"))
    results.pop("one_body", None)
    return results


def timing(median: float) -> dict[str, float]:
    return {"median": median, "low": 0.9 * median, "high": 1.2 * median, "minimum": 0.8 * median}


ROWS = {"so3.exp(w)": {"agreement": {"SciPy": 2e-16}, "timings": {"twistwrench": timing(50.0), "SciPy": timing(200.0)}}}
PART = {
    "date": "2026-11-21",
    "cpu": "some processor",
    "left_out": [1000000],
    "rounds": {"4096": 15},
    "rows": {"4096": ROWS},
}


def test_every_peer_computes_what_ours_does(bench):
    one_body = bench("one_body")
    names = set()
    for match in one_body.matches(500):
        names.add(match.name)
        ours = match.ours(*match.inputs)
        assert match.peers
        for peer in match.peers.values():
            assert bench("cases").difference(peer(*match.inputs), ours) < one_body.TOLERANCE
    assert len(names) == 6


def test_a_peer_that_disagrees_stops_the_benchmark(bench, monkeypatch):
    one_body = bench("one_body")
    match = next(one_body.matches(100))
    match.peers["wrong"] = lambda V, dV: 1.001 * match.ours(V, dV)
    monkeypatch.setattr(one_body, "matches", lambda size: iter([match]))
    with pytest.raises(SystemExit, match=r"wrong disagrees by 1\.0e-03"):
        one_body.times(1, sizes=(100,))


def test_sizes_that_memory_does_not_hold_are_left_out(bench, monkeypatch):
    one_body = bench("one_body")
    monkeypatch.setattr(one_body, "_free_bytes", lambda: 10**6)
    monkeypatch.setattr(one_body, "matches", lambda size: iter([]))
    found = one_body.times(2, sizes=(100, 10**6))
    assert found["left_out"] == [10**6]
    assert list(found["rows"]) == ["100"]


def test_the_table_says_how_many_times_faster(bench):
    text = bench("report").write({**kept(), "one_body": PART})
    assert "## One body and the groups, ns per row" in text
    assert "| `so3.exp(w)` | twistwrench | 50 [45–60] |" in text
    assert "|  | SciPy | 200 [180–240] **4.0 ×** |" in text
    assert "Not timed for want of memory: 1,000,000 rows." in text


def test_results_without_the_section_still_render(bench):
    text = bench("report").write(kept())
    assert "## Agreement" in text
    assert "One body" not in text


def test_only_one_body_leaves_the_other_results_alone(bench, monkeypatch, tmp_path, capsys):
    main = bench("__main__")
    (tmp_path / "results.json").write_text(json.dumps(kept()))
    monkeypatch.setattr(main, "HERE", tmp_path)
    monkeypatch.setattr(main, "pin_to_one_core", lambda: None)
    monkeypatch.setattr(bench("one_body"), "times", lambda rounds: {**PART, "rounds": {"4096": rounds}})
    monkeypatch.setattr("sys.argv", ["bench", "--only", "one_body", "--rounds", "7"])
    main.main()
    capsys.readouterr()
    found = json.loads((tmp_path / "results.json").read_text())
    assert found.pop("one_body")["rounds"] == {"4096": 7}
    assert found == kept()
    assert "7 rounds of 4,096 rows" in (tmp_path / "RESULTS.md").read_text("utf-8")
