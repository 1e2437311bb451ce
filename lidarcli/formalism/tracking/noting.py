"""What a user should know of a topic that was tracked, a line each."""

from __future__ import annotations

import math

from lidarcli.formalism.tracking.correction import Correction
from lidarcli.formalism.tracking.things import Track

FAR_ENOUGH = 1.0
"""[m] A sensor that has gone less far tells little of its poses."""
SURE = 3.0
"""An estimate that is not zero is so many standard deviations from it."""
WORTH_TELLING, WORTH_TELLING_M = 0.02, 0.05
"""[s], [m] Smaller delays and distances change nothing that is seen."""
LONG = 20
"""Sweeps of a track that tells whether all things move."""
MOST = 0.6
"""Where a larger share of such tracks are agents it is the sensor that moves."""
SEVERAL = 4
"""Fewer tracks tell nothing."""


def notes_of(
    topic: str, correction: Correction, tracks: list[Track], has_poses: bool, is_corrected: bool
) -> list[str]:
    """What the poses of a topic are off by, or that it should have some.

    `is_corrected`: whether a delay was found beforehand, beyond which this one is.
    """
    of_poses = _of_poses(topic, correction, is_corrected) if has_poses else []
    return of_poses + _of_motion(topic, tracks, has_poses)


def _of_poses(topic: str, correction: Correction, is_corrected: bool) -> list[str]:
    if correction.way < FAR_ENOUGH:
        return []
    delay, ahead, left, delay_sd, place_sd = correction.estimate()
    lines = []
    if abs(delay) > max(WORTH_TELLING, SURE * delay_sd):
        when = "late" if delay > 0 else "early"
        also = "" if is_corrected else f"; --pose-delay {delay:.2f} also corrects the world columns"
        more = " a further" if is_corrected else ""
        lines.append(
            f"{topic}: static objects show the poses{more} {abs(delay):.2f} s {when}: corrected for tracks{also}"
        )
    if math.hypot(ahead, left) > max(WORTH_TELLING_M, SURE * place_sd):
        lines.append(
            f"{topic}: static objects show the sensor {_place(ahead, left)} of where its poses are told: "
            "corrected for tracks"
        )
    return lines


def _place(ahead: float, left: float) -> str:
    """Where the sensor is, in words."""
    words = []
    if abs(ahead) >= 0.01:
        words.append(f"{abs(ahead):.2f} m {'ahead' if ahead > 0 else 'behind'}")
    if abs(left) >= 0.01:
        words.append(f"{abs(left):.2f} m to the {'left' if left > 0 else 'right'}")
    return " and ".join(words)


def _of_motion(topic: str, tracks: list[Track], has_poses: bool) -> list[str]:
    long = [track for track in tracks if track.sweeps >= LONG]
    moved = sum(track.moved for track in long)
    if len(long) < SEVERAL or moved <= MOST * len(long):
        return []
    why = (
        "the poses may be wrong, or sweeps take long (--pose TOPIC|none, docs/poses.md)"
        if has_poses
        else "without poses the sensor is taken as standing; if it drives, tracks need a log with its poses (tf, odometry)"
    )
    return [f"{topic}: {moved} of {len(long)} things seem to move: {why}"]
