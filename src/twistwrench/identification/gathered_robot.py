"""From information to the identified robot: the fit of all rows, residuals of rows held out, and doubts."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .consistent_robot import sum_of
from .evidence import LogDoubt, left_unexplained
from .held_out import HeldOut
from .identified_robot import IdentifiedRobot
from .information_fit import fit_of

if TYPE_CHECKING:
    from .information import Information

_OFF = 0.5
"""Share of a step within which corrections of the settings are linear."""


def gathered_robot(information: Information, test: Information | None = None) -> IdentifiedRobot:
    """The robot that all rows tell; ``test`` is only predicted."""
    fit, frame = fit_of(information), information.frame
    blocks = len(information.moments.counts)
    x, sigma = fit.solved(np.arange(blocks))
    r = frame.base.count
    among = fit.held_out()
    held_out = among
    if test is not None:
        _ = information + test  # raises where they are not alike
        held_out = fit_of(test).predicted(x, "test")
    if information.shown is not None:
        held_out = replace(held_out, rows=(information.shown,))
    folds = fit.folded(x, sigma)
    return IdentifiedRobot(
        original=information.robot,
        base=frame.base,
        values=x[:r],
        covariance=fit.covariance(x, sigma, information.seconds / max(1, blocks)),
        sigma=sigma,
        settings=fit.settings(x),
        held_out=held_out,
        trained=among,
        doubts=_doubts(information, held_out, among, x),
        prior=information.weak,
        method=information.method,
        sizes=information.sizes,
        information=sum_of([fold.together() for fold in folds]),
        folds=tuple(folds),
        payload_frame=information.payload_frame,
    )


def _doubts(information: Information, held: HeldOut, among: HeldOut, x: np.ndarray) -> tuple[LogDoubt, ...]:
    """Those of the excerpts, and what all rows say besides."""
    found = list(information.doubts)
    kinds = {d.kind for d in found}
    found += [doubt for doubt in left_unexplained(held, among) if doubt.kind not in kinds]
    if far := _settings_off(information, x):
        found.append(
            LogDoubt(
                "other-settings",
                f"all rows ask for another {far} than the excerpt did, so that they are not alike. Set it, or identify "
                "parts of the logs apart.",
            )
        )
    return tuple(sorted(found, key=lambda doubt: not doubt.refuses))


def _settings_off(information: Information, x: np.ndarray) -> str:
    """What is off by more than the linear correction can be trusted with."""
    frame, r = information.frame, information.frame.base.count
    if frame.free_shift and abs(x[r]) > _OFF * 0.1 / frame.settings.cutoff:
        return "offset of the clock"
    at = r + int(frame.free_shift)
    names = frame.base.unknown.model.velocity_names
    far = [k for k in range(len(frame.speeds)) if abs(x[at + k]) > _OFF * 10]
    owners = [names[int(np.flatnonzero(frame.speeds[k][1])[-1])] for k in far]
    return f"friction speed of {', '.join(owners)}" if owners else ""
