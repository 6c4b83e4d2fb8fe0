"""Algorithms of mechanics on trees with every kind of joint: complete answers on record."""

from __future__ import annotations

import operator

import numpy as np
import pytest
from recorded_answers import Records, refusal
from recorded_robots import GRAVITY, MODELS, chain, coupled, driven, flat, floating, placed, state, tree

import twistwrench as tw
from twistwrench.mechanics.algorithms import (
    closed_form,
    constraint_projector,
    constraints,
    contact,
    coriolis_matrix,
    dynamics_derivatives,
    energies,
    forward_dynamics,
    friction,
    inverse_dynamics,
    joint_pair_factors,
    kinematics,
    loop_closure,
    mass_matrix,
    motor_loads,
    newton_step,
    operational_space,
    recursion,
    time_scalings,
)
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model import joint_loads

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

F1 = np.array([0.7, -1.9, 2.3, -4.1, 0.9, 3.3])
F2 = np.array([-1.3, 0.4, 0.8, 2.2, -3.1, 1.7])
F3 = np.array([0.2, 1.1, -0.6, 0.5, 2.4, -1.8])
KINDS = ("body", "space", "world_aligned")


def numbers(x):
    """Array of floats, whatever holds them."""
    return np.asarray(x, float)


def tried(call):
    """Result of a call, or its error."""
    try:
        return call()
    except Exception:
        return refusal(call)


def wrenches_of(model):
    """Wrenches at the tip, at a frame of a middle body and at one of the base."""
    frames = model.all_frames
    on_bodies = [name for name, frame in frames.items() if frame.body >= 0]
    on_base = [name for name, frame in frames.items() if frame.body < 0]
    return {on_bodies[-1]: F1, on_bodies[len(on_bodies) // 2]: F2} | dict.fromkeys(on_base[-1:], F3)


def of_models(call, *names):
    """Answers of a function of (model, q, dq, ddq, tau) for each robot."""
    answers = {}
    for name in names or MODELS:
        model = MODELS[name]()
        answers[name] = call(model, *state(model))
    return answers


def frames_of(model):
    return [name for k, name in enumerate(model.all_frames) if k % 2 or name == model.tip]


# ── Kinematics


@records.of
def poses_of_frames():
    def answers(model, q, *_):
        return {
            "frames": flat([numbers(kinematics.forward_kinematics(model, q, name))[:3] for name in model.all_frames]),
            "links": numbers(kinematics.link_poses(model, q)),
            "places": numbers(recursion.joint_poses(model, q)),
            "of bodies": numbers(recursion.base_poses(model, recursion.joint_poses(model, q))),
        }

    return of_models(answers, "tree", "floating", "driven")


@records.of
def jacobians_of_frames():
    def answers(model, q, dq, ddq, _):
        found = {}
        for kind in KINDS:
            frames = frames_of(model)
            found[kind] = flat(
                numbers([kinematics.jacobian(model, q, frame, kind) for frame in frames]),
                numbers([kinematics.jacobian_rate(model, q, dq, frame, kind) for frame in frames]),
                numbers(kinematics.jacobian_derivative(model, q, frames[-1], kind)),
                numbers([kinematics.frame_velocity(model, q, dq, frame, kind) for frame in frames]),
                numbers([kinematics.frame_acceleration(model, q, dq, ddq, frame, kind) for frame in frames]),
            )
        frame = frames[-1]
        found["default"] = [
            numbers(kinematics.jacobian(model, q, frame)),
            numbers(kinematics.jacobian_rate(model, q, dq, frame)),
            numbers(kinematics.frame_velocity(model, q, dq, frame)),
            numbers(kinematics.frame_acceleration(model, q, dq, ddq, frame)),
        ]
        found["wrench torques"] = numbers([kinematics.wrench_torques(model, q, F1, name) for name in model.all_frames])
        return found

    return of_models(answers, "tree", "floating", "driven", "chain")


@records.of
def coordinates_and_their_rates():
    def answers(model, q, dq, *_):
        other, *_ = state(model, 5)
        long = q * 1.5
        found = {
            "rates": numbers(kinematics.coordinate_rates(model, q)),
            "map": numbers(kinematics.velocity_map(model, q)),
            "of velocities": numbers(kinematics.rates_of_coordinates(model, q, dq)),
            "brackets": kinematics.brackets(model),
            "add": numbers(kinematics.add(model, q, 0.4 * dq)),
            "add at angles": numbers(kinematics.add_at_angles(model, q, 0.4 * dq, other)),
            "subtract": numbers(kinematics.subtract(model, other, q)),
            "normalised": [
                numbers(kinematics.normalise_quaternions(model, long)),
                numbers(kinematics.normalise_quaternions(model, long, 0.25)),
            ],
            "moving parts": [[np.shape(a), numbers(b)] for a, b in kinematics.moving_parts(model, q)],
        }
        angles = np.array([Angle(x) for x in other], object)
        found["halfway"] = numbers(kinematics.halfway(model, q, 0.4 * dq, angles))
        found["halfway, far"] = numbers(kinematics.halfway(model, q, 1e5 * dq, angles))[:2]
        return found

    return of_models(answers, "tree", "floating", "driven")


class Angle(float):
    """Angle that turns."""

    def turned(self, by):
        return Angle(float(self) + 2.0 * float(by))


@records.of
def rows_of_twists():
    rows = (
        None,
        "wx vz",
        "vy, wx",
        [3, 1],
        ["vx", 0],
        (np.int64(2),),
        "",
        [],
        "wx wx",
        [0, "wx"],
        "x",
        [6],
        [-1],
        [True],
        [1.0],
        3,
        "vx,vx",
    )
    return {
        repr(rows) if not isinstance(rows, tuple) else "number of NumPy": tried(
            lambda r=rows: kinematics.row_numbers(r)
        )
        for rows in rows
    } | {"names": [kinematics.KINDS, kinematics.PINOCCHIO]}


# ── Dynamics


@records.of
def torques_of_motions():
    def answers(model, q, dq, ddq, tau):
        wrenches = wrenches_of(model)
        return {
            "plain": numbers(inverse_dynamics.inverse_dynamics(model, q, dq, ddq)),
            "wrenches": numbers(inverse_dynamics.inverse_dynamics(model, q, dq, ddq, wrenches)),
            "friction": numbers(inverse_dynamics.inverse_dynamics(model, q, dq, ddq, friction=True)),
            "both": numbers(inverse_dynamics.inverse_dynamics(model, q, dq, ddq, wrenches, True)),
            "bias": numbers(inverse_dynamics.bias_forces(model, q, dq)),
            "bias with wrenches": numbers(inverse_dynamics.bias_forces(model, q, dq, wrenches)),
            "coriolis": numbers(inverse_dynamics.coriolis_forces(model, q, dq)),
            "gravity": [
                numbers(inverse_dynamics.gravity_forces(model, q)),
                numbers(inverse_dynamics.gravity_forces(model, q, wrenches)),
            ],
            "holding": [
                numbers(inverse_dynamics.holding_torques(model, q)),
                numbers(inverse_dynamics.holding_torques(model, q, wrenches)),
            ],
            "drives": numbers(inverse_dynamics.drive_torques(model, q, dq, ddq, wrenches)),
            "wrenches of joints": numbers(inverse_dynamics.joint_wrenches(model, q, dq, ddq, wrenches)),
            "without gravity": numbers(inverse_dynamics.joint_wrenches(model, q, dq, ddq, gravity=False)),
            "regressor": numbers(inverse_dynamics.regressor(model, q, dq, ddq)),
            "applied": [[i, numbers(F)] for i, F in inverse_dynamics.applied_wrenches(model, wrenches)],
            "computed": numbers(operational_space.computed_torque(model, q, dq, ddq)),
        }

    return of_models(answers) | {"names": inverse_dynamics.PARAMETER_NAMES}


@records.of
def mass_matrices_and_their_factors():
    def answers(model, q, dq, ddq, tau):
        M = mass_matrix.mass_matrix(model, q)
        L, D = mass_matrix.ldl_factors(M)
        W = mass_matrix.inverse_factor(L)
        return flat(
            {
                "M": numbers(M),
                "composite": numbers([G.parameters for G in mass_matrix.composite_inertias(model, q)]),
                "L": np.tril(numbers(L), -1),
                "D": numbers(D),
                "solved": numbers(mass_matrix.solve_ldl(L, D, tau)),
                "inverse": numbers(mass_matrix.symmetric_product(W, D)),
                "diagonal": numbers(mass_matrix.with_diagonal(M, np.arange(1.0, len(M) + 1))),
            }
        )

    return of_models(answers)


@records.of
def accelerations_of_torques():
    def answers(model, q, dq, ddq, tau):
        wrenches, added = wrenches_of(model), 0.1 * np.arange(1.0, model.nv + 1)
        found = {
            "pays": forward_dynamics.articulated_pays(model),
            "plain": numbers(forward_dynamics.forward_dynamics(model, q, dq, tau)),
            "wrenches": numbers(forward_dynamics.forward_dynamics(model, q, dq, tau, wrenches)),
            "added": numbers(forward_dynamics.forward_dynamics(model, q, dq, tau, None, added)),
            "friction": numbers(forward_dynamics.forward_dynamics(model, q, dq, tau, friction=True)),
        }
        if not model.couplings and not any(body.follows for body in model.bodies):
            found["articulated"] = [
                numbers(forward_dynamics.articulated_dynamics(model, q, dq, tau)),
                numbers(forward_dynamics.articulated_dynamics(model, q, dq, tau, wrenches, added)),
            ]
        return found

    lengths = {str(n): forward_dynamics.articulated_pays(chain(n)) for n in (6, 7, 8, 9, 10, 11)}
    return of_models(answers) | {"chains for which articulated bodies pay": lengths}


@records.of
def long_chains_take_articulated_bodies():
    model = chain(11)
    q, dq, ddq, tau = state(model)
    added = 0.1 * np.arange(1.0, model.nv + 1)
    return [
        numbers(forward_dynamics.forward_dynamics(model, q, dq, tau, {"link3": F1}, added, True)),
        numbers(operational_space.computed_torque(model, q, dq, ddq)),
    ]


@records.of
def parts_of_articulated_bodies():
    make = forward_dynamics._Articulated
    one, other = (
        make.from_rigid_body(tw.SpatialInertia.from_com(m, (0.1, -0.3, 0.2 * m), np.diag([0.3, 0.4, 0.5])))
        for m in (1.3, 2.1)
    )
    both = one + other
    U = np.array([[0.3, 0.1], [0.2, -0.4], [0.1, 0.5], [0.7, 0.2], [-0.6, 0.3], [0.2, 0.9]])
    less = both.minus_product(U, 0.1 * U)
    moved = less.in_frame(placed((0.3, -0.5, 0.7), (0.4, 0.2, -0.6)))
    return [vars(x) for x in (one, both, less, moved)] + [moved @ F1]


@records.of
def coriolis_matrices():
    def answers(model, q, dq, *_):
        C = numbers(coriolis_matrix.coriolis_matrix(model, q, dq))
        return {"C": C, "C dq": C @ dq, "symbols": numbers(coriolis_matrix.christoffel(model, q))}

    B = coriolis_matrix.BodyCoriolis.from_twist(
        tw.SpatialInertia.from_com(1.3, (0.1, -0.3, 0.2), np.diag([0.3, 0.4, 0.5])), F1
    )
    moved = (B + B).in_frame(placed((0.3, -0.5, 0.7), (0.4, 0.2, -0.6)))
    return of_models(answers, "tree", "floating", "coupled") | {
        "body": [moved.K, moved.p, moved @ F2, numbers(moved.transposed_times(F2))]
    }


@records.of
def derivatives_of_dynamics():
    def answers(model, q, dq, ddq, tau):
        wrenches = wrenches_of(model)
        return flat(
            numbers(dynamics_derivatives.inverse_dynamics_derivatives(model, q, dq, ddq, wrenches)),
            numbers(dynamics_derivatives.inverse_dynamics_derivatives(model, q, dq, ddq)),
            *map(numbers, dynamics_derivatives.forward_dynamics_derivatives(model, q, dq, tau, wrenches)),
            *map(numbers, dynamics_derivatives.forward_dynamics_derivatives(model, q, dq, tau)),
        )

    return of_models(answers)


@records.of
def factors_of_pairs_of_joints():
    def answers(model, q, dq, ddq, _):
        found = {
            "independent": joint_pair_factors.joints_are_independent(model),
            "relations": joint_pair_factors.relations(model),
            "constants": [joint_pair_factors.constant_mass(model), joint_pair_factors.constant_stiffness(model)],
        }
        if found["independent"]:
            found["mass"] = flat(*map(numbers, joint_pair_factors.mass_matrix_factors(model, q)))
            found["derivatives"] = flat(
                *map(numbers, joint_pair_factors.derivative_factors(model, q, dq, ddq, wrenches_of(model)))
            )
        return found

    return of_models(answers)


@records.of
def energies_and_momenta():
    def answers(model, q, dq, *_):
        return {
            "kinetic": float(energies.kinetic_energy(model, q, dq)),
            "potential": float(energies.potential_energy(model, q)),
            "com": numbers(energies.center_of_mass(model, q)),
            "com jacobian": numbers(energies.com_jacobian(model, q)),
            "momentum": numbers(energies.momentum(model, q, dq)),
            "about the com": numbers(energies.momentum_about_com(model, q, dq)),
            "velocities": numbers(energies.body_velocities(model, recursion.joint_poses(model, q), dq)),
        }

    return of_models(answers) | {
        "no mass": [energies._mass_inverse(0), energies._mass_inverse(0.0), energies._mass_inverse(4.0)]
    }


@records.of
def springs_and_armatures():
    def answers(model, q, dq, ddq, _):
        return {
            "energy": float(recursion.spring_energy(model, q)),
            "forces": numbers(recursion.spring_forces(model, q)),
            "stiffness": numbers(recursion.spring_stiffness(model)),
            "armature": numbers(recursion.armature_forces(model, dq, ddq)),
            "armature, many": numbers(recursion.armature_forces(model, np.stack([dq, 2 * dq]), np.stack([ddq, dq]))),
            "symbols": [[str(columns), numbers(L)] for columns, L in recursion.armature_symbols(model)],
        }

    return of_models(answers)


@records.of
def closed_forms_of_dynamics():
    def answers(model, q, dq, ddq, _):
        form = closed_form.closed_form(model, q, dq, wrenches_of(model))
        none = closed_form.closed_form(model, q, dq)
        return {
            "fields": flat(vars(form)),
            "torques": [form.inverse_dynamics(ddq), none.inverse_dynamics(ddq)],
            "accelerations": form.accelerations(ddq),
            "wrenches": form.wrenches(ddq),
        }

    return of_models(answers, "tree", "floating", "coupled")


# ── Friction, motors, tasks


@records.of
def friction_of_drives():
    def answers(model, q, dq, ddq, tau):
        slow = np.where(np.arange(model.nv) % 2, 0.01, -1.0) * dq
        creep = np.full(model.nv, 0.05)
        found = {"dry joints": friction.dry_friction_indices(model)}
        for name, rates in {"fast": dq, "slow": slow, "still": 0.0 * dq}.items():
            found[name] = flat(
                numbers(friction.friction_forces(model, rates)),
                numbers(friction.friction_forces(model, rates, tau)),
                numbers(friction.torque_past_friction(model, rates, tau)),
                numbers(friction.torque_past_eased_friction(model, rates, tau, friction.sliding_share(rates, creep))),
                numbers(
                    friction.friction_bounds(
                        model, np.array([Number(x) for x in rates], object), np.array([Number(x) for x in tau], object)
                    )
                ),
                friction.sliding_share(rates, creep),
                values(friction.sliding_share(symbols(rates), creep)),
            )
        return found

    x = np.array([-2.0, 0.0, 3.0], object)
    return of_models(answers) | {
        "signs": numbers(friction.signs(x)),
        "positive": [float(friction.positive(value)) for value in (-0.5, 0.0, 0.25)],
        "either": [friction.either(1.0, 3.0, 5.0), friction.either(0.0, 3.0, 5.0)],
        "largest": [
            friction.largest([-3.0, 2.0], 1.0),
            friction.largest([0.5], 1.0),
            friction.largest(np.array([-3.0, 2.0]), 1.0),
        ],
        "smallest": [
            friction.smallest([-3.0, 2.0], 1.0),
            friction.smallest([2.5], 1.0),
            friction.smallest(np.array([4.0, 2.0]), 1.0),
        ],
        "zero": [friction.is_zero(0.0), friction.is_zero(0), friction.is_zero(1e-300)],
        "equal": [
            friction._are_equal(1.0, 1.0),
            friction._are_equal(1.0, 2.0),
            friction._are_equal(x[0], x[0]),
            friction._are_equal(1, 1.0),
        ],
    }


@records.of
def loads_of_motors_and_bearings():
    answers = {}
    for make in (driven, coupled, tree):
        model = make()
        q, dq, ddq, tau = state(model)
        carried, rotor = (numbers(x) for x in inverse_dynamics.drive_torques(model, q, dq, ddq))
        F = numbers(inverse_dynamics.joint_wrenches(model, q, dq, ddq))
        answers[model.name + str(model.nv)] = {
            "driven": motor_loads.driven_velocities(model),
            "loads": motor_loads.motor_loads(model, dq, carried, rotor)._asdict(),
            "at rest and back": motor_loads.motor_loads(
                model, np.stack([0 * dq, -dq, 1e-7 * dq]), carried, rotor
            )._asdict(),
            "bearings": joint_loads.bearing_loads(model, F),
            "of many": joint_loads.bearing_loads(model, np.stack([F, 2 * F]))["tilting"],
        }
        if model.limited_followers:
            answers["followers"] = joint_loads.follower_torques(model, np.stack([F, -F]))
    power = motor_loads.power_balance(dq, tau, 2 * tau, dq, ddq)
    answers["power"] = [power, str(power), str(motor_loads.power_balance(np.stack([dq, dq]), tau, tau, tau, tau))]
    return answers


@records.of
def tasks_in_operational_space():
    def answers(model, q, dq, ddq, tau):
        frame = frames_of(model)[-1] if model.name != "tree" else "tool"
        found = {}
        for kind, rows in (("body", (0, 3)), ("space", (4, 1)), ("world_aligned", (5, 3, 2))):
            found[kind] = [
                list(map(numbers, operational_space.task_inertia(model, q, frame, kind, rows))),
                list(map(numbers, operational_space.task_bias(model, q, dq, frame, kind, rows))),
            ]
        k = np.arange(1.0, model.nv + 1)
        found["law"] = numbers(
            operational_space.proportional_derivative(model, q, dq, 0.3 * q, 0.1 * dq, 10 * k, 3 / k)
        )
        found["several degrees"] = operational_space.multi_dof_joints(model)
        found["clipped"] = numbers(operational_space.clip_torques(tau, 0.9 * k / k))
        return found

    return of_models(answers, "tree", "floating", "driven") | {
        "kept": numbers(operational_space.clip_torques([7.0], [1.0]))
    }


# ── Constraints

CLOSURE_ROWS = ((0, 1, 2, 3, 4, 5), (3, 5), (0, 3, 4), (1, 2, 4), (0, 2, 5, 3), (2,), (1,))


def some_constraints():
    offset = placed((0.3, -0.2, 0.5), (0.05, -0.1, 0.2))
    pose = tuple(map(tuple, offset.tolist()))
    return (
        constraints.Closure("tool", "wheel", (3, 5), pose),
        constraints.Rolling("thumb", (3, 4), "world_aligned"),
        constraints.Closure("ground", "ball", (0, 4), pose),
        constraints.Closure("tool", "wheel", (1,), pose),
        constraints.Closure("cart", "mirror", (0, 2, 4), pose),
        constraints.Rolling("thumb", (2,), "body"),
        constraints.Closure("mirror", "hand", (4,), pose),
    )


@records.of
def constraints_of_a_tree():
    model = tree()
    q, dq, _, tau = state(model)
    several = some_constraints()
    few = several[:3]
    return {
        "names": [constraints.names(several), constraints.row_names(several), constraints.with_gaps(several)],
        "independent": constraints.independent_constraints(several, (0, 2, 3, 5, 6, 9)),
        "poses": constraints.closure_poses(model, q, several),
        "no poses": constraints.closure_poses(model, q, several[1:2]).shape,
        "jacobian": numbers(constraints.constraint_jacobian(model, q, several)),
        "bias": numbers(constraints.constraint_bias(model, q, dq, several)),
        "dynamics": list(map(numbers, constraints.constrained_dynamics(model, q, dq, tau, wrenches_of(model), few))),
        "dynamics without wrenches": list(
            map(numbers, constraints.constrained_dynamics(model, q, dq, tau, constraints=few))
        ),
        "ground": [
            constraints.place_of(model, "ground").body,
            constraints.place_of(model, "tool").body,
            tried(lambda: constraints.place_of(model, "nowhere")),
        ],
        "small gaps": [
            numbers(loop_closure.small_gaps(model, q, [constraints.Closure("tool", "wheel", rows, several[0].pose)]))
            for rows in CLOSURE_ROWS
        ],
        "gaps": [
            loop_closure.closure_gaps(
                [constraints.Closure("tool", "wheel", rows, several[0].pose)],
                constraints.closure_poses(model, q, several[:1]),
            )
            for rows in CLOSURE_ROWS
        ],
        "gaps of many": loop_closure.closure_gaps(
            several, np.stack([constraints.closure_poses(model, x, several) for x in (q, 0.5 * q)])
        ),
        "no gaps": [
            loop_closure.small_gaps(model, q, several[1:2]),
            loop_closure.closure_gaps(several[1:2], np.zeros((3, 0, 4, 4))).shape,
        ],
    }


@records.of
def states_on_closed_loops():
    model = tree()
    q, dq, *_ = state(model)
    several = some_constraints()[:3]
    poses = [
        tuple(map(tuple, (constraints.closure_poses(model, q, (c,))[0]).tolist())) for c in (several[0], several[2])
    ]
    near = tuple(
        constraints.Closure(
            c.frame_a,
            c.frame_b,
            c.rows,
            tuple(
                map(
                    tuple,
                    (np.array(c.pose) @ np.array(pose) @ placed((0.01, 0.02, -0.015), (0.004, -0.003, 0.002))).tolist(),
                )
            ),
        )
        for c, pose in zip((several[0], several[2]), poses, strict=True)
    )
    near = (near[0], several[1], near[1])
    rows = loop_closure.LoopRows(near, (0, 2, 3, 5))
    return {
        "indices": rows.indices,
        "gaps": numbers(rows.gaps(model, q)),
        "jacobian": numbers(rows.jacobian(model, q)),
        "projected": list(map(numbers, loop_closure.project_state(model, q, dq, near, (0, 2, 3, 5)))),
        "all": list(map(numbers, loop_closure.project_state(model, q, dq, near, range(6)))),
        "rolling alone": list(map(numbers, loop_closure.project_state(model, q, dq, near[1:2], (0, 1)))),
    }


@records.of
def rotations_of_gaps():
    R = np.stack(
        [
            se3._exp(np.array([*w, 0.0, 0.0, 0.0]))[:3, :3]
            for w in ([0.3, -0.5, 0.2], [np.pi, 0, 0], [0, 0, np.pi], [0, 0, 0], [0, 3.0, 0.2])
        ]
    )
    p = np.arange(15.0).reshape(5, 3)
    return {
        str(rows): [
            loop_closure._gap(rows, R, p),
            [numbers(loop_closure._small_gap(rows, a, b)) for a, b in zip(R[[0, 3, 4]], p, strict=False)],
        ]
        for rows in CLOSURE_ROWS
    }


@records.of
def steps_that_close_loops():
    target = np.array([0.4, -0.3])

    def gaps(q):
        return np.stack([np.sin(q[:, 0]) + 0.5 * q[:, 1] ** 2 - target[0], q[:, 2] * q[:, 0] - target[1]], axis=-1)

    def rows_and_mass(q):
        zero = 0 * q[:, 0]
        A = np.stack(
            [np.stack([np.cos(q[:, 0]), q[:, 1], zero], axis=-1), np.stack([q[:, 2], zero, q[:, 0]], axis=-1)], axis=1
        )
        return A, np.broadcast_to(np.diag([1.0, 2.0, 0.5]), (len(q), 3, 3))

    problem = loop_closure.LoopProblem(
        gaps, rows_and_mass, lambda q, dv: q + dv, np.array([1.0, 0.7]), np.array([0.5, 2.0])
    )
    start = np.array([[0.6, -0.9, 0.5], [1.2, 0.4, -0.8], [0.5, 0.3, 0.2]])
    A, M = rows_and_mass(start)
    g = gaps(start)
    step = loop_closure._damped_step(g, A, M, problem.sizes, np.array([0.1, 0.5, 1.0]))
    return {
        "closed": loop_closure.close_loops(start, problem, 1e-9),
        "closed roughly": loop_closure.close_loops(start, problem, 0.2),
        "largest": [problem.largest_gaps(g), problem.gap_norms(g)],
        "damped": step,
        "step": loop_closure._take_step(start, g, step, problem),
        "step too long": loop_closure._take_step(start, g, 9.0 * step, problem),
        "step the wrong way": loop_closure._take_step(start, g, -step, problem),
    }


@records.of
def projectors_of_constraints():
    A = np.array(
        [[1.0, 0.3, -0.2, 0.5], [0.2, -0.7, 0.4, 0.1], [1.2, -0.4, 0.2, 0.6]]
    )  # the third row is the sum of the others
    full = A + np.diag([0.5, 0.4, 0.6])[:, :].dot(np.eye(3, 4))
    M = np.array([[2.0, 0.3, 0.1, 0.2], [0.3, 1.5, -0.2, 0.1], [0.1, -0.2, 1.1, 0.05], [0.2, 0.1, 0.05, 0.9]])
    sizes = np.array([1.0, 0.5, 2.0])
    answers = {}
    v, b = np.array([0.4, -0.7, 0.9, 0.2]), np.array([0.1, 0.3, -0.2])
    for name, (rows, options) in {
        "dependent": (A, {}),
        "independent": (full, {}),
        "rank of one": (full, {"max_rank": 1}),
        "many": (np.stack([A, full]), {}),
        "no rows": (A[:0], {}),
    }.items():
        batch = rows.shape[:-2]
        k = rows.shape[-2]
        P = constraint_projector.ConstraintProjector.from_rows(
            rows, np.broadcast_to(M, (*batch, 4, 4)), sizes[:k], **options
        )
        answers[name] = {
            "rank": P.rank,
            "lost": np.swapaxes(P.lost, -1, -2) @ P.lost,  # without the signs that LAPACK chooses
            "range": P.range,
            "pseudoinverse": P.pseudoinverse,
            "projector": P.projector,
            "nearest": [
                P.nearest(np.broadcast_to(v, (*batch, 4)), np.broadcast_to(b[:k], (*batch, k))),
                P.nearest(np.broadcast_to(v, (*batch, 4)), np.broadcast_to(b[:k], (*batch, k)), 0.5),
            ],
            "acceleration": P.constrained_acceleration(
                np.broadcast_to(v, (*batch, 4)), np.broadcast_to(b[:k], (*batch, k))
            ),
            "directions": np.swapaxes(P.directions, -1, -2) @ P.directions,
        }
    J = np.stack([np.vstack([full, 0.1 * full[[1, 2, 0]]]), 2 * np.vstack([A, full])])
    masses = np.stack([M, 1.5 * M])
    answers["rows"] = constraint_projector.mass_weighted_rows(A, M)
    answers["sizes"] = [
        constraint_projector.usual_sizes(J, masses),
        constraint_projector.usual_sizes(0 * J, masses),
        constraint_projector.usual_sizes(J * [[1]] * np.r_[np.zeros(3), np.ones(3)][:, None], masses),
        constraint_projector.usual_sizes(J * np.r_[np.ones(3), np.zeros(3)][:, None], masses),
    ]
    answers["independent rows"] = [
        constraint_projector.independent_rows(np.stack([A, A]), masses, sizes),
        constraint_projector.independent_rows(np.stack([A, full]), masses, sizes),
        constraint_projector.independent_rows(A[None, [2, 0, 1]], masses[:1], sizes),
    ]
    pivots = np.array([[2e-6, 1e-3], [0.5e-6, 1e-3], [2e-6, 0.2e-6], [np.nan, 1.0]])
    answers["singular values"] = [
        constraint_projector.needs_singular_values(pivots, np.array([1.0, 0.5])),
        constraint_projector.needs_singular_values((1e4 * pivots).astype(np.float32), np.array([1.0, 0.5], np.float32)),
    ]
    answers["singular"] = tried(lambda: constraint_projector.mass_weighted_rows(A, np.zeros((4, 4))))
    answers["empty"] = constraint_projector.mass_weighted_rows(np.zeros((2, 0)), np.zeros((0, 0))).shape
    return answers


@records.of
def balances_of_forces():
    A = np.array([[1.0, 0.3, -0.2, 0.5], [0.2, -0.7, 0.4, 0.1], [0.6, 0.4, 0.8, -0.3]])
    f = np.array([0.4, -0.7, 0.9, 0.2])
    sizes = np.array([1.0, 0.5, 2.0])
    masks = {
        "last two": [True, True, False, False],
        "none": [True] * 4,
        "all": [False] * 4,
        "one": [True, False, True, True],
    }
    answers = {name: constraints.balance(f, A, sizes, np.array(mask)) for name, mask in masks.items()}
    answers["many"] = constraints.balance(np.stack([f, 2 * f]), np.stack([A, A[::-1]]), sizes, np.array(masks["one"]))
    return answers


@records.of
def derivatives_along_constraints():
    k = np.arange(1.0, 40.0)
    A = np.array([[1.0, 0.3, -0.2, 0.5], [0.2, -0.7, 0.4, 0.1]])
    at = constraints.Slopes(
        A=A,
        A_by_q=np.sin(k[:32]).reshape(2, 4, 4),
        b_by_q=np.cos(k[:8]).reshape(2, 4),
        b_by_dq=np.cos(2.0 + k[:8]).reshape(2, 4),
        f=np.array([0.4, -0.7, 0.9, 0.2]),
        f_by_q=np.sin(3.0 * k[:16]).reshape(4, 4),
        f_by_dq=np.sin(5.0 * k[:16]).reshape(4, 4),
        M=np.array([[2.0, 0.3, 0.1, 0.2], [0.3, 1.5, -0.2, 0.1], [0.1, -0.2, 1.1, 0.05], [0.2, 0.1, 0.05, 0.9]]),
    )
    driven_entries = np.array([True, False, False, True])
    return constraints.constrained_derivatives(
        at, np.array([0.3, -0.2, 0.8, 0.5]), np.array([1.1, 0.4, -0.6, 0.7]), driven_entries
    )._asdict()


# ── Contact


class Number:
    """Number with the methods of a compiler's symbol."""

    def __init__(self, x):
        self.x = float(x.x if isinstance(x, Number) else x)

    def clip(self, low, high):
        return Number(min(max(self.x, float(Number(low).x)), float(Number(high).x)))

    def sign(self):
        return Number(np.sign(self.x))

    def __float__(self):
        return self.x

    def __neg__(self):
        return Number(-self.x)

    def __abs__(self):
        return Number(abs(self.x))


def _add_methods():
    for name in ("sqrt", "exp", "sin", "cos"):
        function = vars(np)[name]
        setattr(Number, name, lambda self, f=function: Number(f(self.x)))
    for name in ("add", "sub", "mul", "truediv", "pow"):
        f = vars(operator)[name]
        setattr(
            Number,
            f"__{name}__",
            lambda a, b, f=f: NotImplemented if isinstance(b, np.ndarray) else Number(f(a.x, Number(b).x)),
        )
        setattr(Number, f"__r{name}__", lambda a, b, f=f: Number(f(Number(b).x, a.x)))


_add_methods()


def symbols(x):
    """Numbers in an array of any shape."""
    x = np.asarray(x, float)
    return np.array([Number(value) for value in x.ravel()], object).reshape(x.shape)


def values(x):
    return np.asarray([float(value) for value in np.asarray(x, object).ravel()])


@records.of
def steps_of_velocities():
    answers = {}
    for name in ("driven", "coupled", "floating"):
        model = MODELS[name]()
        q, dq, _, tau = map(symbols, state(model))
        gains = symbols(np.where(np.arange(model.nv) % 3 == 1, 0.0, 5.0 + np.arange(model.nv)))
        numeric_gains = np.array([0.0 if float(g) == 0.0 else g for g in gains], object)
        limits = symbols(3.0 + 2.5 * np.arange(model.nv))
        push = symbols(0.4 * np.cos(np.arange(model.nv)))
        h = Number(0.01)
        has_dry = bool(friction.dry_friction_indices(model))
        options = {
            "plain": {},
            "push": {"push": push},
            "gains": {"gains": numeric_gains},
            "gains and friction": {"gains": numeric_gains, "friction": True},
            "limits": {"limits": limits},
            "limits and gains": {"limits": limits, "gains": numeric_gains},
            "friction": {"friction": True},
            "everything": {
                "limits": limits,
                "gains": numeric_gains,
                "friction": True,
                "push": push,
                "wrenches": {next(iter(reversed(model.frames))): symbols(F1)},
            },
        }
        if model.couplings:
            options = {key: option for key, option in options.items() if "friction" not in option}
        answers[name] = {"dry": has_dry}
        for key, option in options.items():
            answers[name][key] = flat([values(x) for x in contact.velocity_step(model, q, dq, h, tau, **option)])
            if key in ("friction", "everything"):
                still = symbols(1e-4 * values(dq))
                answers[name][f"{key}, slow"] = [
                    values(x) for x in contact.velocity_step(model, q, still, h, 0.05 * tau, **option)
                ]
    return answers


@records.of
def forces_of_contacts():
    answers = {"force": {}}
    for depth in (-0.01, 0.0, 0.02):
        for rate in (-9.0, -0.5, 0.4):
            for exponent in (1.0, 1.5, 1.3):
                answers["force"][f"{depth} {rate} {exponent}"] = float(
                    contact.contact_force(Number(depth), Number(rate), 1e4, exponent, 0.3)
                )
    model = floating()
    q, dq, *_ = state(model)
    points = np.array([[0.1, -0.2, -0.5], [0.3, 0.4, 0.2], [0.0, 0.1, 1.9]])
    normal = np.array([0.36, 0.48, 0.8])
    for exponent in (1.0, 1.5):
        tau, depths = contact.plane_contact(
            model,
            symbols(q),
            symbols(dq),
            "lower",
            exponent,
            symbols(points),
            symbols(normal),
            symbols([0.9, 3e3, 0.4, 0.7, 0.05]),
        )
        answers[f"plane {exponent}"] = [values(tau), values(depths)]
    q = symbols([0.3, -0.9, 1.4, 0.2])
    tau, depths = contact.stop_contact(
        q,
        symbols([0.5, -0.2, 0.8, 0.1]),
        [(1, 0), (2, 3)],
        1.5,
        symbols([-0.7, -1.0]),
        symbols([0.6, 1.1]),
        symbols([2e3, 0.6]),
    )
    answers["stops"] = [values(tau), values(depths)]
    answers["largest"] = float(contact.largest([Number(1.0), Number(3.0), Number(2.0)]))
    return answers


# ── Newton steps of inverse kinematics


@records.of
def newton_steps_towards_poses():
    model = chain(7)
    q, *_ = state(model)
    q = 0.5 * q
    T = numbers(kinematics.forward_kinematics(model, q, "link1"))
    near = T @ placed((0.05, -0.03, 0.04), (0.02, 0.01, -0.03))
    far = T @ placed((0.9, -0.7, 1.4), (0.6, 0.4, -0.5))
    scale = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
    low, high = np.full(7, -np.inf), np.full(7, np.inf)
    low[:3], high[1:5] = [-1.0, q[1], -0.5], [0.9, 0.7, q[3], 0.8]
    answers = {}
    for name, options in {
        "six rows": {},
        "posture": {"posture": True},
        "one round": {"rounds": 1},
        "few rows": {"frames": (("link1", (3, 4, 1)),), "scale": scale[:3]},
        "no angles": {"frames": (("link1", (5, 3)),), "scale": scale[3:5]},
        "two frames": {"frames": (("link1", (0, 2)), ("link3", (4,))), "scale": scale[2:5]},
    }.items():
        step = newton_step.NewtonStep(
            **(
                {
                    "model": model,
                    "frames": (("link1", tuple(range(6))),),
                    "scale": scale,
                    "low": low,
                    "high": high,
                    "coordinates": tuple(range(7)),
                }
                | options
            )
        )
        posture = 0.2 - 0.1 * np.arange(7) if step.posture else np.zeros(0)
        found = {"sizes": step.sizes, "rows": step.rows, "begins": step.begins}
        for where, target in {
            "near": near,
            "far": far,
            "there": T,
            "not a pose": 1.01 * T,
            "bad row": T + np.diag([0, 0, 0, 3e-7]),
        }.items():
            passed = np.concatenate([np.zeros(7), [0.0, 0.3], np.zeros(len(step.scale)), np.zeros(7), [0.5, 1.0]])
            inputs = np.concatenate([*[target.ravel()] * len(step.frames), posture, [1e-6, 1e-4]])
            found[where] = flat(*step(q, q, passed, inputs))
        answers[name] = found
    return answers


@records.of
def newton_steps_with_loops():
    model = tree()
    q, *_ = state(model)
    loop = loop_closure.LoopRows(some_constraints()[:1], (0, 1))
    step = newton_step.NewtonStep(
        model,
        (("thumb", (0, 3, 5)),),
        np.array([1.0, 2.0, 2.0, 0.5, 0.7]),
        np.full(11, -np.inf),
        np.full(11, 3.0),
        tuple(range(11)),
        loops=loop,
        gaps=(1e-6, 1e-5),
    )
    T = numbers(kinematics.forward_kinematics(model, q, "thumb")) @ placed((0.05, -0.03, 0.04), (0.02, 0.01, -0.03))
    e, displacements = step.residual(q, T[None])
    V = step.scale * numbers(e)
    return {
        "residual": [numbers(e), displacements],
        "damping": step.damping(V),
        "within": [
            float(step.is_within_tolerance(numbers(e) * share, displacements * share, np.array([1e-3, 1e-2])))
            for share in (1.0, 1e-7)
        ],
        "step": list(map(numbers, step.step(q, q, V, np.zeros(0), 1.0))),
        "masks": list(
            map(
                numbers,
                newton_step.NewtonStep(
                    chain(3), (), V[:0], np.array([-1.0, 0.3, -np.inf]), np.array([0.2, np.inf, 0.5]), (0, 1, 2)
                ).limit_masks(np.array([0.2, 0.3, 0.5 - 1e-13])),
            )
        ),
    }


# ── Time scalings and paths


@records.of
def time_scalings_over_time():
    t = np.array([-0.3, 0.0, 0.1, 0.4, 0.5, 0.75, 1.0, 1.3, 1.9, 2.0, 2.2, np.nan])
    laws = {
        "cubic": time_scalings.cubic(2.0),
        "quintic": time_scalings.quintic(2.0),
        "uniform": time_scalings.uniform(2.0),
        "trapezoid of v and a": time_scalings.trapezoid(v=0.75, a=1.5),
        "trapezoid of v and duration": time_scalings.trapezoid(v=0.625, duration=2.0),
        "trapezoid of a and duration": time_scalings.trapezoid(a=1.25, duration=2.0),
        "triangle": time_scalings.trapezoid(v=9.0, a=1.0),
        "s-curve": time_scalings.s_curve(2.0),
        "s-curve of shares": time_scalings.s_curve(2.0, alpha=0.25, beta=0.4),
        "s-curve of one share": time_scalings.s_curve(2.0, alpha=0.5, beta=0.5),
    }
    answers = {}
    for name, law in laws.items():
        longer = law.stretched(3.0)
        third = getattr(law, "third", None)
        answers[name] = {
            "name": law.name,
            "duration": [law.duration, longer.duration],
            "values": flat(law(t), law(0.7), longer(t)),
            "third": None if third is None else flat(third(t), longer.third(t)),
        }
    answers["knots"] = [
        laws["s-curve of shares"].knots,
        laws["s-curve"].stretched(3.0).knots,
        time_scalings.Averaged(np.array([0.0, 0.3, 1.0]), np.array([0.2, 0.6, 0.1]), (0.2, 0.3), "a")(t),
    ]
    answers["shares"] = [
        time_scalings.cubic_share(0.3),
        time_scalings.quintic_share(0.3),
        time_scalings.horner((1.0, 2.0, -3.0), np.array([0.5, 2.0])),
        time_scalings.derivative_coefficients((1.0, 2.0, -3.0, 4.0)),
    ]
    return answers


@records.of
def time_scalings_that_cannot_be():
    calls = {
        "duration": lambda: time_scalings.cubic(0.0),
        "infinite": lambda: time_scalings.quintic(np.inf),
        "negative": lambda: time_scalings.uniform(-1.0),
        "none": lambda: time_scalings.trapezoid(),
        "one": lambda: time_scalings.trapezoid(v=1.0),
        "three": lambda: time_scalings.trapezoid(v=1.0, a=1.0, duration=1.0),
        "slow": lambda: time_scalings.trapezoid(v=0.5, duration=2.0),
        "fast": lambda: time_scalings.trapezoid(v=1.01, duration=2.0),
        "as fast as may be": lambda: time_scalings.trapezoid(v=1.0, duration=2.0),
        "weak": lambda: time_scalings.trapezoid(a=0.99, duration=2.0),
        "as weak as may be": lambda: time_scalings.trapezoid(a=1.0, duration=2.0),
        "alpha": lambda: time_scalings.s_curve(1.0, alpha=0.51),
        "beta": lambda: time_scalings.s_curve(1.0, beta=0.0),
        "stretched": lambda: time_scalings.cubic(1.0).stretched(0.0),
        "stretched trapezoid": lambda: time_scalings.trapezoid(v=1.0, a=1.0).stretched(-1.0),
        "stretched s-curve": lambda: time_scalings.s_curve(1.0).stretched(np.nan),
        "start": lambda: time_scalings.screw_path(2 * np.eye(4), np.eye(4)),
        "end": lambda: time_scalings.straight_path(np.eye(4), np.eye(3)),
        "many": lambda: time_scalings.screw_path(np.stack([np.eye(4)] * 2), np.eye(4)),
        "not finite": lambda: time_scalings.screw_path(np.eye(4), np.full((4, 4), np.nan)),
    }
    return {name: tried(call) for name, call in calls.items()}


@records.of
def paths_between_poses():
    start, end = placed((0.3, -0.2, 0.5), (0.4, 0.1, -0.3)), placed((-0.6, 0.9, 1.2), (1.1, -0.7, 0.8))
    s = np.array([0.0, 0.3, 1.0])
    return {
        name: {
            "twist": path.twist,
            "poses": path(s),
            "at": path(0.4),
            "twists": path.body_twist(s),
            "twist at": path.body_twist(0.4),
            "straight": path.straight,
        }
        for name, path in (
            ("screw", time_scalings.screw_path(start, end)),
            ("straight", time_scalings.straight_path(start, end)),
        )
    } | {"gravity": GRAVITY}


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
