"""Articles on sections of the book: text, moving pictures and exercises, in a page without a robot."""

from __future__ import annotations

import html
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from ..core import arguments
from ..core.answers.page import digest
from ..core.colours import page_colours
from ..core.files import replacing
from ..core.glossary import complete
from ..core.numbers import number
from .colours import quantity_colours
from .page_scripts import POLICY, joined_script
from .section_pages import SECTIONS, formula_html

__all__ = ["ARTICLES", "article_text", "write_article"]

_FOLDER = resources.files(__package__) / "articles"
_FILES = [Path(entry.name) for entry in _FOLDER.iterdir()]
ARTICLES = tuple(sorted(file.stem for file in _FILES if file.suffix == ".toml"))
"""Sections of the book with an article."""
_SHARED_SCRIPTS = ("decimals.js", "matrices.js", "orbit.js")
"""Scripts that other pages also use."""
_ARTICLE_SCRIPTS = (
    "rigid_body.js", "near_misses.js", "trails.js", "two_cameras.js", "picture.js", "inline_slider.js", "words.js",
    "predict.js", "handle.js",
)  # fmt: skip
"""Scripts that all articles use."""
_MARKUP = re.compile(r"\{(\w+):((?:[^{}]|\{[^{}]*\})*)\}|\*\*(.+?)\*\*")
"""Marks in a text: ``**text**``, and ``{kind:text}``, whose text may contain one more level of braces."""
_SLIDER_BEFORE_STOP = re.compile(r'(<span class="slider[^>]*>[^<]*</span>)([.,;:?]+)')
"""Slider and the punctuation after it."""
_VIEW_HTML = (
    '<div class="view"><b>{caption}</b><canvas data-view="{view}" tabindex="0" role="img" aria-label="{label}"></canvas>'
    '<p class="hint" hidden>Ctrl + scroll to zoom</p></div>'
)
_TURN_HINT = "Drag sideways or use the arrow keys to turn the view."


def write_article(section: str, path: str | Path) -> Path:
    """Write the article on a section of Modern Robotics, as a self-contained page.

    Parameters
    ----------
    section : str, section of Modern Robotics with an article, such as "8.2"

    Raises
    ------
    ValueRangeError
        The section has no article, or the file cannot be written.

    Examples
    --------
    >>> import tempfile, twistwrench as tw
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = tw.viz.write_article("8.2", f"{folder}/article.html")
    ...     "The arrow that stands still" in page.read_text("utf-8")
    True
    """
    text = article_text(section)
    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")
    return Path(path)


def article_text(section: str, *, neighbours: Mapping[str, str] | None = None, instrument: str | None = None) -> str:
    """Return the page of an article as HTML text.

    Parameters
    ----------
    neighbours : {label: address}, optional, links to other pages of a site, above the heading
    instrument : str, optional, address of the section's page with a robot
    """
    section = arguments.choice(section, "section with an article", ARTICLES)
    article = article_of(section)
    player = resources.files(__package__) / "player"
    article_scripts = [*_ARTICLE_SCRIPTS, *article["scripts"], "article.js"]
    article_paths = [f"article/{name}" for name in article_scripts]
    script = joined_script([*_SHARED_SCRIPTS, *article_paths])
    page_data = {"section": section, "pictures": article["picture"]}
    data = json.dumps(page_data, ensure_ascii=False, separators=(",", ":"))
    page = Template((player / "article/article.html").read_text("utf-8"))
    style = (player / "article/article.css").read_text("utf-8")
    body_lines = _body(section, article, neighbours or {}, instrument)
    return page.substitute(
        title=html.escape(f"{section} {article['title']}"),
        policy=f"{POLICY} {digest(script)}",
        style=page_colours() + quantity_colours() + style,
        body="\n".join(body_lines),
        data=data.replace("</", "<\\/"),  # a closing tag would end the script element
        script=script,
    )


@cache
def article_of(section: str) -> dict[str, Any]:
    """Article from its file; each picture has its list of sliders, which may be empty, under "sliders"."""
    article = tomllib.loads((_FOLDER / f"{section}.toml").read_text("utf-8"))
    for picture in article["picture"]:
        picture["sliders"] = picture.pop("slider", [])
    return article


def _body(
    section: str, article: Mapping[str, Any], neighbours: Mapping[str, str], instrument: str | None
) -> Iterator[str]:
    """HTML lines of the article: heading, pictures, questions, and how to go on."""
    no_sliders: dict[str, Any] = {}  # only texts of pictures have sliders
    if neighbours:
        links = [f'<a href="{html.escape(address)}">{html.escape(label)}</a>' for label, address in neighbours.items()]
        yield f"<nav>{''.join(links)}</nav>"
    section_title = article.get("section_title") or SECTIONS[section].title  # the book's title by default
    yield f"<h1><small>{section} {html.escape(section_title)}</small>{html.escape(article['title'])}</h1>"
    yield f'<p class="question">{html.escape(article["question"])}</p>'
    yield from _paragraphs(article["lead"], no_sliders)
    yield "<noscript><p><b>The pictures are drawn by this page's own script, which is switched off.</b></p></noscript>"
    for picture_number, picture in enumerate(article["picture"], 1):
        yield from _picture_section(picture_number, picture)
    yield "<h2>Without looking back</h2>"
    for question in article["question_at_end"]:
        question_html = _text_html(question["ask"], no_sliders)
        answer = "".join(_paragraphs(question["answer"], no_sliders))
        yield f"<details><summary>{question_html}</summary>{answer}</details>"
    yield "<h2>Go on</h2>"
    python_html = _code_html(article["python"].strip())
    yield f"<p>The first picture, in Python:</p>{python_html}"
    link = f', as in <a href="{html.escape(instrument)}">this page</a>' if instrument else ""
    section_of_command = article.get("instrument", section)
    command = f"twistwrench view my_arm.urdf --section {section_of_command} --html page.html"
    yield f"<p>The same with your own arm{link}:</p>{_code_html(command)}"


def _code_html(text: str) -> str:
    """Block with code to copy; it can have the focus, so that the keyboard can scroll wide lines."""
    return f'<pre tabindex="0" role="region" aria-label="Code">{html.escape(text)}</pre>'


def _picture_section(picture_number: int, picture: Mapping[str, Any]) -> Iterator[str]:
    """HTML lines of a picture's section: text with its sliders, canvases, controls, exercise."""
    name = picture["name"]
    views = picture["views"]  # name and caption of each
    sliders = {slider["name"]: slider for slider in picture["sliders"]}
    prediction = picture.get("predict")
    exercise = picture.get("exercise")
    yield f'<section id="{name}"><h2>{picture_number}. {html.escape(picture["title"])}</h2>'
    yield from _paragraphs(picture["text"], sliders)
    figure_class = " class=two" if len(views) > 1 else ""
    yield f'<figure data-picture="{name}"{figure_class}><div class="views">'
    guess_hint = ""
    if prediction is not None and prediction["kind"] == "arrow":
        guess_hint = " Shift and arrow keys move the guess."
    for view, caption in views:
        label = html.escape(f"{picture['title']}, {caption}. {_TURN_HINT}{guess_hint}")
        yield _VIEW_HTML.format(view=view, label=label, caption=html.escape(caption))
    yield '</div><figcaption><button class="play">Play</button><button class="again">Again</button>'
    yield '<button class="skip" hidden>Show me</button>'
    if prediction is not None:
        yield f'<p class="prompt" role="status" hidden><span>{html.escape(prediction["ask"])}</span></p>'
        kind = prediction["kind"]  # an arrow is guessed in the picture itself
        if kind == "number":
            yield _number_guess(name, prediction)
        elif kind != "arrow":
            yield _answer_choice(name, prediction)
    yield '<div class="numbers"></div></figcaption></figure>'
    yield '<div class="after">'
    yield from _paragraphs(picture["after"], sliders)
    yield "</div>"
    if exercise is not None:
        yield f'<form><p id="exercise-{name}">{_text_html(exercise["question"], sliders)}</p><div>'
        yield f'<input type="text" inputmode="decimal" autocomplete="off" aria-labelledby="exercise-{name}"> {exercise["unit"]}'
        yield "<button>Check</button><output></output></div></form>"
    yield "</section>"


def _number_guess(name: str, prediction: Mapping[str, Any]) -> str:
    """Slider with which the reader guesses a number; ``name`` is that of the picture."""
    minimum, maximum = prediction["least"], prediction["most"]
    label = f'<label for="guess-{name}">{html.escape(prediction["label"])}</label>'
    attributes = f'min="{minimum}" max="{maximum}" step="{prediction["step"]}" value="{minimum}"'
    field = f'<input id="guess-{name}" type="range" {attributes}>'
    ends = f"<small>{number(minimum)}</small><small>{number(maximum)}</small>"
    ends = ends.replace("-", "−")  # a typographic minus
    return f'<div class="guess">{label}<span class="range">{field}{ends}</span><output></output></div>'


def _answer_choice(name: str, prediction: Mapping[str, Any]) -> str:
    """Radio buttons with which the reader guesses one of several answers; ``name`` is that of the picture."""
    buttons = ""
    for k, answer in enumerate(prediction["choices"], 1):
        buttons += f'<label><input type="radio" name="guess-{name}" value="{k}">{html.escape(answer)}</label>'
    label = html.escape(prediction["label"])
    return f'<div class="guess choice" role="radiogroup" aria-label="{label}">{buttons}</div>'


def _paragraphs(text: str, sliders: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """HTML paragraphs of a text; a displayed formula is a block instead of a paragraph."""
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        one_line = " ".join(paragraph.split())
        content = _text_html(one_line, sliders)
        is_display = content.startswith('<div class="display')
        yield content if is_display else f"<p>{content}</p>"


def _text_html(text: str, sliders: Mapping[str, Mapping[str, Any]]) -> str:
    """Text as HTML: coloured words, sliders with their initial value, formulas, emphasis."""

    def mark_html(mark: re.Match[str]) -> str:
        """HTML of a match of :data:`_MARKUP`."""
        kind, inner, emphasised = mark.groups()
        if emphasised is not None:
            return f"<strong>{emphasised}</strong>"
        if kind == "slider":
            slider = sliders[inner]
            value = f"{slider['value']} {slider['unit']}"
            return f'<span class="slider {slider["colour"]}" data-slider="{inner}">{value}</span>'
        if kind == "formula":
            return f'<span class="formula">{formula_html(inner)}</span>'
        if kind == "display":
            return f'<div class="display formula">{formula_html(inner)}</div>'
        return f'<span class="word {kind}" data-arrow="{kind}">{inner}</span>'

    text_html = _MARKUP.sub(mark_html, html.escape(text, quote=False))
    # A line does not break between a slider and the full stop after it.
    return _SLIDER_BEFORE_STOP.sub(r'<span class="whole">\1\2</span>', text_html)


complete(globals())
