"""One run as it is compared: its static objects, its occupancy, its frame."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.formalism.matching import alignment
from lidarcli.formalism.matching.differences import RunEvidence
from lidarcli.formalism.matching.extents import BESIDE, contained, each_of, measured
from lidarcli.formalism.matching.free_space import SpaceMap
from lidarcli.formalism.matching.pairs import SAME_PLACE
from lidarcli.formalism.tracking.results import ENDS
from lidarcli.options import choices
from lidarcli.pipeline.inputs.tables import TracksTable, world_in
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.needs import of_one_run
from lidarcli.pipeline.reading.one_log import Reading
from lidarcli.sweeps.types import Float64, Int64
from lidarcli.sweeps.zone import ROBOT

AUTO, AS_IS, _ = choices.ALIGN


@dataclass(frozen=True, slots=True)
class DiffOptions:
    """Options of `diff`, apart from inputs and outputs."""

    detect: DetectOptions
    """Options of reading logs, and of finding and following static objects in them."""
    align: str = AUTO
    min_score: float = choices.MIN_SCORE
    overwrite: bool = False


@dataclass(slots=True)
class ObservedRun:
    """Static objects, occupancy and names of one input."""

    name: str
    run: RunEvidence
    world: str
    """Fixed frame of its places; empty for the sensor's own."""
    log: list[str] = field(default_factory=list)
    """Log of each object."""
    track: list[int] = field(default_factory=list)
    """Track of each object; 0 where there is none."""
    label: list[str | None] = field(default_factory=list)
    grid: Occupancy | None = None
    """The map, if it is one."""
    is_short: bool = False
    """True if nothing could be observed in it for as long as an object has to be static."""
    source: dict[str, Any] = field(default_factory=dict)
    reading: Reading | None = None
    """The first reading of its log."""
    before: SpaceMap | None = None
    """The occupancy by the given poses, where a map corrects them."""
    unsure: int = 0
    """Number of the last objects, which only a lost robot observed."""
    poses: list[str] = field(default_factory=list)
    """Notes on poses that a map corrects."""
    notes: list[str] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)

    @property
    def is_common(self) -> bool:
        """True if its world outlives a run."""
        return bool(self.world) and not of_one_run(self.world)


def joined(*parts: tuple[ObservedRun, Sequence[int]]) -> tuple[alignment.StaticObjects, Float64, dict[str, Any]]:
    """Return the objects of several runs, of each those in these rows: evidence, directions, and log, track, label."""
    names = alignment.StaticObjects.__dataclass_fields__
    things = {name: np.concatenate([getattr(one.run.things, name)[rows] for one, rows in parts]) for name in names}
    yaw = np.concatenate([one.run.yaw[rows] for one, rows in parts])
    lists = {name: [getattr(one, name)[k] for one, rows in parts for k in rows] for name in ("log", "track", "label")}
    return alignment.StaticObjects(**things), yaw, lists


_NONE, _NO_CODE = np.empty(0), np.empty(0, np.int32)
NOTHING = alignment.StaticObjects(_NONE, _NONE, _NONE, _NONE, _NONE, _NONE, _NO_CODE, _NO_CODE), _NONE
"""No objects, and no direction of any."""


def frame_key(world: str, topic: str, frame: str, robot: Sequence[tuple[str, str]] = ()) -> str:
    """Return the world of a sensor, which may be on a robot; one that lies in no common frame begins with a blank."""
    if world.rpartition("/")[2] not in ("", choices.MATCH, ROBOT):
        return world
    topic, frame = (" and ".join(dict.fromkeys(names)) for names in zip(*(robot or [(topic, frame)]), strict=True))
    return f" {frame} of {topic}"


def frame_words(key: str) -> str:
    """Return words for people on a frame, as of `frame_key`."""
    return f"the frame of the sensor {key.strip()}" if key.startswith(" ") else f"the frame {key}"


def known_or_none(value: float) -> float | None:
    """Return a number, None where it is not finite."""
    return float(value) if math.isfinite(value) else None


MAX_THINGS = 10_000
"""Most static objects of a run."""
MIN_SWEEPS, MIN_SECONDS = 10, 2.0
"""Fewest sweeps, and shortest time [s], in which a static object was observed."""


def travelled(table: TracksTable) -> dict[str | None, list[int]]:
    """Return the agents of each topic that went 0.5 m at least, and those of several topics by None.

    What only turned on the spot keeps its place, as a static object does.
    """
    rows = table.rows.to_pydict()
    moved: dict[str | None, list[int]] = {}
    for topic, track, kind, distance in zip(*(rows[name] for name in ("topic", "track", "set", "distance")), strict=True):
        if kind == "A" and distance >= 0.5:
            moved.setdefault(topic, []).append(track)
    return moved


def observed_run(
    name: str,
    table: TracksTable,
    grounds: dict[str, SpaceMap],
    places: dict[str, Float64],
    robots: Mapping[str, Sequence[tuple[str, str]]] | None = None,
) -> ObservedRun:
    """Return the static objects of a tracks table in the frame that has most of them, with its occupancy.

    `robots`: topic → the sensors that were followed together with it.
    """
    rows = table.rows.to_pydict()
    # What several sensors of a robot observed is in the world of all of them.
    one = next(iter(table.poses), "")
    of = next(iter(table.poses.get(one, {}).get("pose_verdict") or {}), "")
    of, one = next(iter((robots or {}).values()), [(of, one)])[0]
    sensors = [(topic or of, frame or one) for topic, frame in zip(rows["topic"], rows["frame_id"], strict=True)]
    keys = [
        frame_key(world_in(table.poses.get(frame, {}), topic), topic, frame, (robots or {}).get(topic, ()))
        for topic, frame in sensors
    ]
    worlds = np.array(keys, object)
    number = {each: np.array(rows[each], np.float64) for each in _MEASURED}
    sweeps = np.array(rows["sweeps"], np.int64)
    long = (sweeps >= MIN_SWEEPS) & (np.array(rows["duration"], np.float64) >= MIN_SECONDS)
    is_static = (np.array(rows["set"], object) == "O") & (np.array(rows["end"], object) != ENDS[1])
    sizes = dict.fromkeys(worlds, 0) | {world: len(ground.points) for world, ground in grounds.items()}
    key = max(sorted(sizes), key=lambda each: (sizes[each], int((worlds == each).sum())), default=" ")
    notes = []
    if others := sorted({*sizes} - {key}):
        notes.append(
            f"{name}: only what lies in {frame_words(key)} is compared, not in "
            f"{', '.join(each.strip() for each in others)} (--topic)"
        )
    at = np.flatnonzero(is_static & long & np.isfinite(number["x"] + number["y"]) & (worlds == key))
    at = at[_distinct({name: values[at] for name, values in number.items()}, sweeps[at])]
    if len(at) > MAX_THINGS:
        raise OptionError(f"{name}: more than {MAX_THINGS:,} standing things cannot be compared; take a part with --end")
    shapes, labels = ([_code(each) for each in rows[column]] for column in ("shape", "label"))
    things = alignment.StaticObjects(
        **{each: number[each][at] for each in _MEASURED if each != "yaw"},
        shape=np.array(shapes, np.int32)[at],
        label=np.array(labels, np.int32)[at],
    )
    yaw, ground = np.nan_to_num(number["yaw"][at]), grounds.get(key)
    if ground is not None:
        things, yaw, kept = measured(things, yaw, ground)
        at = at[kept]
    return ObservedRun(
        name,
        RunEvidence(things, yaw, ground, places.get(key, np.empty((0, 2)))),
        "" if key.startswith(" ") else key,
        log=[rows["log"][k] for k in at],
        track=[rows["track"][k] for k in at],
        label=[rows["label"][k] for k in at],
        is_short=bool(len(long)) and not long.any(),
        notes=notes,
    )


_MEASURED = ("x", "y", "yaw", "length", "width", "length_sd", "width_sd")


def _code(word: str | None) -> int:
    """Return the code of a word, the same in all runs; -1 for none."""
    return -1 if word in (None, "unknown") else zlib.crc32(str(word).encode()) >> 1


def _distinct(number: dict[str, Float64], sweeps: Int64) -> Int64:
    """Return the objects with a place of their own: of several in one place the one that was observed longest."""
    length, width = (np.fmax(number[name], 2.0 * (SAME_PLACE - BESIDE)) for name in ("length", "width"))
    boxes = np.column_stack([number["x"], number["y"], np.nan_to_num(number["yaw"]), length, width])
    inside = each_of(*contained(boxes, boxes[:, :2], BESIDE), len(boxes))
    kept: list[int] = []
    alone = np.ones(len(boxes), np.bool_)
    for k in np.argsort(-sweeps, kind="stable").tolist():
        if alone[k]:
            kept.append(k)
            alone[inside[k]] = False
        if len(kept) > MAX_THINGS:
            break
    return np.array(sorted(kept), np.int64)
