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

_EXAMPLES = "cmeel.prefix/share/example-robot-data/robots"
_ENDINGS = (".urdf", ".sdf")
_COMMON = ("_simple_description", "_description", "_data")
"""Suffixes of robot folders after the robot's name."""
_FETCHED = "robot_descriptions"
_PATHS = ("URDF_PATH", "MJCF_PATH")


@dataclass(frozen=True)
class FoundRobot:
    """Named robot file."""

    name: str
    source: str
    """Package of the file: ``twistwrench``, ``example-robot-data``, ``robot_descriptions``."""
    path: Path


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
    wanted = plain_name(name) if isinstance(name, str) else ""
    if wanted in names():  # bundled robots need no search
        return path_of(wanted)
    known = known_robots()
    if wanted in known:
        return known[wanted].path
    if download:
        return _downloaded(wanted, name)
    raise UnknownNameError.from_choices("robot", name, known)


def robot_file(source: str) -> Path:
    """Path of a robot file, or of the robot of this name; a file takes precedence. Raises NotFoundError with similar names."""
    with suppress(OSError, ValueError):  # the name may be too long for a file
        if Path(source).exists():
            return Path(source)
    known, wanted = known_robots(), plain_name(source)
    if wanted in known:
        return known[wanted].path
    near = similar_names(wanted, known, cutoff=0.6)
    hint = f" Did you mean {near}?" if near else ""
    raise NotFoundError(
        f"no robot file {shorten(source)!r}, and no bundled robot of that name, nor one of another package.{hint} "
        "Give a path, or a name that `twistwrench robots` lists."
    )


def known_robots() -> dict[str, FoundRobot]:
    """Every robot that :func:`twistwrench.find` finds without a download, by name; the first source takes precedence."""
    found: dict[str, FoundRobot] = {}
    for robot in (*_bundled(), *_examples(), *_fetched()):
        found.setdefault(robot.name, robot)
    return found


def plain_name(name: str) -> str:
    """Normalised name for comparison: lower case, ``_`` for blanks and dashes."""
    return name.strip().lower().replace("-", "_").replace(" ", "_")


def _bundled() -> Iterator[FoundRobot]:
    return (FoundRobot(name, "twistwrench", path_of(name)) for name in names())


def _examples() -> Iterator[FoundRobot]:
    """Files by file name, and folders by folder name if one file is clearly the robot."""
    from importlib.metadata import PackageNotFoundError, distribution

    source = "example-robot-data"
    try:
        folder = Path(str(distribution(source).locate_file(_EXAMPLES)))
    except PackageNotFoundError:
        return
    if not folder.is_dir():
        return
    by_folder: dict[str, dict[str, Path]] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix in _ENDINGS:
            files = by_folder.setdefault(_folder_name(path.relative_to(folder).parts[0]), {})
            files.setdefault(plain_name(path.stem), path)
    stems = Counter(chain.from_iterable(by_folder.values()))
    for about, files in by_folder.items():
        for stem, path in files.items():
            if stems[stem] == 1:
                yield FoundRobot(stem, source, path)
                yield FoundRobot(stem.removesuffix("_robot"), source, path)
            elif about.startswith(stem):
                yield FoundRobot(about, source, path)
            else:
                yield FoundRobot(f"{about}_{stem}", source, path)
        if about in files:
            yield FoundRobot(about, source, files[about])
        elif len(files) == 1 or all(stem.startswith(f"{about}_") for stem in files):
            yield FoundRobot(about, source, files[min(files, key=lambda stem: (len(stem), stem))])


def _folder_name(folder: str) -> str:
    name = plain_name(folder)
    for ending in _COMMON:
        if name.endswith(ending):
            return name.removesuffix(ending)
    return name


def _fetched() -> Iterator[FoundRobot]:
    """Robots in the cache of ``robot_descriptions``, read without imports because its modules clone repositories."""
    spec = find_spec(_FETCHED)
    if spec is None or not spec.submodule_search_locations:
        return
    package = Path(next(iter(spec.submodule_search_locations)))
    cache = Path(os.environ.get("ROBOT_DESCRIPTIONS_CACHE") or "~/.cache/robot_descriptions").expanduser()
    if not cache.is_dir():
        return
    places = {name: cache / place for name, place in _repositories(package / "_repositories.py").items()}
    for module in sorted(package.glob("*_description.py")):
        path = _path_said(module, places)
        if path is not None and path.is_file():
            yield FoundRobot(plain_name(module.stem.removesuffix("_description")), _FETCHED, path)


def _repositories(file: Path) -> dict[str, str]:
    """Folder of each repository in the cache, from the package's table."""
    found = {}
    for node in ast.walk(_parsed(file)):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and isinstance(value, ast.Call):
                    said = {k.arg: k.value.value for k in value.keywords if isinstance(k.value, ast.Constant)}
                    if "cache_path" in said:
                        found[str(key.value)] = str(said["cache_path"])
    return found


def _path_said(module: Path, places: Mapping[str, Path]) -> Path | None:
    """Robot file of a description module, evaluated from the few kinds of expressions that such modules use."""
    known: dict[str, Path] = {}
    for node in _parsed(module).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign):
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        value = _value(node.value, known, places)
        if value is None:
            continue
        for target in targets:
            if isinstance(target, ast.Name):
                known[target.id] = value
    for name in _PATHS:
        if name in known:
            return known[name]
    return None


def _value(node: ast.expr | None, known: Mapping[str, Path], places: Mapping[str, Path]) -> Path | None:
    if isinstance(node, ast.Name):
        return known.get(node.id)
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return Path(node.value)
    if not isinstance(node, ast.Call) or not node.args:
        return None
    called = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
    if called.endswith("clone_to_cache"):
        first = node.args[0]
        return places.get(str(first.value)) if isinstance(first, ast.Constant) else None
    if called != "join":
        return None
    parts = list[Path]()
    for argument in node.args:
        part = _value(argument, known, places)
        if part is None:
            return None
        parts.append(part)
    return Path(*parts)


def _parsed(file: Path) -> ast.Module:
    try:
        return ast.parse(file.read_text(encoding="utf-8"))
    except (OSError, SyntaxError, ValueError):  # a package with another layout
        return ast.Module([], [])


def _downloaded(wanted: str, name: object) -> Path:
    if find_spec(_FETCHED) is None:
        raise MissingExtraError(
            f"no robot named {name!r} is on this machine, and fetching one needs {_FETCHED!r}: pip install {_FETCHED}."
        )
    descriptions = importlib.import_module(_FETCHED).DESCRIPTIONS
    known = {plain_name(key.removesuffix("_description")): key for key in descriptions}
    if wanted not in known:
        raise UnknownNameError.from_choices(f"robot of {_FETCHED}", name, known)
    try:
        module = importlib.import_module(f"{_FETCHED}.{known[wanted]}")
    except Exception as problem:
        raise NotFoundError(f"{_FETCHED} could not fetch {name!r}: {' '.join(str(problem).split())[:300]}.") from None
    path = next((getattr(module, one) for one in _PATHS if hasattr(module, one)), None)
    if path is None:
        raise NotFoundError(
            f"{_FETCHED} has {name!r} as xacro only: load its file with twistwrench.load(path, xacro={{…}})."
        )
    return Path(path)


# ── Files beside the bundled robots, called ``demo``

_DEMO = "demo"


def bundled_file(name: str, robot: str, suffix: str, what: str) -> Path:
    """Given path, or for ``demo`` the file of this kind that is bundled with a robot.

    Raises :class:`~twistwrench.UnknownNameError` if none is bundled with it.
    """
    if name != _DEMO or Path(name).is_file():
        return Path(name)
    folder = Path(__file__).parent
    path = folder / f"{robot}_{_DEMO}{suffix}"
    if not path.is_file():
        have = [p.name.removesuffix(f"_{_DEMO}{suffix}") for p in sorted(folder.glob(f"*_{_DEMO}{suffix}"))]
        near = difflib.get_close_matches(robot.lower(), have, n=1, cutoff=0.8)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise UnknownNameError(
            f"no {what} is bundled with {robot!r}.{hint} With: {', '.join(have)}. "
            f"Give the path of a {suffix.rpartition('.')[2].upper()} file instead."
        )
    return path
