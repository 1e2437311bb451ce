"""The MCAP reader: files with and without an index, cut-off ones, and pipes, by one walk in file order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs.base import MULTI_ECHO, Closing, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.blocks import Locate
from lidarcli.logs.laserscan import EXPECTED, TOGETHER, Locator, MessageBatcher, differs
from lidarcli.logs.mcap_records import MAGIC, ChannelCatalogue, McapMessages, McapSummary, RecordCursor, read_summary
from lidarcli.logs.mcap_walk import UNKNOWN, UNWANTED, Walk, Wanted
from lidarcli.logs.unpacking import PACKED_CAUSE, ZSTD_MAGIC, DecompressionBudget, unpack_message
from lidarcli.sweeps.types import RawSweeps
from lidarcli.system.records import dataclass, field

if TYPE_CHECKING:
    from lidarcli.logs import foxglove

STRIPPED_MAGIC = b"\x89MCAP0\n"


@dataclass(slots=True)
class _ColumnDecoder:
    """Decoder by column of a LaserScan topic in cdr or ros1."""

    gather: MessageBatcher
    budget: DecompressionBudget

    @property
    def locate(self) -> Locate:
        """Finder of the ranges in the messages of the topic."""
        return Locator(self.gather.encoding, self.gather.type == MULTI_ECHO)

    def decode(self, rows: McapMessages) -> Iterator[RawSweeps]:
        if not _are_packed(rows):
            yield from self.gather.take(rows.data, rows.start, rows.length, rows.log_ns)
            return
        for data, log_ns in zip(_payloads(rows), rows.log_ns.tolist(), strict=True):
            if (plain := unpack_message(data, self.budget)) is None:
                self.gather.report.refused[(self.gather.topic, PACKED_CAUSE)] += 1
            elif self.gather.add(plain, log_ns):
                yield from self.gather.flush()

    def flush(self) -> Iterator[RawSweeps]:
        yield from self.gather.flush()


@dataclass(slots=True)
class _MessageDecoder:
    """Decoder message by message of a topic in JSON or protobuf."""

    topic: str
    decoder: foxglove.Decoder
    report: ReadReport
    locate: Locate | None = None
    """Finds the ranges of a message; None for JSON, where numbers have no place of their own."""
    waiting: list[tuple[int, bytes]] = field(default_factory=list)

    def decode(self, rows: McapMessages) -> Iterator[RawSweeps]:
        self.waiting += zip(rows.log_ns.tolist(), _payloads(rows), strict=True)
        if len(self.waiting) >= TOGETHER:
            yield from self.flush()

    def flush(self) -> Iterator[RawSweeps]:
        from lidarcli.logs import foxglove

        waiting, self.waiting = self.waiting, []
        yield from foxglove.decode_each(self.topic, waiting, self.decoder, self.report)


def _refuse(_data: bytes, _record_ns: int, *, cause: str) -> foxglove.Scan:
    """Decode no message of a topic."""
    from lidarcli.logs.foxglove import RefusedError

    raise RefusedError(cause)


def _are_packed(rows: McapMessages) -> bool:
    """Return True if a ROS 2 bag has compressed its messages: all or none; plain ones never begin as zstd does."""
    if not len(rows):
        return False
    start = int(rows.start[0])
    return rows.data[start : start + min(len(ZSTD_MAGIC), int(rows.length[0]))].tobytes() == ZSTD_MAGIC


def _payloads(rows: McapMessages) -> Iterator[bytes]:
    data = rows.data.data
    for start, end in zip(rows.start.tolist(), (rows.start + rows.length).tolist(), strict=True):
        yield data[start:end].tobytes()


class McapLog(Closing):
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
        self._budget = DecompressionBudget()
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
        self._source = RecordCursor(self._stream, self.size)
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
        self._summary: McapSummary | None = read_summary(self._source, self._opening)
        self.catalogue = ChannelCatalogue() if self._summary is None else self._summary.catalogue
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
            if self._summary is not None and self._summary.sane:
                self._topics = self._listed(self._summary.counts)
            else:
                walk = self._walk(ReadReport(), Wanted(self.catalogue, types=()))
                walk.counting = True
                for rows in walk.records():
                    if isinstance(rows, McapMessages):
                        channels, counts = np.unique(rows.channel, return_counts=True)
                        walk.skipped.update(dict(zip(channels.tolist(), counts.tolist(), strict=True)))
                self._topics = self._listed(walk.skipped)
        return None if self._topics is None else list(self._topics)

    def _listed(self, counts: Mapping[int, int] | None) -> list[Topic]:
        """Return the topics of the catalogue; several channels (publishers) of one topic are one."""
        known = self.catalogue
        messages: dict[tuple[str, str, str, str], int] = {}
        for key, channel in known.channels.items():
            topic = (channel.topic, known.type(key), channel.message_encoding, known.read_as(key))
            messages[topic] = messages.get(topic, 0) + (counts or {}).get(key, 0)
        return [Topic(*topic[:3], count if counts is not None else None, topic[3]) for topic, count in messages.items()]

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in file order within each topic."""
        wanted = Wanted(self.catalogue, topics)
        decoders: list[_ColumnDecoder | _MessageDecoder] = []
        for rows, groups in self._pass(wanted, report):
            decoders += [self._decoder(key, report) for key in wanted.first[len(decoders) :]]
            present = np.flatnonzero(np.bincount(groups[groups >= 0])).tolist()
            alone = len(present) == 1 and int(groups.min()) >= 0
            for number in present:
                yield from decoders[number].decode(rows if alone else rows.take(groups == number))
        for decoder in decoders:
            yield from decoder.flush()

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in file order."""
        known = self.catalogue
        for part, groups in self._pass(Wanted(known, types=types), report):
            rows = part.take(groups >= 0)
            kinds = {
                key: (known.channels[key].topic, known.type(key), known.channels[key].message_encoding)
                for key in np.unique(rows.channel).tolist()
            }
            named = zip(*map(kinds.__getitem__, rows.channel.tolist()), strict=True)
            found = map(Message, *named, rows.log_ns.tolist(), _payloads(rows))
            yield from self._unpacked(found) if _are_packed(rows) else found

    def raw_records(self, report: ReadReport) -> Walk:
        """Return a pass over all messages and all other records that a copy keeps."""
        report.add(self._opening)
        return self._walk(report, None)

    def locator(self, channel: int) -> Locate | None:
        """Return what finds the ranges in the messages of a channel; None where these are no sweeps, or JSON."""
        return self._decoder(channel, ReadReport()).locate if self.catalogue.read_as(channel) else None

    def _unpacked(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield the messages of a ROS 2 bag that has compressed each of them."""
        for message in messages:
            plain = unpack_message(message.data, self._budget)
            if plain is not None:
                yield message._replace(data=plain)

    def _decoder(self, key: int, report: ReadReport) -> _ColumnDecoder | _MessageDecoder:
        """Return the decoder of a channel of sweeps."""
        channel, kind = self.catalogue.channels[key], self.catalogue.read_as(key)
        schema = self.catalogue.schemas[channel.schema_id]
        encoding, topic = channel.message_encoding, channel.topic
        problem = f"the encoding '{encoding}' is not read"
        if encoding in ("cdr", "ros1") and kind in EXPECTED:
            different = differs(kind, schema.encoding, schema.data.decode("utf-8", "replace"))
            if different is None:
                return _ColumnDecoder(MessageBatcher(topic, kind, encoding, report, self._echo), self._budget)
            problem = f"its definition is not the standard one: {different}"
        # Most logs need not wait for this import.
        from lidarcli.logs import foxglove

        if encoding == "json":
            return _MessageDecoder(topic, partial(foxglove.decode_json, echo=self._echo), report)
        if encoding == "protobuf":
            known = foxglove.protobuf_decoder(schema.name, schema.data)
            if known is not None:
                return _MessageDecoder(topic, known[0], report, known[1])
            problem = f"its protobuf schema does not describe a {kind}"
        return _MessageDecoder(topic, partial(_refuse, cause=problem), report)

    def _pass(self, wanted: Wanted, report: ReadReport) -> Iterator[tuple[McapMessages, NDArray[np.int32]]]:
        """Go through the log once; yield messages, and the group of each, where any is wanted."""
        report.add(self._opening)
        self._budget = DecompressionBudget()
        walk = self._walk(report, wanted)
        unknown: Counter[int] = Counter()
        for rows in walk.records():
            if not isinstance(rows, McapMessages):
                continue
            groups = wanted.groups()[rows.channel]
            unknown.update(rows.channel[groups == UNKNOWN].tolist())
            if groups.max(initial=UNWANTED) >= 0:
                yield rows, groups
        self.compression = "+".join(walk.compressions) or "none"
        hint = "; given as a file instead of a stream, its summary may tell" if self.size is None else ""
        for key, count in sorted(unknown.items()):
            channel = self.catalogue.channels.get(key)
            name, what = ("", "channel record") if channel is None else (f" ({channel.topic})", "schema")
            report.add_damage(f"channel {key}{name}", f"its {what} is missing: {count} messages are lost{hint}")

    def _walk(self, report: ReadReport, wanted: Wanted | None) -> Walk:
        if self.size is None:
            if self._used:
                raise UnreadableError(f"{self.path}: a stream can be read only once; give the file's name instead")
            self._used = True
        else:
            self._source = RecordCursor(self._stream, self.size)
        return Walk(self._source, self.catalogue, report, self._summary, wanted)

    def close(self) -> None:
        """Close the file or the stream."""
        self._stream.close()
