"""Calibration of simulated arms: error before and after, coverage, planned readings, faults of readings, clean readings.

Lengths are off by 1 mm and angles by 2 mrad (standard deviations), readings by 0.05 mm and 0.2 mrad:
python -m bench.calibration. With IRB120_MEASUREMENTS, the published measurements of a real arm, too (tests/support/irb120.py).
"""

from __future__ import annotations

import json
import sys
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

import twistwrench as tw
from twistwrench.calibration import Measurements
from twistwrench.calibration.fit import CalibrationProblem
from twistwrench.calibration.groups import ParameterGroups, fitted_in_groups

ROOT = Path(__file__).resolve().parent.parent
KEPT = Path(__file__).with_name("calibration.json")
sys.path.insert(0, str(ROOT / "tests" / "support"))
import irb120  # noqa: E402
from calibration_faults import HARMLESS, TUNED, UNTUNED  # noqa: E402
from calibration_worlds import ANGLE, NOISE, World, planar, rail, scara  # noqa: E402

ARMS = {
    "UR5": (tw.robots.ur5, None),
    "Panda": (tw.robots.panda, "panda_link8"),
    "SCARA": (scara, None),
    "rail + 3R": (rail, None),
    "6R": (lambda: planar(6), None),
}
CASES = (
    ("UR5", "position", 30), ("UR5", "position", 60), ("Panda", "pose", 30), ("SCARA", "position", 20), ("SCARA", "pose", 20),
    ("rail + 3R", "position", 20), ("UR5", "pair", 120), ("UR5", "distance", 60),
)  # fmt: skip
WORLDS, COVERED, DRAWS, CLEAN = 7, 67, 5, 5
READINGS = {"position": 40, "pose": 40, "distance": 100, "pair": 160}
FAULTY = 313
"""Number of the world whose readings get faults."""


def calibrated(name: str, kind: str, count: int) -> dict[str, Any]:
    """Median errors [mm] over worlds: by the file, true afterwards, predicted, held out; and how many are OK."""
    make, tip = ARMS[name]
    rows, fine = [], 0
    for seed in range(WORLDS):
        world = World.drawn(make(), seed, tip=tip)
        found = tw.calibration.calibrate(world.robot, world.measured(kind, count), tip=tip)
        rows.append([found.before, world.error(found), found.remaining.rms, found.held_out.rms])
        fine += found.verdict.ok
    names = ("before", "after", "predicted", "held out")
    return {**_millimetres(names, np.median(rows, axis=0)), "OK": f"{fine} of {WORLDS}"}


def coverage(name: str, kind: str, count: int) -> dict[str, str]:
    """Number of 95 % intervals of groups, and of zeros among them, that hold the truth."""
    make, tip = ARMS[name]
    robot, inside = make(), dict[str, list[bool]](groups=[], zeros=[])
    for seed in range(COVERED):
        world = World.drawn(robot, 5000 + seed, tip=tip)
        fit = fitted_in_groups(CalibrationProblem(world.chain, (world.measured(kind, count),)).fitted())
        true = dict(zip(world.chain.parameters, world.chain.values(world.truth), strict=True))
        for group in ParameterGroups(fit).all:
            value = sum(factor * true.get(name, 0.0) for name, factor in group.terms.items())
            inside["groups"].append(abs(group.value - value) <= group.half_width())
            inside["zeros"] += inside["groups"][-1:] if group.name.endswith(".zero") else []
    return {word: f"{sum(holds)} of {len(holds)}" for word, holds in inside.items()}


def planned(count: int) -> dict[str, Any]:
    """True error [mm] of a UR5 after chosen and after random positions: median and largest over draws."""
    robot, errors = tw.robots.ur5(), {"chosen": list[float](), "random": list[float]()}
    for seed in range(DRAWS):
        plan = tw.calibration.measuring_poses(robot, count, noise=(NOISE, ANGLE), clear=False, seed=seed)
        for how, q in (("chosen", plan.q), ("random", robot.random_configuration(100 + seed, count))):
            world = World.drawn(robot, 200 + seed)
            found = tw.calibration.calibrate(robot, world.readings("position", q), noise=(NOISE, ANGLE))
            errors[how].append(world.error(found))
    return {how: _millimetres(("median", "largest"), (np.median(x), max(x))) for how, x in errors.items()}


def clean(kind: str) -> str:
    """Number of sets without a fault that lead to a doubt, over all arms."""
    doubted, sets = 0, 0
    for make, tip in ARMS.values():
        for seed in range(CLEAN):
            world = World.drawn(make(), 700 + seed, tip=tip)
            found = tw.calibration.calibrate(world.robot, world.measured(kind, READINGS[kind]), tip=tip)
            doubted += any(doubt.level != "note" for doubt in found.doubts)
            sets += 1
    return f"{doubted} of {sets}"


def faults(name: str, kind: str) -> dict[str, str]:
    """Readings with faults: first doubts; an OK is false if the tip's true error is more than twice the predicted one."""
    make, tip = ARMS[name]

    def first_and_word(world: World, m: Measurements) -> tuple[str, str, bool]:
        found = tw.calibration.calibrate(world.robot, m, tip=tip)
        first = found.doubts[0].kind if found.doubts else ""
        return first, str(found.verdict.word), found.verdict.ok and world.error(found) > 2.0 * found.remaining.rms

    worlds = [World.drawn(make(), FAULTY, tip=tip) for _ in range(3)]
    clean = [world.measured(kind, READINGS[kind]) for world in worlds]
    named = [
        first_and_word(worlds[0], fault(worlds[0], clean[0]))[0] == f"calibration-{doubt}"
        for doubt, fault in TUNED.values()
    ]
    others = [first_and_word(worlds[1], fault(worlds[1], clean[1])) for fault in UNTUNED.values()]
    harmless = [first_and_word(*change(worlds[2], clean[2])) for change in HARMLESS.values()]
    return {
        "tuned, named first": f"{sum(named)} of {len(named)}",
        "untuned, not OK": f"{sum(word != 'OK' for _, word, _ in others)} of {len(others)}",
        "harmless, OK": f"{sum(word == 'OK' for _, word, _ in harmless)} of {len(harmless)}",
        "false OK": f"{sum(is_false for *_, is_false in (*others, *harmless))} of {len(others) + len(harmless)}",
    }


def _millimetres(names: tuple[str, ...], values: Any) -> dict[str, float]:
    return {name: float(f"{1e3 * value:.3g}") for name, value in zip(names, values, strict=True)}


def real() -> dict[str, Any]:
    """Errors [mm] of an ABB IRB 120: by the data sheet, held out, and at 10 and 30 separate positions."""
    robot, measured, found = irb120.irb120(), irb120.poses(), dict[str, Any]()
    for assume in ((), ("gears",), ("sag",)):
        one = tw.calibration.calibrate(robot, measured, assume=assume)
        separate = [
            tw.calibration.calibrate(robot, measured, assume=assume, test=test).held_out.rms
            for test in irb120.separate_positions()
        ]
        names = ("before", "held out", "10 separate", "30 separate")
        found[" ".join(assume) or "geometry"] = {
            **_millimetres(names, [one.before, one.held_out.rms, *separate]),
            "first line": one.headline,
        }
    return found


if __name__ == "__main__":
    before = json.loads(KEPT.read_text("utf-8")) if KEPT.exists() else {}
    kept = {
        "date": date.today().isoformat(),
        "errors [mm]": {
            f"{name}, {count} of kind {kind}": calibrated(name, kind, count) for name, kind, count in CASES
        },
        "coverage": {
            f"{name}, {count} of kind {kind}": coverage(name, kind, count)
            for name, kind, count in (("UR5", "position", 30), ("SCARA", "pose", 24), ("rail + 3R", "position", 24))
        },
        "planned [mm]": {str(count): planned(count) for count in (12, 20, 30)},
        "clean sets with a doubt": {kind: clean(kind) for kind in READINGS},
        "faults": {
            f"{name}, {kind}": faults(name, kind) for name in ("UR5", "6R", "Panda") for kind in ("position", "pose")
        },
        "IRB 120 [mm]": before.get("IRB 120 [mm]", {}) if irb120.folder() is None else real(),
    }
    KEPT.write_text(json.dumps(kept, indent=1) + "\n", "utf-8")
    print(KEPT.read_text("utf-8"))
