"""Robots on the ground: complete answers on record."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from recorded_answers import Records, refusal

import twistwrench as tw
from twistwrench import statics
from twistwrench.core.numbers import number
from twistwrench.motion.differentiation import Differentiation
from twistwrench.motion.motion_log import MotionLog
from twistwrench.reports.support import contact_schedule, ground, judgement, noise, slope, view
from twistwrench.reports.support.ground import ContactSchedule, GroundGiven, ground_of, with_base_free
from twistwrench.reports.support.noise import SupportNoise
from twistwrench.reports.support.standing_log import with_base_held

from .report_cases import TRIPOD, fields_of, heads, quietly, said, shown, tripod, words_of, write_log

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)

JOINTS = ("hip0", "knee0", "hip1", "knee1", "hip2", "knee2")
FEET = ("0.12x0.07@foot0", "0.1x0.08,0.01,0.012,0@foot1", "0.11x0.06@foot2")
POINTS = ("foot0", "foot1", "foot2")
POSE = {name: 0.4 if name.startswith("hip") else -0.4 for name in JOINTS}


@functools.cache
def free():
    return quietly(tw.load)(TRIPOD, floating_base=True, tip="mast")


def swaying(size=0.2, rows=13, lift=0.0, step=0.06, sigma=0.0, derived=False):
    """All legs turn alike, so that the hull sways and the feet stand; the first foot may be lifted meanwhile."""
    t = step * np.arange(rows)
    w, w2 = 2 * math.pi / t[-1], 4 * math.pi / t[-1]
    s = [0.4 + size * np.sin(w * t), size * w * np.cos(w * t), -size * w**2 * np.sin(w * t)]
    rise = [lift * (1 - np.cos(w2 * t)), lift * w2 * np.sin(w2 * t), lift * w2**2 * np.cos(w2 * t)]
    q, dq, ddq = (np.column_stack([x, -x, x, -x, x, -x]) for x in s)
    for values, more in zip((q, dq, ddq), rise, strict=True):
        values[:, 1] -= more
    if derived:
        noisy = q + np.random.default_rng(2).normal(0, sigma, q.shape)
        return tw.Motion(t, noisy, robot=tripod(), in_seconds=True)
    return tw.Motion(t, q, dq, ddq, robot=tripod(), in_seconds=True)


def free_motion(rows=9, velocity=(0, 0, 0), acceleration=(0, 0, 0), turn=0.0, height=0.0):
    """The whole robot moves, with its joints held."""
    robot = free()
    t = 0.04 * np.arange(rows)
    q = np.tile(robot.coordinates(**POSE), (rows, 1))
    v, a = np.array(velocity, float), np.array(acceleration, float)
    q[:, 4:7] = np.outer(t, v) + 0.5 * np.outer(t**2, a) + [0, 0, height]
    q[:, 0], q[:, 1] = math.cos(turn / 2), math.sin(turn / 2)
    dq, ddq = np.zeros((2, rows, robot.nv))
    rotation = np.array([[1, 0, 0], [0, math.cos(turn), -math.sin(turn)], [0, math.sin(turn), math.cos(turn)]])
    dq[:, 3:6] = (v + np.outer(t, a)) @ rotation
    ddq[:, 3:6] = a @ rotation
    return tw.Motion(t, q, dq, ddq, robot=robot, in_seconds=True)


def figures(support):
    names = (
        "holds", "decided", "how", "forces", "torques", "speed", "payload", "friction", "zmp", "zmp_margin", "in_contact", "need", "sliding",
        "strained", "ground_doubt", "aground", "balanced", "balanced_forces", "balancing",
    )  # fmt: skip
    return fields_of(support, *names)


@functools.cache
def swaying_report():
    return tw.check(tripod(), swaying(), feet=FEET, contact_friction=0.8, payload="1.4,0.02,0.01,0.05@mast", why=True)


# ── Robots on their feet


@records.of(relative=1e-5)
def a_swaying_tripod():
    report = swaying_report()
    return {
        "blocks": shown(report.blocks()),
        "support": figures(report.support),
        "torques": report.torques(),
        "peaks": report.peaks,
    }


@records.of(relative=1e-5)
def tables_of_a_swaying_tripod(folder):
    head, *lines = swaying_report().to_csv(folder / "out.csv", split=True).read_text().splitlines()
    rows = np.array([[float(cell or "nan") for cell in line.split(",")] for line in lines])
    return {"head": head.split(","), "rows": rows, "third": rows[2], "last": rows[-1]}


@records.of(relative=1e-4)
def tripods_at_rest():
    robot = tripod()
    answers = {
        "points": tw.check(robot, at=POSE, feet=POINTS),
        "auto": tw.check(robot, feet="auto"),
        "heavy, friction unknown": tw.check(robot, at=POSE, feet=FEET, payload="9,0.9,0.1,0@mast"),
        "pushed, friction unknown": tw.check(
            robot, at=POSE, feet=FEET, wrench_on_robot={"hull": (0, 0, 0, 21.0, 3.0, 0)}
        ),
        "pushed over": tw.check(
            robot, at=POSE, feet=FEET, wrench_on_robot={"mast": (0, 0, 0, 60.0, 9.0, 0)}, contact_friction=1.4
        ),
        "by foot": tw.check(
            robot, at=POSE, feet=FEET, contact_friction={"foot0": 0.5, "foot1": 0.4, "foot2": 0.6}, payload=1
        ),
        "weak": tw.check(robot, at=POSE, feet=FEET, contact_friction=0.5, limits={"hip2": 0.05, "knee1": 0.4}),
        "payload at a foot": tw.check(robot, at=POSE, feet=FEET, payload="1.5@foot1"),
        "uneven": tw.check(robot, at=POSE | {"knee0": -0.9}, feet=FEET),
        "two points": tw.check(robot, at=POSE, feet=POINTS[:2]),
    }
    return {
        name: [
            words_of(answer),
            answer.support.friction,
            answer.support.payload,
            answer.support.zmp_margin,
            answer.peaks,
        ]
        for name, answer in answers.items()
    }


@records.of(relative=1e-4)
def tripods_in_motion():
    robot = tripod()
    answers = {
        "slow": tw.check(robot, swaying(0.05), feet=FEET),
        "fast on given ground": tw.check(robot, swaying(0.3), feet=FEET, contact_friction=0.9),
        "slips": tw.check(robot, swaying(), feet=FEET, contact_friction=0.2),
        "lifts a foot": tw.check(robot, swaying(0.01, lift=0.1), feet=FEET, contact_friction=0.8),
        "scheduled": tw.check(
            robot,
            swaying(0.01),
            feet=FEET,
            in_contact={"foot0": 1, "foot1": [1, 0] * 6 + [1], "foot2": np.full(13, 30.0)},
        ),
    }
    return {
        name: [
            words_of(answer),
            answer.support.in_contact.sum(axis=0),
            answer.support.speed,
            answer.support.friction,
            answer.support.how,
        ]
        for name, answer in answers.items()
    } | {"points": refusal(lambda: tw.check(robot, swaying(0.01, lift=0.1), feet=POINTS))}


@records.of(relative=1e-4)
def tripods_that_move_as_a_whole():
    """Feet that slide, flight, and a base that nothing holds; on both sides of each speed and height."""

    def said_of(motion, **options):
        answer = tw.check(free(), motion, feet=FEET, **options)
        return [words_of(answer), answer.support.in_contact.sum(axis=0), answer.support.sliding, answer.support.need]

    return {
        "carried at 0.049 m/s": said_of(free_motion(velocity=(0.049, 0, 0))),
        "carried at 0.051 m/s": said_of(free_motion(velocity=(0.051, 0, 0))),
        "slides at 0.101 m/s": said_of(free_motion(velocity=(0.05, 0.0877, 0))),
        "falls": said_of(free_motion(velocity=(0.3, 0, 1.0), acceleration=(0, 0, -9.81))),
        "tilted": said_of(free_motion(turn=0.11)),
        "tilted floor": said_of(
            free_motion(turn=0.11), contact_normal=(0, -math.sin(0.11), math.cos(0.11)), contact_friction=0.5
        ),
        "steep floor": said_of(
            free_motion(turn=0.11), contact_normal=(0, -math.sin(0.11), math.cos(0.11)), contact_friction=0.1
        ),
        "steep floor of unknown friction": said_of(
            free_motion(turn=0.4), contact_normal=(0, -math.sin(0.4), math.cos(0.4))
        ),
    }


@functools.cache
def gentle_report():
    return tw.check(tripod(), swaying(0.1), feet=FEET, contact_friction=0.8, payload=2.0)


@functools.cache
def plan_of_positions():
    """How rates of a log of positions are derived; its deviation is replaced by a larger one."""
    motion = gentle_report().motion
    q = motion.q + np.random.default_rng(2).normal(0, 1e-6, motion.q.shape)
    log = MotionLog.from_motion(tw.Motion(motion.time, q, robot=motion.robot, in_seconds=True))
    return Differentiation.plan(log, motion.robot.model)


@records.of
def words_on_noise_of_support():
    certain = np.zeros(3, bool)
    table = {}
    for spread, speed in ((0.01, 1.025), (0.01, 1.027), (0.001, 1.0026), (0.001, 1.0024), (0.0, math.inf), (0.02, 3.0)):
        one = SupportNoise(certain, spread, speed, 0.41, "tips")
        table[f"{spread} {speed}"] = [one.hides, one.words if math.isfinite(speed) else "", one.interval_words(speed)]
    for spread in (0.00203, 0.00205):
        table[f"interval {spread}"] = SupportNoise(certain, spread, 1.4, 0.41, "tips").interval_words(1.4)
    return table


@records.of(relative=1e-3)
def noise_of_support():
    """Failing instants and margins, by deviations of accelerations that are given."""
    plan = plan_of_positions()
    support = gentle_report().support
    sway = tw.check(tripod(), swaying(0.12), feet=FEET, contact_friction=0.2)
    slips = with_ground(sway.support, given=True)
    table = {"none": noise.support_noise(support, replace(plan, sigma_ddq=0 * plan.sigma_ddq))}
    for size in (0.001, 0.03):
        sigma = replace(plan, sigma_ddq=size * np.arange(1.0, 13.0))
        found = noise.support_noise(support, sigma)
        held = replace(support, noise=found)
        table[f"stands {size}"] = [
            found.certain,
            found.spread,
            found.speed,
            found.time,
            found.how,
            judgement.support_verdict(held),
            judgement.standing_words(held),
        ]
        one = noise.support_noise(slips, sigma)
        table[f"slips {size}"] = [
            one.certain,
            one.spread,
            one.speed,
            one.how,
            judgement.support_verdict(replace(slips, noise=one)),
        ]
    return table


@records.of(relative=1e-6)
def load_case_of_a_standing_robot():
    """Torques with and without loads, their causes, and the mass matrix of a base that contacts bear."""
    load = swaying_report().load
    s = slope.samples(swaying_report().motion, slice(2, 5))
    plain = replace(load, friction=False, payloads=(), wrenches={})
    forces, carrying = load.contact(s)
    return {
        "torques": load.torques(s),
        "unloaded": load.unloaded_torques(s),
        "air": load.torques_in_the_air(s),
        "terms": load.terms(s),
        "plain terms": plain.terms(s),
        "mass matrix": load.mass_matrix(s.q),
        "one mass matrix": load.mass_matrix(s.q[0]),
        "forces": [forces.forces, carrying],
        "words": [load.causes, load.fixed_words, load.payload_mass, plain.payload_mass, plain.wrenches_on(s)],
        "explained": load.explain(s[1]).parts,
        "explained without friction": plain.explain(s[1]).parts,
    }


# ── Judgement, instant by instant


def altered(report, **changes):
    """Support with other figures at some instants."""
    support = report.support
    fields = {}
    for name, value in changes.items():
        fields[name] = value(getattr(support, name).copy()) if callable(value) else value
    return replace(support, **fields)


def at(*rows, to):
    def change(values):
        values[list(rows)] = to
        return values

    return change


def with_ground(support, **changes):
    return replace(support, case=replace(support.case, ground=replace(support.case.ground, **changes)))


@records.of(relative=1e-4)
def judgement_of_instants():
    report = gentle_report()
    unknown = tw.check(tripod(), swaying(0.1), feet=FEET, payload=2.0)
    n = len(report.support.time)
    nan = np.nan

    def both(support):
        verdict = judgement.support_verdict(support)
        standing = judgement.standing_words(support) if verdict.ok else None
        return [verdict, standing, judgement.ground_words(support), list(judgement.support_notes(support))]

    fails = at(3, 4, 5, to=False)
    table = {"stands": both(report.support), "unknown": both(unknown.support)}
    for how in ("tips", "slips", "pulls off"):
        for name, speed, payload in (
            ("faster", (0.8, 0.7, 0.9), 1.0),
            ("lighter", (nan, nan, nan), -0.734),
            ("both", (0.8, 0.7, 0.71), -0.5),
            ("neither", (nan, nan, nan), -2.5),
            ("too slow", (0.004, 0.0049, 0.0049), -2.1),
        ):
            one = altered(
                report,
                holds=fails,
                how=at(3, 4, 5, to=how),
                speed=at(3, 4, 5, to=speed),
                payload=at(3, 4, 5, to=(payload + 0.2, payload, payload + 0.1)),
                friction=at(3, 4, 5, to=(0.9, 1.234, 0.85)),
            )
            table[f"{how} {name}"] = judgement.support_verdict(one)
        none = altered(
            report,
            holds=fails,
            how=at(3, 4, 5, to=how),
            speed=at(3, 4, 5, to=(nan, nan, 0.9)),
            friction=at(3, 4, 5, to=(np.inf, 1.2, 1.5)),
            motion=at(3, 4, 5, to=0.3),
        )
        table[f"{how}, no friction holds"] = [
            judgement._worst_instant(none, np.isin(np.arange(n), (3, 4, 5))),
            judgement._worst_instant(none, np.isin(np.arange(n), (4, 5))),
        ]
    equal = altered(
        report,
        holds=fails,
        speed=at(3, 4, 5, to=(0.7, 0.70099, 0.7011)),
        friction=at(3, 4, 5, to=(0.9, 1.0, 1.3)),
        how=at(3, 4, 5, to="slips"),
    )
    table["equal margins"] = [
        judgement._worst_instant(equal, np.isin(np.arange(n), (3, 4, 5))),
        judgement.support_verdict(equal),
    ]
    undecided = altered(report, decided=at(3, 4, to=False), holds=at(3, 4, to=False))
    table["undecided"] = both(undecided)
    no_contact = altered(report, in_contact=at(6, 7, 8, to=False), need=at(6, 7, 8, to=(0.0, 5.0, 3.0)))
    table["flight"] = [
        judgement.support_verdict(replace(no_contact, need=np.where(no_contact.aground, 0.0, force)))
        for force in (0.049 * 9.81 * 14.4, 0.051 * 9.81 * 14.4)
    ]
    table["one instant in flight"] = judgement.support_verdict(
        altered(report, in_contact=at(6, to=False), need=at(6, to=50.0))
    )
    table["slides"] = judgement.support_verdict(
        replace(no_contact, sliding=("foot1", 0.1234, 0.21), need=np.full(n, 90.0))
    )
    for value in (0.299, 0.301, 0.3, 1.23):
        needs = altered(unknown, friction=at(9, to=value))
        needs = replace(needs, friction=np.minimum(needs.friction, value))
        table[f"needs {value}"] = both(needs)[:3]
    table["friction would suffice"] = judgement.support_verdict(
        altered(unknown, friction=at(9, to=0.9), holds=at(9, to=False), how=at(9, to="slips"), speed=at(9, to=0.77))
    )
    for strained in (False, True):
        for friction in (0.0, 0.2):
            for name, given in (("given", report), ("unknown", unknown)):
                one = replace(given.support, strained=strained, friction=np.full(n, friction))
                table[f"words {strained} {friction} {name}"] = judgement.standing_words(one)
    smooth = with_ground(
        report.support, contacts=tuple(replace(c, friction=0.0) for c in report.support.ground.contacts)
    )
    table["without friction"] = judgement.standing_words(smooth)
    still = replace(report.support, speed=np.full(n, np.inf), payload=np.full(n, np.inf))
    table["no margins"] = [
        judgement.standing_words(still),
        judgement.standing_words(replace(still, zmp_margin=np.full(n, nan))),
    ]
    table["balancing"] = {}
    for carrying in ((0,), (0, 1), (0, 1, 2), (0, 1, 3), (0, 4, 8), (4, 5), (0, 2), (4, 5, 8)):
        mask = np.isin(np.arange(12), carrying)
        lined = altered(
            report,
            in_contact=lambda values, mask=mask: np.where(np.arange(n)[:, None] < 4, mask, values),
            holds=at(0, 2, 3, to=False),
            decided=at(3, to=False),
        )
        table["balancing"][str(carrying)] = [lined.balancing, list(judgement._doubts(lined))]
    table["notes"] = [
        list(
            judgement.support_notes(
                altered(
                    report, in_contact=lambda values, k=k: np.broadcast_to(np.arange(values.shape[1]) < k, values.shape)
                )
            )
        )
        for k in (3, 4)
    ]
    return table


@records.of
def numbers_in_words_about_the_ground():
    values = (-0.1, 0.0, 0.0004, 0.001, 0.0012345, 0.01001, 0.0999, 0.1, 0.12000001, 0.121, 0.9951, 1.0, 1.001, 12.34)
    return {
        "friction": [judgement._friction_text(x) for x in values],
        "margin": [judgement._margin_text(x) for x in (*values, 1.2345, 1.2349999999999, 123.46)],
        "mass": [judgement._mass_text(x) for x in (0.0, 0.001, 0.01, 0.0100000001, 0.0101, 1.2345, 123.454)],
        "spans": [judgement._span_text(np.array([0.1, 0.2, 0.3, 0.4]), np.array(mask)) for mask in ([0, 1, 0, 0], [1, 0, 1, 0], [0, 1, 1, 1]) for mask in [np.array(mask, bool)]],
        "force": [view._force_text(x) for x in (1e-7, 0.000123456, 12.34567, 12345.6)],
        "assumed": [number(ground.ASSUMED_FRICTION), ground.UNLIMITED_FRICTION],
    }  # fmt: skip


# ── The ground as a user names it


@records.of(relative=1e-6)
def grounds_of_all_forms():
    robot = free()
    q = robot.coordinates(**POSE)
    wall = statics.Contact((0.05, 0.01, 0.02), (-1, 0.2, 0), friction=0.45, frame="mast", push=40.0)
    magnet = statics.Contact((0, 0, 0), (0, 0, -1), friction=0.6, pull=33.0, frame="hull")
    slanted = [
        statics.Contact(
            (0, 0, 0), (math.sin(math.radians(a)), 0, math.cos(math.radians(a))), friction=0.7, frame="foot0"
        )
        for a in (0.98, 1.02)
    ]
    given = {
        "names": GroundGiven(feet=POINTS), "one": GroundGiven(feet="foot2"), "auto": GroundGiven(feet="auto"), "rectangles": GroundGiven(feet=FEET, friction=0.65),
        "mixed": GroundGiven(feet=["foot0", wall, magnet, *slanted]), "contacts": GroundGiven(feet=[wall, magnet]),
        "contacts with friction": GroundGiven(feet=[wall, "foot1"], friction={"mast": 0.2, "foot1": 0.9}),
        "normal": GroundGiven(feet=("foot0", "foot1"), normal=(0, -0.6, 2.0)), "one contact": GroundGiven(feet=wall),
    }  # fmt: skip
    table = {}
    for name, one in given.items():
        found = ground_of(robot, one, q)
        table[name] = [
            fields_of(found, "given", "automatic", "on_ground", "normal", "normal_given", "frames", "normals", "frictions", "feet"),
            [[c.point, c.friction, c.frame, c.push, c.pull, c.radius, c.group] for c in found.contacts],
            [c.friction for c in found.unlimited_contacts], found.contacts_at("foot1"),
        ]  # fmt: skip
    plain = tripod()
    refused = {
        "empty": lambda: ground_of(robot, GroundGiven(feet=[]), q), "unknown": lambda: ground_of(robot, GroundGiven(feet="foot9"), q),
        "wheel": lambda: ground_of(robot, GroundGiven(wheels=["foot9"]), q), "caster": lambda: ground_of(robot, GroundGiven(casters="foo"), q),
        "rectangle of a wheel": lambda: ground_of(robot, GroundGiven(wheels=["1x2@foot0"]), q), "friction": lambda: ground_of(robot, GroundGiven(feet=POINTS, friction={"foot0": 0.5}), q),
        "friction of": lambda: ground_of(robot, GroundGiven(feet=POINTS, friction={"foot0": 0.5, "leg": 1}), q), "negative": lambda: ground_of(robot, GroundGiven(feet=POINTS, friction=-0.1), q),
        "word": lambda: ground_of(robot, GroundGiven(feet=POINTS, friction="much"), q), "infinite": lambda: ground_of(robot, GroundGiven(feet=POINTS, friction=math.inf), q),
        "normal": lambda: ground_of(robot, GroundGiven(feet=POINTS, normal=(0, 0, 0)), q), "three": lambda: ground_of(robot, GroundGiven(feet=POINTS, normal=(0, 1)), q),
        "numbers": lambda: ground_of(robot, GroundGiven(feet="0.1@foot0"), q), "six": lambda: ground_of(robot, GroundGiven(feet="0.1x0.2,1,2,3,4@foot0"), q),
        "no frame": lambda: ground_of(robot, GroundGiven(feet=statics.Contact()), q), "world": lambda: ground_of(plain, GroundGiven(feet="hull"), plain.neutral),
        "no legs": lambda: ground_of(with_base_free(tw.robots.planar_2r()), GroundGiven(feet="auto"), np.zeros(9)),
        "partly": lambda: with_base_free(quietly(tw.load)('<mujoco><worldbody><body name="b"><joint name="y" type="ball"/><geom size="0.1"/></body></worldbody></mujoco>')),
        "fixed": lambda: with_base_free(quietly(tw.load)(TRIPOD, floating_base=False)), "planar": lambda: with_base_free(quietly(tw.load)('<robot name="s"><link name="g"/><link name="s"><inertial><mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="slide" type="planar"><parent link="g"/><child link="s"/><axis xyz="0 0 1"/></joint></robot>')),
        "properties": lambda: GroundGiven.of(None, None, None, 0.5), "normal alone": lambda: GroundGiven.of(None, None, None, None, "auto", (0, 0, 1)),
    }  # fmt: skip
    table["refused"] = {name: refusal(call) for name, call in refused.items()}
    table["of"] = [
        GroundGiven.of(None, None, None, None),
        GroundGiven.of("a", None, None, 0.5, "log", None),
        GroundGiven.of(None, "w", None, None),
        GroundGiven.of(None, None, ["c"], None),
    ]
    table["free"] = [
        with_base_free(robot) is robot,
        with_base_free(plain).nv,
        with_base_held(robot).nv,
        with_base_held(plain) is plain,
    ]
    return table


@records.of
def contacts_that_carry_by_a_schedule(folder):
    robot = free()
    q = robot.coordinates(**POSE)
    base = ground_of(robot, GroundGiven(feet=FEET), q)
    times = ContactSchedule(np.array([0.0, 0.1, 0.2]), np.array([[1, 0], [0, 0], [1, 1]], bool))
    table = {"at": times.at(np.array([-0.1, 0.0, 0.0999, 0.1 - 1e-13, 0.1, 0.15, 0.2, 9.0]))}
    t = np.array([0.0, 0.02, 0.04, 0.06, 0.08])
    logged = np.column_stack(
        [swaying(rows=5, step=0.02).q, [1, 1, 0, 0, 1], [19.9, 20.1, 300, 0, 21], [0.49, 0.51, 1, 0, 0.5]]
    )
    names = [*JOINTS, "foot0.contact", "foot1.contact [N]", "foot2.contact"]
    np.savetxt(
        folder / "log.csv", np.column_stack([t, logged]), "%.9g", ",", header=",".join(["time", *names]), comments=""
    )
    names[7] = "load [kN]"
    np.savetxt(
        folder / "kilo.csv",
        np.column_stack([1.6e9 + t, logged]),
        "%.12g",
        ",",
        header=",".join(["time", *names]),
        comments="",
    )
    np.savetxt(folder / "counted.csv", logged, "%.9g", ",", header=",".join([*JOINTS, "a", "b", "c"]), comments="")
    logs = {
        name: MotionLog.open(folder / f"{name}.csv", tripod().model, rate=50.0 if name == "counted" else None)
        for name in ("log", "kilo", "counted")
    }

    def scheduled(name, given):
        found = contact_schedule.with_schedule(base, given, logs[name]).schedule
        return None if found is None else [found.time, found.carries]

    of_kilo = {"foot0": "foot0.contact", "foot1": "load", "foot2": "foot2.contact"}
    table |= {
        "auto": scheduled("log", "auto"), "log": scheduled("log", "log"), "kilo": scheduled("kilo", of_kilo), "counted": scheduled("counted", {"foot0": "a", "foot1": "b", "foot2": "c"}),
        "mixed": scheduled("log", {"foot0": [1, 0, 0.6, 0.4, 1], "foot1": 21.0, "foot2": "foot2.contact"}),
    }  # fmt: skip
    table["refused"] = {
        "word": refusal(lambda: scheduled("log", "yes")), "foot": refusal(lambda: scheduled("log", {"foot7": 1})), "missing": refusal(lambda: scheduled("log", {"foot0": 1})),
        "column": refusal(lambda: scheduled("log", of_kilo | {"foot1": "foot1.contct"})), "no hint": refusal(lambda: scheduled("log", of_kilo | {"foot1": "zz"})),
        "rows": refusal(lambda: scheduled("log", {"foot0": [1, 2], "foot1": 1, "foot2": 1})),
    }  # fmt: skip
    still = swaying(0.01, rows=5, step=0.02)
    flags = np.column_stack([[1, 1, 0, 1, 1], [50, 60, 70, 0, 0], [1, 1, 1, 1, 1]])
    rates = heads(tripod(), "", ".vel", ".acc")
    columns = (still.q, still.dq, still.ddq, flags)
    write_log(folder / "flags.csv", t, columns, [*rates, "foot0.contact", "foot1.contact", "foot2.contact"])
    answer = tw.check(tripod(), folder / "flags.csv", feet=FEET, in_contact="log")
    table["check"] = [words_of(answer), answer.support.in_contact]
    return table  # fmt: skip


@records.of(relative=1e-5)
def logs_with_and_without_the_base(folder):
    """Logs of the joints alone, of all coordinates, with rates and torques, of robots that float or not."""
    still = swaying(0.02, rows=12)
    t, q, dq, ddq = still.time, still.q, still.dq, still.ddq
    tau = 0.5 + 0.1 * q
    whole = free_motion(rows=12)
    logs = {
        "joints": (write_log(folder / "joints.csv", t, (q,), JOINTS)),
        "rates": (write_log(folder / "rates.csv", t, (q, dq), heads(tripod(), "", ".vel"))),
        "all": (write_log(folder / "all.csv", t, (q, dq, ddq, tau), heads(tripod(), "", ".vel", ".acc", ".torque"))),
        "base": (write_log(folder / "base.csv", whole.time, (whole.q,), free().coordinate_names)),
    }
    table = {}
    kinds = {"fixed": tripod(), "free": free()}
    for name, log in (("fixed", "rates"), ("free", "all"), ("free", "base")):
        for robot, path in ((kinds[name], logs[log]),):
            answer = tw.check(robot, path, feet=POINTS)
            table[f"{name} {log}"] = [
                words_of(answer)["sentences"][0],
                answer.motion.q[3],
                answer.motion.dq[4],
                answer.motion.ddq[5],
                answer.peaks,
                answer.differentiation.trajectory.notes,
                [m.measured for m in answer.measured],
            ]
    table["fixed with a base"] = refusal(lambda: tw.check(tripod(), logs["base"], feet=POINTS))
    table["mounted"] = with_base_held(free()).model.mounted
    return table


# ── Slopes, heights and wheels


@records.of(relative=1e-6)
def heights_of_contacts():
    e = np.array([0.1, -0.2, 1.0]) / math.sqrt(1.05)
    up = np.array([0.0, 0.0, 1.0])
    square = np.array([[0.3, 0.2, 0.0], [-0.3, 0.2, 0.0], [-0.3, -0.2, 0.0], [0.3, -0.25, 0.0], [0.0, 0.0, 0.5]])
    all_but_last = np.array([1, 1, 1, 1, 0], bool)

    def raised(*heights):
        points = square.copy()
        points[:4, 2] = heights
        return points

    cases = {
        "level": raised(0, 0, 0, 0), "share of the distance below": raised(0, 0, 0, 0.0148), "above": raised(0, 0, 0, 0.0154), "slope": raised(0.06, 0, 0.0, 0.06),
        "bent": raised(0.06, 0.0, 0.06, 0.0), "slope, a little bent": raised(0.06, 0.0, 0.0, 0.048), "slope, more bent": raised(0.06, 0.0, 0.0, 0.03),
    }  # fmt: skip
    table = {name: slope._height_difference(points, all_but_last, up) for name, points in cases.items()}
    close = np.array([[0.0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]])
    for height in (0.0019, 0.0021):
        close[2, 2] = height
        table[f"near each other {height}"] = slope._height_difference(close, np.ones(3, bool), up)
    line = np.array([[0.0, 0, 0], [0.2, 0.0, 0.1], [0.4, 0.03, 0.2]])
    table |= {
        "none": slope._height_difference(square, np.zeros(5, bool), up), "two": slope._height_difference(raised(0.1, 0, 0, 0), np.array([1, 1, 0, 0, 0], bool), up),
        "line": slope._height_difference(line, np.ones(3, bool), up), "not quite a line": slope._height_difference(np.where(line == 0.2, 0.27, line), np.ones(3, bool), up),
        "along a slope": slope._height_difference(raised(0.06, 0, 0.0, 0.06), all_but_last, e), "downward": slope._height_difference(raised(0.06, 0, 0.0, 0.06), all_but_last, -up),
    }  # fmt: skip
    frames = ["f0", "f1", "f1", "f2", "f3"]
    table["words"] = [
        slope._doubt_of_heights(frames, raised(0.06, 0, 0.01, 0.08), mask, up, plane, 0.123)
        for mask in (all_but_last, np.ones(5, bool))
        for plane in (None, e, up)
    ]
    table["gravity"] = [slope._doubt_of_gravity(np.zeros(3), up), slope._doubt_of_gravity(np.array([0.1, 0, 9.0]), e)]
    speeds = np.array([[0.2, -0.05, 0.09], [0.3, 0.101, -0.099], [0.1, 0.0, 0.0]])
    table["wheels"] = [
        slope._doubt_of_wheel_speeds(["a", "b", "c"], factor * speeds, np.array(mask, bool), np.array([0.0, 0.1, 0.2]))
        for factor in (1.0, -1.0)
        for mask in ([0, 1, 1], [0, 0, 1], [0, 0, 0], [1, 1, 1])
    ]
    table["normals"] = [slope._normal_argument(x) for x in (e, -up, np.array([-1e-6, 0.123456, 0.99]))]
    report = swaying_report()
    tilted = []
    for degrees in (0.49, 0.51, 7.0, 90.0):
        normal = np.array([math.sin(math.radians(degrees)), 0, math.cos(math.radians(degrees))])
        one = with_ground(report.support, normal=normal)
        tilted.append([slope.slope(one.case), judgement._slope_words(one)])
    return table | {"slopes": tilted}


@records.of(relative=1e-5)
def gravity_of_all_directions():
    table = {}
    for name, gravity in (("none", (0, 0, 0)), ("up", (0.1, 0.2, 9.0)), ("aslant", (0.9, -0.4, -9.6))):
        robot = quietly(tw.load)(TRIPOD, tip="mast", gravity=gravity)
        for option, normal in (("", None), (" with a normal", (0, 0, 1)))[: 2 if name == "aslant" else 1]:
            answer = tw.check(robot, at=POSE, feet=FEET, contact_normal=normal)
            table[name + option] = [
                words_of(answer)["reasons"],
                answer.to_dict()["sentences"][0],
                answer.support.ground.normal,
                answer.support.holds,
            ]
    return table


ROVER = """<robot name="rover"><link name="chassis"><inertial><origin xyz="0.03 -0.02 0.05"/><mass value="21"/><inertia ixx="0.5" iyy="0.7" izz="0.9" ixy="0.01" ixz="-0.02" iyz="0.03"/></inertial></link>
{wheels}<link name="arm"><inertial><origin xyz="0.35 0.02 0.04"/><mass value="3.2"/><inertia ixx="0.01" iyy="0.155" izz="0.158" ixy="0" ixz="0.002" iyz="0"/></inertial></link>
<joint name="pan" type="revolute"><parent link="chassis"/><child link="arm"/><origin xyz="0.1 0.03 0.4" rpy="0.05 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="60" velocity="9"/></joint>
<link name="tool"/><joint name="to_tool" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0.7 0 0.1"/></joint></robot>"""
WHEEL = (
    '<link name="{name}"><collision><geometry><cylinder radius="{radius}" length="0.04"/></geometry></collision></link>'
    '<joint name="to_{name}" type="fixed"><parent link="chassis"/><child link="{name}"/><origin xyz="{x} {y} {z}" rpy="1.5707963267948966 0 0"/></joint>'
)


@records.of(relative=1e-4)
def a_rover_on_wheels_and_casters(folder):
    places = {"left": (0.3, 0.25, 0.11), "right": (0.28, -0.26, 0.11), "rear": (-0.33, 0.03, 0.08)}
    wheels = "".join(WHEEL.format(name=name, x=x, y=y, z=r - 0.2, radius=r) for name, (x, y, r) in places.items())
    path = folder / "rover.urdf"
    path.write_text(ROVER.format(wheels=wheels))
    robot = quietly(tw.load)(path)
    t = np.linspace(0, 0.8, 17)
    angle = 0.7 * np.sin(3 * t)[:, None] + 0.2

    def turned(scale):
        return tw.Motion(
            t,
            scale * angle,
            scale * 2.1 * np.cos(3 * t)[:, None],
            -scale * 6.3 * np.sin(3 * t)[:, None],
            robot=robot,
            in_seconds=True,
        )

    answers = {
        "wheels": tw.check(robot, turned(1), wheels=tuple(places), contact_friction=0.4, payload=0.7),
        "casters behind": tw.check(robot, turned(1), wheels=("left", "right"), casters="rear", contact_friction=0.4),
        "friction unknown": tw.check(robot, turned(2.5), wheels=("left", "right"), casters="rear"),
        "casters alone": tw.check(robot, turned(0.6), casters=tuple(places)),
        "casters at rest": tw.check(robot, at={"pan": 0.3}, casters=tuple(places)),
        "casters on a slope": tw.check(robot, at={"pan": 0.3}, casters=tuple(places), contact_normal=(0.05, 0.02, 1)),
        "heavy": tw.check(robot, at={"pan": 0.3}, wheels=tuple(places), payload=25, contact_friction=0.9),
        "wheel and foot": tw.check(robot, turned(1), wheels=("left", "right"), feet=[statics.Contact((0, 0, -0.08), friction=0.5, frame="rear")]),
        "slope": tw.check(robot, turned(1), wheels=tuple(places), contact_normal=(0.2, -0.1, 1), contact_friction=0.4),
        "steeper": tw.check(robot, turned(1), wheels=tuple(places), contact_normal=(0.3, -0.3, 1), contact_friction=0.4),
    }  # fmt: skip
    return {
        name: [words_of(answer), answer.support.friction, answer.support.speed[:4], [c.radius for c in answer.support.contacts], answer.motion.q[0], answer.peaks[-1]]
        for name, answer in answers.items()
    } | {"whole": said(answers["casters behind"])}  # fmt: skip


@records.of(relative=1e-4)
def hands_and_magnets():
    """Contacts with normals of their own, which always carry."""
    robot = tripod()
    feet = [
        statics.Contact((0.05 * x, 0.04 * y, 0), friction=0.5, frame=f"foot{k}")
        for k in range(3)
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    hand = statics.Contact((0.03, 0, 0.1), (-1, 0, 0), friction=0.4, frame="mast")
    push = {"hull": (0, 0, 0, 45.0, 2.0, 0)}
    ceiling = [
        statics.Contact((0.1 * x, 0.1 * y, 0), (0, 0, -1), friction=0.6, pull=p, frame="mast")
        for x, y, p in ((1, 1, 90), (-1, 1, 70), (0, -1, 80))
    ]
    answers = {
        "with a hand": tw.check(robot, at=POSE, feet=[*feet, hand], wrench_on_robot=push),
        "in motion": tw.check(robot, swaying(0.1, rows=9), feet=[*feet, hand]),
        "ceiling": tw.check(robot, at=POSE, feet=ceiling),
        "weak magnets": tw.check(robot, at=POSE, feet=[replace(c, pull=0.5 * c.pull) for c in ceiling]),
    }
    return {
        name: [words_of(answer), answer.support.in_contact.sum(axis=0), answer.support.forces[0], answer.support.holds]
        for name, answer in answers.items()
    }


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path):
    records.compare(name, tmp_path)
