"""A motion as a film: the robot, and beside it each torque against its limit. GIF needs nothing more, MP4 needs ffmpeg."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core.printed_numbers import printed, seconds
from ..errors import MissingExtraError, ValueRangeError
from ..outputs import replacing
from ..plotting.style import AXIS, INK, LIMIT, QUIET, SMALL, figure, require_matplotlib
from ..typing import Array
from .camera import FAR, Painter, overview
from .colours import share_colours
from .drawn_motion import DrawnMotion, motion_of
from .scene import Scene, scene_of

if TYPE_CHECKING:
    from ..robot import Robot

MOVIES = (".gif", ".mp4")
"""The kinds of film that are made, by their suffixes."""
_TRIANGLES = 5000
_MOST = 2000
"""Pictures of one film."""
_BARS = 12
"""Joints shown beside the robot; of more, those nearest to their limits."""


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
    """Film a motion to a .gif or .mp4; what is derived of it, :func:`motion_of` says.

    Parameters
    ----------
    robot : Robot
    time : (n,) array_like [s]
    q : (n, nq) array_like, configurations
    path : str or Path, .gif or .mp4
    dq : (n, nv) array_like, optional, velocities [rad/s, m/s]
    ddq : (n, nv) array_like, optional, accelerations [rad/s², m/s²]
    fps : float, pictures a second of film
    speed : float, seconds of motion that a second of film shows
    progress : callable, optional, told how many of how many pictures are drawn

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    MissingExtraError
        There is no matplotlib, or no ffmpeg for .mp4.
    ValueRangeError, ShapeError
        Arrays do not fit each other, or the file cannot be written.

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

    Parameters
    ----------
    motion : DrawnMotion
    path : str or Path, .gif or .mp4
    scene : Scene, optional, the robot's looks
    fps : float, pictures a second of film
    speed : float, seconds of motion that a second of film shows
    progress : callable, optional, told how many of how many pictures are drawn

    Returns
    -------
    path : Path of the file written

    Raises
    ------
    MissingExtraError, ValueRangeError
        As :func:`movie`.

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
    moments = _moments(motion, fps, speed)
    robot = motion.load.loaded
    scene = (scene_of(robot) if scene is None else scene).thinned(_TRIANGLES)
    painter = _painter(scene, motion, moments)
    with replacing(target) as scratch, figure(8.0, 4.5, robot.name, "Filming a motion") as drawn:
        drawn.set_dpi(100)
        left, right = cast("Any", drawn.subfigures(1, 2, width_ratios=[1.9, 1.0]))
        stage = _Stage(left.subplots(), painter)
        bars = _Bars(right.subplots(), motion)
        drawn.canvas.draw()
        drawn.set_layout_engine("none")  # found once; finding it for every picture takes longer than drawing it
        writer = _writer(target.suffix.lower(), fps)
        with writer.saving(drawn, str(scratch), dpi=100):
            for k, moment in enumerate(moments):
                q, tau = motion.at(moment)
                stage.show(q)
                bars.show(tau, moment)
                writer.grab_frame()
                if progress:
                    progress(k + 1, len(moments))
    return target


def movie_path(path: str | Path) -> str:
    """The file a film goes to: ``path``, with .gif added if it has no suffix.

    Raises ValueRangeError for a suffix that is none of :data:`MOVIES`, MissingExtraError where its maker is not there.
    """
    text, suffix = str(path), Path(path).suffix.lower()
    if suffix and suffix not in MOVIES:
        raise ValueRangeError(
            f"cannot film to {Path(path).name!r}: films of kind {suffix[1:]!r} are not made. Choose one of {', '.join(MOVIES)}."
        )
    require_matplotlib("Filming a motion")
    if suffix == ".mp4":
        from matplotlib.animation import FFMpegWriter

        if not FFMpegWriter.isAvailable():
            raise MissingExtraError(
                f"cannot film to {Path(path).name!r}: .mp4 needs the program ffmpeg, which is not on the PATH. "
                "Install it (apt install ffmpeg), or give a name that ends in .gif."
            )
    return text if suffix else f"{text}.gif"


def _moments(motion: DrawnMotion, fps: float, speed: float) -> Array:
    for name, value in (("fps", fps), ("speed", speed)):
        if not 0 < value < np.inf:
            raise ValueRangeError(f"{name} is {value}, and must be positive and finite.")
    span = float(motion.time[-1] - motion.time[0])
    count = int(span * fps / speed) + 1
    if count > _MOST:
        raise ValueRangeError(
            f"a film of {printed(span)} s at {printed(fps)} pictures a second takes {count}, more than {_MOST}. "
            f"Show it faster, such as speed={printed(np.ceil(span * fps / _MOST))}, or give a part of the motion."
        )
    return np.asarray(motion.time[0] + np.arange(count) * speed / fps)


def _writer(suffix: str, fps: float) -> Any:
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if suffix == ".gif":
        return PillowWriter(fps=round(fps) or 1)
    return FFMpegWriter(fps=cast("int", fps), codec="libx264", extra_args=["-pix_fmt", "yuv420p", "-crf", "20"])


def _painter(scene: Scene, motion: DrawnMotion, moments: Array) -> Painter:
    some = np.array([motion.at(t)[0] for t in moments[:: max(1, len(moments) // 24)]])
    return Painter(scene, *overview(scene, some))


class _Stage:
    def __init__(self, axis: Any, painter: Painter) -> None:
        from matplotlib.collections import LineCollection, PolyCollection

        self.painter = painter
        size = painter.camera.distance / FAR
        axis.set_axis_off()
        axis.set_aspect("equal")
        axis.set_xlim(-0.56 * size, 0.56 * size)
        axis.set_ylim(-0.47 * size, 0.47 * size)
        self.polygons = axis.add_collection(PolyCollection([], linewidths=0.25, zorder=2))
        axis.add_collection(LineCollection(list(painter.grid(2.2 * size)), colors="#d9dde2", linewidths=0.6, zorder=1))

    def show(self, q: Array) -> None:
        triangles, colours = self.painter.paint(q)
        self.polygons.set_verts(triangles)
        self.polygons.set_facecolor(colours)
        self.polygons.set_edgecolor(np.where(colours[:, 3:] < 1.0, 0.0, colours))  # hides the seams of what is solid


class _Bars:
    """Each torque as a share of its limit, elsewhere of its largest."""

    def __init__(self, axis: Any, motion: DrawnMotion) -> None:
        robot = motion.load.loaded
        limits = np.where(robot.limits.effort > 0, robot.limits.effort, np.inf)
        self.limited = np.isfinite(limits)
        self.scale = np.where(self.limited, limits, np.maximum(motion.peaks, 1e-9))
        first = np.argsort(-np.where(self.limited, motion.peaks / self.scale, -1.0), kind="stable")[:_BARS]
        self.chosen = np.sort(first)
        names = [robot.model.velocity_names[k].removesuffix("_joint") for k in self.chosen]
        rows = np.arange(len(names))
        self.axis = axis
        self.bars = axis.barh(rows, np.zeros(len(names)), height=0.62)
        axis.axvline(0, color=AXIS, linewidth=0.7)
        reach = max(1.15, 1.05 * float(np.max(motion.peaks / self.scale, initial=0.0)))
        for side in (-1, 1):
            axis.axvline(side, **LIMIT)
        axis.set_xlim(-reach, reach)
        axis.set_yticks(rows, names, fontsize=SMALL)
        axis.set_ylim(max(len(rows), 4) - 0.4, -0.6)
        axis.grid(visible=False, axis="y")
        axis.set_xlabel(
            "torque / limit" if self.limited[self.chosen].all() else "torque / limit, or / peak", fontsize=SMALL
        )
        self.clock = axis.set_title("", loc="right", color=QUIET, fontsize=SMALL + 1)
        axis.tick_params(labelcolor=INK)

    def show(self, tau: Array, moment: float) -> None:
        shares = (tau / self.scale)[self.chosen]
        colours = share_colours(np.where(self.limited[self.chosen], shares, np.nan))
        for bar, share, colour in zip(self.bars, shares, colours, strict=True):
            bar.set_width(share)
            bar.set_color(colour)
        self.clock.set_text(f"t = {seconds(moment, 2)} s")
