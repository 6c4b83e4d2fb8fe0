"""Options of a quantity: defaults, frames, joints, derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

from ...core.errors import KernelError, UnknownNameError, ValueRangeError
from ...mechanics.algorithms import constraints, kinematics
from ...mechanics.model.model import Model
from ...mechanics.model.parameters import matching
from ..differentiate import Derivative
from ..quantities import QUANTITIES, Shape, other_name_hint


class KernelOptions(TypedDict, total=False):
    """Options of :meth:`twistwrench.Robot.kernel`, which explains them."""

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
"""Largest number of links that an error message names."""


def options_of(name: str) -> tuple[str, ...]:
    """Names of the options of a quantity; raises UnknownNameError."""
    if name not in QUANTITIES:
        hint = other_name_hint(str(name))
        if hint:
            raise UnknownNameError(f"no quantity named {name!r}: {hint}.")
        raise UnknownNameError.from_choices("quantity", name, QUANTITIES)
    own_options = QUANTITIES[name].options
    on_robot = ("on_robot",) if "wrenches" in own_options else ()
    return (*own_options, *on_robot, "parameters", *DERIVATIVE_OPTIONS)


def options_by_quantity(model: Model, names: Sequence[str], options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Validated options that apply to each quantity, by name of the quantity."""
    if not names:
        raise UnknownNameError.from_choices("quantity", "", QUANTITIES)
    if len(set(names)) < len(names):
        raise KernelError(f"a quantity is given twice: {', '.join(names)}. Name each once.")
    if len(names) == 1:
        return {names[0]: checked_options(model, names[0], options)}
    allowed_by_quantity = {name: options_of(name) for name in names}
    for option in options:
        is_unknown = all(option not in allowed_options for allowed_options in allowed_by_quantity.values())
        if is_unknown:
            raise KernelError(f"none of {', '.join(names)} takes an option {option!r}.")
    options_of_quantities = {}
    for name, allowed_options in allowed_by_quantity.items():
        applicable = {option: value for option, value in options.items() if option in allowed_options}
        options_of_quantities[name] = checked_options(model, name, applicable)
    return options_of_quantities


def checked_options(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with defaults filled in, frames resolved and kinds checked."""
    allowed_options = options_of(name)
    for option in options:
        if option not in allowed_options:
            raise KernelError(f"{name} takes no option {option!r}; it takes {', '.join(allowed_options)}.")
    if name == "christoffel":
        _require_plain_rates(model)
    complete_options: dict[str, Any] = {}
    if "frame" in allowed_options:
        frame = options.get("frame")
        model.frame(frame)  # only for its error
        complete_options["frame"] = model.tip if frame is None else frame
    if options.get("gravity") is not None:
        gravity = options["gravity"]
        is_input = isinstance(gravity, str) and gravity == "input"  # an array has no single truth value
        if not is_input:
            raise KernelError(
                f"{name}: gravity={gravity!r} is not allowed. 'input' makes gravity the kernel's last input; "
                "for another constant one, robot.with_gravity."
            )
        complete_options["gravity"] = "input"
    if options.get("friction"):
        complete_options["friction"] = True
    if "kind" in allowed_options:
        complete_options["kind"] = _checked_kind(options.get("kind", "body"))
    if "rows" in allowed_options:
        if model.nv == 0:
            raise KernelError(f"{name}: robot {model.name!r} has no joint that moves.")
        complete_options["rows"] = kinematics.row_numbers(options.get("rows"))
    if "constraints" in allowed_options:
        complete_options["constraints"] = _constraints(name, options.get("constraints", ()))
    if "wrenches" in allowed_options:
        complete_options |= _wrench_options(model, name, options)
    if options.get("parameters"):
        complete_options["parameters"] = matching(model, _names_tuple(options["parameters"]))
    if QUANTITIES[name].needs_mass:
        _require_mass(model, name, complete_options.get("parameters", ()))
    options_of_derivative = [option for option in DERIVATIVE_OPTIONS if option in options and option != "by"]
    if options.get("by") is not None:
        derivative_options = {**DERIVATIVE_OPTIONS, **options}
        inputs = tuple(input_shapes(model, name, complete_options))
        complete_options["derivative"] = Derivative.from_inputs(
            name,
            inputs,
            derivative_options["by"],
            derivative_options["form"],
            derivative_options["mode"],
            derivative_options["values"],
        )
    elif options_of_derivative:
        raise KernelError(
            f"{name}: {options_of_derivative[0]}= is of a derivative; name the inputs to differentiate by, as in by='q'."
        )
    return complete_options


def _checked_kind(kind: Any) -> Any:
    """Return the kind of a twist; raises UnknownNameError for another name, with our name for a name of Pinocchio."""
    if kind in kinematics.KINDS:
        return kind
    kind_of_pinocchio = kinematics.PINOCCHIO.get(str(kind).upper())
    if kind_of_pinocchio:
        raise UnknownNameError(
            f"no kind named {str(kind)!r}: Pinocchio's name for kind={kind_of_pinocchio!r}, which has angular rows first."
        )
    raise UnknownNameError.from_choices("kind", kind, kinematics.KINDS)


def _names_tuple(names: str | Sequence[str]) -> tuple[str, ...]:
    """Tuple of one name or several names."""
    return (names,) if isinstance(names, str) else tuple(names)


def _wrench_options(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Options ``wrenches``, frames of all wrenches, and ``on_robot``, frames of wrenches applied by the world."""
    wrenches = options.get("wrenches", ())
    if not isinstance(wrenches, str | Sequence):
        raise KernelError(f"{name}: wrenches={wrenches!r} is not allowed. Give the names of frames.")
    frames = _names_tuple(wrenches)
    on_robot = _names_tuple(options.get("on_robot") or ())
    for frame in frames:
        model.frame(frame)  # only for its error
    if len(set(frames)) < len(frames):
        raise KernelError(f"{name}: a frame is named twice in wrenches={frames}. Add its wrenches up first.")
    for frame in on_robot:
        if frame not in frames:
            raise KernelError(f"{name}: on_robot names {frame!r}, which is not in wrenches={frames}.")
    if on_robot:
        return {"wrenches": frames, "on_robot": on_robot}
    return {"wrenches": frames}


def _constraints(name: str, option: Any) -> tuple[constraints.Constraint, ...]:
    """Return the option ``constraints``; raises KernelError unless it is a tuple of constraints."""
    is_tuple = isinstance(option, tuple) and len(option) > 0
    if not is_tuple or not all(isinstance(constraint, constraints.Constraint) for constraint in option):
        raise KernelError(
            f"{name} needs constraints=(…,), a tuple of those of a closed robot: robot.close(…).constraints, "
            f"got {option!r}."
        )
    return option


def _require_plain_rates(model: Model) -> None:
    """Raise ValueRangeError for a joint whose velocities are not the rates of its coordinates."""
    for body in model.bodies:
        if not body.joint.plain_rates:
            raise ValueRangeError(
                f"Christoffel symbols need coordinates whose rates are the velocities; joint {body.joint.name!r} is "
                f"{body.joint.kind}. coriolis_matrix works on every robot."
            )


def _require_mass(model: Model, name: str, parameters: Sequence[str]) -> None:
    """Raise ValueRangeError if no moving body has mass, unless masses are inputs of the kernel."""
    has_mass_inputs = any(parameter.endswith(".mass") for parameter in parameters)
    if not model.bodies or has_mass_inputs:
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
    """Shapes of a quantity's inputs by name, in the order of its algorithm."""
    shapes = dict(QUANTITIES[name].shapes(model))
    for frame in options.get("wrenches", ()):
        shapes[f"wrench at {frame}"] = (6,)
    if "gravity" in options:
        shapes["gravity"] = (3,)
    parameters = options.get("parameters", ())
    if parameters:
        shapes["parameters"] = (len(parameters),)
    return shapes
