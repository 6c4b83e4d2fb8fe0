"""The benchmark: what its sections time, what stops it, what it makes of the results, and where it keeps them."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

pytest.importorskip("pinocchio", reason="the benchmark needs its peers")


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
    alone = found.pop("timed_alone")["one_body"]
    assert found.pop("one_body")["rounds"] == {"4096": 7}
    assert found == kept()
    text = (tmp_path / "RESULTS.md").read_text("utf-8")
    assert "7 rounds of 4,096 rows" in text
    assert f"- **one body** alone: {alone['date']}, {alone['cpu']} (" in text.partition("\n## ")[0]


def test_without_its_peers_the_benchmark_says_what_to_install():
    """In a process whose search for packages finds no Pinocchio."""
    hidden = "import sys; sys.modules['pinocchio'] = None; import runpy; runpy.run_module('bench', run_name='__main__')"
    ended = subprocess.run([sys.executable, "-c", hidden], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.strip() == 'the benchmark needs its peers: pip install -e ".[peers]"'


# ── one call, and fresh results ──


def test_one_call_is_made_in_every_way_and_shown(bench, monkeypatch, capsys):
    one_call = bench("one_call")
    monkeypatch.setattr(one_call, "STATES", 2)
    monkeypatch.setattr(one_call, "WARM", 4)
    monkeypatch.setattr(one_call, "interleave", lambda pair, rounds: {c.name: (c.sweep(1), Timed())[1] for c in pair})
    monkeypatch.setattr(one_call, "asdict", lambda timed: timing(100.0 if timed else 0.0))
    found = one_call.times(1, [case for case in bench("cases").CASES if case.name == "panda"])
    capsys.readouterr()
    assert "inverse dynamics with a wrench" in found["robots"]["panda"]
    text = bench("report").write({**kept(), "one_call": found})
    assert "| panda | jacobian, frame= | 100 ns [90.0–120] | 100 ns [90.0–120] | **1** |" in text


class Timed:
    pass


@pytest.mark.slow
def test_fresh_results_are_measured_in_processes_of_their_own(bench, monkeypatch, capsys):
    fresh = bench("fresh")
    monkeypatch.setattr(fresh, "ASKED", (("panda", "inverse_dynamics_derivatives", 200), ("talos", "mass_matrix", 10)))
    monkeypatch.setattr(fresh, "SECONDS", 0.0)
    run = fresh.subprocess.run
    monkeypatch.setattr(fresh.subprocess, "run", lambda *given, **more: run(*given, **more, cwd=ROOT))
    found = fresh.times(("panda",))
    capsys.readouterr()
    (row,) = found["rows"]
    assert all(row[way]["median"] > 0 for way in ("fresh", "held", "out"))
    text = bench("report").write({**kept(), "fresh": found})
    assert "| panda | ∂τ/∂(q, dq) | 200 |" in text


# ── derivatives, float32, limits, compiling ──


@pytest.fixture
def panda(bench, monkeypatch):
    """The panda with a small batch, and no C++ compiled for the occasion."""
    monkeypatch.setattr(bench("peer_pinocchio_cpp"), "builds", lambda: ([], {"Pinocchio C++": "not in tests"}))
    return replace(next(c for c in bench("cases").CASES if c.name == "panda"), batch=64)


@pytest.mark.slow
def test_derivatives_agree_with_pinocchio_and_make_tables(bench, panda, capsys):
    found = bench("derivatives").times(1, (panda,), size=64)
    quantities = found["robots"]["panda"]["quantities"]
    assert set(quantities) == set(bench("cases").DERIVATIVES)
    for each in quantities.values():
        assert 0 < each["agreement"]["twistwrench, snap=0"] < 1e-10
        assert all(timing["median"] > 0 for timing in each["timings"].values())
        assert "twistwrench method, batch of 64, out=" in each["timings"]
    text = bench("report").write({**kept(), "derivatives": found})
    assert "## Derivatives: Panda" in text
    assert "| **twistwrench method, batch of 64** |" in text
    assert "| MuJoCo, Python call | – | – |" in text
    assert "| panda | ∂ddq/∂(q, dq, τ) |" in text  # its operations


@pytest.mark.parametrize("matrix", [0, 1, 2])
def test_a_wrong_derivative_stops_the_benchmark(bench, panda, monkeypatch, capsys, matrix):
    ours = bench("ours").Ours
    right = ours.evaluate

    def wrong(self, quantity, states):
        values = right(self, quantity, states)
        values[5, matrix, 2, 3] *= 1 + 1e-6
        return values

    monkeypatch.setattr(ours, "evaluate", wrong)
    peers = bench("side_by_side").ours_and_pinocchio(panda, [], {})
    states = bench("cases").States.random(panda, 8)
    with pytest.raises(SystemExit, match="disagree about forward_dynamics_derivatives"):
        bench("side_by_side").agreement(panda, peers, "forward_dynamics_derivatives", states)


def test_the_inverse_mass_matrix_of_pinocchio_is_completed(bench):
    whole = np.array([[[2.0, 1.0], [1.0, 3.0]]])
    three = np.stack([whole, whole + 1, np.triu(whole)], axis=1)
    completed = bench("peer_pinocchio").completed("forward_dynamics_derivatives", three)
    assert np.array_equal(completed, np.stack([whole, whole + 1, whole], axis=1))


def test_a_small_matrix_is_not_judged_by_a_large_one(bench):
    reference = np.stack([np.full((1, 2, 2), 1e6), np.ones((1, 2, 2))], axis=1)
    values = reference.copy()
    values[0, 1, 0, 0] += 1e-3
    assert bench("cases").difference(values, reference) == pytest.approx(1e-3)


@pytest.mark.slow
def test_float32_is_near_float64_and_the_anchor_stays_in_float64(bench, panda, monkeypatch, capsys):
    float32 = bench("float32")
    monkeypatch.setattr(float32, "COMPARED", ("inverse_dynamics", "inverse_dynamics_derivatives"))
    found = float32.times(1, (panda,), size=64)
    for each in found["robots"]["panda"]["quantities"].values():
        assert 1e-9 < each["median"] <= each["worst"] < 1e-4  # some units of 6e-8, more where terms cancel
        each["timings"]["Pinocchio C++, some build"] = timing(1000.0)
        each["timings"]["twistwrench method, float32"] = timing(10.0)
        each["timings"]["twistwrench method, float64"] = timing(25.0)
    text = bench("report").write({**kept(), "float32": found})
    assert "| panda | inverse dynamics | 64 | 10.0 ns [9.00–12.0] | 2.5 × | 1.00 µs | **100 ×** |" in text
    assert "| panda inverse dynamics in float32 against float64, batch of 64 | 55 × | 100.0 × (10.0 ns" in text


def test_a_wrong_float32_stops_the_benchmark(bench, panda, monkeypatch):
    ours = bench("ours").Ours(panda)
    right = ours.method("inverse_dynamics")

    def wrong(*arrays):
        return right(*arrays) * arrays[0].dtype.type(1.1 if arrays[0].dtype == np.float32 else 1)

    monkeypatch.setattr(ours, "method", lambda quantity: wrong)
    with pytest.raises(SystemExit, match="in float32 is off by"):
        bench("float32").loss(ours, "inverse_dynamics", bench("cases").States.random(panda, 8))


X86 = """
block:
\tpushq\t%rbp
\tsubq\t$2048, %rsp
\tvmovdqu\t(%rdi), %xmm0
\tvinserti128\t$1, 112(%rdi), %ymm0, %ymm0
\tvbroadcastsd\t.LCPI1_3(%rip), %ymm1
\tvtestpd\t%ymm0, %ymm0
\tjne\t.LBB1_2
.LBB1_1:                                # a comment with %ymm0
\tvfmadd213pd\t32(%rsp), %ymm14, %ymm2
\tvmulpd\t%ymm1, %ymm1, %ymm1
\tvsubpd\t%ymm0, %ymm6, %ymm6
\tvmovapd\t%ymm1, %ymm2
\tvmovapd\t%ymm2, 32(%rsp)
\tretq
.LBB1_2:
\tvmovapd\t%ymm2, 32(%rsp)
\tcallq\twrap.v4f64
\tjmp\t.LBB1_1
.Lfunc_end1:
wrap.v4f64:
\tvmulpd\t%ymm1, %ymm1, %ymm1
"""
ARM = """
block:
\tsub\tsp, sp, #896
\tldp\tq1, q2, [x0]
\tzip2\tv12.2d, v1.2d, v0.2d
\tfmla\tv2.2d, v9.2d, v24.2d
\tfadd\tv8.2d, v25.2d, v24.2d
\tmov\tv8.16b, v9.16b
\tstr\tq24, [x0, #1024]
\tret
.Lfunc_end0:
"""


def test_instructions_are_told_apart(bench):
    instructions = bench("instructions")
    found = instructions.counted(X86)
    assert found == {"products": 2, "folded": 1, "sums": 1, "loads": 2, "stores": 1, "moves": 1, "rest": 2}
    assert instructions.total(found) == 8
    assert instructions.frame(X86) == 2048
    found = instructions.counted(ARM)
    assert found == {"products": 1, "sums": 1, "loads": 2, "stores": 1, "rest": 1, "moves": 1}
    assert instructions.frame(ARM) == 896


def test_a_loop_is_told_from_what_surrounds_it(bench):
    text = "ceiling:\n\tvmulpd\t%ymm1, %ymm1, %ymm1\n.L1:\n\tvaddpd\t%ymm1, %ymm1, %ymm1\n\tjl\t.L1\n\tvmulpd\t%ymm1, %ymm1, %ymm1\n"
    assert bench("instructions").counted(text) == {"products": 2, "sums": 1, "loops": 1}
    assert bench("instructions").counted(text, in_loop=True) == {"sums": 1, "loops": 1}


@pytest.mark.parametrize("quantity", ["inverse_dynamics", "mass_matrix"])
def test_the_compiled_products_are_the_program_s(bench, panda, quantity):
    """Two counts of one thing: in the program with what sines cost, and in the machine's code."""
    bounds, machine = bench("bounds"), importlib.import_module("twistwrench.compiler.lowering.target_machine")
    ours = bench("ours").Ours(panda)
    expected = bounds.multiplications(ours.robot.program(quantity))
    found = bench("instructions").of_kernel(ours.robot.kernel(quantity), machine.DOUBLE)
    assert found["products"] == pytest.approx(expected, rel=0.01)
    assert found["loads"] > 0 < found["stores"]
    assert found["frame"] > 0


def test_a_mixture_is_what_was_asked_for(bench):
    ceilings, instructions = bench("ceilings"), bench("instructions")
    parts = {"products": 30, "sums": 20, "loads": 30, "stores": 10, "rest": 20}
    text = ceilings._mixture(ceilings.lanes(), ceilings._spread(parts, 220), ceilings.SPAN)
    found = instructions.counted(ceilings.assembly(text), in_loop=True)
    for part, count in parts.items():
        assert found[part] == pytest.approx(2 * count, abs=10)  # a few spills beside
    long = ceilings._mixture(ceilings.lanes(), ceilings._spread(parts, 1100), ceilings.SPAN)
    found = instructions.counted(ceilings.assembly(long), in_loop=True)
    assert instructions.total(found) == pytest.approx(1100, rel=0.05)


def test_a_stream_reaches_every_byte(bench):
    ceilings = bench("ceilings")
    step = ceilings.UNROLLED * ceilings.lanes() * 8
    source, to = ceilings.aligned(5 * step), ceilings.aligned(5 * step)
    source[:] = np.arange(len(source)) % 251
    ceilings._compiled(ceilings._stream(ceilings.lanes(), "copy"))(to.ctypes.data, source.ctypes.data, 5, 1)
    assert np.array_equal(to, source)
    for kind in ceilings.STREAMS[:2]:
        to[:] = source
        to[: step // ceilings.UNROLLED] = 7  # what is written over and over is the first vector
        ceilings._compiled(ceilings._stream(ceilings.lanes(), kind))(to.ctypes.data, None, 5, 1)
        assert np.all(to == 7)


@pytest.mark.slow
def test_shares_of_limits_are_measured_and_shown(bench, panda, monkeypatch, capsys):
    bounds, limits = bench("bounds"), bench("limits")
    monkeypatch.setattr(bounds, "COMPARED", ("gravity_forces",))
    found = bounds.times(1, (panda,), size=64, beyond=2**20)
    each = found["robots"]["panda"]["quantities"]["gravity_forces"]
    assert each["bytes"] == 56
    assert each["multiplications"] > 6 * bounds.per_angle()
    shares = limits.shares(each, found["lanes"], 64)
    assert set(shares) == {"multiplier", "instructions", "memory"}
    assert all(needed > 0 and share > 0 for needed, share in shares.values())
    assert shares["multiplier"][0] < 1000  # ns: 180 products take 7 on a free core
    text = bench("report").write({**kept(), "bounds": found})
    assert "## What the core can do" in text
    assert "| plain stores, 1 MiB |" in text
    assert f"| panda | gravity forces | 64 | {limits._ns(each['timings']['kernel 64']['minimum'])} |" in text


@pytest.mark.parametrize(
    ("changed", "bound_by"),
    [
        ({}, "multiplier"),
        ({"mixture": 0.3, "as long": 0.3}, "instructions"),
        ({"mixture": 0.2, "as long": 0.3}, "fetching"),
        ({"plain 512": 0.25, "past the cache 512": 0.2}, "memory"),
    ],
)
def test_the_largest_share_bounds_a_kernel(bench, changed, bound_by):
    best = {"products": 0.4, "mixture": 0.1, "as long": 0.1, "plain 512": 0.01, "past the cache 512": 0.02}
    best = {**best, "kernel 512": 100.0, **changed}
    each = {
        "multiplications": 500,
        "executed": 1000,
        "bytes": 400,
        "timings": {name: {"minimum": value} for name, value in best.items()},
    }
    limits = bench("limits")
    shares = limits.shares(each, 4, 512)
    assert shares["multiplier"] == pytest.approx((50.0, 0.5))
    assert shares["instructions"] == pytest.approx((250 * best["as long"], 2.5 * best["as long"]))
    writing = min(best["plain 512"], best["past the cache 512"])
    assert shares["memory"] == pytest.approx((400 * writing, 4 * writing))
    assert limits.verdict(each, 4, 512) == bound_by


def test_all_kernels_are_compiled_in_a_fresh_process(bench, capsys):
    ur5 = next(c for c in bench("cases").CASES if c.name == "ur5")
    found = bench("footprint").compile_times(1, (ur5,))
    times = found["robots"]["ur5"]
    assert 0.1 < times["processor"] <= times["wall"] * 1.05
    text = bench("report").write({**kept(), "compile": found})
    assert "## Compiling all that is compared" in text
    assert "| ur5 |" in text


def test_what_is_wanted_next_is_met_or_not(bench):
    required = bench("required_next")
    timings = {
        "twistwrench method, batch of 512": timing(1000.0),
        "twistwrench method, batch of 512, out=": timing(500.0),
        "twistwrench method, batch of 4096": timing(4000.0),
        "Pinocchio C++, slow": timing(10000.0),
        "Pinocchio C++, fast": timing(8000.0),
    }
    derivatives = {"talos": {"batch": 512, "quantities": {"inverse_dynamics_derivatives": {"timings": timings}}}}
    two = {"65536": {"1": timing(100.0), "2": timing(50.0)}}
    compiled = {"robots": {"talos": {"wall": 24.0, "processor": 20.0}}}
    results = {"derivatives": {"robots": derivatives}, "threads": {"humanoid": two}, "compile": compiled}
    rows = {row.what: row for row in required.rows({"robots": {}, **results})}
    row = rows["talos ∂τ/∂(q, dq), batch of 512"]
    assert (row.need, row.verdict) == ("9 ×", "**not met**, 89% of it")
    assert row.got == "8.0 × (1.00 µs against 8.00 µs); 16.0 × into `out=`"
    assert rows["talos ∂τ/∂(q, dq), batch of 4096"].share == pytest.approx(2 / 5.5)
    assert rows["talos inverse dynamics, two threads over one, 65,536 states"].verdict == "met"
    assert rows["talos, all of the above compiled, no cache"].verdict == "**not met**, 50% of it"
    assert rows["one call from Python: panda inverse dynamics"].verdict == "not measured"
    assert len(rows) == 23


def test_results_go_elsewhere_when_asked_to(bench, monkeypatch, tmp_path, capsys):
    main, elsewhere = bench("__main__"), tmp_path / "elsewhere"
    (tmp_path / "results.json").write_text(json.dumps(kept()))
    monkeypatch.setattr(main, "HERE", tmp_path)
    monkeypatch.setattr(main, "pin_to_one_core", lambda: None)
    given = []
    monkeypatch.setattr(
        bench("footprint"),
        "compile_times",
        lambda rounds, cases: (
            given.append(cases)
            or {"date": "d", "cpu": "c", "rounds": rounds, "quantities": ["mass_matrix"], "robots": {}}
        ),
    )
    monkeypatch.setattr(
        "sys.argv", ["bench", "--only", "compile", "--robots", "talos", "--rounds", "10", "--out", str(elsewhere)]
    )
    main.main()
    capsys.readouterr()
    assert [case.name for case in given[0]] == ["talos"]
    assert json.loads((tmp_path / "results.json").read_text()) == kept()
    assert not (tmp_path / "RESULTS.md").exists()
    assert json.loads((elsewhere / "results.json").read_text())["compile"]["rounds"] == 2
    assert (elsewhere / "RESULTS.md").exists()


# ── generated C ──


@pytest.mark.slow
def test_generated_c_computes_the_same_and_makes_a_table(bench, panda):
    """As the recursions on Pinocchio's model, state by state and eight at a time; and our own C."""
    pytest.importorskip("casadi")
    found = bench("generated").times(1, (panda,), size=64)
    if "missing" in found:
        pytest.skip(found["missing"])
    for each in found["robots"]["panda"].values():
        assert len(each["timings"]) == 4 and len(each["agreement"]) == 3
        assert all(0 < difference < 1e-12 for difference in each["agreement"].values())
    text = bench("report").write({**kept(), "generated": found})
    assert "## Generated C" in text and "the same C, gcc, 8 states at a time" in text
    assert "processor time per state" in text


# ── rollouts ──


@pytest.mark.slow
def test_rollouts_agree_with_mujoco_and_make_tables(bench, capsys):
    found = bench("rollout").times(1, size=8, steps=10)
    assert found["agreement"] < 1e-12
    text = bench("report").write({**kept(), "rollout": found})
    assert "## Rollouts" in text and "8 motions of 10 steps" in text
    assert "panda rollouts, 1 kHz, PD control, 8 motions, steps over `mujoco.rollout`'s" in text
    assert "times real time" in text
    without = {name: section for name, section in kept().items() if name != "rollout"}
    assert "## Rollouts" not in bench("report").write(without)


@pytest.mark.slow
def test_simulations_agree_with_a_loop_of_mujoco_and_make_a_table(bench, monkeypatch):
    simulate = bench("simulate")
    monkeypatch.setattr(simulate, "STEPS", 20)
    monkeypatch.setattr(simulate, "BATCH", 3)
    found = simulate.times(1)
    assert found["agreement"] < 1e-8
    assert {"dopri5, stops and a plane", "rk4, one of a batch of 3"} <= {*found["times"]}
    text = bench("report").write({**kept(), "simulate": found})
    assert "## Simulations" in text and "| **twistwrench, semi_implicit** |" in text
    assert "| **twistwrench, rk4, controller** |" in text and "| mj_step, controller |" in text
    without = {name: section for name, section in kept().items() if name != "simulate"}
    assert "## Simulations" not in bench("report").write(without)


@pytest.mark.slow
def test_closed_loops_stay_closed_and_make_a_table(bench, monkeypatch):
    closed = bench("closed")
    monkeypatch.setattr(closed, "STEPS", 100)
    monkeypatch.setattr(closed, "MOTIONS", 3)
    found = closed.times(1)
    assert found["gap"] <= 1e-12 and {"rk4", "semi_implicit", "rollout"} <= {*found["times"]}
    text = bench("report").write({**kept(), "closed": found})
    assert "## Closed loops" in text and "| **twistwrench, rollout** |" in text
    without = {name: section for name, section in kept().items() if name != "closed"}
    assert "## Closed loops" not in bench("report").write(without)
    monkeypatch.setattr(closed, "GAP", 0.0)
    with pytest.raises(SystemExit, match="nothing is timed"):
        closed.times(1)


def test_simulations_that_disagree_are_not_timed(bench, monkeypatch):
    simulate = bench("simulate")
    monkeypatch.setattr(simulate._Loop, "after", lambda self, steps, *, steered=False: np.ones(14))
    with pytest.raises(SystemExit, match="nothing is timed"):
        simulate.times(1)


def test_rollouts_that_disagree_are_not_timed(bench, monkeypatch):
    rollout = bench("rollout")
    monkeypatch.setattr(
        rollout._Ours, "law", lambda self, dtype: rollout.BatchPD(np.zeros(7), 99.0, rollout.KD, gravity=False)
    )
    with pytest.raises(SystemExit, match="nothing is timed"):
        rollout.times(1, size=8, steps=10)
