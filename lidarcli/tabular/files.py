"""The tables of one log as files that appear together, only when all of them are whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import pyarrow as pa

from lidarcli.newfiles import WholeFiles, new_files, refuse_lost
from lidarcli.stores.url import Place
from lidarcli.tabular.order import TopicOrder
from lidarcli.tabular.parquet import TableFile
from lidarcli.tabular.schemas import SCHEMAS

BY_TABLE, BY_DATE = "table", "date"
"""Layouts beside that of files with the name of their log: a folder for each table, and in it one for each day."""
NO_DATE = "__HIVE_DEFAULT_PARTITION__"
"""What readers of partitioned folders call the day of a log without a sweep."""


def table_suffix(table: str) -> str:
    """How the names of files of a table end, after the name of their log."""
    return f".{table}.parquet"


def table_path(
    folder: Place, log: str, table: str, layout: str | None = None, date: str | None = None
) -> Place:
    """`DIR/<log>.<table>.parquet`; `log` may hold the folders below the one that was given.

    >>> table_path(Path("out"), "trip/run", "objects", BY_DATE, "2026-11-22").as_posix()
    'out/objects/date=2026-11-22/trip/run.parquet'
    """
    if layout is None:
        return folder / f"{log}{table_suffix(table)}"
    day = f"date={date or NO_DATE}/" if layout == BY_DATE else ""
    return folder / table / f"{day}{log}.parquet"


def table_paths(
    folder: Place, log: str, tables: Sequence[str], layout: str | None = None, date: str | None = None
) -> dict[str, Place]:
    """Table → where that of one log belongs, as of `table_path`."""
    return {table: table_path(folder, log, table, layout, date) for table in tables}


class TableFiles:
    """Writers of the named tables of one log; leaving without `publish` leaves no file.

    Parameters
    ----------
    paths : table → where it belongs
    first_topic : the topic that sorts first, where that is known
    overwrite : whether files that are there may be replaced
    """

    def __init__(self, paths: Mapping[str, Place], first_topic: str | None, overwrite: bool = True) -> None:
        self.paths = tuple(paths.values())
        self.sizes: list[int] = []
        """Bytes of each file, once it is published."""
        self._new: dict[Place, WholeFiles] = {}
        self._files: list[TableFile] = []
        self._orders: dict[str, TopicOrder] = {}
        with ExitStack() as stack:
            for folder in dict.fromkeys(path.parent for path in paths.values()):
                new = new_files([path for path in paths.values() if path.parent == folder], overwrite)
                stack.callback(new.close)
                new.open()
                self._new[folder] = new
            for table, path in paths.items():
                file = TableFile(self._new[path.parent].part(path), SCHEMAS[table], path)
                stack.push(file)
                file.open()
                spill = path.parent if isinstance(path, Path) else None
                order = TopicOrder(file, SCHEMAS[table], first_topic, spill)
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
        self.sizes = [self._new[path.parent].part(path).stat().st_size for path in self.paths]
        return [note for new in self._new.values() for note in new.publish()]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)
        for folder in self._new:
            if isinstance(folder, Path):
                refuse_lost(error, folder)
