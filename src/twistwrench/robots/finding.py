"""Robots by name: bundled, from ``example-robot-data``, or in the cache of ``robot_descriptions``."""

from __future__ import annotations

import ast
import difflib
import importlib
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

from ..core.errors import MissingExtraError, NotFoundError, UnknownNameError
from ..core.first_calls import similar_names
from ..core.text import shorten
from . import names, path_of

_EXAMPLES_FOLDER = "cmeel.prefix/share/example-robot-data/robots"
"""Folder of ``example-robot-data`` in the folder of installed packages."""
_FILE_SUFFIXES = (".urdf", ".sdf")
_FOLDER_ENDINGS = ("_simple_description", "_description", "_data")
"""Endings of robot folders after the robot's name."""
_DESCRIPTIONS_PACKAGE = "robot_descriptions"
_PATH_NAMES = ("URDF_PATH", "MJCF_PATH")
"""Names that the modules of this package give to the path of the robot file, in order of preference."""


@dataclass(frozen=True)
class FoundRobot:
    """Named robot file."""

    name: str
    """Name in the form of :func:`plain_name`."""
    source: str
    """Package of the file: ``twistwrench``, ``example-robot-data``, ``robot_descriptions``."""
    path: Path
    """Path of the robot file."""


def find(name: str, *, download: bool = False) -> Path:
    """Find the file of a robot by name: bundled, in ``example-robot-data``, or in the cache of ``robot_descriptions``.

    Parameters
    ----------
    name : str, case-insensitive, such as ``"talos"``, ``"anymal_b"``, ``"panda_mj"``
    download : bool, allow ``robot_descriptions`` to download missing robots; by default nothing is downloaded

    Returns
    -------
    path : Path, for :func:`twistwrench.load`

    Raises
    ------
    MissingExtraError
        ``download=True``, and ``robot_descriptions`` is not installed.
    NotFoundError
        ``download=True``, and the download failed.

    Notes
    -----
    Installed packages are searched in this order without importing them. Files of the same robot may differ between
    packages. ``twistwrench robots`` lists the names.

    Examples
    --------
    >>> import twistwrench as tw
    >>> tw.find("UR5") == tw.robots.path_of("ur5")
    True
    """
    robot_name = plain_name(name) if isinstance(name, str) else ""
    if robot_name in names():  # bundled robots need no search
        return path_of(robot_name)
    robots = known_robots()
    if robot_name in robots:
        return robots[robot_name].path
    if download:
        return _download(robot_name, name)
    raise UnknownNameError.from_choices("robot", name, robots)


def robot_file(source: str) -> Path:
    """Path of a robot file, or of the robot of this name; a file takes precedence. Raises NotFoundError with similar names."""
    with suppress(OSError, ValueError):  # the name may be too long for a file
        if Path(source).exists():
            return Path(source)
    robots = known_robots()
    robot_name = plain_name(source)
    if robot_name in robots:
        return robots[robot_name].path
    similar = similar_names(robot_name, robots, cutoff=0.6)
    hint = f" Did you mean {similar}?" if similar else ""
    raise NotFoundError(
        f"no robot file {shorten(source)!r}, and no bundled robot of that name, nor one of another package.{hint} "
        "Give a path, or a name that `twistwrench robots` lists."
    )


def known_robots() -> dict[str, FoundRobot]:
    """Every robot that :func:`twistwrench.find` finds without a download, by name; the first source takes precedence."""
    robots: dict[str, FoundRobot] = {}
    for robot in chain(_bundled_robots(), _example_robots(), _cached_descriptions()):
        robots.setdefault(robot.name, robot)
    return robots


def plain_name(name: str) -> str:
    """Normalised name for comparison: lower case, ``_`` for blanks and dashes."""
    return name.strip().lower().replace("-", "_").replace(" ", "_")


def _bundled_robots() -> Iterator[FoundRobot]:
    return (FoundRobot(name, "twistwrench", path_of(name)) for name in names())


def _example_robots() -> Iterator[FoundRobot]:
    """Robots of ``example-robot-data``, named by file, and by folder if one file of the folder is clearly the robot."""
    from importlib.metadata import PackageNotFoundError, distribution

    source = "example-robot-data"
    try:
        folder = Path(str(distribution(source).locate_file(_EXAMPLES_FOLDER)))
    except PackageNotFoundError:
        return
    if not folder.is_dir():
        return
    files_by_folder: dict[str, dict[str, Path]] = {}  # paths by the plain name of the file
    for path in sorted(folder.rglob("*")):
        if path.suffix in _FILE_SUFFIXES:
            robot_folder = path.relative_to(folder).parts[0]  # the outermost one
            files = files_by_folder.setdefault(_robot_of_folder(robot_folder), {})
            files.setdefault(plain_name(path.stem), path)
    stem_counts = Counter(chain.from_iterable(files_by_folder.values()))  # number of folders with a file of this name
    for robot_name, files in files_by_folder.items():
        for stem, path in files.items():
            if stem_counts[stem] == 1:  # no other folder has a file of this name
                yield FoundRobot(stem, source, path)
                yield FoundRobot(stem.removesuffix("_robot"), source, path)
            elif robot_name.startswith(stem):
                yield FoundRobot(robot_name, source, path)
            else:
                yield FoundRobot(f"{robot_name}_{stem}", source, path)
        if robot_name in files:
            yield FoundRobot(robot_name, source, files[robot_name])
        elif len(files) == 1 or all(stem.startswith(f"{robot_name}_") for stem in files):
            # all files are variants of one robot, the plainest of which has the shortest name
            shortest_stem = min(
                files, key=lambda stem: (len(stem), stem)
            )  # of equal lengths, the first in the alphabet
            yield FoundRobot(robot_name, source, files[shortest_stem])


def _robot_of_folder(folder: str) -> str:
    """Name of the robot of a folder: the folder's name without its ending."""
    name = plain_name(folder)
    for ending in _FOLDER_ENDINGS:
        if name.endswith(ending):
            return name.removesuffix(ending)
    return name


def _cached_descriptions() -> Iterator[FoundRobot]:
    """Robots in the cache of ``robot_descriptions``, read without imports because its modules clone repositories."""
    spec = find_spec(_DESCRIPTIONS_PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        return
    package = Path(next(iter(spec.submodule_search_locations)))  # folder of the package
    cache_path = os.environ.get("ROBOT_DESCRIPTIONS_CACHE") or "~/.cache/robot_descriptions"
    cache = Path(cache_path).expanduser()
    if not cache.is_dir():
        return
    folder_names = _repositories(package / "_repositories.py")
    clones = {repository: cache / folder for repository, folder in folder_names.items()}
    for module in sorted(package.glob("*_description.py")):
        path = _path_in_module(module, clones)
        if path is not None and path.is_file():
            robot_name = plain_name(module.stem.removesuffix("_description"))
            yield FoundRobot(robot_name, _DESCRIPTIONS_PACKAGE, path)


def _repositories(file: Path) -> dict[str, str]:
    """Folder of each repository in the cache, from the package's table ``{name: Repository(cache_path=…)}``."""
    folders: dict[str, str] = {}
    for node in ast.walk(_parse_module(file)):
        if not isinstance(node, ast.Dict):
            continue
        for key, value in zip(node.keys, node.values, strict=True):
            if not isinstance(key, ast.Constant) or not isinstance(value, ast.Call):
                continue
            for keyword in value.keywords:
                if keyword.arg == "cache_path" and isinstance(keyword.value, ast.Constant):
                    folders[str(key.value)] = str(keyword.value.value)
    return folders


def _path_in_module(module: Path, clones: Mapping[str, Path]) -> Path | None:
    """Robot file of a description module, evaluated from the few kinds of expressions that such modules use.

    ``clones``: folders of the repositories by name.
    """
    variables: dict[str, Path] = {}
    for node in _parse_module(module).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        path = _evaluate_path(node.value, variables, clones)
        if path is None:
            continue
        for target in targets:
            if isinstance(target, ast.Name):
                variables[target.id] = path
    for name in _PATH_NAMES:
        if name in variables:
            return variables[name]
    return None


def _evaluate_path(node: ast.expr | None, variables: Mapping[str, Path], clones: Mapping[str, Path]) -> Path | None:
    """Path of an expression: a variable, a text, ``clone_to_cache(name)`` or ``join(…)``; None for others."""
    if isinstance(node, ast.Name):
        return variables.get(node.id)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return Path(node.value)
    if not isinstance(node, ast.Call) or not node.args:
        return None
    # the function may be a name, or an attribute of a module
    function_name = getattr(node.func, "attr", "")
    if isinstance(node.func, ast.Name):
        function_name = node.func.id
    if function_name.endswith("clone_to_cache"):
        repository = node.args[0]
        return clones.get(str(repository.value)) if isinstance(repository, ast.Constant) else None
    if function_name != "join":
        return None
    parts: list[Path] = []
    for argument in node.args:
        part = _evaluate_path(argument, variables, clones)
        if part is None:
            return None
        parts.append(part)
    return Path(*parts)


def _parse_module(file: Path) -> ast.Module:
    """Syntax tree of a module; empty if it cannot be read."""
    try:
        return ast.parse(file.read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):  # a package with another layout
        return ast.Module([], [])


_MAX_REASON_LENGTH = 300
"""Largest number of characters of a reason."""


def _download(robot_name: str, name: object) -> Path:
    """Path of a robot that ``robot_descriptions`` downloads; ``name``: as the caller wrote it, for errors."""
    if find_spec(_DESCRIPTIONS_PACKAGE) is None:
        raise MissingExtraError(
            f"no robot named {name!r} is on this machine, and fetching one needs {_DESCRIPTIONS_PACKAGE!r}: "
            f"pip install {_DESCRIPTIONS_PACKAGE}."
        )
    descriptions = importlib.import_module(_DESCRIPTIONS_PACKAGE).DESCRIPTIONS
    modules = {plain_name(module.removesuffix("_description")): module for module in descriptions}
    if robot_name not in modules:
        raise UnknownNameError.from_choices(f"robot of {_DESCRIPTIONS_PACKAGE}", name, modules)
    try:
        module = importlib.import_module(f"{_DESCRIPTIONS_PACKAGE}.{modules[robot_name]}")
    except Exception as error:
        reason = " ".join(str(error).split())  # on one line
        reason = reason[:_MAX_REASON_LENGTH]
        raise NotFoundError(f"{_DESCRIPTIONS_PACKAGE} could not fetch {name!r}: {reason}.") from None
    for path_name in _PATH_NAMES:
        if hasattr(module, path_name):
            return Path(getattr(module, path_name))
    raise NotFoundError(
        f"{_DESCRIPTIONS_PACKAGE} has {name!r} as xacro only: load its file with twistwrench.load(path, xacro={{…}})."
    )


# ── Files beside the bundled robots, called ``demo``

_DEMO = "demo"


def bundled_file(name: str, robot: str, suffix: str, what: str) -> Path:
    """Path ``name``; if the name is ``demo``, the file with this suffix that is bundled with a robot.

    ``what`` is the kind of the file, for errors. Raises :class:`~twistwrench.UnknownNameError` if the robot has no such file.
    """
    if name != _DEMO or Path(name).is_file():
        return Path(name)
    folder = Path(__file__).parent
    ending = f"_{_DEMO}{suffix}"
    path = folder / f"{robot}{ending}"
    if not path.is_file():
        robots_with_file = [file.name.removesuffix(ending) for file in sorted(folder.glob(f"*{ending}"))]
        similar = difflib.get_close_matches(robot.lower(), robots_with_file, n=1, cutoff=0.8)
        hint = f" Did you mean {similar[0]!r}?" if similar else ""
        _, _, file_type = suffix.rpartition(".")
        raise UnknownNameError(
            f"no {what} is bundled with {robot!r}.{hint} With: {', '.join(robots_with_file)}. "
            f"Give the path of a {file_type.upper()} file instead."
        )
    return path
