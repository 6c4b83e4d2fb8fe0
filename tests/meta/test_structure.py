"""Structure of the source: sizes of rooms, imports, wrappers. Each list of exceptions may only shrink."""

from __future__ import annotations

import ast
import re
import tomllib
import warnings
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from places import ROOT
from source_trees import syntax_nodes, syntax_tree

import twistwrench as tw

SOURCE = Path(tw.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))
KNOWN_FILES = {path.relative_to(SOURCE).as_posix() for path in FILES}
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)

SELF_ANY = 0
"""Functions with an argument ``self: Any``."""
FIRST_WORDS = ("What", "How", "Where", "Whether", "Which", "Of", "That", "Those")
FIRST = 0.0
"""Share of docstrings that begin with one of those words."""
WRAPPERS: set[str] = set()
"""Private functions with one caller that only pass their arguments on."""
SCREEN = 60
"""Lines of a function without its docstring."""
LONG_FUNCTIONS: set[str] = set()
"""Functions with more lines. The list may only shrink."""
STRONG_PARTICIPLES = (
    "begun broken built chosen drawn driven felt found given held hidden kept known left lost made said seen sent shown "
    "spoken swept taken thrown told undriven unknown unseen written"
)
PARTICIPLE = re.compile(rf"_*([a-z]+ed|{'|'.join(STRONG_PARTICIPLES.split())})")
NOT_PARTICIPLES = {"speed", "quadruped", "feed", "need", "seed", "bed", "embed", "proceed", "exceed", "shed"}
ADJECTIVE = re.compile(r"_*[A-Z]+(ED|EST|LY|ABLE|IBLE|LESS|FUL|ISH|IEST)")
KNOWN_NAMES = Path(__file__).with_name("participles_and_adjectives.txt")
"""Names of today that say how something is, and not what. The list may only shrink."""


def named(path: Path) -> str:
    return path.relative_to(SOURCE).as_posix()


def docstrings(path: Path) -> list[ast.Constant]:
    """Strings that stand alone as statements."""
    alone = (node.value for node in syntax_nodes(path) if isinstance(node, ast.Expr))
    return [value for value in alone if isinstance(value, ast.Constant) and isinstance(value.value, str)]


def test_a_room_has_at_most_twenty_files():
    rooms = defaultdict(list)
    for path in FILES:
        rooms[named(path.parent)].append(path.name)
    assert not {room: len(files) for room, files in rooms.items() if len(files) > 20}


def test_methods_know_the_type_of_self():
    untyped = [
        f"{named(path)}:{node.lineno}"
        for path in FILES
        for node in syntax_nodes(path)
        if isinstance(node, FUNCTION)
        for a in node.args.posonlyargs + node.args.args
        if a.arg == "self" and a.annotation and ast.unparse(a.annotation) == "Any"
    ]
    assert len(untyped) <= SELF_ANY, untyped


def test_docstrings_begin_with_a_verb_or_a_noun():
    docs = [doc.value for path in FILES for doc in docstrings(path)]
    others = [doc for doc in docs if doc.strip().split()[:1] and doc.strip().split()[0].strip(":,.;") in FIRST_WORDS]
    assert len(others) <= FIRST * len(docs)


def lines_of(node: ast.FunctionDef) -> int:
    """Lines of a function without its docstring."""
    first = node.body[0]
    documented = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return node.end_lineno - node.lineno + 1 - (first.end_lineno - first.lineno + 1 if documented else 0)


def test_a_function_fits_a_screen():
    long = {
        f"{named(path)}:{node.name}": lines_of(node)
        for path in FILES
        for node in syntax_nodes(path)
        if isinstance(node, FUNCTION) and lines_of(node) > SCREEN
    }
    new = {name: size for name, size in long.items() if name not in LONG_FUNCTIONS}
    assert not new, f"{new}: more than {SCREEN} lines. Name a part that is a step of its own, and call it."
    assert not (gone := LONG_FUNCTIONS - long.keys()), f"take these from LONG_FUNCTIONS: {gone}"


def numeric(node: ast.expr | None) -> bool:
    """True if an expression is made of numbers alone."""
    if isinstance(node, ast.UnaryOp):
        return numeric(node.operand)
    if isinstance(node, ast.BinOp):
        return numeric(node.left) and numeric(node.right)
    return isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool)


def constants(module: ast.Module) -> set[str]:
    """Names of the module's constants that are one number."""
    found = set()
    for node in module.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            targets, values = [node.targets[0]], [node.value]
            if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
                targets, values = node.targets[0].elts, node.value.elts
            pairs = zip(targets, values, strict=False)
            found |= {target.id for target, value in pairs if isinstance(target, ast.Name) and numeric(value)}
    return found


def vague_names() -> set[str]:
    """Functions named by one participle, and numeric constants named by one adjective or adverb."""
    found = set()
    for path in FILES:
        names = {node.name for node in syntax_nodes(path) if isinstance(node, FUNCTION)}
        found |= {n for n in names if PARTICIPLE.fullmatch(n) and n.strip("_") not in NOT_PARTICIPLES}
        found |= {name for name in constants(syntax_tree(path)) if ADJECTIVE.fullmatch(name)}
    return found


@pytest.mark.filterwarnings("default")
def test_new_names_say_what_something_is():
    """A warning, no failure: a name of this kind may be right now and then."""
    known, found = set(KNOWN_NAMES.read_text("utf-8").split()), vague_names()
    for name in sorted(found - known):
        text = f"`{name}`: what does it return or bound? Name that, as `steady_state` in place of `_settled`."
        warnings.warn(text, UserWarning, stacklevel=1)
    assert not known - found, f"take these from {KNOWN_NAMES.name}: {sorted(known - found)}"


# ── imports ──


@cache
def imports(path: Path) -> frozenset[tuple[str, bool]]:
    """Files of the package that a file imports from, and whether at module level: not in a function, nor for types alone."""
    at_top = {id(node) for node in module_level(syntax_tree(path).body)}
    statements = [node for node in syntax_nodes(path) if isinstance(node, ast.ImportFrom)]
    found = {(target, id(node) in at_top) for node in statements for target in targets(path, node)}
    return frozenset(found - {(named(path), True), (named(path), False)})


def module_level(body: list[ast.stmt]) -> Iterator[ast.ImportFrom]:
    for node in body:
        if isinstance(node, ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test) != "TYPE_CHECKING":
            yield from module_level(node.body + node.orelse)
        elif isinstance(node, (ast.Try, ast.ClassDef)):
            yield from module_level(node.body)


def targets(path: Path, node: ast.ImportFrom) -> Iterator[str]:
    """Files that a statement imports from, one for each name."""
    module, folders = (node.module or "").split("."), named(path).split("/")[:-1]
    if not node.level and module[0] != "twistwrench":
        return
    base = folders[: len(folders) - node.level + 1] if node.level else []
    parts = [*base, *(module if node.level else module[1:])]
    for alias in node.names:
        inner = "/".join(part for part in (*parts, alias.name) if part)
        outer = "/".join(filter(None, parts))
        places = (f"{inner}.py", f"{inner}/__init__.py", f"{outer}.py", f"{outer}/__init__.py".removeprefix("/"))
        yield from [place for place in places if place in KNOWN_FILES][:1]


def floors() -> dict[str, int]:
    """Floor of each room: its line of the contract of layers, from below."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    lines = next(c["layers"] for c in contracts if c.get("containers") == ["twistwrench"])
    return {room: floor for floor, line in enumerate(reversed(lines)) for room in re.findall(r"\w+", line)}


def test_no_room_imports_from_a_room_above_or_beside_it():
    """Of doors.py, and of the package's own table of names, only what they import at module level counts."""
    floor, upward = floors(), set()
    for path in FILES:
        room, door = named(path).split("/")[0].removesuffix(".py"), path.name == "doors.py"
        for target, at_top in imports(path):
            other = target.split("/")[0].removesuffix(".py")
            if room in ("__init__", "__main__", other) or (door and not at_top):
                continue
            if floor.get(other, 99) >= floor[room]:
                upward.add((named(path), target))
    new = [f"{file} -> {target}" for file, target in sorted(upward)]
    assert not new, f"{new}: imports from a room above or beside. Move the function down, or call it from doors.py."


def test_no_two_files_import_each_other_at_module_level():
    graph = {named(path): {target for target, at_top in imports(path) if at_top} for path in FILES}
    done: set[str] = set()

    def visit(name: str, above: tuple[str, ...]) -> list[str]:
        if name in above:
            return [*above[above.index(name) :], name]
        if name in done:
            return []
        for other in sorted(graph[name]):
            if circle := visit(other, (*above, name)):
                return circle
        done.add(name)
        return []

    assert not [circle for name in graph if (circle := visit(name, ()))]


def passes_on(node: ast.FunctionDef) -> bool:
    """True if the body is one call of another function with the same arguments."""
    body = [n for n in node.body if not (isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant))]
    if len(body) != 1 or not isinstance(body[0], (ast.Return, ast.Expr)) or not isinstance(body[0].value, ast.Call):
        return False
    call = body[0].value
    given = [a.arg for a in node.args.posonlyargs + node.args.args + node.args.kwonlyargs]
    passed = [*call.args, *(k.value for k in call.keywords)]
    return bool(given) and [ast.unparse(p).lstrip("*") for p in passed] == given and isinstance(call.func, ast.Name)


def test_no_private_wrapper_with_one_caller():
    texts = "\n".join(path.read_text(encoding="utf-8") for path in FILES)
    found = {
        f"{named(path)}:{node.name}"
        for path in FILES
        for node in syntax_tree(path).body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("_") and not node.decorator_list
        if passes_on(node) and texts.count(f"{node.name}(") <= 2
    }
    assert found <= WRAPPERS, found - WRAPPERS
    assert found >= WRAPPERS, f"take these from the list: {WRAPPERS - found}"
