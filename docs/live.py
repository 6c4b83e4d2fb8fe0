"""Write examples/payload.html, the page with the payload slider that README links to: ``python docs/live.py``."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "examples" / "payload.html"
_NUMBER = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
_BYTES = re.compile(r"[A-Za-z0-9+/=]{400,}")


def page() -> str:
    """Text of the page."""
    import twistwrench as tw
    from twistwrench.viz.page import viewer_page

    heavy = runpy.run_path(str(ROOT / "docs" / "site.py"))["demo_motion"](10.0)
    return viewer_page(tw.robots.ur5(), motion=heavy, embed=True, control="payload").page


def outline(text: str) -> str:
    """The page with numbers to six digits and encoded arrays by their length: equal on processors that round otherwise."""
    text = _BYTES.sub(lambda found: f"({len(found[0])} letters)", text)
    return _NUMBER.sub(lambda found: f"{float(found[0]):.6g}", text)


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
