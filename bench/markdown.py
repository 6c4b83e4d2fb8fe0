"""Numbers and tables as text."""

from collections.abc import Sequence


def section(title: str, text: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A heading, a line of words and a table; nothing at all where there are no rows."""
    if not rows:
        return ""
    lines = ["| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *rows)]
    return "\n\n".join(filter(None, [f"## {title}", text, "\n".join(lines)]))


def duration(nanoseconds: float) -> str:
    """Three figures and a unit: 18.0 ns, 520 ns, 1.25 µs, 7.80 ms."""
    scale, unit = _unit(nanoseconds)
    return f"{_three(nanoseconds / scale)} {unit}"


def quartiles(timing: dict[str, float]) -> str:
    """The spread, in the unit of the median: [17.8–18.9]."""
    scale, _ = _unit(timing["median"])
    return f"[{_three(timing['low'] / scale)}–{_three(timing['high'] / scale)}]"


def times(ratio: float) -> str:
    """29 × where faster, 1/2.4 where slower."""
    if ratio == 1:
        return "1"
    return f"{_two(ratio)} ×" if ratio >= 0.995 else f"1/{_two(1 / ratio)}"


def _unit(nanoseconds: float) -> tuple[float, str]:
    for scale, unit in ((1e6, "ms"), (1e3, "µs")):
        if nanoseconds >= 0.9995 * scale:
            return scale, unit
    return 1.0, "ns"


def _three(value: float) -> str:
    return f"{value:.2f}" if value < 9.995 else f"{value:.1f}" if value < 99.95 else f"{value:.0f}"


def _two(value: float) -> str:
    if value >= 99.5:
        return f"{float(f'{value:.2g}'):.0f}"
    return f"{value:.2f}" if value < 1.995 else f"{value:.1f}" if value < 9.95 else f"{value:.0f}"
