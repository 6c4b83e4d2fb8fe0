"""Chain from the base to the tip with a small twist at each joint: poses of the tip, and twist columns of all parameters.

With the placement P_k of joint k in its parent's moving link and its screw S_k in its own frame,

    T_n = Π_k P_k D_k e^[S_k] (q_k (1 + g_k) - c_k τ_k(q)),   tip = T_n E D

(local product of exponentials; Lynch and Park, Modern Robotics, 4.1, and Wu et al., IEEE T-ASE 12(2), 2015). D_k is a turn
w_k about a point of the joint's axis, and then a shift p_k, both in the axes that the joint's frame has in the file. So an
offset of the joint's zero, however large, is w_k alone, and does not turn the direction of p_k. g_k is the error of a gear,
and c_k the compliance of a joint that gives way to the torque τ_k that holds it. E is the pose of the tip in the last moving
link, as the file has it, and D its displacement, a turn about the tip and a shift in the tip's axes.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.errors import ModelError, ValueRangeError
from ..core.text import argument, listed
from ..core.typing import Array
from ..mechanics.lie import se3, so3
from ..mechanics.lie.adjoint import Ad
from ..mechanics.model.model import BASE
from ..robot import Robot

EFFECTS = ("sag", "gears")
"""Effects beside the geometry that can be fitted."""
_RANDOM_CONFIGURATIONS = 100
"""Configurations in which torques of gravity are compared."""
_ROUNDING = 1e-9
"""Torque of gravity, as a share of the largest joint's, below which it is rounding."""
ANGLES, LENGTHS = ("rx", "ry", "rz"), ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Corrections:
    """Corrections of a chain, turns and shifts in the axes of :attr:`TipChain.axes`."""

    displacements: Array
    """(n, 6) turns w and shifts p."""
    gears: Array
    """(n,) errors of gears, as shares."""
    sags: Array
    """(n,) compliances [rad/(N m) or m/N]."""
    tip: Array
    """(4, 4) pose of the tip in the last moving link."""


@dataclass(frozen=True, eq=False)
class TipChain:
    """Joints on the way from the base to the tip."""

    robot: Robot
    """Robot as its file has it."""
    frame: str
    """Frame of the tip."""
    bodies: tuple[int, ...]
    """Bodies on the way, from the base."""
    assume: tuple[str, ...] = ()
    """Effects that are fitted beside the geometry: sag, gears."""

    @classmethod
    def from_robot(cls, robot: Robot, tip: str | None = None, assume: Collection[str] = ()) -> TipChain:
        """Chain to a frame, by default the tip; raises ModelError for joints that cannot be calibrated."""
        unknown = sorted(set(assume) - set(EFFECTS))
        if unknown:
            raise ValueRangeError(f"assume={listed(unknown)} is not known. Known: {listed(EFFECTS)}.")
        model = robot.model
        if tip is None and robot.tip is None:
            raise ModelError(
                f"robot {model.name!r} has no single tip, so the frame at the target must be named: "
                f"{argument('tip', 'FRAME')}. "
                f"Its leaves: {listed(model.leaves)}."
            )
        frame = str(robot.tip)
        if tip is not None:
            frame = tip
        chain, i = list[int](), model.frame(frame).body
        while i != BASE:
            chain.insert(0, i)
            i = model.bodies[i].parent
        if not chain:
            raise ModelError(f"no joint moves the frame {frame!r}, so there is nothing to calibrate. Give another tip.")
        for i in chain:
            body = model.bodies[i]
            if body.follows:
                raise ModelError(
                    f"{body.joint.name!r} is a mimic joint on the way to {frame!r}. It cannot be calibrated."
                )
            if body.joint.nv != 1:
                raise ModelError(
                    f"joint {body.joint.name!r} on the way to {frame!r} has {body.joint.nv} degrees of freedom. Only joints "
                    "that turn or slide about one axis can be calibrated: load the robot with a fixed base."
                )
        return cls(robot, frame, tuple(chain), tuple(name for name in EFFECTS if name in assume))

    # ── What the file has

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(self.robot.model.bodies[i].joint.name for i in self.bodies)

    @cached_property
    def columns(self) -> list[int]:
        """Indices of the joints in q."""
        return [self.robot.model.bodies[i].q_index for i in self.bodies]

    @cached_property
    def turning(self) -> list[bool]:
        """True for joints that turn."""
        return [bool(self.robot.model.bodies[i].joint.turning[0]) for i in self.bodies]

    @cached_property
    def placements(self) -> Array:
        """(n, 4, 4) placements P."""
        return np.array([self.robot.model.bodies[i].placement for i in self.bodies])

    @cached_property
    def screws(self) -> Array:
        """(n, 6) axes S."""
        return np.array([self.robot.model.bodies[i].joint.axes[0] for i in self.bodies], float)

    @cached_property
    def centres(self) -> Array:
        """(n, 3) points of turning axes nearest to the origins of their frames; zeros for sliding joints."""
        return np.cross(self.screws[:, :3], self.screws[:, 3:])

    @cached_property
    def own(self) -> list[int]:
        """Entry, 0 to 5, of each joint's twist about or along its own axis, or about or along the nearest of x, y and z."""
        return list(map(int, np.abs(self.screws).argmax(axis=1)))

    @cached_property
    def axes(self) -> Array:
        """(n, 3, 3) axes of turns and shifts as columns: x, y, z, with the own axis in place of the nearest."""
        axes = np.zeros((len(self.bodies), 3, 3))
        for k, (screw, own) in enumerate(zip(self.screws, self.own, strict=True)):
            half, own_column = divmod(own, 3)  # half of the screw: angular for a joint that turns, else linear
            R = np.eye(3)
            R[:, own_column] = screw.reshape(2, 3)[half]
            for j in range(3):  # Gram-Schmidt: the own axis stays, the others become normal to it and to one another
                if j == own_column:
                    continue
                done = sorted({own_column, *range(j)})
                R[:, j] -= R[:, done] @ (R[:, done].T @ R[:, j])
                R[:, j] /= np.linalg.norm(R[:, j])
            axes[k] = R
        return axes

    @cached_property
    def start(self) -> Corrections:
        """No corrections."""
        n = len(self.bodies)
        end = np.asarray(self.robot.model.frame(self.frame).pose, float)
        return Corrections(np.zeros((n, 6)), np.zeros(n), np.zeros(n), end)

    def loads(self, q: Array) -> Array:
        """(N, n) torques that hold the joints at rest; zeros if none sags."""
        if "sag" not in self.assume:
            return np.zeros((len(q), len(self.bodies)))
        return np.asarray(self.robot.gravity_forces(q))[:, [self.robot.model.bodies[i].v_index for i in self.bodies]]

    @cached_property
    def loaded_joints(self) -> list[str]:
        """Joints that sag: those with a torque of gravity in some configuration, if sag is fitted."""
        q = self.robot.random_configuration(0, _RANDOM_CONFIGURATIONS)
        largest = np.abs(self.loads(q)).max(axis=0)
        return [joint for joint, load in zip(self.joints, largest, strict=True) if load > _ROUNDING * largest.max()]

    # ── Parameters: twists of the joints, gears, sags, twist of the tip

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters; the turn or slide about the own axis is called ``zero``."""
        names = list[str]()
        for joint, own in zip(self.joints, self.own, strict=True):
            words = [*ANGLES, *LENGTHS]
            words[own] = "zero"
            names += [f"{joint}.{word}" for word in words]
        for effect, word in (("gears", "gear"), ("sag", "sag")):
            if effect in self.assume:
                names += [f"{joint}.{word}" for joint in self.joints]
        return (*names, *(f"tip.{word}" for word in (*ANGLES, *LENGTHS)))

    @cached_property
    def are_lengths(self) -> Array:
        """True for parameters in m."""
        slide_zeros = set()
        for joint, turns in zip(self.joints, self.turning, strict=True):
            if not turns:
                slide_zeros.add(f"{joint}.zero")
        return np.array([name in slide_zeros or name.rpartition(".")[2] in LENGTHS for name in self.parameters])

    def scales(self, angle: float, length: float, gear: float, sag: float, tip: tuple[float, float]) -> Array:
        """A number for each parameter by its kind; ``tip`` are those of its angles and lengths."""
        sizes = np.where(self.are_lengths, length, angle)
        endings = np.array([name.rpartition(".")[2] for name in self.parameters])
        sizes[endings == "gear"] = gear
        sizes[endings == "sag"] = sag
        sizes[-6:] = np.repeat(tip, 3)
        return sizes

    def values(self, at: Corrections) -> Array:
        """Parameters (p,) of corrections; those of the tip are turn and shift from the file's pose."""
        parts = [at.displacements.ravel()]
        if "gears" in self.assume:
            parts.append(at.gears)
        if "sag" in self.assume:
            parts.append(at.sags)
        displacement = np.asarray(se3.inverse(self.start.tip)) @ at.tip
        return np.concatenate([*parts, np.asarray(so3.log(displacement[:3, :3])), displacement[:3, 3]])

    def corrections(self, values: Array) -> Corrections:
        """Corrections with the parameters (p,), as :meth:`values` returns them."""
        n = len(self.bodies)
        effects, gears, sags = values[6 * n : -6], np.zeros(n), np.zeros(n)
        if "gears" in self.assume:
            gears = effects[:n]
        if "sag" in self.assume:
            sags = effects[-n:]
        displacement = np.asarray(se3.pose(so3.exp(values[-6:-3]), values[-3:]))
        return Corrections(values[: 6 * n].reshape(n, 6), gears, sags, self.start.tip @ displacement)

    def step(self, at: Corrections, x: Array) -> Corrections:
        """Corrections after a step x (p,) of the parameters."""
        return self.corrections(self.values(at) + x)

    def bends(self, at: Corrections) -> Array:
        """(n, 4, 4) displacements D."""
        turns, shifts = self.turns_and_shifts(at)
        R = np.asarray(so3.exp(turns))
        return np.asarray(se3.pose(R, self.centres + shifts - np.einsum("kij,kj->ki", R, self.centres)))

    def turns_and_shifts(self, at: Corrections) -> tuple[Array, Array]:
        """(n, 3) turns w and (n, 3) shifts p in the axes of the frames."""
        turns, shifts = np.split(at.displacements, 2, axis=1)
        return np.einsum("kij,kj->ki", self.axes, turns), np.einsum("kij,kj->ki", self.axes, shifts)

    # ── Poses

    def poses(self, q: Array, loads: Array, at: Corrections) -> tuple[Array, Array]:
        """Poses (N, 4, 4) of the tip in the base, and twist columns (N, 6, p) of the parameters in the base frame."""
        yields = -loads  # derivative of each joint's position by its compliance
        positions = q[:, self.columns] * (1.0 + at.gears) + at.sags * yields
        moves = np.asarray(se3.exp(positions.T[..., None] * self.screws[:, None]))
        T, placed, displaced = np.tile(np.eye(4), (len(q), 1, 1)), list[Array](), list[Array]()
        for placement, displacement, move in zip(self.placements, self.placements @ self.bends(at), moves, strict=True):
            placed.append(T @ placement)
            displaced.append(T @ displacement)
            T = displaced[-1] @ move
        turns, shifts = self.turns_and_shifts(at)
        points = self.centres + shifts  # of the axes about which D_k turn, after their shifts
        twists = _displacement_columns(np.array(placed), points[:, None], turns[:, None], self.axes[:, None])
        parts = [np.moveaxis(twists, 0, 2).reshape(len(q), 6, 6 * len(self.bodies))]
        if self.assume:
            screws = np.moveaxis(Ad(np.array(displaced)) @ self.screws[:, None], 0, 2)
            if "gears" in self.assume:
                parts.append(screws * q[:, None, self.columns])
            if "sag" in self.assume:
                parts.append(screws * yields[:, None])
        displacement = np.asarray(se3.inverse(self.start.tip)) @ at.tip
        tip_turn = np.asarray(so3.log(displacement[:3, :3]))
        parts.append(_displacement_columns(T @ self.start.tip, displacement[:3, 3], tip_turn, np.eye(3)))
        return T @ at.tip, np.concatenate(parts, axis=2)

    def tips(self, q: Array, at: Corrections | None = None) -> Array:
        """Poses (N, 4, 4) of the tip alone."""
        if at is None:
            at = self.start
        return self.poses(q, self.loads(q), at)[0]

    def calibrated_robot(self, at: Corrections) -> Robot:
        """Robot whose placements and tip have the corrections; gears and sags are left out."""
        model = self.robot.model
        bodies, bends = list(model.bodies), self.bends(at)
        for k, i in enumerate(self.bodies):
            bodies[i] = replace(bodies[i], placement=bodies[i].placement @ bends[k])
        frames = dict(model.frames)
        # The frame of a moving link is that of its joint and has no pose of its own, so its displacement is left out.
        if self.frame != model.bodies[self.bodies[-1]].link:
            frames[self.frame] = replace(frames[self.frame], pose=at.tip)
        return Robot(replace(model, bodies=tuple(bodies), frames=frames))


def _displacement_columns(T: Array, point: Array, turn: Array, axes: Array) -> Array:
    """Twist columns (..., 6, 6) in the base of a turn w about a point and of its shift, in frames T (..., 4, 4) and ``axes``.

    The velocity of rotation is J(w) dw with the left Jacobian J.
    """
    R = T[..., :3, :3]
    angular = R @ (np.asarray(so3.left_jacobian(turn)) @ axes)
    columns = np.zeros((*T.shape[:-2], 6, 6))
    columns[..., :3, :3] = angular
    columns[..., 3:, :3] = so3.hat(T[..., :3, 3] + (R @ point[..., None])[..., 0]) @ angular  # [p] ω
    columns[..., 3:, 3:] = R @ axes
    return columns


def point_columns(T: Array, columns: Array) -> Array:
    """Velocities (N, 3, p) of the origins of T (N, 4, 4) for twists (N, 6, p) in the base frame: v - p × ω."""
    return np.asarray(columns[:, 3:] - so3.hat(T[:, :3, 3]) @ columns[:, :3])
