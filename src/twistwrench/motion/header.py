"""The header of a motion file while its columns are being given away to the robot's coordinates."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field

from ..errors import TrajectoryError
from ..listing import listed
from .column_units import split_unit


@dataclass(frozen=True)
class Choice:
    """A column of the file, and the unit it is in where that is said."""

    column: int
    unit: str | None = None


@dataclass
class Header:
    """The header's cells while columns are being given away."""

    cells: Sequence[str]
    where: str
    joints: Sequence[str] = ()
    """Names that are taken as they stand, brackets at their ends included."""
    free: list[int] = field(init=False)
    split: list[tuple[str, str | None]] = field(init=False)

    def __post_init__(self) -> None:
        self.free = [k for k, cell in enumerate(self.cells) if cell]
        self.split = [(cell, None) if cell in self.joints else split_unit(cell) for cell in self.cells]

    def found(self) -> str:
        """The names, as they end an error."""
        return f"found: {listed([cell or '(no name)' for cell in self.cells])}."

    def column(self, name: str, told: str) -> Choice:
        """The column of that name, with or without its unit; ``told`` says who asks."""
        base, unit = split_unit(name)
        exact = [k for k, cell in enumerate(self.cells) if cell == name.strip()]
        alike = exact or [k for k, (text, _) in enumerate(self.split) if text == base]
        if not alike:
            near = difflib.get_close_matches(name, [c for c in self.cells if c], n=1, cutoff=0.6)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise TrajectoryError(f"{self.where}: no column {name!r}, which {told} names.{hint} {self.found()}")
        if len(alike) > 1:
            raise self.repeated(name.strip(), len(alike))
        return Choice(alike[0], unit or self.split[alike[0]][1])

    def repeated(self, name: str, count: int) -> TrajectoryError:
        """The error of a column that is there more than once."""
        return TrajectoryError(f"{self.where}: column {name!r} is there {count} times. Keep one of them.")
