"""A run as a part of a report: the sections that say its figures once for every format."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC
from typing import Any

import numpy as np

from lidarcli.display.texts import stamp, times_of_day
from lidarcli.options.times import TimeZone
from lidarcli.reports.columns import Origin, Record
from lidarcli.reports.document import (
    MARKDOWN,
    PAGE,
    TEXT,
    Block,
    Card,
    Code,
    Drawing,
    NamedValues,
    Notes,
    ReportPart,
    ReportTable,
    Section,
    Share,
    Shares,
    table_of,
)
from lidarcli.reports.figures import (
    CATEGORIES,
    DELTA,
    PERCENT,
    SPREADS,
    TRACK_SPREADS,
    plain_fields,
    plain_number,
    plain_numbers,
    unit_of,
)
from lidarcli.reports.streams import most_of, stream_table, stream_values, unlike_of
from lidarcli.reports.summary import (
    KINDS,
    Comparison,
    Summary,
    TracksSummary,
    beams_by_set,
    differences,
    has_agents,
    rate,
    scene_of,
)
from lidarcli.reports.wording import (
    NONE,
    OF_TRACKS,
    SCENES,
    WORDS,
    column,
    counted,
    number,
    percent,
    quantities,
    quantity,
    resample,
    shade,
    share,
    short_label,
    spark,
)
from lidarcli.sweeps.types import worth_telling

STREAMS, STREAMS_OF_PAGE = 12, 100
"""Most logs and topics that tables show; the JSON holds all."""
TRACKS = 12
"""Most tracks that are shown one by one."""
SPARK = 54
"""Width of a course over time [characters]."""
SHOWN_STATISTICS = ("mean", "min", "p05", "p50", "p95", "max")
SHOWN_SPREADS = (
    *("objects_per_sweep", "nearest", "range", "width", "box_length", "box_width", "beams_per_object"),
    *("intensity", "difference", "d_th", "noise", "lost_share", "step"),
)
COMPARED = (
    *("sweeps", "valid_share", "no_return_share", "gaps", "longest_gap", "rate"),
    *("objects_per_sweep.mean", "objects_per_sweep.p95", "agents_per_sweep.mean", "nearest.min"),
    *("range.min", "range.p50", "width.p50", "width.p95", "d_th.mean", "noise.p50"),
    *("tracks", "tracks.agents", "agents_at_once.mean", "agents_at_once.max"),
    *("tracks.duration.p50", "tracks.distance.p50"),
)
"""Figures that a comparison shows where either run has them, in addition to the objects by kind."""
TRACK_CELLS = ("track", "kind", "shape", "label", "duration", "distance", "top speed", "end")
"""Columns of a table of tracks; `track_cells` has more."""


def _card(name: str, value: str, detail: str, word: str) -> Card:
    """Return a key figure whose meaning is that of one of `WORDS`."""
    return Card(name, value, detail, meaning=f"{word}: {WORDS[word]}")


def _comparison(summary: Summary, comparison: Comparison) -> Iterator[tuple[str, Section]]:
    here, there = summary.figures, comparison.baseline.figures
    kinds = [name for name in here if name.split(".")[0] in CATEGORIES and name not in SPREADS]
    rows = []
    for name in (*COMPARED, *kinds):
        before, now = there.get(name), here.get(name)
        # Agents, and objects of a kind, are left out where neither run has any.
        is_kind = name.split(".")[0] in ("agents_per_sweep", *CATEGORIES)
        if (before or now) if is_kind else (before is not None or now is not None):
            change = comparison.figures.get(DELTA + name)
            *both, words = quantities(name, [before, now, change])
            share = comparison.figures.get(PERCENT + name)
            more = "" if not share else f"{share:+.1f} %"
            rows.append((Code(name), *both, f"+{words}" if change and change > 0 else words, more))
    notes = [
        (f"parameter {name}: ", Code(other), " in the baseline, ", Code(own), " here")
        for name, own, other in comparison.parameters
    ]
    table = ReportTable(("figure", "baseline", "here", "difference", "in percent"), rows, (1, 2, 3, 4))
    yield "comparison", Section("Compared with the baseline", [table, Notes([*notes, (comparison.words,)])])
    if comparison.changes:
        changes = [
            (one.log, one.topic, str(one.sweep), str(one.before), str(one.now), f"{one.now - one.before:+d}")
            for one in comparison.changes
        ]
        table = ReportTable(("log", "topic", "sweep", "before", "now", "change"), changes, (2, 3, 4, 5))
        yield "changes", Section("Sweeps whose number of objects changed most", [table])


def _logs(summary: Summary) -> Section:
    sources, streams = summary.sources, summary.streams.all
    blocks: list[Block] = []
    if len(streams) > 1:
        gaps = ["gaps"] if any(one.gaps for one in streams) else []
        cells = ("log and topic", "sweeps", "duration", "rate", "beams", *gaps, "objects")
        blocks.append(stream_table(streams, cells, 1, STREAMS, "more, all of them in --format json"))
    if len(sources) > 1:
        formats = Counter(source.format or "unknown format" for source in sources)
        size = sum(source.size or 0 for source in sources)
        words = f"{', '.join(f'{count:,} {name}' for name, count in formats.items())}; {size:,} bytes"
        blocks.append(NamedValues([("formats", words)]))
    else:
        blocks += [NamedValues([(source.log, _origin(source))]) for source in sources]
    blocks += [NamedValues([("parameters", text)]) for text in dict.fromkeys(map(_settings, sources))]
    blocks += [NamedValues([("damage", f"{one.log}: {line}")]) for one in sources for line in one.damage]
    return Section("Logs" if len(sources) > 1 else "Log", blocks, (TEXT,))


def _overview(summary: Summary) -> NamedValues:
    figures, total = summary.figures, sum(summary.status.values())
    objects = f"{number(figures['objects'])}, on average {number(figures['objects_per_sweep.mean'])} per sweep"
    rows: list[tuple[str, str | Share]] = [
        ("sweeps", f"{number(figures['sweeps'])} in {quantity('duration', figures['duration'])}"),
        ("objects", objects),
    ]
    if has_agents(summary):
        agents = f"{number(figures['agents'])} of these objects"
        if summary.tracked is not None:
            agents += f" belong to {counted(figures['tracks.agents'], 'agent')}"
        rows.append(("agents", agents))
    rows += [("clock", _clock(summary)), ("beams", f"{total:,}")]
    rows += [(f"  {name}", Share(count, total)) for name, count in _beams(summary).items()]
    return NamedValues(rows)


def _key_figures(summary: Summary) -> ReportTable:
    names = {
        **{name: name for name in ("sweeps", "duration", "rate", "gaps", "objects")},
        "objects_per_sweep.mean": "objects per sweep",
        "valid_share": "beams with a range",
    }
    cells = [rate(summary) if name == "rate" else quantity(name, summary.figures[name]) for name in names]
    return ReportTable([*names.values()], [cells], range(len(names)))


def _courses(summary: Summary) -> Iterator[Block]:
    streams = summary.streams.all
    for stream in streams[:STREAMS]:
        course = stream.course
        yield Notes([(f"{stream.name}, {stream.sweeps:,} sweeps from {stamp(stream.start_ns, summary.time_zone)}",)])
        lines = []
        for name, values, unit in (
            ("objects", course.objects_mean, ""),
            ("d_th", course.d_th, " m"),
            ("noise", course.noise, " m"),
            ("lost", course.lost_share, ""),
            *([("agents", course.agents_mean, "")] if np.nansum(course.agents_max) else []),
        ):
            top = most_of(values)
            most = percent(top) if name == "lost" and top is not None else f"{number(top)}{unit}"
            lines.append(f"{name:<8}{spark(resample(values, SPARK)):<{SPARK}}  max {most}")
        yield Drawing(lines)
    if len(streams) > STREAMS:
        yield Notes([(f"and {len(streams) - STREAMS:,} more topics",)])


def _figures(summary: Summary) -> Iterator[tuple[str, Section]]:
    """Yield the table of spreads, without those that mean nothing of unlike sensors together."""
    unlike, tracked = summary.unlike, summary.tracked
    left_out = {*(["step"] if unlike.rates else []), *(["beams_per_object"] if unlike.beams else [])}
    spreads = {name: summary.spreads[name] for name in SHOWN_SPREADS if name not in left_out}
    if tracked is not None:
        spreads |= {name: tracked.spreads[name] for name in TRACK_SPREADS}
    cells, meanings = [], []
    for name, spread in spreads.items():
        if spread.count:
            unit = unit_of(name)
            values = [getattr(spread, part) for part in SHOWN_STATISTICS]
            title = Code(name if unit == "1" else f"{name} [{unit}]")
            cells.append((title, *quantities(f"{name}.", values, with_unit=False)))
            meanings.append((SPREADS | TRACK_SPREADS)[name].meaning)
    if not cells:
        return
    head, right = ("", *SHOWN_STATISTICS), range(1, 7)
    yield "figures", Section("Figures", [ReportTable(head, cells, right)], (TEXT, MARKDOWN), "Figures")
    explained = [(*row, words) for row, words in zip(cells, meanings, strict=True)]
    yield "page of figures", Section("Figures", [ReportTable((*head, "of"), explained, right)], (PAGE,))


def _kinds(summary: Summary) -> Iterator[tuple[str, Section]]:
    fold = "Objects and beams by kind"
    for name in ("shape", "visibility", "change"):
        if counts := _most_first(summary.kinds[name]):
            shares = Shares(name, "objects", counts, sum(counts.values()))
            yield name, Section(f"Objects by {name}", [shares], fold=fold)
    beams = Shares("beams", "number", _beams(summary), sum(summary.status.values()))
    yield "beams", Section("Beams", [beams], (MARKDOWN, PAGE), fold)


def _most_first(counts: Mapping[str, int]) -> dict[str, int]:
    """Return counts by falling number, however the table has numbered its words."""
    return dict(sorted(counts.items(), key=lambda each: (-each[1], each[0])))


def _beams(summary: Summary) -> dict[str, int]:
    """Return the beams by status and then by set."""
    status = {name.replace("_", " "): count for name, count in worth_telling(summary.status).items()}
    return status | beams_by_set(summary)


def _tracks(tracked: TracksSummary) -> Iterator[tuple[str, Section]]:
    formats = (TEXT, MARKDOWN)
    yield "tracks", Section("Tracks", [NamedValues([*_track_facts(tracked).items()])], formats)
    for name, kinds in tracked.kinds.items():
        if counts := _most_first({kind.replace("_", " "): count for kind, count in kinds.items()}):
            shares = Shares(name.removeprefix("tracks."), "tracks", counts, sum(counts.values()))
            title = name.replace(".", " by ").capitalize()
            yield name, Section(title, [shares], fold="Tracks")
    shown = tracked.most(TRACKS)
    if not shown:
        return
    blocks: list[Block] = []
    groups = _by_topic(shown)
    for name, group in groups.items():
        if len(groups) > 1:
            blocks.append(Notes([(name,)]))
        cells = track_cells(group) | {"label": [short_label(one.label) for one in group]}
        blocks.append(table_of({name: cells[name] for name in TRACK_CELLS}))
    total = int(tracked.figures["tracks"] or 0)
    title = "Track by track" + (f", {len(shown)} of {total:,}" if total > len(shown) else "")
    yield "track by track", Section(title, blocks, formats, title if total > len(shown) else "Tracks")


def _track_facts(tracked: TracksSummary) -> dict[str, str]:
    """Return the number of tracks, of agents at once, and the kind of scene, in words."""
    count, agents = tracked.figures["tracks"], tracked.figures["tracks.agents"]
    at_once = tracked.spreads["agents_at_once"]
    facts = {
        "tracks": f"{number(count)}, {number(agents)} of them {'an agent' if agents == 1 else 'agents'}",
        "people": f"{number(tracked.figures['tracks.people'])}: agents that went 2 m or more, each person once",
        "agents at once": f"{number(at_once.mean)} on average, at most {number(at_once.max)}",
    }
    if (part := tracked.agent_share) is not None:
        scene = scene_of(part)
        facts["scene"] = f"{scene}: {SCENES[scene]} ({percent(part)} of the beams on agents)"
    return facts


def track_cells(tracks: Sequence[Record], zone: TimeZone = UTC) -> dict[str, list[str]]:
    """Return heading → cells of a table of tracks, where a column has the same number of decimals."""
    head, clocks = times_of_day([one.first_ns for one in tracks], zone)
    sizes = [" x ".join(f"{value:.2f}" for value in (one.length, one.width) if math.isfinite(value)) for one in tracks]
    return {
        "track": [str(one.track) for one in tracks],
        "kind": ["agent" if one.set == "A" else "object" for one in tracks],
        "shape": [one.shape for one in tracks],
        "label": [one.label for one in tracks],
        "first seen": column([one.start for one in tracks], " s"),
        head: clocks,
        "duration": column([one.duration for one in tracks], " s"),
        "sweeps": [number(one.sweeps) for one in tracks],
        "hidden": column([one.hidden for one in tracks], " s"),
        "size": [f"{size} m" if size else NONE for size in sizes],
        "distance": column([one.distance for one in tracks], " m"),
        "mean speed": column([one.speed_mean for one in tracks], " m/s"),
        "top speed": column([one.speed_max for one in tracks], " m/s"),
        "end": [one.end for one in tracks],
    }


def _labels(summary: Summary) -> Iterator[tuple[str, Section]]:
    if summary.labels:
        rows = [(one.name, number(one.tracks), number(one.objects)) for one in summary.labels]
        yield "labels", Section("By label", [ReportTable(("label", "tracks", "objects"), rows, (1, 2))])


def _distributions(summary: Summary) -> Iterator[tuple[str, Section]]:
    """Yield histograms and maps in block characters; a page has charts."""
    lines = []
    for one in summary.histograms.values():
        if not one.counts.sum():
            continue
        factor, unit = (180 / math.pi, "deg") if one.unit == "rad" else (1.0, one.unit)
        unit = "" if unit == "1" else f" {unit}"
        # The edges of whole numbers lie between them.
        half = 0.5 if one.name == "objects_per_sweep" else 0.0
        low, high = one.edges[0] * factor + half, one.edges[-1] * factor - half
        marks = (mark if count else "·" for mark, count in zip(spark(one.counts), one.counts, strict=True))
        lines.append(f"{one.name:<18}{number(low):>6} {''.join(marks)} {number(high)}{unit}")
    if lines:
        yield "distributions", Section("Distributions", [Drawing(lines)], (TEXT,))
    logs = len(summary.sources)
    several = f", {logs:,} logs over each other" if logs > 1 else ""
    for found in summary.densities:
        nx, ny = found.counts.shape
        x = f"x {number(found.x0)} to {number(found.x0 + nx * found.cell)} m"
        y = f"y {number(found.y0)} to {number(found.y0 + ny * found.cell)} m"
        title = f"Where objects were{several} ({found.frame} frame, {x}, {y}, y up)"
        drawing = Drawing(shade(found, 76, 20))
        yield f"map {found.frame}", Section(title, [drawing], (TEXT,))


def _outliers(summary: Summary) -> Iterator[tuple[str, Section]]:
    if not summary.outliers:
        return
    blocks: list[Block] = []
    for name, group in _by_topic(sorted(summary.outliers, key=lambda one: one.stream)).items():
        if len(summary.streams.all) > 1:
            blocks.append(Notes([(name,)]))
        date, times = _times([one.stamp for one in group], summary.time_zone)
        rows = [(KINDS[one.kind], one.words, str(one.sweep), time) for one, time in zip(group, times, strict=True)]
        blocks.append(ReportTable(("", "value", "sweep", date), rows, (1, 2)))
    blocks.append(Notes([("To see one: ", Code("lidarcli plot LOG --topic TOPIC --sweep N -o sweep.png"))]))
    yield "outliers", Section("Sweeps that stand out", blocks, (TEXT, MARKDOWN))


def _by_topic(items: Sequence[Record]) -> dict[str, list[Record]]:
    """Return log and topic → the items of it, in their order."""
    found: dict[str, list[Record]] = {}
    for one in items:
        found.setdefault(f"{one.log} {one.topic}", []).append(one)
    return found


def _times(stamps_ns: Sequence[int], zone: TimeZone = UTC) -> tuple[str, list[str]]:
    """Return the heading and the cells of a column of stamps: their date once, if they share it.

    >>> _times([1_700_000_000_123_456_789, 1_700_000_001_000_000_000])
    ('2023-11-14', ['22:13:20.123Z', '22:13:21.000Z'])
    """
    words = [stamp(each, zone) for each in stamps_ns]
    dates, _, times = zip(*(each.partition("T") for each in words), strict=True)
    return (dates[0], [*times]) if len({*dates}) == 1 and all(times) else ("stamp", words)


def _streams(summary: Summary) -> Iterator[tuple[str, Section]]:
    cells = ("log, topic (frame)", "sweeps", "rate", "beams", "gaps", "backward", "objects per sweep", "most")
    table = stream_table(summary.streams.all, cells, 1, STREAMS, "more topics")
    if table.rows:
        yield "streams", Section("Over time", [table], (MARKDOWN,), "Over time")


def _words(summary: Summary) -> tuple[str, Section]:
    """Return the words of the page that not everybody knows."""
    rows = [(name, words) for name, words in WORDS.items() if summary.tracked is not None or name not in OF_TRACKS]
    rows += [] if summary.zones is None else summary.zones.words.items()
    return "words", Section("Words", [NamedValues(rows)], (PAGE,))


def _sources(summary: Summary) -> Iterator[tuple[str, Section]]:
    sources = summary.sources
    lines = [(f"damage in {one.log}: {line}",) for one in sources for line in one.damage]
    damage = [Notes(lines, alarming=True)] if lines else []
    for name, most, formats in (("sources", STREAMS, (MARKDOWN,)), ("page of sources", STREAMS_OF_PAGE, (PAGE,))):
        rows = [(one.log, _origin(one), _settings(one)) for one in sources[:most]]
        more = f"and {len(sources) - most:,} more logs" if len(sources) > most else ""
        blocks: list[Block] = [ReportTable(("log", "format", "parameters of detect"), rows, (), more), *damage]
        if formats == (PAGE,):
            cells = ("log", "topic", "frame", "sweeps", "duration", "rate", "gaps", "backward", "objects")
            blocks.insert(0, stream_table(summary.streams.all, cells, 3, most, "more topics"))
        yield name, Section("Logs", blocks, formats, "Logs and parameters")


def _clock(summary: Summary) -> str:
    """Return the rate and the faults of the stamps, in words."""
    figures = summary.figures
    faults = []
    if figures["gaps"]:
        longest = quantity("longest_gap", figures["longest_gap"])
        missing = counted(figures["missing_sweeps"], "sweep")
        faults.append(f"{counted(figures['gaps'], 'gap')} ({missing} missing, the longest gap {longest})")
    if figures["backward"]:
        faults.append(f"{counted(figures['backward'], 'stamp')} before the previous one")
    if figures["repeated"]:
        faults.append(f"{counted(figures['repeated'], 'stamp')} repeated")
    if figures["rate"] is None:
        return ", ".join(faults) or "too few sweeps to tell"
    return ", ".join([rate(summary), *(faults or ["no gaps", "all stamps increasing"])])


def _settings(source: Origin) -> str:
    """Return the parameters of a run that are set, in words."""
    found = {name: value for name, value in source.parameters.items() if value not in (None, False, [], 0.0)}
    return ", ".join(f"{name} {_plain(value)}" for name, value in found.items()) or "not recorded"


def _plain(value: object) -> str:
    if isinstance(value, list):
        return "[" + " ".join(map(str, value)) + "]"
    if isinstance(value, dict):
        return "{" + " ".join(f"{key}={item}" for key, item in value.items()) + "}"
    return str(value)


def _origin(source: Origin) -> str:
    """Return format and size of a log."""
    size = f", {source.size:,} bytes" if source.size is not None else ""
    return f"{source.format or 'unknown format'}{size}"


@dataclass(frozen=True, slots=True)
class RunPart(ReportPart):
    """A run, and a baseline that it is compared with, as a part of a report."""

    summary: Summary
    comparison: Comparison | None = None
    schema = "lidarcli.report/1"

    @property
    def sources(self) -> tuple[Origin, ...]:  # type: ignore[override]
        """Origins of the tables."""
        return self.summary.sources

    @property
    def title(self) -> str:
        """Name of the log, or the number of logs."""
        names = [source.log for source in self.summary.sources]
        return names[0] if len(names) == 1 else counted(len(names), "log")

    @property
    def figures(self) -> Mapping[str, float | None]:  # type: ignore[override]
        """Figures by name."""
        return self.summary.figures

    @property
    def differences(self) -> Mapping[str, float | None]:
        """Differences from the baseline, where there is one."""
        return self.comparison.figures if self.comparison else {}

    def sections(self) -> dict[str, Section]:
        """Return the sections by name, in their order."""
        summary, comparison = self.summary, self.comparison
        parts = [
            *(_comparison(summary, comparison) if comparison is not None else ()),
            ("logs", _logs(summary)),
            ("overview", Section("Overview", [_overview(summary)], (TEXT,))),
            ("key figures", Section("", [_key_figures(summary)], (MARKDOWN,))),
            ("courses", Section("Over time", [*_courses(summary)], (TEXT,))),
            *_figures(summary),
            *_kinds(summary),
            *(_tracks(summary.tracked) if summary.tracked is not None else ()),
            *(summary.zones.sections().items() if summary.zones is not None else ()),
            *_labels(summary),
            *_distributions(summary),
            *_outliers(summary),
            *_streams(summary),
            _words(summary),
            *_sources(summary),
        ]
        return dict(parts)

    def cards(self) -> list[Card]:
        """Return the key figures of a page."""
        summary = self.summary
        figures, per = summary.figures, summary.spreads["objects_per_sweep"]
        logs = f"{counted(figures['logs'], 'log')}, {counted(figures['topics'], 'topic')}"
        objects = f"{number(per.mean)} per sweep, at most {number(per.max)}"
        beams = sum(summary.status.values())
        lost = share(summary.status["no_return"], beams)
        cards = [
            _card("sweeps", number(figures["sweeps"]), logs, "sweep"),
            Card("duration", quantity("duration", figures["duration"]), rate(summary)),
            _card("objects", number(figures["objects"]), objects, "object"),
            _card("beams with a range", share(summary.status["valid"], beams), f"of {beams:,}; {lost} no return", "beam"),
        ]
        tracked = summary.tracked
        if tracked is not None:
            at_once = tracked.spreads["agents_at_once"].max
            most = f", at most {number(at_once)} at once" if at_once else ""
            agents = f"{counted(figures['tracks.agents'], 'agent')}{most}"
            cards.append(_card("tracks", number(figures["tracks"]), agents, "track"))
            if (part := tracked.agent_share) is not None:
                scene = scene_of(part)
                cards.append(_card("beams on agents", percent(part), f"{scene} scene: {SCENES[scene]}", "agent"))
        if summary.zones is not None:
            cards += summary.zones.cards()
        missing, faults = "no sweep is missing", "stamps always increase"
        if figures["gaps"]:
            longest = quantity("longest_gap", figures["longest_gap"])
            missing = f"{counted(figures['missing_sweeps'], 'sweep')} missing, longest {longest}"
        if figures["backward"] or figures["repeated"]:
            faults = f"{number(figures['backward'])} backward, {number(figures['repeated'])} repeated"
        cards += [
            _card("gaps", number(figures["gaps"]), missing, "gap"),
            _card("clock faults", number((figures["backward"] or 0) + (figures["repeated"] or 0)), faults, "clock fault"),
        ]
        if damage := figures["damage"]:
            cards.append(Card("damage", number(damage), f"{'part' if damage == 1 else 'parts'} of the logs not read"))
        return cards

    @property
    def lines(self) -> list[str]:
        """Numbers of sweeps and objects; with a baseline also of sweeps that differ."""
        figures = self.summary.figures
        parts = [f"{counted(figures['sweeps'], 'sweep')} in {quantity('duration', figures['duration'])}"]
        if figures["rate"] is not None:
            parts.append(rate(self.summary))
        parts.append(counted(figures["objects"], "object"))
        if figures["sweeps"]:
            parts[-1] += f" ({number(figures['objects_per_sweep.mean'])} per sweep)"
        if self.summary.tracked is not None:
            agents = counted(figures["tracks.agents"], "agent")
            parts.append(f"{counted(figures['tracks'], 'track')} ({agents})")
        if figures["damage"]:
            parts.append(f"damage in {counted(figures['damage'], 'place')} of the logs")
        lines = [f"{self.title}: {', '.join(parts)}"]
        lines += [] if self.summary.zones is None else self.summary.zones.lines
        return [*lines, *([] if self.comparison is None else [self.comparison.words])]

    @property
    def warnings(self) -> list[str]:
        """Warnings of sensors that are pooled, or compared, but unlike."""
        found = []
        if unlike := differences(self.summary.unlike):
            found.append(
                f"unlike sensors ({unlike}): the figures pool all of them, and no map in the sensor frame is drawn; for "
                "figures of one sensor report its tables alone"
            )
        if self.comparison is not None:
            baseline = self.comparison.baseline
            both = unlike_of([*self.summary.streams.all, *baseline.streams.all])
            if both and not (self.summary.unlike or baseline.unlike):
                found.append(
                    f"the baseline is of another sensor ({differences(both)}): what differs need not be in the scene"
                )
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return beams, objects, tracks, zones and the comparison, for JSON."""
        summary = self.summary
        found: dict[str, Any] = {
            "beams": {"status": summary.status, "set": summary.sets},
            "objects": summary.kinds,
            "histograms": _histograms(summary),
            "maps": [plain_fields(one, "frame", "x0", "y0", "cell", "counts") for one in summary.densities],
            "streams": [stream_values(one) for one in summary.streams.all],
            "standing_out": [
                plain_fields(one, "kind", "log", "topic", "sweep")
                | {"stamp": stamp(one.stamp), "value": plain_number(one.value)}
                for one in summary.outliers
            ],
        }
        if (tracked := summary.tracked) is not None:
            kinds = {name.removeprefix("tracks."): counts for name, counts in tracked.kinds.items()}
            found["tracks"] = {"scene": tracked.scene, "agent_share": plain_number(tracked.agent_share), **kinds}
        if summary.labels:
            found["labels"] = [vars(label) for label in summary.labels]
        found |= {} if summary.zones is None else summary.zones.as_dict()
        return found | {"comparison": None if self.comparison is None else _comparison_values(self.comparison)}


def _histograms(summary: Summary) -> dict[str, Any]:
    return {name: plain_fields(one, "unit", "edges", "counts") for name, one in summary.histograms.items()}


def _comparison_values(comparison: Comparison) -> dict[str, Any]:
    baseline = comparison.baseline
    return {
        "baseline": {
            "logs": [source.log for source in baseline.sources],
            "figures": plain_numbers(baseline.figures),
            "histograms": _histograms(baseline),
        },
        "figures": plain_numbers(comparison.figures),
        "parameters": [{"name": name, "here": here, "baseline": there} for name, here, there in comparison.parameters],
        "changes": [plain_fields(one, "log", "topic", "sweep", "before", "now") for one in comparison.changes],
    }
