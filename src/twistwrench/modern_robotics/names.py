"""Rows of the book's names, the checks of their arguments, and chains of the book's lists.

A row is the declaration of a function, with its arguments in the book's order and their types, under a decorator that has what
evaluates it, the equation, and the result::

    @named(so3.hat, "eq. 3.30", "so3mat : (..., 3, 3) array", real(3))
    def VecToso3(omg: ArrayLike) -> Array:
        \"\"\"Skew-symmetric matrix [omg] of a vector.\"\"\"

:func:`named` is for functions of arrays, :func:`of_chain` for quantities of the chain that the lists among the arguments
describe. Type checkers see the declaration; ``help`` shows its sentence with the equation, and sections from the glossary.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.errors import ShapeError, ValueRangeError
from ..core.glossary import RETURNS
from ..core.typing import Array
from ..mechanics.lie import se3, so3
from ..robot import Robot, from_screws

Declared = TypeVar("Declared", bound=Callable[..., Any])
Check = Callable[[Any, str], Array]

# ── Rows


def named(target: Callable[..., Any], equation: str, result: str, *checks: Check) -> Callable[[Declared], Declared]:
    """Row of a function of arrays: ``target`` of the checked arguments."""

    def decorate(declared: Declared) -> Declared:
        labels = [f"{declared.__name__}: {name}" for name in inspect.signature(declared).parameters]
        check, label = checks[0], labels[0]

        def of_one(given: tuple[Any, ...]) -> Any:  # the usual case by itself: a loop would double the time of a call
            return target(check(given[0], label))

        def of_several(given: tuple[Any, ...]) -> Any:
            return target(*map(lambda check, x, label: check(x, label), checks, given, labels))

        return _built_from(declared, of_one if len(checks) == 1 else of_several, equation, result)

    return decorate


def of_chain(quantity: str, equation: str, result: str) -> Callable[[Declared], Declared]:
    """Row of a quantity of the chain of (Mlist, Glist, Slist), or of screws alone; its kernel takes gravity last."""

    def decorate(declared: Declared) -> Declared:
        names = [*inspect.signature(declared).parameters]
        whole = names[-3:] == ["Mlist", "Glist", "Slist"]
        inputs = [(name, place) for place, name in enumerate(names) if name not in LISTS]
        inputs.sort(key=lambda one: one[0] == "g")

        def evaluate(given: tuple[Any, ...]) -> Array:
            chain = chain_of(*given[-3:]) if whole else screws_of(given[0], names[0])
            return chain.run(quantity, **{name: chain.checked(given[place], name) for name, place in inputs})

        return _built_from(declared, evaluate, equation, result)

    return decorate


def _built_from(declared: Declared, evaluate: Callable[[tuple[Any, ...]], Any], equation: str, result: str) -> Declared:
    """Function with the name and signature of a declaration, and with a docstring of its sentence, equation and result."""
    signature = inspect.signature(declared)
    count = len(signature.parameters)

    @wraps(declared)
    def function(*given: Any, **by_name: Any) -> Any:
        if by_name or len(given) != count:
            given = signature.bind(*given, **by_name).args
        return evaluate(given)

    returns = result or RETURNS[declared.__annotations__["return"]]
    function.__doc__ = f"{(declared.__doc__ or '').rstrip('.')} (MR {equation}).\n\nReturns\n-------\n{returns}\n"
    return function  # type: ignore[return-value]


# ── Checks of arrays, with errors that name the argument

MAX_ROUNDING = 0.01
"""Largest deviation of an entry from the nearest rotation; rotations rounded to two digits are accepted."""


def real(*shape: int) -> Check:
    """Check of real numbers with last axes of a shape."""
    return lambda x, name: arguments.real(x, name, *shape)


def rotation(R: ArrayLike, name: str) -> Array:
    """Check R (..., 3, 3): a rotation to 1e-6 is unchanged, a more coarsely rounded one becomes the nearest rotation."""
    return _nearest(arguments.real(R, name, 3, 3), name, arguments.rotation, so3.project)


def pose(T: ArrayLike, name: str) -> Array:
    """Check T (..., 4, 4), with its rotation treated as in :func:`rotation`."""
    return _nearest(arguments.real(T, name, 4, 4), name, arguments.pose, se3.project)


def _nearest(
    X: Array, name: str, judged: Callable[[Array, str], Array], project: Callable[[Array, float], Array]
) -> Array:
    try:
        return judged(X, name)
    except ValueRangeError:
        try:
            return project(X, MAX_ROUNDING)
        except ValueRangeError as problem:
            reason = str(problem).partition(".project: ")[2] or str(problem)
            raise ValueRangeError(f"{name}: {reason} mr.ProjectToSO3 and mr.ProjectToSE3 take any.") from None


def skew(W: ArrayLike, name: str) -> Array:
    """Check W (..., 3, 3): W + W' must be zero to a hundredth of its largest entry, for rounded input."""
    W = arguments.real(W, name, 3, 3)
    if W.ndim == 2:
        (a, b, c), (d, e, f), (g, h, i) = W.tolist()
        if a == e == i == b + d == c + g == f + h == 0.0:
            return W
    with np.errstate(all="ignore"):
        off = np.abs(W + np.swapaxes(W, -1, -2))
        largest = np.maximum(arguments.TOLERANCE / MAX_ROUNDING, np.abs(W).max(axis=(-2, -1), keepdims=True))
    arguments.refuse(
        off / largest,
        MAX_ROUNDING,
        f"{name} is not skew-symmetric: with its transpose added it is {{gap}} of its largest entry, allowed "
        "{allowed}; mr.VecToso3 and mr.VecTose3 make such matrices of vectors, mr.MatrixLog3 and mr.MatrixLog6 of rotations "
        "and poses",
    )
    return W


def twist_matrix(X: ArrayLike, name: str) -> Array:
    """Check X (..., 4, 4) of a twist: a skew-symmetric upper left block and a last row of zeros."""
    X = arguments.real(X, name, 4, 4)
    skew(X[..., :3, :3], name)
    if X.ndim != 2 or X[3].tolist() != [0.0, 0.0, 0.0, 0.0]:
        complaint = f"{name} has no last row of zeros: an entry is {{gap}} off, allowed {{allowed}}"
        arguments.refuse(np.abs(X[..., 3:, :]), arguments.TOLERANCE, complaint)
    return X


# ── Chains of the book's lists, with kernels cached by the content of the lists

# ``thetalist``, ``dthetalist`` … are (..., n); ``g`` (..., 3) m/s² in the space frame; ``Ftip`` (..., 6) the wrench applied
# by the robot, in the end-effector frame {n+1}; ``Mlist`` (n + 1, 4, 4); ``Glist`` (n, 6, 6); ``Slist`` (6, n).

MAX_CACHED_CHAINS = 64
"""Maximum number of cached sets of lists (least recently used are dropped). Machine code remains cached on disk."""
LISTS = ("Mlist", "Glist", "Slist", "Blist")
SIZES = {"g": 3, "Ftip": 6}
"""Numbers of an input that is not one per joint."""
_AT_TIP: dict[str, Any] = {"gravity": "input", "wrenches": True}
_KERNELS: dict[str, tuple[str, dict[str, Any]]] = {
    "pose": ("forward_kinematics", {}),
    "space_jacobian": ("jacobian", {"kind": "space"}),
    "body_jacobian": ("jacobian", {"kind": "body"}),
    "inverse_dynamics": ("inverse_dynamics", _AT_TIP),
    "forward_dynamics": ("forward_dynamics", _AT_TIP),
    "mass_matrix": ("mass_matrix", {}),
    "coriolis_forces": ("coriolis_forces", {}),
    "gravity_forces": ("gravity_forces", {"gravity": "input"}),
    "wrench_torques": ("wrench_torques", {}),
}
"""Quantities of a chain with their options. Gravity and the tip wrench are inputs, so new values need no compilation."""


class Chain:
    """Serial chain with its kernels."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.n = robot, robot.nv
        self._kernels: dict[str, np.ufunc] = {}

    def kernel(self, name: str) -> np.ufunc:
        """Kernel for a key of the table."""
        found = self._kernels.get(name)
        if found is None:
            quantity, options = _KERNELS[name]
            if "wrenches" in options:
                options = {**options, "wrenches": (str(self.robot.tip),)}
            found = self._kernels[name] = self.robot.kernel(quantity, **options)
        return found

    def joints(self, x: ArrayLike, name: str) -> Array:
        """Vector with one number per joint, or a batch of such vectors."""
        found = arguments.real(x, name)
        if found.ndim == 0 or found.shape[-1] != self.n:
            raise ShapeError(f"{name} has shape {found.shape}, but the lists describe {self.n} joints.")
        return found

    def checked(self, x: ArrayLike, name: str) -> Array:
        """Input of a kernel: gravity, a wrench at the tip, or one number per joint."""
        if name in SIZES:
            return arguments.real(x, name, SIZES[name])
        return self.joints(x, name)

    def run(self, quantity: str, **arrays: Array) -> Array:
        """Evaluate a quantity; raises ShapeError for batches that do not broadcast."""
        kernel = self.kernel(quantity)
        try:
            return kernel(*arrays.values())
        except ValueError:
            raise arguments.mismatch(**arrays) from None


def chain_of(Mlist: ArrayLike, Glist: ArrayLike, Slist: ArrayLike) -> Chain:
    """Chain from the book's lists: n + 1 poses, n inertias, n screw columns. Impossible inertias are accepted.

    Raises ShapeError for inconsistent lists, ModelError and InertiaError if they do not describe a robot.
    """
    steps, inertias, screws = (
        np.ascontiguousarray(arguments.real(x, name), float)
        for x, name in ((Mlist, "Mlist"), (Glist, "Glist"), (Slist, "Slist"))
    )
    return _built(steps.tobytes(), inertias.tobytes(), screws.tobytes(), (steps.shape, inertias.shape, screws.shape))


def screws_of(screws: ArrayLike, name: str) -> Chain:
    """Chain from screws only: every link frame is {s} at zero, so space screws and body screws have equal coordinates."""
    S = np.ascontiguousarray(arguments.real(screws, name), float)
    if S.ndim != 2 or S.shape[0] != 6 or S.shape[1] == 0:
        raise ShapeError(f"{name} has shape {S.shape}, expected (6, n): a screw axis (omega, v) in each column.")
    n = S.shape[1]
    return _built(_HOME * (n + 1), bytes(288 * n), S.tobytes(), ((n + 1, 4, 4), (n, 6, 6), S.shape))


_HOME = np.eye(4).tobytes()
Shape = tuple[int, ...]


@lru_cache(maxsize=MAX_CACHED_CHAINS)
def _built(steps: bytes, inertias: bytes, screws: bytes, shapes: tuple[Shape, Shape, Shape]) -> Chain:
    raw = zip((steps, inertias, screws), shapes, strict=True)
    Mlist, Glist, Slist = (np.frombuffer(data).reshape(shape) for data, shape in raw)
    if Mlist.ndim == 3 and Mlist.shape[1:] == (4, 4):
        Mlist = np.array([pose(T, f"Mlist[{i}]") for i, T in enumerate(Mlist)])
    return Chain(from_screws(None, Slist, Mlist, Glist, name="lists", non_unit_screws=True, inertia="accept"))
