"""Shapes of links, surfaces and capsules: complete answers on record."""

from __future__ import annotations

import struct
from functools import cache

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench.shapes import capsules, meshes, reader, solids, surface, visuals

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")


records = Records(__file__, listed=24)

URDF = """<robot name="looks">
<material name="paint"><color rgba="0.9 0.2 0.4 1"/></material>
<link name="foot"><visual><geometry><box size="0.4 0.3 0.1"/></geometry></visual></link>
<link name="arm">
  <inertial><origin xyz="0.1 0.02 0.3"/><mass value="2"/><inertia ixx="0.2" iyy="0.3" izz="0.25" ixy="0.01" ixz="0" iyz="0.02"/></inertial>
  <visual><origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.5"/><geometry><cylinder radius="0.07" length="0.5"/></geometry>
    <material name="paint"/></visual>
  <visual><geometry><sphere radius="0.11"/></geometry><material name="own"><color rgba="1.4 0.5 -0.1 0.5"/></material></visual>
  <visual><geometry><mesh filename="part.stl" scale="2 -1 0.5"/></geometry><material name="nobody"/></visual>
  <collision><origin xyz="0 0 0.25" rpy="0 0.4 0"/><geometry><box size="0.1 0.2 0.6"/></geometry></collision>
  <collision><origin xyz="0 0 0.6"/><geometry><capsule radius="0.05" length="0.3"/></geometry></collision>
</link>
<link name="hand">
  <inertial><origin xyz="0.02 0.05 0.1"/><mass value="0.7"/><inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><geometry><mesh filename="missing.stl"/></geometry></visual>
  <visual><geometry/></visual>
  <visual><geometry><torus radius="2"/></geometry></visual>
  <visual><geometry><box size="1 2"/></geometry></visual>
  <visual><origin xyz="1 2"/><geometry><sphere radius="0.1"/></geometry></visual>
  <visual/>
  <visual><geometry><sphere radius="0.06"/></geometry><material><color rgba="1 2 3"/></material></visual>
</link>
<link name="tip"><visual><geometry><sphere radius="0.03"/></geometry><material name="paint"/><material name="own"/></visual></link>
<joint name="lift" type="prismatic"><parent link="foot"/><child link="arm"/><origin xyz="0.05 0.1 0.2" rpy="0.1 0 0.2"/><axis xyz="0 0 1"/>
  <limit lower="-0.1" upper="0.8" velocity="1" effort="50"/></joint>
<joint name="bend" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.1 0.05 0.9" rpy="0.2 0.3 0"/><axis xyz="0.2 1 0"/>
  <limit lower="-1.9" upper="2.2" velocity="3" effort="20"/></joint>
<joint name="glue" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0.02 0.01 0.3"/></joint>
</robot>"""

SDF = """<sdf version="1.8"><model name="box"><link name="body">
  <inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1.2</iyy><izz>1.1</izz></inertia></inertial>
  <visual name="a"><pose>0.1 0.2 0.3 0.1 -0.2 0.3</pose><geometry><box><size>0.3 0.2 0.1</size></box></geometry></visual>
  <visual name="b"><geometry><cylinder><radius>0.1</radius><length>0.4</length></cylinder></geometry></visual>
  <visual name="c"><geometry><mesh><uri>part.stl</uri><scale>1 2 3</scale></mesh></geometry></visual>
  <visual name="d"><geometry><mesh><uri>part.stl</uri></mesh></geometry></visual>
  <visual name="e"><geometry><plane><normal>0 0 1</normal></plane></geometry></visual>
  <visual name="f"><pose relative_to="x">1 0 0 0 0 0</pose><geometry><sphere><radius>1</radius></sphere></geometry></visual>
  <visual name="g"><geometry><sphere/></geometry></visual>
  <visual name="h"><geometry/></visual>
  <visual name="i"/>
  <collision name="k"><geometry><ellipsoid><radii>0.1 0.2 0.3</radii></ellipsoid></geometry></collision>
  <collision name="l"><pose relative_to=" ">0 1 0 0 0 0</pose><geometry><capsule><radius>0.1</radius><length>0.4</length></capsule></geometry></collision>
  </link></model></sdf>"""

MJCF = """<mujoco model="geoms"><compiler angle="radian"/><asset><mesh name="m" file="part.stl" scale="1 2 0.5"/></asset><worldbody>
  <geom type="plane" size="1 1 1"/>
  <body name="limb" pos="0 0 1"><joint name="j" axis="0 1 0"/><inertial pos="0.1 0 0.2" mass="1" diaginertia="0.1 0.12 0.13"/>
    <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0.2" euler="0.1 0.2 0.3"/>
    <geom type="capsule" size="0.05" fromto="0 0 0 0.3 0.1 0.2"/>
    <geom type="cylinder" size="0.06 0.2"/>
    <geom size="0.07"/>
    <geom type="ellipsoid" size="0.1 0.2 0.3" pos="0 0.1 0"/>
    <geom type="mesh" mesh="m" pos="0.1 0.2 0.3"/>
    <geom type="box" mesh="m"/>
    <geom type="box" size="0.1"/>
  </body></worldbody></mujoco>"""


def tetrahedron(offset=0.0):
    corners = np.array([[0, 0, 0], [0.3, 0.02, 0], [0.05, 0.4, 0.01], [0.1, 0.06, 0.5]]) + offset
    return corners, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def stl(corners, faces):
    rows = [struct.pack("<12fH", 0, 0, 0, *corners[face].ravel(), 0) for face in faces]
    return b"\0" * 80 + struct.pack("<I", len(faces)) + b"".join(rows)


def files_in(folder):
    (folder / "part.stl").write_bytes(stl(*tetrahedron()))
    for name, text in (("looks.urdf", URDF), ("box.sdf", SDF), ("geoms.xml", MJCF)):
        (folder / name).write_text(text, "utf-8")
    return {name: tw.load(folder / name) for name in ("looks.urdf", "box.sdf", "geoms.xml")}


def described(parts):
    return [[p.kind, p.sizes, p.pose, p.mesh, p.role, p.colour, p.element, p.problem] for p in parts]


@records.of
def shapes_read_from_files(folder):
    found = {}
    for name, robot in files_in(folder).items():
        for role in (None, "visual", "collision"):
            links = reader.read_shapes(robot.model, role)
            if role is None:
                found[name] = [[link.link, described(link.parts)] for link in links]
            else:
                found[f"{name} {role}"] = [[link.link, [p.kind for p in link.parts]] for link in links]
    found["no file"] = reader.read_shapes(tw.robots.planar_2r().with_gravity([0, 0, 0]).model)[:1] == ()
    (folder / "x.urdf").write_text(
        URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" '), "utf-8"
    )
    found["xacro"] = len(reader.read_shapes(tw.load(folder / "x.urdf").model))
    return found


@records.of
def visuals_drawn(folder):
    found = {}
    for name, robot in files_in(folder).items():
        for role in ("visual", "collision"):
            drawn, remarks = visuals.read_visuals(robot.model, role)
            found[f"{name} {role}"] = [
                [[v.link, v.pose, v.colour, v.surface.vertices, v.surface.faces.shape] for v in drawn],
                [text.replace(str(folder), "FOLDER") for text in remarks],
            ]
    (folder / "gone.urdf").write_text(URDF, "utf-8")
    robot = tw.load(folder / "gone.urdf")
    (folder / "gone.urdf").unlink()
    found["gone"] = visuals.read_visuals(robot.model)
    (folder / "x.urdf").write_text(
        '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="a"/></robot>', "utf-8"
    )
    found["xacro"] = visuals.read_visuals(tw.load(folder / "x.urdf").model)
    found["text"] = [len(part) for part in visuals.read_visuals(tw.load(URDF.replace("part.stl", "x.stl")).model)]
    found["built"] = visuals.read_visuals(
        tw.from_dh([[0.5, 0.1, 0.2, 0.3]], columns=("a", "alpha", "d", "theta")).model
    )
    return found


@records.of(relative=1e-6)
def solids_of_links(folder):
    found = {}
    axes = tw.se3.exp([0.3, -0.2, 0.4, 0, 0, 0])[:3, :3]
    for name, robot in files_in(folder).items():
        read = solids.SolidReader(meshes.MeshFiles(folder / name))
        for link in reader.read_shapes(robot.model):
            own = read.read(link)
            if not own.shapes:
                continue
            found[f"{name} {link.link}"] = {
                "complete": own.complete,
                "kinds": [solid.shape.kind for solid in own.solids],
                "points": own.points,
                "diagonal": own.diagonal,
                "uniform": None if own.uniform is None else own.uniform.parameters,
                "tensor": own.tensor(1.7),
                "box": own.box(axes),
                "inertias": [None if s.inertia is None else s.inertia.parameters for s in own.solids],
                "surfaces": [None if s.surface is None else s.surface.faces.shape for s in own.solids],
            }
    empty = solids.LinkSolids()
    found["empty"] = [empty.complete, empty.diagonal, empty.tensor(1.0), empty.points.shape]
    found["primitives"] = [
        None if part is None else [part[0].shape, part[1].parameters]
        for part in (
            solids._primitive_solid(kind, sizes)
            for kind, sizes in (
                ("box", (0.1, 0.2, 0.3)),
                ("sphere", (0.2,)),
                ("ellipsoid", (0.1, 0.2, 0.3)),
                ("cylinder", (0.1, 0.4)),
                ("capsule", (0.1, 0.4)),
                ("box", ()),
                ("plane", (1.0,)),
                ("sphere", (0.0,)),
                ("sphere", (-0.1,)),
                ("box", (1.0, 1.0, 1e6)),
                ("box", (1.0, 1.0, 1.1e6)),
            )
        )
    ]
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    found["hulls"] = [
        None if inertia is None else inertia.parameters
        for inertia in (
            solids.hull_solid(flat),
            solids.hull_solid(tetrahedron()[0]),
            solids.hull_solid(1e-9 * tetrahedron()[0]),
        )
    ]
    without_meshes = solids.SolidReader(None)
    found["no meshes"] = [
        without_meshes._hull("part.stl"),
        solids.SolidReader(meshes.MeshFiles(folder / "a"))._hull("none.stl"),
    ]
    return found


@records.of
def inertias_made_possible():
    tensor = np.array([[0.2, 0.01, 0.0], [0.01, 0.3, 0.02], [0.0, 0.02, 0.8]])
    reference = np.diag([0.3, 0.4, 0.35])
    fine = np.diag([0.3, 0.4, 0.35]) + 0.01
    return {
        "frobenius": solids.nearest(tensor),
        "fine": solids.nearest(fine),
        "entropic": solids.nearest(tensor, "entropic"),
        "entropic fine": solids.nearest(fine, "entropic"),
        "entropic reference": solids.nearest(tensor, "entropic", reference),
        "negative": [solids.nearest(-tensor, metric) for metric in solids.METRICS],
        "zero": solids.nearest(np.zeros((3, 3)), "entropic"),
        "metrics": solids.METRICS,
        "refused": refusal(lambda: solids.nearest(tensor, "euclid")),
    }


@records.of
def mesh_files_found(folder):
    package = folder / "share" / "arm_description"
    (package / "meshes").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>arm_description</name></package>")
    (package / "meshes" / "a.stl").write_bytes(stl(*tetrahedron()))
    (folder / "a.stl").write_bytes(stl(*tetrahedron(1.0)))
    (folder / "bad.stl").write_bytes(b"solid nothing\nendsolid")
    (folder / "a.txt").write_text("no mesh")
    urdf = folder / "arm.urdf"
    urdf.write_text("<robot/>")
    files = meshes.MeshFiles(urdf, [folder / "share", folder])
    alone = meshes.MeshFiles(None, [folder / "share" / "arm_description"])

    def place(mesh_files, name):
        path = mesh_files._find(name)
        return None if path is None else str(path.relative_to(folder))

    names = (
        "a.stl", "package://arm_description/meshes/a.stl", "package://other/meshes/a.stl", "package://x/../a.stl", "a.txt", "b.stl",
        "file://meshes/a.stl", "../a.stl",
    )  # fmt: skip
    first = files.read("a.stl")
    return {
        "places": {name: [place(files, name), place(alone, name)] for name in names},
        "read": [[part.vertices, colour] for part, colour in first],
        "again": files.read("a.stl") is first,
        "refused": [
            refusal(lambda: files.read("none.stl")),
            refusal(lambda: files.read("none.stl")),
            refusal(lambda: files.read("bad.stl")),
        ],
    }


# ── surfaces ──


def shown(s):
    return [s.vertices, s.faces.astype(float) if s.faces.size > 24 else s.faces]


@records.of
def surfaces_of_simple_shapes():
    found = {
        "box": shown(surface.box((0.2, 0.3, 0.5))),
        "sphere": shown(surface.sphere(0.3)),
        "ellipsoid": shown(surface.ellipsoid((0.1, 0.2, 0.3))),
        "cylinder": shown(surface.cylinder(0.1, 0.4)),
        "capsule": shown(surface.cylinder(0.1, 0.4, round_ends=True)),
        "revolved": shown(surface.revolved([(0, -0.1), (0.2, 0.0), (0.1, 0.3)])),
        "simple": [
            surface.SIMPLE[kind](*sizes).vertices.shape
            for kind, sizes in (("box", (1, 2, 3)), ("sphere", (1,)), ("capsule", (1, 2)))
        ],
    }
    s = surface.Surface(*tetrahedron())
    T = tw.se3.exp([0.2, -0.4, 0.3, 0.1, 0.5, -0.2])
    found["placed"] = shown(s.placed(T))
    found["scaled"] = [shown(s.scaled(scale)) for scale in ([1, 2, 3], [-1, 2, 3], [-1, -2, 3], 0.5)]
    found["normals"] = s.normals_of_faces()
    found["degenerate"] = surface.Surface(np.eye(3), np.array([[0, 0, 1], [0, 1, 2]])).normals_of_faces()
    found["joined"] = shown(surface.joined([s, s.placed(T), surface.box((1, 1, 1))]))
    found["slivers"] = shown(
        surface._without_slivers(
            surface.Surface(
                np.arange(18.0).reshape(6, 3),
                np.array([[0, 0, 1], [1, 2, 3], [3, 1, 2], [5, 1, 1], [2, 5, 2], [5, 3, 2]]),
            )
        )
    )
    found["creased"] = [
        shown(surface.box((0.2, 0.3, 0.5)).creased()),
        shown(surface.cylinder(0.1, 0.4).creased()),
        shown(s.creased()),
    ]
    bent = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    for angle in (37.0, 39.0):
        corners = bent.copy()
        corners[3] = [
            0.5 + 0.5 * np.cos(np.radians(angle)) * 1.0,
            0.5 + 0.5 * np.cos(np.radians(angle)),
            np.sin(np.radians(angle)) / np.sqrt(2),
        ]
        found[f"crease {angle}"] = surface.Surface(corners, np.array([[0, 1, 2], [1, 3, 2]])).creased().vertices.shape
    return found


def bumpy(n=9):
    """An open sheet with hills, of triangles of different sizes."""
    x, y = np.meshgrid(np.linspace(0, 1, n) ** 1.3, np.linspace(0, 0.7, n), indexing="ij")
    z = 0.1 * np.sin(5 * x + 0.3) * np.cos(4 * y) + 0.02 * x * y
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return surface.Surface(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces)


@records.of
def surfaces_with_fewer_faces():
    sheet = bumpy()
    round_one = surface.ellipsoid((0.1, 0.2, 0.3))
    bent = round_one.vertices + 0.05 * np.sin(7 * round_one.vertices[:, [1, 2, 0]] + [0.1, 0.4, 0.7])
    closed = surface.Surface(bent, round_one.faces)
    tangled = surface.Surface(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0], [0, -1, 0.2], [0.5, 0.1, 1], [2, 1, 0.3]]),
        np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 5, 2], [1, 4, 5]]),
    )
    a, b = np.array([0, 10, 20, 33]), np.array([1, 11, 29, 42])
    merged = surface.Surface(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1e-8, 0, 0], [1, 1, 0], [np.nan, 0, 0], [0, 0, 1.0], [1, 2e-6, 0]]),
        np.array([[0, 1, 2], [3, 4, 2], [5, 1, 2], [3, 1, 6], [7, 4, 2]]),
    )
    return {
        "sheet": [shown(sheet.decimated(k)) for k in (200, 60, 20)],
        "closed": [shown(closed.decimated(k)) for k in (300, 80)],
        "enough": sheet.decimated(128) is sheet,
        "one less": sheet.decimated(127).faces.shape,
        "tangled": shown(tangled.decimated(2)),
        "collapsed": shown(sheet._collapse_edges(3)),
        "errors": sheet._collapse_errors(a, b, 0.5 * (sheet.vertices[a] + sheet.vertices[b]) + [0, 0, 0.01]),
        "merged": shown(surface._merge_vertices(merged)),
        "nothing left": surface._merge_vertices(
            surface.Surface(np.full((3, 3), np.nan), np.array([[0, 1, 2]]))
        ).faces.shape,
        "large": _large().faces.shape,
        "too large to keep": _too_large().faces.shape,
        "numbers": [surface._MAX_FACES_OF_SOLID, surface._GRID_SHARE],
    }


@cache
def _large():
    return bumpy(20).decimated(300)


def _too_large():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(surface, "_MAX_FACES_OF_SOLID", 100)
        return bumpy(10).decimated(60)


@records.of
def meshes_read_by_colour(folder):
    corners, faces = tetrahedron()
    (folder / "one.stl").write_bytes(stl(corners, faces))
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    (folder / "two.obj").write_text("\n".join(lines) + "\n")
    (folder / "none.obj").write_text("v 0 0 0\n")
    return {
        "stl": [[shown(s), colour] for s, colour in surface.read_mesh(folder / "one.stl")],
        "obj": [[shown(s), colour] for s, colour in surface.read_mesh(folder / "two.obj")],
        "none": refusal(lambda: surface.read_mesh(folder / "none.obj")),
    }


@records.of
def long_tables_thinned():
    t = np.arange(300.0)
    table = np.column_stack([t, np.sin(0.13 * t) * t, np.cos(0.05 * t)])
    found = {}
    for most, parts in ((400, 1), (40, 1), (40, 7), (16, 3), (5, 2)):
        thinned = surface.Decimation(most, slice(1, 3))
        for part in np.array_split(table, parts):
            thinned.add(part)
        found[f"{most} in {parts}"] = [thinned.result()[:, 0], thinned.count, thinned._step, thinned._bin_size]
    empty = surface.Decimation(5, slice(0, 1))
    flat = surface.Decimation(6, slice(1, 2))
    flat.add(np.column_stack([t[:40], np.ones(40)]))
    found["none"] = empty.result().shape
    found["flat"] = flat.result()[:, 0]
    empty.add(np.zeros((0, 2)))
    found["no rows"] = empty.result().shape
    return found


# ── capsules ──

ARM = """<robot name="arm">{}<joint name="a" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0.05 0 0.2"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.7" velocity="2" effort="9"/></joint>
<joint name="b" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.4 0.05 0.02"/><axis xyz="0 1 0.2"/>
<limit lower="-2" upper="2.2" velocity="2" effort="9"/></joint><joint name="c" type="prismatic"><parent link="l2"/><child link="l3"/>
<origin xyz="0.3 -0.02 0.05"/><axis xyz="1 0.2 0"/><limit lower="0" upper="0.3" velocity="2" effort="9"/></joint>
<joint name="d" type="fixed"><parent link="l3"/><child link="tool"/><origin xyz="0.15 0.03 0"/></joint></robot>"""


def links(**shapes):
    texts = []
    for name, mass in (("base", 0), ("l1", 2.0), ("l2", 1.5), ("l3", 0.7), ("tool", 0)):
        inertial = (
            f'<inertial><origin xyz="0.1 0.02 {mass / 20}"/><mass value="{mass}"/><inertia ixx="0.1" iyy="0.11" izz="0.12" ixy="0"'
            ' ixz="0" iyz="0"/></inertial>'
            if mass
            else ""
        )
        texts.append(f'<link name="{name}">{inertial}{shapes.get(name, "")}</link>')
    return ARM.format("".join(texts))


def part(role, geometry, xyz="0 0 0", rpy="0 0 0"):
    return f'<{role}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></{role}>'


SHAPES = {
    "base": part("collision", '<box size="0.3 0.4 0.1"/>'),
    "l1": part("collision", '<cylinder radius="0.05" length="0.4"/>', "0.2 0 0", "0 1.57 0.1")
    + part("visual", '<sphere radius="1"/>'),
    "l2": part("visual", '<sphere radius="0.06"/>', "0.05 0 0")
    + part("visual", '<capsule radius="0.04" length="0.2"/>', "0.2 0 0", "0 1.4 0"),
    "l3": part("collision", '<box size="0.2 0.05 0.04"/>', "0.1 0 0")
    + part("collision", '<box size="0.21 0.05 0.04"/>', "0.11 0 0"),
}


ROUND = {
    "base": part("collision", '<sphere radius="0.15"/>', "0.02 0.05 0"),
    "l1": part("collision", '<capsule radius="0.05" length="0.35"/>', "0.2 0.03 0", "0 1.57 0.1"),
    "l2": SHAPES["l2"],
    "l3": part("collision", '<capsule radius="0.03" length="0.2"/>', "0.1 0.01 0", "0.1 1.4 0"),
}
"""Shapes that are capsules themselves, so that no search finds them."""


def cleaned(x):
    """Numbers of a search, to its accuracy: those near zero are zero."""
    return np.where(np.abs(x) < 2e-3, 0.0, x)


def robots_in(folder, shapes_of=SHAPES):
    some = {"l1": shapes_of["l1"], "l3": shapes_of["l3"]}
    found = {}
    for label, shapes in (("whole", shapes_of), ("some", some), ("none", {})):
        path = folder / f"{label}.urdf"
        path.write_text(links(**shapes))
        found[label] = tw.load(path)
    return found


@records.of(relative=4e-3)
def capsules_around_links(folder):
    found = {}
    for label, robot in robots_in(folder).items():
        around = capsules.LinkCapsules.from_robot(robot)
        q = robot.random_configuration(2, (2,))
        found[label] = {
            "links": around.links,
            "ends": cleaned(around.ends),
            "radii": around.radii,
            "assumed": [around.assumed, around.thickness, around.assumption],
            "pairs": around.separable_pairs(robot),
            "in the base": cleaned(around.ends_in_base(robot.link_poses(q))),
            "lacking": capsules.link_solids(robot)[1],
        }
    thin = tw.load(ARM.format("".join(f'<link name="{n}"/>' for n in ("base", "l1", "l2", "l3", "tool"))))
    found["no mass"] = capsules.link_solids(thin)[1]
    found["one"] = capsules.LinkCapsules(np.array([0]), np.zeros((1, 2, 3)), np.ones(1), ("l1",), 0.05).assumption
    pendulum = tw.robots.pendulum()
    bare = tw.load(
        '<robot name="p"><link name="a"/><link name="b"><inertial><origin xyz="0.1 0.2 -0.5"/><mass value="1"/><inertia ixx="1"'
        ' iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="continuous"><parent link="a"/><child'
        ' link="b"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/></joint></robot>'
    )
    diagonal = tw.load(
        links().replace("0.15 0.03 0", "0.1 0.1 0.1")  # a tool whose three coordinates are equal
    )
    assumed = capsules._assumed_capsules(diagonal, {2})
    found["diagonal tool"] = [[k, cleaned(ends), radius] for k, ends, radius in assumed]
    for label, robot in (("pendulum", pendulum), ("bob", bare)):
        assumed = capsules._assumed_capsules(robot, {0, -1})
        found[label] = [[k, cleaned(ends), radius] for k, ends, radius in assumed]
    return found


def boxes_apart(distance):
    """Two boxes side by side; a capsule around both holds more of what is not a link, the farther they are apart."""
    read = solids.SolidReader(None)
    places = np.eye(4), tw.se3.exp([0, 0, 0, 0, distance, 0])
    return [read._solid(reader.ShapeSpec("box", (0.4, 0.06, 0.09), place)) for place in places]


@records.of(relative=4e-3)
def capsules_around_points_and_solids(folder):
    rng = np.random.default_rng(1)
    cloud = rng.uniform(-1, 1, (40, 3)) * [0.5, 0.1, 0.2] + [0.3, 0.1, -0.2]
    ends, radius = capsules.capsule_around(cloud)
    files = files_in(folder)
    read = solids.SolidReader(meshes.MeshFiles(folder / "looks.urdf"))
    link = read.read(next(link for link in reader.read_shapes(files["looks.urdf"].model) if link.link == "arm"))
    one = capsules.capsule_around(np.tile([[0.1, 0.2, 0.3]], (3, 1)))
    return {
        "volume": capsules._volume(ends, radius),
        "holds": float(np.abs(radius).round(3)),
        "point": cleaned(np.append(one[0], one[1])),
        "volumes": [capsules._volume(np.array([[0, 0, 0], [0, 0, h]]), r) for h, r in ((0.5, 0.1), (0.0, 0.2))],
        "of solids": [[capsules._capsule_of(s)[1], capsules._facet_gap(s)] for s in link.solids],
        "spheres": [capsules._capsule_of(s)[0] for s in link.solids if s.shape.kind in ("sphere", "capsule")],
        "joined or not": [len(capsules._capsules_of(boxes_apart(d))) for d in (0.0, 0.03, 0.12, 0.2, 0.4)],
        "of one role": [s.shape.role for s in capsules._solids_of_one_role(link)],
        "of many": [[radius, capsules._volume(e, radius)] for e, radius in capsules._capsules_of(link.solids)],
        "visual alone": [
            s.shape.role
            for s in capsules._solids_of_one_role(
                solids.LinkSolids(link.shapes, tuple(s for s in link.solids if s.shape.role == "visual"))
            )
        ],
    }


@records.of
def nearest_points_of_segments():
    a = np.zeros((2, 3, 8))
    b = np.zeros((2, 3, 8))
    pairs = [
        ([[0, 0, 0], [1, 0, 0]], [[0.3, 1, 0.2], [0.7, -1, 0.4]]),
        ([[0, 0, 0], [1, 0, 0]], [[2, 1, 0], [3, 0.5, 0]]),
        ([[0, 0, 0], [1, 0, 0]], [[-2, 1, 0], [-1, 0.5, 0]]),
        ([[0, 0, 0], [1, 0.2, 0]], [[0.2, 1, 0], [1.2, 1.2, 0]]),
        ([[0, 0, 0], [1, 0, 0]], [[0.4, 0.5, 0], [0.4, 0.5, 0]]),
        ([[0.3, 0.1, 0], [0.3, 0.1, 0]], [[0, 1, 0], [1, 0.7, 0.1]]),
        ([[0.3, 0.1, 0], [0.3, 0.1, 0]], [[0, 1, 0], [0, 1, 0]]),
        ([[0, 0, 0], [2, 1, 0]], [[0.5, 2, 0], [0.6, 0.9, 0]]),
    ]
    for k, (first, second) in enumerate(pairs):
        a[:, :, k], b[:, :, k] = first, second
    return {"fractions": capsules.nearest_points(a, b), "swapped": capsules.nearest_points(b, a)}


@records.of
def distances_between_capsules(folder):
    found = {}
    for label, robot in robots_in(folder, ROUND).items():
        around = capsules.LinkCapsules.from_robot(robot)
        q = robot.random_configuration(5, (4,))
        for floor, itself in ((None, True), (0.12, True), (-0.3, False)):
            watched = capsules.CapsuleDistances.from_capsules(robot, around, floor=floor, itself=itself)
            distances, pullback = watched.evaluate(q)
            near, _ = watched.evaluate(q, near=0.2)
            weights = np.zeros_like(distances)
            weights[0] = 1.0 + np.arange(distances.shape[1])
            weights[2] = np.cos(np.arange(distances.shape[1]))
            found[f"{label} {floor} {itself}"] = {
                "pairs": watched.pairs,
                "above": watched.above,
                "margins": watched.margins,
                "unwatched": watched.unwatched,
                "count": watched.count,
                "distances": distances,
                "near": near,
                "forces": pullback(weights),
                "itself": [watched.itself, watched.floor],
            }
    return found


@records.of
def pairs_and_floors_that_are_always_near(folder):
    """A turntable low above the floor, with links so near each other that no motion parts them."""

    def own(radius, length, place):
        return part("collision", f'<capsule radius="{radius}" length="{length}"/>', place, "0 1.57 0")

    def link(name, shapes):
        return (
            f'<link name="{name}"><inertial><origin xyz="0.1 0 0.01"/><mass value="1"/><inertia ixx="0.1" iyy="0.11" izz="0.12" ixy="0"'
            f' ixz="0" iyz="0"/></inertial>{shapes}</link>'
        )

    def joint(name, parent, child, xyz, axis):
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/><axis'
            f' xyz="{axis}"/><limit lower="-1.1" upper="1.3" velocity="2" effort="9"/></joint>'
        )

    text = (
        '<robot name="table"><link name="base"/>'
        + link("low", own(0.03, 0.3, "0.2 0 0"))
        + link("mid", own(0.02, 0.02, "0 0 0.01"))
        + link("high", own(0.05, 0.1, "0.03 0 0.02"))
        + joint("a", "base", "low", "0 0 0.06", "0 0 1")
        + joint("b", "low", "mid", "0.3 0 0.05", "0 0 1")
        + joint("c", "mid", "high", "0.02 0 0.02", "0 1 0")
        + "</robot>"
    )
    path = folder / "table.urdf"
    path.write_text(text)
    robot = tw.load(path)
    around = capsules.LinkCapsules.from_robot(robot)
    found = {}
    for floor in (None, 0.0, 0.015, -0.1):
        watched = capsules.CapsuleDistances.from_capsules(robot, around, floor=floor, itself=True)
        found[str(floor)] = [watched.pairs, watched.above, watched.margins, watched.unwatched, watched.count]
    assumed = capsules.LinkCapsules(around.links, around.ends, around.radii, ("mid",), 0.05)
    watched = capsules.CapsuleDistances.from_capsules(robot, assumed, floor=0.0, itself=True)
    found["assumed"] = [watched.pairs, watched.above, watched.margins, watched.unwatched]
    thin = np.array([[0.0, 0, 0], [1e-3, 0, 0], [0.5, 0.4, 0.1], [0.5, -0.4, 0.1]])
    found["flat points"] = float(np.round(capsules._volume(*capsules.capsule_around(thin)), 2))
    return found


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
