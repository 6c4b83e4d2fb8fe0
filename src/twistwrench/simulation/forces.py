"""Forces of a simulation: callbacks, friction, contacts, and the rates of the state.

Configurations are not vectors: Runge–Kutta methods integrate the entries of q with rates N(q) dq, and then normalise
quaternions. The exact flow preserves their norm, so the correction is of the order of the step's error, and every
method keeps its order. Source: Hairer, Lubich and Wanner, Geometric Numerical Integration, section IV.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from glob import escape
from inspect import signature
from math import isfinite
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..compiler.ir.tracer import trace
from ..core import arguments
from ..core.errors import ShapeError, SimulationError, ValueRangeError
from ..core.numbers import printed
from ..core.typing import Array
from ..mechanics.algorithms.contact import velocity_step
from ..mechanics.algorithms.friction import sliding_share, torque_past_eased_friction
from ..mechanics.algorithms.kinematics import brackets
from ..mechanics.lie.twist_wrench import Wrench
from ..mechanics.model.couplings import motor_torques, motor_velocities
from ..mechanics.model.model import Model
from ..mechanics.model.parameters import regrouped
from ..robot.arguments import wrench_at
from ..robot.engine import compile_form
from .contact import RobotContact

if TYPE_CHECKING:
    from ..robot import Robot


class Manifold:
    """Configuration manifold of one robot, one state at a time."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, robot.model
        self.flat = all(body.joint.plain_rates for body in self.model.leaders)
        """True if the rates of all coordinates are velocities."""

    @cached_property
    def _rates(self) -> Any:
        return self.robot.kernel("coordinate_rates")

    @cached_property
    def _add(self) -> Any:
        return self.robot.kernel("add")

    def rates(self, q: Array, dq: Array, out: Array) -> None:
        """Write the rates (nq,) of the coordinates at the joint velocities (nv,) into ``out``."""
        if self.flat:
            out[:] = dq
        else:
            self._rates(q, dq, out=out)

    def move(self, q: Array, dv: Array) -> Array:
        """q ⊕ dv, (nq,), (nv,) → (nq,)."""
        return q + dv if self.flat else np.asarray(self._add(q, dv))

    def normalise(self, q: Array) -> None:
        """Bring the quaternions to unit length, in place."""
        for mine in self.model.quaternions:
            q[mine] /= np.linalg.norm(q[mine])

    def errors(self, off: Array) -> Array:
        """Errors of the joints (nv,) [rad or m] that correspond to errors of the coordinates (nq,)."""
        found = np.zeros(self.model.nv)
        for body in self.model.leaders:
            place, mine = body.places
            found[mine] = body.joint.bound(off[place])
        return found

    @cached_property
    def groups(self) -> tuple[tuple[slice, Array, Array], ...]:
        """Joints whose directions do not commute: velocities, mask of angular ones, and c (n, n²) with ad(V) = V c."""
        constants = brackets(self.model)
        found = []
        for body in self.model.leaders:
            mine = body.places[1]
            c = constants[mine, mine, mine]
            if c.any():
                turning = np.array(body.joint.turning, bool)
                found.append((mine, turning, c.transpose(0, 2, 1).reshape(len(c), -1).copy()))
        return tuple(found)


# ── Validation of numbers and callbacks (t, q, dq)

Function = Callable[[float, Array, Array], Any]
"""Function of the time [s], q (nq) and dq (nv)."""


@dataclass(frozen=True)
class ControlLaw:
    """Callback (t, q, dq) that must return finite arrays of one shape; otherwise raises SimulationError with the time."""

    function: Function
    what: str
    shape: tuple[int, ...]
    meaning: str = ""
    varies: bool = True
    """True for a function of the caller, False for a constant."""

    @classmethod
    def from_function(cls, function: Function, what: str, shape: tuple[int, ...], meaning: str = "") -> ControlLaw:
        """Law from a function, if it takes three arguments."""
        require_three(function, what)
        return cls(function, what, shape, meaning)

    def __call__(self, t: float, q: Array, dq: Array) -> Array:
        """Validated value of the function."""
        return self.checked(t, self._evaluated(t, q, dq))

    def number(self, t: float, q: Array, dq: Array) -> float:
        """Value of a function that returns one number."""
        found = self._evaluated(t, q, dq)
        return float(found) if isinstance(found, float) and isfinite(found) else float(self.checked(t, found))

    def _evaluated(self, t: float, q: Array, dq: Array) -> Any:
        try:
            return self.function(t, q.copy(), dq.copy())  # copies: the function may store or change them
        except Exception as problem:
            raise self.failure(t, problem) from problem

    def failure(self, t: float, problem: Exception) -> SimulationError:
        """Error for an exception raised in the function."""
        return SimulationError(f"{self.what} failed at t = {printed(t, 9)} s with {type(problem).__name__}: {problem}")

    def checked(self, t: float, given: Any) -> Array:
        """Value as a new array of floats; raises SimulationError if it is invalid."""
        try:
            found = arguments.plain(given, self.what)  # a table would be read by position
        except Exception as problem:
            raise self.failure(t, problem) from problem
        kinds = "biuf" if self.shape else "iuf"
        if found.dtype.kind in kinds and found.shape == self.shape and np.isfinite(found).all():
            return found.astype(float)
        at, expected = f"at t = {printed(t, 9)} s", f"{self.shape}{self.meaning}."
        if found.dtype.kind not in "biuf":
            given, fault = repr(found.tolist()), f", expected real numbers of shape {expected}"
        elif found.shape != self.shape:
            given, fault = f"an array of shape {found.shape}", f", expected {expected}"
        elif found.dtype.kind not in kinds:
            given = str(bool(found))
            fault = ", and takes a number whose sign changes where it happens: q[0] - 0.5, not q[0] > 0.5."
        else:
            where = "" if not self.shape else f" at place {int(np.flatnonzero(~np.isfinite(found))[0])}"
            given, fault = str(found), f", not finite{where}."
        raise SimulationError(f"{self.what} gave {given} {at}{fault}")

    def values(self, t: Array, q: Array, dq: Array) -> Array:
        """Values of the function at times (m,) and states (m, nq), (m, nv), validated together."""
        rows = list(zip(t.tolist(), q, dq, strict=True))
        try:
            found = np.array([self.function(*row) for row in rows], float)
        except Exception:  # raised with its time below
            found = np.zeros(0)
        if found.shape == (len(rows), *self.shape) and np.isfinite(found).all():
            return found
        return np.array([self(*row) for row in rows])


def require_three(function: Any, what: str) -> None:
    """Raise an error unless the argument is a function of (t, q, dq)."""
    require_arguments(function, what, ("the time [s]", "q (nq)", "dq (nv)"), "t, q, dq")


def require_arguments(function: Any, what: str, taken: Sequence[str], names: str = "share") -> None:
    """Raise ValueRangeError unless the argument is a function with these parameters, named by ``taken``."""
    if not callable(function) or isinstance(function, type):
        raise ValueRangeError(f"{what} is {arguments.value_text(function)}, and must be a function of ({names}).")
    code = function.__code__ if isinstance(function, FunctionType) else None
    if code is not None and code.co_argcount == len(taken) and not code.co_kwonlyargcount:
        return  # checking a signature takes longer than many steps
    try:
        signed = signature(function)
    except (TypeError, ValueError):  # some C functions have no signature
        return
    try:
        signed.bind(*[None] * len(taken))
    except TypeError as problem:
        listed = " and ".join(filter(None, [", ".join(taken[:-1]), taken[-1]]))
        raise ValueRangeError(
            f"{what} is a function of {signed}, and is called with {listed}: {problem}. Write lambda {names}: …"
        ) from None


# ── Regularised dry friction for smooth methods, and its error

CREEP = 1e-3
"""rad/s or m/s, smallest speed below which dry friction is smoothed."""


def creep_speeds(M: Array, dry: Array, h: float) -> Array:
    """Speeds (..., nv) below which dry friction is smoothed: at least its largest change of velocity in a step h."""
    light = np.diagonal(np.linalg.inv(M), axis1=-2, axis2=-1)
    return np.asarray(np.maximum(CREEP, h * dry * light))


def creep_of_samples(robot: Robot, q0: Array, h: float, parameters: Mapping[str, Array]) -> Array:
    """Speeds (..., nv) below which dry friction is smoothed, for samples with their own parameters."""
    inertia, inputs = robot.mass_matrix, [q0]
    if parameters:
        inertia = robot.kernel("mass_matrix", parameters=tuple(map(escape, parameters)))
        inputs.append(np.stack(np.broadcast_arrays(*parameters.values()), axis=-1))
    try:
        with np.errstate(all="ignore"):  # non-finite states end as unstable motions
            M = inertia(*(np.asarray(x, float) for x in inputs))
            if robot.model.couplings:  # of the drives, A⁻ᵀ M A⁻¹
                M = motor_torques(robot.model, np.swapaxes(motor_torques(robot.model, M), -1, -2))
            return creep_speeds(M, _dry_friction(robot, parameters), h)
    except np.linalg.LinAlgError:
        robot.engine.require_invertible()
        raise ValueRangeError("q0: the mass matrix has no inverse at one of these states.") from None


def _dry_friction(robot: Robot, parameters: Mapping[str, Array]) -> Array:
    """Largest dry friction of each joint without load, (..., nv)."""
    friction = robot.model.friction
    most = np.maximum(friction.static, friction.coulomb)
    most = np.broadcast_to(most, (*np.broadcast_shapes(*(x.shape for x in parameters.values())), robot.nv)).copy()
    for body in robot.model.leaders:
        if body.joint.nv == 1:
            k, laws = body.v_index, {"static": friction.static, "coulomb": friction.coulomb}
            drive = robot.model.drive_names[k]
            given = [parameters.get(f"{drive}.{law}", x[k]) for law, x in laws.items()]
            most[..., k] = np.maximum(*given)
    return most


class EasedFriction:
    """Friction laws of a robot's joints, continuous at rest.

    Dry friction is multiplied by tanh(|dq| / creep). A joint that should stick creeps at up to a few times that speed.
    Steps can then be longer than the time in which friction stops a joint.
    """

    def __init__(self, robot: Robot, creep: Array) -> None:
        self.robot, self.creep, self.dry = robot, creep, rubs_dry(robot.model)

    @cached_property
    def _kernel(self) -> Any:
        robot = self.robot

        def left(dq: Array, tau: Array, share: Array) -> tuple[Array]:
            return (torque_past_eased_friction(robot.model, dq, tau, share),)

        def build() -> Any:
            program = trace(left, [(name, (robot.nv,)) for name in ("dq", "tau", "share")], ["left"])
            return compile_form(
                program, "eased friction", f"Torques minus smoothed friction of {robot.name}, compiled."
            )

        return robot.engine.cache("eased friction", build)

    def left(self, dq: Array, tau: Array) -> Array:
        """Torques tau minus friction, (nv)."""
        return np.asarray(self._kernel(dq, tau, sliding_share(motor_velocities(self.robot.model, dq), self.creep)))


def rubs_dry(model: Model) -> Array:
    """Mask of joints with dry friction, (nv,)."""
    return np.asarray((model.friction.static > 0) | (model.friction.coulomb > 0) | (model.friction.load > 0))


def easing_remark(model: Model, creep: Array) -> str | None:
    """Remark on the effect of smoothed friction on a motion; None without dry friction."""
    dry = rubs_dry(model)
    if not dry.any():
        return None
    most = np.where(dry, creep, 0.0).reshape(-1, len(dry)).max(axis=0)
    worst = int(np.argmax(most))
    return (
        "dry friction is eased off at low speeds: joints that it would hold creep, at up to about "
        f"{printed(most[worst], 2)} rad/s or m/s (most of all {model.drive_labels[worst]!r}), and one that moves as "
        "slowly keeps three quarters of its friction; semi-implicit steps ease nothing"
    )


# ── Velocity step of rollouts as a kernel for simulations with callbacks


class DryFrictionStep:
    """:func:`~twistwrench.mechanics.algorithms.contact.velocity_step` of one robot, compiled."""

    def __init__(self, robot: Robot, usual: float, *, friction: bool, gains: Array | None) -> None:
        self.usual, self.friction, self.gained = usual, friction, gains is not None
        """Default length of a step [s]; True with friction; True with velocity gains."""
        self.dry = rubs_dry(robot.model) & friction
        """Joints with dry friction, (nv,)."""
        self.gains = np.zeros(robot.nv) if gains is None else gains
        self._robot = robot

    @cached_property
    def kernel(self) -> Any:
        """Kernel from (q, dq, h, tau, push, gains) to velocities, applied and friction torques; compiled at first use."""
        robot, friction, gained = self._robot, self.friction, self.gained
        model = regrouped(robot.model)

        def step(q: Array, dq: Array, h: Any, tau: Array, push: Array, gains: Array) -> tuple[Array, Array, Array]:
            return velocity_step(model, q, dq, h, tau, gains=gains if gained else None, friction=friction, push=push)

        def build() -> Any:
            robot.engine.require_invertible()
            rest = [(name, (robot.nv,)) for name in ("tau", "push", "gains")]
            inputs = [("q", (robot.nq,)), ("dq", (robot.nv,)), ("h", ()), *rest]
            program = trace(step, inputs, ["v", "applied", "friction"])
            return compile_form(program, "braked step", f"Velocities of {robot.name} after a step, compiled.")

        return robot.engine.cache(("braked step", friction, gained), build)

    def middle(self, manifold: Manifold, q: Array, dq: Array, h: float) -> Array:
        """Coordinates at which velocities change, (nq,): at the midpoint with friction, at the start without."""
        return manifold.move(q, 0.5 * h * dq) if self.friction else q

    def end(self, manifold: Manifold, middle: Array, v: Array, h: float) -> Array:
        """Coordinates at the end of the step, (nq,)."""
        return manifold.move(middle, (0.5 * h if self.friction else h) * v)


# ── Forces on the robot and rates of its state

# The state is one vector y = (q, dq, W): coordinates, velocities, and the work done so far by joint torques, friction,
# wrenches and contacts. Works are integrated by the same method as the motion, so that
#
#     drift = E(t) - E(0) - W(t)
#
# is only the error of the method.

WORKS = ("torques", "friction", "wrenches", "contacts")
"""Sources of work, in the order of the last entries of a state."""


class System:
    """Robot and the forces on it: y' = f(t, y)."""

    takes_many = True
    """True if :meth:`of_many` is available."""

    def __init__(
        self,
        robot: Robot,
        *,
        tau: ControlLaw | None = None,
        wrenches: Mapping[str, ControlLaw] | None = None,
        contacts: Sequence[RobotContact] = (),
        friction: EasedFriction | None = None,
    ) -> None:
        self.robot, self.manifold = robot, Manifold(robot)
        self.nq, self.nv = robot.nq, robot.nv
        self.moving = slice(robot.nq, robot.nq + robot.nv)
        self.size = robot.nq + robot.nv + len(WORKS)
        self.tau, self.wrenches, self.contacts, self.friction = tau, dict(wrenches or {}), tuple(contacts), friction
        self.functions = self._functions()
        """Callbacks: name, and generalised forces (m, nv) at times (m,) and states (m, size)."""
        self.dry_friction: DryFrictionStep | None = None
        """Steps with implicit friction and velocity gains; accelerations are then those of such a step."""
        self._last: tuple[float, float, Array, Array, Array, Array, Array] | None = None
        self.held = np.zeros(robot.nv)
        """Last output of the controller, (nv)."""
        self.applied = self.held
        """Joint torques at the last evaluation of forces, (nv)."""
        self.evaluations = 0

    @property
    def rubs(self) -> bool:
        """True if there is friction."""
        return self.friction is not None or (self.dry_friction is not None and self.dry_friction.friction)

    def split(self, y: Array) -> tuple[Array, Array]:
        """q and dq of a state."""
        return y[: self.nq], y[self.moving]

    def allowed_velocities(self, y: Array) -> Array:
        """Velocities (..., nv) of states (..., size) that satisfy the constraints; an open robot has none."""
        return y[..., self.moving]

    def forces(self, t: float, q: Array, dq: Array, powers: Array) -> Array:
        """Generalised force (nv) of everything but gravity and springs; writes the powers to ``powers`` (4,) [W]."""
        tau = self._torques(t, q, dq)
        self.applied, total = tau, tau
        powers[0] = tau @ dq
        if self.friction is not None:
            total = self.friction.left(dq, tau)
            powers[1] = total @ dq - powers[0]
        for k, push in self._pushes(t, q, dq, q):
            total = total + push
            powers[k] += push @ dq
        return total

    def braked_step(self, t: float, y: Array, h: float, powers: Array) -> Array:
        """Velocities after a step of length ``h`` from a state; powers as by :meth:`forces`, averaged over the step."""
        assert self.dry_friction is not None
        last = self._last
        if last is not None and last[:2] == (t, h) and last[2] is self.held and np.array_equal(last[3], y):
            v, self.applied, powers[:] = last[4:]
            return v
        q, dq = self.split(y)
        middle = self.dry_friction.middle(self.manifold, q, dq, h)
        pushes = list(self._pushes(t, q, dq, middle))
        push = sum((x for _, x in pushes), np.zeros(self.nv))
        tau, gains = self._torques(t, q, dq), self.dry_friction.gains
        v, self.applied, lost = self.dry_friction.kernel(middle, dq, h, tau, push, gains)
        mean = 0.5 * (dq + v)
        powers[:] = self.applied @ mean, lost @ mean, 0.0, 0.0
        for k, x in pushes:
            powers[k] += x @ mean
        self._last = t, h, self.held, y.copy(), v, self.applied, powers.copy()
        return v

    def _functions(self) -> list[tuple[str, Callable[[Array, Array], Array]]]:
        def values(law: ControlLaw, times: Array, states: Array) -> Array:
            return law.values(times, states[:, : self.nq], states[:, self.moving])

        def pushes(frame: str, law: ControlLaw, times: Array, states: Array) -> Array:
            return self.robot.wrench_torques(states[:, : self.nq], values(law, times, states), frame)

        found: list[tuple[str, Callable[[Array, Array], Array]]] = []
        if self.tau is not None:
            found.append(("tau", partial(values, self.tau)))
        found += [(f"the wrench at {f!r}", partial(pushes, f, law)) for f, law in self.wrenches.items() if law.varies]
        return found

    def _torques(self, t: float, q: Array, dq: Array) -> Array:
        """Torques of the controller and of ``tau``, (nv,)."""
        return self.held if self.tau is None else self.held + self.tau(t, q, dq)

    def _pushes(self, t: float, q: Array, dq: Array, at: Array) -> Iterator[tuple[int, Array]]:
        """For each wrench and contact: joint torques (nv,) at the configuration ``at`` (nq,), and index of its work."""
        for frame, law in self.wrenches.items():
            yield 2, self.robot.wrench_torques(at, law(t, q, dq), frame)
        for contact in self.contacts:
            touched = contact.torques(q, dq)
            if touched is not None:
                yield 3, touched

    def rates(self, t: float, y: Array, out: Array) -> None:
        """Write f(t, y) into ``out``."""
        self.evaluations += 1
        q, dq, powers = y[: self.nq], y[self.moving], out[-4:]
        powers[:] = 0.0
        self.manifold.rates(q, dq, out[: self.nq])
        if self.dry_friction is not None:
            h = self.dry_friction.usual
            out[self.moving] = (self.braked_step(t, y, h, powers) - dq) / h
            return
        force = self.forces(t, q, dq, powers)
        out[self.moving] = self.robot.forward_dynamics(q, dq, force)

    def of_many(self, times: Array, states: Array) -> tuple[Array, Array]:
        """Accelerations and joint torques, (m, nv), at times (m,) and states (m, size); open robots only."""
        self.evaluations += len(states)
        q, dq = states[:, : self.nq], states[:, self.moving]
        tau = np.broadcast_to(self.held, dq.shape)
        if self.tau is not None:
            tau = self.held + self.tau.values(times, q, dq)
        return np.asarray(self.robot.forward_dynamics(q, dq, self.total(times, q, dq, tau))), tau

    def total(self, times: Array, q: Array, dq: Array, tau: Array) -> Array:
        """Torques tau (m, nv) minus friction, plus those of wrenches and contacts."""
        found = tau if self.friction is None else self.friction.left(dq, tau)
        for frame, law in self.wrenches.items():
            F = law.values(times, q, dq) if law.varies else law(0.0, q, dq)
            found = found + self.robot.wrench_torques(q, F, frame)
        for contact in self.contacts:
            touched = contact.torques(q, dq)
            if touched is not None:
                found = found + touched
        return found

    def accelerations(self, t: float, y: Array) -> Array:
        """Accelerations (nv,) of a state."""
        rate = np.zeros(self.size)
        self.rates(t, y, rate)
        return rate[self.moving]


def torque_law(tau: Any, nv: int) -> tuple[Array, ControlLaw | None]:
    """Constant torques (nv) and torque function; one of them is zero or None."""
    if tau is None:
        return np.zeros(nv), None
    if callable(tau):
        return np.zeros(nv), ControlLaw.from_function(tau, "tau", (nv,), ", a torque for each velocity")
    return np.array(arguments.finite(arguments.one(tau, "tau", nv), "tau", nv), float), None


def wrench_laws(robot: Robot, wrenches: Any) -> dict[str, ControlLaw]:
    """Law for each frame of ``{frame: (m, f) or a function}``, wrenches by the world on the robot."""
    if wrenches is None:
        return {}
    if not isinstance(wrenches, Mapping):
        raise ShapeError("wrench_on_robot is a dict {frame: (m, f) or a function of (t, q, dq)}.")
    found = {}
    for frame, given in wrenches.items():
        robot.model.frame(frame)
        what = f"the wrench at {frame!r}"
        if callable(given) and not isinstance(given, Wrench):
            found[frame] = ControlLaw.from_function(given, what, (6,), ", (m, f), moment first")
        else:
            labelled = wrench_at(robot.model, frame, given)  # validates a label
            F = np.array(arguments.finite(arguments.one(labelled, what, 6), what, 6), float)
            found[frame] = ControlLaw(lambda _t, _q, _dq, F=F: F, what, (6,), varies=False)  # type: ignore[misc]
    return found
