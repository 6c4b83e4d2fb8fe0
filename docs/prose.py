"""Advice on the pages' sentences, printed by `make docs`: long sentences, and sentences that stand on two pages.

The rules of the style guide that must hold are in tests/meta/test_words.py, which reads pages by the functions here.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
MEAN_WORDS, LONG_SENTENCE, LONG_SHARE = 18, 35, 0.03
"""Words of a sentence on average, words above which a sentence is long, and share of long sentences of a page."""
LEAST_SHARED = 12
"""Words from which a sentence on two pages is reported."""
_NOT_PROSE = (
    r"```.*?```",  # code and printed output
    r"^---\n.*?^---$",
    r"^\|.*$",
    r"^#.*$",
    r"^>.*$",  # messages as they are printed
    r"\$\$.*?\$\$",
    r"<!--.*?-->",
)


def sentences(page: Path) -> list[str]:
    """Sentences of a page's paragraphs and lists, without code, tables, headings and formulas of their own."""
    text = page.read_text("utf-8")
    for pattern in _NOT_PROSE:
        text = re.sub(pattern, "", text, flags=re.DOTALL | re.MULTILINE if "?" in pattern else re.MULTILINE)
    text = re.sub(r"^ *(?:[-*]|\d+\.) ", "\n\n", text, flags=re.MULTILINE)
    found = [
        " ".join(sentence.split())
        for paragraph in re.split(r"\n\s*\n", text)
        for sentence in re.split(r"(?<=[.!?:])\s+(?=[A-Z`*\[])", paragraph.strip())
    ]
    return [sentence for sentence in found if len(sentence.split()) > 2]


def cells(page: Path) -> list[str]:
    """Cells of a page's tables."""
    rows = re.findall(r"^\|(.*)\|$", re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL), re.MULTILINE)
    return [cell.strip() for row in rows for cell in row.split("|")]


def advice() -> Iterator[str]:
    """Warnings with page and line."""
    places = defaultdict(list)
    for page in PAGES:
        found = sentences(page)
        lengths = [len(sentence.split()) for sentence in found]
        long = [sentence for sentence, length in zip(found, lengths, strict=True) if length > LONG_SENTENCE]
        if sum(lengths) > MEAN_WORDS * len(lengths):
            yield f"{_place(page)}: {sum(lengths) / len(lengths):.1f} words a sentence; {MEAN_WORDS} read well"
        for sentence in long if len(long) > max(1, LONG_SHARE * len(lengths)) else ():
            yield f"{_place(page, sentence)}: sentence of {len(sentence.split())} words: {sentence[:60]} …"
        for sentence, length in zip(found, lengths, strict=True):
            if length >= LEAST_SHARED:
                places[sentence].append(page)
    for sentence, pages in places.items():
        if len(set(pages)) > 1:
            yield f"{_place(pages[0], sentence)}: the same sentence is on {_place(pages[-1], sentence)}: {sentence[:60]} …"


def _place(page: Path, sentence: str = "") -> str:
    """Path of a page, with the line on which a sentence begins."""
    name = page.relative_to(ROOT).as_posix()
    if not sentence:
        return name
    start = r"\s+".join(map(re.escape, sentence.split()[:4]))
    found = re.search(start, page.read_text("utf-8"))
    return f"{name}:{page.read_text('utf-8')[: found.start()].count(chr(10)) + 1}" if found else name


if __name__ == "__main__":
    for line in advice():
        print(f"warning: {line}")
