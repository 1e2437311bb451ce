"""`lidarcli report`: figures of one or many runs for people, programs and CI."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import click

from lidarcli.cli.commands import command
from lidarcli.cli.messages import Messages, are_shown_together, coloured, counted_bar, standard_output
from lidarcli.option_forms import Argument, File, Option
from lidarcli.options import OUTPUT, STDOUT, Overwrite, Reporting, output
from lidarcli.stores import place


class ReportCommand(Overwrite, Reporting, total=False):
    """Options of `report`."""

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


@command(
    ReportCommand,
    examples="""\
  lidarcli report tables/
  lidarcli report run.objects.parquet -o run.html --log run.mcap
  lidarcli report tables/ -o out.md -o out.xml --check "sweeps >= 100"
  lidarcli report tables/ --check "objects_per_sweep.p95 <= 12" --brief
  lidarcli report tables/ --check "objects where width > 1.5 == 0"
  lidarcli report tables/ --check "agents_at_once.max <= 3"
  lidarcli report new/ --baseline old/ --check "changed_sweeps == 0"
  lidarcli report site.changes.parquet -o site.html --check "gone == 0"
  lidarcli report 'tables/*.parquet' --format json | jq .figures
  lidarcli report tables/ --check "sweeps >= 100" --format github
  lidarcli report tables/ --format junit -o report.xml --overwrite""",
)
def report(messages: Messages, options: Mapping[str, Any]) -> int:
    """Summarise one or many runs, and test them against thresholds.

    TABLE is an objects, sweeps or tracks table of detect or track (the others are
    found beside it), a table of changes of diff, a folder to search, or a pattern.
    """
    tables, checks, baseline, logs = options["tables"], options["check"], options["baseline"], options["log"]
    outputs, brief = options["output"], options["brief"]

    from lidarcli.newfiles import refuse, write_whole
    from lidarcli.pipeline.inputs.search import files_of, find_logs
    from lidarcli.pipeline.inputs.tables import table_files
    from lidarcli.pipeline.reporting import SHORT_FORMATS, SUFFIXES, ReportOptions, encoded, make_report, render, understand

    kinds = _kinds(outputs or (STDOUT,), options["format"], SUFFIXES)
    if brief and not {*kinds} & {*SHORT_FORMATS}:
        raise click.UsageError(f"--brief is for {', '.join(SHORT_FORMATS)}; leave it out for {kinds[0]}")
    report_options = ReportOptions(tables, checks, baseline, logs, options["join"])
    understand(report_options)
    files = [place(name) for name in outputs if name != STDOUT]
    if files:
        read = table_files([*tables, *baseline])
        refuse(files, options["overwrite"], [*map(str, read), *files_of(find_logs(logs))], devices=True)
    with counted_bar("report", None, "steps", messages) as progress:
        made = make_report(report_options, viewer="html" in kinds, progress=progress)
    written = [*zip(outputs or (STDOUT,), kinds, strict=True)]
    is_shown = any(name == STDOUT and form in SHORT_FORMATS for name, form in written)
    # Workflow commands are for the log of a step, which shows both.
    if not (is_shown and ((STDOUT, "github") in written or are_shown_together())):
        for kind_of, problem in made.named_problems:
            messages.error(*((kind_of, problem) if kind_of == "incomplete" else (problem,)))
    if not is_shown:
        for warning in made.warnings:
            messages.info(f"warning: {warning}")
    for name, form in written:
        short = brief and form in SHORT_FORMATS
        if name == STDOUT:
            words = render(made, form, colour=coloured(standard_output()), brief=short)
            standard_output().buffer.write(encoded(words))
        else:
            data = encoded(render(made, form, brief=short))
            notes = write_whole(place(name), data, options["overwrite"], devices=True)
            messages.wrote([name])
            messages.notes(notes)
    for verdict in made.verdicts:
        if not verdict.holds:
            messages.error(f"check failed: {verdict.failure}")
    return made.exit_code


def _kinds(outputs: Sequence[str], kind: str | None, suffixes: dict[str, str]) -> list[str]:
    """The format of each output: of one that of --format, of several that of --format where the suffix names none."""
    if len(outputs) == 1 and kind is not None:
        return [kind]
    found = [None if name == STDOUT else suffixes.get(place(name).suffix.lower()) for name in outputs]
    if kind is not None and None not in found:
        raise click.UsageError("--format is for an output whose suffix does not say its format, and all of these do")
    odd = [name for name, one in zip(outputs, found, strict=True) if one is None and name != STDOUT]
    if kind is None and odd:
        raise click.UsageError(f"{odd[0]}: the suffix names no format ({' '.join(suffixes)}); say which with --format")
    return [one or kind or "text" for one in found]
