"""Write the table of threats in SECURITY.md from src/twistwrench/formats/threats.toml: `python tools/threats.py`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "src" / "twistwrench" / "formats" / "threats.toml"
PAGE = ROOT / "SECURITY.md"
BEGIN, END = "<!-- threats: written by tools/threats.py -->\n", "<!-- end of threats -->\n"
_HEADS = {"run": "Code that a file could run", "reach": "Places outside itself", "unpack": "Memory and time"}


def threats() -> dict[str, Any]:
    """Content of the table of threats."""
    return tomllib.loads(TABLE.read_text(encoding="utf-8"))


def _row(threat: Mapping[str, Any]) -> str:
    test = threat["test"].rpartition("::")[2]
    return f"| {', '.join(threat['formats'])} | {threat['threat']} | {threat['bound']} | `{test}` |\n"


def written() -> str:
    """Sections of the page: the rows of each kind of threat."""
    rows = threats()["threat"]
    sections = []
    for kind, head in _HEADS.items():
        lines = [_row(threat) for threat in rows if threat["kind"] == kind]
        sections.append(f"\n### {head}\n\n| files | threat | bound | test |\n|---|---|---|---|\n{''.join(lines)}")
    return "".join(sections) + "\n"


def page_with_threats(page: str) -> str:
    """Page whose part between the marks is the table."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}{written()}{END}{rest.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(page_with_threats(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
