"""`lidarcli diff`, `zones` and `report`: what changed, who came near and what was found, evaluated by checks."""

import json
import shlex
from collections.abc import Mapping, Sequence
from functools import partial, wraps
from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any

import click
from click.core import ParameterSource

from lidarcli.cli.commands import Work, command, log_options, usage_errors
from lidarcli.cli.messages import (
    MessageWriter,
    Total,
    are_shown_together,
    chosen_logs,
    coloured,
    counted_bar,
    print_reads,
    progress_bar,
    show,
    standard_output,
    wrapped,
)
from lidarcli.display.screen import one_line
from lidarcli.display.texts import counted, moment, no_command
from lidarcli.files.stores import place
from lidarcli.options.choices import EXPLAINED, JUNIT
from lidarcli.options.common import CHECK, Checked, ManyLogs, Overwrite, Reported, TextOrJson, output
from lidarcli.options.forms import Argument, File, Option
from lidarcli.options.groups import ZONE_RULES, Diffing, Reporting, Zoning
from lidarcli.options.values import CHECKS, OUTPUT, STDOUT

if TYPE_CHECKING:
    from lidarcli.reports.report import Report


def junit_of_errors(work: Work) -> Work:
    """Write an error by which nothing is checked to the JUnit files of a command: none of an earlier run is left."""

    @wraps(work)
    def with_junit(messages: MessageWriter, options: Any) -> int:
        from lidarcli.errors import NoScanError, OutputError, UnreadableError
        from lidarcli.files.newfiles import write_whole
        from lidarcli.pipeline.reporting import unread_suite

        names = options["output"] or (STDOUT,)
        is_junit = options.get("format") == "junit" and len(names) == 1
        try:
            return work(messages, options)
        except (NoScanError, UnreadableError) as err:
            data = unread_suite(work.__name__, options, err)
            for name in (name for name in names if is_junit or place(name).suffix.lower() == JUNIT):
                try:
                    if name == STDOUT:
                        standard_output().buffer.write(data)
                    else:
                        messages.notes(write_whole(place(name), data, options["overwrite"], devices=True))
                except OutputError as failed:
                    messages.error(str(failed))
            raise

    return with_junit


class DiffCommand(Overwrite, TextOrJson, Diffing, Checked, total=False):
    runs: Annotated[tuple[str, ...], Argument("RUN...", File("RUN"), several=True)]
    output: Annotated[
        tuple[str, ...],
        output("FILE", shown="none", several=True),
        "File to write; may be repeated: .parquet or .csv (table of changes), .png (picture), .xml (checks, as JUnit).",
    ]
    check: Annotated[
        tuple[str, ...], CHECK, "Condition that must hold, else exit code 1: gone == 0 (docs/diff.md); may be repeated."
    ]


@command(
    DiffCommand,
    examples="""\
  lidarcli diff monday.mcap tuesday.mcap -o changes.parquet -o changes.png
  lidarcli diff site.yaml today.mcap --check "gone == 0" --check "new <= 2"
  lidarcli diff monday.tracks.parquet tuesday.tracks.parquet -o changes.csv
  lidarcli diff empty.background.parquet today.bag --align as-is
  lidarcli diff monday.bag tuesday.bag wednesday.bag --min-score 0.95
  lidarcli diff truth.map.yaml room.yaml --format json""",
)
@junit_of_errors
def diff(messages: MessageWriter, options: DiffCommand) -> int:
    """Find what changed between runs: moved, new, gone.

    RUN is a log, a tracks table, a background, or a map (.yaml of map_server). Each is
    compared with the last one before it that saw the place. Only what was in view can
    have gone: the rest is uncertain, with the reason.
    """
    logs = log_options(options)

    from lidarcli.pipeline.api.options import diff_options
    from lidarcli.pipeline.differences.changes import parse_checks, refuse_outputs, write_changes
    from lidarcli.pipeline.differences.comparison import diff_inputs
    from lidarcli.pipeline.differences.inputs import inputs_of
    from lidarcli.pipeline.reporting import checks_of
    from lidarcli.system.machine import keep_freed_memory

    outputs = [place(each) for each in options["output"]]
    with usage_errors():
        parsed = diff_options(options, logs, overwrite=options["overwrite"])
        checks = parse_checks(checks_of(options))
        inputs = inputs_of(options["runs"])
        refuse_outputs(outputs, inputs, parsed)
    keep_freed_memory()
    messages.of_missing_core()
    with progress_bar([one.source for one in inputs if one.source is not None], messages) as report:
        found = diff_inputs(inputs, parsed, report)
    found.judge(checks)
    if options["format"] == "json":
        click.echo(json.dumps(found.as_dict(), indent=2))
    else:
        for line in found.lines:
            click.echo(no_command(one_line(line)))
    for line in found.damage:
        messages.error(line)
    messages.notes([*found.notes, *write_changes(found, outputs, options["overwrite"], options["runs"])])
    messages.wrote(outputs)
    messages.failed(found.verdicts)
    return found.exit_code


class ZonesCommand(Zoning, ManyLogs, Checked, Reported, total=False):
    output: Annotated[
        tuple[str, ...],
        output("DIR", shown="none", several=True),
        "Folder for the tables <log>.events.parquet and <log>.zones.parquet; also a .xml file for the checks (JUnit).",
    ]
    check: Annotated[
        tuple[str, ...],
        CHECK,
        "Condition that must hold, else exit code 1: zones.NAME.events == 0 (docs/zones.md); may be repeated.",
    ]


@command(
    ZonesCommand,
    examples="""\
  lidarcli zones run.mcap --zones nav2.yaml -o tables
  lidarcli zones run.mcap --zones zones.toml --check "zones.stop.events == 0"
  lidarcli zones run.mcap --zones doors.toml --check "zones.door.in >= 30"
  lidarcli zones run.bag --zones nav2.yaml --explain 14:02 -o why.html
  lidarcli zones run.bag --zones zones.toml --objects run.objects.parquet
  lidarcli zones run.bag --zones zones.toml --mask robot.toml --no-objects
  lidarcli zones run.mcap --zones nav2.yaml --clips clips --around 3s
  lidarcli zones run.db3 --zones nav2.yaml \\
    --footprint '[[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]]'""",
    changed={field: {"rare": True} for field in ("background", "max_width", "clips", "range", "jobs")},
    rules=ZONE_RULES,
)
@junit_of_errors
def zones(messages: MessageWriter, options: ZonesCommand) -> int:
    """Find who or what came too close: when, how near, how long.

    Zones are polygons, circles and lines about the sensor, the robot or in the world, of a
    TOML file or of Nav2's Collision Monitor, whose rules they follow. Walls count, too.
    An offline check of a recording, no safety function.
    """
    outputs = [place(each) for each in options["output"]]
    suites = [path for path in outputs if path.suffix.lower() == JUNIT]
    answers = [path for path in outputs if path.suffix.lower() in EXPLAINED and options["explain"] is not None]
    folders = [path for path in outputs if path not in (*suites, *answers)]
    folder = folders[0] if folders else None
    if STDOUT in options["output"] or len(folders) > 1:
        raise click.UsageError("-o takes one folder, and .xml files; there is no standard output of tables")
    logs = log_options(options)

    from lidarcli.errors import CHECK_FAILED, UnreadableError
    from lidarcli.pipeline.api.options import explained, zone_options
    from lidarcli.pipeline.reporting import checks_of
    from lidarcli.pipeline.zones.run import judge, refuse_outputs, understand, watch_files, write_verdicts
    from lidarcli.pipeline.zones.summary import ZoneSummary

    with usage_errors():
        zoning = zone_options(options, logs, overwrite=options["overwrite"])
        zoning = explained(zoning, options["explain"], answers, partial(_commands, options))
        checks = understand(zoning, checks_of(options))
    messages.begin(options, finds=True)
    sources = chosen_logs(messages, options)
    for name, value in (("--objects", zoning.objects), ("--explain", zoning.explain)):
        if value is not None and len(sources) != 1:
            raise click.UsageError(f"{name} is for one log, and these are {len(sources):,}")
    writes = refuse_outputs(sources, folder, zoning, suites)
    if options["dry_run"]:
        return print_reads(sources, writes)
    total = Total()
    failed, tables, problems, found = False, [], [], []

    def lines_of(run: ZoneSummary) -> list[str]:
        since = f" from {moment(run.first_ns, run.time_zone)}" if run.first_ns is not None else ""
        where = f"{counted(run.sweeps, 'sweep')} of {', '.join(sorted(run.topics))}{since}"
        alone = len(sources) == 1
        lines = chain(*(wrapped(*line) for line in (*run.lines, *(run.worst if alone or messages.verbose else ()))))
        look = [f"  look     {_plot_command(options, *run.look)}"] if run.look and alone else []
        # Of several answers the gist; the pages have the rest.
        gist = [line for one in run.answers for line in (one if len(run.answers) == 1 else one[:2])]
        why = chain(*(wrapped("  why      " if not k else " " * 11, line) for k, line in enumerate(gist)))
        return [f"{where}, {counted(len(zoning.zones.zones), 'zone')}", *lines, *look, *why]

    with progress_bar(sources, messages) as report:
        for outcome in watch_files(sources, folder, zoning, report):
            total.add(outcome)
            show(outcome, messages, lines_of)
            problems += [f"{outcome.label}: {line}" for line in outcome.problems]
            if isinstance(outcome.summary, ZoneSummary):
                tables += [(outcome.label, outcome.summary.tables)] if checks or suites else []
                found += [f"{outcome.label}: {line.strip()}" for line in lines_of(outcome.summary)]
            else:
                failed = True
    # Where a log cannot be read, checks of all together are not run.
    skipped = [each for each in checks if failed and not (each.is_of_each and tables)]
    held = [each for each in checks if each not in skipped]
    verdicts, unobserved, figures = judge(held, tables)
    for line in unobserved:
        messages.error("incomplete", line)
    for path in suites:
        title = sources[0].label if len(sources) == 1 else counted(len(sources), "log")
        names = [each.expression for each in skipped], [one.label for one in sources]
        suite = (title, verdicts, {} if failed else figures, [*problems, *unobserved], found, *names)
        messages.notes(write_verdicts(path, options["overwrite"], *suite))
        messages.wrote([path])
    code = CHECK_FAILED if messages.failed(verdicts) and not failed else total.exit_code(sources)
    if not code and unobserved:
        code = UnreadableError.exit_code
    return messages.end(code, checks=[one.as_dict() for one in [*verdicts, *judge(skipped, ())[0]]])


def _again(options: Mapping[str, Any], command: click.Command, *first: str) -> list[str]:
    """A command on the same log and zones, with those options of `zones` that it takes, too, as they were typed."""
    words = ["lidarcli", str(command.name), *options["logs"], *first]
    ctx = click.get_current_context()
    for each in command.params:
        value, source = ctx.params.get(str(each.name)), ctx.get_parameter_source(str(each.name))
        is_own = each.name in ("output", "overwrite", "topic", "explain", "start", "end", "format")
        # Those of several values name tables and the like.
        if source is ParameterSource.COMMANDLINE and not is_own and isinstance(value, str | int | float):
            words += [each.opts[0], *([] if isinstance(value, bool) else [str(value)])]
    return [*words, *(word for file in options["zones"] for word in ("--zones", file))]


def _plot_command(options: Mapping[str, Any], topic: str, seconds: float) -> str:
    """The command that draws the sweep of a topic at a time."""
    from lidarcli.cli.plot import plot

    words = _again(options, plot(), "--topic", topic, "--at", f"{seconds:.3f}")
    tracks = options["objects"] or options["logs"][0]
    return shlex.join(words if options["no_objects"] else [*words, "--tracks", str(tracks)])


def _commands(options: Mapping[str, Any], topic: str, seconds: float) -> list[str]:
    """The commands that show more of a topic at a time: its sweep, this answer again, and the log around each event."""
    again = _again(options, zones(), *(word for each in options["topic"] or () for word in ("--topic", each)))
    return [
        _plot_command(options, topic, seconds),
        shlex.join([*again, "--explain", f"{seconds:.1f}", "-o", "why.html"]),
        shlex.join([*again, "--clips", "clips"]),
    ]


class ReportCommand(Overwrite, Reporting, total=False):
    tables: Annotated[tuple[str, ...], Argument("TABLE...", File("TABLE"), several=True)]
    output: Annotated[
        tuple[str, ...],
        output("FILE", shown="standard output", several=True),
        "File to write, may be repeated: .txt, .md, .html, .json or .xml (JUnit).",
    ]
    format: Annotated[
        str | None,
        Option(OUTPUT, ("text", "markdown", "html", "json", "junit", "github"), shown="by suffix, else text"),
        "Format, where the suffix does not say it.",
    ]
    brief: Annotated[
        bool, Option(OUTPUT, None, False), "Only the checks and a summary in a line: text, markdown or github."
    ]
    init: Annotated[
        str | None,
        Option(CHECKS, File("FILE", is_output=True), shown="none"),
        "Write the checks that good runs set for others to this file, for --checks (TOML, docs/ci.md).",
    ]


@command(
    ReportCommand,
    examples="""\
  lidarcli report tables/ -o run.html --log run.mcap
  lidarcli report tables/ -o out.html -o out.xml --check "sweeps >= 100"
  lidarcli report good/* --init checks.toml
  lidarcli report tables/ --checks checks.toml --brief
  lidarcli report tables/ --check "objects_per_sweep.p95 <= 12" --brief
  lidarcli report tables/ --check "objects where width > 1.5 == 0"
  lidarcli report tables/ --check "agents_at_once.max <= 3"
  lidarcli report new/ --baseline old/ --check "changed_sweeps == 0"
  lidarcli report site.changes.parquet -o site.html --check "gone == 0"
  lidarcli report 'tables/*.parquet' --format json | jq .figures
  lidarcli report tables/ --check "sweeps >= 100" --format github
  lidarcli report tables/ --format junit -o report.xml --overwrite""",
)
@junit_of_errors
def report(messages: MessageWriter, options: Mapping[str, Any]) -> int:
    """Sum up the tables of one or many runs, and check them.

    TABLE is an objects, sweeps or tracks table of detect or track (the others are
    found beside it), a table of changes of diff, a folder to search, or a pattern.
    """
    tables, baseline, logs = options["tables"], options["baseline"], options["log"]
    brief, init = options["brief"], options["init"]
    # Who only wants the checks of good runs reads those.
    outputs = options["output"] or (() if init and not (brief or options["format"]) else (STDOUT,))

    from lidarcli.files.newfiles import refuse, write_whole
    from lidarcli.pipeline import reporting
    from lidarcli.pipeline.api.options import time_zone_of
    from lidarcli.pipeline.inputs.search import files_of, find_logs
    from lidarcli.pipeline.inputs.tables import table_files
    from lidarcli.system.machine import give_freed_memory_back

    give_freed_memory_back()
    formats = _formats(outputs, options["format"], reporting.SUFFIXES)
    if brief and not {*formats} & {*reporting.SHORT_FORMATS}:
        raise click.UsageError(f"--brief is for {', '.join(reporting.SHORT_FORMATS)}; leave it out for {formats[0]}")
    checks, zone = reporting.checks_of(options), time_zone_of(options)
    parsed = reporting.ReportOptions(tables, checks, baseline, logs, options["join"], zone)
    reporting.understand(parsed)
    files = [place(name) for name in (*outputs, *([init] if init else [])) if name != STDOUT]
    if files:
        read = table_files([*tables, *baseline])
        refuse(files, options["overwrite"], [*map(str, read), *files_of(find_logs(logs))], devices=True)
    with counted_bar("report", None, "steps", messages) as progress:
        made = reporting.make_report(parsed, viewer="html" in formats, progress=progress)
    written = [*zip(outputs, formats, strict=True)]
    _show_problems(messages, made, written)
    for name, form in written:
        short = brief and form in reporting.SHORT_FORMATS
        if name == STDOUT:
            words = reporting.render(made, form, colour=coloured(standard_output()), brief=short)
            standard_output().buffer.write(reporting.encoded(words))
        else:
            data = reporting.encoded(reporting.render(made, form, brief=short))
            notes = write_whole(place(name), data, options["overwrite"], devices=True)
            messages.wrote([name])
            messages.notes(notes)
    if init and not made.unread:
        text = reporting.initial_checks(made)
        if not outputs:
            click.echo(no_command(text), nl=False)
        hurt = [f"{init}: learnt from logs that are damaged, which are no good runs"] if made.figures.get("damage") else []
        messages.notes([*write_whole(place(init), reporting.encoded(text), options["overwrite"]), *hurt])
        messages.wrote([init])
    messages.failed(made.verdicts)
    return made.exit_code


def _show_problems(messages: MessageWriter, made: "Report", written: Sequence[tuple[str, str]]) -> None:
    """Show problems and warnings on stderr, unless standard output shows them in the same place."""
    from lidarcli.pipeline.reporting import SHORT_FORMATS

    is_shown = any(name == STDOUT and form in SHORT_FORMATS for name, form in written)
    # Workflow commands are for the log of a step, which shows both.
    if not (is_shown and ((STDOUT, "github") in written or are_shown_together())):
        for kind, problem in made.named_problems:
            messages.error(*((kind, problem) if kind == "incomplete" else (problem,)))
    if not is_shown:
        for warning in made.warnings:
            messages.info(f"warning: {warning}")


def _formats(outputs: Sequence[str], kind: str | None, suffixes: dict[str, str]) -> list[str]:
    """Return the format of each output: of a single one that of --format, else that of its suffix.

    Of several outputs, --format is for those whose suffix names no format.
    """
    if len(outputs) == 1 and kind is not None:
        return [kind]
    found = [None if name == STDOUT else suffixes.get(place(name).suffix.lower()) for name in outputs]
    if kind is not None and None not in found:
        raise click.UsageError("--format is for an output whose suffix does not say its format, and all of these do")
    unknown = [name for name, one in zip(outputs, found, strict=True) if one is None and name != STDOUT]
    if kind is None and unknown:
        raise click.UsageError(f"{unknown[0]}: the suffix names no format ({' '.join(suffixes)}); say which with --format")
    return [one or kind or "text" for one in found]
