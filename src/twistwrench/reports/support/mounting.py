"""Load of a motion on the foundation and on its bolts, as a part of the torque report."""

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
"""Bolts as one of three:

- text ``"6x0.200"``: number of bolts and diameter of their circle [m]
- path of a CSV file with columns ``x,y[,preload]``
- places (k, 2) [m]
"""

_CIRCLE = re.compile(r"(\d+)\s*x\s*([\d.eE+-]+)")
"""Text of a bolt circle, as ``6x0.200``; its groups are the number of bolts and the diameter."""
_FORM = (
    "NUMBERxDIAMETER in metres such as 6x0.200, or a CSV file with the columns x,y[,preload] in m and N, or with other units "
    "in brackets, such as x [mm],y [mm],preload [kN]"
)
"""Allowed forms of bolts, for messages."""
_MAX_CIRCLE = 10.0
"""Largest diameter of a bolt circle [m]."""
_MAX_BOLT_ROWS = 12
"""Largest number of bolts in a table: those with the largest pulls."""


@dataclass(frozen=True, eq=False)
class BoltPattern:
    """Places of bolts in the frame of the mounting, and their preloads."""

    places: Array
    """Coordinates x and y (k, 2) of the bolts [m]."""
    preload: Array | None = None
    """Preloads (k,) of the bolts [N]; None if they are not known."""

    def __post_init__(self) -> None:
        distances = np.linalg.norm(self.places, axis=1)
        max_distance = float(distances.max(initial=0.0))
        if max_distance > 0.5 * _MAX_CIRCLE:
            raise ValueRangeError(
                f"{{0}}: a bolt is {number(max_distance)} m from the middle of the mounting, and a circle of more than "
                f"{number(_MAX_CIRCLE)} m is not one of a robot. Places are in metres: if these are millimetres, give a "
                "thousandth of them, or write x [mm],y [mm] in the header of the file.",
                Argument("bolts"),
            )
        if self.preload is not None and (self.preload < 0).any():
            bolt = int(self.preload.argmin())
            least_preload = float(self.preload[bolt])
            raise ValueRangeError(
                f"{{0}}: the preload of bolt {bolt + 1} is {number(least_preload)} N. Give "
                "the force that presses the joint together, at least 0.",
                Argument("bolts"),
            )

    @classmethod
    def from_given(cls, given: BoltsGiven) -> BoltPattern:
        """Pattern from the text of a bolt circle, from a file, or from places."""
        if not isinstance(given, str | Path):
            places = arguments.finite(given, "bolts", 2)
            return cls(np.atleast_2d(places))
        circle = _CIRCLE.fullmatch(str(given).strip())
        if isinstance(given, str) and circle is not None:
            bolt_count = int(circle[1])
            (diameter,) = parse_numbers(circle[2], "bolts", _FORM, 1)
            return cls(bolt_circle(bolt_count, diameter))
        if not Path(given).is_file():
            raise ValueRangeError(f"{{0}}: {str(given)!r} is not {_FORM}.", Argument("bolts"))
        return cls._from_file(Path(given))

    @classmethod
    def _from_file(cls, path: Path) -> BoltPattern:
        """Pattern from a CSV file with the columns x, y and optionally preload, optionally with units."""
        with table_errors(path, "table of bolts", "x,y,preload, then a line for each bolt, such as 0.1,0.1,5000"):
            file = CsvFile.open(path)
            names_and_units = [split_unit(cell) for cell in file.header]
            names = [name.casefold() for name, _ in names_and_units]  # x, y, preload
            if names not in (["x", "y"], ["x", "y", "preload"]):
                raise ValueRangeError(f"{path}: the columns are {', '.join(file.header)}. Give {_FORM}.")
            factors = np.ones(len(names))  # from the file's units to SI units
            for k, (name, unit) in enumerate(names_and_units):
                if unit is not None:
                    quantity = "tau" if names[k] == "preload" else "q"  # of a prismatic joint: a force, a length
                    turning = False
                    factors[k] = unit_factor(unit, quantity, turning, f"{path}, column {name!r}")
            all_columns = tuple(range(len(names)))
            table = file.table(all_columns) * factors
        preload = table[:, 2] if "preload" in names else None
        return cls(table[:, :2], preload)


@dataclass(frozen=True, eq=False)
class MotionMounting:
    """Wrench of a motion on the foundation, with the loads of its bolts."""

    load: MountingLoad
    """Wrench on the foundation at each time."""
    time: Array
    """Times (n,) of the motion [s]."""
    pattern: BoltPattern | None = None
    """Bolts of the mounting; None if they are not given."""

    @property
    def bolts(self) -> Array | None:
        """Axial and shear load of each bolt with its preload, (n, k, 2) [N]; None without bolts. Positive axial loads pull."""
        if self.pattern is None:
            return None
        loads = self.pulls(self.pattern).copy()
        if self.pattern.preload is not None:
            loads[..., 0] += self.pattern.preload
        return loads

    def pulls(self, pattern: BoltPattern) -> Array:
        """Axial and shear load of each bolt by the robot alone, without preload, (n, k, 2) [N]."""
        return self.load.bolts(pattern.places)

    @property
    def verdict(self) -> Verdict:
        """OVER LIMIT if the robot pulls at a bolt with more than its preload, so that the joint opens there."""
        if self.pattern is None or self.pattern.preload is None:
            return Verdict(Word.OK)
        pulls = self.pulls(self.pattern)[..., 0]
        excess = pulls - self.pattern.preload
        row, bolt = np.unravel_index(int(excess.argmax()), excess.shape)  # of the largest excess
        preload = float(self.pattern.preload[bolt])
        if excess[row, bolt] <= TOLERANCE * max(1.0, preload):
            return Verdict(Word.OK)
        opens = excess.max(axis=0) > 0  # mask of the bolts
        other_count = int(opens.sum()) - 1
        others_text = f", and {other_count} more" if other_count else ""
        pull = float(pulls[row, bolt])
        time = float(self.time[row])
        return Verdict.from_reasons(
            over=[
                f"the joint opens at bolt {bolt + 1}{others_text}: the robot pulls it with {_four_digits(pull)} N at t = "
                f"{seconds(time)} s, preload {_four_digits(preload)} N"
            ]
        )

    @property
    def line(self) -> str:
        """Sentence on the largest loads, and one on the largest pull if the preload of the bolts is not known."""
        text = str(self.load)
        sentence = f"{text[0].upper()}{text[1:]}."
        if self.pattern is None or self.pattern.preload is not None:
            return sentence
        pulls = self.pulls(self.pattern)[..., 0]
        largest_pull = float(pulls.max(initial=0.0))
        return (
            f"{sentence} The bolts are not judged, as their preload is not known: the robot pulls one "
            f"with up to {_four_digits(largest_pull)} N."
        )

    def blocks(self) -> list[Table | Line]:
        """Tables of the wrench and of the bolts."""
        largest_components = self.load.largest  # value and row of the motion, by name
        values = [value for value, _ in largest_components.values()]
        rows = [row for _, row in largest_components.values()]
        times = self.time[rows]
        wrench_table = Table(
            "On the foundation",
            words("component", list(largest_components)),
            numbers("largest", values, _four_digits),
            words("unit", [_unit(name) for name in largest_components]),
            numbers("when", times.tolist(), seconds, "s"),
            detail=f", at {self.load.frame}",
        )
        if self.pattern is None:
            return [wrench_table]
        return [wrench_table, self._bolt_table(self.pattern)]

    def _bolt_table(self, pattern: BoltPattern) -> Table:
        """Table of the robot's pull and shear at each bolt, and of its preload if known."""
        axial, shear = np.moveaxis(self.pulls(pattern), -1, 0)  # (n, k) each
        largest_pulls = axial.max(axis=0)
        detail = ""
        preload_column = None
        if pattern.preload is not None:
            detail = ", by the robot alone"
            preload_column = numbers("preload", pattern.preload, _four_digits, "N")
        return Table(
            "Bolts",
            words("bolt", [str(k + 1) for k in range(len(largest_pulls))]),
            numbers("x", 1e3 * pattern.places[:, 0], _four_digits, "mm"),
            numbers("y", 1e3 * pattern.places[:, 1], _four_digits, "mm"),
            numbers("largest pull", largest_pulls, _four_digits, "N"),
            numbers("when", self.time[axial.argmax(axis=0)], seconds, "s"),
            numbers("least", axial.min(axis=0), _four_digits, "N"),  # pull
            numbers("shear", shear.max(axis=0), _four_digits, "N"),
            preload_column,
            detail=detail,
            most=_MAX_BOLT_ROWS,
            by=largest_pulls.tolist(),
        )

    def columns(self) -> dict[str, Array]:
        """Columns (n,) of a written table, by their names with units."""
        columns = {f"mounting.{name} [{_unit(name)}]": self.load.wrench[:, k] for k, name in enumerate(WRENCH)}
        bolt_loads = self.bolts
        if bolt_loads is not None:
            for k in range(bolt_loads.shape[1]):
                columns[f"bolt{k + 1}.axial [N]"] = bolt_loads[:, k, 0]
                columns[f"bolt{k + 1}.shear [N]"] = bolt_loads[:, k, 1]
        return columns


def _unit(component: str) -> str:
    """Unit of a component of a wrench; names of moments begin with m."""
    return unit_of("tau", component.startswith("m"))


def _four_digits(value: float) -> str:
    """Load or length with four significant digits; magnitudes below 1e-6 print as zero."""
    return number(value, 4, decimals=6)


def motion_mounting(load: LoadCase, motion: Motion, frame: str | None, bolts: BoltsGiven | None) -> MotionMounting:
    """Wrench on the foundation along the states of a motion, with payloads and wrenches on the robot."""
    wrenches = {name: np.broadcast_to(F, (len(motion), 6)) for name, F in load.wrenches.items()}
    foundation_load = mounting_load(
        load.with_load, motion.q, motion.dq, motion.ddq, frame, wrench_on_robot=wrenches or None
    )
    pattern = None if bolts is None else BoltPattern.from_given(bolts)
    return MotionMounting(foundation_load, motion.time, pattern)
