"""Mesh files that a robot file names, each found and read once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..core.errors import ModelError, TwistWrenchError
from ..formats.source import find_resource
from ..mechanics.bodies.mesh_files import SUFFIXES
from .surface import Colour, Surface, read_mesh

Parts = list[tuple[Surface, Colour | None]]


@dataclass(eq=False)
class MeshFiles:
    """Meshes by their names in a robot file."""

    path: Path | None
    """The robot's file, relative to which meshes are searched; None without a file."""
    folders: Sequence[Path] = ()
    """Additional search folders; meshes are found by name or by their path within the package."""
    _meshes: dict[str, Parts | TwistWrenchError | OSError] = field(default_factory=dict)

    def read(self, name: str) -> Parts:
        """Surfaces of a mesh, one a colour, in the units of the mesh; raises ModelError, MissingExtraError and OSError."""
        if name not in self._meshes:
            try:
                self._meshes[name] = self._read(name)
            except (TwistWrenchError, OSError) as error:
                self._meshes[name] = error
        mesh = self._meshes[name]
        if isinstance(mesh, Exception):
            raise mesh
        return mesh

    def _read(self, name: str) -> Parts:
        path = self._find(name)
        if path is None:
            raise ModelError("is not in its package, nor in ROS_PACKAGE_PATH")
        return read_mesh(path)

    def _find(self, name: str) -> Path | None:
        if self.path is not None:
            path = find_resource(name, self.path)
            if path is not None:
                return path
        parts = [part for part in name.partition("://")[2].split("/") if part] or name.split("/")
        if ".." in parts:
            return None
        for folder in self.folders:
            for k in range(len(parts)):
                place = folder.joinpath(*parts[k:])
                if place.suffix.lower() in SUFFIXES and place.is_file():
                    return place
        return None
