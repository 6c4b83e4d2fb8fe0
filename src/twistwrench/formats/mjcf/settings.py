"""What ``<compiler>``, ``<option>`` and its flags say: how the numbers of an MJCF file are meant."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...core.gravity import GRAVITY
from ...errors import RobotFileError
from ..element import Element


@dataclass(frozen=True)
class Settings:
    """The settings of the file's ``<compiler>`` elements, together; defaults are the format's."""

    degrees: bool = True
    euler_sequence: str = "xyz"
    auto_limits: bool = True
    from_geoms: str = "auto"
    """Whether inertia comes from geoms: ``true``, ``false``, or ``auto``, where a body has no ``<inertial>``."""
    groups: tuple[float, ...] = (0.0, 5.0)
    """The first and last group of geoms that have inertia."""
    total_mass: float = -1.0
    """kg, that all bodies are scaled to; none below zero."""
    least_mass: float = 0.0
    least_moment: float = 0.0
    balanced: bool = False
    """Whether principal moments that break the triangle inequality are all set to their mean."""
    mesh_folder: str = ""
    plain_names: bool = False
    """Whether the folders in the names of mesh files are left out."""
    align_free: bool = False

    @property
    def angle(self) -> float:
        """Radians in the file's unit of angles."""
        return math.pi / 180.0 if self.degrees else 1.0

    @classmethod
    def of(cls, root: Element) -> Settings:
        """Those of a file; of several elements the last one that says something counts."""
        attributes = {name: value for e in root.all("compiler") for name, value in e.attributes.items()}
        elements = root.all("compiler")
        one = (elements[-1] if elements else root).with_attributes(attributes)
        if one.word("coordinate", ("local", "global"), "local") == "global":
            raise RobotFileError(
                f'{one} has coordinate="global", which MuJoCo no longer knows either. Write poses relative to the parent body.'
            )
        sequence = one.attributes.get("eulerseq", "xyz").strip()
        if len(sequence) != 3 or set(sequence) - set("xyzXYZ"):
            raise RobotFileError(
                f'{one} has eulerseq="{sequence}": three of the letters x, y, z, X, Y, Z are expected.'
            )
        return cls(
            degrees=one.word("angle", ("degree", "radian"), "degree") == "degree",
            euler_sequence=sequence,
            auto_limits=one.flag("autolimits", default=True),
            from_geoms=one.word("inertiafromgeom", ("true", "false", "auto"), "auto"),
            groups=tuple(one.floats("inertiagrouprange", (0.0, 5.0))),
            total_mass=one.floats("settotalmass", (-1.0,))[0],
            least_mass=one.floats("boundmass", (0.0,))[0],
            least_moment=one.floats("boundinertia", (0.0,))[0],
            balanced=one.flag("balanceinertia", default=False),
            mesh_folder=one.attributes.get("meshdir", one.attributes.get("assetdir", "")).strip(),
            plain_names=one.flag("strippath", default=False),
            align_free=one.flag("alignfree", default=False),
        )


def disabled_by(root: Element) -> set[str]:
    """The forces that the flags of ``<option>`` turn off: gravity, spring, damper, equality and others, by their names."""
    found: set[str] = set()
    for option in root.all("option"):
        for flag in option.all("flag"):
            found |= {name for name, value in flag.attributes.items() if value.strip() == "disable"}
            found -= {name for name, value in flag.attributes.items() if value.strip() == "enable"}
    return found | also_disabled(found)


def also_disabled(found: set[str]) -> set[str]:
    """The forces that flags for several of them turn off."""
    passive = {"spring", "damper"} if "passive" in found else set()
    return passive | ({"equality", "frictionloss"} if "constraint" in found else set())


def gravity_of(root: Element) -> list[float]:
    """(3,) m/s², zero where a flag turns it off."""
    gravity = list(GRAVITY)
    for option in root.all("option"):
        gravity = option.floats("gravity", gravity)
    if "gravity" in disabled_by(root):
        return [0.0, 0.0, 0.0]
    return gravity


def fluid_of(root: Element) -> Element | None:
    """The ``<option>`` that gives the medium a density or a viscosity."""
    found = None
    for option in root.all("option"):
        if any(option.floats(name, (0.0,))[0] for name in ("density", "viscosity")):
            found = option
    return found
