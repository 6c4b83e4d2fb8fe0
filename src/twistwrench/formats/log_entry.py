"""What an actuator file says of the columns of logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..core.printed_numbers import printed
from ..errors import ModelError, UnknownNameError, ValueRangeError
from ..model.model import Model
from .actuator_file import check_entries
from .gear_ratio import gear_ratio
from .yaml_section import Section, shown
from .yaml_text import Source, read_yaml


@dataclass(frozen=True)
class LogSide:
    """What an actuator file says of the columns of logs, by joint."""

    of_motors: bool
    """Whether positions and torques are those of the motors, before their gears."""
    ratios: Mapping[str, float]
    coupled: Mapping[str, Mapping[str, float]]
    """Turns of a joint's motor per turn of other joints."""
    zero: Mapping[str, float]
    """Position of the joint where the log says 0 [rad or m]."""
    sign: Mapping[str, float]
    gain: Mapping[str, float]
    """N m (or N) of the motor, or of the joint, per unit of the column."""


def read_log_side(model: Model, source: Source) -> LogSide:
    """The entry ``log:`` of an actuator file, and the ratios of its actuators; nothing special where there is no entry.

    Raises :class:`~twistwrench.NotFoundError`, and :class:`~twistwrench.ModelError` naming the file and the entry.
    """
    content, origin = read_yaml(source)
    try:
        return _log_side(model, Section(content, ""))
    except (ModelError, UnknownNameError, ValueRangeError) as error:
        raise type(error)(f"{origin}: {error}") from None


def _log_side(model: Model, file: Section) -> LogSide:
    check_entries(model, file)
    names = model.velocity_names
    sliding = {b.joint.name for b in model.leaders if b.joint.nv == 1 and not b.joint.turning[0]}
    actuators = file.section("actuators").content if "actuators" in file.content else {}
    ratios = {
        name: gear_ratio(entry["ratio"], f"actuators → {name} → ratio", sliding=name in sliding)
        for name, entry in actuators.items()
        if isinstance(entry, Mapping) and "ratio" in entry
    }
    log = file.section("log") if "log" in file.content else Section({}, "log")
    log.only("side", "joints")
    side = log.content.get("side", "joint")
    if side not in ("joint", "motor"):
        raise ModelError(f"log → side is {shown(side)}, expected joint or motor.")
    joints = log.section("joints") if "joints" in log.content else Section({}, "log → joints")
    given: dict[str, dict[str, Any]] = {"coupled": {}, "zero": {}, "sign": {}, "gain": {}}
    for name in joints.content:
        if name not in names:
            raise UnknownNameError.of("joint", name, names)
        entry = joints.section(name)
        entry.only(*given)
        if "coupled" in entry.content:
            others = entry.section("coupled")
            for other in others.content:
                if other not in names or other == name:
                    raise UnknownNameError.of("other joint", other, [n for n in names if n != name])
            given["coupled"][name] = {
                o: gear_ratio(others.content[o], others.where(o), sliding=o in sliding) for o in others.content
            }
        given["zero"] |= (
            {name: entry.number("zero", "length" if name in sliding else "angle")} if "zero" in entry.content else {}
        )
        given["gain"] |= {name: entry.number("gain", "torque constant")} if "gain" in entry.content else {}
        if "sign" in entry.content:
            sign = entry.number("sign", "")
            if abs(sign) != 1.0:
                raise ModelError(f"{entry.where('sign')} is {printed(sign)}, expected 1 or -1.")
            given["sign"][name] = sign
    return LogSide(side == "motor", ratios, given["coupled"], given["zero"], given["sign"], given["gain"])
