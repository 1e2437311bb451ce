"""Row groups, written by a thread of their own: its errors come out, and leaving leaves nothing."""

from __future__ import annotations

import errno
import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.tabular.writing import ROWS_PER_GROUP, ParquetSink


def test_row_groups_have_equal_size() -> None:
    out = io.BytesIO()
    schema = pa.schema([pa.field("x", pa.int64())])
    sink = ParquetSink(out, schema)
    total = 2 * ROWS_PER_GROUP + 10
    for first in range(0, total, 7001):
        values = np.arange(first, min(first + 7001, total))
        sink.write(pa.record_batch([pa.array(values)], schema=schema))
    sink.finish({})
    file = pq.ParquetFile(io.BytesIO(out.getvalue()))
    sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
    assert sizes == [ROWS_PER_GROUP, ROWS_PER_GROUP, 10]
    assert file.read()["x"].to_pylist() == list(range(total))


class Refusing(io.RawIOBase):
    """An output that takes the first few bytes alone."""

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        if memoryview(data).nbytes > 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return memoryview(data).nbytes


def test_an_error_of_the_writing_thread_comes_out() -> None:
    sink = ParquetSink(Refusing(), schema := pa.schema([pa.field("x", pa.float64())]))
    noise = np.random.default_rng(1).random(ROWS_PER_GROUP)
    rows = pa.record_batch([pa.array(noise)], schema=schema)
    sink.write(rows)
    with pytest.raises(OSError, match="No space left on device"):
        sink.write(rows)
    sink.abandon()


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    script = f"""
import resource, signal, sys
from pathlib import Path
import numpy as np, pyarrow as pa
from lidarcli.errors import OutputError
from lidarcli.files.newfiles import NewFiles
from lidarcli.tabular.writing import ParquetSink
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))
schema = pa.schema([pa.field("x", pa.float64())])
rows = pa.record_batch([pa.array(np.random.default_rng(1).random({ROWS_PER_GROUP}))], schema=schema)
try:
    path = Path(sys.argv[1])
    with NewFiles([path]) as new, ParquetSink(new.part(path), schema, path) as file:
        for _ in range(5):
            file.write(rows)
        file.finish({{}})
except OutputError as err:
    print(err)
"""
    path = tmp_path / "run.objects.parquet"
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True)
    assert done.stdout == f"cannot write {path}: File too large\n"
    assert list(tmp_path.iterdir()) == []
