"""Write docs/viewer*.webp, pictures of the viewer's pages in a headless Chromium, which draws by software.

``python docs/viewer_pictures.py``, or with names: ``python docs/viewer_pictures.py fall mass``.
"""

from __future__ import annotations

import runpy
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
SIZE = 1280, 800
QUALITY = 85
MOST_BYTES = 120_000


@dataclass(frozen=True)
class PagePicture:
    """One page, and what is done on it before its picture is taken."""

    robot: str
    options: dict[str, Any] = field(default_factory=dict)
    """Options of the page."""
    work: str = ""
    """Script that is run on the page."""


PICTURES = {
    "": PagePicture("ur5", {"motion": 10.0}, "viewer.seek(0)"),
    "mass": PagePicture("panda", {"section": "8.1.3"}),
    "manipulability": PagePicture("ur5", {"section": "5.4"}),
    "wall": PagePicture("panda", {"section": "8.7"}),
    "fall": PagePicture(
        "panda",
        {},
        "viewer.mechanics.mass = 3; viewer.mechanics.push[0] = 60; viewer.panel.load.tell(); viewer.loaded(); viewer.letGo(); "
        "viewer.frame = () => {}; for (let k = 0; k < 60; k++) viewer.fallOn(1 / 120)",
    ),
    "standing": PagePicture(
        "quadruped", {}, "viewer.slide(viewer.robot.hands.findIndex((hand) => hand.name === 'root_joint x'), 0.08)"
    ),
    "forces": PagePicture("ur5", {}, "viewer.panel.show('ellipsoid', true); viewer.panel.show('polytope', true)"),
}
"""Pictures by what follows the name: viewer.webp, viewer_mass.webp."""


def page_text(picture: PagePicture, demo_motion: Callable[[float], Any]) -> str:
    """Text of the page of a picture."""
    import twistwrench as tw
    from twistwrench.viz.page import viewer_page

    options = dict(picture.options)
    if "motion" in options:
        options["motion"] = demo_motion(options["motion"])
    return viewer_page(getattr(tw.robots, picture.robot)(), **options).page


def written(content: bytes, path: Path) -> int:
    """Write a picture; its bytes. Raises ValueError if they are too many."""
    from io import BytesIO

    from PIL import Image

    Image.open(BytesIO(content)).convert("RGB").save(path, quality=QUALITY, method=6)
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ValueError(f"{path.name}: {size} bytes, more than {MOST_BYTES}. Lower QUALITY.")
    return size


def main(names: list[str]) -> None:
    """Write the pictures with these names, or all."""
    import base64

    chromium = runpy.run_path(str(ROOT / "tests" / "support" / "chromium.py"))
    demo_motion = runpy.run_path(str(ROOT / "docs" / "site.py"))["demo_motion"]
    with tempfile.TemporaryDirectory() as folder, chromium["browser"]() as page:
        width, height = SIZE
        page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        for name in names or PICTURES:
            picture, path = PICTURES[name], Path(folder) / f"{name or 'viewer'}.html"
            path.write_text(page_text(picture, demo_motion), "utf-8")
            page.open(path.as_uri())
            page.wait("!!window.viewer")
            page.run(f"(() => {{ {picture.work}; viewer.draw(); }})()")
            page.run("new Promise((done) => setTimeout(done, 1000))")
            content = base64.b64decode(page.call("Page.captureScreenshot", format="png")["data"])
            target = ROOT / "docs" / f"viewer{name and '_'}{name}.webp"
            print(f"{target.relative_to(ROOT)}: {written(content, target)} bytes")


if __name__ == "__main__":
    main(sys.argv[1:])
