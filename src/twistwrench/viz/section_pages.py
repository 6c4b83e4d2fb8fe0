"""Pages for sections of Modern Robotics: ideas, formulas, sliders and programs."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core import arguments
from ..core.errors import ValueRangeError
from ..core.text import Argument, Placeholder, spell
from ..core.typing import Array
from ..mechanics.joints.units import unit_of, units_of
from ..motion.coordinates import Coordinates
from .page_programs import PagePrograms, moving_mass, round_above

if TYPE_CHECKING:
    from ..robot import Robot

MOST_JOINTS = 9
"""Maximum number of columns in a table of the page."""


@dataclass(frozen=True)
class SectionPanel:
    """Contents of one page; its readout is the function with the same number in ``player/*readouts.js``."""

    number: str
    """Number of the section in the book, such as 5.2."""
    title: str
    """Heading of the page."""
    idea: str
    """Text below the heading, as HTML."""
    formulas: tuple[tuple[str, str], ...]
    """Formulas for :func:`~twistwrench.viz.section_pages.formula_html`, each with its equation number in the book."""
    inputs: tuple[str, ...]
    """Groups of sliders besides the joints' positions: dq, ddq, tau, wrench, dV, motor."""
    programs: Callable[[PagePrograms], Asked]
    """Quantities that the page computes."""
    chooses: str = ""
    """Content of a selection list: "joint" or "link"; empty for no list."""
    load: str = ""
    """Sliders of the load at the tip: "payload", or "all" with buttons to push and release; empty for no sliders."""
    shown: tuple[str, ...] = ("looks", "torques")
    """Switches of the picture that are on at first."""
    at_rest: bool = False
    """True if the initial velocities are zero."""
    presses: bool = False
    """True if the initial torques press the tip along the first axis along which it can move."""

    def require(self, robot: Robot) -> None:
        """Raise ValueRangeError if the page cannot show this robot."""
        problem = None
        if robot.model.tip is None:
            problem = f"has no single tip: name one, {spell(Argument('tip', Placeholder('FRAME')))}"
        elif any(body.joint.nv != 1 or not body.joint.driven for body in robot.model.leaders):
            problem = "has joints that neither turn nor slide, or a base that moves"
        elif not 1 <= robot.nv <= MOST_JOINTS:
            problem = f"has {robot.nv} joints that move"
        if problem is not None:
            raise ValueRangeError(
                f"section {self.number}: robot {robot.name!r} {problem}. These pages take an arm with one tip and 1 to "
                f"{MOST_JOINTS} joints that turn or slide, such as planar_2r, ur5 or panda."
            )


_FORMULA_TOKEN = re.compile(
    r"([_^])(?:\{((?:[^{}]|\{[^{}]*\})*)\}|(\w+))|(Ad|ad|diag|rank|sign|sin|cos)|([A-Za-zτθωβ𝒱ℱ𝒢𝒫])([\u0307\u0308]?)"
)
_UPRIGHT_LETTERS = "𝒱ℱ𝒢𝒫"
"""Letters of twist, wrench, spatial inertia and momentum in articles, upright."""
_DOT_CLASSES = {"\u0307": "dot", "\u0308": "ddot"}
"""CSS classes of letters with one dot and with two, by the combining character."""


def formula_html(text: str) -> str:
    """HTML of a formula: ``_i``, ``_{i+1}`` and ``^T`` become indices and powers; θ̇ and θ̈ have dots.

    >>> formula_html("F_b = [ad_{V_b}]^T P")
    '<i>F</i><sub>b</sub> = [ad<sub><i>V</i><sub>b</sub></sub>]<sup>T</sup> <i>P</i>'
    """

    def token_html(token: re.Match[str]) -> str:
        """HTML of an index, a power, a function's name or a letter."""
        index_or_power, braced, plain, function_name, letter, dots = token.groups()
        if index_or_power:
            inside = braced if plain is None else plain
            if braced is not None and "_" in braced:  # an index that has an index itself
                inside = formula_html(braced)
            tag = "sub" if index_or_power == "_" else "sup"
            return f"<{tag}>{inside}</{tag}>"
        if function_name is not None:
            return function_name
        is_upright = letter in _UPRIGHT_LETTERS
        if is_upright and not dots:
            return letter
        tag = "span" if is_upright else "i"
        if dots:
            return f'<{tag} class="{_DOT_CLASSES[dots]}">{letter}</{tag}>'
        return f"<{tag}>{letter}</{tag}>"

    return _FORMULA_TOKEN.sub(token_html, text)


AXES = ("vx", "vy", "vz")
"""Names of the components of a frame's linear velocity."""
_SAMPLED_POSES = 16
"""Number of random configurations at which a rank is determined."""
_RANK_TOLERANCE = 1e-9
"""Singular value of a Jacobian up to which it counts as zero."""


def _sampled_jacobians(robot: Robot, frame: str | None = None) -> Array:
    """Jacobians (16, 6, nv) of a frame, or of the tip, at random configurations."""
    q = robot.random_configuration(0, _SAMPLED_POSES)
    return np.asarray(robot.jacobian(q, frame, kind="world_aligned"))


def _usual_rank(J: Array) -> int:
    """Rank of Jacobians (n, m, nv) at most configurations: the largest of the samples."""
    return int(np.linalg.matrix_rank(J, tol=_RANK_TOLERANCE).max())


def ik_rows(robot: Robot, frame: str | None = None) -> tuple[str, ...]:
    """Largest set of frame velocities that are independent at most configurations; the frame defaults to the tip.

    >>> import twistwrench as tw
    >>> ik_rows(tw.robots.planar_2r()), ik_rows(tw.robots.ur5())
    (('vx', 'vz'), ('vx', 'vy', 'vz'))
    """
    J_v = _sampled_jacobians(robot, frame)[:, 3:]
    independent_rows: list[int] = []
    for k in range(3):
        rows_with_k = [*independent_rows, k]
        if _usual_rank(J_v[:, rows_with_k]) == len(rows_with_k):
            independent_rows.append(k)
    return tuple(AXES[k] for k in independent_rows)


_INPUT_NAMES = {
    "dq": ("θ̇", "velocities of the joints"),
    "ddq": ("θ̈", "accelerations of the joints"),
    "tau": ("τ", "torques of the joints"),
    "dV": ("V̇", "acceleration of the tip, in the axes of {s}"),
    "wrench": ("F_b", "wrench that the tip applies, in its frame {b}"),
    "motor": ("G", "gear, rotor and friction of every joint"),
}
"""Letter and meaning of each group of sliders."""
_MOTOR_SLIDERS = (
    # name, unit, least, most, start
    ("gear ratio G", "", 1.0, 200.0, 100.0),
    ("rotor's inertia I", "kg cm²", 0.0, 5.0, 0.5),
    ("viscous friction b", "N m s/rad", 0.0, 20.0, 2.0),
    ("Coulomb friction μ", "N m", 0.0, 20.0, 3.0),
)
_MOTOR_KEYS = ("name", "unit", "least", "most", "start")
_WRENCH_COMPONENTS = ("moment, x", "moment, y", "moment, z", "force, x", "force, y", "force, z")


def section_data(section: SectionPanel, robot: Robot, start: Array) -> dict[str, Any]:
    """Data of the section for one robot; ``start``: its initial configuration (nq,)."""
    model = robot.model
    sliders = _sliders(robot, start, section)
    inputs = []
    for key in section.inputs:
        letter, meaning = _INPUT_NAMES[key]
        inputs.append({"key": key, "letter": formula_html(letter), "meaning": meaning, "rows": sliders[key]})
    return {
        "number": section.number,
        "title": section.title,
        "idea": section.idea,
        "picture": opening_picture(section.number),
        "formulas": [(formula_html(text), number) for text, number in section.formulas],
        "inputs": inputs,
        "exercises": exercises(robot, section.number),
        "chooses": section.chooses,
        "load": section.load,
        "gravity": model.gravity.tolist(),
        "ranks": _ranks(robot),
        "rows": [AXES.index(row) for row in ik_rows(robot)],
        "links": [
            {"name": body.link, "inertia": body.inertia.matrix.ravel().tolist(), "axis": body.joint.axes[0].tolist()}
            for body in model.bodies
        ],
    }


def opening_picture(number: str) -> str:
    """Drawing above the text of a section, as SVG; empty for a section with an article, which has its own pictures."""
    file = resources.files(__package__) / "openings" / f"{number}.svg"
    return file.read_text("utf-8") if file.is_file() else ""


_USUAL_NEAR_MISSES = ["sign", "double", "half"]
"""Near-misses that are named if an exercise lists none: player/article/near_misses.js has their words."""


def _finite_limits(limits: Array, default: float) -> list[float]:
    """Limits of joints, with ``default`` for joints whose limit is 0 or infinite."""
    has_limit = (limits > 0) & (limits < np.inf)
    return list(np.where(has_limit, limits, default).tolist())


@cache
def _exercise_table() -> Mapping[str, list[dict[str, Any]]]:
    """Exercises of all sections, by the section's number."""
    import tomllib

    return tomllib.loads(Path(__file__).with_name("exercises.toml").read_text(encoding="utf-8"))


def exercises(robot: Robot, number: str) -> list[dict[str, Any]]:
    """Exercises of a section: question, unit of the answer for this robot, formula in HTML, and named near-misses."""
    is_revolute = bool(Coordinates.from_model(robot.model).angular_velocity[0])  # units are those of joint 1
    units = {name: unit_of(name, is_revolute) for name in ("tau", "dq", "ddq")}
    return [
        {
            "question": Template(exercise["question"]).substitute(units),
            "unit": Template(exercise["unit"]).substitute(units),
            "formula": formula_html(exercise["formula"]),
            "near": exercise.get("near", _USUAL_NEAR_MISSES),
        }
        for exercise in _exercise_table()[number]
    ]


def _ranks(robot: Robot) -> dict[str, int]:
    """Rank of the tip Jacobian at most configurations: all, angular and linear rows."""
    J = _sampled_jacobians(robot)
    return {"all": _usual_rank(J), "angular": _usual_rank(J[:, :3]), "linear": _usual_rank(J[:, 3:])}


def _sliders(robot: Robot, start: Array, section: SectionPanel) -> dict[str, list[dict[str, Any]]]:
    """Sliders (name, unit, range and initial value) by group; ``start``: initial configuration (nq,)."""
    coordinates = Coordinates.from_model(robot.model)
    weight = moving_mass(robot.model) * float(np.linalg.norm(robot.model.gravity))  # [N]
    # half the weight, or 10 N if there is no mass or no gravity
    max_force = round_above(weight / 2) if weight else _DEFAULT_FORCE
    moving_axes = ik_rows(robot)
    start_torques = np.asarray(robot.holding_torques(start))
    if section.presses:
        J_v = np.asarray(robot.jacobian(start, kind="world_aligned"))[3:]
        first_row = J_v[AXES.index(moving_axes[0])]
        start_torques = start_torques + max_force / 4 * first_row  # with gravity: tau = g + J' F
    largest_start_torque = float(np.abs(start_torques).max())
    default_torque = round_above(max(2 * largest_start_torque, 1.0))
    max_torques = _finite_limits(robot.limits.effort, default_torque)
    max_rates = _finite_limits(robot.limits.velocity, _DEFAULT_RATE)

    def joint_sliders(units: Sequence[str], most: Sequence[float], begin: Sequence[float]) -> list[dict[str, Any]]:
        """One slider for each joint, from ``-most`` to ``most``, that is at ``begin`` at first."""
        rows = zip(coordinates.velocity_names, units, most, begin, strict=True)
        return [{"name": name, "unit": unit, "most": high, "start": value} for name, unit, high, value in rows]

    # Initial velocities alternate in sign and decrease towards the tip.
    start_rates = []
    for k, rate in enumerate(max_rates):
        start_rates.append((not section.at_rest) * round(0.25 * rate * (-1) ** k / (1 + k / 2), 2))
    max_accelerations = robot.nv * [10.0]
    start_accelerations = [1.0, *(robot.nv - 1) * [0.0]]
    max_moment = round_above(max_force / 5)  # as a force at 0.2 m
    max_wrench = 3 * [max_moment] + 3 * [max_force]
    start_wrench = [0.0, 0.0, 0.0, max_force / 4, 0.0, -max_force / 2]
    directions = [f"along {axis.removeprefix('v')}" for axis in moving_axes]
    return {
        "dV": [{"name": name, "unit": "m/s²", "most": 10.0, "start": 1.0 - k} for k, name in enumerate(directions)],
        "dq": joint_sliders(units_of("dq", coordinates.angular_velocity), max_rates, start_rates),
        "ddq": joint_sliders(units_of("ddq", coordinates.angular_velocity), max_accelerations, start_accelerations),
        "tau": joint_sliders(coordinates.torque_units, max_torques, start_torques.tolist()),
        "motor": [dict(zip(_MOTOR_KEYS, row, strict=True)) for row in _MOTOR_SLIDERS],
        "wrench": [
            {"name": name, "unit": unit_of("tau", k < 3), "most": max_wrench[k], "start": start_wrench[k]}
            for k, name in enumerate(_WRENCH_COMPONENTS)
        ],
    }


_DEFAULT_FORCE = 10.0
"""Largest force [N] at the tip of a robot without weight."""
_DEFAULT_RATE = 3.0
"""Largest velocity [rad/s or m/s] of a joint without a limit."""


Asked = Mapping[str, tuple[str, dict[str, Any]]]
"""Quantities with their options, by the names that the page uses for them."""


def link_motions(programs: PagePrograms) -> Asked:
    """Twists of the links and their time derivatives."""
    quantities = {}
    for k, frame in enumerate(programs.body_frames):
        quantities[f"V{k}"] = "frame_velocity", {"frame": frame, "kind": "body"}
        quantities[f"dV{k}"] = "frame_acceleration", {"frame": frame, "kind": "body"}
    return quantities


def jacobian(programs: PagePrograms, kind: str) -> tuple[str, dict[str, Any]]:
    """Jacobian of the tip."""
    return "jacobian", {"frame": programs.tip, "kind": kind}


def twist(programs: PagePrograms, kind: str) -> tuple[str, dict[str, Any]]:
    """Twist of the tip."""
    return "frame_velocity", {"frame": programs.tip, "kind": kind}


def task(programs: PagePrograms) -> dict[str, Any]:
    """Options for quantities of the tip velocity, with the rows in which it can move."""
    return {"frame": programs.tip, "kind": "world_aligned", "rows": _moving_rows(programs)}


def along_wall(programs: PagePrograms) -> Asked:
    """Dynamics of a robot whose tip stays on a wall, across the first base axis along which the tip can move."""
    axis_across = _moving_rows(programs)[0]
    constrained_robot = programs.robot.constrain(programs.tip or "", axis_across, kind="world_aligned")
    wall = {"constraints": constrained_robot.constraints}
    loads = {**programs.wrench_options, **programs.load}
    return {
        "wall": ("constraint_jacobian", wall),
        "wall_bias": ("constraint_bias", wall),
        "constrained": ("constrained_dynamics", {**wall, **loads}),
        "inverse": ("inverse_dynamics", loads),
    }


def with_friction(programs: PagePrograms) -> Asked:
    """Inverse dynamics of the links, and friction from viscous and Coulomb coefficients of each joint."""
    parameters: list[str] = []
    for body in programs.robot.model.leaders:
        parameters += (f"{body.joint.name}.viscous", f"{body.joint.name}.coulomb")
    return {
        "inverse": ("inverse_dynamics", programs.load),
        "friction": ("friction_forces", {"parameters": tuple(parameters)}),
    }


def _moving_rows(programs: PagePrograms) -> tuple[str, ...]:
    """Axes along which the tip can move, such as "vx"; raises ValueRangeError if there are none."""
    rows = ik_rows(programs.robot, programs.tip)
    if not rows or programs.tip is None:
        raise ValueRangeError(
            f"robot {programs.robot.name!r}: no joint moves the origin of its tip {programs.robot.tip!r}, so the page of this "
            f"section has nothing to show. Load it with another tip: {spell(Argument('tip', Placeholder('FRAME')))}."
        )
    return rows


def section_panel(number: str) -> SectionPanel:
    """Panel of the section with this number; raises ValueRangeError, which lists the sections."""
    return SECTIONS[arguments.choice(number, "section", tuple(SECTIONS))]


_SECTIONS = (
    # number, title, idea, formulas, inputs, programs
    SectionPanel(
        "3.4",
        "Twists and wrenches at the tip",
        "The same motion and the same load, written in two frames: {b} at the tip and {s} at the base. The six numbers change "
        "with the frame, and their product, the power, does not.",
        (("V_s = [Ad_{T_sb}] V_b", "(3.83)"), ("F_s = [Ad_{T_bs}]^T F_b", "(3.98)"), ("V_b^T F_b = V_s^T F_s", "§3.4")),
        ("dq", "wrench"),
        lambda p: {"twist_b": twist(p, "body"), "twist_s": twist(p, "space")},
        shown=("looks",),
    ),
    SectionPanel(
        "5.1",
        "The Jacobian, column by column",
        "Each joint alone moves the tip in its own way: its twist at 1 rad/s (sliding joints: 1 m/s) is a column of the "
        "Jacobian. Together the joints move the tip by the sum of the columns, each times its velocity. Where columns depend "
        "on each other, the tip has lost a direction.",
        (("V_s = J_s(θ) θ̇", "§5.1.1"), ("V_b = J_b(θ) θ̇", "§5.1.2")),
        ("dq",),
        lambda p: {"jacobian_b": jacobian(p, "body"), "jacobian_s": jacobian(p, "space"), "twist_b": twist(p, "body")},
        shown=("looks",),
    ),
    SectionPanel(
        "5.2",
        "Statics: torques of a wrench at the tip",
        "The joints hold a wrench that the tip applies to the world. Each torque is the product of a column of the Jacobian "
        "with the wrench. Gravity comes on top and is left out here.",
        (("τ = J_b^T(θ) F_b", "(5.26)"),),
        ("wrench",),
        lambda p: {"jacobian_b": jacobian(p, "body"), "statics": ("wrench_torques", {"frame": p.tip})},
    ),
    SectionPanel(
        "5.3",
        "Singularities: a direction is lost",
        "Where the Jacobian loses rank, the tip cannot move in some way, however fast the joints turn. Stretch the "
        "arm, or line two axes of the wrist up, and this happens. Near such a pose the last singular value goes to zero, and "
        "the joint velocities for that twist grow beyond bounds.",
        (("J_b(θ) = U Σ W^T,  Σ = diag(σ_1, …, σ_r)", "§5.3"), ("σ_r = 0:  rank J_b(θ) < r", "§5.3")),
        (),
        lambda p: {"jacobian_b": jacobian(p, "body")},
        shown=("looks",),
    ),
    SectionPanel(
        "5.4",
        "Manipulability: what moves fast pushes weakly",
        "Joint velocities of norm 1 move the tip within one ellipsoid, and joint torques of norm 1 hold the forces within "
        "another. Both have the same axes, and the lengths of one are the reciprocals of the other's. Drag the tip, and what "
        "becomes fast becomes weak.",
        (("v^T (J_v J_v^T)^{−1} v = 1", "§5.4"), ("f^T (J_v J_v^T) f = 1", "§5.4")),
        (),
        lambda _: {},
        shown=("looks",),
    ),
    SectionPanel(
        "8.1.2",
        "Coriolis and centripetal torques, term by term",
        "Without gravity and at constant joint velocities a robot still needs torques, as a mass that goes round a bend needs "
        "a push. Each torque is a sum of products of two velocities. Squares are centripetal terms, the others Coriolis "
        "terms.",
        (("c_i = ∑_j ∑_k Γ_ijk(θ) θ̇_j θ̇_k", "§8.1.2"), ("Γ_ijk = ½ (∂m_ij/∂θ_k + ∂m_ik/∂θ_j − ∂m_jk/∂θ_i)", "(8.12)")),
        ("dq",),
        lambda p: {"christoffel": ("christoffel", p.load), "coriolis": ("coriolis_forces", p.load)},
        chooses="joint",
        load="payload",
    ),
    SectionPanel(
        "8.1.3",
        "The mass matrix, and how heavy the tip is",
        "The same push accelerates the tip more in one direction than in another. The ellipsoid holds the forces that "
        "accelerate it by 1 m/s² in each direction, at rest and without gravity: it is long where the tip is heavy. Drag the "
        "tip and watch it turn; J<sub>v</sub> is the lower half of J, for the velocity of the tip.",
        (("K = ½ θ̇^T M(θ) θ̇", "§8.1.2"), ("Λ(θ) = (J_v M^{−1} J_v^T)^{−1}", "§8.1.3, 8.6")),
        (),
        lambda _: {},
        load="payload",
        shown=("looks", "mass"),
    ),
    SectionPanel(
        "8.2",
        "One rigid body",
        "One link, as a body of its own: its twist, its momentum, and the sum F of all wrenches on it, in the frame {b} of "
        "the link. F is what its motion needs, whoever supplies it: joints and weight together. At steady joint speeds V̇ is "
        "not zero, as the joints before it turn its axis.",
        (("P_b = G_b V_b", "§8.2.2"), ("F_b = G_b V̇_b − [ad_{V_b}]^T G_b V_b", "(8.40)")),
        ("dq", "ddq"),
        link_motions,
        chooses="link",
        shown=("looks",),
    ),
    SectionPanel(
        "8.3",
        "Newton–Euler inverse dynamics",
        "Outward, twists and accelerations from link to link, gravity as a base that accelerates upward; inward, the wrenches "
        "that carry the links, and from each the torque of its joint.",
        (
            ("V_i = [Ad_{T_{i,i−1}}] V_{i−1} + A_i θ̇_i", "(8.51)"),
            ("V̇_i = [Ad_{T_{i,i−1}}] V̇_{i−1} + [ad_{V_i}] A_i θ̇_i + A_i θ̈_i", "(8.52)"),
            ("F_i = [Ad_{T_{i+1,i}}]^T F_{i+1} + G_i V̇_i − [ad_{V_i}]^T G_i V_i", "(8.53)"),
            ("τ_i = F_i^T A_i", "(8.54)"),
        ),
        ("dq", "ddq", "wrench"),
        lambda p: {
            **link_motions(p),
            "wrenches": ("joint_wrenches", {"wrenches": (p.tip,)}),
            "inverse": ("inverse_dynamics", {"wrenches": (p.tip,)}),
        },
        chooses="link",
    ),
    SectionPanel(
        "8.4",
        "The equations in closed form: a sum over the links",
        "Twists of all links stacked in one column V, joint axes in A, transforms in L: then there is no recursion, only "
        "products. The six rows of L A that belong to link i are its body Jacobian J<sub>i</sub>. So M is a sum over the "
        "links, and the torques of gravity are, too.",
        (
            ("V = L(θ) A θ̇,  L = (1 − W(θ))^{−1}", "§8.4"),
            ("M = A^T L^T G L A = ∑_i J_i^T G_i J_i", "§8.4, 8.2"),
            ("g = A^T L^T G L V̇_{base}", "§8.4"),
        ),
        ("dq",),
        lambda p: {f"J{k}": ("jacobian", {"frame": f, "kind": "body"}) for k, f in enumerate(p.body_frames)},
        chooses="link",
    ),
    SectionPanel(
        "8.5",
        "Forward dynamics",
        "What is left of the torques after gravity and velocities accelerates the robot, all joints at once through M. At "
        "first the torques hold it still. Change one, or give it a velocity, and let it go: the page integrates the "
        "accelerations.",
        (("M(θ) θ̈ = τ − h(θ, θ̇) − J^T(θ) F_tip", "§8.5"),),
        ("tau", "dq"),
        lambda p: {"inverse": ("inverse_dynamics", {**p.wrench_options, **p.load})},
        load="all",
        at_rest=True,
    ),
    SectionPanel(
        "8.6",
        "Dynamics in the task space",
        "Seen from the tip, a robot is a body whose mass depends on the direction. F is the force at the tip, without moment, "
        "that gives it an acceleration, gravity and velocities counted. The torques J<sub>v</sub><sup>T</sup> F produce it; "
        "the last table compares them.",
        (
            ("F = Λ(θ) V̇ + η(θ, θ̇)", "§8.6"),
            ("Λ = (J_v M^{−1} J_v^T)^{−1}", "§8.6"),
            ("η = Λ (J_v M^{−1} h − J̇_v θ̇)", "§8.6"),
        ),
        ("dV", "dq"),
        lambda p: {
            "task_inertia": ("task_inertia", {**task(p), **p.load}),
            "task_bias": ("task_bias", {**task(p), **p.load}),
            "tip_acceleration": ("frame_acceleration", {"frame": p.tip, "kind": "world_aligned"}),
        },
        load="payload",
        shown=("looks", "torques", "mass"),
    ),
    SectionPanel(
        "8.7",
        "Constrained dynamics: the tip on a wall",
        "The tip can slide along a wall without friction, and cannot leave it. The projector P keeps of the torques, and of "
        "the velocities, what moves the robot along the wall; the rest presses, with λ. At first the torques hold the robot "
        "and press; let it go, and the tip stays on the wall.",
        (
            ("A(θ) θ̇ = 0,  τ = M θ̈ + h + A^T λ", "§8.7"),
            ("λ = (A M^{−1} A^T)^{−1} (A M^{−1} (τ − h) + Ȧ θ̇)", "§8.7"),
            ("P = 1 − A^T (A M^{−1} A^T)^{−1} A M^{−1}", "§8.7"),
        ),
        ("tau", "dq"),
        along_wall,
        load="all",
        presses=True,
    ),
    SectionPanel(
        "8.9",
        "Gears, rotors and friction",
        "Every joint has the same motor behind a gear, which turns G times as fast as the joint. Its rotor has the inertia "
        "G² I<sub>rotor</sub> at the joint, often more than all links. The gear here is stiff and has no losses; its friction "
        "is that of the joint, in place of the robot file's.",
        (
            ("τ_i = τ_{i,links} + G^2 I_{rotor} θ̈_i + τ_{i,fric}", "§8.9.2"),
            ("τ_{i,fric} = b θ̇_i + μ sign(θ̇_i)", "§8.9.4"),
            ("τ_{motor} = τ_i / G,  θ̇_{motor} = G θ̇_i", "§8.9.2"),
        ),
        ("motor", "dq", "ddq"),
        with_friction,
        load="payload",
    ),
)
SECTIONS: Mapping[str, SectionPanel] = {section.number: section for section in _SECTIONS}
