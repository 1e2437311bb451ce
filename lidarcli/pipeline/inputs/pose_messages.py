"""The pose messages of a log, read once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lidarcli.logs.base import POSE_TYPES, Log, ReadReport

if TYPE_CHECKING:
    from lidarcli.poses.tracks import Track


@dataclass(frozen=True, slots=True)
class PoseMessages:
    """What a log tells of poses."""

    tracks: tuple[Track, ...]
    notes: tuple[str, ...]
    """Which of them say nothing, and why."""
    report: ReadReport
    """What the pass over them has met."""


def read_pose_messages(log: Log) -> PoseMessages:
    """All poses of a log that can be read twice, in one pass."""
    # Most logs have no poses and need not wait for the import.
    from lidarcli.poses.tracks import Tracks

    tracks = Tracks()
    report = ReadReport()
    tracks.add(log.messages(POSE_TYPES, report))
    found = tracks.finish()
    notes = [
        f"{count:,} of {topic} left out: {cause}" for (topic, cause), count in sorted(tracks.refused.items())
    ]
    if tracks.left_out:
        notes.append(f"{tracks.left_out:,} poses left out: too many to keep")
    return PoseMessages(tuple(found), tuple(notes), report)
