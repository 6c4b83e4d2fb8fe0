"""Runs the numbered examples, and keeps their pictures for the home page of the site: ``python -m examples``."""

import ast
import subprocess
import sys
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
PICTURES = HERE.parent / "docs" / "gallery"
SCRIPTS = sorted(HERE.glob("[0-9][0-9]_*.py"))


def picture_of(script: Path) -> Path:
    """Where its picture goes."""
    return PICTURES / f"{script.stem[3:]}.png"


def title(script: Path) -> str:
    """First sentence of its docstring."""
    return ast.get_docstring(ast.parse(script.read_text("utf-8"))).partition(".")[0]


def main() -> None:
    """Make the pictures."""
    PICTURES.mkdir(exist_ok=True)
    for script in SCRIPTS:
        picture = picture_of(script)
        print(f"{script.name} → {picture.relative_to(HERE.parent)}", flush=True)
        subprocess.run([sys.executable, script, picture], check=True)
        Image.open(picture).convert("RGB").quantize(160).save(picture, optimize=True)  # they are kept in the repository


if __name__ == "__main__":
    main()
