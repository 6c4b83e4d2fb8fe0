"""The robot in viser's scene (https://viser.studio): nodes made once, and moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ValueRangeError
from ..lie import quaternion, se3
from ..model.model import BASE
from ..typing import Array
from .arrows import arc, arrow
from .colours import COLOURS, force_scale, share_colours, torque_marks
from .skeleton import turned_z
from .surface import ellipsoid

if TYPE_CHECKING:
    from .scene import Scene, Shape

LAYERS = {
    "looks": "Robot",
    "inertia": "Inertia ellipsoids",
    "torques": "Torques",
    "wrenches": "Wrenches",
    "com": "Centre of mass",
    "frames": "Frames",
    "ellipsoid": "Force ellipsoid",
    "polytope": "Force polytope",
}
"""What can be switched on and off, and its label."""
_FULL = 5.4
"""Angle of the arc of a torque at its limit [rad]."""
_LEAST = 0.004


class Nodes:
    """Everything drawn, by layer; ``server`` is a ``viser.ViserServer``."""

    def __init__(self, server: Any, scene: Scene, q: Array, wrenches: Mapping[str, Array]) -> None:
        self.server, self.scene, self.robot = server, scene, scene.robot
        self.size = scene.size
        self.layers: dict[str, list[Any]] = {name: [] for name in LAYERS}
        self.shown = dict.fromkeys(LAYERS, True)
        self.bodies = {BASE: server.scene.add_frame("/robot", show_axes=False)}
        for k, body in enumerate(self.robot.model.bodies):
            if body.joint.moves_body:
                self.bodies[k] = server.scene.add_frame(f"/robot/{k}", show_axes=False)
        self.force_scale = force_scale(self.robot, scene)
        self._floor(q)
        for number, shape in enumerate(scene.shapes):
            self._shape(number, shape)
        for number, (name, frame) in enumerate(self.robot.model.frames.items()):
            self._add("frames", self._frame(number, name, frame.body, frame.pose))
        self._wrenches(wrenches)
        self._marks = [
            (mark, self._mark(mark.body, f"torque_{mark.torque}")) for mark in torque_marks(self.robot.model)
        ]
        if any(body.inertia.mass for body in self.robot.model.bodies):
            self._add("com", server.scene.add_icosphere("/com", 0.026 * self.size, _bytes(COLOURS["com"])))

    def switch(self, layer: str, on: bool) -> None:
        """Show a layer, or hide it."""
        self.shown[layer] = on
        for node in self.layers[layer]:
            node.visible = on

    def has(self, layer: str) -> bool:
        """Whether there is anything to show."""
        forces = layer in ("ellipsoid", "polytope") and self.force_scale > 0
        return forces or bool(self.layers[layer]) or (layer == "torques" and bool(self._marks))

    def update(self, q: Array, shares: Array, coloured: Array) -> None:
        """Move to q (nq,), with torques of these shares (nv,) of their scale; NaN in ``coloured`` (nv,) is no limit."""
        poses = self.scene.body_poses(q)
        with self.server.atomic():
            for k, node in self.bodies.items():
                if k != BASE:
                    _move(node, poses[k])
            for mark, node in self._marks:
                self._set_mark(node, mark, float(shares[mark.torque]), coloured[mark.torque])
            if self.layers["com"]:
                self.layers["com"][0].position = self.robot.center_of_mass(q)
            self._forces(q)

    # ── made once ──

    def _add(self, layer: str, node: Any) -> Any:
        self.layers[layer].append(node)
        return node

    def _floor(self, q: Array) -> None:
        low = float(self.scene.bounds(q)[0, 2])
        self.server.scene.add_grid(
            "/floor",
            infinite_grid=True,
            cell_size=10 ** np.floor(np.log10(self.size / 4)),
            section_size=10 ** np.floor(np.log10(self.size / 4)) * 10,
            fade_distance=8 * self.size,
            cell_color=(205, 211, 219),
            section_color=(165, 173, 184),
            position=(0.0, 0.0, low - 1e-3 * self.size),
        )

    def _shape(self, number: int, shape: Shape) -> None:
        surface = shape.surface.creased().placed(shape.pose)
        self._add(
            shape.layer,
            self.server.scene.add_mesh_simple(
                f"{self.bodies[shape.body].name}/shape_{number}",
                surface.vertices,
                surface.faces,
                color=_bytes(shape.colour),
                opacity=0.3 if shape.layer == "inertia" else None,
                side="front" if shape.layer == "inertia" else "double",
                cast_shadow=shape.layer == "looks",
            ),
        )

    def _frame(self, number: int, name: str, body: int, T: Array) -> Any:
        length = 0.07 * self.size
        node = self.server.scene.add_frame(
            f"{self.bodies[body].name}/frame_{number}_{_plain(name)}", axes_length=length, axes_radius=0.05 * length
        )
        _move(node, T)
        return node

    def _mark(self, body: int, name: str) -> Any:
        surface = arc(1.0, 1.0, 0.1)
        node = self.server.scene.add_mesh_simple(
            f"{self.bodies[body].name}/{name}", surface.vertices, surface.faces, side="double", visible=False
        )
        return self._add("torques", node)

    def _wrenches(self, wrenches: Mapping[str, Array]) -> None:
        largest = max((float(np.linalg.norm(F[3:])) for F in wrenches.values()), default=0.0)
        for name, F in wrenches.items():
            frame = self.robot.model.all_frames[name]
            for part, kind in ((F[:3], "moment"), (F[3:], "force")):
                if not (size := float(np.linalg.norm(part))) > 0:
                    continue
                length = max(0.08, 0.35 * size / largest) if kind == "force" else 0.0
                s = self.size
                surface = arrow(length * s, 0.014 * s) if kind == "force" else arc(4.4, 0.09 * s, 0.008 * s)
                surface = surface.placed(frame.pose @ se3.pose(turned_z(part), np.zeros(3)))
                node = self.server.scene.add_mesh_simple(
                    f"{self.bodies[frame.body].name}/{kind}_{_plain(name)}",
                    surface.vertices,
                    surface.faces,
                    color=_bytes(COLOURS["wrench"]),
                    side="double",
                )
                self._add("wrenches", node)

    # ── changed ──

    def _set_mark(self, node: Any, mark: Any, share: float, coloured: float) -> None:
        node.visible = self.shown["torques"] and abs(share) > _LEAST
        if not node.visible:
            return
        s, level = self.size, min(1.0, abs(share))
        surface = arc(_FULL * level, 0.105 * s, 0.0079 * s) if mark.turns else arrow(0.4 * level * s, 0.008 * s)
        T = mark.pose if share > 0 else mark.pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        placed = surface.placed(T)
        if len(node.faces) != len(placed.faces):
            node.faces = placed.faces.astype(np.uint32)
        node.vertices = placed.vertices.astype(np.float32)
        node.color = _bytes(share_colours(coloured))

    def _forces(self, q: Array) -> None:
        """The force ellipsoid and polytope at the tip, where they are shown and there are any."""
        from ..statics.ellipsoid import wrench_ellipsoid
        from ..statics.polytope import wrench_polytope

        if not self.force_scale or not (self.shown["ellipsoid"] or self.shown["polytope"]):
            return
        at = np.asarray(self.robot.forward_kinematics(q))[:3, 3]
        for layer in ("ellipsoid", "polytope"):
            vertices = faces = None
            if self.shown[layer] and layer == "ellipsoid":
                found = wrench_ellipsoid(self.robot, q, limits=self.robot.limits.effort)
                if np.isfinite(found.semi_axes).all():
                    ball = ellipsoid(found.semi_axes)
                    vertices, faces = ball.vertices @ found.axes.T, ball.faces
            elif self.shown[layer]:
                try:
                    polytope = wrench_polytope(self.robot, q)
                except ValueRangeError:  # the robot cannot hold itself here
                    polytope = None
                if polytope is not None and not polytope.borne.size:
                    vertices, faces = _hull(polytope.vertices)
            for node in self.layers[layer]:
                node.remove()
            self.layers[layer] = []
            if vertices is not None:
                place = at + self.force_scale * vertices
                node = self.server.scene.add_mesh_simple(
                    f"/{layer}", place, faces, color=_bytes(COLOURS[layer]), opacity=0.3,
                    flat_shading=layer == "polytope", cast_shadow=False,
                )  # fmt: skip
                self._add(layer, node)


def _hull(points: Array) -> tuple[Array, Array]:
    """Corners and outward triangles of a convex body."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    a, b, c = (points[faces[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return points, faces


def _move(node: Any, T: Array) -> None:
    node.wxyz, node.position = quaternion.from_matrix(T[:3, :3]), T[:3, 3]


def _bytes(colour: Any) -> tuple[int, int, int]:
    r, g, b = (round(255 * float(c)) for c in colour)
    return r, g, b


def _plain(name: str) -> str:
    """A link's name as part of a node's."""
    return "".join(c if c.isalnum() else "_" for c in name)
