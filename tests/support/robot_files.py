"""Robot files to compare on: those of the package `example-robot-data`, and the folder beside this repository."""

from __future__ import annotations

import warnings
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest
from peers import pinocchio_model
from places import SHARED
from shared_robots import shared

import twistwrench as tw
from twistwrench.core.errors import TwistWrenchError

BESIDE = SHARED / "robots"


def _package_files() -> dict[str, Path]:
    try:
        package = distribution("example-robot-data")
    except PackageNotFoundError:
        return {}
    folder = Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots")))
    return {f"{path.parts[len(folder.parts)]}/{path.stem}": path for path in sorted(folder.rglob("*.urdf"))}


FILES = _package_files()
FILES |= {f"beside/{path.stem}": path for path in sorted(BESIDE.rglob("*.urdf"))}

NONE = [pytest.param(None, marks=pytest.mark.skip(reason="neither example-robot-data nor ../shared/robots is there"))]


@shared
def load(name: str, floating_base: bool) -> tw.Robot:
    """The robot exactly as its file says, so that what other libraries make of the same file can be compared."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        options = {"inertia": "accept", "mimic": "independent", "snap": 0}
        try:
            return tw.load(FILES[name], floating_base=floating_base, **options)
        except TwistWrenchError:
            pytest.skip("not read; with which reason is another test's business")


@cache
def in_pinocchio(name: str, floating_base: bool) -> object:
    """Pinocchio's model of the same file."""
    pytest.importorskip("pinocchio", reason="Pinocchio is not installed", exc_type=ImportError)
    try:
        return pinocchio_model(load(name, floating_base))
    except tw.RobotFileError:
        pytest.skip("Pinocchio does not read this file")
