"""The MCAP reader: files with and without an index, cut-off ones, and pipes, on one path.

Records are walked in file order, whatever the index says: an index only saves work (`records.stretches`,
`McapLog._pass`), so that a missing, partial or lying one loses nothing. One chunk is held at a time; a chunk that
declares more than 1 GiB (`records.MAX_CHUNK`) is refused.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs import foxglove
from lidarcli.logs.base import MULTI_ECHO, SCAN_TYPES, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.blocks import Locate, ScanLayout
from lidarcli.logs.laserscan import EXPECTED, Gather, differs, locate, scan_type
from lidarcli.logs.mcap.records import Cursor, Messages
from lidarcli.logs.mcap.walk import MAGIC, Catalogue, Summary, Walker, index_is_complete, read_summary
from lidarcli.logs.unpacking import PACKED_CAUSE, ZSTD_MAGIC, Unpacking, unpack_message
from lidarcli.sweeps import RawSweeps

STRIPPED_MAGIC = b"\x89MCAP0\n"
TOGETHER = 64
"""Messages of one topic that are decoded where they lie; fewer are gathered from several chunks first."""

_UNKNOWN = -2
_UNWANTED = -1
_CHANNELS = 1 << 16


@dataclass(slots=True)
class _Columns:
    """Decoder by column of a LaserScan topic in cdr or ros1."""

    gather: Gather

    unpacking: Unpacking
    """Limit for the whole log."""

    def locate(self, message: bytes) -> ScanLayout | None:
        """Return where the ranges of a message stand; None where it is no sweep."""
        return locate(message, self.gather.encoding, several=self.gather.type == MULTI_ECHO)

    def decode(self, rows: Messages) -> Iterator[RawSweeps]:
        packed = _are_packed(rows)
        if len(rows) >= TOGETHER and not packed:
            yield from self.gather.decode(rows.data, rows.start, rows.length, rows.log_ns)
            return
        for data, log_ns in zip(_payloads(rows), rows.log_ns.tolist(), strict=True):
            plain = unpack_message(data, self.unpacking) if packed else data
            if plain is None:
                self.gather.report.refused[(self.gather.topic, PACKED_CAUSE)] += 1
            elif self.gather.add(plain, log_ns):
                yield from self.gather.flush()

    def flush(self) -> Iterator[RawSweeps]:
        yield from self.gather.flush()


@dataclass(slots=True)
class _OneByOne:
    """Decoder message by message of a topic in JSON or protobuf."""

    topic: str
    decoder: foxglove.Decoder
    report: ReadReport
    locate: Locate | None = None
    """Finds the ranges of a message; None for JSON, where numbers have no place of their own."""
    waiting: list[tuple[int, bytes]] = field(default_factory=list)

    def decode(self, rows: Messages) -> Iterator[RawSweeps]:
        self.waiting += zip(rows.log_ns.tolist(), _payloads(rows), strict=True)
        if len(self.waiting) >= TOGETHER:
            yield from self.flush()

    def flush(self) -> Iterator[RawSweeps]:
        waiting, self.waiting = self.waiting, []
        yield from foxglove.decode_each(self.topic, waiting, self.decoder, self.report)


def _refuse(_data: bytes, _record_ns: int, *, cause: str) -> foxglove.Scan:
    """Decode no message of a topic."""
    raise foxglove.RefusedError(cause)


def _are_packed(rows: Messages) -> bool:
    """Return True if a ROS 2 bag has compressed its messages: all or none; plain ones never begin as zstd does."""
    if not len(rows):
        return False
    start = int(rows.start[0])
    return rows.data[start : start + min(len(ZSTD_MAGIC), int(rows.length[0]))].tobytes() == ZSTD_MAGIC


def _payloads(rows: Messages) -> Iterator[bytes]:
    data = rows.data.data
    for start, end in zip(rows.start.tolist(), (rows.start + rows.length).tolist(), strict=True):
        yield data[start:end].tobytes()


@dataclass(slots=True)
class _Wanted:
    """Channels that a pass reads. `choose` gives a channel a group number, or `_UNWANTED`."""

    catalogue: Catalogue
    choose: Callable[[int], int]
    table: NDArray[np.int32] = field(default_factory=lambda: np.full(_CHANNELS, _UNKNOWN, np.int32))
    changes: int = -1

    def groups(self) -> NDArray[np.int32]:
        """Return the group of every channel id known so far."""
        if self.changes != self.catalogue.changes:
            self.changes = self.catalogue.changes
            for channel in self.catalogue.channels:
                if self.table[channel] == _UNKNOWN and self.catalogue.knows(channel):
                    self.table[channel] = self.choose(channel)
        return self.table


class McapLog:
    """An MCAP as a `Log`: a file by its path, or a binary stream.

    A stream of known `size` [bytes] is read here and there, as a file is; any other once, in order.
    """

    def __init__(
        self,
        source: str | Path | BinaryIO,
        options: OpenOptions | None = None,
        name: str | None = None,
        size: int | None = None,
    ) -> None:
        self._echo = (options or OpenOptions()).echo
        self.format = "mcap"
        self.compression = "none"
        self.size = size
        self._opening = ReadReport()
        self._used = False
        self._unpacking = Unpacking()
        """Limit for messages compressed one by one."""
        self._topics: list[Topic] | None = None
        if isinstance(source, str | Path):
            self.path = name or str(source)
            try:
                self._stream: BinaryIO = Path(source).open("rb", buffering=0)  # noqa: SIM115
                self.size = self._stream.seek(0, 2)
                self._stream.seek(0)
            except OSError as err:
                raise UnreadableError(f"{self.path}: cannot be opened: {err.strerror}") from err
        else:
            self.path = name or "-"
            self._stream = source
        self._source = Cursor(self._stream, self.size)
        try:
            with unreadable(self.path):
                self._begin()
        except UnreadableError:
            self.close()
            raise

    def _begin(self) -> None:
        """Check the magic and read the summary, if there is one."""
        head = self._source.peek(len(MAGIC) + 1)[: len(MAGIC) + 1]
        if head.startswith(STRIPPED_MAGIC):
            raise UnreadableError(
                f"{self.path}: an MCAP whose carriage-return bytes were stripped, typically by git's autocrlf; "
                "the log is damaged throughout and must be fetched again as a binary file"
            )
        if not head.startswith(MAGIC):
            what = "is empty" if not head else "is not an MCAP: its first bytes are not the MCAP magic"
            raise UnreadableError(f"{self.path}: {what}")
        if len(head) == len(MAGIC):
            raise UnreadableError(f"{self.path}: an MCAP of its magic alone, without a record")
        self._summary: Summary | None = read_summary(self._source, self._opening)
        self._catalogue = self._summary.catalogue if self._summary is not None else Catalogue()
        if self._summary is not None:
            kinds = dict.fromkeys(chunk.compression or "none" for chunk in self._summary.chunks)
            self.compression = "+".join(kinds) or "none"

    @property
    def position(self) -> int:
        """Position of the last pass [bytes]."""
        return self._source.position

    def topics(self) -> list[Topic] | None:
        """Return all topics: from the summary, or by a pass over a file that has none; None for a stream."""
        if self._topics is None and self.size is not None:
            summary = self._summary
            if summary is not None and summary.sane:
                self._topics = self._listed(summary.counts)
            else:
                self._topics = self._listed(self._count())
        return None if self._topics is None else list(self._topics)

    def _listed(self, counts: Mapping[int, int] | None) -> list[Topic]:
        """Return the topics of the catalogue; several channels (publishers) of one topic are one."""
        known = self._catalogue
        messages: dict[tuple[str, str, str, str], int] = {}
        for key, channel in known.channels.items():
            topic = (channel.topic, known.type(key), channel.message_encoding, self._read_as(key))
            messages[topic] = messages.get(topic, 0) + (counts or {}).get(key, 0)
        return [Topic(*topic[:3], count if counts is not None else None, topic[3]) for topic, count in messages.items()]

    def _read_as(self, key: int) -> str:
        """Return the type as which the messages of a channel are read as sweeps; empty where they are none."""
        definition, kind = self._catalogue.schema(key), self._catalogue.type(key)
        if definition is None or kind in SCAN_TYPES:
            return kind
        return scan_type(kind, definition.encoding, definition.data.decode("utf-8", "replace"))

    def _count(self) -> Counter[int]:
        """Count messages by channel, from chunk indexes where possible; damage is left to reading."""
        counts: Counter[int] = Counter()

        def skip(_place: int, index: Mapping[int, int]) -> bool:
            if not all(map(self._catalogue.knows, index)):
                return False
            counts.update(index)
            return True

        for part in self._walker(ReadReport(), skip).parts():
            channels, seen = np.unique(part.channel, return_counts=True)
            counts.update(dict(zip(channels.tolist(), seen.tolist(), strict=True)))
        return counts

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in file order within each topic."""
        decoders: list[_Columns | _OneByOne] = []
        numbers: dict[tuple[str, str, str, int], int] = {}

        def choose(key: int) -> int:
            channel, type_name = self._catalogue.channels[key], self._catalogue.type(key)
            if topics is not None and channel.topic not in topics:
                return _UNWANTED
            # Publishers share a group, so that their sweeps stay in the order of the log; protobuf brings its own types.
            own_types = channel.schema_id if channel.message_encoding == "protobuf" else 0
            group = (channel.topic, type_name, channel.message_encoding, own_types)
            if group not in numbers:
                decoder = self._decoder(key, report)
                if decoder is None:
                    return _UNWANTED
                numbers[group] = len(decoders)
                decoders.append(decoder)
            return numbers[group]

        for number, rows in self._pass(choose, report):
            yield from decoders[number].decode(rows)
        for decoder in decoders:
            yield from decoder.flush()

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in file order."""
        known = self._catalogue
        for _, rows in self._pass(lambda key: 0 if known.type(key) in types else _UNWANTED, report):
            kinds = {
                key: (known.channels[key].topic, known.type(key), known.channels[key].message_encoding)
                for key in np.unique(rows.channel).tolist()
            }
            named = zip(*map(kinds.__getitem__, rows.channel.tolist()), strict=True)
            found = map(Message, *named, rows.log_ns.tolist(), _payloads(rows))
            yield from self._unpacked(found) if _are_packed(rows) else found

    def everything(
        self, others: Callable[[int, bytes], None], report: ReadReport
    ) -> tuple[Walker, Catalogue, Iterator[Messages]]:
        """Return a pass over all messages in file order, its walker, and the channels known so far.

        Parameters
        ----------
        others : takes header, attachments, metadata and private records, opcode and content, when their turn comes
        """
        report.add(self._opening)
        walker = self._walker(report, lambda _place, _index: False)
        walker.others = others
        return walker, self._catalogue, walker.parts()

    def locator(self, channel: int) -> Locate | None:
        """Return what finds the ranges in the messages of a channel; None where these are no sweeps, or JSON."""
        decoder = self._decoder(channel, ReadReport())
        return None if decoder is None else decoder.locate

    def _unpacked(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield the messages of a ROS 2 bag that has compressed each of them."""
        for message in messages:
            plain = unpack_message(message.data, self._unpacking)
            if plain is not None:
                yield message._replace(data=plain)

    def _decoder(self, key: int, report: ReadReport) -> _Columns | _OneByOne | None:
        """Return the decoder of a channel; None if its messages are no sweeps."""
        channel, definition = self._catalogue.channels[key], self._catalogue.schema(key)
        kind, encoding, topic = self._read_as(key), channel.message_encoding, channel.topic
        if definition is None or not kind:
            return None
        if encoding == "json":
            return _OneByOne(topic, partial(foxglove.decode_json, echo=self._echo), report)
        problem = f"the encoding '{encoding}' is not read"
        if encoding in ("cdr", "ros1") and kind in EXPECTED:
            different = differs(kind, definition.encoding, definition.data.decode("utf-8", "replace"))
            if different is None:
                return _Columns(Gather(topic, kind, encoding, report, self._echo), self._unpacking)
            problem = f"its definition is not the standard one: {different}"
        elif encoding == "protobuf":
            known = foxglove.protobuf_decoder(definition.name, definition.data)
            if known is not None:
                return _OneByOne(topic, known[0], report, known[1])
            problem = f"its protobuf schema does not describe a {kind}"
        return _OneByOne(topic, partial(_refuse, cause=problem), report)

    def _pass(self, choose: Callable[[int], int], report: ReadReport) -> Iterator[tuple[int, Messages]]:
        """Go through the log once and hand out messages with the group that `choose` gave their channel."""
        report.add(self._opening)
        self._unpacking = Unpacking()
        wanted = _Wanted(self._catalogue, choose)
        places = frozenset[int]() if self._summary is None else self._summary.chunk_places
        trusted: bool | None = None

        def skip(place: int, index: Mapping[int, int]) -> bool:
            nonlocal trusted
            groups = wanted.groups()
            summary = self._summary
            if summary is None or not summary.sane or any(groups[channel] != _UNWANTED for channel in index):
                return False
            if trusted is None:
                chosen = set(np.flatnonzero(groups >= 0).tolist())
                trusted = index_is_complete(self._source, summary, chosen)
            return trusted and not walker.index_lies and place in places

        walker = self._walker(report, skip)
        unknown: Counter[int] = Counter()
        for part in walker.parts():
            groups = wanted.groups()[part.channel]
            lowest = int(groups.min(initial=0))
            if lowest == _UNKNOWN:
                unknown.update(part.channel[groups == _UNKNOWN].tolist())
            present = np.flatnonzero(np.bincount(groups[groups >= 0])).tolist()
            if len(present) == 1 and lowest >= 0:
                yield present[0], part
            else:
                for number in present:
                    yield number, part.take(groups == number)
        self.compression = "+".join(walker.compressions) or "none"
        self._report_unknown(unknown, report)

    def _report_unknown(self, unknown: Counter[int], report: ReadReport) -> None:
        """Report messages of unknown type as lost."""
        hint = "; given as a file instead of a stream, its summary may tell" if self.size is None else ""
        for key, count in sorted(unknown.items()):
            channel = self._catalogue.channels.get(key)
            name, what = ("", "channel record") if channel is None else (f" ({channel.topic})", "schema")
            report.add_damage(f"channel {key}{name}", f"its {what} is missing: {count} messages are lost{hint}")

    def _walker(self, report: ReadReport, skip: Callable[[int, Mapping[int, int]], bool]) -> Walker:
        if self.size is None:
            if self._used:
                raise UnreadableError(f"{self.path}: a stream can be read only once; give the file's name instead")
            self._used = True
        else:
            self._source = Cursor(self._stream, self.size)
        offsets = np.empty(0, np.int64) if self._summary is None else self._summary.chunk_offsets
        return Walker(self._source, self._catalogue, report, offsets, skip)

    def close(self) -> None:
        """Close the file or the stream."""
        self._stream.close()

    def __enter__(self) -> McapLog:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
