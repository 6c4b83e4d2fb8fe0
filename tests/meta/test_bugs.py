"""The catalogue of bugs fits the source: each can be put in, and the tests that are to notice it are there."""

from __future__ import annotations

import tomllib
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parents[1]
SOURCE = TESTS.parent / "src" / "twistwrench"
BUGS = [
    bug for path in sorted((TESTS / "bugs").glob("*.toml")) for bug in tomllib.loads(path.read_text("utf-8"))["bug"]
]


def test_every_bug_stands_once_in_its_file_and_is_one():
    """Whoever changes a line that a bug is about changes the bug with it."""
    assert len(BUGS) > 300
    odd = [
        bug["name"]
        for bug in BUGS
        if (SOURCE / bug["file"]).read_text("utf-8").count(bug["right"]) != 1 or bug["right"] == bug["wrong"]
    ]
    assert odd == []
    assert [name for name, count in Counter(bug["name"] for bug in BUGS).items() if count > 1] == []


def test_the_tests_that_notice_a_bug_are_there():
    missing = []
    for bug in BUGS:
        for test in bug["tests"]:
            file, _, function = test.partition("::")
            path = TESTS / file
            if not path.is_file() or (function and f"def {function.partition('[')[0]}(" not in path.read_text("utf-8")):
                missing.append((bug["name"], test))
    assert missing == []
