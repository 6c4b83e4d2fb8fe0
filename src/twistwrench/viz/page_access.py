"""Who may see and move the live page: those who know its address, token and all, and come from the page itself.

A browser lets any page that is open in it connect to servers of the same computer. So three things are asked of every
request: the Host it names is this computer (a name of somebody else that leads here is refused), the Origin, which browsers
send along and pages cannot change, is the page itself, and its path begins with a token that was drawn when the page was made.
"""

from __future__ import annotations

import dataclasses
import http
import re
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ..errors import MissingExtraError

Handler = Callable[[Any, Any], Any]
"""Takes a connection and the request that opens it; returns a response, or None where a websocket is to be opened."""

_OWN_NAMES = ("localhost", "127.0.0.1", "[::1]")
_ANYWHERE = ("", "0.0.0.0", "::")
_NAME_AND_PORT = re.compile(r"(\[[0-9a-f:.]+\]|[^:]+)(?::[0-9]{1,5})?")
_REFUSED = "Refused. Open the address that twistwrench printed, with all that stands after the port.\n"
_SERVING = threading.Lock()


class PageAccess:
    """The token of one page, and the check of its requests. ``host`` is the address that the page is served at."""

    def __init__(self, host: str) -> None:
        self.token = secrets.token_urlsafe(16)
        self.guards = False
        """Whether a server asks for it."""
        self._host = host

    def url(self, port: int) -> str:
        """The address of the page."""
        name = "localhost" if self._host in ("127.0.0.1", *_ANYWHERE) else _bracketed(self._host)
        return f"http://{name}:{port}/{self.token}/"

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Have the server of viser that is made within answer nothing but what passes the check.

        viser has no place of its own for one, so what it starts its server with is replaced while it does. Raises
        :class:`~twistwrench.MissingExtraError` for a viser that starts its server otherwise: nothing is served unguarded.
        """
        import websockets.asyncio.server as servers

        plain: Any = servers.serve

        def serve(handler: Any, *args: Any, process_request: Handler | None = None, **options: Any) -> Any:
            if not str(getattr(handler, "__module__", "")).startswith("viser."):
                return plain(handler, *args, process_request=process_request, **options)
            self.guards = True
            return plain(handler, *args, process_request=self.checked(process_request), **options)

        with _SERVING:
            servers.serve = serve  # type: ignore[assignment, misc]
            try:
                yield
            finally:
                servers.serve = plain  # type: ignore[misc]

    def require(self) -> None:
        """Raise where no server asks for the token."""
        if not self.guards:
            raise MissingExtraError(
                "The live view needs a 'viser' whose page can be kept from other pages, and this version's cannot: "
                "pip install 'viser==1.1.*'."
            )

    def checked(self, answer: Handler | None) -> Handler:
        """``answer`` for the requests that pass, with the token taken off their path; a refusal for all others."""

        def check(connection: Any, request: Any) -> Any:
            rest = self._rest(request.path)
            if rest is None or not self._from_here(connection, request):
                return connection.respond(http.HTTPStatus.FORBIDDEN, _REFUSED)
            response = None if answer is None else answer(connection, dataclasses.replace(request, path=rest))
            if response is not None:
                response.headers["Referrer-Policy"] = "no-referrer"  # the token is in the address
            return response

        return check

    def _rest(self, path: str) -> str | None:
        """What follows the token in a path; None without it."""
        given, slash, rest = path.removeprefix("/").partition("/")
        given, mark, query = given.partition("?")
        if not secrets.compare_digest(given.encode(errors="replace"), self.token.encode()):
            return None
        return f"/{rest}" if slash else f"/{mark}{query}"

    def _from_here(self, connection: Any, request: Any) -> bool:
        """Whether Host names this computer, and Origin says the same as Host where there is one; pages always send one.

        The port in Host is that of the browser's end, which may be another where the port is forwarded by SSH.
        """
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        if len(hosts) != 1:
            return False
        name = _NAME_AND_PORT.fullmatch(hosts[0].lower())
        if name is None or name[1] not in self._names(connection.local_address[0]):
            return False
        if not origins:
            return not request.headers.get_all("Upgrade")
        return len(origins) == 1 and origins[0].lower() == f"http://{hosts[0].lower()}"

    def _names(self, address: str) -> set[str]:
        """What this computer is called in addresses of the page; ``address`` is the one that the connection came to."""
        if self._host not in _ANYWHERE:
            return {*_OWN_NAMES, _bracketed(self._host)}
        own = socket.gethostname().lower()
        return {*_OWN_NAMES, _bracketed(address), own, f"{own}.local"}


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host.lower()
