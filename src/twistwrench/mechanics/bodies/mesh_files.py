"""Files of meshes: what a file names and unpacks is checked before trimesh reads it."""

from __future__ import annotations

import io
import json
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core.errors import MissingExtraError, ModelError, NotFoundError
from ...core.files import read_bytes
from ...core.third_party import third_party_errors
from ...core.typing import Array

SUFFIXES = (".stl", ".dae", ".obj", ".ply", ".glb", ".gltf", ".off")
"""Suffixes of the mesh files that a robot file may name. Others are never opened."""
_MAX_BYTES = 256 * 2**20
"""Largest file of a mesh [bytes]."""
_GLB, _JSON = b"glTF", slice(20, None)
"""First bytes of binary glTF, and its JSON behind two heads."""


class MeshPart(NamedTuple):
    """Triangles of one part of a file, in the file's frame."""

    vertices: Array
    """(n, 3)"""
    faces: Array
    """(k, 3) vertex numbers."""
    colour: tuple[float, float, float] | None
    """Colour in the file; trimesh's default grey is ignored."""


def read_parts(path: Path) -> list[MeshPart]:
    """Parts of a mesh file that trimesh reads.

    Raises MissingExtraError, NotFoundError, and ModelError with a sentence without its subject.
    Materials and buffers in other files are read only from the folder of the mesh and those below.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError.from_extra("trimesh", "mesh", f"Reading the mesh {path.name}") from None
    if not path.is_file():
        raise NotFoundError(f"no mesh file {str(path)!r}.")
    with third_party_errors(lambda reason: ModelError(f"cannot be read as a mesh: {reason}")):
        parts, scene = [], _scene(path, trimesh)
        for node in scene.graph.nodes_geometry:
            T, name = scene.graph[node]
            mesh = scene.geometry[name]
            if not len(getattr(mesh, "faces", ())):
                continue
            if np.shape(mesh.vertices)[1:] != (3,):
                raise ModelError(f"has vertices of {np.shape(mesh.vertices)[-1]} numbers, and three are needed")
            check_faces(mesh.faces, len(mesh.vertices))
            vertices = np.asarray(mesh.vertices, float) @ T[:3, :3].T + T[:3, 3]
            parts.append(MeshPart(vertices, np.asarray(mesh.faces, np.int64), _colour_of(mesh)))
    if not parts:
        raise ModelError("holds no triangles")
    return parts


def _colour_of(mesh: Any) -> tuple[float, float, float] | None:
    if mesh.visual.kind not in ("texture", "face", "vertex"):
        return None
    source = mesh.visual.material if mesh.visual.kind == "texture" else mesh.visual
    r, g, b = (np.asarray(source.main_color[:3], float) / 255).tolist()
    return r, g, b


def _scene(path: Path, trimesh: Any) -> Any:
    """Content of a mesh file, checked before it is unpacked."""

    class Neighbours(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
        """Files beside a mesh; versions of trimesh before 5 read any file."""

        def get(self, name: str) -> bytes:
            home = path.resolve().parent
            place = (home / name.strip()).resolve()
            if not place.is_relative_to(home):
                raise ModelError(f"names {name[:200]!r}, which lies outside the folder of the mesh")
            return read_bytes(place, _MAX_BYTES)

    data, kind = read_bytes(path, _MAX_BYTES), path.suffix.lower()
    if kind == ".dae":
        from ...core.entities import refuse_entities

        refuse_entities(data, lambda name: ModelError(f"declares the entity {name[:200]!r}, which is refused"))
    elif kind in (".gltf", ".glb"):
        _check_gltf(data)
    return trimesh.load_scene(io.BytesIO(data), file_type=kind[1:], resolver=Neighbours(str(path)))


def check_faces(faces: Any, count: int) -> None:
    """Raise ModelError, a sentence without its subject, for a face of a vertex that is not one of ``count``."""
    lowest, highest = int(faces.min()), int(faces.max())
    if lowest < 0 or highest >= count:
        raise ModelError(f"has a face of vertex {highest if highest >= count else lowest}, and {count} vertices")


def _check_gltf(data: bytes) -> None:
    """Raise ModelError for arrays without data, which have any size, and for nodes with several parents, which multiply."""
    start = int.from_bytes(data[12:16], "little")
    content: dict[str, Any] = json.loads(data[_JSON][:start] if data.startswith(_GLB) else data)
    empty = [k for k, accessor in enumerate(content.get("accessors", ())) if "bufferView" not in accessor]
    if empty:
        raise ModelError(f"has an accessor without data (number {empty[0]}), which is refused")
    parents = Counter(child for node in content.get("nodes", ()) for child in node.get("children", ()))
    shared = [node for node, count in parents.items() if count > 1]
    if shared:
        raise ModelError(f"has a node with {parents[shared[0]]} parents (number {shared[0]}); one is allowed")
