"""Show the head of an objects table in the terminal: `python -m tools.show_objects TABLE.parquet` (for `make demo`)."""

from __future__ import annotations

import sys
from math import degrees
from typing import Any, Literal

import pyarrow.parquet as pq
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

ROWS = 12
COLUMNS: tuple[tuple[str, str], ...] = (
    ("sweep", "{sweep}"),
    ("object", "{object}"),
    ("shape", "{shape}"),
    ("visibility", "{visibility}"),
    ("beams", "{beams}"),
    ("bearing", "{bearing:.1f}°"),
    ("range", "{r_min:.2f} m"),
    ("width", "{width:.2f} m"),
    ("vertices", "{corners}"),
)


def main(path: str) -> None:
    """Print the first rows, and where all of them are."""
    file = pq.ParquetFile(path)
    rows = next(file.iter_batches(ROWS)).to_pylist() if file.metadata.num_rows else []
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for name, _ in COLUMNS:
        justify: Literal["left", "right"] = "left" if name in ("shape", "visibility") else "right"
        table.add_column(name, justify=justify, no_wrap=True)
    for row in rows:
        table.add_row(*(form.format(**_values(row)) for _, form in COLUMNS))
    console = Console(width=max(Console().width, 80))
    console.print(table)
    console.print(
        f"{len(rows)} of {file.metadata.num_rows:,} rows, {len(COLUMNS)} of {len(file.schema_arrow)} columns.\n"
        f"The whole table is {path}: read it with pandas, DuckDB or polars.",
        highlight=False,
        soft_wrap=True,
    )


def _values(row: dict[str, Any]) -> dict[str, Any]:
    return {**row, "bearing": degrees(row["theta_min"]), "corners": len(row["vertices"])}


if __name__ == "__main__":
    main(*sys.argv[1:])
