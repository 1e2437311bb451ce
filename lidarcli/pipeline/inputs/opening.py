"""Opening the log that a `Source` stands for, wherever it is."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import Log, OpenOptions
from lidarcli.stores.url import Url, place

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import Source

_TRIED = 3
"""A folder may hold a file or two that are no sweep (a README)."""

_IN_METRES = ("mcap", "ros1 bag", "ros2 bag", "json lines")
"""How the formats begin whose ranges are metres unless an option says otherwise; readers of text know their units."""


@contextmanager
def open_source(source: Source, opening: OpenOptions | None = None) -> Iterator[Log]:
    """The open log of a source, closed in the end; many CSV files with one sweep each are one log.

    Where it is said which points of clouds are sweeps, it has these, too.
    """
    with _opened_source(source, opening) as log:
        scaled = opening is not None and opening.range_scale != 1.0 and log.format.startswith(_IN_METRES)
        if opening is None or (opening.slice is None and not scaled):
            yield log
            return
        from lidarcli.pipeline.inputs.sliced import ScaledLog, SlicedLog

        log = ScaledLog(log, opening.range_scale) if scaled else log
        yield log if opening.slice is None else SlicedLog(log, opening, opening.slice)


@contextmanager
def _opened_source(source: Source, opening: OpenOptions | None) -> Iterator[Log]:
    if (url := source.url) is not None:
        from lidarcli.pipeline.inputs.stored import open_stored

        with open_stored(
            url, [found for file in source.files if isinstance(found := place(file), Url)], opening
        ) as log:
            yield log
        return
    with _of_files(source.files, opening) if source.files else open_log(source.path, opening=opening) as log:
        yield log


def _of_files(files: Sequence[str], opening: OpenOptions | None) -> Log:
    from lidarcli.logs.csv.log import CsvLog

    return CsvLog(files, opening)


def hold_one_sweep_each(files: Sequence[Path | Url]) -> bool:
    """Whether several text files are the sweeps of one log, as far as the first readable one shows."""
    from lidarcli.logs.csv.layouts import PER_SWEEP

    if len(files) < 2:
        return False
    for file in files[:_TRIED]:
        with contextlib.suppress(UnreadableError), _opened(file) as log:
            return PER_SWEEP in log.format
    return False


@contextmanager
def _opened(file: Path | Url) -> Iterator[Log]:
    """One file as a log."""
    if isinstance(file, Url):
        from lidarcli.pipeline.inputs.stored import open_stored

        with open_stored(file, (), None) as log:
            yield log
        return
    with open_log(file) as log:
        yield log
