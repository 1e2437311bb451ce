"""The tables of one log as files that appear together, only when all of them are whole."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import pyarrow as pa

from lidarcli.newfiles import NewFiles
from lidarcli.tables.order import TopicOrder
from lidarcli.tables.parquet import TableFile
from lidarcli.tables.schemas import SCHEMAS


def table_suffix(table: str) -> str:
    """How the names of files of a table end, after the name of their log."""
    return f".{table}.parquet"


def table_path(folder: Path, log: str, table: str) -> Path:
    """`DIR/<log>.<table>.parquet`; `log` may hold the folders below the one that was given."""
    return folder / f"{log}{table_suffix(table)}"


class TableFiles:
    """Writers of the named tables of one log; leaving without `publish` leaves no file."""

    def __init__(
        self, folder: Path, log: str, tables: Sequence[str], first_topic: str | None, overwrite: bool = True
    ) -> None:
        self.paths = [table_path(folder, log, table) for table in tables]
        self._new = NewFiles(self.paths, overwrite)
        self._files: list[TableFile] = []
        self._orders: dict[str, TopicOrder] = {}
        with ExitStack() as stack:
            stack.callback(self._new.close)
            self._new.open()
            for table, path in zip(tables, self.paths, strict=True):
                file = TableFile(self._new.part(path), SCHEMAS[table], path)
                stack.push(file)
                file.open()
                order = TopicOrder(file, SCHEMAS[table], first_topic, path.parent)
                self._files.append(file)
                self._orders[table] = stack.enter_context(order)
            self._stack = stack.pop_all()

    def write(self, table: str, topic: str, rows: pa.RecordBatch) -> None:
        """Take rows of one topic for one table."""
        self._orders[table].write(topic, rows)

    def publish(self, metadata: dict[bytes, bytes]) -> list[str]:
        """Make every table whole, then give all of them their names; notes as of `NewFiles.publish`."""
        for order, file in zip(self._orders.values(), self._files, strict=True):
            order.drain()
            file.hand_over()
        for file in self._files:
            file.finish(metadata)
        return self._new.publish()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)
