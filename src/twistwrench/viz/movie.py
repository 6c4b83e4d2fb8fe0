"""Films of a motion: robot and torque bars. MP4 needs ffmpeg."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core.colours import COLOURS, Style, word_style
from ..core.errors import MissingExtraError, ValueRangeError
from ..core.files import replacing
from ..core.glossary import complete
from ..core.numbers import number, printed, seconds
from ..core.typing import Array
from ..reports.drawn_motion import DrawnMotion, motion_of
from ..reports.spoken_verdict import verdict_text
from . import style
from .colours import share_colours
from .plots.robot_picture import CAMERA_DISTANCE, MAX_TRIANGLES, Painter, mark_overloaded_links, overview
from .scene import Scene, scene_of

if TYPE_CHECKING:
    from ..reports.torque_report import TorqueReport
    from ..robot import Robot

MOVIES = (".gif", ".mp4")
"""Supported film formats, by suffix."""
_COLOURS_IN_GIF = 256
"""Number of colours in the palette of a GIF."""
_MAX_OVERVIEW_POSES = 24
"""About the number of poses of the motion by which the camera is placed."""
_PALETTE_FRAMES = 4
"""About the number of frames from which the palette of a GIF is computed."""
_MAX_FRAMES = 2000
"""Maximum number of pictures in a film."""
_MAX_BARS = 12
"""Maximum number of torque bars; a robot with more joints shows the joints nearest to their limits."""
_MIN_ROWS = 4
"""Number of rows for bars, at least; fewer bars are not made thicker."""
_WIDTH = 8.0  # of a film [inch]
_HEIGHT = 4.5  # [inch]
_PIXELS_PER_INCH = 100  # 800 x 450 pixels
_MAX_LINE_LENGTH = 72
"""Largest number of characters in a line of the verdict's reason."""
# Half the size of the robot's picture, in units of the visible region:
_HALF_WIDTH = 0.56
_HALF_HEIGHT = 0.47
_GRID_SIZE = 2.2
"""Size of the floor's grid, in units of the visible region."""
_MIN_AXIS_END = 1.15
"""Smallest end of the bars' axis, in shares of a limit."""
_AXIS_END_PER_BAR = 1.05
"""End of the bars' axis, in units of the largest bar."""


def movie(
    robot: Robot,
    time: ArrayLike,
    q: ArrayLike,
    path: str | Path,
    *,
    dq: ArrayLike | None = None,
    ddq: ArrayLike | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Film a motion to a .gif or .mp4; :func:`motion_of` lists the derived quantities.

    Parameters
    ----------
    time : (n,) array_like [s]
    q : (n, nq) array_like, configurations
    dq : (n, nv) array_like, optional, velocities [rad/s, m/s]
    ddq : (n, nv) array_like, optional, accelerations [rad/s², m/s²]

    Raises
    ------
    MissingExtraError
        Matplotlib is not installed, or ffmpeg is missing for .mp4.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> t = np.linspace(0, 0.2, 7)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     movie(tw.robots.pendulum(), t, np.sin(t)[:, None], f"{folder}/swing.gif", fps=10).suffix
    '.gif'
    """
    movie_path(path)
    return film(motion_of(robot, time, q, dq, ddq), path, fps=fps, speed=speed, progress=progress)


def film(
    motion: DrawnMotion,
    path: str | Path,
    *,
    scene: Scene | None = None,
    fps: float = 20.0,
    speed: float = 1.0,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Film a :class:`DrawnMotion`; see :func:`movie`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> from twistwrench.viz import motion_of
    >>> t = np.linspace(0, 0.2, 7)
    >>> motion = motion_of(tw.robots.pendulum(), t, np.sin(t)[:, None])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     film(motion, f"{folder}/swing.gif", fps=10).suffix
    '.gif'
    """
    target = Path(movie_path(path))
    frame_times = _frame_times(motion, fps, speed)
    robot = motion.load.with_load
    if scene is None:
        scene = scene_of(robot)
    scene = mark_overloaded_links(scene, motion).decimated(MAX_TRIANGLES)
    frame_step = max(1, len(frame_times) // _MAX_OVERVIEW_POSES)
    overview_poses = []
    for t in frame_times[::frame_step]:
        q, _ = motion.at(t)
        overview_poses.append(q)
    camera, floor_height = overview(scene, np.array(overview_poses))
    painter = Painter(scene, camera, floor_height)
    with replacing(target) as scratch, style.figure(_WIDTH, _HEIGHT, robot.name, "Filming a motion") as drawn:
        drawn.set_dpi(_PIXELS_PER_INCH)
        subfigures = drawn.subfigures(1, 2, width_ratios=[1.9, 1.0])  # robot, bars
        left_figure, right_figure = cast("Any", subfigures)
        stage = _Stage(left_figure.subplots(), painter)
        bars = _Bars(right_figure.subplots(), motion)
        if motion.report is not None:  # torques were judged
            _write_payload_and_verdict(left_figure, motion.report)
        drawn.canvas.draw()
        drawn.set_layout_engine("none")  # fixed layout: computing it takes longer than drawing
        writer = _writer(target.suffix.lower(), fps)
        with writer.saving(drawn, str(scratch), dpi=_PIXELS_PER_INCH):
            for frame_count, t in enumerate(frame_times, start=1):
                q, tau = motion.at(t)
                stage.show(q)
                bars.show(tau, t)
                writer.grab_frame()
                if progress is not None:
                    progress(frame_count, len(frame_times))
    return target


def _write_payload_and_verdict(figure: Any, report: TorqueReport) -> None:
    """Write payload and verdict in the upper left corner."""
    word = report.verdict.word
    masses = " + ".join(f"{number(payload.mass)} kg" for payload in report.load.payloads)
    payload_text = "no payload"
    if masses:
        payload_text = f"payload {masses}"
    first_line, _, _ = verdict_text(report).partition("\n")
    reason = fill(first_line.removeprefix(f"{word}: "), _MAX_LINE_LENGTH)
    *_, colour_name = word_style(word).split()  # after "bold"
    colour = COLOURS[Style(colour_name)].plot
    # Heights and the left end are shares of the figure.
    layout: dict[str, Any] = {"x": 0.03, "va": "top", "ha": "left"}
    figure.text(y=0.97, s=payload_text, fontsize=style.SMALL_FONT, color=style.INK, **layout)
    figure.text(y=0.925, s=word, fontsize=style.SMALL_FONT + 6, color=colour, fontweight="bold", **layout)
    figure.text(y=0.855, s=reason, fontsize=style.SMALL_FONT, color=style.INK, **layout)


def movie_path(path: str | Path) -> str:
    """Path of a film; a path without a suffix gets ``.gif``.

    Raises
    ------
    ValueRangeError
        The suffix is not in :data:`MOVIES`.
    MissingExtraError
        Matplotlib is not installed, or ffmpeg is missing for .mp4.
    """
    suffix = Path(path).suffix.lower()
    if suffix and suffix not in MOVIES:
        raise ValueRangeError(
            f"cannot film to {Path(path).name!r}: films of kind {suffix[1:]!r} are not made. Choose one of {', '.join(MOVIES)}."
        )
    style.require_matplotlib("Filming a motion")
    if suffix == ".mp4":
        from matplotlib.animation import FFMpegWriter

        if not FFMpegWriter.isAvailable():
            raise MissingExtraError(
                f"cannot film to {Path(path).name!r}: .mp4 needs the program ffmpeg, which is not on the PATH. "
                "Install it (apt install ffmpeg), or give a name that ends in .gif."
            )
    return str(path) if suffix else f"{path}.gif"


def _frame_times(motion: DrawnMotion, fps: float, speed: float) -> Array:
    """Time (n,) of the motion at each frame of the film [s]."""
    for name, value in (("fps", fps), ("speed", speed)):
        if not 0 < value < np.inf:
            raise ValueRangeError(f"{name} is {value}, and must be positive and finite.")
    duration = float(motion.time[-1] - motion.time[0])
    frame_count = int(duration * fps / speed) + 1
    if frame_count > _MAX_FRAMES:
        sufficient_speed = np.ceil(duration * fps / _MAX_FRAMES)
        raise ValueRangeError(
            f"a film of {printed(duration)} s at {printed(fps)} pictures a second takes {frame_count}, more than "
            f"{_MAX_FRAMES}. Show it faster, such as speed={printed(sufficient_speed)}, or give a part of the motion."
        )
    return np.asarray(motion.time[0] + np.arange(frame_count) * speed / fps)


def _writer(suffix: str, fps: float) -> Any:
    """Matplotlib's writer for films with a suffix."""
    from matplotlib.animation import FFMpegWriter

    if suffix == ".gif":
        return gif_writer(max(1, round(fps)))  # at least one frame a second
    return FFMpegWriter(fps=cast("int", fps), codec="libx264", extra_args=["-pix_fmt", "yuv420p", "-crf", "20"])


def gif_writer(fps: int) -> Any:
    """GIF writer with one palette, so that only changed pixels are stored: an eighth of the size."""
    from matplotlib.animation import PillowWriter
    from PIL import Image

    class Writer(PillowWriter):
        """Writer that stores all frames with one palette."""

        def finish(self) -> None:
            """Compute the palette from a few frames, and write the file."""
            pictures = [picture.convert("RGB") for picture in self._frames]  # type: ignore[attr-defined]
            frame_step = max(1, len(pictures) // _PALETTE_FRAMES)
            samples = pictures[::frame_step]
            width, height = samples[0].size
            column = Image.new("RGB", (width, height * len(samples)))  # the samples, one below the other
            for k, picture in enumerate(samples):
                column.paste(picture, (0, k * height))
            palette = column.quantize(_COLOURS_IN_GIF, kmeans=1)
            frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
            milliseconds = round(1000 / self.fps)  # of a frame
            frames[0].save(self.outfile, save_all=True, append_images=frames[1:], duration=milliseconds, loop=0)

    return Writer(fps=fps)


class _Stage:
    """Picture of the robot on the floor's grid, to be drawn at one pose after another."""

    def __init__(self, axis: Any, painter: Painter) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        self.painter = painter
        region_size = painter.camera.distance / CAMERA_DISTANCE  # [m]
        axis.set_axis_off()
        axis.set_aspect("equal")
        axis.set_xlim(-_HALF_WIDTH * region_size, _HALF_WIDTH * region_size)
        axis.set_ylim(-_HALF_HEIGHT * region_size, _HALF_HEIGHT * region_size)
        self.polygons = axis.add_collection(PolyCollection([], linewidths=0.25, zorder=2))
        floor_lines = list(painter.grid(_GRID_SIZE * region_size))
        axis.add_collection(LineCollection(floor_lines, colors=style.FLOOR, linewidths=0.6, zorder=1))

    def show(self, q: Array) -> None:
        """Draw the robot at a configuration."""
        triangles, colours = self.painter.paint(q)
        self.polygons.set_verts(triangles)
        self.polygons.set_facecolor(colours)
        is_transparent = colours[:, 3:] < 1.0
        self.polygons.set_edgecolor(np.where(is_transparent, 0.0, colours))  # edges hide seams of opaque shapes


class _Bars:
    """Bars of torques, as shares of the torque limits; a joint without a limit has shares of its peak."""

    def __init__(self, axis: Any, motion: DrawnMotion) -> None:
        robot = motion.load.with_load
        limits = np.where(motion.limits.effort > 0, motion.limits.effort, np.inf)
        self.has_limit = np.isfinite(limits)
        peaks = np.maximum(motion.peaks, 1e-9)  # not divided by zero
        self.scale = np.where(self.has_limit, limits, peaks)  # torque of a full bar
        peak_shares = np.where(self.has_limit, motion.peaks / self.scale, -1.0)  # joints without a limit come last
        nearest_to_limit = np.argsort(-peak_shares, kind="stable")[:_MAX_BARS]
        self.joints = np.sort(nearest_to_limit)
        """Indices of the joints with bars."""
        names = [robot.model.velocity_names[k].removesuffix("_joint") for k in self.joints]
        rows = np.arange(len(names))
        self.axis = axis
        self.bars = axis.barh(rows, np.zeros(len(names)), height=0.62)
        axis.axvline(0, color=style.AXIS, linewidth=0.7)
        largest_bar = float(np.max(motion.peaks / self.scale, initial=0.0))
        axis_end = max(_MIN_AXIS_END, _AXIS_END_PER_BAR * largest_bar)
        for side in (-1, 1):
            axis.axvline(side, **style.LIMIT)
        axis.set_xlim(-axis_end, axis_end)
        axis.set_yticks(rows, names, fontsize=style.SMALL_FONT)
        row_count = max(len(rows), _MIN_ROWS)
        axis.set_ylim(row_count - 0.4, -0.6)  # first joint at the top; 0.6 rows beyond the middle of the outer bars
        axis.grid(visible=False, axis="y")
        label = "torque / limit"
        if not self.has_limit[self.joints].all():
            label += ", or / peak"
        axis.set_xlabel(label, fontsize=style.SMALL_FONT)
        self.clock = axis.set_title("", loc="right", color=style.QUIET, fontsize=style.SMALL_FONT + 1)
        axis.tick_params(labelcolor=style.INK)

    def show(self, tau: Array, t: float) -> None:
        """Set the bars to torques (nv,) and the clock to a time [s]."""
        shares = tau[self.joints] / self.scale[self.joints]
        shares_of_limits = np.where(self.has_limit[self.joints], shares, np.nan)  # nan: the colour of no limit
        colours = share_colours(shares_of_limits)
        for bar, share, colour in zip(self.bars, shares, colours, strict=True):
            bar.set_width(share)
            bar.set_color(colour)
        self.clock.set_text(f"t = {seconds(t, 2)} s")


complete(globals())
