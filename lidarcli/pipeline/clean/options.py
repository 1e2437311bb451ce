"""Options of `clean`; logs that cannot be cleaned, and names that cannot be those of a copy."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.files.newfiles import refuse, refuse_nameless
from lidarcli.files.stores import Place, Url
from lidarcli.formalism.tracking.tracker import share_moving
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.registry import SUFFIXES, TopicChoice, format_of
from lidarcli.options.choices import ABOVE, AROUND, MATCH, NAN
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import TableSet, contradicted, world_in
from lidarcli.pipeline.inputs.tracked import columns_of
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.needs import NO_POSES, NONE, Need
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.reading import Readable, read_columns
from lidarcli.tabular.schemas import SCHEMAS
from lidarcli.tabular.writing import table_suffix


@dataclass(frozen=True, slots=True)
class CleanOptions:
    """Options of `clean`, apart from input and output."""

    detect: DetectOptions
    """Options of reading, detection and tracking; a mask covers the robot itself, times and run are the part to write."""
    remove: frozenset[str] = frozenset({"agents"})
    """Kinds of beams that are removed in addition to those under a mask: of agents and temporary."""
    value: str | float = NAN
    """Value of removed beams: one of `SAYINGS`, or a range [m]."""
    margin: int = 1
    """Neighbours of these beams that are removed, too."""
    overwrite: bool = False
    mend: frozenset[str] | None = None
    """Faults that are mended: words of `MENDS`, or `FOUND`; None: none."""
    clips: Readable | None = None
    """Table with a row for each log that is written."""
    around: float = AROUND
    """Time before and after each of its rows [s]."""
    merge: str | None = None
    """Topic of the merged sweeps of a robot; None: none are written."""
    merge_frame: str | None = None
    """Frame of these; None: that of the robot itself."""

    def inputs(self, sources: Sequence[Source]) -> list[str]:
        """Return the files that are read, none of which an output may replace."""
        return [*self.detect.inputs(sources), *([str(self.clips)] if isinstance(self.clips, Path) else [])]

    @property
    def is_cut(self) -> bool:
        """True if only a part of the log is written, or more than it: of a folder one file."""
        return self.merge is not None or not self.is_whole

    @property
    def is_whole(self) -> bool:
        """True if no part of the log is left out."""
        read = self.detect.read
        return all(each is None for each in (read.start, read.end, read.run, self.clips))

    def as_dict(self) -> dict[str, Any]:
        """Return all options that the result depends on, as plain values, for the table's metadata."""
        own: dict[str, Any] = {"remove": sorted(self.remove), "value": self.value, "margin": self.margin}
        own |= {"mend": sorted(self.mend)} if self.mend is not None else {}
        own |= {"merge": [self.merge, self.merge_frame]} if self.merge is not None else {}
        return self.detect.as_dict() | own

    def sweeps(self, log: Log, rules: RangeRules) -> Iterator[SweepBatch]:
        """Yield all sweeps; the pass that makes the tables reports the damage."""
        topics = self.detect.read.topics
        return read_batches(log, ReadOptions(topics, rules=rules), ReadReport(), TopicChoice(topics, log.topics()))


MAX_PLACED = 0.5
"""A sensor is placed if it has poses at this share of its sweeps."""
MOSTLY = 0.9
"""A sensor was stationary if it was so at this share of its sweeps."""


def table_path(path: Place) -> Place:
    """Return the path of the table next to a log."""
    return path.with_name(f"{_stem(path)}{table_suffix('cleaned')}")


def _stem(path: Place) -> str:
    """Return the name of a log without the suffixes of its container."""
    stem = path.name
    for suffix in (".zstd", ".mcap", ".bag", ".db3"):
        if stem.lower().endswith(suffix):
            stem = stem[: -len(suffix)]
    return stem


def refuse_names(source: Source, path: Place) -> None:
    """Refuse names that cannot be those of a log and its copy."""
    if source.is_stdin:
        raise OptionError("a log is cleaned by reading it twice; give the name of its file instead of -")
    if str(path) == "-":
        raise OptionError("a log is no text for standard output; give the name of a file")
    refuse_nameless(path)
    if isinstance(path, Url):
        same = str(path) == source.path
    else:
        original = Path(source.path)
        same = original.is_dir() and original.resolve() in path.resolve().parents
        with suppress(OSError):
            same |= path.samefile(original)
    if same:
        raise OptionError(f"{path} is the log that is read; write elsewhere with -o")


def refuse_log(log: Log, source: Source, path: Place, options: CleanOptions) -> None:
    """Refuse logs that cannot be cleaned, and outputs that cannot be written, before any work."""
    if not format_of(log).magic or source.parts:
        raise OptionError(f"{source.path}: only MCAP and ROS bags can be cleaned")
    topics = log.topics() if options.remove else None
    chosen = frozenset(TopicChoice(options.detect.read.topics, topics).chosen)
    for topic in topics or ():
        if topic.name in chosen and topic.encoding == "json":
            raise OptionError(f"{source.path}: {topic.name} is in JSON, which has no NaN, and cannot be cleaned")
        if topic.name in chosen and topic.encoding == "protobuf" and options.value == ABOVE:
            raise OptionError(f"--value above: {topic.name} is a {topic.type}, which tells no range_max")
    if options.clips is not None:
        return
    wanted = suffix_of(log, source, options.is_cut)
    name = path.name.lower()
    fits = name.endswith(wanted) if wanted else not name.endswith(SUFFIXES)
    if not fits and not wanted:
        raise OptionError(
            f"{path}: {source.path} is a ROS 2 bag folder, and clean changes no container: name a folder, e.g. "
            f"-o {path.with_name(_stem(path))}"
        )
    if not fits:
        raise OptionError(f"{path}: a copy of {source.path} has to have the suffix {wanted}; clean changes no container")
    if not wanted and isinstance(path, Url):
        raise OptionError(f"{path}: the folder of a ROS 2 bag is not written into a store")
    outputs = [path, *([table_path(path)] if options.remove else [])]
    refuse(outputs, options.overwrite, options.inputs([source]), folder_of(log, source, path, options.is_cut))


def folder_of(log: Log, source: Source, path: Place, is_cut: bool) -> Place | None:
    """Return the path of a copy that is a folder."""
    return None if suffix_of(log, source, is_cut) else path


def suffix_of(log: Log, source: Source, is_cut: bool) -> str:
    """Return the suffix of a copy, or of a part; empty for a folder, whose parts are files."""
    if Path(source.path).is_dir():
        if is_cut and "+" in log.format:
            raise OptionError(f"{source.path}: the bag has files of two kinds; cut one of them")
        return "" if not is_cut else ".mcap" if "mcap" in log.format else ".db3"
    suffix = format_of(log).suffixes[0]
    is_packed = suffix == ".db3" and log.compression == "zstd" and source.path.endswith(".zstd") and not is_cut
    return f"{suffix}.zstd" if is_packed else suffix


def blind_topics(tables: TableSet) -> set[str]:
    """Return the topics of which no beam has a range."""
    topics, valid = columns_of(tables, "sweeps", ("topic", "valid")).values()
    return {name for name in np.unique(topics).tolist() if not valid[topics == name].any()}


def refuse_motion(
    log: Log,
    tables: TableSet,
    described: dict[str, Any],
    posing: PoseAttacher,
    options: CleanOptions,
    rules: RangeRules,
    blind: Collection[str],
) -> None:
    """Refuse a log if it is not known where its sensor was while it moved.

    `posing` is that of the pass that made the tables, topics in `blind` have no ranges.
    """
    for frame, source in described.get("poses", {}).items():
        for topic, (words, is_apart) in contradicted(source, posing.file_gap).items():
            if world_in(source, topic) not in (("",) if is_apart else ("", MATCH)):
                raise UnreadableError(f"the poses of {frame or 'the sensor'} {words}")
    topics, pose_x = columns_of(tables, "sweeps", ("topic", "pose_x")).values()
    observing = [name for name in np.unique(topics).tolist() if name not in blind]
    unplaced = [name for name in observing if np.isfinite(pose_x[topics == name]).mean() < MAX_PLACED]
    if not unplaced:
        return
    choice = TopicChoice(options.detect.read.topics, log.topics())
    if posing.found is not None:
        posing = PoseAttacher.of(log, NO_POSES, choice, ReadOptions(rules=rules), need=Need.MOVING)
    tracks = read_columns(tables.tracks, "tracks", SCHEMAS["tracks"], ("topic", "set", "sweeps")).to_pylist()
    for topic in unplaced:
        paths = [path for run in posing.every for (name, _), path in run.paths.items() if name == topic]
        was_stationary = bool(paths) and all(len(path.still) and path.still.mean() >= MOSTLY for path in paths)
        drove = any(not len(path.still) for path in paths)
        own = [row for row in tracks if row["topic"] in (topic, None)]
        share = share_moving([row["sweeps"] for row in own], [row["set"] == "A" for row in own])
        if was_stationary or not (drove or share is not None):
            continue
        seems = "the sensor moves" if share is None else f"{share:.0%} of what stands seems to move"
        is_none = options.detect.poses.source == NONE
        why = "no poses (--pose none)" if is_none else "no poses, and the path cannot be matched"
        raise UnreadableError(f"{why}: {seems}; nothing written")
