"""docs/adding.md is true: on a copy of the source, each recipe of the page adds what it says, in the places it names.

The places are read from the page, so that a recipe that names another file fails here.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

PAGE = (ROOT / "docs" / "adding.md").read_text("utf-8")

JOINT = '''"""Cylindrical joint: rotation about z, and translation along it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...core.typing import Array
from ..lie import se3
from .joint import Joint
from .screw_joint import rodrigues


class Cylindrical(Joint):
    """Joint that rotates about z and slides along it, independently."""

    kind = "cylindrical"
    coordinate_suffixes = velocity_suffixes = (".angle", ".height")
    coordinate_units = ("rad", "m")

    @classmethod
    def axes_from(cls, axis: ArrayLike, pitch: float, normalise: bool, who: str) -> Array:
        """Rotation about z, and translation along z."""
        return np.eye(6)[[2, 5]]

    def pose(self, q: Array) -> Array:
        """Rotation by the first coordinate, translation by the second."""
        z = np.array([0.0, 0.0, 1.0])
        return se3.pose(rodrigues(z, np.cos(q[0]), np.sin(q[0])), z * q[1])

    def rates(self, q: Array) -> Array:
        """Coordinates are the integrals of the velocities."""
        return np.eye(2)
'''
JOINT_LAW = """
import numpy as np
import twistwrench as tw

G = tw.SpatialInertia.from_com(1.3, (0.1, -0.2, 0.3), np.diag([0.02, 0.03, 0.04]))

def arm(joints):
    builder = tw.ModelBuilder("arm")
    builder.add_link("base")
    parent = "base"
    for k, (kind, inertia) in enumerate(joints):
        builder.add_link(f"link{k}", inertia)
        builder.add_joint(f"joint{k}", kind, parent, f"link{k}", axis=(0, 0, 1))
        parent = f"link{k}"
    return tw.Robot(builder.build(quiet=True))

one = arm([("cylindrical", G), ("revolute", G)])
two = arm([("revolute", None), ("prismatic", G), ("revolute", G)])
q, dq, ddq = np.random.default_rng(0).standard_normal((3, 5, 3))
for robot in (one, two):
    assert (robot.nq, robot.nv) == (3, 3)
assert one.coordinate_names[:2] == ("joint0.angle", "joint0.height")
error = np.abs(one.inverse_dynamics(q, dq, ddq) - two.inverse_dynamics(q, dq, ddq)).max()
assert error < 1e-12, error
error = np.abs(one.forward_dynamics(q, dq, one.inverse_dynamics(q, dq, ddq)) - ddq).max()
assert error < 1e-10, error
"""

QUANTITY = '''"""Power of the weight."""

from __future__ import annotations

from typing import Any

from ...core.typing import Array
from ..model.model import Model
from .inverse_dynamics import gravity_forces


def lifting_power(model: Model, q: Array, dq: Array) -> Any:
    """g'dq, the power against the weight."""
    return gravity_forces(model, q) @ dq
'''
QUANTITY_ROW = """    "lifting_power": row(
        lifting.lifting_power, "q dq", "power", "", "power against the weight", felt=True, unit="W",
    ),
"""
QUANTITY_LAW = """
from pathlib import Path
import numpy as np
import twistwrench as tw

robot = tw.robots.ur5()
q, dq = np.random.default_rng(0).standard_normal((2, 7, 6))
power = robot.kernel("lifting_power")(q, dq)
expected = np.sum(robot.gravity_forces(q) * dq, axis=-1)
assert np.abs(power - expected).max() < 1e-12 * np.abs(expected).max()
assert np.isclose(robot.reference("lifting_power", q[0], dq[0]), expected[0], rtol=1e-12)
files = robot.export_c(["lifting_power"], Path("lifting.c"), test=False)
assert any("lifting_power" in file.read_text() for file in files)
"""

CHECK = '''

def check_names(robot: ParsedFile, _options: Options) -> Iterator[Finding]:
    """Joints without a letter in their name."""
    for name in robot.joints:
        if not any(letter.isalpha() for letter in name):
            yield Finding("names", Severity.WARNING, f"joint {name!r}", 0, f"joint {name!r} has no letter in its name.")
'''
CHECK_LAW = """
from pathlib import Path
import twistwrench as tw

text = tw.robots.path_of("planar_2r").read_text()
Path("named.urdf").write_text(text)
Path("numbered.urdf").write_text(text.replace('"joint1"', '"17"'))
kinds = [[finding.check for finding in tw.doctor(file).findings] for file in ("named.urdf", "numbered.urdf")]
assert kinds[1].count("names") == 1 and "names" not in kinds[0], kinds
"""

ANSWER = '''"""Function of the command ``weigh``: the weight of a robot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ..core.answers.answer import Answer
from ..core.answers.blocks import Block, Headline
from ..core.verdict import Verdict, Word
from ..robot import Robot, load


@dataclass(frozen=True, eq=False, repr=False)
class Weight(Answer):
    """Weight of a robot."""

    robot: Robot
    allowed: float
    call = "weigh"

    @property
    def verdict(self) -> Verdict:
        """OK, or OVER LIMIT."""
        mass = self.robot.model.moving_mass
        word = Word.OK if mass <= self.allowed else Word.OVER_LIMIT
        return Verdict(word, (f"moving parts of {mass:.1f} kg, {self.allowed:.1f} kg are allowed",))

    def blocks(self) -> Iterator[Block]:
        """Headline."""
        yield Headline.from_verdict(self.verdict)


def weigh(robot: Robot | str, *, allowed: float = 10.0) -> Weight:
    """Weight of a robot.

    Parameters
    ----------
    robot : Robot or str
    allowed : float
        Largest mass of the moving parts [kg]. [default: 10]
    """
    return Weight(load(robot) if isinstance(robot, str) else robot, allowed)
'''
COMMAND = '''"""The command ``twistwrench weigh``."""

from __future__ import annotations

from ..statics.weight import Weight, weigh
from .shared import RobotOptions
from .skin import Asked, command_of


@command_of("weigh", weigh, examples=("weigh ur5 --allowed 30",))
def weigh_command(robot: RobotOptions, asked: Asked) -> Weight:
    """Weigh the moving parts of a robot."""
    return weigh(robot.load(), **asked)
'''
COMMAND_LAW = """
import json, subprocess, sys

def shell(*words):
    return subprocess.run([sys.executable, "-m", "twistwrench", *words], capture_output=True, text=True)

mass = __import__("twistwrench").robots.ur5().model.moving_mass
heavy = shell("weigh", "ur5")
assert (heavy.returncode, heavy.stdout) == (1, f"OVER LIMIT: moving parts of {mass:.1f} kg, 10.0 kg are allowed.\\n"), heavy
light = shell("weigh", "ur5", "--allowed", "30", "--json", "weight.json")
assert light.returncode == 0 and light.stdout.startswith("OK"), light
assert json.load(open("weight.json"))["verdict"] == "OK"
assert "Largest mass of the moving parts" in shell("weigh", "--help").stdout
assert "Weigh the moving parts" in shell("--help").stdout
"""


def section(title: str) -> str:
    """Text below a heading of the page."""
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


@pytest.fixture
def source(tmp_path):
    """A copy of the package."""
    folder = tmp_path / "src" / "twistwrench"
    shutil.copytree(
        ROOT / "src" / "twistwrench", folder, ignore=shutil.ignore_patterns("*.pyc.*")
    )  # bytecode saves seconds
    return folder


def insert(path: Path, after: str, text: str) -> None:
    """Add text behind a text that stands once in a file."""
    old = path.read_text("utf-8")
    assert old.count(after) == 1, f"{after!r} in {path.name}"
    path.write_text(old.replace(after, after + text), "utf-8")


def holds(law: str, source: Path) -> None:
    """Run statements on the copy."""
    environment = {**os.environ, "PYTHONPATH": str(source.parent), "TWISTWRENCH_CACHE_DIR": "off", "COLUMNS": "120"}
    run = subprocess.run(
        [sys.executable, "-c", law], capture_output=True, text=True, cwd=source.parents[1], env=environment
    )
    assert run.returncode == 0, run.stderr


def test_a_joint_type_is_one_file_and_its_name(source):
    assert "one file in `src/twistwrench/mechanics/joints/`, and its name in `JOINT_TYPES`" in section("A joint type")
    joints = source / "mechanics" / "joints"
    (joints / "cylindrical.py").write_text(JOINT, "utf-8")
    insert(joints / "__init__.py", "from collections.abc import Mapping\n", "\nfrom .cylindrical import Cylindrical")
    insert(joints / "__init__.py", "Planar, Floating, Ball", ", Cylindrical")
    holds(JOINT_LAW, source)


def test_a_quantity_is_one_function_and_one_row(source):
    text = " ".join(section("A quantity").split())
    assert (
        "one function in `src/twistwrench/mechanics/algorithms/`" in text and "one row in `robot/quantities.py`" in text
    )
    (source / "mechanics" / "algorithms" / "lifting.py").write_text(QUANTITY, "utf-8")
    table = source / "robot" / "quantities.py"
    insert(table, "    kinematics,\n", "    lifting,\n")
    insert(table, "QUANTITIES: Mapping[str, Quantity] = {\n", QUANTITY_ROW)
    holds(QUANTITY_LAW, source)


def test_a_check_of_the_doctor_is_one_function_and_its_name(source):
    assert "its name in `CHECKS` of `diagnosis/checks.py`" in " ".join(section("A check of the doctor").split())
    insert(source / "diagnosis" / "mass_checks.py", _last_line(source / "diagnosis" / "mass_checks.py"), CHECK)
    insert(source / "diagnosis" / "checks.py", '    "axis": check_axis,\n', '    "names": masses.check_names,\n')
    holds(CHECK_LAW, source)


def _last_line(path: Path) -> str:
    return path.read_text("utf-8")[-200:]


def test_a_command_is_a_function_one_file_and_one_line(source):
    text = " ".join(section("A command").split())
    assert "one file in `src/twistwrench/cli/` with `command_of" in text and "`_GROUPS` of `cli/main.py`" in text
    (source / "statics" / "weight.py").write_text(ANSWER, "utf-8")
    (source / "cli" / "weigh.py").write_text(COMMAND, "utf-8")
    entry = '        "weigh": _Entry("weigh", "Weigh the moving parts of a robot."),\n'
    insert(source / "cli" / "main.py", 'robots": _Entry("info", "List the robots known by name."),\n', entry)
    holds(COMMAND_LAW, source)


def test_names_of_the_page_are_defined_in_the_files_it_names():
    names = re.findall(r"`(\w+)` (?:of|in) `([\w/]+\.(?:py|toml))`", " ".join(PAGE.split()))
    assert len(names) >= 12
    lost = [
        (name, file)
        for name, file in names
        if not re.search(
            rf"^ *(?:class |def )?{name}\b", (ROOT / "src" / "twistwrench" / file).read_text("utf-8"), re.MULTILINE
        )
    ]
    assert lost == []
