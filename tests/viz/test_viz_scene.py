"""What is drawn of a robot: the surfaces its file gives, in their places, and shapes made from its numbers elsewhere."""

from __future__ import annotations

import pickle
import struct
import warnings

import numpy as np
import pytest
from robot_files import FILES

import twistwrench as tw
from twistwrench.formats.source import find_resource
from twistwrench.mechanics.lie import se3
from twistwrench.mechanics.model.model import BASE
from twistwrench.shapes.surface import Surface, box, cylinder, ellipsoid, joined, sphere
from twistwrench.shapes.visuals import read_visuals
from twistwrench.viz.scene import equal_inertia_ellipsoid, scene_of, turned_z

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

INERTIA = '<inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
BOX = '<visual><origin xyz="0.1 0.2 0.3" rpy="0.4 0 0"/><geometry><box size="0.2 0.4 0.6"/></geometry></visual>'


def arm(visual: str, base: str = "", rest: str = "") -> str:
    return (
        f'<robot name="arm"><link name="base">{base}</link><link name="rod">{INERTIA}{visual}</link>{rest}'
        '<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="10" velocity="1"/></joint></robot>'
    )


def written(tmp_path, text, name="arm.urdf"):
    path = tmp_path / name
    path.write_text(text)
    return tw.load(path)


def corners(scene, q, layer="looks"):
    poses = scene.body_poses(q)
    found = []
    for shape in scene.shapes:
        if shape.layer == layer:
            T = shape.pose if shape.body == BASE else poses[shape.body] @ shape.pose
            found.append(shape.surface.placed(T).vertices)
    return np.concatenate(found)


def stl(path, triangles):
    """A binary STL file."""
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(t), 0) for t in triangles)
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + body)


def test_shapes_are_where_link_poses_and_their_origins_put_them(tmp_path):
    robot = written(tmp_path, arm(BOX, base='<visual><geometry><sphere radius="0.1"/></geometry></visual>'))
    scene = scene_of(robot)
    q = [0.7]
    T = robot.link_poses(q)[robot.link_names.index("rod")] @ se3.pose(tw.so3.exp([0.4, 0, 0]), [0.1, 0.2, 0.3])
    expected = box((0.2, 0.4, 0.6)).placed(T).vertices
    drawn = [s for s in scene.shapes if s.layer == "looks"]
    assert len(drawn) == 2
    (rod,) = (s for s in drawn if s.body == 0)
    found = rod.surface.placed(scene.body_poses(q)[0] @ rod.pose).vertices
    np.testing.assert_allclose(np.sort(found, axis=0), np.sort(expected, axis=0), atol=1e-12)


@pytest.mark.parametrize("name", ["ur5", "quadruped", "cart_pole"])
def test_body_poses_are_those_of_their_links(bundled, name):
    robot = bundled(name)
    q = robot.random_configuration(1, 5)
    poses, links = scene_of(robot).body_poses(q), robot.link_poses(q)
    for k, body in enumerate(robot.model.bodies):
        np.testing.assert_array_equal(poses[:, k], links[:, robot.link_names.index(body.link)])


def test_links_fused_with_others_keep_their_looks(tmp_path):
    tool = f'<link name="tool">{BOX}</link><joint name="flange" type="fixed"><parent link="rod"/><child link="tool"/><origin xyz="0 0 0.5"/></joint>'
    robot = written(tmp_path, arm("", rest=tool))
    T = robot.forward_kinematics([0.3], "tool") @ se3.pose(tw.so3.exp([0.4, 0, 0]), [0.1, 0.2, 0.3])
    scene = scene_of(robot)
    (shape,) = (s for s in scene.shapes if s.layer == "looks" and s.body == 0)
    found = shape.surface.placed(scene.body_poses([0.3])[0] @ shape.pose).vertices
    np.testing.assert_allclose(
        np.sort(found, axis=0), np.sort(box((0.2, 0.4, 0.6)).placed(T).vertices, axis=0), atol=1e-12
    )


@pytest.mark.parametrize(
    "uri",
    [
        "meshes/part.stl",
        "package://my_arm/meshes/part.stl",
        "model://my_arm/meshes/part.stl",
        "file://{}/my_arm/meshes/part.stl",
    ],
)
def test_meshes_are_found_and_scaled(tmp_path, uri):
    pytest.importorskip("trimesh")
    folder = tmp_path / "my_arm"
    (folder / "meshes").mkdir(parents=True)
    s = box((2.0, 4.0, 6.0))
    stl(folder / "meshes" / "part.stl", s.vertices[s.faces])
    mesh = f'<visual><geometry><mesh filename="{uri.format(tmp_path)}" scale="0.1 0.1 -0.1"/></geometry></visual>'
    robot = written(folder, arm(mesh))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = scene_of(robot)
    assert scene.dressed
    (shape,) = (s for s in scene.shapes if s.layer == "looks" and s.body == 0)
    assert len(shape.surface.faces) == 12
    assert len(shape.surface.vertices) == 8  # though the file has each corner in every triangle
    np.testing.assert_allclose(np.ptp(shape.surface.vertices, axis=0), [0.2, 0.4, 0.6], rtol=1e-6)
    assert (
        tw.SpatialInertia.mesh((shape.surface.vertices, shape.surface.faces), mass=1.0).mass == 1.0
    )  # mirrored, still closed


def test_packages_are_looked_for_where_ros_does(tmp_path, monkeypatch):
    for variable, place in (("ROS_PACKAGE_PATH", tmp_path / "a"), ("AMENT_PREFIX_PATH", tmp_path / "b")):
        folder = place / ("share" if variable.startswith("AMENT") else "") / variable.lower()
        folder.mkdir(parents=True)
        (folder / "x.stl").touch()
        uri = f"package://{variable.lower()}/x.stl"
        assert find_resource(uri, tmp_path / "c" / "arm.urdf") is None
        monkeypatch.setenv(variable, str(place))
        assert find_resource(uri, tmp_path / "c" / "arm.urdf") == folder / "x.stl"


@pytest.mark.parametrize(
    "uri", ["http://127.0.0.1:9/x.stl", "https://example.org/x.stl", "ftp://x/y", "", "package://", "\0", "x" * 5000]
)
def test_nothing_is_fetched_and_no_name_is_too_odd(tmp_path, uri):
    assert find_resource(uri, tmp_path / "arm.urdf") is None


def test_a_missing_mesh_is_said_once_and_the_body_is_drawn_from_its_numbers(tmp_path):
    mesh = '<visual><geometry><mesh filename="package://nowhere/rod.stl"/></geometry></visual>'
    robot = written(tmp_path, arm(3 * mesh, base=mesh))
    with pytest.warns(
        tw.ModelWarning, match=r"1 of 1 meshes cannot be drawn, for example package://nowhere/rod.stl"
    ) as told:
        scene = scene_of(robot)
    assert len(told) == 1
    assert not scene.dressed
    assert {s.body for s in scene.shapes if s.layer == "looks"} == {BASE, 0}


@pytest.mark.parametrize(
    "damage", [b"", b"solid nothing\nendsolid", bytes(80) + b"\xff\xff\xff\xff" + bytes(100), b"\x00" * 200]
)
def test_a_damaged_mesh_is_a_remark_and_no_error(tmp_path, damage):
    pytest.importorskip("trimesh")
    (tmp_path / "rod.stl").write_bytes(damage)
    robot = written(tmp_path, arm('<visual><geometry><mesh filename="rod.stl"/></geometry></visual>'))
    with pytest.warns(tw.ModelWarning, match="1 of 1 meshes cannot be drawn"):
        scene = scene_of(robot)
    assert np.isfinite(corners(scene, [0.0])).all()


@pytest.mark.parametrize(
    "visual",
    [
        "<visual/>",
        "<visual><geometry/></visual>",
        '<visual><geometry><box size="1 2"/></geometry></visual>',
        '<visual><geometry><box size="1 nan 2"/></geometry></visual>',
        '<visual><geometry><cone radius="1"/></geometry></visual>',
        '<visual><origin xyz="a b c"/><geometry><sphere radius="1"/></geometry></visual>',
        "<visual><geometry><mesh/></geometry></visual>",
    ],
)
def test_looks_that_cannot_be_read_never_stop_a_robot_from_being_shown(tmp_path, visual):
    robot = written(tmp_path, arm(visual))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        scene = scene_of(robot)
    assert {s.body for s in scene.shapes if s.layer == "looks"} == {BASE, 0}


def test_colours_are_the_materials(tmp_path):
    text = arm('<visual><geometry><sphere radius="1"/></geometry><material name="red"/></visual>')
    robot = written(
        tmp_path, text.replace("<link", '<material name="red"><color rgba="1 0 0.5 1"/></material><link', 1)
    )
    (visual,) = read_visuals(robot.model)[0]
    assert visual.colour == (1.0, 0.0, 0.5)


def test_a_file_that_is_gone_leaves_the_numbers(tmp_path):
    robot = written(tmp_path, arm(BOX))
    of_another_process = pickle.dumps(robot)
    (tmp_path / "arm.urdf").unlink()
    assert scene_of(robot).dressed  # by what was read when it was loaded
    assert not scene_of(pickle.loads(of_another_process)).dressed
    (tmp_path / "arm.urdf").write_text("<robot")
    with pytest.warns(tw.ModelWarning, match="cannot be read again"):
        assert not scene_of(pickle.loads(of_another_process)).dressed


def test_robots_without_a_file_are_drawn(bundled):
    screws = bundled("ur5").screws
    robot = tw.from_screws(screws.M, screws.Slist, screws.Mlist, screws.Glist)
    assert {s.body for s in scene_of(robot).shapes if s.layer == "looks"} == {BASE, *range(6)}


SLIDES = """<robot name="slides"><link name="base"/>{}<joint name="lead" type="prismatic"><parent link="base"/><child link="a"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
<joint name="follow" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="5" velocity="1"/><mimic joint="lead" multiplier="0.25"/></joint></robot>"""


def test_the_rail_of_a_slide_that_follows_is_as_long_as_it_goes():
    """A quarter of a metre to both sides, where its leader goes a metre."""
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    robot = tw.load(SLIDES.format("".join(f'<link name="{name}">{mass}</link>' for name in "ab")))
    shapes = [s for s in scene_of(robot).shapes if s.layer == "looks" and s.body == 0]
    x = np.concatenate([s.surface.placed(s.pose).vertices for s in shapes])[:, 0]
    assert 0.25 <= x.max() < 0.35  # and the thickness of the rail
    assert -0.35 < x.min() <= -0.25


def test_the_ellipsoid_has_the_inertia_of_its_body():
    G = tw.SpatialInertia.box((0.5, 0.3, 0.2), mass=2.0).in_frame(tw.se3.exp([0.3, 0.2, 0.1, 1, 2, 3]))
    (surface,) = equal_inertia_ellipsoid(G)
    fine = tw.SpatialInertia.mesh((surface.vertices, surface.faces), mass=2.0)
    np.testing.assert_allclose(fine.com, G.com, atol=1e-9)
    # of facets inside the smooth ellipsoid: 32 around and 14 up make it some percent smaller
    np.testing.assert_allclose(fine.moment_about_com, G.moment_about_com, atol=0.05 * G.moment_about_com.max())


def test_points_and_nothing_have_shapes_too():
    assert equal_inertia_ellipsoid(tw.SpatialInertia.from_com(0.0)) == []
    (point,) = equal_inertia_ellipsoid(tw.SpatialInertia.from_com(7850.0 * 4 / 3 * np.pi, (1, 2, 3)))
    np.testing.assert_allclose(
        [point.vertices.min(axis=0), point.vertices.max(axis=0)], [[0, 1, 2], [2, 3, 4]], atol=0.02
    )


def test_a_payload_is_drawn_at_its_place(bundled):
    robot = bundled("planar_2r").with_payload(tw.SpatialInertia.from_com(2.0, (0.1, 0, 0)))
    (ball,) = (s for s in scene_of(robot).shapes if s.colour == (0.84, 0.37, 0.0))
    at = robot.forward_kinematics([0.4, 0.5]) @ [0.1, 0, 0, 1]
    found = ball.surface.placed(scene_of(robot).body_poses([0.4, 0.5])[ball.body] @ ball.pose).vertices
    np.testing.assert_allclose((found.min(axis=0) + found.max(axis=0)) / 2, at[:3], atol=1e-9)


SOLIDS = {
    "box": (box((1, 2, 3)), 6.0, 0.0),
    "sphere": (sphere(0.5), np.pi / 6, 0.05),
    "cylinder": (cylinder(1.0, 2.0), 2 * np.pi, 0.02),
    "capsule": (cylinder(1.0, 2.0, round_ends=True), 2 * np.pi + 4 / 3 * np.pi, 0.03),
    "ellipsoid": (ellipsoid((1, 2, 3)), 8 * np.pi, 0.05),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_of_their_volume(name):
    surface, volume, missing = SOLIDS[name]
    G = tw.SpatialInertia.mesh((surface.vertices, surface.faces), density=1.0)  # refuses what is not closed
    assert (1 - missing) * volume - 1e-9 <= G.mass <= volume + 1e-9
    outward = np.einsum("ij,ij->i", surface.normals_of_faces(), surface.vertices[surface.faces].mean(axis=1))
    assert (outward > 0).all()


def test_sharp_edges_stay_sharp_and_round_ones_round():
    assert len(box((1, 1, 1)).creased().vertices) == 24
    ball = sphere(1.0)
    assert len(ball.creased().vertices) == len(ball.vertices)
    whole = joined([box((1, 1, 1)), ball]).creased()
    assert len(whole.vertices) == 24 + len(ball.vertices)
    before, after = (
        np.sort(s.vertices[s.faces].reshape(-1, 9), axis=0) for s in (joined([box((1, 1, 1)), ball]), whole)
    )
    np.testing.assert_array_equal(before, after)


def test_thinned_surfaces_keep_their_shape():
    many = ellipsoid((1.0, 0.5, 0.3))
    for most in (600, 300):
        few = many.decimated(most)
        assert len(few.faces) <= most
        assert abs(np.ptp(few.vertices, axis=0) - [2.0, 1.0, 0.6]).max() < 0.25
    assert many.decimated(10_000) is many


def test_thinned_flat_faces_keep_the_edges_and_the_volume_of_a_box():
    """Ten by ten squares on each side: what lies in a plane goes first, wherever the box stands."""
    ticks, turn = np.linspace(-0.5, 0.5, 11), se3.pose(tw.so3.exp([0.3, -0.5, 0.7]), [3.0, -2.0, 1.0])
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    squares = np.stack([corner, corner + 11, corner + 12, corner, corner + 12, corner + 1], axis=1).reshape(-1, 3)
    u, v = (x.ravel() for x in np.meshgrid(ticks, ticks, indexing="ij"))
    sides = []
    for axis in range(3):
        for sign in (-1, 1):
            flat = np.roll(np.column_stack([u, v, np.full(121, 0.5 * sign)]), axis + 1, axis=1)
            sides.append(Surface(flat, squares[:, ::sign]))
    whole = joined(sides).scaled((0.1, 0.05, 0.2)).placed(turn)
    grid, at = np.unique(whole.vertices.round(9), axis=0, return_inverse=True)
    few = Surface(grid, at.ravel()[whole.faces]).decimated(300)
    assert len(few.faces) <= 300
    np.testing.assert_allclose(tw.SpatialInertia.mesh((few.vertices, few.faces), density=1e3).mass, 1.0, rtol=1e-5)


def edges_by_faces(surface):
    """How many edges have one face, two, and more."""
    sides = np.sort(
        np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]]), axis=1
    )
    counts = np.unique(sides, axis=0, return_counts=True)[1]
    return [(counts == 1).sum(), (counts == 2).sum(), (counts > 2).sum()]


def test_thinning_makes_no_edge_of_more_than_two_faces():
    """A thin wall, whose sides a grid would join: two ellipsoids, one just within the other, and three balls in a row."""
    balls = [sphere(0.1).placed(tw.se3.pose(np.eye(3), [x, 0.0, 0.0])) for x in (2.0, 2.2, 2.4)]
    shells = joined([ellipsoid((1.0, 0.5, 0.3)), ellipsoid((0.99, 0.49, 0.29)), *balls])
    thin = shells.decimated(len(shells.faces) // 3)
    assert len(thin.faces) <= len(shells.faces) // 3
    assert edges_by_faces(thin)[::2] == edges_by_faces(shells)[::2] == [0, 0]
    assert tw.SpatialInertia.mesh((thin.vertices, thin.faces), density=1.0).mass > 0


def test_turned_z_is_a_rotation_onto_the_direction():
    for d in np.random.default_rng(0).normal(size=(20, 3)):
        R = turned_z(d)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(R[:, 2], d / np.linalg.norm(d), atol=1e-15)


def test_impossible_inertias_are_told(bundled):
    """The UR5 file of ROS gave its wrists of 1.2 kg moments that only a disc as large as the robot has."""
    assert scene_of(bundled("ur5")).doubtful == ()
    text = tw.robots.path_of("ur5").read_text()
    for ours, once in (("0.0025599", "0.111172755531"), ("0.0021942", "0.21942"), ("0.00039459", "0.0171364731454"),
                       ("0.00033822", "0.033822")):  # fmt: skip
        text = text.replace(f'"{ours}"', f'"{once}"')
    scene = scene_of(tw.load(text))
    assert scene.doubtful == ("wrist_1_link", "wrist_2_link", "wrist_3_link")
    assert "wrist_1_link" in scene.notes[-1]
    assert scene_of(bundled("quadruped")).doubtful == ()


def real():
    wanted = (
        "panda_description/urdf/panda.urdf",
        "ur_description/urdf/ur5_robot.urdf",
        "talos_data/robots/talos_reduced.urdf",
    )
    return [p for p in FILES.values() if str(p).endswith(wanted)] or [
        pytest.param(None, marks=pytest.mark.skip("no example-robot-data"))
    ]


@pytest.mark.slow
@pytest.mark.parametrize("path", real(), ids=str)
def test_real_robots_are_dressed_and_thin_down(path):
    pytest.importorskip("trimesh")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tw.ModelWarning)
        robot = tw.load(path)
        pytest.importorskip("collada", reason="needs the extra viz") if "talos" not in str(path) else None
        scene = scene_of(robot)
    assert scene.dressed
    assert not scene.remarks
    bounds = scene.bounds(robot.neutral)
    origins = scene.body_poses(robot.neutral)[:, :3, 3]
    assert (origins > bounds[0] - 0.05).all()
    assert (origins < bounds[1] + 0.05).all()
    thin = scene.decimated(20_000)
    assert sum(len(s.surface.faces) for s in thin.shapes if s.layer == "looks") <= 30_000
    tangled = [sum(edges_by_faces(s.surface)[2] for s in each.shapes if s.layer == "looks") for each in (scene, thin)]
    assert tangled[1] <= tangled[0]
    np.testing.assert_allclose(thin.bounds(robot.neutral), bounds, atol=0.03)
