"""Messages as `mcap cat --json` (or `--format=ndjson`) prints them: one per line, of any topics."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from typing import Any

from lidarcli.logs.base import ReadReport, Topic
from lidarcli.logs.cells import time_unit, to_ns
from lidarcli.logs.foxglove import NOT_JSON, NOT_SCAN, ROWS, VALUES, RefusedError, Scan, blocks_of, scan_in, scan_of
from lidarcli.logs.text import JSON_LINE, TextBlock, TextLog
from lidarcli.sweeps import RawSweeps

_SAMPLE = 100
"""Lines by whose times the unit is found."""
_MOST_NAMES = 4096
"""Most topics that are remembered."""
_NO_MESSAGE = "no message of `mcap cat --json`"
_CUT = "the file ends within this line: its message is dropped"


class JsonLinesLog(TextLog):
    """Printed messages from a file or from a stream."""

    format = "json lines"

    def topics(self) -> list[Topic] | None:
        """Return None: nothing lists the topics."""
        return None

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        decoder = _Decoder(topics, report, self._options.echo)
        for block in blocks:
            yield from decoder.feed(block)


class _Decoder:
    """Decodes lines; scans of each topic wait until they fill a block, or until the block of text ends."""

    def __init__(self, topics: Collection[str] | None, report: ReadReport, echo: str) -> None:
        self._topics = topics
        self._echo = echo
        self._report = report
        self._unit: int | None = None
        self._names: dict[bytes, str] = {}
        self._others: set[str] = set()
        """Topics whose first message is no scan."""
        self._scanned: set[str] = set()
        """Topics of which a message was a scan."""
        self._waiting: dict[str, list[Scan]] = {}
        self._rows = self._values = 0

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block, in blocks of each topic."""
        lines = block.text.split(b"\n")[:-1]
        if self._unit is None:
            times = [match[2] for line in lines[:_SAMPLE] if (match := JSON_LINE.match(line))]
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
        """Yield the waiting scans as blocks."""
        for topic, scans in self._waiting.items():
            yield from blocks_of(topic, scans, self._report)
        self._waiting, self._rows, self._values = {}, 0, 0

    def _take(self, line: bytes) -> str | None:
        """Keep the scan of a line; return the cause where the line is no message."""
        match = JSON_LINE.match(line)
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
        if bad[0]:
            return "the time cannot be read"
        message = scan_in(whole["data"])
        if message is not None:
            self._keep(topic, message, line, int(record[0]))
        elif topic in self._scanned:
            self._report.refused[(topic, NOT_SCAN)] += 1
        elif len(self._others) < _MOST_NAMES:
            self._others.add(topic)
        return None

    def _keep(self, topic: str, message: Any, line: bytes, record_ns: int) -> None:
        try:
            scan = scan_of(message, line, record_ns, self._echo)
        except RefusedError as err:
            self._report.refused[(topic, str(err))] += 1
            return
        self._scanned.add(topic)
        self._waiting.setdefault(topic, []).append(scan)
        self._rows += 1
        self._values += len(scan.ranges)

    def _name(self, text: bytes) -> str | None:
        """Return the topic that a piece of JSON names; None where it names none."""
        if text not in self._names:
            if len(self._names) >= _MOST_NAMES:
                self._names.clear()
            try:
                self._names[text] = str(json.loads(text))
            except ValueError:
                return None
        return self._names[text]
