"""From a scene file to a log and its truth tables."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from lidarcli.errors import OptionError, OutputError
from lidarcli.newfiles import NewFiles, refuse, unwritable
from lidarcli.simulate.load import MAX_SWEEPS, load_scene
from lidarcli.sweeps import RawSweeps

MAX_SECONDS = 400_000_000
"""Longest log [s]: the seconds of a ROS 2 stamp end in 2038."""
MAX_SEED = (1 << 63) - 1
_SUFFIXES = (".csv.gz", ".mcap", ".bag", ".db3", ".csv")


@dataclass(frozen=True, slots=True)
class Simulated:
    """What a run has written."""

    scene: str
    sweeps: int
    log: Path
    truth: Path
    truth_beams: Path
    notes: tuple[str, ...] = ()
    """What a user should know of these files."""


def simulate(
    scene_path: str | Path,
    out: str | Path,
    *,
    sweeps: int | None = None,
    duration: float | None = None,
    seed: int = 0,
    container: str | None = None,
    compression: str | None = None,
    encoding: str | None = None,
    layout: str | None = None,
    chunk_size: int = 1 << 20,
    overwrite: bool = False,
) -> Simulated:
    """Ray-cast the scene into the log `out`, with `<log>.truth.parquet` and `<log>.truth-beams.parquet` beside it.

    The number of sweeps comes from `sweeps`, else from `duration` [s], else from the scene. All files appear whole, under
    their own names, or not at all; files that exist are refused without `overwrite`. See `write_log` for the formats.
    """
    # The writers bring half a second of imports along, which `import lidarcli.simulate` need not pay.
    from lidarcli.simulate.generate import simulate_blocks
    from lidarcli.simulate.odometry import simulate_odometry
    from lidarcli.simulate.truth import TruthWriter
    from lidarcli.simulate.writers import check_options, write_log

    if sweeps is not None and duration is not None:
        raise OptionError("--sweeps and --duration exclude each other: leave one out")
    if sweeps is not None and not 0 <= sweeps <= MAX_SWEEPS:
        raise OptionError(f"--sweeps must be at least 0 and at most {MAX_SWEEPS:,}, not {sweeps}")
    if duration is not None and not 0 <= duration <= MAX_SECONDS:
        raise OptionError(
            f"--duration must be at least 0 and at most {MAX_SECONDS:,} seconds, not {duration:g}"
        )
    if not 0 <= seed <= MAX_SEED:
        raise OptionError(f"--seed must be at least 0 and at most {MAX_SEED}, not {seed}")
    log = Path(out)
    check_options(log, container, compression, encoding, layout)
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
    result = Simulated(scene.name, count, log, *truth_paths(log))
    targets = [result.log, result.truth, result.truth_beams]
    refuse(targets, overwrite, [scene_path], folders=True)
    for target in targets:
        if target.is_dir() and not _is_bag(target):
            raise OutputError(
                f"{target}: is a folder that holds more than a ROS 2 bag; it will not be replaced"
            )
    with NewFiles(targets, overwrite, folders=True) as new:
        try:
            with TruthWriter(new.part(result.truth), new.part(result.truth_beams), scene, seed) as truth:

                def raw() -> Iterator[RawSweeps]:
                    for block in simulate_blocks(scene, count, seed):
                        truth.write(block)
                        yield block.raw

                write_log(
                    new.part(log),
                    raw(),
                    container=container,
                    compression=compression,
                    encoding=encoding,
                    layout=layout,
                    chunk_size=chunk_size,
                    poses=simulate_odometry(scene, count, seed),
                )
        except OSError as err:
            raise unwritable(log, err) from err
        return replace(result, notes=tuple(new.publish()))


def truth_paths(log: Path) -> tuple[Path, Path]:
    """Where the truth of a log stands: beside it, under its stem."""
    name = log.name
    stem = next((name[: -len(suffix)] for suffix in _SUFFIXES if name.lower().endswith(suffix)), name)
    return log.with_name(f"{stem}.truth.parquet"), log.with_name(f"{stem}.truth-beams.parquet")


def _is_bag(folder: Path) -> bool:
    """True for an empty folder and for one that holds one ROS 2 bag alone: several logs are somebody's recordings."""
    names = [entry.name for entry in folder.iterdir()]
    storage = [name for name in names if name.endswith((".db3", ".mcap", ".zstd"))]
    return not names or ("metadata.yaml" in names and len(storage) == len(names) - 1)
