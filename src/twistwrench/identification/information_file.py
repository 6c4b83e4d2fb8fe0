"""Information in a file: arrays and what is said of them, in an archive of NumPy."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.files import as_path
from ..core.foreign_errors import foreign_errors
from ..errors import NotFoundError, ShapeError, ValueRangeError
from ..outputs import replacing
from ..robot import Robot
from .evidence import LogDoubt
from .held_out import HeldOutRows
from .joint_moments import JointMoments
from .log_side import MotorSide
from .normal_equations import Prior
from .parameter_groups import BaseParameters
from .setting_trial import FitSettings
from .streamed_rows import RowFrame
from .unknown_parameters import STRIBECK_SPEED, UnknownParameters

if TYPE_CHECKING:
    from .information import Information

_MARK = "twistwrench information 1"
SHOWN = ("time", "log", "measured", "predicted")
"""What there is of rows for pictures."""


def write_information(i: Information, path: str | Path) -> Path:
    """Write it, whole or not at all; raises ValueRangeError."""
    from .. import __version__

    frame, unknown, shown = i.frame, i.frame.base.unknown, i.shown
    said = {
        "format": _MARK,
        "version": __version__,
        "robot": i.robot.name,
        "groups": list(frame.base.names),
        "motor_inertia": unknown.motor_inertia,
        "friction": list(unknown.friction),
        "known": dict(unknown.known),
        "stribeck_speed": unknown.stribeck_speed,
        "payload": i.payload_frame,
        "cutoff": frame.settings.cutoff,
        "shift": frame.settings.shift,
        "chosen": [frame.free_shift, frame.free_speed],
        "robust": frame.robust,
        "method": i.method,
        "seconds": i.seconds,
        "samples": i.samples,
        "hanging": i.hanging,
        "logs": list(i.logs),
        "doubts": [asdict(d) for d in i.doubts],
    }
    side = unknown.motor_side
    arrays: dict[str, Any] = {
        "said": np.array(json.dumps(said)),
        "friction_speed": frame.settings.friction_speed,
        "x": frame.x,
        "sigma": frame.sigma,
        "dead": frame.dead,
        "mean": i.weak.mean,
        "size": i.weak.size,
        "sizes": i.sizes,
        "sums": i.moments.sums,
        "counts": i.moments.counts,
        **{f"factor{j}": R for j, R in enumerate(i.moments.factors)},
        **({} if side is None else {"ratios": side.ratios, "zero": side.zero, "gain": side.gain}),
        **({} if shown is None else {f"shown_{k}": getattr(shown, k) for k in SHOWN}),
    }
    target = as_path(path)
    with replacing(target) as scratch, scratch.open("wb") as file:
        np.savez(file, **arrays)
    return target


def information_arguments(path: str | Path, robot: Robot) -> dict[str, Any]:
    """What information of a file is made with; raises NotFoundError, ShapeError, ValueRangeError."""
    path = as_path(path)
    if not path.is_file():
        raise NotFoundError(f"no information {str(path)!r}. Give a file that --information wrote.")
    advice = "Give a file that --information wrote, whole."
    with foreign_errors(lambda reason: ShapeError(f"{path}: no information that can be read: {reason}. {advice}")):
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        said = json.loads(str(arrays["said"]))
        if said["format"] != _MARK:
            raise ValueError(f"its format is {said['format']!r}")
    side = MotorSide(arrays["ratios"], arrays["zero"], arrays["gain"]) if "ratios" in arrays else None
    speed = said.get("stribeck_speed", STRIBECK_SPEED)
    base = BaseParameters.of(
        UnknownParameters(robot, said["motor_inertia"], tuple(said["friction"]), side, said["known"], speed)
    )
    if list(base.names) != said["groups"]:
        raise ValueRangeError(
            f"{path}: is of {said['robot']!r} with {len(said['groups'])} groups of parameters, and {robot.name!r} has "
            f"others ({base.count}). Give the robot file that it was made with."
        )
    settings = FitSettings(said["cutoff"], arrays["friction_speed"], said["shift"])
    chosen = bool(said["chosen"][0]), bool(said["chosen"][1])
    frame = RowFrame(base, settings, arrays["x"], arrays["sigma"], arrays["dead"], *chosen, said["robust"])
    factors = tuple(arrays[f"factor{j}"] for j in range(len(frame.felt)))
    return {
        "robot": robot,
        "frame": frame,
        "moments": JointMoments(arrays["sums"], arrays["counts"], factors),
        "weak": Prior(arrays["mean"], arrays["size"]),
        "sizes": arrays["sizes"],
        **{name: said[name] for name in ("method", "seconds", "samples", "hanging")},
        "logs": tuple(said["logs"]),
        "doubts": tuple(LogDoubt(d["kind"], d["sentence"], tuple(d["joints"]), d["refuses"]) for d in said["doubts"]),
        "payload_frame": said["payload"],
        "shown": HeldOutRows(*(arrays[f"shown_{k}"] for k in SHOWN)) if "shown_time" in arrays else None,
    }
