"""Tracks: sorted, without repetition, in bounded memory, with everything that is left out counted."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.logs.base import Message
from lidarcli.pose import messages, tracks
from lidarcli.pose.tracks import HOLD_NS, PoseTrack, PoseTracks, planar
from tests.pose.pose_messages import POSE, SECOND, TF, message, odometry, pose_stamped, tf


def gathered(received: list[Message]) -> list[PoseTrack]:
    found = PoseTracks()
    found.add(received)
    return found.finish()


def test_one_track_per_topic_and_pair_of_frames() -> None:
    found = gathered(
        [
            tf(0, "odom", "base_link", (0, 0, 0)),
            tf(0, "base_link", "wheel", (0, 0, 0)),
            odometry(0, "odom", "base_link", (0, 0, 0)),
            tf(5, "/odom", "/base_link", (1, 0, 0)),
            tf(0, "base_link", "laser", (1, 0, 0), "/tf_static"),
            pose_stamped(0, "map", (0, 0, 0)),
        ]
    )
    assert [(t.topic, t.parent, t.child, t.static, t.messages, t.is_link) for t in found] == [
        ("/tf", "odom", "base_link", False, 2, True),
        ("/tf", "base_link", "wheel", False, 1, True),
        ("/odom", "odom", "base_link", False, 1, False),
        ("/tf_static", "base_link", "laser", True, 1, True),
        ("/pose", "map", "", False, 1, False),
    ]


def test_any_order_gives_the_same_track(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracks, "TOGETHER", 7)
    order = np.random.default_rng(1).permutation(50).tolist()
    (track,) = gathered([pose_stamped(1000 + k, "map", (k, -k, 0.1)) for k in order])
    np.testing.assert_array_equal(track.stamp_ns, 1000 + np.arange(50))
    np.testing.assert_array_equal(track.motion.position[:, 0], np.arange(50))
    assert track.span_ns == (1000, 1049)
    assert track.record_ns == (1000, 1049)


@pytest.mark.parametrize("together", [2, 3, 1000])
def test_of_a_run_of_equal_poses_the_ends_are_kept(together: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracks, "TOGETHER", together)
    places = [0] * 20 + [1, 2] + [2] * 20
    (track,) = gathered([pose_stamped(k, "map", (x, 0, 0)) for k, x in enumerate(places)])
    assert track.messages == 42
    assert track.span_ns == (0, 41)
    np.testing.assert_allclose(planar(track.at(np.arange(42))).x, places)
    if together == 1000:
        assert track.stamp_ns.tolist() == [0, 19, 20, 21, 41]


def test_a_static_link_holds_for_ever_and_as_last_told() -> None:
    (track,) = gathered([tf(9, "base", "laser", (x, 0, 0), "/tf_static") for x in (1, 2)])
    assert planar(track.at(np.array([-5, 10**18]))).x.tolist() == [2, 2]


def test_rate_and_jumps_back() -> None:
    stamps = [k * SECOND // 50 for k in range(101)]
    (track,) = gathered([pose_stamped(stamp, "map", (stamp, 0, 0)) for stamp in stamps])
    assert track.rate == pytest.approx(50)
    assert track.jumps_back == 0
    again = [pose_stamped(stamp + 1, "map", (stamp, 0, 0)) for stamp in (*stamps, *stamps[:10])]
    # The log begins again once, however many poses come after that.
    assert gathered(again)[0].jumps_back == 1
    assert gathered(again[:1])[0].rate is None
    # Two steps of 20 ms; of slow poses a tenth of a second, of a single one nothing.
    assert track.hold_ns == 40_000_000
    assert gathered([pose_stamped(k * SECOND, "map", (k, 0, 0)) for k in range(3)])[0].hold_ns == HOLD_NS
    assert gathered(again[:1])[0].hold_ns == 0


def test_unusable_poses_are_counted() -> None:
    found = PoseTracks()
    found.add(
        [
            pose_stamped(1, "map", (float("nan"), 0, 0)),
            pose_stamped(2, "map", (0, 0, 0, 0, 0, 0, 0)),
            pose_stamped(3, "map", (1, 0, 0)),
            message("/pose", POSE, b"\0\1\0\0"),
            message("/tf", TF, b"{}", encoding="json"),
        ]
    )
    (track,) = found.finish()
    assert track.stamp_ns.tolist() == [3]
    assert found.refused == {
        ("/pose", tracks.NOT_FINITE): 1,
        ("/pose", tracks.NO_TURN): 1,
        ("/pose", "shorter than its type"): 1,
        ("/tf", messages.ENCODING): 1,
    }


def test_no_more_poses_than_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracks, "TOGETHER", 10)
    found = PoseTracks(most=25)
    found.add(pose_stamped(k, "map", (k, 0, 0)) for k in range(100))
    (track,) = found.finish()
    assert (len(track.stamp_ns), track.span_ns, found.left_out) == (25, (0, 24), 75)
