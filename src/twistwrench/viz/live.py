"""The page that talks with Python: a robot in the browser by viser, moved by sliders or a motion, its torques computed here."""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..core.printed_numbers import seconds
from ..errors import MissingExtraError, ValueRangeError
from ..typing import Array
from .live_server import check_port, private_server, silence
from .page_access import PageAccess
from .scene import Scene, scene_of
from .scene_nodes import LAYERS, Nodes
from .sliders import slider_value, sliders_of, with_slider
from .starting_pose import starting_pose
from .torque_table import TEXT, torque_table

if TYPE_CHECKING:
    from ..robot import Robot
    from .drawn_motion import DrawnMotion

_TRIANGLES = 400_000
_RATE = 30.0
"""Pictures a second while a motion plays."""
_SPEEDS = ("0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "5 ×")


class LiveView:
    """Live viewer: a robot on a page of this computer, at :attr:`url`; torques are computed by its kernels.

    The address has a token in it that is drawn anew for each page; requests without it, from pages of others, or for
    names of others are refused, and the page cannot be shared by viser's tunnel.

    Parameters
    ----------
    robot : Robot
    motion : DrawnMotion, optional, which plays; without one, and when a slider is moved, torques are those that hold
        the pose
    q : (nq,) array_like, optional, where it starts
    wrench_on_robot : {frame: (6,)}, optional, wrenches (m, f) in their frames, drawn and counted [N m, N]
    scene : Scene, optional, the robot's looks
    port : int
    host : str

    Raises
    ------
    ValueRangeError
        The port is taken.
    MissingExtraError
        There is no viser.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        motion: DrawnMotion | None = None,
        q: ArrayLike | None = None,
        wrench_on_robot: Mapping[str, ArrayLike] | None = None,
        scene: Scene | None = None,
        port: int = 8080,
        host: str = "127.0.0.1",
    ) -> None:
        check_port(port, host)
        try:
            server = private_server()
        except ImportError:
            raise MissingExtraError.of("viser", "viz", "The live view") from None
        if motion is not None:
            motion.require(robot)
            robot, wrench_on_robot = motion.load.loaded, dict(motion.load.wrenches)
        self.robot, self.motion = robot, motion
        start = starting_pose(robot) if motion is None else motion.q[0]
        self.q = np.array(
            start if q is None else arguments.finite(arguments.one(q, "q", robot.nq), "q", robot.nq), float
        )
        self.wrenches = {n: arguments.one(F, f"the wrench on {n!r}", 6) for n, F in (wrench_on_robot or {}).items()}
        self.time = 0.0 if motion is None else float(motion.time[0])
        self.posed = motion is None
        self.playing, self.speed = False, 1.0
        self.tau = np.zeros(robot.nv)
        self._lock = threading.RLock()
        scene = (scene_of(robot) if scene is None else scene).thinned(_TRIANGLES)
        self.access = PageAccess(host)
        with silence(), self.access.guarding():  # what is to be said of the page, its maker says
            self.server = server(host=host, port=port, label=robot.name, verbose=False)
        try:
            self.access.require()
        except MissingExtraError:
            self.close()
            raise
        if port and self.server.get_port() != port:  # taken since it was looked at
            self.close()
            check_port(port, host)
            raise ValueRangeError(f"port {port} of {host} cannot be used. Give another, or 0 for any that is free.")
        self.url = self.access.url(self.server.get_port())
        self._arrange(scene)
        self._panel(scene)
        self.refresh()

    def close(self) -> None:
        """End the page."""
        self.playing = False
        with silence():
            self.server.stop()

    def serve(self) -> None:
        """Play, and answer the page, until interrupted."""
        before = time.monotonic()
        while True:
            time.sleep(1.0 / _RATE)
            now = time.monotonic()
            self.advance(now - before)
            before = now

    def advance(self, seconds: float) -> None:
        """Let the motion go on for some of the viewer's time, if it plays; after its end it begins again.

        Parameters
        ----------
        seconds : float [s]
        """
        if not self.playing or self.motion is None:
            return
        begin, end = float(self.motion.time[0]), float(self.motion.time[-1])
        at = self.time + self.speed * seconds
        self.seek(begin + (at - begin) % (end - begin) if at > end > begin else min(at, end))

    def seek(self, at: float) -> None:
        """Go to a time of the motion.

        Parameters
        ----------
        at : float [s]

        Raises
        ------
        ValueRangeError
            There is no motion.
        """
        motion = self.motion
        if motion is None:
            raise ValueRangeError("there is no motion to go to a time of. Give one: motion=….")
        with self._lock:
            self.time, self.posed = float(np.clip(at, motion.time[0], motion.time[-1])), False
            self.q, self.tau = motion.at(self.time)
            self.refresh()

    def pose(self, q: ArrayLike) -> None:
        """Go to a pose, at rest; a motion that plays stops.

        Parameters
        ----------
        q : (nq,) array_like, configuration

        Raises
        ------
        ShapeError
            ``q`` is of another size.
        """
        with self._lock:
            self.q = np.array(arguments.finite(arguments.one(q, "q", self.robot.nq), "q", self.robot.nq))
            self.posed, self.playing = True, False
            self.refresh()

    def refresh(self) -> None:
        """Bring the page to the state there is."""
        with self._lock:
            if self.posed:
                self.tau = np.asarray(self.robot.holding_torques(self.q, wrench_on_robot=self.wrenches or None))
            shares, coloured = self.shares()
            self.nodes.update(self.q, shares, coloured)
            title = (
                "Torques that hold this pose" if self.posed else f"Torques of the motion at {seconds(self.time, 2)} s"
            )
            self.torque_panel.content = torque_table(self.robot.model, title, self.tau, shares, coloured)
            for hand, slider in zip(self.hands, self.sliders, strict=True):
                value = slider_value(hand, self.q)
                if abs(slider.value - value) > 0.5 * slider.step:
                    slider.value = round(float(np.clip(value, slider.min, slider.max)), 3 - 2 * (hand["unit"] == "°"))
            if self.motion is not None:
                self.time_slider.value = self.time
                self.play_button.label = "Pause" if self.playing else "Play"

    def shares(self) -> tuple[Array, Array]:
        """Torques as shares of their limits, elsewhere of the largest.

        Returns
        -------
        shares : (nv,) array
        of_limits : (nv,) array, the same with NaN where there is no limit
        """
        limits = np.where(self.robot.limits.effort > 0, self.robot.limits.effort, np.inf)
        most = np.abs(self.tau).max(initial=1e-9) if self.motion is None else np.maximum(self.motion.peaks, 1e-9)
        some = np.isfinite(limits)
        shares = self.tau / np.where(some, limits, most)
        return shares, np.where(some, shares, np.nan)

    # ── made once ──

    def _arrange(self, scene: Scene) -> None:
        server = self.server
        server.scene.set_up_direction("+z")
        server.scene.configure_environment_map(None)  # the pictures it lights with are fetched from elsewhere
        server.scene.add_light_hemisphere(
            "/sky", sky_color=(255, 255, 255), ground_color=(205, 211, 219), intensity=3.0
        )
        server.gui.configure_theme(
            show_logo=False, show_share_button=False, brand_color=(31, 78, 121), control_width="medium"
        )
        low, high = scene.bounds(self.q)
        middle = (low + high) / 2
        server.initial_camera.look_at = middle
        server.initial_camera.position = middle + 1.45 * scene.size * np.array([0.58, -0.74, 0.34])
        self.nodes = Nodes(server, scene, self.q, self.wrenches)

    def _panel(self, scene: Scene) -> None:
        gui = self.server.gui
        if self.motion is not None:
            self._motion_controls(self.motion)
        self.torque_panel = gui.add_html("")
        self.hands = sliders_of(self.robot.model)
        with gui.add_folder("Joints"):
            self.sliders = [self._slider(k, hand) for k, hand in enumerate(self.hands)]
        with gui.add_folder("Show"):
            on = {"looks": True, "inertia": not scene.dressed and not scene.doubtful, "torques": True, "wrenches": True}
            for layer, label in LAYERS.items():
                self.nodes.switch(layer, on.get(layer, False))
                if self.nodes.has(layer):
                    self._switch(layer, label, on.get(layer, False))
        notes = [*scene.notes, *(self.motion.warnings if self.motion is not None else ())]
        if notes:
            with gui.add_folder("Notes"):
                gui.add_html(f"<div style='{TEXT}color:#8a4b08'>{'<br>'.join(map(html.escape, notes))}</div>")

    def _motion_controls(self, motion: DrawnMotion) -> None:
        gui = self.server.gui
        with gui.add_folder("DrawnMotion"):
            begin, end = float(motion.time[0]), float(motion.time[-1])
            self.time_slider: Any = gui.add_slider(
                "Time [s]", begin, max(end, begin + 1e-3), (end - begin) / 1000 or 1e-3, begin
            )
            self.play_button = gui.add_button("Play")
            speed = gui.add_dropdown("Speed", _SPEEDS, initial_value="1 ×")

        @self.time_slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # moved by hand, not by us
                self.playing = False
                self.seek(self.time_slider.value)

        @self.play_button.on_click
        def _(_event: Any) -> None:
            self.playing = not self.playing
            self.seek(self.time)

        @speed.on_update
        def _(_event: Any) -> None:
            self.speed = float(speed.value.split()[0])

    def _slider(self, k: int, hand: dict[str, Any]) -> Any:
        factor = 180 / np.pi if hand["unit"] == "°" else 1.0
        digits, step = (1, 0.1) if hand["unit"] == "°" else (3, 0.001)
        value = round(slider_value(hand, self.q), digits)
        low, high = (round(hand[end] * factor, digits) for end in ("lower", "upper"))
        label = f"{hand['name'].removesuffix('_joint')} [{hand['unit']}]"
        slider = self.server.gui.add_slider(label, min(low, value), max(high, value), step, value)

        @slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                self.pose(with_slider(self.hands[k], self.q, slider.value / factor))

        return slider

    def _switch(self, layer: str, label: str, on: bool) -> None:
        box = self.server.gui.add_checkbox(label, on)

        @box.on_update
        def _(_event: Any) -> None:
            with self._lock:
                self.nodes.switch(layer, box.value)
                self.refresh()
