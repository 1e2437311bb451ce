"""Show the tracks of a log beside the truth of its scene (for `make demo`).

`python -m tools.show_tracks LOG.tracks.parquet LOG.truth.parquet`
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow.parquet as pq
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

NEAR = 0.6
"""A track is the true thing whose centre is this near [m] on the whole: the centre of a view lies at its nearer side."""
LONG = 0.5
"""What is seen for less [s] is a piece of something that comes into view."""
COLUMNS: tuple[tuple[str, Literal["left", "right"]], ...] = (
    ("track", "right"),
    ("shape", "left"),
    ("seen for", "right"),
    ("moves", "left"),
    ("speed", "right"),
    ("in the scene", "left"),
    ("true speed", "right"),
)


def main(tracks: str, truth: str) -> None:
    """Print a row per track, and how many things there are beside how many there should be."""
    objects = pq.read_table(tracks.replace(".tracks.", ".objects."), columns=["sweep", "track", "x", "y"])
    followed = pq.read_table(tracks).to_pylist()
    true = _true_things(truth)
    named = _names(objects.to_pydict(), true)
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for name, justify in COLUMNS:
        table.add_column(name, justify=justify, no_wrap=True)
    for row in followed:
        thing = true.get(named.get(row["track"], -1))
        moves = row["set"] == "A"
        table.add_row(
            str(row["track"]),
            row["shape"],
            f"{row['duration']:.1f} s",
            "yes" if moves else "no",
            f"{row['speed_mean']:.2f} m/s" if moves else "",
            "-" if thing is None else thing["kind"] if row["duration"] >= LONG else f"part of a {thing['kind']}",
            f"{thing['speed']:.2f} m/s" if thing is not None and thing["speed"] else "",
        )
    console = Console(width=max(Console().width, 80))
    console.print(table)
    whole = [named.get(row["track"]) for row in followed if row["duration"] >= LONG]
    console.print(
        f"{len(whole)} things are followed for {LONG} s or longer; the scene has {len(true)}, and "
        f"{len(set(whole) & true.keys())} of them are found.",
        highlight=False,
        soft_wrap=True,
    )


def _true_things(path: str) -> dict[int, dict[str, Any]]:
    """Entity → its kind, where it is in each sweep, and how fast [m/s]; without walls."""
    found: dict[int, dict[str, Any]] = {}
    for row in pq.read_table(path).to_pylist():
        if not row["wall"]:
            thing = found.setdefault(row["entity"], {"kind": row["kind"], "at": {}, "speeds": []})
            thing["at"][row["sweep"]] = (row["x"], row["y"])
            thing["speeds"].append(float(np.hypot(row["vx"] or 0.0, row["vy"] or 0.0)))
    for thing in found.values():
        thing["speed"] = float(np.mean(thing["speeds"]))
    return found


def _names(objects: dict[str, list[Any]], true: dict[int, dict[str, Any]]) -> dict[int, int]:
    """Track → the true thing that most of its views are near."""
    votes: dict[int, Counter[int]] = {}
    for sweep, track, x, y in zip(*objects.values(), strict=True):
        if track is None:
            continue
        away = {
            entity: float(np.hypot(place[0] - x, place[1] - y))
            for entity, thing in true.items()
            if (place := thing["at"].get(sweep)) is not None
        }
        if away and away[nearest := min(away, key=lambda entity: away[entity])] <= NEAR:
            votes.setdefault(track, Counter())[nearest] += 1
    return {track: counted.most_common(1)[0][0] for track, counted in votes.items()}


if __name__ == "__main__":
    if len(sys.argv) != 3 or not all(Path(name).is_file() for name in sys.argv[1:]):
        sys.exit("python -m tools.show_tracks LOG.tracks.parquet LOG.truth.parquet")
    main(*sys.argv[1:])
