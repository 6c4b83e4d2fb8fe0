"""Programs of quantities and of their derivatives, traced for one robot, with options checked.

The bridge between `program.differentiate`, which knows expressions, and configurations, which know robot.add.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypedDict

import numpy as np

from ..algorithms import constraints, kinematics, operational_space
from ..algorithms.kinematics import brackets, moving_parts
from ..errors import KernelError, UnknownNameError, ValueRangeError
from ..ir import autodiff
from ..ir.expr import Expr
from ..ir.program import Program
from ..ir.tracer import Trace, trace
from ..model.model import Model
from ..model.parameters import matching, moves_joints, regrouped, with_symbolic_parameters
from ..typing import Array
from .arguments import CONFIGURATIONS
from .quantities import QUANTITIES, Quantity, Shape

FORMS = ("jacobian", "along", "weighted", "hessian", "hessian_along")
"""∂f/∂x; (∂f/∂x) v; ∂(w·f)/∂x; ∂²f/∂x²; ∂²(w·f)/∂x² v."""
MODES = ("auto", "forward", "reverse")
LARGEST_RESULT = 500_000
LARGEST_WORK = 2_000_000
"""Largest number of results of one kernel, and of its operations: beyond, tracing takes minutes."""


@dataclass(frozen=True)
class Derivative:
    """Checked request for a derivative."""

    by: tuple[str, ...]
    form: str = "jacobian"
    mode: str = "auto"
    values: bool = False
    """True if the function's own results come first."""

    @classmethod
    def from_inputs(cls, what: str, inputs: Sequence[str], by: Any, form: Any, mode: Any, values: Any) -> Derivative:
        """By names of ``inputs``; raises UnknownNameError and KernelError. ``what`` is the function's name."""
        names = (by,) if isinstance(by, str) else tuple(by) if isinstance(by, Sequence) else ()
        if not names:
            raise KernelError(f"{what}: by={by!r} names no input. Name one or several of {', '.join(inputs)}.")
        for name in names:
            if name not in inputs:
                raise UnknownNameError.from_choices(f"input of {what}", name, inputs)
        if len(set(names)) < len(names):
            raise KernelError(f"{what}: an input is named twice in by={names}. Name each once.")
        for label, given, allowed in (("form", form, FORMS), ("mode", mode, MODES)):
            if given not in allowed:
                raise UnknownNameError.from_choices(f"{label} of a derivative", given, allowed)
        if mode != "auto" and form not in ("jacobian", "hessian"):
            raise KernelError(f"{what}: form={form!r} has one way to compute it; leave mode={mode!r} out.")
        return cls(names, form, mode, bool(values))

    @property
    def weighs(self) -> bool:
        """True if results are summed with weights."""
        return self.form in ("weighted", "hessian_along")

    def inputs(self, charts: Mapping[str, Shape], outputs: Mapping[str, Shape]) -> dict[str, Shape]:
        """Additional inputs: weights of the results and the direction; ``charts``: shapes of directions by input."""
        more: dict[str, Shape] = {}
        if self.weighs and list(outputs.values()) != [()]:  # one number is its own sum
            more.update({f"weight on {name}": shape for name, shape in outputs.items()})
        if self.form in ("along", "hessian_along"):
            more.update({f"along {name}": charts[name] for name in self.by})
        return more

    def outputs(self, names: Sequence[str]) -> list[str]:
        """Names of what comes out."""
        if self.form == "jacobian":
            found = [f"{out}_by_{name}" for out in names for name in self.by]
        elif self.form == "along":
            found = [f"{out}_along" for out in names]
        elif self.form == "hessian":
            found = [f"{out}_hessian" for out in names]
        else:
            found = [f"{self.form}_by_{name}" for name in self.by]
        return [*(names if self.values else ()), *found]

    def of_results(
        self, what: str, results: Sequence[Any], charts: Mapping[str, Chart], more: Mapping[str, Any]
    ) -> tuple[Array, ...]:
        """The derivatives of arrays of symbols or numbers, as :meth:`outputs` names them; ``more``: by :meth:`inputs`."""
        joined = Chart.joined([charts[name] for name in self.by])
        sizes = [math.prod(charts[name].shape) for name in self.by]
        symbols = (e for part in (joined.known, *(np.ravel(r) for r in results)) for e in part if isinstance(e, Expr))
        owner = next((e.trace for e in symbols), None) or Trace()
        results = [np.asarray(result, object) for result in results]
        flat = [owner.lift(e) for result in results for e in result.reshape(-1)]
        given = [x for name, x in more.items() if name.startswith("weight on ")]
        weights = [e for x in given for e in np.reshape(x, -1)] if given else [1.0]
        direction = [e for name, x in more.items() if name.startswith("along ") for e in np.reshape(x, -1)]
        self._check_size(what, flat, joined)
        if self.form == "along":
            rates = iter(autodiff.along(flat, joined.known, direction))
            found = [_filled(result.shape, [next(rates) for _ in range(result.size)]) for result in results]
        elif self.form in ("jacobian", "hessian"):
            J = autodiff.jacobian(flat, joined.known, sum(sizes), self.mode)
            whole = J if self.form == "jacobian" else _hessian(J, joined)
            found, first = [], 0
            for result in results:
                rows = whole[first : first + result.size]
                first += result.size
                if self.form == "hessian":
                    found.append(rows.reshape((*result.shape, *rows.shape[1:])))
                    continue
                parts = np.split(rows, np.cumsum(sizes)[:-1], axis=1)
                found += [
                    part.reshape((*result.shape, *charts[n].shape)) for n, part in zip(self.by, parts, strict=True)
                ]
        else:
            total = autodiff.gradient(flat, weights, joined.known, sum(sizes))
            if self.form == "hessian_along":
                total = _hessian_along(total, joined, direction)
            parts = np.split(total, np.cumsum(sizes)[:-1])
            found = [part.reshape(charts[n].shape) for n, part in zip(self.by, parts, strict=True)]
        return (*(results if self.values else ()), *found)

    def _check_size(self, what: str, flat: Sequence[Expr], chart: Chart) -> None:
        n, rows = math.prod(chart.shape), len(flat)
        size = {"jacobian": rows * n, "hessian": rows * n * n}.get(self.form, 0)
        advice = "Differentiate fewer results, by fewer inputs, or along a direction: form='along' or 'weighted'."
        if size > LARGEST_RESULT:
            raise KernelError(
                f"{what}: its {self.form} has {size} numbers, more than the {LARGEST_RESULT} one kernel may give. {advice}"
            )
        if size:
            counted = autodiff.work(flat, chart.known)
            effort = min(counted) if self.mode == "auto" else getattr(counted, self.mode)
            effort *= n if self.form == "hessian" else 1
            if effort > LARGEST_WORK:
                raise KernelError(
                    f"{what}: its {self.form} takes some {effort} operations, more than the {LARGEST_WORK} one kernel may "
                    f"take. {advice}"
                )


@dataclass(frozen=True)
class Chart:
    """Motion of an input along its directions, of that shape: known derivatives of expressions."""

    shape: Shape
    known: autodiff.Known
    brackets: Array | None = None
    """c with [a, b] = Σ c_abd d, where directions do not commute."""

    @classmethod
    def from_input(cls, x: Any, model: Model | None = None) -> Chart:
        """Each entry of x is a direction; of a robot's q, that of ``model``, each velocity, along robot.add."""
        if model is None:
            return cls(np.shape(x), {e: {k: e.trace.one} for k, e in enumerate(np.reshape(x, -1))})
        known: dict[Expr, dict[int, Expr]] = {}
        for part, slope in moving_parts(model, x):
            for e, row in zip(part.reshape(-1), slope.reshape(part.size, model.nv), strict=True):
                slopes = {k: e.trace.lift(d) for k, d in enumerate(row)}
                known[e] = {k: d for k, d in slopes.items() if d is not e.trace.zero}
                if e.op == "sub":  # the trace turns its operands round to negate it
                    known[-e] = {k: -d for k, d in known[e].items()}
        c = brackets(model)
        return cls((model.nv,), known, c if c.any() else None)

    @classmethod
    def joined(cls, charts: Sequence[Chart]) -> Chart:
        """Several inputs as one, their directions one after another."""
        n, first = sum(math.prod(chart.shape) for chart in charts), 0
        known: dict[Expr, dict[int, Expr]] = {}
        c = np.zeros((n, n, n)) if any(chart.brackets is not None for chart in charts) else None
        for chart in charts:
            last = first + math.prod(chart.shape)
            known.update({e: {first + k: d for k, d in row.items()} for e, row in chart.known.items()})
            if c is not None and chart.brackets is not None:
                c[first:last, first:last, first:last] = chart.brackets
            first = last
        return cls((n,), known, c)


# Twice along robot.add is, with L_a the derivative along a, L_b L_a f: the derivative along b of the gradient's entry a. It is
# not symmetric where directions do not commute: L_a L_b f - L_b L_a f = L_[a,b] f. Half of each is the second derivative of
# f(q ⊕ v) by v at v = 0, the exponential being even there: L_b L_a f + ½ L_[a,b] f.


def _hessian(J: Array, chart: Chart) -> Array:
    """Second derivatives from first ones (rows, n), symmetric; (rows, n, n)."""
    rows, n = J.shape
    H = np.full((rows, n, n), 0.0, object)
    for b in range(n):
        unit = [float(k == b) for k in range(n)]
        slopes = _filled((rows, b + 1), _along(J[:, : b + 1], chart, unit))
        for a in range(b + 1):
            turned = 0.0 if chart.brackets is None else 0.5 * (J @ chart.brackets[a, b].astype(object))
            H[:, a, b] = H[:, b, a] = slopes[:, a] + turned
    return H


def _hessian_along(gradient: Array, chart: Chart, direction: Sequence[Any]) -> Array:
    """The symmetric second derivative times the direction, from the gradient (n,); (n,)."""
    product = _filled(gradient.shape, _along(gradient, chart, direction))
    if chart.brackets is not None:
        for a, b, d in np.argwhere(chart.brackets):
            product[a] = product[a] + 0.5 * chart.brackets[a, b, d] * (direction[b] * gradient[d])
    return product


def _along(entries: Array, chart: Chart, direction: Sequence[Any]) -> list[Any]:
    """The derivatives of entries, some of which may be plain numbers, along a direction."""
    flat = entries.reshape(-1)
    places = [k for k, e in enumerate(flat) if isinstance(e, Expr)]
    found: list[Any] = [0.0] * flat.size
    for k, rate in zip(places, autodiff.along([flat[k] for k in places], chart.known, direction), strict=True):
        found[k] = rate
    return found


def _filled(shape: Shape, entries: Sequence[Any]) -> Array:
    """An object array; NumPy must not look into what is in it."""
    array = np.empty(math.prod(shape), object)
    array[:] = entries
    return array.reshape(shape)


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


OF_DERIVATIVES: Mapping[str, Any] = {"by": None, "form": "jacobian", "mode": "auto", "values": False}
"""Options of every quantity for its derivatives, with their defaults."""


def options_of(name: str) -> tuple[str, ...]:
    """Options of a quantity; raises UnknownNameError."""
    if name not in QUANTITIES:
        raise UnknownNameError.from_choices("quantity", name, QUANTITIES)
    own = QUANTITIES[name].options
    return (*own, *(["on_robot"] if "wrenches" in own else []), "parameters", *OF_DERIVATIVES)


def wanted(model: Model, names: Sequence[str], options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Each quantity with the options that are its own, checked."""
    if not names:
        raise UnknownNameError.from_choices("quantity", "", QUANTITIES)
    if len(set(names)) < len(names):
        raise KernelError(f"a quantity is asked for twice: {', '.join(names)}. Name each once.")
    if len(names) == 1:
        return {names[0]: checked_options(model, names[0], options)}
    takes = {n: options_of(n) for n in names}
    for option in options:
        if not any(option in mine for mine in takes.values()):
            raise KernelError(f"none of {', '.join(names)} takes an option {option!r}.")
    return {n: checked_options(model, n, {k: v for k, v in options.items() if k in mine}) for n, mine in takes.items()}


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
                    f"no kind named {str(full['kind'])!r}: what Pinocchio calls so is kind={meant!r}, with angular rows first."
                )
            raise UnknownNameError.from_choices("kind", full["kind"], kinematics.KINDS)
    if "rows" in allowed:
        if model.nv == 0:
            raise KernelError(f"{name}: robot {model.name!r} has no joint that moves.")
        full["rows"] = operational_space.row_numbers(options.get("rows"))
    if "constraints" in allowed:
        full["constraints"] = _constraints(name, options.get("constraints", ()))
    if "wrenches" in allowed:
        frames = options.get("wrenches", ())
        if not isinstance(frames, str | Sequence):
            raise KernelError(f"{name}: wrenches={frames!r} is not allowed. Give the names of frames.")
        full["wrenches"] = (frames,) if isinstance(frames, str) else tuple(frames)
        for frame in full["wrenches"]:
            model.frame(frame)
        if len(set(full["wrenches"])) < len(full["wrenches"]):
            raise KernelError(
                f"{name}: a frame is named twice in wrenches={full['wrenches']}. Add its wrenches up first."
            )
        if on_robot := options.get("on_robot", ()):
            on_robot = (on_robot,) if isinstance(on_robot, str) else tuple(on_robot)
            if stray := [frame for frame in on_robot if frame not in full["wrenches"]]:
                raise KernelError(f"{name}: on_robot names {stray[0]!r}, which is not in wrenches={full['wrenches']}.")
            full["on_robot"] = on_robot
    if options.get("parameters"):
        given = options["parameters"]
        full["parameters"] = matching(model, (given,) if isinstance(given, str) else tuple(given))
    if QUANTITIES[name].needs_mass:
        _require_mass(model, name, full.get("parameters", ()))
    if options.get("by") is not None:
        by, form, mode, values = (options.get(option, usual) for option, usual in OF_DERIVATIVES.items())
        full["derivative"] = Derivative.from_inputs(
            name, tuple(input_shapes(model, name, full)), by, form, mode, values
        )
    elif asked := [option for option in OF_DERIVATIVES if option in options and option != "by"]:
        raise KernelError(f"{name}: {asked[0]}= is of a derivative; name the inputs to differentiate by, as in by='q'.")
    return full


def _constraints(name: str, given: Any) -> tuple[constraints.Constraint, ...]:
    if not isinstance(given, tuple) or not given or not all(isinstance(c, constraints.Constraint) for c in given):
        raise KernelError(
            f"{name} needs constraints=(…,), a tuple of those of a closed robot: robot.close(…).constraints, "
            f"got {given!r}."
        )
    return given


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
        links = ", ".join([body.link for body in model.bodies][:12]) + (", …" if len(model.bodies) > 12 else "")
        raise ValueRangeError(
            f"{name}: no moving body of robot {model.name!r} has mass ({links}), so there is no centre of mass. Give "
            "their links an inertial in the file, or a payload: robot.with_payload(…)."
        )


def input_shapes(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, Shape]:
    """The inputs of one quantity, in the order its algorithm wants them."""
    ports = dict(QUANTITIES[name].shapes(model))
    ports.update({f"wrench at {frame}": (6,) for frame in options.get("wrenches", ())})
    if "gravity" in options:
        ports["gravity"] = (3,)
    if names := options.get("parameters", ()):
        ports["parameters"] = (len(names),)
    return ports


# ── Traced programs of quantities


def evaluated(quantity: Quantity, model: Model, arrays: Sequence[Any], options: Mapping[str, Any]) -> Any:
    """The quantity's algorithm on arrays of numbers or symbols: the usual inputs, a wrench per frame, gravity, parameters."""
    rest, usual = {k: v for k, v in options.items() if k != "derivative"}, len(quantity.inputs)
    if names := rest.pop("parameters", ()):
        model, arrays = with_symbolic_parameters(model, names, arrays[-1]), arrays[:-1]
    if frames := rest.pop("wrenches", ()):
        on_robot = rest.pop("on_robot", ())
        given = zip(frames, arrays[usual : usual + len(frames)], strict=True)
        rest["wrenches"] = {frame: -F if frame in on_robot else F for frame, F in given}
    if rest.pop("gravity", None):
        model = replace(model, gravity=arrays[-1])
    return quantity.algorithm(model, *arrays[:usual], **rest)


def program_of(model: Model, name: str, options: Mapping[str, Any], *, regroup: bool = True) -> Program:
    """Trace one quantity of one robot.

    Wrench frames, if any, become further inputs after the usual ones; gravity and parameters follow where they are inputs.
    ``regroup=False`` leaves every inertia where the robot's file has it, to count what regrouping saves.
    """
    return program_of_several(model, {name: options}, regroup=regroup)


def program_of_several(model: Model, wanted: Mapping[str, Mapping[str, Any]], *, regroup: bool = True) -> Program:
    """Trace several quantities, ``{name: options}``, as one program, which does once what they share."""
    ports = {name: input_shapes(model, name, options) for name, options in wanted.items()}
    more = {name: _ports_of_derivative(model, name, options) for name, options in wanted.items()}
    inputs = {label: shape for mine in (*ports.values(), *more.values()) for label, shape in mine.items()}
    order = _in_order(inputs)
    models = {name: _model_for(model, name, options, regroup) for name, options in wanted.items()}

    def on_symbols(*arrays: Any) -> tuple[Any, ...]:
        given = dict(zip(order, arrays, strict=True))
        results: list[Any] = []
        for name, options in wanted.items():
            mine = {label: given[label] for label in ports[name]}
            found = evaluated(QUANTITIES[name], models[name], list(mine.values()), options)
            found = found if isinstance(found, tuple) else (found,)
            if derivative := options.get("derivative"):
                charts = {x: Chart.from_input(mine[x], model if x in CONFIGURATIONS else None) for x in derivative.by}
                found = derivative.of_results(name, found, charts, {label: given[label] for label in more[name]})
            results.extend(found)
        return tuple(results)

    outputs: list[str] = []
    for name, options in wanted.items():
        own = QUANTITIES[name].outputs
        outputs += options["derivative"].outputs(own) if "derivative" in options else own
    return trace(on_symbols, [(label, inputs[label]) for label in order], outputs)


def inputs_of(model: Model, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of the inputs of one quantity's kernel, in its order."""
    ports = input_shapes(model, name, options) | _ports_of_derivative(model, name, options)
    return [(label, ports[label]) for label in _in_order(ports)]


def _in_order(labels: Iterable[str]) -> list[str]:
    """The usual inputs, weights and directions of derivatives, wrenches, gravity, parameters."""
    last = ("gravity", "parameters")
    return sorted(labels, key=lambda label: (label in last, label.startswith("wrench at")))


def _ports_of_derivative(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """The inputs that a derivative has besides."""
    derivative = options.get("derivative")
    if derivative is None:
        return {}
    ports, outputs = input_shapes(model, name, options), QUANTITIES[name].outputs
    shapes: Any = [()] * len(outputs)
    if derivative.weighs:  # the shapes of results are known once they are there
        owner = Trace()
        found = evaluated(QUANTITIES[name], model, [owner.inputs(0, shape) for shape in ports.values()], options)
        shapes = [np.shape(x) for x in (found if isinstance(found, tuple) else (found,))]
        owner.forget()
    directions = {x: (model.nv,) if x in CONFIGURATIONS else shape for x, shape in ports.items()}
    return derivative.inputs(directions, {f"{name} {o}": s for o, s in zip(outputs, shapes, strict=True)})


def _model_for(model: Model, name: str, options: Mapping[str, Any], regroup: bool) -> Model:
    fixed = not moves_joints(model, options.get("parameters", ()))
    return regrouped(model) if QUANTITIES[name].felt and regroup and fixed else model
