"""What `mcap cat --json` (or `--format=ndjson`) prints: one message per line, of any topics."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from lidarcli.logs.base import MAX_BEAMS, Message, ReadReport, Topic
from lidarcli.logs.blocks import TOO_MANY, split_rows
from lidarcli.logs.foxglove import NOT_JSON, ROWS, VALUES, RefusedError
from lidarcli.logs.jsonlines.scans import NOT_SCAN, Scan, block_of, is_scan, scan_of
from lidarcli.logs.jsonlines.words import BEGINS
from lidarcli.logs.text import TextBlock
from lidarcli.logs.textlog import Poses, Sweeps, TextLog
from lidarcli.logs.times import time_unit, to_ns
from lidarcli.sweeps import RawSweeps

_SAMPLE = 100
"""Lines by whose times their unit is told."""
_MOST_NAMES = 4096
"""Topics that are remembered."""
_NO_MESSAGE = "no message of `mcap cat --json`"
_CUT = "the file ends within this line: its message is dropped"


class JsonLinesLog(TextLog):
    """Printed messages from a file or from a stream."""

    format = "json lines"

    def topics(self) -> list[Topic] | None:
        """Nothing lists them."""
        return None

    def _sweeps(self, topics: Collection[str] | None, report: ReadReport) -> Sweeps:
        return _Decoder(topics, report, self._options.echo)

    def _poses(self, types: Collection[str], report: ReadReport) -> Poses:
        return _NoPoses()


class _NoPoses:
    """Poses in JSON are passed over."""

    def feed(self, block: TextBlock) -> Iterator[Message]:
        return iter(())

    def finish(self) -> Iterator[Message]:
        return iter(())


class _Decoder:
    """Lines in, sweeps out; scans of each topic wait until they are a block, or until that of the text ends."""

    def __init__(self, topics: Collection[str] | None, report: ReadReport, echo: str) -> None:
        self._topics = topics
        self._echo = echo
        self._report = report
        self._unit: int | None = None
        self._names: dict[bytes, str] = {}
        self._others: set[str] = set()
        """Topics whose first message is no scan ..."""
        self._scanned: set[str] = set()
        """... and those of which one was."""
        self._waiting: dict[str, list[Scan]] = {}
        self._rows = self._values = 0

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """The sweeps of a block, in blocks of each topic."""
        lines = block.text.split(b"\n")[:-1]
        if self._unit is None:
            times = [match[2] for line in lines[:_SAMPLE] if (match := BEGINS.match(line))]
            self._unit = time_unit("", times) if times else None
        for number, line in enumerate(lines, block.line):
            if not line.strip():
                continue
            last = block.cut and number == block.line + block.lines - 1
            if (cause := self._take(line)) is not None:
                self._report.add_damage(f"line {number}", _CUT if last else cause)
            if self._values >= VALUES or self._rows >= ROWS:
                yield from self._flush()
        yield from self._flush()

    def _flush(self) -> Iterator[RawSweeps]:
        """What waits."""
        for topic, scans in self._waiting.items():
            counts = np.array([len(scan.sweep.ranges) for scan in scans], np.int32)
            for rows in split_rows(counts):
                if (block := block_of(topic, scans[rows], self._report)) is not None:
                    yield block
        self._waiting, self._rows, self._values = {}, 0, 0

    def _take(self, line: bytes) -> str | None:
        """Keep the scan of a line; why it is no message, where it is none."""
        match = BEGINS.match(line)
        if match is None or self._unit is None:
            return _NO_MESSAGE
        topic = self._name(match[1])
        if topic is None:
            return NOT_JSON
        if topic in self._others or (self._topics is not None and topic not in self._topics):
            return None
        record, bad = to_ns([match[2]], self._unit)
        try:
            whole = json.loads(line)
        except (ValueError, RecursionError):
            return NOT_JSON
        if "data" not in whole:
            return _NO_MESSAGE
        if bad is not None:
            return "the time cannot be read"
        message = whole["data"]
        if is_scan(message):
            self._keep(topic, message, line, int(record[0]))
        elif topic in self._scanned:
            self._report.refused[(topic, NOT_SCAN)] += 1
        elif len(self._others) < _MOST_NAMES:
            self._others.add(topic)
        return None

    def _keep(self, topic: str, message: Any, line: bytes, record_ns: int) -> None:
        try:
            scan = scan_of(message, line, record_ns, self._echo)
            if len(scan.sweep.ranges) > MAX_BEAMS:
                raise RefusedError(TOO_MANY)
        except RefusedError as err:
            self._report.refused[(topic, str(err))] += 1
            return
        self._scanned.add(topic)
        self._waiting.setdefault(topic, []).append(scan)
        self._rows += 1
        self._values += len(scan.sweep.ranges)

    def _name(self, text: bytes) -> str | None:
        """The topic that a piece of JSON names; None where it names none."""
        if text not in self._names:
            if len(self._names) >= _MOST_NAMES:
                self._names.clear()
            try:
                self._names[text] = str(json.loads(text))
            except ValueError:
                return None
        return self._names[text]
