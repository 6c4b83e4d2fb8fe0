"""Result of an identification: groups with intervals, settings, held-out residuals, doubts and verdict."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..core.doubts import Doubt, verdict_from_doubts
from ..core.errors import UnknownNameError, ValueRangeError
from ..core.estimation.covariance import GroupCovariance
from ..core.estimation.cross_validation import HeldOut
from ..core.estimation.least_squares import NormalEquations, Prior
from ..core.files import as_path, replacing
from ..core.glossary import complete
from ..core.numbers import percent, printed
from ..core.text import listed
from ..core.typing import Array
from ..core.verdict import Verdict
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.model import BASE
from ..robot import Robot
from .consistent import ConsistentRobot, ModelResiduals, consistent_robot, model_residuals
from .hyperparameters import EssentialGroups, FitSettings, essential_groups
from .parameters import BaseParameters, group_units, undetermined
from .payload import IdentifiedPayload, payload_from

_POOR = 0.3  # relative deviation from which a group is poorly determined


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedRobot:
    """Identified robot: groups of parameters that the logs determine, with their uncertainty.

    Attributes
    ----------
    original : Robot, with the values of its file
    base : BaseParameters
    values : (r,) array, values of the groups
    covariance : GroupCovariance
    sigma : (nv,) array, sizes of the residuals of the training rows [N m or N]
    settings : FitSettings, chosen on the training rows
    held_out : HeldOut
    trained : HeldOut, cross-validation over fifths of the training rows
    doubts : tuple of Doubt
    prior : Prior, weak prior of directions without information
    method : str
    sizes : (p,) array, largest plausible sizes of the unknown parameters
    payload_frame : str or None, frame of the payload if only a payload was identified
    notes : tuple of str, on omitted rows and pauses of the logs

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> arm, t = tw.load(tw.robots.path_of("planar_2r")), np.arange(0, 10, 0.01)
    >>> q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    >>> tau = 1.2 * tw.Motion(t, q, robot=arm).torques() + 0.05 * np.sin(np.outer(t, [41, 43]))
    >>> found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm))
    >>> found.interval().shape, found.consistent_at(1.0).inertias[0].defects()
    ((13, 2), [])
    >>> found.to_dict()["base_parameters"], found.to_json()[0]
    (13, '{')
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     notes = found.write(f"{folder}/new.urdf", f"{folder}/new.yaml")
    ...     picture, page = found.plot(f"{folder}/fit.svg"), found.report(f"{folder}/report.html")
    ...     tw.load(f"{folder}/new.urdf").nv, picture.name, page.read_text()[:15]
    (2, 'fit.svg', '<!doctype html>')
    """

    original: Robot
    base: BaseParameters
    values: Array
    covariance: GroupCovariance
    sigma: Array
    settings: FitSettings
    held_out: HeldOut
    trained: HeldOut
    doubts: tuple[Doubt, ...]
    prior: Prior
    method: str
    sizes: Array
    payload_frame: str | None = None
    notes: tuple[str, ...] = ()
    _fifths: tuple[NormalEquations, ...] = ()
    """Normal equations of the weighted rows of each fifth of the time, joint by joint, in units of the residuals."""

    def __repr__(self) -> str:
        assumed = f", assuming {listed(self.settings.assumed, 3)}" if self.settings.assumed else ""
        return (
            f"<IdentifiedRobot {self.original.name!r}: {self.base.count} groups, {percent(self.held_out.all, 3)} held out "
            f"({self.held_out.kind}), {self.verdict.word}{assumed}>"
        )

    def _repr_html_(self) -> str:
        from ..core.tables import html_table

        left = percent(self.held_out.all, 3)
        title = f"{self.verdict}: {self.original.name}, {left} of the torques unexplained in rows held out"
        rows = ((name, percent(x, 3)) for name, x in self.held_out.joints.items())
        return html_table(title, ("joint", "unexplained"), rows)

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the groups."""
        return self.base.names

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the groups: those of their first parameters."""
        return group_units(self.groups, self.original.model)

    @property
    def standard_deviations(self) -> Array:
        """(r,) standard deviations of the groups, for autocorrelated residuals."""
        return self.covariance.deviations

    @cached_property
    def consistent(self) -> ConsistentRobot:
        """Robot with physically consistent bodies, as near to the file's as held-out predictions allow."""
        return self.consistent_at(None)

    def consistent_at(self, strength: float | None) -> ConsistentRobot:
        """Consistent robot for a given weight of the prior.

        Parameters
        ----------
        strength : float or None, weight γ of the prior; None: chosen by cross-validation

        Returns
        -------
        robot : ConsistentRobot

        Raises
        ------
        ValueRangeError
            The strength is not one of the available weights.
        """
        from .consistent import STRENGTHS

        if strength is not None and not STRENGTHS[-1] <= strength <= STRENGTHS[0]:
            raise ValueRangeError(
                f"a strength of {strength!r} is not offered. Give one from {printed(STRENGTHS[-1])} to {printed(STRENGTHS[0])}."
            )
        fifths = [fifth.together() for fifth in self._fifths]
        return consistent_robot(self.base, self.values, self.sizes, fifths, self.prior, strength)

    @property
    def robot(self) -> Robot:
        """Identified robot: consistent bodies, friction, motor inertias; or the original with the identified payload.

        Gravity is the gravity of the logs, including an assumed cause that changes it.
        """
        if self.payload is not None:
            return self.original.with_payload(self.payload.inertia, self.payload.frame)
        robot, load = self.consistent.robot, self.load_friction
        if not load:
            return robot
        friction = robot.model.friction
        shares = np.array([load.get(joint, 0.0) for joint in robot.model.velocity_names])
        return Robot(replace(robot.model, friction=replace(friction, load=shares)))

    @property
    def load_friction(self) -> Mapping[str, float]:
        """Load friction by joint, as a share of the carried torque, if it was assumed and its estimate is positive."""
        names = self.original.model.velocity_names
        assumed = [one for one in self.settings.assumed if one.kind == "load-friction" and (one.value or 0.0) > 0.0]
        return {joint: 0.01 * (one.value or 0.0) for one in assumed for joint in one.joints or names}

    @cached_property
    def payload(self) -> IdentifiedPayload | None:
        """Payload, if ``payload_only`` was requested."""
        if self.payload_frame is None:
            return None
        return payload_from(self.original, self.payload_frame, self.base, self.values, self.covariance.matrix)

    @cached_property
    def essential(self) -> EssentialGroups:
        """Smallest set of groups that predicts held-out rows as well as all groups."""
        fifths = [fifth.together() for fifth in self._fifths]
        return essential_groups(self.groups, fifths, self.prior.size, self.base.held, self.values)

    @cached_property
    def residuals(self) -> ModelResiduals:
        """Held-out residuals of the file's bodies, the file's bodies with friction, the groups and the consistent robot."""
        return model_residuals(
            self.base, self._fifths, self.prior, self.values, self.sizes, self.consistent.fit.strength
        )

    def interval(self, level: float = 0.95) -> Array:
        """Confidence intervals of the groups.

        Returns
        -------
        interval : (r, 2) array
        """
        half = self.covariance.half_width(level)
        return np.stack([self.values - half, self.values + half], axis=1)

    @cached_property
    def verdict(self) -> Verdict:
        """OK, UNSURE, or LOOK AGAIN if the results are not trustworthy."""
        return verdict_from_doubts(self.doubts)

    @cached_property
    def undetermined(self) -> dict[str, str]:
        """Sentences on quantities that such logs cannot determine, by name; empty if only a payload is identified."""
        return {} if self.payload_frame is not None else undetermined(self.base, self.held_out.all)

    @property
    def poorly_determined(self) -> tuple[str, ...]:
        """Names of the groups whose standard deviation exceeds 30 % of their value, largest share first."""
        share = self.standard_deviations / np.maximum(np.abs(self.values), 1e-300)
        order = np.argsort(-share)
        return tuple(self.groups[k] for k in order if share[k] > _POOR and not self.base.held[k])

    @property
    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """Value and standard deviation of each group, by name."""
        pairs = zip(self.values.tolist(), self.standard_deviations.tolist(), strict=True)
        return dict(zip(self.groups, pairs, strict=True))

    def write(
        self,
        path: str | Path | None = None,
        actuators: str | Path | None = None,
        *,
        given: Mapping[str, object] | None = None,
        logs: Sequence[str] = (),
        force: bool = False,
    ) -> tuple[str, ...]:
        """Write the consistent robot into the robot's file, and friction and motor inertias into an actuator file.

        Parameters
        ----------
        path : str or Path, optional, path of the robot file
        actuators : str or Path, optional, path of the actuator file
        given : mapping, optional, content of an actuator file to keep
        logs : sequence of str, names for a comment on the origin of the file
        force : bool, write even if the verdict is LOOK AGAIN

        Returns
        -------
        notes : tuple of str, remarks on the written file

        Raises
        ------
        ValueRangeError
            The verdict is LOOK AGAIN, or the robot predicts no better than the file. Nothing is written then.
        ModelError
            The robot has no file, or its format cannot store a value.
        """
        from .write import write_identified

        return write_identified(self, path, actuators, given, logs, force=force)

    def plot(self, path: str | Path) -> Path:
        """Plot measured and predicted torques of held-out rows, groups with intervals, and residuals by γ.

        Parameters
        ----------
        path : str or Path; the suffix determines the format (.png, .pdf, .svg)

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        MissingExtraError
            Matplotlib is missing.
        ValueRangeError
            The file cannot be written.
        """
        from .pictures import plot_identification

        return plot_identification(self, path)

    def report(self, path: str | Path) -> Path:
        """Write a report as one HTML page: verdict, doubts, residuals, plots and all groups.

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        MissingExtraError
            Matplotlib is missing.
        ValueRangeError
            The file cannot be written.
        """
        from ..answers.page import ReportPage
        from .pictures import identification_pictures
        from .report import bodies_view, identification_view

        target, blocks = as_path(path), list(identification_view(self))
        pictures, details = identification_pictures(self), list(bodies_view(self))
        page = ReportPage("identify", self.original.name, blocks, details=details, pictures=pictures).html()
        with replacing(target) as scratch:
            scratch.write_text(page, encoding="utf-8")
        return target

    def to_dict(self, *, essential: bool = False) -> dict[str, Any]:
        """Dictionary of plain data in SI units, as written by ``--json``.

        Parameters
        ----------
        essential : bool, include the essential groups

        Returns
        -------
        findings : dict, compatible with ``json.dumps``
        """
        names = self.original.model.velocity_names
        speeds = dict(zip(names, self.settings.friction_speed.tolist(), strict=True))
        return {
            "robot": self.original.name,
            "verdict": str(self.verdict.word),
            "doubts": [doubt.to_dict() for doubt in self.doubts],
            "notes": list(self.notes),
            "assumed": [asdict(one) for one in self.settings.assumed],
            "undetermined": self.undetermined,
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
            "poorly_determined": list(self.poorly_determined),
            "held": {self.groups[k]: float(self.values[k]) for k in np.flatnonzero(self.base.held)},
            "essential": dict(zip(self.essential.names, self.essential.values.tolist(), strict=True))
            if essential
            else None,
            "payload": None if self.payload is None else self.payload.to_dict(),
        }

    def to_json(self, *, essential: bool = False) -> str:
        """Return :meth:`to_dict` as JSON text.

        Parameters
        ----------
        essential : bool, as for :meth:`to_dict`

        Returns
        -------
        text : str
        """
        return json.dumps(self.to_dict(essential=essential), indent=2, ensure_ascii=False) + "\n"


def _known(values: Mapping[str, float]) -> dict[str, float | None]:
    """Replace numbers that JSON cannot represent by None."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


# ── Robot without some of its links


def without_links(robot: Robot, links: Iterable[str]) -> Robot:
    """Remove links, such as a hand that was absent in the log; their frames stay.

    Parameters
    ----------
    links : iterable of str, links that are carried by a joint

    Examples
    --------
    >>> import twistwrench as tw
    >>> arm = tw.robots.panda()
    >>> bare = without_links(arm, ["panda_hand"])
    >>> round(sum(b.inertia.mass for b in arm.model.bodies) - sum(b.inertia.mass for b in bare.model.bodies), 6)
    0.73
    """
    model = robot.model
    bodies, own = list(model.bodies), dict(model.link_inertias)
    moving = [name for name, frame in model.frames.items() if frame.body != BASE and name in own]
    for link in links:
        if link not in moving:
            raise UnknownNameError.from_choices("link that moves", link, moving)
        frame = model.frames[link]
        body = bodies[frame.body]
        bodies[frame.body] = replace(body, inertia=body.inertia - own[link].in_frame(frame.pose))
        own[link] = SpatialInertia.zero()
    return Robot(replace(model, bodies=tuple(bodies), link_inertias=own))


complete(globals())
