"""`lidarcli.read`: the sweeps of logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Unpack

from lidarcli.errors import warn
from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.api.keywords import Paths, Reading
from lidarcli.pipeline.api.options import opening_options, pose_options, read_options
from lidarcli.pipeline.api.signatures import with_keywords
from lidarcli.pipeline.api.sources import sources_of
from lidarcli.pipeline.detecting import Failed
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.reading.one_log import damage_lines
from lidarcli.pipeline.reading.pose_sources import PoseOptions
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.sweeps import SweepBatch


@with_keywords
def read(log: Paths, **options: Unpack[Reading]) -> Iterator[SweepBatch]:
    """Batches of sweeps of one or more logs in any format, log after log.

    A damaged part is warned of and left out.

    Parameters
    ----------
    log : file, ROS 2 bag folder, folder to search, pattern, URL, or `-` for standard input; or several of them

    Returns
    -------
    Iterator of SweepBatch
        Each holds sweeps of one topic, in the order of the log.

    Raises
    ------
    UnreadableError
        There is no such file, or no log in it: at the call where nothing is there, else when it is read.
    NoScanError
        There is no LaserScan in a log, or not the topic that was asked for.
    OptionError
        A value has no meaning.
    """
    return _batches(sources_of(log), read_options(options), opening_options(options), pose_options(options))


def _batches(
    sources: Sequence[Source], options: ReadOptions, opening: OpenOptions, poses: PoseOptions
) -> Iterator[SweepBatch]:
    failed = Failed(len(sources))
    for source in sources:
        with failed.noted(source), open_source(source, opening) as log:
            posing = Posing.of(log, poses, options.topics, options.rules)
            report = ReadReport()
            is_empty = True
            for batch in read_batches(log, options, report):
                is_empty = False
                yield replace(posing.attach(batch), log=source.name)
            # Notes are for reading, but a log without a sweep needs its reason, and ranges that are none theirs.
            notes = [*(report.notes if is_empty else []), *report.doubted()]
            for line in [*damage_lines(posing.together(report)), *notes]:
                warn(f"{source.path}: {line}")
    failed.conclude()
