"""Figures and checks of zones, and what a report shows of them, on tables whose values are known."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.options.times import parse_zone
from lidarcli.pipeline.reporting import FORMATS, ReportOptions, make_report, render
from lidarcli.reports.checks import judge
from lidarcli.reports.columns import Origin, ZoneRows
from lidarcli.reports.run import RunPart
from lidarcli.reports.zones import figures_of, parse_zone_check, zones_part
from lidarcli.tabular.schemas import SCHEMAS
from tests.reports.browser import CHROMIUM, browser
from tests.reports.runs import START, crossing, event, made, watch, watched_of, write_run, write_zones

NAMES = ["stop", "left-door", "behind"]
EVENT_ROWS = [
    event(1, "stop", begin=2, last=4, points=9, nearest=0.4, set="A", track=3),
    event(2, "left-door", "crossing", 3, 3, action="none", direction="in", track=3),
    event(3, "stop", "visit", 2, 8, action="stop", track=3),
    event(4, "left-door", "crossing", 5, 5, action="none", direction="out", track=3),
    event(5, "left-door", "crossing", 6, 6, action="none", direction="in", track=4),
    event(6, "stop", "approach", 7, 8, points=5, nearest=0.6, set="S", ttc=0.5),
    event(7, "stop", "stale", 9, 9),
]
ENOUGH = ["zones.stop.observed >= 0.7", "zones.behind.observed == 0"]
POINTS = [0, 0, 5, 9, 4, 0, 2, 3, 5, 0]
AGENTS = [0, 0, 1, 1, 2, 1, 1, 0, 0, 0]
ZONE_ROWS = [
    *(
        watch(
            k,
            "stop",
            POINTS[k],
            nearest=[None, None, 0.5, 0.4, 0.7, None, 0.8, 0.9, 0.6, None][k],
            ttc={7: 1.5, 8: 0.5}.get(k),
            active=k in (2, 3, 4, 7, 8),
            agents=AGENTS[k],
            observed=k >= 3,
        )
        for k in range(10)
    ),
    *(watch(k, "left-door", agents=0) for k in range(10)),
    *(watch(k, "behind", agents=0, observed=False) for k in range(10)),
]


@pytest.fixture(scope="module")
def watched() -> ZoneRows:
    return watched_of(EVENT_ROWS, ZONE_ROWS)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stop.events", 2),
        ("stop.share", 0.5),
        ("stop.duration.mean", 0.15),
        ("stop.duration.min", 0.1),
        ("stop.duration.max", 0.2),
        ("stop.nearest", 0.4),
        ("stop.points.max", 9),
        ("stop.ttc.min", 0.5),
        ("stop.agents_at_once.max", 2),
        ("stop.agents_at_once.mean", 0.6),
        ("stop.dwell.mean", 0.6),
        ("stop.observed", 0.7),
        ("left-door.in", 2),
        ("left-door.out", 1),
        ("left-door.observed", 1),
        ("left-door.dwell.mean", None),
        ("behind.events", None),
        ("behind.in", None),
        ("behind.observed", 0),
    ],
)
def test_figures_of_a_zone(watched: ZoneRows, name: str, value: float | None) -> None:
    found = figures_of(watched)[f"zones.{name}"]
    assert found is None if value is None else found == pytest.approx(value)


def test_lines_and_areas_lack_the_figures_of_the_other(watched: ZoneRows) -> None:
    figures = figures_of(
        replace(
            watched_of(EVENT_ROWS, ZONE_ROWS), shapes={name: {"line": []} if name == "left-door" else {} for name in NAMES}
        )
    )
    empty = ("events", "share", "nearest", "points.max", "ttc.min", "duration.max", "duration.p50")
    assert [figures[f"zones.left-door.{name}"] for name in empty] == [None] * len(empty)
    assert figures["zones.left-door.in"] == 2
    assert figures["zones.left-door.agents_at_once.max"] == 0
    assert figures["zones.stop.events"] == 2
    assert figures["zones.stop.in"] is None
    assert figures["zones.stop.out"] is None


def test_without_tracks_nobody_knows_who_went_across() -> None:
    figures = figures_of(watched_of([], [watch(k, "door", agents=None) for k in range(3)]))
    assert figures["zones.door.in"] is None
    assert figures["zones.door.agents_at_once.mean"] is None
    assert figures["zones.door.events"] == 0
    assert figures["zones.door.share"] == 0


@pytest.mark.parametrize(
    ("expression", "found", "holds"),
    [
        ("zones.stop.events == 2", 2, True),
        ("zones.stop.events == 0", 2, False),
        ("zones.left-door.in between 2 and 3", 2, True),
        ("zones.left-door.in>=2", 2, True),
        ("zones.behind.events == 0", None, False),
        ("events where kind == occupied and set == A == 1", 1, True),
        ("events where kind == occupied and set == A == 0", 1, False),
        ("events where zone == 'left-door' and direction == in == 2", 2, True),
        ("events where track == 3 and kind == crossing == 2", 2, True),
        ("events where nearest < 0.5 or ttc < 1 == 2", 2, True),
        ("events where kind == stale == 1", 1, True),
        ("events where cut == 0", 0, True),
        ("events where sweeps >= 7 == 1", 1, True),
    ],
)
def test_what_a_check_of_zones_finds(watched: ZoneRows, expression: str, found: float | None, holds: bool) -> None:
    verdict = judge(parse_zone_check(expression, NAMES), figures_of(watched), watched)
    assert (verdict.found, verdict.holds) == (found, holds)
    assert (verdict.words == "nothing to measure") == (found is None)


def test_events_of_zones_that_were_never_observed_are_nothing_to_measure() -> None:
    unseen = watched_of([], [watch(k, "behind", observed=False) for k in range(3)])
    verdict = judge(parse_zone_check("events where set == A == 0", ["behind"]), figures_of(unseen), unseen)
    assert (verdict.found, verdict.holds) == (None, False)


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("zones.stpo.events == 0", "unknown zone 'stpo'; did you mean stop? at 'zones.stpo.events', column 1"),
        ("zones.hall.events == 0", "unknown zone 'hall'; there are stop, left-door, behind; at"),
        ("zones.stop.evnts == 0", "unknown figure 'evnts' of zone stop; did you mean events?"),
        ("zones.stop.weight == 0", "unknown figure 'weight' of zone stop; there are events, share, nearest, points.max"),
        ("zones.stop == 0", "unknown figure '' of zone stop; there are events"),
        ("zones.stop.dwell == 0", "zones.stop.dwell has several values, choose one of .mean, .std"),
        ("delta.zones.stop.events == 0", "delta.zones.stop.events needs a --baseline"),
        ("swepes > 3", "unknown figure 'swepes'; docs/reports.md has all;"),
        ("stop.events == 0", "unknown figure 'stop.events'; did you mean zones.stop.events?"),
        ("stpo.weight == 0", "unknown figure 'stpo.weight'; docs/reports.md has all;"),
        ("objects where width > 1 == 0", "unknown table 'objects' before where; available: events;"),
        (
            "events where kind == ocupied == 0",
            r"unknown kind (occupied, approach, visit, crossing, stale, nav2, stop); did you mean occupied?",
        ),
        ("events where size > 1 == 0", "unknown column 'size' of events"),
    ],
)
def test_mistakes_in_checks_of_zones(expression: str, message: str) -> None:
    with pytest.raises(OptionError) as caught:
        parse_zone_check(expression, NAMES)
    assert message in str(caught.value)


def test_summary_of_zones(watched: ZoneRows) -> None:
    zoned = zones_part(watched, [Origin("run.objects.parquet", "run")])
    stop, door, behind = zoned.zones
    assert (stop.action, stop.by, stop.visits) == ("stop", {"A": 1, "S": 1}, 1)
    assert stop.active == pytest.approx(0.3)
    assert (door.visits, behind.figures["observed"]) == (0, 0.0)
    assert (zoned.sweeps, zoned.seconds) == (10, {0: pytest.approx(0.9)})
    assert zoned.listed == 3
    assert [(one.kind, one.first_sweep, one.set) for one in zoned.events] == [
        ("occupied", 2, "A"),
        ("approach", 7, "S"),
        ("stale", 9, ""),
    ]
    courses = {one.zone: one for one in zoned.timelines[0]}
    assert courses["stop"].events == (pytest.approx((2 / 9, 4 / 9)), pytest.approx((7 / 9, 8 / 9)))
    assert courses["stop"].visits == (pytest.approx((2 / 9, 8 / 9)),)
    assert [low for low, _ in courses["left-door"].visits] == pytest.approx([3 / 9, 5 / 9, 6 / 9])
    assert courses["behind"].events == ()


def test_the_gravest_events_come_first() -> None:
    rows = [
        event(1, "far", action="slowdown", nearest=0.1),
        event(2, "near", action="stop", nearest=0.9),
        event(3, "near", action="stop", nearest=0.5, last=3),
        event(4, "near", action="stop", nearest=0.5, last=9),
        event(5, "near", "stale", action="stop"),
        event(6, "near", "approach", action="approach"),
    ]
    zoned = zones_part(watched_of(rows, [watch(k, "near") for k in range(10)]), [Origin("run.objects.parquet", "run")])
    assert [(one.action, one.duration > 0.5, one.nearest) for one in zoned.events[:4]] == [
        ("stop", True, 0.5),
        ("stop", False, 0.5),
        ("stop", False, 0.9),
        ("stop", False, pytest.approx(float("nan"), nan_ok=True)),
    ]
    assert [one.kind for one in zoned.events[3:]] == ["stale", "approach", "occupied"]


def test_many_short_events_are_one_span_where_no_picture_tells_them_apart() -> None:
    rows = [event(k, "stop", begin=k, last=k) for k in range(5_000)]
    zones = [watch(k, "stop") for k in (0, 20_000)]
    [course] = zones_part(watched_of(rows, zones), [Origin("run.objects.parquet", "run")]).timelines[0]
    assert course.events == (pytest.approx((0, 4_999 / 20_000)),)


SHAPES = [
    {"name": "stop", "frame": "sensor", "action": "stop", "polygon": [[0.2, 0.5], [2.6, 0.5], [2.6, -0.5]]},
    {"name": "left-door", "frame": "world", "action": "none", "line": [[2.0, 0.0], [2.0, 1.2]]},
    {"name": "behind", "frame": "robot", "action": "slowdown", "circle": {"x": -1.0, "y": 0.0, "radius": 0.5}},
]


def test_a_report_on_zones_alone_in_every_format(tmp_path: Path) -> None:
    events = write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS, shapes=SHAPES)
    for named in (events, tmp_path / "run.zones.parquet", tmp_path):
        found = made(named, checks=["zones.stop.events == 2", "zones.behind.events == 0"])
        assert not isinstance(found.parts[0], RunPart)
        assert [(one.found, one.holds) for one in found.verdicts] == [(2, True), (None, False)]
        assert found.exit_code == 1
    text = render(found, "text")
    assert max(map(len, text.splitlines())) <= 80
    assert "  stop       stop      ··········████████████▁▁▁▁▁▁▁▁▁▁▁▁▁▁▁██████····░\n" in text
    rows = [" ".join(line.split()) for line in text.splitlines()]
    for row in (
        "stop 2 0.3 s 0.40 m 70 % 1 by agents, 1 by walls",
        "behind 0 % never observed",
        "stop 1 0.6 s 70 %",
        "left-door 2 1 100 %",
        "stop 0.7 s 22:13:20.7 approach 0.10 s 5 0.60 m 0.50 s wall",
    ):
        assert row in rows
    assert "| stop | 2 | 0.3 s | 0.40 m | 70 % | 1 by agents, 1 by walls |" in render(found, "markdown")
    values = json.loads(render(found, "json"))
    assert values["schema"] == "lidarcli.zones/1"
    assert values["figures"]["zones.stop.observed"] == 0.7
    assert values["figures"]["zones.left-door.events"] is None
    assert values["zones"][1] == {
        "name": "left-door", "action": "none", "line": True, "active": 0, "by": {}, "visits": 0,
    }  # fmt: skip
    assert values["events"][0]["track"] == 3
    assert values["events"][2]["nearest"] is None
    junit = render(found, "junit")
    assert '<property name="zones.stop.points.max" value="9" />' in junit
    assert 'message="expected == 0, found nothing to measure"' in junit
    page = render(found, "html")
    assert (
        '<i class="stop" style="left: 22.22%; width: 22.22%" title="stop 0.20 to 0.40 s, 22:13:20.2 to 22:13:20.4">' in page
    )
    lines = render(found, "github").splitlines()
    accepted = "--check 'zones.stop.observed >= 0.7' accepts that"
    assert lines[:3] == [
        f"::error title=lidarcli%3A incomplete::run: zone stop was observed in 7 of 10 sweeps; {accepted}",
        "::error title=lidarcli%3A incomplete::run: zone behind was never observed",
        "::error title=lidarcli%3A check failed::zones.behind.events == 0: expected == 0, found nothing to measure",
    ]


OTHERS = [
    event(8, "stop", "nav2", 1, 3),
    event(9, "invalid source", "nav2", 8, 9),
    event(10, "left-door", "nav2", 5, 6, action="slowdown"),
    event(11, "", "stop", 2, 4, action="none"),
]
"""What Nav2 did, and when the robot stood."""


def test_what_nav2_did_and_where_the_robot_stood(tmp_path: Path) -> None:
    objects = write_run(tmp_path, **crossing())
    write_zones(tmp_path, [*EVENT_ROWS, *OTHERS], ZONE_ROWS, shapes=[])
    found = made(objects, viewer=True)
    assert (found.unread, found.figures["zones.stop.events"]) == ((), 2)
    text = render(found, "text")
    rows = [" ".join(line.split()) for line in text.splitlines()]
    for row in (
        "stop stop ··········████████████▁▁▁▁▁▁▁▁▁▁▁▁▁▁▁██████····░",
        "Nav2 ·····████████████·········▓▓▓▓▓▓▓·········██████",
        "robot stands ··········████████████··························",
        "█ stop ▓ slowdown ▒ approach, limit ░ no sweep for too long",
        "22:13:20.0 22:13:20.9",
    ):
        assert row in rows
    cells = [(one.zone, one.kind, one.action) for one in found.parts[0].summary.zones.events]  # type: ignore[attr-defined]
    # An act of Nav2 is as grave as its action, and no zone asks for it.
    assert cells.index(("invalid source", "nav2", "stop")) < cells.index(("left-door", "nav2", "slowdown"))
    assert cells[-1] == ("", "stop", "none")
    assert '<i class="stale"' in (page := render(found, "html"))
    assert '<i class="slowdown"' in page
    assert "<td>nav2</td>" in page
    assert found.page is not None
    [stream] = found.page.viewer["streams"]
    assert [(one["name"], [kind for kind, _ in one["parts"]]) for one in stream["others"]] == [
        ("Nav2", ["stop", "slowdown"]),
        ("robot stands", ["still"]),
    ]
    assert stream["others"][1]["parts"] == [["still", [[0.2, 0.4]]]]
    assert stream["zones"][1]["action"] == "none"


def test_a_zone_that_no_row_of_zones_has_is_refused_whatever_nav2_did(tmp_path: Path) -> None:
    write_zones(tmp_path, [*EVENT_ROWS, *OTHERS, event(12, "gone")], ZONE_ROWS)
    with pytest.raises(UnreadableError, match=r"does not belong to run.zones.parquet, which has no zone gone"):
        made(tmp_path)


def test_times_of_day_are_in_the_zone_and_left_out_of_a_clock_that_starts_near_zero(tmp_path: Path) -> None:
    events = write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS)
    options = ReportOptions((str(events),), time_zone=parse_zone("+05:30"))
    text = render(make_report(options), "text")
    assert "03:43:20.0" in text
    assert "2023-11-15" in text
    for kind, rows in (("events", SCHEMAS["events"]), ("zones", SCHEMAS["zones"])):
        path = tmp_path / f"run.{kind}.parquet"
        table = pq.read_table(path)
        for name in {"stamp", "start", "end"} & {*table.schema.names}:
            at = table.schema.get_field_index(name)
            early = pc.subtract(table[name].cast(pa.int64()), START).cast(rows.field(name).type)
            table = table.set_column(at, table.schema.field(name), early)
        pq.write_table(table, path)
    text = render(make_report(options), "text")
    assert "0.20 s" in text
    assert not re.search(r"\d\d:\d\d", text)


def test_zones_beside_objects_join_the_report(tmp_path: Path) -> None:
    objects = write_run(tmp_path, **crossing())
    write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS, shapes=SHAPES)
    found = made(
        objects,
        checks=["zones.stop.duration.max < 0.3", "events where set == A == 1", "sweeps == 10", *ENOUGH],
        viewer=True,
    )
    assert isinstance(found.parts[0], RunPart)
    assert found.holds
    assert found.figures["zones.left-door.in"] == 2
    assert "stop: 2 events, 0.3 s, nearest 0.40 m, 1 by agents, 1 by walls, 1 visit" in found.lines
    assert "behind: never observed" in found.lines
    for kind in FORMATS:
        assert "left-door" in render(found, kind)
    values = json.loads(render(found, "json"))
    assert values["schema"] == "lidarcli.report/1"
    assert sum(name.startswith("zones.") for name in values["figures"]) == 3 * 29
    assert [one["name"] for one in values["zones"]] == NAMES


def test_checks_of_zones_need_their_tables(tmp_path: Path) -> None:
    objects = write_run(tmp_path, **crossing())
    for check in ("zones.stop.events == 0", "events where set == A == 0"):
        with pytest.raises(OptionError, match=r"asks for zones, but .*run.zones.parquet is not there; lidarcli zones LOG"):
            made(objects, checks=[check])


def test_zones_that_lie_in_another_folder_than_their_objects_are_left_out(tmp_path: Path) -> None:
    objects = write_run(tmp_path / "tables", **crossing())
    events = write_zones(tmp_path / "out", EVENT_ROWS, ZONE_ROWS)
    report = made(objects, events)
    assert (report.exit_code, [line.partition(":")[0] for line in report.unread]) == (3, [str(events)])


def test_tables_of_zones_that_do_not_belong_together(tmp_path: Path) -> None:
    write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS[:10])
    with pytest.raises(UnreadableError, match=r"does not belong to run.zones.parquet, which has no zone left-door"):
        made(tmp_path)
    (tmp_path / "run.zones.parquet").unlink()
    with pytest.raises(UnreadableError, match=r"run.zones.parquet: not there; lidarcli zones writes it"):
        made(tmp_path)


def test_checks_see_only_a_part_of_a_damaged_log(tmp_path: Path) -> None:
    events = write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS, damage=["chunk 3: cut"])
    report = made(events, checks=["zones.stop.events == 2"])
    assert report.exit_code == 3
    assert "chunk 3: cut" in report.unseen[0]
    assert made(events).exit_code == 0


def test_the_viewer_holds_outlines_and_times(tmp_path: Path) -> None:
    objects = write_run(tmp_path, **crossing())
    write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS, shapes=SHAPES)
    page = made(objects, viewer=True).page
    assert page is not None
    [stream] = page.viewer["streams"]
    stop, door, behind = stream["zones"]
    assert stop == {
        "name": "stop",
        "action": "stop",
        "events": [[0.2, 0.4], [0.7, 0.8]],
        "visits": [[0.2, 0.8]],
        "stale": [[0.9, 0.9]],
        "frame": "sensor",
        "outline": [[0.2, 0.5], [2.6, 0.5], [2.6, -0.5]],
    }
    assert (door["frame"], door["outline"]) == ("world", [[2.0, 0.0], [2.0, 1.2]])
    # Where the robot is in the frame of the sensor, tables do not tell.
    assert (behind["frame"], behind["outline"]) == ("", [])


@pytest.mark.parametrize(
    "shape",
    [
        {"polygon": [[0.0, "x"], [1.0, 1.0]]},
        {"polygon": [[0.0], [1.0, 1.0]]},
        {"polygon": "all"},
        {"polygon": [[float(k), 0.0] for k in range(2_000)]},
        {"circle": {"x": 1.0}},
        {"circle": {"x": None, "y": 0.0, "radius": 1.0}},
        {"line": None},
        {},
    ],
)
def test_outlines_of_odd_metadata_are_left_out(shape: dict[str, object]) -> None:
    watched = replace(watched_of([], [watch(0, "stop")]), shapes={"stop": {"frame": "sensor", **shape}})
    [course] = zones_part(watched, [Origin("run.objects.parquet", "run")]).timelines[0]
    assert (course.frame, course.outline) == ("", ())


@pytest.mark.whole
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_viewer_draws_zones(tmp_path: Path) -> None:
    objects = write_run(tmp_path, **crossing())
    write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS, shapes=SHAPES)
    found = made(objects, viewer=True)
    (tmp_path / "page.html").write_text(render(found, "html"), encoding="utf-8")
    with browser() as page:
        for width in (1280, 400):
            page.open(tmp_path / "page.html", width)
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert page.evaluate("document.getElementById('zones').clientHeight") == 3 * 16
        assert page.complaints == []


def test_of_many_logs_some_courses_are_drawn(tmp_path: Path) -> None:
    for k in range(8):
        write_zones(tmp_path, EVENT_ROWS, ZONE_ROWS, f"log{k}", SHAPES)
    found = made(tmp_path)
    text = render(found, "text")
    assert "  log5" in text.splitlines()
    assert "  log6" not in text.splitlines()
    assert "and 2 more logs" in text
    assert found.lines[0] == "zones in 8 logs: 80 sweeps in 7.2 s from 2023-11-14T22:13:20.000Z, 3 zones"


def test_figures_of_zones_beside_a_baseline(tmp_path: Path) -> None:
    new, old = write_run(tmp_path / "new", **crossing()), write_run(tmp_path / "old", **crossing())
    write_zones(tmp_path / "new", EVENT_ROWS, ZONE_ROWS)
    write_zones(tmp_path / "old", EVENT_ROWS[1:], ZONE_ROWS)
    checks = ("delta.zones.stop.events == 1", "delta.zones.left-door.in == 0", "zones.stop.events == 2")
    report = make_report(ReportOptions((str(new),), checks, (str(old),)))
    assert [(one.found, one.holds) for one in report.verdicts] == [(1, True), (0, True), (2, True)]


def test_words_of_tables_are_shown_and_never_obeyed(tmp_path: Path) -> None:
    hostile = "n\x1b[31m\x07\n```\n::error file=a::pwned\n<img src=x>\u202e"
    shapes = [shape | {"action": hostile} for shape in SHAPES]
    events = [row | {"label": "::error::x", "log": "::warning::y"} for row in EVENT_ROWS]
    write_zones(tmp_path, events, ZONE_ROWS, shapes=shapes)
    found = made(tmp_path)
    for form in ("text", "markdown", "github"):
        text = render(found, form)
        assert not [mark for mark in text if not (mark.isprintable() or mark == "\n")], form
        assert not [line for line in text.splitlines() if line.lstrip().startswith(("::error", "<img"))] or form == "github"
    markdown = render(found, "markdown")
    assert markdown.count("```") % 2 == 0
    assert [line for line in markdown.splitlines() if line.startswith("```")] == ["```"] * markdown.count("```")
    assert "error file=a" not in "".join(
        line for line in render(found, "github").splitlines() if line.startswith("::error")
    )
