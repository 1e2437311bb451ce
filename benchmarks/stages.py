"""Where the time of `lidarcli detect` goes: processor time per sweep of each stage, `stages.py LOG [--repeats N]`.

The clock is that of the thread, which a busy machine changes least. Row groups are encoded by a thread of their own;
their time is what the process has taken beyond this thread.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from lidarcli.formalism import Parameters, detect
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.system.machine import keep_freed_memory
from lidarcli.tabular.columns import objects_rows, sweeps_rows
from lidarcli.tabular.writing import TableFiles, table_metadata, table_paths

T = TypeVar("T")


class Stages:
    """Processor time of named stages, and the sweeps that went through."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.summary = RunSummary()

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Count the time of what is done inside."""
        started = time.thread_time()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.thread_time() - started

    def each(self, name: str, items: Iterator[T]) -> Iterator[T]:
        """Pass the items on and count the time that they take to come."""
        while True:
            with self(name):
                item = next(items, None)
            if item is None:
                return
            yield item


def once(log: Path, parameters: Parameters) -> Stages:
    """One pass over a log: read, normalise, detect, make rows, write."""
    stage = Stages()
    with tempfile.TemporaryDirectory() as folder, open_log(str(log)) as source:
        decoded = stage.each("read and decode", source.scans(None, ReadReport()))
        source.scans = lambda topics, report: decoded  # type: ignore[method-assign]
        process, thread = time.process_time(), time.thread_time()
        paths = table_paths(Path(folder), log.stem, ("objects", "sweeps"))
        with TableFiles(paths, _first_topic(log)) as files:
            for batch in stage.each("batches", read_batches(source, ReadOptions(), ReadReport())):
                with stage("detect"):
                    found = detect(batch, parameters)
                with stage("count"):
                    stage.summary.add_sweeps(batch)
                    stage.summary.add_sets(found)
                with stage("rows"):
                    objects = objects_rows(log.stem, batch, found)
                    sweeps = sweeps_rows(log.stem, batch, found)
                with stage("write"):
                    files.write("objects", batch.topic, objects)
                    files.write("sweeps", batch.topic, sweeps)
            with stage("write"):
                files.publish(table_metadata(parameters.as_dict()))
        stage.seconds["encode, beside"] = time.process_time() - process - (time.thread_time() - thread)
        stage.seconds["batches"] -= stage.seconds["read and decode"]
    return stage


def _first_topic(log: Path) -> str | None:
    with open_log(str(log)) as source:
        return next((block.topic for block in source.scans(None, ReadReport())), None)


def main() -> None:
    """Parse the arguments, measure, print the least of all passes for each stage."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path)
    parser.add_argument("--repeats", type=int, default=3, help="passes (default: %(default)s)")
    parser.add_argument("--profile", choices=("robust", "paper"), default="robust")
    arguments = parser.parse_args()
    keep_freed_memory()
    parameters = Parameters.for_profile(arguments.profile)
    passes = [once(arguments.log, parameters) for _ in range(arguments.repeats)]
    sweeps, objects = passes[0].summary.sweeps, passes[0].summary.objects
    print(f"{sweeps:,} sweeps, {objects / sweeps:.1f} objects per sweep; us per sweep")
    for name in passes[0].seconds:
        print(f"{name:18}{1e6 * min(each.seconds[name] for each in passes) / sweeps:8.2f}")


if __name__ == "__main__":
    main()
