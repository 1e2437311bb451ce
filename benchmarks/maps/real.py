"""Maps of public recordings: what became of each whose path is known, and pictures of two."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.maps.figures import Recorded
from benchmarks.maps.program import run
from lidarcli.errors import LidarcliError
from lidarcli.formalism.mapping.grid import UNKNOWN
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput
from lidarcli.pipeline.mapping import GrowingMap, MapOptions

PICTURES = ("comprobo24/test-bag", "datmo/overtake_ego.bag")


def measure_recordings(folder: Path) -> list[Recorded]:
    """A map of each log below the folder whose path is told or can be matched."""
    found = []
    for source in find_logs([str(folder)]):
        if isinstance(source, MissingInput):
            continue
        mapping = GrowingMap(MapOptions())
        try:
            summary = mapping.add(source)
        except LidarcliError:
            continue
        grid = mapping.occupancy()
        rows, columns = (np.flatnonzero((grid.cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            continue
        found.append(
            Recorded(
                source.name,
                summary.sweeps,
                mapping.counts.sweeps,
                sum(path.length for path in mapping.paths),
                float(columns[-1] - columns[0] + 1) * grid.resolution,
                float(rows[-1] - rows[0] + 1) * grid.resolution,
                grid.occupied,
                grid.free,
            )
        )
    return found


def picture_name(log: str) -> str:
    """The file of the picture of a recording."""
    return f"{log.replace('/', '-').removesuffix('.bag')}.png"


def draw_recordings(folder: Path, images: Path) -> list[Path]:
    """Pictures of two of them, with the path."""
    drawn = []
    for log in PICTURES:
        target = images / picture_name(log)
        run("plot", str(folder / log), "--view", "map", "-o", str(target), "--overwrite")
        drawn.append(target)
    return drawn
