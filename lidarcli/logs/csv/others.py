"""Text that is plainly something else than CSV: what it is, and the way from it to a log."""

from __future__ import annotations

import re
from dataclasses import dataclass

MOST_TEXT = 64 << 10
"""Bytes at the start of a file in which other formats are looked for."""


@dataclass(frozen=True, slots=True)
class Other:
    """A text format that is recognised and not read."""

    name: str
    way_out: str
    marks: re.Pattern[bytes]
    """Matches at the beginning of a text of this format."""

    @property
    def refusal(self) -> str:
        """For people: what a file is, and what to do."""
        return f"{self.name}, which lidarcli does not read: {self.way_out}"


_COMMENTS = rb"(?:[ \t]*(?:#[^\n]*)?\r?\n)*"
_YAML_KEY = rb"[ \t]*(?:- )?[A-Za-z_][\w.-]*:"
_ANY_WAY = "convert it to CSV with a column per beam (`time,r0,r1,...` in the first line)"
_RECORD = (
    "record with `ros2 bag record` or `rosbag record`, or print with `ros2 topic echo --csv --full-length`"
)
_POSES = "it holds poses, no ranges"
_POINTS = "it holds points, no sweeps; record the LaserScan topic itself"

TRAJECTORY = Other(
    "a trajectory (TUM)",
    _POSES,
    re.compile(_COMMENTS + rb"#?[^\n]*\btx[ ,]+ty[ ,]+tz[ ,]+qx[ ,]+qy[ ,]+qz[ ,]+qw\b"),
)
OTHERS = (
    Other("a point cloud (PCD)", _POINTS, re.compile(rb"# \.PCD |VERSION \S+\r?\nFIELDS ")),
    Other("a point cloud or mesh (PLY)", _POINTS, re.compile(rb"ply\r?\n(?:format|comment|obj_info) ")),
    TRAJECTORY,
    Other("a pose graph (g2o)", _POSES, re.compile(rb"%s(?:VERTEX|EDGE)_SE[23]\S*[ \t]+\d" % _COMMENTS)),
    Other(
        "a pointer of Git LFS, not the file itself",
        "fetch it with `git lfs pull`",
        re.compile(rb"version https://git-lfs"),
    ),
    Other("JSON", _ANY_WAY, re.compile(rb"\s*(?:\{\s*[\"}]|\[\s*[\[{\"])")),
    Other("XML or HTML", "look whether a download has failed", re.compile(rb"\s*<[?!A-Za-z]")),
    Other(
        "ROS messages as Python prints them",
        _RECORD,
        re.compile(rb"[ \t]*(?:\[[ \t]*)?\w+_msgs\.msg\.[\w.]+\("),
    ),
    Other(
        "YAML",
        _RECORD,
        re.compile(
            rb"%s(?:%%YAML|---[ \t]*\r?\n|%s[ \t][^\n]*\n---[ \t]*\r?\n|%s[ \t]*\r?\n(?:[ \t]+%s|[ \t]*- )"
            rb"|%s[ \t][^\n,;]*\n%s(?:[ \t][^\n,;]*)?\r?\n)"
            % (_COMMENTS, _YAML_KEY, _YAML_KEY, _YAML_KEY, _YAML_KEY, _YAML_KEY)
        ),
    ),
)


def other_format(text: bytes) -> Other | None:
    """The format, where a text is plainly none of CSV.

    >>> other_format(b"VERTEX_SE2 0 0.0 0.0 0.0").name
    'a pose graph (g2o)'
    """
    start = text[:MOST_TEXT]
    return next((other for other in OTHERS if other.marks.match(start)), None)
