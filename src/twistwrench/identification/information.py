"""Information: what all rows of logs say of a robot's groups, as sums that add up, in a small file in place of the logs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.files import as_path
from ..core.foreign_errors import foreign_errors
from ..errors import NotFoundError, ShapeError, ValueRangeError
from ..outputs import replacing
from ..robot import Robot
from ..typing import Array
from .evidence import LogDoubt
from .held_out import HeldOutRows
from .information_fit import fit_of
from .joint_moments import JointMoments
from .log_side import MotorSide
from .normal_equations import Prior
from .parameter_groups import BaseParameters
from .setting_choice import FitSettings
from .streamed_rows import RowFrame
from .unknown_parameters import UnknownParameters
from .weights import Method

if TYPE_CHECKING:
    from .identified_robot import IdentifiedRobot

_MARK = "twistwrench information 1"


@dataclass(frozen=True, eq=False, repr=False)
class Information:
    """Information of logs: sums over all their rows, which add up, are saved, and go on next week.

    Attributes
    ----------
    robot : Robot, as its file has it
    frame : RowFrame, groups and settings that all rows were made with
    moments : JointMoments
    weak : Prior, that groups without information keep to
    sizes : (p,) array, that each unknown parameter could have at most
    method : str, ``irls``, ``wls`` or ``ols``
    seconds : float, of logs [s]
    samples : int, of logs
    hanging : float, rows that residuals hang together over
    logs : tuple of str, their names
    doubts : tuple of LogDoubt, of the excerpts that settings were chosen on
    shown : HeldOutRows, optional, rows of an excerpt, measured and predicted, for pictures
    """

    robot: Robot
    frame: RowFrame
    moments: JointMoments
    weak: Prior
    sizes: Array
    method: Method
    seconds: float
    samples: int
    hanging: float
    logs: tuple[str, ...]
    doubts: tuple[LogDoubt, ...] = ()
    shown: HeldOutRows | None = None

    def __repr__(self) -> str:
        return (
            f"<Information of {self.robot.name!r}: {self.frame.base.count} groups, {self.samples} samples, "
            f"{len(self.logs)} logs, {self.seconds / 3600:.3g} h>"
        )

    def __add__(self, other: Information) -> Information:
        """Of both; raises ValueRangeError where they were made with other groups or settings."""
        if not isinstance(other, Information):
            return NotImplemented
        mine, their = self.frame, other.frame
        for what, a, b in (
            ("groups", mine.base.names, their.base.names),
            ("cut-offs [Hz]", mine.settings.cutoff, their.settings.cutoff),
            ("offsets of the clock [s]", mine.settings.shift, their.settings.shift),
            ("friction speeds", mine.settings.friction_speed.tolist(), their.settings.friction_speed.tolist()),
            ("weights", (self.method, *mine.sigma, *mine.x), (other.method, *their.sigma, *their.x)),
            ("chosen settings", (mine.free_shift, mine.free_speed), (their.free_shift, their.free_speed)),
        ):
            if a != b:
                raise ValueRangeError(
                    f"these do not add up: their {what} differ. Gather the new logs like the old ones, like=…, or --add FILE."
                )
        new = tuple(d for d in other.doubts if (d.kind, d.joints) not in {(x.kind, x.joints) for x in self.doubts})
        return replace(
            self,
            moments=self.moments + other.moments,
            seconds=self.seconds + other.seconds,
            samples=self.samples + other.samples,
            logs=(*self.logs, *other.logs),
            doubts=(*self.doubts, *new),
        )

    @property
    def values(self) -> Array:
        """(r,) values of the groups."""
        return fit_of(self).solved(np.arange(len(self.moments.counts)))[0][: self.frame.base.count]

    def identified(self, test: Information | None = None) -> IdentifiedRobot:
        """The robot that all rows together tell.

        Parameters
        ----------
        test : Information, optional, of logs that are only predicted, gathered like this one

        Returns
        -------
        found : IdentifiedRobot

        Raises
        ------
        TrajectoryError
            The logs are too short to hold a part of them out.
        ValueRangeError
            ``test`` was made with other groups or settings.

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 20, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> tw.identification.gather(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=()).identified().base.count
        3
        """
        from .gathered_robot import gathered_robot

        return gathered_robot(self, test)

    def check(self) -> float:
        """The largest difference of a group by orthogonal factors (TSQR), in units of its standard deviation.

        Returns
        -------
        difference : float

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 20, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> information = tw.identification.gather(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
        >>> information.check() < 1e-6
        True
        """
        fit = fit_of(self)
        x, sigma = fit.solved(np.arange(len(self.moments.counts)))
        deviations = fit.covariance(x, sigma, 0.0).deviations
        r = self.frame.base.count
        return float((np.abs(fit.by_factors() - x)[:r] / np.maximum(deviations, 1e-300)).max(initial=0.0))

    def save(self, path: str | Path) -> Path:
        """Save as a small file, whole or not at all.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        ValueRangeError
            The file cannot be written.

        Examples
        --------
        >>> import tempfile, numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 20, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> information = tw.identification.gather(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     again = tw.identification.Information.load(information.save(f"{folder}/week.npz"), arm)
        >>> bool((again.values == information.values).all())
        True
        """
        from .. import __version__

        frame, unknown, shown = self.frame, self.frame.base.unknown, self.shown
        said = {
            "format": _MARK,
            "version": __version__,
            "robot": self.robot.name,
            "groups": list(frame.base.names),
            "motor_inertia": unknown.motor_inertia,
            "friction": list(unknown.friction),
            "cutoff": frame.settings.cutoff,
            "shift": frame.settings.shift,
            "chosen": [frame.free_shift, frame.free_speed],
            "robust": frame.robust,
            "method": self.method,
            "seconds": self.seconds,
            "samples": self.samples,
            "hanging": self.hanging,
            "logs": list(self.logs),
            "doubts": [asdict(d) for d in self.doubts],
        }
        side = unknown.motor_side
        arrays: dict[str, Any] = {
            "said": np.array(json.dumps(said)),
            "friction_speed": frame.settings.friction_speed,
            "x": frame.x,
            "sigma": frame.sigma,
            "dead": frame.dead,
            "mean": self.weak.mean,
            "size": self.weak.size,
            "sizes": self.sizes,
            "sums": self.moments.sums,
            "counts": self.moments.counts,
            **{f"factor{j}": R for j, R in enumerate(self.moments.factors)},
            **({} if side is None else {"ratios": side.ratios, "zero": side.zero, "gain": side.gain}),
            **({} if shown is None else {f"shown_{k}": getattr(shown, k) for k in SHOWN}),
        }
        target = as_path(path)
        with replacing(target) as scratch, scratch.open("wb") as file:
            np.savez(file, **arrays)
        return target

    @classmethod
    def load(cls, path: str | Path, robot: Robot) -> Information:
        """Load what :meth:`save` wrote.

        Parameters
        ----------
        path : str or Path
        robot : Robot, the same

        Returns
        -------
        information : Information

        Raises
        ------
        NotFoundError, ShapeError
            There is no such file, or it is none that can be read.
        ValueRangeError
            It is of another robot.

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.identification.Information.load("none.npz", tw.robots.pendulum())
        Traceback (most recent call last):
        twistwrench.errors.NotFoundError: no information 'none.npz'. Give a file that --information wrote.
        """
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
        base = BaseParameters.of(UnknownParameters(robot, said["motor_inertia"], tuple(said["friction"]), side))
        if list(base.names) != said["groups"]:
            raise ValueRangeError(
                f"{path}: is of {said['robot']!r} with {len(said['groups'])} groups of parameters, and {robot.name!r} has "
                f"others ({base.count}). Give the robot file that it was made with."
            )
        settings = FitSettings(said["cutoff"], arrays["friction_speed"], said["shift"])
        chosen = bool(said["chosen"][0]), bool(said["chosen"][1])
        frame = RowFrame(base, settings, arrays["x"], arrays["sigma"], arrays["dead"], *chosen, said["robust"])
        factors = tuple(arrays[f"factor{j}"] for j in range(len(frame.felt)))
        return cls(
            robot,
            frame,
            JointMoments(arrays["sums"], arrays["counts"], factors),
            Prior(arrays["mean"], arrays["size"]),
            arrays["sizes"],
            said["method"],
            said["seconds"],
            said["samples"],
            said["hanging"],
            tuple(said["logs"]),
            tuple(LogDoubt(d["kind"], d["sentence"], tuple(d["joints"]), d["refuses"]) for d in said["doubts"]),
            HeldOutRows(*(arrays[f"shown_{k}"] for k in SHOWN)) if "shown_time" in arrays else None,
        )


SHOWN = ("time", "log", "measured", "predicted")


def added(parts: Sequence[Information]) -> Information:
    """All of them, in their order."""
    whole = parts[0]
    for one in parts[1:]:
        whole = whole + one
    return whole
