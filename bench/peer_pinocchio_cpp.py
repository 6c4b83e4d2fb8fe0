"""Pinocchio in C++, compiled on the spot: the wheel's headers, instantiated by each compiler found, nothing linked.

The wheel's own build is slower than its code can be, so the yardstick is the best of several builds. They are kept
under `bench/build`, by a hash of all that went into them: each takes a compiler a few minutes and up to 5 GB.
"""

import ctypes
import hashlib
import shutil
import subprocess
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import distribution, version
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from bench.cases import DERIVATIVES, MATRICES, Case, States
from bench.peer_pinocchio import completed
from bench.timing import Contender

NAME = "Pinocchio C++"
SOURCE = Path(__file__).with_name("pinocchio.cpp")
BUILDS = Path(__file__).with_name("build")
# Not -ffast-math: it gains nothing here, and a library linked with it makes the whole process flush denormals to zero.
COMMANDS = ("clang++ -O3 -march=native", "clang++ -O3", "g++ -O3 -march=native")
# What Pinocchio's CMake files define for users of its headers.
DEFINITIONS = (
    "-DNDEBUG",
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
)
LANGUAGE = ("-std=c++17", "-fPIC", "-shared", "-fvisibility=hidden")
DOUBLES = ctypes.POINTER(ctypes.c_double)


class MissingError(RuntimeError):
    """Why this row of the table cannot be had here, and how to get it."""


@dataclass(frozen=True)
class Build:
    """One compiled library."""

    name: str  # e.g. "clang++ -O3 -march=native"
    compiler: str  # its first line about itself
    library: ctypes.CDLL


def builds() -> tuple[list[Build], dict[str, str]]:
    """Compile what is not yet compiled. Second come the rows that cannot be had: why, and what to do about it."""
    done: list[Build] = []
    missing: dict[str, str] = {}
    for command in COMMANDS:
        compiler = command.split()[0]
        if not shutil.which(compiler):
            package = compiler.replace("clang++", "clang")
            missing[f"{NAME}, {command}"] = f"no {compiler}: `apt install {package} libeigen3-dev`"
            continue
        try:
            done.append(_build(command, _eigen()))
        except MissingError as error:
            missing[f"{NAME}, {command}"] = str(error)
        except subprocess.CalledProcessError as error:
            missing[f"{NAME}, {command}"] = f"Pinocchio's headers did not compile: {_first_error(error.stderr)}"
    if not done:
        missing = {NAME: next(iter(missing.values()))}
    return done, missing


def _eigen() -> Path:
    """The folder to include Eigen from: the wheels' own, if there, else the system's."""
    wheels = Path(str(distribution("libpinocchio").locate_file("cmeel.prefix/include")))
    if not (wheels / "pinocchio").is_dir():
        raise MissingError("the pin wheel brings no headers: install `pin` from PyPI, not from elsewhere")
    for prefix in (wheels, Path("/usr/include"), Path("/usr/local/include"), Path("/opt/homebrew/include")):
        if (prefix / "eigen3/Eigen/Core").is_file():
            return prefix / "eigen3"
    raise MissingError("no Eigen headers: `apt install libeigen3-dev`, or `brew install eigen`")


def _build(command: str, eigen: Path) -> Build:
    compiler, *optimisation = command.split()
    about = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout.splitlines()[0]
    include = Path(str(distribution("libpinocchio").locate_file("cmeel.prefix/include")))
    flags = [*optimisation, *LANGUAGE, *DEFINITIONS, "-isystem", str(include), "-isystem", str(eigen)]
    key = "\n".join([about, version("libpinocchio"), _cpu_flags(), *flags, SOURCE.read_text()])
    path = BUILDS / f"pinocchio_{hashlib.sha256(key.encode()).hexdigest()[:16]}.so"
    if not path.exists():
        print(f"  compiling Pinocchio with {command} (a few minutes, once) …", flush=True)
        BUILDS.mkdir(exist_ok=True)
        draft = path.with_suffix(".tmp")
        subprocess.run([compiler, *flags, str(SOURCE), "-o", str(draft)], capture_output=True, text=True, check=True)
        draft.rename(path)
    library = ctypes.CDLL(str(path))
    library.robot_new.restype = ctypes.c_void_p
    return Build(command, about, library)


def _first_error(output: str) -> str:
    lines = output.splitlines()
    return next((line for line in lines if "error" in line), lines[0] if lines else "no message")


def _cpu_flags() -> str:
    """What -march=native depends on."""
    cpuinfo = Path("/proc/cpuinfo")
    if not cpuinfo.exists():
        return ""
    return next((line for line in cpuinfo.read_text().splitlines() if line.startswith("flags")), "")


class PinocchioCpp:
    """One robot in one build."""

    def __init__(self, case: Case, build: Build) -> None:
        self.build, self.model, self.batch = build, case.model, case.batch
        self.robot = ctypes.c_void_p(build.library.robot_new())
        weakref.finalize(self, build.library.robot_delete, self.robot)
        for kind, *arguments in _joints(self.model):
            if not build.library.robot_add_joint(self.robot, kind.encode(), *arguments):
                raise MissingError(f"{SOURCE.name} knows no joint of kind {kind}")
        tip = self.model.frames[self.model.getFrameId(case.tip, pin.BODY)]
        build.library.robot_finish(self.robot, ctypes.c_long(tip.parentJoint), *_placement(tip.placement))

    def evaluate(self, quantity: str, states: States) -> np.ndarray:
        nv, size = self.model.nv, len(states)
        # column-major on that side, so the last two axes are swapped here
        several = {name: (MATRICES[name], nv, nv) for name in DERIVATIVES}
        shape = {"mass_matrix": (nv, nv), "jacobian": (nv, 6), **several}.get(quantity, (nv,))
        values = np.empty((size, *shape))
        for row, state in zip(values, zip(*_inputs(quantity, states), strict=True), strict=True):
            self.build.library.robot_evaluate(self.robot, quantity.encode(), *map(_pointer, state), _pointer(row))
        return completed(quantity, values if values.ndim == 2 else np.swapaxes(values, -1, -2))

    def contenders(self, quantity: str, states: States) -> list[Contender]:
        """A loop in C++ over the headline's batch of states."""
        states = states[: self.batch]
        arrays = _inputs(quantity, states)
        run, robot, name, size = self.build.library.robot_run, self.robot, quantity.encode(), ctypes.c_long(len(states))
        pointers = [_pointer(each) for each in arrays]  # they keep their arrays alive

        def sweep(times: int) -> None:
            run(robot, name, ctypes.c_long(times), size, *pointers)

        return [Contender(f"{NAME}, {self.build.name}", sweep, len(states))]


def _inputs(quantity: str, states: States) -> tuple[np.ndarray, ...]:
    """Always three arrays: what a quantity does not use is not read."""
    return states.q, states.dq, states.tau if quantity.startswith("forward_dynamics") else states.ddq


def _joints(model: pin.Model) -> Iterator[tuple[Any, ...]]:
    for joint, parent, placement, body in zip(
        list(model.joints)[1:],
        list(model.parents)[1:],
        list(model.jointPlacements)[1:],
        list(model.inertias)[1:],
        strict=True,
    ):
        inertia = ctypes.c_double(body.mass), _doubles(body.lever), _doubles(body.inertia)
        yield joint.shortname(), ctypes.c_long(parent), *_placement(placement), *inertia


def _placement(pose: pin.SE3) -> tuple[object, object]:
    return _doubles(pose.rotation), _doubles(pose.translation)


def _doubles(values: np.ndarray) -> object:
    return _pointer(np.ascontiguousarray(values, dtype=float).ravel())


def _pointer(values: np.ndarray) -> object:
    return values.ctypes.data_as(DOUBLES)
