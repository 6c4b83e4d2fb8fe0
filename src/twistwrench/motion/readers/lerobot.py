"""LeRobot datasets: parquet files with the metadata ``meta/info.json``."""

from __future__ import annotations

import json
import re
from pathlib import Path

from ...core.errors import TrajectoryError
from ...core.files import read_text

EPISODES = "episode_index"
"""Column of the episodes of a LeRobot dataset."""
_LEVELS = 3
"""Folders from an episode's file to the dataset's: ``DATASET/data/chunk-000/episode_000000.parquet``."""
_MAX_METADATA_SIZE = 1 << 22
"""Largest size of ``meta/info.json`` [bytes]."""
STATE = "observation.state"
"""Column of the positions of a LeRobot dataset."""


def read_metadata(path: Path) -> tuple[dict[str, list[str]], str]:
    """Element names of a dataset's list columns and unit of positions, from ``meta/info.json`` of the dataset's folder."""
    candidates = [folder / "meta" / "info.json" for folder in path.absolute().parents[:_LEVELS]]
    info = next(filter(Path.is_file, candidates), None)
    if info is None:
        return {}, "unknown"
    try:
        text = read_text(info, _MAX_METADATA_SIZE)
        features = json.loads(text)["features"]
        names_of = {name: feature.get("names") for name, feature in features.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as problem:
        raise TrajectoryError(
            f"{info}: is not the metadata of a LeRobot dataset: {problem!r}. Mend or remove it."
        ) from None
    element_names = {}
    for name, names in names_of.items():
        while isinstance(names, dict) and len(names) == 1:  # {"motors": [...]}
            names = next(iter(names.values()))
        if isinstance(names, list) and all(isinstance(element, str) for element in names):
            element_names[name] = names
    if "range_m100_100" in text:
        return element_names, "range"
    unit = re.search(r'"(?:units?|use_degrees)"\s*:\s*"?(deg|rad|true)', text)
    if unit is None:
        return element_names, "unknown"
    return element_names, {"deg": "degrees", "true": "degrees", "rad": "radians"}[unit[1]]
