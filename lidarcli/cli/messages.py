"""Messages, progress bars and summaries on stderr; stdout carries data only."""

from __future__ import annotations

import json
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import chain
from math import isnan
from typing import TYPE_CHECKING, Any, TextIO

import click

from lidarcli.display.credentials import blotted
from lidarcli.display.screen import Count, Screen, byte_bar, count_bar, one_line
from lidarcli.display.texts import Routine, alike, column_of_times, counted
from lidarcli.errors import OutputError
from lidarcli.options.choices import beams_on
from lidarcli.system import compiled
from lidarcli.system.records import dataclass, field

if TYPE_CHECKING:
    from lidarcli.pipeline.inputs.sources import MissingInput, Source
    from lidarcli.pipeline.reading.one_log import Progress, RunSummary
    from lidarcli.pipeline.runs.over_logs import Outcome


def _to_stderr(line: str) -> None:
    click.echo(line, err=True)


def standard_output() -> TextIO:
    """Return standard output (`OutputError` if it is closed)."""
    if sys.stdout is None:
        raise OutputError("cannot write standard output: it is closed")
    return sys.stdout


def are_shown_together() -> bool:
    """Return True if standard output and standard error go to the same place, such as a terminal."""
    try:
        out, err = (os.fstat(stream.fileno()) for stream in (sys.stdout, sys.stderr))
    except (AttributeError, OSError, ValueError):
        return False
    return (out.st_dev, out.st_ino) == (err.st_dev, err.st_ino)


def coloured(stream: TextIO) -> bool:
    """Return True to colour a stream: FORCE_COLOR says yes, NO_COLOR or TERM=dumb no, else only a terminal is coloured.

    Errors are plain everywhere: they are read by programs as well.
    """
    if os.environ.get("FORCE_COLOR"):
        return True
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return stream.isatty()


@dataclass(slots=True)
class MessageWriter(Screen):
    """Writes to stderr as loudly as the user wants it."""

    write: Callable[[str], None] = field(default=_to_stderr)
    quiet: bool = False
    verbose: bool = False
    errors: int = 0
    """Errors that were shown."""
    summary: dict[str, list[Any]] | None = None
    """Summary that `--format json` prints in the end; None where it is not requested."""

    def begin(self, options: Mapping[str, Any], *, finds: bool = False) -> None:
        """Collect the summary if the options of the command ask for JSON; get ready where it `finds` objects."""
        if finds:
            from lidarcli.system.machine import keep_freed_memory

            keep_freed_memory()
            self.of_missing_core()
        if options["format"] == "json":
            self.summary = {"logs": [], "notes": [], "routine": [], "written": []}

    def end(self, code: int, **more: Any) -> int:
        """Print the summary as JSON where it was requested; return the exit code."""
        if self.summary is not None:
            text = json.dumps({"exit_code": code, **self.summary, **more}, indent=2)
            click.echo(blotted(text), standard_output())
        return code

    def keep(self, key: str, value: object) -> None:
        """Add something to the summary that is printed as JSON."""
        if self.summary is not None:
            self.summary[key].append(value)

    def error(self, *parts: str) -> None:
        """`lidarcli: run.mcap: what is wrong`, always shown."""
        self.errors += 1
        self.write(one_line(": ".join(["lidarcli", *parts])))

    def failed(self, verdicts: Iterable[Any]) -> bool:
        """Name the checks whose verdicts are that they do not hold; return True if there are any."""
        failures = [verdict.failure for verdict in verdicts if not verdict.holds]
        for failure in failures:
            self.error(f"check failed: {failure}")
        return bool(failures)

    def info(self, line: str) -> None:
        """A line of a summary."""
        if not self.quiet:
            self.write(one_line(line))

    def notes(self, notes: Iterable[str]) -> None:
        """Words of a summary that a user should read: each of those that are alike, and the routine ones, by --verbose."""
        self._say("  note     ", [*notes])

    def note(self, note: str) -> None:
        """Words on the run, and not on one log, that a user should read."""
        self._say("note: ", [note])

    def _say(self, head: str, notes: Sequence[str]) -> None:
        for note in notes:
            self.keep("notes", note)
            if isinstance(note, Routine):
                self.keep("routine", note)
        lines = [(note, "") for note in notes if self.verbose or not isinstance(note, Routine)]
        for note, _ in lines if self.verbose else alike(lines):
            for line in lines_of_page(head, note):
                self.info(line)

    def wrote(self, files: Iterable[object]) -> None:
        """A line of a summary for the files that were written, a line for each with --verbose."""
        for name in (names := [*map(str, files)]):
            self.keep("written", name)
        for name in names if self.verbose else together(names):
            self.info(f"  wrote    {name}")

    def of_missing_core(self) -> None:
        """Why a detection takes so long, and how to mend it; not to those who chose it."""
        if compiled.is_wanted() and not compiled.is_there():
            self.info(f"lidarcli: {compiled.MISSING}")

    def detail(self, line: str) -> None:
        """Write a line for `--verbose`."""
        if self.verbose:
            self.write(one_line(line))

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Take the progress bar, if there is one, off the screen while stdout is written to."""
        if self.bar is None:
            yield
            return
        self.bar.stop()
        try:
            yield
        finally:
            self.bar.start()

    def bug(self, trace: str) -> None:
        """The traceback of a bug, and the request to report it."""
        self.write(trace.rstrip())
        self.write("lidarcli: this is a bug in lidarcli; please report it with the lines above")


OPTION = re.compile(r"(?<=\s|\()(--[a-z-]+) (?=[A-Z0-9/'.<]|inf)")
"""An option and its value, which stay on one line."""


def wrapped(head: str, words: str) -> list[str]:
    """Words after their head in the width of the terminal, 80 where there is none; no name and no option is broken.

    >>> wrapped("  note     ", "give the poses of the robot in the world, and how it is mounted (--pose TOPIC)")
    ['  note     give the poses of the robot in the world, and how it is mounted', '           (--pose TOPIC)']
    """
    from shutil import get_terminal_size

    wrapper = textwrap.TextWrapper(max(get_terminal_size().columns, 40), head, " " * len(head))
    wrapper.break_long_words = wrapper.break_on_hyphens = False
    return [line.replace("\u00a0", " ") for line in wrapper.wrap(OPTION.sub("\\1\u00a0", words))]


def lines_of_page(head: str, words: str) -> list[str]:
    """Words after their head, in the width of a terminal: what reads a pipe, such as grep, takes them for a line."""
    words = one_line(words)
    return wrapped(head, words) if "COLUMNS" in os.environ or _is_terminal() else [head + words]


def together(files: Sequence[str]) -> list[str]:
    """Names of files in as few lines as can be: those that differ in one part as one, which a shell takes apart.

    >>> together(["out/run.objects.parquet", "out/run.sweeps.parquet"]), together(["a.png"])
    (['out/run.{objects,sweeps}.parquet'], ['a.png'])
    """
    begin, end = (os.path.commonprefix(names) for names in (files, [file[::-1] for file in files]))  # noqa: RUF071 (of names)
    end = end[::-1]
    begin = begin[: max(begin.rfind("."), begin.rfind("/")) + 1]
    end = end[min((at for mark in "./" if (at := end.find(mark)) >= 0), default=len(end)) :]
    parts = [file[len(begin) : len(file) - len(end)] for file in files]
    if len(files) < 2 or not begin or not all(parts) or any(set(part) & set("{},/ ") for part in parts):
        folders = dict.fromkeys(file.rpartition("/")[0] for file in files)
        groups = [[file for file in files if file.rpartition("/")[0] == folder] for folder in folders]
        return [*chain(*map(together, groups))] if len(groups) > 1 else [*files]
    # A longer list takes more than a line.
    if len(files) > 8:
        return [f"{begin}*{end} ({len(files):,} files)"]
    return [f"{begin}{{{','.join(parts)}}}{end}"]


# Progress bars: only on a terminal.


@contextmanager
def progress_bar(
    sources: Sequence[Source | MissingInput], messages: MessageWriter
) -> Iterator[Callable[[Source, int], None] | None]:
    """A bar by bytes read: yields what the pipeline calls with a log and the position in it, None where nobody looks."""
    if not _shows_bars(messages):
        yield None
        return
    from lidarcli.pipeline.runs.over_logs import summed

    with byte_bar(messages) as show:
        yield summed(sources, show)


@contextmanager
def counted_bar(description: str, total: int | None, unit: str, messages: MessageWriter) -> Iterator[Count | None]:
    """A bar by things done, as of `count_bar`; yields None where nobody looks."""
    if not _shows_bars(messages):
        yield None
        return
    with count_bar(description, total, unit, messages) as show:
        yield show


def _shows_bars(messages: MessageWriter) -> bool:
    """Return True if stderr is a terminal that can take a line back."""
    return _is_terminal() and not messages.quiet and os.environ.get("TERM") != "dumb"


def _is_terminal() -> bool:
    return sys.stderr is not None and sys.stderr.isatty()


# Summaries.


def show(
    outcome: Outcome, messages: MessageWriter, lines_of: Callable[[Any], Sequence[str]] | None = None, alone: bool = False
) -> None:
    """Show the outcome of one log, and of one that is `alone` its agents: errors always, the rest unless quiet.

    `lines_of` returns the lines on its summary, by default what was found; those after the first are below the log.
    """
    before = messages.errors
    if outcome.trace:
        messages.bug(outcome.trace)
    for trouble in filter(None, (outcome.remark, outcome.error)):
        messages.error(outcome.label, trouble)
    if (run := outcome.summary) is not None:
        show_losses(outcome.label, run, messages)
        if not messages.quiet or (outcome.exit_code and messages.errors == before):
            first, *rest = _found_lines(run, messages) if lines_of is None else lines_of(run)
            if messages.quiet:
                messages.error(outcome.label, first)
            for line in (f"{outcome.label}: {first}", *rest, *(agents_of(run) if alone or messages.verbose else ())):
                messages.info(line)
        messages.notes(run.notes)
        messages.wrote(run.outputs)
    if messages.summary is not None:
        names = ("exit_code", "error", "skipped")
        row = {"log": outcome.label} | {name: getattr(outcome, name) for name in names}
        messages.summary["logs"].append(row if run is None else row | run.as_dict())


def show_reading(outcome: Outcome, messages: MessageWriter) -> None:
    """Show the outcome of one log that was only read."""
    show(outcome, messages, _reading_lines)


def _reading_lines(run: RunSummary) -> list[str]:
    return [f"{counted(run.sweeps, 'sweep')}{_damaged(run)}"]


def of_one_log(
    messages: MessageWriter,
    source: Source,
    work: Callable[[Source, Progress | None], RunSummary],
    lines_of: Callable[[Any], Sequence[str]] = _reading_lines,
) -> int:
    """Do the work of a command on one log, show what became of it, and return the exit code; `lines_of` as of `show`."""
    from lidarcli.pipeline.runs.over_logs import outcome_of, progress_of

    with progress_bar([source], messages) as report:
        outcome = outcome_of(source, lambda one: work(one, progress_of(one, report)))
    show(outcome, messages, lines_of)
    return messages.end(outcome.exit_code)


class Total:
    """Sums over the logs of a run; single outcomes are not kept."""

    def __init__(self) -> None:
        from lidarcli.pipeline.reading.one_log import RunSummary

        self._found = RunSummary()
        self._logs = 0
        self._failed = 0
        self._skipped = 0
        self._codes: dict[Source | MissingInput | None, int] = {}

    def add(self, outcome: Outcome) -> None:
        """Take what became of one log."""
        self._logs += 1
        self._skipped += outcome.skipped
        if outcome.exit_code:
            self._failed += 1
            self._codes[outcome.source] = outcome.exit_code
        if outcome.summary is not None:
            self._found.sweeps += outcome.summary.sweeps
            self._found.add_found(outcome.summary)

    def show(self, messages: MessageWriter) -> None:
        """One line over several logs."""
        if self._logs < 2:
            if self._skipped or not self._logs:
                messages.info("1 log, done before" if self._skipped else "0 logs")
            return
        failures = f", {self._failed} with errors" if self._failed else ""
        skipped = f", {self._skipped} done before" if self._skipped else ""
        messages.info(f"{self._logs} logs{failures}{skipped}: {_counts(self._found)}")

    def exit_code(self, sources: Sequence[Source | MissingInput]) -> int:
        """The first exit code that is not zero, in the order of the logs."""
        return next((code for source in sources if (code := self._codes.get(source, 0))), 0)


def _found_lines(run: RunSummary, messages: MessageWriter) -> list[str]:
    lines = [f"{_counts(run)}{_damaged(run)}"]
    if run.sweeps:
        lines += _parts(f"  beams    {run.beams:,}: ", run.by_status, run.beams, ("valid",))
        # There are agents only where objects are followed.
        words = beams_on(run.things is not None)
        on = {name: run.by_set[letter] for letter, name in words.items()}
        lines += _parts("  on       ", on, run.beams, (*on,))
    if messages.verbose:
        lines.append(f"  topics   {', '.join(sorted(run.topics)) or 'none'}")
        lines.append(f"  time     {run.seconds:.3f} s{_speed(run)}")
    return lines


def show_losses(label: str, run: RunSummary, messages: MessageWriter) -> None:
    """Show what of a log could not be read, and which topics were not there."""
    from lidarcli.logs.registry import no_scan_topic

    for line in run.damage:
        messages.error(label, line)
    for topic in run.missing_topics:
        messages.error(label, no_scan_topic([topic]))


MAX_AGENTS = 8
"""Most agents of which there is a line."""


def agents_of(run: RunSummary) -> list[str]:
    """Return a line for each agent of a log, farthest first: when it was observed [s from the start], how far, how fast."""
    several = len({topic for topic, *_ in run.followed}) > 1
    shown = sorted(run.followed, key=lambda one: -one[4])[:MAX_AGENTS]
    head, *clocks = column_of_times([each[2] for each in shown], run.time_zone)
    lines = [f"  agents track      from  {head}      to distance     mean      top  score" + "  topic" * several]
    for (topic, track, *ends, length, mean, top, score), clock in zip(shown, clocks, strict=True):
        begin, end = (f"{(stamp_ns - (run.first_ns or 0)) * 1e-9 + 0.0:8,.1f} s" for stamp_ns in ends)
        line = f"{track:14}{begin}  {clock}{end[2:]}{length:7,.1f} m{mean:5.1f} m/s{top:5.1f} m/s"
        lines.append(line + ("      -" if isnan(score) else f"{score:7.2f}") + f"  {topic}" * several)
    if (more := len(run.followed) - MAX_AGENTS) > 0:
        lines.append(f"           and {more:,} more")
    lines.append(f"  people   {run.people:,}: agents that went 2 m or more, each person once")
    return lines if run.followed else []


def _counts(run: RunSummary) -> str:
    """The numbers of sweeps, objects and, after tracking, tracks."""
    sweeps = counted(run.sweeps, "sweep")
    if run.things is None:
        return f"{sweeps}, {counted(run.objects, 'object')}"
    objects = f"{counted(run.objects + run.agents, 'object')} ({run.agents:,} of agents)"
    return f"{sweeps}, {objects}, {counted(run.things, 'track')} ({counted(run.moved, 'agent')})"


def _speed(run: RunSummary) -> str:
    # The time of a run of less than a second is mostly the start of the program.
    is_shown = run.seconds >= 1.0 and run.sweeps
    return f", {run.sweeps / run.seconds:,.0f} sweeps/s" if is_shown else ""


def _damaged(run: RunSummary) -> str:
    return ", source damaged" if run.damage else ""


def _parts(head: str, counts: Mapping[str, int], total: int, always: Sequence[str]) -> list[str]:
    """Return lines on how many beams are of each kind; kinds without beams are left out, except those in `always`."""
    parts = [
        f"{name.replace('_', ' ')} {f'{count:,} ({count / total:.1%})' if total else 0}"
        for name, count in counts.items()
        if count or name in always
    ]
    return wrapped(head[:11], head[11:] + ", ".join(part.replace(" ", "\u00a0") for part in parts))


def line_of(name: str, value: str, indent: int = 2, column: int = 14) -> str:
    """A line on one quantity, whose value begins at a column."""
    return f"{' ' * indent}{name:<{column - indent}}{value}"


def frame_words(frame_id: str) -> str:
    """The frame of a sensor in words."""
    return f"frame {frame_id}" if frame_id else "no frame"


# Logs of a run.


def chosen_logs(messages: MessageWriter, options: Mapping[str, Any]) -> list[Source | MissingInput]:
    """Return the logs that `ManyLogs` names, with notes on those in parts; see `search.choose`."""
    from lidarcli.pipeline.inputs.search import choose

    return choose(options["logs"], options["files_from"], options["base"], options["shard"], options["join"], messages.note)


def print_reads(sources: Iterable[Source | MissingInput], writes: Iterable[str] = ()) -> int:
    """Print what would be read and written, a line each; return the exit code."""
    from lidarcli.pipeline.runs.over_logs import exit_code

    code = exit_code([print_read(source) for source in sources])
    for output in writes:
        click.echo(f"write  {one_line(output)}")
    return code


def print_read(source: Source | MissingInput, verb: str = "read") -> int:
    """Print what would be done with one log; the exit code of that."""
    from lidarcli.pipeline.inputs.sources import MissingInput

    if isinstance(source, MissingInput):
        click.echo(f"fail   {one_line(f'{source.label}: {source.error}')}")
        return source.error.exit_code
    size = f" ({source.size:,} bytes)" if source.size else ""
    click.echo(f"{verb:6} {one_line(source.label)}{size}")
    return 0
