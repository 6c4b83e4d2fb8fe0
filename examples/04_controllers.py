"""Three controllers follow a straight line with a payload that their model may not include.

PD with gravity compensation, computed torque and impedance control move the hand of a UR5 along a straight line. The model of
each includes the payload once, and once it does not. The error from the missing mass differs by controller: under
impedance control the hand rests too low by the payload's weight divided by the stiffness.

To change: the payload, the gains, the stiffness, or the speed along the line.
"""

from argparse import ArgumentParser

import numpy as np

import twistwrench as tw
from twistwrench.viz.style import BLUE, GREEN, GREY, VERMILION, figure, save

parser = ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("picture", nargs="?", default="controllers.png", help="where to write it")
parser.add_argument("--quick", action="store_true", help="a shorter line, gone along faster")
asked = parser.parse_args()

# With the rotors of its drives, which are most of what the wrists have to accelerate.
empty = tw.robots.ur5().with_actuators(tw.robots.path_of("ur5").with_name("ur5_demo.yaml"))
loaded = empty.with_payload(tw.SpatialInertia.from_com(2.0, com=(0, 0, 0)))
start = np.array([-0.5, -1.9, 1.9, -0.3, 1.5, 0])
T0 = empty.forward_kinematics(start)
T1 = T0.copy()
T1[:3, 3] += [0.1, 0.4, 0.15]
line = tw.trajectories.follow_poses(empty, tw.trajectories.straight_path(T0, T1), start)
move = tw.trajectories.Trajectory(empty, line, tw.trajectories.quintic(0.4 if asked.quick else 1.0))


def reference(t):
    """q, dq, ddq at a time; at rest where the line ends."""
    q, dq, ddq = move(min(t, move.duration))
    return q, dq, ddq


w = 25.0  # rad/s: what the gains of the joints are set for, critically damped
M = np.diag(empty.mass_matrix(start))
soft = {"stiffness": 3000.0, "damping": 300.0, "rows": "vx vy vz"}  # N/m, N s/m: of the hand's position


def impedance(robot):
    """The position yields as told; what it leaves free, the turning, is led as the joints are."""
    return tw.control.Impedance(robot, reference, **soft, posture=reference, posture_kp=w**2, posture_kd=2 * w)


laws = {
    "PD and gravity": lambda robot: tw.control.PD(robot, reference, w**2 * M, 2 * w * M),
    "computed torque": lambda robot: tw.control.ComputedTorque(robot, reference, w**2, 2 * w),
    "impedance": impedance,
}
runs, errors = {}, {}
for name, law in laws.items():
    for model, robot in (("known", loaded), ("unknown", empty)):
        run = loaded.simulate(start, duration=move.duration + 0.4, dt=0.002, method="rk4", controller=law(robot))
        wanted = np.array([reference(t)[0] for t in run.times])
        off = loaded.forward_kinematics(run.q)[:, :3, 3] - loaded.forward_kinematics(wanted)[:, :3, 3]
        runs[name, model], error = run, 1000 * np.linalg.norm(off, axis=1)
        errors[name, model] = error
        print(f"{name:15}, load {model:7}: hand off by {error.max():5.2f} mm at most, {error[-1]:5.2f} mm in the end")

with figure(
    9.6, 4.2, "A UR5 along a line with 2 kg: three controllers, with and without the load in their model"
) as drawn:
    stage, axes = drawn.subplots(1, 2, width_ratios=[1, 1.3])
    q = runs["computed torque", "known"].q
    camera = tw.viz.draw(stage, loaded, q[[0, -1]], azimuth=-0.3, inertia=False)
    stage.plot(*camera.project(loaded.forward_kinematics(q)[:, :3, 3])[0].T, color=VERMILION, linewidth=2)

    for name, colour in zip(laws, (VERMILION, BLUE, GREEN), strict=True):
        times = runs[name, "known"].times
        axes.semilogy(times, errors[name, "unknown"] + 1e-9, color=colour, label=name)
        axes.semilogy(times, errors[name, "known"] + 1e-9, ":", color=colour)
    axes.axvline(move.duration, color=GREY, linewidth=0.8, linestyle="--")
    axes.set(
        xlabel="time [s]; the line ends where the dashes are",
        ylabel="distance from the line [mm] (dotted: load known)",
        ylim=(1e-3, 50),
    )
    axes.yaxis.set_major_formatter("{x:g}")
    axes.margins(x=0)
    drawn.legend(loc="outside lower right", ncols=3, frameon=False)
    save(drawn, asked.picture)
