"""Expansion of a xacro file, in a child process: a request with the text in, the expanded text out.

The library ``xacro`` runs behind three walls. Its expressions are evaluated by :mod:`.expressions` in place of Python's
``eval``. An audit hook refuses everything but reading files below the allowed folders: no code is executed, no module is
imported, no process, connection or file for writing is opened. The caller of the child process limits time and memory.
"""

from __future__ import annotations

import builtins
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from ...core.entities import refuse_entities
from .expressions import Refused, evaluate

_PACKAGE_FILES = ("package.xml", "manifest.xml")
_HARMLESS = (
    "builtins.id", "compile", "glob.glob", "glob.glob/2", "os.fwalk", "os.walk", "sys._getframe", "sys._getframemodulename",
)  # fmt: skip
"""Audit events without an effect outside the process; ``compile`` alone runs nothing."""
_FOLDERS = ("os.listdir", "os.scandir")
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_NOT_FUNCTIONS = ("type", "vars")
"""Functions of xacro that reach into objects of Python."""


def expand(request: Mapping[str, Any]) -> dict[str, Any]:
    """Expanded ``text`` or the ``reason`` why there is none, and the arguments that the file ``declared``."""
    import xacro
    import xacro.substitution_args as substitution
    from xacrodoc import packages

    bounds, arguments = _install_audit_hook(), Arguments(request["arguments"])
    packages.reset()
    if request["include_paths"]:
        packages.look_in(list(request["include_paths"]))
    finder = PackageFinder(request["file"], bounds, packages.get_path)
    replace_evaluation(xacro, substitution, finder, arguments)
    xacro.init_stacks(request["file"])
    answer: dict[str, Any] = {"declared": arguments.declared}
    try:
        with bounds.enforce(request["folders"], request["bytes"]):
            check_evaluation(xacro)
            document = guarded_parse(request["text"])
            xacro.process_doc(document, mappings=arguments)
            text = document.toxml()
    except Exception as problem:
        return answer | {"reason": reason_of(problem)}
    if len(text) > request["bytes"]:
        return answer | {"reason": f"it expands to more than {request['bytes'] // 2**20} MiB"}
    return answer | {"text": text}


@cache
def _install_audit_hook() -> Bounds:
    """Bounds that this process keeps to, set once; what is imported later otherwise is imported before."""
    import xml.dom.expatbuilder
    import xml.dom.minidom
    import xml.parsers.expat  # noqa: F401

    import xacro
    import yaml  # noqa: F401

    for encoding in ("ascii", "utf-8", "utf-16", "latin-1", "cp1252", "iso8859-15"):
        "".encode(encoding)
    xacro.parse = guarded_parse
    bounds = Bounds()
    sys.addaudithook(bounds)
    return bounds


_MAX_REASON = 300
"""Largest number of characters of a reason."""


def reason_of(problem: BaseException) -> str:
    """Text of an error in one line: the cause, and the places in which it occurred, each once."""
    chain: list[Any] = [problem]
    while getattr(chain[-1], "exc", None) is not None:  # the cause of an error of xacro, whose text holds it
        chain.append(chain[-1].exc)
    inner = chain[-1]
    if isinstance(inner, RecursionError):
        return "its macros, elements or expressions are nested too deeply"
    if isinstance(inner, MemoryError):
        return "it needs more memory than is allowed"
    parts = []
    for error in chain[:-1]:
        message = str(error.args[0]) if error.args and error.args[0] else ""
        if message and not message.startswith("<class"):  # that repeats the cause
            parts.append(message)
    parts.append(_cause(inner))
    parts += [str(error.suffix) for error in reversed(chain) if getattr(error, "suffix", None)]
    text = " ".join(" ".join(dict.fromkeys(parts)).split()).rstrip(".")
    return text if len(text) <= _MAX_REASON else f"{text[:_MAX_REASON]}…"


def _cause(inner: Any) -> str:
    """Text of the innermost error without the names of Python's classes."""
    if isinstance(inner, SyntaxError):
        return str(inner.msg)
    if isinstance(inner, KeyError):
        return f"there is no {str(inner.args[0])!r}" if inner.args else "a name is missing"
    message = inner.args[0] if hasattr(inner, "suffix") and inner.args else inner
    return str(message) or "an expression fails"


class Arguments(dict[str, str]):
    """Values of a xacro file's arguments, and the names declared during expansion."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.declared: list[str] = []

    def __contains__(self, name: object) -> bool:
        self.declared.append(str(name))
        return super().__contains__(name)


class Bounds:
    """Audit hook: files below the allowed folders are read, up to a total size; everything else raises Refused."""

    folders: Sequence[Path] = ()
    most, total = 0, 0
    """Largest and present size of the files read [bytes]."""
    active = False
    finding = False
    """True while a package is searched: folders are listed, and files that name packages are read, anywhere."""

    @contextmanager
    def enforce(self, folders: Sequence[str], most: int) -> Iterator[None]:
        """Refuse, until the block ends, all but files below the folders, of at most ``most`` bytes together."""
        self.folders = [Path(folder).resolve() for folder in folders]
        self.most, self.total, self.active = most, 0, True
        try:
            yield
        finally:
            self.active = False

    @contextmanager
    def allow_package_files(self) -> Iterator[None]:
        """Allow, until the block ends, to list folders and to read files that name packages, anywhere."""
        self.finding = True
        try:
            yield
        finally:
            self.finding = False

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        """Check one event of the interpreter."""
        if not self.active or event in _HARMLESS:
            return
        if event == "open":
            self._check_file(*args)
        elif event in _FOLDERS:
            self._check_folder(args[0])
        else:
            raise Refused(f"a robot file may not use {event!r}")

    def allows(self, path: Path) -> bool:
        """True for a path below an allowed folder, after links are resolved."""
        place = path.resolve()
        return any(place.is_relative_to(folder) for folder in self.folders)

    def _check_file(self, name: Any, mode: str | None, flags: int) -> None:
        if not isinstance(name, str | os.PathLike) or flags & _WRITES or set(mode or "r") & set("wxa+"):
            raise Refused("a robot file may not write files")
        path = Path(name)
        if self.finding and path.name in _PACKAGE_FILES:
            return
        if not self.allows(path):
            raise Refused(f"it reads {str(path)[:200]!r}, which lies outside its folder and its package")
        if path.exists():
            self.total += path.stat().st_size
        if self.total > self.most:
            raise Refused(f"the files it includes have more than {self.most // 2**20} MiB together")

    def _check_folder(self, name: Any) -> None:
        if not self.finding and not self.allows(Path(name)):
            raise Refused(f"it lists {str(name)[:200]!r}, which lies outside its folder and its package")


class PackageFinder:
    """Folders of packages: those around the file, then those of ``include_paths`` and of the environment of ROS."""

    def __init__(self, file: str | None, bounds: Bounds, elsewhere: Callable[[str], str]) -> None:
        self.file, self.bounds, self.elsewhere = file, bounds, elsewhere

    def __call__(self, name: str) -> str:
        """Folder of the package ``name``; raises Refused for one outside the folders that are searched."""
        with self.bounds.allow_package_files():
            folder = self._around(name) or Path(self.elsewhere(name))
        if not self.bounds.allows(folder):
            raise Refused(f"the package {name!r} lies outside the folders that are searched")
        return str(folder)

    def _around(self, name: str) -> Path | None:
        """Folder above the file whose package file has the name; None without one."""
        folders = Path(self.file).resolve().parents if self.file else ()
        for folder in folders:
            if package_name(folder) == name:
                self.bounds.folders = [*self.bounds.folders, folder]
                return folder
        return None


def package_name(folder: Path) -> str | None:
    """Name of the package in a folder; None if it is not a package."""
    path = folder / "package.xml"
    if not path.is_file():
        return folder.name if (folder / "manifest.xml").is_file() else None
    names = guarded_parse(None, str(path)).getElementsByTagName("name")
    return str(names[0].firstChild.data).strip() if names and names[0].firstChild is not None else None


def guarded_parse(source: str | None, filename: str | None = None) -> Any:
    """Document of a text or file without entities, in place of ``xacro.parse``."""
    import xml.dom.minidom

    import xacro

    data: str | bytes = source or ""
    if source is None:
        try:
            data = Path(xacro.root_dir, str(filename)).read_bytes()
        except OSError as problem:
            xacro.filestack.pop()  # as xacro does, whose messages name the file that includes
            raise xacro.XacroException(f"{problem.strerror}: {filename}", exc=problem) from None
    refuse_entities(data, lambda name: Refused(f"it declares the entity {name[:40]!r}, which can exhaust memory"))
    return xml.dom.minidom.parseString(data)


_evaluated_texts: list[str] = []
"""Expressions evaluated so far, which show that the replacements of :func:`replace_evaluation` are in use."""


def replace_evaluation(xacro: Any, substitution: Any, finder: PackageFinder, arguments: Arguments) -> None:
    """Replace the functions of xacro that evaluate expressions, read the environment, and find packages."""
    symbols = xacro._global_symbols
    _evaluated_texts.clear()
    spaces = [symbols, *(space for space in symbols.values() if isinstance(space, dict))]
    for space in spaces:
        for name in _NOT_FUNCTIONS:
            dict.pop(space, name, None)
    functions = {id(value) for space in spaces for value in dict.values(space) if callable(value)}

    def safe_eval(text: str, names: Mapping[str, Any], _locals: Any = None) -> Any:
        _evaluated_texts.append(text)
        return evaluate(text, names, functions)

    def environment(name: str, *_: Any) -> str:
        raise Refused(
            f"it reads the environment variable {str(name)[:40]!r}; declare an argument, <xacro:arg>, and give its value"
        )

    def argument(name: str) -> Any:
        return substitution.convert_value(substitution._eval_arg(name, args=arguments), "auto")

    functions_and_constants = {
        "arg": argument,
        "find": finder,
        "env": environment,
        "optenv": lambda _name, default="": default,
    }
    functions_and_constants |= {
        name: getattr(builtins, name) for name in ("list", "dict", "map", "str", "float", "int")
    }
    functions_and_constants |= {name: value for name, value in symbols["math"].items() if not name.startswith("_")}
    functions_of_eval = {id(value) for value in functions_and_constants.values() if callable(value)}

    def eval_substitution(text: str, _context: Any) -> str:
        _evaluated_texts.append(text)
        names = {"true": True, "false": False}
        names |= {name: substitution.convert_value(value, "auto") for name, value in arguments.items()}
        return str(evaluate(text, names | functions_and_constants, functions_of_eval))

    xacro.safe_eval = safe_eval
    substitution._eval = eval_substitution
    substitution._eval_env = environment
    substitution._eval_optenv = lambda _name, default="": default
    substitution._eval_find = finder


def check_evaluation(xacro: Any) -> None:
    """Raise Refused if this version of xacro evaluates expressions by another function than those replaced."""
    table = xacro.Table(xacro._global_symbols)
    for text, inside, value in (("${1 + 1}", "1 + 1", 2), ("$(eval 1 + 2)", "1 + 2", "3")):
        if xacro.eval_text(text, table) != value or _evaluated_texts[-1:] != [inside]:
            raise Refused("this version of xacro is not supported: it evaluates expressions in another way")
