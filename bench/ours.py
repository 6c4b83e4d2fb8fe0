"""twistwrench, behind the same small face as its peers."""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import twistwrench as tw
from bench.cases import MATRICES, Case, States
from bench.timing import Contender, calls
from twistwrench.robot.kernels.options import checked_options
from twistwrench.robot.programs import program_of

KERNEL, METHOD = "twistwrench kernel", "twistwrench method"


def load(case: Case, **options: Any) -> tw.Robot:
    """The robot, from its file, as a user would."""
    locked = dict.fromkeys(case.locked, 0.0)
    options = {"inertia": "accept", "mimic": "independent", **options}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        return tw.load(case.path, floating_base=case.floating_base, lock=locked, **options)


def kernel(robot: tw.Robot, case: Case, quantity: str) -> np.ufunc:
    """The bare compiled function."""
    return robot.kernel(quantity, **_frame(case, quantity))


def _frame(case: Case, quantity: str) -> dict[str, Any]:
    return {"frame": case.tip, "kind": "body"} if quantity == "jacobian" else {}


class Ours:
    """One robot in twistwrench."""

    def __init__(self, case: Case, **options: Any) -> None:
        self.case = case
        self.robot = load(case, **options)
        model = case.model
        names = [name for name in self.robot.joint_names if name in case.moving]
        ids = [model.getJointId(name) for name in names]
        # (qw, qx, qy, qz, x, y, z) from (x, y, z, qx, qy, qz, qw), and (omega, v) from (v, omega)
        base_q = [6, 3, 4, 5, 0, 1, 2] if case.floating_base else []
        base_v = [3, 4, 5, 0, 1, 2] if case.floating_base else []
        self.q_index = np.array([*base_q, *(model.idx_qs[i] for i in ids)])
        self.v_index = np.array([*base_v, *(model.idx_vs[i] for i in ids)])

    def inputs(self, quantity: str, states: States) -> tuple[np.ndarray, ...]:
        """The same states in the order of `robot.coordinate_names`, plain C-contiguous rows."""
        q, *more = states.inputs(quantity)
        return q[:, self.q_index].copy(), *(each[:, self.v_index].copy() for each in more)

    def method(self, quantity: str) -> Callable[..., np.ndarray]:
        if quantity == "jacobian":
            return partial(self.robot.jacobian, frame=self.case.tip)
        return getattr(self.robot, quantity)

    def evaluate(self, quantity: str, states: States) -> np.ndarray:
        """One batch through the method, in Pinocchio's order."""
        back = np.argsort(self.v_index)
        values = self.method(quantity)(*self.inputs(quantity, states))
        values = np.stack(values, axis=1) if isinstance(values, tuple) else values
        values = values[..., back]
        if quantity in MATRICES:
            values = values[..., back, :]
        return values[:, [3, 4, 5, 0, 1, 2]] if quantity == "jacobian" else values

    def contenders(self, quantity: str, states: States) -> list[Contender]:
        method, bare = self.method(quantity), kernel(self.robot, self.case, quantity)
        few = list(zip(*self.inputs(quantity, states[:256]), strict=True))
        shapes = [np.shape(each) for each in _tuple(method(*few[0]))]
        out = [np.empty(shape) for shape in shapes]
        for row in few:
            method(*row)
        often = self.method(quantity)  # what `robot.inverse_dynamics` is after some calls: a builtin
        found = [
            calls(f"{KERNEL}, one state", bare, [(*row, *out) for row in few]),
            calls(f"{METHOD}, one state", often, few),
        ]
        for size in sorted({self.case.batch, len(states)}):
            arrays = self.inputs(quantity, states[:size])
            results = [np.empty((size, *shape)) for shape in shapes]
            found += [Contender(f"{KERNEL}, batch of {size}, out=", repeat(bare, (*arrays, *results)), size)]
            found += [Contender(f"{METHOD}, batch of {size}", repeat(method, arrays), size)]
            if quantity in MATRICES:
                given = partial(method, out=tuple(results) if len(results) > 1 else results[0])
                found += [Contender(f"{METHOD}, batch of {size}, out=", repeat(given, arrays), size)]
        return found

    def operations(self, quantity: str) -> dict[str, int]:
        """How many operations of each kind one state takes, and two sums of them."""
        program = self.robot.program(quantity, **_frame(self.case, quantity))
        options = checked_options(self.robot.model, quantity, _frame(self.case, quantity))
        before = program_of(self.robot.model, quantity, options, regroup=False)
        sums = {"multiplications": program.multiplications, "flops": program.flops}
        return {**program.counts(), **sums, "flops before regrouping": before.flops}


def _tuple(results: Any) -> tuple[Any, ...]:
    return results if isinstance(results, tuple) else (results,)


def repeat(function: Callable[..., object], arrays: tuple[np.ndarray, ...]) -> Callable[[int], None]:
    """A sweep of calls with the same arrays."""

    def sweep(times: int) -> None:
        for _ in range(times):
            function(*arrays)

    return sweep
