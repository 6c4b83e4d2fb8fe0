"""A headless Chromium driven over its DevTools protocol: pages opened, scripts run in them, what they say on their console."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--window-size=1280,800",
    "--remote-debugging-port=0",
    "--remote-allow-origins=*",
)


def find_chromium() -> str | None:
    return next(filter(None, map(shutil.which, NAMES)), None)


class Page:
    """One tab. What the page writes to its console as an error or a warning, and errors nobody caught, are in ``complaints``."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.number, self.complaints = socket, 0, []
        self.requests: list[str] = []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self.socket.recv(timeout=60))
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        kind, what = event.get("method"), event.get("params", {})
        if kind == "Runtime.exceptionThrown":
            self.complaints.append(what["exceptionDetails"].get("exception", {}).get("description", str(what)))
        elif kind == "Runtime.consoleAPICalled" and what["type"] in ("error", "assert"):
            self.complaints.append(" ".join(str(a.get("value", a.get("description"))) for a in what["args"]))
        elif kind == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.complaints.append(f"{what['entry']['text']} {what['entry'].get('url', '')}")
        elif kind == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"])

    def offline(self) -> None:
        """Cut the network off."""
        nothing = {"latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
        self.call("Network.emulateNetworkConditions", offline=True, **nothing)

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)
        self.wait("location.href !== 'about:blank' && document.readyState === 'complete'")

    def run(self, script: str) -> Any:
        """The value of an expression; promises are waited for."""
        found = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, script: str, seconds: float = 30.0) -> Any:
        """The expression's value once it is true."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if value := self.run(script):
                return value
            time.sleep(0.05)
        pytest.fail(f"never came true: {script}; the page said {self.complaints}")

    def picture(self) -> Any:
        """What is on the screen, (height, width, 3) of uint8."""
        from io import BytesIO

        import numpy as np
        from PIL import Image

        data = self.call("Page.captureScreenshot", format="png")["data"]
        return np.asarray(Image.open(BytesIO(base64.b64decode(data))).convert("RGB"))

    def drag(self, *points: tuple[float, float]) -> None:
        """Press the mouse at the first point, and let it go at the last."""
        for k, (x, y) in enumerate(points):
            self.call(
                "Input.dispatchMouseEvent",
                type="mouseMoved" if k else "mousePressed",
                x=x,
                y=y,
                button="left",
                buttons=1,
                clickCount=1,
            )
        x, y = points[-1]
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, button="left", buttons=0, clickCount=1)

    def click(self, selector: str) -> None:
        """A click of the mouse in the middle of an element."""
        box = f"document.querySelector({selector!r}).getBoundingClientRect()"
        x, y = self.run(f"[{box}.x + {box}.width / 2, {box}.y + {box}.height / 2]")
        self.drag((x, y))


WITHOUT_WEBGL = (*(flag for flag in FLAGS if "swiftshader" not in flag), "--disable-3d-apis")


@contextmanager
def browser(flags: tuple[str, ...] = FLAGS) -> Iterator[Page]:
    """A browser of one's own, with one empty page; the test is skipped where there is none."""
    client = pytest.importorskip("websockets.sync.client", reason="needs the extra viz")
    program = find_chromium()
    if program is None:
        pytest.skip("needs Chromium")
    profile = tempfile.mkdtemp(prefix="chromium-")
    process = subprocess.Popen(
        [program, *flags, f"--user-data-dir={profile}", "about:blank"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "HOME": profile},
    )
    try:
        with client.connect(_address(Path(profile), process), max_size=None) as socket:
            yield Page(socket)
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        shutil.rmtree(profile, ignore_errors=True)


def _address(profile: Path, process: subprocess.Popen[bytes]) -> str:
    """The socket of the first page, once the browser tells its port."""
    end = time.monotonic() + 60
    while time.monotonic() < end and process.poll() is None:
        told = profile / "DevToolsActivePort"
        if told.is_file() and (lines := told.read_text().split()):
            with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json/list", timeout=10) as answer:
                for page in json.load(answer):
                    if page["type"] == "page":
                        return page["webSocketDebuggerUrl"]
        time.sleep(0.1)
    pytest.skip(f"Chromium does not start here (exit code {process.poll()})")
