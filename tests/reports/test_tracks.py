"""What a report says of tracks, against values that follow from the scene."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.reports import figures, summary
from lidarcli.reports.columns import Origin, Rows, Run
from lidarcli.reports.summary import Label, scene_of, summarise
from tests.reports.runs import crossing, run_of, sweep, thing, track


def test_every_figure_of_tracks_has_its_name() -> None:
    found = summarise(run_of(**crossing()))
    assert list(found.figures) == [*figures.names(), *figures.track_names()]
    assert list(summarise(run_of([sweep(0)])).figures) == figures.names()


def test_figures_of_a_crossing() -> None:
    found = summarise(run_of(**crossing()))
    wanted = {
        "tracks": 3,
        "tracks.agents": 2,
        "agents": 8 * 2 + 5,
        "objects": 10 + 8 * 2 + 5,
        "objects_per_sweep.mean": 3.1,
        "object_share": (10 * 5 + 8 * 4 + 5 * 6) / 1000,
        "agent_share": (8 * 4 + 5 * 6) / 1000,
        "noise_share": 0.95 - (8 * 4 + 5 * 6) / 1000,
        "agents_at_once.mean": (8 + 5) / 10,
        "agents_at_once.min": 1,
        "agents_at_once.max": 2,
        "agents_per_sweep.max": 3,
        "tracks.duration.p50": 0.7,
        "tracks.sweeps.mean": (10 + 8 + 5) / 3,
        "tracks.distance.max": 0.7,
        "tracks.speed_mean.p50": 0.5,
        "tracks.speed_max.max": 1.2,
        "tracks.shape.prismatic": 1,
        "tracks.shape.unknown": 0,
        "tracks.end.left_view": 1,
        "tracks.end.lost": 0,
    }
    for name, value in wanted.items():
        assert found.figures[name] == pytest.approx(value), name
    tracked = found.tracked
    assert tracked is not None
    assert tracked.kinds == {
        "tracks.shape": {"prismatic": 1, "legged": 1, "round": 1},
        "tracks.end": {"end_of_log": 2, "left_view": 1},
    }
    assert tracked.agent_share == pytest.approx((8 * 4 + 5 * 6) / 1000)
    assert tracked.scene == "semi-structured"
    assert [(one.track, one.first_sweep, one.start, one.set == "A") for one in tracked.tracks] == [
        (1, 0, 0.0, False),
        (2, 0, 0.0, True),
        (3, 5, 0.5, True),
    ]
    assert [one.track for one in tracked.most(2)] == [2, 3]
    assert found.labels == (Label("pallet", 1, 10),)


def test_agents_at_once_are_things_and_not_objects() -> None:
    run = run_of(**crossing())
    assert run.agents_at_once.tolist() == [1] * 5 + [2] * 3 + [1] * 2
    course = summarise(run).streams.all[0].course
    assert course.agents_max.tolist() == run.agents_at_once.tolist()


def test_what_kind_of_scene_it_is() -> None:
    still = crossing()
    for row in still["sweeps"]:
        row |= {"agents": 0, "noise_beams": 95, "agent_beams": 0}
    for share, words in ((0, "structured"), (1, "structured"), (2, "semi-structured"), (251, "unstructured")):
        still["sweeps"][0]["agent_beams"] = share
        tracked = summarise(run_of(**still)).tracked
        assert tracked is not None
        assert (tracked.agent_share, tracked.scene) == (pytest.approx(share / 1000), words)
    assert scene_of(0.25) == "semi-structured"
    nothing = summarise(run_of([], [], [])).tracked
    assert nothing is not None
    assert (nothing.scene, nothing.figures["tracks"], nothing.figures["tracks.duration.p50"]) == (None, 0, None)


def test_without_a_tracks_table_nothing_is_said_of_tracks() -> None:
    found = summarise(run_of([sweep(0, 1)], [thing(0, 1)]))
    assert (found.tracked, found.labels) == (None, ())
    assert found.figures["agents"] == 0


def test_names_of_a_catalogue_count_without_tracks() -> None:
    objects = [thing(0, 1, label="box"), thing(0, 2, label="box"), thing(0, 3), thing(0, 4, set="S", label="box")]
    assert summarise(run_of([sweep(0, 3)], objects)).labels == (Label("box", None, 2),)


def test_logs_with_and_without_tracks() -> None:
    first, second = run_of(**crossing()), run_of([sweep(k, log="b") for k in range(4)])
    third = run_of(**crossing("c"))
    runs = (second, first, third)
    assert first.tracks is not None
    assert third.tracks is not None
    run = Run(
        (Origin("b", "b"), Origin("a", "run", tracked=True), Origin("c", "c", tracked=True)),
        Rows.join([one.sweeps.table for one in runs]),
        Rows.join([one.objects.table for one in runs]),
        Rows.join([first.tracks.table, third.tracks.table], [1, 2]),
    )
    found = summarise(run)
    names = ("tracks", "tracks.agents", "agents", "objects", "agents_at_once.max")
    assert [found.figures[name] for name in names] == [6, 4, 42, 62, 2]
    assert found.figures["agents_at_once.mean"] == pytest.approx(1.3)
    assert np.isnan(run.agents_at_once[:4]).all()
    assert found.tracked is not None
    assert [(one.log, one.stream) for one in found.tracked.tracks] == [("run", 1)] * 3 + [("c", 2)] * 3
    assert found.tracked.agent_share == pytest.approx(0.062)


def test_topics_have_tracks_of_their_own() -> None:
    one, other = crossing(), crossing()
    for rows in other.values():
        for row in rows:
            row["topic"] = "/rear"
    run = run_of(**{name: one[name] + other[name] for name in one})
    assert run.agents_at_once.tolist() == ([1] * 5 + [2] * 3 + [1] * 2) * 2
    found = summarise(run)
    assert found.tracked is not None
    assert [each.topic for each in found.tracked.tracks] == ["/scan"] * 3 + ["/rear"] * 3
    for each in found.tracked.tracks:
        assert each.stream is not None
        assert found.streams.all[each.stream].topic == each.topic


def test_of_many_tracks_agents_and_the_longest_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(summary, "KEPT", 4)
    rows = [track(k, 0, k, set="A" if k == 3 else "O") for k in range(1, 10)]
    found = summarise(run_of([sweep(k) for k in range(10)], [], rows)).tracked
    assert found is not None
    assert [one.track for one in found.tracks] == [3, 7, 8, 9]
    assert [one.track for one in found.most(2)] == [3, 9]
    assert found.figures["tracks"] == 9


def test_the_sweeps_with_most_agents_stand_out() -> None:
    found = summarise(run_of(**crossing())).outliers
    assert [(one.sweep, one.words) for one in found if one.kind == "most_agents"] == [
        # Sweeps 6 and 7 are its like, without a break.
        (5, "2")
    ]
