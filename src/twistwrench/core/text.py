"""Numbers as text for a person; with ASCII signs, so that ``float`` reads them back."""

from __future__ import annotations

import math

_LABELS = {"coriolis": "Coriolis", "wrench": "ext. wrench"}


def cause_label(term: str) -> str:
    """How a term of the torque is called in print.

    >>> cause_label("coriolis")
    'Coriolis'
    """
    return _LABELS.get(term, term)


def number(value: float) -> str:
    """Four significant digits, three decimals at most: in N m, m and rad a person looks no closer.

    >>> number(-62.2648), number(1e-5)
    ('-62.26', '0')
    """
    if abs(value) < 5e-4:
        return "0"
    return f"{value:.{min(max(3 - math.floor(math.log10(abs(value))), 0), 3)}f}"


def spread(sigma: float) -> str:
    """A standard deviation with two digits, and three decimals at most, as :func:`number` has them.

    >>> spread(123.4), spread(0.01234), spread(0.0996), spread(2e-6), spread(0.0)
    ('120', '0.012', '0.10', '<0.001', '0')
    """
    if sigma < 5e-4:
        return "<0.001" if sigma > 0 else "0"
    rounded = float(f"{sigma:.1e}")
    return f"{rounded:.{min(max(1 - math.floor(math.log10(rounded) + 1e-9), 0), 3)}f}"
