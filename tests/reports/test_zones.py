"""Figures and checks of zones, and what a report shows of them, on tables whose values are known."""

from __future__ import annotations

import pytest

from lidarcli.errors import OptionError
from lidarcli.reports.columns import Watched
from lidarcli.reports.zones import figures_of, judge_zones, parse_zone_check, zone_figures
from lidarcli.tabular.schemas import EVENTS, ZONES
from tests.reports.runs import event, table, watch, watched_of

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
            seen=0.5 if k < 5 else 1.0,
        )
        for k in range(10)
    ),
    *(watch(k, "left-door", agents=0) for k in range(10)),
    *(watch(k, "behind", agents=0, seen=0.0) for k in range(10)),
]


@pytest.fixture(scope="module")
def watched() -> Watched:
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
        ("stop.seen", 0.75),
        ("left-door.in", 2),
        ("left-door.out", 1),
        ("left-door.seen", 1),
        ("left-door.dwell.mean", None),
        ("behind.events", None),
        ("behind.in", None),
        ("behind.seen", None),
    ],
)
def test_figures_of_a_zone(watched: Watched, name: str, value: float | None) -> None:
    found = figures_of(watched)[f"zones.{name}"]
    assert found is None if value is None else found == pytest.approx(value)


def test_every_zone_has_every_figure(watched: Watched) -> None:
    figures = figures_of(watched)
    assert len(figures) == 3 * (8 + 3 * 7)
    assert [*dict.fromkeys(name.split(".")[1] for name in figures)] == NAMES


def test_lines_and_areas_lack_the_figures_of_the_other(watched: Watched) -> None:
    figures = zone_figures(table(EVENTS, EVENT_ROWS), table(ZONES, ZONE_ROWS), lines=["left-door"])
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


def test_tables_without_rows_have_no_zones() -> None:
    assert zone_figures(table(EVENTS, []), table(ZONES, [])) == {}


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
def test_what_a_check_of_zones_finds(
    watched: Watched, expression: str, found: float | None, holds: bool
) -> None:
    verdict = judge_zones(parse_zone_check(expression, NAMES), figures_of(watched), watched)
    assert (verdict.found, verdict.holds) == (found, holds)
    assert (verdict.words == "nothing to measure") == (found is None)


def test_events_of_zones_that_were_never_in_view_are_nothing_to_measure() -> None:
    unseen = watched_of([], [watch(k, "behind", seen=0.0) for k in range(3)])
    verdict = judge_zones(
        parse_zone_check("events where set == A == 0", ["behind"]), figures_of(unseen), unseen
    )
    assert (verdict.found, verdict.holds) == (None, False)


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        (
            "zones.stpo.events == 0",
            "unknown zone 'stpo'; did you mean stop? at 'zones.stpo.events', column 1",
        ),
        ("zones.hall.events == 0", "unknown zone 'hall'; there are stop, left-door, behind; at"),
        ("zones.stop.evnts == 0", "unknown figure 'evnts' of zone stop; did you mean events?"),
        (
            "zones.stop.weight == 0",
            "unknown figure 'weight' of zone stop; there are events, share, nearest, points.max",
        ),
        ("zones.stop == 0", "unknown figure '' of zone stop; there are events"),
        ("zones.stop.dwell == 0", "zones.stop.dwell has several values, choose one of .mean, .std"),
        ("delta.zones.stop.events == 0", "delta.zones.stop.events needs a --baseline"),
        ("sweeps > 3", "unknown figure 'sweeps'"),
        ("objects where width > 1 == 0", "unknown table 'objects' before where; available: events;"),
        (
            "events where kind == ocupied == 0",
            r"unknown kind (occupied, approach, visit, crossing, stale); did you mean occupied?",
        ),
        ("events where size > 1 == 0", "unknown column 'size' of events"),
    ],
)
def test_mistakes_in_checks_of_zones(expression: str, message: str) -> None:
    with pytest.raises(OptionError) as caught:
        parse_zone_check(expression, NAMES)
    assert message in str(caught.value)
