"""The intermediate-axis flip: why a thrown phone tumbles.

A body turning about its middle principal axis turns over, again and again, although nothing acts on it. Seen from the body,
the tip of the angular momentum keeps to a sphere (its size is constant) and to an ellipsoid (the energy is constant); where the
two cut lies its path, the polhode. Around the long and the short axis the cuts are small loops, so those turns are steady;
through the middle axis they cross, so the smallest push sends the tip to the other side and back.

Run it: ``python examples/intermediate_axis.py [FOLDER]``. It writes intermediate_axis.png and intermediate_axis.gif there,
the folder where it is run if none is named.
Needs ``pip install -e ".[plot]"``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import twistwrench as tw
from twistwrench.simulation import Flight

BLUE, RED, GREY, SAND, ICE = "#2f6db5", "#c4402f", "#8a8f98", "#f3c79b", "#d7e3f1"
SIZE = np.array([0.30, 0.20, 0.06])  # m: x is the axis of least moment, y the middle one, z that of the greatest

body = tw.RigidBody(tw.SpatialInertia.box(SIZE, mass=1.0))
I = body.inertia.moment_about_com.diagonal()


def momentum_in_body(V: np.ndarray) -> np.ndarray:
    """Angular momentum about the centre of mass over its size, in the body's axes: a point of the unit sphere."""
    L = body.momentum(V)[..., :3]
    return L / np.linalg.norm(L, axis=-1, keepdims=True)


def fly(w: tuple[float, float, float], duration: float, dt: float = 0.01) -> Flight:
    """Fly from rest in space with angular velocity w [rad/s]."""
    return body.fly(np.eye(4), [*w, 0, 0, 0], duration, dt)


def hull(points: np.ndarray, energy: float) -> np.ndarray:
    """How far out the outer of the two surfaces is in the directions ``points``; the ellipsoid is Σ L²/I = 2E."""
    return np.maximum(1.0, 1.0 / np.sqrt((points**2 / I).sum(axis=-1) / energy))


def on_sphere(n: int) -> np.ndarray:
    """Points (n, 2n, 3) of the unit sphere."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * n), np.linspace(0, np.pi, n))
    return np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1)


def eye(axes: plt.Axes) -> np.ndarray:
    """The unit vector towards whoever looks."""
    e, a = np.radians(axes.elev), np.radians(axes.azim)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def visible(points: np.ndarray, towards: np.ndarray, energy: float) -> np.ndarray:
    """Which points (n, 3) outside both surfaces are hidden by neither, seen along ``towards``.

    A line of sight x + s e, s > 0, misses the sphere if it leads away from its middle, x · e > 0, or passes further than its
    radius; and the ellipsoid likewise, once space is stretched until that is a sphere.
    """
    seen = np.ones(len(points), bool)
    for stretch in (np.ones(3), 1.0 / np.sqrt(energy * I)):
        x, e = points * stretch, towards * stretch
        along = x @ e
        seen &= (along > 0.0) | ((x**2).sum(axis=-1) - along**2 / (e @ e) > 1.0)
    return seen


def once(path: np.ndarray) -> np.ndarray:
    """The first time around a closed path that is gone around several times."""
    away = np.linalg.norm(path - path[0], axis=-1)
    far = int(np.argmax(away > 0.5 * away.max()))
    back = np.flatnonzero(away[far:] < 0.05)
    return np.vstack([path[: far + int(back[0]) + 1], path[:1]]) if back.size else path


def draw(axes: plt.Axes, points: np.ndarray, energy: float, **style: object) -> None:
    """A closed curve on the surface: a line in front, and thin dashes where the surface hides it."""
    front = visible(points, eye(axes), energy)[:, None]
    axes.plot(*np.where(front, points, np.nan).T, zorder=5, **style)
    axes.plot(*np.where(front, np.nan, points).T, zorder=4, **{**style, "alpha": 0.45, "lw": 0.8, "ls": (0, (4, 3))})


def prepare(axes: plt.Axes, reach: float) -> None:
    """A bare cube of space from -reach to reach."""
    axes.set_proj_type("ortho")
    axes.view_init(elev=24, azim=50)
    axes.set_box_aspect((1, 1, 1), zoom=1.12)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-reach, reach))
    axes.set_axis_off()


def sphere_and_ellipsoid(axes: plt.Axes, path: np.ndarray, n: int) -> None:
    """The momentum sphere and the energy ellipsoid, each where it is the outer one, and the polhodes: red is the seam."""
    prepare(axes, 1.15)
    energy = float((path[0] ** 2 / I).sum())
    points = on_sphere(n)
    outer = hull(points, energy)
    light = 0.72 + 0.28 * np.clip(points @ np.array([0.5, 0.3, 0.81]), -0.3, 1.0)[..., None]
    colours = np.where(outer[..., None] > 1.0, to_rgb(SAND), to_rgb(ICE)) * light
    axes.plot_surface(*np.moveaxis(outer[..., None] * points, -1, 0), facecolors=colours, rstride=1, cstride=1, lw=0,
                      antialiased=False, shade=False, zorder=1)  # fmt: skip
    for w in steady():
        loop = once(momentum_in_body(fly(w, 12.0).twists))
        draw(axes, 1.005 * hull(loop, energy)[:, None] * loop, energy, color="#5b6470", lw=0.8)
    draw(axes, 1.01 * once(path), energy, color=RED, lw=2.6)
    draw(axes, -1.01 * once(path), energy, color=RED, lw=1.0)  # the seam's other half, which this flight never visits
    for k, name in enumerate(("axis 1:\nleast moment", "axis 2:\nmiddle", "axis 3: greatest moment")):
        tip = np.eye(3)[k] * hull(np.eye(3)[k], energy)
        axes.plot(*np.outer(tip, (1.0, (1.5, 1.6, 1.15)[k])), color="black", lw=1.2, zorder=6)
        place, across = (1.55, 1.66, 1.24)[k] * tip, ("right", "left", "center")[k]
        axes.text(*place, name, ha=across, va="center", fontsize=8, zorder=7)


def steady() -> list[tuple[float, float, float]]:
    """Starts of the other polhodes: about the axes of least and greatest moment, both ways."""
    tilts = [(np.cos(a), np.sin(a)) for a in (0.3, 0.65)]
    L = [(s * c, d, 0.0) for c, d in tilts for s in (-1, 1)] + [(0.0, d, s * c) for c, d in tilts for s in (-1, 1)]
    return [tuple(5.0 * I[1] * np.array(x) / I) for x in L]


def histories(axes: plt.Axes, flight: Flight) -> None:
    """Angular velocity over time: the flip, as a square wave of the middle component."""
    for k, colour, name in (
        (0, GREY, "about axis 1"),
        (1, RED, "about axis 2, the middle one"),
        (2, BLUE, "about axis 3"),
    ):
        axes.plot(flight.times, flight.twists[:, k], color=colour, lw=1.6, label=name)
    axes.set(xlabel="time [s]", ylabel="angular velocity in the body [rad/s]")
    axes.margins(x=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=3, fontsize=9)
    axes.text(0.0, -0.2, f"drift: {flight.drift}", transform=axes.transAxes, fontsize=8, color=GREY)


def picture(path: Path, flight: Flight) -> None:
    """The surfaces with the polhode, beside the angular velocity over time."""
    figure = plt.figure(figsize=(11, 5.4), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1, 1.2))
    L = momentum_in_body(flight.twists)
    globe = left.add_subplot(projection="3d", computed_zorder=False)
    sphere_and_ellipsoid(globe, L, n=150)
    patches = [Patch(color=c, label=t) for c, t in ((ICE, "momentum sphere"), (SAND, "energy ellipsoid"))]
    globe.legend(handles=[*patches, Line2D([], [], color=RED, lw=2.6, label="polhode of the flip")], frameon=False,
                 loc="lower center", ncols=3, fontsize=8)  # fmt: skip
    histories(right.add_subplot(), flight)
    figure.suptitle(
        "A box turned about its middle axis turns over, again and again", x=0.02, ha="left", fontweight="bold"
    )
    figure.savefig(path, dpi=150)
    plt.close(figure)


def animation(path: Path, flight: Flight, frames: int) -> None:
    """The tumbling box beside the tip of the momentum on its sphere."""
    figure = plt.figure(figsize=(7, 3.6))
    space, sphere = (figure.add_axes((0.5 * k, 0, 0.5, 0.92), projection="3d") for k in (0, 1))
    prepare(space, 0.19)
    L = momentum_in_body(flight.twists)
    sphere.computed_zorder = False
    sphere_and_ellipsoid(sphere, L, n=40)
    (tip,) = sphere.plot(*L[0], "o", color=RED, ms=8, mec="white", zorder=9)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    colours = [GREY, GREY, "#9fc0e4", BLUE, "#e8e4da", RED]
    box = Poly3DCollection([], edgecolor="white", lw=0.8)
    space.add_collection3d(box)
    for x, name in ((0.25, "seen from space"), (0.75, "seen from the body")):
        figure.text(x, 0.97, name, ha="center", va="top", fontsize=10)
    energy = float((L[0] ** 2 / I).sum())
    seen = visible(1.01 * L, eye(sphere), energy)

    def show(i: int) -> None:
        corners = 0.5 * signs * SIZE @ flight.poses[i, :3, :3].T
        box.set_verts([corners[q] for q in quads])
        box.set_facecolor(colours)
        tip.set_data_3d(*L[i][:, None])
        tip.set_alpha(1.0 if seen[i] else 0.25)  # faint when behind

    chosen = np.linspace(0, len(flight.times) - 1, frames).astype(int)
    FuncAnimation(figure, show, chosen).save(path, PillowWriter(fps=20), dpi=70)
    plt.close(figure)


def main(folder: Path, frames: int = 100) -> None:
    """Write the picture and the animation to ``folder``, and say where they are."""
    flight = fly((0.0, 5.0, 0.02), duration=18.0)
    still, moving = folder / "intermediate_axis.png", folder / "intermediate_axis.gif"
    picture(still, flight)
    animation(moving, fly((0.0, 5.0, 0.02), duration=9.0), frames)
    print(f"drift over {len(flight.times) - 1} steps: {flight.drift}\nwrote {still}\nwrote {moving}")


def asked_folder() -> Path:
    """The folder named on the command line, made if it is not there."""
    parser = argparse.ArgumentParser(description="Draw the intermediate-axis flip, as a picture and as an animation.")
    parser.add_argument("folder", nargs="?", default=".", type=Path, help="where to write them; this one if not given")
    folder: Path = parser.parse_args().folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        parser.error(f"cannot write to the folder {folder}: {problem.strerror}")
    return folder


if __name__ == "__main__":
    main(asked_folder())
