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
    """Results of the quantity's algorithm on arrays of numbers or symbols.

    The arrays are the usual inputs. Wrenches of the frames, gravity and parameters follow, each if it is an input.
    """
    algorithm_options = dict(options)
    algorithm_options.pop("derivative", None)  # derived by the caller
    usual_count = len(quantity.inputs)
    parameters = algorithm_options.pop("parameters", ())
    if parameters:
        model = with_symbolic_parameters(model, parameters, arrays[-1])
        arrays = arrays[:-1]
    frames = algorithm_options.pop("wrenches", ())
    if frames:
        frames_on_robot = algorithm_options.pop("on_robot", ())
        wrench_arrays = arrays[usual_count : usual_count + len(frames)]
        wrenches_by_robot = dict(zip(frames, wrench_arrays, strict=True))
        for frame in frames:
            if frame in frames_on_robot:
                wrenches_by_robot[frame] = -wrenches_by_robot[frame]
        algorithm_options["wrenches"] = wrenches_by_robot
    if algorithm_options.pop("gravity", None):  # the last of the arrays, once parameters are gone
        model = replace(model, gravity=arrays[-1])
    return quantity.algorithm(model, *arrays[:usual_count], **algorithm_options)


def _result_tuple(returned: Any) -> tuple[Any, ...]:
    """Results of an algorithm that returns one array, or a tuple of several."""
    if isinstance(returned, tuple):
        return returned
    return (returned,)


def program_of(model: Model, name: str, options: Mapping[str, Any], *, regroup: bool = True) -> Program:
    """Trace one quantity of one robot; inputs as of :func:`evaluate_quantity`.

    ``regroup=False`` disables base-parameter regrouping, to count the operations that it saves.
    """
    return program_of_several(model, {name: options}, regroup=regroup)


def program_of_several(model: Model, requested: Mapping[str, Mapping[str, Any]], *, regroup: bool = True) -> Program:
    """Trace several quantities, ``{name: options}``, as one program with common subexpressions."""
    ports: dict[str, dict[str, Shape]] = {}  # inputs, by quantity
    derivative_ports: dict[str, dict[str, Shape]] = {}  # further inputs of derivatives, by quantity
    models: dict[str, Model] = {}  # by quantity
    for name, options in requested.items():
        ports[name] = input_shapes(model, name, options)
        derivative_ports[name] = _ports_of_derivative(model, name, options)
        models[name] = _model_for(model, name, options, regroup)
    inputs: dict[str, Shape] = {}
    for shapes in (*ports.values(), *derivative_ports.values()):
        inputs |= shapes
    labels = _input_order(inputs)

    def all_results(*arrays: Any) -> tuple[Any, ...]:
        """Results of all quantities, from arrays in the order of ``labels``."""
        array_by_label = dict(zip(labels, arrays, strict=True))
        collected: list[Any] = []
        for name, options in requested.items():
            arguments = {label: array_by_label[label] for label in ports[name]}
            returned = evaluate_quantity(QUANTITIES[name], models[name], list(arguments.values()), options)
            results = _result_tuple(returned)
            derivative = options.get("derivative")
            if derivative is not None:
                charts = {}
                for label in derivative.by:
                    chart_model = model if label in CONFIGURATIONS else None  # None: a plain vector
                    charts[label] = Chart.from_input(arguments[label], chart_model)
                weights_and_directions = {label: array_by_label[label] for label in derivative_ports[name]}
                results = derivative.derive(name, results, charts, weights_and_directions)
            collected.extend(results)
        return tuple(collected)

    outputs: list[str] = []
    for name, options in requested.items():
        names = QUANTITIES[name].outputs
        if "derivative" in options:
            names = options["derivative"].outputs(names)
        outputs += names
    input_ports = [(label, inputs[label]) for label in labels]
    return trace(all_results, input_ports, outputs)


def inputs_of(model: Model, name: str, options: Mapping[str, Any]) -> list[tuple[str, tuple[int, ...]]]:
    """Names and shapes of the inputs of one quantity's kernel, in order."""
    ports = input_shapes(model, name, options) | _ports_of_derivative(model, name, options)
    return [(label, ports[label]) for label in _input_order(ports)]


def _input_order(labels: Iterable[str]) -> list[str]:
    """Labels in order: usual inputs, weights and directions of derivatives, wrenches, gravity, parameters."""
    last_labels = ("gravity", "parameters")
    # False sorts before True, and the order within each kind stays.
    return sorted(labels, key=lambda label: (label in last_labels, label.startswith("wrench at")))


def _ports_of_derivative(model: Model, name: str, options: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    """Shapes by label of the additional inputs of a derivative; empty without a derivative."""
    derivative = options.get("derivative")
    if derivative is None:
        return {}
    ports = input_shapes(model, name, options)
    outputs = QUANTITIES[name].outputs
    result_shapes: Any = [()] * len(outputs)  # without effect unless the derivative weighs results
    if derivative.weighs:  # shapes of results are known only after tracing
        temporary_trace = Trace()
        symbols = [temporary_trace.inputs(0, shape) for shape in ports.values()]
        returned = evaluate_quantity(QUANTITIES[name], model, symbols, options)
        results = _result_tuple(returned)
        result_shapes = list(map(np.shape, results))
        temporary_trace.forget()
    direction_shapes = dict(ports)
    for label in ports:
        if label in CONFIGURATIONS:
            direction_shapes[label] = (model.nv,)
    labels = [f"{name} {output}" for output in outputs]
    return derivative.inputs(direction_shapes, dict(zip(labels, result_shapes, strict=True)))


def _model_for(model: Model, name: str, options: Mapping[str, Any], regroup: bool) -> Model:
    """Model for a quantity: regrouped if the quantity depends only on joint torques, and no parameter moves a joint."""
    parameters_move_joints = moves_joints(model, options.get("parameters", ()))
    depends_on_joint_torques_alone = QUANTITIES[name].felt
    if depends_on_joint_torques_alone and regroup and not parameters_move_joints:
        return regrouped(model)
    return model
