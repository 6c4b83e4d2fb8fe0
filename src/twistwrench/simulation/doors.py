"""Plots of results, which stand above this package."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, cast

from ..core.glossary import complete

if TYPE_CHECKING:
    from .result import SimulationResult


class ResultDoors:
    """Methods of a result that call packages above this one."""

    def plot(self, path: str | Path) -> Path:
        """Plot of joints, energies and drift; the suffix sets the kind (.png, .pdf, .svg).

        Returns
        -------
        path : Path of the file written
        """
        from ..viz.plots.simulation import plot_simulation

        return plot_simulation(cast("SimulationResult", self), path)


complete(globals())
