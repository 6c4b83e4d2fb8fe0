"""Files of meshes: what a file names and unpacks is checked before trimesh reads it."""

from __future__ import annotations

import io
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...core.errors import ModelError
from ...core.files import read_bytes

SUFFIXES = (".stl", ".dae", ".obj", ".ply", ".glb", ".gltf", ".off")
"""Suffixes of the mesh files that a robot file may name. Others are never opened."""
_MOST_BYTES = 256 * 2**20
"""Largest file of a mesh [bytes]."""
_GLB, _JSON = b"glTF", slice(20, None)
"""First bytes of binary glTF, and its JSON behind two heads."""


def load_mesh(path: Path, load: Callable[..., Any], **options: Any) -> Any:
    """Content of a mesh file by a loader of trimesh. Raises OSError, and ModelError with a sentence without its subject.

    Materials and buffers in other files are read only from the folder of the mesh and those below.
    """
    from trimesh.resolvers import FilePathResolver

    class Neighbours(FilePathResolver):
        """Files beside a mesh; versions of trimesh before 5 read any file."""

        def get(self, name: str) -> bytes:
            home = path.resolve().parent
            place = (home / name.strip()).resolve()
            if not place.is_relative_to(home):
                raise ModelError(f"names {name[:200]!r}, which lies outside the folder of the mesh")
            return read_bytes(place, _MOST_BYTES)

    data, kind = read_bytes(path, _MOST_BYTES), path.suffix.lower()
    if kind == ".dae":
        from ...core.entities import refuse_entities

        refuse_entities(data, lambda name: ModelError(f"declares the entity {name[:200]!r}, which is refused"))
    elif kind in (".gltf", ".glb"):
        _check_gltf(data)
    return load(io.BytesIO(data), file_type=kind[1:], resolver=Neighbours(str(path)), **options)


def check_faces(faces: Any, count: int) -> None:
    """Raise ModelError, a sentence without its subject, for a face of a vertex that is not one of ``count``."""
    least, most = int(faces.min()), int(faces.max())
    if least < 0 or most >= count:
        raise ModelError(f"has a face of vertex {most if most >= count else least}, and {count} vertices")


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
