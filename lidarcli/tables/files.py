"""The tables of one log as files that appear together, only when all of them are whole."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import pyarrow as pa

from lidarcli.errors import OutputError
from lidarcli.tables.order import TopicOrder
from lidarcli.tables.parquet import PartFile, unwritable
from lidarcli.tables.schemas import SCHEMAS


def table_path(folder: Path, log: str, table: str) -> Path:
    """`DIR/<log>.<table>.parquet`; `log` may hold the folders below the one that was given."""
    return folder / f"{log}.{table}.parquet"


def refuse_existing(paths: Sequence[Path]) -> None:
    """Refuse to overwrite: `OutputError` naming the first file that exists."""
    for path in paths:
        if path.exists():
            raise OutputError(f"{path} exists; use --overwrite to replace it, or -o DIR to write elsewhere")


class TableFiles:
    """Writers of the named tables of one log; leaving without `publish` leaves no file."""

    def __init__(self, folder: Path, log: str, tables: Sequence[str], first_topic: str | None) -> None:
        self.paths = [table_path(folder, log, table) for table in tables]
        self._files: list[PartFile] = []
        self._orders: dict[str, TopicOrder] = {}
        with ExitStack() as stack:
            for table, path in zip(tables, self.paths, strict=True):
                _make_folder(path.parent)
                file = PartFile(path, SCHEMAS[table])
                stack.push(file)
                file.open()
                order = TopicOrder(file, SCHEMAS[table], first_topic, path.parent)
                self._files.append(file)
                self._orders[table] = stack.enter_context(order)
            self._stack = stack.pop_all()

    def write(self, table: str, topic: str, rows: pa.RecordBatch) -> None:
        """Take rows of one topic for one table."""
        self._orders[table].write(topic, rows)

    def publish(self, metadata: dict[bytes, bytes]) -> None:
        """Make every table whole, then give all of them their names."""
        for order, file in zip(self._orders.values(), self._files, strict=True):
            order.drain()
            file.hand_over()
        for file in self._files:
            file.finish(metadata)
        for file in self._files:
            file.publish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)


def _make_folder(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"cannot write below {folder}: it is not a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise unwritable(folder, err) from err
