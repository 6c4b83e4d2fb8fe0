"""Commands that install an extra, on pages and in packages of a version that is on a package index.

Pages have the command for a checkout, `pip install -e ".[plot]"`, which always works. It becomes
`pip install "twistwrench[plot]"` if `TWISTWRENCH_ON_INDEX=1` is set while the site or a package is built, and in what is built
from such a package.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

VERSION = Path(__file__).resolve().parents[1] / "src" / "twistwrench" / "core" / "version.py"
CONSTANT = "ON_INDEX = {}\n"
CHECKOUT = re.compile(r"""(pip (?:install|wheel) )(?:-e )?(\\?["']|)\.\[([\w,…]+)\]""")
_PLACE = re.compile(r" *# in a checkout of this repository$|(?<=# )in a checkout of this repository; ", re.MULTILINE)


def on_index() -> bool:
    """True if what is built now is for a package index, or is built from a package that was."""
    return os.environ.get("TWISTWRENCH_ON_INDEX") == "1" or CONSTANT.format(True) in VERSION.read_text("utf-8")


def for_index(text: str) -> str:
    """Text whose commands install extras from a package index.

    >>> for_index("`pip install -e '.[plot,logs]'`, and pip install .[NAME,…]")
    "`pip install 'twistwrench[plot,logs]'`, and pip install twistwrench[NAME,…]"
    """
    return _PLACE.sub("", CHECKOUT.sub(r"\1\2twistwrench[\3]", text))
