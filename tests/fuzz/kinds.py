"""Kinds of files: whole ones, how they are changed, by which entry points they are read, and which row of the threats they are."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

from . import log_seeds, robot_seeds
from .containers import array, bag, database, gzipped, matrices, mcap, members, named_places
from .mutations import (
    Dice,
    Mutation,
    cells,
    cut,
    elements_with,
    encoded,
    flipped,
    json_values,
    lengths,
    lines,
    numbers,
    tokens,
    yaml_text,
    yaml_values,
)
from .robot_seeds import Case

RAW = (flipped, cut, lengths)
TEXT = (tokens, numbers, lines, flipped)

COMMAND = "[c for c in ().__class__.__base__.__subclasses__() if c.__name__=='_wrap_close'][0].__init__.__globals__['system']('echo x &gt; OUTSIDE/ran')"
"""Expression of Python that runs a command of the shell, by names that every object leads to."""

URDF = elements_with(
    (
        f'<link name="${{(lambda: {COMMAND})()}}"/>',         '<collision><geometry><mesh filename="PLACE"/></geometry></collision>', '<visual><geometry><mesh filename="PLACE"/></geometry></visual>', '<mimic joint="j1"/>',
        '<gazebo><plugin filename="PLACE"/></gazebo>', '<xacro:include filename="PLACE"/>', '<xacro:macro name="m"><xacro:m/></xacro:macro>', '<xacro:m/>', '<inertial><mass value="1e308"/></inertial>',
        '<material name="m"><texture filename="PLACE"/></material>', '<safety_controller soft_lower_limit="1"/>', '<link name="base"/>', '<limit effort="${9**9**9}"/>',
    ), ".stl", ".dae", ".obj", ".xacro",
)  # fmt: skip
XACRO = elements_with(
    (
        f'<link name="${{(lambda: {COMMAND})()}}"/>', f'<xacro:property name="x" value="${{{COMMAND}}}"/>', f'<xacro:if value="${{[{COMMAND} for k in [1]]}}"/>',
        '<xacro:include filename="PLACE"/>', '<xacro:property name="p" value="${xacro.load_yaml(\'PLACE\')}"/>', '<xacro:macro name="m" params="a"><xacro:m a="${a} ${a}"/></xacro:macro>', '<xacro:m a="1"/>',
        '<xacro:property name="p" value="${9**9**9}"/>', '<link name="${(lambda: 1)()}"/>', '<link name="${[c for c in ().__class__.__base__.__subclasses__()][0]}"/>', '<link name="${\'x\' * 10**10}"/>',
        '<xacro:property name="a" value="${b}"/>', '<xacro:property name="b" value="${a}"/>', '<link name="$(find nowhere)"/>', '<link name="$(eval 1)"/>', '<link name="$(env HOME)"/>', '<link name="$(cwd)"/>',
        '<xacro:if value="${open(\'PLACE\')}"/>', '<xacro:if value="${__import__(\'os\')}"/>', '<xacro:unless value="${1 in range(10**12)}"/>', '<link name="${1 &lt;&lt; 10**10}"/>', '<xacro:insert_block name="x"/>',
        '<xacro:element xacro:name="link" name="x"/>', '<xacro:attribute name="x" value="y"/>', '<xacro:call macro="rod"/>', '<link name="${list(range(10**10))}"/>', '<link name="${\'%99999999999d\' % 1}"/>',
    ), ".xacro", ".yaml", ".txt",
)  # fmt: skip
MJCF = elements_with(
    (
        '<include file="PLACE"/>', '<asset><mesh file="PLACE" name="x"/></asset>', '<geom type="mesh" mesh="x"/>', '<asset><hfield file="PLACE" name="x"/></asset>', '<asset><texture file="PLACE"/></asset>', '<compiler meshdir="PLACE"/>',
        '<compiler assetdir="/"/>', '<composite type="cable" count="9999 1 1" prefix="x"/>', '<replicate count="100000000" offset="0 0 1"><body><joint/><geom size="1"/></body></replicate>', '<flexcomp name="f" type="grid" count="999 999 999"/>',
        '<extension><plugin plugin="PLACE"><instance name="x"/></plugin></extension>', '<attach model="x" body="a" prefix="y"/>', '<asset><model file="PLACE" name="x"/></asset>', '<default class="k"><default class="k"/></default>', '<joint class="none"/>',
        '<body childclass="none"/>', '<frame pos="nan 0 0"/>', '<freejoint/>', '<option><flag gravity="disable"/></option>', '<exclude body1="a" body2="a"/>', '<spatial><site site="s"/></spatial>', '<connect body1="a" body2="a"/>',
    ), ".xml", ".stl", ".obj", ".msh",
)  # fmt: skip
SDF = elements_with(
    (
        "<include><uri>PLACE</uri></include>", '<plugin filename="PLACE" name="x"/>', "<visual name='x'><geometry><mesh><uri>PLACE</uri></mesh></geometry></visual>", "<pose relative_to='a'>0 0 0 0 0 0</pose>", "<frame name='f' attached_to='f'/>",
        "<model name='arm'><model name='arm'/></model>", "<joint name='q' type='gearbox'><parent>a</parent><child>b</child></joint>", "<pose rotation_format='quat_xyzw'>0 0 0 0 0 0 0</pose>", "<gravity>nan 0 0</gravity>", "<experimental:params/>".replace(":", "_"),
    ), ".sdf", ".stl", ".dae",
)  # fmt: skip
PLAIN_XML = elements_with((), ".png", ".stl")
USD = (named_places(".usda", ".usdc", ".usdz"), tokens, numbers, lines, lines, flipped)


@dataclass(frozen=True, eq=False)
class Kind:
    """One kind of files of a reader."""

    name: str
    threats: str
    """Its entry among the readers of the table of threats."""
    seeds: Callable[[], list[Case]]
    doors: tuple[str, ...]
    """Entry points; those of the command line stand behind ``cli``, which a file in eight goes through."""
    changes: Mapping[str, Sequence[Mutation]]
    """Mutations by the names of the files of a case."""
    cli: tuple[str, ...] = ()
    features: tuple[Callable[[Dice], Case], ...] = ()
    """Files made anew, with features that no honest program writes: a third of them."""
    needs: tuple[str, ...] = ()
    """Packages without which the kind is left out."""
    share: float = 1.0
    """Number of files in relation to other kinds."""
    refused: bool = False
    """True for a format that is not read for safety, whole files included."""
    slow: bool = False
    """True for kinds whose whole files take seconds to make: they are in the long form only."""

    @property
    def whole(self) -> list[Case]:
        return _whole(self)

    def case(self, number: int, seed: str, outside: str) -> tuple[Case, str]:
        """Files of a number, and the entry point that reads them; the same for the same seed."""
        dice = Dice(f"{seed} {self.name} {number}", outside)
        door = dice.choice(self.cli) if self.cli and dice.often(1 / 8) else dice.choice(self.doors)
        if self.features and dice.often(1 / 3):
            case = dice.choice(self.features)(dice)
            if dice.often(0.7):
                return case, door
        else:
            case = dice.choice(self.whole)
        files = dict(case.files)
        for _ in range(dice.choice((1, 1, 1, 2, 3))):
            name = dice.choice(sorted(name for name in files if self._of(name)))
            dice.own = name
            files[name] = dice.choice(self._of(name))(files[name], dice)
        return Case(case.main, files), door

    def _of(self, name: str) -> Sequence[Mutation]:
        return next((found for pattern, found in self.changes.items() if fnmatch.fnmatch(name, pattern)), ())


@cache
def _whole(kind: Kind) -> list[Case]:
    return kind.seeds()


def _simulated(ending: str) -> list[Case]:
    return log_seeds.simulated(ending)


def cache_entries() -> list[Case]:
    """Entries of the cache of compiled code of a small robot."""
    import os
    import subprocess
    import sys
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        code = "import twistwrench as tw; tw.load(tw.robots.path_of('pendulum')).mass_matrix([0.3])"
        environment = {**os.environ, "TWISTWRENCH_CACHE_DIR": folder}
        subprocess.run([sys.executable, "-c", code], env=environment, check=True)
        files = {entry.name: entry.read_bytes() for entry in sorted(Path(folder).iterdir())}
    return [Case(next(iter(files)), files)]


LOGS = ("motion", "quality")
LOG_COMMANDS = ("log", "torques", "identify")
ROBOTS = ("load", "load", "doctor", "drawn")
ROBOT_COMMANDS = ("info", "doctor command", "convert", "view")

KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind("URDF", "URDF", robot_seeds.urdf, ROBOTS, {"*.urdf": (URDF, URDF, URDF, encoded, *TEXT), "*.stl": RAW}, ROBOT_COMMANDS, share=2),
        Kind("xacro", "xacro", robot_seeds.xacro, ("load",), {"*.xacro": (XACRO, XACRO, tokens, lines, flipped), "*.yaml": (yaml_text, tokens)}, ("info", "doctor command"), needs=("xacrodoc",)),
        Kind("xacro in URDF", "xacro", robot_seeds.xacro_in_urdf, ("load", "load as xacro", "doctor"), {"*.urdf": (XACRO, URDF, tokens), "*.xacro": (XACRO,), "*.yaml": (tokens,)}, ("info", "doctor command")),
        Kind("MJCF", "MJCF", robot_seeds.mjcf, ROBOTS, {"*.xml": (MJCF, MJCF, MJCF, encoded, *TEXT), "*": (*RAW, tokens)}, ROBOT_COMMANDS, share=2),
        Kind("SDF", "SDF", robot_seeds.sdf, ROBOTS, {"*.sdf": (SDF, SDF, SDF, encoded, *TEXT), "*.stl": RAW}, ROBOT_COMMANDS, share=2),
        Kind("SRDF", "SRDF", robot_seeds.srdf, ("srdf",), {"*": (PLAIN_XML, PLAIN_XML, encoded, *TEXT)}, ("clearance",)),
        Kind("USD text", "USD", robot_seeds.usda, ("load",), {"*": USD}, ("info", "convert"), needs=("pxr",), share=2),
        Kind("USD binary", "USD", robot_seeds.usdc, ("load",), {"*": RAW}, ("info",), needs=("pxr",)),
        Kind("USD package", "USD", robot_seeds.usdz, ("load",), {"*": (members(tokens, stored=True), members(lines, stored=True), *RAW)}, ("info",), needs=("pxr",)),
        Kind("meshes", "meshes", robot_seeds.meshes, ("mesh", "shown mesh"), {"*.dae": (PLAIN_XML, PLAIN_XML, *TEXT), "*.gltf": (json_values, *TEXT), "*.glb": (*RAW, tokens), "*": (*TEXT, lengths)}, needs=("trimesh",), share=2),
        Kind("actuators", "actuator files", robot_seeds.actuators, ("actuators", "log side"), {"*": (yaml_values, yaml_values, yaml_text, *TEXT)}, ("info of actuators",)),
        Kind("catalogue", "catalogues", robot_seeds.catalogue, ("catalogue",), {"*": (yaml_values, yaml_values, yaml_text, *TEXT)}, ("size",)),
        Kind("limits", "limits", robot_seeds.limits, ("limits",), {"*": (cells, cells, encoded, *TEXT)}, ("torques with limits",)),
        Kind("factory calibration", "factory calibrations", robot_seeds.factory_calibration, ("factory calibration",), {"*.yaml": (yaml_values, yaml_text, *TEXT), "*": (encoded, *TEXT, tokens)}, share=0.3),
        Kind("measurements", "CSV logs", robot_seeds.measurements, ("measurements", "calibrated"), {"*": (cells, cells, encoded, *TEXT)}, ("calibrate",), share=0.5),
        Kind("waypoints", "CSV logs", robot_seeds.waypoints, ("waypoints",), {"*": (cells, encoded, *TEXT)}, share=0.3),
        Kind("map of columns", "CSV logs", robot_seeds.column_map, ("torques with map",), {"map.csv": (cells, encoded, *TEXT), "*": (cells,)}, share=0.3),
        Kind("sensor", "sensor files", robot_seeds.sensor, ("sensor",), {"*": (json_values, json_values, *TEXT)}, ("sensor command",)),
        Kind("readings", "sensor readings", robot_seeds.readings, ("readings",), {"*": (cells, cells, encoded, *TEXT)}, ("sensor identify",)),
        Kind("poses", "poses", robot_seeds.readings, ("sensor poses",), {"*": (cells, *TEXT)}, share=0.2),
        Kind("CSV", "CSV logs", log_seeds.csv, LOGS, {"*": (cells, cells, encoded, *TEXT)}, LOG_COMMANDS, share=2),
        Kind("CSV in gzip", "CSV logs", log_seeds.csv_gzip, LOGS, {"*": (gzipped(cells), gzipped(encoded), *RAW)}, LOG_COMMANDS),
        Kind("joined CSV", "CSV logs", log_seeds.joined, ("motion",), {"*": (cells, *TEXT)}, ("torques",), share=0.5),
        Kind("npz", "NumPy logs", log_seeds.npz, LOGS, {"*": (*[members(array)] * 8, *RAW)}, LOG_COMMANDS),
        Kind("npy", "NumPy logs", log_seeds.npy, LOGS, {"*": (*[array] * 6, *RAW)}, LOG_COMMANDS),
        Kind("MAT", "NumPy logs", log_seeds.mat, LOGS, {"*": (matrices, matrices, *RAW)}, LOG_COMMANDS),
        Kind("MAT 7.3", "HDF5 logs", log_seeds.mat_73, ("quality", "motion"), {"*": RAW}, LOG_COMMANDS, needs=("h5py",), share=0.5),
        Kind("HDF5", "HDF5 logs", log_seeds.hdf5, LOGS, {"*": RAW}, LOG_COMMANDS, (log_seeds.hdf5_features,), needs=("h5py",), share=2),
        Kind("Parquet", "Parquet and Feather logs", log_seeds.parquet, LOGS, {"*": RAW}, LOG_COMMANDS, (log_seeds.arrow_features,), needs=("pyarrow",), share=2),
        Kind("Feather", "Parquet and Feather logs", log_seeds.feather, LOGS, {"*": RAW}, LOG_COMMANDS, needs=("pyarrow",)),
        Kind("Feather 1", "Parquet and Feather logs", log_seeds.feather_1, LOGS, {"*": (flipped, lengths)}, LOG_COMMANDS, refused=True, share=0.3, needs=("pyarrow",)),
        Kind("LeRobot", "LeRobot logs", log_seeds.lerobot, ("episode", "episode", "quality"), {"*.json": (json_values, tokens, flipped), "*": RAW}, ("log",), needs=("pyarrow",)),
        Kind("MCAP", "MCAP logs", log_seeds.mcap, LOGS, {"*": (mcap, mcap, mcap, *RAW)}, LOG_COMMANDS, needs=("mcap_ros2", "zstandard", "lz4"), share=2),
        Kind("bag of ROS 1", "ROS bags", log_seeds.bag_1, LOGS, {"*": (bag, bag, *RAW)}, LOG_COMMANDS, needs=("rosbags",)),
        Kind("database", "ROS bags", log_seeds.db3, LOGS, {"*": (database, database, *RAW)}, LOG_COMMANDS, needs=("rosbags",)),
        Kind("bag folder", "ROS bags", log_seeds.bag_folder, LOGS, {"*.yaml": (yaml_values, yaml_text, tokens), "*": (database, *RAW)}, LOG_COMMANDS, needs=("rosbags",)),
        Kind("simulation CSV", "simulation results", partial(_simulated, ".csv"), ("simulation", "motion"), {"*": (cells, *TEXT)}, ("torques",)),
        Kind("simulation npz", "simulation results", partial(_simulated, ".npz"), ("simulation", "motion"), {"*": (*[members(array)] * 4, members(tokens), *RAW)}, ("torques",)),
        Kind("kernel cache", "kernel cache", cache_entries, ("code cache",), {"*": RAW}, share=0.2, slow=True),
    )
}  # fmt: skip
