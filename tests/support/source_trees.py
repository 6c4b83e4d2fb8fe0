"""Syntax trees of the package's source: parsed once for all tests of a process, and the nodes of a file listed once."""

from __future__ import annotations

import ast
import gc
from functools import cache
from pathlib import Path

import twistwrench as tw


@cache
def _trees() -> dict[Path, ast.Module]:
    """Trees of all files: a million nodes, which the collector of cycles would look through again and again."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        return {path: ast.parse(path.read_text("utf-8")) for path in Path(tw.__file__).parent.rglob("*.py")}
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()


def syntax_tree(path: Path) -> ast.Module:
    """The tree of a file of the package."""
    return _trees()[path]


@cache
def syntax_nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file of the package, as ``ast.walk`` orders them."""
    return tuple(ast.walk(syntax_tree(path)))
