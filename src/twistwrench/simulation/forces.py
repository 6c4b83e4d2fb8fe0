"""Forces of a simulation: callbacks, friction, contacts, and the rates of the state.

Configurations are not vectors: Runge–Kutta methods integrate the entries of q with rates N(q) dq, and then normalise
quaternions. The exact flow preserves their norm, so the correction is of the order of the step's error, and every
method keeps its order. Source: Hairer, Lubich and Wanner, Geometric Numerical Integration, section IV.4.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from glob import escape
from inspect import signature
from math import isfinite
from types import FunctionType
from typing import TYPE_CHECKING, Any, Self

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
        self.robot = robot
        self.model = robot.model
        self.flat = all(body.joint.plain_rates for body in self.model.leaders)
        """True for a flat manifold: the rates of all coordinates are velocities."""

    @cached_property
    def _rates(self) -> Any:
        """Kernel from q and dq to the rates of q."""
        return self.robot.kernel("coordinate_rates")

    @cached_property
    def _add(self) -> Any:
        """Kernel from q and dv to q ⊕ dv."""
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
        for quaternion in self.model.quaternions:
            q[quaternion] /= np.linalg.norm(q[quaternion])

    def errors(self, coordinate_errors: Array) -> Array:
        """Errors of the joints (nv,) [rad or m] that correspond to errors of the coordinates (nq,)."""
        joint_errors = np.zeros(self.model.nv)
        for body in self.model.leaders:
            coordinates, velocities = body.places
            joint_errors[velocities] = body.joint.bound(coordinate_errors[coordinates])
        return joint_errors

    @cached_property
    def groups(self) -> tuple[tuple[slice, Array, Array], ...]:
        """One tuple for each joint of n velocities whose directions do not commute.

        It has the entries of the velocities in dq, the mask of angular velocities, and c (n, n²) with ad(V) = V c.
        """
        constants = brackets(self.model)
        groups = []
        for body in self.model.leaders:
            _, velocities = body.places
            c = constants[velocities, velocities, velocities]
            if c.any():
                is_angular = np.array(body.joint.turning, bool)
                c = c.transpose(0, 2, 1).reshape(len(c), -1)
                groups.append((velocities, is_angular, c.copy()))
        return tuple(groups)


Function = Callable[[float, Array, Array], Any]
"""Function of the time [s], q (nq) and dq (nv)."""


@dataclass(frozen=True)
class ControlLaw:
    """Callback (t, q, dq) that must return finite arrays of one shape; otherwise raises SimulationError with the time."""

    function: Function
    what: str
    """Name of the callback in messages."""
    shape: tuple[int, ...]
    """Shape of its values; () for one number."""
    meaning: str = ""
    """Clause that follows the shape in messages."""
    varies: bool = True
    """True for a function of the caller, False for a constant."""

    @classmethod
    def from_function(cls, function: Function, what: str, shape: tuple[int, ...], meaning: str = "") -> ControlLaw:
        """Law from a function, if it takes three arguments."""
        require_three(function, what)
        return cls(function, what, shape, meaning)

    def __call__(self, t: float, q: Array, dq: Array) -> Array:
        """Validated value of the function."""
        return self.require_finite(t, self._evaluate(t, q, dq))

    def number(self, t: float, q: Array, dq: Array) -> float:
        """Value of a function that returns one number."""
        value = self._evaluate(t, q, dq)
        if isinstance(value, float) and isfinite(value):
            return float(value)
        return float(self.require_finite(t, value))

    def _evaluate(self, t: float, q: Array, dq: Array) -> Any:
        """Value of the function as it is; raises SimulationError if the function fails."""
        try:
            return self.function(t, q.copy(), dq.copy())  # copies: the function may store or change them
        except Exception as problem:
            raise self.failure(t, problem) from problem

    def failure(self, t: float, problem: Exception) -> SimulationError:
        """Error for an exception raised in the function."""
        return SimulationError(f"{self.what} failed at t = {printed(t, 9)} s with {type(problem).__name__}: {problem}")

    def require_finite(self, t: float, value: Any) -> Array:
        """Value as a new array of floats; raises SimulationError if it is invalid."""
        try:
            array = arguments.plain(value, self.what)  # a table would be read by position
        except Exception as problem:
            raise self.failure(t, problem) from problem
        allowed_kinds = "biuf" if self.shape else "iuf"  # the sign of one number is used, which True does not have
        if array.dtype.kind in allowed_kinds and array.shape == self.shape and np.isfinite(array).all():
            return array.astype(float)
        value_text = str(array)
        expected = f"{self.shape}{self.meaning}."
        if array.dtype.kind not in "biuf":
            value_text = repr(array.tolist())
            fault = f", expected real numbers of shape {expected}"
        elif array.shape != self.shape:
            value_text = f"an array of shape {array.shape}"
            fault = f", expected {expected}"
        elif array.dtype.kind not in allowed_kinds:
            value_text = str(bool(array))
            fault = ", and takes a number whose sign changes where it happens: q[0] - 0.5, not q[0] > 0.5."
        elif self.shape:
            bad_entries = np.flatnonzero(~np.isfinite(array))
            fault = f", not finite at place {int(bad_entries[0])}."
        else:
            fault = ", not finite."
        raise SimulationError(f"{self.what} gave {value_text} at t = {printed(t, 9)} s{fault}")

    def values(self, t: Array, q: Array, dq: Array) -> Array:
        """Values of the function at times (m,) and states (m, nq), (m, nv), validated together."""
        inputs = list(zip(t.tolist(), q, dq, strict=True))
        try:
            values = np.array([self.function(*row) for row in inputs], float)
        except Exception:  # raised with its time below
            values = np.zeros(0)
        if values.shape == (len(inputs), *self.shape) and np.isfinite(values).all():
            return values
        return np.array([self(*row) for row in inputs])  # one by one, to raise the error of the invalid one


def require_three(function: Any, what: str) -> None:
    """Raise an error unless the argument is a function of (t, q, dq)."""
    require_arguments(function, what, ("the time [s]", "q (nq)", "dq (nv)"), "t, q, dq")


def require_arguments(function: Any, what: str, parameters: Sequence[str], names: str = "share") -> None:
    """Raise ValueRangeError unless the argument is a function with these parameters; ``names`` are for its message."""
    if not callable(function) or isinstance(function, type):
        raise ValueRangeError(f"{what} is {arguments.value_text(function)}, and must be a function of ({names}).")
    if isinstance(function, FunctionType):
        code = function.__code__
        if code.co_argcount == len(parameters) and not code.co_kwonlyargcount:
            return  # checking a signature takes longer than many steps
    try:
        own_signature = signature(function)
    except (TypeError, ValueError):  # some C functions have no signature
        return
    try:
        own_signature.bind(*[None] * len(parameters))
    except TypeError as problem:
        *others, listed = parameters
        if others:
            listed = f"{', '.join(others)} and {listed}"
        raise ValueRangeError(
            f"{what} is a function of {own_signature}, and is called with {listed}: {problem}. Write lambda {names}: …"
        ) from None


MIN_CREEP = 1e-3
"""rad/s or m/s, smallest speed below which dry friction is smoothed."""


def creep_speeds(M: Array, dry: Array, h: float) -> Array:
    """Speeds (..., nv) below which dry friction is smoothed: at least its largest change of velocity in a step h."""
    mobilities = np.diagonal(np.linalg.inv(M), axis1=-2, axis2=-1)
    return np.asarray(np.maximum(MIN_CREEP, h * dry * mobilities))


def creep_of_samples(robot: Robot, q0: Array, h: float, parameters: Mapping[str, Array]) -> Array:
    """Speeds (..., nv) below which dry friction is smoothed, for samples with their own parameters."""
    mass_matrix = robot.mass_matrix
    inputs = [q0]
    if parameters:
        mass_matrix = robot.kernel("mass_matrix", parameters=tuple(map(escape, parameters)))
        columns = np.broadcast_arrays(*parameters.values())
        inputs.append(np.stack(columns, axis=-1))
    try:
        with np.errstate(all="ignore"):  # non-finite states end as unstable motions
            M = mass_matrix(*(np.asarray(x, float) for x in inputs))
            if robot.model.couplings:  # of the drives: A⁻ᵀ M A⁻¹
                half_transformed = motor_torques(robot.model, M)
                M = motor_torques(robot.model, np.swapaxes(half_transformed, -1, -2))
            return creep_speeds(M, _dry_friction(robot, parameters), h)
    except np.linalg.LinAlgError:
        robot.engine.require_invertible()
        raise ValueRangeError("q0: the mass matrix has no inverse at one of these states.") from None


def _dry_friction(robot: Robot, parameters: Mapping[str, Array]) -> Array:
    """Largest dry friction of each joint without load, (..., nv)."""
    friction = robot.model.friction
    shape = np.broadcast_shapes(*(x.shape for x in parameters.values()))
    friction_of_model = np.maximum(friction.static, friction.coulomb)
    largest_friction = np.broadcast_to(friction_of_model, (*shape, robot.nv)).copy()
    for body in robot.model.leaders:
        if body.joint.nv == 1:
            k = body.v_index
            drive = robot.model.drive_names[k]
            static = parameters.get(f"{drive}.static", friction.static[k])
            coulomb = parameters.get(f"{drive}.coulomb", friction.coulomb[k])
            largest_friction[..., k] = np.maximum(static, coulomb)
    return largest_friction


class EasedFriction:
    """Friction laws of a robot's joints, continuous at rest.

    Dry friction is multiplied by tanh(|dq| / creep). A joint that should stick creeps at up to a few times that speed.
    Steps can then be longer than the time in which friction stops a joint.
    """

    def __init__(self, robot: Robot, creep: Array) -> None:
        self.robot = robot
        self.creep = creep  # (..., nv), speeds below which dry friction is smoothed [rad/s or m/s]
        self.dry = has_dry_friction(robot.model)

    @cached_property
    def _kernel(self) -> Any:
        """Kernel from dq, tau and the sliding shares to tau minus friction."""
        robot = self.robot

        def net_torques(dq: Array, tau: Array, share: Array) -> tuple[Array]:
            return (torque_past_eased_friction(robot.model, dq, tau, share),)

        def build() -> Any:
            program = trace(net_torques, [(name, (robot.nv,)) for name in ("dq", "tau", "share")], ["left"])
            return compile_form(
                program, "eased friction", f"Torques minus smoothed friction of {robot.name}, compiled."
            )

        return robot.engine.cache("eased friction", build)

    def net_torques(self, dq: Array, tau: Array) -> Array:
        """Torques tau minus friction, (nv)."""
        motor_speeds = motor_velocities(self.robot.model, dq)
        return np.asarray(self._kernel(dq, tau, sliding_share(motor_speeds, self.creep)))


def has_dry_friction(model: Model) -> Array:
    """Mask of joints with dry friction, (nv,)."""
    return np.asarray((model.friction.static > 0) | (model.friction.coulomb > 0) | (model.friction.load > 0))


def easing_remark(model: Model, creep: Array) -> str | None:
    """Remark on the effect of smoothed friction on a motion; None without dry friction."""
    dry = has_dry_friction(model)
    if not dry.any():
        return None
    speeds = np.where(dry, creep, 0.0).reshape(-1, len(dry)).max(axis=0)
    k = int(np.argmax(speeds))
    return (
        "dry friction is eased off at low speeds: joints that it would hold creep, at up to about "
        f"{printed(speeds[k], 2)} rad/s or m/s (most of all {model.drive_labels[k]!r}), and one that moves as "
        "slowly keeps three quarters of its friction; semi-implicit steps ease nothing"
    )


class DryFrictionStep:
    """:func:`~twistwrench.mechanics.algorithms.contact.velocity_step` of one robot, compiled."""

    def __init__(self, robot: Robot, usual: float, *, friction: bool, gains: Array | None) -> None:
        self.usual = usual
        """Usual length of a step [s]."""
        self.friction = friction
        """True with friction."""
        self.has_gains = gains is not None
        """True with velocity gains."""
        self.dry = has_dry_friction(robot.model) & friction
        """Joints with dry friction, (nv,)."""
        self.gains = np.zeros(robot.nv) if gains is None else gains
        """Velocity gains, (nv,); zero without gains."""
        self._robot = robot

    @cached_property
    def kernel(self) -> Any:
        """Kernel from (q, dq, h, tau, push, gains) to velocities, applied and friction torques; compiled at first use."""
        robot, friction, has_gains = self._robot, self.friction, self.has_gains
        model = regrouped(robot.model)

        def step(q: Array, dq: Array, h: Any, tau: Array, push: Array, gains: Array) -> tuple[Array, Array, Array]:
            return velocity_step(model, q, dq, h, tau, gains=gains if has_gains else None, friction=friction, push=push)

        def build() -> Any:
            robot.engine.require_invertible()
            inputs: list[tuple[str, tuple[int, ...]]] = [("q", (robot.nq,)), ("dq", (robot.nv,)), ("h", ())]
            inputs += [(name, (robot.nv,)) for name in ("tau", "push", "gains")]
            program = trace(step, inputs, ["v", "applied", "friction"])
            return compile_form(program, "braked step", f"Velocities of {robot.name} after a step, compiled.")

        return robot.engine.cache(("braked step", friction, has_gains), build)

    def middle(self, manifold: Manifold, q: Array, dq: Array, h: float) -> Array:
        """Coordinates at which velocities change, (nq,): at the midpoint with friction, at the start without."""
        return manifold.move(q, 0.5 * h * dq) if self.friction else q

    def end(self, manifold: Manifold, middle: Array, v: Array, h: float) -> Array:
        """Coordinates at the end of the step, (nq,)."""
        remaining_time = 0.5 * h if self.friction else h
        return manifold.move(middle, remaining_time * v)


# The state is one vector y = (q, dq, W): coordinates, velocities, and the work done so far by joint torques, friction,
# wrenches and contacts. Works are integrated by the same method as the motion, so that
#
#     drift = E(t) - E(0) - W(t)
#
# is only the error of the method.

WORKS = ("torques", "friction", "wrenches", "contacts")
"""Sources of work, in the order of the last entries of a state and of its powers."""
_POWERS = slice(-len(WORKS), None)
"""Entries of works in a state, and of powers in its rate."""
_WRENCHES = WORKS.index("wrenches")
_CONTACTS = WORKS.index("contacts")


class System:
    """Robot and the forces on it: y' = f(t, y)."""

    takes_many = True
    """True if :meth:`batch_accelerations` is available."""

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
        """Entries of a state that are velocities."""
        self.size = robot.nq + robot.nv + len(WORKS)
        """Number of entries of a state."""
        self.tau = tau
        self.wrenches = dict(wrenches or {})
        self.contacts = tuple(contacts)
        self.friction = friction
        self.functions = self._functions()
        """Callbacks: name, and generalised forces (m, nv) at times (m,) and states (m, size)."""
        self.dry_friction: DryFrictionStep | None = None
        """Steps with implicit friction and velocity gains, which then give the accelerations too; None without."""
        self._last: tuple[float, float, Array, Array, Array, Array, Array] | None = None
        """Last braked step: t, h, controller's torques, state, and its results v, applied torques, powers."""
        self.held = np.zeros(robot.nv)
        """Last output of the controller, (nv)."""
        self.applied = self.held
        """Joint torques at the last evaluation of forces, (nv)."""
        self.evaluations = 0

    @property
    def rubs(self) -> bool:
        """True if there is friction."""
        return self.friction is not None or (self.dry_friction is not None and self.dry_friction.friction)

    def under(self, held: Array) -> Self:
        """Copy under these torques of the controller; it counts its own evaluations."""
        copied = copy(self)
        copied.held = held
        return copied

    def split(self, y: Array) -> tuple[Array, Array]:
        """q and dq of a state."""
        return y[: self.nq], y[self.moving]

    def allowed_velocities(self, y: Array) -> Array:
        """Velocities (..., nv) of states (..., size) that satisfy the constraints; an open robot has none."""
        return y[..., self.moving]

    def forces(self, t: float, q: Array, dq: Array, powers: Array) -> Array:
        """Generalised force (nv) of everything but gravity and springs; writes the powers to ``powers`` (4,) [W]."""
        tau = self._torques(t, q, dq)
        self.applied = tau
        total = tau
        powers[0] = tau @ dq
        if self.friction is not None:
            total = self.friction.net_torques(dq, tau)
            powers[1] = total @ dq - powers[0]
        for source, push in self._pushes(t, q, dq, q):
            total = total + push
            powers[source] += push @ dq
        return total

    def braked_step(self, t: float, y: Array, h: float, powers: Array) -> Array:
        """Velocities after a step of length ``h`` from a state; powers as by :meth:`forces`, averaged over the step."""
        assert self.dry_friction is not None
        last = self._last
        if last is not None:
            last_t, last_h, last_held, last_y, v, last_applied, last_powers = last
            if last_t == t and last_h == h and last_held is self.held and np.array_equal(last_y, y):
                self.applied = last_applied
                powers[:] = last_powers
                return v
        q, dq = self.split(y)
        middle = self.dry_friction.middle(self.manifold, q, dq, h)
        pushes = list(self._pushes(t, q, dq, middle))
        total_push = sum((push for _, push in pushes), np.zeros(self.nv))
        tau = self._torques(t, q, dq)
        gains = self.dry_friction.gains
        v, self.applied, friction_torques = self.dry_friction.kernel(middle, dq, h, tau, total_push, gains)
        mean_velocities = 0.5 * (dq + v)
        powers[:] = self.applied @ mean_velocities, friction_torques @ mean_velocities, 0.0, 0.0
        for source, push in pushes:
            powers[source] += push @ mean_velocities
        self._last = t, h, self.held, y.copy(), v, self.applied, powers.copy()
        return v

    def _functions(self) -> list[tuple[str, Callable[[Array, Array], Array]]]:
        """Callbacks for :attr:`functions`."""

        def values(law: ControlLaw, times: Array, states: Array) -> Array:
            return law.values(times, states[:, : self.nq], states[:, self.moving])

        def pushes(frame: str, law: ControlLaw, times: Array, states: Array) -> Array:
            return self.robot.wrench_torques(states[:, : self.nq], values(law, times, states), frame)

        functions: list[tuple[str, Callable[[Array, Array], Array]]] = []
        if self.tau is not None:
            functions.append(("tau", partial(values, self.tau)))
        for frame, law in self.wrenches.items():
            if law.varies:
                functions.append((f"the wrench at {frame!r}", partial(pushes, frame, law)))
        return functions

    def _torques(self, t: float, q: Array, dq: Array) -> Array:
        """Torques of the controller and of ``tau``, (nv,)."""
        return self.held if self.tau is None else self.held + self.tau(t, q, dq)

    def _pushes(self, t: float, q: Array, dq: Array, at: Array) -> Iterator[tuple[int, Array]]:
        """For each wrench and contact: index in ``WORKS``, and joint torques (nv,) at the configuration ``at`` (nq,)."""
        for frame, law in self.wrenches.items():
            yield _WRENCHES, self.robot.wrench_torques(at, law(t, q, dq), frame)
        for contact in self.contacts:
            push = contact.torques(q, dq)
            if push is not None:
                yield _CONTACTS, push

    def rates(self, t: float, y: Array, out: Array) -> None:
        """Write f(t, y) into ``out``."""
        self.evaluations += 1
        q, dq = y[: self.nq], y[self.moving]
        powers = out[_POWERS]
        powers[:] = 0.0
        self.manifold.rates(q, dq, out[: self.nq])
        if self.dry_friction is not None:
            h = self.dry_friction.usual
            out[self.moving] = (self.braked_step(t, y, h, powers) - dq) / h
            return
        force = self.forces(t, q, dq, powers)
        out[self.moving] = self.robot.forward_dynamics(q, dq, force)

    def batch_accelerations(self, times: Array, states: Array) -> tuple[Array, Array]:
        """Accelerations and joint torques, (m, nv), at times (m,) and states (m, size); open robots only."""
        self.evaluations += len(states)
        q, dq = states[:, : self.nq], states[:, self.moving]
        tau = np.broadcast_to(self.held, dq.shape)
        if self.tau is not None:
            tau = self.held + self.tau.values(times, q, dq)
        force = self.total(times, q, dq, tau)
        return np.asarray(self.robot.forward_dynamics(q, dq, force)), tau

    def total(self, times: Array, q: Array, dq: Array, tau: Array) -> Array:
        """Torques tau (m, nv) minus friction, plus the torques of wrenches and contacts."""
        total = tau
        if self.friction is not None:
            total = self.friction.net_torques(dq, tau)
        for frame, law in self.wrenches.items():
            F = law.values(times, q, dq) if law.varies else law(0.0, q, dq)
            total = total + self.robot.wrench_torques(q, F, frame)
        for contact in self.contacts:
            push = contact.torques(q, dq)
            if push is not None:
                total = total + push
        return total

    def accelerations(self, t: float, y: Array) -> Array:
        """Accelerations (nv,) of a state."""
        rate = np.zeros(self.size)
        self.rates(t, y, rate)
        return rate[self.moving]


def torque_law(tau: Any, nv: int) -> tuple[Array, ControlLaw | None]:
    """Constant torques (nv,) and law of ``tau``: zeros with a law for a function, or the torques with None."""
    if tau is None:
        return np.zeros(nv), None
    if callable(tau):
        return np.zeros(nv), ControlLaw.from_function(tau, "tau", (nv,), ", a torque for each velocity")
    tau = arguments.finite(arguments.one(tau, "tau", nv), "tau", nv)
    return np.array(tau, float), None


def wrench_laws(robot: Robot, wrenches: Any) -> dict[str, ControlLaw]:
    """Laws by frame, from ``{frame: (m, f) or a function}``; the wrenches are by the world on the robot."""
    if wrenches is None:
        return {}
    if not isinstance(wrenches, Mapping):
        raise ShapeError("wrench_on_robot is a dict {frame: (m, f) or a function of (t, q, dq)}.")
    laws = {}
    for frame, wrench in wrenches.items():
        robot.model.frame(frame)
        what = f"the wrench at {frame!r}"
        if callable(wrench) and not isinstance(wrench, Wrench):
            laws[frame] = ControlLaw.from_function(wrench, what, (6,), ", (m, f), moment first")
        else:
            unlabelled = wrench_at(robot.model, frame, wrench)  # validates a label
            unlabelled = arguments.finite(arguments.one(unlabelled, what, 6), what, 6)
            F = np.array(unlabelled, float)
            laws[frame] = ControlLaw(lambda _t, _q, _dq, F=F: F, what, (6,), varies=False)  # type: ignore[misc]
    return laws
