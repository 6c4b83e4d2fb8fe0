"""What all tests share: a cache of compiled code that is theirs alone, and the bundled robots."""

from __future__ import annotations

import functools
import os
import shutil
import tempfile
from collections.abc import Callable

import pytest

import twistwrench as tw

CACHE = "TWISTWRENCH_CACHE_DIR"


def pytest_configure(config: pytest.Config) -> None:
    """Point the cache at a new folder before any test is collected; the workers of pytest-xdist inherit it."""
    if not hasattr(config, "workerinput"):
        config.stash[_FOLDER] = os.environ[CACHE] = tempfile.mkdtemp(prefix="twistwrench-tests-")


def pytest_unconfigure(config: pytest.Config) -> None:
    folder = config.stash.get(_FOLDER, None)
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)


_FOLDER = pytest.StashKey[str]()


@pytest.fixture(scope="session")
def bundled() -> Callable[[str], tw.Robot]:
    """The bundled robot of a name, loaded once."""
    return functools.cache(lambda name: getattr(tw.robots, name)())
