"""One case: a log goes through everything that reads it, and what is not allowed to happen is told."""

from __future__ import annotations

import io
import json
import resource
import shutil
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import pyarrow.parquet as pq

from lidarcli.cli.info_text import as_json, as_text
from lidarcli.cli.messages import Messages
from lidarcli.cli.summary import show
from lidarcli.errors import LidarcliError
from lidarcli.logs import open_log
from lidarcli.logs.base import CsvOptions
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.detecting import DetectOptions, detect_to_files
from lidarcli.pipeline.inputs import Source, find_logs
from lidarcli.pipeline.inspecting import LogInfo, inspect_log
from lidarcli.pipeline.many import INTERNAL_ERROR, attempt, outcome_of

CSV = CsvOptions(angle_min=-1.5, angle_increment=0.125, range_max=8.0)
"""For the layouts that hold no geometry."""
SECONDS = 5.0
"""Processor time that a case may take: more counts as a hang."""
PEAK_MB = 640.0
"""Resident memory of the process that reads; without any log it has 200 to 250 MB."""
RSS_UNIT = 1 if sys.platform == "darwin" else 1024


def judge(log: Path, scratch: Path) -> list[str]:
    """What went wrong with a log that lies in a folder of its own; `scratch` is for its tables."""
    before = _content(log.parent)
    started = time.process_time()
    problems = [
        *_searched(log),
        *_inspected(log),
        *_detected(log, scratch),
        *(_streamed(log.read_bytes()) if log.is_file() else ()),
    ]
    seconds = time.process_time() - started
    if seconds > SECONDS:
        problems.append(f"took {seconds:.1f} s")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * RSS_UNIT / 1e6
    if peak > PEAK_MB:
        problems.append(f"took {peak:.0f} MB of memory")
    if _content(log.parent) != before:
        problems.append("changed the folder of the log")
    if left := sorted(path.name for path in scratch.iterdir()):
        problems.append(f"left temporary files: {', '.join(left)}")
    problems += [f"left open: {name}" for folder in (log.parent, scratch) for name in _open_files(folder)]
    return problems


def _content(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def _open_files(folder: Path) -> list[str]:
    """Files below a folder that this process has open, where the system tells."""
    handles = Path("/proc/self/fd")
    if not handles.exists():
        return []
    targets = []
    for handle in handles.iterdir():
        with suppress(OSError):
            targets.append(str(handle.readlink()))
    return sorted(target for target in targets if target.startswith(str(folder)))


def _searched(log: Path) -> Iterator[str]:
    try:
        find_logs([str(log), str(log.parent)])
    except LidarcliError:
        pass
    except Exception:
        yield f"find_logs: {traceback.format_exc()}"


def _inspected(log: Path) -> Iterator[str]:
    result = attempt(Source(str(log), "run"), lambda source: inspect_log(source, CSV))
    if isinstance(result, LogInfo):
        yield from _odd_lines("info", as_text(result).splitlines())
        json.loads(as_json([result]))
    elif result.exit_code == INTERNAL_ERROR:
        yield f"info: {result.trace}"


def _detected(log: Path, scratch: Path) -> Iterator[str]:
    out = scratch / "out"
    options = DetectOptions(csv=CSV, beams=True)
    outcome = outcome_of(Source(str(log), "run"), lambda source: detect_to_files(source, out, options))
    if outcome.exit_code == INTERNAL_ERROR:
        yield f"detect: {outcome.trace}"
        return
    lines: list[str] = []
    show(outcome, Messages(write=lines.append))
    yield from _odd_lines("detect", lines)
    if outcome.summary is None:
        if out.exists() and list(out.iterdir()):
            yield "detect: refused the log and left tables"
    else:
        rows = pq.ParquetFile(out / "run.sweeps.parquet").metadata.num_rows
        if rows != outcome.summary.sweeps:
            yield f"detect: {rows} rows of {outcome.summary.sweeps} sweeps"
    shutil.rmtree(out, ignore_errors=True)


def _streamed(data: bytes) -> Iterator[str]:
    """The same bytes from a stream that cannot seek."""
    try:
        with open_log(_Pipe(data), csv=CSV) as log:
            for _ in read_batches(log, ReadOptions()):
                pass
    except LidarcliError:
        pass
    except Exception:
        yield f"stream: {traceback.format_exc()}"


def _odd_lines(who: str, lines: Sequence[str]) -> Iterator[str]:
    """What is told to a user is one line without control characters each, and not endless."""
    for line in lines:
        if not line.isprintable():
            yield f"{who}: says what cannot be printed: {line!r}"
        if len(line) > 1000:
            yield f"{who}: says {len(line)} characters at once: {line[:200]}"


class _Pipe(io.BytesIO):
    """Bytes that can be read only once, in order."""

    def seekable(self) -> bool:
        return False

    def seek(self, offset: int, whence: int = 0) -> int:
        raise io.UnsupportedOperation("seek")

    def tell(self) -> int:
        raise io.UnsupportedOperation("tell")
