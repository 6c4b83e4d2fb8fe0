"""The data in a page of the viewer, for tests: its header, its arrays, its programs."""

import base64
import json
import zlib
from pathlib import Path

import numpy as np

from twistwrench.viz.page import KINDS


def read_programs(path):
    """The script of a page that defines ``PROGRAMS``, its functions by name."""
    return Path(path).read_text("utf-8").partition('<script id="programs">')[2].partition("</script>")[0]


def read_page(path):
    """What stands in the header of a page, and the motion's arrays by name."""
    text = Path(path).read_text("utf-8")
    _, _, rest = text.partition('<script id="data" type="application/octet-stream">')
    raw = zlib.decompress(base64.b64decode(rest.partition("</script>")[0]))
    length = int.from_bytes(raw[:4], "little")
    header = json.loads(raw[8 : 8 + length])
    start = 8 + -(-length // 8) * 8

    def array(spec):
        return np.frombuffer(raw, KINDS[spec["kind"]], spec["count"], start + spec["at"])

    return header, {
        name: array(spec) for name, spec in (header["motion"] or {}).items() if isinstance(spec, dict) and "at" in spec
    }
