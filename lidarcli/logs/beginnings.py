"""The first bytes by which text logs with one message per line are recognised.

They stand apart from the readers, so that opening a log of another format imports none of these.
"""

from __future__ import annotations

import codecs
import re

ARIA_TITLE = b"LaserOdometryLog"
"""First line of an ARIA log."""
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
_ARIA = re.compile(_COMMENTS + ARIA_TITLE + rb"[ \t]*(?:\r|\n|\Z)")
_PLAYER_HEADER = re.compile(_BOM + rb"[ \t]*## Player version")
_PLAYER_LINE = re.compile(
    _COMMENTS + rb"\d+\.\d+[ \t]+[\w.:-]+[ \t]+\d+[ \t]+(?:[a-z]\w*[ \t]+\d+[ \t]+\d{3}[ \t]+\d{3}[ \t\r\n]"
    rb"|[a-z]\w*[ \t]+\d{2}[ \t]+\d+\.\d+[ \t\r\n])"
)


def is_carmen(head: bytes) -> bool:
    """Tell whether a text is a CARMEN log: by its header, or by the first word that is no comment.

    >>> is_carmen(b"# made by hand\\nODOM 0 0 0 0 0 0 1.5 host 1.5\\n"), is_carmen(b"time,r0,r1")
    (True, False)
    """
    return _CARMEN_HEADER.match(head) is not None or _CARMEN_LINE.match(head) is not None


def is_aria(head: bytes) -> bool:
    """Tell whether a text is an ARIA log: by its title.

    >>> is_aria(b"LaserOdometryLog\\n#Created by hand\\n"), is_aria(b"LaserOdometryLogs,1")
    (True, False)
    """
    return _ARIA.match(head) is not None


def is_player(head: bytes) -> bool:
    """Tell whether a text is a Player log: by its header, or by the first line that is no comment.

    >>> is_player(b"0000000012.500 16777343 6665 laser 00 001 001 0001 -1.57"), is_player(b"12.5 1.0 2.0")
    (True, False)
    """
    return _PLAYER_HEADER.match(head) is not None or _PLAYER_LINE.match(head) is not None


def is_json_lines(head: bytes) -> bool:
    """Tell whether a text is what `mcap cat --json` prints: by its first line.

    >>> is_json_lines(b'{"topic":"/scan","sequence":0,"log_time":1.5,"data":{}}'), is_json_lines(b'{"ranges": []}')
    (True, False)
    """
    return JSON_LINE.match(head.removeprefix(codecs.BOM_UTF8)) is not None
