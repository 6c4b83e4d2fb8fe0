"""Public docstrings: a sentence, then what goes in, what comes out, what is raised, notes, and an example, as numpydoc has it.

Public is what ``import twistwrench`` and its packages offer, with the classes of what that returns, and what the pages import
by its own path. The names documented are compared with those of the signature; ruff's rules (``D2`` and ``D4`` in pyproject.toml)
look after the first sentence and the layout of the sections.
"""

from __future__ import annotations

import ast
import builtins
import dataclasses
import functools
import importlib
import inspect
import itertools
import re
from pathlib import Path

import pytest
from source_trees import syntax_tree

import twistwrench as tw
from twistwrench.core.glossary import SECTIONS
from twistwrench.robot.quantities import QUANTITIES

SOURCE = Path(tw.__file__).parent
OWN_PATHS = (
    "robot.export", "mechanics.joints", "mechanics.model.actuators", "mechanics.model.builder", "mechanics.model.edit", "mechanics.model.limits", "motion", "viz.plots.explanation",
    "viz.plots.motion", "viz.plots.payload", "viz.plots.simulation", "viz.style", "viz.plots.torques", "reports", "mechanics.lie.axis",
    "mechanics.lie.twist_wrench", "core.verdict", "testing.verify",
)  # fmt: skip
"""Modules that are imported by their own path, beside those of ``dir(twistwrench)``."""


def modules():
    yield tw
    yield from (value for name in dir(tw) if inspect.ismodule(value := getattr(tw, name)))
    yield from (importlib.import_module(f"twistwrench.{name}") for name in OWN_PATHS)


@functools.cache
def classes_by_name():
    """Every public class of the source by its name: where its module is."""
    found = {}
    for path in SOURCE.rglob("*.py"):
        module = ".".join(("twistwrench", *path.relative_to(SOURCE).with_suffix("").parts))
        for node in syntax_tree(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found.setdefault(node.name, module)
    return found


def members(cls):
    """Methods and properties of a class that are ours and public, those of its bases in this package too."""
    for label, static in inspect.getmembers_static(cls):
        owner = next((c for c in cls.__mro__ if label in vars(c)), cls)
        if label.startswith("_") or not owner.__module__.startswith("twistwrench"):
            continue
        if isinstance(static, property) or type(static).__name__ == "cached_property":
            yield f"{owner.__module__}.{owner.__qualname__}.{label}", static
        elif isinstance(static, staticmethod | classmethod):
            yield f"{owner.__module__}.{owner.__qualname__}.{label}", static.__func__
        elif inspect.isfunction(static) and not generated(static):
            yield f"{owner.__module__}.{owner.__qualname__}.{label}", static


def generated(function):
    return not function.__code__.co_filename.endswith(".py")


def returned(function):
    """Names of public classes in what a function or property says it returns."""
    inner = getattr(function, "fget", None) or getattr(function, "func", None) or function
    return re.findall(r"[A-Z]\w+", str(getattr(inner, "__annotations__", {}).get("return", "")))


def offered_by(module):
    """The functions and classes of ``__all__``, or, where a module has none, those it defines."""
    own = [name for name, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
    names = getattr(module, "__all__", [name for name in own if not name.startswith("_")])
    values = (getattr(module, name) for name in names)
    return [value for value in values if inspect.isclass(value) or inspect.isfunction(value)]


def public():
    """All that has to be documented, by its name: functions, classes, methods, properties."""
    found: dict[str, object] = {}
    waiting = [value for module in modules() for value in offered_by(module)]
    while waiting:
        value = waiting.pop()
        name = f"{value.__module__}.{value.__qualname__}"
        if name in found or not name.startswith("twistwrench"):
            continue
        found[name] = value
        offered = [(name, value)]
        if inspect.isclass(value):
            offered = list(members(value))
            found.update(offered)
        for _, one in offered:
            waiting += [
                getattr(importlib.import_module(classes_by_name()[label]), label)
                for label in returned(one)
                if label in classes_by_name()
            ]
    return {name.removeprefix("twistwrench."): found[name] for name in sorted(found)}


PUBLIC = public()

# ── reading docstrings ──


def sections(doc):
    """The sections of a docstring by their names, in order; what comes before the first is under the empty name."""
    found, name, lines = {"": []}, "", inspect.cleandoc(doc).splitlines()
    for line, under in zip(lines, [*lines[1:], ""], strict=True):
        if line and under == "-" * len(line):
            assert line not in found, f"section {line} stands twice"
            name, found[line] = line, []
        elif set(line) != {"-"} or found[name]:
            found[name].append(line)
    return found


def documented(lines):
    """The names of a section of parameters, in order: ``q0, q1 : (nq,) array_like, …`` are two."""
    entries = [line for line in lines if line and not line.startswith(" ")]
    return [name.strip() for line in entries for name in line.split(" : ")[0].split(",")]


def parameters(function):
    """The names of a signature, as documented: the first of a method left out, stars before those that take many.

    A function that takes the arguments of another documents its own.
    """
    wrapped = getattr(function, "__wrapped__", function)
    names = [
        "*" * (p.kind is p.VAR_POSITIONAL) + "**" * (p.kind is p.VAR_KEYWORD) + p.name
        for p in inspect.signature(function, follow_wrapped=wrapped.__name__ == function.__name__).parameters.values()
    ]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


@functools.cache
def bodies_of_classes(module):
    tree = ast.parse(inspect.getsource(importlib.import_module(module)))
    return {node.name: node.body for node in tree.body if isinstance(node, ast.ClassDef)}


def documented_fields(cls):
    """Fields that have a docstring of their own below them, those of its bases too."""
    found = set()
    for base in cls.__mro__:
        if base.__module__.startswith("twistwrench"):
            body = bodies_of_classes(base.__module__).get(base.__name__, [])
            for field, text in itertools.pairwise(body):
                if (
                    isinstance(field, ast.AnnAssign)
                    and isinstance(text, ast.Expr)
                    and isinstance(text.value, ast.Constant)
                ):
                    found.add(field.target.id)
    return found


FUNCTIONS = {name: value for name, value in PUBLIC.items() if inspect.isfunction(value)}


def text_of(value):
    return inspect.getdoc(getattr(value, "fget", None) or getattr(value, "func", None) or value)


def problems():
    for name, value in PUBLIC.items():
        yield from (f"{name}: {problem}" for problem in problems_of(name, value))


def overrides(method):
    """Whether a class above says what goes in and comes out: here stands what is special."""
    owner = getattr(inspect.getmodule(method), method.__qualname__.split(".")[0], None)
    above = (getattr(base, method.__name__, None) for base in getattr(owner, "__mro__", ())[1:])
    return any("Returns\n---" in (inspect.getdoc(other) or "") for other in above if callable(other))


def problems_of(name, value):
    doc = text_of(value)
    if not doc:
        yield "has no docstring"
        return
    try:
        found = sections(doc)
    except AssertionError as problem:
        yield str(problem)
        return
    if [s for s in found if s] != [s for s in SECTIONS if s in found]:
        yield f"sections {[*found][1:]} are not those of numpydoc in their order"
    if ">>>" in "\n".join(line for section, lines in found.items() if section != "Examples" for line in lines):
        yield "an example stands outside of Examples"
    for before, line in itertools.pairwise(found.get("Examples", ())):
        if not before and line and not line.startswith(">>>"):
            yield f"text stands behind an example: {line}"
    raised = [line for section in ("Raises", "Warns") for line in found.get(section, ()) if line and line[0] != " "]
    for error in (e.strip() for line in raised for e in line.split(",")):
        if not hasattr(tw, error) and not hasattr(builtins, error):
            yield f"raises {error}, which is not an error"
    if not (inspect.isclass(value) or inspect.isfunction(value)) or (inspect.isfunction(value) and overrides(value)):
        return
    said = documented(found.get("Parameters", ()))
    if inspect.isfunction(value):
        if said != parameters(value):
            yield f"documents {said}, takes {parameters(value)}"
        result = str(getattr(value, "__annotations__", {}).get("return"))
        gives = {"Returns", "Yields"} & set(found)
        if bool(gives) == (result in ("None", "NoReturn")):
            yield f"returns {result}, documents {sorted(gives)}"
    elif dataclasses.is_dataclass(value) or hasattr(value, "_fields"):
        fields = (
            value._fields
            if hasattr(value, "_fields")
            else [f.name for f in dataclasses.fields(value) if not f.name.startswith("_")]
        )
        said += documented(found.get("Attributes", ()))
        if missing := [f for f in fields if f not in {*said, *documented_fields(value)}]:
            yield f"says nothing of {missing}"
    elif "__init__" in vars(value) and said != parameters(value.__init__):
        yield f"documents {said}, takes {parameters(value.__init__)}"


# ── the rules ──

WITHOUT_EXAMPLE = {
    "modern_robotics.": "the book's names: docs/modern-robotics.md shows them at work, tests/book_package runs the book's examples",
    "robot.convert.": "takes a model of another library's, which need not be installed",
    "mechanics.joints.": "asked by the library, each with symbols or a batch of its own; docs/adding.md shows them at work",
    "viz.plots.torques.": "takes a report, which the command makes of a file",
    "simulation.torque_laws.": "called with symbols while a rollout is traced",
    "reports.drawn_motion.read_motion": "takes a file that is open, as the command view has it",
}
"""Functions without an example, by how their names begin, and why."""


def test_every_public_docstring_has_its_sections():
    assert not [*problems()]


def shown_by_classes():
    """Methods that the example of their class calls."""
    found = set()
    for cls in filter(inspect.isclass, PUBLIC.values()):
        example = "\n".join(sections(text_of(cls) or "").get("Examples", ()))
        found |= {method for name, method in members(cls) if re.search(rf"\.{name.rpartition('.')[2]}\(", example)}
    return found


def test_every_public_function_shows_an_example():
    """Its own, or one of its class."""
    shown = shown_by_classes()
    missing = [
        name
        for name, value in FUNCTIONS.items()
        if "Examples" not in sections(text_of(value) or "") and value not in shown
    ]
    assert not [
        name for name in missing if not name.startswith(tuple(WITHOUT_EXAMPLE)) and not overrides(FUNCTIONS[name])
    ]


def test_the_walk_reaches_what_users_call():
    """It finds names of every kind: inherited methods, functions that a class takes over, results that no module lists."""
    found = {value.__module__.split(".")[1] + "." + value.__qualname__ for name, value in FUNCTIONS.items()}
    assert {
        "mechanics.box", "robot.export_c", "mechanics.exp", "motion.Motion.at", "robot.Robot.inverse_dynamics", "robot.load",
        "robot.Explanation.table", "robot.Robot.simulate", "robot.Robot.task_inertia",
        "simulation.SimulationResult.to_csv", "statics.WrenchPolytope.contains", "testing.verify",
    } <= found  # fmt: skip


RIGHT = """Sum of two.

    Parameters
    ----------
    a, b : float

    Returns
    -------
    sum : float

    Raises
    ------
    ShapeError
        Never.

    Examples
    --------
    >>> 1 + 1
    2
    """


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("", "", None),
        ("a, b : float", "a : float", "documents ['a'], takes ['a', 'b']"),
        ("a, b : float", "b, a : float", "documents ['b', 'a'], takes ['a', 'b']"),
        ("Returns", "Results", "sections"),
        ("ShapeError", "ShopeError", "raises ShopeError, which is not an error"),
        ("Examples\n    --------\n", "", "an example stands outside of Examples"),
        ("\n    Returns\n    -------\n    sum : float\n", "", "returns float, documents []"),
    ],
)
def test_a_wrong_docstring_is_found(right, wrong, said):
    def total(a: float, b: float) -> float: ...

    total.__doc__ = RIGHT.replace(right, wrong)
    found = list(problems_of("total", total))

    assert found == [] if said is None else said in "\n".join(found)


WORDS = {"links": "nlinks", "bodies": "nbodies", "parameters": "10 nbodies"}
"""How docstrings say the sizes that the table of quantities names."""


METHODS = {name: getattr(tw.Robot, name) for name in QUANTITIES if hasattr(tw.Robot, name)}


@pytest.mark.parametrize(
    "name", sorted(METHODS.keys() - {"constraint_bias", "constraint_jacobian", "task_bias", "task_inertia"})
)
def test_a_method_of_a_quantity_says_the_sizes_of_the_table(name):
    quantity, found = QUANTITIES[name], sections(text_of(METHODS[name]))
    sizes = [tuple(WORDS.get(axis, axis) for axis in axes) for axes in quantity.sizes]
    wanted = [f"({axes[0]},)" if len(axes) == 1 else f"({', '.join(axes)})" for axes in sizes]
    outputs = [line.split(" : ") for line in found["Returns"] if line and not line.startswith(" ")]
    assert [output for output, _ in outputs] == list(quantity.outputs)
    assert all(said.startswith(size) for (_, said), size in zip(outputs, wanted, strict=True))
