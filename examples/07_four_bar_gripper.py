"""Drive force of a gripper with two four-bar fingers, for the same grip force at every opening.

Each finger is a parallelogram, so its pad does not turn; a rod from the nut of the spindle drives its crank. The mechanism is
modelled as a tree of nine joints that is closed at four pins: one degree of freedom, one motor. Inverse kinematics finds all
joint positions for an opening of the pads, inside limits that keep the fingers from folding over. Inverse dynamics of the
closed robot gives the force on the nut, and the forces in the pins, while the pads hold an object.

To change: the force ``grip``, or where the rods are attached (``arm`` and ``rod``), which moves the opening of largest force.
"""

from argparse import ArgumentParser

import numpy as np

import twistwrench as tw
from twistwrench.viz.style import BLUE, GREEN, GREY, INK, ORANGE, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="four_bar_gripper.png", help="where to write it")
asked = parser.parse_args()

crank, apart, arm, rod, grip = 0.06, 0.025, 0.025, 0.05, 50.0  # m, and N on each pad
inner, pin, pad, up = (
    0.02,
    0.0075,
    0.02,
    0.045,
)  # m: crank's pivot and rod's pin from the middle, and the pad on its finger
sides = {"r": 1.0, "l": -1.0}


def at(x, z):
    """A placement in the plane of the gripper."""
    return tw.se3.pose(np.eye(3), [x, 0.0, z])


def bar(length, mass):
    """A slender bar along z."""
    return tw.SpatialInertia.from_com(mass, (0, 0, length / 2), mass * length**2 / 12 * np.diag([1, 1, 0.02]))


builder = tw.ModelBuilder("gripper")
builder.add_link("palm")
builder.add_link("nut", bar(0.01, 0.05))
builder.add_joint("spindle", "prismatic", "palm", "nut", axis=(0, 0, 1))
guess = {"spindle": -0.05}
for side, s in sides.items():
    for name, length, mass in (
        ("crank", crank, 0.04),
        ("follower", crank, 0.04),
        ("finger", up, 0.06),
        ("rod", rod, 0.02),
    ):
        builder.add_link(f"{name}_{side}", bar(length, mass))
    for parent, name, place, low, high in (
        ("palm", "crank", (s * inner, 0), 0.0, 1.2), ("palm", "follower", (s * (inner + apart), 0), 0.0, 1.2),
        (f"crank_{side}", "finger", (0, crank), -1.2, 0.0), ("nut", "rod", (s * pin, 0), 0.0, 1.4),
    ):  # fmt: skip
        turns = {"axis": (0, s, 0), "placement": at(*place), "lower": low, "upper": high}
        builder.add_joint(f"{name}_{side}_pin", "revolute", parent, f"{name}_{side}", **turns)
    for name, parent, place in (
        ("pad", "finger", (-s * pad, up)), ("heel", "finger", (s * apart, 0)), ("top", "follower", (0, crank)),
        ("elbow", "crank", (s * arm, 0)), ("end", "rod", (0, rod)),
    ):  # fmt: skip
        builder.add_link(f"{name}_{side}")
        builder.add_joint(f"to_{name}_{side}", "fixed", f"{parent}_{side}", f"{name}_{side}", placement=at(*place))
    guess |= {f"crank_{side}_pin": 0.5, f"finger_{side}_pin": -0.5, f"follower_{side}_pin": 0.5, f"rod_{side}_pin": 0.6}
closed = robot = tw.Robot(builder.build())
near = robot.coordinates(**guess)
for side in sides:
    closed = closed.close(f"heel_{side}", f"top_{side}", "vx vz", near=near)
    closed = closed.close(f"elbow_{side}", f"end_{side}", "vx vz", near=near)

width = np.linspace(0.004, 0.1, 49)
wanted = np.tile(np.eye(4), (len(width), 1, 1))
wanted[:, 0, 3] = 0.5 * width
found = closed.inverse_kinematics(wanted, "pad_r", near, rows="vx")
q = found.q
wrenches = {f"pad_{side}": [0, 0, 0, s * grip, 0, 0] for side, s in sides.items()}  # the thing pushes the pads apart
hold = closed.holding_torques(q, ["spindle"], wrench_on_robot=wrenches)
push = hold.tau[:, 0]
rods = np.linalg.norm(closed.wrenches(hold.lam)["elbow_r–end_r"][:, 3:], axis=1)
carried = closed.joint_wrenches(q, 0 * q, 0 * q, ["spindle"], wrench_on_robot=wrenches)[..., 3:]
pivots = np.linalg.norm(carried[:, robot.body_names.index("crank_r")], axis=1)
most = int(np.argmax(push))
print(f"{int(found.converged.sum())} openings of {len(width)}, loops closed to {found.gap.max():.1e} m")
print(
    f"{grip:.0f} N at each pad: the nut pushes {push.min():.1f} to {push.max():.1f} N, most at {1000 * width[most]:.0f} mm"
)
print(f"the rods carry up to {rods.max():.0f} N, the pivots of the cranks {pivots.max():.0f} N")

with figure(
    9.6, 4.2, f"A four-bar gripper that holds {grip:.0f} N: what its nut pushes, and what its pins carry"
) as drawn:
    stage, axes = drawn.subplots(1, 2, width_ratios=[1, 1.1])
    for row, alpha in ((6, 0.25), (24, 1.0), (48, 0.25)):

        def places(*names, row=row):
            """Where frames are in the plane [mm]."""
            return 1000 * np.array([robot.forward_kinematics(q[row], name)[[0, 2], 3] for name in names]).T

        for side in sides:
            crank_r, finger_r, follower_r = (f"{name}_{side}" for name in ("crank", "finger", "follower"))
            stage.fill(*places(crank_r, f"elbow_{side}", finger_r), color=BLUE, alpha=0.5 * alpha, linewidth=2)
            stage.plot(*places(crank_r, finger_r), "o-", color=BLUE, linewidth=3, markersize=5, alpha=alpha)
            stage.plot(*places(follower_r, f"top_{side}"), "o-", color=GREEN, linewidth=3, markersize=5, alpha=alpha)
            stage.plot(*places(f"top_{side}", finger_r, f"pad_{side}"), color=INK, linewidth=4, alpha=alpha)
            stage.plot(
                *places(f"rod_{side}", f"elbow_{side}"), "o-", color=ORANGE, linewidth=2.5, markersize=4, alpha=alpha
            )
        stage.plot(*places("rod_l", "rod_r"), color=VERMILION, linewidth=6, alpha=alpha)
    stage.axvline(0, color=GREY, linewidth=0.8, linestyle=":")
    stage.set(
        aspect="equal",
        xlabel="x [mm]",
        ylabel="z [mm]",
        title=f"open by {', '.join(f'{1000 * width[k]:.0f}' for k in (6, 24, 48))} mm",
    )

    for name, values, colour in (("nut", push, VERMILION), ("rod", rods, ORANGE), ("crank's pivot", pivots, BLUE)):
        axes.plot(1000 * width, values, color=colour, label=name)
    axes.axhline(grip, color=GREY, linestyle="--", label="each pad")
    axes.set(xlabel="opening of the pads [mm]", ylabel="force [N]", ylim=(0, None))
    axes.margins(x=0)
    drawn.legend(loc="outside lower right", ncols=4, frameon=False, fontsize=8)
    save(drawn, asked.picture)
