"""Files of an overlay, and the settings of viewers next to it."""

from __future__ import annotations

from contextlib import ExitStack

from lidarcli.errors import OptionError
from lidarcli.files.newfiles import NewFiles, refuse, writing
from lidarcli.files.stores import Place
from lidarcli.maps.grids import image_of, read_map
from lidarcli.overlays.viewers import BAG, LAYOUT, RRD, RVIZ, SUFFIXES, layout_json, overlay_file, rviz_config
from lidarcli.pipeline.detecting import detect_to_temporary, second_half
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import one_table_set, tables_together
from lidarcli.pipeline.overlay.messages import Overlay, OverlayOptions
from lidarcli.pipeline.reading.one_log import Progress, RunSummary


def outputs_of(path: Place, options: OverlayOptions) -> tuple[Place, ...]:
    """Return all files that are written; what an .rrd shows first is in it."""
    settings = (LAYOUT, RVIZ) if options.layout and path.suffix.lower() != RRD else ()
    return (path, *(path.with_suffix(suffix) for suffix in settings))


def refuse_overlay(path: Place, source: Source, options: OverlayOptions) -> None:
    """Refuse outputs that cannot be written, and inputs that are not there, before any work.

    `OptionError`: an unknown suffix, standard input, or no rerun-sdk for an .rrd; `OutputError`: as of `refuse`;
    `UnreadableError`: there are no such tables, or no such map.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise OptionError(f"{path}: the suffix of an overlay has to be one of {', '.join(SUFFIXES)}")
    if source.is_stdin:
        raise OptionError("an overlay is made by reading the log twice; give the name of its file instead of -")
    if path.suffix.lower() == RRD:
        # It refuses to be imported without rerun, which is an extra.
        import lidarcli.overlays.rrd  # noqa: F401
    inputs = options.detect.inputs([source])
    if options.objects is not None:
        tables = one_table_set(options.objects)
        inputs += [str(tables.objects), str(tables.sweeps)]
    if options.map is not None:
        inputs += [str(options.map), str(image_of(options.map))]
    refuse(outputs_of(path, options), options.overwrite, inputs)


def write_overlay(source: Source, path: Place, options: OverlayOptions, progress: Progress | None = None) -> RunSummary:
    """Write the overlay of one log, and next to it the settings of viewers.

    `UnreadableError`: the log, its tables or the map cannot be read, or the tables are those of another log; `NoScanError`:
    no LaserScan topic, or not the one that was requested; `OutputError`: a file cannot be written.
    """
    grid = None if options.map is None else read_map(options.map)
    paths = outputs_of(path, options)
    with ExitStack() as stack:
        new = stack.enter_context(NewFiles(paths, options.overwrite))
        if options.objects is not None:
            tables, found = tables_together(options.objects), None
        else:
            tables, first = detect_to_temporary(source, new.part(path).with_name("tables"), options.detect, progress)
            found = first.summary
            progress = second_half(progress, source.size)
        is_ros2 = path.suffix.lower() != BAG
        work = Overlay(source, tables, grid, options, is_ros2)
        with writing(path, nameless=True):
            if path.suffix.lower() == RRD:
                work.record(new.part(path), stack, progress)
            else:
                file = overlay_file(new.part(path))
                stack.callback(file.abandon)
                for message in work.messages(stack, progress):
                    file.write(message)
                file.finish()
            if len(paths) > 1:
                new.part(paths[1]).write_bytes(layout_json(work.scene()))
                new.part(paths[2]).write_bytes(rviz_config(work.scene(), is_ros2=is_ros2))
        summary = work.summary(found)
        summary.notes += [*([grid.note] if grid and grid.note else []), *new.publish()]
    summary.outputs = [str(each) for each in paths]
    return summary
