"""Set the version of a release wherever it stands: `python -m tools.release 0.1.0`.

The version is that of src/twistwrench/core/version.py, which the build reads. CITATION.cff has it with the day of the release,
CHANGELOG.md as the heading of its first section, and tools/conda/recipe.yaml as the package to build. With ``--repository`` the
address that the README's links lead to on a package index is set too; nothing else is needed to publish.

``--dry-run`` prints the changes and writes nothing. ``--check TAG`` changes nothing and ends with an error unless the tag, the
version and the heading agree, as the release job does before it builds.
"""

from __future__ import annotations

import argparse
import datetime
import difflib
import re
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tools.conda_recipe import recipe

ROOT = Path(__file__).resolve().parents[1]
VERSION, CITATION, CHANGES, PROJECT, RECIPE = (
    "src/twistwrench/core/version.py",
    "CITATION.cff",
    "CHANGELOG.md",
    "pyproject.toml",
    "tools/conda/recipe.yaml",
)
_FORM = re.compile(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)((a|b|rc)\d+)?")
"""MAJOR.MINOR.PATCH, and a pre-release as PEP 440 writes it."""
_ADDRESS = re.compile(r"https://[\w.-]+/[\w./-]*\w")
_HEADING = re.compile(r"^## (\S+) \((.+)\)$", re.MULTILINE)
UNRELEASED = "not yet released"


@dataclass(frozen=True)
class Release:
    """Version, day and address to write."""

    version: str
    day: datetime.date
    repository: str | None = None

    def module(self, text: str) -> str:
        """Text of version.py."""
        return _replaced(VERSION, r'^__version__ = ".*"$', f'__version__ = "{self.version}"', text)

    def citation(self, text: str) -> str:
        """Text of CITATION.cff, whose line of the day follows that of the version."""
        replaced = "date-released|repository-code" if self.repository else "date-released"
        text = re.sub(rf"^({replaced}): .*\n", "", text, flags=re.MULTILINE)
        lines = [f"version: {self.version}", f"date-released: {self.day.isoformat()}"]
        if self.repository:
            lines.append(f"repository-code: {self.repository}")
        return _replaced(CITATION, r"^version: .*$", "\n".join(lines), text)

    def changes(self, text: str) -> str:
        """Text of CHANGELOG.md, whose first section becomes that of this version."""
        heading = _HEADING.search(text)
        if heading is None or (heading[2] != UNRELEASED and heading[1] != self.version):
            raise SystemExit(f"The first section of {CHANGES} must be headed '## VERSION ({UNRELEASED})'.")
        return f"{text[: heading.start()]}## {self.version} ({self.day.isoformat()}){text[heading.end() :]}"

    def project(self, text: str) -> str:
        """Text of pyproject.toml, with the address if one is given."""
        if self.repository is None:
            return text
        return _replaced(PROJECT, r'^repository = ".*?"', f'repository = "{self.repository}"', text)

    def changed(self, root: Path) -> dict[str, tuple[str, str]]:
        """Text before and after of each file that changes."""
        before = {name: (root / name).read_text("utf-8") for name in (VERSION, CITATION, CHANGES, PROJECT, RECIPE)}
        project = self.project(before[PROJECT])
        after = {
            VERSION: self.module(before[VERSION]),
            CITATION: self.citation(before[CITATION]),
            CHANGES: self.changes(before[CHANGES]),
            PROJECT: project,
            RECIPE: recipe(self.version, tomllib.loads(project)),
        }
        return {name: (text, after[name]) for name, text in before.items() if text != after[name]}


def _replaced(name: str, pattern: str, line: str, text: str) -> str:
    """Text with the one line of the pattern replaced."""
    changed, count = re.subn(pattern, lambda _: line, text, flags=re.MULTILINE)
    if count != 1:
        raise SystemExit(f"{name} has {count} lines of the form {pattern}; it must have one.")
    return changed


def _found(root: Path, name: str, pattern: str) -> str:
    found = re.search(pattern, (root / name).read_text("utf-8"), re.MULTILINE)
    return found[1] if found else ""


def versions(root: Path = ROOT) -> dict[str, str]:
    """Version in each file that has it; empty where there is none."""
    return {
        VERSION: _found(root, VERSION, r'^__version__ = "(.*)"$'),
        CITATION: _found(root, CITATION, r"^version: (.*)$"),
        CHANGES: _found(root, CHANGES, r"^## (\S+) \("),
        RECIPE: _found(root, RECIPE, r'^  version: "(.*)"$'),
    }


def disagreements(tag: str, root: Path = ROOT) -> list[str]:
    """What keeps a tag from being published: one sentence each."""
    places = versions(root)
    version = places.pop(VERSION)
    said = [
        f"{name} has version {other!r}, {VERSION} {version!r}." for name, other in places.items() if other != version
    ]
    if tag != f"v{version}":
        said.append(f"The tag is {tag!r}, the version {version!r}: it must be tagged 'v{version}'.")
    if _found(root, CHANGES, r"^## \S+ \((.+)\)$") == UNRELEASED:
        said.append(f"The first section of {CHANGES} is {UNRELEASED}: run python -m tools.release {version}.")
    if not _found(root, CITATION, r"^date-released: (\d{4}-\d{2}-\d{2})$"):
        said.append(f"{CITATION} has no date-released: run python -m tools.release {version}.")
    if not _found(root, PROJECT, r'^repository = "(.*?)"'):
        said.append(
            "The address of the repository is not set: run python -m tools.release VERSION --repository https://…."
        )
    return said


def main(arguments: Sequence[str] | None = None, root: Path = ROOT) -> None:
    """Command line of this script."""
    parser = argparse.ArgumentParser(prog="tools/release.py", description=__doc__.splitlines()[0])
    parser.add_argument("version", nargs="?", help="MAJOR.MINOR.PATCH, such as 0.1.0 or 0.2.0rc1")
    parser.add_argument("--date", type=datetime.date.fromisoformat, help="day of the release [default: today]")
    parser.add_argument("--repository", help="address of the repository, https://…")
    parser.add_argument("--dry-run", action="store_true", help="print the changes and write nothing")
    parser.add_argument("--check", metavar="TAG", help="change nothing; fail unless version, heading and tag agree")
    given = parser.parse_args(arguments)
    if given.check is not None:
        if said := disagreements(given.check, root):
            raise SystemExit("\n".join(said))
        print(f"{given.check}: version, citation, changes and recipe agree")
        return
    if not _FORM.fullmatch(given.version or ""):
        parser.error(f"{given.version!r} is not a version; write MAJOR.MINOR.PATCH, such as 0.1.0 or 0.2.0rc1")
    if given.repository is not None and not _ADDRESS.fullmatch(given.repository):
        parser.error(
            f"{given.repository!r} is not an address; write https://HOST/OWNER/NAME, without a stroke at its end"
        )
    release = Release(given.version, given.date or datetime.date.today(), given.repository)
    for name, (before, after) in release.changed(root).items():
        if given.dry_run:
            lines = before.splitlines(keepends=True), after.splitlines(keepends=True)
            sys.stdout.writelines(difflib.unified_diff(*lines, name, name, n=0))
        else:
            (root / name).write_text(after, "utf-8")
            print(f"wrote {name}")
    if not given.dry_run:
        tag = f"v{given.version}"
        print(
            f"then: make release-check && git commit -am 'Version {given.version}' && git tag {tag} && git push origin {tag}"
        )


if __name__ == "__main__":
    main()
