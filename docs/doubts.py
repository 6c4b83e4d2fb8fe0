"""Write docs/unsure.md from the table of doubts and the sentences of the verdict: `python docs/doubts.py`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from twistwrench.core.answers.sentences import SENTENCES
from twistwrench.core.doubts import DoubtKind, doubt_table
from twistwrench.core.text import spell_out, words_of_the_shell
from twistwrench.motion.load_case import limits_remedy

PAGE = Path(__file__).with_name("unsure.md")
_SOURCES = PAGE.parent.parent / "src" / "twistwrench"
_HEAD = """# My verdict is UNSURE or LOOK AGAIN

`UNSURE` means that the data cannot decide; it is not a yes. `LOOK AGAIN` means that the input contradicts itself, so no
figure can be trusted. The sentence after the word is the reason. Search this page for words of your sentence; …
stands for names and numbers.

[Verdicts and exit codes](verdicts.md) explains all words, and [what no robot does](plausibility.md) from which
size a log is doubted. `python docs/doubts.py` writes this page from the program's own sentences.
"""
_LIMITS = """
## Limits, noise and the robot file

Reasons of `torques`, `payload`, `move` and `size`.

"""
_NOISE = """
## Noise of the log

The torques of a motion depend on accelerations, which logs rarely have. Noise dominates derived ones quickly: a spline
through a 1 ms log with five decimals has an error of 30 rad/s². [`torques`](torques.md#derived-velocities-and-noise)
estimates the white noise of each column, its quantisation, and the error of the time stamps, which grows with speed. If
these change a torque by more than 0.1 % of its peak, the log is smoothed with a third of the strength that is optimal for
positions.

* If the bias of the largest of many noisy values exceeds 0.1 % of the peak, it is listed as `noise` among the causes,
  which then add up to the peak. The correction never exceeds the noise of the derived accelerations.
* `± 1σ` is estimated by simulation: logs of the smoothed motion are drawn with the estimated errors, and each is
  processed like the log. At both ends of a log, where derived accelerations are less accurate, it is multiplied by five.
* In the plot the light band holds 95 % of single torques with respect to their noise, and the bar is the 95 % interval of
  the peak.
* A torque limit counts as exceeded if the peak exceeds it by more than its σ times a factor that accounts for the choice
  of the worst joint (2.0 for one joint, 2.7 for seven). If the interval reaches half the limit and half of it is more
  than half of the peak, the verdict is `UNSURE`.
* Samples more than 6 σ off the smooth curve make the verdict `UNSURE` if the torque that they would need could exceed a
  limit, or if the joint has none.
* A row with a wrong time stamp is dropped: all joints leave their paths there in proportion to their speeds. Rounded time
  stamps, which several rows share, are replaced by a steady clock. A note reports both.

The table has the share of intervals peak ± 1.96 σ that contained the true peak, with their number in brackets, for
synthetic logs of 3 s that begin and end at rest. White: noise of 1e-4 rad. Encoder: steps of 2π/8192. Stamps: time stamps
with an error of 0.3 ms. All: all three, with half the noise and stamps with an error of 0.2 ms.

"""
_HELD = """
All together they held {held} of {peaks} peaks, and the misses had a root mean square of {low} to {high} σ
([bench/intervals.json](../bench/intervals.json)). Other errors are not part of the estimate, such as a filter in the
logger that delays or flattens, or a sensor with a wrong scale.
"""
_LOG = """
## The log

`torques` and `identify` check every motion before any physics. In Python, `tw.Motion(...).doubts` lists all doubts,
each with `kind`, `joints`, `sentence`, `level` and, if there is one, `value` and `unit`; `.contradictions` are those
that lead to `LOOK AGAIN`. A unit in the name of a column, such as `time [s]`, takes precedence. Values that are
unusual but possible lead to a question below the verdict, `IS THE UNIT RIGHT?`

"""
_STEPS = """
`buffered` and `pause` are found by steps. With the mean speed $v_j$ on both sides of a step, the unexplained part of
the step of joint j is

$$e_j = q_j(t + h) - q_j(t) - h v_j .$$

If positions begin to be late by $s$, $e_j = -s v_j$ in all joints. A step counts if $e_j$ exceeds 3 usual steps of
the joint and 8 standard deviations, in two joints at once. None of these doubts was raised for 400 clean logs of ten
robots.
"""
_CAUSES = """
## Causes in measured torques

If the log has torques of all joints, `identify` and `torques` [search for causes](identification-method.md#doubts).
A cause is raised if S ≥ 0.25 and t at 0.01 over the number of causes; further conditions stand in the last column. The
verdict depends on how much a cause changes the torques of another motion. `identify` begins with `LOOK AGAIN` above
5 %, with `UNSURE` above 1 %. `torques` is `UNSURE` above 5 %.

"""
_FIT = """
## The fit of identify

"""
_SENSOR = """
## Force-torque sensors

Reasons of [`sensor`](sensor.md).

"""
_CALIBRATE = """
## Calibration

Reasons of [`calibrate`](calibration.md).

"""
_SERVOS = """
## Servos

Reasons of [`identify_servos`](identification.md#logs-without-torques).

"""
_THRESHOLD = """
## Thresholds of the residual

Reasons of [`observer.threshold`](control.md#thresholds-for-collision-detection).

"""
_ROOMS = ("sensor", "calibrate", "servos", "threshold")
"""Answers whose rows have a section of their own."""
_SEARCHED = "S >= 0.25 and t at 0.01 over the number of causes"
_LEVELS = {"refuse": "LOOK AGAIN", "unsure": "UNSURE", "note": "note", "effect": "by effect"}
_OTHER = (
    ("…: the arm's own weight takes at most … of …, and 25 to 83 % in real arms",
     "The efforts of the robot file, or of the table, are probably not limits of the motors.",
     "[Give limits](limits.md) from the data sheet, with their unit in the header: `effort [N m]`."),
    ("noise is too large a part of the peak: …",
     "Half the 95 % interval of a peak exceeds half of it, or noise exceeds half of the raw peak.",
     "Log velocities and accelerations, or record a slower or longer motion."),
    ("noise explains why the … limit of … is passed", "The excess is smaller than the noise of the log.", "As above."),
    ("the robot moves while nothing is logged for … s after t = … s",
     "A pause with motion is longer than 15 % of the log, a peak is beside it, it needs a larger speed or acceleration "
     "than any logged, or a torque is above 80 % of its limit.",
     "Record the log without the pause."),
    ("samples that look like glitches were smoothed away; if the robot moved so, torques there are too low",
     "Positions more than 6 σ off the smooth curve.", "If the robot did not move so, remove these rows."),
    ("… no mass, so … weight is missing from the torques", "Moving links have no `<inertial>`.",
     "Add their masses to the robot file, or as `--payload`."),
    ("the measured torque of … is exactly … in … of the rows, while the torque computed changes: it is cut off there, or its "
     "channel is dead", "A driver limits the current, or nothing is measured.", "Log the torque before it is limited."),
    ("the file's own torque column disagrees with the torques computed: …",
     "`UNSURE` if the measured torque is larger, as by friction that the file lacks; else `LOOK AGAIN`: sign or unit.",
     "[Compare measured torques](torques.md#torques-that-were-measured); [identify](identification.md) the friction."),
    ("… may … (capsules; …)", "Capsules overlap, and coal, which could decide, is not installed.",
     "`pip install -e '.[clearance]'`"),
    ("a mesh is not closed, so it is not known whether one link is inside the other: …",
     "Capsules of the links overlap, their surfaces do not touch, and the mesh of one has holes.", "Close the mesh."),
    ("clearance not known of … of … links, whose shapes are not in the file or could not be read: …",
     "Links without `<collision>` and `<visual>`, or meshes that were not found.",
     "Install the extra `mesh`, or correct the paths of the meshes."),
    ("stall data only", "A catalogue gives the stall torque and no thermal data.",
     "Add `thermal` or `current_continuous` to the [catalogue](sizing.md#the-catalogue)."),
)  # fmt: skip
"""Reasons outside the table of doubts: words, cause and remedy. Each piece of the words occurs in a source file."""


@words_of_the_shell()
def page() -> str:
    """The page, as it has to be."""
    kinds = [k for k in doubt_table().values() if k.level != "note" or "UNSURE" in k.threshold]
    own = {room: [k for k in kinds if k.reads == (room,)] for room in _ROOMS}
    apart = [k for room in _ROOMS for k in own[room]]
    log = [k for k in kinds if "motion" in k.reads or k.reads == ("torques",)]
    causes = [k for k in kinds if k.stage in (2, 3, 4) and k not in apart]
    fit = [k for k in kinds if k not in [*apart, *log, *causes]]
    parts = [_HEAD, _LIMITS, _rows(("text of the report", "cause", "what to do"), [*_own(), *_others()]), *_noise()]
    for text, found in (
        (_LOG, log),
        (_STEPS + _CAUSES, causes),
        (_FIT, fit),
        (_SENSOR, own["sensor"]),
        (_CALIBRATE, own["calibrate"]),
        (_SERVOS, own["servos"]),
        (_THRESHOLD, own["threshold"]),
    ):
        parts += [text, _rows(("text of the report", "verdict", "what to do", "`kind`: test, bound"), map(_row, found))]
    return "".join(parts)


def _own() -> Iterable[tuple[str, ...]]:
    """Rows of the sentences of the verdict on a motion that stand for a doubt."""
    yield (
        _words(SENTENCES["hanging"]),
        "The file fixes the base of a legged robot, and nothing states that something holds it.",
        "`--floating-base`, or `--fixed-base` if it hangs or is bolted; in Python `floating_base=True` or `False`.",
    )
    yield _words(SENTENCES["unlimited"].replace("; {remedy}", "")), "The robot file has no `effort` there.", _template()
    yield (
        _words(SENTENCES["open"]),
        "The noise of the log decides.",
        "Log velocities and accelerations, or more slowly.",
    )
    yield _words(SENTENCES["open follower"]), "The same, for a mimic joint.", "As above."
    yield (
        _words(f"… {SENTENCES['no contact'].removeprefix('{words}, ')}"),
        "The base floats, and nothing carries it.",
        "Give `--wrench-on-robot`; in Python `inverse_dynamics(wrench_on_robot=)`.",
    )


def _noise() -> Iterable[str]:
    """How noise enters a peak, and the shares of intervals that held, as measured."""
    found = json.loads((_SOURCES.parents[1] / "bench" / "intervals.json").read_text("utf-8"))["peaks"]
    kinds = list(next(iter(found["rows"].values())))
    misses = [kind["rms"] for row in found["rows"].values() for kind in row.values()]
    every = found["all"]
    yield _NOISE
    yield _rows(
        ("robot, rate", *kinds),
        (
            (name, *(f"{100 * kind['held']:.0f} % ({kind['peaks']})" for kind in row.values()))
            for name, row in found["rows"].items()
        ),
    )
    yield _HELD.format(
        held=f"{100 * every['held']:.0f} %", peaks=every["peaks"], low=f"{min(misses):.2f}", high=f"{max(misses):.2f}"
    )


def _template() -> str:
    remedy = limits_remedy()
    return f"{remedy[0].upper()}{remedy[1:]}; see [limits](limits.md)."


def _others() -> Iterable[tuple[str, ...]]:
    for words, cause, remedy in _OTHER:
        lacking = [piece for piece in words.split("…") if len(piece) > 9 and not _occurs(piece)]
        assert not lacking, f"no source has {lacking}"
        yield _words(words), cause, remedy


def _occurs(piece: str) -> bool:
    return re.sub(r"\s+", " ", piece).strip(" ;:,.(") in _source()


@cache
def _source() -> str:
    """Text of the modules that word verdicts, their string literals joined."""
    files = sorted((_SOURCES / "reports").glob("*.py")) + sorted((_SOURCES / "sizing").glob("*.py"))
    motion = [_SOURCES / "motion" / name for name in ("credible_values.py", "model_doubts.py")]
    others = *motion, _SOURCES / "statics" / "clearance.py"
    text = " ".join(f.read_text("utf-8") for f in (*files, *others))
    return re.sub(r"\s+", " ", re.sub(r'"\s*f?"', "", re.sub(r"\{[^{}]*\}", "…", text)))


def _row(kind: DoubtKind) -> tuple[str, ...]:
    words = kind.tests if set(kind.sentence) <= set("{said}") else kind.sentence.replace("{interval}", "")
    bound = kind.threshold.removeprefix(_SEARCHED).lstrip("; ")
    test = "" if kind.reads[0] in _ROOMS and len(kind.reads) == 1 else f": {kind.tests}{f'; {bound}' if bound else ''}"
    return _words(words), _LEVELS[kind.level], _words(kind.remedy) or "–", _words(f"`{kind.name}`{test}")


def _words(text: str) -> str:
    """A sentence with … for its names and numbers, as Markdown."""
    shown = re.sub(r"\{\w+\}", "…", spell_out(text)).strip().rstrip(":")
    return (
        re.sub(r"…+", "…", shown.replace("[…]", "[unit]")).replace("<", "&lt;").replace("_0", "₀").replace("*", r"\*")
    )


def _rows(heads: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [" | ".join(cell.replace("|", r"\|") for cell in row) for row in (heads, ("---",) * len(heads), *rows)]
    return "".join(f"| {line} |\n" for line in lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
