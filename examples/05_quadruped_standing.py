"""Contact forces of a standing quadruped as its trunk moves forward, until no forces balance it.

A linear program finds contact forces inside the friction cones that balance the robot with the smallest joint torques, each as
a share of its limit. As the trunk moves forward, the load shifts from the rear feet to the front feet. Beyond the front feet no
forces inside the cones balance the robot, and the result is the motion that none of them resists.

To change: the friction coefficient, the height of the trunk, or a wrench on the trunk (``wrench_on_robot``).
"""

from argparse import ArgumentParser

import numpy as np
from scipy.spatial import ConvexHull

import twistwrench as tw
from twistwrench.viz.style import BLUE, GREY, ORANGE, SKY, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="quadruped_standing.png", help="where to write it")
parser.add_argument("--quick", action="store_true", help="fewer poses")
asked = parser.parse_args()

dog, legs = tw.robots.quadruped(), tw.robots.quadruped(floating_base=False)
feet, height, friction = ("FL_foot", "FR_foot", "RL_foot", "RR_foot"), 0.30, 0.6
contacts = [tw.statics.Contact(frame=foot, friction=friction) for foot in feet]
bend = {name: 0.8 if "thigh" in name else -1.6 for name in legs.joint_names if "hip" not in name}
bent = legs.coordinates(**bend)


def standing(lean):
    """The configuration with the trunk ``lean`` metres ahead, the feet where they were."""
    q = bent
    for foot in feet:  # in the trunk's frame they go back
        place = legs.forward_kinematics(bent, foot)
        place[:3, 3] = [place[0, 3] - lean, place[1, 3], -height]
        q = legs.inverse_kinematics(place, foot, q, rows="vx vy vz").q
    return np.concatenate([[1, 0, 0, 0, lean, 0, height], q])


leans = np.linspace(-0.24, 0.24, 9 if asked.quick else 49)
answers = [tw.statics.robot_equilibrium(dog, standing(lean), contacts) for lean in leans]
loads = np.array([a.forces[:, 2] if a.holds else np.full(4, np.nan) for a in answers])
share = np.array([a.share if a.holds else np.nan for a in answers])
weight = 9.81 * dog.mass_matrix(dog.neutral)[3, 3]  # M of the trunk's velocity: the whole mass
held = leans[~np.isnan(share)]
print(f"weight {weight:.2f} N, on the feet {np.nanmin(loads.sum(axis=1)):.2f} to {np.nanmax(loads.sum(axis=1)):.2f} N")
print(f"stands from {1000 * held.min():.0f} to {1000 * held.max():.0f} mm")
print(f"torques {np.nanmin(share):.1%} to {np.nanmax(share):.1%} of their limits")

with figure(9.6, 4.4, "A quadruped leans over its feet: forces of the floor, and the cones they must stay in") as drawn:
    stage, axes = drawn.subplots(1, 2, width_ratios=[1.15, 1])
    lean = 0.12
    q = standing(lean)
    found = tw.statics.robot_equilibrium(dog, q, contacts)
    camera = tw.viz.draw(stage, dog, q, azimuth=-1.0, elevation=0.28, inertia=False)
    turn = np.linspace(0, 2 * np.pi, 60)
    for foot, force in zip(feet, found.forces, strict=True):
        p = dog.forward_kinematics(q, foot)[:3, 3]
        rim = p + 0.1 * np.array([friction * np.cos(turn), friction * np.sin(turn), np.ones(60)]).T
        cone = camera.project(np.vstack([rim, p]))[0]
        stage.fill(*cone[ConvexHull(cone).vertices].T, color=SKY, alpha=0.35, zorder=3)
        stage.plot(*cone[:-1].T, color=BLUE, linewidth=0.8, zorder=3)
        ends = camera.project([p, p + 0.0025 * force])[0]
        stage.annotate(
            "", ends[1], ends[0], arrowprops={"arrowstyle": "-|>", "color": VERMILION, "linewidth": 2}, zorder=4
        )
        stage.annotate(
            f"{np.linalg.norm(force):.0f} N", ends[0], (5, -11), textcoords="offset points", color=VERMILION, fontsize=8
        )
    stage.autoscale_view()

    front, rear = loads[:, :2].sum(axis=1), loads[:, 2:].sum(axis=1)
    axes.plot(1000 * leans, front, color=BLUE, label="two front feet")
    axes.plot(1000 * leans, rear, color=ORANGE, label="two rear feet")
    axes.axhline(weight, color=GREY, linestyle="--", label="weight")
    for end in (leans.min(), held.min()), (held.max(), leans.max()):
        axes.axvspan(
            *(1000 * np.array(end)), color=VERMILION, alpha=0.12, linewidth=0, label="tips" if end[0] < 0 else None
        )
    axes.axvline(1000 * lean, color=GREY, linewidth=0.8, linestyle=":", label="pose at the left")
    axes.set(xlabel="trunk ahead of the feet [mm]", ylabel="force of the floor, upward [N]")
    axes.margins(x=0)
    drawn.legend(loc="outside lower right", ncols=5, frameon=False)
    save(drawn, asked.picture)
