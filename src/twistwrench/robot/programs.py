"""Programs of quantities, traced for one robot with options checked; loops and LAPACK for those of large robots."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from ..compiler.ir.loops import AFTER, BEFORE, NEITHER, ColumnGroup, ColumnSolve, Product, Products
from ..compiler.ir.program import Program
from ..compiler.ir.tracer import Trace, trace
from ..core.errors import KernelError, UnknownNameError, ValueRangeError
from ..core.typing import Array
from ..mechanics.algorithms import constraints, forward_dynamics, kinematics
from ..mechanics.algorithms.forward_dynamics import accelerations, torque_derivatives_and_factors
from ..mechanics.model.model import Model
from ..mechanics.model.parameters import matching, moves_joints, regrouped, with_symbolic_parameters
from .arguments import CONFIGURATIONS
from .differentiate import Chart, Derivative
from .quantities import QUANTITIES, Quantity, Shape, other_name_hint

if TYPE_CHECKING:
    from .engine import Engine

# ── Options of a quantity: defaults, frames, joints, derivatives


class KernelOptions(TypedDict, total=False):
    """Options of :meth:`twistwrench.Robot.kernel`."""

    frame: str | None
    kind: Literal["body", "space", "world_aligned"]
    rows: Any
    wrenches: str | Sequence[str]
    on_robot: str | Sequence[str]
    gravity: Literal["input"] | None
    friction: bool
    parameters: str | Sequence[str]
    constraints: tuple[constraints.Constraint, ...]
    by: str | Sequence[str] | None
    form: Literal["jacobian", "along", "weighted", "hessian", "hessian_along"]
    mode: Literal["auto", "forward", "reverse"]
    values: bool


DERIVATIVE_OPTIONS: Mapping[str, Any] = {"by": None, "form": "jacobian", "mode": "auto", "values": False}
"""Derivative options of every quantity, with defaults."""

_MAX_LISTED_LINKS = 12


def options_of(name: str) -> tuple[str, ...]:
    """Options of a quantity; raises UnknownNameError."""
    if name not in QUANTITIES:
        if hint := other_name_hint(str(name)):
            raise UnknownNameError(f"no quantity named {name!r}: {hint}.")
        raise UnknownNameError.from_choices("quantity", name, QUANTITIES)
    own = QUANTITIES[name].options
    on_robot = ("on_robot",) if "wrenches" in own else ()
    return (*own, *on_robot, "parameters", *DERIVATIVE_OPTIONS)


def options_by_quantity(model: Model, names: Sequence[str], options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Each quantity with the options that apply to it, validated."""
    if not names:
        raise UnknownNameError.from_choices("quantity", "", QUANTITIES)
    if len(set(names)) < len(names):
        raise KernelError(f"a quantity is given twice: {', '.join(names)}. Name each once.")
    if len(names) == 1:
        return {names[0]: checked_options(model, names[0], options)}
    allowed = {name: options_of(name) for name in names}
    for option in options:
        if all(option not in own for own in allowed.values()):
            raise KernelError(f"none of {', '.join(names)} takes an option {option!r}.")
    checked = {}
    for name, own in allowed.items():
        applicable = {option: value for option, value in options.items() if option in own}
        checked[name] = checked_options(model, name, applicable)
    return checked


def checked_options(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with defaults filled in, frames resolved and kinds checked."""
    allowed = options_of(name)
    for option in options:
        if option not in allowed:
            raise KernelError(f"{name} takes no option {option!r}; it takes {', '.join(allowed)}.")
    if name == "christoffel":
        _require_plain_rates(model)
    full: dict[str, Any] = {}
    if "frame" in allowed:
        frame = options.get("frame")
        model.frame(frame)
        full["frame"] = model.tip if frame is None else frame
    if options.get("gravity") is not None:
        if not isinstance(options["gravity"], str) or options["gravity"] != "input":
            raise KernelError(
                f"{name}: gravity={options['gravity']!r} is not allowed. 'input' makes gravity the kernel's last input; "
                "for another constant one, robot.with_gravity."
            )
        full["gravity"] = "input"
    if options.get("friction"):
        full["friction"] = True
    if "kind" in allowed:
        full["kind"] = options.get("kind", "body")
        if full["kind"] not in kinematics.KINDS:
            if meant := kinematics.PINOCCHIO.get(str(full["kind"]).upper()):
                raise UnknownNameError(
                    f"no kind named {str(full['kind'])!r}: Pinocchio's name for kind={meant!r}, which has angular rows first."
                )
            raise UnknownNameError.from_choices("kind", full["kind"], kinematics.KINDS)
    if "rows" in allowed:
        if model.nv == 0:
            raise KernelError(f"{name}: robot {model.name!r} has no joint that moves.")
        full["rows"] = kinematics.row_numbers(options.get("rows"))
    if "constraints" in allowed:
        full["constraints"] = _constraints(name, options.get("constraints", ()))
    if "wrenches" in allowed:
        full |= _wrench_options(model, name, options)
    if options.get("parameters"):
        full["parameters"] = matching(model, _names_tuple(options["parameters"]))
    if QUANTITIES[name].needs_mass:
        _require_mass(model, name, full.get("parameters", ()))
    without_inputs = [option for option in DERIVATIVE_OPTIONS if option in options and option != "by"]
    if options.get("by") is not None:
        by, form, mode, values = (options.get(option, usual) for option, usual in DERIVATIVE_OPTIONS.items())
        full["derivative"] = Derivative.from_inputs(
            name, tuple(input_shapes(model, name, full)), by, form, mode, values
        )
    elif without_inputs:
        raise KernelError(
            f"{name}: {without_inputs[0]}= is of a derivative; name the inputs to differentiate by, as in by='q'."
        )
    return full


def _names_tuple(names: str | Sequence[str]) -> tuple[str, ...]:
    """One name or several, as a tuple."""
    return (names,) if isinstance(names, str) else tuple(names)


def _wrench_options(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Frames of the wrenches, and those of the wrenches applied by the world."""
    wrenches = options.get("wrenches", ())
    if not isinstance(wrenches, str | Sequence):
        raise KernelError(f"{name}: wrenches={wrenches!r} is not allowed. Give the names of frames.")
    frames = _names_tuple(wrenches)
    on_robot = _names_tuple(options.get("on_robot") or ())
    for frame in frames:
        model.frame(frame)
    if len(set(frames)) < len(frames):
        raise KernelError(f"{name}: a frame is named twice in wrenches={frames}. Add its wrenches up first.")
    if stray := [frame for frame in on_robot if frame not in frames]:
        raise KernelError(f"{name}: on_robot names {stray[0]!r}, which is not in wrenches={frames}.")
    return {"wrenches": frames, "on_robot": on_robot} if on_robot else {"wrenches": frames}


def _constraints(name: str, value: Any) -> tuple[constraints.Constraint, ...]:
    if not isinstance(value, tuple) or not value or not all(isinstance(c, constraints.Constraint) for c in value):
        raise KernelError(
            f"{name} needs constraints=(…,), a tuple of those of a closed robot: robot.close(…).constraints, "
            f"got {value!r}."
        )
    return value


def _require_plain_rates(model: Model) -> None:
    for body in model.bodies:
        if not body.joint.plain_rates:
            raise ValueRangeError(
                f"Christoffel symbols need coordinates whose rates are the velocities; joint {body.joint.name!r} is "
                f"{body.joint.kind}. coriolis_matrix works on every robot."
            )


def _require_mass(model: Model, name: str, parameters: Sequence[str]) -> None:
    if not model.bodies or any(x.endswith(".mass") for x in parameters):
        return
    if all(body.inertia.mass == 0 for body in model.bodies):
        links = [body.link for body in model.bodies]
        if len(links) > _MAX_LISTED_LINKS:
            links = [*links[:_MAX_LISTED_LINKS], "…"]
        raise ValueRangeError(
            f"{name}: no moving body of robot {model.name!r} has mass ({', '.join(links)}), so there is no centre of mass. "
            "Give their links an inertial in the file, or a payload: robot.with_payload(…)."
        )


def input_shapes(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, Shape]:
    """Inputs of one quantity, in the order of its algorithm."""
    ports = dict(QUANTITIES[name].shapes(model))
    ports.update({f"wrench at {frame}": (6,) for frame in options.get("wrenches", ())})
    if "gravity" in options:
        ports["gravity"] = (3,)
    if names := options.get("parameters", ()):
        ports["parameters"] = (len(names),)
    return ports


# ── Traced programs of quantities


def evaluate_quantity(quantity: Quantity, model: Model, arrays: Sequence[Any], options: Mapping[str, Any]) -> Any:
    """The quantity's algorithm on arrays of numbers or symbols: usual inputs, a wrench per frame, gravity, parameters."""
    own_options = {option: value for option, value in options.items() if option != "derivative"}
    usual = len(quantity.inputs)
    if names := own_options.pop("parameters", ()):
        model = with_symbolic_parameters(model, names, arrays[-1])
        arrays = arrays[:-1]
    if frames := own_options.pop("wrenches", ()):
        on_robot = own_options.pop("on_robot", ())
        wrenches = zip(frames, arrays[usual : usual + len(frames)], strict=True)
        own_options["wrenches"] = {frame: -F if frame in on_robot else F for frame, F in wrenches}
    if own_options.pop("gravity", None):
        model = replace(model, gravity=arrays[-1])
    return quantity.algorithm(model, *arrays[:usual], **own_options)


def _result_tuple(returned: Any) -> tuple[Any, ...]:
    """Results of an algorithm that returns one or several."""
    return returned if isinstance(returned, tuple) else (returned,)


def program_of(model: Model, name: str, options: Mapping[str, Any], *, regroup: bool = True) -> Program:
    """Trace one quantity of one robot.

    Wrenches, if any, become further inputs after the usual ones, then gravity and parameters if these are inputs.
    ``regroup=False`` disables base-parameter regrouping, to count the operations it saves.
    """
    return program_of_several(model, {name: options}, regroup=regroup)


def program_of_several(model: Model, requested: Mapping[str, Mapping[str, Any]], *, regroup: bool = True) -> Program:
    """Trace several quantities, ``{name: options}``, as one program with common subexpressions."""
    ports = {name: input_shapes(model, name, options) for name, options in requested.items()}
    derivative_ports = {name: _ports_of_derivative(model, name, options) for name, options in requested.items()}
    inputs: dict[str, Shape] = {}
    for shapes in (*ports.values(), *derivative_ports.values()):
        inputs |= shapes
    order = _input_order(inputs)
    models = {name: _model_for(model, name, options, regroup) for name, options in requested.items()}

    def results(*arrays: Any) -> tuple[Any, ...]:
        values = dict(zip(order, arrays, strict=True))
        all_results: list[Any] = []
        for name, options in requested.items():
            arguments = {label: values[label] for label in ports[name]}
            own_results = _result_tuple(
                evaluate_quantity(QUANTITIES[name], models[name], list(arguments.values()), options)
            )
            if derivative := options.get("derivative"):
                charts = {}
                for label in derivative.by:
                    charts[label] = Chart.from_input(arguments[label], model if label in CONFIGURATIONS else None)
                weights_and_directions = {label: values[label] for label in derivative_ports[name]}
                own_results = derivative.derive(name, own_results, charts, weights_and_directions)
            all_results.extend(own_results)
        return tuple(all_results)

    outputs: list[str] = []
    for name, options in requested.items():
        own = QUANTITIES[name].outputs
        outputs += options["derivative"].outputs(own) if "derivative" in options else own
    return trace(results, [(label, inputs[label]) for label in order], outputs)


def inputs_of(model: Model, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of the inputs of one quantity's kernel, in order."""
    ports = input_shapes(model, name, options) | _ports_of_derivative(model, name, options)
    return [(label, ports[label]) for label in _input_order(ports)]


def _input_order(labels: Iterable[str]) -> list[str]:
    """Usual inputs, weights and directions of derivatives, wrenches, gravity, parameters."""
    last = ("gravity", "parameters")
    return sorted(labels, key=lambda label: (label in last, label.startswith("wrench at")))


def _ports_of_derivative(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Additional inputs of a derivative."""
    derivative = options.get("derivative")
    if derivative is None:
        return {}
    ports, outputs = input_shapes(model, name, options), QUANTITIES[name].outputs
    shapes: Any = [()] * len(outputs)
    if derivative.weighs:  # shapes of results are known only after tracing
        owner = Trace()
        symbols = [owner.inputs(0, shape) for shape in ports.values()]
        results = _result_tuple(evaluate_quantity(QUANTITIES[name], model, symbols, options))
        shapes = [np.shape(x) for x in results]
        owner.forget()
    directions = {x: (model.nv,) if x in CONFIGURATIONS else shape for x, shape in ports.items()}
    return derivative.inputs(directions, {f"{name} {o}": s for o, s in zip(outputs, shapes, strict=True)})


def _model_for(model: Model, name: str, options: Mapping[str, Any], regroup: bool) -> Model:
    fixed = not moves_joints(model, options.get("parameters", ()))
    return regrouped(model) if QUANTITIES[name].felt and regroup and fixed else model


# ── Kernels of large robots: forward-dynamics derivatives by column loops or LAPACK, and matrices by loops over joints

# Unrolled, the solutions are half of all instructions; a humanoid's 60,000 instructions exceed processor caches.

COLUMN_LOOP_FROM = 20
"""Number of pairs of a velocity and one of a joint it carries, from which a loop is faster (bench/NOTES.md)."""

FORWARD_DERIVATIVES = "forward_dynamics_derivatives"


def _is_alone(requested: Mapping[str, Mapping[str, Any]], name: str) -> bool:
    """True if only this quantity is requested, with no options but wrenches."""
    return tuple(requested) == (name,) and set(requested[name]) <= {"wrenches"}


def columns_of(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> ColumnSolve | None:
    """Program and its columns; None for short programs and other quantities."""
    if not _is_alone(requested, FORWARD_DERIVATIVES):
        return None
    carries, bodies = forward_dynamics.relations(model)
    if int((carries & (bodies[:, None] != bodies)).sum()) < COLUMN_LOOP_FROM:
        return None
    quantity = replace(QUANTITIES[FORWARD_DERIVATIVES], algorithm=torque_derivatives_and_factors)
    regrouped_model, options = regrouped(model), requested[FORWARD_DERIVATIVES]

    def parts(*arrays: Array) -> Any:
        return evaluate_quantity(quantity, regrouped_model, list(arrays), options)

    program = trace(parts, inputs_of(model, FORWARD_DERIVATIVES, options), [*quantity.outputs, "W", "D"])
    return ColumnSolve(program, 2, tuple(_groups(program, model.nv)))


def _groups(program: Program, n: int) -> list[ColumnGroup]:
    """Nonzero columns of ∂τ, grouped by the rows in which they are nonzero."""
    nonzero = ~np.array(program.zeros[: 2 * n * n]).reshape(2, n, n)
    columns_by_rows: dict[tuple[bool, ...], list[tuple[int, int]]] = {}
    for matrix, column in np.argwhere(nonzero.any(axis=1)).tolist():
        rows = tuple(nonzero[matrix, :, column].tolist())
        columns_by_rows.setdefault(rows, []).append((matrix, column))
    factor = [program.instructions[r] for r in program.results[3 * n * n : 4 * n * n]]
    varies = np.array([x.op != "const" for x in factor]).reshape(n, n)
    constant = np.array([x.value for x in factor]).reshape(n, n)

    def solution(rows: tuple[bool, ...]) -> Program:
        def solve(W: Array, D: Array, x: Array) -> Array:
            return accelerations(np.where(varies, W, constant), D, np.where(rows, x, 0.0))

        return trace(solve, [("W", (n, n)), ("D", (n,)), ("x", (n,))], ["solution"])

    return [ColumnGroup(solution(rows), tuple(columns)) for rows, columns in columns_by_rows.items()]


# ── ∂q̈/∂(q, q̇, τ) by LAPACK: M ∂q̈/∂x = -∂τ/∂x

# Unrolled, the solutions alone take about 2 nv³ operations a state: 3.4 million instructions for a chain of 100 links,
# beyond the limit of a trace.

LAPACK_FROM = 64
"""Number of velocities from which derivatives are computed by LAPACK; unrolled, they would take a million operations."""


def needs_lapack(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> bool:
    """True for derivatives that would be too long unrolled."""
    return _is_alone(requested, FORWARD_DERIVATIVES) and model.nv >= LAPACK_FROM


class LapackDerivatives:
    """Callable like the kernel of ``forward_dynamics_derivatives``: broadcasting, ``out=``, float32 in and out."""

    def __init__(self, engine: Engine, options: Mapping[str, Any]) -> None:
        self._mass = engine.kernel(["mass_matrix"], {})
        self._acceleration = engine.kernel(["forward_dynamics"], options)
        self._torque_derivatives = engine.kernel(["inverse_dynamics_derivatives"], options)
        self.__name__ = FORWARD_DERIVATIVES
        self.__doc__ = f"{FORWARD_DERIVATIVES} of {engine.model.name}, from its mass matrix and ∂τ."
        n = engine.model.nv
        inputs = str(self._acceleration.signature).split("->")[0]
        self.signature = f"{inputs}->({n},{n}),({n},{n}),({n},{n})"
        self.nin, self.nout = self._acceleration.nin, 3

    def __repr__(self) -> str:
        return f"<LapackDerivatives {self.signature}>"

    def __call__(self, *args: ArrayLike, out: tuple[Array, Array, Array] | None = None) -> tuple[Array, ...]:
        """Evaluate on arrays whose last axes match the signature."""
        ddq = self._acceleration(*args)  # validates the arguments, as all kernels do
        q, dq, _, *wrenches = args
        by_q, by_dq = self._torque_derivatives(q, dq, ddq, *wrenches)
        inverse = _inverse(self._mass(q).astype(ddq.dtype, copy=False))
        results = -(inverse @ by_q), -(inverse @ by_dq), np.broadcast_to(inverse, by_q.shape)
        if out is None:
            return results[0], results[1], results[2].copy()
        for target, result in zip(out, results, strict=True):
            target[...] = result
        return out


def _inverse(M: Array) -> Array:
    """M⁻¹, or NaN for singular M: one singular state must not affect the others."""
    try:
        return np.linalg.inv(M)
    except np.linalg.LinAlgError:
        inverses = np.full_like(M, np.nan)
        for state in np.ndindex(M.shape[:-2]):
            if np.linalg.matrix_rank(M[state]) == M.shape[-1]:
                inverses[state] = np.linalg.inv(M[state])
        return inverses


# ── Matrices of long robots by loops over pairs of joints

PAIR_LOOP_FROM = 100_000
"""Instruction count of an unrolled program above which loops replace it (bench/NOTES.md)."""

MAX_OVERESTIMATE = 3
"""Largest factor by which the estimate exceeds the instructions of the unrolled program; it is never much too low."""


@dataclass(frozen=True)
class _Looped:
    """One quantity: the products that compose it, and its estimated length when unrolled."""

    factors: Callable[..., tuple[Array, ...]]
    before: tuple[tuple[int, int], ...]
    after: tuple[tuple[int, int], ...]
    """By matrix, the factors of entries whose row's joint carries the column's, and of all other entries."""
    added: tuple[Callable[[Model], Array] | None, ...]
    """By matrix, its constant part."""
    symmetric: bool
    for_a_joint: int
    for_a_pair: int
    """Instructions per velocity, and per pair of one velocity and another that it carries."""


_LOOPED = {
    "mass_matrix": _Looped(
        forward_dynamics.mass_matrix_factors, ((0, 1),), ((2, 3),), (forward_dynamics.constant_mass,), True, 60, 27
    ),
    "inverse_dynamics_derivatives": _Looped(
        forward_dynamics.derivative_factors, ((0, 1), (0, 2)), ((3, 4), (3, 5)), (forward_dynamics.constant_stiffness, None),
        False, 230, 106,
    ),
}  # fmt: skip


def products_of(model: Model, requested: Mapping[str, Mapping[str, Any]]) -> Products | Program | None:
    """Loops for one quantity; its unrolled program if that is short enough; None for other quantities."""
    (name, options), *_ = requested.items()
    looped = _LOOPED.get(name)
    if looped is None or not _is_alone(requested, name):
        return None
    from ..compiler.lowering.product_loop import MIN_MATRIX_SIZE

    if model.nv < MIN_MATRIX_SIZE or not forward_dynamics.applies(model):
        return None
    carries, bodies = forward_dynamics.relations(model)
    estimated = looped.for_a_joint * model.nv + looped.for_a_pair * int(carries.sum())
    if estimated < PAIR_LOOP_FROM:
        return None
    if estimated < MAX_OVERESTIMATE * PAIR_LOOP_FROM:
        unrolled = program_of_several(model, requested)
        if len(unrolled.instructions) < PAIR_LOOP_FROM:
            return unrolled
    below = carries.T
    if looped.symmetric:  # of two velocities of one body, each pair once
        same_body = bodies[:, None] == bodies
        below = below & ~(same_body & np.triu(np.ones_like(same_body), 1))
    relations = np.where(below, AFTER, np.where(carries, BEFORE, NEITHER))
    quantity, regrouped_model = replace(QUANTITIES[name], algorithm=looped.factors), regrouped(model)

    def factors(*arrays: Array) -> Any:
        return evaluate_quantity(quantity, regrouped_model, list(arrays), options)

    count = len(set(chain(*looped.before, *looped.after)))
    program = trace(factors, inputs_of(model, name, options), [f"factor {k}" for k in range(count)])
    matrices = []
    for output, before, after, added in zip(quantity.outputs, looped.before, looped.after, looped.added, strict=True):
        constant = np.zeros((model.nv, model.nv)) if added is None else added(regrouped_model)
        entries = tuple((int(r), int(c), float(constant[r, c])) for r, c in np.argwhere(constant))
        matrices.append(Product(output, before, after, entries))
    return Products(program, tuple(matrices), tuple(map(tuple, relations.tolist())))
