"""Keywords of the Python functions: shown, checked, and made into the options of the rooms below.

The command line makes its options by the same functions: both name the values by the fields of `lidarcli.options.groups`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, cleandoc, signature
from os import PathLike, fspath
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast, get_type_hints

from lidarcli.display.screen import Screen, byte_bar, count_bar
from lidarcli.errors import OptionError, warn
from lidarcli.files.stores import place
from lidarcli.formalism.background import Background
from lidarcli.formalism.matching.catalogue import Catalogue
from lidarcli.formalism.parameters import Parameters
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.registry import open_options, range_rules
from lidarcli.options.choices import NS, TRAIL
from lidarcli.options.forms import File, Number, Rule, Text, defaults_of, options_of, python_words, refuse_combinations
from lidarcli.options.groups import RULES
from lidarcli.options.objects import Finding, Objects, Tracking
from lidarcli.options.times import Instant, as_time
from lidarcli.options.values import AnyPath, parse_mends, parse_removed, parse_value
from lidarcli.pipeline.inputs.declared import AUTO, read_catalogue, read_masks
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.posing import NONE, PoseOptions
from lidarcli.pipeline.runs.over_logs import LogProgress, summed
from lidarcli.sweeps.masks import Masks
from lidarcli.sweeps.range_rules import parse_no_return

if TYPE_CHECKING:
    from lidarcli.pipeline.cleaning import CleanOptions
    from lidarcli.pipeline.differing import DiffOptions
    from lidarcli.pipeline.objects.detection import DetectOptions
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions
    from lidarcli.pipeline.objects.tracking import TrackOptions
    from lidarcli.pipeline.overlaying import OverlayOptions
    from lidarcli.pipeline.plotting import PlotOptions
    from lidarcli.pipeline.zoning import ZoneOptions

F = TypeVar("F", bound=Callable[..., Any])
Values = Mapping[str, Any]
"""Values of options by their fields; all fields of a group are there."""
WIDTH = 100
"""Columns of a docstring."""
Progress = bool | Callable[[int, int | None], object]
"""Wish to see how far the work is."""
_PROGRESS = "True for a bar on standard error, or a function of how much is done and how much there is (docs/python.md)"
OPENING = ("columns", "angle_min", "angle_increment", "fov", "range_max", "degrees", "range_unit", "echo", "segments")


# Functions with keywords.


def with_keywords(*rules: Rule) -> Callable[[F], F]:
    """Decorate a function whose `**options: Unpack[...]` are shown, checked by name and limits, and complete.

    Type checkers and editors that read sources understand `Unpack`; those that look at the living function, as IPython and
    help() do, get a signature and a docstring with every keyword. `rules` are refused beside `RULES`.
    """

    def decorate(function: F) -> F:
        group = function.__globals__[function.__annotations__["options"].removeprefix("Unpack[").removesuffix("]")]
        known, defaults = options_of(group), defaults_of(group)
        own = signature(function, eval_str=True)
        positional = [one for one in own.parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
        names = [one.name for one in positional] + list(known)

        @wraps(function)
        def called(*arguments: Any, **given: Any) -> Any:
            for at, value in enumerate(arguments):
                _refuse_lost(names[min(at, len(positional) - 1)], value)
            for name, value in given.items():
                if name not in names:
                    close = get_close_matches(name, names, 1)
                    hint = f"did you mean '{close[0]}'?" if close else f"there are {', '.join(names)}"
                    raise TypeError(f"{function.__name__}() has no option '{name}'; {hint}")
                if name in known:
                    _check(name, known[name].value, value)
                else:
                    _refuse_lost(name, value)
            values = {**defaults, **given}
            refuse_combinations((*RULES, *rules), known, values, lambda name: known[name].is_changed(values[name]))
            return function(*arguments, **values)

        types = keyword_types(group)
        keyword_only = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=defaults[name], annotation=types[name]) for name in known
        ]
        called.__signature__ = own.replace(parameters=[*positional, *keyword_only])  # type: ignore[attr-defined]
        meanings = [f"progress : {_PROGRESS}"] if "progress" in own.parameters else []
        meanings += [f"{name} : {python_words(name, option)}" for name, option in known.items()]
        lines = [fill(each, WIDTH, subsequent_indent="    ") for each in meanings]
        # They stand at the end of the list of parameters.
        text = cleandoc(function.__doc__ or "")
        mark = next(mark for mark in ("\n\nReturns\n", "\n\nRaises\n") if mark in text)
        called.__doc__ = text.replace(mark, "\n".join(["", *lines]) + mark, 1)
        return cast(F, called)

    return decorate


def keyword_types(group: type) -> dict[str, Any]:
    """Return the types of the keywords of a group."""
    return get_type_hints(
        group, None, {each.__name__: each for each in (Background, Catalogue, Sequence)} | {"AnyPath": AnyPath}
    )


def _check(name: str, form: Any, value: Any) -> None:
    """Refuse a number out of its limits, or a word that is none of a choice (`OptionError`); None stands for a default."""
    option = f"--{name.replace('_', '-')}"
    if isinstance(form, tuple) and value is not None and value not in form:
        raise OptionError(f"{option}: '{value}' is not one of {', '.join(form)}")
    if isinstance(form, Text | File):
        _refuse_lost(option, value, is_alone=isinstance(form, Text) and not form.is_list)
    if value is None or not isinstance(form, Number):
        return
    try:
        for number in value if form.count > 1 else (value,):
            form.check(number)
    except OptionError as err:
        raise OptionError(f"{option}: {err}") from None


def _refuse_lost(name: str, value: Any, *, is_alone: bool = False) -> None:
    """Refuse a text that is no value, alone or in a list (`OptionError`); `is_alone` as of `Text.lost`."""
    for text in value if isinstance(value, list | tuple | set) else (value,):
        if isinstance(text, str) and (words := Text.lost(text, is_alone=is_alone)):
            raise OptionError(f"{name}: {words}")


@contextmanager
def watched(progress: Progress, sources: Sequence[Source | MissingInput]) -> Iterator[LogProgress | None]:
    """Yield what the work on some logs calls with a log and the position in it; None where nobody wants to know."""
    if progress is True:
        with byte_bar(Screen()) as show:
            yield summed(sources, show)
    else:
        tell = _function(progress)
        yield None if tell is None else summed(sources, lambda done, total, _: tell(done, total))


@contextmanager
def counting(progress: Progress, description: str, unit: str) -> Iterator[Callable[[int, int | None], object] | None]:
    """Yield what work that is no reading calls with the number of things done, and of all."""
    if progress is True:
        with count_bar(description, None, unit, Screen()) as show:
            yield show
    else:
        yield _function(progress)


def _function(progress: Progress) -> Callable[[int, int | None], object] | None:
    if progress is False:
        return None
    if not callable(progress):
        raise TypeError(f"progress is True, False or a function of what is done and of all, not {progress!r}")
    return progress


# Inputs.


def sources_of(log: Any, join: bool) -> list[Source]:
    """Return the logs that are meant, each with a name of its own; `UnreadableError` where one that is named is none."""
    named = several(log)
    found = find_logs(named, join, warn)
    for each in found:
        if isinstance(each, MissingInput):
            error = type(each.error)(f"{each.path}: {each.error}")
            # What was asked for has to be there; of a folder the rest is read.
            if each.path in named:
                raise error
            warn(str(error))
    sources = [each for each in found if isinstance(each, Source)]
    names = Counter(each.name for each in sources)
    return [replace(each, name=each.path) if names[each.name] > 1 else each for each in sources]


def several(values: Any) -> list[str]:
    """Return paths as text, from one or several (`TypeError` if these are none, such as a table in memory)."""
    # A data frame would give the names of its columns one by one.
    is_one = isinstance(values, str | PathLike) or not isinstance(values, Iterable) or hasattr(values, "columns")
    return [path_text(each) for each in ([values] if is_one else values)]


def path_text(value: Any) -> str:
    """Return the path of a file or folder as text (`TypeError` if it is none)."""
    if not isinstance(value, str | PathLike):
        raise TypeError(f"logs, files and outputs are named by their paths, not given as {type(value).__name__}")
    _refuse_lost("a path", value)
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
    """Return which sweeps to read, and how ranges are judged; a command without these fields reads all sweeps."""
    topic, no_return, mask = options.get("topic"), options["no_return"], options["mask"]
    topics = frozenset(name for name in ([topic] if isinstance(topic, str) else topic or []) if name) or None
    text = no_return if isinstance(no_return, str) else ",".join(map(str, no_return))
    masks = None
    if mask is not None and mask != NONE:
        masks = Masks(learn=True) if mask == AUTO else read_masks(path_text(mask))
    rules = range_rules(options["range"], parse_no_return(text), masks)
    start, end, run = (options.get(name) for name in ("start", "end", "run"))
    return ReadOptions(topics, start, end, run, options.get("every", 1), rules=rules)


def pose_options(options: Values) -> PoseOptions:
    """Return where poses come from, and how they are used."""
    file = None if options["poses"] is None else fspath(options["poses"])
    return PoseOptions(options["pose"], file, options.get("pose_delay"), options["beam_order"], options["deskew"])


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
    together = tracking is not None and tracking.tracks and not tracking.apart
    return DetectOptions(
        parameters=parameters_of(parameters, options, subtracted=background is not None),
        read=logs.read,
        opening=logs.opening,
        poses=replace(logs.poses, together=together),
        background=background,
        catalogue=read_catalogue(catalogue) if isinstance(catalogue, str | PathLike) else catalogue,
        tracking=tracking,
        explain=options.get("explain", False),
        stamps=options.get("stamps", NS),
        jobs=options["jobs"] or 0,
        **more,
    )


def tracking_of(options: Values | None = None) -> TrackOptions:
    """Return how things are followed, by default as `track` does."""
    # These imports take long, and only tracking needs them.
    from lidarcli.formalism.parameters import TrackParameters
    from lidarcli.pipeline.objects.tracking import TrackOptions

    options = defaults_of(Tracking) if options is None else options
    parsed = TrackParameters(agent_score=options["agent_score"], memory=options["memory"])
    return TrackOptions(parsed, trajectories=options["trajectories"], apart=options["apart"])


def memory_of(options: Values) -> TrackOptions | None:
    """Return how `detect` judges things by all sweeps, if it does."""
    if not options["memory"]:
        return None
    from lidarcli.pipeline.objects.tracking import TrackOptions

    return TrackOptions(tracks=False)


def diff_options(options: Values, logs: LogOptions, *, overwrite: bool = False) -> DiffOptions:
    """Return how runs are compared."""
    from lidarcli.pipeline.differing import DiffOptions

    tracking = tracking_of(defaults_of(Tracking) | {"trajectories": False})
    detect = detect_options({**defaults_of(Finding), **options}, logs, tracking)
    return DiffOptions(detect, options["align"], options["min_score"], overwrite)


def clean_options(options: Values, *, overwrite: bool = False) -> CleanOptions:
    """Return which beams are left out, and how they are found."""
    from lidarcli.pipeline.cleaning import CleanOptions

    logs = LogOptions(read_options(options), OpenOptions(segments=options["segments"]), pose_options(options))
    return CleanOptions(
        detect_options({**options, "catalogue": None}, logs, tracking_of()),
        _words("remove", options["remove"], parse_removed) - {NONE},
        parse_value(str(options["value"])),
        options["margin"],
        overwrite,
        None if options["mend"] is None else _words("mend", options["mend"], parse_mends),
        None if options["clips"] is None else place(fspath(options["clips"])),
        _around(options["around"]),
        options["merge"],
        options["merge_frame"],
    )


def _around(value: float | str) -> float:
    around = as_time(value)
    if isinstance(around, Instant) or around < 0:
        raise OptionError(f"--around: {value} is no time before and after a row")
    return around


def _words(name: str, value: Any, parse: Callable[[str], str]) -> frozenset[str]:
    """Return the words of an option that is a list, or one text."""
    words = [value] if isinstance(value, str) else value
    if not isinstance(words, list | tuple | set | frozenset) or not all(isinstance(each, str) for each in words):
        raise TypeError(f"{name} is a list of words, or one text, not {value!r}")
    return frozenset(word.strip() for word in parse(",".join(words)).split(","))


def plot_options(options: Values, parameters: Parameters | None, sweeps: tuple[int, ...] | None) -> PlotOptions:
    """Return what is drawn of some sweeps, None for all, and how it is found; without tracks."""
    from lidarcli.pipeline.inputs.declared import read_zones
    from lidarcli.pipeline.plotting import PlotOptions

    read, opening, poses = log_options({**options, "topic": None, "start": None, "end": None})
    return PlotOptions(
        sweeps=sweeps,
        topic=options["topic"],
        parameters=parameters_of(parameters, options),
        rules=read.rules,
        opening=opening,
        background=None if options["background"] is None else fspath(options["background"]),
        trail=TRAIL if options["trail"] is None else options["trail"],
        poses=poses,
        start=options.get("start"),
        end=options.get("end"),
        zones=read_zones(several(options["zones"])) if options["zones"] else None,
    )


def overlay_options(options: Values, logs: LogOptions, *, overwrite: bool = False) -> OverlayOptions:
    """Return what is shown, and how it is found."""
    from lidarcli.pipeline.inputs.declared import read_zones
    from lidarcli.pipeline.overlaying import OverlayOptions

    objects, map_file = options["objects"], options["map"]
    return OverlayOptions(
        detect_options(options, logs, tracking_of()),
        None if objects is None else path_text(objects),
        options["with_log"],
        None if map_file is None else Path(map_file),
        read_zones(several(options["zones"])) if options["zones"] else None,
        options["layout"],
        overwrite,
    )


def zone_options(options: Values, logs: LogOptions, *, overwrite: bool = False) -> ZoneOptions:
    """Return which zones are watched, and how."""
    from lidarcli.pipeline.inputs.declared import parse_footprint, read_zones
    from lidarcli.pipeline.zoning import ZoneOptions, refuse_options

    names = several(options["zones"])
    parsed = ZoneOptions(
        zones=read_zones(names),
        files=tuple(names),
        detect=detect_options(options, logs, tracking_of()),
        objects=None if options["objects"] is None else path_text(options["objects"]),
        find=not options["no_objects"],
        footprint=None if options["footprint"] is None else parse_footprint(options["footprint"]),
        overwrite=overwrite,
        clips=None if options["clips"] is None else place(fspath(options["clips"])),
        around=_around(options["around"]),
    )
    refuse_options(parsed)
    return parsed


def background_options(options: Values) -> BackgroundOptions | None:
    """Return what to compare sweeps with, and how; None without a background."""
    background = options.get("background")
    if background is None:
        return None
    from lidarcli.pipeline.objects.subtracting import BackgroundOptions

    angle = options["station_angle"]
    parsed: dict[str, Any] = {
        "removed": options["removed"],
        "any_frame": options["any_frame"],
        "distance": options["station_distance"],
        "angle": None if angle is None else math.radians(angle),
    }
    if isinstance(background, str | PathLike):
        return BackgroundOptions.of(fspath(background), **parsed)
    if not background:
        raise OptionError("a background of no sensor: nothing can be compared with it")
    return BackgroundOptions("the background", tuple(background), **parsed)


def parameters_of(parameters: Parameters | None, options: Values, *, subtracted: bool = False) -> Parameters:
    """Return the parameters as such, or from their keywords."""
    given = {name: options.get(name, default) for name, default in defaults_of(Objects).items()}
    if parameters is not None:
        if not isinstance(parameters, Parameters):
            raise TypeError(f"parameters have to be Parameters, not {type(parameters).__name__}")
        asked = sorted(name for name, value in defaults_of(Objects).items() if given[name] != value)
        if asked:
            raise TypeError(f"give either parameters or {', '.join(asked)}")
        return parameters
    # What differs from a background is no wall, however wide it is.
    if subtracted and given["max_width"] is None:
        given["max_width"] = math.inf
    return Parameters.for_profile(**given)


def refuse_reading(options: Values, group: type, *more: str) -> None:
    """Refuse options of how a log is read (`TypeError`), where sweeps in memory are given."""
    unasked = defaults_of(group) | dict.fromkeys(more)
    if asked := [name for name, value in unasked.items() if options[name] != value]:
        raise TypeError(f"only a log can be read with {', '.join(asked)}")
