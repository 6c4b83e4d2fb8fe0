"""MuJoCo called from Python: contacts, constraints, limits and passive forces off, so that only the mechanics is left.

A floating base in MuJoCo has its linear velocity along world axes and the classical acceleration of its origin; the
check turns states and results into Pinocchio's, the timing does not charge for that.
"""

from collections.abc import Callable
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin

from bench.cases import Case, States
from bench.timing import Contender, calls

NAME = "MuJoCo, Python call"
OFF = (
    "ACTUATION",
    "CLAMPCTRL",
    "CONSTRAINT",
    "CONTACT",
    "DAMPER",
    "EQUALITY",
    "FRICTIONLOSS",
    "LIMIT",
    "SENSOR",
    "SPRING",
    "WARMSTART",
)


class MuJoCo:
    """One robot in MuJoCo."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.model = _model(case)
        self.data = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in case.moving]
        base_q = [0, 1, 2, 4, 5, 6, 3] if case.floating_base else []  # where (x, y, z, qx, qy, qz, qw) lie in qpos
        base_v = list(range(6)) if case.floating_base else []
        self.q_index = np.array([*base_q, *(int(j.qposadr[0]) for j in joints)])
        self.v_index = np.array([*base_v, *(int(j.dofadr[0]) for j in joints)])

    def evaluate(self, quantity: str, states: States) -> np.ndarray:
        function = self.function(quantity)
        rows = [np.array(function(*row)) for row in zip(*self.inputs(quantity, states), strict=True)]
        return np.array(
            [self.translate(quantity, row, dq, q) for row, dq, q in zip(rows, states.dq, states.q, strict=True)]
        )

    def contenders(self, quantity: str, states: States) -> list[Contender]:
        inputs = self.inputs(quantity, states[:256])
        return [calls(NAME, self.function(quantity), list(zip(*inputs, strict=True)))]

    def function(self, quantity: str) -> Callable[..., object]:
        """The shortest calls that set a state and leave the result in an array."""
        model, data = self.model, self.data
        qpos, qvel, qacc, force = data.qpos, data.qvel, data.qacc, data.qfrc_applied
        matrix, rows, forces = np.zeros((model.nv, model.nv)), np.zeros((6, model.nv)), np.zeros(model.nv)
        linear, angular, site = rows[:3], rows[3:], model.site("tip").id

        def inverse_dynamics(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> object:
            qpos[:], qvel[:], qacc[:] = q, dq, ddq
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, forces)  # with these calls a tenth to a quarter faster than mj_inverse
            return forces

        def mass_matrix(q: np.ndarray) -> object:
            qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)
            mujoco.mj_fullM(model, data, matrix)
            return matrix

        def forward_dynamics(q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> object:
            qpos[:], qvel[:], force[:] = q, dq, tau
            mujoco.mj_forward(model, data)
            return data.qacc

        def jacobian(q: np.ndarray) -> object:
            qpos[:] = q
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacSite(model, data, linear, angular, site)
            return rows

        def gravity_forces(q: np.ndarray) -> object:
            qpos[:], qvel[:] = q, 0.0
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 0, forces)
            return forces

        each = (inverse_dynamics, mass_matrix, forward_dynamics, jacobian, gravity_forces)
        return {function.__name__: function for function in each}[quantity]

    def inputs(self, quantity: str, states: States) -> tuple[np.ndarray, ...]:
        """The same states in MuJoCo's order and frames, forces included."""
        q = np.empty_like(states.q)
        q[:, self.q_index] = states.q
        turned = []
        for kind, values in zip(
            ("dq", "tau" if quantity == "forward_dynamics" else "ddq"), states.inputs(quantity)[1:], strict=False
        ):
            row = values.copy()
            if self.case.floating_base:
                if kind == "ddq":  # classical acceleration of the origin
                    row[:, :3] += np.cross(states.dq[:, 3:6], states.dq[:, :3])
                row[:, :3] = np.einsum("nij,nj->ni", _rotations(states.q), row[:, :3])
            ordered = np.empty_like(row)
            ordered[:, self.v_index] = row
            turned.append(ordered)
        return q, *turned

    def translate(self, quantity: str, values: np.ndarray, dq: np.ndarray, q: np.ndarray) -> np.ndarray:
        """One result, in Pinocchio's order and frames."""
        values = values[..., self.v_index]
        if quantity == "mass_matrix":
            values = values[self.v_index]
        turn = np.eye(len(dq))
        if self.case.floating_base:
            turn[:3, :3] = _rotations(q[None])[0]  # MuJoCo's dq = turn @ Pinocchio's dq
        if quantity == "mass_matrix":
            return turn.T @ values @ turn
        if quantity == "jacobian":  # from world axes to the frame's own
            tip = np.kron(np.eye(2), self.data_tip(q).T)
            return tip @ values @ turn
        values = turn.T @ values
        if quantity == "forward_dynamics" and self.case.floating_base:
            values[:3] -= np.cross(dq[3:6], dq[:3])
        return values

    def data_tip(self, q: np.ndarray) -> np.ndarray:
        """The tip's axes at q."""
        self.data.qpos[self.q_index] = q
        mujoco.mj_kinematics(self.model, self.data)
        return np.array(self.data.site("tip").xmat).reshape(3, 3)


def _rotations(q: np.ndarray) -> np.ndarray:
    return np.array([pin.Quaternion(row[3:7]).toRotationMatrix() for row in q])


def _model(case: Case) -> mujoco.MjModel:
    model = spec_of(case).compile()
    switch_off(model)
    return model


def switch_off(model: mujoco.MjModel, but: set[str] = frozenset()) -> None:
    """Leave only the mechanics, and what is named."""
    for name in OFF:
        if name not in but:
            model.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}").value


def spec_of(case: Case) -> mujoco.MjSpec:
    """The robot as MuJoCo reads it, before it is compiled."""
    root = ElementTree.fromstring(case.text)
    if case.floating_base:
        children = {child.get("link") for child in root.iter("child")}
        base = next(name for link in root.findall("link") if (name := link.attrib["name"]) not in children)
        ElementTree.SubElement(root, "link", name="the_world")
        free = ElementTree.SubElement(root, "joint", name="the_free_joint", type="floating")
        ElementTree.SubElement(free, "parent", link="the_world")
        ElementTree.SubElement(free, "child", link=base)
    options = ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler")
    options.set("fusestatic", "true")
    options.set("balanceinertia", "true")  # it refuses some bodies of Talos otherwise
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    frame = case.model.frames[case.model.getFrameId(case.tip, pin.BODY)]
    x, y, z, w = pin.Quaternion(frame.placement.rotation).coeffs()
    carrier = spec.joint(case.model.names[frame.parentJoint]).parent
    carrier.add_site(name="tip", pos=frame.placement.translation, quat=[w, x, y, z])
    return spec
