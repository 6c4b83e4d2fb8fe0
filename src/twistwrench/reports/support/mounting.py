"""Load of a motion on the foundation and on its bolts, as a question of the torque report."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...core import arguments
from ...core.answers.blocks import Line, Table, numbers, words
from ...core.arguments import parse_numbers
from ...core.errors import ValueRangeError
from ...core.numbers import number, seconds
from ...core.text import Argument
from ...core.typing import Array
from ...mechanics.joints.units import unit_of
from ...mechanics.lie.labelled import WRENCH
from ...motion.readers.csv_reader import CsvFile, table_errors
from ...statics.reactions import MountingLoad, bolt_circle, mounting_load

if TYPE_CHECKING:
    from ...motion.load_case import LoadCase
    from ...motion.motion import Motion

FrameOrTrue: TypeAlias = "bool | str"
"""Frame fixed to the base, or True for the root."""
BoltsGiven: TypeAlias = "str | Path | ArrayLike"
"""``"6x0.200"``, a CSV file ``x,y[,preload]``, or places (k, 2)."""

_CIRCLE = re.compile(r"(\d+)\s*x\s*([\d.eE+-]+)")
_FORM = "NUMBERxDIAMETER in metres such as 6x0.200, or a CSV file with the columns x,y[,preload]"


@dataclass(frozen=True, eq=False)
class BoltPattern:
    """Places of bolts in the frame of the mounting, and their preloads."""

    places: Array
    """(k, 2) [m]"""
    preload: Array
    """(k,) [N]"""

    @classmethod
    def from_given(cls, given: BoltsGiven) -> BoltPattern:
        """Pattern of a number and a circle, of a file, or of places."""
        if not isinstance(given, str | Path):
            places = arguments.finite(given, "bolts", 2)
            return cls(np.atleast_2d(places), np.zeros(len(np.atleast_2d(places))))
        if isinstance(given, str) and (circle := _CIRCLE.fullmatch(given.strip())):
            places = bolt_circle(int(circle[1]), parse_numbers(circle[2], "bolts", _FORM, 1)[0])
            return cls(places, np.zeros(len(places)))
        if not Path(given).is_file():
            raise ValueRangeError(f"{{0}}: {str(given)!r} is not {_FORM}.", Argument("bolts"))
        return cls._from_file(Path(given))

    @classmethod
    def _from_file(cls, path: Path) -> BoltPattern:
        with table_errors(path, "table of bolts", "x,y,preload, then a line for each bolt, such as 0.1,0.1,5000"):
            file = CsvFile.open(path)
            heads = [cell.partition(" ")[0].partition("[")[0].casefold() for cell in file.header]
            if heads[:2] != ["x", "y"] or heads[2:] not in ([], ["preload"]):
                raise ValueRangeError(f"{path}: the columns are {', '.join(file.header)}. Give {_FORM}.")
            table = file.table(tuple(range(len(heads))))
        return cls(table[:, :2], table[:, 2] if table.shape[1] > 2 else np.zeros(len(table)))


@dataclass(frozen=True, eq=False)
class MotionMounting:
    """Wrench of a motion on the foundation, with the loads of its bolts."""

    load: MountingLoad
    time: Array
    """(n,) [s]"""
    pattern: BoltPattern | None = None

    @property
    def bolts(self) -> Array | None:
        """(n, k, 2): axial and shear load of each bolt, with its preload; the axial load pulls if above 0 [N]."""
        if self.pattern is None:
            return None
        found = self.load.bolts(self.pattern.places)
        found[..., 0] += self.pattern.preload
        return found

    @property
    def line(self) -> str:
        """Sentence on the largest loads."""
        text = str(self.load)
        return f"{text[0].upper()}{text[1:]}."

    def blocks(self) -> list[Table | Line]:
        """Tables of the wrench and of the bolts."""
        largest = self.load.largest
        found: list[Table | Line] = [
            Table(
                f"On the foundation, at {self.load.frame}",
                words("component", list(largest)),
                numbers("largest", [value for value, _ in largest.values()], _four),
                words("unit", [_unit(name) for name in largest]),
                numbers("when", [float(self.time[row]) for _, row in largest.values()], seconds, "s"),
            )
        ]
        if (bolts := self.bolts) is not None:
            axial, shear = bolts[..., 0], bolts[..., 1]
            assert self.pattern is not None
            found.append(
                Table(
                    "Bolts",
                    words("bolt", [str(k + 1) for k in range(axial.shape[1])]),
                    numbers("x", self.pattern.places[:, 0], _four, "m"),
                    numbers("y", self.pattern.places[:, 1], _four, "m"),
                    numbers("largest pull", axial.max(axis=0), _four, "N"),
                    numbers("when", self.time[axial.argmax(axis=0)], seconds, "s"),
                    numbers("least", axial.min(axis=0), _four, "N"),
                    numbers("shear", shear.max(axis=0), _four, "N"),
                    most=12,
                    by=axial.max(axis=0).tolist(),
                )
            )
        return found

    def columns(self) -> dict[str, Array]:
        """Columns (n,) of a written table."""
        found = {f"mounting.{name} [{_unit(name)}]": self.load.wrench[:, k] for k, name in enumerate(WRENCH)}
        if (bolts := self.bolts) is not None:
            for k in range(bolts.shape[1]):
                found |= {f"bolt{k + 1}.axial [N]": bolts[:, k, 0], f"bolt{k + 1}.shear [N]": bolts[:, k, 1]}
        return found


def _unit(component: str) -> str:
    return unit_of("tau", component.startswith("m"))


def _four(value: float) -> str:
    return number(value, 4, decimals=6)


def motion_mounting(load: LoadCase, motion: Motion, frame: str | None, bolts: BoltsGiven | None) -> MotionMounting:
    """Wrench on the foundation along the states of a motion, with payloads and wrenches on the robot."""
    wrenches = {name: np.broadcast_to(F, (len(motion), 6)) for name, F in load.wrenches.items()} or None
    found = mounting_load(load.with_load, motion.q, motion.dq, motion.ddq, frame, wrench_on_robot=wrenches)
    return MotionMounting(found, motion.time, None if bolts is None else BoltPattern.from_given(bolts))
