"""The ROS 2 package: compiled against stand-ins for the headers of ROS, and its test run as a plain program.

Skipped where g++ or Eigen (``cmeel-eigen``, or libeigen3-dev) is not found.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from click.testing import CliRunner
from quick import slow

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.mechanics.model.parts import disassemble

STRICT = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
STUBS = {
    "rclcpp/node_interfaces/node_parameters_interface.hpp": """
        #pragma once
        #include <memory>
        namespace rclcpp::node_interfaces {
        struct NodeParametersInterface { using ConstSharedPtr = std::shared_ptr<const NodeParametersInterface>; };
        }
    """,
    "pluginlib/class_list_macros.hpp": """
        #pragma once
        #define PLUGINLIB_EXPORT_CLASS(derived, base) static_assert(std::is_base_of_v<base, derived>);
    """,
    # Transcribed from the documentation of the interface.
    "inverse_dynamics_solver/inverse_dynamics_solver.hpp": """
        #pragma once
        #include <string>
        #include <tuple>
        #include <eigen3/Eigen/Core>
        #include <rclcpp/node_interfaces/node_parameters_interface.hpp>
        namespace inverse_dynamics_solver {
        class InverseDynamicsSolver {
        public:
          using V = Eigen::VectorXd;
          virtual ~InverseDynamicsSolver() {}
          virtual void initialize(rclcpp::node_interfaces::NodeParametersInterface::ConstSharedPtr = nullptr,
            const std::string & = "", const std::string & = "") = 0;
          virtual std::tuple<Eigen::MatrixXd, V, V> getDynamicParameters(const V & q, const V & qd) const
          { return {getInertiaMatrix(q), getCoriolisVector(q, qd), getGravityVector(q)}; }
          virtual Eigen::MatrixXd getInertiaMatrix(const V &) const = 0;
          virtual V getCoriolisVector(const V &, const V &) const = 0;
          virtual V getGravityVector(const V &) const = 0;
          virtual V getFrictionVector(const V &) const = 0;
          virtual V getTorques(const V & q, const V & qd, const V & qdd) const
          { return getInertiaMatrix(q) * qdd + getCoriolisVector(q, qd) + getGravityVector(q); }
        protected:
          InverseDynamicsSolver() {}
        };
        }
    """,
    # The few members that are used; reads one link or joint a line: "link NAME MASS", "joint NAME KIND CHILD".
    "urdf/model.h": """
        #pragma once
        #include <map>
        #include <memory>
        #include <sstream>
        #include <string>
        namespace urdf {
        struct Joint { enum { FIXED = 6, REVOLUTE = 1 }; int type; std::string name; };
        struct Inertial { double mass; };
        struct Link { std::shared_ptr<Inertial> inertial; std::shared_ptr<Joint> parent_joint; };
        struct Model {
          std::map<std::string, std::shared_ptr<Link>> links_;
          std::map<std::string, std::shared_ptr<Joint>> joints_;
          bool initString(const std::string & text) {
            std::istringstream in(text);
            for (std::string what, name, kind, child; in >> what >> name;) {
              if (what == "link") {
                double mass; in >> mass;
                links_[name] = std::make_shared<Link>(Link{std::make_shared<Inertial>(Inertial{mass}), nullptr});
              } else {
                in >> kind >> child;
                joints_[name] = std::make_shared<Joint>(Joint{kind == "fixed" ? Joint::FIXED : Joint::REVOLUTE, name});
                links_.at(child)->parent_joint = joints_[name];
              }
            }
            return !links_.empty();
          }
        };
        }
    """,
    "gtest/gtest.h": """
        #pragma once
        #include <cmath>
        #include <cstdio>
        extern int failures;
        extern int checks;
        #define TEST(suite, name) void name()
        #define EXPECT_NEAR(a, b, most) (++checks, std::abs((a) - (b)) <= (most) ? 0 : ++failures)
        #define EXPECT_THROW(what, error) try { what; ++failures; } catch (const error &) { ++checks; }
    """,
}
MAIN = """
#include <fstream>
#include <iostream>
#include <sstream>
#include "NAME/solver.hpp"
int failures = 0, checks = 0;
void AgreesAtStoredStates();
void RefusesVectorsOfAnotherSizeAndAnEmptyDescription();
int main(int count, char ** files)
{
  AgreesAtStoredStates();
  RefusesVectorsOfAnotherSizeAndAnEmptyDescription();
  for (int k = 1; k < count; ++k) {
    std::ifstream file(files[k]);
    std::stringstream text;
    text << file.rdbuf();
    NAME::Solver solver;
    try { solver.initialize(nullptr, "", text.str()); std::cout << "fine\\n"; }
    catch (const std::exception & error) { std::cout << error.what() << "\\n"; }
  }
  std::cout << checks << " checks, " << failures << " failures\\n";
  return failures > 0;
}
"""


def eigen() -> Path | None:
    """Folder that holds eigen3/Eigen."""
    places = [Path("/usr/include"), *(Path(entry) / "cmeel.prefix" / "include" for entry in sys.path)]
    return next((p for p in places if (p / "eigen3" / "Eigen" / "Core").is_file()), None)


built = pytest.mark.skipif(not shutil.which("g++") or eigen() is None, reason="g++ or Eigen is not found")


def described(robot, changed=()):
    """The robot in the words of the stand-in for urdf, with some of its lines replaced."""
    text = [f"link {link} {x.mass!r}" for link, x in robot.model.link_inertias.items()]
    kinds = {
        entry: "revolute" if entry.name in robot.joint_names else "fixed" for entry in disassemble(robot.model).joints
    }
    text += [f"joint {entry.name} {kind} {entry.child}" for entry, kind in kinds.items()]
    for before, after in changed:
        assert any(re.search(before, line) for line in text), before
        text = [re.sub(before, after, line) for line in text]
    return "\n".join(text)


@built
@pytest.mark.parametrize("name", ["planar_2r", *slow("ur5", "panda")])
def test_it_compiles_without_a_warning_and_its_own_test_passes(bundled, name, tmp_path):
    plain = bundled(name)
    robot = plain.with_payload(tw.SpatialInertia.from_com(2.0, (0, 0, 0.1)))
    package = f"{name}_dynamics"
    files = robot.export_ros2(tmp_path / package)
    assert all(file.is_file() for file in files) and len(files) == 9
    for path, text in STUBS.items():
        (tmp_path / "stubs" / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "stubs" / path).write_text(text)
    (tmp_path / "main.cpp").write_text(MAIN.replace("NAME", package))
    (first, second) = plain.joint_names[:2]
    carried = next(e.child for e in disassemble(plain.model).joints if e.name == second)
    cases = {
        "same": (described(plain), "fine"),
        "fixed": (
            described(plain, [(f"joint {first} revolute", f"joint {first} fixed")]),
            f"joint {first} does not move",
        ),
        "renamed": (described(plain, [(f"joint {first} ", "joint other ")]), f"joint {first} does not move"),
        "heavy": (
            described(plain, [(rf"link {carried} .*", f"link {carried} 99")]),
            f"joint {second} carries link {carried}",
        ),
        "light": (
            described(plain, [(rf"link {carried} .*", f"link {carried} 0.01")]),
            f"joint {second} carries link {carried}",
        ),
        "less": (
            described(plain, [(rf"link {carried} .*", "link a 0"), (f" {carried}$", " a")]),
            f"carries link {carried}",
        ),
    }
    for case, (text, _) in cases.items():
        (tmp_path / case).write_text(text)
    src = tmp_path / package
    subprocess.run(["gcc", "-std=c99", "-O1", "-c", src / "src/dynamics.c", "-o", tmp_path / "dynamics.o"], check=True)
    include = [
        "-I",
        src / "include",
        "-isystem",
        tmp_path / "stubs",
        "-isystem",
        eigen(),
        "-isystem",
        eigen() / "eigen3",
    ]
    sources = [src / "src/solver.cpp", src / "test/test_solver.cpp", tmp_path / "main.cpp"]
    command = ["g++", *STRICT, *include, *sources, tmp_path / "dynamics.o", "-lm", "-o", tmp_path / "check"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr
    said = subprocess.run([tmp_path / "check", *(tmp_path / c for c in cases)], capture_output=True, text=True)
    *found, last = said.stdout.splitlines()
    assert re.fullmatch(r"\d{2,} checks, 0 failures", last) and said.returncode == 0, said.stdout
    for line, (_, words) in zip(found, cases.values(), strict=True):
        assert words in line


def test_the_files_name_each_other_and_what_is_needed(bundled, tmp_path):
    robot = bundled("panda")
    robot.export_ros2(tmp_path / "panda_dynamics", license="BSD-3-Clause")
    package = ET.parse(tmp_path / "panda_dynamics" / "package.xml").getroot()
    assert (package.find("name").text, package.find("license").text) == ("panda_dynamics", "BSD-3-Clause")
    needs = {x.text for x in package.findall("depend")}
    assert needs == {"eigen", "inverse_dynamics_solver", "pluginlib", "rclcpp", "urdf"}
    plugin = ET.parse(tmp_path / "panda_dynamics" / "plugin.xml").getroot()
    assert plugin.get("path") == "panda_dynamics"
    assert plugin.find("class").get("base_class_type") == "inverse_dynamics_solver::InverseDynamicsSolver"
    cmake = (tmp_path / "panda_dynamics" / "CMakeLists.txt").read_text()
    assert "pluginlib_export_plugin_description_file(inverse_dynamics_solver plugin.xml)" in cmake
    for name in needs - {"eigen"}:
        assert f"find_package({name} REQUIRED)" in cmake
    for name in re.findall(r"[\w/]+\.(?:cpp|c)\b", cmake):
        assert (tmp_path / "panda_dynamics" / name).is_file()
    assert "not tried" in (tmp_path / "panda_dynamics" / "README.md").read_text()
    assert not any(
        "@" in file.read_text().replace("nobody@example.org", "") for file in (tmp_path / "panda_dynamics").rglob("*.*")
    )


def test_the_command_writes_what_the_library_writes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(
        main, ["export", "planar_2r", "--ros2", "one_dynamics", "--payload", "2", "--license", "MIT"]
    )
    assert result.exit_code == 0, result.output
    assert "it carries 2 kg at" in (tmp_path / "one_dynamics" / "README.md").read_text()
    assert "<license>MIT</license>" in (tmp_path / "one_dynamics" / "package.xml").read_text()


BAD = {
    "name": (["--ros2", "Arm-Dynamics"], "not the name of a ROS package"),
    "there": (["--ros2", "there"], "is there already"),
    "no folder": (["--ros2", "none/arm"], "cannot be made"),
    "license": (["--ros2", "arm", "--license", "<b>"], "license is"),
    "gravity": (["--ros2", "arm", "--gravity-input"], "do not apply to --ros2"),
}


@pytest.mark.parametrize(("arguments", "words"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line_and_writes_nothing(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    result = CliRunner().invoke(main, ["export", "planar_2r", *arguments])
    assert result.exit_code == 2 and words in result.output and result.output.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["there"]


def test_joints_of_several_coordinates_are_named(bundled, tmp_path):
    with pytest.raises(tw.KernelError, match="have several coordinates"):
        bundled("floating_box").export_ros2(tmp_path / "box_dynamics")
    assert not any(tmp_path.iterdir())
