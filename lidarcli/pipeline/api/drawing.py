"""What `plot` draws and writes by its options, for the command line and for Python; it imports what a picture needs."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from os import PathLike, fspath
from typing import Any

from lidarcli.errors import OptionError
from lidarcli.files.newfiles import refuse, scratch_folder
from lidarcli.files.stores import Place
from lidarcli.options.choices import ANIMATIONS, IMAGES, MAP, Look
from lidarcli.options.times import as_time
from lidarcli.options.values import STDOUT, AnyPath, parse_numbers
from lidarcli.pipeline.api.options import Values, detect_options, listed, log_options, place_of, several, tracking_of
from lidarcli.pipeline.inputs.search import files_of
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.plotting import Drawn, PlotOptions, followed, sweep_at, take_map, take_pictures
from lidarcli.pipeline.reading.one_log import Progress


def look_of(options: Values) -> Look:
    """Return how a picture looks."""
    return Look(**{name: options[name] for name in ("width", "dpi", "title", "legend", "vertices", "fps")})


def refuse_suffix(output: AnyPath | None, options: Values) -> None:
    """Refuse a name that such a picture cannot have (`OptionError`)."""
    known, suffix = ANIMATIONS if options["animate"] else IMAGES, "" if output is None else place_of(output).suffix.lower()
    if output not in (None, STDOUT) and suffix not in known:
        still = " or --animate" if suffix in ANIMATIONS else ""
        raise OptionError(f"--output: {output}: the suffix has to be one of {', '.join(known)}{still}")
    if options["dpi"] is not None and suffix in (".svg", ".pdf"):
        raise OptionError("--dpi is for .png and animations; .svg and .pdf have no pixels")


def at_its_time(source: Source, options: Values, wanted: PlotOptions) -> PlotOptions:
    """Return what is drawn with the sweep of `at`."""
    if options["at"] is None:
        return wanted
    try:
        time = as_time(options["at"], wanted.time_zone)
    except OptionError as err:
        raise OptionError(f"--at: {err}") from None
    return replace(wanted, sweeps=(sweep_at(source, time, wanted.topic, wanted.opening),))


def refused(
    output: AnyPath | None, source: Source | None, options: Values, wanted: PlotOptions, overwrite: bool, default: str = ""
) -> list[Place]:
    """Return the files to write, none of which is read: one, or one for each sweep; without a name those of `default`."""
    if output == STDOUT or not (output or default):
        return []
    path, sweeps = place_of(output or default), wanted.sweeps
    # A name that is given is that of a single picture.
    is_one = options["animate"] or sweeps is None or (output is not None and len(sweeps) == 1)
    paths = [path] if is_one else [path.with_name(f"{path.stem}-{index}{path.suffix}") for index in sweeps or ()]
    read = [wanted.background, options["mask"], wanted.poses.file, *several(options["zones"])]
    read += [] if source is None else files_of([source])
    if isinstance(wanted.tracks, str) and not _is_log(options):
        from lidarcli.pipeline.inputs.tables import table_files

        read += map(str, table_files([wanted.tracks]))
    refuse(paths, overwrite, [fspath(file) for file in read if file])
    return paths


def _is_log(options: Values) -> bool:
    """Return whether the tracks to draw are those of the log itself, which are not known yet."""
    tracks = options["tracks"]
    return isinstance(tracks, str | PathLike) and fspath(tracks) in several(options["log"])


def draw_log(source: Source, options: Values, wanted: PlotOptions, progress: Progress | None = None) -> Drawn[Any]:
    """Return the pictures of a log; tracks of the log itself are found first."""
    with ExitStack() as stack:
        unread = {"topic": None, "start": None, "end": None}
        if _is_log(options):
            every = {**options, **unread, "background": None, "catalogue": None, "jobs": 0}
            detect, folder = detect_options(every, log_options(every), tracking_of()), stack.enter_context(scratch_folder())
            wanted = replace(wanted, tracks=followed(source, wanted.zones, detect, folder, progress))
        if options["view"] != MAP:
            return take_pictures(source, wanted, progress)
        # Only a map needs this import.
        from lidarcli.pipeline.mapping import MapOptions

        read = log_options({**options, "start": None, "end": None}).read
        parsed = MapOptions(read, wanted.opening, wanted.poses, parameters=wanted.parameters)
        only = listed(options["only"], parse_numbers)
        return take_map(source, parsed, wanted.sweeps, wanted.tracks, only, options["density"], progress)
