"""How a line of `mcap cat --json` begins: the topic, its number, and the time of its record."""

from __future__ import annotations

import codecs
import re

BEGINS = re.compile(
    rb'\s*\{\s*"topic"\s*:\s*("(?:[^"\\]|\\.)*+")\s*,\s*"sequence"\s*:\s*\d+\s*,'
    rb'\s*"log_time"\s*:\s*"?([^",{}\s]+)"?\s*,'
)
"""The topic as JSON has it, and the time as it stands."""


def begins(head: bytes) -> bool:
    """Whether a text that begins like this is what `mcap cat --json` prints.

    >>> begins(b'{"topic":"/scan","sequence":0,"log_time":1.5,"publish_time":1.5,"data":{}}'), begins(b'{"ranges": []}')
    (True, False)
    """
    return BEGINS.match(head.removeprefix(codecs.BOM_UTF8)) is not None
