"""The first bytes by which text logs with one message per line are recognised.

They stand apart from the readers, so that opening a log of another format imports none of these.
"""

from __future__ import annotations

import codecs
import re

JSON_LINE = re.compile(
    rb'\s*\{\s*"topic"\s*:\s*("(?:[^"\\]|\\.)*+")\s*,\s*"sequence"\s*:\s*\d+\s*,'
    rb'\s*"log_time"\s*:\s*"?([^",{}\s]+)"?\s*,'
)
"""Start of a line of `mcap cat --json`; its groups are the topic, as JSON, and the time of the record."""

_BOM = rb"(?:\xef\xbb\xbf)?"
_COMMENTS = _BOM + rb"(?:[ \t]*(?:#[^\n]*)?\r?\n)*[ \t]*"
_CARMEN_HEADER = re.compile(_BOM + rb"# (?:CARMEN Logfile|message_name \[message contents\] ipc_timestamp)")
_CARMEN_LINE = re.compile(
    _COMMENTS + rb"(?:[FR]LASER|LASER[34]|REMISSIONFLASER|R(?:AW|OBOT)LASER[1-4]|ODOM|TRUEPOS|PARAM|SYNC"
    rb"|GLOBALPOS|NMEAGGA|NMEARMC|SONAR|BUMPER|IMU|GRIDMAP|SCANMARK|POSITIONLASER)[ \t]+[^\s,;]"
)


def is_carmen(head: bytes) -> bool:
    """Tell whether a text is a CARMEN log: by its header, or by the first word that is no comment.

    >>> is_carmen(b"# made by hand\\nODOM 0 0 0 0 0 0 1.5 host 1.5\\n"), is_carmen(b"time,r0,r1")
    (True, False)
    """
    return _CARMEN_HEADER.match(head) is not None or _CARMEN_LINE.match(head) is not None


def is_json_lines(head: bytes) -> bool:
    """Tell whether a text is what `mcap cat --json` prints: by its first line.

    >>> is_json_lines(b'{"topic":"/scan","sequence":0,"log_time":1.5,"data":{}}'), is_json_lines(b'{"ranges": []}')
    (True, False)
    """
    return JSON_LINE.match(head.removeprefix(codecs.BOM_UTF8)) is not None
