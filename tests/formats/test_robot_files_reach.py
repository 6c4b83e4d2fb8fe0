"""Robot files from strangers: places outside that they could reach, and sizes that they could unpack to."""

from __future__ import annotations

import io
import json
import os
import random
import struct
import warnings
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.formats.source import find_resource
from twistwrench.mechanics.bodies.mesh import read_surface
from twistwrench.shapes.surface import read_mesh
from twistwrench.simulation import SimulationResult

BOX = "solid t\n" + "".join(
    f"facet normal 0 0 0\nouter loop\nvertex 0 0 {k}\nvertex 1 0 {k}\nvertex 0 1 {k}\nendloop\nendfacet\n"
    for k in (0, 1)
)

# ── Meshes that a robot file names


@pytest.fixture
def robot_file(tmp_path: Path, monkeypatch) -> Path:
    """A robot in a package, meshes inside and outside, and links that lead out."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    package = tmp_path / "home" / "ws" / "arm"
    for folder in (
        package / "urdf",
        package / "meshes",
        tmp_path / "home" / "ws" / "tools",
        tmp_path / "home" / "private",
    ):
        folder.mkdir(parents=True)
        (folder / "part.stl").write_text(BOX)
    (package / "package.xml").write_text("<package><name>arm</name></package>")
    (tmp_path / "home" / "private" / "secret.txt").write_text("SECRET")
    (package / "meshes" / "out.stl").symlink_to(tmp_path / "home" / "private" / "part.stl")
    (package / "meshes" / "text.stl").symlink_to(tmp_path / "home" / "private" / "secret.txt")
    (package / "meshes" / "self.stl").symlink_to(package / "meshes" / "self.stl")
    (package / "away").symlink_to(tmp_path / "home" / "private")
    return package / "urdf" / "arm.urdf"


NAMES = {
    "part.stl": True,
    "../meshes/part.stl": True,
    "package://arm/meshes/part.stl": True,
    "package://tools/part.stl": True,
    "package:///arm/meshes/part.stl": True,
    "package:////private/part.stl": False,
    "package:///../arm/meshes/part.stl": False,
    "file://{}/ws/arm/meshes/part.stl": True,
    "../../tools/part.stl": False,
    "../../../private/part.stl": False,
    "file://{}/private/part.stl": False,
    "{}/private/part.stl": False,
    "package://private/part.stl": False,
    "package://arm/away/part.stl": False,
    "../away/part.stl": False,
    "../meshes/out.stl": False,
    "../meshes/text.stl": False,
    "../meshes/self.stl": False,
    "package://arm/meshes/out.stl": False,
    "http://example.org/part.stl": False,
    "file:///etc/passwd": False,
    "file:///dev/zero": False,
    "\0": False,
}


@pytest.mark.parametrize("name", NAMES)
def test_meshes_are_read_from_the_package_of_the_robot_only(robot_file, name, tmp_path):
    assert (find_resource(name.format(tmp_path / "home"), robot_file) is not None) is NAMES[name]


def test_packages_of_the_environment_may_consist_of_links(robot_file, tmp_path, monkeypatch):
    built = tmp_path / "home" / "install" / "share" / "arm" / "meshes"
    built.mkdir(parents=True)
    (built / "linked.stl").symlink_to(tmp_path / "home" / "private" / "part.stl")
    assert find_resource("package://arm/meshes/linked.stl", robot_file) is None
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "home" / "install"))
    assert find_resource("package://arm/meshes/linked.stl", robot_file) == built / "linked.stl"


def test_a_package_of_the_environment_is_not_left_by_its_name(robot_file, tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "home" / "ws"))
    assert find_resource("package://tools/part.stl", robot_file) is not None
    for rest in ("tools/../../private/part.stl", "../private/part.stl", "tools/%2e%2e/%2e%2e/private/part.stl"):
        assert find_resource(f"package://{rest}", robot_file) is None


def test_a_link_with_the_suffix_of_a_mesh_gives_no_other_file(robot_file):
    package = robot_file.parent.parent
    (package / "notes.txt").write_text("SECRET")
    (package / "meshes" / "notes.stl").symlink_to(package / "notes.txt")
    assert find_resource("package://arm/meshes/notes.stl", robot_file) is None


def test_without_a_package_meshes_lie_beside_the_robot_or_its_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for folder in ("arm/urdf", "arm/meshes", "other", "home/loads"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "part.stl").write_text(BOX)
    (tmp_path / "home" / "part.stl").write_text(BOX)
    assert find_resource("../meshes/part.stl", tmp_path / "arm/urdf/arm.urdf") is not None
    assert find_resource("../../other/part.stl", tmp_path / "arm/urdf/arm.urdf") is None
    assert find_resource("part.stl", tmp_path / "home/loads/arm.urdf") is not None
    assert find_resource("../part.stl", tmp_path / "home/loads/arm.urdf") is None


# ── Content of meshes


def gltf(**content: object) -> dict[str, object]:
    triangle = {"primitives": [{"attributes": {"POSITION": 0}, "mode": 4}]}
    whole = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [triangle],
    }
    return {**whole, **content}


NINE = [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}]
EMPTY = gltf(accessors=[{"componentType": 5126, "count": 300_000_000, "type": "VEC3"}])
OUTSIDE = gltf(
    accessors=NINE, bufferViews=[{"buffer": 0, "byteLength": 36}], buffers=[{"uri": "../private.bin", "byteLength": 36}]
)
SHARED = gltf(
    nodes=[*({"children": [k + 1, k + 1]} for k in range(40)), {"mesh": 0}], accessors=NINE,
    bufferViews=[{"buffer": 0, "byteLength": 36}], buffers=[{"uri": "data.bin", "byteLength": 36}],
)  # fmt: skip


def glb(content: dict[str, object]) -> bytes:
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON") + text


BOMB = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 9))
COLLADA = '<?xml version="1.0"?><!DOCTYPE c [{}]><COLLADA version="1.4.1"><asset><contributor><author>{}</author></contributor></asset></COLLADA>'
MESHES = {
    "arrays without data": (".gltf", json.dumps(EMPTY).encode(), "without data"),
    "arrays without data, binary": (".glb", glb(EMPTY), "without data"),
    "a buffer outside": (".gltf", json.dumps(OUTSIDE).encode(), "outside|escapes"),
    "nodes that multiply": (".gltf", json.dumps(SHARED).encode(), "2 parents"),
    "entities": (".dae", COLLADA.format(f'<!ENTITY e0 "lol">{BOMB}', "&e8;").encode(), "entity 'e0'"),
    "an external entity": (
        ".dae",
        COLLADA.format('<!ENTITY x SYSTEM "file:///etc/passwd">', "&x;").encode(),
        "entity 'x'",
    ),
    "a count of STL": (".stl", b"\0" * 80 + struct.pack("<I", 900_000_000) + b"\0" * 50, "no triangles|mesh"),
    "a count of PLY": (
        ".ply",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 900000000\nproperty float x\nproperty float y\nproperty float z\n"
        b"end_header\n0000",
        "length|triangles",
    ),
    "a count of OFF": (".off", b"OFF\n900000000 900000000 0\n0 0 0\n", "mesh"),
    "JSON that is deep": (".gltf", b"[" * 100_000, "deep|mesh"),
}


@pytest.mark.parametrize("mesh", MESHES)
def test_meshes_take_memory_in_proportion_and_reach_no_other_folder(mesh, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    suffix, data, words = MESHES[mesh]
    if suffix == ".dae":
        pytest.importorskip("collada")
    assert trimesh
    (tmp_path / "private.bin").write_bytes(bytes(36))
    (tmp_path / "meshes").mkdir()
    path = tmp_path / "meshes" / f"part{suffix}"
    path.write_bytes(data)
    for read in (read_mesh, read_surface):
        with pytest.raises(tw.ModelError, match=words):
            read(path)


# ── MJCF


MESH_OF_MASS = """<mujoco><asset><mesh name="m" file="{}"/></asset><worldbody><body name="b"><joint name="j"/>
<geom type="mesh" mesh="m"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("name", "words"), [("self.stl", "is not there"), ("m.zip", "not a mesh"), ("m.py", "not a mesh")]
)
def test_a_mesh_of_mjcf_that_links_to_itself_or_is_none_is_one_error(tmp_path, name, words):
    (tmp_path / "self.stl").symlink_to(tmp_path / "self.stl")
    for other in ("m.zip", "m.py"):
        (tmp_path / other).write_text("PK")
    path = tmp_path / "robot.xml"
    path.write_text(MESH_OF_MASS.format(name))
    with pytest.raises(tw.RobotFileError, match=words):
        tw.load(path)


# ── Messages


def link(name: str, inertial: str = "") -> str:
    return f'<link name="{name}">{inertial}</link>'


def fixed(name: str, parent: str, child: str) -> str:
    return f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'


MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LONG = [f"{'n' * 150}{k}" for k in range(800)]
LINKS = [link(name) for name in LONG]
LOOP = [fixed(f"j{k}", LONG[k - 1], LONG[k]) for k in range(800)]
CLASSES = "".join(f"<default class='{name}'/>" for name in LONG)
MODELS = "".join(f"<model name='{name}'><link name='a'/></model>" for name in LONG)
LENGTHY = {
    "inertials": f"<robot>{link('a', MASS * 800)}</robot>",
    "a long cycle": f"<robot>{''.join(LINKS + LOOP)}</robot>",
    "roots": f"<robot>{''.join(LINKS)}</robot>",
    "classes": f"<mujoco><default>{CLASSES}</default><worldbody><body childclass='z'/></worldbody></mujoco>",
    "models": f"<sdf version='1.7'>{MODELS}</sdf>",
}


@pytest.mark.parametrize("case", LENGTHY)
def test_messages_about_robot_files_are_bounded(case):
    for read in (tw.load, tw.doctor):
        with pytest.raises(tw.ModelError) as caught:
            read(LENGTHY[case])
        assert len(str(caught.value)) < 1100


# ── Archives that this program writes


def test_archives_are_refused_by_their_headers_if_out_of_proportion(tmp_path):
    path = tmp_path / "file.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2, 2**25)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("format.npy", written(np.array("twistwrench simulation 1")))
        archive.writestr("said.npy", written(np.array("{}")))
        archive.writestr("q.npy", b"\x93NUMPY\x01\x00" + header.getvalue()[8:] + bytes(1000))
    with pytest.raises(tw.TwistWrenchError, match=r"unpacks to more than 256 MiB"):
        SimulationResult.load(path)


def written(x: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, x)
    return file.getvalue()


class Planted:
    """Object whose unpickling makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.mark.parametrize("read", ["simulation", "log"])
def test_objects_in_archives_are_not_unpickled(read, tmp_path):
    path, planted = tmp_path / "file.npz", np.array([Planted(tmp_path / "RAN")], object)
    np.savez(path, format=np.array("twistwrench simulation 1"), said=planted, times=planted, q=planted)
    readers = {
        "simulation": SimulationResult.load,
        "log": partial(tw.Motion.from_file, robot=tw.robots.planar_2r()),
    }
    with pytest.raises(tw.TwistWrenchError):
        readers[read](path)
    assert not (tmp_path / "RAN").exists()


# ── USD


def test_layers_outside_are_not_opened_to_be_refused(tmp_path):
    """A pipe would wait for ever, and a device never end."""
    pytest.importorskip("pxr")
    (tmp_path / "robot").mkdir()
    os.mkfifo(tmp_path / "pipe.usda")
    os.mkfifo(tmp_path / "robot" / "pipe.usda")
    (tmp_path / "robot" / "out.usda").symlink_to("/dev/zero")
    entry = tmp_path / "robot" / "robot.usda"
    for name in ("../pipe.usda", "./pipe.usda", "/dev/zero", "./out.usda", "../other/none.usda"):
        for arc in ("references", "payload"):
            entry.write_text(f'#usda 1.0\n(\n defaultPrim = "a"\n)\ndef Xform "a" (\n {arc} = @{name}@\n)\n{{\n}}\n')
            with pytest.raises(tw.RobotFileError, match=r"outside its folder|not a file"):
                tw.load(entry)
        entry.write_text(f"#usda 1.0\n(\n subLayers = [@{name}@]\n)\n")
        with pytest.raises(tw.RobotFileError, match=r"outside its folder|not a file"):
            tw.load(entry)


def test_layers_of_layers_outside_are_not_opened_either(tmp_path):
    pytest.importorskip("pxr")
    (tmp_path / "robot").mkdir()
    os.mkfifo(tmp_path / "pipe.usda")
    entry, middle = tmp_path / "robot" / "robot.usda", tmp_path / "robot" / "middle.usda"
    entry.write_text("#usda 1.0\n(\n subLayers = [@./middle.usda@]\n)\n")
    middle.write_text("#usda 1.0\n(\n subLayers = [@../pipe.usda@]\n)\n")
    with pytest.raises(tw.RobotFileError, match="outside its folder"):
        tw.load(entry)


def test_damaged_stages_end_in_one_error(tmp_path):
    """Bytes that are not Unicode among them, which the library repeats in texts of errors that raise themselves."""
    pytest.importorskip("pxr")
    from test_usd import usd_text

    text = f'#usda 1.0\n(\n defaultPrim = "arm"\n metersPerUnit = 1\n upAxis = "Z"\n)\n{usd_text()}'.encode()
    rng, path, refused = random.Random("usd"), tmp_path / "file.usda", 0
    for _ in range(30):
        damaged = bytearray(text)
        for _ in range(rng.randint(1, 3)):
            damaged[rng.randrange(20, len(text))] = rng.randrange(256)
        path.write_bytes(damaged)
        try:
            tw.load(path)
        except tw.TwistWrenchError as problem:
            refused += 1
            assert len(str(problem)) < 1100
    assert refused > 15


TYPES = {
    "float3 physics:centerOfMass": "float physics:centerOfMass = 1",
    "quatf physics:principalAxes": "float3 physics:principalAxes = (1, 0, 0)",
    "float physics:mass": 'string physics:mass = "heavy"',
    "float3 physics:diagonalInertia": "float[] physics:diagonalInertia = [1, 2, 3]",
}


@pytest.mark.parametrize("named", TYPES)
def test_values_of_another_type_in_a_stage_are_one_error(named, tmp_path):
    pytest.importorskip("pxr")
    body = f"""#usda 1.0
(
 defaultPrim = "a"
 metersPerUnit = 1
)
def Xform "a" (
 prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsArticulationRootAPI"]
)
{{
 {TYPES[named]}
}}
"""
    path = tmp_path / "robot.usda"
    path.write_text(body)
    with warnings.catch_warnings(), pytest.raises(tw.RobotFileError, match=named.partition(" ")[2]):
        warnings.simplefilter("ignore")
        tw.load(path)
