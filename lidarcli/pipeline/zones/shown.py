"""Zones in front of the sensors of a log, for viewers and pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lidarcli.errors import NoScanError
from lidarcli.formalism.detection import SETS
from lidarcli.formalism.zones import candidates
from lidarcli.pipeline.zones.frames import Frames
from lidarcli.sweeps.types import Bool, Float64, SweepBatch, SweepPoses, UInt8, record
from lidarcli.sweeps.zone import WORLD, Line, Zone, Zones, placed

COUNTED = {"things": ("O", "A"), "agents": ("A",)}
"""Kind of beams that count in a zone → their sets."""


@record
class ShownZone:
    """A zone in S sweeps."""

    zone: Zone
    corners: Float64
    """(S, K, 2) its outline in the frame of the sensor [m]; NaN where its place is not known."""
    beams: Bool
    """(S, B) beams that count in it."""

    @property
    def occupied(self) -> Bool:
        """(S,) True where as many beams count as it takes."""
        found: Bool = np.count_nonzero(self.beams, axis=1) >= self.zone.min_points
        return found


class Showing:
    """Places zones before the sensors of a log; what cannot be shown is a note."""

    def __init__(self, zones: Zones, frames: Frames) -> None:
        self._zones = zones
        self._frames = frames
        self._notes: dict[str, None] = {}

    @property
    def is_in_world(self) -> bool:
        """True if a zone needs poses."""
        return any(zone.frame == WORLD for zone in self._zones.zones)

    def of(self, batch: SweepBatch, sets: UInt8 | None) -> Iterator[ShownZone]:
        """Yield the zones that can be placed in sweeps of one frame.

        Parameters
        ----------
        sets : (S, B) index into `SETS` of each beam; None where nobody knows
        """
        sensor = batch.frame_ids[int(batch.frame[0])]
        frames = self._frames.of_topic(batch.topic)
        masks = frames.masks_for(self._zones.masks, batch)
        ranges = batch.ranges
        if masks.masks:
            ranges = np.where(masks.under(batch, ranges), np.float32(np.nan), ranges)
        for zone in self._zones.zones:
            shape = zone.shape
            place = self._place(zone, batch, sensor, frames)
            if shape is None or place is None:
                continue
            beams = np.zeros(ranges.shape, np.bool_)
            if self._counts(zone, batch.topic, sets) and not isinstance(shape, Line):
                found = candidates(batch, ranges, place, shape)
                beams[found.row, found.beam] = True
                if zone.count in COUNTED and sets is not None:
                    beams &= np.isin(sets, [SETS.index(name) for name in COUNTED[zone.count]])
            yield ShownZone(zone, placed(shape, place), beams)

    def notes(self) -> list[str]:
        """Return a line for each zone that is not shown, or not as occupied."""
        return [*self._zones.notes, *self._notes, *self._frames.notes()]

    def _place(self, zone: Zone, batch: SweepBatch, sensor: str, frames: Frames) -> SweepPoses | None:
        if zone.shape is None:
            why = f"{zone.shape_topic} tells its shape" if zone.shape_topic else "its shape depends on the velocity"
        elif zone.frame != WORLD:
            try:
                return frames.sensor_in(zone.frame, sensor, batch.stamp_ns)
            except NoScanError as err:
                why = str(err)
        elif batch.poses is not None:
            return batch.poses
        else:
            why = "nothing tells where the sensor is in the world"
        self._notes[f"zone {zone.name} is not drawn: {why}"] = None
        return None

    def _counts(self, zone: Zone, topic: str, sets: UInt8 | None) -> bool:
        """Return whether it is known which beams of a topic count in a zone."""
        if not zone.is_for(topic):
            return False
        if zone.count in COUNTED and sets is None:
            self._notes[f"zone {zone.name} counts {zone.count}, and nobody knows which beams are on them"] = None
            return False
        return True
