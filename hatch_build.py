"""Build of the wheel: its files have the docstrings that :mod:`twistwrench.core.glossary` completes at import, for editors."""

from __future__ import annotations

import ast
import importlib.util
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SOURCE = Path(__file__).parent / "src" / "twistwrench"


def completed_source(path: Path) -> str:
    """The text of a file of the package with completed docstrings."""
    spec = importlib.util.spec_from_file_location("glossary", SOURCE / "core" / "glossary.py")
    glossary = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(glossary)
    text, room = path.read_text("utf-8"), path.relative_to(SOURCE).parts[0].removesuffix(".py")
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
