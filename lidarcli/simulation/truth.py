"""The truth of a simulated log: who was visible in each sweep, what every beam hit, and the true map of the run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import TracebackType

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from lidarcli._version import __version__
from lidarcli.errors import OptionError
from lidarcli.formalism.mapping.grid import HIT, SKIPPED, Beams, Counts, Occupancy, TooLargeError
from lidarcli.maps.grids import MAX_PIXELS
from lidarcli.simulation.generate import SimulatedBlock, relative, simulate_blocks
from lidarcli.simulation.scene import Scene
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Column, Float64, Status
from lidarcli.tabular.schemas import BEAM_OF_SENSOR, field_of

_Index = NDArray[np.intp]

_ROW_GROUP = 1 << 20


def _schema(*columns: Column) -> pa.Schema:
    """Return the schema of a truth table: of its columns the meaning comes first, and only what is measured has a unit."""

    def noted(one: Column) -> pa.Field:
        unit = {"unit": one.unit} if one.unit else {}
        return field_of(one).with_metadata({"description": one.meaning, **unit})

    return pa.schema([noted(one) for one in columns])


_SWEEP = Column("sweep", "int64", "", "index of the sweep, from 0")
TRUTH = _schema(
    _SWEEP,
    Column("stamp", "stamp", "", "header stamp of the sweep"),
    Column("entity", "int32", "", "index of the entity in the scene, from 0"),
    Column("kind", pa.dictionary(pa.int8(), pa.string()), "", "box, cylinder, ladder, plant, wall, ..."),
    Column("wall", "bool", "", "true for what is part of the building"),
    Column("beams", "int32", "", "beams of the sweep that hit it"),
    Column("theta_i", "float32", "rad", "bearing of the first of them, counter-clockwise; null for walls", nullable=True),
    Column("theta_f", "float32", "rad", "bearing of the last of them, above theta_i; null for walls", nullable=True),
    *(Column(axis, "float64", "m", "centre in the sensor frame") for axis in "xy"),
    Column("yaw", "float64", "rad", "orientation in the sensor frame"),
    Column("length", "float64", "m", "extent along its own x axis"),
    Column("width", "float64", "m", "extent along its own y axis"),
    *(Column(f"world_{axis}", "float64", "m", "centre in the world") for axis in "xy"),
    Column("world_yaw", "float64", "rad", "orientation in the world"),
    Column("vx", "float64", "m/s", "velocity of the centre over ground, world frame; of a person, of the body"),
    Column("vy", "float64", "m/s", "velocity of the centre over ground, world frame"),
    Column("yaw_rate", "float64", "rad/s", "how fast it turns, counter-clockwise"),
    Column("moving", "bool", "", "whether it moves by itself in this sweep: its centre goes somewhere or it turns"),
)
TRUTH_BEAMS = _schema(
    _SWEEP, BEAM_OF_SENSOR._replace(unit=""), Column("entity", "int32", "", "index of the entity it hit, -1 for none")
)


class TruthWriter:
    """Writes both truth tables, block by block."""

    def __init__(self, truth: Path, beams: Path, scene: Scene, seed: int) -> None:
        self.scene = scene
        metadata = {"lidarcli": __version__, "scene": scene.name, "seed": str(seed)}
        self.truth = pq.ParquetWriter(truth, TRUTH.with_metadata(metadata), compression="zstd")
        self.beams = pq.ParquetWriter(
            beams,
            TRUTH_BEAMS.with_metadata(metadata),
            compression="zstd",
            column_encoding=dict.fromkeys(TRUTH_BEAMS.names, "DELTA_BINARY_PACKED"),
            use_dictionary=False,
        )
        self.pending: list[pa.RecordBatch] = []

    def write(self, block: SimulatedBlock) -> None:
        """Append the truth of a block."""
        self.pending.append(truth_rows(block, self.scene))
        if sum(len(batch) for batch in self.pending) >= _ROW_GROUP:
            self._flush()
        self.beams.write_batch(beam_rows(block), row_group_size=_ROW_GROUP)

    def _flush(self) -> None:
        if self.pending:
            self.truth.write_table(pa.Table.from_batches(self.pending), row_group_size=_ROW_GROUP)
            self.pending = []

    def __enter__(self) -> TruthWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None:
            self._flush()
        self.truth.close()
        self.beams.close()


def truth_rows(block: SimulatedBlock, scene: Scene) -> pa.RecordBatch:
    """Make a row per sweep and visible entity."""
    entities = scene.entities
    sweeps, count = len(block.raw), len(entities)
    sweep, beam = np.nonzero(block.entity >= 0)
    cell = sweep * count + block.entity[sweep, beam]
    hits = np.bincount(cell, minlength=sweeps * count).astype(np.int32)
    visible = np.flatnonzero(hits)
    row, entity = np.divmod(visible, max(count, 1))

    world, velocity = np.empty((len(visible), 3)), np.zeros((len(visible), 3))
    for number in np.unique(entity):
        own = np.flatnonzero(entity == number)
        seconds = block.seconds[row[own]]
        world[own] = entities[number].poses(seconds)
        if not entities[number].motion.still:
            velocity[own] = entities[number].velocities(seconds)
    local = relative(world, block.poses[row])
    theta_i, theta_f = _extent(block, sweep, beam, cell, np.arctan2(local[:, 1], local[:, 0]), visible)

    kinds = [thing.kind for thing in entities]
    names = sorted(set(kinds))
    code = np.array([names.index(kind) for kind in kinds], np.int8)
    wall = np.array([thing.wall for thing in entities], bool)
    size = np.array([[thing.length, thing.width] for thing in entities]).reshape(-1, 2)
    columns = [
        block.first + row,
        block.raw.stamp_ns[row],
        entity.astype(np.int32),
        pa.DictionaryArray.from_arrays(code[entity], pa.array(names, pa.string())),
        wall[entity],
        hits[visible],
        pa.array(theta_i.astype(np.float32), mask=wall[entity]),
        pa.array(theta_f.astype(np.float32), mask=wall[entity]),
        local[:, 0],
        local[:, 1],
        _wrap(local[:, 2]),
        size[entity, 0],
        size[entity, 1],
        world[:, 0],
        world[:, 1],
        _wrap(world[:, 2]),
        *velocity.T,
        (velocity != 0).any(axis=1),
    ]
    arrays = [pa.array(values, field.type) for values, field in zip(columns, TRUTH, strict=True)]
    return pa.RecordBatch.from_arrays(arrays, schema=TRUTH)


def beam_rows(block: SimulatedBlock) -> pa.RecordBatch:
    """Make a row per beam."""
    sweep, beam = np.nonzero(np.arange(block.entity.shape[1]) < block.raw.beams[:, None])
    columns = [block.first + sweep, beam.astype(np.int32), block.entity[sweep, beam]]
    return pa.RecordBatch.from_arrays([pa.array(values) for values in columns], schema=TRUTH_BEAMS)


def _extent(
    block: SimulatedBlock, sweep: _Index, beam: _Index, cell: _Index, centre: Float64, visible: _Index
) -> tuple[Float64, Float64]:
    """Return first and last bearing of each visible entity, measured from its centre: no seam comes between."""
    bearing = block.raw.angle_min[sweep] + block.raw.angle_increment[sweep] * beam
    rank = np.searchsorted(visible, cell)
    offset = _wrap(bearing - centre[rank])
    low, high = np.full(len(visible), np.inf), np.full(len(visible), -np.inf)
    np.minimum.at(low, rank, offset)
    np.maximum.at(high, rank, offset)
    theta_i = _wrap(centre + low)
    return theta_i, theta_i + (high - low)


def _wrap(angle: Float64) -> Float64:
    """Return angles in [-π, π)."""
    wrapped: Float64 = np.mod(angle + np.pi, TURN) - np.pi
    return wrapped


MAX_CELLS = MAX_PIXELS
"""Largest map: what is written can be read again."""
MAX_BEAMS = (1 << 31) - 1
"""Most beams that are counted one by one: counts are int32."""


def true_map(scene: Scene, sweeps: int, resolution: float) -> Occupancy:
    """Return the map of `sweeps` sweeps of a scene without faults of the sensor and without moving or passing entities.

    Every sweep counts, and each beam starts where the laser is at the very time of this beam. A cell is occupied
    where any beam ends in it, free where beams only pass, else unknown; a beam without a return says nothing.

    The frame is the world of the scene. The odometry of a run begins at its true pose, so that without noise its frame is
    the same; with noise the two diverge, and `lidarcli diff` sees that, too.

    Parameters
    ----------
    resolution : side of a cell [m]

    Raises
    ------
    OptionError
        The map would have more than `MAX_CELLS` cells, there are more than `MAX_BEAMS` beams that take time, or
        nothing static is visible.
    """
    faultless = {"noise": 0.0, "noise_per_metre": 0.0, "resolution": 0.0, "lost": 0.0, "mixed_pixels": 0.0, "flicker": 0.0}
    sensor = replace(scene.sensor, lost_as="inf", beams_jitter=0, **faultless)  # type: ignore[arg-type]
    still = tuple(replace(entity, lost=0.0) for entity in scene.entities if entity.motion.still)
    scene = replace(scene, sensor=sensor, entities=still)
    different = min(sweeps, 1) if scene.still else sweeps
    if sensor.time_increment and different * sensor.beams > MAX_BEAMS:
        raise OptionError(
            f"--map: {different * sensor.beams:,} beams that take time are more than a true map counts ({MAX_BEAMS:,}); "
            "take fewer --sweeps"
        )
    counts = Counts(resolution, MAX_CELLS)
    # Sweeps that are held at once, about a quarter of a million beams.
    size = min(512, max(1, (1 << 18) // sensor.beams))
    for block in simulate_blocks(scene, different, size=size):
        try:
            counts.add(_placed(scene, block))
        except TooLargeError as err:
            raise OptionError(
                f"--map: the true map would reach over {err}, more than {MAX_CELLS:,} cells of {resolution:g} m; "
                "take a coarser --map-resolution"
            ) from err
    grid = counts.occupancy(1, 0.0, "map")
    if not grid.occupied:
        raise OptionError(
            f"--map: no beam of {sweeps:,} sweep{'' if sweeps == 1 else 's'} ends at anything that stands still, so there "
            "is no true map; leave --map out"
        )
    return grid


def _placed(scene: Scene, block: SimulatedBlock) -> Beams:
    """Return the beams of a block in the world, exactly; those that take time are a sweep each."""
    # Within a sweep the path of a sensor is straight and even for `Beams`, but not on a course that turns at once, where a
    # laser that is not mounted on the axis leaps. With one hit to make an occupied cell it makes no difference.
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
    theta = poses[..., 2] + sensor.bearings
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
