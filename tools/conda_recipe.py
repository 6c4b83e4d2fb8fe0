"""Write the conda recipe from pyproject.toml: `python -m tools.conda_recipe`.

The package is ``noarch: python``, built from the sdist. The committed recipe takes the sdist that `python -m build` leaves in
dist/. For a channel that builds from an index, ``--sdist FILE`` prints the recipe with the address and the hash of that file.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RECIPE = ROOT / "tools" / "conda" / "recipe.yaml"
VERSION = ROOT / "src" / "twistwrench" / "core" / "version.py"
_INDEX = "https://pypi.org/packages/source/t/twistwrench/twistwrench-${{ version }}.tar.gz"
_PLATFORM = re.compile(r"\s*;\s*sys_platform != 'emscripten'")
"""The one marker of the core's dependencies; a conda package without a platform has no such systems."""


def conda_name(requirement: str) -> str:
    """Requirement as conda writes it: name, a space, versions.

    >>> conda_name("llvmlite>=0.45; sys_platform != 'emscripten'")
    'llvmlite >=0.45'
    """
    found = re.fullmatch(r"([A-Za-z0-9_.-]+)((?:[<>=!~]=?[\w.*]+,?)*)", _PLATFORM.sub("", requirement))
    if found is None:
        raise SystemExit(f"{requirement!r} has a marker or an extra that a package for all platforms cannot have.")
    return f"{found[1].lower()} {found[2]}".rstrip()


def recipe(version: str, project: dict[str, Any], sdist: Path | None = None) -> str:
    """Text of the recipe for a version, from the content of pyproject.toml."""
    metadata, build = project["project"], project["build-system"]
    python = f"python {metadata['requires-python']}"
    address = project["tool"]["hatch"]["metadata"]["hooks"]["custom"]["repository"]
    if sdist is None:
        source = "path: ../../dist/twistwrench-${{ version }}.tar.gz"
    else:
        source = f"url: {_INDEX}\n  sha256: {hashlib.sha256(sdist.read_bytes()).hexdigest()}"
    return f"""\
# Written by tools/conda_recipe.py from pyproject.toml. Build it with `rattler-build build --recipe tools/conda/recipe.yaml`.
schema_version: 1
context:
  version: "{version}"
package:
  name: {metadata["name"]}
  version: ${{{{ version }}}}
source:
  {source}
build:
  number: 0
  noarch: python
  script: python -m pip install . -vv --no-deps --no-build-isolation
  python:
    entry_points:
{_listed([f"{name} = {place}" for name, place in metadata["scripts"].items()], 6)}
requirements:
  host:
{_listed([python, "pip", *map(conda_name, build["requires"])])}
  run:
{_listed([python, *map(conda_name, metadata["dependencies"])])}
tests:
  - python:
      imports: [{metadata["name"]}]
      pip_check: true
  - script:
      - twistwrench torques ur5 --trajectory demo --payload 5
about:
  summary: {json.dumps(metadata["description"], ensure_ascii=False)}
  license: {metadata["license"]}
  license_file: [{", ".join(metadata["license-files"])}]
""" + (f"  repository: {address}\n" if address else "")


def _listed(lines: list[str], indent: int = 4) -> str:
    return "\n".join(f"{' ' * indent}- {line}" for line in lines)


def main() -> None:
    """Command line of this script."""
    parser = argparse.ArgumentParser(prog="tools/conda_recipe.py", description=__doc__.splitlines()[0])
    parser.add_argument("--sdist", type=Path, help="print the recipe that takes this file from the index")
    given = parser.parse_args()
    version = runpy.run_path(str(VERSION))["__version__"]
    text = recipe(version, tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8")), given.sdist)
    if given.sdist is None:
        RECIPE.write_text(text, "utf-8")
    else:
        print(text, end="")


if __name__ == "__main__":
    main()
