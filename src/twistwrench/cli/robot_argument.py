"""What the argument ROBOT of the shell means."""

from __future__ import annotations

import difflib
from contextlib import suppress
from pathlib import Path

from ..errors import NotFoundError

_STANDARD_INPUT = "-"


def robot_source(source: str) -> str | Path:
    """What ROBOT means: the path of a file, those of robots known by their names too, or the text that comes by a pipe.

    Raises :class:`~twistwrench.NotFoundError`, with near names.
    """
    from ..core.files import is_stream
    from ..formats.source import read_robot_text, standard_input_text
    from ..robots.finding import known_robots, plain_name

    if source == _STANDARD_INPUT:  # read once, and perhaps loaded twice
        return standard_input_text()
    if is_stream(Path(source)):
        return read_robot_text(source)[0]
    with suppress(OSError):  # a name too long for a file
        if Path(source).exists():
            return source
    known, wanted = known_robots(), plain_name(source)
    if wanted in known:
        return known[wanted].path
    near = difflib.get_close_matches(wanted, known, n=3, cutoff=0.6)
    hint = f" Did you mean {' or '.join(map(repr, near))}?" if near else ""
    raise NotFoundError(
        f"no robot file {source!r}, and no bundled robot of that name, nor one of another package.{hint} "
        "Give a path, or a name that `twistwrench robots` lists."
    )
