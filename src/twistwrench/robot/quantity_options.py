"""The options of a quantity, checked: defaults filled in, frames and joints found, derivatives described."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

from ..algorithms import constraints, jacobians, operational_space
from ..errors import KernelError, UnknownNameError, ValueRangeError
from ..model.model import Model
from ..model.variable_parameters import matching
from .derivative_options import Derivative
from .quantities import QUANTITIES
from .quantity_row import Shape


class KernelOptions(TypedDict, total=False):
    """What :meth:`twistwrench.Robot.kernel` takes beside the names of quantities."""

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
"""The options every quantity takes for its derivatives, and what they are unless said otherwise."""


def options_of(name: str) -> tuple[str, ...]:
    """The options a quantity takes; raises UnknownNameError."""
    if name not in QUANTITIES:
        raise UnknownNameError.of("quantity", name, QUANTITIES)
    own = QUANTITIES[name].options
    return (*own, *(["on_robot"] if "wrenches" in own else []), "parameters", *OF_DERIVATIVES)


def wanted(model: Model, names: Sequence[str], options: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Each quantity with the options that are its own, checked."""
    if not names:
        raise UnknownNameError.of("quantity", "", QUANTITIES)
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
        if full["kind"] not in jacobians.KINDS:
            if meant := jacobians.PINOCCHIO.get(str(full["kind"]).upper()):
                raise UnknownNameError(
                    f"no kind named {str(full['kind'])!r}: what Pinocchio calls so is kind={meant!r}, with angular rows first."
                )
            raise UnknownNameError.of("kind", full["kind"], jacobians.KINDS)
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
        full["derivative"] = Derivative.of(name, tuple(input_shapes(model, name, full)), by, form, mode, values)
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
