"""Rotation about the middle principal axis is unstable: a free box turns over again and again.

Seen from the box, the angular momentum L moves on a sphere (its magnitude is constant) and on an ellipsoid (the energy is
constant). Its path is their intersection. Around the axes of least and greatest inertia these paths are small closed
curves. The paths through the middle axis lead from one side to the other, so a small disturbance turns the box over. The
period is an elliptic integral.

To change: ``sides`` (with two equal sides the box no longer turns over), and ``push``, the disturbance, which sets the period.
"""

from argparse import ArgumentParser

import numpy as np
from scipy.special import ellipk

import twistwrench as tw
from twistwrench.viz.style import BLUE, GREY, LINE, ORANGE, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="tumbling_body.png", help="where to write it")
asked = parser.parse_args()

sides, spin, push = (0.30, 0.20, 0.06), 5.0, 0.02  # m, rad/s, rad/s
body = tw.RigidBody(tw.SpatialInertia.box(sides, mass=1.0))
flight = body.fly(np.eye(4), [0, spin, push, 0, 0, 0], duration=20, dt=0.005)

# The closed form (Landau and Lifshitz, Mechanics, section 37), with moments in ascending order.
I = np.diag(body.inertia.moment_about_com)
w = flight.twists[0, :3]
E2, L2 = I @ w**2, I**2 @ w**2
inner, outer = (I[1] - I[0]) * (E2 * I[2] - L2), (I[2] - I[1]) * (L2 - E2 * I[0])
if inner > outer:
    inner, outer = outer, inner
period = 4 * ellipk(inner / outer) * np.sqrt(I.prod() / outer)

# The same from the flight: every other zero of the middle component.
w2, t = flight.twists[:, 1], flight.times
before = np.flatnonzero(w2[:-1] * w2[1:] < 0)
zeros = t[before] - w2[before] * (t[before + 1] - t[before]) / (w2[before + 1] - w2[before])
print(f"flips with period {zeros[2] - zeros[0]:.6f} s, closed form {period:.6f} s")
print(f"drift: {flight.drift}")

L = body.momentum(flight.twists)[:, :3] / np.sqrt(L2)  # in the box's axes, a point of the unit sphere
elevation, azimuth, turn = 22, 52, np.linspace(0, 2 * np.pi, 121)
e, a = np.radians([elevation, azimuth])
eye = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def curve(points, width, colour):
    """Draw points (n, 3) of the sphere, dotted where it hides them."""
    front = (points @ eye > 0)[:, None]
    globe.plot(*np.where(front, points, np.nan).T, color=colour, linewidth=width, zorder=3)
    globe.plot(*np.where(front, np.nan, points).T, color=colour, linewidth=width / 3, linestyle=":", zorder=3)


with figure(9.0, 4.2, "A box about its middle axis: where its momentum may go, and where it goes") as drawn:
    left, right = drawn.subfigures(1, 2, width_ratios=[1, 1.3])
    globe = left.add_subplot(projection="3d", computed_zorder=False, proj_type="ortho", elev=elevation, azim=azimuth)
    globe.set_box_aspect((1, 1, 1), zoom=1.5)
    globe.set_axis_off()
    across, down = turn[:, None], np.linspace(0, np.pi, 61)
    ball = np.array([np.cos(across) * np.sin(down), np.sin(across) * np.sin(down), np.cos(down) + 0 * across])
    light = (0.82 + 0.18 * np.einsum("i,ijk->jk", eye, ball).clip(0))[..., None] * [0.88, 0.94, 1.0]
    globe.plot_surface(*ball, facecolors=light, rstride=1, cstride=1, linewidth=0, antialiased=False, shade=False)
    for k, i, j in ((0, 1, 2), (2, 1, 0)):  # energy lines around axis k reach axis 1, the middle one, at share 1
        for share in (0.1, 0.35, 0.65, 1.0):
            width = np.sqrt(share * (1 / I[k] - 1 / I[1]) / (1 / I[k] - 1 / I[j]))
            loop = np.zeros((121, 3))
            loop[:, i], loop[:, j] = np.sqrt(share) * np.cos(turn), width * np.sin(turn)
            loop[:, k] = np.sqrt(np.maximum(1 - (loop**2).sum(axis=1), 0))
            curve(loop, 0.9, LINE)
            curve(-loop, 0.9, LINE)
    curve(1.01 * L, 2.6, VERMILION)
    for axis, name in zip(np.eye(3), ("1", "2", "3"), strict=True):
        globe.plot(*np.outer(axis, [1, 1.25]), color="black", linewidth=1, zorder=4)
        globe.text(*(1.45 * axis), f"axis {name}", ha="center", va="center", fontsize=8)

    rates = right.subplots()
    for k, colour in enumerate((GREY, VERMILION, BLUE)):
        rates.plot(t, flight.twists[:, k], color=colour, label=f"about axis {k + 1}")
    for x in np.arange(zeros[0], t[-1], period / 2):
        rates.axvline(x, color=ORANGE, linewidth=1, linestyle="--")
    rates.plot([], color=ORANGE, linewidth=1, linestyle="--", label="half periods")
    rates.set(xlabel="time [s]", ylabel="angular velocity in the box [rad/s]")
    rates.margins(x=0)
    right.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    save(drawn, asked.picture)
