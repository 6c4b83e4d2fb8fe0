"""The one look of pictures: written whole and in the kinds there are, in one style that stays within."""

from __future__ import annotations

import builtins
import subprocess
import sys

import numpy as np
import pytest

from twistwrench import MissingExtraError, ValueRangeError
from twistwrench.viz.style import STYLE, figure, require_matplotlib, save, stack


def drawn(title="a title"):
    with figure(3, 2, title) as sheet:
        sheet.subplots().plot([0, 1], [0, 1])
    return sheet


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_the_suffix_says_the_kind(tmp_path, suffix, magic):
    pytest.importorskip("matplotlib")
    path = tmp_path / f"out{suffix}"
    assert save(drawn(), path) == path
    assert path.read_bytes().startswith(magic)
    assert save(drawn(), str(tmp_path / "out")).read_bytes().startswith(b"\x89PNG")


def test_other_kinds_are_refused_and_nothing_is_written(tmp_path):
    pytest.importorskip("matplotlib")
    with pytest.raises(ValueRangeError, match=r"Choose one of \.png, \.pdf, \.svg"):
        save(drawn(), tmp_path / "out.jpg")
    assert not list(tmp_path.iterdir())


def test_a_failed_drawing_leaves_the_old_picture(tmp_path):
    pytest.importorskip("matplotlib")
    from matplotlib.patches import Rectangle

    class Broken(Rectangle):
        def draw(self, renderer):
            raise RuntimeError("halfway")

    path = tmp_path / "out.png"
    path.write_bytes(b"old")
    sheet = drawn()
    sheet.add_artist(Broken((0, 0), 1, 1))
    with pytest.raises(RuntimeError, match="halfway"):
        save(sheet, path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["out.png"]


def test_names_are_drawn_as_they_are(tmp_path):
    pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    save(drawn("cost in $"), tmp_path / "a.png")
    save(drawn("$\\no such command$"), tmp_path / "b.png")  # formulas between dollars would be an error here
    assert (imread(tmp_path / "a.png") != imread(tmp_path / "b.png")).any()


def test_the_style_holds_within_and_only_there():
    mpl = pytest.importorskip("matplotlib")
    before = dict(mpl.rcParams)
    with figure(3, 2, "a title") as sheet:
        assert all(mpl.rcParams[name] == value for name, value in STYLE.items())
        axis = sheet.subplots()
    assert dict(mpl.rcParams) == before
    assert not axis.spines["top"].get_visible()
    assert sheet.get_suptitle() == "a title"
    assert sheet.dpi == STYLE["figure.dpi"]


def test_all_pictures_come_in_it_whatever_the_users_settings(tmp_path):
    """A picture does not change with the rcParams of whoever calls."""
    mpl = pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    save(drawn(), tmp_path / "a.png")
    with mpl.rc_context({"font.size": 20, "axes.grid": False, "lines.color": "red"}):
        save(drawn(), tmp_path / "b.png")
    np.testing.assert_array_equal(imread(tmp_path / "a.png"), imread(tmp_path / "b.png"))


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    plain = builtins.__import__

    def without(name, *rest, **options):
        if name.partition(".")[0] == "matplotlib":
            raise ImportError(name)
        return plain(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    for call in (require_matplotlib, lambda: figure(3, 2, "a title").__enter__()):
        with pytest.raises(MissingExtraError, match=r"needs 'matplotlib'.*\[plot\]"):
            call()


def test_matplotlib_is_left_for_later():
    code = "import sys, twistwrench.viz.style, twistwrench.viz.plots.torques, twistwrench.viz.plots.payload; print('matplotlib' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_terms_of_a_sum_stand_on_one_another_to_both_sides_of_zero():
    """Those below zero add up below, those above it above."""
    pytest.importorskip("matplotlib")
    terms = {"a": [-1.0, 2.0], "b": [-2.0, 3.0], "c": [4.0, -5.0]}
    with figure(3, 2, "a stack") as sheet:
        shown = [(name, "#000000", np.array(values)) for name, values in terms.items()]
        _, below, above = stack(sheet.subplots(), np.array([0.0, 1.0]), shown)
        lowest = min(path.vertices[:, 1].min() for area in sheet.axes[0].collections for path in area.get_paths())
    np.testing.assert_array_equal([below, above], [[-3.0, -5.0], [4.0, 5.0]])
    assert lowest == -5.0
