"""The error for a motion file that lacks columns: which joints have none, and which column may be meant."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..errors import TrajectoryError
from ..listing import listed
from ..typing import Array
from .column_suffixes import SUFFIX
from .column_units import split_unit
from .header import Choice, Header

_FEW = 4
_LIKE = 0.6
"""Similarity of two names from which one may be meant by the other."""
_STILL = 1e-6
"""Share of its size that a column varies by where a joint moves."""
_ANGLES_AND_LENGTHS = ("rad", "deg", "degrees", "radians", "°", "m", "mm", "cm")
_OTHER = re.compile(
    r"temp|curr|volt|amp|force|torq|effort|tau|load|power|energy|tcp|pose|ee_|imu|acc|vel|speed|rate|time|stamp|seq|index|"
    r"count|frame|status|state|mode|flag|id$|err|residual|cmd|command|target|desired|reference|setpoint"
)
"""Words in names of columns that are no positions of joints, or those that were asked for."""


def check_complete(
    header: Header,
    names: Mapping[str, Sequence[str]],
    given: Mapping[str, Mapping[int, Choice]],
    extra: Sequence[str],
    look: Callable[[int], Array],
) -> None:
    """Raise TrajectoryError where coordinates have no column, or rates only some; ``extra`` are columns of no meaning.

    ``look`` gives the first numbers of a column: joints are offered to be held still unless a column that varies is unused.
    """
    missing = [name for k, name in enumerate(names["q"]) if k not in given["q"]]
    if missing:
        near = _alike(missing, extra)
        hint = ""
        if len(missing) == len(names["q"]) and 2 * len(near) < len(missing) and len(extra) > len(near):
            hint = " No column has the name of a joint of this robot: the file seems to be a log of another one."
            near = {}
        elif near:
            name, cell = next(iter(near.items()))
            hint = f" Column {cell!r} is no joint of this robot. Did you mean {name!r}?"
        first = (list(near) or missing[:2])[:_FEW]
        choices = " ".join(f"--columns '{name}={near.get(name, 'COLUMN')}'" for name in first)
        more = " …" if len(missing) > len(first) else ""
        joints = list(dict.fromkeys(_joint(name) for name in missing))
        held = f", or {' '.join(f'--lock {name}=0' for name in joints)}" if len(joints) <= _FEW else ""
        held = f"--lock-missing{held}" if len(missing) < len(names["q"]) else "--lock 'PATTERN*=0'"
        held = f"; or hold joints still that never move: {held}"
        if len(missing) < len(names["q"]) and (unused := varying_columns(header.cells, extra, look)):
            held = f" (columns that vary and are not used: {listed(unused)})"
        raise TrajectoryError(
            f"{header.where}: no column for {listed(missing)}.{hint} Expected: {listed(names['q'])}; {header.found()} "
            f"Say which they are: {choices}{more}{held}."
        )
    for part in ("dq", "ddq"):
        absent = [f"{name}{SUFFIX[part]}" for k, name in enumerate(names[part]) if k not in given[part]]
        if absent and len(absent) < len(names[part]):
            alike = [c[0] for name in extra if (c := difflib.get_close_matches(name, absent, n=1, cutoff=0.6))]
            hint = f" Did you mean {alike[0]!r}?" if alike else ""
            raise TrajectoryError(
                f"{header.where}: no column {listed(absent)}, although others of its kind are there.{hint} "
                f"Give them for every joint, or for none: then they are derived. Or say which it is: --columns "
                f"'{absent[0]}=COLUMN'; {header.found()}"
            )


def varying_columns(cells: Sequence[str], extra: Sequence[str], look: Callable[[int], Array]) -> list[str]:
    """Columns of ``extra`` that may be positions of joints: numbers that vary, by name and unit of no other quantity."""
    found = []
    for k, cell in enumerate(cells):
        name, unit = split_unit(cell)
        if cell not in extra or _OTHER.search(name.lower()) or (unit is not None and unit not in _ANGLES_AND_LENGTHS):
            continue
        try:
            numbers = look(k)
        except TrajectoryError:  # words
            continue
        if numbers.size and np.isfinite(numbers).all() and np.ptp(numbers) > _STILL * (1 + np.abs(numbers).max()):
            found.append(cell)
    return found


def _alike(missing: Sequence[str], columns: Sequence[str]) -> dict[str, str]:
    """For names that are missing the columns most like them, each column once; in the order of the names.

    >>> _alike(["shoulder", "elbow"], ["schoulder", "temperature"])
    {'shoulder': 'schoulder'}
    """
    pairs = [
        (difflib.SequenceMatcher(None, cell, name).ratio(), name, cell)
        for name in missing
        for cell in difflib.get_close_matches(name, columns, n=_FEW, cutoff=_LIKE)
    ]
    found: dict[str, str] = {}
    for _, name, cell in sorted(pairs, key=lambda pair: -pair[0]):
        if name not in found and cell not in found.values():
            found[name] = cell
    return {name: found[name] for name in missing if name in found}


def _joint(coordinate: str) -> str:
    """The joint of a coordinate; those of planar and floating joints have a suffix."""
    base, dot, suffix = coordinate.rpartition(".")
    return base if dot and suffix in ("x", "y", "z", "theta", "qw", "qx", "qy", "qz") else coordinate
