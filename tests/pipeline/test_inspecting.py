"""What `info` finds in a log."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.logs.base import Topic
from lidarcli.pipeline import inspecting
from lidarcli.pipeline.inspecting import inspect_log
from tests.pipeline.in_memory import CLOUD, SCAN, SOURCE, Opens, block


def test_inspection(opened: Opens) -> None:
    wide = replace(block(sweeps=2, first=4, beams=361), angle_increment=np.full(2, 2 * np.pi / 360))
    odom = Topic("/odom", "nav_msgs/msg/Odometry", "cdr", 9)
    log = opened(block(), wide, topics=[replace(SCAN, messages=None), odom])
    log.met.refused["/scan", "NaN geometry"] = 2
    info = inspect_log(SOURCE)
    assert info.exit_code == 3
    assert info.damage == ("topic /scan: 2 messages left out: NaN geometry",)
    assert info.topics == (odom, replace(SCAN, messages=6))
    assert info.pose_topics == ("/odom",)
    assert info.dropped == (("/scan", "NaN geometry", 2),)
    (scan,) = info.scans
    assert (scan.topic, scan.frame_id, scan.sweeps) == ("/scan", "laser", 6)
    assert (scan.beams.low, scan.beams.high) == (360, 361)
    assert (scan.view.low, scan.view.high) == pytest.approx((2 * np.pi, 2 * np.pi))
    assert scan.closure == ("closed", "shared")
    assert scan.by_status == {"valid": 4 * 360 + 2 * 361, "no_return": 0, "too_close": 0, "invalid": 0, "masked": 0}
    assert scan.clock.rate == pytest.approx(10)
    assert scan.clock.span == pytest.approx(0.5)
    assert scan.clock.offset == pytest.approx(0.05)
    assert scan.clock.monotonic


def test_two_publishers_on_one_topic_stay_apart(opened: Opens) -> None:
    one = block(sweeps=6)
    mixed = replace(one, frame_ids=("left", "right"), frame=np.arange(6, dtype=np.int32) % 2)
    opened(mixed, topics=[SCAN])
    scans = inspect_log(SOURCE).scans
    assert [(scan.frame_id, scan.sweeps, scan.clock.rate) for scan in scans] == [
        ("left", 3, pytest.approx(5)),
        ("right", 3, pytest.approx(5)),
    ]


def test_a_new_frame_in_every_sweep_is_no_way_to_fill_the_memory(opened: Opens, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inspecting, "MOST", 3)
    one = block(sweeps=6)
    names = tuple(f"laser{k}" for k in range(6))
    mixed = replace(one, frame_ids=names, frame=np.arange(6, dtype=np.int32))
    opened(mixed, mixed, topics=[replace(SCAN, messages=None)])
    info = inspect_log(SOURCE)
    assert [(scan.frame_id, scan.sweeps) for scan in info.scans] == [(name, 2) for name in names[:3]]
    assert info.notes == ("6 sweeps are counted and no more: there are over 3 frames and topics",)
    assert info.topics == (replace(SCAN, messages=12),)


@pytest.mark.parametrize(("damage", "code"), [(None, 4), ("cut off", 3)])
def test_inspection_without_scans(opened: Opens, damage: str | None, code: int) -> None:
    opened(topics=[CLOUD], damage=damage)
    info = inspect_log(SOURCE)
    assert (info.exit_code, info.scans, info.topics) == (code, (), (CLOUD,))
