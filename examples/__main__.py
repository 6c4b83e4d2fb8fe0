"""Runs the numbered examples, and makes the gallery of their pictures: ``python -m examples``, or ``make gallery``."""

import ast
import subprocess
import sys
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "gallery.md"
PICTURES = PAGE.with_suffix("")
SCRIPTS = sorted(HERE.glob("[0-9][0-9]_*.py"))


def picture_of(script: Path) -> Path:
    """Where its picture goes."""
    return PICTURES / f"{script.stem[3:]}.png"


def entry(script: Path) -> str:
    """Its part of the page, from its docstring: a title, what is seen, and what to change."""
    title, *said = ast.get_docstring(ast.parse(script.read_text("utf-8"))).split("\n\n")
    picture = f"![{title}]({picture_of(script).relative_to(PAGE.parent).as_posix()})"
    head = f"## {title.removesuffix('.')}"
    text = [paragraph.replace("``", "`") for paragraph in said]
    return "\n\n".join([head, picture, *text, f"[`examples/{script.name}`](../examples/{script.name})"])


def page() -> str:
    """The whole of it."""
    start = """# Gallery

Each picture is made by a script of about a page, which also prints the numbers behind it: `python examples/01_falling_ur5.py
PICTURE.png`. `python -m examples` runs all of them and writes this page."""
    return "\n\n".join([start, *map(entry, SCRIPTS)]) + "\n"


def main() -> None:
    """Make pictures and page."""
    PICTURES.mkdir(exist_ok=True)
    for script in SCRIPTS:
        picture = picture_of(script)
        print(f"{script.name} → {picture.relative_to(HERE.parent)}", flush=True)
        subprocess.run([sys.executable, script, picture], check=True)
        Image.open(picture).convert("RGB").quantize(160).save(picture, optimize=True)  # they are kept in the repository
    PAGE.write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
