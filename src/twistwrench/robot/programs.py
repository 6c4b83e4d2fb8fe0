"""Programs of quantities, traced for one robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..compiler.ir.program import Program
from ..compiler.ir.tracer import Trace, trace
from ..mechanics.model.model import Model
from ..mechanics.model.parameters import moves_joints, regrouped, with_symbolic_parameters
from .arguments import CONFIGURATIONS
from .differentiate import Chart
from .kernels.options import input_shapes
from .quantities import QUANTITIES, Quantity, Shape


def evaluate_quantity(quantity: Quantity, model: Model, arrays: Sequence[Any], options: Mapping[str, Any]) -> Any:
    """The quantity's algorithm on arrays of numbers or symbols: usual inputs, a wrench per frame, gravity, parameters."""
    own_options = dict(options)
    own_options.pop("derivative", None)
    usual = len(quantity.inputs)
    parameters = own_options.pop("parameters", ())
    if parameters:
        model = with_symbolic_parameters(model, parameters, arrays[-1])
        arrays = arrays[:-1]
    frames = own_options.pop("wrenches", ())
    if frames:
        on_robot = own_options.pop("on_robot", ())
        wrenches_by_robot = dict(zip(frames, arrays[usual : usual + len(frames)], strict=True))
        for frame in frames:
            if frame in on_robot:
                wrenches_by_robot[frame] = -wrenches_by_robot[frame]
        own_options["wrenches"] = wrenches_by_robot
    if own_options.pop("gravity", None):
        model = replace(model, gravity=arrays[-1])
    return quantity.algorithm(model, *arrays[:usual], **own_options)


def _result_tuple(returned: Any) -> tuple[Any, ...]:
    """Results of an algorithm that returns one or several."""
    if isinstance(returned, tuple):
        return returned
    return (returned,)


def program_of(model: Model, name: str, options: Mapping[str, Any], *, regroup: bool = True) -> Program:
    """Trace one quantity of one robot.

    Wrenches, if any, become further inputs after the usual ones, then gravity and parameters if these are inputs.
    ``regroup=False`` disables base-parameter regrouping, to count the operations it saves.
    """
    return program_of_several(model, {name: options}, regroup=regroup)


def program_of_several(model: Model, requested: Mapping[str, Mapping[str, Any]], *, regroup: bool = True) -> Program:
    """Trace several quantities, ``{name: options}``, as one program with common subexpressions."""
    ports, derivative_ports, models = {}, {}, {}
    for name, options in requested.items():
        ports[name] = input_shapes(model, name, options)
        derivative_ports[name] = _ports_of_derivative(model, name, options)
        models[name] = _model_for(model, name, options, regroup)
    inputs: dict[str, Shape] = {}
    for shapes in (*ports.values(), *derivative_ports.values()):
        inputs |= shapes
    order = _input_order(inputs)

    def results(*arrays: Any) -> tuple[Any, ...]:
        values = dict(zip(order, arrays, strict=True))
        all_results: list[Any] = []
        for name, options in requested.items():
            arguments = {label: values[label] for label in ports[name]}
            own_results = _result_tuple(
                evaluate_quantity(QUANTITIES[name], models[name], list(arguments.values()), options)
            )
            derivative = options.get("derivative")
            if derivative is not None:
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
        shapes = list(map(np.shape, results))
        owner.forget()
    directions = dict(ports)
    for label in ports:
        if label in CONFIGURATIONS:
            directions[label] = (model.nv,)
    labels = [f"{name} {output}" for output in outputs]
    return derivative.inputs(directions, dict(zip(labels, shapes, strict=True)))


def _model_for(model: Model, name: str, options: Mapping[str, Any], regroup: bool) -> Model:
    fixed = not moves_joints(model, options.get("parameters", ()))
    if QUANTITIES[name].felt and regroup and fixed:
        return regrouped(model)
    return model
