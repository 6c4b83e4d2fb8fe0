"""Write docs/questions.md from the tests in tests/questions: `python docs/questions.py [SUBJECT …]`.

Each test there is a question that people ask in public. Its docstring has the question, the answer, the source and the origin
of the expected number. The lines up to the last `print` before the first `assert` are shown with what they print. Each test
compares what it prints with the page, so that the snippets of the page itself are not run again.
"""

from __future__ import annotations

import ast
import re
import sys
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

_DOCS = Path(__file__).resolve().parent
PAGE = _DOCS / "questions.md"
TESTS = _DOCS.parent / "tests" / "questions"
SUBJECTS = (
    "payload",
    "gravity",
    "motions",
    "motors",
    "contacts",
    "loops",
    "files",
    "control",
    "identification",
    "code",
    "book",
)
"""Files of tests/questions in the order of the page."""
LINES = 10
"""Lines of code that an answer may have."""
_HEAD = """## Questions asked in public

Below are {count} questions from public issue trackers, forums and courses. Each snippet begins with `import numpy as np` and
`import twistwrench as tw`. It is a test in `tests/questions`, which compares its numbers with the origin named below it.
`python docs/questions.py` writes this part of the page.

"""


class Question(NamedTuple):
    """A question with its answer, as its test has it."""

    place: str
    """File and name of the test, such as ``test_payload_questions.py::test_payload_on_and_off``."""
    question: str
    answer: str
    source: str
    origin: str
    code: str
    command: str
    exit_code: int

    @property
    def lines(self) -> int:
        return len(self.code.splitlines()) + bool(self.command)


def questions_of(path: Path) -> Iterator[Question]:
    """Questions of a file of tests, in its order."""
    text = path.read_text("utf-8")
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield _question(node, text, f"{path.name}::{node.name}")


def _question(node: ast.FunctionDef, text: str, place: str) -> Question:
    title, answer, origins = (" ".join(part.split()) for part in _paragraphs(node))
    found = re.fullmatch(r"Source: (.+?) Number: (.+)", origins)
    assert found, f"{place}: the last paragraph is 'Source: …' and 'Number: …'"
    shown = node.body[1:]
    first = shown[0]
    end = next(i for i, statement in enumerate(shown) if isinstance(statement, ast.Assert))
    end = max((i + 1 for i, statement in enumerate(shown[:end]) if "print(" in ast.unparse(statement)), default=end)
    command, exit_code = "", 0
    for i, statement in enumerate(shown[:end]):
        call = _shell_call(statement)
        if call is not None:
            command, end = call.args[0].value, i  # type: ignore[attr-defined]
            exit_code = next((k.value.value for k in call.keywords if k.arg == "code"), 0)  # type: ignore[attr-defined]
            break
    lines = text.splitlines()[first.lineno - 1 : shown[end - 1].end_lineno] if end else []
    return Question(
        place,
        title,
        answer,
        found[1].rstrip("."),
        found[2].rstrip("."),
        textwrap.dedent("\n".join(lines)),
        command,
        exit_code,
    )


def _paragraphs(node: ast.FunctionDef) -> list[str]:
    """Question, answer, and source with origin: the three paragraphs of the docstring."""
    paragraphs = (ast.get_docstring(node) or "").split("\n\n")
    assert len(paragraphs) == 3, f"{node.name}: the docstring has a question, an answer, and its source and origin"
    return paragraphs


def _shell_call(statement: ast.stmt) -> ast.Call | None:
    """The call of ``shell`` that a statement is, or assigns."""
    value = statement.value if isinstance(statement, ast.Expr | ast.Assign) else None
    is_shell = isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id == "shell"
    return value if is_shell else None  # type: ignore[return-value]


def subject(path: Path) -> str:
    """Title of a file of questions: the first line of its docstring."""
    return (ast.get_docstring(ast.parse(path.read_text("utf-8"))) or "").partition("\n")[0].rstrip(".")


def introduction(path: Path) -> str:
    """Links of a subject, and what its snippets share: imports beyond the usual, constants, functions."""
    text = path.read_text("utf-8")
    tree = ast.parse(text)
    usual = ("from __future__", "import numpy", "import pytest", "from pytest", "import twistwrench")
    shared = []
    for node in tree.body[1:]:
        lines = ast.get_source_segment(text, node) or ""
        is_test = isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
        if is_test or lines.startswith((*usual, "NOT_YET", '"""')):
            continue
        decorators = [f"@{ast.unparse(d)}\n" for d in getattr(node, "decorator_list", ())]
        shared.append("".join(decorators) + lines)
    links = (ast.get_docstring(tree) or "").partition("\n\n")[2]
    blocks = "\n\n".join(shared).replace("\n\nfrom ", "\nfrom ").replace("\n\nimport ", "\nimport ")
    code = f"\nCommon to the snippets of this section:\n\n```python no-run\n{blocks}\n```\n" if shared else ""
    return f"{links}\n{code}"


def unanswered(path: Path) -> dict[str, tuple[str, str]]:
    """Questions of a file without an answer: source, and the capability that is not there."""
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "NOT_YET":
            return ast.literal_eval(node.value)
    return {}


def files() -> list[Path]:
    return [TESTS / f"test_{name}_questions.py" for name in SUBJECTS]


def page(text: str, outputs: dict[str, str]) -> str:
    """The page: its first part as it is, then the questions with what each test prints."""
    found = {path: list(questions_of(path)) for path in files()}
    count = sum(map(len, found.values()))
    parts = [text.partition(_HEAD.partition("\n")[0])[0], _HEAD.format(count=count), *_contents(found)]
    for path, questions in found.items():
        parts.append(f"\n## {subject(path)}\n\n{introduction(path)}")
        parts += [_entry(question, outputs.get(question.place, "")) for question in questions]
    rows = [(question, *why) for path in found for question, why in unanswered(path).items()]
    if rows:
        parts.append("\n## Not yet answered\n\n| question | source | needs |\n|---|---|---|\n")
        parts += [f"| {' | '.join(row)} |\n" for row in rows]
    return "".join(parts)


def _contents(found: dict[Path, list[Question]]) -> Iterator[str]:
    """Links to the questions, a list for each subject."""
    for path, questions in found.items():
        yield f"**[{subject(path)}](#{_slug(subject(path))})**\n\n"
        yield from (f"* [{question.question}](#{_slug(question.question)})\n" for question in questions)
        yield "\n"


def _slug(title: str) -> str:
    """Anchor of a heading, as MkDocs makes it."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title.encode("ascii", "ignore").decode()).strip().lower())


def _entry(question: Question, printed: str) -> str:
    code = f"```python no-run\n{question.code}\n```\n\n" if question.code else ""
    mark = f" exit={question.exit_code}" if question.exit_code else ""
    command = f"```console no-run{mark}\n$ {question.command}\n```\n\n" if question.command else ""
    output = f"```{'text' if command else 'output'}\n{printed}```\n\n" if printed else ""
    origin = f"Source: {question.source}. Checked against {question.origin}."
    return f"\n### {question.question}\n\n{question.answer}\n\n{code}{command}{output}{origin}\n"


def outputs_shown(text: str) -> dict[str, str]:
    """What the page shows below the code of each question."""
    sections = dict(re.findall(r"^### ([^\n]+)\n(.*?)(?=^##|\Z)", text, re.MULTILINE | re.DOTALL))
    shown = {}
    for question in (q for path in files() for q in questions_of(path)):
        block = re.search(
            r"^```(?:output|text)\n(.*?)^```", sections.get(question.question, ""), re.MULTILINE | re.DOTALL
        )
        shown[question.place] = block[1] if block else ""
    return shown


class Printed:
    """Plugin of pytest that collects what the tests print; `tests/questions/conftest.py` fills it."""

    __name__ = "questions"

    def __init__(self) -> None:
        self.outputs: dict[str, str] = {}


def main(names: Iterable[str]) -> int:
    """Run the tests, or those of some subjects; write the page with outputs that changed."""
    import pytest

    sys.path.insert(0, str(_DOCS))
    from outputs import agree

    printed = Printed()
    chosen = [str(TESTS / f"test_{name}_questions.py") for name in names] or [str(TESTS)]
    code = pytest.main([*chosen, "-q", "-m", "slow or not slow", "-p", "no:cacheprovider"], plugins=[printed])
    text = PAGE.read_text("utf-8")
    kept = outputs_shown(text)
    changed = {place: text for place, text in printed.outputs.items() if not agree(kept.get(place, ""), text)}
    PAGE.write_text(page(text, kept | changed), encoding="utf-8")
    return int(code)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
