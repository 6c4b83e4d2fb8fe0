"""Expressions of xacro files, evaluated node by node: arithmetic, comparisons, subscripts and calls of known functions.

Python's ``eval`` is not used, so an expression can do no more than the nodes below. This file imports nothing of the package,
as the process that expands a xacro file imports it alone.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Collection, Mapping
from typing import Any

MOST_CHARACTERS = 10_000
"""Largest number of characters of an expression. This and the next two limits bound time and memory."""
MOST_ITEMS = 100_000
"""Largest number of characters or items of a value."""
MOST_BITS = 4_096
"""Largest number of bits of an integer."""

_BINARY_OPERATORS: Mapping[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod, ast.Pow: operator.pow, ast.LShift: operator.lshift,
    ast.RShift: operator.rshift, ast.BitOr: operator.or_, ast.BitXor: operator.xor, ast.BitAnd: operator.and_,
}  # fmt: skip
_UNARY_OPERATORS: Mapping[type[ast.AST], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos, ast.USub: operator.neg, ast.Not: operator.not_, ast.Invert: operator.invert,
}  # fmt: skip
_COMPARISONS: Mapping[type[ast.AST], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt,
    ast.GtE: operator.ge, ast.Is: operator.is_, ast.IsNot: operator.is_not,
    ast.In: lambda a, b: a in b, ast.NotIn: lambda a, b: a not in b,
}  # fmt: skip
_METHODS: Mapping[type, frozenset[str]] = {
    str: frozenset((
        "capitalize", "center", "count", "endswith", "find", "index", "isalnum", "isalpha", "isdigit", "islower", "isnumeric",
        "isspace", "isupper", "join", "ljust", "lower", "lstrip", "removeprefix", "removesuffix", "replace", "rfind", "rindex",
        "rjust", "rsplit", "rstrip", "split", "splitlines", "startswith", "strip", "swapcase", "title", "upper", "zfill",
    )),
    list: frozenset(("count", "index")),
    tuple: frozenset(("count", "index")),
    dict: frozenset(("get", "items", "keys", "values")),
    float: frozenset(("is_integer",)),
    complex: frozenset(("conjugate", "imag", "real")),
}  # fmt: skip
"""Methods and attributes that an expression may use, by type. ``format`` is left out, as it reads attributes of arguments."""
_GROWING_FUNCTIONS = frozenset(("center", "comb", "factorial", "ljust", "perm", "range", "rjust", "round", "zfill"))
"""Functions whose work or result grows with the value of a number."""
_WIDE_FORMAT = re.compile(r"%.*?(\d{4}|\*)", re.DOTALL)
"""Format that may have a width or precision of four digits or from an argument."""
_LIST_OF_ALLOWED = (
    "Allowed are numbers, texts, lists, arithmetic, comparisons, conditions, subscripts and the functions of xacro"
)


class Refused(Exception):
    """Expression, file or size that a robot file may not use."""


def evaluate(text: str, names: Mapping[str, Any], functions: Collection[int]) -> Any:
    """Evaluate an expression.

    Parameters
    ----------
    names : values by name
    functions : identities of the functions that may be called

    Raises
    ------
    Refused
        The expression has a node, a name or a size that is not allowed.

    Examples
    --------
    >>> evaluate("2 * (width + 1) if width > 1 else 0", {"width": 3}, ())
    8
    >>> evaluate("2 ** 2 ** 20", {}, ())
    Traceback (most recent call last):
    twistwrench.formats.xacro.expressions.Refused: a power has more than 4,096 bits
    """
    if len(text) > MOST_CHARACTERS:
        raise Refused(f"an expression has {len(text):,} characters; {MOST_CHARACTERS:,} are allowed")
    expression = ast.parse(text.strip(), mode="eval")
    return _Evaluator(names, frozenset(functions)).value(expression.body)


class _Evaluator:
    """Evaluator of nodes with given names and functions; arguments as of :func:`evaluate`."""

    def __init__(self, names: Mapping[str, Any], functions: frozenset[int]) -> None:
        self.names = names
        self.functions = functions

    def value(self, node: ast.AST) -> Any:
        """Value of a node. Raises Refused for another kind of node."""
        match node:
            case ast.Constant(value=str() | int() | float() | complex() | None as value):
                return self._check_value(value)
            case ast.Name(id=name):
                return self._check_value(self._value_of_name(name))
            case ast.BinOp(left=left, op=op, right=right):
                a, b = self.value(left), self.value(right)
                _check_growth(op, a, b)
                if type(op) not in _BINARY_OPERATORS:
                    return _refuse(node)
                return self._check_value(_BINARY_OPERATORS[type(op)](a, b))
            case ast.UnaryOp(op=op, operand=operand):
                operate = _UNARY_OPERATORS[type(op)]
                return self._check_value(operate(self.value(operand)))
            case ast.BoolOp(op=op, values=values):
                return self._value_of_and_or(values, deciding=isinstance(op, ast.Or))
            case ast.Compare(left=left, ops=ops, comparators=right_sides):
                return self._comparison(self.value(left), ops, right_sides)
            case ast.IfExp(test=test, body=body, orelse=other):
                return self.value(body) if self.value(test) else self.value(other)
            case ast.Attribute(value=owner, attr=name):
                return self._attribute(self.value(owner), name)
            case ast.Subscript(value=owner, slice=index):
                items = self.value(owner)
                return self._check_value(items[self.value(index)])
            case ast.Slice(lower=lower, upper=upper, step=step):
                bounds = [None if bound is None else self.value(bound) for bound in (lower, upper, step)]
                return slice(*bounds)
            case ast.List(elts=items):
                return [self.value(item) for item in items]
            case ast.Tuple(elts=items):
                return tuple(self.value(item) for item in items)
            case ast.Set(elts=items):
                return {self.value(item) for item in items}
            case ast.Dict(keys=keys, values=values) if None not in keys:  # None: the key of **mapping
                return {self.value(key): self.value(item) for key, item in zip(keys, values, strict=True) if key}
            case ast.Call(func=function, args=args, keywords=keywords) if not _has_double_star(keywords):
                function_value = self.value(function)
                arg_values = [self.value(arg) for arg in args]
                keyword_values = {keyword.arg: self.value(keyword.value) for keyword in keywords if keyword.arg}
                return self._result_of_call(function_value, arg_values, keyword_values)
        return _refuse(node)

    def _value_of_name(self, name: str) -> Any:
        """Value of a name, with underscores only inside. Raises NameError without such a name."""
        _check_name(name)
        if name not in self.names:
            raise NameError(f"name {name!r} is not defined")
        return self.names[name]

    def _attribute(self, owner: Any, name: str) -> Any:
        """Attribute of an object: an entry of a namespace, or an allowed method. Raises Refused for another."""
        _check_name(name)
        is_namespace = isinstance(owner, dict) and type(owner) is not dict  # of xacro, or a dictionary of a YAML file
        if is_namespace and name in owner:
            return self._check_value(owner[name])
        for kind, methods in _METHODS.items():
            if isinstance(owner, kind) and name in methods:
                return getattr(owner, name)
        raise Refused(
            f"the attribute {name[:40]!r} is not allowed in an expression of a robot file. {_LIST_OF_ALLOWED}"
        )

    def _result_of_call(self, function: Any, args: list[Any], keywords: Mapping[str, Any]) -> Any:
        """Result of a function. Raises Refused for a large number if time or memory grow with it."""
        name = getattr(function, "__name__", "")
        integers = [value for value in (*args, *keywords.values()) if isinstance(value, int)]
        if name in _GROWING_FUNCTIONS and any(abs(integer) > MOST_ITEMS for integer in integers):
            raise Refused(f"{name} of a number above {MOST_ITEMS:,} is not allowed in a robot file")
        return self._check_value(function(*args, **keywords))

    def _value_of_and_or(self, nodes: list[ast.expr], *, deciding: bool) -> Any:
        """First value whose truth is ``deciding`` (False for ``and``, True for ``or``); if there is none, the last value."""
        value = None
        for node in nodes:
            value = self.value(node)
            if bool(value) is deciding:
                break
        return value

    def _comparison(self, a: Any, ops: list[ast.cmpop], right_sides: list[ast.expr]) -> bool:
        """Truth of a chain such as a < b < c; after a comparison that fails, no value is evaluated."""
        for op, right_side in zip(ops, right_sides, strict=True):
            b = self.value(right_side)
            compare = _COMPARISONS[type(op)]
            if not compare(a, b):
                return False
            a = b  # the left side of the next comparison
        return True

    def _check_value(self, value: Any) -> Any:
        """Return the value. Raises Refused if it is too large, or a function that is not allowed."""
        if callable(value) and id(value) not in self.functions:
            name = getattr(value, "__name__", type(value).__name__)
            raise Refused(f"{name} is not a function of robot files")
        if isinstance(value, int) and value.bit_length() > MOST_BITS:
            raise Refused(f"a number has more than {MOST_BITS:,} bits")
        if isinstance(value, str | list | tuple | dict | set | frozenset | range) and len(value) > MOST_ITEMS:
            raise Refused(
                f"a {type(value).__name__} has {len(value):,} items; {MOST_ITEMS:,} are allowed in a robot file"
            )
        return value


def _has_double_star(keywords: list[ast.keyword]) -> bool:
    """True if an argument is ``**mapping``, which has no name."""
    return any(not keyword.arg for keyword in keywords)


def _check_name(name: str) -> None:
    """Raise Refused for a name that begins with an underscore, as Python's internals do."""
    if name.startswith("_"):
        raise Refused(f"the name {name[:40]!r} begins with '_', which is not allowed in an expression of a robot file")


def _check_growth(op: ast.operator, a: Any, b: Any) -> None:
    """Raise Refused before an operation whose result would be too large."""
    are_integers = isinstance(a, int) and isinstance(b, int)
    if isinstance(op, ast.Pow) and are_integers and abs(a) > 1:
        bits_of_power = b * a.bit_length()
        if bits_of_power > MOST_BITS:
            raise Refused(f"a power has more than {MOST_BITS:,} bits")
    if isinstance(op, ast.LShift) and are_integers and b > MOST_BITS:
        raise Refused(f"a shift by more than {MOST_BITS:,} bits")
    if isinstance(op, ast.Mult) and not are_integers:
        for items, count in ((a, b), (b, a)):  # the items may be on either side
            is_repetition = isinstance(items, str | list | tuple) and isinstance(count, int)
            if is_repetition and len(items) * count > MOST_ITEMS:
                raise Refused(f"a {type(items).__name__} is repeated to more than {MOST_ITEMS:,} items")
    if isinstance(op, ast.Mod) and isinstance(a, str) and _WIDE_FORMAT.search(a):
        raise Refused("a format has a width of more than three digits")


def _refuse(node: ast.AST) -> Any:
    """Raise Refused for a node that is not allowed, with its text."""
    raise Refused(f"{ast.unparse(node)[:40]!r} is not allowed in an expression of a robot file. {_LIST_OF_ALLOWED}")
