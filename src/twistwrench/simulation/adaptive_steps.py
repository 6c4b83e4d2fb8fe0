"""The steps of an adaptive run, from sample to sample of a controller, and the states between them one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .free_steps import take_freely

if TYPE_CHECKING:
    from .adaptive import Stepper
    from .run import Run


def take_adaptively(run: Run, stepper: Stepper) -> None:
    """Steps of any length, from sample to sample where a controller asks for it; states between by dense output."""
    run.stepper = stepper
    y = run.begin()
    t, k, spacing = 0.0, 0, run.h * run.every
    end = run.end
    run.sample(t, y)
    run.system.rates(t, y, run.rate)
    run.keep(t, y)
    if stepper.attempts is not None and run.asks_nobody:
        take_freely(run, stepper, stepper.attempts)
        return
    kept = 1
    while t < end:
        until = (k + 1) * run.h if run.controller is not None and k + 1 < run.n else end
        t1, y1 = stepper.step(t, y, run.rate, until)
        run.rejected, rate1 = stepper.rejected, stepper.rate_after
        y1 = run.checked(t, t1, y1)
        if t == 0.0 and run.leaves_at_once(y, y1, t1):
            return
        begin = kept
        while kept * spacing < t1 - 1e-12 * end and kept * spacing < end:
            kept += 1
        times = np.arange(begin, kept) * spacing
        between = stepper.between(times) if len(times) else np.zeros((0, len(y)))
        points = list(zip((times - t).tolist(), between, strict=True))
        if run.watch is not None and run.ended(t, y, [*points, (t1 - t, y1)], points):
            return
        run.keep_all(t + (times - t), between)
        t, y = t1, y1
        run.advance(t, y)
        due = abs(kept * spacing - t) <= 1e-12 * end and t < end
        kept += due
        if run.controller is not None and t == until and t < end:
            k += 1
            run.sample(t, y)
            run.system.rates(t, y, run.rate)
            if due:
                run.keep(t, y)
            continue
        run.rate[:] = rate1
        run.system.manifold.rates(*run.system.split(y), out=run.rate[: run.system.nq])
        if due:
            run.keep_at(t, y)
    run.keep_at(t, y)
