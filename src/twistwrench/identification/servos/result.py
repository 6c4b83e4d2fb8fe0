"""Result of an identification of servos: values of each joint with intervals, ratios, held-out error, doubts and verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ...core.answers.answer import Answer
from ...core.answers.blocks import Block
from ...core.doubts import Doubt, verdict_from_doubts
from ...core.estimation.cross_validation import HeldOut
from ...core.glossary import complete
from ...core.typing import Array
from ...core.verdict import Verdict
from ...mechanics.model.actuation import with_friction
from ...robot import Robot
from .output_error import MAX_WIDTH_DETERMINED, OutputErrorFit
from .replay import QUANTITIES

_MAX_WIDTH = 10.0
"""Largest half width of the interval of log(value); a value with this width is unknown."""
NEGLIGIBLE_SHARE = 0.02
"""Half width of damping or friction, as a share of a joint's rms torque, up to which it is negligible."""
_KP = QUANTITIES.index("kp")
"""Index of kp among the values of a joint; it is the last one."""
_FRICTION = {1: "damping", 2: "coulomb"}
"""Names of damping and friction by their index among the values of a joint."""
RATIOS = tuple(f"{name}/kp" for name in QUANTITIES[:_KP])
"""Names of the ratios to kp, in the order of the values."""


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedServos(Answer):
    """Servos of a robot, identified from commands and positions: result of ``identify_servos``.

    ``damping`` is the sum of the servo's derivative gain and of the joint's viscous friction, which positions cannot
    separate.

    Examples
    --------
    >>> import numpy as np, twistwrench as tw
    >>> arm = tw.robots.planar_2r()
    >>> log = tw.identification.simulated_servo_log(arm, armature=0.4, damping=3.0, coulomb=0.5, kp=90.0, delay=0.012)
    >>> found = tw.identification.identify_servos(arm, log)
    >>> found.verdict.ok, found.kp.round().tolist(), found.determined["armature"].tolist(), found.robot.nv
    (True, [90.0, 90.0], [True, True], 2)
    >>> found.interval()["kp"].shape, found.ratios["damping/kp"].shape, list(found.to_dict()["servos"]["joint1"])[0]
    ((2, 2), (2,), 'armature')
    >>> bool(found.relative()["kp"].max() < 0.1)
    True
    >>> found.ratio_interval()["damping/kp"].shape, found.facts()["delay"]
    ((2, 2), '12.1 ms')
    """

    call: ClassVar[str] = "identify"

    original: Robot
    """Robot as its file has it."""
    fit: OutputErrorFit
    """Values that replay the logs best, with their covariance."""
    held_out: HeldOut
    """Error of replayed positions in rows that were not used, as shares of the tracking error c(t - δ) - q."""
    trained: HeldOut
    """Error of replayed positions in rows that were used, as shares of the tracking error."""
    sizes: Array
    """(nv, 3) factors of armature, damping and Coulomb friction in the torque: rms acceleration, rms speed, and 1."""
    live: Array
    """(nv,) bool, False for joints that do not move."""
    known: Mapping[str, float]
    """Values given by the caller."""
    doubts: tuple[Doubt, ...] = ()
    """Reasons against OK, and notes."""

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return self.original.name

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.original.model.velocity_names

    @cached_property
    def values(self) -> Array:
        """(nv, 4) armature, damping, Coulomb friction and kp."""
        return np.exp(self.fit.p[:-1].reshape(-1, len(QUANTITIES)))

    @property
    def armature(self) -> Array:
        """(nv,) reflected inertia of the drives [kg m², sliding joints: kg]."""
        return self.values[:, 0]

    @property
    def damping(self) -> Array:
        """(nv,) derivative gain and viscous friction together [N m s/rad, sliding joints: N s/m]."""
        return self.values[:, 1]

    @property
    def coulomb(self) -> Array:
        """(nv,) Coulomb friction [N m, sliding joints: N]."""
        return self.values[:, 2]

    @property
    def kp(self) -> Array:
        """(nv,) stiffness of the servos [N m/rad, sliding joints: N/m]."""
        return self.values[:, _KP]

    @property
    def delay(self) -> float:
        """Delay of the commands [s], one for all joints."""
        return float(self.fit.p[-1])

    @property
    def delay_half_width(self) -> float:
        """Half width of the 95 % interval of the delay [s]."""
        delay_direction = np.eye(len(self.fit.p))[-1]
        return self.fit.half_width(delay_direction)

    @property
    def ratios(self) -> dict[str, Array]:
        """(nv,) ratios to kp: ``damping/kp``, ``coulomb/kp``, ``armature/kp``; often known where the values are not."""
        return {name: self.values[:, k] / self.kp for k, name in enumerate(RATIOS)}

    def _half_widths(self, level: float = 0.95) -> dict[str, Array]:
        """(nv,) half widths of logarithms of values and of ratios to kp, by name."""
        unit = np.eye(len(QUANTITIES))
        weights_by_name = dict(zip(QUANTITIES, unit, strict=True))
        weights_by_name |= {name: unit[k] - unit[_KP] for k, name in enumerate(RATIOS)}  # log(x/kp) = log x - log kp
        return {name: self._half_widths_along(weights, level) for name, weights in weights_by_name.items()}

    def _half_widths_along(self, weights: Array, level: float) -> Array:
        """(nv,) half widths of a linear combination of each joint's logarithms, with ``weights`` (4,)."""
        directions = np.zeros((len(self.joints), len(self.fit.p)))
        for j, direction in enumerate(directions):
            direction[len(QUANTITIES) * j : len(QUANTITIES) * (j + 1)] = weights
        return np.array([self.fit.half_width(direction, level) for direction in directions])

    def relative(self, level: float = 0.95) -> dict[str, Array]:
        """Half widths of the intervals of logarithms; small ones are relative half widths of the values.

        Parameters
        ----------
        level : float

        Returns
        -------
        widths : {name: (nv,) array}, of the values and of their ratios to kp; at most 10, which stands for unknown
        """
        return {name: np.minimum(half_widths, _MAX_WIDTH) for name, half_widths in self._half_widths(level).items()}

    def interval(self, level: float = 0.95) -> dict[str, Array]:
        """Intervals of the values of each joint.

        Parameters
        ----------
        level : float

        Returns
        -------
        bounds : {name: (nv, 2) array}
        """
        return self._bounds(dict(zip(QUANTITIES, self.values.T, strict=True)), level)

    def ratio_interval(self, level: float = 0.95) -> dict[str, Array]:
        """Intervals of the ratios to kp.

        Parameters
        ----------
        level : float

        Returns
        -------
        bounds : {name: (nv, 2) array}
        """
        return self._bounds(self.ratios, level)

    def _bounds(self, values: Mapping[str, Array], level: float) -> dict[str, Array]:
        """(nv, 2) intervals by name, from values (nv,) by name and the half widths of their logarithms."""
        half_widths = self.relative(level)
        bounds: dict[str, Array] = {}
        for name, x in values.items():
            low = x * np.exp(-half_widths[name])
            high = x * np.exp(half_widths[name])
            bounds[name] = np.stack([low, high], axis=1)
        return bounds

    @cached_property
    def determined(self) -> dict[str, Array]:
        """(nv,) bool by name, True for values that are known to 10 %.

        Damping and friction are also determined if kp is, and if they are known to 2 % of the joint's torque.
        """
        half_widths = self.relative()
        determined = {name: self.live & (half_widths[name] <= MAX_WIDTH_DETERMINED) for name in QUANTITIES}
        for name, share in self.torque_shares.items():
            determined[name] |= determined["kp"] & (share <= NEGLIGIBLE_SHARE)
        return determined

    @property
    def torque_shares(self) -> dict[str, Array]:
        """(nv,) half widths of ``damping`` and ``coulomb`` as shares of the joint's rms torque; inf without torque."""
        half_widths = self._half_widths()
        torques = self.values[:, :_KP] * self.sizes  # of armature, damping and friction
        has_torque = self.rms_torques > 0.0
        shares: dict[str, Array] = {}
        for k, name in _FRICTION.items():
            torque_half_widths = half_widths[name] * torques[:, k]
            shares[name] = np.full(len(has_torque), np.inf)
            np.divide(torque_half_widths, self.rms_torques, out=shares[name], where=has_torque)
        return shares

    @property
    def whole(self) -> Array:
        """(nv,) bool, True if all four values are determined."""
        return np.all([self.determined[name] for name in QUANTITIES], axis=0)

    @cached_property
    def only_ratios(self) -> Array:
        """(nv,) bool, True if kp is not determined, but all ratios to it are."""
        half_widths = self._half_widths()
        are_all_known = np.ones(len(self.live), bool)
        for k, name in enumerate(RATIOS):
            is_known = half_widths[name] <= MAX_WIDTH_DETERMINED
            if k in _FRICTION:
                torque_half_widths = half_widths[name] * self.values[:, k] * self.sizes[:, k]
                is_known |= torque_half_widths <= NEGLIGIBLE_SHARE * self.rms_torques
            are_all_known &= is_known
        return np.asarray(self.live & ~self.determined["kp"] & are_all_known)

    @property
    def rms_torques(self) -> Array:
        """(nv,) rms torque of the servos [N m, sliding joints: N]: kp times the rms tracking error of used rows."""
        return self.kp * np.sqrt(self.trained.sizes / max(1, self._row_count))

    @property
    def _row_count(self) -> int:
        """Number of used rows of all logs."""
        return sum(len(e) for e in self.fit.residuals)

    @cached_property
    def position_error(self) -> dict[str, float]:
        """Error of replayed positions in used rows, rms of each joint [rad, m]."""
        rms = np.sqrt(self.trained.squares / max(1, self._row_count))
        return dict(zip(self.joints, rms.tolist(), strict=True))

    @cached_property
    def robot(self) -> Robot:
        """Robot with the identified armature and Coulomb friction; damping is left to the servo."""
        model = self.original.model
        friction_by_drive: dict[str, dict[str, float]] = {}
        for name, coulomb in zip(model.drive_names, self.coulomb.tolist(), strict=True):
            friction_by_drive[name] = {"coulomb": coulomb}
        model_with_armature = replace(model, armature=self.armature.copy())
        return Robot(with_friction(model_with_armature, friction_by_drive))

    def write(
        self, path: str | Path | None = None, actuators: str | Path | None = None, *, force: bool = False
    ) -> tuple[str, ...]:
        """Write position actuators, armature and friction into an MJCF file, and armature and friction into an actuator file.

        Parameters
        ----------
        path : str or Path, optional, path of the MJCF file
        actuators : str or Path, optional, path of the actuator file
        force : bool, write joints whose values are not determined, too, and write after LOOK AGAIN

        Returns
        -------
        notes : tuple of str, the delay, and joints that are not written

        Raises
        ------
        ValueRangeError
            The verdict is LOOK AGAIN, or no joint is determined. Nothing is written then.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> arm = tw.robots.pendulum()
        >>> log = tw.identification.simulated_servo_log(arm, armature=0.4, damping=3.0, coulomb=0.5, kp=90.0, delay=0.012)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     notes = tw.identification.identify_servos(arm, log).write(f"{folder}/arm.xml")
        ...     round(float(tw.load(f"{folder}/arm.xml").armature[0]), 2)
        0.4
        """
        from .write import write_servos

        return write_servos(self, path, actuators, force=force)

    # ── The answer on every surface

    @cached_property
    def verdict(self) -> Verdict:
        """LOOK AGAIN if commands contradict positions, UNSURE if the logs leave values open, or OK."""
        return verdict_from_doubts(self.doubts)

    def blocks(self) -> Iterator[Block]:
        """Verdict, values of each joint and remarks."""
        from .result_view import servo_view

        return servo_view(self)

    @property
    def brief(self) -> str:
        """Number of joints that are determined."""
        return f"{int(self.whole.sum())} of {len(self.joints)} joints"

    def facts(self) -> Mapping[str, str]:
        """Delay, held-out error and number of determined joints.

        Returns
        -------
        facts : {name: text}
        """
        from .result_view import servo_facts

        return servo_facts(self)

    def to_dict(self) -> dict[str, Any]:
        """Data of :meth:`Answer.to_dict`, and all values with intervals in SI units.

        Returns
        -------
        data : dict
        """
        half_width = self.delay_half_width
        return super().to_dict() | {
            "doubts": [doubt.to_dict() for doubt in self.doubts],
            "servos": {joint: self._servo_to_dict(j) for j, joint in enumerate(self.joints)},
            "delay": {"value": self.delay, "interval": [self.delay - half_width, self.delay + half_width]},
            "held_out": {"all": self.held_out.all, "joints": self.held_out.joints, "kind": self.held_out.kind},
            "position_error": self.position_error,
        }

    def _servo_to_dict(self, j: int) -> dict[str, Any]:
        """Values of a joint and their ratios to kp, with intervals."""
        bounds = self.interval()
        ratio_bounds = self.ratio_interval()
        servo: dict[str, Any] = {}
        for k, name in enumerate(QUANTITIES):
            servo[name] = {
                "value": float(self.values[j, k]),
                "interval": bounds[name][j].tolist(),
                "determined": bool(self.determined[name][j]),
            }
        ratios: dict[str, Any] = {}
        for name, ratio_by_joint in self.ratios.items():
            ratios[name] = {"value": float(ratio_by_joint[j]), "interval": ratio_bounds[name][j].tolist()}
        return servo | {"ratios": ratios}


complete(globals())
