"""Without llvmlite, as where there is no wheel of it, all runs on NumPy: the README, both notebooks, and the numbers."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from places import ROOT

import twistwrench as tw

BLOCKED = """
import sys

class NoLlvmlite:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "llvmlite":
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, NoLlvmlite())
"""
README = """
import pathlib, re
text = pathlib.Path(ROOT, "README.md").read_text("utf-8")
scope = {}
for block in re.findall(r"^```python\\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
    exec(block, scope)
"""
NOTEBOOK = """
import json, pathlib
cells = json.loads(pathlib.Path(ROOT, "notebooks", NAME).read_text("utf-8"))["cells"]
scope = {}
for cell in cells:
    if cell["cell_type"] == "code":
        exec("".join(cell["source"]), scope)
"""


def run(text, folder, **names):
    given = "".join(f"{name} = {value!r}\n" for name, value in {"ROOT": str(ROOT), **names}.items())
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", BLOCKED + given + text],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_lines_of_the_readme_run(tmp_path):
    run(README, tmp_path)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(path.name, marks=() if path.name.startswith("ur5") else pytest.mark.slow)
        for path in sorted((ROOT / "notebooks").glob("*.ipynb"))
    ],
)
def test_the_notebooks_run(tmp_path, name):
    pytest.importorskip("sympy")
    run(NOTEBOOK, tmp_path, NAME=name)


def test_the_numbers_are_the_kernels_to_round_off(tmp_path):
    """Fused products round twice there: 1e-13 of the largest torque, with some hundred products in a row."""
    said = run(
        "import numpy as np, twistwrench as tw\n"
        "q, dq, ddq = np.random.default_rng(0).normal(size=(3, 4, 7))\n"
        "print(tw.robots.panda().inverse_dynamics(q, dq, ddq).tobytes().hex())\n",
        tmp_path,
    )
    found = np.frombuffer(bytes.fromhex(said.strip())).reshape(4, 7)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 4, 7))
    expected = tw.robots.panda().inverse_dynamics(q, dq, ddq)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
