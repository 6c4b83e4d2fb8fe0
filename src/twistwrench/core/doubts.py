"""Table of doubts about logs: test, threshold, rate of false alarms and remedy of each doubt.

The rows are data in ``doubts.toml``, each named by a cause. A test that finds the cause creates a :class:`Doubt` from the row.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from .errors import UnknownNameError
from .text import Argument, spell, spell_out
from .verdict import Reason, Verdict

Level = Literal["refuse", "unsure", "note"]
"""Effect of a doubt on the verdict: LOOK AGAIN, UNSURE, or none."""


@dataclass(frozen=True)
class DoubtKind:
    """One row of the table.

    Attributes
    ----------
    name : str
    stage : int, order of the tests: 1 without a model, 2 discrete, 3 continuous, 4 laws of the joint, 5 remaining doubts
    reads : tuple of str, commands that raise the doubt: ``motion``, ``torques``, ``identify``, ``sensor``, ``calibrate``,
        ``servos``, ``threshold``
    tests : str, tested quantity
    threshold : str, value of the tested quantity from which the doubt is raised
    false_alarms : float, maximum share of clean logs for which the doubt is raised
    sentence, remedy : str, with {placeholders} and arguments. An argument is written ``<assume='drift'>``, or
        ``<inertia=True|with-inertia>`` if the option of the shell has another name; each is spelled as the caller types it
    level : str, ``refuse``, ``unsure``, ``note``, or ``effect``: the change of predicted torques decides between these
    unit : str, unit of the value
    """

    name: str
    stage: int
    reads: tuple[str, ...]
    tests: str
    threshold: str
    false_alarms: float
    sentence: str
    remedy: str = ""
    level: Level | Literal["effect"] = "unsure"
    unit: str = ""


def _rows(file: str) -> dict[str, dict[str, Any]]:
    """Rows of a TOML file of this folder, by name."""
    import tomllib

    path = Path(__file__).with_name(file)
    return tomllib.loads(path.read_text(encoding="utf-8"))


@cache
def undetermined_table() -> Mapping[str, tuple[str, str]]:
    """Sentence and remedy for each quantity that no log determines, by name; the remedy may be empty."""
    rows = _rows("undetermined.toml")
    return {name: (row["sentence"], row.get("remedy", "")) for name, row in rows.items()}


@cache
def doubt_table() -> Mapping[str, DoubtKind]:
    """Rows of the table, by name."""
    table = {}
    for name, row in _rows("doubts.toml").items():
        row["reads"] = tuple(row["reads"])
        table[name] = DoubtKind(name, **row)
    return table


@dataclass(frozen=True)
class Doubt:
    """Doubt about a log.

    Attributes
    ----------
    kind : str, name of its row in the table, such as ``gain``
    sentence : str, evidence with numbers, then the remedy
    joints : tuple of str, names of the affected joints
    level : str, ``refuse`` (LOOK AGAIN), ``unsure`` (UNSURE) or ``note`` (verdict unchanged)
    value : float, optional, estimated value of the cause, in ``unit``
    interval : (float, float), optional, 95 % interval of the value
    unit : str
    statistic : float, optional, S = Σ log(σ² without the cause / σ² with it) over the joints
    share : float, optional, share of the squared residual that the cause explains, at the joint where it explains most
    effect : float, optional, largest change of predicted torques in another motion, as a share of a joint's RMS torque
    remedy : str, the part of the sentence that says what to do; empty without a remedy

    Examples
    --------
    >>> from dataclasses import asdict
    >>> found = doubt("left-out", path="log.csv", reason="it is empty")
    >>> str(found), found.to_dict()["stage"], Doubt.from_saved(asdict(found)) == found
    ('log.csv is left out: it is empty', 1, True)
    """

    kind: str
    sentence: str
    joints: tuple[str, ...] = ()
    level: Level = "unsure"
    value: float | None = None
    interval: tuple[float, float] | None = None
    unit: str = ""
    statistic: float | None = None
    share: float | None = None
    effect: float | None = None
    remedy: str = ""

    def __str__(self) -> str:
        return self.sentence

    @property
    def refuses(self) -> bool:
        """True if the results are not trustworthy while the doubt stands."""
        return self.level == "refuse"

    @classmethod
    def from_saved(cls, saved: Mapping[str, Any]) -> Doubt:
        """Doubt from fields saved as JSON.

        Parameters
        ----------
        saved : mapping, as returned by ``dataclasses.asdict``

        Returns
        -------
        doubt : Doubt
        """
        fields = dict(saved)
        fields["joints"] = tuple(saved["joints"])  # JSON has lists only
        if saved["interval"] is not None:
            fields["interval"] = tuple(saved["interval"])
        return cls(**fields)

    def to_dict(self) -> dict[str, Any]:
        """Dictionary of the doubt's fields and of the fields of its row.

        Returns
        -------
        fields : dict, compatible with ``json.dumps``
        """
        row = asdict(doubt_table()[self.kind])
        fields = asdict(self) | {"refuses": self.refuses, "joints": list(self.joints)}
        fields_of_row = {name: row[name] for name in ("stage", "tests", "threshold", "false_alarms")}
        return fields | fields_of_row


def doubt(
    kind: str,
    joints: Sequence[str] = (),
    *,
    named: str | None = None,
    level: Level | None = None,
    log: str = "",
    found: Mapping[str, Any] | None = None,
    **words: object,
) -> Doubt:
    """Doubt of the row ``kind``. ``words`` fill the placeholders of its sentence and remedy.

    - ``named``: text in place of the names of the joints in the sentence
    - ``level``: level in place of the row's level
    - ``log``: name of a file with which the sentence begins; empty for none
    - ``found``: other fields of :class:`Doubt`

    An :class:`.Argument` among the words is spelled as the caller types it.
    """
    row = doubt_table().get(kind)
    if row is None:
        raise UnknownNameError.from_choices("doubt", kind, doubt_table())
    joints_text = ", ".join(joints) if named is None else named
    placeholder_values: dict[str, object] = {"joints": joints_text}
    for name, word in words.items():
        placeholder_values[name] = spell(word) if isinstance(word, Argument) else word
    evidence = spell_out(row.sentence).format(**placeholder_values)
    remedy = spell_out(row.remedy).format(**placeholder_values)
    sentence = f"{evidence} {remedy}".strip()
    if log:
        sentence = f"{log}: {sentence}"
    if level is None and row.level != "effect":
        level = row.level
    elif level is None:
        level = "unsure"  # until the change of predicted torques is known
    return Doubt(kind, sentence, tuple(joints), level, remedy=remedy, **(found or {}))


def verdict_from_doubts(doubts: Iterable[Doubt]) -> Verdict:
    """Verdict for these doubts, by their most serious level: LOOK AGAIN, UNSURE, or OK if there are only notes."""
    reasons_by_level: dict[Level, list[str]] = {"refuse": [], "unsure": [], "note": []}
    for each_doubt in doubts:
        reasons_by_level[each_doubt.level].append(Reason(each_doubt.sentence, each_doubt.remedy))
    return Verdict.from_reasons(look_again=reasons_by_level["refuse"], unsure=reasons_by_level["unsure"])
