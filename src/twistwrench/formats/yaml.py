"""YAML of actuator files: mappings with checked keys, and numbers with units such as "33.3 g cm^2"."""

from __future__ import annotations

import math
import os
import re
import reprlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import ModelError, NotFoundError, UnknownNameError
from ..core.files import is_stream, read_text
from ..core.numbers import printed
from ..core.third_party import third_party_errors

_RADIANS_PER_TURN = 2 * math.pi
UNITS: dict[str, dict[str, float]] = {
    "inertia": {"kg m^2": 1.0, "kg cm^2": 1e-4, "kg mm^2": 1e-6, "g m^2": 1e-3, "g cm^2": 1e-7, "g mm^2": 1e-9},
    "torque constant": {"N m/A": 1.0, "mN m/A": 1e-3, "V s/rad": 1.0},
    "resistance": {"ohm": 1.0, "Ω": 1.0, "mohm": 1e-3, "mΩ": 1e-3},
    "inductance": {"H": 1.0, "mH": 1e-3, "uH": 1e-6, "µH": 1e-6},
    "voltage": {"V": 1.0, "mV": 1e-3, "kV": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
    "rotor speed": {
        "rad/s": 1.0,
        "rpm": _RADIANS_PER_TURN / 60,
        "/min": _RADIANS_PER_TURN / 60,
        "deg/s": _RADIANS_PER_TURN / 360,
    },
    "mass": {"kg": 1.0, "g": 1e-3},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "torque": {
        "N m": 1.0,
        "mN m": 1e-3,
        "kN m": 1e3,
        "kgf cm": 0.0980665,
        "ozf in": 0.007061551814226043,
    },
    "force": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "viscous": {"N m s/rad": 1.0, "mN m s/rad": 1e-3},  # friction coefficient
    "viscous, sliding": {"N s/m": 1.0, "kN s/m": 1e3},
    "speed": {"rad/s": 1.0, "rpm": _RADIANS_PER_TURN / 60, "deg/s": _RADIANS_PER_TURN / 360},
    "speed, sliding": {"m/s": 1.0, "mm/s": 1e-3},
    "stiffness": {"N m/rad": 1.0, "kN m/rad": 1e3, "N m/deg": 360 / _RADIANS_PER_TURN},
    "stiffness, sliding": {"N/m": 1.0, "kN/m": 1e3, "N/mm": 1e3},
    "angle": {"rad": 1.0, "deg": _RADIANS_PER_TURN / 360},
    "thermal resistance": {"K/W": 1.0},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "temperature": {"degC": 1.0, "°C": 1.0},
    "life": {"h": 1.0},
}
"""Units of each kind of quantity, SI first, each with its value in the SI unit."""

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?!\d)(.*)", re.DOTALL)
"""Number with a unit: its groups are the number and everything after it. ``(?!\\d)`` keeps a digit out of the unit."""


def si_unit(kind: str) -> str:
    """SI unit of a kind of quantity.

    >>> si_unit("rotor speed")
    'rad/s'
    """
    return next(iter(UNITS[kind]))


def in_si(value: object, kind: str, where: str) -> float:
    """Number in SI units from a text with a unit. Raises ModelError; ``where`` names the entry in its message."""
    factors = UNITS[kind]
    unit_names = ", ".join(factors)
    si = si_unit(kind)
    if isinstance(value, int | float) and not isinstance(value, bool):
        raise ModelError(
            f"{where} is {printed(value)} without a unit. Write {printed(value)} {si}, or one of {unit_names}."
        )
    match = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise ModelError(f"{where} is {value!r}, expected a number with a unit, such as 1.5 {si}.")
    digits, unit_text = match.groups()
    factor_by_unit = {_normalised_unit(unit): factor for unit, factor in factors.items()}
    unit = _normalised_unit(unit_text)
    if unit not in factor_by_unit:
        description = f"the unit {unit_text.strip()!r}" if unit else "no unit"
        raise ModelError(f"{where} is {value!r}, with {description}. Known here: {unit_names}.")
    number = float(digits) * factor_by_unit[unit]
    if not math.isfinite(number):
        raise ModelError(f"{where} is {value!r}, which is not a finite number.")
    return float(f"{number:.15g}")  # rounded as a decimal: 33.3 g cm² is 3.33e-6 kg m² exactly


def _normalised_unit(unit: str) -> str:
    """Unit in one spelling: kg·m², kg*m^2 and kgm2 become equal, as do the two signs for micro."""
    return re.sub(r"[\s·*^]", "", unit).replace("²", "2").replace("μ", "µ")


# ── Mapping with the path of its keys, and numbers with units


def short_text(value: object) -> str:
    """Text of a value, shortened: YAML's aliases can make it very long."""
    shortener = reprlib.Repr()
    shortener.maxlevel = 2
    shortener.maxstring = shortener.maxother = 60
    return shortener.repr(value)


@dataclass(frozen=True)
class Section:
    """Mapping in a file, with the keys that lead to it."""

    content: Any  # the mapping; anything else is refused
    path: str
    """Keys from the top of the file, joined by arrows; empty for the file itself."""

    def __post_init__(self) -> None:
        if not isinstance(self.content, Mapping):
            raise ModelError(
                f"{self.path or 'the file'} is {short_text(self.content)}, expected entries 'name: value'."
            )

    def where(self, key: str) -> str:
        """Keys that lead to an entry, joined by arrows."""
        return f"{self.path} → {key}" if self.path else key

    def only(self, *allowed: str) -> None:
        """Raise UnknownNameError for entries other than those allowed."""
        for key in self.content:
            if key not in allowed:
                raise UnknownNameError.from_choices(f"entry of {self.path or 'an actuator file'}", key, allowed)

    def section(self, key: str) -> Section:
        """Mapping under a key."""
        return Section(self.content[key], self.where(key))

    def number(self, key: str, kind: str) -> float:
        """Number of an entry in SI units; ``kind`` is a key of UNITS, empty for a number without a unit."""
        value = self.content[key]
        if kind:
            return in_si(value, kind, self.where(key))
        return plain_number(value, f"{self.where(key)} is {short_text(value)}, expected a plain number.")

    def vector(self, key: str, kind: str) -> Any:
        """Three numbers (3,) of an entry, each with a unit."""
        values = self.content[key]
        shape: tuple[int, ...] = ()  # of texts and mappings, which are no vectors
        if not isinstance(values, str | Mapping):
            shape = np.shape(np.asarray(values, object))
        if shape != (3,):
            raise ModelError(f"{self.where(key)} is {short_text(values)}, expected three entries in brackets.")
        value_by_axis = dict(zip("xyz", values, strict=True))
        components = Section(value_by_axis, self.where(key))  # so that messages name the axis
        return np.array([components.number(axis, kind) for axis in "xyz"])

    def optional(self, key: str, get: Callable[..., Any], *args: Any) -> dict[str, Any]:
        """Keyword argument ``{key: get(key, *args)}`` from an entry; empty if the key is absent."""
        if key not in self.content:
            return {}
        return {key: get(key, *args)}


def plain_number(value: object, problem: str) -> float:
    """Finite number from a number or a text; others raise ModelError with the text ``problem``."""
    has_underscore = isinstance(value, str) and "_" in value  # Python would read 1_0 as 10
    try:
        if isinstance(value, bool) or has_underscore:
            raise ValueError  # noqa: TRY301  caught below: one message for all cases
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ModelError(problem) from None
    if not np.isfinite(number):
        raise ModelError(problem)
    return number


# ── YAML from a path, text or mapping, as mappings, lists and text

Source = str | os.PathLike[str] | Mapping[str, Any]

_MAX_BYTES = 2**18
"""Largest accepted file [bytes]: parsing is slow, and a robot with a hundred motors takes 40 kB."""

_CONTENT_OF_ENTRY = {"actuators": "joints", "motors": "motors of the catalogue", "kinematics": "six links of a UR"}
"""Content of a file's main entry, for messages."""

_MAX_DEPTH = 50
"""Largest nesting depth: an actuator file needs five levels, and parsing time grows quadratically."""


def read_yaml(source: Source, what: str = "actuator file", entry: str = "actuators") -> tuple[object, str]:
    """Content of YAML, and the name of its source for messages. Raises NotFoundError and ModelError.

    ``what`` is the kind of file and ``entry`` its main entry, both for messages.
    """
    if isinstance(source, Mapping):
        return source, f"the {entry} given"
    if not isinstance(source, str | os.PathLike):
        raise ModelError(f"{entry} come from a path, YAML text or a mapping, not from {type(source).__name__}.")
    text = str(source)  # of YAML, or a path
    origin = "the text given"
    is_yaml = "\n" in text or ":" in Path(text).name  # several lines or "name: value"
    if not is_yaml:
        path = Path(source)
        try:
            exists = path.is_file() or is_stream(path)
        except (OSError, ValueError):  # a name that file systems reject
            exists = False
        if not exists:
            raise NotFoundError(
                f"no {what} {text[:200]!r}. It is YAML with an entry '{entry}:', and the {_CONTENT_OF_ENTRY[entry]} below it."
            )
        origin = str(path)
        with third_party_errors(lambda reason: ModelError(f"cannot read {origin!r}: {reason}.")):
            text = read_text(path, _MAX_BYTES)
    return _parse(text, origin), origin


def _parse(text: str, origin: str) -> object:
    """Mappings, lists and strings of the text. Numbers stay text: YAML would read 101:1 in base sixty."""
    import yaml

    def check_depth(depth: int) -> None:
        if depth > _MAX_DEPTH:
            raise ModelError(
                f"{origin} nests its entries more than {_MAX_DEPTH} deep. An actuator file needs five levels."
            )

    class Loader(yaml.BaseLoader):
        """Loader that limits the depth, of brackets and of indents, and refuses repeated keys."""

        def fetch_flow_collection_start(self, TokenClass: Any) -> None:
            check_depth(self.flow_level)
            super().fetch_flow_collection_start(TokenClass)

        def add_indent(self, column: int) -> bool:
            check_depth(len(self.indents))
            return bool(super().add_indent(column))

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            key_counts = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
            repeated = sorted(key for key, count in key_counts.items() if count > 1)
            if repeated:
                line = node.start_mark.line + 1
                raise ModelError(f"{origin}, line {line}: {', '.join(repeated)} given twice. Keep one of them.")
            return super().construct_mapping(node, deep)

    with third_party_errors(lambda reason: ModelError(f"{origin} is no YAML: {reason}.")):
        return yaml.load(text, Loader)  # a BaseLoader creates only text
