"""One shape in every form in which a zone may have it, and the same events."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.formalism import zones
from lidarcli.formalism.zones import Path as Trajectory
from lidarcli.formalism.zones import same_agents
from lidarcli.masks import Circle
from lidarcli.pipeline.zone_counting import Columns, Shapes, TopicSeries, ZoneSeries
from lidarcli.pipeline.zone_events import EventFinder
from lidarcli.zone import Zone
from tests.zones.runs import (
    column,
    polygon_at,
    rows,
    scans,
    scene_of,
    sound,
    sweeps_of,
    times_of,
    transform_at,
    twists,
    walker,
    write_bag,
    zone_file,
)

ROUND = [(1.5 * np.cos(a), 1.5 * np.sin(a)) for a in np.linspace(0.0, 2 * np.pi, 100, endpoint=False)]
POINTS = "[" + ", ".join(f"[{x:.6f}, {y:.6f}]" for x, y in ROUND) + "]"
FORMS = f"""
monitor:
  ros__parameters:
    base_frame_id: base_link
    cmd_vel_in_topic: /cmd_vel
    polygons: [circle, polygon, parts, told]
    circle: {{type: circle, radius: 1.5, action_type: stop}}
    polygon: {{type: polygon, points: "{POINTS}", action_type: stop}}
    told: {{type: polygon, polygon_sub_topic: /shape, action_type: stop}}
    parts:
      type: velocity_polygon
      action_type: stop
      velocity_polygons: [slow, fast]
      slow: {{points: "{POINTS}", linear_min: 0.0, linear_max: 0.5, theta_min: -1.0, theta_max: 1.0}}
      fast: {{points: "{POINTS}", linear_min: 0.5, linear_max: 2.0, theta_min: -1.0, theta_max: 1.0}}
    observation_sources: [scan]
    scan: {{type: scan, topic: /scan}}
"""
SAME = ("kind", "first_sweep", "last_sweep", "sweeps", "start", "end", "points", "agents", "set", "track", "cut")


def test_events_are_the_same_in_every_form(tmp_path: Path) -> None:
    """The velocity, and with it the part, and the told shape change in every second sweep of a batch."""
    scene = scene_of(walker((-4.0, 0.8), (4.0, 0.8)), walker((4.0, -1.0), (-4.0, -1.0)), sweeps=70)
    stamps = times_of(scene)
    links = [transform_at(int(stamps[0]), "base_link", scene.sensor.frame_id, (0.0, 0.0, 0.0))]
    speeds = [twists([at], (0.2 + 0.6 * (k % 2), 0.0, 0.0))[0] for k, at in enumerate(stamps - 1)]
    # The same shape from another corner on is another shape to the reader.
    shapes = [
        polygon_at(int(at), "base_link", [*ROUND[k % 3 :], *ROUND[: k % 3]], "/shape") for k, at in enumerate(stamps - 1)
    ]
    log = write_bag(tmp_path / "a.bag", links, scans(sweeps_of(scene)), speeds, shapes)
    tables = sound(lidarcli.zones(log, zones=str(zone_file(tmp_path, FORMS, "forms.yaml"))))
    found: dict[str, list[dict[str, Any]]] = {
        name: rows(tables.events, zone=name) for name in ("circle", "polygon", "parts", "told")
    }
    expected = found["circle"]
    assert {event["set"] for event in expected} == {"A"}
    assert {event["track"] for event in expected if event["kind"] == "visit"} == {1, 2}
    assert max(event["agents"] for event in expected) == 2
    for name, told in found.items():
        assert [[e[key] for key in SAME] for e in told] == [[e[key] for key in SAME] for e in expected], name
        for one, other in zip(told, expected, strict=True):
            assert [one[key] for key in ("nearest", "bearing", "x", "y")] == pytest.approx(
                [other[key] for key in ("nearest", "bearing", "x", "y")], abs=0.01
            )
    for each in ("points", "things", "agents", "active"):
        assert column(tables.zones, each, zone="parts") == column(tables.zones, each, zone="polygon")
        assert column(tables.zones, each, zone="told") == column(tables.zones, each, zone="polygon")


def flickering(sweeps: int) -> TopicSeries:
    """A topic with a zone that is occupied in every second sweep."""
    zone = ZoneSeries(Zone("near", Circle(0.0, 0.0, 1.0)), Shapes([Circle(0.0, 0.0, 1.0)]))
    topic = TopicSeries("/scan", "laser", [zone], 0)
    number = np.arange(sweeps)
    inside = (number % 2 == 0)[:, None]
    topic.append(sweep=number, stamp_ns=number * 100_000_000, seconds=number * 0.1)
    zone.append(points=np.where(inside, 9, 0), masked=np.zeros((sweeps, 1), np.int32), reach=np.full((sweeps, 1), 9))
    zone.append(**dict.fromkeys(("nearest", "bearing", "x", "y"), np.where(inside, 0.5, np.nan)))
    zone.append(ttc=np.full((sweeps, 1), np.nan), velocity=np.full((sweeps, 3), np.nan))
    return topic


def test_events_cost_as_much_each_in_a_long_log(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing of the size of the log is walked over once for each event: a whole column is read a few times at most."""
    read = 0
    column = Columns.column

    def counted(self: Columns, name: str) -> Any:
        nonlocal read
        read += 1
        return column(self, name)

    monkeypatch.setattr(Columns, "column", counted)
    calls = []
    for sweeps in (200, 2000):
        read = 0
        topic = flickering(sweeps)
        span_ns = 0, (sweeps - 1) * 100_000_000
        found = EventFinder(topic.zones[0].zone, [topic], [None], has_objects=True, span_ns=span_ns, first_ns=0).find()
        assert len(found.events) == sweeps // 2
        calls.append(read)
    assert calls[0] == calls[1] < 30


def test_only_paths_of_one_time_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    compared = 0

    def apart(path: Trajectory, other: Trajectory) -> float | None:
        nonlocal compared
        compared += 1
        return 0.1

    monkeypatch.setattr(zones, "_apart", apart)
    place = np.zeros(2)
    sensors = [{k: Trajectory(np.array([10 * k, 10 * k + 5]) + late, place, place) for k in range(300)} for late in (0, 1)]
    begin = time.process_time()
    numbers = same_agents(sensors)
    assert compared == 300
    assert time.process_time() - begin < 1.0
    assert all(numbers[0, k] == numbers[1, k] for k in range(300))
    assert len({*numbers.values()}) == 300
