"""Opening the log that a `Source` stands for."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import CsvOptions, Log

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import Source

_TRIED = 3
"""A folder may hold a file or two that are no sweep (a README)."""


def open_source(source: Source, csv: CsvOptions | None = None) -> Log:
    """The open log of a source; many CSV files with one sweep each are one log."""
    if source.files:
        from lidarcli.logs.csv.log import CsvLog

        return CsvLog(source.files, csv)
    return open_log(source.path, csv=csv)


def hold_one_sweep_each(files: Sequence[Path]) -> bool:
    """Whether several text files are the sweeps of one log, as far as the first readable one shows."""
    from lidarcli.logs.csv.layouts import PER_SWEEP

    if len(files) < 2:
        return False
    for file in files[:_TRIED]:
        with contextlib.suppress(UnreadableError), open_log(file) as log:
            return PER_SWEEP in log.format
    return False
