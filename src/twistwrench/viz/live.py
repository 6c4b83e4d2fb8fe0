"""The page that talks with Python: a robot in the browser by viser, moved by sliders or a motion, its torques computed here."""

from __future__ import annotations

import contextlib
import html
import io
import socket
import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core import arguments
from ..errors import MissingExtraError, ValueRangeError
from ..lie import quaternion
from ..motion.coordinates import Coordinates
from ..typing import Array
from .colours import share_colours
from .page_access import PageAccess
from .scene import Scene, scene_of
from .scene_nodes import LAYERS, Nodes
from .sliders import sliders_of

if TYPE_CHECKING:
    import viser

    from ..robot import Robot
    from .drawn_motion import DrawnMotion

_TRIANGLES = 400_000
_RATE = 30.0
"""Pictures a second while a motion plays."""
_SPEEDS = ("0.1 ×", "0.25 ×", "0.5 ×", "1 ×", "2 ×", "5 ×")


def check_port(port: int, host: str = "127.0.0.1") -> None:
    """Raise ValueRangeError where nothing can be served at ``port``; 0 means any that is free."""
    if not 0 <= port <= 65535:
        raise ValueRangeError(f"port {port} does not exist. Give 1024 to 65535, or 0 for any that is free.")
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: what has just closed is free
        try:
            probe.bind((host, port))
        except OSError as problem:
            beside = port + 1 if 1024 <= port < 65535 else 8080
            raise ValueRangeError(
                f"port {port} of {host} cannot be used: {problem.strerror or problem}. "
                f"Give another, such as --port {beside}, or --port 0 for any that is free."
            ) from None


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
            server = _private_server()
        except ImportError:
            raise MissingExtraError.of("viser", "viz", "The live view") from None
        if motion is not None:
            motion.require(robot)
            robot, wrench_on_robot = motion.load.loaded, dict(motion.load.wrenches)
        self.robot, self.motion = robot, motion
        start = robot.neutral if motion is None else motion.q[0]
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
        with _silence(), self.access.guarding():  # what is to be said of the page, its maker says
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
        with _silence():
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
            self.torque_panel.content = self._torque_table(shares, coloured)
            for hand, slider in zip(self.hands, self.sliders, strict=True):
                value = _value(hand, self.q)
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
                gui.add_html(f"<div style='{_TEXT}color:#8a4b08'>{'<br>'.join(map(html.escape, notes))}</div>")

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
        value = round(_value(hand, self.q), digits)
        low, high = (round(hand[end] * factor, digits) for end in ("lower", "upper"))
        label = f"{hand['name'].removesuffix('_joint')} [{hand['unit']}]"
        slider = self.server.gui.add_slider(label, min(low, value), max(high, value), step, value)

        @slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                self.pose(_grasped(self.hands[k], self.q, slider.value / factor))

        return slider

    def _switch(self, layer: str, label: str, on: bool) -> None:
        box = self.server.gui.add_checkbox(label, on)

        @box.on_update
        def _(_event: Any) -> None:
            with self._lock:
                self.nodes.switch(layer, box.value)
                self.refresh()

    def _torque_table(self, shares: Array, coloured: Array) -> str:
        units, rows = Coordinates.of(self.robot.model).torque_units, []
        for name, unit, tau, x, c in zip(
            self.robot.model.velocity_names, units, self.tau.round(2), shares, coloured, strict=True
        ):
            wide = 50 * min(1.0, abs(float(x)))
            colour = "rgb({} {} {})".format(*(round(255 * float(v)) for v in share_colours(c)))
            bar = (
                "<div style='position:relative;height:9px;width:88px;background:#e8ecf0;border-radius:3px'>"
                f"<div style='position:absolute;top:0;bottom:0;left:{50 - wide if x < 0 else 50:.1f}%;width:{wide:.1f}%;"
                f"background:{colour}'></div></div>"
            )
            share = "" if np.isnan(c) else f"{abs(c):.0%}"
            cells = (html.escape(name.removesuffix("_joint")), bar, f"{tau + 0.0:.2f} {unit}".replace("-", "−"), share)
            rows.append(f"<tr>{''.join(f'<td style={_CELL!r}>{cell}</td>' for cell in cells)}</tr>")
        title = "Torques that hold this pose" if self.posed else f"Torques of the motion at {self.time:.2f} s"
        return f"<div style='{_TEXT}'><b>{title}</b><table style='width:100%'>{''.join(rows)}</table></div>"


def _private_server() -> type[viser.ViserServer]:
    """viser's server with its tunnel to the public closed: any page that is connected may ask for one."""
    import viser

    class PrivateServer(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    return PrivateServer


def _silence() -> contextlib.redirect_stdout[io.StringIO]:
    return contextlib.redirect_stdout(io.StringIO())


_TEXT = "font-size:12px;padding:2px 12px 8px;"
_CELL = "padding:1px 4px;white-space:nowrap;font-variant-numeric:tabular-nums"


def _value(hand: dict[str, Any], q: Array) -> float:
    """What a slider shows: degrees or metres."""
    value = _angles(q[hand["q"] : hand["q"] + 4])[hand["turn"]] if "turn" in hand else float(q[hand["q"]])
    return float(np.degrees(value)) if hand["unit"] == "°" else value


def _grasped(hand: dict[str, Any], q: Array, value: float) -> Array:
    """q with one hand moved to a value in rad or m."""
    q, at = q.copy(), hand["q"]
    if "turn" not in hand:
        q[at] = value
        return q
    angles = _angles(q[at : at + 4])
    angles[hand["turn"]] = value
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.array(angles) / 2), np.sin(np.array(angles) / 2)
    q[at : at + 4] = (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
    return q


def _angles(quat: Array) -> list[float]:
    """Roll, pitch, yaw of a quaternion."""
    R = np.asarray(quaternion.rotation(quat / np.linalg.norm(quat)))
    pitch = float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
    return [float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))]
