"""Fixtures of the tests of pages in a browser."""

from __future__ import annotations

import pytest
from chromium import browser

from twistwrench.viz import write_page

READY = "!!window.viewer || document.getElementById('failure').textContent"


@pytest.fixture(scope="module")
def page():
    with browser() as found:
        found.offline()
        yield found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def show(page, folder):
    """Opens a robot's page, and checks that it comes up without a complaint and asks for nothing."""

    def show(name, robot, **options):
        path = folder / f"{name}.html"
        if not path.exists():
            write_page(robot, path, **options)
        page.complaints.clear()
        page.requests.clear()
        page.open(path.as_uri())
        assert page.wait(READY) is True, page.run("document.getElementById('failure').textContent")
        page.run("new Promise(requestAnimationFrame)")
        assert page.complaints == []
        assert page.requests == [path.as_uri()]
        return page

    return show
