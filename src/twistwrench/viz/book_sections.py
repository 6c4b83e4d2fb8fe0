"""The sections of Modern Robotics that have a page, in the order of the book."""

from __future__ import annotations

from collections.abc import Mapping

from ..core import arguments
from .book_programs import along_wall, jacobian, link_jacobians, of_links, task, twist, with_friction
from .book_section import BookSection


def book_section(number: str) -> BookSection:
    """The section of a number; raises ValueRangeError, which lists them."""
    return SECTIONS[arguments.choice(number, "section", tuple(SECTIONS))]


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
        lambda p: {"twist_b": twist(p, "body"), "twist_s": twist(p, "space")},
        shown=("looks",),
    ),
    BookSection(
        "5.1",
        "The Jacobian, column by column",
        "Column i is the twist of the tip when joint i alone moves at 1 rad/s (sliding joints: 1 m/s). Where columns depend on "
        "each other, the tip has lost a direction.",
        (("V_s = J_s(θ) θ̇", "§5.1.1"), ("V_b = J_b(θ) θ̇", "§5.1.2")),
        ("dq",),
        lambda p: {
            "jacobian_b": jacobian(p, "body"),
            "jacobian_s": jacobian(p, "space"),
            "twist_b": twist(p, "body"),
        },
        shown=("looks",),
    ),
    BookSection(
        "5.2",
        "Statics: torques of a wrench at the tip",
        "The joints hold a wrench that the tip applies to the world. Each torque is the product of a column of the Jacobian "
        "with the wrench. Gravity comes on top and is left out here.",
        (("τ = J_b^T(θ) F_b", "(5.26)"),),
        ("wrench",),
        lambda p: {"jacobian_b": jacobian(p, "body"), "statics": ("wrench_torques", {"frame": p.tip})},
    ),
    BookSection(
        "5.3",
        "Singularities: a direction is lost",
        "Where the Jacobian loses rank, the tip cannot move in some way, however fast the joints turn. Stretch the "
        "arm, or line two axes of the wrist up: the last singular value goes to zero, and the joint velocities for that twist "
        "grow beyond bounds.",
        (("J_b(θ) = U Σ W^T,  Σ = diag(σ_1, …, σ_r)", "§5.3"), ("σ_r = 0:  rank J_b(θ) < r", "§5.3")),
        (),
        lambda p: {"jacobian_b": jacobian(p, "body")},
        shown=("looks",),
    ),
    BookSection(
        "5.4",
        "Manipulability: what moves fast pushes weakly",
        "Joint velocities of norm 1 move the tip within one ellipsoid; joint torques of norm 1 hold the forces within another. "
        "Both have the same axes, and the lengths of one are the reciprocals of the other's. Drag the tip.",
        (("v^T (J_v J_v^T)^{−1} v = 1", "§5.4"), ("f^T (J_v J_v^T) f = 1", "§5.4")),
        (),
        lambda _: {},
        shown=("looks",),
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
        of_links,
        chooses="link",
        shown=("looks",),
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
            **of_links(p),
            "wrenches": ("joint_wrenches", {"wrenches": (p.tip,)}),
            "inverse": ("inverse_dynamics", {"wrenches": (p.tip,)}),
        },
        chooses="link",
    ),
    BookSection(
        "8.4",
        "The equations in closed form: a sum over the links",
        "Twists of all links stacked in one column V, joint axes in A, transforms in L: then there is no recursion, only "
        "products. The six rows of L A that belong to link i are its body Jacobian J<sub>i</sub>, so M is a sum over the "
        "links, and the torques of gravity are, too.",
        (
            ("V = L(θ) A θ̇,  L = (1 − W(θ))^{−1}", "§8.4"),
            ("M = A^T L^T G L A = ∑_i J_i^T G_i J_i", "§8.4, 8.2"),
            ("g = A^T L^T G L V̇_{base}", "§8.4"),
        ),
        ("dq",),
        link_jacobians,
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
        at_rest=True,
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
            "task_inertia": ("task_inertia", {**task(p), **p.load}),
            "task_bias": ("task_bias", {**task(p), **p.load}),
            "tip_acceleration": ("frame_acceleration", {"frame": p.tip, "kind": "world_aligned"}),
        },
        load="payload",
        shown=("looks", "torques", "mass"),
    ),
    BookSection(
        "8.7",
        "Constrained dynamics: the tip on a wall",
        "The tip can slide along a wall without friction, and cannot leave it. At first the torques hold the robot and press "
        "on the wall. The projector P keeps of the torques what moves the robot; the rest presses, with λ. Velocities are "
        "projected, too. Let it go, and the tip stays on the wall.",
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
    BookSection(
        "8.9",
        "Gears, rotors and friction",
        "Every joint has the same motor behind a gear, which turns G times as fast as the joint. Its rotor feels as heavy as "
        "G² I<sub>rotor</sub> at the joint, often more than all links. The gear here is stiff and has no losses; its friction "
        "is that of the joint, in place of what the robot's file says.",
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
SECTIONS: Mapping[str, BookSection] = {section.number: section for section in _SECTIONS}
