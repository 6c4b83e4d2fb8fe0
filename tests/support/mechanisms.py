"""Closed mechanisms for the tests of constraints, each built link by link."""

from __future__ import annotations

import numpy as np

import twistwrench as tw
from twistwrench.mechanics.model.builder import ModelBuilder

CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.8, 0.6, 0.7
"""Lengths of a crank–rocker, m: by Grashof's rule 0.3 + 0.8 < 0.6 + 0.7 the crank turns all the way round."""
MASSES = (1.0, 2.0, 1.5)


def along(x=0.0, y=0.0, z=0.0):
    return tw.se3.exp([0, 0, 0, x, y, z])


def rod(length, mass, axis=0):
    """A slender rod from the origin along an axis."""
    com = 0.5 * length * np.eye(3)[axis]
    moment = mass * length**2 / 12 * (np.eye(3) - np.diag(np.eye(3)[axis])) + 1e-4 * np.eye(3)
    return tw.SpatialInertia.from_com(mass, com, moment)


def four_bar(lengths=(CRANK, COUPLER, ROCKER, GROUND), masses=MASSES):
    """Crank and coupler on one pin of the ground, the rocker on the other, open; angles turn x toward z."""
    crank, coupler, rocker, ground = lengths
    builder = ModelBuilder("four_bar")
    builder.add_link("ground_link")
    for name, length, mass in zip(("crank", "coupler", "rocker"), lengths, masses, strict=False):
        builder.add_link(name, rod(length, mass))
    builder.add_link("coupler_pin")
    builder.add_link("rocker_pin")
    builder.add_joint("a", "continuous", "ground_link", "crank", axis=(0, -1, 0))
    builder.add_joint("b", "continuous", "crank", "coupler", axis=(0, -1, 0), placement=along(crank))
    builder.add_joint("d", "continuous", "ground_link", "rocker", axis=(0, -1, 0), placement=along(ground))
    builder.add_joint("to_coupler_pin", "fixed", "coupler", "coupler_pin", placement=along(coupler))
    builder.add_joint("to_rocker_pin", "fixed", "rocker", "rocker_pin", placement=along(rocker))
    return tw.Robot(builder.build())


G = 9.81


def pins(phi):
    """Where the crank and the rocker meet the coupler, with the crank at phi, by plane geometry; (x, z) each."""
    B = np.array([CRANK * np.cos(phi), CRANK * np.sin(phi)])
    x, z = GROUND - B[0], -B[1]
    d2 = x * x + z * z
    along_line = (COUPLER**2 - ROCKER**2 + d2) / (2 * d2)
    across = np.sqrt(COUPLER**2 / d2 - along_line**2)
    return B, B + np.array([along_line * x - across * z, along_line * z + across * x])


def crank_only(angle):
    """Inertia, potential energy and the rocker's rate seen from the crank; rates of the pins by complex steps."""
    step = 1e-30
    B, C = pins(angle)
    dB, dC = (p.imag / step for p in pins(angle + 1j * step))
    crank, coupler, rocker = MASSES
    turn = ((dC - dB) @ np.array([-(C - B)[1], (C - B)[0]])) / COUPLER**2
    rocks = (dC @ np.array([-C[1], C[0] - GROUND])) / ROCKER**2
    middle = 0.5 * (dB + dC)
    inertia = (
        crank * CRANK**2 / 3
        + coupler * (middle @ middle + COUPLER**2 * turn**2 / 12)
        + rocker * ROCKER**2 * rocks**2 / 3
    )
    inertia += 1e-4 * (1 + turn**2 + rocks**2)
    height = crank * B[1] / 2 + coupler * (B[1] + C[1]) / 2 + rocker * C[1] / 2
    return inertia, G * height, rocks


LEGS = 3


def platform():
    """A 3-RRS platform, open: three legs of two hinges each, and a plate that floats among them."""
    builder = ModelBuilder("platform")
    builder.add_link("floor")
    builder.add_link("plate", tw.SpatialInertia.cylinder(radius=0.3, length=0.04, mass=4.0))
    builder.add_joint("float", "floating", "floor", "plate")
    for k in range(LEGS):
        turned = tw.se3.exp([0, 0, 2 * np.pi * k / LEGS, 0, 0, 0])
        for name, length, mass in ((f"thigh{k}", 0.35, 1.2), (f"shin{k}", 0.4, 0.8)):
            builder.add_link(name, rod(length, mass, axis=2))
        builder.add_link(f"foot{k}")
        builder.add_link(f"socket{k}")
        placement = turned @ along(0.35)
        builder.add_joint(f"hip{k}", "continuous", "floor", f"thigh{k}", axis=(0, 1, 0), placement=placement)
        builder.add_joint(f"knee{k}", "continuous", f"thigh{k}", f"shin{k}", axis=(0, 1, 0), placement=along(z=0.35))
        builder.add_joint(f"to_foot{k}", "fixed", f"shin{k}", f"foot{k}", placement=along(z=0.4))
        builder.add_joint(f"to_socket{k}", "fixed", "plate", f"socket{k}", placement=turned @ along(0.3))
    return tw.Robot(builder.build(tip="plate"))


def closed_platform():
    """The platform on three ball joints, and a configuration of it: knees out, the plate a little tilted."""
    robot = platform()
    bent = {f"hip{k}": 0.6 for k in range(LEGS)} | {f"knee{k}": -1.1 for k in range(LEGS)}
    near = robot.coordinates(float=[1, 0.05, -0.08, 0, 0.02, 0, 0.6], **bent)
    closed = robot
    for k in range(LEGS):
        closed = closed.close(f"socket{k}", f"foot{k}", "vx vy vz", near=near)
    return closed, closed.consistent(near)


def integrated(closed, q, dq, torques, duration, dt, each=lambda q, dq: None):
    """Runge and Kutta's fourth order on the configurations near each step's first (Munthe-Kaas), then back to the loops."""
    robot = closed.open()
    floating = [b.v_index for b in robot.model.leaders if b.joint.kind == "floating"]

    def rate(u, v, q0):
        du = v.copy()  # of q = q0 ⊕ u: a floating body's twist is J(-u) du
        for i in floating:
            du[i : i + 6] = tw.se3.left_jacobian_inverse(-u[i : i + 6]) @ v[i : i + 6]
        q = robot.add(q0, u)
        return du, closed.forward_dynamics(q, v, torques(q, v)).ddq

    for _ in range(round(duration / dt)):
        du, dv = [np.zeros(robot.nv)], [np.zeros(robot.nv)]
        for part in (0.0, 0.5, 0.5, 1.0):
            slope = rate(part * dt * du[-1], dq + part * dt * dv[-1], q)
            du.append(slope[0]), dv.append(slope[1])
        weights = dt / 6 * np.array([0, 1, 2, 2, 1])
        q, dq = robot.add(q, weights @ du), dq + weights @ dv
        q = closed.consistent(q)
        dq = closed.project_velocity(q, dq)
        each(q, dq)
    return q, dq
