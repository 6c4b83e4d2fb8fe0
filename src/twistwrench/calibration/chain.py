"""Chain from the base to the tip, corrected by a small twist at each joint: poses of the tip, and their derivatives.

With the placement P_k of joint k in its parent's moving link and its screw S_k in its own frame,

    T_n = Π_k P_k D_k e^[S_k] (q_k (1 + g_k) - c_k τ_k(q)),   tip = T_n E D

(local product of exponentials; Lynch and Park, Modern Robotics, 4.1, and Wu et al., IEEE T-ASE 12(2), 2015).

- D_k is a turn w_k about a point of the joint's axis, followed by a shift p_k, both in the axes that the joint's frame has in
  the file. So an offset of the joint's zero, however large, changes w_k alone, and does not turn the direction of p_k.
- g_k is the error of the gear, and c_k the compliance of the joint under the torque τ_k that holds it.
- E is the pose of the tip in the last moving link in the file, and D its displacement: a turn about the tip and a shift, in
  the tip's axes.
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
"""Number of configurations in which torques of gravity are compared."""
_MIN_LOAD_SHARE = 1e-9
"""Torque of gravity, as a share of the largest joint's, up to which it is a rounding error."""
ANGLES = ("rx", "ry", "rz")
"""Endings of the names of parameters that are turns."""
LENGTHS = ("x", "y", "z")
"""Endings of the names of parameters that are shifts."""


@dataclass(frozen=True, eq=False)
class Corrections:
    """Corrections of the n joints of a chain, with turns and shifts along :attr:`TipChain.axes`, and of its tip."""

    displacements: Array
    """(n, 6) turns w [rad] and shifts p [m]."""
    gears: Array
    """(n,) errors of gears, as shares of the joint's motion."""
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
    """Indices of the bodies on the way, from the base."""
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
        bodies = list[int]()
        i = model.frame(frame).body
        while i != BASE:
            bodies.insert(0, i)
            i = model.bodies[i].parent
        if not bodies:
            raise ModelError(f"no joint moves the frame {frame!r}, so there is nothing to calibrate. Give another tip.")
        for i in bodies:
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
        return cls(robot, frame, tuple(bodies), tuple(name for name in EFFECTS if name in assume))

    @property
    def moves_tip(self) -> bool:
        """True if a robot's file can move the tip alone; False if the tip is a link's own frame, which moves with its joint."""
        return self.frame != self.robot.model.bodies[self.bodies[-1]].link

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
        """(n,) True for joints that turn, False for joints that slide."""
        return [bool(self.robot.model.bodies[i].joint.turning[0]) for i in self.bodies]

    @cached_property
    def placements(self) -> Array:
        """(n, 4, 4) placements P."""
        return np.array([self.robot.model.bodies[i].placement for i in self.bodies])

    @cached_property
    def screws(self) -> Array:
        """(n, 6) screws S of the joints, each in its own frame."""
        return np.array([self.robot.model.bodies[i].joint.axes[0] for i in self.bodies], float)

    @cached_property
    def centres(self) -> Array:
        """(n, 3) points of turning axes nearest to the origins of their frames; zeros for sliding joints."""
        return np.cross(self.screws[:, :3], self.screws[:, 3:])

    @cached_property
    def own(self) -> list[int]:
        """Index, 0 to 5, of the largest entry of each screw: which of rx, ry, rz, x, y, z is nearest to the joint's motion."""
        return [int(entry) for entry in np.abs(self.screws).argmax(axis=1)]

    @cached_property
    def axes(self) -> Array:
        """(n, 3, 3) axes of turns and shifts, as columns: x, y and z, the nearest of which is replaced by the joint's axis."""
        axes = np.zeros((len(self.bodies), 3, 3))
        for k, screw in enumerate(self.screws):
            own_entry = self.own[k]
            half, own_column = divmod(own_entry, 3)  # half 0 of the screw is angular, half 1 linear
            R = np.eye(3)
            R[:, own_column] = screw.reshape(2, 3)[half]
            for j in range(3):  # Gram-Schmidt: the own axis stays, the others become normal to it and to one another
                if j == own_column:
                    continue
                final_columns = sorted({own_column, *range(j)})
                R[:, j] -= R[:, final_columns] @ (R[:, final_columns].T @ R[:, j])
                R[:, j] /= np.linalg.norm(R[:, j])
            axes[k] = R
        return axes

    @cached_property
    def start(self) -> Corrections:
        """Corrections of zero; the tip as in the file."""
        n = len(self.bodies)
        tip_pose = np.asarray(self.robot.model.frame(self.frame).pose, float)
        return Corrections(np.zeros((n, 6)), np.zeros(n), np.zeros(n), tip_pose)

    def loads(self, q: Array) -> Array:
        """(N, n) torques that hold the joints at rest in configurations q (N, nq); zeros if sag is not fitted."""
        if "sag" not in self.assume:
            return np.zeros((len(q), len(self.bodies)))
        velocity_columns = [self.robot.model.bodies[i].v_index for i in self.bodies]
        return np.asarray(self.robot.gravity_forces(q))[:, velocity_columns]

    @cached_property
    def loaded_joints(self) -> list[str]:
        """Joints that sag: those that gravity loads in some configuration; empty if sag is not fitted."""
        q = self.robot.random_configuration(0, _RANDOM_CONFIGURATIONS)
        largest_loads = np.abs(self.loads(q)).max(axis=0)
        min_load = _MIN_LOAD_SHARE * largest_loads.max()
        return [joint for joint, load in zip(self.joints, largest_loads, strict=True) if load > min_load]

    # ── Parameters: twists of the joints, gears, sags, twist of the tip

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters; the turn or slide about the own axis is called ``zero``."""
        names = list[str]()
        for joint, own_entry in zip(self.joints, self.own, strict=True):
            endings = [*ANGLES, *LENGTHS]
            endings[own_entry] = "zero"
            names += [f"{joint}.{ending}" for ending in endings]
        for effect, ending in (("gears", "gear"), ("sag", "sag")):
            if effect in self.assume:
                names += [f"{joint}.{ending}" for joint in self.joints]
        names += [f"tip.{ending}" for ending in (*ANGLES, *LENGTHS)]
        return tuple(names)

    @cached_property
    def are_lengths(self) -> Array:
        """(p,) True for parameters in m: shifts, and zeros of joints that slide."""
        zeros_of_sliding = set()
        for joint, turns in zip(self.joints, self.turning, strict=True):
            if not turns:
                zeros_of_sliding.add(f"{joint}.zero")
        is_length = []
        for name in self.parameters:
            _, _, ending = name.rpartition(".")
            is_length.append(ending in LENGTHS or name in zeros_of_sliding)
        return np.array(is_length)

    def scales(self, angle: float, length: float, gear: float, sag: float, tip: tuple[float, float]) -> Array:
        """Numbers (p,) of the parameters, from a number for each kind; ``tip`` has the numbers of its angles and lengths."""
        scales = np.where(self.are_lengths, length, angle)
        endings = np.array([name.rpartition(".")[2] for name in self.parameters])
        scales[endings == "gear"] = gear
        scales[endings == "sag"] = sag
        scales[-6:] = np.repeat(tip, 3)  # the tip's parameters come last
        return scales

    def values(self, at: Corrections) -> Array:
        """Parameters (p,) of corrections, in the order of :attr:`parameters`."""
        values = [at.displacements.ravel()]
        if "gears" in self.assume:
            values.append(at.gears)
        if "sag" in self.assume:
            values.append(at.sags)
        tip_displacement = np.asarray(se3.inverse(self.start.tip)) @ at.tip
        tip_turn = np.asarray(so3.log(tip_displacement[:3, :3]))
        return np.concatenate([*values, tip_turn, tip_displacement[:3, 3]])

    def corrections(self, values: Array) -> Corrections:
        """Corrections with the parameters (p,), as :meth:`values` returns them."""
        n = len(self.bodies)
        displacements, effects, tip_values = np.split(values, [6 * n, len(values) - 6])
        gears = np.zeros(n)
        sags = np.zeros(n)
        if "gears" in self.assume:
            gears = effects[:n]  # first, if both are fitted
        if "sag" in self.assume:
            sags = effects[-n:]
        tip_displacement = np.asarray(se3.pose(so3.exp(tip_values[:3]), tip_values[3:]))
        return Corrections(displacements.reshape(n, 6), gears, sags, self.start.tip @ tip_displacement)

    def step(self, at: Corrections, x: Array) -> Corrections:
        """Corrections after a step x (p,) of the parameters."""
        return self.corrections(self.values(at) + x)

    def bends(self, at: Corrections) -> Array:
        """(n, 4, 4) displacements D: a turn R about the centre c, then a shift p; a point x moves to R (x - c) + c + p."""
        turns, shifts = self.turns_and_shifts(at)
        R = np.asarray(so3.exp(turns))
        rotated_centres = np.einsum("kij,kj->ki", R, self.centres)
        return np.asarray(se3.pose(R, self.centres + shifts - rotated_centres))

    def turns_and_shifts(self, at: Corrections) -> tuple[Array, Array]:
        """(n, 3) turns w and (n, 3) shifts p in the axes of the joints' frames."""
        turns_along_axes, shifts_along_axes = np.split(at.displacements, 2, axis=1)
        turns = np.einsum("kij,kj->ki", self.axes, turns_along_axes)
        shifts = np.einsum("kij,kj->ki", self.axes, shifts_along_axes)
        return turns, shifts

    # ── Poses

    def poses(self, q: Array, loads: Array, at: Corrections) -> tuple[Array, Array]:
        """Poses (N, 4, 4) of the tip in the base, and twist columns (N, 6, p) of the parameters in the base frame."""
        slopes_by_compliance = -loads  # of the joints' positions
        positions = q[:, self.columns] * (1.0 + at.gears) + at.sags * slopes_by_compliance
        motions = np.asarray(se3.exp(positions.T[..., None] * self.screws[:, None]))  # (n, N, 4, 4)
        T = np.tile(np.eye(4), (len(q), 1, 1))  # from the base to the last moving link so far
        file_poses = list[Array]()  # of each joint's frame, without its own displacement
        joint_poses = list[Array]()  # with it
        for placement, displacement, motion in zip(self.placements, self.bends(at), motions, strict=True):
            file_poses.append(T @ placement)
            joint_poses.append(T @ (placement @ displacement))
            T = joint_poses[-1] @ motion  # of the joint's moving link
        turns, shifts = self.turns_and_shifts(at)
        points = self.centres + shifts  # of the axes about which D_k turn, after their shifts
        twists = _displacement_columns(np.array(file_poses), points[:, None], turns[:, None], self.axes[:, None])
        columns = [np.moveaxis(twists, 0, 2).reshape(len(q), 6, 6 * len(self.bodies))]
        if self.assume:
            screws_in_base = Ad(np.array(joint_poses)) @ self.screws[:, None]
            screws = np.moveaxis(screws_in_base, 0, 2)
            if "gears" in self.assume:
                columns.append(screws * q[:, None, self.columns])
            if "sag" in self.assume:
                columns.append(screws * slopes_by_compliance[:, None])
        tip_displacement = np.asarray(se3.inverse(self.start.tip)) @ at.tip
        tip_turn = np.asarray(so3.log(tip_displacement[:3, :3]))
        columns.append(_displacement_columns(T @ self.start.tip, tip_displacement[:3, 3], tip_turn, np.eye(3)))
        return T @ at.tip, np.concatenate(columns, axis=2)

    def tips(self, q: Array, at: Corrections | None = None) -> Array:
        """Poses (N, 4, 4) of the tip, by default with corrections of zero."""
        if at is None:
            at = self.start
        tip_poses, _ = self.poses(q, self.loads(q), at)
        return tip_poses

    def calibrated_robot(self, at: Corrections) -> Robot:
        """Robot with corrected placements, and with the corrected tip if a file can move it; gears and sags are left out."""
        model = self.robot.model
        bodies = list(model.bodies)
        displacements = self.bends(at)
        for k, i in enumerate(self.bodies):
            bodies[i] = replace(bodies[i], placement=bodies[i].placement @ displacements[k])
        frames = dict(model.frames)
        if self.moves_tip:
            frames[self.frame] = replace(frames[self.frame], pose=at.tip)
        return Robot(replace(model, bodies=tuple(bodies), frames=frames))


def _displacement_columns(T: Array, point: Array, turn: Array, axes: Array) -> Array:
    """Twist columns (..., 6, 6) in the base frame: three for changes of a turn w about a point, three for its shift.

    ``point`` (..., 3) and ``turn`` w (..., 3) are in a frame whose poses are T (..., 4, 4). Both change along the columns of
    ``axes`` (..., 3, 3). The angular velocity of a changing w is J(w) dw with the left Jacobian J.
    """
    R = T[..., :3, :3]
    angular = R @ (np.asarray(so3.left_jacobian(turn)) @ axes)
    rotated_point = R @ point[..., None]
    p = T[..., :3, 3] + rotated_point[..., 0]  # the point in the base frame
    columns = np.zeros((*T.shape[:-2], 6, 6))
    columns[..., :3, :3] = angular
    columns[..., 3:, :3] = so3.hat(p) @ angular  # [p] ω
    columns[..., 3:, 3:] = R @ axes
    return columns


def point_columns(T: Array, columns: Array) -> Array:
    """Velocities (N, 3, p) of the origins of T (N, 4, 4) for twists (N, 6, p) in the base frame: v - p × ω."""
    return np.asarray(columns[:, 3:] - so3.hat(T[:, :3, 3]) @ columns[:, :3])
