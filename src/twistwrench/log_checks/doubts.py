"""The table of doubts about logs: what each one tests, from which value it is raised, how often by mistake, and the remedy.

The rows are data, in ``doubts.toml``. A statistic that finds a cause makes a :class:`Doubt` of the row with that name.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from ..core.verdict import Verdict
from ..errors import UnknownNameError

Level = Literal["refuse", "unsure", "note"]
"""Effect of a doubt on the first word of a report: LOOK AGAIN, UNSURE, or none."""


@dataclass(frozen=True)
class DoubtKind:
    """One row of the table.

    Attributes
    ----------
    name : str
    stage : int, order of the tests: 1 without a model, 2 discrete, 3 continuous, 4 laws of the joint, 5 what remains
    reads : tuple of str, those that raise it: ``motion``, ``torques``, ``identify``, ``sensor``
    tests : str, what is tested
    threshold : str, from where it is raised
    false_alarms : float, share of clean logs that it is raised for by mistake, at most
    sentence, remedy : str, with {placeholders}
    level : str, ``refuse``, ``unsure``, ``note``, or ``effect``: by how much predicted torques change
    unit : str, of the value
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
    import tomllib

    return tomllib.loads(Path(__file__).with_name(file).read_text(encoding="utf-8"))


@cache
def undetermined_table() -> Mapping[str, tuple[str, str]]:
    """Sentence and remedy of each quantity that no log determines, by name."""
    return {name: (row["sentence"], row.get("remedy", "")) for name, row in _rows("undetermined.toml").items()}


@cache
def doubt_table() -> Mapping[str, DoubtKind]:
    """Rows of the table, by name."""
    return {name: DoubtKind(name, **row | {"reads": tuple(row["reads"])}) for name, row in _rows("doubts.toml").items()}


@dataclass(frozen=True)
class Doubt:
    """Doubt about a log.

    Attributes
    ----------
    kind : str, name of its row in the table, such as ``gain``
    sentence : str, the evidence with its numbers, then the remedy
    joints : tuple of str, those concerned
    level : str, ``refuse`` (LOOK AGAIN), ``unsure`` (UNSURE) or ``note`` (the first word stays)
    value : float, optional, what the cause amounts to, in ``unit``
    interval : (float, float), optional, 95 % interval of the value
    unit : str
    statistic : float, optional, S = Σ log(σ² without the cause / σ² with it) over the joints
    share : float, optional, share of the squared residual that it takes away, of the joint that it takes most from
    effect : float, optional, largest share of a joint's torque (rms) in another motion by which predictions change

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

    def __str__(self) -> str:
        return self.sentence

    @property
    def refuses(self) -> bool:
        """True if no number can be trusted while the doubt stands."""
        return self.level == "refuse"

    @classmethod
    def from_saved(cls, saved: Mapping[str, Any]) -> Doubt:
        """Doubt from fields that were saved as JSON.

        Parameters
        ----------
        saved : mapping, as ``dataclasses.asdict`` makes it

        Returns
        -------
        doubt : Doubt
        """
        interval = saved["interval"]
        return cls(**{**saved, "joints": tuple(saved["joints"]), "interval": interval and tuple(interval)})

    def to_dict(self) -> dict[str, Any]:
        """Dictionary of its fields and those of its row.

        Returns
        -------
        fields : dict, which ``json.dumps`` takes
        """
        row = asdict(doubt_table()[self.kind])
        own = asdict(self) | {"refuses": self.refuses, "joints": list(self.joints)}
        return own | {name: row[name] for name in ("stage", "tests", "threshold", "false_alarms")}


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
    """Doubt of the row ``kind``; ``words`` fill its sentence and remedy, ``found`` its other fields.

    ``level`` replaces that of the row, ``named`` the names of the joints in the sentence, ``log`` names the file.
    """
    row = doubt_table().get(kind)
    if row is None:
        raise UnknownNameError.from_choices("doubt", kind, doubt_table())
    said = " ".join(
        text.format(**{"joints": ", ".join(joints) if named is None else named} | words)
        for text in (row.sentence, row.remedy)
        if text
    )
    return Doubt(
        kind,
        f"{log}: {said}" if log else said,
        tuple(joints),
        level or ("unsure" if row.level == "effect" else row.level),
        **(found or {}),
    )


def verdict_from_doubts(doubts: Iterable[Doubt]) -> Verdict:
    """First word of a report with these doubts: LOOK AGAIN, UNSURE, or OK where there are only notes."""
    by_level: dict[Level, list[str]] = {"refuse": [], "unsure": [], "note": []}
    for each in doubts:
        by_level[each.level].append(each.sentence)
    return Verdict.from_reasons(look_again=by_level["refuse"], unsure=by_level["unsure"])
