"""What modules declare: constants, defaults of arguments and options of dataclasses, for records."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import pkgutil

import numpy as np
from recorded_answers import plain_values


def declarations(package):
    """Constants, defaults and options of dataclasses in each module of a package."""
    package = importlib.import_module(package)
    names = [
        package.__name__,
        *(module.name for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")),
    ]
    found = {}
    for name in names:
        module = importlib.import_module(name)
        declared = _declared(module)
        if declared:
            found[name.removeprefix("twistwrench.")] = declared
    return found


def _declared(module):
    tree = ast.parse(inspect.getsource(module))
    found = {}
    for node in tree.body:
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
        )
        for target in targets:
            if isinstance(target, ast.Name) and target.id in vars(module):
                value = vars(module)[target.id]
                if target.id != "__all__" and _is_plain(value):
                    found[target.id] = _with_tiny_numbers_as_texts(plain_values(value))
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and dataclasses.is_dataclass(vars(module).get(node.name)):
            found[node.name] = _options(vars(module)[node.name])
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            found |= _defaults(node)
    return found


def _with_tiny_numbers_as_texts(value):
    """Plain value; numbers that a comparison takes for zero become texts."""
    if isinstance(value, dict):
        return {key: _with_tiny_numbers_as_texts(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_with_tiny_numbers_as_texts(entry) for entry in value]
    if isinstance(value, float) and 0.0 < abs(value) < 1e-3:
        return f"{value:.9g}"
    return value


def _is_plain(value):
    if value is None or isinstance(value, type) or callable(value):
        return False
    if isinstance(value, np.ndarray) and value.dtype == object:
        return False
    try:
        plain_values(value)
    except TypeError:
        return False
    return True


def _options(cls):
    """Names of fields, with the options that are not the usual ones."""
    parameters = cls.__dataclass_params__
    names = []
    for field in dataclasses.fields(cls):
        marks = {"-init": not field.init, "-repr": not field.repr, "-compare": not field.compare, "*": field.kw_only}
        names.append(field.name + "".join(mark for mark, holds in marks.items() if holds))
    return f"eq={parameters.eq} repr={parameters.repr} frozen={parameters.frozen} order={parameters.order}: {' '.join(names)}"


def _defaults(node):
    """Defaults of the arguments of a function, as they are written."""
    arguments = node.args
    positional = [*arguments.posonlyargs, *arguments.args]
    pairs = [*zip(positional[len(positional) - len(arguments.defaults) :], arguments.defaults, strict=True)]
    pairs += [pair for pair in zip(arguments.kwonlyargs, arguments.kw_defaults, strict=True) if pair[1] is not None]
    texts = [f"{argument.arg}={ast.unparse(default)}" for argument, default in pairs if not _is_none(default)]
    return {f"{node.name}()": " ".join(texts)} if texts else {}


def _is_none(node):
    return isinstance(node, ast.Constant) and node.value is None
