"""What a page of a section of Modern Robotics has in its header: words, formulas, sliders, and the links' constants."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..joints.units import unit_of
from ..motion.coordinates import Coordinates
from ..typing import Array
from .formula import formula_html
from .page_programs import round_above
from .task_rows import AXES, task_rows

if TYPE_CHECKING:
    from ..robot import Robot
    from .book_section import BookSection

_NAMES = {
    "dq": ("θ̇", "velocities of the joints"),
    "ddq": ("θ̈", "accelerations of the joints"),
    "tau": ("τ", "torques of the joints"),
    "dV": ("V̇", "acceleration of the tip, in the axes of {s}"),
    "wrench": ("F_b", "wrench that the tip applies, in its frame {b}"),
    "motor": ("G", "gear, rotor and friction of every joint"),
}
_MOTOR = (
    ("gear ratio G", "", 1.0, 200.0, 100.0),
    ("rotor's inertia I", "kg cm²", 0.0, 5.0, 0.5),
    ("viscous friction b", "N m s/rad", 0.0, 20.0, 2.0),
    ("Coulomb friction μ", "N m", 0.0, 20.0, 3.0),
)
"""Name, unit, ends and beginning of the sliders of a motor."""
_COMPONENTS = ("moment, x", "moment, y", "moment, z", "force, x", "force, y", "force, z")


def book_data(section: BookSection, robot: Robot, start: Array) -> dict[str, Any]:
    """The section for one robot, which starts at a configuration."""
    model = robot.model
    sliders = _sliders(robot, start, section)
    return {
        "number": section.number,
        "title": section.title,
        "idea": section.idea,
        "formulas": [(formula_html(text), number) for text, number in section.formulas],
        "inputs": [
            {"key": key, "letter": formula_html(_NAMES[key][0]), "meaning": _NAMES[key][1], "rows": sliders[key]}
            for key in section.inputs
        ],
        "chooses": section.chooses,
        "load": section.load,
        "gravity": model.gravity.tolist(),
        "ranks": _ranks(robot),
        "rows": [AXES.index(row) for row in task_rows(robot)],
        "links": [
            {
                "name": body.link,
                "inertia": body.inertia.matrix.ravel().tolist(),
                "axis": body.joint.axes[0].tolist(),
            }
            for body in model.bodies
        ],
    }


def _ranks(robot: Robot) -> dict[str, int]:
    """Of the Jacobian of the tip at most configurations: all of it, its angular and its linear rows."""
    J = np.asarray(robot.jacobian(robot.random_configuration(0, 16), kind="world_aligned"))
    rows = {"all": slice(6), "angular": slice(3), "linear": slice(3, 6)}
    return {key: int(np.linalg.matrix_rank(J[:, mine], tol=1e-9).max()) for key, mine in rows.items()}


def _sliders(robot: Robot, start: Array, section: BookSection) -> dict[str, list[dict[str, Any]]]:
    """Rows of name, unit, ends and beginning, by input."""
    coordinates, limits = Coordinates.of(robot.model), robot.limits
    turns = coordinates.angular_velocity
    holding = np.asarray(robot.holding_torques(start))
    weight = sum(float(b.inertia.mass) for b in robot.model.bodies) * float(np.linalg.norm(robot.model.gravity))
    push = round_above(weight / 2 or 10.0)
    if section.presses:
        J = np.asarray(robot.jacobian(start, kind="world_aligned"))[3 + AXES.index(task_rows(robot)[0])]
        holding = holding + push / 4 * J  # with gravity, tau = g + J' F
    torque = [
        e if 0 < e < np.inf else round_above(max(2 * float(np.abs(holding).max()), 1.0)) for e in limits.effort.tolist()
    ]
    rates = [v if 0 < v < np.inf else 3.0 for v in limits.velocity.tolist()]

    def joints(unit: str, most: list[float], begin: list[float]) -> list[dict[str, Any]]:
        return [
            {"name": name, "unit": f"{'rad' if turns[k] else 'm'}/{unit}", "most": most[k], "start": begin[k]}
            for k, name in enumerate(coordinates.velocity_names)
        ]

    n = robot.nv
    first = [(not section.at_rest) * round(0.25 * v * (-1) ** k / (1 + k / 2), 2) for k, v in enumerate(rates)]
    tau = joints("", torque, holding.tolist())
    for row, unit in zip(tau, coordinates.torque_units, strict=True):
        row["unit"] = unit
    most = 3 * [round_above(push / 5)] + 3 * [push]
    begin = [0.0, 0.0, 0.0, push / 4, 0.0, -push / 2]
    accelerations = [f"along {row[1]}" for row in task_rows(robot)]
    return {
        "dV": [{"name": n, "unit": "m/s²", "most": 10.0, "start": 1.0 - k} for k, n in enumerate(accelerations)],
        "dq": joints("s", rates, first),
        "ddq": joints("s²", n * [10.0], [1.0, *(n - 1) * [0.0]]),
        "tau": tau,
        "motor": [
            {"name": name, "unit": unit, "least": least, "most": most, "start": start}
            for name, unit, least, most, start in _MOTOR
        ],
        "wrench": [
            {"name": name, "unit": unit_of("tau", k < 3), "most": most[k], "start": begin[k]}
            for k, name in enumerate(_COMPONENTS)
        ],
    }
