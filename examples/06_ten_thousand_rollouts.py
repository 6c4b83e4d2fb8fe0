"""Ten thousand rollouts of a Panda under computed torque, each with its own payload, gains and start.

The controller's model lacks the payload, so each joint ends with an error: M⁻¹ times the missing gravity torque, divided by
the square of the frequency ω of the gains. Higher gains reduce this error, but may require more torque at the
start than the motors have.

To change: the controller (``PD`` instead), the ranges of the random values, or the unknown parameters (``robot.varying()``).
"""

from argparse import ArgumentParser
from time import perf_counter

import numpy as np

import twistwrench as tw
from twistwrench.viz.style import AXIS, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="ten_thousand_rollouts.png", help="where to write it")
parser.add_argument("--quick", action="store_true", help="three hundred of them")
asked = parser.parse_args()

robot, samples, dt, steps = tw.robots.panda(), (300 if asked.quick else 10_000), 1e-3, 1600
start, goal = np.array([0, -0.6, 0, -2.2, 0, 1.7, 0.8]), np.array([0.8, 0.1, 0.2, -1.7, 0.1, 1.9, 0.4])
move = tw.trajectories.move(robot, start, goal, tw.trajectories.quintic(0.8))
q, dq, ddq = move(np.minimum(dt * np.arange(steps), move.duration))

rng = np.random.default_rng(0)
mass = rng.uniform(0.1, 3, samples)  # kg, in the hand
omega = np.exp(rng.uniform(np.log(10), np.log(60), samples))  # rad/s
q0 = start + rng.normal(0, 0.02, (samples, 7))


def rollouts(n):
    """The first n of them; gains (n, 1, 7) differ from one to the next, and stay from step to step."""
    w = omega[:n, None, None] * np.ones(7)
    law = tw.simulation.ComputedTorque(q, kp=w**2, kd=2 * w, dq_des=dq, ddq_des=ddq)
    load = {f"{robot.tip}.mass": mass[:n]}
    return robot.rollout(q0[:n], np.zeros(7), law, dt=dt, steps=steps, every=20, parameters=load, torques=True)


rollouts(8)  # compiles
begin = perf_counter()
motions = rollouts(samples)
seconds = perf_counter() - begin

hand = robot.forward_kinematics(motions.q[:, -1])[:, :3, 3] - robot.forward_kinematics(goal)[:3, 3]
error = 1000 * np.linalg.norm(hand, axis=1)
share = np.abs(motions.tau / robot.limits.effort).max(axis=(1, 2))
print(f"{samples * steps / seconds:.3g} steps a second")
print(f"hand off by {np.median(error):.2f} mm in the median, {np.quantile(error, 0.95):.2f} mm in nineteen of twenty")
print(f"{np.mean(share > 1):.1%} ask for more torque than there is")

with figure(9.6, 4.2, f"{samples:,} rollouts of a Panda: where the hand ends, and what it takes") as drawn:
    left, right = drawn.subplots(1, 2)
    for axes, shown, title in (
        (left, error, "hand off its goal [mm]"),
        (right, 100 * share, "largest |torque|, % of its limit (not clipped)"),
    ):
        dots = axes.scatter(omega, shown, c=mass, s=3, cmap="viridis", linewidths=0, rasterized=True)
        axes.set(xscale="log", yscale="log", xlabel="frequency of the gains ω [rad/s]", ylabel=title, xlim=(10, 60))
        axes.set_xticks([10, 20, 30, 40, 60], ["10", "20", "30", "40", "60"])
        axes.xaxis.minorticks_off()
    left.yaxis.set_major_formatter("{x:g}")
    right.set_yticks([50, 100, 200, 400], ["50", "100", "200", "400"])
    right.yaxis.minorticks_off()
    right.axhline(100, color=VERMILION, linestyle="--")
    drawn.colorbar(dots, ax=right, label="load that the controller does not know [kg]").outline.set_edgecolor(AXIS)
    save(drawn, asked.picture)
