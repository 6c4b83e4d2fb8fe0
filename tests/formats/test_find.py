"""Robots by name: where they are looked for, in which order, and that nothing is fetched unless asked."""

from __future__ import annotations

import ast
import importlib.util
import re
import socket
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from places import ROOT
from robot_files import FILES

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.robots import finding
from twistwrench.robots.finding import known_robots

examples = pytest.mark.skipif(
    not any(not k.startswith("beside/") for k in FILES), reason="example-robot-data is missing"
)

MODULE = """
from os import getenv as _getenv
from os import path as _path

from ._cache import clone_to_cache as _clone_to_cache

REPOSITORY_PATH: str = _clone_to_cache(
    "menagerie",
    commit=_getenv("ROBOT_DESCRIPTION_COMMIT", None),
)
PACKAGE_PATH: str = _path.join(REPOSITORY_PATH, "arms", "one")
{kind}_PATH: str = _path.join(PACKAGE_PATH, "{file}")
"""
TABLE = """
from dataclasses import dataclass
REPOSITORIES = {
    "menagerie": Repository(url="https://nowhere.invalid/x.git", commit="0" * 40, cache_path="menagerie_at"),
}
"""


@pytest.fixture
def fetched(tmp_path, monkeypatch):
    """A package as robot_descriptions is, with two descriptions, one of which is in the cache. Importing them fails."""
    package = tmp_path / "site" / "robot_descriptions"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(
        "DESCRIPTIONS = {'one_description': 1, 'two_mj_description': 2, 'bad_description': 3}"
    )
    (package / "_cache.py").write_text("def clone_to_cache(*_, **__): raise OSError('no network')")
    (package / "_repositories.py").write_text(TABLE)
    (package / "one_description.py").write_text(MODULE.format(kind="URDF", file="one.urdf"))
    (package / "two_mj_description.py").write_text(MODULE.format(kind="MJCF", file="two.xml"))
    (package / "three_description.py").write_text(MODULE.format(kind="XACRO", file="three.urdf.xacro"))
    (package / "bad_description.py").write_text("this is no Python")
    there = tmp_path / "cache" / "menagerie_at" / "arms" / "one"
    there.mkdir(parents=True)
    (there / "one.urdf").write_text('<robot name="one"><link name="a"/></robot>')
    (there / "three.urdf.xacro").write_text("<robot/>")
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    for name in [name for name in sys.modules if name.partition(".")[0] == "robot_descriptions"]:
        monkeypatch.delitem(sys.modules, name)
    yield there
    for name in [name for name in sys.modules if name.partition(".")[0] == "robot_descriptions"]:
        del sys.modules[name]


def test_descriptions_that_the_page_imports_are_in_the_package_of_the_index(tmp_path, monkeypatch):
    """Names and attributes of the page, read from the package without importing its modules, which clone repositories."""
    spec = importlib.util.find_spec("robot_descriptions")
    if spec is None:
        pytest.skip("robot_descriptions is not installed")
    package = Path(spec.submodule_search_locations[0])
    text = (ROOT / "docs" / "formats.md").read_text("utf-8")
    imported = re.search(r"^from robot_descriptions import (.+)$", text, re.MULTILINE)[1].split(", ")
    used = dict(re.findall(r"tw\.load\((\w+_description)\.(\w+)\)", text))
    assert list(used) == imported
    for module, attribute in used.items():
        assigned = ast.walk(ast.parse((package / f"{module}.py").read_text("utf-8")))
        assert attribute in {node.id for node in assigned if isinstance(node, ast.Name)}, module

    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path))  # as after a download, by the package's own tables
    places = {name: tmp_path / place for name, place in finding._repositories(package / "_repositories.py").items()}
    file = finding._path_in_module(package / "iiwa14_description.py", places)
    file.parent.mkdir(parents=True)
    file.write_text('<robot name="iiwa14"><link name="base"/></robot>')
    assert tw.find("iiwa14") == file


def test_bundled_robots_come_first():
    assert all(tw.find(name) == tw.robots.path_of(name) for name in tw.robots.names())
    assert tw.find("Planar-2R") == tw.robots.path_of("planar_2r")


@examples
def test_example_robot_data_is_known_by_files_and_by_folders():
    known = known_robots()
    assert tw.find("talos_reduced").name == "talos_reduced.urdf"
    assert tw.find("talos").name == "talos_full_v2.urdf"  # of those that begin with talos_, the shortest
    assert tw.find("ur10").name == "ur10_robot.urdf"
    assert tw.find("anymal-kinova").name == "anymal-kinova.urdf"
    assert tw.find("anymal_b") != tw.find("anymal_c")
    assert tw.find("cassie").suffix == ".sdf"
    assert "ur" not in known
    assert known["panda"].source == "twistwrench"  # which both packages have
    paths = {robot.path for robot in known.values()}
    assert all(path.is_file() for path in paths)
    assert {p for name, p in FILES.items() if not name.startswith("beside/")} <= paths | {tw.find("panda")} | _shadowed(
        paths
    )


def _shadowed(paths):
    """Files of the package that have the name of a bundled robot."""
    return {p for p in FILES.values() if p.stem in tw.robots.names()}


def test_robot_descriptions_are_known_where_they_are_in_the_cache_and_nothing_is_imported(fetched):
    assert tw.find("one") == fetched / "one.urdf"
    assert not any(name.startswith("robot_descriptions.") for name in sys.modules)
    with pytest.raises(tw.UnknownNameError, match="no robot named 'two_mj'"):
        tw.find("two_mj")
    with pytest.raises(tw.UnknownNameError):
        tw.find("three")  # xacro is never evaluated
    (fetched / "two.xml").write_text("<mujoco/>")
    assert tw.find("two-mj") == fetched / "two.xml"


def test_download_is_asked_of_robot_descriptions_only(fetched):
    with pytest.raises(tw.NotFoundError, match="could not fetch 'two_mj': no network"):
        tw.find("two_mj", download=True)
    with pytest.raises(tw.UnknownNameError, match="no robot of robot_descriptions named 'four'"):
        tw.find("four", download=True)
    assert tw.find("one", download=True) == fetched / "one.urdf"


def test_finding_opens_no_connection(monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("a connection was opened")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(socket, "create_connection", refuse)
    tw.find("ur5")
    with pytest.raises(tw.UnknownNameError):
        tw.find("no such robot")


def test_near_names_are_suggested():
    with pytest.raises(tw.UnknownNameError, match="Did you mean 'quadruped'"):
        tw.find("quadrupet")
    for name in (None, 3, ""):
        with pytest.raises(tw.UnknownNameError):
            tw.find(name)


def test_a_robot_is_loaded_by_its_name_unless_a_file_has_it(fetched, tmp_path, monkeypatch):
    assert tw.load("ONE").name == tw.load(tw.find("one")).name
    assert tw.load("quadruped").nq == tw.robots.quadruped().nq  # with the options of the bundled robot
    assert tw.load("quadruped", floating_base=False).nq == 12
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ur5").write_text(tw.robots.pendulum().to_urdf())
    assert tw.load("ur5").name == "pendulum"
    with pytest.raises(tw.NotFoundError, match="'no_such_robot', and no bundled robot of that name"):
        tw.load("no_such_robot")
    with pytest.raises(tw.NotFoundError) as refused:
        tw.load("one.urdf")
    assert "bundled" not in str(refused.value)


# ── in the shell ──


def run(*arguments, **options):
    return CliRunner().invoke(main, list(arguments), **options)


def test_every_command_takes_such_a_name(fetched):
    assert run("info", "ONE").exit_code == 0
    missing = run("info", "oen")
    assert (missing.exit_code, "'one'" in missing.stderr) == (2, True)


def test_robots_lists_them_by_source(fetched):
    said = run("robots", "one", "--all").stdout
    assert "of robot_descriptions" in said
    assert "arms/one/one.urdf" in said
    assert run("robots").stdout.count("of robot_descriptions") == 1
    assert run("robots", "no such robot").exit_code == 2


def test_a_robot_comes_by_standard_input_to_be_converted(tmp_path):
    text = tw.robots.ur5().to_urdf()
    done = run("convert", "-", str(tmp_path / "a.sdf"), input=text)
    assert done.exit_code == 0 and done.output.count("lost:") == 1 and "the tip is not kept" in done.output
    assert tw.load(tmp_path / "a.sdf").nv == 6
    assert run("convert", "-", str(tmp_path / "a.urdf"), input=text).exit_code == 0
