"""One shape in every form in which a zone may have it, and the same events."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
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
