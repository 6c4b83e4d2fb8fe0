"""Build of the wheel: completed docstrings, for editors, and a README whose links work on a package index.

The files of the wheel have the docstrings that :mod:`twistwrench.core.glossary` completes at import.
"""

from __future__ import annotations

import ast
import importlib.util
import re
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

SOURCE = Path(__file__).parent / "src" / "twistwrench"


def completed_source(path: Path) -> str:
    """The text of a file of the package with completed docstrings."""
    spec = importlib.util.spec_from_file_location("glossary", SOURCE / "core" / "glossary.py")
    glossary = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(glossary)
    text, room = path.read_text("utf-8"), glossary.room_of(path.relative_to(SOURCE).parts[:-1])
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and (doc := ast.get_docstring(node, clean=False)):
            given = node.args
            names = [
                a.arg for a in (*given.posonlyargs, *given.args, *given.kwonlyargs) if a.arg not in ("self", "cls")
            ]
            text = text.replace(
                doc, glossary.completed(doc, names, room, ast.unparse(node.returns) if node.returns else "")
            )
    return text


class CompletedDocstrings(BuildHookInterface):
    """Puts completed files in the place of those that call ``complete``; editable installs complete at import alone."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Replace the files of a wheel that is no editable one."""
        if version == "editable":
            return
        self.folder = tempfile.TemporaryDirectory()
        for number, path in enumerate(sorted(SOURCE.rglob("*.py"))):
            if "complete(globals())" in path.read_text("utf-8") and path.name != "glossary.py":
                file = Path(self.folder.name) / f"{number}.py"
                file.write_text(completed_source(path), "utf-8")
                build_data["force_include"][str(file)] = str(path.relative_to(SOURCE.parent))


def indexed_readme(text: str, repository: str) -> str:
    """README with absolute links into ``repository``; without relative links and pictures if that is empty."""
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
        text = indexed_readme((Path(self.root) / "README.md").read_text("utf-8"), repository)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        if repository:
            metadata["urls"] = {"Source": repository, "Changes": f"{repository}/blob/main/CHANGELOG.md"}
