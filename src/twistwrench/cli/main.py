"""The shell: its commands, each loaded from its file when it is called.

Commands read options, call one function of the library, and turn errors into one line and an exit code, those of
:mod:`twistwrench.core.verdict`.
"""

from __future__ import annotations

from importlib import import_module
from typing import NamedTuple

import click

from .usage import Commands, examples


class _Entry(NamedTuple):
    file: str
    summary: str


_COMMANDS = {
    "convert": _Entry("export", "Write the robot as URDF, MJCF or SDF."),
    "derive": _Entry("derive", "Equations of motion in symbols: text, LaTeX, C or NumPy."),
    "doctor": _Entry("doctor", "What is wrong with a robot file, and the repair."),
    "excite": _Entry("excite", "A motion whose log identifies the robot best."),
    "export": _Entry("export", "The robot's dynamics as C99 source."),
    "identify": _Entry("identify", "Masses, inertias and friction from logs."),
    "info": _Entry("info", "Joints, limits, masses, inertias, frames and the tree."),
    "log": _Entry("log", "What is in the log of a motion."),
    "move": _Entry("move", "A motion from one configuration to another, also the fastest."),
    "payload": _Entry("payload", "The largest payload at a pose, and the joint that limits it."),
    "plot": _Entry("view", "Pictures of a motion: causes of torques, power, phase planes."),
    "robots": _Entry("info", "The robots that have a name."),
    "sensor": _Entry("sensor", "Six-axis sensors: identify a tool, take its weight off readings."),
    "simulate": _Entry("simulate", "How the robot moves: states, energies, events."),
    "torques": _Entry("torques", "Torques of a motion: which joint is over its limit, and why."),
    "verify": _Entry("doctor", "Check the dynamics against independent formulas and libraries."),
    "view": _Entry("view", "The robot in the browser, as a page, or as a film."),
}
"""Commands by name: the file that has the function NAME_command, and the line in the list of commands."""


class LazyCommands(Commands):
    """Commands of :data:`_COMMANDS`, loaded one by one."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  as click calls it
        """Names of all commands."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Load a command; None if there is none of that name."""
        if cmd_name not in _COMMANDS:
            return super().get_command(ctx, cmd_name)
        module = import_module(f".{_COMMANDS[cmd_name].file}", __package__)
        found: click.Command = getattr(module, f"{cmd_name}_command")
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  as above
        """Write the list of commands without loading them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.summary) for name, entry in _COMMANDS.items()])


@click.group(
    cls=LazyCommands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=examples("torques ur5 --trajectory demo --payload 10", "doctor ur5", "torques --help"),
)
@click.version_option(package_name="twistwrench")
def main() -> None:
    """Robot dynamics from robot files. ROBOT is a path, or a name that `twistwrench robots` lists, such as ur5."""
