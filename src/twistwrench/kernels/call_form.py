"""What calls of a method have in common that one shortcut serves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class CallForm:
    """One kind of calls with one sample: its options, its dict of arrays, the type and the batch shape of all arrays."""

    options: tuple[tuple[str, Any], ...] = ()
    """Parameters by name and the very objects they are given as; all others have their defaults."""
    mapping: str = ""
    """The parameter that is a dict of further arrays, if one is."""
    keys: tuple[str, ...] = ()
    """Its keys, in the order of the kernel's inputs."""
    negative: bool = False
    """Whether the dict counts with the other sign."""
    batch: tuple[int, ...] = ()
    """The batch shape of all arrays: none, or ones."""
    char: str = "d"
    """NumPy's letter for the type of all arrays."""
