"""Robots that stand, with their motions: a cart with an arm on four wheels, and the bundled quadruped."""

from __future__ import annotations

import numpy as np
from shared_robots import shared

import twistwrench as tw

WHEELS = ("wheel_fl", "wheel_fr", "wheel_rl", "wheel_rr")


def cart_text():
    """A cart of 30 kg on four wheels of 10 cm, with an arm of two links."""
    at = {"fl": (0.3, 0.25), "fr": (0.3, -0.25), "rl": (-0.3, 0.25), "rr": (-0.3, -0.25)}
    wheels = "".join(
        f'<link name="wheel_{n}"><collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision></link>'
        f'<joint name="to_{n}" type="fixed"><parent link="cart"/><child link="wheel_{n}"/>'
        f'<origin xyz="{x} {y} -0.1" rpy="1.5707963267948966 0 0"/></joint>'
        for n, (x, y) in at.items()
    )

    def link(name, mass, x):
        return (
            f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/><inertia ixx="0.1" ixy="0" ixz="0" '
            'iyy="0.1" iyz="0" izz="0.1"/></inertial></link>'
        )

    def joint(name, parent, child, place, axis):
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>'
            f'<axis xyz="{axis}"/><limit lower="-4" upper="4" effort="300" velocity="9"/></joint>'
        )

    arm = (
        link("upper", 5, 0.3) + joint("pan", "cart", "upper", "0 0 0.5", "0 0 1")
        + link("fore", 4, 0.3) + joint("elbow", "upper", "fore", "0.6 0 0", "0 1 0")
    )  # fmt: skip
    tool = '<link name="tool"/><joint name="to_tool" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0.6 0 0"/></joint>'
    return f'<robot name="cart">{link("cart", 30, 0)}{wheels}{arm}{tool}</robot>'


def turning(robot, angle=0.8, rows=31):
    """The arm turns about the vertical, from rest to rest."""
    t = np.linspace(0, 1, rows)
    s, ds, dds = t - np.sin(2 * np.pi * t) / (2 * np.pi), 1 - np.cos(2 * np.pi * t), 2 * np.pi * np.sin(2 * np.pi * t)
    q, dq, ddq = (np.column_stack([angle * x, 0 * x]) for x in (s, ds, dds))
    return tw.Motion(t, q, dq, ddq, robot=robot, in_seconds=True)


LEGS = ("FL", "FR", "RL", "RR")


quadruped = shared(tw.robots.quadruped)


@shared
def dog(acceleration=0.0, rows=41, period=0.4):
    """The bundled quadruped with its base, which sways sideways while its feet stand, in whole periods of a sine."""
    robot = quadruped()
    angles = {f"{leg}_{k}_joint": a for leg in LEGS for k, a in (("thigh", 0.8), ("calf", -1.6))}
    t, rate = np.linspace(0, period, rows), 2 * np.pi / period
    q = np.repeat(robot.coordinates(**angles)[None], rows, axis=0)
    feet = [f"{leg}_foot" for leg in LEGS]

    def places(q):
        return np.concatenate([np.asarray(robot.forward_kinematics(q, foot))[:, :3, 3] for foot in feet], axis=1)

    def maps(q):
        return np.concatenate([np.asarray(robot.jacobian(q, foot, "world_aligned"))[:, 3:] for foot in feet], axis=1)

    stand, dq, ddq = places(q), *np.zeros((2, rows, robot.nv))
    q[:, 5] = -acceleration / rate**2 * np.sin(rate * t)
    for _ in range(8):
        q[:, 7:] -= np.linalg.solve(maps(q)[:, :, 6:], (places(q) - stand)[..., None])[..., 0]
    J = maps(q)
    for x, wave in ((dq, -acceleration / rate * np.cos(rate * t)), (ddq, acceleration * np.sin(rate * t))):
        x[:, 4] = wave
        drift = np.einsum("nij,nj->ni", J, x)
        if x is ddq:
            h = 1e-6
            drift += np.einsum("nij,nj->ni", maps(robot.add(q, h * dq)) - maps(robot.add(q, -h * dq)), dq) / (2 * h)
        x[:, 6:] = -np.linalg.solve(J[:, :, 6:], drift[..., None])[..., 0]
    return robot, tw.Motion(t, q, dq, ddq, robot=robot, in_seconds=True)
