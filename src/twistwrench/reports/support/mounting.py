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
from ...core.numbers import TOLERANCE, number, seconds
from ...core.text import Argument
from ...core.typing import Array
from ...core.verdict import Verdict, Word
from ...mechanics.joints.units import unit_of
from ...mechanics.lie.labelled import WRENCH
from ...motion.column_names import split_unit, unit_factor
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
_FORM = (
    "NUMBERxDIAMETER in metres such as 6x0.200, or a CSV file with the columns x,y[,preload] in m and N, or with other units "
    "in brackets, such as x [mm],y [mm],preload [kN]"
)
_MAX_CIRCLE = 10.0
"""Largest diameter of a bolt circle [m]."""


@dataclass(frozen=True, eq=False)
class BoltPattern:
    """Places of bolts in the frame of the mounting, and their preloads."""

    places: Array
    """(k, 2) [m]"""
    preload: Array | None = None
    """(k,) [N]; None if it is not known."""

    def __post_init__(self) -> None:
        farthest = float(np.linalg.norm(self.places, axis=1).max(initial=0.0))
        if farthest > 0.5 * _MAX_CIRCLE:
            raise ValueRangeError(
                f"{{0}}: a bolt is {number(farthest)} m from the middle of the mounting, and a circle of more than "
                f"{number(_MAX_CIRCLE)} m is not one of a robot. Places are in metres: if these are millimetres, give a "
                "thousandth of them, or write x [mm],y [mm] in the header of the file.",
                Argument("bolts"),
            )
        if self.preload is not None and (self.preload < 0).any():
            raise ValueRangeError(
                f"{{0}}: the preload of bolt {int(self.preload.argmin()) + 1} is {number(float(self.preload.min()))} N. Give "
                "the force that presses the joint together, at least 0.",
                Argument("bolts"),
            )

    @classmethod
    def from_given(cls, given: BoltsGiven) -> BoltPattern:
        """Pattern of a number and a circle, of a file, or of places."""
        if not isinstance(given, str | Path):
            return cls(np.atleast_2d(arguments.finite(given, "bolts", 2)))
        circle = _CIRCLE.fullmatch(str(given).strip())
        if isinstance(given, str) and circle is not None:
            return cls(bolt_circle(int(circle[1]), parse_numbers(circle[2], "bolts", _FORM, 1)[0]))
        if not Path(given).is_file():
            raise ValueRangeError(f"{{0}}: {str(given)!r} is not {_FORM}.", Argument("bolts"))
        return cls._from_file(Path(given))

    @classmethod
    def _from_file(cls, path: Path) -> BoltPattern:
        with table_errors(path, "table of bolts", "x,y,preload, then a line for each bolt, such as 0.1,0.1,5000"):
            file = CsvFile.open(path)
            heads = [split_unit(cell) for cell in file.header]
            names = [name.casefold() for name, _ in heads]
            if names not in (["x", "y"], ["x", "y", "preload"]):
                raise ValueRangeError(f"{path}: the columns are {', '.join(file.header)}. Give {_FORM}.")
            factors = np.ones(len(heads))
            for k, (name, unit) in enumerate(heads):
                if unit is not None:
                    quantity = "tau" if names[k] == "preload" else "q"
                    factors[k] = unit_factor(unit, quantity, False, f"{path}, column {name!r}")
            table = file.table(tuple(range(len(heads)))) * factors
        return cls(table[:, :2], table[:, 2] if table.shape[1] > 2 else None)


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
        loads = self.pulls(self.pattern).copy()
        if self.pattern.preload is not None:
            loads[..., 0] += self.pattern.preload
        return loads

    def pulls(self, pattern: BoltPattern) -> Array:
        """(n, k, 2): axial and shear load by the robot alone, without preload [N]."""
        return self.load.bolts(pattern.places)

    @property
    def verdict(self) -> Verdict:
        """OVER LIMIT if the robot pulls at a bolt with more than its preload, so that the joint opens there."""
        if self.pattern is None or self.pattern.preload is None:
            return Verdict(Word.OK)
        pull = self.pulls(self.pattern)[..., 0]
        beyond = pull - self.pattern.preload
        row, bolt = np.unravel_index(int(beyond.argmax()), beyond.shape)
        if beyond[row, bolt] <= TOLERANCE * max(1.0, float(self.pattern.preload[bolt])):
            return Verdict(Word.OK)
        others = int((beyond.max(axis=0) > 0).sum()) - 1
        also = f", and {others} more" if others else ""
        return Verdict.from_reasons(
            over=[
                f"the joint opens at bolt {bolt + 1}{also}: the robot pulls it with {_four(float(pull[row, bolt]))} N at t = "
                f"{seconds(float(self.time[row]))} s, preload {_four(float(self.pattern.preload[bolt]))} N"
            ]
        )

    @property
    def line(self) -> str:
        """Sentence on the largest loads, and on bolts that are not judged."""
        text = str(self.load)
        if self.pattern is None or self.pattern.preload is not None:
            return f"{text[0].upper()}{text[1:]}."
        pull = float(self.pulls(self.pattern)[..., 0].max(initial=0.0))
        return (
            f"{text[0].upper()}{text[1:]}. The bolts are not judged, as their preload is not known: the robot pulls one "
            f"with up to {_four(pull)} N."
        )

    def blocks(self) -> list[Table | Line]:
        """Tables of the wrench and of the bolts."""
        largest = self.load.largest
        values, rows = zip(*largest.values(), strict=True)
        wrench_table = Table(
            f"On the foundation, at {self.load.frame}",
            words("component", list(largest)),
            numbers("largest", values, _four),
            words("unit", map(_unit, largest)),
            numbers("when", self.time[list(rows)].tolist(), seconds, "s"),
        )
        if self.pattern is None:
            return [wrench_table]
        return [wrench_table, self._bolt_table(self.pattern)]

    def _bolt_table(self, pattern: BoltPattern) -> Table:
        """Pull and shear of the robot at each bolt, and its preload if that is known."""
        axial, shear = np.moveaxis(self.pulls(pattern), -1, 0)
        title, preload = "Bolts", None
        if pattern.preload is not None:
            title, preload = "Bolts, by the robot alone", numbers("preload", pattern.preload, _four, "N")
        return Table(
            title,
            words("bolt", [str(k + 1) for k in range(axial.shape[1])]),
            numbers("x", 1e3 * pattern.places[:, 0], _four, "mm"),
            numbers("y", 1e3 * pattern.places[:, 1], _four, "mm"),
            numbers("largest pull", axial.max(axis=0), _four, "N"),
            numbers("when", self.time[axial.argmax(axis=0)], seconds, "s"),
            numbers("least", axial.min(axis=0), _four, "N"),
            numbers("shear", shear.max(axis=0), _four, "N"),
            preload,
            most=12,
            by=axial.max(axis=0).tolist(),
        )

    def columns(self) -> dict[str, Array]:
        """Columns (n,) of a written table."""
        columns = {f"mounting.{name} [{_unit(name)}]": self.load.wrench[:, k] for k, name in enumerate(WRENCH)}
        bolts = self.bolts
        if bolts is not None:
            for k in range(bolts.shape[1]):
                columns[f"bolt{k + 1}.axial [N]"] = bolts[:, k, 0]
                columns[f"bolt{k + 1}.shear [N]"] = bolts[:, k, 1]
        return columns


def _unit(component: str) -> str:
    return unit_of("tau", component.startswith("m"))


def _four(value: float) -> str:
    return number(value, 4, decimals=6)


def motion_mounting(load: LoadCase, motion: Motion, frame: str | None, bolts: BoltsGiven | None) -> MotionMounting:
    """Wrench on the foundation along the states of a motion, with payloads and wrenches on the robot."""
    wrenches = {name: np.broadcast_to(F, (len(motion), 6)) for name, F in load.wrenches.items()} or None
    mounting = mounting_load(load.with_load, motion.q, motion.dq, motion.ddq, frame, wrench_on_robot=wrenches)
    pattern = None if bolts is None else BoltPattern.from_given(bolts)
    return MotionMounting(mounting, motion.time, pattern)
