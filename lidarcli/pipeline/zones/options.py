"""Options of `zones`, and what of them is refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from lidarcli.errors import OptionError
from lidarcli.files.stores import Place
from lidarcli.formalism.zones import HALF_WIDTH
from lidarcli.logs.base import Log
from lidarcli.options.choices import AROUND
from lidarcli.options.times import Time
from lidarcli.pipeline.inputs.masks import plain
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.inputs.tables import one_table_set
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.masking import MaskRules
from lidarcli.pipeline.zones.frames import Frames
from lidarcli.sweeps.masks import Circle, Masks, Polygon
from lidarcli.sweeps.zone import WORLD, Line, Zone, Zones
from lidarcli.tabular.writing import table_paths

TABLES = ("events", "zones")
MAX_EXPLAINED = 5
"""Most events of a log that `--explain worst` explains."""
NAMED = ("name", "frame", "action", "count", "min_points", "trigger", "release", "hold", "timeout")
"""Fields of every zone in the metadata, next to those of its shape and topics."""


@dataclass(frozen=True, slots=True)
class Explained:
    """What `zones --explain` is to write."""

    time: Time | None
    """Time of the event; None for the worst ones, of each of which there is a file with its number."""
    outputs: tuple[Place, ...]
    """Pages, pictures and films, by their suffixes."""
    commands: Callable[[str, float], Sequence[str]]
    """Return the commands that show more of a topic at a time [s]."""

    def files(self, number: int) -> list[Place]:
        """Return the outputs of an event."""
        return [one if self.time is not None else one.with_name(f"{one.stem}-{number}{one.suffix}") for one in self.outputs]


@dataclass(frozen=True, slots=True)
class ZoneOptions:
    """Options of `zones`, apart from inputs and outputs."""

    zones: Zones
    files: tuple[str, ...]
    """Files that the zones are from."""
    detect: DetectOptions
    """Options of reading, detection and tracking."""
    objects: str | None = None
    """The objects table of the log, where there is one."""
    find: bool = True
    """True to find and follow objects where no table is given."""
    footprint: Polygon | None = None
    """Shape of zones whose shape is on a topic that the log does not have."""
    overwrite: bool = False
    clips: Place | None = None
    """Folder for a part of the log around each event."""
    interval_ns: int = 0
    """Length of the intervals by which people are counted; 0 for none."""
    around: float = AROUND
    """Time before and after each [s]."""
    explain: Explained | None = None
    stops: bool = False
    """True to tell when the robot stood, and what was ahead of it."""

    @property
    def half_width(self) -> float | None:
        """Half of the width of the robot, where its stops are told: by its footprint, else as most are [m]."""
        told = [self.footprint, *(zone.footprint for zone in self.zones.zones)]
        widths = [max(abs(y) for _, y in one.corners) for one in told if one is not None]
        return (widths or [HALF_WIDTH])[0] if self.stops or self.explain is not None else None

    @property
    def has_objects(self) -> bool:
        """True if it is known which objects the points are on."""
        return self.find or self.objects is not None

    def outputs(self, source: Source, folder: Place) -> dict[str, Place]:
        """Return the path of each table of a log."""
        return table_paths(folder, source.name, (*TABLES, *(("counts",) if self.interval_ns else ())))

    def inputs(self, sources: Sequence[Source | MissingInput]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        tables = [] if self.objects is None else [str(one_table_set(self.objects).objects)]
        return [*self.detect.inputs(sources), *self.files, *tables]

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the tables' metadata."""
        own: dict[str, Any] = {"zones": [*map(zone_dict, self.zones.zones)], "find": self.has_objects}
        more: dict[str, Any] = {"zone_masks": plain(self.zones.masks), "robot": self.zones.robot}
        more["stops"] = self.stops and self.half_width
        more["interval_ns"] = self.interval_ns
        more["footprint"] = None if self.footprint is None else self.footprint.corners
        return self.detect.as_dict() | own | {name: value for name, value in more.items() if value}


def zone_dict(zone: Zone) -> dict[str, Any]:
    """Return a zone as plain values; of its shape one of polygon, circle, line, or each of its polygons by name."""
    ahead = ("time_before_collision", "time_step") if zone.action == "approach" else ()
    topics = [name for name in ("shape_topic", "velocity_topic") if getattr(zone, name)]
    found = {name: getattr(zone, name) for name in (*NAMED, *(("topics",) if zone.topics else ()), *ahead, *topics)}
    match zone.shape:
        case Polygon(corners):
            found["polygon"] = corners
        case Circle():
            found["circle"] = asdict(zone.shape)
        case Line(first, second):
            found["line"] = first, second
        case None:
            found["polygons"] = {
                case.name: {
                    "polygon": case.shape.corners,
                    "linear": case.linear,
                    "turning": case.turning,
                    **({} if case.direction is None else {"direction": case.direction}),
                }
                for case in zone.cases
            }
            if zone.footprint is not None:
                found["footprint"] = zone.footprint.corners
    return found


def refuse_options(options: ZoneOptions) -> None:
    """Refuse zones that need objects where none are known, and options that no zone needs (`OptionError`)."""
    if options.footprint is not None and not (options.stops or any(zone.shape_topic for zone in options.zones.zones)):
        raise OptionError("--footprint is for --stops and for zones whose shape a topic tells, and there are none")
    if options.interval_ns and not any(isinstance(zone.shape, Line) for zone in options.zones.zones):
        raise OptionError("--every with a time counts who crosses lines, and no zone is a line")
    for zone in options.zones.zones:
        needs = isinstance(zone.shape, Line) or zone.count != "beams"
        if needs and not options.has_objects:
            what = "is a line, and crossings" if isinstance(zone.shape, Line) else f"counts {zone.count}, which"
            raise OptionError(f"zone '{zone.name}' {what} need tracks: leave out --no-objects")
        if zone.frame == WORLD:
            refuse_resting(zone)


def refuse_resting(zone: Zone) -> None:
    """Refuse a zone in the world that is to move with the robot (`OptionError`)."""
    if zone.action == "approach":
        raise OptionError(
            f"zone '{zone.name}' approaches, and in the world it does not move with the robot: give another 'frame'"
        )


def narrowed(log: Log, options: ZoneOptions) -> ZoneOptions:
    """Return options that read only the topics that count in a zone, where each zone names some."""
    read, zones = options.detect.read, options.zones.zones
    scans = [topic.name for topic in log.topics() or () if topic.is_scan]
    own = [topic for topic in scans if any(zone.is_for(topic) for zone in zones)]
    if read.topics or not own or not all(zone.topics for zone in zones):
        return options
    return replace(options, detect=replace(options.detect, read=replace(read, topics=own)))


def masked(log: Log, options: ZoneOptions, masking: MaskRules) -> DetectOptions:
    """Return how objects are found where the masks of a zone file are masks of the detection, too."""
    detect, zones = options.detect, options.zones
    own = masking.rules.masks or Masks()
    if not zones.masks.masks:
        mounted = Masks(own.masks, (*own.mounts, *zones.masks.mounts), own.path)
        rules = replace(masking.rules, masks=mounted) if mounted.mounts else masking.rules
        return replace(detect, read=replace(detect.read, rules=rules))
    frames = Frames.of(log, zones, own.mounts)
    mounts = frames.mounts_in({mask.frame for mask in zones.masks.masks if mask.frame})
    masks = Masks((*own.masks, *zones.masks.masks), (*frames.mounts, *mounts), own.path)
    return replace(detect, read=replace(detect.read, rules=replace(masking.rules, masks=masks)))
