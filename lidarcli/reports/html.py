"""A report as one HTML file: offline, without a request to anywhere, with a viewer of the sweeps."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from typing import Any

from lidarcli._version import __version__
from lidarcli.reports.charts import charts, constants, overview_chart
from lidarcli.reports.junit import clean
from lidarcli.reports.map_picture import MapPicture
from lidarcli.reports.page_colours import style as colours
from lidarcli.reports.report import Judged, Report
from lidarcli.reports.standing import KINDS
from lidarcli.reports.walls import Walls
from lidarcli.reports.wording import (
    SHOWN_STATISTICS,
    compared_rows,
    number,
    origin,
    quantity,
    rate,
    settings,
    spreads,
    stamp,
    track_cells,
    track_spreads,
    tracked_words,
)

SHOWN = 100
"""Rows of the tables of logs and topics."""
RIGHT = frozenset(
    {"track", "first seen", "duration", "sweeps", "hidden", "size", "distance", "mean speed", "top speed"}
)
"""Columns of the table of tracks that are flush right."""
SCRIPTS = ("data", "pen", "scene", "curves", "timeline", "looking", "saving", "main")
"""The parts of the viewer, in the order in which they need each other."""


@dataclass(frozen=True, slots=True)
class Page:
    """What only the HTML shows of a run."""

    viewer: dict[str, Any]
    """As `reports.viewer.pack` makes it, with a note on what is left out."""
    overview: MapPicture | None = None
    """The run from above, where there are poses."""
    walls: Mapping[str, Walls] = field(default_factory=dict)
    """By frame."""
    command: str = ""
    """What makes the page again."""


def render(report: Report, shown: Page) -> str:
    """The page. Every text of a log is escaped by the template engine."""
    from markupsafe import Markup

    script = _script()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    summary, viewer = report.summary, shown.viewer
    return page(
        "report.html",
        report=report,
        summary=summary,
        script=Markup(script),
        script_hash=digest,
        data=Markup(embedded(viewer)),
        viewer=viewer,
        has_raw=any("raw" in stream for stream in viewer["streams"]),
        viewer_style=Markup(_part("viewer.css")),
        overview=None
        if shown.overview is None
        else Markup(overview_chart(replace(shown.overview, walls=shown.walls.get("world"))).svg),
        has_walls="world" in shown.walls,
        charts=[replace(chart, svg=Markup(chart.svg)) for chart in charts(report, shown.walls)],
        constants=constants(report),
        command=shown.command,
        versions=sorted({one.version for one in summary.sources if one.version}),
        cards=[*_cards(report), *check_cards(report), *_damage_cards(report)],
        spreads=spreads(summary) + (track_spreads(summary.tracked) if summary.tracked else []),
        statistics=SHOWN_STATISTICS,
        tracks=[(one, track_cells(one)) for one in summary.tracked.tracks] if summary.tracked else [],
        alarming=(),
        kinds=KINDS,
        compared=[*_compared(report)],
        right=RIGHT,
        shown=SHOWN,
        quantity=quantity,
        origin=origin,
        settings=settings,
    )


def page(template: str, **values: Any) -> str:
    """A page from one of the templates, with the style and the functions that all of them use."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("lidarcli.reports"),
        autoescape=True,
        finalize=lambda value: clean(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style = Markup(colours() + "\n" + _part("report.css"))
    return environment.get_template(template).render(
        **values, version=__version__, style=style, number=number, stamp=stamp
    )


def embedded(value: Any) -> str:
    """JSON that cannot end the script element it stands in.

    >>> embedded("</script>&")
    '"\\\\u003c/script\\\\u003e\\\\u0026"'
    """
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _script() -> str:
    """The viewer: its parts in one function, so that nothing of it is in the way of others."""
    parts = "\n".join(_part(f"viewer/{name}.js") for name in SCRIPTS)
    return f'"use strict";\n(() => {{\n{parts}}})();\n'


def _part(name: str) -> str:
    return files("lidarcli.reports").joinpath("templates", name).read_text(encoding="utf-8")


def _cards(report: Report) -> Iterator[tuple[str, str, str]]:
    """What matters most: name, value, and a line of detail."""
    figures, spreads = report.summary.figures, report.summary.spreads
    logs, topics = number(figures["logs"]), number(figures["topics"])
    plural = "s" if figures["topics"] != 1 else ""
    yield (
        "sweeps",
        number(figures["sweeps"]),
        f"{logs} log{'s' if figures['logs'] != 1 else ''}, {topics} topic{plural}",
    )
    yield "duration", quantity("duration", figures["duration"]), rate(report.summary)
    per = spreads["objects_per_sweep"]
    yield "objects", number(figures["objects"]), f"{number(per.mean, 3)} per sweep, most {number(per.max)}"
    lost = figures["valid_share"]
    yield (
        "beams with a range",
        quantity("valid_share", lost),
        f"of {number(figures['beams'])}; {quantity('no_return_share', figures['no_return_share'])} no return",
    )
    tracked = report.summary.tracked
    if tracked is not None:
        lines = tracked_words(tracked)
        yield (
            "tracks",
            number(figures["tracks"]),
            f"{number(figures['tracks.agents'])} agents; at once {lines['agents at once']}",
        )
        if tracked.scene is not None:
            yield "scene", tracked.scene, lines["scene"].removeprefix(f"{tracked.scene}: ")
    gaps = f"{number(figures['missing_sweeps'])} sweeps missing, longest {quantity('longest_gap', figures['longest_gap'])}"
    yield "gaps", number(figures["gaps"]), gaps
    faults = (figures["backward"] or 0) + (figures["repeated"] or 0)
    yield (
        "clock faults",
        number(faults),
        f"{number(figures['backward'])} backward, {number(figures['repeated'])} repeated",
    )


def check_cards(report: Judged) -> Iterator[tuple[str, str, str]]:
    """How many checks hold, where there are any."""
    if report.verdicts:
        held = sum(verdict.holds for verdict in report.verdicts)
        failed = len(report.verdicts) - held
        seen = ", on part of the data" if report.problems else ""
        words = f"{f'{failed} failed' if failed else 'all hold'}{seen}"
        yield "checks", f"{held} of {len(report.verdicts)}", words


def _damage_cards(report: Report) -> Iterator[tuple[str, str, str]]:
    damage = report.summary.figures["damage"]
    if damage:
        yield "damage", number(damage), f"part{'s' if damage != 1 else ''} of the logs not read"


def _compared(report: Report) -> Iterator[tuple[str, str, str, str]]:
    if report.comparison is None:
        return
    here, there, delta = report.summary.figures, report.comparison.baseline.figures, report.comparison.figures
    yield from compared_rows(here, there, delta)
