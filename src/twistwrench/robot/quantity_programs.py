"""The programs of quantities: their algorithms, traced for one robot with the options asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..model.base_parameters import regrouped
from ..model.model import Model
from ..model.variable_parameters import moves_joints, varied
from ..program.program import Program
from ..program.trace import Trace, trace
from .derivative_options import Chart
from .quantities import QUANTITIES
from .quantity_options import input_shapes
from .quantity_row import Quantity
from .quantity_types import CONFIGURATIONS


def evaluated(quantity: Quantity, model: Model, arrays: Sequence[Any], options: Mapping[str, Any]) -> Any:
    """The quantity's algorithm on arrays of numbers or symbols: the usual inputs, a wrench per frame, gravity, parameters."""
    rest, usual = {k: v for k, v in options.items() if k != "derivative"}, len(quantity.inputs)
    if names := rest.pop("parameters", ()):
        model, arrays = varied(model, names, arrays[-1]), arrays[:-1]
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
                charts = {x: Chart.of(mine[x], model if x in CONFIGURATIONS else None) for x in derivative.by}
                found = derivative.of_results(name, found, charts, {label: given[label] for label in more[name]})
            results.extend(found)
        return tuple(results)

    outputs: list[str] = []
    for name, options in wanted.items():
        own = QUANTITIES[name].outputs
        outputs += options["derivative"].outputs(own) if "derivative" in options else own
    return trace(on_symbols, [(label, inputs[label]) for label in order], outputs)


def inputs_of(model: Model, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of what a kernel of one quantity takes, in its order."""
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
