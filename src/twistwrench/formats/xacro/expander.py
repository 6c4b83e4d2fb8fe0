"""Expansion of a xacro file, in a child process: a request with the text in, the expanded text out.

Three measures restrict the library ``xacro``. First, :mod:`.expressions` evaluates its expressions in place of Python's
``eval``. Second, an audit hook refuses everything but reading files below the allowed folders: no code is executed, no module
is imported, no process, connection or file for writing is opened. Third, the caller of the child process limits time and
memory.
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
"""Files that make a folder a package of ROS, and name it."""
_HARMLESS_EVENTS = (
    "builtins.id", "compile", "glob.glob", "glob.glob/2", "os.fwalk", "os.walk", "sys._getframe", "sys._getframemodulename",
)  # fmt: skip
"""Audit events without an effect outside the process; ``compile`` alone runs nothing."""
_FOLDER_EVENTS = ("os.listdir", "os.scandir")
"""Audit events of listing a folder."""
_WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
"""Flags of files that are opened for writing, as bits."""
_REMOVED_FUNCTIONS = ("type", "vars")
"""Functions of xacro that expose attributes of Python objects."""


def expand(request: Mapping[str, Any]) -> dict[str, Any]:
    """Dictionary with the ``declared`` arguments, and the expanded ``text`` or the ``reason`` why there is none."""
    import xacro
    import xacro.substitution_args as substitution
    from xacrodoc import packages

    bounds = _install_audit_hook()
    arguments = Arguments(request["arguments"])
    os.environ.update(request["environment"])  # where packages are found
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
    """Audit hook of this process, installed once.

    The hook refuses imports, so all modules and encodings that xacro needs later are imported here.
    """
    import xml.dom.expatbuilder
    import xml.dom.minidom
    import xml.parsers.expat  # noqa: F401

    import xacro
    import yaml  # noqa: F401

    for encoding in ("ascii", "utf-8", "utf-16", "latin-1", "cp1252", "iso8859-15"):
        "".encode(encoding)  # imports the encoding
    xacro.parse = guarded_parse
    bounds = Bounds()
    sys.addaudithook(bounds)
    return bounds


_MAX_REASON_LENGTH = 300
"""Largest number of characters of a reason."""


_MAX_SHOWN_PATH = 200
"""Largest number of characters of a path in a message."""
_MAX_SHOWN_NAME = 40
"""Largest number of characters of a name in a message."""


def reason_of(problem: BaseException) -> str:
    """Text of an error in one line: the cause, and the places in which it occurred, each once."""
    chain: list[Any] = [problem]  # the error, its cause, the cause of its cause, …
    while getattr(chain[-1], "exc", None) is not None:  # errors of xacro have their cause as ``exc``
        chain.append(chain[-1].exc)
    cause = chain[-1]
    if isinstance(cause, RecursionError):
        return "its macros, elements or expressions are nested too deeply"
    if isinstance(cause, MemoryError):
        return "it needs more memory than is allowed"
    parts = []
    for error in chain[:-1]:
        first_argument = error.args[0] if error.args else None
        message = str(first_argument) if first_argument else ""
        if message and not message.startswith("<class"):  # a message with a class repeats the cause
            parts.append(message)
    parts.append(_text_of_cause(cause))
    parts += [str(error.suffix) for error in reversed(chain) if getattr(error, "suffix", None)]  # places
    joined_parts = " ".join(dict.fromkeys(parts))  # each part once
    text = " ".join(joined_parts.split()).rstrip(".")  # in one line
    if len(text) > _MAX_REASON_LENGTH:
        return f"{text[:_MAX_REASON_LENGTH]}…"
    return text


def _text_of_cause(cause: Any) -> str:
    """Text of the innermost error without the names of Python's classes."""
    if isinstance(cause, SyntaxError):
        return str(cause.msg)
    if isinstance(cause, KeyError):
        return f"there is no {str(cause.args[0])!r}" if cause.args else "a name is missing"
    message = str(cause)
    if hasattr(cause, "suffix") and cause.args:  # an error of xacro, whose text would have the suffix too
        message = str(cause.args[0])
    return message or "an expression fails"


class Arguments(dict[str, str]):
    """Values of a xacro file's arguments, and the names declared during expansion."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.declared: list[str] = []

    def __contains__(self, name: object) -> bool:
        """True for an argument with a value; xacro looks for each argument that the file declares, which is noted."""
        self.declared.append(str(name))
        return super().__contains__(name)


class Bounds:
    """Audit hook that allows to read files below some folders, up to a total size, and raises Refused for all else."""

    folders: Sequence[Path] = ()
    """Folders whose files may be read."""
    max_bytes = 0
    """Allowed total size of the files read [bytes]."""
    read_bytes = 0
    """Size of the files read so far [bytes]."""
    is_enforced = False
    """True while events are checked."""
    searches_package = False
    """True while a package is searched: anywhere, folders may be listed and files that name packages may be read."""

    @contextmanager
    def enforce(self, folders: Sequence[str], max_bytes: int) -> Iterator[None]:
        """Refuse, until the block ends, all but reading files below the folders, of at most ``max_bytes`` together."""
        self.folders = [Path(folder).resolve() for folder in folders]
        self.max_bytes = max_bytes
        self.read_bytes = 0
        self.is_enforced = True
        try:
            yield
        finally:
            self.is_enforced = False

    @contextmanager
    def allow_package_files(self) -> Iterator[None]:
        """Allow, until the block ends, to list folders and to read files that name packages, anywhere."""
        self.searches_package = True
        try:
            yield
        finally:
            self.searches_package = False

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        """Check one event of the interpreter."""
        if not self.is_enforced or event in _HARMLESS_EVENTS:
            return
        if event == "open":
            self._check_file(*args)
        elif event in _FOLDER_EVENTS:
            self._check_folder(args[0])
        else:
            raise Refused(f"a robot file may not use {event!r}")

    def allows(self, path: Path) -> bool:
        """True for a path below an allowed folder, after links are resolved."""
        resolved_path = path.resolve()
        return any(resolved_path.is_relative_to(folder) for folder in self.folders)

    def _check_file(self, name: Any, mode: str | None, flags: int) -> None:
        opens_path = isinstance(name, str | os.PathLike)  # otherwise a file descriptor
        has_write_flag = bool(flags & _WRITE_FLAGS)
        has_write_mode = mode is not None and not set("wxa+").isdisjoint(mode)  # os.open has flags but no mode
        if has_write_flag or has_write_mode or not opens_path:
            raise Refused("a robot file may not write files")
        path = Path(name)
        if self.searches_package and path.name in _PACKAGE_FILES:
            return
        if not self.allows(path):
            raise Refused(f"it reads {str(path)[:_MAX_SHOWN_PATH]!r}, which lies outside its folder and its package")
        if path.exists():
            self.read_bytes += path.stat().st_size
        if self.read_bytes > self.max_bytes:
            raise Refused(f"the files it includes have more than {self.max_bytes // 2**20} MiB together")

    def _check_folder(self, name: Any) -> None:
        if not self.searches_package and not self.allows(Path(name)):
            raise Refused(f"it lists {str(name)[:_MAX_SHOWN_PATH]!r}, which lies outside its folder and its package")


class PackageFinder:
    """Finds packages: first among the folders above the file, then in ``include_paths`` and the environment of ROS."""

    def __init__(self, file: str | None, bounds: Bounds, find_elsewhere: Callable[[str], str]) -> None:
        self.file = file
        self.bounds = bounds
        self.find_elsewhere = find_elsewhere
        """Function that finds a package that is not above the file."""

    def __call__(self, name: str) -> str:
        """Folder of the package ``name``; raises Refused for one outside the folders that are searched."""
        with self.bounds.allow_package_files():
            folder = self._find_around_file(name)
            if folder is None:
                folder = Path(self.find_elsewhere(name))
        if not self.bounds.allows(folder):
            raise Refused(f"the package {name!r} lies outside the folders that are searched")
        return str(folder)

    def _find_around_file(self, name: str) -> Path | None:
        """Folder above the file that is the package ``name``; None without one. The folder may be read from now on."""
        if not self.file:
            return None
        for folder in Path(self.file).resolve().parents:
            if package_name(folder) == name:
                self.bounds.folders = [*self.bounds.folders, folder]
                return folder
        return None


def package_name(folder: Path) -> str | None:
    """Name of the package in a folder; None if it is not a package."""
    path = folder / "package.xml"
    if not path.is_file():
        if (folder / "manifest.xml").is_file():  # package of the first build system of ROS, named by its folder
            return folder.name
        return None
    name_elements = guarded_parse(None, str(path)).getElementsByTagName("name")
    if not name_elements or name_elements[0].firstChild is None:
        return None
    return str(name_elements[0].firstChild.data).strip()


def guarded_parse(source: str | None, filename: str | None = None) -> Any:
    """XML document of the text ``source``, or of the file if ``source`` is None. Replaces ``xacro.parse``; refuses entities."""
    import xml.dom.minidom

    import xacro

    data: str | bytes = source or ""
    if source is None:
        try:
            data = Path(xacro.root_dir, str(filename)).read_bytes()
        except OSError as problem:
            xacro.filestack.pop()  # as xacro does, so that the message names the including file
            raise xacro.XacroException(f"{problem.strerror}: {filename}", exc=problem) from None
    refuse_entities(
        data, lambda name: Refused(f"it declares the entity {name[:_MAX_SHOWN_NAME]!r}, which can exhaust memory")
    )
    return xml.dom.minidom.parseString(data)


_evaluated_texts: list[str] = []
"""Expressions that our functions have evaluated. :func:`check_evaluation` sees from them that xacro uses these functions."""


def replace_evaluation(xacro: Any, substitution: Any, finder: PackageFinder, arguments: Arguments) -> None:
    """Replace the functions of xacro that evaluate expressions, read the environment, and find packages."""
    symbols = xacro._global_symbols
    _evaluated_texts.clear()
    inner_namespaces = [value for value in symbols.values() if isinstance(value, dict)]
    namespaces = [symbols, *inner_namespaces]
    allowed_functions: set[int] = set()  # by identity
    for namespace in namespaces:  # with the methods of dict itself, since xacro's subclasses replace them
        for name in _REMOVED_FUNCTIONS:
            dict.pop(namespace, name, None)
        allowed_functions |= {id(value) for value in dict.values(namespace) if callable(value)}

    def safe_eval(text: str, names: Mapping[str, Any], _locals: Any = None) -> Any:
        _evaluated_texts.append(text)
        return evaluate(text, names, allowed_functions)

    def environment(name: str, *_: Any) -> str:
        raise Refused(
            f"it reads the environment variable {str(name)[:_MAX_SHOWN_NAME]!r}; declare an argument, <xacro:arg>, and give "
            "its value"
        )

    def argument(name: str) -> Any:
        return substitution.convert_value(substitution._eval_arg(name, args=arguments), "auto")

    # Symbols in $(eval …), which differ from those in ${…}.
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
    """Raise Refused if this version of xacro does not evaluate expressions by the functions of ``replace_evaluation``."""
    table = xacro.Table(xacro._global_symbols)
    examples = (  # text, expression in it, expected value
        ("${1 + 1}", "1 + 1", 2),
        ("$(eval 1 + 2)", "1 + 2", "3"),
    )
    for text, expression, expected_value in examples:
        has_expected_value = xacro.eval_text(text, table) == expected_value
        used_our_function = _evaluated_texts[-1:] == [expression]
        if not has_expected_value or not used_our_function:
            raise Refused("this version of xacro is not supported: it evaluates expressions in another way")
