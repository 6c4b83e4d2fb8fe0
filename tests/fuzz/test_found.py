"""Files that failed once, as small as they can be: each ends in one error, and quickly."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import twistwrench as tw
from twistwrench.motion.matching import rising_columns, varying_columns
from twistwrench.trajectories import spline

from . import robot_seeds

ARM = tw.robots.planar_2r()


def test_a_mesh_with_a_face_of_a_vertex_that_is_not_there(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    from twistwrench.shapes.surface import read_mesh

    content = json.loads(robot_seeds.gltf())
    content["accessors"][0]["count"] = 2
    path = tmp_path / "mesh.gltf"
    path.write_text(json.dumps(content))
    with pytest.raises(tw.ModelError, match="has a face of vertex 3, and 2 vertices"):
        read_mesh(path)
    with pytest.raises(tw.ModelError, match="has a face of vertex 3, and 2 vertices"):
        tw.SpatialInertia.mesh(path, density=1000.0)


@pytest.mark.parametrize("far", [1e30, 1e308])
def test_waypoints_too_close_for_the_digits_of_their_path(far: float) -> None:
    with pytest.raises(tw.ValueRangeError, match="too close for its digits"):
        spline(ARM, [[0, 0], [far, 0], [-far, 0], [0, 0], [1, 0]])


def test_each_column_of_a_header_is_looked_at_once() -> None:
    """A log has hundreds of columns."""
    looked = []

    def look(column: int) -> np.ndarray:
        looked.append(column)
        return np.arange(3.0)

    names = [f"c{k}" for k in range(200)]
    assert varying_columns(names, names, look) == names
    assert looked == [*range(200)]


def test_a_header_of_hundreds_of_columns_is_refused_after_one_look_at_each(tmp_path: Path, monkeypatch) -> None:
    from twistwrench.motion.readers.csv_reader import CsvFile

    looks, first = [], CsvFile.first
    monkeypatch.setattr(CsvFile, "first", lambda file, column: looks.append(column) or first(file, column))
    path = tmp_path / "log.csv"
    np.savetxt(
        path,
        np.outer(np.arange(4.0), np.arange(1, 101)),
        delimiter=",",
        header=",".join(f"c{k} x" for k in range(100)),
        comments="",
    )
    with pytest.raises(tw.TrajectoryError, match="no column for joint1, joint2"):
        tw.Motion.from_file(path, ARM)
    assert len(looks) <= 300


def test_names_with_tabs_and_line_ends_are_listed_on_one_line(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    np.savez(path, **{"a\tb\nc": np.array(["x"])})
    with pytest.raises(tw.TrajectoryError, match=r"Found: a\\tb\\nc\.$"):
        tw.Motion.from_file(path, ARM)


def test_every_error_is_of_bounded_length_and_visible() -> None:
    found = str(tw.ModelError(f"link {'a' * 9000!r} and \x1b[2J" + ", more" * 1000))
    assert len(found) <= 1001 and "\x1b" not in found and found.endswith("…")


@pytest.mark.parametrize("size", [0, 3, 15, 17])
def test_a_mesh_of_mujoco_without_its_counts(size: int, tmp_path: Path) -> None:
    (tmp_path / "x.msh").write_bytes(bytes(size))
    path = tmp_path / "robot.xml"
    path.write_text(
        '<mujoco><asset><mesh name="m" file="x.msh"/></asset><worldbody><body><joint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    with pytest.raises(tw.RobotFileError, match="is not a mesh of MuJoCo's"):
        tw.load(path)


@pytest.mark.parametrize("find", ["varying", "rising"])
def test_of_thousands_of_columns_a_bounded_number_is_looked_at(find):
    """Each look at a column of a foreign format asks another process, and a file may have thousands of columns."""
    names, looks = [f"c{chr(97 + k % 26)}_{k}" for k in range(5000)], []

    def look(k):
        looks.append(k)
        return np.array([0.0, 0.1, 0.3])

    found = varying_columns(names, names, look) if find == "varying" else rising_columns(dict(enumerate(names)), look)
    assert 200 < len(found) == len(looks) < 300
