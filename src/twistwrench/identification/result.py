"""Result of an identification: groups with intervals, settings, held-out residuals, doubts and verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block
from ..core.doubts import Doubt, verdict_from_doubts
from ..core.errors import UnknownNameError
from ..core.estimation.covariance import GroupCovariance
from ..core.estimation.cross_validation import HeldOut
from ..core.estimation.least_squares import Information, NormalEquations, Prior
from ..core.files import as_path
from ..core.glossary import complete
from ..core.numbers import percent
from ..core.tables import csv_table
from ..core.text import listed
from ..core.typing import Array
from ..core.verdict import Verdict
from ..mechanics.bodies.inertia import SpatialInertia
from ..mechanics.model.model import BASE
from ..motion.limits_file import robot_origin
from ..robot import Robot
from .body_changes import BodyChanges, body_changes
from .consistent import ConsistentRobot, ModelResiduals, check_strength, consistent_robot, model_residuals
from .essential_groups import EssentialGroups, essential_groups
from .hyperparameters import FitSettings
from .parameters import BaseParameters, group_units
from .payload import IdentifiedPayload, payload_from
from .undetermined import undetermined_quantities

if TYPE_CHECKING:
    from ..control.residual_threshold import ResidualThreshold
    from ..core.answers.page import Picture, Setting
    from ..motion.motion import Motion

_MIN_OPEN_SHARE = 0.02
"""Share of a joint's torque in another motion from which a group is listed if its deviation changes the torque by it."""
_MIN_POOR_DEVIATION = 0.3
"""Relative deviation from which a group is poorly determined."""


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedRobot(Answer):
    """Identified robot: groups of parameters that the logs determine, with their uncertainty.

    Result of :func:`twistwrench.identify`.

    Attributes
    ----------
    original : Robot, with the values of its file
    base : BaseParameters, the groups of parameters
    values : (r,) array, values of the groups, in SI units
    covariance : GroupCovariance
    sigma : (nv,) array, sizes of the residuals of the training rows [N m or N]
    settings : FitSettings, chosen on the training rows
    held_out : HeldOut, unexplained shares of the torques in rows that were not fitted
    trained : HeldOut, cross-validation over fifths of the training rows
    doubts : tuple of Doubt
    prior : Prior, weak prior of directions without information
    method : str, how the rows were weighted
    sizes : (p,) array, largest plausible sizes of the unknown parameters
    payload_frame : str or None, frame of the payload if only a payload was identified
    notes : tuple of str, on omitted rows and pauses of the logs
    strength : float or None, weight γ of the prior of :attr:`consistent`; None: chosen by cross-validation
    logs : tuple of str, paths of the logs and of the test logs that were read from files

    Examples
    --------
    >>> import tempfile, numpy as np, twistwrench as tw
    >>> arm, t = tw.load(tw.robots.path_of("planar_2r")), np.arange(0, 10, 0.01)
    >>> q = np.stack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), np.cos(1.9 * t) + np.sin(4.3 * t)], axis=1)
    >>> tau = 1.2 * tw.Motion(t, q, robot=arm).torques() + 0.05 * np.sin(np.outer(t, [41, 43]))
    >>> found = tw.identification.identify(arm, tw.Motion(t, q, tau=tau, robot=arm), cutoff=10.0, shift=0.0)
    >>> found.interval().shape, found.consistent_at(1.0).inertias[0].defects()
    ((13, 2), [])
    >>> found.to_dict()["base_parameters"], found.brief, list(found.facts()), len(list(found.blocks())) > 5
    (13, '0.192 %', ['unexplained', 'worst joint', 'groups'], True)
    >>> list(found.sources())
    ['ROBOT']
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     notes = found.write(f"{folder}/new.urdf", f"{folder}/new.yaml")
    ...     page = found.report(f"{folder}/report.html").read_text()
    ...     table = found.to_csv(f"{folder}/groups.csv").read_text().partition(",")[0]
    ...     tw.load(f"{folder}/new.urdf").nv, page[:15], "Torques of rows held out" in page, table
    (2, '<!doctype html>', True, 'group')
    """

    call: ClassVar[str] = "identify"

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
    strength: float | None = None
    logs: tuple[str, ...] = ()
    torque_shares: Array | None = None
    """(nv, r) changes of another motion's torques by a deviation of each group, as shares of a joint's torque (rms)."""
    thresholds: ResidualThreshold | None = None
    """Thresholds of a momentum observer's residual, if a gain was given."""
    _fifths: tuple[NormalEquations, ...] = ()
    """Normal equations of the weighted rows of each fifth of the time, joint by joint, in units of the residuals."""

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.original.name

    @property
    def brief(self) -> str:
        """Share of the torques left unexplained in rows held out, and assumed causes."""
        unexplained = percent(self.held_out.all, 3)
        if not self.settings.assumed:
            return unexplained
        return f"{unexplained}, assuming {listed(self.settings.assumed, 3)}"

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the groups."""
        return self.base.names

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the groups: each group has the unit of its first parameter."""
        return group_units(self.groups, self.original.model)

    @property
    def standard_deviations(self) -> Array:
        """(r,) standard deviations of the groups, for autocorrelated residuals."""
        return self.covariance.deviations

    @cached_property
    def consistent(self) -> ConsistentRobot:
        """Robot with physically consistent bodies, as near to the file's as held-out predictions allow."""
        return self.consistent_at(self.strength)

    @cached_property
    def body_changes(self) -> BodyChanges:
        """Changes of masses and centres of mass from the file's, with deviations, and a tool that the robot may carry."""
        return body_changes(self)

    @property
    def worst(self) -> tuple[str, float] | None:
        """Joint and its unexplained share of torque, the largest in rows held out; None if no joint has torques."""
        # a joint without torques has no finite share
        share_of_joint = {joint: share for joint, share in self.held_out.joints.items() if math.isfinite(share)}
        if not share_of_joint:
            return None
        worst_joint = max(share_of_joint, key=lambda joint: share_of_joint[joint])
        return worst_joint, share_of_joint[worst_joint]

    @property
    def free_count(self) -> int:
        """Number of groups that were not held at known values."""
        return int((~self.base.held).sum())

    @property
    def offsets(self) -> Mapping[str, float]:
        """Offset of the torque by joint; 0 if its interval contains 0. Joints without a group of their offset have no entry."""
        low, high = self.interval().T
        offsets: dict[str, float] = {}
        for joint in self.original.model.velocity_names:
            group = f"{joint}.offset"
            if group not in self.groups:
                continue
            k = self.groups.index(group)
            may_be_zero = low[k] <= 0.0 <= high[k]
            offsets[joint] = 0.0 if may_be_zero else float(self.values[k])
        return offsets

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
        check_strength(strength)
        return consistent_robot(self.base, self.values, self.sizes, self._information(), self.prior, strength)

    def _information(self) -> list[Information]:
        """Normal equations of each fifth of the time, of all joints together."""
        return [fifth.together() for fifth in self._fifths]

    @property
    def robot(self) -> Robot:
        """Robot with consistent bodies, friction and motor inertias.

        If only a payload is identified, it is the original robot with that payload. Gravity is the gravity of the logs,
        including an assumed cause that changes it.
        """
        if self.payload is not None:
            return self.original.with_payload(self.payload.inertia, self.payload.frame)
        robot = self.consistent.robot
        load_friction = self.load_friction
        if not load_friction:
            return robot
        model = robot.model
        load_shares = np.array([load_friction.get(joint, 0.0) for joint in model.velocity_names])
        friction = replace(model.friction, load=load_shares)
        return Robot(replace(model, friction=friction))

    def residual_thresholds(self, motion: Motion, gain: float, *, per_hour: float = 1.0) -> ResidualThreshold:
        """Thresholds for collision detection by an observer of the identified robot, from a log without contact.

        Parameters
        ----------
        motion : Motion
            Log with measured torques, 32 s or more.
        gain : float, inverse of the observer's time constant [1/s]
        per_hour : float, false alarms in an hour, of all joints together

        Returns
        -------
        found : ResidualThreshold

        Examples
        --------
        >>> import twistwrench as tw
        >>> found = tw.identify("planar_2r", "demo")
        >>> log = tw.Motion.from_file(tw.robots.path_of("planar_2r").with_name("planar_2r_demo_log.csv"), found.original)
        >>> found.residual_thresholds(log, 30.0).torques.shape
        (2,)
        """
        from ..control.observer import MomentumObserver

        observer = MomentumObserver(self.robot, gain, friction=True)
        return observer.threshold(motion, per_hour=per_hour)

    @property
    def load_friction(self) -> Mapping[str, float]:
        """Load friction by joint, as a share of the carried torque, if it was assumed and its estimate is positive."""
        shares: dict[str, float] = {}
        for cause in self.settings.assumed:
            percentage = cause.value
            if cause.kind != "load-friction" or percentage is None or not percentage > 0.0:
                continue
            joints = cause.joints
            if not joints:  # a cause without joints has one value for all of them
                joints = self.original.model.velocity_names
            shares |= dict.fromkeys(joints, 0.01 * percentage)
        return shares

    @cached_property
    def payload(self) -> IdentifiedPayload | None:
        """Payload, if ``payload_only`` was requested."""
        if self.payload_frame is None:
            return None
        return payload_from(self.original, self.payload_frame, self.base, self.values, self.covariance.matrix)

    @cached_property
    def essential(self) -> EssentialGroups:
        """Smallest set of groups that predicts held-out rows as well as all groups."""
        return essential_groups(self.groups, self._information(), self.prior.size, self.base.held, self.values)

    @cached_property
    def residuals(self) -> ModelResiduals:
        """Held-out residuals of the file's bodies, the file's bodies with friction, the groups and the consistent robot."""
        strength = self.consistent.fit.strength
        return model_residuals(self.base, self._fifths, self.prior, self.values, self.sizes, strength)

    def interval(self, level: float = 0.95) -> Array:
        """Confidence intervals of the groups.

        Returns
        -------
        interval : (r, 2) array, lower and upper limit of each group
        """
        half_widths = self.covariance.half_width(level)
        low = self.values - half_widths
        high = self.values + half_widths
        return np.stack([low, high], axis=1)

    @cached_property
    def verdict(self) -> Verdict:
        """OK, UNSURE, or LOOK AGAIN if the results are not trustworthy."""
        return verdict_from_doubts(self.doubts)

    @cached_property
    def undetermined(self) -> dict[str, str]:
        """Sentences on quantities that such logs cannot determine, by name; empty if only a payload is identified."""
        if self.payload_frame is not None:
            return {}
        return undetermined_quantities(self.base, self.held_out.all)

    @property
    def poorly_determined(self) -> tuple[str, ...]:
        """Names of the groups whose standard deviation exceeds 30 % of their value, largest relative deviation first."""
        sizes_of_values = np.maximum(np.abs(self.values), 1e-300)  # no division by zero
        relative_deviations = self.standard_deviations / sizes_of_values
        largest_first = np.argsort(-relative_deviations)
        is_poor = (relative_deviations > _MIN_POOR_DEVIATION) & ~self.base.held
        return tuple(self.groups[k] for k in largest_first if is_poor[k])

    @property
    def open_for_torques(self) -> dict[str, tuple[str, float]]:
        """Groups whose deviation changes a joint's torque in another motion by over 2 %; the largest change first.

        Each group name is given the joint that changes most, and the change as a share of this joint's torque. Empty if
        ``torque_shares`` is None.
        """
        if self.torque_shares is None:
            return {}
        joint_names = self.original.model.velocity_names
        largest_shares = self.torque_shares.max(axis=0)
        worst_joints = self.torque_shares.argmax(axis=0)
        largest_first = np.argsort(-largest_shares)
        open_groups: dict[str, tuple[str, float]] = {}
        for k in largest_first:
            if largest_shares[k] > _MIN_OPEN_SHARE:
                worst_joint = joint_names[worst_joints[k]]
                open_groups[self.groups[k]] = (worst_joint, float(largest_shares[k]))
        return open_groups

    @property
    def parameters(self) -> Mapping[str, tuple[float, float]]:
        """Value and standard deviation of each group, by name."""
        values_with_deviations = zip(self.values.tolist(), self.standard_deviations.tolist(), strict=True)
        return dict(zip(self.groups, values_with_deviations, strict=True))

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

    def report(self, path: str | Path) -> Path:
        """Write the page of :meth:`to_html`.

        Returns
        -------
        path : Path of the file written

        Raises
        ------
        ValueRangeError
            The file cannot be written.
        """
        return self.to_html(path)

    def to_csv(self, path: str | Path) -> Path:
        """Write groups with values, deviations, 95 % intervals and the values of the file as a table, in SI units.

        Returns
        -------
        path : Path of the file written
        """
        low, high = self.interval().T
        columns: dict[str, Sequence[str] | Array] = {
            "group": self.groups,
            "unit": self.units,
            "value": self.values,
            "deviation": self.standard_deviations,
            "low": low,
            "high": high,
            "file": self.prior.mean,
        }
        with csv_table(path, columns) as table:
            for row in zip(*columns.values(), strict=True):
                table.row(row)
        return as_path(path)

    # ── The answer on every surface

    def blocks(self) -> Iterator[Block]:
        """Verdict, doubts, bodies and joints against the file; groups and settings in the full form."""
        from .views.identified_robot import identification_view

        return identification_view(self)

    def facts(self) -> Mapping[str, str]:
        """Unexplained share of the torques, the joint with the largest share, and the number of groups.

        Returns
        -------
        facts : {name: text}
        """
        facts = {"unexplained": percent(self.held_out.all, 3)}
        if self.worst is not None:
            joint, share = self.worst
            facts["worst joint"] = f"{joint}, {percent(share, 3)}"
        facts["groups"] = str(self.free_count)
        return facts

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the robot and of the logs.

        Returns
        -------
        files : {argument: path}
        """
        log_files = {f"LOG {path}": path for path in self.logs}
        return {"ROBOT": self.original.model.source, **log_files}

    def origin(self) -> Iterator[Setting]:
        """Robot, settings of the fit, and weights.

        Returns
        -------
        entries : iterator of (name, text), and of Table
        """
        yield from robot_origin(self.original)
        yield "fit", f"{self.settings}; weights {self.method}"

    def pictures(self) -> Iterable[Picture]:
        """Robot, torques, residuals, friction, groups, and bodies; none if matplotlib is not installed.

        Returns
        -------
        pictures : iterable of Picture
        """
        from .pictures import identification_pictures

        return identification_pictures(self)

    def plot(self, kind: str | Path | None = None, path: str | Path | None = None) -> Any:
        """Plot measured and predicted torques of held-out rows, groups with intervals, and residuals by γ.

        Parameters
        ----------
        kind : "identification", or a file name
        path : str or Path, optional; the suffix determines the format (.png, .pdf, .svg)

        Returns
        -------
        figure : matplotlib figure, or Path of the file written

        Raises
        ------
        MissingExtraError
            Matplotlib is missing.
        ValueRangeError
            The file cannot be written.
        """
        from ..viz.answers import plot_one_of
        from .pictures import identification_plots

        return plot_one_of(identification_plots(self), self, kind, path)

    def to_dict(self) -> dict[str, Any]:
        """Dictionary of plain data in SI units, as written by ``--json``.

        Returns
        -------
        findings : dict, compatible with ``json.dumps``
        """
        results = {
            "doubts": [doubt.to_dict() for doubt in self.doubts],
            "notes": list(self.notes),
            "assumed": [asdict(cause) for cause in self.settings.assumed],
            "undetermined": self.undetermined,
            "base_parameters": self.base.count,
            "held_out": {"kind": self.held_out.kind, "all": self.held_out.all, "joints": self.held_out.joints},
            "training": {"all": self.trained.all, "joints": self.trained.joints},
            "settings": self._settings_to_dict(),
            "parameters": self._parameters_to_dict(),
            "poorly_determined": list(self.poorly_determined),
            "held": {self.groups[k]: float(self.values[k]) for k in np.flatnonzero(self.base.held)},
            "essential": dict(zip(self.essential.names, self.essential.values.tolist(), strict=True)),
            "bodies": self.body_changes.to_list(),
            "payload": None if self.payload is None else self.payload.to_dict(),
            "thresholds": None if self.thresholds is None else self.thresholds.to_dict(),
        }
        return {**super().to_dict(), **_without_infinities(results)}

    def _settings_to_dict(self) -> dict[str, Any]:
        """Settings of the fit."""
        names = self.original.model.velocity_names
        return {
            "method": self.method,
            "cutoff": self.settings.cutoff,
            "friction_speed": dict(zip(names, self.settings.friction_speed.tolist(), strict=True)),
            "shift": self.settings.shift,
            "block": self.covariance.block,
        }

    def _parameters_to_dict(self) -> dict[str, dict[str, Any]]:
        """Value, deviation, interval and file value of each group, by name."""
        intervals = self.interval().tolist()
        file_values = self.prior.mean.tolist()
        parameters: dict[str, dict[str, Any]] = {}
        for k, (name, (value, deviation)) in enumerate(self.parameters.items()):
            parameters[name] = {
                "value": value,
                "deviation": deviation,
                "interval": intervals[k],
                "prior": file_values[k],
            }
        return parameters


def _without_infinities(data: Any) -> Any:
    """Replace numbers that JSON cannot represent by None."""
    if isinstance(data, dict):
        return {name: _without_infinities(value) for name, value in data.items()}
    if isinstance(data, list | tuple):
        return [_without_infinities(value) for value in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


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
    bodies = list(model.bodies)
    link_inertias = dict(model.link_inertias)
    moving_links = [name for name, frame in model.frames.items() if frame.body != BASE and name in link_inertias]
    for link in links:
        if link not in moving_links:
            raise UnknownNameError.from_choices("link that moves", link, moving_links)
        frame = model.frames[link]
        body = bodies[frame.body]
        G = link_inertias[link].in_frame(frame.pose)  # in the frame of the body
        bodies[frame.body] = replace(body, inertia=body.inertia - G)
        link_inertias[link] = SpatialInertia.zero()
    return Robot(replace(model, bodies=tuple(bodies), link_inertias=link_inertias))


complete(globals())
