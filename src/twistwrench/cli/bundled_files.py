"""Files that come with the bundled robots, which commands call ``demo``."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import UnknownNameError, ValueRangeError

if TYPE_CHECKING:
    from .robot_options import RobotOptions

_DEMO = "demo"


def bundled(name: str, robot: str, suffix: str, what: str) -> Path:
    """The path given, or for ``demo`` the file of that kind bundled with that robot."""
    if name != _DEMO or Path(name).is_file():
        return Path(name)
    folder = Path(__file__).parents[1] / "robots"
    path = folder / f"{robot}_{_DEMO}{suffix}"
    if not path.is_file():
        have = [p.name.removesuffix(f"_{_DEMO}{suffix}") for p in sorted(folder.glob(f"*_{_DEMO}{suffix}"))]
        near = difflib.get_close_matches(robot.lower(), have, n=1, cutoff=0.8)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise UnknownNameError(
            f"no {what} is bundled with {robot!r}.{hint} With: {', '.join(have)}. "
            f"Give the path of a {suffix.rpartition('.')[2].upper()} file instead."
        )
    return path


def motion_path(options: RobotOptions, motion: str) -> Path:
    """The motion's file; the bundled ones are in radians."""
    path = bundled(motion, options.source, ".csv", "motion")
    if options.degrees and path != Path(motion):
        raise ValueRangeError("the bundled motion 'demo' is in radians. Leave --degrees out.")
    return path
