"""Logs of any length in ``twistwrench identify``: information gathered in portions, added to what was saved, and saved."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ..errors import ValueRangeError

if TYPE_CHECKING:
    from ..identification import IdentifiedRobot, Information
    from ..robot import Robot

LARGE = 1 << 26
"""Bytes of all logs, from which they are read in portions."""


def robot_from_portions(
    robot: Robot,
    logs: tuple[str, ...],
    tests: tuple[str, ...],
    options: dict[str, Any],
    *,
    old: str | None,
    out: str | None,
    workers: int | None,
    scheduler: str | None,
) -> IdentifiedRobot:
    """What all rows of the logs tell, and those of the ``old`` file; ``options`` are those of :func:`gather`."""
    from ..core.cluster import workers_of
    from ..identification import gather

    with workers_of(workers, scheduler) as team:
        given = {**options, "client": team.client}
        information = _gathered(robot, logs, old, given)
        tested = gather(robot, tests, like=information, **given) if tests else None
    found = information.identified(tested)
    if out is not None:
        click.echo(f"wrote {information.save(out)}")
    return found


def _gathered(robot: Robot, logs: tuple[str, ...], old: str | None, options: dict[str, Any]) -> Information:
    from ..identification import Information, gather

    if old is None:
        return gather(robot, logs, **options)
    before = Information.load(old, robot)
    if twice := sorted(set(before.logs) & set(logs)):
        raise ValueRangeError(f"{old} has the rows of {twice[0]!r} already. Leave that log out.")
    return before + gather(robot, logs, like=before, **options)
