"""Pictures of answers: kinds of plots, and pictures of their pages."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial, singledispatch
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration.poses import MeasuringPoses
from ..calibration.result import CalibratedRobot
from ..core.answers.answer import Answer
from ..core.answers.blocks import mark_style
from ..core.answers.page import LARGEST_VIEWER, MarkedJoint, Picture, Viewer
from ..core.colours import Style
from ..core.errors import UnknownNameError, ValueRangeError
from ..core.files import as_path, picture_path
from ..core.numbers import percent_of_limit, seconds
from ..diagnosis.report import DoctorReport
from ..motion.load_case import LoadCase
from ..reports.drawn_motion import motion_of, reported_motion
from ..reports.torque_report import TorqueReport
from ..robot import Robot
from ..sensing.compensation import Compensation
from ..sensing.poses import PoseProposal
from ..sensing.result import Identification
from ..simulation.judgement import worst_moment as worst_moment_of
from ..simulation.result import SimulationResult
from ..sizing.choice import Sizing
from ..sizing.sizing_view import worst_moment as worst_sized_moment
from ..statics.payload_report import PayloadReport
from ..trajectories.move_report import MoveReport
from ..trajectories.move_view import worst_moment as worst_planned_moment
from . import page, style
from .findings_scene import findings_scene
from .page_layer import calibration_layer, contact_layer
from .pictures import Plot, plot_picture, robot_picture
from .plots.calibration import plot_calibration, plot_measuring_poses
from .plots.diagnosis import links_drawn, plot_diagnosis
from .plots.explanation import plot_compensation
from .plots.holds import plot_mounting, plot_support
from .plots.motion import plot_phase, plot_power, plot_split
from .plots.payload import plot_payload
from .plots.poses import plot_proposal
from .plots.simulation import plot_simulation, plot_trajectory
from .plots.torques import plot_motors, plot_report, plot_sizing


@singledispatch
def plots_of(answer: Answer) -> Mapping[str, Plot]:
    """Kinds of plots of an answer, the usual one first."""
    del answer
    return {}


@singledispatch
def pictures_of(answer: Answer) -> Iterable[Picture]:
    """Pictures of the page of an answer: by default its usual plot; none without matplotlib."""
    if find_spec("matplotlib") is None:
        return []
    plots = plots_of(answer)
    if not plots:
        return []
    usual_kind = next(iter(plots))
    return [plot_picture(usual_kind, plots[usual_kind])]


@singledispatch
def viewer_of(answer: Answer) -> Viewer | None:
    """Robot of an answer that can be moved on its page; None without one."""
    del answer
    return None


def _if_small(viewer: Viewer) -> Viewer | None:
    """Return the viewer; None if its page is too long to be part of another page."""
    return viewer if len(viewer.page) < LARGEST_VIEWER else None


def plot(answer: Answer, kind: str | Path | None, path: str | Path | None) -> Any:
    """Draw a kind of plot of an answer into a file, or as a figure without a path.

    Without a kind, the usual plot is drawn. A path may also be given alone, in place of the kind.
    """
    return plot_one_of(plots_of(answer), answer, kind, path)


def plot_one_of(plots: Mapping[str, Plot], answer: Answer, kind: str | Path | None, path: str | Path | None) -> Any:
    """Draw one of the ``plots`` of an answer into a file, or as a figure without a path; see :func:`plot`."""
    if not plots:
        raise ValueRangeError(f"a {type(answer).__name__} has no picture. Its tables: {', '.join(answer.tables)}.")
    if path is None and kind is not None:
        is_path = not isinstance(kind, str) or Path(kind).suffix != ""
        if is_path:
            path = as_path(kind)
            kind = None
    if kind is not None and kind not in plots:
        raise UnknownNameError.from_choices("kind of plot", str(kind), plots)
    usual_kind = next(iter(plots))
    drawn_kind = str(kind) if kind else usual_kind
    draw = plots[drawn_kind]
    if path is not None:
        target = picture_path(path)
        draw(target)
        return Path(target)
    shown_figure = style.ShownFigure()
    draw(shown_figure)
    return shown_figure.figure


@plots_of.register
def _(answer: SimulationResult) -> Mapping[str, Plot]:
    return {"simulation": partial(plot_simulation, answer)}


@pictures_of.register
def _(answer: SimulationResult) -> Iterable[Picture]:
    if find_spec("matplotlib") is None:
        return []
    pictures = []
    if answer.simulated is not None:
        pictures.append(robot_picture(answer.simulated, *worst_moment_of(answer)))
    pictures.append(plot_picture("Joints, energies and drift", partial(plot_simulation, answer)))
    return pictures


@viewer_of.register
def _(answer: SimulationResult) -> Viewer | None:
    """Robot that follows the motion, or stands still if forces other than the motors' act on it."""
    robot = answer.simulated
    if robot is None or robot.model.couplings:
        return None
    has_other_forces = any(answer.work[force].any() for force in ("wrenches", "contacts"))
    if robot.constraints or has_other_forces:
        return _if_small(page.viewer_page(robot, q=answer.q[0], embed=True))
    motion = motion_of(LoadCase(robot, friction=answer.friction), answer.motion)
    return _if_small(page.viewer_page(robot, motion=replace(motion, judged=False), embed=True))


@plots_of.register
def _(answer: CalibratedRobot) -> Mapping[str, Plot]:
    return {"calibration": partial(plot_calibration, answer)}


@viewer_of.register
def _(answer: CalibratedRobot) -> Viewer | None:
    """Calibrated robot at the first reading, with the errors at measured points and over the workspace."""
    first_measurements = answer.fit.problem.measured[0]
    first_configuration = first_measurements.q[0]
    layer = calibration_layer(answer)
    return _if_small(page.viewer_page(answer.robot, q=first_configuration, embed=True, layer=layer))


@plots_of.register
def _(answer: MeasuringPoses) -> Mapping[str, Plot]:
    return {"configurations": partial(plot_measuring_poses, answer)}


@plots_of.register
def _(answer: DoctorReport) -> Mapping[str, Plot]:
    return {"inertias": partial(plot_diagnosis, answer)} if links_drawn(answer) else {}


@pictures_of.register
def _(answer: DoctorReport) -> Iterable[Picture]:
    """Links in the colours of their findings, and inertias before and after the repair."""
    if find_spec("matplotlib") is None:
        return []
    scene = findings_scene(answer)
    pictures = []
    if scene.robot.nv:
        title = str(answer.robot)
        has_coloured_links = any(finding.where.startswith("link") for finding in answer.findings)
        if has_coloured_links:
            title += ", links in the colours of their findings: red error, amber warning, grey note"
        pictures.append(robot_picture(scene.robot, None, None, title, scene))
    return pictures + [plot_picture("Inertia before and after", plot) for plot in plots_of(answer).values()]


@viewer_of.register
def _(answer: DoctorReport) -> Viewer | None:
    scene = findings_scene(answer)
    if not scene.robot.nv:
        return None
    return _if_small(page.viewer_page(scene.robot, scene=scene, embed=True))


_MOTION_PLOTS = {"causes": plot_split, "power": plot_power, "phase": plot_phase}
"""Plots of a motion with its torques."""


@plots_of.register
def _(answer: TorqueReport) -> Mapping[str, Plot]:
    plots: dict[str, Plot] = {"torques": partial(plot_report, answer)}

    def motion_plot(draw: Callable[..., Any]) -> Plot:
        return lambda path: draw(reported_motion(answer), path)

    plots |= {kind: motion_plot(draw) for kind, draw in _MOTION_PLOTS.items()}
    if answer.motors:
        plots["motors"] = partial(plot_motors, answer)
    for kind, (_, plot) in _held_plots(answer).items():
        plots[kind] = plot
    return plots


def _held_plots(answer: TorqueReport) -> Mapping[str, tuple[str, Plot]]:
    """Title and plot of each support of the robot or its payload: ground, foundation and grip, by kind."""
    held = answer.held
    plots: dict[str, tuple[str, Plot]] = {}
    if held.support is not None:
        ground = held.support
        draw_ground = partial(plot_support, ground, time=ground.time, robot=ground.robot, q=ground.states.q)
        plots["support"] = ("Contact forces, margins and friction cones", draw_ground)
    if held.mounting is not None:
        mounting = held.mounting
        bolts = None if mounting.pattern is None else mounting.pattern.places
        draw_mounting = partial(plot_mounting, mounting.load, time=mounting.time, bolts=bolts)
        plots["mounting"] = ("Load of the foundation", draw_mounting)
    if held.grip is not None:
        draw_grip = partial(plot_support, held.grip.support, time=held.grip.time)
        plots["grip"] = ("Grip of the payload", draw_grip)
    return plots


@pictures_of.register
def _(answer: TorqueReport) -> Iterable[Picture]:
    if find_spec("matplotlib") is None:
        return []
    pictures = [plot_picture("Torques and limits", partial(plot_report, answer))]
    if answer.worst is not None:
        pictures.append(worst_moment(answer))
    if answer.motors:
        pictures.append(plot_picture("Motors", partial(plot_motors, answer)))
    return pictures + [plot_picture(title, plot) for title, plot in _held_plots(answer).values()]


@viewer_of.register
def _(answer: TorqueReport) -> Viewer | None:
    if answer.load.robot.model.couplings:  # pages cannot show motors that drive several joints
        return None
    if answer.rows == 1:  # at rest
        return _if_small(page.viewer_page(answer.load.with_load, q=answer.motion.q[0], embed=True))
    motion = reported_motion(answer)
    layer = None if answer.held.support is None else contact_layer(answer.held.support, motion.time)
    return _if_small(page.viewer_page(answer.load.robot, motion=motion, embed=True, layer=layer))


def worst_moment(report: TorqueReport) -> Picture:
    """Robot at the peak of the joint nearest to its limit, which is marked."""
    assert report.worst is not None
    joint = report.joints[report.worst]
    states = report.around  # states around the peaks
    share_text = f"{percent_of_limit(joint.share)} of its limit" if math.isfinite(joint.limit) else "no limit"
    row = int(np.argmin(np.abs(states.time - joint.time)))
    q = states.q[row]
    marked_joint = MarkedJoint(joint.joint, f"{joint.joint}, {share_text}", mark_style(joint.share))
    title = f"{report.robot} at t = {seconds(joint.time)} s"
    return robot_picture(report.load.with_load, q, marked_joint, title)


@plots_of.register
def _(answer: PayloadReport) -> Mapping[str, Plot]:
    return {"payload": partial(plot_payload, answer)} if answer.judged else {}


@pictures_of.register
def _(answer: PayloadReport) -> Iterable[Picture]:
    if find_spec("matplotlib") is None:
        return []
    joint = answer.limiting  # None if no joint limits the payload
    marked_joint = MarkedJoint(joint, f"{joint}, which limits the payload", Style.NEAR) if joint else None
    pictures = [robot_picture(answer.robot, answer.q, marked_joint, f"{answer.robot.name} in this pose")]
    return pictures + [plot_picture("Forces and holding torques", plot) for plot in plots_of(answer).values()]


@viewer_of.register
def _(answer: PayloadReport) -> Viewer | None:
    if answer.robot.model.couplings:
        return None
    return _if_small(page.viewer_page(answer.robot, q=answer.q, embed=True))


@plots_of.register
def _(answer: Sizing) -> Mapping[str, Plot]:
    return {"drives": partial(plot_sizing, answer)} if answer.joints else {}


@pictures_of.register
def _(answer: Sizing) -> Iterable[Picture]:
    """Robot at the moment of the drive nearest to a rating, and the drives."""
    if find_spec("matplotlib") is None or answer.motion is None:
        return []
    picture = robot_picture(answer.problem.robot, *worst_sized_moment(answer))
    return [picture, plot_picture("Drives", partial(plot_sizing, answer))]


@viewer_of.register
def _(answer: Sizing) -> Viewer | None:
    if answer.report is None:
        return None
    return _if_small(page.viewer_page(answer.problem.robot, motion=reported_motion(answer.report), embed=True))


@plots_of.register
def _(answer: MoveReport) -> Mapping[str, Plot]:
    trajectory = answer.trajectory
    if trajectory is None:
        return {}
    return {"motion": lambda path: plot_trajectory(trajectory, path, answer.limits, friction=answer.friction)}


@pictures_of.register
def _(answer: MoveReport) -> Iterable[Picture]:
    """Robot at the moment of the joint nearest to a limit, and the motion."""
    if find_spec("matplotlib") is None or answer.trajectory is None:
        return []
    pictures = [robot_picture(answer.robot, *worst_planned_moment(answer, answer.trajectory))]
    return pictures + [plot_picture("Motion and limits", plot) for plot in plots_of(answer).values()]


@viewer_of.register
def _(answer: MoveReport) -> Viewer | None:
    if answer.trajectory is None or answer.load.robot.model.couplings:
        return None
    robot = Robot(replace(answer.load.robot.model, limits=answer.limits))
    motion = motion_of(replace(answer.load, robot=robot), answer.trajectory.sample(answer.step))
    return _if_small(page.viewer_page(robot, motion=replace(motion, clearance=answer.clearance), embed=True))


@plots_of.register
def _(answer: Identification) -> Mapping[str, Plot]:
    left_out_rows = ~answer.kept
    draw = partial(plot_compensation, answer.log, answer.sensor, answer.noise, marked=left_out_rows, mark="left out")
    return {"Readings before and after": draw}


@plots_of.register
def _(answer: Compensation) -> Mapping[str, Plot]:
    draw = partial(plot_compensation, answer.log, answer.sensor, answer.noise, marked=answer.hits, mark="contact")
    return {"Readings before and after": draw}


@plots_of.register
def _(answer: PoseProposal) -> Mapping[str, Plot]:
    return {"Next poses": partial(plot_proposal, answer)} if answer.determines_mass else {}
