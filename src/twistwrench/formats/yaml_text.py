"""YAML from a path, from text or from a mapping, as mappings, lists and text."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..core.files import is_stream, read_text
from ..core.foreign_errors import foreign_errors
from ..errors import ModelError, NotFoundError

Source = str | os.PathLike[str] | Mapping[str, Any]

_MOST_BYTES = 2**18
"""Larger files are refused: YAML is read slowly, and a robot of a hundred motors takes 40 kB."""

_MOST_LEVELS = 50
"""Deeper nesting is refused; an actuator file needs five levels, and YAML takes quadratic time for more."""


def read_yaml(source: Source) -> tuple[object, str]:
    """What the YAML says, and what to call where it is from. Raises NotFoundError and ModelError."""
    if isinstance(source, Mapping):
        return source, "the actuators given"
    if not isinstance(source, str | os.PathLike):
        raise ModelError(f"actuators come from a path, YAML text or a mapping, not from {type(source).__name__}.")
    text, origin = str(source), "the text given"
    if "\n" not in text and ":" not in Path(text).name:
        path = Path(source)
        try:
            found = path.is_file() or is_stream(path)
        except (OSError, ValueError):
            found = False
        if not found:
            raise NotFoundError(
                f"no actuator file {text[:200]!r}. It is YAML with an entry 'actuators:', and the joints below it."
            )
        origin = str(path)
        with foreign_errors(lambda reason: ModelError(f"cannot read {origin!r}: {reason}.")):
            text = read_text(path, _MOST_BYTES)
    return _parsed(text, origin), origin


def _parsed(text: str, origin: str) -> object:
    """The text's mappings, lists and strings: YAML itself would read 101:1 as a number to the base of sixty."""
    import yaml

    def no_deeper(levels: int) -> None:
        if levels > _MOST_LEVELS:
            raise ModelError(
                f"{origin} nests its entries more than {_MOST_LEVELS} deep. An actuator file needs five levels."
            )

    class Loader(yaml.BaseLoader):
        def fetch_flow_collection_start(self, TokenClass: Any) -> None:
            no_deeper(self.flow_level)
            super().fetch_flow_collection_start(TokenClass)

        def add_indent(self, column: int) -> bool:
            no_deeper(len(self.indents))
            return bool(super().add_indent(column))

        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            keys = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
            if twice := sorted(key for key, count in keys.items() if count > 1):
                line = node.start_mark.line + 1
                raise ModelError(f"{origin}, line {line}: {', '.join(twice)} given twice. Keep one of them.")
            return super().construct_mapping(node, deep)

    with foreign_errors(lambda reason: ModelError(f"{origin} is no YAML: {reason}.")):
        return yaml.load(text, Loader)  # a BaseLoader makes nothing but text
