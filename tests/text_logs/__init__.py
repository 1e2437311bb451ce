"""Sweeps as text logs, which the package only reads: CARMEN, RPLIDAR, JSON lines, and every CSV layout."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.simulation import writers
from lidarcli.simulation.generate import SimulatedPoses, simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import load_scene
from lidarcli.simulation.writers import (
    GEOMETRY,
    frame_of,
    geometry_texts,
    intensity_texts,
    only_topic,
    seconds,
    shortest,
    sweep_texts,
    texts,
    write_lines,
)
from lidarcli.sweeps.types import Float64, Int64, RawSweeps
from tests.text_logs.foxglove import ENCODINGS, number_or_word, write_foxglove

_S = 1_000_000_000


def finite(block: RawSweeps) -> RawSweeps:
    """Return the block with infinity replaced by the greatest range."""
    return replace(block, ranges=np.where(np.isposinf(block.ranges), block.range_max[:, None], block.ranges))


_CARMEN_HEADER = (
    "# CARMEN Logfile",
    "# file format is one message per line",
    "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
    "# message formats defined: PARAM ODOM FLASER RAWLASER1 ROBOTLASER1",
)
_HOST = "simulator"
_SIMULATED = 3
"""The type of a laser that is simulated."""


def stamp_parts(block: RawSweeps, row: int) -> list[str]:
    """Seconds and nanoseconds of the stamp of a sweep."""
    return [str(part) for part in divmod(int(block.stamp_ns[row]), 10**9)]


def write_carmen(path: Path, blocks: Iterable[RawSweeps], poses: SimulatedPoses | None = None) -> None:
    """Write sweeps of one topic and the odometry of a robot to `path`, packed where it ends in `.gz`.

    With poses sweeps are FLASER lines, whose geometry is told by PARAM lines, or ROBOTLASER1 where their view is not
    centred; without any RAWLASER1. With intensities they are REMISSIONFLASER in the place of FLASER. The format has no
    place for `range_min` and the names of frames and topics; what is infinite is written as the greatest range. Decimals
    are as many as read back the same.
    """
    write_lines(path, _carmen(blocks, poses))


def _carmen(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None) -> Iterator[str]:
    yield from _CARMEN_HEADER
    begin, told, pose = None, None, 0
    for block in only_topic(blocks, "a CARMEN log"):
        placed = None if poses is None else _placed(poses, block.stamp_ns)
        for row, ranges in enumerate(texts(finite(block))):
            stamp = int(block.stamp_ns[row])
            if begin is None:
                begin = stamp
                if poses is not None:
                    yield from _parameters(_mount(poses), stamp, begin)
            remissions = intensity_texts(block, row)
            lists = f"{_counted(ranges)} {_counted(remissions)}"
            if poses is None or placed is None:
                yield f"RAWLASER1 {_carmen_head(block, row)} {lists} {_tail(stamp, begin)}"
                continue
            while pose < len(poses) and poses.stamp_ns[pose] <= block.record_ns[row]:
                yield _odom(poses, pose, begin)
                pose += 1
            both = " ".join(map(repr, placed[row].tolist()))
            if (view := _carmen_view(block, row)) is None:
                motion = "0.0 0.0 0.0 0.0 0.0"
                yield f"ROBOTLASER1 {_carmen_head(block, row)} {lists} {both} {motion} {_tail(stamp, begin)}"
                continue
            if view != told:
                yield from _parameters(view, stamp, begin)
                told = view
            if remissions:
                pairs = " ".join(f"{far} {strong}" for far, strong in zip(ranges, remissions, strict=True))
                yield f"REMISSIONFLASER {len(ranges)} {pairs} {both} {_tail(stamp, begin)}"
                continue
            yield f"FLASER {_counted(ranges)} {both} {_tail(stamp, begin)}"


def _counted(ranges: list[str]) -> str:
    return " ".join([str(len(ranges)), *ranges])


def _tail(stamp: int, begin: int) -> str:
    return f"{seconds(stamp)} {_HOST} {seconds(stamp - begin)}"


def _carmen_head(block: RawSweeps, row: int) -> str:
    """Return the geometry of a sweep, as RAWLASER and ROBOTLASER have it in their lines."""
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    view = (int(block.beams[row]) - 1) * step
    most = shortest(block.range_max[row : row + 1])[0]
    return f"{_SIMULATED} {first!r} {view!r} {step!r} {most} 0.01 0"


def _carmen_view(block: RawSweeps, row: int) -> dict[str, float] | None:
    """Return the geometry of a sweep as parameters; None unless the view begins at minus its half."""
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    view, gaps = -2.0 * first, int(block.beams[row]) - 1
    if not (step > 0 and abs(view / step - gaps - 0.5) < 0.75):
        return None
    return {
        "laser_front_laser_fov": float(np.degrees(view)),
        "laser_front_laser_resolution": float(np.degrees(step)),
        "robot_front_laser_max": float(shortest(block.range_max[row : row + 1])[0]),
    }


def _mount(poses: SimulatedPoses) -> dict[str, float]:
    """Return the mount of the laser as parameters."""
    names = ("robot_frontlaser_offset", "robot_frontlaser_side_offset", "robot_frontlaser_angular_offset")
    return dict(zip(names, map(float, poses.mount), strict=True))


def _parameters(values: dict[str, float], stamp: int, begin: int) -> Iterator[str]:
    for name, value in values.items():
        yield f"PARAM {name} {value!r} {_tail(stamp, begin)}"


def _odom(poses: SimulatedPoses, row: int, begin: int) -> str:
    numbers = [*poses.poses[row].tolist(), float(poses.speed[row]), float(poses.yaw_rate[row]), 0.0]
    return f"ODOM {' '.join(map(repr, numbers))} {_tail(int(poses.stamp_ns[row]), begin)}"


def _placed(poses: SimulatedPoses, stamp_ns: Int64) -> Float64:
    """Return (S, 6) the pose of the laser at each stamp, then that of the robot."""
    robot = poses.at(stamp_ns)
    x, y, yaw = robot.T
    ahead, left, turn = poses.mount
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.column_stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left, yaw + turn, robot])


_QUALITY = 47
"""Quality of every return; no return has 0."""


def write_rplidar(path: Path, blocks: Iterable[RawSweeps]) -> None:
    """Write sweeps of one topic to `path`, packed where it ends in `.gz`.

    Bearings are rounded to 0.01 degrees and run clockwise, distances to 0.25 mm; what is no return is 0. The format
    has no place for times, limits, names, and sweeps without beams.
    """
    write_lines(path, _rplidar(blocks))


def _rplidar(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for block in only_topic(blocks, "RPLIDAR text"):
        for row, beams in enumerate(block.beams.tolist()):
            bearings = block.angle_min[row] + block.angle_increment[row] * np.arange(beams)
            ranges = block.ranges[row, :beams].astype(np.float64)
            if block.angle_increment[row] > 0:
                bearings, ranges = bearings[::-1], ranges[::-1]
            theta = np.round(-np.degrees(bearings), 2) % 360.0
            seen = np.isfinite(ranges) & (ranges > 0)
            distance = np.round(np.where(seen, ranges, 0.0) * 4000.0) / 4.0
            begin = "S "
            for angle, far in zip(theta.tolist(), distance.tolist(), strict=True):
                yield f"{begin} theta: {angle:.2f} Dist: {far:08.2f} Q: {_QUALITY if far else 0} "
                begin = "  "


def write_jsonlines(path: Path, blocks: Iterable[RawSweeps]) -> None:
    """Write sweeps as LaserScan messages to `path`, one a line, packed where it ends in `.gz`."""
    write_lines(path, _jsonlines(blocks))


def _jsonlines(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    sequence = 0
    for block in blocks:
        for row in range(len(block)):
            time = f"{np.datetime64(int(block.record_ns[row]), 'ns')}Z"
            line = {
                "topic": block.topic,
                "sequence": sequence,
                "log_time": time,
                "publish_time": time,
                "data": _message(block, row),
            }
            yield json.dumps(line, separators=(",", ":"), allow_nan=False)
            sequence += 1


def _message(block: RawSweeps, row: int) -> dict[str, Any]:
    whole, rest = divmod(int(block.stamp_ns[row]), _S)
    beams = int(block.beams[row])
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    times = [0.0 if each is None else float(each[row]) for each in (block.time_increment, block.scan_time)]
    return {
        "header": {"stamp": {"sec": whole, "nanosec": rest}, "frame_id": block.frame_ids[int(block.frame[row])]},
        "angle_min": first,
        "angle_max": first + (beams - 1) * step,
        "angle_increment": step,
        "time_increment": times[0],
        "scan_time": times[1],
        "range_min": number_or_word(float(block.range_min[row])),
        "range_max": number_or_word(float(block.range_max[row])),
        "ranges": [number_or_word(value) for value in block.ranges[row, :beams].tolist()],
        "intensities": []
        if block.intensities is None
        else [number_or_word(value) for value in block.intensities[row, :beams].tolist()],
    }


def write_csv(path: Path, blocks: Iterable[RawSweeps], layout: str = "rostopic") -> None:
    """Write sweeps of one topic (of several in layout `plotjuggler`); for layout `per-sweep` the path is a folder."""
    if layout != "plotjuggler":
        blocks = only_topic(blocks, "this CSV layout")
    if layout == "per-sweep":
        _write_files(path, blocks)
    else:
        write_lines(path, LAYOUTS[layout](blocks))


def _ros2(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for _, block, row, ranges in sweep_texts(blocks):
        head = [*stamp_parts(block, row), frame_of(block, row)]
        yield ",".join(head + geometry_texts(block, row) + ranges + intensity_texts(block, row, "0.0"))


def _plotjuggler(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    kept = list(blocks)
    widths: dict[str, int] = {}
    bright = {block.topic for block in kept if block.intensities is not None}
    for block in kept:
        widths[block.topic] = max(widths.get(block.topic, 0), block.ranges.shape[1])
    names = ["__time"]
    for topic, width in widths.items():
        names += [f"{topic}/{name}" for name in GEOMETRY] + [f"{topic}/header/stamp"]
        names += [f"{topic}/{name}[{i}]" for name in _arrays(topic in bright) for i in range(width)]
    yield ",".join(names)
    sizes = {topic: len(GEOMETRY) + 1 + width * len(_arrays(topic in bright)) for topic, width in widths.items()}
    for _, block, row, ranges in sweep_texts(kept):
        own = [*geometry_texts(block, row), seconds(int(block.stamp_ns[row]))]
        if block.topic in bright:
            # In the order of their names, as the program writes them.
            own += _filled(intensity_texts(block, row), widths[block.topic])
        own += ranges
        cells = [_filled(own if topic == block.topic else [], size) for topic, size in sizes.items()]
        yield ",".join([seconds(int(block.record_ns[row])), *chain.from_iterable(cells)])


def _arrays(is_bright: bool) -> list[str]:
    return [*(["intensities"] if is_bright else []), "ranges"]


def _filled(cells: list[str], width: int) -> list[str]:
    return cells + [""] * (width - len(cells))


def _bagpy(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    kept = list(blocks)
    width = max((block.ranges.shape[1] for block in kept), default=0)
    is_bright = any(block.intensities is not None for block in kept)
    names = ["Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs", "header.frame_id", *GEOMETRY]
    arrays = ["ranges", *(["intensities"] if is_bright else [])]
    yield ",".join(names + [f"{name}_{i}" for name in arrays for i in range(width)])
    for number, block, row, ranges in sweep_texts(kept):
        head = [seconds(int(block.record_ns[row])), str(number), *stamp_parts(block, row), frame_of(block, row)]
        cells = head + geometry_texts(block, row) + _filled(ranges, width)
        yield ",".join(cells + (_filled(intensity_texts(block, row), width) if is_bright else []))


def _mcap(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    """As `mcap cat --format=csv`: the fields of the first message in the order of the alphabet, float32 as float64."""
    kept = list(blocks)
    width = max((block.ranges.shape[1] for block in kept), default=0)
    arrays = _arrays(any(block.intensities is not None for block in kept))
    sorted_names = sorted(("header.frame_id", "header.stamp.nanosec", "header.stamp.sec", *GEOMETRY, *arrays))
    names = ["log_time", "publish_time", "sequence"]
    for name in sorted_names:
        names += [f"{name}.{i}" for i in range(width)] if name in arrays else [name]
    yield ",".join(names)
    for number, block, row, _ in sweep_texts(kept):
        beams = int(block.beams[row])
        lists = {"ranges": block.ranges, "intensities": block.intensities}
        cells = dict(zip(GEOMETRY, geometry_texts(block, row), strict=True))
        cells["header.frame_id"] = frame_of(block, row)
        cells["header.stamp.sec"], cells["header.stamp.nanosec"] = stamp_parts(block, row)
        for name in arrays:
            values = () if (rows := lists[name]) is None else rows[row, :beams].tolist()
            cells[name] = ",".join(_filled([str(number_or_word(value)) for value in values], width))
        times = [f"{np.datetime64(int(block.record_ns[row]), 'ns')}Z"] * 2
        yield ",".join([*times, str(number), *(cells[name] for name in sorted_names)])


def _list(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    yield ",".join(["time", "header", *GEOMETRY, "ranges", "intensities"])
    for _, block, row, ranges in sweep_texts(blocks):
        whole, rest = stamp_parts(block, row)
        date = str(np.datetime64(int(block.record_ns[row]), "ns")).replace("-", "/").replace("T", " ")
        header = f"{{'stamp': {{'secs': {whole}, 'nsecs': {rest}}}, 'frame_id': '{frame_of(block, row)}'}}"
        yield ",".join([date, f'"{header}"', *geometry_texts(block, row), *_quoted(block, row, ranges)])


def _quoted(block: RawSweeps, row: int, ranges: list[str]) -> list[str]:
    """Return ranges and intensities as lists in quotes."""
    return [f'"[{", ".join(values)}]"' for values in (ranges, intensity_texts(block, row))]


def _drow(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for number, block, row, ranges in sweep_texts(blocks):
        yield ",".join([str(number), seconds(int(block.stamp_ns[row])), *ranges])


def _long(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    yield "sweep,stamp,angle,range"
    for number, block, row, ranges in sweep_texts(blocks):
        head = f"{number},{block.stamp_ns[row]}"
        for angle, value in zip(_bearings(block, row), ranges, strict=True):
            yield f"{head},{angle},{value}"


def _write_files(folder: Path, blocks: Iterable[RawSweeps]) -> None:
    """One file per sweep, named by its stamp in seconds; stamps that are not distinct get running numbers."""
    folder.mkdir(parents=True, exist_ok=True)
    kept = list(blocks)
    stamps = [int(stamp) for block in kept for stamp in block.stamp_ns]
    distinct = all(a < b for a, b in pairwise(stamps))
    for number, block, row, ranges in sweep_texts(kept):
        name = seconds(stamps[number]) if distinct else f"sweep_{number:06d}"
        rows = [f"{a},{r}" for a, r in zip(_bearings(block, row), ranges, strict=True)]
        (folder / f"{name}.csv").write_text("\n".join(["theta,r", *rows]) + "\n")


LAYOUTS: dict[str, Callable[[Iterable[RawSweeps]], Iterator[str]]] = {
    **writers.CSV_LAYOUTS,
    "ros2": _ros2,
    "plotjuggler": _plotjuggler,
    "bagpy": _bagpy,
    "mcap": _mcap,
    "list": _list,
    "drow": _drow,
    "long": _long,
    "per-sweep": _long,
}
"""Names of the layouts, as `write_csv` takes them."""


def _bearings(block: RawSweeps, row: int) -> list[float]:
    angles = block.angle_min[row] + block.angle_increment[row] * np.arange(int(block.beams[row]))
    bearings: list[float] = angles.tolist()
    return bearings


_TEXTS: dict[str, str] = {".log": "carmen", ".clf": "carmen", ".txt": "rplidar", ".jsonl": "jsonl"}


def write_log(
    path: Path,
    blocks: Iterable[RawSweeps],
    *,
    container: str | None = None,
    layout: str | None = None,
    poses: SimulatedPoses | None = None,
    **options: Any,
) -> None:
    """Write sweeps into a log of any container, by its suffix unless told; poses go where they fit."""
    kind = container or next((text for suffix, text in _TEXTS.items() if suffix in path.suffixes), None)
    if kind == "csv" or ".csv" in path.suffixes:
        write_csv(path, blocks, layout or "rostopic")
    elif kind == "carmen":
        write_carmen(path, blocks, poses)
    elif kind in ("rplidar", "jsonl"):
        (write_rplidar if kind == "rplidar" else write_jsonlines)(path, blocks)
    elif options.get("encoding") in ENCODINGS:
        write_foxglove(path, blocks, poses=poses, **options)
    else:
        writers.write_log(path, blocks, container=kind, poses=poses, **options)


def simulate(scene: Path, path: Path, sweeps: int, seed: int = 0, **options: Any) -> None:
    """Ray-cast a scene into a log of any container, without its truth."""
    loaded = load_scene(scene)
    path.unlink(missing_ok=True)
    blocks = [block.raw for block in simulate_blocks(loaded, sweeps, seed)]
    write_log(path, blocks, poses=simulate_odometry(loaded, sweeps, seed), **options)
