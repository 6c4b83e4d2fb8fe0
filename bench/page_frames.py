"""Frames a second of the viewer's page in a headless Chromium that draws by software, and the processor time of a frame.

python -m bench.page_frames [PAGE.html …]; without pages, the panda's page and that of section 8.3.

The panda is posed anew in every frame, in a window of 800 x 600. The processor time is that of all processes of the browser, so
that it holds on a busy machine, too; the frames a second hold on a quiet one. Linux only.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import twistwrench as tw
from twistwrench.viz import write_page

ROOT = Path(__file__).resolve().parent.parent
SECONDS = 3.0
MOVE = """(() => { const move = () => {
    viewer.setCoordinates(viewer.robot.start.map((x, k) => x + 0.2 * Math.sin(performance.now() / 500 + k)));
    requestAnimationFrame(move); };
  requestAnimationFrame(move); })()"""
COUNT = f"""new Promise((done) => {{ const begun = performance.now(), times = [];
    const frame = (now) => {{ times.push(now);
      if (now - begun < {1000 * SECONDS}) requestAnimationFrame(frame);
      else done([times.length - 1, times[times.length - 1] - times[0]]); }};
    requestAnimationFrame(frame); }})"""


def processor_time() -> float:
    """Of the processes that this one started, and of theirs [s]."""
    children: dict[int, list[int]] = {}
    spent: dict[int, float] = {}
    for place in Path("/proc").glob("[0-9]*"):
        name = place.name
        try:
            words = (place / "stat").read_text("utf-8").rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        children.setdefault(int(words[1]), []).append(int(name))
        spent[int(name)] = (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    total, left = 0.0, [os.getpid()]
    while left:
        found = children.get(left.pop(), [])
        total += sum(spent[child] for child in found)
        left += found
    return total


def main(paths: list[str]) -> None:
    """Print a line for each page."""
    sys.path[:0] = [str(ROOT / "tests" / "support")]
    from chromium import browser

    with tempfile.TemporaryDirectory() as folder:
        panda, made = tw.robots.panda(), Path(folder)
        pages = [Path(p) for p in paths] or [
            write_page(panda, made / "panda.html"),
            write_page(panda, made / "panda_8.3.html", section="8.3"),
        ]
        with browser() as page:
            page.call("Emulation.setDeviceMetricsOverride", width=800, height=600, deviceScaleFactor=1, mobile=False)
            for path in pages:
                page.open(path.resolve().as_uri())
                page.wait("!!window.viewer")
                page.run(MOVE)
                time.sleep(1.5)  # until the page has found how finely it can draw
                before = processor_time()
                frames, passed = page.run(COUNT)
                each = 1000 * (processor_time() - before) / frames
                print(f"{path.name}: {1000 * frames / passed:.0f} frames a second, {each:.1f} ms of processor each")


if __name__ == "__main__":
    main(sys.argv[1:])
