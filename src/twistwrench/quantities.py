"""What a robot can be asked for: name, algorithm, arrays in and out, options. The table behind ``robot.kernel``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .algorithms import (
    constraints,
    coriolis,
    derivatives,
    energy,
    forward_dynamics,
    forward_kinematics,
    friction,
    inverse_dynamics,
    jacobians,
    mass_matrix,
    regressor,
    task_space,
)
from .derived import Chart, Derivative
from .errors import KernelError, UnknownNameError, ValueRangeError
from .model.model import Model
from .model.regroup import regrouped
from .model.varied import matching, moves_joints, varied
from .program.program import Program
from .program.trace import Trace, trace

__all__ = [
    "NEED_INVERSE",
    "QUANTITIES",
    "Quantity",
    "checked_options",
    "evaluated",
    "inputs_of",
    "options_of",
    "program_of",
    "program_of_several",
]


@dataclass(frozen=True)
class Quantity:
    """One row of the table: ``algorithm(model, *inputs, **options)`` gives ``output``."""

    algorithm: Callable[..., Any]
    inputs: tuple[str, ...]
    output: str
    options: tuple[str, ...] = ()
    felt: bool = False
    """Whether only what the joints feel counts, so that the model may be regrouped."""

    def shapes(self, model: Model) -> list[tuple[str, tuple[int, ...]]]:
        """Names and shapes of the inputs for one robot."""
        return [
            (name, (model.nq,) if name == "q" else (6,) if name == "wrench" else (model.nv,)) for name in self.inputs
        ]


def _quantity(algorithm: Callable[..., Any], inputs: str, output: str, *options: str) -> Quantity:
    return Quantity(algorithm, tuple(inputs.split()), output, options)


def _felt(algorithm: Callable[..., Any], inputs: str, output: str, *options: str) -> Quantity:
    return Quantity(algorithm, tuple(inputs.split()), output, options, felt=True)


QUANTITIES: Mapping[str, Quantity] = {
    "bias_forces": _felt(inverse_dynamics.bias_forces, "q dq", "h", "wrenches", "gravity"),
    "center_of_mass": _quantity(energy.center_of_mass, "q", "com"),
    "christoffel": _felt(coriolis.christoffel, "q", "gamma"),
    "closure_poses": _quantity(constraints.closure_poses, "q", "T", "constraints"),
    "com_jacobian": _quantity(energy.com_jacobian, "q", "J"),
    "constrained_dynamics": _felt(
        constraints.constrained_dynamics, "q dq tau", "ddq lambda pivots", "wrenches", "constraints"
    ),
    "constraint_bias": _quantity(constraints.constraint_bias, "q dq", "b", "constraints"),
    "constraint_jacobian": _quantity(constraints.constraint_jacobian, "q", "A", "constraints"),
    "coriolis_forces": _felt(inverse_dynamics.coriolis_forces, "q dq", "c"),
    "coriolis_matrix": _felt(coriolis.coriolis_matrix, "q dq", "C"),
    "forward_dynamics": _felt(forward_dynamics.forward_dynamics, "q dq tau", "ddq", "wrenches", "gravity"),
    "forward_kinematics": _quantity(forward_kinematics.forward_kinematics, "q", "T", "frame"),
    "frame_acceleration": _quantity(jacobians.frame_acceleration, "q dq ddq", "dV", "frame", "kind"),
    "frame_velocity": _quantity(jacobians.frame_velocity, "q dq", "V", "frame", "kind"),
    "drive_torques": _felt(inverse_dynamics.drive_torques, "q dq ddq", "gear rotor", "wrenches"),
    "friction_forces": _quantity(friction.friction_forces, "dq", "tau"),
    "friction_under_load": _quantity(friction.friction_forces, "dq load", "tau"),
    "gravity_forces": _felt(inverse_dynamics.gravity_forces, "q", "g", "wrenches", "gravity"),
    "holding_torques": _felt(inverse_dynamics.holding_torques, "q", "tau", "wrenches"),
    "forward_dynamics_derivatives": _felt(
        derivatives.forward_dynamics_derivatives, "q dq tau", "ddq_by_q ddq_by_dq ddq_by_tau", "wrenches"
    ),
    "inverse_dynamics_derivatives": _felt(
        derivatives.inverse_dynamics_derivatives, "q dq ddq", "tau_by_q tau_by_dq", "wrenches"
    ),
    "inverse_dynamics": _felt(inverse_dynamics.inverse_dynamics, "q dq ddq", "tau", "wrenches", "gravity"),
    "jacobian": _quantity(jacobians.jacobian, "q", "J", "frame", "kind"),
    "jacobian_derivative": _quantity(jacobians.jacobian_derivative, "q", "J_by_q", "frame", "kind"),
    "jacobian_rate": _quantity(jacobians.jacobian_rate, "q dq", "dJ", "frame", "kind"),
    "joint_wrenches": _quantity(inverse_dynamics.joint_wrenches, "q dq ddq", "F", "wrenches", "gravity"),
    "kinetic_energy": _quantity(energy.kinetic_energy, "q dq", "K"),
    "link_poses": _quantity(forward_kinematics.link_poses, "q", "T"),
    "mass_matrix": _felt(mass_matrix.mass_matrix, "q", "M"),
    "momentum": _quantity(energy.momentum, "q dq", "P"),
    "momentum_about_com": _quantity(energy.momentum_about_com, "q dq", "P"),
    "potential_energy": _quantity(energy.potential_energy, "q", "P"),
    "task_bias": _felt(task_space.task_bias, "q dq", "eta pivots", "frame", "kind", "rows"),
    "task_inertia": _felt(task_space.task_inertia, "q", "Lambda pivots", "frame", "kind", "rows"),
    "regressor": _quantity(regressor.regressor, "q dq ddq", "Y"),
    "torque_past_friction": _quantity(friction.torque_past_friction, "dq tau", "tau"),
    "wrench_torques": _quantity(jacobians.wrench_torques, "q wrench", "tau", "frame"),
}


NEED_INVERSE = (
    "constrained_dynamics",
    "forward_dynamics",
    "forward_dynamics_derivatives",
    "task_bias",
    "task_inertia",
)
"""The quantities that M⁻¹ is part of."""


_NEED_MASS = ("center_of_mass", "com_jacobian", "momentum_about_com")
"""The quantities that are divided by the mass of all moving bodies."""


def options_of(name: str) -> tuple[str, ...]:
    """The options a quantity takes; raises UnknownNameError."""
    if name not in QUANTITIES:
        raise UnknownNameError.of("quantity", name, QUANTITIES)
    return (*QUANTITIES[name].options, "parameters", *_OF_DERIVATIVES)


_OF_DERIVATIVES = ("by", "form", "mode", "values")


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
    if "kind" in allowed:
        full["kind"] = options.get("kind", "body")
        if full["kind"] not in jacobians.KINDS:
            raise UnknownNameError.of("kind", full["kind"], jacobians.KINDS)
    if "rows" in allowed:
        if model.nv == 0:
            raise KernelError(f"{name}: robot {model.name!r} has no joint that moves.")
        full["rows"] = task_space.row_numbers(options.get("rows"))
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
    if options.get("parameters"):
        given = options["parameters"]
        full["parameters"] = matching(model, (given,) if isinstance(given, str) else tuple(given))
    if name in _NEED_MASS:
        _require_mass(model, name, full.get("parameters", ()))
    if options.get("by") is not None:
        by, *how = (options.get(o, default) for o, default in zip(_OF_DERIVATIVES, _USUAL, strict=True))
        full["derivative"] = Derivative.of(name, tuple(_ports(model, name, full)), by, *how)
    elif asked := [option for option in _OF_DERIVATIVES if option in options and option != "by"]:
        raise KernelError(f"{name}: {asked[0]}= is of a derivative; name the inputs to differentiate by, as in by='q'.")
    return full


_USUAL = (None, "jacobian", "auto", False)


def _constraints(name: str, given: Any) -> tuple[constraints.Constraint, ...]:
    if not isinstance(given, tuple) or not given or not all(isinstance(c, constraints.Constraint) for c in given):
        raise KernelError(
            f"{name} needs constraints=(…,), a tuple of those of a closed robot: robot.close(…).constraints, "
            f"got {given!r}."
        )
    return given


def _require_plain_rates(model: Model) -> None:
    for body in model.bodies:
        if body.joint.kind in ("planar", "floating"):
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


def evaluated(quantity: Quantity, model: Model, arrays: Sequence[Any], options: Mapping[str, Any]) -> Any:
    """The quantity's algorithm on arrays of numbers or symbols: the usual inputs, a wrench per frame, gravity, parameters."""
    rest, usual = {k: v for k, v in options.items() if k != "derivative"}, len(quantity.inputs)
    if names := rest.pop("parameters", ()):
        model, arrays = varied(model, names, arrays[-1]), arrays[:-1]
    if frames := rest.pop("wrenches", ()):
        rest["wrenches"] = dict(zip(frames, arrays[usual : usual + len(frames)], strict=True))
    if rest.pop("gravity", None):
        model = replace(model, gravity=arrays[-1])
    return quantity.algorithm(model, *arrays[:usual], **rest)


def program_of(model: Model, name: str, options: Mapping[str, Any], *, regroup: bool = True) -> Program:
    """Trace one quantity of one robot. Wrench frames, if any, become further inputs after the usual ones; gravity and
    parameters follow where they are inputs.

    ``regroup=False`` leaves every inertia where the robot's file has it, to count what regrouping saves.
    """
    return program_of_several(model, {name: options}, regroup=regroup)


def program_of_several(model: Model, wanted: Mapping[str, Mapping[str, Any]], *, regroup: bool = True) -> Program:
    """Trace several quantities, ``{name: options}``, as one program, which does once what they share."""
    ports = {name: _ports(model, name, options) for name, options in wanted.items()}
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
                charts = {x: Chart.of(mine[x], model if x == "q" else None) for x in derivative.by}
                found = derivative.of_results(name, found, charts, {label: given[label] for label in more[name]})
            results.extend(found)
        return tuple(results)

    outputs: list[str] = []
    for name, options in wanted.items():
        own = QUANTITIES[name].output.split()
        outputs += options["derivative"].outputs(own) if "derivative" in options else own
    return trace(on_symbols, [(label, inputs[label]) for label in order], outputs)


def inputs_of(model: Model, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of what a kernel of one quantity takes, in its order."""
    ports = _ports(model, name, options) | _ports_of_derivative(model, name, options)
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
    ports, outputs = _ports(model, name, options), QUANTITIES[name].output.split()
    shapes: Any = [()] * len(outputs)
    if derivative.weighs:  # the shapes of results are known once they are there
        owner = Trace()
        found = evaluated(QUANTITIES[name], model, [owner.inputs(0, shape) for shape in ports.values()], options)
        shapes = [np.shape(x) for x in (found if isinstance(found, tuple) else (found,))]
        owner.forget()
    directions = {x: (model.nv,) if x == "q" else shape for x, shape in ports.items()}
    return derivative.inputs(directions, {f"{name} {o}": s for o, s in zip(outputs, shapes, strict=True)})


def _ports(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """The inputs of one quantity, in the order :func:`evaluated` wants them."""
    ports = dict(QUANTITIES[name].shapes(model))
    ports.update({f"wrench at {frame}": (6,) for frame in options.get("wrenches", ())})
    if "gravity" in options:
        ports["gravity"] = (3,)
    if names := options.get("parameters", ()):
        ports["parameters"] = (len(names),)
    return ports


def _model_for(model: Model, name: str, options: Mapping[str, Any], regroup: bool) -> Model:
    fixed = not moves_joints(model, options.get("parameters", ()))
    return regrouped(model) if QUANTITIES[name].felt and regroup and fixed else model
