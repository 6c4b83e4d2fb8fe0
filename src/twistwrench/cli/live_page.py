"""Serving the live page from the shell: its port, the browser that is opened on it, and its end."""

from __future__ import annotations

import os
import sys
import webbrowser
from typing import TYPE_CHECKING

import click

from ..errors import ValueRangeError

if TYPE_CHECKING:
    from ..viz.live import LiveView

PORT = 8080


def served_port(port: int | None, host: str) -> int:
    """The port to serve at: the one asked for, or the usual one, or any if that is taken."""
    from ..viz.live_server import check_port

    if port is not None:
        check_port(port, host)
        return port
    try:
        check_port(PORT, host)
    except ValueRangeError:
        check_port(0, host)
        click.echo(f"note: port {PORT} is taken, so another is used. Choose one with --port N.", err=True)
        return 0
    return PORT


def require_viser() -> None:
    """Raise MissingExtraError without it."""
    from importlib.util import find_spec

    from ..errors import MissingExtraError

    if find_spec("viser") is None:
        raise MissingExtraError.of("viser", "viz", "The live view (or write a page: --html OUT.html; it)")


def serve(view: LiveView, *, browse: bool) -> None:
    """Serve the page until Ctrl-C."""
    try:
        opened = browse and _open_browser(view.url)
        if browse and not opened:
            click.echo(
                f"note: no browser could be opened here. Open {view.url} in one, or write a page with --html.", err=True
            )
        click.echo(f"{view.robot.name} at {view.url}   (Ctrl-C ends)")
        view.serve()
    except KeyboardInterrupt:
        click.echo("ended")
    finally:
        view.close()


def _open_browser(url: str) -> bool:
    """Whether a browser with windows came up; one that would take over the terminal is none."""
    if sys.platform.startswith("linux") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))):
        return False
    try:
        return webbrowser.open(url)
    except (webbrowser.Error, OSError):
        return False
