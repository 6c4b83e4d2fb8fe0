"""First calls: names that a newcomer may try, with the call to write instead.

Such names come from other libraries, from earlier versions or from a guess. They are rows of ``first_calls.toml``, which is
read when a name is missing. Error messages of :class:`~twistwrench.Robot`, of the package and of the command line are made
from the rows, and so are the tables of ``docs/coming-from.md``.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path

GUESS = "guess"
"""Origin of rows for names of no library."""
CUTOFF = 0.7
"""Least similarity of a name that a message offers, as a ratio of ``difflib``."""
_PLACE_OF_CLASS = {"Robot": "robot", "Motion": "motion", "SpatialInertia": "inertia"}
"""Place of the rows for attributes of a public class."""
_DEFAULT_PLACES = "robot module"
"""Places of a row that names none."""
_MARKDOWN_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
"""Link in Markdown; its group is the text."""
_ROBOT_CALL = re.compile(r"robot\.(?:kernel\(\"(\w+)\"\)|(\w+))\([^()]*\)")
"""Call of a kernel, ``robot.kernel("…")(…)``, or of a method, ``robot.…(…)``; one of its groups is the quantity."""


@dataclass(frozen=True)
class FirstCall:
    """One row of the table.

    Attributes
    ----------
    words : tuple of str, names that lead to this row
    of : str, origin of the names: a library, an earlier version or ``guess``
    where : tuple of str, places of the names: ``robot``, ``module``, ``motion``, ``inertia``, ``command``, ``option``, ``page``
    use : str, call, command or option to write instead; code between backticks if there is text beside it
    differs : str, difference of arguments, order, sign or result
    shown : str, text of the names in the documentation; empty: the words
    quantity : str, quantity of :meth:`twistwrench.Robot.kernel` that the call evaluates
    only : tuple of str, commands whose option is meant; () for all that have ``use``
    """

    words: tuple[str, ...]
    of: str
    where: tuple[str, ...]
    use: str
    differs: str
    shown: str
    quantity: str
    only: tuple[str, ...]

    @property
    def advice(self) -> str:
        """Clause that names the call and the difference, as plain text."""
        clause = self.use
        if self.differs:
            clause += f"; {self.differs}"
        return plain_text(clause)


def plain_text(markdown: str) -> str:
    """Text of a cell without marks of code, emphasis and links.

    >>> plain_text("`robot.nv`, **not** [q](page.md)")
    'robot.nv, not q'
    """
    return _MARKDOWN_LINK.sub(r"\1", markdown).replace("`", "").replace("**", "")


@cache
def first_calls() -> tuple[FirstCall, ...]:
    """Rows of the table, in its order."""
    import tomllib

    text = Path(__file__).with_name("first_calls.toml").read_text(encoding="utf-8")
    calls: list[FirstCall] = []
    for origin, entries in tomllib.loads(text).items():
        calls += [_first_call(origin, entry) for entry in entries]
    return tuple(calls)


def _first_call(origin: str, entry: Mapping[str, str]) -> FirstCall:
    """Row of the table from its entry in the file."""
    call = _ROBOT_CALL.fullmatch(entry["use"])
    called_quantity = (call[1] or call[2]) if call else ""  # of a kernel or of a method
    return FirstCall(
        words=tuple(entry.get("word", "").split()),
        of=origin,
        where=tuple(entry.get("where", _DEFAULT_PLACES).split()),
        use=entry["use"],
        differs=entry.get("differs", ""),
        shown=entry.get("shown", ""),
        quantity=entry.get("quantity", called_quantity),
        only=tuple(entry.get("only", "").split()),
    )


@cache
def _rows_by_key() -> Mapping[tuple[str, str], tuple[FirstCall, ...]]:
    """Rows by (place, name), and by the name in small letters if no row has that name."""
    rows_by_key: dict[tuple[str, str], tuple[FirstCall, ...]] = {}
    for row in first_calls():
        for key in product(row.where, row.words):
            rows_by_key[key] = (*rows_by_key.get(key, ()), row)
    rows_by_small_key = {(place, word.casefold()): rows for (place, word), rows in rows_by_key.items()}
    return rows_by_small_key | rows_by_key  # names as written take precedence


def rows_of(word: str, place: str) -> tuple[FirstCall, ...]:
    """Rows for a name at a place; () for other names.

    >>> [row.use for row in rows_of("rnea", "robot")]
    ['robot.inverse_dynamics(q, dq, ddq)']
    """
    rows = _rows_by_key()
    rows_as_written = rows.get((place, word), ())
    return rows_as_written or rows.get((place, word.casefold()), ())


def similar_names(name: str, known: Iterable[str], cutoff: float = CUTOFF) -> str:
    """At most two similar names, joined by "or"; empty if no name is similar.

    >>> similar_names("mass_matrx", ["mass_matrix", "momentum"]), similar_names("elbow", ["momentum"])
    ("'mass_matrix'", '')
    """
    matches = difflib.get_close_matches(name, list(known), n=2, cutoff=cutoff)
    return " or ".join(map(repr, matches))


def missing_attribute(subject: str, name: str, place: str, known: Iterable[str]) -> AttributeError:
    """Error for an attribute that does not exist, with the call to write instead, or with similar names.

    Parameters
    ----------
    subject : str, description of the object, such as ``'Robot' object``
    name : str, the attribute
    place : str, place of the rows, as in :attr:`FirstCall.where`
    known : iterable of str, attributes that exist

    Examples
    --------
    >>> print(missing_attribute("'Robot' object", "crba", "robot", []))
    'Robot' object has no attribute 'crba' (Pinocchio): use robot.mass_matrix(q); symmetric and full
    """
    text = f"{subject} has no attribute {name!r}"
    rows = rows_of(name, place)
    if rows:
        first_row = rows[0]
        origin = "" if first_row.of == GUESS else f" ({first_row.of})"
        text += f"{origin}: use {first_row.advice}"
    else:
        similar = similar_names(name, known)
        if similar:
            text += f". Did you mean {similar}?"
    return AttributeError(text, name=None)  # without a name, Python does not append a guess of its own


def missing_class_attribute(owner: type, name: str) -> AttributeError:
    """Error of :func:`missing_attribute` for an attribute that a public class does not have."""
    place = _PLACE_OF_CLASS.get(owner.__name__, "")
    return missing_attribute(f"type object {owner.__name__!r}", name, place, dir(owner))
