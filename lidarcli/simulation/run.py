"""Simulation of a scene file: the log and its truth tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

from lidarcli.errors import OptionError
from lidarcli.files.newfiles import NewFiles, refuse, refuse_nameless, writing
from lidarcli.files.stores import Url, place
from lidarcli.options.choices import CONTAINER_BY_SUFFIX, MAP_RESOLUTION
from lidarcli.simulation.scene import MAX_SWEEPS, Scene, load_scene
from lidarcli.sweeps.types import RawSweeps

MAX_SECONDS = 400_000_000
"""Longest log [s]: the seconds of a ROS 2 stamp end in 2038."""
MAX_SEED = (1 << 63) - 1


@dataclass(frozen=True, slots=True)
class Simulated:
    """Files and size of a run."""

    scene: str
    sweeps: int
    log: Path
    truth: Path
    truth_beams: Path
    true_map: Path | None = None
    """The YAML file of the true map, which has its image beside it; None where none was wanted."""
    notes: tuple[str, ...] = ()


def simulate(
    scene_path: str | Path,
    out: str | PathLike[str],
    *,
    sweeps: int | None = None,
    duration: float | None = None,
    seed: int = 0,
    container: str | None = None,
    compression: str | None = None,
    encoding: str | None = None,
    layout: str | None = None,
    clouds: bool = False,
    chunk_size: int = 1 << 20,
    overwrite: bool = False,
    map: str | PathLike[str] | None = None,
    map_resolution: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Simulated:
    """Ray-cast the scene into the log `out`, with `<log>.truth.parquet` and `<log>.truth-beams.parquet` beside it.

    The number of sweeps comes from `sweeps`, else from `duration` [s], else from the scene. `map`, a .yaml in any
    folder, and a .pgm beside it get the true map of the run in cells of `map_resolution` [m]: see `true_map`. All files
    appear whole, under their own names, or not at all; files that exist are refused without `overwrite`. See `write_log`
    for the formats. `progress` is called with the number of sweeps that are done, and of all.
    """
    # The writers bring half a second of imports along, which `import lidarcli.simulation` need not pay.
    from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
    from lidarcli.simulation.truth import TruthWriter
    from lidarcli.simulation.writers import BAG_FOLDERS, check_options, container_of, write_log

    if sweeps is not None and duration is not None:
        raise OptionError("--sweeps and --duration exclude each other: leave one out")
    if sweeps is not None and not 0 <= sweeps <= MAX_SWEEPS:
        raise OptionError(f"--sweeps must be at least 0 and at most {MAX_SWEEPS:,}, not {sweeps}")
    if duration is not None and not 0 <= duration <= MAX_SECONDS:
        raise OptionError(f"--duration must be at least 0 and at most {MAX_SECONDS:,} seconds, not {duration:g}")
    if not 0 <= seed <= MAX_SEED:
        raise OptionError(f"--seed must be at least 0 and at most {MAX_SEED}, not {seed}")
    resolution = MAP_RESOLUTION if map_resolution is None else map_resolution
    if not 0.001 <= resolution <= 1000.0:
        raise OptionError(f"--map-resolution must be at least 0.001 and at most 1000 m, not {resolution:g}")
    if map is None and map_resolution is not None:
        raise OptionError("--map-resolution is that of --map: name its file, too")
    log = place(out)
    if isinstance(log, Url):
        raise OptionError(f"{log}: a simulated log is not written into a store; name a file of this machine")
    check_options(log, container, compression, encoding, layout, clouds)
    refuse_nameless(log)
    targets = (log, *truth_paths(log))
    map_files = () if map is None else (Path(map), Path(map).with_suffix(".pgm"))
    if map_files and map_files[0].suffix.lower() != ".yaml":
        raise OptionError(f"{map_files[0]}: the suffix of a true map has to be .yaml; it comes with a .pgm")
    scene = load_scene(scene_path)
    count = scene.sweeps if sweeps is None else sweeps
    if duration is not None:
        count = round(duration * scene.sensor.rate)
        if count > MAX_SWEEPS:
            raise OptionError(
                f"--duration {duration:g}: {count:,} sweeps at {scene.sensor.rate:g} per second are more than a log "
                f"may have ({MAX_SWEEPS:,})"
            )
    if count > MAX_SECONDS * scene.sensor.rate:
        raise OptionError(
            f"{scene_path}: {count:,} sweeps at {scene.sensor.rate:g} per second take longer than a log may "
            f"({MAX_SECONDS:,} seconds)"
        )
    result = Simulated(scene.name, count, *targets, true_map=map_files[0] if map_files else None)
    bag = log if (container or container_of(log)) in BAG_FOLDERS else None
    outputs = (*map_files, *targets)
    refuse(outputs, overwrite, [scene_path], bag)
    map_data = _map_data(scene, count, resolution, map_files[1].name) if map_files else ()
    with NewFiles(outputs, overwrite, bag) as new:
        for file, data in zip(map_files, map_data, strict=True):
            with writing(file):
                new.part(file).write_bytes(data)
        with writing(log), TruthWriter(new.part(result.truth), new.part(result.truth_beams), scene, seed) as truth:

            def raw() -> Iterator[RawSweeps]:
                for block in simulate_blocks(scene, count, seed):
                    truth.write(block)
                    yield block.raw
                    if progress is not None:
                        progress(block.first + len(block.seconds), count)

            write_log(
                new.part(log),
                raw(),
                container=container,
                compression=compression,
                encoding=encoding,
                layout=layout,
                clouds=clouds,
                chunk_size=chunk_size,
                poses=simulate_odometry(scene, count, seed),
            )
        return replace(result, notes=tuple(new.publish()))


def _map_data(scene: Scene, sweeps: int, resolution: float, image: str) -> tuple[bytes, bytes]:
    """Return the true map as YAML and PGM."""
    from lidarcli.maps.grids import pgm_bytes, yaml_bytes
    from lidarcli.simulation.truth import true_map

    grid = true_map(scene, sweeps, resolution)
    return yaml_bytes(grid, image), pgm_bytes(grid)


def truth_paths(log: Path) -> tuple[Path, Path]:
    """Return the paths of the truth tables of a log: beside it, with its stem."""
    name = log.name
    suffixes = (*(f"{suffix}.gz" for suffix in CONTAINER_BY_SUFFIX), *CONTAINER_BY_SUFFIX)
    stem = next((name[: -len(suffix)] for suffix in suffixes if name.lower().endswith(suffix)), name)
    return log.with_name(f"{stem}.truth.parquet"), log.with_name(f"{stem}.truth-beams.parquet")
