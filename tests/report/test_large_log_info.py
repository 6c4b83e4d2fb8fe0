"""What `log info` says of a large file, block by block, against the same file in memory."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner

from twistwrench import TrajectoryError
from twistwrench.cli.main import main
from twistwrench.motion.bounds import TimeAbove
from twistwrench.reports import log_quality
from twistwrench.reports.log_quality import LogQuality
from twistwrench.reports.measured_torque import TorqueComparison


def test_blocks_say_what_the_whole_says(tmp_path, monkeypatch):
    """Gaps, repeated and backward stamps, a cut-off and a dead column; the grid of 0.001 in every run of rows."""
    rng = np.random.default_rng(0)
    steps = np.full(20_000, 0.01) + 1e-4 * rng.normal(size=20_000)
    steps[[500, 9000]], steps[700], steps[800] = 3.0, 0.0, -0.02
    t = np.cumsum(steps)
    x = np.round(np.clip(np.sin(t) + 0.01 * rng.normal(size=len(t)), -0.9, 2.0), 3)
    table = np.column_stack([t, x, np.full_like(t, 0.25), rng.normal(size=len(t))])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, delimiter=",", header="time,cut,dead,noise", comments="", fmt="%.9g")
    whole = LogQuality.from_file(path)
    monkeypatch.setattr(log_quality, "MAX_TABLE_IN_MEMORY", 0)
    blocks = LogQuality.from_file(path)
    for name in ("rows", "time", "seconds", "gaps", "longest", "repeated", "backward"):
        assert getattr(blocks, name) == getattr(whole, name), name
    np.testing.assert_allclose([blocks.rate, blocks.jitter], [whole.rate, whole.jitter], rtol=0.02)
    assert whole.gaps == 2 and whole.repeated == 1 and whole.backward == 1
    for a, b in zip(blocks.columns, whole.columns, strict=True):
        assert (a.name, a.least, a.most, a.dead, a.cut, a.zeros) == (b.name, b.least, b.most, b.dead, b.cut, b.zeros)
        np.testing.assert_allclose([a.grid, a.noise], [b.grid, b.noise], rtol=0.2, atol=1e-12)


def test_zeros_and_columns_of_few_steps_are_worth_a_word(tmp_path):
    t = np.arange(1000) * 0.01
    table = np.column_stack([t, np.where(t < 5, 0.0, np.sin(t)), np.round(0.01 * np.sin(t), 3), np.sin(t)])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time,half,coarse,fine", comments="", fmt="%.9g")
    said = " ".join(CliRunner().invoke(main, ["log", str(tmp_path / "log.csv")]).output.split())
    assert said.count("exactly 0 in 50 % of the rows") == 1
    assert said.count("no more than 20 steps of its grid in all") == 1
    assert LogQuality.from_file(tmp_path / "log.csv").columns[0].zeros == 0.5


def test_a_step_of_exactly_three_usual_ones_is_a_gap_and_no_jitter(tmp_path):
    t = np.cumsum([0.0, *[0.25] * 10, 0.75, *[0.25] * 10, 0.5])
    np.savetxt(tmp_path / "log.csv", np.column_stack([t, np.sin(t)]), delimiter=",", header="time,x", comments="")
    found = LogQuality.from_file(tmp_path / "log.csv")
    assert (found.gaps, found.longest, found.rate) == (1, 0.75, 4.0)
    assert found.jitter == np.std([0.25] * 20 + [0.5])


def test_what_rests_at_zero_is_not_cut_off_there(tmp_path):
    t = np.arange(1000) * 0.01
    table = np.column_stack([t, np.maximum(0.0, np.sin(t)), np.maximum(-0.5, np.sin(t))])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="time,one_way,clipped", comments="")
    one_way, clipped = LogQuality.from_file(tmp_path / "log.csv").columns
    assert one_way.cut == 0.0 and one_way.zeros > 0.3
    assert clipped.cut == np.mean(table[:, 2] == -0.5) > 0.2


def test_a_measured_torque_is_cut_off_at_the_end_where_it_is():
    t = np.arange(1000) * 0.01
    computed = 10 * np.sin(np.column_stack([t, t]))
    measured = np.column_stack([np.minimum(computed[:, 0], 5.0), np.maximum(computed[:, 1], -5.0)])
    found = TorqueComparison.from_rows(t, computed, measured, np.zeros_like(computed), np.zeros(len(t), bool))
    never = TimeAbove.from_rows(t, np.zeros(computed.shape, bool))
    upper, lower = found.torques(("upper", "lower"), ("N m", "N m"), np.full(2, np.inf), never, 0.01)
    assert upper.cut > 0.2 and upper.cut_at == 5.0
    assert lower.cut > 0.2 and lower.cut_at == -5.0
    assert "upper is exactly 5 N m" in upper.cut_words


def test_columns_of_words_are_ignored_and_named(tmp_path):
    """A controller's state, an empty last column, and a second file joined; a word among numbers is an error as before."""
    rows = [f"{k / 100:.2f};{np.sin(k):.4f};{'RUN' if k > 3 else 'idle'};".replace(".", ",") for k in range(40)]
    (tmp_path / "log.csv").write_text("\n".join(["time;x;state;", *rows]) + "\n")
    found = LogQuality.from_file(tmp_path / "log.csv")
    assert [column.name for column in found.columns] == ["x"] and found.rows == 40 and found.time == "time"
    assert found.notes == ("Ignored, as they hold words: 'state', ''.",)
    joined = LogQuality.from_file(f"{tmp_path / 'log.csv'}+{tmp_path / 'log.csv'}")
    assert [column.name for column in joined.columns] == ["log:x", "log:x"]

    rows[20] = rows[20].replace(rows[20].split(";")[1], "lost")
    (tmp_path / "broken.csv").write_text("\n".join(["time;x;state;", *rows]) + "\n")
    with pytest.raises(TrajectoryError, match="line 22, column 'x' is 'lost', which is not a number"):
        LogQuality.from_file(tmp_path / "broken.csv")
    (tmp_path / "words.csv").write_text("name,state\nelbow,RUN\n")
    with pytest.raises(TrajectoryError, match="column 'name' is 'elbow', which is not a number"):
        LogQuality.from_file(tmp_path / "words.csv")
