"""A Delta robot: three motors, six rods, and a platform that never turns. Closed six times, simulated under its motors' law.

The tree of joints: three arms on the base, on each of them two rods by universal joints, and a platform that floats. Each rod's
end is then closed onto its socket of the platform with a ball joint: 21 velocities, 18 rows, three degrees of freedom. The
motors follow the angles of a path from pick to place by proportional and derivative torques, with what holds the robot at the
beginning; nothing else drives the joints. ``closed.simulate`` takes the steps and ends each one on the constraints.

Run it: ``python examples/delta_robot.py [FOLDER]``. It writes delta_robot.png. Needs ``pip install -e ".[plot]"``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

import twistwrench as tw
from twistwrench.simulation import ClosedSimulation

BLUE, RED, GREY, GREEN = "#2f6db5", "#c4402f", "#8a8f98", "#3a8f5c"
BASE, ARM, ROD, PLATE, SIDE = 0.20, 0.30, 0.70, 0.07, 0.05  # m; SIDE is half the distance of two rods
LEGS, SIDES = range(3), {"l": SIDE, "r": -SIDE}
MOTORS = [f"motor{k}" for k in LEGS]


def along(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """Moved, not turned."""
    return tw.se3.exp([0, 0, 0, x, y, z])


def turned(k: int) -> np.ndarray:
    """From a leg's axes to those of the base."""
    return tw.se3.exp([0, 0, 2 * np.pi * k / 3, 0, 0, 0])


def delta() -> tw.Robot:
    """The robot; x of a leg points outward, and a positive angle of its motor lowers its arm."""
    builder = tw.ModelBuilder("delta")
    builder.add_link("base")
    builder.add_link("plate", tw.SpatialInertia.cylinder(radius=PLATE, length=0.02, mass=0.8))
    builder.add_joint("float", "floating", "base", "plate")
    arm = tw.SpatialInertia.from_com(0.6, (ARM / 2, 0, 0), 0.6 * ARM**2 / 12 * np.diag([0.05, 1, 1]))
    rod = tw.SpatialInertia.from_com(0.12, (0, 0, -ROD / 2), 0.12 * ROD**2 / 12 * np.diag([1, 1, 0.01]))
    for k in LEGS:
        builder.add_link(f"arm{k}", arm)
        builder.add_joint(MOTORS[k], "continuous", "base", f"arm{k}", axis=(0, 1, 0), placement=turned(k) @ along(BASE))
        for side, y in SIDES.items():
            name = f"{k}{side}"
            builder.add_link(f"cross{name}")
            builder.add_link(f"rod{name}", rod)
            builder.add_link(f"end{name}")
            builder.add_link(f"socket{name}")
            builder.add_joint(
                f"u{name}", "continuous", f"arm{k}", f"cross{name}", axis=(0, 1, 0), placement=along(ARM, y)
            )
            builder.add_joint(f"v{name}", "continuous", f"cross{name}", f"rod{name}", axis=(1, 0, 0))
            builder.add_joint(f"to_end{name}", "fixed", f"rod{name}", f"end{name}", placement=along(z=-ROD))
            builder.add_joint(f"to_{name}", "fixed", "plate", f"socket{name}", placement=turned(k) @ along(PLATE, y))
    closed = robot = tw.Robot(builder.build(tip="plate"))
    near = configuration(robot, np.array([0.0, 0.0, -0.6]))
    for k in LEGS:
        for side in SIDES:
            closed = closed.close(f"socket{k}{side}", f"end{k}{side}", "vx vy vz", near=near)
    return closed


def angles(p: np.ndarray) -> np.ndarray:
    """The motors' angles that put the platform at p (..., 3), elbows outward: |v - arm| = rod for each leg; (..., 3)."""
    found = []
    for k in LEGS:
        x, y, z = np.moveaxis(p @ turned(k)[:3, :3] + [PLATE - BASE, 0.0, 0.0], -1, 0)
        c = (x**2 + y**2 + z**2 + ARM**2 - ROD**2) / (2 * ARM)
        found.append(-np.arctan2(z, x) - np.arccos(c / np.hypot(x, z)))
    return np.stack(found, axis=-1)


def configuration(robot: tw.Robot, p: np.ndarray) -> np.ndarray:
    """All coordinates with the platform at p."""
    named: dict[str, object] = {"float": [1, 0, 0, 0, *p]}
    for k, angle in zip(LEGS, angles(p), strict=True):
        elbow = np.array([BASE + ARM * np.cos(angle), 0.0, -ARM * np.sin(angle)])
        d = (p @ turned(k)[:3, :3] + [PLATE, 0.0, 0.0] - elbow) / ROD
        named[MOTORS[k]] = angle
        for side in SIDES:
            named |= {f"u{k}{side}": np.arctan2(-d[0], -d[2]) - angle, f"v{k}{side}": np.arcsin(d[1])}
    return robot.coordinates(**named)


def path(t: np.ndarray, duration: float) -> np.ndarray:
    """From pick to place over an arch, at rest at both ends; (..., 3)."""
    s = np.clip(np.asarray(t) / duration, 0.0, 1.0)
    s = s**3 * (10 - 15 * s + 6 * s**2)
    return np.stack([-0.15 + 0.3 * s, 0.1 - 0.2 * s, -0.68 + 0.1 * np.sin(np.pi * s)], axis=-1)


def velocities(closed: tw.Robot) -> list[int]:
    """Where the motors' velocities are among all."""
    return [closed.open().model.velocity_names.index(name) for name in MOTORS]


def moved(closed: tw.Robot, travel: float, duration: float) -> ClosedSimulation:
    """The motion under the motors' law."""
    driven, at = velocities(closed), [closed.open().coordinate_names.index(name) for name in MOTORS]
    start = configuration(closed.open(), path(np.array(0.0), travel))
    hold = closed.holding_torques(start, MOTORS).tau
    grid = np.linspace(0.0, duration, 2001)
    wanted = angles(path(grid, travel))
    rates = np.gradient(wanted, grid, axis=0)

    def law(t: float, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        tau = hold.copy()
        for k in LEGS:
            off, lag = np.interp(t, grid, wanted[:, k]) - q[at[k]], np.interp(t, grid, rates[:, k]) - dq[driven[k]]
            tau[driven[k]] += 400.0 * off + 20.0 * lag
        return tau

    return closed.simulate(start, duration=duration, dt=1e-3, tau=law)


def picture(path_to: Path, closed: tw.Robot, found: ClosedSimulation, travel: float) -> None:
    """The robot at both ends and between, its motors' torques, and what the motion keeps."""
    robot = closed.open()
    figure = plt.figure(figsize=(11, 5), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1, 1.1))
    axes = left.add_subplot(projection="3d")

    def place(name: str, q: np.ndarray) -> np.ndarray:
        return robot.forward_kinematics(q, name)[..., :3, 3]

    axes.plot(*place("plate", found.q).T, color=RED, lw=1.5)
    last = min(int(np.searchsorted(found.times, travel)), len(found) - 1)
    for row, alpha in ((0, 0.25), (last // 2, 0.4), (last, 1.0)):
        q = found.q[row]
        for k in LEGS:
            for side in SIDES:
                name = f"{k}{side}"
                axes.plot(
                    *np.array([place(f"rod{name}", q), place(f"end{name}", q)]).T, color=GREY, lw=1.5, alpha=alpha
                )
            elbows = [place(f"rod{k}{side}", q) for side in SIDES]
            arm = np.array([place(f"arm{k}", q), np.mean(elbows, axis=0)])
            axes.plot(*arm.T, color=BLUE, lw=4, alpha=alpha, solid_capstyle="round")
            axes.plot(*np.array(elbows).T, color=BLUE, lw=2, alpha=alpha)
        edge = np.array([place(f"socket{k}{side}", q) for k in LEGS for side in SIDES])
        axes.plot(*edge[[1, 0, 3, 2, 5, 4, 1]].T, color=RED, lw=2, alpha=alpha)
    base = np.array([place(f"arm{k}", found.q[0]) for k in (0, 1, 2, 0)])
    axes.plot(*base.T, color=GREY, lw=1)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", title="from pick to place")
    axes.set_aspect("equal")
    axes.locator_params(nbins=4)
    axes.view_init(elev=14, azim=-62)
    torque, error, kept = right.subplots(3, 1, sharex=True)
    for name, k, colour in zip(MOTORS, velocities(closed), (BLUE, GREEN, RED), strict=True):
        torque.plot(found.times, found.tau[:, k], color=colour, label=name)
    torque.set(title="torques of the motors [N m]")
    torque.legend(frameon=False, fontsize=8, ncols=3)
    off = np.linalg.norm(place("plate", found.q) - path(found.times, travel), axis=1)
    error.plot(found.times, 1e3 * off, color=GREY)
    error.set(title="distance of the platform from its path [mm]", ylim=(0, None))
    kept.semilogy(found.times, found.gap + 1e-18, color=GREY, label="largest gap of the six joints [m]")
    kept.semilogy(found.times, np.abs(found.drift) + 1e-18, color=RED, label="energy unaccounted for [J]")
    kept.set(xlabel="time [s]", title="what the motion keeps")
    kept.legend(frameon=False, fontsize=8, loc="center right")
    for each in (torque, error, kept):
        each.margins(x=0)
        each.spines[["top", "right"]].set_visible(False)
    figure.savefig(path_to, dpi=150)
    plt.close(figure)


def main(folder: Path, travel: float = 0.6, duration: float = 0.9) -> None:
    """Write the picture to ``folder`` and print what the motion keeps."""
    closed = delta()
    found = moved(closed, travel, duration)
    picture(folder / "delta_robot.png", closed, found, travel)
    turn = np.linalg.norm(found.q[:, 1:4], axis=1).max()
    print(
        f"{closed.nv - len(closed.independent)} degrees of freedom; gap {found.gap.max():.1e} m, the platform turned by "
        f"{2 * turn:.1e} rad at most, energy unaccounted for {np.abs(found.drift).max():.1e} J"
    )


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description="Simulate a Delta robot from pick to place, and draw it.")
    asked.add_argument("folder", nargs="?", default=".", type=Path, help="where to write it; this one if not given")
    where = asked.parse_args().folder
    try:
        where.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        asked.error(f"cannot write to the folder {where}: {problem.strerror}")
    main(where)
