"""Mesh files. Before trimesh reads a file, the names of other files in it and the sizes of unpacked arrays are checked."""

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
"""Suffixes of the mesh files that a robot file may name. Other files are never opened."""
_MAX_BYTES = 256 * 2**20
"""Largest size of a mesh file [bytes]."""
_MAX_NAME_LENGTH = 200
"""Number of characters of a name in a message."""
_GLB_MAGIC = b"glTF"
"""First bytes of a file in binary glTF."""
_GLB_JSON_LENGTH = slice(12, 16)
"""Bytes with the length of the JSON in binary glTF."""
_GLB_JSON_START = 20
"""First byte of the JSON in binary glTF, after two headers."""


class MeshPart(NamedTuple):
    """Triangles of one part of a file, in the file's frame."""

    vertices: Array
    """Positions (n, 3)."""
    faces: Array
    """Vertex numbers (k, 3), from 0."""
    colour: tuple[float, float, float] | None
    """Red, green and blue in the file, 0 to 1 each; None without a colour."""


def read_parts(path: Path) -> list[MeshPart]:
    """Parts of a mesh file that trimesh reads.

    Raises MissingExtraError, NotFoundError and ModelError. The text of a ModelError lacks its subject, the mesh. Materials and
    buffers in other files are read only from the folder of the mesh and from folders below.
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
            T, name = scene.graph[node]  # pose in the file's frame, name of the mesh
            mesh = scene.geometry[name]
            faces = getattr(mesh, "faces", ())  # points and lines have none
            if len(faces) == 0:
                continue
            shape = np.shape(mesh.vertices)  # (n, 3) as a rule
            if shape[1:] != (3,):
                raise ModelError(f"has vertices of {shape[-1]} numbers, and three are needed")
            check_faces(mesh.faces, len(mesh.vertices))
            R, p = T[:3, :3], T[:3, 3]
            vertices = np.asarray(mesh.vertices, float) @ R.T + p
            parts.append(MeshPart(vertices, np.asarray(mesh.faces, np.int64), _colour_of(mesh)))
    if not parts:
        raise ModelError("holds no triangles")
    return parts


def _colour_of(mesh: Any) -> tuple[float, float, float] | None:
    """Main colour of a mesh: red, green, blue, 0 to 1 each; None if the file has no colour."""
    if mesh.visual.kind not in ("texture", "face", "vertex"):  # trimesh's default grey
        return None
    source = mesh.visual.material if mesh.visual.kind == "texture" else mesh.visual
    bytes_of_colour = np.asarray(source.main_color[:3], float)  # without opacity
    r, g, b = (bytes_of_colour / 255).tolist()
    return r, g, b


def _scene(path: Path, trimesh: Any) -> Any:
    """Content of a mesh file, checked before it is unpacked."""

    class FolderResolver(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
        """Reader of other files, only in the folder of the mesh; versions of trimesh before 5 read any file."""

        def get(self, name: str) -> bytes:
            folder = path.resolve().parent
            named_path = (folder / name.strip()).resolve()
            if not named_path.is_relative_to(folder):
                raise ModelError(f"names {name[:_MAX_NAME_LENGTH]!r}, which lies outside the folder of the mesh")
            return read_bytes(named_path, _MAX_BYTES)

    data = read_bytes(path, _MAX_BYTES)
    suffix = path.suffix.lower()
    if suffix == ".dae":
        from ...core.entities import refuse_entities

        def refusal(name: str) -> ModelError:
            return ModelError(f"declares the entity {name[:_MAX_NAME_LENGTH]!r}, which is refused")

        refuse_entities(data, refusal)
    elif suffix in (".gltf", ".glb"):
        _check_gltf(data)
    file_type = suffix.removeprefix(".")
    return trimesh.load_scene(io.BytesIO(data), file_type=file_type, resolver=FolderResolver(str(path)))


def check_faces(faces: Any, count: int) -> None:
    """Raise ModelError for a face with a number that is not of one of ``count`` vertices; its text lacks the subject."""
    lowest, highest = int(faces.min()), int(faces.max())  # vertex numbers
    if lowest < 0 or highest >= count:
        wrong_number = highest if highest >= count else lowest
        raise ModelError(f"has a face of vertex {wrong_number}, and {count} vertices")


def _check_gltf(data: bytes) -> None:
    """Raise ModelError for contents that would grow without limit when unpacked.

    These are arrays without data, which may have any size, and nodes with several parents, which are copied for each parent.
    """
    json_text = data
    if data.startswith(_GLB_MAGIC):
        json_length = int.from_bytes(data[_GLB_JSON_LENGTH], "little")
        json_text = data[_GLB_JSON_START : _GLB_JSON_START + json_length]
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
