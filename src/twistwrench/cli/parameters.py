"""Parameters of a function as options of a command: their forms, help texts and values.

The name of a parameter is the name of its option, its annotation selects the form (:data:`_KINDS`), and its paragraph in the
docstring is the help.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal, get_args, get_origin

import click

from ..core.arguments import assignments, parse_numbers
from ..core.errors import ValueRangeError
from ..motion.load_case import parse_wrenches, payloads_of
from ..robots.finding import bundled_file
from .hints import Seconds
from .main import Decorator, option

# ── Parameters of a function


@dataclass(frozen=True)
class FunctionParameter:
    """Parameter of a function: name, annotation without ``| None``, default and description."""

    name: str
    annotation: str
    default: Any
    text: str
    """Description."""

    @property
    def flag(self) -> str:
        """Option of the same name."""
        return f"--{self.name.replace('_', '-')}"


def parameters_of(function: Callable[..., Any]) -> dict[str, FunctionParameter]:
    """Parameters of a function by name, with their descriptions from the docstring's section ``Parameters``.

    >>> from twistwrench import check
    >>> parameters_of(check)["clearance"]
    FunctionParameter(name='clearance', annotation='Metres', default=None, text='Check the least distance between links [m].')
    """
    descriptions = _descriptions(inspect.getdoc(function) or "")
    signature_parameters = inspect.signature(function).parameters
    parameters = {}
    for name, parameter in signature_parameters.items():
        annotation = str(parameter.annotation).removesuffix(" | None")
        text = _with_flags(descriptions.get(name, ""), signature_parameters)
        parameters[name] = FunctionParameter(name, annotation, parameter.default, text)
    return parameters


def _descriptions(docstring: str) -> dict[str, str]:
    """Description of each parameter: its indented lines, or, without such lines, the words after its type."""
    # from the underlined heading to the next empty line
    section = re.search(r"^Parameters\n-+\n(.*?)(?:\n\n|\Z)", docstring, re.DOTALL | re.MULTILINE)
    if section is None:
        return {}
    descriptions: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", section[1]):  # an entry begins with each line that is not indented
        first_line, *indented_lines = entry.split("\n")
        names, _, type_and_words = first_line.partition(" : ")
        words = _without_type(type_and_words)
        if indented_lines:
            words = " ".join(map(str.strip, indented_lines))
        description = re.sub(r":\w+:`(?:[^`<]*<)?~?([^`>]*)>?`", r"\1", words)  # a role of Sphinx becomes its name
        if description:
            description = f"{description[:1].upper()}{description[1:].rstrip('.')}."
        descriptions |= dict.fromkeys(names.split(", "), description)
    return descriptions


def _with_flags(text: str, parameters: Container[str]) -> str:
    """Description without backticks, in which parameters between them have become options."""

    def replacement(quoted: re.Match[str]) -> str:
        if quoted[1] in parameters:
            return f"--{quoted[1]}"
        return quoted[1]

    return re.sub(r"``(.*?)``", replacement, text)


def _without_type(type_and_words: str) -> str:
    """Words after the type, which ends with its first comma, or with ``, optional,``."""
    _, separator, words = type_and_words.partition(", optional, ")
    if separator:
        return words
    _, _, words = type_and_words.partition(", ")
    return words


# ── Forms of options, by annotation


@dataclass(frozen=True)
class Kind:
    """Form of the option of a parameter: its placeholder, and how its text becomes a value."""

    form: str
    """Placeholder."""
    parse: Callable[[Any, str], Any] = lambda value, _flag: value
    """Function of the option's text and its flag, such as ``--tip``, that returns the value."""
    settings: Mapping[str, Any] | None = None
    """Further arguments of click.Option."""
    is_file: bool = False
    """True if the value is the name of a file."""
    bundled: tuple[str, str] | None = None
    """If ``demo`` is the file of a bundled robot: ending of its name, and its kind for messages."""


def _vector(text: str, flag: str) -> list[float]:
    """Three numbers separated by commas."""
    return parse_numbers(text, flag, "x,y,z, for example 0,0,0.1", 3)


def several(texts: Sequence[str], _flag: str) -> list[str] | None:
    """Texts of an option that may be repeated; None if there are none, so that the default applies."""
    return list(texts) or None


def _listed(text: str, _flag: str) -> list[str]:
    """Words separated by commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def _entries(texts: Iterable[str]) -> list[str]:
    """Entries of texts such as ``a=0,b=0``; a comma without ``NAME=`` after it belongs to the value."""
    entries: list[str] = []
    for text in texts:
        entries += re.split(r",(?=[^,=]*=)", text)
    return entries


def _positions(texts: Iterable[str], flag: str) -> dict[str, float]:
    """Position of each joint, from texts such as ``gripper=0.02``."""
    text_by_joint = assignments(_entries(texts), flag, "JOINT=VALUE, for example gripper=0.02")
    return {joint: _number(text, f"{flag} {joint}", "a number") for joint, text in text_by_joint.items()}


def _number(text: str, flag: str, form: str) -> float:
    """Single number of a text; ``form`` describes the text in messages."""
    (number,) = parse_numbers(text, flag, form, 1)
    return number


def _macro_arguments(texts: Sequence[str], flag: str) -> dict[str, str]:
    """Arguments of a xacro file; empty if the option has no value."""
    arguments = {}
    stripped_texts = map(str.strip, texts)
    for text in filter(None, stripped_texts):
        name, equals_sign, value = text.partition(":=")
        if not name or not equals_sign:
            raise ValueRangeError(
                f"{flag} {text!r} is not ARG:=VALUE, for example hand:=true. Without a value, it stands after ROBOT."
            )
        arguments[name] = value
    return arguments


def _coefficients(texts: Sequence[str], flag: str) -> float | dict[str, float]:
    """One number, or a number for each frame."""
    form = "a number, or FRAME=NUMBER for each frame, for example 0.7"
    entries = ",".join(texts).split(",")
    if len(entries) == 1 and "=" not in entries[0]:
        return _number(entries[0], flag, form)
    text_by_frame = assignments(entries, flag, form)
    return {frame: _number(text, f"{flag} {frame}", form) for frame, text in text_by_frame.items()}


def _contact_source(texts: Sequence[str], flag: str) -> str | dict[str, str]:
    """One word, or a column for each foot."""
    if len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    return assignments(
        _entries(texts), flag, "auto, log, or FRAME=COLUMN for each foot, for example left_foot=left_force"
    )


DEMO = "demo"
"""Text that stands for a file beside a bundled robot."""
REPEATED = {"multiple": True}
"""Setting of options that may be repeated."""
_KINDS = {
    "str": Kind("NAME"),
    "MethodName": Kind("NAME"),
    "int": Kind("N", settings={"type": int}),
    "float": Kind("VALUE", settings={"type": float}),
    "Seconds": Kind("SECONDS", settings={"type": Seconds()}),
    "Metres": Kind("[DISTANCE]", settings={"type": float, "is_flag": False, "flag_value": 0.0}),  # 0 without a distance
    "Hours": Kind("HOURS", settings={"type": float}),
    "Celsius": Kind("CELSIUS", settings={"type": float}),
    "Frame": Kind("FRAME"),
    "Vector": Kind("x,y,z", _vector),
    "LoadsGiven": Kind("MASS[,x,y,z][@FRAME]", settings=REPEATED),
    "WrenchesGiven": Kind("FRAME:m,m,m,f,f,f", lambda texts, _flag: parse_wrenches(texts), REPEATED),
    "ConfigurationGiven": Kind("v,v,…|NAME|JOINT=VALUE", several, REPEATED),
    "FeetGiven": Kind("FRAME|LxW@FRAME|auto", several, REPEATED),
    "FramesGiven": Kind("FRAME", several, REPEATED),
    "FrictionGiven": Kind("VALUE|FRAME=VALUE", _coefficients, REPEATED),
    "InContactGiven": Kind("auto|log|FRAME=COLUMN", _contact_source, REPEATED),
    "FrameOrTrue": Kind("[FRAME]", lambda text, _flag: text or True, {"is_flag": False, "flag_value": ""}),
    "BoltsGiven": Kind("NxDIAMETER|FILE.csv"),
    "HolderGiven": Kind("FORCE,FRICTION[@FRAME]"),
    "limits_file.Given": Kind("FILE.csv", is_file=True),
    "Any": Kind("FILE", is_file=True, bundled=(".csv", "motion")),
    "Source | Catalog": Kind("FILE.yaml", is_file=True, bundled=(".drives.yaml", "catalogue")),
    "str | Path": Kind("FILE", is_file=True),
    "str | Path | ArrayLike": Kind("FILE.csv", is_file=True),
    "str | Sequence[str]": Kind("NAME", several, REPEATED),
    "bool | Sequence[str | Path]": Kind("DIR", several, REPEATED),
    "Names": Kind("NAME,…", _listed),
    "Causes": Kind("CAUSE", several, REPEATED),
    "Mapping[str, ArrayLike]": Kind("JOINT=VALUE", _positions, REPEATED),
    "Mapping[str, str | float | bool] | bool": Kind(
        "[ARG:=VALUE]", _macro_arguments, {**REPEATED, "is_flag": False, "flag_value": ""}
    ),
    "Sequence[str | Path]": Kind("FOLDER", settings=REPEATED),
}
"""Forms by annotation. A bool is a flag, and a Literal a choice."""
_LOG_PARAMETERS = frozenset({"columns", "gain", "rate", "topic", "episode", "plan"})
"""Parameters for which all commands that read logs have options of their own."""
_ROBOT_PARAMETERS = frozenset({"lock", "actuators", "tip", "degrees"})
"""Parameters for which all commands that load robots have options of their own."""
_ARGUMENTS = frozenset({"robot", "motion", "log", "logs", "measurements", "self"})
"""Parameters that are arguments of commands."""
_PYTHON_PARAMETERS = frozenset({"progress", "draws", "max_bodies", "overwrite"})
"""Other parameters without an option."""
_NOT_OPTIONS = _ARGUMENTS | _PYTHON_PARAMETERS | _LOG_PARAMETERS | _ROBOT_PARAMETERS
"""Parameters that do not become options of the command alone."""


@dataclass(frozen=True)
class Spelling:
    """Option that is not spelled like its parameter: its form, its values by text, and its help."""

    form: str
    """Option and placeholder."""
    values: Mapping[str, Any] | None = None
    """Values by text of the option; a flag has one value, with the text ``""``."""
    text: str = ""
    """Help, if the parameter's description does not fit."""
    opposite: tuple[str, str] | None = None
    """Flag that sets False, and its help, if the default is neither True nor False."""


SPELLINGS = {
    "dt": Spelling("--step SECONDS"),
    "start": Spelling("--from v,v,…|JOINT=VALUE"),
    "add_masses": Spelling("--masses-included", {"": False}),
    "shared_supply": Spelling("--regeneration", {"shared": True, "none": False}),
    "include_paths": Spelling("--include-path FOLDER"),
    "floating_base": Spelling(
        "--floating-base",
        {"": True},
        opposite=(
            "--fixed-base",
            "Hold the base in place, as a stand does: a robot with legs hangs on purpose.",
        ),
    ),
}
"""Options that are not spelled like their parameters, since other words are usual on a command line."""


class Question:
    """Function of a command, and its parameters as options.

    Parameters in ``left_out`` have no option. Parameters in ``kept`` have one, although other commands take them from the
    robot or the log. ``spellings``, and ``kinds`` by annotation, apply to this command alone.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        left_out: Collection[str] = (),
        spellings: Mapping[str, Spelling] = MappingProxyType({}),
        kept: Collection[str] = (),
        kinds: Mapping[str, Kind] = MappingProxyType({}),
    ) -> None:
        self.function = function
        self.parameters = parameters_of(function)
        for name in self.parameters.keys() & set(left_out):
            del self.parameters[name]
        self.spellings = {**SPELLINGS, **spellings}
        self.kinds = {**_KINDS, **kinds}
        self._kept = kept

    def only(self, *names: str) -> Question:
        """Question about some of its parameters."""
        return Question(
            self.function, parameters_of(self.function).keys() - set(names), self.spellings, names, self.kinds
        )

    @property
    def defaults(self) -> dict[str, Any]:
        """Default of each option, by parameter."""
        return {parameter.name: parameter.default for parameter in self.options}

    @cached_property
    def options(self) -> list[FunctionParameter]:
        """Parameters that become options of the command alone."""
        options = []
        for name, parameter in self.parameters.items():
            if name in self._kept or name not in _NOT_OPTIONS:
                options.append(parameter)
        return options

    def choices(self, parameter: FunctionParameter) -> tuple[str, ...]:
        """Values of an annotation that is a Literal, or a union with a Literal; empty for other parameters."""
        annotation = self._type(parameter)
        for member in (annotation, *get_args(annotation)):  # of a union
            if get_origin(member) is Literal:
                return get_args(member)
        return ()

    def _type(self, parameter: FunctionParameter) -> Any:
        """Object that a parameter's annotation names; None if the function's module does not define it."""
        return getattr(self.function, "__globals__", {}).get(parameter.annotation)

    def _is_flag(self, parameter: FunctionParameter) -> bool:
        """True if the option has no value."""
        spelling = self.spellings.get(parameter.name)
        if spelling is None or spelling.values is None:
            return parameter.annotation == "bool"
        return "" in spelling.values

    def declarations(self, cls: type[click.Option] = click.Option) -> Iterator[Decorator]:
        """Options in the order of the signature.

        The value of an option that is not given is None or empty, so that the function's default applies.
        """
        for parameter in self.options:
            yield self._declaration(parameter, cls)
            spelling = self.spellings.get(parameter.name)
            if spelling is not None and spelling.opposite is not None:
                yield option(*spelling.opposite, _opposite_name(parameter), cls=cls)

    def _declaration(self, parameter: FunctionParameter, cls: type[click.Option]) -> Decorator:
        """Option of a parameter, with its form and help."""
        spelling = self.spellings.get(parameter.name)
        kind = self.kinds.get(parameter.annotation)
        form = parameter.flag
        text = parameter.text
        own_values: tuple[str, ...] = ()
        if self._is_flag(parameter):
            if parameter.default:
                form = f"--no-{parameter.flag[2:]}"
        elif kind is not None:
            form = f"{parameter.flag} {kind.form}"
        if spelling is not None:
            form = spelling.form
            text = spelling.text or text
            own_values = tuple(spelling.values or ())
        if self._is_flag(parameter):
            if parameter.annotation == "bool" and parameter.default:
                text = f"Do not {text[:1].lower()}{text[1:]}"
            return option(form, text, parameter.name, cls=cls)
        has_shown_default = parameter.default not in (None, (), "", inspect.Parameter.empty)
        if has_shown_default and not own_values:
            text += f" [default: {_printed(parameter.default)}]"
        settings: dict[str, Any] = {"required": parameter.default is inspect.Parameter.empty}
        choices = own_values or self.choices(parameter)
        if choices:
            settings["choices"] = choices
            annotation = self._type(parameter)
            is_union_with_sequence = bool(get_args(annotation)) and get_origin(annotation) is not Literal
            if is_union_with_sequence:
                settings |= REPEATED
        else:
            assert kind is not None, parameter
            settings |= kind.settings or {}
        if "multiple" in settings:
            text = f"{text[:-1]}; may be repeated."
        return option(form, text, parameter.name, cls=cls, **settings)

    def values(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Values of the options that the user has set, by parameter; ``given`` has what click passes for all options."""
        values: dict[str, Any] = {}
        for parameter in self.options:
            spelling = self.spellings.get(parameter.name)
            value = given[parameter.name]
            is_unset_flag = self._is_flag(parameter) and value is False
            is_set = value is not None and value != () and not is_unset_flag
            if spelling is not None and spelling.opposite is not None and given[_opposite_name(parameter)]:
                if is_set:
                    raise ValueRangeError(
                        f"{spelling.form} and {spelling.opposite[0]} contradict each other. Leave one of them out."
                    )
                values[parameter.name] = False
            elif is_set:
                values[parameter.name] = self._value(parameter, value, given)
        return values

    def _value(self, parameter: FunctionParameter, value: Any, given: Mapping[str, Any]) -> Any:
        """Value of a parameter whose option is set to ``value``."""
        spelling = self.spellings.get(parameter.name)
        kind = self.kinds.get(parameter.annotation)
        if spelling is not None and spelling.values:
            text = "" if value is True else value  # a flag
            return spelling.values[text]
        if parameter.annotation == "bool":
            return not parameter.default
        if parameter.annotation == "LoadsGiven":
            return list(payloads_of(value, given.get("tip")))
        if kind is None:
            return value
        if kind.bundled and value == DEMO:
            return bundled_file(value, given["source"], *kind.bundled)
        return kind.parse(value, parameter.flag)

    def files(self, values: Mapping[str, Any]) -> dict[str, str]:
        """Names of the files that the function reads, by option."""
        files = {}
        for parameter in self.options:
            kind = self.kinds.get(parameter.annotation)
            if kind is not None and kind.is_file and parameter.name in values:
                files[parameter.flag] = str(values[parameter.name])
        return files


def _opposite_name(parameter: FunctionParameter) -> str:
    """Name by which click passes the flag that sets False."""
    return f"not_{parameter.name}"


def _printed(value: object) -> str:
    """Default as text; a tuple as its items, separated by commas."""
    if isinstance(value, tuple):
        return ",".join(map(str, value))
    return str(value)
