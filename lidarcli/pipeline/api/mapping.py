"""`lidarcli.map`: one map of logs."""

from __future__ import annotations

from typing import Unpack

from lidarcli.errors import warn
from lidarcli.formalism.mapping.occupancy import Occupancy
from lidarcli.pipeline.api.keywords import Mapping, Paths, Reading, defaults_of
from lidarcli.pipeline.api.options import opening_options, pose_options, read_options, several
from lidarcli.pipeline.api.signatures import with_keywords
from lidarcli.pipeline.api.sources import sources_of
from lidarcli.pipeline.detecting import Failed
from lidarcli.pipeline.map_files import MapRun
from lidarcli.pipeline.mapping import MapOptions
from lidarcli.stores.url import place

_READING = defaults_of(Reading)


@with_keywords
def map(log: Paths, output: Paths = (), **options: Unpack[Mapping]) -> Occupancy:
    """One occupancy grid of one or several logs whose sensors moved.

    Parameters
    ----------
    log : as of `read`
    output : files to write, replaced where they exist, each of the kind that its suffix says; by default none

    Returns
    -------
    Occupancy
        `cells` (H, W) int8: -1 unknown, 0 free, 100 occupied; `x`, `y` of the lower left corner and `resolution` [m].

    Raises
    ------
    UnreadableError
        As of `read`, or nothing tells where the sensor was.
    NoScanError, OptionError
        As of `read`.
    OutputError
        A file cannot be written.
    """
    made_with = MapOptions(
        read=read_options(options),
        opening=opening_options(options),
        poses=pose_options(options),
        overwrite=True,
        **{name: value for name, value in options.items() if name not in _READING},  # type: ignore[arg-type]
    )
    sources = sources_of(log)
    failed = Failed(len(sources))
    with MapRun(sources, [place(each) for each in several(output)], made_with) as run:
        for source in sources:
            with failed.noted(source):
                for line in run.add(source).damage:
                    warn(f"{source.path}: {line}")
        failed.conclude()
        mapped = run.finish()
    for note in mapped.notes:
        warn(note)
    return mapped.grid
