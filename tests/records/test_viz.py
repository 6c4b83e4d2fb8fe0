"""Pages and plots: the data behind their pictures, on record."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import warnings
from dataclasses import fields, is_dataclass, replace
from functools import cache

import numpy as np
import pytest
from recorded_answers import Records, plain_values, refusal

import twistwrench as tw
from twistwrench import viz
from twistwrench.motion.load_case import Payload
from twistwrench.reports.drawn_motion import reported_motion
from twistwrench.viz import (
    article,
    colours,
    page,
    page_data,
    page_floor,
    page_layer,
    page_loops,
    page_motion,
    page_programs,
    scene,
    section_pages,
    sliders,
    starting_pose,
    style,
)
from twistwrench.viz.page_layer import ArrowGroup, ColouredPoints, PageLayer

from .test_statics import ARM, FLYER, TILTED, from_file, joint, link, quiet
from .test_statics_contacts import SOLES, spider, stork

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
movie = importlib.import_module("twistwrench.viz.movie")  # beside a function of this name
needs_drawing = importlib.util.find_spec("matplotlib") is not None

# ── Robots


def visual(inner, at="0 0 0", turn="0 0 0", colour=""):
    paint = f'<material name="paint {colour}"><color rgba="{colour}"/></material>' if colour else ""
    return f'<visual><origin xyz="{at}" rpy="{turn}"/><geometry>{inner}</geometry>{paint}</visual>'


BOX, ROD, BALL = '<box size="0.2 0.12 0.3"/>', '<cylinder radius="0.04" length="0.5"/>', '<sphere radius="0.09"/>'
MOMENTS = (0.02, 0.03, 0.025, 0.001, 0.002, -0.001)


@cache
def dressed():
    """A robot with visuals on some links, and a link without."""
    return from_file(
        '<robot name="dressed">' + link("foot", 3.0, "0 0 0.1", MOMENTS, shape=visual(BOX, "0.02 0.01 0.15", "0 0 0.2", "0.2 0.4 0.6 1"))
        + link("arm", 1.1, "0.2 0.02 0", MOMENTS, shape=visual(ROD, "0.25 0 0", "0 1.57 0") + visual(BALL, "0.5 0 0", "0 0 0", "0.9 0.1 0.3 1"))
        + link("tip", 0.4, "0.1 0 0.03", (0.0004, 0.0005, 0.0003, 0, 0, 0)) + '<link name="end"/>'
        + joint("pan", "revolute", "foot", "arm", "0.03 0.02 0.33|0 0.2 0.1", "0.1 0.2 0.97", "-2 1.5 30")
        + joint("reach", "prismatic", "arm", "tip", "0.55 0.01 0.02|0.1 0 0", "0.9 0.3 0.1", "-0.1 0.3 20") + joint("to_end", "fixed", "tip", "end", "0.2 0.05 0")
        + "</robot>",
        tip="end",
    )  # fmt: skip


@cache
def stacker():
    return quiet(ARM, tip="tool", gravity=TILTED)


@cache
def line():
    """An arm of three unequal joints for pages on sections of the book."""
    return quiet(
        '<robot name="line">' + link("base", 2.0, "0 0 0.1", MOMENTS) + link("a", 1.4, "0.2 0.03 0.02", MOMENTS) + link("b", 1.1, "0.15 -0.02 0.03", MOMENTS)
        + link("c", 0.6, "0.05 0.01 0.1", (0.003, 0.004, 0.002, 0.0002, -0.0001, 0.0003)) + '<link name="tool0"/>'
        + joint("first", "revolute", "base", "a", "0.02 0.01 0.3|0.2 0 0.1", "0.2 0.1 0.95", "-2.5 2.1 40") + joint("second", "revolute", "a", "b", "0.4 0.03 0.02|0 0.1 0", "0.1 0.95 0.2", "-1.8 2.2 25")
        + joint("third", "prismatic", "b", "c", "0.3 0 0.04|0.1 0.2 0", "0.8 0.2 0.5", "-0.1 0.35 60") + joint("to_tool0", "fixed", "c", "tool0", "0.1 0.03 0.12|0.2 0.1 0")
        + "</robot>",
        tip="tool0",
    )  # fmt: skip


def shortened(value):
    """Plain values whose long texts are lengths, and whose long lists of numbers are arrays."""
    if isinstance(value, dict):
        return {str(key): shortened(entry) for key, entry in value.items()}
    if isinstance(value, str):
        return value if len(value) < 160 else f"{len(value.split())} words"
    if isinstance(value, list | tuple):
        if len(value) > 8 and all(isinstance(x, int | float) and not isinstance(x, bool) for x in value):
            return plain_values(np.array(value, float) if len(value) > 48 else list(value))
        return [shortened(entry) for entry in value]
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: shortened(getattr(value, f.name)) for f in fields(value)}
    try:
        return plain_values(value)
    except TypeError:
        return type(value).__name__


def summary(shown):
    """Shapes of a scene as numbers."""
    return {
        "shapes": [
            [s.body, s.layer, s.colour, s.pose[:3].sum(axis=0), s.surface.vertices.sum(axis=0), np.abs(s.surface.vertices).max(axis=0), list(s.surface.faces.shape)]
            for s in shown.shapes
        ],
        "size": shown.size, "dressed": shown.dressed, "remarks": shown.remarks, "doubtful": shown.doubtful, "notes": shown.notes,
    }  # fmt: skip


@cache
def scenes():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        loaded = stacker().with_payload(tw.SpatialInertia.from_com(2.0, (0.1, 0.05, 0.2)))
        made = {
            "dressed": dressed(), "stacker": stacker(), "loaded": loaded, "flyer": quiet(FLYER, floating_base=True), "stork": stork(floating_base=True),
            "block": quiet('<robot name="block">' + link("only", 2.0, "0 0 0", MOMENTS) + "</robot>", floating_base=True),
        }  # fmt: skip
        return {name: scene.scene_of(robot) for name, robot in made.items()}


# ── Scenes


@records.of(relative=1e-6)
def scenes_of_robots():
    found = {name: summary(shown) for name, shown in scenes().items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found["without meshes"] = summary(scene.scene_of(dressed(), meshes=False))
    shown = scenes()["dressed"]
    return found | {
        "bounds": [shown.bounds([0.3, 0.1]), shown.bounds([0.3, 0.1], "inertia"), scenes()["stork"].bounds(stork(floating_base=True).neutral)],
        "poses": shown.body_poses([[0.3, 0.1], [-0.4, 0.2]]),
        "decimated": [sum(len(s.surface.faces) for s in shown.decimated(n).shapes) for n in (50, 300, 10_000)],
        "ellipsoids": [[s.vertices.sum(axis=0), np.abs(s.vertices).max(axis=0)] for G in (tw.SpatialInertia.from_com(2.0, (0.1, 0.2, 0.3)), dressed().model.bodies[0].inertia) for s in scene.equal_inertia_ellipsoid(G)],
        "none": scene.equal_inertia_ellipsoid(tw.SpatialInertia.zero()), "turned": [scene.turned_z(np.array(d)) for d in ([0.1, 2.0, 0.3], [0, 0, -1.0], [3.0, 0.2, 0.1])],
    }  # fmt: skip


@records.of
def marks_and_colours_of_torques():
    return {
        "marks": {name: [vars(m) for m in colours.torque_marks(shown.robot.model)] for name, shown in scenes().items()},
        "shares": colours.share_colours([0.0, 0.3, 0.79, 0.81, -0.95, 1.0, 1.2, np.nan, 5.0]),
        "forces": {name: colours.force_scale(shown.robot, shown) for name, shown in scenes().items()},
        "masses": {name: colours.mass_scale(shown.robot, shown) for name, shown in scenes().items()},
        "sheet": colours.quantity_colours().splitlines(),
        "steps": colours.SEQUENTIAL,
    }


@records.of
def sliders_of_robots():
    ranges = [
        sliders._slider_range(*x)
        for x in (
            (-1.0, 2.0, 3.0),
            (-np.inf, 2.0, 3.0),
            (-np.inf, -9.0, 3.0),
            (-1.0, np.inf, 3.0),
            (8.0, np.inf, 3.0),
            (-np.inf, np.inf, 3.0),
        )
    ]
    models = {name: shown.robot.model for name, shown in scenes().items()} | {
        "spider": spider(floating_base=True).model
    }
    return {
        "sliders": {name: sliders.sliders_of(model) for name, model in models.items()}, "limbs": {name: sliders.limbs_of(model) for name, model in models.items()},
        "ranges": ranges, "finite": [sliders.finite_or_none(x) for x in (2.5, np.inf, -np.inf)],
    }  # fmt: skip


@records.of(relative=1e-4)
def starting_poses():
    robots = {name: shown.robot for name, shown in scenes().items()} | {"line": line(), "planar": tw.robots.planar_3r()}
    return {
        name: [starting_pose.starting_pose(r), starting_pose.is_arm(r.model), starting_pose.clear_of_stops(r), [b.joint.name for b in starting_pose.single_joints(r.model)],
               [starting_pose.chain_to_base(r.model, k) for k in range(len(r.model.bodies))]]
        for name, r in robots.items()
    }  # fmt: skip


@records.of
def data_of_robots_for_pages():
    wrenches = {"tool": [1.0, -2, 3, 4, 5, -6], "mast": [0, 0, 0, 0.1, 0.2, 0], "finger": [0.3, 0, 0.2, 0, 0, 0]}
    return {
        "robots": {name: shortened(page_data.robot_data(shown.robot, np.asarray(shown.robot.neutral))) for name, shown in scenes().items() if name in ("stacker", "flyer")},
        "many": [x["torques"] for x in page_data.robot_data(spider(floating_base=True), spider(floating_base=True).neutral)["limbs"]],
        "wrenches": page_data.wrench_data(stacker(), wrenches), "no wrench": page_data.wrench_data(stacker(), {}),
        "unknown": refusal(lambda: page_data.wrench_data(stacker(), {"hand": [1, 2, 3, 4, 5, 6.0]})), "short": refusal(lambda: page_data.wrench_data(stacker(), {"tool": [1, 2]})),
    }  # fmt: skip


@records.of(relative=1e-6)
def floors_of_pages():
    found = {}
    for name, shown in scenes().items():
        spheres = page_floor.spheres_of(shown)
        found[name] = [
            spheres,
            page_floor.pedestal_of(shown, spheres, -0.02),
            page_floor.pedestal_of(shown, spheres, -0.6),
        ]
    return found | {"none": page_floor.pedestal_of(scenes()["dressed"], [], 0.0)}


@records.of
def programs_of_pages():
    robots = {name: shown.robot for name, shown in scenes().items()}
    return {
        name: {
            "resistance": page_programs.resistance(r), "driven": page_programs.driven_velocities(r.model), "tips": page_programs.tips_of(r.model),
            "mass": page_programs.moving_mass(r.model), "last": page_programs.last_bodies(r.model), "one arm": page_programs.one_arm(r.model),
            "selectable": [page_programs._selectable_tips(r.model, p) for p in (None, Payload(1.0), Payload(2.0, frame=r.link_names[-1]))],
        }
        for name, r in robots.items()
    } | {
        "tips without one": [page_programs._selectable_tips(quiet(ARM).model, p) for p in (None, Payload(2.0, frame="fore"))],
        "unused": [page_programs._unused_name("a", {"a", "a_"}), page_programs._unused_name("b", {"a"})],
        "above": [page_programs.round_above(x) for x in (0.3, 1.0, 1.01, 2.0, 18.2, 50.0, 50.1, 99.0)],
        "frame": page_programs.frame_data(stacker().model.frame("tool")),
    }  # fmt: skip


# ── Pages


class Header(Exception):
    """Raised with the header of a page in place of packing it."""


def header(robot, **options):
    """Header of a page's data; arrays as sums, programs left out."""
    kept = {}

    def put(self, values, kind):
        array = np.asarray(values, page.KINDS[kind]).ravel()
        return {"kind": kind, "array": plain_values(array.astype(float))}

    def pack(self, data):
        kept.update(data)
        raise Header

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setattr(page._ArrayStore, "put", put)
        patch.setattr(page._ArrayStore, "pack", pack)
        with contextlib.suppress(Header):
            page.viewer_page(robot, **options)
    left_out = {"surfaces", "shapes", "colours", "frames", "bodies", "coordinates"}
    return shortened({key: value for key, value in kept.items() if key not in left_out})


def checked(robot, **options):
    t = np.linspace(0, 1.2, 18) ** 1.1
    s = np.sin(1.3 * t[:, None] * np.linspace(0.6, 1.4, robot.nq))
    q = np.asarray(robot.neutral) + 0.3 * s
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return tw.check(robot, tw.Motion(t, q, robot=robot, in_seconds=True), **options)


@records.of(relative=1e-4)
def headers_of_pages():
    report = checked(line(), payload="1.5,0.02,0.03,0.1", limits={"first": 15.0, "second": 12.0})
    two = checked(line(), payload=["1.5", "0.5@b"], wrench_on_robot={"tool0": [1.0, 2, 3, 4, 5, 6]})
    return {
        "line": header(line()), "pushed": header(line(), wrench_on_robot={"tool0": [1.0, 2, 3, 4, 5, 6]}, q=[0.2, -0.3, 0.1]),
        "motion": header(line(), motion=reported_motion(report)), "two payloads": header(line(), motion=reported_motion(two)),
        "section": header(line(), section="8.3"), "stork": header(stork(floating_base=True)),
        "refused": [refusal(lambda: page.viewer_page(line(), section="99")), refusal(lambda: page.viewer_page(line(), control="dance")), refusal(lambda: page.viewer_page(line(), q=[1.0]))],
    }  # fmt: skip


@records.of(relative=1e-5)
def sections_of_the_book():
    found = {}
    for number in section_pages.SECTIONS:
        panel = section_pages.section_panel(number)
        data = section_pages.section_data(panel, line(), np.array([0.2, -0.3, 0.1]))
        found[number] = shortened({k: v for k, v in data.items() if k not in ("picture", "idea", "links")}) | {
            "shown": panel.shown,
            "at rest": panel.at_rest,
        }
        found[number]["exercises"] = [[e["unit"], e["near"]] for e in data["exercises"]]
        found[number]["formulas"] = len(data["formulas"])
    return {
        "sections": {number: {k: v for k, v in data.items() if k not in ("gravity", "ranks", "rows")} if number != "8.3" else data for number, data in found.items()},
        "rows": [section_pages.ik_rows(r, f) for r, f in ((line(), None), (stacker(), None), (stacker(), "lift"), (tw.robots.planar_3r(), None))],
        "formula": [section_pages.formula_html(t) for t in ("M q̈ + h = τ", "J_b' F", "x_1^2 + dq", "V_b")],
        "limits": section_pages._finite_limits(np.array([3.0, 0.0, np.inf, 2.0]), 7.0),
        "refused": [refusal(lambda r=r: section_pages.section_panel("8.3").require(r)) for r in (stork(floating_base=True), quiet(ARM))] + [refusal(lambda: section_pages.section_panel("9"))],
    }  # fmt: skip


@records.of(relative=1e-5)
def motions_of_pages():
    report = checked(line(), payload="1.5,0.02,0.03,0.1", limits={"first": 15.0, "second": 12.0})
    motions = {
        "one": report, "none": checked(line()), "two": checked(line(), payload=["1.5", "0.5@b"]), "on the base": checked(line(), payload="3@base"),
        "stacker": checked(stacker(), payload="2@finger"),
    }  # fmt: skip
    found = {}
    for name, each in motions.items():
        motion = reported_motion(each)
        robot, payload = page_motion.robot_of_motion(motion)
        data = page_motion.motion_data(robot, motion, payload, lambda values, kind: [kind, np.asarray(values, float)])
        found[name] = [
            payload,
            robot.model.limits.effort,
            shortened(data),
            page_motion.notes_of_motion(motion),
            robot.model.moving_mass,
        ]
    thinned = replace(reported_motion(report), rows=90)
    return found | {
        "notes": page_motion.notes_of_motion(thinned),
        "python": [page_motion._robot_expression(s, t) for s, t in ((str(page_motion.BUNDLED / "ur5.urdf"), None), ("a/b.urdf", None), ("b.xml", "tool"))]
        + [page_motion._log_expression(s) for s in (str(page_motion.BUNDLED / "ur5_demo.csv"), "x/y.csv", str(page_motion.BUNDLED / "ur5.csv"))],
        "frames": [movie._frame_times(reported_motion(report), fps, speed) for fps, speed in ((25.0, 1.0), (10.0, 0.5))],
        "films": [refusal(lambda: movie._frame_times(reported_motion(report), 0.0, 1.0)), refusal(lambda: movie._frame_times(reported_motion(report), 25.0, 1e-6)), refusal(lambda: movie.movie_path("a.avi"))],
    }  # fmt: skip


@records.of(relative=1e-5)
def layers_of_pages():
    rng = np.random.default_rng(2)
    points, along = rng.normal(size=(4, 3, 3)), rng.normal(size=(4, 3, 3))

    def put(values, kind):
        return [kind, np.asarray(values, float)]

    group = ArrowGroup("forces", points, along, (0.1, 0.2, 0.3), np.abs(points[..., 0]))
    plain = ArrowGroup("errors", points[0], along[0], (0.3, 0.2, 0.1))
    dots = ColouredPoints("error", "mm", points[0], np.array([0.11, 0.98, 0.52]))
    layers = {
        "scaled": PageLayer("A", "told", (group, plain), longest=0.35, time=np.array([0.0, 0.2, 0.5, 0.9])), "own lengths": PageLayer("B", "more", (plain,), workspace=dots),
        "empty": PageLayer("C", "none", (), longest=0.2),
    }  # fmt: skip
    return {name: layer.data(put, 1.7) for name, layer in layers.items()} | {
        "rows": page_layer._nearest_rows(
            np.array([0.0, 1.0, 2.0, 4.0]), np.array([-1.0, 0.4, 0.5, 0.6, 2.9, 3.0, 3.1, 9.0])
        ),
        "dots": dots.data(put),
    }


@records.of(relative=1e-4)
def robots_that_stand_on_pages():
    shown = scenes()["stork"]
    standing = page_loops.standing_of(shown.robot, shown)
    box = from_file(SOLES, floating_base=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fixed = scene.scene_of(box)
    held = page_loops.held_pose(box, fixed)
    A = np.array([[1.0, 0.2, 0, 0.5], [0, 0.3, 2.0, 0.1]])
    return {
        "stork": shortened(standing), "arm": page_loops.standing_of(stacker(), scenes()["stacker"]), "held": shortened(held),
        "dependent": [page_loops._dependent_velocities(A, np.array(p)) for p in ([1.0, 1, 1, 1], [9.0, 1, 1, 1], [1.0, 9, 9, 1])],
        "may stand": [page_loops._may_stand(s.robot.model) for s in scenes().values()],
    }  # fmt: skip


@records.of
def articles_of_sections():
    found = {}
    for number in article.ARTICLES:
        text = article.article_text(number)
        made = article.article_of(number)
        found[number] = {
            "headings": [
                line.strip()[:90] for line in text.splitlines() if line.strip().startswith(("<h1", "<h2", "<details"))
            ][:14],
            "pictures": [
                [p.get("program"), p.get("kind"), [s.get("name") for s in p["sliders"]]] for p in made["picture"]
            ],
        }
    return found | {
        "with neighbours": [x[:160] for x in article.article_text("8.2", neighbours={"8.1": "a.html", "8.3": "b.html"}, instrument="i.html").splitlines() if "<nav>" in x or "this page</a>" in x],
        "refused": refusal(lambda: article.write_article("8.4", "a.html")),
    }  # fmt: skip


# ── Plots


def drawn(plot, folder):
    """Lines, texts, titles and limits of the figure that a plot writes."""
    from matplotlib.figure import Figure

    figures = []

    def keep(self, *_, **__):
        figures.append(self)

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setattr(Figure, "savefig", keep)
        try:
            plot(str(folder / "p.png"))
        except (OSError, tw.TwistWrenchError):
            if not figures:
                raise
    (figure, *_) = figures
    return {
        "title": figure.get_suptitle(),
        "size": figure.get_size_inches(),
        "axes": [axes_data(axis) for axis in figure.axes if axis.get_visible()],
    }


def axes_data(axis):
    def numbers(array):
        array = np.ma.filled(np.ma.asarray(array, float), np.nan)
        return [
            list(array.shape),
            float(np.nansum(array)),
            float(np.nansum(np.sin(1.0 + np.arange(array.size)) * array.ravel())),
        ]

    return {
        "titles": [axis.get_title(loc=place) for place in ("left", "center", "right")], "labels": [axis.get_xlabel(), axis.get_ylabel()],
        "limits": [*axis.get_xlim(), *axis.get_ylim()], "scales": [axis.get_xscale(), axis.get_yscale()],
        "lines": [[str(line.get_label())[:40] if not str(line.get_label()).startswith("_") else "", str(line.get_color()), line.get_linestyle(), *numbers(line.get_xydata())] for line in axis.lines][:30],
        "areas": [[str(area.get_label())[:40] if not str(area.get_label()).startswith("_") else "", *numbers(area.get_offsets()), len(area.get_paths())] for area in axis.collections][:20],
        "patches": [numbers(patch.get_path().vertices) for patch in axis.patches][:12], "texts": [text.get_text() for text in axis.texts][:20],
        "legend": [text.get_text() for text in axis.get_legend().get_texts()] if axis.get_legend() else None,
    }  # fmt: skip


@records.of(relative=1e-3)
def drawings_of_answers(folder):
    robot = line()
    report = checked(robot, payload="1.5,0.02,0.03,0.1", limits={"first": 15.0, "second": 12.0})
    payload = tw.payload(robot, [0.2, -0.3, 0.1], map="xz", samples=300)
    plans = tw.sensing.propose_poses(5)
    found = tw.sensing.identify("demo")
    return {
        **{f"torques, {kind}": drawn(lambda p, k=kind: report.plot(k, p), folder) for kind in ("torques", "causes", "power", "phase")},
        "payload": drawn(lambda p: payload.plot(path=p), folder), "poses": drawn(lambda p: plans.plot(path=p), folder), "identified": drawn(lambda p: found.plot(path=p), folder),
    }  # fmt: skip


@records.of
def choices_of_plots():
    report = checked(line())
    return {
        "kinds": [list(viz.answers.plots_of(x)) for x in (report, tw.payload(line(), [0.2, -0.3, 0.1]), tw.sensing.propose_poses(5), tw.sensing.identify("demo"))],
        "unknown": refusal(lambda: report.plot("charts")), "none": refusal(lambda: viz.answers.plot(tw.info(line()), None, None)),
        "grids": [style.panel_grid(n) for n in range(1, 11)] + [style.panel_grid(n, most=m) for n, m in ((5, 4), (3, 9), (7, 1), (4, 0))],
        "colours": [str(c) for c in style.SERIES],
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    if not needs_drawing and name in ("drawings_of_answers", "choices_of_plots", "motions_of_pages"):
        pytest.skip("matplotlib is not installed")
    records.compare(name, tmp_path)
