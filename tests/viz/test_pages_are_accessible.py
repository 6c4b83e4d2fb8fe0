"""Every kind of page, on a desktop and a phone, in light and dark, examined by axe-core, which is not a dependency.

``npm install --no-save axe-core`` puts it where these tests look; ``AXE_CORE`` names its file elsewhere.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner
from places import ROOT

import twistwrench as tw
from twistwrench.cli import main

pytest_plugins = ("page_fixtures",)
AXE = Path(os.environ.get("AXE_CORE", ROOT / "node_modules/axe-core/axe.min.js"))
SECTIONS = ["3.4", "5.1", "5.2", "5.3", "5.4", "8.1.2", "8.1.3", "8.2", "8.3", "8.4", "8.5", "8.6", "8.7", "8.9"]
PAGES = {
    **{f"article {number}": ["view", "--section", number, "--html"] for number in ("3.4", "5.2", "8.1", "8.2", "8.3", "8.9")},
    **{f"section {number}": ["view", "ur5", "--section", number, "--html"] for number in SECTIONS},
    "viewer": ["view", "ur5", "--html"],
    "viewer of a robot that stands": ["view", "quadruped", "--html"],
    "viewer of a motion": ["view", "ur5", "--trajectory", "demo", "--payload", "10", "--html"],
    "frame": ["view", "ur5", "--trajectory", "demo", "--payload", "10", "--embed", "--html"],
    "frame of a section": ["view", "ur5", "--section", "5.4", "--embed", "--html"],
    "report of torques": ["torques", "ur5", "--trajectory", "demo", "--payload", "10", "--report"],
    "report of feet": ["torques", "quadruped", "--feet", "auto", "--report"],
    "report of a payload": ["payload", "ur5", "--report"],
    "report of the doctor": ["doctor", "ur5", "--report"],
    "report of a simulation": ["simulate", "ur5", "--report"],
    "report of a calibration": ["calibrate", "ur5", "demo", "--report"],
}  # fmt: skip
EXAMINED = """axe.run().then(({ violations }) => violations.filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => [id, nodes.slice(0, 3).map((node) => node.target.join(" "))]))"""


@pytest.fixture(scope="module")
def axe():
    if not AXE.is_file():
        pytest.skip("needs axe-core: npm install --no-save axe-core, or AXE_CORE=its axe.min.js")
    return AXE.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_a_page_has_no_serious_barrier(page, axe, name, tmp_path):
    path = tmp_path / "page.html"
    done = CliRunner().invoke(main, [*PAGES[name], str(path)])
    assert path.is_file(), done.output
    try:
        for width, height in ((1280, 800), (390, 844)):
            page.call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            for scheme in ("light", "dark"):
                page.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
                page.call("Page.navigate", url="about:blank")
                page.open(path.as_uri())
                page.wait("!document.querySelector('main.waiting')")
                page.run(f"{axe};null")
                assert page.run(EXAMINED) == [], (width, scheme)
    finally:
        page.call("Emulation.clearDeviceMetricsOverride")
        page.call("Emulation.setEmulatedMedia", features=[])


NAMELESS = """Array.from(document.querySelectorAll("main input, main select, main button"))
    .filter((e) => !e.labels?.length && !e.getAttribute("aria-label") && !e.getAttribute("aria-labelledby") && !e.textContent.trim())
    .map((e) => e.id || e.outerHTML)"""


def test_every_control_of_a_page_has_a_name(show):
    """Those who hear a page know a slider by its name alone; this needs no axe."""
    page = show("ur5_names", tw.robots.ur5())
    assert page.run("document.querySelectorAll('main input').length") >= 6
    assert page.run(NAMELESS) == []
