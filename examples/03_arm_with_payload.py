"""Largest payload of an arm along a path, and the joint that limits it.

The torques are linear in the mass of the payload, τ = τ₀ + m τ₁. This gives the largest mass at each moment, and the joint that
reaches its torque limit first. The path is a move between two configurations.

To change: ``start`` and ``goal``, the duration (a slower move allows more mass), or the position of the payload in the hand.
"""

from argparse import ArgumentParser

import numpy as np

import twistwrench as tw
from twistwrench.viz.style import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="arm_with_payload.png", help="where to write it")
asked = parser.parse_args()

robot, names = tw.robots.ur5(), [n.removesuffix("_joint") for n in tw.robots.ur5().joint_names]
start, goal = np.array([-0.5, -1.9, 1.9, -0.3, 1.5, 0]), np.array([0.9, -0.5, 0.6, -0.4, 1.2, 1.0])
move = tw.trajectories.move(robot, start, goal, tw.trajectories.quintic(1.2))
t = np.linspace(0, move.duration, 241)
q, dq, ddq = move(t)

loaded = robot.with_payload(tw.SpatialInertia.from_com(1.0, com=(0, 0, 0.05)))
tau0 = robot.inverse_dynamics(q, dq, ddq)
tau1 = loaded.inverse_dynamics(q, dq, ddq) - tau0
limit = robot.limits.effort
with np.errstate(divide="ignore"):
    largest = (limit - np.sign(tau1) * tau0) / np.abs(tau1)  # of each joint at each moment
moment, joint = np.unravel_index(np.argmin(largest), largest.shape)
mass = largest[moment, joint]
shares = np.abs(tau0 + mass * tau1) / limit
second = np.sort(shares.max(axis=0))[-2]
print(
    f"carries {mass:.2f} kg; then {names[joint]} is at its limit at {t[moment]:.3f} s, the next at {second:.0%} of its own"
)

with figure(9.6, 4.2, f"A UR5 that moves {mass:.1f} kg: {names[joint]} is the first joint at its limit") as drawn:
    stage, axes = drawn.subplots(1, 2, width_ratios=[1, 1.2])
    tw.viz.draw(stage, loaded, q[[0, 120, 240]], inertia=False)

    for k, colour in enumerate((BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)):
        axes.plot(t, 100 * shares[:, k], color=colour, label=names[k])
        axes.plot(t, 100 * np.abs(tau0[:, k]) / limit[k], ":", color=colour, linewidth=1)
    axes.axhline(100, color=GREY, linestyle="--", label="limit")
    axes.set(xlabel="time [s]", ylabel="|torque|, % of its limit (dotted: empty hand)")
    axes.margins(x=0)
    drawn.legend(loc="outside lower right", ncols=7, frameon=False, fontsize=8)
    save(drawn, asked.picture)
