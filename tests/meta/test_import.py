"""Importing does nothing but import, and every public name is where it is promised, with its explanation."""

from __future__ import annotations

import ast
import importlib
import inspect
import os
import pkgutil
import subprocess
import sys
import types
from importlib import resources
from pathlib import Path

import pytest

import twistwrench as tw

ROOT = Path(__file__).resolve().parents[2]

LATER = (
    "llvmlite",
    "scipy",
    "matplotlib",
    "rich",
    "click",
    "mpmath",
    "mujoco",
    "pinocchio",
    "multiprocessing",
    "difflib",
    "platformdirs",
)
LATER += (
    "twistwrench.mechanics.algorithms",
    "twistwrench.formats",
    "twistwrench.compiler.ir",
    "twistwrench.mechanics.bodies",
    "twistwrench.robots",
)
MODULES = sorted(
    info.name for info in pkgutil.walk_packages(tw.__path__, "twistwrench.") if not info.name.endswith("__main__")
)


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Modules loaded by the import in a process of its own, warnings made errors, and the files that it left behind."""
    home = tmp_path_factory.mktemp("home")
    names = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "TMPDIR")
    environment = {**os.environ, **dict.fromkeys(names, str(home)), "PYTHONDONTWRITEBYTECODE": "1"}
    del environment["TWISTWRENCH_CACHE_DIR"]
    code = "import sys, threading, twistwrench; print(*sys.modules); assert threading.active_count() == 1"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], env=environment, cwd=home, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.split(), list(home.rglob("*"))


@pytest.mark.parametrize("package", LATER)
def test_import_leaves_for_later_what_is_needed_later(imported, package):
    loaded, _ = imported
    assert "twistwrench" in loaded
    assert not [name for name in loaded if f"{name}.".startswith(f"{package}.")]


def test_import_makes_no_files(imported):
    _, files = imported
    assert files == []


def test_the_public_names_are_sorted_and_complete():
    assert list(tw.__all__) == sorted(tw.__all__)
    assert len(set(tw.__all__)) == len(tw.__all__)
    everything = {name: getattr(tw, name) for name in tw.__all__}  # some are imported by this
    there = {
        name
        for name, value in vars(tw).items()
        if not name.startswith("_") and name != "annotations" and not isinstance(value, types.ModuleType)
    }
    modules = {name for name, value in everything.items() if isinstance(value, types.ModuleType)}
    results = set(tw._NAMES) - set(tw.__all__)  # classes of results, where something has asked for them
    assert there - results == set(tw.__all__) - modules
    assert modules == {"robots", "screws", "se3", "so3"}


def test_type_checkers_see_every_name_that_comes_later():
    """What is imported when first asked for is imported for type checkers, from the same place."""
    (block,) = [node for node in ast.parse(inspect.getsource(tw)).body if isinstance(node, ast.If)]
    seen = {
        alias.asname: f"{line.module or ''}.{alias.name}".strip(".")
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
    assert seen == {**tw._MODULES, **{name: f"{where}.{name}" for name, where in tw._NAMES.items()}}
    for name, where in seen.items():
        module = importlib.import_module(f"twistwrench.{tw._NAMES.get(name, where)}")
        assert getattr(tw, name) is (getattr(module, name) if name in tw._NAMES else module)


def test_a_name_that_is_not_there_is_no_attribute():
    with pytest.raises(AttributeError, match="'twistwrench' has no attribute 'nothing'"):
        tw.nothing  # noqa: B018


def test_dir_has_every_public_name_and_nothing_else():
    """Those that come when first asked for, too; what is only imported by the way is not part of it."""
    names = [name for name in dir(tw) if not name.startswith("_")]
    later = {
        "calibration",
        "control",
        "convert",
        "diagnosis",
        "identification",
        "modern_robotics",
        "pointwise",
        "sensing",
        "simulation",
        "sizing",
        "statics",
        "symbolic",
        "testing",
        "trajectories",
        "viz",
    }
    assert set(names) == set(tw.__all__) | later
    assert "__version__" in dir(tw)
    for name in later:
        assert isinstance(getattr(tw, name), types.ModuleType)
    assert tw.convert.to_pinocchio.__doc__


def constants_classes_functions(name: str) -> tuple[bool, bool, str]:
    return not name.isupper(), name[0].islower(), name


@pytest.mark.parametrize("module", MODULES)
def test_modules_say_what_they_are_and_what_they_export(module):
    loaded = importlib.import_module(module)
    assert loaded.__doc__
    exported = getattr(loaded, "__all__", [])
    assert list(exported) == sorted(exported, key=constants_classes_functions)
    assert all(hasattr(loaded, name) for name in exported)


def documented() -> list[tuple[str, object]]:
    """Public functions, classes and modules, and the classes' own public methods and properties."""
    found = []
    for name in tw.__all__:
        value = getattr(tw, name)
        found.append((name, value))
        if inspect.isclass(value):
            members = [(f"{name}.{n}", m) for n, m in vars(value).items()]
        elif inspect.ismodule(value):
            members = [(f"{name}.{n}", getattr(value, n)) for n in value.__all__]
        else:
            members = []
        found += [
            (label, m)
            for label, m in members
            if not label.partition(".")[2].startswith("_")
            and (callable(m) or isinstance(m, (property, staticmethod, classmethod)))
        ]
    return found


@pytest.mark.parametrize(("name", "value"), documented(), ids=[name for name, _ in documented()])
def test_every_public_name_is_explained(name, value):
    explanation = (inspect.getdoc(value) or "").strip()
    assert explanation.endswith((".", "``")) or "\n" in explanation
    if inspect.isclass(value):  # not the one inherited from ValueError
        assert vars(value).get("__doc__")


def test_type_information_is_shipped():
    assert (resources.files("twistwrench") / "py.typed").is_file()


def test_every_error_is_in_the_one_tree_and_the_tree_is_drawn():
    errors = importlib.import_module("twistwrench.core.errors")
    for name in errors.__all__:
        assert issubclass(getattr(errors, name), (tw.TwistWrenchError, UserWarning))
        assert name in errors.__doc__
        assert name in tw.__all__


def test_a_repr_says_what_it_is_in_a_line():
    arm = tw.robots.planar_2r()
    q = arm.neutral
    for thing, words in (
        (arm, "tip 'tip'"),
        (arm.model, "'planar_2r'"),
        (arm.program("gravity_forces"), "(2)->(2)"),
        (arm.inverse_kinematics(arm.forward_kinematics(q)), "reached"),
        (arm.explain(q, q, q), "gravity"),
        (tw.Ad(tw.Pose(arm.forward_kinematics(q), to="s", of="b")).T, "on wrenches from 's' to 'b'"),
        (tw.ad([0.0] * 6), "on twists"),
    ):
        assert words in repr(thing)
        assert len(repr(thing)) < 120
        assert "array(" not in repr(thing)


# ── Public names: a release keeps them, or the minor version before it warned of the change

LISTED = Path(__file__).with_name("public_names.txt")


def public_names():
    """Names of functions, classes and their members, by the module in which users find them."""
    packages = [tw, *(getattr(tw, name) for name in dir(tw) if inspect.ismodule(getattr(tw, name)))]
    for package in packages:
        for name in getattr(package, "__all__", ()):
            value = getattr(package, name)
            place = f"{package.__name__}.{name}"
            yield place
            if inspect.isclass(value):
                own = [base for base in value.__mro__ if base.__module__.startswith("twistwrench.")]
                yield from (f"{place}.{member}" for base in own for member in vars(base) if not member.startswith("_"))


def test_no_public_name_goes_without_notice():
    """Names that come are listed by the release that brings them, and at once while a release is prepared."""
    listed, now = {*LISTED.read_text("utf-8").split()}, {*public_names()}
    assert sorted(listed - now) == [], (
        "keep the name with a DeprecationWarning for a minor version, then take it from the list"
    )
    if "not yet released" not in (ROOT / "CHANGELOG.md").read_text("utf-8"):
        assert sorted(now - listed) == [], "python tests/meta/test_import.py"


if __name__ == "__main__":
    LISTED.write_text("\n".join(sorted({*public_names()})) + "\n", "utf-8")
