"""What a caller gives a rollout, looked at one by one: states, torques or a law, limits, wrenches, parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import arguments
from ..core.printed_numbers import printed
from ..errors import ShapeError, ValueRangeError
from ..model.sampled_parameters import refuse_impossible
from ..model.variable_parameters import matching, nominal
from ..robot.wrench_arguments import wrench_at
from ..typing import Array
from .torque_laws import GivenTorque, TorqueLaw

if TYPE_CHECKING:
    from ..robot import Robot


def torque_limits_of(robot: Robot, asked: Any) -> list[tuple[str, Array, int]]:
    """Torque limits as an input of the step, (label, array, length of the last axis); nothing where there are none."""
    if asked is None or asked is False:
        return []
    limits = robot.limits.effort if asked is True else _real(asked, "torque_limits", robot.model.velocity_names)
    if limits.shape[-1:] != (robot.nv,) and limits.ndim:
        raise ShapeError(
            f"torque_limits has shape {limits.shape}, but robot {robot.name!r} wants {robot.nv} in the last axis, one number "
            "for all, or True for its own."
        )
    if not (limits >= 0).all():
        raise ValueRangeError(
            f"torque_limits has {printed(limits[~(limits >= 0)].flat[0])}, and limits are at least 0; inf is none."
        )
    return [("torque_limits", limits, robot.nv)]


def law_of(tau: Any) -> TorqueLaw:
    """What gives the torques: a law as it is, or torques that are given."""
    if isinstance(tau, type):
        raise ValueRangeError(f"tau is the class {tau.__name__}, not a law: call it, with a reference and gains.")
    if hasattr(tau, "torques") and hasattr(tau, "names"):
        return tau
    if callable(tau):
        raise ValueRangeError(
            "tau is a function, and the loop over the steps is machine code, which calls none. Give torques as an array, "
            "tw.control.PD, tw.control.ComputedTorque, or their batches in tw.simulation; robot.simulate takes functions."
        )
    return GivenTorque(tau)


def _real(x: Any, what: str, names: Sequence[str] = ()) -> Array:
    """Real numbers, float32 or float64, of any shape; a table by the names of its columns."""
    array = arguments.array(x, what, names=names)
    if array.dtype == object:
        raise ValueRangeError(f"{what} is of symbols, and a rollout is of numbers.")
    return array


def leaves_single(x: Array) -> bool:
    """Whether an array leaves the result in float32; single numbers do."""
    return x.dtype == np.float32 or x.ndim == 0


def state_of(robot: Robot, what: str, given: Any, size: int) -> Array:
    """A state's part of the right length, q0 or dq0; quaternions are some rotation."""
    x = _real(given, what, robot.coordinate_names if what == "q0" else robot.model.velocity_names)
    if x.shape[-1:] != (size,):
        raise ShapeError(f"{what} has shape {x.shape}, but robot {robot.name!r} wants {size} in the last axis.")
    if what == "q0":
        for body in robot.model.leaders:
            if not body.joint.is_configuration(x[..., body.places[0]]):
                raise ValueRangeError(
                    f"q0 has a quaternion of zeros at joint {body.joint.name!r}, which is no rotation; none is (1, 0, 0, 0)."
                )
    return x


def given_by(robot: Robot, law: TorqueLaw) -> list[tuple[str, Array, int]]:
    """What a law is given, by name, with the length of the last axis."""
    found = []
    for name in law.names:
        size = robot.nq if name == "q_des" else robot.nv
        given = getattr(law, name)
        none = given is None and isinstance(law, GivenTorque)
        x = _real(
            0.0 if none else given, name, robot.coordinate_names if name == "q_des" else robot.model.velocity_names
        )
        one_for_all = none or name not in ("tau", "q_des")
        if x.shape[-1:] != (size,) and not (one_for_all and x.ndim == 0):
            more = ", or one number for all" if one_for_all else ""
            raise ShapeError(
                f"{name} has shape {x.shape}, but robot {robot.name!r} wants {size} in the last axis{more}."
            )
        found.append((name, x, size))
    return found


def wrenches_by_frame(robot: Robot, wrenches: Any) -> dict[str, Array]:
    """Wrenches on the robot, checked, by frame."""
    if wrenches is None:
        return {}
    if not isinstance(wrenches, Mapping):
        raise ShapeError("wrench_on_robot is a dict {frame: (m, f)}, for the frame is part of what a wrench says.")
    return {frame: wrench_at(robot.model, frame, F) for frame, F in wrenches.items()}


def parameter_values(robot: Robot, given: Any) -> tuple[tuple[str, ...], list[Array]]:
    """Names and numbers of the parameters that samples have of their own."""
    if given is None:
        return (), []
    if not isinstance(given, Mapping):
        raise ShapeError(f"parameters is a dict {{name: numbers}}, got {given!r}; robot.varying() lists the names.")
    known = nominal(robot.model)
    for name in given:
        if name not in known:
            matching(robot.model, (str(name),))  # says which there are
            raise ValueRangeError(
                f"parameters: {name!r} is a pattern. Name each: {', '.join(robot.varying(str(name)))}."
            )
    values = {name: _real(x, f"parameter {name!r}") for name, x in given.items()}
    refuse_impossible(robot.model, values)
    return tuple(values), list(values.values())
