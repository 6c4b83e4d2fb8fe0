"""Known values of parameters, as ``--known`` of ``twistwrench identify`` takes them."""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import UnknownNameError, ValueRangeError
from ..joints.units import units_of

_UNITS = {
    "m": ("kg",),
    **dict.fromkeys(("mcx", "mcy", "mcz"), ("kg m",)),
    **dict.fromkeys(("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"), ("kg m^2",)),
    "motor_inertia": ("kg m^2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    **dict.fromkeys(("coulomb", "stribeck", "offset"), units_of("tau", (True, False))),
}
"""SI units of each kind of parameter: that of turning joints first."""


def parse_known(texts: Sequence[str]) -> dict[str, float]:
    """Values by the names of parameters; ``.mass`` is ``.m``. Raises ValueRangeError.

    >>> parse_known(["link_3.mass=0.73 kg", "joint_2.viscous=1.2"])
    {'link_3.m': 0.73, 'joint_2.viscous': 1.2}
    """
    found = dict[str, float]()
    for text in texts:
        name, equal, value = (part.strip() for part in text.rpartition("="))
        owner, _, kind = name.rpartition(".")
        kind = {"mass": "m"}.get(kind, kind)
        number, _, unit = value.partition(" ")
        allowed = _UNITS.get(kind)
        if equal and owner and allowed is None:
            raise UnknownNameError(f"--known {text!r}: {UnknownNameError.of('parameter', kind, _UNITS)}")
        try:
            if not equal or not owner or allowed is None:
                raise ValueError  # noqa: TRY301  the same sentence answers all of it
            found[f"{owner}.{kind}"] = float(number)
        except ValueError:
            raise ValueRangeError(
                f"--known {text!r} is not NAME=VALUE, for example link_3.m=0.73. Links and joints have: "
                f"{', '.join(_UNITS)}."
            ) from None
        if unit and unit.strip() not in allowed:
            raise ValueRangeError(f"--known {text!r}: the unit {unit.strip()!r} is not {' or '.join(allowed)}.")
    return found


def check_payload(frame: str | None, outputs: Sequence[str]) -> None:
    """Raises ValueRangeError where a file is asked for that a payload alone does not make."""
    refused = [name for name in outputs if name not in ("--json", "--csv")]
    if frame is not None and refused:
        raise ValueRangeError(f"{refused[0]} with --payload-only: a payload is no robot. --json writes it.")
