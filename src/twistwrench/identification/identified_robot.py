"""What identification found: groups with intervals, settings, residuals of rows held out, doubts and the verdict."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..robot import Robot
from ..typing import Array
from ..verdict import Verdict
from .block_deviations import GroupCovariance
from .evidence import LogDoubt
from .held_out import HeldOut
from .normal_equations import Prior
from .parameter_groups import BaseParameters
from .setting_choice import FitSettings

_VAGUE = 0.3
"""Share of its value, from which a group's deviation makes it vague."""

Information = tuple[Array, Array, float]
"""N, c and |τ|² of weighted rows."""


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedRobot:
    """Identified robot: the groups of parameters that the logs tell, and how sure they are.

    Attributes
    ----------
    robot : Robot, as its file has it
    base : BaseParameters
    values : (r,) array, of the groups
    covariance : GroupCovariance
    sigma : (nv,) array, sizes of the residuals of the training rows [N m or N]
    settings : FitSettings, chosen on the training rows
    held_out : HeldOut
    trained : HeldOut, fifths of the training rows predicted from the others
    doubts : tuple of LogDoubt
    prior : Prior, weak, that directions without information keep to
    method : str
    information : tuple, N, c and |τ|² of the weighted rows, in units of their residuals
    folds : tuple, the same of each fifth of the time
    """

    robot: Robot
    base: BaseParameters
    values: Array
    covariance: GroupCovariance
    sigma: Array
    settings: FitSettings
    held_out: HeldOut
    trained: HeldOut
    doubts: tuple[LogDoubt, ...]
    prior: Prior
    method: str
    information: Information
    folds: tuple[Information, ...]

    def __repr__(self) -> str:
        return (
            f"<IdentifiedRobot {self.robot.name!r}: {self.base.count} groups, {100 * self.held_out.all:.3g} % held out "
            f"({self.held_out.kind}), {self.verdict.word}>"
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups in words."""
        return self.base.names

    @property
    def standard_deviations(self) -> Array:
        """(r,) of the groups, with residuals that hang together in time."""
        return self.covariance.deviations

    def interval(self, level: float = 0.95) -> Array:
        """Intervals of the groups.

        Parameters
        ----------
        level : float, the chance that each holds the truth

        Returns
        -------
        interval : (r, 2) array

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 10, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
        >>> found.interval().shape
        (3, 2)
        """
        half = self.covariance.half_width(level)
        return np.stack([self.values - half, self.values + half], axis=1)

    @cached_property
    def verdict(self) -> Verdict:
        """OK, UNSURE, or LOOK AGAIN where no number can be trusted."""
        refused = [doubt.sentence for doubt in self.doubts if doubt.refuses]
        unsure = [doubt.sentence for doubt in self.doubts if not doubt.refuses]
        return Verdict.of(look_again=refused, unsure=unsure)

    @property
    def vague(self) -> tuple[str, ...]:
        """Names of the groups whose deviation is beyond 30 % of their value, vaguest first."""
        share = self.standard_deviations / np.maximum(np.abs(self.values), 1e-300)
        order = np.argsort(-share)
        return tuple(self.groups[k] for k in order if share[k] > _VAGUE)

    @property
    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """Value and standard deviation of each group, by its name."""
        pairs = zip(self.values.tolist(), self.standard_deviations.tolist(), strict=True)
        return dict(zip(self.groups, pairs, strict=True))

    def to_dict(self) -> dict[str, Any]:
        """The findings as plain data, in SI units: what ``--json`` writes.

        Returns
        -------
        findings : dict, which ``json.dumps`` takes

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 10, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
        >>> found.to_dict()["base_parameters"]
        3
        """
        names = self.robot.model.velocity_names
        speeds = dict(zip(names, self.settings.friction_speed.tolist(), strict=True))
        return {
            "robot": self.robot.name,
            "verdict": str(self.verdict.word),
            "doubts": [
                {"kind": d.kind, "joints": list(d.joints), "sentence": d.sentence, "refuses": d.refuses}
                for d in self.doubts
            ],
            "base_parameters": self.base.count,
            "held_out": {"kind": self.held_out.kind, "all": self.held_out.all, "joints": _known(self.held_out.joints)},
            "training": {"all": self.trained.all, "joints": _known(self.trained.joints)},
            "settings": {
                "method": self.method,
                "cutoff": self.settings.cutoff,
                "friction_speed": speeds,
                "shift": self.settings.shift,
                "block": self.covariance.block,
            },
            "parameters": {
                name: {"value": value, "deviation": deviation, "interval": interval, "prior": before}
                for name, (value, deviation), interval, before in zip(
                    self.groups,
                    self.parameters.values(),
                    self.interval().tolist(),
                    self.prior.mean.tolist(),
                    strict=True,
                )
            },
            "vague": list(self.vague),
        }

    def to_json(self) -> str:
        """:meth:`to_dict` as text.

        Returns
        -------
        text : str

        Examples
        --------
        >>> import numpy as np, twistwrench as tw
        >>> arm, t = tw.robots.pendulum(), np.arange(0, 10, 0.01)
        >>> q = (np.sin(1.3 * t) + np.sin(3.1 * t))[:, None]
        >>> tau = tw.Motion(t, q, robot=arm).torques() + 0.01 * np.sin(40 * t)[:, None]
        >>> found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm), friction=())
        >>> found.to_json()[0]
        '{'
        """
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False) + "\n"


def _known(values: Mapping[str, float]) -> dict[str, float | None]:
    """None in place of what JSON has no number for."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}
