"""A UR5 falls from rest: energy error of five integrators.

Five integrators simulate the same fall for three seconds. Gravity is the only force, so the exact motion conserves energy, and
any change of the energy is an error of the integrator. The error of the variational one stays bounded and returns to zero.

To change: the step ``dt`` of all integrators, or the configuration at the start.
"""

from argparse import ArgumentParser

import numpy as np

import twistwrench as tw
from twistwrench.viz.style import BLUE, GREEN, GREY, ORANGE, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="falling_ur5.png", help="where to write it")
parser.add_argument("--quick", action="store_true", help="a shorter fall")
asked = parser.parse_args()

robot = tw.robots.ur5()
duration, dt = (0.6 if asked.quick else 3.0), 0.004
methods = {"euler": GREY, "semi_implicit": ORANGE, "rk4": VERMILION, "midpoint": GREEN, "variational": BLUE}
falls = {method: robot.simulate(duration=duration, dt=dt, method=method) for method in methods}
for method, fall in falls.items():
    print(f"{method:14} drift {fall.relative_drift:.1e} of the largest kinetic energy")

with figure(9.0, 4.2, f"A UR5 falls: the first 0.6 s, and energy errors at a step of {1000 * dt:.0f} ms") as drawn:
    stage, drift = drawn.subplots(1, 2, width_ratios=[1, 1.15])

    moments = np.linspace(0, 0.6, 4)
    tw.viz.draw(stage, robot, falls["variational"].q[np.rint(moments / dt).astype(int)], azimuth=-1.2, inertia=False)

    for (method, fall), colour in zip(falls.items(), methods.values(), strict=True):
        drift.semilogy(fall.times[1:], np.abs(fall.drift[1:]) + 1e-12, color=colour, label=method)
    drift.set(xlabel="time [s]", ylabel="|energy error| [J]")
    drift.yaxis.set_major_formatter("{x:.0e}")
    drift.margins(x=0)
    drawn.legend(loc="outside lower right", ncols=5, frameon=False)
    save(drawn, asked.picture)
