"""Datasets of arms that learn, and makers' conventions: LeRobot's parquet, ALOHA's HDF5, sums of Fanuc's pendant."""

from __future__ import annotations

import json
import re
import shlex

import numpy as np
import pytest
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.motion import MotionLog

UR5 = tw.robots.path_of("ur5").read_text()
OWN = tw.robots.ur5().joint_names
MOTORS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
TIME = np.arange(150) * 0.02
Q = 0.4 * np.sin(np.outer(TIME, [1.0, 1.3, 1.7, 2.1, 2.6, 3.1]) + np.arange(6))


def named(names, robot="arm"):
    """The UR5 with other names of joints."""
    text = UR5
    for k, old in enumerate(OWN):
        text = text.replace(f'"{old}"', f'"#{k}#"')
    for k, new in enumerate(names):
        text = text.replace(f'"#{k}#"', f'"{new}"')
    return text.replace('<robot name="ur5"', f'<robot name="{robot}"')


def dataset(root, q, *, names=("a",), info=None, fixed=True, episodes=(0, 1)):
    """A LeRobot dataset of the same motion in every episode, and its file."""
    pytest.importorskip("pyarrow")
    import pyarrow
    import pyarrow.parquet

    kind = pyarrow.list_(pyarrow.float64(), q.shape[1]) if fixed else pyarrow.list_(pyarrow.float64())
    count = len(episodes)
    lists = pyarrow.array([row for _ in episodes for row in q.tolist()], kind)
    table = pyarrow.table(
        {
            "observation.state": lists,
            "action": lists,
            "timestamp": pyarrow.array(np.tile(TIME, count)),
            "frame_index": np.tile(np.arange(len(TIME)), count),
            "episode_index": np.repeat(episodes, len(TIME)),
            "index": np.arange(count * len(TIME)),
            "task_index": np.zeros(count * len(TIME), int),
        }
    )
    path = root / "data" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    pyarrow.parquet.write_table(table, path)
    if info is None:
        info = {
            "robot_type": "so101_follower",
            "features": {"observation.state": {"dtype": "float32", "names": list(names)}},
        }
    (root / "meta").mkdir()
    (root / "meta" / "info.json").write_text(info if isinstance(info, str) else json.dumps(info))
    return path


def run(*arguments):
    result = CliRunner().invoke(main, [*map(str, arguments)])
    return result.exit_code, " ".join(result.output.split())


def torques_of(path, names):
    table = np.genfromtxt(path, delimiter=",", names=True, deletechars="")
    return np.column_stack([table[f"{name}.torque"] for name in names])


@pytest.mark.parametrize("fixed", [True, False])
def test_an_episode_of_a_dataset_in_degrees_is_understood_and_its_zero_doubted(fixed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "so.urdf").write_text(named(MOTORS))
    q = np.column_stack([np.degrees(Q[:, :5]), 50 + 40 * np.sin(TIME)])
    path = dataset(tmp_path, q, names=[f"{name}.pos" for name in MOTORS], fixed=fixed)
    command = ["torques", "so.urdf", "--trajectory", path, "--csv", "out.csv"]
    code, said = run(*command)
    assert code == 2 and "has several episodes: 0 to 1. Choose one: --episode 0" in said
    command += ["--episode", "1"]
    code, said = run(*command)
    assert code == 2 and "If these are degrees, add: --degrees" in said
    command += ["--degrees"]
    code, said = run(*command)
    assert code == 2 and "Hold it still: --lock gripper=0" in said
    command += ["--lock", "gripper=0"]
    code, said = run(*command)
    assert code == 1, said
    assert said.startswith("UNSURE") or "UNSURE: " in said
    assert "count from the middle of each motor's calibrated range" in said
    assert run("log", path)[0] == 2 and run("log", path, "--episode", "1")[0] == 0
    robot = tw.load(named(MOTORS)).lock({"gripper": 0.0})
    expected = tw.Motion(TIME, Q[:, :5], robot=robot).torques()
    assert np.abs(torques_of("out.csv", MOTORS[:5]) - expected).max() < 1e-9 * np.abs(expected).max()


def test_a_dataset_in_radians_by_its_metadata_needs_no_word(tmp_path):
    info = {"features": {"observation.state": {"dtype": "float32", "names": list(MOTORS), "unit": "radians"}}}
    motion = tw.Motion.from_file(dataset(tmp_path, Q, info=info, episodes=(3,)), tw.load(named(MOTORS)))
    assert np.abs(motion.q - Q).max() < 1e-12 and motion.doubts == ()


def test_a_dataset_that_uses_degrees_by_its_metadata_is_in_degrees(tmp_path):
    """LeRobot's configuration of a robot has ``use_degrees``."""
    info = {"use_degrees": True, "features": {"observation.state": {"dtype": "float32", "names": list(MOTORS)}}}
    path = dataset(tmp_path, np.degrees(Q), info=info, episodes=(0,))
    motion = tw.Motion.from_file(path, tw.load(named(MOTORS)).lock({"gripper": 0.0}))
    assert np.abs(motion.q - Q[:, :5]).max() < 1e-12


def test_positions_of_a_dataset_without_a_unit_are_never_read_as_radians_without_a_word(tmp_path):
    """Degrees may stay within 2π: UNSURE where LeRobot's own motors record degrees, else a note."""
    for folder, names, level in (("so", MOTORS, "unsure"), ("other", [f"joint_{k}" for k in range(1, 7)], "note")):
        (tmp_path / folder).mkdir()
        path = dataset(tmp_path / folder, np.degrees(0.05 * Q), names=names, episodes=(0,))
        motion = tw.Motion.from_file(path, tw.load(named(names)))
        assert [(one.kind, one.level) for one in motion.doubts] == [("dataset-unit", level)]
        assert any("state no unit" in note and "degrees=True" in note for note in motion.notes)


def test_motors_named_in_a_group_and_units_of_the_metadata_are_read(tmp_path):
    feature = {"dtype": "float32", "names": {"motors": [f"main_{name}" for name in MOTORS]}, "unit": "degrees"}
    path = dataset(tmp_path, np.degrees(Q), info={"features": {"observation.state": feature}}, episodes=(0,))
    log = MotionLog.open(path, tw.load(named(MOTORS)).lock({"gripper": 0.0}).model)
    assert np.abs(log.motion(log.table).q - Q[:, :5]).max() < 1e-12
    assert "a common prefix aside: observation.state.main_shoulder_pan.pos is shoulder_pan" in " ".join(log.notes)


def test_a_list_without_names_is_taken_in_its_order(tmp_path):
    path = dataset(tmp_path, Q, info={"features": {}}, episodes=(0,))
    motion = tw.Motion.from_file(path, tw.load(named([f"joint_{k}" for k in range(1, 7)])))
    assert np.abs(motion.q - Q).max() < 1e-12 and "are taken in their order" in " ".join(motion.notes)


BAD_DATASETS = {
    "no such episode": (lambda root: dataset(root, Q, names=MOTORS), {"episode": 7}, "has no episode 7: 0 to 1"),
    "a range": (
        lambda root: dataset(
            root, 90 * Q, info={"norm": "range_m100_100", "features": {"observation.state": {"names": MOTORS}}}, episodes=(0,)
        ),
        {"degrees": True},
        "only its calibration file maps them to angles",
    ),
    "no metadata": (lambda root: dataset(root, Q, info="{"), {"episode": 0}, "is not the metadata of a LeRobot dataset"),
    "metadata of something else": (lambda root: dataset(root, Q, info=[1]), {"episode": 0}, "is not the metadata"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_DATASETS)
def test_bad_datasets_are_one_error(case, tmp_path):
    write, options, said = BAD_DATASETS[case]
    with pytest.raises(tw.TrajectoryError, match=re.escape(said)):
        log = MotionLog.open(write(tmp_path), tw.load(named(MOTORS)).model, **options)
        log.table  # noqa: B018


def test_lists_of_several_lengths_and_episodes_of_other_files_are_errors(tmp_path, monkeypatch):
    monkeypatch.setenv("TWISTWRENCH_SANDBOX", "0")  # rows per portion are those of this process
    monkeypatch.setattr("twistwrench.motion.log_table.ROWS", 16)
    pytest.importorskip("pyarrow")
    import pyarrow
    import pyarrow.parquet

    rows = Q.tolist()
    rows[30] = rows[30][:3]
    path = tmp_path / "log.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"timestamp": TIME, "state": rows}), path)
    model = tw.load(named([f"joint_{k}" for k in range(1, 7)])).model
    with pytest.raises(tw.TrajectoryError, match=r"row 31 of 'state' is not a list of 6 numbers"):
        log = MotionLog.open(path, model, columns={f"joint_{k}": f"state{k}" for k in range(1, 7)})
        log.table  # noqa: B018
    with pytest.raises(tw.TrajectoryError, match=r"episode=… is for datasets"):
        MotionLog.open(path, model, episode=0)
    (tmp_path / "log.csv").write_text("time,joint_1\n0,0\n")
    with pytest.raises(tw.TrajectoryError, match=r"episode=… is for LeRobot datasets"):
        MotionLog.open(tmp_path / "log.csv", model, episode=0)


def test_aloha_needs_its_rate_and_is_read_with_it(tmp_path, monkeypatch):
    """Two arms of seven: here 14 columns of one robot, as two UR5 and two grippers would be."""
    h5py = pytest.importorskip("h5py")
    monkeypatch.chdir(tmp_path)
    with h5py.File("episode_0.hdf5", "w") as file:
        file["observations/qpos"], file["observations/qvel"], file["action"] = Q, np.gradient(Q, 0.02, axis=0), Q + 0.1
        file["observations/effort"] = 0 * Q + TIME[:, None]
        file["observations/images/top"] = np.zeros((len(TIME), 4, 4, 3), np.uint8)
    code, said = run("torques", "ur5", "--trajectory", "episode_0.hdf5")
    assert code == 2 and "--rate HZ (ALOHA records 50)" in said
    motion = tw.Motion.from_file("episode_0.hdf5", tw.robots.ur5(), rate=50.0)
    assert (motion.q == Q).all() and (motion.tau == TIME[:, None]).all() and motion.dq.shape == Q.shape


# ── Fanuc's pendant


def test_fanuc_s_third_column_is_doubted_and_a_sum_reads_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [f"joint_{k}" for k in range(1, 7)]
    (tmp_path / "arm.urdf").write_text(named(names, "fanuc_m10ia"))
    pendant = np.degrees(Q)
    pendant[:, 2] -= pendant[:, 1]  # J3 = joint_3 - J2, so joint_3 = J3 + J2
    np.savetxt("log.csv", np.column_stack([TIME, pendant]), delimiter=",", comments="", header="time,J1,J2,J3,J4,J5,J6")
    command = ["torques", "arm.urdf", "--trajectory", "log.csv", "--degrees", "--csv", "out.csv", "--overwrite"]
    code, said = run(*command)
    assert code == 1 and "J3 on Fanuc's pendant includes J2" in said
    option = "--columns 'J1,J2,J3+J2,J4,J5,J6'"
    code, said = run(*command, *shlex.split(option))
    assert code in (0, 1) and "pendant" not in said, said
    expected = tw.Motion(TIME, Q, robot=tw.robots.ur5()).torques()
    assert np.abs(torques_of("out.csv", names) - expected).max() < 1e-9 * np.abs(expected).max()


def test_sums_take_signs_and_units_and_refuse_several(tmp_path):
    path = tmp_path / "log.csv"
    np.savetxt(
        path, np.column_stack([TIME, np.degrees(Q[:, :2])]), delimiter=",", comments="", header="time,a [deg],b [deg]"
    )
    arm = tw.robots.planar_2r()
    motion = tw.Motion.from_file(path, arm, columns={"joint1": "a", "joint2": "b-a"})
    assert np.abs(motion.q - np.column_stack([Q[:, 0], Q[:, 1] - Q[:, 0]])).max() < 1e-12
    path.write_text(path.read_text().replace("b [deg]", "b [rad]"))
    with pytest.raises(tw.TrajectoryError, match="have several units"):
        MotionLog.open(path, arm.model, columns={"joint1": "a", "joint2": "b-a"})
    with pytest.raises(tw.TrajectoryError, match=r"no column 'c\+a'"):
        MotionLog.open(path, arm.model, columns={"joint1": "a", "joint2": "c+a"})


def test_a_sum_of_columns_of_a_dataset_keeps_its_unit(tmp_path):
    names = [f"joint_{k}" for k in range(1, 7)]
    feature = {"dtype": "float32", "names": names, "unit": "degrees"}
    path = dataset(tmp_path, np.degrees(Q), info={"features": {"observation.state": feature}}, episodes=(0,))
    own = [f"observation.state.{name}.pos" for name in names]
    columns = dict(zip(names, [*own[:2], f"{own[2]}+{own[1]}", *own[3:]], strict=True))
    motion = tw.Motion.from_file(path, tw.load(named(names)), columns=columns)
    expected = np.column_stack([Q[:, :2], Q[:, 2] + Q[:, 1], Q[:, 3:]])
    assert np.abs(motion.q - expected).max() < 1e-12
