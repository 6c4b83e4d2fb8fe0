"""A robot whose file an earlier process has read: the same numbers to the bit, the same warnings, and never another robot."""

from __future__ import annotations

import inspect
import os
import shutil
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from quick import mostly_slow

import twistwrench as tw
from twistwrench.mechanics.model.snapping import DEFAULT_SNAP
from twistwrench.robot.kernels import disk_cache

ARM = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.02"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="1"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="1"/></joint>
</robot>"""
HEAVY = (
    "twistwrench.mechanics.algorithms",
    "twistwrench.formats",
    "twistwrench.mechanics.model.builder",
    "twistwrench.compiler.ir.tracer",
)
HEAVY += (
    "twistwrench.compiler.lowering.lower",
    "llvmlite.binding",
    "_hashlib",
    "tempfile",
    "platformdirs",
    "scipy",
    "xml",
    "difflib",
)
"""What a first torque from the cache imports nothing of."""
TORQUE = """
import os, sys
import twistwrench as tw
robot = tw.load({path!r}{options})
tau = robot.inverse_dynamics(*[[0.1 * k for k in range(robot_nv)] for robot_nv in 3 * ({nv},)])
print(tau.tobytes().hex(), "twistwrench.mechanics.model.builder" in sys.modules, "llvmlite.binding" in sys.modules)
"""


@pytest.fixture
def file(tmp_path, monkeypatch) -> Path:
    """The arm's file in the working folder, under a name that is the same in every test: robots are kept by their paths."""
    monkeypatch.chdir(tmp_path)
    path = Path("arm.urdf")
    path.write_text(ARM)
    return path


@pytest.fixture
def place(tmp_path) -> Path:
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def first(tmp_path_factory) -> tuple[Path, str]:
    """What one process has kept of the arm, and the bits of its torque."""
    folder = tmp_path_factory.mktemp("first")
    (folder / "arm.urdf").write_text(ARM)
    code = TORQUE.format(path="arm.urdf", options="", nv=2)
    return folder / "cache", python(code, folder / "cache", cwd=folder).split()[0]


@pytest.fixture
def bits(first) -> str:
    """Bits of the arm's torque in a process that found nothing kept."""
    return first[1]


@pytest.fixture
def kept(first, place) -> Path:
    """A place with what one process has kept of the arm."""
    return Path(shutil.copytree(first[0], place))


def python(code: str, place: Path | str, *flags: str, cwd: Path | None = None, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, *(flags or ("-W", "error")), "-c", code], cwd=cwd,
        env={**os.environ, "TWISTWRENCH_CACHE_DIR": str(place), **environment}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return (done.stdout + done.stderr).strip()


def torque(path: Path, place: Path | str, *, options: str = "", nv: int = 2, **environment: str) -> tuple[str, bool]:
    """The bits of a torque in a process of its own, and whether that process read the file and asked LLVM."""
    bits, built, _ = python(TORQUE.format(path=str(path), options=options, nv=nv), place, **environment).split()
    return bits, built == "True"


def test_the_second_process_makes_nothing_and_finds_the_same_bits(file, place):
    first, second, without = torque(file, place), torque(file, place), torque(file, "off")
    assert first == without == (second[0], True)
    assert second[1] is not True


def test_what_is_kept_of_a_kernel_is_what_it_has(file, place):
    """Its length decides when single calls get code of their own, its effort how batches are split between threads."""
    code = (
        "import sys, twistwrench as tw\nfrom twistwrench.compiler.runtime.gufunc import owner_of\n"
        f"kernel = tw.load({str(file)!r}).kernel('inverse_dynamics')\nowner = owner_of(kernel)\n"
        "print(owner.length, owner.cost, kernel.__name__, kernel.__doc__, 'twistwrench.mechanics.model.builder' in sys.modules)"
    )
    (fresh, read), (kept, read_again) = (python(code, place).rsplit(" ", 1) for _ in range(2))
    assert (read, read_again) == ("True", "False")
    assert fresh == kept
    length, effort, *_ = fresh.split()
    assert length != effort


def test_a_first_torque_imports_nothing_that_it_does_not_need(file, kept):
    code = TORQUE.format(path=str(file), options="", nv=2) + "print(*sys.modules)"
    loaded = python(code, kept).splitlines()[1].split()
    assert "twistwrench.robot.engine" in loaded
    placed = sys.platform.startswith("linux") and os.uname().machine == "x86_64"
    unwanted = HEAVY if placed else [name for name in HEAVY if "llvm" not in name]
    alone = python("import numpy, sys; print(*sys.modules)", kept).split()
    assert [x for x in loaded if any(x == y or x.startswith(f"{y}.") for y in unwanted) and x not in alone] == []


def test_another_file_of_that_name_is_another_robot(file, kept, bits):
    file.write_text(ARM.replace('<mass value="1"/>', '<mass value="3"/>'))
    heavier, built = torque(file, kept)
    assert built
    assert heavier == torque(file, "off")[0] != bits
    file.write_text(ARM)
    assert torque(file, kept) == (bits, False)


def test_a_file_that_includes_others_is_read_again_whatever_it_is_called(file, place):
    """MJCF may lie in several files, of which the name and the bytes of one say little."""
    part = file.with_name("part.xml")
    body = '<body><joint type="hinge" axis="0 1 0"/><geom type="sphere" size="0.1" pos="0.3 0 0" mass="{}"/></body>'
    file.write_text('<mujoco><!-- once <robot name="arm"> --><include file="part.xml"/></mujoco>')
    found = []
    for mass in (1, 1, 2):
        part.write_text(f"<mujoco><worldbody>{body.format(mass)}</worldbody></mujoco>")
        found.append(torque(file, place, nv=1))
    assert all(built for _, built in found)
    assert found[0] == found[1] != found[2]


@pytest.mark.parametrize(("options", "nv"), mostly_slow([(", gravity=[0, 0, -1.62]", 2), (", lock={'b': 0.5}", 1)], 2))
def test_other_options_are_another_robot(file, kept, options, nv):
    made, found = (torque(file, kept, options=options, nv=nv) for _ in range(2))
    assert made == (torque(file, "off", options=options, nv=nv)[0], True)
    assert found == (made[0], False)


def test_what_is_doubtful_is_said_each_time(file, place):
    file.write_text(ARM.replace('<limit lower="-2" upper="2" effort="10" velocity="1"/>', "", 1))
    code = TORQUE.format(path=str(file), options="", nv=2)
    said = [python(code, place, "-W", "always") for _ in range(3)]
    assert [text.split()[1] for text in said] == ["True", "False", "False"]
    assert "ModelWarning" in said[0]
    said = [text.partition("ModelWarning")[2] for text in said]
    assert said[0] == said[1] == said[2]
    code += "print(*robot.defects, sep='; ')"  # for which the model is made, without the warnings again
    said = [python(code, folder, "-W", "always") for folder in ("off", place)]
    assert said[0].splitlines()[1:] == said[1].splitlines()[1:]
    assert said[1].count("ModelWarning") == 1


def test_an_error_is_the_same_each_time(file, kept):
    code = (
        f"import twistwrench as tw\ntry: tw.load({str(file)!r}, tip='none')\nexcept tw.UnknownNameError as e: print(e)"
    )
    assert python(code, kept) == python(code, kept) == python(code, "off")
    file.unlink()
    code = code.replace("UnknownNameError", "NotFoundError")
    assert "no file" in python(code, kept)


def test_a_library_in_an_archive_reads_files_as_any_other(file, place, tmp_path, bits):
    """As applications in one file have it; what tells its versions apart is no file there, so nothing is kept of robots."""
    package, archive = Path(tw.__file__).parent, tmp_path / "library.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for path in (*package.rglob("*.py"), *package.rglob("*.txt")):
            packed.write(path, path.relative_to(package.parent))
    code = f"import sys; sys.path.insert(0, {str(archive)!r})" + TORQUE.format(path=str(file), options="", nv=2)
    found, built, _ = python(code, place, PYTHONPATH="").split()
    assert (found, built) == (bits, "True")


def test_another_version_is_another_one_where_only_compiled_files_are_there(tmp_path, monkeypatch):
    for part in ("robot", "model"):
        (tmp_path / part).mkdir()
        (tmp_path / part / "module.pyc").write_bytes(b"old")
    monkeypatch.setattr(disk_cache, "__file__", str(tmp_path / "robot" / "kernels" / "disk_cache.pyc"))
    before = disk_cache._version.__wrapped__()
    (tmp_path / "model" / "module.pyc").write_bytes(b"newer")
    assert disk_cache._version.__wrapped__() != before


DAMAGE = {
    "cut": lambda raw: raw[: len(raw) // 2],
    "a bit": lambda raw: raw[:-1] + bytes([raw[-1] ^ 1]),
}


@pytest.mark.parametrize("damage", mostly_slow(DAMAGE, 2))
def test_damaged_entries_are_made_again(file, kept, bits, damage):
    for entry in kept.iterdir():
        entry.write_bytes(DAMAGE[damage](entry.read_bytes()))
    assert torque(file, kept) == (bits, True)


def test_lost_entries_are_made_again(file, kept, bits):
    entries = {entry: entry.read_bytes() for entry in kept.iterdir()}
    assert len(entries) >= 3
    for lost in entries:
        for entry, raw in entries.items():
            entry.write_bytes(raw)
        lost.unlink()
        assert torque(file, kept)[0] == bits
        assert lost.read_bytes() == entries[lost]


def test_another_version_of_the_library_makes_its_own(file, kept):
    code = TORQUE.format(path=str(file), options="", nv=2)
    other = "from twistwrench.robot.kernels import disk_cache; disk_cache._version = lambda: 'another'\n" + code
    assert python(other, kept).split()[1] == "True"
    assert python(other, kept).split()[1] == "False"


@pytest.mark.skipif(not hasattr(os, "uname") or os.uname().machine != "x86_64", reason="levels of x86-64")
def test_another_processor_has_kernels_of_its_own(file, kept):
    bits, built = torque(file, kept, TWISTWRENCH_CPU="x86-64")
    assert built
    assert bits == torque(file, "off", TWISTWRENCH_CPU="x86-64")[0]


def test_without_the_compiler_nothing_kept_is_used(file, kept):
    code = TORQUE.format(path=str(file), options="", nv=2) + "print(type(robot.kernel('inverse_dynamics')).__name__)"
    assert python(code, kept, TWISTWRENCH_JIT="0").splitlines()[1] == "NumpyKernel"


def test_no_home_and_a_home_that_cannot_be_written_to(file, place, tmp_path):
    (tmp_path / "no folder").write_text("")
    homes = (tmp_path / "no folder", tmp_path / "fresh")
    assert len({torque(file, "", XDG_CACHE_HOME=str(home))[0] for home in homes}) == 1
    assert (tmp_path / "fresh" / "twistwrench" / "kernels").is_dir() or not sys.platform.startswith("linux")


def test_processes_side_by_side_find_the_same(file, place):
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: torque(file, place)[0], range(4)))
    assert {*found} == {torque(file, place)[0]}


WHOLE = """
import copy, pickle, sys, warnings
import numpy as np, twistwrench as tw
path = {path!r}
robot = tw.load(path)
q, dq, ddq = np.array([0.1, 0.2]), np.array([0.3, -0.4]), np.array([0.5, 0.6])
found = [robot.inverse_dynamics(q, dq, ddq)]
print("twistwrench.mechanics.model.builder" in sys.modules)
open(path, "w").write("<robot name='gone'><link name='base'/></robot>")  # what was loaded is what counts
found += [robot.inverse_dynamics(q, dq, ddq) for _ in range(4)]  # by the builtin, from the third on
found += [robot.inverse_dynamics(*(x.astype("f") for x in (q, dq, ddq)))]
found += [robot.inverse_dynamics(*(np.tile(x, (50, 1)) for x in (q, dq, ddq)))]
found += [robot.mass_matrix(q), robot.jacobian(q, frame="upper"), robot.forward_kinematics(q)]
found += [robot.with_payload(tw.SpatialInertia.from_com(1.0, (0, 0, 0.1)), "lower").gravity_forces(q)]
found += [pickle.loads(pickle.dumps(robot)).gravity_forces(q), copy.deepcopy(robot).gravity_forces(q)]
found += [robot.kernel("mass_matrix", "bias_forces")(q, dq)[0], robot.limits.effort, robot.parameters]
print(robot.name, robot.nq, robot.nv, robot.tip, *robot.link_names, robot.model.source == path, repr(robot))
print(robot.program("inverse_dynamics").digest, robot.kernel("inverse_dynamics").signature)
print(robot.kernel("inverse_dynamics").__name__, robot.kernel("inverse_dynamics").__doc__[-200:])
print(*(np.asarray(x).tobytes().hex() for x in found))
try:
    robot.inverse_dynamics([0.1], [0.2], [0.3])
except tw.ShapeError as error:
    print(error)
try:
    robot.jacobian(q, frame="nowhere")
except tw.UnknownNameError as error:
    print(error)
"""


def test_all_else_of_a_kept_robot_is_as_of_a_fresh_one(file, place):
    """Beyond the kernels that are kept the model is made, of the bytes that were read; whoever asks cannot tell."""
    said = []
    for folder in ("off", place, place):
        file.write_text(ARM)
        said.append(python(WHOLE.format(path=str(file)), folder).splitlines())
    assert [lines[0] for lines in said] == ["True", "True", "False"]
    assert said[0][1:] == said[1][1:] == said[2][1:]


def test_a_kept_robot_that_nobody_holds_is_freed_at_once(file, place):
    code = TORQUE.format(path=str(file), options="", nv=2) + (
        "import gc, weakref\n"
        "gc.collect(); gc.disable(); seen = weakref.ref(robot), weakref.ref(robot.engine)\n"
        "del robot; print(*(ref() is None for ref in seen))"
    )
    assert [python(code, place).splitlines()[1] for _ in range(2)] == ["True True"] * 2


def test_kernels_with_options_are_told_apart(file, place):
    code = (
        f"import twistwrench as tw, sys; robot = tw.load({str(file)!r}); q = [0.1, 0.2]\n"
        "for kind in ('body', 'space', 'world_aligned'):\n"
        "    print(robot.jacobian(q, 'lower', kind).tobytes().hex())\n"
        "print('twistwrench.compiler.ir.tracer' in sys.modules)"
    )
    first, second = (python(code, place).splitlines() for _ in range(2))
    assert first[:3] == second[:3] == python(code, "off").splitlines()[:3]
    assert len(set(first[:3])) == 3
    assert (first[3], second[3]) == ("True", "False")


def test_a_robot_is_known_whatever_was_imported_before(file, kept):
    code = "import twistwrench.mechanics.algorithms.inverse_dynamics, twistwrench.compiler.ir.tracer\n" + TORQUE.format(
        path=str(file), options="", nv=2
    )
    code += "print('twistwrench.formats.urdf' in sys.modules)"
    assert python(code, kept).split()[3] == "False"


@pytest.mark.parametrize("name", mostly_slow(["text", "mjcf"], 2))
def test_what_is_no_plain_urdf_file_is_read_each_time(tmp_path, place, name):
    if name == "text":
        code = f"import sys, twistwrench as tw; tw.load({ARM!r}); print('twistwrench.mechanics.model.builder' in sys.modules)"
    else:
        (tmp_path / "arm.xml").write_text(tw.load(ARM).to_mjcf())
        code = f"import sys, twistwrench as tw; tw.load({str(tmp_path / 'arm.xml')!r}); print('twistwrench.mechanics.model.builder' in sys.modules)"
    assert [python(code, place, "-W", "ignore") for _ in range(2)] == ["True", "True"]


def test_the_default_tolerance_of_rotations_is_that_of_models():
    assert inspect.signature(tw.load).parameters["snap"].default == DEFAULT_SNAP
