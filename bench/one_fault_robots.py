"""Robots of the logs with one fault: bundled files, public ones, and small written ones of kinds that trip thresholds.

A robot is a line of :data:`ROBOTS`. ``speed`` is what its joints reach if the file gives no velocity limit, or a placeholder.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tests.faulty_logs.truth import SHARED

BUNDLED = Path(__file__).resolve().parent.parent / "src" / "twistwrench" / "robots"
_ROBOT = '<robot name="{name}"><link name="base"/>\n{parts}\n</robot>\n'
_PART = """<link name="{joint}_link"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
  <inertia ixx="{I}" ixy="0" ixz="0" iyy="{I}" iyz="0" izz="{I}"/></inertial></link>
<joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{joint}_link"/><origin xyz="{at}" rpy="0 0 {yaw}"/>
  <axis xyz="{axis}"/>{limit}</joint>"""


@dataclass(frozen=True)
class Part:
    """A joint with its link; ``limit`` are lower, upper, velocity and effort."""

    joint: str
    axis: str
    at: str
    com: str
    mass: float
    limit: tuple[float, float, float, float] | None
    kind: str = "revolute"
    parent: str = ""
    yaw: float = 0.0
    radius: float = 0.08
    """Radius of gyration [m]."""


@dataclass(frozen=True)
class Mechanism:
    """A robot: its file or its parts, options of the command, and how fast it moves."""

    name: str
    file: Path | None = None
    parts: tuple[Part, ...] = ()
    options: tuple[str, ...] = ()
    fastest: float = 1.0
    """Cycles a second of the fastest motions."""
    speed: float = 2.0
    floats: bool = False
    placeholder: bool = False
    """True if its limits are not those of a real drive."""
    faulty: bool = True
    """False if only clean logs of it are made."""

    @property
    def path(self) -> Path | None:
        """Its file; None if the folder of public robots is absent."""
        if self.parts:
            return _written(self)
        return self.file if self.file is not None and self.file.is_file() else None


@cache
def _written(mechanism: Mechanism) -> Path:
    path = Path(tempfile.mkdtemp(prefix="one_fault_")) / f"{mechanism.name}.urdf"
    path.write_text(urdf(mechanism.name, mechanism.parts), "utf-8")
    return path


def urdf(name: str, parts: Sequence[Part]) -> str:
    """URDF of a chain of parts; a part names another parent if it is not the part before."""
    keys = ("lower", "upper", "velocity", "effort")
    texts, before = [], "base"
    for part in parts:
        limit = ""
        if part.limit is not None:
            values = " ".join(f'{key}="{value}"' for key, value in zip(keys, part.limit, strict=True))
            limit = f"<limit {values}/>"
        inertia = part.mass * part.radius**2
        told = {"joint": part.joint, "axis": part.axis, "at": part.at, "com": part.com, "mass": part.mass}
        texts.append(
            _PART.format(**told, I=inertia, kind=part.kind, parent=part.parent or before, yaw=part.yaw, limit=limit)
        )
        before = f"{part.joint}_link"
    return _ROBOT.format(name=name, parts="\n".join(texts))


_SCARA = (
    Part("turn", "0 0 1", "0 0 0.3", "0.15 0 0", 4.0, (-2.4, 2.4, 8.0, 120.0)),
    Part("fold", "0 0 1", "0.3 0 0", "0.12 0 0", 2.0, (-2.5, 2.5, 12.0, 60.0)),
    Part("plunge", "0 0 1", "0.25 0 0", "0 0 -0.1", 0.8, (-0.2, 0.0, 2.0, 150.0), kind="prismatic"),
    Part("spin", "0 0 1", "0 0 -0.2", "0 0.01 0", 0.3, (-6.2, 6.2, 40.0, 4.0), radius=0.03),
)
_DELTA = tuple(
    Part(f"arm{k}", "0 1 0", "0.1 0 0", "0.1 0 0", 0.4, (-0.7, 1.6, 35.0, 20.0), parent="base", yaw=2.0943951 * k)
    for k in range(3)
)


def _servos(velocity: float, effort: float) -> tuple[Part, ...]:
    axes = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "1 0 0")
    return tuple(
        Part(f"servo{k}", axis, "0 0 0.08", "0 0 0.04", 0.09 - 0.01 * k, (-1.57, 1.57, velocity, effort), radius=0.02)
        for k, axis in enumerate(axes)
    )


_GANTRY = (
    Part("x", "1 0 0", "0 0 2", "0 0 0", 80.0, (0.0, 3.0, 1.5, 1500.0), kind="prismatic"),
    Part("y", "0 1 0", "0 0 0", "0 0 0", 30.0, (-0.8, 0.8, 1.5, 600.0), kind="prismatic"),
    Part("z", "0 0 1", "0 0 0", "0 0 -0.5", 12.0, (-1.0, 0.0, 1.0, 400.0), kind="prismatic"),
    Part("head", "0 0 1", "0 0 -1", "0.05 0 0", 2.0, (-3.1, 3.1, 6.0, 20.0)),
)
_TURNTABLE = tuple(
    Part(f"axis{k}", axis, "0.2 0 0.1", "0.1 0 0.02", 3.0 - 0.6 * k, None, kind="continuous")
    for k, axis in enumerate(("0 0 1", "0 1 0", "1 0 0", "0 1 0"))
)
_DRONE = (
    Part("shoulder", "0 1 0", "0 0 -0.05", "0 0 -0.08", 0.12, (-1.6, 1.6, 6.0, 1.2), radius=0.03),
    Part("elbow", "0 1 0", "0 0 -0.16", "0 0 -0.06", 0.08, (-2.0, 2.0, 6.0, 0.8), radius=0.03),
)
_BODY = Part("frame", "0 0 1", "0 0 0", "0 0 0", 1.4, None, kind="fixed")

ROBOTS = {
    robot.name: robot
    for robot in (
        Mechanism("ur5", BUNDLED / "ur5.urdf"),
        Mechanism("panda", BUNDLED / "panda.urdf"),
        Mechanism("planar_3r", BUNDLED / "planar_3r.urdf", faulty=False),
        Mechanism("xarm6", SHARED / "ufactory_xarm6.urdf", options=("--inertia", "accept")),
        Mechanism("tx40", SHARED / "staubli_tx40.urdf", fastest=2.0),
        Mechanism("dual_iiwa14", SHARED / "kuka_dual_iiwa14.urdf"),
        Mechanism("dual_ur10e", SHARED / "dual_ur10e.urdf"),
        Mechanism("sawyer", SHARED / "rethink_sawyer.urdf"),
        Mechanism("wx250s", SHARED / "trossen_wx250s.urdf"),
        Mechanism("leap_hand", SHARED / "leap_hand_right.urdf", fastest=2.0),
        Mechanism("dex5_hand", SHARED / "unitree_dex5_left.urdf", fastest=2.0),
        Mechanism("barrett_hand", SHARED / "barrett_hand.urdf"),
        Mechanism("qarm", SHARED / "quanser_qarm.urdf", faulty=False),
        Mechanism("robotiq_3f", SHARED / "robotiq_3f.urdf", options=("--inertia", "accept"), placeholder=True),
        Mechanism("pick_scara", parts=_SCARA, fastest=6.0),
        Mechanism("delta", parts=_DELTA, fastest=8.0),
        Mechanism("gantry", parts=_GANTRY),
        Mechanism("turntable", parts=_TURNTABLE, faulty=False),
        Mechanism("servo_arm", parts=_servos(100.0, 100.0), fastest=2.0, speed=5.0, placeholder=True),
        Mechanism("servo_low", parts=_servos(0.5, 1.0), fastest=2.0, speed=5.0, placeholder=True, faulty=False),
        Mechanism("drone", parts=(_BODY, *_DRONE), options=("--floating-base",), floats=True, faulty=False),
    )
}
