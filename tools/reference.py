"""The generated pages of docs/: command-line options from click, tables from their Arrow schemas."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import click
import pyarrow as pa

from lidarcli import errors
from lidarcli.cli import settings
from lidarcli.cli.commands import cli
from lidarcli.reports import figures
from lidarcli.simulation.truth import TRUTH, TRUTH_BEAMS
from lidarcli.tabular import writing
from lidarcli.tabular.background import GEOMETRY
from lidarcli.tabular.schemas import BACKGROUND, CHANGES, CLEANED, CLOUD, POSES, SCHEMAS

NOTICE = "<!-- Written by `make docs` from {source}; a test fails when this page is stale. -->"

TABLES = {
    "objects": "One row per object per sweep, ordered by topic, sweep and object.",
    "sweeps": "One row per sweep, ordered by topic and sweep.",
    "tracks": "One row per track, ordered by topic and number ([track.md](track.md)).",
    "trajectories": "One row per track and sweep, from its first sight to its last; the rows of a track are in the order "
    "of time, those of several are mixed ([track.md](track.md#trajectories)).",
    "beams": "One row per beam of each sweep (`--beams`).",
    "events": "One row per event of a zone, by start (`zones`); [zones.md](zones.md) says what an event is.",
    "zones": "One row per sweep and zone, ordered by topic, sweep and zone (`zones`).",
    "counts": "One row per line, interval of time and direction (`zones --every 1min`), by line and time "
    "([counting.md](counting.md)).",
}
METADATA = {
    writing.VERSION: "version of lidarcli",
    writing.PARAMETERS: "everything the result depends on, as JSON",
    writing.SOURCE: "name, size and format of the source log, `recording` (by topic number and checksum of its sweeps, the "
    "same whatever is read of it), its parts where several are joined, what tells its poses (of further `runs`, too) and "
    "how well they fit, and where a pile of ranges is no return, as JSON",
    writing.DAMAGE: "what could not be read, a JSON list; only where the source was damaged",
}
OTHER_CODES = {
    0: "Done.",
    1: "A `--check` does not hold.",
    70: "A bug in lidarcli: a traceback, and a line that asks to report it.",
    130: "Interrupted.",
}


def cli_page() -> str:
    """docs/cli.md."""
    context = _root()
    lines = [
        "# Command line",
        "",
        NOTICE.format(source="the commands themselves"),
        "",
        _prose(cli.help or ""),
        "",
        "Standard output carries data only; messages go to standard error. `--help` leaves out the options that only some",
        "logs need; `lidarcli COMMAND --help-all` shows them. The site (`make site`) has a page for each command.",
        "",
        "```",
        "lidarcli [OPTIONS] COMMAND [ARGS]...",
        "```",
        "",
        *_options(cli, context),
        "## Exit codes",
        "",
        "Of several logs all are processed; the first code that is not 0 is the exit code.",
        "",
        *as_table(("code", "meaning"), ((str(code), text) for code, text in exit_codes().items())),
        "## Commands",
        "",
        *as_table(
            ("command", "what it does"),
            ((f"`lidarcli {name} --help-all`", command.get_short_help_str(limit=200)) for name, command in commands()),
        ),
    ]
    return as_page(lines)


def command_page(name: str, command: click.Command) -> str:
    """The page of a command in docs/commands/ of the site."""
    lines = _command(name, command, click.Context(command, _root(), name))
    lines[1:1] = ["", "[All commands, exit codes](../cli.md)"]
    return as_page(lines)


def _root() -> click.Context:
    """The context of the whole, with its settings: a command keeps the help option it was first asked for."""
    return click.Context(cli, info_name="lidarcli", **cli.context_settings)


def commands() -> Iterator[tuple[str, click.Command]]:
    """Every command with its name, such as `background build`."""
    for name, command, _ in settings.commands(_root()):
        yield name, command


def page_of(name: str) -> str:
    """Name of the page of a command."""
    return f"{name.replace(' ', '-')}.md"


def exit_codes() -> dict[int, str]:
    """Exit code → meaning, as errors.py states it."""
    codes = dict(OTHER_CODES)
    for error in errors.LidarcliError.__subclasses__():
        codes[error.exit_code] = " ".join((error.__doc__ or "").split())
    return dict(sorted(codes.items()))


DUCKDB = """
## Stamps in DuckDB

DuckDB 2 reads `stamp` as `TIMESTAMPTZ_NS`. Differences do not take it, nor, in 2.0.0, do `date_trunc`, `time_bucket`
and `extract`: write `stamp::timestamptz`, which every version takes. `epoch_ns(stamp)` is exact; DuckDB 1 reads whole
microseconds. Before 2.0.1 `fetchall` of a stamp wants the package pytz.

```sql
-- Objects within 2 m, minute by minute.
select date_trunc('minute', stamp::timestamptz) as minute, count(*) as objects
from 'room.objects.parquet' where r_min < 2 group by all order by all;

-- The same in steps of ten seconds, without a time zone.
select time_bucket(interval 10 seconds, make_timestamp(epoch_ns(stamp) // 1000)) as start, count(*) as objects
from 'room.objects.parquet' group by all order by all;

-- Seconds since the first sweep of the topic in the log are there already.
select sweep, t as seconds, objects from 'room.sweeps.parquet' order by sweep;

-- What lies after a time.
select count(*) as sweeps from 'room.sweeps.parquet' where stamp >= '2023-11-14 22:13:20.1+00';
```
"""


TABLES_HEAD = """Parquet files that pandas, DuckDB, polars and pyarrow read. The schema has the types, and the unit and
meaning of every column in the field metadata. Lengths are metres, angles radians, counter-clockwise; x is forward, y left.
Words are dictionaries of strings, stamps timestamps in nanoseconds, UTC (`--stamps us`: microseconds), counts int32 or
int64. Lengths, ranges, bearings and shares are single precision; times, velocities and places in the world are double.

Every table has all its columns: what was not computed is null. A column that can be null says so; all others are `not
null`. A folder of tables is no dataset: read `tables/*.objects.parquet`, or write a folder for each kind
(`--partition table`, [fleet.md](fleet.md)). The same input and parameters give the same bytes; the metadata hold
"""


def tables_page() -> str:
    """docs/tables.md."""
    lines = [
        "# Tables",
        "",
        NOTICE.format(source="the tables' schemas"),
        "",
        TABLES_HEAD,
        *as_table(("key", "value"), ((f"`{key}`", text) for key, text in METADATA.items())),
    ]
    for name, text in TABLES.items():
        lines += [f"## {name}", "", f"`<log>.{name}.parquet`. {text}", "", *_schema(SCHEMAS[name])]
    lines += [
        "## cleaned",
        "",
        "`NAME.cleaned.parquet` beside the log `NAME` that `clean` writes ([clean.md](clean.md)). One row per sweep, by",
        "topic and sweep: its beams that were left out, by the first reason that holds.",
        "",
        *_schema(CLEANED),
        "## background",
        "",
        "Written by `background`. One row per station and beam, by topic, frame and station; the metadata also",
        f"holds `{GEOMETRY}`, the bearings of every sensor and the reach of its stations as JSON.",
        "[background.md](background.md) says what the figures mean.",
        "",
        *_schema(BACKGROUND),
        "## changes",
        "",
        "Written by `diff -o FILE`. One row per object or piece of structure, objects first ([diff.md](diff.md)).",
        "",
        *_schema(CHANGES),
        "## cloud",
        "",
        "Written by `map -o FILE.parquet` ([map.md](map.md)). One row per point, in the order of the logs.",
        "",
        *_schema(CLOUD),
        "## poses",
        "",
        "Written by `poses -o FILE.parquet` ([poses.md](poses.md)). One row per sweep whose pose is known, in the order of "
        "the log; the columns `map_...` tell with `--map` whether the path fits the map.",
        "",
        *_schema(POSES),
        "## truth",
        "",
        "`simulate` writes the truth beside the log: `<log>.truth.parquet` has a row per sweep and visible entity,",
        "`<log>.truth-beams.parquet` one per beam. Their columns are on the site, and in their metadata.",
        "",
        DUCKDB.strip(),
        "",
    ]
    return as_page(lines)


def truth_page() -> str:
    """docs/truth.md of the site."""
    return as_page(["# Tables of the truth", "", *_schema(TRUTH), "", *_schema(TRUTH_BEAMS)])


def reports_page() -> str:
    """docs/reports.md, with its tables of figures as they are declared."""
    page = (Path(__file__).parent.parent / "docs" / "reports.md").read_text(encoding="utf-8")
    head = "| name | unit | meaning |\n|---|---|---|\n"
    before, *parts = page.split(head)
    for counts, spreads in (
        (figures.COUNTS, figures.SPREADS),
        (figures.TRACK_COUNTS, figures.TRACK_SPREADS),
        tuple(
            {f"{figures.ZONES}NAME.{name}": one for name, one in some.items()}
            for some in (figures.ZONE_COUNTS, figures.ZONE_SPREADS)
        ),
        (figures.OF_CHANGES, {}),
        (figures.OF_MAPS, {}),
        (figures.COMPARED, {}),
    ):
        rest = parts.pop(0).partition("\n\n")[2]
        entries = counts | {f"{name}.*": figure for name, figure in spreads.items()}
        rows = ((f"`{name}`", "" if one.unit == "1" else one.unit, one.meaning) for name, one in entries.items())
        before += "\n".join(as_table(("name", "unit", "meaning"), rows)) + "\n" + rest
    return head.join([before, *parts])


def option_names() -> Iterator[tuple[str, str]]:
    """Every (command, `--option`) of the command line, the whole's own under the name `lidarcli`."""
    for name, command in (("lidarcli", cli), *commands()):
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                yield name, max(parameter.opts, key=len)


def _command(name: str, command: click.Command, context: click.Context) -> list[str]:
    arguments = " ".join(
        parameter.metavar or parameter.name or "" for parameter in command.params if isinstance(parameter, click.Argument)
    )
    lines = [f"# lidarcli {name}", "", _prose(command.help or ""), ""]
    lines += ["```", f"lidarcli {name} [OPTIONS] {arguments}", "```", ""]
    lines += _options(command, context)
    if command.epilog:
        lines += ["Examples:", "", "```sh", _examples(command.epilog), "```", ""]
    return lines


def _options(command: click.Command, context: click.Context) -> list[str]:
    headings: dict[str, list[click.Option]] = {}
    for parameter in command.get_params(context):
        if isinstance(parameter, click.Option) and parameter.name != "help":
            headings.setdefault(getattr(parameter, "heading", "Other options"), []).append(parameter)
    lines = []
    for heading, options in headings.items():
        lines += [f"**{heading}**", ""] if len(headings) > 1 else []
        lines += as_table(("option", "meaning"), ((_names(option), _meaning(option)) for option in options))
    return lines


def _names(option: click.Option) -> str:
    names = ", ".join(f"`{name}`" for name in (*option.opts, *option.secondary_opts))
    value = _metavar(option)
    return f"{names} `{value}`" if value else names


def _metavar(option: click.Option) -> str:
    """What stands for the option's value; click spells it differently from release to release."""
    if option.is_flag or option.count:
        return ""
    if option.metavar:
        return option.metavar
    if isinstance(option.type, click.Choice):
        return "|".join(map(str, option.type.choices))
    return getattr(option.type, "metavar", None) or option.type.name.upper()


def _meaning(option: click.Option) -> str:
    return " ".join((option.help or "").split()).replace("<", "&lt;")


def _schema(schema: pa.Schema) -> list[str]:
    """The table of the columns; those that tell the sweep stand at the objects alone."""
    known = [] if schema is SCHEMAS["objects"] else [field for field in schema if field in _sources()]
    words = f"{', '.join(f'`{field.name}`' for field in known)}: as of [objects](tables.md#objects). " if known else ""
    alike = groupby((_column(field) for field in schema if field not in known), lambda row: row[1:])
    rows = ((", ".join(name for name, *_ in some), *rest) for rest, some in alike)
    lines = as_table(("column", "unit", "meaning"), rows)
    return [*([words.strip(), ""] if words else []), *(line.replace("|  |", "| |") for line in lines)]


def _sources() -> list[pa.Field]:
    """The columns of the objects that tell the sweep."""
    return list(SCHEMAS["objects"])[:6]


def _column(field: pa.Field) -> tuple[str, str, str]:
    notes = {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
    meaning = notes["description"]
    if pa.types.is_list(field.type) and pa.types.is_struct(field.type.value_type):
        parts = ", ".join(f"`{part.name}`" for part in field.type.value_type)
        meaning = f"{meaning}, each {parts}"
    unit = notes.get("unit", "")
    return f"`{field.name}`", "" if unit == "1" else unit, meaning


def as_table(head: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> list[str]:
    """Lines of a Markdown table."""

    def line(cells: tuple[str, ...]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return [line(head), "|" + "---|" * len(head), *map(line, rows), ""]


def _examples(epilog: str) -> str:
    """The commands of an epilog, without its headline and click's marks."""
    body = epilog.split("\b\n", 1)[-1] if "\b" in epilog else epilog
    return textwrap.dedent(body).strip()


def _prose(text: str) -> str:
    return inspect.cleandoc(text).replace("\b\n", "").replace("<", "&lt;")


def as_page(lines: list[str]) -> str:
    """The text of a page."""
    return "\n".join(lines).strip() + "\n"
