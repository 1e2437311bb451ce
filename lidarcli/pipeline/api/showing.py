"""`lidarcli.plot` and `lidarcli.report`: sweeps and runs as people look at them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any, Unpack

from lidarcli.errors import OptionError, warn
from lidarcli.files.newfiles import refuse, write_whole
from lidarcli.files.stores import place
from lidarcli.formalism.parameters import Parameters
from lidarcli.options.choices import MAP
from lidarcli.options.forms import options_of, refuse_combinations
from lidarcli.options.groups import PLOT_RULES, Plotting, Reporting, SweepGroup
from lidarcli.options.reading import Delay, Joining, PoseGroup, Ranges, WindowGroup
from lidarcli.options.values import AnyPath, Changed, Paths, TableOrPath, Tables
from lidarcli.pipeline.api.drawing import at_its_time, draw_log, look_of, refuse_suffix, refused
from lidarcli.pipeline.api.keywords import with_keywords
from lidarcli.pipeline.api.options import Values, listed, plot_options, refuse_reading, several, time_zone_of
from lidarcli.pipeline.inputs.search import files_of, find_logs, one_log
from lidarcli.pipeline.inputs.tables import TableSet, table_files, tables_of
from lidarcli.pipeline.plotting import Drawn, PlotOptions, pictures_of, write_pictures
from lidarcli.pipeline.reporting import ReportOptions, checks_of, encoded, format_of, make_report, render, understand
from lidarcli.reports.checks import CheckVerdict
from lidarcli.reports.map_picture import MapPicture
from lidarcli.reports.picture import Axes, Figure, figure_of, figure_of_map
from lidarcli.reports.programs import as_dict
from lidarcli.reports.report import Report
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.reading import TableInMemory

HEIGHT = 720
"""Height of the report in a notebook [px]."""


@with_keywords()
def plot(
    log: Paths | SweepBatch,
    sweep: int | None = None,
    output: AnyPath | None = None,
    parameters: Parameters | None = None,
    axes: Axes | Sequence[Axes] | None = None,
    overwrite: bool = True,
    **options: Unpack[Plotting],
) -> Figure:
    """Sweeps with their objects, a map of the run or an animation, as `lidarcli plot` draws them.

    Parameters
    ----------
    log : one log as of `read`, with `join` its parts, of which no more than the sweeps need is read; or a batch of `read`
    sweep : number of the sweep within its topic, as in tables and in `batch.sweep`; by default the first that there is
    output : picture to write: .png, .svg or .pdf, with `animate` .gif or .mp4; by default none. Several sweeps get a file
        each, FIG-N.png
    parameters : replaces the keywords from `profile` to `walls`
    axes : matplotlib axes to draw on, one for each panel of the view (`scene`: 1, `sweep`: 2, `all`: 3; with
        a background 2 more); by default a figure of its own
    overwrite : False to refuse a file that exists

    Returns
    -------
    matplotlib.figure.Figure
        The figure, of several sweeps that of the first; a notebook shows it. It belongs to no window: give `axes` of a
        figure that has one.

    Raises
    ------
    UnreadableError, NoScanError
        As of `read`.
    OptionError
        As of `read`, a sweep is not there, or there are not as many axes as panels.
    OutputError
        A picture cannot be written.
    """
    values = {**options, "log": () if isinstance(log, SweepBatch) else log, "sweep": sweep}
    known = options_of(SweepGroup) | options_of(Plotting)
    refuse_combinations(PLOT_RULES, known, values, lambda name: known[name].is_changed(values[name]))
    refuse_suffix(output, values)
    wanted, look = plot_options(values, parameters), look_of(values)
    if axes is not None and options["view"] == MAP:
        raise OptionError("--view map is a picture of its own, without axes of others")
    if output is None and (options["animate"] or len(wanted.sweeps or ()) > 1):
        raise OptionError("several sweeps are files: name them by output")
    if isinstance(log, SweepBatch):
        wanted = replace(_in_batch(log, values, wanted), tracks=_tracks(options["tracks"], log.log))
        paths = refused(output, None, values, wanted, overwrite)
        drawn: Drawn[Any] = Drawn(pictures_of(log, wanted), (), ())
    else:
        source = one_log(several(log), options["join"])
        wanted = replace(at_its_time(source, values, wanted), tracks=_tracks(options["tracks"], source.name))
        paths = refused(output, source, values, wanted, overwrite)
        drawn = draw_log(source, values, wanted)
        for line in drawn.damage:
            warn(f"{source.label}: {line}")
    for note in write_pictures(paths, drawn.pictures, options["view"], overwrite, look) if paths else ():
        warn(note)
    first = drawn.pictures[0]
    if isinstance(first, MapPicture):
        return figure_of_map(first, look)
    return figure_of(first, options["view"], [axes] if isinstance(axes, Axes) else axes, look)


class _OfLogs(Joining, PoseGroup, Delay, Ranges, WindowGroup):
    """Options for reading the log of which a sweep is drawn."""


def _in_batch(batch: SweepBatch, options: Values, wanted: PlotOptions) -> PlotOptions:
    """Return what is drawn of a batch: without a number its first sweep, of an animation all."""
    refuse_reading(options, _OfLogs, "topic", "at")
    if options["zones"] or options["view"] == MAP:
        raise TypeError("zones and maps are drawn of a log, not of a batch")
    if options["sweep"] is not None or options["sweeps"] is not None:
        return wanted
    return replace(wanted, sweeps=tuple(batch.sweep[: None if options["animate"] else 1].tolist()))


def _tracks(tables: Tables | None, log: str) -> str | TableSet | None:
    """Return the tables of the log that is drawn: of those of several logs its own."""
    if tables is None:
        return None
    given = tables_of(tables)
    found = [each for each in given if not isinstance(each, TableInMemory)]
    if len(found) < len(given):
        raise OptionError("--tracks: give what track returns, not a table of changes")
    own = [each for each in found if isinstance(each, TableSet) and each.log == log]
    if len(found) != 1 and len(own) != 1:
        raise OptionError(f"--tracks: give the tables of {log or 'one log'}, not those of {len(found)} logs")
    return found[0] if len(found) == 1 else own[0]


@dataclass(frozen=True, slots=True, repr=False)
class RunReport:
    """Report on one or many runs. `print` shows it as text, a notebook as the page with the viewer of the sweeps."""

    _made: Report
    _options: ReportOptions

    @property
    def figures(self) -> Mapping[str, float | None]:
        """Every figure by its name, as checks name it, or None; with a baseline also its change, `delta.NAME`."""
        return {**self._made.figures}

    @property
    def checks(self) -> tuple[CheckVerdict, ...]:
        """One verdict for each check: `expression`, `holds`, `expected`, `found`."""
        return self._made.verdicts

    @property
    def problems(self) -> tuple[str, ...]:
        """Files that could not be read, and damage that no check accepts, one line each."""
        return self._made.problems

    @property
    def holds(self) -> bool:
        """True if every check holds, and all of the data could be read."""
        return self._made.holds

    def as_dict(self) -> dict[str, Any]:
        """Everything as plain values: the JSON schema of docs/reports.md."""
        return as_dict(self._made)

    def __repr__(self) -> str:
        report, figures = self._made, self.figures
        holding = sum(verdict.holds for verdict in self.checks)
        verdict = f", {holding} of {len(self.checks)} checks hold" if self.checks else ""
        if "objects" not in figures:
            return f"<report on {report.lines[0]}{verdict}>"
        return f"<report on {report.title}: {figures['sweeps']:,.0f} sweeps, {figures['objects']:,.0f} objects{verdict}>"

    def __str__(self) -> str:
        return render(self._made, "text")

    def _repr_html_(self) -> str:
        # Who only looks at figures does not wait for what the viewer shows.
        made = self._made if self._made.page is not None else make_report(self._options, viewer=True)
        # The page is a document of its own, with a style and a script that are not to meet the notebook's.
        page = escape(render(made, "html"), quote=True)
        return (
            f'<iframe srcdoc="{page}" sandbox="allow-scripts allow-downloads" '
            f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
        )


@with_keywords()
def report(
    tables: Tables | Changed | Iterable[TableOrPath | Changed],
    output: Paths = (),
    overwrite: bool = True,
    **options: Unpack[Reporting],
) -> RunReport:
    """The figures of one or many runs, held against checks, from tables that are in memory or in files.

    Parameters
    ----------
    tables : what `detect`, `track`, `tables`, `zones` or `diff` returned, or such tables, as Arrow tables or data frames;
        paths of objects, sweeps or tracks tables (the others of a log are found beside each), of tables of changes, folders
        or patterns; or several of all
    output : files to write, each in the format that its suffix says: .txt, .md, .html, .json or .xml (JUnit); by default
        none
    overwrite : False to refuse files that exist

    Returns
    -------
    RunReport
        `figures`, `checks` and `holds`; a check that does not hold is no error.

    Raises
    ------
    UnreadableError
        None of the tables can be read, or the baseline cannot.
    TypeError
        Something is neither a path nor a table.
    OptionError
        A table in memory is none of lidarcli, or its others are missing; a check cannot be understood, or a suffix names
        no format.
    OutputError
        A file cannot be written.
    """
    parsed = ReportOptions(
        tables=tuple(tables_of(tables)),
        checks=checks_of({"check": listed(options["check"], lambda text: [text]), "checks": several(options["checks"])}),
        baseline=tuple(tables_of(options["baseline"])),
        logs=tuple(several(options["log"])),
        join=options["join"],
        time_zone=time_zone_of(options),
    )
    understand(parsed)
    files = {place(name): format_of(place(name)) for name in several(output)}
    read = map(str, table_files(each for each in (*parsed.tables, *parsed.baseline) if isinstance(each, str)))
    refuse(files, overwrite, [*read, *files_of(find_logs(parsed.logs))], devices=True)
    made = make_report(parsed, viewer="html" in files.values())
    for problem in made.problems:
        warn(problem)
    for file, form in files.items():
        for note in write_whole(file, encoded(render(made, form)), overwrite, devices=True):
            warn(note)
    return RunReport(made, parsed)
