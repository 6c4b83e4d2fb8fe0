"""Fixtures of the tests of calls on several threads."""

from __future__ import annotations

import pytest

import twistwrench as tw
from twistwrench.compiler.runtime import batch_threads


@pytest.fixture(scope="module")
def panda() -> tw.Robot:
    return tw.robots.panda()


@pytest.fixture
def jobs(monkeypatch) -> list[batch_threads._Job]:
    """Three batch_threads, small calls cut as well; every call that was shared leaves its job here."""
    made: list[batch_threads._Job] = []

    class Watched(batch_threads._Job):
        def __init__(self, kernel, its_parts):
            super().__init__(kernel, its_parts)
            made.append(self)

    monkeypatch.setattr(batch_threads, "_Job", Watched)
    monkeypatch.setattr(batch_threads, "MIN_PART", 2e4)
    monkeypatch.setattr(batch_threads._THREADS, "wanted", batch_threads._THREADS.wanted)
    tw.set_threads(3)
    yield made
    tw.set_threads(1)
