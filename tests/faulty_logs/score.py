"""Scores of faulty logs: verdict, doubts in order and their names, coverage of intervals, and torques of another motion."""

from __future__ import annotations

import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

import twistwrench as tw
from twistwrench.cli.main import main
from twistwrench.core.estimation.least_squares import Prior
from twistwrench.identification import identify
from twistwrench.identification.hyperparameters import FitSettings, SettingRows

from .cases import Recording
from .parts import Task, motion_of
from .truth import SECONDS, Array, Series, Truth, generator, load

_STATES = 400
_LENGTH = 200
"""Letters of a sentence that are kept."""
_TITLES = ("Torques [", "What the peak", "The file's own")
CAUSE_OF_KIND = {
    "sign": "torque-sign",
    "exchanged": "exchanged-torques",
    "negative": "negative-inertia",
    "unexplained-joint": "unexplained",
    "partly-unexplained": "unexplained",
    "other-torques": "unexplained",
    "angle-unit": "degrees",
    "degrees-option": "degrees",
    "time-unit": "time-scale",
    "closed-pause": "pause",
    "single-row": "spikes",
}
"""Names of causes, of kinds that have others: those of the program before its table of doubts, and those of reading a log."""
_IN_CONTRADICTIONS = (
    ("degree", "degrees"),
    ("gap", "pause"),
    ("pause", "pause"),
    ("millisecond", "time-scale"),
    ("single row", "spikes"),
    ("one row", "spikes"),
)
"""Words in a contradiction between columns, whose kind does not say the cause."""
NO_CAUSE = ("unexciting", "unexplained", "negative-inertia", "contradiction", "quantised", "left-out")
"""Names that say that something is wrong, not what."""


def name_of(kind: str, sentence: str) -> str:
    """Name of the cause of a doubt, by its kind, and for contradictions between columns by its sentence."""
    if kind == "contradiction":
        return next((name for word, name in _IN_CONTRADICTIONS if word in sentence), kind)
    return CAUSE_OF_KIND.get(kind, kind)


@contextmanager
def settings_chosen_once() -> Iterator[None]:
    """Choose the settings of an identification on all fifths of the time only, not anew for each that is held out.

    A third of the time; 6 logs that were compared had the same verdict and doubts.
    """
    plain, first = SettingRows.choose, dict[int, tuple[SettingRows, FitSettings]]()

    def choose(
        self: SettingRows, prior: Prior, sets: Sequence[Sequence[int]], *progress: Callable[[float], None]
    ) -> list[FitSettings]:
        if id(self) not in first:
            first[id(self)] = self, plain(self, prior, sets[:1], *progress)[0]
        return [first[id(self)][1]] * len(sets)

    SettingRows.choose = choose  # type: ignore[method-assign]
    try:
        yield
    finally:
        SettingRows.choose = plain  # type: ignore[method-assign]


def score(task: Task, *, quick: bool = False) -> dict[str, Any]:
    """What the program says of one log, beside what is true; ``quick``: settings are chosen once."""
    made = task.recording()
    motion = motion_of(made)
    row: dict[str, Any] = {"part": task.part, "robot": task.robot, "case": task.name, "seed": task.seed}
    if made.value:
        row["value"] = made.value
    if quick:
        row["quick"] = True
    with warnings.catch_warnings(), settings_chosen_once() if quick else nullcontext():
        warnings.simplefilter("ignore")
        before = time.process_time()
        try:
            found = identify(made.truth.file, motion)
        except Exception as error:  # a crash is a result as well
            return row | {"verdict": "ERROR", "doubts": [], "error": f"{type(error).__name__}: {error}"[:_LENGTH]}
        row["seconds"] = round(time.process_time() - before, 2)
    if task.part in ("clean", "ordinary"):
        row["torques"] = torques_report(task.robot, made)
    low, high = found.interval().T
    free = ~found.base.held
    truth = made.truth.groups(found.base)
    shares = torques_wrong(task, made.truth, found)
    return row | {
        "verdict": str(found.verdict.word),
        "fitted": [one.kind for one in found.settings.assumed],
        "doubts": [doubt_row(doubt) for doubt in found.doubts],
        "notes": [str(note)[:_LENGTH] for note in found.notes],
        "held out": _rounded(found.held_out.all),
        "covered": int(((low <= truth) & (truth <= high))[free].sum()),
        "groups": int(free.sum()),
        "wrong": _rounded(np.sqrt((shares**2).mean())),
        "worst": _rounded(shares.max()),
    }


def torques_report(robot: str, made: Recording) -> dict[str, Any]:
    """What ``twistwrench torques`` says of the log as a file: the verdict's line, and the remarks below the tables."""
    names = made.truth.file.model.velocity_names
    table = np.column_stack([made.t, made.q, made.tau])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        header = ",".join(["time", *names, *(f"{name}.torque" for name in names)])
        np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.9g")
        before = time.process_time()
        # The true drives are none of the file's, so its friction would truly disagree.
        arguments = ["torques", saved(robot), "--trajectory", str(path), "--no-friction"]
        output = CliRunner().invoke(main, arguments).output
    lines = [line.strip() for line in output.split("\n") if line[:1].strip() and not line.startswith(_TITLES)]
    lines = [line[:_LENGTH] for line in lines if "rows at" not in line]
    return {"seconds": round(time.process_time() - before, 2), "first": lines[0], "also": lines[1:]}


@lru_cache(maxsize=32)
def saved(robot: str) -> str:
    """Path of a file of the robot, with inertias that can be; a URDF has no gravity, so that of another is written as MJCF."""
    found = load(robot)
    usual = np.array_equal(found.model.gravity, [0.0, 0.0, -9.81])
    path = Path(tempfile.mkdtemp()) / (f"{robot}.urdf" if usual else f"{robot}.xml")
    tw.save(found, path)
    return str(path)


def doubt_row(doubt: Any) -> dict[str, Any]:
    """Fields of a doubt."""
    row = {
        "name": name_of(doubt.kind, doubt.sentence),
        "kind": doubt.kind,
        "joints": list(doubt.joints),
        "refuses": bool(doubt.refuses),
        "sentence": doubt.sentence[:_LENGTH],
    }
    for name in ("value", "unit", "interval", "level", "statistic", "share", "effect"):
        value = getattr(doubt, name, None)
        if value is not None:
            row[name] = _plain(value)
    return row


def torques_wrong(task: Task, truth: Truth, found: Any) -> Array:
    """(nv,) errors of the torques of another motion, as shares of each joint's torque (rms)."""
    states = Series.random(truth.file, generator(task.robot, task.seed, "another motion"))(np.linspace(0, 10, _STATES))
    real = truth.torques(*states, SECONDS / 2)
    base = found.base
    W = base.unknown.columns(base.kept, *states, found.settings.friction_speed)
    drives, dry = base.unknown.of_bodies[base.kept] < 0, np.tanh(states[1] / found.settings.friction_speed)
    rigid = W @ np.where(drives, 0.0, found.values)
    load = np.array([found.load_friction.get(name, 0.0) for name in truth.file.model.velocity_names])
    off = ((W @ found.values + load * np.abs(rigid) * dry - real) ** 2).mean(axis=0)
    return np.sqrt(off / np.maximum((real**2).mean(axis=0), 1e-300))


def _rounded(x: Any) -> float:
    return float(f"{float(x):.4g}")


def _plain(x: Any) -> Any:
    """Numbers and text for JSON."""
    if isinstance(x, dict):
        return {str(key): _plain(value) for key, value in x.items()}
    if isinstance(x, (list, tuple, np.ndarray)):
        return [_plain(value) for value in x]
    return _rounded(float(x)) if isinstance(x, (int, float, np.number)) else str(x)
