"""The true map of a run: what a perfect sensor on the same way sees of everything that stands still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.formalism.mapping.counts import Beams, Counts, TooLargeError
from lidarcli.formalism.mapping.occupancy import HIT, SKIPPED, Occupancy
from lidarcli.maps.mapserver import MOST_PIXELS
from lidarcli.range_rules import RangeRules, normalise
from lidarcli.simulate.generate import SimulatedBlock, simulate_blocks
from lidarcli.simulate.scene import Scene
from lidarcli.sweeps import Status

MOST_CELLS = MOST_PIXELS
"""Largest map: what is written can be read again."""
MOST_BEAMS = (1 << 31) - 1
"""Most beams that are counted one by one: counts are int32."""
_BLOCK, _BLOCK_BEAMS = 512, 1 << 18
"""Most sweeps, and about as many beams, that are held at once."""


def true_map(scene: Scene, sweeps: int, resolution: float) -> Occupancy:
    """The map of `sweeps` sweeps of a scene, without any fault of the sensor and without what moves, appears or disappears.

    Every sweep counts, and each beam is seen from where the laser is at the very time of this beam. A cell is occupied
    where any beam ends in it, free where beams only pass, else unknown; a beam without a return says nothing.

    The frame is the world of the scene. The odometry of a run begins at its true pose, so that without noise its frame is
    the same; with noise the two part on the way, and `lidarcli map --compare` sees that, too.

    Parameters
    ----------
    resolution : side of a cell [m]

    Raises
    ------
    OptionError
        The ground that is seen has more than `MOST_CELLS` cells, there are more than `MOST_BEAMS` beams that take time, or
        nothing that stands still is seen.
    """
    scene = _undisturbed(scene)
    sensor = scene.sensor
    different = min(sweeps, 1) if scene.still else sweeps
    if sensor.time_increment and different * sensor.beams > MOST_BEAMS:
        raise OptionError(
            f"--map: {different * sensor.beams:,} beams that take time are more than a true map counts ({MOST_BEAMS:,}); "
            "take fewer --sweeps"
        )
    counts = Counts(resolution, MOST_CELLS)
    size = min(_BLOCK, max(1, _BLOCK_BEAMS // sensor.beams))
    for block in simulate_blocks(scene, different, size=size):
        try:
            counts.add(_placed(scene, block))
        except TooLargeError as err:
            raise OptionError(
                f"--map: the true map would reach over {err}, more than {MOST_CELLS:,} cells of {resolution:g} m; "
                "take a coarser --map-resolution"
            ) from err
    grid = counts.occupancy(1, 0.0, "map")
    if not grid.occupied:
        raise OptionError(
            f"--map: no beam of {sweeps:,} sweep{'' if sweeps == 1 else 's'} ends at anything that stands still, so there "
            "is no true map; leave --map out"
        )
    return grid


def _undisturbed(scene: Scene) -> Scene:
    """The scene without the faults of its sensor, of what stands still alone."""
    sensor = replace(
        scene.sensor,
        noise=0.0,
        noise_per_metre=0.0,
        resolution=0.0,
        lost=0.0,
        lost_as="inf",
        beams_jitter=0,
        mixed_pixels=0.0,
        flicker=0.0,
    )
    still = tuple(replace(entity, lost=0.0) for entity in scene.entities if entity.motion.still)
    return replace(scene, sensor=sensor, entities=still)


def _placed(scene: Scene, block: SimulatedBlock) -> Beams:
    """The beams of a block in the world, exactly.

    Beams that take time are a sweep each: within a sweep the way of a sensor is straight and even for `Beams`, but not on
    a course that turns at once, where a laser that is not mounted on the axis leaps. With one hit to make an occupied cell
    it makes no difference how many sweeps the beams are.
    """
    sensor = scene.sensor
    sweeps, beams = block.raw.ranges.shape
    batch = normalise(block.raw, block.first + np.arange(sweeps), RangeRules())
    use = np.where(batch.status == Status.VALID, HIT, SKIPPED).astype(np.uint8)
    # Ranges were rounded to float32. One step more, and no beam ends short of what it hit: a wall on the border of two
    # cells is in the cell behind the border, and not here and there as rounding has it.
    ranges = np.nextafter(batch.ranges, np.float32(np.inf)).astype(np.float64)
    poses = block.poses[:, None]
    if sensor.time_increment:
        times = block.seconds[:, None] + sensor.time_increment * np.arange(beams)
        poses = scene.sensor_poses(times.ravel()).reshape(sweeps, beams, 3)
    theta = poses[..., 2] + sensor.bearings()
    end = np.stack([poses[..., 0] + ranges * np.cos(theta), poses[..., 1] + ranges * np.sin(theta)])
    where = np.column_stack([poses.reshape(-1, 3), np.ones(poses.size // 3)])
    rows = len(where)
    width = sweeps * beams // rows
    return Beams(
        end=end.reshape(2, rows, width),
        use=use.reshape(rows, width),
        beams=np.full(rows, width, np.int32),
        poses=where,
        way=np.zeros((rows, 3)),
    )
