"""HTML page of a report in one file: the blocks printed by the terminal, with pictures, provenance and a glossary.

The page has no scripts and no requests, and styles for paper, phones and dark screens.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import platform
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..colours import COLOURS, Style, page_colours
from ..files import replacing
from ..text import visible
from ..version import __version__
from .blocks import Aligned, Bar, Block, Branch, Cell, Column, Glyphs, Headline, Level, Line, More, Piece, Remark, Table
from .data import plain, table_data

if TYPE_CHECKING:
    from .answer import Answer

POLICY = "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src 'unsafe-inline'"
"""Content-Security-Policy without requests and scripts. For a page with a viewer, digests of allowed scripts are appended."""
LARGEST_VIEWER = 4_000_000
"""Largest number of characters of a viewer in a page. A larger one is left out: meshes may take tens of megabytes."""
TERMS = {
    "OK": "Nothing in the input or the results speaks against the answer.",
    "DONE": "The work is done, and nothing was judged.",
    "UNSURE": "The data do not decide. This is not a yes.",
    "OVER LIMIT": "A limit is exceeded for certain.",
    "COLLISION": "Two links of the robot are in contact, by the exact distance of their shapes.",
    "LOOK AGAIN": "The input contradicts itself, so no number below can be trusted.",
    "CONTACT": "A sensor reads more than its load explains.",
    "STOPPED": "The computation ended before its duration.",
    "peak": "The value of largest magnitude over the motion, with its sign.",
    "rms": "Root mean square over the motion: the steady value that heats a motor as much.",
    "share": "Magnitude divided by the limit; 100 % is the limit itself.",
    "inertia": "Torque that accelerates the masses, M(q) ddq.",
    "Coriolis": "Torque from velocities: Coriolis and centrifugal terms.",
    "gravity": "Torque that holds the weight at rest.",
    "payload": "A body attached to a frame of a loaded robot; the commands take a point mass.",
    "friction": "Torque lost in a joint: viscous and Coulomb parts of its file.",
    "ext. wrench": "Torque that balances moments and forces exerted on the robot.",
    "σ": "Standard deviation.",
    "γ": "Weight of the file's inertias against the log, when physically consistent bodies are fitted.",
    "condition": "Ratio of the best to the worst determined direction of the parameters.",
    "coverage": "Share of intervals that contain the true value.",
    "held out": "Rows that the fit did not use, and that are only predicted.",
    "deviation": "Standard deviation of an estimate.",
    "drift": "Gain of energy that work does not explain: the error of the simulation.",
    "bias": "Reading of a sensor without any load.",
    "limit curve": "Largest speed along a path at which some acceleration keeps all torque limits.",
}
"""Explanations of terms that a page may use, with the words of docs/glossary.md."""


Setting: TypeAlias = tuple[str, str] | Table
"""Entry of the provenance: name and text, or a table."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture of a report: SVG as text, or PNG as bytes."""

    title: str
    """Caption below a PNG, and alternative text of both kinds."""
    content: str | bytes
    """SVG element, or PNG file."""


@dataclass(frozen=True)
class Viewer:
    """Page with the robot that can be moved, inside the page of an answer."""

    page: str
    """HTML of the page."""
    digests: tuple[str, ...]
    """Digests of its scripts. A frame may run only scripts that the page around it allows."""


def digest(script: str) -> str:
    """Digest of a script for a Content-Security-Policy.

    Parameters
    ----------
    script : str

    Returns
    -------
    digest : str
    """
    sha256 = hashlib.sha256(script.encode()).digest()
    return f"'sha256-{base64.b64encode(sha256).decode('ascii')}'"


@dataclass(frozen=True)
class MarkedJoint:
    """Joint that a picture marks, with label and colour."""

    joint: str
    label: str
    style: Style = Style.POINTED

    @property
    def caption(self) -> str:
        """Colour and label, for the title of the picture."""
        return f"{COLOURS[self.style].name}: {self.label}"


@dataclass(frozen=True, eq=False)
class ReportPage:
    """Content of a page. The blocks up to the first empty line or table are the verdict.

    Examples
    --------
    >>> page = ReportPage("torques", "ur5", [Line(("OK", "strong good"), ": all limits kept."), "", "A line."])
    >>> text = page.html()
    >>> text[:15], "<h1>" in text
    ('<!doctype html>', True)
    """

    command: str
    """Name of the command."""
    subject: str
    """Robot and motion or pose."""
    blocks: Sequence[Block]
    """Printed blocks."""
    details: Sequence[Block] = ()
    """Blocks that are not printed."""
    facts: Sequence[tuple[str, str]] = ()
    """Names and values of the decisive numbers of the verdict."""
    pictures: Sequence[Picture] = ()
    notes: Sequence[str] = ()
    """Sentences printed on standard error."""
    provenance: Sequence[tuple[str, str]] = ()
    """Names and values of files, settings and versions."""
    tables: Sequence[Table] = ()
    """Tables of the provenance."""
    shorten: Callable[[str], str] = field(default=str)
    """Function that removes folders from the paths in a text; it is applied to every text of the page."""
    viewer: Viewer | None = None
    """Page with a robot that can be moved, which can replace the picture."""

    def html(self) -> str:
        """Page as text.

        Returns
        -------
        text : str
        """
        body = "\n".join(self._without_folders(part) for part in self._parts())
        used_terms = _terms_in(body)
        if used_terms:
            body += f"\n<h2>Terms</h2>{_list(used_terms)}"
        policy = POLICY
        scripts = ""
        if self.viewer is not None:
            viewer_parts = _ENCODED.split(self.viewer.page)  # text and base64 in turn
            viewer_page = "".join(map(self._without_folders_in_text, viewer_parts))
            content = json.dumps(viewer_page, ensure_ascii=False).replace("<", "\\u003c")  # no "</script>"
            data_script = f'<script type="application/json" id="viewer">{content}</script>'
            scripts = f"{data_script}\n<script>{_START_VIEWER}</script>"
            allowed_scripts = " ".join((digest(_START_VIEWER), *self.viewer.digests))
            policy = f"{POLICY}; frame-src 'self'; script-src {allowed_scripts}"
        style_sheet = resources.files(__package__) / "page.css"
        style = page_colours() + style_sheet.read_text("utf-8")
        data = self.shorten(self._data())
        return _TEMPLATE.format(
            policy=html.escape(policy),
            scripts=scripts,
            title=_escape(f"{self.command}: {self.subject}"),
            style=style,
            kind=_escape(f"twistwrench {self.command} · {self.subject}"),
            body=body,
            data=data.replace("<", "\\u003c"),
        )

    def _parts(self) -> list[str]:
        """Parts of the page in HTML: verdict, pictures, results, details, doubts and provenance."""
        verdict_blocks, result_blocks = self._verdict_and_results()
        raster_pictures = [picture for picture in self.pictures if isinstance(picture.content, bytes)]
        vector_pictures = [picture for picture in self.pictures if isinstance(picture.content, str)]
        parts = [_verdict(verdict_blocks, self.facts), *map(_picture, raster_pictures)]
        if self.viewer is not None:
            parts.append(_MOVE_BUTTON)
        parts += map(_picture, vector_pictures)
        parts += ["<h2>Results</h2>", *map(block_html, result_blocks)]
        if self.details:
            parts += ["<h2>Details</h2>", *map(block_html, self.details)]
        notes = [block.words for block in self.blocks if isinstance(block, Remark)]
        notes += self.notes
        if notes:
            items = "".join(f"<li>{_escape(note)}</li>" for note in notes)
            parts.append(f"<h2>Doubts and notes</h2><ul>{items}</ul>")
        tables = "".join(map(table_html, self.tables))
        parts.append(f"<h2>Provenance</h2>{_list(self.provenance)}{tables}")
        return parts

    def _verdict_and_results(self) -> tuple[list[Block], list[Block]]:
        """Blocks of the verdict, up to the first table or blank line, and the other blocks; both without remarks."""
        verdict_length = len(self.blocks)
        for k, block in enumerate(self.blocks):
            if block == "" or isinstance(block, Table):
                verdict_length = k
                break
        verdict_blocks = list(self.blocks[:verdict_length]) or [f"{self.command}: {self.subject}"]
        other_blocks = self.blocks[verdict_length:]
        verdict: list[Block] = [block for block in verdict_blocks if not isinstance(block, Remark)]
        results: list[Block] = [block for block in other_blocks if block != "" and not isinstance(block, More | Remark)]
        return verdict, results

    def write(self, path: Path) -> Path:
        """Write the page, replacing an existing one.

        Parameters
        ----------
        path : Path

        Returns
        -------
        path : Path
        """
        with replacing(path) as scratch:
            scratch.write_text(self.html(), encoding="utf-8")
        return path

    def _without_folders(self, part: str) -> str:
        """A part of the page without folders in paths; unchanged if it has an image, whose base64 may look like a path."""
        if "base64," in part:
            return part
        return self.shorten(part)

    def _without_folders_in_text(self, part: str) -> str:
        """A part of the viewer without folders in paths; unchanged if it is base64."""
        if _ENCODED.fullmatch(part):
            return part
        return self.shorten(part)

    def _data(self) -> str:
        """Verdict, facts and tables as JSON."""
        verdict: list[str] = []
        if self.blocks and isinstance(self.blocks[0], str | Headline | Line):
            verdict = plain(self.blocks[0]).split("\n")
        blocks = (*self.blocks, *self.details, *self.tables)
        data: dict[str, Any] = {
            "command": self.command,
            "subject": self.subject,
            "verdict": verdict,
            "facts": dict(self.facts),
            "provenance": dict(self.provenance),
            "tables": [table_data(block) for block in blocks if isinstance(block, Table)],
        }
        return json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


_ENCODED = re.compile("([A-Za-z0-9+/=]{200,})")
"""Numbers and images of the viewer as base64. Characters in them may equal a short path by chance."""
_MOVE_BUTTON = '<p class="move" hidden><button type="button" id="move">Move it</button></p>'
"""Button that starts the viewer; without scripts it stays hidden, and the picture remains."""
_START_VIEWER = """
const button = document.getElementById("move");
button.parentElement.hidden = false;
button.onclick = () => {
  const frame = document.createElement("iframe");
  frame.sandbox = "allow-scripts";
  frame.title = "The robot, which can be dragged";
  frame.className = "viewer";
  frame.srcdoc = JSON.parse(document.getElementById("viewer").textContent);
  const picture = document.querySelector("figure.robot");
  if (picture) picture.replaceWith(frame); else button.parentElement.before(frame);
  button.parentElement.remove();
};
"""


def answer_page(
    answer: Answer,
    *,
    command: Sequence[str] = (),
    notes: Sequence[str] = (),
    files: Mapping[str, str | Path | None] = MappingProxyType({}),
    full_paths: bool = False,
) -> ReportPage:
    """Page of an answer.

    ``command`` (words of the command line), ``notes`` and ``files`` belong to the answer of a command. Folders are removed from
    paths unless ``full_paths`` is True.
    """
    blocks: list[Block] = []
    details: list[Block] = []
    for block in answer.blocks():
        if isinstance(block, str) or block.level < Level.PAGE:
            blocks.append(block)
        elif block.level is Level.PAGE:
            details.append(block)
    tables: list[Table] = []
    settings: list[tuple[str, str]] = []
    for entry in answer.origin():
        if isinstance(entry, Table):
            tables.append(entry)
        else:
            settings.append(entry)
    sources = {name: str(path) for name, path in answer.sources().items()}
    known_paths = set(sources.values())
    sources |= {name: str(path) for name, path in files.items() if path is not None and str(path) not in known_paths}
    command_line: list[tuple[str, str]] = []
    if command:
        command_line = [("command", shlex.join(["twistwrench", *command]))]
    shorten: Callable[[str], str] = str
    if not full_paths:
        shorten = without_folders([*command, *sources.values()])
    return ReportPage(
        answer.call,
        answer.subject,
        blocks,
        details=details,
        facts=list(answer.facts().items()),
        pictures=list(answer.pictures()),
        notes=notes,
        provenance=[*command_line, *provenance(sources), *settings, *versions()],
        tables=tables,
        shorten=shorten,
        viewer=answer.viewer(),
    )


_SEPARATORS = ("+", ":=", "=")
"""Separators of paths within a word of the command line."""


def without_folders(texts: Iterable[str]) -> Callable[[str], str]:
    """Function of a text that replaces the paths, which occur in ``texts``, by their file names."""
    name_by_path: dict[str, str] = {}
    for text in texts:
        parts = [text]
        for separator in _SEPARATORS:
            parts = separator.join(parts).split(separator)  # each part is split further
        for part in parts:
            path = Path(part)
            names_folder = path.parent.is_dir() and path.name != part
            if path.name and names_folder:
                name_by_path[part] = path.name
                name_by_path[str(path.resolve())] = path.name
    longest_first = sorted(name_by_path, key=len, reverse=True)  # a path may begin with another one

    def shorten(text: str) -> str:
        """Text with file names in place of paths."""
        for path in longest_first:
            text = text.replace(path, name_by_path[path])
        return text

    return shorten


def provenance(files: Mapping[str, str | Path | None]) -> Iterator[tuple[str, str]]:
    """Name, size and digest of each file."""
    for name, path in files.items():
        if path is not None and Path(path).is_file():
            content = Path(path).read_bytes()
            digest = hashlib.sha256(content).hexdigest()
            argument, _, _ = name.partition(" ")
            yield argument, f"{path}, {len(content):,} bytes, SHA-256 {digest}"


def versions() -> Iterator[tuple[str, str]]:
    """Versions of the programs, and the date."""
    yield "versions", f"twistwrench {__version__}, Python {platform.python_version()}, NumPy {np.__version__}"
    now = datetime.now().astimezone()
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    if epoch.isdigit():  # for reproducible files
        now = datetime.fromtimestamp(int(epoch), UTC)
    yield "date", now.isoformat(sep=" ", timespec="seconds")


_TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="icon" href="data:,">
<style>
{style}</style>
</head>
<body>
<main>
<p class="kind">{kind}</p>
{body}
</main>
<script type="application/json" id="data">{data}</script>
{scripts}
</body>
</html>
"""


def _escape(text: str) -> str:
    """Text for HTML, with control characters as escapes."""
    return html.escape(visible(text))


def _line(line: Block | Cell) -> str:
    """HTML of a line or cell. Of a bar the label is shown, and of glyphs nothing."""
    if isinstance(line, Glyphs):
        return ""
    if isinstance(line, Bar):
        return _pieces(line.label)
    if isinstance(line, Headline | Line | Remark):
        return _pieces(line.pieces)
    return _escape(str(line))


def _pieces(pieces: Iterable[Piece]) -> str:
    """HTML of pieces of text; a style becomes the class of a span."""
    spans = []
    for piece in pieces:
        if isinstance(piece, str):
            spans.append(_escape(piece))
            continue
        text, style = piece
        escaped = _escape(text)
        if style:
            escaped = f'<span class="{style}">{escaped}</span>'
        spans.append(escaped)
    return "".join(spans)


def paragraphs(line: Block) -> list[str]:
    """HTML of each line of a block of text; a span over several lines is closed and opened again."""
    open_tag = ""  # of a span that goes on in the next line
    lines: list[str] = []
    for text_line in _line(line).split("\n"):
        html_line = f"{open_tag}{text_line}"
        tags = re.findall(r'<span class="[^"]*">|</span>', html_line)
        open_tag = ""
        if tags and tags[-1] != "</span>":
            open_tag = tags[-1]
            html_line += "</span>"
        lines.append(html_line)
    return lines


def _verdict(blocks: Sequence[Block], facts: Sequence[tuple[str, str]]) -> str:
    """HTML of the verdict and of its decisive numbers."""
    lines: list[str] = []
    for block in blocks:
        if isinstance(block, str | Headline | Line):
            lines += paragraphs(block)
    heading, *other_lines = lines or [""]
    paragraphs_below = "".join(f"<p>{line}</p>" for line in other_lines)
    verdict = f'<div class="verdict"><h1>{heading}</h1>{paragraphs_below}</div>'
    numbers = "".join(f"<div><dt>{_escape(name)}</dt><dd>{_escape(value)}</dd></div>" for name, value in facts)
    if numbers:
        return f'{verdict}<dl class="facts">{numbers}</dl>'
    return verdict


def _picture(picture: Picture) -> str:
    """HTML of a picture with its title."""
    title = _escape(picture.title)
    if isinstance(picture.content, bytes):
        data = base64.b64encode(picture.content).decode("ascii")
        image = f'<img alt="{title}" src="data:image/png;base64,{data}">'
        return f'<figure class="robot">{image}<figcaption>{title}</figcaption></figure>'
    return f'<figure><div class="scroll" tabindex="0" role="img" aria-label="{title}">{picture.content}</div></figure>'


def block_html(block: Block) -> str:
    """HTML of a block below the headline."""
    if isinstance(block, Table):
        return table_html(block)
    if isinstance(block, Branch):
        branches = "".join(map(block_html, block.branches))
        return f"<ul><li>{_line(block.label)}{branches}</li></ul>"
    if isinstance(block, Aligned):
        caption = f"<h3>{_escape(block.title)}</h3>" if block.title else ""
        lines = [f"{name} {text}" for name, text in block.rows]
        return caption + "".join(f"<p>{_escape(line)}</p>" for line in lines)
    start_tag = "<p>"
    if isinstance(block, Line) and block.indent:
        start_tag = '<p class="below">'
    return "".join(f"{start_tag}{text}</p>" for text in paragraphs(block) if text)


def table_html(table: Table) -> str:
    """HTML of a table with its title as caption. Empty columns are left out; a column is narrow if it has a narrow form."""
    heads = ""
    cells_by_column: list[list[str]] = []
    for column in table.columns:
        shown_column = column.narrow or column
        cells = [_line(shown_column.show(value)) for value in shown_column.values]
        if not any(cells):
            continue
        attribute = _class_attribute(shown_column)
        heads += f'<th scope="col"{attribute}>{_escape(shown_column.head)}</th>'
        cells_by_column.append([f"<td{attribute}>{cell}</td>" for cell in cells])
    rows = []
    for k, style in enumerate(table.styles):
        row_class = f' class="{style}"' if style else ""
        row_cells = "".join(cells[k] for cells in cells_by_column)
        rows.append(f"<tr{row_class}>{row_cells}</tr>")
    title = _escape(table.heading)
    caption = f"<caption>{title}</caption>" if title else ""
    return (
        f'<figure class="table"><div class="scroll" tabindex="0" role="group" aria-label="{title or "Table"}"><table>{caption}'
        f"<thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div></figure>"
    )


def _class_attribute(column: Column) -> str:
    """HTML attribute of the cells of a column, which depends on the kind of its text."""
    if not column.words:
        return ' class="number"'
    if column.whole:
        return ' class="word whole"'
    return ' class="word"'


def _list(pairs: Iterable[tuple[str, str]]) -> str:
    """HTML of a list of names and texts."""
    entries = "".join(f"<dt>{_escape(name)}</dt><dd>{_escape(text)}</dd>" for name, text in pairs)
    return f"<dl>{entries}</dl>"


_NAMING_ELEMENTS = re.compile(r'<(h1|th|dt|caption|figcaption|td(?= class="word))\b.*?</\1>', re.DOTALL)
"""Elements that name a quantity. In other elements, an everyday word such as gravity does not count as a term."""


def _terms_in(page: str) -> list[tuple[str, str]]:
    """Terms that occur on a page, with their explanations; everyday words count only in elements that name a quantity."""
    without_tags = re.sub(r"<svg.*?</svg>|<[^>]+>", " ", page, flags=re.DOTALL)  # and without pictures
    page_text = html.unescape(without_tags)
    naming_elements = " ".join(match[0] for match in _NAMING_ELEMENTS.finditer(page))
    names_text = html.unescape(re.sub(r"<[^>]+>", " ", naming_elements))
    terms: list[tuple[str, str]] = []
    for term, explanation in TERMS.items():
        is_everyday_word = term.isalpha() and term.islower() and len(term) > 1
        searched_text = names_text if is_everyday_word else page_text
        if re.search(rf"(?<!\w){re.escape(term)}(?!\w)", searched_text):
            terms.append((term, explanation))
    return terms
