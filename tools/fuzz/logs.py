"""A log goes through everything that reads logs."""

from __future__ import annotations

import io
import json
import shutil
import stat
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow.parquet as pq

from lidarcli.cli.info import as_json, as_text
from lidarcli.cli.messages import MessageWriter, show
from lidarcli.errors import LidarcliError
from lidarcli.logs import open_log
from lidarcli.logs.base import OpenOptions, ReadReport, Slice
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import SlicedLog, Source
from lidarcli.pipeline.inspecting import LogInfo, inspect_log
from lidarcli.pipeline.objects.detection import DetectOptions, TrackOptions
from lidarcli.pipeline.runs.over_logs import INTERNAL_ERROR, attempt, outcome_of
from tools.fuzz.place import Place

TOLD = OpenOptions(angle_min=-1.5, angle_increment=0.125, range_max=8.0, slice=Slice(-0.1, 0.1, 24, (0.1, 8.0)))
"""For the layouts that hold no geometry, and for point clouds."""
LONGEST = 1000
"""Characters of one line that is told to a user."""


def judge_log(place: Place, log: Path, least: int = 0) -> Iterator[str]:
    """What went wrong with a log; where it is read without an error it has to have `least` sweeps at least."""
    yield from _searched(log)
    yield from _inspected(log)
    yield from _detected(log, place.out / "tables", least)
    if stat.S_ISREG(log.lstat().st_mode):
        yield from _streamed(log.read_bytes())


def _searched(log: Path) -> Iterator[str]:
    try:
        find_logs([str(log), str(log.parent)])
    except LidarcliError:
        pass
    except Exception:
        yield f"find_logs: {traceback.format_exc()}"


def _inspected(log: Path) -> Iterator[str]:
    result = attempt(Source(str(log), "run"), lambda source: inspect_log(source, TOLD))
    if isinstance(result, LogInfo):
        yield from odd_lines("info", as_text(result).splitlines())
        json.loads(as_json([result]))
    elif result.exit_code == INTERNAL_ERROR:
        yield f"info: {result.trace}"


def _detected(log: Path, out: Path, least: int) -> Iterator[str]:
    # LogTracker things is all that detection is, and more.
    options = DetectOptions(opening=TOLD, beams=True, tracking=TrackOptions())
    outcome = outcome_of(Source(str(log), "run"), lambda source: detect_to_files(source, out, options))
    if outcome.exit_code == INTERNAL_ERROR:
        yield f"track: {outcome.trace}"
        return
    lines: list[str] = []
    show(outcome, MessageWriter(write=lines.append))
    yield from odd_lines("track", lines)
    if outcome.summary is None:
        if out.exists() and list(out.iterdir()):
            yield "track: refused the log and left tables"
    else:
        rows = pq.ParquetFile(out / "run.sweeps.parquet").metadata.num_rows
        if rows != outcome.summary.sweeps:
            yield f"track: {rows} rows of {outcome.summary.sweeps} sweeps"
        if rows < least and outcome.exit_code == 0:
            yield f"track: exit 0 with {rows} of {least} sweeps"
    shutil.rmtree(out, ignore_errors=True)


def _streamed(data: bytes) -> Iterator[str]:
    """The same bytes from a stream that cannot seek."""
    for part in (None, TOLD.slice):
        try:
            with open_log(_Pipe(data), opening=TOLD) as log:
                read = log if part is None else SlicedLog(log, TOLD, part)
                for _ in read_batches(read, ReadOptions(), ReadReport()):
                    pass
        except LidarcliError:
            pass
        except Exception:
            yield f"stream: {traceback.format_exc()}"


def odd_lines(who: str, lines: Sequence[str], longest: int = LONGEST) -> Iterator[str]:
    """What is told to a user is one line without control characters each, and not endless."""
    for line in lines:
        if not line.isprintable():
            yield f"{who}: says what cannot be printed: {line[:LONGEST]!r}"
        if len(line) > longest:
            yield f"{who}: says {len(line)} characters at once: {line[:200]}"


class _Pipe(io.BytesIO):
    """Bytes that can be read only once, in order."""

    def seekable(self) -> bool:
        return False

    def seek(self, offset: int, whence: int = 0) -> int:
        raise io.UnsupportedOperation("seek")

    def tell(self) -> int:
        raise io.UnsupportedOperation("tell")
