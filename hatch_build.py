"""Build of the wheel: completed docstrings, for editors, and a README whose links work on a package index.

The files of the wheel have the docstrings that :mod:`twistwrench.core.glossary` completes at import. Packages for an index say
so in :data:`twistwrench.core.version.ON_INDEX`, and their pages install extras by the package's name (tools/install_lines.py).
"""

from __future__ import annotations

import ast
import importlib.util
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

ROOT = Path(__file__).parent
SOURCE = ROOT / "src" / "twistwrench"


def module_at(path: Path) -> Any:
    """Module of a file that imports nothing of this project."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


install_lines = module_at(ROOT / "tools" / "install_lines.py")


def completed_source(path: Path) -> str:
    """The text of a file of the package with completed docstrings."""
    glossary = module_at(SOURCE / "core" / "glossary.py")
    text, room = path.read_text("utf-8"), glossary.room_of(path.relative_to(SOURCE).parts[:-1])
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and (doc := ast.get_docstring(node, clean=False)):
            given = node.args
            names = [
                a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs) if a.arg not in ("self", "cls")
            ]
            text = text.replace(
                doc, glossary.complete_docstring(doc, names, room, ast.unparse(node.returns) if node.returns else "")
            )
    return text


class BuiltFiles(BuildHookInterface):
    """Puts files that are made for the package in the place of those of the source; editable installs have none."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write these files into a folder, and have them packed."""
        if version == "editable":
            return
        self.folder = tempfile.TemporaryDirectory()
        for number, (place, text) in enumerate(self.files()):
            file = Path(self.folder.name) / f"{number}{Path(place).suffix}"
            file.write_text(text, "utf-8")
            build_data["force_include"][str(file)] = place

    def files(self) -> Iterator[tuple[str, str]]:
        """Place and text of each file."""
        on_index, wheel = install_lines.on_index(), self.target_name == "wheel"
        if on_index:
            path = install_lines.VERSION
            text = path.read_text("utf-8").replace(*map(install_lines.CONSTANT.format, (False, True)))
            yield str(path.relative_to(SOURCE.parent if wheel else ROOT)), text
        if not wheel:
            return
        for path in sorted(SOURCE.rglob("*.py")):
            if "complete(globals())" in path.read_text("utf-8") and path.name != "glossary.py":
                yield str(path.relative_to(SOURCE.parent)), completed_source(path)
        for source, place in self.config["guides"].items():
            text = (ROOT / source).read_text("utf-8")
            yield place, install_lines.for_index(text) if on_index else text


def indexed_readme(text: str, repository: str, on_index: bool = False) -> str:
    """README with absolute links into ``repository``; without relative links and pictures if that is empty."""
    text = install_lines.for_index(text) if on_index else text
    text = re.sub(r"^<!-- .*? -->\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"^(```\w+) [^\n]+$", r"\1", text, flags=re.MULTILINE)  # exit=1, which is for the tests
    relative = r"(?!https?:|#)"
    if repository:
        text = re.sub(rf'(src|srcset)="{relative}', rf'\1="{repository}/raw/main/', text)
        return re.sub(rf"\]\({relative}", f"]({repository}/blob/main/", text)
    text = re.sub(r"<picture>.*?</picture>\n+", "", text, flags=re.DOTALL)
    return re.sub(rf"\[([^\]]+)\]\({relative}[^)]*\)", r"\1", text)


class IndexedReadme(MetadataHookInterface):
    """Sets the description of the package; ``repository`` in pyproject.toml is the address that links lead to."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the README, and the project's addresses if the repository has one."""
        repository = self.config.get("repository", "")
        readme = (Path(self.root) / "README.md").read_text("utf-8")
        text = indexed_readme(readme, repository, install_lines.on_index())
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        if repository:
            metadata["urls"] = {"Source": repository, "Changes": f"{repository}/blob/main/CHANGELOG.md"}
