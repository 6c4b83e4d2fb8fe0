"""Motor forces of a hexapod that moves a load around a circle of tilts.

Six legs on universal joints end in ball joints on a floating platform. Closed at six points, the mechanism has six degrees of
freedom and six motors that act along the legs. Inverse kinematics finds all coordinates of each pose with the loops closed;
inverse dynamics of the closed robot gives the motor forces. The load is high and off centre, so one leg is in tension while the
others are in compression.

To change: the load and its position, the tilt, or the period of a round (dotted: the same poses at rest).
"""

from argparse import ArgumentParser

import numpy as np

import twistwrench as tw
from twistwrench.viz.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="hexapod.png", help="where to write it")
parser.add_argument("--quick", action="store_true", help="fewer poses")
asked = parser.parse_args()

legs, load, place = range(6), 120.0, np.array([0.18, 0.0, 0.30])  # kg, and where it is on the platform [m]
height, tilt, period, swing = 1.0, 0.30, 1.6, 0.12  # m, rad, s, m


def ring(radius, middle, apart):
    """Six points in pairs around a circle, at 60 and 180 and 300 degrees from ``middle``."""
    angle = np.radians([middle + 120 * (k // 2) + (apart if k % 2 else -apart) for k in legs])
    return radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


anchors, sockets = ring(0.75, 0, 12), ring(0.45, 0, 42)


def at(p):
    """A placement without a turn."""
    return tw.se3.pose(np.eye(3), p)


builder = tw.ModelBuilder("hexapod")
builder.add_link("base")
builder.add_link("platform", tw.SpatialInertia.cylinder(radius=0.5, length=0.03, mass=25.0))
builder.add_joint("float", "floating", "base", "platform")
cylinder, rod = (
    tw.SpatialInertia.from_com(m, (0, 0, z), m * 0.05 * np.diag([1, 1, 0.05])) for m, z in ((6, 0.3), (3, -0.3))
)
for k in legs:
    builder.add_link(f"cross{k}")
    builder.add_link(f"cylinder{k}", cylinder)
    builder.add_link(f"rod{k}", rod)
    builder.add_link(f"socket{k}")
    builder.add_joint(f"u{k}", "continuous", "base", f"cross{k}", axis=(1, 0, 0), placement=at(anchors[k]))
    builder.add_joint(f"v{k}", "continuous", f"cross{k}", f"cylinder{k}", axis=(0, 1, 0))
    builder.add_joint(f"leg{k}", "prismatic", f"cylinder{k}", f"rod{k}", axis=(0, 0, 1))
    builder.add_joint(f"to_socket{k}", "fixed", "platform", f"socket{k}", placement=at(sockets[k]))
robot = tw.Robot(builder.build(tip="platform")).with_payload(tw.SpatialInertia.from_com(load, com=place), "platform")

level = {"float": [1, 0, 0, 0, 0, 0, height]}
for k, d in zip(legs, sockets + np.array([0, 0, height]) - anchors, strict=True):
    length = np.linalg.norm(d)
    level |= {f"leg{k}": length, f"u{k}": np.arctan2(-d[1], d[2]), f"v{k}": np.arcsin(d[0] / length)}
near = robot.coordinates(**level)
closed, motors = robot, [f"leg{k}" for k in legs]
for k in legs:
    closed = closed.close(f"socket{k}", f"rod{k}", "vx vy vz", near=near)

t = np.linspace(0, period, 25 if asked.quick else 121)
phase = 2 * np.pi * t / period
across = np.stack([np.cos(phase), np.sin(phase), 0 * t], axis=1)
poses = at(swing * across + [0, 0, height]) @ tw.se3.exp(np.concatenate([tilt * across, 0 * across], axis=1))
found = closed.inverse_kinematics(poses, "platform", near)
motion = tw.Motion(t, found.q, robot=robot)
dq = closed.project_velocity(found.q, motion.dq)
ddq = closed.project_acceleration(found.q, dq, motion.ddq)
columns = [robot.model.velocity_names.index(name) for name in motors]
force = closed.inverse_dynamics(found.q, dq, ddq, motors).tau[:, columns]
at_rest = closed.holding_torques(found.q, motors).tau[:, columns]

moment, worst = np.unravel_index(np.argmax(np.abs(force)), force.shape)
why = closed.explain(found.q[moment], dq[moment], ddq[moment], motors)
share = why.contribution("payload at platform")[columns[worst]] / why.torque[columns[worst]]
print(f"{int(found.converged.sum())} poses of {len(t)}, loops closed to {found.gap.max():.1e} m")
print(f"weight {9.81 * (load + 25 + 6 * 9):.0f} N; legs push {force.max():.0f} N at most and pull {-force.min():.0f} N")
print(f"leg {worst} carries most, {force[moment, worst]:.0f} N at {t[moment]:.2f} s, {share:.0%} of it for the load")

colours = (BLUE, SKY, GREEN, ORANGE, VERMILION, PURPLE)
with figure(9.6, 4.4, f"A hexapod swings {load:.0f} kg around: which leg carries how much") as drawn:
    stage, axes = drawn.subplots(1, 2, width_ratios=[1, 1.25])
    q = found.q[moment]
    T = robot.forward_kinematics(q, "platform")
    turn = np.radians(25)

    def seen(points):
        """Points from the side and a little above, (n, 2)."""
        x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
        return np.stack(
            [np.cos(turn) * x - np.sin(turn) * y, 0.3 * (np.sin(turn) * x + np.cos(turn) * y) + 0.95 * z], -1
        )

    def there(points):
        """Points of the platform in the base's frame."""
        return points @ T[:3, :3].T + T[:3, 3]

    stage.fill(*seen(anchors).T, facecolor="#eceef0", edgecolor=GREY)
    for k, colour in zip(legs, colours, strict=True):
        ends = seen([anchors[k], there(sockets[k])])
        stage.plot(*ends.T, color=colour, linewidth=1.5 + 5 * abs(force[moment, k]) / np.abs(force).max())
        stage.annotate(
            f"{force[moment, k]:.0f} N",
            ends[0],
            (0, -13),
            textcoords="offset points",
            ha="center",
            color=colour,
            fontsize=8,
        )
    stage.fill(*seen(there(sockets)).T, facecolor="#f6e8d8", edgecolor=INK, zorder=3, alpha=0.9)
    foot, top = seen(there(np.array([place * [1, 1, 0], place])))
    stage.plot(*np.array([foot, top]).T, color=INK, linewidth=1, zorder=4)
    stage.plot(*top, "o", color=INK, markersize=13, zorder=4)
    stage.set(aspect="equal", xticks=[], yticks=[], title=f"at {t[moment]:.2f} s, where leg {worst} carries most")
    stage.grid(visible=False)
    stage.spines[["left", "bottom"]].set_visible(False)

    for k, colour in zip(legs, colours, strict=True):
        axes.plot(t, force[:, k], color=colour, label=f"leg {k}")
        axes.plot(t, at_rest[:, k], ":", color=colour, linewidth=1)
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.axvline(t[moment], color=GREY, linewidth=0.8, linestyle="--")
    axes.set(xlabel="time [s]", ylabel="force of the motor, pushing [N] (dotted: at rest)")
    axes.margins(x=0)
    drawn.legend(loc="outside lower right", ncols=6, frameon=False, fontsize=8)
    save(drawn, asked.picture)
