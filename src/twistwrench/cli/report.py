"""``--report OUT.html`` and ``--json OUT.json`` of all commands: report as one page with provenance, and as data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from ..core.answers.answer import Answer
from ..core.files import replacing
from .main import option, option_group, typed_words_and_notes

REPORT = option_group(
    option("--report OUT.html", "Write a report as one self-contained page."),
    option("--full-paths", "Show full paths of files in --report."),
)


def answer_report(
    answer: Answer, path: str, files: Mapping[str, str | Path | None], *, full_paths: bool = False
) -> None:
    """Write the page of an answer, with the words of the command line and the digests of its ``files``."""
    from ..core.answers.page import answer_page

    typed, notes = typed_words_and_notes()
    answer_page(answer, command=typed, notes=notes, files=files, full_paths=full_paths).write(Path(path))


def write_answer_json(answer: Answer, path: str) -> None:
    """Write the data of an answer, with the words of the command line and the notes on standard error."""
    typed, notes = typed_words_and_notes()
    data = {"command": typed, **answer.to_dict()}
    data["notes"] = [*data["notes"], *notes]
    with replacing(path) as scratch:
        scratch.write_text(
            json.dumps(data, ensure_ascii=False, allow_nan=False, indent=1) + "\n", encoding="utf-8", newline=""
        )
