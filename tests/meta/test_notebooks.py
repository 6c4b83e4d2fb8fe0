"""The notebooks: every code cell is executed in order, and must print and draw what is stored beside it.

No Jupyter is needed for that. A cell here is plain Python, so running one is `exec`, and showing its last value is asking for
its LaTeX or its repr, which is what Jupyter shows. Pictures are compared as they look from afar.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import re
import shlex

import numpy as np
import pytest
from click.testing import CliRunner
from places import ROOT

from twistwrench.cli.main import main

FOLDER = ROOT / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
ALIKE = 0.015
"""Mean difference of two small grey pictures, of the range from black to white. Other fonts make 0.003; pictures of different
things are 0.03 apart and more, which is tested. What the curves are made of is printed, and compared to the letter."""


def cells(path, kind):
    notebook = json.loads(path.read_text("utf-8"))
    assert notebook["nbformat"] == 4
    return [{**cell, "source": "".join(cell["source"])} for cell in notebook["cells"] if cell["cell_type"] == kind]


def shown(value):
    latex = getattr(value, "_repr_latex_", None)
    return {"text/latex": latex()} if latex else {"text/plain": repr(value)}


def run(source, scope):
    """What a cell prints, shows as its last value (None: nothing), and draws."""
    from matplotlib import pyplot

    tree = ast.parse(source)
    ends_with_value = isinstance(tree.body[-1], ast.Expr) and not source.rstrip().endswith(";")
    last = ast.Expression(tree.body.pop().value) if ends_with_value else None
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(tree, "<cell>", "exec"), scope)
        value = None if last is None else eval(compile(last, "<cell>", "eval"), scope)
    pictures = []
    for number in pyplot.get_fignums():
        buffer = io.BytesIO()
        pyplot.figure(number).savefig(buffer, format="png", bbox_inches="tight")
        pictures.append(buffer.getvalue())
    pyplot.close("all")
    return printed.getvalue(), None if value is None else shown(value), pictures


def stored(cell):
    """The same, as the file has it."""
    printed, value, pictures = "", None, []
    for output in cell["outputs"]:
        if output["output_type"] == "stream":
            assert output["name"] == "stdout", "".join(output["text"])
            printed += "".join(output["text"])
        elif "image/png" in output["data"]:
            pictures.append(base64.b64decode("".join(output["data"]["image/png"])))
        else:
            value = {kind: "".join(text) for kind, text in output["data"].items()}
    return printed, value, pictures


def from_afar(png):
    from PIL import Image

    return np.asarray(Image.open(io.BytesIO(png)).convert("L").resize((48, 36)), float) / 255


@pytest.fixture
def matplotlib():
    mpl = pytest.importorskip("matplotlib")
    pytest.importorskip("sympy")
    with mpl.rc_context():
        mpl.use("Agg")
        yield mpl


def test_there_are_notebooks():
    assert [path.stem for path in NOTEBOOKS] == [
        "2r_from_lagrangian_to_simulation",
        "2r_from_log_to_file",
        "ur5_from_urdf_to_torques",
    ]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_cells_run_in_order_and_give_what_is_stored(path, matplotlib):
    scope: dict[str, object] = {}
    drawn = 0
    for number, cell in enumerate(cells(path, "code"), start=1):
        assert cell["execution_count"] == number, "run all cells from the top before saving"
        printed, value, pictures = run(cell["source"], scope)
        expected, expected_value, expected_pictures = stored(cell)
        assert printed == expected, cell["source"]
        if value is None or expected_value is None:
            assert value is expected_value, cell["source"]
        else:
            assert value.items() <= expected_value.items(), cell["source"]
        assert len(pictures) == len(expected_pictures), cell["source"]
        for mine, theirs in zip(pictures, expected_pictures, strict=True):
            assert np.abs(from_afar(mine) - from_afar(theirs)).mean() < ALIKE, cell["source"]
        drawn += len(pictures)
    assert drawn >= 2


def shell(command):
    done = CliRunner().invoke(main, shlex.split(command))
    assert done.exit_code == 0, done.output
    return done.output


def test_the_commands_of_the_ur5_s_notebook_have_its_numbers():
    pytest.importorskip("rich")
    [path] = [path for path in NOTEBOOKS if path.stem.startswith("ur5")]
    plain, driven = re.findall(r"^    twistwrench (.*)$", cells(path, "markdown")[-1]["source"], re.MULTILINE)
    printed = "".join(stored(cell)[0] for cell in cells(path, "code"))

    out = shell(plain)
    shares = re.findall(r"(\d+) % of the limit", printed)
    assert re.findall(r"[━─]+ +(\d+) % ", out) == shares
    peak = re.search(r"(shoulder_lift_joint) at ([\d.]+) s: (-[\d.]+) N m", printed)
    assert f"Why {peak[1]} at t = {peak[2]} s" in out
    assert peak[3] in re.search(r"together .*", out.partition("Why")[2].partition("payload at")[2])[0]

    rows = re.findall(r"_joint +[\d.]+ / \d+ +([\d.]+) / [\d.]+ ", shell(driven).partition("Motors")[2])
    currents = [float(amperes) for amperes in re.findall(r"([\d.]+) A of", printed)]
    assert np.allclose(currents, [float(amperes) for amperes in rows], rtol=0, atol=0.011)  # two digits are printed


def test_different_pictures_do_not_look_alike(matplotlib):
    pictures = [from_afar(png) for path in NOTEBOOKS for cell in cells(path, "code") for png in stored(cell)[2]]
    for i, one in enumerate(pictures):
        for other in pictures[:i]:
            assert np.abs(one - other).mean() > 2 * ALIKE


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebooks_are_small_and_lead_somewhere(path):
    assert path.stat().st_size < 300_000
    for cell in cells(path, "markdown"):
        for target in re.findall(r"\]\(([^)#]+)\)", cell["source"]):
            assert "://" in target or (path.parent / target).exists(), target
