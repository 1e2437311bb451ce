"""Logs split as recorders split them: what is latched is in the first part alone."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import Writer


def split_mcap(log: Path, folder: Path, parts: int = 3) -> list[Path]:
    """Write the messages of an MCAP to `NAME_0.mcap`, `NAME_1.mcap`, ..., about equally many to each."""
    folder.mkdir(parents=True, exist_ok=True)
    with log.open("rb") as file:
        messages = list(make_reader(file).iter_messages(log_time_order=False))
    size = -(-len(messages) // parts)
    paths = [folder / f"{log.stem}_{number}.mcap" for number in range(parts)]
    for number, path in enumerate(paths):
        with path.open("wb") as out:
            writer = Writer(out)
            writer.start()
            ids: dict[int, int] = {}
            for schema, channel, message in messages[number * size : (number + 1) * size]:
                assert schema is not None
                if channel.id not in ids:
                    known = writer.register_schema(schema.name, schema.encoding, schema.data)
                    ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, known)
                writer.add_message(ids[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
            writer.finish()
    return paths
