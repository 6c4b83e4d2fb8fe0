"""Where a command puts its picture."""

from __future__ import annotations


def check_extra(plot_path: str | None) -> None:
    """Say before the long run, not after it, that a picture cannot be drawn."""
    if plot_path is not None:
        from ..plotting.style import require_matplotlib

        require_matplotlib("Drawing the report (--plot)")


def picture(plot_path: str | None) -> str | None:
    """The path of a picture with its suffix, where one is asked for and can be drawn."""
    from ..outputs import picture_path

    check_extra(plot_path)
    return None if plot_path is None else picture_path(plot_path)
