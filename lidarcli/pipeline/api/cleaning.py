"""`lidarcli.clean`: a log without what moves in it."""

from __future__ import annotations

from os import fspath
from typing import Unpack

import pyarrow as pa

from lidarcli.choices import SIGNIFICANCE
from lidarcli.errors import warn
from lidarcli.logs.base import OpenOptions
from lidarcli.options import AnyPath, Cleaning, parse_removed, parse_value
from lidarcli.pipeline.api.options import (
    LogOptions,
    Progress,
    Values,
    detect_options,
    path_of,
    pose_options,
    read_options,
    tracking_of,
    watched,
    with_keywords,
)
from lidarcli.pipeline.cleaning import CleanOptions, clean_log
from lidarcli.pipeline.inputs.search import one_log
from lidarcli.pipeline.runs.over_logs import progress_of
from lidarcli.stores import place


@with_keywords
def clean(
    log: AnyPath, output: AnyPath, overwrite: bool = False, *, progress: Progress = False, **options: Unpack[Cleaning]
) -> pa.Table:
    """Write a log once more, bit for bit but for the beams of what moves, and beside it the table `.cleaned.parquet`.

    Parameters
    ----------
    log : MCAP, ROS 1 bag or ROS 2 bag
    output : log to write, in the same container
    overwrite : True to replace files that exist

    Returns
    -------
    pyarrow.Table
        One row per sweep with the beams that were left out, by reason, as the command line writes it (docs/clean.md).

    Raises
    ------
    OptionError
        The log is of another container, or the output is the log.
    UnreadableError, NoScanError
        As of `read`; also where it is not known how the sensor moved.
    OutputError
        A file exists, or cannot be written.
    """
    source = one_log([path_of(log)], False)
    how = clean_options(options, overwrite=overwrite)
    with watched(progress, [source]) as report:
        summary = clean_log(source, place(fspath(output)), how, progress_of(source, report))
    for line in summary.damage:
        warn(f"{source.label}: {line}")
    return summary.table


def clean_options(options: Values, *, overwrite: bool = False) -> CleanOptions:
    """Return which beams are left out, and how they are found."""
    logs = LogOptions(read_options(options), OpenOptions(segments=options["segments"]), pose_options(options))
    tracking = tracking_of({"significance": SIGNIFICANCE, "memory": True})
    remove = options["remove"]
    words = [remove] if isinstance(remove, str) else remove
    if not isinstance(words, list | tuple | set | frozenset) or not all(isinstance(each, str) for each in words):
        raise TypeError(f"remove is a list of words, or one text, not {remove!r}")
    return CleanOptions(
        detect_options({**options, "catalogue": None}, logs, tracking),
        frozenset(word.strip() for word in parse_removed(",".join(words)).split(",")),
        parse_value(str(options["value"])),
        options["margin"],
        overwrite,
    )
