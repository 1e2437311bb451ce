"""`lidarcli.tables`: all tables of logs as data frames."""

from __future__ import annotations

from typing import NamedTuple, Unpack

import pandas as pd
import pyarrow as pa

from lidarcli.formalism import Parameters
from lidarcli.pipeline.api.finding import LogsOrBatches, found, tracking_of
from lidarcli.pipeline.api.keywords import Tabling
from lidarcli.pipeline.api.signatures import with_keywords


class Tables(NamedTuple):
    """The tables of logs as pandas data frames, with the columns of docs/tables.md."""

    objects: pd.DataFrame
    """One row per object per sweep."""
    sweeps: pd.DataFrame
    """One row per sweep."""
    tracks: pd.DataFrame
    """One row per thing."""
    beams: pd.DataFrame | None = None
    """One row per beam of each sweep, where that was asked for."""


@with_keywords
def tables(log: LogsOrBatches, parameters: Parameters | None = None, **options: Unpack[Tabling]) -> Tables:
    """All tables of one or more logs as pandas data frames: what `track` finds.

    Stamps are `datetime64[ns, UTC]`, names (log, topic, set, shape, label) categories, whole numbers `Int64` or
    `Int32`, truths `boolean`, and vertices and faces lists of dicts.

    Parameters
    ----------
    log : as of `track`
    parameters : replaces the keywords from `profile` to `walls`

    Returns
    -------
    Tables
        `objects`, `sweeps`, `tracks` and, with `beams=True`, `beams`: each a pandas.DataFrame.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    """
    names = ("objects", "sweeps", "tracks", *(["beams"] if options["beams"] else []))
    made = found(log, names, parameters, options, tracking_of(options))
    return Tables(**{name: _frame(table) for name, table in made.items()})


# Numbers and truths that may be missing: numpy would make fractions of one, and objects of the other.
_NULLABLE = {pa.int32(): pd.Int32Dtype(), pa.int64(): pd.Int64Dtype(), pa.bool_(): pd.BooleanDtype()}


def _frame(table: pa.Table) -> pd.DataFrame:
    """A data frame whose types depend on the schema alone, not on what is missing."""
    frame: pd.DataFrame = table.to_pandas(types_mapper=_NULLABLE.get)
    return frame
