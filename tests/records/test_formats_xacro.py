"""xacro: complete answers on record. Expressions are evaluated in this process; one child process expands files."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from recorded_answers import refusal
from recorded_models import ShortRecords, described

from twistwrench.core.errors import TwistWrenchError
from twistwrench.formats import load_model, xacro, xml
from twistwrench.formats.known_elements import KNOWN
from twistwrench.formats.xacro import expander
from twistwrench.formats.xacro.expressions import Refused, evaluate

pytest.importorskip("xacro", reason="xacro is not installed")
pytest.importorskip("xacrodoc", reason="xacrodoc is not installed")
records = ShortRecords(__file__)


class Names(dict):
    """Namespace as xacro has them."""


NAMES = {
    "w": 3, "h": 2.5, "name": "arm", "items": [4, 5, 6], "table": {"a": 1, "keys": 2}, "space": Names(length=0.25, keys=9), "sin": math.sin,
    "len": len, "range": range, "round": round, "pow": pow, "empty": "", "flag": False, "z": 2 + 3j, "factorial": math.factorial, "eval": eval,
    "long": list(range(100_001)), "short": list(range(50_000)),
}  # fmt: skip
FUNCTIONS = {id(NAMES[name]) for name in ("sin", "len", "range", "round", "pow", "factorial")}
EXPRESSIONS = """
1 + 2 * w - h / 5 | 7 // 2 + 7 % 4 + 2 ** 5 | 6 << 2 | 12 >> 1 | 6 | 12 ^ 5 | 12 & 6 | 12 ^ 6 | -w + +h | not w | ~6 | w and h | empty and h | empty or name | flag or empty | w and 0 and h | 0 or flag or 7
w == 3 | w != 3 | w < 3 | w <= 3 | w > 2 | w >= 4 | 1 < w < 3 | 1 < w <= 3 | 4 < w < undefined | 'r' in name | 'x' not in name | None is None | w is not None | 5 in items
'big' if w > 2 else 'small' | 'big' if w > 3 else 'small' | items[1] | items[-1] | items[0:2] | items[::2] | items[1:] | table['a'] | name[0] + name[1:] | (1, 2, w) | [w, h] | {'k': w, 'm': h} | {1, 2, 2}
sin(0.5) | len(name) | round(h * 1.234, 2) | round(h, ndigits=1) | range(3) | list | space.length | space.keys | table.keys | table.keys() | table.get('a') | name.upper() | name.replace('a', 'b') | '-'.join(['x', 'y']) | name.split('r')
items.count(4) | items.index(6) | h.is_integer() | z.real + z.imag | (1, 2).count(1) | ' x '.strip() | '%d-%s' % (w, name) | '%3d' % w | ' 1 + 1 ' | 1e3 | 'a' 'b' | True | False | None | pow(2, 3) | factorial(5) | name * 2 | 2 * items | 'ab'.center(6)
undefined | _x | name._x | name.__class__ | name.format(1) | items.append(3) | table.pop('a') | (lambda: 1)() | [i for i in items] | f'{w}' | eval('1') | sin | w @ h | {**table} | sin(*items) | sin(**table) | len(name=1) | 1 if | w := 2 | ...
2 ** 4096 | 2 ** 2048 | 2.0 ** 5000 | (-1) ** 99999 | 0 ** 99999 | 1 << 4097 | 1 << 4095 | 'a' * 100000 | 'a' * 100001 | 100001 * [1] | range(100000) | range(100001) | factorial(100001) | 'x'.center(100001) | '%1000d' % 3 | '%999d' % 3 == 3 | '%*d' % (3, 4) | 3 % 2 | round(100001) | round(100000)
1 / 0 | items[7] | table['q'] | 'a' + 1 | len(3)
"""


@records.of
def expressions_of_all_kinds():
    answers = {}
    texts = [text.strip() for line in EXPRESSIONS.strip().splitlines() for text in line.split(" | ")]
    for text in [
        *texts,
        "6 | 9",
        "2 ** 4000 * 2 ** 200",
        "2 ** 4000 * 2 ** 90",
        "long",
        "long + long",
        "len(short + short)",
        "1" + 9_999 * " ",
        "1" + 10_000 * " ",
    ]:
        try:
            value = evaluate(text, NAMES, FUNCTIONS)
        except Refused as error:
            value = f"refused: {error}"
        except Exception as error:  # Python's own words differ between versions
            value = type(error).__name__
        if callable(value):
            value = getattr(value, "__name__", "method")
        if isinstance(value, range | dict | complex | set | slice | type({}.keys())) or value is None:
            value = repr(value)
        if isinstance(value, str | list | tuple) and len(value) > 200:
            value = len(value)
        if isinstance(value, int) and value.bit_length() > 60:
            value = value.bit_length()
        answers[f"{text[:60]} {len(text)}"] = value
    return answers


ARM = """<robot name="{}" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.5"/><xacro:arg name="left" default="false"/>
  <xacro:property name="m" value="${{2 * 1.5}}"/>
  <xacro:macro name="part" params="name mass:=2"><link name="${{name}}"><inertial><origin xyz="0 ${{mass / 10}} 0.1"/><mass value="${{mass}}"/>
    <inertia ixx="${{0.1 + mass / 100}}" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="${{0.15 if mass > 2 else 0.25}}"/></inertial></link></xacro:macro>
  <link name="base"/><xacro:part name="upper" mass="${{m}}"/><xacro:part name="lower"/>
  <joint name="a" type="continuous"><parent link="base"/><child link="upper"/><origin xyz="$(arg length) 0 $(eval 2 * length)"/>
    <xacro:if value="$(arg left)"><axis xyz="0 1 0"/></xacro:if></joint>
  <joint name="b" type="continuous"><parent link="upper"/><child link="lower"/><axis xyz="0 0 ${{-1 if m > 2 else 1}}"/></joint>{}
</robot>
"""


def tried(call):
    try:
        return call()
    except TwistWrenchError as error:
        return f"{type(error).__name__}: {error}"


@records.of
def expanded_files(folder):
    package = folder / "ws" / "my_arm"
    for path in (package / "urdf", folder / "ws" / "other", folder / "far" / "third", folder / "ros"):
        path.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name> my_arm </name></package>")
    (folder / "far" / "third" / "package.xml").write_text("<package><name>third</name></package>")
    part = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="{}"/><joint name="{}" type="fixed"><parent link="lower"/><child link="{}"/></joint></robot>'
    (package / "urdf" / "tip.xacro").write_text(part.format("tip", "t", "tip"))
    (package / "hand.xacro").write_text(part.format("hand", "h", "hand"))
    (folder / "far" / "third" / "far.xacro").write_text(part.format("far", "f", "far"))
    (folder / "ws" / "other" / "out.xacro").write_text(part.format("out", "o", "out"))
    (package / "urdf" / "sizes.yaml").write_text("width: 0.3\n")
    include = '<xacro:include filename="{}"/>'
    bodies = {
        "plain": "", "include": include.format("tip.xacro"), "package": include.format("$(find my_arm)/hand.xacro"),
        "above": include.format("../hand.xacro"), "outside": include.format("../../other/out.xacro"),
        "far": include.format("$(find third)/far.xacro"), "missing": include.format("none.xacro"), "unknown": include.format("$(find nowhere)/x.xacro"), "environment": '<link name="$(env HOME)"/>', "optional": '<link name="x$(optenv HOME y)"/><joint name="q" type="fixed"><parent link="lower"/><child link="xy"/></joint>',
        "undefined": '<link name="${undefined}"/>', "macro": "<xacro:nothing/>", "parameter": "<xacro:part/>", "yaml": '<xacro:property name="s" value="${load_yaml(\'sizes.yaml\')}"/><link name="w${s.width}"/><joint name="q" type="fixed"><parent link="lower"/><child link="w0.3"/></joint>',
        "entity": "", "python": '<link name="${__import__(\'os\')}"/>', "recursion": '<xacro:macro name="r"><xacro:r/></xacro:macro><xacro:r/>',
    }  # fmt: skip
    answers = {}

    def shown(path, **options):
        found = described(load_model(path, quiet=True, **options))
        return [
            found["name"],
            found["bodies"][0].get("placement"),
            [body["axes"] for body in found["bodies"]],
            [body["inertia"] for body in found["bodies"]],
            found["frame names"],
        ]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_PACKAGE_PATH", "")
        patch.setenv("AMENT_PREFIX_PATH", "")
        for name, text in bodies.items():
            path = package / "urdf" / f"{name}.xacro"
            path.write_text(ARM.format(name, text))
            if name == "entity":
                path.write_text('<!DOCTYPE r [<!ENTITY a "b">]>' + path.read_text())
            answers[name] = tried(lambda path=path: shown(path))
        plain = package / "urdf" / "plain.xacro"
        far = package / "urdf" / "far.xacro"
        answers["arguments"] = tried(lambda: shown(plain, xacro={"length": 0.75, "left": True}))
        answers["text argument"] = tried(lambda: shown(plain, xacro={"length": "0.25", "left": "true"}))
        answers["unknown argument"] = tried(lambda: shown(plain, xacro={"long": 1}))
        answers["in a folder"] = tried(lambda: shown(far, include_paths=[folder / "far"]))
        patch.setenv("ROS_PACKAGE_PATH", str(folder / "far"))
        answers["by environment"] = tried(lambda: shown(far))
        text = plain.read_text()
        answers["text"] = tried(lambda: shown(text, xacro=True))
        answers["text without request"] = tried(lambda: shown(text))
        answers["text with unknown argument"] = tried(lambda: shown(text, xacro={"wide": 1}))
        wrong = ARM.format("w", '<link name="lower"/>')
        answers["expanded lines"] = tried(lambda: shown(wrong, xacro=True))
    return answers


@records.of
def xacro_that_is_found():
    texts = [
        '<robot><link name="${a}"/></robot>', '<robot><visual x="${a}"/></robot>', '<robot><link><visual><origin xyz="${a}"/></visual></link></robot>', "<robot><link><xacro:part/></link></robot>", '<robot><joint name="j"><origin rpy="$(arg a)"/></joint></robot>',
        '<robot xmlns:xacro="xacro:x"><link name="a"/></robot>', "<robot><!-- xacro: ${x} --></robot>", '<mujoco><xacro:part/></mujoco>', '<robot name="${n}"/>', '<robot><link name="a"><inertial><mass value="1"/><xacro:origin/></inertial></link><link name="${b}"/></robot>', "<robot><link>${text}</link></robot>",
    ]  # fmt: skip
    arguments = [None, False, True, {}, {"a": 1, "b": 2.5, "c": True, "d": "x", "e": False}]
    return {
        "found": {text: [xacro.is_marked(text), xacro.xacro_in(text)] for text in texts},
        "of a tree": xacro.xacro_in(texts[0], xml.parse(texts[1])),
        "of other rows": xacro.xacro_in(texts[1], rows={"robot": {"<visual>": "read"}, "visual": {"x": "read"}}),
        "rows": [dict(xacro._entries_of(xml.parse(f"<{tag}/>"), xml.parse(f"<{parent}/>"), KNOWN["URDF"])) == dict(KNOWN["URDF"].get(tag, {})) for tag, parent in (("origin", "joint"), ("nothing", "joint"))],
        "arguments": [xacro.xacro_arguments(argument) for argument in arguments],
        "wrong": [refusal(lambda a=a: xacro.xacro_arguments(a)) for a in ("x", {1: "a"}, {"a": None}, {"a": [1]}, 3)],
    }  # fmt: skip


@records.of
def requests_and_reasons(folder):
    nested = folder / "pack" / "deep"
    nested.mkdir(parents=True)
    (folder / "pack" / "manifest.xml").write_text("<x/>")
    (folder / "bad").mkdir()
    (folder / "bad" / "package.xml").write_text("<package><name/></package>")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_PACKAGE_PATH", f"{folder}:")
        patch.setenv("AMENT_PREFIX_PATH", "")
        request = xacro._request_to_child("<a/>", nested / "a.xacro", {"x": "1"}, [folder / "bad"])
        without = xacro._request_to_child("<a/>", None, {}, [])

    class Problem(Exception):
        def __init__(self, *args, exc=None, suffix=""):
            super().__init__(*args)
            self.exc = exc
            self.suffix = suffix

    problems = [
        ValueError("bad  value.\n twice."), KeyError("name"), KeyError(), SyntaxError("wrong"), RecursionError("x"), MemoryError(), ValueError(), Problem("outer", exc=ValueError("inner"), suffix="in a"), Problem("<class 'x'>", exc=KeyError("q"), suffix="in b"),
        Problem("same", exc=Problem("same", suffix="in c"), suffix="in d"), Problem(exc=Problem("deep", exc=RecursionError())), ValueError("x" * 400), ValueError("y" * 300),
    ]  # fmt: skip
    arguments = expander.Arguments({"a": "1"})
    asked = ["a" in arguments, "b" in arguments, "a" in arguments]
    bounds = expander.Bounds()
    bounds.folders = [folder.resolve()]
    return {
        "request": request,
        "without file": {key: value for key, value in without.items() if key != "text"},
        "around": [
            [str(path) for path in xacro._package_around(place / "x")] for place in (nested, folder / "bad", folder)
        ],
        "reasons": [expander.reason_of(problem) for problem in problems],
        "errors": [
            str(xacro._expansion_error("it fails")),
            str(xacro._expansion_error("it fails", {"a": None, "b": None})),
        ],
        "asked": [asked, arguments.declared],
        "allowed": [bounds.allows(path) for path in (nested / "x", folder, folder.parent)],
    }


@records.of
def events_of_a_child(folder):
    """Events of the interpreter that the hook refuses, called without being installed."""
    (folder / "a.txt").write_text("x" * 10)
    (folder / "package.xml").write_text("y" * 5)
    inside, outside = str(folder / "a.txt"), "/etc/hostname"

    def events(bounds):
        answers = {}
        for name, event, arguments in (
            ("read", "open", (inside, "r", 0)), ("read again", "open", (inside, "rb", 0)), ("write", "open", (inside, "w", 0)), ("append", "open", (inside, "a", 0)), ("update", "open", (inside, "r+", 0)), ("exclusive", "open", (inside, "x", 0)), ("flags", "open", (inside, None, 1)),
            ("create", "open", (inside, None, 64)), ("plain flags", "open", (inside, None, 0)), ("descriptor", "open", (3, "r", 0)), ("outside", "open", (outside, "r", 0)), ("outside package", "open", ("/etc/package.xml", "r", 0)), ("path", "open", (Path(inside), "r", 0)), ("list", "os.listdir", (str(folder),)), ("list outside", "os.listdir", ("/etc",)),
            ("scan outside", "os.scandir", ("/etc",)), ("harmless", "compile", ("x", "y")), ("import", "import", ("os",)), ("exec", "exec", (1,)), ("socket", "socket.connect", ()), ("missing", "open", (str(folder / "none"), "r", 0)),
        ):  # fmt: skip
            try:
                bounds(event, arguments)
                answers[name] = bounds.read_bytes
            except Refused as error:
                answers[name] = str(error)
        return answers

    bounds = expander.Bounds()
    before = events(bounds)
    with bounds.enforce([str(folder)], 2 * 2**20):
        during = events(bounds)
        with bounds.allow_package_files():
            searching = events(bounds)
        bounds.read_bytes = 2 * 2**20 - 10
        full = [_event(bounds, inside), _event(bounds, inside)]
    return {
        "before": before,
        "during": during,
        "searching": {key: searching[key] for key in searching if searching[key] != during[key]},
        "full": full,
        "after": [bounds.is_enforced, bounds.searches_package],
    }


def _event(bounds, path):
    try:
        bounds("open", (path, "r", 0))
    except Refused as error:
        return str(error)
    return bounds.read_bytes


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
