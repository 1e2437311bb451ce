"""`lidarcli.detect` and `lidarcli.track`: objects, and the things that they belong to."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from os import PathLike
from typing import TYPE_CHECKING, Any, Unpack

import pyarrow as pa

from lidarcli.formalism import Parameters
from lidarcli.pipeline.api.keywords import Detecting, Paths, Reading, Tracking, defaults_of
from lidarcli.pipeline.api.options import (
    GivenPaths,
    background_options,
    catalogue_of,
    opening_options,
    parameters_of,
    pose_options,
    read_options,
)
from lidarcli.pipeline.api.signatures import with_keywords
from lidarcli.pipeline.api.sources import sources_of
from lidarcli.pipeline.detecting import TrackTables, of_batches, of_logs
from lidarcli.pipeline.objects.options import DetectOptions
from lidarcli.sweeps import SweepBatch

if TYPE_CHECKING:
    from lidarcli.pipeline.objects.following import TrackOptions

LogsOrBatches = Paths | SweepBatch | Iterable[SweepBatch]
_UNASKED = defaults_of(Reading) | {"jobs": None}
"""What says nothing of how a log is read."""


@with_keywords
def detect(
    log: LogsOrBatches, parameters: Parameters | None = None, **options: Unpack[Detecting]
) -> pa.Table:
    """The objects of every sweep as a table.

    Parameters
    ----------
    log : logs as of `read`, each of which is a log of its own in the table; or a batch, or batches (of one topic, or in
        order of topics)
    parameters : replaces the keywords from `profile` to `walls`

    Returns
    -------
    pyarrow.Table
        One row per object per sweep (docs/tables.md); `.to_pandas()` makes a data frame of it.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    """
    tracking = None
    if options["memory"]:
        # Who does not track does not wait for this import.
        from lidarcli.pipeline.objects.following import TrackOptions

        tracking = TrackOptions(tracks=False)
    return found(log, ("objects",), parameters, options, tracking)["objects"]


@with_keywords
def track(
    log: LogsOrBatches, parameters: Parameters | None = None, **options: Unpack[Tracking]
) -> TrackTables:
    """The objects and the sweeps of every log, and the things that its objects belong to, as tables.

    Parameters
    ----------
    log : as of `detect`; batches of a log and topic have to come in the order of the log
    parameters : replaces the keywords from `profile` to `walls`

    Returns
    -------
    TrackTables
        `objects`, `sweeps` and `tracks`, each a pyarrow.Table as the command line writes it (docs/tables.md).

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    """
    return TrackTables(**found(log, TrackTables._fields, parameters, options, tracking_of(options)))


def tracking_of(told: GivenPaths) -> TrackOptions:
    """How things are followed."""
    # Who does not track does not wait for these imports.
    from lidarcli.formalism.parameters import TrackParameters
    from lidarcli.pipeline.objects.following import TrackOptions

    return TrackOptions(TrackParameters(significance=told["significance"], memory=told["memory"]))


def found(
    log: Any,
    tables: Sequence[str],
    parameters: Parameters | None,
    told: GivenPaths,
    tracking: TrackOptions | None,
) -> dict[str, pa.Table]:
    """Some tables of logs or of batches, by their names."""
    background = background_options(told)
    options = DetectOptions(
        parameters=parameters_of(parameters, told, subtracted=background is not None),
        read=read_options(told),
        opening=opening_options(told),
        poses=pose_options(told),
        background=background,
        catalogue=catalogue_of(told["catalogue"]),
        tracking=tracking,
        explain=told["explain"],
        jobs=told["jobs"] or 0,
    )
    items: Iterator[Any] = iter([log] if isinstance(log, str | PathLike | SweepBatch) else log)
    first = next(items, None)
    if not isinstance(first, SweepBatch):
        return of_logs(sources_of([] if first is None else [first, *items]), tables, options)
    if asked := [name for name, value in _UNASKED.items() if told[name] != value]:
        raise TypeError(f"only a log can be read with {', '.join(asked)}")
    return of_batches(chain([first], items), tables, options)
