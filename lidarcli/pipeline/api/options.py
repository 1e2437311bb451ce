"""Values of options made into the records of the rooms below, for the command line and for Python.

Both name the values by the fields of `lidarcli.options.groups`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import timedelta
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from lidarcli.errors import OptionError
from lidarcli.files.stores import Place, place
from lidarcli.formalism.parameters import Parameters
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.open_options import open_options, range_rules
from lidarcli.options.choices import MAP, NS, REMOVABLE, TRAIL
from lidarcli.options.forms import Text, defaults_of
from lidarcli.options.objects import FindingGroup, ObjectGroup, Tracking
from lidarcli.options.reading import parse_no_return
from lidarcli.options.times import SECOND_NS, TimeZone, as_time, parse_zone
from lidarcli.options.values import SWEEP, AnyPath, parse_every, parse_mends, parse_removed, parse_sweeps, parse_value
from lidarcli.pipeline.reading.needs import NONE, PoseOptions
from lidarcli.sweeps.masks import Masks

if TYPE_CHECKING:
    from lidarcli.pipeline.clean.options import CleanOptions
    from lidarcli.pipeline.differences.runs import DiffOptions
    from lidarcli.pipeline.objects.detection import DetectOptions, TrackOptions
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions
    from lidarcli.pipeline.overlay.messages import OverlayOptions
    from lidarcli.pipeline.plotting import PlotOptions
    from lidarcli.pipeline.zones.options import ZoneOptions
    from lidarcli.sweeps.zone import Zones

R = TypeVar("R")
Values = Mapping[str, Any]
"""Values of options by their fields; all fields of a group are there."""
OPENING = ("columns", "angle_min", "angle_increment", "fov", "range_max", "degrees", "range_unit", "echo", "segments")


def refuse_lost(name: str, value: Any, *, is_alone: bool = False) -> None:
    """Refuse a text that is no value, alone or in a list (`OptionError`); `is_alone` as of `Text.lost`."""
    for text in value if isinstance(value, list | tuple | set) else (value,):
        if isinstance(text, str) and (words := Text.lost(text, is_alone=is_alone)):
            raise OptionError(f"{name}: {words}")


def several(values: Any) -> list[str]:
    """Return paths as text, from one or several (`TypeError` if these are none, such as a table in memory)."""
    # A data frame would give the names of its columns one by one.
    is_one = isinstance(values, str | PathLike) or not isinstance(values, Iterable) or hasattr(values, "columns")
    return [path_text(each) for each in ([values] if is_one else values)]


def given(convert: Callable[[Any], R], value: Any) -> R | None:
    """Return a value converted, None where none is given."""
    return None if value is None else convert(value)


def place_of(file: AnyPath) -> Place:
    """Return the place of a file or folder."""
    return place(fspath(file))


def path_text(value: Any) -> str:
    """Return the path of a file or folder as text (`TypeError` if it is none)."""
    if not isinstance(value, str | PathLike):
        raise TypeError(f"logs, files and outputs are named by their paths, not given as {type(value).__name__}")
    refuse_lost("a path", value)
    return fspath(value)


# Options of the rooms.


class LogOptions(NamedTuple):
    """Options for reading logs."""

    read: ReadOptions
    opening: OpenOptions
    poses: PoseOptions


def log_options(options: Values) -> LogOptions:
    """Return how logs are read."""
    # Range limits also say which points of a cloud are the robot itself.
    opening = open_options(
        **{name: options[name] for name in OPENING}, heights=options["slice"], bins=options["bins"], limits=options["range"]
    )
    return LogOptions(read_options(options), opening, pose_options(options))


def read_options(options: Values) -> ReadOptions:
    """Return which sweeps to read, and how ranges are classified; a command without these fields reads all sweeps."""
    topic, no_return, mask = options.get("topic"), options["no_return"], options["mask"]
    topics = frozenset(name for name in ([topic] if isinstance(topic, str) else topic or []) if name) or None
    text = no_return if isinstance(no_return, str) else ",".join(map(str, no_return))
    masks = None
    if mask is not None and mask != NONE:
        from lidarcli.pipeline.inputs.masks import AUTO, read_masks

        masks = Masks(learn=True) if mask == AUTO else read_masks(path_text(mask))
    rules = range_rules(options["range"], parse_no_return(text), masks)
    start, end, run = (options.get(name) for name in ("start", "end", "run"))
    every, zone = _every(options.get("every", 1)), time_zone_of(options)
    # In `zones` a time is an interval by which people are counted.
    stride = 1 if isinstance(every, timedelta) else every
    return ReadOptions(topics, start, end, run, stride, rules=rules, time_zone=zone)


def _every(value: int | str | timedelta) -> int | timedelta:
    return parse_every(value) if isinstance(value, str) else value


def time_zone_of(options: Values) -> TimeZone:
    """Return the time zone of times without one, and of those that people read."""
    try:
        return parse_zone(options.get("time_zone") or "UTC")
    except OptionError as err:
        raise OptionError(f"--time-zone: {err}") from None


def pose_options(options: Values) -> PoseOptions:
    """Return where poses come from, and how they are used."""
    file, delay = given(fspath, options["poses"]), options.get("pose_delay")
    return PoseOptions(options["pose"], file, delay, options["beam_order"], options["deskew"])


def detect_options(
    options: Values,
    logs: LogOptions,
    tracking: TrackOptions | None = None,
    parameters: Parameters | None = None,
    **more: Any,
) -> DetectOptions:
    """Return how objects are found; `parameters` replace the keywords of what an object is."""
    from lidarcli.pipeline.objects.detection import DetectOptions

    background = background_options(options)
    catalogue = options["catalogue"]
    if isinstance(catalogue, str | PathLike):
        # Most runs need not wait for this import.
        from lidarcli.pipeline.inputs.catalogue import read_catalogue

        catalogue = read_catalogue(catalogue)
    together = tracking is not None and tracking.tracks and not tracking.apart
    return DetectOptions(
        parameters=parameters_of(parameters, options, subtracted=background is not None),
        read=logs.read,
        opening=logs.opening,
        poses=replace(logs.poses, together=together),
        background=background,
        catalogue=catalogue,
        tracking=tracking,
        explain=options.get("explain", False),
        stamps=options.get("stamps", NS),
        jobs=options["jobs"] or 0,
        **more,
    )


def tracking_of(options: Values | None = None) -> TrackOptions:
    """Return how objects are followed, by default as `track` does."""
    # These imports take long, and only tracking needs them.
    from lidarcli.formalism.parameters import TrackParameters
    from lidarcli.pipeline.objects.detection import TrackOptions

    options = defaults_of(Tracking) if options is None else options
    parsed = TrackParameters(agent_score=options["agent_score"], memory=options["memory"])
    return TrackOptions(parsed, trajectories=options["trajectories"], apart=options["apart"])


def memory_of(options: Values) -> TrackOptions | None:
    """Return how `detect` classifies objects by all sweeps, None if it does not."""
    if not options["memory"]:
        return None
    from lidarcli.pipeline.objects.detection import TrackOptions

    return TrackOptions(tracks=False)


def diff_options(options: Values, logs: LogOptions, *, overwrite: bool = False) -> DiffOptions:
    """Return how runs are compared."""
    from lidarcli.pipeline.differences.runs import DiffOptions

    tracking = tracking_of(defaults_of(Tracking) | {"trajectories": False})
    detect = detect_options({**defaults_of(FindingGroup), **options}, logs, tracking)
    return DiffOptions(detect, options["align"], options["min_score"], overwrite)


def clean_options(options: Values, *, overwrite: bool = False) -> CleanOptions:
    """Return which beams are left out, and how they are found."""
    from lidarcli.pipeline.clean.options import CleanOptions

    logs = LogOptions(read_options(options), OpenOptions(segments=options["segments"]), pose_options(options))
    # Who asks for another job has not asked for this one.
    is_alone = all(options[name] is None for name in ("mend", "merge", "clips", "start", "end", "run"))
    remove = (REMOVABLE[0] if is_alone else NONE) if options["remove"] is None else options["remove"]
    return CleanOptions(
        detect_options({**options, "catalogue": None}, logs, tracking_of()),
        remove=_words("remove", remove, parse_removed) - {NONE},
        value=parse_value(str(options["value"])),
        overwrite=overwrite,
        mend=given(lambda words: _words("mend", words, parse_mends), options["mend"]),
        clips=given(place_of, options["clips"]),
        around=_around(options["around"]),
        **_chosen(options, "margin", "merge", "merge_frame"),
    )


def _around(value: float | str) -> float:
    around = as_time(value)
    if not isinstance(around, float) or around < 0:
        raise OptionError(f"--around: {value} is no time before and after a row")
    return around


def _words(name: str, value: Any, parse: Callable[[str], str]) -> frozenset[str]:
    """Return the words of an option that is a list, or one text."""
    words = [value] if isinstance(value, str) else value
    if not isinstance(words, list | tuple | set | frozenset) or not all(isinstance(each, str) for each in words):
        raise TypeError(f"{name} is a list of words, or one text, not {value!r}")
    return frozenset(word.strip() for word in parse(",".join(words)).split(","))


def plot_options(options: Values, parameters: Parameters | None = None) -> PlotOptions:
    """Return what is drawn, and how it is found; without tracks, and without the sweep of a time."""
    from lidarcli.pipeline.plotting import PlotOptions

    read, opening, poses = log_options({**options, "topic": None, "start": None, "end": None})
    return PlotOptions(
        sweeps=_sweeps_of(options),
        parameters=parameters_of(parameters, options),
        rules=read.rules,
        opening=opening,
        background=given(fspath, options["background"]),
        trail=TRAIL if options["trail"] is None else options["trail"],
        poses=poses,
        zones=_zones_of(options),
        follow="" if options["follow"] is None else str(options["follow"]).strip(),
        time_zone=read.time_zone,
        topic=options["topic"],
        start=given(lambda time: as_time(time, read.time_zone), options["start"]),
        end=given(lambda time: as_time(time, read.time_zone), options["end"]),
    )


def _sweeps_of(options: Values) -> tuple[int, ...] | None:
    """Return the sweeps to draw: the first by default; None: all, or that of a time."""
    if options["sweep"] is not None or options["sweeps"] is not None:
        name = "sweep" if options["sweeps"] is None else "sweeps"
        try:
            sweeps = listed(options[name], parse_sweeps)
            for sweep in sweeps:
                SWEEP.check(sweep)
            if not sweeps:
                raise OptionError("no sweep is named")
        except OptionError as err:
            raise OptionError(f"--{name}: {err}") from None
        return tuple(dict.fromkeys(map(int, sweeps)))
    return None if options["animate"] or options["view"] == MAP or options["at"] is not None else (0,)


def listed(value: Any, parse: Callable[[str], Iterable[Any]]) -> list[Any]:
    """Return the values of an option that is a list, one text or one value alone; None stands for the default."""
    if value is None:
        return []
    return [*parse(value)] if isinstance(value, str) else [*value] if isinstance(value, Iterable) else [value]


def overlay_options(options: Values, logs: LogOptions, *, overwrite: bool = False) -> OverlayOptions:
    """Return what is shown, and how it is found."""
    from lidarcli.pipeline.overlay.messages import OverlayOptions

    return OverlayOptions(
        detect_options(options, logs, tracking_of()),
        objects=given(path_text, options["objects"]),
        map=given(Path, options["map"]),
        zones=_zones_of(options),
        overwrite=overwrite,
        **_chosen(options, "with_log", "layout"),
    )


def zone_options(options: Values, logs: LogOptions, *, overwrite: bool = False) -> ZoneOptions:
    """Return which zones are watched, and how."""
    from lidarcli.pipeline.inputs.zones import parse_footprint, read_zones
    from lidarcli.pipeline.zones.options import ZoneOptions, refuse_options

    names, every = several(options["zones"]), _every(options["every"])
    parsed = ZoneOptions(
        zones=read_zones(names),
        files=tuple(names),
        detect=detect_options(options, logs, tracking_of()),
        objects=given(path_text, options["objects"]),
        find=not options["no_objects"],
        footprint=given(parse_footprint, options["footprint"]),
        overwrite=overwrite,
        clips=given(place_of, options["clips"]),
        interval_ns=round(every.total_seconds() * SECOND_NS) if isinstance(every, timedelta) else 0,
        around=_around(options["around"]),
        stops=options["stops"],
    )
    refuse_options(parsed)
    return parsed


def explained(parsed: ZoneOptions, wanted: float | str | None, outputs: Sequence[Place], commands: Any) -> ZoneOptions:
    """Return the options with what is to be explained, a time or `worst`, if anything; `commands` as of `Explained`."""
    from lidarcli.pipeline.zones.options import Explained

    if wanted is None:
        return parsed
    if not outputs:
        raise OptionError("--explain writes a page, a picture or a film: give -o why.html, why.png, why.gif or why.mp4")
    time = None if wanted == "worst" else as_time(wanted, parsed.detect.read.time_zone)
    return replace(parsed, explain=Explained(time, tuple(outputs), commands))


def _zones_of(options: Values) -> Zones | None:
    """Return the zones of the files that are named, None where none are."""
    from lidarcli.pipeline.inputs.zones import read_zones

    return read_zones(several(options["zones"])) if options["zones"] else None


def _chosen(options: Values, *names: str) -> dict[str, Any]:
    """Return the values of some options that are fields of a record, too; None for those that a command does not have."""
    return {name: options.get(name) for name in names}


def background_options(options: Values) -> BackgroundOptions | None:
    """Return what to compare sweeps with, and how; None without a background."""
    background = options.get("background")
    if background is None:
        return None
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions

    parsed = _chosen(options, "removed", "any_frame") | {
        "distance": options["station_distance"],
        "angle": given(math.radians, options["station_angle"]),
    }
    if isinstance(background, str | PathLike):
        return BackgroundOptions.of(fspath(background), **parsed)
    if not background:
        raise OptionError("a background of no sensor: nothing can be compared with it")
    return BackgroundOptions("the background", tuple(background), **parsed)


def parameters_of(parameters: Parameters | None, options: Values, *, subtracted: bool = False) -> Parameters:
    """Return the parameters as such, or from their keywords."""
    given = {name: options.get(name, default) for name, default in defaults_of(ObjectGroup).items()}
    if parameters is not None:
        if not isinstance(parameters, Parameters):
            raise TypeError(f"parameters have to be Parameters, not {type(parameters).__name__}")
        changed = sorted(name for name, value in defaults_of(ObjectGroup).items() if given[name] != value)
        if changed:
            raise TypeError(f"give either parameters or {', '.join(changed)}")
        return parameters
    # What differs from a background is no wall, however wide it is.
    if subtracted and given["max_width"] is None:
        given["max_width"] = math.inf
    return Parameters.for_profile(**given)


def refuse_reading(options: Values, group: type, *more: str) -> None:
    """Refuse options of how a log is read (`TypeError`), where sweeps in memory are given."""
    defaults = defaults_of(group) | dict.fromkeys(more)
    if changed := [name for name, value in defaults.items() if options[name] != value]:
        raise TypeError(f"only a log can be read with {', '.join(changed)}")
