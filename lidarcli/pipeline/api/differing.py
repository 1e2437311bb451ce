"""`lidarcli.diff`: what changed from run to run."""

from __future__ import annotations

from typing import Unpack

from lidarcli.choices import SIGNIFICANCE
from lidarcli.errors import warn
from lidarcli.option_forms import defaults_of
from lidarcli.options import AnyPath, Diffing, Finding, Paths
from lidarcli.pipeline.api.options import (
    LogOptions,
    Progress,
    Values,
    detect_options,
    log_options,
    paths_of,
    several,
    tracking_of,
    watched,
    with_keywords,
)
from lidarcli.pipeline.differing import Difference, DiffOptions, diff_inputs, inputs_of, refuse_outputs, write_changes
from lidarcli.stores import place


@with_keywords
def diff(
    before: AnyPath,
    *after: AnyPath,
    output: Paths = (),
    overwrite: bool = False,
    progress: Progress = False,
    **options: Unpack[Diffing],
) -> Difference:
    """Find what changed from run to run.

    Parameters
    ----------
    before : a run: a log, a tracks table of `track`, a background, or a map (.yaml of map_server)
    after : one or more later runs, like this
    output : files to write: .parquet or .csv (table of changes), .png (picture)
    overwrite : replace files that exist

    Returns
    -------
    Difference
        `changes`, a pyarrow.Table with a row for each thing and each change of the structure (docs/diff.md), `figures`,
        and `steps`, how each run lies on those before it.

    Raises
    ------
    OptionError
        There are fewer than two runs, or an output is of no known kind.
    UnreadableError
        A run cannot be read, or does not lie on those before it, or does so in several ways or anywhere along its walls.
    NoScanError
        As of `read`.
    OutputError
        An output exists, or cannot be written.
    """
    how = diff_options(options, log_options(options), overwrite=overwrite)
    inputs = inputs_of(paths_of([before, *after]))
    outputs = [place(each) for each in several(output)]
    refuse_outputs(outputs, inputs, how)
    with watched(progress, [one.source for one in inputs if one.source is not None]) as report:
        found = diff_inputs(inputs, how, report)
    for line in found.damage:
        warn(line)
    write_changes(found, outputs, overwrite)
    return found


def diff_options(told: Values, logs: LogOptions, *, overwrite: bool = False) -> DiffOptions:
    """Return how runs are compared."""
    tracking = tracking_of({"significance": SIGNIFICANCE, "memory": True, "trajectories": False})
    detect = detect_options({**defaults_of(Finding), **told}, logs, tracking)
    return DiffOptions(detect, told["align"], told["min_score"], overwrite)
