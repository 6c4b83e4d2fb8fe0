"""Write answers anew after a change that is meant to alter them: ``python -m tests.records statics``. Read the difference before you commit it."""

from __future__ import annotations

import importlib
import os
import sys
import tempfile
import warnings
from pathlib import Path

FOLDER = Path(__file__).parent


def main(rooms: list[str]) -> None:
    sys.path.insert(0, str(FOLDER.parent / "support"))
    os.environ.update(COLUMNS="110", TWISTWRENCH_JIT="0")
    known = sorted(path.stem.removeprefix("test_") for path in FOLDER.glob("test_*.py"))
    unknown = sorted({*rooms} - {*known})
    if unknown:
        raise SystemExit(f"No records of {', '.join(unknown)}. Records: {', '.join(known)}")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TWISTWRENCH_CACHE_DIR"] = folder
        for room in rooms or known:
            module = importlib.import_module(f"tests.records.test_{room}")
            warnings.simplefilter("ignore")
            print(module.records.write(Path(folder)))


if __name__ == "__main__":
    main(sys.argv[1:])
