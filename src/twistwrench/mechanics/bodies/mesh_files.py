"""Files of meshes. Names of other files, and sizes of unpacked arrays, are checked before trimesh reads them."""

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
_GLB_MAGIC = b"glTF"
"""First bytes of a file in binary glTF."""
_GLB_JSON = slice(20, None)
"""Bytes from the JSON of binary glTF on, after two headers."""


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

    Raises MissingExtraError, NotFoundError, and ModelError whose text is a sentence without its subject. Materials and buffers
    in other files are read only from the folder of the mesh and from folders below.
    """
    try:
        import trimesh
    except ImportError:
        raise MissingExtraError.from_extra("trimesh", "mesh", f"Reading the mesh {path.name}") from None
    if not path.is_file():
        raise NotFoundError(f"no mesh file {str(path)!r}.")
    with third_party_errors(lambda reason: ModelError(f"cannot be read as a mesh: {reason}")):
        parts = []
        scene = _scene(path, trimesh)
        for node in scene.graph.nodes_geometry:
            T, name = scene.graph[node]
            mesh = scene.geometry[name]
            if not len(getattr(mesh, "faces", ())):
                continue
            shape = np.shape(mesh.vertices)
            if shape[1:] != (3,):
                raise ModelError(f"has vertices of {shape[-1]} numbers, and three are needed")
            check_faces(mesh.faces, len(mesh.vertices))
            vertices = np.asarray(mesh.vertices, float) @ T[:3, :3].T + T[:3, 3]
            parts.append(MeshPart(vertices, np.asarray(mesh.faces, np.int64), _colour_of(mesh)))
    if not parts:
        raise ModelError("holds no triangles")
    return parts


def _colour_of(mesh: Any) -> tuple[float, float, float] | None:
    """Main colour of a mesh, 0 to 1 each; None if the file gives none."""
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
            folder = path.resolve().parent
            named_path = (folder / name.strip()).resolve()
            if not named_path.is_relative_to(folder):
                raise ModelError(f"names {name[:200]!r}, which lies outside the folder of the mesh")
            return read_bytes(named_path, _MAX_BYTES)

    data = read_bytes(path, _MAX_BYTES)
    suffix = path.suffix.lower()
    if suffix == ".dae":
        from ...core.entities import refuse_entities

        refuse_entities(data, lambda name: ModelError(f"declares the entity {name[:200]!r}, which is refused"))
    elif suffix in (".gltf", ".glb"):
        _check_gltf(data)
    file_type = suffix.removeprefix(".")
    return trimesh.load_scene(io.BytesIO(data), file_type=file_type, resolver=Neighbours(str(path)))


def check_faces(faces: Any, count: int) -> None:
    """Raise ModelError, a sentence without its subject, for a face whose vertex number is not below ``count``."""
    lowest, highest = int(faces.min()), int(faces.max())
    if lowest < 0 or highest >= count:
        wrong_number = highest if highest >= count else lowest
        raise ModelError(f"has a face of vertex {wrong_number}, and {count} vertices")


def _check_gltf(data: bytes) -> None:
    """Raise ModelError for contents that would grow without limit when unpacked.

    These are arrays without data, which may have any size, and nodes with several parents, which are copied for each parent.
    """
    json_text = data
    if data.startswith(_GLB_MAGIC):
        json_length = int.from_bytes(data[12:16], "little")
        json_text = data[_GLB_JSON][:json_length]
    content: dict[str, Any] = json.loads(json_text)
    for number, accessor in enumerate(content.get("accessors", ())):
        if "bufferView" not in accessor:
            raise ModelError(f"has an accessor without data (number {number}), which is refused")
    parent_counts: Counter[int] = Counter()
    for node in content.get("nodes", ()):
        parent_counts.update(node.get("children", ()))
    for node_number, parent_count in parent_counts.items():
        if parent_count > 1:
            raise ModelError(f"has a node with {parent_count} parents (number {node_number}); one is allowed")
