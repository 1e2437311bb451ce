"""One log in any supported container: the path's suffix says which, unless told otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from lidarcli.choices import CONTAINER_BY_SUFFIX, CONTAINERS, TEXT_CONTAINERS
from lidarcli.errors import OptionError, OutputError
from lidarcli.ros.messages import BAG_COMPRESSIONS
from lidarcli.simulate.aria_writer import write_aria
from lidarcli.simulate.bag_writers import (
    FOLDER_COMPRESSIONS,
    write_bag,
    write_db3,
    write_folder,
)
from lidarcli.simulate.carmen_writer import write_carmen
from lidarcli.simulate.jsonlines_writer import write_jsonlines
from lidarcli.simulate.mcap_writer import COMPRESSIONS, ENCODINGS, write_mcap
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.simulate.player_writer import write_player
from lidarcli.simulate.rplidar_writer import write_rplidar
from lidarcli.sweeps import RawSweeps

_WITH_POSES = {"carmen": write_carmen, "aria": write_aria, "player": write_player}
_WITHOUT_POSES = {"rplidar": write_rplidar, "jsonl": write_jsonlines}
"""Containers of text that has one way to be written → what writes them; some have a place for poses."""


def container_of(path: Path) -> str:
    """The container that a path's suffix asks for; a name without a suffix is a ROS 2 bag folder."""
    name = path.name.lower()
    for suffix, container in CONTAINER_BY_SUFFIX.items():
        if name.endswith(suffix) or (container in TEXT_CONTAINERS and name.endswith(f"{suffix}.gz")):
            return container
    if not path.suffix:
        return "ros2"
    raise OptionError(
        f"{path}: no log format has the suffix '{path.suffix}'; use {', '.join(CONTAINER_BY_SUFFIX)} "
        "(text also with .gz), or no suffix for a ROS 2 bag folder"
    )


def write_log(
    path: str | Path,
    blocks: Iterable[RawSweeps],
    *,
    container: str | None = None,
    compression: str | None = None,
    encoding: str | None = None,
    layout: str | None = None,
    chunk_size: int = 1 << 20,
    poses: SimulatedPoses | None = None,
    clouds: bool = False,
) -> None:
    """Write sweeps into a new log; the same sweeps and options give the same bytes.

    `compression`: none, lz4, zstd for MCAP; none, bz2, lz4 for ROS 1 bags; none, zstd (the file), zstd-message for ROS 2
    folders. `encoding` (MCAP): cdr, cdr-idl, ros1, json, protobuf. `layout`: of a CSV. `poses` go where they fit: CSV,
    RPLIDAR text and JSON lines have no place for them. `clouds`: point clouds instead of LaserScan, in logs of messages.
    Raises OptionError for options that do not fit the container, OutputError for a path that exists.
    """
    target = Path(path)
    kind = container or container_of(target)
    write = _writer(str(path), kind, compression, encoding, layout, chunk_size, poses, clouds)
    if target.exists() or target.is_symlink():
        raise OutputError(f"{path}: exists already")
    write(target, blocks)


def check_options(
    path: Path,
    container: str | None,
    compression: str | None,
    encoding: str | None,
    layout: str | None,
    clouds: bool = False,
) -> None:
    """Raise OptionError where `write_log` would, before any work is done."""
    _writer(str(path), container or container_of(path), compression, encoding, layout, 1, None, clouds)


def _writer(
    path: str,
    container: str,
    compression: str | None,
    encoding: str | None,
    layout: str | None,
    chunk_size: int,
    poses: SimulatedPoses | None,
    clouds: bool,
) -> Callable[[Path, Iterable[RawSweeps]], None]:
    """Check the options against the container and bind them to its writer."""

    def one_of(option: str, value: str | None, choices: Sequence[str], default: str) -> str:
        if value is None:
            return default
        if not choices:
            raise OptionError(f"{path}: {option} '{value}' does not apply to the container '{container}'")
        if value not in choices:
            raise OptionError(f"{path}: {option} '{value}' is not one of {', '.join(choices)} ({container})")
        return value

    encodings = tuple(ENCODINGS) if container == "mcap" else ()
    encode = one_of("encoding", encoding, encodings, "cdr")
    if container != "csv":
        one_of("layout", layout, (), "")
    if clouds and container in TEXT_CONTAINERS:
        raise OptionError(f"{path}: clouds do not apply to the container '{container}'")
    if container == "mcap":
        packed = one_of("compression", compression, tuple(COMPRESSIONS), "zstd")
        return lambda target, blocks: write_mcap(
            target,
            blocks,
            encoding=encode,
            compression=packed,
            chunk_size=chunk_size,
            poses=poses,
            clouds=clouds,
        )
    if container == "bag":
        packed = one_of("compression", compression, tuple(BAG_COMPRESSIONS), "none")
        return lambda target, blocks: write_bag(
            target, blocks, compression=packed, poses=poses, clouds=clouds
        )
    if container in ("ros2", "ros2-mcap"):
        packed = one_of("compression", compression, tuple(FOLDER_COMPRESSIONS), "none")
        storage = "mcap" if container == "ros2-mcap" else "sqlite3"
        return lambda target, blocks: write_folder(
            target, blocks, storage=storage, compression=packed, poses=poses, clouds=clouds
        )
    if container == "db3":
        one_of("compression", compression, ("none",), "none")
        return lambda target, blocks: write_db3(target, blocks, poses=poses, clouds=clouds)
    if container == "csv":
        from lidarcli.simulate.csv_writer import LAYOUTS, write_csv

        one_of("compression", compression, ("none",), "none")
        arranged = one_of("layout", layout, tuple(LAYOUTS), next(iter(LAYOUTS)))
        return lambda target, blocks: write_csv(target, blocks, arranged)
    if container in TEXT_CONTAINERS:
        one_of("compression", compression, ("none",), "none")
        if container in _WITH_POSES:
            return lambda target, blocks: _WITH_POSES[container](target, blocks, poses)
        return _WITHOUT_POSES[container]
    raise OptionError(f"{path}: container '{container}' is not one of {', '.join(CONTAINERS)}")
