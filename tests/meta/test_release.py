"""A release: its version in all places, the conda recipe and the locked environment agree with pyproject.toml."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import pytest
import yaml
from places import ROOT
from tools import conda_recipe, install_lines, release

import twistwrench as tw
from twistwrench.core import errors

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
ADDRESS = "https://forge.example/tw/twistwrench"
LOCK = ROOT / "tools" / "dev.lock"


# ── Version


@pytest.fixture
def copy(tmp_path):
    """Copy of the files that have the version."""
    for name in (release.VERSION, release.CITATION, release.CHANGES, release.PROJECT, release.RECIPE):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def texts(root: Path) -> dict[str, str]:
    return {path.relative_to(root).as_posix(): path.read_text("utf-8") for path in root.rglob("*") if path.is_file()}


def test_the_version_is_the_same_in_all_places():
    assert set(release.versions().values()) == {tw.__version__}
    assert "version" in PROJECT["project"]["dynamic"] and "version" not in PROJECT["project"]
    assert PROJECT["tool"]["hatch"]["version"]["path"] == release.VERSION


def test_a_release_writes_version_day_and_address_and_then_its_tag_may_be_published(copy, capsys):
    release.main(["1.2.3", "--date", "2027-01-31", "--repository", ADDRESS], copy)

    assert set(release.versions(copy).values()) == {"1.2.3"}
    citation = yaml.safe_load((copy / release.CITATION).read_text("utf-8"))
    assert (citation["version"], str(citation["date-released"])) == ("1.2.3", "2027-01-31")
    assert citation["repository-code"] == ADDRESS
    assert "\n## 1.2.3 (2027-01-31)\n" in (copy / release.CHANGES).read_text("utf-8")
    assert yaml.safe_load((copy / release.RECIPE).read_text("utf-8"))["about"]["repository"] == ADDRESS
    assert "git tag v1.2.3" in capsys.readouterr().out
    release.main(["--check", "v1.2.3"], copy)


def test_a_release_changes_no_other_line(copy):
    before = texts(copy)
    release.main(["1.2.3", "--date", "2027-01-31"], copy)
    changed = {
        name: {*text.splitlines()} ^ {*before[name].splitlines()}
        for name, text in texts(copy).items()
        if text != before[name]
    }
    assert {name: len(lines) for name, lines in changed.items()} == {
        release.VERSION: 2, release.CITATION: 3, release.CHANGES: 2, release.RECIPE: 2,
    }  # fmt: skip


def test_the_same_release_twice_is_one_and_keeps_the_address(copy):
    release.main(["1.2.3", "--date", "2027-01-31", "--repository", ADDRESS], copy)
    once = texts(copy)
    release.main(["1.2.3", "--date", "2027-01-31"], copy)
    assert texts(copy) == once


def test_a_dry_run_prints_the_changes_and_writes_nothing(copy, capsys):
    before = texts(copy)
    release.main(["1.2.3", "--dry-run", "--date", "2027-01-31"], copy)
    assert texts(copy) == before
    printed = capsys.readouterr().out
    assert '+__version__ = "1.2.3"' in printed and "+date-released: 2027-01-31" in printed


@pytest.mark.parametrize("version", ["1.2", "v1.2.3", "1.2.3.dev1", "01.2.3", ""])
def test_other_forms_of_a_version_are_refused(version, copy, capsys):
    with pytest.raises(SystemExit):
        release.main([version], copy)
    assert "MAJOR.MINOR.PATCH" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["forge.example/tw", "http://forge.example/tw", f"{ADDRESS}/", 'https://a.b/c" #'])
def test_other_forms_of_an_address_are_refused(address, copy):
    before = texts(copy)
    with pytest.raises(SystemExit):
        release.main(["1.2.3", "--repository", address], copy)
    assert texts(copy) == before


def test_a_tag_is_not_published_before_its_release_was_written(copy):
    said = "\n".join(release.disagreements(f"v{tw.__version__}", copy))
    if release.UNRELEASED in (copy / release.CHANGES).read_text("utf-8"):
        assert release.UNRELEASED in said
    release.main(["1.2.3", "--repository", ADDRESS], copy)
    assert "'v1.2.3'" in "\n".join(release.disagreements("v1.2.4", copy))
    (copy / release.CITATION).write_text("version: 1.2.2\n", "utf-8")
    assert [text.split()[0] for text in release.disagreements("v1.2.3", copy)] == [release.CITATION] * 2


def test_a_section_of_another_release_is_not_renamed(copy):
    release.main(["1.2.3", "--date", "2027-01-31"], copy)
    with pytest.raises(SystemExit, match="not yet released"):
        release.main(["1.2.4"], copy)


# ── Conda


def test_the_recipe_is_what_pyproject_gives():
    assert (ROOT / release.RECIPE).read_text("utf-8") == conda_recipe.recipe(tw.__version__, PROJECT)


def test_the_recipe_as_data_has_name_licence_entry_point_and_dependencies():
    found, metadata = yaml.safe_load((ROOT / release.RECIPE).read_text("utf-8")), PROJECT["project"]
    assert (found["schema_version"], found["build"]["noarch"]) == (1, "python")
    assert found["package"] == {"name": metadata["name"], "version": "${{ version }}"}
    assert found["context"] == {"version": tw.__version__}
    assert found["about"]["license"] == metadata["license"] == "BSD-3-Clause"
    assert all((ROOT / name).is_file() for name in found["about"]["license_file"])
    assert found["about"]["summary"] == metadata["description"]
    assert found["build"]["python"]["entry_points"] == ["twistwrench = twistwrench.cli.main:main"]
    python = f"python {metadata['requires-python']}"
    run = [re.sub(r"\s*;.*", "", need).replace(">=", " >=") for need in metadata["dependencies"]]
    assert found["requirements"] == {"host": [python, "pip", "hatchling"], "run": [python, *run]}
    assert found["source"] == {"path": "../../dist/twistwrench-${{ version }}.tar.gz"}


def test_for_an_index_the_recipe_has_the_hash_of_the_sdist(tmp_path):
    sdist = tmp_path / "twistwrench-0.1.0.tar.gz"
    sdist.write_bytes(b"abc")
    source = yaml.safe_load(conda_recipe.recipe("0.1.0", PROJECT, sdist))["source"]
    assert source["sha256"] == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert source["url"].endswith("/twistwrench-${{ version }}.tar.gz")


def test_a_dependency_for_some_platforms_is_not_taken_silently():
    with pytest.raises(SystemExit, match="marker"):
        conda_recipe.conda_name("colorama>=0.4; sys_platform == 'win32'")


# ── Commands that install an extra

PAGES = [
    *ROOT.glob("*.md"),
    *(ROOT / "docs").rglob("*.md"),
    *ROOT.glob("notebooks/*.ipynb"),
    *ROOT.glob("examples/*.py"),
]
EXTRAS = PROJECT["project"]["optional-dependencies"]


def test_pages_install_extras_as_in_a_checkout_which_always_works():
    by_name = re.compile(r"pip (?!install --no-index)[^\n`]*twistwrench\[[^\n`]*")
    assert {path.name: found for path in PAGES if (found := by_name.findall(path.read_text("utf-8")))} == {}


def test_every_extra_that_a_page_or_a_message_names_exists():
    texts = [path.read_text("utf-8") for path in [*PAGES, *(ROOT / "src").rglob("*.py")]]
    on_pages = {
        name for text in texts for _, _, names in install_lines.CHECKOUT.findall(text) for name in names.split(",")
    }
    in_messages = {name for text in texts for name in re.findall(r'MissingExtraError\.advice\("(\w+)"\)', text)}
    assert (on_pages | in_messages) - {"NAME", "…"} <= set(EXTRAS)
    assert {"plot", "symbolic", "logs", "clearance", "viz", "xacro"} <= on_pages | in_messages


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_of_a_version_on_an_index_no_page_installs_from_a_checkout(page):
    before = page.read_text("utf-8")
    after = install_lines.for_index(before)
    assert not install_lines.CHECKOUT.search(after) and "in a checkout of this repository" not in after
    assert after.count("twistwrench[") - before.count("twistwrench[") == len(install_lines.CHECKOUT.findall(before))


@pytest.mark.parametrize(
    ("on_index", "last"), [(False, "in a checkout of twistwrench"), (True, "pip install 'twistwrench[plot]'")]
)
def test_a_message_names_the_index_only_if_the_version_is_on_one(on_index, last, monkeypatch):
    monkeypatch.setattr(errors, "ON_INDEX", on_index)
    said = str(tw.MissingExtraError.from_extra("matplotlib", "plot", "Drawing"))
    assert "pip install -e '.[plot]' in a checkout" in said and said.removesuffix(".").endswith(last)
    assert ("twistwrench[" in said) == on_index


def test_the_constant_is_decided_at_build(monkeypatch):
    """release_check compares it in wheel and sdist with the setting; here: the source has it once, and says no."""
    assert install_lines.VERSION.read_text("utf-8").count(install_lines.CONSTANT.format(False)) == 1
    monkeypatch.delenv("TWISTWRENCH_ON_INDEX", raising=False)
    assert not install_lines.on_index()
    monkeypatch.setenv("TWISTWRENCH_ON_INDEX", "1")
    assert install_lines.on_index()


# ── Locked environment


def locked() -> dict[str, list[tuple[str, str, int]]]:
    """Version, marker and number of hashes of each package in the lock; some have several versions by marker."""
    found: dict[str, list[tuple[str, str, int]]] = {}
    for entry in re.split(r"^(?=[A-Za-z])", LOCK.read_text("utf-8"), flags=re.MULTILINE)[1:]:
        pin = re.match(r"([\w.-]+)==(\S+)(?: ; (.*?))? \\\n", entry)
        assert pin, entry.splitlines()[0]
        hashes = re.findall(r"^    --hash=sha256:[0-9a-f]{64}(?: \\)?$", entry, re.MULTILINE)
        assert len(hashes) == entry.count("\n") - 1, f"{pin[1]}: a line that is not a SHA-256"
        found.setdefault(pin[1], []).append((pin[2], pin[3] or "", len(hashes)))
    return found


def needs(extra: str) -> list[str]:
    """Requirements of an extra, those of the extras that it names included."""
    found = []
    for need in PROJECT["project"]["optional-dependencies"][extra]:
        inner = re.match(r"twistwrench\[([\w,-]+)\]", need)
        found += [more for name in inner[1].split(",") for more in needs(name)] if inner else [need]
    return found


def test_the_lock_has_every_package_of_dev_at_an_allowed_version_with_hashes():
    requirements = pytest.importorskip("packaging.requirements")
    utils = pytest.importorskip("packaging.utils")
    pins, seen = locked(), set()
    for text in [*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"], *needs("dev")]:
        need = requirements.Requirement(text)
        name = utils.canonicalize_name(need.name)
        assert name in pins, f"tools/dev.lock lacks {name}: make lock"
        for version, _, hashes in pins[name]:
            assert need.specifier.contains(version, prereleases=True), f"{name} {version} is not {need}: make lock"
            assert hashes > 0
        seen.add(name)
    assert len(seen) > 40 and len(pins) > len(seen)


def test_the_lock_names_no_index_and_no_file():
    text = LOCK.read_text("utf-8")
    assert not re.search(r"://|index|find-links|trusted|file:| @ |/", text)
    assert "make lock" in text.splitlines()[1]
