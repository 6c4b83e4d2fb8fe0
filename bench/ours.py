"""twistwrench, behind the same small face as its peers."""

from collections.abc import Callable

import numpy as np
import twistwrench as tw

from bench.cases import Case, States
from bench.timing import Contender, calls

KERNEL, CALL, BATCH = "twistwrench kernel, one state", "twistwrench method, one state", "twistwrench method, batch of {}"


class Ours:
    """One robot, loaded from its file as a user would."""

    def __init__(self, case: Case, **options: object) -> None:
        self.case = case
        locked = dict.fromkeys(case.locked, 0.0)
        self.robot = tw.load(
            case.path, floating_base=case.floating_base, lock=locked, inertia="accept", mimic="independent", **options
        )
        model = case.model
        names = [name for name in self.robot.joint_names if name in case.moving]
        ids = [model.getJointId(name) for name in names]
        base_q = [6, 3, 4, 5, 0, 1, 2] if case.floating_base else []  # (qw, qx, qy, qz, x, y, z) from (x, y, z, qx, qy, qz, qw)
        base_v = [3, 4, 5, 0, 1, 2] if case.floating_base else []  # (omega, v) from (v, omega)
        self.q_index = np.array([*base_q, *(model.idx_qs[i] for i in ids)])
        self.v_index = np.array([*base_v, *(model.idx_vs[i] for i in ids)])

    def inputs(self, quantity: str, states: States) -> tuple[np.ndarray, ...]:
        """The same states in the order of `robot.coordinate_names`, plain C-contiguous rows."""
        q, *more = states.inputs(quantity)
        return q[:, self.q_index].copy(), *(each[:, self.v_index].copy() for each in more)

    def method(self, quantity: str) -> Callable[..., np.ndarray]:
        if quantity == "jacobian":
            return lambda q, **out: self.robot.jacobian(q, self.case.tip, **out)
        return getattr(self.robot, quantity)

    def kernel(self, quantity: str) -> np.ufunc:
        frame = {"frame": self.case.tip, "kind": "body"} if quantity == "jacobian" else {}
        return self.robot.kernel(quantity, **frame)

    def evaluate(self, quantity: str, states: States) -> np.ndarray:
        """One batch through the method, in Pinocchio's order."""
        back = np.argsort(self.v_index)
        values = self.method(quantity)(*self.inputs(quantity, states))[..., back]
        if quantity == "mass_matrix":
            values = values[:, back]
        return values[:, [3, 4, 5, 0, 1, 2]] if quantity == "jacobian" else values

    def contenders(self, quantity: str, states: States) -> list[Contender]:
        method, kernel = self.method(quantity), self.kernel(quantity)
        few = list(zip(*self.inputs(quantity, states[:256]), strict=True))
        out = np.empty(np.shape(method(*few[0])))
        found = [calls(KERNEL, kernel, [(*row, out) for row in few]), calls(CALL, method, few)]
        for size in sorted({self.case.batch, len(states)}):
            arrays = self.inputs(quantity, states[:size])
            name = BATCH.format(size)
            found += [Contender(name, _repeat(method, arrays, {}), size)]
            found += [Contender(f"{name}, out=", _repeat(method, arrays, {"out": np.empty((size, *out.shape))}), size)]
        return found

    def operations(self, quantity: str) -> tuple[dict[str, int], int]:
        """How many operations of each kind the program holds, and its floating-point operations together."""
        frame = {"frame": self.case.tip, "kind": "body"} if quantity == "jacobian" else {}
        program = self.robot.program(quantity, **frame)
        return dict(program.counts()), int(program.flops)


def _repeat(method: Callable[..., np.ndarray], arrays: tuple[np.ndarray, ...], out: dict[str, np.ndarray]) -> Callable[[int], None]:
    def sweep(times: int) -> None:
        for _ in range(times):
            method(*arrays, **out)

    return sweep
