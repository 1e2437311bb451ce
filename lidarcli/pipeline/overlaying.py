"""Objects and tracks of a log as a file that viewers play in step with it."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from lidarcli.errors import OptionError
from lidarcli.maps.mapserver import image_of, read_map
from lidarcli.newfiles import new_files, refuse, unwritable
from lidarcli.overlays.files import SUFFIXES, overlay_file
from lidarcli.overlays.viewers import LAYOUT, RVIZ, layout_json, rviz_config
from lidarcli.pipeline.detecting import DetectOptions, detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import Pair, one_pair
from lidarcli.pipeline.overlay_messages import Overlay
from lidarcli.pipeline.reading.reading import Progress
from lidarcli.pipeline.reading.summary import RunSummary
from lidarcli.stores.url import Place


@dataclass(frozen=True, slots=True)
class OverlayOptions:
    """Everything that `overlay` lets a user choose, apart from input and output."""

    detect: DetectOptions
    """How objects are found and followed, where no tables tell of them."""
    objects: str | None = None
    """The objects table of the log, where there is one."""
    with_log: bool = False
    """Copy scans and poses, too."""
    map: Path | None = None
    """A map (YAML) to show."""
    layout: bool = True
    """Write settings of viewers beside the file."""
    overwrite: bool = False


def outputs_of(path: Place, options: OverlayOptions) -> tuple[Place, ...]:
    """All files that are written."""
    beside = (LAYOUT, RVIZ) if options.layout else ()
    return (path, *(path.with_suffix(suffix) for suffix in beside))


def refuse_overlay(path: Place, source: Source, options: OverlayOptions) -> None:
    """Refuse outputs that cannot be written, and inputs of which nothing comes, before any work.

    Raises
    ------
    OptionError
        The suffix is none of `SUFFIXES`, or the log is standard input.
    OutputError
        As of `newfiles.refuse`.
    UnreadableError
        There are no such tables, or there is no such map.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise OptionError(f"{path}: the suffix of an overlay has to be one of {', '.join(SUFFIXES)}")
    if source.is_stdin:
        raise OptionError(
            "an overlay is made by reading the log twice; give the name of its file instead of -"
        )
    inputs = options.detect.inputs([source])
    if options.objects is not None:
        pair = one_pair(options.objects)
        inputs += [str(pair.objects), str(pair.sweeps)]
    if options.map is not None:
        inputs += [str(options.map), str(image_of(options.map))]
    refuse(outputs_of(path, options), options.overwrite, inputs)


def write_overlay(
    source: Source, path: Place, options: OverlayOptions, progress: Progress | None = None
) -> RunSummary:
    """Write the overlay of one log, and beside it the settings of viewers.

    Raises
    ------
    UnreadableError
        The log, its tables or the map cannot be read, or the tables are those of another log.
    NoScanError
        The log has no LaserScan topic, or not the one that was asked for.
    OutputError
        A file cannot be written.
    """
    grid = None if options.map is None else read_map(options.map)
    paths = outputs_of(path, options)
    with ExitStack() as stack:
        new = stack.enter_context(new_files(paths, options.overwrite))
        if options.objects is not None:
            pair, found = one_pair(options.objects), None
        else:
            pair, found = _found(source, options, new.part(path).with_name("tables"), progress)
            progress = _second(progress, source.size)
        try:
            file = overlay_file(new.part(path))
            stack.callback(file.abandon)
            work = Overlay(source, pair, grid, options.detect.opening, file.is_ros2, options.with_log)
            for message in work.messages(stack, progress):
                file.write(message)
            file.finish()
            if options.layout:
                new.part(paths[1]).write_bytes(layout_json(work.scene()))
                new.part(paths[2]).write_bytes(rviz_config(work.scene(), is_ros2=file.is_ros2))
        except OSError as err:
            if err.filename is None:
                raise unwritable(path, err) from err
            raise
        summary = work.summary(found)
        summary.notes += new.publish()
    summary.outputs = [str(each) for each in paths]
    return summary


def _found(
    source: Source, options: OverlayOptions, folder: Path, progress: Progress | None
) -> tuple[Pair, RunSummary]:
    """The tables of a log in a folder that is made, and what making them has met."""
    made = replace(options.detect, overwrite=True, layout=None)
    summary = detect_to_files(source, folder, made, _first(progress))
    return Pair(f"{folder / source.name}.", ".parquet"), summary


def _first(progress: Progress | None) -> Progress | None:
    """The progress of the first of two passes."""
    return None if progress is None else lambda position: progress(position // 2)


def _second(progress: Progress | None, size: int) -> Progress | None:
    """The progress of the second."""
    return None if progress is None else lambda position: progress((size + position) // 2)
