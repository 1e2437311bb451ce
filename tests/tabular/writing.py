"""Tables written from record batches, for several tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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


def shortest(rows: pa.RecordBatch | pa.Table) -> list[dict[str, Any]]:
    """The rows with the shortest decimals of every number of single precision."""

    def short(kind: pa.DataType, value: Any) -> Any:
        if value is None:
            return None
        if pa.types.is_list(kind):
            return [short(kind.value_type, item) for item in value]
        if pa.types.is_struct(kind):
            return {part.name: short(part.type, value[part.name]) for part in kind}
        return float(str(np.float32(value))) if pa.types.is_float32(kind) else value

    kinds = {field.name: field.type for field in rows.schema}
    return [{name: short(kinds[name], row[name]) for name in row} for row in rows.to_pylist()]
