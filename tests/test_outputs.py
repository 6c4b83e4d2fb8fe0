"""Files out: what is refused before anything runs, and that nothing half-written is ever found."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from twistwrench import ValueRangeError
from twistwrench.outputs import check_outputs, picture_path, replacing


@pytest.mark.parametrize(
    ("given", "found"),
    [("a.png", "a.png"), ("a.PDF", "a.PDF"), ("a.svg", "a.svg"), ("a", "a.png"), ("b.d/a", "b.d/a.png")],
)
def test_pictures_have_a_suffix_that_says_their_kind(given, found):
    assert picture_path(given) == found
    assert picture_path(Path(given)) == found


@pytest.mark.parametrize("name", ["a.jpg", "a.csv", "a.tar.gz", "a.1"])
def test_other_kinds_are_refused_with_those_there_are(name):
    with pytest.raises(ValueRangeError, match=r"pictures of kind .* Choose one of \.png, \.pdf, \.svg"):
        picture_path(name)


def test_outputs_in_their_own_places_are_fine(tmp_path):
    (tmp_path / "in.csv").write_text("x")
    (tmp_path / "old.csv").write_text("x")
    check_outputs({"--csv": tmp_path / "old.csv", "--plot": tmp_path / "new.png", "--save": None}, {"LOG": None})
    check_outputs({"--csv": str(tmp_path / "new.csv")}, {"LOG": tmp_path / "in.csv", "--limits": tmp_path / "gone"})
    assert {p.name for p in tmp_path.iterdir()} == {"in.csv", "old.csv"}  # looking leaves no trace


def test_an_output_that_is_an_input_or_another_output_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log, link, hard = tmp_path / "log.csv", tmp_path / "link.csv", tmp_path / "hard.csv"
    log.write_text("x")
    link.symlink_to(log)
    hard.hardlink_to(log)
    (tmp_path / "sub").mkdir()
    for name in (log, link, hard, "log.csv", "sub/../log.csv"):
        with pytest.raises(ValueRangeError, match=r"--csv .* would overwrite the file of LOG"):
            check_outputs({"--csv": name}, {"LOG": log})
    with pytest.raises(ValueRangeError, match=r"--plot .* would overwrite the file of --csv"):
        check_outputs({"--csv": "new", "--plot": tmp_path / "new"}, {})
    assert log.read_text() == "x"


def test_devices_may_be_shared():
    check_outputs({"--csv": os.devnull, "--plot": os.devnull}, {"LOG": os.devnull})


def test_places_that_cannot_be_written_are_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    circle = tmp_path / "circle"
    circle.symlink_to(circle)
    for name, words in (
        (tmp_path, "it is a folder"),
        (tmp_path / "no" / "where.csv", "no such folder"),
        (tmp_path / "file" / "where.csv", "no such folder|Not a directory"),
        (tmp_path / ("x" * 300), "too long"),
        (circle / "a.csv", "no such folder|[Ll]oop|symbolic links"),
    ):
        with pytest.raises(ValueRangeError, match=f"cannot write .*({words})"):
            check_outputs({"--csv": name}, {})


def test_protected_files_and_folders_are_refused(tmp_path, monkeypatch):
    """Rights are asked of the system; a superuser has them all, so the system is stood in for."""
    (tmp_path / "old.csv").write_text("x")
    denied = []
    monkeypatch.setattr(os, "access", lambda path, _mode: Path(path) not in denied)
    denied[:] = [tmp_path / "old.csv"]
    with pytest.raises(ValueRangeError, match="write-protected"):
        check_outputs({"--csv": tmp_path / "old.csv"}, {})
    check_outputs({"--csv": tmp_path / "new.csv"}, {})
    denied[:] = [tmp_path]
    for name in ("old.csv", "new.csv"):
        with pytest.raises(ValueRangeError, match="the folder is not writable"):
            check_outputs({"--csv": tmp_path / name}, {})


def test_what_was_there_stays_until_the_new_is_whole(tmp_path):
    path = tmp_path / "out.csv"
    path.write_text("old")
    with pytest.raises(RuntimeError, match="halfway"), replacing(path) as scratch:
        scratch.write_text("ne")
        assert path.read_text() == "old"
        raise RuntimeError("halfway")
    assert path.read_text() == "old"
    with replacing(path) as scratch:
        scratch.write_text("new")
    assert path.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv"]


def test_a_link_stays_a_link_and_its_file_is_replaced(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with replacing(tmp_path / "link") as scratch:
        scratch.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_replacing_reports_what_cannot_be_written(tmp_path):
    for path in (tmp_path, tmp_path / "no" / "where.csv"):
        with pytest.raises(ValueRangeError, match="cannot write"), replacing(path):
            pass
