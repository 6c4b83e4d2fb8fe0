"""The rules that keep one place for each thing: what is asked of the source itself."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import tomllib
from collections import defaultdict
from pathlib import Path

import pytest
from places import ROOT
from source_trees import syntax_nodes, syntax_tree

import twistwrench as tw
from twistwrench.core.answers.answer import Answer
from twistwrench.mechanics.joints import JOINT_TYPES
from twistwrench.robot.derivatives import DerivativeMethods
from twistwrench.robot.quantities import QUANTITIES
from twistwrench.robot.quantity_methods import QuantityMethods
from twistwrench.simulation.preparation import build_run
from twistwrench.simulation.rollout_inputs import validate_inputs

SOURCE = Path(tw.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))


def named(path):
    return path.relative_to(SOURCE).as_posix()


def trees():
    return ((named(path), syntax_tree(path)) for path in FILES)


def all_nodes():
    return ((named(path), syntax_nodes(path)) for path in FILES)


def test_nothing_reaches_inside_a_robot():
    """What is built on robots asks ``robot.engine``; only the rooms of the robot itself know its private names."""
    reach = re.compile(r"\brobot\._[a-z]")
    assert not [
        f"{named(path)}: {line.strip()}"
        for path in FILES
        if not named(path).startswith("robot/")
        for line in path.read_text(encoding="utf-8").splitlines()
        if reach.search(line)
    ]


def test_joint_types_are_named_in_one_room():
    """Elsewhere a joint is asked, never which type it is: only readers of files and makers of random robots name types."""
    allowed = ("joints/", "formats/", "testing/", "robot/load.py")
    types = {*JOINT_TYPES, "rotor"}
    found = []
    for name, nodes in all_nodes():
        if name.startswith(allowed):
            continue
        for node in nodes:
            if isinstance(node, ast.Compare):
                texts = [c.value for c in ast.walk(node) if isinstance(c, ast.Constant) and isinstance(c.value, str)]
                kinds = [a for a in ast.walk(node) if isinstance(a, ast.Attribute) and a.attr == "kind"]
                if kinds and types & set(texts):
                    found.append(f"{name}:{node.lineno}")
    assert not found


def test_every_joint_type_has_every_function():
    base = {name for name, member in vars(JOINT_TYPES["ball"].__mro__[1]).items() if inspect.isfunction(member)}
    assert {"pose", "add", "subtract", "rates", "velocities", "random", "from_chart", "to_mujoco"} <= base
    for joint in JOINT_TYPES.values():
        for name in ("pose", "axes_from", "chart", "sliders"):  # those without a meaning for every type
            assert getattr(joint, name) is not getattr(JOINT_TYPES["ball"].__mro__[1], name), (joint, name)


def public_callables():
    """Functions, classes and methods that users call, by their names."""
    packages = [tw, *(getattr(tw, name) for name in dir(tw) if inspect.ismodule(getattr(tw, name)))]
    for package in packages:
        for name in getattr(package, "__all__", ()):
            value = getattr(package, name)
            if inspect.isclass(value):
                yield f"{package.__name__}.{name}", value
                for label, member in inspect.getmembers(value, inspect.isfunction):
                    if not label.startswith("_"):
                        yield f"{package.__name__}.{name}.{label}", member
            elif inspect.isfunction(value):
                yield f"{package.__name__}.{name}", value


def test_no_option_hides_in_keywords():
    """Completion and type checkers see every option: ``**options`` is a TypedDict, or is not there."""
    hidden = []
    for name, value in public_callables():
        try:
            parameters = inspect.signature(value).parameters.values()
        except ValueError:
            continue
        hidden += [name for p in parameters if p.kind is p.VAR_KEYWORD and "Unpack" not in str(p.annotation)]
    named_joints = {"twistwrench.Robot.coordinates"}  # **joints are names of the robot's own
    assert not set(hidden) - named_joints - OPEN


OPEN: set[str] = set()
"""Known to hide options still; nothing may be added."""


def kinds_of(base):
    """A class and all that derive from it."""
    return {base}.union(*map(kinds_of, base.__subclasses__()))


def test_public_data_cannot_be_changed_and_answers_and_arrays_are_not_compared_by_their_fields():
    """They may stand in sets and lists, and ``==`` raises no error: it would ask an array for its one truth."""
    public = {c for _, c in public_callables() if inspect.isclass(c)}
    answers = {c for c in kinds_of(Answer) if c.__module__.startswith("twistwrench.")} - {Answer}
    data = {c for c in public | answers | {tw.LogReport, tw.TorqueReport} if dataclasses.is_dataclass(c)}
    assert len(data) > 80 and len(answers) > 15
    assert not [c for c in data if not c.__dataclass_params__.frozen]
    with_arrays = {c for c in data if any("Array" in str(field.type) for field in dataclasses.fields(c))}
    assert len(with_arrays) > 40
    assert not [c for c in with_arrays | data & answers if c.__dataclass_params__.eq]  # an __eq__ of its own is allowed


def test_no_two_public_classes_have_one_name():
    places = defaultdict(set)
    for name, tree in trees():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].add(name)
    assert not {k: sorted(v) for k, v in places.items() if len(v) > 1}


def test_options_of_simulations_stand_once():
    """One signature serves robots, closed robots and batches; what prepares a run takes the same names, without defaults."""
    assert tw.Robot.simulate is tw.simulation.simulate
    asked = inspect.signature(tw.Robot.simulate).parameters
    assert inspect.signature(tw.Robot.simulate_batch).parameters == asked
    taken = inspect.signature(build_run).parameters
    assert [*taken] == ["robot", *[*asked][1:], "loops"]
    assert all(p.default is p.empty for p in taken.values())
    rolled = [*inspect.signature(tw.Robot.rollout).parameters][1:]
    taken = inspect.signature(validate_inputs).parameters
    assert [*taken] == ["robot", *(name for name in rolled if name not in ("gradients", "out")), "step_of"]
    assert [name for name, p in taken.items() if p.default is not p.empty] == ["step_of"]


# ── the table of quantities ──

METHODS = [name for part in (QuantityMethods, DerivativeMethods) for name in vars(part) if not name.startswith("_")]
METHODS.remove("linearize")  # which is made of quantities


@pytest.mark.parametrize("name", sorted(QUANTITIES))
def test_a_quantity_says_the_sizes_it_has(name):
    quantity = QUANTITIES[name]
    if {"constraints", "rows"} & {*quantity.options}:
        return  # their sizes are those of what is asked for
    robot = tw.robots.planar_3r()
    program = robot.program(name)
    sizes = {"nq": robot.nq, "nv": robot.nv, "links": len(robot.link_names), "bodies": len(robot.body_names)}
    sizes |= {"parameters": len(robot.parameters)}
    wanted = [tuple(sizes.get(axis) or int(axis) for axis in axes) for axes in quantity.sizes]
    assert [port.shape for port in program.outputs] == wanted
    assert [port.name for port in program.outputs] == list(quantity.outputs)


def test_every_quantity_is_a_method_or_a_part_of_one():
    parts = {
        "closure_poses", "constrained_dynamics", "constraint_bias", "constraint_jacobian", "coordinate_rates",
        "friction_under_load", "momentum_about_com", "torque_past_friction", "task_bias", "task_inertia",
    }  # fmt: skip
    methods = set(METHODS)
    assert set(QUANTITIES) - parts <= methods
    derivatives = {
        "inverse_dynamics_gradient",
        "inverse_dynamics_hessian_product",
        "mass_matrix_derivative",
        "linearize",
    }
    assert methods <= set(QUANTITIES) | derivatives


def test_the_page_of_questions_names_every_method_of_a_quantity():
    page = (ROOT / "docs" / "questions.md").read_text(encoding="utf-8")
    missing = [name for name in METHODS if f"`{name}`" not in page]
    assert not missing


# ── bugs that are put in on purpose ──


@pytest.mark.parametrize("table", sorted((ROOT / "tests" / "bugs").glob("*.toml")), ids=lambda path: path.stem)
def test_every_bug_of_the_tables_stands_once_in_its_file(table):
    """So that ``python -m tests.bugs`` can put it in: a table that has fallen behind the source would try nothing."""
    bugs = tomllib.loads(table.read_text(encoding="utf-8"))["bug"]
    lost = [b["name"] for b in bugs if (SOURCE / b["file"]).read_text(encoding="utf-8").count(b["right"]) != 1]
    assert not lost
    assert not [t for b in bugs for t in b["tests"] if not (table.parents[1] / t.partition("::")[0]).is_file()]


def test_every_extra_that_an_error_advises_exists():
    import tomllib

    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    named = {
        (path.name, extra)
        for path in (ROOT / "src").rglob("*.py")
        for extra in re.findall(r'MissingExtraError\.from_extra\(\s*"[^"]+",\s*"([^"]+)"', path.read_text("utf-8"))
    }
    assert named and not [(file, extra) for file, extra in named if extra not in extras]


# ── one place for each thing that is printed ──


def lines_with(pattern, *rooms, but=()):
    """Lines of the source that a pattern is found in, of some rooms or of all."""
    found = re.compile(pattern)
    return [
        f"{named(path)}:{k}: {line.strip()}"
        for path in FILES
        if named(path).startswith(rooms or "") and named(path) not in but
        for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if found.search(line)
    ]


def test_numbers_are_printed_by_one_module():
    """Digits, missing values, percentages: ``core/numbers.py``, in tables, pictures, messages and files alike."""
    own = ("core/numbers.py", "formats/yaml.py")  # it rounds
    assert not lines_with(r"\{[^{}]*:[+,]*(\.\d+)?[gfe%]\}", but=own)


def test_tables_are_written_by_one_module():
    assert not lines_with(r"from rich", but=("core/answers/terminal.py", "cli/terminal.py"))


def test_units_of_joints_are_derived_in_one_module():
    assert not lines_with(
        r"""(N m|rad/s)["'] if |else ["']N["']|\(["']N m["'], ["']N["']\)""", but=("mechanics/joints/units.py",)
    )


def test_colours_of_the_terminal_are_named_in_one_module():
    assert not lines_with(r"""["'](bold )?(red|green|yellow|cyan|blue|dim)["']""", but=("core/colours.py",))


def test_limits_have_one_tolerance():
    assert not lines_with(r"\b(share|most) > 1\b|1 \+ 1e-6|1 \+ TOLERANCE", but=("core/numbers.py",))


def test_gravity_is_a_number_in_one_module():
    """In code; docstrings show it as users see it."""
    numbers = [
        f"{name}:{node.lineno}"
        for name, nodes in all_nodes()
        if name != "core/gravity.py"
        for node in nodes
        if isinstance(node, ast.Constant) and node.value in (9.81, 9.80665)
    ]
    assert not numbers


def test_endings_of_columns_stand_in_one_table():
    assert not lines_with(r'"\.(vel|acc|tau|torque|effort)"', but=("motion/column_names.py",))


def test_lists_of_names_are_cut_short_in_one_module():
    """``core/text.py`` says "a, b and 3 more"."""
    assert not lines_with(
        r"""f", and \{len|" and \{len\(\w+\) - |\} in all\)""", but=("shapes/visuals.py", "motion/columns.py")
    )


def test_components_of_twists_and_wrenches_are_named_in_one_module():
    assert not lines_with(r'"(wx", "wy|mx", "my)"', but=("mechanics/lie/labelled.py",))


def test_places_of_joints_are_asked_of_the_body():
    assert not lines_with(
        r"slice\(\w+\.[qv]_index|\[[^\[]*\b[qv]_index : \w+\.[qv]_index \+", but=("mechanics/model/model.py",)
    )
