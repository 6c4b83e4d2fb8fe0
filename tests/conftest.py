"""What all tests share: a cache of compiled code that is theirs alone, and the bundled robots."""

from __future__ import annotations

import gc
import os
import shutil
import tempfile
from collections.abc import Callable, Generator
from pathlib import Path

import pytest
from shared_robots import shared

import twistwrench as tw

collect_ignore = ["support", "faulty_logs"]
"""Helpers without tests or examples. In old versions of pytest, a module of fixtures that the search for examples has seen
is not a plugin for others any more."""

CACHE = "TWISTWRENCH_CACHE_DIR"


def pytest_configure(config: pytest.Config) -> None:
    """What the workers of pytest-xdist inherit: a new folder as the cache, and one thread of BLAS each.

    Workers whose BLAS has as many threads as there are cores wait for each other: small factorisations take three times as long.
    """
    if not hasattr(config, "workerinput"):
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        os.environ.setdefault("COLUMNS", "110")  # sentences that tests look for stay on their lines
        config.stash[_FOLDER] = os.environ[CACHE] = tempfile.mkdtemp(prefix="twistwrench-tests-")


def pytest_unconfigure(config: pytest.Config) -> None:
    folder = config.stash.get(_FOLDER, None)
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.rmtree(folder + "-level-0", ignore_errors=True)


_FOLDER = pytest.StashKey[str]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--by-file", action="store_true", help="list the seconds that each test file took")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """What each file took, the slowest first."""
    if not config.getoption("--by-file"):
        return
    taken: dict[str, float] = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                name = report.nodeid.partition("::")[0]
                taken[name] = taken.get(name, 0.0) + report.duration
    for name, seconds in sorted(taken.items(), key=lambda item: -item[1])[:60]:
        terminalreporter.write_line(f"{seconds:8.1f} s  {name}")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without looking for cycles: a quarter of the time, as hardly anything that is made then is let go."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Examples that need a newer SciPy than the oldest that is allowed."""
    examples = [item for item in items if item.name.endswith(("se3.as_scipy", "se3.from_scipy"))]
    if examples:
        from scipy.spatial import transform

        if not hasattr(transform, "RigidTransform"):
            for item in examples:
                item.add_marker(pytest.mark.skip(reason="RigidTransform came with SciPy 1.16"))


ROOT = Path(__file__).resolve().parents[1]
IGNORED = {line.strip("/") for line in (ROOT / ".gitignore").read_text("utf-8").split()}


@pytest.fixture(autouse=True)
def folder_without_strays() -> Generator[None]:
    """A test writes into a folder of its own: none may leave a file in the folder in which the tests run."""
    place = Path.cwd()
    before = {*os.listdir(place)}
    yield
    strays = {*os.listdir(place)} - before - IGNORED
    assert not strays, f"{sorted(strays)} came into {place} while this test ran. Write into tmp_path."


FILES_OF_MACHINE_CODE = ("tests/kernels/", "tests/program/")


@pytest.fixture(autouse=True, scope="module")
def level_of_generated_code(request: pytest.FixtureRequest) -> Generator[None]:
    """Quick tests compile as users do only where machine code is the subject.

    All others generate it without LLVM's optimisation, in less than half the time: its bits are the same, as
    ``test_bits_do_not_depend_on_the_level_of_optimisation`` holds. Files of the two levels share no entries of the cache.
    """
    place = Path(request.node.path).relative_to(ROOT).as_posix()
    if place.startswith(FILES_OF_MACHINE_CODE) or request.config.option.markexpr != "not slow":
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("twistwrench.compiler.runtime.jit.CODE_GENERATION_LEVEL", 0)
        patch.setenv(CACHE, os.environ[CACHE] + "-level-0")
        yield


@pytest.fixture(scope="session")
def bundled() -> Callable[[str], tw.Robot]:
    """The bundled robot of a name, loaded once."""
    return shared(lambda name: getattr(tw.robots, name)())
