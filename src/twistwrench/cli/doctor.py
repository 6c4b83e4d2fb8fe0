"""The command ``twistwrench doctor``: its options, and its answer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..core.files import check_outputs, refuse_existing
from ..core.verdict import ExitCode
from ..errors import ValueRangeError
from .motion_options import option_group
from .robot_options import robot_source

if TYPE_CHECKING:
    from rich.console import RenderableType


doctor_options = option_group(
    click.option("--floating-base", is_flag=True, help="Let the base move freely, so that its own inertia counts."),
    click.option("--model", metavar="NAME", help="Of an SDF world: this model."),
    click.option("--strict", is_flag=True, help="Exit code 1 with notes too."),
    click.option("--json", "as_json", is_flag=True, help="Print everything as JSON, in SI units."),
    click.option(
        "--metric",
        type=click.Choice(["frobenius", "entropic"]),
        default="frobenius",
        show_default=True,
        help="What the nearest tensor is nearest in, where no one slip explains the numbers.",
    ),
    click.option(
        "--mirror-from",
        type=click.Choice(["left", "right"]),
        help="The side that is copied, mirrored, where two sides are no mirror images.",
    ),
    click.option(
        "--meshes", "folders", metavar="DIR", multiple=True, help="Look for meshes there too; may be repeated."
    ),
    click.option(
        "--plot", "plot_path", metavar="OUT.png", help="Draw shapes, and ellipsoids of inertia before and after."
    ),
    click.option("--page", metavar="OUT.html", help="Write a page: links in the colours of the findings."),
    click.option("--fix", metavar="OUT", help="Write the file with the repairs, everything else byte for byte."),
    click.option("--force", "overwrite", is_flag=True, help="Replace the file of --fix if it is there."),
    click.option("--only", metavar="CHECK", multiple=True, help="Run this check only; may be repeated."),
    click.argument("source", metavar="ROBOT"),
)
"""The options of the command and its ROBOT."""


def run_doctor(
    show: Callable[[RenderableType], None],
    *,
    source: str,
    fix: str | None,
    overwrite: bool,
    plot_path: str | None,
    page: str | None,
    only: tuple[str, ...],
    folders: tuple[str, ...],
    metric: str,
    mirror_from: str | None,
    as_json: bool,
    strict: bool,
    floating_base: bool,
    model: str | None,
) -> ExitCode:
    """Print the findings; what the command ends with. Raises errors of the library."""
    from ..diagnosis import doctor
    from .tables.robots import doctor_view

    for folder in folders:
        if not Path(folder).is_dir():
            raise ValueRangeError(
                f"--meshes {folder!r} is no folder. Give the one that holds the meshes or their package."
            )
    found = robot_source(source)
    check_outputs(
        {"--fix": fix, "--plot": plot_path, "--page": page}, {"ROBOT": source if Path(source).is_file() else None}
    )
    if fix is not None:
        refuse_existing(fix, overwrite=overwrite)
    report = doctor(
        found,
        only=only or None,
        meshes=folders or True,
        metric=metric,
        mirror_from=mirror_from,
        floating_base=floating_base or None,
        model=model,
    )
    if as_json:
        click.echo(report.to_json(), nl=False)
    else:
        show(doctor_view(report, every=strict))
    if fix is not None:
        repaired = report.write(fix, overwrite=overwrite)
        click.echo(f"wrote {fix}, with {len(repaired)} repair{'' if len(repaired) == 1 else 's'}", err=as_json)
    if plot_path is not None:
        from ..plotting.identification import links_drawn, plot_diagnosis

        if links_drawn(report):
            click.echo(f"wrote {plot_diagnosis(report, plot_path)}", err=as_json)
        else:
            click.echo("note: no finding changes an inertia, so there is nothing to draw.", err=True)
    if page is not None:
        from ..viz.page import write_findings_page

        click.echo(f"wrote {write_findings_page(report, page)}", err=as_json)
    return report.exit_code(strict=strict)
