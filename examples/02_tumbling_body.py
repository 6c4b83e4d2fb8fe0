"""A box thrown about its middle axis turns over, again and again.

Seen from the box, the tip of the angular momentum moves where a sphere (its size stays) meets an ellipsoid (so does the energy).
Around the first and the last axis those curves are small loops; through the middle one they cross, and a slight push is enough
to be carried to the other side and back, in a time that an elliptic integral says.

To change: ``sides``, where two equal ones end the flip, and ``push``, which sets how long it waits.
"""

from argparse import ArgumentParser

import numpy as np
from scipy.special import ellipk

import twistwrench as tw
from twistwrench.figure import BLUE, GREY, LINE, ORANGE, VERMILION, figure, save

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
