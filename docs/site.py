"""What the site has beside the pages of this folder: home, changes, command line, API, pages to drag, and linked files.

Hooks of MkDocs. Pages link to files of the repository as they do on a forge; on the site these files are pages of their own, so
that nothing leads out of it.
"""

from __future__ import annotations

import inspect
import re
import runpy
from html import escape, unescape
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
_LINK = re.compile(r"\]\((\.\./|docs/|)([^)#:]+)(#[^)]*)?\)")
_SEARCHED = re.compile(r"^<!-- search: (.+) -->$", re.MULTILINE)
"""Words of a page that the search finds before the titles of others."""
_FENCE = re.compile(r"^```(\w+) [^\n]+$", re.MULTILINE)
"""What the tests read behind a block's language: no-run, exit=1, file=limits.csv."""
_LIVE = re.compile(r"^<!-- live: (\S+), (.+) -->$", re.MULTILINE)
"""A page that computes, within a page of the site: its name, and its title."""
_STILL = re.compile(r"<picture>.*?</picture>\n", re.DOTALL)
"""A picture for readers of a forge, which draws no live page."""
_ROLE = re.compile(r":(?:func|class|meth|data|attr|mod|exc):\s*<code>(?:([^<&]+) &lt;)?(~?)([\w.]+)(?:&gt;)?</code>")
_FORMULA = re.compile(r'<(?:span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</(?:span|div)>', re.DOTALL)
"""LaTeX as Arithmatex marks it: \\(inline\\) and \\[displayed\\]."""
_HIGHLIGHTED = re.compile(r'<div class="((?:language-console )?highlight)">(?=(.*?)</div>)', re.DOTALL)
"""A block of code, which may be commands and what they print."""
_COMMENT = re.compile(r"<!--.*?-->\n?", re.DOTALL)
_LANGUAGES = {".py": "python", ".toml": "toml", ".md": "markdown", ".cpp": "cpp", ".ipynb": "json"}
_SHIM = "https://unpkg.com/iframe-worker/shim"
_GROUPS: dict[str, tuple[str, str, str]] = {
    "Answers": (
        "",
        "check check_each payload move verify derive excite identify info check_log",
        "TorqueReport PayloadReport MoveReport Sizing SimulationResult DoctorReport RobotReport LogReport VerifyReport "
        "Derivation ExcitingMotion IdentifiedRobot KnownRobots Saved Written",
    ),
    "Load and build": (
        "attach chain lock with_actuators with_armature with_gravity with_payload close constrain info "
        "to_urdf to_mjcf to_sdf to_mujoco to_pinocchio coordinates random_configuration screws_at_com varying",
        "load find save from_dh from_screws from_mujoco from_pinocchio doctor",
        "SpatialInertia diagnosis convert",
    ),
    "Kinematics": (
        "forward_kinematics link_poses jacobian jacobian_rate frame_velocity frame_acceleration inverse_kinematics "
        "inverse_kinematics_branches lost_directions add subtract",
        "Ad ad",
        "Pose Twist Wrench se3 so3",
    ),
    "Dynamics": (
        "inverse_dynamics forward_dynamics mass_matrix bias_forces coriolis_forces coriolis_matrix christoffel gravity_forces "
        "friction_forces drive_torques motor_loads power_balance explain newton_euler regressor kinetic_energy "
        "potential_energy momentum center_of_mass com_jacobian task_inertia task_bias closed_form",
        "set_threads get_threads",
        "RigidBody pointwise",
    ),
    "Derivatives": (
        "inverse_dynamics_derivatives forward_dynamics_derivatives inverse_dynamics_gradient inverse_dynamics_hessian_product "
        "mass_matrix_derivative jacobian_derivative linearize",
        "differentiate",
        "",
    ),
    "Statics and payload": (
        "holding_torques wrench_torques joint_wrenches clearance",
        "size_drives",
        "statics sizing sensing calibration identification",
    ),
    "Motions and simulation": (
        "simulate simulate_batch rollout show",
        "",
        "Motion simulation control trajectories viz",
    ),
    "Export": (
        "export_c export_cuda export_st export_ros2 to_jax to_torch to_casadi to_javascript kernel program reference",
        "",
        "symbolic",
    ),
}
"""Methods of a robot, functions, and classes and modules with pages of their own, by subject."""


_MOVED = {
    "features": "questions.html#common-questions",
    "gallery": "index.html#examples",
    "noise": "unsure.html#noise-of-the-log",
}
"""Pages of earlier sites, and where their text is."""
_SENTENCES = {
    "index.md": "What twistwrench computes, how to install it, where to start, and how fast it is.",
    "questions.md": "Common questions with the pages that answer them, and questions from public forums with short answers.",
    "installation.md": "Installation on Linux, macOS, Windows and ARM, and what each extra adds.",
    "unsure.md": "Every reason for UNSURE or LOOK AGAIN with its cause and remedy, and how noise enters a verdict.",
    "identification.md": "Masses, inertias and friction of a robot from logs of its torques.",
    "calibration.md": "Zeros, axes and lengths of an arm from measured positions.",
    "viewer.md": "Robots and motions as one offline page that computes; films and pictures.",
    "actuation.md": "Motors, gears, rotors, friction and elastic joints from a YAML file.",
    "constraints.md": "Robots with closed loops: constrained dynamics, holding torques, simulation.",
    "ros.md": "Xacro files, package paths, bags, mimic joints and joint names in ROS.",
    "assistant.md": "What a coding assistant needs: imports, ten tasks with code, pitfalls.",
    "api.md": "Methods and functions by subject.",
    "plausibility.md": "What no robot does, and from which size a log is doubted.",
    "derivatives.md": "Derivatives of every quantity, of your own functions, and linear models.",
    "modern-robotics.md": "The book's Python package, function by function, on compiled kernels.",
    "compare.md": "Features of other libraries beside those of twistwrench, with versions and sources.",
    "how-it-works.md": "How a robot becomes compiled code, how results are tested, and what bounds their errors.",
    "adding.md": "Where a joint type, a quantity, a command or a file format is added to the source.",
    "changes.md": "Changes of each version.",
}
"""What llms.txt has for pages whose first sentence does not describe them."""
_AMERICAN = {
    **{f"{stem}is": f"{stem}iz" for stem in (
        "optim", "normal", "minim", "maxim", "random", "linear", "discret", "regular", "factor", "vector", "visual", "quant",
        "parametr", "initial", "general", "stabil",
    )},
    "centre": "center", "colour": "color", "behaviour": "behavior", "neighbour": "neighbor", "metre": "meter",
    "labelled": "labeled", "modelled": "modeled", "travelled": "traveled", "grey": "gray",
}  # fmt: skip
"""Beginnings of British words, and of their American forms; unit names may follow a prefix, as millimetre."""
_BRITISH = re.compile(rf"\b(?:milli|centi|kilo)?(?:{'|'.join(_AMERICAN)})[a-z]*", re.IGNORECASE)
_read: dict[str, str] = {}
"""Text of each page that is built, by its file."""


_BOOSTS = {"Tutorials": 2, "How-to": 2, "Reference": 2, "Project": 0.3, "API": 0.3}
"""Weight of a page in the search, by its group of the navigation: guides are found before docstrings."""


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that are made."""
    from mkdocs.structure.files import File

    def add(name: str, text: str) -> None:
        files.append(File.generated(config, name, content=text))

    examples = runpy.run_path(str(ROOT / "examples" / "__main__.py"))
    add("index.md", _STILL.sub("", _beside_docs("README.md")) + _strip(examples))
    add("changes.md", _beside_docs("CHANGELOG.md"))
    add("commands.md", _commands())
    for name, text in (_api() | _book() | _live()).items():
        add(name, text)
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    linked = {target for page in pages for target in _files_linked(page)} | {*examples["SCRIPTS"]}
    for target in sorted(linked):
        add(_page_of(target), _shown(target))
    return files


def _strip(examples: dict[str, Any]) -> str:
    """Pictures of the numbered examples; each leads to its script, which begins with an explanation."""
    entries = (
        f'<a href="{_page_of(script).removesuffix(".md")}.html">'
        f'<img src="gallery/{examples["picture_of"](script).name}" alt="" width="360" loading="lazy">'
        f"{escape(examples['title'](script))}</a>"
        for script in examples["SCRIPTS"]
    )
    return '\n## Examples\n\n<div class="thumbnails">\n' + "\n".join(entries) + "\n</div>\n"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links to the repository's files lead to their pages on the site."""
    _read[page.file.src_uri] = markdown
    markdown = _LIVE.sub(_frame, _FENCE.sub(r"```\1", markdown))
    if page.file.src_uri == "changes.md":
        page.meta["search"] = {"exclude": True}
    elif not page.file.src_uri.startswith("files/"):
        made = page.file.src_uri.startswith("api-") or page.file.src_uri in ("commands.md", "errors.md")
        group = "API" if made else "" if page.parent is None else page.parent.title
        page.meta["search"] = {"boost": _BOOSTS.get(group, 1)}
    if page.file.src_uri.startswith("files/"):
        return markdown
    if words := _SEARCHED.search(markdown):
        page.meta["tags"] = words[1].split()
    return _LINK.sub(lambda found: _relinked(found, ROOT / "docs"), markdown)


def on_page_content(html: str, page: Any, **_: Any) -> str:
    """Replace formulas by MathML, and roles of docstrings, :meth:`~twistwrench.Robot.add`, by the names they show.

    The copy button of a block of commands copies them without prompts and output. A last line that only the search reads has
    the American spelling of the page's words.
    """
    from latex2mathml.converter import convert

    def shown(found: re.Match[str]) -> str:
        text, tilde, name = found[1], found[2], found[3]
        return f"<code>{text or (name.rpartition('.')[2] if tilde else name)}</code>"

    def formula(found: re.Match[str]) -> str:
        return convert(unescape(found[2]), display="inline" if found[1] == "(" else "block")

    def console(found: re.Match[str]) -> str:
        commands = _commands_of(found[2])
        return f'<div class="{found[1]}" data-copy="{escape(commands)}">' if commands else found[0]

    american = "" if page.file.src_uri.startswith("files/") else f"<p hidden>{' '.join(_american(html))}</p>"
    return _FORMULA.sub(formula, _ROLE.sub(shown, _HIGHLIGHTED.sub(console, html))) + american


def _american(text: str) -> list[str]:
    """American forms of the British words of a text, once each."""
    words = {word.lower() for word in _BRITISH.findall(re.sub(r"<[^>]+>", " ", text))}
    return sorted(re.sub("|".join(_AMERICAN), lambda found: _AMERICAN[found[0]], word) for word in words)


def _commands_of(block: str) -> str:
    """Commands of a highlighted block, one a line; a line that ends with a backslash goes on."""
    commands, goes_on = [], False
    for line in unescape(re.sub(r"<[^>]+>", "", block)).splitlines():
        if goes_on or line.startswith("$ "):
            commands.append(line if goes_on else line.removeprefix("$ "))
            goes_on = line.endswith("\\")
    return "\n".join(commands)


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """The script that search needs where the site is read from files is the site's own, and not fetched.

    The search has a name for those who do not see it.
    """
    output = output.replace(_SHIM, "../" * page.file.dest_uri.count("/") + "search_frame.js")
    return re.sub(r'(<div class="?md-search"? [^>]*role="?dialog"?)', r'\1 aria-label="Search"', output)


def on_post_template(output: str, **_: Any) -> str:
    """Likewise for the page of what is not found."""
    return output.replace(_SHIM, "search_frame.js")


def on_post_build(config: Any) -> None:
    """Write lists for programs that read the site, and pages at old addresses.

    llms.txt has a sentence for each page of the navigation; llms-full.txt has the text of all but the API.
    """
    site = Path(config.site_dir)
    head = [f"# {config.site_name}", "", f"> {config.site_description}", ""]
    lines, texts = list(head), list(head)
    for group, entries in _groups(config.nav):
        pages = (f"- [{title}]({name.removesuffix('.md')}.html): {_sentence(name, title)}" for title, name in entries)
        lines += [f"## {group}", "", *pages, ""]
        texts += [_COMMENT.sub("", _read[name]) for _, name in entries if not name.startswith("api")]
    (site / "llms.txt").write_text("\n".join(lines), "utf-8")
    (site / "llms-full.txt").write_text("\n".join(texts), "utf-8")
    for name, target in _MOVED.items():
        link = f'<!doctype html><meta http-equiv="refresh" content="0; url={target}"><a href="{target}">Moved</a>\n'
        (site / f"{name}.html").write_text(link, "utf-8")


def _sentence(name: str, title: str) -> str:
    """First sentence of a page below its title, without links; API pages begin with lists."""
    if name in _SENTENCES:
        return _SENTENCES[name]
    if name.startswith("api"):
        return f"Methods, functions and classes with their docstrings: {title[0].lower()}{title[1:]}."
    paragraphs = re.split(r"\n\s*\n", _COMMENT.sub("", _read[name]))[1:]
    prose = next(" ".join(p.split()) for p in paragraphs if re.match(r"[A-Z\[*]|`(?!``)", p.strip()))
    sentence = re.split(r"(?<=[.:?]) (?=[A-Z`])", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", prose))[0]
    return f"{sentence.rstrip(':.')}."


def _groups(nav: Any) -> list[tuple[str, list[tuple[str, str]]]]:
    """Groups of the navigation with titles and files of their pages; pages without a group come first."""
    pairs = [(title, place) for entry in nav for title, place in entry.items()]
    single = [(title, place) for title, place in pairs if isinstance(place, str)]
    grouped = [
        (title, [(t, p) for entry in places for t, p in entry.items()])
        for title, places in pairs
        if isinstance(places, list)
    ]
    return [("Start", single), *grouped]


def _relinked(found: re.Match[str], folder: Path) -> str:
    target = (folder / found[1] / found[2]).resolve()
    if found[1] != "../" or not target.is_relative_to(ROOT) or target.parent == ROOT / "docs":
        return found[0]
    return f"]({_page_of(target)})"


def _files_linked(page: Path) -> set[Path]:
    """Files of the repository, outside docs, that a page links to."""
    found = set()
    for match in _LINK.finditer(page.read_text("utf-8")):
        target = (page.parent / match[1] / match[2]).resolve()
        inside = target.is_relative_to(ROOT) and not target.is_relative_to(ROOT / "docs")
        if target.exists() and inside and target.name not in ("README.md", "payload.html"):
            found.add(target)
    return found


def _page_of(target: Path) -> str:
    return f"files/{target.relative_to(ROOT).as_posix().replace('/', '-')}.md"


def _shown(target: Path) -> str:
    """A file as a page: text as it is, sources in a block, a folder as a list."""
    unsearched = "---\nsearch:\n  exclude: true\n---\n\n"
    title = f"{unsearched}# {target.relative_to(ROOT).as_posix()}\n\n"
    if target.is_dir():
        return title + "\n".join(f"- `{f.name}`" for f in sorted(target.iterdir()) if f.suffix == ".py")
    text = target.read_text("utf-8")
    if target.suffix == ".md":
        return unsearched + _LINK.sub(lambda m: f"]: {m[2]}".replace("]: ", "] (") + ")", text)
    return f"{title}````{_LANGUAGES.get(target.suffix, 'text')}\n{text.rstrip()}\n````\n"


def _beside_docs(name: str) -> str:
    """A file of the checkout's root, its links as seen from docs."""
    text = (ROOT / name).read_text("utf-8")

    def moved(found: re.Match[str]) -> str:
        if (found[1] + found[2]).startswith("docs/"):
            return f"]({(found[1] + found[2]).removeprefix('docs/')}{found[3] or ''})"
        return f"](../{found[1]}{found[2]}{found[3] or ''})"

    text = text.replace("](examples/payload.html)", "](docs/live/payload.html)")  # the site has it where its frames are
    return _LINK.sub(moved, re.sub(r'(src|srcset)="docs/', r'\1="', text))


def _commands() -> str:
    """The command line, from its own help."""
    import click

    from twistwrench.cli.main import main

    parts = ["# Command line\n\nWritten from `twistwrench COMMAND --help`.\n"]
    for name in sorted(main.list_commands(click.Context(main))):
        command = main.get_command(click.Context(main), name)
        context = click.Context(command, info_name=f"twistwrench {name}", max_content_width=100, terminal_width=100)
        parts.append(f"## {name}\n\n```text\n{command.get_help(context)}\n```\n")
    return "\n".join(parts)


def _book() -> dict[str, str]:
    """Sections of the book as pages to drag, and a page that lists them."""
    import twistwrench as tw
    from twistwrench.viz.article import ARTICLES, article_of, article_text
    from twistwrench.viz.page import viewer_page
    from twistwrench.viz.section_pages import SECTIONS

    robots = {"8.1.3": tw.robots.planar_2r(), "8.5": tw.robots.planar_2r()}
    robots |= dict.fromkeys(("5.3", "5.4", "8.9"), tw.robots.ur5())
    titles = {number: article_of(number).get("section_title") for number in ARTICLES if number not in SECTIONS}
    titles |= {number: section.title for number, section in SECTIONS.items()}
    found, rows, numbers = {}, [], sorted(titles, key=lambda number: [int(part) for part in number.split(".")])
    for k, number in enumerate(numbers):
        robot = robots.get(number, tw.robots.panda())
        before, after = numbers[:k][-1:], numbers[k + 1 :][:1]
        neighbours = {f"← {n}": f"{n}.html" for n in before} | {"All pages": "../book-pages.html"}
        neighbours |= {f"{n} →": f"{n}.html" for n in after}
        instrument = None
        if number in SECTIONS:
            instrument = f"{number}-robot.html" if number in ARTICLES else f"{number}.html"
            found[f"book/{instrument}"] = viewer_page(robot, section=number, neighbours=neighbours).page
        if number in ARTICLES:
            instrument = instrument or f"{article_of(number)['instrument']}.html"
            found[f"book/{number}.html"] = article_text(number, neighbours=neighbours, instrument=instrument)
        rows.append(
            f'<a href="book/{number}.html"><img src="book/{number}.webp" alt="" width="360" height="225" loading="lazy">'
            f"<b>{number}</b> {titles[number]}</a>"
        )
    found["book-pages.md"] = (
        "# Interactive pages of the book\n\nSections of *Modern Robotics*, each a page that computes while its reader drags "
        "the tip of a robot or moves a slider. They need no network; save one, and it runs from a file.\n\n"
        '<div class="thumbnails">\n' + "\n".join(rows) + "\n</div>\n\n"
        "For your own arm: `twistwrench view my_arm.urdf --section 8.3 --html page.html`; [what the pages show](viewer.md).\n"
    )
    return found


def demo_motion(mass: float) -> Any:
    """The bundled motion of the UR5 with a payload [kg], to be shown."""
    import twistwrench as tw
    from twistwrench.motion.differentiation import Differentiation
    from twistwrench.motion.load_case import LoadCase, Payload
    from twistwrench.motion.motion_log import MotionLog
    from twistwrench.reports.drawn_motion import reported_motion
    from twistwrench.reports.torque_analysis import analyse

    ur5, log = tw.robots.ur5(), tw.robots.path_of("ur5").with_name("ur5_demo.csv")
    plan = Differentiation.plan(MotionLog.open(log, ur5.model), ur5.model)
    return reported_motion(analyse(LoadCase(ur5, (Payload(mass),)), plan, ur5.limits))


def _live() -> dict[str, str]:
    """Pages without side panel, for frames in guides."""
    import twistwrench as tw
    from twistwrench.viz.page import viewer_page

    ur5, heavy, light = tw.robots.ur5(), demo_motion(10.0), demo_motion(5.0)
    shown = {
        "payload": viewer_page(ur5, motion=heavy, embed=True, control="payload", still=True).page,
        "speed": viewer_page(ur5, motion=light, embed=True, control="speed", still=True).page,
        "fall": viewer_page(ur5, embed=True, control="fall", still=True).page,
        "ellipsoid": viewer_page(ur5, section="5.4", embed=True, control="section", still=True).page,
        "mass": viewer_page(tw.robots.planar_2r(), section="8.1.3", embed=True, control="section", still=True).page,
    }
    return {f"live/{name}.html": text for name, text in shown.items()}


def _frame(found: re.Match[str]) -> str:
    """A frame that loads its page once it is seen; without frames, a link."""
    name, title = found[1], found[2]
    return (
        f'<iframe class="live" src="live/{name}.html" title="{title}" loading="lazy"></iframe>\n\n'
        f"[{title}: open it by itself](live/{name}.html)"
    )


def _api() -> dict[str, str]:
    """A page of groups, and one for each group, class and module."""
    import twistwrench as tw

    pages, rows, grouped = {}, "", set[str]()
    for title, group in _GROUPS.items():
        methods, functions, others = (names.split() for names in group)
        page = f"api-{title.lower().replace(' ', '-')}.md"
        names = [*functions, *(f"Robot.{method}" for method in methods)]
        for name in others:
            rest = getattr(tw, name)
            own = [name] if inspect.isclass(rest) else [f"{name}.{n}" for n in rest.__all__ if not n.startswith("_")]
            pages[f"api-{name.lower()}.md"] = _listed(name if inspect.isclass(rest) else f"twistwrench.{name}", own)
        links = ", ".join(f"[`{name}`](api-{name.lower()}.md)" for name in others)
        more = f"See also {links}." if links else ""
        pages[page] = _listed(title, names).replace("\n\n", f"\n\n{more}\n\n", 1)
        entries = ", ".join(f"[`{n.removeprefix('Robot.')}`]({page}#twistwrench.{n})" for n in names)
        rows += f"| [{title}]({page}) | {entries} | {links} |\n"
        grouped.update(methods)
    errors = [n for n in sorted(tw.__all__) if n.endswith(("Error", "Warning"))]
    rest = [n for n in dir(tw.Robot) if not n.startswith("_") and n not in grouped]
    shown = f"    options:\n      members: [{', '.join(rest)}]\n"
    return pages | {
        "api-errors.md": _listed("Classes of errors", errors),
        "api-robot.md": f"# Robot\n\nMethods by subject: [API](api.md).\n\n::: twistwrench.Robot\n{shown}",
        "api.md": "# API by subject\n\n`import twistwrench as tw`; `tw.load` returns a [`Robot`](api-robot.md). "
        "The second column has methods of robots and functions of `tw`.\n\n"
        f"| subject | methods and functions | classes and modules |\n| --- | --- | --- |\n{rows}"
        "\n[Errors and warnings](errors.md) have a page with examples, and [their classes](api-errors.md) one of their own.\n",
    }


def _listed(title: str, names: list[str]) -> str:
    return f"# {title}\n\n" + "\n".join(f"::: twistwrench.{name}\n" for name in names)
