"""The live page answers its own page and nobody else: token, Host and Origin of every request, and no tunnel to the public.

Requests are written byte by byte, as a program of somebody else would write them.
"""

from __future__ import annotations

import base64
import os
import socket
import struct
import sys
import threading

import pytest

import twistwrench as tw

viser = pytest.importorskip("viser", reason="needs the extra viz")

from twistwrench.viz import LiveView  # noqa: E402
from twistwrench.viz.page_access import PageAccess  # noqa: E402


@pytest.fixture(scope="module")
def view():
    view = LiveView(tw.robots.pendulum(), port=0)
    yield view
    view.close()


def ask(view, path=None, *, host=None, origin=None, websocket=False, extra=()):
    """The status of the answer to one request, and what came with it."""
    port = view.server.get_port()
    lines = [f"GET {path if path is not None else f'/{view.access.token}/'} HTTP/1.1"]
    lines += [f"Host: {h}" for h in ([host] if isinstance(host, str) else host or [f"localhost:{port}"])]
    lines += [f"Origin: {o}" for o in ([origin] if isinstance(origin, str) else origin or [])]
    if websocket:
        key = base64.b64encode(os.urandom(16)).decode()
        lines += ["Upgrade: websocket", "Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]
        lines += [f"Sec-WebSocket-Protocol: viser-v{viser.__version__}"]
    lines += extra
    with socket.create_connection(("127.0.0.1", port), timeout=30) as line:
        line.sendall(("\r\n".join(lines) + "\r\n\r\n").encode("latin-1"))
        answer = b""
        while b"\r\n\r\n" not in answer and (part := line.recv(4096)):
            answer += part
        if websocket and b" 101 " in answer[:20]:
            while len(answer) < 4096:  # the scene comes by itself
                answer += line.recv(4096)
    return int(answer.split(b" ", 2)[1]), answer


def own(view):
    return f"http://localhost:{view.server.get_port()}"


def test_the_page_s_own_address_is_answered(view):
    status, page = ask(view)
    assert status == 200
    assert b"referrer-policy: no-referrer" in page.lower()
    assert view.url == f"{own(view)}/{view.access.token}/"
    assert ask(view, f"/{view.access.token}")[0] == 200
    assert ask(view, f"/{view.access.token}/?darkMode")[0] == 200
    assert ask(view, f"/{view.access.token}?darkMode")[0] == 200
    assert ask(view, host=f"127.0.0.1:{view.server.get_port()}")[0] == 200


@pytest.mark.parametrize("end", ["", "/"])
def test_the_page_s_own_websocket_is_answered(view, end):
    status, answer = ask(view, f"/{view.access.token}{end}", origin=own(view), websocket=True)
    assert status == 101
    assert len(answer) >= 4096


@pytest.mark.parametrize(
    "path", ["/", "", "/index.html", "/wrong/", "/?token", "//", "/{token}x/", "/x{token}/", "/%2e/{token}/"]
)
@pytest.mark.parametrize("websocket", [False, True])
def test_without_the_token_nothing_is_answered(view, path, websocket):
    path = path.format(token=view.access.token)
    status, answer = ask(view, path or "/", origin=own(view), websocket=websocket)
    assert status == 403
    assert b"viser" not in answer.lower()


def foreign_origins(view):
    port = view.server.get_port()
    return [
        "http://evil.example",
        f"http://evil.example:{port}",
        f"http://localhost:{port + 1 if port < 65535 else 1}",
        "http://localhost",
        f"https://localhost:{port}",
        f"http://localhost:{port}.evil.example",
        f"http://localhost.evil.example:{port}",
        "null",
        [own(view), "http://evil.example"],
    ]


def test_pages_of_others_are_refused_even_with_the_token(view):
    for origin in foreign_origins(view):
        for websocket in (False, True):
            assert ask(view, origin=origin, websocket=websocket)[0] in (400, 403), origin
    assert ask(view, websocket=True)[0] == 403  # every browser says where a websocket comes from
    assert ask(view, extra=["Upgrade: WebSocket"])[0] == 403  # however it is written


def test_names_of_others_that_lead_here_are_refused(view):
    """A page may let its own name lead to this computer, and would then be of one origin with what it finds here."""
    port = view.server.get_port()
    for host in (
        "evil.example",
        f"evil.example:{port}",
        f"localhost.evil.example:{port}",
        f"localhost:{port}.evil.example",
        "",
        [f"localhost:{port}"] * 2,
    ):
        for origin in (None, f"http://{host}", own(view)):
            assert ask(view, host=host if host else [""], origin=origin)[0] in (400, 403), host
            assert ask(view, host=host if host else [""], origin=origin, websocket=True)[0] in (400, 403), host


def test_a_port_that_ssh_forwards_may_have_another_number_here(view):
    assert ask(view, host="localhost:9000")[0] == 200
    assert ask(view, host="localhost:9000", origin="http://localhost:9000", websocket=True)[0] == 101
    assert ask(view, host="localhost:9000", origin=own(view), websocket=True)[0] == 403


def test_every_page_has_a_token_of_its_own():
    tokens = {PageAccess("127.0.0.1").token for _ in range(100)}
    assert len(tokens) == 100
    assert min(map(len, tokens)) >= 22  # 128 bits


def test_a_page_for_others_is_guarded_too_and_answers_to_its_address():
    view = LiveView(tw.robots.pendulum(), port=0, host="0.0.0.0")
    try:
        port = view.server.get_port()
        assert view.url.startswith("http://localhost:")
        assert ask(view)[0] == 200
        assert ask(view, host=f"127.0.0.1:{port}")[0] == 200  # the address that the connection came to
        assert ask(view, host=f"{socket.gethostname()}:{port}")[0] == 200
        assert ask(view, host=f"evil.example:{port}")[0] == 403
        assert ask(view, "/")[0] == 403
        assert ask(view, origin="http://evil.example", websocket=True)[0] == 403
    finally:
        view.close()


def masked(payload: bytes) -> bytes:
    """One binary frame of a client."""
    key = os.urandom(4)
    body = bytes(b ^ key[k % 4] for k, b in enumerate(payload))
    assert len(payload) < 126
    return struct.pack("!BB", 0x82, 0x80 | len(payload)) + key + body


def test_no_tunnel_to_the_public_is_opened(view, monkeypatch):
    """Neither by Python nor by a page that is connected and asks for it."""
    import msgspec
    from viser import _messages

    def tunnel(*_, **__):
        raise AssertionError("a tunnel")

    monkeypatch.setattr(sys.modules[viser.ViserServer.__module__], "ViserTunnel", tunnel)
    assert view.server.request_share_url() is None
    asked = threading.Event()
    answer = type(view.server).request_share_url
    monkeypatch.setattr(type(view.server), "request_share_url", lambda self, *a: (answer(self, *a), asked.set())[0])
    port = view.server.get_port()
    with socket.create_connection(("127.0.0.1", port), timeout=30) as line:
        key = base64.b64encode(os.urandom(16)).decode()
        line.sendall(
            (
                f"GET /{view.access.token} HTTP/1.1\r\nHost: localhost:{port}\r\nOrigin: {own(view)}\r\nUpgrade: websocket\r\n"
                f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
                f"Sec-WebSocket-Protocol: viser-v{viser.__version__}\r\n\r\n"
            ).encode()
        )
        assert b" 101 " in line.recv(4096)[:20]
        line.sendall(masked(msgspec.msgpack.encode({"type": _messages.ShareUrlRequest.__name__})))
        assert asked.wait(30)
    assert view.server._share_tunnel is None


def test_a_viser_that_starts_its_server_otherwise_is_not_served(monkeypatch):
    """What cannot be guarded is closed: here the guard finds no server of viser's to guard."""
    monkeypatch.setattr(PageAccess, "checked", lambda self, answer: answer)
    monkeypatch.setattr(PageAccess, "guards", property(lambda self: False, lambda self, _: None), raising=False)
    with pytest.raises(tw.MissingExtraError, match="viser"):
        LiveView(tw.robots.pendulum(), port=0)


def test_other_servers_of_websockets_are_left_alone(monkeypatch):
    import websockets.asyncio.server as servers

    made = []
    monkeypatch.setattr(servers, "serve", lambda *args, **options: made.append((args, options)))
    plain, access = servers.serve, PageAccess("127.0.0.1")
    with access.guarding():
        servers.serve(test_other_servers_of_websockets_are_left_alone, "127.0.0.1", 0, compression=None)
    assert made == [
        (
            (test_other_servers_of_websockets_are_left_alone, "127.0.0.1", 0),
            {"process_request": None, "compression": None},
        )
    ]
    assert not access.guards
    assert servers.serve is plain
    with pytest.raises(RuntimeError), access.guarding():
        raise RuntimeError
    assert servers.serve is plain
