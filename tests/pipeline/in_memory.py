"""What the logs in memory hold of which the pipeline makes tables."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lidarcli.logs.base import LASERSCAN, Topic
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.sweeps.types import RawSweeps
from tests.fake_log import FakeLog
from tests.sweeping import BOX, START, STEP, raw_sweeps, round_room


def block(topic: str = "/scan", sweeps: int = 4, first: int = 0, beams: int = 360) -> RawSweeps:
    """Sweeps of the round room with one box in it."""
    stamps = START + STEP * np.arange(first, first + sweeps)
    return raw_sweeps(round_room(sweeps, beams, BOX), topic=topic, stamp_ns=stamps, record_ns=stamps + STEP // 2)


Opens = Callable[..., FakeLog]
SOURCE = Source("run.fake", "run")
SCAN = Topic("/scan", LASERSCAN, "cdr", 4)
CLOUD = Topic("/cloud", "sensor_msgs/msg/PointCloud2", "cdr", 7)
