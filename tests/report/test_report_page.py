"""``--report``: one page for every command, with the words and numbers that were printed, and nothing from elsewhere."""

from __future__ import annotations

import functools
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from chromium import browser
from click.testing import CliRunner
from quick import mostly_slow

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.text import words_of_the_shell

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")

pytest.importorskip("matplotlib")
DEMO = Path(tw.__file__).parent / "robots" / "ur5_demo.csv"
VOID = {"meta", "link", "img", "br", "path", "use", "rect", "image"}
COMMANDS = {
    "torques": ["torques", "ur5", "--trajectory", "demo", "--payload", "10"],
    "move": ["move", "ur5", "--to", "0.9,-0.9,1.0,-0.4,1.2,1.0", "--payload", "5", "--fastest"],
    "simulate": ["simulate", "planar_2r", "--duration", "0.3"],
    "identify": ["identify", "planar_2r", "demo", "--all"],
    "payload": ["payload", "ur5", "--at", "shoulder_lift_joint=-0.6"],
    "sensor identify": ["sensor", "identify", "demo"],
    "sensor compensate": ["sensor", "compensate", "demo-motion", "--sensor", "demo", "--contacts", "1e-6"],
    "sensor poses": ["sensor", "poses", "demo", "--count", "3"],
    "doctor": ["doctor", "quadruped"],
    "size": ["size", "ur5", "demo", "--catalog", "demo", "--pause", "0.8", "--masses-included"],
}
"""A call of each command that has the option."""


class Reader(HTMLParser):
    """Texts by the element they stand in; complains of elements that are not closed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.links: list[str] = []
        self.feed(page)
        assert not self.open, self.open

    def handle_starttag(self, tag, attributes):
        self.links += [value for name, value in attributes if name in ("src", "href", "xlink:href") and value]
        if tag not in VOID:
            self.open.append(tag)
            self.texts.setdefault(tag, []).append("")

    def handle_startendtag(self, tag, attributes):
        self.links += [value for name, value in attributes if name in ("src", "href", "xlink:href") and value]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        for tag in set(self.open):
            self.texts[tag][-1] += data


def spaced(text: str) -> str:
    return " ".join(text.split())


def run(*arguments: object, code: int | None = None) -> str:
    result = CliRunner().invoke(main, list(map(str, arguments)), env={"COLUMNS": "200", "SOURCE_DATE_EPOCH": "86400"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in ((0, 1) if code is None else (code,)), result.output
    return result.output


def small_log(path: Path) -> Path:
    """A motion of the bundled arm of two joints, which has no meshes and a page of two panels."""
    t = np.linspace(0.0, 1.0, 101)
    table = np.column_stack([t, 0.5 * np.sin(3.0 * t), np.cos(2.0 * t)])
    np.savetxt(path, table, "%.9g", ",", header="time,joint1,joint2", comments="")
    return path


@pytest.fixture(scope="module")
def page_of(tmp_path_factory):
    """What a command prints, and the file of its page, by the name of the command."""

    @functools.cache
    def page_of(name: str) -> tuple[str, Path]:
        path = tmp_path_factory.mktemp("report") / "report.html"
        return run(*COMMANDS[name], "--report", path), path

    return page_of


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.slow) if name in ("identify", "size") else name for name in COMMANDS],
)
def report(request, page_of):
    """Name of a command, its output, and its page."""
    output, path = page_of(request.param)
    return request.param, output, path.read_text("utf-8")


def test_the_page_begins_with_the_verdict_word_for_word(report):
    _, output, page = report
    (first,) = Reader(page).texts["h1"]
    assert spaced(first)
    assert spaced(output).startswith(spaced(first))


def test_cells_of_the_page_are_those_printed(report):
    name, output, page = report
    numbers = re.split("<h2>(?:Details|Provenance)</h2>", page)[0]
    cells = [spaced(cell) for cell in Reader(f"<p>{numbers.partition('<h2>Results</h2>')[2]}</p>").texts.get("td", [])]
    assert (len(cells) > 10) == (name != "doctor")
    for cell in cells:
        assert all(word in output for word in cell.split()), cell


def test_data_of_the_page_round_to_the_numbers_shown(report):
    name, output, page = report
    data = json.loads(re.findall(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[0])
    assert data["command"] == name
    assert spaced(output).startswith(spaced("".join(data["verdict"][:1])))
    values = [x for table in data["tables"] for row in table["rows"] for x in row]
    assert name == "doctor" or any(isinstance(x, float) for x in values)
    for table in data["tables"]:
        assert {len(row) for row in table["rows"]} == {len(table["columns"])}


def test_the_page_needs_no_network_no_script_and_little_room(report):
    name, _, page = report
    assert len(page.encode()) <= 1_000_000
    assert all(link.startswith(("#", "data:")) for link in Reader(page).links)
    assert "default-src &#x27;none&#x27;" in page
    outside = re.sub(r'<script type="application/json" id="viewer">.*?</script>', "", page, flags=re.DOTALL)
    assert len(re.findall(r"<script(?! type=\"application/json\")", outside)) <= 1  # the button of the viewer
    assert not re.findall(r"@import|url\((?!#)|\son\w+=", outside)
    assert name in ("doctor", "sensor poses") or page.count("<svg") >= 1
    assert name.startswith("sensor") or page.count("<img ") == 1


def test_pictures_have_their_texts_as_text(report):
    _, _, page = report
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        assert "<text" in svg
        assert "metadata" not in svg
    used, known = set(re.findall(r"url\(#([\w-]+)\)", page)), set(re.findall(r' id="([\w-]+)"', page))
    assert used <= known


def test_provenance_and_terms_stand_on_the_page(report):
    name, _, page = report
    terms = {spaced(text) for text in Reader(page).texts["dt"]}
    assert {"command", "versions", "date"} <= terms
    assert f"twistwrench {COMMANDS[name][0]}" in page
    assert "1970-01-02 00:00:00+00:00" in page
    body = re.sub(r"<h2>Terms</h2>.*", "", re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL), flags=re.DOTALL)
    for term in ("γ", "Coriolis", "bias"):
        assert (term in terms) <= (term in body)


def test_two_pages_of_one_date_are_equal_byte_for_byte(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log, pages = small_log(Path("log.csv")), []
    for _ in range(2):
        run("torques", "planar_2r", log, "--report", "a.html", code=1)
        pages.append(Path("a.html").read_bytes())
        Path("a.html").unlink()
    assert pages[0] == pages[1]


def test_the_page_of_torques_shows_the_robot_with_the_worst_joint(page_of):
    page = page_of("torques")[1].read_text("utf-8")
    (caption,) = Reader(page).texts["figcaption"]
    assert caption == "ur5 at t = 1.808 s; red: shoulder_lift_joint, 111 % of its limit"
    facts = page.partition('<dl class="facts">')[2].partition("</dl>")[0]
    assert [spaced(x) for x in Reader(facts).texts["dd"]] == ["-167.0 N m", "150 N m", "111 %", "1.808 s"]


def test_the_caption_names_the_marked_joint_and_its_colour(report):
    name, _, page = report
    captions = Reader(page).texts.get("figcaption", [])
    marked = {"torques": "red: shoulder_lift_joint, 111 %", "size": "amber: shoulder_pan_joint, average torque 83 %"}
    assert (name not in marked) or f"{marked[name]} of its limit" in captions[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "said"),
    [
        ((), "ur5 at t = 1.200 s; red: wrist_1_joint, position over its limit"),
        (("--stop-at-limits",), "ur5 at the end, t = 1.15117 s; amber: wrist_1_joint, at its limit"),
    ],
)
def test_the_picture_of_a_simulation_shows_the_joint_that_passes_its_limit(tmp_path, more, said):
    run("simulate", "ur5", "--duration", "1.2", *more, "--report", tmp_path / "r.html")
    assert Reader((tmp_path / "r.html").read_text("utf-8")).texts["figcaption"] == [said]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["move", "size", "doctor"])
def test_the_report_holds_the_robot_that_can_be_moved(page_of, name):
    page = page_of(name)[1].read_text("utf-8")
    shown = json.loads(re.search(r'<script type="application/json" id="viewer">(.*?)</script>', page, re.DOTALL)[1])
    assert '<canvas id="stage"' in shown


@pytest.mark.parametrize("whole", [False, True])
def test_folders_are_left_out_unless_they_are_asked_for(tmp_path, whole):
    folder = tmp_path / "customer name"
    folder.mkdir()
    page = folder / "r.html"
    log = small_log(folder / "log.csv")
    run("torques", "planar_2r", "--trajectory", log, "--report", page, *["--full-paths"] * whole)
    text = page.read_text("utf-8")
    assert "log.csv" in text
    assert ("customer name" in text) == whole


def test_working_files_are_named_with_size_and_digest(tmp_path):
    import hashlib

    log = small_log(tmp_path / "log.csv")
    run("torques", "planar_2r", "--trajectory", log, "--report", tmp_path / "r.html")
    said = f"log.csv, {log.stat().st_size:,} bytes, SHA-256 {hashlib.sha256(log.read_bytes()).hexdigest()}"
    assert said in (tmp_path / "r.html").read_text("utf-8")


def test_a_report_is_not_begun_if_it_cannot_be_written(tmp_path):
    for arguments, text in (
        (("--report", tmp_path / "none" / "r.html"), "no such folder"),
        (("--report", DEMO, "--trajectory", DEMO), "would overwrite"),
    ):
        assert text in spaced(run("torques", "ur5", "--trajectory", "demo", *arguments, code=2))
    assert not list(tmp_path.iterdir())


def test_many_motions_have_one_page(tmp_path):
    """A row for each, and size and digest of each file."""
    for name in ("first.csv", "second.csv"):
        shutil.copy(DEMO, tmp_path / name)
    page = tmp_path / "r.html"
    run("torques", "ur5", tmp_path / "*.csv", "--payload", "10", "--report", page, code=1)
    text = page.read_text("utf-8")
    assert "OVER LIMIT" in text
    for name in ("first.csv", "second.csv"):
        assert f'<td class="word">{name}</td>' in text
        assert re.search(rf"<dt>MOTION</dt><dd>{name}, [\d,]+ bytes, SHA-256", text)


IN_PYTHON = {
    "torques": lambda: tw.check("ur5", "demo", payload=10),
    "payload": lambda: tw.payload("ur5", {"shoulder_lift_joint": -0.6}),
    "move": lambda: tw.move("ur5", [0.9, -0.9, 1.0, -0.4, 1.2, 1.0], payload=5, fastest=True),
    "doctor": lambda: tw.doctor("quadruped"),
}
"""The same questions as those of the commands."""


@pytest.mark.parametrize("name", mostly_slow(IN_PYTHON, 2))
def test_the_page_of_the_command_is_that_of_the_answer(name, page_of, tmp_path, monkeypatch):
    """Except for the words of the command line, which only the shell has."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    with words_of_the_shell():  # sentences of the page that can be moved name options there, and arguments in Python
        python = IN_PYTHON[name]().to_html(tmp_path / "python.html").read_text("utf-8")
    pages = [page_of(name)[1].read_text("utf-8"), python]
    command = re.compile(r'<dt>command</dt><dd>.*?</dd>|"command":"twistwrench [^"]*",')
    shell, python = (_unnumbered(command.sub("", page)) for page in pages)
    assert shell == python


def _unnumbered(page):
    """Page without the numbers that matplotlib gives to parts of a drawing."""
    return re.sub(r"\b[mp][0-9a-f]{10}\b", "", page)


# ── In a browser

CONTRAST = """
(() => {
  const numbers = (colour) => (colour.match(/[\\d.]+/g) || [0, 0, 0, 0]).map(Number);
  const light = (colour) => numbers(colour).slice(0, 3).reduce((sum, x, k) => {
    x /= 255;
    return sum + [0.2126, 0.7152, 0.0722][k] * (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  }, 0);
  const paper = (element) => {
    for (; element; element = element.parentElement) {
      const colour = getComputedStyle(element).backgroundColor;
      if (numbers(colour)[3] !== 0 && colour !== "rgba(0, 0, 0, 0)") return colour;
    }
    return "rgb(255, 255, 255)";
  };
  const low = [], page = getComputedStyle(document.body).backgroundColor;
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!own || element.closest("script")) continue;
    const drawn = element.closest("svg"), style = getComputedStyle(element);
    if (drawn && style.fill === "rgb(255, 255, 255)") continue; // names on coloured bars
    const [a, b] = [light(drawn ? style.fill : style.color), light(drawn ? page : paper(element))].sort((x, y) => y - x);
    if ((a + 0.05) / (b + 0.05) < 4.5) low.push([element.textContent.trim(), (a + 0.05) / (b + 0.05)]);
  }
  return low;
})()
"""


@pytest.fixture(scope="module")
def page():
    from chromium import browser

    with browser() as opened:
        opened.offline()
        yield opened


@pytest.mark.parametrize("name", ["torques", pytest.param("identify", marks=pytest.mark.slow)])
def test_the_page_fits_a_phone_and_is_read_in_light_in_dark_and_on_paper(page, name, page_of):
    page.open(page_of(name)[1].as_uri())
    for width in (390, 1280):
        page.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=844, deviceScaleFactor=1, mobile=width < 500
        )
        assert page.run("document.documentElement.scrollWidth") == width
        for media, scheme in (("", "light"), ("", "dark"), ("print", "dark")):
            features = [{"name": "prefers-color-scheme", "value": scheme}]
            page.call("Emulation.setEmulatedMedia", media=media, features=features)
            assert page.run(CONTRAST) == [], (width, media, scheme)
            dark = page.run("getComputedStyle(document.body).backgroundColor") != "rgb(255, 255, 255)"
            assert dark == (scheme == "dark" and media != "print")
    assert page.run("document.querySelectorAll('[tabindex]:not([aria-label])').length") == 0
    assert not page.complaints
    assert not [request for request in page.requests if not request.startswith(("file:", "data:"))]


def test_the_robot_on_the_page_can_be_moved(page_of):
    """Without a request and without a complaint; the frame runs the viewer's scripts, and nothing else may run."""
    _, path = page_of("torques")
    assert path.stat().st_size < 650_000
    with browser() as page:
        page.offline()
        page.open(path.as_uri())
        assert page.run("document.querySelector('figure.robot img').complete")
        page.run("document.getElementById('move').click()")
        assert page.wait("document.querySelector('iframe.viewer') !== null")
        page.run("document.querySelector('iframe.viewer').scrollIntoView({ block: 'center' })")
        for _ in range(20):  # of half a second; a busy machine draws late
            page.run("new Promise(done => setTimeout(done, 500))")
            colours = len(np.unique(page.picture()[100:-100].reshape(-1, 3), axis=0))
            if colours > 500:
                break
        assert colours > 500  # an empty frame has a colour
        assert page.complaints == []
        assert [url for url in page.requests if not url.startswith(("file:", "data:", "about:"))] == []
        assert page.run("document.getElementById('move')") is None


def test_a_page_written_in_python_has_no_folders_of_its_writer(tmp_path):
    folder = tmp_path / "secret"
    folder.mkdir()
    shutil.copy(tw.robots.path_of("planar_2r"), folder)
    log = small_log(folder / "motion.csv")
    page = tw.check(folder / "planar_2r.urdf", log).to_html(tmp_path / "page.html").read_text("utf-8")
    assert "motion.csv" in page
    assert "secret" not in page
