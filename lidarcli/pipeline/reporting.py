"""Reports of tables: reads the columns that are needed, sums up, judges the checks, renders."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC
from itertools import count
from os.path import commonprefix
from typing import Any, NamedTuple

import pyarrow as pa

from lidarcli.display.screen import one_line
from lidarcli.errors import LidarcliError, OptionError, UnreadableError
from lidarcli.files.configfiles import read_toml
from lidarcli.files.stores import Place
from lidarcli.options.times import TimeZone
from lidarcli.pipeline.inputs.tables import (
    Given,
    TableSet,
    find_table_sets,
    find_tables,
    origin_of,
    read_changes,
    read_table,
    read_tracks,
    refuse_mixed,
)
from lidarcli.reports.changes import ChangesPart, changes_part
from lidarcli.reports.checks import Check, OfEachLog, OneRun, accepts, columns_needed, held, parse_check
from lidarcli.reports.columns import Origin, Rows, Run, least_observed
from lidarcli.reports.document import ReportPart
from lidarcli.reports.figures import COMPARED, OF_CHANGES, OF_MAPS, guards
from lidarcli.reports.report import Report
from lidarcli.reports.run import RunPart
from lidarcli.reports.streams import streams_of
from lidarcli.reports.summary import (
    OBJECT_COLUMNS,
    SWEEP_COLUMNS,
    TRACK_COLUMNS,
    TRACKED_COLUMNS,
    compare,
    edges_of,
    summarise,
)
from lidarcli.reports.trends import trends
from lidarcli.reports.wording import counted, span
from lidarcli.reports.zones import floored, parse_zone_check, unobserved, zones_alone, zones_in, zones_part
from lidarcli.tabular.reading import Readable, StoredTable
from lidarcli.tabular.schemas import COUNTS, EVENTS

Progress = Callable[[int, int], None] | None
"""Takes the number of steps that are done, and of all."""
FORMATS = ("text", "markdown", "html", "json", "junit", "github")
SHORT_FORMATS = ("text", "markdown", "github")
"""Those of which there is a short form."""
SUFFIXES = {
    ".txt": "text",
    ".md": "markdown",
    ".markdown": "markdown",
    ".html": "html",
    ".htm": "html",
    ".json": "json",
    ".xml": "junit",
}
VIEWER_COLUMNS = ("topic", "sweep", "object", "theta_i", "theta_f", "box_x", "box_y", "box_yaw", "thing")
"""Columns of the objects table that only the viewer reads."""
VIEWER_POSES = ("pose_x", "pose_y", "pose_yaw")
"""Columns of the sweeps table that only the viewer reads."""
TRACKED_VIEW = ("vx", "vy", "moving")
"""Columns of the objects table that only the viewer reads, where there are tracks."""
EVENT_COLUMNS = EVENTS.names
ZONE_COLUMNS = ("log", "topic", "sweep", "stamp", "zone", "points", "nearest", "ttc", "active", "agents", "observed")
"""Columns of the tables of zones that are read."""
NAMED = 10
"""Most tables, logs and baselines that the command of a page names."""


@dataclass(frozen=True, slots=True)
class ReportOptions:
    """Options of a report."""

    tables: tuple[Given, ...]
    checks: tuple[str, ...] = ()
    baseline: tuple[Given, ...] = ()
    logs: tuple[str, ...] = ()
    """Logs whose raw sweeps the viewer of the HTML shows."""
    join: bool = False
    """True where parts of these are one log."""
    time_zone: TimeZone = UTC


def understand(options: ReportOptions, zones: Collection[str] | None = None) -> list[Check]:
    """Parse the checks, or raise a usage error before any work is done; `zones`: the names that zones have, once known."""
    return [parse_check(text, bool(options.baseline), zones=zones) for text in options.checks]


def make_report(options: ReportOptions, viewer: bool = False, progress: Progress = None) -> Report:
    """Read the tables and make the report.

    Parameters
    ----------
    viewer : also read what the viewer of the HTML shows
    progress : called with the number of steps that are done, and of all: tables read, the figures, the viewer

    Raises
    ------
    UnreadableError
        None of the tables can be read, or the baseline cannot.
    """
    checks = understand(options)
    tables, base_found = find_tables(options.tables), find_table_sets(options.baseline)
    steps = 2 * len(tables.table_sets) + len(tables.changes) + 2 * len(base_found[0]) + 1 + viewer
    step = _steps(steps, progress)
    if missing := [check for check in checks if check.needs_changes and not tables.changes]:
        raise OptionError(
            f"--check '{missing[0].expression}' asks for changes, and no table of them is named; "
            "lidarcli diff A B -o x.changes.parquet writes it"
        )
    changes, unread = _read_changes(tables.changes, step)
    failed = [*tables.problems, *unread]
    if all(map(_is_of_zones, tables.table_sets)) and (tables.table_sets or changes is not None):
        return _without_objects(tables.table_sets, changes, failed, options, step)
    run, pairs, problems, alone = _load(tables.table_sets, failed, checks, viewer, step)
    run = replace(run, time_zone=options.time_zone)
    alone = [one._replace(log=source.log) for one, source in zip(alone, run.sources, strict=False)]
    if run.zones is not None:
        # Only now it is known which zones there are.
        checks = understand(options, run.zones.names)
    unseen = (*_unseen(checks, run.sources), *_unobserved(checks, run), *_unseen_changes(checks, changes))
    if options.baseline:
        compared = [check for check in checks if check.name != check.figure]
        base_run, _, base_problems, _ = _load(*base_found, compared, False, step)
        if base_problems:
            raise UnreadableError(f"baseline: {base_problems[0]}")
        judging = checks if compared else []
        missed = (*_unseen(judging, base_run.sources), *_unobserved(judging, base_run))
        unseen += tuple(f"baseline {line}" for line in missed)
        # Both runs share the edges of their histograms.
        edges = edges_of(*((one, streams_of(one)) for one in (run, base_run)))
        summary = summarise(run, edges)
        comparison = compare(run, summary, base_run, summarise(base_run, edges))
        part = RunPart(summary, comparison)
        of_sweeps = [check.expression for check in checks if check.name in COMPARED]
        if of_sweeps and not comparison.is_same:
            unseen += (f"baseline: of another recording, with other sweeps than --check '{of_sweeps[0]}' compares",)
    else:
        part = RunPart(summarise(run))
    runs = (*alone, *([] if changes is None else changes.runs))
    parts = (part, *([] if changes is None else [changes]))
    report = Report(parts, (), problems, unseen, runs, trends(alone, checks, options.time_zone))
    report = replace(report, verdicts=tuple(held(check, runs, report.figures, run) for check in checks))
    step()
    if not viewer:
        return report
    from lidarcli.pipeline.viewing import page_of

    page, unread_beams = page_of(run, part.summary, pairs, options.logs, options.join, _command(options))
    return replace(report, page=page, unread=(*report.unread, *unread_beams))


def checks_of(options: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the checks of `--check`, and those of the files of `--checks` (`OptionError`, `UnreadableError`)."""
    every = [*options["check"]]
    for file in options["checks"]:
        content = read_toml(file, "file of checks")
        found = content.get("checks")
        if {*content} != {"checks"} or not isinstance(found, list) or not all(isinstance(each, str) for each in found):
            raise OptionError(
                f'{file}: a file of checks holds one list of texts, checks = ["sweeps >= 100"], and nothing else'
            )
        if not found:
            raise OptionError(f"{file}: holds no check")
        for each in (own := [*map(OfEachLog, found)]):
            each.file = str(file)
        every += own
    return tuple(every)


def unread_suite(command: str, options: Mapping[str, Any], error: LidarcliError) -> bytes:
    """Return the JUnit suite of a command that could not read its input: each of its checks is not run."""
    from lidarcli.reports.programs import as_junit

    checks = options["check"]
    with suppress(LidarcliError):
        checks = checks_of(options)
    title = ", ".join(options.get("runs") or options.get("logs") or options.get("tables") or (command,))
    return encoded(as_junit(command, title, (), {}, [str(error)], skipped=checks))


def initial_checks(report: Report) -> str:
    """Return a file of checks that these runs pass, with room for others (`figures.guards`)."""
    found = guards([one.figures for one in report.runs] or [report.figures])
    lines = [f"  {json.dumps(one)},  # {span(values)} in {counted(len(values), 'run')}" for one, values in found.items()]
    head = f"# Checks of good runs ({one_line(report.title)}), for lidarcli report RUN --checks THIS_FILE"
    return "\n".join([head, "checks = [", *lines, "]", ""])


def _is_of_zones(pair: TableSet) -> bool:
    """Tell whether a log has tables of zones alone."""
    return (pair.zones.exists() or pair.events.exists()) and not (pair.objects.exists() or pair.sweeps.exists())


def _read_zones(pair: TableSet) -> tuple[pa.Table, pa.Table, pa.Table | None]:
    """Read the tables of events, of zones, and of counts if there is one, of a log, which belong together."""
    events, zones = read_table(pair, "events", EVENT_COLUMNS), read_table(pair, "zones", ZONE_COLUMNS)
    known = {*Rows.join([zones]).counts("zone")}
    # What Nav2 did, and where the robot stood, is of no zone.
    rows = Rows.join([events])
    others = sorted({*rows.counts("zone", ~(rows.are("kind", "nav2") | rows.are("kind", "stop")))} - known)
    if others:
        raise UnreadableError(
            f"{pair.events}: does not belong to {pair.zones.name}, which has no zone {others[0]}; "
            "write both again with lidarcli zones"
        )
    counts = read_table(pair, "counts", COUNTS.names) if pair.counts.exists() else None
    refuse_mixed(pair, {"zones": zones, "events": events, **({} if counts is None else {"counts": counts})})
    return events, zones, counts


def _read_changes(paths: Sequence[Readable], step: Callable[[], None]) -> tuple[ChangesPart | None, list[UnreadableError]]:
    """Read tables of changes; returns them, None without any, with an error for each that cannot be read."""
    found: list[tuple[str, pa.Table]] = []
    problems: list[UnreadableError] = []
    for path in paths:
        with _collected(problems):
            found.append((str(path), read_changes(path)))
        step()
    return changes_part(found) if found else None, problems


def _unseen_changes(checks: Sequence[Check], changes: ChangesPart | None) -> tuple[str, ...]:
    """Return a line where checks are of changes of runs that could be read in part alone."""
    damaged = [] if changes is None else [source for source in changes.sources if source.damage]
    if not damaged or not any(check.needs_changes for check in checks):
        return ()
    return (f"{damaged[0].log}: its runs were damaged when it was made ({damaged[0].damage[0]})",)


def _without_objects(
    pairs: Sequence[TableSet],
    changes: ChangesPart | None,
    failed: list[UnreadableError],
    options: ReportOptions,
    step: Callable[[], None],
) -> Report:
    """Report on zones, on changes, or on both, where there are no tables of objects."""
    kind = "zones" if pairs else "changes"
    read: dict[int, tuple[pa.Table, pa.Table, pa.Table | None]] = {}
    sources: list[Origin] = []
    for pair in pairs:
        with _collected(failed):
            found = read[len(sources)] = _read_zones(pair)
            sources.append(origin_of(pair, found[1]))
            step()
    if pairs and not read:
        raise nothing_read(failed)
    sources = [*_told_apart(sources)]
    for name, values in (("--baseline", options.baseline), ("--log", options.logs)):
        if values:
            raise OptionError(f"{name}: these are tables of {kind} alone; name the objects table of the log as well")
    others = ("damage", *(() if changes is None else (*OF_CHANGES, *OF_MAPS)))
    if pairs:
        zones = zones_in(read)
        checks = [parse_zone_check(text, zones.names, others) for text in options.checks]
        logs = enumerate(sources if len(sources) > 1 else [])
        alone = [zones_alone(source.log, read[k], checks, len(source.damage)) for k, source in logs]
        parts: list[ReportPart] = [zones_part(zones, sources, options.time_zone), *([] if changes is None else [changes])]
        incomplete = (*_unseen(checks, sources), *unobserved(checks, zones))
    else:
        assert changes is not None
        zones, parts, incomplete, alone = None, [changes], (), []
        checks = [parse_check(text, only=others) for text in options.checks]
    if not accepts(checks, "damage"):
        incomplete = (*incomplete, *_unseen_changes(checks, changes))
    runs, told = (*alone, *([] if changes is None else changes.runs)), trends(alone, checks, options.time_zone)
    report = Report(tuple(parts), (), tuple(map(str, failed)), incomplete, runs, told)
    figures = {"damage": sum(len(source.damage) for part in parts for source in part.sources), **report.figures}
    return replace(report, verdicts=tuple(held(check, runs, figures, zones) for check in checks))


def _command(options: ReportOptions) -> str:
    """Return the command that makes such a page, with the names of files but not their folders."""
    words = ["lidarcli", "report", *_names(options.tables)]
    for name, values in (("--log", _names(options.logs)), ("--baseline", _names(options.baseline))):
        words += [word for value in values for word in (name, value)]
    words += ["--join"] if options.join else []
    checks = [
        ("--checks", *_names([one.file])) if isinstance(one, OfEachLog) else ("--check", one) for one in options.checks
    ]
    return shlex.join([*words, *(word for pair in dict.fromkeys(checks) for word in pair), "-o", "report.html"])


def _names(paths: Sequence[Given]) -> list[str]:
    """Return the names of files, of many the first."""
    full = [str(path.objects if isinstance(path, TableSet) else path) for path in paths]
    names = [path.rstrip("/").split("/")[-1] or path for path in full]
    return names if len(names) <= NAMED else [*names[:NAMED], "..."]


def _steps(total: int, progress: Progress) -> Callable[[], None]:
    """Return a function to call once after each of `total` steps."""
    done = count(1)
    return lambda: None if progress is None else progress(next(done), total)


def _load(
    pairs: Sequence[TableSet],
    problems: Sequence[UnreadableError],
    checks: Sequence[Check],
    viewer: bool,
    step: Callable[[], None],
) -> tuple[Run, tuple[TableSet, ...], tuple[str, ...], list[OneRun]]:
    """Read the rows of all tables that can be read; returns them, a line for each problem, and several logs one by one."""
    problems = [*problems]
    problems += [
        UnreadableError(f"{pair.events}: no objects table beside it: write both into one folder, or report on zones alone")
        for pair in pairs
        if _is_of_zones(pair)
    ]
    pairs = [pair for pair in pairs if not _is_of_zones(pair)]
    columns = _columns_read(pairs, checks, viewer)
    read: list[_ReportTables] = []
    runs: list[OneRun] = []
    for pair in pairs:
        with _collected(problems):
            read.append(_read_tables(pair, columns, viewer, problems, step, stored=len(pairs) == 1))
            if len(pairs) > 1:
                run = _run_of(read[-1:])
                figures, stamps = summarise(run).figures, run.sweeps.integers("stamp")
                runs.append(OneRun.of(run.sources[0].log, stamps, figures, run, checks))
    if not read:
        raise nothing_read(problems)
    kept = tuple(one.pair for one in read)
    _refuse_missing(checks, kept)
    return _run_of(read), kept, tuple(map(str, problems)), runs


def _run_of(read: Sequence[_ReportTables]) -> Run:
    """Return the rows of the tables of one or many logs."""
    zones = {k: each.zones for k, each in enumerate(read) if each.zones is not None}
    return Run(
        _told_apart([replace(origin_of(each.pair, each.sweeps), tracked=each.tracks is not None) for each in read]),
        Rows.join([each.sweeps for each in read]),
        Rows.join([each.objects for each in read]),
        _joined([each.tracks for each in read]),
        _joined([each.trajectories for each in read]),
        zones_in(zones) if zones else None,
    )


def _told_apart(sources: Sequence[Origin]) -> tuple[Origin, ...]:
    """Return logs, if some have the same name with the folders of their tables, as far as these differ."""
    if len({one.log for one in sources}) == len(sources):
        return tuple(sources)
    shared = len(commonprefix([one.label for one in sources]).rpartition("/")[0])  # noqa: RUF071 (of names)
    return tuple(replace(one, log=one.label[shared:].lstrip("/").removesuffix(".objects.parquet")) for one in sources)


def _joined(tables: Sequence[pa.Table | StoredTable | None]) -> Rows | None:
    """Return the rows of the tables that there are, each with the number of its log."""
    there = {number: table for number, table in enumerate(tables) if table is not None}
    return Rows.join([*there.values()], [*there]) if there else None


class _ReportTables(NamedTuple):
    """The tables of one log; None for those that are not there, or cannot be read."""

    pair: TableSet
    sweeps: pa.Table | StoredTable
    objects: pa.Table | StoredTable
    tracks: pa.Table | None
    trajectories: pa.Table | StoredTable | None
    zones: tuple[pa.Table, pa.Table, pa.Table | None] | None


@contextmanager
def _collected(problems: list[UnreadableError]) -> Iterator[None]:
    """Add what cannot be read to the problems."""
    try:
        yield
    except UnreadableError as err:
        problems.append(err)


def _columns_read(pairs: Sequence[TableSet], checks: Sequence[Check], viewer: bool) -> dict[str, set[str]]:
    """Return the columns that are read, by table; those of tracks in the objects only where there are tracks."""
    columns = {
        "objects": {*OBJECT_COLUMNS, *columns_needed(checks, "objects")},
        "sweeps": {*SWEEP_COLUMNS, *columns_needed(checks, "sweeps")},
        "tracks": {*TRACK_COLUMNS, *columns_needed(checks, "tracks")},
    }
    has_tracks = any(pair.tracks.exists() for pair in pairs)
    if has_tracks:
        columns["objects"] |= {*TRACKED_COLUMNS}
    if viewer:
        from lidarcli.reports import map_picture, world

        columns["objects"] |= {*VIEWER_COLUMNS, *(TRACKED_VIEW if has_tracks else ())}
        columns["sweeps"] |= {*VIEWER_POSES, *map_picture.COLUMNS["sweeps"]}
        columns["tracks"] |= {*map_picture.COLUMNS["tracks"]}
        columns["trajectories"] = {*world.COLUMNS["trajectories"], *map_picture.COLUMNS["trajectories"]}
    return columns


def _read_tables(
    pair: TableSet,
    columns: dict[str, set[str]],
    viewer: bool,
    problems: list[UnreadableError],
    step: Callable[[], None],
    *,
    stored: bool,
) -> _ReportTables:
    """Read the tables of one log; without its objects and sweeps an `UnreadableError`, without others a problem.

    `stored`: of the only log, which may be long, columns are read one by one, later.
    """
    sweeps = read_table(pair, "sweeps", columns["sweeps"], stored=stored)
    step()
    objects = read_table(pair, "objects", columns["objects"], stored=stored)
    refuse_mixed(pair, {"sweeps": sweeps, "objects": objects})
    step()
    tracks = trajectories = zones = None
    with _collected(problems):
        found = read_tracks(pair, objects, columns["tracks"])
        if found is not None:
            refuse_mixed(pair, {"sweeps": sweeps, "tracks": found})
        if found is not None and viewer and pair.trajectories.exists():
            paths = read_table(pair, "trajectories", columns["trajectories"], stored=stored)
            refuse_mixed(pair, {"sweeps": sweeps, "trajectories": paths})
            trajectories = paths
        tracks = found
    with _collected(problems):
        if pair.zones.exists() or pair.events.exists():
            found = _read_zones(pair)
            refuse_mixed(pair, {"sweeps": sweeps, "zones": found[1]})
            zones = found
    return _ReportTables(pair, sweeps, objects, tracks, trajectories, zones)


def _unseen(checks: Sequence[Check], sources: Sequence[Origin]) -> tuple[str, ...]:
    """Return a line where checks saw only a part of the logs, and none of them limits the damage."""
    damaged = [source for source in sources if source.damage]
    if not checks or not damaged or accepts(checks, "damage"):
        return ()
    first, total = damaged[0], sum(len(source.damage) for source in damaged)
    more = f" and {len(damaged) - 1:,} more logs" if len(damaged) > 1 else ""
    return (
        f"{first.log}{more}: damaged when its tables were made ({first.damage[0]}); "
        f"--check 'damage <= {total}' accepts that",
    )


def _unobserved(checks: Sequence[Check], run: Run) -> tuple[str, ...]:
    """Return lines on logs and zones that checks ask for, and that were not observed all the time."""
    of_sweeps = [check for check in checks if not (check.needs_zones or check.needs_changes)]
    lines = [] if run.zones is None else [*unobserved(checks, run.zones)]
    least = least_observed(run.observed_in())
    if of_sweeps and least is not None and not accepts(checks, "observed"):
        some = f"{least.observed:,} of {counted(least.sweeps, 'sweep')} show anything"
        what = some if least.sweeps else "no sweep was read"
        lines.append(f"{least.log}: {what}; --check 'observed >= {floored(least.share)}' accepts that")
    return tuple(lines)


def _refuse_missing(checks: Sequence[Check], pairs: Sequence[TableSet]) -> None:
    """Refuse a check of tracks or zones where some log has none: it would speak of the others alone."""
    for check in checks:
        for needed, kind, how in (
            (check.needs_tracks, "tracks", "track LOG"),
            (check.needs_zones, "zones", "zones LOG --zones FILE"),
        ):
            missing = [getattr(pair, kind) for pair in pairs if needed and not getattr(pair, kind).exists()]
            if missing:
                raise OptionError(
                    f"--check '{check.expression}' asks for {kind}, but {missing[0]} is not there; lidarcli {how} writes it"
                )


def format_of(file: Place) -> str:
    """Return the format that the suffix of an output names (`OptionError` where it names none)."""
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise OptionError(f"{file}: the suffix names no format ({' '.join(SUFFIXES)})")
    return SUFFIXES[suffix]


def encoded(words: str) -> bytes:
    r"""UTF-8; bytes of a file name that are none stand as escapes, which JSON, too, reads.

    >>> encoded("bad\udcff")
    b'bad\\udcff'
    """
    return words.encode("utf-8", "backslashreplace")


def render(report: Report, kind: str, colour: bool = False, brief: bool = False) -> str:
    """The report in one of `FORMATS`, `brief` in one of `SHORT_FORMATS`; for html, one that was made with `viewer`."""
    if kind == "html":
        from lidarcli.reports import html

        return html.render(report)
    from lidarcli.reports import programs, text

    match kind:
        case "text":
            return text.as_text(report, colour, brief)
        case "markdown":
            return text.as_markdown(report, brief)
        case "github":
            return programs.as_github(report, "" if brief else text.as_text(report))
        case "json":
            return programs.as_json(report)
    warnings = [f"warning: {line}" for line in report.warnings]
    logs = [source.log for part in report.parts for source in part.sources]
    logs += [line.partition(": ")[0] for line in report.unread]
    told = (report.title, report.verdicts, report.figures, report.problems, warnings)
    return programs.as_junit("report", *told, logs=[*dict.fromkeys(logs)])


def nothing_read(problems: Sequence[UnreadableError]) -> LidarcliError:
    """Return the error where there is nothing to report on."""
    if not problems:
        return OptionError("no tables to report on")
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return UnreadableError(f"{problems[0]}{more}")
