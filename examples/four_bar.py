"""A four-bar linkage: what its motor gives and its pins carry over one turn, and how a closed loop is kept closed in motion.

The tree of joints is cut at the pin between coupler and rocker, and closed there with ``robot.close``. Over one turn of the
crank at constant speed, inverse dynamics of the one motor gives its torque, and λ the load of the cut pin. Then the motor is
let go, and the linkage swings for ten seconds under its weight: ``closed.simulate`` takes steps of Runge and Kutta's fourth
order, and ends each at the nearest configuration with the loop closed and the nearest velocity with A dq = 0.

Run it: ``python examples/four_bar.py [FOLDER]``. It writes four_bar.png. Needs ``pip install -e ".[plot]"``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

import twistwrench as tw

BLUE, RED, GREY, GREEN = "#2f6db5", "#c4402f", "#8a8f98", "#3a8f5c"
LENGTHS = {"crank": 0.3, "coupler": 0.8, "rocker": 0.6}  # m; the ground's is 0.7
MASSES = {"crank": 1.0, "coupler": 2.0, "rocker": 1.5}  # kg


def linkage() -> tw.Robot:
    """The linkage in the plane (x, z), its angles from x toward z."""
    builder = tw.ModelBuilder("four_bar")
    builder.add_link("ground_link")
    for bar, L in LENGTHS.items():
        moment = MASSES[bar] * L**2 / 12 * np.diag([0.001, 1, 1])
        builder.add_link(bar, tw.SpatialInertia.from_com(MASSES[bar], (L / 2, 0, 0), moment))
        builder.add_link(f"{bar}_end")
        builder.add_joint(f"to_{bar}_end", "fixed", bar, f"{bar}_end", placement=tw.se3.exp([0, 0, 0, L, 0, 0]))
    y, right = (0, -1, 0), tw.se3.exp([0, 0, 0, 0.7, 0, 0])
    builder.add_joint("A", "continuous", "ground_link", "crank", axis=y)
    builder.add_joint("B", "continuous", "crank_end", "coupler", axis=y)
    builder.add_joint("D", "continuous", "ground_link", "rocker", axis=y, placement=right)
    return tw.Robot(builder.build()).close("rocker_end", "coupler_end", rows="vx vz")


def one_turn(closed: tw.Robot, samples: int = 181) -> np.ndarray:
    """Configurations of one turn of the crank, from one to the next along the one way that the linkage can move."""
    q = [closed.consistent([0.0, 0.8, 1.6])]
    turn = np.linspace(0.0, 2 * np.pi, samples) + q[0][0]
    for angle in turn[1:]:
        n = closed.project_velocity(q[-1], [1.0, 0.0, 0.0])
        ahead = q[-1] + n * (angle - q[-1][0]) / n[0]
        q.append(closed.consistent(ahead))
    return np.array(q)


def at_constant_speed(closed: tw.Robot, q: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and accelerations with the crank at that speed [rad/s]; the linkage's one freedom takes what is left."""
    n = closed.project_velocity(q, [1.0, 0.0, 0.0])
    n = n / n[:, :1]
    dq = speed * n
    ddq = closed.project_acceleration(q, dq, np.zeros(3))
    return dq, ddq - n * ddq[:, :1]


def swing(closed: tw.Robot, q: np.ndarray, dq: np.ndarray, duration: float, dt: float) -> dict[str, np.ndarray]:
    """The free motion, and how well it keeps the loop, the velocity and the energy."""
    found = closed.simulate(q, dq, duration, dt)
    slip = np.abs(closed.constraint_jacobian(found.q) @ found.dq[..., None]).max(axis=(1, 2))
    return {"time": found.times, "energy": found.energy, "gap": found.gap, "slip": slip}


def draw_linkage(axes: plt.Axes, closed: tw.Robot, q: np.ndarray) -> None:
    """The linkage at a few angles, the last one strong, and the way of the coupler's middle."""

    def place(name: str, q: np.ndarray) -> np.ndarray:
        return closed.open().forward_kinematics(q, name)[..., [0, 2], 3]

    pins = [np.zeros((len(q), 2)), place("crank_end", q), place("coupler_end", q), np.tile([0.7, 0.0], (len(q), 1))]
    middle = 0.5 * (pins[1] + pins[2])
    axes.plot(*middle.T, color=RED, lw=1.2)
    for k in (150, 120, 90, 60, 20):
        strong = k == 20
        for (a, b), colour in zip(((0, 1), (1, 2), (2, 3)), (BLUE, RED, GREEN), strict=True):
            ends = np.array([pins[a][k], pins[b][k]]).T
            axes.plot(
                *ends, "-o", color=colour, lw=3.5 if strong else 1.2, ms=6 if strong else 3, alpha=1 if strong else 0.25
            )
    for name, (x, z), up in zip("ABCD", (p[20] for p in pins), (-0.07, 0.03, 0.03, -0.07), strict=True):
        axes.text(x - 0.02, z + up, name, ha="right")
    axes.annotate(
        "cut here, and closed", pins[2][20], (0.45, 0.71), arrowprops={"arrowstyle": "-", "color": GREY}, color=GREY
    )
    axes.set(aspect="equal", ylim=(-0.35, 0.8), xlabel="x [m]", ylabel="z [m]", title="the linkage over one turn")


def picture(path: Path, closed: tw.Robot, q: np.ndarray, speed: float, kept: dict[str, np.ndarray]) -> None:
    """The linkage, its torque and pin load over a turn, and the drift of its free motion."""
    torques, lam = closed.inverse_dynamics(q, *at_constant_speed(closed, q, speed), actuated=["A"])
    figure = plt.figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1, 1.2))
    draw_linkage(left.subplots(), closed, q)
    load, drift = right.subplots(2, 1)
    angle = np.degrees(q[:, 0])
    load.plot(angle, torques[:, 0], color=BLUE, label="torque of the motor at A [N m]")
    load.plot(angle, np.linalg.norm(lam, axis=1), color=GREY, label="load of the pin C, |λ| [N]")
    load.set(
        xlabel="crank angle [°]",
        title=f"the crank turned steadily, {speed / (2 * np.pi):g} turn a second",
        xticks=range(0, 361, 60),
    )
    load.legend(frameon=False, fontsize=8, loc="upper right", bbox_to_anchor=(1.0, 1.05))
    drift.semilogy(
        kept["time"], np.abs(kept["energy"] - kept["energy"][0]) + 1e-18, color=RED, label="energy, change [J]"
    )
    drift.semilogy(kept["time"], kept["slip"] + 1e-18, color=GREEN, label="|A dq| [m/s]")
    drift.semilogy(kept["time"], kept["gap"] + 1e-18, color=GREY, label="gap of the loop [m]")
    drift.set(xlabel="time [s]", title="let go: what the motion keeps")
    drift.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.28), ncols=3)
    for axes in (load, drift):
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def main(folder: Path, duration: float = 10.0, dt: float = 0.005) -> None:
    """Write the picture to ``folder`` and print what the motion keeps."""
    closed, speed = linkage(), 2 * np.pi
    q = one_turn(closed)
    start = closed.consistent([0.0, 0.8, 1.6])
    kept = swing(closed, start, closed.project_velocity(start, [6.0, 0.0, 0.0]), duration, dt)
    picture(folder / "four_bar.png", closed, q, speed, kept)
    print(
        f"over {duration:g} s in steps of {dt:g} s: gap {kept['gap'].max():.1e} m, A dq {kept['slip'].max():.1e} m/s, "
        f"energy within {np.ptp(kept['energy']):.1e} J"
    )


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description="Draw what a four-bar linkage's motor gives and its pins carry.")
    asked.add_argument("folder", nargs="?", default=".", type=Path, help="where to write it; this one if not given")
    where = asked.parse_args().folder
    try:
        where.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        asked.error(f"cannot write to the folder {where}: {problem.strerror}")
    main(where)
