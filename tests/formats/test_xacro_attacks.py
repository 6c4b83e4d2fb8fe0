"""Attacks on the expansion of xacro: none runs code, reads a file outside, writes, or takes more than its share.

Every attack is a file that is expanded as users expand it.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from pathlib import Path
from xml.dom.minidom import parseString

import pytest
from places import SHARED

import twistwrench as tw
from twistwrench.formats import xacro as room
from twistwrench.formats.xacro import xacro_in
from twistwrench.formats.xacro.expander import Bounds, PackageFinder
from twistwrench.formats.xacro.expressions import Refused, evaluate

pytest_plugins = ("torque_fixtures",)
pytest.importorskip("xacrodoc", reason="the extra xacro is not installed")

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
LINK = '<link name="a"/>'
SUBCLASSES = "().__class__.__base__.__subclasses__()"

EXPRESSIONS = {
    # names and attributes of Python's objects
    "subclasses in a lambda": (
        f"(lambda: [c for c in {SUBCLASSES} if c.__name__=='_wrap_close'][0].__init__.__globals__['system']('id'))()",
        "lambda",
    ),
    "subclasses": (SUBCLASSES, "begins with '_'"),
    "a class": ("''.__class__", "begins with '_'"),
    "globals of a function": ("xacro.tokenize.__globals__", "begins with '_'"),
    "code of a function": ("xacro.tokenize.__code__", "begins with '_'"),
    "builtins": ("__builtins__", "begins with '_'"),
    "import": ("__import__('os')", "begins with '_'"),
    "self of a builtin": ("len.__self__", "begins with '_'"),
    "one underscore": ("_x", "begins with '_'"),
    "a loader": ("math.__loader__", "begins with '_'"),
    "parent of a namespace": ("math.parent", "not allowed"),
    "root of a namespace": ("math.root['python']", "not allowed"),
    "an item with underscores": ("python['__builtins__']", "when evaluating"),
    "frame of a generator": ("(x for x in [1]).gi_frame", "for x in"),
    "code of a lambda": ("(lambda: 0).__code__", "lambda"),
    "mro of a type": ("str.mro()", "not allowed"),
    "attribute of an error": ("xacro.fatal.exc", "not allowed"),
    # syntax that evaluates later, binds names or loops
    "lambda": ("(lambda: 1)()", "lambda"),
    "lambda as argument": ("list(map(lambda x: x, [1]))", "lambda"),
    "lambda as key": ("sorted([1, 2], key=lambda x: x.__class__)", "lambda"),
    "list comprehension": ("[x for x in range(3)]", "for x in"),
    "set comprehension": ("{x for x in range(3)}", "for x in"),
    "dictionary comprehension": ("dict({x: 1 for x in range(3)})", "for x in"),
    "generator": ("max(x for x in range(3))", "for x in"),
    "walrus": ("[y := 1, y]", ":= 1"),
    "await": ("await 1", "'await 1' is"),
    "yield": ("(yield 1)", "(yield 1)' is"),
    "starred call": ("max(*[1, 2])", "'*"),
    "starred list": ("[*range(3)]", "'*"),
    "unpacked words": ("dict(**{'a': 1})", "dict(**{'a': 1})"),
    "unpacked dictionary": ("{**{'a': 1}}", "{**{'a': 1}}\" is"),
    "bytes": ("b'x'", "b'x'\" is"),
    "statement": ("import os", "when evaluating"),
    "assignment": ("a = 1", "when evaluating"),
    "two expressions": ("1; 2", "when evaluating"),
    "a newline and a statement": ("1\nimport os", "when evaluating"),
    # texts that format
    "f-string": ("f'{1}'", "f'{"),
    "f-string with attributes": ("f'{len.__self__}'", "f'{"),
    "format": ("'{0.__class__}'.format(1)", "not allowed"),
    "format of a mapping": ("'{a.__class__}'.format_map({'a': 1})", "not allowed"),
    "format of the class": ("str.format('{0.__class__}', 1)", "not allowed"),
    "format by map": ("list(map('{0.__class__}'.format, [1]))", "not allowed"),
    "format of a width": ("'%999999999d' % 1", "width"),
    "format of a width after a name": ("'%(a)999999999d' % dict(a=1)", "width"),
    "format of a width from an argument": ("'%*d' % (999999999, 1)", "width"),
    # functions that are not there
    "type": ("python.type('X', (), {})", "not allowed"),
    "vars": ("python.vars(math)", "not allowed"),
    "type as an item": ("python['type']", "when evaluating"),
    "getattr": ("getattr(1, 'real')", "not defined"),
    "eval": ("eval('1')", "not defined"),
    "exec": ("exec('1')", "not defined"),
    "open": ("open('/etc/passwd').read()", "not defined"),
    "compile": ("compile('1', '', 'eval')", "not defined"),
    "globals": ("globals()", "not defined"),
    "breakpoint": ("breakpoint()", "not defined"),
    "a method of a list that changes it": ("[1].append(2)", "not allowed"),
    "encode": ("'x'.encode('zlib')", "not allowed"),
    # numbers and texts without end
    "a power": ("9**9**9", "power"),
    "a power of products": ("(2**4000 * 2**90) * 2**4000", "bits"),
    "a power of a boolean": ("(True + True)**10000000", "power"),
    "a shift": ("1 << 10**9", "shift"),
    "a repeated text": ("'a' * 10**10", "repeated"),
    "a repeated list": ("10**10 * [0]", "repeated"),
    "a repeated tuple": ("(0,) * 10**9", "repeated"),
    "doubled texts": ("(('a' * 99999) + ('a' * 99999)).replace('a', 'b' * 9)", "items"),
    "a range": ("list(range(10**12))", "items"),
    "a range of python": ("list(python.range(10**12))", "above"),
    "padding": ("'a'.zfill(10**10)", "above"),
    "padding right": ("'a'.ljust(10**10)", "above"),
    "rounding": ("round(5, -10**9)", "above"),
    "factorial": ("math.factorial(10**9)", "above"),
    "combinations": ("math.comb(10**9, 10**8)", "above"),
    "digits": ("9" * 5000, "4300 digits"),
    "a long expression": ("1+" * 6000 + "1", "characters"),
    "a deep expression": ("(" * 4000 + "1" + ")" * 4000, "nested"),
    "a deep sum": ("-" * 4000 + "1", "deep"),
}
"""Expression in ``${…}``, and words of the refusal; all of them must be refused."""

SUBSTITUTIONS = {
    "eval of subclasses": (f"eval {SUBCLASSES}", "begins with"),
    "eval of a single underscore": ("eval str(1)._x", "begins with"),
    "eval of a method": ("eval str(1).format", "not allowed"),
    "eval of a lambda": ("eval list(map(lambda x: x, [1]))", "lambda"),
    "eval of an open": ("eval open('x')", "not defined"),
    "eval of a loader": ("eval __loader__", "begins with"),
    "eval of a power": ("eval 9**9**9", "power"),
    "eval of the environment": ("eval env('HOME')", "environment variable"),
    "environment": ("env HOME", "environment variable"),
    "a package that is a path": ("find /etc", "Package"),
    "a package above": ("find ../..", "Package"),
    "a command": ("anon x", "Unknown substitution"),
}
"""Substitution in ``$(…)``, and words of the refusal."""

EVIL = "().__class__"
FILES = {
    # expressions put together while the file is expanded
    "in a property": (f'<xacro:property name="p" value="${{{EVIL}}}"/><link name="${{p}}"/>', "begins with"),
    "in a property that is never used but not lazy": (
        f'<xacro:property name="p" value="${{{EVIL}}}" lazy_eval="false"/>',
        "begins with",
    ),
    "from properties": (
        '<xacro:property name="a" value="().__cla"/><xacro:property name="b" value="ss__"/><link name="${${a}${b}}"/>',
        "",
    ),
    "from an argument": (f'<xacro:arg name="e" default="{EVIL}"/><link name="${{$(arg e)}}"/>', "begins with"),
    "in a macro's default": (
        f'<xacro:macro name="m" params="n:=${{{EVIL}}}"><link name="${{n}}"/></xacro:macro><xacro:m/>',
        "begins with",
    ),
    "in a macro's parameter": (
        f'<xacro:macro name="m" params="n"><link name="${{n}}"/></xacro:macro><xacro:m n="${{{EVIL}}}"/>',
        "begins with",
    ),
    "in a macro's body": (
        f'<xacro:macro name="m" params=""><link name="${{{EVIL}}}"/></xacro:macro><xacro:m/>',
        "begins with",
    ),
    "in a condition": (f'<xacro:if value="${{{EVIL}}}">{LINK}</xacro:if>', "begins with"),
    "in the name of an element": (f'<xacro:element xacro:name="${{{EVIL}}}"/>', "begins with"),
    "in the name of an attribute": (f'<link><xacro:attribute name="${{{EVIL}}}" value="1"/></link>', "begins with"),
    "in the name of a property": (f'<xacro:property name="${{{EVIL}}}" value="1"/>', "begins with"),
    "in the name of a macro": (f'<xacro:call macro="${{{EVIL}}}"/>', "begins with"),
    "in an include": (f'<xacro:include filename="${{{EVIL}}}"/>', "begins with"),
    "in a namespace": (f'<xacro:include filename="in.xacro" ns="${{{EVIL}}}"/>', "begins with"),
    "in a text": (f"<gazebo>${{{EVIL}}}</gazebo>", "begins with"),
    "in a comment": (f"<!-- xacro:eval-comments --><!-- ${{{EVIL}}} -->", "begins with"),
    "in a block": (
        f'<xacro:macro name="m" params="*b"><xacro:insert_block name="b"/></xacro:macro><xacro:m><link name="${{{EVIL}}}"/></xacro:m>',
        "begins with",
    ),
    "in an included file": ('<xacro:include filename="evil.xacro"/>', "begins with"),
    "in a file of YAML": ("<link name=\"${xacro.load_yaml('units.yaml')}\"/>", "begins with"),
    "a property over a function": (
        '<xacro:property name="len" value="${python.type}"/><link name="${len(1)}"/>',
        "not allowed",
    ),
    # files outside
    "an include above": ('<xacro:include filename="../secret.txt"/>', "lies outside"),
    "an include by its path": ('<xacro:include filename="/etc/passwd"/>', "lies outside"),
    "an optional include": ('<xacro:include filename="/etc/passwd" optional="true"/>', "lies outside"),
    "includes of a folder": ('<xacro:include filename="/etc/*"/>', "outside"),
    "an include through a link": ('<xacro:include filename="link.xacro"/>', "lies outside"),
    "an include of a device": ('<xacro:include filename="/dev/zero"/>', "lies outside"),
    "YAML above": ("<link name=\"${xacro.load_yaml('../secret.txt')}\"/>", "lies outside"),
    "YAML by its path": ("<link name=\"${xacro.load_yaml('/etc/passwd')}\"/>", "lies outside"),
    "YAML through a link": ("<link name=\"${xacro.load_yaml('link.xacro')}\"/>", "lies outside"),
    "YAML of a file descriptor": ('<link name="${xacro.load_yaml(0)}"/>', ""),
    "YAML of an object": ("<link name=\"${xacro.load_yaml('object.yaml')}\"/>", "could not determine a constructor"),
    "entities of an included file": ('<xacro:include filename="entity.xacro"/>', "declares the entity"),
    "an include above a package": ('<xacro:include filename="$(find robot)/../secret.txt"/>', "lies outside"),
    "an element as a value": (
        '<xacro:property name="p"><a/></xacro:property><xacro:include filename="in.xacro" ns="n"/><link name="${n[\'**p\'].ownerDocument}"/>',
        "not allowed",
    ),
    # recursion
    "a macro of itself": ('<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>', "too deeply"),
    "an include of itself": ('<xacro:include filename="again.xacro"/>', "too deeply"),
    "a property of itself": ('<xacro:property name="p" value="${p}"/><link name="${p}"/>', "circular"),
    "deep elements": (f"{'<a>' * 5000}{'</a>' * 5000}", "too deeply"),
    "a large included file": ('<xacro:include filename="sparse.xacro"/>', "together"),
}
"""Content of a file, and words of the refusal."""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A file with neighbours, a secret above them, and a link to it."""
    folder = tmp_path / "robot"
    folder.mkdir()
    (tmp_path / "secret.txt").write_text("<robot>SECRET</robot>")
    (folder / "link.xacro").symlink_to(tmp_path / "secret.txt")
    (folder / "package.xml").write_text("<package><name>robot</name></package>")
    (folder / "in.xacro").write_text(f"{HEAD}{LINK}</robot>")
    (folder / "evil.xacro").write_text(f'{HEAD}<link name="${{{EVIL}}}"/></robot>')
    (folder / "again.xacro").write_text(f'{HEAD}<xacro:include filename="again.xacro"/></robot>')
    (folder / "entity.xacro").write_text(f'<!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]>{HEAD}&b;</robot>')
    (folder / "units.yaml").write_text(f"!degrees {EVIL}\n")
    (folder / "object.yaml").write_text("!!python/object/apply:os.system [id]\n")
    with (folder / "sparse.xacro").open("wb") as sparse:
        sparse.truncate(3 * 2**30)
    return folder / "arm.urdf.xacro"


def answer(file: Path, text: str) -> dict[str, str]:
    """Text that the content of a file expands to, or the reason why there is none."""
    file.write_text(f"{HEAD}{text}{LINK}</robot>")
    try:
        return {"text": room.expand_xacro(file.read_text(), file, {}, (), "")}
    except tw.RobotFileError as problem:
        return {"reason": str(problem)}


def escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")


def in_expression(k: int, text: str) -> str:
    """Expression that is put together while the file is expanded, as braces end one that is written out."""
    return f'<xacro:arg name="e{k}" default="{escaped(text)}"/><link name="${{$(arg e{k})}}"/>'


def in_substitution(text: str) -> str:
    return f'<xacro:property name="p" value="{escaped(text)}"/><link name="$(${{p}})"/>'


def test_no_attack_on_xacro_passes_its_walls(file):
    attacks = {
        f"${{…}}: {name}": (in_expression(k, text), words)
        for k, (name, (text, words)) in enumerate(EXPRESSIONS.items())
    }
    attacks |= {f"$(…): {name}": (in_substitution(text), words) for name, (text, words) in SUBSTITUTIONS.items()}
    attacks |= FILES
    assert len(attacks) > 100
    found = {name: answer(file, text) for name, (text, _) in attacks.items()}
    passed = {name: said["text"][-300:] for name, said in found.items() if "text" in said}
    other = {
        name: said["reason"]
        for name, said in found.items()
        if attacks[name][1] not in said.get("reason", attacks[name][1])
    }
    assert not passed and not other, (
        f"passed: {json.dumps(passed, indent=1)}; for other reasons: {json.dumps(other, indent=1)}"
    )
    assert "SECRET" not in json.dumps(found)


HARMLESS = {
    "2 * (w + 1)": 8, "w if w > 2 and not False else 0": 3, "pi": 3.141592653589793, "math.sin(0)": 0.0, "-w ** 2": -9,
    "'a' + 'b'": "ab", "'left_arm'.split('_')[1].upper()": "ARM", "'x' in 'xyz'": True, "w in [1, 2, 3]": True,
    "[1, 2, 3][1:]": [2, 3], "max(1, len('abc'))": 3, "round(2.345, 2)": 2.35, "radians(180)": 3.141592653589793,
    "'%.2f' % 1.234": "1.23", "dict(a=1)['a']": 1, "list(map(int, ['1', '2']))": [1, 2], "1 < w <= 3": True,
    "python.sorted([2, 1], reverse=True)": [2, 1], "xacro.load_yaml('joints.yaml')['elbow']['upper']": 1.5,
    "xacro.load_yaml('joints.yaml').elbow.upper * 2": 3.0, "'_'.join(['a', 'b'])": "a_b", "w and 5 or 6": 5, "~w": -4,
    "(1, 2)[0]": 1, "str(w) + 'm'": "3m", "int(7 / 2)": 3, "7 // 2 + 7 % 2": 4, "complex(1, 2).imag": None,
}  # fmt: skip


def test_expressions_of_real_files_have_the_values_of_python(file):
    """A file of 27 expressions that occur in descriptions of robots."""
    (file.parent / "joints.yaml").write_text("elbow: {lower: -1.5, upper: 1.5}\n")
    wanted = {text: value for text, value in HARMLESS.items() if value is not None}
    lines = [f'<a v="${{{escaped(text)}}}"/>' for text in wanted]
    said = answer(file, '<xacro:property name="w" value="3"/>' + "".join(lines))
    found = [element.getAttribute("v") for element in parseString(said["text"]).getElementsByTagName("a")]
    assert found == [str(value) for value in wanted.values()]


BOMBS = {
    "macros": (
        "".join(
            f'<xacro:macro name="m{k}" params="">{f"<xacro:m{k - 1}/>" * 10 if k else LINK}</xacro:macro>'
            for k in range(10)
        )
        + "<xacro:m9/>",
        "took more than 0.4 s|longer than 1.2 s",
    ),
    "a text of lists of lists": (
        "".join(f'<xacro:property name="p{k + 1}" value="${{[{",".join([f"p{k}"] * 60)}]}}"/>' for k in range(8))
        + '<xacro:property name="p0" value="1"/><link name="${str(p8)}"/>',
        "memory|0.4 s|1.2 s",
    ),
    "an expression of macros' parameters": (
        f'<xacro:macro name="m" params="{"a" * 40}:=\'{"a" * 40}"/>{LINK}' + '<xacro:m b="1"/>',
        "xacro cannot expand it",
    ),
}


@pytest.mark.parametrize("bomb", BOMBS)
def test_expansion_ends_in_time_and_memory(bomb, tmp_path, monkeypatch):
    monkeypatch.setattr(room, "MAX_SECONDS", 0.4)
    text, words = BOMBS[bomb]
    path = tmp_path / "bomb.xacro"
    path.write_text(f"{HEAD}{text}</robot>")
    with pytest.raises(tw.RobotFileError, match=words):
        tw.load(path)


SYSTEM = """<robot name="{}"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_an_urdf_file_runs_no_commands(tmp_path, run):
    """Neither loaded nor examined, by no command; asked for, the expression is refused."""
    ran = tmp_path / "RAN"
    call = f"(lambda: [c for c in {SUBCLASSES} if c.__name__=='_wrap_close'][0].__init__.__globals__['system']('id > {ran}'))()"
    path = tmp_path / "robot.urdf"
    path.write_text(SYSTEM.format(f"${{{call}}}"))
    for command in ("info", "doctor", "payload", "verify", "convert", "view", "derive", "torques"):
        more = {
            "convert": [tmp_path / "o.xml"],
            "torques": ["--trajectory", tw.robots.path_of("ur5").with_name("ur5_demo.csv")],
            "view": ["--html", tmp_path / "v.html"],
        }
        code, said = run(command, path, *more.get(command, ()))
        assert code == 2 and "unexpanded xacro" in said and said.count("\n") <= 1, said
    for load in (tw.load, tw.doctor, lambda p: tw.load(p.read_text())):
        with pytest.raises(tw.RobotFileError, match="unexpanded xacro"):
            load(path)
    with pytest.raises(tw.RobotFileError, match=r"lambda.* is not allowed"):
        tw.load(path, xacro=True)
    assert run("info", path, "--xacro")[0] == 2
    path.rename(named := path.with_suffix(".xacro"))
    with pytest.raises(tw.RobotFileError, match=r"lambda.* is not allowed"):
        tw.load(named)
    assert not ran.exists()


IGNORED = {
    "a declaration": ('xmlns:xacro="http://www.ros.org/wiki/xacro"', ""),
    "a comment": ("", "<!-- <xacro:arm prefix='${p}'/> $(find x) -->"),
    "an ignored element": (
        "",
        '<gazebo><plugin file="$(find x)/${p}"/></gazebo><transmission name="t"><a v="${p}"/></transmission>',
    ),
    "a visual": ("", '<link name="c"><visual><geometry><mesh filename="${p}.stl"/></geometry></visual></link>'),
    "an ignored attribute": ("", '<material name="${p}"/>'),
    "a sensor": ("", '<sensor name="${p}"/>'),
}


@pytest.mark.parametrize("place", IGNORED)
def test_xacro_that_no_reader_reads_changes_nothing(place):
    attributes, more = IGNORED[place]
    text = SYSTEM.format("r").replace("<robot", f"<robot {attributes}").replace("</robot>", f"{more}</robot>")
    joint = '<joint name="f" type="fixed"><parent link="a"/><child link="c"/></joint>'
    text = text.replace("</robot>", f"{joint}</robot>") if 'name="c"' in more else text
    assert tw.load(text, inertia="accept").joint_names == ("j",)


@pytest.mark.parametrize("value", ["${1}", "$(arg x)"])
@pytest.mark.parametrize("old", ['name="r"', 'name="j"', 'type="revolute"', 'link="a"', 'xyz="0 0 1"', 'lower="-1"'])
def test_expressions_in_attributes_that_are_read_are_refused(old, value):
    name = old.partition("=")[0]
    text = SYSTEM.format("r").replace(old, f'{name}="{value}"', 1)
    with pytest.raises(tw.RobotFileError, match=r"unexpanded xacro.*xacro=True"):
        tw.load(text)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared robots are not there")
def test_finished_files_that_declare_xacro_are_read(capsys):
    files = [path for path in sorted((SHARED / "robots").rglob("*.urdf")) if b"xmlns:xacro" in path.read_bytes()]
    assert len(files) >= 8
    said = {path.name: xacro_in(path.read_text(errors="replace")) for path in files}
    assert {name for name, found in said.items() if found} == {"valkyrie_sim.urdf"}  # a macro of another file


def test_only_functions_of_the_table_are_called():
    names = {"largest": max, "run": exec}
    assert evaluate("largest(1, 2)", names, {id(max)}) == 2
    for text in ("run('1')", "run", "[run][0]", "{'a': run}"):
        with pytest.raises(Refused, match="exec is not a function of robot files"):
            evaluate(text, names, {id(max)})


def test_work_that_grows_with_a_number_is_refused_before_it_is_done():
    for text in (
        "factorial(100001)",
        "round(1, ndigits=-100001)",
        "range(100001)",
        "'a'.zfill(100001)",
        "comb(100001, 2)",
    ):
        names = {"factorial": math.factorial, "round": round, "range": range, "comb": math.comb}
        with pytest.raises(Refused, match="of a number above 100,000 is not allowed"):
            evaluate(text, names, set(map(id, names.values())))


# ── The audit hook alone, as expressions stop most attacks before it


@pytest.fixture
def bounds(tmp_path):
    """The hook for a robot's folder, beside which lies a file that is not the robot's."""
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "own.txt").write_bytes(bytes(600))
    (tmp_path / "secret.txt").write_bytes(b"x")
    found = Bounds()
    with found.enforce([str(tmp_path / "robot")], 1000):
        yield found


@pytest.mark.parametrize(
    "event",
    [
        "ctypes.dlopen", "exec", "import", "os.chdir", "os.exec", "os.fork", "os.kill", "os.mkdir", "os.putenv", "os.remove",
        "os.rename", "os.symlink", "os.system", "shutil.rmtree", "socket.connect", "subprocess.Popen", "sys.addaudithook", "x.new",
    ],
)  # fmt: skip
def test_the_hook_refuses_every_event_that_it_does_not_know(event, bounds):
    with pytest.raises(Refused, match="a robot file may not use"):
        bounds(event, ())


@pytest.mark.parametrize(
    ("mode", "flags"),
    [("w", 0), ("r+", 0), ("a", 0), ("x", 0), (None, os.O_WRONLY), (None, os.O_RDWR), (None, os.O_CREAT)],
)
def test_the_hook_refuses_to_write(mode, flags, bounds, tmp_path):
    with pytest.raises(Refused, match="may not write"):
        bounds("open", (str(tmp_path / "robot" / "own.txt"), mode, flags))


def test_the_hook_follows_links_and_adds_up_what_is_read(bounds, tmp_path):
    own, link = tmp_path / "robot" / "own.txt", tmp_path / "robot" / "link.txt"
    bounds("open", (str(own), "r", 0))
    with pytest.raises(Refused, match="lies outside its folder"):
        bounds("open", (str(tmp_path / "robot" / ".." / "secret.txt"), "r", 0))
    with contextlib.suppress(OSError):  # of systems that allow no links
        link.symlink_to(tmp_path / "secret.txt")
        with pytest.raises(Refused, match="lies outside its folder"):
            bounds("open", (str(link), "r", 0))
    with pytest.raises(Refused, match="lies outside its folder"):
        bounds("os.listdir", (str(tmp_path),))
    with pytest.raises(Refused, match="more than 0 MiB together"):
        bounds("open", (str(own), "r", 0))


def test_after_a_package_is_found_its_files_elsewhere_are_refused_again(bounds, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "package.xml").write_text("<package/>")
    find = PackageFinder(None, bounds, lambda name: str(tmp_path / name))
    assert find("robot") == str(tmp_path / "robot")
    with pytest.raises(Refused, match="the package 'other' lies outside"):
        find("other")
    with pytest.raises(Refused, match="lies outside its folder"):
        bounds("open", (str(tmp_path / "other" / "package.xml"), "r", 0))
