"""Export as a ROS 2 package: a plug-in of ``inverse_dynamics_solver`` around the C functions of a robot.

Source of the interface: inverse_dynamics_solver.hpp of unisa-acg/inverse-dynamics-solver. The plug-in overrides its
five pure virtual methods and ``getTorques``.
"""

from __future__ import annotations

import re
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np

from ...core.errors import KernelError, ValueRangeError
from ...core.glossary import complete
from ...core.numbers import number
from ...core.typing import Array
from .c99 import header, source
from .request import requests
from .self_test import STATES
from .written import Written

if TYPE_CHECKING:
    from .. import Robot

_QUANTITIES = ("mass_matrix", "coriolis_forces", "gravity_forces", "inverse_dynamics", "friction_forces")
"""Quantities that the plug-in calls."""

# Templates of the files; @WORD@ is replaced.

_PACKAGE = """\
<?xml version="1.0"?>
<package format="3">
  <name>@NAME@</name>
  <version>1.0.0</version>
  <description>Inverse dynamics of the robot @ROBOT@ for inverse_dynamics_solver. By twistwrench @VERSION@.</description>
  <maintainer email="nobody@example.org">your name</maintainer>
  <license>@LICENSE@</license>

  <buildtool_depend>ament_cmake</buildtool_depend>

  <depend>eigen</depend>
  <depend>inverse_dynamics_solver</depend>
  <depend>pluginlib</depend>
  <depend>rclcpp</depend>
  <depend>urdf</depend>

  <test_depend>ament_cmake_gtest</test_depend>

  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""

_CMAKE = """\
cmake_minimum_required(VERSION 3.8)
project(@NAME@ LANGUAGES C CXX)

find_package(ament_cmake REQUIRED)
find_package(Eigen3 REQUIRED)
find_package(inverse_dynamics_solver REQUIRED)
find_package(pluginlib REQUIRED)
find_package(rclcpp REQUIRED)
find_package(urdf REQUIRED)

add_library(@NAME@ SHARED src/solver.cpp src/dynamics.c)
target_compile_features(@NAME@ PUBLIC c_std_99 cxx_std_17)
target_include_directories(@NAME@ PUBLIC
  $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include> $<INSTALL_INTERFACE:include>)
ament_target_dependencies(@NAME@ Eigen3 inverse_dynamics_solver pluginlib rclcpp urdf)
if(CMAKE_C_COMPILER_ID STREQUAL "GNU")
  target_compile_options(@NAME@ PRIVATE $<$<COMPILE_LANGUAGE:C>:-ffp-contract=off>)
endif()

pluginlib_export_plugin_description_file(inverse_dynamics_solver plugin.xml)

install(DIRECTORY include/ DESTINATION include)
install(TARGETS @NAME@ EXPORT export_@NAME@
  ARCHIVE DESTINATION lib LIBRARY DESTINATION lib RUNTIME DESTINATION bin)

if(BUILD_TESTING)
  find_package(ament_cmake_gtest REQUIRED)
  ament_add_gtest(test_solver test/test_solver.cpp)
  target_link_libraries(test_solver @NAME@)
endif()

ament_export_targets(export_@NAME@)
ament_export_dependencies(Eigen3 inverse_dynamics_solver pluginlib rclcpp urdf)
ament_package()
"""

_PLUGIN = """\
<library path="@NAME@">
  <class name="@NAME@/Solver" type="@NAME@::Solver" base_class_type="inverse_dynamics_solver::InverseDynamicsSolver">
    <description>Inverse dynamics of the robot @ROBOT@.</description>
  </class>
</library>
"""

_HEADER = """\
// Inverse dynamics of one robot for inverse_dynamics_solver. Written by twistwrench @VERSION@.
#pragma once

#include <string>

#include <inverse_dynamics_solver/inverse_dynamics_solver.hpp>

namespace @NAME@
{

/// Vectors are in the order of JOINTS, in SI units and radians. The methods allocate their results only and keep no state.
class Solver : public inverse_dynamics_solver::InverseDynamicsSolver
{
public:
  static constexpr const char * JOINTS[] = {@JOINTS@};
  static constexpr int SIZE = @SIZE@;

  /// Compare joints and masses with the robot description; std::runtime_error names the joint that differs.
  void initialize(
    rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr parameters_interface = nullptr,
    const std::string & param_namespace = "", const std::string & robot_description = "") override;

  Eigen::MatrixXd getInertiaMatrix(const Eigen::VectorXd & q) const override;
  Eigen::VectorXd getCoriolisVector(const Eigen::VectorXd & q, const Eigen::VectorXd & qd) const override;
  Eigen::VectorXd getGravityVector(const Eigen::VectorXd & q) const override;
  Eigen::VectorXd getFrictionVector(const Eigen::VectorXd & qd) const override;

  /// By the recursive Newton-Euler algorithm, friction left out.
  Eigen::VectorXd getTorques(
    const Eigen::VectorXd & q, const Eigen::VectorXd & qd, const Eigen::VectorXd & qdd) const override;
};

}  // namespace @NAME@
"""

_SOURCE = """\
#include "@NAME@/solver.hpp"

#include <cmath>
#include <map>
#include <stdexcept>

#include <pluginlib/class_list_macros.hpp>
#include <urdf/model.h>

#include "dynamics.h"

namespace @NAME@
{

namespace
{

/// Mass of each link, payloads left out [kg]; that of the root is not compared.
const std::map<std::string, double> MASSES = {
@MASSES@
};

const double * checked(const Eigen::VectorXd & x, const char * name)
{
  if (x.size() != Solver::SIZE) {
    throw std::invalid_argument(
      std::string(name) + " has " + std::to_string(x.size()) + " entries, expected " + std::to_string(Solver::SIZE));
  }
  return x.data();
}

}  // namespace

void Solver::initialize(
  rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr, const std::string &,
  const std::string & robot_description)
{
  urdf::Model model;
  if (robot_description.empty() || !model.initString(robot_description)) {
    throw std::runtime_error("@NAME@: robot_description is empty or not URDF, so its joints cannot be compared");
  }
  for (const char * name : JOINTS) {
    const auto found = model.joints_.find(name);
    if (found == model.joints_.end() || found->second->type == urdf::Joint::FIXED) {
      throw std::runtime_error(std::string("@NAME@: joint ") + name + " does not move in robot_description");
    }
  }
  std::map<std::string, double> missing = MASSES;
  for (const auto & [name, link] : model.links_) {
    missing.erase(name);
    if (!link->parent_joint) {
      continue;
    }
    const double mass = link->inertial ? link->inertial->mass : 0.0;
    const auto known = MASSES.find(name);
    const double expected = known == MASSES.end() ? 0.0 : known->second;
    if (std::abs(mass - expected) > 1e-6 * std::abs(expected) + 1e-12) {
      throw std::runtime_error(
        "@NAME@: joint " + link->parent_joint->name + " carries link " + name + " of " + std::to_string(mass) +
        " kg in robot_description, and of " + std::to_string(expected) + " kg in the exported robot");
    }
  }
  for (const auto & [name, mass] : missing) {
    if (mass > 0.0) {
      throw std::runtime_error("@NAME@: no joint of robot_description carries link " + name);
    }
  }
}

Eigen::MatrixXd Solver::getInertiaMatrix(const Eigen::VectorXd & q) const
{
  Eigen::MatrixXd M(SIZE, SIZE);  // symmetric, so rows and columns are alike
  @NAME@_mass_matrix(checked(q, "q"), M.data());
  return M;
}

Eigen::VectorXd Solver::getCoriolisVector(const Eigen::VectorXd & q, const Eigen::VectorXd & qd) const
{
  Eigen::VectorXd c(SIZE);
  @NAME@_coriolis_forces(checked(q, "q"), checked(qd, "qd"), c.data());
  return c;
}

Eigen::VectorXd Solver::getGravityVector(const Eigen::VectorXd & q) const
{
  Eigen::VectorXd g(SIZE);
  @NAME@_gravity_forces(checked(q, "q"), g.data());
  return g;
}

Eigen::VectorXd Solver::getFrictionVector(const Eigen::VectorXd & qd) const
{
  Eigen::VectorXd friction(SIZE);
  @NAME@_friction_forces(checked(qd, "qd"), friction.data());
  return friction;
}

Eigen::VectorXd Solver::getTorques(
  const Eigen::VectorXd & q, const Eigen::VectorXd & qd, const Eigen::VectorXd & qdd) const
{
  Eigen::VectorXd tau(SIZE);
  @NAME@_inverse_dynamics(checked(q, "q"), checked(qd, "qd"), checked(qdd, "qdd"), tau.data());
  return tau;
}

}  // namespace @NAME@

PLUGINLIB_EXPORT_CLASS(@NAME@::Solver, inverse_dynamics_solver::InverseDynamicsSolver)
"""

_TEST = """\
// Each method at @STATES@ states, against the numbers of twistwrench.
#include <stdexcept>

#include <gtest/gtest.h>

#include "@NAME@/solver.hpp"

namespace
{

constexpr int N = @NAME@::Solver::SIZE;
@DATA@

Eigen::VectorXd vector(const double * data) {return Eigen::Map<const Eigen::VectorXd>(data, N);}

void near(const Eigen::MatrixXd & found, const double * data)
{
  const Eigen::Map<const Eigen::VectorXd> wanted(data, found.size());
  const double size = wanted.cwiseAbs().maxCoeff() + 1e-300;
  for (Eigen::Index k = 0; k < found.size(); ++k) {
    EXPECT_NEAR(found.data()[k] / size, wanted[k] / size, 1e-12);
  }
}

}  // namespace

TEST(Solver, AgreesAtStoredStates)
{
  const @NAME@::Solver solver;
  for (int k = 0; k < @STATES@; ++k) {
    const Eigen::VectorXd q = vector(Q[k]), qd = vector(QD[k]), qdd = vector(QDD[k]);
    near(solver.getInertiaMatrix(q), INERTIA[k]);
    near(solver.getCoriolisVector(q, qd), CORIOLIS[k]);
    near(solver.getGravityVector(q), GRAVITY[k]);
    near(solver.getFrictionVector(qd), FRICTION[k]);
    near(solver.getTorques(q, qd, qdd), TORQUES[k]);
  }
}

TEST(Solver, RefusesVectorsOfAnotherSizeAndAnEmptyDescription)
{
  @NAME@::Solver solver;
  EXPECT_THROW(solver.getGravityVector(Eigen::VectorXd::Zero(N + 1)), std::invalid_argument);
  EXPECT_THROW(solver.initialize(nullptr, "", ""), std::runtime_error);
}
"""

_README = """\
# @NAME@

Inverse dynamics of the robot @ROBOT@ as a plug-in of [inverse_dynamics_solver](https://github.com/unisa-acg/inverse-dynamics-solver),
written by twistwrench @VERSION@. Class `@NAME@/Solver`; build it with colcon beside inverse_dynamics_solver.

- Order of all vectors: @ORDER@. SI units, radians. Reorder the values of a controller that has another order.
- Gravity, payloads and rotors of the exported robot are in the numbers@CARRIED@. Gravity: (@GRAVITY@) m/s² in the base frame.
- `getTorques` is M q̈ + C q̇ + g without friction; add `getFrictionVector`, which is zero if the robot's file gives none.
- `initialize` compares `robot_description` with the exported robot: each of these joints moves there, and each link but the
  root has the same mass, payloads left out. Otherwise it throws std::runtime_error and names the joint. Joints that are there
  and not in the list count as locked where they were when the robot was exported.
- `test/test_solver.cpp` compares all methods with stored results (`colcon test`).

## Not verified

The sources were compiled with g++ and Eigen against stand-ins for the headers of ROS, and the test passed. **colcon, CMake and
loading through pluginlib were not tried.** Name the maintainer in `package.xml` before you publish the package.
"""


def export_ros2(
    robot: Robot,
    path: str | Path,
    *,
    license: str = "Apache-2.0",  # noqa: A002
    label: str = "path",
) -> Written:
    """ROS 2 package export; see :meth:`twistwrench.Robot.export_ros2`.

    Parameters
    ----------
    path : str or Path, folder to create; its last part is the package name
    license : str, for package.xml
    label : str, name of ``path`` in messages

    Returns
    -------
    files : Written, a tuple of Path

    Raises
    ------
    KernelError, ValueRangeError
        As :meth:`twistwrench.Robot.export_ros2`.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     len(export_ros2(tw.robots.planar_2r(), f"{folder}/arm_dynamics"))
    9
    """
    folder = Path(path)
    if not re.fullmatch(r"[a-z](_?[a-z0-9])*", folder.name):
        raise ValueRangeError(
            f"{label} {str(path)!r}: its last part is not the name of a ROS package. Use lower-case letters, digits and single "
            "underscores, a letter first, such as arm_dynamics."
        )
    if not isinstance(license, str) or not re.fullmatch(r"[A-Za-z0-9.+ -]+", license):
        raise ValueRangeError(f"license is {license!r}: give the name of a license, such as Apache-2.0 or Proprietary.")
    problem = ""
    if folder.exists():
        problem = "is there already"
    elif not folder.parent.is_dir():
        problem = "cannot be made: the folder above it is not there"
    if problem:
        raise ValueRangeError(f"{label} {str(path)!r} {problem}. Name a new folder inside one that exists.")
    text_by_file = _texts(robot, folder.name, license)
    try:
        # The folder is renamed when it is complete, so that no part of a package is left behind.
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as scratch:
            package = Path(scratch) / folder.name
            for name, text in text_by_file.items():
                file = package / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(text, encoding="utf-8", newline="\n")
            package.rename(folder)
    except OSError as error:
        raise ValueRangeError(
            f"cannot write {str(path)!r}: {error.strerror}. Free space, or give another name."
        ) from None
    return Written([folder / name for name in text_by_file], folder, robot.name)


def _texts(robot: Robot, name: str, license: str) -> dict[str, str]:  # noqa: A002
    """Text of each file of the package, by path within it."""
    unsupported_joints = [body.joint.name for body in robot.model.leaders if body.joint.nv != 1]
    if unsupported_joints:
        raise KernelError(
            f"joints {', '.join(unsupported_joints)} of robot {robot.name!r} have several coordinates, and the vectors of the "
            "ROS interface have one for each joint. Lock them, or fix the base."
        )
    exports = requests(robot, _QUANTITIES, "double", name)
    joints = [body.joint.name for body in robot.model.leaders]
    payloads = robot.model.payloads
    masses = {}  # of links without their payloads [kg]
    for link, inertia in robot.model.link_inertias.items():
        payload_mass = sum(payload.mass for frame, payload in payloads if frame == link)
        masses[link] = float(inertia.mass - payload_mass)
    printable_name = "".join(character for character in robot.name if character.isprintable())
    text_by_word = {  # text in place of each @WORD@ of the templates
        "NAME": name,
        "ROBOT": escape(printable_name),
        "VERSION": version("twistwrench"),
        "LICENSE": escape(license),
        "JOINTS": ", ".join(map(_cpp_string, joints)),
        "ORDER": ", ".join(joints),
        "SIZE": str(robot.nv),
        "STATES": str(STATES),
        "GRAVITY": ", ".join(f"{number(g)}" for g in robot.gravity),
        "CARRIED": "".join(f"; it carries {number(payload.mass)} kg at {frame}" for frame, payload in payloads),
        "MASSES": ",\n".join(f"  {{{_cpp_string(link)}, {mass!r}}}" for link, mass in masses.items()),
        "DATA": _data(robot),
    }

    def fill(template: str) -> str:
        return re.sub(r"@([A-Z]+)@", lambda match: text_by_word[match[1]], template)

    return {
        "package.xml": fill(_PACKAGE),
        "CMakeLists.txt": fill(_CMAKE),
        "plugin.xml": fill(_PLUGIN),
        f"include/{name}/solver.hpp": fill(_HEADER),
        "src/solver.cpp": fill(_SOURCE),
        "src/dynamics.h": header(robot, exports, "dynamics", name),
        "src/dynamics.c": source(robot, exports, "dynamics"),
        "test/test_solver.cpp": fill(_TEST),
        "README.md": fill(_README),
    }


def _cpp_string(text: str) -> str:
    """C++ string literal in ASCII."""
    characters = "".join(map(_cpp_character, text))
    return f'"{characters}"'


def _cpp_character(character: str) -> str:
    """Character of a C++ string literal; octal bytes unless it is plain ASCII."""
    if character.isascii() and character.isprintable() and character not in '"\\?':
        return character
    return "".join(f"\\{byte:03o}" for byte in character.encode())


def _data(robot: Robot) -> str:
    """States and results as constant arrays, with exact literals."""
    rng = np.random.default_rng(0)
    q = robot.random_configuration(rng, STATES)
    qd, qdd = rng.standard_normal((2, STATES, robot.nv))
    tables = {
        "Q": q,
        "QD": qd,
        "QDD": qdd,
        "INERTIA": robot.mass_matrix(q),
        "CORIOLIS": robot.coriolis_forces(q, qd),
        "GRAVITY": robot.gravity_forces(q),
        "FRICTION": robot.friction_forces(qd),
        "TORQUES": robot.inverse_dynamics(q, qd, qdd),
    }
    table_texts = []
    for name, values in tables.items():
        table = np.asarray(values, float).reshape(STATES, -1)
        table_texts.append(_table_text(name, table))
    return "\n".join(table_texts)


def _table_text(name: str, table: Array) -> str:
    """C++ array with a row for each state; hexadecimal literals are exact."""
    row_texts = []
    for row in table:
        literals = ", ".join(float(x).hex() for x in row)
        row_texts.append(f"  {{{literals}}}")
    rows_text = ",\n".join(row_texts)
    return f"const double {name}[{STATES}][{table.shape[1]}] = {{\n{rows_text}}};"


complete(globals())
