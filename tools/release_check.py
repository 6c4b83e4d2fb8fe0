"""What has to hold before a release: `make release-check`, or `make release-check DIST=dist` to keep what was built.

Builds sdist and wheel from what is committed, checks their metadata and contents, installs the wheel with the core's
dependencies only, in a fresh environment, and runs the README's first lines there; and these and the notebooks in another,
without llvmlite.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from pathlib import Path

from tools.install_lines import on_index
from tools.release import VERSION, versions

ROOT = Path(__file__).resolve().parent.parent
NEEDED = (
    "twistwrench/py.typed",
    "twistwrench/robots/panda.urdf",
    "twistwrench/viz/player/page.html",
    "twistwrench/guides/logs.md",
    "twistwrench/guides/skill/SKILL.md",
)


def main(kept: Path | None = None) -> None:
    """Build, check and try; sdist and wheel are copied into the folder ``kept`` if all of it passes."""
    if kept is not None and kept.exists() and any(kept.iterdir()):
        raise SystemExit(f"{kept} is not empty: what is published must be what was checked. Remove it.")
    with tempfile.TemporaryDirectory() as folder:
        clone, dist = Path(folder, "clone"), Path(folder, "dist")
        run("git", "clone", "--quiet", "--depth", "1", ROOT.as_uri(), clone)
        run(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, clone)
        run(sys.executable, "-m", "twine", "check", "--strict", *dist.iterdir())
        (wheel,), (sdist,) = dist.glob("*.whl"), dist.glob("*.tar.gz")
        check_contents(wheel, sdist)
        check_version(wheel)
        check_install(wheel, Path(folder, "fresh"))
        check_without_compiler(wheel, Path(folder, "light"))
        if kept is not None:
            shutil.copytree(dist, kept, dirs_exist_ok=True)
    print("release check: passed")


def check_contents(wheel: Path, sdist: Path) -> None:
    """The package's data is in, and nothing but the package."""
    packed = zipfile.ZipFile(wheel)
    names = packed.namelist()
    if lacking := [name for name in NEEDED if name not in names]:
        raise SystemExit(f"{wheel.name} lacks {', '.join(lacking)}")
    if stray := [n for n in names if not n.startswith("twistwrench/") and ".dist-info/" not in n]:
        raise SystemExit(f"{wheel.name} has {', '.join(stray[:5])}")
    if b"joint velocities [rad/s, m/s]" not in packed.read("twistwrench/robot/quantity_methods.py"):
        raise SystemExit(f"{wheel.name} has docstrings that hatch_build.py did not complete")
    with tarfile.open(sdist) as archive:
        (name,) = (name for name in archive.getnames() if name.endswith("src/twistwrench/core/version.py"))
        constants = {archive.extractfile(name).read(), packed.read("twistwrench/core/version.py")}
        if constants != {(ROOT / VERSION).read_bytes().replace(b"ON_INDEX = False", b"ON_INDEX = %a" % on_index())}:
            raise SystemExit("ON_INDEX of wheel or sdist is not as TWISTWRENCH_ON_INDEX says")
        inside = {name.split("/")[1] for name in archive.getnames()}
    if lacking := {"LICENSE", "THIRD_PARTY.md", "CHANGELOG.md", "tests", "docs"} - inside:
        raise SystemExit(f"{sdist.name} lacks {', '.join(lacking)}")


def check_version(wheel: Path) -> None:
    """One version in the wheel, the citation, the changes and the recipe."""
    built = wheel.name.split("-")[1]
    if others := [f"{name} has version {version!r}" for name, version in versions(ROOT).items() if version != built]:
        raise SystemExit(f"{wheel.name} is version {built!r}, but {', '.join(others)}")


def check_install(wheel: Path, folder: Path) -> None:
    """The README's first Python lines and its first command, with the core's dependencies only."""
    python = environment(folder)
    run(python, "-m", "pip", "install", "--quiet", wheel)
    run(python, "-c", first_lines(), cwd=folder)
    run(python, "-m", "twistwrench", "torques", "ur5", "--trajectory", "demo", "--payload", "5", cwd=folder)


def check_without_compiler(wheel: Path, folder: Path) -> None:
    """The README's first lines and the notebooks on NumPy, as where there is no wheel of llvmlite."""
    python = environment(folder)
    run(python, "-m", "pip", "install", "--quiet", "--no-deps", wheel)
    core = [need for need in requirements(wheel) if not need.startswith("llvmlite")]
    run(python, "-m", "pip", "install", "--quiet", *core, "matplotlib", "sympy", "nbclient", "ipykernel")
    run(python, "-c", ABSENT + first_lines(), cwd=folder)
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        run(python, "-c", NOTEBOOK, notebook, cwd=folder)


ABSENT = """
import importlib.util
assert importlib.util.find_spec("llvmlite") is None
"""
NOTEBOOK = """
import sys
import nbclient, nbformat
notebook = nbformat.read(sys.argv[1], 4)
nbclient.NotebookClient(notebook, timeout=600).execute()
"""
"""Ends with the error of the first cell that has one."""


def environment(folder: Path) -> Path:
    """Python of a fresh environment."""
    venv.create(folder, with_pip=True)
    return folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"


def requirements(wheel: Path) -> list[str]:
    """What the wheel needs without any extra."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        lines = re.findall(r"^Requires-Dist: (.+)$", archive.read(name).decode(), re.MULTILINE)
    return [line for line in lines if "extra ==" not in line]


def first_lines() -> str:
    """The README's first block of Python."""
    block = re.search(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text("utf-8"), re.MULTILINE | re.DOTALL)
    if block is None:
        raise SystemExit("README.md has no Python lines")
    return block[1]


def run(*command: object, cwd: Path = ROOT) -> None:
    print("$", *command[:4], "…" if len(command) > 4 else "", flush=True)
    subprocess.run([str(c) for c in command], check=True, cwd=cwd)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
