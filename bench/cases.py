"""What is timed: three robots, seven quantities, and random states. Everything here is in Pinocchio's order and signs.

Pinocchio's order: joints of one parent alphabetically; a floating base is q = (x, y, z, qx, qy, qz, qw),
dq = (v, omega); twists and wrenches have the linear part first.
"""

from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import distribution
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

QUANTITIES = ("inverse_dynamics", "mass_matrix", "forward_dynamics", "jacobian", "gravity_forces")
DERIVATIVES = ("inverse_dynamics_derivatives", "forward_dynamics_derivatives")
"""By q and dq, and of forward dynamics by tau as well; by q along the base's own axes."""
COMPARED = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "gravity_forces", *DERIVATIVES)
"""The quantities whose speed, bounds and compile time are said together."""
MATRICES = {"mass_matrix": 1, "inverse_dynamics_derivatives": 2, "forward_dynamics_derivatives": 3}
"""How many square matrices, a row and a column for each velocity, these results are."""


@dataclass(frozen=True)
class Case:
    """A robot file of the `example-robot-data` package, and how it is used."""

    name: str
    file: str
    tip: str
    batch: int  # the batch that the headline is about
    floating_base: bool = False
    locked: tuple[str, ...] = ()  # joints held at zero
    title: str = field(default="", compare=False)

    @cached_property
    def path(self) -> Path:
        robots = distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data/robots")
        return Path(str(robots)) / self.file

    @cached_property
    def text(self) -> str:
        """The same file without meshes (MuJoCo would open them), its locked joints made fixed joints."""
        root = ElementTree.parse(self.path).getroot()
        for link in root.iter("link"):
            for geometry in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(geometry)
        for joint in root.findall("joint"):
            if joint.get("name") in self.locked:
                joint.set("type", "fixed")
                for element in [e for e in joint if e.tag not in ("origin", "parent", "child")]:
                    joint.remove(element)
        return ElementTree.tostring(root, encoding="unicode")

    @cached_property
    def model(self) -> pin.Model:
        """Pinocchio's model: it sets the order in which every contender's results are compared."""
        if self.floating_base:
            return pin.buildModelFromXML(self.text, pin.JointModelFreeFlyer())
        return pin.buildModelFromXML(self.text)

    @property
    def moving(self) -> list[str]:
        """The joints of one degree, in Pinocchio's order."""
        return [n for n, nv in zip(self.model.names, self.model.nvs, strict=True) if nv == 1]


CASES = (
    Case("ur5", "ur_description/urdf/ur5_robot.urdf", "tool0", 4096, title="UR5, 6 joints"),
    Case(
        "panda",
        "panda_description/urdf/panda.urdf",
        "panda_hand_tcp",
        4096,
        locked=("panda_finger_joint1", "panda_finger_joint2"),
        title="Panda, 7 joints, hand attached, fingers locked",
    ),
    Case(
        "talos",
        "talos_data/robots/talos_reduced.urdf",
        "gripper_left_base_link",
        512,
        floating_base=True,
        title="Talos, floating base and 32 joints: 38 velocities",
    ),
)


@dataclass(frozen=True)
class States:
    """Random states, one per row, C-contiguous, in Pinocchio's order."""

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    tau: np.ndarray

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice) -> "States":
        return States(self.q[rows], self.dq[rows], self.ddq[rows], self.tau[rows])

    @classmethod
    def random(cls, case: Case, size: int, seed: int = 8) -> "States":
        """Angles within the limits (or within pi), a base anywhere within a metre and any way up, the rest N(0, 1)."""
        rng = np.random.default_rng(seed)
        model = case.model
        lower = np.maximum(model.lowerPositionLimit, -np.pi)
        upper = np.minimum(model.upperPositionLimit, np.pi)
        q = rng.uniform(lower, upper, (size, model.nq))
        if case.floating_base:
            quaternion = rng.normal(size=(size, 4))
            q[:, :3] = rng.uniform(-1, 1, (size, 3))
            q[:, 3:7] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
        return cls(q, *rng.normal(size=(3, size, model.nv)))

    def inputs(self, quantity: str) -> tuple[np.ndarray, ...]:
        """What a quantity is a function of."""
        return {
            "inverse_dynamics": (self.q, self.dq, self.ddq),
            "forward_dynamics": (self.q, self.dq, self.tau),
        }.get(quantity.removesuffix("_derivatives"), (self.q,))


def difference(values: np.ndarray, reference: np.ndarray) -> float:
    """The largest relative difference: per state the largest entry of |values - reference| over that of |reference|.

    Where a result is several matrices (N, k, rows, columns), each is taken by itself.
    """
    return float(np.max(differences(values, reference)))


def differences(values: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """The same for each state, and each matrix."""
    axes = tuple(range(max(1, reference.ndim - 2), reference.ndim))
    return np.abs(values - reference).max(axes) / np.abs(reference).max(axes)
