"""Write below the Python blocks of a page what they print: `make outputs`, or `python docs/outputs.py PAGE …`.

A block of code that prints is followed by a block ```` ```output ````; the tests run the code and compare.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

_DOCS = Path(__file__).resolve().parent
_BLOCK = re.compile(
    r"^```python(?P<marks>[^\n]*)\n(?P<code>.*?)^```\n(?:\n```output\n(?P<shown>.*?)^```\n)?", re.MULTILINE | re.DOTALL
)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?")


def outputs(text: str, name: str) -> Iterator[tuple[re.Match[str], str]]:
    """Run the Python blocks of a page one after another; yield each block and what it prints."""
    scope: dict[str, object] = {}
    for block in _BLOCK.finditer(text):
        if "no-run" not in block["marks"]:
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                exec(compile(block["code"], name, "exec"), scope)
            yield block, out.getvalue()


def agree(shown: str, printed: str) -> bool:
    """True if two texts differ only in spaces, in the last digit of numbers, and by what "…" leaves out."""
    found = _tokens(printed)
    first, *rest = [_tokens(part) for part in shown.split("…")]
    if not rest:
        return _equal(first, found)
    at = 0
    for part in (first, *rest):
        places = range(at, len(found) - len(part) + 1) if at or part is not first else (0,)
        at = next((i + len(part) for i in places if _equal(part, found[i : i + len(part)])), -1)
        if at < 0:
            return False
    return not rest[-1] or _equal(rest[-1], found[-len(rest[-1]) :])


def _tokens(text: str) -> list[str]:
    """Numbers, and the words and signs between them."""
    return re.findall(
        rf"{_NUMBER.pattern}|[^\W\d]+|[^\w\s]", re.sub("─+", "─", text)
    )  # rules as long as a table is wide


def _equal(shown: list[str], printed: list[str]) -> bool:
    return len(shown) == len(printed) and all(a == b or _close(a, b) for a, b in zip(shown, printed, strict=True))


def _close(shown: str, printed: str) -> bool:
    """True if two numbers differ by at most one unit of the last digit shown, or both are rounding errors below 1e-10."""
    if not (_NUMBER.fullmatch(shown) and _NUMBER.fullmatch(printed)):
        return False
    mantissa, _, exponent = shown.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    rounding = "e-" in shown and max(abs(float(shown)), abs(float(printed))) < 1e-10
    return rounding or abs(float(shown) - float(printed)) <= 1.001 * unit


def rewritten(page: Path) -> str:
    """The text of a page with its outputs as they are today; shown outputs that still agree are kept."""
    text = page.read_text("utf-8")
    parts, end = [], 0
    for block, printed in outputs(text, page.name):
        shown = block["shown"] or ""
        if not agree(shown, printed):
            code = text[block.start() : block.end("code")]
            parts += [text[end : block.start()], code, "```\n", f"\n```output\n{printed}```\n" if printed else ""]
            end = block.end()
    return "".join([*parts, text[end:]])


if __name__ == "__main__":
    pages = [Path(p).resolve() for p in sys.argv[1:]] or [_DOCS.parent / "README.md", *sorted(_DOCS.glob("*.md"))]
    for page in pages:
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            text = rewritten(page)
        if text != page.read_text("utf-8"):
            page.write_text(text, "utf-8")
            print(f"rewrote {os.path.relpath(page)}")
