"""Commands: their options, what these pass on to the functions, and their refusals, on record."""

from __future__ import annotations

import importlib
import inspect
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from recorded_answers import Records, plain_values

import twistwrench as tw
from twistwrench.cli import export, hints, identify, parameters, shared, torques

from .test_statics import ARM, Q

pytest_plugins = ("numpy_fixtures",)
pytestmark = pytest.mark.usefixtures("on_numpy")
records = Records(__file__)
main = importlib.import_module("twistwrench.cli.main")  # beside a function of this name
calibration = importlib.import_module("twistwrench.cli.calibration.calibrate")

COMMANDS = [name for name in main._COMMANDS if name != "mcp"]


def command(name):
    group, _, sub = name.partition(" ")
    found = main.main.get_command(click.Context(main.main), group)
    return found.commands[sub] if sub else found


ALL = [*(name for name in COMMANDS if name != "sensor"), "sensor identify", "sensor compensate", "sensor poses"]


# ── Declarations


def declared(parameter):
    """Names, type, default and form of an option or an argument in one line."""
    is_option = isinstance(parameter, click.Option)
    is_flag = is_option and parameter.is_flag  # whose defaults are spelt otherwise by versions of Click
    entries = [
        " ".join(parameter.opts), parameter.name, parameter.type.name, parameter.metavar, None if is_flag else parameter.default,
        parameter.nargs, parameter.multiple if is_option else None, parameter.required, is_flag,
        getattr(parameter.type, "choices", None), parameter.is_eager, getattr(parameter, "hidden", None),
    ]  # fmt: skip
    words = [str(entry) if isinstance(entry, str | int | float | bool | tuple | list) else "-" for entry in entries]
    return " | ".join(words)


@records.of
def options_of_commands():
    return {name: [declared(p) for p in command(name).params] for name in ALL if name != "help"}


@records.of
def help_of_commands():
    def text(*words):
        return CliRunner().invoke(main.main, list(words)).output.splitlines()

    headings = {
        name: [line for line in text(*name.split(), "--help") if line.endswith(":") or "more options" in line]
        for name in ALL
    }
    return headings | {
        "all": text("--help"), "torques": text("torques", "--help"), "sensor": text("sensor", "--help"), "robot": text("help", "robot"),
        "no topic": text("help"), "all options": text("move", "--help-all"), "verdicts": text("help", "verdicts")[:12],
        "columns": text("help", "columns")[:8],
    }  # fmt: skip


@records.of
def parameters_from_signatures():
    docs = [tw.check, tw.payload, tw.move, tw.identify]
    described = parameters._descriptions(
        "Sum.\n\nParameters\n----------\na, b : float, optional, first words\nc : int, or so, more words.\nd : str\n"
        "    Lines of :func:`~x.y` and\n    :class:`z <w>`.\ne : bool\n\nReturns\n-------\nx : int, no\n"
    )
    return {f.__name__: [[p.name, p.annotation, p.flag, p.text] for p in parameters.parameters_of(f).values()][:6] for f in docs} | {
        "described": described,
        "none": parameters._descriptions("Sum."),
        "flags": parameters._with_flags("With ``a_b`` and ``c``.", {"a_b": 1}),
        "typed": [parameters._without_type(t) for t in ("float, optional, words, more", "int, words", "str")],
        "printed": [parameters._printed(x) for x in ((1, 2), 0.5, "a")],
        "short": [main._short_help(*x) for x in (
            ("--csv OUT.csv", "Write the table; '-' prints it."), ("--wrench-on-robot FRAME:m,m,m,f,f,f", "Constant wrench. More."),
            ("--long-option-name [ARG:=VALUE]", "Words " * 12), ("--a", "Text with a default. [default: 5]"), ("--b N", "Ends  [default: 5]"),
        )],
    }  # fmt: skip


# ── Values of options


def tried(call):
    try:
        return call()
    except (tw.TwistWrenchError, click.UsageError) as error:
        return f"{type(error).__name__}: {error}"


@records.of
def values_of_texts():
    kinds = parameters._KINDS
    cases = {
        "Vector": ["1,2,3", "1,2", "a,b,c", " 0.1, -2e-3 ,3"], "Names": ["a, b,,c", ""], "FrameOrTrue": ["", "tool"],
        "FrictionGiven": [("0.7",), ("a=0.5", "b=0.6"), ("a=0.5,b=0.6",), ("x",), ("a=x",), ("a=0.5,0.6",)],
        "InContactGiven": [("auto",), ("a=c1,b=c2",), ("a=c1", "b=c2,3"), ("a", "b")],
        "Mapping[str, ArrayLike]": [("a=0.02,b=1", "c=-3"), ("a",), ("a=x",), ("a=1,2",)],
        "Mapping[str, str | float | bool] | bool": [("",), ("a:=1", " b:=x:=y "), ("a=1",), (":=2",)],
        "WrenchesGiven": [("tool:1,2,3,4,5,6",), ("tool:1,2,3",), ("1,2,3,4,5,6",)], "FeetGiven": [(), ("a", "0.2x0.1@b")],
    }  # fmt: skip
    return {name: [tried(lambda k=kinds[name], t=text: k.parse(t, "--flag")) for text in texts] for name, texts in cases.items()} | {
        "friction laws": [identify.parse_friction(t) for t in ("viscous, offset", "none", " none ", "coulomb")],
        "auto": [tried(lambda t=t: identify._number_or_auto(t, "--cutoff")) for t in ("auto", "2.5", "x")],
        "known": [
            tried(lambda t=t: identify.parse_known([t]))
            for t in ("link_3.mass=0.73 kg", "link_3.m=0.73 g", "j.viscous=1.2", "a.b.m=2", "m=2", "a.x=2", "a.m=x", "a.m", "a.m=2 kg", "a=b.m=1")
        ],
        "noise": [tried(lambda t=t: calibration._parse_noise(t, "--noise")) for t in ("1mm", "0.5mm,0.1deg", "2mrad", "0.001", "-1mm", "0mm", "1mm,1deg,1m", "1 km", "x")],
        "accuracy": [tried(lambda t=t: calibration._parse_accuracy(t, "--accuracy")) for t in ("1mm,2mrad", "1mm", "0.002m,0.1°")],
        "quantity": [
            tried(lambda t=t: export._quantity(t))
            for t in ("mass_matrix", "jacobian:frame=tool0,kind=space", "x:rows=vx+vy,by=a", " y :wrenches=a+b,parameters=m", "z:frame", "u:")
        ],
        "columns": [
            tried(lambda t=t, n=n: shared.parse_columns(t, n))
            for t, n in (
                (["elbow=pos3,time=Time [ms]"], []), (["pos1,pos2, pos3"], []), (["pos1"], []), ([""], []), (['a="x, y"', "b=2"], []),
                (["a=1", "a=2"], []), (["a=1", "a=1"], []), (["b.csv:a=1", "c.csv:a=2"], ["x/b.csv", "c.csv"]), (["d.csv:a=1"], ["x/b.csv"]), (["=x"], []),
                (["a="], []), (["a=1,b"], []), (["@none.csv"], []), (["1=q1"], []), (['"a,b",c'], []),
            )
        ],
        "seconds": [tried(lambda t=t: hints.Seconds().convert(t, None, None)) for t in ("5", "5s", "500 ms", "2 min", "1 h", "x", "-3")],
        "payloads": [tried(lambda t=t: shared.load and parameters.payloads_of(t, "tool")) for t in (["2"], ["2,0.1,0.2,0.3"], ["2@hand"], ["1.5,1,2,3@hand", "3"], ["x"], ["2,1"])],
    }  # fmt: skip


@records.of
def maps_of_columns(folder):
    texts = {
        "fine": "name,column\nelbow,pos3\ntime,stamp\n",
        "capitals": "Name,COLUMN\na,b\n",
        "header": "joint,column\na,b\n",
        "empty": "name,column\n",
    }
    found = {}
    for name, text in texts.items():
        path = folder / f"{name}.csv"
        path.write_text(text)
        found[name] = tried(lambda path=path: shared.parse_columns([f"@{path}", "more=1"], []))
    return found


# ── What the options pass on


@cache
def _stacker(folder):
    path = Path(folder) / "stacker.urdf"
    path.write_text(ARM)
    return str(path)


def files(folder):
    """Files that commands read, by name."""
    t = np.linspace(0, 1, 12)[:, None]
    q = Q + 0.1 * t * np.arange(1, 7)
    names = ("turn", "raise", "shoulder", "elbow", "bend", "wave")
    rows = [",".join(f"{x:.6f}" for x in (tt, *row)) for tt, row in zip(t[:, 0], q, strict=True)]
    texts = {
        "motion.csv": "\n".join(["time," + ",".join(names), *rows]), "other.csv": "\n".join(["time," + ",".join(names), *rows]),
        "limits.csv": "joint,effort\nturn,50\n", "drives.yaml": "actuators:\n  turn: {ratio: 60, friction: {viscous: 0.2 N m s/rad}}\n",
        "bolts.csv": "x,y\n0.1,0\n-0.1,0.1\n0,-0.1\n", "log.csv": "mx,my,mz,fx,fy,fz,gx,gy,gz\n0,0,0,1,2,3,0,0,-1\n",
        "pairs.srdf": '<robot name="stacker"/>', "readings.csv": "turn\n1\n", "calibration.conf": "x",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).write_text(text + "\n")
    return {name: str(folder / name) for name in texts} | {"robot": _stacker(str(folder))}


def described(value):
    """Value as JSON has it; robots and logs by their names."""
    if isinstance(value, tw.Robot):
        return f"robot {value.name}, {value.nv} velocities, tip {value.tip}, {value.model.moving_mass:.9g} kg, {sorted(value.actuators)}"
    if isinstance(value, dict):
        return {str(k): described(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [described(v) for v in value]
    if isinstance(value, Path):
        return f"file {value.name}"
    if callable(value) or type(value).__name__ in ("MotionLog", "MotionFile", "DrawnMotion", "Scene"):
        return type(value).__name__
    try:
        return plain_values(value)
    except TypeError:
        return type(value).__name__


def passed_on(words, *targets):
    """Arguments of the first call of one of the targets, and what the command printed before."""
    calls = []
    for name in ALL:
        command(name)  # before their functions are replaced, whose signatures they read

    def recorder(name, signature):
        def record(*args, **kwargs):
            bound = signature.bind(*args, **kwargs)
            calls.append({"function": name, **{k: described(v) for k, v in bound.arguments.items()}})
            raise tw.ValueRangeError("recorded")

        return record

    with ExitStack() as stack:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        for target in targets:
            place, _, name = target.rpartition(".")
            owner = importlib.import_module(f"twistwrench.{place}") if place != "Robot" else tw.Robot
            patch.setattr(owner, name, recorder(name, inspect.signature(getattr(owner, name))))
        result = CliRunner().invoke(main.main, [str(w) for w in words])
    return [*calls, result.exit_code, result.output.strip().splitlines()[-3:]]


MANY = {
    "check": "cli.torques.check", "size": "cli.size.size_drives", "simulate": "Robot.simulate", "log": "cli.log.check_log", "derive": "cli.derive.derive",
    "identify": "cli.identify.identify", "servos": "cli.identify.identify_servos", "excite": "cli.identify.excite", "info": "cli.info.info",
    "doctor": "cli.doctor.doctor", "verify": "cli.doctor.verify", "convert": "cli.export.save", "join": "cli.export.join",
    "c": "robot.export.c99.export_c", "st": "robot.export.structured_text.export_st", "ros2": "robot.export.ros2.export_ros2",
    "calibrate": "cli.calibration.calibrate.calibrate", "plan": "cli.calibration.calibrate.measuring_poses",
    "sensor identify": "cli.sensor.identify", "sensor compensate": "cli.sensor.compensate", "sensor poses": "cli.sensor.propose_poses",
    "page": "cli.view.write_page", "film": "cli.view.film", "article": "cli.view.write_article", "many": "cli.torques.checked_motions",
    "robots": "robots.known",
}  # fmt: skip


def calls(f, folder):
    r, m = f["robot"], f["motion.csv"]
    load = ["--payload", "2.5,0.1,-0.2,0.3@finger", "--payload", "1.5", "--tip", "tool"]
    return {
        "torques": ("check", ["torques", r, m]),
        "torques, all": ("check", ["torques", r, m, *load, "--wrench-on-robot", "tool:1,2,3,4,5,6", "--no-friction", "--limits", f["limits.csv"], "--smooth",
                                   "--clearance", "0.03", "--srdf", f["pairs.srdf"], "--why", "--degrees"]),
        "torques, clearance": ("check", ["torques", r, m, "--clearance", "--actuators", f["drives.yaml"], "--lock", "wave=0.2"]),
        "torques at rest": ("check", ["torques", r, "--at", "shoulder=0.7", "--at", "raise=0.2", "--fixed-base"]),
        "torques on feet": ("check", ["torques", "quadruped", "--feet", "auto", "--contact-friction", "0.7", "--in-contact", "FL_foot=c1,FR_foot=c2"]),
        "torques of many": ("many", ["torques", r, str(folder / "*.csv"), "--limits", f["limits.csv"], "--workers", "2"]),
        "size": ("size", ["size", "ur5", "demo", "--catalog", "demo", "--pause", "0.8", "--ambient", "40", "--masses-included", "--life", "9000", "--emergency", "demo", "--payload", "2"]),
        "simulate": ("simulate", ["simulate", r]),
        "simulate, all": ("simulate", ["simulate", r, *load, "--at", "shoulder=0.7", "--velocity", "bend=2", "--torque", "turn=3", "--no-friction", "--stop-at-limits",
                                       "--touch", "tool:0,0,0.1", "--touch", "finger", "--touch", "tool:0.1,0,0", "--ground", "-0.4", "--contact", "2e5,0.2,0.6", "--duration", "0.5",
                                       "--step", "2 ms", "--method", "dop853", "--rtol", "1e-7"]),
        "simulate with friction": ("simulate", ["simulate", "ur5", "--actuators", "demo", "--wrench-on-robot", "tool0:1,2,3,4,5,6", "--at", "0.1,0.2,0.3,0.4,0.5,0.6"]),
        "simulate in degrees": ("simulate", ["simulate", r, "--tip", "tool", "--at", "shoulder=40", "--velocity", "bend=90", "--torque", "turn=3", "--degrees", "--ground", "0"]),
        "log": ("log", ["log", m, "--topic", "joint:reference", "--episode", "3"]),
        "derive": ("derive", ["derive", r]),
        "identify": ("identify", ["identify", r, m]),
        "identify, all": ("identify", ["identify", r, m, "--test", f["other.csv"], "--columns", "turn=q1", "--gain", "bend=3.5", "--rate", "100", "--friction-model", "viscous,offset",
                                       "--known", "finger.mass=0.4 kg", "--known", "bend.viscous=0.2", "--cutoff", "8", "--weights", "wls", "--tip", "tool"]),
        "identify, payload": ("identify", ["identify", r, m, "--payload-only", "tool", "--friction-model", "none", "--cutoff", "auto", "--actuators", f["drives.yaml"], "--lock-missing"]),
        "servos": ("servos", ["identify", r, m, "--from-commands", "--command-hold", "zero", "--known", "bend.armature=0.2"]),
        "servos, default": ("servos", ["identify", r, m, "--from-commands", "--test", f["other.csv"]]),
        "excite": ("excite", ["excite", r]),
        "excite, all": ("excite", ["excite", r, "--duration", "20", "--harmonics", "4", "--ignore-self", "--torque-noise", "0.3", "--floor", "-0.2", "--friction-model", "coulomb", "--seed", "3"]),
        "info": ("info", ["info", r, "--tip", "tool"]),
        "doctor": ("doctor", ["doctor", r, "--meshes", str(folder), "--floating-base"]),
        "doctor, plain": ("doctor", ["doctor", r]),
        "verify": ("verify", ["verify", r]),
        "convert": ("convert", ["convert", r, str(folder / "new.xml"), "--strict"]),
        "convert, over": ("convert", ["convert", r, f["pairs.srdf"], "--overwrite"]),
        "join": ("join", ["join", str(folder / "cell.urdf"), r, "planar_2r@tool:hand_"]),
        "join, named": ("join", ["join", str(folder / "cell.urdf"), r, "--name", "pair"]),
        "c": ("c", ["export", r, "--c", str(folder / "a.c"), "--quantity", "mass_matrix", "--quantity", "jacobian:frame=tool", "--payload", "2@tool", "--gravity-input", "--float", "--prefix", "my_", "--no-test-program"]),
        "c, default": ("c", ["export", r, "--c", str(folder / "a.c")]),
        "st": ("st", ["export", r, "--st", str(folder / "a.st"), "--torque-side", "motor", "--style", "codesys", "--float"]),
        "ros2": ("ros2", ["export", r, "--ros2", str(folder / "pack"), "--license", "MIT", "--tip", "tool", "--payload", "2"]),
        "calibrate": ("calibrate", ["calibrate", r, f["readings.csv"], "--tip", "tool", "--noise", "0.5mm,0.1deg", "--keep-outliers", "--test", f["other.csv"]]),
        "calibrate, plan": ("plan", ["calibrate", r, "--plan", "12", "--towards", "1,2,0.5", "--floor", "-0.1", "--tip", "tool", "--noise", "1mm"]),
        "calibrate, more readings": ("plan", ["calibrate", r, f["readings.csv"], "--plan", "5"]),
        "sensor identify": ("sensor identify", ["sensor", "identify", f["log.csv"]]),
        "sensor identify, all": ("sensor identify", ["sensor", "identify", f["log.csv"], "--sign", "by_sensor", "--with-inertia", "--assume", "drift", "--assume", "tilt", "--bias", "1,2,3,4,5,6",
                                                     "--noise", "0.01,0.3", "--keep-outliers", "--gravity", "9.79"]),
        "sensor compensate": ("sensor compensate", ["sensor", "compensate", "demo", "--sensor", "demo", "--contacts", "1e-5", "--gravity", "9.79"]),
        "sensor poses": ("sensor poses", ["sensor", "poses", f["log.csv"], "--within", "60", "--count", "4", "--noise", "0.02,0.4", "--mass", "2.5"]),
        "sensor poses, default": ("sensor poses", ["sensor", "poses"]),
        "page": ("page", ["view", r, "--html", str(folder / "p.html"), *load, "--wrench-on-robot", "tool:1,2,3,4,5,6", "--embed", "--control", "http://localhost:1"]),
        "page, section": ("page", ["view", r, "--html", str(folder / "p.html"), "--section", "8.1.3", "--tip", "tool"]),
        "page, motion": ("page", ["view", r, m, "--html", str(folder / "p.html"), "--no-browser"]),
        "film": ("film", ["view", r, m, "--movie", str(folder / "p.gif"), "--speed", "0.5"]),
        "article": ("article", ["view", "--section", "8.2", "--html", str(folder / "a.html")]),
        "robots": ("robots", ["robots", "panda"]),
    }  # fmt: skip


@records.of(relative=1e-6)
def options_that_are_passed_on(folder):
    f = files(folder)
    return {name: passed_on(words, MANY[target]) for name, (target, words) in calls(f, folder).items()}


def said(words):
    result = CliRunner().invoke(main.main, [str(w) for w in words])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return [type(result.exception).__name__]
    lines = result.stderr.strip().splitlines()
    return [result.exit_code, *lines[-2:]]


@records.of
def refusals_of_commands(folder):
    f = files(folder)
    r, m = f["robot"], f["motion.csv"]
    html, out = str(folder / "p.html"), str(folder / "o.csv")
    lines = [
        "torqus", "ur5", "urdf2mjcf", f"{r}", "torques", "torques ur5 demo --paylod 3", "torques ur5 demo --verbose", f"torques {r} {m} --trajectory {m}", f"torques {r} --rate 100",
        f"torques {r} --lock-missing --plan", f"torques {r} {m} --kind causes", f"torques {r} {m} --joint turn", f"torques {r} {m} --plot {out}.png --joint turn", f"torques {r} {m} --plot causes={out}.png",
        f"torques {r} {m} --plot {out}.png --kind motors", f"torques {r} {m} --workers 2 --why", f"torques {r} {m} --json - --csv -", f"torques {r} {m} --json {m}", f"torques {r} {m} --csv {f['limits.csv']}",
        "torques ur5 demo --degrees", f"torques {r} {m} --clearance x", f"torques {r} {m} --floating-base --fixed-base", f"torques {r} {m} --chain rail",
        f"torques {r} nowhere.csv", "torques nowhere.urdf demo", f"torques {r} {m} --actuators demo", f"size {r} {m} --actuators {f['drives.yaml']} --catalog demo",
        f"view {r} --section 8.1.3", f"view {r} --movie {out}.gif", f"view {r} --embed", f"view {r} --control x", "view --section 8.1.3", "view --section 8.2", "view --section 99 --html a.html", "view",
        f"view --section 8.2 --html {html} --payload 2", f"view {r} --section 8.2 --html {html}", f"view {r} {m} --section 8.1.3 --html {html}", f"view {r} --smooth 0.1", f"view {r} --clearance", f"view {r} --rate 100",
        f"simulate {r} --touch tool", f"simulate {r} --contact 1,2,3", f"simulate {r} --ground 0", f"simulate {r} --tip tool --ground 0 --contact 1,2", f"simulate {r} --ground 0 --touch tool:1,2", f"simulate {r} --step 5x",
        f"identify {r} {m} --add {m}", f"identify {r} {m} --command-hold zero", f"identify {r} {m} --from-commands --cutoff 8", f"identify {r} {m} --payload-only tool --out {out}.urdf", f"identify {r}", f"identify {r} {m} --known a=b",
        f"export {r}", f"export {r} --c {out}.c --style codesys", f"export {r} --ros2 {out} --float", f"export {r} --c {out}.c --quantity a:b", f"convert {r} {f['limits.csv']}", f"convert {r}", f"join {out}",
        f"calibrate {r}", f"calibrate {r} --towards 1,2,3", f"calibrate {r} --floor 1", f"calibrate {r} {m} --from {f['calibration.conf']}", f"calibrate {r} a b --plan 3", f"calibrate {r} --plan 3 --test {m}", f"calibrate {r} --plan 3 --towards 1,2",
        f"sensor identify {f['log.csv']} --degrees", f"sensor identify {f['log.csv']} --frame tool", f"sensor identify {f['log.csv']} --bias 1,2", "sensor identify", f"sensor compensate {f['log.csv']}", "sensor weigh", "log", "log nowhere.csv", f"log {m} --json {m}",
        f"doctor {r} --meshes nowhere", "doctor", "help weather", f"derive {r} --latex - --c -", f"payload {r} --at 1,2", f"payload {r} --samples 3", "move", f"verify {r} --samples x", "--frobnicate",
    ]  # fmt: skip
    return {line.replace(str(folder), "FOLDER"): said(line.split()) for line in lines}


# ── Whole commands


@records.of(relative=1e-5)
def reports_of_commands(folder):
    f = files(folder)
    r, m = f["robot"], f["motion.csv"]

    def run(*words):
        result = CliRunner().invoke(main.main, [str(w) for w in words])
        return [result.exit_code, result.output.strip().splitlines()[:6]]

    page, table = folder / "page.html", folder / "t.csv"
    return {
        "payload": run("payload", r, "--tip", "tool", "--at", "shoulder=-0.6", "--csv", table, "--json", folder / "p.json"), "table": table.read_text().splitlines()[:1],
        "existing": run("payload", r, "--tip", "tool", "--csv", table), "over": run("payload", r, "--tip", "tool", "--csv", table, "--overwrite"),
        "printed": run("payload", r, "--tip", "tool", "--csv", "-")[1][0][:60], "torques": run("torques", r, m, "--tip", "tool", "--report", page), "page": page.exists(),
        "chain": run("torques", r, "--chain", "rail", "fore"), "degrees": run("payload", r, "--tip", "tool", "--at", "shoulder=40", "--degrees"), "log": run("log", m)[0],
        "logs": run("log", m, folder / "none.csv")[0], "info": run("info", r)[1][:3], "robots": run("robots", "planar")[0], "traceback": run("info", "--help")[0],
    }  # fmt: skip


@records.of
def options_of_robots(folder):
    f = files(folder)
    given = {p.name: None for p in command("torques").params} | {
        "source": f["robot"],
        "actuators": f["drives.yaml"],
        "chain": None,
        "lock": (),
        "floating_base": False,
        "not_floating_base": False,
    }

    def made(**changes):
        return shared.RobotOptions(f["robot"], {"tip": "tool"} | changes.pop("loading", {}), **changes)

    def locked(options, **more):
        robot, names = options.load_and_locked(**more)
        return [
            described(robot),
            names,
            robot.forward_kinematics(robot.neutral, "tool")[:3, 3],
            robot.forward_kinematics(robot.neutral, "flag")[:3, 3],
        ]

    return {
        "files": {k: bool(v) for k, v in made(actuators=f["drives.yaml"]).files.items()}, "no files": shared.RobotOptions("ur5", {}, "demo").files,
        "demo": shared.RobotOptions("ur5", {}, "demo").actuator_file.name, "tip": made().tip,
        "plain": locked(made()), "lock": locked(made(loading={"lock": {"wave": 0.2, "elbow": -0.3}})), "lock in degrees": locked(made(loading={"lock": {"wave": 20.0}}, degrees=True)),
        "chain": locked(made(chain=("rail", "fore"))), "chain and lock": locked(made(chain=("plate", "upper"), loading={"lock": {"wave": 0.3}})),
        "actuators": locked(made(actuators=f["drives.yaml"], loading={"lock": {"turn": 0.4}})), "held": locked(made(), held=lambda _: ["wave", "bend"]),
        "log options": [shared.LogOptions("a.csv", rate=3.0, plan=True).given, shared.LogOptions(None).given, shared.LogOptions(None, ("a",), ("b",), None, "t", 2, True).given],
        "gains": [tried(lambda t=t: shared.current_gains(t, made().load().model, None)) for t in (["turn=3.5", "bend=2"], ["turn"], ["turn=x"])],
        "neutral": shared._neutral_positions(made().load()), "motion": [shared.motion_path(shared.RobotOptions("ur5", {}), "demo").name, tried(lambda: shared.motion_path(shared.RobotOptions("ur5", {}, degrees=True), "demo"))],
        "kinds": torques._PLOT_KINDS, "given": sorted(given)[:3],
    }  # fmt: skip


@pytest.mark.parametrize("name", records.names)
def test_answers_are_those_on_record(name, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "110")
    records.compare(name, tmp_path)
