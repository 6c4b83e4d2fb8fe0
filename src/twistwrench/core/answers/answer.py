"""Base class of all results that answer a question: verdict, text, card of a notebook, pictures, page and data."""

from __future__ import annotations

import html
import json
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TextIO

from ..files import as_path, refuse_existing, replacing
from ..version import __version__

if TYPE_CHECKING:
    from ..verdict import Verdict
    from .blocks import Block
    from .card import Shares
    from .data import DataTable
    from .page import Picture, Setting, Viewer

SCHEMA = 1
"""Version of the dictionary of :meth:`Answer.to_dict`: another number means other keys."""


class Answer:
    """Result of a question: its verdict, and the blocks that every surface shows.

    A subclass defines ``verdict`` and ``blocks``. ``print(answer)`` prints the report of the command, and ``answer.print()``
    prints it with colours. A notebook shows a card. ``to_html`` writes a page, ``to_json`` the data with all digits.

    Examples
    --------
    >>> import twistwrench as tw
    >>> answer = tw.check("ur5", "demo", payload=10)
    >>> answer.verdict.ok, answer
    (False, <TorqueReport of ur5: OVER LIMIT, shoulder_lift_joint 111 %>)
    >>> list(answer.tables), answer.facts()["limit"], list(answer.sources()), answer.shares().values.shape
    (['Torques', 'What the peak is made of'], '150 N m', ['MOTION', 'ROBOT'], (751, 6))
    """

    call: ClassVar[str] = ""
    """Name of the function that returns the answer, and of the command that prints it."""

    @property
    @abstractmethod
    def verdict(self) -> Verdict:
        """Word, reasons and exit code of the answer."""

    @abstractmethod
    def blocks(self) -> Iterable[Block]:
        """Headline, facts, tables and remarks, in the order in which every surface shows them.

        Returns
        -------
        blocks : iterable of Block
        """

    @property
    def subject(self) -> str:
        """Subject of the question: robot, and motion, pose or file."""
        return self.robot_name

    @property
    def robot_name(self) -> str:
        """Name of the robot."""
        return ""

    @property
    def brief(self) -> str:
        """Decisive number of the verdict, in a few words; empty if there is none."""
        return ""

    def facts(self) -> Mapping[str, str]:
        """Decisive numbers of the verdict with their units.

        Returns
        -------
        facts : {name: text}

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.check("ur5", "demo", payload=10).facts()["share of limit"]
        '111 %'
        """
        return {}

    def sources(self) -> Mapping[str, str | Path]:
        """Files of the question.

        Returns
        -------
        files : {argument: path}

        Examples
        --------
        >>> import twistwrench as tw
        >>> list(tw.check("ur5", "demo").sources())
        ['MOTION', 'ROBOT']
        """
        return {}

    def origin(self) -> Iterable[Setting]:
        """Settings of the computation, for the provenance of the page: robot, friction, method, limits.

        Returns
        -------
        entries : iterable of (name, text), and of Table

        Examples
        --------
        >>> import twistwrench as tw
        >>> [getattr(entry, "title", entry) for entry in tw.check("ur5", "demo").origin()][1:]
        ['Limits used', ('torques', 'no friction, as its file gives none')]
        """
        return []

    def shares(self) -> Shares | None:
        """Shares of limits over time, which the card draws; None for answers without a motion and limits.

        Returns
        -------
        shares : Shares, or None

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.check(tw.robots.ur5(), "demo").shares().values.shape, tw.payload(tw.robots.ur5()).shares()
        ((751, 6), None)
        """
        return None

    def pictures(self) -> Iterable[Picture]:
        """Pictures of the page; none if matplotlib is not installed.

        Returns
        -------
        pictures : iterable of Picture

        Examples
        --------
        >>> import twistwrench as tw
        >>> [picture.title for picture in tw.check("ur5", "demo").pictures()]  # doctest: +SKIP
        ['Torques and limits', 'ur5 at t = 1.808 s; green: shoulder_lift_joint, 52 % of its limit']
        """
        from .doors import pictures_of

        return pictures_of(self)

    def viewer(self) -> Viewer | None:
        """Robot that can be moved on the page.

        Returns
        -------
        viewer : Viewer, or None without a motion that can be shown

        Examples
        --------
        >>> import twistwrench as tw
        >>> tw.check("ur5", "demo").viewer().page[:15]
        '<!doctype html>'
        """
        from .doors import viewer_of

        return viewer_of(self)

    # ── Surfaces

    def __str__(self) -> str:
        from .terminal import as_text

        return as_text(self.blocks())

    def print(self, *, every: bool = False, file: TextIO | None = None) -> None:
        """Print the report of the command, with colours on a terminal.

        Parameters
        ----------
        every : bool, print all rows of long tables, and notes on how files were read, too
        file : text stream, optional; default: standard output

        Examples
        --------
        >>> import io, twistwrench as tw
        >>> text = io.StringIO()
        >>> tw.check("ur5", "demo").print(file=text)
        >>> text.getvalue()[:22]
        'OK: all limits kept. C'
        """
        from .terminal import print_blocks

        print_blocks(self.blocks(), every=every, file=file)

    def __repr__(self) -> str:
        text = type(self).__name__
        if self.robot_name:
            text += f" of {self.robot_name}"
        text += f": {self.verdict.word}"
        if self.brief:
            text += f", {self.brief}"
        return f"<{text}>"

    def __bool__(self) -> bool:
        raise TypeError(f"a {type(self).__name__} has no truth value. Use .verdict.ok")

    def _repr_html_(self) -> str:
        """Card of a notebook; the plain text if an error prevents the card, since a notebook must show something."""
        from .card import card

        try:
            return card(self)
        except Exception:
            return f"<pre>{html.escape(str(self))}</pre>"

    def plot(self, kind: str | Path | None = None, path: str | Path | None = None) -> Any:
        """Draw the answer.

        Parameters
        ----------
        kind : str, optional, one of the kinds that an error lists; default: the first
            A file name, ``plot("torques.png")``, is taken as ``path``.
        path : str or Path, optional, file to write (.png, .pdf, .svg)

        Returns
        -------
        figure : matplotlib figure, or Path of the written file

        Raises
        ------
        MissingExtraError
            matplotlib is not installed.
        UnknownNameError
            There is no picture of this kind.

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     tw.check("ur5", "demo").plot("causes", f"{folder}/causes.svg").name
        'causes.svg'
        """
        from .doors import plot

        return plot(self, kind, path)

    def to_html(self, path: str | Path) -> Path:
        """Write the answer as one self-contained page, replacing an existing one.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        path : Path

        Examples
        --------
        >>> import tempfile, twistwrench as tw
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     page = tw.check("ur5", "demo").to_html(f"{folder}/report.html").read_text()
        >>> page.startswith("<!doctype html>")
        True
        """
        from .page import answer_page

        return answer_page(self).write(as_path(path))

    def to_dict(self) -> dict[str, Any]:
        """Data of the answer: verdict, reasons, facts, sentences, tables with all digits, and notes.

        Returns
        -------
        data : dict, as written by ``--json``

        Examples
        --------
        >>> import twistwrench as tw
        >>> data = tw.check("ur5", "demo", payload=10).to_dict()
        >>> data["verdict"], data["exit_code"], data["facts"]["share of limit"], data["tables"][0]["columns"][1]
        ('OVER LIMIT', 1, '111 %', {'name': 'peak', 'unit': 'N m'})
        """
        from .data import report_data

        verdict = self.verdict
        return {
            "schema": SCHEMA,
            "call": self.call,
            "robot": self.robot_name,
            **report_data(list(self.blocks())),
            "verdict": str(verdict.word),
            "reasons": list(verdict.reasons),
            "remedies": list(verdict.remedies),
            "ok": verdict.ok,
            "exit_code": int(verdict.exit_code),
            "facts": dict(self.facts()),
            "version": __version__,
        }

    def to_json(self, path: str | Path | None = None, *, overwrite: bool = False) -> str | Path:
        """Data of :meth:`to_dict` as JSON.

        Parameters
        ----------
        path : str or Path, optional, file to write
        overwrite : bool, replace an existing file

        Returns
        -------
        text : str, or Path of the written file

        Raises
        ------
        ValueRangeError
            The file exists, and ``overwrite`` is False.

        Examples
        --------
        >>> import json, twistwrench as tw
        >>> json.loads(tw.check("ur5", "demo").to_json())["verdict"]
        'OK'
        """
        text = json.dumps(self.to_dict(), ensure_ascii=False, allow_nan=False, indent=1) + "\n"
        if path is None:
            return text
        target = as_path(path)
        refuse_existing(target, overwrite=overwrite)
        with replacing(target) as scratch:
            scratch.write_text(text, encoding="utf-8", newline="")
        return target

    @property
    def tables(self) -> Mapping[str, DataTable]:
        """Tables with all rows and digits, by title; if a table has no title, by the name of its first column."""
        from .blocks import Table
        from .data import DataTable

        tables = [DataTable.from_table(block) for block in self.blocks() if isinstance(block, Table)]
        by_title: dict[str, DataTable] = {}
        for table in tables:
            name = table.title
            if not name:
                name, _ = table.columns[0]
            by_title[name] = table
        return by_title

    @property
    def headline(self) -> str:
        """First line of the report, without its colour."""
        from .blocks import Headline
        from .data import plain

        for block in self.blocks():
            if isinstance(block, Headline):
                first_line, *_ = plain(block).split("\n")
                return first_line
        return ""
