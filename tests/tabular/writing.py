"""Tables written from record batches, for several tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa

from lidarcli.tabular.writing import TableFiles, table_metadata, table_paths

STAMPS = np.array([1_700_000_000_123_456_789, 1_700_000_000_223_456_789, 1_700_000_000_323_456_789])
METADATA = table_metadata({"profile": "robust"}, {"name": "run.mcap", "size": 12, "format": "mcap"})


def write_files(folder: Path, batches: list[tuple[str, pa.RecordBatch]], first: str | None) -> Path:
    with TableFiles(table_paths(folder, "run", ("objects",)), first) as files:
        for topic, rows in batches:
            files.write("objects", topic, rows)
        files.publish(METADATA)
    return folder / "run.objects.parquet"
