"""The server of `twistwrench mcp` answers in the protocol, gives what --json gives, and stays within its folder."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import twistwrench as tw
from twistwrench.cli.assistant.confinement import Folder
from twistwrench.cli.assistant.tools import Tools
from twistwrench.core.errors import ValueRangeError

ARM = """<robot name="arm"><link name="base"/><link name="a">{mesh}<inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="50"/></joint></robot>"""
MJCF = '<mujoco><include file="{file}"/></mujoco>'


_FACES = ("000", "010", "100"), ("000", "001", "010"), ("000", "100", "001"), ("100", "010", "001")
_CORNERS = {name: " ".join(str(0.1 * int(digit)) for digit in name) for name in ("000", "100", "010", "001")}
_VERTICES = ["\n".join(f"vertex {_CORNERS[name]}" for name in face) for face in _FACES]
_FACETS = [f"facet normal 0 0 0\nouter loop\n{vertices}\nendloop\nendfacet" for vertices in _VERTICES]
CORNER = "\n".join(["solid corner", *_FACETS, "endsolid corner\n"])
"""A tetrahedron of 0.1 m: the tensor that the doctor proposes for its link is another one than without it."""


class Client:
    """Client of the protocol on the pipes of a server."""

    def __init__(self, folder, *words):
        command = [sys.executable, "-m", "twistwrench", "mcp", str(folder), *words]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self.number = 0

    def end(self):
        """Exit code and standard error of the server once its input has ended."""
        self.process.stdin.close()
        code, error = self.process.wait(20), self.process.stderr.read()
        self.process.stdout.close()
        self.process.stderr.close()
        return code, error

    def send(self, line: bytes):
        self.process.stdin.write(line + b"\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def ask(self, method, **params):
        self.number += 1
        request = {"jsonrpc": "2.0", "id": self.number, "method": method, "params": params}
        answer = self.send(json.dumps(request).encode())
        assert answer["jsonrpc"] == "2.0"
        assert answer["id"] == self.number
        return answer

    def call(self, name, **arguments):
        """Text of a result, and whether it is an error."""
        (content,) = (result := self.ask("tools/call", name=name, arguments=arguments)["result"])["content"]
        return content["text"], result["isError"]


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Folder of a server, and files beside it that it must not touch."""
    root = tmp_path_factory.mktemp("served")
    inside, outside = root / "inside", root / "outside"
    inside.mkdir()
    outside.mkdir()
    for name, folder in (("arm.urdf", inside), ("arm.urdf", outside)):
        (folder / name).write_text(ARM.format(mesh=""))
    (outside / "secret.xml").write_text("<mujoco><worldbody><body name='secret'/></worldbody></mujoco>")
    for folder in (inside, outside):
        (folder / "box.stl").write_text(CORNER)
    (inside / "package.xml").write_text("<package><name>inside</name></package>")
    (inside / "link.urdf").symlink_to(outside / "arm.urdf")
    (inside / "link.stl").symlink_to(outside / "box.stl")
    (inside / "linked").symlink_to(outside)
    (inside / "include.xml").write_text(MJCF.format(file="../outside/secret.xml"))
    (inside / "arm.xacro").write_text(ARM.format(mesh=""))
    return inside, outside


@pytest.fixture(scope="module")
def client(places):
    client = Client(places[0])
    yield client
    assert client.end() == (0, b"")


def test_eight_tools_are_listed_in_five_kilobytes(client):
    started = client.ask("initialize", protocolVersion="2025-06-18", capabilities={}, clientInfo={"name": "test"})[
        "result"
    ]
    assert started["protocolVersion"] == "2025-06-18"
    assert client.ask("initialize", protocolVersion="1999-01-01")["result"]["protocolVersion"] == "2025-11-25"
    assert client.ask("ping")["result"] == {}
    tools = client.ask("tools/list")["result"]["tools"]
    assert [tool["name"] for tool in tools] == [
        "torques",
        "payload",
        "doctor",
        "info",
        "identify",
        "move",
        "size",
        "convert",
    ]
    assert all(len(tool["inputSchema"]["properties"].keys() - {"more"}) <= 6 for tool in tools)
    assert all("more" in tool["inputSchema"]["properties"] for tool in tools)
    assert len(json.dumps(tools, separators=(",", ":"), ensure_ascii=False).encode()) <= 5000


def test_results_are_those_of_the_library_with_the_verdict_first(client):
    text, is_error = client.call("torques", robot="ur5", motion="demo", payload=10)
    expected = tw.check("ur5", "demo", payload=10.0)
    assert not is_error
    assert text.startswith('{"verdict":"OVER LIMIT","sentences":["OVER LIMIT: shoulder_lift_joint needs -167.0 N m')
    assert json.loads(text)["tables"] == json.loads(json.dumps(expected.to_dict()))["tables"]


def test_lists_and_further_options_are_those_of_the_shell(client):
    found = [
        client.call("payload", robot="ur5", at=[0, -0.9, 1.0, -0.4, 1.2, 0]),
        client.call("payload", robot="ur5", at="0,-0.9,1.0,-0.4,1.2,0"),
        client.call("payload", robot="ur5", more="--at=0,-0.9,1.0,-0.4,1.2,0"),
    ]
    numbers = [json.loads(text)["tables"] for text, _ in found]
    assert numbers[0] == numbers[1] == numbers[2]
    assert client.call("info", robot="ur5", more="--help")[0].startswith("Usage: twistwrench info")


@pytest.mark.parametrize(
    ("tool", "arguments", "sentence"),
    [
        ("info", {"robot": "no_such_robot"}, "no robot file 'no_such_robot'"),
        ("info", {"robot": "ur5", "tp": "tool0"}, "tip"),
        ("info", {"robot": "ur5", "more": "--no-such"}, "No such option"),
        ("info", {"robot": "ur5", "more": "'"}, "Close the quotation"),
        ("info", {"robot": {"a": 1}}, "Give a text, a number"),
        ("info", {"robot": "-"}, "is not a path"),
        ("info", {}, "Missing ROBOT"),
        ("torques", {"robot": "ur5", "motion": "demo", "more": "--workers 2"}, "not an option of this server"),
        ("info", {"robot": "ur5", "more": "--json out.json"}, "not an option of this server"),
        ("info", {"robot": "arm.xacro"}, "macros of xacro are not expanded"),
        ("info", {"robot": "arm.urdf", "more": "--xacro a:=1"}, "macros of xacro are not expanded"),
    ],
)
def test_mistakes_are_errors_of_the_call_with_the_remedy(client, tool, arguments, sentence):
    text, is_error = client.call(tool, **arguments)
    assert is_error
    assert sentence in text


def test_no_path_leads_outside_the_folder(client, places):
    inside, outside = places
    before = sorted(path.name for path in outside.iterdir())
    assert not client.call("info", robot="arm.urdf")[1]
    assert not client.call("info", robot=str(inside / "arm.urdf"))[1], "an absolute path in the folder"
    for name in (
        str(outside / "arm.urdf"),
        "../outside/arm.urdf",
        "link.urdf",
        "linked/arm.urdf",
        "~/arm.urdf",
        "linked",
    ):
        text, is_error = client.call("info", robot=name)
        assert is_error, name
        assert "the folder of this server" in text
    refused = [
        client.call("convert", robot="arm.urdf", out="../outside/new.xml"),
        client.call("convert", robot="arm.urdf", out="linked/new.xml"),
        client.call("info", robot="arm.urdf", more="--csv ../outside/new.csv"),
        client.call("torques", robot="arm.urdf", motion="linked/*.csv"),
        client.call("torques", robot="ur5", motion="demo", limits="linked/limits.csv"),
        client.call("torques", robot="ur5", motion="demo", more="--columns @../outside/arm.urdf"),
        client.call("info", robot="include.xml"),
        client.call("info", robot="include.xml", more="--include-path ../outside"),
    ]
    assert all(is_error for _, is_error in refused), refused
    assert sorted(path.name for path in outside.iterdir()) == before
    assert "secret" not in "".join(text for text, _ in refused[-2:]).replace("secret.xml", "")


def test_meshes_of_a_robot_file_are_read_in_the_folder_only(client, places):
    """A mesh elsewhere is as one that is missing; one in the folder changes what the doctor finds."""
    inside, outside = places

    def findings(name):
        shape = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        (inside / "shaped.urdf").write_text(ARM.format(mesh=shape))
        text, is_error = client.call("doctor", robot="shaped.urdf")
        assert not is_error, text
        return json.loads(text)["findings"]

    missing = findings("missing.stl")
    assert findings("box.stl") != missing
    for name in ("link.stl", "../outside/box.stl", str(outside / "box.stl"), f"file://{outside}/box.stl"):
        assert findings(name) == missing, name


def test_files_are_written_in_the_folder(client, places):
    text, is_error = client.call("convert", robot="arm.urdf", out="arm.xml")
    assert not is_error, text
    assert tw.load(places[0] / "arm.xml").nv == 1
    text, is_error = client.call("convert", robot="arm.urdf", out="arm.xml")
    assert is_error
    assert "overwrite" in text


def test_lines_that_are_not_requests_are_answered_and_the_next_is_served(client):
    codes = {
        b"not JSON": -32700,
        b"\xff\xfe": -32700,
        b"[" * 100_000: -32700,
        b"[]": -32600,
        b'"text"': -32600,
        b'{"id": 1}': -32600,
        b'{"id": 1, "method": "ping", "params": [1]}': -32600,
        b'{"id": 1, "method": "resources/list"}': -32601,
        b'{"id": 1, "method": "tools/call", "params": {"name": "rm"}}': -32602,
        b'{"id": 1, "method": "tools/call", "params": {"name": "info", "arguments": [1]}}': -32602,
        b'{"id": 1, "method": "ping", "params": {"x": "' + b"x" * (3 << 20) + b'"}}': -32600,
    }
    for line, code in codes.items():
        assert client.send(line)["error"]["code"] == code, line[:40]
    client.process.stdin.write(b'\n{"jsonrpc": "2.0", "method": "notifications/initialized"}\n')
    assert client.ask("ping")["result"] == {}, "a notification and a blank line have no answer"


GUARDED = """
import os, socket, subprocess, sys
from twistwrench.cli.assistant.confinement import Folder
from twistwrench.core.child_process import run_in_child
from twistwrench.core.errors import ValueRangeError
inside, outside = sys.argv[1:]
Folder(inside).confine()
open("new.txt", "w").close()
os.remove("new.txt")
run_in_child("os:listdir", inside, error_of=ValueRangeError)
attempts = {
    "read": lambda: open(f"{outside}/box.stl"),
    "link": lambda: open("link.stl"),
    "list": lambda: os.listdir(outside),
    "write": lambda: open(f"{outside}/new", "w"),
    "installation": lambda: open(os.__file__, "a"),
    "make": lambda: os.mkdir(f"{outside}/new"),
    "move": lambda: os.rename("arm.urdf", f"{outside}/new"),
    "remove": lambda: os.remove(f"{outside}/box.stl"),
    "connect": lambda: socket.create_connection(("127.0.0.1", 9), 1),
    "start": lambda: subprocess.run(["true"]),
    "child": lambda: run_in_child("os:listdir", outside, error_of=ValueRangeError),
}
for name, attempt in attempts.items():
    try:
        attempt()
    except (PermissionError, ValueRangeError):
        continue
    print(name)
"""


def test_whatever_opens_a_file_in_the_process_or_a_child_is_confined(places):
    command = [sys.executable, "-c", GUARDED, *map(str, places)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert found.stderr == ""
    assert found.stdout == "", "attempts that were not refused"


@pytest.mark.slow
def test_a_closed_pipe_ends_the_server(tmp_path):
    client = Client(tmp_path)
    client.process.stdout.close()
    client.process.stdin.write(b'{"jsonrpc": "2.0", "id": 1, "method": "ping"}\n')
    client.process.stdin.flush()
    assert client.process.wait(20) == 141
    assert client.end() == (141, b"")


@pytest.mark.slow
def test_xacro_is_expanded_if_the_server_is_started_with_it(places):
    pytest.importorskip("xacrodoc")
    client = Client(places[0], "--expand-xacro")
    text, is_error = client.call("info", robot="arm.xacro")
    client.end()
    assert not is_error, text


def test_every_option_of_a_tool_that_names_a_file_is_confined(tmp_path):
    tools = Tools(Folder(tmp_path))
    for tool in tools.by_name.values():
        files = [
            one for one in tool.command.params if "FILE" in (one.metavar or "") or str(one.name).startswith("file_")
        ]
        assert files
        for one in files:
            with pytest.raises(ValueRangeError):
                tools._check(tool, [f"{one.opts[0]}=/etc/passwd"])


def test_a_link_to_a_file_of_xacro_is_a_file_of_xacro(tmp_path):
    """Macros run code of the file; neither its name nor that of a link to it lets them."""
    (tmp_path / "arm.xacro").write_text(ARM.format(mesh=""))
    (tmp_path / "arm.urdf").symlink_to("arm.xacro")
    for name in ("arm.xacro", "arm.urdf"):
        found = Tools(Folder(tmp_path)).call("info", {"robot": name})
        assert found.is_error
        assert "macros of xacro are not expanded by this server" in found.text
