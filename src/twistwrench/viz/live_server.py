"""The server of the live page: the port it is at, and viser without its way to the public."""

from __future__ import annotations

import contextlib
import io
import socket
from typing import TYPE_CHECKING

from ..errors import ValueRangeError

if TYPE_CHECKING:
    import viser


def check_port(port: int, host: str = "127.0.0.1") -> None:
    """Raise ValueRangeError where nothing can be served at ``port``; 0 means any that is free."""
    if not 0 <= port <= 65535:
        raise ValueRangeError(f"port {port} does not exist. Give 1024 to 65535, or 0 for any that is free.")
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does: what has just closed is free
        try:
            probe.bind((host, port))
        except OSError as problem:
            beside = port + 1 if 1024 <= port < 65535 else 8080
            raise ValueRangeError(
                f"port {port} of {host} cannot be used: {problem.strerror or problem}. "
                f"Give another, such as --port {beside}, or --port 0 for any that is free."
            ) from None


def private_server() -> type[viser.ViserServer]:
    """viser's server with its tunnel to the public closed: any page that is connected may ask for one."""
    import viser

    class PrivateServer(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> None:
            """Refuse."""

    return PrivateServer


def silence() -> contextlib.redirect_stdout[io.StringIO]:
    """A context in which nothing is printed."""
    return contextlib.redirect_stdout(io.StringIO())
