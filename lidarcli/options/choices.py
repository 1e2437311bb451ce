"""Words, limits and defaults of options. Nothing is imported, so that commands start soon."""

from __future__ import annotations

import math

from lidarcli.system.records import dataclass

MAX_NUMBER = 1e6
"""A length, an angle or a time of an option is no larger [m], [rad], [degrees]: no range is (`range_rules.FARTHEST`)."""
MAX_COUNT = 1_000_000
"""A number of beams, sweeps or processes in an option is no larger: no sweep has more beams (`logs.base.MAX_BEAMS`)."""
VIEWS = ("all", "scene", "sweep")
MAP = "map"
"""View of the whole run in the world."""
IMAGES = (".png", ".svg", ".pdf")
ANIMATIONS = (".gif", ".mp4")
LAST_SWEEP = 1_000_000_000
"""The number of a sweep in an option is no larger: three years at 10 Hz."""
MAX_SHARDS = 1_000_000
"""Greatest number of shares of a run (`--shard`)."""
PROFILES = ("robust", "paper")
"""Sets of defaults for the detection; the first by default."""
AGENT_SCORE = 0.55
"""Least probability that an object moves by itself; what has less is no agent (`track`)."""
MIN_THING = 0.3
"""Least probability that an object is a thing and not a piece of building; anything less counts as wall."""
MENDS = (
    *("beams", "stamps", "angles", "times", "order", "intensities", "units", "limits", "no-return", "frames"),
    *("statics", "clock"),
)
"""Faults of a log that `clean` mends."""
FOUND = "found"
"""Word for those that `info --deep` finds."""
AROUND = 5.0
"""Time before and after an event in a clip of it [s], by default."""
REMOVABLE = ("agents", "temporary")
"""Kinds of objects whose beams `clean` removes; the first by default."""
SAYINGS = NAN, INF, ABOVE = ("nan", "inf", "above")
"""Words for the value of a removed beam, which may also be a range; the first by default."""
TRAIL = 3.0
"""Length of the paths of tracks in a picture of a sweep and in overlays [s]."""
STATION_DISTANCE = 0.25
"""Greatest distance of a sweep from its station [m], by default."""
STATION_DEGREES = 5.0
"""Greatest difference of headings of a sweep and its station [degrees], by default."""
STATION_ANGLE = math.radians(STATION_DEGREES)
"""Greatest difference of headings [rad]."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units that the ranges of a log may have, in metres."""
PILE = "pile"
NO_RETURN_WORDS = ("inf", "zero", "max", "above", PILE, "nan", "negative", "below")
"""Words for the values of a beam that mean no return; a pile is a range that many beams share."""
ECHOES = ("first", "last", "strongest")
"""Echoes to take of a beam that has several; the first by default."""
JOIN, KEEP = SEGMENTS = ("join", "keep")
"""Use of messages that are segments of a turn; the first by default."""
BINS = 720
"""Beams of a sweep that is made of a point cloud: half a degree each in a full turn."""
ALIGN = ("auto", "as-is", "search")
"""Ways to lay one run on another; the first by default."""
CHANGE_KINDS = ("thing", "structure")
CHANGE_STATUSES = ("known", "moved", "new", "gone", "uncertain")
CHANGE_WHYS = ("hidden", "out of view", "no free space", "short", "ambiguous", "poses", "drift")
"""Kinds of changes from run to run, their statuses, and the reasons for which one is uncertain."""
MAP_STATES = ("fits", "off", "lost", "unknown")
"""States of a path on a map: it fits, would fit elsewhere, fits nowhere near, or there is no evidence."""
MIN_SCORE = 0.8
"""Least probability of the status of a change, by default."""
BEAM_ORDERS = ("auto", "forward", "reverse", "once")
"""Orders in which the beams of a sweep are sent; the first by default."""
MAX_DELAY = 3600.0
"""Greatest `--pose-delay` [s], positive or negative: a greater one is another clock."""
MATCH = "match"
"""Value of `--pose` for poses found by matching sweeps, and the name of their world frame."""
MAP_RESOLUTION = 0.05
"""Side of a cell of a map [m], by default."""
MAP_RESOLUTIONS = (0.001, 10.0)
MIN_MOVE = 0.12
"""Distance between sweeps that count for a map [m]."""
OCCUPIED_RATIO = 0.25
"""Least share of hits among the sweeps that hit or passed an occupied cell."""
MAX_MAP_KM2 = 0.25
"""Largest area of a map [km²]: at 5 cm 100 million cells, 1.3 GB if all of them are observed."""
CONTAINERS = ("mcap", "bag", "ros2", "ros2-mcap", "db3", "csv")
"""Formats of simulated logs: `ros2` is a folder with an sqlite3 file in it, `ros2-mcap` one with an MCAP file."""
TABLE_BY_SUFFIX = {".parquet": "parquet", ".csv": "csv", ".ndjson": "ndjson", ".jsonl": "ndjson", ".arrow": "arrow"}
"""Formats of a file that holds one table."""
JUNIT = ".xml"
"""Suffix of an output for the verdicts of checks."""
CONTAINER_BY_SUFFIX = {".mcap": "mcap", ".bag": "bag", ".db3": "db3", ".csv": "csv"}
"""Suffix of a log that is simulated → its container; a CSV may end in .csv.gz as well."""
CLOUDS = (".ply", ".pcd", ".parquet")
NS, _ = STAMPS = ("ns", "us")
INCH = 25.4
"""Millimetres in an inch."""
PICTURE_WIDTHS = (40.0, 2000.0)
"""The least and the greatest width of a picture [mm]."""
PICTURE_DPI = (30, 1200)
ANIMATED_DPI = 120
"""Pixels per inch of an animation, by default."""
FRAMES_PER_SECOND, MAX_FRAMES = 10.0, 50.0
"""Sweeps per second of an animation, by default, and at most: viewers of GIF files show no more."""

EXPLAINED = (".html", ".png", ".gif", ".mp4")
"""Suffixes of what `zones --explain` writes."""


@dataclass(frozen=True, slots=True)
class Look:
    """Size and furniture of a picture."""

    width: float | None = None
    """Width of the picture [mm]; None: the default of its kind."""
    dpi: int | None = None
    """Pixels per inch; None: 200, of an animation `ANIMATED_DPI`."""
    title: bool = True
    legend: bool = True
    vertices: bool = False
    """Mark the vertices and the nearest point of each object in the scene, too."""
    fps: float | None = None
    """Sweeps per second of an animation; None: `FRAMES_PER_SECOND`."""

    def inches(self, default: float) -> float:
        """Return the width [inch], or `default`."""
        return default if self.width is None else self.width / INCH


AS_IT_COMES = Look()

SET_WORDS = {"O": "objects", "A": "agents", "S": "walls and rest"}
"""Set (Def. 4) → what its beams are on, for readers."""


def beams_on(agents: bool) -> dict[str, str]:
    """Return the words for each set; without tracking, agents are among the objects."""
    return {"A": "agents", **SET_WORDS, "O": "other objects"} if agents else {k: SET_WORDS[k] for k in "OS"}
