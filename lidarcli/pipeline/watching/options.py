"""Options of `zones`, and zones as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from lidarcli.errors import OptionError
from lidarcli.masks import Circle, Polygon
from lidarcli.pipeline.inputs.masks import plain
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.pipeline.inputs.tables import one_pair
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.stores import Place
from lidarcli.tabular.writing import table_paths
from lidarcli.zone import WORLD, Line, Zone, Zones

TABLES = ("events", "zones")


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
    """Shape of zones whose shape a topic tells that the log does not have."""
    overwrite: bool = False

    @property
    def has_objects(self) -> bool:
        """True if it is known which objects the points are on."""
        return self.find or self.objects is not None

    def outputs(self, source: Source, folder: Place) -> dict[str, Place]:
        """Return the path of each table of a log."""
        return table_paths(folder, source.name, TABLES)

    def inputs(self, sources: Sequence[Source | Nothing]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        tables = [] if self.objects is None else [str(one_pair(self.objects).objects)]
        return [*self.detect.inputs(sources), *self.files, *tables]

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the tables' metadata."""
        told: dict[str, Any] = {"zones": [zone_dict(zone) for zone in self.zones.zones], "find": self.has_objects}
        if masks := plain(self.zones.masks):
            told["zone_masks"] = masks
        if self.zones.robot:
            told["robot"] = self.zones.robot
        if self.footprint is not None:
            told["footprint"] = [[*corner] for corner in self.footprint.corners]
        return self.detect.as_dict() | told


def zone_dict(zone: Zone) -> dict[str, Any]:
    """Return a zone as plain values; of its shape one of polygon, circle, line, or each of its polygons by name."""
    shape = zone.shape
    told: dict[str, Any] = {
        name: getattr(zone, name)
        for name in ("name", "frame", "action", "count", "min_points", "trigger", "release", "hold", "timeout")
    }
    if zone.topics:
        told["topics"] = [*zone.topics]
    if zone.action == "approach":
        told |= {name: getattr(zone, name) for name in ("time_before_collision", "time_step")}
    told |= {name: topic for name in ("shape_topic", "velocity_topic") if (topic := getattr(zone, name))}
    if zone.footprint is not None:
        told["footprint"] = [[*corner] for corner in zone.footprint.corners]
    match shape:
        case Polygon(corners):
            told["polygon"] = [[*corner] for corner in corners]
        case Circle(x, y, radius):
            told["circle"] = {"x": x, "y": y, "radius": radius}
        case Line(first, second):
            told["line"] = [[*first], [*second]]
        case None:
            told["polygons"] = {
                case.name: {
                    "polygon": [[*corner] for corner in case.shape.corners],
                    "linear": [*case.linear],
                    "turning": [*case.turning],
                    **({} if case.direction is None else {"direction": [*case.direction]}),
                }
                for case in zone.cases
            }
    return told


def refuse_options(options: ZoneOptions) -> None:
    """Refuse zones that need objects where none are known, and options that no zone needs (`OptionError`)."""
    if options.footprint is not None and not any(zone.shape_topic for zone in options.zones.zones):
        raise OptionError("--footprint is for zones whose shape a topic tells, and there are none")
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
