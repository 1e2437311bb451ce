"""A report as one HTML file: offline, without a request to anywhere, with a viewer of the sweeps."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, timedelta
from functools import partial
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lidarcli._version import __version__
from lidarcli.display.palette import COLOURS, page_style, themed
from lidarcli.display.texts import stamp
from lidarcli.formalism.detection import SETS, SHAPES
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, Occupancy
from lidarcli.options.times import is_date, local
from lidarcli.reports.columns import Rows, Run, rows_of
from lidarcli.reports.document import NAMES, PAGE, Code, FromAbove, TimePlot
from lidarcli.reports.drawing import project_style
from lidarcli.reports.explanation import Explanation, courses_figure
from lidarcli.reports.figures import Density, Histogram, Spread, plain
from lidarcli.reports.map_picture import Backdrop, changes_figure, map_figure
from lidarcli.reports.programs import clean
from lidarcli.reports.report import Page, Report
from lidarcli.reports.run import RunPart, track_cells
from lidarcli.reports.streams import Stream
from lidarcli.reports.summary import KINDS, Summary
from lidarcli.reports.wording import number, quantity, share
from lidarcli.reports.world import PosedStream, Raw, Walls, posed_stream
from lidarcli.reports.zones import ZonesPart
from lidarcli.sweeps.types import Float64, Int64, UInt8

SCRIPTS = ("data", "pen", "scene", "curves", "charts", "timeline", "looking", "saving", "main")
"""Parts of the viewer, each after those that it needs."""


BUDGET = 14_000_000
"""Most bytes of the viewer's arrays, which lose about half in packing: with the charts the file stays below 10 MB."""
LOST = 65_535
"""Code of a beam without a range."""
SURE = 254
"""Byte of an object that is certainly no wall; 255 is unknown."""
SPEED = 0.005
"""Unit of velocities as whole numbers [m/s]."""
ANGLE = 32_767 / (3 * np.pi)
"""Whole numbers by radian of angles; theta_f may pass π."""
SVG_STYLE: dict[str, Any] = {"svg.fonttype": "none", "svg.image_inline": True, "axes.grid": False}
"""Style of drawings in the page, whose texts stay texts."""
GREYS = (0.15, 1.0, int(COLOURS["pressed"][0][1:3], 16) / 255)
"""Greys of occupied, free and unknown cells of a map; the last one is a colour of the page, and turns dark with it."""
SERIES = ("blue", "vermilion", "green", "purple", "orange", "ink")
DASHES = ((), (6, 3), (6, 3, 1, 3), (1, 2), (5, 2), (2, 2))
HEAT = 5
"""Steps from pale to dark of a map."""
OVER_TIME = {
    "objects_per_sweep": ("Objects over time", "objects per sweep"),
    "agents_at_once": ("Agents over time", "agents in view"),
    "d_th": ("Threshold over time", "[m]"),
    "noise": ("Noise over time", "[m]"),
}
"""Figure of a series → title and axis."""
TITLES = {
    "objects_per_sweep": ("Objects per sweep", "objects"),
    "range": ("Range of objects", "nearest point [m]"),
    "bearing": ("Bearing of objects", "bearing [deg]"),
    "width": ("Width of objects", "chord [m]"),
}
"""Figure of a histogram → title and axis."""
WIDEST = 1.5
"""Longest side of a map by its shortest."""


def render(report: Report) -> str:
    """Return the page; one that begins with a run needs what is shown of its sweeps."""
    run = report.parts[0]
    if isinstance(run, RunPart):
        assert report.page is not None
        return _page("report.html", report, **_shown(run, report.page))
    if isinstance(run, Explanation):
        script, digest = _script("film.js")
        return _page("film.html", report, script=script, script_hash=digest)
    return _page("parts.html", report)


def _script(*parts: str) -> tuple[Markup, str]:
    """Return a script of some parts, and its hash for the policy of the page."""
    own = "\n".join(map(_part, parts))
    script = f'"use strict";\n(async () => {{\n{own}}})();\n'
    return Markup(script), base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _shown(run: RunPart, shown: Page) -> dict[str, Any]:
    """Return the values of the template that the document does not hold."""
    # In one function, so that its names meet no others.
    script, digest = _script(*(f"viewer/{name}.js" for name in SCRIPTS))
    summary, viewer = run.summary, shown.viewer
    tracks = summary.tracked.tracks if summary.tracked else ()
    overview = None
    if shown.overview is not None:
        with project_style(SVG_STYLE):
            figure = map_figure(replace(shown.overview, grid=shown.grid), 7.0, greys=GREYS)
            overview = _inline("The run from above", figure)
    drawn = [*charts(run, shown.walls)]
    viewer = viewer | {"charts": [chart.values for chart in drawn]}
    return {
        "summary": summary,
        "script": script,
        "script_hash": digest,
        "data": Markup(embedded(viewer)),
        "viewer": viewer,
        "has_raw": any("raw" in stream for stream in viewer["streams"]),
        "has_zones": summary.zones is not None,
        "viewer_style": Markup(_part("viewer.css")),
        "overview": overview,
        "has_map": shown.grid is not None,
        "charts": drawn,
        "command": shown.command,
        "tracks": tracks,
        # Columns without a single entry are left out.
        "track_cells": {name: cells for name, cells in track_cells(tracks, summary.time_zone).items() if any(cells)},
        "kinds": KINDS,
        "names": NAMES,
    }


def _page(template: str, report: Report, **values: Any) -> str:
    """Return a page from one of the templates. Every text of a log is escaped by the template engine."""
    environment = Environment(
        loader=PackageLoader("lidarcli.reports"),
        autoescape=True,
        finalize=lambda value: clean(value) if type(value) in (str, Code) else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests["code"] = lambda value: isinstance(value, Code)
    zone = report.parts[0].summary.time_zone if isinstance(report.parts[0], RunPart) else UTC
    shown = {"number": number, "share": share, "stamp": partial(stamp, zone=zone), "drawn": _drawn, "embedded": embedded}
    environment.globals.update(**shown)
    sections = {name: one for name, one in report.sections().items() if PAGE in one.formats}
    return environment.get_template(template).render(
        **values,
        report=report,
        sections=sections,
        versions=sorted({one.version for one in report.parts[0].sources if one.version}),
        version=__version__,
        style=Markup(page_style() + "\n" + _part("report.css")),
    )


def _drawn(block: FromAbove | TimePlot) -> Markup:
    """Return quantities over time, or the changes of a run from above, without the map, which tables do not hold."""
    with project_style(SVG_STYLE):
        if isinstance(block, TimePlot):
            return _inline("Distance and speed", courses_figure(block))
        return _inline(f"Changes of run {block.number}", changes_figure([block.changes], [Backdrop()]))


def _inline(title: str, figure: Figure) -> Markup:
    """Return a figure as a part of a page: ids of its own, a width that follows the page, and its colours."""
    out = io.StringIO()
    figure.set_layout_engine(None)
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    body = out.getvalue()
    prefix = "c" + re.sub(r"\W", "", title)
    body = re.sub(r"<metadata>.*?</metadata>", "", body[body.index("<svg") :], count=1, flags=re.DOTALL)
    body = re.sub(r'\bid="', f'id="{prefix}-', body)
    body = re.sub(r'(xlink:href="|url\()#', rf"\1#{prefix}-", body)
    for side in ("width", "height"):
        body = re.sub(rf'(<svg[^>]*?) {side}="[^"]*"', r"\1", body, count=1)
    # A hundredth of a point is finer than any screen.
    body = re.sub(r'\bd="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), body)
    return Markup(themed(body).replace("<svg", f'<svg role="img" aria-label="{title}"', 1))


def embedded(value: Any) -> str:
    """Return JSON that cannot end the script element around it.

    >>> embedded("</script>&")
    '"\\\\u003c/script\\\\u003e\\\\u0026"'
    """
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _part(name: str) -> str:
    return files("lidarcli.reports").joinpath("templates", name).read_text(encoding="utf-8")


@dataclass(frozen=True, slots=True)
class Choice:
    """The sweeps of each stream that are shown: rows of the sweeps table."""

    rows: tuple[NDArray[np.intp], ...]
    total: int
    streams: int

    @property
    def note(self) -> str:
        """Data that is left out, in words; empty where it is all there."""
        shown = sum(map(len, self.rows))
        parts = []
        if self.streams > len(self.rows):
            parts.append(f"the first {len(self.rows):,} of {self.streams:,} topics")
        if shown < self.total:
            parts.append(f"{shown:,} of {self.total:,} sweeps, evenly spaced, and all that stand out")
        return f"To keep this file small the viewer holds {' and '.join(parts)}." if parts else ""


def choose_sweeps(run: Run, summary: Summary) -> Choice:
    """Choose as many sweeps as the budget allows, evenly spaced, and the outliers."""
    streams = summary.streams
    count = min(len(streams.all), 40)
    own = streams.stream < count
    tracked = run.tracks is not None
    posed = run.sweeps.has_any("pose_x")
    # Bytes of a sweep, of an object and of a row of the trajectories.
    cost = 20 + 12 * posed + 2 * run.sweeps.numbers("beams")
    per_object = 19 + 8 * tracked
    cost += per_object * run.objects_per_sweep
    total = float(cost[own].sum())
    total += 0 if run.trajectories is None else 17 * len(run.trajectories)
    keep = min(1.0, BUDGET / total) if total else 1.0
    outliers = {(one.stream, one.sweep) for one in summary.outliers}
    index = run.sweeps.integers("sweep")
    chosen = []
    for k in range(count):
        rows = np.flatnonzero(streams.stream == k)
        rows = rows[np.argsort(index[rows], kind="stable")]
        places = np.unique(np.linspace(0, len(rows) - 1, max(1, int(keep * len(rows)))).astype(np.int64))
        wanted = [sweep for stream, sweep in outliers if stream == k]
        kept = np.isin(np.arange(len(rows)), places) | np.isin(index[rows], wanted)
        chosen.append(rows[kept])
    return Choice(tuple(chosen), len(run.sweeps), len(streams.all))


def pack(run: Run, summary: Summary, choice: Choice, raw: Mapping[tuple[int, str], Raw]) -> dict[str, Any]:
    """Return all data of the viewer as values for JSON; `raw` by source and topic."""
    streams = [
        _stream(run, one, rows, raw.get((one.source, one.topic)))
        | ({} if summary.zones is None else _zones(summary.zones, one))
        for one, rows in zip(summary.streams.all, choice.rows, strict=False)
    ]
    return {
        "streams": streams,
        "shapes": list(SHAPES),
        "angle": ANGLE,
        "standing": [
            {"stream": one.stream, "sweep": one.sweep, "kind": KINDS[one.kind], "value": one.words}
            for one in summary.outliers
            if one.stream < len(choice.rows)
        ],
    }


def pack_map(grid: Occupancy) -> dict[str, Any]:
    """Return a map as values for JSON: of free and of occupied cells the runs along x."""
    found: dict[str, Any] = {"cell": grid.resolution, "origin": [grid.x, grid.y]}
    for name, value in (("free", FREE), ("occupied", OCCUPIED)):
        # A cell of another kind on either side ends each run.
        edges = np.diff(np.pad(grid.cells == value, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        (row, begin), (_, end) = np.nonzero(edges > 0), np.nonzero(edges < 0)
        runs = {"row": row, "column": begin, "length": end - begin}
        found[name] = {key: _packed(values, np.uint16) for key, values in runs.items()}
    return found


def _stream(run: Run, stream: Stream, rows: NDArray[np.intp], raw: Raw | None) -> dict[str, Any]:
    sweeps = run.sweeps.integers("sweep")[rows]
    stamp = run.sweeps.integers("stamp")[rows]
    # Of many logs each column would be read once for every stream.
    objects = run.objects.of_source(stream.source)
    members, of_sweep = rows_of(objects, stream.topic, sweeps, stream.source)
    offsets = np.searchsorted(of_sweep, np.arange(len(rows) + 1))
    in_metres, angles = ("box_x", "box_y", "box_length", "box_width", "r_min"), ("box_yaw", "theta_i", "theta_f")
    columns = {name: objects.numbers(name)[members] for name in ("object", *in_metres, *angles)}
    lengths = [columns[name] for name in in_metres]
    reach = max((float(np.nanmax(np.abs(values), initial=0)) for values in lengths), default=0.0)
    scale = max(reach, 1.0) / 32_000
    packed: dict[str, Any] = {
        "log": stream.log,
        "topic": stream.topic,
        "frame": stream.frame_id,
        "count": len(rows),
        "sweep": _packed(sweeps, np.int32),
        "seconds": _packed((stamp - stream.start_ns) * 1e-9, np.float32),
        "d_th": _packed(run.sweeps.numbers("d_th")[rows], np.float32),
        # Of all objects, and of those that are agents.
        "objects": _packed(np.minimum(run.objects_per_sweep[rows], LOST), np.uint16),
        "agents": _packed(np.minimum(run.sweeps.numbers("agents")[rows], LOST), np.uint16),
        "offsets": _packed(offsets, np.int32),
        "scale": scale,
        "object": _packed(np.minimum(columns["object"], LOST), np.uint16),
        "shape": _packed(_codes(objects, "shape", SHAPES)[members], np.uint8),
        "set": _packed(_codes(objects, "set", SETS)[members], np.uint8),
        **{name: _packed(np.nan_to_num(np.round(columns[name] / scale)), np.int16) for name in in_metres},
        **{name: _signed(columns[name] * ANGLE) for name in angles},
    }
    if is_date(stream.start_ns):
        # The first stamp [s since 1970], and at each sweep the time of the zone minus UTC [s].
        shift = [(local(one, run.time_zone).utcoffset() or timedelta()).total_seconds() for one in stamp.tolist()]
        packed |= {"begin": stream.start_ns * 1e-9, "shift": _packed(np.array(shift), np.int32)}
    if objects.has_any("label"):
        codes, packed["labels"] = objects.words("label")
        packed["label"] = _packed(np.where(codes < 0, LOST, codes)[members], np.uint16)
    if objects.has_any("thing"):
        thing = objects.numbers("thing")[members]
        share = np.clip(np.round(np.nan_to_num(thing) * SURE), 0, SURE)
        packed["thing"] = _packed(np.where(np.isnan(thing), 255, share), np.uint8)
    in_world = posed_stream(run.sweeps, rows, objects, members, of_sweep)
    if in_world.posed:
        packed["pose"] = {
            "side": in_world.side,
            "origin": list(in_world.origin),
            "x": _packed(in_world.pose_x, np.float32),
            "y": _packed(in_world.pose_y, np.float32),
            "yaw": _packed(in_world.pose_yaw, np.float32),
        }
    if run.sources[stream.source].tracked:
        packed["tracks"] = _tracks(objects, members)
        if run.trajectories is not None:
            packed["paths"] = _paths(run.trajectories.of_source(stream.source), stream, sweeps, in_world)
    if raw is not None and len(raw.sweep):
        packed["raw"] = _raw(raw, sweeps)
    return packed


def _zones(zones: ZonesPart, stream: Stream) -> dict[str, Any]:
    """Return the zones of a stream: outline, and the times of events and of visits since its start [s]."""
    if stream.source not in zones.timelines:
        return {}
    begin = (zones.starts_ns[stream.source] - stream.start_ns) * 1e-9
    length = zones.seconds[stream.source]

    def times(spans: Sequence[tuple[float, float]]) -> list[list[float]]:
        return [[round(begin + share * length, 3) for share in span] for span in spans]

    return {
        "zones": [
            {
                "name": one.zone,
                "action": one.action or "none",
                "events": times(one.events),
                "visits": times(one.visits),
                "stale": times(one.stale),
                "frame": one.frame,
                "outline": [[round(x, 4), round(y, 4)] for x, y in one.outline],
            }
            for one in zones.timelines[stream.source]
        ],
        "others": [
            {"name": one.name, "parts": [[kind, times(spans)] for kind, spans in one.parts]}
            for one in zones.others[stream.source]
        ],
    }


def _tracks(objects: Rows, members: Int64) -> dict[str, Any]:
    """Return number and velocity of the track of each object; a static track has no velocity."""
    moves = objects.numbers("moving")[members] == 1
    packed: dict[str, Any] = {
        # Numbers beyond are no track's of a log that a page can show.
        "track": _packed(np.nan_to_num(np.minimum(objects.numbers("track")[members], 2**31 - 1)), np.int32),
        "speed": SPEED,
    }
    for name in ("vx", "vy"):
        packed[name] = _signed(np.where(moves, objects.numbers(name)[members], 0.0) / SPEED)
    return packed


def _paths(found: Rows, stream: Stream, sweeps: Int64, in_world: PosedStream) -> dict[str, Any]:
    """Return number, position over ground and velocity of each track in each of the sweeps, visible or hidden."""
    rows, at = rows_of(found, stream.topic, sweeps, stream.source)
    order = np.lexsort((found.integers("track")[rows], at))
    rows, at = rows[order], at[order]
    return {
        "offsets": _packed(np.searchsorted(at, np.arange(len(sweeps) + 1)), np.int32),
        "track": _packed(np.minimum(found.integers("track")[rows], 2**31 - 1), np.int32),
        **{
            name: _packed(found.numbers(name)[rows] - origin, np.float32)
            for name, origin in zip("xy", in_world.origin, strict=True)
        },
        **{name: _signed(found.numbers(name)[rows] / SPEED) for name in ("vx", "vy")},
        "seen": _packed(~found.are("seen", "hidden")[rows], np.uint8),
    }


def _signed(values: Float64) -> dict[str, str]:
    """Return the nearest whole numbers of two bytes; 0 for NaN."""
    return _packed(np.clip(np.nan_to_num(np.round(values)), -32_767, 32_767), np.int16)


def _raw(raw: Raw, sweeps: Int64) -> dict[str, Any]:
    """Return raw sweeps with these indices; one that is not there has no beams."""
    at = np.clip(np.searchsorted(raw.sweep, sweeps), 0, len(raw.sweep) - 1)
    beams, raw = np.where(raw.sweep[at] == sweeps, raw.beams[at], 0), raw.rows(at)
    ranges = raw.ranges
    finite = np.isfinite(ranges) & (ranges >= 0)
    # What is finer than a millimetre is noise, which does not pack.
    scale = max(float(ranges[finite].max(initial=1.0)) / (LOST - 1), 0.001)
    whole = np.where(finite, np.round(np.where(finite, ranges, 0.0) / scale), LOST).astype(np.uint16)
    inside = np.arange(ranges.shape[1]) < beams[:, None]
    return {
        "scale": scale,
        "beams": _packed(beams, np.int32),
        "angle_min": _packed(raw.angle_min, np.float32),
        "angle_increment": _packed(raw.angle_increment, np.float32),
        "closure": _packed(raw.closure, np.uint8),
        "ranges": _packed(_steps(whole[inside]), np.uint8),
    }


def _codes(rows: Rows, name: str, known: Sequence[str]) -> UInt8:
    """Return the codes of a column in a list of names; unknown names are the last one."""
    codes, names = rows.words(name)
    table = np.array([known.index(word) if word in known else len(known) - 1 for word in names] or [0], np.uint8)
    found: UInt8 = table[codes]
    return found


def _steps(values: NDArray[np.uint16]) -> UInt8:
    """Return (2 N,) low and high bytes of the steps between N numbers: even ones for steps up, odd ones for steps down."""
    step = np.diff(values, prepend=np.uint16(0)).view(np.int16)
    folded = ((step << 1) ^ (step >> 15)).view(np.uint16)
    # Most high bytes are zero; by themselves they pack to next to nothing.
    return np.concatenate([folded & 0xFF, folded >> 8]).astype(np.uint8)


def _packed(values: NDArray[Any], kind: type[np.generic]) -> dict[str, str]:
    """Return values of a type, little-endian as in every browser, packed by zlib, in base64."""
    plain = np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<")).tobytes()
    return {"packed": base64.b64encode(zlib.compress(plain)).decode()}


class Key(NamedTuple):
    """An entry of the legend of a chart."""

    words: str
    colour: str
    """Name of a colour of the page."""
    form: str = ""
    """Class of its mark: a square, or `stem` for a line."""


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart, and what is said of it for those who do not see it."""

    title: str
    words: str
    keys: Sequence[Key]
    values: dict[str, Any]
    """Values that `charts.js` draws."""
    aspect: float | None = None
    """Width by height of a map."""


def charts(run: RunPart, walls: Mapping[str, Walls]) -> Iterator[Chart]:
    """Yield the charts that have something to show.

    Parameters
    ----------
    walls : frame → surfaces, to be drawn below the maps
    """
    summary = run.summary
    # More than six lines cannot be distinguished.
    streams = summary.streams.all[:6]
    has_agents = any(np.nansum(stream.course.agents_max) for stream in streams)
    for name in OVER_TIME:
        if streams and (name != "agents_at_once" or has_agents):
            yield _over_time(name, summary, streams)
    baseline = run.comparison.baseline.histograms if run.comparison else {}
    for name in TITLES:
        if summary.histograms[name].counts.sum():
            yield _histogram_chart(summary.histograms[name], baseline.get(name), summary.spreads[name])
    for found in summary.densities:
        yield _density_chart(found, walls.get(found.frame))


def _chart_words(title: str, name: str, spread: Spread) -> str:
    least, greatest = (quantity(name, value) for value in (spread.min, spread.max))
    return f"{title}: {quantity(name, spread.mean)} on average, {least} to {greatest}"


def _over_time(name: str, summary: Summary, streams: Sequence[Stream]) -> Chart:
    """Return a series of each stream; of objects and agents of a single stream also the least and the most."""
    title, label = OVER_TIME[name]
    is_count = name in ("objects_per_sweep", "agents_at_once")
    one = streams[0].course
    series, keys = [], []
    colours: Sequence[str] = ("vermilion",) if name == "agents_at_once" and len(streams) == 1 else SERIES
    if is_count and len(streams) == 1:
        is_agents = name == "agents_at_once"
        low, high = (np.zeros_like(one.seconds), one.agents_max) if is_agents else (one.objects_min, one.objects_max)
        colour = "bar-agents" if is_agents else "bar-objects"
        series.append({"form": "band", "colour": colour, "x": plain(one.seconds), "low": plain(low), "y": plain(high)})
        keys.append(Key("most" if is_agents else "least to most", colour))
    for stream, colour, dash in zip(streams, colours, DASHES, strict=False):
        course = stream.course
        values = {
            "objects_per_sweep": course.objects_mean,
            "agents_at_once": course.agents_mean,
            "d_th": course.d_th,
            "noise": course.noise,
        }[name]
        form = "steps" if is_count else "line"
        series.append({"form": form, "colour": colour, "dash": dash, "x": plain(course.seconds), "y": plain(values)})
        keys.append(Key("mean" if len(streams) == 1 else stream.name, colour, "stem"))
    spread = summary.tracked.spreads[name] if summary.tracked is not None and name == "agents_at_once" else None
    end = max(float(np.max(stream.course.seconds, initial=0.0)) for stream in streams)
    values_of = {"x": "time [s]", "y": label, "span": [0.0, end or 1.0], "whole_y": is_count, "series": series}
    return Chart(title, _chart_words(title, name, spread or summary.spreads[name]), keys, values_of)


def _histogram_chart(one: Histogram, other: Histogram | None, spread: Spread) -> Chart:
    """Return a histogram, with that of a baseline over it."""
    title, label = TITLES[one.name]
    is_turn, is_count = one.unit == "rad", one.name == "objects_per_sweep"
    edges = one.edges * (180 / math.pi if is_turn else 1.0)
    series = [{"form": "bars", "colour": "blue", "x": plain(edges), "y": plain(one.counts)}]
    keys: list[Key] = []
    if other is not None:
        # Shares, because the runs may differ in length.
        own, others = (counts / max(counts.sum(), 1) for counts in (one.counts, other.counts))
        series = [
            {"form": "bars", "colour": "sky", "x": plain(edges), "y": plain(own)},
            {"form": "outline", "colour": "vermilion", "x": plain(edges), "y": plain(others)},
        ]
        keys = [Key("here", "sky"), Key("baseline", "vermilion", "stem")]
    counted = ("sweeps" if is_count else "objects") if other is None else "share"
    values: dict[str, Any] = {"x": label, "y": counted, "span": [float(edges[0]), float(edges[-1])], "series": series}
    values |= {"step": 90.0 if is_turn else None, "whole_x": is_count, "whole_y": other is None}
    return Chart(title, _chart_words(title, one.name, spread), keys, values)


def _density_chart(found: Density, walls: Walls | None) -> Chart:
    """Return how often each cell had an object, in a few steps from pale to dark, over the walls."""
    counts, cell = _coarse(found, walls)
    ix, iy = np.nonzero(counts)
    number = counts[ix, iy]
    level = np.ceil(HEAT * np.sqrt(number / number.max(initial=1))).astype(np.int64)
    keys = []
    for step in range(1, HEAT + 1):
        if len(own := number[level == step]):
            low, high = int(own.min()), int(own.max())
            keys.append(Key(f"{low:,}" if low == high else f"{low:,} to {high:,}", f"heat-{step}"))
    keys = [
        key._replace(words=f"{key.words} objects in a cell of {cell:g} m") if not k else key for k, key in enumerate(keys)
    ]
    values: dict[str, Any] = {"x0": found.x0, "y0": found.y0, "cell": cell, "ix": plain(ix), "iy": plain(iy)}
    values |= {"level": plain(level), "sensor": found.frame == "sensor"}
    corners = [np.array([found.x0, found.y0]), np.array([found.x0, found.y0]) + cell * np.array(counts.shape)]
    corners += [np.zeros(2)] if found.frame == "sensor" else []
    if walls is not None and len(walls.x):
        centres = np.column_stack([walls.x, walls.y])
        corners += [centres.min(axis=0) - walls.cell / 2, centres.max(axis=0) + walls.cell / 2]
        values["walls"] = {"cell": walls.cell, "x": _short(walls.x), "y": _short(walls.y)}
        keys.append(Key("walls and rest", "grey"))
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    width, height = (high - low).tolist()
    title = f"Where objects were, {found.frame} frame"
    words = f"{title}: {int(number.sum()):,} objects in {len(number):,} cells, {number.max(initial=0):,} at most in one"
    values["limits"] = [*low.tolist(), *high.tolist()]
    return Chart(title, words, keys, values, min(max(width / height, 1 / WIDEST), WIDEST))


def _short(values: Float64) -> list[float]:
    """Return places to the millimetre."""
    return [float(value) for value in np.round(values, 3)]


def _coarse(found: Density, walls: Walls | None) -> tuple[Int64, float]:
    """Return the counts of cells and their side [m]; cells are joined where far walls would make them too small to see."""
    nx, ny = found.counts.shape
    extent = max(nx, ny) * found.cell
    if walls is not None and len(walls.x):
        extent = max(extent, float(np.ptp(walls.x)), float(np.ptp(walls.y)))
    block = max(1, math.ceil(extent / 60 / found.cell - 1e-9))
    along_x = np.add.reduceat(found.counts, np.arange(0, nx, block), axis=0)
    counts: Int64 = np.add.reduceat(along_x, np.arange(0, ny, block), axis=1)
    return counts, block * found.cell
