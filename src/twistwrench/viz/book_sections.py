"""Sections of Modern Robotics as pages show them: the idea, the formulas with their numbers, what is set, what is computed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core import arguments
from ..errors import ValueRangeError
from .task_rows import task_rows

if TYPE_CHECKING:
    from ..robot import Robot
    from .page_programs import PagePrograms

Asked = Mapping[str, tuple[str, dict[str, Any]]]
"""Quantities and their options by the names that the page calls their programs."""
MOST_JOINTS = 9
"""Columns that a table of the page has room for."""


@dataclass(frozen=True)
class BookSection:
    """What one page shows; its readout is the function of the same number in ``player/readouts.js``."""

    number: str
    title: str
    idea: str
    formulas: tuple[tuple[str, str], ...]
    """As :func:`~twistwrench.viz.formula.formula_html` takes them, and where the book has them."""
    inputs: tuple[str, ...]
    """Sliders besides the joints': dq, ddq, tau, wrench, dV."""
    programs: Callable[[PagePrograms], Asked]
    chooses: str = ""
    """What is picked from a list: a joint or a link."""
    load: str = ""
    """Sliders of what the tip carries: payload, all (with push and the button that lets the robot go), or none."""
    shown: tuple[str, ...] = ("looks", "torques")
    """What is switched on at first."""

    def require(self, robot: Robot) -> None:
        """Raise ValueRangeError unless the page can show this robot."""
        why = None
        if robot.model.tip is None:
            why = "has no single tip"
        elif any(body.joint.nv != 1 or not body.joint.driven for body in robot.model.leaders):
            why = "has joints that neither turn nor slide, or a base that moves"
        elif not 1 <= robot.nv <= MOST_JOINTS:
            why = f"has {robot.nv} joints that move"
        if why is not None:
            raise ValueRangeError(
                f"section {self.number}: robot {robot.name!r} {why}. These pages take an arm with one tip and 1 to "
                f"{MOST_JOINTS} joints that turn or slide, such as planar_2r, ur5 or panda."
            )


def book_section(number: str) -> BookSection:
    """The section of a number; raises ValueRangeError, which lists them."""
    return SECTIONS[arguments.choice(number, "section", tuple(SECTIONS))]


def _of_links(programs: PagePrograms) -> dict[str, tuple[str, dict[str, Any]]]:
    found = {}
    for k, frame in enumerate(programs.body_frames):
        found[f"V{k}"] = "frame_velocity", {"frame": frame, "kind": "body"}
        found[f"dV{k}"] = "frame_acceleration", {"frame": frame, "kind": "body"}
    return found


def _jacobian(programs: PagePrograms, kind: str) -> tuple[str, dict[str, Any]]:
    return "jacobian", {"frame": programs.tip, "kind": kind}


def _twist(programs: PagePrograms, kind: str) -> tuple[str, dict[str, Any]]:
    return "frame_velocity", {"frame": programs.tip, "kind": kind}


def _task(programs: PagePrograms) -> dict[str, Any]:
    return {"frame": programs.tip, "kind": "world_aligned", "rows": task_rows(programs.robot, programs.tip)}


_SECTIONS = (
    BookSection(
        "3.4",
        "Twists and wrenches at the tip",
        "The same motion and the same load, written in two frames: {b} at the tip and {s} at the base. The six numbers change "
        "with the frame, and their product, the power, does not.",
        (
            ("V_s = [Ad_{T_sb}] V_b", "(3.83)"),
            ("F_s = [Ad_{T_bs}]^T F_b", "(3.98)"),
            ("V_b^T F_b = V_s^T F_s", "§3.4"),
        ),
        ("dq", "wrench"),
        lambda p: {"twist_b": _twist(p, "body"), "twist_s": _twist(p, "space")},
    ),
    BookSection(
        "5.1",
        "The Jacobian, column by column",
        "Column i is the twist of the tip when joint i alone moves at 1 rad/s (sliding joints: 1 m/s). Where columns depend on "
        "each other, the tip has lost a direction.",
        (("V_s = J_s(θ) θ̇", "§5.1.1"), ("V_b = J_b(θ) θ̇", "§5.1.2")),
        ("dq",),
        lambda p: {
            "jacobian_b": _jacobian(p, "body"),
            "jacobian_s": _jacobian(p, "space"),
            "twist_b": _twist(p, "body"),
        },
    ),
    BookSection(
        "5.2",
        "Statics: torques of a wrench at the tip",
        "The joints hold a wrench that the tip applies to the world. Each torque is the product of a column of the Jacobian "
        "with the wrench. Gravity comes on top and is left out here.",
        (("τ = J_b^T(θ) F_b", "(5.26)"),),
        ("wrench",),
        lambda p: {"jacobian_b": _jacobian(p, "body"), "statics": ("wrench_torques", {"frame": p.tip})},
    ),
    BookSection(
        "8.1.2",
        "Coriolis and centripetal torques, term by term",
        "Without gravity and at constant joint velocities a robot still needs torques. Each is a sum of products of two "
        "velocities: squares are centripetal, the others Coriolis terms.",
        (
            ("c_i = ∑_j ∑_k Γ_ijk(θ) θ̇_j θ̇_k", "§8.1.2"),
            ("Γ_ijk = ½ (∂m_ij/∂θ_k + ∂m_ik/∂θ_j − ∂m_jk/∂θ_i)", "(8.12)"),
        ),
        ("dq",),
        lambda p: {"christoffel": ("christoffel", p.load), "coriolis": ("coriolis_forces", p.load)},
        chooses="joint",
        load="payload",
    ),
    BookSection(
        "8.1.3",
        "The mass matrix, and how heavy the tip is",
        "The ellipsoid holds the forces that accelerate the tip by 1 m/s² in each direction, at rest and without gravity: it "
        "is long where the tip is heavy. Drag the tip and watch it turn. J<sub>v</sub> is the lower half of J, for the "
        "velocity of the tip.",
        (("K = ½ θ̇^T M(θ) θ̇", "§8.1.2"), ("Λ(θ) = (J_v M^{−1} J_v^T)^{−1}", "§8.1.3, 8.6")),
        (),
        lambda _: {},
        load="payload",
        shown=("looks", "mass"),
    ),
    BookSection(
        "8.2",
        "One rigid body",
        "One link, as a body of its own: its twist, its momentum, and the sum of all wrenches on it, its weight included, in "
        "the frame {b} of the link.",
        (("P_b = G_b V_b", "§8.2.2"), ("F_b = G_b V̇_b − [ad_{V_b}]^T G_b V_b", "(8.40)")),
        ("dq", "ddq"),
        _of_links,
        chooses="link",
    ),
    BookSection(
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
            **_of_links(p),
            "wrenches": ("joint_wrenches", {"wrenches": (p.tip,)}),
            "inverse": ("inverse_dynamics", {"wrenches": (p.tip,)}),
        },
        chooses="link",
    ),
    BookSection(
        "8.5",
        "Forward dynamics",
        "Given torques, how does the robot accelerate? At first the torques hold it still. Change one, or give it a velocity, "
        "and let it go: the page integrates the accelerations.",
        (("M(θ) θ̈ = τ − h(θ, θ̇) − J^T(θ) F_tip", "§8.5"),),
        ("tau", "dq"),
        lambda p: {"inverse": ("inverse_dynamics", {**p.pushed, **p.load})},
        load="all",
    ),
    BookSection(
        "8.6",
        "Dynamics in the task space",
        "The equation of motion as the tip feels it: the force at the tip, without moment, that gives it an acceleration, "
        "gravity and velocities counted. The torques J<sub>v</sub><sup>T</sup> F put it there; the last table says what they "
        "give.",
        (
            ("F = Λ(θ) V̇ + η(θ, θ̇)", "§8.6"),
            ("Λ = (J_v M^{−1} J_v^T)^{−1}", "§8.6"),
            ("η = Λ (J_v M^{−1} h − J̇_v θ̇)", "§8.6"),
        ),
        ("dV", "dq"),
        lambda p: {
            "task_inertia": ("task_inertia", {**_task(p), **p.load}),
            "task_bias": ("task_bias", {**_task(p), **p.load}),
            "tip_acceleration": ("frame_acceleration", {"frame": p.tip, "kind": "world_aligned"}),
        },
        load="payload",
        shown=("looks", "torques", "mass"),
    ),
)
SECTIONS: Mapping[str, BookSection] = {section.number: section for section in _SECTIONS}
