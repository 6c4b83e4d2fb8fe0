"""Writing what was identified: the robot's file and the actuator file, both or neither, and what to know of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.files import as_path
from ..core.printed_numbers import number, percent
from ..errors import ValueRangeError
from ..outputs import replacing
from ..verdict import Word
from .written_actuators import actuator_text, same_actuators
from .written_robot import WrittenRobot, check_written, written_robot

if TYPE_CHECKING:
    from .identified_robot import IdentifiedRobot

_SAME = 1e-12
_KINDS = {
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "stribeck": "static friction above Coulomb's",
    "motor_inertia": "motor inertia",
}


def write_identified(
    found: IdentifiedRobot,
    path: str | Path | None,
    actuators: str | Path | None,
    given: Mapping[str, object] | None,
    logs: Sequence[str],
    *,
    force: bool,
) -> tuple[str, ...]:
    """Write them, and return what to know; raises as :meth:`IdentifiedRobot.write` does, nothing written then."""
    if found.verdict.word is Word.LOOK_AGAIN and not force:
        raise ValueRangeError(f"nothing is written after {found.verdict}. Pass force=True to write all the same.")
    if found.payload_frame is not None:
        raise ValueRangeError("a payload alone is no robot to write. Take found.payload, or with_payload of the robot.")
    consistent = found.consistent
    notes = check_written(consistent)
    if together := _numbers(consistent.of_several_joints):
        notes.append(
            f"no file can say what one motor does to several joints: {together}. Without it the torques of these joints are "
            "not predicted as they are here"
        )
    notes += consistent.outside(found.interval(), found.standard_deviations)
    made = None if path is None else written_robot(found.original, consistent, _headline(found, logs))
    text = None if actuators is None else actuator_text(found.original.model, consistent, given)
    if text is not None and not same_actuators(text, consistent) <= _SAME:
        raise ValueRangeError("what was written of the actuators does not come back. Please report it.")
    if path is not None and made is not None:
        with replacing(path) as scratch:
            scratch.write_bytes(made.data)
        notes += _notes(made, as_path(path), beside=text is not None)
    if actuators is not None and text is not None:
        with replacing(actuators) as scratch:
            scratch.write_text(text, encoding="utf-8")
    return tuple(notes)


def _headline(found: IdentifiedRobot, logs: Sequence[str]) -> str:
    """The comment at the top of the robot's file."""
    from .. import __version__

    said = (
        f"version {__version__}, {date.today().isoformat()}{' from ' + ', '.join(logs) if logs else ''}: {found.base.count} "
        f"groups, {percent(found.held_out.all, 3)} of the torques left in rows held out ({found.held_out.kind}), pull to the "
        f"file {number(found.consistent.fit.strength)}"
    )
    together = _numbers(found.consistent.of_several_joints)
    return f"{said}; not in it: {together}" if together else said


def _notes(made: WrittenRobot, path: Path, *, beside: bool) -> list[str]:
    """What to know of the robot's file; ``beside``: an actuator file is written too."""
    notes = [f"{link} is part of the link that carries it now" for link in made.folded]
    if made.folder is not None and path.resolve().parent != made.folder:
        notes.append(
            f"the robot's file names other files from the folder it came from, {made.folder}: keep the new one there"
        )
    where = "the actuator file has it" if beside else "it stands in an actuator file only, and none is written"
    return notes + [
        f"the robot's file has no place for this {_KINDS[kind]}; {where}: {_numbers(values)}"
        for kind, values in made.missing.items()
    ]


def _numbers(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {number(value)}" for name, value in values.items())
